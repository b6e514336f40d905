"""Seas made of numbers: fields on axes, curvilinear grids and scattered points as a forcing, and how elements meet them."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from riftberg import DatasetForcing
from riftberg.state import Elements, Floats, new_elements

BEGIN = np.datetime64("2020-12-09", "ns")
HOUR = 3600.0
NAMED = {
    "uo": ("eastward_sea_water_velocity", "m s-1"), "vo": ("northward_sea_water_velocity", "m s-1"),
    "ssh": ("sea_surface_height_above_geoid", "m"), "ice_thickness": ("sea_ice_thickness", "m"),
    "taux": ("surface_downward_eastward_stress", "Pa"), "tauy": ("surface_downward_northward_stress", "Pa"),
}  # fmt: skip


def sea(lon: Any, lat: Any, *, depth: Any = None, coastal_drift: float = 0.0, **fields: Any) -> DatasetForcing:
    """Return the forcing that fields (records, levels, points) give; records follow each other by an hour.

    The points lie on two axes, on a grid of positions of two dimensions, or are scattered. ``depth``: levels (m), from the
    surface down. A current must have both components.
    """
    lon, lat = np.asarray(lon), np.asarray(lat)
    on_axes = lon.ndim == 1 and np.shape(next(iter(fields.values())))[-2:] == (lat.size, lon.size)
    dims = ("y", "x") if lon.ndim == 2 else ("lat", "lon") if on_axes else ("node",)
    ds = xr.Dataset()
    for name, values, way in (("lon", lon, "east"), ("lat", lat, "north")):
        ds.coords[name] = (name if on_axes else dims), values, {"units": f"degrees_{way}"}
    if depth is not None:
        ds["depth"] = "depth", np.asarray(depth), {"units": "m", "positive": "down", "standard_name": "depth"}
    for name, values in fields.items():
        leading = np.ndim(values) - len(dims)
        on_levels = leading > 0 and depth is not None and np.shape(values)[leading - 1] == len(depth)
        axes = ("time",) * (leading - on_levels) + ("depth",) * on_levels
        meaning, units = NAMED[name]
        ds[name] = (*axes, *dims), np.asarray(values), {"standard_name": meaning, "units": units}
        if "time" in axes:
            ds["time"] = BEGIN + np.arange(len(values)) * np.timedelta64(1, "h")
    level = "files" if "ssh" in fields else "none"
    return DatasetForcing.from_xarray(ds, BEGIN, sea_level=level, coastal_drift=coastal_drift)


def meet(forcing: DatasetForcing, lon: Any, lat: Any, *, draft: Any = 1.0, hours: float = 0.0) -> Elements:
    """Return elements at positions (degrees), of some draft (m), with what the forcing gives them."""
    e = new_elements(np.size(lon))
    e.place.lon[:], e.place.lat[:] = lon, lat
    e.body.thickness[:] = np.asarray(draft) * 1025.0 / 850.0
    forcing.sample(e, HOUR * hours)
    return e


def within(lon: Floats, lat: Floats, count: int = 200, seed: int = 3) -> tuple[Floats, Floats]:
    """Return positions in the middle half of some points."""
    rng = np.random.default_rng(seed)
    low, high = np.nanquantile(lon, [0.25, 0.75]), np.nanquantile(lat, [0.25, 0.75])
    return rng.uniform(*low, count), rng.uniform(*high, count)
