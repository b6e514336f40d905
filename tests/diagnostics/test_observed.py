"""Observed outlines and positions."""

from __future__ import annotations

import json
import re
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from riftberg import read_observed
from riftberg.bergs.outline import read_features
from riftberg.errors import InputError

RING = [[-39.0, -55.0], [-38.0, -55.0], [-38.0, -54.5], [-39.0, -55.0]]


def feature(geometry: object, **properties: object) -> dict[str, object]:
    """Return a GeoJSON feature."""
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def geojson(path: Path, *features: object) -> Path:
    """Write a collection."""
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_polygons_of_geojson_without_the_repeated_point(tmp_path: Path) -> None:
    found = read_observed(
        geojson(
            tmp_path / "o.geojson",
            feature({"type": "Polygon", "coordinates": [RING]}, date="2020-12-17", berg="A68A"),
            feature(
                {"type": "MultiPolygon", "coordinates": [[RING], [np.add(RING, 1).tolist()]]},
                date="2020-12-18T10:30:00Z",
            ),
            feature({"type": "LineString", "coordinates": RING}, date="2020-12-18", name="a rift"),
        )
    )
    assert [(o.name, o.when, o.day_only, len(o.ring)) for o in found.outlines] == [
        ("A68A", datetime(2020, 12, 17), True, 3),
        ("", datetime(2020, 12, 18, 10, 30), False, 3),
        ("", datetime(2020, 12, 18, 10, 30), False, 3),
    ]
    assert {day: len(rings) for day, rings in found.rings_by_day().items()} == {"2020-12-17": 1, "2020-12-18": 2}


def test_an_outline_given_twice_is_taken_once(tmp_path: Path) -> None:
    polygon = feature({"type": "Polygon", "coordinates": [RING]}, date="2020-12-17")
    assert len(read_observed(geojson(tmp_path / "o.json", polygon, polygon)).outlines) == 1


def test_vertices_in_csv_in_any_order_of_columns(tmp_path: Path) -> None:
    path = tmp_path / "o.csv"
    rows = [f"{x},{k},{y},2020-12-{day}" for day in (17, 18) for k, (x, y) in enumerate(RING[:3])]
    path.write_text("\n".join(["lon,vertex,lat,Date", *rows]))
    found = read_observed(path)
    assert len(found.outlines) == 2
    np.testing.assert_array_equal(found.outlines[1].ring, RING[:3])


def test_byu_tracks_are_read_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a68d.csv"
    path.write_text(
        "nic_1,ascat_1,ascat_2,ascat_3,date,nic_2,nic_3\n"
        "-55.5,-55.06,-37.38,1,2020353,-36.4,1\n"  # both saw it: ascat is daily
        "-55.6,-55.10,-37.30,0,2020354,-36.3,1\n"  # ascat interpolated: nic saw it
        "-55.7,-55.20,-37.20,0,2020355,-36.2,0\n"
        "0,0,0,0,2020356,0,0\n"
    )
    fixes = read_observed(path).fixes
    assert [(f.name, f.when.day, f.lat, f.lon, f.interpolated) for f in fixes] == [
        ("A68D", 18, -55.06, -37.38, False),
        ("A68D", 19, -55.6, -36.3, False),
        ("A68D", 20, -55.2, -37.2, True),
    ]


def test_a_sensor_without_both_coordinates_saw_nothing(tmp_path: Path) -> None:
    """Another sensor has its say then; a column that is not there makes no position either."""
    path = tmp_path / "a68d.csv"
    path.write_text(
        "date,ascat_1,ascat_2,ascat_3,qscat_1,nic_1,nic_2,nic_3\n"
        "2020353,-55.1,,1,-55.2,-55.5,-36.4,1\n"
        "2020354,,-37.2,1,-55.2,-55.6,-36.3,1\n"
    )
    assert [(f.when.day, f.lat, f.lon) for f in read_observed(path).fixes] == [(18, -55.5, -36.4), (19, -55.6, -36.3)]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_score_and_berg_read_the_same_table(tmp_path: Path, separator: str) -> None:
    """Bug: with semicolons a berg was made of it, but it could not be scored."""
    path = tmp_path / "o.csv"
    rows = [
        ("date", "vertex", "Longitude", "latitude"),
        *(("2020-12-17", k, x, y) for k, (x, y) in enumerate(RING[:3])),
        (),
    ]
    path.write_text("\n".join(separator.join(map(str, row)) for row in rows) + "\n")
    (outline,) = read_observed(path).outlines
    (made,) = read_features(path)
    assert outline.when == datetime(2020, 12, 17)
    np.testing.assert_array_equal(outline.ring, np.asarray(made.geometry.exterior.coords)[:-1])
    assert made.date == "2020-12-17"


