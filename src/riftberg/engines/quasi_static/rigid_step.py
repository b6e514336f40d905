"""Compiled parts of a trial step: predictor, operators at the new place, loads, and their record in the state.

For a berg of some hundred elements a call from Python takes as long as a law, so the kernels of
`riftberg.engines.quasi_static.bodies` are called together. All arrays come from Python (`riftberg.compiled.kernels.borrower`).

Between two steps elements may come, go, be moved or part (`sync_bodies`). A fragment to which nothing has happened keeps its
body: a body made anew from the positions of its elements would take their displacements by load into its reference coordinates,
again and again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.common.forces.media import MEDIA, ForcedElements
from riftberg.engines.common.forces.pack import mean_pack
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.quasi_static.bodies.dynamics import (
    BodyMatrices,
    BodyOperators,
    BodyWorkspace,
    Booleans,
    ElementForcing,
    ForceTerms,
    HalfKick,
    accumulate_excess_drag,
    accumulate_forces,
    add_forces,
    add_inertia,
    allocate_forcing,
    evaluate_forcing,
    first_half_kick,
    scatter_velocities,
)
from riftberg.engines.quasi_static.bodies.pose import (
    Bodies,
    bodies_from_elements,
    fill_levers,
    mean_displacement,
    move_poses,
    place_elements,
    split_bodies,
    subtract_mean,
)
from riftberg.engines.quasi_static.lattice.equilibrium import balance_loads
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import invert
from riftberg.physics.sea_ice import LOCKED
from riftberg.state import Bonds, Elements, Floats, Ints, Motion, Shown
from riftberg.state.population import find_rows

EVERY_MEDIUM, NOTHING = np.ones(len(MEDIA), np.bool_), np.empty((1, 0, 0))
"""Arguments of `evaluate_forcing` in place of the results of a velocity solve."""


class BodyState(NamedTuple):
    """All that is known at one time level."""

    time: float  # s
    bodies: Bodies
    operators: BodyOperators
    terms: ForceTerms  # At the velocities of the bodies
    force: (
        Floats  # On the elements, with what the bed and lasting contact press them with, N, N, N m; shape (elements, 3)
    )
    load: Floats  # Balanced loads on the lattice, N, N, N m; shape (elements, 3)


# Many arguments: a borrower makes no arrays, so both ends of the step, the places in the state and the workspace come
# in.
@borrower
def predict(
    new: Bodies, bodies: Bodies, op: BodyOperators, terms: ForceTerms, frozen_displacement: Floats, h: float, latlon: bool,
    radius: float, period: float, lon: Floats, lat: Floats, static: Floats, rotation: Floats, contact_bodies: Ints,
    contact_mean: Floats, kick: HalfKick, work: BodyWorkspace,
) -> None:  # fmt: skip
    """Take the first half ``kick`` and drift over ``h`` s: fill it, twist and pose of ``new``, and place the elements.

    ``contact_bodies`` drift with the mean twists ``contact_mean`` of their sub-steps in contact instead; all others are left
    active for the second half kick.
    """
    body, twist = bodies.body, new.twist
    first_half_kick(op, bodies.twist, terms, 0.5 * h, kick, work)
    for b in range(twist.shape[0]):
        work.active[b] = True
        for i in range(3):
            twist[b, i] = kick.twist[b, i]
    for k in range(contact_bodies.size):
        work.active[contact_bodies[k]] = False
        for i in range(3):
            twist[contact_bodies[k], i] = contact_mean[k, i]
    move_poses(bodies.pose, twist, h, latlon, radius, new.pose, work.scratch[0])
    for e in range(body.size):
        m, q = op.levers[e], twist[body[e]]
        rotation[e] += h * (m[6] * q[0] + m[7] * q[1] + m[8] * q[2])
    # Displacements lag by the whole time step: those of a trial are known only after its velocities and loads.
    drifted = Bodies(body, bodies.reference, new.pose, twist, frozen_displacement)
    place_elements(drifted, lon, lat, static, latlon, radius, period)


def assemble_operators(
    el: Elements, sizes: Sizes, bodies: Bodies, p: KernelParameters, work: BodyWorkspace, sides: Floats | None = None
) -> BodyOperators:
    """Assemble the forces and inertia of the fragments from the environment that the elements carry; no supports yet.

    ``sides``: points on their outlines, as `ElementForcing` has them.
    """
    count = bodies.pose.shape[0]
    forcing, levers = allocate_forcing(el, p, sides), np.empty((el.size, 11))
    matrices = BodyMatrices(*np.zeros((2, count, 3, 3)))
    environment = el.environment
    if p.ice_capture == LOCKED:
        environment = mean_pack(environment, el.body.mass, bodies.body)
    seen = ForcedElements(el.place, el.body, environment)
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
    add_inertia(bodies.body, levers, forcing, matrices.inertia)
    invert(matrices.inertia, matrices.mobility, work.scratch)


# Many arguments: a borrower makes no arrays, so forces, loads and the groups of the state that it fills come in.
@borrower
def find_loads(
    op: BodyOperators, twist: Floats, xy: Floats, pressed: Floats, terms: ForceTerms, force: Floats, load: Floats,
    motion: Motion, shown: Shown, spin_rate: Floats, work: BodyWorkspace,
) -> None:  # fmt: skip
    """Find forces and balanced loads at the velocities ``twist`` of the fragments, which their elements take on.

    ``pressed``: forces on the elements (N, N, N m) that load the lattice alone; no rows where there are none.
    """
    body, levers, forcing = op.body, op.levers, op.forcing
    add_forces(body, levers, twist, forcing, terms.accelerations, terms.drag_rate, force, terms.net_force)
    scatter_velocities(body, levers, twist, motion, shown)
    for b in range(twist.shape[0]):
        angular = 0.0
        for i in range(3):
            angular += op.matrices.mobility[b, 2, i] * terms.net_force[b, i]
        work.residual[b, 2] = angular
    for e in range(body.size):
        spin_rate[e] = work.residual[body[e], 2]
    for e in range(pressed.shape[0]):
        for i in range(3):
            force[e, i] += pressed[e, i]
    # The cosine and sine of the fragment's axis stand in columns 9 and 10 of the levers.
    balance_loads(body, xy, levers, 9, force, forcing.mass, forcing.inertia, twist, work.sums, load)


@borrower
def remove_rigid_modes(
    body: Ints, xy: Floats, displacement: Floats, previous: Floats, rotation: Floats, forcing: ElementForcing,
    work: BodyWorkspace,
) -> bool:  # fmt: skip
    """Subtract the mean displacement of each fragment, which its pose contains, and rotate the elements by the rest.

    Fragments with supports (``work.supported``) keep theirs. Returns whether all displacements are finite; ``previous`` are
    those until now.
    """
    for e in range(body.size):
        for i in range(3):
            if not np.isfinite(displacement[e, i]):
                return False
    mean, moments = work.residual, work.moments
    mean_displacement(body, xy, displacement, forcing.mass, forcing.inertia, mean, moments)
    for b in range(mean.shape[0]):
        if work.supported[b]:
            mean[b, :] = 0.0
    subtract_mean(body, xy, displacement, mean, moments)
    for e in range(body.size):
        rotation[e] += displacement[e, 2] - previous[e, 2]
    return True


@borrower
def accumulate_step_forces(
    op: BodyOperators, terms: ForceTerms, end_terms: ForceTerms, twist: Floats, kick: HalfKick, half_dt: float, weight: float,
    applied: Floats,
) -> None:  # fmt: skip
    """Add to ``applied`` the accelerations of a step by the trapezoidal rule: ``weight`` of those at each of its ends.

    ``twist``: at its start; ``kick``: the first half kick from there.
    """
    accumulate_forces(terms.accelerations, weight, applied)
    accumulate_excess_drag(op, twist, kick, half_dt, weight, applied)
    accumulate_forces(end_terms.accelerations, weight, applied)


# ---- between two steps ----


class StepSnapshot(NamedTuple):
    """The elements at the end of a step; arrays of shape (elements,)."""

    id: Ints
    lon: Floats  # Degrees or m
    lat: Floats
    u: Floats  # m s-1
    v: Floats
    spin: Floats  # rad s-1
    static: Floats  # Supports
    free_y: Floats
    load_x: Floats  # Given forces, N
    load_y: Floats

    def is_current(self, el: Elements) -> bool:
        """Whether nothing of this has changed since."""
        return el.size == self.id.size and _is_same(_collect_arrays(el), self)


@kernel
def _is_same(current: StepSnapshot, saved: StepSnapshot) -> bool:
    """Whether two snapshots of as many elements are alike."""
    for e in range(saved.id.size):
        if not (
            current.id[e] == saved.id[e]
            and current.lon[e] == saved.lon[e]
            and current.lat[e] == saved.lat[e]
            and current.u[e] == saved.u[e]
            and current.v[e] == saved.v[e]
            and current.spin[e] == saved.spin[e]
            and current.static[e] == saved.static[e]
            and current.free_y[e] == saved.free_y[e]
            and current.load_x[e] == saved.load_x[e]
            and current.load_y[e] == saved.load_y[e]
        ):
            return False
    return True


def _collect_arrays(el: Elements) -> StepSnapshot:
    place, motion, body = el.place, el.motion, el.body
    return StepSnapshot(
        body.id, place.lon, place.lat, motion.u, motion.v, motion.spin, body.static, body.free_y, body.load_x, body.load_y
    )  # fmt: skip


def take_snapshot(el: Elements) -> StepSnapshot:
    """Return a copy of the elements as they are."""
    return StepSnapshot._make([array.copy() for array in _collect_arrays(el)])


def sync_bodies(
    el: Elements, bonds: Bonds, old: Bodies, snapshot: StepSnapshot, p: KernelParameters
) -> tuple[Bodies, NDArray[np.bool_]]:
    """Return the bodies of the elements as they are now, and which of them have to take the velocity of their elements.

    A fragment that is as it was keeps its body. Where elements went, or bonds broke, the pieces get bodies of their own with
    the reference coordinates that they had. Where elements were born, bonded to others or moved, the body is made anew from
    the positions of its elements, less their displacements by load. The velocity of the elements counts where they were
    born, pushed or held.
    """
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    count = int(body.max()) + 1
    row, existed = find_rows(snapshot.id, el.body.id)
    current = _collect_arrays(el)
    differs = {name: a != b[row] for name, a, b in zip(StepSnapshot._fields, current, snapshot, strict=True)}
    moved = ~existed | differs["lon"] | differs["lat"]
    pushed = ~existed | differs["u"] | differs["v"] | differs["spin"] | differs["static"] | differs["free_y"]

    # A fragment comes from one old body (``source``), unless some of its elements were moved or came from several.
    anew, source, last = np.zeros(count, bool), np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    anew[body[moved]] = True
    np.minimum.at(source, body, old.body[row])
    np.maximum.at(last, body, old.body[row])
    anew |= source != last
    unchanged = ~anew & (np.bincount(body, minlength=count) == np.bincount(old.body)[source])

    new = Bodies(
        body, np.zeros((el.size, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((el.size, 3))
    )  # fmt: skip
    stays = unchanged[body]
    new.reference[stays], new.displacement[stays] = old.reference[row[stays]], old.displacement[row[stays]]
    new.pose[unchanged], new.twist[unchanged] = old.pose[source[unchanged]], old.twist[source[unchanged]]
    parted = ~anew & ~unchanged
    if parted.any():
        inside = parted[body]
        was = row[inside]
        of_old = Bodies(old.body[was], old.reference[was], old.pose, old.twist, old.displacement[was])
        numbers, mass = _renumbered(parted)[body[inside]], el.body.mass[inside]
        _insert(new, parted, split_bodies(of_old, numbers, mass, p.latlon, p.earth_radius))
    if anew.any():
        inside = anew[body]
        lon, lat = _without_load(el, old, snapshot, row, existed, p)
        remade = bodies_from_elements(
            lon[inside], lat[inside], _renumbered(anew)[body[inside]], el.body.mass[inside], p.latlon, p.earth_radius,
            p.period,
        )  # fmt: skip
        _insert(new, anew, remade)
    unknown = anew.copy()
    unknown[body[pushed]] = True
    return new, unknown


def _renumbered(chosen: NDArray[np.bool_]) -> Ints:
    """New numbers 0, 1, ... of some fragments, by their old ones."""
    return np.asarray(np.cumsum(chosen) - 1, np.int64)


def _insert(new: Bodies, chosen: NDArray[np.bool_], bodies: Bodies) -> None:
    """Write the bodies of some fragments to their places among all."""
    inside = chosen[new.body]
    new.reference[inside], new.displacement[inside] = bodies.reference, bodies.displacement
    new.pose[chosen], new.twist[chosen] = bodies.pose, bodies.twist


def _without_load(
    el: Elements, old: Bodies, snapshot: StepSnapshot, row: Ints, existed: NDArray[np.bool_], p: KernelParameters
) -> tuple[Floats, Floats]:
    """Positions of the elements now, less the displacements by load that they had at the end of the step."""
    lon, lat = snapshot.lon.copy(), snapshot.lat.copy()
    undeformed = old._replace(displacement=np.zeros_like(old.displacement))
    place_elements(undeformed, lon, lat, np.zeros(lon.size), p.latlon, p.earth_radius, p.period)
    return (
        el.place.lon - np.where(existed, (snapshot.lon - lon)[row], 0.0),
        el.place.lat - np.where(existed, (snapshot.lat - lat)[row], 0.0),
    )
