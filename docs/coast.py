"""Make the coastline that comes with Riftberg, ``src/riftberg/viz/coast.npz``, from Natural Earth (public domain).

    python docs/coast.py FOLDER

FOLDER holds GeoJSON of Natural Earth 5 in degrees: ``land_10m_south`` (south of 35 S), ``land_10m_north`` (north of 40 N),
``ice_shelves_10m`` and ``land_50m`` (the whole world). Lines are simplified by `TOLERANCE`, between the two 1:10 million
pieces, where no icebergs drift, by more; islands below `SMALLEST` are left out. Points are kept as differences of thousandths
of a degree, which pack well.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import shapely

TOLERANCE = 0.02, 0.05
"""Degrees, at 1:10 million and between."""

SMALLEST = 2e-4, 0.02
"""Square degrees of the smallest island or lake, likewise; 1 km2 at 60 degrees of latitude."""

STEPS = 1000
"""Units of the stored points in a degree."""

TARGET = Path(__file__).resolve().parents[1] / "src" / "riftberg" / "viz" / "coast.npz"


def polygons(file: Path, tolerance: float, smallest: float, south: float = -90.0, north: float = 90.0) -> list[Any]:
    """Return the simplified polygons of a file between two parallels."""
    shapes = shapely.from_geojson(file.read_text())
    shapes = shapely.clip_by_rect(shapely.make_valid(shapely.get_parts(shapes)), -180.0, south, 180.0, north)
    parts = shapely.get_parts(shapely.make_valid(shapely.simplify(shapely.get_parts(shapes), tolerance)))
    return [part for part in parts if part.geom_type == "Polygon" and part.area >= smallest]


def packed(
    parts: list[Any], smallest: float
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return differences of the points of all rings, the sizes of the rings, and the number of rings of each polygon."""
    points, sizes, counts = [], [], []
    for part in parts:
        holes = [ring for ring in part.interiors if shapely.Polygon(ring).area >= smallest]
        for ring in (part.exterior, *holes):
            xy = np.round(np.asarray(ring.coords)[:-1] * STEPS).astype(np.int32)
            points.append(np.diff(xy, axis=0, prepend=0 * xy[:1]))
            sizes.append(len(xy))
        counts.append(1 + len(holes))
    return np.concatenate(points), np.array(sizes, np.int32), np.array(counts, np.int32)


def main(folder: Path) -> None:
    """Write the file."""
    (fine, coarse), (island, wide) = TOLERANCE, SMALLEST
    land = polygons(folder / "land_10m_south.geojson", fine, island)
    land += polygons(folder / "land_10m_north.geojson", fine, island)
    land += polygons(folder / "land_50m.geojson", coarse, wide, -35.0, 40.0)
    shelves = polygons(folder / "ice_shelves_10m.geojson", fine, island)
    arrays = {}
    for name, parts in (("land", land), ("shelf", shelves)):
        points, sizes, counts = packed(parts, island)
        arrays |= {
            f"{name}_x": points[:, 0],
            f"{name}_y": points[:, 1],
            f"{name}_sizes": sizes,
            f"{name}_rings": counts,
        }
    np.savez_compressed(TARGET, **{name: values.astype(np.int32) for name, values in arrays.items()})
    print(
        f"{TARGET.name}: {TARGET.stat().st_size / 1e3:.0f} kB, {len(arrays['land_x']) + len(arrays['shelf_x'])} points"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