def test_weekly_tables_of_the_us_national_ice_center(tmp_path: Path) -> None:
    """Columns of 2014 to 2024 and later; month first, a byte order mark, text in the remarks."""
    path = tmp_path / "AntarcticIcebergs_20201211.csv"
    path.write_text(
        "\ufeffIceberg,Length (NM),Width (NM),Latitude,Longitude,Remarks,Last Update\n"
        'A68A,82,26,-55.03,-38.9,"calved, 2017",12/10/2020\nA68D,11,5,-55.52,-36.38,,2020-12-23\n'
    )
    fixes = read_observed(path).fixes
    assert [(f.name, f.when, f.day_only, f.lat, f.lon) for f in fixes] == [
        ("A68A", datetime(2020, 12, 10), True, -55.03, -38.9),
        ("A68D", datetime(2020, 12, 23), True, -55.52, -36.38),
    ]
    other = tmp_path / "o.csv"
    other.write_text("date,lat,lon\n12/10/2020,-55,-39\n")  # nobody can tell which is the month
    with pytest.raises(InputError, match="is not a date"):
        read_observed(other)


def test_a_table_of_states_gives_azimuth_and_area(tmp_path: Path) -> None:
    path = tmp_path / "state.csv"
    path.write_text(
        "date,centroid_lat,centroid_lon,area_km2,mrr_azimuth_deg_mod180\n2020-12-09T13:00,-55,321,4151,190\n"
    )
    (fix,) = read_observed(path).fixes
    assert (fix.lat, fix.lon, fix.area, fix.azimuth, fix.day_only) == (-55.0, 321.0, 4151e6, 10.0, False)


@pytest.mark.parametrize(
    ("text", "when", "day_only"),
    [
        ("2020353", datetime(2020, 12, 18), True),
        ("20201218", datetime(2020, 12, 18), True),
        ("2020-12-18", datetime(2020, 12, 18), True),
        ("2020-12-18T13:00", datetime(2020, 12, 18, 13), False),
        ("2020-12-18T13:00+02:00", datetime(2020, 12, 18, 11), False),
    ],
)
def test_dates(tmp_path: Path, text: str, when: datetime, day_only: bool) -> None:
    (tmp_path / "seen.csv").write_text(f"date,lon,lat\n{text},-39,-55\n")
    assert [(fix.when, fix.day_only) for fix in read_observed(tmp_path / "seen.csv").fixes] == [(when, day_only)]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "date,x,y\n2020-12-01,1,2\n", "no columns of latitude and longitude"),
        ("a.csv", "day of,lat,lon\n1,2,3\n", "no column of dates"),
        ("a.csv", "date,lat,lon\n2020-12-01,abc,2\n", "line 2, lat: 'abc' is not a number"),
        ("a.csv", "date,lat,lon\nyesterday,1,2\n", "'yesterday' is not a date"),
        ("a.csv", "date,lat,lon\n", "no rows"),
        ("a.geojson", "hello", "not JSON"),
        ("a.geojson", json.dumps(feature({"type": "Polygon", "coordinates": [RING]})), "outline 0: no date"),
        ("a.geojson", json.dumps(feature({"type": "Polygon", "coordinates": [[[1, 2], [3, 4]]]}, date="2020-12-01")),
         r"feature 0: not a GeoJSON.*at least 4"),
        ("a.geojson", json.dumps(feature({"type": "Polygon", "coordinates": [[[1, 95], [3, 4], [5, 6]]]}, date="2020-12-01")),
         "latitude beyond 90"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_observed(tmp_path / name)


POLYGON = {"type": "Polygon", "coordinates": [RING]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"type": "FeatureCollection", "features": [feature(None, date="2020-12-01")]}, "no geometry found"),
        ({"type": "FeatureCollection", "features": None}, "its features are no list of features"),
        ({"type": "FeatureCollection", "features": [None]}, "its features are no list of features"),
        (feature({"type": "Polygon", "coordinates": None}, date="2020-12-01"), "no geometry found"),
        (feature({"type": "Polygon", "coordinates": [None]}, date="2020-12-01"), "no polygons"),
        (feature({"type": "Polygon", "coordinates": [[None, *RING]]}, date="2020-12-01"), "feature 0: not a GeoJSON geometry"),
        (feature({"type": "Polygon", "coordinates": [[[-39.0, None], *RING]]}, date="2020-12-01"), "feature 0: not a GeoJSON"),
        (feature({"type": "MultiPolygon", "coordinates": [None]}, date="2020-12-01"), "no polygons"),
        (feature({"type": None, "coordinates": [RING]}, date="2020-12-01"), "feature 0: not a GeoJSON geometry"),
        (feature({"type": "GeometryCollection", "geometries": None}, date="2020-12-01"), "no geometry found"),
        (feature({"type": "GeometryCollection", "geometries": [None, POLYGON]}, date="2020-12-01"), "feature 0: not a GeoJSON"),
        ({"type": "Feature", "properties": None, "geometry": POLYGON}, "outline 0: no date"),
        (feature(POLYGON, date=None), "outline 0: no date"),
    ],
)  # fmt: skip
def test_null_in_geojson_is_named_and_never_python(tmp_path: Path, content: object, message: str) -> None:
    (tmp_path / "o.geojson").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message) as refusal:
        read_observed(tmp_path / "o.geojson")
    assert not re.search("None(Type)?\\b|iterable|subscript", str(refusal.value))


