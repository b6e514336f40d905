"""Cases with options mixed against the reference's output: records, positions, all variables, restart."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from riftberg.kid.run import run_kid

from .cases import MASS_AND_SHAPE, MIXED, POSITION_MIXED, RELATIVE
from .records import Table, paired, read

ELEMENT = ("second", "id_cnt", "id_ij")
UNDEFINED = {"od", "uvel_prev", "vvel_prev"}
"""What the reference leaves undefined in the records of single-step schemes, in the first step, or both."""

each_case = pytest.mark.parametrize("name", MIXED)
Ran = tuple[Table, Table, Table, Table]
_DONE: dict[str, Ran] = {}


@pytest.fixture(scope="module")
def ran(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ran]:
    """Return a function that runs a case once: trajectory and restart, ours and the reference's."""

    def run(name: str) -> Ran:
        if name not in _DONE:
            folder = shared / "reference" / "more" / name
            report = run_kid(folder, tmp_path_factory.mktemp(name) / f"{name}.nc", ranks=MIXED[name])
            restart = next(path for path in report.files if path.stem == f"{name}_restart")
            expected = folder / "expected"
            _DONE[name] = (
                read(report.files[0]), read(expected / "trajectories.nc"), read(restart),
                read(expected / "final_restart.nc"),
            )  # fmt: skip
        return _DONE[name]

    return run


@each_case
def test_the_same_records(ran: Callable[[str], Ran], name: str) -> None:
    """Who is there at each stamp, and nobody else at any other."""
    ours, theirs, *_ = ran(name)
    assert ours["lon"].size == theirs["lon"].size
    paired(ours, theirs, ELEMENT)


@each_case
def test_positions(ran: Callable[[str], Ran], name: str) -> None:
    ours, theirs, *_ = ran(name)
    ours, theirs = paired(ours, theirs, ELEMENT)
    assert np.hypot(ours["lon"] - theirs["lon"], ours["lat"] - theirs["lat"]).max() <= POSITION_MIXED


@each_case
def test_all_other_variables(ran: Callable[[str], Ran], name: str) -> None:
    """As part of the largest value of each in the case; masses and sizes more closely."""
    ours, theirs, *_ = ran(name)
    ours, theirs = paired(ours, theirs, ELEMENT)
    compared = sorted(set(ours) & set(theirs) - UNDEFINED - {"lon", "lat"})
    assert len(compared) >= 15
    for v in compared:
        limit = MASS_AND_SHAPE if v in ("mass", "thickness", "width", "length") else RELATIVE
        assert np.abs(ours[v] - theirs[v]).max() <= limit * np.abs(theirs[v]).max(), v


@each_case
def test_final_restart(ran: Callable[[str], Ran], name: str) -> None:
    """Elements that have left are gone from it too."""
    ours, theirs = paired(*ran(name)[2:], ("id_cnt", "id_ij"))
    assert set(ours) == set(theirs)
    assert np.hypot(ours["lon"] - theirs["lon"], ours["lat"] - theirs["lat"]).max(initial=0.0) <= POSITION_MIXED
    np.testing.assert_allclose(ours["mass"], theirs["mass"], rtol=1e-9)


def test_no_case_is_forgotten(shared: Path) -> None:
    assert {path.name for path in (shared / "reference" / "more").iterdir() if path.is_dir()} == set(MIXED)
