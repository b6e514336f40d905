"""Ctrl-C and requests to terminate: the step ends, files are readable, the state is saved, and it is said how to go on."""

from __future__ import annotations

import ast
import os
import random
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer

import riftberg
from forked import Program
from riftberg import A68A_2022, Forcing, Iceberg, Model, open_run
from riftberg.cli.options import report_errors
from riftberg.runs.restart import load_state
from riftberg.system import process as interrupts
from riftberg.system.process import held, insisting

EXIT_INTERRUPTED = 130

SOURCES = Path(riftberg.__file__).parent

PROGRAM = """
import sys
from riftberg import Forcing, Iceberg, Model
from riftberg import A68A_2022
scheme, how, out = sys.argv[1:4]
stepping = {"scheme": scheme, **({} if scheme == "mts" else {"time_step": 20.0})}
law = {} if scheme == "mts" else {"bonds": {"law": "spring", "spring": 1e-4}, "fracture": {"enabled": False}}
berg = Iceberg.rectangle(24e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
model = Model(berg, Forcing.uniform(current=(0.3, 0.1), depth=500.0), A68A_2022.changed(stepping=stepping, **law))
class Tell:
    def start(self, model): pass
    def record(self, model):
        if model.step_number == 1: print("ready", flush=True)
    def finish(self, model): pass
if how == "run":
    model.run(steps=10**7, output=out + "/run.nc", recorders=[Tell()])
elif how == "memory":
    model.run(steps=10**7, recorders=[Tell()])
elif how == "advance":
    model.advance(steps=10**7, recorders=[Tell()])
elif how == "step":
    while True:
        model.step()
        Tell().record(model)
"""


def stopped(
    folder: Path, program: str, *arguments: str, number: int = signal.SIGINT, wait: float = 0.0
) -> tuple[int, str]:
    """Run a program, send it a signal ``wait`` seconds after it is ready, and return its exit code and error output."""
    errors = folder.with_name(f"{folder.name}-errors.txt")
    process = Program(program, *arguments, errors=errors)
    try:
        for line in process.printed:
            if line == "ready\n":
                break
        time.sleep(wait)
        process.send_signal(number)
        code = process.wait(60)
        assert code is not None, "the process did not end"
    finally:
        process.kill()
    return code, errors.read_text()


WAYS = [("mts", "memory"), ("runge_kutta", "advance"), ("verlet", "step")]
MORE = [(scheme, how) for how in ("memory", "advance", "step") for scheme in ("mts", "verlet", "runge_kutta")] * 4


@pytest.mark.parametrize(("scheme", "how"), [*WAYS, *(pytest.param(*way, marks=pytest.mark.slow) for way in MORE)])
def test_an_interrupt_is_a_keyboard_interrupt_in_all_ways_of_running(tmp_path: Path, scheme: str, how: str) -> None:
    """A kernel that returned a named tuple died of a segmentation fault when a signal waited, in every second try."""
    # Programs of tests are children of a server, which no script is.
    program = f"import multiprocessing, os; multiprocessing.parent_process = lambda: None; os.chdir({str(tmp_path)!r})\n{PROGRAM}"
    code, errors = stopped(tmp_path, program, scheme, how, str(tmp_path), wait=random.uniform(0.0, 0.1))
    assert code in (1, -signal.SIGINT, 130), errors  # Python ends a program so after a KeyboardInterrupt
    assert "KeyboardInterrupt" in errors
    if how == "step":
        return
    # Named for a season of bergs in a script of which nothing was left: records and state are readable.
    assert "Go on with Model.resume('interrupted.restart.nc', forcing)" in errors
    state = load_state(tmp_path / "interrupted.restart.nc")
    assert state.step_number >= 1
    assert (tmp_path / "interrupted.nc").exists() == (how == "memory")
    if how == "memory":
        with open_run(tmp_path / "interrupted.nc") as run:
            assert (run.time.values[-1] - run.time.values[0]) / np.timedelta64(1, "s") == state.time
            np.testing.assert_array_equal(run.lon.values[:, -1], state.elements.lon)


