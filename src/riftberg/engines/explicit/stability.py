"""How long a step may be: critical time step of bonds and contact, and resonance of a berg with its outer kicks.

All of it is Riftberg's own; the steps of the reference are set by hand.

The fastest mode of a lattice of bonds decides how long a sub-step may be. In generalised coordinates X (displacement and
rotation of every element) and velocities V the linearised sub-step is
``V' = V - h M^-1 (K X + C V)``, ``X' = X + h V'``: leapfrog with the damping at the half-kicked velocity. With symmetric,
non-negative K and C each eigenvector sees Rayleigh quotients k and c, and all its factors stay within the unit circle
exactly while ``4 - 2 h c - h^2 k > 0``. At the limit ``4 M - 2 h C - h^2 K`` is singular, that is an eigenvalue is -1, so
the bound is sharp, however K and C are combined. With ``K = S S^T`` and ``mu = 1 / h`` the limit is the largest eigenvalue
of the symmetric matrix::

    [ 0      S^T / 2 ]
    [ S / 2  C / 2   ]

(mass-weighted), which a few dozen Lanczos steps give. The matrix is never written down: of a million elements it would take
gigabytes.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.config.units import duration_text
from riftberg.constants import SECONDS_PER_DAY
from riftberg.engines.common.forces.sizes import Sizes, interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.slenderness import spread
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import cut_out, numbered

ACCURACY: Final = 0.01
"""Relative accuracy of the largest eigenvalue: far less than the margin of ``stepping.safety``."""

MAX_LANCZOS_STEPS: Final = 400
"""Lanczos steps at most; some 30 to 80 are usual."""

MAX_SUBSTEPS: Final = 1e15
"""Sub-steps beyond which nothing can be counted; how many a run may take is a matter of `riftberg.system.input_files`."""

SINGLE_STEP: Final = {"verlet": 4.0, "runge_kutta": 0.5}
"""Largest squared frequency of bonds times step for schemes without sub-steps: of Verlet the bound of the leapfrog; in
Runge-Kutta others are seen where they were at its start, so that it grows from 0.6 on (hexagonal) or 0.8 (square) even where
bonds are damped critically."""

CONTACT_LIMIT: Final = 1.0
"""The same of one pair of bergs whose contact acts in the long step. They may get into each other by a whole step of their
closing speed v before contact is seen, and ``2 k v dt`` in a step is then more than they came with."""

BIN_WIDTH: Final = 0.01
"""Width of the bins of the logarithm of sizes; in a new bin sub-steps are chosen anew. Far less than the margin of
``stepping.safety``."""

STEADY: Final = 12.0
"""Long steps in a bending period of the berg from which on the stress is within 1 kPa of that in equilibrium (numerics page)."""

FIRST_MODE: Final = 22.373
"""Square of the first eigenvalue of a free beam, ``cos(k) cosh(k) = 1``."""


def critical_time_step(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> float:
    """Largest stable sub-step in seconds; infinite without bonds.

    At most a hundredth below the exact limit of the linearised lattice, never above it: see
    `SubstepMatrix`. For one oscillator ``x'' + c x' + w^2 x = 0`` it is
    ``(sqrt(c^2 + 4 w^2) - c) / w^2``, which is 2 / w without damping.
    """
    if p.bonds.law == "none" or not np.any(bonds.status == 0):
        return math.inf
    fastest = largest_eigenvalue(SubstepMatrix(p, elements, bonds, sizes))
    if not math.isfinite(fastest):
        return 0.0
    return 1.0 / fastest if fastest > 0.0 else math.inf


def _directions(p: Parameters, elements: Elements, first: Ints, second: Ints) -> tuple[Floats, Floats]:
    """Unit vectors from the second to the first elements (equations 2.2)."""
    dx, dy = elements.lon[first] - elements.lon[second], elements.lat[first] - elements.lat[second]
    if p.earth.period > 0.0:
        dx -= p.earth.period * np.floor(dx / p.earth.period + 0.5)
    if p.earth.latlon:
        dx *= np.cos(np.radians(0.5 * (elements.lat[first] + elements.lat[second])))
    length = np.hypot(dx, dy)
    return dx / length, dy / length


def _dem_stiffness(
    p: Parameters, radii: tuple[Floats, Floats], thickness: Floats, i: Ints, j: Ints
) -> tuple[Floats, Floats, Floats]:
    """Normal, shear (N m-1) and bending (N m) stiffness of undeformed bonds (equations 5.4)."""
    r1, r2 = radii
    rest = r1 + r2
    reach = np.minimum(r1, r2) / rest
    width = 2.0 * (np.minimum(r1, r2) + reach * np.abs(r1 - r2))
    of_smaller, of_larger = np.where(r2 <= r1, (thickness[j], thickness[i]), (thickness[i], thickness[j]))
    height = of_smaller + reach * (of_larger - of_smaller)
    if p.quirks.bond_thickness_of_second:
        height = np.maximum(thickness[i], thickness[j]) + reach * np.abs(thickness[i] - thickness[j])
    beam = p.bonds.youngs_modulus * height * width / rest
    shear = 0.0 * beam if p.bonds.no_shear else beam * (0.5 / (1.0 + p.bonds.poisson))
    return beam, shear, beam * width**2 / 12.0


def _radii_when_formed(p: Parameters, rest: Floats, r1: Floats, r2: Floats) -> tuple[Floats, Floats]:
    """Radii (m) of both ends as the bond knows them; it keeps the shape with which it formed."""
    formed = np.where(np.isnan(rest) | p.quirks.rest_length_from_sizes, 1.0, rest / (r1 + r2))
    return r1 * formed, r2 * formed


def _dem_damping(p: Parameters, sizes: Sizes, i: Ints, j: Ints) -> Floats:
    """Damping constant of the bonds, kg s-1 (equations 5.4)."""
    plane = 2.0 * p.bonds.youngs_modulus / (3.0 * (1.0 - p.bonds.poisson**2))
    m1, m2 = sizes.bond_mass[i], sizes.bond_mass[j]
    return np.asarray(p.bonds.damping * np.sqrt(plane * m1 * m2 / (m1 + m2)))


def _spring_stiffness(p: Parameters, rest: Floats) -> Floats:
    """Stiffness (s-2) of spring bonds of some rest lengths (m): as given, or that of the ice (equations 5.2; Riftberg)."""
    if p.bonds.spring is None:
        return np.asarray(p.kernel_values().modulus / rest**2)
    return np.full(rest.shape, p.bonds.spring)


def _spring_damping(p: Parameters, stiffness: Floats) -> tuple[Floats, Floats]:
    """Radial and tangential damping (s-1) of spring bonds; 0 where it is quadratic and has no linear part (equations 5.2)."""
    c, ones = p.contact, np.ones_like(stiffness)
    if p.quirks.damping_by_speed:
        return 0.0 * ones, 0.0 * ones
    if not c.critical_damping:
        return c.radial_damping * ones, c.tangential_damping * ones
    full = 2.0 * stiffness**0.5
    return full, full / 4.0 if c.tangential_critical_damping else c.tangential_damping * ones


class SubstepMatrix:
    """The matrix whose largest eigenvalue is the inverse of the longest stable sub-step (s-1), as the product with a vector.

    The intact bonds are linearised about the present positions, without strain. A vector holds the three strains of all bonds
    (extension, slip, bend), then the mass-weighted velocities (u, v, spin) of all elements.
    """

    def __init__(self, p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> None:
        on = bonds.status == 0
        i, j, rest = bonds.first[on], bonds.second[on], bonds.rest_length[on]
        nothing = np.zeros(i.size)
        r1, r2 = _radii_when_formed(p, rest, sizes.bond_radius[i], sizes.bond_radius[j])
        if p.bonds.law == "dem":
            stiffness = _dem_stiffness(p, (r1, r2), elements.thickness, i, j)
            damper = _dem_damping(p, sizes, i, j)
            slip, tangent = (damper, nothing) if p.bonds.objective_damping else (nothing, damper)
            self._damping = damper, slip, tangent, damper
        else:
            least = np.minimum(sizes.bond_mass[i], sizes.bond_mass[j])
            spring = _spring_stiffness(p, r1 + r2)
            stiffness = spring * least, nothing, nothing
            radial, tangential = _spring_damping(p, spring)
            self._damping = radial * least, nothing, tangential * least, nothing
        moves = np.where(elements.static < 0.5, 1.0, 0.0)
        weight = moves / np.sqrt(sizes.bond_mass)
        self._weight = np.stack([weight, weight, moves / (np.sqrt(0.5 * sizes.bond_mass) * sizes.bond_radius)])
        self._i, self._j, self._r1, self._r2, self._count = i, j, r1, r2, elements.size
        self._nx, self._ny = _directions(p, elements, i, j)
        self._root = tuple(np.sqrt(k) for k in stiffness)
        self.size = 3 * (i.size + elements.size)

    def __matmul__(self, vector: Floats) -> Floats:
        """Return the product with a vector."""
        i, j, nx, ny, r1, r2 = self._i, self._j, self._nx, self._ny, self._r1, self._r2
        strain, (u, v, spin) = vector[: 3 * i.size].reshape(3, -1), vector[3 * i.size :].reshape(3, -1) * self._weight
        du, dv = u[i] - u[j], v[i] - v[j]
        tangent = ny * du - nx * dv
        rates = nx * du + ny * dv, tangent + r1 * spin[i] + r2 * spin[j], spin[i] - spin[j]
        (normal, shear, bend), (c_normal, c_slip, c_tangent, c_spin) = self._root, self._damping
        out = np.empty(self.size)
        for row, root, rate in zip(out[: 3 * i.size].reshape(3, -1), self._root, rates, strict=True):
            row[:] = 0.5 * root * rate
        # The transposed product: what the strains and their rates do to the elements at both ends.
        along = normal * strain[0] + c_normal * rates[0]
        slip = shear * strain[1] + c_slip * rates[1]
        turning = bend * strain[2] + c_spin * rates[2]
        across = slip + c_tangent * tangent
        forces = out[3 * i.size :].reshape(3, -1)
        fx, fy = nx * along + ny * across, ny * along - nx * across
        for row, on_first, on_second in zip(
            forces, (fx, fy, r1 * slip + turning), (-fx, -fy, r2 * slip - turning), strict=True
        ):
            row[:] = np.bincount(i, on_first, self._count) + np.bincount(j, on_second, self._count)
        forces *= 0.5 * self._weight
        return out


def largest_eigenvalue(matrix: SubstepMatrix) -> float:
    """Return an upper estimate of the largest eigenvalue (s-1) of a symmetric matrix; not a number where it overflows.

    By Lanczos' method, of which the largest eigenvalue needs no more than the last two vectors. The residual of the Ritz vector
    is added to the Ritz value, so that the estimate errs to the safe side by at most `ACCURACY`.
    """
    vector = np.random.default_rng(1).standard_normal(matrix.size)  # fixed: the same lattice, the same sub-step
    vector /= np.linalg.norm(vector)
    previous, beta, value, residual = vector, 0.0, 0.0, 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    with np.errstate(over="ignore", invalid="ignore"):
        for n in range(1, MAX_LANCZOS_STEPS + 1):
            new = matrix @ vector
            diagonal.append(float(new @ vector))
            new -= diagonal[-1] * vector + beta * previous
            beta = float(np.linalg.norm(new))
            if not np.isfinite(beta):
                return np.nan
            ended = beta <= 1e-10 * max(map(abs, diagonal))  # nothing is left that the vectors so far do not span
            if ended or n % 5 == 0:
                values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, -1))  # reads the lower half
                value, residual = float(values[-1]), beta * abs(float(vectors[-1, -1]))
            if ended or (n % 5 == 0 and residual <= ACCURACY * value):
                break
            beside.append(beta)
            previous, vector = vector, new / beta
    return value + residual


def choose_substeps(p: Parameters, elements: Elements, bonds: Bonds, sizes: Sizes) -> int:
    """Return the number of sub-steps in a long step: as given (and checked), or the smallest that is safe."""
    fixed: int | None = p.stepping.substeps
    if fixed is not None and (p.quirks.zero_start or not p.stepping.explicit_substeps):
        return fixed
    dt, stable = p.time_step, critical_time_step(p, elements, bonds, sizes)
    required = dt / (p.stepping.safety * stable) if stable > 0.0 else math.inf
    if not required < MAX_SUBSTEPS:
        raise InputError(
            f"no sub-step of these bonds is stable (the longest is {stable:.3g} s)",
            where="stepping.substeps",
            remedy="Look at thickness, radius, ice.density and bonds.youngs_modulus: one of them is far out of range",
        )
    least = max(1, math.ceil(required - 1e-9)) if math.isfinite(stable) else 1
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
    p, dt = run.parameters, run.parameters.time_step
    scheme = p.stepping.scheme
    if p.quirks.zero_start or p.stepping.frozen or p.stepping.fixed_velocity is not None:
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
    if 2.0 * k * dt * dt > CONTACT_LIMIT and np.ptp(run.elements.body.berg) > 0:
        longest = math.sqrt(0.5 * CONTACT_LIMIT / k)
        raise InputError(
            f"contact of {k:g} s-2 swings in {2.0 * math.pi / math.sqrt(2.0 * k):.3g} s, and the step of {dt:g} s, in which it "
            f"acts, is longer than the {longest:.3g} s that this bears",
            where="contact.spring",
            remedy="Leave it out to have what the step can resolve, or take stepping.scheme = 'mts' with contact.on_substeps",
        )


def _spring_frequency(run: RunState) -> float:
    """Bound of the largest squared frequency (s-2) of KID's spring bonds: twice the stiffest sum over one element."""
    el, bonds, c = run.elements, run.bonds, run.constants
    intact = np.flatnonzero(bonds.status == 0)
    if intact.size == 0:
        return 0.0
    i, j = bonds.first[intact], bonds.second[intact]
    mass = el.body.mass
    metric = Metric(c.latlon, c.earth_radius, c.period)
    x, y = separations(metric, el.place.lon[i], el.place.lat[i], el.place.lon[j], el.place.lat[j])
    squared = np.maximum(x * x + y * y, 1e-300)
    stiffness = np.full(i.size, c.spring) if c.spring >= 0.0 else c.modulus / squared
    lighter = stiffness * np.minimum(mass[i], mass[j]) / squared
    sums = np.zeros((el.size, 2, 2))
    for end in (i, j):
        along = np.stack([x, y], axis=-1)
        np.add.at(sums, end, (lighter / mass[end])[:, None, None] * along[:, :, None] * along[:, None, :])
    return 2.0 * float(np.linalg.eigvalsh(sums).max())


