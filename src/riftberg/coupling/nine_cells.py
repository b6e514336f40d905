"""Bergs on ocean cells by the rules of the reference: shares of the nine cells around, gathered into fields.

Source: files 4.1 to 4.5.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE
from riftberg.life.melted import bit_shape
from riftberg.life.values import LifeValues
from riftberg.ocean.grid import Grid
from riftberg.physics.geometry import separation
from riftberg.physics.spreading import hexagon_shares, rectangle_shares, wet_part
from riftberg.state import Bonds, Elements, Floats, Ints

RHO_SPREADING: Final = 1035.0
"""Density of sea water that the reference takes here and nowhere else, kg m-3 (quirk T1)."""


class NineCellRules(NamedTuple):
    """How the reference spreads; names of its namelist in brackets."""

    hexagonal: bool  # Elements are hexagons (``hexagonal_icebergs``)
    one_cell_wide: bool  # Every rectangular berg counts as one cell wide (``use_old_spreading``)
    orientation: float  # Reference angle of hexagons, degrees (``initial_orientation``)
    turned_by_bonds: bool  # Hexagons turn with their bonds (``rotate_icebergs_for_mass_spreading`` and bonds on)
    grounding_fraction: float  # Part of the depth of water to which a keel weighs on the ocean; 0 for no limit


class Spread(NamedTuple):
    """Bergs to be spread; arrays of shape (bergs,)."""

    cell_i: Ints  # Cells and places in them
    cell_j: Ints  # Cells and places in them
    xi: Floats  # Cells and places in them
    eta: Floats  # Cells and places in them
    mass: Floats  # Of one berg, kg
    bits: Floats  # Of one berg, kg
    fl_bits: Floats  # Of one berg, kg
    fl_bergy_bits: Floats  # Of one berg, kg
    scaling: Floats  # Number of bergs
    area: Floats  # Of one berg, m2 and m
    thickness: Floats  # Of one berg, m2 and m
    u: Floats  # Velocity, m s-1
    v: Floats  # Velocity, m s-1
    static: Floats  # 1 where an element never moves
    orientation: Floats  # Turn of a hexagon, as the reference takes it


def orientations(elements: Elements, bonds: Bonds, rules: NineCellRules, earth: tuple[bool, float, float]) -> Floats:
    """Return the turn of each hexagon as the reference finds it from its bonds, radians taken for degrees (quirk T18).

    ``earth``: whether positions are degrees, radius (m), period.
    """
    value = np.full(elements.size, rules.orientation)
    if not rules.turned_by_bonds:
        return value
    third = math.pi / 3.0
    angles: list[list[float]] = [[] for _ in range(elements.size)]
    for b in np.flatnonzero(bonds.status == 0):
        for own, other in ((bonds.first[b], bonds.second[b]), (bonds.second[b], bonds.first[b])):
            e = elements.place
            dx, dy = separation(e.lon[other], e.lat[other], e.lon[own], e.lat[own], *earth)
            if dx == 0.0:
                angles[own].append(math.pi / 2.0)
            else:
                turn = (math.pi / 2.0 - rules.orientation * DEGREE) - math.atan(dy / dx)
                angles[own].append(turn % third)
    for e_row, found in enumerate(angles):
        value[e_row] = (sum(found) / len(found) if found else 0.0) % third
    return value


def bergs_of(elements: Elements, orientation: Floats) -> Spread:
    """Return all elements as they stand, to be spread."""
    place, body, life = elements.place, elements.body, elements.life
    return Spread(
        place.cell_i, place.cell_j, place.xi, place.eta, body.mass, life.mass_of_bits, life.mass_of_fl_bits,
        life.mass_of_fl_bergy_bits, life.mass_scaling, body.length * body.width, body.thickness, elements.motion.u,
        elements.motion.v, body.static, orientation,
    )  # fmt: skip


@kernel
def _afloat(thickness: float, water: float, rho_ice: float) -> float:
    """Part of the weight of a berg that the ocean bears, by the reference: depth of water over draft, at most 1."""
    draft = (rho_ice / RHO_SPREADING) * thickness
    return min(1.0, water / draft) if draft > water else 1.0


@kernel
def spread_nine(
    b: Spread,
    rules: NineCellRules,
    values: LifeValues,
    depth: Floats,
    ssh: Floats,
    area: Floats,
    mask: Floats,
    out: Floats,
) -> None:
    """Add mass (kg), area (m2) and area times velocity of bergs to the nine cells around each.

    ``out`` has the shape (4, 9, rows, columns): what the bergs of a cell give to its neighbour number n, counted row by
    row from the south-west.
    """
    w, scratch = np.zeros(9), np.zeros((8, 16))
    for e in range(b.mass.size):
        i, j, cell = b.cell_i[e], b.cell_j[e], area[b.cell_j[e], b.cell_i[e]]
        mass, fl_bits = b.mass[e], b.fl_bits[e]
        if rules.grounding_fraction > 0.0:
            water = rules.grounding_fraction * (depth[j, i] + ssh[j, i])
            mass = mass * _afloat(b.thickness[e], water, values.rho_ice)
            if fl_bits > 0.0:
                thin, _, _ = bit_shape(b.thickness[e], values)
                fl_bits = fl_bits * _afloat(thin, water, values.rho_ice)
        part = 1.0
        if rules.hexagonal:
            reach = math.sqrt(3.0) / 2.0 * 0.49
            if cell > 0.0:
                reach = min(math.sqrt(b.area[e] / (2.0 * math.sqrt(3.0))) / math.sqrt(cell), 1.0)
            hexagon_shares(b.xi[e], b.eta[e], reach, b.orientation[e], w, scratch)
            if b.static[e] < 0.5:
                part = 1.0 / wet_part(w, mask, i, j)
            for k in range(9):
                if k != 4:
                    w[k] *= mask[j + k // 3 - 1, i + k % 3 - 1]
        else:
            reach = 1.0
            if not rules.one_cell_wide and cell > 0.0:
                reach = min(math.sqrt(b.area[e] / cell), 1.0)
            rectangle_shares(b.xi[e], b.eta[e], reach, mask, i, j, w)
        weight = (((mass + fl_bits) + b.bits[e]) + b.fl_bergy_bits[e]) * b.scaling[e]
        plan = b.area[e] * b.scaling[e]
        for k in range(9):
            out[0, k, j, i] += (w[k] * weight) * part
            out[1, k, j, i] += (w[k] * plan) * part
            out[2, k, j, i] += (w[k] * (b.u[e] * plan)) * part
            out[3, k, j, i] += (w[k] * (b.v[e] * plan)) * part


def gather(parts: Floats, grid: Grid) -> Floats:
    """Return what each cell gets from the nine around it, over its area; shape of the grid with its halo (files, 4.4).

    ``parts``: as `spread_nine` fills it (shape (9, rows, columns)).
    """
    g, h = grid.arrays, grid.arrays.halo
    c = np.zeros_like(parts)
    rows, columns = grid.domain
    c[:, rows, columns] = parts[:, rows, columns]
    if g.cyclic:
        c[:, :, :h], c[:, :, h + g.ni :] = c[:, :, g.ni : g.ni + h], c[:, :, h : 2 * h]

    def at(k: int, di: int, dj: int) -> Floats:
        part: Floats = c[k, rows.start + dj : rows.stop + dj, columns.start + di : columns.stop + di]
        return part

    total = at(4, 0, 0) + (
        ((at(8, -1, -1) + at(0, 1, 1)) + (at(6, 1, -1) + at(2, -1, 1)))
        + ((at(5, -1, 0) + at(3, 1, 0)) + (at(7, 0, -1) + at(1, 0, 1)))
    )
    field = np.zeros_like(g.area)
    area, mask = g.area[grid.domain], g.mask[grid.domain]
    field[grid.domain] = np.where(area > 0.0, total / np.where(area > 0.0, area, 1.0) * mask, 0.0)
    return field
