"""Bergs on the sea floor as events: which, when, where, what the floor carries and what it can hold.

What is aground is decided in `riftberg.engines.common.forces.media.touches_floor` and nowhere else: what a bed of
sediment carries, or where the drag of an explicit scheme acts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY
from riftberg.engines.common.forces.media import SEA_FLOOR, touches_floor
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.parameters import KernelParameters
from riftberg.physics.floating import draft_of
from riftberg.physics.geometry import metres_per_unit, nearest_image
from riftberg.state import Elements, Floats, Ints
from riftberg.state.variables import Body, Keel, Motion, Place

AFLOAT_TIME: Final = 6.0 * 3600.0
"""Time (s) afloat after which the next touch is an event of its own; a tide that lifts a berg for less belongs to the event."""

LEAST_SHARE: Final = 0.05
"""Part of the area of its berg from which on a fragment has events of its own."""

MIDDLE: Final = 0.1
"""Distance from the centre of a berg, in parts of the root of its area, within which it touches with its middle, and no side."""

STANDSTILL: Final = 1e-3
"""Speed (m s-1) below which a berg aground has come to rest."""


@dataclass(frozen=True)
class GroundingEvent:
    """One stay of a berg or fragment on the sea floor."""

    number: int  # Of the berg or fragment
    time: float  # Start of the long step in which it touched first, s since the start of the run
    end: float  # End of the last long step at whose end the floor carried it, s since the start of the run
    lon: float  # Where the floor carried it first, degrees (m on a Cartesian grid)
    lat: float
    # Direction of that from its centre, degrees clockwise from north; -1 where it touched with its middle, or is one element
    towards: float
    elements: int  # Elements that touched first
    times: int  # How often it touched; a tide lifts it off for a while
    seconds: float  # Time on the floor, s
    carried: int  # Elements that the floor carried last
    load: float  # Weight that the floor carried last, N
    capacity: float  # Friction that could hold it last, N; 0 for the laws of drag, which hold nothing
    pressing: float  # Force of all else on it in the last of these steps, N
    lift: float  # Largest rise of its keel so far, m
    stress: float  # Largest bending stress of the ice that the floor lifts so far, Pa
    gouge: float  # How deep it has pressed a bed that yields at most, m
    way: float  # Way of its centre on the floor, with that before the touch in the first step, m
    stopped: float  # The same when it first came to rest; -1 where it never did
    # End of the step since which it has stood still, s since the start of the run; -1 while it slides
    held: float = -1.0
    level: float = 0.0  # Of the sea above the zero of the depth, where and when it touched first, m


class GroundingLog:
    """All stays on the sea floor of bergs, and of fragments that are not small."""

    def __init__(self, rows: list[GroundingEvent] | None = None, clearance: float = math.inf) -> None:
        self.rows: list[GroundingEvent] = list(rows or [])
        self.clearance = clearance  # Least water under a keel, m; negative where it stands deeper than the floor
        self._latest = {row.number: k for k, row in enumerate(self.rows)}

    def saved(self) -> GroundingLog:
        """Return a checkpoint."""
        return GroundingLog(self.rows, self.clearance)

    def update(
        self, previous: Elements, el: Elements, step: tuple[float, float], tree: FragmentTree, p: KernelParameters,
        forces: Callable[[], Floats], clearance: float, sea_level: Callable[[Floats, Floats, float], Floats],
    ) -> None:  # fmt: skip
        """Record the load on the floor after a long ``step`` from one time to another, s.

        ``previous``, ``el``: the elements at its start and at its end; ``forces``: gives the mean forces (N) of the step, shape
        (elements, forces, 2); ``clearance``: least water under a keel as the bed has it (m), NaN where the depth under the middle
        of elements counts; ``sea_level``: gives the level (m) above the zero of the depth, at points and a time.
        """
        at_middle, touches = _survey_floor(el.body.thickness, el.environment.depth, el.keel.floor_load, p)
        self.clearance = min(self.clearance, at_middle if math.isnan(clearance) else clearance)
        if not touches:  # nearly always, and quick
            return
        fragment = _reunite_small_pieces(previous.body.berg, el, tree)
        measures = _measure(fragment, previous, el, p, forces())
        for n, number in enumerate(measures.number):
            if measures.area[n] >= _least_area(number, tree):
                self._add(measures, n, *step, sea_level)

    def _add(
        self, m: _Measures, n: int, began: float, ended: float, sea_level: Callable[[Floats, Floats, float], Floats]
    ) -> None:  # fmt: skip
        """Extend the last event of a fragment by a step, or begin a new one."""
        number, way, carried = m.number[n], m.way[n], int(m.carried[n])
        k, stands = self._latest.get(number, -1), m.speed[n] < STANDSTILL
        event = self.rows[k] if k >= 0 else None
        if event is None or began - event.end >= AFLOAT_TIME:
            self._latest[number] = len(self.rows)
            level = sea_level(np.array([m.lon[n]]), np.array([m.lat[n]]), began)
            self.rows.append(
                GroundingEvent(
                    number, began, ended, m.lon[n], m.lat[n], m.towards[n], carried, 1, ended - began, carried, m.load[n],
                    m.capacity[n], m.pressing[n], m.lift[n], m.stress[n], m.gouge[n], way,
                    *((way, ended) if stands else (-1.0, -1.0)), float(level[0]),
                )
            )  # fmt: skip
            return
        way += event.way
        stopped = event.stopped if event.stopped >= 0.0 or not stands else way
        held = -1.0 if not stands else ended if event.held < 0.0 else event.held
        # Field by field: a copy that names what changes takes most of the time of a field of bergs aground.
        self.rows[k] = GroundingEvent(
            number, event.time, ended, event.lon, event.lat, event.towards, event.elements, event.times + (event.end < began),
            event.seconds + (ended - began), carried, m.load[n], m.capacity[n], m.pressing[n], max(event.lift, m.lift[n]),
            max(event.stress, m.stress[n]), max(event.gouge, m.gouge[n]), way, stopped, held, event.level,
        )  # fmt: skip


def _least_area(number: int, tree: FragmentTree) -> float:
    """Area (m2) from which on a fragment has events of its own."""
    berg = tree.origin(number)
    return LEAST_SHARE * tree.rows[berg - 1].area if 0 < berg <= len(tree.rows) else 0.0


def _reunite_small_pieces(previous: Ints, el: Elements, tree: FragmentTree) -> Ints:
    """Return the fragments to which elements count: those of one that has gone to pieces too small for events still to it."""
    number = el.body.berg
    if np.array_equal(number, previous):
        return number
    pieces, piece = np.unique(number, return_inverse=True)
    least = np.array([_least_area(n, tree) for n in pieces.tolist()])
    small = np.bincount(piece, el.body.length * el.body.width) < least
    # The heaviest piece keeps the number.
    return np.where(small[piece] & np.isin(previous, pieces[small]), previous, number)


def mass_on_floor(el: Elements, p: KernelParameters) -> Floats:
    """Return the mass of each element that the sea floor carries, kg.

    On a bed of sediment its load. The drag of the explicit schemes carries nothing: there it is what lies above the water that
    is as deep as the keel, where the element is aground.
    """
    carried = np.empty(el.size)
    _fill_mass_on_floor(el.body, el.environment.depth, el.keel.floor_load, p, carried)
    return carried


@kernel
def _fill_mass_on_floor(body: Body, depth: Floats, floor_load: Floats, p: KernelParameters, carried: Floats) -> None:
    """Find the mass (kg) of each element that the sea floor carries."""
    for e in range(carried.size):
        carried[e] = floor_load[e] / GRAVITY
        if floor_load[e] == 0.0 and touches_floor(body.thickness[e], depth[e], 0.0, p):
            in_water = min(max(depth[e] / draft_of(body.thickness[e], p.rho_ice), 0.0), 1.0)
            carried[e] = body.mass[e] * (1.0 - in_water)


class _Measures(NamedTuple):
    """Fragments on the floor, as one step has them; the fields of `GroundingEvent` by fragment."""

    number: list[int]
    area: list[float]  # m2
    lon: list[float]
    lat: list[float]
    towards: list[float]
    carried: list[float]
    load: list[float]
    capacity: list[float]
    pressing: list[float]
    lift: list[float]
    stress: list[float]
    gouge: list[float]
    way: list[float]  # In this step, m
    speed: list[float]  # At its end, m s-1


def _measure(number: Ints, previous: Elements, el: Elements, p: KernelParameters, forces: Floats) -> _Measures:
    """Return the measures of one step for each fragment on the floor; ``number``: of the fragment of each element."""
    load = GRAVITY * mass_on_floor(el, p)
    fragments, first, total, largest = _sum_up(
        number, load, previous.place, el.place, el.body, el.motion, el.keel, el.environment.depth, forces, p
    )
    mass, weight, touch_x, touch_y, centre_x, centre_y, gone_x, gone_y, u, v, push_x, push_y, *borne, area, mx, my = (
        total
    )
    touch_x, touch_y = touch_x / weight, touch_y / weight
    off_x, off_y = (touch_x - centre_x / mass) * mx, (touch_y - centre_y / mass) * my
    towards = np.where(
        np.hypot(off_x, off_y) > MIDDLE * np.sqrt(area), np.degrees(np.arctan2(off_x, off_y)) % 360.0, -1.0
    )
    columns = (
        fragments, area, el.place.lon[first] + touch_x, el.place.lat[first] + touch_y, towards, *borne,
        np.hypot(push_x, push_y), *largest, np.hypot(gone_x, gone_y) / mass, np.hypot(u, v) / mass,
    )  # fmt: skip
    return _Measures(*(column.tolist() for column in columns))


# Many arguments: the state at both ends of the step.
@kernel
def _sum_up(
    number: Ints, load: Floats, previous: Place, place: Place, body: Body, motion: Motion, keel: Keel, depth: Floats,
    forces: Floats, p: KernelParameters,
) -> tuple[Ints, Ints, Floats, Floats]:  # fmt: skip
    """Find the fragments on the floor in rising order, the first element of each, sums over its elements, and largest values.

    Behind the sums stand the metres per unit of longitude and latitude at the first element.
    """
    touching = np.empty(number.size, np.bool_)
    for e in range(number.size):
        touching[e] = touches_floor(body.thickness[e], depth[e], keel.floor_load[e], p)
    fragments = np.unique(number[touching])
    first, total, largest = np.full(fragments.size, -1), np.zeros((18, fragments.size)), np.zeros((3, fragments.size))
    for e in range(number.size):
        n = np.searchsorted(fragments, number[e])
        if n == fragments.size or fragments[n] != number[e]:
            continue
        mx, my = metres_per_unit(place.lat[e], p.latlon, p.earth_radius)
        if first[n] < 0:
            first[n], total[16, n], total[17, n] = e, mx, my
        # From the first element of each fragment: across the seam too.
        x, y = nearest_image(place.lon[e] - place.lon[first[n]], p.period), place.lat[e] - place.lat[first[n]]
        gone_x, gone_y = nearest_image(place.lon[e] - previous.lon[e], p.period), place.lat[e] - previous.lat[e]
        push_x = push_y = 0.0
        for k in range(forces.shape[1]):
            if k != SEA_FLOOR:
                push_x += forces[e, k, 0]
                push_y += forces[e, k, 1]
        # Drag may act on a keel that has not come to the floor yet: where nothing is carried, all elements aground count alike.
        mass, weight = body.mass[e], max(load[e], 1.0) if touching[e] else 0.0
        values = (
            mass, weight, weight * x, weight * y, mass * x, mass * y, mass * gone_x * mx, mass * gone_y * my,
            mass * motion.u_sync[e], mass * motion.v_sync[e], push_x, push_y, 1.0 if touching[e] else 0.0,
            load[e], keel.floor_hold[e], body.length[e] * body.width[e],
        )  # fmt: skip
        for k in range(len(values)):
            total[k, n] += values[k]
        highest = keel.floor_lift[e], keel.floor_stress[e], keel.floor_yield[e]
        for k in range(len(highest)):
            largest[k, n] = max(largest[k, n], highest[k])
    return fragments, first, total, largest


@kernel
def _survey_floor(thickness: Floats, depth: Floats, floor_load: Floats, p: KernelParameters) -> tuple[float, bool]:
    """Least water (m) under the keel in the middle of an element, and whether the sea floor acts on any."""
    least, touches = math.inf, False
    for e in range(thickness.size):
        water = depth[e] - draft_of(thickness[e], p.rho_ice)
        if water < least:  # where the depth is unknown it is no number
            least = water
        touches = touches or touches_floor(thickness[e], depth[e], floor_load[e], p)
    return least, touches
