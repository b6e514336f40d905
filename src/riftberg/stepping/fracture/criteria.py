"""What decides that a bond breaks in equilibrium: its own stress, or the stress averaged over a distance.

Both answer the same questions about the bonds that hold, by their rows in ``intact``: which is the most overloaded
place, when within a step the first is reached, and which bond breaks there.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from riftberg.compiled.kernels import kernel
from riftberg.config.parameter_groups import Fracture
from riftberg.parameters import KernelParameters
from riftberg.physics.averaging import critical_distance, disc_of_lattice, disc_weight, principal
from riftberg.physics.damage import stress_ratio
from riftberg.state import Floats, Ints
from riftberg.stepping.fracture.strengths import Strengths, first_failure, first_overload, most_overloaded, overload
from riftberg.stepping.lattice.equilibrium import ElasticLattice, bond_deformation, deformations_and_stresses

SAFE_RATIO = 1.0 - 1e-9
"""Stress over strength at the end of a step below which nothing has failed in it: stress is largest at one of its ends."""

CHUNK = 512
"""Bonds whose discs are looked for at once: as a list a disc takes several times the memory that it has as an array."""


class Equilibrium:
    """A lattice under its loads, with the stress of its bonds, found when it is first asked for.

    ``displacement``: displacements, m, m and rad (shape (elements, 3)).
    """

    def __init__(self, lattice: ElasticLattice, intact: Ints, displacement: Floats, p: KernelParameters) -> None:
        self.lattice, self.intact, self.displacement, self._p = lattice, intact, displacement, p

    @cached_property
    def _found(self) -> tuple[Floats, Floats]:
        return deformations_and_stresses(self.lattice, self.intact, self.displacement, self._p)

    @property
    def deformation(self) -> Floats:
        """Extension, slip (m) and bend (rad) of the bonds that hold, shape (bonds that hold, 3)."""
        return self._found[0]

    @property
    def stress(self) -> Floats:
        """Tensile and shear stress (Pa) of the bonds that hold, shape (bonds that hold, 2)."""
        return self._found[1]


class Criterion(Protocol):
    """When and where bonds break."""

    def first_failure(self, before: Floats, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """Row of the place that is overloaded first from displacements to an equilibrium (-1: none), and the part of the step."""

    def most_critical(self, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """Row of the most overloaded place and its stress over strength; above 1 it breaks (-1 without bonds)."""

    def failing_bond(self, row: int, now: Equilibrium, strengths: Strengths) -> int:
        """Row of the bond that breaks where the place ``row`` is overloaded."""

    def damage_drive(self, now: Equilibrium, strengths: Strengths) -> Floats:
        """Stress over strength for the growth of damage, for each bond that holds."""


class BondStress:
    """Each bond by its own stress."""

    def __init__(self, lattice: ElasticLattice, p: KernelParameters) -> None:
        self._lattice, self._p = lattice, p

    def first_failure(self, before: Floats, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        if most_overloaded(now.stress, strengths)[1] < SAFE_RATIO:
            return -1, 1.0
        return first_failure(self._lattice, now.intact, before, now.displacement, strengths, self._p)

    def most_critical(self, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        return most_overloaded(now.stress, strengths)

    def failing_bond(self, row: int, now: Equilibrium, strengths: Strengths) -> int:
        """See `Criterion`."""
        return row

    def damage_drive(self, now: Equilibrium, strengths: Strengths) -> Floats:
        """See `Criterion`."""
        return _damage_ratios(now.stress, strengths)


class AveragedStress:
    """The largest tension and shear of the stress averaged over a disc (`riftberg.physics.averaging`).

    The disc lies around the middle of each bond that holds and takes in the elements of the same fragment. Where its
    mean is above the strength, the bond breaks that is itself the most loaded in the disc: the one at the tip.

    ``xy``: places in the fragments, m (shape (elements, 2)); ``body``: fragment of each element (shape (elements,));
    ``volume``: of the ice, m3 (shape (elements,)); ``distance``: characteristic distance, m.
    """

    def __init__(
        self, lattice: ElasticLattice, intact: Ints, xy: Floats, body: Ints, volume: Floats, distance: float,
        p: KernelParameters,
    ) -> None:  # fmt: skip
        self._lattice, self._p, self._volume = lattice, p, volume
        spacing = float(lattice.rest[intact].max()) if intact.size else 1.0
        self.radius, self._scale = disc_of_lattice(distance, spacing)
        self._middle = 0.5 * (xy[lattice.first] + xy[lattice.second])
        self._body = body[lattice.first]
        self._start, self._member, self._weight = self._discs(intact, xy, body)

    def _discs(self, intact: Ints, xy: Floats, body: Ints) -> tuple[Ints, Ints, Floats]:
        """Elements in the disc of each bond and their weights; a row for each bond of the state."""
        far = 4.0 * (float(np.abs(xy).max(initial=0.0)) + self.radius)  # fragments have frames of their own
        tree = cKDTree(np.column_stack([xy, far * body]))
        places = np.column_stack([self._middle[intact], far * self._body[intact]])
        counts, members = np.zeros(self._middle.shape[0] + 1, np.int64), [np.zeros(0, np.int64)]
        for begin in range(0, intact.size, CHUNK):
            inside = tree.query_ball_point(places[begin : begin + CHUNK], self.radius, return_sorted=True)
            counts[intact[begin : begin + CHUNK] + 1] = [len(near) for near in inside]
            members.extend(np.array(near, np.int64) for near in inside)
        member, start = np.concatenate(members), np.cumsum(counts)
        return start, member, _weights(intact, start, member, xy, self._middle, self._volume, self.radius)

    def _means(self, intact: Ints, displacement: Floats) -> Floats:
        stress = element_stresses(self._lattice, intact, displacement, self._volume, self._p)
        return _averaged(intact, self._start, self._member, self._weight, stress)

    def first_failure(self, before: Floats, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        scaled = Strengths(self._scale * strengths.normal, self._scale * strengths.shear)
        one, two = self._means(now.intact, before), self._means(now.intact, now.displacement)
        return first_overload(one, two, scaled, True, self._lattice, now.intact, self._p)

    def most_critical(self, now: Equilibrium, strengths: Strengths) -> tuple[int, float]:
        """See `Criterion`."""
        return most_overloaded(_strongest(self._means(now.intact, now.displacement)) / self._scale, strengths)

    def failing_bond(self, row: int, now: Equilibrium, strengths: Strengths) -> int:
        """See `Criterion`."""
        here = now.intact[row]
        return _most_loaded_near(now.intact, now.stress, strengths, self._middle, self._body, here, self.radius)

    def damage_drive(self, now: Equilibrium, strengths: Strengths) -> Floats:
        """See `Criterion`."""
        return _damage_ratios(_strongest(self._means(now.intact, now.displacement)) / self._scale, strengths)


def characteristic_distance(fracture: Fracture) -> float:
    """Distance (m) of the averaging: as it is set, or as strength and toughness of the ice give it."""
    if fracture.criterion == "toughness":
        return critical_distance(fracture.toughness, fracture.normal_strength)
    return fracture.distance


@kernel
def element_stresses(
    lattice: ElasticLattice, intact: Ints, displacement: Floats, volume: Floats, p: KernelParameters
) -> Floats:
    """Mean stress (Pa) in each element, in the axes of its fragment: xx, yy, xy; tension is positive.

    ``sigma = (1 / V) sum over bonds of sym(r F)`` with r from the middle of the element to the bond and F the pull of the
    bond (Love 1927; Bagi 1996, Mechanics of Materials 22). It is that of a uniform stress exactly, in both packings.
    """
    stress = np.zeros((volume.size, 3))
    for k in range(intact.size):
        b = intact[k]
        e, s, _ = bond_deformation(lattice, displacement, b)
        fn, fs = lattice.stiffness[b, 0] * e, lattice.stiffness[b, 1] * s
        nx, ny = lattice.nx[b], lattice.ny[b]
        xx, yy, xy = (
            fn * nx * nx + fs * nx * ny,
            fn * ny * ny - fs * nx * ny,
            fn * nx * ny + 0.5 * fs * (ny * ny - nx * nx),
        )
        for end in range(2):
            i = lattice.first[b] if end == 0 else lattice.second[b]
            arm = lattice.strain_operator[b, 1, 2 if end == 0 else 5] * lattice.radius[i] / volume[i]
            stress[i, 0] += arm * xx
            stress[i, 1] += arm * yy
            stress[i, 2] += arm * xy
    return stress


@kernel
def _weights(
    intact: Ints, start: Ints, member: Ints, xy: Floats, middle: Floats, volume: Floats, radius: float
) -> Floats:
    """Weights of the elements of each disc, by their volume; they add to 1."""
    weight = np.zeros(member.size)
    for b in intact:
        total = 0.0
        for n in range(start[b], start[b + 1]):
            e = member[n]
            away = np.hypot(xy[e, 0] - middle[b, 0], xy[e, 1] - middle[b, 1])
            weight[n] = volume[e] * disc_weight(away, radius)
            total += weight[n]
        for n in range(start[b], start[b + 1]):
            weight[n] /= total
    return weight


@kernel
def _averaged(intact: Ints, start: Ints, member: Ints, weight: Floats, stress: Floats) -> Floats:
    """Averaged stress tensor around each bond that holds, shape (bonds that hold, 3)."""
    mean = np.zeros((intact.size, 3))
    for k in range(intact.size):
        for n in range(start[intact[k]], start[intact[k] + 1]):
            for c in range(3):
                mean[k, c] += weight[n] * stress[member[n], c]
    return mean


@kernel
def _strongest(mean: Floats) -> Floats:
    """Largest tension and shear (Pa) of each tensor, shape (places, 2)."""
    extremes = np.empty((mean.shape[0], 2))
    for k in range(mean.shape[0]):
        extremes[k, 0], extremes[k, 1] = principal(mean[k, 0], mean[k, 1], mean[k, 2])
    return extremes


@kernel
def _most_loaded_near(
    intact: Ints, own: Floats, strengths: Strengths, middle: Floats, body: Ints, here: int, radius: float
) -> int:
    """Row of the bond within the disc around the bond ``here`` that is the most loaded for its strength."""
    best, highest = -1, -np.inf
    for k in range(intact.size):
        b = intact[k]
        if body[b] != body[here]:
            continue
        away = np.hypot(middle[b, 0] - middle[here, 0], middle[b, 1] - middle[here, 1])
        ratio = overload(own[k, 0], own[k, 1], strengths.normal[k], strengths.shear[k])
        if away < radius and ratio > highest:
            best, highest = k, ratio
    return best


@kernel
def _damage_ratios(stress: Floats, strengths: Strengths) -> Floats:
    """Stress over strength as the growth of damage takes it."""
    damage_drive = np.empty(stress.shape[0])
    for k in range(stress.shape[0]):
        damage_drive[k] = stress_ratio(stress[k, 0], stress[k, 1], strengths.normal[k], strengths.shear[k])
    return damage_drive
