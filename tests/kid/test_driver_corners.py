"""Corners of KID's drivers beside those of the parity cases: equal sizes, hours, edges, depths, births, tides, broken bonds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import Grid
from riftberg.engines.common.stepper import update_fragments
from riftberg.errors import BergError, InputError, NamelistError
from riftberg.kid.a68 import HourlyFile
from riftberg.kid.restart import write_stores
from riftberg.life.calving import Stores

from . import scenes
from .test_mixed_options import DEM, DRIFT, PAIR, SINGLE, read, records, run

CALVING_FILE = "calving.res.nc"
DEPTH_FILE = "topog.nc"

TWINS = {"lon": [5500.0, 5500.0], "lat": [5500.0, 5500.0], "thickness": [200.0, 200.0]}
LOOSE = {**SINGLE, "iceberg_bonds_on": False, "manually_initialize_bonds": False}


# ------------------------------------------------------------------------------------------------- equal sizes


@pytest.mark.parametrize("other", [199.99999999999997, 200.0 * (1.0 + 1e-12)])
def test_thickness_is_equal_up_to_round_off(tmp_path: Path, other: float) -> None:
    run(
        tmp_path / "case",
        {**DRIFT, "nmax": 1},
        {**DEM, "save_bond_forces": False},
        **{**PAIR, "thickness": [200.0, other]},
    )


def test_radii_that_differ_by_round_off_do_not_save_unequal_thickness(tmp_path: Path) -> None:
    """Whether their squares are equal to the last digit would decide which thickness KID takes."""
    sides = [400.0, np.nextafter(400.0, 0.0)]
    with pytest.raises(NamelistError, match=r"save_bond_forces = .false. with bonded elements of 200 and 150 m"):
        run(tmp_path / "case", DRIFT, {**DEM, "save_bond_forces": False}, **{**PAIR, "width": sides, "length": sides})


def test_the_spacing_of_the_seamount_is_equal_up_to_round_off() -> None:
    scenes.run("seamount", "dem", {"gridres": 5000.0 * (1.0 + 1e-15), "nmax": 1})


def test_hours_counted_in_days_are_whole_hours(tmp_path: Path) -> None:
    """A little before the hour and a little after it are the same date."""
    grid = Grid.from_corners(*np.meshgrid(np.arange(3.0), np.arange(2.0)))
    dates = []
    for shift in (-2e-6, 2e-6):
        path = tmp_path / f"{shift}.nc"
        with netCDF4.Dataset(path, "w") as dataset:
            for name, size in (("time", 3), ("lat", 2), ("lon", 3)):
                dataset.createDimension(name, size)
            dataset.createVariable("SSH", "f8", ("time", "lat", "lon"))[:] = 0.0
            time = dataset.createVariable("time", "f8", ("time",))
            time.units, time[:] = "days since 2020-12-01", np.arange(3) / 24.0 + shift
        dates.append(HourlyFile(path, ("SSH",), grid).dates())
    assert dates[0] == dates[1] == ["2020-12-01 00:00", "2020-12-01 01:00", "2020-12-01 02:00"]


# ---------------------------------------------------------------------------------------- hours, edges, one spot


@pytest.mark.quick(1)
@pytest.mark.parametrize("dt", [3600.0, 5400.0, 7200.0])
def test_a_step_takes_the_hour_at_which_it_begins(dt: float) -> None:
    """At half hours currents and wind are means of two records, the sea level is that of the earlier one."""
    case = scenes.run("a68", "dem", {"ibdt": dt, "nmax": 3}).report.case
    hours = [case.model.forcing.fields_at(3600.0 * k) for k in range(5)]
    k, half = divmod(2.0 * dt / 3600.0, 1.0)
    fields = case.model.forcing.fields_at(2.0 * dt)
    assert half == 0.0
    np.testing.assert_array_equal(fields.uo, hours[int(k)].uo)
    between = case.model.forcing.fields_at(1800.0)
    np.testing.assert_allclose(between.ua, 0.5 * (hours[0].ua + hours[1].ua), rtol=1e-15)
    np.testing.assert_array_equal(between.ssh, hours[0].ssh)


@pytest.mark.parametrize("dt", [900.0, 1200.0, 4000.0])
def test_steps_between_half_hours_are_refused(dt: float) -> None:
    with pytest.raises(NamelistError, match="between whole and half hours, for which the driver has no rule"):
        scenes.run("a68", "dem", {"ibdt": dt, "nmax": 2})


def placed(scene: str, count: int, **values: Any) -> Callable[[Path], None]:
    """Return what puts some bergs of a scene, without bonds, into the restart of a run folder."""
    some = {name: np.array(array)[:count] for name, array in scenes.bergs(scene).items()}
    some |= {name: np.asarray(array) for name, array in values.items()}
    some["mass"] = 850.0 * some["thickness"] * some["length"] * some["width"]
    return lambda folder: scenes.write_nc(folder / "INPUT" / "icebergs.res.nc", some) and None


NO_BONDS = {"iceberg_bonds_on": False, "manually_initialize_bonds": False, "max_bonds": 0}
EDGES = {"east": (321.12, -59.5, 2.0, 0.0), "west": (319.88, -59.5, -2.0, 0.0), "north": (320.5, -59.13, 0.0, 2.0),
         "south": (320.5, -60.12, 0.0, -2.0)}  # fmt: skip


@pytest.mark.quick(4)
@pytest.mark.parametrize("scheme", ["verlet", "runge", "springs"])
@pytest.mark.parametrize("edge", EDGES)
def test_elements_leave_a_grid_in_degrees_over_every_edge(scheme: str, edge: str) -> None:
    """One of two bergs goes fast over the edge beside it; the other one stays."""
    lon, lat, u, v = EDGES[edge]
    bergs = placed("a68", 2, lon=[lon, 320.6], lat=[lat, -59.7], uvel=[u, 0.0], vvel=[v, 0.0], start_lon=[1.0, 2.0])
    entries = {**NO_BONDS, "A68_test": False, "cdrag_grounding": 0.0}
    done = scenes.run("a68", scheme, {"nmax": 3}, entries, prepare=bergs)
    assert done.state["start_lon"].tolist() == [2.0]


def test_bergs_on_one_spot_need_no_distance(tmp_path: Path) -> None:
    """Bergs of one place of birth, and two that lie 0.1 m apart, with contact: those on one spot do not push each other."""
    for name, apart in (("spot", 0.0), ("near", 0.1)):
        entries = {**LOOSE, "interactive_icebergs_on": True}
        now = records(
            run(tmp_path / name, {**DRIFT, "nmax": 2}, entries, **{**TWINS, "lat": [5500.0, 5500.0 + apart]})
        )[-1]
        assert np.isfinite(now["lon"]).all()
        assert bool(abs(now["lat"][1] - now["lat"][0]) > apart) is (apart > 0.0)
    with pytest.raises(BergError, match="two elements with a bond lie on top of each other, 0 m apart"):
        run(tmp_path / "bonded", DRIFT, DEM, **TWINS)


# ------------------------------------------------------------------------------------- entries that do nothing


def depth_file(value: float) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        with netCDF4.Dataset(folder / "INPUT" / DEPTH_FILE, "w") as dataset:
            dataset.createDimension("j", 20)
            dataset.createDimension("i", 20)
            dataset.createVariable("depth", "f8", ("j", "i"))[:] = value

    return write


def test_the_depth_of_a_file_is_that_of_the_water() -> None:
    """It stops bergs; without a file the depth is the driver's, and the run says so."""
    entries = {"read_ocean_depth_from_file": True, "cdrag_grounding": 1e5}
    deep, none, shallow = (
        scenes.run("berg", "verlet", {}, {**entries, **more}, **{"prepare": prepare} if prepare else {})
        for more, prepare in (({"read_ocean_depth_from_file": False}, None), ({}, None), ({}, depth_file(100.0)))
    )
    np.testing.assert_array_equal(none.state["uvel"], deep.state["uvel"])
    assert any("there is no" in note and DEPTH_FILE in note for note in none.report.case.notes)
    assert (np.abs(shallow.state["uvel"]) < np.abs(deep.state["uvel"])).all()
    assert shallow.said("read_ocean_depth_from_file").startswith("honoured")


