"""The size of a berg as a whole and the sides that its elements bear: what waves and side drag act on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import fsolve

from engines.lattices import surroundings_of
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import (
    EARTH_ROTATION,
    GRAVITY,
    RHO_AIR,
    RHO_SEAWATER,
    WAVE_RADIATION_MAX,
)
from riftberg.engines.common.fragments.tree import equivalent_rectangles, measure_outlines
from riftberg.parameters import PUBLISHED_DRAG, Drag
from riftberg.plane import ConformalPlane

DRAG = Parameters().drag
LENGTH, WIDTH, THICKNESS, LATITUDE = 30e3, 15e3, 250.0, -60.0


def root(wind: float, *, waves: bool = True, drag: Drag = DRAG) -> float:
    """Terminal speed (m s-1) of a 30 x 15 km berg as one body, by the balance of forces alone."""
    area, mass = LENGTH * WIDTH, 850.0 * THICKNESS * LENGTH * WIDTH
    draft = THICKNESS * 850.0 / RHO_SEAWATER
    freeboard, side = THICKNESS - draft, 0.5 * (LENGTH + WIDTH)
    water = RHO_SEAWATER * (0.5 * drag.water_side * side * draft + drag.water_base * area)
    air = RHO_AIR * (0.5 * drag.air_side * side * freeboard + drag.air_top * area)
    amplitude, f = 0.5 * 0.02025 * wind**2, 2.0 * EARTH_ROTATION * np.sin(np.radians(LATITUDE))
    push = 0.5 * RHO_SEAWATER * WAVE_RADIATION_MAX * GRAVITY * amplitude * min(amplitude, freeboard)
    push *= 2.0 * LENGTH * WIDTH / (LENGTH + WIDTH) if waves else 0.0

    def balance(q):
        u, v = q
        through_air, through_water = np.hypot(wind - u, v), np.hypot(u, v)
        east = air * through_air * (wind - u) - water * through_water * u + mass * f * v + push
        north = -air * through_air * v - water * through_water * v - mass * f * u
        return np.array([east, north]) / mass * 1e6

    return float(np.hypot(*fsolve(balance, (0.1, 0.1))))


def drift(wind: float, radius: float, *, days: float = 25.0, scheme: str = "quasi_static", **options) -> float:
    """Terminal speed (m s-1) of the berg on a lattice."""
    berg = Iceberg.rectangle(LENGTH, WIDTH, thickness=THICKNESS, placement=(-30.0, LATITUDE), radius=radius, **options)
    p = Parameters(
        earth={"f_plane": True, "reference_latitude": LATITUDE}, fracture={"enabled": False},
        stepping={"scheme": scheme, "time_step": 1800.0},
    )  # fmt: skip
    model = Model(berg, Forcing.uniform(wind=(wind, 0.0)), p)
    # Inertial motion is damped by the drag, slowly in light winds: the mean over five of its periods leaves it out.
    period = 2.0 * np.pi / (2.0 * EARTH_ROTATION * np.sin(np.radians(-LATITUDE)))
    last = round(5.0 * period / 1800.0)
    mass, means = model.elements.mass, []
    for step in range(round(days * 48)):
        model.step()
        if step >= round(days * 48) - last:
            means.append([float(part @ mass) / mass.sum() for part in model.velocity()])
    return float(np.hypot(*np.mean(means, axis=0)))


def test_the_root_is_that_of_the_force_balance_by_hand():
    """12.10 cm/s at 20 m/s of wind, 11.28 without waves, with the coefficients of KID."""
    published = Drag(**PUBLISHED_DRAG)
    assert 100.0 * root(20.0, drag=published) == pytest.approx(12.10, abs=0.01)
    assert 100.0 * root(20.0, waves=False, drag=published) == pytest.approx(11.28, abs=0.01)


@pytest.mark.quick(2)
@pytest.mark.parametrize(("radius", "packing", "angle"), [
    (7500.0, "square", 0.0), (1500.0, "square", 0.0), (1500.0, "square", 45.0), (1500.0, "hexagonal", 20.0)
])  # fmt: skip
@pytest.mark.compiled
def test_drift_in_waves_does_not_depend_on_the_lattice(radius, packing, angle):
    """Bug once: 12.5, 17.4, 23.5 and 35.7 cm/s with elements of 15, 3, 1.5 and 0.75 km, for inner elements felt waves too."""
    assert drift(20.0, radius, packing=packing, lattice_angle=angle) == pytest.approx(root(20.0), rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("wind", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("angle", [0.0, 15.0, 22.5, 30.0, 45.0])
@pytest.mark.parametrize("radius", [1500.0, 750.0, 250.0])
def test_drift_on_all_lattices(wind, packing, angle, radius):
    days = {20.0: 25.0, 10.0: 60.0, 5.0: 150.0}[wind]
    assert drift(wind, radius, days=days, packing=packing, lattice_angle=angle) == pytest.approx(root(wind), rel=0.02)


def berg_of(length=LENGTH, width=WIDTH, **options):
    return Iceberg.rectangle(length, width, thickness=200.0, placement=(-30.0, LATITUDE), **options)


def measured(berg, p=None):
    """Return the elements of a berg with its outline measured."""
    model = Model(berg, Forcing.uniform(), p or Parameters())
    model.step()
    return model.elements


@pytest.mark.quick(4)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("angle", [0.0, 22.5, 45.0])
@pytest.mark.parametrize("rotation", [0.0, 35.0])
def test_a_rectangle_has_its_own_sides(packing, angle, rotation):
    el = measured(berg_of(60e3, 20e3, radius=1000.0, packing=packing, lattice_angle=angle, rotation=rotation))
    assert el.berg_length[0] == pytest.approx(60e3, rel=0.02)
    assert el.berg_length[0] * el.berg_width[0] == pytest.approx(1200e6, rel=1e-12)
    assert (el.berg_length == el.berg_length[0]).all()


def test_a_berg_of_one_element_has_the_sides_of_that():
    berg = Iceberg.from_points([-30.0], [-60.0], thickness=200.0, radius=1500.0)
    berg.elements.length[:], berg.elements.width[:] = 4e3, 2e3
    el = measured(berg)
    assert (el.berg_length[0], el.berg_width[0], el.side_share[0]) == (4e3, 2e3, 1.0)


def test_shares_sum_to_one_for_each_berg_and_inner_elements_have_none():
    el = measured(berg_of())
    assert el.side_share.sum() == pytest.approx(1.0, rel=1e-12)
    assert (el.side_share[el.bond_count == 4] == 0.0).all()
    assert (el.side_share[el.bond_count < 4] > 0.0).all()
    corner, edge = el.side_share[el.bond_count == 2], el.side_share[el.bond_count == 3]
    np.testing.assert_allclose(corner, 2.0 * edge[0], rtol=1e-12)


def test_each_piece_after_a_break_has_its_own():
    model = Model(berg_of(), Forcing.uniform(), Parameters())
    model.step()
    el, bonds = model.elements, model.bonds
    middle = 0.5 * (el.lon.min() + el.lon.max())
    cut = (el.lon[bonds.first] < middle) != (el.lon[bonds.second] < middle)
    bonds.status[cut] = 2
    for side in (bonds.first, bonds.second):
        np.subtract.at(el.bond_count, side[cut], 1)
    model.fragments.update(el, bonds, model.time, model.constants)
    assert np.unique(el.berg).size == 2
    np.testing.assert_allclose(el.berg_length, 15e3, rtol=1e-5)
    np.testing.assert_allclose(el.berg_width, 15e3, rtol=1e-5)
    for number in (1, 2):
        assert el.side_share[el.berg == number].sum() == pytest.approx(1.0, rel=1e-12)


def moments(x, y, area):
    """Slow twin: length and width (m) of the rectangle with the area and moments of squares, by eigenvalues."""
    weight = area / area.sum()
    x, y = x - weight @ x, y - weight @ y
    tensor = np.array(
        [[weight @ (x * x + area / 12.0), weight @ (x * y)], [weight @ (x * y), weight @ (y * y + area / 12.0)]]
    )
    small, large = np.linalg.eigvalsh(tensor)
    ratio = np.sqrt(large / small)
    return np.sqrt(area.sum() * ratio), np.sqrt(area.sum() / ratio)


@pytest.mark.parametrize("turn", [0.0, 40.0, 130.0])
def test_any_shape_equals_the_twin_in_metres(turn):
    random = np.random.default_rng(3)
    chosen = random.random(400) < 0.6
    x, y = (a.ravel()[chosen] * 2e3 for a in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    berg = Iceberg.from_points(c * x - s * y, s * x + c * y, thickness=200.0, radius=1e3, latlon=False)
    berg.elements.berg[:] = 1
    p = Parameters(earth={"latlon": False, "f_plane": True, "reference_latitude": -60.0, "period": 0.0})
    measure_outlines(berg.elements, p.kernel_values())
    want = moments(x, y, np.full(x.size, 4e6))
    np.testing.assert_allclose((berg.elements.berg_length[0], berg.elements.berg_width[0]), want, rtol=1e-9)


def test_a_berg_across_the_date_line_is_measured_as_anywhere():
    there, here = (measured(Iceberg.rectangle(LENGTH, WIDTH, thickness=200.0, placement=(lon, LATITUDE)))
                   for lon in (180.0, -30.0))  # fmt: skip
    np.testing.assert_allclose(there.berg_length, here.berg_length, rtol=1e-9)


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", ["waves", "air", "water", "sea_ice"])
def test_what_acts_on_sides_is_the_bergs_on_every_lattice(name):
    """The sum over elements: waves by 2 L W / (L + W), drag on sides by a quarter of the perimeter."""
    totals = []
    for radius, packing, angle in ((7500.0, "square", 0.0), (1500.0, "square", 0.0), (1000.0, "hexagonal", 30.0)):
        berg = berg_of(radius=radius, packing=packing, lattice_angle=angle)
        model = Model(
            berg,
            Forcing.uniform(
                wind=(15.0, 5.0), current=(0.2, 0.1), sea_ice=(0.3, 0.1, 1.0), ice_fraction=0.8, slope=(0.0, 0.0)
            ),
            Parameters(),
        )
        model.step()
        el, p = model.elements, model.constants
        row = surroundings_of(el, p)[0][name]
        totals.append(el.mass @ (row.push_x if name == "waves" else row.quadratic))
    np.testing.assert_allclose(totals, totals[0], rtol=0.01)
    assert totals[0] > 0.0


def test_forces_by_element_stay_where_the_reference_asks_for_them():
    """The reference's waves push inner elements too (Q34)."""
    by_element = Parameters(stepping={"scheme": "mts"}, compatibility={"forces_by_element": True})
    assert by_element.kernel_values().forces_by_element
    assert Parameters(stepping={"scheme": "mts"}, drag={"sides_by_bonds": False}).kernel_values().forces_by_element
    assert not Parameters().kernel_values().forces_by_element


@pytest.mark.parametrize("latitude", [60.0, 89.0, 89.9, 90.0, -89.95])
def test_length_and_width_are_those_of_the_ice_also_at_a_pole(latitude):
    """Bug once: within a degree of a pole the length was measured in degrees of longitude, and came out too long."""
    x, y = (a.ravel() for a in np.meshgrid(1e3 * np.arange(-14.5, 15.0), 1e3 * np.arange(-7.0, 7.5)))
    lon, lat = ConformalPlane(170.0, latitude, 6.371e6).inverse(*(np.array([[0.8, -0.6], [0.6, 0.8]]) @ [x, y]))
    side = np.full(x.size, 1e3)
    got = equivalent_rectangles(lon, lat, side, side, np.zeros(x.size, int), 1, True, 6.371e6, 360.0)
    assert float(got[0][0]) == pytest.approx(30e3, rel=1e-3)
    assert float(got[1][0]) == pytest.approx(15e3, rel=1e-3)
