"""Fluxes from bergs to the ocean, on cells: monthly means and moments of a run as CF files, conserving to round-off.

Names follow CMIP and the exchange (`riftberg.coupling.fields.GIVEN`): ``ficeberg`` is the fresh water,
``hfibthermds2d`` the heat that it takes, latent heat above all.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from riftberg.config.values import number
from riftberg.constants import LATENT_HEAT
from riftberg.coupling.exchange import ocean_grid
from riftberg.coupling.fields import GIVEN
from riftberg.coupling.shelf import Shares, compute_shares
from riftberg.errors import InputError
from riftberg.life.ledger import PROCESSES, scaled_mass
from riftberg.life.process import LifeModel
from riftberg.model import BareModel
from riftberg.ocean.cells import locate_points
from riftberg.ocean.grid import Grid
from riftberg.runs.layout import time_units
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import summed
from riftberg.system.netcdf_lock import write_dataset
from riftberg.version import __version__

MASS: Final = len(PROCESSES)
HEAT: Final = MASS + 1
AREA: Final = HEAT + 1
ROWS: Final = AREA + 1
"""Rows of a sum: melt water by process (kg), then mass (kg s), heat (J) and area (m2 s)."""

MOST_LATITUDE: Final = 88.0
"""Cells of `make_cells` end here: nearer to the pole they have no width."""


def make_cells(width: float) -> Grid:
    """Return cells of this width (degrees) around the Earth, joined at the date line."""
    width = number(width, "degree", where="cells")
    count = round(360.0 / width) if 1e-3 < width <= 10.0 else 0
    if not count or abs(count * width - 360.0) > 1e-6:
        raise InputError(
            f"cells of {width:g} degrees",
            where="cells",
            remedy="Give a width that divides 360, from 0.01 to 10 degrees",
        )
    rows = math.floor(MOST_LATITUDE / width)
    lon, lat = np.meshgrid(np.arange(count + 1) * width - 180.0, np.arange(-rows, rows + 1) * width)
    return ocean_grid(lon, lat)


class _Sums(NamedTuple):
    """Sums in the cells that bergs have touched, [row, cell]; most cells of a grid never see one."""

    cells: Ints
    rows: Floats

    def added(self, cells: Ints, rows: Floats) -> _Sums:
        """Return these sums with amounts added, in a fixed order."""
        return _Sums(*summed(self.cells, self.rows, cells, rows))


class _Span(NamedTuple):
    """Fluxes between two moments, and stocks (kg, m2)."""

    since: datetime
    end: datetime
    sums: _Sums
    state: _Sums

    @property
    def seconds(self) -> float:
        return (self.end - self.since).total_seconds()


def _nothing(rows: int) -> _Sums:
    return _Sums(np.zeros(0, np.int64), np.zeros((rows, 0)))


class GridRecorder:
    """Recorder of a run: gathers on cells the fluxes of the bergs, and writes them at the end.

    A restart keeps the sums of the month and of the time since the last moment, so that a resumed run goes on with both: its
    files hold the months and moments that end in it, as the run that never stopped has them; with ``goes_on`` those from
    before too.

    Parameters
    ----------
    path : path
        Folder, or file name to which ``-monthly.nc`` and ``-instantaneous.nc`` are added.
    grid : Grid or float
        Cells (`riftberg.coupling.exchange.ocean_grid`), or their width in degrees.
    every_hours : float, optional
        Time between moments; fluxes of a moment are means since the one before.
    goes_on : bool, optional
        Write the months and moments from before the restart too.

    Examples
    --------
    >>> from riftberg import Forcing, Iceberg, Model, Parameters
    >>> berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    >>> model = Model(berg, Forcing.uniform(temperature=2.0, salinity=34.0), Parameters(melt={"enabled": True}))
    >>> recorder = GridRecorder("somewhere/fields", 0.25, every_hours=24.0)
    >>> recorder.names()
    ('fields-monthly.nc', 'fields-instantaneous.nc')
    """

    def __init__(
        self, path: str | Path, grid: Grid | float, *, every_hours: float = 24.0, goes_on: bool = False
    ) -> None:
        self.path, self.goes_on = Path(path), goes_on
        self.grid = grid if isinstance(grid, Grid) else make_cells(grid)
        self.every = timedelta(hours=number(every_hours, "h", where="every_hours"))
        if self.every <= timedelta(0):
            raise InputError(f"a moment every {every_hours:g} h", where="every_hours", remedy="Give hours above 0")
        self._month = self._passed = _nothing(ROWS)
        self._month_began = self._passed_began = datetime.min
        self._months: list[_Span] = []
        self._moments: list[_Span] = []
        self._seen: tuple[Shares, Floats] | None = None
        self._before: Callable[[LifeModel], None] | None = None
        self._times = self._sums = ""
        self._kept = -1

    def names(self) -> tuple[str, str]:
        """Return the names of the two files."""
        return f"{self.path.name}-monthly.nc", f"{self.path.name}-instantaneous.nc"

    def start(self, model: BareModel) -> None:
        """Begin; look at the bergs between their motion and their melt from now on."""
        if model.parameters.earth.latlon != self.grid.arrays.latlon:
            raise InputError(
                "cells and bergs are not both in degrees, or both in metres", where="gridded output",
                remedy="Give a grid in the coordinates of the run: riftberg.coupling.exchange.ocean_grid(..., latlon=...)",
            )  # fmt: skip
        self._month_began = self._passed_began = model.date
        self._take_up(model)
        life = model.life
        if life is None:
            return
        # An exchange may look there too; it comes first, and gets its place back at the end.
        previous = self._before = life.look_around

        def look(living: LifeModel) -> None:
            if previous is not None:
                previous(living)
            self._look(model)

        life.look_around = look

    def record(self, model: BareModel) -> None:
        """Add a long step."""
        if self._seen is None:
            self._look(model)
        assert self._seen is not None
        shares, stock = self._seen
        dt, amounts = model.parameters.time_step, np.zeros((ROWS, stock.shape[1]))
        amounts[[MASS, AREA]] = stock * dt
        last = model.life.last if model.life is not None else None
        if last is not None:
            amounts[:MASS] = last.water
            amounts[HEAT] = last.melt.water * (last.melt.heat_density - LATENT_HEAT)
        cells, rows = shares.cells, _shared(shares, amounts)
        self._seen = None
        # A step counts to the month in which it began.
        began = model.date - timedelta(seconds=model.parameters.time_step)
        if (began.year, began.month) != (self._month_began.year, self._month_began.month):
            self._end_month(began)
        self._month, self._passed = self._month.added(cells, rows), self._passed.added(cells, rows)
        # A millisecond is allowed: dates are whole microseconds, time steps need not be.
        if model.date - self._passed_began >= self.every - timedelta(milliseconds=1):
            self._moments.append(_Span(self._passed_began, model.date, self._passed, self._state(model)))
            self._passed, self._passed_began = _nothing(ROWS), model.date
        self._remember(model)

    def _key(self, name: str) -> str:
        """Name under which a restart keeps sums on these cells."""
        corners = self.grid.arrays.lon.tobytes() + self.grid.arrays.lat.tobytes()
        return f"gridded_{zlib.crc32(corners)}_every_{self.every.total_seconds():g}_s_{name}"

    def _remember(self, model: BareModel) -> None:
        """Leave with the model the sums of the month and since the last moment, for a run that goes on from here."""
        memory = model.remembered
        began = [(moment - model.start).total_seconds() for moment in (self._month_began, self._passed_began)]
        memory[self._times] = np.array([model.time, *began])
        for name, sums in (("month", self._month), ("passed", self._passed)):
            memory[f"{self._sums}_{name}_cells"] = sums.cells.astype(float)
            memory[f"{self._sums}_{name}_rows"] = sums.rows
        spans = [*((0, span) for span in self._months), *((1, span) for span in self._moments)]
        # Spans that have ended do not change, and copying all of them in every step would cost more and more.
        if len(spans) == self._kept:
            return
        self._kept = len(spans)
        tables = [table for _, span in spans for table in (span.sums, span.state)]
        memory[f"{self._sums}_spans"] = np.array(
            [[kind, *((moment - model.start).total_seconds() for moment in span[:2]), *(len(p.cells) for p in span[2:])]
             for kind, span in spans], float,
        ).reshape(-1, 5)  # fmt: skip
        memory[f"{self._sums}_spans_cells"] = np.concatenate([np.zeros(0), *(table.cells for table in tables)])
        memory[f"{self._sums}_spans_values"] = np.concatenate([np.zeros(0), *(table.rows.ravel() for table in tables)])

    def _take_up(self, model: BareModel) -> None:
        """Go on with the month and the time to the next moment of the run that stopped here."""
        self._times, self._sums = self._key("times"), self._key("sums")
        memory = model.remembered
        saved_time, month, passed = memory.get(self._times, np.full(3, np.nan)).tolist()
        if saved_time != model.time:
            if self.goes_on:
                raise InputError(
                    "the run had no output on these cells", where="gridded output", remedy="Leave --cells as it was"
                )
            return
        cells = self.grid.arrays.area.size
        for name in (f"{self._sums}_{period}" for period in ("month", "passed")):
            touched, rows = memory.get(f"{name}_cells"), memory.get(f"{name}_rows")
            if touched is None or rows is None or rows.shape != (ROWS, touched.size) or (touched >= cells).any():
                raise InputError(
                    f"sums that do not fit the {cells} cells of the output", where=f"restart file, extra/{name}_cells",
                    remedy="The file is damaged: resume from another restart",
                )  # fmt: skip
        self._month_began, self._passed_began = (model.start + timedelta(seconds=s) for s in (month, passed))
        self._month, self._passed = (
            _Sums(memory[f"{self._sums}_{name}_cells"].astype(np.int64), memory[f"{self._sums}_{name}_rows"])
            for name in ("month", "passed")
        )
        if self.goes_on:
            self._take_up_spans(model)

    def _take_up_spans(self, model: BareModel) -> None:
        """Take up the months and moments that ended before."""
        name = f"{self._sums}_spans"
        table, cells, values = (
            model.remembered.get(key, np.zeros((0, 5))) for key in (name, f"{name}_cells", f"{name}_values")
        )
        counts = table[:, 3:].astype(np.int64)
        if (counts < 0).any() or cells.size != counts.sum() or values.size != (counts @ [ROWS, 2]).sum():
            raise InputError(
                "months and moments that are not whole", where=f"restart file, extra/{name}",
                remedy="The file is damaged: resume from another restart",
            )  # fmt: skip
        for (kind, since, end), sizes in zip(table[:, :3].tolist(), counts.tolist(), strict=True):
            pair = []
            for size, rows in zip(sizes, (ROWS, 2), strict=True):
                pair.append(_Sums(cells[:size].astype(np.int64), values[: rows * size].reshape(rows, size)))
                cells, values = cells[size:], values[rows * size :]
            began, ended = (model.start + timedelta(seconds=moment) for moment in (since, end))
            (self._moments if kind else self._months).append(_Span(began, ended, pair[0], pair[1]))

    def finish(self, model: BareModel) -> None:
        """Write both files; nothing where no step was taken."""
        if model.life is not None:
            model.life.look_around = self._before
        if model.date > self._month_began:
            self._end_month(model.date)
        for name, dataset in zip(self.names(), (self.monthly(), self.moments()), strict=True):
            if dataset.sizes["time"]:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                write_dataset(dataset, self.path.with_name(name))

    def monthly(self) -> xr.Dataset:
        """Return means by month; the first and the last may be cut off by the run, as their bounds say."""
        return self._dataset(self._months, "mean")

    def moments(self) -> xr.Dataset:
        """Return mass and area at moments, and fluxes as means since the moment before."""
        return self._dataset(self._moments, "point")

    def _end_month(self, end: datetime) -> None:
        seconds = (end - self._month_began).total_seconds()
        state = _Sums(self._month.cells, self._month.rows[[MASS, AREA]] / seconds)
        self._months.append(_Span(self._month_began, end, self._month, state))
        self._month, self._month_began = _nothing(ROWS), end

    def _look(self, model: BareModel) -> None:
        elements = self._placed(model)
        self._seen = compute_shares(elements, model.bonds, self.grid, model.parameters), _stock(elements)

    def _placed(self, model: BareModel) -> Elements:
        """Return the elements with their cells of this grid; on the forcing's own grid they are known."""
        elements = model.elements
        if self.grid is model.forcing.grid and (elements.place.cell_i >= 0).all():
            return self._unwrapped(elements)
        count = elements.size
        i, j = np.zeros(count, np.int64), np.zeros(count, np.int64)
        lon, lat, g = elements.place.lon, elements.place.lat, self.grid.arrays
        locate_points(lon, lat, g, True, i, j, np.zeros(count), np.zeros(count))
        if (i < 0).any():
            row = int(np.flatnonzero(i < 0)[0])
            raise InputError(
                f"element {elements.body.id[row]} at ({lon[row]:.6g}, {lat[row]:.6g}) is outside the cells",
                where="gridded output", remedy="Give a grid that holds all bergs of the run",
            )  # fmt: skip
        return self._unwrapped(elements.replaced(cell_i=i, cell_j=j))

    def _unwrapped(self, elements: Elements) -> Elements:
        """Return the elements with the longitudes that lie in their cells."""
        g, place = self.grid.arrays, elements.place
        if g.period <= 0.0:
            return elements
        turns = np.round((place.lon - g.lon_centre[place.cell_j, place.cell_i]) / g.period) * g.period
        return elements.replaced(lon=place.lon - turns)

    def _state(self, model: BareModel) -> _Sums:
        elements = self._placed(model)
        shares = compute_shares(elements, model.bonds, self.grid, model.parameters)
        return _nothing(2).added(shares.cells, _shared(shares, _stock(elements)))

    def _box(self, spans: list[_Span]) -> tuple[slice, slice]:
        """Return rows and columns with bergs, and one more on each side."""
        g = self.grid.arrays
        touched = np.concatenate([np.zeros(0, np.int64), *(sums.cells for s in spans for sums in (s.sums, s.state))])
        j, i = np.divmod(np.unique(touched), g.area.shape[1])
        if not j.size:
            return np.s_[g.halo : g.halo + 1, g.halo : g.halo + 1]
        low, high = g.halo, (g.halo + g.nj, g.halo + g.ni)
        rows, columns = (
            slice(max(int(k.min()) - 1, low), min(int(k.max()) + 2, most)) for k, most in zip((j, i), high, strict=True)
        )
        return rows, columns

    def _cells(self, sums: _Sums, box: tuple[slice, slice]) -> Floats:
        """Return sums per area on a box of cells, [row, j, i]."""
        area = self.grid.arrays.area
        out = np.zeros((len(sums.rows), area[box].size))
        j, i = np.divmod(sums.cells, area.shape[1])
        out[:, (j - box[0].start) * area[box].shape[1] + i - box[1].start] = sums.rows
        return out.reshape(-1, *area[box].shape) / area[box]

    def _dataset(self, spans: list[_Span], how: str) -> xr.Dataset:
        box = self._box(spans)
        shape = self.grid.arrays.area[box].shape
        flux = np.array([self._cells(s.sums, box) / s.seconds for s in spans]).reshape(-1, ROWS, *shape)
        states = np.array([self._cells(s.state, box) for s in spans]).reshape(-1, 2, *shape)
        mean, state = "area: time: mean", f"area: mean time: {how}"
        data: dict[str, Any] = {
            "ficeberg": _variable(flux[:, :MASS].sum(axis=1), "water_flux_into_sea_water_from_icebergs", mean),
            "hfibthermds2d": _variable(
                flux[:, HEAT], "heat_flux_into_sea_water_due_to_iceberg_thermodynamics", mean
            ),
            "ibmass": _variable(states[:, 0], "iceberg_mass_on_sea_water", state, "mass of bergs, also of those aground"),
            "ibarea": _variable(states[:, 1], "iceberg_area_fraction", state),
            "ficeberg_process": (
                ("time", "process", "j", "i"), flux[:, :MASS],
                {"units": "kg m-2 s-1", "long_name": "melt water of bergs by process", "cell_methods": mean},
            ),
        }  # fmt: skip
        g = self.grid.arrays
        bounds = np.array([[s.since, s.end] for s in spans], dtype="datetime64[us]").reshape(-1, 2)
        time = bounds[:, 1] if how == "point" else bounds[:, 0] + (bounds[:, 1] - bounds[:, 0]) // 2
        units = ("degrees_east", "degrees_north") if g.latlon else ("m", "m")
        names = ("longitude", "latitude") if g.latlon else ("projection_x_coordinate", "projection_y_coordinate")
        coordinates = {
            "time": ("time", time, {"standard_name": "time", "bounds": "time_bnds"}),
            "time_bnds": (("time", "bnds"), bounds),
            "lon": (("j", "i"), g.lon_centre[box], {"units": units[0], "standard_name": names[0]}),
            "lat": (("j", "i"), g.lat_centre[box], {"units": units[1], "standard_name": names[1]}),
            "areacello": (("j", "i"), g.area[box], {"units": "m2", "standard_name": "cell_area"}),
            "process": ("process", list(PROCESSES), {"long_name": "way in which ice becomes melt water"}),
        }
        dataset = xr.Dataset(data, coordinates, {
            "Conventions": "CF-1.11", "title": "What icebergs give to the ocean", "source": f"riftberg {__version__}",
            "comment": "The sum over cells of a field times areacello is that over all bergs.",
        })  # fmt: skip
        began = spans[0].since if spans else datetime(2000, 1, 1)
        for name in ("time", "time_bnds"):
            dataset[name].encoding = {**time_units(began), "dtype": "float64"}
        for name in data:
            dataset[name].encoding = {"zlib": True}
        return dataset


def _variable(values: Floats, name: str, how: str, meaning: str | None = None) -> tuple[Any, ...]:
    q = GIVEN[name]
    attributes = {
        "units": q.units,
        "long_name": meaning or q.meaning,
        "cell_methods": how,
        "cell_measures": "area: areacello",
    }
    return ("time", "j", "i"), values, {**attributes, **({"standard_name": name} if q.standard else {})}


def _stock(elements: Elements) -> Floats:
    """Return ice (kg) with all bits, and plan area (m2), of all bergs that each element stands for."""
    body, life = elements.body, elements.life
    return np.stack([scaled_mass(life, body.mass), body.length * body.width * life.mass_scaling])


def _shared(shares: Shares, amounts: Floats) -> Floats:
    """Return the part of each amount, [row, element], that each pair of element and cell has."""
    return np.asarray(np.repeat(amounts, np.diff(shares.first), axis=1) * shares.shares)
