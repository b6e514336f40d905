"""Gridded berg masks and thickness maps: reading, and bilinear sampling that tolerates gaps.

GeoTIFFs need the optional packages of the extra ``geotiff`` (rasterio, pyproj), imported when first used.
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from riftberg.bergs.lattice import Booleans
from riftberg.config.values import required
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.physics.elementary import cos
from riftberg.state import Floats
from riftberg.system.input_files import MOST_VALUES, check_file, is_folder, needed, reading, refuse_large
from riftberg.system.netcdf_lock import open_lazily
from riftberg.system.process import own_filters

if TYPE_CHECKING:
    import xarray as xr


A_DAY = np.timedelta64(1, "D")
"""Farthest date from the one asked for of which a map is taken."""

_LON = ("lon", "longitude", "nav_lon", "x")
_LAT = ("lat", "latitude", "nav_lat", "y")


@dataclass(frozen=True)
class Raster:
    """Values on a longitude-latitude grid, or on the grid of a map projection."""

    lon: Floats  # Rising coordinates, degrees (m for Cartesian bergs and for projected grids), of shape (n,) and (m,)
    lat: Floats  # Rising coordinates, degrees (m for Cartesian bergs and for projected grids), of shape (n,) and (m,)
    values: Floats  # Shape (m, n); NaN where nothing is known
    name: str  # File and variable, for messages
    crs: str | None = None  # Coordinate system of projected coordinates; None where they are longitude and latitude

    def cells(self) -> tuple[Floats, Floats]:
        """Widths of the cells along longitude and latitude, in the units of the coordinates."""
        return np.gradient(self.lon), np.gradient(self.lat)

    def above(self, least: float) -> Raster:
        """Return the raster with gaps where the values are not above ``least``."""
        with np.errstate(invalid="ignore"):
            return replace(self, values=np.where(self.values > least, self.values, np.nan))

    def sample(self, lon: Floats, lat: Floats) -> Floats:
        """Return bilinear values at points; gaps are left out of the mean, NaN outside and where all four are gaps."""
        total, weight = np.zeros(np.shape(lon)), np.zeros(np.shape(lon))
        for value, share in self._corners(lon, lat):
            has_value = np.isfinite(value)
            total += np.where(has_value, value, 0.0) * share
            weight += has_value * share
        with np.errstate(invalid="ignore"):
            return np.where(weight > 0, total / weight, np.nan)

    def of_largest_weight(self, lon: Floats, lat: Floats) -> Floats:
        """Return the value with the largest weight among the four points around that are no gaps; NaN without any."""
        best, weight = np.full(np.shape(lon), np.nan), np.zeros(np.shape(lon))
        for value, share in self._corners(lon, lat):
            better = np.isfinite(value) & (share > weight)
            best, weight = np.where(better, value, best), np.where(better, share, weight)
        return best

    def _corners(self, lon: Floats, lat: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Yield values and bilinear weights of the four points around; no weight outside."""
        if self.crs is not None:
            lon, lat = projection(self.crs).transform(lon, lat)
        # Degrees, by their range: points are brought to the branch about the middle of the grid.
        elif self.lon[-1] - self.lon[0] <= 360 and abs(self.lon).max() <= 540:
            middle = 0.5 * (self.lon[0] + self.lon[-1])
            lon = middle + (lon - middle + 180) % 360 - 180
        i, a, in_lon = _bracket(self.lon, lon)
        j, b, in_lat = _bracket(self.lat, lat)
        # Gaps are left to the callers: a mean without them, or the one that weighs most.
        for dj, wj in ((0, 1 - b), (1, b)):
            for di, wi in ((0, 1 - a), (1, a)):
                yield self.values[j + dj, i + di], wi * wj * (in_lon & in_lat)


@cache
def projection(crs: str) -> Any:
    """Return the transformer from longitude and latitude (degrees) to a projection (m)."""
    return needed("pyproj", "projected grids need it", "geotiff").Transformer.from_crs("EPSG:4326", crs, always_xy=True)


def unbroken(raster: Raster, marked: Booleans) -> Raster:
    """Return a raster whose longitudes begin in the widest gap of the marked cells, so that no seam cuts these.

    ``raster``: longitudes in degrees.
    """
    lon = np.sort(raster.lon[marked.any(axis=0)])
    # The last gap is that over the seam, where the axis may be cut without a change.
    gaps = np.append(np.diff(lon), lon[0] + 360.0 - lon[-1])
    k = int(np.argmax(gaps))
    if raster.crs is not None or k == len(gaps) - 1:
        return raster
    cut = 0.5 * (lon[k] + lon[k + 1])
    turned = np.where(raster.lon > cut, raster.lon - 360.0, raster.lon)
    # A grid from 0 to 360 has its first column twice.
    _, order = np.unique(np.round(turned, 9), return_index=True)
    return replace(raster, lon=turned[order], values=raster.values[:, order])


