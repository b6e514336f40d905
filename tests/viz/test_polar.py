"""Polar stereographic maps and the view of where in the world: true lengths and directions, and when they are taken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from typer.testing import CliRunner

from fakes import SIDE, FakeModel
from riftberg import draw_map, draw_tracks, open_run
from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.plane import ConformalPlane
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Box
from riftberg.viz import style
from riftberg.viz.coast import project_coast
from riftberg.viz.panels import Map, PolarWater, depth_bar

SIZE = 0.24
LAND = "#D3CBBB"
SHELF = "#F1F4F6"

SOUTH = ConformalPlane(-40.0, -90.0, 6.37e6)


def finished(folder: Path, lat: float, lon: float = -39.0) -> xr.Dataset:
    """Run three days at a latitude."""
    FakeModel(lat=lat, lon=lon).advance(
        3, recorders=[RunWriter(folder / f"{lat:g}.nc", every_hours=12, experiment="fake")]
    )
    return open_run(folder / f"{lat:g}.nc")


@pytest.fixture(scope="module")
def south(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return finished(tmp_path_factory.mktemp("south"), -72.0)


def extent(figure: Figure) -> float:
    """Return the width of the overview in the units of its axes."""
    west, east = figure.axes[0].get_xlim()
    return float(east - west)


@pytest.mark.quick(2)
@pytest.mark.parametrize(("lat", "polar"), [(-72.0, True), (72.0, True), (-55.0, False), (20.0, False)])
def test_projection_is_chosen_by_latitude(tmp_path: Path, lat: float, polar: bool) -> None:
    run = finished(tmp_path, lat)
    assert (extent(draw_tracks(run)) > 1e3) == polar  # metres, or degrees


@pytest.mark.slow
def test_projection_can_be_changed(south: xr.Dataset, tmp_path: Path) -> None:
    assert extent(draw_map(south, projection="degrees")) < 10.0
    here = finished(tmp_path, -55.0)
    assert extent(draw_map(here, projection="polar")) > 1e3
    with pytest.raises(InputError, match="mercator"):
        draw_map(here, projection="mercator")  # type: ignore[call-overload]
    FakeModel(latlon=False).advance(1, recorders=[RunWriter(tmp_path / "metres.nc", every_hours=12, experiment="fake")])
    metres = open_run(tmp_path / "metres.nc")
    with pytest.raises(InputError, match="degrees"):
        draw_tracks(metres, projection="polar")


def test_axes_of_the_user_stay_in_degrees(south: xr.Dataset) -> None:
    ax = Figure().subplots()
    draw_map(south, ax=ax)
    assert ax.get_xlim()[1] - ax.get_xlim()[0] < 10.0


def test_option_of_the_command_line(south: xr.Dataset, tmp_path: Path) -> None:
    run = south.encoding["source"]
    call = ["plot", str(run), "-k", "map", "--dpi", "40", "-o", str(tmp_path)]
    done = CliRunner().invoke(app, [*call, "--projection", "mercator"])
    assert done.exit_code != 0
    assert CliRunner().invoke(app, [*call, "--projection", "polar"]).exit_code == 0
    polar = (tmp_path / "map.png").read_bytes()
    assert CliRunner().invoke(app, [*call, "--projection", "degrees"]).exit_code == 0
    assert (tmp_path / "map.png").read_bytes() != polar


@pytest.mark.quick(2)
@pytest.mark.parametrize("lat", [-72.0, -56.0, 56.0, 72.0])
def test_map_around_positions_holds_them_on_any_branch_and_takes_the_pole_beyond_60_degrees(lat: float) -> None:
    lon = np.array([179.5, -179.5, np.nan, 180.2])  # across the date line
    lats = lat + np.array([0.0, 0.5, 7.0, -0.5])  # of the third the longitude is unknown: it is nowhere
    chart = Map.around(Figure().subplots(), lon, lats, margin=0.0)
    assert (chart.plane is not None) == (abs(lat) > 60.0)
    x, y = (v[[0, 1, 3]] for v in chart.placed(lon, lats))
    box = chart.box
    assert min(x.min() - box.west, box.east - x.max(), y.min() - box.south, box.north - y.max()) > -1e-6
    height = (box.north - box.south) / chart.units_per_km
    assert height == pytest.approx(111.19, rel=0.02)  # a degree of latitude; 1 degree of longitude is less
    assert np.hypot(*(v[0] - v[2] for v in (x, y))) / chart.units_per_km > 50.0


@pytest.mark.parametrize(
    ("low", "high"), [(4000.0, 4500.0), (4000.0, 9500.0), (150.0, 250.0), (150.0, 1000.0), (20.0, 5500.0), (0.5, 40.0)]
)
def test_the_scale_of_depth_shows_the_depths_of_the_map(low: float, high: float) -> None:
    """Named for a map of 250 m under a scale from 0 to 12,000 m: one grey for all."""

    class Sloping:
        """A floor from one depth to another."""

        def depth(self, lon: Any, lat: Any) -> Any:
            """Return the depth."""
            return np.linspace(low, high, np.size(lon)).reshape(np.shape(lon))

    chart = Map.around(Figure().subplots(), np.array([-38.0, -36.0]), np.array([-57.0, -56.0]))
    chart.draw_floor(Sloping(), shaded=True)
    steps = np.array(chart.depth_steps)
    assert steps[0] <= low
    assert high <= steps[-1]
    # At least four colours, of which the map has all but the ends.
    assert steps.size >= 5
    assert ((steps > low) & (steps < high)).sum() >= steps.size - 2


@pytest.mark.parametrize("deep", [250.0, 4000.0])
def test_a_floor_of_one_depth_has_no_scale(deep: float) -> None:
    class Flat:
        """A plain."""

        def depth(self, lon: Any, lat: Any) -> Any:
            """Return the depth."""
            return np.full(np.shape(lon), deep)

    chart = Map.around(Figure().subplots(), np.array([-38.0, -36.0]), np.array([-57.0, -56.0]))
    chart.draw_floor(Flat(), shaded=True)
    assert chart.depth_steps == []
    depth_bar(chart)
    assert len(chart.ax.figure.axes) == 1


def test_tracks_have_gaps_where_a_berg_lost_a_part() -> None:
    x, y = style.insert_gaps(np.arange(4.0), np.arange(4.0), np.array([9.0, 8.999, 5.0, 5.0]))
    np.testing.assert_array_equal(x, [0.0, 1.0, np.nan, 2.0, 3.0])
    np.testing.assert_array_equal(y, x)


@pytest.mark.quick(1)
@pytest.mark.parametrize("lat", [-72.0, 72.0])
def test_elements_keep_size_and_shape(tmp_path: Path, lat: float) -> None:
    """A square of 3 km is one on the map, where a map in degrees is true at one latitude alone."""
    run = finished(tmp_path, lat)
    first, second = run["bond_first"].values, run["bond_second"].values
    for ax in [ax for ax in draw_map(run).axes if ax.get_title()][::-5]:
        (ice,) = (c for c in ax.collections if isinstance(c, PolyCollection) and len(c.get_paths()) == 24)
        corners = np.array([path.vertices[:5] for path in ice.get_paths()])
        np.testing.assert_allclose(np.hypot(*np.moveaxis(np.diff(corners, axis=1), -1, 0)), SIDE, rtol=2e-3)
        # Neighbours touch: the distance of their middles is a side.
        middle = corners[:, :4].mean(axis=1)
        apart = np.hypot(*(middle[first] - middle[second]).T)
        assert np.median(apart) == pytest.approx(SIDE, rel=5e-3)
        assert apart.min() == pytest.approx(SIDE, rel=5e-3)  # later some are parted


class Northward:
    """A current of 1 m/s to the north, over a floor as deep as the latitude."""

    def currents(self, lon: Any, lat: Any, time: float) -> Any:
        """Return east and north."""
        return np.zeros(np.shape(lon)), np.ones(np.shape(lon))

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the depth."""
        return -np.asarray(lat)


