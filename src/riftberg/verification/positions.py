"""Positions on the sphere as kilometres along and across a direction, and the scores of forecast positions and outlines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.affinity import translate

from riftberg.diagnostics.outlines import intersection_over_union
from riftberg.plane import unit_vectors
from riftberg.state import Floats
from riftberg.verification.scores import (
    LEVELS,
    bootstrap_interval,
    fair_brier,
    fair_crps,
    fair_energy,
    inside_area,
    ranks,
    with_observation_error,
)

EARTH_KM: Final = 6371.0
"""Mean radius of the Earth, km."""


class Point(NamedTuple):
    """A forecast of one position beside what was seen."""

    group: str  # Berg: positions of one are no independent cases
    members: Floats  # (members, 2), km along the motion before the start and to the left of it
    observed: Floats  # (2,), in the same axes


class Outlines(NamedTuple):
    """Outlines of members (polygons, km) beside the one that was seen."""

    members: list[Any]
    observed: Any
    known: float  # Part of the members whose outlines are known


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


def position_scores(points: Sequence[Point], error: float, *, seed: int = 1, draws: int = 400) -> dict[str, Any]:
    """Return all scores of positions of one lead time, with the error of the observation (km) added to the members.

    Scores have 90 % intervals from drawing groups where there are `FEWEST` or more. Those of an ensemble are left out where a
    forecast has one member, and areas, spread and ranks where one has less than `LEAST`.
    """
    random = np.random.default_rng(seed)
    fewest = min(len(point.members) for point in points)
    groups: list[str] = []
    found: dict[str, list[Floats]] = {}  # One array for each number of members
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
            found.setdefault(name, []).append(value)
    result: dict[str, Any] = {"starts": len(points), "bergs": len(set(groups))}
    whole = {name: np.concatenate(parts) for name, parts in found.items()}
    rank, spread = whole.pop("ranks", None), whole.get("spread_and_error")
    for name, value in whole.items():
        statistic = _ratio if name == "spread_and_error" else np.mean
        label = "spread_over_error" if name == "spread_and_error" else name
        result[label] = float(statistic(value))
        if result["bergs"] >= FEWEST:
            by_group = [value[np.array(groups) == group] for group in sorted(set(groups))]
            result[f"{label}_interval"] = bootstrap_interval(by_group, statistic, seed=seed, draws=draws)
    if rank is not None and spread is not None:
        # Along either axis, so that both compare with the error of an axis.
        result["spread_km"], result["rms_error_km"] = (float(value) for value in np.sqrt(spread.mean(axis=0) / 2.0))
        parts = min(10, fewest + 1)
        for k, axis in enumerate(("along", "across")):
            result[f"ranks_{axis}"] = np.histogram(rank[:, k], np.linspace(0.0, 1.0, parts + 1))[0].tolist()
    return result


CELLS: Final = 30
"""Cells along the root of the area that was seen, on which outlines are compared: each some 5 km2 for A68a."""


def outline_scores(outlines: Sequence[Outlines], error: float, *, seed: int = 1) -> dict[str, float]:
    """Return the overlap of outlines of one lead time, with the error of the observation (km) added to the members.

    ``overlap`` is the mean intersection over union of members and observation. It is no score: members all at the best place
    win it. ``area_km2`` is one, the squared difference between the probability of ice and what was seen, summed over the area
    (Goessling and Jung 2018, https://doi.org/10.1002/qj.3242), fair in the number of members.
    """
    random = np.random.default_rng(seed)
    overlap, area = [], []
    for one in outlines:
        moves = random.normal(0.0, error, (len(one.members), 2)) if error > 0.0 else np.zeros((len(one.members), 2))
        members = [translate(shape, *move) for shape, move in zip(one.members, moves, strict=True)]
        overlap.append(np.mean([intersection_over_union(shape, one.observed) for shape in members]))
        west, south, east, north = shapely.total_bounds([*members, one.observed])
        step = np.sqrt(one.observed.area) / CELLS
        x, y = np.meshgrid(np.arange(west, east + step, step), np.arange(south, north + step, step))
        inside = np.stack([shapely.contains_xy(shape, x, y) for shape in (*members, one.observed)])
        area.append(step**2 * fair_brier(inside[:-1], inside[-1]).sum())
    return {"outlines": len(outlines), "known": float(np.mean([one.known for one in outlines])),
            "overlap": float(np.mean(overlap)), "area_km2": float(np.mean(area))}  # fmt: skip


def _ratio(spread_and_error: Floats) -> Any:
    """Return spread over error, of variances and squared errors."""
    variance, square = spread_and_error.mean(axis=0)
    return np.sqrt(variance / square) if square > 0.0 else np.inf


def verdict(found: dict[str, Any]) -> str:
    """Return what the spread beside the error says of an ensemble; of few bergs it says nothing."""
    interval = found.get("spread_over_error_interval")
    if interval is None:
        return "undecided"
    return "overconfident" if interval[1] < 1.0 else "underconfident" if interval[0] > 1.0 else "reliable"


# --- on the sphere ------------------------------------------------------------------------------------------------------


def distance(lon1: Floats | float, lat1: Floats | float, lon2: Floats | float, lat2: Floats | float) -> Floats:
    """Return great-circle distances, km."""
    east, north = local(lon1, lat1, lon2, lat2)
    return np.hypot(east, north)


def local(
    lon0: Floats | float, lat0: Floats | float, lon: Floats | float, lat: Floats | float
) -> tuple[Floats, Floats]:
    """Return kilometres east and north of a place, with the distance and first direction of the great circle."""
    a, b, b0 = np.radians(np.subtract(lon, lon0)), np.radians(lat), np.radians(lat0)
    east = np.cos(b) * np.sin(a)
    north = np.cos(b0) * np.sin(b) - np.sin(b0) * np.cos(b) * np.cos(a)
    sine = np.hypot(east, north)
    angle = np.arctan2(sine, np.sin(b0) * np.sin(b) + np.cos(b0) * np.cos(b) * np.cos(a))
    stretch = EARTH_KM * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    return stretch * east, stretch * north


def moved(lon0: Floats | float, lat0: Floats | float, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return longitude and latitude of points kilometres east and north of a place; the inverse of `local`."""
    length = np.hypot(east, north)
    angle, b0 = length / EARTH_KM, np.radians(lat0)
    sine = np.divide(np.sin(angle), length, out=np.zeros_like(length), where=length > 0.0)
    lat = np.arcsin(np.clip(np.cos(angle) * np.sin(b0) + north * sine * np.cos(b0), -1.0, 1.0))
    lon = np.arctan2(east * sine, np.cos(b0) * np.cos(angle) - np.sin(b0) * north * sine)
    return (lon0 + np.degrees(lon) + 180.0) % 360.0 - 180.0, np.degrees(lat)


def carried_on(lon1: float, lat1: float, lon2: float, lat2: float, ratio: Floats) -> tuple[Floats, Floats]:
    """Return where a great circle from one place through another leads: ``ratio`` times as far again beyond the second."""
    first, second = unit_vectors(np.array(lon1), np.array(lat1)), unit_vectors(np.array(lon2), np.array(lat2))
    angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
    ahead = second * np.cos(angle) - first
    length = np.linalg.norm(ahead)
    turn = angle * np.asarray(ratio)[..., None]
    # Without motion there is no direction, and the turn is zero.
    place = second * np.cos(turn) + (ahead / length if length > 0.0 else ahead) * np.sin(turn)
    return np.degrees(np.arctan2(place[..., 1], place[..., 0])), np.degrees(
        np.arcsin(np.clip(place[..., 2], -1.0, 1.0))
    )


def along_across(east: Floats, north: Floats, heading: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return displacements along a heading (east and north, any length) and to the left of it."""
    e, n = np.divide(heading, np.hypot(*heading))
    return east * e + north * n, north * e - east * n
