"""Grids from GeoTIFF files, in longitude and latitude or in a map projection.

Needs the optional packages of the extra ``geotiff`` (rasterio, pyproj), imported when first used.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from riftberg.bergs.feature import needed
from riftberg.errors import BergError
from riftberg.state import Floats
from riftberg.system.input_files import check_file, reading
from riftberg.system.limits import MOST_VALUES, refuse_large
from riftberg.system.process_settings import own_filters

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
    if transform.b or transform.d:
        raise BergError("a turned grid", where=where, remedy="Warp it to a grid along its coordinates")
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
