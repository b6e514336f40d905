"""Bergs of one element that meet, in sub-steps of their own, against the general sub-steps and against physics."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, Steady
from riftberg.state import ELEMENT_VARIABLES, new_elements
from riftberg.stepping.explicit import mts
from riftberg.stepping.explicit.lone_bergs import find_lone_islands
from riftberg.stepping.forces.media import FORCES

SPRING = (0.4 * 31.9 / 600.0) ** 2
"""Stiffness (s-2) for which both ways take 32 sub-steps in 600 s."""


def pair(
    gap: float = 40.0, speed: float = 0.3, push: float = 0.0, others: bool = False, law: str = "dem", **groups: Any
) -> Model:
    """Return a model of two bergs of one element that meet, in a current.

    ``push`` (m s-2) on the first, too small to move it, keeps both from going free.
    """
    rows = [(0.0, 0.0, speed), (400.0 + gap, 60.0, 0.0)]
    rows += [(9000.0, 0.0, 0.1), (9000.0, 7000.0, 0.0)] if others else []
    bergs = [
        Iceberg.rectangle(
            400.0, 400.0, thickness=100.0 + 10.0 * k, placement=(x, y), radius=200.0, velocity=(u, 0.0), latlon=False
        )
        for k, (x, y, u) in enumerate(rows)
    ]
    plane = {"earth": {"latlon": False, "period": 0.0}, "bonds": {"law": law}, "stepping": {"time_step": 600.0}}
    ocean = Steady(current=(0.1, 0.05), depth=90.0 if "grounding" in groups else 1000.0)
    model = Model(Iceberg.join(bergs), ocean, Parameters(**{**plane, **groups}))
    model.elements.kicks.bx_fast[0] = push
    return model


def test_islands_are_the_bergs_that_may_meet_directly_or_by_way_of_others() -> None:
    """Against a plain search, on random pairs; bergs of several elements and those near the pole are left to the general way."""
    r = np.random.default_rng(3)
    for _ in range(60):
        el = new_elements(int(r.integers(4, 30)))
        el.body.berg[:] = r.integers(5, 60, el.size)
        el.place.lat[:] = r.choice([-60.0, 89.5], el.size, p=[0.95, 0.05])
        drawn = {tuple(sorted(pair)) for pair in r.integers(0, el.size, (int(r.integers(1, 20)), 2)).tolist()}
        pairs = sorted(pair for pair in drawn if el.berg[pair[0]] != el.berg[pair[1]])
        run: Any = SimpleNamespace(elements=el, parameters=Parameters(), constants=Parameters().kernel_values())
        sizes: Any = SimpleNamespace(radius=r.uniform(100.0, 2e3, el.size))
        first, second = np.array(pairs, np.int64).reshape(-1, 2).T
        islands, others = find_lone_islands(run, sizes, first, second)
        wanted = plain_islands(el, pairs)
        assert others.tolist() == [not any(pair[0] in rows for rows in wanted) for pair in pairs]
        if islands is None:
            assert not wanted
            continue
        starts, pair_starts = islands.start.tolist(), islands.pair_start.tolist()
        assert [islands.rows[a:b].tolist() for a, b in pairwise(starts)] == wanted
        for k, (a, b) in enumerate(pairwise(pair_starts)):
            mine = islands.rows[starts[k] : starts[k + 1]]
            ends = zip(mine[islands.first[a:b]].tolist(), mine[islands.second[a:b]].tolist(), strict=True)
            assert list(ends) == [pair for pair in pairs if pair[0] in wanted[k]]


def plain_islands(el: Any, pairs: list[tuple[int, int]]) -> list[list[int]]:
    """Rows of each island, in the order of the smallest number of its bergs."""
    bergs = el.berg.tolist()
    parts = [{berg} for berg in sorted(set(bergs))]
    for i, j in pairs:
        one = next(part for part in parts if bergs[i] in part)
        other = next(part for part in parts if bergs[j] in part)
        if one is not other:
            parts.remove(other)
            one |= other
    general = {berg for berg, lat in zip(bergs, el.lat, strict=True) if bergs.count(berg) > 1 or lat > 89.0}
    met = {row for pair in pairs for row in pair}
    rows = [sorted(row for row in met if bergs[row] in part) for part in sorted(parts, key=min) if not part & general]
    return [some for some in rows if some]


def state_of(model: Model) -> dict[str, np.ndarray]:
    return {v.name: getattr(model.elements, v.name).copy() for v in ELEMENT_VARIABLES}


@pytest.mark.parametrize("law", ["dem", "spring", "none"])
@pytest.mark.parametrize(
    "options",
    [{}, {"grounding": {"coefficient": 1e3, "torque": True}}, {"grounding": {"law": "quadratic", "quadratic_coefficient": 200.0}},
     {"grounding": {"coefficient": 1e3, "implicit": False}}, {"compatibility": {"explicit_contact_damping": True}}],
    ids=["afloat", "aground", "ploughing", "explicit-floor", "explicit-damping"],
)  # fmt: skip
def test_sub_steps_of_an_island_are_the_general_ones(
    law: str, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where they go one by one (a force keeps bergs from going free), bit for bit; meetings and forces too."""
    case = {"push": 1e-300, "law": law, "contact": {"spring": SPRING}, **options}

    def run() -> tuple[dict[str, np.ndarray], np.ndarray, Any]:
        model = pair(**case)
        model.elements.spin[:] = 1e-5, -2e-5
        model.advance(steps=4)
        return state_of(model), model.applied_forces(), model.contacts.rows

    own, forces, met = run()
    monkeypatch.setattr(mts, "find_lone_islands", lambda run, sizes, first, *more: (None, np.ones(first.size, bool)))
    general, forces_then, met_then = run()
    for name, values in general.items():
        np.testing.assert_array_equal(own[name], values, err_msg=name)
    np.testing.assert_array_equal(forces, forces_then)
    assert met == met_then
    assert "grounding" in options or len(met) == 1


