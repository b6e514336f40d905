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
    """Files keep the order below where processes share them; warnings without compilation."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        # NumPy's scalars warn of what compiled code passes on in silence: infinities and NaN.
        config.addinivalue_line("filterwarnings", "ignore::RuntimeWarning")


COMPILES = "test_every_parameter.py"
"""Compiles nearly every kernel, in minutes."""

FEW_KERNELS = ("products", "fetching", "bergs", "ocean", "viz")
"""Folders that need few kernels."""

DEAR = (
    "test_docs.py", "test_short.py", "test_side_by_side.py", "test_going_on.py", "test_tiles.py", "test_why.py",
)  # fmt: skip
"""Files that take more than twenty seconds."""


def _turn(item: pytest.Item) -> int:
    """Rank a test's file: two processes must not compile the same kernels, nor one wait for the other's last long file."""
    if item.path.name == COMPILES:
        return 0
    if item.path.parent.name in FEW_KERNELS:
        return 1
    return 2 if item.path.name in DEAR else 3


def _mark_slow_cases(items: list[pytest.Item]) -> None:
    """Mark as slow all cases of a test that are not among those in the quick set: ``quick(count)``, spread over the list."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("quick") and not item.get_closest_marker("slow"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for items_of_test in cases.values():
        marker = items_of_test[0].get_closest_marker("quick")
        assert marker is not None
        (count,) = marker.args
        last = len(items_of_test) - 1
        chosen = {round(k * last / max(count - 1, 1)) for k in range(count)}
        for number, item in enumerate(items_of_test):
            if number not in chosen:
                item.add_marker(pytest.mark.slow)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files in their order; mark slow cases; leave out what needs compilation where there is none."""
    _mark_slow_cases(items)
    items.sort(key=_turn)
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        for item in items:
            if item.get_closest_marker("compiled"):
                item.add_marker(pytest.mark.skip(reason="needs compilation: takes minutes, or measures time"))


def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """End the tests where a signal has ended a run: the program takes it up, and pytest would go on with the next test."""
    if (
        call.excinfo is not None
        and call.excinfo.errisinstance(SystemExit)
        and call.excinfo.value.code == 128 + signal.SIGTERM
    ):
        item.session.shouldstop = "a signal"


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
