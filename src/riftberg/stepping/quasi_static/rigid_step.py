"""Compiled parts of a trial step: predictor, operators at the new place, corrector, and what they leave in the state.

For a berg of some hundred elements a call from Python takes as long as a law, so the kernels of `riftberg.stepping.bodies` are
called together. All arrays come from Python (`riftberg.compiled.kernels.borrower`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints, Motion, Shown
from riftberg.stepping.bodies.dynamics import (
    BodyMatrices,
    BodyOperators,
    BodyWorkspace,
    Booleans,
    ElementForcing,
    ForceTerms,
    accumulate_forces,
    add_forces,
    add_inertia_and_floor_drag,
    allocate_forcing,
    evaluate_forcing,
    half_kick_explicit,
    half_kick_newton,
    mean_drag_velocity,
    scatter_velocities,
)
from riftberg.stepping.bodies.pose import (
    Bodies,
    fill_levers,
    mean_displacement,
    move_poses,
    place_elements,
    subtract_mean,
)
from riftberg.stepping.forces.media import MEDIA, ForcedElements
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.equilibrium import balance_loads
from riftberg.stepping.mat3 import invert

EVERY_MEDIUM, NOTHING = np.ones(len(MEDIA), np.bool_), np.empty((1, 0, 0))
"""What `evaluate_forcing` is given in the place of the results of a velocity solve."""


class BodyState(NamedTuple):
    """All that is known at one time level."""

    time: float  # s
    bodies: Bodies
    operators: BodyOperators
    terms: ForceTerms  # At the velocities of the bodies
    force: Floats  # On the elements, with the drag of the sea floor, N, N, N m; shape (elements, 3)
    load: Floats  # Balanced loads on the lattice, N, N, N m; shape (elements, 3)


# Many arguments: a borrower makes no arrays, so both ends of the step, the places in the state and the workspace come
# in.
@borrower
def predict(
    new: Bodies, bodies: Bodies, matrices: BodyMatrices, levers: Floats, net_force: Floats, frozen_displacement: Floats,
    h: float, latlon: bool, radius: float, period: float, lon: Floats, lat: Floats, static: Floats, rotation: Floats,
    contact_bodies: Ints, contact_mean: Floats, work: BodyWorkspace,
) -> None:  # fmt: skip
    """Take the first half kick and drift over ``h`` s: fill twist and pose of ``new``, and place the elements.

    ``contact_bodies`` drift with the mean twists ``contact_mean`` of their sub-steps in contact instead.
    """
    body, twist = bodies.body, new.twist
    half_kick_explicit(matrices, bodies.twist, net_force, 0.5 * h, twist, work)
    for k in range(contact_bodies.size):
        for i in range(3):
            twist[contact_bodies[k], i] = contact_mean[k, i]
    move_poses(bodies.pose, twist, h, latlon, radius, new.pose, work.scratch[0])
    for e in range(body.size):
        m, q = levers[e], twist[body[e]]
        rotation[e] += h * (m[6] * q[0] + m[7] * q[1] + m[8] * q[2])
    # Displacements lag by the whole time step: those of a trial are known only after its velocities and loads.
    there = Bodies(body, bodies.reference, new.pose, twist, frozen_displacement)
    place_elements(there, lon, lat, static, latlon, radius, period)


def assemble_operators(
    el: Elements, sizes: Sizes, bodies: Bodies, p: KernelParameters, work: BodyWorkspace
) -> BodyOperators:
    """Find what moves the fragments, from the environment that the elements carry; no supports yet."""
    count = bodies.pose.shape[0]
    forcing, levers = allocate_forcing(el, p), np.empty((el.size, 11))
    matrices = BodyMatrices(*np.zeros((3, count, 3, 3)))
    seen = ForcedElements(el.place, el.body, el.environment)
    _assemble_operators(seen, sizes, p, bodies, EVERY_MEDIUM, NOTHING, levers, forcing, matrices, work)
    return BodyOperators(bodies.body, levers, forcing, matrices)


@borrower
def _assemble_operators(
    el: ForcedElements, sizes: Sizes, p: KernelParameters, bodies: Bodies, acts: Booleans, nothing: Floats, levers: Floats,
    forcing: ElementForcing, matrices: BodyMatrices, work: BodyWorkspace,
) -> None:  # fmt: skip
    """Fill the arrays of `assemble_operators`."""
    fill_levers(bodies, p.latlon, p.earth_radius, levers)
    evaluate_forcing(el, sizes, p, acts, nothing, forcing)
    add_inertia_and_floor_drag(bodies.body, levers, forcing, matrices.inertia, matrices.floor_drag)
    invert(matrices.inertia, matrices.mobility, work.scratch)


# Many arguments: a borrower makes no arrays, so velocities, forces, loads and the groups of the state that it fills
# come in.
@borrower
def correct(
    op: BodyOperators, middle: Floats, twist: Floats, half_dt: float, kick: bool, xy: Floats, terms: ForceTerms,
    force: Floats, load: Floats, motion: Motion, shown: Shown, spin_rate: Floats, sums: Floats, work: BodyWorkspace,
) -> int:  # fmt: skip
    """Take the second half kick from ``middle`` (where ``kick``), and find forces and balanced loads at its velocities.

    ``twist`` holds a first guess and takes the velocities; the elements take on those of their fragments. Returns the
    iterations of Newton's method, -1 where they do not converge.
    """
    iterations, body, levers, forcing = 0, op.body, op.levers, op.forcing
    if kick:
        work.active[:] = True
        iterations = half_kick_newton(op, middle, twist, half_dt, work)
    add_forces(body, levers, twist, forcing, terms.accelerations, force, terms.net_force)
    scatter_velocities(body, levers, twist, forcing, force, motion, shown)
    for b in range(twist.shape[0]):
        angular = 0.0
        for i in range(3):
            f = terms.net_force[b, i]
            for j in range(3):
                f -= op.matrices.floor_drag[b, i, j] * twist[b, j]
            angular += op.matrices.mobility[b, 2, i] * f
        work.residual[b, 2] = angular
    for e in range(body.size):
        spin_rate[e] = work.residual[body[e], 2]
    # The cosine and sine of the fragment's axis stand in columns 9 and 10 of the levers.
    balance_loads(body, xy, levers, 9, force, forcing.mass, forcing.inertia, twist, sums, load)
    return iterations


@borrower
def remove_rigid_modes(
    body: Ints, xy: Floats, displacement: Floats, before: Floats, rotation: Floats, forcing: ElementForcing,
    supported: Booleans, mean: Floats, moments: Floats,
) -> bool:  # fmt: skip
    """Subtract the mean displacement of each fragment, which its pose contains, and rotate the elements by the rest.

    Fragments with supports keep theirs. Returns whether all displacements are finite; ``before`` are those until now.
    """
    for e in range(body.size):
        for i in range(3):
            if not np.isfinite(displacement[e, i]):
                return False
    mean_displacement(body, xy, displacement, forcing.mass, forcing.inertia, mean, moments)
    for b in range(mean.shape[0]):
        if supported[b]:
            mean[b, :] = 0.0
    subtract_mean(body, xy, displacement, mean, moments)
    for e in range(body.size):
        rotation[e] += displacement[e, 2] - before[e, 2]
    return True


# Many arguments: the trapezoidal rule needs levers, floor, matrices, forces and velocities of both ends of the step.
@borrower
def accumulate_step_forces(
    body: Ints, levers: Floats, end_levers: Floats, floor_rate: Floats, end_floor_rate: Floats, matrices: BodyMatrices,
    end_matrices: BodyMatrices, terms: ForceTerms, end_terms: ForceTerms, twist: Floats, end_twist: Floats, half_dt: float,
    part: float, middle: Floats, drag_twist: Floats, applied: Floats, work: BodyWorkspace,
) -> None:  # fmt: skip
    """Add to ``applied`` the accelerations of a step by the trapezoidal rule: ``part`` of those at each of its ends."""
    half_kick_explicit(matrices, twist, terms.net_force, half_dt, middle, work)
    mean_drag_velocity(matrices, terms.net_force, middle, half_dt, drag_twist, work.scratch)
    accumulate_forces(body, levers, floor_rate, terms.accelerations, drag_twist, part, applied)
    mean_drag_velocity(end_matrices, end_terms.net_force, end_twist, half_dt, drag_twist, work.scratch)
    accumulate_forces(body, end_levers, end_floor_rate, end_terms.accelerations, drag_twist, part, applied)
