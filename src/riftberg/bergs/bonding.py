"""From positions to checked elements, which of them are bonded, and how strong their bonds are before a run starts.

Two elements are bonded by a rule on the distance of their centres (equations 1.3, and quirk Q14 for the factor 1.25).
`riftberg.state.Bonds.strength` multiplies the fracture thresholds of a bond (1 is nominal). Rifts and values from a
distribution, a list or a map multiply earlier factors, so they may be combined in any order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np

from riftberg.bergs.keys import BergOptions
from riftberg.bergs.lattice import Booleans, element_area
from riftberg.bergs.raster import Raster, is_gridded, projection, read_raster
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, RHO_SEAWATER
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.physics.elementary import cos, cos_array, sin, sin_array
from riftberg.plane import ConformalPlane, near
from riftberg.state import Bonds, Elements, Floats, Ints, new_bonds, new_elements
from riftberg.state.neighbours import ANY, find_pairs
from riftberg.state.rules import Rule, find_breach, is_positive
from riftberg.state.variables import GONE, THICKEST
from riftberg.system.input_files import check_elements, value_shown

RADII_FACTOR = 1.25
"""Elements are bonded when closer than this times the sum of their radii."""

SEARCH_MARGIN = 1e-3
"""Part by which candidates are searched farther than bonds reach."""


@dataclass(frozen=True)
class BondRule:
    """When two elements are bonded; both inequalities are strict."""

    length: float | None = None  # Bonded when the centres are closer than this, m; None means the rule on radii
    packing: Packing = "square"  # Shape of the elements, which gives their inscribed radius
    radii_factor: float = RADII_FACTOR  # Bonded when closer than this times the sum of the radii

    def reaches(self, elements: Elements) -> Floats:
        """Return the reach of each element (m): two are bonded when closer than the sum of their reaches."""
        if self.length is not None:
            return np.full(len(elements.lon), 0.5 * self.length)
        radii: Floats = np.sqrt(elements.length * elements.width * inscribed_share(elements, self.packing))
        return self.radii_factor * radii


@dataclass(frozen=True)
class Metric:
    """How differences of position become metres (equations 2.2)."""

    latlon: bool  # Positions in degrees; otherwise metres
    radius: float = 1.0  # Radius of the sphere, m
    period: float = -1.0  # Zonal period in units of the positions; 0 or less where there is none


def inscribed_share(elements: Elements, packing: Packing) -> Floats:
    """Square of the radius of the inscribed circle over the area, of each element; ``packing`` counts where none is said."""
    sides = np.where(elements.body.sides == 0, 6 if packing == "hexagonal" else 4, elements.body.sides)
    return np.where(sides == 6, 1.0 / (2.0 * math.sqrt(3.0)), 0.25)


def form_bonds(elements: Elements, rule: BondRule, metric: Metric) -> Bonds:
    """Bond all pairs of elements that the rule joins.

    Distances use the metric of the mean latitude of the pair, and the nearest image in a periodic domain.
    """
    first, second, distance = _pairs(elements, rule.reaches(elements), metric)
    bonds = new_bonds(first, second)
    bonds.bond_length[:] = distance
    count_bonds(elements, bonds)
    return bonds


def count_bonds(elements: Elements, bonds: Bonds) -> None:
    """Set ``bond_count`` of the elements from the unbroken bonds."""
    unbroken = bonds.status == 0
    ends = np.concatenate([bonds.first[unbroken], bonds.second[unbroken]])
    elements.bond_count[:] = np.bincount(ends, minlength=len(elements.id))


def separations(metric: Metric, lon_a: Floats, lat_a: Floats, lon_b: Floats, lat_b: Floats) -> tuple[Floats, Floats]:
    """Return eastward and northward metres from points b to points a, with the metric of the mean latitude."""
    dx, dy = lon_a - lon_b, lat_a - lat_b
    if metric.period > 0:
        dx = np.where(np.abs(dx) > 0.5 * metric.period, dx - metric.period * np.round(dx / metric.period), dx)
    if not metric.latlon:
        return dx, dy
    mean = 0.5 * (lat_a + lat_b)
    return dx * (DEGREE * metric.radius * cos_array(mean * DEGREE)), dy * (DEGREE * metric.radius)


def _pairs(elements: Elements, reaches: Floats, metric: Metric) -> tuple[Ints, Ints, Floats]:
    """Return rows of bonded pairs, sorted, and their distances."""
    size = len(elements.lon)
    if size < 2 or reaches.max() <= 0.0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    bad = ~(np.isfinite(elements.lon) & np.isfinite(elements.lat) & np.isfinite(reaches))
    if bad.any():
        k = int(np.argmax(bad))
        raise BergError(
            f"position ({elements.lon[k]}, {elements.lat[k]}) or size {elements.length[k]} x {elements.width[k]} "
            "is no number",
            where=f"element {elements.id[k]}",
            remedy="Bonds need finite positions and sizes",
        )
    # The search measures distances with a fast cosine; a margin keeps all that the exact distance below may join.
    reach = 2.0 * float(reaches.max()) * (1.0 + SEARCH_MARGIN)
    lon, lat = elements.place.lon, elements.place.lat
    neighbours = find_pairs(lon, lat, elements.body.berg, reach, ANY, metric.latlon, metric.radius, metric.period)
    first, second = np.repeat(np.arange(size), np.diff(neighbours.start)), neighbours.partner
    # The search lists each pair from both ends.
    once = first < second
    first, second = first[once], second[once]
    dx, dy = separations(metric, lon[first], lat[first], lon[second], lat[second])
    distance = np.sqrt(dx * dx + dy * dy)
    joined = distance < reaches[first] + reaches[second]
    return first[joined], second[joined], distance[joined]


def give_velocity(elements: Elements, east: Any, north: Any) -> None:
    """Add a velocity (m s-1) to the elements, at the moment of the position and as others see it too."""
    for when in ("", "_sync", "_pair"):
        getattr(elements, f"u{when}")[:] += east
        getattr(elements, f"v{when}")[:] += north


def turn_rigidly(elements: Elements, rate: Any, metric: Metric) -> None:
    """Add a rotation of each piece about its centre of mass to the spins and velocities that elements have.

    ``rate``: rad s-1, counter-clockwise; one number, or one for each element, the same all over a piece.
    """
    rates = np.broadcast_to(np.asarray(rate, np.float64), elements.berg.shape)
    elements.spin[:] += rates
    east, north = np.zeros((2, elements.size))
    pieces, size = np.unique(elements.berg, return_counts=True)
    for piece in pieces[size > 1]:  # a lone element turns about its own centre
        members = elements.berg == piece
        lon, lat, share = (
            elements.lon[members],
            elements.lat[members],
            elements.mass[members] / elements.mass[members].sum(),
        )
        if metric.period > 0.0:
            lon = near(lon, lon[0], metric.period)
        lon0, lat0 = (float(a.mean() + (share * (a - a.mean())).sum()) for a in (lon, lat))
        if metric.latlon:  # exact on the sphere, in the local axes of each element
            x, y, y0 = (lon - lon0) * DEGREE, lat * DEGREE, lat0 * DEGREE
            south = cos(y0) * sin_array(y) * cos_array(x) - sin(y0) * cos_array(y)
            east[members], north[members] = -metric.radius * south, metric.radius * cos(y0) * sin_array(x)
        else:
            east[members], north[members] = lat0 - lat, lon - lon0
    give_velocity(elements, rates * east, rates * north)


OVERLAP_ALLOWED = 0.01
"""Part of R1 + R2 by which two elements may overlap before the berg is refused."""


def make_elements(lon: Floats, lat: Floats, settings: BergOptions, *, static: Any = False) -> Elements:
    """Return elements at positions, with all that follows from radius, thickness and density.

    ``lon``, ``lat``: positions, degrees (m if not ``settings.latlon``).
    """
    check_elements(len(lon), kind=BergError)
    radius, density, velocity = settings.radius, settings.density, settings.velocity
    elements = new_elements(len(lon))
    thickness = np.broadcast_to(broadcast_thickness(settings.thickness, len(lon)), lon.shape)
    _check_elements(lon, lat, radius, thickness, density, settings.latlon)
    elements.lon[:] = elements.lon_pair[:] = lon
    elements.lat[:] = elements.lat_pair[:] = lat
    give_velocity(elements, *velocity)
    elements.static[:] = np.asarray(static, dtype=np.float64)
    elements.thickness[:] = thickness
    area = np.asarray([element_area(float(r), settings.packing) for r in np.atleast_1d(radius)])
    elements.length[:] = elements.width[:] = np.sqrt(area)
    elements.mass[:] = thickness * density * area
    elements.sides[:] = 6 if settings.packing == "hexagonal" else 4
    return elements


THICKNESS_RULES: Final = (
    Rule(
        "thickness", lambda values: ~(values > THICKEST),
        f"No ice is thicker than {THICKEST:g} m: give metres, and leave out fill values",
    ),
    Rule("thickness", is_positive, "Give a positive thickness everywhere under the outline"),
)  # fmt: skip
"""Rules for the thickness of elements, with the remedy."""


def _check_elements(lon: Floats, lat: Floats, radius: Any, thickness: Floats, density: float, latlon: bool) -> None:
    if len(lon) == 0:
        raise BergError("no elements", remedy="Give at least one position")
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        k = int(np.argmin(np.isfinite(lon) & np.isfinite(lat)))
        raise BergError(
            "positions that are not numbers",
            where=f"element {k + 1}",
            remedy="Remove them, or look at placement and size",
        )
    if latlon and abs(lat).max() > 89.0:
        raise BergError(
            f"latitude {lat[np.argmax(abs(lat))]:g}", remedy="Latitudes must lie within 89 degrees of the equator"
        )
    if not ((np.asarray(radius) > 0) & np.isfinite(radius)).all():
        raise BergError(f"radius {np.min(radius)} m", remedy="Give a positive radius in metres")
    if not 0 < density < RHO_SEAWATER:
        raise BergError(
            f"ice density {density} kg m-3",
            remedy=f"Ice floats: give a density between 0 and {RHO_SEAWATER:g}, usually 850 to 917",
        )
    thickness = np.broadcast_to(thickness, lon.shape)
    if breach := find_breach(THICKNESS_RULES, lambda _: thickness):
        others = (
            f" ({breach.count} of {thickness.size} elements are not positive)"
            if breach.rule.test is is_positive
            else ""
        )
        raise BergError(
            f"thickness {breach.value:g} m{others}",
            where=f"element {breach.row + 1} at {lon[breach.row]:.4f}, {lat[breach.row]:.4f}",
            remedy=breach.rule.allowed,
        )


def refuse_overlap(elements: Elements, packing: Packing, metric: Metric) -> None:
    """Raise `BergError` if two elements stand closer than their radii allow."""
    bonds = form_bonds(elements, BondRule(packing=packing), metric)
    radius = inscribed_radius(elements, packing)
    ratio = bonds.bond_length / (radius[bonds.first] + radius[bonds.second])
    if len(ratio) == 0 or ratio.min() >= 1.0 - OVERLAP_ALLOWED:
        return
    k = int(np.argmin(ratio))
    i, j = int(bonds.first[k]), int(bonds.second[k])
    raise BergError(
        f"elements {i + 1} and {j + 1} overlap: {bonds.bond_length[k]:.6g} m apart "
        f"instead of {radius[i] + radius[j]:.6g} m",
        where=f"near {elements.lon[i]:.5f}, {elements.lat[i]:.5f}",
        remedy="Place elements at least two radii apart, or give a smaller radius",
    )


def inscribed_radius(elements: Elements, packing: Packing) -> Floats:
    """Radius (m) of the inscribed circle of bonded elements (equations 1.4)."""
    return np.sqrt(elements.body.length * elements.body.width * inscribed_share(elements, packing))


def broadcast_thickness(values: Any, size: int) -> Floats:
    """Return one thickness, or one for each of ``size`` things, as floats; lists and numbers of any kind will do."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BergError(
            f"thickness {value_shown(values)} is no number", remedy=f"Give one number, {size} numbers, or a map"
        ) from error
    if array.size == 1:
        return array.reshape(())
    if array.shape != (size,):
        raise BergError(
            f"thickness of shape {array.shape}",
            remedy=f"Give one number, {size} numbers (one each), or a map with longitude and latitude",
        )
    return array


