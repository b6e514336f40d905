"""From a file to its canonical fields: opened lazily, decoded, chosen, dated, placed in all three dimensions, in SI units."""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Hashable, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError, nearest
from riftberg.products.cf import (
    NAMED,
    above_ellipsoid,
    by_standard_name,
    find_coordinates,
    find_role,
    is_height,
    misnamed_fields,
    read_units,
    role_by_name,
    standard_name,
    statistic,
    strange_height,
    unread_fields,
)
from riftberg.products.dates import date_field, declared_mean, describe_kind, stated_interval
from riftberg.products.levels import LEVEL, judge_levels, on_depths
from riftberg.products.models import with_static_grid
from riftberg.products.place import place_field, tidy_axes
from riftberg.products.product import Product, noted
from riftberg.products.quantities import QUANTITIES, TO_DIRECTION, canonicalise
from riftberg.products.records import MEAN_OF, REMARKS, VECTORS
from riftberg.products.repair import (
    REPAIRS,
    VALID,
    with_scalar_mappings,
    with_text_dates,
    within_valid_range,
    without_flags,
    without_land,
)
from riftberg.products.sea_ice import true_ice_thickness
from riftberg.products.vectors import COMPONENTS, is_true, with_angle
from riftberg.system.input_files import check_file, hidden, is_address, is_folder, reading, whole_address
from riftberg.system.netcdf_lock import noted_as_open, open_lazily, whole_size
from riftberg.system.process import SETTINGS, own_filters

CHUNK = "16MiB"
"""Size of the parts in which large files are read (dask)."""

WHOLE: Final = 4 * 2**20
"""Bytes up to which a file is read as it is: parts of a small one take longer to keep account of than to read."""

ALL_WHOLE: Final = 128 * 2**20
"""Bytes up to which several files together are read so: they may be converted and joined in memory."""

