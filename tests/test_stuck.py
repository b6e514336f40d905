"""Files that never open: pipes are refused, and a clock runs beside the libraries."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import netCDF4
import pytest
from typer.testing import CliRunner

from riftberg.cli import options as failures
from riftberg.cli.main import app
from riftberg.system import process as stuck
from riftberg.system.netcdf_lock import open_lazily, open_netcdf


@pytest.fixture
def limited() -> Iterator[None]:
    """End a test that waits for a pipe."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(20)
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


@pytest.fixture
def slow_library(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return a file that the library takes a second to open, where a twentieth is given."""
    path = tmp_path / "slow.nc"
    netCDF4.Dataset(path, "w").close()
    real = netCDF4.Dataset

    def slow(*arguments: Any, **options: Any) -> netCDF4.Dataset:
        time.sleep(1.0)
        return real(*arguments, **options)

    monkeypatch.setattr(netCDF4, "Dataset", slow)
    monkeypatch.setattr(stuck, "STUCK_AFTER", 0.05)
    return path


def test_a_program_is_warned_of_a_file_that_does_not_open(
    slow_library: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(stuck, "_action", [stuck._warn])
    with caplog.at_level(logging.WARNING), open_netcdf(slow_library):
        pass
    assert "slow.nc: has not opened within" in caplog.text
    assert "damaged" in caplog.text


def test_the_command_line_gives_up_on_it_in_one_sentence(slow_library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[int] = []
    said: list[str] = []
    monkeypatch.setattr(os, "_exit", ended.append)
    monkeypatch.setattr(failures, "say", said.append)
    monkeypatch.setattr(stuck, "_action", [failures._give_up])
    with open_netcdf(slow_library):
        pass
    assert ended == [2]
    assert said[0].startswith(f"Error: {slow_library}: has not opened within")


def test_a_command_called_by_a_program_leaves_its_warning_behind(tmp_path: Path) -> None:
    """A notebook that had called a command would have been ended by the next file that does not open."""
    before = list(stuck._action)
    CliRunner().invoke(app, ["doctor", str(tmp_path / "none.nc")])
    assert stuck._action == before


def test_a_file_that_opens_is_no_news(slow_library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(stuck, "_action", [told.append])
    with stuck.opening(slow_library):
        pass
    time.sleep(0.2)
    assert not told
