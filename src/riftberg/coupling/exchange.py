"""Bergs beside an ocean model: one call for each of its steps, with names, units, stocks and a ledger that closes."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, Final, Literal, NamedTuple, TypeVar

import numpy as np
import xarray as xr
from pydantic import ValidationError
from scipy.spatial import cKDTree

from riftberg.bergs.bonding import Metric, separations
from riftberg.config.values import Section, explained, key, number
from riftberg.constants import LATENT_HEAT
from riftberg.coupling.fields import GIVEN, TAKEN, OceanForcing, taken
from riftberg.coupling.shelf import IceShelf, Shares, compute_shares
from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.fragments.grounding_log import mass_on_floor
from riftberg.errors import ForcingError, InputError
from riftberg.life.calving import FluxCalving, Stores, check_flux
from riftberg.life.melt import scaled_mass
from riftberg.life.process import PROCESSES, LifeModel, birth_date, stocks
from riftberg.model import BareModel
from riftberg.ocean.cells import CORNER_FIELDS, Fields
from riftberg.ocean.grid import Grid, Staggering, at_corners, wind_from_stress
from riftberg.ocean.gridded import interpolate_corners
from riftberg.ocean.needs import find_missing_water
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import find_rows


class Settling:
    """Mass that cells bear beyond the bergs on them, since ice calved there; its sum is 0, and it fades.

    ``time``: in which it becomes smaller by the factor e, s; ``rest``: kg (shape (nj, ni)).
    """

    def __init__(self, time: float, grid: Grid) -> None:
        if not 0.0 < time < math.inf:
            raise InputError(f"settling_time = {time:g} s", where="Exchange", remedy="Give a finite time above 0")
        self.time = time
        self.rest = np.zeros((grid.arrays.nj, grid.arrays.ni))

    def take_up(self, saved: Floats | None) -> None:
        """Go on from the state in a restart."""
        if saved is not None:
            self.rest = saved.copy()

    def settle(self, dt: float) -> None:
        """Let some time (s) pass."""
        self.rest *= math.exp(-dt / self.time)

    def settled(self, mass: Floats) -> Floats:
        """Return the mass of bergs on cells (kg) with the mass that has not settled yet; never below 0, of the same sum."""
        more = np.maximum(self.rest, 0.0)
        if not more.any():
            return mass
        # A berg may have left cells that still lack something: as much less is then added elsewhere.
        less = np.minimum(np.maximum(-self.rest, 0.0), mass)
        return np.asarray(mass - less + more * (less.sum() / more.sum()))


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
Kind = TypeVar("Kind", bound=Section)

FITS: Final = 1e-9
"""How closely the steps of ocean and bergs must fit, as part of a step."""


class ExchangeBalance(NamedTuple):
    """The ledger of an exchange since its start."""

    start: float  # Ice in bergs and stores, kg
    now: float  # Ice in bergs and stores, kg
    taken: float  # Ice that came from the land, and water that the ocean got, kg
    given: float  # Ice that came from the land, and water that the ocean got, kg
    left: float  # Ice that left over an open edge, kg
    heat_start: float  # The same for heat, J: ice lacks the latent heat
    heat_now: float  # The same for heat, J: ice lacks the latent heat
    heat_taken: float  # The same for heat, J: ice lacks the latent heat
    heat_given: float  # The same for heat, J: ice lacks the latent heat
    heat_left: float  # The same for heat, J: ice lacks the latent heat

    @property
    def error(self) -> float:
        """Mass that is left over, as part of the mass in the ledger; 0 if it closes."""
        scale = max(abs(self.start), abs(self.now), self.taken, self.given, 1e-30)
        return (self.start + self.taken - self.given - self.left - self.now) / scale

    @property
    def heat_error(self) -> float:
        """The same for heat."""
        scale = max(abs(self.heat_start), abs(self.heat_now), abs(self.heat_taken), abs(self.heat_given), 1e-30)
        return (self.heat_start + self.heat_taken - self.heat_given - self.heat_left - self.heat_now) / scale

    def describe(self) -> str:
        """Return the ledger in two lines."""
        return (
            f"ice {self.start:.6e} kg + taken {self.taken:.6e} - given {self.given:.6e} - left {self.left:.6e} = {self.now:.6e} "
            f"(error {self.error:.1e})\n"
            f"heat {self.heat_start:.6e} J + taken {self.heat_taken:.6e} - given {self.heat_given:.6e} "
            f"- left {self.heat_left:.6e} = {self.heat_now:.6e} "
            f"(error {self.heat_error:.1e})"
        )


class _Seen(NamedTuple):
    """Elements as they were after their motion and before the melt."""

    ids: Any
    shares: Shares
    scaling: Floats
    drag: Floats  # Of the water on the elements, N, along and across the rows of the grid; shape (2, elements)


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
        self.staggering: Staggering = staggering
        self.wind_staggering: Staggering = wind_staggering
        _check_kept(model, self.grid)
        # Which fields have been handed over so far: 1 or 0 for each name of `Fields`.
        self._handed = model.remembered.get(STORES + "handed", np.zeros(len(Fields._fields))).copy()
        self.calving = FluxCalving(p, self.grid, _kept_stores(model)) if calving else None
        self._settling = Settling(number(settling_time, "s", where="settling_time"), self.grid)
        self._settling.take_up(model.remembered.get(STORES + "settling"))
        self._seen: _Seen | None = None
        if model.life is not None:
            model.life.look_around = self._look
        self._held = model.remembered.get(STORES + "held", np.zeros(2)).copy()
        self._totals = model.remembered.get(STORES + "totals", np.zeros(4)).copy()
        self._left = model.remembered.get(STORES + "left", np.zeros(2)).copy()
        self.departed: list[tuple[Elements, Bonds]] = []
        start = model.remembered.get(STORES + "start")
        self._start = np.array(self.stocks()) if start is None else start.copy()
        self._keep()

    # --------------------------------------------------------------------------------------------------------- stocks

    def stocks(self) -> tuple[float, float]:
        """Return ice in bergs and stores (kg), and the heat it lacks (J, negative)."""
        ice, heat = stocks(self.model.elements)
        if self.calving is not None:
            stored = float(self.calving.stores.ice.sum()) + float(self._held[0])
            warmth = float(self.calving.stores.heat.sum()) + float(self._held[1])
            ice, heat = ice + stored, heat + warmth - LATENT_HEAT * stored
        return ice, heat

    def balance(self) -> ExchangeBalance:
        """Return the ledger since the start."""
        current = self.stocks()
        came, went, heat_came, heat_went = self._totals.tolist()
        left, heat_left = self._left.tolist()
        return ExchangeBalance(
            float(self._start[0]), current[0], came, went, left,
            float(self._start[1]), current[1], heat_came, heat_went, heat_left,
        )  # fmt: skip

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
        arrays = self._arrays(given)
        shape = self.grid.arrays.nj, self.grid.arrays.ni
        flux, heat = (np.broadcast_to(arrays.pop(name, np.zeros(shape)), shape) for name in ("calving", "calving_heat"))
        mask = self.grid.arrays.mask[self.grid.domain]
        check_flux(flux, heat, mask, "exchange")
        # On land may stand what marks missing values.
        flux, heat = (np.where(mask >= 0.5, q, 0.0) for q in (flux, heat))
        # All that may be refused has been checked by now: a step that is refused has changed nothing.
        self.forcing.put(self._fields(arrays))
        self._handed[[name in arrays for name in Fields._fields]] = 1.0
        go_back = self._checkpoint()
        try:
            return self._stepped(flux, heat)
        except BaseException:
            go_back()
            raise

    def show(self, given: Mapping[str, Any] | xr.Dataset) -> None:
        """Hand fields over without a step: bergs at their start, and a record of it, meet this ocean and not one at rest."""
        arrays = self._arrays(given)
        self.forcing.put(
            self._fields({name: a for name, a in arrays.items() if name in {*Fields._fields, "taux", "tauy"}})
        )

    def _checkpoint(self) -> Callable[[], None]:
        """Return a function that restores bergs, stores and budget."""
        go_back = self.model.checkpoint()
        names = ("_held", "_totals", "_left", "departed")
        copies = {name: getattr(self, name).copy() for name in names}
        rest, stores = self._settling.rest.copy(), None if self.calving is None else deepcopy(self.calving.stores)

        def whole_way() -> None:
            go_back()
            for name, value in copies.items():
                setattr(self, name, value)
            self._settling.rest = rest
            if self.calving is not None and stores is not None:
                self.calving.stores = stores

        return whole_way

    def _stepped(self, flux: Floats, heat: Floats) -> xr.Dataset:
        """Let ice calve and bergs step, and return the fields to the ocean."""
        fluxes = {name: np.zeros(flux.shape) for name in ("melt", "heat", "left", "left_heat", "stress_x", "stress_y")}
        by_process = np.zeros((len(PROCESSES), *flux.shape))
        if self.calving is not None:
            self._calve(flux, heat, fluxes)
        else:
            # Without calving all land ice goes to the ocean at once, and takes its latent heat with it.
            fluxes["left"], fluxes["left_heat"] = flux, heat - LATENT_HEAT * flux
        self.departed = []
        for _ in range(self.steps):
            self._seen = None
            self.model.step()
            if self.model.departed is not None:
                self.departed.append(self.model.departed)
                self._add_departed(self.model.departed[0], fluxes)
            # A model without melt has no process that looks around between motion and melt.
            if self._seen is None:
                self._look(self.model)
            self._add(fluxes, by_process)
        self._settling.settle(self.ocean_step)
        self._count(fluxes, flux, heat)
        return self._returned({**fluxes, **self._state()}, by_process)

    def _arrays(self, given: Mapping[str, Any] | xr.Dataset) -> dict[str, Floats]:
        items = {str(k): v for k, v in given.items()}
        if isinstance(given, xr.Dataset):
            items = {str(v.attrs.get("standard_name", k)): v for k, v in given.items()}
        g = self.grid.arrays
        cell = ((g.nj, g.ni), (g.nj + 2, g.ni + 2))
        corner = (*cell, (g.nj + 1, g.ni + 1))
        # Vectors may come with one more row and column: their corners.
        wide = {*CORNER_FIELDS, "taux", "tauy"}
        shapes: dict[str, tuple[tuple[int, int], ...]]
        shapes = {q.field: corner if q.field in wide else cell for q in TAKEN.values()}
        shapes |= {"calving": cell[:1], "calving_heat": cell[:1]}  # ice calves into cells of the ocean only
        arrays = taken(items, shapes, g.mask[self.grid.domain])
        for lacking, field in find_missing_water(self.model.parameters, arrays).items():
            name = next(name for name, q in TAKEN.items() if q.field == field)
            raise ForcingError(
                f"no {name}, but bergs melt", where="exchange",
                remedy=f"Hand it over, give melt.{lacking} as a number, or set melt.enabled = false",
            )  # fmt: skip
        for pair in (("uo", "vo"), ("ui", "vi"), ("ua", "va"), ("taux", "tauy")):
            if (pair[0] in arrays) != (pair[1] in arrays):
                raise InputError(
                    f"one of {pair[0]} and {pair[1]} alone", where="exchange", remedy="Hand over both parts"
                )
        if "taux" in arrays and "ua" in arrays:
            raise InputError("wind and its stress", where="exchange", remedy="Hand over one of them")
        return arrays

    def _fields(self, arrays: dict[str, Floats]) -> Fields:
        """Put the fields on the grid with its halo, vectors at its corners."""
        if "taux" in arrays:
            tau_x, tau_y = np.broadcast_arrays(arrays.pop("taux"), arrays.pop("tauy"))
            arrays["ua"], arrays["va"] = wind_from_stress(np.atleast_2d(tau_x), np.atleast_2d(tau_y))
            if tau_x.ndim == 0:
                arrays["ua"], arrays["va"] = arrays["ua"][0, 0], arrays["va"][0, 0]
        self._refuse_lacking(arrays)
        if "ssh" not in arrays and not self.forcing.given:  # the first step says it for all
            _LOG.warning(
                "the ocean gives no sea level (sea_surface_height_above_geoid): its slope is 0, and large bergs lag behind the "
                "current that it balances"
            )
        # A pack that only seems to stand still would hold bergs.
        model = self.model
        model.constants = model.constants._replace(ice_drift_known="ui" in arrays or "ice_thickness" not in arrays)
        previous = self.forcing.fields_at(0.0)
        fields = {name: self.grid.extended(a) for name, a in arrays.items()}
        for u, v, where in (
            ("uo", "vo", self.staggering),
            ("ui", "vi", self.staggering),
            ("ua", "va", self.wind_staggering),
        ):
            if u in fields:
                fields[u], fields[v] = at_corners(fields[u], fields[v], self.grid, where)
        return previous._replace(**fields)

    def _refuse_lacking(self, arrays: Mapping[str, Floats]) -> None:
        """Refuse the first step after a restart unless all is there that was handed over before: a restart has no fields."""
        handed = (name for name, once in zip(Fields._fields, self._handed, strict=True) if once)
        lacking = [name for name in handed if name not in arrays]
        if lacking and not self.forcing.given:
            names = [name for name, q in TAKEN.items() if q.field in lacking]
            raise InputError(
                f"no {' and no '.join(names)}, which the run had before its restart", where="exchange",
                remedy="Hand over in the first step all that was handed over before; a restart holds no fields of the ocean",
            )  # fmt: skip

    def _calve(self, flux: Floats, heat: Floats, fluxes: dict[str, Floats]) -> None:
        assert self.calving is not None
        area = self.grid.arrays.area[self.grid.domain]
        got = self.calving.take(flux, heat, self.ocean_step)
        # What a running mean holds back is still there: it counts as a stock.
        self._held[0] += float(((flux - got.flux) * area).sum()) * self.ocean_step
        self._held[1] += float(((heat - got.heat_flux) * area).sum()) * self.ocean_step
        fluxes["left"] = got.left / area
        fluxes["left_heat"] = got.heat_left / area - LATENT_HEAT * fluxes["left"]
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
        previous = self._borne()[0] + self._settling.rest
        ids, mass, heat = self._bear(new, berg.bonds)
        self._settling.rest = previous + shelf.mass - self._borne()[0]
        self._totals[0], self._totals[2] = self._totals[0] + mass, self._totals[2] + heat
        self._keep()
        return ids

    def mass_on_water(self) -> Floats:
        """Return the mass on the water of each cell now, kg m-2, shape (nj, ni)."""
        borne, grounded = self._borne()
        return np.asarray(self._settling.settled(borne - grounded) / self.grid.arrays.area[self.grid.domain])

    def _borne(self) -> tuple[Floats, Floats]:
        """Return the mass of bergs on cells, and the part that the floor bears, kg."""
        m = self.model
        shares = self._shares()
        mass = scaled_mass(m.elements.life, m.elements.body.mass)
        return shares.sum(mass), shares.sum(self._on_floor(m.elements))

    def _shares(self) -> Shares:
        """Return the shares of the elements in cells as they lie now."""
        m = self.model
        elements = m.elements.copy()
        self.grid.locate(elements)
        return compute_shares(elements, m.bonds, self.grid, m.parameters)

    def _on_floor(self, el: Elements) -> Floats:
        """Return the mass of each element that the sea floor bears, kg."""
        return np.asarray(mass_on_floor(el, self.model.constants) * el.life.mass_scaling)

    def _look(self, model: LifeModel) -> None:
        """Note the positions of the elements and the forces on them, before the melt."""
        m = self.model
        shares = compute_shares(m.elements, m.bonds, self.grid, m.parameters)
        scaling = m.elements.life.mass_scaling.copy()
        self._seen = _Seen(m.elements.body.id.copy(), shares, scaling, self._drag(m.elements))

    def _drag(self, elements: Elements) -> Floats:
        """Return the mean drag of the water (N) in the last step of the bergs, along and across the rows of the grid."""
        east, north = self.model.applied_forces(elements)[:, FORCES.index("water")].T
        g, mirrored = self.grid.arrays, bool(self.forcing.rules.mirrored)
        c, s = (interpolate_corners(angle, elements, mirrored) for angle in (g.cos_angle, g.sin_angle))
        return np.stack([c * east - s * north, s * east + c * north])

    def _add_departed(self, elements: Elements, fluxes: dict[str, Floats]) -> None:
        """Add the drag of departed bergs in one step: to their cells, or to the nearest ones if they lie beyond the edge."""
        inside, place, g = elements.copy(), elements.place, self.grid.arrays
        for index, size, name in ((place.cell_i, g.ni, "cell_i"), (place.cell_j, g.nj, "cell_j")):
            getattr(inside.place, name)[:] = np.clip(index, g.halo, g.halo + size - 1)
        np.clip(place.xi, 0.0, 1.0, out=inside.place.xi)
        np.clip(place.eta, 0.0, 1.0, out=inside.place.eta)
        cells = inside.place.cell_j - g.halo, inside.place.cell_i - g.halo
        area = g.area[self.grid.domain][cells]
        for name, drag in zip(("stress_x", "stress_y"), self._drag(inside), strict=True):
            np.add.at(fluxes[name], cells, -drag * inside.life.mass_scaling / area / self.steps)

    def _add(self, fluxes: dict[str, Floats], by_process: Floats) -> None:
        """Add the fluxes of one step of the bergs."""
        assert self._seen is not None
        seen, per_second = self._seen, 1.0 / self.ocean_step
        # The ocean gets the opposite of what it did to the bergs.
        for name, drag in zip(("stress_x", "stress_y"), seen.drag, strict=True):
            fluxes[name] += seen.shares.per_area(-drag * seen.scaling) / self.steps
        life = self.model.life
        if life is None or life.last is None:
            return
        step = life.last.melt
        fluxes["melt"] += seen.shares.per_area(step.water * per_second)
        fluxes["heat"] += seen.shares.per_area(step.water * (step.heat_density - LATENT_HEAT) * per_second)
        for k, water in enumerate(life.last.water):
            by_process[k] += seen.shares.per_area(water * per_second)

    def _state(self) -> dict[str, Floats]:
        """Mass, area and friction velocity at the end of the step."""
        assert self._seen is not None
        el, p = self.model.elements, self.model.parameters
        # Melt may have removed elements since their shares were found: rows are matched by identifier.
        rows, matched = find_rows(self._seen.ids, el.body.id)
        # Processes of the user may have added ice since.
        shares = self._seen.shares.taken(rows) if matched.all() else self._shares()
        scaling = el.life.mass_scaling
        mass, plan = scaled_mass(el.life, el.body.mass), el.body.length * el.body.width * scaling
        on_floor = self._on_floor(el)
        speed = np.hypot(el.motion.u - el.environment.uo, el.motion.v - el.environment.vo)
        friction = np.maximum(p.melt.least_friction, np.sqrt(p.melt.friction_drag * (speed**2 + p.melt.tide**2)))
        covered = shares.sum(plan)
        ustar = np.divide(shares.sum(plan * friction), covered, out=np.zeros_like(covered), where=covered > 0.0)
        return {
            "mass": self._settling.settled(shares.sum(mass - on_floor)) / self.grid.arrays.area[self.grid.domain],
            "grounded": shares.per_area(on_floor),
            "area": np.minimum(shares.per_area(plan), 1.0),
            "ustar": ustar,
        }

    def _count(self, fluxes: dict[str, Floats], flux: Floats, heat: Floats) -> None:
        area = self.grid.arrays.area[self.grid.domain] * self.ocean_step
        came, came_heat = float((flux * area).sum()), float(((heat - LATENT_HEAT * flux) * area).sum())
        went = float(((fluxes["melt"] + fluxes["left"]) * area).sum())
        went_heat = float(((fluxes["heat"] + fluxes["left_heat"]) * area).sum())
        for elements, _ in self.departed:
            self._left += stocks(elements)
        self._totals += (came, went, came_heat, went_heat)
        self._keep()

    def _returned(self, fields: dict[str, Floats], by_process: Floats) -> xr.Dataset:
        g = self.grid.arrays
        data: dict[str, Any] = {}
        for name, q in GIVEN.items():
            attributes = {"units": q.units, "long_name": q.meaning}
            attributes |= {"standard_name": name} if q.standard else {}
            data[q.short] = (("j", "i"), fields[q.field], attributes)
        data["ficeberg_process"] = (
            ("process", "j", "i"), by_process, {"units": "kg m-2 s-1", "long_name": "melt water of bergs by process"}
        )  # fmt: skip
        lon, lat = g.lon_centre[self.grid.domain], g.lat_centre[self.grid.domain]
        coordinates = {"process": list(PROCESSES), "lon": (("j", "i"), lon), "lat": (("j", "i"), lat)}
        return xr.Dataset(data, coordinates)

    def _keep(self) -> None:
        """Leave stores and ledger where a restart finds them."""
        memory: dict[str, Floats | None] = {
            "totals": self._totals, "start": self._start, "held": self._held, "left": self._left,
            "settling": self._settling.rest, "handed": self._handed, "corners": _outer_corners(self.grid),
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


def _kept_stores(model: BareModel) -> Stores | None:
    memory = model.remembered
    if STORES + "ice" not in memory:
        return None
    flux, heat = (
        memory[name].copy() if (name := STORES + kind) in memory else None for kind in ("mean_flux", "mean_heat")
    )
    counter = memory[STORES + "counter"].astype(np.int64)
    return Stores(memory[STORES + "ice"].copy(), memory[STORES + "heat"].copy(), counter, flux, heat, begun=True)


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


class Box(Section):
    """Cells of longitude and latitude in a box, as files of couplings give it in their section ``grid``."""

    west: float = key(..., "degree", "western edge", ge=-360, le=360)
    east: float = key(..., "degree", "eastern edge", ge=-360, le=720)
    south: float = key(..., "degree", "southern edge", ge=-90, le=90)
    north: float = key(..., "degree", "northern edge", ge=-90, le=90)
    columns: int = key(..., "", "cells from west to east", ge=1, le=10_000)
    rows: int = key(..., "", "cells from south to north", ge=1, le=10_000)
    edge: Edge = key("open", "", "open: bergs leave over it; closed: a coast")

    def cells(self, **options: Any) -> Grid:
        """Return its grid; options as of `ocean_grid`."""
        if not (self.west < self.east and self.south < self.north):
            raise InputError(
                f"no cells from {self.west:g} to {self.east:g} and {self.south:g} to {self.north:g} degrees", where="grid",
                remedy="Give west below east and south below north",
            )  # fmt: skip
        lon, lat = (
            np.linspace(self.west, self.east, self.columns + 1),
            np.linspace(self.south, self.north, self.rows + 1),
        )
        return ocean_grid(*np.meshgrid(lon, lat), edge=self.edge, **options)


def read_section(kind: type[Kind], values: Any, *, where: str) -> Kind:
    """Return a section of a file; refuse values that cannot be, each by its key."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise explained(error, kind, name=where) from error
