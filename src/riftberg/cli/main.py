"""The command line: runs, pictures of them, comparison with observations, and forcing files.

Nothing heavy is imported here; every command imports what it needs when it runs, so that help appears at once.
"""

from __future__ import annotations

from typing import Annotated

import typer

from riftberg.cli import animate, bench, compare, doctor, fetch, kid, plot, replay, run, score, sweep, why
from riftberg.cli.verbose import verbose
from riftberg.version import __version__

app = typer.Typer(
    name="riftberg",
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


app.command("run")(verbose(run.run))
app.command("sweep")(verbose(sweep.sweep))
app.command("experiments")(verbose(run.experiments))
app.command("kid")(verbose(kid.kid))
app.command("bench")(verbose(bench.bench))
app.command("plot")(verbose(plot.plot))
app.command("animate")(verbose(animate.animate))
app.command("replay")(verbose(replay.replay))
app.command("score")(verbose(score.score))
app.command("compare")(verbose(compare.compare))
app.command("why")(verbose(why.why))
app.command("doctor")(verbose(doctor.doctor))
app.command("fetch")(verbose(fetch.fetch))

if __name__ == "__main__":
    app()
