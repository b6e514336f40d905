"""Scores of a run against observations made from that run, moved and turned by known amounts."""

from __future__ import annotations

import json
import math
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
import xarray as xr
from matplotlib.image import imread

from fakes import FakeModel
from riftberg import Fix, Observations, Outline, draw_score, open_run, score_run
from riftberg.diagnostics.outlines import (
    aligned_overlap,
    group_fragments,
    intersection_over_union,
    pair_cost,
    polygon_moments,
    same_pieces,
)
from riftberg.errors import InputError
from riftberg.ocean.grid import haversine
from riftberg.plane import ConformalPlane
from riftberg.runs.run_file import RunWriter
from riftberg.runs.tracks import axis_difference

WORST = 3.0

START = datetime(2020, 12, 9, 13)
RADIUS = 6_363_827.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Four days of a berg of 24 by 9 km that loses its last 6 km after a day."""
    path = tmp_path_factory.mktemp("score") / "run.nc"
    FakeModel().advance(4, recorders=[RunWriter(path, every_hours=3, experiment="fake")])
    return open_run(path)


def true_outline(
    day: int, *, shift: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, columns: slice = slice(0, 8)
) -> np.ndarray:
    """Return the outline of the fake berg on a day, moved (m) and turned (degrees, counter-clockwise)."""
    model = FakeModel(break_time=math.inf)
    model.time = 86_400.0 * day
    model._place()
    left, right = -12e3 + 3e3 * columns.start, -12e3 + 3e3 * columns.stop
    x, y = np.array([left, right, right, left]), np.array([-4.5e3, -4.5e3, 4.5e3, 4.5e3])
    angle = model.turn * model.time + math.radians(turn)
    gone = 0.2 * model.time, -0.02 * model.time
    px = x * math.cos(angle) - y * math.sin(angle) + gone[0] + shift[0]
    py = x * math.sin(angle) + y * math.cos(angle) + gone[1] + shift[1]
    metres = math.radians(1.0) * RADIUS
    return np.column_stack([-39.0 + px / (metres * math.cos(math.radians(-55.0))), -55.0 + py / metres])


def seen(day: int, ring: np.ndarray, name: str = "") -> Outline:
    """Return an outline of a day."""
    return Outline(name, datetime(2020, 12, 9 + day), True, ring)


def test_the_run_against_itself_is_perfect(run: xr.Dataset) -> None:
    (day,) = score_run(run, Observations("itself", [seen(0, true_outline(0))])).days
    match = day.berg
    assert match is not None
    assert match.distance_km == pytest.approx(0.0, abs=0.02)
    assert match.azimuth_difference == pytest.approx(0.0, abs=0.1)
    assert match.area_km2 == 216.0
    assert match.area_observed_km2 == pytest.approx(216.0, rel=0.003)
    assert match.iou == pytest.approx(1.0, abs=0.01)


def test_a_known_shift_and_turn_come_back(run: xr.Dataset) -> None:
    (day,) = score_run(run, Observations("moved", [seen(0, true_outline(0, shift=(3e3, 4e3), turn=20.0))])).days
    match = day.berg
    assert match is not None
    assert match.distance_km == pytest.approx(5.0, rel=0.01)
    assert match.azimuth_difference == pytest.approx(20.0, abs=0.2)  # counter-clockwise lowers the observed azimuth
    (day,) = score_run(run, Observations("along", [seen(0, true_outline(0, shift=(12e3, 0.0)))])).days
    assert day.berg is not None
    assert day.berg.iou == pytest.approx(1.0 / 3.0, abs=0.01)  # half of it overlaps


def test_the_observed_heading_is_from_north_at_the_piece_however_far_the_model_is(run: xr.Dataset) -> None:
    """Bug: it was from north at the model's berg, 2 degrees off for 150 km."""
    there = ConformalPlane(-36.0, -57.0, RADIUS)
    x, y = np.array([-5e3, 5e3, 5e3, -5e3]), np.array([-20e3, -20e3, 20e3, 20e3])
    angle = math.radians(30.0)  # clockwise
    ring = np.column_stack(
        there.inverse(x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle))
    )
    found = score_run(run, Observations("far", outlines=[Outline("A", START, False, ring)]))
    (match,) = found.days[0].matches
    assert match.distance_km is not None
    assert match.distance_km > 250.0
    assert match.azimuth_observed == pytest.approx(30.0, abs=0.01)


