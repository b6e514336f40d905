"""A table of what theory asks and what the model gives, printed at the end of a verbose test run."""

from __future__ import annotations

from collections.abc import Callable

import pytest

_ROWS: list[tuple[str, float, float, str]] = []


@pytest.fixture
def agrees() -> Callable[..., None]:
    """Check ``got`` against ``asked`` and note both for the table."""

    def check(what: str, asked: float, got: float, *, rel: float | None = None, abs: float | None = None) -> None:
        allowed = f"{100 * rel:g} %" if rel is not None else f"{abs:g}"
        _ROWS.append((what, asked, got, allowed))
        assert got == pytest.approx(asked, rel=rel, abs=abs if abs is not None else 0.0), what

    return check


@pytest.fixture
def below() -> Callable[..., None]:
    """Check that ``got`` is below ``limit`` and note both for the table."""

    def check(what: str, limit: float, got: float) -> None:
        _ROWS.append((what, 0.0, got, f"< {limit:g}"))
        assert got < limit, what

    return check


def theory_table() -> str:
    """Return the table of this test run."""
    lines = [f"{'':58s} {'theory':>14s} {'model':>14s}  allowed"]
    lines += [f"{what:58s} {asked:14.8g} {got:14.8g}  {allowed}" for what, asked, got, allowed in _ROWS]
    return "\n".join(lines)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table if asked to be verbose."""
    if _ROWS and terminalreporter.config.getoption("verbose") > 0:
        terminalreporter.section("theory and model")
        terminalreporter.write_line(theory_table())
