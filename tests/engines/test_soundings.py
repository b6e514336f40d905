"""Soundings of the floor around fragments: bounded for any way, and no summit is missed, however narrow."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import DEGREE
from riftberg.engines.quasi_static.ground.pads import place_points
from riftberg.engines.quasi_static.ground.soundings import Soundings

RADIUS = 6_371_229.0
BOX = np.array([-30e3, -10e3, 30e3, 10e3])
PLAIN = 700.0


def pose_at(lon: float, lat: float, turn: float = 0.7) -> np.ndarray:
    """Axes of a fragment at a place on the sphere."""
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    north, c, s = np.cross(up, east), math.cos(turn), math.sin(turn)
    return np.stack([c * east + s * north, c * north - s * east, up], axis=1)


PLACES = {
    "plane": (False, np.array([[0.8, -0.6, 3e6], [0.6, 0.8, -7e5], [0.0, 0.0, 1.0]])),
    "Weddell Sea": (True, pose_at(-40.0 * DEGREE, -62.0 * DEGREE)),
    "180 degrees east": (True, pose_at(179.95 * DEGREE, -70.0 * DEGREE)),
    "180 degrees west": (True, pose_at(-179.8 * DEGREE, 71.0 * DEGREE, -2.0)),
    "near the North Pole": (True, pose_at(20.0 * DEGREE, 89.8 * DEGREE)),
    "South Pole": (True, pose_at(0.0, -90.0 * DEGREE)),
}


def metres(lon: Any, lat: Any, x: float, y: float, latlon: bool) -> Any:
    """Distance of points from one."""
    if not latlon:
        return lon - x, lat - y
    east = (np.asarray(lon) - x + 180.0) % 360.0 - 180.0
    a = (
        np.sin(0.5 * (lat - y) * DEGREE) ** 2
        + np.cos(lat * DEGREE) * math.cos(y * DEGREE) * np.sin(0.5 * east * DEGREE) ** 2
    )
    return 2.0 * RADIUS * np.arcsin(np.sqrt(a)), np.zeros(np.shape(lon))


def bell(x: float, y: float, latlon: bool, width: float) -> Any:
    """A formula: 600 m high over the plain."""
    return lambda lon, lat: PLAIN - 600.0 * np.exp(-0.5 * np.hypot(*metres(lon, lat, x, y, latlon)) ** 2 / width**2)


def node(x: float, y: float, width: float) -> Any:
    """A chart of which one node is 600 m high, bilinear between the nodes."""

    def depth(lon: Any, lat: Any) -> Any:
        return PLAIN - 600.0 * np.maximum(1.0 - abs(lon - x) / width, 0.0) * np.maximum(1.0 - abs(lat - y) / width, 0.0)

    return depth


@pytest.mark.quick(3)
@pytest.mark.parametrize("where", PLACES)
@pytest.mark.parametrize("reach", [2e3, 15e3])
def test_a_summit_within_reach_is_known_however_narrow(where: str, reach: float) -> None:
    """Tiles have 4.8 km; over the pole, across 180 degrees, and at the rim of what is in reach."""
    latlon, pose = PLACES[where]
    random = np.random.default_rng(5)
    for _ in range(30):
        u, v = random.uniform(BOX[:2] - reach, BOX[2:] + reach)
        x, y = place_points(u, v, pose, latlon, RADIUS)
        floors = [bell(x, y, latlon, 200.0), bell(x, y, latlon, 1000.0)] + ([] if latlon else [node(x, y, 500.0)])
        for depth in floors:
            floor = Soundings(depth, latlon, RADIUS).find_tiles(pose, BOX, reach)
            near = np.hypot(floor.x - u, floor.y - v) < floor.half
            assert floor.least[near].min() <= PLAIN - 600.0
            assert floor.slope[near].max() > 0.6 * 600.0 / 1000.0


@pytest.mark.parametrize("where", PLACES)
def test_soundings_lie_around_the_middles_of_their_tiles(where: str) -> None:
    """Those of each tile come together; their mean is the middle, on the sphere too."""
    (latlon, pose), asked = PLACES[where], []

    def depth(lon: Any, lat: Any) -> Any:
        asked.append(np.stack([lon, lat]).reshape(2, -1, 256).mean(axis=2))
        return np.full(lon.shape, PLAIN)

    floor = Soundings(depth, latlon, RADIUS).find_tiles(pose, BOX, 2e3)
    lon, lat = np.concatenate(asked, axis=1)
    assert lon.size == floor.x.size
    for x, y in zip(floor.x, floor.y, strict=True):
        away = np.hypot(*metres(lon, lat, *place_points(x, y, pose, latlon, RADIUS), latlon))
        assert away.min() < 5.0  # the last row ends at the pole


@pytest.mark.parametrize("where", ["plane", "Weddell Sea", "South Pole"])
def test_the_price_of_a_survey_is_bounded_for_any_way(where: str) -> None:
    """Bug: rasters of two pads over a ring of 45 km took 3e8 points for a berg 3 m thick, and the process was killed."""
    (latlon, pose), asked = PLACES[where], [0]

    def depth(lon: Any, lat: Any) -> Any:
        assert lon.size <= 1 << 18
        asked[0] += lon.size
        return np.full(lon.shape, PLAIN)

    soundings = Soundings(depth, latlon, RADIUS)
    for reach in (1e3, 45e3, 1e6, 3e7):
        for box in (BOX, 1e-3 * BOX, np.array([-3e5, -2e3, 3e5, 2e3])):
            before, floor = asked[0], soundings.find_tiles(pose, box, reach)
            assert 0 < floor.x.size <= 4096
            assert asked[0] - before <= 256 * 4096
            before, again = asked[0], soundings.find_tiles(pose, box, reach)
            assert asked[0] == before
            assert np.array_equal(again.least, floor.least)
            # Soundings that are all alike do not tell that the floor between them is level: it may rise by 1 m in a kilometre.
            assert floor.slope.min() >= 1e-3
            assert floor.slope.max() < 1.1e-3


def test_a_floor_is_sounded_once_on_the_way_over_it() -> None:
    asked = []

    def depth(lon: Any, lat: Any) -> Any:
        asked.append(np.stack([lon, lat], axis=1))
        return np.full(lon.shape, PLAIN)

    soundings, pose = Soundings(depth, False, RADIUS), np.eye(3)
    for way in range(0, 100_000, 7000):
        pose[0, 2] = way
        soundings.find_tiles(pose, BOX, 8e3)
    points = np.concatenate(asked)
    assert len(np.unique(points, axis=0)) == len(points)
    area = (100e3 + 60e3 + 16e3 + 10e3) * (20e3 + 16e3 + 20e3)
    assert len(points) < area / 300.0**2


def test_the_survey_goes_around_all_of_a_berg(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the corners of its ice, not to the middles of its outer elements."""
    boxes, find_tiles = [], Soundings.find_tiles

    def kept(self: Any, pose: Any, box: Any, reach: float) -> Any:
        boxes.append(box)
        return find_tiles(self, pose, box, reach)

    monkeypatch.setattr(Soundings, "find_tiles", kept)
    berg = Iceberg.rectangle(9e3, 6e3, thickness=250.0, placement=(0.0, -60.0), radius=1500.0)
    Model(berg, Forcing.uniform(depth=400.0), Parameters()).step()
    west, south, east, north = np.array(boxes[0])
    assert max(west, -east) <= -4.5e3
    assert max(south, -north) <= -3e3


