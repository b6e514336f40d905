"""Cases with melt, bits, rolling and footloose calving against the reference's output: mass, shape, bits, births and deaths."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from contract import HEAT_CLOSES, MASS_CLOSES
from riftberg.kid.run import KidReport, run_kid

from .cases import MASS_AND_SHAPE, MELTING, POSITION
from .records import Table, layout, paired, read

ELEMENT = ("second", "id_cnt", "id_ij")
SHAPE = ("mass", "thickness", "width", "length", "mass_of_bits", "mass_of_fl_bits", "mass_of_fl_bergy_bits", "fl_k",
         "mass_scaling", "start_mass", "sst", "heat_density", "start_year", "start_day")  # fmt: skip
LEAST = 1e-6
"""Part of the largest value in the case below which a value is round-off of a difference, not relative to itself."""


def each_case(test: Callable[..., None]) -> Callable[..., None]:
    """Give a test all cases; the same two of all tests are quick, and run once. The longest has 70,000 steps."""
    cases = [pytest.param(name, marks=pytest.mark.slow) if name == "footloose" else name for name in MELTING]
    return pytest.mark.quick(2)(pytest.mark.parametrize("name", cases)(test))


Ran = tuple[KidReport, Table, Table]
_DONE: dict[str, Ran] = {}


@pytest.fixture(scope="module")
def ran(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Ran]:
    """Return a function that runs a case once, and pairs its records with the reference's."""

    def run(name: str) -> Ran:
        if name not in _DONE:
            folder = shared / "reference" / name
            report = run_kid(folder, tmp_path_factory.mktemp(name) / f"{name}.nc", ranks=MELTING[name])
            _DONE[name] = report, read(report.files[0]), read(folder / "expected" / "trajectories.nc")
        return _DONE[name]

    return run


@each_case
def test_the_same_bergs_at_each_record(ran: Callable[[str], Ran], name: str) -> None:
    """Births and deaths: `paired` compares who is there."""
    _, ours, theirs = ran(name)
    ours, theirs = paired(ours, theirs, ELEMENT)
    counts = np.unique(theirs["second"], return_counts=True)[1]
    if name != "iKID_collision_melting":
        assert counts.min() != counts.max()


@each_case
def test_mass_shape_and_bits(ran: Callable[[str], Ran], name: str) -> None:
    _, *tables = ran(name)
    ours, theirs = paired(*tables, ELEMENT)
    compared = [v for v in SHAPE if v in theirs]
    assert len(compared) >= 6
    for v in compared:
        scale = np.maximum(np.abs(theirs[v]), LEAST * np.abs(theirs[v]).max())
        np.testing.assert_array_less(np.abs(ours[v] - theirs[v]), MASS_AND_SHAPE * scale + 1e-300, err_msg=v)


@each_case
def test_positions(ran: Callable[[str], Ran], name: str) -> None:
    """Northward everywhere; eastward where the reference has its elements in the right cells (Lx > 0)."""
    _, *tables = ran(name)
    ours, theirs = paired(*tables, ELEMENT)
    limit = 10.0 * POSITION
    assert np.abs(ours["lat"] - theirs["lat"]).max() <= limit
    for v in ("uvel", "vvel"):
        assert np.abs(ours[v] - theirs[v]).max() <= 1e-6
    if name in ("iKID_collision_melting", "footloose"):
        assert np.abs(ours["lon"] - theirs["lon"]).max() <= limit


@each_case
def test_final_restart(ran: Callable[[str], Ran], name: str, shared: Path) -> None:
    """Names, order, types and attributes, and the numbers of melt and calving."""
    report, _, _ = ran(name)
    path = next(p for p in report.files if p.stem == f"{name}_restart")
    expected = shared / "reference" / name / "expected" / "final_restart.nc"
    assert layout(path) == layout(expected)
    ours, theirs = paired(read(path), read(expected), ("id_cnt", "id_ij"))
    for v in [v for v in SHAPE if v in theirs]:
        np.testing.assert_allclose(ours[v], theirs[v], rtol=1e-8, atol=1e-300, err_msg=v)


@each_case
def test_layout_of_the_trajectory(ran: Callable[[str], Ran], name: str, shared: Path) -> None:
    report, _, _ = ran(name)
    known = {v.name: v for v in layout(report.files[0])}
    for variable in layout(shared / "reference" / name / "expected" / "trajectories.nc"):
        assert known[variable.name] == variable


@each_case
def test_the_ledger_closes(ran: Callable[[str], Ran], name: str) -> None:
    model = ran(name)[0].case.model
    assert model.life is not None
    balance = model.life.balance(model)
    assert abs(balance.error) <= MASS_CLOSES
    assert abs(balance.heat_error) <= HEAT_CLOSES
    assert sum(balance.water.values()) > 1e9
