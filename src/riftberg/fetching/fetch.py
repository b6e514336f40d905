"""Fetching of data without a login: inputs of the A68a paper from its public repository, databases of named Antarctic bergs.

`fetch_product` (of `riftberg.fetching.services`) fetches original products from the services that hold them.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.fetching.download import (
    Progress,
    Resuming,
    checksum,
    fetch_one,
    is_pointer,
    made,
    show_progress,
    unpacked,
)
from riftberg.fetching.services import fetch_product
from riftberg.system.atomic_files import only_writer, refusal, replacing, write_text
from riftberg.system.input_files import value_shown
from riftberg.system.netcdf_lock import open_lazily, open_netcdf

__all__ = ["BASE_URL", "FILES", "HOURLY", "Hourly", "check_hourly", "fetch_a68a", "fetch_product", "merge_hourly"]

COMMIT = "b0bfa8332a4592aaa375620d812dcae1dcc224d6"
BASE_URL = f"https://raw.githubusercontent.com/alex-huth/iKID_iceberg_A68a/{COMMIT}/"
"""Public repository of the paper's A68a experiment (data files only are fetched), at a fixed commit."""

LARGE_FILES_URL = f"https://media.githubusercontent.com/media/alex-huth/iKID_iceberg_A68a/{COMMIT}/"
"""Where that repository keeps what its tree holds as Git LFS pointers."""

_DATA = "tests/a68/data/"

FILES: dict[str, str | None] = {
    f"{_DATA}a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc": (
        "52c650ffb155941371e117034d0008cc5b365374000f897dcb23ef828cd13368"
    ),
    f"{_DATA}a68_experiment_gebco_ll_p125.nc": "4bf31e8b2cdd6f8de9e3506f1700e2f5ace8aa9b10ffdc3f3d569f1f4eab250c",
    f"{_DATA}a68_experiment_ll_p125_grid.nc": "49cca30bc510180e27af095bf079173c3fadc7203d29a9769e2059ca2bfe077e",
    f"{_DATA}a68_experiment_ocean_surf_and_mean_vel_fixed_oras5_dec2020_ll_p125.nc": (
        "e00538bdf4f4ca4dc2bd4460cdf0a105207addf36c0b42c53b23596cda05a29e"
    ),
    f"{_DATA}a68_experiment_ssh_oras5_dec2020_ll_p125.nc": (
        "49cbbfa7f71a10ea0f95ef47c0b3a1912568886f4ea5c93557e82ee2cded7478"
    ),
    f"{_DATA}a68_experiment_wind_stress_oras5_dec2020_ll_p125.nc": (
        "ea476c476b6802c95cc393d1044e78bb914cadccf9b7081b379528f67a1a1656"
    ),
    f"{_DATA}a68_experiment_wind_vel_jra55_dec2020_ll_p125.nc": (
        "5161ab402b26382da97609b7751535c6e1c8953b3a030374330f6213e8bbf4af"
    ),
    "tests/a68/INPUT/icebergs.res.nc": "3c4fd2ac29422d0ae07ff109ddb6315277c0b446c701084a80a22e8d1a14273c",
}
"""Small files of the experiment and their sha256."""


@dataclass(frozen=True)
class Hourly:
    """One hourly field of the paper, kept in the repository as eight parts without checksums."""

    stem: str  # Name of the parts before their number
    merged: str  # Name of the file made from them
    variables: tuple[str, ...]  # Fields that it must hold
    records: int  # Hours that it must hold
    limit: float  # Largest magnitude that is believable (m s-1 or m)
    split_files: int = 8

    @property
    def names(self) -> list[str]:
        """Addresses of the parts below the base address."""
        return [f"{_DATA}split_files/{self.stem}{number:06d}.nc" for number in range(self.split_files)]


HOURLY: tuple[Hourly, ...] = (
    Hourly("ocean", "a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc", ("uo", "vo"), 744, 5.0),
    Hourly("ssh", "a68_experiment_ssh_duacs_dec2020_HOURLY_ll_p125.nc", ("SSH",), 744, 10.0),
    Hourly("wind", "a68_experiment_wind_vel_ncep_10m_dec2020_HOURLY_ll_p125.nc", ("ua", "va"), 739, 80.0),
)
"""The paper's hourly forcing: OSCAR currents, DUACS sea level, NCEP wind, December 2020."""


def fetch_a68a(
    folder: str | Path,
    *,
    base_url: str = BASE_URL,
    large_files_url: str = LARGE_FILES_URL,
    hourly: Sequence[Hourly] = HOURLY,
    files: dict[str, str | None] | None = None,
    progress: Progress | bool = True,
) -> list[Path]:
    """Fetch the inputs of the A68a experiment of Huth et al. (2022); about 1.3 GB, resumed if cut."""
    folder = made(Path(folder))
    registry = FILES if files is None else files
    with show_progress(progress) as show:
        downloader = Resuming(show, large_files=lambda url: url.replace(base_url, large_files_url))
        fetched = [fetch_one(name, digest, folder, base_url, downloader) for name, digest in registry.items()]
        fetched += [_fetch_hourly(field, folder, base_url, downloader) for field in hourly]
    return fetched