_MOST_CELLS = 4_000_000
"""Cells of a grid of longitude and latitude to which a projected mask is brought at most."""


def reproject(raster: Raster, marked: Booleans) -> Raster:
    """Return the part of a projected raster around the marked cells on longitudes and latitudes.

    The new cells are half as wide as the old ones at the middle of the marked ones, for their edges lie askew; values are
    bilinear.
    """
    assert raster.crs is not None
    to_lonlat = partial(projection(raster.crs).transform, direction="INVERSE")
    lon, lat = to_lonlat(*(c[marked] for c in np.meshgrid(raster.lon, raster.lat)))
    order = np.sort(lon)
    gaps = np.append(np.diff(order), order[0] + 360.0 - order[-1])
    k = int(np.argmax(gaps))
    if k < len(gaps) - 1:
        lon = np.where(lon > order[k], lon - 360.0, lon)
    dx, dy = (np.diff(axis).min() for axis in (raster.lon, raster.lat))
    x, y = projection(raster.crs).transform(lon.mean(), lat.mean())
    lons, lats = to_lonlat(np.array([x, x + dx, x]), np.array([y, y, y + dy]))
    narrow = cos(lats[0] * DEGREE)
    step = 0.5 * float(np.hypot(((lons[1:] - lons[0] + 180) % 360 - 180) * narrow, lats[1:] - lats[0]).min())
    # Not finer than the largest number of cells allows.
    step = max(step, math.sqrt(np.ptp(lon) * narrow * np.ptp(lat) / _MOST_CELLS))
    fine_lon = np.arange(lon.min() - 2 * step / narrow, lon.max() + 2 * step / narrow, step / narrow)
    fine_lat = np.arange(lat.min() - 2 * step, lat.max() + 2 * step, step)
    values = np.nan_to_num(raster.sample(*np.meshgrid(fine_lon, fine_lat)))
    return Raster(fine_lon, fine_lat, values, raster.name)


def _bracket(axis: Floats, points: Floats) -> tuple[Any, Floats, Any]:
    """Lower index, weight of the upper one, and whether the point lies within the grid's outer cell edges."""
    i = np.clip(np.searchsorted(axis, points, side="right") - 1, 0, len(axis) - 2)
    weight = (points - axis[i]) / (axis[i + 1] - axis[i])
    # The outermost half cell belongs to the grid: its value is held.
    return i, np.clip(weight, 0.0, 1.0), (weight >= -0.5) & (weight <= 1.5)


def is_map(source: Any) -> bool:
    """Whether something is a grid, or the name of a file that holds one."""
    if isinstance(source, str | Path):
        return Path(source).suffix.lower() in (*SUFFIXES, ".nc", ".nc4", ".cdf", ".zarr")
    return isinstance(source, Raster) or is_gridded(source)


def is_gridded(source: Any) -> bool:
    """Whether something is a DataArray or a Dataset, which nothing is before xarray has been loaded."""
    if "xarray" not in sys.modules:
        return False
    import xarray as xr

    return isinstance(source, xr.DataArray | xr.Dataset)


def read_raster(source: Any, variable: str | None = None, *, date: str | None = None) -> Raster:
    """Read a two-dimensional grid."""
    import xarray as xr

    if isinstance(source, xr.DataArray):
        return _raster(source, f"DataArray {source.name}", date)
    where = "Dataset"
    if isinstance(source, str | Path):
        where = str(source)
        path = Path(source)
        if path.suffix.lower() != ".zarr":
            check_file(path, remedy="Name a NetCDF file or a GeoTIFF", kind=BergError, missing="file not found")
        elif not is_folder(path):
            raise BergError("file not found", where=where, remedy="Check the path")
        if path.suffix.lower() in SUFFIXES:
            if date is not None:
                raise BergError("a GeoTIFF has no dates", where=str(path), remedy="Leave out date=")
            return Raster(*read_band(path, variable))
        with reading(where, "not a grid", "Give NetCDF or GeoTIFF", BergError), open_lazily(path) as opened:
            chosen = [variable] if variable in opened.data_vars else list(opened.data_vars)
            size = sum(opened[name].size for name in chosen)
            refuse_large(
                size, MOST_VALUES, "values", size=8.0, where=where, kind=BergError,
                remedy="Cut the grid to the berg and its date, or make it coarser",
            )  # fmt: skip
            source = opened[chosen].load()
    required(source, xr.Dataset, "a file, a DataArray, a Dataset or a Raster", where="grid", kind=BergError)
    names = [str(n) for n, v in source.data_vars.items() if v.ndim >= 2]
    if variable is None and len(names) == 1:
        variable = names[0]
    if variable not in names:
        raise BergError(
            f"no variable {variable!r}",
            where=where,
            remedy=f"Name one with variable=: {', '.join(names) or 'none there'}",
        )
    return _raster(source[variable], f"{where}, {variable}", date)


