"""Contact by crushing between pieces whose lattices oscillate: each impact is resolved between rigid pieces.

Elastic bars give back a part of their speed by their own ringing, whatever the contact. So the pieces of a berg meet as rigid
bodies (`riftberg.stepping.contact.crushing_step`), between the slow kick of a long step and its sub-steps, and the elements
take the impulse as a change of the rigid motion of their piece. Media act in the kicks, not on the way through an impact.

Through the sub-steps a piece goes with its mean twist on the way, so it comes to where the impact leaves it; then it takes the
twist of its end. Bonds are tested under the largest force of the impact, in equilibrium with the acceleration of the rigid piece.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.bodies.dynamics import (
    BodyMatrices,
    BodyOperators,
    add_inertia_and_floor_drag,
    allocate_forcing,
)
from riftberg.stepping.bodies.pose import Bodies, bodies_from_elements, fill_levers
from riftberg.stepping.contact.broad_phase import NO_PAIRS
from riftberg.stepping.contact.faces import NO_FACE_PAIRS, FaceContact
from riftberg.stepping.contact.islands import SubcycledMotion
from riftberg.stepping.contact.land import NearPairs
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.lattice.footprints import FootprintBook
from riftberg.stepping.run_state import RunState


class RigidMotion(NamedTuple):
    """Pieces as rigid bodies that no medium acts on."""

    bodies: Bodies
    operators: BodyOperators


class Impact(NamedTuple):
    """What the pieces do in a long step in which some touch."""

    body: Ints  # Piece of each element
    # From the mean twists on the way to those at the end, as impulses: the pieces have deformed by then; shape (pieces, 3)
    impulse: Floats
    stress: Floats  # Of the bonds under the largest force, Pa; shape (bonds,), or (0,) where none is tested


class RigidImpacts:
    """The impacts of a run with an explicit scheme."""

    def __init__(self, run: RunState) -> None:
        self._footprints = FootprintBook(run)
        self.faces = FaceContact(run, self._footprints)
        self.touched = NO_PAIRS
        # At the start of the last step, with its time, for a model that takes a failed step back.
        self._last_start = math.nan, NO_FACE_PAIRS

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        return {**self._footprints.state_dict(), **self.faces.state_dict()}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave."""
        self._footprints.load_state_dict(saved)
        self.faces.load_state_dict(saved)

    def take_back(self, run: RunState) -> None:
        """See `riftberg.stepping.stepper.Stepper.take_back`."""
        if self._last_start[0] == run.time:
            self.faces.pairs = self._last_start[1]

    def before_substeps(self, run: RunState, sizes: Sizes, dt: float) -> tuple[Impact | None, int]:
        """Give the elements the mean motion of their piece through the impacts of a step of ``dt`` s.

        Returns what `after_substeps` needs after the sub-steps, and the number of bonds that break.
        """
        self._last_start = run.time, self.faces.pairs
        self.touched = NO_PAIRS
        el, bonds = run.elements, run.bonds
        body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
        if not run.constants.interactions or not body.any():
            return None, 0
        moving = el.static < 0.5
        for shown, own in ((el.u_pair, el.u), (el.v_pair, el.v)):
            np.copyto(shown, own, where=moving)
        rigid = rigid_motion(el, body, sizes, run.constants)
        contact = self.faces.resolve(run, rigid.bodies, rigid.operators, dt, sizes, el.rotation)
        if contact is None:
            return None, 0
        self.touched = contact.first, contact.second
        change = np.zeros_like(rigid.bodies.twist)
        change[contact.bodies] = contact.mean - rigid.bodies.twist[contact.bodies]
        broken, stress = self._break(run, rigid.bodies, contact)
        _add_rigid_motion(el, body, rigid.operators.levers, change)
        change[contact.bodies] = contact.twist - contact.mean
        impulse = (rigid.operators.matrices.inertia @ change[:, :, None])[:, :, 0]
        return Impact(body, impulse, stress), broken

    def after_substeps(self, run: RunState, sizes: Sizes, impact: Impact | None) -> None:
        """Give the elements the motion with which their pieces come out of the impacts, where they are now."""
        if impact is None:
            return
        op = rigid_motion(run.elements, impact.body, sizes, run.constants).operators
        change = (op.matrices.mobility @ impact.impulse[:, :, None])[:, :, 0]
        _add_rigid_motion(run.elements, impact.body, op.levers, change)
        if impact.stress.size:
            np.maximum(run.bonds.peak_stress, impact.stress, out=run.bonds.peak_stress)

    def find_near(self, run: RunState, lon: Floats, lat: Floats, part: Ints, within: float) -> NearPairs:
        """Find faces of different pieces near each other: see `riftberg.stepping.contact.faces.FaceContact.find_near`."""
        el, c = run.elements, run.constants
        bodies = bodies_from_elements(lon, lat, part, el.mass, c.latlon, c.earth_radius, c.period)
        return self.faces.find_near(run, bodies, lon, lat, el.rotation, within)

    def _break(self, run: RunState, bodies: Bodies, contact: SubcycledMotion) -> tuple[int, Floats]:
        """Break the bonds that do not bear the largest force of the impact; returns their number and the stress of all."""
        fracture = run.parameters.fracture
        unbreakable = run.step_number == 0 and fracture.not_in_first_step
        if not fracture.enabled or unbreakable or not contact.peak_load.rows.size:
            return 0, np.zeros(0)
        # With scipy's sparse solver, half a second that other runs do not wait for.
        from riftberg.stepping.quasi_static.step import break_under_impact

        return break_under_impact(run, bodies, contact.peak_load, self.faces)


