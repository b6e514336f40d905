"""Coastlines: drawn from the files that cartopy has, and never fetched."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from fakes import FakeModel
from riftberg import draw_dates, draw_map, open_run
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Box, Scene
from riftberg.viz import animate
from riftberg.viz import coast as basemap
from riftberg.viz.animate import write_film
from riftberg.viz.panels import Map

LAND = "#D3CBBB"
SHELF = "#F1F4F6"

SQUARE = [(-38.9, -54.95), (-38.5, -54.95), (-38.5, -54.8), (-38.9, -54.8), (-38.9, -54.95)]
LAKE = [(-38.8, -54.9), (-38.8, -54.85), (-38.7, -54.85), (-38.7, -54.9), (-38.8, -54.9)]
SOUTH_GEORGIA = Box(-38.4, -35.6, -55.0, -53.9)
CLOSE = Box(-39.5, -38.0, -55.2, -54.6)


def write_layer(folder: Path, name: str, *rings: Any, resolution: str = "10m", lines: bool = False) -> None:
    """Write a stand-in for a layer of Natural Earth where cartopy looks for it."""
    writer = pytest.importorskip("shapefile").Writer
    place = folder / "shapefiles" / "natural_earth" / "physical"
    place.mkdir(parents=True, exist_ok=True)
    with writer(str(place / f"ne_{resolution}_{name}.shp")) as layer:
        layer.field("featurecla", "C", 20)
        (layer.line if lines else layer.poly)([ring[::-1] for ring in rings])
        layer.record(name)


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a data folder of cartopy's own, empty; whoever goes to the network fails."""
    cartopy = pytest.importorskip("cartopy")
    io = pytest.importorskip("cartopy.io")

    def refused(*arguments: Any, **how: Any) -> None:
        raise AssertionError("went to the network")

    for name in ("data_dir", "pre_existing_data_dir"):
        monkeypatch.setitem(cartopy.config, name, tmp_path / name)
    monkeypatch.setattr(io, "urlopen", refused)
    forget()
    yield tmp_path / "data_dir"
    forget()


