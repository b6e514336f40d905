"""``riftberg compare``, ``rerun``, ``why`` and ``score``: results of runs and their causes, side by side with observations."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, redirect_stdout
from datetime import datetime, timedelta
from io import StringIO
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Final

import typer

from riftberg.cli.options import (
    Data,
    Days,
    Every,
    Map,
    NumericsName,
    OutputBeside,
    Quiet,
    Settings,
    Without,
    check_folder,
    check_range,
    console,
    dates,
    load_observed,
    output_folder,
    report_errors,
    results_folder,
    say,
    table,
    tell,
    words_without,
)
from riftberg.cli.pictures import Format, Run, check_picture_format, folder_beside
from riftberg.config.units import count_text, minute_text
from riftberg.errors import CUT, InputError
from riftberg.system.atomic_files import write_text
from riftberg.system.input_files import ADDRESSES, check_file, is_folder, value_shown

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table

    from riftberg.diagnostics.compare import Comparison, RealEvent
    from riftberg.diagnostics.cut import Breakup
    from riftberg.diagnostics.score import Match, Score
    from riftberg.diagnostics.why import Reasons


PICTURES: Final = ("comparison.json", "tracks.png")
"""Files that a comparison may write into its folder."""


@report_errors
def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN RUN ...",
            help="Folders that 'riftberg run' made; sweep.nc#3 is member 3 of a sweep, openberg.nc#3 trajectory 3 of OpenDrift.",
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for comparison.json and tracks.png.")
    ] = None,
    observed: Annotated[
        Path | None,
        typer.Option("--observed", help="Observed positions (CSV).  [default: those of A68a, for its runs]"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare runs: how far apart they are by time, break-ups, bonds, and the distance from observed positions."""
    if output is not None:
        check_folder(output, PICTURES)
    result = comparison(runs, short_names(runs), observed)
    if as_json:
        tell(json.dumps(result.as_dict(), indent=1))
    else:
        show(result)
    if output is not None:
        from riftberg.viz.score import draw_compared

        with results_folder(output, PICTURES, locked=PICTURES):
            written = [
                result.write(output / PICTURES[0]), draw_compared(result.runs, result.fixes, output / PICTURES[1])
            ]  # fmt: skip
        say("Written: " + ", ".join(str(path) for path in written))


def short_names(runs: Sequence[Path]) -> list[str]:
    """Return short names that differ: the names of the folders, or their paths where two names are the same."""
    short = [run_folder(run).name if is_folder(run) or run.name == "run.nc" else run.name for run in runs]
    return short if all(short) and len(set(short)) == len(short) else [str(run) for run in runs]


def split_member(run: Path) -> tuple[Path, int] | None:
    """Return the sweep and the number of a member, such as of ``sweep.nc#3``; None for a run."""
    path, mark, number = str(run).rpartition("#")
    if not mark or run.exists() or not Path(path).exists():
        return None
    if not number.isdecimal():
        raise InputError(
            f"no member {number}", where=str(run), remedy="They are counted from 0: sweep.nc#3 is the fourth"
        )
    return Path(path), int(number)


def run_folder(run: Path) -> Path:
    """Return the folder of a run, which may be named by its run file."""
    if not is_folder(run) and run.suffix == ".nc" and run.name != "run.nc":
        raise InputError(
            "not the run.nc of a run", where=str(run), remedy="Name folders that 'riftberg run' made, with summary.json"
        )
    return run if is_folder(run) or run.suffix != ".nc" else run.parent


