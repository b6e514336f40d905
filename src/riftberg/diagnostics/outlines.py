"""Observed outlines from drawings and grids (KML, shapefiles, masks, tables of corners in NetCDF), their dates, their overlap.

Drawings are read by the readers that also make bergs (`riftberg.bergs.outline`), masks by
`riftberg.bergs.raster`. Only outer rings count: a pool of water within the berg belongs to it. Lines (rifts) and points
are left alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
import xarray as xr
from shapely import Polygon, make_valid
from shapely.affinity import translate
from shapely.validation import explain_validity

from riftberg.bergs.outline import DATE_KEYS, DATES_BY_BELIEF, Feature, join_polygons, read_features
from riftberg.bergs.raster import Raster, read_raster, unbroken
from riftberg.bergs.seams import NO_BERG, ring_fault
from riftberg.config.values import parse_date
from riftberg.errors import BergError, InputError
from riftberg.plane import ConformalPlane
from riftberg.runs.accessor import best_pairs
from riftberg.runs.tracks import principal_azimuth
from riftberg.state import Floats
from riftberg.system.input_files import MOST_VALUES, reading, refuse_large, value_shown
from riftberg.system.netcdf_lock import open_lazily

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


SMALLEST: Final = 0.005
"""Pieces of a mask below this part of all ice of their date are left out: single cells are no bergs."""

CROSSED: Final = 0.02
"""Part of its area that an outline may have in loops that cross: hand-drawn ones have small ones."""

_MOST: Final = 500
"""Most pieces that whole numbers may distinguish; with more of them it is no mask but a depth or a height."""

_MASKS: Final = ("mask", "berg", "b_id", "iceberg", "berg_mask", "iceberg_mask", "label", "labels", "fraction")
_LINES: Final = ("crack", "rift", "line")


@dataclass(frozen=True)
class Outline:
    """One closed outline."""

    name: str  # Berg, or source where the file names none
    when: datetime  # UTC; midnight where only a day is given
    day_only: bool  # No time of day was given
    ring: Floats  # Longitude and latitude, first point not repeated; shape (n, 2)


class NoBergError(InputError):
    """An outline that no berg has, such as one around a pole."""


def checked_ring(points: Any, where: str, remedy: str = "GeoJSON has longitude first") -> Floats:
    """Return an outer ring without the repeated point, or refuse a faulty one."""
    try:
        ring = np.asarray(points, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("vertices that are no numbers", where=where, remedy=remedy) from error
    if ring.ndim != 2 or ring.shape[1] < 2:
        raise InputError("an outline needs pairs of longitude and latitude", where=where, remedy=remedy)
    if not np.isfinite(ring[:, :2]).all():
        raise InputError("an outline with vertices that are not numbers", where=where, remedy="Leave these out")
    ring = ring[:, :2]
    if len(ring) > 1 and (ring[0] == ring[-1]).all():
        ring = ring[:-1]
    if (np.abs(ring[:, 1]) > 90.0).any():
        raise InputError("a latitude beyond 90 degrees", where=where, remedy=remedy)
    if (np.abs(ring[:, 0]) > 540.0).any():
        raise InputError("a longitude beyond 540 degrees", where=where, remedy=remedy)
    if fault := ring_fault(ring):
        raise NoBergError(fault, where=where, remedy=NO_BERG)
    # Across the date line the corners jump by 360 degrees; unwrapped, the polygon is whole.
    drawn = Polygon(np.column_stack([np.unwrap(ring[:, 0], period=360.0), ring[:, 1]]))
    if not drawn.is_valid and abs(drawn.area / make_valid(drawn).area - 1.0) > CROSSED:
        raise InputError(
            f"an outline that crosses itself ({explain_validity(drawn)})", where=where,
            remedy="Give its corners in their order around the berg",
        )  # fmt: skip
    return ring


# --- drawings ----------------------------------------------------------------------------------------------------------


def read_drawing(path: Path, date: str | None = None) -> Iterator[Outline | NoBergError]:
    """Read the polygons of a GeoJSON or KML file or of a shapefile; lines (rifts) and points are left alone."""
    polygons = [Feature(area, f.properties) for f in read_features(path) if (area := join_polygons(f.geometry))]
    if not polygons:
        raise InputError("no polygons, only lines or points", where=str(path), remedy="Outlines are closed polygons")
    for number, feature in enumerate(polygons):
        where = f"{path}, outline {number}"
        # A name that is only its date is none.
        name = "" if len(feature.name) <= 10 and date_in_text(feature.name) else feature.name
        for polygon in getattr(feature.geometry, "geoms", [feature.geometry]):
            try:
                ring = checked_ring(polygon.exterior.coords, where, "Add the .prj file with its coordinate system")
            except NoBergError as fault:  # another one may be meant
                yield fault
                continue
            when, day_only = find_date(feature.properties, [path.stem], where=where, stated=date)
            yield Outline(name, when, day_only, ring)


# --- grids -------------------------------------------------------------------------------------------------------------


def read_grid_outlines(path: Path, date: str | None = None, variable: str | None = None) -> Iterator[Outline]:
    """Read the outlines of a gridded mask, or of tables of corners, from NetCDF.

    A mask of 0 and 1, or the fraction of ice in a cell, is outlined where its bilinear value is one half, as
    `Iceberg.from_mask` fills it. A mask of whole numbers numbers the pieces: each is outlined alone and has its
    number for a name. A table has longitudes in one row (or column) and latitudes in the next, and NaN in the others.
    """
    with reading(path, "cannot be read", "Name a NetCDF file"), open_lazily(path) as opened:
        refuse_large(
            sum(values.size for values in opened.data_vars.values()), MOST_VALUES, "values", size=8.0, where=str(path),
            remedy="Cut the file to the berg and its dates", kind=InputError,
        )  # fmt: skip
        data = opened.load()
    tables = {str(n): t for n, v in data.data_vars.items() if (t := _corners(v)) is not None}
    if tables and variable is None:
        for name, table in tables.items():
            when, day_only = find_date({**data.attrs, **data[name].attrs}, [path.stem], where=str(path), stated=date)
            if not name.lower().startswith(_LINES):
                yield Outline(name, when, day_only, checked_ring(table, f"{path}, {name}"))
        return
    name = variable or _mask_variable(data, path)
    if name not in data:
        raise InputError(f"no variable {name!r}", where=str(path), remedy=f"It holds {', '.join(map(str, data))}")
    yield from _dated_pieces(data[name], data.attrs, path, date)


def _corners(table: xr.DataArray) -> Floats | None:
    """Return the corners of a table of longitudes and latitudes, None if it is something else."""
    if table.ndim != 2 or table.coords or not np.issubdtype(table.dtype, np.number):
        return None
    values = np.asarray(table.values, np.float64)
    values = np.where(
        np.abs(values) > 1e30, np.nan, values
    )  # the fill value of NetCDF, which such files do not declare
    # Corners may stand in rows or in columns.
    for rows in (values, values.T):
        # Longitudes and latitudes fill the beginning of the first two rows; all else is missing.
        full = np.isfinite(rows)
        count = int(full[0].sum()) if len(rows) > 1 else 0
        if count >= 3 and (full[:2] == (np.arange(rows.shape[1]) < count)).all() and not full[2:].any():
            return np.asarray(rows[:2, :count].T)
    return None


def _mask_variable(data: xr.Dataset, path: Path) -> str:
    names = [str(name) for name, values in data.data_vars.items() if values.ndim >= 2]
    mask_names = [name for name in names if name.lower() in _MASKS]
    if len(names) == 1 or len(mask_names) == 1:
        return (mask_names or names)[0]
    raise InputError(
        f"{len(names)} gridded variables", where=str(path),
        remedy=f"Name the mask with --variable: {', '.join(names) or 'there is none'}",
    )  # fmt: skip


def _dated_pieces(mask: xr.DataArray, attributes: Mapping[str, Any], path: Path, date: str | None) -> Iterator[Outline]:
    """Yield the pieces of every date of a mask."""
    where = f"{path}, {mask.name}"
    fields = [mask.isel(time=k) for k in range(mask.sizes["time"])] if "time" in mask.dims else [mask]
    times = [str(f["time"].values)[:19] if "time" in f.coords else "" for f in fields]
    # A day is written as its midnight, which is no time of day.
    midnight = all(time.endswith("00:00:00") for time in times)
    for field, time in zip(fields, times, strict=True):
        stated = {"time": time[:10] if midnight else time} if time else {**attributes, **mask.attrs}
        when, day_only = find_date(stated, [path.stem], where=where, stated=date)
        try:
            raster = read_raster(field.drop_vars("time", errors="ignore"))
        except BergError as error:
            raise InputError(error.what, where=where, remedy=error.remedy) from error
        for name, ring in mask_pieces(raster, mask.attrs, where):
            yield Outline(name, when, day_only, ring)


def mask_pieces(mask: Raster, attributes: Mapping[str, Any], where: str) -> list[tuple[str, Floats]]:
    """Return names and outer rings of the pieces of a mask, those too small left out."""
    values = np.nan_to_num(mask.values)
    if str(attributes.get("units", "")).strip().lower() in ("%", "percent", "per cent"):
        values = values / 100.0
    if values.min() >= -1e-9 and values.max() <= 1.0 + 1e-9:
        pieces = [("", ring) for ring in _contour_rings(replace(mask, values=values), where)]
    elif len(numbers := np.unique(values[values > 0.0])) <= _MOST and (values == np.round(np.abs(values))).all():
        each = {f"{n:g}": replace(mask, values=(values == n).astype(np.float64)) for n in numbers}
        pieces = [(name, ring) for name, numbered in each.items() for ring in _contour_rings(numbered, where)]
    else:
        raise InputError(
            f"values from {values.min():g} to {values.max():g} are no mask", where=where,
            remedy="A mask has 0 and 1, fractions between, per cent (with units), or whole numbers that number the pieces",
        )  # fmt: skip
    if not pieces:
        raise BergError("no ice in the mask", where=where, remedy="Cells of ice have values above one half")
    areas = []  # in squares of a degree of latitude
    for _, ring in pieces:
        x, y = ring[:, 0] * np.cos(np.radians(ring[:, 1].mean())), ring[:, 1]
        areas.append(0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))))
    return [piece for piece, area in zip(pieces, areas, strict=True) if area >= SMALLEST * sum(areas)]


def _contour_rings(mask: Raster, where: str) -> list[Floats]:
    """Return the outer rings of where the values exceed one half; a frame of water closes them at the edge."""
    from contourpy import FillType, contour_generator

    ice = mask.values > 0.5
    mask = unbroken(mask, ice) if ice.any() else mask
    # Round the whole Earth: a berg across the seam would be outlined as two.
    is_global = mask.lon[-1] - mask.lon[0] + np.diff(mask.lon).mean() >= 359.9
    if is_global and (mask.values[:, [0, -1]] > 0.5).any(axis=0).all():
        raise InputError(
            "there is ice at all longitudes", where=where,
            remedy="Cut the grid to the berg, or roll the longitudes, so that they begin in open water",
        )  # fmt: skip
    # One more line on each side, as far apart as the last two.
    lon, lat = (np.concatenate([[2 * a[0] - a[1]], a, [2 * a[-1] - a[-2]]]) for a in (mask.lon, mask.lat))
    framed = np.pad(mask.values, 1)
    contours = contour_generator(lon, lat, framed, name="serial", fill_type=FillType.OuterOffset)
    points, offsets = contours.filled(0.5, np.inf)[:2]
    rings = [p[o[0] : o[1] - 1] for p, o in zip(points, offsets, strict=True) if p is not None and o is not None]
    return [np.asarray(ring, np.float64) for ring in rings if len(ring) >= 3]


TWINS: Final = 0.8
"""Two outlines of a day that overlap more than this (intersection over union) are one piece drawn twice."""

REACH: Final = 3.0
"""Mean diameters between the centroids beyond which a fragment and a piece that do not overlap are not the same."""

LARGEST_RATIO: Final = 4.0
"""Ratio of areas beyond which a fragment is not the piece."""

KEPT: Final = 0.5
"""Part of its cost that a pair has if it held the time before: a fragment does not change its name without need."""

WORST: Final = 3.0
"""Cost of a pair that may just be, and of a piece that stays without a fragment."""


def group_fragments(
    shapes: dict[int, BaseGeometry], pieces: Sequence[BaseGeometry], previous: Mapping[int, int] | None = None
) -> list[list[int]]:
    """Return which fragments make up each observed piece.

    Each piece gets at most one fragment first, all pieces together in the best way (`pair_cost`). A fragment that is
    left joins the piece whose overlap, centroid on centroid, it makes better.
    """
    union = shapely.union_all
    numbers, previous = list(shapes), previous or {}
    cost = np.empty((len(pieces), len(numbers)))
    for (k, piece), (i, number) in product(enumerate(pieces), enumerate(numbers)):
        same = KEPT if previous.get(k) == number else 1.0
        cost[k, i] = same * pair_cost(shapes[number], piece, main=i == k == 0)
    groups: list[list[int]] = [[] for _ in pieces]
    free = dict(shapes)
    for k, column in best_pairs(cost, alone=WORST):
        groups[k] = [numbers[column]]
        del free[numbers[column]]
    for number, shape in free.items():
        # How much better each piece would be covered with the fragment than without it.
        gains = [
            aligned_overlap(union([shapes[n] for n in (*group, number)]), piece)
            - aligned_overlap(union([shapes[n] for n in group]), piece)
            if group
            else 0.0
            for group, piece in zip(groups, pieces, strict=True)
        ]
        if max(gains, default=0.0) > 0.0 and shape.area > 0.0:
            groups[int(np.argmax(gains))].append(number)
    return groups


def same_pieces(earlier: Sequence[BaseGeometry], pieces: Sequence[BaseGeometry]) -> dict[int, int]:
    """Return which piece (by its index) is which one of an earlier time, all in the best way."""
    cost = np.empty((len(pieces), len(earlier)))
    for (k, piece), (i, other) in product(enumerate(pieces), enumerate(earlier)):
        cost[k, i] = pair_cost(other, piece)
    return dict(best_pairs(cost, alone=WORST))


def pair_cost(shape: BaseGeometry, piece: BaseGeometry, *, main: bool = False) -> float:
    """Return how badly a fragment answers to an observed piece, 0 to `WORST`; infinite where it is not that piece.

    The cost is the sum of three parts from 0 to 1: one minus the overlap (intersection over union), the distance of the
    centroids as a part of the largest that may be, and the logarithm of the ratio of areas over the logarithm of
    `LARGEST_RATIO`. A fragment is not the piece if it has more than `LARGEST_RATIO` times its area; or if they do not overlap
    and it has less than that part of it, or lies further away than `REACH` times the mean diameter of both (of circles of
    their areas).

    ``shape``, ``piece``: outlines of the fragment and the piece, m.
    """
    if min(shape.area, piece.area) <= 0.0:
        return math.inf
    iou, ratio = intersection_over_union(shape, piece), float(shape.area / piece.area)
    diameters = [2.0 * math.sqrt(a.area / math.pi) for a in (shape, piece)]
    distance = float(shape.centroid.distance(piece.centroid)) / (REACH * 0.5 * sum(diameters))
    unlike = abs(math.log(ratio)) / math.log(LARGEST_RATIO)
    if ratio > LARGEST_RATIO or (iou == 0.0 and (unlike > 1.0 or (distance > 1.0 and not main))):
        return math.inf
    return 1.0 - iou + min(distance, 1.0) + min(unlike, 1.0)


def intersection_over_union(a: BaseGeometry, b: BaseGeometry) -> float:
    """Return the intersection over the union of two outlines."""
    common = float(a.intersection(b).area)
    union = float(a.area) + float(b.area) - common
    return common / union if union > 0.0 else 0.0


def aligned_overlap(a: BaseGeometry, b: BaseGeometry) -> float:
    """Return the intersection over the union of two outlines whose centroids are laid on each other."""
    origin, target = a.centroid, b.centroid
    return intersection_over_union(translate(a, target.x - origin.x, target.y - origin.y), b)


def polygon_moments(ring: Floats) -> tuple[float, float, float]:
    """Return the centroid of a polygon and the azimuth of its axis of the largest second moment.

    ``ring``: corners, m east and north, closed or not (shape (n, 2)); returns ``x, y``: centroid, m.
    """
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    xn, yn = np.roll(x, -1), np.roll(y, -1)
    cross = x * yn - xn * y
    area = 0.5 * cross.sum()
    cx, cy = ((x + xn) * cross).sum() / (6.0 * area), ((y + yn) * cross).sum() / (6.0 * area)
    xx = ((x * x + x * xn + xn * xn) * cross).sum() / (12.0 * area) - cx * cx
    yy = ((y * y + y * yn + yn * yn) * cross).sum() / (12.0 * area) - cy * cy
    xy = ((x * yn + 2.0 * x * y + 2.0 * xn * yn + xn * y) * cross).sum() / (24.0 * area) - cx * cy
    return float(cx + ring[0, 0]), float(cy + ring[0, 1]), float(principal_azimuth(xx, yy, xy))


def project_polygon(plane: ConformalPlane, ring: Floats) -> BaseGeometry:
    """Return an outline on the plane; one that crosses itself is made valid and its largest part kept."""
    x, y = plane.forward(ring[:, 0], ring[:, 1])
    polygon: BaseGeometry = shapely.Polygon(np.column_stack([x, y]))
    if not polygon.is_valid:
        # Parts may be collections themselves, and lines where the outline runs back along itself.
        polygons = shapely.get_parts(shapely.get_parts(shapely.make_valid(polygon)))
        polygon = max(polygons, key=lambda single: single.area)
    return polygon


def drop_twins(pieces: list[tuple[str, BaseGeometry]]) -> list[tuple[str, BaseGeometry]]:
    """Return the pieces largest first, without those drawn twice."""
    unique: list[tuple[str, BaseGeometry]] = []
    for name, piece in sorted(pieces, key=lambda p: -p[1].area):
        if not any(intersection_over_union(piece, other) > TWINS for _, other in unique):
            unique.append((name, piece))
    return unique


NAME_KEYS: Final = ("berg", "iceberg", "name", "label", "variable", "outline", "id", "folder", "description")
"""Attributes in whose text a date may stand, such as ``A68A 2020-12-17``."""

_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NUMBERS: Final = re.compile(
    r"(?<!\d)((?:19|20)\d\d)([-_./]?)(0[1-9]|1[0-2])\2(0[1-9]|[12]\d|3[01])"
    r"(?:T(\d\d):?(\d\d)(?::?(\d\d))?Z?|[ _](\d\d):(\d\d)(?::(\d\d))?)?(?!\d)",
    re.IGNORECASE,
)
_WORDS: Final = re.compile(
    rf"(?<!\d)(\d?\d)[-_. ]?({'|'.join(_MONTHS)})[a-z]*[-_., ]*((?:19|20)\d\d)(?!\d)", re.IGNORECASE
)


def date_in_text(text: str) -> tuple[datetime, bool] | None:
    """Find the date in a name, such as ``a68a_2020-12-17``, ``S1A_EW_20201217T081533`` or ``17 Dec 2020``."""
    dates: set[tuple[datetime, bool]] = set()
    for match in _NUMBERS.finditer(text):
        year, _, month, day, *clock = match.groups()
        hour, minute, second = clock[:3] if clock[0] else clock[3:]
        dates |= _moment(year, month, day, hour, minute, second)
    for match in _WORDS.finditer(text):
        dates |= _moment(match[3], str(_MONTHS.index(match[2].lower()) + 1), match[1], None, None, None)
    return dates.pop() if len(dates) == 1 else None


def _moment(*fields: str | None) -> set[tuple[datetime, bool]]:
    """Return a moment as a set of one; an impossible one gives an empty set."""
    year, month, day, hour, minute, second = (int(field or 0) for field in fields)
    try:
        return {(datetime(year, month, day, hour, minute, second), fields[3] is None)}
    except ValueError:
        return set()


_CLOCK: Final = re.compile(r"(\d\d?):?(\d\d)(?::(\d\d)(?:\.\d*)?)?(?: ?UTC| ?Z)?", re.IGNORECASE)


def find_attribute_date(values: Mapping[str, str], *, where: str) -> tuple[datetime, bool] | None:
    """Return the date that attributes or the columns of a row give, with the time of day where one says it; None without any.

    Dates when a picture was taken go before others, and before the beginning of a span. Others must fall on one day.
    """
    for keys in DATES_BY_BELIEF:
        texts = {key: values[key] for key in keys if values.get(key)}
        # A column acquired may name a sensor; another date that cannot be read is a fault.
        read = [key for key, text in texts.items() if _is_date(text)] or list(texts)[: keys is not DATES_BY_BELIEF[0]]
        dates = {k: _add_clock(*parse_date(texts[k], where=f"{where}, {k}"), k, values, where) for k in read}
        days = {when.date(): key for key, (when, _) in reversed(dates.items())}
        if len(days) > 1:
            (first_date, a), (second_date, b) = sorted(days.items())[:2]
            raise InputError(
                f"{a} says {first_date}, {b} says {second_date}, and nothing tells when the berg lay there", where=where,
                remedy=f"Leave one of them out, or call the date of the picture {DATES_BY_BELIEF[0][0]}",
            )  # fmt: skip
        if dates:
            return next((date for date in dates.values() if not date[1]), next(iter(dates.values())))
    return None


def _add_clock(
    when: datetime, day_only: bool, key: str, values: Mapping[str, str], where: str
) -> tuple[datetime, bool]:
    """Return a date with the time of day that stands beside it: acq_time beside acq_date."""
    name = key.replace("date", "time")
    text = values.get(name, "") if name != key and day_only else ""
    if not text or _is_date(text):
        return when, day_only
    clock = _CLOCK.fullmatch(text)
    if clock is None or int(clock[1]) > 23 or int(clock[2]) > 59:
        raise InputError(
            f"{value_shown(text)} is no time of day", where=f"{where}, {name}", remedy="Write it like 18:30, in UTC"
        )
    hour, minute, second = (int(digits or 0) for digits in clock.groups())
    return when + timedelta(hours=hour, minutes=minute, seconds=second), False


def _is_date(text: str) -> bool:
    with suppress(InputError):
        parse_date(text, where="")
        return True
    return False


def find_date(
    properties: Mapping[str, Any], names: Iterable[str], *, where: str, stated: str | None = None
) -> tuple[datetime, bool]:
    """Find the date of an outline: in its attributes, in its names, in the name of its file."""
    small = {str(key).lower(): value for key, value in properties.items()}
    if (
        attribute_date := find_attribute_date({key: _cell_text(value) for key, value in small.items()}, where=where)
    ) is not None:
        return attribute_date
    for text in (*(str(small[key]) for key in NAME_KEYS if small.get(key)), *names):
        dated = date_in_text(text)
        if dated is not None:
            return dated
    if stated:
        return parse_date(stated, where="--date")
    has = f"it has {', '.join(map(str, properties))}" if properties else "it has none"
    raise InputError(
        "no date",
        where=where,
        remedy=f"Looked for an attribute {', '.join(DATE_KEYS)} ({has}), and for one date such as 2020-12-17 in its "
        "name and in the name of the file. Add one there, or give --date",
    )


def _cell_text(value: Any) -> str:
    """Return a value of a table as text, empty for none; numbers without the point that tables give them."""
    if value is None or value != value:
        return ""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return str(value).strip()
