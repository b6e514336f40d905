"""KID's drivers: grid, forcing, length and calendar of its stand-alone runs, and the cases that exchange with an ocean.

The small driver of group ``drv_nml`` hands over fields by formulas: see `ocean_fields`. Melt, rolling and footloose calving act
by KID's own rules, there as in runs without an ocean. Source: equations 3.1 and 10.1 to 10.5; files 1, 2, 5, 7.2 and 8.9;
quirks T5 to T13, T44 to T46.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.coupling.fields import OceanForcing
from riftberg.coupling.reference import NineCellRules, ReferenceExchange, Returned, ReturnRules
from riftberg.errors import InputError, NamelistError
from riftberg.kid.a68 import LIMITS, STRESS, a68_grid, a68_records
from riftberg.kid.parameters import (
    LATE_START,
    Clock,
    KidNamelist,
    NamelistGroup,
    add_file_depth,
    depth_notes,
    namelist_period,
    time_step,
    to_parameters,
)
from riftberg.kid.restart import (
    CALVING_FILE,
    RESTART,
    IdentifierCounter,
    as_iceberg,
    read_restart,
    read_stores,
    write_stores,
)
from riftberg.kid.trajectories import resample_environment
from riftberg.life.calving import FluxCalving, Stores, check_flux
from riftberg.life.draws import ReferenceDraws
from riftberg.life.melt import life_values
from riftberg.life.process import LifeModel
from riftberg.model import Recorder, recording
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid, celsius, wind_from_stress
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.parameters import Parameters
from riftberg.physics.floating import roll
from riftberg.runs.model import Model
from riftberg.state import Bonds, Elements, Floats, new_elements
from riftberg.system.atomic_files import replacing
from riftberg.system.input_files import MEANT, MOST_STEPS, extreme_allowed, refuse_large
from riftberg.system.netcdf_lock import open_netcdf
from riftberg.system.process import held

OCEAN_DEPTH: Final = 1000.0
"""Depth of the driver's ocean, m."""

SEAMOUNT: Final = {"x": 63e3, "y": 60e3, "width": 5e3, "spacing": 5e3, "half_cell": 2500.0, "offset": -0.45}
"""Seamount of the grounding test: place, width, spacing of its grid and shift of the corners, m (10.4)."""

SEAMOUNT_LAND: Final = (-5000.0, 220_000.0)
"""Cells of the grounding test are land where the corner's y is at most the first or at least the second, m."""

MOST_CELLS: Final = 10_000_000
"""Cells of the driver's grid."""

PLAUSIBLE: Final = {
    **dict.fromkeys(("ibuo", "ibvo", "uo0", "vo0"), ("current", LIMITS["uo"], "m/s")),
    **dict.fromkeys(("ibui", "ibvi", "ui0", "vi0"), ("drift of sea ice", LIMITS["uo"], "m/s")),
    **dict.fromkeys(("ibua", "ibuy", "ua0", "va0"), ("wind", LIMITS["ua"], "m/s (or Pa of stress, at most 10)")),
}
"""Largest plausible magnitudes of the driver's entries, with what they are."""

WIDEST_CELL: Final = 1e7
"""Widest cell of the driver's grid, m."""

LONGEST: Final = 2.5e11
"""Longest run, s: some 8000 years, within the calendar."""

COLLISION_CENTRE: Final = 10_000.0
"""Line towards which the currents of the collision test converge, m (10.2)."""


def build_clock(namelist: KidNamelist) -> Clock:
    """Return length and calendar: steps until ``nmax`` are done or ``ibhrs`` hours are reached."""
    driver = namelist.driver
    dt = time_step(namelist)
    steps_in_hours = driver.whole("ibhrs") * 3600.0 / dt
    steps = min(driver.whole("nmax"), math.ceil(steps_in_hours) if steps_in_hours < 1e18 else driver.whole("nmax"))
    refuse_large(
        steps, MOST_STEPS, "long steps", where=driver.where, remedy="Give a smaller ibhrs or nmax", kind=NamelistError
    )
    if steps < 1:
        raise driver.error(
            f"ibhrs = {driver.whole('ibhrs')} and nmax = {driver.whole('nmax')} give no step", "Give positive numbers"
        )
    if steps * dt > LONGEST:
        raise driver.error(f"nmax and ibhrs ask for {steps * dt / 86400.0:.3g} days", "Run at most some 8000 years")
    index = driver.whole("transient_a68_data_start_ind") if driver.flag("a68_test") else 0
    return Clock(dt, steps, float(LATE_START.get(index, 0)))


