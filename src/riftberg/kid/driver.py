"""KID's stand-alone driver: grid, forcing, length and calendar of its runs.

Source: equations 3.1 and 10.1 to 10.5; files 7.2 and 8.9.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.errors import NamelistError
from riftberg.kid.a68 import LIMITS, STRESS, a68_grid, a68_records
from riftberg.kid.namelist import LATE_START, Clock, KidNamelist, NamelistGroup
from riftberg.kid.parameters import namelist_period, time_step
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid, celsius, wind_from_stress
from riftberg.ocean.gridded import FieldRules, GriddedForcing
from riftberg.state import Floats
from riftberg.system.limits import MEANT, MOST_STEPS, extreme_allowed, refuse_large

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
    wanted = driver.whole("ibhrs") * 3600.0 / dt
    steps = min(driver.whole("nmax"), math.ceil(wanted) if wanted < 1e18 else driver.whole("nmax"))
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
    if seamount and spacing != SEAMOUNT["spacing"]:
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
    fields = uniform_fields(driver, icebergs, grid)
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
    for name, (what, most, unit) in PLAUSIBLE.items():
        if name not in driver.values:
            continue
        if what == "wind" and not icebergs.flag("tau_is_velocity"):
            most = STRESS
        value = driver.number(name)
        if abs(value) > most and not extreme_allowed():
            raise driver.error(f"{name} = {value:g} is no {what}: the most is {most:g}", f"Give it in {unit}, {MEANT}")
    sst = driver.number("sst0" if "sst0" in driver.values else "sst")
    if not (-3.0 <= sst <= 45.0 or 270.0 <= sst <= 318.0 or extreme_allowed()):
        raise driver.error(f"a sea surface of {sst:g} degrees", f"Give degrees Celsius, or kelvin, {MEANT}")
    for name, most in (("cn0", 10.0), ("hi0", 30.0), ("sss0", 60.0)):
        if name in driver.values and not (0.0 <= driver.number(name) <= most or extreme_allowed()):
            raise driver.error(
                f"{name} = {driver.number(name):g} cannot be", f"Give a number from 0 to {most:g}, {MEANT}"
            )
