"""Products of the atmosphere: NCEP reanalyses, JRA-55, ERA5."""

from __future__ import annotations

import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.products.cf import USUAL_NAMES
from riftberg.products.product import Heading, Product, Source, without_single

# NCEP reanalyses, 10 m wind on the T62 Gaussian grid: NCEP/NCAR NCEP_R1 and NCEP/DOE NCEP_R2 (NOAA PSL).
#
# NCEP_R1 was checked against a real file of the same layout (air.2m.gauss) and a published header of uwnd.10m.gauss; NCEP_R2
# (singleton ``level``, packed) follows the documentation. Latitudes are irregular and descend; old copies count hours
# since 1-1-1 on the mixed Julian/Gregorian calendar, which xarray decodes.

_NCEP_WINDS = (Source("ua", ("uwnd",), "m/s"), Source("va", ("vwnd",), "m/s"))
_HEADINGS = ("title", "dataset", "dataset_title", "description", "source", "References")


def _stated_here(heading: Heading) -> str:
    variables = " ".join(str(variable.get("dataset", "")) for variable in heading.variables.values()).lower()
    return f"{heading.says(*_HEADINGS)} {variables}"


def _is_ncep_r2(heading: Heading) -> bool:
    words = _stated_here(heading)
    named = any(word in words for word in ("reanalysis-2", "reanalysis 2", "ncep/doe", "reanalysis2"))
    return named or (("uwnd" in heading.names or "vwnd" in heading.names) and heading.sizes.get("level", 0) == 1)


def _is_ncep_r1(heading: Heading) -> bool:
    words = _stated_here(heading)
    named = any(word in words for word in ("nmc reanalysis", "ncep reanalysis", "ncep/ncar"))
    winds = bool({"uwnd", "vwnd"} & heading.names) and {"lat", "lon"} <= set(heading.sizes)
    return (named or winds) and not _is_ncep_r2(heading)


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


_NCEP_NOTES = ("6-hourly values at their stamp", "about 200 km resolution: the wind is smooth over a berg")

NCEP_R1 = Product(
    name="ncep-r1",
    title="NCEP/NCAR Reanalysis 1, 10 m wind, 6-hourly",
    citation="Kalnay et al. 1996, Bull. Am. Meteorol. Soc. 77, 437; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="layout",
    matches=_is_ncep_r1,
    sources=_NCEP_WINDS,
    reshape=_at_ten_metres,
    longest_step=SECONDS_PER_DAY,
    notes=(*_NCEP_NOTES, "a real file of the same layout was read too, but of the air temperature at 2 m"),
)
NCEP_R2 = Product(
    name="ncep-r2",
    title="NCEP/DOE Reanalysis 2, 10 m wind, 6-hourly",
    citation="Kanamitsu et al. 2002, Bull. Am. Meteorol. Soc. 83, 1631; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="documentation",
    matches=_is_ncep_r2,
    sources=_NCEP_WINDS,
    reshape=_at_ten_metres,
    longest_step=SECONDS_PER_DAY,
    notes=_NCEP_NOTES,
)


# JRA-55 (GRIB converted by NCL) and JRA55-do (input4MIPs) 10 m wind.
#
# Written from documentation only: no original file was to be had (the JRA-55 fields of the A68a experiment are another
# layout, see `riftberg.products.models`).


_JRA55_EAST = ("UGRD_GDS4_HTGL", "UGRD_GDS0_HTGL", "uas", "uas_10m")
_JRA55_NORTH = ("VGRD_GDS4_HTGL", "VGRD_GDS0_HTGL", "vas", "vas_10m")


def _is_jra55(heading: Heading) -> bool:
    names = heading.names
    # NCL makes these names from the tables of GRIB; no other converter does.
    if any(str(name).startswith(("UGRD_GDS", "VGRD_GDS")) for name in names):
        return True
    return bool(names & {*_JRA55_EAST, *_JRA55_NORTH}) and "jra" in heading.says(
        "source_id", "source", "title", "institution_id"
    )


def _with_ncl_axes_named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of NCL's conversion from GRIB."""
    axes = {}
    for name in ds.dims:
        text = str(name)
        if text.startswith("initial_time"):
            axes[name] = "time"
        elif text.startswith(("g4_lat", "g0_lat")):
            axes[name] = "lat"
        elif text.startswith(("g4_lon", "g0_lon")):
            axes[name] = "lon"
    return ds.rename(axes)