def comparison(runs: Sequence[Path], names: Sequence[str], observed: Path | None = None) -> Comparison:
    """Read runs and members of sweeps, and put them side by side."""
    from riftberg.diagnostics.compare import compare, compare_member, compare_run, compare_trajectory
    from riftberg.runs.opendrift import only_one, trajectories_if_any

    drifted = {
        run: only_one(trajectories, run) for run in runs if (trajectories := trajectories_if_any(run)) is not None
    }
    for run in runs:
        if run not in drifted and not split_member(run):
            check_file(run_folder(run) / "run.nc", missing="no run.nc", remedy="Name folders that 'riftberg run' made")
    with ExitStack() as stack:
        results = {run: stack.enter_context(opened_result(run)) for run in dict.fromkeys(runs) if run not in drifted}
        if runs[0] in drifted:
            known_event = _known_event("", drifted[runs[0]].start, observed)
        else:
            first = results[runs[0]]
            start = first["time"].values[0].astype("datetime64[s]").item()
            known_event = _known_event(str(first.attrs.get("experiment", "")), start, observed)
        compared = [
            compare_trajectory(drifted[run], name, known_event.fixes)
            if run in drifted
            else compare_member(results[run], name, known_event.fixes)
            if split_member(run)
            else compare_run(run_folder(run), results[run], name, known_event.fixes)
            for run, name in zip(runs, names, strict=True)
        ]
    begin, end = (pick(pick(run.course.times) for run in compared) for pick in (min, max))
    event = known_event.within(begin, end)
    if observed is not None and not event.fixes:
        raise InputError(
            "no position during the runs", where=f"--observed {observed}",
            remedy=f"They go from {minute_text(begin)} to {minute_text(end)}",
        )  # fmt: skip
    return compare(compared, event)


def opened_result(run: Path) -> xr.Dataset:
    """Return a run, or a member of a sweep."""
    from riftberg.ensembles.result import open_sweep
    from riftberg.runs.accessor import own_dates
    from riftberg.runs.run_file import open_run

    member = split_member(run)
    if member is None:
        return open_run(run_folder(run))
    sweep = open_sweep(member[0])
    if member[1] not in sweep["member"].values:
        count = sweep.sizes["member"]
        raise InputError(f"no member {member[1]}", where=str(run), remedy=f"It has {count}, counted from 0")
    member_data = sweep.sel(member=member[1])
    return member_data.assign_coords(time=own_dates(member_data)).drop_vars("start_after", errors="ignore")


def _known_event(experiment: str, start: datetime, observed: Path | None) -> RealEvent:
    """Return the observed event that the first run simulates, by its experiment and start."""
    from riftberg.diagnostics.compare import RealEvent, set_hours
    from riftberg.diagnostics.observed import Fix
    from riftberg.experiments.a68a import A68A_OBSERVED, PARTIAL, PUBLISHED, SEEN

    fixes: list[Fix] = []
    if observed is not None:
        fixes = set_hours(load_observed(observed).fixes, start.hour + start.minute / 60.0)
        if not fixes:
            raise InputError("no positions", where=f"--observed {observed}", remedy="Outlines: see riftberg score")
    elif experiment.startswith("a68a"):
        fixes = [
            Fix("A68A", datetime(2020, 12, o.day, 13), False, o.lon, o.lat, o.azimuth, o.area * 1e6)
            for o in A68A_OBSERVED
            if o.day not in PARTIAL
        ]
    if not experiment.startswith("a68a"):
        return RealEvent(fixes=fixes)
    return RealEvent(dict(PUBLISHED), dict(SEEN), fixes)


def show(result: Comparison) -> None:
    """Print the tables: results of the runs, and how far apart they are."""
    from rich.table import Table

    first, *others = (run.name for run in result.runs)
    tables = [(result.columns, result.rows)]
    if others:
        tables.append((["apart", first, *(f"{name} from {first}" for name in others)], result.apart_rows()))
    for columns, rows in tables:
        table = Table()
        for k, name in enumerate(columns):
            table.add_column(name, overflow="fold", no_wrap=k == 0)
        for label, cells in rows:
            table.add_row(label, *cells)
        console(40 + 34 * (len(columns) - 1)).print(table, highlight=False)


