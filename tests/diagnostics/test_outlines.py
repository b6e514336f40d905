"""Outlines from drawings and grids: shapes, dates from wherever users' files keep them, and what is refused."""

from __future__ import annotations

import json
import zipfile
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import read_observed
from riftberg.config.values import parse_date
from riftberg.diagnostics.observed import KINDS
from riftberg.errors import InputError

shapely = pytest.importorskip("shapely")
shapefile = pytest.importorskip("shapefile")

RING = [(-39.0, -55.0), (-38.0, -55.0), (-38.0, -54.5), (-39.0, -54.5), (-39.0, -55.0)]
SMALL = [(-37.0, -55.0), (-36.8, -55.0), (-36.8, -54.9), (-37.0, -55.0)]


def mark(inside: str, ring: list[tuple[float, float]] = RING) -> str:
    """Return a placemark of KML with a polygon."""
    points = " ".join(f"{lon},{lat},0" for lon, lat in ring)
    return (
        f"<Placemark>{inside}<Polygon><outerBoundaryIs><LinearRing><coordinates>{points}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark>"
    )


def kml(path: Path, *marks: str) -> Path:
    """Write a KML file."""
    path.write_text(f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(marks)}</Document></kml>')
    return path


def shape(path: Path, fields: list[tuple[Any, ...]], *records: tuple[Any, ...]) -> Path:
    """Write a shapefile with one polygon for each record."""
    with shapefile.Writer(str(path)) as writer:
        for field in fields:
            writer.field(*field)
        for number, record in enumerate(records):
            writer.poly([[(lon + number, lat) for lon, lat in RING[::-1]]])
            writer.record(*record)
    return path


def told(path: Path, **how: str) -> list[tuple[str, datetime, bool]]:
    """Return names and dates of the outlines of a file."""
    return [(o.name, o.when, o.day_only) for o in read_observed(path, **how).outlines]


def area(ring: np.ndarray) -> float:
    """Return the area of a ring in square degrees."""
    return float(shapely.Polygon(ring).area)


def undated(path: Path, ring: Any = RING) -> Path:
    """Write an outline whose date stands in the name of its file alone."""
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


# --- dates -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "when", "day_only"),
    [
        ("a68a_2020-12-17", datetime(2020, 12, 17), True),
        ("berg_2020_12_09_gridded_ll_p0625", datetime(2020, 12, 9), True),
        ("A68A 17 Dec 2020", datetime(2020, 12, 17), True),
        ("17December2020", datetime(2020, 12, 17), True),
        ("S1A_EW_GRDM_1SDH_20201217T081533_A68", datetime(2020, 12, 17, 8, 15, 33), False),
        ("A68A 2020-12-17 08:15 UTC", datetime(2020, 12, 17, 8, 15), False),
        ("seen 20201217, drawn from 2020-12-17", datetime(2020, 12, 17), True),
    ],
)
def test_a_date_is_found_in_a_name(tmp_path: Path, text: str, when: datetime, day_only: bool) -> None:
    assert [(when, day_only)] == [row[1:] for row in told(undated(tmp_path / f"{text}.geojson"))]


@pytest.mark.parametrize(
    "text", ["a68a", "20201209_20201217", "p0625_1217", "2020-13-01", "20200230", "120201217", "2020-12_17"]
)
def test_no_date_or_more_than_one_is_none(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="date"):
        told(undated(tmp_path / f"{text}.geojson"))


def test_slashes_with_the_year_first_are_read_and_others_are_refused() -> None:
    assert parse_date("2020/12/17") == (datetime(2020, 12, 17), True)
    with pytest.raises(InputError, match="'12/11/2020' is not a date"):
        parse_date("12/11/2020")


# --- KML ---------------------------------------------------------------------------------------------------------------


