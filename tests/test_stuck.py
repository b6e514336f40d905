"""Files that never open: pipes are refused; Ctrl-C and a limit of time end the wait for a library in its loop, or a server."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import netCDF4
import pytest
from typer.testing import CliRunner

from forked import COMMAND, Program
from riftberg.cli.main import app
from riftberg.system import process
from riftberg.system.netcdf_lock import open_lazily, open_netcdf

HANG = (
    Path(os.environ.get("RIFTBERG_SHARED") or Path(__file__).parents[2] / "shared") / "data" / "hostile" / "hang_sea.nc"
)


@pytest.fixture
def limited() -> Iterator[None]:
    """End a test that waits for a pipe."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(90)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("opened", [lambda path: open_netcdf(path).__enter__(), open_lazily])
def test_a_pipe_is_refused_by_whatever_opens_files(
    tmp_path: Path, limited: None, opened: Callable[[Path], Any]
) -> None:
    os.mkfifo(tmp_path / "pipe.nc")
    with pytest.raises(OSError, match=r"a pipe, not a file.*pipe\.nc"):
        opened(tmp_path / "pipe.nc")


def test_the_doctor_does_not_wait_for_a_pipe(tmp_path: Path, limited: None) -> None:
    """It asked what else the file might be, past the check of the reader that had refused it."""
    os.mkfifo(tmp_path / "pipe.nc")
    result = CliRunner().invoke(app, ["doctor", str(tmp_path / "pipe.nc")])
    assert result.exit_code != 0
    assert "a pipe, not a file" in result.output


class Slow(netCDF4.Dataset):
    """Takes half a second to open. It outlives all of its files: netCDF4 asks for its class as it closes them."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        time.sleep(0.5)
        super().__init__(*arguments, **options)


@pytest.fixture
def slow_library(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return a file that the library takes half a second to open, where a twentieth is given."""
    path = tmp_path / "slow.nc"
    netCDF4.Dataset(path, "w").close()
    monkeypatch.setattr(netCDF4, "Dataset", Slow)
    monkeypatch.setattr(process, "STUCK_AFTER", 0.05)
    return path


@pytest.mark.parametrize("opened", [lambda path: open_netcdf(path).__enter__(), open_lazily])
def test_a_file_that_does_not_open_in_time_is_an_error(
    slow_library: Path, opened: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(TimeoutError, match=r"has not opened within .* as if damaged"):
        opened(slow_library)
    with pytest.raises(OSError, match=r"because .*slow\.nc never opened"):
        opened(slow_library)
    time.sleep(0.8)  # it comes after all, and others can be opened again
    monkeypatch.setattr(process, "STUCK_AFTER", 60.0)
    with open_netcdf(slow_library) as file:
        assert file.isopen()


@pytest.mark.parametrize("command", ["doctor", "plot", "score"])
def test_the_command_line_says_so_in_one_sentence(slow_library: Path, command: str) -> None:
    result = CliRunner().invoke(app, [command, str(slow_library), *(["seen.csv"] if command == "score" else [])])
    assert result.exit_code != 0
    assert "slow.nc" in result.output
    assert "has not opened within" in result.output
    time.sleep(0.8)


LOOP = """
import sys, threading, netCDF4
from riftberg.cli.main import app
from riftberg.system import process
class Endless(netCDF4.Dataset):
    def __init__(self, *words, **options):
        print("in the loop", flush=True)
        while True:
            threading.Event().wait(60)
netCDF4.Dataset = Endless
process.STUCK_AFTER = float(sys.argv[1])
app(sys.argv[2:], prog_name="riftberg")
"""


@pytest.mark.parametrize(
    "words",
    [["doctor", "{}"], ["plot", "{}"], ["replay", "{}"], ["why", "{}"], ["compare", "{}", "{}"]],
    ids=lambda words: words[0],
)
def test_ctrl_c_ends_the_wait_for_a_library_in_its_loop(tmp_path: Path, words: list[str]) -> None:
    """Two of them did nothing: a C library hears no signal."""
    netCDF4.Dataset(tmp_path / "run.nc", "w").close()
    program = Program(LOOP, "60", *(word.format(tmp_path / "run.nc") for word in words), errors=tmp_path / "errors.txt")
    try:
        assert program.printed.readline() == "in the loop\n"
        program.send_signal(signal.SIGINT)
        assert program.wait(60) == 130
        assert (tmp_path / "errors.txt").read_text() == "Interrupted.\n"
    finally:
        program.kill()


def test_a_process_that_gives_up_ends_with_an_error(tmp_path: Path) -> None:
    netCDF4.Dataset(tmp_path / "sea.nc", "w").close()
    program = Program(LOOP, "0.2", "plot", str(tmp_path / "sea.nc"), errors=tmp_path / "errors.txt")
    try:
        assert program.wait(60) == 2
        assert (
            "sea.nc: not a NetCDF file, or a damaged one (has not opened within"
            in (tmp_path / "errors.txt").read_text()
        )
    finally:
        program.kill()


@pytest.fixture
def silent() -> Iterator[str]:
    """Give an OPeNDAP address whose server takes every call and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"http://127.0.0.1:{server.getsockname()[1]}/thredds/dodsC/sea.nc"


def test_ctrl_c_ends_the_wait_for_a_server_that_never_answers(silent: str, tmp_path: Path) -> None:
    """It did nothing: the library asks the server in mid-call."""
    program = Program(
        COMMAND.replace("app(", "print('asking', flush=True)\napp("), "doctor", silent, errors=tmp_path / "errors.txt"
    )
    try:
        assert program.printed.readline() == "asking\n"
        assert program.wait(3) is None
        program.send_signal(signal.SIGINT)
        assert program.wait(60) == 130
        assert (tmp_path / "errors.txt").read_text() == "Interrupted.\n"
    finally:
        program.kill()


@pytest.mark.parametrize("words", [["doctor"], ["run"]], ids=lambda words: words[0])
def test_a_server_that_never_answers_is_given_up(silent: str, words: list[str], tmp_path: Path) -> None:
    """By whoever asks, in a sentence without what the address keeps secret."""
    address = silent.replace("//", "//me:s3cret@")
    (tmp_path / "sea.yaml").write_text(
        "start: 2020-12-09\ndays: 0.1\nberg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39, -55]}\n"
        f"forcing: ['{address}']\n"
    )
    words = {"doctor": ["doctor", address],
             "run": ["run", str(tmp_path / "sea.yaml"), "-o", str(tmp_path / "out")]}[words[0]]  # fmt: skip
    program = Program(
        COMMAND.replace("app(", "from riftberg.system import process\nprocess.SILENT_AFTER = 0.5\napp("), *words,
        errors=tmp_path / "errors.txt",
    )  # fmt: skip
    try:
        said = program.printed.read() + (tmp_path / "errors.txt").read_text()
        assert program.wait(60) in (1, 2)  # not ready, or refused
    finally:
        program.kill()
    said = " ".join(said.split())
    assert "dodsC/sea.nc" in said
    assert "has not answered within" in said
    assert "s3cret" not in said
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not HANG.exists(), reason="needs the file of the shared data with which HDF5 never comes back")
def test_a_file_that_sends_hdf5_into_its_loop_is_given_up(tmp_path: Path) -> None:
    program = Program(
        LOOP.replace("netCDF4.Dataset = Endless\n", ""), "2", "plot", str(HANG), errors=tmp_path / "errors.txt"
    )
    try:
        assert "has not opened within" in program.printed.read() + (tmp_path / "errors.txt").read_text()
        assert program.wait(60) == 2
    finally:
        program.kill()
