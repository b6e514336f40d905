"""ERA5 single levels (ECMWF, Climate Data Store): wind, stress, waves, sea ice, sea surface temperature.

Three layouts: the old store (packed int16, hours since 1900; checked against a real file of wind and sea surface
temperature), the new store
(``valid_time``, ``number``, ``expver``; checked against a published header) and the ARCO Zarr stores (long names;
documentation only).
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.cf import USUAL_NAMES
from riftberg.products.product import DAY_SECONDS, Product, Source, text_of, without_single

_SOURCES = (
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
_OWN = {"u10", "v10", "swh", "mwp", "mwd", "iews", "inss", "siconc", "ci", "sst"}


def _matches(ds: xr.Dataset) -> bool:
    names = set(map(str, ds.variables))
    words = text_of(ds, "history", "institution", "GRIB_centre", "title", "source")
    ecmwf = any(word in words for word in ("grib_to_netcdf", "ecmf", "era5", "ecmwf", "cfgrib", "earthkit"))
    arco = (
        any(name.startswith("10m_u_component") for name in names)
        or "significant_height_of_combined_wind_waves_and_swell" in names
    )
    # By its names alone a file is one of ERA5 only where it holds nothing that ERA5 does not have.
    bare = {"u10", "v10"} <= names and not names & (USUAL_NAMES - _OWN)
    return arco or (bool(_OWN & names) and (ecmwf or "valid_time" in ds.dims or bare))


def _one_version(ds: xr.Dataset) -> xr.Dataset:
    """Name the time axis, join final and preliminary version (old store: dimension ``expver``)."""
    if "expver" in ds.dims:
        versions = [ds.isel(expver=k, drop=True) for k in range(ds.sizes["expver"])]
        ds = versions[0]
        for later in versions[1:]:
            ds = ds.fillna(later)
    if "valid_time" in ds.dims:
        ds = ds.drop_vars("time", errors="ignore").rename({"valid_time": "time"})
    if ds.sizes.get("number", 1) > 1:
        ds = without_single(ds, "number", what="This is an ensemble: ask for the product type 'reanalysis'")
    return ds.drop_vars("expver", errors="ignore")


PRODUCT = Product(
    name="era5",
    title="ERA5 hourly data on single levels",
    citation="Hersbach et al. 2020, Q. J. R. Meteorol. Soc. 146, 1999; Copernicus C3S, doi:10.24381/cds.adbb2d47",
    evidence="sample",
    matches=_matches,
    sources=_SOURCES,
    reshape=_one_version,
    longest_step=DAY_SECONDS,
    variants=(("new Climate Data Store", "layout"), ("ARCO Zarr store", "documentation")),
    notes=(
        "instantaneous values at their stamp; monthly means (GRIB_stepType avgua, avgad) in mid-month",
        "mean wave direction is the direction the waves come FROM",
        "waves come on a half-degree grid in a file of their own",
    ),
)
