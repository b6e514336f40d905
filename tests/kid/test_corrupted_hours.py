"""KID's hourly files and its grid, spoilt in many ways: each is refused for its true reason before the first step."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from experiments.paper_files import GRID_FILE, OCEAN_FILE, SEA_LEVEL_FILE, WIND_FILE
from riftberg.cli.main import app
from riftberg.errors import ForcingError, InputError, NamelistError, RunError
from riftberg.kid.run import load_case, run_kid
from riftberg.system.input_files import allow_extreme

CASES = ("a68_oras5", "a68_story")
ROW, COLUMN = 20, 30


def copied(shared: Path, folder: Path, name: str, **entries: Any) -> Path:
    """Return a copy of a case of the reference that runs six hours."""
    shutil.copytree(shared / "reference" / name, folder, ignore=shutil.ignore_patterns("expected"))
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755)
    text = (folder / "input.nml").read_text()
    for key, value in {"ibhrs": 6, **entries}.items():
        text, count = re.subn(rf"(?im)^(\s*{key}\s*=).*$", rf"\g<1> {value}", text)
        assert count == 1, key
    (folder / "input.nml").write_text(text)
    return folder


def rewritten(
    path: Path, change: Callable[[dict[str, Any], dict[str, dict[str, Any]]], None], kind: str = "f8"
) -> None:
    """Write a file anew, in double precision, its variables and their attributes changed."""
    with netCDF4.Dataset(path) as old:
        sizes = {name: len(d) for name, d in old.dimensions.items()}
        old.set_auto_mask(False)
        values = {name: np.array(v[...], kind) for name, v in old.variables.items()}
        dimensions = {name: v.dimensions for name, v in old.variables.items()}
    attributes: dict[str, dict[str, Any]] = {name: {} for name in values}
    change(values, attributes)
    path.unlink()
    with netCDF4.Dataset(path, "w") as new:
        for name, size in sizes.items():
            new.createDimension(name, size)
        for name, array in values.items():
            where = dimensions.get(name, ())
            if len(where) != array.ndim:  # time, lon and lat of its own, or positions of both axes
                where = ("lat", "lon") if array.ndim == 2 else ("time" if name == "time" else name[:3],)
            fill = attributes.get(name, {}).pop("_FillValue", None)
            variable = new.createVariable(name, array.dtype, where, fill_value=fill)
            variable.set_auto_maskandscale(False)
            variable.setncatts(attributes.get(name, {}))
            variable[...] = array


def everywhere(file: str, names: str, value: float) -> tuple[str, Callable[..., None]]:
    return file, lambda values, _: [values[name].fill(value) for name in names.split()]


def in_a_cell(file: str, names: str, value: float) -> tuple[str, Callable[..., None]]:
    def change(values: dict[str, Any], attributes: dict[str, Any]) -> None:
        for name in names.split():
            values[name][..., ROW, COLUMN] = value

    return file, change


def times(file: str, names: str, factor: float) -> tuple[str, Callable[..., None]]:
    def change(values: dict[str, Any], attributes: dict[str, Any]) -> None:
        for name in names.split():
            values[name] *= factor

    return file, change


def axis(name: str, change: Callable[[np.ndarray], np.ndarray]) -> tuple[str, Callable[..., None]]:
    return GRID_FILE, lambda values, _: values.update({name: change(values[name])})


def shuffled(values: np.ndarray) -> np.ndarray:
    return values[np.random.default_rng(1).permutation(len(values))]


def kid(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["kid", *map(str, arguments)])


CELL = f"in row {ROW + 1}, column {COLUMN + 1}"
FAULTS: dict[str, tuple[tuple[str, Callable[..., None]], tuple[str, ...]]] = {
    # the table of the review
    "currents all NaN": (everywhere(OCEAN_FILE, "uo vo", np.nan), ("variable uo, record", "no number, and not declared")),
    "some currents infinite": (in_a_cell(OCEAN_FILE, "uo", np.inf), ("uo = inf", CELL, "1 of ")),
    "currents of 1e20": (everywhere(OCEAN_FILE, "uo vo", 1e20), ("uo = 1e+20", "5 m s-1", "_FillValue", "allow-extreme")),
    "wind of 1e20": (in_a_cell(WIND_FILE, "ua", 1e20), ("ua = 1e+20", CELL, "80 m s-1")),
    "currents in cm/s": (times(OCEAN_FILE, "uo vo", 100.0), ("variable uo", "the most is 5 m s-1")),
    "sea level all NaN": (everywhere(SEA_LEVEL_FILE, "SSH", np.nan), ("variable SSH", "no number, and not declared")),
    "some sea level NaN": (in_a_cell(SEA_LEVEL_FILE, "SSH", np.nan), ("SSH = nan", CELL, "1 of ")),
    "some sea level infinite": (in_a_cell(SEA_LEVEL_FILE, "SSH", -np.inf), ("SSH = -inf", CELL)),
    "sea level in mm": (times(SEA_LEVEL_FILE, "SSH", 1000.0), ("variable SSH", "the most is 10 m")),
    "wind all NaN": (everywhere(WIND_FILE, "ua va", np.nan), ("variable ua", "record 1 (every hour)")),
    "latitude reversed": (axis("latitude", lambda q: q[::-1]), (GRID_FILE, "variable latitude", "latitude goes from")),
    "longitude reversed": (axis("longitude", lambda q: q[:, ::-1]), (GRID_FILE, "longitude goes from", "must rise")),
    "latitude shuffled": (axis("latitude", shuffled), (GRID_FILE, "variable latitude", "latitude goes from")),
    "latitude with NaN": (in_a_cell(GRID_FILE, "latitude", np.nan), ("not all finite",)),
    # of the same class
    "wind in dm/min": (times(WIND_FILE, "va", 600.0), ("variable va", "80 m s-1")),
    "an undeclared fill of -999": (in_a_cell(SEA_LEVEL_FILE, "SSH", -999.0), ("SSH = -999", CELL)),
    "the library's own fill": (in_a_cell(WIND_FILE, "va", 9.96921e36), ("va = 9.96921e+36", CELL)),
    "longitude jumps by 360": (
        axis("longitude", lambda q: np.where(q > np.median(q), q - 360.0, q)), ("longitude goes from", "jump of 360"),
    ),
    "longitude transposed": (axis("longitude", lambda q: np.broadcast_to(q[0, : len(q), None], q.shape)), ("longitude goes",)),
    "latitude in radians times 100": (axis("latitude", lambda q: np.linspace(-100, 89, q.size).reshape(q.shape)), ("latitude",)),
    "one row of the grid twice": (
        axis("latitude", lambda q: np.concatenate([q[:5], q[4:5], q[5:-1]])), ("column 1", "row 5", "must rise"),
    ),
}  # fmt: skip
"""File and change, and the words that must stand in the message."""


@pytest.mark.quick(10)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_spoilt_file_is_refused_for_its_true_reason(shared: Path, tmp_path: Path, name: str, fault: str) -> None:
    case = copied(shared, tmp_path / "case", name)
    (file, change), words = FAULTS[fault]
    rewritten(case / "data" / file, change)
    with pytest.raises(InputError) as caught:
        load_case(case)
    for word in (*words, *(() if "not all finite" in words else (file,))):
        assert word in str(caught.value)


def test_the_message_names_hour_and_date(shared: Path, tmp_path: Path) -> None:
    """Only what the run needs is looked at: records 206 to 212, of 6 hours."""
    case = copied(shared, tmp_path / "case", "a68_story")

    def spoil(values: dict[str, Any], attributes: dict[str, Any]) -> None:
        values["uo"][[204, 209, 212], 3, 4] = 7.0

    rewritten(case / "data" / OCEAN_FILE, spoil)
    with pytest.raises(
        ForcingError, match=r"variable uo, record 210 \(0001-01-01 04:00:00 of the run\): uo = 7 in row 4,"
    ):
        load_case(case)


def test_what_is_meant_can_be_said(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")
    rewritten(case / "data" / OCEAN_FILE, times(OCEAN_FILE, "uo vo", 10.0)[1])
    with pytest.raises(
        ForcingError, match=r"--allow-extreme \(in Python: riftberg.system.input_files.allow_extreme\(\)\)"
    ):
        load_case(case)
    with allow_extreme():
        loaded = load_case(case)
    assert loaded.model.parameters.stepping.speed_limit == 1000.0
    rewritten(case / "data" / OCEAN_FILE, in_a_cell(OCEAN_FILE, "uo", np.inf)[1])
    with allow_extreme(), pytest.raises(ForcingError, match="is no number"):
        load_case(case)


@pytest.mark.parametrize("fill", [np.nan, -999.0, 1e20])
def test_declared_gaps_stay_gaps(shared: Path, tmp_path: Path, fill: float) -> None:
    """They are still water, as in KID; a record with nothing else is refused."""
    case = copied(shared, tmp_path / "case", "a68_oras5")

    def gap(values: dict[str, Any], attributes: dict[str, Any], rows: Any = slice(ROW, ROW + 1)) -> None:
        for name in ("uo", "vo"):
            values[name][:, rows] = fill
            attributes[name]["_FillValue"] = fill

    rewritten(case / "data" / OCEAN_FILE, gap)
    fields = load_case(case).model.forcing.fields_at(0.0)  # type: ignore[attr-defined]
    halo = 4
    assert (fields.uo[halo + ROW, halo:-halo] == 0.0).all()
    assert (fields.uo[halo + ROW + 1, halo:-halo] != 0.0).any()
    rewritten(case / "data" / OCEAN_FILE, lambda values, attributes: gap(values, attributes, slice(None)))
    with pytest.raises(ForcingError, match=r"variable uo.* holds no value at all, only gaps"):
        load_case(case)


def test_a_fill_of_another_precision_is_declared_all_the_same(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")

    def gap(values: dict[str, Any], attributes: dict[str, Any]) -> None:
        values["SSH"][:, ROW, COLUMN] = 1e20
        attributes["SSH"]["missing_value"] = np.array([-1.0, 1e20])

    rewritten(case / "data" / SEA_LEVEL_FILE, gap, "f4")
    level = load_case(case).model.forcing.fields_at(0.0).ssh  # type: ignore[attr-defined]
    assert np.isnan(level[4 + ROW, 4 + COLUMN]) or level[4 + ROW, 4 + COLUMN] == 0.0


ATTRIBUTES: dict[str, tuple[str, str, dict[str, Any], str]] = {
    "units of cm/s": (OCEAN_FILE, "uo", {"units": "cm s-1"}, "its units are 'cm s-1'.*KID takes the numbers as m s-1"),
    "units of knots": (WIND_FILE, "ua", {"units": "knots"}, "its units are 'knots'"),
    "units of a stress": (WIND_FILE, "va", {"units": "N m-2"}, "its units are 'N m-2'"),
    "a factor in words": (OCEAN_FILE, "vo", {"scale_factor": "tiny"}, "scale_factor = 'tiny' says nothing"),
    "a factor of 0": (SEA_LEVEL_FILE, "SSH", {"scale_factor": 0.0}, "scale_factor = .*that is not 0"),
    "two offsets": (SEA_LEVEL_FILE, "SSH", {"add_offset": np.array([0.0, 1.0])}, "add_offset"),
    "a gap in words": (OCEAN_FILE, "uo", {"missing_value": "none"}, "missing_value = 'none' says nothing"),
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("what", ATTRIBUTES)
def test_attributes_that_say_something_else_are_refused(shared: Path, tmp_path: Path, what: str) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")
    file, name, given, words = ATTRIBUTES[what]
    rewritten(case / "data" / file, lambda _, attributes: attributes[name].update(given))
    with pytest.raises(InputError, match=f"{file}, variable {name}: .*{words}"):
        load_case(case)


def test_units_that_say_the_same_are_taken(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")
    rewritten(case / "data" / OCEAN_FILE, lambda _, a: (a["uo"].update(units="m/s"), a["vo"].update(units="m s-1")))
    load_case(case)


def test_integers_without_their_factor_are_refused(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_story")
    with netCDF4.Dataset(case / "data" / OCEAN_FILE, "a") as dataset:
        dataset["uo"].delncattr("scale_factor")
    with pytest.raises(ForcingError, match=r"variable uo, record 206 .*uo = -?\d+ in row .*the most is 5 m s-1"):
        load_case(case)


@pytest.mark.quick(2)
@pytest.mark.parametrize("what", ["reversed", "shifted", "transposed", "two-dimensional and reversed"])
def test_rows_that_lie_elsewhere_are_refused_where_the_file_says_where(shared: Path, tmp_path: Path, what: str) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")
    with netCDF4.Dataset(case / "data" / GRID_FILE) as grid:
        lon, lat = np.array(grid["longitude"][0]), np.array(grid["latitude"][:, 0])
    load_case(_with_positions(case, lon, lat))
    assert not any("no positions" in note and OCEAN_FILE in note for note in load_case(case).notes)
    if what == "shifted":
        lat = lat + 0.125
    elif what == "transposed":
        lat = np.full_like(lat, lat[0])
    else:
        lat = lat[::-1]
    if what.startswith("two"):
        lon, lat = np.meshgrid(lon, lat)
    with pytest.raises(
        ForcingError, match=rf"{OCEAN_FILE}, variable lat: its lat runs from .* degrees away from the grid's"
    ):
        load_case(_with_positions(case, lon, lat))


def _with_positions(case: Path, lon: np.ndarray, lat: np.ndarray) -> Path:
    rewritten(case / "data" / OCEAN_FILE, lambda values, _: values.update(lon=lon, lat=lat))
    return case


def test_without_positions_it_is_said_that_rows_are_taken_in_the_grids_order(shared: Path, tmp_path: Path) -> None:
    """Currents with their rows reversed cannot be told from others: one line says so before the run."""
    case = copied(shared, tmp_path / "case", "a68_oras5")
    notes = [note for note in load_case(case).notes if "no positions in the file" in note]
    assert len(notes) == 1
    assert all(file in notes[0] for file in (WIND_FILE, OCEAN_FILE, SEA_LEVEL_FILE))
    assert f"in the order of {GRID_FILE}" in notes[0]


def test_dates_are_compared_with_one_another(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_story")

    def dated(file: str, first: float, step: float = 1.0, units: str = "hours since 2020-12-01") -> None:
        def change(values: dict[str, Any], attributes: dict[str, Any]) -> None:
            values["time"] = first + step * np.arange(len(values[next(iter(values))]))
            attributes["time"] = {"units": units}

        rewritten(case / "data" / file, change)

    dated(OCEAN_FILE, 0.0)
    dated(SEA_LEVEL_FILE, 0.0, 1 / 24, "days since 2020-12-01 00:00:00")
    load_case(case)
    dated(SEA_LEVEL_FILE, 24.0)
    with pytest.raises(
        ForcingError, match=rf"{SEA_LEVEL_FILE}.*record 206 is of 2020-12-10 13:00, that of .*2020-12-09 13:00"
    ):
        load_case(case)
    dated(SEA_LEVEL_FILE, 0.0, 6.0)
    with pytest.raises(ForcingError, match="record 1 is of 2020-12-01 00:00:00, record 2 of 2020-12-01 06:00:00"):
        load_case(case)
    dated(SEA_LEVEL_FILE, 743.0, -1.0)
    with pytest.raises(ForcingError, match="hour after hour"):
        load_case(case)


def test_too_few_records_are_refused(shared: Path, tmp_path: Path) -> None:
    """The run needs 212 records; a file of 211 ends before it."""
    case = copied(shared, tmp_path / "case", "a68_story", transient_a68_data_start_ind=740)
    with pytest.raises(ForcingError, match="744 hourly records, but 12 steps from record 740 need 746"):
        load_case(case)


def test_wind_that_is_a_stress_is_held_to_10_pascal(shared: Path, tmp_path: Path) -> None:
    """The case's wind of up to 7 m/s is no stress of 12 Pa."""
    case = copied(shared, tmp_path / "case", "a68_oras5", tau_is_velocity=".false.")
    load_case(case)
    rewritten(case / "data" / WIND_FILE, times(WIND_FILE, "ua va", 2.0)[1])
    with pytest.raises(ForcingError, match=r"variable ua.*the most is 10 Pa"):
        load_case(case)


