"""Cracks as lines with tips that have a place and a direction of their own.

A lattice whose most critical bond breaks, and then the next one, cracks along its rows, whatever the stress. So a crack is a
line here. A tip turns normal to the larger principal stress of the ice ahead of it, and the first unbroken bond that its ray
crosses breaks: the line cuts every bond that it crosses and leaves none behind. A bond that fails away from all tips starts a
crack of its own, with two tips in opposite directions. A tip ends where its ray leaves the ice or meets another crack.

The first advance of a rift whose stress intensity is known goes normal to the largest hoop stress instead: a rift is given, so it
may stand at any angle to the tension.

A tip keeps its place beside the ends of the bond that it crossed last, so it moves with its piece.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple, TypeVar, cast

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.crack_tips import NO_TIPS, RUN_OUT, UNTOLD, CrackTips
from riftberg.engines.quasi_static.fracture.stress_intensity import TipRing, ring_intensities, tip_ring
from riftberg.engines.quasi_static.lattice.dense import multiply
from riftberg.parameters import KernelParameters
from riftberg.physics.crack_tip import hoop_intensity
from riftberg.physics.elementary import atan2, cos, sin
from riftberg.plane import ConformalPlane
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows

if TYPE_CHECKING:  # the lattice loads scipy.spatial, half a second that runs by explicit schemes do not wait for
    from riftberg.engines.quasi_static.lattice.cell_stiffness import CellStiffness

REACH = 2.5
"""A bond that fails within this distance of a tip (in distances of elements) is the tip's: it goes on, and no crack starts."""

AHEAD = 1.5
"""Radius (in distances of elements) within which the ice ahead of a tip decides on its direction: 0.75 to 2 give the same
direction within 3 degrees."""

LONGEST_STEP = 3.0
"""Way (in distances of elements) within which the ray of a tip must cross a bond; else the tip has run out of the ice."""

LEAST_FILLED = 0.98
"""Part of the disc around a tip that must be ice for it to turn. With less the outline is nearer than three elements: the ice
between bends like a hinge, its mean stress says nothing of the way, and the crack crosses it straight on."""

BEYOND = 1e-3
"""Part of the distance of elements by which a tip stands beyond the bond that it has crossed."""

LEAST_CRACK = 3.0
"""Length of a crack (in distances of elements) from which its stress intensity is known; shorter ones grow by strength."""

LARGEST_RING, RELIABLE_RING, SMALLEST_RING = 4.0, 2.4, 1.2
"""Outer radius (in distances of elements) of the ring over which stress intensity is integrated: where there is room, the least
for a value to be told, and the least for a crack to go on by it. The smallest let a running crack reach the outline."""

SHARE_OF_LENGTH, SHARE_AHEAD, SHARE_BEHIND = 0.55, 0.6, 0.85
"""What a ring takes of the length of the crack, and of the way to the outline or another crack ahead of its tip and behind it."""

FLANK = 0.75
"""Distance (in distances of elements) from the line of a crack within which triangles are freed by it, not by others."""


def find_rift_tips(el: Elements, bonds: Bonds, p: KernelParameters) -> CrackTips:
    """Return the tips of the rifts that are there from the start, at both ends of each line of crossed bonds.

    A tip at the outline finds no ice ahead of it and ends with the first bond that fails near it. A line of one crossing has
    no direction, and no tips.
    """
    tips = []
    for number in np.unique(bonds.crack[bonds.crack > 0]):
        rows = np.flatnonzero(bonds.crack == number)
        rows = rows[np.argsort(bonds.crack_order[rows])]
        if rows.size < 2:
            continue
        first, second, fraction = bonds.first[rows], bonds.second[rows], bonds.crack_part[rows]
        # On a plane about the first crossing; a rift is short beside the Earth.
        plane = ConformalPlane(float(el.lon[first[0]]), float(el.lat[first[0]]), p.earth_radius, p.latlon)
        a, b = (np.column_stack(plane.forward(el.lon[e], el.lat[e])) for e in (first, second))
        crossings = a + fraction[:, None] * (b - a)
        length = float(np.hypot(*np.diff(crossings, axis=0).T).sum())
        for end, neighbour, order in ((0, 1, -1), (-1, -2, rows.size)):
            direction = (crossings[end] - crossings[neighbour]) / np.hypot(*(crossings[end] - crossings[neighbour]))
            along = b[end] - a[end]
            spacing = float(np.hypot(*along))
            axes = np.array([along, [-along[1], along[0]]]) / spacing
            position = multiply(axes, crossings[end] + BEYOND * spacing * direction - a[end])
            beside = [el.body.id[first[end]], el.body.id[second[end]]]
            tips.append((beside, position, multiply(axes, direction), number, order, length, (0.0, 0.0, UNTOLD)))
    if not tips:
        return NO_TIPS
    return CrackTips._make([
        np.array(values, old.dtype) for old, values in zip(NO_TIPS, zip(*tips, strict=True), strict=True)
    ])  # fmt: skip


