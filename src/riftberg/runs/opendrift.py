"""Trajectories that OpenDrift's iceberg module (OpenBerg) wrote: start and size of a berg, forcing along its way, its positions.

A file is a CF trajectory file: an array (trajectory, time) on one time axis, NaN before a seed and after the end of each, or
TrajAn's layout of one dimension, all samples one after the other. Where no reader covers, OpenDrift writes a fallback, which is
no value: a current of 0, a depth of 10,000 m. The attribute ``reader_NAME`` of a file says where a variable came from; ``0``
is from nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.needs import DEFAULTS
from riftberg.ocean.series import PAIRS, Series
from riftberg.physics.floating import draft_of
from riftberg.runs.accessor import Course
from riftberg.runs.layout import run_parameters
from riftberg.state import Floats, Ints
from riftberg.system.input_files import check_file, is_seen, reading
from riftberg.system.netcdf_lock import open_lazily, write_dataset

VARIABLES: Final = {
    "uo": "x_sea_water_velocity", "vo": "y_sea_water_velocity", "ua": "x_wind", "va": "y_wind",
    "ice_fraction": "sea_ice_area_fraction", "ice_thickness": "sea_ice_thickness", "ui": "sea_ice_x_velocity",
    "vi": "sea_ice_y_velocity", "wave_height": "sea_surface_wave_significant_height",
}  # fmt: skip
"""OpenDrift's name of each value of a series. A sea level at the place itself has no slope, and its slopes are 0 by default."""

DEPTH: Final = "sea_floor_depth_below_sea_level"

NO_READER: Final = "0"
"""Value of the attribute ``reader_NAME`` of a variable that no reader gave."""

KIND: Final = "OpenBerg"
"""Class of OpenDrift whose files tell of icebergs."""

REMEDY: Final = "Give a trajectory file of OpenDrift's OpenBerg, or of TrajAn"


class Size(NamedTuple):
    """Size of a berg at its start, m."""

    length: float
    width: float
    sail: float
    draft: float

    @property
    def thickness(self) -> float:
        """Sail and draft together, m."""
        return self.sail + self.draft


@dataclass(frozen=True)
class Trajectory:
    """One trajectory of a file: its valid records."""

    source: str  # Name of the file
    number: int  # That the file gives it; it is not the start: several sizes share one
    program: str  # Class and version of OpenDrift
    times: NDArray[np.datetime64]
    lon: Floats  # Degrees
    lat: Floats  # Degrees
    moving: Floats  # 0 where it is aground or locked in ice; NaN where not given
    end: str  # Its last status in the file's own words
    size: Size | None  # At the start: melt and rolling change it later; None where the file gives none
    series: Mapping[str, Floats]  # Of values that a reader gave, by Riftberg's names
    depth: float | None  # At the start, m
    ocean: str  # Source of the current, in the file's own words; the names of files lie
    options: Mapping[str, str]  # Of the drift model: sea_surface_slope, vertical_profile, sea_ice_lockin

    @property
    def start(self) -> datetime:
        """Date (UTC) of the first valid record."""
        return self.times[0].astype("datetime64[us]").item()  # type: ignore[no-any-return]

    def observed(self) -> dict[datetime, tuple[float, float]]:
        """Return longitude and latitude by date, as an observed track."""
        dates = self.times.astype("datetime64[us]").tolist()
        return dict(zip(dates, zip(self.lon.tolist(), self.lat.tolist(), strict=True), strict=True))

    def berg(self, **options: Any) -> Iceberg:
        """Return the berg at its start.

        Its thickness is sail and draft of the file together. The draft that grounds is Riftberg's, from that thickness and the
        density of the ice: 0.83 of it at 850 kg m-3, where OpenBerg has 0.875.

        Parameters
        ----------
        **options
            As for `riftberg.Iceberg.rectangle`.
        """
        return Iceberg.rectangle(
            **{**self.known_size(), "placement": (float(self.lon[0]), float(self.lat[0])), **options}
        )

    def known_size(self) -> dict[str, float]:
        """Return length, width and thickness (m) at the start, or say that the file has none."""
        if self.size is None:
            raise InputError(
                "no length, width, sail and draft", where=self.source, remedy="Give the size of the berg yourself"
            )
        if not (min(self.size) >= 0.0 < min(self.size.length, self.size.width, self.size.draft)):
            size = ", ".join(f"{name} {value:g}" for name, value in self.size._asdict().items())
            raise InputError(
                f"{size} m are no size of a berg", where=f"{self.source}, trajectory {self.number}",
                remedy="Give the size of the berg yourself",
            )  # fmt: skip
        return {"length": self.size.length, "width": self.size.width, "thickness": self.size.thickness}

    def forcing(self, **options: Any) -> Series:
        """Return the forcing along the trajectory, the same everywhere; the floor is taken at the start.

        Parameters
        ----------
        **options
            As for `riftberg.Forcing.along`; values given here replace those in the file, None leaves one out.

        Raises
        ------
        ForcingError
            If the file holds no current, or one of 0 throughout: no reader covered it.
        """
        if not {"uo", "vo"} <= self.series.keys():
            raise ForcingError("no current along the trajectory", where=self.source, remedy="Give a file of OpenBerg")
        if not any(self.series[name].any() for name in ("uo", "vo")):
            raise ForcingError(
                f"the current is 0 at all {self.times.size} times of trajectory {self.number}: no ocean covered it",
                where=self.source, remedy="Run OpenDrift with an ocean that covers the berg, or give another trajectory",
            )  # fmt: skip
        try:
            return Series(self.times, **{"depth": self.depth, **self.series, **options})
        except ForcingError as error:
            where = f"{self.source}, trajectory {self.number}, {error.where}"
            raise ForcingError(error.what, where=where, remedy=error.remedy) from error

    def course(self) -> Course:
        """Return the trajectory as the course of a berg, to be compared with a run."""
        size = self.size
        area = np.full(self.times.size, np.nan if size is None else size.length * size.width)
        lon = np.unwrap(self.lon, period=360.0)
        return Course("", self.times, lon, self.lat, np.full(lon.shape, np.nan), area, [], True, EARTH_RADIUS_A68)


