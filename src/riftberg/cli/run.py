"""``riftberg run``: build an experiment, run it, write run.nc, summary.json and map.png. ``riftberg kid``: a folder of KID."""

from __future__ import annotations

import logging
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer

from riftberg.cli.options import (
    EXIT_INTERRUPTED,
    Data,
    Days,
    Every,
    Map,
    Names,
    NumericsName,
    Quiet,
    Settings,
    Without,
    announce_compilation,
    check_folder,
    check_output,
    check_positive,
    check_range,
    make_options,
    named_files,
    output_folder,
    report_errors,
    results_folder,
    say,
    tell,
    words_without,
)
from riftberg.errors import InputError, RiftbergError, RunError
from riftberg.experiments import EXPERIMENTS, Info, Numerics, Options
from riftberg.system.atomic_files import refusal
from riftberg.system.input_files import allow_extreme, allow_large, check_file, is_folder, shown
from riftberg.system.process import held

if TYPE_CHECKING:
    from riftberg.model import Recorder
    from riftberg.parameters import Parameters
    from riftberg.runs.model import Model
    from riftberg.runs.progress import Stopwatch
    from riftberg.runs.tracks import DailyTrack


RESULTS: Final = ("run.nc", "summary.json", "map.png", "bergs-monthly.nc", "bergs-instantaneous.nc")
"""Files that a run may write into its folder."""

KEEP_MINUTES: Final = 10.0
"""Minutes of computing between two states that are kept on the way; shorter runs keep none."""

KEPT_APART: Final = ("--output", "-o", "--resume", "--data", "--keep-days", "--keep-minutes", "--set", "-s")
"""Options that belong to one run and not to its experiment, or that its file keeps in another way."""

MOST_EVENTS: Final = 10
"""Break-ups, and collisions, that have a line each."""

MOST_BERGS: Final = 6
"""Bergs that have a line of results each; of more, the areas are listed."""

DRIFTED: Final = "drifted"

STILL: Final = 1.0
"""Drift (m) below which a berg has stayed: its direction means nothing."""

BOTH: Final[tuple[Numerics, ...]] = ("reference", "own")


@report_errors
def run(
    context: typer.Context,
    experiment: Annotated[
        str, typer.Argument(help="A built-in experiment (see 'riftberg experiments') or a YAML file.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME]")
    ] = None,
    settings: Settings = None,
    days: Days = None,
    data: Data = None,
    without: Without = None,
    numerics: NumericsName = None,
    fetch: Annotated[
        bool, typer.Option("--fetch", help="Download missing data files first (a68a-paper: 1.3 GB, a68a-oras5: 8 MB).")
    ] = False,
    grid: Annotated[
        float | None,
        typer.Option(
            "--grid",
            help="Interpolate data files to a grid with cells of this width (degrees).  [default: their own grids]",
        ),
    ] = None,
    names: Names = None,
    every: Every = None,
    forces: Annotated[
        bool, typer.Option("--forces", help="Write the mean force of each medium between records.")
    ] = False,
    cells: Annotated[
        float | None,
        typer.Option(
            "--cells", help="Write fresh water, heat and mass on cells of this width (degrees), monthly and daily."
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            help="Restart the run in a folder from its last good state, or start from a restart file in another folder.",
        ),
    ] = None,
    keep_days: Annotated[
        float | None, typer.Option("--keep-days", help="Simulated days between the states saved for --resume.")
    ] = None,
    keep_minutes: Annotated[
        float,
        typer.Option("--keep-minutes", help="Minutes of computing between the states saved for --resume; 0 for none."),
    ] = KEEP_MINUTES,
    map_: Map = True,
    quiet: Quiet = False,
    large: Annotated[
        bool,
        typer.Option(
            "--allow-large",
            help="Allow very large numbers of elements, steps or bytes, which are usually a slip of units.",
        ),
    ] = False,
) -> None:
    """Run an experiment and write run.nc, summary.json and map.png."""
    with allow_large(large):
        errors, plain = split_settings(settings or [])
        single_numerics = None if numerics == "both" else numerics
        options = make_options(plain, days, data, without, single_numerics, fetch, grid)
        if names is not None:
            options = replace(options, files=named_files(experiment, names, data))
        check_positive(every, "--every", "hours", most=1e6)
        check_positive(keep_days, "--keep-days", "days", most=1e6)
        check_range(keep_minutes, "--keep-minutes", 0.0, 1e6)
        words = ["riftberg", *context.find_root().obj]
        run_options = RunOptions(
            output,
            every,
            forces,
            map_,
            quiet,
            cells,
            keep_days,
            keep_minutes,
            words,
            experiment,
            data,
            settings or [],
            errors,
        )
        if output is not None:
            check_folder(output, RESULTS)
        announce_compilation(quiet)
        if numerics == "both":
            _run_both(experiment, options, run_options, resume)
        else:
            _run_one(experiment, options, run_options, resume)


