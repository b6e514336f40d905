"""Limits of ice, positions and ice near a place, from forecasts made by hand, and the files of the command."""

from __future__ import annotations

import csv
import itertools
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import xarray as xr
from typer.testing import CliRunner

from riftberg.cli.main import app
from riftberg.ensembles.hazard import approach, smallest_line
from riftberg.ensembles.probability import told
from riftberg.ensembles.result import write_sweep

from .made import forecast_of, limits_of, outcome, table_of, wilson

DEGREE = 111.195  # km


def standing(lons: list[float], lat: float = -56.0, area: float = 100e6) -> xr.Dataset:
    """Return a forecast whose members stay where they are."""
    return forecast_of([outcome(k, [lon, lon], [lat, lat], area=area) for k, lon in enumerate(lons)], 1)


def test_the_limit_holds_whole_members_and_is_no_contour_of_presence(tmp_path: Path) -> None:
    """Ten bergs far from each other: the 50 % limit surrounds five of them, where no cell has a presence above 10 %."""
    ds = standing([-40.0 + 0.5 * k for k in range(10)])
    assert ds["presence"].values.max() == pytest.approx(0.1)
    (limit,) = limits_of(ds, tmp_path, 50, "whole time")
    assert limit.inside == pytest.approx(0.5)
    inside = [limit.shape.contains(shapely.Point(-40.0 + 0.5 * k, -56.0)) for k in range(10)]
    assert sum(inside) == 5
    # The smallest such line: five next to each other.
    west, _, east, _ = limit.shape.bounds
    assert east - west == pytest.approx(2.0, abs=0.4)


def test_all_ice_of_a_member_lies_inside_also_its_pieces(tmp_path: Path) -> None:
    members = [outcome(k, [-37.0] * 3, [-56.0] * 3, broken=1) for k in range(12)]
    ds = forecast_of(members, 2)
    (whole,) = limits_of(ds, tmp_path, 90, "whole time")
    shape = whole.shape.buffer(1e-5)  # positions in files have five digits
    for lat, area in ((-56.0, 100e6), (-55.9, 30e6)):  # the piece drifts 0.1 degrees to the north
        radius = np.sqrt(area / np.pi) / 1e3 / DEGREE
        for angle in np.linspace(0.0, 6.28, 12):
            corner = -37.0 + radius * np.cos(angle) / np.cos(np.deg2rad(lat)), lat + radius * np.sin(angle)
            assert shape.contains(shapely.Point(corner))
    first = limits_of(ds, tmp_path, 90)[1]
    assert first.shape.area < 0.9 * shape.area  # on the first day there is no piece yet


def test_the_limit_of_half_holds_one_of_two_groups_far_apart(tmp_path: Path) -> None:
    """Leaving out one member after another took them from both groups in turn, and the line joined what was left."""
    ends = [-37.0, -36.8, -36.6, -20.0, -19.8, -19.6] * 2
    ds = forecast_of([outcome(k, [lon] * 2, [-55.0] * 2) for k, lon in enumerate(ends)], 1)
    half = limits_of(ds, tmp_path, 50)[0]
    west, _, east, _ = half.shape.bounds
    assert east - west < 1.0
    assert half.inside == pytest.approx(0.5)


def test_limits_are_nearly_the_smallest_of_all_choices_of_members() -> None:
    random, angle = np.random.default_rng(5), 2.0 * np.pi * np.arange(12) / 12
    disc = 0.15 * np.column_stack([np.cos(angle), np.sin(angle)])
    for spread in (np.eye(2), np.diag([4.0, 0.5])):
        for _ in range(8):
            points = [place + disc for place in random.standard_normal((8, 2)) @ spread]
            line, inside = smallest_line(points, np.full(8, 0.125), 0.6)
            hulls = (shapely.MultiPoint(np.concatenate(five)).convex_hull for five in itertools.combinations(points, 5))
            assert shapely.Polygon(line).area < 1.1 * min(hull.area for hull in hulls)
            assert inside == pytest.approx(0.625)
    # Where most members have no ice left, nothing is needed.
    assert len(smallest_line([disc, disc[:0], disc[:0]], np.full(3, 1 / 3), 0.5)[0]) == 0


