"""Fetching of original products from the services that hold them, over a box and some days.

The services' own clients are used where they are installed and logged in: earthaccess for OSCAR, copernicusmarine for
GLORYS12 and DUACS, cdsapi for ERA5. NCEP/NCAR R1 wind comes from NOAA PSL and GEBCO's sea floor from an ERDDAP by plain
HTTPS, without either.
"""

from __future__ import annotations

import base64
import configparser
import netrc
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypedDict, Unpack

import numpy as np

from riftberg.errors import ForcingError, line_of_fault
from riftberg.fetching.download import (
    Progress,
    Resuming,
    Tell,
    fetch_one,
    made,
    missing_package,
    show_progress,
    tell_terminal,
    unpacked,
)
from riftberg.products.mesh import utc
from riftberg.system.atomic_files import only_writer, replacing
from riftberg.system.netcdf_lock import open_netcdf

Service = Literal["oscar", "glorys", "duacs", "era5", "ncep-r1", "gebco"]
Span = tuple[float, float]

FIELDS: dict[str, dict[str, tuple[str, ...]]] = {
    "oscar": {"currents": ("u", "v")},
    "glorys": {"currents": ("uo", "vo"), "ssh": ("zos",), "ice": ("siconc", "sithick", "usi", "vsi")},
    "duacs": {"ssh": ("adt",), "currents": ("ugos", "vgos")},
    "era5": {
        "wind": ("10m_u_component_of_wind", "10m_v_component_of_wind"),
        "waves": (
            "significant_height_of_combined_wind_waves_and_swell", "mean_wave_period", "mean_wave_direction",
        ),
        "ice": ("sea_ice_cover",),
    },
    "ncep-r1": {"wind": ("uwnd", "vwnd")},
    "gebco": {"depth": ("elevation",)},
}  # fmt: skip
"""Fields that each service gives here, and the service's names of their variables."""

DEFAULT_FIELDS = {"glorys": ("currents", "ssh"), "duacs": ("ssh",), "era5": ("wind",)}
"""Fields that are fetched if none are named, where a service gives several: those that every run needs."""

EXTRAS = {"earthaccess": "oscar", "copernicusmarine": "copernicus", "cdsapi": "era5"}
"""Optional extra of Riftberg that brings the client of a service."""

_DATASETS = {
    "glorys": "cmems_mod_glo_phy_my_0.083deg_P1D-m",
    "duacs": "cmems_obs-sl_glo_phy-ssh_my_allsat-l4-duacs-0.125deg_P1D",
}


class Addresses(TypedDict, total=False):
    """Addresses of files that are fetched without a client."""

    ncep_url: str
    gebco_url: str


class Request(NamedTuple):
    """Request to a service."""

    name: str
    folder: Path
    lon: Span
    lat: Span
    first: np.datetime64
    last: np.datetime64
    fields: tuple[str, ...]
    depth: float

    @property
    def days(self) -> tuple[str, str]:
        """First and last day, as text: whole days are asked for, whatever the hours, since files are known by their days."""
        return str(self.first)[:10], str(self.last)[:10]

    def file(self, *fields: str) -> Path:
        """Return the file for some fields; its name holds all that was asked for, so that it can be known again."""
        levels = (f"{self.depth:g}m",) if self.name == "glorys" else ()
        box = (f"{end:g}" for end in (*self.lon, *self.lat))
        return self.folder / f"{'_'.join((self.name, *fields, *levels, *box, *self.days))}.nc"


