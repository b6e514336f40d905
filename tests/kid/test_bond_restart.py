"""KID's bond restart: directed bonds, each physical bond twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import Grid
from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.errors import BergError, InputError
from riftberg.kid.restart import read_bonds, read_restart, split_id, write_bonds
from riftberg.state import Bonds, Elements

from .conftest import restart_variables, write_nc

PLANE = Metric(latlon=False)
GRID = Grid.cartesian(20, 20, 1000.0)


@pytest.fixture
def berg(tmp_path: Path) -> tuple[Elements, Bonds]:
    """Five squares in a row, with bonds that carry something."""
    elements = read_restart(write_nc(tmp_path / "r.nc", restart_variables(5)), GRID)
    bonds = form_bonds(elements, BondRule(), PLANE)
    rng = np.random.default_rng(5)
    for name in ("shear_x", "shear_y", "normal_stress", "shear_stress", "relative_rotation"):
        getattr(bonds, name)[:] = rng.normal(size=4)
    return elements, bonds


def test_round_trip_with_broken_and_gone_bonds(tmp_path: Path, berg: tuple[Elements, Bonds]) -> None:
    elements, bonds = berg
    bonds.status[:] = 0, 1, 2, 0
    path = tmp_path / "bonds.nc"
    write_bonds(path, elements, bonds, GRID, dem=True)
    again = read_bonds(path, elements, PLANE)
    listed = bonds.status != 2
    dem = ("shear_x", "shear_y", "normal_stress", "shear_stress", "relative_rotation")
    for name in ("first", "second", "status", *dem):
        np.testing.assert_array_equal(getattr(again, name), getattr(bonds, name)[listed], err_msg=name)
    assert np.isnan(again.break_time).tolist() == [True, False, True]
    assert elements.bond_count.tolist() == [1, 1, 0, 1, 1]
    np.testing.assert_allclose(again.bond_length, 400.0, rtol=1e-12)


def test_layout(tmp_path: Path, berg: tuple[Elements, Bonds]) -> None:
    elements, bonds = berg
    write_bonds(tmp_path / "bonds.nc", elements, bonds, GRID, dem=True)
    with netCDF4.Dataset(tmp_path / "bonds.nc") as dataset:
        assert list(dataset.variables) == [
            "first_berg_ine", "first_berg_jne", "first_id_cnt", "first_id_ij", "other_berg_ine", "other_berg_jne",
            "other_id_cnt", "other_id_ij", "tangd1", "tangd2", "nstress", "sstress", "rel_rotation", "broken",
        ]  # fmt: skip
        assert len(dataset.dimensions["i"]) == 8
        assert dataset["first_id_cnt"].long_name == "counter component of iceberg id first berg in bond"
        assert dataset["other_berg_ine"].long_name == "iceberg ine of second berg in bond"
        assert dataset["broken"].units == "none"
        assert dataset["nstress"].units == "Pa"
        first, other = dataset["first_berg_ine"][:4], dataset["other_berg_ine"][4:]
        np.testing.assert_array_equal(first, other)
        np.testing.assert_array_equal(dataset["tangd1"][:4], -dataset["tangd1"][4:])
        np.testing.assert_array_equal(dataset["nstress"][:4], dataset["nstress"][4:])
    write_bonds(tmp_path / "plain.nc", elements, bonds, GRID, dem=False)
    with netCDF4.Dataset(tmp_path / "plain.nc") as dataset:
        assert "tangd1" not in dataset.variables


def records(elements: Elements, pairs: list[tuple[int, int]]) -> dict[str, Any]:
    counter, cell = (part.astype("i4") for part in split_id(elements.id))
    a, b = (np.array(ends) for ends in zip(*pairs, strict=True))
    return {"first_id_cnt": counter[a], "first_id_ij": cell[a], "other_id_cnt": counter[b], "other_id_ij": cell[b]}


def test_order_of_records_does_not_matter_and_dem_variables_are_optional(
    tmp_path: Path, berg: tuple[Elements, Bonds]
) -> None:
    elements, _ = berg
    path = write_nc(tmp_path / "b.nc", records(elements, [(3, 2), (0, 1), (2, 3), (1, 0)]))
    bonds = read_bonds(path, elements, PLANE)
    assert bonds.first.tolist() == [0, 2]
    assert bonds.second.tolist() == [1, 3]
    assert not bonds.shear_x.any()


@pytest.mark.parametrize("pairs", [[(0, 1)], [(0, 1), (1, 0), (0, 1)], [(2, 2)], [(0, 1), (1, 0), (2, 1)]])
def test_bonds_without_their_mirror_are_refused(
    tmp_path: Path, berg: tuple[Elements, Bonds], pairs: list[tuple[int, int]]
) -> None:
    elements, _ = berg
    path = write_nc(tmp_path / "b.nc", records(elements, pairs))
    with pytest.raises(BergError, match=r"mirror|twice|itself"):
        read_bonds(path, elements, PLANE)


def test_unknown_element_and_obsolete_layout(tmp_path: Path, berg: tuple[Elements, Bonds]) -> None:
    elements, _ = berg
    wrong = records(elements, [(0, 1), (1, 0)])
    wrong["other_id_cnt"] = wrong["other_id_cnt"] + 77
    with pytest.raises(BergError, match=r"other_id_cnt.*bond 1 names element id_cnt = 7"):
        read_bonds(write_nc(tmp_path / "b.nc", wrong), elements, PLANE)
    old = {**records(elements, [(0, 1)]), "first_berg_num": np.ones(1, dtype="i4")}
    with pytest.raises(InputError, match="obsolete layout"):
        read_bonds(write_nc(tmp_path / "o.nc", old), elements, PLANE)
