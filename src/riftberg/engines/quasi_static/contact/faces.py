"""Fragments that crush each other's faces: the pairs kept between steps, and a step of all islands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower
from riftberg.engines.common.broad_phase import NO_PAIRS, SEARCH_MARGIN, candidate_pairs
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.land import NearPairs, movable
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import BodyOperators
from riftberg.engines.quasi_static.bodies.pose import Bodies, fill_levers, tangent_coordinates
from riftberg.engines.quasi_static.contact.crushing_step import integrate_faces
from riftberg.engines.quasi_static.contact.face_forces import CrushingLaw
from riftberg.engines.quasi_static.contact.face_overlaps import find_seams
from riftberg.engines.quasi_static.contact.face_pairs import Faces, Seams, face_gaps
from riftberg.engines.quasi_static.contact.face_states import (
    APART,
    COLUMNS,
    PHASE,
    PUSH_X,
    PUSH_Y,
    SINCE,
    TORQUE_1,
    TORQUE_2,
)
from riftberg.engines.quasi_static.contact.islands import (
    SubcycledMotion,
    allocate_result,
    gather_islands,
    pair_separations,
    subcycled_motion,
)
from riftberg.engines.quasi_static.lattice.footprints import FootprintBook, Footprints, body_footprint
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import near_pairs
from riftberg.state.population import find_rows

DRIVEN: Final = 2e-4
"""Acceleration (m s-2) at which media drive two bergs together at most: twice the Coriolis acceleration at 0.7 m/s."""

GOLDEN_RATIO: Final = 0.5 * (1.0 + math.sqrt(5.0))

LASTING: Final = 600.0
"""Time (s) that contact lasts before the lattices bear it as a load at rest; of shorter contact they bear the largest impact.

