"""The bed of sediment under a run: it finds the fragments that come near it, and takes those that touch it through the step."""

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
from riftberg.engines.quasi_static.bodies.linear_pack import linear_pack
from riftberg.engines.quasi_static.bodies.pose import Bodies, tangent_coordinates
from riftberg.engines.quasi_static.contact.anchors import allocate_anchors
from riftberg.engines.quasi_static.contact.islands import PeakContactLoad, SubcycledMotion
from riftberg.engines.quasi_static.ground import landing
from riftberg.engines.quasi_static.ground.pads import (
    choose_pad_sides,
    cut_into_pads,
    melt_pads,
)
from riftberg.engines.quasi_static.ground.press import LIFT
from riftberg.engines.quasi_static.ground.shoal import Keels, Shoal, find_near
from riftberg.engines.quasi_static.ground.soundings import DepthSampler, Soundings
from riftberg.engines.quasi_static.keel_friction import read_anchor
from riftberg.engines.quasi_static.lattice.dense import multiply
from riftberg.engines.quasi_static.lattice.footprints import FootprintBook, body_footprint
from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing
from riftberg.physics.elementary import atan2, cos, sin
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


def make_depth_sampler(forcing: Forcing, middle: float = 0.0, period: float = 0.0) -> DepthSampler:
    """Return the depth of the bed (m) at points: land of no known depth is dry, and the sea beyond all data is deep.

    ``period``: of a plane that repeats eastward (m), which is asked within half of it from ``middle``.
    """

    def depth(lon: Floats, lat: Floats) -> Floats:
        if period > 0.0:
            lon = lon - period * np.round((lon - middle) / period)
        depths = np.asarray(forcing.depth(lon, lat), float)
        missing = ~np.isfinite(depths)
        if missing.any():
            dry = forcing.land(lon[missing], lat[missing])
            # Beyond the data it is as deep as at its edge: a plane through a step of kilometres would overshoot into the keel.
            beyond = OPEN_DEPTH if missing.all() else float(np.max(depths[~missing]))
            depths = depths.copy()
            depths[missing] = np.where(dry, 0.0, beyond)
        return depths

    return depth


