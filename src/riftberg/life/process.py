"""The life of the bergs as a part of each long step, and its ledger.

Pieces break off, ice melts, bergs that are gone are removed.

A run whose forcing lacks a field that melt needs is refused before its first step.

The ledger says where the ice of a run went and the heat that took, by process; it closes, or something is wrong. The stock
of ice is all bergs with all their bits. Its heat is the heat that the ocean would have to give to melt it, with the sign of
the ice: ``(h - L) m``, with the latent heat ``L`` and the heat ``h`` that the ice brings with it.
"""

from __future__ import annotations

import calendar
from collections.abc import Callable, Mapping, MutableMapping
from datetime import datetime
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from riftberg.constants import LATENT_HEAT
from riftberg.engines.common.laws import ElementLaw, law_values
from riftberg.errors import InputError
from riftberg.life.births import Circumstances, Living
from riftberg.life.draws import CalvingDraws, OwnDraws
from riftberg.life.footloose import calve_footloose, find_growth, follow_growth, let_children_go
from riftberg.life.melt import NO_RATES, MeltStep, life_values, melt_step, scaled_mass
from riftberg.ocean.forcing import Forcing
from riftberg.ocean.needs import find_missing_water
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import by_identifier, summed

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


def water_by_process(step: MeltStep) -> Floats:
    """Melt water (kg) of each element by process, shape (processes, elements)."""
    m = step.melted
    return step.scaling * np.stack(
        [m.base, m.sides, m.waves - m.bits_born, m.bits_melt, m.fl_loss - m.fl_bits_born, m.fl_bits_melt]
    )


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


def check_water(forcing: Forcing, p: Parameters) -> None:
    """Refuse melt without a temperature, or without a salinity where the law of the base needs one.

    Runs with the reference's numerics take the fields of their driver.
    """
    missing = {} if p.quirks.zero_start else find_missing_water(p, forcing.provides)
    if missing:
        fields = " and ".join(missing.values())
        raise InputError(
            f"bergs are to melt, but there is no {' and no '.join(missing)} of the sea",
            where=f"forcing: {forcing.describe()}",
            remedy=f"Give files with {fields}, or numbers: {' and '.join(f'melt.{name}' for name in missing)}; "
            "or set melt.enabled = false",
        )


LEDGER: Final = "life_ledger"
"""Name under which a restart keeps the ledger."""


def lives(p: Parameters) -> bool:
    """Whether anything but motion changes the bergs of a run."""
    return p.melt.enabled or p.rolling.enabled or p.footloose.enabled


MELTS: Final = ("base", "sides", "waves")
"""What a melt law of one's own gives."""


class LifeModel(Living, Protocol):
    """Members of a model that the life of bergs uses."""

    parameters: Parameters
    constants: KernelParameters
    forcing: Forcing
    outlines: tuple[Any, ...]
    start: datetime
    time: float
    step_number: int
    remembered: dict[str, Floats]


class LifeStep(NamedTuple):
    """Events of a step beside motion."""

    melt: MeltStep
    water: (
        Floats  # Melt water by process, kg; see `riftberg.life.process.water_by_process`; shape (processes, elements)
    )


