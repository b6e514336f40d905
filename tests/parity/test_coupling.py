"""The cases that exchange with an ocean: everything that the reference returns and records, to 1e-12."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from riftberg.kid.run import run_kid

from .records import Table, read

CASES = (
    "bits", "calve_n", "calve_tau", "default", "fl_bits", "fl_nodecay", "fl_nodisp", "fl_pe", "fl_zero", "gridcut", "kelvin",
    "land", "nodecay", "nodecay_spread", "nosplit", "roll1", "roll1b", "shelf2", "shelf3", "spreadmelt", "zero",
)  # fmt: skip

RELATIVE = 1e-12
"""Largest difference of any value: of a berg as part of that value, of a field as part of its largest value in the case."""

UNDEFINED = ("uvel_prev", "vvel_prev", "od")
"""What the reference leaves undefined in the records of bergs that do not move (quirk T31)."""


def ordered(path: Path) -> Table:
    """Records of bergs by time and identifier."""
    table = read(path)
    order = np.lexsort((table["id_ij"], table["id_cnt"], table["second"], table["year"]))
    return {name: values[order] for name, values in table.items()}


def fields(path: Path) -> dict[str, np.ndarray]:
    with netCDF4.Dataset(path) as dataset:
        return {name: np.asarray(v[...]) for name, v in dataset.variables.items()}


def differences(folder: Path, expected: Path) -> Iterator[tuple[str, float]]:
    ours, theirs = fields(folder / "ocean.nc"), fields(expected / "ocean.nc")
    assert set(ours) == set(theirs)
    for name, want in theirs.items():
        yield name, float(np.abs(ours[name] - want).max() / max(np.abs(want).max(), 1e-300))
    ours, theirs = ordered(folder / "t.nc"), ordered(expected / "trajectories.nc")
    for name in ("second", "year", "id_cnt", "id_ij"):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    for name in set(theirs) - set(UNDEFINED):
        want = theirs[name]
        size = np.where(want != 0.0, np.abs(want), 1.0)
        yield f"berg {name}", float((np.abs(ours[name] - want) / size).max())


@pytest.mark.quick(6)
@pytest.mark.parametrize("name", CASES)
def test_returned_fields_stocks_ids_and_bergs(shared: Path, tmp_path: Path, name: str) -> None:
    folder = shared / "reference" / "coupling" / name
    run_kid(folder, tmp_path / "t.nc")
    wrong = {what: size for what, size in differences(tmp_path, folder / "expected") if not size <= RELATIVE}
    assert not wrong


def test_no_case_is_forgotten(shared: Path) -> None:
    assert {path.name for path in (shared / "reference" / "coupling").iterdir() if path.is_dir()} == set(CASES)


def test_ocean_file_has_the_layout_of_the_reference(shared: Path, tmp_path: Path) -> None:
    folder = shared / "reference" / "coupling" / "calve_tau"
    run_kid(folder, tmp_path / "t.nc")
    with netCDF4.Dataset(tmp_path / "ocean.nc") as ours, netCDF4.Dataset(folder / "expected" / "ocean.nc") as theirs:
        assert {k: len(v) for k, v in ours.dimensions.items()} == {k: len(v) for k, v in theirs.dimensions.items()}
        for name, want in theirs.variables.items():
            got = ours.variables[name]
            assert (got.dimensions, got.dtype) == (want.dimensions, want.dtype)
            for attribute in ("units", "comment"):
                assert getattr(got, attribute, None) == getattr(want, attribute, None)
