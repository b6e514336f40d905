"""A whole KID run: from the case folder to trajectory, restart and bond files."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.bergs.bonding import BondRule, Metric, count_bonds, form_bonds
from riftberg.errors import InputError, RiftbergError, RunError, SpeedError
from riftberg.kid.a68 import place_note
from riftberg.kid.driver import (
    CoupledRun,
    ExchangeRun,
    FedBackRun,
    attach_life,
    build_clock,
    build_grid,
    driver_forcing,
    without_idle_life,
)
from riftberg.kid.parameters import (
    Clock,
    KidNamelist,
    NamelistGroup,
    check_bond_lengths,
    check_both_sides,
    check_calving_store,
    check_footloose,
    depth_notes,
    order_sides,
    read_namelist,
    to_parameters,
)
from riftberg.kid.restart import (
    CALVING_FILE,
    RESTART,
    as_iceberg,
    id_text,
    read_bonds,
    read_restart,
    write_bonds,
    write_restart,
)
from riftberg.kid.trajectories import BondRecorder, TrajectoryRecorder
from riftberg.model import Recorder
from riftberg.ocean.grid import Grid
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from riftberg.state import Bonds, Elements, Ints, new_bonds
from riftberg.system.atomic_files import only_writer, refusal
from riftberg.system.input_files import is_folder
from riftberg.system.process import held, say

_LOG = logging.getLogger(__name__)

NAMELIST: Final = "input.nml"
BOND_RESTART: Final = "bonds_iceberg.res.nc"

Writer = TrajectoryRecorder | BondRecorder


@dataclass
class KidCase:
    """A KID run folder, read and checked, ready to run."""

    folder: Path  # The run folder
    namelist: KidNamelist  # ``input.nml``
    parameters: Parameters  # What it says about the physics
    clock: Clock  # Length and calendar
    grid: Grid  # The driver's grid
    model: Model  # The model at its initial state
    notes: list[str] = field(default_factory=list)  # What was done beyond the namelist
    exchange: ExchangeRun | None = (
        None  # The run, where water goes to an ocean (group ``drv_nml``) or back to the driver
    )


@dataclass(frozen=True)
class KidReport:
    """Report of a KID run."""

    case: KidCase  # The case, its model at the final state
    files: tuple[Path, ...]  # Files written
    lines: tuple[str, ...]  # One line for each namelist entry of the file, each ignored group, and each note

    def describe(self, entries: bool = True) -> str:
        """Return the report as text, without the lines of the namelist if ``entries`` is off."""
        return "\n".join([*(self.lines if entries else ()), *(f"wrote {path}" for path in self.files)])


def load_case(case_dir: Path, ranks: tuple[int, int] = (1, 1)) -> KidCase:
    """Read and check a KID run folder; nothing is written.

    Parameters
    ----------
    case_dir : pathlib.Path
        Folder with ``input.nml`` and the restart folder it names.
    ranks : tuple of int, optional
        Processes along x and y of the run of the reference that is followed; footloose calving depends on them (quirk T10).

    Raises
    ------
    InputError
        If something is missing, unknown, unsupported or impossible.
    """
    folder = Path(case_dir)
    if not is_folder(folder):
        raise InputError("no such folder", where=str(folder), remedy=f"Name a KID run folder, with {NAMELIST}")
    namelist = read_namelist(folder / NAMELIST)
    if namelist.coupled:
        run = CoupledRun(folder, namelist, ranks)
        return KidCase(folder, namelist, run.parameters, run.clock, run.grid, run.model, run.notes, run)
    parameters = to_parameters(namelist)
    clock = build_clock(namelist)
    grid = build_grid(namelist, folder)
    forcing = driver_forcing(namelist, grid, folder, clock)
    restarts = namelist.restarts
    earth = parameters.earth
    elements = read_restart(restarts / RESTART, grid, seam=not earth.latlon and earth.period <= 0.0)
    bonds = _form_or_read_bonds(elements, namelist.icebergs, parameters, restarts)
    check_bond_lengths(elements, bonds, parameters.bonds.packing)
    check_footloose(elements, namelist.icebergs)
    parameters = without_idle_life(parameters, elements, bonds, namelist.icebergs.flag("passive_mode"))
    check_both_sides(elements, bonds, namelist.icebergs, parameters)
    notes = depth_notes(namelist.icebergs, restarts)
    # Melt orders the sides itself, in every step.
    ordered = parameters.melt.enabled or namelist.icebergs.flag("Iceberg_melt_without_decay")
    if not ordered and (turned := order_sides(elements)):
        notes.append(f"length and width exchanged in {turned} elements, as KID does in its first step")
    if namelist.driver.flag("a68_test"):
        notes += place_note(namelist.driver, folder, grid)
    apply_beam_test(elements, namelist.icebergs.whole("dem_beam_test"))
    berg = as_iceberg(elements, bonds, parameters, restarts / RESTART)
    start = datetime(1, 1, 1) + timedelta(seconds=clock.offset)
    model = Model(berg, forcing, parameters, start)
    attach_life(model, namelist.icebergs, clock, restarts, ranks)
    fed_back = None
    if model.life is not None and not namelist.icebergs.flag("passive_mode"):
        fed_back = FedBackRun(model, namelist.icebergs, grid, clock, restarts)
        notes += fed_back.notes
    else:
        check_calving_store(restarts, namelist.icebergs, grid)
    return KidCase(folder, namelist, parameters, clock, grid, model, notes, fed_back)


def _form_or_read_bonds(elements: Elements, group: NamelistGroup, parameters: Parameters, restarts: Path) -> Bonds:
    """Form the bonds by rule or read them, as the namelist says; none if bonds are off."""
    if not group.flag("iceberg_bonds_on"):
        none: Ints = np.zeros(0, dtype=np.int64)
        return new_bonds(none, none)
    earth = parameters.earth
    metric = Metric(earth.latlon, earth.radius, earth.period)
    if not group.flag("manually_initialize_bonds"):
        return read_bonds(restarts / BOND_RESTART, elements, metric)
    by_radii = group.flag("manually_initialize_bonds_from_radii")
    length = None if by_radii else group.number("length_for_manually_initialize_bonds")
    bonds = form_bonds(elements, BondRule(length=length, packing=parameters.bonds.packing), metric)
    count_bonds(elements, bonds)
    return bonds


def apply_beam_test(elements: Elements, kind: int) -> None:
    """Put the loads and supports of the beam tests on the elements (section 10.3).

    They are found by exact equality of their x with the ends or the middle of the beam. The present positions become the
    places of origin.
    """
    if kind < 1:
        return
    west, east = elements.lon.min(), elements.lon.max()
    if kind == 1:
        elements.free_y[(elements.lon == west) | (elements.lon == east)] = 0.0
        # Loads in N, as section 10.3 gives them.
        elements.load_y[elements.lon == 0.5 * (west + east)] = -1.5e5
    elif kind == 2:
        elements.load_y[elements.lon == east] = -1.5e10 / 3.0
    elements.life.start_lon[:], elements.life.start_lat[:] = elements.lon, elements.lat


def run_kid(
    case_dir: Path | KidCase, output: Path, *, progress: Recorder | None = None, ranks: tuple[int, int] = (1, 1)
) -> KidReport:
    """Run a KID case and write its files.

    Written are the trajectory, beside it ``<stem>_restart.nc`` and, with bonds, ``<stem>_bonds_restart.nc``; with
    ``save_bond_traj`` also ``<stem>_bonds.nc``; of cases with an ocean ``ocean.nc`` and ``<stem>_calving.nc``.
    Existing files of these names are replaced; the case folder is only
    read.

    Parameters
    ----------
    case_dir : pathlib.Path or KidCase
        Folder with ``input.nml`` and the restart folder it names; or the case that `load_case` made of it.
    output : pathlib.Path
        Trajectory file; or a folder, in which the files get the names of the namelist.
    progress : Recorder, optional
        Called after every long step, for example to show a bar.
    ranks : tuple of int, optional
        Processes along x and y of the run of the reference that is followed; only footloose calving depends on them.

    Returns
    -------
    KidReport
        Treatment of each namelist entry, and the files written.

    Raises
    ------
    InputError
        Before the first step, if something is missing, unknown, unsupported or impossible.
    RunError
        If the run fails; the last good state is written first.
    KeyboardInterrupt
        After Ctrl-C, at the end of the step in hand; the state is written first. So it is with the SystemExit after a
        request to terminate.
    """
    with held():
        return _run(case_dir, output, progress, ranks)


def _run(case_dir: Path | KidCase, output: Path, progress: Recorder | None, ranks: tuple[int, int]) -> KidReport:
    case = case_dir if isinstance(case_dir, KidCase) else load_case(Path(case_dir), ranks)
    for note in case.notes:
        _LOG.warning(note)
    paths = _output_paths(case, Path(output))
    writers = _writers(case, paths)
    files, restarts = [writer.path for writer in writers], _restart_paths(case, paths)
    with only_writer(*files, *restarts):
        _advance(case, [*writers, *([] if progress is None else [progress])], paths, writers)
        _write_restarts(case, paths)
    return KidReport(case, (*files, *restarts), (*case.namelist.report(), *case.notes))


def _advance(case: KidCase, recorders: list[Recorder], paths: dict[str, Path], writers: list[Writer]) -> None:
    """Take all steps; where the run ends before, write its state and say how to go on."""
    try:
        if case.exchange is None:
            case.model.advance(steps=case.clock.steps, recorders=recorders)
        else:
            case.exchange.advance(recorders)
    except (KeyboardInterrupt, SystemExit):
        progress = f"{case.model.step_number} of {case.clock.steps} steps"
        say(f"Stopped after {progress}; {_write_rescue(case, paths)}")
        raise
    except Exception as error:
        # Elements of KID are known by two numbers and a run of it may allow what the model refuses.
        if isinstance(error, SpeedError):
            error = RunError(f"{error} or --allow-extreme; by KID's names it is {id_text(error.element)}")
        if case.model.step_number == 0:
            for writer in writers:  # nothing was run: no file may look like a result
                writer.discard()
            if isinstance(error, RunError):
                raise RunError(f"the run failed in its first step: {error}. Nothing was written") from error
        if not isinstance(error, RunError):
            raise
        raise RunError(f"{error}; {_write_rescue(case, paths, 'last good ')}") from error


def _write_rescue(case: KidCase, paths: dict[str, Path], which: str = "") -> str:
    """Write the state and say how to go on from it."""
    try:
        saved = _write_restarts(case, paths)
    except (OSError, RiftbergError) as error:  # it must not hide why the run ended
        return f"the {which}state cannot be saved ({refusal(error)})"
    return f"the {which}state is in {', '.join(map(str, saved))}. {_restart_advice(case, saved)}"


def _restart_advice(case: KidCase, saved: list[Path]) -> str:
    """Say how KID's own restart files start another run, which takes the steps and the hours of the forcing that are left."""
    folder, steps_done, driver = "a copy of the run folder", case.model.step_number, case.namelist.driver
    rest = f"set nmax = {case.clock.steps - steps_done}"
    if driver.flag("a68_test"):
        hours = steps_done * case.clock.dt / 3600.0
        rest += f" and transient_a68_data_start_ind = {driver.whole('transient_a68_data_start_ind') + int(hours)}"
        rest += ", whose hour begins half an hour before this state" if hours % 1.0 else ""
    if case.namelist.coupled:
        return f"To go on, put the first two into {folder} as INPUT/{RESTART} and INPUT/{CALVING_FILE}"
    stores = [] if case.exchange is None else [f"INPUT/{CALVING_FILE}"]
    bonds = [] if case.parameters.bonds.law == "none" else [f"INPUT/{BOND_RESTART}"]
    names = " and ".join([f"INPUT/{RESTART}", *stores, *bonds])
    rest = f"set manually_initialize_bonds = .false., and {rest}" if bonds else f"and {rest}"
    return f"To go on, put {'it' if len(saved) == 1 else 'them'} into {folder} as {names}, {rest}"


