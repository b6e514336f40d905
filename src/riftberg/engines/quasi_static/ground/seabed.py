"""The bed of sediment under a run: which fragments come near it, and what it makes of a step for those that it touches."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.bed import make_bed
from riftberg.engines.common.broad_phase import NO_PAIRS
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import BodyOperators
from riftberg.engines.quasi_static.bodies.pose import Bodies, tangent_coordinates
from riftberg.engines.quasi_static.contact import anchors
from riftberg.engines.quasi_static.contact.islands import PeakContactLoad, SubcycledMotion, forcing_of_rows
from riftberg.engines.quasi_static.ground import landing
from riftberg.engines.quasi_static.ground.pads import (
    ORIGIN_X,
    ORIGIN_Y,
    Pads,
    cut_into_pads,
    melted,
    place_points,
    sides_of_pads,
)
from riftberg.engines.quasi_static.ground.press import LIFT
from riftberg.engines.quasi_static.ground.shoal import Keels, Shoal, choose_squares, find_candidates, find_near
from riftberg.engines.quasi_static.ground.soundings import DepthOf, Soundings
from riftberg.engines.quasi_static.lattice.footprints import FootprintBook, body_footprint
from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing
from riftberg.physics.floating import draft_of
from riftberg.physics.seabed import POISSON, UNBENT_MODULUS, bending_stress
from riftberg.state import Floats, Ints
from riftberg.state.population import find_rows
from riftberg.state.variables import LARGEST, Keel

FARTHEST: Final = 512.0
"""Times the expected way for which the floor is watched before a step is given up."""

OPEN_DEPTH: Final = 1e4
"""Depth (m) beyond all data."""

DEEP_KEEL: Final = 1.0
"""How far below the floor a keel may start, m, where it is not to start aground."""

INSIDE: Final = 0.75
"""Share of ice around a load from which the ice cracks along the line of the load; elsewhere a piece of the edge breaks off."""


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
            dry = forcing.land(lon[lost], lat[lost])
            # Beyond the data it is as deep as at its edge: a plane through a step of kilometres would overshoot into the keel.
            beyond = OPEN_DEPTH if lost.all() else float(np.max(found[~lost]))
            found = found.copy()
            found[lost] = np.where(dry, 0.0, beyond)
        return found

    return depth


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
        grounding: Any = p.grounding  # that of the engine which has a bed
        self.bed = make_bed(grounding)
        self.depth = depth_of_bed(
            model.forcing, float(lon[0]) if lon.size else 0.0, 0.0 if p.earth.latlon else p.earth.period
        )
        self.soundings = Soundings(self.depth, p.earth.latlon, model.constants.earth_radius)
        self.familiar: Ints | None = None  # Identifiers of the elements that were there in the last step; None at first
        # Work of friction since the start, J; least clearance of a keel, m.
        self.rubbed, self.clearance = np.zeros(1), np.full(1, np.inf)
        self._footprints, self._divided = footprints, footprints.divided
        self._looked: tuple[Any, ...] = (None,) * 3
        self._looked_for = (math.nan, math.nan)
        self._found: tuple[NDArray[np.bool_], Floats, Shoal]
        self._shoals: list[Shoal] = []  # Of the last groups of fragments that went through a step, the latest first

    def checkpoint(self) -> tuple[Floats, Floats]:
        """Return what a step changes."""
        return self.rubbed.copy(), self.clearance.copy()

    def rollback(self, before: tuple[Floats, Floats]) -> None:
        """Return to what `checkpoint` gave."""
        self.rubbed, self.clearance = (array.copy() for array in before)
        self._looked_for = (math.nan, math.nan)

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        # The run that goes on looks at the floor anew, as a resumed one does: the least clearance hangs on what is asked for.
        self._shoals, self._looked_for = [], (math.nan, math.nan)
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
        return self._find_near(model, bodies, h, 1.0)[0]

    def _find_near(
        self, model: RunState, bodies: Bodies, h: float, further: float
    ) -> tuple[NDArray[np.bool_], Floats, Shoal]:
        """Return which fragments may come near the floor in ``h`` s, their ways (m), and what is known of them.

        ``further``: factor of the way for which the floor is watched.
        """
        el, c, looked = model.elements, model.constants, (bodies.pose, bodies.twist, model.elements.keel)
        if self._divided != self._footprints.divided:  # the same elements have other pads
            self._divided = self._footprints.divided
            self._shoals, self._looked_for = [], (math.nan, math.nan)
        # The stepper asks before it parts the bergs, then the trial step.
        if (h, further) == self._looked_for and all(map(operator.is_, looked, self._looked)):
            return self._found
        shoal = self._shoal(model, bodies)
        survey, count, scale = shoal.survey, bodies.pose.shape[0], c.earth_radius if c.latlon else 1.0
        near, left, (reach, draft) = np.zeros(count, np.bool_), np.zeros(count, np.bool_), np.empty((2, count))
        least = find_near(
            bodies, el.body, el.environment, el.keel.floor_load, survey, c.rho_ice, h, further, scale, near, left, reach, draft
        )  # fmt: skip
        for b in np.flatnonzero(left).tolist():
            shoal.survey_around(b, bodies.pose[b], float(reach[b]), float(draft[b]), self.soundings)
            near[b] = survey.shallow[b]
        if not near.any():  # else it is looked at more closely
            self.clearance[0] = min(self.clearance[0], least)
        self._looked, self._looked_for, self._found = looked, (h, further), (near, reach, shoal)
        return self._found

    def _shoal(self, model: RunState, bodies: Bodies) -> Shoal:
        """Return what is known of these fragments since they last went through a step."""
        el, c = model.elements, model.constants
        arrays = (bodies.body, bodies.reference, el.body.id)
        for shoal in self._shoals:  # nearly always: nothing has changed
            if all(map(operator.is_, arrays, shoal.arrays)):
                return shoal
        key = [array.tobytes() for array in arrays]
        known = next((shoal for shoal in self._shoals if shoal.key == key), None)
        shoal = known or Shoal(bodies, el.body, c.latlon, c.earth_radius)
        shoal.arrays, shoal.key = arrays, key
        self._shoals = [shoal, *(one for one in self._shoals if one is not shoal)][:3]
        return shoal

    def _keels(self, model: RunState, bodies: Bodies, near: NDArray[np.bool_], shoal: Shoal) -> Keels:
        """Return the pads of the fragments that are near."""
        el, c, keels, ice = model.elements, model.constants, shoal.keels, model.elements.body.thickness.tobytes()
        numbers = np.flatnonzero(near)
        if keels is not None:
            fits = not (near & ~keels.cut).any()
            if fits and ice == shoal.ice:
                return keels
            # Those that came near before may do so again.
            if fits or keels.bodies.size < 2 * numbers.size:
                numbers = np.union1d(numbers, keels.bodies)
        count = np.bincount(bodies.body, minlength=near.size)[numbers]
        thickness = np.bincount(bodies.body, el.body.thickness, near.size)[numbers] / count
        side = sides_of_pads(self.bed.modulus or UNBENT_MODULUS, POISSON, thickness)
        shoal.ice = ice
        if keels is not None and np.array_equal(numbers, keels.bodies) and np.array_equal(side, keels.side):
            return keels
        place = np.full(near.size, -1)
        place[numbers] = np.arange(numbers.size)
        rows = np.flatnonzero(place[bodies.body] >= 0)
        rows = rows[np.argsort(place[bodies.body[rows]], kind="stable")]
        xy, body = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius), place[bodies.body[rows]]
        prints = self._footprints.follow(model)
        footprint = body_footprint(prints, el, rows, xy, body, shrinks=False)
        size = prints.size[find_rows(prints.element, el.body.id[rows])[0]]
        pads = cut_into_pads(footprint, body, numbers.size, xy[rows], side)
        shoal.keels = Keels(numbers, side, pads, size, shoal.survey, bodies.pose[numbers])
        return shoal.keels

    def _landing(
        self, model: RunState, bodies: Bodies, time: float, h: float, further: float
    ) -> tuple[landing.Landing, Ints] | None:
        """Prepare the fragments that may touch the floor for a step; None where there are none.

        ``further``: factor of the way for which the floor is watched.
        """
        el, c, forcing = model.elements, model.constants, model.forcing
        near, reach, shoal = self._find_near(model, bodies, h, further)
        if not near.any():
            return None
        keels = self._keels(model, bodies, near, shoal)
        numbers, rows, count = keels.bodies, keels.whole.rows, keels.bodies.size
        pose, thickness, reach = bodies.pose[numbers], el.body.thickness[rows], np.where(near, reach, -1.0)[numbers]
        watch = keels.watch(shoal, pose, c.earth_radius if c.latlon else 1.0)
        pads = melted(keels.whole, np.sqrt(el.body.length[rows] * el.body.width[rows] / keels.size))
        draft, level = draft_of(thickness, c.rho_ice), np.empty((3, count))
        middle = _place_middles(pads.frame, pose, c.latlon, c.earth_radius)
        for n in range(3):
            level[n] = forcing.sea_level(*middle, time + 0.5 * n * h)
        lowest, chosen, (lon, lat) = level.min(axis=0), np.empty_like(watch.square), np.empty((2, watch.square.size))
        found = choose_squares(
            pads, watch, pose, reach, lowest, np.maximum.reduceat(draft, pads.row_start[:-1]), keels.way, c.latlon,
            c.earth_radius, chosen, lon, lat,
        )  # fmt: skip
        polygons, start = np.empty(watch.polygon.size, np.int64), np.zeros(count + 1, np.int64)
        clearance = np.full(count, np.inf)
        if found:
            depth = self.depth(lon[:found], lat[:found])
            find_candidates(pads, watch, chosen[:found], depth, reach, lowest, draft, polygons, start, clearance)
        if not start[-1]:
            self.clearance[0] = min(self.clearance[0], max(clearance.min(initial=np.inf), 0.0))
            return None
        now = landing.prepared(pads, keels.plates, polygons[: start[-1]], start, pose, draft)
        now.number[:, landing.REACH], now.number[:, landing.CLEARANCE] = reach, clearance
        now.number[:, landing.RADIUS], now.number[:, landing.LEVEL :] = shoal.survey.radius[numbers], level.T
        landing.board(now, numbers, bodies, el.keel, thickness, self.bed)
        return now, numbers

    def resolve(
        self, model: RunState, bodies: Bodies, op: BodyOperators, time: float, h: float, contact: SubcycledMotion | None
    ) -> tuple[SubcycledMotion | None, bool]:
        """Take the fragments that touch the floor within ``h`` s through sub-steps; None where none does.

        Those that stood on it before ``contact`` go as it says. The second value: whether the floor holds one of them otherwise
        where contact has taken it, or a fragment in contact has touched it. Writes what the floor does to the keels at the end,
        and the largest bending stress that each bond has borne.
        """
        further, by_the_floor = 1.0, NO_PAIRS[0]
        model.bonds.flexural_stress[:] = 0.0
        while (prepared := self._landing(model, bodies, time, h, further)) is not None:
            flexure = self._run(model, op, h, contact, by_the_floor, *prepared)
            now, numbers = prepared
            beyond = (now.flag[:, landing.STATUS] == landing.BEYOND).any()
            changed = now.flag[:, landing.CHANGED] == 1
            if not beyond and changed.any() and h <= landing.TOUCH_STEP * (1.0 + 1e-9):
                # The floor changes faster than others push: those go as it says, pushed by the mean force.
                by_the_floor = np.union1d(by_the_floor, numbers[changed])
                continue
            if not beyond:
                model.bonds.flexural_stress[:] = flexure
                return self._finish(model, *prepared, h), _is_pushed_elsewhere(contact, *prepared)
            further *= 8.0  # a light berg may be taken up by the water
            if further > FARTHEST:
                raise RunError(
                    "the sea floor throws a berg over more than a hundred kilometres in a step: its keel stands far inside the "
                    "floor. Compare thickness and depth, or take a shorter stepping.time_step"
                )
        landing.lift_off(model.elements.keel)
        return None, False

    def _run(
        self, model: RunState, op: BodyOperators, h: float, contact: SubcycledMotion | None, by_the_floor: Ints,
        now: landing.Landing, numbers: Ints,
    ) -> Floats:  # fmt: skip
        """Take fragments through a step; returns the bending stress of bonds, if it may break any (Pa).

        ``by_the_floor``: those in contact that do not go as that says.
        """
        c, pads = model.constants, now.pads
        landing.set_going(now, numbers, op.matrices)
        if contact is not None:
            _carry(now, numbers, contact, by_the_floor, op.body, h)
        forcing = forcing_of_rows(pads.rows, op.forcing)
        flexure, bends = np.zeros(model.bonds.first.size), model.parameters.fracture.flexural_strength is not None
        points = _count_points(pads, now.polygons)
        (lon, lat), depth = np.empty((2, points)), np.zeros(0)
        while asked := landing.advance(now, forcing, self.bed, h, depth, c.latlon, c.earth_radius, lon, lat):
            if bends:
                self._bend(model, now, flexure)
            depth = self.depth(lon[:asked], lat[:asked])
        if bends:
            self._bend(model, now, flexure)
        if (now.flag[:, landing.STATUS] == landing.TOO_SHORT).any():
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

    def _finish(self, model: RunState, now: landing.Landing, numbers: Ints, h: float) -> SubcycledMotion | None:
        """Write what the floor does at the end to the keels; return the motion of those that touched it as a phase of contact."""
        pads, number = now.pads, now.number
        landing.lift_off(model.elements.keel)
        self.clearance[0] = min(self.clearance[0], max(number[:, landing.CLEARANCE].min(), 0.0))
        done = now.flag[:, landing.STATUS] == landing.DONE
        if not done.any():
            return None
        landing.write_loads(now, model.elements.keel)
        landing.write_friction(now, model.elements.keel)
        self.rubbed += number[done, landing.RUBBED].sum()
        elements = np.diff(pads.row_start)
        # What contact presses has its loads from there, or from the equilibrium at the end.
        bonded = done & (elements > 1) & (now.flag[:, landing.CARRIED] == 0)
        touched, pressed = np.repeat(done, elements), np.repeat(bonded, elements)
        peak = PeakContactLoad(
            pads.rows[pressed], now.peak[pressed, :3].copy(), now.peak[pressed, 3:].copy(), numbers[bonded],
            number[bonded, landing.PEAK_SPIN],
        )  # fmt: skip
        return SubcycledMotion(
            numbers[done], pads.rows[touched], now.motion[done, landing.PATH] / h, now.motion[done, landing.VELOCITY],
            np.zeros((np.count_nonzero(done), 3)), anchors.without_floor(int(touched.sum())),
            number[done, landing.RUBBED], now.applied[touched], *NO_PAIRS,
            # Loads of the floor grow over minutes: cracks are not located as finely as the sub-steps that arrest a berg.
            max(number[done, landing.SHORTEST].min(), landing.TOUCH_STEP), peak,
        )  # fmt: skip

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
        prepared = self._landing(model, bodies, model.time, 0.0, 1.0)
        if prepared is None:
            return
        now, numbers = prepared
        if new is not None:  # others have been there
            old = np.isin(numbers, bodies.body[~new])
            now.flag[old, landing.STATUS] = landing.AFLOAT
        points = _count_points(now.pads, now.polygons)
        lon, lat = np.empty(points), np.empty(points)
        landing.press_all(now, self.bed, c.latlon, c.earth_radius, np.zeros(0), lon, lat)
        landing.press_all(now, self.bed, c.latlon, c.earth_radius, self.depth(lon, lat), lon, lat)
        self._check_settled(model, now)
        if model.parameters.grounding.start == "refuse":
            self._refuse_deep_keels(model, now)
        landing.write_loads(now, el.keel)
        done = now.flag[:, landing.STATUS] == landing.DONE
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

    def anchors(self, keel: Keel) -> Floats:
        """Return what anchors the elements on the floor, for sub-steps of contact."""
        force, found = np.array([keel.anchor_x, keel.anchor_y]), anchors.without_floor(keel.floor_x.size)
        found[:, [anchors.ANCHOR_X, anchors.ANCHOR_Y]] = force.T
        found[:, anchors.STIFFNESS] = keel.anchor_capacity / self.bed.anchor_way
        found[:, anchors.HOLD] = keel.floor_hold
        found[:, anchors.SLOPE_X], found[:, anchors.SLOPE_Y] = keel.floor_x - force[0], keel.floor_y - force[1]
        found[:, anchors.ARM_X], found[:, anchors.ARM_Y] = keel.floor_arm_x, keel.floor_arm_y
        return found


def _carry(
    now: landing.Landing, numbers: Ints, contact: SubcycledMotion, by_the_floor: Ints, body: Ints, h: float
) -> None:
    """Let contact take the fragments on the floor through the step, but push those that come down on it and ``by_the_floor``.

    ``body``: of the elements.
    """
    _, here, there = np.intersect1d(numbers, contact.bodies, return_indices=True)
    for a, c in zip(here.tolist(), there.tolist(), strict=True):
        if not now.flag[a, landing.TOUCHES] or numbers[a] in by_the_floor:
            now.motion[a, landing.PUSH] = contact.impulse[c] / h
            continue
        # The elements of a fragment stand in the order of the state in both.
        rows = np.flatnonzero(body[contact.rows] == numbers[a])
        friction = contact.anchors[rows][:, [anchors.ANCHOR_X, anchors.ANCHOR_Y]]
        landing.carry(
            now, a, h * contact.mean[c], contact.twist[c], friction, contact.applied[rows], float(contact.rubbed[c])
        )  # fmt: skip


def _is_pushed_elsewhere(contact: SubcycledMotion | None, now: landing.Landing, numbers: Ints) -> bool:
    """Whether contact has taken a fragment to where the floor holds it otherwise, or down onto the floor."""
    if contact is None:
        return False
    touched = (now.flag[:, landing.STATUS] == landing.DONE) & (now.flag[:, landing.CARRIED] == 0)
    return bool(now.flag[:, landing.CHANGED].any() or (touched & np.isin(numbers, contact.bodies)).any())


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
        # A load from side to side bends the edges most, but breaks the ice between them, which has more ice around it.
        stresses = [bending_stress(length, share, thickness, bending) for _, bending, share, *_ in mine.tolist()]
        stress, share = max(zip(stresses, mine[:, 2].tolist(), strict=True))
        if share >= INSIDE:
            middle = np.average(mine[:, 3:], axis=0, weights=mine[:, 0])
            away = mine[:, 3:] - middle
            axis = np.linalg.eigh((away * mine[:, :1]).T @ away)[1][:, 1]
            side, ends = (xy - middle) @ np.array([-axis[1], axis[0]]) > 0.0, away @ axis
            along = (0.5 * (xy[first] + xy[second]) - middle) @ axis
            near = (along > ends.min() - reach) & (along < ends.max() + reach)
            near |= (group[first] == g) | (group[second] == g)  # the shortest crack is one element long
            if (cut := (side[first] != side[second]) & near).any():
                found.append((cut, stress))
                continue
        # Elements are the smallest piece, so a loaded one breaks off whole.
        places = shapely.multipoints(mine[:, 3:])
        piece = (group == g) | (shapely.distance(places, shapely.points(xy)) < 0.25 * math.pi * reach)
        found.append((piece[first] != piece[second], stress))
    return found


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
        both("bodies"), both("rows"), both("mean"), both("twist"), both("impulse"), both("anchors"), both("rubbed"),
        both("applied"),
        contact.first, contact.second, min(contact.shortest_substep, ground.shortest_substep), peak,
    )  # fmt: skip


def without(contact: SubcycledMotion, bodies: Ints, body: Ints) -> SubcycledMotion:
    """Return what contact did to the others: fragments on the bed go as its sub-steps say, in which contact acts, too."""
    stay, rows = ~np.isin(contact.bodies, bodies), ~np.isin(body[contact.rows], bodies)
    return contact._replace(
        bodies=contact.bodies[stay], rows=contact.rows[rows], mean=contact.mean[stay], twist=contact.twist[stay],
        impulse=contact.impulse[stay], anchors=contact.anchors[rows], rubbed=contact.rubbed[stay],
        applied=contact.applied[rows],
    )  # fmt: skip
