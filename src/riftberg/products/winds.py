"""NCEP reanalyses, 10 m wind on the T62 Gaussian grid: NCEP/NCAR R1 and NCEP/DOE R2 (NOAA PSL).

R1 was checked against a real file of the same layout (air.2m.gauss) and a published header of uwnd.10m.gauss; R2
(singleton ``level``, packed) follows the documentation. Latitudes are irregular and descend; old copies count hours
since 1-1-1 on the mixed Julian/Gregorian calendar, which xarray decodes.
"""

from __future__ import annotations

import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.product import DAY_SECONDS, Product, Source, text_of

_WINDS = (Source("ua", ("uwnd",), "m/s"), Source("va", ("vwnd",), "m/s"))
_HEADINGS = ("title", "dataset", "dataset_title", "description", "source", "References")


def _stated_here(ds: xr.Dataset) -> str:
    variables = " ".join(str(variable.attrs.get("dataset", "")) for variable in ds.variables.values()).lower()
    return f"{text_of(ds, *_HEADINGS)} {variables}"


def _matches_r2(ds: xr.Dataset) -> bool:
    words = _stated_here(ds)
    named = any(word in words for word in ("reanalysis-2", "reanalysis 2", "ncep/doe", "reanalysis2"))
    return named or (("uwnd" in ds.variables or "vwnd" in ds.variables) and ds.sizes.get("level", 0) == 1)


def _matches_r1(ds: xr.Dataset) -> bool:
    words = _stated_here(ds)
    named = any(word in words for word in ("nmc reanalysis", "ncep reanalysis", "ncep/ncar"))
    winds = bool({"uwnd", "vwnd"} & set(ds.variables)) and {"lat", "lon"} <= set(ds.dims)
    return (named or winds) and not _matches_r2(ds)


def _at_ten_metres(ds: xr.Dataset) -> xr.Dataset:
    """Refuse winds that are not at 10 m; their level, if they have one, is judged later."""
    for name in {"uwnd", "vwnd"} & set(ds.variables):
        words = " ".join(str(ds[name].attrs.get(key, "")) for key in ("long_name", "level_desc", "var_desc")).lower()
        if "sigma" in words or "pressure" in words or "995" in words:
            raise ForcingError(
                f"{name} is not the wind at 10 m ({words.strip()})",
                where=str(ds.encoding.get("source", "")),
                remedy="Use the files uwnd.10m.gauss.YYYY.nc and vwnd.10m.gauss.YYYY.nc of the folder surface_gauss",
            )
    return ds


_NOTES = ("6-hourly values at their stamp", "about 200 km resolution: the wind is smooth over a berg")

R1 = Product(
    name="ncep-r1",
    title="NCEP/NCAR Reanalysis 1, 10 m wind, 6-hourly",
    citation="Kalnay et al. 1996, Bull. Am. Meteorol. Soc. 77, 437; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="layout",
    matches=_matches_r1,
    sources=_WINDS,
    reshape=_at_ten_metres,
    longest_step=DAY_SECONDS,
    notes=(*_NOTES, "a real file of the same layout was read too, but of the air temperature at 2 m"),
)
R2 = Product(
    name="ncep-r2",
    title="NCEP/DOE Reanalysis 2, 10 m wind, 6-hourly",
    citation="Kanamitsu et al. 2002, Bull. Am. Meteorol. Soc. 83, 1631; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="documentation",
    matches=_matches_r2,
    sources=_WINDS,
    reshape=_at_ten_metres,
    longest_step=DAY_SECONDS,
    notes=_NOTES,
)
