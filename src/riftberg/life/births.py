"""Births of footloose calving: a child is drawn on the rim of its parent, put where there is sea, and added after the step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np

from riftberg.engines.common.broad_phase import NEWBORN_CHILD
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.life.draws import CalvingDraws
from riftberg.life.free_places import FreePlaces, corner_reach
from riftberg.ocean.cells import locate_points
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.physics.calving import rim_place
from riftberg.physics.elementary import cos, sin
from riftberg.physics.geometry import move, wrap_around
from riftberg.state import Bonds, Elements, Floats, Ints

CHILD: Final = NEWBORN_CHILD
"""Foot of a child of footloose calving that takes no part in contact yet."""

FARTHEST: Final = 3.0
"""How far from the rim of its parent a child is put at most, in distances at which both touch; else it waits."""


class Living(Protocol):
    """A model, as far as births and deaths go."""

    fragments: FragmentTree

    @property
    def elements(self) -> Elements:
        """The elements now."""

    @property
    def bonds(self) -> Bonds:
        """The bonds now."""

    def append(
        self, elements: Elements, bonds: Bonds | None = None, *, parent: int = 0, ids: Ints | None = None
    ) -> Ints:
        """Add elements and return their identifiers."""

    def remove(self, ids: Ints) -> None:
        """Take elements out, with their bonds."""


class Circumstances(NamedTuple):
    """When and where bergs calve."""

    year: int  # Date of birth
    day: float  # Date of birth
    step: int  # Number of the long step
    grid: Grid | None  # Grid on which the children lie
    draws: CalvingDraws  # Random places on the rim
    # Processes of the reference along x and y whose results are followed; 1, 1 in runs of Riftberg's own
    ranks: tuple[int, int] = (1, 1)
    growth: Floats | None = None  # Rates of `find_growth`; None where edges do not relax
    # Gives the identifier of a child from the cell (column, row) of its parent; None where the population numbers them
    names: Callable[[int, int], int] | None = None

    def rank(self, i: int, j: int) -> int:
        """Return the process of the reference that owns a cell (column, row)."""
        if self.grid is None or self.ranks == (1, 1):
            return 0
        g, (across, up) = self.grid.arrays, self.ranks
        return (j - g.halo) * up // g.nj * across + (i - g.halo) * across // g.ni


class Births:
    """Children of the bergs of a model in one step."""

    def __init__(self, model: Living, p: Parameters, when: Circumstances) -> None:
        self.model, self.p, self.when = model, p, when
        self.el = model.elements
        self.born: list[tuple[Elements, int]] = []
        beside = p.stepping.interactions and not p.quirks.births_at_centre
        self.free = FreePlaces(self.el, p) if beside else None

    def add(self) -> None:
        """Add the children to the model."""
        for child, parent in self.born:
            self._add(child, parent)

    def draw_rim(self, e: int, width: float, length: float) -> tuple[float, float]:
        """Draw a place on the rim, m east and north of the parent; none without displacement."""
        if not self.p.footloose.displace:
            return 0.0, 0.0
        rank = self.when.rank(int(self.el.cell_i[e]), int(self.el.cell_j[e]))
        draw = self.when.draws.draw(rank, int(self.el.body.id[e]), self.when.step)
        x, y = rim_place(draw, float(width), float(length), self.p.footloose.half_west_rim)
        return (x, y) if self.p.footloose.footloose_sets_density else self._turn_offset(e, x, y)

    def _turn_offset(self, e: int, x: float, y: float) -> tuple[float, float]:
        """Metres east and north of metres along the length and the width of an element that has turned."""
        angle = float(self.el.motion.rotation[e])
        cosine, sine = cos(angle), sin(angle)
        return x * cosine - y * sine, x * sine + y * cosine

    def bear(
        self, e: int, offset: tuple[float, float], piece: tuple[float, float, float, float, float], scaling: float,
        heat: float | None = None,
    ) -> bool:  # fmt: skip
        """Make a child of an element: mass (kg), thickness, width, length (m), bits (kg) of one berg; how many (files, 2.6).

        ``heat``: of the ice (J kg-1), by default as in the element.

        Returns whether there is room for it: where other ice lies, it is for the caller to keep the ice.
        """
        child = self.el.taken([e])
        body, life = child.body, child.life
        body.mass[0], body.thickness[0], body.width[0], body.length[0], life.mass_of_bits[0] = piece
        life.mass_scaling[0], life.fl_k[0] = scaling, CHILD
        if heat is not None:
            life.heat_density[0] = heat
        life.mass_of_fl_bits[0] = life.mass_of_fl_bergy_bits[0] = 0.0
        # A child is a copy of its parent's row; what belongs to the lattice of the parent does not go with it.
        for array in (body.bond_count, body.bond_area, body.substeps, body.load_x, body.load_y, body.in_contact):
            array[0] = 0
        for array in child.keel:  # whatever the floor does to the parent
            array[0] = 0.0
        body.free_y[0] = 1.0
        child.motion.spin[0] = child.motion.rotation[0] = child.kicks.spin_rate[0] = 0.0
        if self.free is None:
            self._put(child, e, offset)
        elif not self._put_beside(child, e, offset, self.free):
            return False
        life.start_lon[0], life.start_lat[0] = child.place.lon[0], child.place.lat[0]
        life.start_year[0], life.start_day[0] = self.when.year, self.when.day
        self.born.append((child, e))
        return True

    def _put_beside(self, child: Elements, e: int, offset: tuple[float, float], free: FreePlaces) -> bool:
        """Put a child beside the ice that lies on the rim of its parent, if there is sea near enough."""
        at, earth, body = child.place, self.p.earth, self.el.body
        reach = float(corner_reach(child.length[0], child.width[0]))
        lon, lat = move(float(at.lon[0]), float(at.lat[0]), *offset, 1.0, earth.latlon, earth.radius)
        farthest = FARTHEST * max(reach + float(corner_reach(body.length[e], body.width[e])), free.distance)
        if free.nearest(lon, lat, reach, lambda x, y: self._holds(child, x, y, e), farthest) is None:
            return False
        free.take(float(at.lon[0]), float(at.lat[0]), reach)
        return True

    def _put(self, child: Elements, e: int, offset: tuple[float, float]) -> None:
        """Put a child on the rim, or where the parent is if there is no sea of this process there (files, 2.6)."""
        earth, at = self.p.earth, child.place
        if offset == (0.0, 0.0):
            return
        lon, lat = float(at.lon[0]), float(at.lat[0])
        half = 0.5 * float(self.el.length[e]), 0.5 * float(self.el.width[e])
        # The place that was drawn, then the four corners of the parent, in the order of the reference.
        tried = [offset, *((sx * half[0], sy * half[1]) for sx, sy in ((-1, -1), (-1, 1), (1, 1), (1, -1)))]
        in_metres = self.p.footloose.unplaced_child_in_metres
        for k, (dx, dy) in enumerate(tried):
            if k > 0 and in_metres:
                x, y = lon + dx, lat + dy
            else:
                x, y = move(lon, lat, dx, dy, 1.0, earth.latlon, earth.radius)
            if self._holds(child, x, y, e):
                return
            # Without a grid there is no land to avoid; the first place has been taken already.
            if k == 0 and self.when.grid is None:
                return
        at.lon[0], at.lat[0] = lon, lat

    def _holds(self, child: Elements, x: float, y: float, e: int) -> bool:
        """Put a child at a point, with its cell, if that is sea that the process of the parent owns."""
        at, grid = child.place, self.when.grid
        if grid is None:
            at.lon[0], at.lat[0] = x, y
            return True
        g = grid.arrays
        i, j, xi, eta = np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1), np.zeros(1)
        locate_points(np.array([x]), np.array([y]), g, True, i, j, xi, eta)
        if i[0] < 0 or g.mask[j[0], i[0]] < 0.5:
            return False
        if self.when.rank(int(i[0]), int(j[0])) != self.when.rank(int(self.el.cell_i[e]), int(self.el.cell_j[e])):
            return False
        # On the branch of longitude of its cell: contact takes differences of positions as they stand.
        if g.period > 0.0:
            x = wrap_around(x, float(g.lon_centre[j[0], i[0]]), g.period)
        at.lon[0], at.lat[0], at.cell_i[0], at.cell_j[0], at.xi[0], at.eta[0] = x, y, i[0], j[0], xi[0], eta[0]
        return True

    def _add(self, child: Elements, parent: int) -> None:
        names, ids = self.when.names, None
        if names is not None:
            ids = np.array([names(int(self.el.cell_i[parent]), int(self.el.cell_j[parent]))], np.int64)
        number = int(self.el.body.berg[parent])
        for born in self.model.append(child, ids=ids).tolist():
            self.model.fragments.calved_from[born] = number