@pytest.mark.parametrize("pole", [-90.0, 90.0])
def test_northward_current_runs_along_the_meridians(pole: float) -> None:
    plane = ConformalPlane(30.0, pole, 6.37e6)
    water = PolarWater(Northward(), plane)
    lon, lat = np.meshgrid([-20.0, 30.0, 100.0], np.sign(pole) * np.array([62.0, 75.0, 88.0]))
    x, y = plane.forward(lon, lat)
    u, v = water.currents(x, y, 0.0)
    away = (
        -np.sign(pole) * np.stack([x, y]) / np.hypot(x, y)
    )  # north is away from the south pole, and towards the north pole
    np.testing.assert_allclose([u, v], away, atol=1e-12)
    np.testing.assert_allclose(water.depth(x, y), -lat)


def test_land_is_where_it_is() -> None:
    """On the plane as on the sphere; cut edges of the continent's stored parts do not bend over the sea."""
    box = Box(-1.5e6, 1.5e6, 0.6e6, 3.4e6)  # the Weddell Sea, its shelves and the Peninsula
    areas, _ = project_coast(box, SOUTH)

    def under(lon: float, lat: float) -> set[str]:
        point = shapely.Point(*(float(v) for v in SOUTH.forward(np.array(lon), np.array(lat))))
        return {colour for area, colour in areas if area.contains(point)}

    assert under(-65.0, -69.5) == {LAND}  # Peninsula
    assert under(-60.0, -77.5) == {SHELF}  # Ronne
    assert under(-20.0, -80.0) == {LAND}
    for sea in ((-40.0, -70.0), (-30.0, -65.0), (-50.0, -66.0), (-20.0, -72.0)):
        assert under(*sea) == set()