class Seabed:
    """The bed under a run, with its memory from one step to the next beside the state."""

    def __init__(self, model: RunState, footprints: FootprintBook) -> None:
        p, lon = model.parameters, model.elements.lon
        grounding: Any = p.grounding  # that of the engine which has a bed
        self.bed = make_bed(grounding)
        self.depth = make_depth_sampler(
            model.forcing, float(lon[0]) if lon.size else 0.0, 0.0 if p.earth.latlon else p.earth.period
        )
        self.soundings = Soundings(self.depth, p.earth.latlon, model.constants.earth_radius)
        self.familiar: Ints | None = None  # Identifiers of the elements that were there in the last step; None at first
        # Work of friction since the start, J; least clearance of a keel, m.
        self.rubbed, self.clearance = np.zeros(1), np.full(1, np.inf)
        self._footprints, self._divided = footprints, footprints.divided
        self._shoals: list[Shoal] = []  # Of the last groups of fragments that went through a step, the latest first

    def checkpoint(self) -> tuple[Floats, Floats]:
        """Return the values that a step changes."""
        return self.rubbed.copy(), self.clearance.copy()

    def rollback(self, saved: tuple[Floats, Floats]) -> None:
        """Return to the values of `checkpoint`."""
        self.rubbed, self.clearance = (array.copy() for array in saved)

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        # The run that goes on looks at the floor anew, as a resumed one does: the least clearance hangs on what is asked for.
        self._shoals = []
        # Files hold finite numbers: a large one stands for no keel near the floor yet.
        return {"bed_plastic": self.rubbed, "bed_clearance": np.minimum(self.clearance, 0.5 * LARGEST)}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`."""
        if "bed_plastic" in saved:
            self.rubbed = np.array(saved["bed_plastic"], np.float64)[:1]  # earlier versions had gouges behind it
        if "bed_clearance" in saved:
            clearance = np.array(saved["bed_clearance"], np.float64)
            self.clearance = np.where(clearance < 0.5 * LARGEST, clearance, np.inf)

    def find_near_floor(self, model: RunState, bodies: Bodies, h: float) -> NDArray[np.bool_]:
        """Which fragments may come near the floor in ``h`` s."""
        return self._find_near(model, bodies, h, np.ones(len(bodies.pose)))[1].near_floor.copy()

    def _find_near(self, model: RunState, bodies: Bodies, h: float, further: Floats) -> tuple[bool, Shoal]:
        """Return whether fragments may come near the floor in ``h`` s, and the survey that says which.

        ``further``: factors of the ways for which the floor is watched.
        """
        el, c = model.elements, model.constants
        if self._divided != self._footprints.divided:  # the same elements have other pads
            self._divided = self._footprints.divided
            self._shoals = []
        shoal = self._shoal(model, bodies)
        survey, near_floor, left = shoal.survey, shoal.near_floor, shoal.left
        least, some_near, some_left = find_near(
            bodies, el.body, el.environment, el.keel.floor_load, survey, c.rho_ice, h, further,
            c.earth_radius if c.latlon else 1.0, near_floor, left, shoal.reach, shoal.draft,
        )  # fmt: skip
        if some_left:
            for b in np.flatnonzero(left).tolist():
                shoal.survey_around(b, bodies.pose[b], float(shoal.reach[b]), float(shoal.draft[b]), self.soundings)
                near_floor[b] = survey.shallow[b]
            some_near = bool(near_floor.any())
        if not some_near:  # else it is looked at more closely
            self.clearance[0] = min(self.clearance[0], least)
        return some_near, shoal

    def _shoal(self, model: RunState, bodies: Bodies) -> Shoal:
        """Return the survey and the pads of these fragments from the last steps, or begin new ones."""
        el, c = model.elements, model.constants
        arrays = (bodies.body, bodies.reference, el.body.id)
        for shoal in self._shoals:  # nearly always: nothing has changed
            if all(map(operator.is_, arrays, shoal.arrays)):
                return shoal
        key = [array.tobytes() for array in arrays]
        previous_shoal = next((shoal for shoal in self._shoals if shoal.key == key), None)
        shoal = previous_shoal or Shoal(bodies, el.body, c.latlon, c.earth_radius)
        shoal.arrays, shoal.key = arrays, key
        self._shoals = [shoal, *(other for other in self._shoals if other is not shoal)][:3]
        return shoal

    def _keels(self, model: RunState, bodies: Bodies, near_floor: NDArray[np.bool_], shoal: Shoal) -> Keels:
        """Return the pads of the fragments that are near."""
        el, c, keels, ice = model.elements, model.constants, shoal.keels, model.elements.body.thickness.tobytes()
        numbers = np.flatnonzero(near_floor)
        if keels is not None:
            fits = not (near_floor & ~keels.cut).any()
            if fits and ice == shoal.ice:
                return keels
            # Those that came near before may do so again.
            if fits or keels.bodies.size < 2 * numbers.size:
                numbers = np.union1d(numbers, keels.bodies)
        count = np.bincount(bodies.body, minlength=near_floor.size)[numbers]
        thickness = np.bincount(bodies.body, el.body.thickness, near_floor.size)[numbers] / count
        side = choose_pad_sides(self.bed.modulus or UNBENT_MODULUS, POISSON, thickness)
        shoal.ice = ice
        if keels is not None and np.array_equal(numbers, keels.bodies) and np.array_equal(side, keels.pads.side):
            return keels
        index = np.full(near_floor.size, -1)
        index[numbers] = np.arange(numbers.size)
        rows = np.flatnonzero(index[bodies.body] >= 0)
        rows = rows[np.argsort(index[bodies.body[rows]], kind="stable")]
        xy, body = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius), index[bodies.body[rows]]
        prints = self._footprints.follow(model)
        footprint = body_footprint(prints, el, rows, xy, body, shrinks=False)
        size = prints.size[find_rows(prints.element, el.body.id[rows])[0]]
        pads = cut_into_pads(footprint, body, xy[rows], side)
        shoal.keels = Keels(numbers, pads, size, shoal.survey, bodies.pose[numbers])
        return shoal.keels

    def _landing(
        self, model: RunState, bodies: Bodies, time: float, h: float, further: Floats
    ) -> landing.Landing | None:
        """Prepare the fragments that may touch the floor for a step; None where there are none.

        ``further``: factors of the ways for which the floor is watched.
        """
        el, c, forcing = model.elements, model.constants, model.forcing
        some_near, shoal = self._find_near(model, bodies, h, further)
        if not some_near:
            return None
        near_floor, reach = shoal.near_floor, shoal.reach
        keels, body, step = self._keels(model, bodies, near_floor, shoal), el.body, self._step(model, h)
        rows, f, (lon, lat) = keels.pads.rows, keels.landing, np.empty((2, keels.bodies.size))
        pads = melt_pads(keels.pads, np.sqrt(body.length[rows] * body.width[rows] / keels.size))
        if pads is not keels.pads:
            f = f._replace(pads=pads)
        landing.begin_step(
            f, bodies, body, el.environment.depth, el.keel, c.rho_ice, step, shoal.survey.radius, reach, near_floor, lon, lat
        )  # fmt: skip
        for n in range(3):
            f.level[:, n] = forcing.sea_level(lon, lat, time + 0.5 * n * h)
        f.level.min(axis=1, out=f.lowest)
        if keels.find_candidates(f, shoal, self.depth, c):
            return f
        self.clearance[0] = min(self.clearance[0], max(f.clearance.min(), 0.0))
        return None

    def _step(self, model: RunState, h: float) -> landing.Step:
        """Return a step of ``h`` s over this bed."""
        return landing.Step(h, self.bed, model.constants.latlon, model.constants.earth_radius)

    def resolve(
        self, model: RunState, bodies: Bodies, op: BodyOperators, time: float, h: float, contact: SubcycledMotion | None
    ) -> tuple[SubcycledMotion | None, float]:
        """Take the fragments that touch the floor within ``h`` s through sub-steps; None where none does.

        Those in ``contact`` go as it says. The second value: by how much the hold of the floor changes on one that contact has
        taken over it, as a multiple of what it may change in a step. Writes its loads to the keels at the end, and the largest
        bending stress that each bond has borne.
        """
        further, by_the_floor = np.ones(len(bodies.pose)), NO_PAIRS[0]
        model.bonds.flexural_stress[:] = 0.0
        while (f := self._landing(model, bodies, time, h, further)) is not None:
            flexure = self._run(model, linear_pack(op, bodies.twist), h, contact, by_the_floor, f)
            beyond, changed = (f.status == landing.BEYOND).any(), f.hold_change > 1.0
            if not beyond and changed.any() and h <= landing.SHORTEST_PUSHED_STEP * (1.0 + 1e-9):
                # The floor changes faster than others push: those go as it says, pushed by the mean force.
                by_the_floor = np.union1d(by_the_floor, f.bodies[changed])
                continue
            if not beyond:
                model.bonds.flexural_stress[:] = flexure
                largest = 0.0 if contact is None else landing.find_largest_change(f, contact.bodies, contact.twist)
                return self._finish(model, f, h), largest
            further[f.bodies[f.status == landing.BEYOND]] *= 8.0  # a light berg may be taken up by the water
            if further.max() > FARTHEST:
                raise RunError(
                    "the sea floor throws a berg over more than a hundred kilometres in a step: its keel stands far inside the "
                    "floor. Compare thickness and depth, or take a shorter stepping.time_step"
                )
        landing.lift_off(model.elements.keel)
        return None, 0.0

    def _run(
        self, model: RunState, op: BodyOperators, h: float, contact: SubcycledMotion | None, by_the_floor: Ints,
        f: landing.Landing,
    ) -> Floats:  # fmt: skip
        """Take fragments through a step; returns the bending stress of bonds, if it may break any (Pa).

        ``by_the_floor``: those in contact that do not go as that says.
        """
        flexure, bends = np.zeros(model.bonds.first.size), self._breaks_in_bending(model)
        landing.set_masses(f, op.matrices)
        if contact is not None and landing.carry(f, contact, by_the_floor, op.body, h):
            return flexure  # others need not go through the step in vain
        step, depth, (lon, lat) = (
            self._step(model, h),
            np.zeros(0),
            np.empty((2, f.asked_start[-1] + f.polygon_start[-1])),
        )
        while requested := landing.advance(f, step, op.forcing, depth, lon, lat):
            if bends:
                self._bend(model, f, flexure)
            depth = self.depth(lon[:requested], lat[:requested])
        if bends:
            self._bend(model, f, flexure)
        if (f.status == landing.TOO_SHORT).any():
            raise RunError(
                f"a berg that runs aground at {model.date:%Y-%m-%d %H:%M} needs sub-steps of less than {landing.LEAST_STEP:g} s"
            )
        self._check_settled(model, f)
        return flexure

    @staticmethod
    def _breaks_in_bending(model: RunState) -> bool:
        """Whether bending breaks the ice."""
        return model.parameters.fracture.flexural_strength is not None

    def _check_settled(self, model: RunState, fragments: landing.Landing) -> None:
        """Refuse a rise that was not found."""
        if (fragments.status == landing.UNSETTLED).any():
            raise RunError(f"the heave of a berg aground did not settle at {model.date:%Y-%m-%d %H:%M}")

    def _bend(self, model: RunState, fragments: landing.Landing, flexure: Floats) -> None:
        """Raise the bending stress of bonds to its value in the sub-steps that were just accepted."""
        pads, bonds = fragments.pads, model.bonds
        for a in np.flatnonzero(fragments.accepted).tolist():
            rows = pads.rows[pads.row_start[a] : pads.row_start[a + 1]]
            index = np.full(model.elements.size, -1)
            index[rows] = np.arange(rows.size)
            intact = np.flatnonzero((bonds.status == 0) & (index[bonds.first] >= 0))
            first, second = index[bonds.first[intact]], index[bonds.second[intact]]
            own_polygons = slice(fragments.polygon_start[a], fragments.polygon_start[a + 1])
            owner, bent = pads.owner[fragments.polygons[own_polygons]] - pads.row_start[a], fragments.bent[own_polygons]
            xy = pads.element[pads.row_start[a] : pads.row_start[a + 1]] + pads.origin[a]
            cracks = bent_bonds(owner, bent, fragments.length[a], fragments.thickness[a], xy, first, second)
            for cut, stress in cracks:
                flexure[intact[cut]] = np.maximum(flexure[intact[cut]], stress)

    def _finish(self, model: RunState, f: landing.Landing, h: float) -> SubcycledMotion | None:
        """Write the final loads to the keels; return the motion of the fragments that touched it, as contact."""
        landing.lift_off(model.elements.keel)
        self.clearance[0] = min(self.clearance[0], max(f.clearance.min(), 0.0))
        landed, elements, struck, struck_elements = landing.list_landed(f, h, self._breaks_in_bending(model))
        if not landed.size:
            return None
        landing.write_keels(f, model.elements.keel)
        rubbed = f.rubbed[landed]
        self.rubbed += rubbed.sum()
        peak = PeakContactLoad(
            f.pads.rows[struck_elements], f.peak_force[struck_elements], f.peak_axes[struck_elements], f.bodies[struck],
            f.peak_spin[struck], f.peak_time[struck],
        )  # fmt: skip
        return SubcycledMotion(
            f.bodies[landed], f.pads.rows[elements], f.path[landed] / h, f.velocity[landed], np.zeros((landed.size, 3)),
            allocate_anchors(elements.size), rubbed, f.applied[elements], *NO_PAIRS,
            # Loads of the floor grow over minutes: cracks are not located as finely as the sub-steps that arrest a berg.
            max(f.shortest[landed].min(), landing.TOUCH_STEP), peak,
        )  # fmt: skip

    def check_start(self, model: RunState, bodies: Bodies) -> None:
        """Find the loads on the floor at the start, or refuse keels that start deep below it.

        Of all fragments in the first step, of those that have come since the last one later.
        """
        el, new = model.elements, None
        if model.step_number > 0:
            if self.familiar is None or np.array_equal(self.familiar, el.body.id):
                return
            new = ~np.isin(el.body.id, self.familiar)
            if not new.any():
                return
            model.forcing.sample(el, model.time)  # the depth under them, by which the near ones are found
        f = self._landing(model, bodies, model.time, 0.0, np.ones(len(bodies.pose)))
        if f is None:
            return
        if new is not None:  # others have been there
            f.status[np.isin(f.bodies, bodies.body[~new])] = landing.AFLOAT
        self._press(model, f)
        if model.parameters.grounding.start == "refuse":
            self._refuse_deep_keels(model, f)
        landing.write_keels(f, el.keel)
        clearance = f.clearance[f.status == landing.DONE]
        self.clearance[0] = min(self.clearance[0], max(clearance.min(initial=np.inf), 0.0))

    def settle_pieces(self, model: RunState, bodies: Bodies, time: float) -> None:
        """Find the loads of the floor after fragments have parted: each piece floats and bends by itself now."""
        self._footprints.follow(model)  # cracks have divided them
        f = self._landing(model, bodies, time, 0.0, np.ones(len(bodies.pose)))
        landing.lift_off(model.elements.keel)
        if f is not None:
            self._press(model, f)
            landing.write_keels(f, model.elements.keel)

    def _press(self, model: RunState, f: landing.Landing) -> None:
        """Press fragments onto the floor where they stand."""
        step, (lon, lat) = self._step(model, 1.0), np.empty((2, f.asked_start[-1] + f.polygon_start[-1]))
        landing.press_all(f, step, np.zeros(0), lon, lat)
        landing.press_all(f, step, self.depth(lon, lat), lon, lat)
        self._check_settled(model, f)

    def _refuse_deep_keels(self, model: RunState, fragments: landing.Landing) -> None:
        """Refuse keels that start deep below the floor, but for pieces off a berg aground, which lay there before."""
        el, pads, deepest = model.elements, fragments.pads, -fragments.clearance
        for a in np.flatnonzero(deepest > DEEP_KEEL).tolist():
            own_rows = slice(pads.row_start[a], pads.row_start[a + 1])
            if (el.life.fl_k[pads.rows[own_rows]] < 0.0).all():
                continue
            e = int(pads.rows[own_rows][fragments.loads[own_rows, LIFT].argmax()])
            raise InputError(
                f"the keel of element {el.body.id[e]} at ({el.lon[e]:.6g}, {el.lat[e]:.6g}) starts {deepest[a]:.3g} m below the "
                "sea floor", where="Model", remedy="Place the berg in deeper water, or set grounding.start to aground",
            )  # fmt: skip

    def loads(self, keel: Keel, aground: Floats) -> Floats:
        """Return force and torque (N, N, N m) of the floor on the elements, none where it carries none; mark which it does."""
        force = np.empty((keel.floor_x.size, 3))
        return force if _fill_loads(keel, aground, force) else force[:0]

    def anchors(self, keel: Keel) -> Floats:
        """Return the anchors of the elements on the floor, for sub-steps of contact."""
        anchors = allocate_anchors(keel.floor_x.size)
        _fill_anchors(keel, self.bed.anchor_way, anchors)
        return anchors


@kernel
def _fill_loads(keel: Keel, aground: Floats, force: Floats) -> bool:
    """Find the forces of the floor on the elements, and which stand on it; returns whether any does."""
    any_stands = False
    for e in range(aground.size):
        x, y = keel.floor_x[e], keel.floor_y[e]
        force[e, 0], force[e, 1] = x, y
        force[e, 2] = keel.floor_arm_x[e] * y - keel.floor_arm_y[e] * x + keel.anchor_torque[e]
        stands = keel.floor_load[e] > 0.0
        aground[e], any_stands = 1.0 if stands else 0.0, any_stands or stands
    return any_stands


@kernel
def _fill_anchors(keel: Keel, anchor_way: float, anchors: Floats) -> None:
    """Take the anchors of the elements on the floor from their keels."""
    for e in range(keel.floor_x.size):
        if keel.anchor_capacity[e] > 0.0:
            read_anchor(keel, e, anchor_way, anchors[e])


def bent_bonds(
    owner: Ints, bent: Floats, length: float, thickness: float, xy: Floats, first: Ints, second: Ints
) -> list[tuple[NDArray[np.bool_], float]]:
    """Return which intact bonds of a fragment the bending stress of each group of loaded elements acts on, and that stress (Pa).

    At an edge or a corner those between the ice that breaks off, up to ``pi lambda / 4`` from the loads where the moment is
    largest, and the rest; inside those that cross the line of the loads, and ``lambda`` beyond its ends. ``owner``: element of
    each polygon, ``bent``: results of `press` for it; ``xy``: places of the elements, m.
    """
    loaded = np.zeros(len(xy), np.bool_)
    loaded[owner[bent[:, 0] > 0.0]] = True
    joined_up = (~(loaded[first] & loaded[second])).astype(np.int64)
    group = np.where(loaded, connected_parts(len(xy), first, second, joined_up), -1)
    cracks, reach = [], math.sqrt(2.0) * length
    for g in np.unique(group[loaded]).tolist() if length > 0.0 else []:
        mine = bent[(group[owner] == g) & (bent[:, 0] > 0.0)]
        # A load from side to side bends the edges most, but breaks the ice between them, which has more ice around it.
        stresses = [bending_stress(length, share, thickness, bending) for _, bending, share, *_ in mine.tolist()]
        stress, share = max(zip(stresses, mine[:, 2].tolist(), strict=True))
        if share >= INSIDE:
            middle = np.average(mine[:, 3:], axis=0, weights=mine[:, 0])
            offset = mine[:, 3:] - middle
            xx, yy, xy_moment = ((mine[:, 0] * offset.T[i] * offset.T[j]).sum() for i, j in ((0, 0), (1, 1), (0, 1)))
            angle = 0.5 * atan2(2.0 * xy_moment, xx - yy)
            axis, across = np.array([cos(angle), sin(angle)]), np.array([-sin(angle), cos(angle)])
            side, ends = multiply(xy - middle, across) > 0.0, multiply(offset, axis)
            along = multiply(0.5 * (xy[first] + xy[second]) - middle, axis)
            spanned = (along > ends.min() - reach) & (along < ends.max() + reach)
            spanned |= (group[first] == g) | (group[second] == g)  # the shortest crack is one element long
            if (cut := (side[first] != side[second]) & spanned).any():
                cracks.append((cut, stress))
                continue
        # Elements are the smallest piece, so a loaded one breaks off whole.
        load_points = shapely.multipoints(mine[:, 3:])
        piece = (group == g) | (shapely.distance(load_points, shapely.points(xy)) < 0.25 * math.pi * reach)
        cracks.append((piece[first] != piece[second], stress))
    return cracks


def join_drifts(contact: SubcycledMotion | None, ground: SubcycledMotion | None) -> tuple[Ints, Floats]:
    """Return the fragments that go through sub-steps, and their mean twists."""
    motions = [motion for motion in (contact, ground) if motion is not None]
    if not motions:
        return NO_PAIRS[0], np.empty((0, 3))
    return np.concatenate([motion.bodies for motion in motions]), np.concatenate([motion.mean for motion in motions])


def join_motions(contact: SubcycledMotion | None, ground: SubcycledMotion | None, body: Ints) -> SubcycledMotion | None:
    """Return both as one, of different fragments; ``body``: fragment of each element."""
    if contact is None or ground is None:
        return ground if contact is None else contact
    hard = ground.peak_load
    # An impact loads a fragment more than the floor that it makes it press on.
    others = np.ones(int(body.max()) + 1, np.bool_)
    others[contact.peak_load.bodies] = False
    alone, rows = others[hard.bodies], others[body[hard.rows]]
    hard = PeakContactLoad(
        hard.rows[rows], hard.force[rows], hard.axes[rows], hard.bodies[alone], hard.spin[alone], hard.time[alone]
    )
    peak = PeakContactLoad(*(np.concatenate([a, b]) for a, b in zip(contact.peak_load, hard, strict=True)))
    arrays: Any = {
        name: np.concatenate([getattr(contact, name), getattr(ground, name)]) for name in SubcycledMotion._fields[:-2]
    }
    return SubcycledMotion(
        **arrays, shortest_substep=min(contact.shortest_substep, ground.shortest_substep), peak_load=peak
    )


def drop_fragments(contact: SubcycledMotion, bodies: Ints, body: Ints) -> SubcycledMotion:
    """Return the motion in contact of all other fragments: contact acts in the sub-steps of the bed, too."""
    others = np.ones(int(body.max()) + 1, np.bool_)
    others[bodies] = False
    stay, rows = others[contact.bodies], others[body[contact.rows]]
    by_body = {name: getattr(contact, name)[stay] for name in ("bodies", "mean", "twist", "impulse", "rubbed")}
    return contact._replace(
        rows=contact.rows[rows], anchors=contact.anchors[rows], applied=contact.applied[rows], **by_body
    )
