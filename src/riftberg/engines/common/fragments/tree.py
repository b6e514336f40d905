"""Fragments of a berg and their family tree: which split from which, when and where; and the size of each berg as a whole.

Waves and the drag on sides act on the outline of a berg. How many sides of its elements are counted along that outline depends
on how the lattice lies in it (up to the root of two more), so the outline is measured by what does not: area and second moments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.engines.common.forces.media import on_the_floor
from riftberg.engines.common.forces.sizes import count_sides
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import exposed_sides
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import nearest_image
from riftberg.state import Bonds, Elements, Floats, Ints


@dataclass(frozen=True)
class Fragment:
    """One fragment at the time of its birth."""

    number: int  # Number that its elements carry in ``Elements.berg``
    # Number of the fragment that it split from; 0 for a berg that was there at the start or was added to the run
    parent: int
    birth_time: float  # Seconds since the start of the run
    lon: float  # Centroid at birth, degrees (m on a Cartesian grid)
    lat: float  # Centroid at birth, degrees (m on a Cartesian grid)
    elements: int  # Number of elements
    area: float  # Plan area, m2
    mass: float  # kg
    bonds_broken: int  # Broken bonds that joined it to the rest of its parent
    grounded: bool  # Whether one of its elements was aground at birth, or an end of a bond of the cracks that freed it
    # Name of a berg; a fragment has that of the berg that it comes from, with its number among the fragments of that
    name: str = ""
    # Number of the berg from whose edge it calved by the footloose mechanism; 0 for all others. No bond broke, so it
    # has no ``parent``
    calved_from: int = 0


class FragmentTree:
    """All fragments that a run has seen.

    ``bergs``: name and number of elements of each berg of the start, by row ((str, int)).
    """

    def __init__(self, rows: list[Fragment] | None = None, bergs: Sequence[tuple[str, int]] = ()) -> None:
        self.rows: list[Fragment] = list(rows or [])
        self.bergs = tuple(bergs)
        self.calved_from: dict[int, int] = {}

    def __repr__(self) -> str:
        return f"<FragmentTree: {len(self.rows)} bergs and fragments, {len(self.breakups)} of them broken off>"

    @property
    def breakups(self) -> list[Fragment]:
        """Fragments that split from a parent."""
        return [row for row in self.rows if row.parent > 0]

    def update(self, elements: Elements, bonds: Bonds, time: float, p: KernelParameters) -> int:
        """Find the fragments, number them in ``elements.berg`` and record births.

        The heaviest piece of a fragment keeps its number, the others get new ones; bergs present at the start are
        numbered from 1. A berg added to the run gets the next number.
        """
        if elements.size == 0:
            return 0
        component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
        count = int(component.max()) + 1
        mass: Floats = np.bincount(component, weights=elements.mass, minlength=count).astype(np.float64)
        number = self._inherited(component, mass, elements.berg)
        unnumbered = np.flatnonzero(number == 0)
        cuts = _Cuts(component, elements, bonds)
        touching = on_the_floor(elements.body.thickness, elements.environment.depth, elements.keel.floor_load, p)
        # All rows of a part in turn, in their order.
        order = np.argsort(component, kind="stable")
        ends = np.cumsum(np.bincount(component))
        recorded = len(self.rows)
        names = _Names(self.rows) if unnumbered.size else None
        first = order[np.append(0, ends)[unnumbered]]
        parents, bergs = elements.body.berg[first].tolist(), self._name_initial_bergs(first) if recorded == 0 else []
        ids, single = elements.body.id[first].tolist(), _measure_singles(first, elements)
        on_ground = np.bincount(component[touching], minlength=count) + cuts.grounded > 0
        # A population begins with tens of thousands of bergs: what they are is found for all at once.
        for n, k in enumerate(unnumbered.tolist()):
            rows = order[ends[k - 1] if k else 0 : ends[k]]
            parent = parents[n] if 0 < parents[n] <= recorded else 0
            assert names is not None
            name = names.free(self.rows[self.origin(parent) - 1].name if parent else bergs[n] if bergs else "")
            row = Fragment(
                len(self.rows) + 1, parent, time, *(single[n] if rows.size == 1 else _measures(rows, elements, p.period)),
                int(cuts.count[k]), bool(on_ground[k]), name, self.calved_from.get(ids[n], 0),
            )  # fmt: skip
            number[k] = row.number
            self.rows.append(row)
        self.calved_from.clear()
        elements.berg[:] = number[component]
        measure_outlines(elements, p)
        return count

    def origin(self, number: int) -> int:
        """Return the number of the berg that a fragment comes from: itself for a berg of the start, or one added later."""
        while 0 < number <= len(self.rows) and self.rows[number - 1].parent > 0:
            number = self.rows[number - 1].parent
        return number

    def _name_initial_bergs(self, rows: Ints) -> list[str]:
        """Return the names of the bergs of the start to which elements belong; none where they are not known."""
        if not self.bergs:
            return []
        last = np.cumsum([count for _, count in self.bergs])
        berg = np.minimum(np.searchsorted(last, rows, side="right"), last.size - 1)
        return [self.bergs[k][0] for k in berg.tolist()]

    def _inherited(self, component: Ints, mass: Floats, berg: Ints) -> Ints:
        """Give the heaviest part of each known fragment its number; 0 for all other parts."""
        number = np.zeros(mass.size, np.int64)
        if not self.rows:
            return number
        first = np.unique(component, return_index=True)[1]
        old = berg[first]
        numbered = np.flatnonzero(old > 0)
        # By number, then from the heaviest to the lightest; of equals the first goes first.
        numbered = numbered[np.lexsort((-mass[numbered], old[numbered]))]
        keeping = numbered[np.unique(old[numbered], return_index=True)[1]]
        number[keeping] = old[keeping]
        return number


class _Names:
    """Names that are taken, and the next number to try for each berg: thousands of pieces may be born at once."""

    def __init__(self, rows: Sequence[Fragment]) -> None:
        self._taken = {row.name for row in rows}
        self._next: dict[str, int] = {}

    def free(self, berg: str) -> str:
        """Return the name of a piece: that of its berg, for the first, or with the first number that is free."""
        name = berg
        # The pieces of a berg that lie apart at the start are numbered as its fragments are.
        while berg and name in self._taken:
            self._next[berg] = self._next.get(berg, 0) + 1
            name = f"{berg}.{self._next[berg]}"
        self._taken.add(name)
        return name


class _Cuts:
    """Broken bonds that joined the parts to the rest of the fragment that they were one with, counted per part."""

    def __init__(self, component: Ints, el: Elements, bonds: Bonds) -> None:
        first, second = component[bonds.first], component[bonds.second]
        # Not those to pieces that had left the parent before: they set these free.
        same_fragment = el.body.berg[bonds.first] == el.body.berg[bonds.second]
        cut = (bonds.status != 0) & (first != second) & same_fragment
        # A cut counts for the parts on both of its sides.
        ends = np.concatenate([first[cut], second[cut]])
        on_ground = np.tile(_of_grounded_cracks(el, bonds, (bonds.status != 0) & same_fragment)[cut], 2)
        self.count = np.bincount(ends, minlength=component.max() + 1)
        self.grounded = np.bincount(ends[on_ground], minlength=component.max() + 1)


def _of_grounded_cracks(el: Elements, bonds: Bonds, broken: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each of the broken bonds of a fragment broke in a crack of which a bond had an end aground.

    A crack is what breaks in one fragment at one moment. In equilibrium the load of the sea floor on one element is
    felt everywhere at once, and the bonds that then free a piece are seldom those at the element that touched.
    """
    marks = np.zeros(bonds.status.size, np.bool_)
    if broken.any():
        crack = np.column_stack([el.body.berg[bonds.first[broken]], bonds.break_time[broken]])
        number = np.unique(crack, axis=0, return_inverse=True)[1].ravel()
        marks[broken] = np.bincount(number, bonds.break_grounded[broken])[number] > 0
    return marks


