"""Bergs as a component of the coupler YAC (Hanke et al. 2016, doi:10.5194/gmd-9-2755-2016), beside an ocean of any grid.

Needs the extra ``yac``. One rank holds all bergs, on rows of longitude and latitude of their own; YAC interpolates between
these and the grid of the ocean, on however many ranks it runs.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
import yaml
from pydantic import model_validator

from riftberg.config.values import Section, UnfitError, key, moment
from riftberg.coupling.exchange import Exchange
from riftberg.coupling.fields import GIVEN, TAKEN, OceanForcing
from riftberg.coupling.sections import Box, read_section
from riftberg.errors import InputError, RiftbergError
from riftberg.model import BareModel, Recorder
from riftberg.ocean.forcing import Forcing
from riftberg.ocean.needs import DEPTH
from riftberg.parameters import Parameters
from riftberg.physics.floating import draft_of
from riftberg.products.quantities import unit_change
from riftberg.state import Floats
from riftberg.system.input_files import MOST_YAML, check_file, needed, reading, value_shown
from riftberg.system.process import say

_LOG = logging.getLogger(__name__)

LAST_GIVEN: Final = "yac_given"  # Name under which a restart keeps what the bergs gave last
ROUND_OFF: Final = 1e-6  # Up to which corners stand in one row or column, degrees, and their axes point east: 0.1 m


class YacSettings(Section):
    """Section ``riftberg`` of a coupling file, which YAC itself passes over."""

    component: str = key("riftberg", "", "name of the component; its grid is called the same with _grid", min_length=1)
    grid: Box | None = None
    step: float | None = key(None, "s", "step of the exchange, whole long steps; one by default", gt=0)
    wait: float = key(600.0, "s", "how long to wait for the ocean", gt=0, le=1e6)
    levels: list[float] = key([], "m", "edges of the layers of currents by depth, from 0 downwards")

    @model_validator(mode="after")
    def _downwards(self) -> YacSettings:
        if self.levels and (len(self.levels) < 2 or self.levels[0] != 0.0 or np.diff(self.levels).min() <= 0.0):
            raise UnfitError(f"levels are {self.levels}", "Give edges of layers from 0 downwards, such as [0, 10, 50]")
        return self


class Coupling(NamedTuple):
    """Settings of a coupling file that concern the bergs."""

    path: Path
    start: datetime
    end: datetime
    settings: YacSettings


def read_coupling(path: str | Path) -> Coupling:
    """Read a configuration file of YAC with its section ``riftberg``; refuse a file without dates, or with another calendar."""
    path = Path(path)
    check_file(path, most=MOST_YAML, remedy="Name the coupling file of YAC")
    with reading(path, "cannot be read", "Write it as YAML"):
        settings = yaml.safe_load(path.read_text("utf-8"))
    settings = settings if isinstance(settings, dict) else {}
    for name, form in (("calendar", "proleptic-gregorian"), ("start_date", "2020-12-09"), ("end_date", "2020-12-31")):
        if name not in settings:
            raise InputError(f"no {name}", where=str(path), remedy=f"Write it, such as {name}: {form}")
    if str(settings["calendar"]).lower() != "proleptic-gregorian":
        raise InputError(
            f"calendar {value_shown(settings['calendar'])}", where=str(path),
            remedy="Write calendar: proleptic-gregorian, for all components: bergs have real dates",
        )  # fmt: skip
    start, end = (moment(settings[name], where=f"{path}, {name}") for name in ("start_date", "end_date"))
    return Coupling(
        path, start, end, read_section(YacSettings, settings.get("riftberg", {}), where=f"{path}, riftberg")
    )


def ocean_beside(forcing: Forcing, coupling: Coupling, parameters: Parameters) -> OceanForcing:
    """Return the forcing on the grid of a coupling file: sea floor and land of another one; the coupler gives the rest."""
    box = coupling.settings.grid
    if box is None or not parameters.earth.latlon:
        raise InputError(
            "no grid of longitude and latitude", where=f"{coupling.path}, riftberg.grid",
            remedy="Write grid: {west: -40, east: -36, south: -58, north: -55, columns: 16, rows: 12}, and bergs in degrees",
        )  # fmt: skip
    cells = box.cells(radius_for_metrics=parameters.earth.radius)
    depth = forcing.depth(cells.arrays.lon_centre[cells.domain], cells.arrays.lat_centre[cells.domain])
    if np.isnan(depth).all():  # it knows no floor at all, and so no land
        return OceanForcing(cells, cells.fields())
    depth = np.clip(np.nan_to_num(depth), 0.0, DEPTH.default)
    grid = box.cells(radius_for_metrics=parameters.earth.radius, mask=depth > 0.0)
    return OceanForcing(grid, grid.fields(depth=depth))


_WATCHER: Final = """
import os, select, signal, sys
limit, text = None, ""
while select.select([0], [], [], limit)[0]:
    lines = os.read(0, 65536).decode().splitlines()
    if not lines:
        sys.exit()
    seconds, _, text = lines[-1].partition(" ")
    limit = float(seconds) or None
