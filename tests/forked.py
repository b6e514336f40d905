"""Programs in processes that are forked from one that has loaded what they import (`loaded`), which takes two seconds."""

from __future__ import annotations

import multiprocessing
import os
import sys
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

CAN_FORK = "forkserver" in multiprocessing.get_all_start_methods()


def processes() -> Any:
    """Return the context whose processes are forked; elsewhere each loads for itself."""
    context: Any = multiprocessing.get_context("forkserver" if CAN_FORK else "spawn")
    if CAN_FORK:
        context.set_forkserver_preload(["loaded"])
    return context


def begin(process: Any) -> None:
    """Begin a process; the one that is forked finds `loaded` by the path, which until Python 3.13 it is not handed on."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    with patch.dict(os.environ, PYTHONPATH=path):
        process.start()


COMMAND = """
import sys
from riftberg.cli.main import app
app(sys.argv[1:], prog_name="riftberg")
"""
"""The command line as a program."""


class Program:
    """A program in a process of its own: what it prints can be read, and signals be sent to it."""

    def __init__(self, text: str, *arguments: str, errors: Path | str = os.devnull) -> None:
        here, there = processes().Pipe(duplex=False)
        self._process = processes().Process(target=_run, args=(textwrap.dedent(text), arguments, there, str(errors)))
        begin(self._process)
        there.close()
        self.printed = os.fdopen(os.dup(here.fileno()), encoding="utf-8")
        here.close()

    def send_signal(self, number: int) -> None:
        """Send it a signal."""
        os.kill(self._process.pid, number)

    def wait(self, seconds: float | None = None) -> int | None:
        """Wait for its end; return the exit code, None where it has not ended by then."""
        self._process.join(seconds)
        code: int | None = self._process.exitcode
        if code is not None:
            self.printed.close()
        return code

    def kill(self) -> None:
        """End it, if it has not ended."""
        self._process.kill()
        self._process.join()
        self.printed.close()


def _run(text: str, arguments: tuple[str, ...], printed: Any, errors: str) -> None:
    with open(errors, "ab") as file:
        os.dup2(file.fileno(), 2)
    os.dup2(printed.fileno(), 1)
    sys.argv = ["-c", *arguments]
    sys.modules["__main__"] = main = ModuleType("__main__")
    exec(compile(text, "<program>", "exec"), main.__dict__)
