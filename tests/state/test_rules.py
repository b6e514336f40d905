"""Rules for arrays: the first value that breaks one is found, with its index, and the limits read well."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg.state.rules import Rule, find_breach, is_positive
from riftberg.state.variables import ABOVE_0, LARGEST


@pytest.mark.parametrize(
    ("rule", "values", "index"),
    [
        (Rule.between("a", 0.0, 1.0), [0.0, 1.0, 1.1], (2,)),
        (Rule.between("a", 0.0, 1.0), [0.5, np.nan, 2.0], (1,)),
        (Rule.between("a", 0.0, 1.0, missing=True), [np.nan, 1.0], None),
        (Rule.between("a", 0.0, 1.0, missing=True), [np.nan, np.inf], (1,)),
        (Rule.between("a", 0, 3, whole=True), [[1.0, 1.5], [2.0, 4.0]], (0, 1)),
        (Rule.between("a", 0, 3, whole=True), [1, 2, 4], (2,)),
        (Rule.between("a", ABOVE_0, 3.0), [1e-300, 0.0], (1,)),
        (Rule("a", is_positive, "positive"), [1.0, np.inf, 0.0], (1,)),
        (Rule.between("a", 0.0, 1.0), [], None),
    ],
)
def test_the_first_value_that_breaks_a_rule_is_found(rule: Rule, values: Any, index: tuple[int, ...] | None) -> None:
    breach = find_breach([rule], lambda name: np.array(values))
    assert (None if breach is None else breach.index) == index
    if breach is not None:
        assert breach.value == np.array(values)[breach.index] or np.isnan(breach.value)


def test_rules_hold_in_their_order_and_all_breaches_are_counted() -> None:
    table = {"a": np.array([1.0, 2.0]), "b": np.array([-1.0, 5.0, -2.0])}
    breach = find_breach(
        [Rule.between("a", 0.0, 9.0), Rule.between("b", 0.0, 9.0), Rule.between("a", 0.0, 0.0)], table.get
    )
    assert breach is not None
    assert (breach.rule.variable, breach.row, breach.value, breach.count) == ("b", 0, -1.0, 2)
    single = find_breach([Rule.between("time", 0.0, 1.0)], lambda name: np.array(3.0))
    assert single is not None
    assert (single.row, single.value) == (0, 3.0)


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (Rule.between("a", -LARGEST, LARGEST), "a finite number"),
        (Rule.between("a", ABOVE_0, 5.0), "a number above 0 and up to 5"),
        (Rule.between("a", -1.0, 5.0), "a number from -1 to 5"),
        (Rule.between("a", 0, 255, whole=True), "a whole number from 0 to 255"),
    ],
)
def test_the_limits_read_well(rule: Rule, words: str) -> None:
    assert rule.allowed == words