def test_pieces_are_matched_with_fragments(run: xr.Dataset) -> None:
    # On the second day fragment 2 (the last two columns) has moved 8.6 km east.
    rings = [true_outline(2, columns=slice(0, 6)), true_outline(2, columns=slice(6, 8), shift=(8.64e3, 0.0))]
    (day,) = score_run(run, Observations("pieces", [seen(2, rings[1], "tip"), seen(2, rings[0], "rest")])).days
    assert [(m.observed, m.fragments) for m in day.matches] == [("rest", [1]), ("tip", [2])]
    assert all(m.iou is not None and m.iou > 0.98 for m in day.matches)
    assert day.unmatched == []


def test_a_piece_still_in_place_counts_to_the_berg_whatever_the_drift_error(run: xr.Dataset) -> None:
    when = datetime(2020, 12, 10, 16)  # three hours after the break
    ring = true_outline(1, shift=(8e3, 5e3))
    (day,) = score_run(run, Observations("whole", [Outline("", when, False, ring)])).days
    assert day.matches[0].fragments == [1, 2]
    far = Outline("", datetime(2020, 12, 13, 13), False, true_outline(4, columns=slice(0, 6)))
    (day,) = score_run(run, Observations("rest", [far])).days
    assert day.matches[0].fragments == [1]
    assert day.unmatched == [2]


def test_the_fragments_of_the_berg_can_be_told(run: xr.Dataset) -> None:
    ring = true_outline(4, columns=slice(0, 6))
    (day,) = score_run(run, Observations("rest", [seen(4, ring)]), together=[1, 2]).days
    assert day.matches[0].fragments == [1, 2]
    assert day.matches[0].area_km2 == 216.0


def test_tracks_are_matched_by_name_over_the_run(run: xr.Dataset) -> None:
    tip = run.isel(trajectory=run["berg"].isel(time=-1).values == 2)
    fixes = []
    for day in (0, 2, 3, 4):
        ring = true_outline(day).mean(axis=0)
        fixes.append(Fix("A1", datetime(2020, 12, 9 + day), True, ring[0] + 0.01, ring[1]))
        if day > 1:
            place = tip.sel(time=START + timedelta(days=day))
            fixes.append(
                Fix("A2", datetime(2020, 12, 9 + day), True, float(place["lon"].mean()), float(place["lat"].mean()))
            )
    fixes.append(Fix("A1", datetime(2020, 12, 10), True, 0.0, 0.0, interpolated=True))
    found = score_run(run, Observations("tracks", fixes=fixes))
    assert len(found.days) == 4
    assert [(m.observed, m.fragments) for m in found.days[-1].matches] == [("A1", [1]), ("A2", [2])]
    assert found.days[-1].matches[1].distance_km == pytest.approx(0.0, abs=0.05)
    assert found.summary()["days"] == 4
    assert len(score_run(run, Observations("tracks", fixes=fixes), interpolated=True).days) == 5


def test_a_fragment_goes_by_the_name_seen_when_it_broke_off(run: xr.Dataset) -> None:
    """Bug: A68a's finger, off on 20 December, went by the name of A68F, first seen five days later and somewhat nearer."""
    tip = run.isel(trajectory=run["berg"].isel(time=-1).values == 2)

    def fix(name: str, day: int, north: float) -> Fix:
        place = tip.sel(time=START + timedelta(days=day))
        return Fix(
            name, datetime(2020, 12, 9 + day), True, float(place["lon"].mean()), float(place["lat"].mean()) + north
        )

    berg = [Fix("A1", datetime(2020, 12, 9), True, -39.0, -55.0)]
    early, late = [fix("E", day, 0.2) for day in (2, 3, 4)], [fix("F", 4, 0.15)]
    names = [{m.observed: m.fragments for m in score_run(run, Observations("t", fixes=[*berg, *seen])).days[-1].matches}
             for seen in ([*early, *late], late)]  # fmt: skip
    assert names == [{"E": [2], "F": []}, {"F": [2]}]
    far = [fix("F", 4, 1.0)]  # 111 km
    assert score_run(run, Observations("t", fixes=[*berg, *far])).days[-1].matches[0].fragments == []


def test_of_the_names_seen_first_the_berg_is_the_nearest(run: xr.Dataset) -> None:
    """Bug: in a table of all bergs it was the first in the alphabet."""
    fixes = [
        Fix(name, datetime(2020, 12, 9), True, lon, -55.0)
        for name, lon in (("A23A", -45.0), ("A68A", -39.1), ("B1", 120.0))
    ]
    matches = score_run(run, Observations("all", fixes=fixes)).days[0].matches
    assert {m.observed: m.fragments for m in matches} == {"A23A": [], "A68A": [1]}  # B1 is left out


def test_a_day_is_compared_at_the_hour_asked_for(run: xr.Dataset) -> None:
    ring = true_outline(0)
    (day,) = score_run(run, Observations("hour", [Outline("", datetime(2020, 12, 9), True, ring)]), hour=19).days
    assert day.time == "2020-12-09T19:00:00"
    assert day.matches[0].distance_km == pytest.approx(6 * 3.6 * math.hypot(0.2, 0.02), rel=0.02)


