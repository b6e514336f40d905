"""What the pictures show, read from their artists: places, moments, extents, colours and signs, not only that a file is there."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.quiver import QuiverKey

from fakes import SIDE, FakeForcing, FakeModel
from riftberg import (
    A68A_2022,
    Fix,
    Observations,
    Parameters,
    draw_dates,
    draw_fragments,
    draw_map,
    draw_reasons,
    draw_score,
    draw_stress,
    explain,
    open_run,
    score_run,
)
from riftberg.cli.pictures import usual_kinds
from riftberg.engines.common.fragments.tree import Fragment
from riftberg.errors import InputError
from riftberg.runs.background import stored_water
from riftberg.runs.positions import stretch
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.viz import animate, colours, ensemble, style
from riftberg.viz.replay import ReplayContent
from scripts import ROOT

GROUND = "#A50026"
MODEL = "#E69F00"
DOT = 3.0


class Channel(FakeModel):
    """A berg in metres that goes around a channel of 60 km."""

    period = 60e3

    def __init__(self, **how: Any) -> None:
        super().__init__(latlon=False, **how)
        self.parameters = self.parameters.changed(earth={"period": self.period})

    def _place(self) -> None:
        super()._place()
        self.turns = np.floor(self.elements.lon / self.period)
        self.elements.lon[:] = self.elements.lon % self.period


class DateLine(FakeModel):
    """A berg that crosses longitude 180, with longitudes from -180 to 180 or from 0 to 360."""

    def __init__(self, west: float, **how: Any) -> None:
        self.west = west
        super().__init__(lon=179.9, lat=-70.0, **how)

    def _place(self) -> None:
        super()._place()
        self.elements.lon[:] = (self.elements.lon - self.west) % 360.0 + self.west


class Seconds(FakeModel):
    """A run of seconds."""

    def __init__(self) -> None:
        super().__init__(parameters=A68A_2022.changed(stepping={"time_step": 1.0}))


class NoFloor(FakeForcing):
    """Depth 0 where no sea floor is known; the sea level is all that varies."""

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the sea level alone."""
        return 0.3 * np.sin(np.asarray(lon)) + 0.0 * np.asarray(lat)


def finished(model: FakeModel, folder: Path, days: float = 3.0, **how: Any) -> xr.Dataset:
    """Run, and open the file."""
    model.advance(days, recorders=[RunWriter(folder / "run.nc", **{"every_hours": 6, "experiment": "fake", **how})])
    return open_run(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Four days, a break after one."""
    return finished(FakeModel(12, 5), tmp_path_factory.mktemp("drawn"), 4.0)


@pytest.fixture(scope="module")
def picture(run: xr.Dataset) -> Figure:
    """Return the map of that run."""
    return draw_map(run)


def ice(figure: Figure) -> Iterator[np.ndarray]:
    """Return the corners of the elements of each map of a figure."""
    for ax in figure.axes:
        for drawn in ax.collections:
            if isinstance(drawn, PolyCollection) and len(drawn.get_paths()) > 10:
                yield np.concatenate([path.vertices[:-1] for path in drawn.get_paths()])


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the list that will hold the figures that are written."""
    made: list[Figure] = []
    write = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *how, **more: made.append(self) or write(self, *how, **more))
    return made


# ---- places ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_metres_are_not_folded_by_the_period_of_degrees(tmp_path: Path) -> None:
    """Bug: with the default period x was folded modulo 360 m; a beam along x stood upright in the picture."""
    assert Parameters(earth={"latlon": False}).earth.period == 0.0
    assert A68A_2022.changed(earth={"latlon": False}).earth.period == 0.0
    assert Parameters(earth={"latlon": False, "period": 20e3}).earth.period == 20e3
    assert Parameters().earth.period == 360.0
    run = finished(FakeModel(20, 2, latlon=False, turn_per_day=0.0), tmp_path, 0.5)
    # A file that was written before.
    written = json.loads(run.attrs["parameters_json"])
    run.attrs["parameters_json"] = json.dumps({**written, "earth": {**written["earth"], "period": 360.0}})
    for corners in ice(draw_map(run)):
        along, across = np.ptp(corners, axis=0)
        assert along == pytest.approx(20 * SIDE, rel=1e-6)
        assert across == pytest.approx(2 * SIDE, rel=1e-6)


@pytest.mark.slow
def test_no_line_crosses_the_seam_of_a_channel(tmp_path: Path) -> None:
    """Bug: each time the berg came round, its track ran back through the whole channel, and so did its elements."""
    run = finished(Channel(), tmp_path, 8.0)
    assert float(np.ptp(run["x"].values)) > 2.0 * Channel.period  # twice round
    scene = Scene(run)
    assert np.abs(np.diff(scene.x, axis=0)).max() < 12e3
    assert scene.x[-1].mean() - scene.x[0].mean() == pytest.approx(0.2 * 8 * 86_400.0, rel=0.25)
    figure = draw_map(run)
    drawn = [line for line in figure.axes[0].lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 4]
    assert drawn
    for line in drawn:
        assert np.nanmax(np.abs(np.diff(line.get_xdata())), initial=0.0) < 12e3
    for corners in ice(figure):
        assert np.ptp(corners[:, 0]) < 90e3
    water = stored_water(run)
    assert water is not None
    assert np.isfinite(water.currents(scene.x[-1], scene.y[-1], 0.0)[0]).all()