print(text, file=sys.stderr, flush=True)
os.kill(int(sys.argv[1]), signal.SIGKILL)
"""
"""Program beside the bergs: while the coupler waits in C, no thread and no signal handler of Python would have its turn."""


class _Watch:
    """Ends this rank, and with it all, where a wait takes longer than a limit (s)."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        program = [sys.executable, "-I", "-S", "-c", _WATCHER, str(os.getpid())]
        self._process = subprocess.Popen(program, stdin=subprocess.PIPE)

    @contextmanager
    def waiting(self, awaited: str) -> Iterator[None]:
        """Wait in this block for something, named in the message."""
        remedy = "See the log of the partner, which must put before it gets; or set riftberg.wait in the coupling file"
        self._tell(f"{self.limit} Error: waited {self.limit:g} s for {awaited}. {remedy}")
        try:
            yield
        finally:
            self._tell("0 ")

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """Let the program beside end."""
        self._process.communicate()


@contextmanager
def ending_all_ranks() -> Iterator[None]:
    """End all ranks where this block fails, with its error: the others would wait for this one for ever."""
    try:
        yield
    except BaseException as error:
        mpi = sys.modules.get("mpi4py.MPI")
        if mpi is None or mpi.COMM_WORLD.size == 1:
            raise
        if isinstance(error, RiftbergError):
            say(f"Error: {error}")
        elif not hasattr(error, "exit_code"):  # of a command, which has said why
            traceback.print_exc()
        mpi.COMM_WORLD.Abort(2)


class _Port(NamedTuple):
    """A field that is coupled."""

    name: str
    field: Any  # Of YAC
    partners: str
    factor: float  # Units of what is taken, or given, are turned by factor and offset
    offset: float


