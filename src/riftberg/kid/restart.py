"""KID's restart files ``icebergs.res.nc``: reading into elements, and writing in the same layout.

Source: specification of files, sections 6.1, 6.2; initial values of the state: dynamics, section 1.1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import BergError
from riftberg.kid.identifiers import cell_indices, join_id, new_identifiers, split_id
from riftberg.kid.ncfile import Column, column, dimension, opened_dataset, whole_column, write_restart_file
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.state import Elements, Floats, Ints, new_elements

CONTACT_FLAG: Final = 0.1
"""Value of ``static_berg`` that marks an element of the contact iteration (quirk Q2)."""

REQUIRED: Final = {
    "lon": "lon",
    "lat": "lat",
    "uvel": "u",
    "vvel": "v",
    "mass": "mass",
    "thickness": "thickness",
    "width": "width",
    "length": "length",
}
"""Variables that a restart must have, and the fields of `Elements` they fill."""

OPTIONAL: Final = {
    "axn": "ax",
    "ayn": "ay",
    "bxn": "bx",
    "byn": "by",
    "axn_fast": "ax_fast",
    "ayn_fast": "ay_fast",
    "bxn_fast": "bx_fast",
    "byn_fast": "by_fast",
    "ang_vel": "spin",
    "ang_accel": "spin_rate",
    "rot": "rotation",
}
"""Variables that are 0 where a restart lacks them, and the fields of `Elements` they fill."""

_POSITIVE: Final = ("mass", "thickness", "width", "length")


class Origin(NamedTuple):
    """What KID records about the origin of elements and the dynamics do not use; arrays over elements.

    Attributes
    ----------
    start_lon, start_lat : ndarray
        Place of calving, degrees or m.
    start_year : ndarray of int
        Year of calving.
    start_day : ndarray
        Day of that year, d.
    start_mass : ndarray
        Mass at calving, kg.
    mass_scaling : ndarray
        Number of bergs that an element stands for.
    mass_of_bits : ndarray
        Mass of bergy bits, kg.
    heat_density : ndarray
        Heat density, J kg-1.
    """

    start_lon: Floats
    start_lat: Floats
    start_year: Ints
    start_day: Floats
    start_mass: Floats
    mass_scaling: Floats
    mass_of_bits: Floats
    heat_density: Floats


def read_restart(path: Path, grid: Grid) -> tuple[Elements, Origin]:
    """Read a KID restart file.

    Cells are found from the positions; the file's ``ine`` and ``jne`` (often never assigned) are not used. Without
    ``id_cnt`` and ``id_ij``, or with the old ``iceberg_num``, identifiers are made anew in the order of the file.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    grid : Grid
        Grid on which the elements lie.

    Returns
    -------
    Elements
        With ``u_pair = u_sync = u``, ``lon_pair = lon``, cells and identifiers; environment not yet filled.
    Origin
        What else the file says.

    Raises
    ------
    InputError
        If the file or a variable is missing, cut short or of a wrong size.
    BergError
        If an element is impossible, outside the grid, on land, or not unique.
    """
    path = Path(path)
    with opened_dataset(path) as dataset:
        elements = _read_bergs(dataset, path)
        origin = _read_origin(dataset, path, len(elements.id))
        _refuse_footloose(dataset, path, len(elements.id))
        _check_values(elements, path)
        grid.locate(elements)
        elements.id[:] = _read_identifiers(dataset, path, elements, grid)
    _check_unique(elements, path)
    return elements, origin


def _read_bergs(dataset: netCDF4.Dataset, path: Path) -> Elements:
    size = dimension(dataset, path)
    if size == 0:
        raise BergError("no element in the file", where=str(path), remedy="A run needs at least one")
    elements = new_elements(size)
    for name, field in REQUIRED.items():
        getattr(elements, field)[:] = column(dataset, path, name, size)
    for name, field in OPTIONAL.items():
        getattr(elements, field)[:] = column(dataset, path, name, size, default=0.0)
    for field in ("u", "v"):
        for copy in (f"{field}_sync", f"{field}_pair"):
            getattr(elements, copy)[:] = getattr(elements, field)
    elements.lon_pair[:], elements.lat_pair[:] = elements.lon, elements.lat
    static = column(dataset, path, "static_berg", size, default=0.0)
    elements.static[:] = static >= 0.5
    elements.in_contact[:] = static == CONTACT_FLAG
    return elements


def _read_origin(dataset: netCDF4.Dataset, path: Path, size: int) -> Origin:
    def read(name: str, default: float | None = None) -> Floats:
        return column(dataset, path, name, size, default)

    return Origin(
        start_lon=read("start_lon"),
        start_lat=read("start_lat"),
        start_year=whole_column(dataset, path, "start_year", size),
        start_day=read("start_day"),
        start_mass=read("start_mass"),
        mass_scaling=read("mass_scaling"),
        mass_of_bits=read("mass_of_bits", 0.0),
        heat_density=read("heat_density", 0.0),
    )


def _read_identifiers(dataset: netCDF4.Dataset, path: Path, elements: Elements, grid: Grid) -> Ints:
    if "iceberg_num" in dataset.variables:
        return new_identifiers(elements, grid)
    size = len(elements.id)
    return join_id(whole_column(dataset, path, "id_cnt", size), whole_column(dataset, path, "id_ij", size))


def _refuse_footloose(dataset: netCDF4.Dataset, path: Path, size: int) -> None:
    for name in ("fl_k", "mass_of_fl_bits"):
        values = column(dataset, path, name, size, default=0.0)
        wrong = values < 0 if name == "fl_k" else values > 0
        if wrong.any():
            k = int(np.argmax(wrong))
            raise BergError(
                f"{name} = {values[k]} of record {k + 1} comes from footloose calving, which KID runs here do not have",
                where=f"{path}, variable {name}",
                remedy="Remove the children of footloose calving from the file",
            )


def _check_values(elements: Elements, path: Path) -> None:
    for name, field in {**REQUIRED, **OPTIONAL}.items():
        values = getattr(elements, field)
        good = np.isfinite(values)
        demand = "a finite number"
        if name in _POSITIVE:
            good, demand = good & (values > 0), "a positive number"
        if not good.all():
            k = int(np.argmin(good))
            raise BergError(
                f"{name} = {values[k]} of record {k + 1} is not {demand}",
                where=f"{path}, variable {name}",
                remedy="Correct the record, or remove that element",
            )


def _check_unique(elements: Elements, path: Path) -> None:
    unique, counts = np.unique(elements.id, return_counts=True)
    if (counts > 1).any():
        cnt, ij = split_id(unique[counts > 1][:1])
        raise BergError(
            f"identifier id_cnt = {cnt[0]}, id_ij = {ij[0]} stands {counts.max()} times",
            where=str(path),
            remedy="Identifiers must be unique",
        )


def _columns(elements: Elements, origin: Origin, grid: Grid) -> dict[str, NDArray[Any]]:
    """Return all variables by KID's names."""
    columns: dict[str, NDArray[Any]] = {name: getattr(elements, f) for name, f in {**REQUIRED, **OPTIONAL}.items()}
    columns.update(origin._asdict())
    columns["ine"], columns["jne"] = cell_indices(elements, grid)
    columns["id_cnt"], columns["id_ij"] = split_id(elements.id)
    columns["static_berg"] = np.where(
        elements.static >= 0.5, 1.0, np.where(elements.in_contact != 0, CONTACT_FLAG, 0.0)
    )
    return columns