def test_a_limit_is_no_larger_than_what_is_left_if_one_member_after_another_goes() -> None:
    """22 of 40 members: begun around single members alone it is 3 % larger."""
    random, angle = np.random.default_rng(6), 2.0 * np.pi * np.arange(12) / 12
    disc = 0.15 * np.column_stack([np.cos(angle), np.sin(angle)])
    points = [place + disc for place in random.standard_normal((80, 2))[40:] * [4.0, 0.5]]

    def area(points: list[Any]) -> float:
        return float(shapely.MultiPoint(np.concatenate(points)).convex_hull.area)

    found = shapely.Polygon(smallest_line(points, np.full(40, 1 / 40), 0.55)[0]).area
    while len(points) > 22:
        del points[min(range(len(points)), key=lambda k: area(points[:k] + points[k + 1 :]))]
    assert found < 1.01 * area(points)


def test_members_with_more_weight_are_kept() -> None:
    square = np.array([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)])
    points = [square, square + 0.01, square + np.array([9.0, 0.0])]
    _, inside = smallest_line(points, np.array([0.3, 0.3, 0.4]), 0.6)
    assert inside == pytest.approx(0.6)
    line, inside = smallest_line(points, np.array([0.2, 0.2, 0.6]), 0.6)
    assert inside == pytest.approx(0.6)
    assert line[:, 0].min() == pytest.approx(9.0)


def test_positions_have_the_radii_that_hold_half_and_most_of_the_members(tmp_path: Path) -> None:
    north = np.arange(1, 11) / 100.0  # members from 1.1 to 11 km north of the start
    members = [outcome(k, [-37.0, -37.0], [-56.0, -56.0 + d]) for k, d in enumerate(north)]
    first, last = table_of(forecast_of(members, 1), tmp_path)
    assert float(first["radius_90_km"]) == pytest.approx(0.0, abs=1e-6)
    assert float(last["lat"]) == pytest.approx(-56.0 + north.mean(), abs=1e-4)
    away = np.sort(np.abs(north - north.mean())) * DEGREE
    assert float(last["radius_50_km"]) == pytest.approx(away[4], abs=0.02)
    assert float(last["radius_90_km"]) == pytest.approx(away[8], abs=0.02)


def test_ice_near_a_place_is_found_between_the_tracks_times() -> None:
    """Bergs that pass north of a point within a day: the closest approach lies between two positions."""
    north = [0.1, 0.2, 0.4, 0.8] * 5
    members = [outcome(k, [-38.0, -36.0], [-56.0 + d] * 2, area=4e6) for k, d in enumerate(north)]
    found = approach(forecast_of(members, 1), "rig", shapely.Point(-37.0, -56.0), 25e3)
    radius = np.sqrt(4.0 / np.pi)
    assert found.closest / 1e3 == pytest.approx([d * DEGREE - radius for d in north], abs=0.6)
    assert found.probability.tolist() == [0.0, 0.5]
    assert str(found.first_arrival[1])[:13] in ("2020-12-09T09", "2020-12-09T08")
    area = approach(forecast_of(members, 1), "box", shapely.box(-37.1, -56.2, -36.9, -55.85), 0.0)
    assert area.closest[0] == 0.0
    assert area.probability[-1] == pytest.approx(0.25)


def test_across_the_date_line() -> None:
    members = [outcome(k, [179.5, 180.5], [-60.0, -60.0 + 0.01 * k]) for k in range(5)]
    ds = forecast_of(members, 1)
    found = approach(ds, "rig", shapely.Point(-179.6, -60.0), 10e3)
    assert found.probability[-1] == 1.0


