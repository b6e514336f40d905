"""Footloose calving applied to the population: pieces leave the edges, become bits, and bits become bergs.

A berg of one element follows the rules of the reference. A berg of many elements, which the reference refuses, is cut at its
edges: the feet of all its elements count together, a piece takes from each element as much area as that has part in the
foot, and all of it goes to the bits or to the child. Source: files 2. Places on the rim come from one stream of random numbers
as in the reference, or from draws that depend on berg and step alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.compiled.kernels import kernel
from riftberg.constants import SECONDS_PER_DAY
from riftberg.engines.common.broad_phase import NEWBORN_CHILD, contact_cells, within_cells
from riftberg.engines.common.forces.sizes import interaction_radius
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.errors import RunError
from riftberg.life.melt import LifeValues, bit_shape
from riftberg.ocean.cells import locate_points
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.physics.calving import (
    ASPECT,
    foot_length,
    mean_weights,
    piece_width,
    pieces_ready,
    relaxed_modulus,
    rim_place,
    sides_without,
)
from riftberg.physics.floating import roll
from riftberg.physics.geometry import move, separation, wrap_around
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import ANY, find_pairs
from riftberg.state.population import find_rows, listed, numbered

_LARGEST: Final = 2.0**32 - 1.0


class FmsStream:
    """Random numbers of FMS: Mersenne twister with an array as seed; a draw is the next 32 bits over the largest (files, 0.5).

    Examples
    --------
    >>> round(FmsStream((0, 0, 1, 1, 1, 0, 0, 0)).next(), 6)
    0.121208

    """

    def __init__(self, seed: int | Sequence[int]) -> None:
        self._twister = np.random.RandomState(seed)

    def next(self) -> float:
        """Return the next draw, from 0 to 1, both included."""
        return int.from_bytes(self._twister.bytes(4), "little") / _LARGEST


class ReferenceDraws:
    """Draws as in the reference (quirk T10): a stream for each process, seeded by its rank and the date of its first step.

    ``date``: year, month, day, hour, minute and second of the first step.
    """

    def __init__(self, date: tuple[int, ...], one_draw: bool = False) -> None:
        self._date, self._one_draw = date, one_draw
        self._streams: dict[int, FmsStream] = {}
        self._first: dict[int, float] = {}

    def draw(self, rank: int, identifier: int, step: int) -> float:
        """Return the next number of the stream of a process; every stream loses one draw at its start (files, 2.2)."""
        if rank not in self._streams:
            self._streams[rank] = FmsStream((rank, rank, *self._date))
            self._first[rank] = self._streams[rank].next()
        return self._first[rank] if self._one_draw else self._streams[rank].next()


class OwnDraws:
    """Draws by seed, step and element, so that a run that is resumed goes on alike, and no berg changes another's."""

    def __init__(self, seed: int, one_draw: bool = False) -> None:
        self._seed, self._one_draw = seed, one_draw

    def draw(self, rank: int, identifier: int, step: int) -> float:
        """Return the number of a child of an element that is born in a long step."""
        key = (self._seed,) if self._one_draw else (self._seed, step, identifier)
        return float(np.random.default_rng(key).random())


CalvingDraws = ReferenceDraws | OwnDraws
"""Where random numbers from 0 to 1 come from."""

LARGEST_CUT: Final = 0.5
"""Part of its area that an element of a bonded berg loses to pieces in one step at most; the rest stays in its foot."""

CHILD: Final = NEWBORN_CHILD
"""Foot of a child of footloose calving that takes no part in contact yet."""

LET_GO: Final = -2.0
"""Foot of a child that has drifted off its parent and may collide."""


FARTHEST: Final = 3.0
"""How far from the rim of its parent a child is put at most, in distances at which both touch; else it waits."""


FOOT_GROWTH: Final = "foot_growth"
"""Name under which a restart keeps the mean rate (m s-1) at which feet grow, by identifier."""

MEMORY: Final = 30.0 * SECONDS_PER_DAY
"""Time (s) over which that mean is taken: feet grow in storms, and are months old when they break an edge."""


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
    growth: Floats | None = None  # `find_growth` the elements; None where edges do not relax
    # Gives the identifier of a child from the cell (column, row) of its parent; None where the population numbers them
    names: Callable[[int, int], int] | None = None