COORDINATES: Final[dict[str, dict[str, str]]] = {
    "lon": {"standard_name": "longitude", NAMED: "lon"},
    "lat": {"standard_name": "latitude", NAMED: "lat"},
    "time": {"standard_name": "time", NAMED: "time"},
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
    file = Path(path)
    if file.is_file():
        return _zipped(path) is not None
    return file.suffix == ".zarr" or any((file / mark).exists() for mark in _MARKS)


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
    for opening, kind, remedy in _OPENINGS:
        if head.lstrip().startswith(opening):
            raise ForcingError(f"this is {kind}", where=path, remedy=remedy)
    if (full_size := whole_size(path)) is not None and full_size > file.stat().st_size:
        raise ForcingError(
            f"the file is cut short: {file.stat().st_size} of {full_size} bytes are there",
            where=path,
            remedy="Fetch or copy it again",
        )
    if not head.startswith(_NETCDF):
        raise ForcingError(
            "this is not a netCDF file", where=path, remedy="Give netCDF or Zarr; the file may be cut or damaged"
        )


def open_raw(path: str, whole: float = math.inf) -> xr.Dataset:
    """Open a file or Zarr store without decoding anything, lazily; text variables are left out.

    ``whole``: bytes up to which it is read as it is, and not in parts.
    """
    path = hidden(path)
    opened = _open(path)
    ds = with_text_dates(with_scalar_mappings(opened))
    text = [name for name, variable in ds.variables.items() if variable.dtype.kind in "OSU" and variable.ndim]
    if ds.nbytes > whole and find_spec("dask") is not None:
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
        return open_lazily(whole_address(path), decode_cf=False, **options)


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
        store: Any = whole_address(path)
        if not is_address(path) and Path(path).is_file():
            from zarr.storage import ZipStore

            store = ZipStore(path, mode="r")
            options = {"group": _zipped(path) or None, "consolidated": False, **options}
        return noted_as_open(xr.open_zarr(store, decode_cf=False, **{"chunks": None, **options}))


def read(path: str, product: Product, whole: float = WHOLE) -> list[xr.Dataset]:
    """Read one file of ``product`` into canonical datasets, lazily: one for each grid and set of dates in it."""
    remedy = "The file may be damaged, or of a layout that is not known: look at it with ncdump -h"
    with reading(path, f"cannot be read as {product.name}", remedy, ForcingError):
        return canonical_parts(open_raw(path, whole), product, path)


def canonical_parts(raw: xr.Dataset, product: Product, path: str) -> list[xr.Dataset]:
    """Do the same as `read` for a dataset that is open already, decoded or not."""
    for repair in REPAIRS:
        raw = repair(raw, path)
    # Coordinates that the user names say what they are.
    extra = {
        product.names[key]: attributes
        for key, attributes in COORDINATES.items()
        if product.names.get(key) in raw.variables
    }
    levels = product.names.get("depth")
    # Levels lie along one dimension, or change in place.
    if levels in raw.variables and levels not in raw.dims and raw[levels].ndim == 2:
        raise ForcingError(
            f"{levels} is a map, but depth names the levels of a field", where="names, depth",
            remedy=f"The depth of the sea floor is depth_below_surface: {levels}",
        )  # fmt: skip
    raw = (
        _with_attributes(raw, {name: {**raw[name].attrs, **attributes} for name, attributes in extra.items()})
        if extra
        else raw
    )
    decoded = _decoded(product.mend(raw))
    if product.member is not None:
        # A file with fewer members begins anew, so that files of two ensembles go together.
        member = {dim: product.member % size for dim, size in member_dimensions(decoded).items()}
        decoded = decoded.isel(member, drop=True)
    ds = product.reshape(within_valid_range(decoded))
    ds.encoding["source"] = path
    ds = with_static_grid(ds)
    # The undecoded heading says these: decoding takes units and bounds out of the attributes.
    stated, kind = stated_interval(raw, path), describe_kind(raw, path) if product.kind_matters else ""
    datasets = []
    for dataset in gather_fields(ds, product, where=path):
        dataset = noted(tidy_axes(dataset, where=path), told=kind)
        if "time" in dataset.dims and stated:
            dataset = dataset.assign_attrs(stated_seconds=stated)
        dataset = product.finish(dataset)
        keys = ("crs_wkt", "stated_seconds", "longest_step", "means", *REMARKS)
        averaging = dataset.attrs.get("averaging_seconds", product.averaging / np.timedelta64(1, "s"))
        dataset = dataset.copy(deep=False)
        dataset.attrs = {
            "Conventions": "CF-1.11",
            "product": product.name,
            "title": product.title,
            "source": path,
            "citation": product.citation,
            "reader_checked_against": product.checked(dataset.data_vars),
            "averaging_seconds": float(averaging),
            "history": f"read by riftberg as {product.name}; {raw.attrs.get('history', '')}".rstrip("; "),
            **{key: dataset.attrs[key] for key in keys if key in dataset.attrs},
        }
        datasets.append(dataset)
    return datasets


def _decoded(raw: xr.Dataset) -> xr.Dataset:
    """Return the file with packing, fill values and dates decoded; that is xarray's work."""
    with own_filters():
        warnings.filterwarnings("ignore", message="Ambiguous reference date string", category=xr.SerializationWarning)
        # Only dates that pandas cannot hold come back as cftime objects.
        warnings.filterwarnings("ignore", message="Unable to decode time axis", category=xr.SerializationWarning)
        warnings.filterwarnings("ignore", message=".*has multiple fill values", category=xr.SerializationWarning)
        warnings.filterwarnings("ignore", category=FutureWarning)
        undecoded: dict[Hashable, dict[str, Any]] = {}
        try:
            decoded = xr.decode_cf(raw, decode_timedelta=False)
        except (ValueError, OverflowError):
            # Dates that cannot be decoded are reported where they matter; the rest of the file is read, other dates too.
            counting = {n: v for n, v in raw.variables.items() if " since " in str(v.attrs.get("units", ""))}
            undecoded = {n: v.attrs for n, v in counting.items() if not _decodes(raw, n)}
            bare = {n: {key: value for key, value in attrs.items() if key != "units"} for n, attrs in undecoded.items()}
            for name, bounds in [(n, v.attrs.get("bounds")) for n, v in counting.items() if n not in undecoded]:
                if bounds in raw.variables and not _decodes(raw, name, bounds):  # no dates, and none that are needed
                    bare[name] = {key: value for key, value in raw.variables[name].attrs.items() if key != "bounds"}
            decoded = xr.decode_cf(_with_attributes(raw, bare), decode_timedelta=False)
        decoded.encoding.update(raw.encoding)
        return _with_attributes(decoded, undecoded) if undecoded else decoded


def _decodes(raw: xr.Dataset, *names: Hashable) -> bool:
    try:
        xr.decode_cf(xr.Dataset({name: raw.variables[name] for name in names}), decode_timedelta=False)
    except (ValueError, OverflowError):
        return False
    return True


def _with_attributes(ds: xr.Dataset, attributes: Mapping[Hashable, dict[str, Any]]) -> xr.Dataset:
    """Return the dataset with other attributes of some variables; entries decoded into the encoding stay there."""
    changed = ds.copy()
    for name, attrs in attributes.items():
        decoded = {key for key in attrs if key in changed.variables[name].encoding}
        changed.variables[name].attrs = {key: value for key, value in attrs.items() if key not in decoded}
    return changed


NAMING = (
    "Name the variables (names: {uo: u, vo: v} beside the file; --names uo=u,vo=v; in Python "
    'Forcing.from_dataset(ds, uo="u", vo="v")), or give them CF standard names and units'
)
"""Remedy for files whose variables nothing recognises."""

_KEPT = ("time", "depth", "lat", "lon", "y", "x", "grid_angle")
_NOT_OF_THE_SEA = frozenset({"ua", "va", "taux", "tauy", "depth_below_surface"})
"""Fields that are known over land too."""


def gather_fields(ds: xr.Dataset, product: Product, *, where: str) -> list[xr.Dataset]:
    """Return the canonical fields of a decoded file, one dataset for each grid and set of dates."""
    groups: dict[tuple[object, ...], dict[str, xr.DataArray]] = {}
    levels: dict[tuple[object, ...], bytes] = {}
    remarks_by_field: dict[tuple[object, ...], list[str]] = {}
    wkt: dict[tuple[object, ...], str] = {}
    means_by_key: dict[tuple[object, ...], str] = {}
    chosen = list(_chosen(ds, product, where))
    for quantity, name, remark in chosen:
        field, remarks = _canonical(ds, product, quantity, name, where)
        means = declared_mean(ds, name) if "time" in field.dims and MEAN_OF not in field.coords else ""
        # What tells grids and dates apart; levels are left out, fields with and without them go together.
        axes = (name for name in ("time", "lat", "lon", "y", "x") if name in field.coords)
        along = [field[name] for name in axes if set(field[name].dims) <= set(field.dims)]
        key: tuple[object, ...] = (
            field.attrs.get("crs_wkt", ""), *((axis.name, axis.dims, axis.values.tobytes()) for axis in along)
        )  # fmt: skip
        # Fields of one grid whose levels differ cannot share a dataset.
        depth = field["depth"].values.tobytes() if "depth" in field.dims else b""
        if depth and levels.setdefault(key, depth) != depth:
            key = (*key, depth)
        key = (*key, MEAN_OF in field.coords, bool(means))
        means_by_key.setdefault(key, means)
        wkt[key] = str(field.attrs.pop("crs_wkt", ""))
        groups.setdefault(key, {})[quantity] = field
        remarks_by_field.setdefault(key, []).extend(filter(None, [remark, *remarks]))
    headings = " ".join(str(ds.attrs.get(key, "")) for key in ("title", "id", "product", "summary")).lower()
    datasets: list[xr.Dataset] = []
    for key, fields in groups.items():
        if "ice_thickness" in fields:
            field = fields["ice_thickness"]
            cover = next((others["ice_fraction"] for others in groups.values() if "ice_fraction" in others), None)
            fields["ice_thickness"], remarks = true_ice_thickness(field, ds[str(field.attrs["original_name"])], cover)
            remarks_by_field[key].extend(remarks)
        dataset = xr.Dataset(fields)
        misleading = (
            misnamed_fields(ds.drop_vars(product.names.values(), errors="ignore")) if product.select is not None else ""
        )
        text = "; ".join(
            dict.fromkeys(filter(None, [str(ds.attrs.get("told", "")), *remarks_by_field[key], misleading]))
        )
        attributes: dict[str, Any] = {"crs_wkt": wkt[key], "told": text}
        if not datasets:  # what concerns the whole file is said once
            attributes["unread"] = "; ".join(
                unread_fields(ds, [q for q, _, _ in chosen], [name for _, name, _ in chosen])
            )
        methods = [
            str(ds[str(field.attrs["original_name"])].attrs.get("cell_methods", "")) for field in fields.values()
        ]
        # Instants may be days apart in what a file holds: their interval shows nothing of the product's.
        if "hourly" in headings or any("time: point" in method for method in methods):
            attributes["longest_step"] = SECONDS_PER_DAY
        if MEAN_OF in dataset.coords and dataset[MEAN_OF].values.any():
            attributes["averaging_seconds"] = float(np.median(dataset[MEAN_OF].values))
        attributes |= {name: ds.attrs[name] for name in ("averaging_seconds",) if name in ds.attrs}
        attributes["means"] = means_by_key[key]
        datasets.append(dataset.assign_attrs({name: value for name, value in attributes.items() if value}))
    return datasets


def _chosen(ds: xr.Dataset, product: Product, where: str) -> Iterable[tuple[str, str, str]]:
    """Yield quantity, variable and remark for each canonical field in the file."""
    if missing := [name for name in product.names.values() if name not in ds.variables]:
        names = sorted(map(str, ds.variables))
        raise ForcingError(
            f"there is no variable {missing[0]!r}", where=where,
            remedy=f"{nearest(missing[0], names)}It holds {', '.join(names)}",
        )  # fmt: skip
    choice = [(quantity, name, "") for quantity, name in product.names.items() if quantity in QUANTITIES]
    if product.select is not None:
        selected = product.select(ds, product.names)
        choice += [(quantity, name, remark) for quantity, (name, remark) in selected.items()]
    else:
        for source in product.sources:
            names = [name for name in source.names if name in ds.variables]
            if names and source.quantity not in {quantity for quantity, _, _ in choice}:
                others = ", ".join(names[1:])
                remark = f"{source.quantity} is taken from {names[0]}; {others} could be it too" if others else ""
                choice.append((source.quantity, names[0], remark))
        # What the product does not know and the file holds all the same, by standard name and with units.
        quantities = {quantity for quantity, _, _ in choice}
        for quantity in QUANTITIES:
            name = "" if quantity in quantities else by_standard_name(ds, quantity)
            if name and read_units(ds[name]) and name not in product.left_out:
                choice.append((quantity, name, f"{quantity} is taken from {name} by its standard name"))
    if not choice:
        names = sorted(map(str, ds.data_vars))
        others = f" ({misleading})" if (misleading := misnamed_fields(ds)) else ""
        raise ForcingError(
            f"holds no field that {product.name} offers ({', '.join(product.gives)}); it has "
            f"{', '.join(names) or 'nothing'}{others}",
            where=where,
            remedy=NAMING
            if product.name == "cf"
            else "Give the file with the wanted variables, or name the right product",
        )
    return choice


def _canonical(
    ds: xr.Dataset, product: Product, quantity: str, name: str, where: str
) -> tuple[xr.DataArray, list[str]]:
    """Return one field, placed and in canonical units, and remarks on it."""
    source = next((s for s in product.sources if s.quantity == quantity), None)
    units = read_units(ds[name]) or (source.units if source is not None else "")
    if other := statistic(ds[name], quantity):
        raise ForcingError(
            f"{name} is no {QUANTITIES[quantity].long_name} at its dates but a statistic of it: {other}", where=where,
            remedy=f"Give the values or their means, or leave it out: ncks -x -v {name} FILE OUT",
        )  # fmt: skip
    if quantity == "ssh" and above_ellipsoid(ds[name]):
        raise ForcingError(
            f"{name} is the height of the sea above the ellipsoid, whose slope is that of the geoid", where=where,
            remedy=f"Subtract the geoid (ADT), or leave it out: ncks -x -v {name} FILE OUT",
        )  # fmt: skip
    attributes = dict(ds[name].attrs)
    # In this order: the dimensions that dates, members and levels leave over are those of the place.
    field, when = date_field(ds, name, where=where, moves=quantity != "depth_below_surface")
    field = without_flags(ds[name], field)
    field = field if quantity in _NOT_OF_THE_SEA else without_land(ds, field)
    means = {MEAN_OF: field.coords[MEAN_OF].variable} if MEAN_OF in field.coords else {}
    notes = _one_member(ds, name, field, where)
    field, remarks = judge_levels(ds, name, field, quantity, where=where)
    point = "t" if quantity not in COMPONENTS else "u" if quantity in dict(VECTORS) else "v"
    field = place_field(ds, name, field, where=where, point=point)

    def locate(other: str) -> xr.DataArray:
        # ANGLET, gcost and cos_rot stand in the middle of the cells, ANGLE where the components stand.
        target = "t" if other.lower().endswith("t") else point
        return place_field(ds, other, date_field(ds, other, where=where, moves=False)[0], where=where, point=target)

    wkt, placed = field.attrs.get("crs_wkt", ""), str(field.attrs.pop("placed", ""))
    field = field.assign_attrs({**attributes, **({"crs_wkt": wkt} if wkt else {})})
    if quantity in COMPONENTS and not is_true(field, name):
        field = with_angle(ds, field, name, locate, where=where)
        if product.select is not None and not standard_name(ds[name]):
            notes.append(
                f"{name} has no standard name: it is taken along its grid, not as a component to true east or north"
            )
    if LEVEL in field.dims:
        axes = [c for c, role, _ in find_coordinates(ds, name) if role == "level" and ds[c].ndim == 1]
        axis = min(axes, key=lambda c: c not in ds[name].dims)  # that of the levels, where a file has more
        field = on_depths(ds, field, ds[axis], locate, where=where)
    if product.select is not None and quantity == "depth_below_surface" and is_height(ds[name], name):
        field = (-field).where(field < 0.0)
        if strange_height(ds[name]):
            notes.append(
                f"{name} ({standard_name(ds[name])}) is taken as a height, positive up: where negative, there is water"
            )
    # `canonicalise` leaves the attributes of the quantity alone: what else must be known is kept aside and put back.
    along = field.attrs.get("along")
    field = field.drop_vars([c for c in field.coords if c not in _KEPT]).assign_coords(means)
    field = canonicalise(field, QUANTITIES[quantity], units, where=f"{where}, variable {name}")
    if quantity == "wave_direction" and standard_name(ds[name]) == TO_DIRECTION:
        field = ((field + 180.0) % 360.0).assign_attrs(field.attrs)
    origin = {
        "original_name": name,
        "original_units": units,
        "along": along,
        "crs_wkt": wkt,
        VALID: attributes.get(VALID),
    }
    field.attrs |= {key: value for key, value in origin.items() if value or key == "original_units"}
    if not read_units(ds[name]) and units and QUANTITIES[quantity].units not in ("1", "1e-3"):
        remarks = [*remarks, f"{name} has no units in the file: {units} is taken, as {product.name} writes it"]
    return field, [*notes, *remarks, *filter(None, [when, placed])]


def member_dimensions(ds: xr.Dataset) -> dict[str, int]:
    """Return the dimensions of members that a file has, with the number of members."""
    return {
        str(dim): int(size) for dim, size in ds.sizes.items()
        if size > 1 and (find_role(dim, ds[dim].variable) if dim in ds.variables else role_by_name(dim)) == "member"
    }  # fmt: skip


def _one_member(ds: xr.Dataset, name: str, field: xr.DataArray, where: str) -> list[str]:
    """Return a remark where a field is a member of an ensemble; refuse several."""
    member_remarks: list[str] = []
    for other, role, _ in find_coordinates(ds, name):
        if role != "member" or (ds[other].size != 1 and not set(ds[other].dims) <= set(field.dims)):
            continue
        if ds[other].size > 1:
            dim = str(ds[other].dims[0])
            raise ForcingError(
                f"{name} has {ds[other].size} members of an ensemble ({other})",
                where=where,
                remedy=f"Choose one by member: 0 beside files in forcing (0 to {ds[other].size - 1}); riftberg forecast takes "
                f"them in turn. In Python ds.isel({dim}=0)",
            )
        value = np.ravel(ds[other].values)[0]
        if value != 0:
            member_remarks.append(f"{name} is member {value} ({other}) of an ensemble")
    return member_remarks