def test_routes_and_areas_across_the_date_line_take_the_short_way() -> None:
    ds = forecast_of([outcome(k, [179.5, 180.5], [-60.0, -60.0]) for k in range(5)], 1)
    area = shapely.Polygon([(179, -60.5), (-179, -60.5), (-179, -59.5), (179, -59.5)])
    assert approach(ds, "area", area, 1e3).probability.tolist() == [1.0, 1.0]
    route = shapely.LineString([(170, -62.0), (-170, -62.0)])  # some 220 km south of the berg
    assert approach(ds, "route", route, 0.0).closest / 1e3 == pytest.approx(2 * DEGREE, abs=8.0)
    # Once around the Earth is no jump.
    assert approach(ds, "south", shapely.box(-180, -90, 180, -59), 0.0).probability[-1] == 1.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a forecast."""
    write_sweep(forecast_of(members_at(-37.0), 2), tmp_path / "forecast.nc")
    return tmp_path


def test_the_files_can_be_read_by_others(folder: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rigs.geojson"
    point = {"type": "Point", "coordinates": [-36.8, -56.0]}
    features = [{"type": "Feature", "properties": {"name": "Rig"}, "geometry": point}]
    features.append({"type": "Feature", "properties": {"name": "nowhere"}, "geometry": None})  # allowed by RFC 7946
    rig.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    said = CliRunner().invoke(
        app, ["hazard", str(folder), "-o", str(tmp_path / "h"), "--near", str(rig), "--within", "5nm"]
    )
    assert said.exit_code == 0, said.output
    assert "Rig: 100 %" in said.output
    assert "Not covered: ice smaller than an element" in said.output
    out = tmp_path / "h"
    document = json.loads((out / "hazard.geojson").read_text())
    kinds = {feature["properties"]["kind"] for feature in document["features"]}
    assert kinds == {"limit of ice", "position", "ellipse of the position"}
    assert all(shapely.from_geojson(json.dumps(feature["geometry"])).is_valid for feature in document["features"])
    root = ElementTree.fromstring((out / "hazard.kml").read_text())
    assert len(root.findall(".//{http://www.opengis.net/kml/2.2}Placemark")) == len(document["features"])
    rows = list(csv.DictReader((out / "hazard.csv").read_text().splitlines()))
    assert [row["date"] for row in rows] == ["2020-12-09T00:00Z", "2020-12-10T00:00Z", "2020-12-11T00:00Z"]
    assert float(rows[-1]["p_broken"]) == pytest.approx(0.4)
    near = list(csv.DictReader((out / "near.csv").read_text().splitlines()))
    assert near[-1]["place"] == "Rig"
    assert float(near[-1]["within_km"]) == pytest.approx(9.26)
    with xr.open_dataset(out / "hazard.nc") as grid:
        assert grid["presence"].dims == ("time", "lat", "lon")
        assert grid["lat"].attrs["standard_name"] == "latitude"
        assert not any("_FillValue" in grid[name].encoding for name in grid.coords)
        # A map has one longitude and one latitude (5.6).
        names = [grid[name].attrs.get("standard_name") for name in grid.variables]
        assert names.count("longitude") == names.count("latitude") == 1
        assert grid.attrs["Conventions"] == "CF-1.11"


def members_at(lon: float) -> list[Any]:
    """Return members that start at a longitude and drift to the east, some of them losing a piece."""
    return [
        outcome(k, [lon, lon + 0.2 + 0.02 * (k % 2), lon + 0.4], [-56.0, -56.0 + 0.01 * k, -56.1], broken=1 if k < 4 else None)
        for k in range(10)
    ]  # fmt: skip


@pytest.fixture(params=[-37.0, 179.9], ids=["Atlantic", "date line"])
def hazards(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A folder of hazards, of a berg in the Atlantic and one that drifts across the date line."""
    write_sweep(forecast_of(members_at(request.param), 2), tmp_path / "forecast.nc")
    said = CliRunner().invoke(app, ["hazard", str(tmp_path)])
    assert said.exit_code == 0, said.output
    return tmp_path / "hazard"