class RunOptions(NamedTuple):
    """Output and display options of a run, as given on the command line."""

    output: Path | None  # Folder of the results
    every: float | None  # Hours between records; None for those of the experiment
    forces: bool  # Write the mean force of each medium
    draw: bool  # Draw a map at the end
    quiet: bool  # Show no progress
    cells: float | None  # Width (degrees) of the cells of the gridded output; None for none
    keep_days: float | None  # Simulated days between two states that are kept
    keep_minutes: float  # The same in minutes of computing
    words: list[str]  # The command line
    experiment: str  # As named there
    data: Path | None  # Folder of data files
    settings: Sequence[str]  # What was set
    errors: Mapping[str, Any] = {}  # What of it is no parameter: the start, and errors of the surroundings, by name

    def extend_info(self, info: Info) -> Info:
        """Return an experiment with the files that the command line requests."""
        cells = info.output_cells if self.cells is None else self.cells
        return replace(info, output_forces=info.output_forces or self.forces, output_cells=cells)

    def hours(self, info: Info) -> float:
        """Return the hours between records of an experiment."""
        return info.output_every_hours if self.every is None else self.every

    def origin(self, folder: Path) -> dict[str, str]:
        """Return the attributes by which a run file in a folder keeps its command, for ``riftberg rerun``."""
        from riftberg.experiments.changes import origin

        ignored = ("--map", "--no-map", "--quiet", "-q", "--verbose", "-v", "-vv", self.experiment)
        words = [word for word in words_without(self.words, *KEPT_APART)[2:] if word not in ignored]
        return origin(self.experiment, words, self.settings, self.data, folder)


