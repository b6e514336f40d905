"""Fragments that go together through a step: the survey of the floor around them, and the pads of the fragments near it."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.bodies.pose import Bodies, tangent_coordinates
from riftberg.engines.quasi_static.ground.landing import AFLOAT, Landing, allocate_landing, list_corners
from riftberg.engines.quasi_static.ground.pads import CLEAR, Pads, place_points
from riftberg.engines.quasi_static.ground.plate import unmade_plates
from riftberg.engines.quasi_static.ground.soundings import DepthSampler, Floor, Soundings
from riftberg.parameters import KernelParameters
from riftberg.physics.floating import draft_of
from riftberg.state import Floats, Ints
from riftberg.state.variables import Body, Environment

STEEPEST: Final = 0.5
"""Slope by which a floor that is not surveyed may rise towards the keel of a lone berg."""

RING: Final = 10_000.0
"""Distance (m) beyond the way of a step for which the floor is surveyed."""

NEAR_RING: Final = 4000.0
"""The same where a part of it is shallow; where that is farther away, nobody needs to look until the fragment comes to it."""

RESERVE: Final = 10.0
"""Clearance (m) beyond the surveyed one that levels may take."""

ASIDE: Final = 20.0
"""How far forces may take a fragment from its way in a step, m, before it is looked at again."""


STILL: Final = 1.0
"""Way (m) on which the floor under the middle of a square counts as it was found: nobody looks again under a held berg."""


class Survey(NamedTuple):
    """Survey of the floor around fragments; one row for each fragment."""

    lone: NDArray[np.bool_]
    box: Floats  # Least x and y, and largest, of the footprint, m; shape (fragments, 4)
    radius: Floats  # Of the farthest corner of that box, m
    pose: Floats  # At the survey; shape (fragments, 3, 3)
    distance: Floats  # For which the survey holds, m; negative before the first
    shallow: NDArray[np.bool_]  # Whether the keel may touch the floor on that way
    draft: Floats  # Of the deepest keel then, m
    times: Ints  # How often it was surveyed


def _begin_survey(bodies: Bodies, body: Body, latlon: bool, earth: float) -> Survey:
    """Return a survey in which nothing is surveyed yet."""
    count, xy = len(bodies.pose), tangent_coordinates(bodies.reference, latlon, earth)
    # Ice of an element at the rim may reach farther than its own half.
    margin = np.hypot(body.length, body.width)[:, None]
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, bodies.body, xy - margin)
    np.maximum.at(high, bodies.body, xy + margin)
    return Survey(
        lone=np.bincount(bodies.body) == 1, box=np.hstack([low, high]), radius=np.hypot(*np.maximum(-low, high).T),
        pose=np.zeros((count, 3, 3)), distance=np.full(count, -1.0), shallow=np.zeros(count, np.bool_), draft=np.zeros(count),
        times=np.zeros(count, np.int64),
    )  # fmt: skip


@borrower
def _measure_distance(pose: Floats, other: Floats, reach: float, radius: float) -> float:
    """Way (m) of the farthest point of a fragment, at ``reach`` m from its middle, between two poses."""
    moved = turned = 0.0
    for k in range(3):
        moved += (pose[k, 2] - other[k, 2]) ** 2
        turned += (pose[k, 0] - other[k, 0]) ** 2
    return radius * math.sqrt(moved) + reach * math.sqrt(turned)


@borrower
def _add_distances(pose: Floats, last: Floats, radius: Floats, scale: float, travelled: Floats) -> None:
    """Add the distances that fragments have gone since their last poses, and keep the new poses."""
    for b in range(travelled.size):
        travelled[b] += _measure_distance(pose[b], last[b], radius[b], scale)
        for i in range(3):
            for j in range(3):
                last[b, i, j] = pose[b, i, j]


# Many arguments: the arrays that it fills.
@borrower
def find_near(
    bodies: Bodies, body: Body, environment: Environment, load: Floats, survey: Survey, rho_ice: float, h: float, further: Floats,
    scale: float, near_floor: NDArray[np.bool_], left: NDArray[np.bool_], reach: Floats, draft: Floats,
) -> tuple[float, bool, bool]:  # fmt: skip
    """Mark the fragments that may come near the floor in ``h`` s, and the fragments that may have left the surveyed floor.

    Lone bergs by the depth in the middle and the speed of the water, which they may take up; where that is near, the floor is
    surveyed. ``further``: factors of their ways; ``scale``: radius of the earth, or 1 in a plane; ``reach``
    takes the way of the step and ``draft`` the deepest keel of each fragment, m. Returns the least clearance in the middle of
    elements, m, and whether any fragment comes near the floor or has left.
    """
    least, some_near, some_left = math.inf, False, False
    for b in range(near_floor.size):
        twist = bodies.twist[b]
        draft[b], near_floor[b], left[b] = -math.inf, False, False
        reach[b] = further[b] * (h * (math.hypot(twist[0], twist[1]) + survey.radius[b] * abs(twist[2])) + ASIDE)
    for e in range(bodies.body.size):
        b, keel = bodies.body[e], draft_of(body.thickness[e], rho_ice)
        draft[b], least = max(draft[b], keel), min(least, environment.depth[e] - keel)
        if survey.lone[b]:
            reach[b] = max(reach[b], further[b] * (h * math.hypot(environment.uo[e], environment.vo[e]) + ASIDE))
            within = math.sqrt(body.length[e] * body.width[e]) + reach[b]
            near_floor[b] = load[e] > 0.0 or environment.depth[e] - keel < STEEPEST * within
    for b in range(near_floor.size):
        if near_floor[b] or not survey.lone[b]:
            travelled = _measure_distance(bodies.pose[b], survey.pose[b], survey.radius[b], scale)
            left[b] = not travelled + reach[b] <= survey.distance[b] or draft[b] > survey.draft[b]
            near_floor[b] = survey.shallow[b]
        some_near, some_left = some_near or near_floor[b], some_left or left[b]
    return least, some_near, some_left


class Watch(NamedTuple):
    """Squares of ice over a floor that may touch them, and the polygons in these."""

    square: Ints  # Their numbers
    body: Ints  # Place of the fragment of each
    slope: Floats  # Steepest of the floor that may come under it
    depth: Floats  # Of its middle when the floor was asked for it last, m
    travelled: Floats  # Distance that its fragment had gone then, m
    polygon: Ints  # By fragment
    within: Ints  # Place of the square of each polygon
    start: Ints  # Where the polygons of each fragment begin; shape (fragments + 1,)
    is_near: NDArray[np.bool_]  # Whether the floor may come near a square in the step
    any_near: NDArray[np.bool_]  # Whether it may come near any of a fragment
    asked: Ints  # Places of those for which the floor is asked anew come here
    lon: Floats  # And where they are
    lat: Floats


@kernel
def _watch_squares(
    pads: Pads, b: int, floor: Floor, shallow: NDArray[np.bool_], distance: float, slope: Floats
) -> None:
    """Find the steepest slope of the floor within ``distance`` m of the squares of a fragment, NaN where it is deep.

    Blocks of squares of some half a tile have the same.
    """
    rows, columns, side, shallow_tiles = pads.shape[b, 0], pads.shape[b, 1], pads.side[b], np.flatnonzero(shallow)
    wide = max(int(0.7 * floor.half / side), 1)
    reach = distance + floor.half + 0.71 * wide * side
    for j in range((rows - 1) // wide + 1):
        for i in range((columns - 1) // wide + 1):
            x = pads.origin[b, 0] + pads.low[b, 0] + (i + 0.5) * wide * side
            y = pads.origin[b, 1] + pads.low[b, 1] + (j + 0.5) * wide * side
            steepest = math.nan
            for t in shallow_tiles:
                if (floor.x[t] - x) ** 2 + (floor.y[t] - y) ** 2 < reach * reach:
                    steepest = 0.0
                    break
            if steepest == 0.0:
                for n in range(shallow.size):
                    if (floor.x[n] - x) ** 2 + (floor.y[n] - y) ** 2 < reach * reach:
                        steepest = max(steepest, floor.slope[n])
            for row in range(j * wide, min((j + 1) * wide, rows)):
                for column in range(i * wide, min((i + 1) * wide, columns)):
                    slope[row * columns + column] = steepest


@kernel
def _list_watched(square: Ints, slope: Floats) -> tuple[Ints, Ints, Ints]:
    """List the squares over a floor that may touch them, the polygons in these, and the place of the square of each.

    ``square``: of each polygon; ``slope``: of each square, NaN where it is deep.
    """
    number, polygons = np.full(slope.size, -1), 0
    for s in square:
        if not math.isnan(slope[s]):
            number[s] = 0
            polygons += 1
    squares = np.flatnonzero(number == 0)
    number[squares] = np.arange(squares.size)
    polygon, within, count = np.empty(polygons, np.int64), np.empty(polygons, np.int64), 0
    for k in range(square.size):
        if not math.isnan(slope[square[k]]):
            polygon[count], within[count] = k, number[square[k]]
            count += 1
    return squares, polygon, within


@borrower
def _choose_squares(f: Landing, watch: Watch, travelled: Floats, latlon: bool, radius: float) -> int:
    """Mark the squares that may come near the floor in a step, by the depth that was found last.

    Lists those that have moved since, and returns their number. ``travelled``: distance that each fragment has gone since it is
    watched, m.
    """
    pads, count = f.pads, 0
    watch.any_near[:] = False
    for n in range(watch.square.size):
        b, slope = watch.body[n], watch.slope[n]
        moved = travelled[b] - watch.travelled[n]
        rise = slope * (moved + 0.75 * pads.side[b] + f.reach[b])
        watch.is_near[n] = f.reach[b] >= 0.0 and watch.depth[n] + f.lowest[b] - f.deepest[b] < rise + CLEAR
        watch.any_near[b] = watch.any_near[b] or watch.is_near[n]
        if watch.is_near[n] and (moved > STILL or watch.depth[n] == -math.inf):
            ice = pads.ice[watch.square[n]]
            x, y = ice[1] + pads.origin[b, 0], ice[2] + pads.origin[b, 1]
            watch.lon[count], watch.lat[count] = place_points(x, y, f.pose[b], latlon, radius)
            watch.asked[count], watch.travelled[n] = n, travelled[b]
            count += 1
    return count


@borrower
def _list_candidates(f: Landing, watch: Watch, depth: Floats) -> None:
    """List the polygons that may touch the floor in a step, by the depth in the middle of their squares.

    ``depth``: of those that were asked for, m.
    """
    pads, count, changed = f.pads, 0, False
    for a in range(f.bodies.size):
        f.clearance[a] += f.lowest[a]
    for n in range(depth.size):
        watch.depth[watch.asked[n]] = depth[n]
    for a in range(f.bodies.size):
        changed = changed or f.polygon_start[a] != count
        f.polygon_start[a] = count
        for n in range(watch.start[a], watch.start[a + 1] if watch.any_near[a] else watch.start[a]):
            s, k = watch.within[n], watch.polygon[n]
            if not watch.is_near[s]:
                continue
            clear = watch.depth[s] + f.lowest[a] - f.draft[pads.owner[k]]
            f.clearance[a] = min(f.clearance[a], clear)
            if clear < watch.slope[s] * (STILL + 0.75 * pads.side[a] + f.reach[a]) + CLEAR:
                changed = changed or f.polygons[count] != k
                f.polygons[count] = k
                count += 1
    changed = changed or f.polygon_start[f.bodies.size] != count
    f.polygon_start[f.bodies.size] = count
    if changed:  # else those of the last step
        list_corners(f)
    for a in range(f.bodies.size):
        if f.polygon_start[a] == f.polygon_start[a + 1]:
            f.status[a] = AFLOAT


class Keels:
    """Pads of fragments that came near the floor, and which of them are looked at."""

    def __init__(self, bodies: Ints, pads: Pads, size: Floats, survey: Survey, pose: Floats) -> None:
        self.bodies, self.pads, self.size = bodies, pads, size
        self.landing = allocate_landing(bodies, pads, unmade_plates(pads))
        self.cut = np.zeros(survey.distance.size, np.bool_)
        self.cut[bodies] = True
        fragment = np.repeat(np.arange(bodies.size), np.diff(pads.polygon_start))
        self._square = pads.square_start[fragment] + pads.square[:, 0] * pads.shape[fragment, 1] + pads.square[:, 1]
        # Steepest slope of the floor that may come under each square; none where it is so deep that nobody needs to look.
        self._slope = np.full(len(pads.ice), np.nan)
        self.travelled, self._pose, self._times = np.zeros(bodies.size), pose.copy(), np.zeros(bodies.size, np.int64)
        self._watch: Watch | None = None

    def find_candidates(self, f: Landing, shoal: Shoal, depth: DepthSampler, c: KernelParameters) -> bool:
        """List the polygons of fragments that may touch the floor in a step; returns whether there are any."""
        watch = self._update_watch(shoal, f.pose, c.earth_radius if c.latlon else 1.0)
        squares = _choose_squares(f, watch, self.travelled, c.latlon, c.earth_radius)
        asked = depth(watch.lon[:squares], watch.lat[:squares]) if squares else np.zeros(0)
        _list_candidates(f, watch, asked)
        return bool(f.polygon_start[-1] > 0)

    def _update_watch(self, shoal: Shoal, pose: Floats, scale: float) -> Watch:
        """Return the squares that are looked at, after the fragments have come to ``pose``."""
        survey, pads = shoal.survey, self.pads
        _add_distances(pose, self._pose, survey.radius[self.bodies], scale, self.travelled)
        renewed = np.flatnonzero(self._times != survey.times[self.bodies]).tolist()
        for a in renewed:
            b, first, squares = int(self.bodies[a]), int(pads.square_start[a]), int(pads.shape[a].prod())
            slope = self._slope[first : first + squares]
            _watch_squares(pads, a, *shoal.floors[b], float(survey.distance[b]), slope)
            self._times[a] = survey.times[b]
        if renewed or self._watch is None:
            square, polygon, within = _list_watched(self._square, self._slope)
            body, start = (
                np.searchsorted(pads.square_start, square, side="right") - 1,
                np.searchsorted(polygon, pads.polygon_start),
            )
            self._watch = Watch(
                square, body, self._slope[square], np.full(square.size, -np.inf), np.zeros(square.size), polygon, within, start,
                np.zeros(square.size, np.bool_), np.zeros(self.bodies.size, np.bool_), np.empty_like(square),
                *np.empty((2, square.size)),
            )  # fmt: skip
        return self._watch


class Shoal:
    """Fragments that go together through a step."""

    def __init__(self, bodies: Bodies, body: Body, latlon: bool, earth: float) -> None:
        self.arrays: tuple[NDArray[Any], ...] = ()  # by which they are known again
        self.key: list[bytes] = []
        self.survey = _begin_survey(bodies, body, latlon, earth)
        self.floors: dict[int, tuple[Floor, NDArray[np.bool_]]] = {}  # Around each, and where it is shallow
        self.keels: Keels | None = None
        # Of the last step: which may come near the floor, which have left what is surveyed, their ways and deepest keels, m
        count = self.survey.lone.size
        self.near_floor, self.left = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self.reach, self.draft = np.zeros(count), np.zeros(count)
        self.ice = b""  # Thickness for which these were cut

    def survey_around(self, b: int, pose: Floats, reach: float, draft: float, soundings: Soundings) -> None:
        """Survey the floor around a fragment."""
        survey, box, distance = self.survey, self.survey.box[b], reach + RING
        floor = soundings.find_tiles(pose, box, distance)
        shallow = floor.least < draft + RESERVE
        if shallow.any():
            x, y = floor.x[shallow], floor.y[shallow]
            gap = np.hypot(np.maximum(box[0] - x, x - box[2]).clip(0.0), np.maximum(box[1] - y, y - box[3]).clip(0.0))
            open_way, distance = float(gap.min()) - floor.half, reach + NEAR_RING
            if open_way > distance:
                shallow[:], distance = False, open_way
        survey.pose[b], survey.distance[b], survey.draft[b], survey.shallow[b] = pose, distance, draft, shallow.any()
        survey.times[b] += 1
        self.floors[b] = floor, shallow
