"""Hazards of a forecast to others at sea: limits of ice, positions with error, and the probability that ice comes near.

The p % limit of ice is the smallest line such that in p % of the members all ice lies inside of it: not a contour of
presence, which with members far apart would hold all of them at 50 %. The line is a convex hull. It is sought around several
members, then by exchanging one member for another, so it need not be the very smallest: of nine members it was in nine cases of
ten, and 1 % too large on average.

Where fewer than ten members count (effective number, as after sightings that most members miss), there are no limits, radii,
ellipses and dates of shares: they would say how well the few agree, not where the ice is. The range of the members is given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
import xarray as xr
from shapely.geometry import mapping
from shapely.geometry.polygon import orient

from riftberg.config.units import minute_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.ensembles.probability import (
    beyond_last_position,
    counted,
    effective,
    ellipse_axes,
    enough,
    quantiles,
    share_until,
    with_interval,
)
from riftberg.errors import InputError
from riftberg.plane import ellipses, near
from riftberg.state import Floats
from riftberg.version import __version__

LIMITS: Final = (50, 90, 99)
"""Limits of ice, %."""

CORNERS: Final = 24
"""Corners of the polygon around the ellipse that stands for a fragment."""

HOURS: Final = 1.0
"""Interval at which tracks are read between their positions to find how near ice comes."""


@dataclass(frozen=True)
class IceLimit:
    """A line, and the weight of the members inside of it."""

    percent: int | None  # None for the range of the members: too few count for a limit
    date: np.datetime64 | None  # None for the whole time
    line: Floats  # Longitude and latitude of its corners (closed), shape (n, 2)
    inside: float  # Weight of the members whose ice lies inside, all of it


def ice_limits(ds: xr.Dataset) -> list[IceLimit]:
    """Return the limits of ice of each day and of the whole time."""
    members, weight = counted(ds, "unfinished")
    time, beyond = members["time"].values, beyond_last_position(members)
    days = [k for k, t in enumerate(time) if (t - time[0]) % np.timedelta64(1, "D") == np.timedelta64(0, "D")]
    if days[-1] != len(time) - 1:
        days.append(len(time) - 1)
    corners, area = _corners(members)
    limits = []
    for where in [*([k] for k in days), list(range(len(time)))]:
        # Of the members that are known until then.
        visible = np.flatnonzero(~beyond[:, where[-1]])
        visible = visible[weight[visible] > 0.0]
        points = [corners[m][:, where][np.isfinite(area[m][:, where])].reshape(-1, 2) for m in visible]
        is_whole_time = len(where) > 1 or len(time) == 1
        share_of = weight[visible] / weight[visible].sum()
        if not enough(share_of):  # all of them, however little each weighs
            line, inside = smallest_line(points, np.full(len(points), 1.0 / max(len(points), 1)), 1.0)
            limits.append(IceLimit(None, None if is_whole_time else time[where[0]], line, inside))
            continue
        for percent in LIMITS:
            line, inside = smallest_line(points, share_of, percent / 100.0)
            limits.append(IceLimit(percent, None if is_whole_time else time[where[0]], line, inside))
    return limits


def _corners(members: xr.Dataset) -> tuple[list[Floats], list[Floats]]:
    """Return the corners of each fragment of each member at each time, shape (fragment, time, corners, 2), and the areas."""
    lon, lat, area = (members[name].values for name in ("lon", "lat", "area"))
    lon = near(lon, float(lon[np.isfinite(lon)][0]))
    east, north = _around(*ellipse_axes(members))
    x = lon[..., None] + east / (DEGREE * EARTH_RADIUS_A68 * np.cos(lat * DEGREE))[..., None]
    y = lat[..., None] + north / (DEGREE * EARTH_RADIUS_A68)
    return list(np.stack([x, y], axis=-1)), list(np.where(np.isfinite(lon), area, np.nan))


def _around(major: Floats, minor: Floats, azimuth: Floats) -> tuple[Floats, Floats]:
    """Return the corners (along a last axis) of the polygons around ellipses, m east and north of their middles.

    Around an ellipse, not in it: no ice sticks out.
    """
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    outside = 1.0 / math.cos(math.pi / CORNERS)
    along, across = outside * major[..., None] * np.cos(angle), outside * minor[..., None] * np.sin(angle)
    sine, cosine = np.sin(azimuth * DEGREE)[..., None], np.cos(azimuth * DEGREE)[..., None]
    return along * sine + across * cosine, along * cosine - across * sine


def smallest_line(points: list[Floats], weight: Floats, share: float) -> tuple[Floats, float]:
    """Return the convex line around members that weigh ``share`` or more, the smallest found, and their weight.

    ``points``: corners of the ice of each member, degrees; ``weight``: adds up to 1. A member without ice has all of it inside.
    """
    icy = [m for m, p in enumerate(points) if len(p)]
    hulls, w = [_hull(points[m]) for m in icy], weight[icy]
    none = 1.0 - float(w.sum())
    needed = share - none - 1e-9
    if needed <= 0.0:
        return np.zeros((0, 2)), none
    corners = np.concatenate(hulls)
    flat = corners * [math.cos(float(corners[:, 1].mean()) * DEGREE), 1.0]
    reach = np.maximum.reduceat(flat @ _WAYS.T, np.cumsum([0, *map(len, hulls)])[:-1], axis=0)
    starts = [
        _gather_nearest(reach, w, needed, k) for k in np.unique(np.linspace(0, len(w) - 1, STARTS).round().astype(int))
    ]
    if (np.cumsum(np.sort(w)) <= w.sum() - needed).sum() <= MOST_LEFT_OUT:
        starts.append((list(range(len(w))), []))  # few are left out: one after another, from all
    _, chosen = min((_swap_members(reach, w, needed, *start) for start in starts), key=lambda result: result[0])
    line = _hull(np.concatenate([hulls[k] for k in chosen]))
    return np.concatenate([line, line[:1]]), none + float(w[chosen].sum())


_ANGLE: Final = 2.0 * np.pi / 72
_WAYS: Final = np.column_stack([np.cos(_ANGLE * np.arange(72)), np.sin(_ANGLE * np.arange(72))])
"""Directions in which the reach of ice is looked at: the largest distance along each describes a convex line."""

STARTS: Final = 12
"""Members around which a line is sought: one around the middle of all would join groups far apart."""

NEXT: Final = 10
"""Members outside that may take the place of one inside."""

MOST_LEFT_OUT: Final = 20
"""Members that are left out one after another, of all; more take too long."""


def _hull_area(reach: Floats) -> Floats:
    """Return the area inside of lines that reach so far along each direction (last axis)."""
    beside = np.roll(reach, 1, axis=-1) + np.roll(reach, -1, axis=-1) - 2.0 * math.cos(_ANGLE) * reach
    return np.asarray(0.5 * (reach * beside).sum(axis=-1) / math.sin(_ANGLE))


def _gather_nearest(reach: Floats, w: Floats, needed: float, start: int) -> tuple[list[int], list[int]]:
    """Return members around one of them that weigh enough, and those that come next.

    First by their distance, then by how much the line around those that are kept would have to grow, until it shrinks no more
    (as in the concentration steps of Rousseeuw and Van Driessen 1999).
    """
    selection: tuple[list[int], list[int]] = [], []
    centre, shape, least = 2.0 / len(_WAYS) * reach[start] @ _WAYS, np.ones(len(_WAYS)), np.inf
    while True:
        order = np.argsort(((reach - _WAYS @ centre) / shape).max(axis=1), kind="stable").tolist()
        enough = 1 + int(np.searchsorted(np.cumsum(w[order]), needed))
        line = reach[order[:enough]].max(axis=0)
        if not _hull_area(line) < least * (1.0 - 1e-9):
            return selection
        least, selection = float(_hull_area(line)), (order[:enough], order[enough : enough + NEXT])
        centre = 2.0 / len(_WAYS) * line @ _WAYS  # inside of any convex line (its Steiner point)
        shape = line - _WAYS @ centre


def _swap_members(
    reach: Floats, w: Floats, needed: float, chosen: list[int], rest: list[int]
) -> tuple[float, list[int]]:
    """Leave members out, or exchange them for others, as long as the area shrinks; return the area and who is inside."""
    current = float(_hull_area(reach[chosen].max(axis=0)))
    while len(chosen) > 1:
        inside = reach[chosen]
        second, largest = np.partition(inside, -2, axis=0)[-2:]
        outermost = inside.argmax(axis=0)
        gained = np.append(0.0, w[rest])  # nobody, or one of the others, comes in
        least, change = current * (1.0 - 1e-6), None
        for k in np.unique(outermost).tolist():
            without = np.where(outermost == k, second, largest)
            area = _hull_area(np.vstack([without, np.maximum(without, reach[rest])]))
            area[w[chosen].sum() - w[chosen[k]] + gained < needed] = np.inf
            j = int(area.argmin())
            if area[j] < least:
                least, change = float(area[j]), (k, j - 1)
        if change is None:
            break
        current, (k, j) = least, change
        gone = chosen.pop(k)
        if j >= 0:
            chosen.append(rest.pop(j))
        rest.append(gone)
    return current, chosen


def _hull(points: Floats) -> Floats:
    from scipy.spatial import ConvexHull

    return np.asarray(points[ConvexHull(points).vertices])


def area_km2(line: Floats) -> float:
    """Return the area inside of a line, km2."""
    middle = float(line[:, 1].mean()) if len(line) else 0.0
    flat = line * (DEGREE * EARTH_RADIUS_A68 / 1e3 * np.array([math.cos(middle * DEGREE), 1.0]))
    return float(shapely.Polygon(flat).area)


# ---- positions --------------------------------------------------------------------------------------------------------


def positions(ds: xr.Dataset) -> list[dict[str, Any]]:
    """Return the position of the first berg by date, the range of the members, and the radii that hold 50 and 90 % of them.

    No radii where too few count.
    """
    members, weight = counted(ds)
    rows = []
    for k, time in enumerate(ds["time"].values):
        lon, lat = float(ds["cone_lon"].values[k]), float(ds["cone_lat"].values[k])
        if not math.isfinite(lon):
            continue
        x = (near(members["lon"].values[:, 0, k], lon) - lon) * math.cos(lat * DEGREE)
        distance = np.hypot(x, members["lat"].values[:, 0, k] - lat) * DEGREE * EARTH_RADIUS_A68 / 1e3
        row = {
            "date": f"{str(time)[:16]}Z",
            "lead_h": float(ds["lead"].values[k]),
            "lon": round((lon + 180) % 360 - 180, 5),
            "lat": round(lat, 5),
        }
        valid = np.isfinite(distance) & (weight > 0.0)
        lons, lats = near(members["lon"].values[valid, 0, k], lon), members["lat"].values[valid, 0, k]
        ends = {"west": lons.min(), "east": lons.max(), "south": lats.min(), "north": lats.max()}
        row |= {f"members_{side}": round((float(end) + 180) % 360 - 180, 5) for side, end in ends.items()}
        radii = quantiles(distance, weight, (0.5, 0.9)) if enough(weight[valid]) else (None, None)
        row |= {f"radius_{p}_km": r if r is None else round(float(r), 2) for p, r in zip((50, 90), radii, strict=True)}
        for name in ("p_broken", "p_aground"):
            row |= {f"{name}{end}": round(float(ds[f"{name}{end}"].values[k]), 4) for end in ("", "_low", "_high")}
        rows.append(row)
    return rows


# ---- ice near a place -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Approach:
    """How likely ice comes near a point, a route or an area."""

    name: str
    within: float  # m
    time: Any  # Dates
    probability: Floats  # That ice has come that near until then
    low: Floats  # Ends of Wilson's interval, with what is not known of unfinished members as no and as yes
    high: Floats
    # Dates by which 10, 50 and 90 % of the members that arrive have arrived, or, where too few count, the first and the last
    # has; NaT where none does
    first_arrival: Any
    closest: Floats  # Closest approach of each member that counts, m; 0 where ice lies over it
    weight: Floats  # Of these members

    def told(self) -> str:
        """Return it in a line."""
        p, low, high = (100.0 * float(a[-1]) for a in (self.probability, self.low, self.high))
        first, *half, last = self.first_arrival
        least, middle, most = self.closest.min(), float(quantiles(self.closest, self.weight, 0.5)), self.closest.max()
        far = f" km, median {middle / 1e3:.0f}" if enough(self.weight) else f" to {most / 1e3:.0f}"
        near_by = f"closest approach {least / 1e3:.0f}{far} km"
        arrival = (
            f", half of these by {minute_text(half[0])}" if half else f", {minute_text(first)} to {minute_text(last)}"
        )
        arrival = "" if np.isnat(first) else arrival
        chance = f"{self.name}: {p:.0f} % ({low:.0f} to {high:.0f} %) that ice comes within {self.within / 1e3:.1f} km"
        return f"{chance}{arrival}; {near_by}"

    def rows(self) -> list[dict[str, Any]]:
        """Return it by date, for a table."""
        names = ("10_percent", "50_percent", "90_percent") if len(self.first_arrival) == 3 else ("first", "last")
        dates = dict(zip(names, (str(d)[:16] for d in self.first_arrival), strict=True))
        arrival = {f"arrival_{name}": "" if date == "NaT" else f"{date}Z" for name, date in dates.items()}
        return [
            {"place": self.name, "within_km": self.within / 1e3, "date": f"{str(time)[:16]}Z", "probability": round(float(p), 4),
             "low": round(float(low), 4), "high": round(float(high), 4), **arrival,
             "closest_km": round(float(self.closest.min()) / 1e3, 2)}
            for time, p, low, high in zip(self.time, self.probability, self.low, self.high, strict=True)
        ]  # fmt: skip


def _unwrap_shape(p: Floats) -> Floats:
    """Return positions in a row whose longitudes do not jump at the date line; once around the Earth is no jump."""
    jump = np.diff(p[:, 0], prepend=p[0, 0])
    turns = np.where(np.abs(jump) < 360.0, np.round(jump / 360.0), 0.0)
    return np.column_stack([p[:, 0] - 360.0 * np.cumsum(turns), p[:, 1]])


def approach(ds: xr.Dataset, name: str, shape: Any, within: float) -> Approach:
    """Return how likely ice comes within a distance (m) of a shape in degrees.

    An unfinished member counts up to its last position; its later path is unknown.
    """
    members, weight = counted(ds, "unfinished")
    # After sightings some members count in nothing.
    members, weight = members.isel(member=weight > 0.0), weight[weight > 0.0]
    if shape.is_empty:
        raise InputError("an empty shape", where=name, remedy="Give a point, a line or an area")
    shape = shapely.transform(shape, _unwrap_shape)
    x0, y0 = (float(c) for c in shape.representative_point().coords[0])
    metres = DEGREE * EARTH_RADIUS_A68

    def laid_flat(p: Any) -> Any:
        # Each point with the cosine of the mean latitude to the middle: within 1 % up to some 1000 km.
        mean = np.cos(0.5 * (p[:, 1] + y0) * DEGREE)
        return np.column_stack([near(p[:, 0] - x0, 0.0) * metres * mean, (p[:, 1] - y0) * metres])

    flat = shapely.transform(shape, laid_flat)
    shapely.prepare(flat)
    lead = ds["lead"].values
    fine = np.union1d(np.arange(lead[0], lead[-1], HOURS), lead)  # and at the positions themselves
    ellipses = ellipse_axes(members)
    arrived, closest = np.full(members.sizes["member"], np.inf), np.full(members.sizes["member"], np.inf)
    for m in range(members.sizes["member"]):
        for p in range(members.sizes["fragment"]):
            valid = np.isfinite(members["lon"].values[m, p])
            if not valid.any():
                continue
            hours = fine[(fine >= lead[valid][0]) & (fine <= lead[valid][-1])]
            track = near(members["lon"].values[m, p][valid], float(members["lon"].values[m, p][valid][0]))
            lon = np.interp(hours, lead[valid], track)
            lat = np.interp(hours, lead[valid], members["lat"].values[m, p][valid])
            axes = (np.interp(hours, lead[valid], row[m, p][valid], period=period)
                    for row, period in zip(ellipses, (None, None, 180.0), strict=True))  # fmt: skip
            middle = laid_flat(np.column_stack([lon, lat]))
            ice = middle[:, None] + np.stack(_around(*axes), axis=-1)
            distance = shapely.distance(flat, shapely.polygons(ice))
            closest[m] = min(closest[m], float(distance.min()))
            close = np.flatnonzero(distance <= within)
            if close.size:
                arrived[m] = min(arrived[m], float(hours[close[0]]))
    share, unknown = share_until(members, weight, arrived[:, None] <= lead[None, :] + 1e-9)
    share, low, high = with_interval(share, effective(weight), unknown)
    came = np.isfinite(arrived)
    start = ds["time"].values[0]
    levels = (0.1, 0.5, 0.9) if enough(weight[came] if came.any() else weight) else (0.0, 1.0)
    dates = np.full(len(levels), np.datetime64("NaT", "s"))
    if came.any():
        seconds = np.rint(3600.0 * quantiles(arrived, weight, levels))
        dates = start.astype("datetime64[s]") + seconds.astype("timedelta64[s]")
    return Approach(name, within, ds["time"].values, share, low, high, dates, closest, weight)


# ---- files ------------------------------------------------------------------------------------------------------------


def geojson(ds: xr.Dataset, limits: list[IceLimit]) -> dict[str, Any]:
    """Return limits, ellipses and positions as GeoJSON (RFC 7946)."""
    features: list[dict[str, Any]] = []

    def add(kind: str, geometry: dict[str, Any], **properties: Any) -> None:
        if geometry["coordinates"]:  # an ellipse of members on one line has no area
            features.append({"type": "Feature", "geometry": geometry, "properties": {"kind": kind, **properties}})

    for limit in limits:
        if len(limit.line) > 3:
            date = "whole time" if limit.date is None else f"{str(limit.date)[:16]}Z"
            about: dict[str, Any]
            kind, about = "limit of ice", {"percent": limit.percent, "members_inside": round(limit.inside, 4)}
            if limit.percent is None:
                kind, about = "range of the members' ice", {"comment": "too few members count for limits of ice"}
            add(kind, _polygon(limit.line), date=date, **about)
    rows = positions(ds)
    for row in rows:
        add("position", {"type": "Point", "coordinates": [row["lon"], row["lat"]]}, **row)
    areas = {share: ellipses(ds, share) for share in ds["cone"].values.tolist()}
    daily = [k for k in range(ds.sizes["time"]) if float(ds["lead"].values[k]) % 24.0 == 0.0 and k > 0]
    for k in daily:
        for share, lines in areas.items():
            if np.isfinite(lines[k]).all():
                date = f"{str(ds['time'].values[k])[:16]}Z"
                add(
                    "ellipse of the position",
                    _polygon(lines[k]),
                    percent=round(100 * share),
                    date=date,
                )
    return {"type": "FeatureCollection", "features": features}


def _polygon(line: Floats) -> dict[str, Any]:
    """Return a closed line as a polygon, counter-clockwise and cut at the date line."""
    # Longitudes on one branch may pass 180 degrees; each part then stands on its own side.
    turned = [shapely.Polygon(line + np.array([turn, 0.0])) for turn in (-360.0, 0.0, 360.0)]
    pieces = shapely.get_parts(shapely.intersection(turned, shapely.box(-180.0, -90.0, 180.0, 90.0)))
    polygons = [orient(piece) for piece in pieces if piece.geom_type == "Polygon" and not piece.is_empty]
    geometry = polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
    return dict(mapping(shapely.transform(geometry, lambda points: np.round(points, 5))))


def kml(features: dict[str, Any]) -> str:
    """Return the features as KML, by kind in folders."""
    from xml.sax.saxutils import escape

    folders: dict[str, list[str]] = {}
    for feature in features["features"]:
        about, geometry = feature["properties"], feature["geometry"]
        percent = f"{about['percent']} %, " if "percent" in about else ""
        data = "".join(
            f"<Data name={escape(key)!r}><value>{escape(str(value))}</value></Data>" for key, value in about.items()
        )
        when = "" if about["date"] == "whole time" else f"<TimeStamp><when>{about['date'][:-1]}:00Z</when></TimeStamp>"
        name = f"<name>{escape(percent + about['date'])}</name>"
        mark = f"<Placemark>{name}{when}<ExtendedData>{data}</ExtendedData>{_kml_shape(geometry)}</Placemark>"
        folders.setdefault(about["kind"], []).append(mark)
    inner = "".join(
        f"<Folder><name>{escape(kind)}</name>{''.join(marks)}</Folder>\n" for kind, marks in folders.items()
    )
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n{inner}</Document></kml>\n'


def _kml_shape(geometry: dict[str, Any]) -> str:
    if geometry["type"] == "Point":
        return f"<Point><coordinates>{geometry['coordinates'][0]},{geometry['coordinates'][1]}</coordinates></Point>"
    polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    rings = [" ".join(f"{x},{y}" for x, y in rings[0]) for rings in polygons]
    elements = "".join(
        f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
        for ring in rings
    )
    return elements if len(rings) == 1 else f"<MultiGeometry>{elements}</MultiGeometry>"


def gridded(ds: xr.Dataset) -> xr.Dataset:
    """Return the probabilities on cells and by date as a CF dataset, whose maps other systems find where they belong."""
    names = [
        name
        for name in ds.data_vars
        if str(name).startswith(("p_", "presence", "passes", "cone_", "members_", "area_class"))
    ]
    if not enough(counted(ds)[1]):  # the range of the members stands in the place of ellipses
        names = [name for name in names if name not in ("cone_major", "cone_minor", "cone_azimuth")]
    grid = ds[names].drop_vars("weight", errors="ignore").rename(cell_lon="lon", cell_lat="lat")
    for axis, name in (("X", "lon"), ("Y", "lat")):
        grid[name].attrs |= {
            "axis": axis,
            "long_name": f"{grid[name].attrs['standard_name']} of the middle of the cell",
        }
    grid["crs"] = (), np.int32(0), {
        "grid_mapping_name": "latitude_longitude", "semi_major_axis": 6378137.0, "inverse_flattening": 298.257223563,
        "long_name": "WGS 84",
    }  # fmt: skip
    for name in ("presence", "passes"):
        grid[name].attrs["grid_mapping"] = "crs"
    for name in ("cone_lon", "cone_lat"):
        del grid[name].attrs["standard_name"]  # of a map one pair of coordinates has it alone (CF, 5.6)
    return grid.assign_attrs(
        Conventions="CF-1.11", title=f"Probabilities of ice: {ds.attrs.get('experiment', '')}",
        comment=f"Not covered: {ds.attrs.get('not_covered', '')}", history=f"riftberg {__version__}: riftberg hazard",
    )  # fmt: skip
