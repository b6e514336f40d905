"""``riftberg couple``: the bergs of an experiment beside an ocean model, through the coupler YAC."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from riftberg.cli.options import (
    Data,
    Every,
    Map,
    Quiet,
    Settings,
    check_folder,
    listening,
    make_options,
    output_folder,
    report_errors,
    tell,
)
from riftberg.errors import InputError

RESTART = "end.restart.nc"  # Written at the end of a coupled run


@report_errors
def couple(
    context: typer.Context,
    experiment: Annotated[str, typer.Argument(help="A YAML file; of its forcing the sea floor counts.")],
    yac: Annotated[Path, typer.Option("--yac", metavar="COUPLING.yaml", help="Coupling file of YAC with section riftberg.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results.  [default: riftberg-out/NAME]")
    ] = None,
    settings: Settings = None,
    data: Data = None,
    every: Every = None,
    resume: Annotated[
        Path | None, typer.Option("--resume", help="Restart file to go on from, into another folder.")
    ] = None,
    map_: Map = True,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    """Run an experiment beside an ocean model, through the coupler YAC; ends with a restart file for the next run."""
    from riftberg.cli.run import RESULTS, RunOptions, Session, build_run
    from riftberg.coupling.fields import OceanForcing
    from riftberg.coupling.yac import YacComponent, ending_all_ranks, ocean_beside, read_coupling

    with ending_all_ranks(), listening(1, "riftberg.coupling"):
        coupling = read_coupling(yac)
        options = make_options(settings, None, data, None)
        options = replace(options, ocean=lambda forcing, parameters: ocean_beside(forcing, coupling, parameters))
        words = ["riftberg", *context.find_root().obj]
        run_options = RunOptions(
            output, every, False, map_, quiet, None, None, 0.0, words, experiment, data, settings or []
        )
        model, info, _ = build_run(experiment, options, resume, run_options)
        if not isinstance(model.forcing, OceanForcing):
            raise InputError(f"{experiment} has its own ocean", where="couple", remedy="Name an experiment file (YAML)")
        folder = output_folder(output, info.name)
        check_folder(folder, (*RESULTS, RESTART))
        if 3600.0 * run_options.hours(info) < (coupling.settings.step or 0.0) * (1.0 - 1e-9):
            raise InputError(f"a record every {run_options.hours(info):g} h", where="--every",
                             remedy=f"Give the step of the exchange or more: {coupling.settings.step} s")  # fmt: skip
        component = YacComponent(model, coupling)
        session = Session(model, info, folder, run_options, placed=output is not None, step=component.step)
        session.run_and_report((model.time + (coupling.end - coupling.start).total_seconds()) / 86400.0)
        for line in component.exchange.balance().describe().splitlines():
            tell(line)
        tell(f"Go on with: --resume {model.save(folder / RESTART)}")
        component.close()