def sample_thickness(source: Any, lon: Floats, lat: Floats, read: Any) -> Any:
    """Return thickness at positions: a number, one value per element, or a map that is sampled.

    Of a map only ice counts, values above zero: the zeros and gaps around a berg are left out of the bilinear mean, or
    they would thin its rim.

    ``source``: the thickness, m.
    """
    if not (isinstance(source, str | Path | Raster) or is_gridded(source)):
        return broadcast_thickness(source, len(lon))
    raster: Raster = source if isinstance(source, Raster) else read(source)
    values = raster.above(0.0).sample(lon, lat)
    missing = ~np.isfinite(values)
    if missing.any():
        k = int(np.argmax(missing))
        raise BergError(
            f"no thickness for {missing.sum()} of {len(lon)} elements, the first at {lon[k]:.4f}, {lat[k]:.4f}",
            where=raster.name,
            remedy="Extend the map, fill its gaps and zeros, or give one number",
        )
    return values


def within_pieces(bonds: Bonds, piece: Ints) -> Bonds:
    """Return the bonds whose ends lie in the same piece."""
    same_piece = piece[bonds.first] == piece[bonds.second]
    inner = new_bonds(bonds.first[same_piece], bonds.second[same_piece])
    inner.bond_length[:] = bonds.bond_length[same_piece]
    return inner


