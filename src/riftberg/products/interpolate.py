"""Canonical fields on the points of a model grid, at the dates of a run.

In time: linear between records, over gaps up to a stated limit; before the first and after the last record a mean may
be held for half its averaging time. In space: bilinear over the wet points around (weights renormalised), then the
nearest wet point within a stated number of source cells, else 0; where a value came from stands in ``<name>_origin``.

Three quantities need care. Depth: land counts as depth 0, so that shores shoal. Wave direction: its sine and cosine are
interpolated, since the mean of 350 and 10 degrees is north. Sources finer than half the target step are averaged
first, so that no sounding is missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.products.axes import goes_round, step_of
from riftberg.products.cells import curvilinear, scattered
from riftberg.products.records import Gap, check_ends, gap_error, gap_limit
from riftberg.products.stencil import MISSING, Stencil
from riftberg.products.window import extent_text, longitudes_near, utc, window

Floats = NDArray[np.float64]
Dates = NDArray[np.datetime64]
Flags = NDArray[np.int8]
Period = np.timedelta64 | float | None
Outside = Literal["raise", "mask"]
_BLOCK_BYTES = 64e6


def to_grid(
    ds: xr.Dataset,
    lon: Floats,
    lat: Floats,
    times: Sequence[Any] | Dates | None = None,
    *,
    max_gap: Period = None,
    hold: Period = None,
    fill_cells: int = 2,
    outside: Outside = "raise",
) -> xr.Dataset:
    """Interpolate a canonical dataset to points and dates.

    ``lon``, ``lat``: target axes (1-D, ascending) or positions of every point (2-D, same shape), degrees; ``max_gap``:
    longest interval between two records that is interpolated across ((s)); ``hold``: how long the first and last record
    are held beyond themselves ((s)).
    """
    target = _Target.of(lon, lat)
    source = _averaged(_averageable(_around_target(ds, target, fill_cells)), target)
    stencil = _stencil(source, target)
    if outside == "raise" and stencil.outside.any():
        _raise_outside(ds, target, stencil)
    plan = _Plan.of(ds, times, max_gap, hold) if "time" in ds.dims else None
    fields: dict[str, Any] = {}
    for name in map(str, source.data_vars):
        values, origin, dims = _on_target(
            source[name], stencil, plan, 0 if name == "depth_below_surface" else fill_cells
        )
        fields[name] = ((*dims, *target.dims), values, source[name].attrs)
        fields[f"{name}_origin"] = ((*dims, *target.dims), origin, _origin_attributes(name))
    coords: dict[str, Any] = {name: ds[name] for name in ("depth", "draft") if name in ds.dims}
    if plan is not None:
        coords["time"] = ("time", plan.dates, {"standard_name": "time", "axis": "T"})
    history = f"interpolated by riftberg ({fill_cells} cells inland); {ds.attrs.get('history', '')}"
    attributes = {key: value for key, value in ds.attrs.items() if key != "crs_wkt"}
    return _restored(xr.Dataset(fields, coords={**coords, **target.coords}, attrs={**attributes, "history": history}))


@dataclass(frozen=True)
class _Target:
    """Target points: positions, dimensions and coordinates, usual step (degrees)."""

    lon: Floats
    lat: Floats
    dims: tuple[str, str]
    coords: dict[str, Any]
    step: float

    @classmethod
    def of(cls, lon: Floats, lat: Floats) -> _Target:
        lon, lat = np.asarray(lon, float), np.asarray(lat, float)
        east = {"standard_name": "longitude", "units": "degrees_east"}
        north = {"standard_name": "latitude", "units": "degrees_north"}
        if lon.ndim == 2:
            points = {"lon": (("y", "x"), lon, east), "lat": (("y", "x"), lat, north)}
            return cls(lon, lat, ("y", "x"), points, step_of(lat[:, 0]))
        grid_lon, grid_lat = np.meshgrid(lon, lat)
        coords = {"lon": ("lon", lon, {**east, "axis": "X"}), "lat": ("lat", lat, {**north, "axis": "Y"})}
        return cls(grid_lon, grid_lat, ("lat", "lon"), coords, step_of(lat))

    @property
    def box(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """West and east, south and north."""
        return (float(self.lon.min()), float(self.lon.max())), (float(self.lat.min()), float(self.lat.max()))


def _around_target(ds: xr.Dataset, target: _Target, fill_cells: int) -> xr.Dataset:
    """Cut the source to the surroundings of the target, on its branch of longitudes."""
    step = step_of(ds["lat"].values) if "lat" in ds.dims else 0.5
    east_west, south_north = target.box
    if "lon" in ds.dims and east_west[1] - east_west[0] >= 300.0:
        return longitudes_near(ds, *east_west)
    return window(ds, east_west, south_north, margin=(fill_cells + 1) * step + target.step)


def _averageable(ds: xr.Dataset) -> xr.Dataset:
    """Make fields that may be averaged: depth 0 over land, wave direction as sine and cosine."""
    if "depth_below_surface" in ds.data_vars:
        depth = ds["depth_below_surface"]
        ds = ds.assign(depth_below_surface=depth.fillna(0.0).assign_attrs(depth.attrs))
    if "wave_direction" in ds.data_vars:
        angle: Any = np.deg2rad(ds["wave_direction"])
        ds = ds.drop_vars("wave_direction").assign(wave_sine=np.sin(angle), wave_cosine=np.cos(angle))
    return ds


def _restored(ds: xr.Dataset) -> xr.Dataset:
    """Turn sine and cosine back into a direction."""
    if "wave_sine" not in ds.data_vars:
        return ds
    from riftberg.products.canonical import QUANTITIES, labelled

    angle: Any = np.rad2deg(np.arctan2(ds["wave_sine"], ds["wave_cosine"])) % 360.0
    known = ds["wave_sine_origin"]
    direction = labelled(angle.where(known != MISSING, 0.0), QUANTITIES["wave_direction"])
    ds = ds.assign(wave_direction=direction, wave_direction_origin=known.rename("wave_direction_origin"))
    return ds.drop_vars(["wave_sine", "wave_cosine", "wave_sine_origin", "wave_cosine_origin"])


def _averaged(ds: xr.Dataset, target: _Target) -> xr.Dataset:
    """Average blocks of a source that is at least twice as fine as the target."""
    if "lat" not in ds.dims or "lon" not in ds.dims or target.step <= 0.0:
        return ds
    counts = {}
    for axis in ("lat", "lon"):
        step = step_of(ds[axis].values)
        count = int(target.step / step + 1e-6) if step > 0.0 else 1
        if count >= 2 and ds.sizes[axis] >= 2 * count:
            counts[axis] = count
    if not counts:
        return ds
    averaged: xr.Dataset = ds.coarsen(counts, boundary="trim").mean(keep_attrs=True)
    return averaged


def _stencil(ds: xr.Dataset, target: _Target) -> Stencil:
    if "crs_wkt" in ds.attrs:
        from riftberg.products.projected import to_projection

        x, y = to_projection(ds.attrs["crs_wkt"], target.lon, target.lat)
        return Stencil.bilinear(ds["x"].values, ds["y"].values, x, y)
    if "node" in ds.dims:
        return scattered(ds["lon"].values, ds["lat"].values, target.lon, target.lat)
    if "lat" not in ds.dims:
        return curvilinear(ds["lon"].values, ds["lat"].values, target.lon, target.lat)
    axis = ds["lon"].values
    turn = 360.0 if goes_round(axis) else 0.0
    return Stencil.bilinear(axis, ds["lat"].values, target.lon, target.lat, turn=turn)


def _raise_outside(ds: xr.Dataset, target: _Target, stencil: Stencil) -> None:
    j, i = np.argwhere(stencil.outside)[0]
    raise ForcingError(
        f"{int(stencil.outside.sum())} points lie outside the data, "
        f"the first at {target.lon[j, i]:g} E {target.lat[j, i]:g} N; "
        f"the data cover {extent_text(ds)}",
        where=str(ds.attrs.get("source", "")),
        remedy="Give files that cover the grid, or set outside='mask'",
    )


def _origin_attributes(name: str) -> dict[str, Any]:
    return {
        "long_name": f"origin of {name}",
        "flag_values": np.array([0, 1, 2], dtype=np.int8),
        "flag_meanings": "nothing_known_value_0 interpolated nearest_wet_point",
    }


@dataclass(frozen=True)
class _Plan:
    """Which two records, and how much of the later one, make the field at each date."""

    dates: Dates
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    share: Floats

    @classmethod
    def of(cls, ds: xr.Dataset, times: Sequence[Any] | Dates | None, max_gap: Period, hold: Period) -> _Plan:
        records = ds["time"].values
        if times is None:
            every = np.arange(records.size)
            return cls(records, every, every, np.zeros(records.size))
        dates = np.array([utc(moment) for moment in times], dtype="datetime64[ns]")
        check_ends(ds, dates, hold)
        held = np.clip(dates, records[0], records[-1])
        before = np.clip(np.searchsorted(records, held, side="right") - 1, 0, records.size - 1)
        after = np.where(records[before] == held, before, np.minimum(before + 1, records.size - 1))
        _check_gaps(ds, dates, before, after, max_gap)
        span = (records[after] - records[before]) / np.timedelta64(1, "s")
        share = np.divide(
            (held - records[before]) / np.timedelta64(1, "s"), span, out=np.zeros(dates.size), where=span > 0
        )
        return cls(dates, before, after, share)


def _check_gaps(
    ds: xr.Dataset, dates: Dates, before: NDArray[np.int64], after: NDArray[np.int64], max_gap: Period
) -> None:
    records = ds["time"].values
    longest = gap_limit(ds, max_gap)
    spans = (records[after] - records[before]) / np.timedelta64(1, "s")
    if (spans > longest).any():
        k = int(np.argmax(spans > longest))
        raise gap_error(ds, Gap(records[before[k]], records[after[k]]), longest, dates[k])


class _RecordBlocks:
    """Records of a field, read in blocks: one by one, each would read (and unpack) a whole chunk of the file again."""

    def __init__(self, field: xr.DataArray) -> None:
        self.field = field
        self.length = max(1, int(_BLOCK_BYTES / (8 * max(1, field[0].size))))
        self.start, self.block = 0, np.empty((0,))

    def __getitem__(self, record: int) -> Floats:
        """Return one record; fast when they are asked for in ascending order."""
        if not self.start <= record < self.start + len(self.block):
            self.start = record
            self.block = self.field.isel(time=slice(record, record + self.length)).values
        values: Floats = self.block[record - self.start]
        return values


def _on_target(
    field: xr.DataArray, stencil: Stencil, plan: _Plan | None, fill_cells: int
) -> tuple[Floats, Flags, tuple[str, ...]]:
    """Return values, origins and leading dimensions of one field on the target."""
    field = field.expand_dims("row", axis=-2) if "node" in field.dims else field
    plane = ("row", "node") if "node" in field.dims else ("y", "x") if "y" in field.dims else ("lat", "lon")
    lead = tuple(str(name) for name in field.dims if name not in plane)
    if plan is None or "time" not in lead:
        values, origin = stencil.wet(field.transpose(*lead, *plane).values, fill_cells)
        return values, origin, lead
    rest = tuple(name for name in lead if name != "time")
    field = field.transpose("time", *rest, *plane)
    records = _RecordBlocks(field)
    gridded: dict[int, tuple[Floats, Flags]] = {}
    series: list[Floats] = []
    origins: list[Flags] = []
    for before, after, share in zip(plan.before.tolist(), plan.after.tolist(), plan.share.tolist(), strict=True):
        # Dates ascend, so that records before the present one are done with and need no memory.
        for record in [record for record in gridded if record < before]:
            del gridded[record]
        for record in {before, after} - set(gridded):
            gridded[record] = stencil.wet(records[record], fill_cells)
        value, origin = _mixed(gridded[before], gridded[after], share)
        series.append(value)
        origins.append(origin)
    return np.stack(series), np.stack(origins), ("time", *rest)


def _mixed(before: tuple[Floats, Flags], after: tuple[Floats, Flags], share: float) -> tuple[Floats, Flags]:
    """Mix two records; where only one knows a value (ice came or went) that one is taken."""
    (first, known_first), (last, known_last) = before, after
    mixed = (1.0 - share) * first + share * last
    mixed = np.where(known_first == MISSING, last, np.where(known_last == MISSING, first, mixed))
    origin = np.where(
        known_first == MISSING,
        known_last,
        np.where(known_last == MISSING, known_first, np.maximum(known_first, known_last)),
    )
    return mixed, origin.astype(np.int8)