T = TypeVar("T")


class Tip(NamedTuple):
    """A tip in the frame of its fragment."""

    row: int  # Among all tips
    body: int
    place: Floats  # m
    direction: Floats
    spacing: float  # Distance of the elements beside it, m


class TipIntensity(NamedTuple):
    """Stress intensity at a tip, Pa m^(1/2)."""

    tip: Tip
    ring: TipRing
    opening: float  # K_I
    shearing: float  # K_II
    kink: float  # Angle at which the crack goes on, to the left, rad
    hoop: float  # Of the largest hoop stress there, which the toughness is compared with


NO_INTENSITIES: Mapping[int, TipIntensity] = {}


class Crossing(NamedTuple):
    """Where the way of a crack crosses a bond."""

    bond: int  # Row of the state
    fraction: float  # Of the way from its first end to its second
    tip: Tip  # With its new direction, before it steps


class CrackPaths:
    """Where the tips of a fragmented lattice stand, and where they go next.

    ``last``: a number of a crack above which new ones are numbered.
    """

    def __init__(
        self, tips: CrackTips, bonds: Bonds, ids: Ints, body: Ints, xy: Floats, cells: CellStiffness, last: int = 0,
    ) -> None:  # fmt: skip
        self.tips, self._bonds, self._ids, self._body, self._xy, self._cells = tips, bonds, ids, body, xy, cells
        self._last = last

    def _find_once(self, name: str, find: Callable[[], T]) -> T:
        """Return what is found at the tips where they are, once for as long as no bond breaks, though the ice melts."""
        at_tips, place = self._cells.at_tips, self.tips.place
        if name not in at_tips or at_tips[name][0] is not place:  # a tip that moves makes new arrays
            at_tips[name] = place, find()
        return cast(T, at_tips[name][1])

    def standing(self) -> list[Tip]:
        """Return the tips in the frames of their fragments, without those whose elements have parted or melted away."""
        return self._find_once("tips", self._find_standing)

    def _find_standing(self) -> list[Tip]:
        rows, is_present = find_rows(self._ids, self.tips.beside.ravel())
        a, b = rows.reshape(-1, 2).T
        here = is_present.reshape(-1, 2).all(axis=1)
        tips = []
        for n in np.flatnonzero(here):
            i, j = a[n], b[n]
            if self._body[i] != self._body[j]:
                continue
            along = self._xy[j] - self._xy[i]
            spacing = float(np.hypot(*along))
            axes = np.array([along, [-along[1], along[0]]]) / spacing
            position = self._xy[i] + multiply(axes.T, self.tips.place[n])
            direction = multiply(axes.T, self.tips.direction[n])
            tips.append(Tip(int(n), int(self._body[i]), position, direction, spacing))
        return tips

    def intensities(self, displacement: Floats, load: Floats) -> dict[int, TipIntensity]:
        """Stress intensity at the standing tips, by their rows; tips without a ring are left out.

        ``displacement``: of all nodes (m, m, rad); ``load``: of the elements, balanced (N, N, N m).
        """
        intensities = {}
        for tip, ring in self._rings():
            if isinstance(ring, TipRing):
                opening, shearing = ring_intensities(ring.weights, self._cells.volume, displacement, load)
                intensities[tip.row] = TipIntensity(tip, ring, opening, shearing, *hoop_intensity(opening, shearing))
        return intensities

    def bonds_beside_tips(self) -> Ints:
        """Rows of the intact bonds beside the tips with a ring, sorted."""
        rings = (ring for _, ring in self._rings() if isinstance(ring, TipRing))
        return self._find_once("beside", lambda: np.unique(np.concatenate([ring.beside for ring in rings])))

    def _rings(self) -> list[tuple[Tip, TipRing | float]]:
        """Return the standing tips with their rings."""
        return self._find_once("rings", lambda: [(tip, self._ring(tip)) for tip in self.standing()])

    def _ring(self, tip: Tip) -> TipRing | float:
        """Ring around the end of a crack; ``UNTOLD`` where there is no room for one, ``RUN_OUT`` where the crack has ended."""
        bond, fraction = self._crossed(tip, int(self.tips.crack[tip.row]))
        if bond < 0:
            return RUN_OUT
        # The crack ends somewhere between the last bond that it has crossed and the next one.
        i, j, spacing = self._bonds.first[bond], self._bonds.second[bond], tip.spacing
        end = 0.5 * (tip.place + self._xy[i] + fraction * (self._xy[j] - self._xy[i]))
        length = float(np.hypot(*(self._line(tip)[-1] - end))) + 0.5 * spacing
        if length < LEAST_CRACK * spacing:
            return UNTOLD
        ice = self._cells.triangles_near(tip.body, end, (LARGEST_RING / SHARE_AHEAD + 1.0) * spacing)
        axes = np.array([tip.direction, [-tip.direction[1], tip.direction[0]]])
        middle, vertex = multiply(ice.vertex.mean(axis=1) - end, axes.T), multiply(ice.vertex - end, axes.T)
        # No triangle of the ring but those along the crack itself may have a free edge.
        of_others = ~ice.whole & ((middle[:, 0] > FLANK * spacing) | (abs(middle[:, 1]) > FLANK * spacing))
        free = np.concatenate([middle[of_others], vertex[ice.node >= len(self._xy)]])
        distance = np.hypot(*free.T)
        if distance.min(initial=np.inf) <= SMALLEST_RING * spacing:
            return UNTOLD
        room = np.where(free[:, 0] > 0.0, SHARE_AHEAD, SHARE_BEHIND) * distance
        radius = max(SMALLEST_RING * spacing, min(LARGEST_RING * spacing, float(room.min(initial=np.inf))))
        radius = min(radius, max(SHARE_OF_LENGTH * length, RELIABLE_RING * spacing))
        element = np.flatnonzero((self._body == tip.body) & (np.hypot(*(self._xy - end).T) < radius))
        # Beside a tip stress is a matter of the size of the elements.
        first, second = self._bonds.first, self._bonds.second
        offset = 0.5 * (self._xy[first] + self._xy[second]) - tip.place
        beside = (self._body[first] == tip.body) & (np.hypot(*offset.T) <= REACH * spacing) & (self._bonds.status == 0)
        return tip_ring(
            ice, element, self._xy[element], end, tip.direction, radius, self._cells.elastic,
            reliable=radius >= RELIABLE_RING * spacing, beside=np.flatnonzero(beside),
        )  # fmt: skip

    def _line(self, tip: Tip) -> Floats:
        """Where the crack of a tip has crossed bonds of its fragment (m), from the tip backwards."""
        bonds = self._bonds
        rows = np.flatnonzero((bonds.crack == self.tips.crack[tip.row]) & (bonds.status != 0))
        rows = rows[(self._body[bonds.first[rows]] == tip.body) & (self._body[bonds.second[rows]] == tip.body)]
        order = bonds.crack_order[rows]
        rows = rows[np.argsort(order if self.tips.order[tip.row] < 0 else -order)]
        a, b = self._xy[bonds.first[rows]], self._xy[bonds.second[rows]]
        return np.asarray(a + bonds.crack_part[rows, None] * (b - a))

    def with_intensities(self, intensities: Mapping[int, TipIntensity]) -> CrackTips:
        """Return the tips with the intensities of those that stand here, as far as these can be told."""
        values = self.tips.intensity.copy()
        for tip, ring in self._rings():
            k = intensities.get(tip.row)
            if k is not None and k.ring.reliable:
                values[tip.row] = k.opening, k.shearing, max(k.hoop, values[tip.row, 2])
            else:
                values[tip.row] = 0.0, 0.0, RUN_OUT if ring == RUN_OUT else UNTOLD
        return self.tips._replace(intensity=values)

    def next_bond(
        self, failing: int, last: bool, tensor: Floats, stress: Floats, ratio: Floats, strength: Floats,
        intensities: Mapping[int, TipIntensity] = NO_INTENSITIES,
    ) -> int:  # fmt: skip
        """Return the bond (row of the state) that breaks next where ``failing`` is overloaded; the tips have moved then.

        ``last``: it is the last one between two parts, which any crack beside it must cross;
        ``tensor``: stress (Pa; xx, yy, xy) at that bond; ``stress``: of the triangles; ``ratio``, ``strength``: stress over
        strength and strength (Pa) of all bonds of the state, broken ones too; ``intensities``: at the tips.
        """
        i, j = self._bonds.first[failing], self._bonds.second[failing]
        middle, spacing = 0.5 * (self._xy[i] + self._xy[j]), float(np.hypot(*(self._xy[j] - self._xy[i])))
        nearby = [(float(np.hypot(*(tip.place - middle))), tip) for tip in self.standing() if tip.body == self._body[i]]
        ended = []
        for distance, tip in sorted(nearby, key=lambda pair: pair[0]):
            if distance > REACH * spacing:
                break
            crossing = (
                Crossing(failing, 0.5, tip) if last else self.find_crossing(tip, stress, intensities.get(tip.row))
            )
            if crossing is None:
                ended.append(tip.row)
                continue
            bond, fraction = crossing.bond, crossing.fraction
            if ratio[bond] <= 1.0 and strength[failing] < strength[bond] * (1.0 - 1e-9):
                # Ice of uneven strength: the crack goes to the weaker bond beside its way.
                bond, fraction = failing, 0.5
            self._step(crossing.tip, bond, fraction)
            self._drop(ended)
            return bond
        self._drop(ended)
        self._start(failing, middle, spacing, tensor)
        return failing

    def find_crossing(self, tip: Tip, stress: Floats, intensity: TipIntensity | None = None) -> Crossing | None:
        """Return the unbroken bond that a tip crosses next; None where it ends.

        A rift turns by its stress intensity, all else normal to the larger principal stress ahead.
        """
        if intensity is not None and intensity.ring.reliable and self._is_given(tip):
            c, s = cos(intensity.kink), sin(intensity.kink)
            direction = multiply(np.array([[c, -s], [s, c]]), tip.direction)
        else:
            direction = self._across_tension(tip, stress)
        bond, fraction = self._crossed(tip._replace(direction=direction), int(self.tips.crack[tip.row]))
        return None if bond < 0 else Crossing(bond, fraction, tip._replace(direction=direction))

    def _is_given(self, tip: Tip) -> bool:
        """Whether a tip stands where a rift ended at the start: the bond that it crossed last never broke in the run."""
        bonds, order = self._bonds, int(self.tips.order[tip.row])
        last = (bonds.crack == self.tips.crack[tip.row]) & (bonds.crack_order == order - (1 if order > 0 else -1))
        return bool(last.any() and np.isnan(bonds.break_time[last]).all())

    def _across_tension(self, tip: Tip, stress: Floats) -> Floats:
        """Direction normal to the larger principal stress ahead of a tip; straight on near the outline."""
        (xx, yy, xy), filled = self._cells.mean_ahead(stress, tip.body, tip.place, tip.direction, AHEAD * tip.spacing)
        if filled < LEAST_FILLED or (xx == yy and xy == 0.0):
            return tip.direction
        angle = 0.5 * atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
        direction = np.array([cos(angle), sin(angle)])
        return direction if (direction * tip.direction).sum() >= 0.0 else -direction

    def _crossed(self, tip: Tip, crack: int) -> tuple[int, float]:
        """First unbroken bond on the ray of a tip, and where on the bond; -1 where there is none before another crack."""
        bonds, (x, y), (east, north) = self._bonds, tip.place, tip.direction
        return _find_crossed(
            bonds.first, bonds.second, bonds.status, bonds.crack, self._body, self._xy, self._cells.facet, tip.body, crack,
            x, y, east, north, LONGEST_STEP * tip.spacing,
        )  # fmt: skip

    def _start(self, bond: int, middle: Floats, spacing: float, tensor: Floats) -> None:
        """Start a crack in the middle of a bond, with two tips."""
        xx, yy, xy = tensor
        angle = 0.5 * atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
        number = 1 + max(self._last, int(self._bonds.crack.max(initial=0)), int(self.tips.crack.max(initial=0)))
        self._bonds.crack[bond], self._bonds.crack_order[bond], self._bonds.crack_part[bond] = number, 0, 0.5
        for sign in (1.0, -1.0):
            direction = sign * np.array([cos(angle), sin(angle)])
            self._add(bond, middle + BEYOND * spacing * direction, direction, number, int(sign), spacing)

    def _add(self, bond: int, position: Floats, direction: Floats, number: int, order: int, length: float) -> None:
        beside, axes, origin = self._axes(bond)
        position, direction = multiply(axes, position - origin), multiply(axes, direction)
        tip = beside, position, direction, number, order, length, (0.0, 0.0, UNTOLD)
        self.tips = CrackTips._make([np.concatenate([old, [new]]) for old, new in zip(self.tips, tip, strict=True)])

    def _axes(self, bond: int) -> tuple[list[int], Floats, Floats]:
        i, j = self._bonds.first[bond], self._bonds.second[bond]
        along = self._xy[j] - self._xy[i]
        axes = np.array([along, [-along[1], along[0]]]) / np.hypot(*along)
        return [int(self._ids[i]), int(self._ids[j])], axes, self._xy[i]

    def _step(self, tip: Tip, bond: int, fraction: float) -> None:
        """Let a tip cross a bond."""
        row, tips = tip.row, CrackTips._make([array.copy() for array in self.tips])
        i, j = self._bonds.first[bond], self._bonds.second[bond]
        position = self._xy[i] + fraction * (self._xy[j] - self._xy[i])
        advance = position - tip.place
        direction = tip.direction if (advance * tip.direction).sum() > 0.0 else advance / np.hypot(*advance)
        position = position + BEYOND * tip.spacing * direction
        number, order = int(tips.crack[row]), int(tips.order[row])
        self._bonds.crack[bond], self._bonds.crack_order[bond], self._bonds.crack_part[bond] = number, order, fraction
        beside, axes, origin = self._axes(bond)
        tips.beside[row] = beside
        tips.place[row], tips.direction[row] = multiply(axes, position - origin), multiply(axes, direction)
        tips.order[row] += 1 if order > 0 else -1
        tips.intensity[row] = 0.0, 0.0, UNTOLD
        tips.length[tips.crack == number] += np.hypot(*(position - tip.place))
        self.tips = tips

    def _drop(self, rows: list[int]) -> None:
        if rows:
            remaining = np.setdiff1d(np.arange(self.tips.crack.size), rows)
            self.tips = CrackTips._make([array[remaining] for array in self.tips])


