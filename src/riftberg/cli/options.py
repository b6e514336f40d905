"""Shared by commands: options and their checks, folders of results, and messages at the terminal.

A run may take hours, so a file that cannot be written is refused first. A folder that was made for a run that was
refused is removed. Two commands that write one file are kept apart (`riftberg.system.atomic_files.only_writer`).

An error is one clear message and a code for scripts; with ``--verbose`` the log of the package is shown.
"""

from __future__ import annotations

import errno
import functools
import inspect
import logging
import math
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, ParamSpec, TypeVar, cast

import typer

from riftberg.errors import InputError, RiftbergError, nearest, visible
from riftberg.system.atomic_files import only_writer, refusal
from riftberg.system.input_files import at_home, human, in_folder, is_folder, shown, value_shown
from riftberg.system.process import insisting
from riftberg.system.process import say as say

if TYPE_CHECKING:
    from datetime import datetime

    from rich.console import Console
    from rich.table import Table

    from riftberg.diagnostics.observed import Observations
    from riftberg.experiments import Numerics, Options
    from riftberg.products.registry import Choice


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", "-s", metavar="GROUP.NAME=VALUE",
        help="Set a parameter, for example fracture.normal_strength='20 kPa'.",
    ),
]  # fmt: skip
Days = Annotated[float | None, typer.Option("--days", help="Length of the run, instead of the experiment's.")]
Data = Annotated[Path | None, typer.Option("--data", help="Folder of data files.")]
Without = Annotated[list[str] | None, typer.Option("--without", help="Leave out a part of the experiment.")]
NumericsName = Annotated[
    str | None,
    typer.Option(
        "--numerics",
        help="'own', 'reference' for the numerics and quirks of iKID, or 'both' for both, side by side.  "
        "[default: own; reference for a68a-paper]",
    ),
]
OneNumerics = Annotated[
    str | None,
    typer.Option(
        "--numerics",
        help="'own', or 'reference' for the numerics and quirks of iKID.  [default: own; reference for a68a-paper]",
    ),
]
Every = Annotated[float | None, typer.Option("--every", help="Hours of model time between records.")]
Map = Annotated[bool, typer.Option("--map/--no-map", help="Draw map.png.")]
Names = Annotated[
    str | None,
    typer.Option(
        "--names", metavar="QUANTITY=VARIABLE,...",
        help="Variables of the files by quantity or coordinate, such as uo=u,vo=v; each file takes those that it holds.",
    ),
]  # fmt: skip
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Members = Annotated[
    int | None,
    typer.Option("--members", min=1, help="Members to draw where something has a distribution or a random error."),
]
PlanName = Annotated[
    str | None, typer.Option("--plan", help="How they are drawn: sobol, random or latin-hypercube.  [default: sobol]")
]
PartOfMany = Annotated[
    str | None,
    typer.Option("--part", metavar="K/N", help="Run one part of N, as in job arrays; bring them together by --join."),
]
Join = Annotated[
    Path | None, typer.Option("--join", metavar="FOLDER", help="Make one result of the parts in a folder.")
]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all that is drawn.  [default: 1]")]
ExperimentToRun = Annotated[
    str | None, typer.Argument(help="A built-in experiment or a YAML file; not needed with --resume.")
]
EveryPosition = Annotated[
    float | None,
    typer.Option("--every", help="Hours of model time between positions.  [default: 6, or the length of the runs]"),
]
DefaultErrors = Annotated[
    bool,
    typer.Option(
        "--default-errors/--no-default-errors", help="Vary what the table of errors in the documentation has."
    ),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers run the members.")
]
Workers = Annotated[
    int | None, typer.Option("--workers", min=0, help="Processes on this machine; 0 to run in this process.")
]
MemberTime = Annotated[
    str | None,
    typer.Option(
        "--member-time", metavar="TIME",
        help="Wall time after which a member is left unfinished and told so, such as 10min.  [default: no limit]",
    ),
]  # fmt: skip
Resume = Annotated[
    Path | None, typer.Option("--resume", metavar="FOLDER", help="Continue in the folder of an earlier call.")
]
AllowMore = Annotated[bool, typer.Option("--allow-large", help="Allow more members and larger runs.")]
BergInFile = Annotated[str | None, typer.Option("--berg", help="Name of the berg, where the file has several.")]
Hour = Annotated[
    float | None, typer.Option("--hour", help="Hour (UTC) of days without a time.  [default: of the start]")
]
PositionError = Annotated[
    float, typer.Option("--error", help="Error of an observed position along each axis, km (standard deviation).")
]
AzimuthError = Annotated[
    float,
    typer.Option("--azimuth-error", help="Error of the long axis of an outline, degrees (standard deviation)."),
]
Broken = Annotated[str | None, typer.Option("--broken", metavar="DATE", help="When the berg was first seen broken.")]
WholeUntil = Annotated[str | None, typer.Option("--whole-until", metavar="DATE", help="When it was last seen whole.")]
VaryDrawn = Annotated[
    list[str] | None,
    typer.Option(
        "--vary", metavar="GROUP.NAME~DISTRIBUTION",
        help="What is uncertain, beside or instead of the default errors where a command has these: "
        "'start.thickness~lognormal(1, 10 %)', 'current_error.speed=0.2 m/s'. May be repeated.",
    ),
]  # fmt: skip
Figure = Annotated[bool, typer.Option("--figure/--no-figure", help="Draw the figures.")]
OutputFolder = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME-COMMAND]")
]
OutputBeside = Annotated[Path | None, typer.Option("--output", "-o", help="Folder.  [default: beside the run]")]


