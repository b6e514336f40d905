"""Forcing from files of any products that Riftberg knows: opened, cut to the run, checked, and handed to the elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from riftberg.config.units import box_text, duration_text, place_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.ocean.balance import MEAN, decided
from riftberg.ocean.dataset_preparation import describe_idle_fields
from riftberg.ocean.datasets import DatasetForcing
from riftberg.ocean.files_schema import FileForcing, NamedFiles
from riftberg.ocean.grid import Grid
from riftberg.ocean.needs import CURRENT, OVER_DRAFT, WIND
from riftberg.ocean.product_part import Part, averaged_product, product_part, provided_fields
from riftberg.ocean.product_records import (
    Block,
    ProductRecords,
    Wanted,
    block_length,
    check_not_empty,
    values_at,
)
from riftberg.physics.floating import draft_of
from riftberg.products import records
from riftberg.products.levels import uppermost
from riftberg.products.mesh import AxesMesh, Located, NodeMesh, extent_text, utc, window, window_in_time
from riftberg.products.place import median_step
from riftberg.products.product import noted
from riftberg.products.quantities import QUANTITIES
from riftberg.products.reading import member_dimensions, open_raw
from riftberg.products.registry import Choice, open_named, read_named
from riftberg.products.repair import VALID
from riftberg.state import Floats
from riftberg.system.input_files import files_matching, refuse_large
from riftberg.system.netcdf_lock import closing_files

MARGIN = 3
"""Points of a product around the box that are read too."""

MOST_POINTS = 4e6
"""Points of a sea floor without records; finer ones are averaged in blocks first."""


MOST_CELLS = 20e6
"""Cells of a model grid."""

BYTES_PER_CELL = 200
"""Memory of a cell with two records of the usual fields, about."""

MOST_MOMENTS = 1e6
"""Dates to which files are interpolated for a model grid."""


class Run(NamedTuple):
    """Demands of a run on its files: start and end (UTC), thickness (m) and density (kg m-3) of the ice, and whether it melts.

    What melts takes temperature and salinity over the draft.
    """

    start: datetime
    end: datetime
    thickness: Floats
    ice_density: float
    melts: bool = False
    place: tuple[Floats, Floats] | None = None  # Longitude and latitude of the elements, degrees

    @classmethod
    def of(
        cls, start: datetime, days: float, thickness: Floats, ice_density: float, *, melts: bool = False,
        place: tuple[Floats, Floats] | None = None,
    ) -> Run:  # fmt: skip
        """Return the demands of a run of some days."""
        return cls(start, start + timedelta(days=days), thickness, ice_density, melts, place)

    @property
    def drafts(self) -> Floats:
        """Drafts of the elements, m."""
        return np.asarray(draft_of(self.thickness, self.ice_density))

    @property
    def extent(self) -> tuple[float, ...] | None:
        """Longitudes and latitudes that hold the elements, by half degrees: with another lattice the box mostly stays."""
        if self.place is None:
            return None
        ends = [
            (math.floor(2.0 * float(axis.min())) / 2.0, math.ceil(2.0 * float(axis.max())) / 2.0) for axis in self.place
        ]
        return (*ends[0], *ends[1])

    def seconds(self, moments: Sequence[datetime]) -> list[float]:
        """Times since the start."""
        return [(moment - self.start).total_seconds() for moment in moments]


def opened_files(settings: FileForcing, folder: Path) -> list[xr.Dataset]:
    """Open the files of a forcing, for `forcing_from_files`."""
    _check_member(settings, folder)
    return open_named(_paths(settings.entries, folder), settings.member)


@closing_files(only_if_refused=True)
def forcing_from_files(
    settings: FileForcing, folder: Path, run: Run, opened: list[xr.Dataset] | None = None
) -> DatasetForcing:
    """Return the forcing for a run; ``opened``: its files, where several runs share them."""
    if settings.spacing is None and "every_hours" in settings.model_fields_set:
        raise ForcingError(
            "an interval without a model grid", where="forcing.every_hours",
            remedy="Give spacing too, or leave it out: each product keeps its own grid and dates",
        )  # fmt: skip
    opened = opened_files(settings, folder) if opened is None else opened
    settings, chosen = _with_box(settings, opened, run)
    slope = decided(
        settings.sea_level, {str(name) for ds in opened for name in ds.data_vars}, where="forcing.sea_level",
        level_wanted="Add a file of it, or leave sea_level out: then the slope balances the current",
        currents_wanted="Add a file of currents, or leave sea_level out",
    )  # fmt: skip
    assumed, settings = settings.sea_level == "auto", settings.model_copy(update={"sea_level": slope})
    # Fields that the run does not use are dropped before any values are read.
    datasets = [piece for ds in serving_only(opened, settings) for piece in _near(ds, settings, run)]
    if not any("uo" in ds for ds in datasets):
        fields = sorted({str(name) for ds in opened for name in ds.data_vars})
        raise ForcingError(
            f"no {CURRENT.quantity} ({', '.join(CURRENT.fields)}) in these files",
            where=", ".join(entry.file for entry in settings.entries),
            remedy=f"They give {', '.join(fields)}; add a file of currents, or name its variables (names: {{uo: u, vo: v}})",
        )
    records.check_pairs(datasets)  # only now: records without values may have parted the components
    if (
        settings.wind_layer
        and settings.currents == "draft"
        and any("uo" in ds and "depth" in ds.dims for ds in datasets)
    ):
        raise ForcingError(
            "currents that are means over the draft hold no layer of the wind's own", where="forcing.wind_layer",
            remedy="Leave it out, or take currents: surface",
        )  # fmt: skip
    deep = {*(("uo", "vo") if settings.currents == "draft" else ()), *(OVER_DRAFT if run.melts else ())}
    currents = next(ds for ds in datasets if "uo" in ds)
    datasets = [_as_needed(ds, deep) for ds in datasets]
    grid = None if settings.spacing is None else ModelGrid.of(settings, datasets, run)

    def make_product(ds: xr.Dataset) -> Part:
        return product_part(ds, run.start, keel=float(run.drafts.max())) if grid is None else grid.part(ds, run)

    products = [make_product(ds) for ds in datasets]
    balance = None
    if slope == "geostrophic":
        balance = next(each for each in products if "uo" in each.gives)
        # Over the draft also where the surface alone drives the berg; on the product's own points and dates.
        if grid is not None or (settings.currents == "surface" and "depth" in currents.dims):
            balance = product_part(currents[["uo", "vo"]], run.start, keel=float(run.drafts.max()))
        balance = averaged_product(balance)
    # Fields that the files lack, and doubts about others, in a line each.
    fields_read = {str(name) for ds in datasets for name in ds.data_vars}
    notices = [*records.named_remarks(datasets), *records.doubtful_units(datasets)]
    if not fields_read & {"ua", "taux"} and settings.wind == "files":
        wind = ", ".join(WIND.fields)
        notices.append(f"no file gives the wind ({wind}): the air is calm. With wind: none in forcing this is not said")
    notices += [
        f"{records.named(ds)} has no dates: its {', '.join(moving)} are held constant for the whole run"
        for ds in datasets
        if "time" not in ds.dims and (moving := [str(name) for name in ds.data_vars if QUANTITIES[str(name)].moves])
    ]
    # Fields that this run does not use, in a line each.
    remarks = describe_idle_fields(opened)
    offered = {str(name): ds for ds in opened for name in ds.data_vars}
    if {"taux", "ua"} <= set(offered) and "ua" in fields_read:
        remarks.append(f"{records.named(offered['taux'])}: wind stress (taux, tauy) is not used beside a wind")
    if not run.melts and (idle := [name for name in ("sst", "sss") if name in fields_read]):
        remarks.append(f"{', '.join(idle)} are for melt alone, which is off in this run")
    if run.melts and "wave_height" in fields_read:
        remarks.append("given waves push the berg; what waves melt follows from the wind all the same")
    return DatasetForcing(
        products,
        ice_density=run.ice_density,
        draft=float(run.drafts.mean()),
        coastal_drift=settings.coastal_drift,
        grid=None if grid is None else grid.grid,
        balance=balance,
        assumes_slope=assumed and balance is not None,
        wind_layer=settings.wind_layer,
        notices=(*chosen, *notices, *remarks),
    )


MOST_KEPT = 8
"""Forcings that members of an ensemble share: more would keep blocks of too many files in memory."""

_SHARED: dict[Any, DatasetForcing] = {}


def shared_forcing(settings: FileForcing, folder: Path, run: Run) -> DatasetForcing:
    """Return the forcing for a run; members of an ensemble that ask for the same get the same, and read no file again."""
    if not _SHARING.get():
        return forcing_from_files(settings, folder, run)
    drafts = run.drafts
    key = (settings.model_dump_json(), str(folder), run.start, run.end, run.ice_density, run.melts, float(drafts.max()),
           float(drafts.mean()), run.extent)  # fmt: skip
    forcing = _SHARED.pop(key, None) or forcing_from_files(settings, folder, run)
    _SHARED[key] = forcing  # the one that was used last stands last
    while len(_SHARED) > MOST_KEPT:
        del _SHARED[next(iter(_SHARED))]
    return forcing


_SHARING: ContextVar[bool] = ContextVar("riftberg_sharing_forcings", default=False)


@contextmanager
def sharing_forcings() -> Iterator[None]:
    """Let the models that are built within a ``with`` block share their forcings, to which nothing is written."""
    token = _SHARING.set(True)
    try:
        yield
    finally:
        _SHARING.reset(token)


def forget_forcings() -> None:
    """Let go of the forcings that were shared, with their files."""
    _SHARED.clear()


FASTEST = 2.0
"""Speed (m s-1) of a current in whose box the fastest one is looked for."""

SPARE = 50e3
"""Margin (m) of a box that is chosen, beyond the way of the fastest current."""


def _with_box(settings: FileForcing, opened: Sequence[xr.Dataset], run: Run) -> tuple[FileForcing, tuple[str, ...]]:
    """Return settings with a box as far around the berg as the fastest current carries it, and a notice that says so."""
    if settings.longitude is not None:
        return settings, ()
    if run.extent is None:
        raise ForcingError("no box", where="forcing", remedy="Give longitude and latitude")
    west_end, east_end, south_end, north_end = run.extent
    seconds = (run.end - run.start).total_seconds()

    def box_around(speed: float) -> FileForcing:
        reach = (speed * seconds + SPARE) / (DEGREE * EARTH_RADIUS_A68)
        south, north = max(south_end - reach, -90.0), min(north_end + reach, 90.0)
        across = reach / max(math.cos(max(abs(south), abs(north)) * DEGREE), 0.05)
        west, east = west_end - across, east_end + across
        if east - west >= 360.0:
            west, east = -180.0, 180.0
        return settings.model_copy(update={"longitude": (west, east), "latitude": (south, north)})

    fastest = 0.0
    for ds in opened:
        for windowed in (
            _near(uppermost(ds, ["uo", "vo"]), box_around(FASTEST), run)[:1] if "uo" in ds and "vo" in ds else ()
        ):
            count = windowed.sizes.get("time", 1)  # a few dates stand for all, which would take long to read
            rows = np.unique(np.linspace(0, count - 1, 6).astype(int))
            sampled = windowed.isel(time=rows) if "time" in windowed.dims else windowed
            sizes = [float(abs(sampled[name]).max()) for name in ("uo", "vo")]
            fastest = max(fastest, math.hypot(*(0.0 if math.isnan(size) else size for size in sizes)))
    boxed = box_around(min(fastest, FASTEST) or FASTEST)
    (west, east), (south, north) = ((round(low, 2), round(high, 2)) for low, high in boxed.box)
    days = seconds / SECONDS_PER_DAY
    return boxed, (
        f"files are read from {box_text(west, east, south, north)}: as far as the fastest current there, {fastest:.2g} m/s, "
        f"carries a berg in {duration_text(float(f'{days:.6g}'))}; longitude and latitude in forcing give another box",
    )


def _as_needed(ds: xr.Dataset, deep: set[str]) -> xr.Dataset:
    """Return the uppermost level of all fields not in ``deep``; a sea floor of very many points as means of blocks."""
    keeping = deep if ds.sizes.get("depth", 0) > 1 else set()
    ds = uppermost(ds, [str(name) for name in ds.data_vars if name not in keeping])
    if "time" in ds.dims or not {"lat", "lon"} <= set(ds.dims):
        return ds
    count = math.ceil(math.sqrt(ds.sizes["lat"] * ds.sizes["lon"] / MOST_POINTS))
    return _coarse(ds, {"lat": count, "lon": count} if count > 1 else {})


class ModelGrid(NamedTuple):
    """Equal cells over the box of a run, to whose corners all products are interpolated at equal intervals."""

    lon: Floats  # Lines of corners, degrees
    lat: Floats  # Lines of corners, degrees
    moments: list[datetime]  # Dates (UTC)
    grid: Grid  # The cells; land where the sea floor is above the water

    @classmethod
    def of(cls, settings: FileForcing, datasets: list[xr.Dataset], run: Run) -> ModelGrid:
        """Return the grid that an experiment file asks for."""
        assert settings.spacing is not None
        _check_size(settings, run)
        # Cells of about that width, from the lower end of the box on.
        lon, lat = (
            np.asarray(
                low + settings.spacing * np.arange(max(1, round((high - low) / settings.spacing)) + 1), np.float64
            )
            for low, high in settings.box
        )
        hours = (run.end - run.start) / timedelta(hours=1)
        # Round-off must not add an interval beyond the end, for which no file need have records.
        count = math.ceil(hours / settings.every_hours - 1e-9)
        moments = [run.start + timedelta(hours=settings.every_hours * k) for k in range(count + 1)]
        mask = None
        for ds in datasets:
            if "depth_below_surface" in ds.data_vars:
                floor = product_part(_averaged(ds, settings.spacing), run.start)
                middles = np.meshgrid(0.5 * (lon[:-1] + lon[1:]), 0.5 * (lat[:-1] + lat[1:]))
                depth = interpolate_levels(floor, "depth_below_surface", 0.0, place_points(floor, *middles))
                mask = np.where(depth[0].reshape(middles[0].shape) > 0.0, 1.0, 0.0)
        return cls(lon, lat, moments, Grid.from_corners(*np.meshgrid(lon, lat), mask=mask, includes_southwest=True))

    def part(self, ds: xr.Dataset, run: Run) -> Part:
        """Return a product on this grid."""
        fields = _GridRecords(ds, run, self)
        return Part(AxesMesh(self.lon, self.lat), fields, provided_fields(fields))


class _GridRecords(ProductRecords):
    """Fields of a product at the corners and dates of a model grid, from the product's own points as elements get them."""

    def __init__(self, ds: xr.Dataset, run: Run, grid: ModelGrid) -> None:
        keel = float(run.drafts.max())
        self._product = product_part(_averaged(ds, grid.lat[1] - grid.lat[0]), run.start, keel=keel)
        super().__init__(ds, run.start, keel=keel)
        self._corners = np.meshgrid(grid.lon, grid.lat)
        self._at = place_points(self._product, *self._corners)
        if self.times:
            self.dates = np.array([utc(moment) for moment in grid.moments])
            self.times = run.seconds(grid.moments)
        self._length = block_length(self._corners[0].size * (self.limits.size - 1) * len(self.names))

    def reach(self, keel: float) -> None:
        with self._lock:
            self._product.records.reach(keel)
            super().reach(keel)

    def _read(self, records: slice) -> Block:
        times = self.times[records] if self.times else [0.0]
        shape = (-1, *self._corners[0].shape)
        block = {
            name: np.stack([interpolate_levels(self._product, name, time, self._at).reshape(shape) for time in times])
            for name in self.names
        }
        for name, values in block.items():
            check_not_empty(name, values, self.ds, self.dates[records])
        return block

    def _check_gap(self, record: int, time: float) -> None:
        """Pass: the records of the product check its gaps."""


