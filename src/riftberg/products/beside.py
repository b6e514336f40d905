"""Grid files that lie beside output of a model: found by what they hold, never by their name alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.system.netcdf_lock import open_lazily

_SAME = ("h", "mask_rho", "mask_u", "mask_v")
"""Fields of a grid that output often repeats, by which a grid is known to be its own."""


def grid_of(
    ds: xr.Dataset, patterns: Sequence[str], wanted: Sequence[str], fits: Callable[[xr.Dataset], bool]
) -> xr.Dataset | None:
    """Return what the one grid file beside a file gives; None if there is none."""
    where = str(ds.encoding.get("source", ""))
    folder = Path(where).parent
    own = Path(str(ds.attrs.get("grd_file", ""))).name
    stated = bool(own) and (folder / own).is_file()
    files = sorted({path for pattern in patterns for path in folder.glob(pattern)} - {Path(where)})
    alike: dict[str, xr.Dataset] = {}
    proven: dict[str, xr.Dataset] = {}
    others: list[str] = []
    for path in [folder / own] if stated else files:
        try:
            # Times of a grid file matter to nobody, and those of a stray file may be none.
            with open_lazily(path, decode_times=False) as opened:
                if not set(wanted[:2]) <= set(opened.variables):
                    continue
                shared = [name for name in _SAME if _comparable(ds, opened, name)]
                if not fits(opened) or not all(_close(ds[name], opened[name]) for name in shared):
                    others.append(path.name)
                    continue
                held = opened[[name for name in wanted if name in opened.variables]].load().reset_coords()
        except Exception:  # a neighbour that cannot be read is no grid of this file
            others.append(path.name)
            continue
        (proven if shared or stated else alike)[path.name] = held
    fitting = proven or alike
    names, remedy = ", ".join(fitting or others), "Put its own grid file, and no other, into the same folder"
    if not fitting and not others:
        return None
    if not fitting:
        what = f"the grid files beside it are those of another grid, or cannot be read: {names}"
        raise ForcingError(what, where=where, remedy=remedy)
    if own and not proven:
        what = f"its positions are in its grid file {own}, which is not beside it; {names} may be that of another"
        raise ForcingError(what, where=where, remedy=remedy)
    first = next(iter(fitting.values()))
    if not all(_close(grid[name], first[name]) for grid in fitting.values() for name in wanted[:2]):
        raise ForcingError(f"{len(fitting)} different grids beside it fit: {names}", where=where, remedy=remedy)
    by = "named in the file" if stated else "of the same sea floor or mask" if proven else "of the same size"
    return first.assign_attrs(told=f"positions are those of the grid file {next(iter(fitting))}, {by}")


def _comparable(ds: xr.Dataset, grid: xr.Dataset, name: str) -> bool:
    return name in ds.variables and name in grid.variables and 0 < ds[name].ndim == grid[name].ndim


def _close(a: xr.DataArray, b: xr.DataArray) -> bool:
    return a.shape == b.shape and bool(np.allclose(a.values, b.values, rtol=1e-3, atol=1e-3, equal_nan=True))
