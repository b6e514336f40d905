"""Forces of all faces of an island at once, by Newton's method: sweeps take hundreds where bergs grind on each other.

The law of a face is made of straight pieces. On those on which the present velocities lie, the new ones follow from a linear
system with a block for each pair of bodies,

    V + h C sum J^T (F + F' J V) = V0

with the compliance C of the bodies, their velocities V0 without contact, and the levers J of the faces. Bodies go so far towards
its solution as the energy ``1/2 (V - V0) C^-1 (V - V0) + h sum integral F ds`` falls, of which the law is the gradient; without
that limit faces press and part by turns.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.physics.contact import sliding_force
from riftberg.physics.geometry import invert, multiply, solve, times
from riftberg.state import Floats, Ints

MOST_BODIES: Final = 100
"""Bodies of an island up to which all its faces are solved at once; the blocks of more would not fit into the cache."""

MOST_ITERATIONS: Final = 20
"""Iterations after which sweeps go on from where Newton's method is; it takes three as a rule."""

FLAT: Final = 1e-3
"""Part of its slope at the start to which the energy may rise at the end of the way, which then is gone whole."""

SEARCHES: Final = 8
"""Evaluations of the slope on a way that is not gone whole."""

UNLOADING, UNLOADING_RATE, LOADING, LOADING_RATE, CRUSHING, STICKING, SHEAR_RATE = range(7)
"""Columns of ``law``: the forces (N) and their change by the closing speed (N s m-1) as a face is unloaded, loaded and crushed;
the friction at the end of the last sub-step (N), and its change by the sliding speed (N s m-1)."""

FORCE, BY_CLOSING, FRICTION, BY_SLIDING, FRICTION_BY_CLOSING = range(5)
"""Columns of ``line``: force and friction (N) on the pieces of the law on which a face is, and how they change by its speeds."""

PUSH, DRAG, CLOSING_NOW, SLIDING_NOW, NEXT_CLOSING, NEXT_SLIDING = range(6)
"""Columns of ``course``: force and friction (N) that lead to the velocities so far; speeds (m s-1) of these, and of the next."""

APART, CRUSHED, UNLOADED, LOADED = range(4)
STICKS, SLIDES, SLIDES_BACK = range(3)
"""Pieces of the law, as in ``piece``."""


class NewtonWorkspace(NamedTuple):
    """Workspace for the forces of all faces of an island."""

    free: Floats  # Velocities without contact; shape (bodies, 3)
    law: Floats  # shape (pairs, 7)
    line: Floats  # shape (pairs, 5)
    course: Floats  # shape (pairs, 6)
    piece: Ints  # Of force and friction of each face; shape (pairs, 2)
    matrix: Floats  # Blocks of the system; shape (bodies, bodies, 3, 3)
    right: Floats  # shape (bodies, 3)
    linked: NDArray[np.bool_]  # Whether two bodies have a block; shape (bodies, bodies)
    links: Ints  # With how many others each has one; shape (bodies,)
    order: Ints  # Bodies, as they are eliminated; shape (bodies,)
    neighbours: Ints  # shape (bodies,)
    block: Floats  # shape (4, 3, 3)


@kernel
def allocate_newton(bodies: int, pairs: int) -> NewtonWorkspace:
    """Return a workspace; that of too many bodies has no system."""
    solved = bodies if bodies <= MOST_BODIES else 0
    return NewtonWorkspace(
        np.empty((bodies, 3)), np.empty((pairs, 7)), np.empty((pairs, 5)), np.empty((pairs, 6)), np.empty((pairs, 2), np.int64),
        np.zeros((solved, solved, 3, 3)), np.empty((solved, 3)), np.zeros((solved, solved), np.bool_),
        np.empty(solved, np.int64), np.empty(solved, np.int64), np.empty(solved, np.int64), np.empty((4, 3, 3)),
    )  # fmt: skip


