"""Machine code that is kept, and that a wheel brings along: found where it fits, ignored where it does not, never in the way."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from riftberg.compiled import kernels
from scripts import ROOT

LEVEL = kernels.LEVELS.get(platform.machine().lower(), ("", ()))[0]

PROGRAM = """\
import sys
from pathlib import Path
import numba, numpy as np

@numba.njit
def mine(x):
    return x.sum() * 3.0

before = mine(np.ones(4)), numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
code = mine.inspect_asm(mine.signatures[0])
import riftberg.compiled.kernels as kernels
kernels.SHIPPED = Path(sys.argv[1])

@kernels.kernel
def doubled(x):
    return 2.0 * x

@kernels.kernel
def all_doubled(values):
    total = 0.0
    for value in values:
        total += doubled(value)
    return total

print(all_doubled(np.ones(3)), all_doubled(np.ones(3, np.float32)), len(doubled.part.overloads))

@numba.njit
def again(x):
    return x.sum() * 3.0

assert before == (again(np.ones(4)), numba.core.registry.cpu_target.target_context.codegen().magic_tuple())
assert again.inspect_asm(again.signatures[0]).replace("again", "mine").count("\\n") == code.count("\\n")
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM, "utf-8")
    return path


def started(program: Path, shipped: Path, cache: Path, **environment: str) -> subprocess.Popen[str]:
    settings = {**os.environ, "RIFTBERG_CACHE": str(cache), **environment}
    words = [sys.executable, str(program), str(shipped)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=settings)


def said(*arguments: Path, **environment: str) -> str:
    """Return the two sums, and for how many types the inner kernel was compiled."""
    process = started(*arguments, **environment)
    out, err = process.communicate()
    assert process.returncode == 0, err
    return out.strip()


def made(program: Path, folder: Path) -> Path:
    """Return the folder of machine code for the common processor."""
    assert said(program, folder / "none", folder, NUMBA_CPU_NAME=LEVEL, NUMBA_CPU_FEATURES="") == "6.0 6.0 2"
    return folder / "kernels"


@pytest.mark.slow
@pytest.mark.compiled
def test_each_signature_has_its_own_file_whoever_writes_at_once(program: Path, tmp_path: Path) -> None:
    """Two processes that compile the same at once leave code that the next one takes."""
    cache, none = tmp_path / "cache", tmp_path / "none"
    both = [started(program, none, cache) for _ in range(2)]
    assert {process.communicate()[0].strip().rsplit(" ", 1)[0] for process in both} == {"6.0 6.0"}
    assert len(list(cache.rglob("*.code"))) == 2
    assert not [path for path in cache.rglob("*") if path.is_file() and path.suffix != ".code"]
    assert said(program, none, cache) == "6.0 6.0 0"
    program.write_text(PROGRAM.replace("2.0 * x", "4.0 * x"), "utf-8")
    assert said(program, none, cache) == "12.0 12.0 2"  # a changed source is never answered with old code


@pytest.mark.compiled
@pytest.mark.skipif(not LEVEL, reason="no machine code is made for this kind of processor")
def test_code_of_the_wheel_is_found_after_numba_was_used_and_changes_nobody_elses(
    program: Path, tmp_path: Path
) -> None:
    shipped = made(program, tmp_path / "shipped")
    assert said(program, shipped, tmp_path / "cache") == "6.0 6.0 0"
    assert not list((tmp_path / "cache").rglob("*.code"))


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.skipif(not LEVEL, reason="no machine code is made for this kind of processor")
def test_code_of_the_wheel_that_does_not_fit_is_left_alone(program: Path, tmp_path: Path) -> None:
    shipped = made(program, tmp_path / "shipped")
    (folder,) = shipped.iterdir()
    for path in folder.iterdir():  # cut off, as by a full disk
        path.write_bytes(path.read_bytes()[:-10])
    assert said(program, shipped, tmp_path / "one") == "6.0 6.0 2"
    folder.rename(shipped / "0123456789abcdef")  # made of other sources, or for another numba
    assert said(program, shipped, tmp_path / "two") == "6.0 6.0 2"


