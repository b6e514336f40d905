"""Fields on a map projection: axes in metres, positions by pyproj."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError

Floats = NDArray[np.float64]
METRES = {"km": 1000.0, "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "": 1.0}
"""Metres in the units of map axes."""


_TEXTS = ("crs_wkt", "spatial_ref", "proj4_string", "proj4", "proj4text", "proj_params", "proj_string")

RADII = frozenset((
    "earth_radius", "semi_major_axis", "semi_minor_axis", "inverse_flattening", "reference_ellipsoid_name", "crs_wkt",
    "horizontal_datum_name", "geographic_crs_name",
))  # fmt: skip
"""Attributes of a grid mapping that say how large the Earth is."""


def states_radius(mapping: xr.Variable) -> bool:
    """Tell whether a grid mapping says how large the Earth is, by itself or in a text."""
    return bool({*RADII, *_TEXTS} & set(mapping.attrs))


def projected(ds: xr.Dataset, *, x: str, y: str, fallback: str) -> xr.Dataset:
    """Name the projected axes ``x`` and ``y`` in metres and note the projection as ``crs_wkt``."""
    crs = _crs_of(ds, fallback)
    ds = ds.rename({old: new for old, new in ((x, "x"), (y, "y")) if old != new})
    for axis in ("x", "y"):
        units = str(ds[axis].attrs.get("units", "")).lower()
        values = ds[axis].values.astype(float) * METRES[units]
        attributes = {"standard_name": f"projection_{axis}_coordinate", "units": "m", "axis": axis.upper()}
        ds = ds.assign_coords({axis: (axis, values, attributes)})
    if {"lat", "lon"} <= set(ds.variables):
        _check_projection(ds, crs)
    return ds.assign_attrs(crs_wkt=crs.to_wkt())


def _crs_of(ds: xr.Dataset, fallback: str) -> Any:
    """Return the projection from the grid mapping variable, else the fallback."""
    from pyproj import CRS

    for variable in ds.variables.values():
        if variable.ndim == 0 and "grid_mapping_name" in variable.attrs:
            crs = crs_of_mapping(variable)
            if crs is not None:
                return crs
    return CRS.from_user_input(fallback)


def _transformer(crs: Any) -> Any:
    from pyproj import CRS, Transformer

    crs = CRS.from_user_input(crs)
    # A projection and its own ellipsoid have no datum shift between them: so the products define their positions.
    return Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)


def to_projection(crs: Any, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
    """Return projected positions (m) of longitudes and latitudes (degrees)."""
    x, y = _transformer(crs).transform(lon, lat)
    return np.asarray(x, float), np.asarray(y, float)


def to_degrees(crs: Any, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes (degrees) of projected positions (m; degrees on a rotated pole)."""
    from pyproj.enums import TransformDirection

    lon, lat = _transformer(crs).transform(x, y, direction=TransformDirection.INVERSE)
    return np.asarray(lon, float), np.asarray(lat, float)


def crs_of_mapping(mapping: xr.Variable) -> Any:
    """Return the projection that a grid mapping variable describes; None if pyproj understands none of its words."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    attributes = _plain_attributes(mapping.attrs)
    texts = [attributes[key] for key in _TEXTS if key in attributes]
    ways = [(cast(Any, CRS).from_cf, attributes), *((cast(Any, CRS).from_user_input, t) for t in texts)]
    if not RADII & set(attributes):  # a text may say which; without one the library takes WGS84
        ways = [*ways[1:], ways[0]]
    for reading, stated in ways:
        try:
            return reading(stated)
        except (CRSError, KeyError, ValueError, TypeError, AttributeError):
            continue
    return None


def _plain_attributes(attributes: Any) -> dict[str, Any]:
    """Return attributes with lists instead of arrays; a tangent cone has one standard parallel."""
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in attributes.items()}
    parallels = plain.get("standard_parallel")
    if (
        isinstance(parallels, list)
        and len(set(parallels)) == 1
        and "conformal_conic" in str(plain.get("grid_mapping_name"))
    ):
        plain["standard_parallel"] = parallels[0]
    return plain


def _check_projection(ds: xr.Dataset, crs: Any) -> None:
    """Compare a sample of the file's positions with the projection; half a cell is the most that they may differ."""
    lat, lon = ds["lat"], ds["lon"]
    pick = {dim: slice(None, None, max(1, size // 8)) for dim, size in lat.sizes.items()}
    lon_s, lat_s = lon.isel(pick).values, lat.isel(pick).values
    x, y = to_projection(crs, lon_s, lat_s)
    expected_x, expected_y = np.meshgrid(ds["x"].isel(x=pick["x"]).values, ds["y"].isel(y=pick["y"]).values)
    off = np.nanmax(np.hypot(x - expected_x, y - expected_y)) if np.isfinite(lat_s).any() else 0.0
    if not off <= 0.5 * abs(float(ds["x"][1] - ds["x"][0])):
        raise ForcingError(
            f"projection and positions of the file differ by {off / 1000.0:.1f} km",
            where=str(ds.encoding.get("source", "")),
            remedy="The file's grid mapping is wrong or missing: check its header",
        )