def split_settings(settings: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    """Return the settings of errors in the start and the surroundings, checked, by name; and the other settings."""
    if not settings:
        return {}, []
    from riftberg.ensembles.uncertain import UNCERTAIN, is_uncertain
    from riftberg.experiments.changes import parse_settings

    error_settings = [setting for setting in settings if is_uncertain(setting.partition("=")[0].strip())]
    checked = parse_settings(error_settings, {group: (kind,) for group, kind in UNCERTAIN.items()})
    errors = {f"{group}.{name}": value for group, inner in checked.items() for name, value in inner.items()}
    return errors, [setting for setting in settings if setting not in error_settings]


def _run_one(experiment: str, options: Options, run_options: RunOptions, resume: Path | None) -> None:
    from riftberg.experiments.changes import format_settings

    goes_on = resume is not None and is_folder(resume)
    if goes_on and run_options.output not in (None, resume):
        raise InputError(
            f"the run in {shown(resume)} goes on there",
            where="--output",
            remedy="Leave --output out, or name a file to resume",
        )
    model, info, parameters = build_run(experiment, options, resume, run_options)
    info = run_options.extend_info(info)
    _print_notices(info, model, options, run_options)
    # A state knows the parameters that were set for it, and takes no others.
    old, new = (p.model_dump(mode="json") for p in (parameters, model.parameters))
    changed = {
        g: {name: value for name, value in values.items() if value != old.get(g, {}).get(name)}
        for g, values in new.items()
    }
    run_options = run_options._replace(settings=[*run_options.settings, *format_settings(changed)])
    folder = resume if goes_on and resume is not None else output_folder(run_options.output, info.name)
    placed = goes_on or run_options.output is not None
    session = Session(model, info, folder, run_options, placed=placed, goes_on=goes_on)
    session.run_and_report(options.days if options.days is not None else info.days)


def _run_both(experiment: str, options: Options, run_options: RunOptions, resume: Path | None) -> None:
    """Run an experiment with both numerics and show them side by side."""
    from riftberg.cli.compare import comparison, show

    if resume is not None:
        raise InputError("two runs cannot go on from one state", where="--resume", remedy="Resume them one by one")
    folders: list[Path] = []
    folder = run_options.output
    words = words_without(run_options.words, "--numerics")
    for numerics in BOTH:
        chosen = replace(options, numerics=numerics)
        model, info = _build_model(experiment, chosen, run_options)
        info = run_options.extend_info(info)
        if not folders:
            _print_notices(info, model, chosen, run_options)
        folder = folder or output_folder(None, f"{info.name}-both", "comparison.json")
        folders.append(folder / numerics)
        options_of_run = run_options._replace(words=[*words, "--numerics", numerics])
        session = Session(model, info, folders[-1], options_of_run, placed=True)
        session.run_and_report(options.days if options.days is not None else info.days)
    assert folder is not None
    table = comparison(folders, BOTH)
    show(table)
    files = [table.write(folder / "comparison.json")]
    if run_options.draw:
        from riftberg.viz.score import draw_compared

        files.append(draw_compared(table.runs, table.fixes, folder / "tracks.png"))
    tell(f"Written to {folder}: {', '.join(path.name for path in files)}")


def _print_notices(info: Info, model: Model, options: Options, run_options: RunOptions) -> None:
    """Print notices before the run: how the requested berg was built, and doubtful inputs."""
    if info.loses:  # a notice, which --quiet leaves
        say(f"Notice: {info.made}")
    elif info.made and not run_options.quiet:
        say(info.made)
    for notice in collect_notices(info, model, options, run_options.hours(info)):
        say(f"Notice: {notice}")


def collect_notices(info: Info, model: Model, options: Options, hours: float) -> list[str]:
    """Return notices before a run, a sentence each."""
    from riftberg.config.usual_ranges import of_length, of_records

    left = (info.days if options.days is None else options.days) - model.time / 86400.0
    of_end = of_length(left, model.parameters)
    return [*info.notices, *getattr(model, "notices", ()), *of_end, *of_records(hours, left, model.parameters)]


def check_start(model: Model, days: float, every_hours: float) -> None:
    """Refuse a run that cannot start: ``riftberg doctor`` calls ready exactly the runs that ``riftberg run`` takes.

    Raises
    ------
    InputError
        Naming the obstacle.
    """
    step = model.parameters.time_step / 3600.0
    if every_hours < step * (1.0 - 1e-9):
        raise InputError(
            f"a record every {every_hours:g} h, but the long step is {step:g} h", where="--every (output_every_hours)",
            remedy=f"Give {step:g} or more, or a shorter stepping.time_step",
        )  # fmt: skip
    if days - model.time / 86400.0 <= 0.0:
        raise InputError(f"the state is already {model.time / 86400.0:g} days old", where="--days",
                         remedy=f"Give more than that; now it is {days:g}")  # fmt: skip
    model.check(days - model.time / 86400.0)


def experiments() -> None:
    """List the built-in experiments."""
    width = max(len(entry.name) for entry in EXPERIMENTS)
    for entry in EXPERIMENTS:
        options_text = f"  (--without {' | '.join(entry.parts)})" if entry.parts else ""
        tell(f"{entry.name:{width}}  {entry.summary}{options_text}")


def _free_folder(folder: Path) -> Path:
    """Return a folder beside one, that holds nothing yet: the files of the part that was run stay as they are."""
    number = 2
    while (free := folder.with_name(f"{folder.name}-{number}")).exists():
        number += 1
    return free


def _build_model(experiment: str, options: Options, run_options: RunOptions) -> tuple[Model, Info]:
    """Return the model of an experiment at its start, with the errors that were set and a step that divides its records."""
    from riftberg.experiments import build

    model, info = build(experiment, options)
    if run_options.errors:
        from riftberg.ensembles.uncertain import with_errors

        model = with_errors(model, run_options.errors)
    model.fit_time_step(3600.0 * run_options.hours(info))
    return model, info


def build_run(
    experiment: str, options: Options, resume: Path | None, run_options: RunOptions
) -> tuple[Model, Info, Parameters]:
    """Return the model at its start or where it goes on, and the parameters of the experiment."""
    if resume is None:
        model, info = _build_model(experiment, options, run_options)
        return model, info, model.parameters
    if options.changes:
        raise InputError(
            "a resumed run keeps the parameters of its restart file", where="--set", remedy="Leave --set out"
        )
    from riftberg.runs.model import Model, last_good
    from riftberg.runs.restart import check_same_run, load_state

    if not is_folder(resume):
        check_file(resume, remedy="Name a restart file that Riftberg wrote (*.restart.nc), or the folder of a run")
    fresh, info = _build_model(experiment, options, run_options)
    if is_folder(resume):
        interval = 3600.0 * run_options.hours(info)
        resume = last_good(
            resume, interval, lambda state, path: check_same_run(state, fresh, path, experiment=experiment)
        )
        if not run_options.quiet:
            say(f"Going on from {resume}")
    else:
        check_same_run(load_state(resume), fresh, resume, experiment=experiment)
    return Model.resume(resume, fresh.forcing), info, fresh.parameters


@dataclass
class Session:
    """One run from the command line."""

    model: Model  # At its start
    info: Info  # Of the experiment
    folder: Path  # Where the results go
    run_options: RunOptions
    placed: bool = False  # The folder was given
    goes_on: bool = False  # The run in the folder goes on
    step: Callable[[], object] | None = None  # Takes the model on, where that is not its own step
    gridded: list[Path] = field(default_factory=list)
    track: DailyTrack | None = None
    stopwatch: Stopwatch | None = None

    def run_and_report(self, days: float) -> None:
        """Run and report in a folder of its own, which is not left behind by a run that was refused."""
        hours = self.run_options.hours(self.info)
        check_start(self.model, days, hours)
        needed = self._size(days, hours)
        with results_folder(self.folder, RESULTS, needed=needed, locked=["summary.json"]):
            self.run(days, hours)
            self.report(draw=self.run_options.draw)

    def _size(self, days: float, every_hours: float) -> float:
        """Return the disk space (bytes) that the run takes beyond the files in its folder, about.

        What is written goes into a copy of the run file; of the states that are kept there are two, and one more while it is
        written.
        """
        from riftberg.runs.derived import force_variables
        from riftberg.runs.layout import element_history
        from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES

        elements, bonds = len(self.model.elements.id), len(self.model.bonds.first)
        records = days * 24.0 / every_hours
        histories = len(element_history()) + (len(force_variables()) if self.info.output_forces else 0)
        # Compression leaves half of the single precision; the ledgers, in double precision, have some 300 bytes a record.
        record = 0.5 * 4.0 * (histories * elements + 3.0 * bonds) + 300.0
        state = 8.0 * (elements * len(ELEMENT_VARIABLES) + bonds * len(BOND_VARIABLES))
        # Names, units and checksums of its variables take 400 kB of a run file, and 140 kB of a restart file.
        existing = self.folder / "run.nc"
        return (
            2.0 * (records * record + 4e5)
            + 3.0 * (state + 1.4e5)
            - (existing.stat().st_size if existing.is_file() else 0.0)
        )

    def run(self, days: float, every_hours: float) -> None:
        """Run to ``days`` after the start of the experiment; save the state where that fails or is interrupted."""
        from riftberg.runs.model import StateKeeper
        from riftberg.runs.progress import ProgressRecorder, Stopwatch
        from riftberg.runs.run_file import RunWriter
        from riftberg.runs.tracks import DailyTrack

        remaining = days - self.model.time / 86400.0
        self.track, self.stopwatch = DailyTrack(), Stopwatch()
        writer = RunWriter(
            self.folder / "run.nc",
            every_hours=every_hours,
            experiment=self.info.name,
            seed=self.info.seed,
            forces=self.info.output_forces,
            goes_on=self.goes_on,
            origin={"heading": self.info.title or self.info.name, **self.run_options.origin(self.folder)},
        )
        keeper = StateKeeper(writer, every_days=self.run_options.keep_days, minutes=self.run_options.keep_minutes)
        recorders: list[Recorder] = [
            writer,
            self.track,
            self.stopwatch,
            ProgressRecorder(remaining, quiet=self.run_options.quiet),
        ]
        if self.info.output_cells is not None:
            recorders.append(self._cell_recorder(self.info.output_cells, every_hours))
        first_step = self.model.step_number
        if not self.run_options.quiet:
            say(berg_line(self.model))
        try:
            with held():  # also while the state is saved and reported after an interrupt
                self._advance(remaining, [*recorders, keeper])
            keeper.remove()
        except typer.Exit:
            raise
        except RiftbergError as error:
            if self.model.step_number == first_step and not isinstance(error, RunError):
                raise  # refused before the first step: there is nothing to save
            if self.model.step_number == first_step:
                writer.discard()
                raise RunError(f"the run failed in its first step: {error}. Nothing was written") from error
            raise RunError(f"the run failed at {self._date()}: {error}. {self._save_state('failed')}") from error
        except Exception:
            if self.model.step_number == first_step:
                writer.discard()
                raise
            say(f"The run failed at {self._date()}. {self._save_state('failed')}")
            raise

    def _cell_recorder(self, width: float, every_hours: float) -> Recorder:
        """Return the recorder of fresh water, heat and mass on cells."""
        from riftberg.coupling.gridded import GridRecorder

        # Cells are written daily, or as often as the run is recorded where that is less.
        hours = max(24.0, every_hours)
        recorder = GridRecorder(self.folder / "bergs", width, every_hours=hours, goes_on=self.goes_on)
        self.gridded = [recorder.path.with_name(name) for name in recorder.names()]
        return recorder

    def _advance(self, days: float, recorders: list[Recorder]) -> None:
        try:
            self.model.advance(days, recorders=recorders, step=self.step)
        except (KeyboardInterrupt, SystemExit) as error:
            say(f"Interrupted at {self._date()}. {self._save_state('interrupted')}")
            self.report(draw=False)
            raise typer.Exit(getattr(error, "code", EXIT_INTERRUPTED)) from error

    def _date(self) -> str:
        return f"{self.model.date:%Y-%m-%d %H:%M} (day {self.model.time / 86400.0:.2f})"

    def _save_state(self, why: str) -> str:
        """Save the state and say how to go on."""
        from riftberg.experiments.changes import setting

        try:
            path = self.model.save(self.folder / f"{why}.restart.nc")
        except (OSError, RiftbergError) as error:  # it must not hide why the run ended
            return f"The state cannot be saved ({refusal(error)})"
        # The restart file knows the parameters; the files of the part that was run stay as they are.
        words = words_without(self.run_options.words, "--output", "-o", "--resume", "--set", "-s")
        words += [word for name, value in self.run_options.errors.items() for word in ("--set", setting(name, value))]
        output_words = ["--output", str(_free_folder(self.folder))] if self.placed else []
        return f"Go on with: {shlex.join([*words, *output_words, '--resume', str(path)])}"

    def report(self, *, draw: bool = True) -> None:
        """Write summary and map, and print the summary."""
        from riftberg.diagnostics.summary import summarize
        from riftberg.system.atomic_files import write_json

        rows = self.track.rows if self.track else ()
        summary = summarize(self.model, experiment=self.info.name, track=rows, stopwatch=self.stopwatch)
        write_json(summary, self.folder / "summary.json")
        files = ["run.nc", "summary.json", *(path.name for path in self.gridded if path.exists())]
        if draw:
            from riftberg.runs.run_file import open_own
            from riftberg.viz.coast import ice_over_land
            from riftberg.viz.map import draw_map

            with open_own(self.folder / "run.nc") as dataset:
                draw_map(
                    dataset, self.folder / "map.png", forcing=self.model.forcing, title=self.info.title,
                    observed=self.info.observed,
                )  # fmt: skip
                if ashore := ice_over_land(dataset):
                    say(f"Notice: {ashore}")
            files.append("map.png")
        for line in short_summary(summary):
            tell(line)
        for line in ledger_lines(summary):
            logging.getLogger(__name__).info(line)
        tell(f"Written to {self.folder}: {', '.join(files)}")


def berg_line(model: Model) -> str:
    """Return size and place of the berg of a model in one line: swapped coordinates show there before the run."""
    import numpy as np

    from riftberg.config.units import area_text, count_text, place_text
    from riftberg.engines.common.fragments.tree import centroid

    e = model.elements
    lon, lat = centroid(e.lon, e.lat, e.mass, model.parameters.earth.period)
    position = place_text(lon, lat, latlon=model.parameters.earth.latlon)
    count = len(np.unique(e.berg))
    names = [name for name, _ in getattr(model.fragments, "bergs", ())]
    area = float((e.length * e.width).sum())
    size = f"{area / 1e6:.6g} km2" if area >= 1e4 else area_text(area)
    if len(names) > 1:
        listed = ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])} and {len(names) - 5} more"
        return f"{len(names)} bergs ({listed}): {len(e.lon)} elements, {size}, centred at {position}"
    pieces = f"{count_text(count, 'piece')}"
    return f"Berg{''.join(' ' + n for n in names)}: {len(e.lon)} elements, {size} in {pieces} at {position}"


