"""The order in which the reference goes through its elements: a sorted list in each cell of the grid (equations 1.6)."""

from __future__ import annotations

import numpy as np

from riftberg.state import Elements, Ints


def listed(el: Elements, cell_i: Ints | None = None, cell_j: Ints | None = None) -> Ints:
    """Return the rows of all elements in the order of the reference's lists.

    Row by row and column by column of the grid; in a cell by date, mass and place of origin, and of equals the one that came
    into the cell last goes first.
    """
    place, life = el.place, el.life
    columns, rows = (place.cell_i, place.cell_j) if cell_i is None or cell_j is None else (cell_i, cell_j)
    keys = life.start_lat, life.start_lon, life.start_mass, life.start_day, life.start_year, columns, rows
    return np.asarray(np.lexsort((-np.arange(el.size), -place.entered, *keys)), np.int64)


def enter_cells(el: Elements, cell_i: Ints, cell_j: Ints) -> None:
    """Note which elements have come into another cell since they stood in the cells (``cell_i``, ``cell_j``)."""
    place = el.place
    moved = (place.cell_i != cell_i) | (place.cell_j != cell_j)
    if not moved.any():
        return
    old, new = np.lexsort((np.arange(el.size), place.entered)), listed(el, cell_i, cell_j)
    place.entered[np.concatenate([old[~moved[old]], new[moved[new]]])] = np.arange(el.size)