def place_points(product: Part, lon: Floats, lat: Floats) -> Located:
    """Locate the points of a model grid on a product; refuse such as lie outside."""
    located = Located(product.mesh, lon, lat)
    outside = np.flatnonzero(located.outside)
    if outside.size:
        ds, first = product.records.ds, outside[0]
        position = place_text(float(located.lon[first]), float(located.lat[first]), latlon=True, digits=2)
        raise ForcingError(
            f"{outside.size} points of the model grid lie outside the data, the first at {position}; the data cover "
            f"{extent_text(ds)}",
            where=records.named(ds), remedy="Give files that cover the box, or take a smaller one",
        )  # fmt: skip
    return located


def interpolate_levels(product: Part, name: str, time: float, points: Located) -> Floats:
    """Return a field at points and a time on each of its levels, shape (levels, points); NaN where nothing is known."""
    # Where one record knows nothing the other one counts, also of sea ice: 0 would thin the ice all around.
    blend = product.records.field(name, time)
    levels = len(blend.before)
    if isinstance(product.mesh, NodeMesh):
        earlier, later = blend.before[:, 0], blend.after[:, 0]
        mixed = (1.0 - blend.weight) * earlier + blend.weight * later if blend.weight > 0.0 else earlier
        filled = np.where(np.isnan(earlier), later, np.where(np.isnan(later), earlier, mixed))
        return product.mesh.smooth(filled, points.lon, points.lat)
    # Each level counts as a field by itself.
    blend = blend._replace(bounds=np.arange(levels + 1), absent=np.full(levels, np.nan))
    wanted = Wanted.of(*((level, False, np.nan) for level in range(levels)))
    return values_at(blend, points.places, product.mesh.points.columns, wanted)


