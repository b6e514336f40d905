"""Faults of the machine: outputs in use, disks that are full, kills, closed streams, and restarts that index memory."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from fuzz.base_files import EXPERIMENT, TRACK, changed_nc, copied
from fuzz.judging import SOON, Kind, Truth, call
from fuzz.kinds import RESUME, resealed

LONG = EXPERIMENT.replace("days: 0.0625", "days: 12").replace("output_every_hours: 0.5", "output_every_hours: 0.5")
RUN = ["run", "good.yaml", "-o", "out", "-q", "--no-map"]


def _beside(work: Callable[[], Any]) -> int:
    """Do something in a process of its own, forked from this one, and return its number."""
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            os.setpgid(0, 0)
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
            for number, handler in (
                (signal.SIGINT, signal.default_int_handler),
                (signal.SIGTERM, signal.SIG_DFL),
                (signal.SIGHUP, signal.SIG_DFL),
            ):
                signal.signal(number, handler)
            for clock in (signal.ITIMER_REAL, signal.ITIMER_PROF):
                signal.setitimer(clock, 0.0)
            work()
        os._exit(0)
    return child


def _wait_for(check: Callable[[], Any], seconds: float = 60.0) -> None:
    began = time.monotonic()
    while not check() and time.monotonic() - began < seconds:
        time.sleep(0.05)


def _files(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*")} if folder.is_dir() else set()


# --- outputs -------------------------------------------------------------------------------------------------------------


def outputs_in_use() -> Iterator[Kind]:
    """Name an output that another command is writing: the other's files survive, and it ends well."""
    f = "outputs in use"
    running: list[int] = []

    def with_other(
        first: list[str], second: list[str], text: str = LONG, *, stopped: bool = True
    ) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "run.nc")
            (folder / "good.yaml").write_text(text)
            (folder / "seen.csv").write_text(TRACK)
            if "kid" in (first[0], second[0]):
                copied(folder, "case")
                (folder / "out").mkdir()
            if first[0] == "kid":  # long enough to be met at work
                namelist = folder / "case" / "input.nml"
                text_ = namelist.read_text().replace("ibhrs = 1\n", "ibhrs = 60\n")
                assert "ibhrs = 60" in text_
                namelist.write_text(text_.replace("mts_sub_steps = 10\n", "mts_sub_steps = 100\n"))
            child = _beside(lambda: call(first, 600.0))
            running[:] = [child]
            _wait_for(lambda: len(_files(folder / "out")) > 0)
            if stopped:
                os.kill(child, signal.SIGSTOP)
            return second

        return make

    def survived(folder: Path) -> str:
        child = running[0]
        before = _files(folder / "out")
        os.kill(child, signal.SIGCONT)
        began = time.monotonic()
        while os.waitpid(child, os.WNOHANG)[0] == 0:
            if time.monotonic() - began > 400.0:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return "the first command never ended"
            time.sleep(0.05)
        after = _files(folder / "out")
        whole = any(name.endswith(".nc") and "lock" not in name for name in after)
        return "" if whole else f"the files of the first command are gone: {sorted(before)} to {sorted(after)}"

    kid, run = ["kid", "case", "-o", "out", "-q"], [*RUN]
    for name, first, second in (
        ("kid twice", kid, kid), ("kid into a run", run, kid), ("run twice", run, run), ("run into kid", kid, run), ("kid with a broken namelist", kid, ["kid", "nowhere", "-o", "out", "-q"]), ("run of another file", run, ["run", "nowhere.yaml", "-o", "out", "-q"]), ("run with a mistake", run, [*run, "--set", "ice.density=-1"]), ("sweep", run, ["sweep", "good.yaml", "--vary", "ice.density=880,900", "-o", "out", "-q", "--workers", "0", "--no-map", "--days", "0.0625"]),
        ("a resumed run", run, [*run, "--resume", "nowhere.nc"]), ("both numerics", run, ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--numerics", "both", "--days", "0.0625"]),
    ):  # fmt: skip
        yield Kind(f, name, with_other(first, second), (), False, None, (), survived, SOON)


def outputs_there() -> Iterator[Kind]:
    """Fail with an output folder that holds results of another day: they stay as they were."""
    f = "results that are there already"

    def make_of(arguments: list[str], files: dict[str, str]) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "good.yaml", "run.nc", "case", "good.restart.nc")
            (folder / "seen.csv").write_text(TRACK)
            (folder / "bad.yaml").write_text(EXPERIMENT.replace("thickness: 200", "thickness: none.nc"))
            (folder / "late.yaml").write_text(
                EXPERIMENT.replace("current: [0.2, 0.0]", "current: [0.2, 0.0]\n  wind_: 3")
            )
            (folder / "out").mkdir()
            for name, content in files.items():
                (folder / "out" / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / "out" / name).write_text(content)
            return arguments

        return make

    def kept(files: dict[str, str]) -> Callable[[Path], str]:
        def check(folder: Path) -> str:
            lost = [
                n
                for n, content in files.items()
                if not (folder / "out" / n).exists() or (folder / "out" / n).read_text() != content
            ]
            return f"lost or changed: {', '.join(lost)}" if lost else ""

        return check

    old = {"run.nc": "old", "summary.json": "{}", "map.png": "old", "notes.txt": "mine"}
    traj = {
        "bergs.nc": "old",
        "iceberg_trajectories.nc": "old",
        "icebergs.res.nc": "old",
        "bonds_iceberg.res.nc": "old",
        "notes.txt": "mine",
    }
    for name, arguments, files in (
        ("run with a mistake", ["run", "bad.yaml", "-o", "out", "-q", "--no-map"], old), ("run with an unknown key", ["run", "late.yaml", "-o", "out", "-q", "--no-map"], old), ("run with a wrong restart", ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--resume", "run.nc"], old), ("kid with a wrong folder", ["kid", "good.yaml", "-o", "out", "-q"], traj), ("kid without input", ["kid", "nowhere", "-o", "out", "-q"], traj),
        ("score without observations", ["score", "run.nc", "nowhere.csv", "-o", "out"], {"score.json": "old", "score.png": "old"}), ("plot of nothing", ["plot", "nowhere.nc", "-o", "out"], {"timeline.png": "old", "map.png": "old"}), ("why of nothing", ["why", "nowhere.nc", "-o", "out"], {"why.json": "old"}), ("sweep with a mistake", ["sweep", "good.yaml", "--vary", "ice.density=a,b", "-o", "out", "-q"], {"sweep.nc": "old", "sweep.png": "old", "members/0/run.nc": "old"}), ("compare with nothing", ["compare", "nowhere", "-o", "out"], {"comparison.json": "old"}),
    ):  # fmt: skip
        yield Kind(f, name, make_of(arguments, files), (), True, None, (), kept(files), SOON)


def full_disks() -> Iterator[Kind]:
    """Let no file grow beyond some bytes, as on a full disk or under a quota: it is called so, and what was written is good."""
    f = "no room for the output"

    def limited(size: int, arguments: list[str] = RUN, text: str = LONG) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "run.nc", "case")
            (folder / "good.yaml").write_text(text.replace("days: 12", "days: 4"))
            (folder / "seen.csv").write_text(TRACK)
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
            return arguments

        return make

    def good(folder: Path) -> str:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        for path in (folder / "out").rglob("*.nc") if (folder / "out").is_dir() else ():
            try:
                with netCDF4.Dataset(path) as file:
                    assert file.variables
            except (OSError, RuntimeError, AssertionError):
                return f"{path.name} does not open"
        return ""

    cause = ("full|room|space|ulimit|quota|larger",)
    for name, size, arguments in (
        ("run, 1 kB", 1000, RUN), ("run, 20 kB", 20_000, RUN), ("run, 60 kB", 60_000, RUN), ("run, 120 kB", 120_000, RUN), ("run with forces, 80 kB", 80_000, [*RUN, "--forces"]), ("run with cells, 30 kB", 30_000, [*RUN, "--cells", "0.5"]),
        ("kid, 2 kB", 2000, ["kid", "case", "-o", "out", "-q"]), ("score, 100 bytes", 100, ["score", "run.nc", "seen.csv", "-o", "out", "--no-figure"]), ("replay, 5 kB", 5000, ["replay", "run.nc", "-o", "out/replay.html"]), ("why, 100 bytes", 100, ["why", "run.nc", "-o", "out", "--no-figure", "-q"]),
    ):  # fmt: skip
        yield Kind(f, name, limited(size, arguments), ("out", "disk", "file"), False, None, cause, good, SOON)


