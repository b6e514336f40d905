"""Land stops a berg as a whole, with all that it would be pushed into; nothing is thrown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import FieldRules, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.bergs.bonding import Metric, separations
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.engines.common.land import rotate_along
from riftberg.parameters import Compatibility

SIZE = 3000.0
CURRENT = 0.3
WAVE = float(np.sqrt(850.0 * 5e6))
"""Stress of an elastic wave in ice of 5 MPa over the speed that makes it, rho c, Pa s m-1."""
PLANE = {"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": 0.0}


def berg(x: float, columns: int, rows: int, speed: float = CURRENT) -> Iceberg:
    """A berg of square elements whose eastern edge stands at x; a current and its own speed carry it to the coast."""
    return Iceberg.rectangle(
        columns * SIZE, rows * SIZE, thickness=200.0, radius=1500.0, placement=(x - 0.5 * columns * SIZE, 20e3), latlon=False,
        velocity=(speed, 0.0),
    )  # fmt: skip


def coast(current: float = CURRENT, bend: float = 0.0) -> GriddedForcing:
    """A coast at 50 km, with a cape of one cell; ``bend`` (m) makes the grid curvilinear."""
    mask = np.ones((8, 16))
    mask[:, 10:] = mask[5, 9] = 0.0
    grid = Grid.cartesian(16, 8, 5000.0, mask=mask)
    if bend:
        x, y = np.meshgrid(5000.0 * np.arange(17), 5000.0 * np.arange(9))
        x, y = x + bend * np.sin(y / 9e3), y + bend * np.sin(x / 12e3)
        grid = Grid.from_corners(x, y, latlon=False, regular=False, period=0.0, mask=mask, includes_southwest=True)
    fields = grid.fields(uo=np.full((8, 16), current))
    return GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())


BERGS = {
    "three single bergs": lambda: Iceberg.join([berg(49e3, 1, 1), berg(45.9e3, 1, 1), berg(42.8e3, 1, 1)]),
    "one bonded berg": lambda: berg(49.4e3, 3, 4),
    "a bonded berg before a single one": lambda: Iceberg.join([berg(49.4e3, 3, 4), berg(40.3e3, 1, 1)]),
    "a single berg before a bonded one": lambda: Iceberg.join([berg(49e3, 1, 1), berg(45.9e3, 3, 4)]),
}


def parameters(scheme: str, spring: float | None = None, **groups: Any) -> Parameters:
    """Contact as soft as published, or as stiff as the ice; in the default scheme by crushing."""
    if scheme in ("verlet", "runge_kutta"):
        groups = {"bonds": {"law": "spring", "spring": 1e-8}, "fracture": {"enabled": False}, **groups}
    # A bed would take the edge of a berg at dry land before the coast takes its elements.
    floor = {"grounding": {"law": "none"}}
    own = floor if scheme == "quasi_static" else {"contact": {"spring": spring}}
    return Parameters(**{"earth": PLANE, **own, **groups}, stepping={"scheme": scheme, "time_step": 1800.0})


@pytest.mark.parametrize(
    ("bend", "steps"),
    [(0.0, 6), pytest.param(0.0, 24, marks=pytest.mark.slow), pytest.param(300.0, 24, marks=pytest.mark.slow)],
    ids=["landing", "square cells", "curvilinear"],
)
def test_a_berg_is_not_thrown_by_the_bed_of_dry_land_beside_deep_water(bend: float, steps: int) -> None:
    """Bug: a plane through a pad between land of no known depth and 10 km of water stood kilometres inside the keel."""
    model = Model(BERGS["one bonded berg"](), coast(bend=bend), parameters("quasi_static", grounding={}))
    fastest, energy = 0.0, _energy(model)
    for _ in range(steps):
        model.advance(steps=1)
        assert _energy(model) < energy
        fastest = max(fastest, float(np.hypot(model.elements.u, model.elements.v).max()))
    assert model.elements.keel.floor_load.sum() > 0.0  # it lies on the land, with a corner
    # With all its energy in drift and spin, v^2 + k^2 w^2 = u^2, the corner would go at u (1 + r^2 / k^2)^(1/2) = 1.6 u as the
    # berg pivots; the water pushes on meanwhile. It was 1.61 u with the integral over the outline, 1.50 u without sides.
    assert fastest < 1.75 * CURRENT
    assert _in_water(model)


@pytest.mark.quick(20)
@pytest.mark.parametrize("bend", [0.0, 300.0], ids=["square cells", "curvilinear"])
@pytest.mark.parametrize(
    ("scheme", "spring"),
    [(scheme, spring) for scheme in ("mts", "verlet", "runge_kutta") for spring in (1e-7, None)]
    + [("quasi_static", None)],
)
@pytest.mark.parametrize("name", BERGS)
def test_bergs_that_a_coast_stops_are_not_thrown(name: str, scheme: str, spring: float | None, bend: float) -> None:
    """Bug: each element was stopped for itself, out of its lattice or into the next berg: up to 43 m/s in a current of 0.3."""
    model = Model(BERGS[name](), coast(bend=bend), parameters(scheme, spring))
    energy = _energy(model)
    # A heavy berg that strikes a light one at rest gives it up to twice its speed.
    fastest, largest = (2.0 if name == "a single berg before a bonded one" else 1.1) * CURRENT, 0.0
    for _ in range(24):
        swing = float(np.ptp(model.elements.u))
        model.advance(steps=1)
        swing = max(swing, float(np.ptp(model.elements.u)))
        largest = max(largest, float(model.bonds.peak_stress.max(initial=0.0)))
        assert _in_water(model)
        assert np.hypot(model.elements.u, model.elements.v).max() < fastest
        assert _energy(model) < 1.1 * energy
    assert (model.bonds.status == 0).all()
    # The current would have carried them 13 km ashore. They are held at the shore, and feel the water as a berg at rest does.
    assert model.elements.lon.max() > 49.9e3
    free = Model(berg(25e3, 3, 4, 0.0), coast(bend=bend), parameters(scheme, spring))
    free.advance(steps=4)
    # In `mts` a berg that is pressed against one that is held swings on the spring between them, and sends elastic waves through
    # it: rho c times the speed, over the vibrations of a berg in open water.
    wave = WAVE * swing if scheme == "mts" else 0.0
    # Faces that part and meet again within a step do so more slowly than at first: 109 Pa in the last step, of 1093 Pa.
    again = 0.15 * largest if scheme == "quasi_static" else 0.0
    assert model.bonds.peak_stress.max(initial=0.0) < max(
        100.0, 1.3 * free.bonds.peak_stress.max(initial=0.0) + wave, again
    )


def test_a_berg_does_not_go_into_the_one_that_a_coast_holds() -> None:
    """Bug: land looked by circles for what is in the way, and faces that met beside the line of centres went on, 90 m a step."""
    model = Model(BERGS["a single berg before a bonded one"](), coast(), parameters("quasi_static"))
    model.advance(steps=18)
    x = model.elements.lon
    assert x[0] > 48e3
    assert x[0] - x[1:].max() > SIZE - 5.0
    assert np.abs(model.elements.u).max() < 0.1 * CURRENT


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("scheme", "columns"),
    [
        ("mts", 1),
        ("mts", 3),
        ("verlet", 1),
        ("runge_kutta", 1),
        ("runge_kutta", 3),
        ("quasi_static", 1),
        ("quasi_static", 3),
    ],
)
def test_a_berg_held_by_a_coast_has_no_velocity_into_the_land(scheme: str, columns: int) -> None:
    """Bug: it kept the 0.3 m/s of the current, so its base melted too little and its drag on the water was that of moving ice."""
    grid = coast().grid
    fields = grid.fields(uo=np.full((8, 16), CURRENT), vo=np.full((8, 16), 0.1))
    sea = GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())
    model = Model(berg(49.9e3, columns, columns), sea, parameters(scheme, None))
    model.advance(steps=24)
    east, north = (part.mean() for part in model.velocity())
    # Explicit schemes end half a kick of the water ahead.
    assert abs(east) < (1e-6 if scheme in ("quasi_static", "runge_kutta") else 0.025)
    assert abs(model.elements.u.mean()) < 2e-3
    assert north > 0.02  # along the coast it goes on
    before = model.elements.lon.copy()
    for _ in range(4):
        model.advance(steps=1)
        if not (scheme == "runge_kutta" and columns > 1):  # its bonds do not hold against shear
            np.testing.assert_allclose(model.elements.lon, before, rtol=0, atol=1.0)
    # Water that turns away takes it with it.
    away = grid.fields(uo=np.full((8, 16), -CURRENT))
    model.forcing = GriddedForcing(grid, [away, away], np.array([0.0, 10.0 * 86400.0]), FieldRules())
    model.advance(steps=12)
    assert model.elements.lon.max() < before.max() - 500.0


def _in_water(model: Model) -> bool:
    """Whether all elements stand in the cell that they are counted in, and that is water."""
    el, grid = model.elements, model.forcing.grid.arrays
    inside = (el.xi >= 0.0) & (el.xi < 1.0) & (el.eta >= 0.0) & (el.eta < 1.0)
    return bool((inside & (grid.mask[el.cell_j, el.cell_i] > 0.0)).all())


def _energy(model: Model) -> float:
    el = model.elements
    return float(0.5 * np.sum(el.mass * (el.u**2 + el.v**2)))


@pytest.mark.parametrize("scheme", ["mts", "quasi_static"])
def test_pieces_of_one_berg_that_breaks_at_a_coast_are_not_thrown(scheme: str) -> None:
    """It breaks along its columns; the pieces go back together, those behind with those ashore."""
    model = Model(
        berg(49.4e3, 3, 4), coast(), parameters(scheme, None, fracture={"normal_strength": 1e9, "shear_strength": 1e9})
    )
    bonds, lon = model.bonds, model.elements.lon.copy()
    bonds.strength[np.abs(lon[bonds.first] - lon[bonds.second]) > 1.0] = 1e-12  # as soon as anything pulls at them
    for _ in range(14):
        model.advance(steps=1)
        assert np.hypot(model.elements.u, model.elements.v).max() < 1.1 * CURRENT
        assert _in_water(model)
    assert (bonds.status != 0).any()


def test_the_reference_puts_a_berg_back_and_leaves_its_velocity() -> None:
    """A twentieth of a cell, from where it runs ashore again (equations 8.1)."""
    p = parameters("mts", None, compatibility={"elements_stopped_alone": True})
    model, found = Model(berg(49e3, 1, 1), coast(), p), []
    for _ in range(12):
        model.advance(steps=1)
        found.append(float(model.elements.lon[0]))
        assert model.elements.u[0] == pytest.approx(CURRENT, rel=0.01)
    assert found.count(49750.0) > 5


def test_runs_of_kid_stop_each_element_for_itself() -> None:
    assert Compatibility.kid().elements_stopped_alone
    assert not Compatibility().elements_stopped_alone


@pytest.mark.parametrize("period", [0.0, 80e3])
def test_bergs_are_stopped_at_the_edge_of_the_grid_too(period: float) -> None:
    """The sea ends at an open edge as at land; in a periodic one it goes on."""
    grid = Grid.cartesian(16, 8, 5000.0, period=period)
    fields = grid.fields(uo=np.full((8, 16), CURRENT))
    sea = GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())
    bergs = Iceberg.join([berg(79e3, 3, 4), berg(69.9e3, 1, 1)])
    model = Model(bergs, sea, parameters("mts", None, earth={**PLANE, "period": period}))
    for _ in range(24):
        model.advance(steps=1)
        assert np.hypot(model.elements.u, model.elements.v).max() < 1.1 * CURRENT
    assert (model.bonds.status == 0).all()
    assert (model.elements.lon.max() < 80e3) == (period == 0.0) or model.elements.lon.min() < 30e3


def test_a_berg_beside_the_one_that_land_stops_goes_on() -> None:
    """What lies beside or before the berg that goes back is in nobody's way."""
    bergs = Iceberg.join([berg(49e3, 1, 1), berg(40e3, 1, 1)])
    model = Model(bergs, coast(), parameters("mts", None))
    model.advance(steps=4)
    assert model.elements.lon[0] < 50e3
    assert model.elements.lon[1] == pytest.approx(38.5e3 + 4 * 1800.0 * CURRENT, abs=5.0)


