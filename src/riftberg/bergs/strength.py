"""Strengths of bonds before a run starts: rifts, and values from a distribution, a list or a map.

`riftberg.state.Bonds.strength` multiplies the fracture thresholds of a bond (1 is nominal). Rifts and scatter multiply what
is there, so they may be combined in any order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal, get_args

import numpy as np

from riftberg.bergs.bonding import count_bonds
from riftberg.bergs.lattice import Booleans
from riftberg.bergs.raster import Raster, read_raster
from riftberg.constants import DEGREE
from riftberg.errors import BergError
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.variables import GONE


def crossed_by_lines(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool) -> Booleans:
    """Return which bonds a line crosses.

    A bond that a line only touches counts to one side of it, so that a line through element centres cuts on one side.

    ``lines``: each of shape (n, 2): longitude and latitude (m on a Cartesian grid).
    """
    return crossings(elements, bonds, lines, latlon)[0] >= 0


def crossings(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool) -> tuple[Ints, Floats, Floats]:
    """Return the first line that crosses each bond (-1 for none), where along the line, and where along the bond.

    Along a line its points have the places 0, 1, 2, ...; along a bond its ends have 0 and 1.
    """
    lon0, lat0 = (float(a.mean()) for a in (elements.lon, elements.lat))
    # In plane coordinates about the middle of the berg: whether lines cross does not depend on the scale, but on the
    # shape.
    squeeze = math.cos(lat0 * DEGREE) if latlon else 1.0
    x, y = (elements.lon - lon0) * squeeze, elements.lat - lat0
    ax, ay, bx, by = x[bonds.first], y[bonds.first], x[bonds.second], y[bonds.second]
    number, along, part = np.full(len(ax), -1), np.zeros(len(ax)), np.zeros(len(ax))
    for n, line in enumerate(lines):
        east = line[:, 0] - lon0
        px, py = (np.mod(east + 180, 360) - 180 if latlon else east) * squeeze, line[:, 1] - lat0
        for k in range(len(line) - 1):
            c, d = (px[k], py[k]), (px[k + 1], py[k + 1])
            # Two segments cross where each has its ends on different sides of the other.
            ends_apart = _left(*c, *d, ax, ay) != _left(*c, *d, bx, by)
            crossed = ends_apart & (_left(ax, ay, bx, by, *c) != _left(ax, ay, bx, by, *d)) & (number < 0)
            dx, dy, ex, ey = d[0] - c[0], d[1] - c[1], (bx - ax)[crossed], (by - ay)[crossed]
            fx, fy, turn = ax[crossed] - c[0], ay[crossed] - c[1], dx * ey - dy * ex
            along[crossed], part[crossed] = k + (fx * ey - fy * ex) / turn, (fx * dy - fy * dx) / turn
            number[crossed] = n
    return number, along, np.clip(part, 0.0, 1.0)


def mark_cracks(elements: Elements, bonds: Bonds, lines: Iterable[Any], latlon: bool, chosen: Booleans) -> None:
    """Note the lines that have parted the ice as cracks: their numbers, and which bonds they cross, where and in which order."""
    number, along, part = crossings(elements, bonds, lines, latlon)
    before = int(bonds.crack.max(initial=0))
    for n in np.unique(number[chosen & (number >= 0)]):
        before += 1
        rows = np.flatnonzero(chosen & (number == n))
        rows = rows[np.argsort(along[rows], kind="stable")]
        bonds.crack[rows], bonds.crack_order[rows], bonds.crack_part[rows] = before, np.arange(rows.size), part[rows]


def _left(ax: Any, ay: Any, bx: Any, by: Any, px: Any, py: Any) -> Any:
    """Whether P lies on or left of the directed line from A to B."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) >= 0.0


def crossed_by_mask(elements: Elements, bonds: Bonds, mask: Raster, threshold: float = 0.5) -> Booleans:
    """Return which bonds run through cells of a rift mask; each bond is probed at nine points along it."""
    crossed = np.zeros(len(bonds.first), dtype=bool)
    i, j = bonds.first, bonds.second
    # A rift may be narrower than a bond is long, but not than an eighth of it.
    for part in np.linspace(0.0, 1.0, 9):
        lon = (1 - part) * elements.lon[i] + part * elements.lon[j]
        lat = (1 - part) * elements.lat[i] + part * elements.lat[j]
        crossed |= np.nan_to_num(mask.sample(lon, lat)) > threshold
    return crossed


def crossed_by(
    elements: Elements, bonds: Bonds, rift: Any, lines: list[Any] | None, *, latlon: bool, threshold: float = 0.5
) -> Booleans:
    """Return which unbroken bonds a rift crosses: its ``lines``, or the mask ``rift`` where these are None."""
    if lines is None:
        mask = rift if isinstance(rift, Raster) else read_raster(rift)
        crossed = crossed_by_mask(elements, bonds, mask, threshold)
    else:
        crossed = crossed_by_lines(elements, bonds, lines, latlon)
    crossed &= bonds.status == 0
    if not crossed.any():
        raise BergError(
            "the rift crosses no bond",
            where="rift",
            remedy="Check that it lies on the berg, in longitude and latitude",
        )
    return crossed


def weaken(elements: Elements, bonds: Bonds, chosen: Booleans, *, strength: float, broken: bool) -> None:
    """Weaken bonds in place by a factor, or remove them: status, bonds of their ends and numbers of the pieces."""
    if not 0 <= strength <= 1:
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


def listed(values: Any, size: int) -> Floats:
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


def mapped(source: Any, elements: Elements, bonds: Bonds) -> Floats:
    """Return the values of a map (Raster, DataArray, file) at the middles of the bonds."""
    raster = source if isinstance(source, Raster) else read_raster(source)
    lon, lat = (0.5 * (a[bonds.first] + a[bonds.second]) for a in (elements.lon, elements.lat))
    values = raster.sample(lon, lat)
    places = [f"{x:.4f}, {y:.4f}" for x, y in zip(lon, lat, strict=True)]
    missing = np.isnan(values)
    if missing.any():
        raise BergError(
            f"no strength for {missing.sum()} of {len(values)} bonds, the first at {places[int(np.argmax(missing))]}",
            where=raster.name,
            remedy="Extend the map or fill its gaps",
        )
    _check_strengths(values, places, raster.name)
    return values


def _check_strengths(strengths: Floats, places: list[str], name: str = "strength") -> None:
    bad = ~(np.isfinite(strengths) & (strengths > 0.0))
    if bad.any():
        k = int(np.argmax(bad))
        raise BergError(
            f"strength {strengths[k]:g} ({bad.sum()} of {len(bad)} values are not positive numbers)",
            where=f"{name}, {places[k]}",
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
