"""Fixtures shared by all tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what runs in the background so that Ctrl-C passes it by, and its children; tests send Ctrl-C to children.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def shared_folder() -> Path | None:
    """Return the folder of shared reference data, or None where there is none."""
    named = os.environ.get("RIFTBERG_SHARED")
    folder = Path(named) if named else ROOT.parent / "shared"
    return folder if (folder / "reference").is_dir() else None


def pytest_configure(config: pytest.Config) -> None:
    """Without compilation NumPy's scalars warn of what compiled code passes on in silence: infinities and NaN."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        config.addinivalue_line("filterwarnings", "ignore::RuntimeWarning")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what needs compilation where there is none."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        for item in items:
            if item.get_closest_marker("compiled"):
                item.add_marker(pytest.mark.skip(reason="needs compilation: takes minutes, or measures time"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of shared reference data; skips where it is absent, fails if the run demands it."""
    folder = shared_folder()
    if folder is None:
        message = "no shared reference data: put it at ../shared or name it in RIFTBERG_SHARED"
        if os.environ.get("RIFTBERG_REQUIRE_SHARED") == "1":
            pytest.fail(message)
        pytest.skip(message)
    return folder
