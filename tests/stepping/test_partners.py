"""Who is near whom, remembered from step to step: the same pairs as a search in each step finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.ocean.ready_made import Forcing
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from riftberg.state import new_elements
from riftberg.state.neighbours import near_pairs
from riftberg.stepping import partners
from riftberg.stepping.partners import KnownPairs

PLACES = {
    "plane": (False, 0.0, 0.0),
    "ring": (False, 90e3, 0.0),
    "sphere": (True, 360.0, -77.0),
    "pole": (True, 360.0, 89.0),
}


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of pairs of each search."""
    counted: list[int] = []

    def counting(*arguments: Any) -> Any:
        found = near_pairs(*arguments)
        counted.append(found[0].size)
        return found

    monkeypatch.setattr(partners, "near_pairs", counting)
    return counted


def crowd(place: str, count: int = 80) -> tuple[Any, Any, Any]:
    """Elements, the constants of their coordinates, and metres in a unit of x and of y."""
    latlon, period, lat = PLACES[place]
    earth = {"latlon": latlon, "period": period}
    c = Parameters(earth=earth if latlon else {**earth, "f_plane": True}).kernel_values()
    metres = np.array([np.cos(np.radians(lat)), 1.0]) * c.earth_radius * np.pi / 180.0 if latlon else np.ones(2)
    r, el = np.random.default_rng(5), new_elements(count)
    x, y = r.uniform(0.0, 60e3, (2, count))
    el.shown.lon_pair[:], el.shown.lat_pair[:] = (x + (90e3 - 20e3)) / metres[0], lat + y / metres[1] * (lat < 80.0)
    el.body.berg[:] = np.arange(count) // 2
    return el, c, metres


def searched(el: Any, reach: Any, c: Any) -> tuple[Any, Any]:
    """What a search in this step finds."""
    shown = el.shown
    return near_pairs(shown.lon_pair, shown.lat_pair, el.body.berg, reach, c.latlon, c.earth_radius, c.period)


@pytest.mark.parametrize("place", PLACES)
def test_pairs_that_are_remembered_are_those_that_a_search_finds(place: str, searches: list[int]) -> None:
    """On their way with the current and against each other, with changing reach, a jump, and new numbers of bergs."""
    el, c, metres = crowd(place)
    r, known, steps = np.random.default_rng(1), KnownPairs(), 40
    u, v = 0.4 + r.normal(0.0, 0.15, el.size), -0.2 + r.normal(0.0, 0.15, el.size)
    for n in range(steps):
        el.shown.lon_pair[:] += 1800.0 * u / metres[0]
        el.shown.lat_pair[:] += 1800.0 * v / metres[1] * (place != "pole")
        u += r.normal(0.0, 0.02, el.size)
        if n == 15:
            el.shown.lon_pair[3] = el.shown.lon_pair[40]
            el.shown.lat_pair[3] = el.shown.lat_pair[40]
        if n == 20:
            el.body.berg[:] = r.permutation(el.body.berg)
        step = 1800.0 * np.hypot(u - u.mean(), v - v.mean())
        reach = 1500.0 + 1.3 * step
        first, second = known.near(el, el.body.berg, reach, step, c)
        wanted = searched(el, reach, c)
        assert wanted[0].size > 20
        np.testing.assert_array_equal(first, wanted[0])
        np.testing.assert_array_equal(second, wanted[1])
    assert len(searches) == steps if place == "pole" else 5 < len(searches) < steps // 2


def test_who_leaves_or_joins_is_seen_and_who_reaches_far_is_searched_for_anew(searches: list[int]) -> None:
    el, c, _ = crowd("plane")
    known, reach, step = KnownPairs(), np.full(el.size, 2e3), np.full(el.size, 200.0)
    for some in (slice(None), slice(1, None), slice(None)):
        part = el.taken(some)
        first, second = known.near(part, part.body.berg, reach[some], step[some], c)
        wanted = searched(part, reach[some], c)
        np.testing.assert_array_equal((first, second), wanted)
    assert len(searches) == 3
    reach[7] = 2e5
    np.testing.assert_array_equal(known.near(el, el.body.berg, reach, step, c), searched(el, reach, c))


@pytest.mark.parametrize("scheme", ["mts", "quasi_static"])
def test_a_field_of_bergs_goes_the_same_way_whether_pairs_are_remembered_or_not(
    scheme: str, monkeypatch: pytest.MonkeyPatch, searches: list[int]
) -> None:
    """Bit for bit, with meetings."""
    bergs = Iceberg.field(40, (-40.0, -39.7, -58.0, -57.9), seed=1)
    sea = Forcing.uniform(current=(0.1, 0.0), wind=(5.0, 0.0)) + Forcing.eddy((-39.85, -57.95), radius=6e3, speed=0.4)
    runs, counts = [], []
    for ahead in (partners.STEPS_AHEAD, 0.0):
        monkeypatch.setattr(partners, "STEPS_AHEAD", ahead)
        model = Model(bergs, sea, Parameters(stepping={"scheme": scheme}))
        model.advance(steps=12)
        runs.append(model)
        counts.append(len(searches))
        searches.clear()
    assert counts[0] < counts[1] / 2
    assert runs[0].contacts.rows == runs[1].contacts.rows != []
    for name, values in runs[0].elements.arrays().items():
        np.testing.assert_array_equal(values, runs[1].elements.arrays()[name], err_msg=name)
