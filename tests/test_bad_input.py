"""Bad input is refused before the first step, in one message with place, value and remedy; nothing is written half.

Files of KID runs are in ``tests/kid``; here are the model, the built-in ways to make it, and the command line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import A68A_2022, A68A_2022_KID, A68A_2022_MTS, Forcing, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.cli.main import app
from riftberg.errors import BergError, ForcingError, InputError, RunError
from riftberg.experiments.changes import parse_settings
from riftberg.system.input_files import shown

PLACE = (-39.0, -55.0)
EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.25
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  uniform: {current: [0.2, 0.0], slope: [0, 0]}
"""


def berg(placement: tuple[float, float] = PLACE) -> Iceberg:
    """Return a berg of 4 x 2 elements."""
    return Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=placement)


def ocean(mask: Any = None, hours: int = 4, **fields: Any) -> GriddedForcing:
    """Return hourly records of a current on a grid of 16 x 16 cells around the berg."""
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(1, 17), -56.0 + 0.125 * np.arange(1, 17))
    grid = Grid.from_corners(lon, lat, radius_for_metrics=A68A_2022.earth.radius, mask=mask)
    records = [grid.fields(uo=0.2, depth=500.0) for _ in range(hours - 1)]
    records.append(grid.fields(**{"uo": 0.2, "depth": 500.0, **fields}))
    return GriddedForcing(grid, records, 3600.0 * np.arange(hours), source="made for tests")


def refused(model: Model, out: Path, error: type[InputError], *words: str, days: float = 0.125) -> None:
    """Assert that a run is refused, in words, and leaves nothing behind."""
    with pytest.raises(error) as caught:
        model.run(days=days, output=out / "run.nc")
    for word in words:
        assert word in str(caught.value)
    assert not isinstance(caught.value, RunError)
    assert model.step_number == 0
    assert list(out.iterdir()) == []


def test_gap_over_water_names_field_cell_record_and_remedy(tmp_path: Path) -> None:
    wind = np.zeros((16, 16))
    wind[3, 5] = np.nan
    words = ("made for tests", "va is NaN over water in cell (6, 4)", "record 3", "10800 s", "Fill the gap")
    refused(Model(berg(), ocean(va=wind)), tmp_path, ForcingError, *words)


def test_gap_under_land_is_none(tmp_path: Path) -> None:
    wind, mask = np.zeros((16, 16)), np.ones((16, 16))
    wind[3, 5] = np.nan
    mask[3, 5] = 0.0
    assert Model(berg(), ocean(mask, va=wind)).run(days=0.125).sizes["trajectory"] == 8


def test_times_outside_the_forcing(tmp_path: Path) -> None:
    words = ("the run needs 0 s to 21600 s", "cover 0 s to 10800 s", "shorten or shift the run")
    refused(Model(berg(), ocean()), tmp_path, ForcingError, *words, days=0.25)


def test_berg_outside_the_grid(tmp_path: Path) -> None:
    words = ("element 1 at 55.0", "S, 45.0", "outside the grid", "covers 56 S to 54 S, 40 W to 38 W")
    refused(Model(berg((-45.0, -55.0)), ocean()), tmp_path, BergError, *words)


def test_berg_on_land(tmp_path: Path) -> None:
    words = ("on land", "Move the berg, or correct the land mask")
    refused(Model(berg(), ocean(np.zeros((16, 16)))), tmp_path, BergError, *words)


def moved_together() -> Iceberg:
    """Return a berg whose second element has been moved onto the first."""
    made = berg()
    made.elements.lon[1] = made.elements.lon[0] + 0.2 * (made.elements.lon[1] - made.elements.lon[0])
    made.elements.lat[1] = made.elements.lat[0] + 0.2 * (made.elements.lat[1] - made.elements.lat[0])
    return made


def test_overlapping_elements() -> None:
    with pytest.raises(BergError, match=r"elements 1 and 2 overlap: 600.* m apart instead of 3000 m. Place elements"):
        Model(moved_together(), Forcing.uniform())


def test_overlap_stays_possible_with_the_quirks_of_the_reference() -> None:
    Model(moved_together(), Forcing.uniform(), A68A_2022_KID)


def test_a_resumed_berg_may_be_compressed(tmp_path: Path) -> None:
    """Overlap is a mistake of who places a berg; in a run, contact and compression bring elements closer."""
    model = Model(berg(), Forcing.uniform())
    model.step()
    model.elements.lon[:] = model.elements.lon.mean() + 0.98 * (model.elements.lon - model.elements.lon.mean())
    Model.resume(model.save(tmp_path / "a.nc"), Forcing.uniform())