def test_map_around_the_pole_is_covered() -> None:
    areas, _ = project_coast(Box(-5e5, 5e5, -5e5, 5e5), SOUTH)
    assert all(
        any(a.contains(shapely.Point(x, y)) for a, _ in areas) for x, y in ((3e5, 3e5), (-4e5, 1e5), (2e5, -4e5))
    )


def test_degrees_stand_where_meridians_and_parallels_meet_the_edges() -> None:
    box = Box(-2e5, 3e5, 1.8e6, 2.4e6)
    ax = Figure().subplots()
    Map(ax, box, latlon=False, plane=SOUTH)
    for axis, which in ((ax.xaxis, 0), (ax.yaxis, 1)):
        labels = [label.get_text() for label in axis.get_ticklabels()]
        assert len(labels) >= 2
        for place, text in zip(axis.get_ticklocs(), labels, strict=True):
            point = (place, box.south) if which == 0 else (box.west, place)
            degrees = float(SOUTH.inverse(*map(np.array, point))[which])
            assert text[-1] == ("W" if which == 0 else "S")
            assert float(text[:-2]) == pytest.approx(-degrees, abs=0.05)


def test_view_of_the_world_marks_the_place_and_stays_off_the_ice(south: xr.Dataset) -> None:
    figure = draw_tracks(south)
    (inset,) = figure.axes[0].child_axes
    mark = inset.lines[-1]
    x, y = (np.asarray(values).item() for values in (mark.get_xdata(), mark.get_ydata()))
    lon = float(np.degrees(np.arctan2(x, y)))  # 0 degrees is up
    assert lon == pytest.approx(float(south["lon"].mean()), abs=1.0)
    assert 2.0 * np.sin(np.radians(18.0 / 2.0)) == pytest.approx(
        np.hypot(x, y), rel=0.02
    )  # Lambert's plane, 72 degrees south
    figure.canvas.draw()
    frame = inset.get_window_extent()
    for drawn in figure.axes[0].collections:
        if isinstance(drawn, PolyCollection) and drawn.get_array() is None and len(drawn.get_paths()) == 24:
            points = np.concatenate([figure.axes[0].transData.transform(path.vertices) for path in drawn.get_paths()])
            assert not any(frame.contains(*point) for point in points)
    assert frame.width < 1.1 * SIZE * figure.axes[0].get_window_extent().width


@pytest.mark.slow
def test_no_view_where_no_coast_is_known(tmp_path: Path) -> None:
    assert not draw_tracks(finished(tmp_path, 20.0)).axes[0].child_axes
    assert len(draw_tracks(finished(tmp_path, 60.5)).axes[0].child_axes) == 1


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("lat", "lon", "named"), [(-74.9, -60.5, {"land", "ice shelf"}), (-54.5, -38.0, {"land"}), (-58.0, -20.0, set())]
)
def test_legend_names_what_is_on_the_map(tmp_path: Path, lat: float, lon: float, named: set[str]) -> None:
    figure = draw_tracks(finished(tmp_path, lat, lon))
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert texts & {"land", "ice shelf"} == named