_BASE: Final = (
    Column("lon", "f8", "longitude", "degrees_E"),
    Column("lat", "f8", "latitude", "degrees_N"),
    Column("uvel", "f8", "zonal velocity", "m/s"),
    Column("vvel", "f8", "meridional velocity", "m/s"),
    Column("mass", "f8", "mass", "kg"),
)
_VERLET: Final = (
    Column("axn", "f8", "explicit zonal acceleration", "m/s^2"),
    Column("ayn", "f8", "explicit meridional acceleration", "m/s^2"),
    Column("bxn", "f8", "implicit zonal acceleration", "m/s^2"),
    Column("byn", "f8", "implicit meridional acceleration", "m/s^2"),
)
_BERG: Final = (
    Column("ine", "i4", "i index", "none"),
    Column("jne", "i4", "j index", "none"),
    Column("thickness", "f8", "thickness", "m"),
    Column("width", "f8", "width", "m"),
    Column("length", "f8", "length", "m"),
    Column("start_lon", "f8", "longitude of calving location", "degrees_E"),
    Column("start_lat", "f8", "latitude of calving location", "degrees_N"),
    Column("start_year", "i4", "calendar year of calving event", "years"),
    Column("id_cnt", "i4", "counter component of iceberg id", "dimensionless"),
    Column("id_ij", "i4", "position component of iceberg id", "dimensionless"),
    Column("start_day", "f8", "year day of calving event", "days"),
    Column("start_mass", "f8", "initial mass of calving berg", "kg"),
    Column("mass_scaling", "f8", "scaling factor for mass of calving berg", "none"),
    Column("mass_of_bits", "f8", "mass of bergy bits", "kg"),
    Column("heat_density", "f8", "heat density", "J/kg"),
)
_FAST: Final = (
    Column("axn_fast", "f8", "sub-step explicit zonal acceleration", "m/s^2"),
    Column("ayn_fast", "f8", "sub-step explicit meridional acceleration", "m/s^2"),
    Column("bxn_fast", "f8", "sub-step implicit zonal acceleration", "m/s^2"),
    Column("byn_fast", "f8", "sub-step implicit meridional acceleration", "m/s^2"),
)
_SPIN: Final = (
    Column("ang_vel", "f8", "dem angular velocity", "rad/s"),
    Column("ang_accel", "f8", "dem angular acceleration", "rad/s^2"),
    Column("rot", "f8", "dem accumulated rotation", "rad"),
)
_STATIC: Final = (Column("static_berg", "f8", "static_berg", "dimensionless"),)


def write_restart(path: Path, elements: Elements, origin: Origin, grid: Grid, parameters: Parameters) -> None:
    """Write a restart file in KID's layout.

    Accelerations are written for Verlet stepping, fast ones for multiple time steps, rotation for DEM bonds, and
    ``static_berg`` only where an element is static, as KID does (marks of the contact iteration alone do not count:
    the reference's restarts lack them).
    """
    values = _columns(elements, origin, grid)
    scheme = parameters.stepping.scheme
    layout = [*_BASE]
    layout += _VERLET if scheme != "runge_kutta" else ()
    layout += _BERG
    layout += _FAST if scheme == "mts" else ()
    layout += _SPIN if parameters.bonds.law == "dem" else ()
    layout += _STATIC if (elements.static >= 0.5).any() else ()
    write_restart_file(Path(path), [(c, values[c.name]) for c in layout], len(elements.id), counter=True)
