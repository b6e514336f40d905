"""Opening of files, lazily, and the way of one file through a product to the canonical dataset."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Hashable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.dates import stated_interval, told_kind
from riftberg.products.fields import gathered, of_member
from riftberg.products.place import tidy_axes
from riftberg.products.product import Product, noted
from riftberg.products.records import REMARKS
from riftberg.products.repair import REPAIRS, with_text_dates, within_valid_range
from riftberg.system.input_files import check_file, is_address, is_folder, reading
from riftberg.system.netcdf_lock import noted_as_open, open_lazily, whole_size
from riftberg.system.process import SETTINGS, own_filters

CHUNK = "16MiB"
COORDINATES: Final[dict[str, dict[str, str]]] = {
    "lon": {"standard_name": "longitude"},
    "lat": {"standard_name": "latitude"},
    "time": {"standard_name": "time"},
    "depth": {"standard_name": "depth", "positive": "down"},
}
"""Coordinates that a user may name beside the quantities, and what the variable then says of itself."""

_OPENINGS = (
    (
        b"PK\x03\x04",
        "a zip archive",
        "Unzip it and give the .nc files or the .zarr folder inside (the Climate Data Store packs one per kind of step)",
    ),
    (b"\x1f\x8b", "a gzip file", "Unpack it first: gunzip FILE"),
    (b"GRIB", "a GRIB file", "Convert it: grib_to_netcdf or cdo -f nc copy, or ask the service for netCDF"),
    (
        b"version https://git-lfs",
        "a Git LFS pointer, not the data",
        "Fetch the data itself: riftberg fetch, or git lfs pull",
    ),
    (
        b"<",
        "a web page, not data",
        "The download met a login or error page: log in to the data centre and fetch it again",
    ),
)
_NETCDF = (b"CDF", b"\x89HDF")


BUCKETS: Final = ("s3://", "gs://")
"""Beginnings of addresses at which nothing but stores can be opened."""

REFERENCES: Final = (".json", ".parq", ".parquet")
"""Endings of kerchunk's references to files elsewhere, which its own engine of xarray opens."""

_MARKS = (".zgroup", ".zmetadata", "zarr.json")
"""Files that every Zarr store has."""


def is_zarr(path: str) -> bool:
    """Tell whether ``path`` names a Zarr store (a folder, a zip of one, or an address)."""
    if is_address(path):
        return ".zarr" in path or path.startswith(BUCKETS)
    place = Path(path)
    if place.is_file():
        return _zipped(path) is not None
    return place.suffix == ".zarr" or any((place / mark).exists() for mark in _MARKS)


def _zipped(path: str) -> str | None:
    """Return the folder inside a zip archive in which a Zarr store lies, "" for the archive itself; None if there is none."""
    if not zipfile.is_zipfile(path):
        return None
    with zipfile.ZipFile(path) as archive:
        marks = [name for name in archive.namelist() if name.rpartition("/")[2] in _MARKS]
    return min(marks, key=lambda name: name.count("/")).rpartition("/")[0] if marks else None


def check_readable(path: str) -> None:
    """Raise `ForcingError` with a remedy unless ``path`` is a file that looks like netCDF."""
    file = Path(path)
    if is_folder(file):
        raise ForcingError("this is a folder", where=path, remedy="Give its files, for example FOLDER/*.nc")
    check_file(path, remedy="Check the name and the folder", kind=ForcingError, missing="the file does not exist")
    with file.open("rb") as stream:
        head = stream.read(64)
    for opening, what, remedy in _OPENINGS:
        if head.lstrip().startswith(opening):
            raise ForcingError(f"this is {what}", where=path, remedy=remedy)
    if (whole := whole_size(path)) is not None and whole > file.stat().st_size:
        raise ForcingError(
            f"the file is cut short: {file.stat().st_size} of {whole} bytes are there",
            where=path,
            remedy="Fetch or copy it again",
        )
    if not head.startswith(_NETCDF):
        raise ForcingError(
            "this is not a netCDF file", where=path, remedy="Give netCDF or Zarr; the file may be cut or damaged"
        )