@pytest.mark.quick(1)
@pytest.mark.parametrize("west", [-180.0, 0.0])
def test_runs_across_longitude_180_stay_together(tmp_path: Path, west: float) -> None:
    run = finished(DateLine(west), tmp_path)
    for corners in ice(draw_map(run, projection="degrees")):
        assert np.ptp(corners[:, 0]) < 5.0
    for corners in ice(draw_map(run)):  # metres of the plane of the pole
        assert np.ptp(corners[:, 0]) < 90e3
    content = ReplayContent(run, title="", observed={})
    x, _ = content.plane.forward(content.scene.x, content.scene.y)
    assert np.ptp(x) < 200e3


@pytest.mark.quick(1)
@pytest.mark.parametrize(("seen", "made"), [(179.9, -179.95), (-179.9, 179.9), (359.9, -0.05), (181.0, -179.1)])
def test_the_score_of_a_run_across_a_seam_is_one_map(
    tmp_path: Path, figures: list[Figure], seen: float, made: float
) -> None:
    """Bug: model and observations on two branches of longitude were drawn a globe apart."""
    run = finished(FakeModel(lon=made, lat=-56.0, turn_per_day=0.0), tmp_path, 4.0)
    days = [datetime(2020, 12, 9 + k, 13) for k in range(5)]
    fixes = [Fix("a", day, False, (seen + 0.1 * k + 180.0) % 360.0 - 180.0, -56.05) for k, day in enumerate(days)]
    draw_score(score_run(run, Observations("track.csv", fixes=fixes)), tmp_path / "score.png", dpi=40)
    (ax,) = [ax for ax in figures[0].axes if ax.get_title("left") == "(a)"]
    west, east = ax.get_xlim()
    assert east - west < 5.0
    for line in ax.lines[:-1]:
        assert np.ptp(line.get_xdata()) < 2.0


def test_tracks_have_a_gap_where_the_berg_broke(run: xr.Dataset, picture: Figure) -> None:
    """Bug: at a break-up the track of the berg jumped to the centroid of what was left of it."""
    scene = Scene(run)
    x, _ = scene.track_line(1)
    steps = np.abs(np.diff(x))
    drift = 6 * 3600.0 * 0.25 / (111e3 * np.cos(np.radians(55.0)))
    assert np.isnan(x).sum() == 1
    assert np.nanmax(steps) < drift
    plain, _, _ = scene.track(1)
    assert np.abs(np.diff(plain)).min() < 0.5 * np.nanmin(steps)  # the centroid itself jumps back
    overview = picture.axes[0]
    assert sum(np.isnan(np.asarray(line.get_xdata(), float)).any() for line in overview.lines) == 1
    assert np.isnan(scene.track_line(1, until=2)[0]).sum() == 0


# ---- moments ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_panels_of_a_short_run_tell_their_seconds(tmp_path: Path, figures: list[Figure]) -> None:
    """Bug: six panels of a run of ten seconds carried one minute."""
    run = finished(Seconds(), tmp_path, 10.0 / 86_400.0, every_hours=1.0 / 3600.0)
    titles = [ax.get_title() for ax in draw_map(run).axes if ax.get_title()]
    assert titles == ["0 s", "2 s", "4 s", "6 s", "8 s", "10 s"]
    draw_dates(run, tmp_path / "dates.png", dpi=30)
    shown = [ax.get_title() for ax in figures[0].axes if ax.get_title()]
    assert len(shown) == len(set(shown)) == 6
    assert draw_fragments(run).axes[-1].get_xlabel() == "time since the start (s)"


@pytest.mark.quick(1)
@pytest.mark.parametrize(("hours", "unit", "last"), [(2.0, "min", 120.0), (5.0, "h", 5.0)])
def test_the_axis_of_a_short_run_has_a_unit_that_fits(hours: float, unit: str, last: float, tmp_path: Path) -> None:
    """Bug: five hours stood as 300 minutes below panels that were named 0 h to 5 h."""
    run = finished(FakeModel(), tmp_path, hours / 24.0)
    axis = draw_fragments(run).axes[-1]
    assert axis.get_xlabel() == f"time since the start ({unit})"
    assert axis.get_xlim() == (0.0, pytest.approx(last))


@pytest.mark.parametrize(
    ("step", "records", "titles"),
    [
        ("2 h", 31, ["9 Dec 13:00", "10 Dec 01:00", "10 Dec 13:00", "11 Dec 01:00", "11 Dec 13:00", "12 Dec 01:00"]),
        ("20 s", 6, ["0 s", "20 s", "40 s", "60 s", "80 s", "100 s"]),
        ("9 min", 11, ["0 min", "18 min", "36 min", "54 min", "72 min", "90 min"]),
        ("1 h", 6, ["0 h", "1 h", "2 h", "3 h", "4 h", "5 h"]),
        ("2 ms", 6, ["0.000 s", "0.002 s", "0.004 s", "0.006 s", "0.008 s", "0.010 s"]),
    ],
)
def test_moments_differ_and_are_as_short_as_can_be(run: xr.Dataset, step: str, records: int, titles: list[str]) -> None:
    number, unit = step.split()
    every = np.timedelta64(int(number), {"min": "m"}.get(unit, unit)).astype("timedelta64[ns]")
    times = run["time"].values[0] + every * np.arange(records)
    figure = draw_map(run.isel(time=np.zeros(records, int)).assign_coords(time=times))
    assert [ax.get_title() for ax in figure.axes if ax.get_title()] == titles
    assert figure.axes[0].texts[0].get_text() == titles[0]


