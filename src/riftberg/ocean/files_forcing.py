"""Forcing from files of any products that Riftberg knows: each on its own grid, or all on one model grid."""

from __future__ import annotations

import glob
import math
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.ocean.files_fields import NAMES, FieldMaker, Mesh, belongs, even_mesh, own_mesh
from riftberg.ocean.files_levels import LevelColumns, has_levels, without_levels
from riftberg.ocean.files_schema import FileForcing, NamedFiles
from riftberg.ocean.gridded import GriddedForcing
from riftberg.ocean.over_draft import DraftCurrents
from riftberg.ocean.own_grids import FILLS, OwnGrids, Part
from riftberg.physics.floating import draft_of
from riftberg.products import records
from riftberg.products.axes import step_of
from riftberg.products.canonical import QUANTITIES
from riftberg.products.registry import open_named
from riftberg.products.window import utc, window
from riftberg.state import Floats

PARTNER = dict(records.VECTORS)
"""Northward component of each vector by its eastward one."""

MOVING = frozenset({"ssh", *PARTNER, *PARTNER.values()})
"""Fields that change by the day; without dates they are a mean or a snapshot."""

MARGIN = 3
"""Points of a product around the box that are read too."""


class Run(NamedTuple):
    """What a run asks of its files: start and end (UTC), thickness of the elements (m) and density of the ice (kg m-3)."""

    start: datetime
    end: datetime
    thickness: Floats
    ice_density: float

    @classmethod
    def of(cls, start: datetime, days: float, thickness: Floats, ice_density: float) -> Run:
        """Return what a run of some days asks for."""
        return cls(start, start + timedelta(days=days), thickness, ice_density)

    @property
    def drafts(self) -> Floats:
        """Drafts of the elements, m."""
        return np.asarray(draft_of(self.thickness, self.ice_density))

    def seconds(self, moments: Sequence[datetime]) -> list[float]:
        """Times since the start."""
        return [(moment - self.start).total_seconds() for moment in moments]


def forcing_from_files(given: FileForcing, folder: Path, run: Run) -> GriddedForcing | OwnGrids:
    """Return the forcing for a run.

    Parameters
    ----------
    given : FileForcing
        Files, box, and perhaps spacing of a model grid.
    folder : pathlib.Path
        Folder of relative file names.
    run : Run
        What it is for.

    Raises
    ------
    ForcingError
        If a pattern matches nothing, or currents are missing, or the files do not cover place and time.
    """
    opened = open_named(_paths(given.entries, folder))
    datasets = [part for ds in serving_only(opened, given) for part in _near(ds, given, run)]
    if not any("uo" in ds for ds in datasets):
        found = sorted({str(name) for ds in opened for name in ds.data_vars})
        raise ForcingError(
            "no ocean current (uo, vo) in these files",
            where=", ".join(entry.file for entry in given.entries),
            remedy=f"They give {', '.join(found)}; add a file of currents",
        )
    if given.currents == "surface":
        datasets = [without_levels(ds, surface=True) for ds in datasets]
    _check_pairs(datasets)
    if given.spacing is None:
        forcing: GriddedForcing | OwnGrids = _on_own_grids(given, datasets, run)
    else:
        forcing = _on_one_grid(given, even_mesh(_box(given.longitude), given.latitude, given.spacing), datasets, run)
    forcing.notices = _notices(datasets, given)
    return forcing


def _check_pairs(datasets: list[xr.Dataset]) -> None:
    """Raise `ForcingError` where one component of a vector is given without the other: it would count as 0."""
    for ds in datasets:
        for pair in records.VECTORS:
            given = [name for name in pair if name in ds.data_vars]
            if len(given) == 1:
                other = pair[1 - pair.index(given[0])]
                raise ForcingError(
                    f"gives {given[0]} and no file gives {other} with the same records on the same grid",
                    where=records.named(ds),
                    remedy=f"Add the file with {QUANTITIES[other].long_name}",
                )


def _notices(datasets: list[xr.Dataset], given: FileForcing) -> tuple[str, ...]:
    """Return what the files leave out, and doubts about them, in a line each."""
    held = {str(name) for ds in datasets for name in ds.data_vars}
    told = [f"{records.named(ds)}: {ds.attrs[key]}" for ds in datasets for key in ("told", "doubt") if key in ds.attrs]
    if "ssh" not in held and given.sea_level == "files":
        told.append(
            "no file gives the sea level (ssh): its slope, which balances most of the Coriolis force on a large berg, "
            "is 0. With sea_level: none in forcing this is not said"
        )
    if not held & {"ua", "taux"} and given.wind == "files":
        told.append("no file gives the wind (ua, va): the air is calm. With wind: none in forcing this is not said")
    told += [
        f"{records.named(ds)} has no dates: its {', '.join(moving)} are held constant for the whole run"
        for ds in datasets
        if "time" not in ds.dims and (moving := [str(name) for name in ds.data_vars if str(name) in MOVING])
    ]
    return tuple(told)


