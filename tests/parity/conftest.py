"""Runs each case once, and prints the table of all that ran."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from .cases import CASES
from .comparison import Comparison, compare
from .table import lines

_DONE: dict[str, Comparison] = {}
_FAILED: dict[str, BaseException] = {}


@pytest.fixture(scope="session")
def comparison(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Comparison]:
    """Return a function that runs a case of the reference, once in a session, and compares it."""

    def run(name: str) -> Comparison:
        if name in _FAILED:
            raise _FAILED[name]
        if name not in _DONE:
            try:
                _DONE[name] = compare(CASES[name], shared / "reference" / name, tmp_path_factory.mktemp(name))
            except BaseException as error:
                _FAILED[name] = error
                raise
        return _DONE[name]

    return run


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the table."""
    if _DONE:
        terminalreporter.section("parity with the reference")
        for line in lines([_DONE[name] for name in CASES if name in _DONE]):
            terminalreporter.write_line(line)