def short_summary(summary: dict[str, Any]) -> list[str]:
    """Return a summary in a few lines."""
    from riftberg.config.units import area_text, count_text, duration_text, minute_text, place_text
    from riftberg.runs.groundings import ground_lines, standing_lines

    latlon, breakups, bergs = summary["numerics"]["earth"]["latlon"], summary["breakups"], summary.get("bergs", [])
    collisions, short = summary.get("collisions", []), summary["days"] < 1.0
    length = duration_text(summary["days"]) + ("" if short else f" to {minute_text(summary['end'])}")
    # Of a run of less than a day no speed, but how long it took.
    speed, unit = (summary.get("wall_seconds"), "of computing") if short else (summary["seconds_per_day"], "per day")
    lines = [
        f"{summary['experiment'] or 'run'}: {length}, {summary['elements']} elements, {summary['bonds_broken']} of "
        f"{summary['bonds_total']} bonds broken" + ("" if speed is None else f", {speed:.3g} s {unit}")
    ]
    events = []
    for event in breakups[:MOST_EVENTS]:
        whom = f"{event['parent_name']} " if event.get("parent_name") else ""
        bonds = f"{count_text(event['bonds'], 'bond')}"
        text = f"{area_text(1e6 * event['area_km2'])} broke off {whom}{'aground' if event['grounded'] else 'afloat'} ({bonds})"
        events.append((event, text))
    events += [
        (event, f"{' and '.join(event['bergs'])} met at {event['speed']:.2g} m/s,")
        for event in collisions[:MOST_EVENTS]
    ]
    for event, text in sorted(events, key=lambda item: item[0]["time"]):
        lines.append(
            f"  {minute_text(event['time'])}  {text} at {place_text(event['lon'], event['lat'], latlon=latlon)}"
        )
    for word, all_of_them in (("break-ups", breakups), ("collisions", collisions)):
        if len(all_of_them) > MOST_EVENTS:
            lines.append(f"  and {len(all_of_them) - MOST_EVENTS} more {word}, see summary.json")
    ground = summary.get("ground") or {"stays": [], "first": None, "least_clearance": None, "bathymetry_spacing": None}
    # A beam under its load goes nowhere: it bends.
    verb = "bent: its centre moved" if summary["numerics"].get("stepping", {}).get("only_interactions") else DRIFTED
    if berg_lines := _berg_lines(bergs, latlon, ground["stays"], verb):
        told = {berg["largest"] for berg in bergs}
        others_stand = any(stay["lasts"] and stay["number"] not in told for stay in ground["stays"])
        return [*lines, *berg_lines, *(standing_lines(ground) if others_stand else []), *ground_lines(ground)]
    count, many_bergs = summary["fragments"], len(bergs) > 1
    of_bergs = f" of {len(bergs)} bergs" if many_bergs else ""
    pieces = f"{count_text(count, 'fragment')}{of_bergs}"
    if many_bergs and not breakups:
        pieces = f"{count} bergs" if count == len(bergs) else f"{count}{of_bergs}"
    pieces_line = f"  {pieces} at the end: {_areas(summary['areas_km2'], count)}"
    return [*lines, pieces_line, *standing_lines(ground), *ground_lines(ground)]