def test_real_tables(shared: Path) -> None:
    outlines = read_observed(shared / "data/observed/a68a_daily_outlines.geojson")
    table = read_observed(shared / "data/observed/a68a_daily_outlines.csv")
    assert len(outlines.outlines) == len(table.outlines) == 28
    track = read_observed(shared / "data/tracks/a68a.csv")
    december = [f for f in track.fixes if f.when == datetime(2020, 12, 9)]
    assert december[0].lat == pytest.approx(-55.0, abs=0.2)
    byu = read_observed(shared / "data/observed/a68_tracks_20201101_20210131_byu.csv")
    assert {f.name for f in byu.fixes} == {"A68A", "A68C", "A68D", "A68E", "A68F", "A68G"}


# --- what would be scored wrongly in silence ------------------------------------------------------------------------------

SQUARE = [(-39.0, -55.0), (-38.0, -55.0), (-38.0, -54.5), (-39.0, -54.5)]


def table(path: Path, order: tuple[int, ...], *, column: str = "vertex", numbers: str = "0123", berg: str = "") -> Path:
    head = f"date,{column},lat,lon" + (",berg" if berg else "")
    rows = [f"2020-12-10,{numbers[k]},{SQUARE[k][1]},{SQUARE[k][0]}{f',{berg}' if berg else ''}" for k in order]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("order", [(2, 0, 3, 1), (3, 2, 1, 0), (0, 2, 1, 3), (1, 1, 0, 2, 3, 3), (0, 1, 2, 3, 0)])
@pytest.mark.parametrize("column", ["vertex", "order", "point"])
def test_corners_are_taken_by_their_numbers_in_whatever_order_they_stand(
    tmp_path: Path, order: tuple[int, ...], column: str
) -> None:
    """A berg of 560 km2 had 142."""
    (outline,) = read_observed(table(tmp_path / "o.csv", order, column=column)).outlines
    np.testing.assert_array_equal(outline.ring, SQUARE)


def test_corners_with_names_stand_in_the_order_of_the_file(tmp_path: Path) -> None:
    (outline,) = read_observed(table(tmp_path / "o.csv", (1, 2, 3, 0), numbers="badc")).outlines
    np.testing.assert_array_equal(outline.ring, [SQUARE[k] for k in (1, 2, 3, 0)])


def test_two_outlines_of_a_date_need_names(tmp_path: Path) -> None:
    path = table(tmp_path / "o.csv", (0, 1, 2, 3))
    moved = [line.replace("-39.0", "-49.0").replace("-38.0", "-48.0") for line in path.read_text().splitlines()[1:]]
    path.write_text(path.read_text() + "\n".join(moved) + "\n")
    with pytest.raises(
        InputError, match=r"o\.csv, 2020-12-10: two corners of one outline have the same number.*column 'berg'"
    ):
        read_observed(path)


