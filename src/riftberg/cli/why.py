"""``riftberg why``: the reasons of the break-ups of a run."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import OutputBeside, results_folder
from riftberg.cli.pictures import Format, Run, check_picture_format, folder_beside
from riftberg.cli.terminal import reported, say
from riftberg.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.diagnostics.cut import Breakup
    from riftberg.diagnostics.why import Reasons
    from riftberg.experiments import Options


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
    experiment: Annotated[
        str | None,
        typer.Option(
            "--experiment",
            help="Experiment or YAML file of the run, for the controls.  [default: as recorded in the run]",
        ),
    ] = None,
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
            add_controls(dataset, reasons, experiment=experiment, quiet=quiet, data=data)
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


def add_controls(
    run: xr.Dataset, reasons: Reasons, *, experiment: str | None = None, quiet: bool = False, data: Path | None = None
) -> None:
    """Run the experiment again without each of its parts, and with half the long step; note what became of each break-up.

    Parameters
    ----------
    run : xarray.Dataset
        The full run; names its experiment and parameters.
    reasons : Reasons
        Its break-ups; ``controls`` of each is filled.
    experiment : str, optional
        Built-in experiment or YAML file that made the run; by default the built-in one that the run names.
    quiet : bool, optional
        Show no progress.
    data : pathlib.Path, optional
        Folder of data files, for experiments that need one.
    """
    from riftberg.diagnostics.why import removed_by
    from riftberg.experiments import Options

    name, parts_of_it = _experiment(experiment or reasons.experiment)
    kept, left_out, errors = _kept(run)
    parts_of_it = tuple(part for part in parts_of_it if part not in left_out)
    changes = {f"without {part}": ({part}, 1) for part in parts_of_it} | {"with half the long step": (set[str](), 2)}
    with TemporaryDirectory(prefix="riftberg-controls-") as folder:
        for number, (change, (parts, split)) in enumerate(changes.items()):
            if not quiet:
                say(f"Control {change}:")
            control = _control(run, name, Path(folder) / f"{number}.nc", quiet=quiet, split=split, errors=errors,
                               options=Options(kept, data=data, without=frozenset(parts) | left_out))  # fmt: skip
            for breakup in reasons.breakups:
                breakup.controls[change] = removed_by(breakup, control)
            control.close()


def _experiment(name: str) -> tuple[str, tuple[str, ...]]:
    """Return the experiment as `riftberg.experiments.build` takes it, and its parts; files have none."""
    from riftberg.experiments import find

    if name.endswith((".yaml", ".yml")):
        return name, ()
    try:
        entry = find(name)
    except InputError as error:
        raise InputError(
            f"{name!r} is no built-in experiment",
            where="--controls",
            remedy="Name the YAML file of the run by --experiment FILE",
        ) from error
    return entry.name, tuple(entry.parts)


def _kept(run: xr.Dataset) -> tuple[dict[str, Any], frozenset[str], dict[str, Any]]:
    """Return what the command of a run changed beside its parameters: of its berg, what was left out, and errors."""
    from riftberg.cli.run import parted
    from riftberg.experiments.changes import parse_settings
    from riftberg.parameters import Parameters
    from riftberg.runs.layout import COMMAND

    words = shlex.split(str(run.attrs.get(COMMAND, "")))
    given = {name: [value for word, value in pairwise(words) if word == name] for name in ("--set", "--without")}
    errors, plain = parted(given["--set"])
    changes = {g: inner for g, inner in parse_settings(plain).items() if g not in Parameters.model_fields}
    return changes, frozenset(given["--without"]), errors


def _control(
    run: xr.Dataset, name: str, path: Path, *, quiet: bool, split: int, errors: dict[str, Any], options: Options
) -> xr.Dataset:
    """Run a control; ``split`` shortens the long step, the sub-step stays. ``options``: what it changes beside parameters."""
    import numpy as np

    from riftberg.ensembles.uncertain import with_errors
    from riftberg.experiments import Numerics, build
    from riftberg.parameters import Parameters
    from riftberg.runs.progress import ProgressRecorder
    from riftberg.runs.run_file import RunWriter, open_run

    times = run["time"].values
    days = float((times[-1] - times[0]) / np.timedelta64(1, "s")) / 86400.0
    every = float(np.median(np.diff(times)) / np.timedelta64(1, "s")) / 3600.0
    same: dict[str, Any] = Parameters.model_validate_json(run.attrs["parameters_json"]).model_dump()
    stepping = same["stepping"]
    stepping["time_step"] /= split
    if stepping["substeps"] is not None:
        stepping["substeps"] = max(1, round(stepping["substeps"] / split))
    # Some experiments have another ocean, or read it in another way, with the reference's numerics.
    numerics: Numerics = "reference" if same["compatibility"]["zero_start"] else "own"
    model, _ = build(name, replace(options, changes={**options.changes, **same}, days=days, numerics=numerics))
    model = with_errors(model, errors)
    if len(model.elements.id) != run.sizes["trajectory"]:
        raise InputError(
            f"{name} builds {len(model.elements.id)} elements, the run has {run.sizes['trajectory']}", where="--controls",
            remedy="The run was made with another berg; run its controls with 'riftberg run --without'",
        )  # fmt: skip
    writer = RunWriter(path, every_hours=every, experiment=name, background=False)
    model.advance(days, recorders=[writer, ProgressRecorder(days, quiet=quiet)])
    return open_run(path)


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
