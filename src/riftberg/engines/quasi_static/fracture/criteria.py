"""Fracture criteria: which bond of a lattice in equilibrium breaks next, by its own stress, that of the ice, or its toughness.

Strengths of bonds stand here too, and the effects of stress on them: overload, damage, and their record in the state.

`make_criterion` is the one place where a criterion is chosen, and `riftberg.engines.quasi_static.fracture.brittle_lattice` the
one where it is called. A criterion sees the whole lattice, never one bond by itself: `Equilibrium` is the lattice with its
intact bonds, displacements, loads and stresses, `Strengths` the residual strengths after damage. All else follows from what
it answers: the moment within a step at which the first bond fails (the scheme looks for the sign change of "stress over
strength - 1" between both ends), how far a crack runs at once, and how damage grows.

A function of a user takes the place of a criterion by `OwnRatios`. `riftberg.parameters` refuses all of them with the explicit
schemes, which know the stress of single bonds alone.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.config.parameter_groups import Fracture
from riftberg.engines.common.laws import Ratios, law_name, to_read
from riftberg.engines.common.reserves import bond_strengths
from riftberg.engines.quasi_static.fracture.crack_paths import CrackPaths, TipIntensity
from riftberg.engines.quasi_static.fracture.stress_intensity import NONE
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellStiffness, CellStresses
from riftberg.engines.quasi_static.lattice.equilibrium import ElasticLattice, bond_deformation, bond_deformations
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import (
    damage_rate,
    grown_damage,
    residual_strength,
    stress_ratio,
)
from riftberg.physics.elementary import atan2, cos, sin
from riftberg.state import Bonds, Floats, Ints


class Equilibrium:
    """A lattice under its loads, with the stresses of its bonds, found when first needed."""

    def __init__(
        self, lattice: ElasticLattice, intact: Ints, displacement: Floats, load: Floats, cells: CellStiffness | None,
        paths: CrackPaths | None,
    ) -> None:  # fmt: skip
        self.lattice = lattice
        self.intact = intact  # bonds, as rows of the state
        self.displacement = displacement  # m, m and rad; shape (elements, 3)
        self.load = load  # balanced, N, N and N m; shape (elements, 3)
        self._cells, self._paths = cells, paths

    @property
    def cells(self) -> CellStiffness:
        """The elastic cells of bonded ice."""
        assert self._cells is not None
        return self._cells

    @property
    def paths(self) -> CrackPaths:
        """Where cracks end, and where they go."""
        assert self._paths is not None
        return self._paths

    @cached_property
    def _ice(self) -> CellStresses:
        if self._cells is None:
            return CellStresses(
                np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0, np.int64)
            )
        return self._cells.stresses(self.lattice, self.intact, self.displacement, self.load)

    @property
    def triangle_stress(self) -> Floats:
        """Stress (Pa; xx, yy, xy) of the triangles of the cells."""
        return self._ice.triangle

    @property
    def tensor(self) -> Floats:
        """Stress (Pa; xx, yy, xy) of the ice at the intact bonds, shape (intact bonds, 3)."""
        return self._ice.tensor

    @cached_property
    def intensities(self) -> dict[int, TipIntensity]:
        """Stress intensity at the tips of cracks that are long enough, by their rows."""
        if self._cells is None or self._paths is None or not self._paths.tips.crack.size:
            return {}
        return self._paths.intensities(self._ice.displacement, self.load)

    @property
    def bridges(self) -> Ints:
        """Rows among the intact bonds of those that are the last between two parts."""
        return self._ice.bridge

    @cached_property
    def deformation(self) -> Floats:
        """Extension, slip (m) and bend (rad) of the intact bonds, shape (intact bonds, 3)."""
        return bond_deformations(self.lattice, self.intact, self.displacement)

    @property
    def stress(self) -> Floats:
        """Largest tension and shear (Pa) of the ice at the intact bonds, shape (intact bonds, 2)."""
        return self._ice.bond


NORMAL, SHEAR, FLEXURAL = 1, 2, 3
"""Values of ``break_strength``: which strength a bond exceeded when it broke."""


class Strengths(NamedTuple):
    """Stresses at which the intact bonds break."""

    normal: Floats  # Pa; shape (intact bonds,)
    shear: Floats  # Pa; shape (intact bonds,)


def residual_strengths(thickness: Floats, bonds: Bonds, intact: Ints, p: KernelParameters) -> Strengths:
    """Strengths that damage has left to the intact bonds; ``thickness``: of the elements, m."""
    nominal = bond_strengths(thickness, bonds.first[intact], bonds.second[intact], p)
    return Strengths(*_residual_strengths(bonds.strength, bonds.damage, intact, nominal, p.shear_strength))


@kernel
def _residual_strengths(
    strength: Floats, damage: Floats, intact: Ints, nominal: Floats, shear_strength: float
) -> tuple[Floats, Floats]:
    """Return the fields of `Strengths` (no named tuple: see `riftberg.compiled.kernels`)."""
    normal, shear = np.empty(intact.size), np.empty(intact.size)
    for k in range(intact.size):
        b = intact[k]
        normal[k], shear[k] = residual_strength(nominal[k], shear_strength, strength[b], damage[b])
    return normal, shear


@kernel
def most_overloaded(stress: Floats, strengths: Strengths, intact: Ints, left_out: Ints) -> tuple[int, float]:
    """Row of the bond whose stress is highest over its strength, and that ratio; -1 without bonds.

    ``left_out``: sorted rows of the state, as in ``intact``, of bonds that do not count.
    """
    row, highest, n = -1, -np.inf, 0
    for k in range(stress.shape[0]):
        while n < left_out.size and left_out[n] < intact[k]:
            n += 1
        if n < left_out.size and left_out[n] == intact[k]:
            continue
        ratio = stress_ratio(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
        if ratio > highest:
            row, highest = k, ratio
    return row, highest


@kernel
def overloads(stress: Floats, strengths: Strengths) -> Floats:
    """Stress over strength of each intact bond."""
    ratios = np.empty(stress.shape[0])
    for k in range(stress.shape[0]):
        ratios[k] = stress_ratio(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
    return ratios


@kernel
def grow_damage(bonds: Bonds, intact: Ints, damage_drive: Floats, dt: float, p: KernelParameters) -> None:
    """Let the damage of the intact bonds grow over ``dt`` s; ``damage_drive`` is stress over strength in the middle."""
    for k in range(intact.size):
        b = intact[k]
        rate = damage_rate(damage_drive[k], p.damage_threshold, p.damage_time, p.damage_exponent)
        bonds.damage[b] = grown_damage(bonds.damage[b], rate, dt)


@borrower
def store_stresses(
    bonds: Bonds, lattice: ElasticLattice, intact: Ints, displacement: Floats, stress: Floats, levers: Floats
) -> None:
    """Write stresses and deformations of the intact bonds to the state; ``levers``: of its bodies."""
    # Taken out before the loop, inside which numba would count references at each access.
    first, nx, ny, unstrained = lattice.first, lattice.nx, lattice.ny, lattice.length
    normal, shear, peak, length = bonds.normal_stress, bonds.shear_stress, bonds.peak_stress, bonds.bond_length
    shear_x, shear_y, rotation = bonds.shear_x, bonds.shear_y, bonds.relative_rotation
    for k in range(intact.size):
        b = intact[k]
        (e, s, bend), i = bond_deformation(lattice, b, displacement), first[b]
        tx, ty, c, d = ny[b], -nx[b], levers[i, 9], levers[i, 10]
        normal[b], shear[b], peak[b] = stress[k, 0], stress[k, 1], max(peak[b], stress[k, 0])
        length[b] = unstrained[b] + e
        shear_x[b] = s * (c * tx - d * ty)
        shear_y[b] = s * (d * tx + c * ty)
        rotation[b] = bend


@kernel
def begin_peak_stress(peak: Floats, intact: Ints, stress: Floats) -> None:
    """Begin the record of the largest tensile stress (Pa) of each intact bond."""
    for k in range(intact.size):
        peak[intact[k]] = stress[k, 0]


@kernel
def record_peak_stress(peak: Floats, intact: Ints, stress: Floats) -> None:
    """Record the largest tensile stress (Pa) of each intact bond."""
    for k in range(intact.size):
        peak[intact[k]] = max(peak[intact[k]], stress[k, 0])


class Criterion(Protocol):
    """A rule by which bonds break; see the text above for how to add one."""

    def most_critical(self, equilibrium: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """Find which bond breaks next.

        Parameters
        ----------
        equilibrium : Equilibrium
            The lattice under its loads.
        strengths : Strengths
            Strengths of its intact bonds.

        Returns
        -------
        row : int
            Row among the intact bonds (``equilibrium.intact``) of the one that breaks; -1 without bonds. It counts only where
            the ratio is above 1.
        ratio : float
            Stress over strength in the most critical place; above 1 the bond breaks.
        """

    def damage_drive(self, equilibrium: Equilibrium, strengths: Strengths) -> Floats:
        """Find the ratio by which the damage of bonds grows.

        Parameters
        ----------
        equilibrium : Equilibrium
            The lattice under its loads, in the middle of a step.
        strengths : Strengths
            Strengths of its intact bonds.

        Returns
        -------
        Floats
            Stress over strength of each intact bond.
        """


def make_criterion(fracture: Fracture, user_ratios: Ratios | None = None) -> Criterion:
    """Make the criterion that the parameters name; ``user_ratios`` takes its place."""
    if user_ratios is not None:
        return OwnRatios(user_ratios)
    return Toughness(fracture.toughness) if fracture.criterion == "toughness" else IceStress()


class OwnRatios:
    """The function of a user, which knows all bonds at once."""

    def __init__(self, ratios: Ratios) -> None:
        self._ratios = ratios

    def most_critical(self, equilibrium: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        ratios = self.damage_drive(equilibrium, strengths)
        row = int(np.argmax(ratios)) if ratios.size else -1
        return row, float(ratios[row]) if ratios.size else -math.inf

    def damage_drive(self, equilibrium: Equilibrium, strengths: Strengths) -> Floats:
        """See `Criterion`."""
        where = f"Laws, fracture: {law_name(self._ratios)}"
        seen = [
            equilibrium.stress,
            equilibrium.deformation,
            equilibrium.displacement,
            equilibrium.load,
            equilibrium.intact,
        ]
        seen += [equilibrium.tensor, equilibrium.triangle_stress]
        with to_read((seen, equilibrium.lattice, strengths), "equilibrium", where):
            ratios = np.asarray(self._ratios(equilibrium, strengths), np.float64)
        if ratios.shape != equilibrium.intact.shape or np.isnan(ratios).any():
            fault = "a value that is no number" if ratios.shape == equilibrium.intact.shape else f"shape {ratios.shape}"
            raise RunError(f"{where} returns {fault}; there are {equilibrium.intact.size} intact bonds")
        return ratios


class IceStress:
    """The largest tension and shear of the ice at each bond: a strength is the ice's.

    They hardly depend on the direction of a bond, so in one place several are alike: of those that fail there the one
    breaks that is the most nearly in line with the tension.
    """

    def most_critical(self, equilibrium: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        row, ratio = most_overloaded(equilibrium.stress, strengths, equilibrium.intact, NONE)
        if (
            ratio > 1.0
            and stress_ratio(equilibrium.stress[row, 0], 0.0, strengths.normal[row], strengths.shear[row]) == ratio
        ):
            row = _most_in_line(
                equilibrium.lattice, equilibrium.intact, equilibrium.tensor, equilibrium.stress, strengths, row
            )
        return row, ratio

    def damage_drive(self, equilibrium: Equilibrium, strengths: Strengths) -> Floats:
        """See `Criterion`."""
        return overloads(equilibrium.stress, strengths)


class Toughness(IceStress):
    """A crack goes on where the stress intensity at its tip reaches the toughness; elsewhere, and while it is short, by strength.

    ``toughness``: K_Ic, Pa m^(1/2).
    """

    def __init__(self, toughness: float) -> None:
        self._toughness = toughness

    def most_critical(self, equilibrium: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        at_tips = equilibrium.intensities
        if not at_tips:
            return super().most_critical(equilibrium, strengths)
        # Beside tips the toughness alone decides.
        row, ratio = most_overloaded(
            equilibrium.stress, strengths, equilibrium.intact, equilibrium.paths.bonds_beside_tips()
        )
        for k in sorted(at_tips.values(), key=lambda k: k.hoop, reverse=True):
            share = k.hoop / self._toughness
            if share <= ratio:
                break
            if share <= 1.0:
                return row, share  # nothing breaks, so it does not matter which bond the crack would cross
            if (crossing := equilibrium.paths.find_crossing(k.tip, equilibrium.triangle_stress, k)) is not None:
                return int(np.searchsorted(equilibrium.intact, crossing.bond)), share
        return row, ratio


@kernel
def _most_in_line(
    lattice: ElasticLattice, intact: Ints, tensor: Floats, stress: Floats, strengths: Strengths, row: int
) -> int:
    """Row of the failing bond at either end of the one in ``row`` that is the most nearly in line with the tension there."""
    angle = 0.5 * atan2(2.0 * tensor[row, 2], tensor[row, 0] - tensor[row, 1])
    x, y, i, j = cos(angle), sin(angle), lattice.first[intact[row]], lattice.second[intact[row]]
    best = row
    nearest = abs(lattice.nx[intact[row]] * x + lattice.ny[intact[row]] * y)
    for k in range(intact.size):
        b = intact[k]
        first, second = lattice.first[b], lattice.second[b]
        if first != i and first != j and second != i and second != j:
            continue
        in_line = abs(lattice.nx[b] * x + lattice.ny[b] * y)
        fails = stress_ratio(stress[k, 0], 0.0, strengths.normal[k], strengths.shear[k]) > 1.0
        if fails and in_line > nearest + 1e-9:
            best, nearest = k, in_line
    return best
