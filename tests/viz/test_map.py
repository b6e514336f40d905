"""The map of a run: shapes, extents, and the picture itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.image import imread

from fakes import SIDE, FakeModel
from riftberg import draw_map, open_run
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Box, Scene, corner_offsets, element_polygons
from riftberg.viz.records import even_records, telling_records
from riftberg.viz.style import Labels, lay_out

LED = 11.0

RADIUS = 6_363_827.0


def shoelace(corners: np.ndarray) -> float:
    """Area of a polygon."""
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[FakeModel, xr.Dataset]:
    """Run twelve days with a break on the first."""
    path = tmp_path_factory.mktemp("map") / "run.nc"
    model = FakeModel(20, 6)
    model.advance(12, recorders=[RunWriter(path, every_hours=6, experiment="fake")])
    return model, open_run(path)


@pytest.mark.parametrize(("packing", "corners"), [("square", 4), ("hexagonal", 6)])
def test_elements_have_their_true_area_and_orientation(packing: Any, corners: int) -> None:
    lon, lat, angle, area = (np.array([v]) for v in (-39.0, -55.0, 0.3, 9e6))
    polygons = element_polygons(lon, lat, angle, area, packing, latlon=True, radius=RADIUS)
    assert polygons.shape == (1, corners, 2)
    metres = math.radians(1.0) * RADIUS
    plane = (polygons[0] - [-39.0, -55.0]) * [metres * math.cos(math.radians(55.0)), metres]
    assert shoelace(plane) == pytest.approx(9e6, rel=1e-9)
    first = math.atan2(plane[0, 1], plane[0, 0]) - math.atan2(*corner_offsets(packing)[0][::-1])
    assert first == pytest.approx(0.3)


def test_neighbouring_hexagons_share_an_edge() -> None:
    corners = corner_offsets("hexagonal")
    inner = math.sqrt(1.0 / (2.0 * math.sqrt(3.0)))  # radius of the inscribed circle for area 1 (equations 1.4)
    north = corners[np.argsort(corners[:, 1])[-2:]]
    assert north[:, 1] == pytest.approx([inner, inner])


def test_turned_elements_stay_side_by_side(run: tuple[FakeModel, xr.Dataset]) -> None:
    scene = Scene(run[1])
    polygons = scene.polygons(20)
    y = scene.y[20].mean()
    scale = math.radians(1.0) * RADIUS * np.array([math.cos(math.radians(y)), 1.0])
    corners = np.round((polygons.reshape(-1, 2) - polygons.reshape(-1, 2).mean(axis=0)) * scale / 200.0)
    main = np.repeat(scene.berg[20] == 1, 4)
    places = np.unique(corners[main], axis=0)
    # 18 x 6 squares that share their corners have 19 x 7 different ones; some are split by rounding.
    assert len(places) < 1.6 * 19 * 7


def test_a_lattice_that_was_turned_when_made_is_drawn_turned(tmp_path: Path) -> None:
    model = FakeModel(turn_per_day=0.0)
    angle = math.radians(25.0)
    x, y = model._x.copy(), model._y.copy()
    model._x, model._y = x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
    model._place()
    model.advance(0.25, recorders=[RunWriter(tmp_path / "run.nc")])
    assert Scene(open_run(tmp_path)).lattice_angle == pytest.approx(angle, abs=0.01)


def test_dates_are_whole_days_from_first_to_last(run: tuple[FakeModel, xr.Dataset]) -> None:
    scene = Scene(run[1])
    records = even_records(scene, 6)
    assert (records[0], records[-1], len(records)) == (0, 48, 6)
    assert {str(scene.times[k])[11:16] for k in records} == {"13:00"}


def test_dates_of_the_map_show_what_broke_off(run: tuple[FakeModel, xr.Dataset]) -> None:
    """The panels of 16 and 19 December showed nothing of A68a's finger breaking off on the 20th."""
    scene = Scene(run[1])
    births = [born[0] for n in scene.numbers if (born := scene.birth(n)) is not None]
    records = telling_records(scene, 6)
    assert len(births) == 1
    assert len(records) == 6
    assert records[0] == 0
    assert records[-1] == len(scene.times) - 1
    late = [(scene.times[k] - births[0]) / np.timedelta64(1, "h") for k in records]
    assert min(hours for hours in late if hours >= 0.0) <= 9.0
    assert np.diff(records).min() >= len(scene.times) / 15.0