def build_grid(namelist: KidNamelist, case: Path) -> Grid:
    """Return the driver's grid."""
    driver, icebergs = namelist.driver, namelist.icebergs
    a68 = driver.flag("a68_test")
    if a68 != icebergs.flag("grid_is_latlon"):
        kind = "degrees" if a68 else "metres"
        raise icebergs.error(
            f"grid_is_latlon = {icebergs.flag('grid_is_latlon')}, but the driver's grid is in {kind}",
            f"Set grid_is_latlon = {'.true.' if a68 else '.false.'}",
        )
    if a68:
        return a68_grid(driver, case, namelist_period(icebergs))
    ni, nj, spacing = driver.whole("ni"), driver.whole("nj"), driver.number("gridres")
    if ni < 2 or nj < 2 or not 0 < spacing <= WIDEST_CELL:
        raise driver.error(
            f"ni = {ni}, nj = {nj}, gridres = {spacing:g} make no grid",
            "Give at least 2 x 2 cells, at most 10000 km wide",
        )
    refuse_large(
        ni * nj, MOST_CELLS, "grid cells", size=1000.0, where=driver.where, remedy="Give smaller ni and nj",
        kind=NamelistError,
    )  # fmt: skip
    period = namelist_period(icebergs)
    if period > 0 and not math.isclose(period, ni * spacing, rel_tol=1e-12):
        raise icebergs.error(
            f"Lx = {period} m, but the driver's grid spans ni x gridres = {ni * spacing} m",
            "Make them equal, or set Lx = -1 for closed ends",
        )
    seamount = driver.flag("big_grounding_test")
    if seamount and not math.isclose(spacing, SEAMOUNT["spacing"]):
        raise driver.error(f"big_grounding_test with gridres = {spacing}", "The seamount is made for gridres = 5000")
    mask = np.ones((nj + 2, ni + 2))
    if seamount:
        _, y = _ring_corners(driver, ni, nj)
        mask[(y <= SEAMOUNT_LAND[0]) | (y >= SEAMOUNT_LAND[1])] = 0.0
    grid = Grid.cartesian(
        ni, nj, spacing, period=max(period, 0.0), offset=SEAMOUNT["offset"] if seamount else 0.0, mask=mask
    )
    grid.arrays = grid.arrays._replace(regular=icebergs.flag("grid_is_regular"))
    return grid


def _ring_corners(driver: NamelistGroup, ni: int, nj: int) -> tuple[Floats, Floats]:
    """Return north-east corners of the domain and one ring around it."""
    spacing = driver.number("gridres")
    offset = SEAMOUNT["offset"] if driver.flag("big_grounding_test") else 0.0
    x, y = np.meshgrid(spacing * np.arange(ni + 2) + offset, spacing * np.arange(nj + 2) + offset)
    return x, y


def driver_forcing(namelist: KidNamelist, grid: Grid, case: Path, clock: Clock) -> GriddedForcing:
    """Return the driver's forcing.

    ``sample`` at the start time of a step gives the fields that the driver hands over in that step.
    """
    driver, icebergs = namelist.driver, namelist.icebergs
    restarts = case / icebergs.text("restart_input_dir")
    # The artificial depth of A68 has a zone, with multiple time steps alone.
    zoned = icebergs.flag("mts") and icebergs.flag("A68_test")
    rules = field_rules(icebergs)
    if zoned:
        zone = (icebergs.number("A68_xdisp") + 360.0, icebergs.number("A68_ydisp"))
        rules = replace(rules, depth_rule="zone", zone=zone, sea_level_gaps=True)
    if driver.flag("a68_test"):
        records, times = a68_records(driver, icebergs, grid, case, clock.dt, clock.steps)
        source = f"the A68 data of {driver.text('data_dir')}"
        return GriddedForcing(grid, records, times, replace(rules, stepwise=("ssh",)), source=source)
    fields = add_file_depth(uniform_fields(driver, icebergs, grid), icebergs, restarts, grid)
    return GriddedForcing(grid, fields, rules=rules, source="KID's stand-alone driver")


def field_rules(icebergs: NamelistGroup) -> FieldRules:
    """Return how the fields reach the elements (section 3.2)."""
    return FieldRules(
        depth_rule="biquadratic" if icebergs.flag("mts") else "cell",
        coastal_drift=icebergs.number("coastal_drift"),
        tidal_drift=icebergs.number("tidal_drift"),
        mirrored=icebergs.flag("old_bug_bilin"),
        even_parity=icebergs.flag("rev_mind"),
        listed_draws=True,
    )


