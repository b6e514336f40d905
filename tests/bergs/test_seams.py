"""Outlines cut at a meridian or at the edge of a tile are one shape, whatever they come from; bergs that touch stay two."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from shapely.affinity import rotate, translate
from shapely.geometry import mapping
from shapely.ops import split

from riftberg import Iceberg, IceShelf, read_observed
from riftberg.bergs.outline import read_features
from riftberg.bergs.seams import join_polygons, shrink
from riftberg.errors import BergError, InputError

METRE = 360.0 / 4.003e7


def cut(middle: float, seam: float, *, bend: float = 0.0) -> tuple[Any, list[Any]]:
    """Return a berg of 60 by 20 km at 65 S and its parts west and east of a meridian, as programs write them."""
    west, east = middle - 0.64, middle + 0.64
    whole = shapely.Polygon([(west, -65.09), (middle, -65.09 - bend), (east, -65.09), (east, -64.91), (west, -64.91)])
    parts = [whole.intersection(shapely.box(seam + a, -80.0, seam + b, 0.0)) for a, b in ((-9.0, 0.0), (0.0, 9.0))]
    around = [shapely.transform(p, lambda c: c - [360.0 * np.round(c[:, 0].mean() / 360.0), 0.0]) for p in parts]
    return whole, around


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": mapping(geometry)}


def geojson(path: Path, *features: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
    return path


def kml(path: Path, parts: list[Any]) -> Path:
    drawn = ""
    for part in parts:
        text = " ".join(f"{x:.7f},{y:.7f},0" for x, y in part.exterior.coords)
        ring = f"<LinearRing><coordinates>{text}</coordinates></LinearRing>"
        drawn += f"<Polygon><outerBoundaryIs>{ring}</outerBoundaryIs></Polygon>"
    mark = f"<Placemark><name>C1 2020-12-05</name><MultiGeometry>{drawn}</MultiGeometry></Placemark>"
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{mark}</Document></kml>')
    return path


def shapefile(path: Path, parts: list[Any]) -> Path:
    with pytest.importorskip("shapefile").Writer(str(path)) as writer:
        writer.field("date", "C", 20)
        writer.poly([list(shapely.geometry.polygon.orient(part, -1.0).exterior.coords) for part in parts])
        writer.record("2020-12-05")
    return path


def table(path: Path, parts: list[Any]) -> Path:
    rows = ["date,berg,part,vertex,lon,lat"]
    for name, part in zip("we", parts, strict=True):
        rows += [f"2020-12-05,C1,{name},{k},{x},{y}" for k, (x, y) in enumerate(part.exterior.coords[:-1])]
    path.write_text("\n".join(rows))
    return path


FORMS = {
    "o.geojson": lambda path, parts: geojson(path, feature(shapely.MultiPolygon(parts), date="2020-12-05", berg="C1")),
    "o.kml": kml,
    "o.shp": shapefile,
    "o.csv": table,
}


@pytest.mark.parametrize("seam", [180.0, 0.0, -40.0])
@pytest.mark.parametrize("name", FORMS)
def test_an_outline_cut_at_a_meridian_is_one_shape_in_every_format(name: str, seam: float, tmp_path: Path) -> None:
    """Bug: half of a berg became a berg of its own that collided with the other, or half an observation."""
    whole, parts = cut(seam + 0.2, seam)
    path = FORMS[name](tmp_path / name, parts)
    (read,) = read_features(path)
    assert read.geometry.geom_type == "Polygon"
    assert read.geometry.area == pytest.approx(whole.area, rel=1e-6)
    (seen,) = read_observed(path).outlines
    assert np.ptp(seen.ring[:, 0]) == pytest.approx(1.28, abs=1e-6)
    assert (seen.ring[:, 0].mean() - seam + 180.0) % 360.0 - 180.0 == pytest.approx(0.2, abs=0.2)


def test_a_berg_of_a_cut_outline_is_bonded_across_the_cut(tmp_path: Path) -> None:
    whole, parts = cut(180.0, 180.0)
    made = [Iceberg.from_outline(g, thickness=200.0, radius=2000.0) for g in (whole, shapely.MultiPolygon(parts))]
    assert made[0].bonds.first.size == made[1].bonds.first.size
    assert (made[1].elements.berg == 1).all()
    # The vertices at the cut bend the northern side along its parallel.
    np.testing.assert_allclose(made[1].elements.lon, made[0].elements.lon, atol=3e-3)


def read(folder: Path, parts: list[Any]) -> Any:
    """Return the geometry that a file holds, of one feature with these polygons."""
    (only,) = read_features(geojson(folder / "parts.geojson", feature(shapely.MultiPolygon(parts))))
    return only.geometry


@pytest.mark.parametrize("digits", [5, 6, 9])
def test_a_seam_closes_to_a_metre_and_leaves_no_slit(digits: int, tmp_path: Path) -> None:
    """Coordinates of six digits are rounded to 0.1 m, of five to 1 m; the cut line has vertices of its own on each side."""
    whole, parts = cut(180.1, 180.0, bend=0.02)
    first = shapely.segmentize(parts[0], 0.013)
    rounded = [shapely.transform(p, lambda c: np.round(c + np.array([2e-7, -3e-7]), digits)) for p in (first, parts[1])]
    shape = read(tmp_path, rounded)
    assert shape.geom_type == "Polygon"
    assert not shape.interiors
    assert shape.area == pytest.approx(whole.area, rel=1e-4)


@pytest.mark.parametrize("metres", [2.0, 5.0, 500.0])
def test_parts_that_overlap_a_little_are_one_shape(metres: float, tmp_path: Path) -> None:
    """Parts cut with a margin were two observations, or a berg whose elements overlap at any radius."""
    _, (west, east) = cut(180.2, 180.0)
    parts = shapely.MultiPolygon([west, translate(east, -metres * METRE / np.cos(np.radians(65.0)))])
    path = geojson(tmp_path / "o.geojson", feature(parts, date="2020-12-05"))
    (seen,) = read_observed(path).outlines
    assert np.ptp(seen.ring[:, 0]) == pytest.approx(1.28, abs=0.02)
    assert (Iceberg.from_outline(path, thickness=200.0, radius=2000.0).elements.berg == 1).all()
    assert len(read_features(geojson(path, *(feature(p, date="2020-12-05", name="A") for p in parts.geoms)))) == 2


def test_three_tiles_and_a_hole_on_the_cut_are_one_shape_with_its_hole(tmp_path: Path) -> None:
    whole = shapely.box(179.0, -66.0, 181.0, -65.0).difference(shapely.box(179.8, -65.6, 180.3, -65.4))
    tiles = [
        shapely.box(178.0, -70.0, 180.0, -65.5),
        shapely.box(178.0, -65.5, 180.0, 0.0),
        shapely.box(180.0, -70.0, 190.0, 0.0),
    ]
    parts = [whole.intersection(tile) for tile in tiles]
    parts[2] = shapely.transform(parts[2], lambda c: c - [360.0, 0.0])
    assert read(tmp_path, parts).equals(whole)


def test_pieces_apart_and_pieces_that_touch_at_a_corner_stay_two(tmp_path: Path) -> None:
    _, (west, east) = cut(180.0, 180.0)
    apart = translate(east, 5.0 * METRE / np.cos(np.radians(65.0)))
    assert len(read(tmp_path, [west, apart]).geoms) == 2
    corner = translate(east, 0.0, 0.18)
    assert len(read(tmp_path, [west, corner]).geoms) == 2


def test_features_are_joined_along_a_meridian_and_under_one_name_and_date_only(tmp_path: Path) -> None:
    """Two bergs that touch are two, and so are two dates of one berg."""
    _, (west, east) = cut(180.0, 180.0)

    def count(*properties: dict[str, str], parts: Any = (west, east)) -> int:
        drawn = [feature(part, **p) for part, p in zip(parts, properties, strict=True)]
        return len(read_features(geojson(tmp_path / "two.geojson", *drawn)))

    a, b = {"name": "A", "date": "2020-12-05"}, {"name": "B", "date": "2020-12-05"}
    assert count(a, a) == 1
    assert count({"id": "7", "size": "1"}, {"id": "7", "size": "2"}) == 1
    assert count(a, b) == 2
    assert count(a, {**a, "date": "2020-12-06"}) == 2
    assert count({}, {}) == 2
    below = [shapely.box(10.0, -66.0, 11.0, -65.5), shapely.box(10.0, -65.5, 11.0, -65.0)]
    assert count(a, a, parts=below) == 2
    tiles = [shapely.box(-41.0, -66.0, -40.0, -65.0), shapely.box(-40.0, -65.8, -39.0, -65.0)]
    assert count(a, a, parts=tiles) == 1


def test_a_projected_outline_across_180_degrees_is_not_torn(tmp_path: Path) -> None:
    """Bug: 'the outline jumps by more than 180 degrees of longitude', which no one can mend in a projection."""
    x, y = pytest.importorskip("pyproj").Transformer.from_crs(4326, 3031, always_xy=True).transform(180.0, -70.0)
    square = shapely.box(x - 20e3, y - 20e3, x + 20e3, y + 20e3)
    halves = [square.intersection(shapely.box(x - s * 1e6, y - 1e6, x, y + 1e6)) for s in (1, -1)]
    for geometry in (square, shapely.MultiPolygon(halves)):
        (read,) = read_features(geometry, crs="EPSG:3031")
        assert read.geometry.geom_type == "Polygon"
        assert abs(read.geometry.bounds[0]) == pytest.approx(180.0, abs=1.0)
        assert read.geometry.bounds[2] - read.geometry.bounds[0] == pytest.approx(1.07, abs=0.02)
    with pytest.raises(BergError, match="an outline around a pole"):
        Iceberg.from_outline(shapely.box(-2e4, -2e4, 2e4, 2e4), thickness=200.0, crs="EPSG:3031")


def globe(west: float, step: float = 0.25) -> tuple[np.ndarray, np.ndarray]:
    return west + step * (np.arange(round(360.0 / step)) + 0.5), -70.0 + step * (np.arange(20) + 0.5)


@pytest.mark.parametrize(("west", "middle"), [(-180.0, 180.0), (0.0, 0.0), (-40.0, -40.0)])
def test_masks_on_grids_that_wrap_are_one_shape(west: float, middle: float, tmp_path: Path) -> None:
    """As a berg, an observation, and an ice shelf; in NetCDF and as a GeoTIFF."""
    lon, lat = globe(west)
    away = np.abs((lon - middle + 180.0) % 360.0 - 180.0)
    ice = (away < 1.1)[None, :] & (np.abs(lat + 67.5) < 0.6)[:, None]
    array = xr.DataArray(ice.astype("i1"), coords={"lat": lat, "lon": lon}, dims=("lat", "lon"), name="mask")
    array.to_netcdf(tmp_path / "m_20201205.nc")
    (seen,) = read_observed(tmp_path / "m_20201205.nc").outlines
    assert np.ptp(seen.ring[:, 0]) == pytest.approx(2.0, abs=0.01)
    sources: list[Any] = [array]
    rasterio = pytest.importorskip("rasterio")
    made = {"driver": "GTiff", "height": 20, "width": lon.size, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(
        tmp_path / "m.tif", "w", transform=rasterio.Affine(0.25, 0, west, 0, -0.25, -65.0), **made
    ) as file:
        file.write(ice[::-1].astype("f4"), 1)
    sources.append(str(tmp_path / "m.tif"))
    bergs = [Iceberg.from_mask(source, thickness=200.0, radius=3000.0) for source in sources]
    shelf = IceShelf.from_raster(array.astype(float) * 200.0)
    bergs.append(shelf.berg(radius=3000.0))
    for berg in bergs:
        assert (berg.elements.berg == 1).all()
        assert (berg.elements.length * berg.elements.width).sum() == pytest.approx(2.0 * 1.0 * 4717e6, rel=0.03)


NOTHING = [[179.9, -65.0], [179.95, -65.0], [-179.95, -65.0], [179.9, -65.0]]
LINE = [[-40.0, -60.0], [-39.0, -61.0], [-38.0, -62.0], [-39.0, -61.0], [-40.0, -60.0]]
BAND = [[-180.0, -80.0], [180.0, -80.0], [180.0, -70.0], [-180.0, -70.0], [-180.0, -80.0]]
CAP = [[lon, -80.0 + 5.0 * np.cos(np.radians(2 * lon))] for lon in range(-180, 180, 30)]
FRAME = [[-70.0, -78.0], [-10.0, -78.0], [-10.0, -50.0], [-70.0, -50.0], [-70.0, -78.0]]
WIDE = [[-70.0, -60.0], [20.0, -60.0], [20.0, -50.0], [-70.0, -50.0], [-70.0, -60.0]]
SICK = [
    (NOTHING, "no area"), (LINE, "no area"), (BAND, "around a pole"), (CAP, "around a pole"),
    (FRAME, "28 degrees of latitude"), (WIDE, "90 degrees of longitude"),
]  # fmt: skip


@pytest.mark.parametrize(("ring", "fault"), SICK)
def test_outlines_that_no_berg_has_are_left_out_with_a_notice_where_another_is_meant(
    ring: Any, fault: str, tmp_path: Path
) -> None:
    """Bug: 'float division by zero', or the whole file refused."""
    sick = {"type": "Polygon", "coordinates": [ring]}
    box = feature(shapely.box(-39.0, -56.0, -38.0, -55.5), name="A", date="2020-12-05")
    both = geojson(tmp_path / "both.geojson", {"type": "Feature", "properties": {"name": "X"}, "geometry": sick}, box)
    seen = read_observed(both)
    assert [o.name for o in seen.outlines] == ["A"]
    assert len(seen.notices) == 1
    assert fault in seen.notices[0]
    Iceberg.from_outline(both, feature="A", thickness=200.0, radius=3000.0)
    alone = geojson(
        tmp_path / "alone.geojson", {"type": "Feature", "properties": {"date": "2020-12-05"}, "geometry": sick}
    )
    with pytest.raises(InputError, match=fault):
        read_observed(alone)
    with pytest.raises(BergError, match=fault):
        Iceberg.from_outline(alone, thickness=200.0, radius=3000.0)


def test_rings_of_no_area_beside_or_in_a_berg_are_nothing(tmp_path: Path) -> None:
    box = shapely.box(-39.0, -56.0, -38.0, -55.5)
    spoilt = shapely.Polygon(box.exterior, [[(-38.5, -55.8), (-38.4, -55.8), (-38.3, -55.8)]])
    sliver = shapely.Polygon([(-37.0, -55.0), (-36.0, -55.0), (-36.5, -55.0)])
    berg = Iceberg.from_outline(shapely.MultiPolygon([spoilt, sliver]), thickness=200.0, radius=3000.0)
    assert (berg.elements.berg == 1).all()
    across = shapely.Polygon([(179.5, -65.0), (-179.5, -65.0), (-179.5, -64.0)])  # over the date line, of one degree
    (seen,) = read_observed(geojson(tmp_path / "o.geojson", feature(across, date="2020-12-05"))).outlines
    assert np.ptp(seen.ring[:, 0] % 360.0) == pytest.approx(1.0)


def test_archives_of_macos_capitals_and_latin_letters_are_read(tmp_path: Path) -> None:
    """Bugs: the projection of a .PRJ was passed over, and texts of pyshp reached the user."""
    pyshp, pyproj = pytest.importorskip("shapefile"), pytest.importorskip("pyproj")
    plane = pyproj.CRS.from_epsg(3031)
    corners = pyproj.Transformer.from_crs(4326, 3031, always_xy=True).transform(
        [-39, -39, -38, -38], [-65, -64.8, -64.8, -65]
    )
    with pyshp.Writer(str(tmp_path / "a"), encoding="latin-1") as writer:
        writer.field("NAME", "C", 20)
        writer.poly([list(zip(*corners, strict=True))])
        writer.record("Grænland ø")
    (tmp_path / "a.prj").write_text(plane.to_wkt("WKT1_ESRI"))
    ends = ("shp", "shx", "dbf", "prj")
    fork = b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X"
    with zipfile.ZipFile(tmp_path / "mac.zip", "w") as archive:
        for end in ends:
            archive.writestr(f"__MACOSX/bergs/._a.{end}", fork)
            archive.write(tmp_path / f"a.{end}", f"bergs/a.{end}")
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        for end in ends:
            archive.write(tmp_path / f"a.{end}", f"a.{end}")
            archive.write(tmp_path / f"a.{end}", f"B.{end.upper()}")
    for end, new in (("shp", "SHP"), ("shx", "Shx"), ("dbf", "dbf"), ("prj", "PRJ")):
        (tmp_path / f"U.{new}").write_bytes((tmp_path / f"a.{end}").read_bytes())
    for name in ("a.shp", "mac.zip", "U.SHP"):
        (read,) = read_features(tmp_path / name)
        assert read.name == "Grænland ø"
        assert read.geometry.bounds == pytest.approx((-39.0, -65.0, -38.0, -64.8), abs=0.01)
    (tmp_path / "a.cpg").write_text("ISO-8859-1")
    assert read_features(tmp_path / "a.shp")[0].name == "Grænland ø"
    (tmp_path / "a.dbf").unlink()
    assert read_features(tmp_path / "a.shp")[0].properties == {}
    with pytest.raises(BergError, match=r"an archive of 2 shapefiles; it holds a.shp, B.SHP\. Unzip it and name one"):
        read_features(tmp_path / "two.zip")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8"])
def test_geojson_and_kml_with_a_mark_of_their_encoding_are_read(encoding: str, tmp_path: Path) -> None:
    _, parts = cut(-39.8, -40.0)
    text = geojson(tmp_path / "o.geojson", feature(shapely.MultiPolygon(parts), name="Ø1")).read_text()
    (tmp_path / "o.geojson").write_text(text, encoding=encoding)
    assert read_features(tmp_path / "o.geojson")[0].name == "Ø1"
    text = kml(tmp_path / "o.kml", parts).read_text()
    with zipfile.ZipFile(tmp_path / "o.kmz", "w") as archive:
        archive.writestr("__MACOSX/._doc.kml", b"\x00\x05\x16\x07")
        archive.writestr("doc.kml", text.encode(encoding))
    assert read_features(tmp_path / "o.kmz")[0].name == "C1 2020-12-05"


def test_a_vertex_that_is_not_a_number_is_told_so(tmp_path: Path) -> None:
    """It was 'Add the .prj file with its coordinate system', after a warning of shapely."""
    box = [[-39.0, -56.0], [-38.0, float("nan")], [-38.0, -55.5], [-39.0, -56.0]]
    ring = {"type": "Polygon", "coordinates": [box]}
    path = geojson(tmp_path / "o.geojson", {"type": "Feature", "properties": {"date": "2020-12-05"}, "geometry": ring})
    for taking in (read_observed, lambda p: Iceberg.from_outline(p, thickness=200.0, radius=3000.0)):
        with pytest.raises((InputError, BergError), match="vertices that are not numbers"):
            taking(path)


def test_geojson_in_latin_letters_is_read(tmp_path: Path) -> None:
    """It was 'not JSON', though tables in Latin-1 are read."""
    path = tmp_path / "o.geojson"
    drawn = feature(shapely.box(-39.0, -56.0, -38.0, -55.5), date="2020-12-05", name="Grønland")
    path.write_bytes(
        json.dumps({"type": "FeatureCollection", "features": [drawn]}, ensure_ascii=False).encode("cp1252")
    )
    assert read_features(path)[0].name == "Grønland"


def test_of_several_kml_files_in_an_archive_none_is_guessed(tmp_path: Path) -> None:
    """The first was taken in silence."""
    _, (west, east) = cut(180.2, 180.0)
    files = {name: kml(tmp_path / name, [part]) for name, part in (("one.kml", west), ("doc.kml", east))}
    for inside in (["one.kml", "doc.kml"], ["one.kml", "two.kml"], ["map/one.kml"]):
        with zipfile.ZipFile(tmp_path / "o.kmz", "w") as archive:
            for name in inside:
                archive.write(files.get(name, files["one.kml"]), name)
        if "two.kml" in inside:
            with pytest.raises(BergError, match=r"an archive of 2 KML files; it holds one.kml, two.kml"):
                read_features(tmp_path / "o.kmz")
        else:
            (read,) = read_features(tmp_path / "o.kmz")
            assert read.geometry.area == pytest.approx((east if "doc.kml" in inside else west).area, rel=1e-6)


def test_a_projection_with_a_mark_of_its_encoding_is_read(tmp_path: Path) -> None:
    _, parts = cut(180.2, 180.0)
    path = shapefile(tmp_path / "o.shp", parts)
    pyproj = pytest.importorskip("pyproj")
    path.with_suffix(".prj").write_text(pyproj.CRS.from_epsg(4326).to_wkt("WKT1_ESRI"), encoding="utf-8-sig")
    assert len(read_features(path)) == 1


def a_mask() -> xr.DataArray:
    """A berg of half by a degree on a plain grid."""
    lon, lat = -40.0 + 0.05 * np.arange(41), -56.0 + 0.05 * np.arange(31)
    ice = ((lon > -39.5) & (lon < -38.5))[None, :] & ((lat > -55.5) & (lat < -55.0))[:, None]
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    return xr.DataArray(ice.astype(float), coords=axes, dims=("lat", "lon"), name="mask")


@pytest.mark.parametrize("way", ["radians", "other sides"])
def test_axes_of_masks_count_in_their_units(way: str) -> None:
    """Radians were taken for degrees: the berg lay in the Gulf of Guinea, 60 times too small."""
    mask = a_mask()
    plain = Iceberg.from_mask(mask, thickness=200.0, radius=3000.0).elements
    for name, side in (("lat", "degrees_south"), ("lon", "degrees_west")):
        values = np.deg2rad(mask[name].values) if way == "radians" else -mask[name].values
        mask = mask.assign_coords({name: (name, values, {"units": "radians" if way == "radians" else side})})
    turned = Iceberg.from_mask(mask, thickness=200.0, radius=3000.0).elements
    np.testing.assert_allclose(turned.lon, plain.lon, atol=1e-6)
    np.testing.assert_allclose(turned.lat, plain.lat, atol=1e-6)


def test_axes_of_masks_on_bent_and_rotated_grids_are_no_positions(tmp_path: Path) -> None:
    mask = a_mask()
    bent = mask["lat"] + 0.3 * np.sin(mask["lon"])
    aside = mask.assign_coords(nav_lat=bent.assign_attrs(units="degrees_north"))
    rotated = mask.assign_coords(lat=mask["lat"].assign_attrs(standard_name="grid_latitude", units="degrees"))
    for wrong, words in ((aside, "aside of nav_lat"), (rotated, "is an axis of a rotated grid")):
        with pytest.raises(BergError, match=words):
            Iceberg.from_mask(wrong, thickness=200.0, radius=3000.0)
        wrong.to_netcdf(tmp_path / "m_20201205.nc")
        with pytest.raises(InputError, match=words):
            read_observed(tmp_path / "m_20201205.nc")
    same = mask.assign_coords(nav_lat=(mask["lat"] + 0.0 * mask["lon"]).assign_attrs(units="degrees_north"))
    Iceberg.from_mask(same, thickness=200.0, radius=3000.0)


def test_no_outline_is_lost_with_its_margin() -> None:
    """Bug: GEOS took the whole of this outline away with a margin of 3 m, and a run ended in an IndexError."""
    outline = shapely.Polygon(
        [(13210.45706831496, -11179.871503113649), (14495.642387030355, -12337.045166720896),
         (14498.773293107453, -12327.938047733818), (14502.53900112079, -12328.981379438086),
         (14499.620660000797, -12342.711456570049), (14061.668263153822, -14403.169758598311)]
    )  # fmt: skip
    width = 2.802164465758713
    smaller = shrink(outline, width)
    assert smaller.area == pytest.approx(outline.area - width * outline.length, rel=1e-4)
    assert outline.contains(smaller)
    square = shapely.box(0.0, 0.0, 10.0, 10.0)
    assert shrink(square, 1.0).equals(shapely.box(1.0, 1.0, 9.0, 9.0))
    assert shrink(square, 6.0).is_empty
    turned = shapely.box(0.0, 0.0, 10.0, 10.0, ccw=False)
    assert join_polygons([square, shapely.box(10.0 + 1e-4, 0.0, 20.0, 10.0), turned], 1e-3).area == pytest.approx(200.0)


def test_a_margin_is_taken_from_an_outline_that_geos_loses() -> None:
    """Bug: of ten elements with edges nearly in line nothing was left, and a run of a berg that shattered ended."""
    corners = [
        -1002.7320404228468, -1732.782864372068, -2734.7823268284646, -732.7831652658167, -2800.1109817114125, -695.0656487833505,
        -2233.739597116337, 135.04801511799417, -2233.7395971163364, 135.04801511799516, -1667.4648070389924, 965.0201033126443,
        -1104.0479105374122, 1790.8034620415315, -1105.3067437018356, 1792.8496849063763, -1104.496776664628, 1792.8270636236089,
        -1168.8108385122907, 1979.5595793172658, -733.8580326761786, 2732.920673839323, -733.0634682239902, 2734.9442064671143,
        -732.7831769906845, 2734.782380316007, -728.8440472804708, 2741.60515977652, -726.5790415436849, 2740.514160237885,
        -729.5603254737315, 2732.9216669057914, 130.79319920742188, 2236.1965362319884, 130.79319920741375, 2236.196536232019,
        134.9878881995711, 2233.7747324292627, 135.69217831683352, 2233.3681105110704, 135.69745031488105, 2233.3484351464995,
        964.1152301824148, 1735.0535308827132, 964.115230182415, 1735.0535308827132, 990.3234479852673, 1719.2892369499043,
        990.3234479852676, 1719.2892369499048, 1849.130004715746, 1202.7154243555465, 2707.875531746694, 686.1783212440415,
        1733.7820506126957, -1001.0002768149814, 732.7828588624068, -2734.782858657015,
    ]  # fmt: skip
    outline = shapely.Polygon(np.reshape(corners, (-1, 2)))
    for turn in (0.0, 30.0):
        berg = rotate(outline, turn, origin=(0.0, 0.0))
        assert shrink(berg, 2.0).area == pytest.approx(berg.area - 2.0 * berg.length, rel=1e-4)


def tiles(seed: int, gap: float) -> list[shapely.Polygon]:
    """Cells of random points in a box, some of them cut in two, each moved by a part of a gap."""
    rng = np.random.default_rng(seed)
    box = shapely.box(0.0, 0.0, 60.0, 40.0)
    cells = shapely.get_parts(shapely.voronoi_polygons(shapely.multipoints(rng.uniform(0.0, (60.0, 40.0), (80, 2)))))
    whole = [cell for cell in shapely.intersection(cells, box) if cell.area > 0.0]
    line = shapely.LineString(
        [(-1.0, 13.0), (25.0, 17.0), (61.0, 9.0)]
    )  # its ends on an edge divide a neighbour's edge
    cut = [piece for n, cell in enumerate(whole) for piece in (split(cell, line).geoms if n % 2 else [cell])]
    return [translate(piece, *(rng.uniform(-0.2, 0.2, 2) * gap)) for piece in cut]


@pytest.mark.parametrize("seed", range(6))
def test_tiles_are_joined_by_the_edges_that_no_two_share(seed: int) -> None:
    """As the union of all of them, a little wider, would be; corners within an edge of a neighbour divide it."""
    pieces = tiles(seed, 1e-3)
    joined = join_polygons(pieces, 1e-3)
    assert joined.geom_type == "Polygon"
    assert not joined.interiors
    assert joined.area == pytest.approx(2400.0, abs=0.1)
    reference = shapely.buffer(
        shapely.union_all(shapely.buffer(pieces, 1e-3, join_style="mitre")), -1e-3, join_style="mitre"
    )
    assert shapely.hausdorff_distance(joined, max(shapely.get_parts(reference), key=shapely.area)) < 0.01
    assert shapely.hausdorff_distance(joined, join_polygons(pieces[::-1], 1e-3)) < 2e-3
    apart = [piece for piece in pieces if piece.bounds[2] < 25.0 or piece.bounds[0] > 35.0]
    assert len(shapely.get_parts(join_polygons(apart, 1e-3))) > 1


def test_polygons_that_overlap_or_have_holes_are_joined_too() -> None:
    ring = shapely.box(0.0, 0.0, 10.0, 10.0).difference(shapely.box(4.0, 4.0, 6.0, 6.0))
    assert join_polygons([ring, shapely.box(10.0, 0.0, 12.0, 10.0)], 1e-3).area == pytest.approx(116.0, abs=0.01)
    assert join_polygons(
        [shapely.box(0.0, 0.0, 10.0, 10.0), shapely.box(5.0, 0.0, 15.0, 10.0)], 1e-3
    ).area == pytest.approx(150.0, abs=0.01)