class LifeProcess:
    """Melt, rolling and footloose calving of a model, once in each long step."""

    def __init__(self, parameters: Parameters, law: ElementLaw | None = None) -> None:
        self.parameters, self.values, self.law = parameters, life_values(parameters), law
        footloose = parameters.footloose
        self.relaxes = footloose.enabled and footloose.modulus == "relaxed"
        self.last: LifeStep | None = None
        self.look_around: Callable[[LifeModel], None] | None = None
        # Depth of the floor of each cell (m), against which ``melt.least_gap`` is held; None for that at the elements.
        self.floor: Floats | None = None
        self.born: Callable[[LifeModel], tuple[int, float]] = birth_date
        self.draws: CalvingDraws = OwnDraws(footloose.seed, parameters.footloose.one_draw)
        self.ranks: tuple[int, int] = (1, 1)
        self.names: Callable[[int, int], int] | None = None
        self._ledger: Ledger | None = None

    def act(self, model: LifeModel) -> None:
        """Calve, melt and remove bergs for a step; the model stands at its end."""
        ledger = self.ledger(model)
        ledger.find_others(model.elements)
        born = self.born(model)
        if self.parameters.footloose.enabled:
            _, heat = stocks(model.elements)
            growth = find_growth(model.elements, model.remembered)[0] if self.relaxes else None
            when = Circumstances(
                *born, model.step_number, model.forcing.grid, self.draws, self.ranks, growth, self.names
            )
            gained = calve_footloose(model, self.parameters, self.values, when)
            warmed = stocks(model.elements)[1] - heat
            let_children_go(model.elements, self.parameters, model.forcing.grid)
            if gained != 0.0:
                ledger.gain("density_reset", gained, warmed)
        if self.look_around is not None:
            self.look_around(model)
        self.follow_outlines(model)
        fragment = model.elements.body.berg.copy()
        rates = NO_RATES
        if self.law is not None:
            rates = law_values(self.law, model.elements, model.time, "melt", MELTS, 0.0, may_leave=True)
        positions = model.elements.place
        depth = None if self.floor is None else self.floor[positions.cell_j, positions.cell_i]
        feet = model.elements.life.fl_k.copy()
        step = melt_step(model.elements, self.values, born, rates, depth)
        if self.relaxes:
            follow_growth(model.elements, step.melted.foot - feet, self.values.dt, model.remembered)
        water = water_by_process(step)
        add_melt(model.remembered, fragment, water)
        if step.gone.any():
            model.remove(step.id[step.gone])
        ledger.melted(step, water)
        # With options of the reference bergs do not decay, or bits are dropped: the ledger closes with these as sources.
        per_mass = latent_deficit(step.heat_density)
        if self.values.keep_shape:
            ledger.gain("not_decayed", float(step.water.sum()), float((step.water * per_mass).sum()))
        elif self.values.drop_orphan_bits:
            dropped = step.melted.dropped * step.scaling
            ledger.gain("dropped_bits", -float(dropped.sum()), -float((dropped * per_mass).sum()))
        self.last = LifeStep(step, water)
        self._keep(model, ledger)

    def follow_outlines(self, model: LifeModel) -> None:
        """Find the fronts along which sides melt; to be called once where the bergs lie at the start, too."""
        if self.values.by_front and not self.values.zero_rates:
            from riftberg.life.ice_fronts import follow_outlines  # with shapely and scipy.spatial, half a second

            follow_outlines(model.elements, model.bonds, model.outlines, model.constants, model.remembered)

    def find_others(self, model: LifeModel) -> None:
        """Enter the changes by others until now; to be called before another process adds ice, see `enter`."""
        ledger = self.ledger(model)
        ledger.find_others(model.elements)
        self._keep(model, ledger)

    def enter(self, model: LifeModel, source: str, mass: float, heat: float) -> None:
        """Enter ice (kg) that another process has just added, and its heat (J), under a name of `ledger.SOURCES`."""
        ledger = self.ledger(model)
        ledger.gain(source, mass, heat)
        self._keep(model, ledger)

    def balance(self, model: LifeModel) -> Balance:
        """Return the ledger from the start of the run to now."""
        ledger = self.ledger(model)
        ledger.find_others(model.elements)
        return ledger.balance(model.elements)

    @staticmethod
    def _keep(model: LifeModel, ledger: Ledger) -> None:
        ledger.close_step(model.elements)
        model.remembered[LEDGER] = ledger.kept()

    def ledger(self, model: LifeModel) -> Ledger:
        """Return the ledger of the run so far, from before the first step or from a restart."""
        if self._ledger is None or LEDGER not in model.remembered:
            self._ledger = Ledger(model.elements)
        if LEDGER in model.remembered:
            self._ledger.take_up(model.remembered[LEDGER])
        return self._ledger


def birth_date(model: LifeModel, *, coming: bool = False) -> tuple[int, float]:
    """Year, and days since its beginning, at the start of the step that has just ended, or of the coming step."""
    date = model.start.replace(tzinfo=None)
    seconds = model.time - (0.0 if coming else model.parameters.time_step)
    days = (date - datetime(date.year, 1, 1)).total_seconds() / 86400.0 + seconds / 86400.0
    year = date.year
    while days >= (length := 366 if calendar.isleap(year) else 365):
        days -= length
        year += 1
    return year, float(np.float64(days))
