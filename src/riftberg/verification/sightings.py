"""Sightings of a berg, the positions of the members of an ensemble at their dates, and the weights that sightings give them.

A fragment keeps its number when something breaks off, so the first row of the tables of an ensemble is the berg.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
import xarray as xr
from shapely.affinity import rotate, scale, translate

from riftberg.bergs.seams import join_polygons
from riftberg.diagnostics.observed import Observations
from riftberg.diagnostics.outlines import polygon_moments, project_polygon
from riftberg.ensembles.matching import FEW_MEMBERS
from riftberg.ensembles.probability import effective
from riftberg.ensembles.sweep import MEMBERS, WEIGHTS, Plan, Store, read_record, write_record
from riftberg.ensembles.vary import Varied
from riftberg.errors import InputError
from riftberg.plane import ConformalPlane
from riftberg.runs.accessor import own_dates
from riftberg.runs.run_file import open_run
from riftberg.runs.scene import Scene
from riftberg.runs.tracks import axis_difference
from riftberg.state import Floats
from riftberg.system.input_files import reading, shortened
from riftberg.verification.scores import AZIMUTH_ERROR, local

DAY: Final = np.timedelta64(1, "D")

RADIUS: Final = 6.371e6
"""Mean radius of the Earth, m."""


FEWEST: Final = 1.0 / 3.0
"""Part of the members that has to count; below it they are drawn anew."""

KERNEL: Final = 0.3
"""Width of the kernel of Liu and West (2001), in standard deviations of the members."""

FARTHEST: Final = 10.0
"""Distance of a sighting from all members, in standard deviations of its error, beyond which weights say nothing."""


CONTRADICT: Final = 3.0
"""The same of the best member on average over all positions, beyond which a notice says that none agrees with them."""

_LOG: Final = logging.getLogger(__name__)


class Sighting(NamedTuple):
    """A berg at a moment."""

    when: datetime
    lon: float  # Of its centroid, degrees
    lat: float
    azimuth: float  # Long axis, degrees clockwise from north; NaN where it was not seen
    ring: Floats | None  # Outline: longitudes and latitudes, shape (n, 2)

    @property
    def place(self) -> tuple[float, float]:
        """Longitude and latitude."""
        return self.lon, self.lat

    @property
    def shape(self) -> Any:
        """The outline in kilometres east and north of the centroid; None where it was not seen."""
        if self.ring is None:
            return None
        return scale(project_polygon(ConformalPlane(*self.place, RADIUS), self.ring), 1e-3, 1e-3, origin=(0.0, 0.0))


def select_sightings(
    observed: Observations, berg: str | None, start: datetime, hour: float | None
) -> tuple[str, list[Sighting]]:
    """Return the name of the berg and when it was seen, in order: of several pieces at a moment the largest, then positions.

    ``hour``: of observations without a time (UTC), by default the hour of the start.
    """
    outlines = [(o.name, resolve_moment(o.when, o.day_only, start, hour), o) for o in observed.outlines]
    fixes = [(f.name, resolve_moment(f.when, f.day_only, start, hour), f) for f in observed.fixes if not f.interpolated]
    names = sorted({row[0] for row in (*outlines, *fixes)})
    chosen = next((name for name in names if berg is not None and name.lower() == berg.lower()), None)
    if chosen is None and (berg is not None or (len(names) > 1 and not observed.outlines)):
        fault = "several bergs" if berg is None else f"no positions of {berg}"
        listed = ", ".join(name for name in names if name)
        remedy = f"Name one with --berg: {shortened(listed, 100)}" if listed else "It names no berg: leave --berg out"
        raise InputError(fault, where=str(observed.source), remedy=remedy)
    seen: dict[datetime, Sighting] = {}
    sizes: dict[datetime, float] = {}
    for name, when, outline in outlines:
        if chosen not in (None, name):
            continue
        # First where it is, then its axis against north there.
        rough = ConformalPlane(float(outline.ring[0, 0]), float(outline.ring[0, 1]), RADIUS)
        shape = project_polygon(rough, outline.ring)
        if shape.area >= sizes.get(when, 0.0):
            lon, lat = (float(a) for a in rough.inverse(np.array(shape.centroid.x), np.array(shape.centroid.y)))
            polygon = project_polygon(ConformalPlane(lon, lat, RADIUS), outline.ring)
            azimuth = polygon_moments(np.asarray(polygon.exterior.coords))[2] % 180.0
            seen[when], sizes[when] = Sighting(when, lon, lat, azimuth, outline.ring), shape.area
    name = chosen or (names[0] if len(names) == 1 and names[0] else "berg")
    positions = [
        Sighting(when, f.lon, f.lat, f.azimuth, None)
        for name, when, f in fixes
        if chosen in (None, name) and when not in seen
    ]
    return name, sorted([*seen.values(), *positions], key=lambda s: s.when)


def resolve_moment(when: datetime, day_only: bool, start: datetime, hour: float | None) -> datetime:
    """Return the moment of an observation: without a time, that day at an hour (UTC), by default the hour of the start."""
    return when + timedelta(hours=start.hour + start.minute / 60.0 if hour is None else hour) if day_only else when


def check_dates(broken: datetime | None, whole_until: datetime | None) -> None:
    """Refuse a berg that was seen whole after it was seen broken."""
    if broken is not None and whole_until is not None and whole_until >= broken:
        raise InputError("whole until after it broke", where="--whole-until", remedy="Give an earlier date")


# --- members ------------------------------------------------------------------------------------------------------------


def track_dates(ds: xr.Dataset) -> Any:
    """Return the dates of the tracks of an ensemble, or of a member, in nanoseconds; members of other dates are refused."""
    if "start_after" in ds.coords and np.ptp(ds["start_after"].values) > 0.0:
        raise InputError(
            "members that start at different dates", where="ensemble",
            remedy="Give a forecast, or the members of one start: result.isel(member=result.start_after == 0)",
        )  # fmt: skip
    return own_dates(ds.isel(member=0) if "member" in ds.dims else ds)


def ensemble_start(ds: xr.Dataset) -> datetime:
    """Return the start of an ensemble."""
    start: datetime = track_dates(ds)[0].astype("datetime64[us]").item()
    return start


def berg_offsets(ds: xr.Dataset, when: datetime, position: tuple[float, float]) -> Floats:
    """Return kilometres of the first berg of each member east and north of a place at a date (members, 2)."""
    if "lon" not in ds:
        raise InputError("positions in metres", where="ensemble", remedy="Observations need longitude and latitude")
    lon, lat = (ds[name].isel(fragment=0).values.astype(float) for name in ("lon", "lat"))
    (first, after), share = between(track_dates(ds), when)
    earlier, then = (np.stack(local(*position, lon[:, k], lat[:, k]), axis=-1) for k in (first, after))
    return np.asarray(then if share == 1.0 else earlier + share * (then - earlier))


def between(times: Any, when: datetime) -> tuple[tuple[int, int], float]:
    """Return the records before and after a date, and its place between them, 0 to 1."""
    date = np.datetime64(when, "ns")
    after = int(np.clip(np.searchsorted(times, date), 1, len(times) - 1))
    return (after - 1, after), float((date - times[after - 1]) / (times[after] - times[after - 1]))


def axis_angles(ds: xr.Dataset, when: datetime, axis: float) -> Floats:
    """Return the angle from an axis to the long axis of the first berg, degrees, at the record nearest to a date (members,)."""
    nearest = int(np.abs(track_dates(ds) - np.datetime64(when, "ns")).argmin())
    return np.asarray(axis_difference(ds["azimuth"].values[:, 0, nearest].astype(float), axis))


def drift_error(ensemble: xr.Dataset, observed: Observations, *, berg: str | None = None) -> Floats:
    """Return the mean distance (km) of each member's berg from the observed positions after the start."""
    start, end = ensemble_start(ensemble), track_dates(ensemble)[-1].astype("datetime64[us]").item()
    seen = during(*select_sightings(observed, berg, start, None), start, end, str(observed.source))
    return np.asarray(np.mean([np.linalg.norm(berg_offsets(ensemble, s.when, s.place), axis=-1) for s in seen], axis=0))