def test_text_where_numbers_belong_is_called_text(shared: Path, tmp_path: Path) -> None:
    case = copied(shared, tmp_path / "case", "a68_oras5")
    rewritten(case / "data" / GRID_FILE, lambda values, _: values.update(latitude=values["latitude"].astype("S1")))
    with pytest.raises(InputError, match=rf"{GRID_FILE}, variable latitude: holds text, not numbers"):
        load_case(case)
    shutil.copy(shared / "reference" / "a68_oras5" / "data" / GRID_FILE, case / "data" / GRID_FILE)
    with netCDF4.Dataset(case / "data" / OCEAN_FILE, "a") as dataset:
        dataset.renameVariable("uo", "u_old")
        dataset.createVariable("uo", str, ("time", "lat", "lon"))
    with pytest.raises(InputError, match=rf"{OCEAN_FILE}, variable uo: holds text, not numbers"):
        load_case(case)


DRIVER = {
    "ibuo": (20.0, "ibuo = 20 is no current: the most is 5"), "ibvi": (-9.0, "ibvi = -9 is no drift of sea ice"),
    "ibua": (11.0, "ibua = 11 is no wind: the most is 10"), "sst": (1000.0, "a sea surface of 1000 degrees"),
}  # fmt: skip


@pytest.mark.parametrize("entry", DRIVER)
def test_the_uniform_driver_is_held_to_the_same(case: Path, entry: str) -> None:
    from .conftest import namelist_text

    value, words = DRIVER[entry]
    (case / "input.nml").write_text(namelist_text({entry: value}))
    with pytest.raises(NamelistError, match=re.escape(words)):
        load_case(case)
    with allow_extreme():
        load_case(case)