def read_opendrift(path: str | Path) -> list[Trajectory]:
    """Read the trajectories of a file that OpenDrift's OpenBerg wrote, or TrajAn.

    Parameters
    ----------
    path : path
        NetCDF file; ``FILE.nc#7`` is trajectory 7 alone.

    Returns
    -------
    list of Trajectory
        Those with a valid record, in the order of the file.

    Raises
    ------
    InputError
        If it is no such file, or one of another class of OpenDrift.

    Examples
    --------
    >>> bergs = riftberg.read_opendrift("openberg.nc")                            # doctest: +SKIP
    >>> Model(bergs[0].berg(), bergs[0].forcing()).run("3 d")                     # doctest: +SKIP
    """
    file, number = file_and_number(path)
    check_file(file, remedy=REMEDY)
    with reading(file, "no trajectories that can be read", REMEDY), open_lazily(file) as ds:
        return _read_all(ds, file, number)


def trajectories_if_any(path: str | Path) -> list[Trajectory] | None:
    """Return the trajectories of a file of OpenDrift or TrajAn, opened once; None of a run of Riftberg and any other file."""
    file, number = file_and_number(path)
    if file.suffix.lower() not in (".nc", ".nc4", ".cdf") or not file.is_file():
        return None
    with reading(file, "cannot be read", REMEDY), open_lazily(file, decode_times=False) as ds:
        ours = {"parameters_json", "riftberg_version"} & ds.attrs.keys()
        if "opendrift_class" in ds.attrs or (str(ds.attrs.get("featureType", "")) == "trajectory" and not ours):
            return _read_all(xr.decode_cf(ds), file, number)
    return None


def _read_all(ds: xr.Dataset, file: Path, number: int | None) -> list[Trajectory]:
    """Return the trajectories of an open file that have a position, or the one with a number."""
    kind = str(ds.attrs.get("opendrift_class", KIND))
    if kind != KIND:
        raise InputError(f"written by OpenDrift's {kind}, which knows no icebergs", where=str(file), remedy=REMEDY)
    layout = _layout(ds, str(file))
    trajectories = [
        track for k in range(layout.trajectories) if (track := _trajectory(ds, layout, k, file.name)) is not None
    ]
    if number is not None:
        numbers = [track.number for track in trajectories]
        trajectories = [track for track in trajectories if track.number == number]
        if not trajectories:
            raise InputError(
                f"no trajectory {number}",
                where=str(file),
                remedy=f"It has {', '.join(map(str, numbers[:20])) or 'none'}",
            )
    if not trajectories:
        raise InputError("no trajectory with a position", where=str(file), remedy=REMEDY)
    return trajectories