A piece that breaks off turns about one element of the rest for some minutes. Its load meanwhile acts on a point,
whose stress goes as one over the size of the elements, and a step of half an hour sees none, a short one all of it.
"""


class FacePairs(NamedTuple):
    """The faces that press each other, as the last sub-step left them."""

    pair: Ints  # Identifiers of both elements; shape (faces, 2)
    polygon: Ints  # Numbers of the first polygons of both that overlap in it; shape (faces, 2)
    state: Floats  # See `riftberg.engines.quasi_static.contact.face_states`; shape (faces, columns)
    dissipated: Floats  # Plastic work and friction since the start of the run, J; shape (1,)


FACE_PAIR_NAMES = tuple(f"meeting_{name}" for name in FacePairs._fields)
"""Names in a restart file."""

NO_FACE_PAIRS = FacePairs(np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64), np.zeros((0, COLUMNS)), np.zeros(1))


class _Polygons(NamedTuple):
    """Footprints of all elements, along the axes of their fragments."""

    begin: Ints  # Where the polygons of each element begin; shape (elements + 1,)
    ring: Ints  # Where the corners of each polygon begin; shape (polygons + 1,)
    corner: Floats  # From the centre of the element, m; shape (corners, 2)
    element: Ints  # Of each corner
    reach: Floats  # Farthest corner of each element, m
    seams: Seams


class FaceContact:
    """Contact by crushing under a run."""

    def __init__(self, model: RunState, footprints: FootprintBook) -> None:
        p = model.parameters.contact
        self._law = CrushingLaw(p.crushing_strength, p.crushing_depth, p.unloading_ratio, p.friction)
        self._footprints = footprints
        self._polygons: _Polygons | None = None
        self._key: tuple[object, ...] = ()
        self._reach: tuple[Footprints | None, Floats] = (None, np.zeros(0))  # of the footprints as they were made, m
        self.pairs = NO_FACE_PAIRS

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        return dict(zip(FACE_PAIR_NAMES, self.pairs, strict=True))

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`."""
        if "meeting_pair" in saved:
            # In former files each pair of elements has one face, which goes on whatever its polygons.
            saved = {"meeting_polygon": np.zeros_like(saved["meeting_pair"]), **saved}
            pair, polygon, state, dissipated = (np.array(saved[name]) for name in FACE_PAIR_NAMES)
            self.pairs = FacePairs(
                pair.astype(np.int64), polygon.astype(np.int64), state.astype(float), dissipated.astype(float)
            )

    def forget_pairs(self) -> None:
        """Forget all pairs: nobody may touch."""
        self.pairs = NO_FACE_PAIRS._replace(dissipated=self.pairs.dissipated)

    def reach(self, model: RunState) -> Floats:
        """Distance (m) of the farthest corner of each element's footprint from its centre."""
        footprints, body = self._footprints.follow(model), model.elements.body
        if footprints is not self._reach[0]:
            polygon_element = np.repeat(footprints.owner, np.diff(footprints.start))
            farthest, offset = np.zeros(footprints.element.size), footprints.corner - footprints.centre[polygon_element]
            np.maximum.at(farthest, polygon_element, np.hypot(offset[:, 0], offset[:, 1]))
            self._reach = footprints, farthest
        rows = find_rows(footprints.element, body.id)[0]
        return np.asarray(self._reach[1][rows] * np.sqrt(body.length * body.width / footprints.size[rows]))

    def force(self, model: RunState) -> Floats:
        """Force and torque (N, N, N m) of lasting contact on the elements after the last sub-step; shape (elements, 3)."""
        force, s = np.zeros((model.elements.size, 3)), self.pairs.state
        lasting = s[:, SINCE] >= LASTING
        if not lasting.any():
            return force
        rows, is_present = find_rows(model.elements.body.id, self.pairs.pair.ravel())
        rows, selected = rows.reshape(-1, 2), is_present.reshape(-1, 2).all(axis=1) & lasting
        for side, sign, torque in ((0, -1.0, TORQUE_1), (1, 1.0, TORQUE_2)):
            push = np.column_stack([sign * s[:, PUSH_X], sign * s[:, PUSH_Y], s[:, torque]])
            np.add.at(force, rows[selected, side], push[selected])
        return force

    def resolve(
        self, model: RunState, bodies: Bodies, op: BodyOperators, h: float, sizes: Sizes, anchors: Floats
    ) -> SubcycledMotion | None:
        """Take the bodies that may touch through ``h`` s of sub-steps, and keep the pairs of faces; None where none touch.

        ``anchors``: of the elements on the sea floor (`riftberg.engines.quasi_static.keel_friction`).
        """
        el, c, previous_pairs = model.elements, model.constants, self.pairs
        self.forget_pairs()
        polygons = self._find_polygons(model, bodies)
        first, second = candidate_pairs(el, bodies.body, sizes._replace(radius=polygons.reach), h, c)
        if first.size == 0:
            return None
        faces = self._orient_polygons(polygons, el, op.levers)
        separation, turn = pair_separations(el.shown.lon_pair, el.shown.lat_pair, first, second, c)
        # As far as both can come in the step by their velocities and their driving forces.
        # The spin of the state may come from a trial step that was rolled back.
        turning = np.einsum("ek,ek->e", op.levers[:, 6:9], bodies.twist[op.body])
        velocity = np.column_stack([el.shown.u_pair, el.shown.v_pair, turning])
        u, v, spin = np.abs(velocity[first] - velocity[second]).T
        approach = h * (np.hypot(u, v) + spin * (polygons.reach[first] + polygons.reach[second]) + 0.5 * DRIVEN * h)
        may_touch = face_gaps(first, second, separation, turn, faces)[:, 0] <= approach
        if not may_touch.any():
            return None
        order = np.flatnonzero(may_touch)[np.argsort(_sweep_position(el, first[may_touch], second[may_touch]))]
        first, second = first[order], second[order]
        lists, island = gather_islands(op, first, second, separation[order], turn[order])
        ids = np.column_stack([el.body.id[first[lists.order]], el.body.id[second[lists.order]]])
        polygon_count, rows = np.diff(polygons.begin), lists.rows
        counts = np.column_stack([polygon_count[first[lists.order]], polygon_count[second[lists.order]]])
        start = np.concatenate([[0], np.cumsum(counts[:, 0] * counts[:, 1])])
        states = _recall_states(previous_pairs, ids, counts, start)
        faces = faces._replace(
            begin=faces.begin[rows], end=faces.end[rows], reach=faces.reach[rows], thickness=faces.thickness[rows],
            seams=faces.seams._replace(begin=faces.seams.begin[rows], end=faces.seams.end[rows]), start=start,
        )  # fmt: skip
        result = allocate_result(island, bodies.twist[lists.members], anchors[rows])
        shortest, dissipated = integrate_faces(lists, island, result, faces, states, h, self._law)
        if not np.isfinite(result.twist).all():
            raise FloatingPointError
        pressed = np.flatnonzero(states[:, PHASE] != APART)
        pair = np.searchsorted(start, pressed, side="right") - 1
        polygon = np.column_stack(np.divmod(pressed - start[pair], counts[pair, 1]))
        self.pairs = FacePairs(ids[pair], polygon, states[pressed], previous_pairs.dissipated + dissipated)
        return subcycled_motion(op, lists, first, second, result, shortest, h)

    def find_near(self, model: RunState, bodies: Bodies, lon: Floats, lat: Floats, within: float) -> NearPairs:
        """Find faces of different bodies that are at most ``within`` m from each other, with elements at ``lon``, ``lat``."""
        el, c, free = model.elements, model.constants, movable(model.elements)
        polygons, levers = self._find_polygons(model, bodies), np.empty((el.size, 11))
        fill_levers(bodies, c.latlon, c.earth_radius, levers)
        first, second = NO_PAIRS
        if c.interactions:
            reach = polygons.reach[free] + 0.5 * within
            first, second = near_pairs(
                lon[free], lat[free], bodies.body[free], SEARCH_MARGIN * reach, c.latlon, c.earth_radius, c.period
            )
        first, second = free[first], free[second]
        separation, turn = pair_separations(lon, lat, first, second, c)
        gaps = face_gaps(first, second, separation, turn, self._orient_polygons(polygons, el, levers))
        selected = gaps[:, 0] <= within
        return NearPairs(first[selected], second[selected], gaps[selected, 0], gaps[selected, 1:])

    @staticmethod
    def _orient_polygons(polygons: _Polygons, el: Elements, levers: Floats) -> Faces:
        """Turn the footprints to where the axes of the bodies stand."""
        corner, seams = np.empty_like(polygons.corner), polygons.seams
        _turn_corners(polygons.corner, polygons.element, levers, corner)
        point = np.empty_like(seams.point)
        _turn_corners(seams.point, np.repeat(np.arange(el.size), 2 * (seams.end - seams.begin)), levers, point)
        return Faces(
            polygons.begin[:-1], polygons.begin[1:], polygons.ring, corner, polygons.reach, el.body.thickness,
            seams._replace(point=point), NO_PAIRS[0],
        )  # fmt: skip

    def _find_polygons(self, model: RunState, bodies: Bodies) -> _Polygons:
        """Footprints about the centres of their elements, rebuilt where elements or fragments have changed."""
        el, c, body = model.elements, model.constants, model.elements.body
        arrays = bodies.body, bodies.reference, body.id, body.length, body.width
        key = (self._footprints.divided, *(a.tobytes() for a in arrays))
        if self._polygons is None or key != self._key:
            self._key = key
            xy = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius)
            footprint = body_footprint(self._footprints.follow(model), el, np.arange(el.size), xy, bodies.body)
            size, order = np.diff(footprint.start), np.argsort(footprint.owner, kind="stable")
            owner, ring = footprint.owner[order], np.concatenate([[0], np.cumsum(size[order])]).astype(np.int64)
            index = np.arange(ring[-1]) - np.repeat(ring[:-1] - footprint.start[order], size[order])
            element = np.repeat(owner, size[order])
            corner, reach = footprint.corner[index] - xy[element], np.zeros(el.size)
            np.maximum.at(reach, element, np.hypot(corner[:, 0], corner[:, 1]))
            begin = np.searchsorted(owner, np.arange(el.size + 1)).astype(np.int64)
            seams = Seams(*find_seams(begin, ring, corner, reach))
            self._polygons = _Polygons(begin, ring, corner, element, reach, seams)
        return self._polygons


