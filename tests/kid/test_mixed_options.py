"""Options of KID in combinations, as KID has them: by hand for a first step, and by what a user sees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.bergs.bonded import join
from riftberg.errors import NamelistError
from riftberg.kid.run import KidReport, run_kid

from .conftest import fortran, namelist_text, restart_variables, write_nc

RHO_ICE, RHO_WATER, RHO_AIR = 850.0, 1025.0, 1.1


def run(folder: Path, driver: dict[str, Any], icebergs: dict[str, Any], **elements: Any) -> KidReport:
    """Make a case and run it; ``elements`` replace variables of the restart, of as many elements as ``lon`` has."""
    folder.mkdir(exist_ok=True)
    (folder / "input.nml").write_text(namelist_text(driver, icebergs))
    values = restart_variables(np.size(elements.get("lon", [0, 0])))
    values.update({name: np.asarray(array) for name, array in elements.items()})
    values["mass"] = RHO_ICE * values["thickness"] * values["length"] * values["width"]
    write_nc(folder / "INPUT" / "icebergs.res.nc", values)
    return run_kid(folder, folder / "out.nc")


def read(path: Path) -> dict[str, np.ndarray]:
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)
        return {name: variable[...] for name, variable in dataset.variables.items()}


def records(report: KidReport) -> list[dict[str, np.ndarray]]:
    """Return the trajectory step by step, elements in the order in which they were numbered."""
    table = read(report.files[0])
    stamps = table["year"] * 1000.0 + table["day"]
    found = []
    for stamp in np.unique(stamps):
        rows = np.flatnonzero(stamps == stamp)
        rows = rows[np.lexsort((table["id_ij"][rows], table["id_cnt"][rows]))]
        found.append({name: values[rows] for name, values in table.items() if values.ndim})
    return found


SINGLE = {
    "mts": False, "dem": False, "iceberg_bonds_on": False, "max_bonds": 0, "traj_sample_hrs": -1.0,
    "tau_is_velocity": True, "save_bond_traj": False, "use_operator_splitting": True,
}  # fmt: skip
"""Single steps without bonds, all recorded."""

TWO = {"lon": [5500.0, 5850.0], "lat": [5500.0, 5600.0], "uvel": [0.3, -0.1], "vvel": [0.05, 0.2],
       "thickness": [200.0, 150.0], "width": [400.0, 300.0], "length": [400.0, 300.0]}  # fmt: skip
"""Two bergs in contact."""


# ------------------------------------------------------------------------------------------- Runge-Kutta stages


def runge_kutta(e: dict[str, np.ndarray], dt: float, current: complex, wind: complex, f: float, flag: bool,
                spring: float) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """One step of the reference by hand (equations 4.1, 4.2, 6.3): positions and velocities as complex numbers.

    No waves: wind and current are the same, or there is no wind. Partners are seen where they were at the start.
    """
    x0 = np.asarray(e["lon"]) + 1j * np.asarray(e["lat"])
    u0 = np.asarray(e["uvel"]) + 1j * np.asarray(e["vvel"])
    t, w, q = (np.asarray(e[name]) for name in ("thickness", "width", "length"))
    mass, draft = RHO_ICE * t * w * q, RHO_ICE / RHO_WATER * t
    water = RHO_WATER / mass * (0.45 * w * draft + 0.0012 * w * q)
    air = RHO_AIR / mass * (0.65 * w * (t - draft) + 0.0055 * w * q)
    radius = np.sqrt(w * q / np.pi)

    def partners(k: int, first: complex, now: complex) -> tuple[complex, np.ndarray, np.ndarray]:
        """Spring acceleration, damping tensor and its product with the velocity of the partner."""
        push, tensor, pull = 0j, np.zeros((2, 2)), np.zeros(2)
        for other in range(x0.size):
            away = x0[k] - x0[other]
            if other == k or spring == 0.0 or abs(away) >= radius[k] + radius[other]:
                continue
            n = away / abs(away)
            ratio = min(mass[k], mass[other]) / mass[k]
            push += spring * ratio * (radius[k] + radius[other] - abs(away)) * n
            along = np.array([[n.real**2, n.real * n.imag], [n.real * n.imag, n.imag**2]])
            for projector, coefficient in ((along, 2 * spring**0.5), (np.eye(2) - along, 0.5 * spring**0.5)):
                speeds = [np.linalg.norm(projector @ _pair(u0[other] - v)) for v in (first, now)]
                part = coefficient * ratio * 0.5 * sum(speeds) * projector
                tensor, pull = tensor + part, pull + part @ _pair(u0[other])
        return push, tensor, pull

    def acceleration(k: int, stage: complex, span: float) -> complex:
        iterate = u0[k] if flag else stage
        seen = u0[k]
        a = 0j
        for _ in range(2):
            push, tensor, pull = partners(k, u0[k], seen)
            rates = []
            for coefficient, medium in ((water[k], current), (air[k], wind)):
                mean = 0.5 * (abs(iterate - medium) + abs(u0[k] - medium))
                rates.append((coefficient * (mean if flag else abs(0.5 * (iterate + stage) - medium)), medium))
            drag = sum(rate * (u0[k] - medium) for rate, medium in rates)
            damping = tensor @ _pair(u0[k]) - pull
            right = push - 1j * f * stage - drag - complex(*damping)
            matrix = np.eye(2) * (1.0 + span * sum(rate for rate, _ in rates)) + span * tensor
            a = complex(*np.linalg.solve(matrix, _pair(right)))
            iterate = u0[k] + span * a
            seen = iterate if flag else 0.5 * (iterate + stage)
        return a

    end, speed = x0.copy(), u0.copy()
    for k in range(x0.size):
        v, a = [u0[k]], []
        for stage, span in enumerate((dt / 2, dt / 2, dt, dt)):
            a.append(acceleration(k, v[stage], span))
            if stage < 3:
                v.append(u0[k] + (dt / 2, dt / 2, dt)[stage] * a[stage])
        end[k] += dt / 6 * (v[0] + 2 * v[1] + 2 * v[2] + v[3])
        speed[k] += dt / 6 * (a[0] + 2 * a[1] + 2 * a[2] + a[3])
    return end, speed


def _pair(z: complex) -> np.ndarray:
    return np.array([z.real, z.imag])


@pytest.mark.quick(2)
@pytest.mark.parametrize("flag", [True, False], ids=["with the flag", "without"])
@pytest.mark.parametrize(
    ("elements", "latitude", "wind", "spring"),
    [(TWO, 0.0, 0.0, 0.0), (TWO, -60.0, 4.0, 0.0), (TWO, 0.0, 0.0, 1e-5), (TWO, -60.0, 4.0, 1e-5)],
    ids=["drag", "drag and Coriolis", "contact", "all"],
)
def test_a_runge_kutta_step_by_hand(
    tmp_path: Path, elements: dict[str, Any], latitude: float, wind: float, spring: float, flag: bool
) -> None:
    """First iterate of the drag, and the velocities that the damping of partners takes."""
    driver = {"ibdt": 120.0, "nmax": 1, "ibuo": wind or 0.4, "ibua": wind, "ibvo": 0.0, "ibuy": 0.0}
    entries = {
        **SINGLE, "Runge_not_Verlet": True, "use_new_predictive_corrective": flag, "lat_ref": latitude, "use_f_plane": True,
        "interactive_icebergs_on": spring > 0.0, "spring_coef": spring or 1e-5,
    }  # fmt: skip
    (now,) = records(run(tmp_path / "case", driver, entries, **elements))
    f = 2.0 * 7.292e-5 * np.sin(np.radians(latitude))
    place, speed = runge_kutta(elements, 120.0, driver["ibuo"], wind, f, flag, spring)
    np.testing.assert_allclose(now["uvel"] + 1j * now["vvel"], speed, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(now["lon"] + 1j * now["lat"], place, rtol=0.0, atol=1e-7)


# --------------------------------------------------------------------------------- order of elements in DEM bonds

DEM = {"dem_spring_coef": 1e-3, "dem_damping_coef": 0.0, "mts_sub_steps": 1, "traj_sample_hrs": -1.0, "tau_is_velocity": True,
       "save_bond_traj": False, "force_convergence": False}  # fmt: skip
"""Bonds so soft that they move nothing, and tell the thickness that they count with."""

DRIFT = {"ibdt": 600.0, "ibuo": 0.5, "ibua": 0.5, "ibvo": 0.0, "ibuy": 0.0}
"""Water and air that go with the berg, so that nothing else acts."""

PAIR = {"lon": [5300.0, 5710.0], "lat": [5500.0, 5500.0], "uvel": [0.5, 0.5], "vvel": [0.0, 0.0],
        "thickness": [200.0, 150.0]}  # fmt: skip
"""Two squares of 400 m, stretched by 10 m, in one cell."""


def thickness_at_contact(now: dict[str, np.ndarray]) -> float:
    """Thickness (m) that the force on the first element shows: F = E H (l - l0) w / l0 with w = 2 (R - (R - d) 0) = l0."""
    stretch = np.hypot(now["lon"][1] - now["lon"][0], now["lat"][1] - now["lat"][0]) - 400.0
    force = np.hypot(now["axn_fast"][0], now["ayn_fast"][0]) * now["mass"][0]
    return float(force / (1e-3 * stretch))


def first_of(now: dict[str, np.ndarray]) -> int:
    """Element that was processed first: the contact starts from the thickness of the other, and adds the difference (Q11)."""
    small, thick = (1.0 + 5.0 / 410.0) * 50.0, thickness_at_contact(now)
    radius = 200.0 + 5.0  # R - d/2 of half the overlap, which is negative
    gap = radius / 410.0 * 50.0
    assert small > gap
    for first, other in ((0, 150.0), (1, 200.0)):
        if thick == pytest.approx(other + gap, abs=1.0):
            return first
    raise AssertionError(thick)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("changed", "first"),
    [
        ({}, 1),
        ({"start_mass": [1.0, 2.0]}, 0),
        ({"start_year": np.array([2, 1], "i4"), "start_mass": [1.0, 2.0]}, 1),
        ({"start_lon": [1.0, 2.0], "start_lat": [2.0, 1.0]}, 0),
        ({"lon": [5710.0, 5300.0]}, 1),
        ({"lat": [6100.0, 5690.0], "lon": [5500.0, 5500.0]}, 1),
        ({"lat": [5690.0, 6100.0], "lon": [5500.0, 5500.0]}, 0),
        ({"lon": [5690.0, 6100.0]}, 0),
    ],
    ids=["equals: newest", "mass", "year before mass", "longitude before latitude", "not by place", "northern row",
         "southern row", "western column"],
)  # fmt: skip
def test_which_end_of_a_bond_comes_first(tmp_path: Path, changed: dict[str, Any], first: int) -> None:
    now = records(run(tmp_path / "case", {**DRIFT, "nmax": 1}, DEM, **{**PAIR, **changed}))[0]
    assert first_of(now) == first


def test_an_element_that_changes_cells_is_the_newest_of_its_new_cell(tmp_path: Path) -> None:
    """The eastern one crosses first; then the western one comes in, and goes before it. That stays so."""
    found = records(run(tmp_path / "case", {**DRIFT, "nmax": 5}, DEM, **PAIR))
    cells = np.array([now["lon"] // 1000.0 for now in found])
    np.testing.assert_array_equal(cells[:, 1] - cells[:, 0], [1, 1, 0, 0, 1])
    # A record shows the order of the step that led to it: by the cells before it.
    assert [first_of(now) for now in found] == [1, 0, 0, 0, 0]


@pytest.mark.parametrize("steps", [1, 2])
def test_two_that_cross_together_change_places(tmp_path: Path, steps: int) -> None:
    """They come into the new cell one after the other, and the last one stands first; sister: northward."""
    along = {"lon": [5500.0, 5500.0], "lat": [5300.0, 5710.0], "uvel": [0.0, 0.0], "vvel": [1.7, 1.7]}
    driver = {**DRIFT, "ibuo": 0.0, "ibua": 0.0, "ibvo": 1.7, "ibuy": 1.7, "nmax": steps + 1}
    found = records(run(tmp_path / "case", driver, DEM, **{**PAIR, **along}))
    assert [first_of(now) for now in found] == [1, 0, 1][: steps + 1]


def test_the_order_is_kept_over_a_restart(tmp_path: Path) -> None:
    """Run on from the file of the state in which the order had changed: the file lists the elements as they came in."""
    through = records(run(tmp_path / "all", {**DRIFT, "nmax": 4}, DEM, **PAIR))
    begun = run(tmp_path / "begun", {**DRIFT, "nmax": 3}, DEM, **PAIR)
    kept = read(next(path for path in begun.files if path.name == "out_restart.nc"))
    (tmp_path / "on" / "INPUT").mkdir(parents=True)
    (tmp_path / "on" / "input.nml").write_text(namelist_text({**DRIFT, "nmax": 1}, DEM))
    write_nc(tmp_path / "on" / "INPUT" / "icebergs.res.nc", {k: v for k, v in kept.items() if v.ndim})
    (now,) = records(run_kid(tmp_path / "on", tmp_path / "on" / "out.nc"))
    assert first_of(now) == first_of(through[3]) == 0
    np.testing.assert_allclose(now["lon"], through[3]["lon"], rtol=0.0, atol=1e-9)


def test_unequal_sizes_share_the_lever_of_the_first(tmp_path: Path) -> None:
    """Both ends turn by the shear force at the lever arm of the end that comes first (quirk Q10)."""
    sizes = {"width": [400.0, 500.0], "length": [400.0, 500.0], "lon": [5300.0, 5755.0], "thickness": [200.0, 200.0]}
    for start_mass, first in (([1.0, 2.0], 0), ([2.0, 1.0], 1)):
        changed = {**PAIR, **sizes, "vvel": [1e-6, 0.0], "start_mass": start_mass}
        now = records(run(tmp_path / f"case{first}", {**DRIFT, "nmax": 1}, DEM, **changed))[0]
        radius = 0.5 * now["length"]
        lever = radius[first] + 0.5 * (now["lon"][1] - now["lon"][0] - 450.0)
        inertia = 0.5 * now["mass"] * radius**2
        torque = inertia * now["ang_accel"]
        east, north = np.diff(now["lon"])[0], np.diff(now["lat"])[0]
        shear = now["mass"][0] * (east * now["ayn_fast"][0] - north * now["axn_fast"][0]) / np.hypot(east, north)
        np.testing.assert_allclose(torque, lever * shear, rtol=1e-3)


@pytest.mark.parametrize("how", ["thickness", "melt", "constant size"])
def test_two_sides_with_forces_of_their_own_are_refused(tmp_path: Path, how: str) -> None:
    """Without mirrored forces KID computes each side with the thickness of the other."""
    entries = {**DEM, "save_bond_forces": False}
    elements: dict[str, Any] = {**PAIR}
    if how == "melt":
        elements["thickness"] = [200.0, 200.0]
        entries["set_melt_rates_to_zero"] = False
    if how == "constant size":
        elements.update(width=[400.0, 390.0], length=[400.0, 390.0])
        entries.update(constant_interaction_LW=True, constant_length=400.0, constant_width=400.0)
    with pytest.raises(NamelistError, match=r"save_bond_forces = .false. with bonded elements of 200 and"):
        run(tmp_path / "case", {**DRIFT, "nmax": 1}, entries, **elements)


# ----------------------------------------------------------------------------------------------- imposed velocity

SCHEMES = {
    "verlet": SINGLE,
    "runge_kutta": {**SINGLE, "Runge_not_Verlet": True},
    "mts with springs": {"mts": True, "dem": False, "traj_sample_hrs": -1.0, "save_bond_traj": False},
    "mts with DEM": {"traj_sample_hrs": -1.0, "save_bond_traj": False},
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_an_imposed_velocity(tmp_path: Path, scheme: str) -> None:
    """Verlet at once, Runge-Kutta from the second step on, MTS not at all: elements keep the velocity that they have."""
    entries = {**SCHEMES[scheme], "override_iceberg_velocities": True, "u_override": 0.25, "v_override": -0.1}
    start = {"lon": [5100.0, 5510.0], "lat": [5500.0, 5500.0], "uvel": [0.1, 0.1], "vvel": [0.0, 0.0]}
    found = records(run(tmp_path / "case", {"nmax": 2, "ibdt": 300.0, "ibuo": 0.3}, entries, **start))
    own, given = np.array([0.1, 0.0]), np.array([0.25, -0.1])
    steps = {"verlet": (given, given), "runge_kutta": (own, given)}.get(scheme, (own, own))
    place = np.stack([start["lon"], start["lat"]])
    for now, step in zip(found, steps, strict=True):
        place = place + 300.0 * step[:, None]
        np.testing.assert_allclose(np.stack([now["lon"], now["lat"]]), place, rtol=0.0, atol=1e-8)
        speed = own if scheme.startswith("mts") else given
        np.testing.assert_array_equal(np.stack([now["uvel"], now["vvel"]]), np.repeat(speed[:, None], 2, axis=1))


@pytest.mark.parametrize("scheme", ["verlet", "runge_kutta", "mts", "quasi_static"])
def test_an_imposed_velocity_in_own_runs(scheme: str) -> None:
    """Every scheme takes it from the first step on."""
    p = Parameters(
        stepping={"scheme": scheme, "time_step": 300.0, "fixed_velocity": (0.25, -0.1)}, earth={"latlon": False},
        bonds={"law": "none" if scheme in ("verlet", "runge_kutta") else "dem"},
    )  # fmt: skip
    model = _own_model(p, "800 m", "400 m")
    before = model.elements.lon.copy(), model.elements.lat.copy()
    for _ in range(3):
        model.step()
    np.testing.assert_allclose(model.elements.lon - before[0], 225.0, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(model.elements.lat - before[1], -90.0, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(model.velocity()[0], 0.25, rtol=1e-12)
    assert not model.applied_forces().any()


def _own_model(p: Parameters, length: str, width: str) -> Model:
    grid = Grid.cartesian(20, 20, 1000.0)
    berg = Iceberg.rectangle(length, width, thickness="200 m", placement=(9500.0, 9500.0), latlon=False, radius="200 m")
    return Model(berg, GriddedForcing(grid, grid.fields(uo=0.3, depth=1000.0)), p)


# ---------------------------------------------------------------------------------------------- contact by cells


@pytest.mark.quick(6)
@pytest.mark.parametrize("scheme", ["verlet", "runge_kutta", "mts with springs"])
@pytest.mark.parametrize(
    ("apart", "across", "distance", "feels"),
    [
        (2100.0, False, 0.0, False),
        (1900.0, False, 0.0, True),
        (2100.0, True, 0.0, False),
        (2100.0, True, 1500.0, True),
        (2100.0, False, 1500.0, True),
        (3100.0, False, 1500.0, False),
        (3100.0, False, 2500.0, True),
    ],
)
def test_bergs_wider_than_a_cell_meet_by_cells(
    tmp_path: Path, scheme: str, apart: float, across: bool, distance: float, feels: bool
) -> None:
    """Centres two cells apart: no contact, however wide the bergs; ``contact_distance`` spans more cells."""
    x = [5050.0, 5050.0 + apart] if across else [5500.0, 5500.0]
    y = [5500.0, 5500.0] if across else [5050.0, 5050.0 + apart]
    entries = {**SCHEMES[scheme], "iceberg_bonds_on": False, "max_bonds": 0, "contact_distance": distance,
               "contact_spring_coef": 1e-6}  # fmt: skip
    big = {"length": [4000.0, 4000.0], "width": [4000.0, 4000.0]}
    found = records(run(tmp_path / "case", {"nmax": 2, "ibdt": 60.0, "ibuo": 0.0}, entries, lon=x, lat=y, **big))
    speed = np.hypot(found[-1]["uvel"], found[-1]["vvel"])
    assert bool((speed > 1e-4).all()) is feels
    assert feels or not speed.any()


def test_own_runs_meet_by_distance() -> None:
    """The same two bergs, in cells far apart, push each other away."""
    grid = Grid.cartesian(20, 20, 1000.0)
    one, other = (
        Iceberg.rectangle("3 km", "3 km", thickness="200 m", placement=(x, 9500.0), latlon=False, radius="1.5 km")
        for x in (6000.0, 8999.0)
    )
    p = Parameters(stepping={"scheme": "verlet", "time_step": 60.0}, earth={"latlon": False}, bonds={"law": "none"})
    model = Model(join([one, other]), GriddedForcing(grid, grid.fields(depth=1e3)), p)
    for _ in range(2):
        model.step()
    assert model.elements.u[0] < 0.0 < model.elements.u[1]


# -------------------------------------------------------------------------------------------- footloose children

FOOTLOOSE = {
    **SINGLE, "iceberg_bonds_on": True, "max_bonds": 4, "footloose": True, "fl_style": "fl_bits", "fl_youngs": 1e8,
    "use_operator_splitting": True, "set_melt_rates_to_zero": True, "save_fl_traj": True, "displace_fl_bergs": False,
    "length_for_manually_initialize_bonds": -1000.0, "manually_initialize_bonds_from_radii": False,
}  # fmt: skip


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("x", "width", "distance", "flag"),
    [
        (7950.0, 5000.0, 0.0, -2.0),
        (6950.0, 5000.0, 0.0, -1.0),
        (6950.0, 1000.0, 0.0, -2.0),
        (7600.0, 5000.0, 1500.0, -2.0),
        (6950.0, 1000.0, 1500.0, -1.0),
        (6950.0, 1000.0, 990.0, -1.0),
    ],
    ids=["two cells away", "next cell", "out of reach", "radii do not count over more cells", "distance does",
         "in one cell too"],
)  # fmt: skip
def test_a_child_may_collide_once_nobody_stands_in_the_cells_around(
    tmp_path: Path, x: float, width: float, distance: float, flag: float
) -> None:
    elements = {
        "lon": [5990.0, x], "lat": [5500.0, 5500.0], "length": [width, 300.0], "width": [width, 100.0],
        "fl_k": [0.0, -1.0], "start_mass": [1.0, 2.0],
    }  # fmt: skip
    entries = {**FOOTLOOSE, "contact_distance": distance, "contact_spring_coef": 1e-8}
    report = run(tmp_path / "case", {"nmax": 1, "ibdt": 60.0, "ibuo": 0.0}, entries, **elements)
    assert read(next(p for p in report.files if p.name == "out_restart.nc"))["fl_k"][1] == flag


# ------------------------------------------------------------------------------------------------- closed edges

EDGES = {"north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0)}


@pytest.mark.quick(6)
@pytest.mark.parametrize("scheme", ["verlet", "runge_kutta", "mts with springs", "mts with DEM", "footloose"])
@pytest.mark.parametrize("edge", EDGES)
def test_what_leaves_over_a_closed_edge_is_gone(tmp_path: Path, edge: str, scheme: str) -> None:
    """From the step in which it leaves, alone or out of a bonded berg; with melt, the ledger has it as gone otherwise."""
    east, north = EDGES[edge]
    at = np.array([10_000.0 + 9800.0 * east, 10_000.0 + 9800.0 * north])
    behind = at - 410.0 * np.array([east, north])
    elements = {
        "lon": [at[0], behind[0]], "lat": [at[1], behind[1]], "uvel": [0.5 * east] * 2, "vvel": [0.5 * north] * 2,
    }  # fmt: skip
    driver = {"ibdt": 600.0, "nmax": 3, "ibuo": 0.5 * east, "ibvo": 0.5 * north, "sst": 1.0}
    entries = FOOTLOOSE if scheme == "footloose" else SCHEMES[scheme]
    entries = {**entries, "dem_spring_coef": 1.0, "spring_coef": 1e-9, "set_melt_rates_to_zero": False}
    report = run(tmp_path / "case", driver, entries, **elements)
    assert [now["lon"].size for now in records(report)] == [1, 1]
    model = report.case.model
    assert model.elements.size == model.bonds.first.size == 0
    assert model.life is not None
    balance = model.life.balance(model)
    assert abs(balance.error) <= 1e-9
    assert read(next(p for p in report.files if p.name == "out_restart.nc"))["lon"].size == 0


def test_a_cyclic_edge_is_none(tmp_path: Path) -> None:
    """What leaves in the east comes back in the west."""
    start = {"lon": [19_900.0, 5000.5], "lat": [9500.0, 9500.0], "uvel": [0.5, 0.5]}
    report = run(tmp_path / "case", {"ibdt": 600.0, "nmax": 2, "ibuo": 0.5}, {**SINGLE, "Lx": 20_000.0}, **start)
    assert [now["lon"].size for now in records(report)] == [2, 2]
    assert 0.0 < report.case.model.elements.lon.min() < 1000.0


# ------------------------------------------------------------------------------------------- melt and random tide

COUPLED = {
    "grid_is_latlon": False, "ignore_ij_restart": True, "Lx": -1.0, "old_bug_bilin": False, "Runge_not_Verlet": False,
    "save_short_traj": False, "tau_is_velocity": True, "traj_sample_hrs": -1.0, "tidal_drift": 0.15,
    "override_iceberg_velocities": True, "use_operator_splitting": True,
}  # fmt: skip
ISLAND = {"calv0": 0.0, "cn0": 0.1, "dt": 1800.0, "gridres": 5000.0, "land": 1.0, "ni": 12, "nj": 10, "nsteps": 2,
          "sst0": 2.0, "uo0": 0.3, "ua0": 3.0}  # fmt: skip
BESIDE_LAND = {"lon": [28_000.0, 28_800.0], "lat": [22_600.0, 23_700.0], "length": [300.0, 250.0], "width": [200.0, 200.0],
               "thickness": [150.0, 150.0]}  # fmt: skip
"""Two bergs in the cell west of the land, (6, 5)."""


def coupled(folder: Path, entries: dict[str, Any], **elements: Any) -> list[dict[str, np.ndarray]]:
    """Run a case with the small driver of an ocean; return its records."""
    folder.mkdir()
    groups = {"drv_nml": ISLAND, "icebergs_nml": {**COUPLED, **entries}}
    lines = [
        f"&{name}\n" + "\n".join(f" {k} = {fortran(v)}" for k, v in e.items()) + "\n/" for name, e in groups.items()
    ]
    (folder / "input.nml").write_text("\n".join(lines) + "\n")
    values = {**restart_variables(2), **{name: np.asarray(v) for name, v in {**BESIDE_LAND, **elements}.items()}}
    values["mass"] = RHO_ICE * values["thickness"] * values["length"] * values["width"]
    write_nc(folder / "INPUT" / "icebergs.res.nc", values)
    return records(run_kid(folder, folder / "out.nc"))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("entries", "in_melt"),
    [({}, False), ({"Runge_not_Verlet": True}, False), ({"mts": True, "mts_sub_steps": 2}, True),
     ({"footloose": True, "fl_youngs": 1e8}, True)],
    ids=["verlet", "runge_kutta", "mts", "footloose"],
)  # fmt: skip
def test_the_random_tide_in_melt(tmp_path: Path, entries: dict[str, Any], in_melt: bool) -> None:
    """Bergs that are made to stand: only through melt can the tide do anything. Coastal drift stays in melt everywhere."""
    with_tide = coupled(tmp_path / "tide", entries)[-1]
    without = coupled(tmp_path / "none", {**entries, "tidal_drift": 0.0})[-1]
    drifted = coupled(tmp_path / "drift", {**entries, "tidal_drift": 0.0, "coastal_drift": 0.15})[-1]
    assert bool((with_tide["mass"] != without["mass"]).all()) is in_melt
    assert in_melt or not (with_tide["mass"] != without["mass"]).any()
    assert (drifted["mass"] != without["mass"]).all()


@pytest.mark.parametrize(
    ("keys", "first"), [({}, 1), ({"start_mass": [1.0, 2.0]}, 0), ({"start_mass": [2.0, 1.0]}, 1)],
    ids=["equals: newest", "lighter", "lighter in the other row"],
)  # fmt: skip
def test_who_draws_the_first_number_of_a_cell(tmp_path: Path, keys: dict[str, Any], first: int) -> None:
    """The random current by hand: numbers of a stream of the cell, drawn in the order of its list (equations 3.2)."""
    now = coupled(tmp_path / "case", {"mts": True, "mts_sub_steps": 2}, **keys)[-1]
    seed = 6 + 10_000 * 5 + int(16384.0 * abs(np.sin(262144.0 * 0.06)))
    words = np.random.RandomState(seed).randint(0, 2**32, size=4, dtype=np.uint32)
    east, north = (2.0 * words / (2.0**32 - 1.0) - 1.0).reshape(2, 2)[[0, 1] if first == 0 else [1, 0]].T
    # Land in the east alone: from there nothing comes, and along the coast nothing goes.
    np.testing.assert_allclose(now["uo"], 0.3, rtol=0.0, atol=0.15)
    np.testing.assert_allclose(now["vo"], 0.15 * (np.minimum(0, north) + np.maximum(0, north)), rtol=0.0, atol=1e-12)
    assert (east != north).all()