@pytest.mark.parametrize("push", [0.0, 1e-300])
def test_going_free_costs_no_accuracy(push: float) -> None:
    """Many sub-steps at once until bergs touch: the same path to a thousandth of a metre as one by one."""
    one, other = pair(push=push), pair(push=1e-300)
    for model in (one, other):
        model.advance(steps=6)
        assert len(model.contacts.rows) == 1
    np.testing.assert_allclose(one.elements.lon, other.elements.lon, rtol=0, atol=1e-3)
    np.testing.assert_allclose(one.elements.u, other.elements.u, rtol=0, atol=1e-6)


def test_sub_steps_of_a_meeting_are_those_of_its_island_alone() -> None:
    """Others far away, and others that meet elsewhere, change nothing; a berg alone goes as it always did."""
    together, alone = pair(others=True), pair()
    for model in (together, alone):
        model.advance(steps=6)
    for name in ("lon", "lat", "u", "v"):
        np.testing.assert_array_equal(getattr(together.elements, name)[:2], getattr(alone.elements, name))
    assert (together.elements.body.substeps == 1).all()


def test_a_meeting_keeps_the_momentum_and_stops_the_approach() -> None:
    """Without drag: momentum to round-off, and two bergs that touch neither pass through each other nor speed up."""
    model = pair(gap=10.0, speed=0.5, drag={"ocean_scale": 0.0})
    el = model.elements
    mass, before = el.mass.copy(), float(el.mass @ el.u)
    energy = float(mass @ (el.u**2 + el.v**2))
    model.advance(steps=6)
    assert float(mass @ el.u) == pytest.approx(before, rel=1e-2)
    assert float(mass @ (el.u**2 + el.v**2)) < energy
    assert float(np.hypot(*(np.diff(el.lon), np.diff(el.lat)))[0]) > 0.9 * 400.0


@pytest.mark.parametrize("implicit", [True, False])
def test_a_berg_that_is_held_on_the_floor_takes_no_force_of_it(implicit: bool) -> None:
    """Two bergs meet, the second is aground: held, it stays where it is and the floor does nothing; free, the floor brakes it."""
    floor = {}
    for held in (0.0, 1.0):
        model = pair(contact={"spring": SPRING}, grounding={"coefficient": 1e3, "implicit": implicit})
        model.elements.static[1], model.elements.v[1] = held, 0.01
        place = model.elements.lon[1], model.elements.lat[1]
        model.advance(steps=1)  # the first step has a half kick of its own
        assert ((model.elements.lon[1], model.elements.lat[1]) == place) == bool(held)
        forces = model.applied_forces()
        assert np.isfinite(forces).all()
        floor[held] = forces[1, FORCES.index("sea_floor")]
    assert floor[0.0].any()
    assert not floor[1.0].any()


def test_a_meeting_goes_on_from_a_restart(tmp_path: Any) -> None:
    whole, part = pair(), pair()
    whole.advance(steps=5)
    part.advance(steps=2)
    part.save(tmp_path / "half.restart.nc")
    rest = Model.resume(tmp_path / "half.restart.nc", part.forcing)
    rest.advance(steps=3)
    for name, values in state_of(whole).items():
        np.testing.assert_array_equal(getattr(rest.elements, name), values, err_msg=name)
    assert rest.contacts.rows == whole.contacts.rows


def test_a_meeting_on_the_sphere_is_the_same_across_the_seam() -> None:
    """Bergs that meet at the date line go as those that meet elsewhere."""

    def apart(east: float) -> tuple[float, float]:
        bergs = [
            Iceberg.rectangle(
                400.0, 400.0, thickness=100.0, radius=200.0, placement=(east + d, -60.0), velocity=(u, 0.0)
            )
            for d, u in ((-0.004, 0.3), (0.004, 0.0))
        ]
        model = Model(Iceberg.join(bergs), Forcing.uniform())
        model.advance(steps=4)
        assert len(model.contacts.rows) == 1
        el = model.elements
        return float((el.lon[1] - el.lon[0] + 180.0) % 360.0 - 180.0), float(el.u[1])

    np.testing.assert_allclose(apart(180.0), apart(20.0), rtol=1e-7)