JRA55 = Product(
    name="jra55",
    title="JRA-55 or JRA55-do, 10 m wind",
    citation="Kobayashi et al. 2015, J. Meteorol. Soc. Japan 93, 5; Tsujino et al. 2018, Ocean Modell. 130, 79",
    evidence="documentation",
    matches=_is_jra55,
    sources=(Source("ua", _JRA55_EAST, "m s-1"), Source("va", _JRA55_NORTH, "m s-1")),
    reshape=_with_ncl_axes_named,
    longest_step=SECONDS_PER_DAY,
    notes=("values at their stamp: 6-hourly (JRA-55) or 3-hourly (JRA55-do)",),
)


# ERA5 single levels (ECMWF, Climate Data Store): wind, stress, waves, sea ice, sea surface temperature.
#
# Three layouts: the old store (packed int16, hours since 1900; checked against a real file of wind and sea surface
# temperature), the new store
# (``valid_time``, ``number``, ``expver``; checked against a published header) and the ARCO Zarr stores (long names;
# documentation only).


_ERA5_FIELDS = (
    Source("ua", ("u10", "10m_u_component_of_wind"), "m s-1"),
    Source("va", ("v10", "10m_v_component_of_wind"), "m s-1"),
    Source("taux", ("iews", "avg_iews", "metss", "avg_ttss_x"), "N m-2", "documentation"),
    Source("tauy", ("inss", "avg_inss", "mntss", "avg_ttss_y"), "N m-2", "documentation"),
    Source("sst", ("sst", "sea_surface_temperature"), "K"),
    Source("ice_fraction", ("siconc", "ci", "sea_ice_cover"), "1", "documentation"),
    Source("wave_height", ("swh", "significant_height_of_combined_wind_waves_and_swell"), "m", "documentation"),
    Source("wave_period", ("mwp", "mean_wave_period"), "s", "documentation"),
    Source("wave_direction", ("mwd", "mean_wave_direction"), "degree", "documentation"),
)
_ERA5_NAMES = {"u10", "v10", "swh", "mwp", "mwd", "iews", "inss", "siconc", "ci", "sst"}


def _is_era5(heading: Heading) -> bool:
    names = heading.names
    words = heading.says("history", "institution", "GRIB_centre", "title", "source")
    ecmwf = any(word in words for word in ("grib_to_netcdf", "ecmf", "era5", "ecmwf", "cfgrib", "earthkit"))
    arco = (
        any(name.startswith("10m_u_component") for name in names)
        or "significant_height_of_combined_wind_waves_and_swell" in names
    )
    # By its names alone a file is one of ERA5 only where it holds nothing that ERA5 does not have.
    bare = {"u10", "v10"} <= names and not names & (USUAL_NAMES - _ERA5_NAMES)
    return arco or (bool(_ERA5_NAMES & names) and (ecmwf or "valid_time" in heading.sizes or bare))


def _one_version(ds: xr.Dataset) -> xr.Dataset:
    """Name the time axis, join final and preliminary version (old store: dimension ``expver``)."""
    if "expver" in ds.dims:
        versions = [ds.isel(expver=k, drop=True) for k in range(ds.sizes["expver"])]
        ds = versions[0]
        # The first version is the final one; the preliminary one fills the months that it does not have yet.
        for later in versions[1:]:
            ds = ds.fillna(later)
    if "valid_time" in ds.dims:
        # With both names, ``time`` is the start of the forecast and not the date of the values.
        ds = ds.drop_vars("time", errors="ignore").rename({"valid_time": "time"})
    if ds.sizes.get("number", 1) > 1:
        ds = without_single(ds, "number", what="This is an ensemble: ask for the product type 'reanalysis'")
    return ds.drop_vars("expver", errors="ignore")


ERA5 = Product(
    name="era5",
    title="ERA5 hourly data on single levels",
    citation="Hersbach et al. 2020, Q. J. R. Meteorol. Soc. 146, 1999; Copernicus C3S, doi:10.24381/cds.adbb2d47",
    evidence="sample",
    matches=_is_era5,
    sources=_ERA5_FIELDS,
    reshape=_one_version,
    longest_step=SECONDS_PER_DAY,
    variants=(("new Climate Data Store", "layout"), ("ARCO Zarr store", "documentation")),
    notes=(
        "instantaneous values at their stamp; monthly means (GRIB_stepType avgua, avgad) in mid-month",
        "mean wave direction is the direction the waves come FROM",
        "waves come on a half-degree grid in a file of their own",
    ),
)