@pytest.mark.parametrize("order", [(0, 2, 1, 3), (2, 0, 1, 3)])
@pytest.mark.parametrize("east", [0.0, 218.5])
def test_an_outline_that_crosses_itself_is_refused_where_its_area_is_in_doubt(
    tmp_path: Path, order: tuple[int, ...], east: float
) -> None:
    ring = [[(SQUARE[k][0] + east + 180.0) % 360.0 - 180.0, SQUARE[k][1]] for k in (*order, order[0])]
    with pytest.raises(
        InputError, match=r"outline 0: an outline that crosses itself \(Self-intersection.*in their order"
    ):
        read_observed(
            geojson(tmp_path / "o.json", feature({"type": "Polygon", "coordinates": [ring]}, date="2020-12-17"))
        )
    good = [[(x + east + 180.0) % 360.0 - 180.0, y] for x, y in SQUARE]
    loop = [*good[:3], [good[2][0], good[2][1] + 0.01], [good[2][0] - 0.01, good[2][1] - 0.001], *good[3:], good[0]]
    path = geojson(tmp_path / "o.json", feature({"type": "Polygon", "coordinates": [loop]}, date="2020-12-17"))
    assert len(read_observed(path).outlines) == 1  # a small loop of a hand-drawn line


@pytest.mark.parametrize("twice", ["line by line", "the whole table", "with the longitude written otherwise"])
def test_a_position_given_twice_counts_once(tmp_path: Path, twice: str) -> None:
    """Days whose lines stood twice had twice the weight in the root mean square."""
    rows = [f"2020-12-{day},-55.5,{-39.0 + 0.1 * day},A68A" for day in (10, 11, 12)]
    again = [row.replace("-38.0,", "-38.00,") for row in rows]
    lines = (
        [row for pair in zip(rows, again, strict=True) for row in pair] if twice == "line by line" else [*rows, *again]
    )
    path = tmp_path / "track.csv"
    path.write_text("\n".join(["date,lat,lon,iceberg", *lines]) + "\n")
    assert [fix.when.day for fix in read_observed(path).fixes] == [10, 11, 12]
    path.write_text(path.read_text() + "2020-12-12,-55.5,-37.8,A68D\n")
    assert len(read_observed(path).fixes) == 4  # another berg


NOT_SEEN = [("0", "0"), ("-999", "-999"), ("9999", "9999"), ("-56", "1e20"), ("-99.99", "-38"), ("-32768", "-32768")]


@pytest.mark.parametrize(("lat", "lon"), NOT_SEEN)
def test_numbers_that_stand_for_no_position_are_left_out_with_a_notice(tmp_path: Path, lat: str, lon: str) -> None:
    """Bug: latitude 0, longitude 0 was a position of the berg, and -999 refused the whole table."""
    path = tmp_path / "t.csv"
    rows = [
        "2020-12-09,A68A,-55.9,-38.1",
        f"2020-12-10,A68A,{lat},{lon}",
        "2020-12-11,A68A,,",
        f"2020-12-12,A68A,{lat},{lon}",
    ]
    path.write_text("\n".join(["date,berg,lat,lon", *rows]))
    seen = read_observed(path)
    assert [(fix.lat, fix.lon) for fix in seen.fixes] == [(-55.9, -38.1)]
    (notice,) = seen.notices
    assert "line 3" in notice
    assert notice.endswith("stand for a berg that was not seen, and 1 more")
    path.write_text(f"date,ascat_1,ascat_2,ascat_3,nic_1,nic_2,nic_3\n2020345,{lat},{lon},1,-56,-38,1\n")
    assert [fix.sensor for fix in read_observed(path).fixes] == ["nic"]


@pytest.mark.parametrize(("lat", "lon"), [("0", "-38"), ("-56", "0"), ("-56", "-99"), ("-56", "99.9")])
def test_positions_on_the_equator_and_on_greenwich_are_positions(tmp_path: Path, lat: str, lon: str) -> None:
    (tmp_path / "t.csv").write_text(f"date,lat,lon\n2020-12-09,{lat},{lon}\n")
    seen = read_observed(tmp_path / "t.csv")
    assert [(fix.lat, fix.lon) for fix in seen.fixes] == [(float(lat), float(lon))]
    assert not seen.notices