@pytest.mark.parametrize(
    ("name", "value"), [("thickness", 0.0), ("thickness", -1.0), ("mass", 0.0), ("lon", np.nan), ("u", np.inf)]
)
def test_impossible_elements(name: str, value: float) -> None:
    made = berg()
    getattr(made.elements, name)[2] = value
    with pytest.raises(
        InputError, match=rf"element 3 \(row 2\) at .*: {name} is {value:g}. It must be a finite number"
    ):
        Model(made, Forcing.uniform())


def test_zero_thickness_in_the_making_of_a_berg() -> None:
    with pytest.raises(BergError, match=r"element 1 at .*thickness 0 m .*Give a positive thickness"):
        Iceberg.rectangle(12e3, 6e3, thickness=0.0, placement=PLACE)


def test_substep_too_long() -> None:
    with pytest.raises(
        InputError, match=r"stepping.substeps: sub-step of 600 s \(3 in 1800 s\).*Set it to \d+ or more"
    ):
        Model(berg(), Forcing.uniform(), A68A_2022_MTS.changed(stepping={"substeps": 3}))


@pytest.mark.parametrize(
    ("earth", "period"),
    [({}, 360.0), ({"latlon": False}, 0.0), ({"latlon": False, "period": 2e4}, 2e4), ({"period": 0.0}, 0.0)],
)
def test_a_run_in_metres_does_not_keep_the_period_of_degrees(earth: dict[str, Any], period: float) -> None:
    """Without a word, positions of a run in metres came round again after 360 m."""
    p = A68A_2022.changed(earth=earth)
    assert p.earth.period == p.kernel_values().period == period


def test_degrees_and_metres_do_not_mix() -> None:
    metres = Iceberg.rectangle(12e3, 6e3, thickness=200.0, latlon=False)
    with pytest.raises(InputError, match="positions of the berg are metres, those of the parameters degrees"):
        Model(metres, Forcing.uniform())
    flat = Grid.cartesian(20, 20, 1000.0)
    with pytest.raises(InputError, match="positions of the grid of the forcing are metres"):
        Model(berg(), GriddedForcing(flat, flat.fields()))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("fracture.normal_strength=18 m", r"--set fracture.normal_strength=18 m: .*Pa"),
        ("stepping.time_step=30 kg", r"--set stepping.time_step=30 kg: .*(?i:second|s\b)"),
        ("stepping.time_step=soon", r"--set stepping.time_step=soon"),
        ("stepping.time_stp=900", r"no parameter 'time_stp'.*time_step"),
        ("steping.time_step=900", r"no group of parameters is called 'steping'.*stepping"),
    ],
)
def test_wrong_units_and_names_in_settings(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_settings([setting])


def call(folder: Path, text: str, *arguments: str) -> Any:
    """Run an experiment file from the command line, into ``folder/out``."""
    (folder / "berg.yaml").write_text(text)
    return CliRunner().invoke(app, ["run", str(folder / "berg.yaml"), "-o", str(folder / "out"), "-q", *arguments])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("length: 12 km", "length: 12 kg", ("line 4", "length", "12 kg")),
        ("length: 12 km", "length: -12 km", ("line 4", "length", "-12000", "Allowed: a number > 0 ")),
        ("length: 12 km", "lenght: 12 km", ("line 4", "lenght", "length")),
        ("days: 0.25", "days: 0.25 m", ("line 2", "days", "0.25 m")),
        ("  rectangle:", "  thickness: 0 m\n  rectangle:", ("thickness 0 m", "Give a positive thickness")),
        ("  uniform: {current: [0.2, 0.0], slope: [0, 0]}", "  kind: files\n  files: [none.nc]\n  longitude: [-41, -37]\n"
         "  latitude: [-57, -54]", ("no file matches 'none.nc'", "forcing.files")),
    ],
)  # fmt: skip
def test_a_bad_experiment_file_leaves_nothing_behind(
    tmp_path: Path, old: str, new: str, words: tuple[str, ...]
) -> None:
    result = call(tmp_path, EXPERIMENT.replace(old, new))
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_file_cut_short_is_named(tmp_path: Path) -> None:
    pytest.importorskip("cf_xarray")
    lon, lat = np.arange(-43.0, -34.9, 0.5), np.arange(-59.0, -51.9, 0.5)
    current = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}
    coords = {"lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
              "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"})}  # fmt: skip
    field = xr.DataArray(np.zeros((lat.size, lon.size)), coords, ("lat", "lon"), "u", current)
    field.to_netcdf(tmp_path / "currents.nc")
    whole = (tmp_path / "currents.nc").read_bytes()
    (tmp_path / "currents.nc").write_bytes(whole[: len(whole) // 2])
    files = "  kind: files\n  files: [currents.nc]\n  longitude: [-41, -37]\n  latitude: [-57, -54]\n"
    result = call(tmp_path, EXPERIMENT[: EXPERIMENT.index("  uniform")] + files)
    assert result.exit_code == 2, result.output
    assert "currents.nc" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_restart_cut_short_is_named(tmp_path: Path, share: float) -> None:
    path = Model(berg(), Forcing.uniform()).save(tmp_path / "a.restart.nc")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"a.restart.nc: (not readable as NetCDF-4|the file is empty)"):
        Model.resume(path, Forcing.uniform())
    path.unlink()
    with pytest.raises(InputError, match=r"a.restart.nc: no such file"):
        Model.resume(path, Forcing.uniform())


class Failing(Forcing.uniform):
    """An environment that is lost at some time, or turns into nonsense."""

    def __init__(self, after: float, error: BaseException | None = None) -> None:
        super().__init__(current=(0.2, 0.1), slope=(0.0, 0.0))
        self.after, self.error = after, error

    def sample(self, elements: Any, time: float) -> None:
        """Fill the environment, or fail."""
        super().sample(elements, time)
        if time >= self.after:
            if self.error is not None:
                raise self.error
            elements.uo[:] = np.nan


@pytest.mark.parametrize("scheme", ["mts", "quasi_static"])
def test_a_failure_in_a_run_saves_the_state_and_says_how_to_go_on(tmp_path: Path, scheme: str) -> None:
    """The water at the end of a step belongs to the state: one with none could not be gone on with."""
    model = Model(berg(), Failing(5400.0), Parameters(stepping={"scheme": scheme, "time_step": 1800.0}))
    with pytest.raises(
        RunError,
        match=r"the run failed at .*step 3 .*reason is the forcing: uo = nan.*Go on with Model.resume\('.*run.failed",
    ):
        model.run(days=0.25, output=tmp_path / "run.nc")
    assert model.step_number == 2
    assert xr.open_dataset(tmp_path / "run.nc").sizes["time"] >= 2
    resumed = Model.resume(tmp_path / "run.failed.restart.nc", Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0)))
    np.testing.assert_array_equal(resumed.elements.lon, model.elements.lon)
    resumed.advance(steps=1)
    assert np.isfinite(resumed.elements.lon).all()


