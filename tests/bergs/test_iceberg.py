"""Bergs from masks, tables, points and rectangles; what they weigh and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from riftberg import Iceberg
from riftberg.bergs.bonding import Metric, separations
from riftberg.bergs.raster import read_raster
from riftberg.errors import BergError

OUTLINE = [(-39.5, -55.2), (-38.5, -55.2), (-38.5, -54.9), (-39.5, -54.9)]


def grid(function, west=-40.0, east=-38.0, south=-55.6, north=-54.6, step=0.02, name="h"):
    """Sample a function at the centres of the cells."""
    lon, lat = np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step)
    return xr.DataArray(
        function(*np.meshgrid(lon, lat)), coords={"lat": lat, "lon": lon}, dims=("lat", "lon"), name=name
    )


def test_rectangle_has_the_mass_bonds_and_start_of_theory():
    berg = Iceberg.rectangle(30e3, 15e3, thickness=200.0, velocity=(0.22, -0.1), spin=1e-6, placement=(-39.0, -55.0))
    e = berg.elements
    assert len(e.id) == 50
    assert berg.area == pytest.approx(450e6, rel=1e-12)
    assert berg.mass == pytest.approx(450e6 * 200 * 850, rel=1e-12)
    assert len(berg.bonds.first) == 9 * 5 + 10 * 4
    assert np.bincount(e.bond_count).tolist() == [0, 0, 4, 22, 24]
    assert (e.berg == 1).all()
    assert berg.report["area_error"] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(e.lon, e.lon_pair)
    x, y = separations(Metric(True, berg.earth_radius), e.lon, e.lat, np.full(50, -39.0), np.full(50, -55.0))
    np.testing.assert_allclose(e.u, 0.22 - 1e-6 * y, atol=1e-4)  # with its spin about its centre, in local axes
    np.testing.assert_allclose(e.v, -0.1 + 1e-6 * x, atol=1e-4)
    np.testing.assert_array_equal(e.u_pair, e.u)
    np.testing.assert_array_equal(e.v_sync, e.v)
    assert (e.spin == 1e-6).all()


def test_interior_elements_of_a_hexagonal_berg_have_six_bonds():
    berg = Iceberg.rectangle(30e3, 30e3, thickness=200.0, packing="hexagonal", placement=(-39.0, -55.0))
    assert berg.elements.bond_count.max() == 6
    assert berg.area == pytest.approx(900e6, rel=0.03)


def test_cartesian_rectangle_stands_where_it_is_put():
    berg = Iceberg.rectangle(5.0, 1.0, thickness=1.0, radius=0.5, placement=(100.0, 50.0), latlon=False)
    np.testing.assert_allclose(berg.elements.lon, 100 + np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), atol=1e-12)
    np.testing.assert_allclose(berg.elements.lat, 50.0, atol=1e-12)
    assert berg.initial_strain == pytest.approx(0.0, abs=1e-12)


def test_points_stay_where_they_are():
    x = 101000 + 5000.0 * np.arange(4)
    berg = Iceberg.from_points(
        x, np.full(4, 146e3), thickness=1.0, radius=2500.0, density=900.0, latlon=False, static=[1, 0, 0, 0]
    )
    np.testing.assert_array_equal(berg.elements.lon, x)
    assert berg.elements.static.tolist() == [1, 0, 0, 0]
    assert berg.elements.mass.tolist() == [2.25e10] * 4
    assert len(berg.bonds.first) == 3


def test_bonds_by_length_and_across_a_period():
    x = np.array([500.0, 2500.0, 19500.0])
    made = {"thickness": 1.0, "radius": 500.0, "latlon": False}
    assert len(Iceberg.from_points(x, np.zeros(3), **made).bonds.first) == 0
    assert len(Iceberg.from_points(x, np.zeros(3), bond_length=2100.0, **made).bonds.first) == 1
    berg = Iceberg.from_points(x, np.zeros(3), period=20000.0, **made)
    assert list(zip(berg.bonds.first, berg.bonds.second, strict=True)) == [(0, 2)]


def test_makeberg_rules_give_the_elements_of_the_published_run(shared):
    """Spec 10.5: the 472 elements of icebergs.res.nc, to the last digit."""
    netcdf = pytest.importorskip("netCDF4")
    folder = shared / "data" / "a68a"
    berg = Iceberg.from_mask(
        folder / "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc", variable="b_id", rules="makeberg",
        reference_latitude=-55.2, shift=(0.0, -0.1), thickness=200.0, velocity=(0.22, 0.0),
    )  # fmt: skip
    with netcdf.Dataset(folder / "icebergs.res.nc") as file:
        file.set_auto_mask(False)
        lon, lat, mass, width = (file[name][:] for name in ("lon", "lat", "mass", "width"))
    assert len(berg.elements.id) == len(lon) == 472
    metres = np.hypot(*separations(Metric(True, berg.earth_radius), berg.elements.lon, berg.elements.lat, lon, lat))
    print(f"largest difference from the published elements: {metres.max():.3g} m")
    assert metres.max() < 1e-6
    np.testing.assert_allclose(berg.elements.mass, mass, rtol=1e-15)
    np.testing.assert_allclose(berg.elements.width, width, rtol=1e-15)
    assert len(berg.bonds.first) == 874
    assert berg.initial_strain * 3000 > 1.0  # the sheared columns of equations 10.5


def test_observed_mask_is_filled_with_its_own_area(shared):
    path = shared / "data" / "a68a" / "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc"
    for packing in ("square", "hexagonal"):
        berg = Iceberg.from_mask(path, thickness=200.0, packing=packing)
        assert berg.report["outline_area"] == pytest.approx(4215e6, rel=0.01)
        assert abs(berg.report["area_error"]) < 0.01
        assert abs(berg.initial_strain) < 1e-5


@pytest.mark.parametrize("conformal", [True, False])
def test_mask_and_outline_of_the_same_box_agree(conformal):
    pytest.importorskip("shapely")
    mask = grid(lambda lon, lat: ((abs(lon + 39) < 0.5) & (abs(lat + 55.05) < 0.15)).astype(float))
    made = {"thickness": 200.0, "conformal": conformal, "radius": 1000.0}
    from_mask, from_outline = Iceberg.from_mask(mask, **made), Iceberg.from_outline(OUTLINE, **made)
    assert from_mask.area == pytest.approx(from_outline.area, rel=0.03)
    assert from_mask.centroid == pytest.approx(from_outline.centroid, abs=0.01)


def test_descending_latitude_and_360_longitudes_make_no_difference():
    mask = grid(lambda lon, lat: ((abs(lon + 39) < 0.5) & (abs(lat + 55.05) < 0.15)).astype(float))
    turned = mask.isel(lat=slice(None, None, -1)).T.assign_coords(lon=mask.lon + 360)
    one, other = (Iceberg.from_mask(m, thickness=200.0) for m in (mask, turned))
    np.testing.assert_allclose(other.elements.lon - 360, one.elements.lon, atol=1e-9)
    np.testing.assert_allclose(other.elements.lat, one.elements.lat, atol=1e-9)


def test_gridded_thickness_is_mask_and_thickness_in_one():
    wedge = grid(
        lambda lon, lat: np.where((abs(lon + 39) < 0.5) & (abs(lat + 55) < 0.2), 250 + 50 * (lon + 39), np.nan)
    )
    berg = Iceberg.from_mask(wedge)
    expected = 250 + 50 * (berg.elements.lon + 39)
    inner = abs(berg.elements.lon + 39) < 0.45
    np.testing.assert_allclose(berg.elements.thickness[inner], expected[inner], atol=0.1)
    assert berg.mass == pytest.approx(850 * (berg.elements.thickness * berg.elements.length**2).sum(), rel=1e-12)


def test_thickness_raster_is_sampled_where_the_outline_was_drawn():
    pytest.importorskip("shapely")
    heights = grid(lambda lon, lat: 200 + 100 * (lon + 39))
    still = Iceberg.from_outline(OUTLINE, thickness=heights)
    np.testing.assert_allclose(still.elements.thickness, 200 + 100 * (still.elements.lon + 39), atol=1e-3)
    moved = Iceberg.from_outline(OUTLINE, thickness=heights, placement=(20.0, -60.0), rotation=90.0)
    np.testing.assert_array_equal(moved.elements.thickness, still.elements.thickness)
    assert moved.centroid == pytest.approx((20.0, -60.0), abs=0.05)
    # Its eastern, thick end now points north.
    assert moved.elements.lat[np.argmax(moved.elements.thickness)] > -60.0 + 0.2


def test_shift_moves_by_degrees():
    pytest.importorskip("shapely")
    here, there = (Iceberg.from_outline(OUTLINE, thickness=200.0, shift=s) for s in ((0.0, 0.0), (1.0, 0.5)))
    np.testing.assert_allclose(np.subtract(there.centroid, here.centroid), [1.0, 0.5], atol=2e-3)


@pytest.mark.parametrize(
    ("thickness", "match"), [(0.0, "thickness 0 m"), (-5.0, "thickness -5 m"), (np.nan, "thickness nan")]
)
def test_impossible_thickness_is_refused(thickness, match):
    with pytest.raises(BergError, match=match):
        Iceberg.rectangle(30e3, 15e3, thickness=thickness)


def test_thickness_map_with_a_gap_is_refused_with_the_place():
    pytest.importorskip("shapely")
    heights = grid(lambda lon, lat: np.where(lon < -39.0, 200.0, np.nan))
    with pytest.raises(BergError, match=r"no thickness for \d+ of \d+ elements, the first at -3"):
        Iceberg.from_outline(OUTLINE, thickness=heights)


def test_overlapping_elements_are_refused_with_their_numbers():
    with pytest.raises(BergError, match="elements 2 and 3 overlap: 2900 m apart instead of 3000 m"):
        Iceberg.from_points([0.0, 3000.0, 5900.0], np.zeros(3), thickness=200.0, latlon=False)


def test_overlap_is_found_even_where_no_bond_reaches():
    with pytest.raises(BergError, match="overlap"):
        Iceberg.from_points([0.0, 500.0], np.zeros(2), thickness=200.0, latlon=False, bond_length=100.0)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"density": 1100.0}, "density: .* is not possible.*Allowed: a number > 0 and < 1025, in kg m-3"),
        ({"lat": [0.0, 0.0, 0.0]}, "equal length"),
        ({"lon": [0.0, np.inf]}, "not numbers"),
        ({"lat": [0.0, 89.5]}, "within 89"),
        ({"radius": -1.0}, "radius: .* is not possible.*Allowed: a number > 0 and <= 1e\\+06, in m"),
        ({"lon": [], "lat": []}, "no elements"),
        ({"lon": [], "lat": [], "length": 1000.0, "width": 500.0}, "no elements"),
    ],
)
def test_impossible_points_are_refused(changes, match):
    with pytest.raises(BergError, match=match):
        Iceberg.from_points(**{"lon": [0.0, 1.0], "lat": [0.0, 1.0], "thickness": 1.0, **changes})


def test_masks_that_cannot_be_used_are_refused(tmp_path):
    with pytest.raises(BergError, match="file not found"):
        Iceberg.from_mask(tmp_path / "none.nc", thickness=200.0)
    empty = grid(lambda lon, lat: 0 * lon)
    with pytest.raises(BergError, match=r"no value above 0\.5"):
        Iceberg.from_mask(empty, thickness=200.0)
    both = xr.Dataset({"a": empty, "b": empty})
    with pytest.raises(BergError, match="a, b"):
        Iceberg.from_mask(both, thickness=200.0)
    with pytest.raises(BergError, match="2 dates"):
        Iceberg.from_mask(xr.concat([empty, empty], dim="time"), thickness=200.0)
    with pytest.raises(BergError, match="one-dimensional longitude"):
        Iceberg.from_mask(empty.rename(lon="column"), thickness=200.0)


def test_description_names_size_place_and_strain():
    text = Iceberg.rectangle(30e3, 15e3, thickness=200.0, placement=(-39.0, 0.0)).describe()
    for part in (
        "50 square",
        "450 km2",
        "76.5 Gt",
        "draft 165.9 m",
        "30 km x 15 km",
        "85 (0 removed",
        "pieces: 1",
        "strain",
    ):
        assert part in text


def test_separate_pieces_are_counted():
    berg = Iceberg.from_points([0.0, 3000.0, 9000.0], np.zeros(3), thickness=200.0, latlon=False)
    assert berg.elements.berg.tolist() == [1, 1, 2]
    assert "pieces: 2" in berg.describe()


def slab(value: float, outside: float, step: float = 0.02) -> xr.DataArray:
    """A box of ice, ``outside`` around it."""
    return grid(
        lambda lon, lat: np.where((abs(lon + 39) < 0.5) & (abs(lat + 55) < 0.3), value, outside), step=step, name="h"
    )


@pytest.mark.parametrize("outside", [0.0, np.nan])
def test_a_gridded_slab_is_not_thinned_at_its_rim(outside):
    """Bilinear means with the nothing around made a slab of 200 m as thin as 117 m at its rim."""
    slab_of, plain = slab(200.0, outside), slab(1.0, outside)
    berg = Iceberg.from_mask(slab_of)
    np.testing.assert_allclose(berg.elements.thickness, 200.0, rtol=1e-12)
    as_mask = Iceberg.from_mask(plain, thickness=200.0)
    np.testing.assert_array_equal(berg.elements.lon, as_mask.elements.lon)
    np.testing.assert_array_equal(berg.elements.lat, as_mask.elements.lat)


def test_thickness_at_the_edge_of_a_mask_is_that_of_the_ice_beside():
    mask, heights = slab(1.0, 0.0), slab(1.0, 0.0) * (250 + 50 * (slab(1.0, 0.0).lon + 39))
    berg = Iceberg.from_mask(mask, thickness=heights)
    expected = 250 + 50 * (berg.elements.lon + 39)
    # A point beyond the last column of ice has the value of that column, at most half a cell (0.5 m) away.
    assert np.abs(berg.elements.thickness - expected).max() < 0.51
    assert np.median(np.abs(berg.elements.thickness - expected)) < 1e-3


@pytest.mark.parametrize("outside", [0.0, np.nan, -9999.0])
def test_a_thickness_map_that_ends_at_the_outline_leaves_the_rim_whole(outside):
    pytest.importorskip("shapely")
    box = [(-39.5, -55.3), (-38.5, -55.3), (-38.5, -54.7), (-39.5, -54.7)]
    berg = Iceberg.from_outline(box, thickness=slab(200.0, outside))
    np.testing.assert_allclose(berg.elements.thickness, 200.0, rtol=1e-12)
    far = [(-39.8, -55.3), (-38.5, -55.3), (-38.5, -54.7), (-39.8, -54.7)]
    with pytest.raises(BergError, match=r"no thickness for \d+ of \d+ elements, the first at -39"):
        Iceberg.from_outline(far, thickness=slab(200.0, outside))


@pytest.mark.quick(2)
@pytest.mark.parametrize("outside", [0.0, np.nan])
@pytest.mark.parametrize("value", [1.0, 7.0, 200.0])
def test_ice_of_a_mask_ends_half_way_to_the_cells_without(value, outside):
    """Whatever number stands for ice, the berg is that of ones and noughts."""
    berg = Iceberg.from_mask(slab(value, outside), thickness=200.0, radius=400.0, conformal=False)
    plain = Iceberg.from_mask(slab(1.0, 0.0), thickness=200.0, radius=400.0, conformal=False)
    np.testing.assert_array_equal(berg.elements.lon, plain.elements.lon)
    assert np.abs(berg.elements.lat + 55).max() < 0.3


def boxes(gap: float) -> list[tuple[float, float, float, float]]:
    """Bounds (degrees) of two boxes of 30 km x 33 km with a gap (m) between them."""
    metre = 1.0 / (np.radians(1.0) * 6371e3 * np.cos(np.radians(55.75)))
    middle = -38 + 30e3 * metre
    return [(-38, -56, middle, -55.7), (middle + gap * metre, -56, middle + (30e3 + gap) * metre, -55.7)]


@pytest.mark.quick(3)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("gap", [300.0, 1000.0, 1500.0, 2000.0, 3000.0, 4000.0])
def test_pieces_of_an_outline_are_not_bonded_to_each_other(gap, packing):
    """How wide the gap is must not matter, nor where the lattice happens to lie."""
    shapely = pytest.importorskip("shapely")
    outline = shapely.MultiPolygon([shapely.box(*bounds) for bounds in boxes(gap)])
    berg = Iceberg.from_outline(outline, thickness=200.0, packing=packing)
    middle = 0.5 * (boxes(gap)[0][2] + boxes(gap)[1][0])
    west = berg.elements.lon < middle
    assert (west[berg.bonds.first] == west[berg.bonds.second]).all()
    assert berg.elements.berg.max() == 2
    np.testing.assert_array_equal(west, west[0] == (berg.elements.berg == berg.elements.berg[0]))
    assert (berg.report["outline_pieces"], abs(berg.report["area_error"]) < 0.02) == (2, True)
    assert "pieces: 2, not bonded to each other" in berg.describe()
    assert np.array_equal(np.bincount(np.r_[berg.bonds.first, berg.bonds.second]), berg.elements.bond_count)


@pytest.mark.parametrize("height", [1.0, 200.0])
def test_separate_regions_of_a_mask_are_not_bonded_to_each_other(height):
    """One column of water, 0.64 km, parts them; without it they are one."""
    made = {"thickness": 200.0} if height == 1.0 else {}
    whole = slab(height, 0.0, step=0.01)
    cut = whole.where(abs(whole.lon + 39.005) > 0.004, 0.0)
    berg = Iceberg.from_mask(cut, **made)
    west = berg.elements.lon < -39.005
    assert (west[berg.bonds.first] == west[berg.bonds.second]).all()
    assert (berg.elements.berg.max(), berg.report["outline_pieces"]) == (2, 2)
    assert Iceberg.from_mask(whole, **made).elements.berg.max() == 1


def test_regions_that_touch_at_a_corner_are_separate():
    mask = grid(lambda lon, lat: (((lon < -39) & (lat < -55)) | ((lon > -39) & (lat > -55))).astype(float), step=0.05)
    mask = mask.where((abs(mask.lon + 39) < 0.4) & (abs(mask.lat + 55) < 0.3), 0.0)
    berg = Iceberg.from_mask(mask, thickness=200.0)
    assert (berg.elements.berg.max(), berg.report["outline_pieces"]) == (2, 2)
    assert len(set(berg.elements.berg[berg.elements.lat < -55])) == 1


def test_pieces_too_small_for_an_element_are_told():
    shapely = pytest.importorskip("shapely")
    outline = shapely.MultiPolygon([shapely.box(-38, -56, -37, -55.7), shapely.box(-36.5, -56, -36.499, -55.999)])
    text = Iceberg.from_outline(outline, thickness=200.0).describe()
    assert "pieces: 1 (the outline has 2)" in text


@pytest.mark.slow
def test_a_mask_across_greenwich_or_the_date_line_is_joined():
    """Longitudes from 0 to 360, as a whole circle or cropped to both of its ends, or from -180 to 180."""
    here = grid(
        lambda lon, lat: ((abs(lon) < 0.5) & (abs(lat + 60) < 0.3)).astype(float), west=-2, east=2, south=-61, north=-59
    )
    plain = Iceberg.from_mask(here, thickness=200.0)
    cropped = here.assign_coords(lon=here.lon % 360).sortby("lon")
    lon = np.arange(0.01, 360, 0.02)
    circle = here.assign_coords(lon=np.round(here.lon % 360, 6)).reindex(lon=np.round(lon, 6), fill_value=0.0)
    twice = xr.concat([circle, circle.isel(lon=[0]).assign_coords(lon=[360.01])], "lon")
    for mask in (cropped, circle, twice):
        berg = Iceberg.from_mask(mask, thickness=200.0)
        np.testing.assert_allclose(berg.elements.lon, plain.elements.lon, atol=1e-9)
        thick = Iceberg.from_mask(mask * 200.0)
        np.testing.assert_allclose(thick.elements.thickness, 200.0)
        assert len(thick.elements.id) == len(plain.elements.id)
    east = here.assign_coords(lon=(here.lon + 360) % 360 - 180).sortby("lon")
    berg = Iceberg.from_mask(east, thickness=200.0)
    np.testing.assert_allclose(berg.elements.lon + 180, plain.elements.lon, atol=1e-9)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "thickness", [200, np.float32(200), np.int64(200), np.array(200.0), [200.0], (200,), "200 m", "0.2 km"]
)
def test_thickness_may_be_a_number_of_any_kind(thickness):
    """Bug: "200 m" was looked for as a file by outlines and masks."""
    pytest.importorskip("shapely")
    for berg in (
        Iceberg.from_outline(OUTLINE, thickness=thickness),
        Iceberg.rectangle(30e3, 12e3, thickness=thickness, placement=(-39.0, -55.0)),
        Iceberg.from_mask(slab(1.0, 0.0), thickness=thickness),
        Iceberg.from_mask(slab(1.0, 0.0), thickness=thickness, rules="makeberg"),
    ):
        assert (berg.elements.thickness == 200.0).all()


@pytest.mark.parametrize("thickness", [[200.0, 210.0], np.full((4, 5), 200.0), "thick", {"a": 1}, None, [[1], [2, 3]]])
def test_thickness_that_is_neither_number_nor_map_is_refused(thickness):
    pytest.importorskip("shapely")
    with pytest.raises(BergError, match=r"thickness|file not found|kind of file"):
        Iceberg.from_outline(OUTLINE, thickness=thickness)


def test_thickness_may_be_a_list_with_one_number_per_element():
    pytest.importorskip("shapely")
    count = len(Iceberg.from_outline(OUTLINE, thickness=200.0).elements.id)
    given = [200.0 + k for k in range(count)]
    np.testing.assert_array_equal(Iceberg.from_outline(OUTLINE, thickness=given).elements.thickness, given)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda **o: Iceberg.rectangle(9e3, 9e3, thickness=200.0, **o), "rotaton"),
        (lambda **o: Iceberg.rectangle(9e3, 9e3, thickness=200.0, **o), "shift"),
        (lambda **o: Iceberg.from_points([0.0], [0.0], thickness=200.0, **o), "rotation"),
        (lambda **o: Iceberg.from_table([(0, 0, 1)], thickness=200.0, placement=(0.0, 0.0), **o), "shift"),
        (lambda **o: Iceberg.from_outline(np.zeros((4, 2)), thickness=200.0, **o), "latlon"),
    ],
)
def test_an_option_that_a_constructor_does_not_take_is_refused(make, name):
    with pytest.raises(TypeError, match=f"unexpected keyword argument '{name}'"):
        make(**{name: 1.0})


@pytest.mark.parametrize("offset", [(3.0, 0.0), (0.0, 1.05), (0.0, -0.5), (float("nan"), 0.0), (-39.3, -55.5), 0.5])
def test_a_lattice_is_shifted_by_at_most_one_pitch(offset):
    """A shift by three pitches left 9 km of the outline empty without a word; one in metres or degrees all of it."""
    with pytest.raises(BergError, match="offset"):
        Iceberg.rectangle(30e3, 15e3, thickness=200.0, offset=offset)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
def test_a_shift_by_a_whole_pitch_is_none(offset):
    here, there = (Iceberg.rectangle(30e3, 15e3, thickness=200.0, offset=o).elements for o in (offset, (0.0, 0.0)))
    np.testing.assert_array_equal(here.lon, there.lon)
    np.testing.assert_array_equal(here.lat, there.lat)


@pytest.mark.parametrize(
    ("velocity", "fault"), [((1000.0, 0.0), "10 m s-1"), ((0.1,), "missing"), ((0.1, 0.2, 0.3), "2 numbers")]
)
def test_a_velocity_is_two_numbers_that_ice_can_have(velocity, fault):
    with pytest.raises(BergError, match=f"velocity.*{fault}"):
        Iceberg.rectangle(30e3, 15e3, thickness=200.0, velocity=velocity)


def test_description_gives_the_range_of_a_thickness_that_varies():
    x = 3000.0 * np.arange(3)
    berg = Iceberg.from_points(x, np.zeros(3), thickness=[100.0, 150.0, 200.0], density=820.0, latlon=False)
    draft = [0.8 * h for h in (100.0, 200.0)]
    assert (
        f"thickness: 100.0 to 200.0 m, draft {draft[0]:.1f} to {draft[1]:.1f} m, freeboard 20.0 to 40.0 m"
        in berg.describe()
    )


def test_elements_on_both_sides_of_the_date_line_are_bonded() -> None:
    """A row of points at 180 degrees had a gap there: four bonds and two pieces."""
    lon = 180.0 + 3000.0 / (111194.9 * np.cos(np.radians(75.0))) * (np.arange(6) - 2.5)
    row = Iceberg.from_points((lon + 180.0) % 360.0 - 180.0, np.full(6, -75.0), thickness=200.0, radius=1500.0)
    assert row.bonds.first.size == 5
    with pytest.raises(BergError, match="overlap"):
        Iceberg.from_points([179.7, -180.3], [-75.0, -75.0], thickness=200.0, radius=1500.0)


def test_a_map_of_another_year_is_not_taken_for_the_date_asked_for(tmp_path) -> None:
    """The nearest date was taken, however far: 1995 gave the map of 2020."""
    days = np.array(["2020-12-01", "2020-12-15"], "datetime64[ns]")
    thickness = xr.DataArray(
        np.full((2, 5, 5), 200.0), dims=("time", "lat", "lon"),
        coords={"time": days, "lat": np.linspace(-56.2, -56.0, 5), "lon": np.linspace(-37.2, -37.0, 5)}, name="h",
    )  # fmt: skip
    thickness.to_netcdf(tmp_path / "h.nc")
    assert read_raster(tmp_path / "h.nc", date="2020-12-15").values.shape == (5, 5)
    with pytest.raises(BergError, match=r"within a day of one of its dates, 2020-12-01 to 2020-12-15"):
        read_raster(tmp_path / "h.nc", date="1995-01-01")