@kernel
def find_pieces(work: NewtonWorkspace, count: int, friction: float) -> bool:
    """Find on which pieces of the law the faces are at the present velocities; returns whether any has changed."""
    changed = False
    for f in range(count):
        law, line = work.law[f], work.line[f]
        unloading, force = _pressing_force(law, work.course[f, CLOSING_NOW])
        if force == 0.0:
            pressing, line[FORCE], line[BY_CLOSING] = APART, 0.0, 0.0
        elif force == law[CRUSHING]:
            pressing, line[FORCE], line[BY_CLOSING] = CRUSHED, law[CRUSHING], 0.0
        elif force == unloading:
            pressing, line[FORCE], line[BY_CLOSING] = UNLOADED, law[UNLOADING], law[UNLOADING_RATE]
        else:
            pressing, line[FORCE], line[BY_CLOSING] = LOADED, law[LOADING], law[LOADING_RATE]
        stop = law[STICKING] + law[SHEAR_RATE] * work.course[f, SLIDING_NOW]
        if abs(stop) < friction * force:
            moving, line[FRICTION], line[BY_SLIDING], line[FRICTION_BY_CLOSING] = (
                STICKS,
                law[STICKING],
                law[SHEAR_RATE],
                0.0,
            )
        else:
            along = friction if stop > 0.0 else -friction
            moving = SLIDES if stop > 0.0 else SLIDES_BACK
            line[FRICTION], line[BY_SLIDING] = along * line[FORCE], 0.0
            line[FRICTION_BY_CLOSING] = along * line[BY_CLOSING]
        if pressing == APART:
            moving = STICKS
        changed = changed or work.piece[f, 0] != pressing or work.piece[f, 1] != moving
        work.piece[f, 0], work.piece[f, 1] = pressing, moving
    return changed


@kernel
def _pressing_force(law: Floats, closing: float) -> tuple[float, float]:
    """Force across a face at a closing speed (m s-1): by unloading alone, and the least of all pieces of the law; N."""
    unloading, loading = law[UNLOADING] + law[UNLOADING_RATE] * closing, law[LOADING] + law[LOADING_RATE] * closing
    return unloading, max(min(unloading, loading, law[CRUSHING]), 0.0)


@kernel
def begin_system(work: NewtonWorkspace) -> None:
    """Begin the system of bodies without contact."""
    for b in range(work.right.shape[0]):
        for c in range(work.right.shape[0]):
            if work.linked[b, c] or b == c:  # all others are zero
                work.matrix[b, c], work.linked[b, c] = 0.0, False
        for i in range(3):
            work.matrix[b, b, i, i], work.right[b, i] = 1.0, work.free[b, i]


@kernel
def add_face(work: NewtonWorkspace, f: int, levers: Floats, kicks: Floats, a: int, b: int, h: float) -> None:
    """Add face ``f`` between two bodies to the system.

    ``levers``: across and then along the face, of both bodies; ``kicks``: changes of their velocities by a unit impulse.
    """
    line, across, along = work.line[f], levers[:6], levers[6:]
    work.linked[a, b] = work.linked[b, a] = True
    for body, k in ((a, 0), (b, 3)):
        push, drag = kicks[k : k + 3], kicks[6 + k : 9 + k]
        for i in range(3):
            work.right[body, i] -= h * (push[i] * line[FORCE] + drag[i] * line[FRICTION])
            by_closing = h * (push[i] * line[BY_CLOSING] + drag[i] * line[FRICTION_BY_CLOSING])
            by_sliding = h * drag[i] * line[BY_SLIDING]
            for j in range(3):
                work.matrix[body, a, i, j] += by_closing * across[j] + by_sliding * along[j]
                work.matrix[body, b, i, j] += by_closing * across[3 + j] + by_sliding * along[3 + j]


