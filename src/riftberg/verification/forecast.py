"""An ensemble of `riftberg sweep` or `riftberg forecast` against later observations.

Errors are measured along and across the motion of the berg before the start: axes that knew the outcome could be won with a wrong
spread. Without a position before the start they are east and north.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import xarray as xr

from riftberg.diagnostics.observed import Observations
from riftberg.ensembles.probability import effective, wilson
from riftberg.errors import InputError
from riftberg.state import Floats
from riftberg.verification.scores import (
    LEAST,
    LEVELS,
    Outlines,
    Point,
    along_across,
    distance,
    extrapolate,
    fair_brier,
    liu_weisberg,
    local,
    moved,
    outline_scores,
    position_scores,
    reliability,
    verdict,
)
from riftberg.verification.sightings import (
    DAY,
    berg_offsets,
    between,
    check_dates,
    during,
    ensemble_start,
    member_outlines,
    select_sightings,
    track_dates,
)
from riftberg.verification.tracks import DAYS_BEFORE, Dressed, Start


@dataclass(frozen=True)
class Verified:
    """Verification of one forecast."""

    name: str  # Of the berg
    start: datetime
    members: int  # That are done
    failed: int  # That are not, and count in nothing
    origin: tuple[float, float]  # Mean position of the members at the start
    heading: tuple[float, float] | None  # Motion before the start, km east and north; None where it is not known
    points: dict[int, list[Point]]  # By lead time, nearest whole day
    baselines: dict[str, dict[int, list[Point]]]  # The same of forecasts that cost nothing
    liu_weisberg: dict[str, float]  # Skill of the mean of the members, and the median of their own
    broken: dict[int, tuple[Floats, bool]]  # By day: members that have broken by then, and whether the berg had
    # By lead time: of the forecast's own ellipses the offset of what was seen (2,) and the covariance (2, 2), km
    own_areas: dict[int, list[tuple[Floats, Floats]]] = field(default_factory=dict)
    outlines: dict[int, list[Outlines]] = field(default_factory=dict)  # By lead time, of members that are whole


def verified(
    ensemble: xr.Dataset, observed: Observations, *, berg: str | None = None, broken: datetime | None = None,
    whole_until: datetime | None = None, hour: float | None = None,
    dressed: dict[str, Dressed] | Callable[[str], dict[str, Dressed]] | None = None, outline: Any = None,
    pieces: Callable[[int], list[list[Any]]] | None = None,
) -> Verified:  # fmt: skip
    """Compare an ensemble with observations.

    Parameters
    ----------
    ensemble : xarray.Dataset
        From `riftberg.open_sweep`.
    observed : Observations
        Outlines or positions; interpolated ones are left out.
    berg : str, optional
        Name of the berg, where the file has several.
    broken : datetime, optional
        When it was first seen broken.
    whole_until : datetime, optional
        When it was last seen whole; by default nothing is said of break-ups before `broken` is given.
    hour : float, optional
        Hour (UTC) of observations without a time; by default the hour of the start.
    dressed : dict or callable, optional
        Baselines with errors of other bergs, by name (`riftberg.verification.tracks.Dressed`); or a function that returns them
        for the name of the verified berg, without errors of its family.
    outline : shapely.Polygon, optional
        Outline of the berg at the start (`riftberg.verification.sightings.read_first_outline`), to compare outlines with.
    pieces : callable, optional
        Gives the outlines of the pieces of a member that broke up, by its number (`riftberg.ensembles.member.Outcome`).

    Returns
    -------
    Verified

    Raises
    ------
    InputError
        If fewer than two members are done, the berg is not named, or nothing was observed during the forecast.
    """
    where = str(observed.source)
    ended = np.flatnonzero(ensemble["status"].values == 0)
    if len(ended) < 2:
        raise InputError(f"{len(ended)} members are done", where="ensemble", remedy="Give one with two or more")
    if "lon" not in ensemble:
        raise InputError("positions in metres", where="ensemble", remedy="Observations need longitude and latitude")
    ds = ensemble.isel(member=_by_weight(ensemble, ended))
    times, first = track_dates(ds), ensemble_start(ds)
    start = times[0]
    berg_name, seen = select_sightings(observed, berg, first, hour)
    lon, lat = (ds[name].isel(fragment=0).values.astype(float) for name in ("lon", "lat"))
    if not np.isfinite(lon[:, 0]).all():
        raise InputError("members without a position at the start", where="ensemble", remedy="Make the ensemble again")
    east, north = local(lon[0, 0], lat[0, 0], lon[:, 0], lat[:, 0])
    x, y = moved(lon[0, 0], lat[0, 0], east.mean(), north.mean())
    origin = float(x), float(y)
    earlier = {s.when: s.place for s in seen if timedelta(0) < first - s.when <= timedelta(days=DAYS_BEFORE)}
    heading = _heading(earlier, origin)
    axes = (1.0, 0.0) if heading is None else heading
    later = during(berg_name, seen, first, times[-1].astype("datetime64[us]").item(), where)
    points: dict[int, list[Point]] = {}
    baselines: dict[str, dict[int, list[Point]]] = {}
    own_areas: dict[int, list[tuple[Floats, Floats]]] = {}
    others = dressed(berg_name) if callable(dressed) else dressed or {}
    outlines: dict[int, list[Outlines]] = {}
    separations, steps, last = [], [], origin
    for sighting in later:
        when, position = sighting.when, sighting.place
        lead = max(1, round((when - first) / timedelta(days=1)))
        members = berg_offsets(ds, when, origin)
        members = members[np.isfinite(members).all(axis=1)]
        truth = np.array(along_across(*local(*origin, *position), axes))
        ahead = np.stack(along_across(members[:, 0], members[:, 1], axes), axis=-1)
        if len(members) >= 2:
            points.setdefault(lead, []).append(Point(berg_name, ahead, truth))
            separations.append(np.linalg.norm(ahead - truth, axis=-1) if len(members) == len(lon) else None)
            steps.append(float(distance(*last, *position)))
            last = position
        if "cone_major" in ensemble and np.isfinite((area := _own_area(ensemble, when, position))[1]).all():
            own_areas.setdefault(lead, []).append(area)  # where too few members count there is none
        if outline is not None and sighting.shape is not None:
            shapes = member_outlines(ds, outline, sighting, pieces)
            if len(shapes) >= LEAST:
                outlines.setdefault(lead, []).append(Outlines(shapes, sighting.shape, len(shapes) / len(lon)))
        for name, drifted in _baselines(Start(berg_name, first, *origin, earlier), heading, when, others).items():
            offsets = np.stack(along_across(*local(*origin, drifted[:, 0], drifted[:, 1]), axes), axis=-1)
            baselines.setdefault(name, {}).setdefault(lead, []).append(Point(berg_name, offsets, truth))
    skills: dict[str, float] = {}
    if separations and all(each is not None for each in separations):
        by_member = np.stack([each for each in separations if each is not None], axis=1)
        means = [float(np.linalg.norm(p.members.mean(axis=0) - p.observed)) for row in points.values() for p in row]
        skills = {
            "mean of the members": liu_weisberg(means, steps),
            "median of the members": float(np.median([liu_weisberg(row, steps) for row in by_member])),
        }
    return Verified(
        berg_name, first, len(ended), int(ensemble.sizes["member"]) - len(ended), origin, heading, points, baselines, skills,
        _broken(ds, start, times[-1], broken, whole_until), own_areas, outlines,
    )  # fmt: skip


def _own_area(ds: xr.Dataset, when: datetime, position: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return the offset of an observation from the middle of a forecast's ellipses (km east, north), and their covariance."""
    (previous, after), share = between(track_dates(ds), when)
    level = float(ds["cone"].values[-1])
    offset, covariance = np.zeros(2), np.zeros((2, 2))
    for k, weight in ((previous, 1.0 - share), (after, share)):
        offset += weight * np.array(local(float(ds["cone_lon"][k]), float(ds["cone_lat"][k]), *position))
        azimuth = np.radians(float(ds["cone_azimuth"][k]))
        along = np.array([np.sin(azimuth), np.cos(azimuth)])
        across = np.array([along[1], -along[0]])
        for name, axis in (("cone_major", along), ("cone_minor", across)):
            variance = (float(ds[name].sel(cone=level)[k]) / 1e3) ** 2 / (-2.0 * np.log(1.0 - level))
            covariance += weight * variance * np.outer(axis, axis)
    return offset, covariance


