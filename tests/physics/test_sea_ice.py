"""Pack ice on rigid bergs: drag by concentration, a hold that is limited, capture as published models have it, waves."""

from __future__ import annotations

import logging
import pickle
from typing import Any

import numpy as np
import pytest
import xarray as xr

from contract import FORCES
from engines.lattices import surroundings_of
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.errors import ForcingError, InputError
from riftberg.parameters import PUBLISHED_DRAG, Drag
from riftberg.state import ELEMENT_VARIABLES
from twins import sea_ice as twin

SUBSTEP_YIELD = 2e-3

ICE = (0.2, -0.05)
METRES: dict[str, Any] = {"latlon": False, "latitude": -70.0}
WAVES = FORCES.index("waves")


def model_of(
    length: float = 1e3, width: float | None = None, *, radius: float | None = None, velocity: Any = (0.0, 0.0),
    latitude: float = -70.0, thickness: float = 220.0, dt: float = 1800.0, sea: Any = None,
    lone: bool = False, **groups: Any,
) -> Model:  # fmt: skip
    """Return a berg on a plane, of one element if it is a lone one, in a pack of 1 m that is closed."""
    width = length if width is None else width
    berg = Iceberg.rectangle(
        length, width, thickness=thickness, radius=radius or 0.5 * width, placement=(0.0, 0.0), latlon=False,
        velocity=velocity,
    )  # fmt: skip
    if lone:
        berg = Iceberg.from_points(
            [0.0], [0.0], length=length, width=width, thickness=thickness, latlon=False, velocity=velocity
        )
    p = Parameters(**{
        "earth": {"latlon": False, "period": 0.0, "reference_latitude": latitude}, "stepping": {"time_step": dt},
        "fracture": {"enabled": False}, **groups,
    })  # fmt: skip
    return Model(berg, pack() if sea is None else sea, p)


def pack(thickness: float = 1.0, fraction: float = 1.0, ice: Any = ICE, **others: Any) -> Forcing:
    """Return water at rest under a pack of sea ice."""
    return Forcing.uniform(sea_ice=(*ice, thickness), ice_fraction=fraction, slope=(0.0, 0.0), **others)


def drift(model: Model) -> np.ndarray:
    """Mean velocity by mass, m s-1."""
    u, v = model.velocity()
    mass = model.elements.mass
    return np.array([mass @ u, mass @ v]) / mass.sum()


def momentum(model: Model) -> np.ndarray:
    """Momentum, N s."""
    return drift(model) * model.elements.mass.sum()


def rows_of(model: Model) -> dict[str, Any]:
    """Rows of the media with the environment that the elements carry."""
    el, p = model.elements, model.constants
    return surroundings_of(el, p)[0]


@pytest.mark.parametrize("capture", ["limited", "locked", "none"])
def test_rows_equal_the_twin(capture: str) -> None:
    model = model_of(6e3, 4e3, radius=1e3, sea_ice={"capture": capture})
    model.step()
    el, rng = model.elements, np.random.default_rng(4)
    env, draft = el.environment, 850.0 / 1025.0 * 220.0
    for fraction in (0.0, 0.1499, 0.15, 0.5, 0.86, 0.9, 1.0):
        env.ice_fraction[:] = fraction
        env.ice_thickness[:] = rng.choice([0.0, 0.3, 1.2, 3.0, 400.0], el.size)
        env.ua[:], env.va[:] = 9.0, -3.0
        rows = rows_of(model)
        calm = env.ice_fraction.copy()
        env.ice_fraction[:] = 0.0
        open_water = rows_of(model)
        env.ice_fraction[:] = calm
        for e in range(el.size):
            want = twin.row(el.mass[e], 5e3, el.side_share[e], env.ice_thickness[e], fraction, draft, capture)
            ice = rows["sea_ice"]
            np.testing.assert_allclose([ice.quadratic[e], ice.linear[e], ice.limit[e]], want[:3], rtol=1e-12)
            push, unhindered = rows["waves"].push_x[e], open_water["waves"].push_x[e]
            np.testing.assert_allclose(push, want[3] * unhindered, rtol=1e-12)


