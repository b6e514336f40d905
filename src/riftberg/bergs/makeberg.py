"""The rules by which the reference's scripts turn a gridded mask into elements (equations 10.5; thermodynamics 8.2, 8.3).

They are kept for parity: the published A68a run starts from what they give. Two of their habits are deliberate copies:
the mask is counted from its first point while positions are measured from half a cell further south-west, and every
longitude uses its element's own latitude.
"""

from __future__ import annotations

import numpy as np

from riftberg.bergs.lattice import Lattice, lattice_points
from riftberg.bergs.placement import ReferencePlane
from riftberg.bergs.raster import Raster
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.state import Floats


def makeberg_lattice(
    mask: Raster,
    radius: float,
    packing: Packing,
    *,
    spacing: float = 500.0,
    reference_latitude: float | None = None,
    threshold: float = 0.5,
    shift: tuple[float, float] = (0.0, 0.0),
    earth_radius: float,
) -> tuple[Lattice, ReferencePlane]:
    """Return the elements of a mask as the reference's script places them, and the map to the sphere.

    ``mask``: ice where positive; ``radius``, ``packing``: radius (m) and packing of the elements; ``spacing``: spacing
    (m) of the plane grid on which the mask is resampled; ``reference_latitude``: latitude (degrees) that scales the
    longitudes of the mask; ``earth_radius``: radius of the sphere, m.
    """
    if mask.crs is not None:
        raise BergError(
            "a projected mask", where=mask.name, remedy='rules="makeberg" needs a grid of longitude and latitude'
        )
    lon = mask.lon + shift[0]
    lon = lon + 360 if lon[0] < 0 else lon
    lat = mask.lat + shift[1]
    fraction = (np.nan_to_num(mask.values) > 0).astype(np.float64)
    reference = float(lat.mean()) if reference_latitude is None else reference_latitude
    scale = np.pi / 180 * earth_radius
    x, y = scale * np.cos(np.radians(reference)) * lon, scale * lat
    fine = _resampled(x, y, fraction, spacing)
    bounds = (0.0, 0.0, x[-1] - x[0] + (x[1] - x[0]), y[-1] - y[0] + (y[1] - y[0]))
    lattice = lattice_points(bounds, radius, packing)
    i, j = (lattice.x // spacing).astype(int), (lattice.y // spacing).astype(int)
    there = (i < fine.shape[1]) & (j < fine.shape[0])
    lattice = lattice.where(there)
    lattice = lattice.where(fine[j[there], i[there]] > threshold)
    west, south = lon[0] - 0.5 * (lon[1] - lon[0]), lat[0] - 0.5 * (lat[1] - lat[0])
    return lattice, ReferencePlane(float(west), float(south), reference, earth_radius)


def _resampled(x: Floats, y: Floats, fraction: Floats, spacing: float) -> Floats:
    """Bilinear values of the mask on a plane grid that starts at its first point."""
    grid = Raster(x, y, fraction, "mask")
    fine_x, fine_y = np.arange(x[0], x[-1], spacing), np.arange(y[0], y[-1], spacing)
    return grid.sample(*np.meshgrid(fine_x, fine_y))