# Many arguments: the bonds and the ray, without an array for each.
@kernel
def _find_crossed(
    first: Ints, second: Ints, status: Ints, crack: Ints, body: Ints, xy: Floats, facet: Floats, own_body: int, own_crack: int,
    x: float, y: float, east: float, north: float, longest: float,
) -> tuple[int, float]:  # fmt: skip
    """First unbroken bond of a fragment on a ray, and where on the bond (0 to 1); -1 where there is none before another crack."""
    row, where_crossed = -1, 0.0
    for is_intact in (False, True):
        row, where_crossed, nearest = -1, 0.0, longest
        for b in range(first.size):
            i, j = first[b], second[b]
            if body[i] != own_body or body[j] != own_body or (status[b] == 0) != is_intact:
                continue
            begin_x, begin_y, along_x, along_y = xy[i, 0], xy[i, 1], xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
            if not is_intact:
                # Facets of broken bonds are open, but for those of its own crack, which lie behind it.
                if crack[b] == own_crack:
                    continue
                facet_x, facet_y = -along_y * facet[i], along_x * facet[i]
                begin_x, begin_y = begin_x + 0.5 * (along_x - facet_x), begin_y + 0.5 * (along_y - facet_y)
                along_x, along_y = facet_x, facet_y
            offset_x, offset_y, turn = begin_x - x, begin_y - y, east * along_y - north * along_x
            distance = (offset_x * along_y - offset_y * along_x) / turn
            fraction = (offset_x * north - offset_y * east) / turn
            # A ray through an element crosses one of its bonds at least, whatever round-off says.
            if 0.0 < distance <= nearest and -1e-9 <= fraction <= 1.0 + 1e-9 and (distance < nearest or row < 0):
                nearest, row, where_crossed = distance, b, fraction
        longest = nearest
    return row, min(max(where_crossed, 0.0), 1.0)