def _measures(rows: Ints, el: Elements, period: float) -> tuple[float, float, int, float, float]:
    """Centroid, number of elements, area (m2) and mass (kg) of some elements."""
    body, mass = el.body, el.body.mass[rows]
    lon, lat = centroid(el.place.lon[rows], el.place.lat[rows], mass, period)
    return lon, lat, rows.size, float((body.length * body.width)[rows].sum()), float(mass.sum())


def _measure_singles(rows: Ints, el: Elements) -> list[tuple[float, float, int, float, float]]:
    """Return the same for bergs of one element each."""
    body, place = el.body, el.place
    mass, area = body.mass[rows], body.length[rows] * body.width[rows]
    means = [
        np.where(mass > 0.0, x[rows] * mass / np.where(mass > 0.0, mass, 1.0), x[rows]) for x in (place.lon, place.lat)
    ]
    ones = [1] * rows.size
    return list(zip(means[0].tolist(), means[1].tolist(), ones, area.tolist(), mass.tolist(), strict=True))


def centroid(lon: Floats, lat: Floats, weight: Floats, period: float = 360.0) -> tuple[float, float]:
    """Weighted mean position; longitudes are joined across the seam of a periodic domain first."""
    x = lon - period * np.round((lon - lon[0]) / period) if period > 0.0 else lon
    total = weight.sum()
    mean_x, mean_y = float((x * weight).sum() / total), float((lat * weight).sum() / total)
    # Elements without weight have no mean; the place of the first stands for them.
    return (mean_x, mean_y) if math.isfinite(mean_x) else (float(lon[0]), float(lat[0]))


