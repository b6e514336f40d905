"""Scores of ensembles and single forecasts, and of positions on the sphere and outlines.

The first functions take arrays, members along the first axis; the second part turns positions into kilometres along and across a
direction, and scores many bergs together.

A score is proper where nobody can win it with an ensemble other than the one that the truth is drawn from. Scores of an ensemble
(`fair_crps`, `fair_energy`, `fair_brier`) are fair too: their expectation does not depend on the number of members, so that
ensembles of different size can be compared. Coverage, rank histogram and the ratio of spread to error are no scores. They show
errors of an ensemble. Errors of observations are added to the members (`with_observation_error`) before any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.affinity import translate

from riftberg.diagnostics.outlines import intersection_over_union
from riftberg.ensembles.probability import wilson
from riftberg.errors import InputError
from riftberg.plane import EquidistantPlane, unit_vectors
from riftberg.state import Floats

LEVELS: Final = (0.5, 0.9)
"""Probabilities of the areas whose coverage is counted."""

BINS: Final = 5
"""Bins of probabilities, each beside how often it occurred."""


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
    error = np.linalg.norm(x - np.asarray(observed, float), axis=-1).mean(axis=0)
    pairs = sum(np.linalg.norm(x[k] - x[k + 1 :], axis=-1).sum(axis=0) for k in range(count - 1))
    return np.asarray(error - pairs / (count * (count - 1.0)))


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


def reliability(probability: ArrayLike, occurred: ArrayLike) -> list[ReliabilityBin]:
    """Return how often it occurred where a probability was given; bins without a case are left out."""
    p, o = np.ravel(probability).astype(float), np.ravel(occurred).astype(float)
    bins = np.minimum((p * BINS).astype(int), BINS - 1)
    result = []
    for k in np.unique(bins):
        inside = bins == k
        share, count = float(o[inside].mean()), int(inside.sum())
        low, high = (float(end) for end in wilson(share, count))
        result.append(ReliabilityBin(k / BINS, (k + 1) / BINS, float(p[inside].mean()), share, count, (low, high)))
    return result


def inside_area(members: ArrayLike, observed: ArrayLike, level: float) -> np.ndarray[Any, Any]:
    """Return whether positions lie in the ellipse that holds a new member with a probability.

    The ellipse of a normal distribution with the members' mean and covariance, as large as so many members must have it
    (Hotelling's T2). The last axis holds two coordinates; three or more members are needed.
    """
    from scipy.stats import f as fisher

    x = _members(members, 4)
    count, error = len(x), np.asarray(observed, float) - x.mean(axis=0)
    anomaly = x - x.mean(axis=0)
    covariance = np.einsum("m...i,m...j->...ij", anomaly, anomaly) / (count - 1.0)
    # Members all at one point: only that point is inside.
    square = np.einsum("...i,...ij,...j->...", error, np.linalg.pinv(covariance, hermitian=True), error)
    flat = (np.linalg.matrix_rank(covariance, hermitian=True) < 2) & (np.abs(error).max(axis=-1) > 0.0)
    limit = fisher.ppf(level, 2, count - 2) * 2.0 * (count - 1.0) * (count + 1.0) / (count * (count - 2.0))
    return np.asarray((square <= limit) & ~flat)


def ranks(members: ArrayLike, observed: ArrayLike, random: np.random.Generator) -> np.ndarray[Any, Any]:
    """Return the number of members below the observation, 0 to M; equal ones fall on either side by chance."""
    x, y = _members(members), np.asarray(observed, float)
    return np.asarray((x < y).sum(axis=0) + random.integers(0, (x == y).sum(axis=0) + 1))


def liu_weisberg(separation: ArrayLike, steps: ArrayLike) -> float:
    """Return the skill score of a track: 1 perfect, 0 where the separations add up to as much as the way that was gone.

    Liu and Weisberg (2011), https://doi.org/10.1029/2010JC006837: the sum of the separations over the sum, at the same times, of
    the observed way so far.

    Parameters
    ----------
    separation : array_like
        Distance between both tracks at each time after the start.
    steps : array_like
        Way that was observed between each time and the one before.
    """
    d, travelled = np.asarray(separation, float), np.cumsum(np.asarray(steps, float))
    if d.shape != travelled.shape or d.size == 0:
        raise InputError(
            f"{d.size} separations, {travelled.size} steps", where="liu_weisberg", remedy="Give as many of both"
        )
    if not travelled.sum() > 0.0:
        return 1.0 if not d.any() else 0.0
    return float(max(0.0, 1.0 - d.sum() / travelled.sum()))


def with_observation_error(members: ArrayLike, error: float, random: np.random.Generator) -> Floats:
    """Return members to which the error of the observation is added, a standard deviation in their unit.

    An observation is the truth with an error: a perfect ensemble of the truth is too narrow for it.
    """
    x = np.asarray(members, float)
    return x + random.normal(0.0, error, x.shape) if error > 0.0 else x


def bootstrap_interval(
    groups: Sequence[Floats], statistic: Callable[[Floats], Any], *, draws: int = 2000
) -> tuple[float, float]:
    """Return the 90 % interval of a statistic of all values from drawing the groups they belong to, with replacement."""
    random, count = np.random.default_rng(1), len(groups)
    drawn = [
        float(statistic(np.concatenate([groups[k] for k in random.integers(0, count, count)]))) for _ in range(draws)
    ]
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(low), float(high)


# --- positions and outlines ---------------------------------------------------------------------------------------------

EARTH_KM: Final = 6371.0
"""Mean radius of the Earth, km."""


class Point(NamedTuple):
    """A forecast of one position, and the observed one."""

    group: str  # Berg: positions of one are no independent cases
    members: Floats  # (members, 2), km along the motion before the start and to the left of it
    observed: Floats  # (2,), in the same axes


class Outlines(NamedTuple):
    """Outlines of members (polygons, km) beside the one that was seen."""

    members: list[Any]
    observed: Any
    share_known: float  # Part of the members whose outlines are known


USUAL_ERROR: Final = 6.0
"""Error of a scatterometer position along each axis, km (standard deviation), of a usual giant berg.

Those of A68a, 150 km long, lie 8.1 km east or west and 4.6 km north or south of the centroids of its outlines (medians of 16 days
in December 2020).
"""

AZIMUTH_ERROR: Final = 5.0
"""Error of the long axis of an outline, degrees (standard deviation).

Two outlines of A68a of one day, of 24, 25 and 26 December 2020, differ by 2, 6 and 4.
"""

FEWEST: Final = 5
"""Bergs from which an interval from drawing bergs means something."""

LEAST: Final = 4
"""Members from which areas, spread and ranks mean something."""


def position_scores(points: Sequence[Point], error: float) -> dict[str, Any]:
    """Return all scores of positions of one lead time, with the error of the observation (km) added to the members.

    Scores have 90 % intervals from drawing groups where there are `FEWEST` or more. Scores of ensembles are left out where a
    forecast has one member, and areas, spread and ranks where one has less than `LEAST`.
    """
    random = np.random.default_rng(1)
    fewest = min(len(point.members) for point in points)
    groups: list[str] = []
    values_by_name: dict[str, list[Floats]] = {}  # One array for each number of members
    for count in sorted({len(point.members) for point in points}):
        same = [point for point in points if len(point.members) == count]
        groups += [point.group for point in same]
        x = with_observation_error(np.stack([point.members for point in same], axis=1), error, random)
        y = np.stack([point.observed for point in same])
        square = ((x.mean(axis=0) - y) ** 2).sum(axis=-1)
        values = {"error_of_mean_km": np.sqrt(square)}
        if fewest > 1:
            values["energy_km"] = fair_energy(x, y)
            for k, axis in enumerate(("along", "across")):
                values[f"crps_{axis}_km"] = fair_crps(x[..., k], y[:, k])
        if fewest >= LEAST:
            values |= {f"inside_{level:.0%}": inside_area(x, y, level).astype(float) for level in LEVELS}
            variance = x.var(axis=0, ddof=1).sum(axis=-1) * (count + 1.0) / count
            values["spread_and_error"] = np.stack([variance, square], axis=-1)
            below = np.stack([ranks(x[..., k], y[:, k], random) for k in range(2)], axis=-1)
            # Anywhere in the part of its rank: M + 1 ranks need not divide by the number of bins.
            values["ranks"] = (below + random.random(below.shape)) / (count + 1.0)
        for name, value in values.items():
            values_by_name.setdefault(name, []).append(value)
    result: dict[str, Any] = {"starts": len(points), "bergs": len(set(groups))}
    joined = {name: np.concatenate(arrays) for name, arrays in values_by_name.items()}
    rank, spread = joined.pop("ranks", None), joined.get("spread_and_error")
    for name, value in joined.items():
        statistic = _ratio if name == "spread_and_error" else np.mean
        label = "spread_over_error" if name == "spread_and_error" else name
        result[label] = float(statistic(value))
        if result["bergs"] >= FEWEST:
            by_group = [value[np.array(groups) == group] for group in sorted(set(groups))]
            result[f"{label}_interval"] = bootstrap_interval(by_group, statistic, draws=400)
    if rank is not None and spread is not None:
        # Along either axis, so that both compare with the error of an axis.
        result["spread_km"], result["rms_error_km"] = (float(value) for value in np.sqrt(spread.mean(axis=0) / 2.0))
        bins = min(10, fewest + 1)
        for k, axis in enumerate(("along", "across")):
            result[f"ranks_{axis}"] = np.histogram(rank[:, k], np.linspace(0.0, 1.0, bins + 1))[0].tolist()
    return result


CELLS: Final = 30
"""Cells along the root of the area that was seen, on which outlines are compared: each some 5 km2 for A68a."""


def outline_scores(outlines: Sequence[Outlines], error: float) -> dict[str, float]:
    """Return the overlap of outlines of one lead time, with the error of the observation (km) added to the members.

    ``overlap`` is the mean intersection over union of members and observation. It is no score: members all at the best place
    win it. ``area_km2`` is one, the squared difference between the probability of ice and the observed ice, summed over the area
    (Goessling and Jung 2018, https://doi.org/10.1002/qj.3242), fair in the number of members.
    """
    random = np.random.default_rng(1)
    overlap, area = [], []
    for case in outlines:
        moves = random.normal(0.0, error, (len(case.members), 2)) if error > 0.0 else np.zeros((len(case.members), 2))
        members = [translate(shape, *move) for shape, move in zip(case.members, moves, strict=True)]
        overlap.append(np.mean([intersection_over_union(shape, case.observed) for shape in members]))
        west, south, east, north = shapely.total_bounds([*members, case.observed])
        step = np.sqrt(case.observed.area) / CELLS
        x, y = np.meshgrid(np.arange(west, east + step, step), np.arange(south, north + step, step))
        inside = np.stack([shapely.contains_xy(shape, x, y) for shape in (*members, case.observed)])
        area.append(step**2 * fair_brier(inside[:-1], inside[-1]).sum())
    return {"outlines": len(outlines), "known": float(np.mean([case.share_known for case in outlines])),
            "overlap": float(np.mean(overlap)), "area_km2": float(np.mean(area))}  # fmt: skip


def _ratio(spread_and_error: Floats) -> Any:
    """Return spread over error, of variances and squared errors."""
    variance, square = spread_and_error.mean(axis=0)
    return np.sqrt(variance / square) if square > 0.0 else np.inf


def verdict(scores: dict[str, Any]) -> str:
    """Judge the spread of an ensemble by its error; few bergs leave it undecided."""
    interval = scores.get("spread_over_error_interval")
    if interval is None:
        return "undecided"
    return "overconfident" if interval[1] < 1.0 else "underconfident" if interval[0] > 1.0 else "reliable"


# --- on the sphere ------------------------------------------------------------------------------------------------------


def distance(lon1: Floats | float, lat1: Floats | float, lon2: Floats | float, lat2: Floats | float) -> Floats:
    """Return great-circle distances, km."""
    east, north = local(lon1, lat1, lon2, lat2)
    return np.hypot(east, north)


def local(lon0: Any, lat0: Any, lon: Any, lat: Any) -> tuple[Floats, Floats]:
    """Return kilometres east and north of a place, with the distance and first direction of the great circle."""
    return EquidistantPlane(lon0, lat0, EARTH_KM).forward(lon, lat)


def moved(lon0: Any, lat0: Any, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return longitude and latitude of points kilometres east and north of a place; the inverse of `local`."""
    lon, lat = EquidistantPlane(lon0, lat0, EARTH_KM).inverse(east, north)
    return (lon + 180.0) % 360.0 - 180.0, lat


def extrapolate(lon1: float, lat1: float, lon2: float, lat2: float, ratio: Floats) -> tuple[Floats, Floats]:
    """Return where a great circle from one place through another leads: ``ratio`` times as far again beyond the second."""
    first, second = unit_vectors(np.array(lon1), np.array(lat1)), unit_vectors(np.array(lon2), np.array(lat2))
    angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
    ahead = second * np.cos(angle) - first
    length = np.linalg.norm(ahead)
    turn = angle * np.asarray(ratio)[..., None]
    # Without motion there is no direction, and the turn is zero.
    position = second * np.cos(turn) + (ahead / length if length > 0.0 else ahead) * np.sin(turn)
    return np.degrees(np.arctan2(position[..., 1], position[..., 0])), np.degrees(
        np.arcsin(np.clip(position[..., 2], -1.0, 1.0))
    )


def along_across(east: Floats, north: Floats, heading: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return displacements along a heading (east and north, any length) and to the left of it."""
    e, n = np.divide(heading, np.hypot(*heading))
    return east * e + north * n, north * e - east * n
