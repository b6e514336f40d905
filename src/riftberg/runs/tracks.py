"""Where bergs are, how large they are and how they move: one row for each berg or fragment at each record.

All of it follows from the elements. `Shapes` finds centroid and second moments of any number of bergs at once, each on the
plane that touches the sphere at its centroid; over a berg of 150 km lengths there are true to 1e-4. `berg_rows` makes the
rows of a block of records, in the run (`riftberg.runs.run_file`) or from a run that was opened, and `ragged` lays
them one berg after the other, as a CF contiguous ragged array.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg import constants
from riftberg.engines.common.forces.media import on_the_floor
from riftberg.engines.common.reserves import bond_strengths
from riftberg.parameters import Parameters
from riftberg.runs.layout import (
    FRAGMENT_VARIABLES,
    define_texts,
    in_file,
    position_names,
    run_parameters,
    texts,
    time_units,
)
from riftberg.state import Floats, Ints, Variable

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel

_TOLERANCE: Final = 1e-6  # s
_REMEMBERED: Final = "daily_track"


@dataclass(frozen=True)
class Position:
    """Place and heading of a berg."""

    lon: float  # Area-weighted centroid, degrees (metres on a Cartesian grid)
    lat: float  # Area-weighted centroid, degrees (metres on a Cartesian grid)
    azimuth: float  # Long axis, degrees clockwise from north, 0 to 180; NaN where no axis is longer
    area: float  # Plan area, m2


def long_axis(x: Floats, y: Floats, weight: Floats) -> float:
    """Azimuth of the axis of the largest second moment, degrees clockwise from north, 0 to 180.

    ``x``, ``y``: positions, m east and north.
    """
    return float(Shapes.of_one(x, y, weight, latlon=False).azimuth[0])


def principal_azimuth(xx: Floats, yy: Floats, xy: Floats) -> Floats:
    """Return the azimuth of the larger principal axis of second moments about the centroid; NaN where both are equal."""
    azimuth = np.degrees(0.5 * np.arctan2(2.0 * xy, yy - xx)) % 180.0
    return np.where(np.hypot(2.0 * xy, yy - xx) <= 1e-9 * (xx + yy), np.nan, azimuth)


def axis_difference(first: Any, second: Any) -> Any:
    """Return the angle between two axes, first minus second, degrees in [-90, 90); of numbers or arrays."""
    return (first - second + 90.0) % 180.0 - 90.0


class Shapes:
    """Centroid, area and second moments of bergs, and how their elements lie about the centroid.

    ``berg``: place of the berg of each element, 0 to ``count`` - 1; ``period``: length of a periodic channel (m), where
    ``latlon`` is false.
    """

    def __init__(
        self, lon: Floats, lat: Floats, area: Floats, berg: Ints, count: int, *, latlon: bool,
        radius: float = constants.EARTH_RADIUS_A68, period: float = 0.0,
    ) -> None:  # fmt: skip
        self.berg, self.count, self.weight = berg, count, area
        self.area = self.sum(area)
        first = np.empty(count)
        first[berg[::-1]] = lon[::-1]
        if latlon:
            sin_lon, cos_lon, sin_lat, cos_lat = (f(a) for a in map(np.radians, (lon, lat)) for f in (np.sin, np.cos))
            # The mean of the places as vectors: neither the date line nor a pole is a special case.
            x, y, z = (self.sum(area * a) for a in (cos_lat * cos_lon, cos_lat * sin_lon, sin_lat))
            self.lon, self.lat = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
            self.lon += 360.0 * np.round((first - self.lon) / 360.0)
            sin0, cos0, sin_lat0, cos_lat0 = (
                f(np.radians(a))[berg] for a in (self.lon, self.lat) for f in (np.sin, np.cos)
            )
            sine, cosine = sin_lon * cos0 - cos_lon * sin0, cos_lon * cos0 + sin_lon * sin0
            self.x = radius * cos_lat * sine
            self.y = radius * (sin_lat * cos_lat0 - cos_lat * sin_lat0 * cosine)
            # East and north at an element, seen from the centroid.
            self._turn = cosine, -sin_lat * sine, sin_lat0 * sine, sin_lat * sin_lat0 * cosine + cos_lat * cos_lat0
        else:
            unwrapped = lon - period * np.round((lon - first[berg]) / period) if period > 0.0 else lon
            self.lon, self.lat = self.mean(unwrapped), self.mean(lat)
            self.x, self.y = unwrapped - self.lon[berg], lat - self.lat[berg]
            self._turn = 1.0, 0.0, 0.0, 1.0
        self.xx, self.yy, self.xy = (self.mean(p) for p in (self.x * self.x, self.y * self.y, self.x * self.y))

    @classmethod
    def of_one(cls, lon: Floats, lat: Floats, area: Floats, **earth: Any) -> Shapes:
        """Return the shape of all elements as one berg."""
        return cls(lon, lat, area, np.zeros(lon.size, np.int64), 1, **earth)

    def sum(self, values: Floats) -> Floats:
        """Return the sum over the elements of each berg."""
        return np.asarray(np.bincount(self.berg, values, self.count), np.float64)

    def mean(self, values: Floats) -> Floats:
        """Return the mean over the area of each berg."""
        return self.sum(self.weight * values) / self.area

    @property
    def azimuth(self) -> Floats:
        """Direction of the long axis, degrees clockwise from north, 0 to 180; NaN where no axis is longer.

        A lone element has none: its one point lies at the centroid to round-off.
        """
        alone = np.bincount(self.berg, minlength=self.count) == 1
        return np.where(alone, np.nan, principal_azimuth(self.xx, self.yy, self.xy))

    def sides(self, length: Floats, width: Floats, gyration: Floats) -> tuple[Floats, Floats]:
        """Return length and width of the rectangles with the area of the bergs and the ratio of their second moments.

        As `riftberg.engines.common.fragments.tree` has them for drag. ``length``, ``width``: of the elements, m;
        ``gyration``: squares of their radii of gyration, m2.
        """
        element_moment = 0.5 * self.mean(gyration)  # an element may lie any way round
        half = np.hypot(0.5 * (self.xx - self.yy), self.xy)
        middle = 0.5 * (self.xx + self.yy) + element_moment
        ratio = np.sqrt((middle + half) / (middle - half))
        alone = np.bincount(self.berg, minlength=self.count) == 1
        if alone.any():
            is_alone = alone[self.berg]
            ratio[self.berg[is_alone]] = np.maximum(length, width)[is_alone] / np.minimum(length, width)[is_alone]
        return np.sqrt(self.area * ratio), np.sqrt(self.area / ratio)

    def motion(self, u: Floats, v: Floats, spin: Floats, gyration: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the velocity of the centroids and the angular velocity of rigid bergs with the same angular momentum.

        ``gyration``: square of the radius of gyration of each element about its own centre, m2.
        """
        a, b, c, d = self._turn
        east, north = a * u + b * v, c * u + d * v
        u0, v0 = self.mean(east), self.mean(north)
        # The mean of x and y is 0, so the mean velocity has no part in it.
        momentum = self.x * north - self.y * east + gyration * spin
        return u0, v0, self.mean(momentum) / (self.xx + self.yy + self.mean(gyration))


