"""The result of a sweep as one dataset: a member dimension, varied inputs, break-ups, fragments, tracks."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
import xarray as xr

from riftberg.config.values import required
from riftberg.ensembles.member import CELLS, FRAGMENT, Outcome, broken_off
from riftberg.ensembles.uncertain import SEED
from riftberg.ensembles.vary import Varied
from riftberg.errors import InputError
from riftberg.runs.layout import time_units
from riftberg.runs.scene import SMALL
from riftberg.runs.tracks import GOES_ON
from riftberg.state import Floats
from riftberg.system.input_files import check_file, is_folder, reading
from riftberg.system.netcdf_lock import fixed_texts, open_lazily, open_netcdf, write_dataset
from riftberg.version import __version__

STATUS: Final = {"done": 0, "failed": 1, "waiting": 2, "unfinished": 3}
"""Values of the variable ``status``."""

MOST_LISTED: Final = 64
"""Fragments of a member in the tables: of more, the bergs at the start and the largest."""

TOTALS: Final = {
    "pieces": ("1", "number of bergs and fragments at the end"),
    "bonds_broken": ("1", "number of bonds that broke"),
    "breakups": ("1", "number of fragments that broke off, crumbs too"),
    "largest_area": ("m2", "plan area of the largest piece at the end"),
    "stress_ratio": ("1", "largest stress over strength of a bond until the first break-up"),
    "fresh_water": ("kg", "ice that melted"),
    "aground_lon": (
        "degrees_east",
        "longitude where the sea floor first acted (x in m in Cartesian runs), missing where never",
    ),
    "aground_lat": (
        "degrees_north",
        "latitude where the sea floor first acted (y in m in Cartesian runs), missing where never",
    ),
}
"""Whole numbers and sizes of a member: unit and meaning."""

MEANS: Final = {
    "current_error_east": ("m s-1", "mean eastward error of the current along the track of the first berg"),
    "current_error_north": ("m s-1", "mean northward error of the current along the track of the first berg"),
    "wind_error_east": ("m s-1", "mean eastward error of the wind along the track of the first berg"),
    "wind_error_north": ("m s-1", "mean northward error of the wind along the track of the first berg"),
    "floor_error_mean": ("1", "mean of the random field of the floor along the track, in its standard deviations"),
}
"""What random errors came to in a member, where there are any."""

_ABOUT: Final = {
    "parent": ("1", "fragment that it split from; 0 for a berg that was there at the start"),
    "elements": ("1", "number of elements at birth"),
    "area": ("m2", "plan area at birth"),
    "mass": ("kg", "mass at birth"),
    "bonds_broken": ("1", "broken bonds that joined it to the rest of its parent"),
    "grounded": ("1", "1 where it broke off aground"),
}


def build_dataset(
    varied: Sequence[Varied], members: Sequence[Mapping[str, Any]], outcomes: Mapping[int, Outcome], *,
    start: datetime, days: float, every: float, latlon: bool, attributes: Mapping[str, str],
    room: tuple[int, Sequence[str]] = (0, ()), lagged: bool = False,
) -> xr.Dataset:  # fmt: skip
    """Return the result of a sweep, or of a block of its members.

    ``days``, ``every``: length of the runs, days, and interval of the tracks, s; ``room``: fragments and means of errors
    that other blocks need; ``lagged``: members that start at other dates have their tracks by the dates of the whole.
    """
    count = len(members)
    listed = {number: _listed(outcome) for number, outcome in outcomes.items()}
    most = max((len(rows) for rows in listed.values()), default=0)
    most = max(most, room[0])
    times = np.arange(0.0, days * 86400.0 + 0.5 * every, every)
    ds = xr.Dataset(attrs={"Conventions": "CF-1.11", **attributes, "riftberg": __version__})
    ds["member"] = (
        "member",
        np.arange(count),
        {"long_name": "number of the member", "standard_name": "realization", "units": "1"},
    )
    ds["fragment"] = ("fragment", np.arange(1, most + 1), {"long_name": "place of the fragment in the tables"})
    ds["time"] = (
        "time",
        np.datetime64(start, "ns") + (times * 1e9).astype("timedelta64[ns]"),
        {"standard_name": "time"},
    )
    for v in varied:
        values = [member[v.name] for member in members]
        numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
        column = (
            np.array(values, dtype=np.float64)
            if numeric
            else np.array([_text(value) for value in values], dtype=object)
        )
        about = {"long_name": v.meaning or v.name, "parameter": v.name}
        if numeric:
            about["units"] = v.unit or "1"
        if v.distribution is not None:
            about["distribution"] = v.distribution.text
        ds.coords[variable_name(v.name)] = ("member", column, about)
    if members and SEED in members[0] and variable_name(SEED) not in ds.coords:
        seeds = np.array([member[SEED] for member in members], dtype=np.int64)
        ds.coords[variable_name(SEED)] = ("member", seeds, {"long_name": "seed of the random fields of the member"})
    later = np.zeros(count)
    if "start" in ds.coords:
        later = np.array([(datetime.fromisoformat(str(member["start"])) - start).total_seconds() for member in members])
        if not lagged:
            ds["time"].attrs["comment"] = "dates of member 0; add start_after for those of another member"
            about = {"units": "s", "long_name": "how much later than member 0 the member starts"}
            ds.coords["start_after"] = ("member", later, about)
    _add_ends(ds, outcomes, later, start, room[1])
    _add_fragments(ds, outcomes, listed, later, start, latlon)
    _add_tracks(ds, outcomes, listed, times, later if lagged else np.zeros(count), latlon)
    return ds


def _text(value: Any) -> str:
    """Return a value that is no number as experiment files have it."""
    return json.dumps(value) if isinstance(value, bool | list | tuple | dict) else str(value)


def _listed(outcome: Outcome) -> list[int]:
    """Return the rows of the fragments that the tables hold, in order of birth."""
    table = outcome.fragments
    rows = range(len(table.get("number", ())))
    if len(rows) <= MOST_LISTED:
        return list(rows)
    # Bergs of the start come first, then the largest.
    by_size = sorted(rows, key=lambda k: (table["parent"][k] != 0.0, -table["area"][k]))
    return sorted(by_size[:MOST_LISTED])


def varied_values(member: xr.Dataset) -> dict[str, Any]:
    """Return the varied inputs of one member of a result, by ``group.name``."""
    names = {str(coord.attrs["parameter"]): coord for coord in member.coords.values() if "parameter" in coord.attrs}
    if variable_name(SEED) in member.coords:
        names.setdefault(SEED, member[variable_name(SEED)])
    return {name: coord.item() for name, coord in names.items()}


def variable_name(name: str) -> str:
    """Return the name of the variable of a parameter: ``fracture_normal_strength``."""
    return name.replace(".", "_")


def _add_ends(
    ds: xr.Dataset, outcomes: Mapping[int, Outcome], later: Floats, start: datetime, needed: Sequence[str]
) -> None:
    """Add how the members ended; ``later``: how much later than the first each begins, s."""
    count = later.size
    status = np.full(count, STATUS["waiting"], dtype="i4")
    message = np.full(count, "", dtype=object)
    means = [name for name in MEANS if name in needed or any(name in o.totals for o in outcomes.values())]
    values = {name: np.full(count, np.nan) for name in ("wall_time", "first_aground", *TOTALS, *means)}
    births = np.full((2, count), np.nan)
    for number, outcome in outcomes.items():
        status[number], message[number] = STATUS[outcome.status], outcome.message
        for name, column in values.items():
            column[number] = outcome.totals.get(name, np.nan)
        values["wall_time"][number] = outcome.wall_seconds
        *rows, time = (outcome.fragments.get(name, ()) for name in ("number", "parent", "area", "birth_time"))
        born = [time[row] for row in broken_off(zip(*rows, time, strict=True))[:2]]
        births[: len(born), number] = born
    births += later
    large = f" of a piece of {100.0 * SMALL:g} % of its berg or more"
    values["first_aground"] += later
    flags = {"flag_values": np.array(list(STATUS.values()), dtype="i4"), "flag_meanings": " ".join(STATUS)}
    ds["status"] = ("member", status, {"long_name": "how the member ended", **flags})
    ds["message"] = ("member", message, {"long_name": "why the member failed or is unfinished"})
    for name, (unit, meaning) in {**TOTALS, **{name: MEANS[name] for name in means}}.items():
        ds[name] = ("member", values[name], {"units": unit, "long_name": meaning})
    for name, seconds, description in (
        ("first_breakup", births[0], f"time of the first break-up{large}, missing where none"),
        ("second_breakup", births[1], f"time of the second break-up{large}, missing where none"),
        ("first_aground", values["first_aground"], "time at which the sea floor first acted, missing where never"),
    ):
        ds[name] = ("member", _dates(seconds, start), {"long_name": description})
    ds["wall_time"] = ("member", values["wall_time"], {"units": "s", "long_name": "wall time of the last attempt"})


def _dates(seconds: Floats, start: datetime) -> np.ndarray[Any, Any]:
    """Return times as dates; NaN as no date."""
    finite = np.isfinite(seconds)
    moments = np.full(seconds.shape, np.datetime64("NaT", "ns"))
    moments[finite] = np.datetime64(start, "ns") + (seconds[finite] * 1e9).astype("timedelta64[ns]")
    return moments


def _place(latlon: bool) -> dict[str, tuple[str, dict[str, str]]]:
    """Return names and attributes of the two coordinates of a place."""
    if latlon:
        return {
            "lon": ("lon", {"units": "degrees_east", "standard_name": "longitude", "long_name": "longitude"}),
            "lat": ("lat", {"units": "degrees_north", "standard_name": "latitude", "long_name": "latitude"}),
        }
    return {
        "lon": ("x", {"units": "m", "standard_name": "projection_x_coordinate", "long_name": "x"}),
        "lat": ("y", {"units": "m", "standard_name": "projection_y_coordinate", "long_name": "y"}),
    }


def _add_fragments(
    ds: xr.Dataset, outcomes: Mapping[int, Outcome], listed: Mapping[int, list[int]], later: Floats, start: datetime,
    latlon: bool,
) -> None:  # fmt: skip
    shape = ds.sizes["member"], ds.sizes["fragment"]
    table = {name: np.full(shape, np.nan) for name in FRAGMENT}
    for number, outcome in outcomes.items():
        for index, row in enumerate(listed[number]):
            for name in FRAGMENT:
                table[name][number, index] = outcome.fragments[name][row]
    dims = ("member", "fragment")
    at = {"coordinates": " ".join(f"fragment_{shown}" for shown, _ in reversed(_place(latlon).values()))}
    about: dict[str, str] = {"units": "1", "long_name": "number of the fragment in its member", **at}
    ds["fragment_number"] = (dims, table["number"], about)
    for name, (unit, meaning) in _ABOUT.items():
        ds[f"fragment_{name}"] = (dims, table[name], {"units": unit, "long_name": meaning, **at})
    birth = {"long_name": "time at which the fragment broke off; the start for a berg that was there", **at}
    ds["fragment_birth_time"] = (dims, _dates(table["birth_time"] + later[:, None], start), birth)
    for name, (shown, about) in _place(latlon).items():
        ds[f"fragment_{shown}"] = (dims, table[name], {**about, "long_name": f"{about['long_name']} at birth"})


TRACK: Final = {
    "area": ("m2", "plan area of the fragment"),
    "aground": ("1", "1 where an element of the fragment is aground"),
    "azimuth": ("degree", "long axis, clockwise from north, 0 to 180"),
    "stress_ratio_so_far": ("1", "largest stress over strength of a bond so far, until the first break-up"),
    "elongation": ("1", "length over width, of the second moments of the fragment"),
    "stress_ratio_again": ("1", "the same since the first break-up, until the second; 0 before"),
}
"""Columns of tracks after the place, in the order of `Outcome.track`: unit and meaning."""

OF_MEMBER: Final = ("stress_ratio_so_far", "stress_ratio_again")
"""Those that are one number of all fragments of a member."""


def _add_tracks(
    ds: xr.Dataset, outcomes: Mapping[int, Outcome], listed: Mapping[int, list[int]], times: Floats, later: Floats,
    latlon: bool,
) -> None:  # fmt: skip
    axes = list(_place(latlon).values())
    about = {**dict(axes), **{name: {"units": unit, "long_name": meaning} for name, (unit, meaning) in TRACK.items()}}
    if not latlon:
        about["x"]["comment"] = GOES_ON
    for name in set(TRACK) - set(OF_MEMBER):
        about[name]["coordinates"] = f"{axes[1][0]} {axes[0][0]}"
    dims = {name: ("member", "time") if name in OF_MEMBER else ("member", "fragment", "time") for name in about}
    tracks = {name: np.full([ds.sizes[dim] for dim in dims[name]], np.nan) for name in about}
    interval = times[1] if len(times) > 1 else 1.0
    for number, outcome in outcomes.items():
        if not outcome.track:
            continue
        rows = np.array(outcome.track)
        place_of = {outcome.fragments["number"][row]: index for index, row in enumerate(listed[number])}
        at = np.array([place_of.get(fragment, -1) for fragment in rows[:, 1].tolist()])
        k = np.rint((rows[:, 0] + later[number]) / interval).astype(int)
        valid = (at >= 0) & (k >= 0) & (k < len(times))
        for name, column in zip(about, rows[valid, 2:].T, strict=True):
            tracks[name][(number, k[valid]) if name in OF_MEMBER else (number, at[valid], k[valid])] = column
    for name, values in tracks.items():
        ds[name] = (dims[name], values, about[name])


def write_sweep(ds: xr.Dataset, path: str | Path, *, more: bool = False) -> Path:
    """Write the result of a sweep: NetCDF, or Zarr where the name ends so (with the extra ``products``).

    ``more``: add its variables to those that are in the file.
    """
    path = Path(path)
    encoding = _encoding(ds)
    if path.suffix == ".zarr":
        dates = {name: value for name, value in encoding.items() if "calendar" in value}
        # Texts of a fixed length, as a file gives them back, have no place in the standard of Zarr.
        texts = {name: ds[name].astype(object) for name in ds.variables if ds[name].dtype.kind == "U"}
        ds.assign(texts).drop_encoding().to_zarr(path, mode="w", encoding=dates, consolidated=False)
        return path
    write_dataset(ds, path, encoding=encoding, more=more)
    return path


def longest_text(members: Iterable[Mapping[str, Any]]) -> int:
    """Return the length (bytes) of the longest text among the values of members."""
    return max((len(_text(value).encode()) for member in members for value in member.values()), default=1)


def write_blocks(blocks: Iterable[xr.Dataset], path: Path, width: int) -> None:
    """Write the result of a sweep from blocks of its members, one after another; ``width``: bytes of the longest text."""
    for k, block in enumerate(blocks):
        ds = fixed_texts(block, width)
        if k == 0:
            write_dataset(ds, path, encoding=_in_chunks(ds), unlimited_dims=["member"])
            continue
        zero = ds["time"].values[0]
        with open_netcdf(path, "a") as file:
            first = len(file.dimensions["member"])
            file.set_auto_chartostring(False)
            for name, variable in ds.variables.items():
                if "member" in variable.dims:
                    values = variable.values
                    if values.dtype.kind == "S":
                        values = np.ascontiguousarray(values).view("S1").reshape(len(values), -1)
                    if values.dtype.kind == "M":  # as `_encoding` says
                        values = np.where(np.isnat(values), np.nan, (values - zero) / np.timedelta64(1, "s"))
                    file[str(name)][first : first + len(values)] = values


CHUNK_BYTES: Final = 1_000_000
"""Size of what is read and packed at once. One member each, as netCDF has it by itself, makes 10,000 chunks of each variable."""


def _in_chunks(ds: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return how a result is written whose members are added later: several of them in one chunk."""
    encoding = _encoding(ds)
    for name, variable in ds.variables.items():
        if "member" in variable.dims:
            shape = [variable.sizes[dim] for dim in variable.dims if dim != "member"]
            per_chunk = max(1, CHUNK_BYTES // (8 * max(int(np.prod(shape)), 1)))
            sizes = tuple(
                min(per_chunk, 250) if dim == "member" else max(variable.sizes[dim], 1) for dim in variable.dims
            )
            if variable.dtype.kind == "S":
                sizes = (*sizes, variable.dtype.itemsize)
                encoding.setdefault(str(name), {}).update(zlib=True, complevel=1)
            encoding.setdefault(str(name), {})["chunksizes"] = sizes
    return encoding


def _encoding(ds: xr.Dataset) -> dict[str, dict[str, Any]]:
    start = ds["time"].values[0] if "time" in ds else ds["init"].values
    about = {**time_units(start), "dtype": "float64"}
    encoding: dict[str, dict[str, Any]] = {
        str(name): dict(about) for name, variable in ds.variables.items() if variable.dtype.kind == "M"
    }
    for name, variable in ds.variables.items():
        if (
            name in ds.coords and name in ds.dims
        ):  # without missing values, and so without a number that stands for one (CF, 2.5.1)
            encoding.setdefault(str(name), {})["_FillValue"] = None
        elif name not in ds.coords and variable.dtype.kind == "f":
            encoding[str(name)] = {"zlib": variable.ndim > 1, "complevel": 1, "_FillValue": np.nan}
    return encoding


def open_sweep(path: str | Path, *, tracks: bool = True) -> xr.Dataset:
    """Open the result of a sweep.

    Parameters
    ----------
    path : path
        ``sweep.nc``, ``sweep.zarr`` or ``forecast.nc``, or the folder that holds it.
    tracks : bool, optional
        Read tracks and tables of fragments too; otherwise they stay in the file until they are used, for ensembles of
        thousands.

    Returns
    -------
    xarray.Dataset
        In memory, with dimensions ``member``, ``fragment`` and ``time``.

    Raises
    ------
    InputError
        If it is none.
    """
    ds: xr.Dataset
    required(path, (str, Path), "the path of a sweep.nc, or of its folder", where="open_sweep")
    path = Path(path)
    remedy = "Name a folder that 'riftberg sweep' made"
    if path.suffix == ".zarr":
        with reading(path, "not readable as Zarr", remedy):
            ds = xr.open_zarr(path, consolidated=False).load()
    else:
        file = path / ("forecast.nc" if (path / "forecast.nc").exists() else "sweep.nc") if is_folder(path) else path
        check_file(file, remedy=remedy)
        ds = _loaded(file, remedy) if tracks else _without_tracks(file, remedy)
    if "member" not in ds.dims or "status" not in ds:
        raise InputError("not the result of a sweep", where=str(path), remedy=remedy)
    return ds


def open_cells(path: str | Path, kind: str = "monthly") -> xr.Dataset:
    """Open the gridded output of the members of a sweep (``cells``).

    Parameters
    ----------
    path : path
        The folder of the sweep.
    kind : {"monthly", "instantaneous"}, optional
        Which of the files of each member.

    Returns
    -------
    xarray.Dataset
        In memory, with dimensions ``member``, ``time``, ``lat``, ``lon`` (and ``process``) on all cells that any member has; 0
        where a member has no bergs. Where the members are parts of one population, ``.sum("member")`` is the whole.

    Raises
    ------
    InputError
        If the folder holds none.
    """
    required(path, (str, Path), "the folder of a sweep", where="open_cells")
    if kind not in ("monthly", "instantaneous"):
        raise InputError(f"{kind!r}", where="open_cells, kind", remedy="Give monthly or instantaneous")
    ending = f"-{kind}.nc"
    by_number = {int(file.name.removesuffix(ending)): file for file in (Path(path) / CELLS).glob(f"*{ending}")}
    numbers, files = sorted(by_number), [by_number[number] for number in sorted(by_number)]
    if not files:
        raise InputError(
            f"holds no {kind} files of members on cells", where=str(path), remedy="Sweep with --cells, or cells=0.25"
        )
    members = [_on_axes(file) for file in files]
    shared = xr.merge(
        [xr.Dataset({"areacello": ds["areacello"].isel(lon=0, drop=True), "time_bnds": ds["time_bnds"]}) for ds in members],
        join="outer", compat="no_conflicts",
    )  # fmt: skip
    fields = xr.align(*(ds.drop_vars(["areacello", "time_bnds"]) for ds in members), join="outer", fill_value=0.0)
    combined: xr.Dataset = xr.concat(fields, dim="member")
    return combined.assign_coords(member=numbers, areacello=shared["areacello"], time_bnds=shared["time_bnds"])


def _on_axes(file: Path) -> xr.Dataset:
    """Return a file of one member with its cells, which are regular, on axes."""
    ds = _loaded(file, "Do the member again")
    lon, lat = ds["lon"].isel(j=0).variable, ds["lat"].isel(i=0).variable
    ds = ds.drop_vars(["lon", "lat"]).rename(i="lon", j="lat")
    return ds.assign_coords(lon=("lon", lon.values, lon.attrs), lat=("lat", lat.values, lat.attrs))


def _loaded(file: Path, remedy: str) -> xr.Dataset:
    """Return a NetCDF file in memory."""
    with reading(file, "not readable as NetCDF", remedy):
        ds: xr.Dataset = open_lazily(file).load()
        ds.close()
    return ds


def _without_tracks(file: Path, remedy: str) -> xr.Dataset:
    """Return a result in memory but for its tracks and tables of fragments."""
    with reading(file, "not readable as NetCDF", remedy), _small_chunk_cache():
        ds: xr.Dataset = open_lazily(file)
        for name, variable in ds.variables.items():
            if "member" not in variable.dims or variable.ndim == 1:
                ds[name].load()
    return ds


@contextmanager
def _small_chunk_cache() -> Iterator[None]:
    """Let files that are opened meanwhile cache one chunk of each variable; the default of netCDF is 16 MB of each."""
    previous_cache = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(2 * CHUNK_BYTES, *previous_cache[1:])
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*previous_cache)