def _averaged(ds: xr.Dataset, spacing: float) -> xr.Dataset:
    """Return means of blocks of a product that is at least twice as fine as a model grid, so that no sounding is missed."""
    if not {"lat", "lon"} <= set(ds.dims):
        return ds
    # A spacing of 0.3 is 30 steps of 0.01 in spite of round-off.
    counts = {axis: int(spacing / (median_step(ds[axis].values) or spacing) + 1e-6) for axis in ("lat", "lon")}
    return _coarse(ds, {axis: count for axis, count in counts.items() if 2 <= count <= ds.sizes[axis] // 2})


def _coarse(ds: xr.Dataset, counts: dict[str, int]) -> xr.Dataset:
    """Return means of blocks of points: directions by their unit vectors, and land counts as depth 0."""
    if not counts:
        return ds
    if "depth_below_surface" in ds:
        ds = ds.assign(depth_below_surface=ds["depth_below_surface"].fillna(0.0))
    if "wave_direction" not in ds:
        return ds.coarsen(counts, boundary="trim").mean(keep_attrs=True)
    angle: Any = np.deg2rad(ds["wave_direction"])
    coarse = ds.assign(sine=np.sin(angle), cosine=np.cos(angle)).coarsen(counts, boundary="trim").mean(keep_attrs=True)
    direction: Any = np.rad2deg(np.arctan2(coarse["sine"], coarse["cosine"])) % 360.0
    return coarse.drop_vars(["sine", "cosine"]).assign(
        wave_direction=direction.assign_attrs(ds["wave_direction"].attrs)
    )


def _check_size(settings: FileForcing, run: Run) -> None:
    """Refuse a model grid of more cells or dates than anybody means, before any of them is made."""
    assert settings.spacing is not None
    files = ", ".join(entry.file for entry in settings.entries)
    spans = [high - low for low, high in settings.box]
    refuse_large(
        math.prod(span / settings.spacing for span in spans), MOST_CELLS, "cells of a model grid", size=BYTES_PER_CELL,
        where=f"forcing.spacing, for {files}", remedy="Give a wider spacing or a smaller box", kind=ForcingError,
    )  # fmt: skip
    refuse_large(
        (run.end - run.start) / timedelta(hours=1) / settings.every_hours, MOST_MOMENTS, "dates on a model grid",
        where=f"forcing.every_hours, for {files}", remedy="Give a longer interval or a shorter run", kind=ForcingError,
    )  # fmt: skip


def _paths(entries: list[NamedFiles], folder: Path) -> list[tuple[str, Choice]]:
    """Return all files with the product or names that are given for them."""
    files = [(entry, files_matching(entry.file, folder)) for entry in entries]
    for entry, matches in files:
        if not matches:
            raise ForcingError(
                f"no file matches {entry.file!r}",
                where=f"the folder {folder.absolute()}",
                remedy="Correct forcing.files or --data",
            )
    return [(path, entry.choice) for entry, matches in files for path in matches]


def count_members(settings: FileForcing, folder: Path) -> dict[str, int]:
    """Return of how many members of an ensemble the files give a quantity, by its canonical name; one is left out."""
    counts: dict[str, int] = {}
    for number, (path, choice) in enumerate(_paths(settings.entries, folder)):
        count = _member_count(path)
        if count > 1:
            counts |= {str(name): count for ds, _ in read_named(path, choice, number, 0) for name in ds.data_vars}
    return counts


def _member_count(path: str) -> int:
    return max(member_dimensions(open_raw(path)).values(), default=1)


def _check_member(settings: FileForcing, folder: Path) -> None:
    """Refuse a member that no file has."""
    if settings.member is None:
        return
    most = max(_member_count(path) for path, _ in _paths(settings.entries, folder))
    if settings.member >= most or most == 1:
        raise ForcingError(
            f"member {settings.member} of files with {most if most > 1 else 'no'} members", where="forcing.member",
            remedy=f"Give 0 to {most - 1}" if most > 1 else "Leave it out",
        )  # fmt: skip


def serving_only(datasets: list[xr.Dataset], settings: FileForcing) -> list[xr.Dataset]:
    """Return datasets with the fields that a run takes from them: of several the last, and no stress beside a wind."""

    def last_file(ds: xr.Dataset, name: str, number: int) -> int:
        """Return the number of the last file that gives a field; both components of a vector share it."""
        pair = next((pair for pair in records.VECTORS if name in pair), (name,))
        return max(
            int(ds[component].attrs.get(records.PLACE, number)) for component in pair if component in ds.data_vars
        )

    left_out = set() if settings.sea_level in ("auto", "files") else {"ssh"}
    field_names = {str(name) for ds in datasets for name in ds.data_vars}
    if settings.wind == "none" or {"ua", "va"} <= field_names:
        left_out |= {"taux", "tauy"} | ({"ua", "va"} if settings.wind == "none" else set())
    sources = sorted(
        (last_file(ds, str(name), number), number, str(name))
        for number, ds in enumerate(datasets)
        for name in ds.data_vars
        if str(name) not in records.WAVES or records.have_waves(ds)
    )
    last = {name: number for _, number, name in sources}
    if "wave_period" in last:
        last["wave_period"] = last["wave_height"]  # from the same waves
    fields_kept = [
        [str(name) for name in ds.data_vars if last.get(str(name)) == number and name not in left_out]
        for number, ds in enumerate(datasets)
    ]
    selected = [ds[names].assign_attrs(ds.attrs) for ds, names in zip(datasets, fields_kept, strict=True)]
    for number, ds in enumerate(datasets):
        for later in set(last.values()) - {number}:
            if twice := [str(name) for name in ds.data_vars if last.get(str(name)) == later and name not in left_out]:
                remark = (
                    f"{', '.join(twice)} are taken from here and not from {records.named(ds)}, which is named earlier"
                )
                selected[later] = noted(selected[later], told=remark)
    return [ds for ds in selected if ds.data_vars]


def _near(ds: xr.Dataset, settings: FileForcing, run: Run) -> list[xr.Dataset]:
    """Return a dataset around place and time of the run, in parts without records that hold no value."""
    spacing = median_step(np.asarray(ds["lat"].values, np.float64)) if "lat" in ds.dims else 0.5
    margin = MARGIN * spacing if settings.spacing is None else 2.0 * settings.spacing
    first, last = utc(run.start), utc(run.end)
    if "time" in ds.dims:
        limits = {"max_gap_seconds": settings.max_gap, "hold_seconds": settings.hold}
        ds = ds.assign_attrs({name: 3600.0 * hours for name, hours in limits.items() if hours is not None})
        records.check_ends(ds, np.array([first, last]))
        # So much more that a missing record at the edge can be bridged by those beyond it.
        balanced = settings.sea_level == "geostrophic" and "uo" in ds
        ds = window_in_time(ds, (first, last), max(records.gap_limit(ds), MEAN * balanced))
    windowed = window(ds, *settings.box, margin=margin)
    for axis in ("lat", "lon", "y", "x"):
        if windowed.sizes.get(axis, 2) < 2:
            raise ForcingError(
                f"only one point along {axis} lies near the box of the run: between points nothing is known",
                where=records.named(ds),
                remedy="Fetch a larger area, at least two points each way",
            )
    if "time" not in ds.dims:
        return [windowed]
    pieces = records.without_empty(windowed)
    lost = set(windowed.data_vars) - {name for piece in pieces for name in piece.data_vars}
    if lost:
        valid = sorted({str(windowed[name].attrs[VALID]) for name in lost if VALID in windowed[name].attrs})
        only = f", or outside of what the file calls valid ({'; '.join(valid)})" if valid else ""
        raise ForcingError(
            f"no value of {', '.join(sorted(map(str, lost)))} in the box and at the dates of the run: all land or missing{only}",
            where=records.named(ds),
            remedy="Leave the file out of forcing.files, or give one with values there",
        )
    for k, piece in enumerate(pieces):
        if "time" in piece.dims:
            records.check_records(piece, first, last)
        missing = windowed.sizes["time"] - piece.sizes.get("time", windowed.sizes["time"])
        if missing:
            names = ", ".join(map(str, piece.data_vars))
            pieces[k] = noted(piece, doubt=f"{missing} record(s) without any value of {names} count as missing")
    return pieces