def _fetch_hourly(field: Hourly, folder: Path, base_url: str, downloader: Resuming) -> Path:
    """Fetch the parts of an hourly field, merge them and check the result."""
    target = folder / field.merged
    if target.exists() and is_pointer(target):  # from a copy of the repository without its large files
        target.unlink()
    if target.exists():
        check_hourly(target, field)
        return target
    with only_writer(target):
        files = [fetch_one(name, None, folder, base_url, downloader) for name in field.names]
        merge_hourly(files, target, field)
    for file in files:
        file.unlink()
    return target


def merge_hourly(files: Sequence[Path], target: Path, field: Hourly) -> None:
    """Join the parts of an hourly field in order of time, check them, and write one file."""
    with replacing(target) as temporary:
        try:
            _join(_in_order(files), temporary)
        except (OSError, RuntimeError) as error:  # the latter is how the NetCDF library tells of a full disk
            remedy = "Free some space, or choose another folder: the parts are kept"
            raise ForcingError(f"could not be written ({refusal(error)})", where=str(target), remedy=remedy) from error
        check_hourly(temporary, field)


def _in_order(files: Sequence[Path]) -> list[Path]:
    """Return the parts in order of their first hour, or as given where they have no stamps; broken ones are removed."""
    begins = []
    for file in files:
        try:
            with open_netcdf(file) as ds:
                records = len(ds.dimensions["time"]) if "time" in ds.dimensions else 0
                begins.append(float(ds["time"][0]) if records and "time" in ds.variables else 0.0)
        except (OSError, RuntimeError) as error:
            raise _damaged(file) from error
        if not records:
            remedy = "The source has changed: do not use the data"
            raise ForcingError("this part has no records", where=str(file), remedy=remedy)
    return [file for _, file in sorted(zip(begins, files, strict=True), key=lambda pair: pair[0])]


def _damaged(file: Path) -> ForcingError:
    """Remove a part that cannot be read, and return the error that says so."""
    file.unlink()
    remedy = "It was removed: run the same command again"
    return ForcingError("this part is damaged", where=str(file), remedy=remedy)


def _join(files: Sequence[Path], target: Path) -> None:
    """Copy parts one behind the other, without decoding, holding one part in memory at a time; texts are left out.

    Of texts of any length, such as the version of each hour, other programs die that compare two of our files.
    """
    with open_netcdf(target, "w", format="NETCDF4") as out:
        for file in files:
            with open_netcdf(file) as ds:
                ds.set_auto_maskandscale(False)
                if not out.dimensions:
                    _copy_header(ds, out)
                first = len(out.dimensions["time"])
                for name, variable in _numbers(ds).items():
                    if "time" in variable.dimensions:
                        try:
                            values = variable[...]
                        except (OSError, RuntimeError) as error:
                            raise _damaged(file) from error
                        out[name][first : first + len(ds.dimensions["time"])] = values


def _numbers(ds: netCDF4.Dataset) -> dict[str, netCDF4.Variable[Any]]:
    return {name: variable for name, variable in ds.variables.items() if variable.dtype is not str}


def _copy_header(ds: netCDF4.Dataset, out: netCDF4.Dataset) -> None:
    """Copy dimensions (time unlimited), attributes, variables and the values that do not change in time."""
    out.setncatts({name: ds.getncattr(name) for name in ds.ncattrs()})
    for name, dimension in ds.dimensions.items():
        out.createDimension(name, None if name == "time" else len(dimension))
    for name, variable in _numbers(ds).items():
        attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
        fill = attributes.pop("_FillValue", None)
        copy = out.createVariable(name, variable.dtype, variable.dimensions, fill_value=fill)
        copy.setncatts(attributes)
        copy.set_auto_maskandscale(False)
        if "time" not in variable.dimensions:
            copy[...] = variable[...]


def check_hourly(path: Path, field: Hourly) -> None:
    """Raise `ForcingError` unless a merged file holds the hours and values that the paper's forcing has."""
    remedy = "Delete it and fetch again; if it stays wrong, the source has changed"
    try:
        ds = open_lazily(path, decode_times=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]  # what follows is advice on packages, which would not help here
        raise ForcingError(f"cannot be read ({reason})", where=str(path), remedy=remedy) from error
    with ds:
        missing = [name for name in field.variables if name not in ds.data_vars]
        if missing:
            raise ForcingError(f"lacks {', '.join(missing)}", where=str(path), remedy=remedy)
        if ds.sizes.get("time") != field.records:
            hours = ds.sizes.get("time", 0)
            raise ForcingError(f"holds {hours} records instead of {field.records}", where=str(path), remedy=remedy)
        _check_hours(ds, path, remedy)
        for name in field.variables:
            _check_range(ds[name], field.limit, path, remedy)