def forget() -> None:
    """Forget shapes that were read before."""
    basemap.clip_coast.cache_clear()
    basemap._shapes.cache_clear()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Run two days near the square."""
    path = tmp_path_factory.mktemp("coast") / "run.nc"
    FakeModel().advance(2, recorders=[RunWriter(path, every_hours=12, experiment="fake")])
    return open_run(path)


def part_in(path: Path, colour: str) -> float:
    """Return the part of a picture that has a colour."""
    picture = imread(path)[..., :3]
    return float((np.abs(picture - np.array(to_rgb(colour))).sum(axis=-1) < 0.02).mean())


def axes(box: Box) -> Any:
    """Return axes of an extent."""
    figure = Figure(figsize=(4, 3))
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    ax.set_xlim(box.west, box.east)
    ax.set_ylim(box.south, box.north)
    return ax


def test_land_with_its_lake_is_drawn_from_the_local_file_and_the_extent_stays(data: Path) -> None:
    write_layer(data, "land", SQUARE, LAKE)
    ax = axes(CLOSE)
    assert basemap.draw_coast(ax, CLOSE)
    assert (*ax.get_xlim(), *ax.get_ylim()) == (CLOSE.west, CLOSE.east, CLOSE.south, CLOSE.north)
    areas, lines = basemap.clip_coast(CLOSE)
    assert sum(polygon.area for polygon, _ in areas) == pytest.approx(0.4 * 0.15 - 0.1 * 0.05)
    assert len(lines) == 2
    inside = areas[0][0]
    path = basemap.polygon_path(inside)
    assert path.contains_point((-38.6, -54.9))
    ax.figure.savefig(data / "land.png")
    place = ax.get_position()
    whole = (CLOSE.east - CLOSE.west) * (CLOSE.north - CLOSE.south)
    expected = (0.4 * 0.15 - 0.1 * 0.05) / whole * place.width * place.height
    assert part_in(data / "land.png", LAND) == pytest.approx(expected, rel=0.15)


def test_pictures_show_the_coast_where_there_is_one(data: Path, run: xr.Dataset, tmp_path: Path) -> None:
    write_layer(data, "land", SQUARE)
    forget()
    draw_map(run, tmp_path / "map.png", dpi=60)
    draw_dates(run, tmp_path / "dates.png", dpi=60)
    write_film(run, tmp_path / "film.gif", hours=24, dpi=50)
    for name in ("map", "dates"):
        assert part_in(tmp_path / f"{name}.png", LAND) > 0.005
    from PIL import Image

    with Image.open(tmp_path / "film.gif") as film:
        pixels = np.asarray(film.convert("RGB")).reshape(-1, 3) / 255.0
    assert (np.abs(pixels - to_rgb(LAND)).sum(axis=1) < 0.05).mean() > 0.005


def test_without_cartopy_or_its_files_the_coast_of_the_package_is_drawn(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert basemap.draw_coast(axes(SOUTH_GEORGIA), SOUTH_GEORGIA)
    write_layer(data, "land", SQUARE)
    forget()
    (polygon, _), *more = basemap.clip_coast(Box(-39.5, -38.0, -55.2, -53.5))[0]
    assert not more  # that of cartopy is drawn alone
    assert polygon.area == pytest.approx(0.4 * 0.15)
    for name in [n for n in sys.modules if n == "cartopy" or n.startswith("cartopy.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cartopy", None)
    forget()
    assert basemap.natural_earth("land") is None
    assert basemap.draw_coast(axes(SOUTH_GEORGIA), SOUTH_GEORGIA)


def test_the_coast_of_the_package_is_where_the_land_is(data: Path) -> None:
    """South Georgia with its area of 3,500 km2, an ice shelf, and open sea."""
    areas, lines = basemap.clip_coast(SOUTH_GEORGIA)
    km2 = sum(part.area for part, _ in areas) * 111.2**2 * np.cos(np.radians(54.4))
    assert km2 == pytest.approx(3500.0, rel=0.1)
    assert lines
    ronne = basemap.clip_coast(Box(-62.0, -48.0, -78.5, -76.0))[0]
    assert sum(part.area for part, colour in ronne if colour == SHELF) > 15.0
    assert basemap.clip_coast(Box(-41.0, -39.5, -57.0, -56.0)) == ([], [])


@pytest.mark.parametrize(("box", "cut"), [((-80.0, -50.0, -45.0, -25.0), -35.0), ((-10.0, 20.0, 30.0, 50.0), 40.0)])
def test_cuts_of_the_package_are_no_coasts(data: Path, box: tuple[float, ...], cut: float) -> None:
    for line in basemap.clip_coast(Box(*box))[1]:
        y = np.asarray(line.coords)[:, 1]
        assert not ((np.abs(y[1:] - cut) < 0.01) & (np.abs(y[:-1] - cut) < 0.01)).any()


def test_neither_date_line_nor_pole_are_coasts(data: Path) -> None:
    for line in basemap.clip_coast(Box(150.0, 210.0, -90.0, -60.0))[1]:
        x, y = np.asarray(line.coords).T
        assert y.min() > -89.9
        assert not ((np.abs(x[1:] - 180.0) < 0.005) & (np.abs(x[:-1] - 180.0) < 0.005)).any()


def test_ice_that_floats_over_land_is_noticed(data: Path) -> None:
    write_layer(data, "land", SQUARE)
    time = np.array(["2020-12-09T00", "2020-12-09T12"], "M8[ns]")
    ice = ("time", "trajectory"), np.full((2, 2), 200.0)
    floor = np.array([[4000.0, 4000.0], [4000.0, 600.0]])

    def run(lon: list[list[float]], depth: Any) -> xr.Dataset:
        place = {"lon": (ice[0], np.array(lon)), "lat": (ice[0], np.full((2, 2), -54.9))}
        return xr.Dataset({**place, "depth": (ice[0], depth), "thickness": ice}, {"time": time})

    ashore = run([[-39.2, -39.0], [-39.1, -38.87]], floor)
    found = "from 2020-12-09 12:00 on ice of this run floats over land of the map, at 54.9 S, 38.9 W"
    assert basemap.ice_over_land(ashore).startswith(f"{found}: its sea floor is 600 m deep there")
    assert "it has no sea floor" in basemap.ice_over_land(
        run([[-39.2, -39.0], [-39.1, -38.87]], np.full((2, 2), 10000.0))
    )
    assert not basemap.ice_over_land(run([[-39.2, -39.0], [-39.1, -38.95]], floor))  # beside it
    assert not basemap.ice_over_land(run([[-39.2, -39.0], [-39.1, -38.87]], np.full((2, 2), 150.0)))  # aground


def test_a_run_in_metres_has_no_coast(data: Path) -> None:
    write_layer(data, "land", SQUARE)
    assert Map(axes(CLOSE), CLOSE).coast == {LAND}
    assert not Map(axes(CLOSE), CLOSE, latlon=False).coast


@pytest.mark.parametrize("turn", [-360.0, 0.0, 360.0])
def test_land_is_found_on_any_branch_of_the_longitudes(data: Path, turn: float) -> None:
    write_layer(data, "land", SQUARE)
    areas, _ = basemap.clip_coast(Box(CLOSE.west + turn, CLOSE.east + turn, CLOSE.south, CLOSE.north))
    assert areas[0][0].bounds == pytest.approx((-38.9 + turn, -54.95, -38.5 + turn, -54.8))


def test_the_coastline_layer_replaces_the_edges_of_the_land(data: Path) -> None:
    write_layer(data, "land", SQUARE)
    write_layer(data, "coastline", SQUARE[:3], lines=True)  # as the continent, whose edge at 180 degrees is no shore
    _, lines = basemap.clip_coast(CLOSE)
    assert sum(line.length for line in lines) == pytest.approx(0.4 + 0.15)


def test_a_continent_is_cut_outside_of_the_map(data: Path) -> None:
    write_layer(data, "land", [(-60.0, -80.0), (0.0, -80.0), (0.0, -54.9), (-60.0, -54.9), (-60.0, -80.0)])
    ax = axes(CLOSE)
    assert basemap.draw_coast(ax, CLOSE)
    (polygon, _), *_ = basemap.clip_coast(CLOSE)[0]
    west, south, east, north = polygon.bounds
    assert west < CLOSE.west
    assert east > CLOSE.east
    assert south < CLOSE.south
    assert north == pytest.approx(-54.9)


def test_each_frame_of_a_film_shows_where_the_map_lies(run: xr.Dataset) -> None:
    film = animate._Film(Scene(run), None, {}, 50)
    for record in (0, 1):
        film.draw(record)
        assert film.inset is not None
        assert film.ax.child_axes == [film.inset]
        # In a corner, but not in that of the date.
        box, frame = film.inset.get_window_extent(), film.ax.get_window_extent()
        assert not (box.x0 < frame.x0 + 0.3 * frame.width and box.y1 > frame.y1 - 0.1 * frame.height)