def own_coverage(areas: Sequence[tuple[Floats, Floats]], error: float) -> dict[str, float]:
    """Return the shares of observations in a forecast's own ellipses, with an error of the observation (km) added."""
    coverage = {}
    for level in LEVELS:
        # Within r standard deviations of a normal distribution in two dimensions lies 1 - exp(-r2 / 2).
        limit = -2.0 * np.log(1.0 - level)
        inside = [
            float(offset @ np.linalg.pinv(covariance + error**2 * np.eye(2)) @ offset) <= limit
            for offset, covariance in areas
        ]
        coverage[f"own_{level:.0%}"] = float(np.mean(inside))
    return coverage


def _by_weight(ensemble: xr.Dataset, ended: Any) -> Any:
    """Return the members that count, as often as their weights say (systematic resampling).

    As many as their effective number: more would give scores and intervals a certainty that the weights do not have.
    """
    if "weight" not in ensemble.coords and "weight" not in ensemble:
        return ended
    weight = ensemble["weight"].values[ended].astype(float)
    if not (np.isfinite(weight).all() and (weight >= 0.0).all() and weight.sum() > 0.0):
        raise InputError("weights that are no numbers from 0", where="ensemble", remedy="Make the ensemble again")
    shares, count = np.cumsum(weight) / weight.sum(), max(2, round(effective(weight)))
    return ended[np.searchsorted(shares, (np.arange(count) + 0.5) / count)]


