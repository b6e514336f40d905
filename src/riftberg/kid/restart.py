"""KID's restart files of elements and bonds: identifiers, reading into the state, and writing in the same layout.

``icebergs.res.nc``: files 6.1, 6.2; initial values of the state: dynamics, section 1.1. ``bonds_iceberg.res.nc``: directed
bonds, each physical bond twice (files 6.3, as intended by KID's older file layer; quirk T33 of the newer one).
64-bit identifiers: a counter and the cell of creation (files 0.4). Restart of calving: ice in the stores of the size
classes (files 6.4), and counters of the bergs born in each cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Self

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, count_bonds, separations
from riftberg.bergs.iceberg import Iceberg
from riftberg.errors import BergError, InputError
from riftberg.kid.ncfile import (
    Column,
    checksum,
    column,
    count_records,
    opened_dataset,
    unpacked,
    whole_column,
    write_restart_file,
)
from riftberg.life.calving import Stores
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters, element_radius
from riftberg.state import Bonds, Elements, Floats, Ints, new_bonds, new_elements
from riftberg.state.population import find_rows
from riftberg.state.rules import Rule, find_breach
from riftberg.state.variables import GONE
from riftberg.system.atomic_files import replacing
from riftberg.system.input_files import MEANT, extreme_allowed
from riftberg.system.netcdf_lock import open_netcdf

_LOW = 0xFFFFFFFF


def join_id(counter: Ints, cell: Ints) -> Ints:
    """Return identifiers from their two 32-bit components."""
    return (np.asarray(counter, dtype=np.int64) << 32) | (np.asarray(cell, dtype=np.int64) & _LOW)


def split_id(identifiers: Ints) -> tuple[Ints, Ints]:
    """Return the signed 32-bit components (``id_cnt``, ``id_ij``) of identifiers."""
    ids = np.asarray(identifiers, dtype=np.int64)
    return (ids >> 32) & _LOW, (ids & _LOW).astype(np.uint32).astype(np.int32).astype(np.int64)


def id_text(identifier: int) -> str:
    """Return an identifier as KID's files write it."""
    counter, cell = split_id(np.array([identifier]))
    return f"id_cnt = {counter[0]}, id_ij = {cell[0]}"


def cell_indices(elements: Elements, grid: Grid) -> tuple[Ints, Ints]:
    """Return the cells of elements as KID counts them, from 1 (``ine``, ``jne``)."""
    halo = grid.arrays.halo
    return elements.cell_i - halo + 1, elements.cell_j - halo + 1


def new_identifiers(elements: Elements, grid: Grid, seam: bool = False) -> Ints:
    """Return identifiers for elements that have none: a count per cell, in the order of the elements."""
    ine, jne = cell_indices(elements, grid)
    if seam:
        ine, jne = np.ones_like(ine), np.where(elements.eta == 0.0, jne - 1, jne)
    cell = ine + grid.arrays.ni * (jne - 1)
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    counter = np.empty(len(cell), dtype=np.int64)
    sizes = np.diff(np.append(starts, len(cell)))
    # Elements of one cell count from 1 in the order of the file.
    counter[order] = np.arange(len(cell)) - np.repeat(starts, sizes) + 1
    return join_id(counter, cell)


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


LIFE: Final[dict[str, float | None]] = {
    "start_lon": None,
    "start_lat": None,
    "start_year": None,
    "start_day": None,
    "start_mass": None,
    "mass_scaling": None,
    "mass_of_bits": 0.0,
    "heat_density": 0.0,
    "fl_k": 0.0,
    "mass_of_fl_bits": 0.0,
    "mass_of_fl_bergy_bits": 0.0,
}
"""Variables of calving and melt, fields of `riftberg.state.Life` of the same names; None for those that a restart must have."""

CHILD_FLAGS: Final = (-1.0, -2.0)
"""Values of ``fl_k`` of children of footloose calving; any other below 0 means nothing."""


