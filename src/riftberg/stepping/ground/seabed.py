"""The bed of sediment under a run: which fragments come near it, and what it makes of a step for those that it touches."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing, land_at, sea_level
from riftberg.parameters import Grounding
from riftberg.physics.floating import draft_of
from riftberg.physics.seabed import bending_stress, friction_depth
from riftberg.state import Floats, Ints
from riftberg.state.population import rows_of
from riftberg.state.variables import LARGEST
from riftberg.stepping.bodies.dynamics import BodyOperators, add_inertia_and_floor_drag
from riftberg.stepping.bodies.pose import Bodies, tangent_coordinates
from riftberg.stepping.contact.broad_phase import NO_PAIRS
from riftberg.stepping.contact.islands import PeakContactLoad, SubcycledMotion, forcing_of_rows
from riftberg.stepping.forces.media import FORCES
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.ground import landing
from riftberg.stepping.ground.pads import (
    LOW_X,
    LOW_Y,
    ORIGIN_X,
    ORIGIN_Y,
    RIGID,
    SIDE,
    Pads,
    cut_into_pads,
    fill_hulls,
    melted,
    place_points,
    sides_of_pads,
)
from riftberg.stepping.ground.plate import PlateRoom
from riftberg.stepping.ground.press import HOLD, LIFT, LOAD, PRESSED, STRESS, YIELD, Bed
from riftberg.stepping.ground.soundings import DepthOf, Floor, Soundings
from riftberg.stepping.lattice.footprints import FootprintBook, body_footprint
from riftberg.stepping.run_state import RunState

POISSON: Final = 0.3
"""Of the ice that bends, for which the stiffness at edges and corners was found."""

SEDIMENTS: Final[dict[str, dict[str, float]]] = {
    "rock": {"stiffness": 1e9, "bearing_strength": 1e7, "friction": 0.5},
    "sand": {"stiffness": 1e7, "bearing_strength": 1e6, "friction": 0.5},
    "clay": {"stiffness": 1e6, "friction": 0.5, "shear_strength": 2e4},
    "other": {},
}
"""Beds by name; on clay the bearing strength follows from the shear strength."""

BEARING_FACTOR: Final = 6.0
"""Bearing strength of clay over its shear strength (a long strip 5.14)."""

FARTHEST: Final = 512.0
"""Times the expected way for which the floor is watched before a step is given up."""

OPEN_DEPTH: Final = 1e4
"""Depth (m) beyond all data."""

STEEPEST: Final = 0.5
"""Slope by which a floor that is not surveyed may rise towards a keel."""

RING: Final = 5000.0
"""Way (m) for which the floor around a fragment is surveyed at once."""

RESERVE: Final = 5.0
"""Clearance (m) beyond the surveyed one that levels may take."""

ASIDE: Final = 20.0
"""How far forces may take a fragment from its way in a step, m, before it is looked at again."""

STRUCK: Final = 0.05
"""Change of velocity (m s-1) in a step that makes an impact; pieces that lean on each other give less."""

DEEP_KEEL: Final = 1.0
"""How far below the floor a keel may start, m, where it is not to start aground."""

INSIDE: Final = 0.75
"""Share of ice around a load from which the ice cracks along the line of the load; elsewhere a piece of the edge breaks off."""


def bed_of(g: Grounding) -> Bed:
    """Return the bed that the parameters describe."""
    values = {**SEDIMENTS[g.sediment]}
    for name in ("stiffness", "bearing_strength", "friction", "shear_strength"):
        if (given := getattr(g, name)) is not None:
            values[name] = given
    shear = values.get("shear_strength", 0.0)
    stiffness, strength = values["stiffness"], values.get("bearing_strength", BEARING_FACTOR * shear)
    grip = friction_depth(stiffness, strength, values["friction"], g.adhesion * shear)
    modulus = g.ice_modulus if g.bending else 0.0
    return Bed(stiffness, strength, values["friction"], g.adhesion * shear, grip, g.anchor_way, modulus, POISSON)


def depth_of_bed(forcing: Forcing, middle: float = 0.0, period: float = 0.0) -> DepthOf:
    """Return the depth of the bed (m) at points: land of no known depth is dry, and what lies beyond all data is deep.

    ``period``: of a plane that repeats eastward (m), which is asked within half of it from ``middle``.
    """

    def depth(lon: Floats, lat: Floats) -> Floats:
        if period > 0.0:
            lon = lon - period * np.round((lon - middle) / period)
        found = np.asarray(forcing.depth(lon, lat), float)
        lost = ~np.isfinite(found)
        if lost.any():
            dry = land_at(forcing, lon[lost], lat[lost])
            # Beyond the data it is as deep as at its edge: a plane through a step of kilometres would overshoot into the keel.
            beyond = OPEN_DEPTH if lost.all() else float(np.max(found[~lost]))
            found = found.copy()
            found[lost] = np.where(dry, 0.0, beyond)
        return found

    return depth


class Survey(NamedTuple):
    """What has been surveyed around fragments; one of each."""

    bodies: Ints  # Their numbers
    radius: Floats  # m
    pose: Floats  # At the survey; shape (fragments, 3, 3)
    way: Floats  # For which the survey holds, m
    open_way: Floats  # The same where nothing is near the keel; 0 where something is
    draft: Floats  # Of the deepest keel then, m


NO_SURVEY: Final = Survey(
    np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
)


@kernel
def _way_since(pose: Floats, surveyed: Floats, reach: float, radius: float) -> float:
    """Way (m) of the farthest point of a fragment, at ``reach`` m from its middle, since a survey."""
    moved = turned = 0.0
    for k in range(3):
        moved += (pose[k, 2] - surveyed[k, 2]) ** 2
        turned += (pose[k, 0] - surveyed[k, 0]) ** 2
    return radius * math.sqrt(moved) + reach * math.sqrt(turned)


# Many arguments: the arrays that it needs of the state, apart.
@kernel
def _find_near(
    bodies: Bodies, thickness: Floats, length: Floats, width: Floats, depth: Floats, uo: Floats, vo: Floats, load: Floats,
    rho_ice: float, h: float, radius: float, survey: Survey, near: NDArray[np.bool_],
) -> float:  # fmt: skip
    """Mark the fragments that may come near the floor in ``h`` s, by the depth in the middle of their elements.

    Those that stay where nothing near was surveyed do not. A lone berg may take up the speed of the water on the way.
    ``radius``: of the earth, or 1 in a plane. Returns the least clearance there, m.
    """
    least, body, number, deepest = math.inf, bodies.body, np.zeros(near.size, np.int64), np.full(near.size, -math.inf)
    for n in range(survey.bodies.size):
        b = survey.bodies[n]
        twist, reach = bodies.twist[b], survey.radius[n]
        way = h * (math.hypot(twist[0], twist[1]) + reach * abs(twist[2])) + ASIDE
        if _way_since(bodies.pose[b], survey.pose[n], reach, radius) + way <= survey.open_way[n]:
            deepest[b] = survey.draft[n]
    for e in range(body.size):
        number[body[e]] += 1
    for e in range(body.size):
        b, draft = body[e], draft_of(thickness[e], rho_ice)
        arm = radius * math.hypot(bodies.reference[e, 0], bodies.reference[e, 1])
        twist = bodies.twist[b]
        speed = math.hypot(twist[0], twist[1]) + arm * abs(twist[2])
        if number[b] == 1:
            speed = max(speed, math.hypot(uo[e], vo[e]))
        reach = math.sqrt(length[e] * width[e]) + h * speed + ASIDE
        near[b] = near[b] or (draft > deepest[b] and depth[e] - draft < STEEPEST * reach) or load[e] > 0.0
        least = min(least, depth[e] - draft)
    return least


@kernel
def _place_squares(
    pads: Pads, squares: Ints, body: Ints, pose: Floats, latlon: bool, radius: float, lon: Floats, lat: Floats
) -> None:  # fmt: skip
    """Find the positions of the middles of squares; ``body``: place of the fragment of each, ``pose``: of the fragments."""
    for n in range(squares.size):
        b, ice = body[n], pads.ice[squares[n]]
        x, y = ice[1] + pads.frame[b, ORIGIN_X], ice[2] + pads.frame[b, ORIGIN_Y]
        lon[n], lat[n] = place_points(x, y, pose[b], latlon, radius)


# Many arguments: lists of squares and polygons are arrays apart, as the loop reads them.
@kernel
def _find_candidates(
    pads: Pads, polygons: Ints, square: Ints, body: Ints, slope: Floats, depth: Floats, draft: Floats, reach: Floats,
    near: NDArray[np.bool_], out: Ints, start: Ints, clearance: Floats,
) -> None:  # fmt: skip
    """List the polygons that may touch the floor on a way of ``reach`` m, by the depth (with the level) in the middle of squares.

    ``polygons``: those in squares that are watched, by fragment; ``square``: theirs among these, ``body`` and ``slope`` of each.
    ``start``: where those of each fragment begin; ``clearance``: takes the least of each fragment.
    """
    count, b = 0, 0
    for n in range(polygons.size):
        s, k = square[n], polygons[n]
        while b <= body[s]:
            start[b] = count
            b += 1
        clear = depth[s] - draft[pads.owner[k]]
        clearance[body[s]] = min(clearance[body[s]], clear)
        if near[body[s]] and clear < slope[s] * (0.75 * pads.frame[body[s], SIDE] + reach[body[s]]) + 2.0:
            out[count] = k
            count += 1
    start[b:] = count


class Shoal:
    """Fragments that have come near the floor, with their pads, and which of these are looked at in each step."""

    def __init__(
        self, key: list[bytes], bodies: Ints, side: Floats, pads: Pads, size: Floats, before: Shoal | None = None
    ) -> None:  # fmt: skip
        self.key, self.bodies, self.side, self.whole, self.size = key, bodies, side, pads, size
        self.plates = PlateRoom(pads)
        self.arrays: tuple[NDArray[Any], ...] = ()  # of which the key was made, as they were last
        self.ice = b""  # and the thickness that it had then
        self.lone, of = np.diff(pads.row_start) == 1, np.repeat(np.arange(bodies.size), np.diff(pads.polygon_start))
        self._square = pads.raster[of, 0] + pads.square[:, 0] * pads.raster[of, 2] + pads.square[:, 1]
        of_corner = np.repeat(of, np.diff(pads.start))
        self.radius, count = np.zeros(bodies.size), bodies.size
        np.maximum.at(self.radius, of_corner, np.hypot(*(pads.corner + pads.frame[of_corner, :2]).T))
        self.survey = Survey(bodies, self.radius, np.full((count, 3, 3), np.inf), *(np.zeros(count) for _ in range(3)))
        # Steepest slope of the floor near each square; none where it is so deep that nobody needs to look.
        self._slope = np.where(np.repeat(self.lone, pads.raster[:, 1] * pads.raster[:, 2]), STEEPEST, np.nan)
        if before is not None:  # of the same fragments: what was surveyed holds
            for b, old in zip(*np.intersect1d(bodies, before.bodies, return_indices=True)[1:], strict=True):
                if side[b] == before.side[old]:
                    for array, values in zip(self.survey[2:], before.survey[2:], strict=True):
                        array[b] = values[old]
                    squares, those = (
                        slice(r[0], r[0] + r[1] * r[2]) for r in (pads.raster[b], before.whole.raster[old])
                    )
                    self._slope[squares] = before._slope[those]
        self._list()

    def _list(self) -> None:
        """List the squares that are watched, and the polygons in them."""
        self.polygons = np.flatnonzero(np.isfinite(self._slope[self._square]))
        self.squares, self.square = np.unique(self._square[self.polygons], return_inverse=True)
        self.body, self.slope = (
            np.searchsorted(self.whole.raster[:, 0], self.squares, side="right") - 1,
            self._slope[self.squares],
        )

    def look_around(
        self, pose: Floats, reach: Floats, draft: Floats, near: NDArray[np.bool_], soundings: Soundings, scale: float
    ) -> None:  # fmt: skip
        """Survey the floor around bonded fragments that may leave that of the last survey on a way of ``reach`` m.

        ``scale``: radius of the earth, or 1 in a plane.
        """
        survey, pads = self.survey, self.whole
        left = [
            b for b in np.flatnonzero(near & ~self.lone).tolist()
            if not _way_since(pose[b], survey.pose[b], float(self.radius[b]), scale) + reach[b] <= survey.way[b]
        ]  # fmt: skip
        for b in left:
            low, (first, rows, columns) = pads.frame[b, [LOW_X, LOW_Y]], pads.raster[b].tolist()
            box = np.concatenate([low, low + self.side[b] * np.array([columns, rows])]) + np.tile(pads.frame[b, :2], 2)
            way, deepest = reach[b] + RING, float(draft[pads.row_start[b] : pads.row_start[b + 1]].max())
            floor = soundings.around(pose[b], box, way)
            shallow = floor.least < deepest + RESERVE
            _watch_squares(
                pads.raster[b], pads.frame[b], floor, shallow, way, self._slope[first : first + rows * columns]
            )
            survey.pose[b], survey.draft[b], survey.way[b] = pose[b], deepest, way
            survey.open_way[b] = 0.0 if shallow.any() else way
        if left:
            self._list()


@kernel
def _watch_squares(
    raster: Ints, frame: Floats, floor: Floor, shallow: NDArray[np.bool_], way: float, slope: Floats
) -> None:
    """Find the steepest slope of the floor within ``way`` m of squares, NaN where no tile within it is shallow.

    Blocks of squares of some half a tile have the same.
    """
    rows, columns, side = raster[1], raster[2], frame[SIDE]
    wide = max(int(0.7 * floor.half / side), 1)
    reach = way + floor.half + 0.71 * wide * side
    for j in range((rows - 1) // wide + 1):
        for i in range((columns - 1) // wide + 1):
            x = frame[ORIGIN_X] + frame[LOW_X] + (i + 0.5) * wide * side
            y = frame[ORIGIN_Y] + frame[LOW_Y] + (j + 0.5) * wide * side
            steepest, near = 0.0, False
            for n in range(shallow.size):
                if (floor.x[n] - x) ** 2 + (floor.y[n] - y) ** 2 < reach * reach:
                    near = near or shallow[n]
                    steepest = max(steepest, floor.slope[n])
            for row in range(j * wide, min((j + 1) * wide, rows)):
                for column in range(i * wide, min((i + 1) * wide, columns)):
                    slope[row * columns + column] = steepest if near else math.nan


@kernel
def _place_middles(frame: Floats, pose: Floats, latlon: bool, radius: float) -> tuple[Floats, Floats]:
    """Find the positions of the middles of fragments."""
    lon, lat = np.empty(len(frame)), np.empty(len(frame))
    for b in range(len(frame)):
        lon[b], lat[b] = place_points(frame[b, ORIGIN_X], frame[b, ORIGIN_Y], pose[b], latlon, radius)
    return lon, lat


class Seabed:
    """The bed under a run: what lives from one step to the next beside the state."""

    def __init__(self, model: RunState, footprints: FootprintBook) -> None:
        p, lon = model.parameters, model.elements.lon
        self.bed = bed_of(p.grounding)
        self.depth = depth_of_bed(
            model.forcing, float(lon[0]) if lon.size else 0.0, 0.0 if p.earth.latlon else p.earth.period
        )
        self.soundings = Soundings(self.depth, p.earth.latlon, model.constants.earth_radius)
        self.familiar: Ints | None = None  # Identifiers of the elements that were there in the last step; None at first
        # Work of friction since the start, J; least clearance of a keel, m.
        self.rubbed, self.clearance = np.zeros(1), np.full(1, np.inf)
        self._footprints = footprints
        self._shoals: list[Shoal] = []  # Of the last groups of fragments that went through a step, the latest first

    def checkpoint(self) -> tuple[Floats, Floats]:
        """Return what a step changes."""
        return self.rubbed.copy(), self.clearance.copy()

    def rollback(self, before: tuple[Floats, Floats]) -> None:
        """Return to what `checkpoint` gave."""
        self.rubbed, self.clearance = (array.copy() for array in before)

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        # Files hold finite numbers: a large one stands for no keel near the floor yet.
        return {"bed_plastic": self.rubbed, "bed_clearance": np.minimum(self.clearance, 0.5 * LARGEST)}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave."""
        if "bed_plastic" in saved:
            self.rubbed = np.array(saved["bed_plastic"], np.float64)[:1]  # earlier versions had gouges behind it
        if "bed_clearance" in saved:
            clearance = np.array(saved["bed_clearance"], np.float64)
            self.clearance = np.where(clearance < 0.5 * LARGEST, clearance, np.inf)

    def near(self, model: RunState, bodies: Bodies, h: float) -> NDArray[np.bool_]:
        """Which fragments may come near the floor in ``h`` s."""
        el, c, near = model.elements, model.constants, np.zeros(bodies.pose.shape[0], np.bool_)
        around, body, arrays = el.environment, el.body, (bodies.body, bodies.reference, el.body.id)
        shoal = next((shoal for shoal in self._shoals if all(map(operator.is_, arrays, shoal.arrays))), None)
        least = _find_near(
            bodies, body.thickness, body.length, body.width, around.depth, around.uo, around.vo, el.keel.floor_load, c.rho_ice, h,
            c.earth_radius if c.latlon else 1.0, NO_SURVEY if shoal is None else shoal.survey, near,
        )  # fmt: skip
        if not near.any():  # else it is looked at more closely
            self.clearance[0] = min(self.clearance[0], least)
        return near

    def _shoal(self, model: RunState, bodies: Bodies, near: NDArray[np.bool_]) -> Shoal:
        """Return the pads of the fragments that are near."""
        el, c, which = model.elements, model.constants, np.flatnonzero(near)
        arrays, ice = (bodies.body, bodies.reference, el.body.id), el.body.thickness.tobytes()
        for shoal in self._shoals:  # nearly always: nothing has changed
            if all(map(operator.is_, arrays, shoal.arrays)) and ice == shoal.ice and np.isin(which, shoal.bodies).all():
                return shoal
        key = [array.tobytes() for array in arrays]
        known = next((shoal for shoal in self._shoals if shoal.key == key), None)
        if known is not None and not np.isin(which, known.bodies).all():
            which = np.union1d(which, known.bodies) if known.bodies.size < 2 * which.size else which
        elif known is not None:
            which = known.bodies
        count = np.bincount(bodies.body, minlength=near.size)[which]
        thickness = np.bincount(bodies.body, el.body.thickness, near.size)[which] / count
        # Also ice that does not bend is cut that finely, for the sake of the floor.
        modulus = self.bed.modulus or 9e9
        side = sides_of_pads(modulus, POISSON, thickness)
        if known is not None and np.array_equal(which, known.bodies) and np.array_equal(side, known.side):
            known.arrays, known.ice = arrays, ice
            return known
        place = np.full(near.size, -1)
        place[which] = np.arange(which.size)
        rows = np.flatnonzero(place[bodies.body] >= 0)
        rows = rows[np.argsort(place[bodies.body[rows]], kind="stable")]
        xy, body = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius), place[bodies.body[rows]]
        prints = self._footprints.follow(model)
        footprint = body_footprint(prints, el, rows, xy, body, shrinks=False)
        size = prints.size[rows_of(prints.element, el.body.id[rows])[0]]
        shoal = Shoal(key, which, side, cut_into_pads(footprint, body, which.size, xy[rows], side), size, known)
        shoal.arrays, shoal.ice = arrays, ice
        self._shoals = [shoal, *(one for one in self._shoals if one is not known)][:3]
        return shoal

    def _landing(
        self, model: RunState, bodies: Bodies, near: NDArray[np.bool_], time: float, h: float, further: float
    ) -> tuple[landing.Landing, Ints] | None:
        """Prepare the fragments that may touch the floor for a step; None where there are none.

        ``further``: factor of the way for which the floor is watched.
        """
        el, c, forcing = model.elements, model.constants, model.forcing
        shoal = self._shoal(model, bodies, near)
        which, rows, count = shoal.bodies, shoal.whole.rows, shoal.bodies.size
        thickness, first = el.body.thickness[rows], rows[shoal.whole.row_start[:-1]]
        draft, pose, twist = draft_of(thickness, c.rho_ice), bodies.pose[which], bodies.twist[which]
        speed = np.hypot(twist[:, 0], twist[:, 1]) + shoal.radius * np.abs(twist[:, 2])
        drift = np.where(shoal.lone, np.hypot(el.environment.uo[first], el.environment.vo[first]), 0.0)
        reach = further * (h * np.maximum(speed, drift) + ASIDE)
        shoal.look_around(pose, reach, draft, near[which], self.soundings, c.earth_radius if c.latlon else 1.0)
        if not shoal.squares.size:
            self.clearance[0] = np.fmin.reduce(
                el.environment.depth - draft_of(el.body.thickness, c.rho_ice), initial=self.clearance[0]
            )
            return None
        pads = melted(shoal.whole, np.sqrt(el.body.length[rows] * el.body.width[rows] / shoal.size))
        number, hull, mean = np.zeros((count, landing.NUMBERS)), np.empty((count, 3, 3)), np.empty(count)
        number[:, landing.REACH] = reach
        lon, lat = np.empty((2, shoal.squares.size))
        _place_squares(pads, shoal.squares, shoal.body, pose, c.latlon, c.earth_radius, lon, lat)
        middle = _place_middles(pads.frame, pose, c.latlon, c.earth_radius)
        for n, part in enumerate((0.0, 0.5, 1.0)):
            number[:, landing.LEVEL + n] = sea_level(forcing, *middle, time + part * h)
        depth = self.depth(lon, lat) + number[:, landing.LEVEL :].min(axis=1)[shoal.body]
        polygons, start, clearance = (
            np.empty(shoal.polygons.size, np.int64),
            np.zeros(count + 1, np.int64),
            np.full(count, np.inf),
        )
        _find_candidates(
            pads, shoal.polygons, shoal.square, shoal.body, shoal.slope, depth, draft, reach, near[which], polygons, start,
            clearance,
        )  # fmt: skip
        polygons = polygons[: start[-1]]
        if not polygons.size:
            self.clearance[0] = min(self.clearance[0], max(clearance.min(initial=np.inf), 0.0))
            return None
        fill_hulls(pads, thickness, draft, self.bed.modulus, POISSON, hull, mean, number[:, landing.LENGTH])
        plates = shoal.plates.reserve(polygons, start, number[:, landing.LENGTH], hull[:, 1, 1] < RIGID)
        number[:, landing.THICKNESS], number[:, landing.CLEARANCE], number[:, landing.RADIUS] = (
            mean,
            clearance,
            shoal.radius,
        )
        flag = np.zeros((count, 5), np.int64)
        flag[np.diff(start) == 0, landing.STATUS] = landing.AFLOAT
        motion = np.zeros((count, 7, 3))
        motion[:, landing.VELOCITY] = twist
        keel, n = el.keel, rows.size
        anchors = np.column_stack(
            [keel.anchor_x[rows], keel.anchor_y[rows], keel.anchor_capacity[rows], np.zeros((n, 3))]
        )  # fmt: skip
        touched = (keel.floor_load[rows] > 0.0) | anchors[:, : landing.ANCHOR_X + 2].any(axis=1)
        flag[:, landing.TOUCHES] = np.logical_or.reduceat(touched, pads.row_start[:-1])
        number[:, landing.SUBSTEP] = np.where(
            (flag[:, landing.TOUCHES] > 0) & (keel.floor_substep[first] > 0.0),
            keel.floor_substep[first],
            landing.HELD_STEP,
        )
        number[:, landing.SHORTEST], number[:, landing.PEAK] = math.inf, -1.0
        return landing.Landing(
            pads, plates, polygons, start, pose, np.empty_like(pose), hull, np.zeros_like(hull), motion, number, flag,
            np.zeros((count, 3)), draft, bodies.reference[rows], np.empty((n, 11)), anchors, np.zeros((n, 6)),
            np.zeros((n, PRESSED)), keel.floor_yield[rows], np.zeros((polygons.size, 5)), np.zeros((n, len(FORCES), 2)),
            np.zeros((n, 5)),
        ), which  # fmt: skip

    def resolve(
        self, model: RunState, bodies: Bodies, op: BodyOperators, time: float, h: float, contact: SubcycledMotion | None
    ) -> SubcycledMotion | None:
        """Take the fragments that touch the floor within ``h`` s through sub-steps; None where none does.

        Writes what the floor does to the keels at the end, and the largest bending stress that each bond has borne.
        """
        near, further, prepared = self.near(model, bodies, h), 1.0, None
        model.bonds.flexural_stress[:] = 0.0
        while near.any():
            prepared = self._landing(model, bodies, near, time, h, further)
            if prepared is None:
                break
            flexure = self._run(model, bodies, op, h, contact, *prepared)
            if not (prepared[0].flag[:, landing.STATUS] == landing.BEYOND).any():
                model.bonds.flexural_stress[:] = flexure
                break
            further *= 8.0  # a light berg may be taken up by the water
            if further > FARTHEST:
                raise RunError(
                    "the sea floor throws a berg over more than a hundred kilometres in a step: its keel stands far inside the "
                    "floor. Compare thickness and depth, or take a shorter stepping.time_step"
                )
        if prepared is None:
            self._lift_off(model)
            return None
        return self._finish(model, *prepared, h)

    def _run(
        self, model: RunState, bodies: Bodies, op: BodyOperators, h: float, contact: SubcycledMotion | None,
        now: landing.Landing, which: Ints,
    ) -> Floats:  # fmt: skip
        """Take the fragments ``which`` through a step; returns the bending stress of bonds, if it may break any (Pa)."""
        c, inertia, pads = model.constants, op.matrices.inertia[which], now.pads
        now.mobility[:] = op.matrices.mobility[which]
        now.number[:, landing.ARM] = np.sqrt(inertia[:, 2, 2] / inertia[:, 0, 0])
        twist = bodies.twist[which]
        now.number[:, landing.SPEED] = np.hypot(twist[:, 0], twist[:, 1]) + now.number[:, landing.ARM] * np.abs(
            twist[:, 2]
        )
        if contact is not None:
            _, here, there = np.intersect1d(which, contact.bodies, return_indices=True)
            now.motion[here, landing.PUSH] = contact.impulse[there] / h
        forcing = forcing_of_rows(pads.rows, op.forcing)
        flexure, bends = np.zeros(model.bonds.first.size), model.parameters.fracture.flexural_strength is not None
        points = _count_points(pads, now.polygons)
        lon, lat, depth = np.empty(points), np.empty(points), np.zeros(0)
        while asked := landing.advance(now, forcing, self.bed, h, depth, c.latlon, c.earth_radius, lon, lat):
            if bends:
                self._bend(model, now, flexure)
            depth = self.depth(lon[:asked], lat[:asked])
        if bends:
            self._bend(model, now, flexure)
        status = now.flag[:, landing.STATUS]
        if (status == landing.TOO_SHORT).any():
            raise RunError(
                f"a berg that runs aground at {model.date:%Y-%m-%d %H:%M} needs sub-steps of less than {landing.LEAST_STEP:g} s"
            )
        self._check_settled(model, now)
        return flexure

    def _check_settled(self, model: RunState, now: landing.Landing) -> None:
        """Refuse a rise that was not found."""
        if (now.flag[:, landing.STATUS] == landing.UNSETTLED).any():
            raise RunError(f"the heave of a berg aground did not settle at {model.date:%Y-%m-%d %H:%M}")

    def _bend(self, model: RunState, now: landing.Landing, flexure: Floats) -> None:
        """Raise the bending stress of bonds by that of the sub-steps that were just accepted."""
        pads, bonds = now.pads, model.bonds
        for a in np.flatnonzero(now.flag[:, landing.ACCEPTED]).tolist():
            rows = pads.rows[pads.row_start[a] : pads.row_start[a + 1]]
            place = np.full(model.elements.size, -1)
            place[rows] = np.arange(rows.size)
            intact = np.flatnonzero((bonds.status == 0) & (place[bonds.first] >= 0))
            first, second = place[bonds.first[intact]], place[bonds.second[intact]]
            some = slice(now.polygon_start[a], now.polygon_start[a + 1])
            owner, bent = pads.owner[now.polygons[some]] - pads.row_start[a], now.bent[some]
            xy = pads.element[pads.row_start[a] : pads.row_start[a + 1]] + pads.frame[a, :2]
            length, thickness = now.number[a, landing.LENGTH], now.number[a, landing.THICKNESS]
            for cut, stress in bent_bonds(owner, bent, length, thickness, xy, first, second):
                flexure[intact[cut]] = np.maximum(flexure[intact[cut]], stress)

    def _lift_off(self, model: RunState) -> None:
        """Nothing is on the floor; what it has yielded stays."""
        keel = model.elements.keel
        if keel.floor_load.any() or keel.anchor_capacity.any():
            for array in keel:
                if array is not keel.floor_yield:
                    array[:] = 0.0

    def _finish(self, model: RunState, now: landing.Landing, which: Ints, h: float) -> SubcycledMotion | None:
        """Write what the floor does at the end to the keels; return the motion of those that touched it as a phase of contact."""
        pads, keel, number = now.pads, model.elements.keel, now.number
        self._lift_off(model)
        self.clearance[0] = min(self.clearance[0], max(number[:, landing.CLEARANCE].min(), 0.0))
        done = now.flag[:, landing.STATUS] == landing.DONE
        if not done.any():
            return None
        of = np.repeat(np.arange(which.size), np.diff(pads.row_start))
        self._write(model, now, done)
        mine = done[of]
        rows, loaded, anchors = pads.rows[mine], now.found[mine, LOAD] > 0.0, now.anchors[mine]
        for n, array in enumerate(
            (keel.anchor_x, keel.anchor_y, keel.anchor_capacity, keel.floor_x, keel.floor_y, keel.floor_torque)
        ):  # fmt: skip
            array[rows] = np.where(loaded, anchors[:, n], 0.0)
        keel.floor_substep[rows] = number[of[mine], landing.SUBSTEP]
        self.rubbed += number[done, landing.RUBBED].sum()
        bonded = done & (np.diff(pads.row_start) > 1)
        peak_rows = bonded[of]
        peak = PeakContactLoad(
            pads.rows[peak_rows], now.peak[peak_rows, :3].copy(), now.peak[peak_rows, 3:].copy(), which[bonded],
            number[bonded, landing.PEAK_SPIN],
        )  # fmt: skip
        return SubcycledMotion(
            which[done], rows, now.motion[done, landing.PATH] / h, now.motion[done, landing.VELOCITY],
            np.zeros((np.count_nonzero(done), 3)), now.applied[mine], *NO_PAIRS,
            # Loads of the floor grow over minutes: cracks are not located as finely as the sub-steps that arrest a berg.
            max(number[done, landing.SHORTEST].min(), landing.TOUCH_STEP), peak,
        )  # fmt: skip

    def _write(self, model: RunState, now: landing.Landing, done: NDArray[np.bool_]) -> None:
        """Write what the press has found to the keels of the fragments that are ``done``."""
        keel, pads = model.elements.keel, now.pads
        mine = np.repeat(done, np.diff(pads.row_start))
        rows, found = pads.rows[mine], now.found[mine]
        for array, column in (
            (keel.floor_load, LOAD), (keel.floor_hold, HOLD), (keel.floor_lift, LIFT), (keel.floor_stress, STRESS),
        ):  # fmt: skip
            array[rows] = found[:, column]
        keel.floor_yield[rows] = np.maximum(now.yielded[mine], found[:, YIELD])

    def check_start(self, model: RunState, bodies: Bodies) -> None:
        """Find what the floor carries at the start, or refuse keels that start deep below it.

        Of all fragments in the first step, of those that have come since the last one later.
        """
        el, c, new = model.elements, model.constants, None
        if model.step_number > 0:
            if self.familiar is None or np.array_equal(self.familiar, el.body.id):
                return
            new = ~np.isin(el.body.id, self.familiar)
            if not new.any():
                return
            model.forcing.sample(el, model.time)  # the depth under them, by which the near ones are found
        near = self.near(model, bodies, 0.0)
        if new is not None:
            near[bodies.body[~new]] = False
        prepared = self._landing(model, bodies, near, model.time, 0.0, 1.0) if near.any() else None
        if prepared is None:
            return
        now = prepared[0]
        points = _count_points(now.pads, now.polygons)
        lon, lat = np.empty(points), np.empty(points)
        landing.press_all(now, self.bed, c.latlon, c.earth_radius, np.zeros(0), lon, lat)
        landing.press_all(now, self.bed, c.latlon, c.earth_radius, self.depth(lon, lat), lon, lat)
        self._check_settled(model, now)
        if model.parameters.grounding.start == "refuse":
            self._refuse_deep_keels(model, now)
        done = now.flag[:, landing.STATUS] == landing.DONE
        self._write(model, now, done)
        rows = now.pads.rows[np.repeat(done, np.diff(now.pads.row_start))]
        el.keel.anchor_capacity[rows] = el.keel.floor_hold[rows]
        self.clearance[0] = min(self.clearance[0], max(now.number[done, landing.CLEARANCE].min(initial=np.inf), 0.0))

    def _refuse_deep_keels(self, model: RunState, now: landing.Landing) -> None:
        """Refuse keels that start deep below the floor, but for pieces off a berg aground, which lay there before."""
        el, pads, deepest = model.elements, now.pads, -now.number[:, landing.CLEARANCE]
        for a in np.flatnonzero(deepest > DEEP_KEEL).tolist():
            found = slice(pads.row_start[a], pads.row_start[a + 1])
            if (el.life.fl_k[pads.rows[found]] < 0.0).all():
                continue
            e = int(pads.rows[found][now.found[found, LIFT].argmax()])
            raise InputError(
                f"the keel of element {el.body.id[e]} at ({el.lon[e]:.6g}, {el.lat[e]:.6g}) starts {deepest[a]:.3g} m below the "
                "sea floor", where="Model", remedy="Place the berg in deeper water, or set grounding.start to aground",
            )  # fmt: skip

    def held_in_contact(self, model: RunState, op: BodyOperators, twist: Floats, slides: Ints) -> BodyOperators:
        """Return the operators for sub-steps of contact, in which the bed brakes all fragments on it but ``slides``.

        Its drag is linear and gives what friction can bear at the speed now, or at 1 mm/s: a fragment at rest is held.
        """
        el = model.elements
        capacity = np.where(np.isin(op.body, slides), 0.0, el.keel.anchor_capacity)
        if not capacity.any():
            return op
        u, v = (np.einsum("ek,ek->e", op.levers[:, k : k + 3], twist[op.body]) for k in (0, 3))
        speed, drag = np.maximum(np.hypot(u, v), landing.SLOW), np.zeros_like(op.matrices.floor_drag)
        forcing = op.forcing._replace(floor_rate=op.forcing.floor_rate + capacity / (el.mass * speed))
        add_inertia_and_floor_drag(op.body, op.levers, forcing, np.zeros_like(drag), drag)
        return op._replace(forcing=forcing, matrices=op.matrices._replace(floor_drag=drag))