@pytest.mark.parametrize("scheme", ["mts", "quasi_static"])
def test_without_interactions_a_berg_is_not_stopped_by_another_that_land_stops(scheme: str) -> None:
    """The second berg drifts through the first until the coast stops it too."""
    bergs = Iceberg.join([berg(49e3, 1, 1), berg(45.9e3, 1, 1)])
    interactions = {"scheme": scheme, "time_step": 1800.0, "interactions": False}
    model = Model(bergs, coast(), Parameters(earth=PLANE, stepping=interactions))
    model.advance(steps=8)
    start = 45.9e3 - 0.5 * SIZE
    assert model.elements.lon[1] == pytest.approx(start + 8 * 1800.0 * CURRENT, abs=60.0)


def test_on_the_sphere_distances_in_a_berg_stay() -> None:
    """A berg that goes back is turned about the centre of the sphere, whatever way its rows lie."""
    lon, lat = np.meshgrid(np.linspace(-52.0, -49.0, 7), np.linspace(-76.0, -74.0, 7))
    lon, lat = lon.ravel(), lat.ravel()

    def vectors(x: Any, y: Any) -> Any:
        x, y = np.radians(x), np.radians(y)
        return np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)], axis=-1)

    start, end = vectors(lon[:1], lat[:1]), vectors(lon[:1] + 0.02, lat[:1] - 0.01)
    before, after = vectors(lon, lat), rotate_along(start, end, vectors(lon, lat))
    np.testing.assert_allclose(after[0], end[0], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(after @ after.T, before @ before.T, rtol=0.0, atol=1e-14)


def test_a_berg_on_the_sphere_is_not_strained_by_land() -> None:
    """77 degrees south the meridians converge by the hour; moved along parallels, a berg would be sheared."""
    mask = np.ones((12, 16))
    mask[:, 9:] = 0.0
    lon, lat = np.meshgrid(-52.0 + 0.25 * np.arange(17), -78.0 + 0.1 * np.arange(13))
    grid = Grid.from_corners(lon, lat, mask=mask, includes_southwest=True)
    fields = grid.fields(uo=np.full((12, 16), CURRENT))
    sea = GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())
    ice = Iceberg.rectangle(
        12e3, 30e3, thickness=200.0, radius=1500.0, placement=(-50.02, -77.4), velocity=(CURRENT, 0.0)
    )
    model = Model(
        ice,
        sea,
        Parameters(stepping={"scheme": "mts", "time_step": 600.0}, earth={"f_plane": True, "reference_latitude": 0.0}),
    )
    el, bonds = model.elements, model.bonds
    metric = Metric(True, EARTH_RADIUS_A68, 360.0)
    rest = np.hypot(
        *separations(metric, el.lon[bonds.first], el.lat[bonds.first], el.lon[bonds.second], el.lat[bonds.second])
    )
    for _ in range(30):
        model.advance(steps=1)
    now = np.hypot(
        *separations(metric, el.lon[bonds.first], el.lat[bonds.first], el.lon[bonds.second], el.lat[bonds.second])
    )
    assert el.lon.max() < -49.75
    np.testing.assert_allclose(now, rest, rtol=1e-4)
    assert bonds.peak_stress.max() < 1500.0