def test_a_hold_grows_with_thickness_strength_and_front_and_falls_with_open_water() -> None:
    """Units: 20 kPa and 1 m of ice bear 2e7 N on the front of a berg of 1 km."""

    def hold(model: Model, thickness: float = 1.0, fraction: float = 1.0) -> float:
        model.elements.ice_thickness[:], model.elements.ice_fraction[:] = thickness, fraction
        return float(model.elements.mass @ rows_of(model)["sea_ice"].limit)

    one = model_of()
    one.step()
    assert hold(one) == pytest.approx(2e7, rel=1e-12)
    assert hold(one, 3.0) == pytest.approx(6e7, rel=1e-12)
    assert hold(one, 1.0, 0.95) == pytest.approx(2e7 * np.exp(-1.0), rel=1e-12)
    other = model_of(3e3, 1e3, radius=500.0, sea_ice={"strength": "30 kPa", "decay": 10.0})
    other.step()
    assert hold(other) == pytest.approx(30e3 * 2e3, rel=1e-12)
    assert hold(other, 1.0, 0.9) == pytest.approx(30e3 * 2e3 * np.exp(-1.0), rel=1e-12)


@pytest.mark.parametrize("way", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, -0.8)])
@pytest.mark.parametrize("capture", ["limited", "locked", "none"])
def test_a_pack_takes_a_berg_its_own_way_and_as_fast_in_all_directions(way: tuple[float, float], capture: str) -> None:
    """Rotation: on a plane that does not turn the drift along the way of the pack is that along any other."""
    model = model_of(sea=pack(ice=(0.2 * way[0], 0.2 * way[1])), latitude=0.0, sea_ice={"capture": capture}, dt=600.0)
    model.advance(steps=6)
    along, across = drift(model) @ way, drift(model) @ (-way[1], way[0])
    assert along == pytest.approx(SPEEDS.setdefault(capture, along), rel=1e-6)
    assert abs(across) < 1e-9
    assert along > {"limited": 0.1998, "locked": 0.1998, "none": 1e-4}[capture]
    assert along < 0.2


SPEEDS: dict[str, float] = {}
"""Speed after an hour by capture, of the first direction."""


TABLE = {
    (1e3, 1e3): ((0.2, -0.05), (0.2, -0.05), (0.0736, 0.0882)),
    (6e3, 4e3): ((0.1615, 0.0609), (0.1076, 0.0851), (0.0058, 0.0389)),
    (24e3, 9e3): ((0.0365, 0.0676), (0.024, 0.0571), (0.0016, 0.024)),
}
"""Drift (m s-1) by length and width of a berg of 220 m at 70 S under 8 m/s of wind, for the packs of `PACKS`: roots of a balance
of water, air, Coriolis force and hold that somebody else has solved. Drags of base and top 0.0012 and 0.0055."""

RADII = {1e3: None, 6e3: 1e3, 24e3: 1.5e3}
"""Radius of the elements (m) by length of the berg."""

PACKS = ((1.0, 1.0), (2.0, 0.95), (0.5, 0.9))
"""Thickness (m) and concentration."""


@pytest.mark.quick(5)
@pytest.mark.parametrize("size", TABLE)
@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("own", [False, True], ids=["published drag", "own drag"])
def test_drift_in_a_pack_that_is_limited_is_that_of_the_table_of_roots(
    size: tuple[float, float], k: int, own: bool
) -> None:
    """From the root a berg does not drift away; from rest the two smaller ones come to it.

    The roots have the mean drag of the sides over all directions, which is that of a lone element.
    """
    (thickness, fraction), want = PACKS[k], TABLE[size][k]
    drag = Parameters().drag if own else Drag(**PUBLISHED_DRAG)
    root = twin.drift(*size, 220.0, -70.0, (8.0, 0.0), ICE, thickness, fraction, drag.water_base, drag.air_top)
    if own:
        want = root
    np.testing.assert_allclose(root, want, atol=1e-4)
    model = model_of(
        *size, lone=True, sea=pack(thickness, fraction, wind=(8.0, 0.0)), velocity=want, drag=drag
    )  # fmt: skip
    model.advance(days=1.5)
    np.testing.assert_allclose(drift(model), want, atol=1e-3)
    if size[0] < 5e3:
        model = model_of(*size, lone=True, sea=pack(thickness, fraction, wind=(8.0, 0.0)), drag=drag)
        model.advance(days=3.0)
        np.testing.assert_allclose(drift(model), want, atol=1e-3)