def test_fragments_are_named_by_size_and_tracked_from_birth(run: tuple[FakeModel, xr.Dataset]) -> None:
    scene = Scene(run[1])
    assert scene.numbers == [1, 2]
    assert scene.final_area(2) == 12 * SIDE**2
    _, _, there = scene.track(2)
    assert there[0] == 4
    birth = scene.birth(2)
    assert birth is not None
    assert (str(birth[0])[:13], birth[1]) == ("2020-12-10T13", True)
    assert scene.birth(1) is None


def test_dates_before_its_birth_stand_on_the_track_of_the_parent(run: tuple[FakeModel, xr.Dataset]) -> None:
    """Named for a map whose largest piece at the end was a fragment: all earlier dates stood at the place of its birth."""
    scene = Scene(run[1])
    born = int(np.flatnonzero((scene.berg == 2).any(axis=1))[0])
    assert [scene.ancestor(2, record) for record in (0, born - 1, born, -1)] == [1, 1, 2, 2]
    assert scene.ancestor(1, 0) == 1


def test_a_berg_on_the_date_line_stays_in_one_piece(tmp_path: Path) -> None:
    model = FakeModel(lon=179.9, lat=-70.0)
    model.elements.lon[model.elements.lon > 180.0] -= 360.0
    model.advance(0.5, recorders=[RunWriter(tmp_path / "run.nc")])
    box = Scene(open_run(tmp_path)).box()
    assert box.east - box.west < 3.0


def test_the_picture_is_drawn(run: tuple[FakeModel, xr.Dataset], tmp_path: Path) -> None:
    model, ds = run
    ring = np.array([[-39.5, -55.1], [-38.5, -55.1], [-38.5, -54.9], [-39.5, -55.1]])
    path = draw_map(ds, tmp_path / "map.png", forcing=model.forcing, observed={"2020-12-09": [ring]}, dpi=60)
    picture = imread(path)
    assert picture.shape[1] > 1.5 * picture.shape[0]
    colours = np.unique((255 * picture[..., :3]).astype(int).reshape(-1, 3), axis=0)
    orange = np.abs(colours - [230, 159, 0]).sum(axis=1).min()
    green = np.abs(colours - [0, 158, 115]).sum(axis=1).min()
    assert max(orange, green) < 6  # both fragments are there in their colours


def test_a_run_in_metres_without_a_period_is_drawn_where_it_was(tmp_path: Path) -> None:
    """Metres were folded to 360 around the first element, and the margins took the cosine of metres."""
    model = FakeModel(20, 6, latlon=False)
    model.parameters = model.parameters.changed(earth={"period": 0.0})
    model.advance(1.0, recorders=[RunWriter(tmp_path / "run.nc", every_hours=6)])
    run = open_run(tmp_path)
    scene = Scene(run)
    np.testing.assert_array_equal(scene.x, run["x"].transpose("time", "trajectory").values)
    box = Box(0.0, 40e3, 85e3, 105e3).grown(0.1, latlon=scene.latlon)
    assert (box.west, box.east, box.south, box.north) == (-4e3, 44e3, 81e3, 109e3)


def test_the_scale_of_the_current_is_that_of_the_panels(run: tuple[FakeModel, xr.Dataset]) -> None:
    """The bar of the dates went by the square root, the currents beside it did not."""
    model, ds = run
    figure = draw_map(ds, forcing=model.forcing)
    images = [image for ax in figure.axes for image in ax.images if ax.get_title()]
    (bar,) = figure.axes[-1].collections[-1:]
    image, speeds = images[0], np.linspace(0.0, 0.2, 9)
    assert len(images) == 6
    np.testing.assert_allclose(image.norm(speeds), bar.norm(speeds))
    np.testing.assert_allclose(image.cmap(image.norm(speeds)), bar.cmap(bar.norm(speeds)))


