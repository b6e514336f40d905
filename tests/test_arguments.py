"""Kernels take arrays and numbers out of the tuples of Python by themselves: what they read is what Python sees."""

from __future__ import annotations

import gc
import weakref
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.errors import NumbaError, NumbaValueError

from riftberg.compiled.kernels import borrower, kernel
from riftberg.state import Floats, Ints


class Inner(NamedTuple):
    """A tuple in a tuple, with numbers."""

    factor: float
    count: int
    on: bool
    row: Ints


class Outer(NamedTuple):
    """Arrays of one and two dimensions."""

    table: Floats
    inner: Inner
    pair: tuple[Floats, float]


@borrower
def _summed(outer: Outer, loose: Floats, scale: float, out: Floats) -> float:
    """Add up all that there is, with weights that tell places apart."""
    total, inner = 0.0, outer.inner
    for i in range(outer.table.shape[0]):
        for j in range(outer.table.shape[1]):
            total += outer.table[i, j] * (1 + i + 10 * j)
    for k in range(inner.row.size):
        total += inner.row[k] * (k + 1)
    for k in range(loose.size):
        total += loose[k] * (k + 3)
    total += outer.pair[0][0] * outer.pair[1]
    out[0] = total
    return scale * (total * inner.factor + inner.count) if inner.on else -total


@kernel
def _first_row(outer: Outer) -> Floats:
    """Return a view of an argument."""
    return outer.table[0]


def _outer(table: Floats, factor: object = 2.0, count: object = 3, on: object = True, row: object = (4, 5)) -> Outer:
    inner = Inner(factor, count, on, np.array(row, np.int64))  # type: ignore[arg-type]
    return Outer(table, inner, (np.array([7.0]), 0.5))


def _agrees(outer: Outer, loose: Floats, scale: float = 1.5) -> bool:
    compiled, plain = np.zeros(1), np.zeros(1)
    results = _summed(outer, loose, scale, compiled), _summed.py_func(outer, loose, scale, plain)
    return bool(results[0] == results[1] and compiled[0] == plain[0])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 4), st.integers(0, 4), st.booleans(), st.sampled_from("CFTSR"), st.integers(-5, 2**40))
def test_what_is_read_is_what_stands_there(rows: int, columns: int, on: bool, layout: str, count: int) -> None:
    """Of any shape and layout: rows or columns first, turned round, with steps between, or not to be written to."""
    whole = np.arange(4.0 * rows * columns).reshape(2 * rows, 2 * columns)
    table = {
        "C": whole[:rows].copy(), "F": np.asfortranarray(whole), "T": whole.T, "S": whole[::2, ::2], "R": whole.copy(),
    }[layout]  # fmt: skip
    table.flags.writeable = layout != "R"
    assert _agrees(_outer(table, count=count, on=on), np.arange(6.0)[::2] if on else np.arange(3.0))


@pytest.mark.quick(3)
@pytest.mark.parametrize("factor", [2.5, np.float64(2.5), 2, np.int64(2)])
@pytest.mark.parametrize("on", [True, False, np.True_])
def test_numbers_may_be_of_python_or_numpy(factor: object, on: object) -> None:
    """In turns: code for one kind must not read the other."""
    for _ in range(2):
        assert _agrees(_outer(np.ones((2, 2)), factor, np.int64(3), on), np.ones(2))
        assert _agrees(_outer(np.ones((2, 2))), np.ones(2))


def test_other_types_of_arrays_get_code_of_their_own() -> None:
    """One after the other with the same kernel: numbers of single precision read as double would be others."""
    for kind in (np.float64, np.float32, np.int64, np.int32, np.float64):
        assert _agrees(_outer(np.arange(6).reshape(2, 3).astype(kind)), np.ones(2))
    with pytest.raises(NumbaValueError, match=">f8"):  # numbers of another machine, which numba does not take
        _agrees(_outer(np.arange(6.0).reshape(2, 3).astype(">f8")), np.ones(2))


def test_an_array_that_a_kernel_returns_lives_as_long_as_it_is_held() -> None:
    """Nothing would keep its memory: a view of an argument is copied before the argument can go."""
    assert type(_first_row).__name__ == "TupleKernel"
    table = np.arange(6.0).reshape(2, 3)
    row = _first_row(_outer(table))
    assert not np.shares_memory(row, table)
    table[:] = -1.0
    assert row.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.compiled
def test_a_kernel_keeps_nothing_of_what_it_was_called_with() -> None:
    """Bug: the arrays of the first call were held as long as the code was, 110 MiB of a run of 50,000 bergs."""
    table = np.arange(6.0, dtype=np.float32).reshape(3, 2)  # of a type that calls for code of its own
    held = weakref.ref(table)
    _first_row(_outer(table))
    del table
    gc.collect()
    assert held() is None


@kernel
def _total(of: tuple[Floats, ...]) -> float:
    """Add up the first numbers of some arrays."""
    total = 0.0
    for k in range(len(of)):
        total += of[k][0]
    return total


def test_nothing_is_read_beyond_the_end_of_a_tuple_or_of_what_is_no_array() -> None:
    """Bug: a longer tuple before a shorter one of the same class read behind its end, and the process died."""
    for count in (5, 1, 3, 40, 2):
        assert _total(tuple(np.array([float(k)]) for k in range(count))) == sum(range(count))
    assert _agrees(_outer(np.ones((2, 2))), np.ones(2))
    for wrong in (None, 3.0, (), np.float64(1.0), np.array(1.0)):
        with pytest.raises(NumbaError):
            _summed(_outer(np.ones((2, 2)))._replace(table=wrong), np.ones(2), 1.0, np.zeros(1))
    for pair in (None, (), (np.ones(1),)):
        with pytest.raises(NumbaError):
            _summed(_outer(np.ones((2, 2)))._replace(pair=pair), np.ones(2), 1.0, np.zeros(1))


def test_code_for_other_types_has_a_name_of_its_own() -> None:
    for array in (np.ones((2, 2)), np.ones((2, 2), np.float32)):
        _first_row(_outer(array))
    names = [call.__globals__["by_address"].py_func.__name__ for call in _first_row._variants.values()]
    assert len(set(names)) == len(names) > 1
