"""``riftberg bench``: how fast a run is here, beside a yardstick that makes machines comparable."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import Settings, announce_compilation, make_options, positive, reported, tell
from riftberg.errors import InputError
from riftberg.experiments import Options
from riftberg.system.input_files import check_elements

if TYPE_CHECKING:
    from riftberg.runs.model import Model

SIZES = (500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000)
"""Numbers of elements that ``--scaling`` goes through."""

WHOLE_SECONDS = 10.0
"""Seconds up to which a whole run is timed, six times in all; estimated from its first day."""

ALIKE = ("mts", "quasi_static")
"""Schemes that take the same long steps, with bonds as beams."""


@reported
def bench(
    experiment: Annotated[str, typer.Argument(help="A built-in experiment or a YAML file.")] = "a68a",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    settings: Settings = None,
    days: Annotated[
        float | None,
        typer.Option("--days", help="Simulated days to time.  [default: the first day, then the whole experiment]"),
    ] = None,
    scaling: Annotated[
        str | None,
        typer.Option(
            "--scaling",
            metavar="FROM..TO",
            help="Time rectangular bergs of FROM to TO elements, by mts unless a scheme is set.",
        ),
    ] = None,
) -> None:
    """Measure seconds per simulated day, compilation and memory, relative to a reference workload."""
    import json

    from riftberg.diagnostics.speed import measure, measure_whole
    from riftberg.experiments import build

    whole = days is None
    days = 1.0 if days is None else days
    positive(days, "--days", "days", most=1000.0)
    options = make_options(settings, None, None, None)
    sizes = None if scaling is None else sizes_between(scaling)
    announce_compilation()
    if sizes is None:
        model, info = build(experiment, options)
        rows = [measure(model, experiment=info.name, days=days)]
        for other in _others(model, options):
            with suppress(InputError):  # these bonds, or this criterion, do not go with the scheme
                rows[0]["other_schemes"].append(measure(build(experiment, other)[0], experiment=info.name, days=days))
        if whole and rows[0]["seconds_per_day"] * info.days < WHOLE_SECONDS:
            rows[0]["whole_run"] = measure_whole(
                lambda: build(experiment, options)[0], info.days, info.output_every_hours
            )
    else:
        rows = list(_scaled(sizes, days, options))
    if as_json:
        tell(json.dumps(rows if scaling else rows[0], indent=1))
        return
    for row in rows:
        for told in (row, *row["other_schemes"]):
            tell(line(told))
        if row["whole_run"]:
            tell(whole_line(row["whole_run"]))


def _others(model: Model, options: Options) -> list[Options]:
    """The settings of the other schemes that may take the long steps of this run; none where one was chosen."""
    p, asked = model.parameters, dict(options.changes.get("stepping", {}))
    if "scheme" in asked or not options.own or p.bonds.law != "dem" or p.stepping.scheme not in ALIKE:
        return []
    others = (name for name in ALIKE if name != p.stepping.scheme)
    return [replace(options, changes={**options.changes, "stepping": {**asked, "scheme": name}}) for name in others]


def sizes_between(text: str) -> list[int]:
    """Read ``500..100000`` and return the sizes to time, both ends among them."""
    low, dots, high = text.replace("_", "").partition("..")
    long = len(text) > 40
    if long or not (low.isdecimal() and (high.isdecimal() if dots else True)) or not 1 <= int(low) <= int(high or low):
        raise InputError(f"{text[:40]!r} is not a range of sizes", where="--scaling", remedy="For example 500..100000")
    first, last = int(low), int(high or low)
    check_elements(last, where="--scaling")
    return sorted({first, last, *(size for size in SIZES if first < size < last)})


def _scaled(sizes: list[int], days: float, options: Options) -> Iterator[dict[str, Any]]:
    from riftberg.diagnostics.speed import measure, square_berg

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