def check_positive(value: float | None, option: str, unit: str, most: float = math.inf) -> None:
    """Refuse an option that is no finite number above 0."""
    if value is not None and not (0.0 < value <= most and math.isfinite(value)):
        to = f", at most {most:g}" if math.isfinite(most) else ""
        raise InputError(f"{value:g} {unit}", where=option, remedy=f"Give a number above 0{to or ', not infinity'}")


def check_range(value: float | None, option: str, low: float, high: float) -> None:
    """Refuse an option outside its limits; NaN is outside of all."""
    if value is not None and not low <= value <= high:
        raise InputError(f"{value:g} is not possible", where=option, remedy=f"Give a number from {low:g} to {high:g}")


def pair(text: str | None, where: str) -> tuple[float, float] | None:
    """Read two numbers with a comma between them."""
    if text is None:
        return None
    try:
        first, second = (float(word) for word in text.split(","))
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} is not two numbers", where=where, remedy=f"For example {where} -43,-33"
        ) from error
    most = 90.0 if where == "--lat" else 540.0
    if not (abs(first) <= most and abs(second) <= most):
        raise InputError(
            f"{value_shown(text)} are no degrees", where=where, remedy=f"Give two numbers from {-most:g} to {most:g}"
        )
    if first >= second:
        raise InputError(
            f"{first:g} is not below {second:g}", where=where,
            remedy="The smaller number stands first; across the date line count on beyond 180",
        )  # fmt: skip
    return first, second


def dates(text: str | None, where: str = "--time") -> tuple[datetime, datetime] | None:
    """Read two dates with a comma between them."""
    if text is None:
        return None
    from riftberg.config.values import parse_date

    words = [word.strip() for word in text.split(",")]
    if len(words) != 2:
        raise InputError(
            f"{value_shown(text)} is not two dates", where=where, remedy=f"For example {where} 2020-12-09,2020-12-25"
        )
    first, last = (parse_date(word, where=where)[0] for word in words)
    if first > last:
        raise InputError(f"{words[0]} is later than {words[1]}", where=where, remedy="The earlier date stands first")
    return first, last


