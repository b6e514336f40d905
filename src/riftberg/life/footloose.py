"""Footloose calving applied to the population: pieces leave the edges, become bits, and bits become bergs.

A berg of one element follows the rules of the reference. A berg of many elements, which the reference refuses, is cut at its
edges: the feet of all its elements count together, a piece takes from each element as much area as that has part in the
foot, and all of it goes to the bits or to the child. Source: files 2. Places on the rim come from one stream of random numbers
as in the reference, or from draws that depend on berg and step alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.broad_phase import contact_cells, within_cells
from riftberg.engines.common.forces.sizes import interaction_radius
from riftberg.errors import RunError
from riftberg.life.births import CHILD, Births, Circumstances, Living
from riftberg.life.feet import edge_moduli
from riftberg.life.melt import LifeValues, bit_shape
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.physics.calving import (
    ASPECT,
    foot_length,
    piece_width,
    pieces_ready,
    sides_without,
)
from riftberg.physics.floating import roll
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import ANY, find_pairs
from riftberg.state.population import listed

LARGEST_CUT: Final = 0.5
"""Part of its area that an element of a bonded berg loses to pieces in one step at most; the rest stays in its foot."""

LET_GO: Final = -2.0
"""Foot of a child that has drifted off its parent and may collide."""


class FootlooseCalving:
    """One step of footloose calving on a model."""

    def __init__(self, model: Living, p: Parameters, values: LifeValues, when: Circumstances) -> None:
        self.model, self.p, self.values, self.when = model, p, values, when
        self.el = model.elements
        self.youngs = edge_moduli(self.el, p, when.growth)
        self.reference = p.footloose.footloose_sets_density
        self.births = Births(model, p, when)
        self.gained = 0.0

    def run(self) -> float:
        """Let all bergs calve in turn, and add their children; returns as `calve_footloose`."""
        alone = self._alone()
        body, foot = self.el.body, self.el.life.fl_k
        able = alone & self._eligible() & (foot > 0.0)
        # All pieces of a step are counted before the first breaks: what one berg loses cannot set another free.
        ready = _ready(foot, able, body.thickness, body.width, body.length, self.youngs, self.values)
        for e in self._order(np.flatnonzero(alone & ((ready > 0.0) | self._may_spawn()))):
            if ready[e] > 0.0:
                self._calve_one(int(e), float(ready[e]))
            self._spawn(int(e))
        if not self.reference:
            for rows in self._bonded_bergs(alone):
                self._calve_bonded(rows)
        # Only now: elements that are added in between would shift the rows that the loops go by.
        self.births.add()
        return self.gained

    # ------------------------------------------------------------------------------------------------- who calves

    def _alone(self) -> NDArray[np.bool_]:
        """Elements that are a berg by themselves; in the reference no other may calve."""
        count = self.el.body.bond_count
        if self.reference:
            wrong = (count > 0) & self._eligible()
            if wrong.any():
                e = int(np.argmax(wrong))
                raise RunError(
                    f"footloose calving of element {int(self.el.body.id[e])}, which has {int(count[e])} bonds: the "
                    "reference stops there too; switch footloose off, or run it with Riftberg's own numerics"
                )
            return np.ones(self.el.size, bool)
        # Number 0 is that of elements that no berg has taken in; each of them is a berg by itself.
        members = np.bincount(self.el.body.berg)[self.el.body.berg] if self.el.size else count
        return np.asarray((members == 1) | (self.el.body.berg == 0))

    def _eligible(self) -> NDArray[np.bool_]:
        return np.asarray((self.el.body.static < 0.5) & (self.el.life.fl_k >= 0.0))

    def _may_spawn(self) -> NDArray[np.bool_]:
        life = self.el.life
        # One event may add bits to those that are there, so that is looked at again berg by berg.
        return np.asarray(life.mass_of_fl_bits * life.mass_scaling > self.p.footloose.berg_mass)

    def _bonded_bergs(self, alone: NDArray[np.bool_]) -> Iterator[Ints]:
        """Rows of the elements of each berg of several, berg by berg."""
        many = np.flatnonzero(~alone)
        berg = self.el.body.berg[many]
        for number in np.unique(berg):
            yield many[berg == number]

    def _order(self, rows: Ints) -> Ints:
        """Put elements in the order in which the reference visits them, process by process (files, 0.3)."""
        visit_order = np.empty(self.el.size, np.int64)
        visit_order[listed(self.el)] = np.arange(self.el.size)
        return rows[np.lexsort((visit_order[rows], self._find_ranks(rows)))]

    def _find_ranks(self, rows: Ints) -> Ints:
        """Process of the reference that owns the cells of elements."""
        return np.array([self.when.rank(int(self.el.cell_i[e]), int(self.el.cell_j[e])) for e in rows], np.int64)

    # ---------------------------------------------------------------------------------------- bergs of one element

    def _calve_one(self, e: int, pieces: float) -> None:
        """Take pieces from a berg of one element (files, 2.3)."""
        body, life, v = self.el.body, self.el.life, self.values
        thickness, width, length = body.thickness[e], body.width[e], body.length[e]
        youngs = float(self.youngs[e])
        wide = piece_width(thickness, youngs)
        life.fl_k[e] -= pieces * (foot_length(thickness, youngs, v.strength, v.rho_ice) * (ASPECT * wide))
        # The foot of the pieces goes before the sides are cut: their width follows from the thickness alone.
        narrow, short = sides_without(pieces, thickness, width, length, youngs)
        if narrow <= 0.0 or short <= 0.0:
            raise RunError(f"footloose calving leaves nothing of element {int(body.id[e])}")
        area = length * width - short * narrow
        # Bergs that were made with another density keep it; the reference gives them that of the parameters (quirk
        # T45).
        density = v.rho_ice if self.reference else body.mass[e] / (thickness * width * length)
        if self.p.footloose.style == "bits":
            life.mass_of_fl_bits[e] += density * thickness * area
        else:
            offset, piece = self.births.draw_rim(e, width, length), _piece(thickness, wide, density)
            if not self.births.bear(e, offset, piece, pieces * life.mass_scaling[e]):
                life.mass_of_fl_bits[e] += density * thickness * area
        old_mass, lost = body.mass[e], density * thickness * area
        # A berg that has lost pieces is narrower, and may roll over at once.
        if v.rolls:
            thickness, narrow, short = roll(thickness, narrow, short, v.rolling_scheme, v.tip, v.rho_ice, v.rolls_on)
        body.thickness[e], body.width[e], body.length[e] = thickness, narrow, short
        body.mass[e] = short * narrow * thickness * density if self.reference else old_mass - lost
        self.gained += (body.mass[e] + lost - old_mass) * life.mass_scaling[e]

    def _spawn(self, e: int) -> None:
        """Make a berg of the footloose bits of an element where there are enough (files, 2.3, 2.6)."""
        life, least = self.el.life, self.p.footloose.berg_mass
        bits_mass = life.mass_of_fl_bits[e] * life.mass_scaling[e]
        if bits_mass <= least:
            return
        body = self.el.body
        offset = self.births.draw_rim(e, body.width[e], body.length[e])
        count = float(np.floor(bits_mass / least))
        shape = bit_shape(body.thickness[e], self.values)
        mass = shape[0] * shape[2] * shape[1] * self.values.rho_ice
        scaling = count * least / mass
        # Bergy bits go with the bits of which they came, in proportion.
        share = mass * scaling / bits_mass
        bergy = share * life.mass_of_fl_bergy_bits[e] * life.mass_scaling[e] / scaling
        if not self.births.bear(e, offset, (mass, *shape, bergy), scaling):
            return
        life.mass_of_fl_bergy_bits[e] *= 1.0 - share
        life.mass_of_fl_bits[e] -= count * least / life.mass_scaling[e]

    # ------------------------------------------------------------------------------------- bergs of many elements

    def _calve_bonded(self, rows: Ints) -> None:
        """Take pieces from the edges of a berg of many elements, and make a berg of the bits where there are enough."""
        body, life, v = self.el.body, self.el.life, self.values
        feet = np.where(self._eligible()[rows], life.fl_k[rows], 0.0)
        area = body.length[rows] * body.width[rows]
        if feet.sum() > 0.0:
            # Pieces break where the feet are, so their thickness is weighted by these and not by area.
            thickness, youngs = (float(feet @ values[rows] / feet.sum()) for values in (body.thickness, self.youngs))
            wide = piece_width(thickness, youngs)
            each = foot_length(thickness, youngs, v.strength, v.rho_ice) * (ASPECT * wide)
            pieces = float(np.floor(feet.sum() / each))
            # A berg no longer than a piece is itself one, as in `pieces_ready`.
            if pieces > 0.0 and np.sqrt(area.sum()) > ASPECT * wide:
                self._cut_edges(rows, feet / feet.sum(), pieces, (wide, each), area)
        self._spawn_together(rows)

    def _cut_edges(self, rows: Ints, share: Floats, pieces: float, piece: tuple[float, float], area: Floats) -> None:
        """Take the area of pieces from edge elements by their share in the foot; the ice goes to bits or to a child."""
        body, life = self.el.body, self.el.life
        wide, each = piece
        demand = share * pieces * ASPECT * wide * wide
        cut = np.minimum(demand, LARGEST_CUT * area)
        # An element that could not give all keeps that part of its foot for the next step.
        got = np.divide(cut, demand, out=np.zeros_like(cut), where=demand > 0.0)
        life.fl_k[rows] -= share * pieces * each * got
        front = np.maximum(life.front[rows], 0.0)
        if front.sum() > 0.0:  # the outline retreats by what breaks off it
            life.retreat[rows] += cut.sum() / front.sum()
        fraction = cut / area
        mass = body.mass[rows] * fraction
        body.mass[rows] -= mass
        # Alike in both directions: the lattice does not know which side of an element lies at the edge.
        for side in (body.width, body.length):
            side[rows] *= np.sqrt(1.0 - fraction)
        total = float((mass * life.mass_scaling[rows]).sum())
        if self.p.footloose.style == "bits":
            life.mass_of_fl_bits[rows] += mass
        elif total > 0.0:  # a child of the ice of pieces, as many of them as that mass gives
            e = int(rows[np.argmax(share)])
            density = body.mass[e] / (body.thickness[e] * body.width[e] * body.length[e])
            shape = _piece(float(body.thickness[e]), wide, density)
            offset = self.births.draw_rim(e, body.width[e], body.length[e])
            if not self.births.bear(e, offset, shape, total / shape[0], self._heat(rows, mass)):
                life.mass_of_fl_bits[rows] += mass

    def _spawn_together(self, rows: Ints) -> None:
        """Make a berg of the footloose bits that all elements of a berg hold, at the one that holds most."""
        life, least = self.el.life, self.p.footloose.berg_mass
        bits_mass = life.mass_of_fl_bits[rows] * life.mass_scaling[rows]
        if bits_mass.sum() <= least:
            return
        e, body = int(rows[np.argmax(bits_mass)]), self.el.body
        count = float(np.floor(bits_mass.sum() / least))
        shape = bit_shape(body.thickness[e], self.values)
        mass = shape[0] * shape[2] * shape[1] * self.values.rho_ice
        scaling, share = count * least / mass, count * least / bits_mass.sum()
        bergy = share * float((life.mass_of_fl_bergy_bits[rows] * life.mass_scaling[rows]).sum())
        offset = self.births.draw_rim(e, body.width[e], body.length[e])
        heat = self._heat(rows, life.mass_of_fl_bits[rows] + life.mass_of_fl_bergy_bits[rows])
        if not self.births.bear(e, offset, (mass, *shape, bergy / scaling), scaling, heat):
            return
        for bits in (life.mass_of_fl_bits, life.mass_of_fl_bergy_bits):
            bits[rows] *= 1.0 - share

    def _heat(self, rows: Ints, mass: Floats) -> float:
        """Heat (J kg-1) of ice (kg of one berg) that several elements give."""
        life = self.el.life
        return float(np.average(life.heat_density[rows], weights=mass * life.mass_scaling[rows]))


@kernel
def _ready(
    foot: Floats,
    able: NDArray[np.bool_],
    thickness: Floats,
    width: Floats,
    length: Floats,
    youngs: Floats,
    v: LifeValues,
) -> Floats:
    """Pieces that are ready to break from each of the elements that are able to calve by themselves."""
    ready = np.zeros(foot.size)
    for e in range(foot.size):
        if able[e]:
            ready[e] = pieces_ready(foot[e], thickness[e], width[e], length[e], youngs[e], v.strength, v.rho_ice)
    return ready


def _piece(thickness: float, wide: float, density: float) -> tuple[float, float, float, float, float]:
    """Mass (kg), thickness, width, length (m) and bits (kg) of one piece that has just broken off."""
    return wide * (ASPECT * wide) * thickness * density, thickness, wide, ASPECT * wide, 0.0


def calve_footloose(model: Living, p: Parameters, values: LifeValues, when: Circumstances) -> float:
    """Let all bergs of a model calve by the footloose mechanism, and make bergs of bits.

    Returns the mass (kg) that parents gained by being given the density of the parameters (quirk T45); 0 in own runs.
    """
    return FootlooseCalving(model, p, values, when).run()


def let_children_go(elements: Elements, p: Parameters, grid: Grid | None) -> None:
    """Let children collide from now on that no other element is near enough to touch (files, 2.7)."""
    foot = elements.life.fl_k
    if not p.stepping.interactions or not (foot == CHILD).any():
        return
    body, positions, earth = elements.body, elements.place, p.earth
    hexagonal, bonded = p.bonds.packing == "hexagonal", p.bonds.law != "none"
    radius = np.array([interaction_radius(area, hexagonal, bonded) for area in (body.length * body.width).tolist()])
    reach = max(2.0 * float(radius.max()), p.contact_distance)
    neighbours = find_pairs(
        positions.lon, positions.lat, body.berg, reach, ANY, earth.latlon, earth.radius, earth.period
    )
    cells = contact_cells(p, grid)
    if cells is not None:
        neighbours = within_cells(neighbours, elements, cells)
        if cells.columns > 1 or cells.rows > 1:
            radius[:] = 0.0  # then the reference asks for the distance alone
    for e in np.flatnonzero(foot == CHILD):
        others = neighbours.partner[neighbours.start[e] : neighbours.start[e + 1]]
        if not any(_touch(elements, int(e), int(k), radius, p) for k in others):
            foot[e] = LET_GO


def _touch(elements: Elements, first: int, second: int, radius: Floats, p: Parameters) -> bool:
    positions, earth = elements.place, p.earth
    x, y = separation(
        positions.lon[first],
        positions.lat[first],
        positions.lon[second],
        positions.lat[second],
        earth.latlon,
        earth.radius,
        earth.period,
    )
    return bool(np.hypot(x, y) < max(radius[first] + radius[second], p.contact_distance))
