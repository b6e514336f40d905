"""Spin of lone elements and of bonded ones in the default scheme: who is braked by its sides, and with which inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engines.lattices import surroundings_of
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.forces.sizes import interaction_sizes
from twins import drag as twin

FLAT: dict[str, Any] = {"latlon": False, "period": 0.0}
DAY = 86400.0


class Whirl(Forcing.uniform):
    """Still water that turns."""

    vorticity = 0.0

    def sample(self, elements, time) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.vorticity[:] = self.vorticity


DRAG = Parameters().drag


def lone(length: float, width: float, thickness: float = 40.0, dt: float = 600.0, **groups: Any) -> Model:
    """A lone berg that spins at 1e-3 s-1 in still water."""
    side = np.sqrt(length * width)
    berg = Iceberg.rectangle(side, side, thickness=thickness, radius=0.5 * side, latlon=False, spin=1e-3)
    berg.elements.length[:], berg.elements.width[:] = length, width
    stepping = {"time_step": dt, **groups.pop("stepping", {})}
    return Model(berg, Whirl(), Parameters(earth=FLAT, stepping=stepping, **groups))


def braking(length: float, width: float, thickness: float, scale: float = 1.0) -> float:
    """Coefficient k (rad-1) of w' = -k |w| w by the twins of base and sides, with the inertia of a rectangle."""
    inertia = 850.0 * length * width * thickness * (length**2 + width**2) / 12.0
    draft = twin.draft(thickness, 850.0)
    base = twin.spin(inertia, 0.5 * np.sqrt(length * width), scale, DRAG.water_base)
    return float(base + twin.side_spin(inertia, length, width, draft, scale, DRAG.water_side))


@pytest.mark.parametrize(
    ("length", "width", "degrees"), [(49.0, 49.0, 930.0), (60.0, 40.0, 804.0), (40.0, 60.0, 804.0)]
)
def test_a_small_berg_turns_less_than_three_times_in_a_day(length: float, width: float, degrees: float) -> None:
    """Bug: without drag of its sides it turned by 4,835 degrees and spun on at 9.5e-4 s-1."""
    model = lone(length, width)
    model.advance(days=1.0)
    k, el = braking(length, width, 40.0), model.elements
    assert np.degrees(el.rotation[0]) == pytest.approx(degrees, rel=0.005)
    assert np.degrees(el.rotation[0]) == pytest.approx(np.degrees(np.log(1.0 + k * 1e-3 * DAY) / k), rel=0.003)
    assert el.spin[0] == pytest.approx(1e-3 / (1.0 + k * 1e-3 * DAY), rel=0.01)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("length", "width", "thickness"), [(49.0, 49.0, 40.0), (1000.0, 700.0, 230.0), (3e3, 3e3, 200.0)]
)
@pytest.mark.parametrize("dt", [60.0, 3600.0])
def test_the_way_a_lone_berg_turns_hangs_on_no_step(length: float, width: float, thickness: float, dt: float) -> None:
    """In steps of an hour drag takes half of the spin in the first one: 14 % of the way were lost."""
    model = lone(length, width, thickness, dt, drag={"ocean_scale": 3.0})
    model.advance(days=0.25)
    k = braking(length, width, thickness, 3.0)
    turned = np.log(1.0 + k * 1e-3 * 0.25 * DAY) / k
    assert model.elements.rotation[0] == pytest.approx(turned, rel=0.002 if dt < 100.0 else 0.05)


def test_the_sides_bring_a_lone_berg_to_half_the_vorticity_from_both_ways() -> None:
    for vorticity in (1e-3, 4e-3):
        model = lone(60.0, 40.0)
        model.forcing.vorticity = vorticity  # type: ignore[attr-defined]
        gap = 1e-3 - 0.5 * vorticity
        model.advance(days=0.5)
        left = gap / (1.0 + braking(60.0, 40.0, 40.0) * abs(gap) * 0.5 * DAY)
        assert model.elements.spin[0] - 0.5 * vorticity == pytest.approx(left, rel=0.03, abs=1e-12)


