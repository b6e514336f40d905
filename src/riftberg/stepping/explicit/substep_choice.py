"""How long a sub-step may be: from stiffness, mass and damping of the bonds (Riftberg's own; the reference is set by hand)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Elements, Floats
from riftberg.state.numbering import numbered
from riftberg.state.population import cut_out
from riftberg.stepping.forces.sizes import Sizes, interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.lattice.modes import largest_eigenvalue, substep_matrix
from riftberg.stepping.run_state import RunState

MOST_COUNTED = 1e15
"""Sub-steps beyond which nothing can be counted; how many a run may take is a matter of `riftberg.system.limits`."""

SINGLE_STEP = {"verlet": 4.0, "runge_kutta": 0.5}
"""Largest squared frequency of bonds times step for schemes without sub-steps: of Verlet the bound of the leapfrog; in
Runge-Kutta others are seen where they were at its start, so that it grows from 0.6 on (hexagonal) or 0.8 (square) even where
bonds are damped critically."""

LONG_CONTACT = 1.0
"""The same of one pair of bergs whose contact acts in the long step. They may get into each other by a whole step of their
closing speed v before contact is seen, and ``2 k v dt`` in a step is then more than they came with."""

COARSE = 0.01
"""Steps of the logarithm of sizes at which sub-steps are chosen anew: far less than the margin of ``stepping.safety``."""


def stable_substep(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> float:
    """Largest stable sub-step in seconds; infinite without bonds.

    At most a hundredth below the exact limit of the linearised lattice, never above it: see
    `riftberg.stepping.lattice.modes`. For one oscillator ``x'' + c x' + w^2 x = 0`` it is
    ``(sqrt(c^2 + 4 w^2) - c) / w^2``, which is 2 / w without damping.
    """
    if p.bonds.law == "none" or not np.any(bonds.status == 0):
        return math.inf
    fastest = largest_eigenvalue(substep_matrix(p, elements, bonds, sizes))
    if not math.isfinite(fastest):
        return 0.0
    return 1.0 / fastest if fastest > 0.0 else math.inf


def choose_substeps(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> int:
    """Return the number of sub-steps in a long step: as given (and checked), or the smallest that is safe."""
    fixed = p.stepping.substeps
    if fixed is not None and (p.compatibility.zero_start or not p.stepping.explicit_substeps):
        return fixed
    dt, stable = p.stepping.time_step, stable_substep(p, elements, bonds, sizes)
    wanted = dt / (p.stepping.safety * stable) if stable > 0.0 else math.inf
    if not wanted < MOST_COUNTED:
        raise InputError(
            f"no sub-step of these bonds is stable (the longest is {stable:.3g} s)",
            where="stepping.substeps",
            remedy="Look at thickness, radius, ice.density and bonds.youngs_modulus: one of them is far out of range",
        )
    least = max(1, math.ceil(wanted - 1e-9)) if math.isfinite(stable) else 1
    if fixed is None:
        return least
    if dt / fixed > stable:
        raise InputError(
            f"sub-step of {dt / fixed:.3g} s ({fixed} in {dt:g} s) is longer than the stable {stable:.3g} s "
            "of these bonds",
            where="stepping.substeps",
            remedy=f"Set it to {least} or more, or leave it out to have it chosen",
        )
    return fixed


def check_long_step(run: RunState) -> None:
    """Refuse a long step that springs cannot bear which act in it: bonds without sub-steps, contact of a given stiffness.

    Runs with the reference's quirks must run as they stand.
    """
    p, dt = run.parameters, run.parameters.stepping.time_step
    scheme = p.stepping.scheme
    moves = not p.stepping.frozen and p.stepping.fixed_velocity is None
    if p.compatibility.zero_start or scheme == "quasi_static" or not moves:
        return
    if scheme in SINGLE_STEP and p.bonds.law != "none":
        longest = math.sqrt(SINGLE_STEP[scheme] / max(_spring_frequency(run), 1e-300))
        if dt > longest:
            raise InputError(
                f"step of {dt:g} s is longer than the {longest:.3g} s that the springs of these bonds bear with scheme "
                f"{scheme!r}",
                where="stepping.time_step",
                remedy="Make it shorter, give softer bonds (bonds.spring), or take stepping.scheme = 'mts', which has sub-steps",
            )
    k = p.contact.spring
    if k is None or run.constants.contact_on_substeps or not p.stepping.interactions:
        return
    if 2.0 * k * dt * dt > LONG_CONTACT and np.ptp(run.elements.body.berg) > 0:
        longest = math.sqrt(0.5 * LONG_CONTACT / k)
        raise InputError(
            f"contact of {k:g} s-2 swings in {2.0 * math.pi / math.sqrt(2.0 * k):.3g} s, and the step of {dt:g} s, in which it "
            f"acts, is longer than the {longest:.3g} s that this bears",
            where="contact.spring",
            remedy="Leave it out to have what the step can resolve, or take stepping.scheme = 'mts' with contact.on_substeps",
        )


def _spring_frequency(run: RunState) -> float:
    """Bound of the largest squared frequency (s-2) of KID's spring bonds: twice the stiffest sum over one element."""
    el, bonds, c = run.elements, run.bonds, run.constants
    held = np.flatnonzero(bonds.status == 0)
    if held.size == 0:
        return 0.0
    i, j, mass = bonds.first[held], bonds.second[held], el.body.mass
    metric = Metric(c.latlon, c.earth_radius, c.period)
    x, y = separations(metric, el.place.lon[i], el.place.lat[i], el.place.lon[j], el.place.lat[j])
    squared = np.maximum(x * x + y * y, 1e-300)
    stiffness = np.full(held.size, c.spring) if c.spring >= 0.0 else c.modulus / squared
    lighter = stiffness * np.minimum(mass[i], mass[j]) / squared
    sums = np.zeros((el.size, 2, 2))
    for end in (i, j):
        along = np.stack([x, y], axis=-1)
        np.add.at(sums, end, (lighter / mass[end])[:, None, None] * along[:, :, None] * along[:, None, :])
    return 2.0 * float(np.linalg.eigvalsh(sums).max())