@report_errors
def rerun(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN", help="Folder that 'riftberg run' made, or its run.nc; sweep.nc#3 is member 3 of a sweep."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-2]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: NumericsName = None,
    every: Every = None,
    check: Annotated[
        bool, typer.Option("--check", help="Report whether both runs have the same bits, record by record.")
    ] = False,
    map_: Map = True,
    quiet: Quiet = False,
) -> None:
    """Repeat a run from the experiment file that it keeps, with other parameters or another length."""
    from riftberg.runs.derived import STATE_DIGEST
    from riftberg.runs.run_file import open_run

    member, first = split_member(run), run
    if member is None:
        with open_run(run) as dataset:
            attributes, member_settings, has_digest = dict(dataset.attrs), list[str](), STATE_DIGEST in dataset
    else:
        # What a sweep keeps of its command, and what is set for one of its members.
        from riftberg.ensembles.result import varied_values
        from riftberg.experiments.changes import setting

        member_data = opened_result(run)
        run, attributes, member_settings, has_digest = (
            member[0],
            *(dict(member_data.attrs), [setting(name, value) for name, value in varied_values(member_data).items()]),
            False,
        )
    if check and not has_digest:
        raise InputError("keeps no digest of its state", where=str(first), remedy="Name a run that this version made")
    name = Path(str(attributes["experiment"])).stem
    folder = output_folder(output, name if member is None else f"{name}-member-{member[1]}")
    more = [argument for option, values in (("--set", [*member_settings, *(settings or ())]), ("--without", without))
            for value in values or () for argument in (option, value)]  # fmt: skip
    more += [word for word, is_set in (("--no-map", not map_), ("--quiet", quiet)) if is_set]
    single = {"--days": days, "--numerics": numerics, "--every": every}
    run_again(run, attributes, folder, more, {option: str(v) for option, v in single.items() if v is not None}, data)
    if check:
        _compare_digests(first, folder)


def _compare_digests(first: Path, second: Path) -> None:
    """Say whether two runs have the same bits at the times that both record; exits with 1 where they have not."""
    import numpy as np

    from riftberg.runs.derived import STATE_DIGEST
    from riftberg.runs.run_file import open_run

    with open_run(first) as a, open_run(second) as b:
        times, *rows = np.intersect1d(a["time"].values, b["time"].values, return_indices=True)
        digests = (run[STATE_DIGEST].values[..., row].ravel() for run, row in zip((a, b), rows, strict=True))
        other = np.flatnonzero(np.not_equal(*digests))
    if other.size:
        tell(f"Other bits from {minute_text(times[other[0]])} on, record {other[0] + 1} of {times.size}")
        raise typer.Exit(1)
    tell(f"The same bits in all {times.size} records")


def run_again(
    run: Path, attributes: Mapping[str, str], folder: Path, more: Sequence[str], single: Mapping[str, str],
    data: Path | None = None,
) -> None:  # fmt: skip
    """Run what a run, or a sweep, keeps of its experiment into a folder.

    ``attributes``: attributes of its file; ``more``: options beside those of its command; ``single``: those that stand once, by
    name; ``data``: folder of data files, by default where they were.
    """
    from riftberg.cli.main import app
    from riftberg.runs.layout import COMMAND, FILE, PLACE

    if COMMAND not in attributes:
        raise InputError(
            "keeps no experiment",
            where=str(run),
            remedy="Name what 'riftberg run' or 'riftberg sweep' made, by this version or a later one",
        )
    _, command, experiment, *words = shlex.split(attributes[COMMAND])
    home = run if run.is_dir() else run.parent
    if folder.resolve() == home.resolve():
        raise InputError(
            "the run that is repeated would be lost", where=f"--output {folder}", remedy="Name another folder"
        )
    if data is None and PLACE in attributes:
        data = Path(os.path.normpath(home / attributes[PLACE]))
    single = {**single, "--output": str(folder), **({} if data is None else {"--data": str(data)})}
    step = _first_step(attributes, home, [*words, *more], single)
    words = [*words_without(words, *single), *step, *more, *(argument for pair in single.items() for argument in pair)]
    file = folder / experiment
    file_existed = FILE in attributes and file.exists()
    if file_existed and file.read_text("utf-8", errors="replace") != attributes[FILE]:
        raise InputError("another experiment has this file", where=str(file), remedy="Name another folder by --output")
    with results_folder(folder):
        if FILE in attributes:
            write_text(file, attributes[FILE])
            experiment = str(file)
            if CUT in attributes[FILE]:
                say(
                    f"Notice: {CUT} in its addresses was cut when it was stored; the whole addresses are read from {ADDRESSES}"
                )
        try:
            say("riftberg " + shlex.join([command, experiment, *words]))
            code = app([command, experiment, *words], standalone_mode=False)
            if code:
                raise typer.Exit(code)
        except BaseException:
            # A run that was stopped on its way goes on from the file.
            if FILE in attributes and not file_existed and not (folder / "run.nc").exists():
                file.unlink(missing_ok=True)
            raise
        if FILE in attributes and not file_existed:  # it lacks what was changed, and the run file keeps both
            file.unlink(missing_ok=True)