def kills() -> Iterator[Kind]:
    """Kill a run at some moment and go on from what it left: without a gap, and bit for bit."""
    f = "runs that were killed"
    text = LONG.replace("days: 12", "days: 240").replace("output_every_hours: 0.5", "output_every_hours: 6")

    def killed(number: int, records: float, extra: tuple[str, ...] = ()) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            (folder / "good.yaml").write_text(text)
            child = _beside(lambda: call([*RUN, *extra], 600.0))
            _wait_for(lambda: len(_files(folder / "out")) > 0)
            time.sleep(records)
            os.kill(child, number)
            os.waitpid(child, 0)
            saved = sorted((folder / "out").glob("*restart*"), key=lambda p: p.stat().st_mtime)
            if not saved:  # it had ended before: then the folder is named, and the answer is judged
                return ["run", "good.yaml", "-q", "--no-map", "--resume", "out"]
            return ["run", "good.yaml", "-q", "--no-map", "--resume", str(saved[-1]), "-o", "rest"]

        return make

    def whole(folder: Path, said: str) -> str:
        call(["run", "good.yaml", "-o", "never", "-q", "--no-map"], 600.0)
        with xr.open_dataset(folder / "never" / "run.nc") as want, xr.open_dataset(folder / "rest" / "run.nc") as got:
            same = (
                np.array_equal(want["lon"].values[:, -1], got["lon"].values[:, -1])
                and want["time"].values[-1] == got["time"].values[-1]
            )
        return "" if same else "the run that went on ends elsewhere"

    for name, number, pause in (
        ("SIGTERM soon", signal.SIGTERM, 0.2), ("SIGTERM later", signal.SIGTERM, 1.0), ("SIGINT soon", signal.SIGINT, 0.2), ("SIGINT later", signal.SIGINT, 1.0), ("hang-up soon", signal.SIGHUP, 0.2), ("hang-up later", signal.SIGHUP, 1.0), ("hang-up at once", signal.SIGHUP, 0.0), ("SIGTERM at once", signal.SIGTERM, 0.0), ("SIGINT at once", signal.SIGINT, 0.0), ("hang-up last", signal.SIGHUP, 2.0),
    ):  # fmt: skip
        yield Kind(
            f,
            name,
            killed(number, pause),
            ("restart", "out", "--resume"),
            False,
            Truth(whole),
            ("has come to its end|run.nc: no such file",),
            None,
            SOON,
        )


