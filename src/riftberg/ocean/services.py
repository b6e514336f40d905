"""Fetching of original products from the services that hold them, over a box and some days.

The services' own clients are used (earthaccess for OSCAR, copernicusmarine for GLORYS12 and DUACS, cdsapi for ERA5)
where they are installed and logged in; NCEP/NCAR R1 needs no login.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from riftberg.errors import ForcingError
from riftberg.ocean.download import Bar, Progress, Resuming, fetch_one, made, missing_package
from riftberg.ocean.products.window import utc

Service = Literal["oscar", "glorys", "duacs", "era5", "ncep-r1"]
NCEP_URL = "https://downloads.psl.noaa.gov/Datasets/ncep.reanalysis/surface_gauss/"
EXTRAS = {"earthaccess": "oscar", "copernicusmarine": "copernicus", "cdsapi": "era5"}
"""Optional extra of Riftberg that brings the client of a service."""
_COPERNICUS = {
    "glorys": ("cmems_mod_glo_phy_my_0.083deg_P1D-m", ["uo", "vo", "zos"]),
    "duacs": ("cmems_obs-sl_glo_phy-ssh_my_allsat-l4-duacs-0.125deg_P1D", ["adt"]),
}


def fetch_product(
    name: Service,
    folder: str | Path,
    lon: tuple[float, float],
    lat: tuple[float, float],
    time: tuple[Any, Any],
    *,
    depth: float = 250.0,
    progress: Progress | bool = True,
    ncep_url: str = NCEP_URL,
) -> list[Path]:
    """Fetch an original product from the service that holds it.

    Parameters
    ----------
    name : {"oscar", "glorys", "duacs", "era5", "ncep-r1"}
        OSCAR v2 final (Earthdata login), GLORYS12 and DUACS (Copernicus Marine login), ERA5 wind (Climate Data Store
        key), NCEP/NCAR R1 10 m wind (no login, whole years).
    folder : str or Path
        Where the files go.
    lon, lat : tuple of float
        Box (degrees, -180..180).
    time : tuple
        First and last day (UTC).
    depth : float
        Deepest level wanted (m), where the product has levels.
    progress : bool or callable
        As in `fetch_a68a`, for services without a client of their own.
    ncep_url : str
        Address of the NCEP files.

    Returns
    -------
    list of Path

    Raises
    ------
    ForcingError
        If the client of the service is not installed or not logged in; the message says how to come by either.
    """
    folder = made(Path(folder))
    first, last = utc(time[0]), utc(time[1])
    if name == "oscar":
        return _fetch_oscar(folder, first, last)
    if name in _COPERNICUS:
        return _fetch_copernicus(name, folder, lon, lat, first, last, depth)
    if name == "era5":
        return _fetch_era5(folder, lon, lat, first, last)
    if name == "ncep-r1":
        return _fetch_ncep(folder, first, last, ncep_url, progress)
    known = "oscar, glorys, duacs, era5, ncep-r1"
    raise ForcingError(f"there is no service for {name!r}", where="fetch", remedy=f"Choose one of: {known}")


def _client(package: str, what: str) -> Any:
    """Return the client of a service, or say that it is not installed."""
    if find_spec(package) is None:
        raise missing_package(package, EXTRAS[package], what)
    return import_module(package)


def _needs_login(service: str, remedy: str) -> ForcingError:
    return ForcingError(f"{service} wants a login and none was found", where="fetch", remedy=remedy)


def _fetch_oscar(folder: Path, first: np.datetime64, last: np.datetime64) -> list[Path]:
    client = _client("earthaccess", "to fetch OSCAR from NASA PO.DAAC")
    remedy = (
        "Make a free account at https://urs.earthdata.nasa.gov, then put it in ~/.netrc "
        "(machine urs.earthdata.nasa.gov) or in EARTHDATA_USERNAME and EARTHDATA_PASSWORD"
    )
    if not _earthdata_known():
        raise _needs_login("NASA Earthdata", remedy)
    if not client.login(strategy="all", persist=False):
        raise ForcingError("NASA Earthdata refused the login", where="fetch", remedy=remedy)
    found = client.search_data(short_name="OSCAR_L4_OC_FINAL_V2.0", temporal=(str(first)[:10], str(last)[:10]))
    if not found:
        raise ForcingError(
            f"no OSCAR file for {str(first)[:10]}..{str(last)[:10]}",
            where="fetch",
            remedy="Check the dates (from 1993)",
        )
    return sorted(Path(path) for path in client.download(found, str(folder)))


def _earthdata_known() -> bool:
    """Tell whether a login for Earthdata is to be found; its content is not looked at."""
    variables = "EARTHDATA_TOKEN" in os.environ or {"EARTHDATA_USERNAME", "EARTHDATA_PASSWORD"} <= set(os.environ)
    return variables or Path(os.environ.get("NETRC", Path.home() / ".netrc")).exists()


def _fetch_copernicus(
    name: str,
    folder: Path,
    lon: tuple[float, float],
    lat: tuple[float, float],
    first: np.datetime64,
    last: np.datetime64,
    depth: float,
) -> list[Path]:
    client = _client("copernicusmarine", "to fetch from the Copernicus Marine Service")
    known = {"COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD"} <= set(os.environ)
    if not known and not (Path.home() / ".copernicusmarine").exists():
        remedy = "Make a free account at https://data.marine.copernicus.eu, then run: copernicusmarine login"
        raise _needs_login("Copernicus Marine", remedy)
    dataset, variables = _COPERNICUS[name]
    target = folder / f"{name}_{str(first)[:10]}_{str(last)[:10]}.nc"
    levels = {"minimum_depth": 0.0, "maximum_depth": depth} if name == "glorys" else {}
    client.subset(
        dataset_id=dataset,
        variables=variables,
        minimum_longitude=lon[0],
        maximum_longitude=lon[1],
        minimum_latitude=lat[0],
        maximum_latitude=lat[1],
        start_datetime=str(first)[:19],
        end_datetime=str(last)[:19],
        output_filename=target.name,
        output_directory=str(folder),
        **levels,
    )
    return [target]


def _fetch_era5(
    folder: Path, lon: tuple[float, float], lat: tuple[float, float], first: np.datetime64, last: np.datetime64
) -> list[Path]:
    client = _client("cdsapi", "to fetch ERA5 from the Climate Data Store")
    if not ((Path.home() / ".cdsapirc").exists() or {"CDSAPI_URL", "CDSAPI_KEY"} <= set(os.environ)):
        remedy = "Make a free account at https://cds.climate.copernicus.eu and write your key to ~/.cdsapirc"
        raise _needs_login("the Climate Data Store", remedy)
    target = folder / f"era5_wind_{str(first)[:10]}_{str(last)[:10]}.nc"
    request = {
        "product_type": ["reanalysis"],
        "variable": ["10m_u_component_of_wind", "10m_v_component_of_wind"],
        "date": [f"{str(first)[:10]}/{str(last)[:10]}"],
        "time": [f"{hour:02d}:00" for hour in range(24)],
        "area": [lat[1], lon[0], lat[0], lon[1]],
        "data_format": "netcdf",
        "download_format": "unarchived",
    }
    client.Client().retrieve("reanalysis-era5-single-levels", request, str(target))
    return [target]


def _fetch_ncep(
    folder: Path, first: np.datetime64, last: np.datetime64, base_url: str, progress: Progress | bool
) -> list[Path]:
    years = range(int(str(first)[:4]), int(str(last)[:4]) + 1)
    names = [f"{part}.10m.gauss.{year}.nc" for year in years for part in ("uwnd", "vwnd")]
    bar = Bar() if progress is True else None
    downloader = Resuming(bar or (progress if callable(progress) else None))
    fetched = [fetch_one(name, None, folder, base_url, downloader) for name in names]
    if bar is not None:
        bar.close()
    return fetched