def _first_step(
    attributes: Mapping[str, str], home: Path, words: Sequence[str], single: Mapping[str, str]
) -> list[str]:
    """Return the option by which a run takes the time step of the first, unless its steps or records are to be others."""
    from riftberg.experiments.changes import setting
    from riftberg.runs.layout import read_parameters

    parameters = read_parameters(attributes.get("parameters_json"), home)
    given = "--numerics" in single or any(word.startswith("stepping.") for word in words)
    if given or not parameters.stepping.in_equilibrium:
        return []
    step = parameters.time_step
    steps = 3600.0 * float(single.get("--every", "nan")) / step
    divides = math.isnan(steps) or (steps > 0.5 and abs(steps - round(steps)) < 1e-9)
    return ["--set", setting("stepping.time_step", step)] if divides else []


@report_errors
def why(
    run: Run,
    output: OutputBeside = None,
    controls: Annotated[
        bool,
        typer.Option(
            "--controls", help="Repeat the experiment without each of its parts, and with half the time step."
        ),
    ] = False,
    data: Annotated[Path | None, typer.Option("--data", help="Folder of data files, for the controls.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Report every piece, however small.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw why.png.")] = True,
    picture: Format = "png",
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress of the controls.")] = False,
) -> None:
    """Explain why a berg broke: forces on the fragments, load across the cut, the first bonds to fail, and controls."""
    from riftberg.diagnostics.why import explain, reason_lines
    from riftberg.runs.layout import check_recorded
    from riftberg.runs.run_file import open_run
    from riftberg.runs.scene import SMALL

    check_picture_format(picture)
    names = ("why.json", f"why.{picture}") if figure else ("why.json",)
    with open_run(run) as dataset, results_folder(folder_beside(run, output), names, locked=names) as folder:
        check_recorded(dataset, SURROUNDINGS)
        reasons = explain(dataset, smallest=0.0 if everything else SMALL)
        if controls:
            add_controls(run, dataset, reasons, quiet=quiet, data=data)
        if as_json:
            tell(json.dumps(reasons.as_dict(), indent=1))
        else:
            for k, paragraph in enumerate(reason_lines(reasons)):
                tell(paragraph)
                if k < len(reasons.breakups):
                    _print_breakup(reasons.breakups[k])
        written = [reasons.write(folder / "why.json")]
        if figure:
            from riftberg.viz.score import draw_reasons

            written.append(draw_reasons(reasons, folder / f"why.{picture}"))
    say("Written: " + ", ".join(str(path) for path in written))


SURROUNDINGS = ("uo", "vo", "ui", "vi", "ua", "va", "slope_x", "slope_y", "depth", "ice_thickness")
"""Variables of a run file from which the forces on the fragments are computed."""