def open_raw(path: str, *, chunked: bool = True) -> xr.Dataset:
    """Open a file or Zarr store without decoding anything, lazily; text variables are left out."""
    opened = _open(path)
    ds = with_text_dates(opened)
    text = [name for name, variable in ds.variables.items() if variable.dtype.kind in "OSU" and variable.ndim]
    if chunked and find_spec("dask") is not None:
        import dask

        with SETTINGS, dask.config.set({"array.chunk-size": CHUNK}):
            written = {name: ds.variables[name] for name in ds.encoding.get("written", ())}
            noted = ds.encoding.get("texts", {})
            opened.close()
            ds = _open(path, chunks="auto", drop_variables=[*text, *written]).assign(written)
            ds.encoding["texts"] = noted
    else:
        ds = ds.drop_vars(text)
    ds.encoding["source"] = path
    return ds


def _open(path: str, **options: Any) -> xr.Dataset:
    if is_zarr(path):
        if find_spec("zarr") is None:
            raise ForcingError("Zarr is not installed", where=path, remedy="pip install 'riftberg[products]'")
        if path.startswith("gs://"):
            options["storage_options"] = {"token": "anon"}
        return _open_store(path, options)
    remedy = "The file may be no forcing file, or be cut short or damaged: then fetch it again and compare its size"
    if path.endswith(REFERENCES):
        if find_spec("kerchunk") is None:
            raise ForcingError("kerchunk, which reads references, is not installed", where=path,
                               remedy="pip install kerchunk")  # fmt: skip
        options["engine"] = "kerchunk"
    elif is_address(path):
        remedy = (
            "Check the address and the network. An address must speak OPeNDAP (of a THREDDS server that with /dodsC/ in place of "
            "/fileServer/) or be a Zarr store (.zarr); other files are downloaded first"
        )
    else:
        check_readable(path)
    with reading(path, "cannot be opened", remedy, ForcingError):
        return open_lazily(path, decode_cf=False, **options)


def _open_store(path: str, options: dict[str, Any]) -> xr.Dataset:
    if is_address(path):
        remedy = "Check the address and the network; http:// needs pip install aiohttp, s3:// s3fs, gs:// gcsfs"
    elif Path(path).exists():
        remedy = "The folder is not a Zarr store, or an incomplete one: fetch or write it again"
    else:
        remedy = "Check the name and the folder"
    with own_filters(), reading(path, "the store cannot be opened", remedy, ForcingError):
        # A store without consolidated metadata opens more slowly, which is no fault of the reader.
        warnings.filterwarnings("ignore", message="Failed to open Zarr store with consolidated metadata")
        # Listing a store of the second format, zarr-python stumbles over that format's own marks.
        warnings.filterwarnings("ignore", message=r"Object at \.z\w+ is not recognized")
        place: Any = path
        if not is_address(path) and Path(path).is_file():
            from zarr.storage import ZipStore

            place = ZipStore(path, mode="r")
            options = {"group": _zipped(path) or None, "consolidated": False, **options}
        return noted_as_open(xr.open_zarr(place, decode_cf=False, **{"chunks": None, **options}))


def read(path: str, product: Product) -> list[xr.Dataset]:
    """Read one file of ``product`` into canonical datasets, lazily: one for each grid and set of dates in it."""
    remedy = "The file may be damaged, or of a layout that is not known: look at it with ncdump -h"
    with reading(path, f"cannot be read as {product.name}", remedy, ForcingError):
        return canonical_parts(open_raw(path), product, path)