def rigid_motion(el: Elements, body: Ints, sizes: Sizes, c: KernelParameters) -> RigidMotion:
    """Return the pieces as rigid bodies, with the momentum and the angular momentum of their elements."""
    bodies = bodies_from_elements(el.lon, el.lat, body, el.mass, c.latlon, c.earth_radius, c.period)
    count, levers, forcing = bodies.pose.shape[0], np.empty((el.size, 11)), allocate_forcing(el, c)
    fill_levers(bodies, c.latlon, c.earth_radius, levers)
    forcing.media[:], forcing.coriolis[:] = 0.0, 0.0
    forcing.inertia[:] = 0.5 * el.mass * sizes.bond_radius**2
    none = np.zeros(el.size)
    forcing = forcing._replace(push_x=none, push_y=none, media_act=False, floor_acts=False)
    matrices = BodyMatrices(*np.zeros((3, count, 3, 3)))
    add_inertia_and_floor_drag(body, levers, forcing, matrices.inertia, matrices.floor_drag)
    matrices.mobility[:] = np.linalg.inv(matrices.inertia)
    matrices.mobility[np.unique(body[(el.static >= 0.5) | (el.free_y < 0.5)])] = 0.0
    momentum = el.mass[:, None] * (levers[:, 0:3] * el.u[:, None] + levers[:, 3:6] * el.v[:, None])
    momentum += (forcing.inertia * el.spin)[:, None] * levers[:, 6:9]
    sums = np.array([np.bincount(body, momentum[:, k], count) for k in range(3)]).T
    twist = np.ascontiguousarray((matrices.mobility @ sums[:, :, None])[:, :, 0])
    return RigidMotion(bodies._replace(twist=twist), BodyOperators(body, levers, forcing, matrices))


def _add_rigid_motion(el: Elements, body: Ints, levers: Floats, change: Floats) -> None:
    """Add changes of the twists of pieces to the velocities of their elements."""
    q, moving = change[body], el.static < 0.5
    for array, columns in ((el.u, slice(0, 3)), (el.v, slice(3, 6)), (el.spin, slice(6, 9))):
        array[moving] += np.sum(levers[:, columns] * q, axis=1)[moving]