def measure_outlines(elements: Elements, p: KernelParameters) -> None:
    """Set length and width of the berg that each element belongs to, and the element's share of its sides.

    Bergs whose area is that of their rectangle stay as they were measured: what happens to others must not change their digits.
    """
    if p.forces_by_element:  # nothing there reads them
        return
    place, body = elements.place, elements.body
    numbers, component = np.unique(body.berg, return_inverse=True)
    count = numbers.size
    share_sides(body.length, body.width, body.sides, body.bond_count, component, count, p, body.side_share)
    area = np.bincount(component, body.length * body.width, count)
    stale = np.zeros(count, bool)
    stale[component[np.abs(body.berg_length * body.berg_width - area[component]) > 1e-12 * area[component]]] = True
    if not stale.any():
        return
    length, width = equivalent_rectangles(
        place.lon, place.lat, body.length, body.width, component, count, p.latlon, p.earth_radius, p.period
    )
    rows = stale[component]
    body.berg_length[rows], body.berg_width[rows] = length[component[rows]], width[component[rows]]


@kernel
def _on_sphere(lon: float, lat: float, start: float, latlon: bool, period: float) -> tuple[float, float, float]:
    """Direction from the centre of the sphere; on a plane the place (m) in its image nearest to ``start``."""
    if not latlon:
        return start + nearest_image(lon - start, period), lat, 0.0
    lam, phi = lon * DEGREE, lat * DEGREE
    return cos(phi) * cos(lam), cos(phi) * sin(lam), sin(phi)


@kernel
def equivalent_rectangles(
    lon: Floats, lat: Floats, length: Floats, width: Floats, component: Ints, count: int, latlon: bool, radius: float,
    period: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Length and width (m) of the rectangle with the area of each berg and the ratio of its principal second moments.

    With the principal moments ``i_1 >= i_2`` of the area A: ``L = sqrt(A r)``, ``W = sqrt(A / r)``, ``r = sqrt(i_1 / i_2)``. A
    rectangle of elements gives its own sides, and a berg of one element those of the element.

    Parameters
    ----------
    lon, lat : ndarray
        Positions, degrees (m if not ``latlon``).
    length, width : ndarray
        Sides of the elements, m.
    component : ndarray of int
        Berg of each element, from 0.
    count : int
        Number of bergs.
    latlon : bool
        Positions are degrees.
    radius, period : float
        Radius of the sphere, m, and period of the longitude (0: none).
    """
    first, number, area = np.full(count, -1, np.int64), np.zeros(count), np.zeros(count)
    ixx, iyy, ixy = np.zeros((3, count))
    for e in range(component.size):
        k = component[e]
        if first[k] < 0:
            first[k] = e
        number[k] += 1.0
        area[k] += length[e] * width[e]
    # Centres on the sphere itself, and distances on the plane that touches it there: degrees of longitude are none at a pole.
    centre = np.zeros((count, 3))
    for e in range(component.size):
        k, a = component[e], length[e] * width[e]
        if number[k] > 1.0:
            x, y, z = _on_sphere(lon[e], lat[e], lon[first[k]], latlon, period)
            centre[k, 0] += a * x
            centre[k, 1] += a * y
            centre[k, 2] += a * z
    for e in range(component.size):
        k, a = component[e], length[e] * width[e]
        if number[k] > 1.0:
            x, y, z = _on_sphere(lon[e], lat[e], lon[first[k]], latlon, period)
            if latlon:
                cx, cy, cz = centre[k]
                along, distance = math.hypot(cx, cy), math.sqrt(cx * cx + cy * cy + cz * cz)
                c, s = (cx / along, cy / along) if along > 0.0 else (1.0, 0.0)
                x, y = radius * (c * y - s * x), radius * (along * z - cz * (c * x + s * y)) / distance
            else:
                x, y = x - centre[k, 0] / area[k], y - centre[k, 1] / area[k]
            # An element of many may lie any way round: the mean of its own two moments counts along both axes.
            moment = (length[e] * length[e] + width[e] * width[e]) / 24.0
            ixx[k] += a * (x * x + moment)
            iyy[k] += a * (y * y + moment)
            ixy[k] += a * x * y
    long, short = np.empty(count), np.empty(count)
    for k in range(count):
        if number[k] > 1.0:
            half = 0.5 * math.sqrt((ixx[k] - iyy[k]) ** 2 + 4.0 * ixy[k] * ixy[k])
            mean = 0.5 * (ixx[k] + iyy[k])
            ratio = math.sqrt((mean + half) / (mean - half))
        else:
            single = first[k]
            ratio = max(length[single], width[single]) / min(length[single], width[single])
        long[k], short[k] = math.sqrt(area[k] * ratio), math.sqrt(area[k] / ratio)
    return long, short


@kernel
def share_sides(
    length: Floats, width: Floats, sides: Ints, bonds: Ints, component: Ints, count: int, p: KernelParameters, share: Floats
) -> None:  # fmt: skip
    """Write to ``share`` the part of the sides of its berg that each element bears: by the sides that no bond covers."""
    total = np.zeros(count)
    for e in range(component.size):
        share[e] = exposed_sides(bonds[e], count_sides(sides[e], p), p.bonds_on) * math.sqrt(length[e] * width[e])
        total[component[e]] += share[e]
    for e in range(component.size):
        if total[component[e]] > 0.0:
            share[e] /= total[component[e]]