def add_controls(path: Path, run: xr.Dataset, reasons: Reasons, *, quiet: bool, data: Path | None) -> None:
    """Run the experiment again without each of its parts, and with half the long step; note which break-ups remain.

    ``path``: the run, or its folder; ``data``: folder of data files, by default where they were.
    """
    import numpy as np

    from riftberg.diagnostics.why import control_fate
    from riftberg.experiments import EXPERIMENTS
    from riftberg.runs.layout import COMMAND, run_parameters
    from riftberg.runs.run_file import open_run

    words = shlex.split(str(run.attrs.get(COMMAND, "")))
    components = next((entry.parts for entry in EXPERIMENTS if entry.name in words[2:3]), ())
    left_out = [value for word, value in pairwise(words) if word == "--without"]
    changes = {
        f"without {component}": ["--without", component] for component in components if component not in left_out
    }
    parameters = run_parameters(run)
    stepping = parameters.stepping
    half: dict[str, object] = {"time_step": parameters.time_step / 2.0}
    substeps = getattr(stepping, "substeps", None)
    if substeps is not None and parameters.stepping.has_substeps:  # the sub-step stays
        half["substeps"] = max(1, round(substeps / 2))
    changes["with half the long step"] = [w for name in half for w in ("--set", f"stepping.{name}={half[name]}")]
    days = float((run["time"].values[-1] - np.datetime64(run.attrs["start"])) / np.timedelta64(1, "s")) / 86400.0
    with TemporaryDirectory(prefix="riftberg-controls-") as scratch:
        for number, (change, more) in enumerate(changes.items()):
            if not quiet:
                say(f"Control {change}:")
            folder = Path(scratch) / str(number)
            with redirect_stdout(StringIO()):  # the results of the controls are in what is told of the break-ups
                more = [*more, "--no-map", *(["--quiet"] if quiet else [])]
                run_again(path, run.attrs, folder, more, {"--days": repr(days)}, data)
            with open_run(folder) as control:
                for breakup in reasons.breakups:
                    breakup.controls[change] = control_fate(breakup, control)


def _print_breakup(b: Breakup) -> None:
    """Print the budget and the load of one break-up as tables."""
    from rich.table import Table

    table = Table(title=f"Fragment {b.fragment}: forces at {minute_text(b.decisive.time)}")
    table.add_column("force", no_wrap=True)
    for column in (
        "on it, GN east",
        "north",
        "on the rest, GN east",
        "north",
        "cut: tension GN",
        "couple TN m",
        "stress kPa",
    ):
        table.add_column(column, justify="right")
    load = b.decisive
    for name in load.stress:
        sides = [component / 1e9 for k in ("fragment", "rest") for component in b.budgets[k].forces[name]]
        across = (load.tension[name] / 1e9, load.couple[name] / 1e12, load.stress[name] / 1e3)
        if not any((*sides, *across)):
            continue
        table.add_row(name, *(f"{v:+.3f}" for v in (*sides, *across)))
    table.add_section()
    for title, name in (("inertia", "inertia"), ("through the cut", "residual")):
        pair = [getattr(b.budgets[k], name) for k in ("fragment", "rest")]
        if pair[0] is not None and pair[1] is not None:
            table.add_row(title, *(f"{v / 1e9:+.3f}" for p in pair for v in p), "", "", "")
    recorded = ["", "", ""]
    if load.tension_recorded is not None and load.couple_recorded is not None:
        recorded = [f"{load.tension_recorded / 1e9:+.3f}", f"{load.couple_recorded / 1e12:+.3f}", ""]
    total = (sum(load.tension.values()) / 1e9, sum(load.couple.values()) / 1e12, load.nominal / 1e3)
    table.add_row("all, if rigid", "", "", "", "", *(f"{v:+.3f}" for v in total))
    table.add_row("recorded", "", "", "", "", *recorded)
    console(120).print(table)