def crossings(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool) -> tuple[Ints, Floats, Floats]:
    """Return the first line that crosses each bond (-1 for none), where along the line, and where along the bond.

    A bond that a line only touches counts to one side of it, so that a line through element centres cuts on one side. Along a
    line, of shape (n, 2) in degrees (m on a Cartesian grid), its points have the places 0, 1, 2, ...; along a bond its ends have
    0 and 1.
    """
    lon0, lat0 = (float(a.mean()) for a in (elements.lon, elements.lat))
    # In plane coordinates about the middle of the berg: whether lines cross does not depend on the scale, but on the
    # shape.
    squeeze = cos(lat0 * DEGREE) if latlon else 1.0
    x, y = (elements.lon - lon0) * squeeze, elements.lat - lat0
    ax, ay, bx, by = x[bonds.first], y[bonds.first], x[bonds.second], y[bonds.second]
    number, along, fraction = np.full(len(ax), -1), np.zeros(len(ax)), np.zeros(len(ax))
    for n, line in enumerate(lines):
        east = line[:, 0] - lon0
        if latlon:  # on the branch of the berg, and in one piece where the line itself crosses the date line
            east = np.unwrap(np.mod(east + 180, 360) - 180, period=360.0)
        px, py = east * squeeze, line[:, 1] - lat0
        for k in range(len(line) - 1):
            c, d = (px[k], py[k]), (px[k + 1], py[k + 1])
            # Two segments cross where each has its ends on different sides of the other.
            ends_apart = _left(*c, *d, ax, ay) != _left(*c, *d, bx, by)
            crossed = ends_apart & (_left(ax, ay, bx, by, *c) != _left(ax, ay, bx, by, *d)) & (number < 0)
            dx, dy, ex, ey = d[0] - c[0], d[1] - c[1], (bx - ax)[crossed], (by - ay)[crossed]
            fx, fy, turn = ax[crossed] - c[0], ay[crossed] - c[1], dx * ey - dy * ex
            along[crossed], fraction[crossed] = k + (fx * ey - fy * ex) / turn, (fx * dy - fy * dx) / turn
            number[crossed] = n
    return number, along, np.clip(fraction, 0.0, 1.0)


