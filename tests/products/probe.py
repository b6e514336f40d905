"""Fields of a canonical dataset at points, as a model grid there gets them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from riftberg.ocean.files_forcing import interpolate_levels, place_points
from riftberg.ocean.product_part import product_part


def at_points(ds: xr.Dataset, lon: Any, lat: Any, times: Any = None) -> xr.Dataset:
    """Return all fields on (time, depth, y, x) at points (axes, or positions of every point) and dates; NaN where unknown."""
    lon, lat = np.meshgrid(lon, lat) if np.ndim(lon) == 1 else (np.asarray(lon), np.asarray(lat))
    records = ds["time"].values if "time" in ds.dims else np.array(["2020-12-01"], "M8[ns]")
    start = datetime.fromisoformat(str(records[0].astype("M8[s]")))
    part = product_part(ds, start)
    places = place_points(part, lon, lat)
    dates = records if times is None else np.array(times, "M8[ns]")
    seconds = (dates - records[0]) / np.timedelta64(1, "s")
    fields = {
        name: np.stack([interpolate_levels(part, name, time, places).reshape(-1, *lon.shape) for time in seconds])
        for name in part.records.names
    }
    levels = {"depth": ds["depth"].values} if "depth" in ds.dims else {}
    return xr.Dataset(
        {
            name: (("time", "depth", "y", "x"), v) if levels else (("time", "y", "x"), v[:, 0])
            for name, v in fields.items()
        },
        {"time": dates, **levels},
    )
