"""Small files in the layouts of products, written with netCDF4: the published headers, filled with known values."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

FILL_INT16 = -32767


def write(
    path: Path, dims: dict[str, int | None], variables: dict[str, tuple[str, tuple[str, ...], Any, dict]], **attrs: Any
) -> Path:
    """Write a netCDF-4 file; values are stored raw, without packing by the library."""
    with netCDF4.Dataset(path, "w") as ds:
        ds.setncatts(attrs)
        for name, size in dims.items():
            ds.createDimension(name, size)
        for name, (dtype, axes, values, attributes) in variables.items():
            attributes = dict(attributes)
            fill = attributes.pop("_FillValue", None)
            variable = ds.createVariable(name, str if dtype == "string" else dtype, axes, fill_value=fill)
            variable.set_auto_maskandscale(False)
            variable.setncatts(attributes)
            if values is not None:
                variable[...] = np.asarray(values, dtype=object if dtype == "string" else dtype)
    return path


def oscar_v2(
    path: Path, day: int = 11307, *, name: str = "oscar_currents_final_20201216.nc", shift: float = 0.0
) -> Path:
    """OSCAR v2.0 as published (layouts/oscar_v2_final.cdl): (time, LONGITUDE, LATITUDE), Julian calendar, fill -999."""
    u = np.array([[0.1, 0.2, 0.3], [0.11, 0.21, 0.31], [0.12, 0.22, 0.32], [-999.0, 0.23, 0.33]])
    u = np.where(u == -999.0, u, u + shift)
    v = np.where(u == -999.0, u, 0.0)
    field = ("f8", ("time", "longitude", "latitude"))
    extra = {"valid_min": -3.0, "valid_max": 3.0, "depth": "15 m"}
    return write(
        path / name,
        {"latitude": 3, "longitude": 4, "time": 1},
        {
            "lat": ("f8", ("latitude",), [-56.5, -56.25, -56.0], {"units": "degrees_north"}),
            "lon": ("f8", ("longitude",), [322.0, 322.25, 322.5, 322.75], {"units": "degrees_east"}),
            "time": ("f8", ("time",), [day], {"units": "days since 1990-01-01", "calendar": "julian"}),
            "u": (*field, u[None], {"_FillValue": -999.0, "units": "m s-1", **extra}),
            "v": (*field, v[None], {"_FillValue": -999.0, "units": "m s-1"}),
            "ug": (*field, u[None], {"_FillValue": -999.0, "units": "m s-1"}),
            "vg": (*field, v[None], {"_FillValue": -999.0, "units": "m s-1"}),
        },
    )


def oscar_v1(path: Path, lon: Any = (322.3333, 322.6667, 323.0, 323.3333)) -> Path:
    """OSCAR third degree (layouts/oscar_v1_thirddeg.cdl): depth level, descending latitudes, day since 1992-10-05."""
    lon = np.asarray(lon)
    u = np.arange(2 * 3 * lon.size, dtype=float).reshape(2, 1, 3, lon.size) / 100.0
    u[0, 0, 0, 0] = np.nan
    field = ("f8", ("time", "depth", "latitude", "longitude"))
    speed = {"units": "meter/sec", "missing_value": np.nan}
    return write(
        path / "oscar_vel2020.nc",
        {"time": 2, "year": 2, "depth": 1, "latitude": 3, "longitude": lon.size},
        {
            "time": (
                "i4",
                ("time",),
                [10288, 10293],
                {"units": "day since 1992-10-05 00:00:00", "long_name": "Day since 1992-10-05 00:00:00"},
            ),
            "year": ("f4", ("year",), [2020.93, 2020.95], {"units": "time in years"}),
            "depth": ("f4", ("depth",), [15.0], {"units": "meter"}),
            "latitude": ("f8", ("latitude",), [-55.6667, -56.0, -56.3333], {"units": "degrees-north"}),
            "longitude": ("f8", ("longitude",), lon, {"units": "degrees-east"}),
            "u": (*field, u, speed),
            "v": (*field, -u, speed),
            "um": (*field, u, {"units": "meter/sec"}),
            "vm": (*field, -u, {"units": "meter/sec"}),
        },
    )


def era5_new(path: Path) -> Path:
    """ERA5 of the new Climate Data Store (layouts/era5_cds_new.cdl): valid_time, number, text expver, float32."""
    u = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    u[1, 2, 3] = np.nan
    field = ("f4", ("valid_time", "latitude", "longitude"))
    speed = {"_FillValue": np.float32(np.nan), "units": "m s**-1", "standard_name": "unknown"}
    return write(
        path / "data_stream-oper_stepType-instant.nc",
        {"valid_time": 2, "latitude": 3, "longitude": 4},
        {
            "number": ("i8", (), 0, {"standard_name": "realization"}),
            "valid_time": (
                "i8",
                ("valid_time",),
                [1608076800, 1608080400],
                {"standard_name": "time", "units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"},
            ),
            "latitude": (
                "f8",
                ("latitude",),
                [-56.0, -56.25, -56.5],
                {"units": "degrees_north", "standard_name": "latitude", "stored_direction": "decreasing"},
            ),
            "longitude": (
                "f8",
                ("longitude",),
                [-38.0, -37.75, -37.5, -37.25],
                {"units": "degrees_east", "standard_name": "longitude"},
            ),
            "expver": ("string", ("valid_time",), ["0001", "0001"], {}),
            "u10": (*field, u, {**speed, "coordinates": "number valid_time latitude longitude expver"}),
            "v10": (*field, -u, speed),
        },
    )


def ncep_r1(path: Path, component: str = "uwnd", start: float = 1936512.0) -> Path:
    """NCEP/NCAR R1 10 m wind (layouts/ncep_r1_uwnd10m.cdl): Gaussian descending latitudes, longitudes 0..358."""
    values = np.arange(24, dtype=np.float32).reshape(2, 3, 4) * (1.0 if component == "uwnd" else -1.0)
    values[0, 0, 0] = -9.96921e36
    return write(
        path / f"{component}.10m.gauss.2020.nc",
        {"lat": 3, "lon": 4, "time": None},
        {
            "lat": (
                "f4",
                ("lat",),
                [-54.2846, -56.1893, -58.0940],
                {"units": "degrees_north", "standard_name": "latitude", "axis": "Y"},
            ),
            "lon": (
                "f4",
                ("lon",),
                [319.6875, 321.5625, 323.4375, 325.3125],
                {"units": "degrees_east", "standard_name": "longitude", "axis": "X"},
            ),
            "time": (
                "f8",
                ("time",),
                [start, start + 6],
                {
                    "units": "hours since 1800-01-01 00:00:0.0",
                    "delta_t": "0000-00-00 06:00:00",
                    "standard_name": "time",
                    "axis": "T",
                },
            ),
            component: (
                "f4",
                ("time", "lat", "lon"),
                values,
                {
                    "units": "m/s",
                    "long_name": f"4xDaily {component[0]}-wind at 10 m",
                    "missing_value": np.float32(-9.96921e36),
                },
            ),
        },
    )


def osisaf(path: Path) -> Path:
    """OSI SAF 10 km ice concentration (layouts/osisaf_ice_conc.cdl); positions by the product's own projection."""
    from pyproj import CRS, Transformer

    crs = CRS.from_user_input("+proj=stere +a=6378273 +b=6356889.44891 +lat_0=-90 +lat_ts=-70 +lon_0=0")
    x = np.array([-2205.0, -2195.0, -2185.0, -2175.0])
    y = np.array([2905.0, 2895.0, 2885.0])
    inverse = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    lon, lat = inverse.transform(*np.meshgrid(x * 1000.0, y * 1000.0))
    raw = (np.add.outer(y - 2885.0, x + 2205.0) * 100).astype(np.int16) + 1000
    raw[0, 0] = -999
    return write(
        path / "ice_conc_sh_polstere-100_multi_202012161200.nc",
        {"time": 1, "xc": 4, "yc": 3},
        {
            "time": ("f8", ("time",), [1355659200.0], {"units": "seconds since 1978-01-01 00:00:00"}),
            "xc": ("f8", ("xc",), x, {"units": "km", "standard_name": "projection_x_coordinate"}),
            "yc": ("f8", ("yc",), y, {"units": "km", "standard_name": "projection_y_coordinate"}),
            "lat": ("f4", ("yc", "xc"), lat, {"units": "degrees_north"}),
            "lon": ("f4", ("yc", "xc"), lon, {"units": "degrees_east"}),
            "ice_conc": (
                "i2",
                ("time", "yc", "xc"),
                raw[None],
                {
                    "_FillValue": np.int16(-999),
                    "units": "%",
                    "scale_factor": np.float32(0.01),
                    "standard_name": "sea_ice_area_fraction",
                    "coordinates": "lat lon",
                },
            ),
        },
    )


def header_of(cdl: str) -> tuple[dict[str, tuple[str, ...]], set[tuple[str, str]]]:
    """Return variables with their dimensions, and (variable, attribute) pairs, of a header in CDL."""
    text = re.sub(r"//[^\n]*", "", cdl)
    text = text[text.index("variables:") :].split("data:")[0]
    kinds = "int64|double|float|short|int|string|byte"
    names = re.findall(rf"\b(?:{kinds})\s+(\w+)\s*(?:\(([^)]*)\))?\s*;", text)
    variables = {name: tuple(dim.strip() for dim in dims.split(",") if dim.strip()) for name, dims in names}
    return variables, set(re.findall(r"(\w+):(\w+)\s*=", text))


def header_in(path: Path) -> tuple[dict[str, tuple[str, ...]], set[tuple[str, str]]]:
    """Return the same two of a file."""
    with netCDF4.Dataset(path) as ds:
        variables = {name: variable.dimensions for name, variable in ds.variables.items()}
        attributes = {(name, key) for name, variable in ds.variables.items() for key in variable.ncattrs()}
    return variables, attributes