def test_kml_dates_from_time_stamp_extended_data_name_folder_and_file(tmp_path: Path) -> None:
    stamp = "<TimeStamp><when>2020-12-17T13:00:00Z</when></TimeStamp>"
    data = '<ExtendedData><Data name="Acq_Date"><value>2020-12-18</value></Data></ExtendedData>'
    table = '<ExtendedData><SchemaData><SimpleData name="date">20201219</SimpleData></SchemaData></ExtendedData>'
    path = kml(
        tmp_path / "bergs_2020-12-22.kml",
        mark("<name>A68A</name>" + stamp),
        mark("<name>A68D</name>" + data, SMALL),
        mark(table),
        mark("<name>2020-12-20</name>"),
        "<Folder><name>21 Dec 2020</name>" + mark("<name>A68A</name>") + "</Folder>",
        mark("<name>A68E</name>"),
    )
    assert told(path) == [
        ("A68A", datetime(2020, 12, 17, 13), False),
        ("A68D", datetime(2020, 12, 18), True),
        ("", datetime(2020, 12, 19), True),
        ("", datetime(2020, 12, 20), True),
        ("A68A", datetime(2020, 12, 21), True),
        ("A68E", datetime(2020, 12, 22), True),
    ]
    np.testing.assert_array_equal(read_observed(path).outlines[0].ring, RING[:-1])


def test_kml_lines_are_left_alone_and_a_file_of_lines_is_refused(tmp_path: Path) -> None:
    line = "<Placemark><name>rift</name><LineString><coordinates>-39,-55 -38,-55</coordinates></LineString></Placemark>"
    assert len(read_observed(kml(tmp_path / "a.kml", line, mark("<name>A 2020-12-17</name>"))).outlines) == 1
    with pytest.raises(InputError, match="no polygons, only lines"):
        read_observed(kml(tmp_path / "b.kml", line))


def test_without_a_date_everything_that_was_looked_for_is_named(tmp_path: Path) -> None:
    path = kml(tmp_path / "bergs.kml", mark("<name>A68A</name>"))
    with pytest.raises(
        InputError, match=r"bergs\.kml, outline 0: no date.*acq_date.*it has name.*name of the file.*--date"
    ):
        read_observed(path)
    assert told(path, date="2020-12-17") == [("A68A", datetime(2020, 12, 17), True)]
    with pytest.raises(InputError, match="'noon' is not a date"):
        read_observed(path, date="noon")


# --- shapefiles --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "record", "when", "day_only"),
    [
        ([("DATE", "D")], (datetime(2020, 12, 17).date(),), datetime(2020, 12, 17), True),
        ([("Acq_Date", "C", 12)], ("2020/12/17",), datetime(2020, 12, 17), True),
        ([("DATE", "N", 10, 0)], (20201217,), datetime(2020, 12, 17), True),
        ([("DATE", "N", 12, 1)], (2020352.0,), datetime(2020, 12, 17), True),
        ([("date", "C", 12), ("time", "C", 8)], ("2020-12-17", "08:15"), datetime(2020, 12, 17, 8, 15), False),
        ([("label", "C", 30)], ("2020-12-17",), datetime(2020, 12, 17), True),
    ],
)  # fmt: skip
def test_shapefile_dates_as_users_write_them(
    tmp_path: Path, fields: list[Any], record: tuple[Any, ...], when: datetime, day_only: bool
) -> None:
    assert told(shape(tmp_path / "a.shp", fields, record)) == [("", when, day_only)]


def test_a_shapefile_gives_names_and_rings_also_from_a_zip(tmp_path: Path) -> None:
    path = shape(
        tmp_path / "a.shp", [("Berg", "C", 9), ("date", "C", 10)], ("A68A", "2020-12-17"), ("A68D", "2020-12-17")
    )
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        for kind in (".shp", ".dbf", ".shx"):
            archive.write(path.with_suffix(kind), "a" + kind)
    for file in (path, tmp_path / "b.zip"):
        found = read_observed(file).outlines
        assert [o.name for o in found] == ["A68A", "A68D"]
        assert [area(o.ring) for o in found] == pytest.approx([0.5, 0.5])
        assert found[1].ring[:, 0].min() == -38.0


