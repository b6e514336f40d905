"""GEBCO grids (15 arc seconds): elevation of the sea floor or of the ice surface.

Checked against a real subset of GEBCO_2021. Cells are pixel centred. Of the two versions the one with the elevation
under the ice ("sub ice topo") is right south of ice fronts; elsewhere they agree.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.bathymetry import NOTES, depth_from_elevation
from riftberg.products.product import Product, Source, text_of


def _matches(ds: xr.Dataset) -> bool:
    return "elevation" in ds.variables and "gebco" in text_of(ds, "title", "summary", "source", "id", "history")


PRODUCT = Product(
    name="gebco",
    title="GEBCO grid, 15 arc seconds",
    citation="GEBCO Compilation Group, GEBCO Grid, https://www.gebco.net (public domain; state the year of the grid)",
    evidence="sample",
    matches=_matches,
    sources=(Source("depth_below_surface", ("elevation",), "m"),),
    finish=depth_from_elevation,
    notes=NOTES,
)