def _output_paths(case: KidCase, output: Path) -> dict[str, Path]:
    group = case.namelist.icebergs
    folder = output.is_dir()
    main = output / Path(group.text("traj_name")).name if folder else output
    main.parent.mkdir(parents=True, exist_ok=True)
    if folder and main.name == Path(group.text("bond_traj_name")).name:
        raise group.error(f"traj_name = bond_traj_name = {main.name!r}", "Give the two files different names")
    beside = {
        name: main.with_name(f"{main.stem}_{name}.nc") for name in ("restart", "bonds_restart", "bonds", "calving")
    }
    beside["ocean"] = main.with_name("ocean.nc")
    if folder:
        beside["bonds"] = output / Path(group.text("bond_traj_name")).name
    return {"trajectory": main, **beside}


def _writers(case: KidCase, paths: dict[str, Path]) -> list[Writer]:
    group = case.namelist.icebergs
    if group.flag("ignore_traj"):
        return []
    writers: list[Writer] = [TrajectoryRecorder(paths["trajectory"], group, case.clock)]
    if group.flag("save_bond_traj") and group.flag("iceberg_bonds_on"):
        writers.append(BondRecorder(paths["bonds"], group, case.clock))
    return writers


def _restart_paths(case: KidCase, paths: dict[str, Path]) -> list[Path]:
    exchange = [] if case.exchange is None else [paths["calving"]]
    if case.namelist.coupled:
        return [paths["restart"], *exchange, paths["ocean"]]
    return [paths["restart"], *exchange, *([] if case.parameters.bonds.law == "none" else [paths["bonds_restart"]])]


def _write_restarts(case: KidCase, paths: dict[str, Path]) -> list[Path]:
    model, p = case.model, case.parameters
    write_restart(paths["restart"], model.elements, case.grid, p)
    if case.exchange is not None:
        case.exchange.write_stores(paths["calving"])
    if isinstance(case.exchange, CoupledRun):
        case.exchange.write_ocean(paths["ocean"])
    elif p.bonds.law != "none":
        dem = case.namelist.icebergs.flag("dem")
        write_bonds(paths["bonds_restart"], model.elements, model.bonds, case.grid, dem=dem)
    return _restart_paths(case, paths)
