"""The inner loop takes no memory: a long step with more sub-steps allocates as often as one with fewer."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core.errors import NumbaError
from numba.core.runtime import _nrt_python, rtsys

from riftberg import A68A_2022_MTS, Forcing, Iceberg, Model
from riftberg.compiled.kernels import borrower, kernel

pytestmark = pytest.mark.compiled


def _allocations(substeps: int, grounded: bool) -> int:
    """Return how often compiled code takes memory in the third long step of a berg."""
    berg = Iceberg.rectangle("24 km", "12 km", thickness="200 m", placement=(-38.0, -56.0), velocity=(0.1, 0.0))
    sea = Forcing.uniform((0.2, 0.0), depth=150.0 if grounded else 3000.0)
    model = Model(berg, sea, A68A_2022_MTS.changed(stepping={"substeps": substeps}))
    model.advance(steps=2)
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        model.advance(steps=1)
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    return int(after.alloc - before.alloc)


@pytest.mark.parametrize("grounded", [False, True])
def test_sub_steps_take_no_memory(grounded: bool) -> None:
    few, many = _allocations(90, grounded), _allocations(180, grounded)
    assert few == many > 0


@borrower
def _lends(a):
    """Not to be compiled: it makes an array."""
    return (a + 1.0)[0]


@kernel
def _asks(a):
    return _lends(a) + a.copy()[0]


def test_a_borrower_borrows_from_a_kernel_too() -> None:
    """Called from a kernel that counts references, it counted them too: four fifths of the time of bergs in contact."""
    with pytest.raises(NumbaError, match="NRT required"):
        _asks(np.zeros(2))
