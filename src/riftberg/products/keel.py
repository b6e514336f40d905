"""Currents over the draft: the mean from the surface to the keel, for one draft or for a field of drafts.

A berg of 200 m draft moves with the water along its whole side, not with the surface. Levels of a product are taken
as layers whose limits lie half-way between levels (the first begins at the surface); within a layer the current is
constant. The mean runs over water only: in water shallower than the draft it ends at the sea floor.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.products.quantities import QUANTITIES, labelled

Floats = NDArray[np.float64]


def layer_limits(depth: Floats) -> Floats:
    """Return the limits (m) of the layers around the levels ``depth`` (m, ascending): one more than levels."""
    depth = np.asarray(depth, float)
    if depth.size == 1:
        return np.array([0.0, 2.0 * depth[0]])
    middle = 0.5 * (depth[:-1] + depth[1:])
    return np.concatenate([[0.0], middle, [2.0 * depth[-1] - middle[-1]]])


def _levelled(ds: xr.Dataset) -> list[str]:
    names = [name for name in ("uo", "vo") if name in ds.data_vars and "depth" in ds[name].dims]
    if not names:
        raise ForcingError(
            "has no currents on levels of depth",
            where=str(ds.attrs.get("source", "")),
            remedy="Use a product with depth (GLORYS12), or run with surface currents",
        )
    return names


def keel_mean(ds: xr.Dataset, draft: float | xr.DataArray) -> xr.Dataset:
    """Replace currents on levels by their mean from the surface to the draft.

    ``draft``: draft (m, positive).
    """
    names = _levelled(ds)
    limits = layer_limits(ds["depth"].values)
    _check_draft(draft, float(limits[-1]), ds)
    top = xr.DataArray(limits[:-1], dims="depth", coords={"depth": ds["depth"].values})
    thick = xr.DataArray(np.diff(limits), dims="depth", coords={"depth": ds["depth"].values})
    share = (draft - top).clip(0.0, None)
    weight = share.where(share < thick, thick)
    means = {}
    for name in names:
        water = weight.where(ds[name].notnull(), 0.0)
        total = water.sum("depth")
        mean = (ds[name].fillna(0.0) * water).sum("depth") / total.where(total > 0.0)
        means[name] = labelled(mean, QUANTITIES[name]).assign_attrs(cell_methods="depth: mean (surface to draft)")
    draft_text = f"{float(draft):g} m" if np.ndim(draft) == 0 else "a draft that varies"
    history = f"currents averaged from the surface to {draft_text}; {ds.attrs.get('history', '')}"
    return ds.drop_vars([*names, "depth"]).assign(means).assign_attrs(history=history)


def _check_draft(draft: float | xr.DataArray, deepest: float, ds: xr.Dataset) -> None:
    low, high = float(np.nanmin(draft)), float(np.nanmax(draft))
    if low <= 0.0 or high > deepest * (1.0 + 1e-9):
        raise ForcingError(
            f"drafts {low:g}..{high:g} m are outside the layers of the data, 0..{deepest:g} m",
            where=str(ds.attrs.get("source", "")),
            remedy="Fetch deeper levels, or give a draft above zero",
        )