def coarse_sizes(elements: Elements) -> tuple[Floats, ...]:
    """Sizes of the bergs that the stable sub-step depends on, in steps of `COARSE`, for each of their elements.

    Melt changes all sizes in every long step, the stable sub-step by a part of that; it is chosen anew where one of these
    steps is passed. The steps are fixed, so that a run that is resumed chooses at the same times.
    """
    body = elements.body
    if elements.size == 0:
        return (body.mass, body.mass, body.mass, body.mass)
    numbers, berg = numbered(body.berg)
    count = numbers.size
    extremes = []
    for values, least in (
        (body.mass, True),
        (body.thickness, True),
        (body.thickness, False),
        (body.length * body.width, True),
    ):
        of_berg = np.full(count, np.inf if least else 0.0)
        (np.minimum if least else np.maximum).at(of_berg, berg, values)
        extremes.append(np.floor(np.log(np.maximum(of_berg, 1e-300)) / COARSE)[berg])
    return tuple(extremes)


def assign_substeps(run: RunState, chosen: NDArray[np.bool_]) -> None:
    """Choose the number of sub-steps of the bergs to which the ``chosen`` elements belong, each for itself.

    Fragments keep the number of the berg that they come from: found anew it would depend on the bonds broken since.
    """
    if not chosen.any():
        return
    p, elements, bonds = run.parameters, run.elements, run.bonds
    if p.stepping.scheme != "mts":
        elements.body.substeps[:] = 1
        return
    part = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    if p.compatibility.bergs_coupled or not part.any():
        sizes = interaction_sizes(elements, run.constants)
        elements.body.substeps[:] = choose_substeps(p, elements, bonds, sizes)
        return
    touched = np.isin(part, part[chosen])
    fixed = p.stepping.substeps
    elements.body.substeps[touched] = 1 if fixed is None else fixed
    bonded = np.bincount(part)[part] > 1
    for k in np.unique(part[touched & bonded]):
        rows = np.flatnonzero(part == k)
        some, between, _ = cut_out(elements, bonds, rows)
        sizes = interaction_sizes(some, run.constants)
        elements.body.substeps[rows] = choose_substeps(p, some, between, sizes)
