"""Bergs of any size without a word about a radius: at points, smaller than an element, in a cloud around a place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, build
from riftberg.errors import BergError, InputError
from riftberg.plane import EqualAreaPlane

HEAD = """
start: 2020-12-09
days: 1
forcing: {kind: formula, uniform: {current: [0.1, 0.0]}}
berg:
"""


def built(tmp_path: Path, berg: str) -> Any:
    path = tmp_path / "berg.yaml"
    path.write_text(HEAD + "".join(f"  {line}\n" for line in berg.splitlines()))
    return build(str(path))[0]


@pytest.mark.parametrize(("length", "width"), [(300.0, 200.0), (60.0, 60.0), (2000.0, 1500.0), (40.0, 100.0)])
def test_a_rectangle_smaller_than_an_element_is_one_element(length: float, width: float) -> None:
    """It was refused: "the outline (0.06 km2) is smaller than one element (9 km2). Give a radius below 49 m"."""
    berg = Iceberg.rectangle(length, width, thickness=100.0, placement=(-39.0, -56.0))
    e = berg.elements
    assert (e.size, berg.bonds.first.size) == (1, 0)
    assert (float(e.length[0]), float(e.width[0])) == pytest.approx((max(length, width), min(length, width)))
    assert float(e.mass[0]) == pytest.approx(850.0 * length * width * 100.0)
    assert berg.centroid == pytest.approx((-39.0, -56.0))


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_an_outline_smaller_than_an_element_keeps_its_area_and_place(packing: Any) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 30)
    plane = EqualAreaPlane(-37.0, -56.0, 6371e3)
    lon, lat = plane.inverse(500.0 + 800.0 * np.cos(turn), 400.0 * np.sin(turn))
    berg = Iceberg.from_outline(np.column_stack([lon, lat]), thickness=150.0, packing=packing)
    assert berg.elements.size == 1
    assert berg.area == pytest.approx(np.pi * 800.0 * 400.0, rel=0.02)
    east, north = plane.forward(berg.elements.lon, berg.elements.lat)
    assert (float(east[0]), float(north[0])) == pytest.approx((500.0, 0.0), abs=5.0)


def test_a_radius_that_is_given_counts_and_a_long_strip_is_no_element() -> None:
    assert Iceberg.rectangle(300.0, 200.0, thickness=50.0, placement=(0.0, -60.0), radius=25.0).elements.size == 24
    with pytest.raises(BergError, match="smaller than one element"):
        Iceberg.rectangle(300.0, 200.0, thickness=50.0, placement=(0.0, -60.0), radius=1500.0)
    with pytest.raises(BergError, match="Give a radius below"):
        Iceberg.rectangle(20e3, 100.0, thickness=50.0, placement=(0.0, -60.0))


def test_points_with_length_and_width_are_lone_bergs() -> None:
    berg = Iceberg.from_points(
        [-37.0, -36.99, -36.98],
        -56.0,
        length=["300 m", "0.4 km", "100 m"],
        width=[200.0, 100.0, 150.0],
        thickness=[50.0, 60.0, 70.0],
    )
    e = berg.elements
    np.testing.assert_allclose(e.length, [300.0, 400.0, 150.0])
    np.testing.assert_allclose(e.width, [200.0, 100.0, 100.0])
    np.testing.assert_allclose(e.mass, 850.0 * np.array([60e3 * 50, 40e3 * 60, 15e3 * 70]))
    assert berg.bonds.first.size == 0
    assert len(berg.bergs) == 3
    one = Iceberg.from_points(-37.0, -56.0, length=120.0, thickness=40.0)
    assert (float(one.elements.length[0]), float(one.elements.width[0])) == pytest.approx((120.0, 120.0))
    in_metres = Iceberg.from_points([0.0, 1e3], [0.0, 0.0], length=100.0, thickness=40.0, latlon=False)
    assert in_metres.elements.size == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"width": 100.0}, "a width without a length"),
        ({"length": 100.0, "radius": 50.0}, "radius beside length and width"),
        ({"length": 100.0, "bond_length": 50.0}, "bond_length beside length and width"),
        ({"length": 100.0, "pieces": [1, 2]}, "pieces beside length and width"),
        ({"length": [100.0, -5.0]}, "a length that no berg has"),
        ({"length": [100.0, float("nan")]}, "a length that no berg has"),
        ({"length": [100.0, 90.0, 80.0]}, "3 values for 2 bergs"),
        ({"length": 5000.0}, "overlap"),
    ],
)
def test_sizes_that_cannot_be_are_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(BergError, match=said) as error:
        Iceberg.from_points([-37.0, -36.99], [-56.0, -56.0], thickness=50.0, **options)
    assert error.value.remedy


@pytest.mark.parametrize("sizes", [{"length": 300.0, "width": 200.0}, {"length": "150 m"}, {}, {"sizes": "tournadre"}])
def test_a_cloud_lies_within_its_radius_and_its_bergs_do_not_touch(sizes: dict[str, Any]) -> None:
    cloud = Iceberg.cloud(60, (179.95, -66.0), "20 km", seed=4, gap=10.0, **sizes)
    plane = EqualAreaPlane(179.95, -66.0, 6371e3)
    x, y = plane.forward(cloud.elements.lon, cloud.elements.lat)
    assert np.hypot(x, y).max() < 20.1e3
    assert np.hypot(x, y).max() > 15e3
    reach = 0.5 * np.hypot(cloud.elements.length, cloud.elements.width)
    apart = np.hypot(x[:, None] - x, y[:, None] - y) - reach[:, None] - reach
    assert apart[~np.eye(60, dtype=bool)].min() > 9.0
    again = Iceberg.cloud(60, (179.95, -66.0), 20e3, seed=4, gap=10.0, **sizes)
    assert again.elements.lon.tobytes() == cloud.elements.lon.tobytes()
    assert Iceberg.cloud(60, (179.95, -66.0), 20e3, seed=5, gap=10.0, **sizes).elements.lon[0] != cloud.elements.lon[0]


def test_bergs_of_a_cloud_overlap_where_that_is_asked_and_they_do_not_act_on_each_other() -> None:
    cloud = Iceberg.cloud(40, (0.0, -60.0), 500.0, length=400.0, thickness=80.0, seed=1, overlap=True)
    ocean = Forcing.uniform(current=(0.2, 0.0))
    with pytest.raises(BergError, match="overlap"):
        Model(cloud, ocean)
    model = Model(cloud, ocean, Parameters().changed(stepping={"interactions": False}))
    model.advance(steps=4)
    assert np.ptp(model.elements.u) < 2e-5  # that of f between their latitudes


def test_a_cloud_without_room_is_refused() -> None:
    with pytest.raises(BergError, match="no place is left for berg"):
        Iceberg.cloud(40, (0.0, -60.0), 500.0, length=400.0, seed=1)
    with pytest.raises(BergError, match="width without a length"):
        Iceberg.cloud(4, (0.0, -60.0), 500.0, width=400.0)


def test_a_cloud_in_metres_spreads_evenly() -> None:
    cloud = Iceberg.cloud(400, (1e5, 2e5), 10e3, length=20.0, thickness=10.0, seed=2, latlon=False)
    away = np.hypot(cloud.elements.lon - 1e5, cloud.elements.lat - 2e5)
    assert 0.4 < np.mean(away < 10e3 / np.sqrt(2.0)) < 0.6  # half of them in half of the area


def test_a_file_gives_points_clouds_and_small_bergs(tmp_path: Path) -> None:
    (tmp_path / "bergs.csv").write_text("lon,lat,length,width,thickness\n-37,-56,300,200,80\n-36.9,-56,900,500,150\n")
    model = built(tmp_path, "points: bergs.csv")
    np.testing.assert_allclose(model.elements.length, [300.0, 900.0])
    np.testing.assert_allclose(model.elements.thickness, [80.0, 150.0])
    (tmp_path / "semi.csv").write_text("longitude;latitude;length\n-37,5;-56;300\n")
    assert float(built(tmp_path, "points: {file: semi.csv}\nthickness: 60 m").elements.thickness[0]) == 60.0
    model = built(
        tmp_path, "seed: {number: 20, radius: 5 km, length: 200 m, seed: 3}\nplacement: [-37, -56]\nthickness: 90 m"
    )
    assert model.elements.size == 20
    assert (
        built(
            tmp_path, "rectangle: {length: 300 m, width: 200 m}\nplacement: [-37, -56]\nthickness: 80 m"
        ).elements.size
        == 1
    )


@pytest.mark.parametrize(
    ("berg", "said"),
    [
        ("points: none.csv", "none.csv"),
        ("points: bad.csv", "the length 'long' is no number"),
        ("points: plain.csv", "no columns of longitude and latitude"),
        ("points: good.csv\nradius: 20 m", "a radius beside lengths"),
        ("points: good.csv\nplacement: [-37, -56]", "points has no placement"),
        ("seed: {number: 5, radius: 3 km}", "needs placement"),
        ("seed: {number: 5, radius: 3 km, width: 20 m}\nplacement: [-37, -56]", "a width without a length"),
        ("seed: {number: 5, radius: 3 km}\nplacement: [-37, -56]\nrotation: 3", "seed has no rotation"),
    ],
)
def test_tables_and_clouds_that_cannot_be_are_refused(tmp_path: Path, berg: str, said: str) -> None:
    (tmp_path / "good.csv").write_text("lon,lat,length\n-37,-56,300\n")
    (tmp_path / "bad.csv").write_text("lon,lat,length\n-37,-56,long\n")
    (tmp_path / "plain.csv").write_text("a,b\n-37,-56\n")
    with pytest.raises(InputError, match=said):
        built(tmp_path, berg)


def test_lone_bergs_drift() -> None:
    """They go with the water, each for itself."""
    bergs = Iceberg.cloud(10, (-37.0, -56.0), 10e3, length=100.0, thickness=30.0, seed=1)
    model = Model(bergs, Forcing.uniform(current=(0.2, 0.0)))
    east = model.elements.lon.copy()
    model.advance(steps=24)
    way = (model.elements.lon - east) * 111.195e3 * np.cos(np.radians(56.0))
    assert np.ptp(way) < 50.0
    assert 0.7 < float(way.mean()) / (0.2 * 24 * model.parameters.time_step) < 1.0


def test_lone_bergs_may_lie_on_each_other_where_that_is_asked() -> None:
    two = Iceberg.from_points([0.0, 0.0], -60.0, length=400.0, thickness=80.0, overlap=True)
    assert two.elements.lon.tolist() == [0.0, 0.0]
    with pytest.raises(BergError, match="overlap of elements that may be bonded"):
        Iceberg.from_points([0.0, 0.0], -60.0, thickness=80.0, overlap=True)