def berg_position(
    lon: Floats, lat: Floats, area: Floats, *, latlon: bool = True, radius: float = constants.EARTH_RADIUS_A68,
    period: float = 0.0,
) -> Position:  # fmt: skip
    """Return centroid, heading and area of the elements given.

    ``lon``, ``lat``: centres of the elements, degrees (metres where ``latlon`` is false); ``area``: their plan areas,
    m2; ``radius``: radius of the sphere, m; ``period``: length of a periodic channel (m), where ``latlon`` is false.
    """
    s = Shapes.of_one(lon, lat, area, latlon=latlon, radius=radius, period=period)
    return Position(float(s.lon[0]), float(s.lat[0]), float(s.azimuth[0]), float(s.area[0]))


def by_area(berg: Ints, area: Floats) -> dict[int, float]:
    """Return the area of each fragment by its number, the largest first; of two that are equal the smaller number."""
    numbers, index = np.unique(berg, return_inverse=True)
    areas = np.bincount(index, weights=area)
    return {int(numbers[k]): float(areas[k]) for k in np.argsort(-areas, kind="stable")}


def main_berg(berg: Ints, area: Floats) -> int:
    """Return the number of the fragment with the largest area; the smallest number where two are equal."""
    return next(iter(by_area(berg, area)))


GOES_ON: Final = "goes on over the ends of the channel"
"""Comment of the positions of a run file that need not be laid on one branch."""