@pytest.mark.quick(1)
@pytest.mark.parametrize("entry", ["generate_test_icebergs", "add_iceberg_thickness_to_SSH"])
def test_what_does_nothing_is_accepted_and_said(entry: str) -> None:
    done = scenes.run("berg", "verlet", {}, {entry: True, "add_weight_to_ocean": False})
    plain = scenes.run("berg", "verlet", {}, {"add_weight_to_ocean": False})
    assert scenes.same(done.files, plain.files)
    assert done.said(entry).startswith("no effect here: there is")


def test_what_acts_is_refused() -> None:
    for scene, scheme, entries in (
        ("berg", "verlet", {"add_weight_to_ocean": True}),
        ("ocean", "verlet", {}),
        ("a68", "dem", {}),
    ):
        with pytest.raises(NamelistError, match="the weight of bergs is not added to the sea level"):
            scenes.run(scene, scheme, {}, {**entries, "add_iceberg_thickness_to_SSH": True})
    with pytest.raises(InputError, match="bergs are read from a restart file only"):
        scenes.run(
            "ocean", "verlet", {}, {"generate_test_icebergs": True},
            prepare=lambda folder: (folder / "INPUT" / "icebergs.res.nc").unlink(),
        )  # fmt: skip


# --------------------------------------------------------------------------------------------- melt and births