def test_a_projected_shapefile_needs_its_projection_also_in_a_zip(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    to_polar = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3031", always_xy=True)
    points = [to_polar.transform(*point) for point in RING]
    with shapefile.Writer(str(tmp_path / "p_2020-12-17.shp")) as writer:
        writer.field("id", "N")
        writer.poly([points[::-1]])
        writer.record(7)
    with pytest.raises(InputError, match=r"latitude beyond 90 degrees\. Add the \.prj file"):
        read_observed(tmp_path / "p_2020-12-17.shp")
    (tmp_path / "p_2020-12-17.prj").write_text(pyproj.CRS("EPSG:3031").to_wkt("WKT1_ESRI"))
    with zipfile.ZipFile(tmp_path / "p_2020-12-17.zip", "w") as archive:
        for kind in (".shp", ".dbf", ".shx", ".prj"):
            archive.write(tmp_path / ("p_2020-12-17" + kind), "p" + kind)
    for kind in (".shp", ".zip"):
        (outline,) = read_observed(tmp_path / ("p_2020-12-17" + kind)).outlines
        assert outline.when == datetime(2020, 12, 17)
        assert shapely.Polygon(outline.ring).symmetric_difference(shapely.Polygon(RING)).area < 1e-6


# --- masks -------------------------------------------------------------------------------------------------------------

LON, LAT = np.linspace(-40.0, -36.0, 81), np.linspace(-56.0, -54.0, 41)
X, Y = np.meshgrid(LON, LAT)
BERG = (abs(X + 38.5) < 0.51) & (abs(Y + 55.0) < 0.26)  # 1.05 by 0.55 degrees, cell by cell
PIECE = (abs(X + 36.5) < 0.11) & (abs(Y + 55.5) < 0.11)  # 0.25 by 0.25 degrees


def write_mask(
    path: Path, values: Any, name: str = "mask", attributes: dict[str, Any] | None = None, **how: Any
) -> Path:
    """Write a mask, of one date or of several."""
    dims = ("time", "lat", "lon")[3 - np.ndim(values) :]
    coords = {"lon": LON, "lat": LAT, **how}
    mask = xr.DataArray(np.asarray(values), coords=coords, dims=dims, name=name, attrs=attributes or {})
    mask.to_dataset().to_netcdf(path)
    return path


def test_a_mask_is_outlined_half_way_between_ice_and_water(tmp_path: Path) -> None:
    path = write_mask(tmp_path / "mask_2020-12-17.nc", BERG.astype("i1"))
    (outline,) = read_observed(path).outlines
    assert (outline.name, outline.when, outline.day_only) == ("", datetime(2020, 12, 17), True)
    assert outline.ring.min(axis=0) == pytest.approx([-39.025, -55.275])
    assert outline.ring.max(axis=0) == pytest.approx([-37.975, -54.725])
    # The corners are cut: four triangles of half a cell.
    assert area(outline.ring) == pytest.approx(1.05 * 0.55 - 4 * 0.5 * 0.025**2)


def test_the_outline_of_a_fraction_is_where_the_berg_made_from_it_ends(tmp_path: Path) -> None:
    share = np.clip(5.0 * (0.5 - np.hypot((X + 38.0) * 0.57, Y + 55.0)) + 0.5, 0.0, 1.0)
    path = write_mask(tmp_path / "m.nc", share, "fraction", {"date": "2020-12-17T06:00"})
    (outline,) = read_observed(path).outlines
    assert outline.when == datetime(2020, 12, 17, 6)
    from riftberg.bergs.raster import read_raster

    np.testing.assert_allclose(read_raster(path).sample(*outline.ring.T), 0.5, atol=1e-9)


def test_pieces_of_a_mask_without_specks_and_with_the_pool_filled(tmp_path: Path) -> None:
    both = (BERG | PIECE).astype(float)
    both[abs(X + 38.5) + abs(Y + 55.0) < 0.08] = 0.0  # a pool
    both[3, 3] = 1.0  # a speck
    found = read_observed(write_mask(tmp_path / "m_20201217.nc", both)).outlines
    assert sorted(area(o.ring) for o in found) == pytest.approx([0.0625, 0.5775], abs=0.002)


def test_pieces_are_specks_by_their_area_on_the_globe(tmp_path: Path) -> None:
    """Four cells beside 300: near the pole they are a third of what they are in the north."""
    lat, lon = np.arange(-80.0, -39.0), np.arange(-60.0, 1.0)
    ice = np.zeros((lat.size, lon.size))
    ice[30:40, 5:35] = 1.0
    north, south = ice.copy(), ice.copy()
    north[34:36, 45:47] = 1.0
    south[1:3, 45:47] = 1.0
    for values, count in ((north, 2), (south, 1)):
        axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
        xr.Dataset({"ice": (("lat", "lon"), values)}, axes).to_netcdf(tmp_path / "m_20201217.nc")
        assert len(read_observed(tmp_path / "m_20201217.nc").outlines) == count


def test_whole_numbers_number_the_pieces_also_where_they_touch(tmp_path: Path) -> None:
    numbers = np.where(BERG & (X < -38.4), 3, np.where(BERG, 5, 0))
    found = read_observed(write_mask(tmp_path / "m_20201217.nc", numbers, "labels")).outlines
    assert [o.name for o in found] == ["3", "5"]
    assert sum(area(o.ring) for o in found) == pytest.approx(0.5775, abs=0.006)
    assert found[0].ring[:, 0].max() == pytest.approx(found[1].ring[:, 0].min())


def test_per_cent_are_fractions_and_ice_at_the_edge_is_closed(tmp_path: Path) -> None:
    path = write_mask(tmp_path / "m_20201217.nc", np.where(X < -39.4, 100, 0), "ice", {"units": "%"})
    (outline,) = read_observed(path).outlines
    assert outline.name == ""
    assert outline.ring[:, 0].min() == pytest.approx(-40.025)
    assert area(outline.ring) == pytest.approx(0.6 * 2.05, rel=0.01)


def test_a_mask_of_several_days_and_of_hours(tmp_path: Path) -> None:
    days = np.array(["2020-12-17", "2020-12-18"], "datetime64[ns]")
    path = write_mask(tmp_path / "m.nc", [BERG, PIECE], time=days)
    assert told(path) == [("", datetime(2020, 12, 17), True), ("", datetime(2020, 12, 18), True)]
    hours = np.array(["2020-12-17T00", "2020-12-17T12"], "datetime64[ns]")
    path = write_mask(tmp_path / "h.nc", [BERG, PIECE], time=hours)
    assert told(path) == [("", datetime(2020, 12, 17), False), ("", datetime(2020, 12, 17, 12), False)]


def test_the_variable_is_recognised_or_asked_for(tmp_path: Path) -> None:
    data = xr.Dataset({n: (("lat", "lon"), BERG.astype(float)) for n in ("b_id", "thick")}, {"lon": LON, "lat": LAT})
    data.to_netcdf(tmp_path / "m_20201217.nc")
    assert len(read_observed(tmp_path / "m_20201217.nc").outlines) == 1
    data.rename(b_id="first").to_netcdf(tmp_path / "n_20201217.nc")
    with pytest.raises(InputError, match="Name the mask with --variable: first, thick"):
        read_observed(tmp_path / "n_20201217.nc")
    assert len(read_observed(tmp_path / "n_20201217.nc", variable="thick").outlines) == 1
    with pytest.raises(InputError, match=r"no variable 'third'\. It holds first, thick"):
        read_observed(tmp_path / "n_20201217.nc", variable="third")


def test_what_is_no_mask_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mask: values from 0 to 250.5 are no mask"):
        read_observed(write_mask(tmp_path / "a_20201217.nc", 250.5 * BERG))
    with pytest.raises(InputError, match="values from 0 to 3320 are no mask"):  # a depth in whole metres
        read_observed(write_mask(tmp_path / "b_20201217.nc", np.arange(X.size).reshape(X.shape)))
    with pytest.raises(InputError, match="no ice in the mask"):
        read_observed(write_mask(tmp_path / "c_20201217.nc", 0.3 * BERG))
    with pytest.raises(InputError, match="no date"):
        read_observed(write_mask(tmp_path / "d.nc", BERG.astype(float)))
    (tmp_path / "e.nc").write_text("nothing")
    with pytest.raises(InputError, match="cannot be read"):
        read_observed(tmp_path / "e.nc")


@pytest.mark.parametrize(("west", "east"), [(1.0, 1.0), (1.0, 0.52), (0.52, 1.0)])
def test_ice_across_the_seam_of_a_whole_globe_is_one_piece(tmp_path: Path, west: float, east: float) -> None:
    """Cells that are more than half ice are ice."""
    lon, lat = np.arange(-179.5, 180.0), np.arange(-79.5, -60.0)
    ice = (abs(lon) > 176.0)[None, :] & (abs(lat + 70.0) < 3.0)[:, None]
    share = ice * np.where(lon < 0.0, west, east)
    xr.DataArray(share, coords={"lat": lat, "lon": lon}, name="mask").to_netcdf(tmp_path / "g_20201217.nc")
    (outline,) = read_observed(tmp_path / "g_20201217.nc").outlines
    assert np.ptp(outline.ring[:, 0]) == pytest.approx(7.9, abs=0.5)
    everywhere = np.where(abs(lat + 70.0) < 3.0, 1.0, 0.0)[:, None] + 0.0 * lon
    xr.DataArray(everywhere, coords={"lat": lat, "lon": lon}, name="mask").to_netcdf(tmp_path / "a_20201217.nc")
    with pytest.raises(InputError, match="there is ice at all longitudes"):
        read_observed(tmp_path / "a_20201217.nc")


def test_tables_of_corners_in_netcdf(tmp_path: Path) -> None:
    """The layout of the published outlines: longitudes in the first row, latitudes in the second, NaN below."""
    table = np.full((5, 5), np.nan)
    table[:2] = np.transpose(RING)
    data = xr.Dataset(
        {"outline1": (("y", "x"), table), "outline2": (("y", "x"), table.T + 1), "crack1": (("y", "x"), table)}
    )
    data.to_netcdf(tmp_path / "o_2020-12-21.nc")
    found = read_observed(tmp_path / "o_2020-12-21.nc").outlines
    assert [o.name for o in found] == ["outline1", "outline2"]
    np.testing.assert_array_equal(found[0].ring, RING[:-1])
    np.testing.assert_array_equal(found[1].ring, np.add(RING[:-1], 1))


def test_files_of_an_unknown_kind_are_refused_with_those_known(tmp_path: Path) -> None:
    (tmp_path / "a.gpkg").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"unknown kind of file '.gpkg'.*" + r".*".join(KINDS[:3])):
        read_observed(tmp_path / "a.gpkg")