def uniform_fields(driver: NamelistGroup, icebergs: NamelistGroup, grid: Grid) -> Fields:
    """Return the constant fields of the Cartesian cases."""
    g = grid.arrays
    check_medium(driver, icebergs)
    x, y = _ring_corners(driver, g.ni, g.nj)
    vo = np.full_like(x, driver.number("ibvo"))
    if driver.flag("collision_test"):  # currents converge on a line, west of it
        vo *= np.sign(COLLISION_CENTRE - y)
        vo[(x > COLLISION_CENTRE) | (x <= 0.0)] = 0.0
    if driver.flag("fl_test"):
        vo[x > COLLISION_CENTRE] *= -1.0
    depth = np.full_like(x, OCEAN_DEPTH)
    if driver.flag("big_grounding_test"):
        dx = x - SEAMOUNT["half_cell"] - SEAMOUNT["x"]
        dy = y - SEAMOUNT["half_cell"] - SEAMOUNT["y"]
        height = OCEAN_DEPTH - driver.number("bump_depth")
        depth = OCEAN_DEPTH - height * np.exp(-(dx * dx + dy * dy) / (2.0 * SEAMOUNT["width"] ** 2))
    tau = np.array([[driver.number("ibua")]]), np.array([[driver.number("ibuy")]])
    ua, va = tau if icebergs.flag("tau_is_velocity") else wind_from_stress(*tau)
    fields = grid.fields(
        uo=driver.number("ibuo"),
        vo=vo,
        ui=driver.number("ibui"),
        vi=driver.number("ibvi"),
        ua=float(ua[0, 0]),
        va=float(va[0, 0]),
        sst=driver.number("sst"),
        depth=depth,
    )
    return fields._replace(sst=celsius(fields.sst, g.mask))


def check_medium(driver: NamelistGroup, icebergs: NamelistGroup) -> None:
    """Refuse water, ice and air of a driver that cannot be, unless they are said to be meant."""
    for name, (medium, most, unit) in PLAUSIBLE.items():
        if name not in driver.values:
            continue
        if medium == "wind" and not icebergs.flag("tau_is_velocity"):
            most = STRESS
        value = driver.number(name)
        if abs(value) > most and not extreme_allowed():
            raise driver.error(
                f"{name} = {value:g} is no {medium}: the most is {most:g}", f"Give it in {unit}, {MEANT}"
            )
    sst = driver.number("sst0" if "sst0" in driver.values else "sst")
    if not (-3.0 <= sst <= 45.0 or 270.0 <= sst <= 318.0 or extreme_allowed()):
        raise driver.error(f"a sea surface of {sst:g} degrees", f"Give degrees Celsius, or kelvin, {MEANT}")
    for name, most in (("cn0", 10.0), ("hi0", 30.0), ("sss0", 60.0)):
        if name in driver.values and not (0.0 <= driver.number(name) <= most or extreme_allowed()):
            raise driver.error(
                f"{name} = {driver.number(name):g} cannot be", f"Give a number from 0 to {most:g}, {MEANT}"
            )


def without_idle_life(p: Parameters, elements: Elements, bonds: Bonds, passive: bool) -> Parameters:
    """Return the parameters, with melt and rolling off where they cannot change anything in the whole run.

    So it is with rates of zero, no bits to melt and no element that would roll, now or once its bonds have broken, and with
    bergs that do not decay while nothing is returned to an ocean.
    """
    if p.footloose.enabled:
        return p
    off = p.changed(melt={"enabled": False}, rolling={"enabled": False})
    if p.melt.keep_shape:
        return off if passive else p
    bits = p.melt.bits_fraction > 0.0 and (elements.life.mass_of_bits > 0.0).any()
    if not p.melt.zero_rates or bits:
        return p
    count = np.bincount(np.concatenate([bonds.first, bonds.second]), minlength=elements.size)
    free = (elements.static < 0.5) & ((count == 0) | p.fracture.enabled)
    # Whether an element without bonds would roll at once.
    v, body = life_values(p), elements.body
    shapes = zip(free.tolist(), body.thickness.tolist(), body.width.tolist(), body.length.tolist(), strict=True)
    rolls = p.rolling.enabled and any(
        alone and roll(t, w, q, v.rolling_scheme, v.tip, v.rho_ice, v.rolls_on)[0] != t for alone, t, w, q in shapes
    )
    return p if rolls else off