def _paths(entries: list[NamedFiles], folder: Path) -> list[tuple[str, str | None]]:
    """Return all files with the product that is named for them."""
    found = [(entry, sorted(glob.glob(str(folder / entry.file)))) for entry in entries]
    for entry, matches in found:
        if not matches:
            raise ForcingError(
                f"no file matches {entry.file!r}", where=str(folder), remedy="Correct forcing.files or --data"
            )
    return [(path, entry.product) for entry, matches in found for path in matches]


def serving_only(datasets: list[xr.Dataset], given: FileForcing) -> list[xr.Dataset]:
    """Return datasets with the fields that a run takes from them: of several the last, and no stress beside a wind."""
    left_out = {"ssh"} if given.sea_level == "none" else set()
    held = {str(name) for ds in datasets for name in ds.data_vars}
    if given.wind == "none" or {"ua", "va"} <= held:
        left_out |= {"taux", "tauy"} | ({"ua", "va"} if given.wind == "none" else set())
    last = {str(name): number for number, ds in enumerate(datasets) for name in ds.data_vars if belongs(str(name))}
    kept = [
        [str(name) for name in ds.data_vars if last.get(str(name)) == number and name not in left_out]
        for number, ds in enumerate(datasets)
    ]
    return [ds[names].assign_attrs(ds.attrs) for ds, names in zip(datasets, kept, strict=True) if names]


def _box(longitude: tuple[float, float]) -> tuple[float, float]:
    """West and east with east above west, also across the date line."""
    west, east = longitude
    return west, east if east > west else east + 360.0


def _near(ds: xr.Dataset, given: FileForcing, run: Run) -> list[xr.Dataset]:
    """Return a dataset around place and time of the run, in parts without records that hold no value.

    Raises
    ------
    ForcingError
        If the records have too long a gap in the run, or do not cover it.
    """
    own = step_of(np.asarray(ds["lat"].values, np.float64)) if "lat" in ds.dims else 0.5
    margin = MARGIN * own if given.spacing is None else 2.0 * given.spacing
    if "time" not in ds.dims:
        return [_with_area(window(ds, _box(given.longitude), given.latitude, margin=margin))]
    first, last = utc(run.start), utc(run.end)
    ds = with_rules(ds, given)
    records.check_ends(ds, np.array([first, last]))
    # So much more that a missing record at the edge can be bridged by those beyond it.
    spare = np.timedelta64(round(records.gap_limit(ds)), "s")
    near = _with_area(window(ds, _box(given.longitude), given.latitude, (first - spare, last + spare), margin=margin))
    parts = records.without_empty(near)
    lost = set(near.data_vars) - {name for part in parts for name in part.data_vars}
    if lost:
        raise ForcingError(
            f"no value of {', '.join(sorted(map(str, lost)))} in the box and at the dates of the run: all land or missing",
            where=records.named(ds),
            remedy="Leave the file out of forcing.files, or give one with values there",
        )
    for part in parts:
        if "time" in part.dims:
            records.check_records(part, first, last)
    return [_told_of_missing(part, near) for part in parts]


def _told_of_missing(part: xr.Dataset, near: xr.Dataset) -> xr.Dataset:
    """Return a part with a doubt noted on it if it has lost records without values."""
    lost = near.sizes["time"] - part.sizes.get("time", near.sizes["time"])
    if not lost:
        return part
    names = ", ".join(map(str, part.data_vars))
    earlier = f"{part.attrs['doubt']}; " if "doubt" in part.attrs else ""
    return part.assign_attrs(doubt=f"{earlier}{lost} record(s) without any value of {names} count as missing")


def with_rules(ds: xr.Dataset, given: FileForcing) -> xr.Dataset:
    """Note on a dataset what the experiment file says about gaps and ends, in seconds."""
    told = {"max_gap_seconds": given.max_gap, "hold_seconds": given.hold}
    return ds.assign_attrs({name: 3600.0 * hours for name, hours in told.items() if hours is not None})


def _with_area(ds: xr.Dataset) -> xr.Dataset:
    """Return the dataset; refuse one that has a single row or column of points."""
    for axis in ("lat", "lon", "y", "x"):
        if ds.sizes.get(axis, 2) < 2:
            raise ForcingError(
                f"only one point along {axis} lies near the box of the run: between points nothing is known",
                where=records.named(ds),
                remedy="Fetch a larger area, at least two points each way",
            )
    return ds


