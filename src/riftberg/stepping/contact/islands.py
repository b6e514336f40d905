"""Fragments that may touch within a step: the islands that they form, and what contact made of each.

Bodies that may touch each other in a step, directly or by way of others, form an island, and each island goes through the
step by itself, in sub-steps (`riftberg.stepping.contact.crushing_step`). Bodies that touch nothing on the way keep the result of
the whole step, as if alone. The others get their twist from the sub-steps, corrected here for the forces of the media at
the end of the step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.compiled.kernels import borrower, kernel
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.bodies.dynamics import (
    BodyMatrices,
    BodyOperators,
    ElementForcing,
    add_forces,
    assemble_force_and_jacobian,
)
from riftberg.stepping.forces.media import FORCES
from riftberg.stepping.fragments.connectivity import connected_parts


class Islands(NamedTuple):
    """Bodies that may touch each other, island by island; those of island k from ``start[k]`` to ``start[k + 1]``."""

    members: Ints  # Bodies
    start: Ints  # Where the islands begin in ``members``
    rows: Ints  # Elements of the bodies
    row_start: Ints  # Where the islands begin in ``rows``
    body_of: Ints  # Place of each element's body in its island; shape (rows,)
    first: Ints  # Candidate pairs, as places in the rows of their island
    second: Ints
    pair_start: Ints  # Where the islands begin among the pairs
    order: Ints  # Places of the pairs in the list that was given


class Island(NamedTuple):
    """The bodies and candidate pairs of one island, or of all, at the start of the step; bodies are numbered within each."""

    body_of: Ints  # Body of each element
    levers: Floats  # See `riftberg.stepping.bodies.pose.fill_levers`; shape (elements, 11)
    forcing: ElementForcing  # On the elements
    matrices: BodyMatrices  # Of the bodies
    bonded: NDArray[np.bool_]  # Whether a body has more than one element; shape (bodies,)
    first: Ints  # Elements of the candidate pairs
    second: Ints
    separation: Floats  # From the second to the first element at the start, east and north, m; shape (pairs, 2)


class IslandResult(NamedTuple):
    """What the sub-steps change: for one island the arrays are views of those of all."""

    twist: Floats  # Now; shape (bodies, 3)
    path: Floats  # Since the start, m, m, rad; shape (bodies, 3)
    touched: NDArray[np.bool_]  # Candidate pairs that touched; shape (pairs,)
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (elements, forces, 2)
    peak_force: Floats  # On the elements when contact pressed their body hardest, N, N, N m; shape (elements, 3)
    peak_axes: Floats  # Cosine and sine of the axis of their fragment then; shape (elements, 2)
    peak_spin: Floats  # Of the bodies then, rad s-1; shape (bodies,)


class PeakContactLoad(NamedTuple):
    """The loads of each bonded fragment in the sub-step in which contact pressed it hardest."""

    rows: Ints  # Elements of these fragments
    force: Floats  # N, N, N m; shape (rows, 3)
    axes: Floats  # Cosine and sine of the fragment's axis from local east then; shape (rows, 2)
    bodies: Ints  # The fragments
    spin: Floats  # Theirs then, rad s-1; shape (bodies,)


class ContactPhase(NamedTuple):
    """What contact made of a step, for the bodies that touched others."""

    bodies: Ints
    rows: Ints  # Their elements
    mean: Floats  # Twists on the way; shape (bodies, 3)
    twist: Floats  # Twists at the end; shape (bodies, 3)
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (rows, forces, 2)
    first: Ints  # Elements of the pairs that touched, each once
    second: Ints
    shortest_substep: float  # s
    peak_load: PeakContactLoad


def find_islands(body: Ints, count: int, first: Ints, second: Ints) -> Islands:
    """Find the islands among ``count`` bodies: connected components by the candidate pairs of elements, each given once."""
    part = connected_parts(count, body[first], body[second], np.zeros(first.size, np.int64))
    involved = np.zeros(count, bool)
    involved[body[first]] = involved[body[second]] = True
    members = np.flatnonzero(involved)
    members = members[np.argsort(part[members], kind="stable")]
    numbers, start = np.unique(part[members], return_index=True)
    place = np.zeros(count, np.int64)
    place[members] = np.arange(members.size) - np.repeat(start, np.diff(np.append(start, members.size)))
    rows = np.flatnonzero(involved[body])
    rows = rows[np.argsort(part[body[rows]], kind="stable")]
    row_start = np.searchsorted(part[body[rows]], numbers)
    at = np.zeros(body.size, np.int64)
    at[rows] = np.arange(rows.size) - np.repeat(row_start, np.diff(np.append(row_start, rows.size)))
    island = part[body[first]]
    # Within an island in the order of the rows, so that its sums do not depend on what is elsewhere.
    order = np.lexsort((second, first, island))
    return Islands(
        members, np.append(start, members.size), rows, np.append(row_start, rows.size), place[body[rows]],
        at[first[order]], at[second[order]], np.append(np.searchsorted(island[order], numbers), order.size), order,
    )  # fmt: skip


def pair_separations(el: Elements, first: Ints, second: Ints, p: KernelParameters) -> Floats:
    """Vectors from the second to the first element of each pair, east and north, m; shape (pairs, 2)."""
    metric, shown = Metric(p.latlon, p.earth_radius, p.period), el.shown
    one, two = (shown.lon_pair[first], shown.lat_pair[first]), (shown.lon_pair[second], shown.lat_pair[second])
    return np.column_stack(separations(metric, *one, *two))


def gather_islands(op: BodyOperators, first: Ints, second: Ints, apart: Floats) -> tuple[Islands, Island]:
    """Return the islands of the candidate pairs of elements, and what compiled code needs of all of them."""
    count = op.matrices.mobility.shape[0]
    i = find_islands(op.body, count, first, second)
    rows = i.rows
    return i, Island(
        i.body_of, op.levers[rows], forcing_of_rows(rows, op.forcing), BodyMatrices(*(m[i.members] for m in op.matrices)),
        np.bincount(op.body, minlength=count)[i.members] > 1, i.first, i.second, apart[i.order],
    )  # fmt: skip


def phase_of(
    op: BodyOperators, i: Islands, first: Ints, second: Ints, result: IslandResult, shortest: float, dt: float
) -> ContactPhase | None:
    """Return what the sub-steps of all islands made of the bodies that touched others; None where no pair did.

    ``first``, ``second``: elements of the candidate pairs, as they were given.
    """
    first, second = first[i.order], second[i.order]
    after, path, touched, applied, force, axes, spin = result
    if not touched.any():
        return None
    count = op.matrices.mobility.shape[0]
    took_part = np.zeros(count, bool)
    took_part[op.body[first[touched]]] = took_part[op.body[second[touched]]] = True
    members, rows = took_part[i.members], took_part[op.body[i.rows]]
    loaded = np.zeros(count, bool)
    pressed = np.bincount(op.body[i.rows], np.abs(force).sum(axis=1), count)[i.members] > 0.0
    loaded[i.members[members & pressed]] = True
    loaded_rows = loaded[op.body[i.rows]]
    peak = PeakContactLoad(
        i.rows[loaded_rows],
        force[loaded_rows],
        axes[loaded_rows],
        i.members[members & pressed],
        spin[members & pressed],
    )
    return ContactPhase(
        i.members[members], i.rows[rows], path[members] / dt, after[members], applied[rows], first[touched],
        second[touched], shortest, peak,
    )  # fmt: skip


def trapezoidal_correction(
    contact: ContactPhase, start: BodyOperators, end: BodyOperators, twist: Floats, dt: float
) -> tuple[Floats, ContactPhase]:
    """Put the twists of bodies in contact into ``twist``, with half the difference that the media at the end make.

    In the sub-steps the media are those of the start; with this correction they act by the trapezoidal rule.
    """
    bodies, rows, half_dt = contact.bodies, contact.rows, 0.5 * dt
    twist[bodies] = contact.twist
    active, mobility = np.zeros(twist.shape[0], np.bool_), end.matrices.mobility[bodies]
    active[bodies] = True

    def forces(op: BodyOperators) -> tuple[Floats, Floats]:
        """Accelerations of the elements by each force, and net forces on the bodies, at ``twist``."""
        accelerations, net_force = np.zeros((op.body.size, len(FORCES), 2)), np.zeros(twist.shape)
        add_forces(op.body, op.levers, twist, op.forcing, accelerations, np.empty((op.body.size, 3)), net_force)
        return accelerations[rows], net_force[bodies]

    (old_accelerations, old_force), (accelerations, net_force) = forces(start), forces(end)
    for _ in range(2):  # Newton's method from a guess that is nearly right: two iterations leave round-off
        jacobian = np.zeros((*twist.shape, 3))
        assemble_force_and_jacobian(end.body, end.levers, twist, end.forcing, active, np.zeros(twist.shape), jacobian)
        matrix = np.eye(3) + half_dt * mobility @ jacobian[bodies]
        change = half_dt * mobility @ (net_force - old_force)[:, :, None]
        twist[bodies] += np.linalg.solve(matrix, change + (contact.twist - twist[bodies])[:, :, None])[:, :, 0]
        accelerations, net_force = forces(end)
    applied = contact.applied + half_dt * (accelerations - old_accelerations)
    return twist, contact._replace(twist=twist[bodies], applied=applied)


def forcing_of_rows(rows: Ints, forcing: ElementForcing) -> ElementForcing:
    """Return the forcing of some elements."""
    return forcing._replace(
        **{name: part[rows] for name, part in forcing._asdict().items() if not isinstance(part, bool)}
    )


def scatter_peak_load(peak: PeakContactLoad, elements: int, bodies: int) -> tuple[Floats, Floats, Floats]:
    """Force (N, N, N m) and axes of all elements, and spins of all bodies (rad s-1); 0 where contact pressed nothing."""
    force, axes, spin = np.zeros((elements, 3)), np.zeros((elements, 2)), np.zeros(bodies)
    force[peak.rows], axes[peak.rows], spin[peak.bodies] = peak.force, peak.axes, peak.spin
    return force, axes, spin


@kernel
def island_part(lists: Islands, k: int, whole: Island) -> Island:
    """Return island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n, f, m = slice(lists.pair_start[k], lists.pair_start[k + 1]), whole.forcing, whole.matrices
    forcing = ElementForcing(
        f.media[e], f.coriolis[e], f.mass[e], f.inertia[e], f.floor_rate[e], f.floor_spin_rate[e], f.aground[e],
        f.spin_drag[e], f.water_spin[e], f.push_x[e], f.push_y[e], f.media_act, f.floor_acts,
    )  # fmt: skip
    return Island(
        whole.body_of[e], whole.levers[e], forcing, BodyMatrices(m.inertia[b], m.mobility[b], m.floor_drag[b]),
        whole.bonded[b], whole.first[n], whole.second[n], whole.separation[n],
    )  # fmt: skip