def read_restart(path: Path, grid: Grid, *, seam: bool = False) -> Elements:
    """Read a KID restart file.

    Cells are found from the positions; the file's ``ine`` and ``jne`` (often never assigned) are not used. Without
    ``id_cnt`` and ``id_ij``, or with the old ``iceberg_num``, identifiers are made anew in the order of the file.
    """
    path = Path(path)
    with opened_dataset(path) as dataset:
        elements = _read_bergs(dataset, path)
        for name, default in LIFE.items():
            array = getattr(elements.life, name)
            if array.dtype == np.int64:
                array[:] = whole_column(dataset, path, name, elements.size)
            else:
                array[:] = column(dataset, path, name, elements.size, default)
        _check_values(elements, path, grid)
        grid.locate(elements)
        if (
            "iceberg_num" in dataset.variables
        ):  # of before identifiers had two parts; KID numbers such elements anew too
            elements.id[:] = new_identifiers(elements, grid, seam)
        else:
            numbers = (whole_column(dataset, path, name, elements.size) for name in ("id_cnt", "id_ij"))
            elements.id[:] = join_id(*numbers)
    unique, counts = np.unique(elements.id, return_counts=True)
    if (counts > 1).any():
        raise BergError(
            f"identifier {id_text(unique[counts > 1][0])} stands {counts.max()} times",
            where=str(path),
            remedy="Identifiers must be unique",
        )
    return elements


def as_iceberg(elements: Elements, bonds: Bonds | None, p: Parameters, source: Path) -> Iceberg:
    """Return elements and bonds of a restart as the bergs that a model begins with."""
    none: Ints = np.zeros(0, dtype=np.int64)
    area = float(np.mean(elements.length * elements.width)) if elements.size else 1.0
    bonded = bonds is not None and p.bonds.law != "none"
    return Iceberg(
        elements=elements,
        bonds=new_bonds(none, none) if bonds is None else bonds,
        packing=p.bonds.packing,
        radius=element_radius(area, p.bonds.packing, bonded),
        report={"source": str(source)},
        latlon=p.earth.latlon,
        earth_radius=p.earth.radius,
        density=p.ice.density,
    )


def _read_bergs(dataset: netCDF4.Dataset, path: Path) -> Elements:
    size = count_records(dataset, path)
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
    # One variable holds two things: 1 a fixed element, 0.1 one of the contact iteration (quirk Q2).
    static = column(dataset, path, "static_berg", size, default=0.0)
    elements.static[:] = static >= 0.5
    elements.in_contact[:] = static == CONTACT_FLAG
    return elements


_LARGEST: Final = {"thickness": 5000.0, "length": 1e6, "width": 1e6, "uvel": 100.0, "vvel": 100.0, "ang_vel": 1.0}
"""Sizes (m) and speeds (m s-1, rad s-1) that no element has."""

FASTEST: Final = 10.0
"""Speed that most elements of a restart do not exceed, m s-1."""

DENSITIES: Final = (200.0, 1100.0)
"""Densities (kg m-3) between which mass over volume lies."""


def _at_most(most: float) -> Callable[[Any], Any]:
    """Return the test that numbers are no larger, of either sign."""
    return lambda values: ~(np.abs(values) > most)


RULES: Final = (
    *(Rule(name, lambda values: ~(values <= 0.0), "a positive number") for name in _POSITIVE),
    *(Rule(name, _at_most(most), f"a number of at most {most:g}") for name, most in _LARGEST.items()),
    Rule("mass_scaling", lambda values: values > 0.0, "a number above 0"),
    *(
        Rule(name, lambda values: ~(values < 0.0), "0 or more")
        for name in ("start_mass", "mass_of_bits", "start_day", "mass_of_fl_bits", "mass_of_fl_bergy_bits")
    ),
    Rule(
        "fl_k", lambda values: ~(values < 0.0) | np.isin(values, CHILD_FLAGS),
        "0 or more, or -1 or -2 of a child of footloose calving",
    ),
)  # fmt: skip
"""Rules for the numbers of an iceberg restart: flipped bits and slips of units leave finite ones, which are all that was read."""


def _position_rules(grid: Grid) -> list[Rule]:
    """Return the rules for positions on a grid; any number would be wrapped into a periodic domain."""
    period = grid.arrays.period
    if grid.arrays.latlon:
        return [
            Rule("lat", lambda values: ~(np.abs(values) > 90.0), "a latitude from -90 to 90"),
            Rule("lon", lambda values: ~(np.abs(values) > 720.0), "a longitude in degrees"),
        ]
    within = f"within two periods ({period:g} m) of the domain"
    return [Rule("lon", lambda values: ~(np.abs(values) > 2.0 * period), within)] if period > 0.0 else []