BONDED = ((3e3, 3e3, 0.75e3), (6e3, 4e3, 1e3), (24e3, 9e3, 1.5e3), (10e3, 30e3, 2.5e3))
"""Length, width and radius of the elements (m) of bergs with bonds."""


@pytest.mark.compiled
@pytest.mark.quick(4)
@pytest.mark.parametrize("size", BONDED)
@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("wind", [(8.0, 0.0), (-6.0, 10.0)])
def test_a_bonded_berg_drifts_in_a_pack_as_the_balance_with_its_outline_has_it(
    size: tuple[float, float, float], k: int, wind: tuple[float, float]
) -> None:
    """With the default coefficients: from the root it does not drift away, and it does not turn."""
    (thickness, fraction), drag = PACKS[k], Parameters().drag
    length, width, radius = size
    root = twin.drift(
        length, width, 220.0, -70.0, wind, ICE, thickness, fraction, drag.water_base, drag.air_top, outline=True
    )
    model = model_of(length, width, radius=radius, sea=pack(thickness, fraction, wind=wind), velocity=tuple(root))
    assert model.elements.size > 3
    model.advance(days=1.5)
    np.testing.assert_allclose(drift(model), root, atol=1e-3)
    assert abs(model.elements.spin).max() < 1e-7


@pytest.mark.parametrize("size", TABLE)
def test_a_pack_that_is_locked_carries_bergs_along_where_it_is_dense_and_strong(size: tuple[float, float]) -> None:
    for k, (thickness, fraction) in enumerate(PACKS):
        sea = pack(thickness, fraction, wind=(8.0, 0.0))
        model = model_of(*size, radius=RADII[size[0]], sea=sea, sea_ice={"capture": "locked"})
        model.advance(steps=4)
        off = np.hypot(*(drift(model) - ICE))
        assert off < 2e-4 if k < 2 else off > 0.05


def test_a_pack_that_is_locked_loads_no_giant_by_its_own_shear() -> None:
    """It carries the berg by its mean: ice whose drift varies along a berg would tear it at once, were each element to follow."""

    class Shear(Forcing.uniform):
        def sample(self, elements: Any, time: float) -> None:
            super().sample(elements, time)
            elements.environment.ui[:] = 0.2 + 1e-5 * elements.lon

    model = model_of(
        24e3, 9e3, radius=1.5e3, sea=Shear(sea_ice=(*ICE, 1.0), ice_fraction=1.0), sea_ice={"capture": "locked"},
        fracture={"enabled": True},
    )  # fmt: skip
    model.advance(steps=4)
    assert model.bonds_broken == 0
    assert np.hypot(*(drift(model) - (0.2 + 1e-5 * model.elements.lon.mean(), ICE[1]))) < 1e-3


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.1499])
def test_below_the_least_concentration_the_sea_is_open_to_the_digit(fraction: float) -> None:
    ends = []
    for sea in (pack(3.0, fraction, wind=(8.0, 2.0)), Forcing.uniform(wind=(8.0, 2.0))):
        model = model_of(sea=sea)
        model.advance(steps=5)
        ends.append(np.array([model.elements.lon, model.elements.lat, *model.velocity()]).tobytes())
    assert ends[0] == ends[1]