def test_a_contact_far_away_does_not_change_what_land_does_to_a_berg() -> None:
    """Where any two bergs touched anywhere, land stopped the second half kick of a step alone, and not the first."""
    mask = np.ones((8, 40))
    mask[:, 34:] = 0.0
    grid = Grid.cartesian(40, 8, 5000.0, mask=mask)
    fields = grid.fields(uo=np.full((8, 40), CURRENT), vo=np.full((8, 40), 0.1))
    ends = []
    for gap in (20.0, 20e3):
        pair = [
            Iceberg.rectangle(
                SIZE, SIZE, thickness=200.0, radius=1500.0, placement=(x, 20e3), latlon=False, velocity=(speed, 0.1)
            )
            for x, speed in ((20e3, CURRENT), (20e3 + SIZE + gap, 0.1))
        ]
        model = Model(
            Iceberg.join([berg(171.4e3, 3, 3), *pair]),
            GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules()),
            Parameters(earth=PLANE, fracture={"enabled": False}, stepping={"time_step": 1800.0}),
        )
        model.advance(steps=2)
        assert len(model.contacts.rows) == (gap < 100.0)
        ends.append(np.stack([a[:9] for a in (*model.elements.place[:2], model.elements.u, model.elements.v)]))
    assert ends[0].tolist() == ends[1].tolist()
