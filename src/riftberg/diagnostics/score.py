"""How well a run agrees with observations: position, heading, area, outline and fragments, day by day.

A day without a time is compared at one hour, by default the hour of the start of the run. The model's outline is the union
of its elements. Which of the model's fragments make up an observed piece is found in two steps. First each piece gets
at most one fragment, all pieces together in the best way: by overlap, by the distance of the centroids in diameters,
and by the ratio of areas (`riftberg.diagnostics.outlines.pair_cost`); a fragment that answered to the piece the time
before is preferred, and beyond three mean diameters or a factor of four in area a piece stays without. Only the berg
itself, the largest fragment and the largest piece, is known however far the run has gone astray. Then each fragment that
is left joins the piece that the fragments, laid on it centroid on centroid, overlap better with it than without
(intersection over union). So a finger that is off but still in place counts to the berg, and an error of drift does not
decide. The overlap that is reported is that in the true places.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import shapely
import xarray as xr

from riftberg.bergs.seams import join_polygons
from riftberg.config.units import minute_text
from riftberg.diagnostics.observed import Fix, Observations
from riftberg.diagnostics.outlines import (
    REACH,
    Outline,
    drop_twins,
    group_fragments,
    intersection_over_union,
    polygon_moments,
    project_polygon,
    same_pieces,
)
from riftberg.diagnostics.summary import melt_lines
from riftberg.errors import InputError
from riftberg.ocean.grid import haversine
from riftberg.plane import ConformalPlane
from riftberg.runs.accessor import best_pairs
from riftberg.runs.scene import Scene
from riftberg.runs.tracks import Position, axis_difference, berg_position
from riftberg.state import Floats
from riftberg.system.atomic_files import write_json

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Seen = TypeVar("Seen", Outline, Fix)

SMALLEST: Final = 0.005
"""Fragments below this part of the whole area are not matched one by one."""

FIX_REACH: Final = 100e3
"""Mean distance (m) within which a position can belong to a small fragment: positions have no size, and scatter by tens
of km between sensors."""

STRANGE: Final = 500e3
"""Distance (m) beyond which another berg of a table has nothing to do with the run, and is left out."""

DRIFT: Final = 0.2
"""Usual drift of a large berg, m s-1."""

_SEAM = 60.0  # m; closes the hairline gaps between elements


@dataclass(frozen=True)
class Match:
    """One observed piece and the fragments of the model that make it up."""

    observed: str  # Name of the piece
    fragments: list[int]  # Numbers of the model's fragments; empty where none answers to it
    distance_km: float | None  # Between the centroids
    # Long axes, degrees clockwise from north; the difference model minus observed lies in [-90, 90)
    azimuth: float | None
    azimuth_observed: float | None
    azimuth_difference: float | None
    area_km2: float | None
    area_observed_km2: float | None
    iou: float | None  # Intersection over union of the outlines; None for positions
    lon: float | None  # Centroids
    lat: float | None  # Centroids
    lon_observed: float  # Centroids
    lat_observed: float  # Centroids


@dataclass(frozen=True)
class ScoredDay:
    """Comparison at one time."""

    time: str  # ISO 8601
    matches: list[Match]  # Observed pieces, largest first
    largest: int  # Number of the largest fragment of the model
    unmatched: list[int] = field(default_factory=list)  # Fragments that answer to no piece

    @property
    def berg(self) -> Match | None:
        """Comparison of the berg itself: the piece to which the largest fragment belongs."""
        return next((m for m in self.matches if self.largest in m.fragments), None)


@dataclass(frozen=True)
class Score:
    """Comparison of a run with observations."""

    observed: str  # File of the observations
    days: list[ScoredDay]
    melt: list[str] = field(default_factory=list)  # Melt of the run, in words; empty where nothing melts

    def summary(self) -> dict[str, Any]:
        """Return means over the days, for the berg itself."""
        rows = [berg for day in self.days if (berg := day.berg) is not None]
        return {
            "days": len(rows),
            "distance_km_rms": root_mean_square(m.distance_km for m in rows),
            "distance_km_max": max((m.distance_km for m in rows if m.distance_km is not None), default=None),
            "azimuth_rms": root_mean_square(m.azimuth_difference for m in rows),
            "area_ratio_mean": _mean(
                m.area_km2 / m.area_observed_km2 if m.area_km2 and m.area_observed_km2 else None for m in rows
            ),
            "iou_mean": _mean(m.iou for m in rows),
        }

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, texts, lists and dicts."""
        days = [asdict(day) for day in self.days]
        melt = {"melt": self.melt} if self.melt else {}
        return {"observed": self.observed, "summary": self.summary(), "days": days, **melt}

    def write(self, path: str | Path) -> Path:
        """Write as JSON."""
        return write_json(self.as_dict(), path)


