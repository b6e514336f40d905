"""A68a from its table of rows: the published elements, and the same shape at other resolutions."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.bergs.bonding import Metric, separations
from riftberg.experiments.a68a import A68A_OBSERVED, A68A_ROWS, a68a_berg, table_positions


def positions(path):
    netcdf = pytest.importorskip("netCDF4")
    with netcdf.Dataset(path) as file:
        file.set_auto_mask(False)
        return file["lon"][:], file["lat"][:]


def test_table_has_the_472_elements_and_874_bonds_of_the_paper():
    assert sum(last - first + 1 for _, first, last in A68A_ROWS) == 472
    berg = a68a_berg()
    assert (len(berg.elements.id), len(berg.bonds.first)) == (472, 874)
    assert berg.mass == pytest.approx(472 * 1.53e12, rel=1e-12)
    assert berg.elements.berg.max() == 1


@pytest.mark.parametrize(
    ("northward", "file"),
    [(0.0, "data/a68a/icebergs.res.nc"), (0.1, "reference/a68_story/INPUT/icebergs.res.nc")],
)
def test_positions_of_the_reference_to_the_last_digit(shared, northward, file):
    row, column = np.array([(row, column) for row, first, last in A68A_ROWS for column in range(first, last + 1)]).T
    by_column = np.lexsort((row, column))  # as the file numbers the elements
    for ours, theirs in zip(table_positions(northward), positions(shared / file), strict=True):
        np.testing.assert_array_equal(ours[by_column], theirs)


def test_what_was_observed_is_the_shared_table(shared):
    with (shared / "data/observed/a68a_observed_state.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("centroid_lat", "centroid_lon", "mrr_azimuth_deg_mod180", "area_km2")
    table = [(int(row["date"][-2:]), *(float(row[name]) for name in names)) for row in rows]
    assert [tuple(seen) for seen in A68A_OBSERVED] == table[: len(A68A_OBSERVED)]


def test_unstrained_berg_stands_where_the_reference_does(shared):
    """Mean position to a metre, no element further than 0.7 km: the lattice of the reference is bent, ours is not."""
    lon, lat = positions(shared / "reference/a68_story/INPUT/icebergs.res.nc")
    berg = a68a_berg()
    x, y = separations(Metric(True, berg.earth_radius), berg.elements.lon + 360.0, berg.elements.lat, lon, lat)
    assert (x.mean(), y.mean()) == pytest.approx((0.0, 0.0), abs=1.0)
    assert np.hypot(x, y).max() < 700.0


def test_strain_at_the_start_is_gone_against_the_rule_of_the_reference():
    assert abs(a68a_berg().initial_strain) < 1e-9
    bent = Iceberg.from_points(*table_positions(), thickness=200.0)
    assert bent.initial_strain * 5e6 == pytest.approx(3.8e3, abs=100)  # Pa; story: 4 kPa


@pytest.mark.quick(3)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("radius", [750.0, 1000.0, 1500.0, 2000.0])
def test_other_lattices_fill_the_same_shape(radius, packing):
    berg = a68a_berg(radius, packing)
    assert berg.area == pytest.approx(4248e6, rel=0.02)
    assert berg.report["area_error"] == pytest.approx(berg.area / 4248e6 - 1.0, abs=1e-12)
    assert berg.centroid == pytest.approx((-39.2548, -55.0286), abs=0.01)
    assert berg.elements.berg.max() == 1
    assert abs(berg.initial_strain) < 5e-6
