"""The ledger of an exchange: stocks of ice and heat, what came and went, and mass that has not settled on its cells yet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from riftberg.constants import LATENT_HEAT
from riftberg.errors import InputError
from riftberg.life.ledger import stocks
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats


class Settling:
    """Mass that cells bear beyond the bergs on them, since ice calved there; its sum is 0, and it fades.

    ``time``: in which it becomes smaller by the factor e, s; ``rest``: kg (shape (nj, ni)).
    """

    def __init__(self, time: float, grid: Grid) -> None:
        if not 0.0 < time < math.inf:
            raise InputError(f"settling_time = {time:g} s", where="Exchange", remedy="Give a finite time above 0")
        self.time = time
        self.rest = np.zeros((grid.arrays.nj, grid.arrays.ni))

    def take_up(self, saved: Floats | None) -> None:
        """Go on from the state in a restart."""
        if saved is not None:
            self.rest = saved.copy()

    def settle(self, dt: float) -> None:
        """Let some time (s) pass."""
        self.rest *= math.exp(-dt / self.time)

    def settled(self, mass: Floats) -> Floats:
        """Return the mass of bergs on cells (kg) with the mass that has not settled yet; never below 0, of the same sum."""
        more = np.maximum(self.rest, 0.0)
        if not more.any():
            return mass
        # A berg may have left cells that still lack something: as much less is then added elsewhere.
        less = np.minimum(np.maximum(-self.rest, 0.0), mass)
        return np.asarray(mass - less + more * (less.sum() / more.sum()))


class ExchangeBalance(NamedTuple):
    """The ledger of an exchange since its start."""

    start: float  # Ice in bergs and stores, kg
    now: float  # Ice in bergs and stores, kg
    taken: float  # Ice that came from the land, and water that the ocean got, kg
    given: float  # Ice that came from the land, and water that the ocean got, kg
    left: float  # Ice that left over an open edge, kg
    heat_start: float  # The same for heat, J: ice lacks the latent heat
    heat_now: float  # The same for heat, J: ice lacks the latent heat
    heat_taken: float  # The same for heat, J: ice lacks the latent heat
    heat_given: float  # The same for heat, J: ice lacks the latent heat
    heat_left: float  # The same for heat, J: ice lacks the latent heat

    @property
    def error(self) -> float:
        """Mass that is left over, as part of the mass in the ledger; 0 if it closes."""
        scale = max(abs(self.start), abs(self.now), self.taken, self.given, 1e-30)
        return (self.start + self.taken - self.given - self.left - self.now) / scale

    @property
    def heat_error(self) -> float:
        """The same for heat."""
        scale = max(abs(self.heat_start), abs(self.heat_now), abs(self.heat_taken), abs(self.heat_given), 1e-30)
        return (self.heat_start + self.heat_taken - self.heat_given - self.heat_left - self.heat_now) / scale

    def describe(self) -> str:
        """Return the ledger in two lines."""
        return (
            f"ice {self.start:.6e} kg + taken {self.taken:.6e} - given {self.given:.6e} - left {self.left:.6e} = {self.now:.6e} "
            f"(error {self.error:.1e})\n"
            f"heat {self.heat_start:.6e} J + taken {self.heat_taken:.6e} - given {self.heat_given:.6e} "
            f"- left {self.heat_left:.6e} = {self.heat_now:.6e} "
            f"(error {self.heat_error:.1e})"
        )


class ExchangeLedger:
    """Sums since the start of an exchange, in kg and J; ``saved``: those of a restart, by name."""

    def __init__(self, saved: Mapping[str, Floats]) -> None:
        self.totals = saved.get("totals", np.zeros(4)).copy()  # Mass taken and given, heat taken and given
        self.start = saved.get("start", np.full(2, np.nan)).copy()  # Ice and its heat
        self.held = saved.get("held", np.zeros(2)).copy()  # Land ice that a running mean holds back, and its heat
        self.left = saved.get("left", np.zeros(2)).copy()  # Ice that left over an open edge, and its heat

    @property
    def arrays(self) -> dict[str, Floats]:
        """What a restart keeps, by name."""
        return {"totals": self.totals, "start": self.start, "held": self.held, "left": self.left}

    def copy(self) -> ExchangeLedger:
        """Return a copy, for the way back."""
        return ExchangeLedger(self.arrays)

    def enter_birth(self, mass: float, heat: float) -> None:
        """Enter ice (kg, J) that has calved from a shelf."""
        self.totals[0], self.totals[2] = self.totals[0] + mass, self.totals[2] + heat

    def enter_step(
        self, taken: tuple[Floats, Floats], fluxes: Mapping[str, Floats], scale: Floats, departed: list[Elements]
    ) -> None:
        """Enter a step of the ocean.

        ``taken``: flux of land ice (kg m-2 s-1) and of its heat; ``fluxes``: to the ocean; ``scale``: area of the cells by the
        step, m2 s; ``departed``: elements that left over an open edge.
        """
        flux, heat = taken
        came, came_heat = float((flux * scale).sum()), float(((heat - LATENT_HEAT * flux) * scale).sum())
        went = float(((fluxes["melt"] + fluxes["left"]) * scale).sum())
        went_heat = float(((fluxes["heat"] + fluxes["left_heat"]) * scale).sum())
        for elements in departed:
            self.left += stocks(elements)
        self.totals += (came, went, came_heat, went_heat)

    def balance(self, stock: tuple[float, float]) -> ExchangeBalance:
        """Return the ledger with the present stock of ice (kg) and its heat (J)."""
        came, went, heat_came, heat_went = self.totals.tolist()
        left, heat_left = self.left.tolist()
        return ExchangeBalance(
            float(self.start[0]), stock[0], came, went, left,
            float(self.start[1]), stock[1], heat_came, heat_went, heat_left,
        )  # fmt: skip