def read_trajectory(path: str | Path, number: int | None = None) -> Trajectory:
    """Return one trajectory of a file: the one with a number, or the only one."""
    return only_one(read_opendrift(path if number is None else f"{path}#{number}"), path)


def only_one(trajectories: list[Trajectory], path: str | Path) -> Trajectory:
    """Return the trajectory of a file that has no other."""
    if len(trajectories) > 1:
        numbers = ", ".join(str(trajectory.number) for trajectory in trajectories[:20])
        raise InputError(
            f"{len(trajectories)} trajectories", where=str(path),
            remedy=f"Name one of {numbers}: trajectory in an experiment file, or {Path(path).name}#{trajectories[0].number}",
        )  # fmt: skip
    return trajectories[0]


def file_and_number(path: str | Path) -> tuple[Path, int | None]:
    """Return the file of ``FILE.nc#7``, and the number."""
    name, mark, number = str(path).rpartition("#")
    return (Path(name), int(number)) if mark and number.isdecimal() and not Path(path).exists() else (Path(path), None)


class _Layout(NamedTuple):
    """Where the samples of each trajectory stand."""

    trajectories: int
    dims: tuple[Any, ...]  # Of a variable by sample
    along: str  # Dimension of the trajectories, empty for none
    rows: Ints | None  # Trajectory of each sample, in a file of one dimension
    time: Any  # Dates by sample, or one axis for all


def _layout(ds: xr.Dataset, where: str) -> _Layout:
    lat = ds.variables.get("lat", ds.variables.get("latitude"))
    time = ds.variables.get("time")
    if lat is None or time is None or time.dtype.kind != "M" or lat.ndim not in (1, 2):
        raise InputError("no latitude by time", where=where, remedy=REMEDY)
    if lat.ndim == 2:
        along = next((d for d in lat.dims if d not in time.dims or d == "trajectory"), lat.dims[0])
        return _Layout(ds.sizes[along], lat.dims, str(along), None, time.values)
    sizes = next((v for v in ds.variables.values() if "sample_dimension" in v.attrs), ds.variables.get("rowsize"))
    index = next((v for v in ds.variables.values() if "instance_dimension" in v.attrs or (
        v.attrs.get("cf_role") == "trajectory_id" and v.dims == lat.dims)), None)  # fmt: skip
    if sizes is not None:
        rows = np.repeat(np.arange(sizes.size), sizes.values.astype(int))
    else:
        rows = np.zeros(lat.size, int) if index is None else np.unique(index.values, return_inverse=True)[1]
    return _Layout(int(rows.max(initial=0)) + 1, lat.dims, "", rows, time.values)


def _trajectory(ds: xr.Dataset, layout: _Layout, k: int, source: str) -> Trajectory | None:
    """Return one trajectory from its first valid record to its last; None where it has none."""

    def column(*names: str) -> NDArray[Any] | None:
        variable = next((ds.variables[name] for name in names if name in ds.variables), None)
        if variable is None or variable.dims != layout.dims:
            return None
        values = variable.values if layout.rows is not None else variable.isel({layout.along: k}).values
        return values if layout.rows is None else values[layout.rows == k]

    lon, lat = (np.asarray(column(*names), float) for names in (("lon", "longitude"), ("lat", "latitude")))
    times = layout.time if layout.rows is None and layout.time.ndim == 1 else column("time")
    assert times is not None
    valid = np.fromiter(map(is_seen, lon, lat), bool, lon.size) & ~np.isnat(times)
    if not valid.any():
        return None

    def known(*names: str) -> Floats | None:
        values = column(*names)
        return None if values is None else np.asarray(values, float)[valid]

    series = {name: values for name in VARIABLES if _was_read(ds, name)
              and (values := known(VARIABLES[name])) is not None and np.isfinite(values).any()}  # fmt: skip
    depth = known(DEPTH)
    depths = np.empty(0) if depth is None else depth[np.isfinite(depth)]
    sizes = [known(name) for name in Size._fields]
    firsts = [
        np.nan if values is None or not np.isfinite(values).any() else values[np.isfinite(values)][0]
        for values in sizes
    ]
    moving, status = known("moving"), known("status")
    numbers = ds.variables.get("trajectory")
    number = k
    if numbers is not None and numbers.size == layout.trajectories and numbers.dtype.kind in "iuf":
        number = int(numbers.values.ravel()[k])
    return Trajectory(
        source, number,
        " ".join(str(ds.attrs[name]) for name in ("opendrift_class", "opendrift_version") if name in ds.attrs),
        times[valid].astype("datetime64[ns]"), lon[valid], lat[valid],
        np.full(int(valid.sum()), np.nan) if moving is None else moving, _meaning(ds, status),
        Size(*map(float, firsts)) if np.isfinite(firsts).all() else None, series,
        None if not depths.size or not 0.0 < depths[0] < DEFAULTS["depth"] else float(depths[0]),
        str(ds.attrs.get("reader_x_sea_water_velocity", "")),
        {key.removeprefix("config_drift:"): str(value) for key, value in ds.attrs.items() if key.startswith("config_drift:")},
    )  # fmt: skip