@kernel
def allocate_result(whole: Island, twist: Floats) -> IslandResult:
    """Return the results of all islands at the start of the step."""
    bodies, rows = twist.shape[0], whole.body_of.size
    return IslandResult(
        twist.copy(), np.zeros((bodies, 3)), np.zeros(whole.first.size, np.bool_),
        np.zeros((rows, whole.forcing.media.shape[1] + 1, 2)), np.zeros((rows, 3)), whole.levers[:, 9:11].copy(),
        np.zeros(bodies),
    )  # fmt: skip


@kernel
def result_part(lists: Islands, k: int, r: IslandResult) -> IslandResult:
    """Return the results of island ``k`` of all."""
    b, e = slice(lists.start[k], lists.start[k + 1]), slice(lists.row_start[k], lists.row_start[k + 1])
    n = slice(lists.pair_start[k], lists.pair_start[k + 1])
    return IslandResult(
        r.twist[b], r.path[b], r.touched[n], r.applied[e], r.peak_force[e], r.peak_axes[e], r.peak_spin[b]
    )


@kernel
def spin_lever(m: Floats, c: float, s: float) -> tuple[float, float]:
    """How the spin moves an element now, m; ``m`` are its levers at the start, cosine and sine those of the turn since."""
    return m[2] * c - m[5] * s, m[5] * c + m[2] * s


@kernel
def element_path(m: Floats, path: Floats, c: float, s: float) -> tuple[float, float]:
    """Path (m) of an element whose body has gone ``path`` since the levers ``m`` were found and turned by cosine and sine."""
    return (
        m[0] * path[0] + m[1] * path[1] + m[2] * s + m[5] * (c - 1.0),
        m[3] * path[0] + m[4] * path[1] + m[5] * s - m[2] * (c - 1.0),
    )


@borrower
def approach_bound(twist: Floats, arm: Floats) -> float:
    """Upper bound of the speed (m s-1) at which two elements could approach each other; or of their accelerations."""
    most = u = v = 0.0
    for b in range(twist.shape[0]):
        u += twist[b, 0] / twist.shape[0]
        v += twist[b, 1] / twist.shape[0]
    for b in range(twist.shape[0]):
        most = max(most, math.hypot(twist[b, 0] - u, twist[b, 1] - v) + arm[b] * abs(twist[b, 2]))
    return 2.02 * most  # both together, and 1 % more: distances on the sphere are not quite those of the plane