def streams() -> Iterator[Kind]:
    """Close the streams of a command: it does its work, or says so in its exit code."""
    f = "streams that are closed"

    def closed(arguments: list[str], numbers: tuple[int, ...], pipe: bool = False) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "good.yaml", "run.nc", "ocean.nc", "case")
            (folder / "seen.csv").write_text(TRACK)
            import subprocess

            def before() -> None:
                for number in numbers:
                    if pipe:
                        out, into = os.pipe()
                        os.close(out)
                        os.dup2(into, number)
                    else:
                        os.close(number)

            done = subprocess.run(
                [sys.executable, "-m", "riftberg", *arguments],
                cwd=folder,
                preexec_fn=before,
                check=False,
                stdin=subprocess.DEVNULL,
            )
            (folder / "code").write_text(str(done.returncode))
            return ["experiments"]

        return make

    def done(file: str, code: str = "0") -> Callable[[Path, str], str]:
        def wrong(folder: Path, text: str) -> str:
            got = (folder / "code").read_text()
            if got != code:
                return f"exit code {got} for {code}"
            return "" if not file or (folder / file).exists() else f"no {file}"

        return wrong

    run = [*RUN]
    for name, arguments, numbers, pipe, file, code in (
        ("run without stderr", run, (2,), False, "out/run.nc", "0"), ("run without stdout", run, (1,), False, "out/run.nc", "0"), ("run without either", run, (1, 2), False, "out/run.nc", "0"), ("run with a broken pipe for stderr", run, (2,), True, "out/run.nc", "0"), ("run with progress, without stderr", [a for a in run if a != "-q"], (2,), False, "out/run.nc", "0"),
        ("a mistake without stderr", ["run", "nowhere.yaml", "-o", "out"], (2,), False, "", "2"), ("kid without stderr", ["kid", "case", "-o", "out"], (2,), False, "out", "0"), ("score without stderr", ["score", "run.nc", "seen.csv", "--no-figure", "-o", "out"], (2,), False, "out/score.json", "0"), ("doctor without stderr", ["doctor", "ocean.nc"], (2,), False, "", "0"), ("run without stdin and stderr", run, (0, 2), False, "out/run.nc", "0"),
    ):  # fmt: skip
        yield Kind(f, name, closed(arguments, numbers, pipe), (), False, Truth(done(file, code)), (), None, SOON)