def _source(ds: xr.Dataset) -> str:
    return str(ds.attrs.get("product") or ds.attrs.get("source", "files"))


def _forcing(
    given: FileForcing, maker: FieldMaker, moments: Sequence[datetime], levels: xr.Dataset | None, source: str, run: Run
) -> GriddedForcing:
    """Return gridded forcing from a maker of fields, with currents over the draft if there are levels."""
    if levels is not None:
        columns = LevelColumns(levels, maker.mesh.corners, moments, float(run.drafts.max()))
        columns.grid = maker.grid
        maker.over_draft = DraftCurrents(columns.limits, columns, run.ice_density, float(run.drafts.mean()))
    return GriddedForcing(
        maker.grid, maker, run.seconds(moments), coastal_drift=given.coastal_drift, over_draft=maker.over_draft,
        start=run.start, source=source,
    )  # fmt: skip


def _on_one_grid(given: FileForcing, mesh: Mesh, datasets: list[xr.Dataset], run: Run) -> GriddedForcing:
    """All products on one grid, at equal intervals."""
    days = (run.end - run.start) / timedelta(days=1)
    count = math.ceil(24.0 * days / given.every_hours - 1e-9)
    moments = [run.start + timedelta(hours=given.every_hours * k) for k in range(count + 1)]
    levels = next((ds for ds in reversed(datasets) if "uo" in ds and has_levels(ds)), None)
    maker = FieldMaker(mesh, [without_levels(ds, surface=False) for ds in datasets], moments)
    return _forcing(given, maker, moments, levels, "; ".join(map(_source, datasets)), run)


def _on_own_grids(given: FileForcing, datasets: list[xr.Dataset], run: Run) -> OwnGrids:
    """Each product on its own points, at its own times."""
    serving = _serving(datasets)
    sea_level = serving.get("ssh")
    parts: dict[tuple[int, str], list[str]] = {}
    for name, ds in serving.items():
        number = next(k for k, other in enumerate(datasets) if other is ds)
        # Depth needs the sea level at its own points: it is a part of its own.
        parts.setdefault((number, "depth" if name == "depth" else belongs(name)), []).append(name)
    return OwnGrids([
        Part(_own_part(given, datasets[number], kind, names, sea_level, run), tuple(names))
        for (number, kind), names in parts.items()
    ])  # fmt: skip


def _serving(datasets: list[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the dataset that each field comes from: of several the last."""
    serving: dict[str, xr.Dataset] = {}
    for name in FILLS:
        canonical = next((long for long, short in NAMES.items() if short == name), name)
        holders = [ds for ds in datasets if canonical in ds.data_vars]
        if name == "ua" and not holders:
            holders = [ds for ds in datasets if "taux" in ds.data_vars]
        if holders:
            serving[name] = holders[-1]
    return serving


def _own_part(
    given: FileForcing, ds: xr.Dataset, kind: str, names: list[str], sea_level: xr.Dataset | None, run: Run
) -> GriddedForcing:
    """Return the forcing of one product that serves some fields."""
    canonical = {short: long for long, short in NAMES.items()}
    wanted = {canonical.get(name, name) for name in names} | {PARTNER[name] for name in names if name in PARTNER}
    if "ua" in names:
        wanted |= {"taux", "tauy"}
    mine = ds[[name for name in ds.data_vars if name in wanted]].assign_attrs(ds.attrs)
    levels = mine if "uo" in names and has_levels(mine) else None
    used = [without_levels(mine, surface=False)]
    if kind == "depth" and sea_level is not None:
        used.append(sea_level[["ssh"]].assign_attrs(sea_level.attrs))
    moments = _own_moments([mine, *used], run)
    known = next((name for name in ("ssh", "uo") if name in names and levels is None), "")
    maker = FieldMaker(own_mesh(mine, at="corner" if kind == "corner" else "centre"), used, moments, known)
    return _forcing(given, maker, moments, levels, _source(ds), run)


def _own_moments(datasets: Sequence[xr.Dataset], run: Run) -> list[datetime]:
    """Return start, end, and the records between them."""
    first, last = utc(run.start), utc(run.end)
    times = [ds["time"].values for ds in datasets if "time" in ds.dims]
    within = [time[(time > first) & (time < last)] for time in times]
    moments = np.unique(np.concatenate([[first, last], *within]).astype("datetime64[us]"))
    return [moment.item() for moment in moments]
