"""Texts in a run file: characters in rows of one length.

Texts of any length (NC_STRING) crash the HDF5 library where a file that is written again and again is opened twice.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

LENGTH = 96
"""Bytes of a text; a longer one is cut."""


def define_texts(file: netCDF4.Dataset, name: str, dimension: str) -> netCDF4.Variable[Any]:
    """Create a variable of texts along a dimension; xarray and netCDF4 read it as texts."""
    if "text" not in file.dimensions:
        file.createDimension("text", LENGTH)
    variable = file.createVariable(name, "S1", (dimension, "text"))
    variable._Encoding = "utf-8"
    return variable


def texts(values: Iterable[str]) -> NDArray[Any]:
    """Return texts as such a variable takes them."""
    cut = [value.encode()[:LENGTH].decode(errors="ignore") for value in values]
    return np.array(cut, dtype=f"U{LENGTH}")