def zonal_period(p: Parameters) -> float:
    """Return the period of x: 360 degrees on the sphere, 0 in metres without a period."""
    return p.earth.period if p.earth.period > 0.0 else 360.0 if p.earth.latlon else 0.0


def is_channel(p: Parameters) -> bool:
    """Whether positions repeat after a period that is not the globe's."""
    return zonal_period(p) not in (0.0, 360.0)


def track_longitudes(model: BareModel) -> Floats:
    """Return longitudes (x) as files have them: in a channel they go on over its ends, on the globe they may jump by 360."""
    lon = model.elements.lon
    return lon + model.parameters.earth.period * model.turns if is_channel(model.parameters) else lon


def main_position(model: BareModel) -> Position:
    """Return place and heading of the largest fragment of a model."""
    e, earth = model.elements, model.parameters.earth
    area = e.length * e.width
    rows = e.berg == main_berg(e.berg, area)
    return berg_position(
        track_longitudes(model)[rows],
        e.lat[rows],
        area[rows],
        latlon=earth.latlon,
        radius=earth.radius,
        period=earth.period,
    )


class DailyTrack:
    """Recorder that keeps the position of the largest fragment once a day, at the hour of the start."""

    def __init__(self) -> None:
        self.rows: list[tuple[datetime, Position]] = []
        self._next = 0.0

    def start(self, model: BareModel) -> None:
        """Keep the first position; a resumed run knows the days before, and goes on at its next full day."""
        day = constants.SECONDS_PER_DAY
        stored_rows = model.remembered.get(_REMEMBERED, np.zeros((0, 5))).tolist()
        self.rows = [
            (model.start + timedelta(seconds=row[0]), Position(*row[1:])) for row in stored_rows if row[0] <= model.time
        ]
        self._next = day * math.ceil((model.time - _TOLERANCE) / day)
        if stored_rows and stored_rows[-1][0] >= self._next - _TOLERANCE:
            self._next += day
        else:
            self.record(model)

    def record(self, model: BareModel) -> None:
        """Keep the position where a day is full."""
        if model.time >= self._next - _TOLERANCE:
            position = main_position(model)
            self.rows.append((model.start + timedelta(seconds=model.time), position))
            self._next += constants.SECONDS_PER_DAY
            row = np.array([[model.time, position.lon, position.lat, position.azimuth, position.area]])
            model.remembered[_REMEMBERED] = np.concatenate([model.remembered.get(_REMEMBERED, row[:0]), row])

    def finish(self, model: BareModel) -> None:
        """Do nothing: the last day may be incomplete."""


def track_table(rows: Sequence[tuple[datetime, Position]]) -> list[dict[str, Any]]:
    """Return rows for a summary: time, lon, lat, azimuth (null where none), area in km2."""
    return [
        {
            "time": when.isoformat(),
            "lon": position.lon,
            "lat": position.lat,
            "azimuth": None if math.isnan(position.azimuth) else position.azimuth,
            "area_km2": position.area / 1e6,
        }
        for when, position in rows
    ]


TRACK_VARIABLES: Final = (
    Variable("time", "s", "time", standard_name="time"),
    Variable("lon", "degrees_east", "longitude of the centroid", standard_name="longitude"),
    Variable("lat", "degrees_north", "latitude of the centroid", standard_name="latitude"),
    Variable("u", "m s-1", "eastward velocity of the centroid"),
    Variable("v", "m s-1", "northward velocity of the centroid"),
    Variable("spin", "rad s-1", "angular velocity, counter-clockwise: of the rigid body with the same angular momentum"),
    Variable("area", "m2", "plan area"),
    Variable("mass", "kg", "mass"),
    Variable("length", "m", "length of the rectangle with the area and the ratio of second moments of the berg"),
    Variable("width", "m", "width of that rectangle"),
    Variable(
        "azimuth", "degrees",
        "direction of the long axis, from the second moments, clockwise from north, 0 to 180; missing where none is longer",
    ),
    Variable(
        "stress_over_strength", "1",
        "largest tensile stress of a bond since the record before over its strength, of bonds that hold at the record; at most 1",
    ),
    Variable("aground", "1", "1 where the sea floor acts on an element of the berg", dtype="i1"),
)  # fmt: skip
"""Variables of each berg and fragment at each record."""

