"""The life of the bergs as a part of each long step: pieces break off, ice melts, bergs that are gone are removed.

All of it goes into the ledger (`riftberg.life.ledger`).
"""

from __future__ import annotations

import calendar
from collections.abc import Callable
from datetime import datetime
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from riftberg.engines.common.laws import ElementLaw, law_values
from riftberg.life.births import Circumstances, Living
from riftberg.life.draws import CalvingDraws, OwnDraws
from riftberg.life.feet import find_growth, follow_growth
from riftberg.life.footloose import calve_footloose, let_children_go
from riftberg.life.ledger import (
    Balance,
    Ledger,
    add_melt,
    latent_deficit,
    stocks,
)
from riftberg.life.melt import NO_RATES, MeltStep, life_values, melt_step
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Floats


def water_by_process(step: MeltStep) -> Floats:
    """Melt water (kg) of each element by process, shape (processes, elements)."""
    m = step.melted
    return step.scaling * np.stack(
        [m.base, m.sides, m.waves - m.bits_born, m.bits_melt, m.fl_loss - m.fl_bits_born, m.fl_bits_melt]
    )


LEDGER: Final = "life_ledger"
"""Name under which a restart keeps the ledger."""


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
