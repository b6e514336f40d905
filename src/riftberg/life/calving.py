"""Calving from a flux of land ice: stores of ice by size class in each cell, and the bergs that leave them.

Source: files 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.config.parameter_groups import Calving, ClassTable
from riftberg.errors import InputError
from riftberg.life.draws import FmsStream
from riftberg.life.free_places import FreePlaces, corner_reach
from riftberg.ocean.cells import position_in_cell
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.physics.calving import class_width, fill_stores, fractions_by_mass, mean_weights
from riftberg.state import Elements, Floats, Ints, new_elements

PART_OF_STEP: Final = 2.0 / 17.0
"""Part of a step by which bergs that leave one store in one step differ in their day of birth (files, 3.2)."""

_GOLDEN: Final = (0.7548776662466927, 0.5698402909980532)
"""Steps of a sequence that fills a square evenly (Roberts 2018)."""

WITHIN: Final = 0.8
"""Part of a cell, along both axes, within which bergs of own runs are born."""


class Classes(NamedTuple):
    """Size classes of one hemisphere; arrays of shape (classes,)."""

    mass: Floats  # Of one berg, kg
    fraction: Floats  # Part of the mass of calved ice
    scaling: Floats  # Number of bergs that one element stands for
    thickness: Floats  # Of one berg, m
    width: Floats  # Of one berg, m
    length: Floats  # Of one berg, m


def size_classes(table: ClassTable, calving: Calving, density: float) -> Classes:
    """Return the classes of a table, with the sizes that follow from it (files, 3.1)."""
    mass, fraction, scaling, thickness = (
        np.array(q, dtype=float) for q in (table.mass, table.fraction, table.scaling, table.thickness)
    )
    if calving.fractions == "number":
        number_fractions, fraction = fraction, np.zeros_like(fraction)
        fractions_by_mass(number_fractions, mass, fraction)
    ratio = calving.length_over_width
    width = np.array([class_width(m, t, density, ratio) for m, t in zip(mass, thickness, strict=True)])
    return Classes(mass, fraction, scaling, thickness, width, ratio * width)


@dataclass
class Stores:
    """Ice that has left the land and is not yet a berg; arrays over the cells of the domain, without halo."""

    ice: Floats  # By size class, kg; shape (classes, nj, ni)
    heat: Floats  # Heat that came with it, J; shape (nj, ni)
    counter: Ints  # Bergs born in each cell so far; shape (nj, ni)
    mean_flux: Floats | None = None  # Running means, kg m-2 s-1 and W m-2; None before the first step
    mean_heat: Floats | None = None  # Running means, kg m-2 s-1 and W m-2; None before the first step
    # Whether the heat in the stores is known: at the first flux of a fresh run it is set from that flux
    begun: bool = False

    @classmethod
    def empty(cls, classes: int, grid: Grid) -> Stores:
        """Return stores without ice."""
        shape = grid.arrays.nj, grid.arrays.ni
        return cls(np.zeros((classes, *shape)), np.zeros(shape), np.zeros(shape, np.int64), begun=True)

    @classmethod
    def random(cls, south: Classes, north: Classes, grid: Grid, *, by_column: bool) -> Stores:
        """Return stores filled at random, as the reference does without a file of stores (files, 3.3)."""
        g = grid.arrays
        stores = cls.empty(south.mass.size, grid)
        stores.begun = False
        draws = np.empty_like(stores.ice)
        # Streams are seeded by cell or by column, so that the draws do not depend on the processes of the reference.
        for i in range(g.ni):
            if by_column:
                stream = FmsStream(i + 1)
                draws[:, :, i] = [[stream.next() for _ in range(g.nj)] for _ in range(len(draws))]
                continue
            for j in range(g.nj):
                stream = FmsStream(i + 1 + 10000 * (j + 1))
                draws[:, j, i] = [stream.next() for _ in range(len(draws))]
        is_south = g.lat[grid.domain] < 0.0
        mask = g.mask[grid.domain]
        for k in range(len(draws)):
            mass = np.where(is_south, south.mass[k], north.mass[k])
            scaling = np.where(is_south, south.scaling[k], north.scaling[k])
            stores.ice[k] = draws[k] * mask * mass * scaling
        return stores

    def next_identifier(self, column: int, row: int) -> int:
        """Count a birth in a cell (indices of the domain) and return the identifier of the reference (files, 0.4)."""
        self.counter[row, column] += 1
        return (int(self.counter[row, column]) << 32) | (column + 1 + int(self.counter.shape[1]) * row)

    def copy(self) -> Stores:
        """Return stores that share no memory with these."""
        flux, heat = (None if q is None else q.copy() for q in (self.mean_flux, self.mean_heat))
        return Stores(self.ice.copy(), self.heat.copy(), self.counter.copy(), flux, heat, self.begun)


class Accumulated(NamedTuple):
    """The result of a flux of ice in a step."""

    flux: Floats  # Ice (kg m-2 s-1) and heat (W m-2) that arrived, after mask and running mean
    heat_flux: Floats  # Ice (kg m-2 s-1) and heat (W m-2) that arrived, after mask and running mean
    left: Floats  # What no class takes: ice (kg s-1) and heat (W) of each cell
    heat_left: Floats  # What no class takes: ice (kg s-1) and heat (W) of each cell


class _Birth(NamedTuple):
    """A berg that leaves a store."""

    size: int  # Class
    row: int  # Of its cell in the domain
    column: int
    day: float  # Of the year
    warmth: float  # Heat, J kg-1
    identifier: int
    spot: tuple[float, float, float, float]  # Longitude, latitude, coordinates in the cell


class FluxCalving:
    """Calving from a flux of land ice, on the grid of an ocean."""

    def __init__(self, parameters: Parameters, grid: Grid, stores: Stores | None = None) -> None:
        calving, density = parameters.calving, parameters.ice.density
        self.parameters, self.grid = parameters, grid
        self.south = size_classes(calving.south, calving, density)
        self.north = size_classes(calving.north or calving.south, calving, density)
        self.stores = Stores.empty(self.south.mass.size, grid) if stores is None else stores
        g, corner = grid.arrays, parameters.calving.hemisphere_by_corner
        self.is_south = np.ascontiguousarray((g.lat if corner else g.lat_centre)[grid.domain] < 0.0)
        self._area = np.ascontiguousarray(g.area[grid.domain])
        self._mask = np.ascontiguousarray(g.mask[grid.domain])

    def take(self, flux: Floats, heat_flux: Floats, dt: float) -> Accumulated:
        """Take the flux of one step into the stores.

        ``flux``, ``heat_flux``: ice (kg m-2 s-1, not negative) and heat (W m-2) that leave the land (shape (nj, ni));
        ``dt``: step, s.
        """
        s = self.stores
        flux, heat_flux = flux * self._mask, heat_flux * self._mask
        if self.parameters.calving.smoothing_time > 0.0:
            flux, heat_flux = self._smooth(flux, heat_flux, dt)
            flux, heat_flux = flux * self._mask, heat_flux * self._mask
        # The heat of stores that were filled at random is that of the first flux, in proportion to their ice.
        if not s.begun:
            rate = flux * self._area
            has_flux = rate != 0.0
            s.heat[has_flux] = s.ice.sum(axis=0)[has_flux] * (heat_flux * self._area)[has_flux] / rate[has_flux]
            s.begun = True
        left, heat_left = np.zeros_like(flux), np.zeros_like(flux)
        fill_stores(
            s.ice, s.heat, flux, heat_flux, self._area, self.is_south, (self.south.fraction, self.north.fraction),
            dt, left, heat_left,
        )  # fmt: skip
        return Accumulated(flux, heat_flux, left, heat_left)

    def _smooth(self, flux: Floats, heat_flux: Floats, dt: float) -> tuple[Floats, Floats]:
        s, tau = self.stores, self.parameters.calving.smoothing_time
        if s.mean_flux is None or s.mean_heat is None:
            s.mean_flux, s.mean_heat = flux.copy(), heat_flux.copy()
        new, old = mean_weights(tau, dt)
        for mean, current in ((s.mean_flux, flux), (s.mean_heat, heat_flux)):
            mean[:] = new * current + old * mean
        return s.mean_flux.copy(), s.mean_heat.copy()

    def bear(self, year: int, day: float, dt: float, others: Elements | None = None) -> tuple[Elements, Ints]:
        """Let bergs leave the stores that hold enough ice for one (files, 3.2); return them, and their identifiers by cell.

        ``dt``: step, s; ``others``: ice beside which they must find room in their cell, or wait in their store.
        """
        s, free = self.stores, None if others is None else FreePlaces(others, self.parameters)
        rows: list[_Birth] = []
        for k in range(self.south.mass.size):
            need = np.where(
                self.is_south, self.south.mass[k] * self.south.scaling[k], self.north.mass[k] * self.north.scaling[k]
            )
            for j, i in np.argwhere(s.ice[k] >= need).tolist():
                offset = 0.0
                while s.ice[k, j, i] >= need[j, i]:
                    c = self.south if self.is_south[j, i] else self.north
                    spot = self._spot(i, j, float(corner_reach(c.length[k], c.width[k])), free)
                    if spot is None:
                        break
                    # The reference gives a berg the heat of all classes over the ice of its own (quirk T16).
                    ice = self.stores.ice[:, j, i]
                    ice_mass = ice[k] if self.parameters.calving.heat_of_one_class else ice.sum()
                    warmth = float(self.stores.heat[j, i] / ice_mass)
                    rows.append(_Birth(k, j, i, day + offset / 86400.0, warmth, s.next_identifier(i, j), spot))
                    s.heat[j, i] -= need[j, i] * warmth
                    s.ice[k, j, i] -= need[j, i]
                    offset -= dt * PART_OF_STEP
        e = new_elements(len(rows))
        halo = self.grid.arrays.halo
        for n, (k, j, i, day, warmth, _, spot) in enumerate(rows):
            c = self.south if self.is_south[j, i] else self.north
            e.mass[n], e.thickness[n], e.width[n], e.length[n] = c.mass[k], c.thickness[k], c.width[k], c.length[k]
            e.start_mass[n], e.mass_scaling[n], e.heat_density[n] = c.mass[k], c.scaling[k], warmth
            e.start_year[n], e.start_day[n] = year, day
            e.cell_i[n], e.cell_j[n] = i + halo, j + halo
            e.lon[n], e.lat[n], e.xi[n], e.eta[n] = spot
        e.start_lon[:], e.start_lat[:] = e.lon, e.lat
        return e, np.array([birth.identifier for birth in rows], np.int64)

    def _spot(self, i: int, j: int, reach: float, free: FreePlaces | None) -> tuple[float, float, float, float] | None:
        """Place of the next birth in a cell: longitude, latitude, coordinates in the cell; None where other ice leaves no room.

        The middle of the cell with the reference's numerics; in own runs beside it, so that no two lie on top of each other.
        """
        g = self.grid.arrays
        row, column = j + g.halo, i + g.halo
        if self.parameters.quirks.births_at_centre:
            lon, lat = float(g.lon_centre[row, column]), float(g.lat_centre[row, column])
            xi, eta, _ = position_in_cell(lon, lat, column, row, g)
            return lon, lat, xi, eta
        # Births follow a sequence that fills the cell evenly: near in number, far in place.
        count = float(self.stores.counter[j, i] + 1)
        xi, eta = (0.5 + WITHIN * ((0.5 + step * count) % 1.0 - 0.5) for step in _GOLDEN)

        def blended(corner: Floats) -> float:
            south = (1.0 - xi) * corner[row - 1, column - 1] + xi * corner[row - 1, column]
            north = (1.0 - xi) * corner[row, column - 1] + xi * corner[row, column]
            return float((1.0 - eta) * south + eta * north)

        drawn = blended(g.lon), blended(g.lat)
        if free is None:
            return *drawn, xi, eta
        across = float(np.sqrt(g.area[row, column]))
        free_spot = free.nearest(*drawn, reach, lambda x, y: position_in_cell(x, y, column, row, g)[2], across)
        if free_spot is None:
            return None
        free.take(*free_spot, reach)
        if free_spot != drawn:
            xi, eta, _ = position_in_cell(*free_spot, column, row, g)
        return *free_spot, xi, eta


def check_flux(flux: Floats, heat_flux: Floats, mask: NDArray[np.float64], where: str) -> None:
    """Refuse a flux of land ice that cannot be."""
    for name, values in (("calving flux", flux), ("heat of the calving flux", heat_flux)):
        bad = ~np.isfinite(values) & (mask >= 0.5)
        if name == "calving flux":
            bad |= values < 0.0
        if bad.any():
            j, i = np.argwhere(bad)[0]
            raise InputError(
                f"{name} is {values[j, i]:g} in cell ({i + 1}, {j + 1})",
                where=where,
                remedy="Ice leaves the land: give numbers of 0 or more"
                if name == "calving flux"
                else "Give finite numbers",
            )
    dry = (flux > 0.0) & (mask < 0.5)
    if dry.any():
        j, i = np.argwhere(dry)[0]
        raise InputError(
            f"ice calves into cell ({i + 1}, {j + 1}), which is land ({int(dry.sum())} such cells)",
            where=where,
            remedy="Move the flux to the nearest cell of water, or correct the mask",
        )