def test_concentration_reaches_the_force_and_the_waves_and_not_the_wind_on_the_sail() -> None:
    """Bug: with 0, 0.5 and 1 of ice of 1 m all digits of the drift were alike."""
    drifts, waves, air = [], [], []
    for fraction in (0.2, 0.5, 0.8, 1.0):
        model = model_of(sea=pack(1.0, fraction, wind=(8.0, 0.0)))
        model.advance(steps=8)
        drifts.append(tuple(drift(model)))
        forces = dict(zip(FORCES, model.applied_forces().sum(axis=0), strict=True))
        waves.append(forces["waves"][0])
        air.append(forces["air"][0])
    assert len(set(drifts)) == 4
    np.testing.assert_allclose(np.array(waves) / waves[0], [1.0, 0.5 / 0.8, 0.2 / 0.8, 0.0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(air, air[0], rtol=0.05)


def test_ice_beside_a_berg_takes_the_place_of_water_by_its_mean_depth() -> None:
    model = model_of(60.0, thickness=40.0)
    model.step()
    water = []
    for fraction in (0.0, 0.5, 1.0):
        model.elements.ice_thickness[:], model.elements.ice_fraction[:] = 4.0, fraction
        water.append(rows_of(model)["water"].quadratic[0])
    assert water[0] - water[2] == pytest.approx(2.0 * (water[0] - water[1]), rel=1e-9)


SCENES = {
    "lone": (400.0, 400.0, None), "lone and small": (40.0, 30.0, None), "bonded": (6e3, 4e3, 1e3), "giant": (24e3, 9e3, 4.5e3)
}  # fmt: skip


@pytest.mark.quick(3)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("fraction", [1.0, 0.9, 0.8])
def test_the_ledger_closes_and_no_pack_gives_more_than_it_bears(scene: str, fraction: float) -> None:
    """Through a wind that turns about and a pack that stops: what all forces gave is the change of momentum."""
    length, width, radius = SCENES[scene]
    thickness = 20.0 if length < 100.0 else 220.0
    model = model_of(length, width, radius=radius, thickness=thickness, sea=pack(1.0, fraction, wind=(8.0, 0.0)))
    most = twin.strength(1.0, fraction) * 0.5 * (length + width)
    row = FORCES.index("sea_ice")
    for n in range(9):
        if n == 3:
            model.forcing = pack(1.0, fraction, wind=(-15.0, 10.0))
        if n == 6:
            model.forcing = pack(1.0, fraction, ice=(0.0, 0.0), wind=(-15.0, 10.0))
        before = momentum(model)
        model.step()
        forces = model.applied_forces()
        change = (momentum(model) - before) / 1800.0
        np.testing.assert_allclose(forces.sum(axis=(0, 1)), change, rtol=0, atol=1e-7 * np.abs(forces).sum())
        if n % 3 == 2:  # what comes suddenly lags by half a step
            relative = np.hypot(*(np.array(ICE if n < 6 else (0.0, 0.0)) - drift(model)))
            drags = 0.5 * 916.7 * 0.9 * 0.5 * (length + width) * fraction * max(relative, 0.25) ** 2
            assert np.hypot(*forces[:, row].sum(axis=0)) <= 1.05 * most + drags


def test_what_a_pack_bears_it_holds_to_a_tenth_of_a_millimetre_a_second() -> None:
    """In steps of an hour, for bergs of 40 m to 1 km, from rest and flung."""
    for size, thickness in ((40.0, 20.0), (200.0, 150.0), (1e3, 220.0)):
        for velocity in ((0.0, 0.0), (1.0, 0.5)):
            model = model_of(size, thickness=thickness, sea=pack(wind=(5.0, 0.0)), velocity=velocity, dt=3600.0)
            model.advance(steps=6)
            assert np.hypot(*(drift(model) - ICE)) < 1e-4


def test_a_strong_current_pulls_a_berg_through() -> None:
    """No switch: beyond what the pack bears the berg slips by the root of the excess, as drag of water has it."""
    off = []
    for speed in (0.0, 0.2, 0.4, 0.6, 0.8):
        model = model_of(400.0, sea=pack(0.5, 0.97, ice=(0.0, 0.0), current=(speed, 0.0)), latitude=0.0)
        model.advance(steps=12)
        off.append(drift(model)[0])
    assert off[0] < 1e-9
    assert off[1] < 1e-4
    draft = 850.0 / 1025.0 * 220.0
    water = 1025.0 * (0.45 * 400.0 * (draft - 0.485) + Parameters().drag.water_base * 400.0**2)
    slip = np.sqrt(twin.strength(0.5, 0.97) * 400.0 / water)
    np.testing.assert_allclose(off[2:], np.array([0.4, 0.6, 0.8]) - slip, atol=2e-3)


@pytest.mark.parametrize("radius", [None, 1e3], ids=["lone", "bonded"])
@pytest.mark.parametrize("capture", ["limited", "locked"])
def test_a_run_that_is_kept_and_taken_up_goes_on_bit_for_bit(radius: float | None, capture: str) -> None:
    runs = []
    for parted in (False, True):
        model = model_of(6e3, 4e3, radius=radius, sea=pack(0.5, 0.9, wind=(8.0, 4.0)), sea_ice={"capture": capture})
        model.advance(steps=3)
        model = pickle.loads(pickle.dumps(model)) if parted else model
        model.advance(steps=3)
        runs.append({v.name: getattr(model.elements, v.name).tobytes() for v in ELEMENT_VARIABLES})
    assert runs[0] == runs[1]


def test_bergs_that_stand_close_go_with_the_pack_through_sub_steps_of_contact() -> None:
    one, other = (
        Iceberg.rectangle(600.0, 600.0, thickness=220.0, radius=300.0, placement=(x, 0.0), latlon=False)
        for x in (0.0, 650.0)
    )
    p = Parameters(earth={"latlon": False, "period": 0.0, "reference_latitude": -70.0}, fracture={"enabled": False})
    model = Model(Iceberg.join([one, other]), pack(wind=(8.0, 0.0)), p)
    model.advance(steps=12)
    for u, v in np.transpose(model.velocity()):
        assert np.hypot(u - ICE[0], v - ICE[1]) <= 1.1 * SUBSTEP_YIELD


def test_a_berg_on_the_sea_floor_stays_in_a_pack_that_goes_by() -> None:
    """Its ground bears more than the pack; `locked` is no force that could drag it off."""
    depth = 850.0 / 1025.0 * 220.0 - 0.5
    for capture in ("limited", "locked"):
        model = model_of(sea=pack(depth=depth), sea_ice={"capture": capture}, dt=600.0)
        model.advance(steps=4)
        assert model.elements.floor_load[0] > 0.0
        assert np.hypot(*drift(model)) < 1e-3
        assert np.hypot(model.elements.lon[0], model.elements.lat[0]) < 5.0


def test_explicit_schemes_know_no_concentration() -> None:
    for scheme in ("mts", "verlet", "runge_kutta"):
        ends = []
        for fraction in (0.0, 1.0):
            model = model_of(
                sea=pack(1.0, fraction, wind=(8.0, 0.0)), stepping={"scheme": scheme, "time_step": 60.0}, bonds={"law": "none"}
            )  # fmt: skip
            model.advance(steps=3)
            ends.append(np.array([model.elements.lon, model.elements.lat, *model.velocity()]).tobytes())
            assert (rows_of(model)["sea_ice"].limit == 0.0).all()
            assert (rows_of(model)["sea_ice"].quadratic > 0.0).all()
        assert ends[0] == ends[1]


def test_a_concentration_a_strength_or_a_limit_that_cannot_be_is_refused() -> None:
    for key, value in (
        ("strength", -1.0), ("strength", 1e9), ("decay", -2.0), ("least_concentration", 1.2), ("locked_concentration", -0.1),
        ("locked_strength", -5.0), ("capture", "switch"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=key):
            Parameters(sea_ice={key: value})
    for make in (Forcing.uniform,):
        with pytest.raises(ForcingError, match="ice_fraction"):
            make(ice_fraction=1.5)

    class InPercent(Forcing.uniform):
        def sample(self, elements: Any, time: float) -> None:
            super().sample(elements, time)
            elements.environment.ice_fraction[:] = 95.0

    with pytest.raises(ForcingError, match="ice_fraction = 95 at element 1 is no part of the sea"):
        model_of(sea=InPercent(sea_ice=(0.1, 0.0, 1.0))).step()


def dataset(*left_out: str) -> xr.Dataset:
    """Return a sea at rest with wind and a closed pack, less some fields."""
    fields = {
        "uo": ("eastward_sea_water_velocity", "m s-1", 0.0), "vo": ("northward_sea_water_velocity", "m s-1", 0.0),
        "usi": ("eastward_sea_ice_velocity", "m s-1", 0.2), "vsi": ("northward_sea_ice_velocity", "m s-1", -0.05),
        "siconc": ("sea_ice_area_fraction", "1", 1.0), "sithick": ("sea_ice_thickness", "m", 1.0),
        "zos": ("sea_surface_height_above_geoid", "m", 0.0),
    }  # fmt: skip
    axes = {
        "lat": ("lat", np.arange(-72.0, -67.0), {"units": "degrees_north"}),
        "lon": ("lon", np.arange(-42.0, -37.0), {"units": "degrees_east"}),
        "time": ("time", np.array(["2020-08-01", "2020-08-03"], "M8[ns]")),
    }
    ds = xr.Dataset(coords=axes)
    for name, (standard, units, value) in fields.items():
        if name not in left_out:
            attributes = {"standard_name": standard, "units": units}
            ds[name] = ("time", "lat", "lon"), np.full((2, 5, 5), value), attributes
    return ds


LACKING = {
    "velocity (ui)": ("usi", "vsi"), "thickness (ice_thickness)": ("sithick",), "concentration (ice_fraction)": ("siconc",),
    "thickness (ice_thickness) and velocity (ui)": ("sithick", "usi", "vsi"),
}  # fmt: skip


@pytest.mark.parametrize("words", [None, *LACKING])
def test_a_pack_of_files_needs_all_three_and_what_lacks_is_told_once(words: str | None) -> None:
    """A pack without a velocity would hold bergs as if it stood still."""
    forcing = Forcing.from_xarray(dataset(*LACKING[words]) if words else dataset())
    berg = Iceberg.rectangle(1e3, 1e3, thickness=220.0, radius=500.0, placement=(-40.0, -70.0), velocity=(0.05, 0.0))
    model = Model(berg, forcing, Parameters(fracture={"enabled": False}))
    model.advance(steps=3)
    force = model.applied_forces()[0, FORCES.index("sea_ice")]
    told = [text for text in forcing.notices if "sea ice" in text]
    if words is None:
        assert np.hypot(*(drift(model) - ICE)) < 1e-3
        assert not told
    else:
        assert (force == 0.0).all()
        assert len(told) == 1
        assert f"sea ice without its {words} exerts no force" in told[0]


def test_formulas_that_give_no_concentration_are_told_in_the_same_words(caplog: pytest.LogCaptureFixture) -> None:
    words = "sea ice without its concentration (ice_fraction) exerts no force in the default scheme"
    for forcing in (Forcing.uniform(sea_ice=(*ICE, 1.0)), Forcing.uniform(sea_ice=(*ICE, 1.0), **METRES)):
        model = model_of(sea=forcing)
        with caplog.at_level(logging.WARNING):
            model.advance(steps=1)
        assert [text for text in model.notices if "sea ice" in text] == [words]
    assert caplog.text.count(words) == 2
    for forcing in (pack(), Forcing.uniform(sea_ice=(*ICE, 1.0), ice_fraction=0.9, **METRES), Forcing.uniform()):
        assert not any("sea ice" in text for text in model_of(sea=forcing).notices)
    explicit = model_of(sea=Forcing.uniform(sea_ice=(*ICE, 1.0)), stepping={"scheme": "mts"})
    assert not any("sea ice" in text for text in explicit.notices)


def test_uniform_and_steady_ice_are_one() -> None:
    ends = []
    for sea in (pack(0.5, 0.9), Forcing.uniform(sea_ice=(*ICE, 0.5), ice_fraction=0.9, **METRES)):
        model = model_of(sea=sea)
        model.advance(steps=4)
        ends.append(drift(model))
    np.testing.assert_allclose(*ends, rtol=1e-9)