def score_run(
    run: xr.Dataset,
    observed: Observations,
    *,
    hour: float | None = None,
    between: tuple[datetime, datetime] | None = None,
    together: Sequence[int] = (),
    interpolated: bool = False,
) -> Score:
    """Compare a run with observations.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run`, on a sphere.
    observed : Observations
        From `riftberg.read_observed`.
    hour : float, optional
        Hour of the day (UTC) at which observations without a time are compared; by default the hour of the start.
    between : tuple of datetime, optional
        First and last moment to compare.
    together : sequence of int, optional
        Numbers of the fragments that make up the berg, instead of finding them by overlap.
    interpolated : bool, optional
        Compare also with positions that the table calls interpolated.

    Raises
    ------
    InputError
        If nothing was observed during the run.
    """
    scene = Scene(run)
    if not scene.latlon:
        raise InputError("this run is in metres", remedy="Only runs on a sphere can be compared with observations")
    judge = _Judge(scene, tuple(together))
    start: datetime = scene.times[0].astype("datetime64[s]").item()
    at_hour = start.hour + start.minute / 60.0 if hour is None else hour
    wished = [f for f in observed.fixes if interpolated or not f.interpolated]
    fixes = judge.in_run(wished, at_hour)
    outlines = judge.in_run(observed.outlines, at_hour)
    sightings: list[tuple[datetime, int, Outline | Fix]] = [*outlines, *fixes]
    for kind, count in (("outlines", len(outlines)), ("positions", len(fixes))):
        if count > MOST_COMPARED[kind]:
            raise InputError(
                f"{count} {kind} during the run; the most that are compared is {MOST_COMPARED[kind]}",
                where=observed.source, remedy="Give the rows of one berg, or one of an hour",
            )  # fmt: skip
    names = judge.name_fragments(fixes)
    # A berg of the table that a fragment is known as stays in, however far away it is.
    strangers = judge.strangers(fixes) - set(names)
    groups: dict[tuple[datetime, int], list[Outline | Fix]] = {}
    for when, record, item in sightings:
        if item.name not in strangers and (between is None or between[0] <= when <= between[1]):
            groups.setdefault((when, record), []).append(item)
    days = [judge.day(when, record, groups[when, record], names) for when, record in sorted(groups)]
    if not days:
        span = " to ".join(map(minute_text, (scene.times[0], scene.times[-1])))
        raise InputError(
            "nothing was observed during the run", where=observed.source, remedy=f"The run goes from {span}"
        )
    return Score(observed.source, days, melt_lines(run))


MOST_COMPARED: Final = {"outlines": 2000, "positions": 100_000}
"""Most observations compared with one run: half a minute of computing. Nobody sees bergs more often."""


