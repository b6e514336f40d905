"""``riftberg why``: the reasons of the break-ups of a run."""

from __future__ import annotations

import json
import shlex
from contextlib import redirect_stdout
from io import StringIO
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import OutputBeside, results_folder
from riftberg.cli.pictures import Format, Run, check_picture_format, folder_beside
from riftberg.cli.terminal import reported, say

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.diagnostics.cut import Breakup
    from riftberg.diagnostics.why import Reasons


@reported
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
    from riftberg.diagnostics.why import explain, words
    from riftberg.runs.checks import check_recorded
    from riftberg.runs.run_file import open_run
    from riftberg.runs.scene import SMALL

    check_picture_format(picture)
    names = ("why.json", f"why.{picture}") if figure else ("why.json",)
    with open_run(run) as dataset, results_folder(folder_beside(run, output), names, taken=names) as folder:
        check_recorded(dataset, SURROUNDINGS)
        reasons = explain(dataset, smallest=0.0 if everything else SMALL)
        if controls:
            add_controls(run, dataset, reasons, quiet=quiet, data=data)
        if as_json:
            typer.echo(json.dumps(reasons.as_dict(), indent=1))
        else:
            for k, paragraph in enumerate(words(reasons)):
                typer.echo(paragraph)
                if k < len(reasons.breakups):
                    _print_breakup(reasons.breakups[k])
        written = [reasons.write(folder / "why.json")]
        if figure:
            from riftberg.viz.why import draw_reasons

            written.append(draw_reasons(reasons, folder / f"why.{picture}"))
    say("Written: " + ", ".join(str(path) for path in written))


SURROUNDINGS = ("uo", "vo", "ui", "vi", "ua", "va", "slope_x", "slope_y", "depth", "ice_thickness")
"""Variables of a run file from which the forces on the fragments are computed."""


def add_controls(path: Path, run: xr.Dataset, reasons: Reasons, *, quiet: bool, data: Path | None) -> None:
    """Run the experiment again without each of its parts, and with half the long step; note what became of each break-up.

    ``path``: the run, or its folder; ``data``: folder of data files, by default where they were.
    """
    import numpy as np

    from riftberg.cli.compare import run_again
    from riftberg.diagnostics.why import removed_by
    from riftberg.experiments import EXPERIMENTS
    from riftberg.runs.checks import parameters_of
    from riftberg.runs.layout import COMMAND
    from riftberg.runs.run_file import open_run

    words = shlex.split(str(run.attrs.get(COMMAND, "")))
    parts = next((entry.parts for entry in EXPERIMENTS if entry.name in words[2:3]), ())
    left_out = [value for word, value in pairwise(words) if word == "--without"]
    changes = {f"without {part}": ["--without", part] for part in parts if part not in left_out}
    stepping = parameters_of(run).stepping
    half: dict[str, object] = {"time_step": stepping.time_step / 2.0}
    if (
        stepping.substeps is not None and stepping.scheme == "mts"
    ):  # the sub-step stays; where none are made, they ask for mts
        half["substeps"] = max(1, round(stepping.substeps / 2))
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
                    breakup.controls[change] = removed_by(breakup, control)


def _print_breakup(b: Breakup) -> None:
    """Print the budget and the load of one break-up as tables."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"Fragment {b.fragment}: forces at {b.decisive.time.replace('T', ' ')[:16]}")
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
        sides = [part / 1e9 for k in ("fragment", "rest") for part in b.budgets[k].forces[name]]
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
    console = Console()
    (console if console.is_terminal else Console(width=120)).print(table)
