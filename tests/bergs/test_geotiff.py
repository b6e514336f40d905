"""GeoTIFF masks and thickness maps, in degrees and in polar stereographic coordinates."""

from __future__ import annotations

import re
import sys
import warnings

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.bergs.raster import read_raster
from riftberg.errors import BergError, RiftbergError

rasterio = pytest.importorskip("rasterio")
pyproj = pytest.importorskip("pyproj")

POLAR = "EPSG:3031"
CELL = 500.0


def write(path, values, west, north, step, crs=POLAR, nodata=None, names=()):
    """Write bands of rows from north to south, as GeoTIFF files have them."""
    bands = np.atleast_3d(values).reshape(-1, *np.shape(values)[-2:])
    transform = rasterio.Affine(step, 0.0, west, 0.0, -step, north) if step else None
    with rasterio.open(
        path, "w", driver="GTiff", width=bands.shape[2], height=bands.shape[1], count=len(bands), dtype="float32",
        crs=crs, transform=transform, nodata=nodata,
    ) as file:  # fmt: skip
        file.write(bands.astype("float32"))
        for number, name in enumerate(names, start=1):
            file.set_band_description(number, name)
    return path


@pytest.fixture
def box():
    """Edges and centres x (m) of 120 by 80 cells of 500 m in polar stereographic coordinates, and a box of 40 km x 20 km."""
    x, y = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True).transform(-45.0, -65.0)
    west, north = x - 60 * CELL, y + 40 * CELL
    cx, cy = np.meshgrid(west + CELL * (np.arange(120) + 0.5), north - CELL * (np.arange(80) + 0.5))
    return west, north, cx, (abs(cx - x) < 20e3) & (abs(cy - y) < 10e3)


def true_area() -> float:
    """Area (m2) of the box on the model's sphere: the projection stretches lengths, by k at 65 S."""
    k = pyproj.Proj(POLAR).get_factors(-45.0, -65.0).areal_scale
    ellipsoid = pyproj.CRS(POLAR).ellipsoid
    sine = np.sin(np.radians(65.0))
    e2 = 1 - (ellipsoid.semi_minor_metre / ellipsoid.semi_major_metre) ** 2
    local = ellipsoid.semi_major_metre**2 * (1 - e2) / (1 - e2 * sine**2) ** 2  # product of the radii of curvature
    return 40e3 * 20e3 / k * Iceberg.from_points([0.0], [0.0], thickness=1.0).earth_radius ** 2 / local


@pytest.mark.parametrize("nodata", [None, 0.0])
def test_a_projected_mask_gives_the_berg_of_its_outline(tmp_path, box, nodata):
    west, north, _, there = box
    path = write(tmp_path / "mask.tif", there, west, north, CELL, nodata=nodata)
    berg = Iceberg.from_mask(path, thickness=200.0, radius=1000.0)
    assert berg.report["outline_area"] == pytest.approx(true_area(), rel=5e-4)
    assert berg.area == pytest.approx(berg.report["outline_area"], rel=1e-12)
    # The centre of the elements is that of the outline to a quarter of an element.
    assert berg.centroid == pytest.approx((-45.0, -65.0), abs=4.5e-3)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True).transform(-45.0, -65.0)
    corners = [(x + a * 20e3, y + b * 10e3) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    outline = Iceberg.from_outline(corners, thickness=200.0, radius=1000.0, crs=POLAR)
    assert berg.area == pytest.approx(outline.area, rel=0.02)
    assert berg.centroid == pytest.approx(outline.centroid, abs=4.5e-3)
    # At 45 W the projection's x axis points to the south-east.
    azimuths = [float(re.findall(r"long axis (\d+) degrees from north", b.describe())[0]) for b in (berg, outline)]
    assert azimuths == pytest.approx([135.0, 135.0], abs=2.0)


def test_a_projected_thickness_is_sampled_where_it_lies(tmp_path, box):
    west, north, cx, there = box
    heights = np.where(there, 250 + 2e-3 * (cx - cx.mean()), 0.0)
    path = write(tmp_path / "thickness.tif", heights, west, north, CELL)
    outline = Iceberg.from_mask(write(tmp_path / "mask.tif", there, west, north, CELL), thickness=path, radius=1000.0)
    to_polar = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True)
    for berg in (Iceberg.from_mask(path, radius=1000.0), outline):
        x, _ = to_polar.transform(berg.elements.lon, berg.elements.lat)
        # Beyond the last column of ice its value is held; half a diagonal of a cell more, where cells lie askew.
        np.testing.assert_allclose(berg.elements.thickness, 250 + 2e-3 * (x - cx.mean()), atol=0.75)


