"""Products of the sea floor: GEBCO, IBCSO, SRTM15+ and ETOPO5."""

from __future__ import annotations

import xarray as xr

from riftberg.products.place import projected
from riftberg.products.product import Heading, Product, Source
from riftberg.products.quantities import QUANTITIES, labelled

NOTES = ("elevations are turned into depths, positive down; land is missing (NaN)",)


def depth_from_elevation(ds: xr.Dataset) -> xr.Dataset:
    """Return the dataset with ``depth_below_surface`` made from the elevation that it holds under that name so far.

    ``ds``: canonical dataset in which ``depth_below_surface`` still holds the elevation (m, positive up).
    """
    if "depth_below_surface" not in ds.data_vars:
        return ds
    elevation = ds["depth_below_surface"]
    depth = labelled((-elevation).where(elevation < 0.0), QUANTITIES["depth_below_surface"])
    depth.attrs |= {key: elevation.attrs[key] for key in ("original_name", "original_units") if key in elevation.attrs}
    return ds.assign(depth_below_surface=depth)


# GEBCO grids (15 arc seconds): elevation of the sea floor or of the ice surface.
#
# Checked against a real subset of GEBCO_2021. Cells are pixel centred. Of the two versions the one with the elevation
# under the ice ("sub ice topo") is right south of ice fronts; elsewhere they agree.


def _is_gebco(heading: Heading) -> bool:
    return "elevation" in heading.names and "gebco" in heading.says("title", "summary", "source", "id", "history")


GEBCO = Product(
    name="gebco",
    title="GEBCO grid, 15 arc seconds",
    citation="GEBCO Compilation Group, GEBCO Grid, https://www.gebco.net (public domain; state the year of the grid)",
    evidence="sample",
    matches=_is_gebco,
    sources=(Source("depth_below_surface", ("elevation",), "m"),),
    finish=depth_from_elevation,
    notes=NOTES,
)


# IBCSO v2 sea floor south of 50 S: 500 m polar stereographic (EPSG:9354), or the WGS84 longitude-latitude version.
#
# Written from documentation only: no file was to be had.


_IBCSO_MAP = "EPSG:9354"


def _is_ibcso(heading: Heading) -> bool:
    words = heading.says("title", "summary", "source", "history", "project", "references", "comment", "id")
    return "z" in heading.names and (
        "ibcso" in words or ({"x", "y"} <= set(heading.sizes) and "ibcso" in heading.source.lower())
    )


IBCSO = Product(
    name="ibcso",
    title="International Bathymetric Chart of the Southern Ocean, version 2",
    citation="Dorschel et al. 2022, Scientific Data 9, 275; doi:10.1594/PANGAEA.937574 (CC-BY 4.0)",
    evidence="documentation",
    matches=_is_ibcso,
    sources=(Source("depth_below_surface", ("z",), "m"),),
    reshape=lambda ds: projected(ds, _IBCSO_MAP) if {"x", "y"} <= set(ds.dims) else ds,
    finish=depth_from_elevation,
    notes=(*NOTES, "polar stereographic, true scale at 65 S: to_latlon regrids it"),
)


# SRTM15+ and ETOPO5 style elevation grids (GMT): ``z(lat, lon)`` or ``topo(topo_lat, topo_lon)``.
#
# The SRTM15+ style was checked against a real (coarsened) file; the ETOPO5 style follows the documentation.


def _is_srtm15(heading: Heading) -> bool:
    gmt = "GMT_version" in heading.attributes or any(
        word in heading.says("title", "history") for word in ("srtm15", "etopo")
    )
    return ("topo" in heading.names and "topo_lat" in heading.names) or (
        "z" in heading.names and gmt and "lat" in heading.sizes
    )


def _with_etopo_axes_named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of the ETOPO5 style."""
    return ds.rename({old: new for old, new in (("topo_lat", "lat"), ("topo_lon", "lon")) if old in ds.variables})


SRTM15 = Product(
    name="srtm15",
    title="SRTM15+ or ETOPO5 style elevation grid",
    citation="Tozer et al. 2019, Earth and Space Science 6, 1847, doi:10.1029/2019EA000658",
    evidence="sample",
    matches=_is_srtm15,
    sources=(Source("depth_below_surface", ("z", "topo"), "m"),),
    reshape=_with_etopo_axes_named,
    variants=(("ETOPO5 style", "documentation"),),
    finish=depth_from_elevation,
    notes=NOTES,
)
