"""Bergs beside an ocean model: one call for each of its steps, with names, units, stocks and a ledger that closes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, Final, Literal

import numpy as np
import xarray as xr
from scipy.spatial import cKDTree

from riftberg.bergs.bonding import Metric, separations
from riftberg.config.values import number
from riftberg.constants import LATENT_HEAT
from riftberg.coupling.fields import OceanForcing
from riftberg.coupling.fluxes import OceanFluxes, mass_on_cells
from riftberg.coupling.intake import OceanIntake
from riftberg.coupling.ledger import ExchangeBalance, ExchangeLedger, Settling
from riftberg.coupling.shelf import IceShelf
from riftberg.errors import InputError
from riftberg.life.calving import FluxCalving, Stores, check_flux
from riftberg.life.ledger import stocks
from riftberg.life.process import birth_date
from riftberg.model import BareModel
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid, Staggering
from riftberg.state import Bonds, Elements, Floats, Ints


def refuse_ice_on_bergs(old: Elements, new: Elements, metric: Metric) -> None:
    """Refuse new elements that lie on others."""
    if not old.size:
        return
    size_old, size_new = (np.sqrt(e.body.length * e.body.width) for e in (old, new))
    lon0, lat0 = float(new.lon[0]), float(new.lat[0])
    positions = [
        np.stack(separations(metric, e.lon, e.lat, np.asarray(lon0), np.asarray(lat0)), axis=1) for e in (old, new)
    ]
    reach = 0.5 * (float(size_old.max()) + float(size_new.max()))
    # The tree finds who may touch by the largest sizes; each pair is then held against its own.
    for n, neighbours in enumerate(cKDTree(positions[0]).query_ball_point(positions[1], 2.0 * reach)):
        rows = np.asarray(neighbours, np.int64)
        dx, dy = separations(metric, old.lon[rows], old.lat[rows], np.asarray(new.lon[n]), np.asarray(new.lat[n]))
        close = np.hypot(dx, dy) < 0.5 * (size_old[rows] + size_new[n])
        if close.any():
            raise InputError(
                f"element {int(old.body.id[rows[np.argmax(close)]])} lies where the ice shelf calves, at "
                f"{new.lon[n]:.4f}, {new.lat[n]:.4f}",
                where="ice shelf, mask", remedy="Leave cells with bergs out of the mask",
            )  # fmt: skip


_LOG = logging.getLogger(__name__)

STORES: Final = "exchange_"
"""Beginning of the names under which a restart keeps stores and ledger of the exchange."""

Edge = Literal["open", "closed"]

FITS: Final = 1e-9
"""How closely the steps of ocean and bergs must fit, as part of a step."""


class Exchange:
    """Bergs beside an ocean model.

    Parameters
    ----------
    model : Model
        Its forcing must be an `OceanForcing` on the grid of the ocean.
    ocean_step : float or str, optional
        Step of the ocean, s or with a unit: a whole number of long steps of the bergs; one by default.
    staggering : {"A", "B", "C"}, optional
        Where currents and sea-ice velocities stand: in the middle of the cells, at north-east corners, or u on the east and
        v on the north sides.
    wind_staggering : {"A", "B", "C"}, optional
        The same for wind or stress; A by default.
    calving : bool, optional
        Whether bergs calve from the flux of land ice that is handed over.
    settling_time : float, optional
        Time (s) in which the mass on cells passes from a shelf to the berg that calved from it, see
        `calve_shelf`.

    Attributes
    ----------
    departed : list of (Elements, Bonds)
        Bergs that left the grid over an open edge (`ocean_grid`) in the last step of the ocean. `Model.append` of a model
        beside this one takes them; the ledger counts them either way.

    Examples
    --------
    >>> import numpy as np
    >>> from riftberg import Iceberg, Model, Parameters
    >>> from riftberg.coupling.exchange import Exchange, ocean_grid
    >>> from riftberg.coupling.fields import OceanForcing
    >>> lon, lat = np.meshgrid(np.linspace(-40, -30, 21), np.linspace(-60, -54, 13))
    >>> grid = ocean_grid(lon, lat)
    >>> berg = Iceberg.rectangle(30e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
    >>> parameters = Parameters(melt={"enabled": True})
    >>> exchange = Exchange(Model(berg, OceanForcing(grid, grid.fields()), parameters))
    >>> given = exchange.step({"sea_surface_temperature": (275.0, "K"), "sea_surface_salinity": 34.0})
    >>> float(given["ficeberg"].sum()) > 0.0
    True
    """

    def __init__(
        self, model: BareModel, ocean_step: float | str | None = None, *, staggering: Staggering = "B",
        wind_staggering: Staggering = "A", calving: bool = True, settling_time: float = 86400.0,
    ) -> None:  # fmt: skip
        if not isinstance(model.forcing, OceanForcing):
            raise InputError(
                "the model has the forcing " + type(model.forcing).__name__, where="Exchange",
                remedy="Make the model with OceanForcing(grid, grid.fields(...))",
            )  # fmt: skip
        if ocean_step is None:
            self.ocean_step = model.parameters.time_step
        else:
            self.ocean_step = number(ocean_step, "s", where="Exchange, ocean_step")
            model.fit_time_step(self.ocean_step)
        p = model.parameters
        self.model, self.forcing, self.grid = model, model.forcing, model.forcing.ocean_grid
        self.steps = _whole_steps(self.ocean_step, p.time_step)
        _check_kept(model, self.grid)
        saved = {
            name.removeprefix(STORES): array for name, array in model.remembered.items() if name.startswith(STORES)
        }
        handed = saved.get("handed", np.zeros(len(Fields._fields))).copy()
        self._intake = OceanIntake(model, self.forcing, staggering, wind_staggering, handed)
        self.calving = FluxCalving(p, self.grid, _kept_stores(saved)) if calving else None
        self._settling = Settling(number(settling_time, "s", where="settling_time"), self.grid)
        self._settling.take_up(saved.get("settling"))
        self._fluxes = OceanFluxes(model, self.forcing, self.ocean_step, self.steps)
        if model.life is not None:
            model.life.look_around = self._fluxes.look
        self.departed: list[tuple[Elements, Bonds]] = []
        self._ledger = ExchangeLedger(saved)
        if "start" not in saved:
            self._ledger.start[:] = self.stocks()
        self._keep()

    # --------------------------------------------------------------------------------------------------------- stocks

    def stocks(self) -> tuple[float, float]:
        """Return ice in bergs and stores (kg), and the heat it lacks (J, negative)."""
        ice, heat = stocks(self.model.elements)
        if self.calving is not None:
            stored = float(self.calving.stores.ice.sum()) + float(self._ledger.held[0])
            warmth = float(self.calving.stores.heat.sum()) + float(self._ledger.held[1])
            ice, heat = ice + stored, heat + warmth - LATENT_HEAT * stored
        return ice, heat

    def balance(self) -> ExchangeBalance:
        """Return the ledger since the start."""
        return self._ledger.balance(self.stocks())

    # ----------------------------------------------------------------------------------------------------------- step

    def step(self, given: Mapping[str, Any] | xr.Dataset) -> xr.Dataset:
        """Take one step of the ocean.

        Parameters
        ----------
        given : mapping or xarray.Dataset
            Fields from the ocean, by the names of `riftberg.coupling.fields.TAKEN`: numbers, arrays in the units of that
            table, pairs of array and units, or xarray variables with units. Fields that are left out stay at rest or
            absent; temperature must be there if bergs melt.

        Returns
        -------
        xarray.Dataset
            Fields to the ocean, mean over its step (mass, area and friction velocity: at its end), with CF attributes; see
            `riftberg.coupling.fields.GIVEN`.

        Raises
        ------
        InputError
            If a name, a unit, a shape or a value is wrong; nothing has been stepped then. Whatever else fails takes the whole
            step back, with births and stores.
        """
        arrays = self._intake.read(given)
        shape = self.grid.arrays.nj, self.grid.arrays.ni
        flux, heat = (np.broadcast_to(arrays.pop(name, np.zeros(shape)), shape) for name in ("calving", "calving_heat"))
        mask = self.grid.arrays.mask[self.grid.domain]
        check_flux(flux, heat, mask, "exchange")
        # On land may stand what marks missing values.
        flux, heat = (np.where(mask >= 0.5, q, 0.0) for q in (flux, heat))
        # All that may be refused has been checked by now: a step that is refused has changed nothing.
        self._intake.deliver(arrays)
        self._intake.note_handed(arrays)
        go_back = self._checkpoint()
        try:
            return self._stepped(flux, heat)
        except BaseException:
            go_back()
            raise

    def show(self, given: Mapping[str, Any] | xr.Dataset) -> None:
        """Hand fields over without a step: bergs at their start, and a record of it, meet this ocean and not one at rest."""
        arrays = self._intake.read(given)
        self._intake.deliver({name: a for name, a in arrays.items() if name in {*Fields._fields, "taux", "tauy"}})

    def _checkpoint(self) -> Callable[[], None]:
        """Return a function that restores bergs, stores and budget."""
        go_back = self.model.checkpoint()
        ledger, departed, rest = self._ledger.copy(), self.departed.copy(), self._settling.rest.copy()
        stores = None if self.calving is None else deepcopy(self.calving.stores)

        def whole_way() -> None:
            go_back()
            self._ledger, self.departed, self._settling.rest = ledger, departed, rest
            if self.calving is not None and stores is not None:
                self.calving.stores = stores

        return whole_way

    def _stepped(self, flux: Floats, heat: Floats) -> xr.Dataset:
        """Let ice calve and bergs step, and return the fields to the ocean."""
        self._fluxes.begin()
        if self.calving is not None:
            self._calve(flux, heat)
        else:
            # Without calving all land ice goes to the ocean at once, and takes its latent heat with it.
            self._fluxes.fields |= {"left": flux, "left_heat": heat - LATENT_HEAT * flux}
        self.departed = []
        for _ in range(self.steps):
            departed = self._fluxes.step_bergs()
            if departed is not None:
                self.departed.append(departed)
        self._settling.settle(self.ocean_step)
        scale = self.grid.arrays.area[self.grid.domain] * self.ocean_step
        gone = [elements for elements, _ in self.departed]
        self._ledger.enter_step((flux, heat), self._fluxes.fields, scale, gone)
        self._keep()
        return self._fluxes.dataset(self._settling)

    def _calve(self, flux: Floats, heat: Floats) -> None:
        """Take land ice into the stores, and let bergs calve from them."""
        assert self.calving is not None
        area = self.grid.arrays.area[self.grid.domain]
        got = self.calving.take(flux, heat, self.ocean_step)
        # What a running mean holds back is still there: it counts as a stock.
        self._ledger.held[0] += float(((flux - got.flux) * area).sum()) * self.ocean_step
        self._ledger.held[1] += float(((heat - got.heat_flux) * area).sum()) * self.ocean_step
        left = got.left / area
        self._fluxes.fields |= {"left": left, "left_heat": got.heat_left / area - LATENT_HEAT * left}
        others = self.model.elements if self.model.parameters.stepping.interactions else None
        elements, ids = self.calving.bear(*birth_date(self.model, coming=True), self.ocean_step, others)
        if ids.size:
            self._bear(elements)

    def _bear(self, elements: Elements, bonds: Bonds | None = None) -> tuple[Ints, float, float]:
        """Add newborn elements to the model and its ledger; return identifiers, mass (kg) and heat (J)."""
        if self.model.life is not None:
            self.model.life.find_others(self.model)
        ids = self.model.append(elements, bonds)
        mass, heat = stocks(elements)
        if self.model.life is not None:
            self.model.life.enter(self.model, "calved", mass, heat)
        return ids, mass, heat

    # -------------------------------------------------------------------------------------------- calving of a shelf

    def calve_shelf(
        self, mask: Any, thickness: Any, *, radius: float = 1500.0, velocity: tuple[float, float] = (0.0, 0.0)
    ) -> Ints:
        """Let a bonded berg calve from an ice shelf, between two steps.

        The berg has the mass of the shelf. On each cell the ocean meets no jump of pressure: at this moment the mass on the
        water (`mass_on_water`) is the mass of the shelf, and from there it goes over into the mass of the berg within
        ``settling_time``. The shelf is the ocean's or the land ice's own: take ice away there at the same moment.

        Parameters
        ----------
        mask : array, shape (nj, ni)
            Part of each cell that calves, 0 to 1; these cells must be ocean.
        thickness : float or array, shape (nj, ni)
            Of the shelf, m, as ice of the density of the run.
        radius : float, optional
            Half the width of an element, m.
        velocity : tuple of float, optional
            m s-1.

        Returns
        -------
        array of int
            Identifiers of the elements.

        Raises
        ------
        InputError
            If mask or thickness cannot be, or bergs lie there already; nothing has calved then.
        """
        model, p = self.model, self.model.parameters
        shelf = IceShelf.of(self.grid, mask, thickness, p.ice.density)
        dry = (shelf.part > 0.0) & (self.grid.arrays.mask[self.grid.domain] < 0.5)
        if dry.any():
            j, i = np.argwhere(dry)[0]
            raise InputError(
                f"cell ({i + 1}, {j + 1}) of the ice shelf is land for the ocean ({int(dry.sum())} such cells)",
                where="ice shelf, mask", remedy="Calve ice that floats on cells of water",
            )  # fmt: skip
        berg = shelf.berg(radius=radius, packing=p.bonds.packing, velocity=velocity)
        new = berg.elements
        self.grid.locate(new)
        refuse_ice_on_bergs(model.elements, new, Metric(p.earth.latlon, p.earth.radius, p.earth.period))
        new.life.start_mass[:], new.life.start_lon[:], new.life.start_lat[:] = new.mass, new.lon, new.lat
        year, day = birth_date(model, coming=True)
        new.life.start_year[:], new.life.start_day[:] = year, day
        # What the cells bear with and without the new berg, both now: their difference is what has still to settle.
        previous = mass_on_cells(model, self.grid)[0] + self._settling.rest
        ids, mass, heat = self._bear(new, berg.bonds)
        self._settling.rest = previous + shelf.mass - mass_on_cells(model, self.grid)[0]
        self._ledger.enter_birth(mass, heat)
        self._keep()
        return ids

    def mass_on_water(self) -> Floats:
        """Return the mass on the water of each cell now, kg m-2, shape (nj, ni)."""
        borne, grounded = mass_on_cells(self.model, self.grid)
        return np.asarray(self._settling.settled(borne - grounded) / self.grid.arrays.area[self.grid.domain])

    def _keep(self) -> None:
        """Leave stores and ledger where a restart finds them."""
        memory: dict[str, Floats | None] = {
            **self._ledger.arrays, "settling": self._settling.rest, "handed": self._intake.handed,
            "corners": _outer_corners(self.grid),
        }  # fmt: skip
        if self.calving is not None:
            s = self.calving.stores
            memory |= {"ice": s.ice, "heat": s.heat, "counter": s.counter.astype(float)}
            memory |= {"mean_flux": s.mean_flux, "mean_heat": s.mean_heat}
        self.model.remembered.update(
            {STORES + name: array.copy() for name, array in memory.items() if array is not None}
        )


def _check_kept(model: BareModel, grid: Grid) -> None:
    """Refuse stores of a restart that lie on another grid, or are not whole."""
    shape, memory = (grid.arrays.nj, grid.arrays.ni), model.remembered
    names = [STORES + name for name in ("settling", "ice", "heat", "counter", "mean_flux", "mean_heat")]
    for name in names:
        if name in memory and memory[name].shape[-2:] != shape:
            raise InputError(
                f"{name} lies on a grid of {memory[name].shape[-2:]} cells, the exchange on one of {shape}",
                where=f"restart file, extra/{name}", remedy="Go on with the grid of the run that wrote the restart",
            )  # fmt: skip
    saved, here = memory.get(STORES + "corners"), _outer_corners(grid)
    if saved is not None and not np.allclose(saved, here, rtol=0.0, atol=1e-6):
        raise InputError(
            f"the grid of the exchange reached from {saved[:2]} to {saved[2:]}, and reaches from {here[:2]} to {here[2:]} now",
            where="restart file, group extra", remedy="Go on with the grid of the run that wrote the restart",
        )  # fmt: skip
    if names[1] in memory and not {names[2], names[3]} <= memory.keys():
        raise InputError(
            "stores of ice without their heat or counters", where="restart file, group extra",
            remedy="The file is damaged: resume from another restart",
        )  # fmt: skip


def _outer_corners(grid: Grid) -> Floats:
    """Return the first and the last corner of the cells: two coordinates each."""
    g, first = grid.arrays, grid.arrays.halo - 1
    last = first + g.nj, first + g.ni
    return np.array([g.lon[first, first], g.lat[first, first], g.lon[last], g.lat[last]])


def _kept_stores(saved: Mapping[str, Floats]) -> Stores | None:
    """Return the stores of land ice in a restart."""
    if "ice" not in saved:
        return None
    flux, heat = (saved[name].copy() if name in saved else None for name in ("mean_flux", "mean_heat"))
    return Stores(saved["ice"].copy(), saved["heat"].copy(), saved["counter"].astype(np.int64), flux, heat, begun=True)


def _whole_steps(ocean: float, bergs: float) -> int:
    if not 0.0 < ocean < math.inf:
        raise InputError(
            f"an ocean that steps by {ocean:g} s", where="Exchange, ocean_step", remedy="Give a finite number above 0"
        )
    steps = round(ocean / bergs) if bergs > 0.0 else 0
    if steps < 1 or abs(steps * bergs - ocean) > FITS * bergs:
        raise InputError(
            f"the ocean steps by {ocean:g} s, the bergs by {bergs:g} s", where="Exchange",
            remedy="Set stepping.time_step so that a whole number of long steps makes a step of the ocean",
        )  # fmt: skip
    return steps


def ocean_grid(
    lon: Any,
    lat: Any,
    *,
    mask: Any = None,
    area: Any = None,
    latlon: bool = True,
    period: float | None = None,
    edge: Edge = "open",
    **options: Any,
) -> Grid:
    """Return the grid of an ocean model from the corners of its cells.

    Parameters
    ----------
    lon, lat : array, shape (nj + 1, ni + 1)
        Corners of the cells, degrees, or m where ``latlon`` is false.
    mask : array, shape (nj, ni), optional
        1 ocean, 0 land.
    area : array, shape (nj, ni), optional
        Areas of the cells in the ocean model, m2, so that it gets all that leaves the bergs; found from the corners if
        left out.
    latlon : bool, optional
        Whether corners are degrees.
    period : float, optional
        Of the first coordinate; 360 degrees, or none in metres.
    edge : {"open", "closed"}, optional
        Kind of the edge of the grid, where it is neither land nor joined to the other side nor a pole: open, and bergs leave
        the model over it, as a whole, as soon as a part of them lies beyond (`Exchange.departed`); or closed like a coast.
    **options
        See `riftberg.ocean.grid.Grid.from_corners`.
    """
    turn = (360.0 if latlon else 0.0) if period is None else period
    sea = None if mask is None else np.asarray(mask, dtype=float)
    if edge not in ("open", "closed"):
        raise InputError(f"edge {edge!r}", where="ocean_grid", remedy="Use open or closed")
    grid = Grid.from_corners(lon, lat, latlon=latlon, period=turn, mask=sea, includes_southwest=True, **options)
    if edge == "open":
        grid.arrays.mask[:] = grid.extended(grid.arrays.mask[grid.domain])
        if latlon:  # behind a pole there is no sea
            grid.arrays.mask[np.abs(grid.arrays.lat_centre) > 90.0] = 0.0
    if area is not None:
        areas = np.asarray(area, dtype=float)
        if areas.shape != (grid.arrays.nj, grid.arrays.ni) or not (np.isfinite(areas).all() and (areas > 0.0).all()):
            raise InputError("areas of cells that are not positive numbers on the grid", where="ocean_grid")
        grid.arrays.area[:] = grid.extended(areas)
    return grid
