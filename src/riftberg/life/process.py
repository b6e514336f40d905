"""The life of the bergs as a part of each long step: pieces break off, ice melts, bergs that are gone are removed.

A run whose forcing lacks what melt needs is refused before its first step.
"""

from __future__ import annotations

import calendar
from collections.abc import Callable, Container
from datetime import datetime
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from riftberg.errors import InputError
from riftberg.life.footloose import Calved, Circumstances, Draws, Living, OwnDraws, calve_footloose, let_children_go
from riftberg.life.ledger import Balance, Ledger, add_melt, latent_deficit, stocks, water_by_process
from riftberg.life.melt import NO_RATES, MeltStep, life_values, melt_step
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Floats
from riftberg.stepping.laws import ElementLaw, rows_of


def check_water(forcing: Forcing, p: Parameters) -> None:
    """Refuse melt without a temperature, or without a salinity where the law of the base needs one.

    Runs with the reference's numerics take what their driver hands over.
    """
    missing = {} if p.compatibility.zero_start else missing_water(p, provided(forcing))
    if missing:
        fields = " and ".join(missing.values())
        raise InputError(
            f"bergs are to melt, but there is no {' and no '.join(missing)} of the sea",
            where=f"forcing: {forcing.describe()}",
            remedy=f"Give files with {fields}, or numbers: {' and '.join(f'melt.{name}' for name in missing)}; "
            "or set melt.enabled = false",
        )


def missing_water(p: Parameters, known: Container[str]) -> dict[str, str]:
    """Return what melt needs of the sea and has neither as a number nor from the known fields: field by name."""
    melt = p.melt
    if not melt.enabled or p.compatibility.zero_rates:
        return {}
    salty = melt.base != "turbulent" and melt.mode != "berg" and melt.salinity_from_ocean
    wanted = [("temperature", "sst", melt.temperature), *([("salinity", "sss", melt.salinity)] if salty else [])]
    return {name: field for name, field, number in wanted if number is None and field not in known}


def provided(forcing: Forcing) -> frozenset[str]:
    """Return which variables around the elements a forcing knows; empty where it does not say."""
    return frozenset(getattr(forcing, "provides", ()))


LEDGER: Final = "life_ledger"
"""Name under which a restart keeps the ledger."""


def lives(p: Parameters) -> bool:
    """Whether anything but motion changes the bergs of a run."""
    return p.melt.enabled or p.rolling.enabled or p.footloose.enabled


MELTS: Final = ("base", "sides", "waves")
"""What a melt law of one's own gives."""


class LifeModel(Living, Protocol):
    """What the life of bergs asks of a model."""

    parameters: Parameters
    constants: KernelParameters
    forcing: Forcing
    outlines: tuple[Any, ...]
    start: datetime
    time: float
    step_number: int
    remembered: dict[str, Floats]


class LifeStep(NamedTuple):
    """What happened in a step beside motion."""

    melt: MeltStep
    calved: Calved | None  # Of footloose calving; None without
    water: Floats  # Melt water by process, kg; see `riftberg.life.ledger.water_by_process`; shape (processes, elements)


class LifeProcess:
    """Melt, rolling and footloose calving of a model, once in each long step."""

    def __init__(self, parameters: Parameters, law: ElementLaw | None = None) -> None:
        self.parameters, self.values, self.law = parameters, life_values(parameters), law
        own = parameters.footloose
        self.last: LifeStep | None = None
        self.look_around: Callable[[LifeModel], None] | None = None
        self.born: Callable[[LifeModel], tuple[int, float]] = date_of_birth
        self.draws: Draws = OwnDraws(own.seed, parameters.compatibility.one_draw)
        self.ranks: tuple[int, int] = (1, 1)
        self.names: Callable[[int, int], int] | None = None
        self._ledger: Ledger | None = None

    def act(self, model: LifeModel) -> None:
        """Do what a step does to bergs beside moving them; the model stands at its end."""
        ledger = self.ledger(model)
        ledger.find_others(model.elements)
        born = self.born(model)
        calved = self._calve(model, born, ledger) if self.parameters.footloose.enabled else None
        if self.look_around is not None:
            self.look_around(model)
        self.follow_outlines(model)
        fragment = model.elements.body.berg.copy()
        rates = NO_RATES if self.law is None else rows_of(self.law, model.elements, model.time, "melt", MELTS, 0.0)
        step = melt_step(model.elements, self.values, born, rates)
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
        self.last = LifeStep(step, calved, water)
        self._keep(model, ledger)

    def follow_outlines(self, model: LifeModel) -> None:
        """Find the fronts along which sides melt; to be called once where the bergs lie at the start, too."""
        if self.values.by_front and not self.values.zero_rates:
            from riftberg.life.ice_fronts import follow_outlines  # with shapely and scipy.spatial, half a second

            follow_outlines(model.elements, model.bonds, model.outlines, model.constants, model.remembered)

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

    def _calve(self, model: LifeModel, born: tuple[int, float], ledger: Ledger) -> Calved:
        before = stocks(model.elements)
        when = Circumstances(*born, model.step_number, model.forcing.grid, self.draws, self.ranks, self.names)
        calved = calve_footloose(model, self.parameters, self.values, when)
        now = stocks(model.elements)
        let_children_go(model.elements, self.parameters, model.forcing.grid)
        if calved.density_mass != 0.0:
            ledger.gain("density_reset", calved.density_mass, now[1] - before[1])
        return calved


def date_of_birth(model: LifeModel, *, coming: bool = False) -> tuple[int, float]:
    """Year, and days since its beginning, of the start of the step that has just ended, or of the coming one."""
    date = model.start.replace(tzinfo=None)
    seconds = model.time - (0.0 if coming else model.parameters.stepping.time_step)
    days = (date - datetime(date.year, 1, 1)).total_seconds() / 86400.0 + seconds / 86400.0
    year = date.year
    while days >= (length := 366 if calendar.isleap(year) else 365):
        days -= length
        year += 1
    return year, float(np.float64(days))