def fetch_product(
    name: Service,
    folder: str | Path,
    lon: Span,
    lat: Span,
    time: tuple[Any, Any] | None = None,
    *,
    fields: Sequence[str] = (),
    depth: float = 250.0,
    progress: Progress | bool = True,
    tell: Tell = tell_terminal,
    **addresses: Unpack[Addresses],
) -> list[Path]:
    """Fetch an original product from the service that holds it.

    ``lon``, ``lat``: box (degrees, -180..180); ``depth``: deepest level wanted (m), where the product has levels.
    """
    if name not in FIELDS:
        raise ForcingError(
            f"there is no service for {name!r}", where="fetch", remedy=f"Choose one of: {', '.join(FIELDS)}"
        )
    chosen = _fields(name, fields)
    folder = made(Path(folder))
    if name == "gebco":
        return fetch_gebco(
            folder, lon, lat, progress=progress, tell=tell, base_url=addresses.get("gebco_url", GEBCO_URL)
        )
    if time is None:
        raise ForcingError("days are needed", where=f"fetch {name}", remedy="Give the first and the last")
    request = Request(name, folder, lon, lat, utc(time[0]), utc(time[1]), chosen, depth)
    if name == "ncep-r1":
        years = range(int(request.days[0][:4]), int(request.days[1][:4]) + 1)
        # Fetch NCEP/NCAR R1 10 m wind of whole years; files that have changed at their source since are fetched again.
        base_url = addresses.get("ncep_url", NCEP_URL)
        names = [f"{component}.10m.gauss.{year}.nc" for year in years for component in ("uwnd", "vwnd")]
        with show_progress(progress) as show:
            downloader = Resuming(show)
            return [fetch_one(name, None, folder, base_url, downloader, renew=True, tell=tell) for name in names]
    clients = {"oscar": _fetch_oscar, "era5": _fetch_era5}
    with only_writer(request.file(*chosen)):
        return clients.get(name, _fetch_copernicus)(request)


def _fields(name: str, requested: Sequence[str]) -> tuple[str, ...]:
    """Return the fields to fetch, in the order of `FIELDS`."""
    available = FIELDS[name]
    unknown = [field for field in requested if field not in available]
    if unknown:
        raise ForcingError(
            f"{name} has no field {unknown[0]!r} here", where="fetch", remedy=f"Choose from: {', '.join(available)}"
        )
    chosen = requested or DEFAULT_FIELDS.get(name, tuple(available))
    return tuple(field for field in available if field in chosen)


def _client(package: str, purpose: str) -> Any:
    """Return the client of a service, or say that it is not installed."""
    if find_spec(package) is None:
        raise missing_package(package, EXTRAS[package], purpose)
    return import_module(package)


@contextmanager
def _asking(service: str, remedy: str) -> Iterator[None]:
    """Turn whatever a client raises into an error that names the service; each client has errors of its own."""
    try:
        yield
    except ForcingError:
        raise
    except Exception as error:
        message = " ".join(str(error).split()) or type(error).__name__
        raise ForcingError(f"{service} did not give the data ({message})", where="fetch", remedy=remedy) from error


def _fetch_oscar(request: Request) -> list[Path]:
    client = _client("earthaccess", "to fetch OSCAR from NASA PO.DAAC")
    strategy = earthdata_login()
    refused = ForcingError(
        "NASA Earthdata refused the login",
        where="fetch",
        remedy=f"Check user name and password at https://{EARTHDATA_HOST}; tokens expire after some weeks",
    )
    try:  # by the one way that has a login: "all" would end in questions at the terminal
        login = client.login(strategy=strategy, persist=False)
    except Exception as error:
        raise refused from error
    if not getattr(login, "authenticated", False):
        raise refused
    with _asking("NASA PO.DAAC", "Run again: files that are there are not fetched twice"):
        granules = client.search_data(short_name="OSCAR_L4_OC_FINAL_V2.0", temporal=request.days)
        if not granules:
            raise ForcingError(
                f"no OSCAR file for {'..'.join(request.days)}",
                where="fetch",
                remedy="Check the dates (from 1993; the final version appears more than a year later)",
            )
        return sorted(Path(path) for path in client.download(granules, local_path=str(request.folder)))