def _heading(earlier: dict[datetime, tuple[float, float]], origin: tuple[float, float]) -> tuple[float, float] | None:
    """Return the motion from the earliest position of the days before to the start; None where there is none."""
    if not earlier:
        return None
    east, north = local(*origin, *earlier[min(earlier)])
    return None if np.hypot(east, north) == 0.0 else (-float(east), -float(north))


def _baselines(
    start: Start, heading: tuple[float, float] | None, when: datetime, dressed: dict[str, Dressed]
) -> dict[str, Floats]:
    """Return positions (members, 2) of the forecasts that cost nothing; constant velocity where there was a motion."""
    forecasts = {"staying put": np.array([[start.lon, start.lat]])}
    if heading is None:
        return forecasts
    earliest = min(start.before)
    ratio = np.array([(when - start.date) / (start.date - earliest)])
    forecasts["constant velocity"] = np.stack(
        extrapolate(*start.before[earliest], start.lon, start.lat, ratio), axis=-1
    )
    random = np.random.default_rng([1, when.toordinal(), *start.berg.encode()])
    days = (when - start.date) / timedelta(days=1)
    dressings = {
        f"{name}, dressed": model.around(forecasts[name][0], heading, days, random) for name, model in dressed.items()
    }
    return forecasts | dressings


def _broken(
    ds: xr.Dataset, start: np.datetime64, end: np.datetime64, broken: datetime | None, whole_until: datetime | None
) -> dict[int, tuple[Floats, bool]]:
    """Return by day which members have broken by then and whether the berg had, as far as that was observed."""
    if broken is None and whole_until is None:
        return {}
    check_dates(broken, whole_until)
    first = ds["first_breakup"].values.astype("datetime64[ns]")
    result = {}
    for day in range(1, int((end - start) / DAY) + 1):
        date = start + day * DAY
        # Between the last time it was seen whole and the first time broken nobody knows.
        seen_whole = whole_until is not None and date <= np.datetime64(whole_until, "ns")
        over = broken is not None and bool(date >= np.datetime64(broken, "ns"))
        if seen_whole or over or (whole_until is None and broken is not None):
            result[day] = (~np.isnat(first) & (first <= date)).astype(float), over
    return result


def _merge_by_lead(rows: Iterable[Mapping[int, list[Any]]]) -> dict[int, list[Any]]:
    """Return lists by lead time of several forecasts as one."""
    merged: dict[int, list[Any]] = {}
    for row in rows:
        for lead, values in row.items():
            merged.setdefault(lead, []).extend(values)
    return merged


def report(forecasts: Sequence[Verified], error: float) -> dict[str, Any]:
    """Return all scores of forecasts, several bergs together, with and without the error of the observation (km)."""
    pooled, areas = (
        _merge_by_lead(forecast.points for forecast in forecasts),
        _merge_by_lead(forecast.own_areas for forecast in forecasts),
    )
    outlines = _merge_by_lead(forecast.outlines for forecast in forecasts)
    names = list(dict.fromkeys(name for forecast in forecasts for name in forecast.baselines))
    others = {name: _merge_by_lead(forecast.baselines.get(name, {}) for forecast in forecasts) for name in names}

    def scored(points: dict[int, list[Point]], added: float) -> list[dict[str, Any]]:
        rows = [
            {"lead_days": lead, **position_scores(points[lead], added),
             **(own_coverage(areas[lead], added) if points is pooled and lead in areas else {}),
             **(outline_scores(outlines[lead], added) if points is pooled and lead in outlines else {})}
            for lead in sorted(points)
        ]  # fmt: skip
        return [{**row, "verdict": verdict(row)} for row in rows]

    days = [
        (p.mean(), len(p), over, day) for forecast in forecasts for day, (p, over) in sorted(forecast.broken.items())
    ]
    return {
        "forecasts": [
            {"berg": forecast.name, "start": forecast.start.isoformat(), "members": forecast.members, "failed": forecast.failed,
             "axes": "east and north" if forecast.heading is None else "motion before the start",
             "liu_weisberg": forecast.liu_weisberg,
             "broken": [
                 {"day": day, "probability": float(p.mean()), "occurred": over, "fair_brier": float(fair_brier(p, over)),
                  "interval": [float(end) for end in wilson(p.mean(), len(p))]}
                 for day, (p, over) in sorted(forecast.broken.items())
             ]}
            for forecast in forecasts
        ],
        "error_km": error,
        "with_error": scored(pooled, error),
        "without_error": scored(pooled, 0.0),
        "baselines": {name: scored(rows, 0.0) for name, rows in others.items()},
        "reliability": [row._asdict() for row in reliability([d[0] for d in days], [d[2] for d in days])] if days else [],
    }  # fmt: skip