def _coordinate(array: xr.DataArray, names: tuple[str, ...], standard: str, where: str) -> str:
    for name, coordinate in array.coords.items():
        if coordinate.attrs.get("standard_name") == standard and coordinate.ndim == 1:
            return str(name)
    for name, coordinate in array.coords.items():
        if str(name).lower() in names and coordinate.ndim == 1:
            return str(name)
    raise BergError(
        f"no one-dimensional {standard} among {', '.join(map(str, array.coords)) or 'no coordinates'}",
        where=where,
        remedy="Regrid to a longitude-latitude grid with coordinates lon and lat",
    )


def _raster(array: xr.DataArray, where: str, date: str | None) -> Raster:
    if "time" in array.dims:
        if date is None and array.sizes["time"] > 1:
            raise BergError(f"{array.sizes['time']} dates", where=where, remedy="Choose one with date=")
        first, last = (str(t)[:10] for t in array.time.values[[0, -1]])
        remedy = f"Give date= as 2020-12-17, within a day of one of its dates, {first} to {last}"
        with reading(where, "dates that cannot be chosen from", remedy, BergError):
            array = array.isel(time=0) if date is None else array.sel(time=date, method="nearest", tolerance=A_DAY)
    array = array.squeeze(drop=True)
    lon = _coordinate(array, _LON, "longitude", where)
    lat = _coordinate(array, _LAT, "latitude", where)
    if array.ndim != 2 or min(array.shape) < 2:
        raise BergError(f"shape {array.shape}", where=where, remedy="Give a grid of at least 2 by 2 points")
    with reading(where, "not a grid", "Give numbers on longitude and latitude", BergError):
        array = array.transpose(array[lat].dims[0], array[lon].dims[0])
        array = array.assign_coords({c: (array[c].dims, _by_units(array[c], where)) for c in (lat, lon)})
        array = array.sortby([lat, lon])
        values = np.asarray(array.values, dtype=np.float64)
        axes = (np.asarray(array[lon], np.float64), np.asarray(array[lat], np.float64))
    _check_grid(*axes, values, where)
    _check_true_positions(array, lon, lat, where)
    return Raster(*axes, values, where)


def _by_units(axis: xr.DataArray, where: str) -> Floats:
    """Return an axis in degrees north and east by its units; refuse one of a rotated grid."""
    values, units = np.asarray(axis.values, np.float64), str(axis.attrs.get("units", "")).strip().lower()
    if (
        str(axis.attrs.get("standard_name", "")).startswith("grid_")
        or "rotat" in str(axis.attrs.get("long_name", "")).lower()
    ):
        raise BergError(
            f"{axis.name} is an axis of a rotated grid: its numbers are no latitudes and longitudes", where=where,
            remedy="Regrid to a longitude-latitude grid with coordinates lon and lat",
        )  # fmt: skip
    if units.startswith("rad"):
        return np.rad2deg(values)
    if re.fullmatch(r"deg(ree)?s?_?(s|south|w|west)", units):
        return -values
    return values


def _check_true_positions(array: xr.DataArray, lon: str, lat: str, where: str) -> None:
    """Refuse axes that lie aside of latitudes that the grid has for each point, as nominal ones of a bent grid do."""
    for name, field in array.coords.items():
        descriptors = {str(field.attrs.get("standard_name", "")), str(field.attrs.get("units", "")).lower()}
        if field.dims == array.dims and {"latitude", "degrees_north"} & descriptors:
            off = float(np.abs(field - array[lat]).max())
            if off > 0.1 * float(np.diff(array[lat]).max()):
                raise BergError(
                    f"the axes {lat} and {lon} lie up to {off:.2g} degrees aside of {name}", where=where,
                    remedy="Regrid to a longitude-latitude grid with coordinates lon and lat",
                )  # fmt: skip