def during(name: str, seen: list[Sighting], start: datetime, end: datetime, where: str) -> list[Sighting]:
    """Return when and where a berg was seen after the start of runs until their end; none is refused."""
    sightings = [s for s in seen if start < s.when <= end]
    if not sightings:
        raise InputError(
            f"no position of {name or 'the berg'} from {start:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M}", where=where,
            remedy="Give positions of the time of the runs",
        )  # fmt: skip
    return sightings


def read_first_outline(file: Path) -> Any:
    """Return the outline of all ice at the start of a run in kilometres east and north of its centroid."""
    with open_run(file) as run:
        scene = Scene(run)
        corners = scene.polygons(0)
        lon, lat = (float(np.average(a[0], weights=scene.area)) for a in (scene.x, scene.y))
    x, y = ConformalPlane(lon, lat, scene.radius).forward(corners[..., 0], corners[..., 1])
    squares = shapely.polygons(np.stack([x, y], axis=-1) / 1e3)
    seam = 1e-3 * float(np.sqrt(scene.area.min()) / 1e3)  # elements meet to within rounding errors
    outline = max(shapely.get_parts(join_polygons(squares, seam)), key=lambda piece: piece.area)
    return translate(outline, -outline.centroid.x, -outline.centroid.y)


def member_outlines(
    ds: xr.Dataset, start: Any, seen: Sighting, pieces: Callable[[int], list[list[Any]]] | None = None
) -> list[Any]:  # fmt: skip
    """Return the outlines of the first berg of the members at a sighting, kilometres east and north of its centroid.

    ``start``: outline at the start of the run in which nothing is varied; ``pieces``: gives the outlines of a member that
    broke up, as `riftberg.ensembles.member.Outcome` has them. A berg is rigid until it breaks: its centroid gives the position,
    its long axis the turn, its area the size.
    """
    (first, after), share = between(track_dates(ds), seen.when)
    broke = ds["first_breakup"].values <= np.datetime64(seen.when, "ns")
    position = berg_offsets(ds, seen.when, seen.place)
    azimuth = ds["azimuth"].isel(fragment=0).values.astype(float)
    # Of one that broke between two records the area is that after it.
    area = 1e-6 * ds["area"].isel(fragment=0).values.astype(float)
    area = np.where(broke, area[:, after], area[:, first])
    # An axis has no direction, so a turn is known but for 180 degrees: at the start the smaller one, then continued.
    turn = np.unwrap(azimuth, period=180.0, axis=1) - azimuth[:, :1]
    turn += axis_difference(azimuth[:, :1], long_axis_azimuth(start))
    outlines = []
    for m in np.flatnonzero(np.isfinite(position).all(axis=1)).tolist():
        shape, turns = start, turn[m]
        if broke[m]:
            rings = [] if pieces is None else pieces(int(ds["member"].values[m]))
            if not any(number == 1 for number, _ in rings):
                continue
            shape, turns = broken_outline(ds.isel(member=m), rings, after, seen.when)
        size = np.sqrt(area[m] / shape.area)
        turned = rotate(shape, -((1.0 - share) * turns[first] + share * turns[after]), origin=(0.0, 0.0))
        outlines.append(translate(scale(turned, size, size, origin=(0.0, 0.0)), *position[m]))
    return outlines


