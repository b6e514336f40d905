"""Thickness of sea ice: of the ice itself, or spread over the whole cell. The words of a file tell one from the other.

Models keep volume per area, and many write that as a thickness. Where half of a cell is open, its ice is twice as thick.
"""

from __future__ import annotations

import re
from collections.abc import MutableMapping
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
    """Tell whether a thickness of sea ice is volume per area of the cell, by its own words; without any it is that of the ice."""
    methods = str(variable.attrs.get("cell_methods", "")).lower()
    words = " ".join(str(variable.attrs.get(key, "")) for key in ("long_name", "description", "comment")).lower()
    if _OF_ICE.search(methods) or _OF_ICE.search(words):
        return False
    return bool(_WHOLE_AREA.search(methods) or _OF_CELL.search(words))


def thickness_of_ice(ds: xr.Dataset, fields: MutableMapping[str, xr.DataArray]) -> list[str]:
    """Turn a thickness over the whole cell into that of the ice, where the fields have the concentration; return remarks."""
    if "ice_thickness" not in fields:
        return []
    field = fields["ice_thickness"]
    name = str(field.attrs["original_name"])
    if not is_per_cell(ds[name]):
        return []
    if "ice_fraction" not in fields:
        return [
            f"{name} is sea ice spread over the whole cell, and no concentration stands beside it: where water is open the ice "
            "is thicker"
        ]
    concentration = fields["ice_fraction"]
    fields["ice_thickness"] = (field / concentration.clip(min=LEAST_CONCENTRATION)).assign_attrs(field.attrs)
    return [f"{name} is sea ice spread over the whole cell: divided by {concentration.attrs['original_name']}"]
