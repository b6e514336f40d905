"""The families of faults: what files, people and the machine really do, ten kinds each."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from fuzz import forcing_kinds, kid_kinds, machine_kinds, user_kinds
from fuzz.judging import Kind

FAMILIES: tuple[Callable[[], Iterator[Kind]], ...] = (
    *forcing_kinds.FAMILIES, *kid_kinds.FAMILIES, *user_kinds.FAMILIES, *machine_kinds.FAMILIES,
)  # fmt: skip
"""All families; each is another fault."""


def faults() -> Iterator[Kind]:
    """Give the kinds of all families."""
    for family in FAMILIES:
        yield from family()