def test_a_latitude_beyond_the_globe_that_is_no_fill_value_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("date,lat,lon\n2020-12-09,-156,-38\n")
    with pytest.raises(InputError, match="no place on Earth"):
        read_observed(tmp_path / "t.csv")


def test_starts_and_forecasts_at_no_position_are_refused(tmp_path: Path) -> None:
    from riftberg.ensembles.uncertain import read_starts
    from riftberg.verification.tracks import read_forecasts

    (tmp_path / "s.csv").write_text("lon,lat\n-38,-56\n0,0\n")
    with pytest.raises(InputError, match=r"line 3: latitude 0, longitude 0 are no position"):
        read_starts(tmp_path / "s.csv")
    for lon, lat in (("0", "0"), ("-999", "-999")):
        (tmp_path / "f.csv").write_text(f"berg,start,lead_days,lon,lat\nA,2020-12-09,1,{lon},{lat}\n")
        with pytest.raises(InputError, match=r"line 2: .* are no position"):
            read_forecasts(tmp_path / "f.csv")


# Several dates of one observation.

DATES: list[tuple[dict[str, str], str]] = [
    ({"date": "2020-12-08", "acquired": "2020-12-05"}, "2020-12-05T00:00"),
    ({"timestamp": "2021-01-01T00:00", "img_date": "2020-12-05"}, "2020-12-05T00:00"),
    ({"date": "2020-12-05", "datetime": "2020-12-05T06:00"}, "2020-12-05T06:00"),
    ({"date": "2020-12-05", "time": "06:30"}, "2020-12-05T06:30"),
    ({"date": "2020-12-05", "time": "06:30:12.5Z"}, "2020-12-05T06:30:12"),
    ({"acq_date": "2020-12-05", "acq_time": "0630"}, "2020-12-05T06:30"),
    ({"begin": "2020-12-01", "date": "2020-12-05"}, "2020-12-05T00:00"),
    ({"acquired": "Sentinel-1", "date": "2020-12-05"}, "2020-12-05T00:00"),
]


def observed_at(folder: Path, kind: str, dates: dict[str, str]) -> datetime:
    """Write one observation with these dates as a table of positions, of corners, or as a drawing; return when it was read."""
    ring = [(-39.0, -56.0), (-38.0, -56.0), (-38.0, -55.5)]
    path = folder / f"o.{'geojson' if kind == 'drawing' else 'csv'}"
    if kind == "drawing":
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        path.write_text(json.dumps({"type": "Feature", "properties": dates, "geometry": geometry}))
    else:
        corners = kind == "corners"
        rows = [[*dates.values(), str(x), str(y), *([str(k)] if corners else [])] for k, (x, y) in enumerate(ring)]
        names = [*dates, "lon", "lat", *(["vertex"] if corners else [])]
        path.write_text("\n".join(map(",".join, [names, *rows[: None if corners else 1]])) + "\n")
    seen = read_observed(path)
    return [*seen.outlines, *seen.fixes][0].when


@pytest.mark.quick(8)
@pytest.mark.parametrize("kind", ["drawing", "positions", "corners"])
@pytest.mark.parametrize(("dates", "when"), DATES)
def test_the_date_of_the_picture_counts_with_its_time_of_day(
    tmp_path: Path, kind: str, dates: dict[str, str], when: str
) -> None:
    """Of several dates the first of a list was taken, and a column of times beside the date was not read."""
    assert observed_at(tmp_path, kind, dates) == datetime.fromisoformat(when)


@pytest.mark.parametrize("kind", ["drawing", "positions"])
@pytest.mark.parametrize(
    "dates",
    [
        {"date": "2020-12-08", "datetime": "2020-12-05T06:00"},
        {"obs_date": "2020-12-05", "img_date": "2020-12-06"},
    ],
)
def test_dates_of_which_none_can_be_chosen_are_refused_with_both_named(
    tmp_path: Path, kind: str, dates: dict[str, str]
) -> None:
    with pytest.raises(InputError) as told:
        observed_at(tmp_path, kind, dates)
    for name, text in dates.items():
        assert f"{name} says {text[:10]}" in str(told.value)


@pytest.mark.parametrize("text", ["6:30 PM", "25:00", "morning"])
def test_a_time_of_day_that_cannot_be_read_is_told(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="is no time of day"):
        observed_at(tmp_path, "positions", {"date": "2020-12-05", "time": text})
