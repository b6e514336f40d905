"""How much the edges of a berg bend: largest stress at its fronts and feet, where, with its corners and its width.

The outline of a lattice has steps. Those of up to one element are straightened, and corners count whose sides are both longer
than the ice bends.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from riftberg.config.units import place_text
from riftberg.life.feet import edge_lengths
from riftberg.parameters import Parameters
from riftberg.physics.calving import INSTANT_MODULUS
from riftberg.physics.crevasses import prestress
from riftberg.physics.edge_bending import (
    FOOT_AT_CORNER,
    FRONT_AT_CORNER,
    corner_factor,
    flexural_length,
    foot_moment,
    front_moment,
    surface_stress,
)
from riftberg.physics.elementary import atan2_array
from riftberg.plane import ConformalPlane
from riftberg.state import Elements, Floats, Ints

STEP: Final = 1.05
"""Height of the steps of a lattice that are straightened, in distances of its elements."""

NARROW: Final = 0.4
"""Part of the width of a berg that is not straightened away."""

LONG_SIDES: Final = 2.0
"""Sides of a corner are at least as long, in distances of the elements."""


class EdgeIce(NamedTuple):
    """Elements of a berg: positions (degrees, or m on a plane), length, width and thickness (m)."""

    lon: Floats
    lat: Floats
    length: Floats
    width: Floats
    thickness: Floats

    @property
    def area(self) -> Floats:
        """Plan areas, m2."""
        return self.length * self.width


class Feet(NamedTuple):
    """Feet of a berg."""

    length: float  # How far they jut out on average, m
    youngs: float  # Modulus by which they bend the ice, Pa


@dataclass(frozen=True)
class BentEdge:
    """Largest bending stress at the edges of a berg."""

    stress: float  # Pa
    inland: float  # From the edge, m
    lon: float  # Of the edge, degrees (m on a plane)
    lat: float
    corner: float | None  # Angle of the ice, degrees; None along a straight edge


@dataclass(frozen=True)
class EdgeBending:
    """Bending at the fronts (top in tension) and at the feet (base in tension; None without feet) of a berg."""

    front: BentEdge
    foot: BentEdge | None

    def as_dict(self) -> dict[str, Any]:
        """Return it as a summary holds it."""
        return asdict(self)


def edge_bending(ice: EdgeIce, parameters: Parameters, feet: Feet | None = None) -> EdgeBending:
    """Return how much the edges of a berg bend."""
    earth, density = parameters.earth, parameters.ice.density
    plane = ConformalPlane(float(ice.lon[0]), float(ice.lat[0]), earth.radius, earth.latlon)
    x, y = plane.forward(ice.lon, ice.lat)
    spacing = _spacing(np.column_stack([x, y]), ice.area)
    if x.size == 1:
        half = 0.5 * float(ice.length[0]), 0.5 * float(ice.width[0])
        outline = shapely.box(-half[0], -half[1], *half)
    else:  # around the elements, whichever way their lattice lies
        discs = shapely.buffer(shapely.points(x, y), 0.75 * spacing, quad_segs=4)
        pieces = shapely.get_parts(shapely.buffer(shapely.union_all(discs), -0.25 * spacing))
        outline = max(pieces, key=shapely.area)
    on_edge = shapely.distance(outline.exterior, shapely.points(x, y)) < 0.75 * spacing
    thickness, at = ice.thickness[on_edge], np.column_stack([x, y])[on_edge]
    sides = np.diff(np.asarray(outline.minimum_rotated_rectangle.exterior.coords)[:3], axis=0)
    width = float(np.hypot(*sides.T).min())
    bends = flexural_length(feet.youngs if feet else INSTANT_MODULUS, float(thickness.max()))
    step, side = (min(STEP * spacing, NARROW * width), max(bends, LONG_SIDES * spacing)) if x.size > 1 else (0.0, bends)
    corners = _find_corners(outline, step, side)
    thickest = int(thickness.argmax())
    edges: list[tuple[float, Floats, float | None]] = [(float(thickness[thickest]), at[thickest], None)]
    edges += [(float(thickness[np.hypot(*(at - p).T).argmin()]), p, angle) for p, angle in corners]

    def largest(stresses: list[tuple[float, float]]) -> BentEdge:
        k = int(np.argmax([stress for stress, _ in stresses]))
        _, position, angle = edges[k]
        lon, lat = plane.inverse(*position)
        return BentEdge(*stresses[k], float(lon), float(lat), angle)

    front = largest([
        (surface_stress(front_moment(h, density), h) * (corner_factor(FRONT_AT_CORNER, angle) if angle else 1.0), 0.0)
        for h, _, angle in edges
    ])  # fmt: skip
    if feet is None or feet.length <= 0.0:
        return EdgeBending(front, None)
    stresses = []
    for h, _, angle in edges:
        length = flexural_length(feet.youngs, h)
        strip, inland = foot_moment(feet.length, h, density, length, width)
        wide, _ = foot_moment(feet.length, h, density, length)
        # A narrow berg bends as a strip, corners and all; a wide one most at its sharpest corner.
        at_most = max(strip, wide * corner_factor(FOOT_AT_CORNER, angle)) if angle else strip
        stresses.append((surface_stress(at_most, h), inland))
    return EdgeBending(front, largest(stresses))


def _spacing(centres: Floats, area: Floats) -> float:
    """Return the distance of the elements of a berg, m; elements that have melted at their sides lie farther apart than wide."""
    side = float(np.sqrt(area.mean()))
    if len(centres) == 1:
        return side
    from scipy.spatial import KDTree

    return max(side, float(np.median(KDTree(centres).query(centres, 2)[0][:, 1])))


def _find_corners(outline: Any, step: float, side: float) -> list[tuple[Floats, float]]:
    """Return corners of an outline without its steps, and the angles of the ice there (degrees), between sides as long."""
    ring = np.asarray(orient(shapely.simplify(outline, step)).exterior.coords)[:-1]
    to_previous, to_next = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
    turn = atan2_array(*to_previous.T[::-1]) - atan2_array(*to_next.T[::-1])
    angle = np.degrees(turn) % 360.0
    long = np.minimum(np.hypot(*to_previous.T), np.hypot(*to_next.T)) >= side
    return [(ring[k], float(angle[k])) for k in np.flatnonzero(long)]


def berg_edges(el: Elements, rows: NDArray[np.bool_], parameters: Parameters, youngs: Floats | None) -> EdgeBending:
    """Return how much the edges of a berg bend.

    ``rows``: of its elements; ``youngs``: moduli (Pa) by which edges bend (`riftberg.life.feet.edge_moduli`), None without
    footloose calving.
    """
    feet = None
    foot, edge = np.maximum(el.life.fl_k[rows], 0.0), edge_lengths(el)[rows]
    if youngs is not None and foot.any() and edge.any():
        feet = Feet(float(foot.sum() / edge.sum()), float(foot @ youngs[rows] / foot.sum()))
    return edge_bending(
        EdgeIce(*(a[rows] for a in (el.lon, el.lat, el.length, el.width, el.thickness))), parameters, feet
    )


def front_lines(ice: EdgeIce, berg: Ints, parameters: Parameters) -> list[str]:
    """Return in a sentence how much the fronts of the largest berg bend, beside the pre-stress; ``berg``: of each element."""
    if not berg.size:
        return []
    largest = berg == np.bincount(berg, ice.area).argmax()
    ice = EdgeIce(*(array[largest] for array in ice))
    front = edge_bending(ice, parameters).front
    where = place_text(front.lon, front.lat, latlon=parameters.earth.latlon, digits=2)
    corner = f", a corner of {front.corner:.0f} degrees" if front.corner else ""
    at_rest = prestress(float(np.average(ice.thickness, weights=ice.area)), parameters.ice.density)
    return [
        f"The water bends the fronts by up to {front.stress / 1e3:.0f} kPa of tension at the top (at {where}{corner}), beside a "
        f"pre-stress of {at_rest / 1e3:.0f} kPa: fronts carry crevasses, and this breaks none."
    ]
