"""Whether products cover elements: points, levels, known values; and where a sea level has gaps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.errors import ForcingError
from riftberg.ocean.product_part import Part
from riftberg.ocean.product_records import NO_RINGS, Blend, values_at
from riftberg.products.mesh import NodeMesh, Places
from riftberg.products.place import nominal_axes
from riftberg.products.records import in_python, named
from riftberg.state import Elements, Floats

MOST_SHOWN: Final = 20_000
"""Points of a sea level that are looked at for gaps; of more some are left out."""


def locate_elements(product: Part, elements: Elements) -> Places:
    """Return the cells of a product's points that hold the elements.

    Raises
    ------
    ForcingError
        If an element lies outside of the product.
    """
    located = product.mesh.locate(elements.lon, elements.lat)
    outside = np.flatnonzero(located.row < 0)
    if outside.size:
        raise ForcingError(
            f"{_named(elements, int(outside[0]))} is outside of the data of {', '.join(product.gives)}"
            f"{nominal_axes(product.records.ds)}",
            where=product.source,
            remedy="Give data that cover it, or fewer days"
            if in_python(product.records.ds)
            else "Take a larger box (forcing.longitude, forcing.latitude), files that cover it, or fewer days",
        )
    return located


def check_known(product: Part, name: str, located: Places, elements: Elements, time: float) -> None:
    """Refuse elements where a field is unknown, or the sea floor above the water."""
    values = product.values(name, located, time)
    dry = values <= 0.0 if name == "depth_below_surface" else np.isnan(values)
    if dry.any():
        row = int(np.flatnonzero(dry)[0])
        fault, remedy = f"is on land: no {name} is known there", "Move the berg, or give data that know it"
        if values[row] < 0.0:
            fault = f"is on land: no {name} but {values[row]:.4g} m is known there, or these are heights, positive up"
            remedy = f"Move the berg; of heights change the sign, or write positive: up on {product.original(name)}"
        raise ForcingError(
            f"{_named(elements, row)} {fault}", where=named(product.records.ds) or product.source, remedy=remedy
        )


def check_keel(product: Part, elements: Elements, row: int, draft: float) -> None:
    """Refuse the draft (m) of an element below the levels of the currents."""
    deepest = float(product.records.limits[-1])
    if draft > deepest * (1.0 + 1e-9):
        raise ForcingError(
            f"element {elements.id[row]} has a draft of {draft:.0f} m, the levels of the currents end at {deepest:.0f} m",
            where=product.source,
            remedy="Give deeper levels, or the currents of the surface alone: ds.isel(depth=0)"
            if in_python(product.records.ds)
            else "Fetch deeper levels (--depth), or take the currents of the surface (forcing.currents: surface)",
        )


def unknown_level_share(level: Part | None, current: Part | None, time: float) -> float:
    """Return the share of points with water all around at which the sea level is unknown; 0 where nothing gives one."""
    if level is None or current is None or isinstance(level.mesh, NodeMesh) or isinstance(current.mesh, NodeMesh):
        return 0.0
    blend = level.records.field("ssh", time)
    unknown = np.isnan(blend.before[0]) & np.isnan(blend.after[0])
    every = math.ceil(math.sqrt(unknown.size / MOST_SHOWN))
    at = level.mesh.points
    lon, lat, unknown = (flattened(values[::every, ::every]) for values in (at.lon, at.lat, unknown))
    wet = np.where(np.isnan(current.records.field("uo", time).before[:1]), 0.0, 1.0)
    places, columns = current.mesh.locate(lon, lat), current.mesh.points.columns
    water_weights = values_at(Blend.of(wet, wet), places, columns, rings=NO_RINGS)[0]
    water_around = water_weights > 1.0 - 1e-9
    return float((water_around & (unknown > 0.0)).sum() / max(1, water_around.sum()))


def level_gaps_text(level: Part | None, unknown_share: float) -> str:
    """Return at how many of the points with water all around the sea level is unknown; nothing where it is known at all."""
    if level is None or unknown_share == 0.0:
        return ""
    return (
        f"{named(level.records.ds) or level.source}: the sea level is unknown at "
        f"{max(100.0 * unknown_share, 0.1):.2g} % of the points whose current is known; there its slope is 0. "
        "With sea_level: geostrophic the slope balances the current everywhere"
    )


def flattened(values: Floats) -> Floats:
    """Return values one after the other, as compiled code reads them."""
    return np.ascontiguousarray(values, np.float64).ravel()


def _named(elements: Elements, row: int) -> str:
    return f"element {elements.id[row]} at ({elements.lon[row]:.6g}, {elements.lat[row]:.6g})"
