"""Outlines and masks as plane regions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from riftberg.bergs.feature import needed
from riftberg.bergs.lattice import Booleans, Region
from riftberg.bergs.placement import Plane
from riftberg.bergs.raster import Raster
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.state import Floats


def outline_region(geometry: Any, plane: Plane) -> Region:
    """Return an outline (shapely, longitude and latitude in degrees) as a region of a plane."""
    shapely = needed("shapely")
    flat = shapely.transform(geometry, plane.forward, interleaved=False)
    shapely.prepare(flat)
    centroid = (flat.centroid.x, flat.centroid.y)
    return Region(flat.bounds, flat.area, centroid, lambda x, y: shapely.contains_xy(flat, x, y))


def mask_region(
    mask: Raster,
    threshold: float,
    plane_at: Callable[[tuple[float, float, float, float], tuple[float, float]], Plane],
) -> tuple[Region, Plane, tuple[float, float]]:
    """Return a mask as a region of the plane that suits it, the plane, and the mask's centroid in degrees.

    Parameters
    ----------
    mask : Raster
        Mask, fraction or thickness.
    threshold : float
        Value above which there is ice.
    plane_at : callable
        Makes a plane from bounds and centroid (degrees).
    """
    values = np.nan_to_num(mask.values)
    ice = values > threshold
    if not ice.any():
        raise BergError(
            f"no value above {threshold:g}; the largest is {values.max():g}",
            where=mask.name,
            remedy="Lower threshold= or choose another variable",
        )
    width, height = mask.cells()
    lon, lat = np.meshgrid(mask.lon, mask.lat)
    cell = np.outer(height, width) * np.cos(lat * DEGREE)
    weight = np.where(ice, cell, 0.0)
    centroid = (float((weight * lon).sum() / weight.sum()), float((weight * lat).sum() / weight.sum()))
    west, east = (lon - 0.5 * width)[ice].min(), (lon + 0.5 * width)[ice].max()
    south, north = (lat - 0.5 * height[:, None])[ice].min(), (lat + 0.5 * height[:, None])[ice].max()
    plane = plane_at((west, south, east, north), centroid)
    edges_x, edges_y = plane.forward(*_edge(west, south, east, north))
    bounds = (float(edges_x.min()), float(edges_y.min()), float(edges_x.max()), float(edges_y.max()))
    # In a fractional mask a cell counts by its fraction; elsewhere it is ice or not.
    share = values if values.min() >= 0.0 and values.max() <= 1.0 + 1e-9 else ice
    area = float((share * cell).sum()) * _square_degree(plane, centroid)

    def inside(x: Floats, y: Floats) -> Booleans:
        found: Booleans = np.nan_to_num(mask.sample(*plane.inverse(x, y))) > threshold
        return found

    x, y = plane.forward(lon[ice], lat[ice])
    middle = (float(np.average(x, weights=cell[ice])), float(np.average(y, weights=cell[ice])))
    return Region(bounds, area, middle, inside), plane, centroid


def _edge(west: float, south: float, east: float, north: float) -> tuple[Floats, Floats]:
    """Return points along the edge of a longitude-latitude box."""
    part = np.linspace(0.0, 1.0, 33)
    lon, lat = west + part * (east - west), south + part * (north - south)
    all_lon = np.concatenate([lon, lon, np.full(33, west), np.full(33, east)])
    return all_lon, np.concatenate([np.full(33, south), np.full(33, north), lat, lat])


def _square_degree(plane: Plane, centroid: tuple[float, float]) -> float:
    """Area (m2) of one square degree at the equator, from the plane's own scale along the meridian."""
    lat = np.array([centroid[1] - 1e-3, centroid[1] + 1e-3])
    x, y = plane.forward(np.full(2, centroid[0]), lat)
    return float((np.hypot(x[1] - x[0], y[1] - y[0]) / 2e-3) ** 2)
