"""The ledger of ice and of its heat: stocks, melt water by process and by fragment; it closes, or something is wrong.

The stock of ice is all bergs with all their bits. Its heat is the heat that the ocean would have to give to melt it, with the
sign of the ice: ``(h - L) m``, with the latent heat ``L`` and the heat ``h`` that the ice brings with it.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from riftberg.constants import LATENT_HEAT
from riftberg.errors import InputError
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import by_identifier, summed
from riftberg.state.variables import Life

if TYPE_CHECKING:
    from riftberg.life.melt import MeltStep

PROCESSES: Final = ("base", "sides", "waves", "bergy_bits", "footloose_bits", "footloose_bergy_bits")
"""Ways in which ice becomes melt water. Waves: without what became bits; footloose bits: all melt of theirs."""

SOURCES: Final = ("calved", "unsplit", "not_decayed", "density_reset", "dropped_bits", "other")
"""Ways in which ice comes or goes without melt water: births; the error of losses that act at one time; melt water of bergs
that stay as they are; quirks T45 and T44 of the reference; whatever other processes did."""

MASS_CLOSES: Final = 1e-12
"""Largest error of the ledger of mass, as part of what the ledger turns over."""

HEAT_CLOSES: Final = 1e-10


def latent_deficit(heat_density: Floats) -> Floats:
    """Heat of ice, J kg-1, counted from water at its freezing point."""
    return heat_density - LATENT_HEAT


def stocks(elements: Elements) -> tuple[float, float]:
    """Return ice (kg) and its heat (J) in all elements."""
    mass = scaled_mass(elements.life, elements.body.mass)
    return float(mass.sum()), float((mass * latent_deficit(elements.life.heat_density)).sum())


def mass_in_bits(life: Life) -> float:
    """Ice in bits of all kinds and of all bergs, kg."""
    return float((_bits(life) * life.mass_scaling).sum())


def scaled_mass(life: Life, mass: Floats) -> Floats:
    """Ice in all bergs of each element with all bits, kg."""
    return (mass + _bits(life)) * life.mass_scaling


def _bits(life: Life) -> Floats:
    """Ice in bits of all kinds of one berg of each element, kg."""
    return life.mass_of_bits + life.mass_of_fl_bits + life.mass_of_fl_bergy_bits


class Balance(NamedTuple):
    """The ledger between two moments."""

    start: float  # Ice, kg
    now: float  # Ice, kg
    water: dict[str, float]  # Melt water by process, kg
    gained: dict[str, float]  # Ice that came otherwise, kg; negative where it went
    heat_start: float  # Heat of the ice, J
    heat_now: float  # Heat of the ice, J
    # Heat that the melt water brought to the ocean by process, J; negative, for it takes the latent heat from there
    heat: dict[str, float]
    heat_gained: float  # Heat of the ice that came otherwise, J

    @property
    def error(self) -> float:
        """Residual of the ledger of mass, relative to its turnover; 0 if it closes."""
        came, went = sum(self.gained.values()), sum(self.water.values())
        scale = max(self.start, self.now, abs(came), went, 1e-30)
        return (self.now - self.start - came + went) / scale

    @property
    def heat_error(self) -> float:
        """The same in the ledger of heat."""
        went = sum(self.heat.values())
        scale = max(abs(self.heat_start), abs(self.heat_now), abs(went), abs(self.heat_gained), 1e-30)
        return (self.heat_now - self.heat_start - self.heat_gained + went) / scale

    def lines(self) -> list[str]:
        """Return the ledger as lines of text, in Gt and EJ."""
        rows = [f"ice at the start {self.start / 1e12:.6g} Gt, now {self.now / 1e12:.6g} Gt"]
        for name, mass in self.water.items():
            if mass:
                rows.append(
                    f"  melted, {name.replace('_', ' ')}: {mass / 1e12:.6g} Gt, heat {self.heat[name] / 1e18:.6g} EJ"
                )
        rows += [f"  {name.replace('_', ' ')}: {mass / 1e12:+.6g} Gt" for name, mass in self.gained.items() if mass]
        return [*rows, f"  closes to {abs(self.error):.1e} in mass, {abs(self.heat_error):.1e} in heat"]


class Ledger:
    """Sums over the steps of a run; its numbers live in two arrays that a restart keeps."""

    def __init__(self, elements: Elements) -> None:
        size = 1 + len(PROCESSES) + len(SOURCES)
        self.mass, self.heat = np.zeros(size), np.zeros(size)
        self._lost = np.zeros((2, size))
        self.mass[0], self.heat[0] = self._stock = stocks(elements)

    def find_others(self, elements: Elements) -> None:
        """Enter ice that others have added or removed since the last step of the life of the bergs."""
        mass, heat = stocks(elements)
        if (mass, heat) != self._stock:
            self.gain("other", mass - self._stock[0], heat - self._stock[1])
        self._stock = mass, heat

    def close_step(self, elements: Elements) -> None:
        """Note the stock, so that changes by other hands are found."""
        self._stock = stocks(elements)

    def melted(self, step: MeltStep, by_process: Floats) -> None:
        """Enter a step of melt, and its water as `water_by_process` gives it."""
        unsplit = step.scaling * (step.melted.loss - (step.melted.base + step.melted.sides + step.melted.waves))
        per_mass = latent_deficit(step.heat_density)
        for k, row in enumerate(by_process):
            self._add(1 + k, float(row.sum()), float((row * per_mass).sum()))
        # Losses that do not add up: what is missing in the processes left the ice all the same.
        self.gain("unsplit", -float(unsplit.sum()), -float((unsplit * per_mass).sum()))

    def gain(self, source: str, mass: float, heat: float) -> None:
        """Enter ice (kg) that came otherwise than by freezing, and its heat (J)."""
        self._add(1 + len(PROCESSES) + SOURCES.index(source), mass, heat)

    def _add(self, k: int, mass: float, heat: float) -> None:
        """Add with the error of the sum kept, so that ten thousand steps do not add up theirs."""
        for total, lost, value in ((self.mass, self._lost[0], mass), (self.heat, self._lost[1], heat)):
            corrected = value - lost[k]
            new = total[k] + corrected
            lost[k] = (new - total[k]) - corrected
            total[k] = new

    def balance(self, elements: Elements) -> Balance:
        """Return the ledger from the start to now."""
        mass_now, heat_now = stocks(elements)
        first = 1 + len(PROCESSES)
        return Balance(
            float(self.mass[0]), mass_now, dict(zip(PROCESSES, self.mass[1:first].tolist(), strict=True)),
            dict(zip(SOURCES, self.mass[first:].tolist(), strict=True)), float(self.heat[0]), heat_now,
            dict(zip(PROCESSES, self.heat[1:first].tolist(), strict=True)), float(self.heat[first:].sum()),
        )  # fmt: skip

    def kept(self) -> Floats:
        """Return all numbers as one array, for a restart."""
        stock_row = np.zeros_like(self.mass)
        stock_row[:2] = self._stock
        return np.stack([self.mass, self.heat, *self._lost, stock_row])

    def take_up(self, numbers: Floats) -> None:
        """Go on from the numbers of `kept`."""
        self.mass[:], self.heat[:], self._lost[:] = numbers[0], numbers[1], numbers[2:4]
        self._stock = float(numbers[4, 0]), float(numbers[4, 1])


KEPT: Final = "melt_by_fragment"
"""Name under which a restart keeps the table: a row for each fragment, its number and the water (kg) by process."""


def add_melt(remembered: MutableMapping[str, Floats], fragment: Ints, water: Floats) -> None:
    """Add a step.

    ``fragment``: number of the fragment of each element (shape (elements,)); ``water``: kg (shape (processes,
    elements)).
    """
    table = _table(remembered)
    numbers, sums = summed(table[:, 0].astype(np.int64), table[:, 1:].T, fragment, water)
    remembered[KEPT] = np.stack([numbers.astype(float), *sums], axis=1)


def read_melt(remembered: Mapping[str, Floats], numbers: Ints) -> Floats:
    """Return the melt water (kg) of some fragments, shape (fragments, processes)."""
    table = _table(remembered)
    return by_identifier(table[:, 0].astype(np.int64), table[:, 1:], numbers)


def _table(remembered: Mapping[str, Floats]) -> Floats:
    """Return the table so far."""
    table = np.asarray(remembered.get(KEPT, np.zeros((0, 1 + len(PROCESSES)))))
    if table.ndim != 2 or table.shape[1] != 1 + len(PROCESSES) or table.dtype.kind not in "fiu":
        raise InputError(
            f"a table of shape {table.shape} and type {table.dtype}", where=f"restart file, extra/{KEPT}",
            remedy="Name a restart file that Riftberg wrote",
        )  # fmt: skip
    return table.astype(float)