@kernel
def _count_points(pads: Pads, polygons: Ints) -> int:
    """How many points the press needs the depth of: the corners of polygons and their middles."""
    count = polygons.size
    for k in polygons:
        count += pads.start[k + 1] - pads.start[k]
    return count


def bent_bonds(
    owner: Ints, bent: Floats, length: float, thickness: float, xy: Floats, first: Ints, second: Ints
) -> list[tuple[NDArray[np.bool_], float]]:
    """Return which intact bonds of a fragment the bending stress of each group of loaded elements acts on, and that stress (Pa).

    At an edge or a corner those between the ice that breaks off, up to ``pi lambda / 4`` from the loads where the moment is
    largest, and the rest; inside those that cross the line of the loads, and ``lambda`` beyond its ends. ``owner``: element of
    each polygon, ``bent``: what `press` finds for it; ``xy``: places of the elements, m.
    """
    loaded = np.zeros(len(xy), np.bool_)
    loaded[owner[bent[:, 0] > 0.0]] = True
    joined_up = (~(loaded[first] & loaded[second])).astype(np.int64)
    group = np.where(loaded, connected_parts(len(xy), first, second, joined_up), -1)
    found, reach = [], math.sqrt(2.0) * length
    for g in np.unique(group[loaded]).tolist() if length > 0.0 else []:
        mine = bent[(group[owner] == g) & (bent[:, 0] > 0.0)]
        _, bending, share, *_ = mine[mine[:, 1].argmax()].tolist()
        stress, places = bending_stress(length, share, thickness, bending), shapely.multipoints(mine[:, 3:])
        if share < INSIDE:
            # Elements are the smallest piece, so a loaded one breaks off whole.
            piece = (group == g) | (shapely.distance(places, shapely.points(xy)) < 0.25 * math.pi * reach)
            found.append((piece[first] != piece[second], stress))
            continue
        middle = np.average(mine[:, 3:], axis=0, weights=mine[:, 0])
        away = mine[:, 3:] - middle
        axis = np.linalg.eigh((away * mine[:, :1]).T @ away)[1][:, 1]
        side, ends = (xy - middle) @ np.array([-axis[1], axis[0]]) > 0.0, away @ axis
        along = (0.5 * (xy[first] + xy[second]) - middle) @ axis
        near = (along > ends.min() - reach) & (along < ends.max() + reach)
        found.append(((side[first] != side[second]) & near, stress))
    return found


