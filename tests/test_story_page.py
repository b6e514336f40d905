"""The tables of docs/evidence/a68a.md are what benchmarks/story.py gets now."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from riftberg import read_observed
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.diagnostics.outlines import polygon_moments, project_polygon
from riftberg.experiments.a68a import A68A_OBSERVED
from riftberg.ocean.story import OWN, REFERENCE, StoryOcean
from riftberg.plane import ConformalPlane
from riftberg.runs.tracks import axis_difference
from scripts import loaded, table_rows

AGAIN = "run: python benchmarks/story.py --write"


SCRIPT = loaded("benchmarks/story.py")


def rows(name: str) -> list[tuple[str, ...]]:
    """Return the rows below the head of a table of the page."""
    return table_rows(SCRIPT.PAGE, name)


def test_the_page_has_all_rows_in_their_order() -> None:
    assert [row[0] for row in rows("story")] == [run.name for run in SCRIPT.RUNS], AGAIN


def test_the_page_has_all_rows_of_the_explicit_scheme() -> None:
    assert [row[0] for row in rows("explicit")] == [run.name for run in SCRIPT.EXPLICIT], AGAIN


@pytest.mark.slow
def test_the_storyline_is_what_comes_now() -> None:
    assert rows("storyline") == SCRIPT.storyline(), AGAIN


@pytest.mark.slow
def test_the_first_row_is_what_comes_now() -> None:
    assert rows("story")[0] == SCRIPT.row(SCRIPT.RUNS[0]), AGAIN


@pytest.mark.slow
@pytest.mark.parametrize("k", range(1, len(SCRIPT.RUNS)), ids=[run.name for run in SCRIPT.RUNS[1:]])
def test_a_row_is_what_comes_now(k: int) -> None:
    assert rows("story")[k] == SCRIPT.row(SCRIPT.RUNS[k]), AGAIN


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(SCRIPT.EXPLICIT)), ids=[run.name for run in SCRIPT.EXPLICIT])
def test_a_row_of_the_explicit_scheme_is_what_comes_now(k: int) -> None:
    assert rows("explicit")[k] == SCRIPT.row(SCRIPT.EXPLICIT[k]), AGAIN


def test_the_observed_axes_are_those_of_the_outlines(shared: Path) -> None:
    """Both measures of the published daily outlines; the table of the least rectangles is rounded, from another projection."""
    found = read_observed(shared / "data" / "observed" / "a68a_daily_outlines.geojson").outlines
    rings = {outline.when.day: outline.ring for outline in found if outline.when.month == 12}
    apart = []
    assert len(SCRIPT.MOMENTS) == 13
    for seen, moment in zip(A68A_OBSERVED, SCRIPT.MOMENTS, strict=False):
        shape = project_polygon(ConformalPlane(seen.lon, seen.lat, EARTH_RADIUS_A68), rings[seen.day])
        assert axis_difference(polygon_moments(np.asarray(shape.exterior.coords))[2], moment) == pytest.approx(
            0.0, abs=0.06
        )
        assert axis_difference(SCRIPT.rectangle_azimuth(shape), seen.azimuth) == pytest.approx(0.0, abs=2.0)
        apart.append(abs(axis_difference(seen.azimuth, moment)))
    assert round(max(apart)) == 13  # as the page says, on 18 December
    assert A68A_OBSERVED[int(np.argmax(apart))].day == 18


def test_the_shoal_is_as_large_as_the_page_says() -> None:
    """Where the depth is the draft, found by bisection; 5.0 km."""
    draft = 200.0 * 850.0 / 1025.0
    for numbers, radius in ((OWN, 5.0), (REFERENCE, 5.0)):
        ocean, near, far = StoryOcean(numbers), 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (near + far)
            deep = float(ocean.depth(np.array([numbers.shoal[0]]), np.array([numbers.shoal[1] + middle]))[0]) > draft
            near, far = (near, middle) if deep else (middle, far)
        metres = np.radians(near) * EARTH_RADIUS_A68
        assert SCRIPT.contact_radius(ocean, draft) == pytest.approx(metres, rel=1e-6)
        assert metres / 1e3 == pytest.approx(radius, abs=0.05)


@pytest.mark.parametrize("turn", [0.0, 30.0, 100.0, 170.0])
def test_the_least_rectangle_of_a_berg_with_a_finger(turn: float) -> None:
    """Its long side is that of the rectangle, whatever lies within; the axis of the second moment goes by the area."""
    flag = shapely.Polygon([(0.0, -20.0), (2.0, -20.0), (2.0, 10.0), (8.0, 10.0), (8.0, 20.0), (0.0, 20.0)])
    turned = shapely.affinity.rotate(flag, -turn, origin=(3.0, 4.0))  # clockwise
    assert axis_difference(SCRIPT.rectangle_azimuth(turned), turn) == pytest.approx(0.0, abs=1e-6)
    assert axis_difference(SCRIPT.rectangle_azimuth(shapely.MultiPoint(turned.exterior.coords)), turn) == pytest.approx(
        0.0, abs=1e-6
    )
    assert 3.0 < axis_difference(polygon_moments(np.asarray(turned.exterior.coords))[2], turn) < 10.0
    assert math.isnan(SCRIPT.rectangle_azimuth(shapely.Point(1.0, 2.0)))
