"""Rules for the values of arrays, and the one function that holds arrays against them.

The state of a model, restarts, tables of run files and files of KID declare their rules and word the refusal themselves: each
names the place in its own terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.state.variables import ABOVE_0, LARGEST


class Rule(NamedTuple):
    """A demand on every value of one variable."""

    variable: str
    test: Callable[[NDArray[Any]], Any]  # True where a value is allowed
    allowed: str  # The allowed values in words: "a number from 0 to 1"

    @classmethod
    def between(cls, variable: str, least: float, most: float, *, whole: bool = False, missing: bool = False) -> Rule:
        """Return the rule that values lie between two numbers; ``whole``: and are whole; ``missing``: or are NaN."""

        def test(values: NDArray[Any]) -> Any:
            with np.errstate(invalid="ignore"):
                good = (values >= least) & (values <= most)
                good = good & (values == np.floor(values)) if whole and values.dtype.kind == "f" else good
            return good | np.isnan(values) if missing else good

        if whole:
            allowed = f"a whole number from {least:.0f} to {most:.0f}"
        elif least == ABOVE_0:
            allowed = f"a number above 0 and up to {most:g}"
        else:
            allowed = "a finite number" if least == -most == -LARGEST else f"a number from {least:g} to {most:g}"
        return cls(variable, test, allowed)


@dataclass(frozen=True)
class Breach:
    """The first value that breaks a rule."""

    rule: Rule
    index: tuple[int, ...]
    value: Any
    count: int  # Values that break it

    @property
    def row(self) -> int:
        """Row of the value in a table."""
        return self.index[0]


def is_positive(values: NDArray[Any]) -> Any:
    """Return which values are finite and above zero."""
    return np.isfinite(values) & (values > 0.0)


def find_breach(rules: Iterable[Rule], read: Callable[[str], Any]) -> Breach | None:
    """Return the first breach of rules; ``read`` gives the values of a variable by its name."""
    for rule in rules:
        values = np.atleast_1d(read(rule.variable))
        bad = ~np.atleast_1d(rule.test(values))
        if bad.any():
            index = tuple(int(k) for k in np.unravel_index(np.argmax(bad), bad.shape))
            return Breach(rule, index, values[index], int(bad.sum()))
    return None