@pytest.mark.quick(1)
@pytest.mark.parametrize("latlon", [True, False])
def test_the_picture_needs_neither_forcing_nor_bonds_nor_many_records(tmp_path: Path, latlon: bool) -> None:
    model = FakeModel(1, 1, latlon=latlon)
    model.advance(1 / 48, recorders=[RunWriter(tmp_path / "run.nc")])
    assert draw_map(open_run(tmp_path), tmp_path / "map.png", dpi=50).stat().st_size > 5000


@pytest.mark.parametrize(
    ("lon", "lat", "east", "north"), [(-38.5, -55.0, "W", "S"), (321.5, 20.0, "W", "N"), (10.0, -55.0, "E", "S")]
)
def test_degrees_are_labelled_by_hemisphere(tmp_path: Path, lon: float, lat: float, east: str, north: str) -> None:
    FakeModel(lon=lon, lat=lat).advance(0.5, recorders=[RunWriter(tmp_path / "run.nc")])
    figure = draw_map(open_run(tmp_path))
    figure.canvas.draw()
    for ax in [ax for ax in figure.axes if ax.get_title()][:1]:
        for axis, degrees, end in ((ax.xaxis, (lon + 180.0) % 360.0 - 180.0, east), (ax.yaxis, lat, north)):
            labels = [label.get_text() for label in axis.get_ticklabels() if label.get_text()]
            assert labels
            for text in labels:
                assert text[-2:] == f"°{end}"
                assert float(text[:-2]) == pytest.approx(abs(degrees), abs=1.0)


def test_scale_bars_are_round(tmp_path: Path) -> None:
    lengths = set()
    for nx in (1, 4, 20, 60):
        (tmp_path / f"{nx}").mkdir()
        FakeModel(nx, 1, break_time=math.inf).advance(0.5, recorders=[RunWriter(tmp_path / f"{nx}" / "run.nc")])
        figure = draw_map(open_run(tmp_path / f"{nx}"))
        lengths |= {text.get_text() for ax in figure.axes for text in ax.texts if text.get_text().endswith(" km")}
    assert len(lengths) > 2
    assert lengths <= {f"{figure}{zeros} km" for figure in "125" for zeros in ("", "0", "00")}


def test_labels_never_overlap() -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = Figure(figsize=(4, 3))
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    labels = Labels(ax)
    placed = [labels.put("12 Dec", 0.5 + 0.002 * k, 0.5) for k in range(60)]
    assert 0 < sum(placed) < 60
    boxes = [text.get_window_extent() for text in ax.texts if text.get_text()]
    assert len(boxes) == sum(placed)
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    # A label that stands away from its point is joined to it by a line.
    led = [text for text in ax.texts if text.get_text() and np.hypot(*text.get_position()) > LED]
    lines = [text for text in ax.texts if not text.get_text()]
    assert led
    assert sorted(text.xy for text in led) == sorted(text.xy for text in lines)


@pytest.mark.parametrize("heights", [0.4, 2.5])
def test_maps_that_are_laid_out_keep_their_place_when_they_are_drawn(heights: float) -> None:
    """Bug: the shape of a map was set when it was drawn, after labels had found their places: they lay on stars."""
    figure = Figure(figsize=(6.0, 4.0), dpi=50, layout="constrained")
    ax = figure.subplots()
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, heights), aspect="equal")
    lay_out(figure)
    laid_out = ax.transData.transform((0.3, 0.2))
    figure.canvas.draw()
    np.testing.assert_allclose(ax.transData.transform((0.3, 0.2)), laid_out, atol=1e-6)


@pytest.mark.slow
def test_a_notebook_shows_the_figure_without_pyplot(run: tuple[FakeModel, xr.Dataset]) -> None:
    """Bug: a kernel that had not imported pyplot showed ``<Figure size ...>``; IPython asks objects for a picture."""
    assert draw_map(run[1], dpi=30)._repr_png_().startswith(b"\x89PNG")