def _check_values(elements: Elements, path: Path, grid: Grid) -> None:
    """Refuse elements that cannot be."""
    fields, speed = {**REQUIRED, **OPTIONAL}, np.hypot(elements.u, elements.v)
    rules, hint = [*RULES, *_position_rules(grid)], ""
    if np.median(speed) > FASTEST and not extreme_allowed():  # some may be debris that contact has flung, not most
        name = "uvel" if np.median(np.abs(elements.u)) >= np.median(np.abs(elements.v)) else "vvel"
        rules.append(Rule(name, lambda _: ~(speed > FASTEST), f"a speed of ice, at most {FASTEST:g} m/s"))
        hint = f", {MEANT}"
    if breach := find_breach(rules, lambda name: getattr(elements, fields.get(name, name))):
        name = breach.rule.variable
        raise BergError(
            f"{name} = {breach.value:g} of record {breach.row + 1} is not {breach.rule.allowed}",
            where=f"{path}, variable {name}",
            remedy=f"Correct the record, or remove that element{hint if breach.rule is rules[-1] else ''}",
        )
    # A flipped bit in one of four numbers leaves it finite, but rarely a density of ice.
    density = elements.mass / (elements.thickness * elements.length * elements.width)
    wrong = (density < DENSITIES[0]) | (density > DENSITIES[1])
    if wrong.any():
        k = int(np.argmax(wrong))
        raise BergError(
            f"mass = {elements.mass[k]:g} of record {k + 1} gives {density[k]:g} kg m-3 with its thickness and sides",
            where=f"{path}, variable mass",
            remedy=f"Correct mass, thickness, length or width: ice has {DENSITIES[0]:g} to {DENSITIES[1]:g} kg m-3",
        )


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
_FOOTLOOSE: Final = (
    Column("fl_k", "f8", "footloose calving k", "m"),
    Column("mass_of_fl_bits", "f8", "mass of footloose bits", "kg"),
    Column("mass_of_fl_bergy_bits", "f8", "mass of bergy bits associated with footloose bits", "kg"),
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


def write_restart(path: Path, elements: Elements, grid: Grid, parameters: Parameters) -> None:
    """Write a restart file in KID's layout.

    Accelerations are written for Verlet stepping, foot and footloose bits with footloose calving, fast accelerations for
    multiple time steps, rotation for DEM bonds, and
    ``static_berg`` only where an element is static, as KID does (marks of the contact iteration alone do not count:
    the reference's restarts lack them).
    """
    # In the order in which the elements have come into their cells: that in which a reader puts them there again.
    e = elements.taken(np.lexsort((np.arange(elements.size), elements.place.entered)))
    values: dict[str, NDArray[Any]] = {name: getattr(e, field) for name, field in {**REQUIRED, **OPTIONAL}.items()}
    values |= {name: getattr(e.life, name) for name in LIFE}
    values["ine"], values["jne"] = cell_indices(e, grid)
    values["id_cnt"], values["id_ij"] = split_id(e.id)
    values["static_berg"] = np.where(e.static >= 0.5, 1.0, np.where(e.in_contact != 0, CONTACT_FLAG, 0.0))
    layout = [*_BASE]
    layout += _VERLET if parameters.stepping.scheme != "runge_kutta" else ()
    layout += _BERG
    layout += _FOOTLOOSE if parameters.footloose.enabled else ()
    layout += _FAST if parameters.stepping.has_substeps else ()
    layout += _SPIN if parameters.bonds.law == "dem" else ()
    layout += _STATIC if (elements.static >= 0.5).any() else ()
    write_restart_file(Path(path), [(c, values[c.name]) for c in layout], len(elements.id), counter=True)


DEM_FIELDS: Final = {
    "tangd1": "shear_x",
    "tangd2": "shear_y",
    "nstress": "normal_stress",
    "sstress": "shear_stress",
    "rel_rotation": "relative_rotation",
}
"""Variables of DEM bonds and the fields of `Bonds` they fill."""

_MIRRORED: Final = ("tangd1", "tangd2", "rel_rotation")


def read_bonds(path: Path, elements: Elements, metric: Metric) -> Bonds:
    """Read a bond restart."""
    path = Path(path)
    with opened_dataset(path) as dataset:
        if "first_berg_num" in dataset.variables:
            raise InputError(
                "the obsolete layout with first_berg_num",
                where=str(path),
                remedy="KID cannot read it either; set manually_initialize_bonds = .true.",
            )
        size = count_records(dataset, path)
        first = _rows(dataset, path, elements, "first", size)
        second = _rows(dataset, path, elements, "other", size)
        keep = _check_mirrors(first, second, elements, path)
        bonds = new_bonds(first[keep], second[keep])
        for name, field in DEM_FIELDS.items():
            getattr(bonds, field)[:] = column(dataset, path, name, size, default=0.0)[keep]
        status = whole_column(dataset, path, "broken", size, default=0)
        _check_status(status, first, second, path)
        bonds.status[:] = status[keep]
    # KID keeps no date of breaking: these broke before the run.
    bonds.break_time[bonds.status != 0] = 0.0
    a, b = bonds.first, bonds.second
    dx, dy = separations(metric, elements.lon[a], elements.lat[a], elements.lon[b], elements.lat[b])
    bonds.bond_length[:] = np.sqrt(dx * dx + dy * dy)
    # Elements of another moment have moved; their bonds would be stretched over many sides.
    side = np.maximum(elements.length, elements.width)
    far = bonds.bond_length > LONGEST * 0.5 * (side[bonds.first] + side[bonds.second])
    if far.any():
        k = int(np.argmax(far))
        start, end = (id_text(elements.id[rows[k]]) for rows in (bonds.first, bonds.second))
        raise BergError(
            f"a bond of {bonds.bond_length[k]:g} m, from element {start} to {end}",
            where=str(path),
            remedy="Both restart files must be of the same moment",
        )
    count_bonds(elements, bonds)
    return bonds


LONGEST: Final = 10.0
"""Length of a bond, in sides of its elements, beyond which the file is of another moment or another berg."""


def _rows(dataset: netCDF4.Dataset, path: Path, elements: Elements, end: str, size: int) -> Ints:
    """Return rows of the elements at one end of the bonds."""
    counters = whole_column(dataset, path, f"{end}_id_cnt", size)
    cells = whole_column(dataset, path, f"{end}_id_ij", size)
    ids = join_id(counters, cells)
    rows, found_ids = find_rows(elements.id, ids)
    if not found_ids.all():
        k = int(np.argmin(found_ids))
        raise BergError(
            f"bond {k + 1} names element id_cnt = {counters[k]}, id_ij = {cells[k]}, which the iceberg restart lacks",
            where=f"{path}, variable {end}_id_cnt",
            remedy="Both restart files must be of the same moment",
        )
    return rows


def _check_mirrors(first: Ints, second: Ints, elements: Elements, path: Path) -> Ints:
    """Return the records of the first element of each pair, after a check that both directions are there once."""
    size = len(elements.id)
    forward, backward = first * size + second, second * size + first
    _, indices, counts = np.unique(forward, return_index=True, return_counts=True)
    faults = (
        ("joins an element to itself", first == second),
        ("is given twice", np.isin(np.arange(len(forward)), indices[counts > 1])),
        ("lacks its mirror, the same bond in the other direction", ~np.isin(backward, forward)),
    )
    for fault, wrong in faults:
        if wrong.any():
            k = int(np.argmax(wrong))
            start, end = (id_text(elements.id[rows[k]]) for rows in (first, second))
            raise BergError(
                f"bond {k + 1}, from element {start} to {end}, {fault}",
                where=str(path),
                remedy="The file must hold each bond once in each direction",
            )
    # One record of each pair, in the order of its first element, as `form_bonds` would list them.
    keep = np.flatnonzero(first < second)
    return keep[np.lexsort((second[keep], first[keep]))]


def _check_status(status: Ints, first: Ints, second: Ints, path: Path) -> None:
    """Refuse a mark of breaking that means nothing, or differs between the two directions of a bond."""
    bad = ~np.isin(status, (0, 1))
    if not bad.any():
        # Sorted by (first, second) and by (second, first), a bond and its mirror stand at the same place.
        forward, backward = np.lexsort((second, first)), np.lexsort((first, second))
        differs = status[forward] != status[backward]
        bad = np.isin(np.arange(len(status)), forward[differs])
    if bad.any():
        k = int(np.argmax(bad))
        raise BergError(
            f"broken = {status[k]} of bond {k + 1} is neither 0 nor 1, or differs from that of its mirror",
            where=f"{path}, variable broken",
            remedy="Correct both records of the bond",
        )


_ENDS: Final = (("first", "first"), ("other", "second"))
DEM_COLUMNS: Final = (
    Column("tangd1", "f8", "zonal tangential displacement", "m"),
    Column("tangd2", "f8", "meridional tangential displacement", "m"),
    Column("nstress", "f8", "normal stress", "Pa"),
    Column("sstress", "f8", "shear stress", "Pa"),
    Column("rel_rotation", "f8", "relative rotation", "rad"),
    Column("broken", "i4", "broken status", "none"),
)
"""Columns of DEM bonds, in restarts and trajectories alike."""


def directed(bonds: Bonds, dem: bool) -> dict[str, NDArray[Any]]:
    """Return the listed bonds in both directions: rows ``first`` and ``other``, and DEM variables by KID's names.

    Displacements and relative rotation change sign with the direction; stresses do not.
    """
    listed = bonds.status != GONE
    a, b = bonds.first[listed], bonds.second[listed]
    columns: dict[str, NDArray[Any]] = {"first": np.concatenate([a, b]), "other": np.concatenate([b, a])}
    if dem:
        for name, field in DEM_FIELDS.items():
            values = getattr(bonds, field)[listed]
            columns[name] = np.concatenate([values, -values if name in _MIRRORED else values])
        columns["broken"] = np.tile(bonds.status[listed], 2)
    return columns


def write_bonds(path: Path, elements: Elements, bonds: Bonds, grid: Grid, *, dem: bool) -> None:
    """Write the listed bonds, unbroken or still contact pairs, as a bond restart in KID's layout."""
    ends = directed(bonds, dem)
    ine, jne = cell_indices(elements, grid)
    counter, cell = split_id(elements.id)
    columns: list[tuple[Column, NDArray[Any]]] = []
    for end, word in _ENDS:
        rows = ends[end]
        for axis, values in (("ine", ine), ("jne", jne)):
            item = Column(f"{end}_berg_{axis}", "i4", f"iceberg {axis} of {word} berg in bond", "dimensionless")
            columns.append((item, values[rows]))
        for component, name, values in (("counter", "id_cnt", counter), ("position", "id_ij", cell)):
            text = f"{component} component of iceberg id {word} berg in bond"
            columns.append((Column(f"{end}_{name}", "i4", text, "dimensionless"), values[rows]))
    columns += [(item, ends[item.name]) for item in DEM_COLUMNS if dem]
    write_restart_file(Path(path), columns, len(ends["first"]), counter=False)


RESTART: Final = "icebergs.res.nc"
"""Restart file of elements."""

CALVING_FILE: Final = "calving.res.nc"
"""Restart file of calving; it keeps the counters of the cells too."""

AXES: Final = {"xaxis_1": "X", "yaxis_1": "Y", "zaxis_1": "Z", "Time": "T"}
"""Dimensions of the file with their CF axis."""


def read_stores(path: Path, grid: Grid, classes: int) -> Stores | None:
    """Return the stores in the file; None without a file."""
    if not path.is_file():
        return None
    shape = grid.arrays.nj, grid.arrays.ni
    counter = read_counter(path, grid)
    with opened_dataset(path) as dataset:

        def read(name: str, *size: int) -> Floats:
            return _field(dataset, path, name, size)

        def maybe(name: str) -> Floats | None:
            return read(name, *shape) if name in dataset.variables else None

        heat = maybe("stored_heat")
        return Stores(
            read("stored_ice", classes, *shape), np.zeros(shape) if heat is None else heat, counter,
            maybe("rmean_calving"), maybe("rmean_calving_hflx"), begun=True,
        )  # fmt: skip


def read_counter(path: Path, grid: Grid) -> Ints:
    """Return how many bergs were born in each cell; 0 where the file does not count them."""
    shape, name = (grid.arrays.nj, grid.arrays.ni), "iceberg_counter_grd"
    with opened_dataset(path) as dataset:
        if name not in dataset.variables:
            return np.zeros(shape, np.int64)
        counter = _field(dataset, path, name, shape)
    if not ((counter >= 0.0) & (counter < 2.0**31) & (counter == np.floor(counter))).all():
        raise InputError(
            "a count below 0, or no whole number", where=f"{path}, variable {name}", remedy="Correct the file"
        )
    return counter.astype(np.int64)


DEPTH_FILE: Final = "topog.nc"
"""File of the depth of water, in the folder of restarts."""


def read_depth(path: Path, grid: Grid) -> Floats | None:
    """Return the depth of water (m) in the cells of the domain (files, 6.4); None without a file."""
    if not path.is_file():
        return None
    with opened_dataset(path) as dataset:
        return _field(dataset, path, "depth", (grid.arrays.nj, grid.arrays.ni))


def _field(dataset: netCDF4.Dataset, path: Path, name: str, size: tuple[int, ...]) -> Floats:
    """Return a field of one moment, finite, and for ice not negative."""
    values = unpacked(dataset, path, name)
    if values.size != math.prod(size) or values.shape[-len(size) :] != size:
        raise InputError(
            f"shape {values.shape}, expected {size}{', size classes first' if len(size) == 3 else ''}",
            where=f"{path}, variable {name}",
            remedy="Give the file of a run on the same grid",
        )
    values = values.reshape(size)
    bad = ~np.isfinite(values) | ((values < 0.0) if name == "stored_ice" else False)
    if bad.any():
        at = tuple(int(k[0]) for k in np.nonzero(bad))
        raise InputError(
            f"values that are negative or no numbers, the first {values[at]:g} in row {at[-2] + 1}, column {at[-1] + 1}",
            where=f"{path}, variable {name}",
            remedy="Correct the file",
        )
    return values


def write_stores(path: Path, stores: Stores) -> None:
    """Write stores in the layout of the reference."""
    classes, nj, ni = stores.ice.shape
    plane = ("Time", "yaxis_1", "xaxis_1")
    columns: list[tuple[str, str, tuple[str, ...], NDArray[Any]]] = [
        ("stored_ice", "f8", ("Time", "zaxis_1", "yaxis_1", "xaxis_1"), stores.ice),
        ("stored_heat", "f8", plane, stores.heat),
        ("iceberg_counter_grd", "i4", plane, stores.counter),
    ]
    if stores.mean_flux is not None and stores.mean_heat is not None:
        columns += [
            ("rmean_calving", "f8", plane, stores.mean_flux),
            ("rmean_calving_hflx", "f8", plane, stores.mean_heat),
        ]
    with (
        replacing(path, to_disk=True) as temporary,
        open_netcdf(temporary, "w", format="NETCDF3_64BIT_OFFSET") as dataset,
    ):
        for name, size in (("xaxis_1", ni), ("yaxis_1", nj), ("zaxis_1", classes), ("Time", None)):
            dataset.createDimension(name, size)
        for name, kind, dimensions, values in columns:
            variable = dataset.createVariable(name, kind, dimensions)
            variable.setncatts({"long_name": name.upper(), "units": "none", "checksum": checksum(values).strip()})
        for name, axis in AXES.items():
            variable = dataset.createVariable(name, "f8", (name,))
            units = "time level" if name == "Time" else "none"
            variable.setncatts({"long_name": name, "units": units, "cartesian_axis": axis})
        for name, _, _, values in columns:
            dataset.variables[name][0] = values
        for name, size in (("xaxis_1", ni), ("yaxis_1", nj), ("zaxis_1", classes), ("Time", 1)):
            dataset.variables[name][:] = np.arange(1.0, size + 1.0)


class IdentifierCounter:
    """Identifiers for elements born in a run: each cell counts its own (files 0.4).

    ``counts``: of the domain, without the halo (shape (rows, columns)).
    """

    def __init__(self, grid: Grid, counts: Ints) -> None:
        self._grid, self.counts = grid, counts

    @classmethod
    def beside(cls, restarts: Path, grid: Grid, identifiers: Ints) -> Self:
        """Return the counters of a folder of restarts, or 0 in every cell; never below the counters of existing elements."""
        g = grid.arrays
        counts = np.zeros((g.nj, g.ni), np.int64)
        path = restarts / CALVING_FILE
        if path.is_file():
            counts[:] = read_counter(path, grid)
        counter, cell = split_id(identifiers)
        inside = (cell >= 1) & (cell <= counts.size)
        # A file of counters may be older than the elements beside it; an identifier must not come twice.
        np.maximum.at(counts.ravel(), cell[inside] - 1, counter[inside])
        return cls(grid, counts)

    def take(self, cell_i: int, cell_j: int) -> int:
        """Return the next identifier of a cell, by its array column and row."""
        g = self._grid.arrays
        i, j = cell_i - g.halo, cell_j - g.halo
        self.counts[j, i] += 1
        # Cells of the reference are counted from 1, row by row.
        return int(join_id(self.counts[j : j + 1, i], np.array([i + 1 + g.ni * j]))[0])