def check_what_is_left(folder: Path, errors: str) -> None:
    """The file is readable, the state is that of its last record, and the message names it."""
    name = re.search(r"Go on with Model\.resume\('(.*)', forcing\)", errors)
    assert name, errors
    assert Path(name[1]) == folder / "run.interrupted.restart.nc"
    state = load_state(name[1])
    with open_run(folder) as run:
        last = (run.time.values[-1] - run.time.values[0]) / np.timedelta64(1, "s")
        assert last == state.time
        np.testing.assert_array_equal(run.lon.values[:, -1], state.elements.lon)
        assert np.isfinite(run.lon.values).all()
    assert sorted(path.name for path in folder.iterdir()) == ["run.interrupted.restart.nc", "run.nc"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_with_output_leaves_file_state_and_the_way_to_go_on(tmp_path: Path, number: int) -> None:
    code, errors = stopped(tmp_path, PROGRAM, "mts", "run", str(tmp_path), number=number, wait=random.uniform(0.0, 0.5))
    assert code == 128 + signal.SIGTERM if number == signal.SIGTERM else code in (1, -number, 130), errors
    check_what_is_left(tmp_path, errors)


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(20))
def test_interrupts_at_many_moments(tmp_path: Path, trial: int) -> None:
    code, errors = stopped(tmp_path, PROGRAM, "mts", "run", str(tmp_path), wait=random.uniform(0.0, 2.0))
    assert code in (1, -signal.SIGINT, 130), errors
    check_what_is_left(tmp_path, errors)


KID = """
import sys
from pathlib import Path
from riftberg.kid.run import run_kid
class Tell:
    def start(self, model): pass
    def record(self, model):
        if model.step_number == 1: print("ready", flush=True)
    def finish(self, model): pass
run_kid(Path(sys.argv[1]), Path(sys.argv[2]), progress=Tell())
"""


@pytest.mark.parametrize("trial", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 10))])
def test_a_kid_run_leaves_its_restart(tmp_path: Path, trial: int) -> None:
    """`riftberg kid` died of a segmentation fault on every second Ctrl-C."""
    from kid.conftest import write_case

    # At rest and with sub-steps short enough for its springs: else the run ends by itself within a second.
    still = {"ibhrs": 10**6, "nmax": 10**8, "ibuo": 0.0}
    case = write_case(tmp_path / "case", still, {"traj_sample_hrs": -1.0, "mts_sub_steps": 60})
    code, errors = stopped(tmp_path, KID, str(case), str(tmp_path / "KID.nc"), wait=random.uniform(0.0, 0.3))
    assert code in (1, -signal.SIGINT, 130), errors
    assert "To go on, put them into a copy of the run folder" in errors
    import netCDF4

    with netCDF4.Dataset(tmp_path / "KID_restart.nc") as state, netCDF4.Dataset(tmp_path / "KID.nc") as track:
        assert len(track.dimensions["i"]) % 2 == 0
        np.testing.assert_array_equal(state["lon"][:], track["lon"][-2:])
    assert (tmp_path / "KID_bonds_restart.nc").exists()


def model() -> Model:
    berg = Iceberg.rectangle(24e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(0.3, 0.1), depth=500.0, slope=(0.0, 0.0)))


class Presses:
    """Recorder that presses Ctrl-C after some steps."""

    def __init__(self, *steps: int) -> None:
        self.steps = steps

    def start(self, model: Model) -> None: ...

    def record(self, model: Model) -> None:
        for _ in range(self.steps.count(model.step_number)):
            os.kill(os.getpid(), signal.SIGINT)

    def finish(self, model: Model) -> None: ...