def test_a_projected_mask_across_the_date_line(tmp_path):
    there = np.zeros((80, 120), bool)
    there[20:60, 20:100] = True
    x, y = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True).transform(180.0, -70.0)
    path = write(tmp_path / "mask.tif", there, x - 60 * CELL, y + 40 * CELL, CELL)
    berg = Iceberg.from_mask(path, thickness=200.0)
    assert berg.centroid[0] % 360 == pytest.approx(180.0, abs=5e-3)
    assert np.ptp(berg.elements.lon) < 1.2
    assert berg.elements.berg.max() == 1


def test_a_geotiff_in_degrees_is_the_grid_that_it_holds(tmp_path):
    values = np.zeros((50, 100))
    values[10:40, 20:80] = 1.0
    path = write(tmp_path / "mask.TIF", values, -40.0, -54.5, 0.02, crs="EPSG:4326")
    raster = read_raster(path)
    assert raster.crs is None
    np.testing.assert_allclose(raster.lon, -40 + 0.02 * (np.arange(100) + 0.5))
    np.testing.assert_allclose(raster.lat, -55.5 + 0.02 * (np.arange(50) + 0.5))
    np.testing.assert_array_equal(raster.values, values[::-1])
    berg = Iceberg.from_mask(path, thickness=200.0)
    assert berg.centroid == pytest.approx((-39.0, -55.0), abs=0.01)


@pytest.mark.parametrize("beyond", [0.5, 0.52])
def test_a_grid_may_end_half_a_cell_beyond_a_pole(tmp_path, beyond):
    """The last row of cells of one degree has its middle at the pole or half a cell beyond it, not farther."""
    path = write(tmp_path / "mask.tif", np.ones((5, 10)), 0.0, 90.5 + beyond, 1.0, crs="EPSG:4326")
    if beyond == 0.5:
        assert Iceberg.from_mask(path, thickness=200.0, radius=60e3).elements.size > 0
    else:
        with pytest.raises(BergError, match=r"latitude 90\.52 is beyond the globe"):
            Iceberg.from_mask(path, thickness=200.0)


@pytest.mark.parametrize(
    ("west", "north", "named"), [(-40.0, -154.5, "latitude -15"), (1000.0, -54.5, "longitude 100")]
)
def test_a_mask_beyond_the_globe_is_refused(tmp_path, west, north, named):
    """An area below zero met the square root in the advice on a smaller radius."""
    path = write(tmp_path / "mask.tif", np.ones((50, 100)), west, north, 0.02, crs="EPSG:4326")
    with pytest.raises(RiftbergError, match=rf"mask\.tif.*{named}.* is beyond the globe"):
        Iceberg.from_mask(path, thickness=200.0)


def test_bands_are_chosen_by_number_or_description(tmp_path):
    bands = np.stack([np.full((4, 5), 1.0), np.full((4, 5), 2.0)])
    path = write(tmp_path / "two.tif", bands, -40.0, -54.5, 0.1, crs="EPSG:4326", names=("mask", "height"))
    assert (read_raster(path, "2").values == 2).all()
    assert (read_raster(path, "height").values == 2).all()
    with pytest.raises(BergError, match=r"no band None.*1, 2, mask, height"):
        read_raster(path)
    with pytest.raises(BergError, match="has no dates"):
        read_raster(path, "1", date="2020-12-09")


def test_geotiff_files_that_cannot_be_used_are_refused(tmp_path, box):
    west, north, _, there = box
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        bare = write(tmp_path / "bare.tif", there, 0, 0, None, crs=None)
    with pytest.raises(BergError, match="no coordinates"):
        read_raster(bare)
    (tmp_path / "text.tif").write_text("no picture")
    with pytest.raises(BergError, match="not a GeoTIFF"):
        read_raster(tmp_path / "text.tif")
    (tmp_path / "text.nc").write_text("no grid")
    with pytest.raises(BergError, match=r"text\.nc: not a grid"):
        read_raster(tmp_path / "text.nc")
    path = write(tmp_path / "mask.tif", there, west, north, CELL)
    with pytest.raises(BergError, match="makeberg"):
        Iceberg.from_mask(path, thickness=200.0, rules="makeberg")


def test_the_missing_extra_is_named(tmp_path, box, monkeypatch):
    west, north, _, there = box
    path = write(tmp_path / "mask.tif", there, west, north, CELL)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(RiftbergError, match=r"GeoTIFF files need it: pip install 'riftberg\[geotiff\]'"):
        read_raster(path)