def canonical_parts(raw: xr.Dataset, product: Product, path: str) -> list[xr.Dataset]:
    """Return what `read` does of a dataset that is open already, decoded or not."""
    for repair in REPAIRS:
        raw = repair(raw, path)
    raw = _with_named_coordinates(raw, product.names)
    decoded = _decoded(product.mend(raw))
    if product.member is not None:
        decoded = of_member(decoded, product.member)
    ds = product.reshape(within_valid_range(decoded))
    ds.encoding["source"] = path
    # The undecoded heading says these: decoding takes units and bounds out of the attributes.
    stated, kind = stated_interval(raw, path), told_kind(raw, path) if product.kind_matters else ""
    parts = []
    for part in gathered(ds, product, where=path):
        part = noted(tidy_axes(part, where=path), told=kind)
        if "time" in part.dims and stated:
            part = part.assign_attrs(stated_seconds=stated)
        part = product.finish(part)
        kept = ("crs_wkt", "stated_seconds", "longest_step", "means", *REMARKS)
        averaging = part.attrs.get("averaging_seconds", product.averaging / np.timedelta64(1, "s"))
        part = part.copy(deep=False)
        part.attrs = {
            "Conventions": "CF-1.11",
            "product": product.name,
            "title": product.title,
            "source": path,
            "citation": product.citation,
            "reader_checked_against": product.checked(part.data_vars),
            "averaging_seconds": float(averaging),
            "history": f"read by riftberg as {product.name}; {raw.attrs.get('history', '')}".rstrip("; "),
            **{key: part.attrs[key] for key in kept if key in part.attrs},
        }
        parts.append(part)
    return parts


def _decoded(raw: xr.Dataset) -> xr.Dataset:
    """Return the file with packing, fill values and dates decoded; that is xarray's work."""

    def decode(ds: xr.Dataset) -> xr.Dataset:
        decoded = xr.decode_cf(ds, decode_timedelta=False)
        decoded.encoding.update(ds.encoding)
        return decoded

    with own_filters():
        warnings.filterwarnings("ignore", message="Ambiguous reference date string", category=xr.SerializationWarning)
        # Only dates that pandas cannot hold come back as cftime objects.
        warnings.filterwarnings("ignore", message="Unable to decode time axis", category=xr.SerializationWarning)
        warnings.filterwarnings("ignore", message=".*has multiple fill values", category=xr.SerializationWarning)
        warnings.filterwarnings("ignore", category=FutureWarning)
        try:
            return decode(raw)
        except (ValueError, OverflowError):
            # Dates that cannot be decoded are reported where they matter; the rest of the file is read, other dates too.
            counting = {n: v for n, v in raw.variables.items() if " since " in str(v.attrs.get("units", ""))}
            kept = {n: v.attrs for n, v in counting.items() if not _decodes(n, v)}
            bare = {n: {key: value for key, value in attrs.items() if key != "units"} for n, attrs in kept.items()}
            return _with_attributes(decode(_with_attributes(raw, bare)), kept)


def _with_named_coordinates(raw: xr.Dataset, names: Mapping[str, str]) -> xr.Dataset:
    """Return a file that says of each coordinate a user names what it is."""
    said = {names[key]: attrs for key, attrs in COORDINATES.items() if names.get(key) in raw.variables}
    levels = names.get("depth")
    if (
        levels in raw.variables and levels not in raw.dims and raw[levels].ndim == 2
    ):  # levels lie along one dimension, or change in place
        raise ForcingError(
            f"{levels} is a map, but depth names the levels of a field", where="names, depth",
            remedy=f"The depth of the sea floor is depth_below_surface: {levels}",
        )  # fmt: skip
    return _with_attributes(raw, {name: {**raw[name].attrs, **attrs} for name, attrs in said.items()}) if said else raw


def _decodes(name: Hashable, variable: xr.Variable) -> bool:
    try:
        xr.decode_cf(xr.Dataset({name: variable}), decode_timedelta=False)
    except (ValueError, OverflowError):
        return False
    return True


def _with_attributes(ds: xr.Dataset, attributes: Mapping[Hashable, dict[str, Any]]) -> xr.Dataset:
    """Return the dataset with other attributes of some variables; what was decoded into the encoding stays there."""
    changed = ds.copy()
    for name, attrs in attributes.items():
        decoded = {key for key in attrs if key in changed.variables[name].encoding}
        changed.variables[name].attrs = {key: value for key, value in attrs.items() if key not in decoded}
    return changed