def read_pieces(ensemble: Path, number: int) -> list[list[Any]]:
    """Return the outlines of the pieces of a member that broke up, from the folder of its ensemble; none where it keeps none."""
    file = (ensemble if ensemble.is_dir() else ensemble.parent) / MEMBERS / f"{number:05d}.json"
    with reading(file, "a damaged member", "Run it again by --resume"):
        shapes: list[list[Any]] = read_record(file).get("shapes", []) if file.exists() else []
    return shapes


def long_axis_azimuth(shape: Any) -> float:
    """Return the azimuth of the long axis of a polygon, degrees."""
    return polygon_moments(np.asarray(shape.exterior.coords))[2]


def broken_outline(member: xr.Dataset, rings: list[list[Any]], last: int, when: datetime) -> tuple[Any, Floats]:
    """Return the outline of the first berg of a member at a date (km about its centroid), and its turn by record.

    ``rings``: outlines at the end where their ice lay at the start; pieces that break off later belong to the berg;
    ``last``: record after the date.
    """
    names = ("number", "parent", "birth_time")
    rows = zip(*(member[f"fragment_{name}"].values for name in names), strict=True)
    parents = {int(number): (int(parent), born) for number, parent, born in rows if np.isfinite(number)}

    def owner(number: int, date: Any) -> int:
        while number in parents and parents[number][0] > 0 and parents[number][1] > date:
            number = parents[number][0]
        return number

    shapes: dict[tuple[int, ...], Any] = {}

    def find_shape(date: Any) -> Any:
        numbers = tuple(k for k, (number, _) in enumerate(rings) if owner(number, date) == 1)
        if numbers not in shapes:
            # Pieces of one lattice meet, but for what rounding their corners took: closed by a hundredth of the berg.
            polygons = [shapely.Polygon(np.array(rings[k][1]) / 1e3) for k in numbers]
            seam = 0.02 * float(np.sqrt(sum(polygon.area for polygon in polygons)))
            ice = shapely.buffer(shapely.buffer(shapely.union_all(polygons), seam), -seam)
            shape = max(shapely.get_parts(ice), key=lambda polygon: polygon.area)
            shapes[numbers] = translate(shape, -shape.centroid.x, -shape.centroid.y)
        return shapes[numbers]

    turns, turned = np.zeros(last + 1), 0.0
    azimuth = member["azimuth"].isel(fragment=0).values.astype(float)
    for k, time in enumerate(track_dates(member)[: last + 1]):
        turned += axis_difference(azimuth[k] - long_axis_azimuth(find_shape(time)), turned)
        turns[k] = turned
    return find_shape(np.datetime64(when, "ns")), turns