SHELF = {
    "melt_icebergs_as_ice_shelf": True, "apply_thickness_cutoff_to_bergs_melt": True, "set_melt_rates_to_zero": False,
    "ustar_icebergs_bg": 0.01,
}  # fmt: skip


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("scheme", "cutoff", "melts"), [("verlet", 20.1, False), ("verlet", 19.9, True), ("springs", 20.1, False)]
)
def test_the_sea_level_does_not_count_in_the_cutoff_of_melt(scheme: str, cutoff: float, melts: bool) -> None:
    """Column 5 of the ocean is 200 m deep and its level 0.05 m: under a keel of 180 m there are 20 m by the floor."""
    thickness = 180.0 * 1025.0 / 850.0
    berg = placed("ocean", 1, lon=[22_500.0], lat=[22_500.0], uvel=[0.0], vvel=[0.0], thickness=[thickness])
    entries = {**SHELF, **NO_BONDS, "melt_cutoff": cutoff, "Static_icebergs": True}
    done = scenes.run("ocean", scheme, {"sst0": 3.0, "calv0": 0.0}, entries, prepare=berg)
    assert bool(done.state["thickness"].min() < thickness) is melts


def full_stores(folder: Path) -> None:
    """Put ice for one berg of the first class, and a little more, into the stores of a cell."""
    stores = Stores.empty(10, Grid.cartesian(20, 20, 1000.0))
    stores.ice[0, 5, 5] = 8.8e7 * 2000.0 * 1.001
    write_stores(folder / "INPUT" / CALVING_FILE, stores)


MELTS = {"set_melt_rates_to_zero": False, "passive_mode": False}


@pytest.mark.parametrize("scheme", ["verlet", "springs"])
def test_melt_that_the_driver_gets_back_calves(scheme: str) -> None:
    """From stores that hold enough for one berg already, it is born in the first step; with passive_mode none is."""
    done = scenes.run("berg", scheme, {"sst": 3.0}, MELTS, prepare=full_stores)
    count = len(scenes.bergs("berg")["lon"])
    assert done.state["lon"].size == count + 1
    assert 8.8e7 in done.state["start_mass"]
    assert any("bergs calve where ice melts" in note for note in done.report.case.notes)
    assert done.said("passive_mode").startswith("honoured")
    with pytest.raises(NamelistError, match="enough to calve a berg"):
        scenes.run("berg", scheme, {"sst": 3.0}, {**MELTS, "passive_mode": True}, prepare=full_stores)