class _Judge:
    """Compares one run, record by record."""

    def __init__(self, scene: Scene, together: tuple[int, ...]) -> None:
        self.scene, self.together = scene, together
        self._before: list[tuple[Floats, int]] = []  # outlines of the time before (degrees), and the fragment of each
        steps = np.diff(scene.seconds)
        self.patience = float(max(3600.0, 0.51 * steps.max())) if len(steps) else 3600.0
        self._fragments: dict[int, list[int]] = {}
        self._positions: dict[tuple[int, tuple[int, ...]], Position] = {}

    def in_run(self, items: Sequence[Seen], hour: float) -> list[tuple[datetime, int, Seen]]:
        """Return the observations during the run, each with its time and the record nearest to it: a table may hold decades."""
        seen = np.array([item.when for item in items], "datetime64[us]")
        day_only = np.array([item.day_only for item in items], bool)
        seen = np.where(day_only, seen + np.timedelta64(round(hour * 3.6e9), "us"), seen)
        times = self.scene.times.astype("datetime64[us]")
        after = np.clip(np.searchsorted(times, seen), 1, max(1, len(times) - 1))
        nearest = np.where(seen - times[after - 1] <= times[after % len(times)] - seen, after - 1, after % len(times))
        is_near = np.abs(times[nearest] - seen) <= np.timedelta64(round(self.patience * 1e6), "us")
        return [(seen[k].item(), int(nearest[k]), items[k]) for k in np.flatnonzero(is_near).tolist()]

    def position(self, record: int, numbers: Iterable[int]) -> Position:
        """Return position and heading of some fragments together; kept, for each is asked for many times."""
        s, key = self.scene, (record, tuple(numbers))
        if key not in self._positions:
            rows = np.isin(s.berg[record], key[1])
            self._positions[key] = berg_position(
                s.x[record][rows], s.y[record][rows], s.areas[record][rows], radius=s.radius
            )
        return self._positions[key]

    def fragments(self, record: int) -> list[int]:
        """Return the fragments large enough to be matched, largest first."""
        if record not in self._fragments:
            areas = self.scene.fragment_areas(record)
            large = [number for number, area in areas.items() if area >= SMALLEST * self.scene.area.sum()]
            # The largest is matched however small it is.
            self._fragments[record] = large or list(areas)[:1]
        return self._fragments[record]

    def day(self, when: datetime, record: int, items: list[Outline | Fix], names: dict[str, int]) -> ScoredDay:
        """Compare at one time."""
        outlines = [item for item in items if isinstance(item, Outline)]
        if outlines:
            matches, unmatched = self._outlines(record, outlines)
        else:
            matches = [self._fix(record, item, names) for item in items if isinstance(item, Fix)]
            used = {n for m in matches for n in m.fragments}
            unmatched = [n for n in self.fragments(record) if n not in used]
        return ScoredDay(when.isoformat(), matches, self.fragments(record)[0], unmatched)

    # --- outlines --------------------------------------------------------------------------------------------------

    def _outlines(self, record: int, outlines: list[Outline]) -> tuple[list[Match], list[int]]:
        # All shapes of a moment on one plane, which touches at the largest fragment: areas and overlaps are true
        # there.
        centre = self.position(record, self.fragments(record)[:1])
        plane = ConformalPlane(centre.lon, centre.lat, self.scene.radius)
        pieces = drop_twins([(o.name, project_polygon(plane, o.ring)) for o in outlines])
        polygons = self.scene.polygons(record)
        shapes = {n: self._union(plane, polygons[self.scene.berg[record] == n]) for n in self.fragments(record)}
        drawn = [shape for _, shape in pieces]
        # The fragments that answered to these pieces when they were seen the time before.
        earlier = [project_polygon(plane, ring) for ring, _ in self._before]
        groups = group_fragments(shapes, drawn, {k: self._before[i][1] for k, i in same_pieces(earlier, drawn).items()})
        self._before = [
            (np.column_stack(plane.inverse(*np.asarray(shape.exterior.coords).T)), group[0])
            for shape, group in zip(drawn, groups, strict=True)
            if group
        ]
        if self.together:
            present = [n for n in self.together if n in shapes]
            groups = [present, *([n for n in g if n not in present] for g in groups[1:])]
        matches = [
            self._piece(record, plane, name, piece, group, shapes)
            for (name, piece), group in zip(pieces, groups, strict=True)
        ]
        used = {n for group in groups for n in group}
        return matches, [n for n in shapes if n not in used]

    def _union(self, plane: ConformalPlane, polygons: Floats) -> BaseGeometry:
        x, y = plane.forward(polygons[..., 0], polygons[..., 1])
        squares = shapely.polygons(np.stack([x, y], axis=-1))
        return join_polygons(squares, _SEAM)

    def _piece(
        self,
        record: int,
        plane: ConformalPlane,
        name: str,
        piece: BaseGeometry,
        group: list[int],
        shapes: dict[int, BaseGeometry],
    ) -> Match:
        x, y, azimuth = polygon_moments(np.asarray(piece.exterior.coords))
        lon, lat = (float(a) for a in plane.inverse(np.array(x), np.array(y)))
        # The meridians converge: north at the piece is not north at the model's berg, on whose plane all lie.
        azimuth = (azimuth + float(np.degrees(plane.eastward(np.array(lon), np.array(lat))))) % 180.0
        iou = intersection_over_union(shapely.union_all([shapes[n] for n in group]), piece) if group else None
        seen = Position(lon, lat, azimuth, float(piece.area))
        return self._match(name or "berg", group, record, seen, iou)

    # --- positions -------------------------------------------------------------------------------------------------

    def name_fragments(self, fixes: list[tuple[datetime, int, Fix]]) -> dict[str, int]:
        """Return which fragment goes by which name.

        Of the names that are seen first the largest fragment has the one nearest to it, and comes first here. The others
        are given in the best way by their mean distances, which must be within `REACH` diameters of the fragment or
        `FIX_REACH`; the time between the break-off and the first sight counts as distance at `DRIFT`.
        """
        seen: dict[str, list[tuple[int, Fix]]] = {}
        for _, record, fix in fixes:
            seen.setdefault(fix.name, []).append((record, fix))
        if not seen:
            return {}
        # By the fragments at the end: those that broke off late have names too.
        largest, *others = self.fragments(len(self.scene.times) - 1)
        earliest = min(record for rows in seen.values() for record, _ in rows)
        first = [name for name in sorted(seen) if any(record == earliest for record, _ in seen[name])]
        main = min(first, key=lambda name: self._mean_distance(largest, seen[name]))
        rest = [name for name in sorted(seen) if name != main]
        cost = np.full((len(rest), len(others)), np.inf)
        for (k, name), (i, number) in product(enumerate(rest), enumerate(others)):
            distance = self._mean_distance(number, seen[name])
            reach = max(FIX_REACH, REACH * 2.0 * math.sqrt(self.scene.final_area(number) / math.pi))
            if distance <= reach:
                cost[k, i] = distance + DRIFT * self._wait(number, seen[name][0][0])
        # To leave a name alone costs as much as the worst match, so that every name that can be matched is.
        alone = float(cost[np.isfinite(cost)].max(initial=FIX_REACH))
        return {main: largest} | {rest[k]: others[i] for k, i in best_pairs(cost, alone)}

    def strangers(self, fixes: list[tuple[datetime, int, Fix]]) -> set[str]:
        """Return the bergs that never came within `STRANGE` of the run's largest fragment: tables may hold all there are."""
        here = [(self.position(record, self.fragments(record)[:1]), fix) for _, record, fix in fixes]
        close_names = {
            fix.name for (_, fix), distance in zip(here, self._apart(here), strict=True) if distance <= STRANGE
        }
        return {fix.name for _, _, fix in fixes} - close_names

    def _apart(self, pairs: list[tuple[Position, Fix]]) -> Floats:
        """Return the distances (m) of observations from positions of the run."""
        lon1, lat1, lon2, lat2 = np.array([(p.lon, p.lat, fix.lon, fix.lat) for p, fix in pairs]).reshape(-1, 4).T
        return haversine(lon1, lat1, lon2, lat2, self.scene.radius)

    def _wait(self, number: int, record: int) -> float:
        """Return the time between the birth of a fragment and a record, s."""
        birth = self.scene.birth(number)
        return abs(float((self.scene.times[record] - birth[0]) / np.timedelta64(1, "s"))) if birth else 0.0

    def _mean_distance(self, number: int, seen: list[tuple[int, Fix]]) -> float:
        """Return the mean distance (m) of a fragment from where a berg was seen; infinite if never both were there."""
        records_present = {record for record, _ in seen if (self.scene.berg[record] == number).any()}
        pairs = [(self.position(record, [number]), fix) for record, fix in seen if record in records_present]
        return float(np.mean(self._apart(pairs))) if pairs else math.inf

    def _fix(self, record: int, fix: Fix, names: dict[str, int]) -> Match:
        number = names.get(fix.name)
        main = number is not None and number == names[next(iter(names))]
        group = list(self.together) if main and self.together else [number] if number is not None else []
        present = [n for n in group if (self.scene.berg[record] == n).any()]
        return self._match(fix.name, present, record, Position(fix.lon, fix.lat, fix.azimuth, fix.area), None)

    def _match(self, name: str, group: list[int], record: int, seen: Position, iou: float | None) -> Match:
        if not group:
            azimuth, area = _or_none(seen.azimuth), _or_none(seen.area / 1e6)
            return Match(name, [], None, None, azimuth, None, None, area, None, None, None, seen.lon, seen.lat)
        modelled = self.position(record, group)
        return Match(
            observed=name,
            fragments=group,
            distance_km=float(haversine(modelled.lon, modelled.lat, seen.lon, seen.lat, self.scene.radius)) / 1e3,
            azimuth=_or_none(modelled.azimuth),
            azimuth_observed=_or_none(seen.azimuth),
            azimuth_difference=_or_none(axis_difference(modelled.azimuth, seen.azimuth)),
            area_km2=modelled.area / 1e6,
            area_observed_km2=_or_none(seen.area / 1e6),
            iou=iou,
            lon=modelled.lon,
            lat=modelled.lat,
            lon_observed=seen.lon,
            lat_observed=seen.lat,
        )


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def root_mean_square(values: Iterable[float | None]) -> float | None:
    """Return the root of the mean square of the values that there are; None where there is none."""
    present = [v for v in values if v is not None]
    return math.sqrt(sum(v * v for v in present) / len(present)) if present else None


def _mean(values: Iterable[float | None]) -> float | None:
    present = [v for v in values if v is not None]
    return sum(present) / len(present) if present else None