@borrower
def _turn_corners(corner: Floats, element: Ints, levers: Floats, turned: Floats) -> None:
    """Turn corners of footprints (m) from the axes of their fragments to east and north; ``element``: of each corner."""
    for n in range(element.size):
        x, y, c, s = corner[n, 0], corner[n, 1], levers[element[n], 9], levers[element[n], 10]
        turned[n, 0], turned[n, 1] = c * x - s * y, s * x + c * y


def _sweep_position(el: Elements, first: Ints, second: Ints) -> Floats:
    """Where pairs stand on a line from south-west to north-east, in which the sweeps over the faces take them.

    Friction between several faces that stick is statically indeterminate, and how the sweeps share it out depends on their order.
    By place it is the same in whatever order the bergs were given. No row of a lattice stands square to this line.
    """
    lon, lat = el.shown.lon_pair, el.shown.lat_pair
    return np.asarray(lon[first] + lon[second] + GOLDEN_RATIO * (lat[first] + lat[second]))


def _recall_states(pairs: FacePairs, ids: Ints, counts: Ints, start: Ints) -> Floats:
    """Return the states of all faces of pairs of elements; zeros for those that did not press each other.

    ``ids``: identifiers of both elements, in either order; ``counts``: how many polygons they have; ``start``: as in `Faces`.
    Where a crack has divided these since, faces go on at the first of the pair that is free.
    """
    states, pair_row = np.zeros((start[-1], COLUMNS)), {}
    if len(pairs.pair):
        pair_row = {(min(pair), max(pair)): k for k, pair in enumerate(ids.tolist())}
    for pair, polygon, state in zip(pairs.pair.tolist(), pairs.polygon.tolist(), pairs.state, strict=True):
        if (k := pair_row.get((min(pair), max(pair)))) is None:
            continue
        p, q = polygon if pair[0] == ids[k, 0] else polygon[::-1]
        of_pair = states[start[k] : start[k + 1]]
        free = np.flatnonzero(of_pair[:, PHASE] == APART)
        number = p * counts[k, 1] + q
        if p < counts[k, 0] and q < counts[k, 1] and of_pair[number, PHASE] == APART:
            of_pair[number] = state
        elif free.size:
            of_pair[free[0]] = state
    return states