def _check_hours(ds: xr.Dataset, path: Path, remedy: str) -> None:
    """Check that the stamps, where there are any, ascend evenly."""
    if "time" in ds.coords and ds["time"].dtype.kind in "iuf":
        steps = np.diff(ds["time"].values.astype(float))
        usual = float(np.median(steps)) if steps.size else 0.0
        # Half a step of slack: stamps in single precision are rough, a missing part is not.
        if steps.size and not (usual > 0.0 and np.all(np.abs(steps - usual) < 0.5 * usual)):
            raise ForcingError(
                "its hours are not evenly spaced: a part is missing or doubled", where=str(path), remedy=remedy
            )


def _check_range(data: xr.DataArray, limit: float, path: Path, remedy: str) -> None:
    """Check values day by day, so that a large file needs little memory."""
    lowest, highest = np.inf, -np.inf
    for start in range(0, data.sizes["time"], 24):
        block = data.isel(time=slice(start, start + 24)).values
        lowest, highest = min(lowest, float(np.nanmin(block))), max(highest, float(np.nanmax(block)))
    if not (-limit <= lowest <= highest <= limit) or lowest == highest:
        fault = f"{data.name} runs from {lowest:g} to {highest:g}; within +-{limit:g} and not constant is right"
        raise ForcingError(fault, where=str(path), remedy=remedy)


# Positions of named Antarctic bergs.

LARGEST_ZIP: Final = 200e6
"""Bytes that a database may have when it is unpacked: a thousand tables have 40 MB."""


@dataclass(frozen=True)
class PositionSource:
    """Where positions come from."""

    title: str
    base: str  # Address
    name: str  # File below it
    tried: str  # What of it has been read here


SOURCES: Final = {
    "byu": PositionSource(
        "BYU/NIC consolidated database (Budge and Long 2018)", "https://www.scp.byu.edu/data/iceberg/",
        "consolidated_database_v8.0.zip", "version 5 was read; version 8, which is fetched, was not tried",
    ),
    "usnic": PositionSource(
        "US National Ice Center, current week", "https://usicecenter.gov/File/", "DownloadCurrent?pId=134", "not tried"
    ),
}  # fmt: skip
"""Sources by the name that ``riftberg fetch`` takes."""


def fetch_positions(database: str, folder: str | Path, *, progress: Progress | bool = True) -> list[Path]:
    """Fetch a database of positions; returns its tables."""
    source, folder = SOURCES[database], made(Path(folder))
    with show_progress(progress) as show:
        path = fetch_one(source.name, None, folder, source.base, Resuming(show), renew=True)
    with path.open("rb") as stream:
        return unpack_tables(path, folder) if stream.read(2) == b"PK" else [path]


PLAIN_NAME: Final = re.compile(r"\w[\w ().+-]{0,99}")
"""Names of files that every system can have, and a terminal show."""


def _unpacked_before(record: Path) -> dict[str, str]:
    """Return the checksums of the tables that were unpacked before; none where the record is damaged: then all are the user's."""
    try:
        written = json.loads(record.read_text())
    except (OSError, ValueError):
        return {}
    return written if isinstance(written, dict) else {}


def unpack_tables(path: Path, folder: Path) -> list[Path]:
    """Unpack the tables of a database, all into one folder; a file there that it did not unpack before is not touched."""
    record = folder / f".{path.name}.json"
    written = _unpacked_before(record)
    tables: dict[Path, bytes] = {}
    for name, content in unpacked(path, ".csv", LARGEST_ZIP):
        target = folder / Path(name.replace("\\", "/")).name.lower()
        if not PLAIN_NAME.fullmatch(target.name):
            fault = f"the archive holds {value_shown(target.name)}, which is no name for a file"
            raise ForcingError(fault, where=str(path), remedy="Unpack it by hand, under another name")
        if target in tables:
            remedy = "Unpack it by hand, into several folders"
            raise ForcingError(f"the archive holds {target.name} twice", where=str(path), remedy=remedy)
        exists = target.is_symlink() or target.exists()
        if exists and (
            target.is_symlink()
            or not target.is_file()
            or checksum(target) not in (written.get(target.name), hashlib.sha256(content).hexdigest())
        ):
            remedy = "Move it away, or name another folder"
            raise ForcingError(
                "is there already, and is another file than the archive's", where=str(target), remedy=remedy
            )
        tables[target] = content
    for target, content in tables.items():
        with replacing(target) as temporary:
            temporary.write_bytes(content)
    write_text(
        record,
        json.dumps({target.name: hashlib.sha256(content).hexdigest() for target, content in tables.items()}) + "\n",
    )
    return list(tables)