def test_outside_of_the_run_there_is_nothing_to_compare(run: xr.Dataset) -> None:
    with pytest.raises(
        InputError, match=r"nothing was observed during the run. The run goes from \d{4}-\d\d-\d\d \d\d:\d\d to "
    ):
        score_run(run, Observations("late", [Outline("", datetime(2021, 1, 9), True, true_outline(0))]))


def test_score_is_written_and_drawn(run: xr.Dataset, tmp_path: Path) -> None:
    rings = [seen(day, true_outline(day, shift=(1e3 * day, 0.0))) for day in range(5)]
    found = score_run(run, Observations("rings", rings))
    content = json.loads(found.write(tmp_path / "score.json").read_text())
    assert content["summary"]["days"] == 5
    assert content["summary"]["distance_km_max"] > 3.0
    picture = imread(draw_score(found, tmp_path / "score.png", title="a test", dpi=60))
    assert picture[..., :3].std() > 0.05
    only = Observations("points", fixes=[Fix("A", datetime(2020, 12, 10), True, -39.0, -55.0)])
    assert draw_score(score_run(run, only), tmp_path / "points.png", dpi=60).exists()


def test_axes_differ_by_at_most_a_right_angle() -> None:
    assert axis_difference(175.0, 5.0) == pytest.approx(-10.0)
    assert axis_difference(5.0, 175.0) == pytest.approx(10.0)
    assert abs(axis_difference(0.0, 90.0)) == 90.0


def test_distance_on_the_sphere_matches_the_plane() -> None:
    plane = ConformalPlane(-37.0, -56.0, RADIUS)
    lon, lat = plane.inverse(np.array([3e3]), np.array([4e3]))
    assert haversine(-37.0, -56.0, float(lon[0]), float(lat[0]), RADIUS) == pytest.approx(5e3, rel=1e-6)
    assert haversine(179.9, 0.0, -179.9, 0.0, RADIUS) == pytest.approx(math.radians(0.2) * RADIUS)


@pytest.mark.parametrize("turn", [0.0, 30.0, 100.0, 170.0])
def test_moments_of_a_rectangle(turn: float) -> None:
    angle = math.radians(90.0 - turn)
    x, y = np.array([-8.0, 8.0, 8.0, -8.0]), np.array([-2.0, -2.0, 2.0, 2.0])
    ring = np.column_stack(
        [x * math.cos(angle) - y * math.sin(angle) + 50.0, x * math.sin(angle) + y * math.cos(angle) - 7.0]
    )
    for corners in (ring, ring[::-1], np.vstack([ring, ring[:1]])):
        cx, cy, azimuth = polygon_moments(corners)
        assert (cx, cy) == pytest.approx((50.0, -7.0))
        assert axis_difference(azimuth, turn) == pytest.approx(0.0, abs=1e-6)


def test_overlap_of_squares() -> None:
    a, b = shapely.box(0, 0, 2, 1), shapely.box(1, 0, 3, 1)
    assert intersection_over_union(a, b) == pytest.approx(1.0 / 3.0)
    assert aligned_overlap(a, b) == pytest.approx(1.0)
    assert group_fragments({1: a, 2: shapely.box(50, 0, 51, 1)}, [b, shapely.box(53, 0, 54, 1)]) == [[1], [2]]


def test_the_tip_that_stayed_behind_is_the_piece_beside_it_not_the_larger_one_far_away() -> None:
    """Bug: of two observed pieces that nothing overlaps the larger one took the fragment, 186 km away, like A68F that of A68D.

    Sizes and distances (km) are about those of 24 December.
    """
    berg, finger, tip = shapely.box(0, 0, 45, 77), shapely.box(20, -40, 40, -15), shapely.box(-60, 180, -43, 196)
    seen_berg, seen_finger = shapely.box(3, 4, 43, 68), shapely.box(45, -45, 65, -15)
    seen_tip, seen_other = shapely.box(-37, 177, -25, 189), shapely.box(70, 40, 85, 55)
    pieces = [seen_berg, seen_finger, seen_other, seen_tip]
    assert [p.area for p in pieces] == sorted((p.area for p in pieces), reverse=True)
    assert group_fragments({1: berg, 3: finger, 2: tip}, pieces) == [[1], [3], [], [2]]
    # The best for all: the one piece that two fragments may be goes to the fragment that has no other.
    assert group_fragments({1: shapely.box(0, 0, 10, 10), 2: shapely.box(24, 0, 34, 10)},
                           [shapely.box(12, 0, 22, 10), shapely.box(-13, 0, -3, 10)]) == [[2], [1]]  # fmt: skip


