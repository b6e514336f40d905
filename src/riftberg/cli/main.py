"""The command line: runs, pictures of them, comparison with observations, and forcing files.

Nothing heavy is imported here; every command imports what it needs when it runs, so that help appears at once.
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from riftberg.cli import animate, bench, compare, doctor, fetch, kid, plot, replay, run, score, sweep, why
from riftberg.cli.verbose import verbose
from riftberg.version import __version__


class Commands(TyperGroup):
    """The commands; an empty word, as of a variable that a script did not set, is no value of any of their options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse empty words: as a path they would mean the folder at hand."""
        if "" in args:
            place = args.index("")
            ctx.fail(f"Nothing stands after '{args[place - 1]}', only an empty word." if place else "An empty word.")
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="riftberg",
    cls=Commands,
    help="Tabular icebergs as lattices of ice columns joined by breakable bonds: drift, grounding and break-up.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"riftberg {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Take the options that stand before the command."""


COMMANDS = (
    run.run, sweep.sweep, run.experiments, kid.kid, bench.bench, plot.plot, animate.animate, replay.replay, score.score,
    compare.compare, why.why, doctor.doctor, fetch.fetch,
)  # fmt: skip
"""The commands, called as these functions are, in the order of the help."""

for command in COMMANDS:
    app.command(command.__name__)(verbose(command))

if __name__ == "__main__":
    app()