@report_errors
def score(
    run: Run,
    observed: Annotated[
        Path,
        typer.Argument(
            metavar="OBSERVED",
            help="Outlines (GeoJSON, KML, shapefile, CSV, masks in NetCDF) or tracks (BYU/NIC and other CSV).",
        ),
    ],
    output: OutputBeside = None,
    hour: Annotated[
        float | None,
        typer.Option(
            "--hour", min=0.0, max=24.0, help="Hour (UTC) for days without a time.  [default: that of the start]"
        ),
    ] = None,
    date: Annotated[
        str | None,
        typer.Option("--date", "-d", help="Date of outlines whose file gives none (KML, shapefile, NetCDF)."),
    ] = None,
    variable: Annotated[
        str | None, typer.Option("--variable", help="Name of the mask variable, in a NetCDF file that has several.")
    ] = None,
    between: Annotated[str | None, typer.Option("--between", metavar="FIRST,LAST", help="Dates to compare.")] = None,
    together: Annotated[
        str | None,
        typer.Option(
            "--together",
            metavar="N,N,...",
            help="Fragments that make up the berg, instead of matching them automatically.",
        ),
    ] = None,
    interpolated: Annotated[bool, typer.Option("--interpolated", help="Include interpolated positions.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw score.png.")] = True,
    picture: Format = "png",
) -> None:
    """Compare a run with observations, day by day: distance, heading, area, overlap, fragments."""
    from riftberg.diagnostics.score import score_run
    from riftberg.runs.run_file import open_run
    from riftberg.viz.plots import figure_title

    check_range(hour, "--hour", 0.0, 24.0)
    check_picture_format(picture)
    names = ("score.json", f"score.{picture}") if figure else ("score.json",)
    with open_run(run) as dataset, results_folder(folder_beside(run, output), names, locked=names) as folder:
        seen = load_observed(observed, date=date, variable=variable)
        result = score_run(
            dataset, seen, hour=hour, between=_span(between), together=_numbers(together), interpolated=interpolated
        )
        title = figure_title(dataset, f"run against {observed.name}")
        if as_json:
            tell(json.dumps(result.as_dict(), indent=1))
        else:
            out = console(120)
            out.print(score_table(result))
            if len(result.days) > MOST_SHOWN:
                out.print(f"and {len(result.days) - MOST_SHOWN} times more, see score.json")
            for line in (sentence(result), *result.melt):
                out.print(line, highlight=False)
        written = [result.write(folder / "score.json")]
        if figure:
            from riftberg.runs.background import stored_water
            from riftberg.viz.score import draw_score

            water = stored_water(dataset)
            written.append(draw_score(result, folder / f"score.{picture}", title=title, water=water))
    say("Written: " + ", ".join(str(path) for path in written))


def _span(text: str | None) -> tuple[datetime, datetime] | None:
    span = dates(text, "--between")
    if span is None:
        return None
    first, last = span
    # A day alone is meant to its end.
    return first, last + timedelta(days=1, seconds=-1) if last.time() == last.min.time() else last


def _numbers(text: str | None) -> list[int]:
    try:
        return [int(word) for word in (text or "").split(",") if word.strip()]
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} are no numbers", where="--together", remedy="For example --together 1,6"
        ) from error


MOST_SHOWN = 500
"""Most times in a table."""


def score_table(result: Score) -> Table:
    """Return the table of a score."""
    days = table(
        f"Run against {result.observed}",
        ("time", "piece", "fragments", "distance km", "azimuth", "observed", "diff", "area km2", "observed", "IoU"),
        texts=("time", "piece", "fragments"),
    )
    for day in result.days[:MOST_SHOWN]:
        for k, match in enumerate(day.matches):
            days.add_row(
                minute_text(day.time) if k == 0 else "",
                *_match_cells(match),
                style="bold" if match is day.berg else "",
            )
    return days


def _match_cells(m: Match) -> list[str]:
    def text(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    return [
        m.observed, ", ".join(map(str, m.fragments)) or "none", text(m.distance_km, ".1f"), text(m.azimuth, ".0f"),
        text(m.azimuth_observed, ".0f"), text(m.azimuth_difference, "+.0f"), text(m.area_km2, ".0f"),
        text(m.area_observed_km2, ".0f"), text(m.iou, ".2f"),
    ]  # fmt: skip


def sentence(result: Score) -> str:
    """Return the summary in a sentence."""
    s = result.summary()
    if not s["days"]:
        return "The berg itself was not observed during the run."
    phrases = [f"centroid {s['distance_km_rms']:.1f} km off (rms; at most {s['distance_km_max']:.1f} km)"]
    if s["azimuth_rms"] is not None:
        phrases.append(f"long axis {s['azimuth_rms']:.0f} degrees off (rms)")
    if s["area_ratio_mean"] is not None:
        phrases.append(f"area {s['area_ratio_mean']:.2f} of the observed one")
    if s["iou_mean"] is not None:
        phrases.append(f"overlap {s['iou_mean']:.2f}")
    return f"{count_text(s['days'], 'time')}: " + ", ".join(phrases) + "."