def test_a_fragment_keeps_its_piece_from_day_to_day() -> None:
    """On 26 December the model's finger lies nearer to A68F than to the finger that it was the day before."""
    berg = shapely.box(-80, 0, -20, 60)
    fragments = {1: berg, 2: shapely.box(0, 0, 22, 23)}
    finger, other = shapely.box(0, -75, 20, -50), shapely.box(30, 0, 45, 17)
    assert group_fragments(fragments, [berg, finger, other]) == [[1], [], [2]]
    assert group_fragments(fragments, [berg, finger, other], {1: 2}) == [[1], [2], []]
    gone = shapely.affinity.translate(finger, 0, -100)
    assert group_fragments(fragments, [berg, gone, other], {1: 2}) == [[1], [], [2]]
    moved = [shapely.affinity.translate(other, 5, -5), shapely.affinity.translate(finger, -5, 5)]
    assert same_pieces([finger, other], moved) == {0: 1, 1: 0}


def test_the_day_before_counts_in_a_score(run: xr.Dataset) -> None:
    """The tip (54 km2), seen in its place on one day, is on the next day not the like piece that is nearer to it."""
    tip = slice(6, 8)
    first, last = ([seen(day, true_outline(day, columns=slice(0, 6)), "rest")] for day in (3, 4))
    place = run.isel(trajectory=run["berg"].isel(time=-1).values == 2)

    def at(day: int, east: float) -> np.ndarray:
        here = place.sel(time=START + timedelta(days=day))
        ring = true_outline(day, columns=tip)
        ring = ring - ring.mean(axis=0) + [float(here["lon"].mean()), float(here["lat"].mean())]
        return np.add(ring, [east / (math.radians(1.0) * RADIUS * math.cos(math.radians(55.0))), 0.0])

    first.append(seen(3, at(3, 0.0), "tip"))
    last += [seen(4, at(4, -11e3), "tip"), seen(4, at(4, 10e3), "stranger")]
    alone = score_run(run, Observations("one day", last)).days[-1]
    both = score_run(run, Observations("both", first + last)).days[-1]
    assert {m.observed: m.fragments for m in alone.matches} == {"rest": [1], "tip": [], "stranger": [2]}
    assert {m.observed: m.fragments for m in both.matches} == {"rest": [1], "tip": [2], "stranger": []}


def test_beyond_three_diameters_or_four_times_the_area_a_piece_is_no_fragment() -> None:
    square = shapely.box(0, 0, 1, 1)  # diameter of the circle of its area: 1.128
    near, far = shapely.box(3.35, 0, 4.35, 1), shapely.box(3.45, 0, 4.45, 1)
    assert math.isfinite(pair_cost(square, near))
    assert pair_cost(square, far) == math.inf
    assert pair_cost(square, far, main=True) < WORST  # the berg itself is known
    large, larger = shapely.box(1.1, 0, 3.05, 2), shapely.box(1.1, 0, 3.15, 2)
    for pair in ((square, large), (large, square)):
        assert math.isfinite(pair_cost(*pair))
    for pair in ((square, larger), (larger, square)):
        assert pair_cost(*pair) == math.inf
    # A chip of a broken berg that lies on the piece may be it, a whole berg that lies on a chip is not.
    whole = shapely.box(0, 0, 3, 3)
    assert math.isfinite(pair_cost(square, whole))
    assert pair_cost(whole, square) == math.inf
    assert pair_cost(square, square) == 0.0
    # Scale does not matter.
    wide = (shapely.affinity.scale(a, 1e3, 1e3, origin=(0, 0)) for a in (square, near))
    assert pair_cost(*wide) == pytest.approx(pair_cost(square, near))


def test_headings_are_drawn_without_jumps_also_where_the_axes_come_to_lie_across_each_other() -> None:
    """Bug: the model's heading was drawn near the observed one of each day, and jumped by 180 degrees at a right angle."""
    from matplotlib.figure import Figure

    from riftberg.diagnostics.score import Match
    from riftberg.viz.score import _draw_azimuth

    def match(azimuth: float, observed: float) -> Match:
        off = axis_difference(azimuth, observed)
        return Match("A", [1], 0.0, azimuth, observed, off, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    ax = Figure().add_subplot()
    rows = [match((60.0 - 20.0 * k) % 180.0, (120.0 + 20.0 * k) % 180.0) for k in range(7)]
    _draw_azimuth(ax, np.arange(7), rows)
    observed, model = (np.asarray(line.get_ydata()) for line in ax.lines)
    np.testing.assert_allclose(np.diff(observed), 20.0)
    np.testing.assert_allclose(np.diff(model), -20.0)
    assert abs(model[0] - observed[0]) <= 90.0
