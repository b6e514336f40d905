"""What a file says about the numbers that it stores, where xarray does not look: packing as text, valid values, masks."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.roles import standard_name

VALID = "valid"
"""Attribute that notes which values of a field are valid by its file."""

_PACKING = ("scale_factor", "add_offset")

_SEA, _LAND = ("sea_binary_mask", "sea_area_fraction"), ("land_binary_mask", "land_area_fraction")
"""Standard names of masks: above 0 there is sea, from 1 on there is land alone."""


def with_plain_packing(raw: xr.Dataset, where: str) -> xr.Dataset:
    """Return an undecoded dataset whose scale factors and offsets are numbers, also where the file writes them as text."""
    for name, variable in raw.variables.items():
        for key in _PACKING:
            value = variable.attrs.get(key)
            if isinstance(value, np.ndarray) and value.size > 1:
                raise ForcingError(
                    f"{key} of {name} has {value.size} numbers", where=where,
                    remedy=f"Give one: ncatted -a {key},{name},o,d,NUMBER FILE",
                )  # fmt: skip
            if value is None:
                continue
            correct = f"Correct it: ncatted -a {key},{name},o,d,NUMBER FILE"
            try:
                scale = float(np.ravel(value)[0])
            except ValueError:
                raise ForcingError(
                    f"{key} of {name} is {value[:40]!r}, which is no number", where=where, remedy=correct
                ) from None
            if not np.isfinite(scale) or (scale == 0.0 and key == "scale_factor"):
                raise ForcingError(
                    f"{key} of {name} is {scale:g}, which leaves nothing of its values", where=where, remedy=correct
                )
            if isinstance(value, str):
                variable.attrs[key] = scale
    return raw


def without_land(ds: xr.Dataset, field: xr.DataArray) -> xr.DataArray:
    """Return a field of the sea without the values where a mask of its file says land, which files write as zeros."""
    for name, mask in ds.variables.items():
        if mask.ndim > 1 and set(mask.dims) <= set(field.dims) and (said := standard_name(mask)) in (*_SEA, *_LAND):
            field = field.where(ds[name] > 0 if said in _SEA else ~(ds[name] >= 1))
    return field


def within_valid_range(ds: xr.Dataset) -> xr.Dataset:
    """Return a decoded dataset without the values that its attributes ``valid_min``, ``valid_max``, ``valid_range`` rule out.

    As CF says, limits that are whole numbers beside packed whole numbers are packed too, other limits are not.
    """
    masked: dict[Any, xr.DataArray] = {}
    for name in ds.data_vars:
        limits = _limits(ds[name])
        if limits is not None:
            low, high = limits
            masked[name] = ds[name].where((ds[name] >= low) & (ds[name] <= high))
            masked[name].encoding = ds[name].encoding
            masked[name].attrs = {**ds[name].attrs, VALID: f"{low:.3g} to {high:.3g}"}
    return ds.assign(masked) if masked else ds


def _limits(field: xr.DataArray) -> tuple[float, float] | None:
    """Return the limits of valid values as decoded, a little wider for round-off; None where the file gives none."""
    if field.dtype.kind != "f":
        return None
    both = np.ravel(field.attrs.get("valid_range", ()))
    if both.size != 2:
        both = np.array([np.ravel(field.attrs.get(key, np.nan))[0] for key in ("valid_min", "valid_max")])
    if both.dtype.kind not in "iuf" or not np.isfinite(both.astype(float)).any():
        return None
    low, high = (float(limit) for limit in both)
    stored = np.dtype(field.encoding.get("dtype", field.dtype)).kind
    if stored in "iu" and _whole(field):
        ends = [
            limit * float(field.encoding.get("scale_factor", 1.0)) + float(field.encoding.get("add_offset", 0.0))
            for limit in (low, high)
        ]
        low, high = (ends[1], ends[0]) if ends[0] > ends[1] else (ends[0], ends[1])
    elif stored == "f" and "scale_factor" in field.encoding:
        return None  # whether the limits are packed is not told
    low, high = (-np.inf if np.isnan(low) else low), (np.inf if np.isnan(high) else high)
    slack = 1e-5 * max(abs(limit) for limit in (low, high) if np.isfinite(limit))
    return (low - slack, high + slack) if low < high else None


def _whole(field: xr.DataArray) -> bool:
    """Tell whether the limits of a field are whole numbers, as its packed values are."""
    given = [np.asarray(field.attrs[key]) for key in ("valid_range", "valid_min", "valid_max") if key in field.attrs]
    return all(limits.dtype.kind in "iu" for limits in given)
