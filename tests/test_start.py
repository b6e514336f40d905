"""What a user waits for before the first step: imports, help, machine code from the cache, and code that is compiled."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from kid.conftest import write_case
from riftberg.cli.main import app
from riftberg.state.neighbours import find_pairs

KERNELS = """\
import gc
import sys
import numpy as np
from riftberg.compiled.kernels import borrower, kernel

@kernel
def doubled(x):
    return 2.0 * x

@kernel
def all_doubled(values):
    total = 0.0
    for value in values:
        total += doubled(value)
    return total

searches = []
gc.callbacks.append(lambda phase, info: searches.append(phase))
result = all_doubled(np.ones(3))
few = len(searches) < 40 and gc.isenabled()
print(result, len(doubled.overloads), len(doubled.part.overloads), "numba.np.arraymath" in sys.modules, few)
"""

ALLOCATION = """\
import numpy as np
from numba.core.errors import NumbaError
from riftberg.compiled.kernels import borrower, kernel

@kernel
def ones(n):
    return np.ones(n)

@kernel
def six(x):
    return 2.0 * ones(3).sum()

@borrower
def made(x):
    return np.zeros(3).sum() + x

@borrower
def given(x):
    return ones(3).sum() + x

print(six(1.0))
for wrong in (made, given):
    try:
        print(wrong(1.0))
    except NumbaError:
        print("refused")
"""

TUPLES = """\
import sys
from typing import NamedTuple
import numpy as np
from riftberg.compiled.kernels import borrower

class Place(NamedTuple):
    x: np.ndarray
    y: np.ndarray

class Turned(NamedTuple):
    y: np.ndarray
    x: np.ndarray

class Body(NamedTuple):
    number: int
    place: Place
    mass: float

@borrower
def first(place: Place) -> float:
    return place.x[0] + 10.0 * place.y[0]

@borrower
def moment(body: Body, arm: float) -> float:
    body.place.x[1] = 7.0
    return body.number * body.mass * first(body.place) * arm

one, two = np.array([1.0, 0.0]), np.array([2.0, 0.0])
print(moment(Body(2, Place(one, two), 0.5), 3.0), one[1], first(Place(one, two)), first(Turned(one, two)))
print(moment.py_func(Body(2, Place(one, two), 0.5), 3.0), "numba.np.arraymath" in sys.modules)
"""

LOADED = """\
import atexit, sys
from riftberg.cli.main import app
loaded = lambda name: any(module == name or module.startswith(name + ".") for module in sys.modules)
atexit.register(lambda: print("loaded:", [name for name in {unwanted} if loaded(name)]))
app({command})
"""

FORMULA = """\
start: 2020-12-09
berg: {rectangle: {length: 12 km, width: 9 km}, placement: [-37, -56], thickness: 200 m, radius: 1.5 km}
forcing: {kind: formula, uniform: {current: [0.1, 0.0]}}
"""

READERS = ("xarray", "pandas", "dask", "riftberg.products", "riftberg.ocean.product_records", "riftberg.ocean.datasets")
"""What runs on files load, which takes half a second."""

OTHERS = ("matplotlib", "riftberg.ensembles", "riftberg.ocean.errors", "riftberg.viz", "scipy.optimize", "scipy.stats")
"""What other commands load."""

UNWANTED = {
    "run": (*READERS, *OTHERS, "riftberg.engines.explicit", "riftberg.kid", "f90nml", "riftberg.coupling"),
    "kid": (
        *READERS,
        *OTHERS,
        "scipy.spatial",
        "scipy.sparse",
        "riftberg.engines.quasi_static",
        "riftberg.ocean.formulas",
    ),
}
"""Modules that a run does not load, by command; the sparse solver of a berg with cells is SciPy's."""

LOCK = """\
import sys
from riftberg.system.netcdf_lock import NETCDF
with NETCDF:
    pass
print("xarray" in sys.modules)
with NETCDF:
    import xarray
    from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK
    print(NETCDF4_PYTHON_LOCK.locked())
with NETCDF:
    print(NETCDF4_PYTHON_LOCK.locked())
print(NETCDF4_PYTHON_LOCK.locked(), NETCDF.locked())
"""


