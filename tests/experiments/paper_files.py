"""Stand-ins for the hourly files of the A68a publication, in their layout.

The published files are double-precision classic files (64-bit offset), dimensions (time, lat, lon) with unlimited time,
744 hours of currents and sea level and 739 of wind on 152 x 232 points, the hours, positions, and, beside the sea level,
``ssh_bgrid`` and the positions of the cell centres. That follows from their sizes (419,792,376, 419,795,392 and
416,971,208 bytes: two fields of 744 or 739 hours, 9 kB of coordinates, 3 kB more of coordinates beside the sea level, and
a header) and from the monthly files beside them.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

GRID_FILE = "a68_experiment_ll_p125_grid.nc"
WIND_FILE = "a68_experiment_wind_vel_ncep_10m_dec2020_HOURLY_ll_p125.nc"
OCEAN_FILE = "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc"
SEA_LEVEL_FILE = "a68_experiment_ssh_duacs_dec2020_HOURLY_ll_p125.nc"
"""Names of the published files."""

VARIABLES = {WIND_FILE: ("ua", "va"), OCEAN_FILE: ("uo", "vo"), SEA_LEVEL_FILE: ("SSH",)}
"""What is read of them."""

HOURS = {WIND_FILE: 739, OCEAN_FILE: 744, SEA_LEVEL_FILE: 744}
"""Records of the published files."""

SIZES = {WIND_FILE: 416_971_208, OCEAN_FILE: 419_792_376, SEA_LEVEL_FILE: 419_795_392}
"""Bytes of the published files."""

OFFSET = 0.0625
"""What the positions ``lon``, ``lat`` of the monthly files are more than those of the grid file, degrees."""

Field = NDArray[Any]


def write_hours(
    path: Path, fields: Mapping[str, Mapping[int, Field]], lon: Field, lat: Field, hours: int, **changes: Any
) -> None:
    """Write an hourly file.

    Parameters
    ----------
    path : Path
        One of the published names.
    fields : mapping
        Values by variable and record (from 0); records not given are holes in the file, which read as 0.
    lon, lat : array
        Axes of the grid file.
    hours : int
        Number of records.
    changes : dict
        ``shift`` moves the positions (degrees), for files that lie elsewhere.
    """
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as out:
        out.set_fill_off()
        for name, size in (("time", None), ("lat", lat.size), ("lon", lon.size)):
            out.createDimension(name, size)
        axes = {"lon": (lon + OFFSET, "lon"), "lat": (lat + OFFSET, "lat")}
        if path.name == SEA_LEVEL_FILE:
            axes |= {"actual_lon": (lon, "lon"), "actual_lat": (lat, "lat")}
        for name, (values, dimension) in axes.items():
            out.createVariable(name, "f8", (dimension,))[:] = values + changes.get("shift", 0.0)
        stamps = out.createVariable("time", "f8", ("time",))
        names = [*fields, "ssh_bgrid"] if path.name == SEA_LEVEL_FILE else list(fields)
        variables = {name: out.createVariable(name, "f8", ("time", "lat", "lon")) for name in names}
        stamps.units = "hours since 2020-12-01 00:00:00"
        stamps[:] = np.arange(hours, dtype=np.float64)
        for name, variable in variables.items():
            for number, values in fields.get(name, fields.get("SSH", {})).items():
                variable[number] = values


def unpacked_hours(case: Path, file: str, records: Sequence[int], box: Any) -> dict[str, dict[int, Field]]:
    """Return records of a reference case in double precision; a single record stands for every hour."""
    found: dict[str, dict[int, Field]] = {}
    with netCDF4.Dataset(case / "data" / file) as dataset:
        dataset.set_auto_maskandscale(False)
        for name in VARIABLES[file]:
            variable = dataset[name]
            scale = np.float64(getattr(variable, "scale_factor", 1.0))
            raw = variable[:]
            found[name] = {k: raw[k if len(raw) > 1 else 0][box] * scale for k in records}
    return found


def stand_ins(case: Path, folder: Path, days: float, box: Any = np.s_[:, :]) -> Path:
    """Make a folder of the paper's files from a reference case: its grid, berg and hours for so many days.

    ``box`` cuts rows and columns out of the grid.
    """
    folder.mkdir(parents=True)
    shutil.copy(case / "INPUT" / "icebergs.res.nc", folder)
    with netCDF4.Dataset(case / "data" / GRID_FILE) as grid:
        lon, lat = np.array(grid["longitude"][:][box]), np.array(grid["latitude"][:][box])
    with netCDF4.Dataset(folder / GRID_FILE, "w", format="NETCDF3_64BIT_OFFSET") as out:
        for name, size in zip(("lat", "lon"), lon.shape, strict=True):
            out.createDimension(name, size)
        for name, values in (("longitude", lon), ("latitude", lat)):
            out.createVariable(name, "f8", ("lat", "lon"))[:] = values
    records = range(205, 206 + int(np.ceil(24 * days)))
    for file, hours in HOURS.items():
        write_hours(folder / file, unpacked_hours(case, file, records, box), lon[0], lat[:, 0], hours)
    return folder