@pytest.mark.slow
def test_dates_of_a_berg_that_stays_do_not_pile_up(tmp_path: Path) -> None:
    """Bug: the dates of a berg that hardly moved were written around one mark."""
    ax = draw_map(finished(Seconds(), tmp_path, 10.0 / 86_400.0, every_hours=1.0 / 3600.0)).axes[0]
    assert [text.get_text() for text in ax.texts if text.get_text().endswith(" s")] == ["0 s"]


def test_a_break_on_impact_is_drawn_at_the_record_that_saw_it(run: xr.Dataset) -> None:
    """The record before showed a scale up to 0.0015 kPa: nothing had touched the ice yet."""
    scene = Scene(run)
    birth = scene.birth(2)
    assert birth is not None
    before = int(np.searchsorted(scene.times, birth[0])) - 1
    # Titles say when the values are of, and the break-up beside them.
    dates = [*scene.times[before : before + 2], birth[0]]
    now, after, broke = (f"{date:%-d %b %H:%M}" for date in np.array(dates).astype("datetime64[us]").tolist())
    (title,) = [ax.get_title() for ax in draw_stress(run).axes if ax.get_title()]
    assert title == f"{now}; breaks {broke}"
    struck = run.copy(deep=True)
    peak = struck["peak_stress"].transpose("time", "bond").values.copy()
    peak[: before + 1], peak[before + 1] = 0.5, 18_000.0
    struck["peak_stress"] = (("time", "bond"), peak)
    (title,) = [ax.get_title() for ax in draw_stress(struck).axes if ax.get_title()]
    assert title == f"{now} to {after}; breaks {broke}"


@pytest.mark.parametrize(("top", "unit"), [(1.5, "Pa"), (1.8e4, "kPa"), (5e7, "MPa")])
def test_the_scale_of_stress_has_a_unit_that_fits(run: xr.Dataset, top: float, unit: str) -> None:
    peak = run["peak_stress"] * 0.0 + top
    label = draw_stress(run.assign(peak_stress=peak, normal_stress=peak)).axes[-1].get_xlabel()
    assert label.startswith(f"largest tensile stress at a bond ({unit})")


# ---- sea floor -------------------------------------------------------------------------------------------------------


def hatched(figure: Figure) -> bool:
    return any(any(getattr(drawn, "hatches", None) or ()) for ax in figure.axes for drawn in ax.collections)


@pytest.mark.slow
def test_a_run_without_a_sea_floor_is_not_hatched_as_shallow(tmp_path: Path, run: xr.Dataset, picture: Figure) -> None:
    """Bug: a depth of 0 and the sea level on top of it was drawn as a shoal from edge to edge."""
    model = FakeModel()
    model.forcing = NoFloor()
    bare = finished(model, tmp_path)
    assert not hatched(draw_map(bare, forcing=NoFloor()))
    assert not hatched(draw_map(bare))
    assert ReplayContent(bare, title="", observed={})._floor() is None
    assert hatched(picture)  # where there is a shoal it is hatched
    assert ReplayContent(run, title="", observed={}).data()["floor"]["shallow"]


