"""The same bits on every processor: a run, from its outline on, under what an old x86-64 processor allows.

NumPy, OpenBLAS and the C library choose their code by the processor; each can be told to do without what a new one has. Kernels
are compiled for the processor: `NUMBA_CPU_NAME` takes minutes, so that case is slow.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, build

pytestmark = pytest.mark.skipif(platform.machine() not in {"x86_64", "AMD64"}, reason="of x86-64 processors")

OLD = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA4,-AVX512F",
}
"""What makes NumPy, OpenBLAS and the GNU C library do without vectors of 32 bytes and fused products."""


def a68a() -> Model:
    """Return A68a on the shoal of the story: the tip and the rest part on the eighth day."""
    return build("a68a")[0]


def bergs() -> Model:
    """Return bergs that break in an eddy, drift into each other, melt and stand on a bank under a tide."""
    outline = [(-40.7, -60.0), (-39.6, -60.1), (-39.3, -59.8), (-40.1, -59.88), (-40.3, -59.5)]
    large = Iceberg.from_outline(outline, radius=2500.0, thickness=250.0)
    small = Iceberg.field(12, (-40.4, -40.0, -60.09, -60.06), seed=1)
    sea = Forcing.eddy((-39.7, -60.0), 15e3, 0.9) + Forcing.jet((-40.0, -60.0), 60.0, 0.4, 30e3)
    sea = sea + Forcing.tide(0.2, minor=0.1, level=0.8) + Forcing.uniform((0.1, 0.05), wind=(9.0, 3.0), depth=1000.0)
    sea = sea + Forcing.seamount((-39.85, -59.95), 790.0, 6e3, 1000.0)
    return Model(
        Iceberg.join([large, small]), sea,
        Parameters(fracture={"normal_strength": 6e3}, melt={"enabled": True, "temperature": 1.0, "salinity": 34.0}),
    )  # fmt: skip


def lone_bergs_aground() -> Model:
    """Return bergs of one element each that slide and spin on the sea floor."""
    field = Iceberg.field(12, (-40.4, -40.0, -60.09, -60.02), seed=1)
    field.elements.spin[:] = 1e-3
    return Model(field, Forcing.uniform((0.4, 0.1), wind=(9.0, 3.0), depth=150.0))


RUNS = {
    "a68a": (a68a, (0.0, 7.0, 0.5, 0.5)), "bergs": (bergs, (0.0, 1.0, 1.0)), "lone": (lone_bergs_aground, (0.0, 0.1, 0.2)),
}  # fmt: skip
"""Models, and after how many days each the state is taken."""


def trace(name: str) -> list[str]:
    """Return digests of all arrays of the state by record, and how many bonds have broken or elements stand aground at last."""
    build, steps = RUNS[name]
    model, lines = build(), []
    for days in steps:
        if days:
            model.advance(days=days)
        arrays = {**model.elements.arrays(), **model.bonds.arrays()}
        lines.append(" ".join(f"{k}={zlib.crc32(np.ascontiguousarray(a)):x}" for k, a in arrays.items()))
    return [*lines, str(int((model.bonds.status != 0).sum() + (model.elements.keel.floor_load > 0.0).sum()))]


def trace_anew(name: str, **environment: str) -> list[str]:
    """Return the same from a process of its own."""
    program = f"import test_processors as t; print(*t.trace({name!r}), sep='\\n')"
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True, text=True, check=True, timeout=1200,
    )  # fmt: skip
    return done.stdout.splitlines()


@pytest.mark.parametrize("name", RUNS)
def test_runs_are_the_same_bits_without_the_vectors_of_new_processors(name: str) -> None:
    here = trace(name)
    assert int(here[-1]) > 0, "nothing has broken, nor stands aground"
    assert trace_anew(name, **OLD) == here


@pytest.mark.slow
def test_kernels_for_any_x86_64_give_the_same_bits() -> None:
    assert trace_anew("a68a", NUMBA_CPU_NAME="x86-64", NUMBA_CPU_FEATURES="", **OLD) == trace("a68a")
