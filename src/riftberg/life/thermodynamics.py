"""One step of melt applied to the population: bergs become smaller, roll, or are gone; what the ocean gets is reported.

Source: files 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.life.melted import Melted, melted
from riftberg.life.values import LifeValues
from riftberg.state import Elements, Floats, Ints, Life, Place


class MeltStep(NamedTuple):
    """What the ocean got in one step, for whoever hands it on; the rows are those of the elements before any was removed."""

    id: Ints  # Elements
    place: Place  # Where they were: positions, cells, places in the cells
    scaling: Floats  # Number of bergs that each stands for: everything in ``melted`` is for one of them
    heat_density: Floats  # Heat that the ice brings with it, J kg-1
    start_mass: Floats  # Mass at calving, kg
    u: Floats  # Velocity, m s-1
    v: Floats  # Velocity, m s-1
    melted: Melted  # Losses and remains
    gone: NDArray[np.bool_]  # Elements of which nothing is left; they are removed

    @property
    def water(self) -> Floats:
        """Melt water of all bergs of each element, kg."""
        return self.melted.water * self.scaling


def melt_step(elements: Elements, values: LifeValues, born: tuple[int, float]) -> MeltStep:
    """Melt all elements by one long step and change them; those of which nothing is left are marked, not removed."""
    body, life = elements.body, elements.life
    result = melted(elements, values)
    place = Place(*(getattr(elements, name).copy() for name in Place._fields))
    step = MeltStep(
        body.id.copy(), place, life.mass_scaling.copy(), life.heat_density.copy(), life.start_mass.copy(),
        elements.motion.u.copy(), elements.motion.v.copy(), result, np.zeros(body.id.size, bool),
    )  # fmt: skip
    life.fl_k[:] = result.foot
    if values.keep_shape:
        return step
    _store(elements, result)
    empty = result.mass <= 0.0
    replaced = empty & (result.fl_bits > 0.0)
    if replaced.any():
        _let_bits_replace(elements, result, replaced, values.rho_ice, born)
    step.gone[:] = empty & ~replaced
    return step


def _store(elements: Elements, result: Melted) -> None:
    """Take mass, sizes and bits over; the longer side is the length (files, 1.12)."""
    body, life = elements.body, elements.life
    body.mass[:], body.thickness[:] = result.mass, result.thickness
    body.width[:] = np.minimum(result.width, result.length)
    body.length[:] = np.maximum(result.width, result.length)
    life.mass_of_bits[:], life.mass_of_fl_bits[:] = result.bits, result.fl_bits
    life.mass_of_fl_bergy_bits[:] = result.fl_bergy_bits


def _let_bits_replace(
    elements: Elements, result: Melted, rows: NDArray[np.bool_], rho_ice: float, born: tuple[int, float]
) -> None:
    """Where a berg has melted but its footloose bits have not, they go on in its place (files, 1.12)."""
    body, life = elements.body, elements.life
    thickness, width, length = (a[rows] for a in (result.fl_thickness, result.fl_width, result.fl_length))
    mass = length * width * thickness * rho_ice
    before = life.mass_scaling[rows]
    scaling = result.fl_bits[rows] * before / mass
    body.mass[rows], body.thickness[rows], body.width[rows], body.length[rows] = mass, thickness, width, length
    life.mass_of_bits[rows] = result.fl_bergy_bits[rows] * before / scaling
    life.mass_of_fl_bits[rows] = life.mass_of_fl_bergy_bits[rows] = 0.0
    life.mass_scaling[rows], life.fl_k[rows] = scaling, -1.0
    life.start_year[rows], life.start_day[rows] = born


def mass_in_bits(life: Life) -> float:
    """Ice in bits of all kinds and of all bergs, kg."""
    return float((_bits(life) * life.mass_scaling).sum())


def scaled_mass(life: Life, mass: Floats) -> Floats:
    """Ice in all bergs of each element with all bits, kg."""
    return (mass + _bits(life)) * life.mass_scaling


def _bits(life: Life) -> Floats:
    """Ice in bits of all kinds of one berg of each element, kg."""
    return life.mass_of_bits + life.mass_of_fl_bits + life.mass_of_fl_bergy_bits
