"""Shapes that are filled with elements: an outline, a mask, rows of a lattice, a rectangle."""

from __future__ import annotations

from typing import Any

import shapely

from riftberg.bergs import outline as outlines
from riftberg.bergs.bonded import BondedBerg
from riftberg.bergs.bonding import sample_thickness
from riftberg.bergs.keys import BergOptions
from riftberg.bergs.lattice import cells_region, expand_rows, rectangle_region
from riftberg.bergs.placement import fill_about, fill_on_plane, place_on_sphere
from riftberg.bergs.raster import Raster, read_raster, unbroken
from riftberg.bergs.regions import (
    FillingPlane,
    IceMask,
    filling_plane,
    ice_cells,
    makeberg_lattice,
    mask_region,
    outline_region,
)


def fill_outline(
    source: Any, settings: BergOptions, *, feature: int | str | None, date: str | None, crs: str | None, repair: bool
) -> BondedBerg:
    """Fill an outline; arguments as of `riftberg.bergs.iceberg.Iceberg.from_outline`."""
    where = str(source) if isinstance(source, str) or hasattr(source, "__fspath__") else type(source).__name__
    chosen = outlines.select_outline(outlines.read_features(source, crs), where=where, feature=feature, date=date)
    geometry = outlines.check_outline(chosen.geometry, where=f"{where} ({chosen.label()})", repair=repair)
    plane: FillingPlane = filling_plane(
        geometry.bounds, (geometry.centroid.x, geometry.centroid.y), settings.conformal, settings.earth_radius
    )
    region = outline_region(geometry, plane)
    flat = shapely.transform(geometry, plane.forward, interleaved=False)
    report = {"source": where, "feature": chosen.label()}
    centroid = (geometry.centroid.x, geometry.centroid.y)
    return fill_on_plane(region, plane, centroid, settings, settings.thickness, report, flat)


def fill_mask(mask: Raster, settings: BergOptions, threshold: float, of_ice: bool) -> BondedBerg:
    """Fill the cells of a mask above a threshold; ``of_ice``: its values are thicknesses (m)."""
    ice = IceMask.of(mask, threshold)
    region, plane_of, centroid = mask_region(
        ice, lambda b, c: filling_plane(b, c, settings.conformal, settings.earth_radius)
    )
    ice_itself = unbroken(mask, ice_cells(mask, threshold)).above(threshold) if of_ice else None
    source_of_heights = settings.thickness if ice_itself is None else ice_itself
    return fill_on_plane(region, plane_of, centroid, settings, source_of_heights, {"source": mask.name})


def copy_makeberg(
    mask: Raster,
    settings: BergOptions,
    threshold: float,
    of_ice: bool,
    reference_latitude: float | None,
    spacing: float,
) -> BondedBerg:
    """Make exactly the elements of the reference's script (equations 10.5); ``spacing``: of the resampled mask, m."""
    lattice, plane = makeberg_lattice(
        mask, settings.radius, settings.packing, spacing=spacing, reference_latitude=reference_latitude,
        threshold=threshold, shift=settings.shift, earth_radius=settings.earth_radius,
    )  # fmt: skip
    # The script pairs mask points with positions half a cell further south-west; thickness follows the mask.
    lon, lat = plane.inverse(lattice.x, lattice.y)
    lon, lat = lon - settings.shift[0], lat - settings.shift[1]
    heights = sample_thickness(mask if of_ice else settings.thickness, lon, lat, read_raster)
    report: dict[str, Any] = {"source": mask.name, "rules": "makeberg"}
    settings = settings.model_copy(update={"thickness": heights, "conformal": False})
    return place_on_sphere(lattice.x, lattice.y, plane, settings, report)


def fill_table(rows: list[tuple[int, int, int]], cell_radius: float, settings: BergOptions) -> BondedBerg:
    """Fill the cells of a square lattice; ``cell_radius``: half the side of a cell, m."""
    column, row = expand_rows(rows)
    region = cells_region(column, row, 2.0 * cell_radius)
    centre = (2.0 * cell_radius * (column.mean() + 0.5), 2.0 * cell_radius * (row.mean() + 0.5))
    west, south = 2.0 * cell_radius * column - centre[0], 2.0 * cell_radius * row - centre[1]
    cells = shapely.union_all(shapely.box(west, south, west + 2.0 * cell_radius, south + 2.0 * cell_radius))
    return fill_about(region, centre, settings, "table of lattice rows", cells)


def fill_rectangle(length: float, width: float, settings: BergOptions) -> BondedBerg:
    """Fill a rectangle of some extents (m) along x and y."""
    region = rectangle_region(length, width)
    source = f"rectangle {length:g} m x {width:g} m"
    return fill_about(region, (0.0, 0.0), settings, source, shapely.box(*region.bounds))