@kernel
def solve_system(work: NewtonWorkspace, out: Floats) -> None:
    """Solve for the velocities by elimination, the body with the fewest neighbours first; the system is used up."""
    matrix, right, bodies = work.matrix, work.right, work.right.shape[0]
    inverse, factor, product = work.block[0], work.block[1], work.block[2]
    for b in range(bodies):
        work.order[b], work.links[b] = b, 0
        for c in range(bodies):
            work.links[b] += work.linked[b, c]
    for n in range(bodies):
        chosen = n
        for m in range(n + 1, bodies):
            if work.links[work.order[m]] < work.links[work.order[chosen]]:
                chosen = m
        p, count = work.order[chosen], 0
        work.order[chosen], work.order[n] = work.order[n], p
        for m in range(n + 1, bodies):
            if work.linked[p, work.order[m]]:
                work.neighbours[count] = work.order[m]
                count += 1
        if count == 0:
            continue
        invert(matrix[p, p : p + 1], work.block[:1], work.block[3:])
        for i in work.neighbours[:count]:
            work.links[i] -= 1
            multiply(matrix[i, p], inverse, factor)
            change = times(factor, right[p])
            for k in range(3):
                right[i, k] -= change[k]
            for j in work.neighbours[:count]:
                multiply(factor, matrix[p, j], product)
                for k in range(3):
                    for m in range(3):
                        matrix[i, j, k, m] -= product[k, m]
                if i != j and not work.linked[i, j]:
                    work.linked[i, j] = True
                    work.links[i] += 1
    for n in range(bodies - 1, -1, -1):
        p = work.order[n]
        for j in work.order[n + 1 :]:
            if work.linked[p, j]:
                change = times(matrix[p, j], out[j])
                for k in range(3):
                    right[p, k] -= change[k]
        out[p, 0], out[p, 1], out[p, 2] = solve(matrix[p, p], right[p])


@kernel
def approach_solution(work: NewtonWorkspace, count: int, friction: float) -> float:
    """Go the share of the way to the solution on which the energy falls; returns that share, 0 where it does not fall."""
    share, at_start, at_end = 1.0, _energy_slope(work, count, friction, 0.0), _energy_slope(work, count, friction, 1.0)
    if at_start >= 0.0:
        return 0.0
    if at_end > -FLAT * at_start:
        low, high = 0.0, 1.0
        for _ in range(SEARCHES):
            share = high - at_end * (high - low) / (at_end - at_start)
            share = min(max(share, 0.9 * low + 0.1 * high), 0.1 * low + 0.9 * high)
            slope = _energy_slope(work, count, friction, share)
            if slope > 0.0:
                high, at_end = share, slope
            else:
                low, at_start = share, slope
        share = low if low > 0.0 else high
    for f in range(count):
        course = work.course[f]
        push, drag = _solved_forces(work, f)
        course[PUSH] += share * (push - course[PUSH])
        course[DRAG] += share * (drag - course[DRAG])
        course[CLOSING_NOW] += share * (course[NEXT_CLOSING] - course[CLOSING_NOW])
        course[SLIDING_NOW] += share * (course[NEXT_SLIDING] - course[SLIDING_NOW])
    return share


@kernel
def _energy_slope(work: NewtonWorkspace, count: int, friction: float, share: float) -> float:
    """Change of the energy by the share of the way to the solution, where so much of it is gone; W."""
    slope = 0.0
    for f in range(count):
        law, course = work.law[f], work.course[f]
        push, drag = _solved_forces(work, f)
        to_closing, to_sliding = course[NEXT_CLOSING] - course[CLOSING_NOW], course[NEXT_SLIDING] - course[SLIDING_NOW]
        closing, sliding = course[CLOSING_NOW] + share * to_closing, course[SLIDING_NOW] + share * to_sliding
        _, force = _pressing_force(law, closing)
        stop = sliding_force(law[STICKING], sliding, law[SHEAR_RATE], 0.0, friction * force)
        # The kinetic term is that of the forces that lead to the velocities, which change evenly on the way.
        slope += (force - course[PUSH] - share * (push - course[PUSH])) * to_closing
        slope += (stop - course[DRAG] - share * (drag - course[DRAG])) * to_sliding
    return slope


@kernel
def _solved_forces(work: NewtonWorkspace, f: int) -> tuple[float, float]:
    """Force and friction of a face in the solution of the system, N."""
    line, closing, sliding = work.line[f], work.course[f, NEXT_CLOSING], work.course[f, NEXT_SLIDING]
    push = line[FORCE] + line[BY_CLOSING] * closing
    return push, line[FRICTION] + line[BY_SLIDING] * sliding + line[FRICTION_BY_CLOSING] * closing