class _Calving:
    """One step of footloose calving on a model."""

    def __init__(self, model: Living, p: Parameters, values: LifeValues, when: Circumstances) -> None:
        self.model, self.p, self.values, self.when = model, p, values, when
        self.el = model.elements
        self.youngs = edge_moduli(self.el, p, when.growth)
        self.reference = p.footloose.footloose_sets_density
        self.born: list[tuple[Elements, int]] = []
        self.gained = 0.0
        beside = p.stepping.interactions and not p.quirks.births_at_centre
        self.free = FreePlaces(self.el, p) if beside else None

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
        for child, parent in self.born:
            self._add(child, parent)
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
        return np.array([self._rank(int(self.el.cell_i[e]), int(self.el.cell_j[e])) for e in rows], np.int64)

    def _rank(self, i: int, j: int) -> int:
        if self.when.grid is None or self.when.ranks == (1, 1):
            return 0
        g, (across, up) = self.when.grid.arrays, self.when.ranks
        return (j - g.halo) * up // g.nj * across + (i - g.halo) * across // g.ni

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
            offset, piece = self._rim(e, width, length), _piece(thickness, wide, density)
            if not self._bear(e, offset, piece, pieces * life.mass_scaling[e]):
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
        offset = self._rim(e, body.width[e], body.length[e])
        count = float(np.floor(bits_mass / least))
        shape = bit_shape(body.thickness[e], self.values)
        mass = shape[0] * shape[2] * shape[1] * self.values.rho_ice
        scaling = count * least / mass
        # Bergy bits go with the bits of which they came, in proportion.
        share = mass * scaling / bits_mass
        bergy = share * life.mass_of_fl_bergy_bits[e] * life.mass_scaling[e] / scaling
        if not self._bear(e, offset, (mass, *shape, bergy), scaling):
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
            offset = self._rim(e, body.width[e], body.length[e])
            if not self._bear(e, offset, shape, total / shape[0], self._heat(rows, mass)):
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
        offset = self._rim(e, body.width[e], body.length[e])
        heat = self._heat(rows, life.mass_of_fl_bits[rows] + life.mass_of_fl_bergy_bits[rows])
        if not self._bear(e, offset, (mass, *shape, bergy / scaling), scaling, heat):
            return
        for bits in (life.mass_of_fl_bits, life.mass_of_fl_bergy_bits):
            bits[rows] *= 1.0 - share

    def _heat(self, rows: Ints, mass: Floats) -> float:
        """Heat (J kg-1) of ice (kg of one berg) that several elements give."""
        life = self.el.life
        return float(np.average(life.heat_density[rows], weights=mass * life.mass_scaling[rows]))

    # ------------------------------------------------------------------------------------------------------ births

    def _rim(self, e: int, width: float, length: float) -> tuple[float, float]:
        """Draw a place on the rim, m east and north of the parent; none without displacement."""
        if not self.p.footloose.displace:
            return 0.0, 0.0
        rank = self._rank(int(self.el.cell_i[e]), int(self.el.cell_j[e]))
        draw = self.when.draws.draw(rank, int(self.el.body.id[e]), self.when.step)
        x, y = rim_place(draw, float(width), float(length), self.p.footloose.half_west_rim)
        return (x, y) if self.reference else self._turn_offset(e, x, y)

    def _turn_offset(self, e: int, x: float, y: float) -> tuple[float, float]:
        """Metres east and north of metres along the length and the width of an element that has turned."""
        angle = float(self.el.motion.rotation[e])
        cosine, sine = math.cos(angle), math.sin(angle)
        return x * cosine - y * sine, x * sine + y * cosine

    def _bear(
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
        if self._rank(int(i[0]), int(j[0])) != self._rank(int(self.el.cell_i[e]), int(self.el.cell_j[e])):
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
    return _Calving(model, p, values, when).run()


def edge_lengths(el: Elements) -> Floats:
    """Length (m) of the edge along which the foot of each element grows."""
    return np.where(el.life.front >= 0.0, el.life.front, 2.0 * (el.length + el.width))


def edge_moduli(el: Elements, p: Parameters, growth: Floats | None) -> Floats:
    """Young's modulus (Pa) by which the edge of each element breaks; ``growth`` of its foot, m s-1, where edges relax."""
    footloose = p.footloose
    if footloose.modulus == "constant" or growth is None:
        return np.full(el.size, footloose.youngs)
    edge = edge_lengths(el)
    _, berg = numbered(np.where(el.berg == 0, -1 - np.arange(el.size), el.berg))  # without a number each is alone
    of_berg = np.bincount(berg, growth * edge) / np.maximum(np.bincount(berg, edge), 1.0)
    return np.array([
        relaxed_modulus(thickness, rate, footloose.strength, p.ice.density, footloose.viscosity)
        for thickness, rate in zip(el.thickness.tolist(), of_berg[berg].tolist(), strict=True)
    ])  # fmt: skip


def follow_growth(el: Elements, grown: Floats, dt: float, remembered: MutableMapping[str, Floats]) -> None:
    """Take the growth of the feet (m2) in a step (s) into the mean rate that is remembered."""
    edge = edge_lengths(el)
    rate = np.divide(grown, edge * dt, out=np.zeros(el.size), where=edge > 0.0)
    mean, has_mean = find_growth(el, remembered)
    new, old = mean_weights(MEMORY, dt)
    remembered[FOOT_GROWTH] = np.column_stack([el.body.id, np.where(has_mean, new * rate + old * mean, rate)])


def find_growth(el: Elements, remembered: Mapping[str, Floats]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the mean rate (m s-1) at which the feet of the elements grow, 0 where it is not known, and where it is."""
    ids, means = np.asarray(remembered.get(FOOT_GROWTH, np.zeros((0, 2)))).T
    row, has_mean = find_rows(ids.astype(np.int64), el.body.id)
    mean = np.zeros(el.size)
    mean[has_mean] = means[row[has_mean]]
    return mean, has_mean


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


# Places for the newly born: beside the ice that is there. One that is born on another berg would be thrown by contact. Where no
# place is free it waits: ice of a flux in its store, a footloose piece among the bits of its parent.

DIRECTIONS: Final = 16
"""Directions in which a free place is looked for."""

SLACK: Final = 1.001
"""Factor on the distance of two that do not touch: a newborn must not touch by round-off."""


def corner_reach(length: Floats | float, width: Floats | float) -> Floats:
    """Distance of the corners of an element from its centre, m: a square of its area; hexagons and discs reach less far."""
    return np.asarray(np.sqrt(0.5 * np.asarray(length) * np.asarray(width)))


class FreePlaces:
    """Where ice lies, so that newborn elements find room beside it."""

    def __init__(self, elements: Elements, p: Parameters) -> None:
        self._earth = p.earth
        self.distance = p.contact_distance
        self._lon, self._lat = elements.lon.copy(), elements.lat.copy()
        self._reach = corner_reach(elements.length, elements.width)

    def take(self, lon: float, lat: float, reach: float) -> None:
        """Count a newborn element at (lon, lat) from now on."""
        self._lon, self._lat = np.append(self._lon, lon), np.append(self._lat, lat)
        self._reach = np.append(self._reach, reach)

    def nearest(
        self, lon: float, lat: float, reach: float, allowed: Callable[[float, float], bool], farthest: float
    ) -> tuple[float, float] | None:
        """Return the free place nearest to (lon, lat) for an element whose corners are ``reach`` m away; None without any.

        Looked for along `DIRECTIONS` up to ``farthest`` m away; ``allowed(lon, lat)`` says where there is sea.
        """
        earth, candidates = self._earth, []
        metric = Metric(earth.latlon, earth.radius, earth.period)
        x, y = separations(metric, self._lon, self._lat, np.array([lon]), np.array([lat]))
        clearance = SLACK * np.maximum(self._reach + reach, self.distance)
        in_reach = np.hypot(x, y) < clearance + farthest
        x, y, clearance = x[in_reach], y[in_reach], clearance[in_reach]
        for k in range(DIRECTIONS):
            angle = 2.0 * np.pi * k / DIRECTIONS
            distance = _exit_distance(x, y, clearance, float(np.cos(angle)), float(np.sin(angle)), farthest)
            if distance <= farthest:
                candidates.append((distance, k, float(distance * np.cos(angle)), float(distance * np.sin(angle))))
        for _, _, dx, dy in sorted(candidates):
            position = move(lon, lat, dx, dy, 1.0, earth.latlon, earth.radius)
            if allowed(*position):
                return position
        return None


def _exit_distance(x: Floats, y: Floats, clearance: Floats, c: float, s: float, farthest: float) -> float:
    """Distance (m) along (c, s) at which all points (x, y) are farther than ``clearance``."""
    distance = 0.0
    along, across = c * x + s * y, c * y - s * x
    half_chord = np.sqrt(np.maximum(clearance * clearance - across * across, 0.0))
    enter, leave = along - half_chord, along + half_chord
    while distance <= farthest:
        inside = (half_chord > 0.0) & (enter < distance) & (distance < leave)
        if not inside.any():
            return distance
        distance = float(leave[inside].max())
    return np.inf
