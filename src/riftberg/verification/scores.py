"""Scores of ensembles, of whole numbers of members and of single forecasts: functions of arrays, members along the first axis.

A score is proper where nobody can win it with an ensemble other than the one that the truth is drawn from. Those of an ensemble
(`fair_crps`, `fair_energy`, `fair_brier`) are fair too: their expectation does not depend on the number of members, so that
ensembles of different size can be compared. Coverage, rank histogram and the ratio of spread to error are no scores. They show
what is wrong. Errors of observations are added to the members (`with_observation_error`) before any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from riftberg.ensembles.probability import wilson
from riftberg.errors import InputError
from riftberg.state import Floats

LEVELS: Final = (0.5, 0.9)
"""Probabilities of the areas whose coverage is counted."""


def _members(members: ArrayLike, least: int = 2) -> Floats:
    array = np.asarray(members, float)
    if array.ndim == 0 or len(array) < least:
        count = 0 if array.ndim == 0 else len(array)
        raise InputError(f"{count} members", where="scores", remedy=f"Give {least} or more")
    return array


def fair_crps(members: ArrayLike, observed: ArrayLike) -> Floats:
    """Return the continuous ranked probability score of an ensemble, fair in the number of members.

    Mean distance of the members from the observation less half of the mean distance between two members (Ferro 2014,
    https://doi.org/10.1002/qj.2270). In the unit of the members; 0 is perfect, and a single perfect ensemble may be below.
    """
    x = _members(members)
    count = len(x)
    # The sum over all pairs from the sorted members: sum of (2 k - M + 1) x_k, k from 0.
    weight = 2.0 * np.arange(count) - count + 1.0
    pairs = np.tensordot(weight, np.sort(x, axis=0), axes=1)
    return np.asarray(np.abs(x - np.asarray(observed, float)).mean(axis=0) - pairs / (count * (count - 1.0)))


def fair_energy(members: ArrayLike, observed: ArrayLike) -> Floats:
    """Return the energy score of positions, the last axis holding their coordinates: `fair_crps` in more than one dimension.

    Gneiting and Raftery (2007), https://doi.org/10.1198/016214506000001437.
    """
    x = _members(members)
    count = len(x)
    away = np.linalg.norm(x - np.asarray(observed, float), axis=-1).mean(axis=0)
    pairs = sum(np.linalg.norm(x[k] - x[k + 1 :], axis=-1).sum(axis=0) for k in range(count - 1))
    return np.asarray(away - pairs / (count * (count - 1.0)))


def brier(probability: ArrayLike, occurred: ArrayLike) -> Floats:
    """Return the Brier score of probabilities: the squared difference from 1 where it occurred, from 0 where it did not."""
    return np.asarray((np.asarray(probability, float) - np.asarray(occurred, float)) ** 2)


def fair_brier(members: ArrayLike, occurred: ArrayLike) -> Floats:
    """Return the Brier score of members that say yes or no, fair in their number (Ferro 2014)."""
    x = _members(members)
    count, p = len(x), x.mean(axis=0)
    return np.asarray(brier(p, occurred) - p * (1.0 - p) / (count - 1.0))


class ReliabilityBin(NamedTuple):
    """Forecasts of about one probability."""

    low: float  # Probabilities from
    high: float  # to
    forecast: float  # Mean of the probabilities
    observed: float  # Part of the cases in which it occurred
    cases: int
    interval: tuple[float, float]  # 90 % interval of the observed part


def reliability(probability: ArrayLike, occurred: ArrayLike, bins: int = 5) -> list[ReliabilityBin]:
    """Return how often it occurred where a probability was given; bins without a case are left out."""
    p, o = np.ravel(probability).astype(float), np.ravel(occurred).astype(float)
    place = np.minimum((p * bins).astype(int), bins - 1)
    result = []
    for k in np.unique(place):
        inside = place == k
        share, count = float(o[inside].mean()), int(inside.sum())
        low, high = (float(end) for end in wilson(share, count))
        result.append(ReliabilityBin(k / bins, (k + 1) / bins, float(p[inside].mean()), share, count, (low, high)))
    return result


def inside_area(members: ArrayLike, observed: ArrayLike, level: float) -> np.ndarray[Any, Any]:
    """Return whether positions lie in the ellipse that holds a new member with a probability.

    The ellipse of a normal distribution with the members' mean and covariance, as large as so many members must have it
    (Hotelling's T2). The last axis holds two coordinates; three or more members are needed.
    """
    from scipy.stats import f as fisher

    x = _members(members, 4)
    count, away = len(x), np.asarray(observed, float) - x.mean(axis=0)
    anomaly = x - x.mean(axis=0)
    covariance = np.einsum("m...i,m...j->...ij", anomaly, anomaly) / (count - 1.0)
    # Members all at one point: only that point is inside.
    square = np.einsum("...i,...ij,...j->...", away, np.linalg.pinv(covariance, hermitian=True), away)
    flat = (np.linalg.matrix_rank(covariance, hermitian=True) < 2) & (np.abs(away).max(axis=-1) > 0.0)
    limit = fisher.ppf(level, 2, count - 2) * 2.0 * (count - 1.0) * (count + 1.0) / (count * (count - 2.0))
    return np.asarray((square <= limit) & ~flat)


def ranks(members: ArrayLike, observed: ArrayLike, random: np.random.Generator) -> np.ndarray[Any, Any]:
    """Return the number of members below the observation, 0 to M; equal ones fall on either side by chance."""
    x, y = _members(members), np.asarray(observed, float)
    return np.asarray((x < y).sum(axis=0) + random.integers(0, (x == y).sum(axis=0) + 1))


def liu_weisberg(separation: ArrayLike, steps: ArrayLike, tolerance: float = 1.0) -> float:
    """Return the skill score of a track: 1 perfect, 0 where the separations add up to as much as the way that was gone.

    Liu and Weisberg (2011), https://doi.org/10.1029/2010JC006837: the sum of the separations over the sum, at the same times, of
    the observed way so far.

    Parameters
    ----------
    separation : array_like
        Distance between both tracks at each time after the start.
    steps : array_like
        Way that was observed between each time and the one before.
    tolerance : float, optional
        Ratio at which the skill is zero.
    """
    d, way = np.asarray(separation, float), np.cumsum(np.asarray(steps, float))
    if d.shape != way.shape or d.size == 0:
        raise InputError(f"{d.size} separations, {way.size} steps", where="liu_weisberg", remedy="Give as many of both")
    if not way.sum() > 0.0:
        return 1.0 if not d.any() else 0.0
    return float(max(0.0, 1.0 - d.sum() / way.sum() / tolerance))


def with_observation_error(members: ArrayLike, error: float, random: np.random.Generator) -> Floats:
    """Return members to which the error of the observation is added, a standard deviation in their unit.

    An observation is the truth with an error: a perfect ensemble of the truth is too narrow for it.
    """
    x = np.asarray(members, float)
    return x + random.normal(0.0, error, x.shape) if error > 0.0 else x


def bootstrap_interval(
    groups: Sequence[Floats],
    statistic: Callable[[Floats], Any],
    *,
    level: float = 0.9,
    draws: int = 2000,
    seed: int = 1,
) -> tuple[float, float]:
    """Return the interval of a statistic of all values from drawing the groups they belong to, with replacement."""
    random, count = np.random.default_rng(seed), len(groups)
    drawn = [
        float(statistic(np.concatenate([groups[k] for k in random.integers(0, count, count)]))) for _ in range(draws)
    ]
    low, high = np.quantile(drawn, [0.5 - level / 2.0, 0.5 + level / 2.0])
    return float(low), float(high)
