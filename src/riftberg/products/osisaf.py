"""OSI SAF sea ice concentration: 10 km polar stereographic (daily) and 25 km EASE2 (climate data record).

The polar stereographic layout was checked against a published header; EASE2 follows the documentation. The projection
is read from the file's grid mapping; where that is missing the standard one of the product is taken, and either is
checked against the file's two-dimensional latitudes and longitudes.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.product import DAY, Product, Source, stamped_at_noon
from riftberg.products.projected import projected

_STEREOGRAPHIC = "+proj=stere +a=6378273 +b=6356889.44891 +lat_0={pole} +lat_ts={true} +lon_0={lon}"
_EASE2 = "+proj=laea +ellps=WGS84 +datum=WGS84 +lat_0={pole} +lon_0=0"


def _matches(ds: xr.Dataset) -> bool:
    return "ice_conc" in ds.variables and {"xc", "yc"} <= set(ds.dims)


def _fallback(ds: xr.Dataset) -> str:
    """Return the standard projection of the product for the hemisphere of the file."""
    south = float(ds["lat"].mean()) < 0 if "lat" in ds.variables else True
    spacing = abs(float(ds["xc"][1] - ds["xc"][0]))
    if "Lambert_Azimuthal_Grid" in ds.variables or spacing > 20.0:
        return _EASE2.format(pole=-90 if south else 90)
    return _STEREOGRAPHIC.format(pole=-90 if south else 90, true=-70 if south else 70, lon=0 if south else -45)


def _reshape(ds: xr.Dataset) -> xr.Dataset:
    return projected(ds, x="xc", y="yc", fallback=_fallback(ds))


PRODUCT = Product(
    name="osisaf-ice",
    title="OSI SAF sea ice concentration",
    citation="OSI SAF global sea ice concentration OSI-401 / OSI-450-a, EUMETSAT Ocean and Sea Ice SAF, https://osi-saf.eumetsat.int",
    evidence="layout",
    matches=_matches,
    sources=(Source("ice_fraction", ("ice_conc",), "%"),),
    reshape=_reshape,
    variants=(("EASE2, 25 km", "documentation"),),
    finish=stamped_at_noon,
    averaging=DAY,
    notes=("daily, stamped 12:00 UTC", "percent in the file, fraction here", "projected grid: to_latlon regrids it"),
)
