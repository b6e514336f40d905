"""SRTM15+ and ETOPO5 style elevation grids (GMT): ``z(lat, lon)`` or ``topo(topo_lat, topo_lon)``.

The SRTM15+ style was checked against a real (coarsened) file; the ETOPO5 style follows the documentation.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.bathymetry import NOTES, depth_from_elevation
from riftberg.products.product import Product, Source, text_of


def _matches(ds: xr.Dataset) -> bool:
    gmt = "GMT_version" in ds.attrs or any(word in text_of(ds, "title", "history") for word in ("srtm15", "etopo"))
    return ("topo" in ds.variables and "topo_lat" in ds.variables) or ("z" in ds.variables and gmt and "lat" in ds.dims)


def _named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of the ETOPO5 style."""
    return ds.rename({old: new for old, new in (("topo_lat", "lat"), ("topo_lon", "lon")) if old in ds.variables})


PRODUCT = Product(
    name="srtm15",
    title="SRTM15+ or ETOPO5 style elevation grid",
    citation="Tozer et al. 2019, Earth and Space Science 6, 1847, doi:10.1029/2019EA000658",
    evidence="sample",
    matches=_matches,
    sources=(Source("depth_below_surface", ("z", "topo"), "m"),),
    reshape=_named,
    variants=(("ETOPO5 style", "documentation"),),
    finish=depth_from_elevation,
    notes=NOTES,
)
