"""The products that Riftberg reads, how a file finds its product, and how files become canonical datasets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError, nearest
from riftberg.products import cf, models, oceans
from riftberg.products.dates import place_means
from riftberg.products.levels import uppermost
from riftberg.products.product import Heading, Product, noted
from riftberg.products.quantities import QUANTITIES
from riftberg.products.reading import ALL_WHOLE, COORDINATES, NAMING, WHOLE, canonical_parts, is_zarr, open_raw, read
from riftberg.products.records import MEAN_OF, PLACE, minute, own_interval
from riftberg.products.vectors import pair_vectors
from riftberg.system.input_files import at_home, files_matching, hidden, is_address
from riftberg.system.netcdf_lock import closing_files, open_netcdf

STAGES = ("nrt", "interim", "final")
"""Issues of one file, the most final last, as OSCAR has them in its names."""

AXES = ("depth", "lat", "lon", "y", "x")

SINGLE = 2e-7
"""Part of the largest value of an axis by which others that are written in single precision differ from it."""

LONGEST_NAME = 60
"""Letters of the title of a dataset that serve as its name."""

PRODUCTS: tuple[Product, ...] = (
    oceans.GLOBCURRENT,
    oceans.OSCAR_V1,
    oceans.OSCAR_V2,
    oceans.DUACS,
    oceans.DUACS_GEOSTROPHIC,
    oceans.MERCATOR_FORECAST,
    oceans.GLORYS,
    oceans.ORAS5,
    models.NCEP_R2,
    models.NCEP_R1,
    models.JRA55,
    models.ERA5,
    oceans.IBCSO,
    oceans.OSISAF,
    oceans.GEBCO,
    oceans.SRTM15,
    models.A68A,
    models.A68A_KEEL_MEAN,
    models.ROMS,
    models.NEMO,
    models.FVCOM,
    models.FESOM,
    models.WRF,
    cf.PRODUCT,
)
"""All products; a file belongs to the first that matches it."""

Paths = str | Path | Sequence[str | Path]


def product_named(name: str) -> Product:
    """Return the product of that name; `ForcingError` lists the names if there is none."""
    for product in PRODUCTS:
        if product.name == name:
            return product
    names = ", ".join(product.name for product in PRODUCTS)
    raise ForcingError(f"there is no product {name!r}", where="product", remedy=f"Choose one of: {names}")


Choice = str | Product | Mapping[str, str] | None
"""Product of a file by name or itself, names of its variables by quantity or coordinate, or None: recognise it."""


def check_naming(names: Mapping[str, str], *, where: str = "names") -> dict[str, str]:
    """Return names of variables by quantity or coordinate; `ForcingError` where a key is neither, or a name no text."""
    keys = (*QUANTITIES, *COORDINATES)
    for key, name in names.items():
        if key not in keys:
            remedy = f"{nearest(str(key), keys)}These are {', '.join(keys)}"
            raise ForcingError(f"{key!r} is no quantity or coordinate", where=where, remedy=remedy)
        if not isinstance(name, str) or not name:
            raise ForcingError(
                f"{name!r} is no name of a variable", where=f"{where}, {key}", remedy=f"Such as {key}: u"
            )
    return dict(names)


def choose_product(product: str | None, names: Mapping[str, str], *, where: str = "names") -> Choice:
    """Return the product that a user names for a file, the names of its variables, or a product with such names."""
    if not names:
        return product
    checked = check_naming(names, where=where)
    return checked if product is None else replace(product_named(product), names=checked)


def recognise(path: str | Path) -> Product:
    """Return the product that a file belongs to, told by its attributes, variables and dimensions."""
    with closing_files():
        ds = open_raw(str(path))
        if product := find_product(ds):
            return product
        variables = ", ".join(f"{name}{variable.dims}" for name, variable in ds.data_vars.items())
        strange = cf.misnamed_fields(ds)
    if not variables and (group := _group_with_fields(str(path))):
        raise ForcingError(
            f"its variables stand in the group {group}, which is not looked into", where=str(path),
            remedy=f"Take them out first: ncks -G : -g {group} FILE OUT",
        )  # fmt: skip
    raise ForcingError(
        f"the product was not recognised; the file holds {variables or 'nothing'}{f' ({strange})' if strange else ''}",
        where=str(path),
        remedy="Give a file of what a run takes"
        if strange
        else f"{NAMING}. Products that can be named (--product): {', '.join(product.name for product in PRODUCTS)}",
    )


def find_product(ds: xr.Dataset) -> Product | None:
    """Return the product that an open dataset belongs to, told by its attributes, variables and dimensions."""
    return next((product for product in PRODUCTS if belongs(ds, product)), None)


def _group_with_fields(path: str) -> str:
    """Return the first group of a netCDF-4 file that holds variables; empty if there is none."""
    if is_zarr(path) or is_address(path):
        return ""
    try:
        with open_netcdf(path) as file:
            return next((name for name, group in file.groups.items() if group.variables), "")
    except (OSError, RuntimeError):
        return ""


def belongs(ds: xr.Dataset, product: Product) -> bool:
    """Return whether an open dataset looks like a product."""
    try:
        return cf.holds_fields(ds) if product is cf.PRODUCT else product.matches(Heading.of(ds))
    except Exception:  # a file so damaged that its heading cannot be compared is not of this product
        return False


def expand(paths: Paths) -> list[str]:
    """Return the files that ``paths`` names: patterns are expanded, addresses and Zarr stores kept."""
    patterns: Iterable[str | Path] = [paths] if isinstance(paths, str | Path) else paths
    files: list[str] = []
    for path in map(hidden, map(str, patterns)):
        matches = files_matching(path)
        if not matches and any(sign in path for sign in "*?["):
            raise ForcingError("no file matches", where=path, remedy="Check the folder and the pattern")
        files.extend(matches or [at_home(path)])
    if not files:
        raise ForcingError("no files were given", where="forcing", remedy="Give at least one file")
    return files


@closing_files(only_if_refused=True)
def open_product(paths: Paths, product: str | Product | None = None, *, levels: bool = False) -> xr.Dataset:
    """Open the files of one product as one canonical dataset, lazily.

    Parameters
    ----------
    paths : path, pattern or sequence of them
        Files, patterns such as ``"oscar_*.nc"``, Zarr stores or addresses.
    product : str, optional
        Name of the product, where the files do not tell it.
    levels : bool
        Keep temperature and salinity on levels, not the uppermost alone.

    Returns
    -------
    xarray.Dataset
        Canonical names, units and axes (see `riftberg.products`).

    Raises
    ------
    ForcingError
        If a file cannot be read, is of no known product, or the files make several datasets.
    """
    datasets = open_all(paths, product, levels=levels)
    if len(datasets) > 1:
        served = "; ".join(
            f"{ds.attrs['product']}: {', '.join(map(str, ds.data_vars))} {dict(ds.sizes)}" for ds in datasets
        )
        raise ForcingError(
            f"these files make {len(datasets)} datasets with different products, grids or records ({served})",
            where=", ".join(expand(paths)[:4]),
            remedy="Open each set by itself, or use open_all",
        )
    return datasets[0]


@closing_files(only_if_refused=True)
def open_all(paths: Paths, product: str | Product | None = None, *, levels: bool = False) -> list[xr.Dataset]:
    """Open files of any products; those on one grid with the same records are joined."""
    opened = open_named((path, product) for path in expand(paths))
    # Currents keep their levels, for a mean over the draft.
    opened = opened if levels else [uppermost(ds, ("sst", "sss")) for ds in opened]
    for field in [field for ds in opened for field in ds.data_vars.values()]:
        field.attrs.pop(PLACE, None)
    return opened


@closing_files(only_if_refused=True)
def open_named(entries: Iterable[tuple[str, Choice]], member: int | None = None) -> list[xr.Dataset]:
    """Open files as the products named beside them, joined as `open_all` does.

    ``entries``: files ((path, choice)); ``member``: of files with members of an ensemble, from 0.
    """
    entries = list(entries)
    whole = max(WHOLE, ALL_WHOLE / max(1, len(entries)))
    read_files = (read_named(path, product, number, member, whole) for number, (path, product) in enumerate(entries))
    return pair_vectors(joined_files([dataset for datasets in read_files for dataset in datasets]))


def read_named(
    path: str, product: Choice, number: int, member: int | None = None, whole: float = WHOLE
) -> list[tuple[xr.Dataset, Product]]:
    """Read one file as the product named for it, with its place among the files on each field.

    Of two files that give a field a run takes the later. Where a file does not look like the product named for it, an error
    says so. ``whole``: as for `riftberg.products.reading.open_raw`.
    """
    if isinstance(product, Mapping):
        chosen = _with_names(open_raw(path), product)
    else:
        chosen = (product_named(product) if isinstance(product, str) else product) or recognise(path)
    chosen = chosen if member is None else replace(chosen, member=member)
    try:
        datasets = read(path, chosen, whole)
    except ForcingError as error:
        if not isinstance(product, str) or belongs(open_raw(path), chosen):
            raise
        fault = f"{error.what}; it is named {chosen.name} and does not look like it"
        remedy = f"Name the right product, or none. Of {chosen.name}: {error.remedy}"
        raise ForcingError(fault, where=error.where, remedy=remedy) from error
    return [(_placed(ds, number), chosen) for ds in datasets]


def _with_names(ds: xr.Dataset, names: Mapping[str, str]) -> Product:
    """Return the product of a dataset with names of its variables; one that is not recognised is taken by CF."""
    return replace(find_product(ds) or cf.PRODUCT, names=dict(names))


def _placed(ds: xr.Dataset, number: int) -> xr.Dataset:
    return ds.assign({name: field.assign_attrs({PLACE: number}) for name, field in ds.data_vars.items()})


def joined_files(files: Sequence[tuple[xr.Dataset, Product]]) -> list[xr.Dataset]:
    """Join files of one product: first those with the same fields in time, then different fields on the same points."""
    groups: dict[tuple[object, ...], list[xr.Dataset]] = {}
    products = {product.name: product for _, product in files}
    for ds, (_, product) in zip(_on_common_axes([ds for ds, _ in files]), files, strict=True):
        groups.setdefault((product.name, *_grid_key(ds), tuple(ds.data_vars)), []).append(ds)
    # Where means hold follows from the time between the records of all files: these are joined in time first.
    joined = [(dataset, products[str(key[0])]) for key, group in groups.items() for dataset in _join_in_time(group)]
    return _merge_fields([_settle_means(dataset, product) for dataset, product in joined])


def in_memory(datasets: Sequence[xr.Dataset], names: Mapping[str, str] | None = None) -> list[xr.Dataset]:
    """Return canonical datasets of others that are open already, one for each grid and set of records.

    ``names``: of variables by quantity or coordinate; each dataset takes those that it holds.
    """
    naming = check_naming(names or {})
    variables = list(dict.fromkeys(str(name) for ds in datasets for name in ds.variables))
    for name in naming.values():
        if name not in variables:
            remedy = f"{nearest(name, variables)}There are {', '.join(variables)}"
            raise ForcingError(f"there is no variable {name!r}", where="names", remedy=remedy)
    canonical = []
    for number, ds in enumerate(datasets, 1):
        product = _with_names(ds, {key: name for key, name in naming.items() if name in ds.variables})
        # What messages and titles call it: its file, its title, or its number.
        title = ds.attrs.get("title")
        titled = " ".join(title.replace("/", " ").split())[:LONGEST_NAME] if isinstance(title, str) else ""
        label = str(ds.encoding.get("source") or titled or f"dataset {number}")
        canonical += [_settle_means(dataset, product) for dataset in canonical_parts(ds.copy(), product, label)]
    return pair_vectors(_merge_fields(_on_common_axes(canonical)))


def _settle_means(ds: xr.Dataset, product: Product) -> xr.Dataset:
    """Return joined files with the interval of all their records noted, which a window would no longer show."""
    if "time" not in ds.dims:
        return ds
    ds = place_means(product.settle(ds), known=product.longest_step is not None)
    _, first = np.unique(ds["time"].values, return_index=True)
    if first.size < ds.sizes["time"]:  # days written 00:00 in one file and 12:00 in another
        lost = ds.sizes["time"] - first.size
        ds = noted(
            ds.isel(time=first), doubt=f"{lost} record(s) are means over the time of another: the first is taken"
        )
    stepped = ds if product.longest_step is None else ds.assign_attrs(longest_step=product.longest_step)
    return ds.assign_attrs(interval_seconds=own_interval(stepped))


def _on_common_axes(datasets: Iterable[xr.Dataset]) -> list[xr.Dataset]:
    """Put axes and positions that differ from those of an earlier dataset by the rounding of single precision on these."""
    result: list[xr.Dataset] = []
    axes: dict[tuple[str, tuple[int, ...]], list[Any]] = {}
    for ds in datasets:
        for name in [name for name in AXES if name in ds.coords]:
            values = ds[name].values
            others = axes.setdefault((name, values.shape), [])
            rounding = SINGLE * float(np.nanmax(np.abs(values), initial=0.0))
            alike = (axis for axis in others if np.allclose(values, axis, rtol=0.0, atol=rounding, equal_nan=True))
            common = next(alike, None)
            if common is None:
                others.append(values)
            elif common.tobytes() != values.tobytes():
                ds = ds.assign_coords({name: (ds[name].dims, common, ds[name].attrs)})
        result.append(ds)
    return result


def _grid_key(ds: xr.Dataset) -> tuple[object, ...]:
    """Return a key of the grid: dimensions, and the values of axes and positions."""
    dims = [(name, ds.sizes[name]) for name in (*AXES, "node") if name in ds.dims]
    return (*dims, *(ds[name].values.tobytes() for name in AXES if name in ds.coords))


def _join_in_time(datasets: list[xr.Dataset]) -> list[xr.Dataset]:
    """Join files with the same variables and grid in order of time.

    Of files that share dates the one named later counts, from its first to its last record: mixed, the series would jump to
    and fro between two forecasts. Files without time are not joined: of two a run takes the one named later.
    """
    if len(datasets) == 1 or any("time" not in ds.dims for ds in datasets):
        return datasets
    originals = sorted(datasets, key=lambda ds: ds["time"].values[0])
    datasets, remark = _drop_earlier(datasets)
    if any(MEAN_OF in ds.coords for ds in datasets):
        datasets = [
            ds if MEAN_OF in ds.coords
            else ds.assign_coords({MEAN_OF: ("time", np.full(ds.sizes["time"], ds.attrs["averaging_seconds"]))})
            for ds in datasets
        ]  # fmt: skip
    datasets = sorted(datasets, key=lambda ds: ds["time"].values[0])
    same: Any = {"data_vars": "minimal", "coords": "minimal", "compat": "override", "join": "override"}
    series = xr.concat(datasets, dim="time", combine_attrs="override", **same)
    stated = [ds.attrs["stated_seconds"] for ds in datasets if "stated_seconds" in ds.attrs]
    series = series.assign_attrs(stated_seconds=min(stated)) if stated else series
    order = np.argsort(series["time"].values, kind="stable")
    series = _join_sources(series if np.all(np.diff(order) == 1) else series.isel(time=order), originals)
    last = max(int(field.attrs.get(PLACE, 0)) for ds in originals for field in ds.data_vars.values())
    return [noted(_placed(series, last), told=remark)]


def _drop_earlier(datasets: list[xr.Dataset]) -> tuple[list[xr.Dataset], str]:
    """Where two files overlap in time, keep the one named later for the whole overlap, and note it.

    Of OSCAR's issues of one day (final, interim, nrt) the most final counts, in whatever order a pattern names them.
    """
    dates = [dataset["time"].values for dataset in datasets]
    names = [Path(str(dataset.attrs["source"])).name for dataset in datasets]
    stages = [next((k for k, word in enumerate(STAGES, 1) if f"_{word}_" in name), 0) for name in names]
    masks = [np.ones(each.size, bool) for each in dates]
    order = sorted(range(len(datasets)), key=lambda k: dates[k][0])
    over: list[tuple[int, int]] = []
    for rank, first in enumerate(order):
        for other in order[rank + 1 :]:
            if dates[other][0] > dates[first][-1]:
                break
            if np.intersect1d(dates[first], dates[other]).size:
                earlier, later = sorted((first, other))
                if stages[earlier] > stages[later] > 0:
                    earlier, later = later, earlier
                masks[earlier] &= (dates[earlier] < dates[later][0]) | (dates[earlier] > dates[later][-1])
                over.append((earlier, later))
    if not over:
        return datasets, ""
    earlier, later = over[0]
    rule = "the more final" if earlier > later else "the one named later"
    remark = (
        f"{len(over)} pair(s) of files share dates: of each {rule} counts, such as {names[later]} over {names[earlier]} "
        f"from {minute(dates[later][0])} to {minute(dates[later][-1])}"
    )
    return [dataset.isel(time=flags) for dataset, flags in zip(datasets, masks, strict=True) if flags.any()], remark


def _merge_fields(datasets: list[xr.Dataset]) -> list[xr.Dataset]:
    """Merge datasets of one product with different variables on the same grid and records."""
    groups: dict[tuple[object, ...], list[xr.Dataset]] = {}
    for dataset in datasets:
        records = dataset["time"].values.tobytes() if "time" in dataset.dims else b""
        key: tuple[object, ...] = (dataset.attrs["product"], *_grid_key(dataset), records)
        while not records and any(set(other.data_vars) & set(dataset.data_vars) for other in groups.get(key, [])):
            key = (*key, "again")
        groups.setdefault(key, []).append(dataset)
    merged = []
    for group in groups.values():
        fields = {name: ds[[name]] for ds in reversed(group) for name in ds.data_vars}  # of two the first
        fresh = [group[0], *(field for name, field in fields.items() if name not in group[0])]
        same: Any = {"compat": "override", "join": "override", "combine_attrs": "override"}
        merged.append(group[0] if len(group) == 1 else _join_sources(xr.merge(fresh, **same), group))
    return merged


def _join_sources(ds: xr.Dataset, datasets: list[xr.Dataset]) -> xr.Dataset:
    for key in ("told", "unread"):
        if text := "; ".join(dict.fromkeys(str(dataset.attrs[key]) for dataset in datasets if key in dataset.attrs)):
            ds = ds.assign_attrs({key: text})
    return ds.assign_attrs(source=", ".join(dict.fromkeys(str(dataset.attrs["source"]) for dataset in datasets)))