def _fetch_copernicus(request: Request) -> list[Path]:
    client = _client("copernicusmarine", "to fetch from the Copernicus Marine Service")
    check_copernicus_login()
    target = request.file(*request.fields)
    if _whole(target):
        return [target]
    variables = FIELDS[request.name]
    levels = {"minimum_depth": 0.0, "maximum_depth": request.depth} if request.name == "glorys" else {}
    with _asking("Copernicus Marine", "Check the dates and the network, or log in anew: copernicusmarine login"):
        answer = client.subset(
            dataset_id=_DATASETS[request.name],
            variables=[variable for field in request.fields for variable in variables[field]],
            minimum_longitude=request.lon[0],
            maximum_longitude=request.lon[1],
            minimum_latitude=request.lat[0],
            maximum_latitude=request.lat[1],
            start_datetime=f"{request.days[0]}T00:00:00",
            end_datetime=f"{request.days[1]}T23:59:59",
            coordinates_selection_method="outside",  # else the box, the days and the depth would not be covered
            output_filename=target.name,
            output_directory=str(request.folder),
            overwrite=True,  # what is there is not whole; else the client would number the new file
            **levels,
        )
        written = Path(getattr(answer, "file_path", target))
        if not _whole(written):  # it does not raise where a question at the terminal is given up
            raise ForcingError("Copernicus Marine gave no file", where="fetch", remedy="Run again")
    return [written]


def _fetch_era5(request: Request) -> list[Path]:
    """Fetch each field by a request of its own: waves have another grid, and mixed requests come as archives."""
    client = _client("cdsapi", "to fetch ERA5 from the Climate Data Store")
    check_climate_data_store_login()
    fetched: list[Path] = []
    for field in request.fields:
        target = request.file(field)
        if _whole(target):
            fetched.append(target)
            continue
        query = {
            "product_type": ["reanalysis"],
            "variable": list(FIELDS["era5"][field]),
            "date": "/".join(request.days),
            "time": [f"{hour:02d}:00" for hour in range(24)],
            "area": [request.lat[1], request.lon[0], request.lat[0], request.lon[1]],
            "data_format": "netcdf",
            "download_format": "unarchived",
        }
        answer = target.with_suffix(".answer")
        with _asking(
            "The Climate Data Store",
            "Check the key in ~/.cdsapirc, and accept the licence on the page of 'ERA5 hourly data on single levels'",
        ):
            client.Client().retrieve("reanalysis-era5-single-levels", query, str(answer))
        fetched += _unpacked(answer, target)
    return fetched


def _unpacked(answer: Path, target: Path) -> list[Path]:
    """Put an answer in its place; of an archive, each file that is in it."""
    with answer.open("rb") as stream:
        if stream.read(2) != b"PK":
            return [answer.replace(target)]
    contents = [content for _, content in unpacked(answer, ".nc")]
    many = len(contents) > 1
    targets = [target.with_suffix(f".{number}.nc") if many else target for number in range(len(contents))]
    for content, path in zip(contents, targets, strict=True):
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    answer.unlink()
    return targets


def _whole(path: Path) -> bool:
    """Tell whether a file is there and can be opened."""
    try:
        with open_netcdf(path):
            return True
    except (OSError, RuntimeError):
        return False


NCEP_URL = "https://downloads.psl.noaa.gov/Datasets/ncep.reanalysis/surface_gauss/"
GEBCO_URL = "https://coastwatch.pfeg.noaa.gov/erddap/griddap/"
"""ERDDAP of NOAA CoastWatch, which cuts boxes out of the GEBCO_2020 grid; GEBCO itself has no address for that."""
GEBCO_GRID = "GEBCO_2020"
_PER_DEGREE = 240  # 15 arc seconds
_LARGEST = 500e6