# --- restarts ------------------------------------------------------------------------------------------------------------


def _restart(change: Callable[[dict[str, Any], dict[str, int], dict[str, Any]], Any]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "good.restart.nc", "good.yaml")
        changed_nc(folder / "good.restart.nc", change)
        resealed(folder / "good.restart.nc")
        (folder / "good.restart.nc").rename(folder / "bad.restart.nc")
        return RESUME

    return make


def _value(name: str, value: Any, index: Any = 0, kind: str | None = None) -> Callable[..., None]:
    def change(table: dict[str, Any], sizes: dict[str, int], attributes: dict[str, Any]) -> None:
        dtype, dims, values, own = table[name]
        new = np.array(values).astype(kind) if kind else np.array(values)
        if new.ndim:
            new.reshape(-1)[index] = value
        else:
            new = np.array(value, new.dtype)
        table[name] = [kind or dtype, dims, new, own]

    return change


def restart_extras() -> Iterator[Kind]:
    """Give restarts whose extra group indexes memory that is not there."""
    f = "restart, what indexes memory in the extra group"
    for name, change in {
        "rigid_body of 2**63 - 1": _value("extra/rigid_body", 2**63 - 1), "rigid_body of 2**31": _value("extra/rigid_body", 2**31), "rigid_body of -1": _value("extra/rigid_body", -1), "rigid_body of 7": _value("extra/rigid_body", 7), "rigid_body of -2**63": _value("extra/rigid_body", -(2**63)), "rigid_left_id of 10**9": _value("extra/rigid_left_id", 10**9), "rigid_left_id twice": _value("extra/rigid_left_id", 2, 0), "next_element of 1": _value("extra/next_element", 1), "next_element of 2**63 - 1": _value("extra/next_element", 2**63 - 1), "next_bond of -1": _value("extra/next_bond", -1),
    }.items():  # fmt: skip
        yield Kind(f, name, _restart(change), ("bad.restart.nc",), True, seconds=SOON)


