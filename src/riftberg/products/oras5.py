"""ORAS5 ocean reanalysis (ECMWF, Climate Data Store), monthly, on the quarter-degree NEMO grid.

Written from documentation only: no native file was to be had. Native files have dims ``(time_counter, [deptht,] y,
x)`` with two-dimensional ``nav_lat`` and ``nav_lon``. South of about 20 N that grid is a Mercator grid, so that a
window there gets ordinary axes (see `riftberg.products.window`). The monthly ORAS5 fields of the A68a
experiment are another layout, see `riftberg.products.experiment`.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from riftberg.products.means import in_mid_month
from riftberg.products.product import Product, Source, text_of

_NAMES = {"vozocrte", "vomecrtn", "vozocrtx", "vomecrty", "sossheig", "sozotaux", "sometauy", "ileadfra", "sosstsst"}
_RENAMED = {"nav_lat": "lat", "nav_lon": "lon", "time_counter": "time"}
_LEVELS = ("deptht", "depthu", "depthv")


def _matches(ds: xr.Dataset) -> bool:
    """Tell ORAS5 from other output of NEMO by heading or name: its records are months, those of others may be hours."""
    words = (
        text_of(ds, "title", "source", "summary", "product", "id", "references")
        + str(ds.encoding.get("source", "")).lower()
    )
    named = "oras5" in words or "oras-5" in words or "_monthly_highres_" in words
    return named and bool(_NAMES & set(ds.variables)) and {"nav_lat", "nav_lon"} <= set(ds.variables)


def _named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes, and keep the two-dimensional positions as coordinates."""
    names = {**_RENAMED, **{name: "depth" for name in _LEVELS}}
    ds = ds.rename({old: new for old, new in names.items() if old in ds.variables or old in ds.dims})
    return ds.set_coords(["lat", "lon"])


PRODUCT = Product(
    name="oras5",
    title="ORAS5 global ocean reanalysis, monthly, 1/4 degree",
    citation="Zuo et al. 2019, Ocean Sci. 15, 779; Copernicus Climate Change Service, doi:10.24381/cds.67e8eeb7",
    evidence="documentation",
    matches=_matches,
    sources=(
        Source("uo", ("vozocrte", "vozocrtx"), "m s-1"),
        Source("vo", ("vomecrtn", "vomecrty"), "m s-1"),
        Source("ssh", ("sossheig",), "m"),
        Source("sst", ("sosstsst",), "degC"),
        Source("taux", ("sozotaux",), "Pa"),
        Source("tauy", ("sometauy",), "Pa"),
        Source("ice_fraction", ("ileadfra",), "1"),
    ),
    reshape=_named,
    finish=lambda ds: in_mid_month(ds) if "time" in ds.dims else ds,
    averaging=np.timedelta64(int(30.4 * 86400), "s"),
    notes=(
        "monthly means: stamps put in mid-month; they smooth the eddies that break bergs",
        "vozocrte, vomecrtn are rotated to true east and north; vozocrtx, vomecrty follow the grid, "
        "which is the same south of 20 N but half a cell aside",
    ),
)