def make_options(
    settings: list[str] | None,
    days: float | None,
    data: Path | None,
    without: list[str] | None,
    numerics: str | None = None,
    fetch: bool = False,
    grid: float | None = None,
) -> Options:
    """Check the options of the command line."""
    from riftberg.experiments import Options

    if numerics == "both":
        raise InputError("one kind of numerics is needed", where="--numerics", remedy="Use own or reference")
    if numerics not in (None, "own", "reference"):
        raise InputError(f"{numerics!r} is not known", where="--numerics", remedy="Use own or reference, or both")
    if grid is not None and not 1e-4 <= grid <= 5.0:
        raise InputError(f"{grid:g} degrees", where="--grid", remedy="Give a number from 0.0001 (some 10 m) to 5")
    check_positive(days, "--days", "days")
    if data is not None and not is_folder(data) and not fetch:
        raise InputError("no such folder", where=f"--data {data}", remedy="Name a folder with data files")
    changes: dict[str, dict[str, Any]] = {}
    if settings:
        from riftberg.experiments.changes import parse_settings

        changes = parse_settings(settings)
    return Options(changes, days, data, frozenset(without or ()), cast("Numerics | None", numerics), fetch, grid)


@dataclass(frozen=True)
class EnsembleOptions:
    """Options of all commands that run members."""

    output: OutputFolder = None
    settings: Settings = None
    days: Days = None
    data: Data = None
    without: Without = None
    numerics: OneNumerics = None
    seed: Seed = None
    scheduler: Scheduler = None
    workers: Workers = None
    member_time: MemberTime = None
    resume: Resume = None
    quiet: Quiet = False
    large: AllowMore = False

    def checked(self) -> Options:
        """Return the options that are the same for all members."""
        return make_options(self.settings, self.days, self.data, self.without, self.numerics)