def test_on_the_command_line(shared: Path, tmp_path: Path) -> None:
    """Exit 2 with one line; the notice stands before the run; quiet means that only the files are listed."""
    case = copied(shared, tmp_path / "case", "a68_oras5", ibhrs=1)
    done = kid(case, "-o", tmp_path / "out", "-q")
    assert done.exit_code == 0
    assert done.stdout.splitlines() == [line for line in done.stdout.splitlines() if line.startswith("wrote ")]
    assert "Notice:" in done.stderr
    rewritten(case / "data" / OCEAN_FILE, times(OCEAN_FILE, "uo vo", 10.0)[1])
    done = kid(case, "-o", tmp_path / "out", "-q")
    assert done.exit_code == 2
    assert "allow-extreme" in done.stderr
    assert kid(case, "-o", tmp_path / "out", "-q", "--allow-extreme").exit_code == 0


@pytest.mark.compiled
def test_a_berg_that_the_sea_throws_ends_the_run(shared: Path, tmp_path: Path) -> None:
    """Sea level within 10 m may slope beyond all reason: the speed ends the run, with element, date, force and KID's names."""
    case = copied(shared, tmp_path / "case", "a68_oras5")

    def steep(values: dict[str, Any], attributes: dict[str, Any]) -> None:
        values["SSH"][:] = 9.0 * np.sign(np.sin(np.arange(values["SSH"].shape[2]) * np.pi / 3.0 + 0.1))

    rewritten(case / "data" / SEA_LEVEL_FILE, steep)
    with pytest.raises(RunError) as caught:
        run_kid(case, tmp_path / "t.nc")
    text = str(caught.value)
    for words in (
        "no ice is faster than 10 m/s", "in step ", "0001-01-01", "largest force on it is the slope of the sea surface",
        "--allow-extreme", "id_cnt = ", "id_ij = ", "element ",
    ):  # fmt: skip
        assert words in text
    assert "unstable" not in text
