"""Fragments on a bed of sediment: rigid motion in sub-steps, as long as the floor lets them be.

    M (V1 - V0) = h (G(V) + sum B^T f),    V = (V0 + V1) / 2,    position: by V

with the media G and the forces f of the floor in the middle of the sub-step. Friction is an elastic-plastic anchor at the centre
of the load of each element: what the keel moves on (at V1: backward Euler, so that a held fragment comes to rest in any step)
loads it with the stiffness C / anchor way, up to the capacity C. The force is stored, not the way: where a load rises, a
stored way would push the berg back, and make energy.

A sub-step is halved until the floor changes the velocity by little, or holds the fragment, and until touching and coming free
are met within a minute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing, land_at, sea_level
from riftberg.parameters import Grounding, KernelParameters
from riftberg.physics.floating import draft_of
from riftberg.state import Floats, Ints, Keel
from riftberg.stepping.bodies.dynamics import (
    BodyOperators,
    ElementForcing,
    add_forces,
    add_inertia_and_floor_drag,
    assemble_force_and_jacobian,
)
from riftberg.stepping.bodies.pose import Bodies, fill_levers, move_poses, tangent_coordinates
from riftberg.stepping.contact.broad_phase import NO_PAIRS
from riftberg.stepping.contact.islands import PeakContactLoad, SubcycledMotion, forcing_of_rows
from riftberg.stepping.forces.media import FORCES, SEA_FLOOR
from riftberg.stepping.ground.balance import Bed, Bending, Hull, Pressure, hull_of, press
from riftberg.stepping.ground.floor import OPEN_DEPTH, STEEPEST, Floor, Patches
from riftberg.stepping.lattice.footprints import BodyFootprint, FootprintBook, body_footprint
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

VELOCITY_CHANGE: Final = 0.05
"""Largest part of its speed by which the floor changes that of a fragment in a sub-step, unless it holds it."""

SLOW: Final = 1e-3
"""Speed (m s-1) below which changes are measured by this one."""

TOUCH_STEP: Final = 60.0
"""Touching and coming free are met within this time, s."""

LEAST_STEP: Final = 0.01
"""Shortest sub-step, s."""

ASIDE: Final = 100.0
"""How far forces may take a fragment from its way in a step, m."""

STRUCK: Final = 0.05
"""Change of velocity (m s-1) in a step that makes an impact; pieces that lean on each other give less."""

DEEP_KEEL: Final = 1.0
"""How far below the floor a keel may start, m."""

INSIDE: Final = 0.75
"""Share of ice around a load from which the ice cracks along the line of the patch; elsewhere a piece of the edge breaks off."""

PASSES: Final = 50
"""Of Newton's method for the friction, after which the sub-step is halved."""


def bed_of(g: Grounding) -> Bed:
    """Return the bed that the parameters describe."""
    values = {**SEDIMENTS[g.sediment]}
    for name in ("stiffness", "bearing_strength", "friction", "shear_strength"):
        if (given := getattr(g, name)) is not None:
            values[name] = given
    shear = values.get("shear_strength", 0.0)
    strength = values.get("bearing_strength", BEARING_FACTOR * shear)
    return Bed(
        values["stiffness"], strength, values["friction"], g.adhesion * shear, g.anchor_way, g.bending, g.ice_modulus, POISSON
    )  # fmt: skip


class Fragment(NamedTuple):
    """One fragment as the floor sees it."""

    rows: Ints  # Elements
    footprint: BodyFootprint
    xy: Floats  # m; shape (elements, 2)
    thickness: Floats  # m
    draft: Floats  # m
    radius: float  # Of the circle about its origin that holds it, m
    hull: Hull
    first: Ints  # Intact bonds, as elements of the fragment
    second: Ints
    bonds: Ints  # The same, as rows of the state


class GroundMotion(NamedTuple):
    """What the floor made of a step for the fragments that it touched; the gouges are deepened already."""

    motion: SubcycledMotion  # As that of contact
    keel: Keel  # Of all elements, at the end
    flexure: Floats  # Largest bending stress that each bond has borne, Pa; shape (bonds,)


