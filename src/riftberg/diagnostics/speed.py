"""How fast a model runs on this machine.

Keys of a measurement
---------------------
experiment : name
scheme : stepping.scheme of the run
time_step : its long step, s
elements, bonds : their numbers
substeps_per_day : sub-steps in a simulated day; 0 for the quasi-static scheme, which has none
days : simulated days that were timed
seconds_per_day : wall seconds per simulated day, after the first step, without writing files
compile_seconds : wall time of the first step above that of the others (compilation, or loading what was compiled), s
memory_mb : largest memory of the process so far, MiB
yardstick_seconds_per_day : wall seconds of the yardstick (`riftberg.diagnostics.yardstick`) for the same berg
    and 4,320 sub-steps, whatever the scheme
yardstick_version : version of the yardstick
relative_to_yardstick : seconds_per_day / yardstick_seconds_per_day
riftberg : version
machine : processor and operating system
other_schemes : a list of the same for the other schemes that an experiment may take; empty where a scheme was asked for
"""

from __future__ import annotations

import platform
import sys
import time as clock
from typing import TYPE_CHECKING, Any

from riftberg.constants import SECONDS_PER_DAY
from riftberg.diagnostics import yardstick
from riftberg.system.interrupts import held
from riftberg.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable

    from riftberg.parameters import Parameters
    from riftberg.runs.model import Model


def measure(model: Model, *, experiment: str = "", days: float = 1.0, seconds: float = 20.0) -> dict[str, Any]:
    """Step a model and return how fast that went; the keys are documented at the top of this file.

    ``seconds``: stop after this wall time even if fewer days are done, s.
    """
    dt = model.parameters.stepping.time_step
    first = _timed_step(model)
    steps = 0
    with held() as hold:  # as in a run: each step by itself would hold signals back anew
        before = clock.perf_counter()
        while steps < 1 or (steps < days * SECONDS_PER_DAY / dt and clock.perf_counter() - before < seconds):
            model.step()
            steps += 1
            if hold.requested:
                break
        per_step = (clock.perf_counter() - before) / steps
    speed = per_step * SECONDS_PER_DAY / dt
    stick = yardstick.yardstick_seconds_per_day(model)
    return {
        "experiment": experiment,
        "scheme": model.parameters.stepping.scheme,
        "time_step": dt,
        "elements": len(model.elements.id),
        "bonds": len(model.bonds.first),
        "substeps_per_day": yardstick.substeps_per_day(model),
        "days": steps * dt / SECONDS_PER_DAY,
        "seconds_per_day": speed,
        "compile_seconds": max(0.0, first - per_step),
        "memory_mb": memory_mb(),
        "yardstick_seconds_per_day": stick,
        "yardstick_version": yardstick.VERSION,
        "relative_to_yardstick": speed / stick if stick > 0.0 else None,
        "riftberg": __version__,
        "machine": f"{platform.processor() or platform.machine()}, {platform.system()}",
        "other_schemes": [],
    }


def _timed_step(model: Model) -> float:
    before = clock.perf_counter()
    model.advance(steps=1)
    return clock.perf_counter() - before


def memory_mb() -> float | None:
    """Return the largest memory that this process has held, MiB; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return peak / 1024.0**2 if sys.platform == "darwin" else peak / 1024.0


def square_berg(elements: int, change: Callable[[Parameters], Parameters] | None = None) -> Model:
    """Return a model of a rectangular berg of about ``elements`` elements in a steady current, in plane coordinates.

    Element size, sub-steps and forcing are the same for all sizes, so that the cost of an element shows: that of the explicit
    scheme, unless ``change`` names another one.
    """
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.ocean.analytic import Steady
    from riftberg.parameters import A68A_2022
    from riftberg.runs.model import Model

    rows = max(1, round((elements / 2.0) ** 0.5))
    columns = max(1, round(elements / rows))
    berg = Iceberg.rectangle(columns * 3000.0, rows * 3000.0, thickness=200.0, latlon=False, offset=(0.0, 0.0))
    plane = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
    parameters = A68A_2022.changed(
        earth=plane, stepping={"scheme": "mts", "substeps": None}, fracture={"enabled": False}
    )
    return Model(berg, Steady(current=(0.2, 0.0)), change(parameters) if change else parameters)
