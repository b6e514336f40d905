"""From a decoded file to its canonical fields: chosen, dated, placed in the vertical and the horizontal, in SI units."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError, nearest
from riftberg.products.cf import (
    above_ellipsoid,
    by_standard_name,
    coordinates_of,
    is_height,
    role_of,
    role_of_name,
    standard_name,
    statistic,
    strange_height,
    turned_away,
    units_of,
    unread,
)
from riftberg.products.dates import dated, declared_mean
from riftberg.products.levels import LEVEL, judged, on_depths
from riftberg.products.place import positioned
from riftberg.products.product import Product
from riftberg.products.quantities import QUANTITIES, TO_DIRECTION, canonicalise
from riftberg.products.records import MEAN_OF
from riftberg.products.repair import VALID, without_land
from riftberg.products.vectors import COMPONENTS, is_true, with_angle

NAMING = (
    "Name the variables (names: {uo: u, vo: v} beside the file; --names uo=u,vo=v; in Python "
    'Forcing.from_dataset(ds, uo="u", vo="v")), or give them CF standard names and units'
)
"""Remedy for files whose variables nothing recognises."""

_KEPT = ("time", "depth", "lat", "lon", "y", "x", "grid_angle")
_NOT_OF_THE_SEA = frozenset({"ua", "va", "taux", "tauy", "depth_below_surface"})
"""Fields that are known over land too."""


def gathered(ds: xr.Dataset, product: Product, *, where: str) -> list[xr.Dataset]:
    """Return the canonical fields of a decoded file, one dataset for each grid and set of dates."""
    groups: dict[tuple[object, ...], dict[str, xr.DataArray]] = {}
    levels: dict[tuple[object, ...], bytes] = {}
    remarks_by_field: dict[tuple[object, ...], list[str]] = {}
    wkt: dict[tuple[object, ...], str] = {}
    said: dict[tuple[object, ...], str] = {}
    chosen = list(_chosen(ds, product, where))
    for quantity, name, remark in chosen:
        field, remarks = _canonical(ds, product, quantity, name, where)
        means = declared_mean(ds, name) if "time" in field.dims and MEAN_OF not in field.coords else ""
        key = _key(field)
        # Fields of one grid whose levels differ cannot share a dataset.
        depth = field["depth"].values.tobytes() if "depth" in field.dims else b""
        if depth and levels.setdefault(key, depth) != depth:
            key = (*key, depth)
        key = (*key, MEAN_OF in field.coords, bool(means))
        said.setdefault(key, means)
        wkt[key] = str(field.attrs.pop("crs_wkt", ""))
        groups.setdefault(key, {})[quantity] = field
        remarks_by_field.setdefault(key, []).extend(filter(None, [remark, *remarks]))
    headings = " ".join(str(ds.attrs.get(key, "")) for key in ("title", "id", "product", "summary")).lower()
    parts: list[xr.Dataset] = []
    for key, fields in groups.items():
        part = xr.Dataset(fields)
        away = turned_away(ds.drop_vars(product.names.values(), errors="ignore")) if product.select is not None else ""
        told = "; ".join(dict.fromkeys(filter(None, [str(ds.attrs.get("told", "")), *remarks_by_field[key], away])))
        attributes: dict[str, Any] = {"crs_wkt": wkt[key], "told": told}
        if not parts:  # what concerns the whole file is said once
            attributes["unread"] = "; ".join(unread(ds, [q for q, _, _ in chosen], [name for _, name, _ in chosen]))
        methods = [
            str(ds[str(field.attrs["original_name"])].attrs.get("cell_methods", "")) for field in fields.values()
        ]
        # Instants may be days apart in what a file holds: their interval shows nothing of the product's.
        if "hourly" in headings or any("time: point" in method for method in methods):
            attributes["longest_step"] = SECONDS_PER_DAY
        if MEAN_OF in part.coords and part[MEAN_OF].values.any():
            attributes["averaging_seconds"] = float(np.median(part[MEAN_OF].values))
        attributes |= {name: ds.attrs[name] for name in ("averaging_seconds",) if name in ds.attrs}
        attributes["means"] = said[key]
        parts.append(part.assign_attrs({name: value for name, value in attributes.items() if value}))
    return parts


def _chosen(ds: xr.Dataset, product: Product, where: str) -> Iterable[tuple[str, str, str]]:
    """Yield quantity, variable and remark for each canonical field in the file."""
    if missing := [name for name in product.names.values() if name not in ds.variables]:
        held = sorted(map(str, ds.variables))
        raise ForcingError(
            f"there is no variable {missing[0]!r}", where=where,
            remedy=f"{nearest(missing[0], held)}It holds {', '.join(held)}",
        )  # fmt: skip
    choice = [(quantity, name, "") for quantity, name in product.names.items() if quantity in QUANTITIES]
    if product.select is not None:
        selected = product.select(ds, product.names)
        choice += [(quantity, name, remark) for quantity, (name, remark) in selected.items()]
    else:
        for source in product.sources:
            held = [name for name in source.names if name in ds.variables]
            if held and source.quantity not in {quantity for quantity, _, _ in choice}:
                others = ", ".join(held[1:])
                remark = f"{source.quantity} is taken from {held[0]}; {others} could be it too" if others else ""
                choice.append((source.quantity, held[0], remark))
        # What the product does not know and the file holds all the same, by standard name and with units.
        found = {quantity for quantity, _, _ in choice}
        for quantity in QUANTITIES:
            name = "" if quantity in found else by_standard_name(ds, quantity)
            if name and units_of(ds[name]) and name not in product.left_out:
                choice.append((quantity, name, f"{quantity} is taken from {name} by its standard name"))
    if not choice:
        held = sorted(map(str, ds.data_vars))
        others = f" ({away})" if (away := turned_away(ds)) else ""
        raise ForcingError(
            f"holds no field that {product.name} offers ({', '.join(product.gives)}); it has "
            f"{', '.join(held) or 'nothing'}{others}",
            where=where,
            remedy=NAMING
            if product.name == "cf"
            else "Give the file with the wanted variables, or name the right product",
        )
    return choice


def _canonical(
    ds: xr.Dataset, product: Product, quantity: str, name: str, where: str
) -> tuple[xr.DataArray, list[str]]:
    """Return one field, placed and in canonical units, and what should be known of it."""
    source = next((s for s in product.sources if s.quantity == quantity), None)
    units = units_of(ds[name]) or (source.units if source is not None else "")
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
    field = dated(ds, name, where=where, moves=quantity != "depth_below_surface")
    field = field if quantity in _NOT_OF_THE_SEA else without_land(ds, field)
    means = {MEAN_OF: field.coords[MEAN_OF].variable} if MEAN_OF in field.coords else {}
    field, one = _one_member(ds, name, field, where)
    field, remarks = judged(ds, name, field, quantity, where=where)
    field = positioned(ds, name, field, where=where)

    def place(other: str) -> xr.DataArray:
        return positioned(ds, other, dated(ds, other, where=where, moves=False), where=where)

    wkt, placed = field.attrs.get("crs_wkt", ""), str(field.attrs.pop("placed", ""))
    field = field.assign_attrs({**attributes, **({"crs_wkt": wkt} if wkt else {})})
    if quantity in COMPONENTS and not is_true(field, name):
        field = with_angle(ds, field, name, place, where=where)
        if product.select is not None and not standard_name(ds[name]):
            one.append(
                f"{name} has no standard name: it is taken along its grid, not as a component to true east or north"
            )
    if LEVEL in field.dims:
        axes = [c for c, role, _ in coordinates_of(ds, name) if role == "level" and ds[c].ndim == 1]
        axis = min(axes, key=lambda c: c not in ds[name].dims)  # that of the levels, where a file has more
        field = on_depths(ds, field, ds[axis], place, where=where)
    if product.select is not None and quantity == "depth_below_surface" and is_height(ds[name], name):
        field = (-field).where(field < 0.0)
        if strange_height(ds[name]):
            one.append(
                f"{name} ({standard_name(ds[name])}) is taken as a height, positive up: where negative, there is water"
            )
    # `canonicalise` leaves the attributes of the quantity alone: what else must be known is kept aside and put back.
    along = field.attrs.get("along")
    field = field.drop_vars([c for c in field.coords if c not in _KEPT]).assign_coords(means)
    field = canonicalise(field, QUANTITIES[quantity], units, where=f"{where}, variable {name}")
    if quantity == "wave_direction" and standard_name(ds[name]) == TO_DIRECTION:
        field = ((field + 180.0) % 360.0).assign_attrs(field.attrs)
    noted = {
        "original_name": name,
        "original_units": units,
        "along": along,
        "crs_wkt": wkt,
        VALID: attributes.get(VALID),
    }
    field.attrs |= {key: value for key, value in noted.items() if value or key == "original_units"}
    if not units_of(ds[name]) and units and QUANTITIES[quantity].units not in ("1", "1e-3"):
        remarks = [*remarks, f"{name} has no units in the file: {units} is taken, as {product.name} writes it"]
    return field, [*one, *remarks, *([placed] if placed else [])]


def members_in(ds: xr.Dataset) -> dict[str, int]:
    """Return the dimensions of members that a file has, with the number of members."""
    return {
        str(dim): int(size) for dim, size in ds.sizes.items()
        if size > 1 and (role_of(dim, ds[dim].variable) if dim in ds.variables else role_of_name(dim)) == "member"
    }  # fmt: skip


def of_member(ds: xr.Dataset, member: int) -> xr.Dataset:
    """Return a file with one of its members; one with fewer begins anew, so that files of two ensembles go together."""
    return ds.isel({dim: member % size for dim, size in members_in(ds).items()}, drop=True)


def _one_member(ds: xr.Dataset, name: str, field: xr.DataArray, where: str) -> tuple[xr.DataArray, list[str]]:
    """Return the only member of an ensemble and a remark; refuse several."""
    member_remarks: list[str] = []
    for other, role, _ in coordinates_of(ds, name):
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
    return field, member_remarks


def _key(field: xr.DataArray) -> tuple[object, ...]:
    """Return what tells grids and dates apart; levels are left out, fields with and without them go together."""
    axes: list[Any] = [field.attrs.get("crs_wkt", "")]
    for name in ("time", "lat", "lon", "y", "x"):
        if name in field.coords and set(field[name].dims) <= set(field.dims):
            axes.append((name, field[name].dims, field[name].values.tobytes()))
    return tuple(axes)