_FAMILY: Final = {v.name: v for v in FRAGMENT_VARIABLES}

TRACK_COORDINATES: Final = (
    replace(_FAMILY["number"], name="trajectory", long_name="number of the berg or fragment, the value of berg"),
    _FAMILY["parent"],
    replace(_FAMILY["birth_time"], name="birth"),
    _FAMILY["name"],
    _FAMILY["calved_from"],
)
"""Constants of each berg and fragment, from the family tree."""

TRACKS: Final = "tracks"
"""Group of a run file that holds them."""

ELEMENT_COLUMNS: Final = (
    "lon", "lat", "u", "v", "spin", "length", "width", "mass", "thickness", "depth", "berg",
)  # fmt: skip
FLOOR_LOAD: Final = "floor_load"
ON_BED: Final = (FLOOR_LOAD, "floor_yield")
"""Variable of a run file on a bed of sediment, by which it carries elements over water deeper than their draft."""
BOND_COLUMNS: Final = ("first", "second", "strength", "break_time", "peak_stress")
"""Variables of a run file from which the rows follow; ``damage`` too, where the run has it."""


def split_blocks(records: int, elements: int) -> Iterator[slice]:
    """Give blocks of records of some million values, for which there is memory."""
    step = max(1, 4_000_000 // max(1, elements))
    return (slice(begin, min(begin + step, records)) for begin in range(0, records, step))


def aground_in_file(thickness: Floats, depth: Floats, load: Floats | None, p: Parameters) -> NDArray[np.bool_]:
    """Return which elements of a run file the sea floor acts on; ``load``: carried by a bed, None where the file has none."""
    return on_the_floor(thickness, depth, 0.0 if load is None else load, p.kernel_values())


def berg_rows(time: Floats, columns: Mapping[str, NDArray[Any]], p: Parameters) -> dict[str, NDArray[Any]]:
    """Return the variables of each berg in a block of records, in the order of the records and then of the numbers.

    ``time``: of the records, s (shape (records,)); ``columns``: variables of the run file by name; variables
    of elements and bonds that change with time have shape (element or bond, record).
    """
    shape = columns["lat"].shape
    berg = np.where(np.isfinite(columns["lat"]), columns["berg"], 0).astype(np.int64)
    present: Any = berg.ravel() > 0
    present = slice(None) if present.all() else present
    span = int(berg.max(initial=0)) + 1
    keys = (berg + span * np.arange(shape[1])).ravel()[present]
    bergs_at, berg_index = _rank_keys(keys, span * shape[1])

    def of(name: str) -> Floats:
        column = columns[name]
        table = np.broadcast_to(column[:, None] if column.ndim == 1 else column, shape)
        return np.asarray(table.ravel()[present], np.float64)

    length, width = of("length"), of("width")
    earth = p.earth
    bergs = Shapes(
        of("lon"),
        of("lat"),
        length * width,
        berg_index,
        bergs_at.size,
        latlon=earth.latlon,
        radius=earth.radius,
        period=earth.period,
    )
    gyration = (length * length + width * width) / 12.0
    u, v, spin = bergs.motion(of("u"), of("v"), of("spin"), gyration)
    touching = aground_in_file(of("thickness"), of("depth"), of(FLOOR_LOAD) if FLOOR_LOAD in columns else None, p)
    rows: dict[str, NDArray[Any]] = {
        "number": bergs_at % span,
        "time": time[bergs_at // span],
        "lon": bergs.lon, "lat": bergs.lat, "u": u, "v": v, "spin": spin, "area": bergs.area, "mass": bergs.sum(of("mass")),
        **dict(zip(("length", "width"), bergs.sides(length, width, gyration), strict=True)),
        "azimuth": bergs.azimuth,
        "aground": bergs.sum(touching.astype(np.float64)) > 0.0,
    }  # fmt: skip
    fragment = np.full(berg.size, -1, np.int64)
    fragment[present] = berg_index
    rows |= _stresses(time, columns, fragment.reshape(shape), bergs_at.size, p)
    return {name: values.astype(_STORED.get(name, "f4")) for name, values in rows.items()}


def _rank_keys(keys: Ints, span: int) -> tuple[Ints, Ints]:
    """Return the different keys in order, and the place of each key among them; keys are below ``span``."""
    if span > 4 * keys.size:
        return np.unique(keys, return_inverse=True)
    occurs = np.bincount(keys, minlength=span) > 0
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[keys]


_STORED: Final = {"number": "i8", "time": "f8", "lon": "f8", "lat": "f8", "aground": "i1"}


def _stresses(
    time: Floats, columns: Mapping[str, NDArray[Any]], fragment: Ints, count: int, p: Parameters
) -> dict[str, Floats]:
    """Return the largest tension of the bonds of each berg over their strength; nothing where bonds cannot break."""
    values = p.kernel_values()
    if not (values.fracture and max(values.normal_strength, values.crevasse_strength) > 0.0):
        return {}
    first, second, breaks = columns["first"], columns["second"], columns["break_time"]
    berg = fragment[first]
    holds = (np.isnan(breaks)[:, None] | (breaks[:, None] > time)) & (berg >= 0) & (berg == fragment[second])
    # Numbers by (bond, record); a constant thickness has the dimension of the elements alone.
    thickness = np.atleast_2d(columns["thickness"].T).astype(np.float64)
    left = bond_strengths(thickness, first, second, values).T * columns["strength"][:, None]
    if "damage" in columns:
        left = left * (1.0 - np.nan_to_num(columns["damage"]))
    with np.errstate(divide="ignore", invalid="ignore"):  # bonds without any strength
        ratio = np.nan_to_num(columns["peak_stress"] / left)
    largest = np.zeros(count)
    np.maximum.at(largest, berg[holds], ratio[holds])
    # While a crack runs, its neighbours bear more than their strength for a moment, and hold.
    return {"stress_over_strength": np.minimum(largest, 1.0)}


class Ragged(NamedTuple):
    """A variable of the tracks: dimension, values and attributes, as xarray takes them."""

    dimension: str
    values: NDArray[Any]
    attributes: dict[str, Any]


def ragged(
    blocks: Sequence[Mapping[str, NDArray[Any]]], fragments: Mapping[int, Mapping[str, Any]], start: Any, latlon: bool
) -> dict[str, Ragged]:
    """Return the rows of all records one berg after the other: a CF contiguous ragged array, times not decoded.

    ``fragments``: parent, birth_time (s), name and calved_from by number; ``start``: date of time zero.
    """
    rows = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    order = np.argsort(rows["number"], kind="stable")
    numbers, counts = np.unique(rows["number"], return_counts=True)
    coordinates = position_names(latlon)
    counted = time_units(start)
    unknown = {"parent": 0, "birth_time": np.nan, "name": "", "calved_from": 0}
    descriptions = [{**unknown, **fragments.get(n, {}), "trajectory": n} for n in numbers.tolist()]
    table = {}
    for v in TRACK_COORDINATES:
        values = np.array([row[{"birth": "birth_time"}.get(v.name, v.name)] for row in descriptions])
        table[v.name] = Ragged(
            "trajectory", values.astype({"i8": "i4", "str": "U"}.get(v.dtype, "f8")), {"long_name": v.long_name}
        )
    table["trajectory"].attributes["cf_role"] = "trajectory_id"
    table["birth"].attributes.update(counted)
    about = {"long_name": "number of records of the berg or fragment", "sample_dimension": "index"}
    table["rowsize"] = Ragged("trajectory", counts.astype("i4"), about)
    for v in TRACK_VARIABLES:
        if v.name in rows:
            attributes = _attributes(v, coordinates) | (counted if v.name == "time" else {})
            table[coordinates.get(v.name, v.name)] = Ragged("index", rows[v.name][order], attributes)
    table["aground"].attributes.update(flag_values=np.array([0, 1], "i1"), flag_meanings="afloat aground")
    return table


def write_tracks(file: netCDF4.Dataset, table: Mapping[str, Ragged]) -> None:
    """Write tracks as a group of an open file.

    TrajAn 0.12 wants it so: ``rowsize`` is the one data variable of the trajectories, all else is a coordinate there; places
    are data variables, and ``time`` is a coordinate.
    """
    group = file.createGroup(TRACKS)
    group.setncatts({"Conventions": "CF-1.11", "featureType": "trajectory"})
    for name in ("trajectory", "index"):
        group.createDimension(name, table["rowsize" if name == "trajectory" else "time"].values.size)
    # All are defined before the first is written: at each change between the two the library writes out the whole file.
    for name, (dimension, values, attributes) in table.items():
        if values.dtype.kind == "U":
            variable = define_texts(group, name, dimension)
        else:
            missing = np.nan if name == "azimuth" else False
            variable = group.createVariable(name, values.dtype, (dimension,), fill_value=missing, fletcher32=True)
        variable.setncatts(attributes)
        if dimension == "index" and name != "time":
            variable.coordinates = "time"
    group["rowsize"].coordinates = " ".join(v.name for v in TRACK_COORDINATES[1:])
    for name, (_, values, _) in table.items():
        group[name][:] = texts(values.tolist()) if values.dtype.kind == "U" else values


def _attributes(v: Variable, coordinates: Mapping[str, str]) -> dict[str, Any]:
    """Return the attributes of a variable; positions on a Cartesian grid are metres."""
    if v.name in coordinates:
        axis = coordinates[v.name]
        return {"units": "m", "standard_name": f"projection_{axis}_coordinate", "long_name": f"{axis} of the centroid"}
    standard = {"standard_name": v.standard_name} if v.standard_name else {}
    return {"units": v.units, "long_name": v.long_name, **standard}


def read_family(run: xr.Dataset) -> dict[int, dict[str, Any]]:
    """Return the data of each berg and fragment in a run file (parent, birth_time, area, ...), by its number."""
    names = [name for name in _FAMILY if f"fragment_{name}" in run]
    rows = zip(*(run[f"fragment_{name}"].values for name in names), strict=True)
    return {int(row[0]): dict(zip(names, row, strict=True)) for row in rows}


def build_tracks(run: xr.Dataset) -> xr.Dataset:
    """Return the tracks of all bergs and fragments of a run that was opened, or of a part of it."""
    import xarray as xr

    parameters = run_parameters(run)
    start = np.datetime64(run.attrs["start"])

    def seconds(dates: Any) -> Floats:
        return np.where(np.isnat(dates), np.nan, (dates - start) / np.timedelta64(1, "s"))

    latlon = parameters.earth.latlon
    names = position_names(latlon)
    bonds = {name: run[in_file(name)] for name in BOND_COLUMNS if in_file(name) in run}
    fixed = {name: variable.values for name, variable in bonds.items() if "time" not in variable.dims}
    fixed["break_time"] = seconds(run["break_time"].values)
    moving = [*ELEMENT_COLUMNS, *(name for name in (FLOOR_LOAD, "peak_stress", "damage") if name in run)]
    blocks = []
    for block in split_blocks(run.sizes["time"], run.sizes["trajectory"]):
        records = run.isel(time=block).transpose("trajectory", "bond", "time", ...)
        columns = {name: records[names.get(name, name)].values for name in moving}
        columns.setdefault("peak_stress", records["normal_stress"].values)
        blocks.append(berg_rows(seconds(records["time"].values), fixed | columns, parameters))
    family = read_family(run).items()
    fragments = {number: {**row, "birth_time": float(seconds(row["birth_time"]))} for number, row in family}
    tracks = xr.Dataset(
        {name: tuple(variable) for name, variable in ragged(blocks, fragments, start, latlon).items()},
        attrs={"Conventions": "CF-1.11", "featureType": "trajectory"},
    )
    return xr.decode_cf(tracks.set_coords([*(v.name for v in TRACK_COORDINATES), "time"]))