def attach_life(model: Model, group: NamelistGroup, clock: Clock, restarts: Path, ranks: tuple[int, int]) -> None:
    """Give the life of a model KID's rules: its environment, dates, identifiers and random numbers."""
    life, grid = model.life, model.forcing.grid
    if life is None or grid is None:
        return
    first = clock.date(0.0)
    seed = first.year, first.month, first.day, first.hour, first.minute, int(first.second)
    life.draws = ReferenceDraws(seed, group.flag("fl_init_child_xy_by_pe"))
    life.ranks = ranks
    life.names = IdentifierCounter.beside(restarts, grid, model.elements.id).take
    single = not model.parameters.stepping.has_substeps

    def born(m: LifeModel) -> tuple[int, float]:
        date = clock.date((m.step_number - 1) * clock.dt)
        return date.year, date.year_day()

    def look(m: LifeModel) -> None:
        if single:
            resample_environment(m, (m.step_number - 1) * clock.dt, group)

    life.born, life.look_around = born, look
    if isinstance(model.forcing, GriddedForcing):
        # That of the cell, without the sea level, whatever depth the forces take (files, 1.4).
        life.floor = model.forcing.fields_at(0.0).depth


LAND: Final = (7, slice(4, 7))
"""Column and rows of the land, counted from 1."""

CALVES: Final = (5, slice(3, 9))
"""Column and rows that land ice calves into, counted from 1."""

OCEAN: Final = {
    "calving": ("kg m-2 s-1", "kg m-2 s-1, as returned (melt water added)"),
    "calving_hflx": ("W m-2", "W m-2, as returned"),
    "mass_berg": ("kg m-2", "kg m-2"),
    "ustar_berg": ("m s-1", "m s-1"),
    "area_berg": ("1", "1"),
    "incr_mass": ("kg m-2", "kg m-2, from icebergs_incr_mass"),
}
"""Fields of ``ocean.nc`` with units and comment."""


def _grid(driver: NamelistGroup, icebergs: NamelistGroup) -> Grid:
    """Return the grid: square cells in metres, closed unless ``Lx`` spans them."""
    ni, nj, spacing = driver.whole("ni"), driver.whole("nj"), driver.number("gridres")
    if icebergs.flag("grid_is_latlon"):
        raise icebergs.error("grid_is_latlon = T, but the grid of drv_nml is in metres", "Set grid_is_latlon = .false.")
    if ni < 2 or nj < 2 or spacing <= 0.0:
        raise driver.error(f"ni = {ni}, nj = {nj}, gridres = {spacing} make no grid", "Give at least 2 x 2 cells")
    refuse_large(
        ni * nj, MOST_CELLS, "grid cells", size=1000.0, where=driver.where, remedy="Give smaller ni and nj",
        kind=NamelistError,
    )  # fmt: skip
    mask = np.ones((nj, ni))
    if driver.number("land") > 0.0:
        mask[_cells(LAND)] = 0.0
    x, y = np.meshgrid(spacing * np.arange(1, ni + 1), driver.number("lat0") + spacing * np.arange(1, nj + 1))
    period = namelist_period(icebergs)
    grid = Grid.from_corners(x, y, latlon=False, regular=True, period=max(period, 0.0), mask=mask)
    grid.arrays.dx[:], grid.arrays.dy[:], grid.arrays.area[:] = spacing, spacing, spacing**2
    grid.arrays = grid.arrays._replace(regular=icebergs.flag("grid_is_regular"))
    grid.bergs_on_land = True
    return grid


def _cells(line: tuple[int, slice]) -> tuple[slice, slice]:
    """Rows and columns of an array over the domain."""
    column, rows = line
    return slice(rows.start - 1, rows.stop - 1), slice(column - 1, column)


