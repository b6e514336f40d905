"""Seconds per simulated day, compilation and memory of a run on this machine, beside a yardstick that makes machines comparable.

    python benchmarks/bench.py a68a                      the first day, then the whole experiment
    python benchmarks/bench.py FILE.yaml --days 2 --set stepping.scheme=mts
    python benchmarks/bench.py --scaling 500..100000     rectangular bergs of growing size, by mts unless a scheme is set

With ``--json`` it prints what it measured under these keys:

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
yardstick_seconds_per_day : wall seconds of the yardstick for the same berg
    and 4,320 sub-steps, whatever the scheme
yardstick_version : version of the yardstick
relative_to_yardstick : seconds_per_day / yardstick_seconds_per_day
riftberg : version
machine : processor and operating system
whole_run : the whole length of the experiment in processor time, best of its repeats: days, seconds_per_day, slowest (the
    slowest repeat's seconds per day), yardsticks (seconds_per_day over the yardstick's processor time), dearest_days (the
    three: day, counted from 0, and seconds) and with_output (seconds_per_day and slowest of a run that writes its run
    file); null where it would take longer than a minute, or where ``--days`` asks for something else
other_schemes : a list of the same for the other schemes that an experiment may take; empty where a scheme was chosen
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time as clock
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numba import njit

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.cli.options import make_options
from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import InputError, RiftbergError
from riftberg.experiments import Options, build
from riftberg.parameters import A68A_2022_MTS
from riftberg.state import Floats, Ints
from riftberg.system.input_files import check_elements
from riftberg.system.process import held
from riftberg.version import __version__

SIZES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
"""Numbers of elements that ``--scaling`` goes through."""

WHOLE_SECONDS = 10.0
"""Seconds up to which a whole run is timed, six times in all; estimated from its first day."""


YARDSTICK_VERSION: Final = 1

PUBLISHED_SUBSTEPS: Final = 4320
"""Sub-steps a day of the published A68a run: the measure of all schemes."""

STIFFNESS: Final = 1e-4
"""Spring per mass, s-2; soft enough to stay stable."""

DAMPING: Final = 1e-3
"""Damping per mass, s-1."""


@njit(cache=False)
def _loop(first: Ints, second: Ints, state: Floats, force: Floats, rest: Floats, dt: float, count: int) -> None:
    """Advance ``state`` (6, n: x, y, angle and their rates) by ``count`` sub-steps."""
    for _ in range(count):
        force[:, :] = 0.0
        for b in range(first.size):
            i, j = first[b], second[b]
            dx, dy = state[0, i] - state[0, j], state[1, i] - state[1, j]
            length = np.sqrt(dx * dx + dy * dy)
            nx, ny = dx / length, dy / length
            turn = state[2, i] - state[2, j]
            s, c = np.sin(turn), np.cos(turn)
            du, dv = state[3, i] - state[3, j], state[4, i] - state[4, j]
            slip = -du * ny + dv * nx - 0.5 * length * (state[5, i] + state[5, j])
            pull = -STIFFNESS * (length - rest[b]) * c - DAMPING * (du * nx + dv * ny)
            shear = -DAMPING * slip
            fx, fy = pull * nx - shear * ny, pull * ny + shear * nx
            moment = -STIFFNESS * s
            force[0, i] += fx
            force[1, i] += fy
            force[2, i] += moment - shear / length
            force[0, j] -= fx
            force[1, j] -= fy
            force[2, j] -= moment + shear / length
        for e in range(state.shape[1]):
            for k in range(3):
                state[3 + k, e] += dt * force[k, e]
                state[k, e] += dt * state[3 + k, e]


def substeps_per_day(model: Model) -> float:
    """Return how many sub-steps the model takes in a day; the quasi-static scheme has none."""
    if model.parameters.stepping.scheme == "quasi_static":
        return 0.0
    return model.substeps * SECONDS_PER_DAY / model.parameters.time_step


def yardstick_seconds_per_day(
    model: Model, *, seconds: float = 0.3, repeats: int = 3, timer: Callable[[], float] | None = None
) -> float:
    """Time the yardstick for the berg of a model.

    ``seconds``: about how long one measurement may take, s. ``timer``: wall clock unless it is given.
    """
    timer = timer or clock.perf_counter
    first, second = model.bonds.first, model.bonds.second
    if not first.size:
        return 0.0
    state, rest = _start(model)
    force = np.zeros((3, state.shape[1]))

    def measured(count: int) -> float:
        before = timer()
        _loop(first, second, state, force, rest, 1.0, count)
        return (timer() - before) / count

    measured(1)  # compiles
    count = max(1, int(seconds / max(measured(3), 1e-7)))
    return min(measured(count) for _ in range(repeats)) * PUBLISHED_SUBSTEPS


def _start(model: Model) -> tuple[Floats, Floats]:
    """Return positions in metres at rest, and the lengths of the bonds."""
    e, earth = model.elements, model.parameters.earth
    metres = earth.radius * np.pi / 180.0 if earth.latlon else 1.0
    shrink = np.cos(np.radians(e.lat.mean())) if earth.latlon else 1.0
    state = np.zeros((6, e.lon.size))
    state[0], state[1] = (e.lon - e.lon[0]) * metres * shrink, (e.lat - e.lat[0]) * metres
    first, second = model.bonds.first, model.bonds.second
    return state, np.hypot(state[0, first] - state[0, second], state[1, first] - state[1, second])


def measure(model: Model, *, experiment: str = "", days: float = 1.0, seconds: float = 20.0) -> dict[str, Any]:
    """Step a model and return how fast that went; the keys are documented at the top of this file.

    ``seconds``: stop after this wall time even if fewer days are done, s.
    """
    dt = model.parameters.time_step
    before = clock.perf_counter()
    model.advance(steps=1)
    first, steps = clock.perf_counter() - before, 0
    with held() as hold:  # as in a run: each step by itself would hold signals back anew
        before = clock.perf_counter()
        while steps < 1 or (steps < days * SECONDS_PER_DAY / dt and clock.perf_counter() - before < seconds):
            model.step()
            steps += 1
            if hold.requested:
                break
        per_step = (clock.perf_counter() - before) / steps
    speed = per_step * SECONDS_PER_DAY / dt
    stick = yardstick_seconds_per_day(model)
    return {
        "experiment": experiment,
        "scheme": model.parameters.stepping.scheme,
        "time_step": dt,
        "elements": len(model.elements.id),
        "bonds": len(model.bonds.first),
        "substeps_per_day": substeps_per_day(model),
        "days": steps * dt / SECONDS_PER_DAY,
        "seconds_per_day": speed,
        "compile_seconds": max(0.0, first - per_step),
        "memory_mb": memory_mb(),
        "yardstick_seconds_per_day": stick,
        "yardstick_version": YARDSTICK_VERSION,
        "relative_to_yardstick": speed / stick if stick > 0.0 else None,
        "riftberg": __version__,
        "machine": f"{platform.processor() or platform.machine()}, {platform.system()}",
        "whole_run": None,
        "other_schemes": [],
    }


REPEATS = 3
"""Whole runs of a measurement; the best of each day counts."""


def measure_whole(build: Callable[[], Model], days: float, every_hours: float) -> dict[str, Any]:
    """Return the processor time of whole runs: what a day costs changes when a berg breaks, grounds or melts.

    ``build`` makes the model anew, as nothing else takes it back to its start; ``every_hours``: interval of its records.
    """
    daily, written, sticks = [], [], []
    for _ in range(REPEATS):
        daily.append(_processor_days(build(), days))
        model = build()
        with tempfile.TemporaryDirectory() as folder:
            before = clock.process_time()
            model.run(days, output=Path(folder) / "run.nc", every_hours=every_hours)
            written.append((clock.process_time() - before) / days)
        sticks.append(yardstick_seconds_per_day(model, repeats=1, timer=clock.process_time))
    totals = [sum(each) / days for each in daily]
    best = [min(same) for same in zip(*daily, strict=True)]  # other work on the machine only ever adds to a day
    dearest = sorted(range(len(best)), key=best.__getitem__, reverse=True)[:3]
    return {
        "days": days,
        "seconds_per_day": min(totals),
        "slowest": max(totals),
        "yardsticks": min(totals) / min(sticks) if min(sticks) > 0.0 else None,
        "dearest_days": [{"day": day, "seconds": best[day]} for day in dearest],
        "with_output": {"seconds_per_day": min(written), "slowest": max(written)},
    }


def _processor_days(model: Model, days: float) -> list[float]:
    """Step a model through some days and return the processor time of each, s; the last may be a part of a day."""
    steps = round(days * SECONDS_PER_DAY / model.parameters.time_step)
    ends = np.arange(1, steps + 1) * model.parameters.time_step / SECONDS_PER_DAY
    spent = [0.0] * (int(np.ceil(ends[-1] - 1e-9)) if steps else 1)
    with held():
        for end in ends:
            before = clock.process_time()
            model.step()
            spent[int(np.ceil(end - 1e-9)) - 1] += clock.process_time() - before
    return spent


def memory_mb() -> float | None:
    """Return the largest memory that this process has held, MiB; None where the system does not say."""
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
    rows = max(1, round((elements / 2.0) ** 0.5))
    columns = max(1, round(elements / rows))
    berg = Iceberg.rectangle(columns * 3000.0, rows * 3000.0, thickness=200.0, latlon=False, offset=(0.0, 0.0))
    plane = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
    parameters = A68A_2022_MTS.changed(earth=plane, stepping={"substeps": None}, fracture={"enabled": False})
    return Model(
        berg, Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)), change(parameters) if change else parameters
    )


def sizes_between(text: str) -> list[int]:
    """Read ``500..100000`` and return the sizes to time, both ends among them."""
    low, dots, high = text.replace("_", "").partition("..")
    if not (low.isdecimal() and (high.isdecimal() if dots else True)) or not 1 <= int(low) <= int(high or low):
        raise InputError(f"{text!r} is not a range of sizes", where="--scaling", remedy="For example 500..100000")
    first, last = int(low), int(high or low)
    check_elements(last, where="--scaling")
    return sorted({first, last, *(size for size in SIZES if first < size < last)})


def other_schemes(model: Model, options: Options) -> list[Options]:
    """Return the options of the other engine where the run may take it and no scheme was asked for."""
    scheme, asked = model.parameters.stepping.scheme, dict(options.changes.get("stepping", {}))
    alike = ("mts", "quasi_static")
    if "scheme" in asked or not options.own or model.parameters.bonds.law != "dem" or scheme not in alike:
        return []
    other = alike[scheme == "mts"]
    return [replace(options, changes={**options.changes, "stepping": {**asked, "scheme": other}})]


def measure_experiment(experiment: str, options: Options, days: float | None) -> Iterator[dict[str, Any]]:
    """Yield the measurement of one experiment, with that of the other scheme and of the whole run."""
    model, info = build(experiment, options)
    row = measure(model, experiment=info.name, days=days or 1.0)
    for other in other_schemes(model, options):
        with suppress(InputError):  # these bonds, or this criterion, do not go with the scheme
            row["other_schemes"].append(measure(build(experiment, other)[0], experiment=info.name, days=days or 1.0))
    if days is None and row["seconds_per_day"] * info.days < WHOLE_SECONDS:
        row["whole_run"] = measure_whole(lambda: build(experiment, options)[0], info.days, info.output_every_hours)
    yield row


def measure_sizes(sizes: list[int], options: Options, days: float) -> Iterator[dict[str, Any]]:
    """Yield the measurement of a rectangular berg of each size."""
    for size in sizes:
        yield measure(square_berg(size, options.apply), experiment=f"rectangle of {size}", days=days, seconds=5.0)


def line(row: dict[str, Any]) -> str:
    """Return a measurement in one line."""
    room = f"{row['memory_mb']:.0f} MB" if row["memory_mb"] is not None else "memory unknown"
    ratio = f" = {row['relative_to_yardstick']:.2f} yardsticks" if row["relative_to_yardstick"] else ""
    return (
        f"{row['experiment']}: {row['elements']} elements, {row['bonds']} bonds, {row['scheme']} with "
        f"{row['time_step']:g} s, {row['seconds_per_day']:.3g} s per day"
        f"{ratio} (yardstick {row['yardstick_seconds_per_day']:.3g} s), "
        f"first step {row['compile_seconds']:.3g} s, {room}"
    )


def whole_line(row: dict[str, Any]) -> str:
    """Return the measurement of a whole run in one line."""
    output = row["with_output"]
    ratio = f" = {row['yardsticks']:.2f} yardsticks" if row["yardsticks"] else ""
    days = ", ".join(f"day {day['day']} {day['seconds']:.3g} s" for day in row["dearest_days"])
    return (
        f"  all {row['days']:g} days, processor time: {row['seconds_per_day']:.3g} to {row['slowest']:.3g} s per day{ratio}, "
        f"with output {output['seconds_per_day']:.3g} to {output['slowest']:.3g} s; dearest: {days}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Measure what the command line asks for, and print it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("experiment", nargs="?", default="a68a", help="a built-in experiment or a YAML file")
    parser.add_argument(
        "--set", action="append", dest="settings", metavar="GROUP.NAME=VALUE", help="as in riftberg run"
    )
    parser.add_argument("--days", type=float, help="simulated days to time (the first, then all)")
    parser.add_argument("--scaling", metavar="FROM..TO", help="time rectangular bergs of FROM to TO elements")
    parser.add_argument("--json", action="store_true", help="print the raw measurements")
    asked = parser.parse_args(arguments)
    try:
        options = make_options(asked.settings, None, None, None)
        if asked.scaling:
            rows = list(measure_sizes(sizes_between(asked.scaling), options, asked.days or 1.0))
        else:
            rows = list(measure_experiment(asked.experiment, options, asked.days))
    except RiftbergError as error:
        parser.error(str(error))
    if asked.json:
        print(json.dumps(rows if asked.scaling else rows[0], indent=1))
        return 0
    for row in rows:
        for each in (row, *row["other_schemes"]):
            print(line(each))
        if row["whole_run"]:
            print(whole_line(row["whole_run"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