@pytest.mark.quick(1)
def test_maps_lie_where_gdal_and_so_qgis_finds_them(hazards: Path) -> None:
    """The probability of ice by date had its dates last: QGIS took them for longitudes, and laid the map at 0, 0."""
    import rasterio

    with xr.open_dataset(hazards / "hazard.nc") as ours:
        for name, count in (("presence", 3), ("passes", 1)):
            with rasterio.open(f"netcdf:{hazards}/hazard.nc:{name}") as map_:
                assert map_.count == count
                assert map_.crs.is_geographic
                values = map_.read(count)
                row, column = np.unravel_index(values.argmax(), values.shape)
                lon, lat = map_.xy(row, column)
            last = ours[name] if count == 1 else ours[name].isel(time=-1)
            assert float(last.sel(lon=lon, lat=lat, method="nearest")) == pytest.approx(float(values.max()))
            assert float(abs(ours["lon"] - lon).min()) < 1e-9
            assert float(abs(ours["lat"] - lat).min()) < 1e-9


@pytest.mark.quick(2)
@pytest.mark.parametrize("end", ["geojson", "kml"])
def test_shapes_are_read_alike_by_gdal_and_so_by_qgis(hazards: Path, end: str) -> None:
    from pyogrio import list_layers
    from pyogrio.raw import read

    document = json.loads((hazards / "hazard.geojson").read_text())
    found: dict[str, list[Any]] = {}
    for layer in list_layers(hazards / f"hazard.{end}")[:, 0]:
        about, _, shapes, columns = read(hazards / f"hazard.{end}", layer=layer)
        assert about["crs"] == "EPSG:4326"
        kinds = columns[list(about["fields"]).index("kind")]
        for kind, shape in zip(kinds, shapely.from_wkb(shapes), strict=True):
            found.setdefault(str(kind), []).append(shape)
    for feature in document["features"]:
        shape = found[feature["properties"]["kind"]].pop(0)
        assert shape.is_valid
        assert shape.equals_exact(shapely.from_geojson(json.dumps(feature["geometry"])), 1e-9)
    assert not any(found.values())