def mark_cracks(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool, chosen: Booleans) -> None:
    """Note the lines that have parted the ice as cracks: their numbers, and which bonds they cross, where and in which order."""
    number, along, fraction = crossings(elements, bonds, lines, latlon)
    crack_number = int(bonds.crack.max(initial=0))
    for n in np.unique(number[chosen & (number >= 0)]):
        crack_number += 1
        rows = np.flatnonzero(chosen & (number == n))
        rows = rows[np.argsort(along[rows], kind="stable")]
        bonds.crack[rows], bonds.crack_order[rows], bonds.crack_part[rows] = (
            crack_number,
            np.arange(rows.size),
            fraction[rows],
        )


def _left(ax: Any, ay: Any, bx: Any, by: Any, px: Any, py: Any) -> Any:
    """Whether P lies on or left of the directed line from A to B."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) >= 0.0


def crossed_by_mask(elements: Elements, bonds: Bonds, mask: Raster, threshold: float = 0.5) -> Booleans:
    """Return which bonds run through cells of a rift mask; each bond is probed at nine points along it."""
    crossed = np.zeros(len(bonds.first), dtype=bool)
    i, j = bonds.first, bonds.second
    # A rift may be narrower than a bond is long, but not than an eighth of it.
    for fraction in np.linspace(0.0, 1.0, 9):
        lon = (1 - fraction) * elements.lon[i] + fraction * elements.lon[j]
        lat = (1 - fraction) * elements.lat[i] + fraction * elements.lat[j]
        crossed |= np.nan_to_num(mask.sample(lon, lat)) > threshold
    return crossed


def find_crossed(
    elements: Elements, bonds: Bonds, rift: Any, lines: list[Any] | None, *, latlon: bool, threshold: float = 0.5
) -> Booleans:
    """Return which unbroken bonds a rift crosses: its ``lines``, or the mask ``rift`` where these are None."""
    if lines is None:
        mask = rift if isinstance(rift, Raster) else read_raster(rift)
        crossed = crossed_by_mask(elements, bonds, mask, threshold)
    else:
        crossed = crossings(elements, bonds, lines, latlon)[0] >= 0
    on_bonds = bool(crossed.any())
    crossed &= bonds.status == 0
    if on_bonds and not crossed.any():
        raise BergError(
            "the rift crosses only bonds that are broken already",
            where="rift",
            remedy="Leave it out, or give it elsewhere",
        )
    if not on_bonds:
        raise BergError(
            "the rift crosses no bond",
            where="rift",
            remedy="Check that it lies on the berg, in longitude and latitude",
        )
    return crossed


BEYOND: Final = 1.25
"""Distance from the next element, in distances of elements, from which a rift is outside of the ice."""


def share_outside(
    elements: Elements, rift: Any, lines: list[Any] | None, *, latlon: bool, threshold: float = 0.5
) -> float:
    """Return which part of a rift lies outside of the ice: of the length of its ``lines``, or of the cells of a mask.

    0 where it reaches no farther beyond the ice than one element: lines are drawn across an outline to cut it.
    """
    from scipy.spatial import KDTree  # half a second

    plane = ConformalPlane(float(elements.lon[0]), float(elements.lat[0]), EARTH_RADIUS_A68, latlon)
    spacing = float(np.sqrt((elements.length * elements.width).mean()))
    steps = np.zeros(0)
    if lines is None:
        mask = rift if isinstance(rift, Raster) else read_raster(rift)
        row, column = np.nonzero(np.nan_to_num(mask.values) > threshold)
        positions = mask.lon[column], mask.lat[row]
        if mask.crs is not None:
            positions = projection(mask.crs).transform(*positions, direction="INVERSE")
        points = np.column_stack(plane.forward(*positions))
    else:
        drawn = []
        for line in lines:
            ends = np.column_stack(plane.forward(line[:, 0], line[:, 1]))
            distance = np.concatenate([[0.0], np.hypot(*np.diff(ends, axis=0).T).cumsum()])
            at = np.linspace(0.0, distance[-1], 1 + min(int(4.0 * distance[-1] / spacing) + 1, 10_000))
            drawn.append(np.column_stack([np.interp(at, distance, side) for side in ends.T]))
            steps = np.append(steps, np.full(at.size, distance[-1] / at.size))
        points = np.concatenate(drawn)
    centres = np.column_stack(plane.forward(elements.lon, elements.lat))
    outside = KDTree(centres).query(points)[0] > BEYOND * spacing
    if lines is None:
        return float(outside.mean())
    return float(steps[outside].sum() / steps.sum()) if steps[outside].sum() >= spacing else 0.0


def weaken(elements: Elements, bonds: Bonds, chosen: Booleans, *, strength: Floats, broken: bool) -> None:
    """Weaken bonds in place by factors, or remove them: status, bonds of their ends and numbers of the pieces."""
    if not np.all((strength >= 0) & (strength <= 1)):
        raise BergError(f"strength {strength}", where="rift", remedy="Give a factor from 0 to 1")
    if broken:
        bonds.status[chosen] = GONE
        number_pieces(elements, bonds)
    else:
        bonds.strength[chosen] *= strength


def number_pieces(elements: Elements, bonds: Bonds) -> None:
    """Set ``bond_count`` and ``berg`` (pieces, from 1) of the elements from their unbroken bonds."""
    count_bonds(elements, bonds)
    intact = bonds.status == 0
    elements.berg[:] = pieces(len(elements.id), bonds.first[intact], bonds.second[intact])


def pieces(size: int, first: Ints, second: Ints) -> Ints:
    """Give the connected pieces of a graph numbers from 1, in the order of their first element."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(size, size))
    numbers: Ints = connected_components(graph, directed=False)[1].astype(np.int64) + 1
    return numbers


