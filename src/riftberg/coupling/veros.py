"""Bergs in the ocean model Veros: the fields that they take from its state, and the sources that they put into it.

Veros (https://veros.readthedocs.io) has a fixed volume: fresh water comes as the salt that it would replace at a salinity of
reference, so that salt, and with it fresh water, can be counted to round-off. Currents, temperature and salinity are means over
the upper ``keel`` metres; melt water, heat and drag go into the same metres.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from riftberg.config.values import number
from riftberg.coupling.exchange import Exchange, ocean_grid
from riftberg.coupling.fields import OceanForcing
from riftberg.errors import InputError
from riftberg.model import BareModel
from riftberg.ocean.grid import Grid
from riftberg.state import Floats

HEAT_CAPACITY: Final = 3991.868
"""Specific heat of sea water of TEOS-10, J kg-1 K-1; Veros itself knows none."""

NEEDED: Final = ("enable_tempsalt_sources", "enable_momentum_sources")
"""Settings of Veros through which bergs give."""

INNER: Final = np.s_[2:-2, 2:-2]
"""Cells of Veros without the two rows of its halo; its arrays are indexed [x, y, z, time]."""


def veros_grid(state: Any) -> Grid:
    """Return the grid of a Veros set-up, with its land, its areas and its period."""
    vs, settings = state.variables, state.settings
    unit = (
        float(settings.degtom) if settings.coord_degree else 1.0
    )  # set_grid gives degrees, setup makes metres of them
    lon, lat = np.meshgrid(_edges(vs.xu, vs.dxt, unit), _edges(vs.yu, vs.dyt, unit))
    period = float(lon[0, -1] - lon[0, 0]) if settings.enable_cyclic_x else None
    return ocean_grid(
        lon, lat, mask=np.asarray(vs.maskT)[..., -1][INNER].T, area=np.asarray(vs.area_t)[INNER].T,
        latlon=bool(settings.coord_degree), period=period, edge="closed",
    )  # fmt: skip


def _edges(ends: Any, lengths: Any, unit: float) -> Floats:
    """Return the edges of the cells along an axis; the halo of a cyclic axis holds the edges of its other end."""
    inner = np.asarray(ends)[2:-2]
    return np.concatenate([[inner[0] - np.asarray(lengths)[2] / unit], inner])


def veros_forcing(state: Any) -> OceanForcing:
    """Return the forcing of a model of bergs in a Veros set-up: its grid and its sea floor; the rest comes by step."""
    grid = veros_grid(state)
    return OceanForcing(grid, grid.fields(depth=np.asarray(state.variables.ht)[INNER].T))


class Stock(NamedTuple):
    """Stocks of bergs and ocean."""

    ice: float  # Of bergs and stores, kg
    fresh_water: float  # Of the ocean above its salinity of reference, kg
    ice_heat: float  # Of the ice, J: it lacks the latent heat
    ocean_heat: float  # Of the water above 0 degree Celsius, J


class Closure(NamedTuple):
    """Balance between the loss of the bergs and the gain of the ocean."""

    water: float  # What left the ice since the start, kg
    heat: float  # The same, J
    # What of it did not arrive, as part of what ice and ocean hold: fresh water of the ocean is counted by its mass of
    # salt
    water_error: float
    heat_error: float


class VerosBergs:
    """Bergs in a Veros set-up: call `step` before each step of the ocean.

    Parameters
    ----------
    state : veros.VerosState
        After ``setup()``, with ``enable_tempsalt_sources`` and ``enable_momentum_sources``.
    model : Model
        Its forcing is `veros_forcing` of the same state.
    keel : float, optional
        Depth (m) of the water that bergs feel and give to; by default the uppermost layer.
    salinity : float, optional
        Salinity of reference (1e-3), of the water that fresh water replaces; the mean of the ocean by default.
    **options
        Of `riftberg.coupling.exchange.Exchange`.

    Raises
    ------
    InputError
        If Veros lacks a setting, or the forcing of the model is not of its grid.

    Examples
    --------
    See docs/howto/coupling-to-veros.md.
    """

    def __init__(
        self, state: Any, model: BareModel, *, keel: float | None = None, salinity: float | None = None, **options: Any
    ) -> None:
        _check(state, model)
        self.state = state
        self.exchange = Exchange(
            model, ocean_step=float(state.settings.dt_tracer), staggering="C", wind_staggering="C", **options
        )
        vs = state.variables
        self._thick = np.asarray(vs.dzt)
        upper = np.asarray(vs.zw)
        reach = float(self._thick[-1]) if keel is None else number(keel, "m", where="VerosBergs, keel")
        if not 0.0 < reach < np.inf:
            raise InputError(f"keel = {keel}", where="VerosBergs", remedy="Give a depth in m, above 0")
        felt = np.clip(reach + upper, 0.0, self._thick)
        # Where water is not as deep as the keel, its layers share among themselves.
        self._parts = {at: _parts(np.asarray(getattr(vs, f"mask{at}"))[INNER], felt) for at in ("T", "U", "V")}
        self._volume = np.asarray(vs.maskT)[INNER] * (np.asarray(vs.area_t)[INNER][..., None] * self._thick)
        self.salinity = (
            self._mean_salinity() if salinity is None else number(salinity, "1e-3", where="VerosBergs, salinity")
        )
        if not 0.0 < self.salinity < np.inf:
            raise InputError(
                f"salinity = {salinity}", where="VerosBergs", remedy="Give the salinity of the ocean, above 0"
            )
        self._start = self.stock()

    def step(self) -> xr.Dataset:
        """Let the bergs take the state of the ocean, move and melt, and put their fluxes into its next step.

        Returns
        -------
        xarray.Dataset
            Fields to the ocean; see `riftberg.coupling.exchange.Exchange.step`.
        """
        given = self.exchange.step(self.taken())
        density = float(self.state.settings.rho_0)
        water = (given["ficeberg"] + given["flandice"]).values.T
        heat = (given["hfibthermds2d"] + given["hflandice"]).values.T
        per_layer = self._parts["T"] / self._thick
        self._put("salt_source", -self.salinity / density * water[..., None] * per_layer)
        self._put("temp_source", heat[..., None] / (density * HEAT_CAPACITY) * per_layer)
        vs = self.state.variables
        for axis, at, name, stress in ((0, "U", "u_source", "ibtaux"), (1, "V", "v_source", "ibtauy")):
            force = given[stress].values.T * np.asarray(vs.area_t)[INNER]
            on_faces = self._on_faces(force, axis, at) / np.asarray(getattr(vs, f"area_{at.lower()}"))[INNER]
            self._put(name, on_faces[..., None] / density * self._parts[at] / self._thick)
        return given

    def taken(self) -> dict[str, Any]:
        """Return the fields from the ocean, by CF name: means over the keel, stress of the wind, and sea level."""
        vs = self.state.variables
        level = int(vs.tau)
        fields = {
            "eastward_sea_water_velocity": self._mean(vs.u, "U", level),
            "northward_sea_water_velocity": self._mean(vs.v, "V", level),
            "sea_surface_temperature": self._mean(vs.temp, "T", level),
            "sea_surface_salinity": self._mean(vs.salt, "T", level),
            "surface_downward_eastward_stress": np.asarray(vs.surface_taux)[INNER].T,
            "surface_downward_northward_stress": np.asarray(vs.surface_tauy)[INNER].T,
        }
        if not self.state.settings.enable_streamfunction:
            fields["sea_surface_height_above_geoid"] = np.asarray(vs.ssh)[INNER].T
        return fields

    def stock(self) -> Stock:
        """Return the stocks of bergs and ocean."""
        vs, density = self.state.variables, float(self.state.settings.rho_0)
        level = int(vs.tau)
        salt, temperature = (np.asarray(field)[INNER][..., level] for field in (vs.salt, vs.temp))
        fresh = float((self._volume * (self.salinity - salt)).sum()) * density / self.salinity
        heat = float((self._volume * temperature).sum()) * density * HEAT_CAPACITY
        ice, ice_heat = self.exchange.stocks()
        return Stock(ice, fresh, ice_heat, heat)

    def closure(self) -> Closure:
        """Return the loss of the ice since the start, and the part that did not arrive; after a step of the ocean."""
        start, end = self._start, self.stock()
        density = float(self.state.settings.rho_0)
        all_water = float(self._volume.sum()) * density
        lost = (end.ice - start.ice) + (end.fresh_water - start.fresh_water)
        heat_lost = (end.ice_heat - start.ice_heat) + (end.ocean_heat - start.ocean_heat)
        scale = max(abs(start.ice_heat), abs(end.ocean_heat))
        return Closure(
            start.ice - end.ice, start.ice_heat - end.ice_heat, lost / (start.ice + all_water), heat_lost / scale
        )

    def _mean_salinity(self) -> float:
        salt = np.asarray(self.state.variables.salt)[INNER][..., int(self.state.variables.tau)]
        return float((self._volume * salt).sum() / self._volume.sum())

    def _mean(self, field: Any, at: str, level: int) -> Floats:
        """Mean over the keel, [y, x]."""
        return np.asarray((self._parts[at] * np.asarray(field)[INNER][..., level]).sum(axis=-1)).T

    def _on_faces(self, force: Floats, axis: int, at: str) -> Floats:
        """Share the force on each cell among its open faces of an axis; none is lost but in a cell without any."""
        mask = np.asarray(getattr(self.state.variables, f"mask{at}"), dtype=float)[..., -1]  # true + true is not 2
        after, behind = mask[INNER], mask[1:-3, 2:-2] if axis == 0 else mask[2:-2, 1:-3]
        share = force / np.maximum(after + behind, 1.0)
        # The face before the first cell is that behind the last one, or shut.
        return np.asarray(share * after + np.roll(share * behind, -1, axis=axis))

    def _put(self, name: str, values: Floats) -> None:
        vs = self.state.variables
        field = np.array(getattr(vs, name))
        field[INNER] = values
        with vs.unlock():
            setattr(vs, name, field)


def _parts(mask: Floats, felt: Floats) -> Floats:
    """Part of the keel in each layer, [x, y, z]; 0 on land."""
    wet = mask * felt
    total = wet.sum(axis=-1, keepdims=True)
    return np.asarray(np.divide(wet, total, out=np.zeros_like(wet), where=total > 0.0))


def _check(state: Any, model: BareModel) -> None:
    missing = [name for name in NEEDED if not getattr(state.settings, name)]
    if missing:
        raise InputError(
            f"{' and '.join(missing)} is off", where="VerosBergs",
            remedy=f"In set_parameter: {'; '.join(f'settings.{name} = True' for name in missing)}",
        )  # fmt: skip
    grid = model.forcing.grid
    shape = np.asarray(state.variables.maskT)[INNER].shape[1::-1]
    if not isinstance(model.forcing, OceanForcing) or grid is None or (grid.arrays.nj, grid.arrays.ni) != shape:
        raise InputError(
            "the forcing of the model is not of the grid of Veros", where="VerosBergs",
            remedy="Make the model with veros_forcing(state)",
        )  # fmt: skip