class _Friction(NamedTuple):
    """Friction in a sub-step; ``plastic``: energy (J) that keels lose as they slide."""

    velocity: Floats  # V1; shape (3,)
    anchor: Floats  # Of each element, N; shape (elements, 2)
    capacity: Floats  # Largest so far, N
    force: Floats  # Of the floor on each element with that of its slope, N; shape (elements, 2)
    torque: Floats  # About the centre of the element, N m
    net: Floats  # On the fragment; shape (3,)
    slides: bool
    plastic: float


def depth_of_bed(forcing: Forcing) -> Callable[[Floats, Floats], Floats]:
    """Return the depth of the bed (m) at points: land of no known depth is dry, and what lies beyond all data is deep."""

    def depth(lon: Floats, lat: Floats) -> Floats:
        found = np.asarray(forcing.depth(lon, lat), float)
        lost = ~np.isfinite(found)
        if lost.any():
            dry = land_at(forcing, lon[lost], lat[lost])
            found = found.copy()
            found[lost] = np.where(dry, 0.0, OPEN_DEPTH)
        return found

    return depth


class Seabed:
    """The bed under a run: what lives from one step to the next beside the state."""

    def __init__(self, model: RunState, footprints: FootprintBook) -> None:
        p, forcing = model.parameters, model.forcing
        self.bed, lon = bed_of(p.grounding), model.elements.lon
        self.floor = Floor(
            p.grounding.cell, depth_of_bed(forcing), p.earth.latlon, p.earth.radius, float(lon[0]) if lon.size else 0.0,
            p.earth.period,
        )  # fmt: skip
        self.newcomers = np.zeros(0, np.bool_)  # Elements that came since the last step
        self.plastic = np.zeros(2)  # Work of friction and of gouging since the start, J
        self._footprints = footprints
        self._fragments: dict[int, Fragment] = {}
        self._key: list[bytes] = []

    def checkpoint(self) -> tuple[dict[int, Floats], Floats]:
        """Return what a step changes: gouges and plastic work."""
        return self.floor.checkpoint(), self.plastic.copy()

    def rollback(self, before: tuple[dict[int, Floats], Floats]) -> None:
        """Return to what `checkpoint` gave."""
        self.floor.rollback(before[0])
        self.plastic = before[1].copy()

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        return {**self.floor.to_arrays(), "bed_plastic": self.plastic}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave."""
        if "gouge_block" in saved:
            self.floor.take_up(np.asarray(saved["gouge_block"]), np.asarray(saved["gouge_depth"]))
        if "bed_plastic" in saved:
            self.plastic = np.array(saved["bed_plastic"], np.float64)

    def prepare(self, model: RunState, bodies: Bodies) -> None:
        """Bring the fragments up to date with the state."""
        el, bonds = model.elements, model.bonds
        body = el.body
        key = [
            a.tobytes()
            for a in (bodies.body, bodies.reference, body.id, body.thickness, body.length, body.width, bonds.status)
        ]
        if key != self._key:
            self._key, self._fragments = key, {}
            self._footprints.follow(model)

    def fragment(self, model: RunState, bodies: Bodies, b: int) -> Fragment:
        """Return one fragment."""
        if b not in self._fragments:
            el, bonds, c = model.elements, model.bonds, model.constants
            xy = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius)
            rows = np.flatnonzero(bodies.body == b)
            footprint = body_footprint(self._footprints.follow(model), el, rows, xy)
            thickness = el.thickness[rows]
            draft = draft_of(thickness, c.rho_ice)
            place = np.full(el.size, -1)
            place[rows] = np.arange(rows.size)
            first, second = place[bonds.first], place[bonds.second]
            whole = (bonds.status == 0) & (first >= 0)
            radius = float(np.hypot(*footprint.corner.T).max())
            hull = hull_of(footprint.corner, footprint.start, footprint.owner, thickness, draft)
            self._fragments[b] = Fragment(
                rows,
                footprint,
                xy[rows],
                thickness,
                draft,
                radius,
                hull,
                first[whole],
                second[whole],
                np.flatnonzero(whole),
            )
        return self._fragments[b]

    def resolve(
        self, model: RunState, bodies: Bodies, op: BodyOperators, time: float, h: float, contact: SubcycledMotion | None
    ) -> GroundMotion | None:
        """Take the fragments that touch the floor within ``h`` s through sub-steps; None where none does."""
        self.prepare(model, bodies)
        keel, flexure = Keel._make(array.copy() for array in model.elements.keel), np.zeros(model.bonds.first.size)
        phases = []
        for b in range(bodies.pose.shape[0]):
            rows = np.flatnonzero(op.body == b)
            near = self._near(model, bodies, b, rows, time, h)
            if not near.any():
                for array in keel:  # it may have been lifted off the floor since the last step
                    array[rows] = 0.0
                continue
            fragment = self.fragment(model, bodies, b)
            push = _impulse_of(contact, b) / h
            run = _Landing(self, fragment, b, bodies, op, near, time, model, keel, push)
            if run.touches_within(h):
                run.integrate(h)
                flexure[fragment.bonds] = run.flexure
                phases.append(run)
        return GroundMotion(_motion_of(phases, h), keel, flexure) if phases else None

    def held_in_contact(self, model: RunState, op: BodyOperators, twist: Floats, slides: Ints) -> BodyOperators:
        """Return the operators for sub-steps of contact, in which the bed brakes all fragments on it but ``slides``.

        Its drag is linear and gives what friction can bear at the speed now, or at 1 mm/s: a fragment at rest is held.
        """
        el = model.elements
        capacity = np.where(np.isin(op.body, slides), 0.0, el.keel.anchor_capacity)
        if not capacity.any():
            return op
        u, v = (np.einsum("ek,ek->e", op.levers[:, k : k + 3], twist[op.body]) for k in (0, 3))
        speed, drag = np.maximum(np.hypot(u, v), SLOW), np.zeros_like(op.matrices.floor_drag)
        forcing = op.forcing._replace(floor_rate=op.forcing.floor_rate + capacity / (el.mass * speed))
        add_inertia_and_floor_drag(op.body, op.levers, forcing, np.zeros_like(drag), drag)
        return op._replace(forcing=forcing, matrices=op.matrices._replace(floor_drag=drag))

    def _near(
        self, model: RunState, bodies: Bodies, b: int, rows: Ints, time: float, h: float
    ) -> NDArray[np.bool_]:  # fmt: skip
        """Which elements of a fragment may come near the floor in the step."""
        el, p, twist = model.elements, model.constants, bodies.twist[b]
        draft = draft_of(el.body.thickness[rows], p.rho_ice)
        size = np.sqrt(el.body.length[rows] * el.body.width[rows])
        # By the depth in their middle first, so that deep water is never asked for its blocks: half of the diagonal of an
        # element, the way of the step, and a level of some metres.
        reach = size + h * math.hypot(twist[0], twist[1]) + 20.0
        some = np.asarray((el.environment.depth[rows] < draft + STEEPEST * reach) | (el.keel.floor_load[rows] > 0.0))
        if not some.any():
            return some
        fragment, pose = self.fragment(model, bodies, b), bodies.pose[b]
        lon, lat = corner_positions(fragment.footprint.corner, pose, p)
        level = min(_level(model, pose, time + t) for t in (0.0, 0.5 * h, h))
        way = h * (math.hypot(twist[0], twist[1]) + fragment.radius * abs(twist[2])) + ASIDE
        return self.floor.near(fragment.footprint, lon, lat, draft, some, level, way)

    def check_start(self, model: RunState, bodies: Bodies) -> None:
        """Refuse keels that start deep below the floor, or settle them into gouges; find what the floor carries at the start.

        Of all fragments in the first step, of those that have come since the last one later.
        """
        first = model.step_number == 0
        if not first:
            if not self.newcomers.any():
                return
            model.forcing.sample(model.elements, model.time)  # the depth under them, by which the near ones are found
        self.prepare(model, bodies)
        el, c, g = model.elements, model.constants, model.parameters.grounding
        for b in range(bodies.pose.shape[0]):
            rows = np.flatnonzero(bodies.body == b)
            if not first and not self.newcomers[rows].all():
                continue
            near = self._near(model, bodies, b, rows, model.time, 0.0)
            if not near.any():
                continue
            fragment = self.fragment(model, bodies, b)
            place = corner_positions(fragment.footprint.corner, bodies.pose[b], c)
            level = _level(model, bodies.pose[b], model.time)
            patches = self.floor.patches(fragment.footprint, *place, fragment.draft, near, level)
            deepest = patches.corner[:, 2].max(initial=0.0)
            # Pieces off a berg aground lay there before they broke off: they settle.
            piece = bool((el.life.fl_k[rows] < 0.0).all())
            if deepest > DEEP_KEEL and g.start == "refuse" and not piece:
                at = np.searchsorted(patches.start, patches.corner[:, 2].argmax(), side="right") - 1
                e = int(rows[patches.owner[at]])
                raise InputError(
                    f"the keel of element {el.body.id[e]} at ({el.lon[e]:.6g}, {el.lat[e]:.6g}) starts {deepest:.3g} m below the "
                    "sea floor", where="Model", remedy="Place the berg in deeper water, or set grounding.start to settle",
                )  # fmt: skip
            for _ in range(2 if deepest > DEEP_KEEL else 0):  # whole blocks first, then their cells
                self.floor.settle(patches)
                patches = self.floor.patches(fragment.footprint, *place, fragment.draft, near, level)
            found = self.press(model, fragment, patches, np.zeros(3))
            el.keel.floor_load[rows], el.keel.anchor_capacity[rows] = found.load, found.capacity

    def press(self, model: RunState, f: Fragment, patches: Patches, rise: Floats) -> Pressure:
        """Rise and loads of a fragment; ``rise``: where the search begins."""
        try:
            return press(patches, f.rows.size, f.hull, self.bed, f.thickness, f.first, f.second, rise)
        except FloatingPointError:
            raise RunError(f"the heave of a berg aground did not settle at {model.date:%Y-%m-%d %H:%M}") from None


def corner_positions(corner: Floats, pose: Floats, p: KernelParameters) -> tuple[Floats, Floats]:
    """Return the positions (degrees, or m) of points of a fragment, given on its tangent plane (m)."""
    if not p.latlon:
        x, y = corner[:, 0], corner[:, 1]
        return pose[0, 2] + pose[0, 0] * x + pose[0, 1] * y, pose[1, 2] + pose[1, 0] * x + pose[1, 1] * y
    s = corner / (2.0 * p.earth_radius)
    square = (s * s).sum(axis=1)
    unit = np.column_stack([2.0 * s, 1.0 - square]) / (1.0 + square)[:, None] @ pose.T
    return np.degrees(np.arctan2(unit[:, 1], unit[:, 0])), np.degrees(
        np.arctan2(unit[:, 2], np.hypot(unit[:, 0], unit[:, 1]))
    )


def _level(model: RunState, pose: Floats, time: float) -> float:
    """Sea level (m) at the centre of a fragment."""
    lon, lat = corner_positions(np.zeros((1, 2)), pose, model.constants)
    return float(sea_level(model.forcing, lon, lat, time)[0])


def bodies_under_impact(contact: SubcycledMotion, op: BodyOperators) -> Ints:
    """Bodies that contact gives a change of velocity of more than `STRUCK`."""
    impulse, mass = np.hypot(*contact.impulse[:, :2].T), op.matrices.inertia[contact.bodies, 0, 0]
    return np.asarray(contact.bodies[impulse > STRUCK * mass])


def _impulse_of(contact: SubcycledMotion | None, b: int) -> Floats:
    """Impulse (N s, N s, N m s) that contact gave a fragment in the step."""
    if contact is None:
        return np.zeros(3)
    return np.asarray(contact.impulse[contact.bodies == b].sum(axis=0))


class _Landing:
    """One fragment on its way through a step."""

    def __init__(
        self, seabed: Seabed, fragment: Fragment, b: int, bodies: Bodies, op: BodyOperators, near: NDArray[np.bool_],
        time: float, model: RunState, keel: Keel, push: Floats,
    ) -> None:  # fmt: skip
        self.seabed, self.fragment, self.b, self.near, self.time, self.model = seabed, fragment, b, near, time, model
        self.bed, self.c, rows = seabed.bed, model.constants, fragment.rows
        self.rows, self.keel, self.push = rows, keel, push
        self.forcing: ElementForcing = forcing_of_rows(rows, op.forcing)
        self.mobility, inertia = op.matrices.mobility[b], op.matrices.inertia[b]
        self.arm = math.sqrt(inertia[2, 2] / inertia[0, 0])
        self.reference, self.pose = bodies.reference[rows], bodies.pose[b : b + 1]
        self.body_of = np.zeros(rows.size, np.int64)
        self.path, self.velocity, self.elapsed = np.zeros(3), bodies.twist[b].copy(), 0.0
        self.anchor = np.column_stack([keel.anchor_x[rows], keel.anchor_y[rows]])
        self.capacity = keel.anchor_capacity[rows].copy()
        self.applied = np.zeros((rows.size, len(FORCES), 2))
        self.shortest, self.acceleration, self.rise = math.inf, np.zeros(3), np.zeros(3)
        self.peak, self.peak_force, self.peak_axes, self.peak_spin = (
            -1.0,
            np.zeros((rows.size, 3)),
            np.zeros((rows.size, 2)),
            0.0,
        )
        self.load, self.force, self.torque = np.zeros(rows.size), np.zeros((rows.size, 2)), np.zeros(rows.size)
        self.flexure, self.bends = (
            np.zeros(fragment.bonds.size),
            model.parameters.fracture.flexural_strength is not None,
        )

    def touches_within(self, h: float) -> bool:
        """Whether the floor touches the fragment at the start, or would in the middle or at the end without it."""
        if self.keel.floor_load[self.rows].any() or self.anchor.any():
            return True
        return any(
            self._overlaps(self._pose_after(t * self.velocity, t), t).any() for t in (0.0, 0.5 * h, h)
        )  # fmt: skip

    def _pose_after(self, path: Floats, t: float) -> Floats:
        if t == 0.0:
            return self.pose
        new = np.empty_like(self.pose)
        move_poses(self.pose, (path / t)[None], t, self.c.latlon, self.c.earth_radius, new, np.empty((3, 3)))
        return new

    def _patches(self, pose: Floats, t: float) -> Patches:
        lon, lat = corner_positions(self.fragment.footprint.corner, pose[0], self.c)
        level = _level(self.model, pose[0], self.time + t)
        return self.seabed.floor.patches(
            self.fragment.footprint, lon, lat, self.fragment.draft, self.near, level
        )  # fmt: skip

    def _overlaps(self, pose: Floats, t: float) -> NDArray[np.bool_]:
        return np.asarray(self._patches(pose, t).corner[:, 2] > 0.0)

    def _press(self, path: Floats, t: float) -> tuple[Floats, Pressure]:
        """Pose and pressure after a path (m, m, rad), ``t`` s from the start."""
        pose = self._pose_after(path, t)
        return pose, self.seabed.press(self.model, self.fragment, self._patches(pose, t), self.rise)

    def integrate(self, h: float) -> None:
        """Take the fragment through ``h`` s."""
        # Without a rise nothing overlaps, or the floor carries some of it.
        touches, dt, stop = bool(self._overlaps(self.pose, 0.0).any()), h, 0.0
        while (left := h - self.elapsed) > 1e-12 * h:
            dt = min(dt, left)
            middle, friction, end, accepted = self._substep(dt, touches)
            if not accepted:
                dt *= 0.5
                if dt < LEAST_STEP:
                    raise RunError(
                        f"a berg that runs aground at {self.model.date:%Y-%m-%d %H:%M} needs sub-steps of less than "
                        f"{LEAST_STEP:g} s"
                    )
                continue
            self._accept(dt, middle, friction, end)
            touches, dt = end.touches, 2.0 * dt
            if not friction.slides and end.touches:
                dt = h
            elif (slowing := -self.acceleration[:2] @ self.velocity[:2]) > 0.0:
                # Just before it stops: over a way shorter than that of the anchor the floor stops the fragment at once.
                speed = math.hypot(*self.velocity[:2])
                stop = speed * speed / slowing
                if 0.5 * speed * stop < 0.9 * self.bed.anchor_way and friction.slides:
                    dt = max(dt, 1.2 * stop)
        self._finish()

    def _substep(self, dt: float, touches: bool) -> tuple[tuple[Floats, Pressure], _Friction, Pressure, bool]:
        """Try a sub-step: middle, friction, end, and whether it is short enough."""
        t, v0 = self.elapsed, self.velocity
        half = self.path + 0.5 * dt * v0 + 0.125 * dt * dt * self.acceleration
        pose, found = self._press(half, t + 0.5 * dt)
        friction = self._friction(dt, pose, found)
        if friction is None:
            return (pose, found), self._no_friction(), found, False
        way = 0.5 * dt * (v0 + friction.velocity)
        _, end = self._press(self.path + way, t + dt)
        if not (touches == found.touches == end.touches) and dt > TOUCH_STEP:
            return (pose, found), friction, end, False
        moved = math.hypot(way[0], way[1]) + self.arm * abs(way[2])
        if not friction.slides and moved <= self.bed.anchor_way:
            return (pose, found), friction, end, True
        # By the greater of the forces in the middle and at the end.
        if found.touches or not end.touches:
            grows = max(0.0, end.capacity.sum() / max(found.capacity.sum(), 1e-30) - 1.0) if found.touches else 0.0
            more = grows * friction.net
        else:
            more = -end.capacity.sum() / max(math.hypot(v0[0], v0[1]), 1e-12) * np.array([v0[0], v0[1], 0.0])
        change = friction.velocity - v0 + dt * (self.mobility @ more) if found.touches or end.touches else np.zeros(3)
        size = math.hypot(change[0], change[1]) + self.arm * abs(change[2])
        speed = math.hypot(v0[0], v0[1]) + self.arm * abs(v0[2])
        return (pose, found), friction, end, size <= VELOCITY_CHANGE * max(speed, SLOW)

    def _levers(self, pose: Floats) -> Floats:
        n = self.rows.size
        levers = np.empty((n, 11))
        fill_levers(
            Bodies(self.body_of, self.reference, pose, self.velocity[None], np.zeros((n, 3))), self.c.latlon,
            self.c.earth_radius, levers,
        )  # fmt: skip
        return levers

    def _no_friction(self) -> _Friction:
        n = self.rows.size
        return _Friction(
            self.velocity, self.anchor, self.capacity, np.zeros((n, 2)), np.zeros(n), np.zeros(3), True, 0.0
        )

    def _friction(self, dt: float, pose: Floats, found: Pressure) -> _Friction | None:
        """Solve for the velocity at the end of a sub-step, with the anchors; None where it does not settle."""
        m, v0, loaded = self._levers(pose), self.velocity, found.load > 0.0
        # From the centre of an element to that of its load, east and north.
        dx, dy = (
            np.where(loaded, found.x - self.fragment.xy[:, 0], 0.0),
            np.where(loaded, found.y - self.fragment.xy[:, 1], 0.0),
        )
        ox, oy = m[:, 9] * dx - m[:, 10] * dy, m[:, 10] * dx + m[:, 9] * dy
        lever = np.stack([m[:, 0:3] - oy[:, None] * m[:, 6:9], m[:, 3:6] + ox[:, None] * m[:, 6:9]], axis=1)
        anchor = np.where(loaded[:, None], self.anchor, 0.0)
        largest = np.where(loaded, np.maximum(self.capacity, found.capacity), 0.0)
        spring = dt * largest / self.bed.anchor_way
        net_media, jacobian, always = np.zeros((1, 3)), np.zeros((1, 3, 3)), np.ones(1, np.bool_)
        constant = np.einsum("eak,ea->k", lever, found.slope) + self.push
        limit = found.capacity

        def forces(v: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
            trial = anchor - spring[:, None] * (lever @ v)
            size = np.hypot(trial[:, 0], trial[:, 1])
            slides = loaded & (size > limit)
            part = np.where(slides, limit / np.where(size > 0.0, size, 1.0), 1.0)
            return (
                trial * part[:, None],
                np.where(size[:, None] > 0.0, trial / np.where(size > 0.0, size, 1.0)[:, None], 0.0),
                slides,
            )

        def residual(v: Floats, f: Floats) -> Floats:
            # Media at the mean velocity, as the ledger has them: momentum closes to round-off.
            net_media[:], jacobian[:] = 0.0, 0.0
            assemble_force_and_jacobian(
                self.body_of, m, 0.5 * (v0 + v)[None], self.forcing, always, net_media, jacobian
            )
            net = net_media[0] + constant + np.einsum("eak,ea->k", lever, f)
            return np.asarray(v - v0 - dt * (self.mobility @ net))

        def size_of(r: Floats) -> float:
            return float(math.hypot(r[0], r[1]) + self.arm * abs(r[2]))

        v = v0.copy()
        f, direction, slides = forces(v)
        r = residual(v, f)
        for _ in range(PASSES):
            # Slope of the force by the velocity: of a sliding anchor that of its direction alone.
            part = np.where(
                slides, limit / np.maximum(np.hypot(*(anchor - spring[:, None] * (lever @ v)).T), 1e-30), 1.0
            )
            normal = np.where(slides, 1.0, 0.0)[:, None, None] * direction[:, :, None] * direction[:, None, :]
            tangent = (spring * part)[:, None, None] * (np.eye(2) - normal)
            slope = 0.5 * jacobian[0] + np.einsum("eak,eab,ebl->kl", lever, tangent, lever)
            step = np.linalg.solve(np.eye(3) + dt * (self.mobility @ slope), -r)
            scale, before = 1.0, size_of(r)
            while True:
                new = v + scale * step
                f, direction, slides = forces(new)
                r = residual(new, f)
                if size_of(r) < before or scale < 1e-3:
                    break
                scale *= 0.5
            v = new
            if size_of(scale * step) <= 1e-12 * max(size_of(v), 1e-6):
                break
        else:
            return None
        force = f + found.slope
        net = np.einsum("eak,ea->k", lever, force)
        # Where it slides, the anchor yields over the part of the way, by the mean velocity, that its spring does not take up.
        tried = np.hypot(*(anchor - spring[:, None] * (lever @ (0.5 * (v0 + v)))).T)[slides]
        yields = np.maximum(tried - limit[slides], 0.0) * self.bed.anchor_way / largest[slides]
        plastic = float((limit[slides] * yields).sum())
        return _Friction(v, f, largest, force, ox * force[:, 1] - oy * force[:, 0], net, bool(slides.any()), plastic)

    def _accept(self, dt: float, middle: tuple[Floats, Pressure], friction: _Friction, end: Pressure) -> None:
        """Make a sub-step the state of the fragment."""
        pose, n = middle[0], self.rows.size
        levers, mean = self._levers(pose), 0.5 * (self.velocity + friction.velocity)
        accelerations, rate, force, net = (
            np.zeros((n, len(FORCES), 2)),
            np.empty((n, 3)),
            np.empty((n, 3)),
            np.zeros((1, 3)),
        )
        add_forces(self.body_of, levers, mean[None].copy(), self.forcing, accelerations, rate, force, net)
        accelerations[:, SEA_FLOOR] += friction.force / self.forcing.mass[:, None]
        self.applied += dt * accelerations
        self.path = self.path + dt * mean
        self.acceleration = (friction.velocity - self.velocity) / dt
        self.elapsed += dt
        self.velocity, self.anchor, self.capacity = friction.velocity, friction.anchor, friction.capacity
        self.load, self.force, self.torque, self.rise = end.load, friction.force, friction.torque, end.rise
        self.shortest = min(self.shortest, dt)
        if (size := float(np.hypot(*friction.force.T).sum())) > self.peak:
            self.peak, self.peak_axes, self.peak_spin = size, levers[:, 9:11], float(friction.velocity[2])
            self.peak_force = force + np.column_stack([friction.force, friction.torque])
        if self.bends and self.flexure.size:
            for patch in end.bending():
                cut = bent_bonds(patch, self.fragment.xy, self.fragment.first, self.fragment.second)
                self.flexure[cut] = np.maximum(self.flexure[cut], patch.stress)
        self.seabed.plastic += (
            friction.plastic, self.bed.strength * self.seabed.floor.plough(end.patches, end.excess)
        )  # fmt: skip

    def _finish(self) -> None:
        """Write what the floor does at the end to the keels."""
        rows, keel, loaded = self.rows, self.keel, self.load > 0.0
        for array, values in zip(
            keel,
            (self.load, *self.force.T, self.torque, *self.anchor.T, self.capacity),
            strict=True,
        ):
            array[rows] = np.where(loaded, values, 0.0)


def bent_bonds(patch: Bending, xy: Floats, first: Ints, second: Ints) -> NDArray[np.bool_]:
    """Which intact bonds of a fragment the largest bending stress of a patch acts on.

    At an edge or a corner those between the ice that breaks off, up to ``pi lambda / 4`` from the loaded area where the moment is
    largest, and the rest; inside those that cross the line under the load, and ``lambda`` beyond its ends.
    """
    if patch.share < INSIDE:
        # Elements are the smallest piece, so a loaded one breaks off whole.
        piece = patch.inside | (shapely.distance(patch.area, shapely.points(xy)) < 0.25 * math.pi * patch.length)
        return np.asarray(piece[first] != piece[second])
    axis = np.array(patch.axis)
    origin = np.array(patch.area.centroid.coords[0])
    ends = (shapely.get_coordinates(patch.area) - origin) @ axis
    side = (xy - origin) @ np.array([-axis[1], axis[0]]) > 0.0
    along = (0.5 * (xy[first] + xy[second]) - origin) @ axis
    near = (along > ends.min() - patch.length) & (along < ends.max() + patch.length)
    return np.asarray((side[first] != side[second]) & near)


def _motion_of(phases: list[_Landing], h: float) -> SubcycledMotion:
    """Return the fragments that touched the floor as a phase of contact."""
    rows = np.concatenate([run.rows for run in phases])
    bonded = [run for run in phases if run.rows.size > 1]
    peak = PeakContactLoad(
        np.concatenate([np.zeros(0, np.int64), *(run.rows for run in bonded)]),
        np.concatenate([np.zeros((0, 3)), *(run.peak_force for run in bonded)]),
        np.concatenate([np.zeros((0, 2)), *(run.peak_axes for run in bonded)]),
        np.array([run.b for run in bonded], np.int64), np.array([run.peak_spin for run in bonded], np.float64),
    )  # fmt: skip
    return SubcycledMotion(
        np.array([run.b for run in phases], np.int64), rows, np.array([run.path for run in phases]) / h,
        np.array([run.velocity for run in phases]), np.zeros((len(phases), 3)),
        np.concatenate([run.applied for run in phases]), *NO_PAIRS,
        # Loads of the floor grow over minutes: cracks are not located as finely as the sub-steps that arrest a berg.
        max(min(run.shortest for run in phases), TOUCH_STEP), peak,
    )  # fmt: skip


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