Distribution = Literal["weibull", "normal", "uniform"]
DISTRIBUTIONS = get_args(Distribution)

LEAST_MODULUS = 0.05
"""Weibull modulus below which the mean of the distribution is lost in floating point."""


def given_strengths(values: Any, size: int) -> Floats:
    """Return given relative strengths, one for each of ``size`` bonds, if they are that."""
    try:
        strengths = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BergError(f"{error}", where="strength", remedy=f"Give {size} numbers, one per bond") from error
    if strengths.shape != (size,):
        raise BergError(
            f"values of shape {strengths.shape} for {size} bonds",
            where="strength",
            remedy="Give one value per bond, in the order of berg.bonds, a map, or a distribution",
        )
    _check_strengths(strengths, [f"bond {k}" for k in range(size)])
    return strengths


def sample_bonds(source: Any, elements: Elements, bonds: Bonds) -> Floats:
    """Return the values of a map (Raster, DataArray, file) at the middles of the bonds."""
    raster = source if isinstance(source, Raster) else read_raster(source)
    lon, lat = (0.5 * (a[bonds.first] + a[bonds.second]) for a in (elements.lon, elements.lat))
    values = raster.sample(lon, lat)
    positions = [f"{x:.4f}, {y:.4f}" for x, y in zip(lon, lat, strict=True)]
    missing = np.isnan(values)
    if missing.any():
        raise BergError(
            f"no strength for {missing.sum()} of {len(values)} bonds, the first at {positions[int(np.argmax(missing))]}",
            where=raster.name,
            remedy="Extend the map or fill its gaps",
        )
    _check_strengths(values, positions, raster.name)
    return values