def fetch_gebco(
    folder: Path, lon: Span, lat: Span, *, progress: Progress | bool, tell: Tell, base_url: str = GEBCO_URL
) -> list[Path]:
    """Fetch the elevations of GEBCO_2020 over a box, at its full 15 arc seconds; a box that is there is not asked for.

    ``lon``, ``lat``: box (degrees, -180..180).
    """
    if not (-180.0 <= lon[0] < lon[1] <= 180.0 and -90.0 <= lat[0] < lat[1] <= 90.0):
        raise ForcingError(
            f"{lon[0]:g}..{lon[1]:g} east, {lat[0]:g}..{lat[1]:g} north is no box of the grid",
            where="fetch gebco",
            remedy="Give west before east within -180..180 (two boxes where the date line is crossed), south before north",
        )
    target = folder / f"gebco_2020_{lon[0]:g}_{lon[1]:g}_{lat[0]:g}_{lat[1]:g}.nc"
    if target.exists() and not _floor_fault(target, lon, lat):
        return [target]
    cells = [round((ends[1] - ends[0]) * _PER_DEGREE) + 2 for ends in (lon, lat)]
    size = 2.0 * cells[0] * cells[1]
    if size > _LARGEST:
        raise ForcingError(
            f"this box of GEBCO has {size / 1e6:,.0f} MB",
            where="fetch gebco",
            remedy=f"Ask for at most {_LARGEST / 1e6:.0f} MB, or get the whole grid from https://www.gebco.net",
        )
    tell(f"{target.name}: {cells[0]} x {cells[1]} cells, {size / 1e6:.1f} MB")
    with show_progress(progress) as show:
        Resuming(show)(base_url + gebco_query(lon, lat), target, checked=True)
    fault = _floor_fault(target, lon, lat)
    if fault:
        target.unlink()
        raise ForcingError(
            fault, where=base_url, remedy="Nothing was kept: run again, or get it from https://www.gebco.net"
        )
    return [target]


def gebco_query(lon: Span, lat: Span) -> str:
    """Return the address, relative to the ERDDAP, of the elevations in a box and one cell around it."""
    ends = []
    for low, high, limit in ((*lat, 90.0), (*lon, 180.0)):
        cell = 1.0 / _PER_DEGREE
        # Ends beyond the outermost pixel centres are refused.
        first, last = max(low - cell, -limit + 0.5 * cell), min(high + cell, limit - 0.5 * cell)
        ends.append(f"%5B({first:.6f}):1:({last:.6f})%5D")
    return f"{GEBCO_GRID}.nc?elevation{''.join(ends)}"


def _floor_fault(path: Path, lon: Span, lat: Span) -> str:
    """Return the fault of a file of elevations over a box; empty = none."""
    try:
        with open_netcdf(path) as ds:
            if "elevation" not in ds.variables:
                return "the answer holds no elevations"
            for name, ends in (("longitude", lon), ("latitude", lat)):
                axis = np.asarray(ds[name][:], dtype=float)
                slack = (
                    1.0 / _PER_DEGREE
                )  # a box that ends at the pole or the date line ends half a cell beyond the grid
                if axis.min() > ends[0] + slack or axis.max() < ends[1] - slack:
                    return f"its {name}s run from {axis.min():g} to {axis.max():g}, not over the box"
            # The library reads zeros behind the end of a classic file that was cut.
            least = sum(ds[name].size * ds[name].dtype.itemsize for name in ("elevation", "longitude", "latitude"))
            if ds.data_model.startswith("NETCDF3") and path.stat().st_size < least:
                return f"the answer was cut: {path.stat().st_size:,} of at least {least:,} bytes"
            ds["elevation"][-1, -1]
    except (OSError, RuntimeError, IndexError, ValueError):
        return "the answer is no file of NetCDF that can be read"
    return ""


# ---- logins: whether a client will find one where it looks itself, or ask at the terminal or fail late ------------------

EARTHDATA_HOST = "urs.earthdata.nasa.gov"
COPERNICUS_HOSTS = ("auth.marine.copernicus.eu", "nrt.cmems-du.eu", "my.cmems-du.eu")
"""Machines of a ``.netrc`` that copernicusmarine takes; the last two only in its older versions."""