def landing_loads(monkeypatch: pytest.MonkeyPatch, sea: Any, *, every: bool) -> np.ndarray:
    """Loads of the floor by step; ``every``: all pads are looked at in every step, whatever is known of the floor."""
    if every:
        around = Soundings.find_tiles

        def steep(self: Any, *args: Any) -> Any:
            floor = around(self, *args)
            return floor._replace(least=np.full(floor.least.shape, -1e4), slope=np.full(floor.slope.shape, 1e3))

        monkeypatch.setattr(Soundings, "find_tiles", steep)
    berg = Iceberg.rectangle(9e3, 6e3, thickness=250.0, placement=(0.0, -60.0), velocity=(0.5, 0.1), radius=750.0)
    model = Model(berg, sea, Parameters(fracture={"enabled": False}))
    loads = []
    for _ in range(20):
        model.step()
        loads.append(model.elements.keel.floor_load.copy())
    monkeypatch.undo()
    return np.array(loads)


@pytest.mark.quick(1)
@pytest.mark.parametrize("width", [250.0, 900.0])
def test_a_needle_is_touched_as_when_every_pad_is_asked_in_every_step(
    monkeypatch: pytest.MonkeyPatch, width: float
) -> None:
    """A seamount narrower than a tile of soundings, steeper than 1 in 1, whose top stands 67 m inside the keel."""
    sea = Forcing.uniform(current=(0.5, 0.1)) + Forcing.seamount((0.23, -59.99), height=500.0, width=width, depth=640.0)
    surveyed, asked = (landing_loads(monkeypatch, sea, every=every) for every in (False, True))
    assert surveyed.max() > 0.0
    assert surveyed[0].max() == 0.0
    np.testing.assert_array_equal(surveyed, asked)
