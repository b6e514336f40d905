"""KID's restart of calving: written, read again, and gone on from."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from riftberg import Grid
from riftberg.errors import InputError
from riftberg.kid.restart import read_stores, write_stores
from riftberg.life.calving import Stores


def stores(means: bool) -> Stores:
    r = np.random.default_rng(5)
    mean = (r.uniform(size=(4, 6)), r.normal(size=(4, 6))) if means else (None, None)
    return Stores(r.uniform(0, 1e9, (10, 4, 6)), r.normal(0, 1e15, (4, 6)), r.integers(0, 9, (4, 6)), *mean, begun=True)


def grid() -> Grid:
    return Grid.cartesian(6, 4, 1000.0)


@pytest.mark.parametrize("means", [False, True])
def test_stores_come_back_as_they_were(tmp_path: Path, means: bool) -> None:
    given = stores(means)
    write_stores(tmp_path / "calving.res.nc", given)
    got = read_stores(tmp_path / "calving.res.nc", grid(), 10)
    assert got is not None
    for name in ("ice", "heat", "counter", "mean_flux", "mean_heat"):
        want = getattr(given, name)
        assert (getattr(got, name) is None) == (want is None)
        if want is not None:
            np.testing.assert_array_equal(getattr(got, name), want)


def test_layout_is_that_of_the_reference(tmp_path: Path) -> None:
    write_stores(tmp_path / "c.nc", stores(True))
    with netCDF4.Dataset(tmp_path / "c.nc") as dataset:
        assert {name: len(d) for name, d in dataset.dimensions.items()} == {
            "xaxis_1": 6, "yaxis_1": 4, "zaxis_1": 10, "Time": 1,
        }  # fmt: skip
        ice = dataset["stored_ice"]
        assert ice.dimensions == ("Time", "zaxis_1", "yaxis_1", "xaxis_1")
        assert (ice.long_name, ice.units) == ("STORED_ICE", "none")
        assert dataset["iceberg_counter_grd"].dtype == np.int32
        assert {name: dataset[name].cartesian_axis for name in dataset.dimensions} == {
            "xaxis_1": "X", "yaxis_1": "Y", "zaxis_1": "Z", "Time": "T",
        }  # fmt: skip


def test_a_file_of_another_grid_or_with_impossible_ice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.nc"
    write_stores(path, stores(False))
    with pytest.raises(InputError, match="same grid"):
        read_stores(path, Grid.cartesian(5, 4, 1000.0), 10)
    wrong = stores(False)
    wrong.ice[0, 0, 0] = -1.0
    write_stores(path, wrong)
    with pytest.raises(InputError, match="stored_ice: values that are negative"):
        read_stores(path, grid(), 10)
    assert read_stores(tmp_path / "none.nc", grid(), 10) is None


def test_the_stores_of_the_specification_are_reproduced() -> None:
    """Least, largest and mean store of a 20 x 20 grid with scalings of one, as written for the reference."""
    from riftberg.config.parameter_groups import SOUTHERN_CLASSES, Calving
    from riftberg.life.calving import size_classes

    table = SOUTHERN_CLASSES.model_copy(update={"scaling": (1.0,) * 10})
    classes = size_classes(table, Calving(), 850.0)
    ice = Stores.random(classes, classes, Grid.cartesian(20, 20, 1000.0), by_column=False).ice
    assert ice.min() == pytest.approx(639335.88, abs=0.005)
    assert ice.max() == pytest.approx(7.380127765e11, rel=5e-10)
    assert ice.mean() == pytest.approx(8.033602570e10, rel=5e-10)