def ledger_lines(summary: dict[str, Any]) -> list[str]:
    """Return the ledgers of ice, heat, momentum and energy, which --verbose shows."""
    ice, motion = summary.get("ledger") or {}, summary.get("motion") or {}
    return [*ice.get("lines", ()), *motion.get("lines", ()), *([motion["closing"]] if motion else [])]


def _berg_lines(bergs: list[dict[str, Any]], latlon: bool, stays: list[dict[str, Any]], verb: str) -> list[str]:
    """Return the fate of each berg, in a sentence; nothing where there are many, or where a summary lacks it.

    ``stays``: of bergs and fragments on the sea floor, as the summary has them.
    """
    from riftberg.config.units import drift_text, place_text
    from riftberg.runs.groundings import stay_words

    if not bergs or len(bergs) > MOST_BERGS or any("drift_east_km" not in berg for berg in bergs):
        return []
    lines = []
    for berg in bergs:
        name = berg["name"] or ("the berg" if len(bergs) == 1 else f"berg {berg['number']}")
        if not berg["fragments"]:
            lines.append(f"  {name} melted away")
            continue
        east, north = 1e3 * berg["drift_east_km"], 1e3 * berg["drift_north_km"]
        moved = (
            f"{verb} {drift_text(east, north)} to"
            if verb != DRIFTED or math.hypot(east, north) >= STILL
            else "stayed at"
        )
        position = place_text(berg["lon"], berg["lat"], latlon=latlon)
        areas = _areas(berg["areas_km2"], berg["fragments"])
        pieces = "one piece" if berg["fragments"] == 1 else f"{berg['fragments']} pieces"
        melted = f"; {berg['melted_kg'] / 1e12:.3g} Gt melted" if berg["melted_kg"] else ""
        mine = [stay for stay in stays if stay["number"] == berg["largest"]]
        ground = f", {stay_words(mine[-1], berg['largest_weight'])}" if mine else ""
        lines.append(f"  {name} {moved} {position}, in {pieces} ({areas}){ground}{melted}")
    return lines