def _check_strengths(strengths: Floats, positions: list[str], name: str = "strength") -> None:
    if breach := find_breach([Rule(name, is_positive, "positive numbers")], lambda _: strengths):
        raise BergError(
            f"strength {breach.value:g} ({breach.count} of {len(strengths)} values are not {breach.rule.allowed})",
            where=f"{name}, {positions[breach.row]}",
            remedy="Give positive factors, 1 where a bond is as strong as the parameters say",
        )


def scatter(size: int, distribution: Distribution, *, shape: float | None, spread: float | None, seed: int) -> Floats:
    """Draw relative strengths of mean 1."""
    generator = np.random.default_rng(seed)
    spread = 0.1 if spread is None else spread
    if distribution == "weibull":
        modulus = 10.0 if shape is None else shape
        if not LEAST_MODULUS <= modulus < math.inf:
            raise BergError(
                f"Weibull modulus {modulus:g}", where="strength", remedy=f"Give a shape of {LEAST_MODULUS:g} or more"
            )
        return generator.weibull(modulus, size) / math.gamma(1.0 + 1.0 / modulus)
    if not 0 <= spread < 1:
        raise BergError(f"spread {spread}", where="strength", remedy="Give a spread from 0 up to, not including, 1")
    if distribution == "uniform":
        return generator.uniform(1.0 - spread, 1.0 + spread, size)
    if distribution != "normal":
        raise BergError(f"distribution {distribution!r}", where="strength", remedy=f"Use {', '.join(DISTRIBUTIONS)}")
    values = generator.normal(1.0, spread, size)
    # Drawn anew, not cut off: a cut at 0 would leave bonds without strength.
    while (low := values <= 0).any():
        values[low] = generator.normal(1.0, spread, int(low.sum()))
    return values