def check_on_globe(raster: Raster) -> None:
    """Refuse positions that the globe does not have, where a raster is one of longitudes and latitudes.

    Half a cell beyond a pole is the edge of a grid that ends there, and passes.
    """
    if raster.crs is not None:
        return
    cell = float(np.diff(raster.lat).max())
    for name, axis, most in (("latitude", raster.lat, 90.0 + 0.5 * min(cell, 2.0)), ("longitude", raster.lon, 540.0)):
        worst = axis[np.argmax(np.abs(axis))]
        if abs(worst) > most + 1e-6:
            raise BergError(
                f"{name} {worst:g} is beyond the globe", where=raster.name,
                remedy="Give degrees; coordinates in metres need their coordinate system",
            )  # fmt: skip


def _check_grid(lon: Floats, lat: Floats, values: Floats, where: str) -> None:
    """Refuse coordinates that are no axes, and fill values that the file does not declare."""
    for name, axis in (("longitude", lon), ("latitude", lat)):
        if not np.isfinite(axis).all() or (np.abs(axis) > _FILL).any() or (np.diff(axis) <= 0.0).any():
            raise BergError(
                f"a {name} that is no number, or stands twice", where=where, remedy=f"Give every {name} once, in order"
            )
    with np.errstate(invalid="ignore"):
        # xarray has turned fill values that the file declares into NaN; remaining ones of their size were not declared.
        odd = np.isinf(values) | (np.abs(values) >= _FILL)
    if odd.any():
        raise BergError(
            f"{int(odd.sum())} values such as {values[odd][0]:g}", where=where,
            remedy="Declare the fill value (attribute _FillValue), or write NaN there",
        )  # fmt: skip
    if np.isnan(values).all():
        raise BergError("no values, only gaps", where=where, remedy="Choose another variable or date")


_FILL = 1e30
"""Numbers at least this large are fill values."""


SUFFIXES = (".tif", ".tiff", ".gtiff")


def read_band(path: Path, variable: str | None = None) -> tuple[Floats, Floats, Floats, str, str | None]:
    """Read a band of a GeoTIFF."""
    rasterio = needed("rasterio", "GeoTIFF files need it", "geotiff")
    check_file(path, remedy="Name a GeoTIFF", kind=BergError)
    with reading(path, "not a GeoTIFF, or a damaged one", "Write the grid again", BergError), own_filters():
        warnings.simplefilter("ignore")
        with rasterio.open(path, driver="GTiff") as file:
            band = _band(file, variable, str(path))
            refuse_large(
                file.width * file.height, MOST_VALUES, "values", size=8.0, where=str(path), kind=BergError,
                remedy="Cut the grid to the berg, or make it coarser",
            )  # fmt: skip
            raw = file.read(band, masked=True)
            if raw.dtype.kind not in "iufb":
                raise BergError(f"values of type {raw.dtype}", where=str(path), remedy="Give a band of plain numbers")
            values = np.ma.filled(raw.astype(np.float64), np.nan)
            transform, system = file.transform, file.crs
    where = f"{path}, band {band}"
    if system is None or transform.is_identity:
        raise BergError("no coordinates", where=where, remedy="Write a GeoTIFF with transform and coordinate system")
    # Terms that mix rows and columns: then no row has one latitude.
    if transform.b or transform.d:
        raise BergError("a rotated grid", where=where, remedy="Warp it to a grid along its coordinates")
    if not np.isfinite(list(transform)[:6]).all() or not transform.a or not transform.e:
        raise BergError(
            "a transform that is no grid", where=where, remedy="Write the GeoTIFF again, with its cell size"
        )
    if min(values.shape) < 2:
        raise BergError(f"shape {values.shape}", where=where, remedy="Give a grid of at least 2 by 2 points")
    x = transform.c + transform.a * (np.arange(values.shape[1]) + 0.5)
    y = transform.f + transform.e * (np.arange(values.shape[0]) + 0.5)
    columns, rows = np.argsort(x), np.argsort(y)
    crs = None if system.is_geographic else str(system.to_wkt())
    return x[columns], y[rows], values[np.ix_(rows, columns)], where, crs


def _band(file: Any, variable: str | None, where: str) -> int:
    """Return the number of the band that is meant."""
    names = {str(number): number for number in file.indexes}
    names |= {text: number for number, text in zip(file.indexes, file.descriptions, strict=True) if text}
    if variable is None and file.count == 1:
        return 1
    if variable not in names:
        raise BergError(f"no band {variable!r}", where=where, remedy=f"Name one with variable=: {', '.join(names)}")
    return int(names[variable])