# --- weights -----------------------------------------------------------------------------------------------------------


def log_likelihood(
    ds: xr.Dataset, observed: Observations | None, *, error: float, berg: str | None = None, hour: float | None = None,
    broken: datetime | None = None, whole_until: datetime | None = None, doubt: float = 0.05,
    azimuth_error: float | None = AZIMUTH_ERROR,
) -> Floats:  # fmt: skip
    """Return the logarithm of the probability of all sightings for each member; NaN for one that failed.

    ``error``: standard deviation of a position along each axis, km; ``azimuth_error``: of a long axis, degrees, none to leave
    axes out; ``doubt``: probability that it was wrongly seen whole or broken. Sightings are independent of each other.
    """
    check_dates(broken, whole_until)
    times = track_dates(ds)
    total = np.where(ds["status"].values == 0, 0.0, np.nan)
    if not np.isfinite(total).any():
        raise InputError("no member came to its end", where="update", remedy="Look at the reasons in sweep.json")
    count, squares = 0, np.zeros(total.size)
    _, sightings = ("", []) if observed is None else select_sightings(observed, berg, ensemble_start(ds), hour)
    for seen in sightings:
        if not times[0] <= np.datetime64(seen.when, "ns") <= times[-1]:
            continue
        offset = berg_offsets(ds, seen.when, seen.place)
        if (nearest := float(np.nanmin(np.hypot(*offset.T)))) > FARTHEST * error:
            assert observed is not None
            raise InputError(
                f"on {seen.when:%Y-%m-%d %H:%M} the berg was seen {nearest:,.0f} km from the nearest member, with an error "
                f"of {error:g} km",
                where=str(observed.source),
                remedy="Check place, date and berg; if they are right, give an error that covers it (--error)",
            )
        square = (offset**2).sum(axis=-1) / error**2
        total -= 0.5 * square
        squares += square
        if azimuth_error is not None and np.isfinite(seen.azimuth):
            total -= 0.5 * (axis_angles(ds, seen.when, seen.azimuth) / azimuth_error) ** 2
        count += 1
    if count and (best := float(np.sqrt(np.nanmin(squares + 0.0 * total) / count))) > CONTRADICT:
        _LOG.warning("no member agrees with all %d positions: the best one is %.1f standard deviations off on average. "
                     "Check dates and positions, or take a larger error", count, best)  # fmt: skip
    first = ds["first_breakup"].values.astype("datetime64[ns]")
    for date, was in ((broken, True), (whole_until, False)):
        if date is not None:
            moment = np.datetime64(date, "ns")
            if not times[0] <= moment <= times[-1] + DAY:
                raise InputError(f"{date:%Y-%m-%d %H:%M} is not within the forecast", where="update")
            right = (~np.isnat(first) & (first <= moment)) == was
            if not (right & np.isfinite(total)).any():
                _LOG.warning("no member %s by %s: this sighting tells none from another",
                             "had broken up" if was else "was still whole", f"{date:%Y-%m-%d %H:%M}")  # fmt: skip
            total += np.log(np.where(right, 1.0 - doubt, doubt))
            count += 1
    if not count:
        raise InputError("no sighting during the forecast", where="update", remedy="Give positions, or --broken DATE")
    return total