def earthdata_login() -> Literal["environment", "netrc"]:
    """Return the way in which earthaccess will log in."""
    if _set("EARTHDATA_TOKEN") or _set("EARTHDATA_USERNAME", "EARTHDATA_PASSWORD"):
        return "environment"
    path = Path(os.environ.get("NETRC") or _home_netrc())
    if _in_netrc(path, EARTHDATA_HOST):
        return "netrc"
    raise missing_login(
        "NASA Earthdata",
        "Make a free account at https://urs.earthdata.nasa.gov, then put it in ~/.netrc "
        f"(machine {EARTHDATA_HOST}) or in EARTHDATA_USERNAME and EARTHDATA_PASSWORD, or a token in EARTHDATA_TOKEN",
    )


def check_copernicus_login() -> None:
    """Raise `ForcingError` if copernicusmarine would find no login: variables, its own file, ``.netrc``."""
    if _set("COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD"):
        return
    # The client takes the first of these files that exists, and asks at the terminal if that one holds no login.
    folder = Path(os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY") or Path.home())
    file = folder / ".copernicusmarine" / ".copernicusmarine-credentials"
    if _in_copernicus_file(file) if file.exists() else _in_netrc(_home_netrc(), *COPERNICUS_HOSTS):
        return
    raise missing_login(
        "Copernicus Marine",
        "Make a free account at https://data.marine.copernicus.eu, then run: copernicusmarine login",
    )


def check_climate_data_store_login() -> None:
    """Raise `ForcingError` if cdsapi would find no address and key in its variables and ``~/.cdsapirc`` together."""
    path = Path(os.environ.get("CDSAPI_RC") or Path.home() / ".cdsapirc")
    lines = path.read_text().splitlines() if path.is_file() else []
    keys = {name.strip() for name, colon, value in (line.partition(":") for line in lines) if colon and value.strip()}
    lacking = [name for name in ("url", "key") if name not in keys and not _set(f"CDSAPI_{name.upper()}")]
    if lacking:
        lacking_text = f"; {path} lacks {' and '.join(lacking)}" if path.is_file() else ""
        raise missing_login(
            "the Climate Data Store",
            "Make a free account at https://cds.climate.copernicus.eu and write the two lines url and key, which its page "
            "'how to api' shows, to ~/.cdsapirc",
            lacking_text,
        )


def missing_login(service: str, remedy: str, detail: str = "") -> ForcingError:
    """Return the error that says that a service wants a login and how to come by one."""
    return ForcingError(f"{service} wants a login and none was found{detail}", where="fetch", remedy=remedy)


def _set(*names: str) -> bool:
    """Tell whether all of these variables of the environment hold something."""
    return all(os.environ.get(name) for name in names)


def _home_netrc() -> Path:
    return Path.home() / ("_netrc" if os.name == "nt" else ".netrc")


def _in_netrc(path: Path, *machines: str) -> bool:
    """Tell whether a ``.netrc`` holds user name and password for one of these machines."""
    if not path.is_file():
        return False
    try:
        hosts = netrc.netrc(path).hosts
    except (netrc.NetrcParseError, UnicodeDecodeError) as error:
        remedy = "Mend that line, or give the login in variables of the environment"
        raise ForcingError(f"cannot be read{line_of_fault(error)}", where=str(path), remedy=remedy) from error
    entries = [hosts[machine] for machine in machines if machine in hosts]
    return any(user and password for user, _, password in entries)


def _in_copernicus_file(path: Path) -> bool:
    """Tell whether the file that ``copernicusmarine login`` writes (base64 of an INI file) holds both."""
    login = configparser.RawConfigParser()
    try:
        login.read_string(base64.standard_b64decode(path.read_text()).decode())
    except (OSError, ValueError, configparser.Error):
        return False
    return all(login.get("credentials", name, fallback="") for name in ("username", "password"))