def bodies_under_impact(contact: SubcycledMotion, op: BodyOperators) -> Ints:
    """Bodies that contact gives a change of velocity of more than `STRUCK`."""
    impulse, mass = np.hypot(*contact.impulse[:, :2].T), op.matrices.inertia[contact.bodies, 0, 0]
    return np.asarray(contact.bodies[impulse > STRUCK * mass])


def joined(contact: SubcycledMotion | None, ground: SubcycledMotion | None, body: Ints) -> SubcycledMotion | None:
    """Return both as one, of different fragments; ``body``: fragment of each element."""
    if contact is None or ground is None:
        return ground if contact is None else contact
    some = ground.peak_load
    # An impact loads a fragment more than the floor that it makes it press on.
    alone, rows = (~np.isin(which, contact.peak_load.bodies) for which in (some.bodies, body[some.rows]))
    kept = PeakContactLoad(some.rows[rows], some.force[rows], some.axes[rows], some.bodies[alone], some.spin[alone])
    peak = PeakContactLoad(*(np.concatenate([a, b]) for a, b in zip(contact.peak_load, kept, strict=True)))

    def both(name: str) -> Any:
        return np.concatenate([getattr(contact, name), getattr(ground, name)])

    return SubcycledMotion(
        both("bodies"), both("rows"), both("mean"), both("twist"), both("impulse"), both("applied"),
        contact.first, contact.second, min(contact.shortest_substep, ground.shortest_substep), peak,
    )  # fmt: skip


def without(contact: SubcycledMotion, bodies: Ints, body: Ints) -> SubcycledMotion:
    """Return what contact did to the others: fragments on the bed go as its sub-steps say, in which contact acts, too."""
    stay, rows = ~np.isin(contact.bodies, bodies), ~np.isin(body[contact.rows], bodies)
    return contact._replace(
        bodies=contact.bodies[stay], rows=contact.rows[rows], mean=contact.mean[stay], twist=contact.twist[stay],
        impulse=contact.impulse[stay], applied=contact.applied[rows],
    )  # fmt: skip