def ocean_fields(driver: NamelistGroup, icebergs: NamelistGroup, grid: Grid) -> Fields:
    """Return the fields that the driver hands over in each step, with the global column i and row j counted from 1.

    Sea level 0.01 i, sea-ice concentration 0.1 cn0 i, temperature sst0 + 0.1 i - 0.05 j + sstk, salinity
    sss0 - 0.2 i + 0.1 j, depth 100 + 20 i; currents, sea ice and wind are uniform.
    """
    g = grid.arrays
    # One ring around the domain, as the driver has it.
    i, j = np.meshgrid(np.arange(g.ni + 2.0), np.arange(g.nj + 2.0))
    inner = np.s_[1:-1, 1:-1]
    tau = np.array([[driver.number("ua0")]]), np.array([[driver.number("va0")]])
    ua, va = tau if icebergs.flag("tau_is_velocity") else wind_from_stress(*tau)
    sst = driver.number("sst0") + 0.1 * i - 0.05 * j + driver.number("sstk")
    fields = grid.fields(
        uo=driver.number("uo0"), vo=driver.number("vo0"), ui=driver.number("ui0"), vi=driver.number("vi0"),
        ua=float(ua[0, 0]), va=float(va[0, 0]), ssh=0.01 * i, ice_fraction=0.1 * driver.number("cn0") * i,
        ice_thickness=driver.number("hi0"), sst=sst[inner],
        sss=(driver.number("sss0") - 0.2 * i + 0.1 * j)[inner], depth=(100.0 + 20.0 * i)[inner],
    )  # fmt: skip
    return fields._replace(sst=celsius(fields.sst, g.mask))


def land_ice(driver: NamelistGroup, grid: Grid, step: int) -> tuple[Floats, Floats]:
    """Return flux of ice (kg m-2 s-1) and heat (W m-2) of a step, counted from 1."""
    g = grid.arrays
    flux, heat = np.zeros((g.nj, g.ni)), np.zeros((g.nj, g.ni))
    rows, columns = _cells(CALVES)
    j = np.arange(1, g.nj + 1)[rows, None]
    flux[rows, columns] = driver.number("calv0") * (1.0 + 0.1 * j + 0.02 * step)
    heat[rows, columns] = -driver.number("calvh0") * (1.0 + 0.05 * j)
    return flux, heat


class ExchangeRun:
    """A run of KID's in which water goes to an ocean, or to the driver, in each step and land ice comes from there."""

    def __init__(self, model: Model, group: NamelistGroup, grid: Grid, clock: Clock, restarts: Path) -> None:
        parameters = model.parameters
        stores = read_stores(restarts / CALVING_FILE, grid, len(parameters.calving.south.mass))
        calving = FluxCalving(parameters, grid)
        random = Stores.random(calving.south, calving.north, grid, by_column=not group.flag("make_calving_reproduce"))
        calving.stores = random if stores is None else stores
        counter = getattr(getattr(model.life, "names", None), "__self__", None)
        if counter is not None:
            # Births by calving and by the footloose mechanism draw from one counter in each cell.
            np.maximum(counter.counts, calving.stores.counter, out=counter.counts)
            calving.stores.counter = counter.counts
        self.model, self.grid, self.clock = model, grid, clock
        self.exchange = ReferenceExchange(model, calving, _return_rules(group))
        self.returned: list[Returned] = []
        self.notes = (
            [] if stores is not None else ["stores of land ice filled at random, as KID does without calving.res.nc"]
        )

    def advance(self, recorders: Sequence[Recorder]) -> None:
        """Take all steps, calling the recorders; Ctrl-C takes effect between two steps."""
        with held() as hold:
            with recording(recorders, self.model) as record:
                while self.model.step_number < self.clock.steps and not hold.requested:
                    self.returned.append(self.step())
                    record()
            hold.check()

    def step(self) -> Returned:
        """Take a step, and return the fields to the ocean."""
        raise NotImplementedError

    def born(self) -> tuple[int, float]:
        """Return year and day of the year at the start of the step."""
        date = self.clock.date(self.model.step_number * self.clock.dt)
        return date.year, date.year_day()

    def write_stores(self, path: Path) -> None:
        """Write the stores of land ice."""
        write_stores(path, self.exchange.calving.stores)


class FedBackRun(ExchangeRun):
    """A run of the stand-alone driver, which takes the water that bergs return for the land ice of the next step (quirk T42)."""

    def __init__(self, model: Model, group: NamelistGroup, grid: Grid, clock: Clock, restarts: Path) -> None:
        super().__init__(model, group, grid, clock, restarts)
        self.notes += [
            "passive_mode = .false.: KID's driver takes the melt water for land ice, so bergs calve where ice melts"
        ]

    def step(self) -> Returned:
        """Take a step with the fields that the last one returned; no other is kept."""
        fields = self.exchange.forcing.fields_at(self.model.step_number * self.clock.dt)
        no_ice = np.zeros((self.grid.arrays.nj, self.grid.arrays.ni))
        if not self.returned:
            return self.exchange.step(fields, no_ice, no_ice, self.born())
        last = self.returned.pop()
        return self.exchange.step(fields, last.calving, last.calving_hflx, self.born())


