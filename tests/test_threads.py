"""Results do not depend on the number of threads: several runs side by side, and numba's own setting."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.ocean.analytic import Steady
from riftberg.parameters import A68A_2022
from riftberg.runs.model import Model
from riftberg.stepping.explicit import mts as multiple
from riftberg.stepping.explicit.beams import partition
from riftberg.stepping.explicit.tiles import allocate_tiles, pack_bonds
from riftberg.stepping.forces.sizes import interaction_sizes

PROGRAM = """
import hashlib
from test_threads import moved
elements, bonds = moved(0)
print(hashlib.sha256(b"".join(a.tobytes() for part in (elements, bonds) for a in part.arrays().values())).hexdigest())
"""


def moved(seed: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return elements and bonds of a small berg that has drifted and broken for some steps."""
    berg = Iceberg.rectangle(30e3, 12e3, thickness=200.0, placement=(-37.0, -56.0))
    wear = {"enabled": seed % 2 == 0, "threshold": 0.1, "time_scale": 3600.0}
    weak = A68A_2022.changed(fracture={"normal_strength": 3e2 + 1e2 * seed}, damage=wear, stepping={"scheme": "mts"})
    model = Model(berg, Steady(current=(0.3, 0.1), wind=(10.0, -4.0), depth=165.0), weak)
    model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.u.size)
    for _ in range(6):
        model.step()
    return model.elements, model.bonds


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


def shattering(threads: int) -> Model:
    """Return a berg that has gone to pieces on the sea floor, its sub-steps taken by some threads."""
    berg = Iceberg.rectangle(66e3, 30e3, thickness=200.0, placement=(-37.0, -56.0))
    weak = A68A_2022.changed(
        fracture={"normal_strength": 4e3}, damage={"enabled": True, "threshold": 0.1, "time_scale": 3600.0},
        stepping={"scheme": "mts", "threads": threads},
    )  # fmt: skip
    model = Model(berg, Steady(current=(0.3, 0.1), wind=(10.0, -4.0), depth=168.0), weak)
    model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.u.size)
    model.elements.thickness[::31] = 205.0
    for _ in range(4):
        model.step()
    return model


@pytest.mark.parametrize("threads", [3, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 12))])
def test_threads_within_a_lattice_change_nothing(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Breaking, wear, contact of broken ends and the sea floor: the same to the last bit, with more threads than blocks too."""
    alone = shattering(1)
    monkeypatch.setattr(multiple, "WORTH_THREADS", 1)
    together = shattering(threads)
    assert 10 < alone.bonds_broken < 0.9 * alone.bonds.status.size
    assert (alone.bonds.damage > 0.0).any()
    for mine, theirs in ((alone.elements, together.elements), (alone.bonds, together.bonds)):
        for name, a in mine.arrays().items():
            np.testing.assert_array_equal(a, getattr(theirs, name), err_msg=name)
    np.testing.assert_array_equal(alone.applied_forces(), together.applied_forces())


def test_each_block_of_bonds_is_the_work_of_one_thread() -> None:
    model = shattering(1)
    el, bonds, p = model.elements, model.bonds, model.parameters.kernel_values()
    rows = allocate_tiles(el, bonds, p)
    count = pack_bonds(rows, el, bonds, interaction_sizes(el, p), np.arange(el.size), p)
    for threads in (1, 2, 5, 40):
        parts = partition(rows, count, el.size, threads)
        assert sorted(np.concatenate([part.in_use for part in parts])) == sorted(rows.in_use[:count])
        assert [part.begin for part in parts[1:]] == [part.end for part in parts[:-1]]
