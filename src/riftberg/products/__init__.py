"""Data products of ocean, air, sea ice and sea floor, each turned into one canonical `xarray.Dataset`.

The canonical dataset
---------------------
Dimensions
    ``time`` (``datetime64[ns]``, UTC, standard calendar; absent for static fields), with ``averaging_period`` (s) beside
    it where records are means of known bounds; ``depth`` (m, positive down, ascending; only where the product has
    levels), ``lat`` and ``lon`` (degrees, ascending).
    Longitudes run from -180 to 180; a regional field that crosses the date line goes on beyond 180 (for example
    170..190), so that they stay ascending. Products on a projected grid keep ``y`` and ``x`` (m) with the projection
    in the attribute ``crs_wkt``; products on a curvilinear ocean grid keep ``y``, ``x`` with two-dimensional ``lat``
    and ``lon``; scattered points (unstructured models) have one dimension ``node`` with ``lat`` and ``lon`` on it.
    Vectors point east and north on all of them.
Variables
    The names of `riftberg.products.quantities.QUANTITIES`, in the units given there. Land and missing values are
    NaN.

Attributes
----------
    ``product``, ``source``, ``history``, ``citation``.

Use
---
>>> from riftberg.products import open_product, window
>>> currents = open_product("oscar_currents_final_202012*.nc")                        # doctest: +SKIP
>>> currents = window(currents, lon=(-45, -30), lat=(-60, -50), margin=1.0)           # doctest: +SKIP
"""

from riftberg.products.levels import keel_mean
from riftberg.products.mesh import window
from riftberg.products.registry import PRODUCTS, open_all, open_product, product_named, recognise

__all__ = ["PRODUCTS", "keel_mean", "open_all", "open_product", "product_named", "recognise", "window"]