@pytest.mark.quick(1)
def test_geojson_keeps_the_rules_of_rfc_7946(hazards: Path) -> None:
    document = json.loads((hazards / "hazard.geojson").read_text())
    assert document["type"] == "FeatureCollection"
    assert "crs" not in document  # always WGS 84 (4)
    for feature in document["features"]:
        assert set(feature) >= {"type", "geometry", "properties"}
        geometry = feature["geometry"]
        polygons = {"Point": [], "Polygon": [geometry["coordinates"]], "MultiPolygon": geometry["coordinates"]}
        for ring in (ring for polygon in polygons[geometry["type"]] for ring in polygon):
            assert ring[0] == ring[-1]
            assert len(ring) >= 4
            assert shapely.LinearRing(ring).is_ccw  # outer rings counter-clockwise (3.1.6)
            x = np.array(ring)[:, 0]
            # Cut at the date line (3.1.9): no part reaches around the Earth.
            assert np.ptp(x) < 180.0
            assert np.abs(x).max() <= 180.0


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("place", "within", "message"),
    [
        ('{"type": "FeatureCollection", "features": []}', "5nm", "no geometry found"),
        ('{"type": "Feature", "properties": {}, "geometry": null}', "5nm", "no geometry found"),
        ('{"type": "Point"}', "5nm", "Give points, lines or areas"),
        ("no json", "5nm", "not JSON"),
        ('{"type": "Point", "coordinates": [-36000, -5600000]}', "5nm", "are no degrees"),
        ('{"type": "Point", "coordinates": [-36, -56]}', "-5nm", "Give a distance"),
        ('{"type": "Point", "coordinates": [-36, -56]}', "5kPa", "is in kPa"),
        (
            '{"type": "Point", "coordinates": [-36, -56]}',
            "5",
            "no distance with a unit. Give a distance, such as 5nm or 10km",
        ),
        ('{"type": "Point", "coordinates": [-36, -56]}', "1e3", "no distance with a unit"),
        ('{"type": "Point", "coordinates": [-36, -56]}', " 0.5 ", "no distance with a unit"),
    ],
)
def test_bad_places_are_refused_and_nothing_is_written(
    folder: Path, place: str, within: str, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "place.geojson"
    file.write_text(place)
    said = CliRunner().invoke(
        app, ["hazard", str(folder), "-o", str(tmp_path / "h"), "--near", str(file), f"--within={within}"]
    )
    assert said.exit_code == 2 or said.exit_code == 1
    assert message in " ".join(said.output.split())
    assert not (tmp_path / "h").exists()


FEW: dict[str, tuple[int, list[float] | None]] = {
    "one of three": (3, [1.0, 1e-9, 1e-9]), "nine": (9, None),
    "one of forty": (40, [1.0] + [1e-6] * 39), "two of thirty": (30, [1.0, 1.0] + [0.0] * 28),
}  # fmt: skip
"""Members and their weights, which are those of fewer than ten."""


def spread_out(number: int, weight: list[float] | None) -> xr.Dataset:
    """Return a forecast whose members drift apart and break up, one a day after the other."""
    members = [
        outcome(k, [-37.0, -36.5 + 0.1 * k, -36.0 + 0.2 * k], [-56.0, -56.0, -56.0 + 0.1 * k], broken=1 + k % 2)
        for k in range(number)
    ]
    return forecast_of(members, 2, weight=weight)


@pytest.mark.quick(2)
@pytest.mark.parametrize("kind", FEW)
def test_where_few_members_count_no_file_and_no_line_tells_a_spread(kind: str, tmp_path: Path) -> None:
    """Bug: after sightings that one member met, 90 % lay within an ellipse of 0 by 0 km, and one line was all limits of ice."""
    number, weight = FEW[kind]
    counting = [k for k in range(number) if weight is None or weight[k] > 0.0]
    ds = spread_out(number, weight)
    write_sweep(ds, tmp_path / "forecast.nc")
    said = " ".join([*told(ds), CliRunner().invoke(app, ["hazard", str(tmp_path)]).output])
    assert "ellipse of" not in said
    assert "% limit of ice" not in said
    assert "with 50 %" not in said
    assert f"first break-up in {len(counting)} of {len(counting)} members, 2020-12-10 00:00 to 2020-12-11 00:00" in said
    assert "range of the members" in said
    assert "range of all ice of the members" in said
    features = json.loads((tmp_path / "hazard" / "hazard.geojson").read_text())["features"]
    kinds = [feature["properties"]["kind"] for feature in features]
    assert set(kinds) == {"position", "range of the members' ice"}
    assert not any("percent" in feature["properties"] for feature in features)
    whole = shapely.from_geojson(json.dumps(features[kinds.index("position") - 1]["geometry"]))
    assert all(whole.contains(shapely.Point(-36.0 + 0.2 * k, -56.0 + 0.1 * k)) for k in counting)
    assert (
        "range of the members&#" in (text := (tmp_path / "hazard" / "hazard.kml").read_text())
        or "range of the members'" in text
    )
    last = list(csv.DictReader((tmp_path / "hazard" / "hazard.csv").read_text().splitlines()))[-1]
    assert (last["radius_50_km"], last["radius_90_km"]) == ("", "")
    assert float(last["members_east"]) == pytest.approx(-36.0 + 0.2 * counting[-1])
    assert float(last["members_south"]) == pytest.approx(-56.0)
    with (
        xr.open_dataset(tmp_path / "hazard" / "hazard.nc") as grid,
        xr.open_dataset(tmp_path / "forecast.nc") as forecast,
    ):
        assert not any(name in grid for name in ("cone_major", "cone_minor", "cone_azimuth"))
        assert np.isnan(forecast["cone_major"].values).all()
        for file in (grid, forecast):
            assert float(file["members_north"][-1]) == pytest.approx(-56.0 + 0.1 * counting[-1])


def test_few_members_that_come_near_have_a_first_and_a_last_date_and_ten_have_shares() -> None:
    point = shapely.Point(-35.9, -56.0)
    few, many = (approach(spread_out(number, None), "rig", point, 60e3) for number in (3, 10))
    assert [name for name in few.rows()[-1] if name.startswith("arrival")] == ["arrival_first", "arrival_last"]
    assert few.first_arrival[0] < few.first_arrival[1]
    assert "half of these by" not in few.told()
    assert "median" not in few.told()
    assert few.first_arrival[0].astype("datetime64[m]").item().strftime("%Y-%m-%d %H:%M") in few.told()
    assert "half of these by" in many.told()
    assert [name for name in many.rows()[-1] if name.startswith("arrival")][1] == "arrival_50_percent"


def test_of_few_that_come_near_of_many_members_the_first_and_the_last_date_is_told(tmp_path: Path) -> None:
    """Bug: of thirty members two came near, and half of these by a date."""
    ds = spread_out(30, None)
    write_sweep(ds, tmp_path / "forecast.nc")
    places = [{"type": "Feature", "properties": {"name": name}, "geometry": {"type": "Point", "coordinates": at}}
              for name, at in (("rig", [-30.2, -53.1]), ("start", [-37.0, -56.0]))]  # fmt: skip
    (tmp_path / "places.json").write_text(json.dumps({"type": "FeatureCollection", "features": places}))
    near_by = ["--near", str(tmp_path / "places.json"), "--within", "20km"]
    done = CliRunner().invoke(app, ["hazard", str(tmp_path), *near_by])
    assert done.exit_code == 0, done.output
    rows = {row["place"]: row for row in csv.DictReader((tmp_path / "hazard" / "near.csv").read_text().splitlines())}
    assert (rows["rig"]["arrival_50_percent"], rows["start"]["arrival_first"]) == ("", "")
    assert rows["rig"]["arrival_first"]
    assert rows["start"]["arrival_50_percent"] == "2020-12-09T00:00Z"
    found = approach(ds, "rig", shapely.Point(-30.2, -53.1), 20e3)
    assert 0.0 < found.probability[-1] < 10.0 / 30.0
    assert len(found.first_arrival) == 2
    assert "half of these by" not in found.told()


def test_ten_members_have_limits_radii_and_ellipses(tmp_path: Path) -> None:
    ds = spread_out(10, None)
    assert all(limits_of(ds, tmp_path, percent) for percent in (50, 90, 99))
    assert float(table_of(ds, tmp_path)[-1]["radius_90_km"]) > 0.0
    assert "90 % within an ellipse of" in " ".join(told(ds))
    assert ds["members_west"].values[-1] == pytest.approx(-36.0)


@pytest.mark.parametrize("text", ["5nm", "5 NM", " 5.0 nmi", "9.26 km", "9260m", "9.26e3 m"])
def test_nautical_miles_as_ships_write_them(text: str, folder: Path) -> None:
    (folder / "place.json").write_text('{"type": "Point", "coordinates": [-36.8, -56.0]}')
    said = CliRunner().invoke(app, ["hazard", str(folder), "--near", str(folder / "place.json"), f"--within={text}"])
    assert said.exit_code == 0, said.output
    rows = csv.DictReader((folder / "hazard" / "near.csv").read_text().splitlines())
    assert {float(row["within_km"]) for row in rows} == {9.26}


def test_a_sweep_is_no_forecast(tmp_path: Path) -> None:
    write_sweep(standing([-37.0]).drop_vars(["cone_lon"]), tmp_path / "sweep.nc")
    said = CliRunner().invoke(app, ["hazard", str(tmp_path)])
    assert "holds no forecast" in " ".join(said.output.split())
    assert not (tmp_path / "hazard").exists()


def test_members_without_weight_come_near_nothing() -> None:
    """Bug: after ``riftberg update`` members of weight 0 still told when, and how near, ice comes."""
    ds = standing([-38.0] * 10 + [-40.0] * 8)
    ds["weight"] = "member", [5.0] * 10 + [0.0] * 8
    found = approach(ds, "rig", shapely.Point(-40.0, -56.0), 20e3)
    assert found.probability[-1] == 0.0
    assert np.isnat(found.first_arrival).all()
    km = 2 * DEGREE * np.cos(np.deg2rad(56.0)) - np.sqrt(100 / np.pi)
    assert found.closest / 1e3 == pytest.approx([km] * 10, abs=0.5)
    assert f"closest approach {km:.0f} km, median {km:.0f} km" in found.told()
    # The median is that of the weight, not of the number of members.
    ds["weight"] = "member", [4.0] * 10 + [0.25] * 8
    assert f"closest approach 0 km, median {km:.0f} km" in approach(ds, "rig", shapely.Point(-40.0, -56.0), 20e3).told()


def test_ice_that_comes_after_the_last_whole_hour_has_come() -> None:
    """Bug: tracks were read every hour from the start on, and what is beyond the last whole hour was not seen."""
    ds = standing([-37.0] * 3, area=1e4)
    ds = ds.assign_coords(lead=ds["lead"] * 6.5 / 24.0)
    ds["lat"].values[..., -1] = -55.9
    found = approach(ds, "rig", shapely.Point(-37.0, -55.9), 100.0)
    assert found.probability.tolist() == [0.0, 1.0]
    assert found.closest.tolist() == [0.0] * 3


def test_what_unfinished_members_did_counts_and_the_rest_is_not_known() -> None:
    """Bug: five of ten members lay over the harbour before they ran out of time, and the answer was 0 % (0 to 35)."""
    members = [outcome(k, [-38.0] * 4, [-56.0] * 4) for k in range(5)]
    members += [replace(outcome(k, [-38.0, -40.0], [-56.0] * 2), status="unfinished") for k in range(5, 10)]
    ds = forecast_of(members, 3)
    harbour = approach(ds, "harbour", shapely.Point(-40.0, -56.0), 20e3)
    assert harbour.probability == pytest.approx([0.0, 0.5, 0.5, 0.5])
    assert harbour.low[-1] == pytest.approx(wilson(0.5, 10)[0])
    assert harbour.high[-1] == pytest.approx(wilson(0.5, 10)[1])
    # Where those that are known until the end do not come, the others might.
    far = approach(ds, "far", shapely.Point(-30.0, -56.0), 20e3)
    assert far.probability.tolist() == [0.0] * 4
    assert far.high == pytest.approx([wilson(0.0, 10)[1]] * 2 + [wilson(0.5, 10)[1]] * 2)
    assert far.low.tolist() == [0.0] * 4


@pytest.mark.parametrize("lat", [0.0, -60.0])
def test_the_area_inside_of_a_line_is_that_of_its_parallels(lat: float, tmp_path: Path) -> None:
    write_sweep(ds := standing([10.0 + 0.3 * k for k in range(10)], lat, area=100e6), tmp_path / "forecast.nc")
    said = CliRunner().invoke(app, ["hazard", str(tmp_path)]).output
    told = {int(p): float(km2) for p, km2 in re.findall(r"(\d+) % limit of ice, whole time: (\d+) km2", said)}
    for percent in (50, 90, 99):
        (limit,) = limits_of(ds, tmp_path, percent, "whole time")
        expected = limit.shape.area * np.cos(np.radians(lat)) * DEGREE**2
        assert told[percent] == pytest.approx(expected, rel=5e-3)