def weighted(store: Store, likelihood: Floats, about: str) -> tuple[Floats, float]:
    """Write the weights of a forecast and the forecast anew; return weights (sum 1) and their effective number."""
    base = read_base(store, likelihood.size)
    # Less the largest difference: the likelihoods of members that were drawn anew lie far above those of their parents.
    weight = np.exp(likelihood - base - np.nanmax(likelihood - base))
    weight = np.nan_to_num(weight / np.nansum(weight))
    record = {"observed": about, "effective": effective(weight), "base": base.tolist(),
            "weight": (weight * np.count_nonzero(np.isfinite(likelihood))).tolist()}  # fmt: skip
    write_record(store.folder / WEIGHTS, record)
    store.write()
    return weight, effective(weight)


def read_base(store: Store, count: int) -> Floats:
    """Return the logarithm of the probability by which each member was chosen before: 0 unless it was drawn anew."""
    return np.array(store.weights().get("base", [0.0] * count))


def redraw_members(plan: Plan, weight: Floats, likelihood: Floats) -> tuple[dict[str, list[Any]], list[float], int]:
    """Return inputs of new members around those that count, the logarithms of their parents' likelihood, and how many these are.

    Numbers move by the kernel of Liu and West (2001) in the normal scores of their distributions, which keeps mean and
    variance; choices and random fields are the parent's. A new member counts by its likelihood over its parent's.
    """
    random = np.random.default_rng(1)
    parents = np.searchsorted(np.cumsum(weight), (np.arange(weight.size) + random.random()) / weight.size).clip(
        0, weight.size - 1
    )
    columns: dict[str, list[Any]] = {name: [plan.members[k][name] for k in parents] for name in plan.members[0]}
    for v in plan.varied:
        if v.distribution is not None and not v.distribution.choices and v.components == 1:
            columns[v.name] = _moved(v, np.array([values[v.name] for values in plan.members]), parents, weight, random)
    return columns, [float(likelihood[k]) for k in parents], len(np.unique(parents))


def _moved(v: Varied, values: Floats, parents: Any, weight: Floats, random: np.random.Generator) -> list[Any]:
    from scipy.stats import norm

    assert v.distribution is not None
    score = norm.ppf(np.clip(v.distribution.shares_below(values), 1e-9, 1.0 - 1e-9))
    mean = weight @ score
    # Few members lie close together by chance, and a single one has no spread at all: theirs is drawn towards that of all.
    shrinkage = FEW_MEMBERS / (FEW_MEMBERS + effective(weight))
    spread = np.sqrt((1.0 - shrinkage) * (weight @ (score - mean) ** 2) + shrinkage)
    shrunk = mean + np.sqrt(1.0 - KERNEL**2) * (score[parents] - mean)
    return v.distribution.quantiles(norm.cdf(shrunk + KERNEL * spread * random.standard_normal(len(parents))))
