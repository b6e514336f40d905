"""Meetings of bergs: one for each pair, as long as they touch again within hours; none for what has just broken off."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg import Parameters
from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.tree import Fragment, FragmentTree
from riftberg.state import Elements, new_elements

SEPARATION_TIME = 6.0 * 3600.0

P = Parameters().kernel_values()
HOUR = 3600.0


def fragment(number: int, parent: int = 0, birth: float = 0.0) -> Fragment:
    """Return a row of the family tree."""
    return Fragment(number, parent, birth, 0.0, 0.0, 1, 1e6, 1e9, 0, False)


def elements(bergs: tuple[int, ...] = (1, 2, 3)) -> Elements:
    """Return elements near the date line, one of each berg."""
    el = new_elements(len(bergs))
    el.berg[:] = bergs
    el.lon[:], el.lat[:] = np.array([179.99, -179.99, 0.0])[: len(bergs)], -60.0
    el.u[:] = np.array([0.3, 0.0, 0.0])[: len(bergs)]
    el.v[:] = np.array([0.0, 0.4, 0.0])[: len(bergs)]
    return el


def pair(i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([i]), np.array([j])


def test_a_meeting_is_one_until_the_bergs_have_been_apart() -> None:
    log, tree, el = ContactLog(), FragmentTree([fragment(1), fragment(2), fragment(3)]), elements()
    for hour in (10.0, 11.0, 15.0):  # they bounce
        log.update(el, pair(1, 0), hour * HOUR, (hour + 0.5) * HOUR, tree, P)
    (met,) = log.rows
    assert (met.first, met.second, met.time, met.end) == (1, 2, 10.0 * HOUR, 15.5 * HOUR)
    assert met.speed == 0.5
    assert abs(abs(met.lon) - 180.0) < 1e-9  # half way across the seam
    log.update(el, pair(0, 1), 15.5 * HOUR + SEPARATION_TIME, 16.0 * HOUR + SEPARATION_TIME, tree, P)
    assert len(log.rows) == 2
    log.update(el, (np.array([0, 0]), np.array([1, 2])), 24.0 * HOUR, 24.5 * HOUR, tree, P)
    assert [(row.first, row.second) for row in log.rows] == [(1, 2), (1, 2), (1, 3)]


def test_a_piece_has_not_met_what_it_broke_off() -> None:
    tree, el = FragmentTree([fragment(1), fragment(2, parent=1, birth=5.0 * HOUR)]), elements((1, 2))
    log = ContactLog()
    for hour in np.arange(5.0, 20.0, 4.0):  # never apart for long
        log.update(el, pair(0, 1), hour * HOUR, (hour + 0.5) * HOUR, tree, P)
    assert log.rows == []
    log.update(el, pair(0, 1), 40.0 * HOUR, 40.5 * HOUR, tree, P)  # it has been away and comes back
    assert len(log.rows) == 1


def test_the_pieces_of_a_berg_go_on_with_the_meeting_of_the_whole() -> None:
    tree, el = FragmentTree([fragment(1), fragment(2)]), elements((1, 2, 3))
    log = ContactLog()
    log.update(el, pair(0, 1), 10.0 * HOUR, 10.5 * HOUR, tree, P)
    tree.rows.append(fragment(3, parent=1, birth=10.5 * HOUR))
    log.update(el, pair(1, 2), 10.5 * HOUR, 11.0 * HOUR, tree, P)
    assert [(row.first, row.second) for row in log.rows] == [(1, 2)]
    copied = log.saved()
    copied.update(el, pair(1, 2), 90.0 * HOUR, 90.5 * HOUR, tree, P)
    assert (len(copied.rows), len(log.rows)) == (2, 1)


def test_elements_of_one_berg_do_not_meet() -> None:
    log = ContactLog()
    log.update(elements((1, 1)), pair(0, 1), 0.0, 1.0, FragmentTree([fragment(1)]), P)
    assert log.rows == []


def test_a_contact_that_goes_on_has_a_new_end_when_somebody_asks() -> None:
    """Hundreds of pieces of a shattered berg touch in each step: one object each took longer than their motion."""
    log, tree = ContactLog(), FragmentTree([fragment(1), fragment(2)])
    log.update(elements(), pair(0, 1), 0.0, 1800.0, tree, P)
    saved = log.saved()
    log.update(elements(), pair(0, 1), 1800.0, 3600.0, tree, P)
    assert [row.end for row in log.rows] == [3600.0]
    assert [row.end for row in saved.rows] == [1800.0]


class PlainLog:
    """The log one pair after the other: when each pair last met, and last touched without meeting."""

    def __init__(self) -> None:
        self.met: list[list[float]] = []
        self.latest: dict[tuple[int, int], int] = {}
        self.suppressed: dict[tuple[int, int], float] = {}

    def update(self, pairs: set[tuple[int, int]], began: float, ended: float, tree: FragmentTree) -> None:
        for pair in sorted(pairs):
            if pair in self.latest and began - self.met[self.latest[pair]][3] < SEPARATION_TIME:
                self.met[self.latest[pair]][3] = ended
            elif began - self.suppressed.get(pair, -np.inf) < SEPARATION_TIME or self.born(pair, began, tree):
                self.suppressed[pair] = ended
            else:
                self.latest[pair] = len(self.met)
                self.met.append([*pair, began, ended])

    def born(self, pair: tuple[int, int], began: float, tree: FragmentTree) -> bool:
        for own, other in (pair, pair[::-1]):
            row, sibling = tree.rows[own - 1], tree.rows[other - 1].parent
            family = (min(row.parent, other), max(row.parent, other))
            late = self.suppressed.get(family, -np.inf)
            if family in self.latest:
                late = max(late, self.met[self.latest[family]][3])
            near = row.parent in (other, sibling) or began - late < SEPARATION_TIME
            if row.parent > 0 and began - row.birth_time < SEPARATION_TIME and near:
                return True
        return False


@pytest.mark.parametrize("seed", range(4))
def test_the_log_is_that_of_one_pair_after_the_other(seed: int) -> None:
    """Pairs that touched a step before are extended all at once; restarts and copies in between change nothing."""
    random = np.random.default_rng(seed)
    tree, log, plain = FragmentTree([fragment(n) for n in range(1, 6)]), ContactLog(), PlainLog()
    el = new_elements(40)
    for step in range(120):
        began = 1800.0 * step + (SEPARATION_TIME if step > 60 else 0.0)
        if step % 8 == 7:
            parent = int(random.integers(1, len(tree.rows) + 1))
            tree.rows.append(fragment(len(tree.rows) + 1, parent, began))
        el.berg[:] = random.integers(1, len(tree.rows) + 1, 40)
        first, second = random.integers(0, 40, (2, int(random.integers(0, 12))))
        bergs = zip(el.berg[first].tolist(), el.berg[second].tolist(), strict=True)
        plain.update({(min(b), max(b)) for b in bergs if b[0] != b[1]}, began, began + 1800.0, tree)
        log.update(el, (first, second), began, began + 1800.0, tree, P)
        if step % 13 == 5:
            log = log.saved() if step % 2 else ContactLog(log.rows, log.suppressed)
    assert len(plain.met) > 20
    assert len(plain.suppressed) > 5
    assert [[row.first, row.second, row.time, row.end] for row in log.rows] == plain.met
    assert log.suppressed == plain.suppressed


def test_bergs_meet_at_the_speed_of_one_against_the_other() -> None:
    el, log = elements((1, 2)), ContactLog()
    el.u[:], el.v[:] = (0.3, -0.1), (0.5, 0.2)
    log.update(el, pair(0, 1), 0.0, 1800.0, FragmentTree([fragment(1), fragment(2)]), P)
    assert log.rows[0].speed == pytest.approx(0.5)