def with_ensemble_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that takes each of `EnsembleOptions` by itself, and gets them together as ``shared``."""
    ensemble_options = inspect.signature(EnsembleOptions, eval_str=True).parameters.values()
    fields = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in ensemble_options]

    @functools.wraps(command)
    def wrapped(**arguments: Any) -> Any:
        shared = EnsembleOptions(**{field.name: arguments.pop(field.name) for field in fields})
        return command(**arguments, shared=shared)

    signature = inspect.signature(command, eval_str=True)
    parameters = [*(p for p in signature.parameters.values() if p.name != "shared"), *fields]
    wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapped


def words_without(words: Iterable[str], *options: str) -> list[str]:
    """Return a command line without some options and their values."""
    rest: list[str] = []
    values = iter(words)
    for word in values:
        if word in options:
            next(values, None)
        elif not any(word.startswith(f"{option}=" if option.startswith("--") else option) for option in options):
            rest.append(word)
    return rest


def output_folder(wished: Path | None, name: str, holds: str = "run.nc") -> Path:
    """Return the folder of the results; without a wish, one that holds no earlier run."""
    if wished is not None:
        return wished
    folder, number = Path("riftberg-out") / name, 1
    while (folder / holds).exists():
        number += 1
        folder = Path("riftberg-out") / f"{name}-{number}"
    return folder


LEAST_SPACE: Final = 2e6
"""Bytes that must be free at least."""


def check_folder(folder: Path, names: Iterable[str] = (), *, needed: float = LEAST_SPACE) -> None:
    """Refuse a folder that cannot be made or written into, before any work.

    Parameters
    ----------
    folder : pathlib.Path
        Where results go.
    names : iterable of str
        Files that will be written there.
    needed : float
        Bytes that will be written, about.
    """
    where = f"--output {shown(folder)}"
    remedy = "Name another folder"
    try:
        nearest = folder
        while not nearest.exists():
            nearest = nearest.parent
        if not nearest.is_dir():
            problem = "a file, not a folder" if nearest == folder else f"{shown(nearest)} is a file, not a folder"
            raise InputError(problem, where=where, remedy=remedy)
        blocking = next((name for name in names if (folder / name).is_dir()), None)
        if blocking is not None:
            raise InputError(f"{blocking} is a folder there, where a file goes", where=where, remedy=remedy)
        # A test of the rights alone misses what is mounted read-only.
        with tempfile.TemporaryFile(dir=nearest) as file:
            file.write(b"riftberg")
        free = shutil.disk_usage(nearest).free
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be written ({reason.lower()})", where=where, remedy=remedy) from error
    if free < max(needed, LEAST_SPACE):
        raise InputError(
            f"the results take about {human(max(needed, LEAST_SPACE))}, and {human(free)} are free", where=where,
            remedy="Make room, name a folder on another disk, or write fewer records (--every)",
        )  # fmt: skip


def check_output(path: Path, *, inputs: Iterable[Path | None] = ()) -> None:
    """Refuse a file that cannot be written, or that is one of those read."""
    where = f"--output {shown(path)}"
    with suppress(OSError, ValueError):
        if path.is_dir():
            raise InputError("a folder, where a file goes", where=where, remedy="Name a file in it")
        if path.exists() and any(other is not None and other.exists() and path.samefile(other) for other in inputs):
            raise InputError("the output is one of the inputs", where=where, remedy="Name another file")
    check_folder(path.parent)


@contextmanager
def results_folder(
    folder: Path, names: Iterable[str] = (), *, needed: float = LEAST_SPACE, locked: Iterable[str] = ()
) -> Iterator[Path]:
    """Make a folder; remove it again where an error leaves it empty.

    Parameters
    ----------
    folder, names, needed
        As in `check_folder`.
    locked : iterable of str
        Files there that nobody else may write meanwhile.
    """
    check_folder(folder, names, needed=needed)
    created = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with only_writer(*(folder / name for name in locked)):
            yield folder
    except BaseException:
        for parent in created:
            with suppress(OSError):  # one with something in it stays
                parent.rmdir()
        raise


def match_names(
    files: Sequence[str], product: str | None, names: str | None
) -> tuple[Sequence[str], dict[str, Choice]]:
    """Return the files that patterns name, and for each the product and the variable names that it holds."""
    if not names:
        return files, dict.fromkeys(files, product)
    from riftberg.products.reading import open_raw
    from riftberg.products.registry import choose_product, expand

    if not files:
        raise InputError(
            "no files were named", where="--names", remedy="Name them in the experiment file: names: {uo: u}"
        )
    pairs = [word.partition("=") for word in names.split(",")]
    requested = {key.strip(): name.strip() for key, _, name in pairs}
    choose_product(None, requested, where="--names")
    files = expand(files)
    variables = {file: set(map(str, open_raw(file).variables)) for file in files}
    if missing := set(requested.values()) - set().union(*variables.values()):
        everything = sorted(set().union(*variables.values()))
        remedy = f"{nearest(min(missing), everything)}They hold {', '.join(everything)}"
        raise InputError(f"no file has a variable {min(missing)!r}", where="--names", remedy=remedy)
    chosen = {file: {key: name for key, name in requested.items() if name in variables[file]} for file in files}
    return files, {file: choose_product(product, chosen[file], where="--names") for file in files}


def named_files(experiment: str, names: str, data: Path | None) -> tuple[Any, ...]:
    """Return the files of an experiment with the variables named; a product or names in the experiment stay."""
    from riftberg.experiments.yaml_file import read_file
    from riftberg.ocean.files_schema import FileForcing

    forcing = read_file(Path(experiment))[0].forcing if experiment.endswith((".yaml", ".yml")) else None
    if not isinstance(forcing, FileForcing):
        raise InputError(
            "the forcing has no files", where="--names", remedy="It is for experiment files with kind: files"
        )
    folder = data or Path(experiment).parent
    paths = [in_folder(folder, entry.file) for entry in forcing.entries]
    preset = {
        file: entry.choice for file, entry in zip(paths, forcing.entries, strict=True) if entry.product or entry.names
    }
    free = [file for file in paths if file not in preset]
    files, choices = match_names(free, None, names)
    return list_entries([*preset, *files], preset | choices)


def list_entries(files: Sequence[str], choices: Mapping[str, Choice]) -> tuple[Any, ...]:
    """Return files as entries of an experiment, each with its product or names."""
    from riftberg.ocean.files_schema import NamedFiles

    # A product that is not known is refused where the files are opened, as in a run.
    return tuple(NamedFiles.chosen(in_folder(Path.cwd(), file), choices[file]) for file in files)


P = ParamSpec("P")
R = TypeVar("R")

EXIT_ERROR: Final = 2
EXIT_INTERRUPTED: Final = 130


def report_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Turn errors that Riftberg raises on purpose, and refusals of the system, into a message and exit code 2.

    An interrupt has the code 130.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        # A shell writes ~ out, but not in --output=~/run nor between quotes.
        for key, value in kwargs.items():
            if isinstance(value, str | Path):
                kwargs[key] = at_home(value) if isinstance(value, str) else Path(at_home(str(value)))
        try:
            with insisting():
                return command(*args, **kwargs)
        except RiftbergError as error:
            say(f"Error: {error}")
            raise typer.Exit(EXIT_ERROR) from error
        except OSError as error:
            say(f"Error: {_system_message(error)}")
            raise typer.Exit(EXIT_ERROR) from error
        except MemoryError as error:
            say(
                "Error: this needs more memory than there is (or than ulimit -v allows). "
                "Give larger elements (berg.radius), shorter or fewer records, or smaller files"
            )
            raise typer.Exit(EXIT_ERROR) from error
        except KeyboardInterrupt as error:
            say("Interrupted.")
            raise typer.Exit(EXIT_INTERRUPTED) from error

    return wrapped


def _system_message(error: OSError) -> str:
    """Return the message of a system error, with its file."""
    prefix = f"{error.filename}: " if error.filename is not None else ""
    remedy = "" if error.errno == errno.ENOLCK else ". Name a place that can be used, with room on its disk"
    return f"{prefix}{refusal(error)}{remedy}"


def announce_compilation(quiet: bool = False) -> None:
    """Say beforehand that the first step takes long where nothing has been compiled yet."""
    from riftberg.compiled.kernels import is_warm

    if not quiet and not is_warm():
        say("First run with this version: compiling takes three to four minutes on a free core, once.")


def tell(text: object) -> None:
    """Write a result to standard output; names in files of others are shown, and do not steer the terminal."""
    typer.echo(visible(str(text)))


def console(width: int) -> Console:
    """Return the console for tables: the terminal, or a file or pipe, which has no width, as wide as ``width``."""
    from rich.console import Console

    class Plain(Console):
        def render_str(self, text: str, **options: Any) -> Any:
            return super().render_str(visible(text), **options)

    output = Plain(markup=False)
    return output if output.is_terminal else Plain(width=width, markup=False)


def table(title: str, columns: Iterable[str], texts: Collection[str] = ()) -> Table:
    """Return an empty table; ``texts``: columns that stand to the left, numbers stand to the right."""
    from rich.table import Table

    new_table = Table(title=title)
    for name in columns:
        new_table.add_column(name, justify="left" if name in texts else "right", no_wrap=name in texts)
    return new_table


Verbose = Annotated[
    int,
    typer.Option(
        "--verbose", "-v", count=True, help="Show the log; twice (-vv) to include each file that is opened or written."
    ),
]


def verbose(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that takes ``--verbose`` too."""

    @functools.wraps(command)
    def wrapped(*args: Any, verbose: int = 0, **kwargs: Any) -> Any:
        with listening(verbose):
            return command(*args, **kwargs)

    signature = inspect.signature(command, eval_str=True)
    added = inspect.Parameter("verbose", inspect.Parameter.KEYWORD_ONLY, default=0, annotation=Verbose)
    parameters = [*signature.parameters.values(), added]
    wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapped


def load_observed(path: str | Path, **how: Any) -> Observations:
    """Return observations, and say which of the file were left out; ``how`` as for `read_observed`."""
    from riftberg.diagnostics.observed import read_observed

    observed = read_observed(path, **how)
    for notice in observed.notices:
        say(f"Notice: {notice}")
    return observed


@contextmanager
def listening(times: int, name: str = "riftberg") -> Iterator[None]:
    """Write the records of loggers, of the package or below it, to the error stream: 1 for what happens, 2 for each file too."""
    if not times:
        yield
        return
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    logger = logging.getLogger(name)
    previous_level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if times == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(previous_level)
