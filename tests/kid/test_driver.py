"""Grid, forcing, length and beam loads of KID's stand-alone driver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from experiments.paper_files import GRID_FILE, OCEAN_FILE, SEA_LEVEL_FILE, WIND_FILE
from riftberg import Grid
from riftberg.errors import ForcingError, InputError, NamelistError
from riftberg.kid import a68
from riftberg.kid.driver import build_clock, build_grid, driver_forcing, uniform_fields
from riftberg.kid.parameters import KidNamelist, read_namelist
from riftberg.kid.run import apply_beam_test
from riftberg.state import new_elements

from .conftest import namelist_text

HALO = 4


def written(tmp_path: Path, driver: dict[str, Any] | None = None, **icebergs: Any) -> KidNamelist:
    (tmp_path / "input.nml").write_text(namelist_text(driver, icebergs))
    return read_namelist(tmp_path / "input.nml")


@pytest.mark.parametrize(
    ("changes", "steps"),
    [
        ({"ibhrs": 2}, 12),
        ({"ibhrs": 2, "nmax": 5}, 5),
        ({"ibhrs": 1, "ibdt": 700.0}, 6),
        ({"ibhrs": 1, "ibdt": 7200.0}, 1),
    ],
)
def test_number_of_steps(tmp_path: Path, changes: dict[str, Any], steps: int) -> None:
    assert build_clock(written(tmp_path, changes)).steps == steps


def test_no_steps(tmp_path: Path) -> None:
    with pytest.raises(NamelistError, match="nmax = 0"):
        build_clock(written(tmp_path, {"nmax": 0}))


def test_start_index_355_starts_later(tmp_path: Path) -> None:
    late = {"a68_test": True, "transient_a68_data_start_ind": 355}
    assert str(build_clock(written(tmp_path, late)).date(0.0)) == "0001-01-07 05:00:00"
    assert build_clock(written(tmp_path, {**late, "a68_test": False})).offset == 0.0


def test_collision_currents(tmp_path: Path) -> None:
    """Section 10.2: towards y = 10 km for 0 < x <= 10 km, none east of it."""
    namelist = written(tmp_path, {"collision_test": True, "ibvo": 0.2}, Lx=20e3)
    grid = build_grid(namelist, tmp_path)
    assert grid.arrays.cyclic
    vo = uniform_fields(namelist.driver, namelist.icebergs, grid).vo[HALO : HALO + 20, HALO : HALO + 20]
    column = np.concatenate([np.full(9, 0.2), [0.0], np.full(10, -0.2)])
    np.testing.assert_array_equal(vo[:, :10], np.repeat(column[:, None], 10, axis=1))
    np.testing.assert_array_equal(vo[:, 10:], 0.0)


def test_footloose_currents_turn(tmp_path: Path) -> None:
    namelist = written(tmp_path, {"fl_test": True, "ibvo": 0.1})
    vo = uniform_fields(namelist.driver, namelist.icebergs, build_grid(namelist, tmp_path)).vo
    assert vo[10, HALO + 9] == 0.1
    assert vo[10, HALO + 10] == -0.1


def test_wind_is_a_stress_unless_said_otherwise(tmp_path: Path) -> None:
    for flag, wind in ((False, -1.0 / np.sqrt(0.0015)), (True, -1.0)):
        namelist = written(tmp_path, {"ibua": -1.0}, tau_is_velocity=flag)
        fields = uniform_fields(namelist.driver, namelist.icebergs, build_grid(namelist, tmp_path))
        assert fields.ua[10, 10] == pytest.approx(wind, rel=1e-14)
        assert fields.va[10, 10] == 0.0


def test_temperature_in_kelvin(tmp_path: Path) -> None:
    namelist = written(tmp_path, {"sst": 274.15})
    fields = uniform_fields(namelist.driver, namelist.icebergs, build_grid(namelist, tmp_path))
    assert fields.sst[10, 10] == pytest.approx(1.0)


SEAMOUNT = {"ni": 45, "nj": 45, "gridres": 5000.0, "big_grounding_test": True, "bump_depth": 50.0, "ibvo": 0.1}


def test_seamount(tmp_path: Path) -> None:
    """Section 10.4: shifted corners, land in the top row, depth of a Gaussian bump."""
    namelist = written(tmp_path, SEAMOUNT, Lx=225e3)
    grid = build_grid(namelist, tmp_path)
    g = grid.arrays
    assert g.lon[HALO, HALO] == 5000.0 - 0.45
    assert g.mask[HALO + 43, HALO] == 1.0
    assert g.mask[HALO + 44, HALO] == 0.0
    assert g.mask[HALO - 1, HALO] == 1.0
    assert g.mask[HALO - 2, HALO] == 0.0
    depth = uniform_fields(namelist.driver, namelist.icebergs, grid).depth
    dx, dy = 65e3 - 0.45 - 2500.0 - 63e3, 60e3 - 0.45 - 2500.0 - 60e3
    expected = 1000.0 - 950.0 * np.exp(-(dx**2 + dy**2) / (2 * 5e3**2))
    assert depth[HALO + 11, HALO + 12] == pytest.approx(expected, abs=1e-9)


def test_grounding_case_sees_the_depth_of_the_reference(shared: Path) -> None:
    """The biquadratic depth at the recorded positions of the reference is the recorded depth."""
    case = shared / "reference" / "dem_ground_frac"
    namelist = read_namelist(case / "input.nml")
    grid = build_grid(namelist, case)
    forcing = driver_forcing(namelist, grid, case, build_clock(namelist))
    with netCDF4.Dataset(case / "expected" / "trajectories.nc") as dataset:
        elements = new_elements(len(dataset.dimensions["i"]))
        elements.lon[:], elements.lat[:] = dataset["lon"][:], dataset["lat"][:]
        expected, uo = np.array(dataset["od"][:]), np.array(dataset["uo"][:])
    elements.lon_pair[:], elements.lat_pair[:] = elements.lon, elements.lat
    grid.locate(elements)
    forcing.sample(elements, 0.0)
    np.testing.assert_allclose(elements.depth, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(elements.uo, uo, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("driver", "icebergs", "words"),
    [
        ({"ni": 0}, {}, "ni = 0"),
        ({}, {"grid_is_latlon": True}, "grid_is_latlon = True, but the driver's grid is in metres"),
        ({"a68_test": True}, {}, "grid_is_latlon = False, but the driver's grid is in degrees"),
        ({}, {"Lx": 30e3}, "Lx = 30000.0 m, but the driver's grid spans"),
        ({"big_grounding_test": True}, {}, "big_grounding_test with gridres = 1000.0"),
    ],
)
def test_impossible_grids(tmp_path: Path, driver: dict[str, Any], icebergs: dict[str, Any], words: str) -> None:
    with pytest.raises(NamelistError, match=words):
        build_grid(written(tmp_path, driver, **icebergs), tmp_path)


A68 = {"a68_test": True, "ibdt": 1800.0, "ibhrs": 3, "transient_a68_data_start_ind": 2, "data_dir": "./data/"}
A68_ICE = {"grid_is_latlon": True, "Lx": 360.0, "A68_test": True, "A68_xdisp": -39.8, "A68_ydisp": -59.9,
           "tau_is_velocity": True}  # fmt: skip


def a68_data(folder: Path, hours: dict[str, int], packed: bool = False) -> None:
    """Write data files whose value is 0.1 x hour (counted from 1)."""
    folder.mkdir()
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(8), -60.0 + 0.125 * np.arange(6))
    with netCDF4.Dataset(folder / GRID_FILE, "w") as grid:
        grid.createDimension("lat", 6)
        grid.createDimension("lon", 8)
        grid.createVariable("longitude", "f8", ("lat", "lon"))[:] = lon
        grid.createVariable("latitude", "f8", ("lat", "lon"))[:] = lat
    for file, names in ((WIND_FILE, "ua va"), (OCEAN_FILE, "uo vo"), (SEA_LEVEL_FILE, "SSH")):
        with netCDF4.Dataset(folder / file, "w") as dataset:
            for name, size in (("time", hours[file]), ("lat", 6), ("lon", 8)):
                dataset.createDimension(name, size)
            for name in names.split():
                variable = dataset.createVariable(name, "i2" if packed else "f8", ("time", "lat", "lon"))
                variable.set_auto_maskandscale(False)
                values = np.arange(1, hours[file] + 1)[:, None, None] * np.ones((1, 6, 8))
                if packed:
                    variable.scale_factor = 0.1
                variable[:] = values if packed else 0.1 * values


ALL = (WIND_FILE, OCEAN_FILE, SEA_LEVEL_FILE)


@pytest.mark.parametrize(("west", "east"), [(-10.0, 175.0), (5.0, 5.0), (350.0, -9.0)])
def test_corners_more_than_half_a_turn_apart_or_backwards_are_no_row(west: float, east: float) -> None:
    lat = np.array([[-56.0, -56.0], [-55.0, -55.0]])
    a68._check_axes(np.array([[west, west + 1.0]] * 2), lat, Path("grid.nc"))
    with pytest.raises(ForcingError, match=f"longitude goes from {west:g} to {east:g} at column 1 of row 1"):
        a68._check_axes(np.array([[west, east]] * 2), lat, Path("grid.nc"))


def a68_forcing(tmp_path: Path, **changes: Any) -> tuple[Any, Any]:
    namelist = written(tmp_path, {**A68, **changes}, **A68_ICE)
    grid = build_grid(namelist, tmp_path)
    return driver_forcing(namelist, grid, tmp_path, build_clock(namelist)), grid


@pytest.mark.parametrize("packed", [False, True])
def test_a68_half_hours(tmp_path: Path, packed: bool) -> None:
    """Step n at hour start + (n - 1) / 2; half hours are means, but the sea level is that of the hour before."""
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 6), packed)
    forcing, grid = a68_forcing(tmp_path)
    g = grid.arrays
    assert g.lon[HALO, HALO] == 320.0
    assert not g.cyclic
    assert grid.earth_radius == 6.378e6
    for step, hour, level in ((1, 2.0, 2), (2, 2.5, 2), (3, 3.0, 3), (4, 3.5, 3), (6, 4.5, 4)):
        fields = forcing.fields_at((step - 1) * 1800.0)
        assert fields.uo[HALO + 2, HALO + 2] == pytest.approx(0.1 * hour, abs=1e-15)
        assert fields.va[HALO + 2, HALO + 2] == pytest.approx(0.1 * hour, abs=1e-15)
        assert fields.ssh[HALO + 2, HALO + 2] == pytest.approx(0.1 * level, abs=1e-15)


def test_a68_single_records_are_constant(tmp_path: Path) -> None:
    a68_data(tmp_path / "data", {WIND_FILE: 1, OCEAN_FILE: 6, SEA_LEVEL_FILE: 1})
    forcing, _ = a68_forcing(tmp_path)
    fields = forcing.fields_at(5400.0)
    assert fields.ua[HALO, HALO] == pytest.approx(0.1)
    assert fields.uo[HALO, HALO] == pytest.approx(0.35)


def test_a68_wholly_constant_serves_any_time_and_step(tmp_path: Path) -> None:
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 1))
    forcing, _ = a68_forcing(tmp_path, ibdt=600.0, ibhrs=5000)
    assert forcing.fields_at(1e7).vo[HALO, HALO] == pytest.approx(0.1)


def test_a68_records_must_last(tmp_path: Path) -> None:
    """Six steps from record 2 end half way between records 4 and 5."""
    a68_data(tmp_path / "data", {**dict.fromkeys(ALL, 6), WIND_FILE: 5})
    a68_forcing(tmp_path)
    with pytest.raises(ForcingError, match=rf"{WIND_FILE}.*5 hourly records, but 8 steps from record 2 need 6"):
        a68_forcing(tmp_path, ibhrs=4)


def test_a68_errors(tmp_path: Path) -> None:
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 6))
    with pytest.raises(NamelistError, match="transient_a68_data_start_ind = 0"):
        a68_forcing(tmp_path, transient_a68_data_start_ind=0)
    with pytest.raises(NamelistError, match="ibdt = 600"):
        a68_forcing(tmp_path, ibdt=600.0)
    with pytest.raises(InputError, match="no such file"):
        a68_forcing(tmp_path, data_dir="elsewhere/")
    with netCDF4.Dataset(tmp_path / "data" / SEA_LEVEL_FILE, "a") as dataset:
        dataset.renameVariable("SSH", "zos")
    with pytest.raises(InputError, match=r"no variable 'SSH' \(found: zos\)"):
        a68_forcing(tmp_path)


def test_a68_without_depth_cannot_ground(tmp_path: Path) -> None:
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 6))
    namelist = written(tmp_path, A68, **{**A68_ICE, "A68_test": False, "cdrag_grounding": 1e4})
    grid = build_grid(namelist, tmp_path)
    with pytest.raises(NamelistError, match="knows no depth"):
        driver_forcing(namelist, grid, tmp_path, build_clock(namelist))


def test_gaps_in_currents_are_still_water(tmp_path: Path) -> None:
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 1))
    with netCDF4.Dataset(tmp_path / "data" / OCEAN_FILE, "a") as dataset:
        dataset["uo"].missing_value = np.nan
        dataset["uo"][0, 2, 2] = np.nan
    forcing, _ = a68_forcing(tmp_path)
    assert forcing.fields_at(0.0).uo[HALO + 2, HALO + 2] == 0.0


@pytest.mark.parametrize(("step_scheme", "depth"), [(True, 0.0), (False, 1000.0)])
def test_dry_quadrant_needs_multiple_time_steps(tmp_path: Path, step_scheme: bool, depth: float) -> None:
    """Quirks Q18, Q19."""
    a68_data(tmp_path / "data", dict.fromkeys(ALL, 1))
    namelist = written(tmp_path, A68, **{**A68_ICE, "mts": step_scheme})
    grid = build_grid(namelist, tmp_path)
    forcing = driver_forcing(namelist, grid, tmp_path, build_clock(namelist))
    elements = new_elements(1)
    elements.lon[:], elements.lat[:] = 320.4, -59.7
    grid.locate(elements)
    forcing.sample(elements, 0.0)
    level = 0.1 if depth > 0 else 0.0
    assert elements.depth[0] == pytest.approx(depth + level)


def test_beam_loads() -> None:
    """Section 10.3."""
    row = new_elements(29)
    row.lon[:] = 101000 + 0.5 * np.arange(29)
    apply_beam_test(row, 1)
    assert row.free_y.tolist() == [0.0] + [1.0] * 27 + [0.0]
    assert row.load_y.nonzero()[0].tolist() == [14]
    assert row.load_y[14] == -1.5e5
    block = new_elements(90)
    block.lon[:] = 101000 + 5000 * (np.arange(90) % 30)
    apply_beam_test(block, 2)
    assert block.load_y.sum() == pytest.approx(-1.5e10)
    assert (block.load_y != 0).sum() == 3
    assert block.free_y.all()
    apply_beam_test(row, 3)
    assert (row.load_y != 0).sum() == 1


def test_closed_ends_without_period(tmp_path: Path) -> None:
    grid = build_grid(written(tmp_path), tmp_path)
    assert isinstance(grid, Grid)
    assert not grid.arrays.cyclic