def test_a_failure_without_a_file_leaves_the_model_at_its_last_good_state() -> None:
    for scheme in ("mts", "quasi_static"):
        model = Model(berg(), Failing(5400.0), Parameters(stepping={"scheme": scheme, "time_step": 1800.0}))
        with pytest.raises(RunError, match="left at its last good state"):
            model.run(days=0.25)
        assert np.isfinite(model.elements.lon).all()
        assert model.time == 2 * 1800.0


@pytest.mark.parametrize("error", [ForcingError("the disk is gone"), KeyboardInterrupt(), ValueError("a bug")])
def test_any_failure_within_a_step_leaves_the_state_before_it(error: BaseException) -> None:
    """Once only RunError took the state back; a failure of the forcing left positions a step ahead of the step number."""
    model = Model(berg(), Failing(3600.0, error), Parameters(stepping={"time_step": 1800.0}))
    model.step()
    before = model.time, model.elements.lon.copy(), list(model.fragments.rows)
    with pytest.raises(type(error)):
        model.step()
    assert model.time == before[0]
    np.testing.assert_array_equal(model.elements.lon, before[1])
    assert model.fragments.rows == before[2]


@pytest.mark.slow
def test_a_failure_on_the_command_line_can_be_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def sample(self: Forcing, elements: Any, time: float) -> None:
        whole(self, elements, time)
        if time >= 5400.0:
            raise ForcingError("the disk is gone", where="currents.nc")

    whole = Forcing.sample
    monkeypatch.setattr(Forcing, "sample", sample)
    result = call(tmp_path, EXPERIMENT, "--no-map")
    assert result.exit_code == 2, result.output
    assert "currents.nc: the disk is gone" in result.stderr
    restart = tmp_path / "out" / "failed.restart.nc"
    assert f"--resume {restart}" in result.stderr
    monkeypatch.setattr(Forcing, "sample", whole)
    result = call(tmp_path, EXPERIMENT, "--no-map", "--resume", str(restart))
    assert result.exit_code == 0, result.output


def test_a_word_of_thousands_of_letters_is_not_given_back_whole() -> None:
    """A date or a name of 3000 letters filled the screen, wherever it stood in a message."""
    error = InputError(f"{'w' * 3000!r} is no date", where=f"berg.yaml, {'v' * 3000}", remedy="Give a date")
    assert len(str(error)) < 300
    assert str(error).endswith("is no date. Give a date")


def test_names_in_messages_stand_on_one_line_and_are_not_too_long() -> None:
    assert shown("a.nc") == "a.nc"
    assert shown("x" * 300) == "x" * 300
    assert shown("x" * 301) == f"{'x' * 140} ... {'x' * 140}"
    assert shown("two\nlines") == "two\\nlines"
