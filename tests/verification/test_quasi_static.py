"""The quasi-static scheme against theory, against itself at other steps, and against the explicit scheme."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Options, Parameters
from riftberg.errors import InputError, RunError
from riftberg.experiments.a68a import story_model
from scripts import loaded
from verification.setups import RADIUS, lattice, parameters, turn

CONVERGENCE = loaded("benchmarks/convergence.py")


def quasi(**groups: Any) -> Parameters:
    """Parameters of the verification tests with the quasi-static scheme."""
    stepping = {"scheme": "quasi_static", **groups.pop("stepping", {})}
    return parameters(stepping=stepping, **groups)


class Whirl(Forcing.uniform):
    """A current that shears and turns once in a day, so that every element is pushed another way."""

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        phase = 2 * math.pi * time / 86_400.0
        elements.uo[:] = 0.3 * math.cos(phase) + 2e-5 * elements.lat
        elements.vo[:] = 0.3 * math.sin(phase) - 1e-5 * elements.lon


def order(results: list[Any]) -> float:
    """Order from results with steps that halve; the mean over the sequence."""
    errors = [np.abs(a - b).max() for a, b in pairwise(results)]
    return float(np.mean(np.log2(np.array(errors[:-1]) / errors[1:])))


# Motion


@pytest.mark.slow
def test_order_in_the_long_step(agrees) -> None:
    """Places and turns of the elements after two days are of second order in the step."""
    ends = []
    # In longer ones drag takes more than a quarter of the speed through the water, and is taken with a smaller error.
    for dt in (1800.0, 900.0, 450.0, 225.0):
        p = quasi(
            stepping={"time_step": dt}, drag={"ocean_scale": 17.8}, bonds={"youngs_modulus": 1e9},
            earth={"reference_latitude": -55.0},
        )  # fmt: skip
        model = lattice(p, 7, 3, Whirl())
        model.advance(steps=round(172_800.0 / dt))
        ends.append(np.concatenate([model.elements.lon, model.elements.lat]))
    agrees("order of the quasi-static scheme, drag and Coriolis", 2.0, order(ends), abs=0.25)


def test_free_rotation_goes_on(agrees) -> None:
    """Without forces spin and angular momentum stay, and after a turn the berg is back."""
    period = 86_400.0
    stiff = {"youngs_modulus": 9e9}
    model = lattice(quasi(stepping={"only_interactions": True, "time_step": 1800.0}, bonds=stiff), 7, 3)
    turn(model, 2 * math.pi / period)
    x, y = model.elements.lon.copy(), model.elements.lat.copy()
    model.advance(steps=48)
    agrees("quasi-static: turn in a day (rad)", 2 * math.pi, float(model.elements.rotation.mean()), rel=1e-9)
    # The lattice is stretched by its rotation by a fifth of a millimetre: the places hold to that.
    assert np.hypot(model.elements.lon - x, model.elements.lat - y).max() < 1e-3
    assert np.ptp(model.elements.spin) < 1e-18


def test_rotation_stretches_the_lattice_as_theory_says(agrees) -> None:
    """A chain that turns carries the centrifugal force of what lies beyond each bond."""
    model = lattice(quasi(stepping={"only_interactions": True}), 9, 1)
    rate = 1e-4
    turn(model, rate)
    x = model.elements.lon.copy()
    model.advance(steps=1)
    el, b = model.elements, model.bonds
    middle = np.abs(0.5 * (x[b.first] + x[b.second])).argmin()
    beyond = x > 0.5 * (x[b.first[middle]] + x[b.second[middle]])
    force = float((el.mass * rate**2 * x)[beyond].sum())
    agrees("quasi-static: stress by rotation (Pa)", force / (2 * RADIUS * 200.0), b.normal_stress[middle], rel=0.005)


def test_fragments_in_contact_keep_their_momentum(agrees) -> None:
    p = quasi(stepping={"only_interactions": True, "time_step": 1800.0}, drag={"rotational": False})
    x = np.concatenate([np.arange(4) * 3000.0, 14_000.0 + np.arange(3) * 3000.0])
    y = np.concatenate([np.zeros(4), np.full(3, 1000.0)])
    u = np.where(x < 13_000.0, 0.4, -0.1)
    berg = Iceberg.from_points(x, y, radius=RADIUS, thickness=200.0, velocity=(u, 0.0 * u), latlon=False)
    model = Model(berg, Forcing.uniform(), p)
    el = model.elements
    before = (el.mass * el.u).sum(), (el.mass * el.v).sum()
    model.advance(steps=60)
    assert np.ptp(el.berg) == 1
    assert el.u[0] < 0.3  # they have met
    agrees("quasi-static: momentum of two bergs that meet (kg m s-1)", before[0], (el.mass * el.u).sum(), rel=1e-9)
    assert abs((el.mass * el.v).sum()) < 1e-9 * before[0]


# Stress


def test_stress_does_not_depend_on_youngs_modulus(agrees) -> None:
    """From 5 MPa to 9 GPa: what is left is the displacement of a soft lattice in the sheared current."""
    stress = []
    for youngs in (5e6, 9e9):
        p = quasi(stepping={"time_step": 1800.0}, drag={"ocean_scale": 17.8}, bonds={"youngs_modulus": youngs})
        model = lattice(p, 12, 4, Whirl())
        model.advance(steps=24)
        stress.append(model.bonds.normal_stress.copy())
    largest = float(stress[1].max())
    agrees("quasi-static: stress at 5 MPa and 9 GPa (Pa)", largest, float(stress[0].max()), rel=0.01)
    assert np.abs(stress[0] - stress[1]).max() < 0.01 * largest


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_stress_turns_with_the_berg(packing) -> None:
    """Turned by 30 degrees with its current, a berg has the same stresses."""
    stress = []
    for angle in (0.0, math.radians(30.0)):
        p = quasi(stepping={"time_step": 1800.0}, drag={"ocean_scale": 17.8}, bonds={"packing": packing})
        model = lattice(p, 8, 4, Turned(angle))
        el = model.elements
        c, s = math.cos(angle), math.sin(angle)
        x, y = el.lon.copy(), el.lat.copy()
        for name in ("lon", "lon_pair"):
            getattr(el, name)[:] = c * x - s * y
        for name in ("lat", "lat_pair"):
            getattr(el, name)[:] = s * x + c * y
        model.advance(steps=12)
        stress.append(model.bonds.normal_stress.copy())
    np.testing.assert_allclose(stress[0], stress[1], rtol=0, atol=1e-7 * np.abs(stress[0]).max())


class Turned(Forcing.uniform):
    """A sheared current turned by an angle (rad)."""

    def __init__(self, angle: float) -> None:
        super().__init__()
        self.angle = angle

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        c, s = math.cos(self.angle), math.sin(self.angle)
        across = -s * elements.lon + c * elements.lat
        along = 0.2 + 2e-5 * across
        elements.uo[:], elements.vo[:] = c * along, s * along


# Breaking


def pulled(strength: float, **groups: Any) -> Model:
    """A notched plate pulled apart along x by loads that outgrow its strength at the notch."""
    p = quasi(
        fracture={"enabled": True, "normal_strength": strength, "shear_strength": 1e9},
        stepping={"only_interactions": True, "time_step": 1800.0}, **groups,
    )  # fmt: skip
    model = lattice(p, 10, 6)
    el, b = model.elements, model.bonds
    el.load_x[:] = np.where(el.lon > 13e3, 4e9, np.where(el.lon < -13e3, -4e9, 0.0))
    middle = 0.5 * (el.lon[b.first] + el.lon[b.second])
    height = 0.5 * (el.lat[b.first] + el.lat[b.second])
    notch = (np.abs(middle) < 100.0) & (height < -5e3)
    b.status[notch] = 2
    el.bond_count[b.first[notch]] -= 1
    el.bond_count[b.second[notch]] -= 1
    return model


def test_a_crack_runs_through_in_one_step() -> None:
    """All bonds of the cross-section break at one time, and the pieces part; the crack releases energy."""
    whole = pulled(1e9)
    whole.advance(steps=1)
    model = pulled(0.8 * whole.bonds.normal_stress.max())
    model.advance(steps=1)
    times = model.bonds.break_time[np.isfinite(model.bonds.break_time)]
    assert times.size == 5
    assert np.ptp(times) == 0.0
    assert model.fragment_count == 2
    assert [f.elements for f in model.fragments.breakups] == [30]
    assert model.bonds.released_energy.max() > 0.0
    assert (model.bonds.released_energy != 0.0).sum() == 1
    # What is left is pulled less than what was whole.
    intact = model.bonds.status == 0
    assert model.bonds.normal_stress[intact].max() < whole.bonds.normal_stress.max()


def test_a_crack_that_stops_inside_releases_what_griffith_says() -> None:
    """The middle of a plate breaks over 12 km: twice the integral of K^2 t / E over half of it, for a plate of 40 km (Feddersen).

    The energy had the other sign: under loads that stay the plate with the crack stores more than without.
    """
    p = quasi(
        fracture={"enabled": True, "normal_strength": 1e12, "shear_strength": 1e12},
        stepping={"only_interactions": True, "time_step": 1800.0},
    )  # fmt: skip
    model = Model(Iceberg.rectangle(40e3, 40e3, thickness=250.0, radius=1000.0, latlon=False), Forcing.uniform(), p)
    el, b = model.elements, model.bonds
    el.load_x[:] = np.where(el.lon > 18e3, 4e9, np.where(el.lon < -18e3, -4e9, 0.0))
    across = np.abs(el.lat[b.first] - el.lat[b.second]) < 1.0
    middle, height = 0.5 * (el.lon[b.first] + el.lon[b.second]), 0.5 * (el.lat[b.first] + el.lat[b.second])
    weak = across & (np.abs(middle) < 100.0) & (np.abs(height) < 6e3)
    b.strength[weak] = 1e-9
    model.step()
    assert (model.bonds.status != 0).sum() == weak.sum() == 6
    assert model.fragment_count == 1
    half = np.linspace(0.0, 6e3, 601)
    k2 = (4e9 * 20 / (250.0 * 40e3)) ** 2 * np.pi * half / np.cos(np.pi * half / 40e3)
    griffith = 2.0 * 250.0 / p.bonds.youngs_modulus * float(np.trapezoid(k2, half))
    assert model.bonds.released_energy.sum() == pytest.approx(griffith, rel=0.1)


def test_a_berg_on_rollers_that_has_turned_is_refused() -> None:
    """Rollers stood across the axis of the berg, not north: turned by 90 degrees it went 97 m through one."""
    p = quasi(stepping={"only_interactions": True, "time_step": 1800.0}, fracture={"enabled": False})
    model = lattice(p, 6, 2)
    turn(model, 0.05 / 1800.0)
    model.step()
    model.elements.free_y[0] = 0.0
    with pytest.raises(RunError, match=r"free_y = 0\) has turned by 2.9 degrees"):
        model.step()


def test_a_berg_on_one_roller_goes_along_it_and_turns_about_it() -> None:
    """Bug: the motions that one support leaves were not those at right angles to it, and the held element went along."""
    p = quasi(stepping={"only_interactions": True, "time_step": 60.0}, fracture={"enabled": False})
    model = lattice(p, 6, 2)
    el = model.elements
    end = int(np.argmin(el.lon))
    el.free_y[end], lat = 0.0, float(el.lat[end])
    el.u[:], el.v[:] = 0.01, 0.01
    for _ in range(3):
        model.step()
    assert el.lat[end] == pytest.approx(lat, abs=1e-4)  # not held: 1.8 m
    assert el.u[end] > 0.005
    assert el.v[np.argmax(el.lon)] > 0.005


def test_nothing_breaks_below_the_strength() -> None:
    whole = pulled(1e9)
    whole.advance(steps=1)
    model = pulled(1.001 * whole.bonds.normal_stress.max())
    model.advance(steps=3)
    assert model.bonds_broken == 0


@pytest.mark.quick(1)
@pytest.mark.parametrize("dt", [1800.0, 900.0, 450.0])
def test_time_of_a_break_does_not_depend_on_the_step(agrees, dt) -> None:
    """Loads of a current that rises: the break comes when the stress reaches the strength, within a step."""
    times = []
    for step in (100.0, dt):
        p = quasi(
            stepping={"time_step": step}, drag={"ocean_scale": 17.8},
            fracture={"enabled": True, "normal_strength": 900.0, "shear_strength": 1e9},
        )  # fmt: skip
        model = lattice(p, 14, 4, Rising())
        model.advance(steps=round(36_000.0 / step))
        times.append(float(np.nanmin(model.bonds.break_time)))
    agrees(f"quasi-static: time of the first break, step {dt:g} s (h)", times[0] / 3600, times[1] / 3600, abs=0.05)


class Rising(Forcing.uniform):
    """Currents against each other, that rise over ten hours."""

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.vo[:] = 0.5 * (time / 36_000.0) * np.cos(np.pi * elements.lon / 21e3)


def test_laws_that_it_cannot_hold_are_refused() -> None:
    for bonds in ({"law": "spring"}, {"no_shear": True}):
        with pytest.raises((InputError, ValueError), match=r"quasi_static|is of the explicit schemes"):
            quasi(bonds=bonds)


# A68a


SMOOTH_SIDES = {"water_side": 0.0, "air_side": 0.0}


def story(dt: float, *, fracture: bool = True, without: tuple[str, ...] = (), **groups: Any) -> Model:
    """The built-in A68a with the quasi-static scheme."""
    stepping = {"scheme": "quasi_static", "time_step": dt, **groups.pop("stepping", {})}
    return story_model(Options({"stepping": stepping, "fracture": {"enabled": fracture}, **groups}, without=without))


def azimuth(model: Model) -> float:
    """Direction of the long axis, degrees."""
    el = model.elements
    x, y = (el.lon - el.lon.mean()) * math.cos(math.radians(float(el.lat.mean()))), el.lat - el.lat.mean()
    return math.degrees(0.5 * math.atan2(2 * (x @ y), x @ x - y @ y))


def apart(a: Model, b: Model) -> float:
    """Distance of the centroids, m."""
    metre = math.radians(a.parameters.earth.radius)
    east = (a.elements.lon.mean() - b.elements.lon.mean()) * math.cos(math.radians(float(a.elements.lat.mean())))
    return metre * math.hypot(east, a.elements.lat.mean() - b.elements.lat.mean())


@pytest.mark.slow
def test_path_and_rotation_are_those_of_the_explicit_scheme(agrees) -> None:
    """A68a after ten days without breaks: steps of 1800 s against the explicit scheme at 300 s.

    Sides are without drag: each engine has a law for them.
    """
    quick = story(1800.0, fracture=False, without=("shoal",), drag=SMOOTH_SIDES)
    quick.advance(days=10)
    slow = story(
        300.0, fracture=False, without=("shoal",), drag=SMOOTH_SIDES, stepping={"scheme": "mts", "substeps": 15}
    )
    slow.advance(days=10)
    agrees("quasi-static: A68a after 10 days, from the explicit path (m)", 0.0, apart(quick, slow), abs=300.0)
    difference = (azimuth(quick) - azimuth(slow) + 90.0) % 180.0 - 90.0
    agrees("quasi-static: A68a after 10 days, azimuth (degree)", 0.0, difference, abs=1.0)


@pytest.mark.slow
def test_explicit_stress_tends_to_equilibrium_as_its_steps_shrink(agrees) -> None:
    """From one state, over the hours in which the finger is loaded: explicit long steps of 150 s and 50 s.

    Against the equilibrium of its bonds under the loads of the quasi-static scheme.
    """
    quick = story(1800.0, fracture=False, without=("shoal",), drag=SMOOTH_SIDES)
    quick.advance(steps=2 * 255)
    explicit = {}
    for dt, substeps in ((150.0, 8), (50.0, 4)):
        stepping = {"scheme": "mts", "substeps": substeps}
        model = story(dt, fracture=False, without=("shoal",), drag=SMOOTH_SIDES, stepping=stepping)
        for there, here in ((quick.elements, model.elements), (quick.bonds, model.bonds)):
            for name, values in there.arrays().items():
                if name != "substeps":
                    getattr(here, name)[:] = values
        model.time, model.step_number = quick.time, 1
        model.advance(steps=round(11 * 3600.0 / dt))
        explicit[dt] = model.bonds.normal_stress
    quick.advance(steps=22)
    stress = CONVERGENCE.Beams(quick).stress(quick)
    off = {dt: float(np.sqrt(np.mean((s - stress) ** 2)) / stress.max()) for dt, s in explicit.items()}
    agrees("quasi-static: stress from explicit 50 s, rms over largest", 0.0, off[50.0], abs=0.003)
    agrees("quasi-static: stress from explicit 150 s, rms over largest", 0.0, off[150.0], abs=0.003)
    agrees("quasi-static: largest stress from explicit 50 s (Pa)", float(explicit[50.0].max()), stress.max(), rel=0.02)
    assert off[50.0] < off[150.0]


@pytest.mark.slow
@pytest.mark.parametrize("dt", [900.0, 450.0])
def test_the_story_does_not_depend_on_the_long_step(agrees, dt) -> None:
    """Times of both break-ups of A68a and areas of the large pieces."""
    told = []
    for step in (1800.0, dt):
        model = story(step)
        model.advance(days=12)
        told.append([(f.birth_time / 3600.0, f.area / 1e6) for f in model.fragments.breakups if f.area > 50e6])
    assert [area for _, area in told[0]] == [area for _, area in told[1]]
    assert len(told[0]) == 2
    for (one, area), (two, _) in zip(*told, strict=True):
        agrees(f"quasi-static: break-up of {area:.0f} km2 at {dt:g} s (h)", one, two, abs=1.0)


@pytest.mark.slow
def test_the_stress_of_the_story_does_not_depend_on_youngs_modulus(agrees) -> None:
    """A68a for twelve days without breaks, its landing included: all bonds every twelve hours, and the largest of all steps."""
    hours, peaks = [], []
    for youngs in (9e9, 5e6):
        model = story(1800.0, fracture=False, bonds={"youngs_modulus": youngs})
        stress, peak = [], []
        for _ in range(24):
            for _ in range(24):
                model.step()
                peak.append(float(model.bonds.peak_stress.max()))
            stress.append(model.bonds.normal_stress.copy())
        hours.append(np.array(stress))
        peaks.append(np.array(peak))
    largest = float(hours[0].max())
    agrees("quasi-static: A68a at 5 MPa and 9 GPa, largest at records (Pa)", largest, float(hours[1].max()), rel=0.01)
    for what, part in (("landing", slice(None, 400)), ("load of the finger", slice(450, None))):
        one, two = (float(peak[part].max()) for peak in peaks)
        agrees(f"quasi-static: A68a at 5 MPa and 9 GPa, {what} (Pa)", one, two, rel=0.01)
    off = float(np.sqrt(np.mean((hours[1] - hours[0]) ** 2)) / largest)
    agrees("quasi-static: A68a at 5 MPa and 9 GPa, all bonds, rms over largest", 0.0, off, abs=0.01)


@pytest.mark.slow
def test_the_story_does_not_depend_on_youngs_modulus(agrees) -> None:
    """What the landing takes off, pieces and splinters together, and what the current does; in kilometres squared and hours."""
    told = []
    for youngs in (9e9, 5e6):
        model = story(1800.0, bonds={"youngs_modulus": youngs})
        model.advance(days=12)
        landed, *_, finger = (f.birth_time / 3600.0 for f in model.fragments.breakups)
        tip = sum(f.area for f in model.fragments.breakups if f.birth_time / 3600.0 < landed + 1.0)
        told.append((landed, tip / 1e6, finger, model.fragments.breakups[-1].area / 1e6))
    for name, one, two in zip(("tip off (h)", "tip (km2)", "finger off (h)", "finger (km2)"), *told, strict=True):
        agrees(f"quasi-static: A68a at 5 MPa and 9 GPa, {name}", one, two, rel=0.01)
