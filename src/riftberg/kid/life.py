"""Melt, rolling and footloose calving of a KID run, attached with KID's own rules.

Source: files 1 and 2; quirks T5 to T13, T44 to T46.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from riftberg.kid.calendar import Clock
from riftberg.kid.calving_file import IdentifierCounter
from riftberg.kid.namelist import NamelistGroup
from riftberg.kid.trajectories import resample_environment
from riftberg.life.draws import ReferenceDraws
from riftberg.life.melt import life_values
from riftberg.life.process import LifeModel
from riftberg.parameters import Parameters
from riftberg.physics.rolling import roll
from riftberg.runs.model import Model
from riftberg.state import Bonds, Elements


def without_idle_life(p: Parameters, elements: Elements, bonds: Bonds, passive: bool) -> Parameters:
    """Return the parameters, with melt and rolling off where they cannot change anything in the whole run.

    So it is with rates of zero, no bits to melt and no element that would roll, now or once its bonds have broken, and with
    bergs that do not decay while nothing is returned to an ocean.
    """
    if p.footloose.enabled:
        return p
    off = p.changed(melt={"enabled": False}, rolling={"enabled": False})
    if p.melt.keep_shape:
        return off if passive else p
    bits = p.melt.bits_fraction > 0.0 and (elements.life.mass_of_bits > 0.0).any()
    if not p.melt.zero_rates or bits:
        return p
    count = np.bincount(np.concatenate([bonds.first, bonds.second]), minlength=elements.size)
    free = (elements.static < 0.5) & ((count == 0) | p.fracture.enabled)
    return p if p.rolling.enabled and (free & _would_roll(elements, p)).any() else off


def _would_roll(elements: Elements, p: Parameters) -> NDArray[np.bool_]:
    """Whether elements without bonds would roll at once."""
    values, body = life_values(p), elements.body
    shapes = zip(body.thickness.tolist(), body.width.tolist(), body.length.tolist(), strict=True)
    rolled = [roll(t, w, q, values.rolling_scheme, values.tip, values.rho_ice)[0] != t for t, w, q in shapes]
    return np.asarray(rolled, np.bool_)


def attach_life(model: Model, group: NamelistGroup, clock: Clock, restarts: Path, ranks: tuple[int, int]) -> None:
    """Give the life of a model KID's rules: its environment, dates, identifiers and random numbers."""
    life, grid = model.life, model.forcing.grid
    if life is None or grid is None:
        return
    first = clock.date(0.0)
    seed = first.year, first.month, first.day, first.hour, first.minute, int(first.second)
    life.draws = ReferenceDraws(seed, group.flag("fl_init_child_xy_by_pe"))
    life.ranks = ranks
    life.names = IdentifierCounter.beside(restarts, grid, model.elements.id).take
    single = model.parameters.stepping.scheme != "mts"

    def born(m: LifeModel) -> tuple[int, float]:
        date = clock.date((m.step_number - 1) * clock.dt)
        return date.year, date.year_day()

    def look(m: LifeModel) -> None:
        if single:
            resample_environment(m, (m.step_number - 1) * clock.dt, group)

    life.born, life.look_around = born, look
