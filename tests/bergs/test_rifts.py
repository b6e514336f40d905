"""Rifts cut exactly the bonds they cross; scatter of strength can be repeated."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from riftberg import Iceberg
from riftberg.errors import BergError


@pytest.fixture(scope="module")
def block() -> Iceberg:
    """Six by four square elements of 2 m on a plane, centres at odd coordinates from 1."""
    return Iceberg.rectangle(12.0, 8.0, thickness=1.0, radius=1.0, placement=(6.0, 4.0), latlon=False)


def ends(berg: Iceberg, chosen) -> set[tuple[float, float, float, float]]:
    e, b = berg.elements, berg.bonds
    i, j = b.first[chosen], b.second[chosen]
    return set(zip(e.lon[i], e.lat[i], e.lon[j], e.lat[j], strict=True))


def test_full_rift_separates_the_berg(block):
    broken = block.with_rifts([(4.0, -1.0), (4.0, 9.0)], broken=True)
    assert ends(broken, broken.bonds.status == 2) == {(3.0, y, 5.0, y) for y in (1.0, 3.0, 5.0, 7.0)}
    assert broken.elements.berg.max() == 2
    assert (broken.elements.berg == 1).sum() == 8
    assert broken.bonds.status[broken.bonds.status != 0].tolist() == [2] * 4
    assert np.isnan(broken.bonds.break_time).all()


def test_number_of_bonds_of_the_ends_falls(block):
    broken = block.with_rifts([(4.0, -1.0), (4.0, 2.0)], broken=True)
    changed = block.elements.bond_count - broken.elements.bond_count
    assert changed.sum() == 2
    assert sorted(broken.elements.lon[changed == 1]) == [3.0, 5.0]
    assert broken.elements.berg.max() == 1


def test_weak_rift_keeps_bonds_and_the_original_untouched(block):
    weak = block.with_rifts([(-1.0, 4.0), (6.0, 4.0)], strength=0.3)
    assert ends(weak, weak.bonds.strength == 0.3) == {(x, 3.0, x, 5.0) for x in (1.0, 3.0, 5.0)}
    assert (weak.bonds.status == 0).all()
    assert (block.bonds.strength == 1.0).all()


def test_broken_line_of_several_segments(block):
    weak = block.with_rifts([(4.0, -1.0), (4.0, 4.0), (13.0, 4.0)], strength=0.0)
    vertical = {(3.0, y, 5.0, y) for y in (1.0, 3.0)}
    horizontal = {(x, 3.0, x, 5.0) for x in (5.0, 7.0, 9.0, 11.0)}
    assert ends(weak, weak.bonds.strength == 0.0) == vertical | horizontal


def test_rift_through_element_centres_still_separates(block):
    """A line through a column of centres must cut on exactly one side of it, not on both or none."""
    broken = block.with_rifts([(5.0, -1.0), (5.0, 9.0)], broken=True)
    assert (broken.bonds.status == 2).sum() == 4
    assert broken.elements.berg.max() == 2


@given(angle=st.floats(0, np.pi), across=st.floats(-3.0, 3.0))
def test_any_long_straight_rift_leaves_no_bond_between_its_sides(block, angle, across):
    centre = np.array([6.0, 4.0]) + across * np.array([-np.sin(angle), np.cos(angle)])
    direction = np.array([np.cos(angle), np.sin(angle)])
    line = np.array([centre - 30 * direction, centre + 30 * direction])
    e = block.elements
    side = (line[1, 0] - line[0, 0]) * (e.lat - line[0, 1]) - (line[1, 1] - line[0, 1]) * (e.lon - line[0, 0])
    if np.abs(side).min() < 1e-6 or np.all(side > 0) or np.all(side < 0):
        return
    broken = block.with_rifts(line, broken=True)
    apart = (side[block.bonds.first] > 0) != (side[block.bonds.second] > 0)
    np.testing.assert_array_equal(broken.bonds.status == 2, apart)


def test_rift_mask_cuts_bonds_that_pass_its_cells():
    berg = Iceberg.rectangle(30e3, 12e3, thickness=100.0, placement=(10.0, -60.0))
    lon, lat = np.linspace(9.5, 10.5, 201), np.linspace(-60.2, -59.8, 81)
    values = (np.abs(lon - 10.0) < 0.011)[None, :] & np.ones(81, bool)[:, None]
    mask = xr.DataArray(values.astype(float), coords={"lat": lat, "lon": lon}, dims=("lat", "lon"), name="rift")
    cut = berg.with_rifts(mask, broken=True)
    e, b = berg.elements, berg.bonds
    gone = cut.bonds.status == 2
    assert gone.sum() == 4
    assert (np.minimum(e.lon[b.first[gone]], e.lon[b.second[gone]]) < 10.0).all()
    assert cut.elements.berg.max() == 2


def test_a_rift_mask_just_beyond_the_end_of_a_bond_leaves_it():
    """Cells on an eighth of the way from the second to the third column cut the bonds between these two alone."""
    berg = Iceberg.rectangle(30e3, 12e3, thickness=100.0, placement=(10.0, -60.0))
    e, b = berg.elements, berg.bonds
    second, third = np.unique(e.lon.round(9))[1:3]
    lon, lat = second + 0.025 * (third - second) * np.arange(-20, 21), np.linspace(-60.2, -59.8, 81)
    values = np.isin(np.arange(-20, 21), (4, 5))[None, :] & np.ones(81, bool)[:, None]
    mask = xr.DataArray(values.astype(float), coords={"lat": lat, "lon": lon}, dims=("lat", "lon"), name="rift")
    gone = berg.with_rifts(mask, broken=True).bonds.status == 2
    ends_of = np.sort([e.lon[b.first], e.lon[b.second]], axis=0)
    np.testing.assert_array_equal(gone, np.isclose(ends_of[0], second) & np.isclose(ends_of[1], third))


def test_rift_beside_the_berg_is_refused(block):
    with pytest.raises(BergError, match="crosses no bond"):
        block.with_rifts([(100.0, 0.0), (101.0, 1.0)])


@pytest.mark.parametrize("strength", [-0.1, 1.1])
def test_impossible_strength_is_refused(block, strength):
    with pytest.raises(BergError, match="factor from 0 to 1"):
        block.with_rifts([(4.0, -1.0), (4.0, 9.0)], strength=strength)


def test_rift_in_0_to_360_longitudes_cuts_a_berg_in_negative_longitudes():
    berg = Iceberg.rectangle(30e3, 12e3, thickness=100.0, placement=(-39.0, -55.0))
    east = np.array([(321.0, -56.0), (321.0, -54.0)])
    one, other = (berg.with_rifts(line, broken=True) for line in (east, east - [360.0, 0.0]))
    np.testing.assert_array_equal(one.bonds.status, other.bonds.status)
    assert (one.bonds.status == 2).sum() == 4


@cache
def slab() -> Iceberg:
    """A berg of 200,000 bonds."""
    berg = Iceberg.rectangle(632.0, 632.0, thickness=1.0, radius=1.0, latlon=False, offset=(0.0, 0.0))
    assert len(berg.bonds.first) > 199_000
    return berg


@pytest.mark.parametrize("distribution", ["weibull", "normal", "uniform"])
def test_scatter_is_reproducible_and_has_mean_one(block, distribution):
    first, second, other = (block.with_strength(distribution, seed=seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.bonds.strength, second.bonds.strength)
    assert (first.bonds.strength != other.bonds.strength).all()
    many = slab().with_strength(distribution, seed=1).bonds.strength
    assert many.mean() == pytest.approx(1.0, abs=2e-3)
    assert many.min() > 0


def test_weibull_modulus_is_that_of_the_distribution():
    """The share below x of a Weibull distribution is 1 - exp(-(x / scale)**m)."""
    from math import gamma

    values = slab().with_strength("weibull", shape=4.0, seed=3).bonds.strength
    scale = 1 / gamma(1.25)
    for x in (0.6, 1.0, 1.3):
        assert (values < x).mean() == pytest.approx(1 - np.exp(-((x / scale) ** 4)), abs=4e-3)


def test_wide_normal_scatter_stays_positive():
    assert slab().with_strength("normal", spread=0.9, seed=2).bonds.strength.min() > 0


def test_drawn_seed_is_reported_and_makes_the_same_berg(block):
    first = block.with_strength("normal", spread=0.2)
    again = block.with_strength("normal", spread=0.2, seed=first.report["scatter"]["seed"])
    np.testing.assert_array_equal(first.bonds.strength, again.bonds.strength)


def test_rift_and_scatter_may_come_in_any_order(block):
    line = [(4.0, -1.0), (4.0, 9.0)]
    one = block.with_rifts(line, strength=0.5).with_strength(seed=5)
    other = block.with_strength(seed=5).with_rifts(line, strength=0.5)
    np.testing.assert_allclose(one.bonds.strength, other.bonds.strength, rtol=1e-15)


@pytest.mark.parametrize(
    ("distribution", "values"), [("weibull", {"shape": 0.0}), ("uniform", {"spread": 1.0}), ("gamma", {})]
)
def test_impossible_scatter_is_refused(block, distribution, values):
    with pytest.raises(BergError, match="strength"):
        block.with_strength(distribution, seed=1, **values)


@given(st.data())
def test_pieces_are_those_of_a_plain_search(block, data):
    """Any bonds of a berg broken, by a strength of 0 and a rift across all: its pieces are numbered by their first element."""
    lon, lat = block.elements.lon, block.elements.lat
    broken = data.draw(st.sets(st.integers(0, len(block.bonds.first) - 1), min_size=1))
    pairs = list(zip(block.bonds.first.tolist(), block.bonds.second.tolist(), strict=True))
    rifts = []
    for k in broken:  # a short line across the middle of the bond, which touches no other
        i, j = pairs[k]
        x, y, dx, dy = (
            0.5 * (lon[i] + lon[j]),
            0.5 * (lat[i] + lat[j]),
            0.2 * (lon[j] - lon[i]),
            0.2 * (lat[j] - lat[i]),
        )
        rifts.append([(x - dy, y + dx), (x + dy, y - dx)])
    got = block.with_rifts(rifts, broken=True).elements.berg
    label = list(range(len(lon)))
    for _ in range(len(lon)):
        for k, (a, b) in enumerate(pairs):
            if k not in broken:
                label[a] = label[b] = min(label[a], label[b])
    order = {root: n for n, root in enumerate(sorted(set(label)), start=1)}
    assert got.tolist() == [order[root] for root in label]


def test_given_strengths_are_those_of_the_bonds_and_multiply(block):
    count = len(block.bonds.first)
    values = np.linspace(0.5, 1.5, count)
    for given_values in (values, values.tolist(), values.astype(np.float32)):
        np.testing.assert_allclose(block.with_strength(given_values).bonds.strength, values, rtol=1e-7)
    twice = block.with_strength(values).with_strength(values)
    np.testing.assert_allclose(twice.bonds.strength, values**2)
    assert twice.report["scatter"] == {"distribution": "given", "least": 0.5, "largest": 1.5}
    assert (block.bonds.strength == 1.0).all()


def sloping() -> tuple[Iceberg, xr.DataArray]:
    """A berg of 30 km x 12 km, and a strength that rises by 1 per degree of longitude, 0.25 per degree of latitude."""
    berg = Iceberg.rectangle(30e3, 12e3, thickness=100.0, placement=(10.0, -60.0))
    lon, lat = np.linspace(9.5, 10.5, 21), np.linspace(-60.2, -59.8, 9)
    values = 1.0 + (lon[None] - 10.0) + 0.25 * (lat[:, None] + 60.0)
    return berg, xr.DataArray(values, coords={"lat": lat, "lon": lon}, dims=("lat", "lon"), name="strength")


def test_a_map_of_strength_is_read_at_the_middles_of_the_bonds(tmp_path):
    berg, field = sloping()
    field.to_netcdf(tmp_path / "strength.nc")
    i, j = berg.bonds.first, berg.bonds.second
    lon, lat = (0.5 * (a[i] + a[j]) for a in (berg.elements.lon, berg.elements.lat))
    for source in (field, tmp_path / "strength.nc", str(tmp_path / "strength.nc")):
        got = berg.with_strength(source).bonds.strength
        np.testing.assert_allclose(got, 1.0 + (lon - 10.0) + 0.25 * (lat + 60.0), rtol=1e-12)
    with pytest.raises(BergError, match=r"no strength for \d+ of \d+ bonds, the first at 10"):
        berg.with_strength(field.where(field.lon < 10))
    with pytest.raises(BergError, match="are not positive numbers"):
        berg.with_strength(field - 1.0)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ([1.0, 2.0], r"values of shape \(2,\) for 38 bonds"),
        (0.5, r"values of shape \(\) for 38 bonds"),
        (np.full(38, 0.0), "strength, bond 0: strength 0 .38 of 38"),
        (np.r_[np.ones(37), np.nan], "strength, bond 37: strength nan .1 of 38"),
        (np.r_[np.inf, np.ones(37)], "strength inf"),
        (np.r_[np.ones(37), -1.0], "strength -1"),
        (["a", "b"], "one per bond"),
        ({"a": 1}, "one per bond"),
        (None, "38 bonds"),
        ("strong.nc", r"strong\.nc: file not found"),
    ],
)
def test_impossible_given_strengths_are_refused(block, values, match):
    with pytest.raises(BergError, match=match):
        block.with_strength(values)


def test_given_strengths_take_no_seed(block):
    with pytest.raises(BergError, match="belong to a distribution"):
        block.with_strength(np.ones(38), seed=1)


def test_a_rift_mask_may_be_a_file(tmp_path):
    berg, field = sloping()
    mask = (abs(field.lon - 10.0) < 0.03) * xr.ones_like(field)
    mask.to_netcdf(tmp_path / "rift.nc")
    one, other = (berg.with_rifts(source, strength=0.2) for source in (mask, tmp_path / "rift.nc"))
    np.testing.assert_array_equal(one.bonds.strength, other.bonds.strength)
    assert (one.bonds.strength == 0.2).sum() >= 4


UPWARD = np.array([(4.0, -1.0), (4.0, 5.0)])  # from one element below the ice
MASK = xr.DataArray(
    np.zeros((41, 41)), {"lat": np.linspace(-20.0, 20.0, 41), "lon": np.linspace(-20.0, 20.0, 41)}, ("lat", "lon")
)


def covering(east: slice, north: slice) -> xr.DataArray:
    """A mask with a rift in a box."""
    mask = MASK.copy()
    mask.loc[{"lon": east, "lat": north}] = 1.0
    return mask


@pytest.mark.parametrize(
    ("rift", "how", "outside"),
    [
        (UPWARD, {"broken": True}, 0.0),
        (UPWARD, {"strength": 0.3}, 0.0),
        ([UPWARD[0] - [0.0, 19.0], UPWARD[1]], {"broken": True}, 0.74),
        ([UPWARD[0] - [0.0, 19.0], UPWARD[1]], {"strength": 0.3}, 0.74),
        ([UPWARD[0] - [0.0, 19.0], UPWARD[1]], {"depth": 0.9, "crevasse_strength": 9e4}, 0.74),
        ([(-20.0, 4.0), (6.0, 4.0), (6.0, -20.0)], {"broken": True}, 0.74),
        ([UPWARD, np.add(UPWARD, [40.0, 0.0])], {"broken": True}, 0.5),
        ([UPWARD, np.add(UPWARD, [3.0, 0.0])], {"broken": True}, 0.0),
        (covering(slice(3.9, 4.1), slice(1.0, 5.0)), {"broken": True}, 0.0),
        (covering(slice(3.9, 4.1), slice(-16.0, 5.0)), {"strength": 0.5}, 0.71),
    ],
)  # fmt: skip
def test_what_of_a_rift_lies_outside_of_the_ice_is_told(block, rift, how, outside):
    """Lines and masks, broken, weakened and cut to a depth; not the end that crosses the outline."""
    cut = block.with_rifts(rift, **how)
    assert cut.report["rifts"][0]["outside"] == pytest.approx(outside, abs=0.04)
    assert ("of it lies outside of the ice" in cut.describe()) is (outside > 0.0)


def test_a_rift_in_a_map_projection_is_held_against_the_ice_where_it_lies(tmp_path):
    rasterio, pyproj = pytest.importorskip("rasterio"), pytest.importorskip("pyproj")
    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, radius=500.0, placement=(-38.0, -70.0))
    x, y = pyproj.Transformer.from_crs(4326, 3031, always_xy=True).transform(-38.0, -70.0)
    values = np.zeros((61, 61), np.uint8)
    values[30, 10:51] = 1  # 40 km along x, as the grid of the projection lies there
    corner = rasterio.Affine(1e3, 0.0, x - 30.5e3, 0.0, -1e3, y + 30.5e3)
    about = {"driver": "GTiff", "width": 61, "height": 61, "count": 1, "dtype": "uint8", "crs": "EPSG:3031"}
    with rasterio.open(tmp_path / "rift.tif", "w", transform=corner, **about) as file:
        file.write(values, 1)
    share = berg.with_rifts(tmp_path / "rift.tif", broken=True).report["rifts"][0]["outside"]
    assert 0.45 < share < 0.8


@pytest.mark.parametrize("broken", ["no", "false", False])
def test_words_for_no_do_not_break_a_rift(block, broken):
    assert (block.with_rifts(UPWARD, broken=broken, strength=0.5).bonds.status == 0).all()


@pytest.mark.parametrize("broken", ["perhaps", 2, None])
def test_what_is_neither_true_nor_false_is_refused(block, broken):
    with pytest.raises(BergError, match=r"broken.*neither true nor false"):
        block.with_rifts(UPWARD, broken=broken)


def test_a_rift_where_all_is_broken_already_is_refused_as_that(block):
    cut = block.with_rifts(UPWARD, broken=True)
    with pytest.raises(BergError, match="crosses only bonds that are broken already"):
        cut.with_rifts(UPWARD, strength=0.5)