def size_bins(elements: Elements) -> tuple[Floats, ...]:
    """Sizes of the bergs that the critical time step depends on, as numbers of bins of `BIN_WIDTH`, for each of their elements.

    Melt changes all sizes in every long step, the critical time step by a part of that; it is found anew where a size passes
    into another bin. The bins are fixed, so that a run that is resumed finds it anew at the same times.
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
        extremes.append(np.floor(np.log(np.maximum(of_berg, 1e-300)) / BIN_WIDTH)[berg])
    return tuple(extremes)


def assign_to_bergs(run: RunState, chosen: NDArray[np.bool_]) -> None:
    """Choose the number of sub-steps of the bergs to which the ``chosen`` elements belong, each for itself.

    Fragments keep the number of the berg that they come from: found anew it would depend on the bonds broken since.
    """
    p, elements, bonds = run.parameters, run.elements, run.bonds
    component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    if p.quirks.bergs_coupled or not component.any():
        sizes = interaction_sizes(elements, run.constants)
        elements.body.substeps[:] = choose_substeps(p, elements, bonds, sizes)
        return
    # All of a berg of which an element was chosen: its lattice vibrates as a whole.
    touched = np.isin(component, component[chosen])
    fixed = p.stepping.substeps
    elements.body.substeps[touched] = 1 if fixed is None else fixed
    bonded = np.bincount(component)[component] > 1
    for k in np.unique(component[touched & bonded]):
        rows = np.flatnonzero(component == k)
        members, between, _ = cut_out(elements, bonds, rows)
        sizes = interaction_sizes(members, run.constants)
        elements.body.substeps[rows] = choose_substeps(p, members, between, sizes)


def bending_period(elements: Elements, parameters: Parameters) -> float:
    """Return the period (s) of the first mode in which the largest berg bends in its plane.

    That of a free beam with the spread of the berg along and across, ``T = 2 pi / 22.4 L^2 sqrt(rho A / (E I))`` with
    ``L^2 = 12 s1^2`` and ``I / A = s2^2``. An estimate and no more: a compact berg is no beam, and shears too.
    """
    p, place = parameters, elements.place
    numbers, counts = np.unique(elements.berg, return_counts=True)
    members = elements.berg == numbers[counts.argmax()]
    lon, lat = place.lon[members], place.lat[members]
    metric = Metric(p.earth.latlon, p.earth.radius, p.earth.period)
    x, y = separations(metric, lon, lat, np.full_like(lon, lon[0]), np.full_like(lat, lat[0]))
    across, along = spread(x, y, elements.body.length[members] * elements.body.width[members])
    speed = math.sqrt(p.bonds.youngs_modulus / p.ice.density)
    return 2.0 * math.pi / FIRST_MODE * 12.0 * along**2 / (speed * across) if speed > 0.0 else math.inf


def resonance_warning(elements: Elements, bonds: Bonds, parameters: Parameters) -> str:
    """Return a warning where the stress in the bonds of a run rings, else nothing.

    Between two outer kicks no drag and no slope act on a lattice that was bent under them, so it swings by as much, and by
    more where a period is a whole number of steps: the resonance that r-RESPA is known for.
    """
    p = parameters
    period = bending_period(elements, p) if _may_resonate(bonds, p) else math.inf
    if p.time_step * STEADY <= period:
        return ""
    breaks = ", so bonds may break that would hold" if p.fracture.enabled else ""
    return (
        f"the stress in the bonds rings: the drag of water and air acts in two impulses per time step of {p.time_step:g} s, "
        f"which is long against the berg's natural period of {duration_text(period / SECONDS_PER_DAY)}{breaks}. "
        "stepping.scheme=quasi_static gives the stress that the ice has to bear"
    )


def _may_resonate(bonds: Bonds, p: Parameters) -> bool:
    """Whether outer kicks act on intact bonds; the reference's numerics are taken as they are."""
    s = p.stepping
    explicit = s.scheme == "mts" and p.bonds.law == "dem" and not p.quirks.zero_start
    return explicit and not (s.only_interactions or s.frozen or s.fixed_velocity) and bool((bonds.status == 0).any())
