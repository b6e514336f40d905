"""The command line: runs, pictures of them, comparison with observations, and forcing files.

Nothing heavy is imported here; a command is loaded when it is called, and imports what it needs when it runs, so that help
appears at once.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import sys
import warnings
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import CommandInfo

from riftberg.version import __version__

SUMMARIES: Final = {
    "run": "Run an experiment and write run.nc, summary.json and map.png.",
    "new": "Write an experiment file for a named berg: place, size, products to fetch.",
    "rerun": "Repeat a run from the experiment file that it keeps, with other parameters or another length.",
    "sweep": "Run an ensemble: an experiment for every combination of parameter values, collected in one result.",
    "forecast": "Forecast how likely a berg breaks, grounds and where it drifts: an ensemble with errors in all inputs.",
    "update": "Weight the members of a forecast by new sightings; where too few of them count, run new ones around these.",
    "sensitivity": "Show which input matters: Morris effects or Sobol' indices of stress, break-up, grounding, area and drift.",
    "calibrate": "Find inputs that agree with observed positions, headings and break-up, and say how well they are known.",
    "hazard": "Write limits of ice, positions with error radius and probabilities of a forecast as GeoJSON, KML, netCDF and CSV.",
    "product-errors": "Estimate the error of the current by the differences of two products: size, length, time.",
    "couple": "Run an experiment beside an ocean model, through the coupler YAC; ends with a restart file for the next run.",
    "experiments": "List the built-in experiments.",
    "kid": "Run a KID or iKID case from its namelist; write trajectory, restart and bond files.",
    "plot": "Draw maps at chosen dates with observed outlines, stress and damage of the bonds, and the history of the fragments.",
    "animate": "Write a film of a run.",
    "replay": "Write one web page that plays the run offline, with scrubbing and zoom; of a forecast with all its members.",
    "score": "Compare a run with observations, day by day: distance, heading, area, overlap, fragments.",
    "verify": "Score an ensemble against observations: CRPS, energy score, coverage, ranks, spread, probability of break-up.",
    "verify-tracks": "Score drift models on observed tracks, beside staying put and constant velocity: of BYU and NIC, or of a "
    "suite.",
    "compare": "Compare runs: how far apart they are by time, break-ups, bonds, and the distance from observed positions.",
    "why": "Explain why a berg broke: forces on the fragments, load across the cut, the first bonds to fail, and controls.",
    "doctor": "Identify forcing files, check that they are sufficient for an experiment, list what is missing.",
    "fetch": "Download forcing files; an interrupted download resumes where it stopped.",
}
"""The commands in the order of the help, with the first lines of their own, so that help need not load them."""

_ELSEWHERE: Final = {
    **dict.fromkeys(("experiments", "kid"), "run"),
    **dict.fromkeys(("rerun", "why", "score"), "compare"),
    **dict.fromkeys(("doctor", "fetch", "new"), "forcing_files"),
    **dict.fromkeys(("sweep", "forecast", "product-errors", "update", "hazard"), "ensembles"),
    **dict.fromkeys(("sensitivity", "calibrate"), "inputs"),
    "verify-tracks": "verify",
    **dict.fromkeys(("plot", "animate", "replay"), "pictures"),
}  # fmt: skip
"""Commands that stand in the file of another."""


def load_command(name: str) -> Callable[..., Any]:
    """Return the function of a command, to be called unchanged."""
    word = name.replace("-", "_")
    function: Callable[..., Any] = getattr(importlib.import_module(f"riftberg.cli.{_ELSEWHERE.get(name, word)}"), word)
    return function


class Commands(TyperGroup):
    """The commands; an empty word, as of a variable that a script did not set, is no value of any of their options."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands = {name: TyperCommand(name, help=summary) for name, summary in SUMMARIES.items()}

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the words for commands that print how to go on; refuse empty ones: a path would mean the present folder."""
        ctx.obj = list(args)
        if "" in args:
            position = args.index("")
            ctx.fail(
                f"Nothing stands after '{args[position - 1]}', only an empty word." if position else "An empty word."
            )
        _take_flags_as_they_are(self, ctx)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; refuse an invalid value in our words, where typer would print the words of pydantic."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            findings: list[Any] = getattr(error.__cause__, "errors", list)()
            if findings:
                error.message = _refusal(findings[0])
            raise

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, loaded."""
        if super().get_command(ctx, cmd_name) is None:
            return None
        command = typer.main.get_command(_single_command(cmd_name))
        _take_flags_as_they_are(command, ctx)
        return command

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the summary of each command, in full and without loading it."""
        with formatter.section("Commands"):
            formatter.write_dl(list(SUMMARIES.items()))


def _take_flags_as_they_are(command: Any, ctx: Any) -> None:
    """Take flags and counts as the parser found them; typer would load pydantic to find their types, 60 ms."""
    for option in command.get_params(ctx):
        if getattr(option, "is_flag", False) or getattr(option, "count", False):
            option.process_value = partial(_called_back, option)


def _called_back(option: Any, ctx: Any, value: Any) -> Any:
    return value if option.callback is None else option.callback(ctx, option, value)


def _refusal(finding: Any) -> str:
    """Return the refusal of a word on the command line, from the finding of pydantic."""
    from riftberg.config.values import finding_text

    kind, limits = finding["type"].partition("_")[0], finding.get("ctx", {})
    expected = {"float": "a number", "int": "a whole number", "bool": "true or false"}.get(kind, "a number")
    signs = {"ge": "from", "gt": "above", "le": "at most", "lt": "below"}
    bounds = "".join(f" {word} {limits[sign]:g}" for sign, word in signs.items() if sign in limits)
    return f"{finding_text(finding)}. Give {expected}{bounds}"


def _single_command(name: str) -> typer.Typer:
    from riftberg.cli.options import verbose

    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    single.command(name)(verbose(load_command(name)))
    return single


class App(typer.Typer):
    """The application; commands are listed without loading them."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run as the command line: values that are no numbers are reported in our words, not by warnings of NumPy."""
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        # What is imported stays: to look through it for cycles took a tenth of the start, and at the end a quarter of a second.
        gc.set_threshold(20_000)
        atexit.register(gc.freeze)
        from riftberg.system.process import make_streams_last

        make_streams_last()
        return super().__call__(*args, **kwargs)

    @property
    def registered_commands(self) -> list[CommandInfo]:
        """All commands, loaded; none for typer itself, which would load them all before it runs one (`Commands` does that)."""
        if sys._getframe(1).f_globals.get("__name__") == "typer.main":
            return []
        return [info for name in SUMMARIES for info in _single_command(name).registered_commands]

    @registered_commands.setter
    def registered_commands(self, commands: list[CommandInfo]) -> None:
        """Ignore the empty list that typer begins with."""


app = App(
    name="riftberg",
    cls=Commands,
    help="Tabular icebergs as lattices of ice columns joined by breakable bonds: drift, grounding, melt and break-up.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # half of the time of help goes into loading what draws frames around it
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(requested: bool) -> None:
    if requested:
        typer.echo(f"riftberg {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Take the options that stand before the command."""


if __name__ == "__main__":
    app()
