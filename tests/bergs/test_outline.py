"""Outlines of every format give the same berg; bad outlines are refused with a remedy."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.bergs.outline import line_strings, read_features
from riftberg.errors import BergError, RiftbergError

shapely = pytest.importorskip("shapely")

SHELL = [(-39.5, -55.2), (-38.5, -55.2), (-38.5, -54.9), (-39.5, -54.9), (-39.5, -55.2)]
HOLE = [(-39.2, -55.1), (-38.9, -55.1), (-38.9, -55.0), (-39.2, -55.0), (-39.2, -55.1)]
SMALL = [(-37.0, -55.0), (-36.8, -55.0), (-36.8, -54.9), (-37.0, -54.9), (-37.0, -55.0)]


def geojson(path):
    features = [
        {"type": "Feature", "properties": {"date": "2020-12-09", "name": "A"},
         "geometry": {"type": "Polygon", "coordinates": [SHELL, HOLE]}},
        {"type": "Feature", "properties": {"date": "2020-12-17", "name": "D"},
         "geometry": {"type": "Polygon", "coordinates": [SMALL]}},
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def csv(path):
    rows = ["Date,Name,Ring,Latitude,vertex,Longitude"]
    for date, name, ring, points in (
        ("2020-12-09", "A", 0, SHELL),
        ("2020-12-09", "A", 1, HOLE),
        ("2020-12-17", "D", 0, SMALL),
    ):
        rows += [f"{date},{name},{ring},{lat},{k},{lon}" for k, (lon, lat) in enumerate(points)]
    path.write_text("\n".join(rows) + "\n")


def kml_text() -> str:
    def ring(kind, points):
        text = " ".join(f"{lon},{lat},0" for lon, lat in points)
        return f"<{kind}><LinearRing><coordinates>{text}</coordinates></LinearRing></{kind}>"

    marks = [
        f"<Placemark><name>A</name><TimeStamp><when>2020-12-09T13:00:00Z</when></TimeStamp><Polygon>"
        f"{ring('outerBoundaryIs', SHELL)}{ring('innerBoundaryIs', HOLE)}</Polygon></Placemark>",
        f"<Placemark><name>D</name><TimeStamp><when>2020-12-17</when></TimeStamp><Polygon>"
        f"{ring('outerBoundaryIs', SMALL)}</Polygon></Placemark>",
    ]
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(marks)}</Document></kml>'


def kml(path):
    path.write_text(kml_text())


def kmz(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("doc.kml", kml_text())


def shapefile(path):
    with pytest.importorskip("shapefile").Writer(str(path)) as writer:
        writer.field("date", "C", 20)
        writer.field("name", "C", 5)
        writer.poly([SHELL[::-1], HOLE])
        writer.record("2020-12-09", "A")
        writer.poly([SMALL[::-1]])
        writer.record("2020-12-17", "D")


WRITERS = {"b.geojson": geojson, "b.csv": csv, "b.kml": kml, "b.kmz": kmz, "b.shp": shapefile}


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_outline_by_date_name_and_number(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    features = read_features(path)
    expected = shapely.Polygon(SHELL, [HOLE])
    assert [f.date[:10] for f in features] == ["2020-12-09", "2020-12-17"]
    assert features[0].geometry.symmetric_difference(expected).area < 1e-12
    assert features[1].geometry.symmetric_difference(shapely.Polygon(SMALL)).area < 1e-12
    made = [
        Iceberg.from_outline(path, thickness=200.0, **choice)
        for choice in ({"date": "2020-12-09"}, {"feature": "A"}, {"feature": 0})
    ]
    reference = Iceberg.from_outline(expected, thickness=200.0)
    for berg in made:
        np.testing.assert_allclose(berg.elements.lon, reference.elements.lon, atol=1e-9)
    assert reference.report["area_error"] == pytest.approx(0.0, abs=0.02)


def test_choice_among_several_outlines_is_demanded_and_listed(tmp_path):
    geojson(tmp_path / "b.geojson")
    with pytest.raises(BergError, match=r"0: date=2020-12-09, name=A; 1: date=2020-12-17, name=D"):
        Iceberg.from_outline(tmp_path / "b.geojson", thickness=200.0)
    with pytest.raises(BergError, match="0 of 2 outlines"):
        Iceberg.from_outline(tmp_path / "b.geojson", thickness=200.0, date="2021-01-01")
    with pytest.raises(BergError, match="0 of 2 outlines"):
        Iceberg.from_outline(tmp_path / "b.geojson", thickness=200.0, feature=-1)


def test_projected_shapefile_is_brought_to_longitude_and_latitude(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    to_polar = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3031", always_xy=True)
    points = list(zip(*to_polar.transform(*zip(*SHELL, strict=True)), strict=True))
    with pytest.importorskip("shapefile").Writer(str(tmp_path / "p.shp")) as writer:
        writer.field("id", "N")
        writer.poly([points[::-1]])
        writer.record(1)
    (tmp_path / "p.prj").write_text(pyproj.CRS("EPSG:3031").to_wkt("WKT1_ESRI"))
    got = read_features(tmp_path / "p.shp")[0].geometry
    assert got.symmetric_difference(shapely.Polygon(SHELL)).area < 1e-9


def test_metres_taken_for_degrees_are_refused_and_crs_mends_it():
    pyproj = pytest.importorskip("pyproj")
    to_polar = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3031", always_xy=True)
    points = np.stack(to_polar.transform(*np.array(SHELL).T), axis=1)
    with pytest.raises(BergError, match="crs="):
        Iceberg.from_outline(points, thickness=200.0)
    berg = Iceberg.from_outline(points, thickness=200.0, crs="EPSG:3031")
    assert berg.centroid == pytest.approx((-39.0, -55.05), abs=0.01)
    with pytest.raises(BergError, match="unknown coordinate system"):
        Iceberg.from_outline(points, thickness=200.0, crs="EPSG:0")


def test_outline_that_crosses_itself_is_refused_or_mended():
    bow_tie = [(-39.5, -55.2), (-38.5, -54.9), (-38.5, -55.2), (-39.5, -54.9)]
    with pytest.raises(BergError, match=r"crosses itself \(Self-intersection\[-39 -55.05\]\)"):
        Iceberg.from_outline(bow_tie, thickness=200.0)
    berg = Iceberg.from_outline(bow_tie, thickness=200.0, repair=True)
    assert berg.report["area_error"] == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize(
    ("west", "east", "goes_on"),
    [(179.5, -179.5, (179.5, 180.5)), (359.5, 0.5, (-0.5, 0.5))],  # date line, Greenwich
)
def test_longitudes_that_jump_are_refused_and_those_that_go_on_work(west, east, goes_on):
    with pytest.raises(BergError, match=r"jumps by more than 180 degrees of longitude\. Let its longitudes go on"):
        Iceberg.from_outline([(west, -65.0), (east, -65.0), (east, -64.7), (west, -64.7)], thickness=200.0)
    west, east = goes_on
    berg = Iceberg.from_outline([(west, -65.0), (east, -65.0), (east, -64.7), (west, -64.7)], thickness=200.0)
    assert berg.centroid[0] == pytest.approx(0.5 * (west + east), abs=0.01)


@pytest.mark.parametrize(
    "points", [[(0.0, 91.0), (1.0, 91.0), (1.0, 90.5)], [(0.0, -60.0), (np.nan, -60.0), (1.0, -61.0)]]
)
def test_vertices_off_the_earth_are_refused(points):
    with pytest.raises(BergError, match=r"not longitude and latitude|not numbers"):
        Iceberg.from_outline(points, thickness=200.0)


def test_files_that_cannot_be_read_are_named(tmp_path):
    for name, text, match in [
        ("a.geojson", "{", r"not JSON \(line 1, column 2\)"),
        ("b.geojson", "[1]", "no GeoJSON object"),
        ("c.geojson", '{"type": "Blob", "coordinates": [1]}', "not a GeoJSON geometry"),
        ("d.geojson", '{"type": "FeatureCollection", "features": []}', "no geometry"),
        ("e.csv", "a,b\n1,2\n", "no columns of longitude and latitude among a, b"),
        ("f.csv", "lon,lat\n1,2\n1,x\n1,3\n", "line 3"),
        ("g.kml", "<kml>", r"not KML \(line 1, column 5\)"),
        ("h.png", "x", "unknown kind of file '.png'"),
    ]:
        (tmp_path / name).write_text(text)
        with pytest.raises(BergError, match=match) as caught:
            read_features(tmp_path / name)
        assert name in str(caught.value)
    with pytest.raises(BergError, match="file not found"):
        read_features(tmp_path / "none.kml")


@pytest.mark.parametrize(("package", "keys"), [("pyproj", {"crs": "EPSG:3031"}), ("shapefile", {})])
def test_missing_extra_is_named(monkeypatch, tmp_path, package, keys):
    import sys

    (tmp_path / "outline.shp").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RiftbergError, match=rf"{package} is not installed .*riftberg\[outline\]"):
        read_features(SHELL if keys else tmp_path / "outline.shp", **keys)


def test_lines_come_from_files_geometries_and_arrays(tmp_path):
    line = [(-39.0, -55.3), (-39.0, -54.8)]
    (tmp_path / "rift.geojson").write_text(json.dumps({"type": "LineString", "coordinates": line}))
    sources = [
        tmp_path / "rift.geojson",
        shapely.LineString(line),
        line,
        np.array(line),
        [line],
        [shapely.LineString(line)],
    ]
    for source in sources:
        got = line_strings(source)
        assert len(got) == 1
        np.testing.assert_array_equal(got[0], line)
    berg = Iceberg.from_outline(SHELL, thickness=200.0)
    assert berg.with_rifts(tmp_path / "rift.geojson", broken=True).elements.berg.max() == 2


def test_observed_outlines_of_a68a_are_read(shared):
    folder = shared / "data" / "observed"
    bergs = [
        Iceberg.from_outline(folder / name, thickness=200.0, date="2020-12-09", repair=True)
        for name in ("a68a_daily_outlines.geojson", "a68a_daily_outlines.csv")
    ]
    # The table of observed areas is for the WGS84 ellipsoid; the model's world is a sphere, 0.7 % smaller there.
    sine = np.sin(np.radians(55.02))
    ellipsoid = 6378137.0**2 * (1 - 0.00669438) / (1 - 0.00669438 * sine**2) ** 2
    for berg in bergs:
        assert berg.report["outline_area"] == pytest.approx(4151e6 * berg.earth_radius**2 / ellipsoid, rel=1e-3)
        assert abs(berg.report["area_error"]) < 5e-3
        assert berg.centroid == pytest.approx((-39.2454, -55.0194), abs=0.01)
        assert abs(berg.initial_strain) < 1e-8


RIFT = [(-39.1, -55.3), (-39.0, -55.05), (-39.2, -54.8)]


def rift_files(folder):
    """Write a bent rift in every format; return the paths."""
    rows = [f"{lon},{lat}" for lon, lat in RIFT]
    (folder / "rift.csv").write_text("lon,lat\n" + "\n".join(rows) + "\n")
    (folder / "semicolon.csv").write_text("Longitude;Latitude\n" + "\n".join(r.replace(",", ";") for r in rows))
    decimal = [f"{lon};{lat}".replace(".", ",") for lon, lat in RIFT]
    (folder / "comma.csv").write_text("Longitude;Latitude\n" + "\n".join(decimal))
    (folder / "rift.geojson").write_text(json.dumps({"type": "LineString", "coordinates": RIFT}))
    text = " ".join(f"{lon},{lat},0" for lon, lat in RIFT)
    (folder / "rift.kml").write_text(
        f"<kml><Placemark><LineString><coordinates>{text}</coordinates></LineString></Placemark></kml>"
    )
    return [folder / n for n in ("rift.csv", "semicolon.csv", "comma.csv", "rift.geojson", "rift.kml")]


def test_a_rift_cuts_the_same_bonds_from_csv_geojson_kml_and_array(tmp_path):
    """The vertices of a table are an open line: a closing segment would cut bonds that the rift does not reach."""
    berg = Iceberg.from_outline(SHELL, thickness=200.0)
    expected = berg.with_rifts(np.array(RIFT), broken=True).bonds.status
    assert (expected == 2).sum() > 10
    for path in rift_files(tmp_path):
        np.testing.assert_array_equal(berg.with_rifts(path, broken=True).bonds.status, expected, err_msg=path.name)


def test_a_table_of_rifts_holds_lines_of_two_points_and_several_lines(tmp_path):
    path = tmp_path / "rifts.csv"
    path.write_text("rift,lon,lat\na,-39.1,-55.3\na,-39.1,-54.8\nb,-38.7,-55.3\nb,-38.7,-54.8\n")
    got = line_strings(path)
    assert [line.tolist() for line in got] == [
        [[-39.1, -55.3], [-39.1, -54.8]],
        [[-38.7, -55.3], [-38.7, -54.8]],
    ]
    berg = Iceberg.from_outline(SHELL, thickness=200.0)
    assert berg.with_rifts(path, broken=True).elements.berg.max() == 3
    path.write_text("id,lon,lat\n1,-39.1,-55.3\n2,-39.1,-54.8\n")
    with pytest.raises(BergError, match=r"a line of 1 vertex. A line needs at least 2 rows"):
        line_strings(path)


def test_projected_lines_of_an_array_are_brought_to_longitude_and_latitude():
    pyproj = pytest.importorskip("pyproj")
    to_polar = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3031", always_xy=True)
    points = np.stack(to_polar.transform(*np.array(RIFT).T), axis=1)
    np.testing.assert_allclose(line_strings(points, "EPSG:3031")[0], RIFT, atol=1e-9)


def kml_of(coordinates: str) -> str:
    return (
        "<kml><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{coordinates}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )


@pytest.mark.parametrize("form", ["{}, {}", "{} , {}", "{}, {}, 0", "{},{},0,", "{},{}"])
def test_spaces_after_the_commas_of_kml_are_read(form, tmp_path):
    path = tmp_path / "a.kml"
    path.write_text(kml_of("\n".join(form.format(*point) for point in SHELL)))
    (feature,) = read_features(path)
    np.testing.assert_array_equal(shapely.get_coordinates(feature.geometry), SHELL)


@pytest.mark.parametrize("text", ["x,y x,y x,y", "1, 2, 3, 4", "1 2 3 4", "1,2,3,4 5,6 7,8"])
def test_coordinates_of_kml_that_cannot_be_read_are_named(text, tmp_path):
    path = tmp_path / "a.kml"
    path.write_text(kml_of(text))
    with pytest.raises(BergError, match=r"a\.kml: coordinates that cannot be read"):
        read_features(path)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
def test_tables_in_other_encodings_are_read(encoding, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(("name,lon,lat\n" + "\n".join(f"Ré,{x},{y}" for x, y in SHELL)).encode(encoding))
    (feature,) = read_features(path)
    assert feature.properties == {"name": "Ré"}
    np.testing.assert_array_equal(shapely.get_coordinates(feature.geometry), SHELL)


def test_polygons_and_lines_of_a_geometry_collection_are_found(tmp_path):
    line = {"type": "LineString", "coordinates": RIFT}
    members = [{"type": "Point", "coordinates": SHELL[0]}, line, {"type": "Polygon", "coordinates": [SHELL]}]
    nested = {"type": "GeometryCollection", "geometries": [{"type": "GeometryCollection", "geometries": members}]}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": nested}))
    berg, plain = (Iceberg.from_outline(source, thickness=200.0) for source in (path, SHELL))
    np.testing.assert_array_equal(berg.elements.lon, plain.elements.lon)
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": [members[0], line]}))
    np.testing.assert_array_equal(line_strings(path)[0], RIFT)
    with pytest.raises(BergError, match="0 of 0 outlines"):
        Iceberg.from_outline(path, thickness=200.0)


def test_columns_are_found_by_name_in_any_order(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("lat,lon\n" + "\n".join(f"{lat},{lon}" for lon, lat in SHELL))
    np.testing.assert_array_equal(shapely.get_coordinates(read_features(path)[0].geometry), SHELL)
