"""Forcing on a regular grid from files of any products that Riftberg knows."""

from __future__ import annotations

import glob
import math
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from riftberg.constants import RHO_SEAWATER
from riftberg.errors import ForcingError
from riftberg.experiments.files_levels import LevelColumns, has_levels, without_levels
from riftberg.experiments.schema import FileForcing
from riftberg.ocean.grid import CORNER_FIELDS, Fields, Grid
from riftberg.ocean.gridded import GriddedForcing
from riftberg.ocean.loading import wind_from_stress
from riftberg.ocean.over_draft import DraftCurrents
from riftberg.ocean.products.interpolate import to_grid
from riftberg.ocean.products.registry import open_all
from riftberg.ocean.products.window import window
from riftberg.state import Floats

NAMES = {"depth_below_surface": "depth"}
"""Fields whose canonical name is not that of the model."""


def forcing_from_files(
    given: FileForcing, folder: Path, start: datetime, days: float, thickness: Floats, ice_density: float
) -> GriddedForcing:
    """Return the forcing for a run.

    Parameters
    ----------
    given : FileForcing
        Files, extent and spacing of the grid, interval of the records.
    folder : pathlib.Path
        Folder of relative file names.
    start : datetime.datetime
        Start of the run (UTC).
    days : float
        Length of the run, days.
    thickness : ndarray
        Of the elements (m): how deep currents are needed.
    ice_density : float
        Density of the ice, kg m-3.

    Raises
    ------
    ForcingError
        If a pattern matches nothing, or currents are missing, or the files do not cover place and time.
    """
    moments = _moments(start, days, given.every_hours)
    datasets = [_near(ds, given, moments) for ds in open_all(_paths(given.files, folder))]
    if not any("uo" in ds for ds in datasets):
        found = sorted({str(name) for ds in datasets for name in ds.data_vars})
        raise ForcingError(
            "no ocean current (uo, vo) in these files",
            where=", ".join(given.files),
            remedy=f"They give {', '.join(found)}; add a file of currents",
        )
    drafts = thickness * ice_density / RHO_SEAWATER
    levels = [ds for ds in datasets if has_levels(ds)] if given.currents == "draft" else []
    if len(levels) > 1:
        raise ForcingError(
            "two sets of files give currents on levels",
            where="; ".join(str(ds.attrs.get("source", "")) for ds in levels),
            remedy="Name one of them in forcing.files",
        )
    flat = [without_levels(ds, surface=not levels) for ds in datasets]
    maker = _Maker(given, flat, moments)
    if levels:
        columns = LevelColumns(levels[0], maker.corners, moments, float(drafts.max()))
        columns.grid = maker.grid
        maker.over_draft = DraftCurrents(columns.limits, columns, ice_density, float(drafts.mean()))
    seconds = [(moment - start).total_seconds() for moment in moments]
    return GriddedForcing(
        maker.grid, maker, seconds, coastal_drift=given.coastal_drift, over_draft=maker.over_draft, start=start,
        source=_sources(datasets),
    )  # fmt: skip


def _paths(names: list[str], folder: Path) -> list[str]:
    found = [sorted(glob.glob(str(folder / name))) for name in names]
    for name, matches in zip(names, found, strict=True):
        if not matches:
            raise ForcingError(f"no file matches {name!r}", where=str(folder), remedy="Correct forcing.files or --data")
    return [path for matches in found for path in matches]


def _moments(start: datetime, days: float, every_hours: float) -> list[datetime]:
    count = math.ceil(24.0 * days / every_hours - 1e-9)
    return [start + timedelta(hours=every_hours * k) for k in range(count + 1)]


def _near(ds: xr.Dataset, given: FileForcing, moments: list[datetime]) -> xr.Dataset:
    time = (moments[0], moments[-1]) if "time" in ds.dims else None
    return window(ds, given.longitude, given.latitude, time, margin=2.0 * given.spacing)


def _sources(datasets: list[xr.Dataset]) -> str:
    return "; ".join(str(ds.attrs.get("product") or ds.attrs.get("source", "files")) for ds in datasets)


class _Maker:
    """Makes the fields of one record when it is needed."""

    def __init__(self, given: FileForcing, datasets: list[xr.Dataset], moments: list[datetime]) -> None:
        self.datasets, self.moments = datasets, moments
        west, south = given.longitude[0], given.latitude[0]
        ni = round((given.longitude[1] - west) / given.spacing)
        nj = round((given.latitude[1] - south) / given.spacing)
        east = np.asarray(west + given.spacing * np.arange(1, ni + 1), np.float64)
        north = np.asarray(south + given.spacing * np.arange(1, nj + 1), np.float64)
        self.corners = east, north
        self.centres = east - 0.5 * given.spacing, north - 0.5 * given.spacing
        self._static = self._fields([ds for ds in datasets if "time" not in ds.dims], None)
        depth = self._static.get("depth")
        mask = None if depth is None else np.where(depth > 0.0, 1.0, 0.0)
        self.grid = Grid.from_corners(*np.meshgrid(*self.corners), mask=mask)
        self.over_draft: DraftCurrents | None = None

    def __call__(self, record: int) -> Fields:
        moving = self._fields([ds for ds in self.datasets if "time" in ds.dims], self.moments[record])
        if self.over_draft is not None:
            moving["uo"], moving["vo"] = self.over_draft.at_nominal(record)
        return self.grid.fields(**{**self._static, **moving})

    def _fields(self, datasets: list[xr.Dataset], moment: datetime | None) -> dict[str, Any]:
        found: dict[str, Floats] = {}
        times = None if moment is None else [moment]
        for ds in datasets:
            for at, axes in (("corner", self.corners), ("centre", self.centres)):
                wanted = [n for n in map(str, ds.data_vars) if _belongs(n) == at]
                if wanted:
                    values = to_grid(ds[wanted].assign_attrs(ds.attrs), *axes, times)
                    found |= {n: np.asarray(values[n].squeeze(drop=True).values, np.float64) for n in wanted}
        if "taux" in found and "ua" not in found:
            found["ua"], found["va"] = wind_from_stress(found["taux"], found["tauy"])
        named = {NAMES.get(name, name): value for name, value in found.items()}
        return {name: value for name, value in named.items() if name in Fields._fields}


def _belongs(name: str) -> str:
    """Whether a canonical field is needed at corners or at centres of the cells, or not at all."""
    if name in CORNER_FIELDS or name in ("taux", "tauy"):
        return "corner"
    return "centre" if NAMES.get(name, name) in Fields._fields else ""