class YacComponent:
    """Bergs as a component of YAC; to be used inside of `ending_all_ranks`.

    Its fields are listed in `riftberg.coupling.fields.TAKEN` and `GIVEN`, with names and units as metadata; it exchanges the
    fields that the coupling file names. Units that a partner states in its own metadata (``units: K``) are converted.

    Parameters
    ----------
    model : BareModel
        On rows of longitude and latitude (`OceanForcing`). Areas of their cells are taken from the coupler, times its radius
        squared.
    coupling : Coupling
        See `read_coupling`.
    **options
        Of `riftberg.coupling.exchange.Exchange`: ``calving``, ``settling_time``.

    Attributes
    ----------
    exchange : Exchange
        The exchange behind it, with its ledger.
    taken : dict of str to (array, str)
        Last fields from the ocean, by name, and their units.

    Raises
    ------
    InputError
        If dates, lags or units do not fit, or nothing is coupled.
    """

    def __init__(self, model: BareModel, coupling: Coupling, **options: Any) -> None:
        self.exchange = Exchange(model, coupling.settings.step, staggering="A", **options)
        self.coupling = coupling
        self.taken: dict[str, tuple[Floats, str]] = {}
        self._own = coupling.settings.component, f"{coupling.settings.component}_grid"
        lon, lat = self._checked()
        self._watch = _Watch(coupling.settings.wait)
        with self._watch.waiting("all components to begin"):
            needed("mpi4py.MPI", "the coupler needs it", "yac")  # YAC finds the library of MPI that this has loaded
            self._yac = needed("yac", "coupling needs it", "yac")
            self._coupler = self._yac.YAC()
            self._coupler.read_config_yaml(str(coupling.path))
            self._component = self._coupler.def_comp(self._own[0])
        if self._component.size > 1:
            raise InputError(
                f"{self._component.size} ranks are {self._own[0]}", where=str(coupling.path),
                remedy="Run bergs on one rank; give a second run its own riftberg.component in its own coupling file",
            )  # fmt: skip
        fields = self._defined(lon, lat)
        with self._watch.waiting("the definitions of all components"):
            self._coupler.enddef()
        roles = {"TARGET": TAKEN, "SOURCE": GIVEN}
        ports = [self._port(name, field) for name, field in fields.items() if name in roles.get(field.role.name, ())]
        if not ports:
            raise InputError(
                f"nothing is coupled with {self._own[0]}", where=str(coupling.path),
                remedy=f"Name it in the list coupling, with the grid {self._own[1]} and fields such as {next(iter(TAKEN))}",
            )  # fmt: skip
        self._inward = [port for port in ports if port.name in TAKEN]
        self._outward = {
            lag: [port for port in ports if port.name in GIVEN and self._lag(port) == lag] for lag in (0, 1)
        }
        self._meet()  # before the first record, and before bergs at their start look around
        self.exchange.show(self.taken)
        self._met = True

    def run(self, recorders: Sequence[Recorder] = ()) -> None:
        """Run to the end date of the coupling, calling the recorders after each exchange."""
        seconds = (self.coupling.end - self.coupling.start).total_seconds()
        self.exchange.model.advance(seconds / 86400.0, recorders=recorders, step=self.step)

    def step(self) -> xr.Dataset:
        """Take one step with the ocean; return the fields to it (see `riftberg.coupling.exchange.Exchange.step`)."""
        if not self._met:
            self._meet()
        self._met = False
        given, memory = self.exchange.step(self.taken), self.exchange.model.remembered
        memory[LAST_GIVEN] = np.stack([given[quantity.short].values for quantity in GIVEN.values()])
        self._put(1, memory[LAST_GIVEN])
        return given

    def _meet(self) -> None:
        """Exchange the fields with the date at which a step begins."""
        # Dates decide: without a lag the ocean gets at a date what bergs gave in the step before, and both run at once; with a
        # lag of one step, whose date is the end of this step, it waits for what they give in it.
        arrays = self.exchange.grid.arrays
        zero = np.zeros((len(GIVEN), arrays.nj, arrays.ni))
        self._put(0, self.exchange.model.remembered.get(LAST_GIVEN, zero))
        for port in self._inward:
            self._get(port)

    def close(self) -> None:
        """Leave the coupler."""
        for port in self._inward:
            if port.field.action == self._yac.Action.NONE:  # the next run begins with an exchange of all fields
                _LOG.warning(
                    "the run ends between two dates of %s: runs that go on from here meet other values than one in one go. "
                    "End it at whole coupling periods", port.name,
                )  # fmt: skip
        self._coupler.cleanup()
        self._watch.close()

    def _checked(self) -> tuple[Floats, Floats]:
        """Return the edges of columns and rows, degrees; refuse an exchange that does not fit the coupling."""
        exchange, (path, start, end, _) = self.exchange, self.coupling
        g = exchange.grid.arrays
        corners = np.s_[g.halo - 1 : g.halo + g.nj, g.halo - 1 : g.halo + g.ni]
        lon, lat = g.lon[corners], g.lat[corners]
        bent = max(np.ptp(lon, axis=0).max(), np.ptp(lat, axis=1).max())
        if not g.latlon or bent > ROUND_OFF or (np.abs(g.sin_angle) > ROUND_OFF).any() or (g.cos_angle < 0.0).any():
            raise InputError("no rows of longitude and latitude", where="YacComponent, grid of the exchange",
                             remedy="Exchange on these; the ocean may have any grid")  # fmt: skip
        if abs((start - exchange.model.date).total_seconds()) > 1e-3:
            raise InputError(
                f"the coupling starts at {start}, the bergs stand at {exchange.model.date}", where=f"{path}, start_date",
                remedy="Start at the date of the experiment, or of the restart",
            )  # fmt: skip
        steps = (end - start).total_seconds() / exchange.ocean_step
        if steps < 1.0 or abs(steps - round(steps)) > 1e-9 * steps:
            raise InputError(f"{start} to {end} is {steps:g} steps of {exchange.ocean_step:g} s", where=f"{path}, end_date",
                             remedy="Give a date that whole steps of the exchange (riftberg.step) lead to")  # fmt: skip
        return lon[0], lat[:, 0]

    def _defined(self, lon: Floats, lat: Floats) -> dict[str, Any]:
        """Define grid and fields; return the fields of YAC by name."""
        yac, grid, g = self._yac, self.exchange.grid, self.exchange.grid.arrays
        joined = bool(g.cyclic)
        cells = yac.Reg2dGrid(self._own[1], np.radians(lon[:-1] if joined else lon), np.radians(lat), [joined, False])
        areas = np.reshape(cells.compute_grid_cell_areas(), (g.nj, g.ni)) * grid.earth_radius**2
        g.area[:] = grid.extended(areas)  # what the coupler sums up is then what bergs give
        middle = [np.radians(0.5 * (edges[1:] + edges[:-1])) for edges in (lon, lat)]
        at_sea, everywhere = (cells.def_points(yac.Location.CELL, *middle, name=name) for name in ("sea", "all"))
        # Bergs give nothing on land, but with cells left out the coupler would leave out those of the ocean beside them.
        at_sea.set_mask((g.mask[grid.domain] >= 0.5).astype(np.intc).ravel())
        step, layers = str(round(1000.0 * self.exchange.ocean_step)), max(len(self.coupling.settings.levels) - 1, 1)
        fields = {}
        for name, quantity in {**TAKEN, **GIVEN}.items():
            points, size = at_sea if name in TAKEN else everywhere, layers if name.endswith("sea_water_velocity") else 1
            fields[name] = yac.Field.create(name, self._component, points, size, step, yac.TimeUnit.MILLISECOND)
            standard = {"standard_name": name} if quantity.standard else {}
            text = yaml.safe_dump({**standard, "units": quantity.units, "long_name": quantity.meaning})
            self._coupler.def_field_metadata(*self._own, name, text.encode())
        return fields

    def _port(self, name: str, field: Any) -> _Port:
        """Return a coupled field with the change of units between its partners and here."""
        coupler, units, field_id = self._coupler, {**TAKEN, **GIVEN}[name].units, (*self._own, name)
        if name in TAKEN:
            partners = [tuple(coupler.get_field_source(*field_id))]
        else:
            others = [(c, g, f) for c in coupler.component_names for g in coupler.get_comp_grid_names(c)
                      for f in coupler.get_field_names(c, g)]  # fmt: skip
            targets = [other for other in others if coupler.get_field_role(*other) == self._yac.ExchangeType.TARGET]
            partners = [target for target in targets if tuple(coupler.get_field_source(*target)) == field_id]
        stated = {_units(coupler.get_field_metadata(*partner)) or units for partner in partners}
        change = unit_change(stated.pop(), units) if len(stated) == 1 else None
        if change is None:
            raise InputError(
                f"{' and '.join('.'.join(partner) for partner in partners)}: units are not those of {units!r}, or differ",
                where=f"{self.coupling.path}, {name}", remedy=f"Let the partner hand over, or take, {units}, and declare it",
            )  # fmt: skip
        factor, offset = change if name in TAKEN else (1.0 / change[0], -change[1] / change[0])
        return _Port(name, field, " and ".join(partner[0] for partner in partners), factor, offset)

    def _lag(self, port: _Port) -> int:
        """Return by how many steps the first date of a field lies behind the start."""
        late = datetime.fromisoformat(str(port.field.datetime)) - self.coupling.start
        lag = round(late.total_seconds() / self.exchange.ocean_step)
        if lag not in (0, 1):
            raise InputError(
                f"a lag of {lag} steps", where=f"{self.coupling.path}, {port.name}, src_lag",
                remedy="Give 0, and the ocean gets what bergs gave in the step before; or 1, and it waits for this step's",
            )  # fmt: skip
        return lag

    def _get(self, port: _Port) -> None:
        """Take the values of a field; where nothing is due, the last ones stay."""
        grid, date, size = self.exchange.grid, self.exchange.model.date, port.field.collection_size
        g, where = grid.arrays, f"{self.coupling.path}, {port.name}"
        with self._watch.waiting(f"{port.name} from {port.partners} at {date}"):
            got, _ = port.field.get(np.full((size, g.nj * g.ni), np.nan))
        if got is None:
            if port.name not in self.taken:
                raise InputError(f"no value at {date}, the first step", where=where, remedy="Leave tgt_lag out")
            return
        layers = port.factor * np.reshape(got, (size, g.nj, g.ni)) + port.offset
        lacking = np.isnan(layers).any(axis=0) & (g.mask[grid.domain] >= 0.5)
        if lacking.any():
            j, i = np.argwhere(lacking)[0]
            raise InputError(
                f"no value for {int(lacking.sum())} cells of sea, such as ({i + 1}, {j + 1})", where=where,
                remedy="Make riftberg.grid smaller than the ocean, or add '- nnn: {n: 1}' to the interpolation",
            )  # fmt: skip
        self.taken[port.name] = self._above_keels(layers), TAKEN[port.name].units

    def _above_keels(self, layers: Floats) -> Floats:
        """Return the mean over the draft of the bergs (theirs by mass), or over the water where it is shallower."""
        if len(layers) == 1:
            return np.asarray(layers[0])
        body, grid = self.exchange.model.elements.body, self.exchange.grid
        drafts = draft_of(body.thickness, self.exchange.model.parameters.ice.density)
        keel = float(np.average(drafts, weights=body.mass)) if body.mass.size else 0.0
        reach = np.minimum(keel, self.exchange.forcing.fields_at(0.0).depth[grid.domain])
        edges = np.asarray(self.coupling.settings.levels)[:, None, None]
        felt = np.clip(reach - edges[:-1], 0.0, np.diff(edges, axis=0))
        felt[0] = np.maximum(felt[0], 1e-3)  # without a berg, or on land, the uppermost layer counts
        return np.asarray((felt * layers).sum(axis=0) / felt.sum(axis=0))

    def _put(self, lag: int, values: Floats) -> None:
        """Hand the fields over that have a lag (steps)."""
        by_name, skipped = dict(zip(GIVEN, values, strict=True)), (self._yac.Action.NONE, self._yac.Action.REDUCTION)
        for port in self._outward[lag]:
            if port.field.action in skipped:
                raise InputError(
                    f"the step to {self.exchange.model.date} is not exchanged, and what bergs give in it would be lost",
                    where=f"{self.coupling.path}, {port.name}, coupling_period", remedy="Set riftberg.step to that period",
                )  # fmt: skip
            with self._watch.waiting(f"{port.partners} to take {port.name} at {self.exchange.model.date}"):
                port.field.put((port.factor * by_name[port.name] + port.offset).reshape(1, -1))


def _units(metadata: str | None) -> str | None:
    """Return the units that a partner states in its metadata, if it does."""
    try:
        entries = yaml.safe_load(metadata or "")
    except yaml.YAMLError:
        return None
    return str(entries["units"]) if isinstance(entries, dict) and entries.get("units") else None