def spin_row(model: Model) -> np.ndarray:
    """Coefficients (rad-1) of the drag of the water on the spin of the elements."""
    el, p = model.elements, model.parameters.kernel_values()
    return np.array(surroundings_of(el, p)[0]["water"].spin_quadratic)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_bonded_elements_turn_with_their_berg_whose_sides_have_their_levers_already(packing: str) -> None:
    berg = Iceberg.rectangle(4e3, 2e3, thickness=200.0, radius=500.0, packing=packing, latlon=False)
    p = Parameters(earth=FLAT, bonds={"packing": packing})
    model = Model(berg, Forcing.uniform(), p)
    el = model.elements
    radius = interaction_sizes(el, p.kernel_values()).bond_radius
    inertia = el.mass * (el.length**2 + el.width**2) / 12.0
    base = np.array([twin.spin(i, r, 1.0, DRAG.water_base) for i, r in zip(inertia, radius, strict=True)])
    np.testing.assert_allclose(spin_row(model), base, rtol=1e-12)
    draft = twin.draft(200.0, 850.0)
    sides = np.array(
        [twin.side_spin(*of, draft, 1.0, DRAG.water_side) for of in zip(inertia, el.length, el.width, strict=True)]
    )
    model.bonds.status[:], el.bond_count[:] = 1, 0
    np.testing.assert_allclose(spin_row(model), base + sides, rtol=1e-12)
    assert (sides > 5.0 * base).all()


def test_sea_ice_covers_a_part_of_the_sides_and_the_switch_takes_all_drag_on_spin() -> None:
    model = lone(60.0, 40.0)
    open_water = spin_row(model)[0]
    model.elements.ice_thickness[:], model.elements.ice_fraction[:] = 3.0, 1.0
    draft, covered = twin.draft(40.0, 850.0), spin_row(model)[0]
    base = twin.spin(850.0 * 2400.0 * 40.0 * 5200.0 / 12.0, 0.5 * np.sqrt(2400.0), 1.0, DRAG.water_base)
    assert (covered - base) / (open_water - base) == pytest.approx((draft - 3.0) / draft, rel=1e-12)
    assert spin_row(lone(60.0, 40.0, drag={"rotational": False}))[0] == 0.0


@pytest.mark.parametrize("scheme", ["mts", "verlet"])
def test_explicit_schemes_keep_the_drag_and_the_inertia_of_the_reference(scheme: str) -> None:
    bonds = {} if scheme == "mts" else {"law": "none"}
    model = lone(60.0, 40.0, stepping={"scheme": scheme}, bonds=bonds)
    radius = 0.5 * np.sqrt(2400.0)
    assert spin_row(model)[0] == pytest.approx(
        twin.spin(0.5 * model.elements.mass[0] * radius**2, radius, 1.0, DRAG.water_base), rel=1e-12
    )


def test_the_ledger_knows_the_inertia_of_a_rectangle() -> None:
    el = (model := lone(60.0, 40.0)).elements
    ledger = model.motion.balance(model, model.remembered)
    assert ledger.kinetic_now == pytest.approx(0.5 * el.mass[0] * 5200.0 / 12.0 * 1e-6, rel=1e-12)


def test_a_bar_of_two_squares_turns_as_the_rectangle_that_they_make() -> None:
    """A couple of 1 N m kg-1 on each: M (L^2 + W^2) / 12 with twice the length, by parallel axes."""
    berg = Iceberg.rectangle(2e3, 1e3, thickness=200.0, radius=500.0, latlon=False)
    p = Parameters(earth=FLAT, stepping={"time_step": 60.0, "only_interactions": True}, fracture={"enabled": False})
    model = Model(berg, Forcing.uniform(), p)
    el = model.elements
    el.load_y[:] = np.sign(el.lon) * 1e6
    model.advance(steps=1)
    torque, inertia = 1e6 * 1e3, el.mass.sum() * (2e3**2 + 1e3**2) / 12.0
    assert el.spin == pytest.approx(60.0 * torque / inertia, rel=1e-6)
