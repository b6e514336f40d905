"""Results do not depend on the number of threads: several runs side by side, and numba's own setting."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from riftberg import A68A_2022_MTS, Forcing, Iceberg, Model

PROGRAM = """
import hashlib
from test_threads import moved
elements, bonds = moved(0)
print(hashlib.sha256(b"".join(a.tobytes() for part in (elements, bonds) for a in part.arrays().values())).hexdigest())
"""


def moved(seed: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return elements and bonds of a small berg that has drifted and broken for some steps."""
    berg = Iceberg.rectangle(30e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
    weak = A68A_2022_MTS.changed(fracture={"normal_strength": 3e2 + 1e2 * seed})
    model = Model(berg, Forcing.uniform(current=(0.3, 0.1), wind=(10.0, -4.0), depth=165.0, slope=(0.0, 0.0)), weak)
    model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.u.size)
    for _ in range(6):
        model.step()
    return model.elements, model.bonds


@pytest.mark.quick(1)
@pytest.mark.parametrize("threads", [2, 4])
def test_runs_side_by_side_equal_runs_in_turn(threads: int) -> None:
    """Kernels release the interpreter lock and share nothing, so replicas may run in threads."""
    alone = [moved(seed) for seed in range(4)]
    assert any(np.isfinite(bonds.break_time).any() for _, bonds in alone)
    with ThreadPoolExecutor(threads) as pool:
        together = list(pool.map(moved, range(4)))
    for (elements, bonds), (other_elements, other_bonds) in zip(alone, together, strict=True):
        for mine, theirs in ((elements, other_elements), (bonds, other_bonds)):
            for name, a in mine.arrays().items():
                np.testing.assert_array_equal(a, getattr(theirs, name), err_msg=name)


@pytest.mark.slow
def test_numba_thread_setting_changes_nothing() -> None:
    """One process per setting; every array of the state enters the digest."""
    digests = set()
    for threads in ("1", "2"):
        path = os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "PYTHONPATH": path}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True, timeout=300
        )
        digests.add(done.stdout.strip())
    assert len(digests) == 1


BREAKING = """
import hashlib
from riftberg import Forcing, Iceberg, Model, Parameters
berg = Iceberg.rectangle("90 km", "40 km", thickness="200 m", radius="1.5 km", placement=(-37.0, -56.0))
sea = Forcing.uniform(current=(0.3, 0.1), wind=(15.0, -5.0)) + Forcing.eddy((-37.2, -56.3), radius=30e3, speed=0.8)
model = Model(berg, sea, Parameters().changed(fracture={"normal_strength": 1.5e3}))
model.advance(steps=30)
print(model.bonds_broken, len(model.fragments.rows))
state = (a for part in (model.elements, model.bonds) for a in part.arrays().values())
print(hashlib.sha256(b"".join(a.tobytes() for a in state)).hexdigest())
"""


@pytest.mark.slow
def test_threads_of_a_library_change_nothing_where_a_berg_breaks() -> None:
    """Bug: sums of linear algebra differed with its threads, and members of a forecast shattered otherwise with workers."""
    printed = set()
    for threads in ("1", "2"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        done = subprocess.run(
            [sys.executable, "-c", BREAKING], env=environment, capture_output=True, text=True, check=True, timeout=300
        )
        printed.add(done.stdout)
    assert len(printed) == 1
    assert int(printed.pop().split()[0]) > 10
