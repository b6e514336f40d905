"""Stand-ins for the clients of data services: the same calls, no network, small files in the layout of the product.

Their parameters are those of earthaccess 0.17, copernicusmarine 2.5 and cdsapi 0.7, by name, order and default, so that a
call which the real client would refuse fails here too.
"""

from __future__ import annotations

import os
import sys
import types
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "products"))
from products import product_files as files


class Earthaccess(types.ModuleType):
    """`earthaccess`: two days of OSCAR; ``granted`` says whether the login is taken."""

    def __init__(self, granted: bool = True, found: bool = True) -> None:
        super().__init__("earthaccess")
        self.granted, self.found = granted, found
        self.asked: dict[str, Any] = {}

    def login(self, strategy: str = "all", persist: bool = False, system: object = None) -> object:
        self.asked["strategy"] = strategy
        if strategy == "netrc" and not self.granted:
            raise RuntimeError("LoginAttemptFailure: Authentication with Earthdata Login failed")
        return types.SimpleNamespace(authenticated=self.granted)  # an instance of Auth, which is never false by itself

    def search_data(self, count: int = -1, **kwargs: Any) -> list[int]:
        self.asked |= kwargs
        return [11307, 11308] if self.found else []

    def download(
        self, granules: list[int], local_path: str | None = None, provider: str | None = None, threads: int = 8, *,
        show_progress: bool | None = None, credentials_endpoint: str | None = None, pqdm_kwargs: object = None,
        force: bool = False,
    ) -> list[Path]:  # fmt: skip
        names = {day: f"oscar_currents_final_202012{day - 11291:02d}.nc" for day in granules}
        return [files.oscar_v2(Path(str(local_path)), day, name=name) for day, name in reversed(names.items())]


class Copernicusmarine(types.ModuleType):
    """`copernicusmarine`: subsets of DUACS and GLORYS12 at the corners of what was asked."""

    def __init__(self) -> None:
        super().__init__("copernicusmarine")
        self.asked: list[dict[str, Any]] = []
        self.gives_up = False

    def subset(
        self, dataset_id: str | None = None, dataset_version: str | None = None, dataset_part: str | None = None,
        username: str | None = None, password: str | None = None, variables: list[str] | None = None,
        minimum_longitude: float | None = None, maximum_longitude: float | None = None,
        minimum_latitude: float | None = None, maximum_latitude: float | None = None,
        minimum_depth: float | None = None, maximum_depth: float | None = None, vertical_axis: str = "depth",
        start_datetime: str | None = None, end_datetime: str | None = None, minimum_x: float | None = None,
        maximum_x: float | None = None, minimum_y: float | None = None, maximum_y: float | None = None,
        coordinates_selection_method: str = "inside", output_filename: str | None = None,
        file_format: str | None = None, service: str | None = None, request_file: str | None = None,
        output_directory: str | None = None, credentials_file: str | None = None, motu_api_request: str | None = None,
        overwrite: bool = False, skip_existing: bool = False, dry_run: bool = False,
        disable_progress_bar: bool = False, staging: bool = False, netcdf_compression_level: int = 0,
        netcdf3_compatible: bool = False, chunk_size_limit: int = -1, raise_if_updating: bool = False,
        platform_ids: list[str] | None = None, polygons_file: str | None = None,
    ) -> object:  # fmt: skip
        asked = {name: value for name, value in locals().items() if name not in ("self",)}
        self.asked.append(asked)
        if self.gives_up:
            return None
        path = Path(str(output_directory)) / str(output_filename)
        if path.exists() and not overwrite:
            path = path.with_name(f"{path.stem}_(1).nc")
        axes = ((minimum_longitude, maximum_longitude), (minimum_latitude, maximum_latitude))
        days = [np.datetime64(str(moment), "s").astype(int) for moment in (start_datetime, end_datetime)]
        subset(path, axes, days, variables or [], (minimum_depth, maximum_depth))
        return types.SimpleNamespace(file_path=path, output_directory=path.parent, filename=path.name)


