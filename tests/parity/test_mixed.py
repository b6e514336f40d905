"""Cases with options mixed against the reference's output: records, positions, all variables, bonds, restart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from riftberg.kid.run import run_kid

from .cases import MASS_AND_SHAPE, MIXED, POSITION_MIXED, RELATIVE
from .comparison import BOND, ELEMENT
from .records import Table, offset, paired, read

UNDEFINED = {"od", "uvel_prev", "vvel_prev"}
"""What the reference leaves undefined in the records of single-step schemes, in the first step, or both."""

NOISE = 1e-12
"""Largest value of a variable that is nothing but round-off in the case, in its own unit."""


def each_case(test: Callable[..., None]) -> Callable[..., None]:
    """Give a test all cases; the same five of all tests are quick, and run once."""
    return pytest.mark.quick(5)(pytest.mark.parametrize("name", MIXED)(test))


@dataclass
class Ran:
    """What a case gave, by the end of the file's name: trajectory (none), restart, bonds."""

    name: str
    ours: dict[str, Path]
    expected: Path

    def tables(self, kind: str = "") -> tuple[Table, Table]:
        """Return a file of ours and that of the reference; skip where the case has none."""
        theirs = {"": "trajectories.nc", "restart": "final_restart.nc", "bonds": "bonds.nc"}[kind]
        if not (self.expected / theirs).exists():
            pytest.skip(f"the reference kept no {theirs} of this case")
        return read(self.ours[kind]), read(self.expected / theirs)

    def distance(self, ours: Table, theirs: Table) -> float:
        """Return the largest distance of paired positions, m."""
        return float(np.hypot(*offset(ours, theirs, MIXED[self.name].latlon)).max(initial=0.0))


_DONE: dict[str, Ran] = {}


@pytest.fixture(scope="module")
def ran(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ran]:
    """Return a function that runs a case once."""

    def run(name: str) -> Ran:
        if name not in _DONE:
            case = MIXED[name]
            folder = shared / case.folder / name
            report = run_kid(folder, tmp_path_factory.mktemp(name) / f"{name}.nc", ranks=case.ranks)
            files = {path.stem.removeprefix(name).removeprefix("_"): path for path in report.files}
            _DONE[name] = Ran(name, files, folder / "expected")
        return _DONE[name]

    return run


@each_case
def test_the_same_records(ran: Callable[[str], Ran], name: str) -> None:
    """Who is there at each stamp, and nobody else at any other."""
    ours, theirs = ran(name).tables()
    assert ours["lon"].size == theirs["lon"].size
    paired(ours, theirs, ELEMENT)


@each_case
def test_positions(ran: Callable[[str], Ran], name: str) -> None:
    ours, theirs = paired(*ran(name).tables(), ELEMENT)
    assert ran(name).distance(ours, theirs) <= POSITION_MIXED


@each_case
def test_all_other_variables(ran: Callable[[str], Ran], name: str) -> None:
    """As part of the largest value of each in the case; masses and sizes more closely."""
    ours, theirs = paired(*ran(name).tables(), ELEMENT)
    compared = sorted(set(ours) & set(theirs) - UNDEFINED - {"lon", "lat"})
    assert len(compared) >= 9
    for v in compared:
        limit = MASS_AND_SHAPE if v in ("mass", "thickness", "width", "length") else RELATIVE
        assert np.abs(ours[v] - theirs[v]).max() <= limit * np.abs(theirs[v]).max() + NOISE, v


@each_case
def test_bonds(ran: Callable[[str], Ran], name: str) -> None:
    """Every listed bond at every stamp, with whether it is broken."""
    ours, theirs = paired(*ran(name).tables("bonds"), BOND)
    np.testing.assert_array_equal(ours["broken"], theirs["broken"])


@each_case
def test_final_restart(ran: Callable[[str], Ran], name: str) -> None:
    """Elements that have left are gone from it too."""
    ours, theirs = paired(*ran(name).tables("restart"), ("id_cnt", "id_ij"))
    assert set(ours) == set(theirs)
    assert ran(name).distance(ours, theirs) <= POSITION_MIXED
    np.testing.assert_allclose(ours["mass"], theirs["mass"], rtol=MASS_AND_SHAPE)


def test_no_case_is_forgotten(shared: Path) -> None:
    for folder in {case.folder for case in MIXED.values()}:
        known = {name for name, case in MIXED.items() if case.folder == folder}
        assert {path.name for path in (shared / folder).iterdir() if path.is_dir()} == known