def _was_read(ds: xr.Dataset, name: str) -> bool:
    """Whether a reader gave a value, or the other component of its vector; a current of 0 is told where it is used."""
    fields = next((pair for pair in PAIRS if name in pair), (name,))
    return "uo" in fields or any(
        str(ds.attrs.get(f"reader_{VARIABLES[field]}", "")).strip() != NO_READER for field in fields
    )


def _meaning(ds: xr.Dataset, status: Floats | None) -> str:
    """Return the last status of a trajectory in words; their order differs between files."""
    if status is None or not np.isfinite(status).any():
        return ""
    about = ds.variables["status"].attrs
    flags, words = np.ravel(about.get("flag_values", ())).astype(float), str(about.get("flag_meanings", "")).split()
    return dict(zip(map(float, flags), words, strict=False)).get(float(status[np.isfinite(status)][-1]), "")


def write_opendrift(run: xr.Dataset, path: str | Path) -> Path:
    """Write the bergs of a run as OpenDrift writes its results, for the readers and plots of OpenDrift and TrajAn.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run` or ``Model.run``; on a sphere.
    path : path
        NetCDF file: position, size, sail and draft of each berg and fragment by time.

    Returns
    -------
    path
    """
    parameters, tracks = run_parameters(run), run.riftberg.tracks.dataset
    if not parameters.earth.latlon:
        raise InputError(
            "this run is in metres", where="write_opendrift", remedy="OpenDrift knows longitude and latitude"
        )
    dates, sizes = run["time"].values, tracks["rowsize"].values
    row, column = np.repeat(np.arange(sizes.size), sizes), np.searchsorted(dates, tracks["time"].values)
    density = parameters.ice.density
    thickness = tracks["mass"].values / (density * tracks["area"].values)
    draft = draft_of(thickness, density)
    columns = {
        "lon": tracks["lon"].values, "lat": tracks["lat"].values, "length": tracks["length"].values,
        "width": tracks["width"].values, "sail": thickness - draft, "draft": draft, "iceb_x_velocity": tracks["u"].values,
        "iceb_y_velocity": tracks["v"].values, "moving": 1 - tracks["aground"].values, "status": np.zeros(row.size),
        "z": np.zeros(row.size),
    }  # fmt: skip
    fields = {}
    for name, values in columns.items():
        field = np.full((sizes.size, dates.size), np.nan, "f8" if name in ("lon", "lat") else "f4")
        field[row, column] = values
        fields[name] = ("trajectory", "time"), field
    ds = xr.Dataset(fields, {"trajectory": ("trajectory", tracks["trajectory"].values), "time": dates})
    ds["trajectory"].attrs["cf_role"] = "trajectory_id"
    ds["status"].attrs = {"flag_values": np.array([0], "i4"), "flag_meanings": "active"}
    for name, direction in (("lon", "east"), ("lat", "north")):
        ds[name].attrs = {
            "units": f"degrees_{direction}",
            "standard_name": "longitude" if name == "lon" else "latitude",
        }
    step = str(timedelta(seconds=float(np.diff(dates[:2])[0] / np.timedelta64(1, "s")) if dates.size > 1 else 0.0))
    ds.attrs = {
        "Conventions": "CF-1.11", "featureType": "trajectory", "source": "Riftberg", "opendrift_class": KIND,
        "opendrift_module": "opendrift.models.openberg", "time_step_calculation": step, "time_step_output": step,
    }  # fmt: skip
    write_dataset(ds, path)
    return Path(path)
