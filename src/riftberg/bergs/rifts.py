"""Rifts: bonds weakened or removed before a run starts.

`riftberg.state.Bonds.strength` multiplies the fracture thresholds of a bond (1 is nominal). Rifts and scatter
(`riftberg.bergs.strength`) both multiply what is there, so they may be combined in any order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from riftberg.bergs.bonding import count_bonds
from riftberg.bergs.lattice import Booleans
from riftberg.bergs.raster import Raster, is_map, read_raster
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.state import Bonds, Elements, Ints

GONE = 2
"""Status of a bond that no longer exists (`riftberg.state`)."""


def crossed_by_lines(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool) -> Booleans:
    """Return which bonds a line crosses.

    A bond that a line only touches counts to one side of it, so that a line through element centres cuts on one side.

    ``lines``: each of shape (n, 2): longitude and latitude (m on a Cartesian grid).
    """
    lon0, lat0 = (float(a.mean()) for a in (elements.lon, elements.lat))
    squeeze = math.cos(lat0 * DEGREE) if latlon else 1.0
    x, y = (elements.lon - lon0) * squeeze, elements.lat - lat0
    ax, ay, bx, by = x[bonds.first], y[bonds.first], x[bonds.second], y[bonds.second]
    crossed = np.zeros(len(ax), dtype=bool)
    for line in lines:
        east = line[:, 0] - lon0
        px, py = (np.mod(east + 180, 360) - 180 if latlon else east) * squeeze, line[:, 1] - lat0
        for k in range(len(line) - 1):
            c, d = (px[k], py[k]), (px[k + 1], py[k + 1])
            ends_apart = _left(*c, *d, ax, ay) != _left(*c, *d, bx, by)
            crossed |= ends_apart & (_left(ax, ay, bx, by, *c) != _left(ax, ay, bx, by, *d))
    return crossed


def _left(ax: Any, ay: Any, bx: Any, by: Any, px: Any, py: Any) -> Any:
    """Whether P lies on or left of the directed line from A to B."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) >= 0.0


def crossed_by_mask(elements: Elements, bonds: Bonds, mask: Raster, threshold: float = 0.5) -> Booleans:
    """Return which bonds run through cells of a rift mask; each bond is probed at nine points along it."""
    crossed = np.zeros(len(bonds.first), dtype=bool)
    i, j = bonds.first, bonds.second
    for part in np.linspace(0.0, 1.0, 9):
        lon = (1 - part) * elements.lon[i] + part * elements.lon[j]
        lat = (1 - part) * elements.lat[i] + part * elements.lat[j]
        crossed |= np.nan_to_num(mask.sample(lon, lat)) > threshold
    return crossed


def crossed_by(
    elements: Elements, bonds: Bonds, rift: Any, *, latlon: bool, crs: str | None = None, threshold: float = 0.5
) -> Booleans:
    """Return which unbroken bonds a rift crosses: a mask, or lines in any form that `line_strings` reads."""
    if is_map(rift):
        mask = rift if isinstance(rift, Raster) else read_raster(rift)
        crossed = crossed_by_mask(elements, bonds, mask, threshold)
    else:
        from riftberg.bergs.outline import line_strings

        crossed = crossed_by_lines(elements, bonds, line_strings(rift, crs), latlon)
    crossed &= bonds.status == 0
    if not crossed.any():
        raise BergError(
            "the rift crosses no bond",
            where="rift",
            remedy="Check that it lies on the berg, in longitude and latitude",
        )
    return crossed


def weaken(elements: Elements, bonds: Bonds, chosen: Booleans, *, strength: float, broken: bool) -> None:
    """Weaken bonds in place by a factor, or remove them: status, bonds of their ends and numbers of the pieces."""
    if not 0 <= strength <= 1:
        raise BergError(f"strength {strength}", where="rift", remedy="Give a factor from 0 to 1")
    if broken:
        bonds.status[chosen] = GONE
        number_pieces(elements, bonds)
    else:
        bonds.strength[chosen] *= strength


def number_pieces(elements: Elements, bonds: Bonds) -> None:
    """Set ``bond_count`` and ``berg`` (pieces, from 1) of the elements from their unbroken bonds."""
    count_bonds(elements, bonds)
    intact = bonds.status == 0
    elements.berg[:] = pieces(len(elements.id), bonds.first[intact], bonds.second[intact])


def pieces(size: int, first: Ints, second: Ints) -> Ints:
    """Give the connected pieces of a graph numbers from 1, in the order of their first element."""
    label = np.arange(size)
    while True:
        lowest = np.minimum(label[first], label[second])
        new = label.copy()
        np.minimum.at(new, label[first], lowest)
        np.minimum.at(new, label[second], lowest)
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    numbers: Ints = np.unique(label, return_inverse=True)[1].astype(np.int64) + 1
    return numbers