class CoupledRun(ExchangeRun):
    """A case with an ocean, read and checked, ready to run; nothing is written."""

    def __init__(self, folder: Path, namelist: KidNamelist, ranks: tuple[int, int]) -> None:
        group, driver = namelist.icebergs, namelist.driver
        parameters = to_parameters(namelist)
        if group.flag("iceberg_bonds_on"):
            raise group.error(
                "iceberg_bonds_on = T with drv_nml", "Set iceberg_bonds_on = .false.: this driver has no bonds"
            )
        steps = driver.whole("nsteps")
        refuse_large(
            steps, MOST_STEPS, "long steps", where=driver.where, remedy="Give a smaller nsteps", kind=NamelistError
        )
        if steps < 1:
            raise driver.error(f"nsteps = {steps}", "Give a positive number")
        clock, grid = Clock(time_step(namelist), steps, 0.0), _grid(driver, group)
        restarts = folder / group.text("restart_input_dir")
        elements = _bergs(restarts / RESTART, grid, group)
        check_medium(driver, group)
        self._fields = add_file_depth(ocean_fields(driver, group, grid), group, restarts, grid)
        forcing = OceanForcing(grid, self._fields, rules=field_rules(group), source="KID's driver with an ocean")
        for flux in (land_ice(driver, grid, 1), land_ice(driver, grid, clock.steps)):
            check_flux(*flux, np.ones_like(flux[0]), driver.where)
        model = Model(as_iceberg(elements, None, parameters, restarts), forcing, parameters, datetime(1, 1, 1))
        attach_life(model, group, clock, restarts, ranks)
        super().__init__(model, group, grid, clock, restarts)
        self.parameters, self._driver = parameters, driver
        self.notes += depth_notes(group, restarts)

    def step(self) -> Returned:
        """Take a step with the fields and the flux of the driver."""
        flux = land_ice(self._driver, self.grid, self.model.step_number + 1)
        return self.exchange.step(self._fields, *flux, self.born())

    def write_ocean(self, path: Path) -> None:
        """Write the fields to the ocean so far, in the layout of the reference's ``ocean.nc``."""
        if self.returned:
            _write_ocean(path, self.returned)


def _bergs(path: Path, grid: Grid, group: NamelistGroup) -> Elements:
    if path.is_file():
        return read_restart(path, grid)
    if group.flag("require_restart"):
        raise InputError("no such file", where=str(path), remedy="Put it there, or set require_restart = .false.")
    return new_elements(0)


def _return_rules(group: NamelistGroup) -> ReturnRules:
    """Return how a namelist wants bergs spread and returned."""
    cutoff = group.number("melt_cutoff")
    nine = NineCellRules(
        hexagonal=group.flag("hexagonal_icebergs"),
        one_cell_wide=group.flag("use_old_spreading"),
        orientation=group.number("initial_orientation"),
        turned_by_bonds=False,  # bergs have no bonds here
        grounding_fraction=max(group.number("grounding_fraction"), 0.0),
    )
    return ReturnRules(
        nine=nine,
        weight=group.flag("add_weight_to_ocean"),
        fields=group.flag("pass_fields_to_ocean_model"),
        passive=group.flag("passive_mode"),
        melt_by_mass=group.flag("find_melt_using_spread_mass"),
        least_gap=cutoff if group.flag("apply_thickness_cutoff_to_gridded_melt") else -1.0,
    )


def _write_ocean(path: Path, steps: list[Returned]) -> None:
    """Write the fields that each step returned."""
    shape = steps[0].calving.shape
    with replacing(path, to_disk=True) as temporary, open_netcdf(temporary, "w") as dataset:
        for name, size in (("step", len(steps)), ("j", shape[0]), ("i", shape[1])):
            dataset.createDimension(name, size)
        for name, (units, comment) in OCEAN.items():
            variable = dataset.createVariable(name, "f8", ("step", "j", "i"), zlib=True)
            variable.setncatts({"units": units, "comment": comment})
            variable[...] = np.stack([getattr(step, name) for step in steps])
        for name in ("stock_water", "stock_heat"):
            dataset.createVariable(name, "f8", ("step",))[...] = [getattr(step, name) for step in steps]