def subset(path: Path, axes: Any, days: list[int], names: list[str], depth: Any) -> None:
    """Write a subset as the toolbox does (float32, NaN, seconds since 1970)."""
    lon, lat = axes
    flat, levelled = ("time", "latitude", "longitude"), ("time", "depth", "latitude", "longitude")
    dims: dict[str, int | None] = {"time": 2, "latitude": 2, "longitude": 2}
    variables: dict[str, Any] = {
        "time": ("i8", ("time",), days, {"units": "seconds since 1970-01-01", "standard_name": "time"}),
        "latitude": ("f4", ("latitude",), lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "longitude": ("f4", ("longitude",), lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    if depth[1] is not None:
        dims["depth"] = 2
        variables["depth"] = ("f4", ("depth",), [0.494, depth[1]], {"units": "m", "positive": "down"})
    units = {"zos": "m", "adt": "m", "siconc": "1", "sithick": "m"}
    for name in names:
        on = levelled if depth[1] is not None and name in ("uo", "vo") else flat
        values = np.full([dims[dim] for dim in on], 0.1, dtype=np.float32)
        variables[name] = ("f4", on, values, {"_FillValue": np.float32("nan"), "units": units.get(name, "m s-1")})
    title = (
        "DT merged all satellites Global Ocean Gridded SSALTO/DUACS Sea Surface Height L4 product"
        if "adt" in names or "ugos" in names
        else "daily mean fields from Global Ocean Physics Analysis and Forecast updated Daily"
    )
    files.write(path, dims, variables, title=title, source="MERCATOR GLORYS12V1" if "uo" in names else "Altimetry")


class Cdsapi(types.ModuleType):
    """`cdsapi`: ERA5 of the new store, at the corners of what was asked; as an archive if it is told to."""

    def __init__(self, zipped: bool = False, fault: str = "") -> None:
        super().__init__("cdsapi")
        self.asked: list[dict[str, Any]] = []
        module = self

        class Client:
            def __init__(
                self, url: str | None = None, key: str | None = None, quiet: bool = False, debug: bool = False,
                verify: bool | None = None, timeout: float = 60, progress: bool = True,
            ) -> None:  # fmt: skip
                self.url = url or os.environ.get("CDSAPI_URL")

            def retrieve(self, name: str, request: dict[str, Any], target: str | None = None) -> None:
                if fault:
                    raise RuntimeError(fault)
                assert name == "reanalysis-era5-single-levels"
                module.asked.append(request)
                path = Path(str(target))
                if zipped:
                    inside = path.with_name("data_stream-oper_stepType-instant.nc")
                    era5(inside, request)
                    with zipfile.ZipFile(path, "w") as archive:
                        archive.write(inside, inside.name)
                    inside.unlink()
                else:
                    era5(path, request)

        self.Client = Client


_SHORT = {
    "10m_u_component_of_wind": ("u10", "m s**-1"),
    "10m_v_component_of_wind": ("v10", "m s**-1"),
    "significant_height_of_combined_wind_waves_and_swell": ("swh", "m"),
    "mean_wave_period": ("mwp", "s"),
    "mean_wave_direction": ("mwd", "Degree true"),
    "sea_ice_cover": ("siconc", "(0 - 1)"),
}


def era5(path: Path, request: dict[str, Any]) -> None:
    """Write what was asked for in the layout of the new Climate Data Store."""
    north, west, south, east = request["area"]
    first, last = (np.datetime64(day, "s").astype(int) for day in request["date"].split("/"))
    hours = [first, last + 3600 * (len(request["time"]) - 1)]
    field = ("f4", ("valid_time", "latitude", "longitude"))
    variables: dict[str, Any] = {
        "number": ("i8", (), 0, {"standard_name": "realization"}),
        "valid_time": ("i8", ("valid_time",), hours, {"standard_name": "time", "units": "seconds since 1970-01-01"}),
        "latitude": ("f8", ("latitude",), [north, south], {"units": "degrees_north", "standard_name": "latitude"}),
        "longitude": ("f8", ("longitude",), [west, east], {"units": "degrees_east", "standard_name": "longitude"}),
        "expver": ("string", ("valid_time",), ["0001", "0001"], {}),
    }
    for name in request["variable"]:
        short, units = _SHORT[name]
        variables[short] = (*field, np.full((2, 2, 2), 0.5), {"_FillValue": np.float32("nan"), "units": units})
    files.write(path, {"valid_time": 2, "latitude": 2, "longitude": 2}, variables, institution="ECMWF")