def test_published_mask_and_tables(shared: Path) -> None:
    folder = shared / "data"
    (mask,) = read_observed(folder / "a68a/a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc").outlines
    drawn = read_observed(folder / "observed/a68a_daily_outlines.geojson").outlines[0]
    assert mask.when == drawn.when == datetime(2020, 12, 9)
    first, second = shapely.Polygon(mask.ring), shapely.Polygon(drawn.ring)
    assert first.intersection(second).area / first.union(second).area > 0.96
    table = read_observed(folder / "observed/a68_12_24_all.nc", date="2020-12-24").outlines
    same = [
        o for o in read_observed(folder / "observed/a68_fragments_20201217_26.geojson").outlines if o.when.day == 24
    ]
    assert [area(o.ring) for o in table] == pytest.approx([area(o.ring) for o in same], rel=1e-4)


@pytest.mark.parametrize(
    ("lon", "lat", "words"),
    [(539.5, -75.0, ""), (541.0, -75.0, "longitude beyond 540"), (-541.0, -75.0, "longitude beyond 540"),
     (0.0, 90.5, "latitude beyond 90"), (0.0, -90.5, "latitude beyond 90")],
)  # fmt: skip
def test_positions_that_no_convention_has_are_refused(tmp_path: Path, lon: float, lat: float, words: str) -> None:
    """Longitudes run to one and a half turns: products begin at -180, at 0, or at 180."""
    ring = [[lon, lat], [lon - 0.3, lat], [lon - 0.3, lat - 0.1], [lon, lat - 0.1], [lon, lat]]
    path = undated(tmp_path / "berg_2020-12-17.geojson", ring)
    if words:
        with pytest.raises(InputError, match=words):
            read_observed(path)
    else:
        assert read_observed(path).outlines[0].ring.shape == (4, 2)
