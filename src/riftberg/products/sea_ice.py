"""Thickness of sea ice: of the ice itself, or spread over the whole cell. The words of a file tell one from the other.

Models keep volume per area, and many write that as a thickness. Where half of a cell is open, its ice is twice as thick.
"""

from __future__ import annotations

import re
from typing import Final

import xarray as xr

LEAST_CONCENTRATION: Final = 0.15
"""Concentration by which a mean over a cell is divided at least: below it floes exert no force, and round-off would count."""

_OF_ICE: Final = re.compile(r"where\s+sea_?ice|over (the )?(sea )?ice\b|ice[- ]covered|actual")
"""Words for a mean over the ice of a cell."""

_OF_CELL: Final = re.compile(
    r"per (unit |grid |cell )?(cell )?area|volume|effective|equivalent|(grid[- _]?)?(cell|box)[- _](mean|average)|"
    r"(in|over|of) (the |a )?(whole |entire )?(model |grid[- _]?)?(cell|box)\b"
)
"""Words for one over the whole cell."""

_WHOLE_AREA: Final = re.compile(
    r"\barea\s*:\s*(\w+\s*:\s*)*mean\b(?!\s+where)|\barea\s*:\s*(\w+\s*:\s*)*mean\s+where\s+(sea|all)\b"
)
"""The same as CF's cell methods say it: a mean over area, or over that of the sea."""


def is_per_cell(variable: xr.DataArray | xr.Variable) -> bool:
    """Tell whether a thickness of sea ice is volume per area of the cell, by its own words; without any it is of the ice."""
    methods = str(variable.attrs.get("cell_methods", "")).lower()
    words = " ".join(str(variable.attrs.get(key, "")) for key in ("long_name", "description", "comment")).lower()
    if _OF_ICE.search(methods) or _OF_ICE.search(words):
        return False
    return bool(_WHOLE_AREA.search(methods) or _OF_CELL.search(words))


def true_ice_thickness(
    field: xr.DataArray, variable: xr.DataArray, concentration: xr.DataArray | None
) -> tuple[xr.DataArray, list[str]]:
    """Return the thickness of the ice itself, from a ``field`` of the ``variable`` of a file, and remarks on it.

    ``concentration``: of the same file, if it has any.
    """
    name = str(variable.name)
    if not is_per_cell(variable):
        return field, []
    if concentration is None or not _on_same_points(field, concentration):
        return field, [
            f"{name} is sea ice spread over the whole cell, and no concentration stands beside it: where water is open the ice "
            "is thicker"
        ]
    thicker = (field / concentration.clip(min=LEAST_CONCENTRATION)).assign_attrs(field.attrs)
    return thicker, [f"{name} is sea ice spread over the whole cell: divided by {concentration.attrs['original_name']}"]


def _on_same_points(field: xr.DataArray, other: xr.DataArray) -> bool:
    return field.dims == other.dims and all(
        field[dim].equals(other[dim]) for dim in field.dims if dim in field.coords and dim in other.coords
    )
