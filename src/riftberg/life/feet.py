"""Feet under the edges of bergs: how fast they grow, and by which modulus the edge above one breaks."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.constants import SECONDS_PER_DAY
from riftberg.parameters import Parameters
from riftberg.physics.calving import mean_weights, relaxed_modulus
from riftberg.state import Elements, Floats
from riftberg.state.population import find_rows, numbered

FOOT_GROWTH: Final = "foot_growth"
"""Name under which a restart keeps the mean rate (m s-1) at which feet grow, by identifier."""

MEMORY: Final = 30.0 * SECONDS_PER_DAY
"""Time (s) over which that mean is taken: feet grow in storms, and are months old when they break an edge."""


def edge_lengths(el: Elements) -> Floats:
    """Length (m) of the edge along which the foot of each element grows."""
    return np.where(el.life.front >= 0.0, el.life.front, 2.0 * (el.length + el.width))


def edge_moduli(el: Elements, p: Parameters, growth: Floats | None) -> Floats:
    """Young's modulus (Pa) by which the edge of each element breaks; ``growth`` of its foot, m s-1, where edges relax."""
    footloose = p.footloose
    if footloose.modulus == "constant" or growth is None:
        return np.full(el.size, footloose.youngs)
    edge = edge_lengths(el)
    _, berg = numbered(np.where(el.berg == 0, -1 - np.arange(el.size), el.berg))  # without a number each is alone
    of_berg = np.bincount(berg, growth * edge) / np.maximum(np.bincount(berg, edge), 1.0)
    return np.array([
        relaxed_modulus(thickness, rate, footloose.strength, p.ice.density, footloose.viscosity)
        for thickness, rate in zip(el.thickness.tolist(), of_berg[berg].tolist(), strict=True)
    ])  # fmt: skip


def follow_growth(el: Elements, grown: Floats, dt: float, remembered: MutableMapping[str, Floats]) -> None:
    """Take the growth of the feet (m2) in a step (s) into the mean rate that is remembered."""
    edge = edge_lengths(el)
    rate = np.divide(grown, edge * dt, out=np.zeros(el.size), where=edge > 0.0)
    mean, has_mean = find_growth(el, remembered)
    new, old = mean_weights(MEMORY, dt)
    remembered[FOOT_GROWTH] = np.column_stack([el.body.id, np.where(has_mean, new * rate + old * mean, rate)])


def find_growth(el: Elements, remembered: Mapping[str, Floats]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the mean rate (m s-1) at which the feet of the elements grow, 0 where it is not known, and where it is."""
    ids, means = np.asarray(remembered.get(FOOT_GROWTH, np.zeros((0, 2)))).T
    row, has_mean = find_rows(ids.astype(np.int64), el.body.id)
    mean = np.zeros(el.size)
    mean[has_mean] = means[row[has_mean]]
    return mean, has_mean