def restart_tables() -> Iterator[Kind]:
    """Give restarts whose tables in the extra group have other shapes, kinds and numbers."""
    f = "restart, tables of the extra group"

    def shorter(name: str, count: int) -> Callable[..., None]:
        def change(table: dict[str, Any], sizes: Any, attributes: Any) -> None:
            table[f"extra/{name}"][2] = np.array(table[f"extra/{name}"][2])[:count]

        return change

    def gone(name: str) -> Callable[..., None]:
        return lambda table, sizes, attributes: table.pop(f"extra/{name}") and None  # type: ignore[func-returns-value]

    def text(name: str) -> Callable[..., None]:
        def change(table: dict[str, Any], sizes: Any, attributes: Any) -> None:
            values = np.array(table[f"extra/{name}"][2])
            table[f"extra/{name}"] = ["S1", (), np.full(values.shape, b"x"), {}]

        return change

    for name, change in {
        "rigid_body shorter": shorter("rigid_body", 3), "rigid_shape shorter": shorter("rigid_shape", 2), "rigid_pose of none": shorter("rigid_pose", 0), "motion_ledger shorter": shorter("motion_ledger", 5), "rigid_pose left out": gone("rigid_pose"), "rigid_body of text": text("rigid_body"), "next_element of text": text("next_element"), "NaN in rigid_pose": _value("extra/rigid_pose", np.nan), "NaN in motion_ledger": _value("extra/motion_ledger", np.nan), "1e300 in rigid_rate": _value("extra/rigid_rate", 1e300),
    }.items():  # fmt: skip
        yield Kind(f, name, _restart(change), ("bad.restart.nc",), True, seconds=SOON)


def restart_indexes() -> Iterator[Kind]:
    """Give restarts whose elements and bonds point where nothing is."""
    f = "restart, what indexes memory"
    for name, change in {
        "bond_first of 2**62": _value("bond_first", 2**62), "bond_second of -7": _value("bond_second", -7), "bond to itself": _value("bond_second", 0, 0), "element_berg of 2**40": _value("element_berg", 2**40), "element_berg of -5": _value("element_berg", -5), "element_cell_i of 10**9": _value("element_cell_i", 10**9), "element_cell_j of -10**9": _value("element_cell_j", -(10**9)), "element_bond_count of 2**31": _value("element_bond_count", 2**31), "element_sides of -4": _value("element_sides", -4), "element_substeps of 2**60": _value("element_substeps", 2**60),
    }.items():  # fmt: skip
        yield Kind(f, name, _restart(change), ("bad.restart.nc", "element", "bond"), True, seconds=SOON)


def restart_gaps() -> Iterator[Kind]:
    """Give restarts with NaN and impossible numbers where the run goes on with them: never on in silence."""
    f = "restart, numbers that are none"
    with_what = {
        "NaN in the current": _value("element_uo", np.nan), "NaN in the slope": _value("element_slope_x", np.nan), "NaN in the wind": _value("element_va", np.nan), "NaN in the depth": _value("element_depth", np.nan), "NaN in a rest length": _value("bond_rest_length", np.nan), "inf in a rest length": _value("bond_rest_length", np.inf), "a rest length of nothing": _value("bond_rest_length", 0.0), "NaN in an acceleration": _value("element_ax", np.nan), "a speed of 1e4": _value("element_u", 1e4), "NaN in the mass at the start": _value("element_start_mass", np.nan),
    }  # fmt: skip

    def same(folder: Path, text: str) -> str:
        call([*RESUME[:-1], "good.restart.nc", "-o", "good"])
        copied(folder, "good.restart.nc")
        call(["run", "good.yaml", "-o", "fine", "-q", "--no-map", "--resume", "good.restart.nc"])
        with xr.open_dataset(folder / "fine" / "run.nc") as want, xr.open_dataset(folder / "out" / "run.nc") as got:
            return (
                ""
                if np.array_equal(want["lon"].values, got["lon"].values)
                and np.array_equal(want["u"].values, got["u"].values)
                else "goes on elsewhere"
            )

    for name, change in with_what.items():
        yield Kind(
            f,
            name,
            _restart(change),
            ("bad.restart.nc", "element", "bond"),
            False,
            Truth(same, ("NaN|missing|restart",)),
            seconds=SOON,
        )


FAMILIES: tuple[Callable[[], Iterator[Kind]], ...] = (
    outputs_in_use, outputs_there, full_disks, kills, streams, restart_extras, restart_tables, restart_indexes, restart_gaps,
)  # fmt: skip
"""All families of this module."""