def test_a_processor_that_lacks_what_the_code_needs_does_without(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    machine = platform.machine().lower()
    monkeypatch.setattr(kernels, "SHIPPED", tmp_path)
    for needs, found in (((), True), (("instructions of the year 2100",), False)):
        monkeypatch.setitem(kernels.LEVELS, machine, ("x86-64-v3", needs))
        (tmp_path / kernels.toolchain_digest("x86-64-v3 ")).mkdir(exist_ok=True)
        kernels.shipped_folder.cache_clear()
        assert (kernels.shipped_folder() is not None) is found
    kernels.shipped_folder.cache_clear()


FILES = {
    "physics/numbers.py": "FACTOR = 2.0\n",
    "physics/law.py": (
        "from riftberg.compiled.kernels import kernel\nfrom riftberg.physics.numbers import FACTOR\n\n"
        "@kernel\ndef law(x):\n    return FACTOR * x + 0.0\n"
    ),
    "physics/middle.py": (
        "from riftberg.compiled.kernels import kernel\nfrom riftberg.physics import law as laws\n\n"
        "law = laws.law\n\n@kernel\ndef middle(x):\n    return law(x)\n"
    ),
    "state/pair.py": "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    first: float\n    second: float\n",
    "engines/outer.py": (
        "from riftberg.compiled.kernels import kernel\nfrom riftberg.physics.middle import middle\n\n"
        "@kernel\ndef outer(pair):\n    return middle(pair.first)\n"
    ),
    "engines/other.py": "from riftberg.compiled.kernels import kernel\n\n@kernel\ndef other(x):\n    return x + 1.0\n",
}
"""A kernel that calls another, that calls a law with a constant from elsewhere; and one beside them."""

CALLS = """\
import os, sys
import numba, numpy
CALL = \"\"\"
from riftberg.state.pair import Pair
from riftberg.engines.outer import outer
from riftberg.engines.other import other
result = outer(Pair(5.0, 7.0))
print(result, bool(outer.stats.cache_hits), other(1.0), bool(other.stats.cache_hits), flush=True)
\"\"\"
for _ in sys.stdin:
    assert not any(name.startswith("riftberg") for name in sys.modules)
    child = os.fork()
    if not child:
        exec(CALL)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""
"""Calls the kernels once for each line that it reads, each time in a process that has loaded numba and nothing of ours."""


@pytest.mark.compiled
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_changed_source_is_compiled_anew_with_its_callers_and_nothing_else(tmp_path: Path) -> None:
    """Numba freezes constants, laws and the order of fields into code: stale code would give old results in silence."""
    package = tmp_path / "riftberg"
    shutil.copytree(ROOT / "src" / "riftberg", package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in FILES.items():
        (package / name).write_text(text, "utf-8")
    # Bytecode goes by the second in which a file was changed, and by its size: too coarse for what follows.
    settings = {
        **os.environ, "PYTHONPATH": str(tmp_path), "RIFTBERG_CACHE": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip
    program = subprocess.Popen(
        [sys.executable, "-c", CALLS], env=settings, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )

    def called() -> str:
        assert program.stdin is not None
        assert program.stdout is not None
        print("call", file=program.stdin, flush=True)
        return program.stdout.readline().strip()

    assert called() == "10.0 False 2.0 False"
    assert called() == "10.0 True 2.0 True"
    for name, old, new, result in [
        ("physics/numbers.py", "2.0", "3.0", 15.0),
        ("physics/law.py", "* x", "* x * x", 75.0),
        ("state/pair.py", "first: float\n    second", "second: float\n    first", 147.0),
        ("physics/middle.py", "law(x)", "-law(x)", -147.0),
    ]:
        text = (package / name).read_text("utf-8")
        assert old in text
        (package / name).write_text(text.replace(old, new), "utf-8")
        assert called() == f"{result} False 2.0 True", name
    assert called() == "-147.0 True 2.0 True"
    parts = package / "compiled" / "parts.py"  # how kernels are compiled is part of all of them
    parts.write_text(parts.read_text("utf-8") + "\n", "utf-8")
    assert called() == "-147.0 False 2.0 False"
    program.communicate()
    assert program.returncode == 0


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.skipif(not LEVEL, reason="no machine code is made for this kind of processor")
def test_a_wheel_with_machine_code_draws_its_first_map_without_compiling(tmp_path: Path) -> None:
    """And its run has the digits of one that was compiled for this very processor."""
    xr = pytest.importorskip("xarray")
    pytest.importorskip("build")
    root, code, site = Path(__file__).resolve().parents[1], tmp_path / "code", tmp_path / "site"

    def run(*words: str | Path, **environment: str) -> None:
        done = subprocess.run(
            [str(word) for word in words], env={**os.environ, **environment}, cwd=tmp_path, check=False
        )
        assert done.returncode == 0, words

    run(sys.executable, root / "benchmarks" / "machine_code.py", code, "a68a", PYTHONPATH=str(root / "src"))
    run(
        sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", tmp_path / "dist", root,
        RIFTBERG_MACHINE_CODE=str(code),
    )  # fmt: skip
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", site, wheel)
    before = time.perf_counter()
    run(
        sys.executable, "-m", "riftberg", "run", "a68a", "-o", tmp_path / "out",
        PYTHONPATH=str(site), RIFTBERG_CACHE=str(tmp_path / "cache"),
    )  # fmt: skip
    assert time.perf_counter() - before < 15.0
    assert (tmp_path / "out" / "map.png").exists()
    assert not list((tmp_path / "cache").rglob("*.code"))
    run(
        sys.executable,
        "-m",
        "riftberg",
        "run",
        "a68a",
        "-o",
        tmp_path / "native",
        "--no-map",
        PYTHONPATH=str(root / "src"),
    )
    with xr.open_dataset(tmp_path / "out" / "run.nc") as one, xr.open_dataset(tmp_path / "native" / "run.nc") as other:
        for name in one.variables:
            np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=str(name))


GROUNDED = """
import sys
import numpy as np
from riftberg import Parameters
from riftberg.engines.common.forces.media import on_the_floor

constants = Parameters().kernel_values()
for shape in eval(sys.argv[1]):
    print(int(on_the_floor(np.full(shape, 300.0), np.full(shape, 200.0), 1.0, constants).sum()), end=" ")
"""


@pytest.mark.slow
@pytest.mark.compiled
def test_code_for_other_types_that_another_process_kept_is_not_taken_for_ones_own(tmp_path: Path) -> None:
    """Bug: numba gave both the same name, for each was the first that its process compiled, and they shared their constants.

    A process that had loaded one kept the other with constants beyond those that it had by itself: the next one failed.
    """
    environment = {**os.environ, "RIFTBERG_CACHE": str(tmp_path)}
    for shapes, said in (("[(3,)]", "3"), *2 * (("[(3,), (2, 2)]", "3 4"),)):
        done = subprocess.run([sys.executable, "-c", GROUNDED, shapes], env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stdout.strip()) == (0, said), done.stderr
