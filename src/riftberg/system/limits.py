"""How large a run may be unless it is allowed to be larger: elements, steps, sub-steps, bytes of input.

A slip of units (a radius of 1.5 instead of 1500 m) asks for terabytes or for months of computing. Such a wish is
refused before any work begins, unless it is allowed: on the command line by ``--allow-large``, in Python by

>>> from riftberg.system.limits import allow_large
>>> with allow_large():
...     pass
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

from riftberg.errors import InputError

MOST_ELEMENTS: Final = 1_000_000
"""Elements of a berg."""

MOST_STEPS: Final = 10_000_000
"""Long steps of a run."""

MOST_SUBSTEPS: Final = 1_000_000
"""Sub-steps in a long step."""

MOST_WORK: Final = 1e13
"""Elements times sub-steps of a whole run: some ten days of computing."""

MOST_TEXT: Final = 64 * 2**20
"""Bytes of a table, drawing or other text."""

MOST_YAML: Final = 500_000
"""Bytes of an experiment file or a namelist."""

MOST_VALUES: Final = 1_000_000_000
"""Numbers that are read from a grid or a run file at once (8 GB)."""

BYTES_PER_ELEMENT: Final = 2500
"""Memory of an element with its bonds, about."""

MEANT: Final = "or allow it by --allow-extreme (in Python: riftberg.system.limits.allow_extreme())"

ANYWAY: Final = "or allow it by --allow-large (in Python: riftberg.system.limits.allow_large())"

_ALLOWED: ContextVar[bool] = ContextVar("riftberg_large_allowed", default=False)


_EXTREME: ContextVar[bool] = ContextVar("riftberg_extreme_allowed", default=False)


@contextmanager
def allow_extreme(allowed: bool = True) -> Iterator[None]:
    """Allow KID runs in currents, wind and sea level that no sea has, and ice of any speed below 1000 m/s."""
    token = _EXTREME.set(allowed or _EXTREME.get())
    try:
        yield
    finally:
        _EXTREME.reset(token)


def extreme_allowed() -> bool:
    """Whether currents, wind and sea level beyond belief are allowed here."""
    return _EXTREME.get()


@contextmanager
def allow_large(allowed: bool = True) -> Iterator[None]:
    """Allow runs and files beyond the limits within a ``with`` block."""
    token = _ALLOWED.set(allowed or _ALLOWED.get())
    try:
        yield
    finally:
        _ALLOWED.reset(token)


def large_allowed() -> bool:
    """Whether runs and files beyond the limits are allowed here; for work that goes to another process."""
    return _ALLOWED.get()


def refuse_large(
    count: float, most: float, what: str, *, size: float = 0.0, where: str = "", remedy: str, kind: type[InputError]
) -> None:
    """Raise an error where more is asked for than the most."""
    if count <= most or (_ALLOWED.get() and count < 1e18):
        return
    about = f", about {human(count * size)}" if size else ""
    raise kind(
        f"this asks for {number_text(count)} {what}{about}; the most is {number_text(most)}",
        where=where,
        remedy=f"{remedy}, {ANYWAY}",
    )


def number_text(count: float) -> str:
    """Return a count in words that can be read: plain up to ten digits."""
    return f"{count:.0f}" if abs(count) < 1e10 else f"{count:.3g}"


def human(size: float) -> str:
    """Return bytes as MB or GB."""
    return f"{size / 1e6:.3g} MB" if size < 1e9 else f"{size / 1e9:.3g} GB"


def check_elements(count: float, *, where: str = "", kind: type[InputError] = InputError) -> None:
    """Refuse more elements than are allowed, before any is made."""
    refuse_large(
        count,
        MOST_ELEMENTS,
        "elements",
        size=BYTES_PER_ELEMENT,
        where=where,
        remedy="Give a larger radius or a smaller berg",
        kind=kind,
    )


def check_work(steps: float, substeps: int, elements: int, *, where: str) -> None:
    """Refuse a run of more steps, sub-steps or work than is allowed, before its first step."""
    refuse_large(
        steps,
        MOST_STEPS,
        "long steps",
        where=where,
        remedy="Run shorter, or give a longer stepping.time_step",
        kind=InputError,
    )
    refuse_large(
        substeps, MOST_SUBSTEPS, "sub-steps in a long step", where=where, kind=InputError,
        remedy="Look at thickness, radius and stiffness (bonds.youngs_modulus), give a shorter stepping.time_step",
    )  # fmt: skip
    refuse_large(
        steps * substeps * elements, MOST_WORK,
        f"updates of elements ({number_text(steps)} steps of {substeps} sub-steps for {elements} elements, "
        f"about {number_text(steps * substeps * elements / 1e7 / 86400.0)} days of computing)",
        where=where, remedy="Run shorter, or with fewer and larger elements", kind=InputError,
    )  # fmt: skip
