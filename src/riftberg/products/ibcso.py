"""IBCSO v2 sea floor south of 50 S: 500 m polar stereographic (EPSG:9354), or the WGS84 longitude-latitude version.

Written from documentation only: no file was to be had.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.bathymetry import NOTES, depth_from_elevation
from riftberg.products.product import Product, Source, text_of
from riftberg.products.projected import projected

_CRS = "EPSG:9354"


def _matches(ds: xr.Dataset) -> bool:
    words = text_of(ds, "title", "summary", "source", "history", "project", "references", "comment", "id")
    return "z" in ds.variables and (
        "ibcso" in words or ({"x", "y"} <= set(ds.dims) and "ibcso" in str(ds.encoding.get("source", "")).lower())
    )


def _reshape(ds: xr.Dataset) -> xr.Dataset:
    return projected(ds, x="x", y="y", fallback=_CRS) if {"x", "y"} <= set(ds.dims) else ds


PRODUCT = Product(
    name="ibcso",
    title="International Bathymetric Chart of the Southern Ocean, version 2",
    citation="Dorschel et al. 2022, Scientific Data 9, 275; doi:10.1594/PANGAEA.937574 (CC-BY 4.0)",
    evidence="documentation",
    matches=_matches,
    sources=(Source("depth_below_surface", ("z",), "m"),),
    reshape=_reshape,
    finish=depth_from_elevation,
    notes=(*NOTES, "polar stereographic, true scale at 65 S: to_latlon regrids it"),
)