def test_water_that_comes_back_is_in_the_stores() -> None:
    """All but that of the last step; a hundredth is of no class and goes round once more."""

    def empty(folder: Path) -> None:
        write_stores(folder / "INPUT" / CALVING_FILE, Stores.empty(10, Grid.cartesian(20, 20, 1000.0)))

    driver, entries = {"sst": 3.0, "nmax": 3}, {**MELTS, "bergy_bit_erosion_fraction": 0.0}
    case = scenes.run("berg", "verlet", driver, entries, prepare=empty).report.case
    assert case.exchange is not None
    assert case.model.life is not None
    stored = case.exchange.exchange.calving.stores.ice.sum()
    back = case.exchange.returned[-1].calving.sum() * 1000.0**2 * case.clock.dt
    assert stored > 0.0
    assert stored + back == pytest.approx(sum(case.model.life.balance(case.model).water.values()), rel=1e-12)


# ------------------------------------------------------------------------------------------ tides, broken bonds


def test_a_berg_that_passes_does_not_take_the_numbers_of_another() -> None:
    """Runge-Kutta, beside land: the first stages of one berg lie in the cell of the other."""
    drift = {
        "tidal_drift": 0.3,
        "override_iceberg_velocities": False,
        "Static_icebergs": False,
        "interactive_icebergs_on": False,
    }
    two = {
        "lon": [29_900.0, 24_950.0],
        "lat": [22_500.0] * 2,
        "uvel": [0.0, 3.0],
        "vvel": [0.0] * 2,
        "start_day": [2.0, 1.0],
        "start_mass": [2.0, 1.0],
    }
    found = []
    for count in (2, 1):
        bergs = placed("ocean", count, **{name: values[:count] for name, values in two.items()})
        done = scenes.run("ocean", "runge", {"land": 1.0, "nsteps": 1, "calv0": 0.0}, drift, prepare=bergs)
        table = done.files["iceberg_trajectories.nc"]
        found.append(table["vvel"][table["start_mass"] == 2.0])
    assert found[0][-1] == found[1][-1] != 0.0


BREAKS = {
    **DEM, "dem_spring_coef": 1e6, "fracture_criterion": "stress", "break_bonds_on_sub_steps": True, "no_frac_first_ts": True,
    "mts_sub_steps": 10, "save_bond_traj": True,
}  # fmt: skip


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("more", "listed"),
    [({"frac_thres_n": 1.0, "frac_thres_t": 1e9}, True),
     ({"frac_thres_n": 1.0, "frac_thres_t": 1e9, "no_frac_first_ts": False}, False),
     ({"frac_thres_n": 0.0, "frac_thres_t": 0.0, "no_frac_first_ts": False}, True),
     ({"frac_thres_n": 1.0, "frac_thres_t": 1e9, "use_broken_bonds_for_substep_contact": True}, False)],
    ids=["protected first step", "not protected", "thresholds of 0", "kept as contact"],
)  # fmt: skip
def test_broken_bonds_stay_listed_where_the_long_step_drops_none(
    tmp_path: Path, more: dict[str, Any], listed: bool
) -> None:
    """Two squares that fly apart: both directions of their bond, and the counts of both ends."""
    entries = {**BREAKS, **more}
    elements = {**PAIR, "thickness": [200.0, 200.0], "uvel": [-0.5, 0.5]}
    report = run(tmp_path / "case", {"ibdt": 600.0, "nmax": 3}, entries, **elements)
    assert [now["n_bonds"].tolist() for now in records(report)] == [[int(listed)] * 2] * 3
    bonds = read(next(path for path in report.files if path.stem.endswith("_bonds")))
    assert bonds["broken"].tolist() == [1] * (6 if listed else 0)


def test_a_later_break_drops_them(tmp_path: Path) -> None:
    elements = {**PAIR, "thickness": [200.0, 200.0], "uvel": [-0.5, 0.5]}
    entries = {**BREAKS, "frac_thres_n": 1.0, "frac_thres_t": 1e9}
    model = run(tmp_path / "case", {"ibdt": 600.0, "nmax": 2}, entries, **elements).case.model
    assert model.bonds.status.tolist() == [1]
    update_fragments(model)
    assert model.bonds.status.tolist() == [2]
