"""Fragments of a berg and their family tree: who split from whom, when and where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.conglomerates import connected_parts
from riftberg.stepping.media import aground


@dataclass(frozen=True)
class Fragment:
    """One fragment at the time of its birth.

    Attributes
    ----------
    number : int
        Number that its elements carry in ``Elements.berg``.
    parent : int
        Number of the fragment that it split from; 0 for a berg that was there at the start.
    birth_time : float
        Seconds since the start of the run.
    lon, lat : float
        Centroid at birth, degrees (m on a Cartesian grid).
    elements : int
        Number of elements.
    area : float
        Plan area, m2.
    mass : float
        kg.
    bonds_broken : int
        Broken bonds that joined it to the rest of its parent.
    grounded : bool
        Whether one of its elements was aground at birth or where one of those bonds broke.
    """

    number: int
    parent: int
    birth_time: float
    lon: float
    lat: float
    elements: int
    area: float
    mass: float
    bonds_broken: int
    grounded: bool


class FragmentTree:
    """All fragments that a run has seen.

    Attributes
    ----------
    rows : list of Fragment
        In order of birth; numbers rise by one.
    """

    def __init__(self, rows: list[Fragment] | None = None) -> None:
        self.rows: list[Fragment] = list(rows or [])

    @property
    def breakups(self) -> list[Fragment]:
        """Fragments that split from a parent."""
        return [row for row in self.rows if row.parent > 0]

    def update(self, elements: Elements, bonds: Bonds, time: float, p: KernelParameters) -> int:
        """Find the fragments, number them in ``elements.berg`` and record births.

        The heaviest piece of a fragment keeps its number, the others get new ones; bergs present at the start are
        numbered from 1.

        Parameters
        ----------
        elements, bonds : Elements, Bonds
            The state; ``elements.berg`` is changed.
        time : float
            Seconds since the start.
        p : KernelParameters

        Returns
        -------
        int
            Number of fragments now.
        """
        part = connected_parts(elements.mass.size, bonds.first, bonds.second, bonds.status)
        count = int(part.max()) + 1
        mass: Floats = np.bincount(part, weights=elements.mass, minlength=count).astype(np.float64)
        number = self._inherited(part, mass, elements.berg)
        newborn = [k for k in range(count) if number[k] == 0]
        for k in newborn:
            row = self._describe(part == k, elements, bonds, time, p)
            number[k] = row.number
            self.rows.append(row)
        elements.berg[:] = number[part]
        return count

    def _inherited(self, part: Ints, mass: Floats, berg: Ints) -> Ints:
        """Give the heaviest part of each known fragment its number; 0 for all other parts."""
        number = np.zeros(mass.size, np.int64)
        if not self.rows:
            return number
        first = np.unique(part, return_index=True)[1]
        heaviest: dict[int, int] = {}
        for k in range(mass.size):
            old = int(berg[first[k]])
            if old not in heaviest or mass[k] > mass[heaviest[old]]:
                heaviest[old] = k
        for old, k in heaviest.items():
            number[k] = old
        return number

    def _describe(self, inside: np.ndarray, el: Elements, bonds: Bonds, time: float, p: KernelParameters) -> Fragment:
        parent = int(el.berg[inside][0]) if self.rows else 0
        # Not those to pieces that had left the parent before: they set these free.
        together = el.berg[bonds.first] == el.berg[bonds.second]
        cut = (bonds.status != 0) & (inside[bonds.first] != inside[bonds.second]) & together
        touching = aground(el.thickness[inside], el.depth[inside], p).any()
        lon, lat = centroid(el.lon[inside], el.lat[inside], el.mass[inside], p.period)
        return Fragment(
            number=len(self.rows) + 1,
            parent=parent,
            birth_time=time,
            lon=lon,
            lat=lat,
            elements=int(inside.sum()),
            area=float((el.length * el.width)[inside].sum()),
            mass=float(el.mass[inside].sum()),
            bonds_broken=int(cut.sum()),
            grounded=bool(touching or (bonds.break_grounded[cut] > 0).any()),
        )


def centroid(lon: Floats, lat: Floats, weight: Floats, period: float = 360.0) -> tuple[float, float]:
    """Weighted mean position; longitudes are joined across the seam of a periodic domain first."""
    x = lon - period * np.round((lon - lon[0]) / period) if period > 0.0 else lon
    total = weight.sum()
    mean_x, mean_y = float((x * weight).sum() / total), float((lat * weight).sum() / total)
    return (mean_x, mean_y) if math.isfinite(mean_x) else (float(lon[0]), float(lat[0]))