class AllShallow(FakeForcing):
    """A bank that reaches further than the map."""

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return less than the draft everywhere."""
        return np.full(np.shape(lon), 120.0)


@pytest.mark.slow
def test_a_map_that_is_shallow_from_edge_to_edge_is_hatched(run: xr.Dataset) -> None:
    """Bug: a berg aground in 150 m of water was drawn on a blue without a sign of it."""
    assert hatched(draw_map(run, forcing=AllShallow()))


def test_a_break_near_the_end_has_its_date(tmp_path: Path) -> None:
    """Bug: in the last hours of a run it "breaks 0.000 min"."""
    model = FakeModel(8, 4)
    model.advance(1.1, recorders=[RunWriter(tmp_path / "run.nc", every_hours=1)])
    with open_run(tmp_path) as late:
        titles = [ax.get_title() for ax in draw_stress(late).axes]
    assert any("breaks 10 Dec 13:00" in title for title in titles), titles


@pytest.mark.slow
def test_what_is_hatched_is_explained_wherever_it_is_drawn(tmp_path: Path, figures: list[Figure]) -> None:
    """Bug: maps at dates and of stress hatched the shoal without a word."""
    model = FakeModel(12, 5)
    model.forcing = AllShallow()
    shallow = finished(model, tmp_path, 2.0)
    label = draw_stress(shallow).axes[-1].get_xlabel().replace("\n", " ")
    assert "hatched: shallower than the keel" in label
    draw_dates(shallow, tmp_path / "dates.png")
    told = [text.get_text() for legend in figures[0].legends for text in legend.get_texts()]
    assert any(text.startswith("shallower than the keel") for text in told), told


def test_a_zone_that_is_declared_dry_is_no_depth(run: xr.Dataset) -> None:
    """Bug: in a68a-oras5 it was "shallower than the keel", over a sea shaded by depths that nobody knows."""

    class Zone(NoFloor):
        def depth(self, lon, lat):
            return np.where(np.asarray(lon) > -37.5, 0.0, 1000.0)

    figure = draw_map(run, forcing=Zone())
    words = [text.get_text() for part in figure.subfigs for legend in part.legends for text in legend.get_texts()]
    assert "grounds here by the set-up; no depths" in words
    assert "depth of the sea floor (m)" not in [ax.get_xlabel() for part in figure.subfigs for ax in part.axes]


@pytest.mark.slow
def test_a_floor_that_does_not_act_is_not_hatched(tmp_path: Path) -> None:
    parameters = A68A_2022.changed(grounding={"law": "none"})
    quiet = finished(FakeModel(12, 5, parameters=parameters), tmp_path)
    assert not Scene(quiet).has_floor
    assert not hatched(draw_map(quiet))
    assert not ReplayContent(quiet, title="", observed={}).data()["floor"]["shallow"]


# ---- signs ------------------------------------------------------------------------------------------------------------


def test_maps_have_letters_scales_a_key_and_one_extent(picture: Figure) -> None:
    figure = picture
    letters = [ax.get_title("left") for ax in figure.axes if ax.get_title("left")]
    assert letters == [f"({letter})" for letter in "abcdefg"]
    keys = [artist for ax in figure.axes for artist in ax.artists if isinstance(artist, QuiverKey)]
    assert [key.text.get_text() for key in keys] == ["0.2 m s$^{-1}$"]
    panels = [ax for ax in figure.axes if ax.get_title()]
    assert len({round(float(np.ptp(ax.get_ylim())), 9) for ax in panels}) == 1
    assert all(any("km" in text.get_text() for text in ax.texts) for ax in (figure.axes[0], *panels))
    assert figure.axes[-1].get_xlabel() == "speed of the current (m s$^{-1}$)"


def limits(figure: Figure) -> list[tuple[float, ...]]:
    """Return the extents of the panels of a map."""
    return [(*ax.get_xlim(), *ax.get_ylim()) for ax in figure.axes if ax.get_title()]


def test_panels_that_are_compared_have_one_size(tmp_path: Path, picture: Figure) -> None:
    boxes = limits(draw_map(finished(FakeModel(), tmp_path, 12.0)))
    assert len({round(box[3] - box[2], 9) for box in boxes}) == 1
    assert boxes[0] != boxes[2]  # a berg that goes far is followed
    (tmp_path / "near").mkdir()
    near = limits(draw_map(finished(FakeModel(), tmp_path / "near", 0.5)))
    assert len(near) > 2
    assert set(near) == {near[0]}


@pytest.mark.slow
def test_maps_in_metres_name_their_axes_at_the_rim_only(tmp_path: Path) -> None:
    """Bug: the names of y lay on the ticks of the panel before."""
    figure = draw_map(finished(FakeModel(latlon=False), tmp_path))
    panels = [ax for ax in figure.axes if ax.get_title()]
    left, foot = (min(getattr(ax.get_position(), edge) for ax in panels) for edge in ("x0", "y0"))
    assert len(panels) == 6
    for ax in panels:
        assert ax.get_ylabel() == ("y (km)" if ax.get_position().x0 < left + 0.01 else "")
        assert ax.get_xlabel() == ("x (km)" if ax.get_position().y0 < foot + 0.01 else "")
    assert figure.axes[0].get_xlabel() == "x (km)"


def test_nothing_on_the_map_overprints(picture: Figure) -> None:
    figure = picture
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    parts = [ax.get_tightbbox(renderer) for ax in figure.axes]
    assert figure._suptitle is not None  # type: ignore[attr-defined]
    parts.append(figure._suptitle.get_window_extent(renderer))  # type: ignore[attr-defined]
    for (i, a), (j, b) in itertools.combinations(enumerate(parts), 2):
        assert not a.overlaps(b), (i, a, j, b)
    (legend,) = figure.subfigs[0].legends
    assert not legend.get_window_extent(renderer).overlaps(figure.axes[0].get_window_extent(renderer))
    texts = [t.get_window_extent(renderer) for t in figure.axes[0].texts if t.get_text()]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(texts, 2))


@pytest.mark.slow
def test_a_long_forcing_is_wrapped_in_every_title(run: xr.Dataset) -> None:
    """Bug: the picture of the stress cut the second line of its title at the edge."""
    long = run.copy()
    long.attrs["forcing_title"] = "currents of one product, wind of another, sea level of a third, " * 4
    for figure in (draw_stress(long), draw_fragments(long)):
        title = figure._suptitle  # type: ignore[attr-defined]
        assert title is not None
        assert title.get_window_extent().x1 <= figure.bbox.x1


# ---- colours ----------------------------------------------------------------------------------------------------------


def test_a_fragment_has_one_colour_in_all_pictures(run: xr.Dataset, picture: Figure) -> None:
    largest, second = colours.FRAGMENTS[:2]
    lines = [
        to_hex(line.get_color()).upper()
        for line in draw_fragments(run).axes[0].lines
        if line.get_drawstyle() == "steps-post"
    ]
    assert lines == [largest, second]
    tracks = {to_hex(line.get_color()).upper() for line in picture.axes[0].lines if line.get_label()[0] != "_"}
    assert tracks == {largest, second}
    assert largest == MODEL
    assert ReplayContent(run, title="", observed={}).data()["colours"][:2] == [largest, second]


def test_the_replay_page_has_the_colours_of_the_pictures() -> None:
    from importlib.resources import files

    page = files("riftberg.viz").joinpath("replay_template.html").read_text(encoding="utf-8").lower()
    for scale in (colours.stress_map(), colours.damage_map()):
        assert to_hex(scale(0.0)) in page
        assert to_hex(scale(1.0)) in page
    assert GROUND.lower() in page


def test_colours_stand_in_one_place() -> None:
    """Two pictures had two reds for the sea floor as soon as one of them was written anew."""
    for path in sorted((ROOT / "src" / "riftberg" / "viz").glob("*.py")):
        if path.name != "colours.py":
            assert not re.findall(r"#[0-9A-Fa-f]{6}", path.read_text(encoding="utf-8")), path.name


# Machado, Oliveira and Fernandes (2009), full severity, on linear RGB.
BLIND = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour: str, seen: str) -> np.ndarray:
    """Return a colour as somebody sees it, in CIE Lab."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ @ np.clip(np.array(BLIND[seen]) @ linear, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("seen", list(BLIND))
