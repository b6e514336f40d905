"""Elements at their places: a region is filled with a lattice, brought to the sphere, and its elements are bonded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
import shapely.affinity

from riftberg.bergs.bonded import BondedBerg, with_report
from riftberg.bergs.bonding import (
    BondRule,
    Metric,
    form_bonds,
    make_elements,
    number_pieces,
    refuse_overlap,
    sample_thickness,
    turn_rigidly,
    within_pieces,
)
from riftberg.bergs.keys import BergOptions
from riftberg.bergs.lattice import Lattice, Region, fill, is_lone, lone_element
from riftberg.bergs.raster import read_raster
from riftberg.bergs.regions import FillingPlane, ReferencePlane, move_centroid, relax, turned
from riftberg.config.values import number, numbers
from riftberg.errors import BergError, placed_in
from riftberg.plane import EqualAreaPlane, near
from riftberg.state import Floats


def bond_points(
    lon: Floats, lat: Floats, settings: BergOptions, *, static: Any = False, rule: BondRule | None = None,
    period: float = 0.0, overlap: bool = False,
) -> BondedBerg:  # fmt: skip
    """Return the elements at these positions and the bonds between them."""
    elements = make_elements(lon, lat, settings, static=static)
    metric = Metric(settings.latlon, settings.earth_radius, period)
    if not overlap:
        refuse_overlap(elements, settings.packing, metric)
    bonds = form_bonds(elements, rule or BondRule(packing=settings.packing), metric)
    if settings.pieces is not None:
        bonds = within_pieces(bonds, np.broadcast_to(np.asarray(settings.pieces, dtype=np.int64), lon.shape))
    number_pieces(elements, bonds)
    if settings.latlon:
        # Across the date line on one branch, as berg by berg their centres, rifts and maps are found.
        _, first, piece = np.unique(elements.berg, return_index=True, return_inverse=True)
        elements.lon[:] = elements.lon_pair[:] = near(elements.lon, elements.lon[first][piece])
    if np.ndim(settings.spin):
        elements.spin[:] = settings.spin  # each element about itself
    elif settings.spin:
        turn_rigidly(elements, settings.spin, metric)
    return BondedBerg(
        elements, bonds, settings.packing, float(np.mean(settings.radius)), {"source": "points"}, settings.latlon,
        settings.earth_radius, settings.density,
    )  # fmt: skip


def fill_on_plane(
    region: Region, plane: FillingPlane, centroid: tuple[float, float], settings: BergOptions, thickness: Any,
    report: dict[str, Any], outline: Any = None,
) -> BondedBerg:  # fmt: skip
    """Fill a region of a plane, turn it about its centroid (degrees) and place it; ``outline``: of the ice, on the plane."""
    with placed_in(report["source"]):
        lattice, radius = fitting_lattice(region, settings)
    # Of a map where the ice was drawn, before it is turned and moved.
    heights = sample_thickness(thickness, *plane.inverse(lattice.x, lattice.y), read_raster)
    cx, cy = plane.forward(np.array([centroid[0]]), np.array([centroid[1]]))
    x, y = turned(lattice.x - cx, lattice.y - cy, settings.rotation)
    if outline is not None:
        outline = shapely.affinity.rotate(outline, settings.rotation, origin=(float(cx[0]), float(cy[0])))
    moved = move_centroid(plane, centroid, settings.placement, settings.shift)
    settings = settings.model_copy(
        update={"radius": radius, "thickness": heights, "pieces": region.piece_numbers(lattice)}
    )
    report = {**report, "outline_area": region.area, "outline_pieces": region.pieces}
    return place_on_sphere(x + cx, y + cy, moved, settings, report, outline)


def fill_about(
    region: Region, centre: tuple[float, float], settings: BergOptions, source: str, outline: Any
) -> BondedBerg:
    """Fill a region in metres and place its centre; ``outline``: of the ice about the centre."""
    lattice, radius = fitting_lattice(region, settings)
    x, y = turned(lattice.x - centre[0], lattice.y - centre[1], settings.rotation)
    settings = settings.model_copy(update={"radius": radius})
    assert settings.placement is not None
    outline = shapely.affinity.rotate(outline, settings.rotation, origin=(0.0, 0.0))
    report = {"source": source, "outline_area": region.area}
    if not settings.latlon:
        east, north = settings.placement
        berg = bond_points(x + east, y + north, settings)
        return keep_outline(with_report(berg, report), outline, lambda a, b: (a + east, b + north))
    plane: FillingPlane = EqualAreaPlane(*settings.placement, settings.earth_radius)
    if not settings.conformal:
        plane = ReferencePlane(*settings.placement, settings.placement[1], settings.earth_radius)
    return place_on_sphere(x, y, plane, settings, report, outline)


def place_on_sphere(
    x: Floats, y: Floats, plane: FillingPlane, settings: BergOptions, report: dict[str, Any],
    outline: Any = None,
) -> BondedBerg:  # fmt: skip
    """Bring plane points to the sphere, without strain if ``settings.conformal``."""
    lon, lat = plane.inverse(x, y)
    berg = bond_points(lon, lat, settings)
    if settings.conformal and len(berg.bonds.first):
        rest = np.full(len(berg.bonds.first), 2.0 * berg.radius)
        # Bonds are known only once the points are placed; then these move until no bond is strained.
        lon, lat = relax(lon, lat, berg.bonds.first, berg.bonds.second, rest, Metric(True, settings.earth_radius))
        berg = bond_points(lon, lat, settings)
    return keep_outline(with_report(berg, report), outline, plane.inverse)


def keep_outline(
    berg: BondedBerg, outline: Any, placed: Callable[[Floats, Floats], tuple[Floats, Floats]]
) -> BondedBerg:
    """Return the berg with its outline on a plane (m), brought to the coordinates of the elements."""
    if outline is None:
        return berg
    # Straight sides of the plane are none in longitude and latitude: they get points as dense as the elements.
    shape = shapely.transform(shapely.segmentize(outline, 2.0 * berg.radius), placed, interleaved=False)
    return replace(berg, outlines=tuple(getattr(shape, "geoms", [shape])))


def fitting_lattice(region: Region, settings: BergOptions) -> tuple[Lattice, float]:
    """Return the elements of a region and their radius (m): without a radius one, if the berg is smaller than the default."""
    if "radius" not in settings.model_fields_set and is_lone(region, settings.radius, settings.packing):
        return lone_element(region, settings.packing)
    return fill(region, settings.radius, settings.packing, settings.offset, settings.lattice_angle)


def check_positions(lon: Any, lat: Any, period: Any, latlon: bool) -> tuple[Floats, Floats, float]:
    """Return positions of elements and the zonal period (degrees; m if not ``latlon``), by default the period of the globe."""
    unit = "degree" if latlon else "m"
    period = (360.0 if latlon else 0.0) if period is None else number(period, unit, where="period", kind=BergError)
    lon = np.atleast_1d(numbers(lon, unit, where="lon", kind=BergError))
    lat = np.atleast_1d(numbers(lat, unit, where="lat", kind=BergError))
    if lon.shape != lat.shape or lon.ndim != 1:
        raise BergError(f"lon has shape {lon.shape}, lat {lat.shape}", remedy="Give two lists of equal length")
    return lon, lat, period