def _areas(km2: Sequence[float], count: int) -> str:
    """Return areas, largest first, all in one unit; ``count``: how many there are."""
    unit, name = (1.0, "km2") if not km2 or km2[0] >= 0.01 else (1e6, "m2")
    numbers = [area * unit for area in km2[:6]]
    areas = ", ".join(f"{area:.0f}" if area >= 9.5 else f"{area:.2g}" for area in numbers)
    return f"{areas}{' ...' if count > len(numbers) else ''} {name}"


@report_errors
def kid(
    case: Annotated[Path, typer.Argument(help="Folder with input.nml and the restart files named in it.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Trajectory file or folder.  [default: riftberg-out/NAME]")
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Show neither progress nor the list of namelist entries.")
    ] = False,
    large: Annotated[
        bool, typer.Option("--allow-large", help="Allow very large numbers of elements and steps.")
    ] = False,
    extreme: Annotated[
        bool,
        typer.Option(
            "--allow-extreme", help="Accept unphysical currents, wind and sea level, and ice speeds up to 1000 m/s."
        ),
    ] = False,
    ranks: Annotated[
        str,
        typer.Option(
            "--ranks",
            help="Processors of the KID run to reproduce, such as 2x2: footloose random numbers depend on them.",
        ),
    ] = "1x1",
) -> None:
    """Run a KID or iKID case from its namelist; write trajectory, restart and bond files."""
    from riftberg.kid.run import load_case, run_kid
    from riftberg.runs.progress import ProgressRecorder

    numbers = ranks.lower().split("x")
    if len(numbers) != 2 or not all(number.isdigit() and 1 <= int(number) <= 1000 for number in numbers):
        raise InputError(f"{ranks!r} is no layout of processes", where="--ranks", remedy="For example 2x2")
    layout = int(numbers[0]), int(numbers[1])
    with allow_large(large), allow_extreme(extreme):
        folder = output.parent if output is not None and not is_folder(output) else output
        if folder is not None:
            check_folder(folder)
        announce_compilation(quiet)
        loaded = load_case(case, layout)
        folder = folder or Path("riftberg-out") / case.resolve().name
        output = output or folder
        if not is_folder(output):
            check_output(output, inputs=[case / "input.nml", *case.glob("*/*.nc")])
        with results_folder(folder):
            for note in loaded.notes:
                say(f"Notice: {note}")
            clock = loaded.clock
            progress = ProgressRecorder(clock.steps * clock.dt / 86400.0, quiet=quiet)
            tell(run_kid(loaded, output, progress=progress).describe(entries=not quiet))