def test_colours_are_told_apart_without_red_or_green(seen: str) -> None:
    kinds = [
        colours.FRAGMENTS[:5],
        list(colours.force_colours(["ocean drag", "Coriolis and surface slope", "wind drag", "waves"]).values()),
    ]
    for kind in kinds:
        for a, b in itertools.combinations(kind, 2):
            assert np.linalg.norm(lab(a, seen) - lab(b, seen)) > 12.0, (a, b)
    assert (
        np.linalg.norm(lab("#FF0000", seen) - lab("#7F5F00", seen)) < 40.0
    )  # the yardstick itself knows red and olive
    for scale in (colours.stress_map(), colours.damage_map(), colours.speed_map(), colours.depth_map()):
        light = [lab(to_hex(scale(part)), seen)[0] for part in np.linspace(0.0, 1.0, 9)]
        assert (np.diff(light) < 0.0).all()


# ---- what a referee asks for -----------------------------------------------------------------------------------------


def legend_of(figure: Figure) -> list[str]:
    """Return the entries of the legends of a figure and its parts."""
    parts = [figure, *figure.subfigs]
    return [text.get_text() for part in parts for legend in part.legends for text in legend.get_texts()]


def test_the_ends_of_a_channel_are_drawn_and_explained(tmp_path: Path) -> None:
    run = finished(Channel(), tmp_path, 4.0)
    figure = draw_map(run)
    seams = [
        line.get_xdata()[0]
        for line in figure.axes[0].lines
        if line.get_linestyle() == "--" and len(set(line.get_xdata())) == 1
    ]
    west, east = figure.axes[0].get_xlim()
    assert seams == [x for x in np.arange(-10, 20) * Channel.period if west <= x <= east]
    assert seams
    assert "edge of the periodic channel" in legend_of(figure)


def test_a_legend_is_as_wide_as_its_figure() -> None:
    """Named for a wide map whose last entry, "shallower than the keel", was cut off after eight letters."""
    figure = Figure(figsize=(15.5, 4.0), dpi=60, layout="constrained")
    handles = [Line2D([], [], label=f"fragment {k}: 1,656 km², off on 13 Dec 12:37, afloat") for k in range(12)]
    style.legend_below(figure, handles, columns=6)
    (legend,) = figure.legends
    assert legend.get_window_extent().width <= figure.bbox.width
    assert len(legend.get_texts()) == 12


def test_the_reference_arrow_stays_inside_its_panel(picture: Figure) -> None:
    """It began at the right edge of its panel, and ended in the next one."""
    (key,) = (artist for ax in picture.axes for artist in ax.artists if isinstance(artist, QuiverKey))
    assert key.X + key.U / key.Q.scale == pytest.approx(0.97)


def test_pictures_of_dates_name_their_year(run: xr.Dataset) -> None:
    """Two panels with "16 Dec 15:00" belonged to any year."""
    year = str(run["time"].values[0])[:4]
    assert draw_stress(run).get_suptitle().split("\n")[0].endswith(f", {year}")


def test_a_wide_drift_fills_its_map(tmp_path: Path, run: xr.Dataset) -> None:
    """Named for a map of which nine tenths were empty sea: the overview has the shape of the drift."""
    for scene_run in (run, finished(FakeModel(30, 2, turn_per_day=0.0), tmp_path, 4.0)):
        figure, scene = draw_map(scene_run), Scene(scene_run)
        (west, east), (south, north) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
        box = scene.box()
        assert (box.east - box.west) / (east - west) > 0.55
        assert (box.north - box.south) / (north - south) > 0.25 if scene.shape(0.05) < 4.0 else True


def test_named_pieces_carry_their_names_and_stars_are_of_those_in_colour(picture: Figure, run: xr.Dataset) -> None:
    texts = [text.get_text() for text in picture.axes[0].texts]
    scene = Scene(run)
    assert [name for name in map(scene.name, scene.numbers) if name in texts]
    stars = [line for line in picture.axes[0].lines if line.get_marker() == "*"]
    born = [number for number in scene.numbers if scene.birth(number) is not None]
    assert len(stars) == len(born)


