"""A trial step: fragments move as rigid bodies, in contact in sub-steps, and their lattices bear the loads at its end.

A trial changes positions, rotations and damage in the model; `riftberg.engines.quasi_static.step` accepts it or rolls it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.land import (
    MAX_PASSES,
    corrected_poses,
    find_near_circles,
    land_corrections,
    leading_elements,
    stopped_by_land,
)
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import (
    BodyOperators,
    BodyWorkspace,
    ForceTerms,
    HalfKick,
    allocate_body_workspace,
    check_converged,
    half_kick_newton,
)
from riftberg.engines.quasi_static.bodies.linear_pack import linear_pack, soft_pack
from riftberg.engines.quasi_static.bodies.pose import Bodies, place_elements
from riftberg.engines.quasi_static.contact.anchors import allocate_anchors
from riftberg.engines.quasi_static.contact.islands import (
    PeakContactLoad,
    SubcycledMotion,
    scatter_peak_load,
    trapezoidal_correction,
)
from riftberg.engines.quasi_static.fracture.brittle_lattice import BrittleLattice
from riftberg.engines.quasi_static.fracture.criteria import Equilibrium, grow_damage
from riftberg.engines.quasi_static.ground.seabed import drop_fragments, join_drifts, join_motions
from riftberg.engines.quasi_static.lattice.dense import multiply_stacks
from riftberg.engines.quasi_static.lattice.equilibrium import balanced_loads, find_mobility, supported_loads
from riftberg.engines.quasi_static.memory import LawsWithMemory
from riftberg.engines.quasi_static.rigid_step import (
    BodyState,
    assemble_operators,
    find_loads,
    predict,
    remove_rigid_modes,
)
from riftberg.errors import RunError
from riftberg.ocean.cells import settle_elements
from riftberg.state import Floats, Ints

LARGEST_TURN_ON_ROLLERS = 0.02
"""Sine of the angle by which a fragment may turn on supports that are free eastward: they stay across its own axis."""


class Ashore(NamedTuple):
    """Fragments that land has put back."""

    bodies: Ints
    leading: Ints  # The elements that went farthest over land, theirs or of a fragment that they push
    is_own: NDArray[np.bool_]  # Whether it is theirs
    correction: Floats  # Of these, m east and north; shape (fragments, 2)


def _remove_landward_velocity(twist: Floats, levers: Floats, ashore: list[Ashore]) -> None:
    """Take from fragments the velocity into the land that stops their leading elements, or those that they push."""
    for bodies, leading, is_own, correction in ashore:
        m, q = levers[leading], twist[bodies]
        q[:, 2] *= is_own  # of a fragment that pushes the motion of its centre counts
        u, v = np.sum(m[:, 0:3] * q, axis=1), np.sum(m[:, 3:6] * q, axis=1)
        du, dv = stopped_by_land(0.0 * u, 0.0 * v, u, v, correction)
        # From the axes of the element to those of the centre: the inverse of a rotation.
        twist[bodies, 0] += m[:, 0] * du + m[:, 3] * dv
        twist[bodies, 1] += m[:, 1] * du + m[:, 4] * dv


@dataclass
class Trial:
    """A trial step from the state at its start; positions, rotation and damage in the model have followed it."""

    h: float  # s
    state: BodyState  # At its end
    kick: HalfKick  # The first one of both
    contact: SubcycledMotion | None  # What contact and the bed did on the way
    touching: bool = False  # Whether fragments have touched each other, or the bed has caught, turned or freed one
    hold_change: float = (
        0.0  # Of the bed on fragments that others push over it, as a multiple of what a step may change
    )
    peak: Equilibrium | None = None  # Under the peak contact loads, once it has been needed


class FragmentMotion:
    """Takes the fragments of a model through trial steps.

    ``lattice``: of the bonds that are intact now. ``frozen_displacement``: displacements of the elements at the start of the
    time step (m, m, rad), with which they are placed all through it.
    """

    lattice: BrittleLattice
    frozen_displacement: Floats

    def __init__(
        self, model: RunState, laws: LawsWithMemory, sizes: Sizes, work: BodyWorkspace | None = None
    ) -> None:  # fmt: skip
        self.model, self.el, self.bonds, self.c = model, model.elements, model.bonds, model.constants
        self.laws, self.sizes = laws, sizes
        self.work = work
        self.seabed, self.faces, self._sides = laws

    def trial(self, start: BodyState, h: float) -> Trial:
        """Take a trial step of ``h`` s: the fragments at the new place with their velocities, loads and equilibrium."""
        el, c, bodies = self.el, self.c, start.bodies
        work, time = self.workspace(bodies), start.time + h

        # Contact: fragments that may touch each other go through the step in sub-steps, island by island; then those that
        # touch a bed of sediment.
        contact, ground, hold_change = self._resolve_contacts_and_bed(start, h)
        drifting, mean = join_drifts(contact, ground)

        # Predictor: first half kick and drift. Bodies in contact drift with the mean twist of their sub-steps.
        new = bodies._replace(pose=np.empty_like(bodies.pose), twist=np.empty_like(bodies.twist))
        kick = HalfKick(np.empty_like(bodies.twist), np.empty((el.size, 2)))
        predict(
            new, bodies, start.operators, start.terms, self.frozen_displacement, h, c.latlon, c.earth_radius, c.period,
            el.place.lon, el.place.lat, el.body.static, el.motion.rotation, drifting, mean, kick, work,
        )  # fmt: skip
        new, ashore = self._constrained_by_land(new)
        self.model.forcing.sample(el, time)
        op = self.operators(new)

        # Corrector: second half kick, with the forces at the new place and time. Bodies in contact have their twists.
        twist = 2.0 * new.twist - bodies.twist  # first guess: the second half changes it as the first has done
        _remove_landward_velocity(
            new.twist, op.levers, ashore
        )  # each half kick drives a body into the land that stops it
        check_converged(half_kick_newton(op, new.twist, twist, 0.5 * h, work))
        if contact is not None:
            twist, contact = trapezoidal_correction(contact, soft_pack(start.operators), soft_pack(op), twist, h)
        if ground is not None:
            twist[ground.bodies] = ground.twist
        _remove_landward_velocity(twist, op.levers, ashore)

        state = self.in_equilibrium(self._loaded(new, op, time, twist))
        if self.model.parameters.damage.enabled:
            # By the equilibrium in the middle of the step, and the damage at its start.
            lattice, displacement = self.lattice, 0.5 * (bodies.displacement + state.bodies.displacement)
            middle = lattice.moment(displacement, 0.5 * (start.load + state.load))
            grow_damage(self.bonds, lattice.intact, lattice.criterion.damage_drive(middle, lattice.strengths()), h, c)
        # A fragment that the bed holds goes through the step at once; where it catches, turns or frees one sub-steps are shorter.
        lands = ground is not None and ground.shortest_substep < h
        touching = lands or (contact is not None and contact.first.size > 0)
        return Trial(h, state, kick, join_motions(contact, ground, bodies.body), touching, hold_change)

    def _resolve_contacts_and_bed(
        self, start: BodyState, h: float
    ) -> tuple[SubcycledMotion | None, SubcycledMotion | None, float]:
        """Take fragments through contact and over a bed of sediment; the third value goes into `Trial.hold_change`."""
        contact = self._resolve_contacts(start, h)
        if self.seabed is None:
            return contact, None, 0.0
        op = linear_pack(start.operators, start.bodies.twist)
        ground, hold_change = self.seabed.resolve(self.model, start.bodies, op, start.time, h, contact)
        if contact is not None and ground is not None:
            contact = drop_fragments(contact, ground.bodies, start.bodies.body)
        return contact, ground, hold_change

    def _resolve_contacts(self, start: BodyState, h: float) -> SubcycledMotion | None:
        """Take the fragments that may touch each other within ``h`` s through sub-steps."""
        bodies, keel = start.bodies, self.el.keel
        if self.faces is None or not self.c.interactions:
            return None
        if bodies.pose.shape[0] < 2:
            self.faces.forget_pairs()
            return None
        anchors = allocate_anchors(self.el.size) if self.seabed is None else self.seabed.anchors(keel)
        try:
            return self.faces.resolve(self.model, bodies, soft_pack(start.operators), h, self.sizes, anchors)
        except FloatingPointError:
            raise RunError(
                f"the velocities of bergs in contact did not converge at {self.model.date:%Y-%m-%d %H:%M}"
            ) from None

    def _constrained_by_land(self, bodies: Bodies) -> tuple[Bodies, list[Ashore]]:
        """Find the cells of the elements; where land stops one, its fragment is put back, with those in its way."""
        el, c, grid, ashore = self.el, self.c, self.model.forcing.grid, []
        for _ in range(MAX_PASSES):  # a correction may lead onto other land
            if grid is None:
                break
            lon, lat = el.lon.copy(), el.lat.copy()
            settle_elements(el, grid.arrays, c)
            correction = land_corrections(el, lon, lat, c)
            if not correction.any():
                break
            if self.faces is None:  # nobody may touch another
                find_near = partial(find_near_circles, el, lon, lat, bodies.body, c)
            else:
                find_near = partial(self.faces.find_near, self.model, bodies, lon, lat)
            leading = leading_elements(correction, bodies.body, find_near)
            bodies = bodies._replace(pose=corrected_poses(bodies.pose, el, lon, lat, leading, c))
            stopped = np.flatnonzero(leading >= 0)
            is_own = bodies.body[leading[stopped]] == stopped
            ashore.append(Ashore(stopped, leading[stopped], is_own, correction[leading[stopped]]))
            place_elements(
                bodies._replace(displacement=self.frozen_displacement), el.lon, el.lat, el.static, c.latlon,
                c.earth_radius, c.period,
            )  # fmt: skip
        self.publish_positions(bodies)
        return bodies, ashore

    def publish_positions(self, bodies: Bodies) -> None:
        """Let fragments see each other as they are without load."""
        # A slender piece bends by more than its contact is pressed in, and displacements lag by one step: seen bent, it
        # came out of contact in one step and deeper into it in the next.
        el, c = self.el, self.c
        el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
        if bodies.pose.shape[0] > 1:
            undeformed = bodies._replace(displacement=np.zeros_like(bodies.displacement))
            place_elements(undeformed, el.lon_pair, el.lat_pair, el.static, c.latlon, c.earth_radius, c.period)

    def operators(self, bodies: Bodies) -> BodyOperators:
        """Assemble the forces and inertia of the fragments from the environment that the elements carry."""
        el, c = self.el, self.c
        sides = None if self._sides is None else self._sides.find(self.model, bodies.body, self.lattice.xy)
        op = assemble_operators(el, self.sizes, bodies, c, self.workspace(bodies), sides)
        for b, inside in self._supported(bodies):
            turn = float(np.abs(op.levers[inside, 10] * (el.free_y[inside] < 0.5)).max())  # sine of the angle
            if turn > LARGEST_TURN_ON_ROLLERS:
                raise RunError(
                    f"a berg with elements that are held north and south (free_y = 0) has turned by "
                    f"{math.degrees(math.asin(turn)):.1f} degrees at {self.model.date:%Y-%m-%d %H:%M}: the default scheme "
                    "holds them across the berg as it stood at the start. Hold more elements, or use stepping.scheme mts"
                )
            # Fragments with supports move only as these allow: Z (Z^T M Z)^-1 Z^T in place of M^-1.
            z = self.lattice.supports.rigid_modes(inside, self.lattice.xy)
            op.matrices.mobility[b] = find_mobility(op.matrices.inertia[b], z)
        return op

    def _supported(self, bodies: Bodies) -> list[tuple[int, Ints]]:
        """Fragments with supports, and their elements."""
        if not self.lattice.supports.any:
            return []
        supported = np.unique(bodies.body[(self.el.static >= 0.5) | (self.el.free_y < 0.5)])
        return [(int(b), np.flatnonzero(bodies.body == b)) for b in supported]

    def _loaded(self, bodies: Bodies, op: BodyOperators, time: float, twist: Floats) -> BodyState:
        """Find forces and loads where the bodies are and go with ``twist``."""
        el, count = self.el, self.el.size
        # What the bed and lasting contact load the lattice with is no part of the forces by which the next step begins.
        pressed = np.zeros((0, 3))
        if self.seabed is not None:
            keel = el.keel
            torque = keel.floor_arm_x * keel.floor_y - keel.floor_arm_y * keel.floor_x + keel.anchor_torque
            pressed = np.column_stack([keel.floor_x, keel.floor_y, torque])
            op.forcing.aground[:] = el.keel.floor_load > 0.0
        if self.faces is not None and self.faces.pairs.pair.size:
            of_faces = self.faces.force(self.model)
            pressed = pressed + of_faces if pressed.size else of_faces
        terms = ForceTerms(np.zeros((count, len(FORCES), 2)), np.zeros_like(twist), np.empty((count, 3)))
        force, load = np.empty((count, 3)), np.empty((count, 3))
        find_loads(
            op, twist, self.lattice.xy, pressed, terms, force, load, el.motion, el.shown, el.kicks.spin_rate,
            self.workspace(bodies),
        )  # fmt: skip
        state = BodyState(time, bodies._replace(twist=twist), op, terms, force, load)
        self._set_supported_loads(state, load, op.levers[:, 9:11], force)
        return state

    def find_state(self, bodies: Bodies, time: float) -> BodyState:
        """Forces and loads where the bodies are."""
        return self._loaded(bodies, self.operators(bodies), time, bodies.twist)

    def _set_supported_loads(self, state: BodyState, balanced: Floats, turn: Floats, force: Floats) -> None:
        """Replace the loads of fragments with supports, which carry a part of them, in those of free fragments."""
        lattice, forcing = self.lattice, state.operators.forcing
        for _, inside in self._supported(state.bodies):
            z = lattice.supports.rigid_modes(inside, lattice.xy)
            balanced[inside] = supported_loads(inside, z, lattice.xy, turn, force, forcing.mass, forcing.inertia)

    def in_equilibrium(self, state: BodyState) -> BodyState:
        """Return the state with the displacements of the equilibrium under its loads."""
        bodies, work = state.bodies, self.workspace(state.bodies)
        displacement = self.lattice.displacements(state.load)
        work.supported[:] = False
        for b, _ in self._supported(bodies):
            work.supported[b] = True
        finite = remove_rigid_modes(
            bodies.body, self.lattice.xy, displacement, bodies.displacement, self.el.rotation, state.operators.forcing, work
        )  # fmt: skip
        if not finite:
            raise RunError(f"the equilibrium of the lattice is not a number at {self.model.date:%Y-%m-%d %H:%M}")
        return state._replace(bodies=bodies._replace(displacement=displacement))

    def peak_load(self, state: BodyState, peak: PeakContactLoad) -> Floats:
        """Balanced loads at the end of a trial; of the touched fragments at the moment of their peak contact load."""
        forcing, lattice = state.operators.forcing, self.lattice
        force, axes, spin = scatter_peak_load(peak, self.el.size, state.bodies.pose.shape[0])
        at_peak = balanced_loads(state.bodies.body, lattice.xy, axes, force, forcing.mass, forcing.inertia, spin)
        self._set_supported_loads(state, at_peak, axes, force)
        load = state.load.copy()
        load[peak.rows] = at_peak[peak.rows]
        return load

    def fit_twists(self, bodies: Bodies) -> Floats:
        """Return the rigid motions with the same momentum as the velocities of the elements."""
        el, op = self.el, self.operators(bodies)
        m, mass, inertia = op.levers, op.forcing.mass, op.forcing.inertia
        momentum = mass[:, None] * (m[:, 0:3] * el.u[:, None] + m[:, 3:6] * el.v[:, None])
        momentum += (inertia * el.spin)[:, None] * m[:, 6:9]
        sums = np.array([np.bincount(bodies.body, momentum[:, k], bodies.pose.shape[0]) for k in range(3)]).T
        return multiply_stacks(op.matrices.mobility, sums[:, :, None])[:, :, 0]

    def workspace(self, bodies: Bodies) -> BodyWorkspace:
        """Return a workspace for the fragments."""
        # All elements are in it, however the fragments part.
        count, elements = bodies.pose.shape[0], bodies.body.size
        if self.work is None or (self.work.residual.shape[0], self.work.direction.shape[0]) != (count, elements):
            self.work = allocate_body_workspace(count, elements)
        return self.work
