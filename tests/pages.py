"""Code blocks of pages, each page in a process forked from one that has loaded what pages import, which takes two seconds."""

from __future__ import annotations

import multiprocessing
import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

from forked import CAN_FORK, begin, processes
from riftberg.cli.main import app


def run_blocks(blocks: list[tuple[str, str]], folder: Path) -> None:
    """Run blocks of Python and bash in order, all Python in one namespace, in ``folder``."""
    if blocks:
        said = folder / ".said"
        page = processes().Process(target=_page, args=(blocks, str(folder), str(said)))
        begin(page)
        page.join()
        assert page.exitcode == 0, said.read_text()[-6000:]


def _page(blocks: list[tuple[str, str]], folder: str, said: str) -> None:
    """Run a page: its Python in one process and each command in another, forked before anything has used threads."""
    os.chdir(folder)
    with open(said, "ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    fork = multiprocessing.get_context("fork" if CAN_FORK else "spawn")
    here, there = fork.Pipe()
    python = fork.Process(target=_python, args=(there, here))
    python.start()
    there.close()
    try:
        for kind, content in blocks:
            if kind == "python":
                here.send(content)
                here.recv()  # an EOFError where the code has ended its process
            else:
                _commands(content, fork)
    finally:
        here.close()
        python.join()
    assert python.exitcode == 0


def _commands(content: str, fork: Any) -> None:
    """Run a block of bash; lines that call Riftberg in a fork of this process."""
    for part in re.split(r"^(?=riftberg )", content.replace("\\\n", " "), flags=re.MULTILINE):
        if part.startswith("riftberg ") and part.strip().count("\n") == 0:
            words = shlex.split(part, comments=True)[1:]
            command = fork.Process(target=_command, args=(words,))
            command.start()
            command.join()
            assert command.exitcode == 0, part
        elif part:
            shell = f'set -e\nriftberg() {{ {shlex.quote(sys.executable)} -m riftberg "$@"; }}\n{part}'
            subprocess.run(["bash", "-c", shell], check=True)


def _command(words: list[str]) -> None:
    if words[0] in ("forecast", "sweep") and "--workers" not in words:
        words = [*words, "--workers", "1"]  # each process of theirs takes two seconds to begin
    app(words, prog_name="riftberg")


def _python(blocks: Any, other_end: Any) -> None:
    """Run the Python blocks that come, in one namespace."""
    other_end.close()
    warnings.filterwarnings("error", category=DeprecationWarning, module="__main__")
    sys.modules["__main__"] = main = ModuleType("__main__")
    while True:
        try:
            content = blocks.recv()
        except EOFError:
            return
        exec(compile(content, "<page>", "exec"), main.__dict__)
        blocks.send(None)