# ---- formats and axes of one's own ----------------------------------------------------------------------------------


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("ending", "begin"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml"), ("PDF", b"%PDF")]
)
def test_the_ending_says_the_format(run: xr.Dataset, tmp_path: Path, ending: str, begin: bytes) -> None:
    path = draw_fragments(run, tmp_path / f"timeline.{ending}", dpi=40)
    content = path.read_bytes()
    assert content.startswith(begin)
    if ending == "svg":
        assert "area (km" in content.decode()  # text stays text
        draw_fragments(run, tmp_path / "again.svg", dpi=40)
        assert (tmp_path / "again.svg").read_bytes() == content


def test_an_unknown_format_is_refused_before_anything_is_drawn(run: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no picture can be written as \.docx"):
        draw_map(run, tmp_path / "map.docx")
    with pytest.raises(InputError, match="no picture can be written"):
        draw_fragments(run, tmp_path / "timeline.xyz")
    assert not list(tmp_path.iterdir())


def test_the_map_is_drawn_into_axes_of_ones_own(run: xr.Dataset) -> None:
    figure = Figure(figsize=(9.0, 4.0), dpi=60)
    left, right = figure.subplots(1, 2)
    assert draw_map(run, ax=left) is left
    assert draw_map(run, ax=right, date="2020-12-11T13:00") is right
    assert right.get_title("left") == "11 Dec 2020 13:00"
    assert len(list(ice(figure))) == 3  # first and last record, and the date
    names = [text.get_text() for text in left.legend().get_texts()]
    assert [name.split(":")[0] for name in names] == ["fragment 2", "berg 1"]
    scene = Scene(run)
    (west, east), (south, north) = left.get_xlim(), left.get_ylim()
    assert west < scene.x.min() < scene.x.max() < east
    assert south < scene.y.min() < scene.y.max() < north


def test_axes_that_cannot_hold_a_map_and_dates_outside_are_refused(run: xr.Dataset, tmp_path: Path) -> None:
    figure = Figure(figsize=(4.0, 4.0), dpi=60)
    with pytest.raises(InputError, match="Give plain axes"):
        draw_map(run, ax=figure.add_subplot(projection="polar"))
    with pytest.raises(InputError, match="Give path or ax"):
        draw_map(run, tmp_path / "map.png", ax=figure.add_subplot())  # type: ignore[call-overload]
    with pytest.raises(InputError, match="is not in the run"):
        draw_map(run, ax=figure.add_subplot(), date="2021-03-01")


def test_several_axes_at_once_are_refused(run: xr.Dataset) -> None:
    with pytest.raises(InputError, match="ndarray is no axes"):
        draw_map(run, ax=np.array([None, None]))  # type: ignore[call-overload]


# ---- found when every picture was opened ------------------------------------------------------------------------------


@pytest.mark.quick(1)
@pytest.mark.parametrize(("depth", "panels"), [(0.0, 2), (0.4, 2), (100.0, 3)])
def test_a_run_without_a_sea_floor_has_nothing_aground(run: xr.Dataset, depth: float, panels: int) -> None:
    """Bug: the timeline of the supported beam, which hangs over no water at all, had all its elements aground."""
    assert len(draw_fragments(run.assign(depth=xr.full_like(run["thickness"], depth))).axes) == panels


class Still(FakeForcing):
    """Water that does not move."""

    def currents(self, lon: Any, lat: Any, time: float) -> tuple[Any, Any]:
        """Return no current."""
        return np.zeros(np.shape(lon)), np.zeros(np.shape(lon))


@pytest.mark.parametrize(("water", "keyed"), [(Still(), False), (FakeForcing(), True)], ids=["still", "flowing"])
def test_a_film_of_still_water_has_no_scale_of_its_speed(run: xr.Dataset, water: Any, keyed: bool) -> None:
    film = animate._Film(Scene(run), water, {}, 40)
    film.draw(0)
    assert any("speed" in ax.get_xlabel() for ax in film.figure.axes) is keyed


def test_bergs_of_one_size_are_all_seen_in_the_timeline(run: xr.Dataset) -> None:
    """Bug: the second of two equal bergs hid the first: lines of lower rank must be thinner by more than a point."""
    lines = [line for line in draw_fragments(run).axes[0].lines if line.get_drawstyle() == "steps-post"]
    widths = [line.get_linewidth() for line in lines]
    assert len(widths) == 2
    assert widths[0] > widths[1] + 1.0


@pytest.mark.slow
def test_the_score_shows_the_sea_floor_where_it_is_known(tmp_path: Path, figures: list[Figure]) -> None:
    near = finished(FakeModel(lon=-37.4, lat=-54.95), tmp_path)
    fixes = [Fix("a", datetime(2020, 12, 10 + k, 13), False, -37.3 + 0.1 * k, -55.0) for k in range(2)]
    score = score_run(near, Observations("track.csv", fixes=fixes))
    for water in (None, FakeForcing(), NoFloor()):
        draw_score(score, tmp_path / "score.png", dpi=40, water=water)
    filled = [any(isinstance(c, ContourSet) and c.filled for c in figure.axes[0].collections) for figure in figures]
    assert filled == [False, True, False]
    scales = [any("depth of the sea floor" in ax.get_xlabel() for ax in figure.axes) for figure in figures]
    assert scales == [False, True, False]  # a shaded floor has its scale


@pytest.mark.parametrize(
    ("seconds", "entries"),
    [
        ([10, 30], ["12-09 22:02:10", "12-09 22:02:30"]),
        ([10, 70], ["12-09 22:02", "12-09 22:03"]),
        # Named for five lines of one time in a legend, which leaves out names that begin with an underscore.
        ([10, 10, 10], ["12-09 22:02:10 (3 bonds)"]),
    ],
)
def test_bonds_that_fail_within_a_minute_are_told_apart(
    run: xr.Dataset, tmp_path: Path, figures: list[Figure], seconds: list[int], entries: list[str]
) -> None:
    reasons = explain(run)
    bonds = [
        replace(
            reasons.breakups[0].first_bonds[0], time=str(np.datetime64("2020-12-09T22:02:00") + np.timedelta64(k, "s"))
        )
        for k in seconds
    ]
    draw_reasons(
        replace(reasons, breakups=[replace(reasons.breakups[0], first_bonds=bonds)]), tmp_path / "why.png", dpi=40
    )
    texts = [t.get_text() for ax in figures[0].axes if (legend := ax.get_legend()) for t in legend.get_texts()]
    texts += [t.get_text() for legend in figures[0].legends for t in legend.get_texts()]
    assert [text for text in texts if text.startswith("12-09")] == entries


def test_axes_of_time_write_dates_as_titles_do(run: xr.Dataset) -> None:
    """A day stood as 09 or Dec-10 on the axes, and as 9 Dec above the panels."""
    figure = draw_fragments(run)
    figure.canvas.draw()
    axis = figure.axes[-1].xaxis
    assert "11 Dec" in [label.get_text() for label in axis.get_ticklabels()]
    assert axis.get_offset_text().get_text() == "2020"


def unbonded(run: xr.Dataset) -> xr.Dataset:
    """Return a run without bonds."""
    return run.isel(bond=slice(0))


def test_a_run_without_bonds_has_no_panel_and_no_map_of_their_stress(run: xr.Dataset, tmp_path: Path) -> None:
    """Bug: an empty panel with a legend of lines that were not there."""
    assert not any("stress" in ax.get_ylabel() for ax in draw_fragments(unbonded(run)).axes)
    assert "stress" not in usual_kinds(unbonded(run))
    with pytest.raises(InputError, match="the run has no bonds"):
        draw_stress(unbonded(run), tmp_path / "s.png")


def dots(ax: Any) -> int:
    return sum(line.get_marker() == "o" and line.get_markersize() == DOT for line in ax.lines)


@pytest.mark.slow
def test_bergs_too_small_to_be_seen_are_dots(run: xr.Dataset) -> None:
    """Bug: a field of sixty bergs was drawn true to size, and none was seen."""
    small = draw_map(run.assign(length=run["length"] / 200.0, width=run["width"] / 200.0))
    before, after = ([ax for ax in figure.axes if ax.get_label() != "<colorbar>"] for figure in (draw_map(run), small))
    assert [dots(ax) for ax in before] == [0] * 7
    assert len(after) == 7
    assert all(dots(ax) >= 1 for ax in after)


def test_one_element_does_not_fill_its_panel(tmp_path: Path) -> None:
    lone = finished(FakeModel(1, 1, break_time=np.inf), tmp_path)
    side = SIDE / 1e3 * Scene(lone).units_per_km()
    for _, _, south, north in limits(draw_map(lone)):
        assert north - south >= 3.9 * side


def test_the_legend_of_many_pieces_keeps_off_the_title(tmp_path: Path) -> None:
    run = finished(Fleet(), tmp_path)
    run.attrs["forcing_title"] = "currents of one product, wind of another, sea level of a third, " * 2
    figure = draw_fragments(run, dpi=60)
    figure.canvas.draw()
    assert figure._suptitle is not None  # type: ignore[attr-defined]
    title, legend = figure._suptitle.get_window_extent(), figure.axes[0].get_legend()  # type: ignore[attr-defined]
    assert legend is not None
    assert len(legend.get_texts()) >= 6
    assert legend.get_window_extent().y1 < title.y0


def test_longitude_180_is_neither_east_nor_west(tmp_path: Path) -> None:
    figure = draw_map(finished(DateLine(0.0), tmp_path), projection="degrees")
    figure.canvas.draw()
    labels = {label.get_text() for ax in figure.axes for label in ax.get_xticklabels()}
    assert "180.0°" in labels or "180°" in labels
    assert not [text for text in labels if text.startswith(("180°E", "180.0°E", "180°W", "180.0°W", "-"))]


def test_members_with_the_same_value_have_the_first_colour_of_the_scale() -> None:
    same, apart = (ensemble._colour_scale(np.array(values)) for values in ([3.0, 3.0], [3.0, 4.0]))
    assert same.to_rgba(3.0) == apart.to_rgba(3.0) != apart.to_rgba(4.0)


def test_an_axis_that_crosses_the_new_year_names_both_years(run: xr.Dataset) -> None:
    year = run.assign_coords(time=run["time"] + np.timedelta64(21, "D"))
    figure = draw_fragments(year)
    figure.canvas.draw()
    assert figure.axes[-1].xaxis.get_offset_text().get_text() == "2020 to 2021"


def test_dates_up_an_axis_have_their_year_in_its_name() -> None:
    """Bug: in the picture of a sweep it stood on the letter of the panel."""
    ax = Figure(figsize=(4.0, 3.0), dpi=60).add_subplot()
    ax.plot([0.0, 1.0], np.array(["2020-12-09T13", "2020-12-26T13"], "datetime64[s]"))
    style.date_axis(ax, "y")
    ax.figure.canvas.draw()
    assert ax.get_ylabel() == "date, 2020"
    assert ax.yaxis.get_offset_text().get_text() == ""
    assert all(" Dec" in label.get_text() for label in ax.get_yticklabels())


def test_a_number_stays_with_its_unit_where_a_title_breaks() -> None:
    """A title broke between "2500" and "m"."""
    text = "sea floor that deepens by 10 m per km towards south, 2500 m at 56.00 S, 37.00 W on 9 Dec 2020 with 18 kPa"
    for inches in np.linspace(2.0, 9.0, 60):
        lines = style.wrap_text(text, float(inches), size=12.0)
        assert " ".join(lines).replace("\u00a0", " ") == text
        for line in lines[1:]:
            assert not re.match(r"(m|S|W|Dec|kPa)\b", line), lines


def test_children_of_a_berg_are_drawn_and_not_named(tmp_path: Path) -> None:
    """Bug: children of footloose calving took the colours, their dots hid the parent, and each map was as wide as the debris."""
    run = finished(FakeModel(), tmp_path).load()
    # The last three elements stand for children born after a day: bergs of their own, small and far away.
    berg, first = run["berg"].transpose("time", "trajectory").copy(), 3
    number = int(run["fragment_number"].max()) + 1
    born = run["fragment_number"].size
    berg[:, -1] = np.where(np.arange(run.sizes["time"]) < first, 0, number)
    lon, lat, width = (run[name].copy() for name in ("lon", "lat", "width"))
    gone = xr.DataArray(np.arange(run.sizes["time"]) < first, dims="time")
    child = xr.DataArray(np.arange(run.sizes["trajectory"]) == run.sizes["trajectory"] - 1, dims="trajectory")
    lon, lat = (value.where(~(gone & child)) for value in (lon + 3.0 * child, lat))
    width = width.where(~child, 10.0)
    row = {
        name: xr.concat([run[name], run[name].isel(fragment=[0])], "fragment") for name in run if run[name].dims == ("fragment",)
    }  # fmt: skip
    row["fragment_number"][born], row["fragment_parent"][born], row["fragment_area"][born] = number, 0, 3e4
    run = run.drop_dims("fragment").assign(**row, berg=berg, lon=lon, lat=lat, width=width)
    scene = Scene(run)
    assert scene.children == {number}
    assert number not in scene.numbers
    one, whole = scene.box(len(scene.times) - 1), scene.box()
    assert one.east - one.west < 1.0 < 2.0 < whole.east - whole.west


def test_track_of_a_melting_berg_is_a_line(run: xr.Dataset) -> None:
    """Bug: a berg that lost more than 1 % of its area between records had no track at all."""
    melting = run["width"] * (1.0 - 0.02 * xr.DataArray(np.arange(run.sizes["time"]), dims="time"))
    x, _ = Scene(run.assign(width=melting)).track_line(1)
    whole, _ = Scene(run).track_line(1)
    assert np.isnan(x).sum() == np.isnan(whole).sum() < 3


class Fleet(FakeModel):
    """Fourteen bergs in a row, each smaller than the one before."""

    def __init__(self) -> None:
        super().__init__(14, 1, turn_per_day=0.0, break_time=np.inf)
        area = np.linspace(9e6, 5e6, 14)[::-1]
        e = self.elements
        e.berg[:] = np.arange(1, 15)
        e.length[:] = e.width[:] = np.sqrt(area)
        self.fragments.rows[:] = [
            Fragment(k + 1, 0, 0.0, -39.0, -55.0, 1, float(area[k]), float(area[k]) * 170e3, 0, False)
            for k in range(14)
        ]


def test_of_many_bergs_the_largest_are_named(tmp_path: Path) -> None:
    scene = Scene(finished(Fleet(), tmp_path))
    assert scene.numbers == [14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3]


@pytest.mark.parametrize("record", [None, 0, 5])
def test_the_box_of_a_map_holds_the_ice_on_all_sides(run: xr.Dataset, record: int | None) -> None:
    scene = Scene(run)
    box, half = scene.box(record), 0.5 * SIDE / 1e3 * scene.units_per_km()
    rows = slice(None) if record is None else [record]
    x, y = scene.x[rows], scene.y[rows]
    wide = half * stretch(float(y.mean()), scene.latlon)
    assert (box.west, box.east) == pytest.approx((x.min() - wide, x.max() + wide), abs=2e-4)
    assert (box.south, box.north) == pytest.approx((y.min() - half, y.max() + half), abs=2e-4)
