"""Machine code that a wheel brings along, so that the first run compiles nothing.

    python benchmarks/machine_code.py FOLDER [RUN ...]

runs experiments with kernels compiled for a common kind of processor and leaves their machine code in a folder. A wheel that
is built with ``RIFTBERG_MACHINE_CODE=FOLDER`` holds it (``hatch_build.py``). It is data: where sources, Python, numba or the
processor differ it is left alone, and kernels are compiled as without it.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from riftberg.compiled.kernels import LEVELS, toolchain_digest

RUNS = {
    "a68a": ["a68a"],
    "a68a-melt": ["a68a-melt", "--days", "2"],
    "reference": ["a68a", "--numerics", "reference", "--days", "0.1"],
}
"""Runs whose kernels are wanted, with their arguments."""


def make(folder: Path, runs: list[str]) -> Path:
    """Make runs in processes of their own and leave their machine code in a folder; returns where it lies."""
    level, _ = LEVELS[platform.machine().lower()]
    with tempfile.TemporaryDirectory() as passing:
        environment = {
            **os.environ, "NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": "", "RIFTBERG_CACHE": passing,
        }  # fmt: skip
        for name in runs:
            words = ["run", *RUNS[name], "--quiet", "--output", str(Path(passing) / "out" / name)]
            subprocess.run([sys.executable, "-m", "riftberg", *words], check=True, env=environment)
        made = Path(passing) / "kernels" / toolchain_digest(f"{level} ")
        return Path(shutil.copytree(made, folder / made.name, dirs_exist_ok=True))


if __name__ == "__main__":
    made = make(Path(sys.argv[1]), sys.argv[2:] or list(RUNS))
    print(f"{len(list(made.iterdir()))} kernels in {made}")