def test_the_step_in_hand_ends_and_the_signals_are_handed_back(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    m, before = model(), [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    with pytest.raises(KeyboardInterrupt):
        m.advance(steps=10, recorders=[Presses(3)])
    assert m.step_number == 3
    assert "press Ctrl-C again" in capsys.readouterr().err
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == before
    other = model()
    other.advance(steps=3)
    theirs = other.elements.arrays()
    assert [name for name, a in m.elements.arrays().items() if a.tobytes() != theirs[name].tobytes()] == []
    m.advance(steps=1)  # it is not remembered


def test_a_second_interrupt_ends_at_once() -> None:
    reached = []

    def press() -> None:
        with held():
            for number in (1, 2):
                os.kill(os.getpid(), signal.SIGINT)
                reached.append(number)

    with pytest.raises(KeyboardInterrupt):
        press()
    assert reached == [1]


def test_a_program_that_handles_signals_itself_goes_on_doing_so() -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        m = model()
        m.advance(steps=3, recorders=[Presses(2)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIGINT]
    assert m.step_number == 3


def test_runs_in_other_threads_need_no_signals() -> None:
    m, errors = model(), []

    def work() -> None:
        try:
            m.run(steps=2)
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert errors == []
    assert m.step_number == 2


def test_a_loop_of_runs_ends_with_the_first_interrupt() -> None:
    done = []

    def sweep() -> None:
        with held():
            for _ in range(3):
                m = model()
                m.advance(steps=4, recorders=[Presses(2)])
                done.append(m)

    with pytest.raises(KeyboardInterrupt):
        sweep()
    assert done == []


@cache
def _trees() -> list[ast.Module]:
    return [ast.parse(path.read_text()) for path in SOURCES.rglob("*.py")]


@cache
def _called() -> frozenset[str]:
    """Names of all that Python functions of the package call."""
    return frozenset(name for tree in _trees() for name in _calls(tree))


def _calls(tree: ast.AST) -> Iterator[str]:
    """Names of what Python functions of a module call; what kernels call is compiled code."""
    nodes = [tree]
    while nodes:
        node = nodes.pop()
        marks = {ast.unparse(mark) for mark in getattr(node, "decorator_list", ())}
        if marks & {"kernel", "borrower", "stage"}:
            continue
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            yield node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        nodes.extend(ast.iter_child_nodes(node))


def _named_tuples_returned(tree: ast.AST, named: set[str]) -> set[str]:
    """Names of the kernels of a module that say that they return one of the classes ``named``."""
    return {
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and {ast.unparse(mark) for mark in node.decorator_list} & {"kernel", "borrower", "stage"}
        and node.returns is not None
        and any(isinstance(part, ast.Name) and part.id in named for part in ast.walk(node.returns))
    }


def test_no_kernel_that_python_calls_says_that_it_returns_a_named_tuple() -> None:
    """Of all kernels, also of those that no test has compiled in this process."""
    named = {
        node.name
        for tree in _trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases)
    }
    returning = set().union(*(_named_tuples_returned(tree, named) for tree in _trees()))
    assert returning, "the search itself finds none"
    assert returning & _called() == set()


def test_no_kernel_that_python_calls_returns_a_named_tuple() -> None:
    """Of all kernels that have been compiled; see `riftberg.compiled.kernels`."""
    from numba.core.dispatcher import Dispatcher
    from numba.core.types import BaseNamedTuple, BaseTuple

    def named(kind: object) -> bool:
        return isinstance(kind, BaseNamedTuple) or (isinstance(kind, BaseTuple) and any(map(named, kind)))

    spring = {"bonds": {"law": "spring", "spring": 1e-4}, "fracture": {"enabled": False}}
    for scheme, dt in (("mts", 1800.0), ("quasi_static", 1800.0), ("verlet", 20.0), ("runge_kutta", 20.0)):
        law = spring if scheme in {"verlet", "runge_kutta"} else {}
        p = A68A_2022.changed(stepping={"scheme": scheme, "time_step": dt}, **law)
        berg = Iceberg.rectangle(24e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
        Model(berg, Forcing.uniform(current=(0.3, 0.1), depth=500.0, slope=(0.0, 0.0)), p).run(steps=2)
    returning = {
        name
        for module in list(sys.modules.values())
        if getattr(module, "__name__", "").startswith("riftberg")
        for name, value in vars(module).items()
        if isinstance(value, Dispatcher)
        # Named tuples are read by a kernel of their own (`riftberg.compiled.parts.TupleKernel`).
        for called in (value, *(call.__globals__["by_address"] for call in getattr(value, "_calls", {}).values()))
        if any(named(compiled.signature.return_type) for compiled in called.overloads.values())
    }
    assert returning & _called() == set()


def _loses_the_first() -> None:
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        time.sleep(0.01)


def _makes_an_error_of_it() -> None:
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ValueError("Invalid bounding box") from None


@pytest.mark.parametrize("library", [_loses_the_first, _makes_an_error_of_it])
def test_a_command_ends_where_a_library_loses_the_interrupt(
    library: Callable[[], None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Seen in 1 of 150 replays (netCDF4 went on reading) and 1 of 250 pictures (a ValueError of matplotlib)."""
    monkeypatch.setattr(interrupts, "AGAIN", 0.05)
    begun, threads = time.monotonic(), threading.active_count()
    with pytest.raises(typer.Exit) as ended:
        report_errors(library)()
    assert ended.value.exit_code == EXIT_INTERRUPTED
    assert capsys.readouterr().err == "Interrupted.\n"
    assert time.monotonic() - begun < 5.0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    time.sleep(0.2)  # nothing comes any more
    assert threading.active_count() == threads


def test_a_run_in_a_command_still_ends_its_step(capsys: pytest.CaptureFixture[str]) -> None:
    """What holds signals back takes them over from a command that insists."""

    def run() -> None:
        with held() as hold:
            signal.raise_signal(signal.SIGINT)
            heard.append(hold.requested)

    heard: list[int] = []
    with pytest.raises(typer.Exit) as ended:
        report_errors(run)()
    assert ended.value.exit_code == EXIT_INTERRUPTED
    assert heard == [signal.SIGINT]
    assert "Stopping after this step" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_error_without_an_interrupt_stays_an_error() -> None:
    with pytest.raises(ValueError, match="a bug"), insisting():
        raise ValueError("a bug")