def said(code: str, folder: Path | None = None, **environment: str) -> str:
    """Return what a program prints in a process of its own."""
    command = [sys.executable, "-c", code]
    if folder is not None:  # kernels are kept for functions that stand in a file
        (folder / "program.py").write_text(code)
        command = [sys.executable, str(folder / "program.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
    return done.stdout.strip() or done.stderr


def test_the_help_of_all_commands_says_what_each_says() -> None:
    """It is written by hand, so that no command is loaded for it."""
    shown = " ".join(CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).output.split())
    for command in app.registered_commands:
        assert command.callback is not None
        summary = " ".join((command.callback.__doc__ or "").split("\n\n")[0].split())
        assert summary
        assert f" {command.name} {summary}" in shown


def test_help_loads_no_command() -> None:
    code = (
        "import sys\nfrom riftberg.cli.main import app\ntry: app(['--help'])\nexcept SystemExit: pass\n"
        "print([m for m in sys.modules if m.startswith('riftberg.cli.') and m != 'riftberg.cli.main'])"
    )
    assert said(code).endswith("[]")


@pytest.mark.parametrize(
    ("words", "unwanted"), [("--help", ("rich", "pydantic", "numpy")), ("experiments", ("rich", "pydantic", "numpy"))]
)
def test_help_and_the_list_of_experiments_load_nothing_heavy(words: str, unwanted: tuple[str, ...]) -> None:
    code = (
        f"import sys\nfrom riftberg.cli.main import app\ntry: app([{words!r}])\nexcept SystemExit: pass\n"
        f"print([m for m in {unwanted} if m in sys.modules])"
    )
    assert said(code).endswith("[]")


def test_the_end_of_a_command_searches_no_cycles() -> None:
    """To look through all that was imported takes a quarter of a second; callbacks of the start are called last."""
    code = (
        "import atexit, gc\natexit.register(lambda: print(gc.get_freeze_count() > 1000))\n"
        "from riftberg.cli.main import app\ntry: app(['--version'])\nexcept SystemExit: pass"
    )
    assert said(code).endswith("True")


def test_the_application_lists_its_commands() -> None:
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).output.partition("Commands:")[2]
    listed = [line.split()[0] for line in shown.splitlines() if line.startswith("  ") and line[2] != " "]
    assert [command.name for command in app.registered_commands] == listed
    assert len(listed) > 20
    assert all(command.callback is not None and command.callback.__doc__ for command in app.registered_commands)


def test_a_mistyped_command_is_told_the_nearest() -> None:
    assert "Did you mean 'run'" in CliRunner().invoke(app, ["runn"]).stderr


@pytest.mark.parametrize("work", ["a68a", "formula", "kid"])
def test_a_run_loads_no_more_than_it_needs(work: str, tmp_path: Path) -> None:
    """To load xarray with pandas takes half a second, SciPy's solvers another, an engine that is not used a twentieth."""
    (tmp_path / "formula.yaml").write_text(FORMULA)
    command = ["run", "a68a" if work == "a68a" else str(tmp_path / "formula.yaml"), "--days", "0.05", "--no-map"]
    if work == "kid":
        command = ["kid", str(write_case(tmp_path / "case"))]
    command += ["-q", "-o", str(tmp_path / "out")]
    printed = said(LOADED.format(unwanted=UNWANTED[command[0]], command=command))
    assert printed.splitlines()[-1] == "loaded: []", printed


def test_the_lock_includes_that_of_xarray_once_it_is_loaded() -> None:
    assert said(LOCK).split() == ["False", "False", "True", "False", "False"]


@pytest.mark.slow
@pytest.mark.compiled
def test_a_kernel_that_kernels_call_is_a_part_of_their_code(tmp_path: Path) -> None:
    """One file of machine code; and loaded again it does without what numba loads to compile.

    Compiling is not stopped by searches for cycles of objects, which go on afterwards.
    """
    first = said(KERNELS, tmp_path, RIFTBERG_CACHE=str(tmp_path / "cache"))
    again = said(KERNELS, tmp_path, RIFTBERG_CACHE=str(tmp_path / "cache"))
    assert first == "6.0 0 1 True True"
    assert again == "6.0 0 0 False True"
    assert len(list(tmp_path.rglob("*.code"))) == 1


@pytest.mark.slow
@pytest.mark.compiled
def test_named_tuples_of_a_call_are_taken_apart_by_name(tmp_path: Path) -> None:
    """Nested ones too, by the class that is given; the code of another order of fields is another one."""
    first, again, turned = (
        said(code, tmp_path, RIFTBERG_CACHE=str(tmp_path / "cache")).split()
        for code in (TUPLES, TUPLES, TUPLES.replace("number: int\n    place: Place", "place: Place\n    number: int")
                     .replace("(2, Place(one, two)", "(Place(one, two), 2"))
    )  # fmt: skip
    assert first == ["63.0", "7.0", "21.0", "12.0", "63.0", "True"]
    assert again == [*first[:-1], "False"]
    assert turned == first


@pytest.mark.slow
@pytest.mark.compiled
def test_a_kernel_that_borrows_cannot_make_an_array(tmp_path: Path) -> None:
    """By itself, or by a kernel that it calls and that another has called before; such an array would never be given back."""
    assert said(ALLOCATION, tmp_path).split() == ["6.0", "refused", "refused"]


def test_partners_ascend_where_there_are_many() -> None:
    """They are sorted by hand, because NumPy's sort takes seconds to compile."""
    random = np.random.default_rng(3)
    x, y = random.uniform(0.0, 1.0, (2, 150))
    start, partner = find_pairs(x, y, np.zeros(150, np.int64), 0.6, 0, False, 6.37e6, 0.0)
    for e in range(150):
        near = np.flatnonzero(np.hypot(x - x[e], y - y[e]) < 0.6)
        assert partner[start[e] : start[e + 1]].tolist() == near[near != e].tolist()


@pytest.mark.slow
@pytest.mark.compiled
def test_with_another_numba_kernels_are_compiled_as_it_does(tmp_path: Path) -> None:
    """`riftberg.compiled.parts` knows the inside of some versions only; the others must do without."""
    other = "import riftberg.compiled.kernels\nriftberg.compiled.kernels.KNOWN_NUMBA = ()\n" + KERNELS
    other = other.replace("len(doubled.part.overloads)", "hasattr(doubled, 'part')")
    for _ in range(2):  # compiled, then from the cache
        assert said(other, tmp_path, RIFTBERG_CACHE=str(tmp_path)).split()[::2][:2] == ["6.0", "False"]
