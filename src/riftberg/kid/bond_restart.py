"""KID's bond restart ``bonds_iceberg.res.nc``: directed bonds, each physical bond twice.

Source: files 6.3 (as intended by KID's older file layer; quirk T33 of the newer one).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, count_bonds, separations
from riftberg.errors import BergError, InputError
from riftberg.kid.identifiers import cell_indices, join_id, split_id
from riftberg.kid.ncfile import Column, column, dimension, opened_dataset, whole_column, write_restart_file
from riftberg.ocean.grid import Grid
from riftberg.state import Bonds, Elements, Ints, new_bonds

GONE: Final = 2
"""Status of a bond that is no longer listed."""

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
        _refuse_obsolete(dataset, path)
        size = dimension(dataset, path)
        first = _rows(dataset, path, elements, "first", size)
        second = _rows(dataset, path, elements, "other", size)
        keep = _check_mirrors(first, second, elements, path)
        bonds = new_bonds(first[keep], second[keep])
        for name, field in DEM_FIELDS.items():
            getattr(bonds, field)[:] = column(dataset, path, name, size, default=0.0)[keep]
        status = whole_column(dataset, path, "broken", size, default=0)
        _check_status(status, first, second, path)
        bonds.status[:] = status[keep]
    bonds.break_time[bonds.status != 0] = 0.0
    a, b = bonds.first, bonds.second
    dx, dy = separations(metric, elements.lon[a], elements.lat[a], elements.lon[b], elements.lat[b])
    bonds.bond_length[:] = np.sqrt(dx * dx + dy * dy)
    _check_lengths(bonds, elements, path)
    count_bonds(elements, bonds)
    return bonds


LONGEST: Final = 10.0
"""Length of a bond, in sides of its elements, beyond which the file is of another moment or another berg."""


def _check_lengths(bonds: Bonds, elements: Elements, path: Path) -> None:
    """Refuse bonds between elements that lie far apart."""
    side = np.maximum(elements.length, elements.width)
    far = bonds.bond_length > LONGEST * 0.5 * (side[bonds.first] + side[bonds.second])
    if far.any():
        k = int(np.argmax(far))
        one, other = (split_id(elements.id[rows[k : k + 1]]) for rows in (bonds.first, bonds.second))
        raise BergError(
            f"a bond of {bonds.bond_length[k]:g} m, from element id_cnt = {one[0][0]}, id_ij = {one[1][0]} to "
            f"id_cnt = {other[0][0]}, id_ij = {other[1][0]}",
            where=str(path),
            remedy="Both restart files must be of the same moment",
        )


def _refuse_obsolete(dataset: netCDF4.Dataset, path: Path) -> None:
    if "first_berg_num" in dataset.variables:
        raise InputError(
            "the obsolete layout with first_berg_num",
            where=str(path),
            remedy="KID cannot read it either; set manually_initialize_bonds = .true.",
        )


def _rows(dataset: netCDF4.Dataset, path: Path, elements: Elements, end: str, size: int) -> Ints:
    """Return rows of the elements at one end of the bonds."""
    counters = whole_column(dataset, path, f"{end}_id_cnt", size)
    cells = whole_column(dataset, path, f"{end}_id_ij", size)
    ids = join_id(counters, cells)
    order = np.argsort(elements.id)
    place = np.clip(np.searchsorted(elements.id[order], ids), 0, len(order) - 1)
    rows: Ints = order[place]
    lost = elements.id[rows] != ids
    if lost.any():
        k = int(np.argmax(lost))
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
    _, places, counts = np.unique(forward, return_index=True, return_counts=True)
    faults = (
        ("joins an element to itself", first == second),
        ("is given twice", np.isin(np.arange(len(forward)), places[counts > 1])),
        ("lacks its mirror, the same bond in the other direction", ~np.isin(backward, forward)),
    )
    for what, wrong in faults:
        if wrong.any():
            k = int(np.argmax(wrong))
            one, other = (split_id(elements.id[rows[k : k + 1]]) for rows in (first, second))
            raise BergError(
                f"bond {k + 1}, from element id_cnt = {one[0][0]}, id_ij = {one[1][0]} to id_cnt = {other[0][0]}, "
                f"id_ij = {other[1][0]}, {what}",
                where=str(path),
                remedy="The file must hold each bond once in each direction",
            )
    keep = np.flatnonzero(first < second)
    return keep[np.lexsort((second[keep], first[keep]))]


def _check_status(status: Ints, first: Ints, second: Ints, path: Path) -> None:
    """Refuse a mark of breaking that means nothing, or differs between the two directions of a bond."""
    bad = ~np.isin(status, (0, 1))
    if not bad.any():
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
    both = directed(bonds, dem)
    ine, jne = cell_indices(elements, grid)
    counter, cell = split_id(elements.id)
    columns: list[tuple[Column, NDArray[Any]]] = []
    for end, word in _ENDS:
        rows = both[end]
        for axis, values in (("ine", ine), ("jne", jne)):
            item = Column(f"{end}_berg_{axis}", "i4", f"iceberg {axis} of {word} berg in bond", "dimensionless")
            columns.append((item, values[rows]))
        for part, name, values in (("counter", "id_cnt", counter), ("position", "id_ij", cell)):
            text = f"{part} component of iceberg id {word} berg in bond"
            columns.append((Column(f"{end}_{name}", "i4", text, "dimensionless"), values[rows]))
    columns += [(item, both[item.name]) for item in DEM_COLUMNS if dem]
    write_restart_file(Path(path), columns, len(both["first"]), counter=False)
