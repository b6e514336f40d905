"""Which break-ups of several runs are the same event, and in what the runs differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from diagnostics.test_compare import make_run
from riftberg.diagnostics.compare import compare, read_compared
from riftberg.runs.accessor import align_breakups

EARTH = {"latlon": True, "radius": 6.371e6}


def event(time: str, area: float, *, grounded: bool, lon: float = -37.2, lat: float = -56.0) -> dict[str, Any]:
    """Return a break-up as a summary holds it."""
    return {"time": time, "area_km2": area, "grounded": grounded, "lon": lon, "lat": lat, "bonds": 5}


TIP = event("2020-12-16T10:00:00", 279.0, grounded=True, lon=-37.56, lat=-54.93)
FINGER = event("2020-12-20T07:00:00", 504.0, grounded=False, lon=-37.16, lat=-56.49)


def test_the_finger_of_a_run_without_tip_stands_beside_the_finger() -> None:
    """Named for a comparison that put it into the row of the tip, because it came first."""
    late = event("2020-12-20T14:30:00", 504.0, grounded=False, lon=-37.25, lat=-56.53)
    assert align_breakups([[late], [TIP, FINGER], [TIP]], EARTH) == [[None, late], [TIP, FINGER], [TIP, None]]


def test_what_lies_apart_is_another_event() -> None:
    for other in (
        {**FINGER, "time": "2020-12-25T07:00:00"},
        {**FINGER, "lat": -58.5},
        {**FINGER, "area_km2": 120.0},
        {**FINGER, "grounded": True},
    ):
        assert align_breakups([[TIP, FINGER], [other]], EARTH) == [[TIP, FINGER, None], [None, None, other]]


def test_of_two_alike_the_nearer_is_the_same() -> None:
    early = {**FINGER, "time": "2020-12-19T07:00:00"}
    soon = {**FINGER, "time": "2020-12-20T09:00:00"}
    assert align_breakups([[FINGER], [early, soon]], EARTH) == [[None, FINGER], [early, soon]]


def test_places_on_a_plane_are_metres() -> None:
    plane = {"latlon": False, "radius": 6.371e6}
    one, far = ({**FINGER, "lon": x, "lat": 0.0} for x in (0.0, 151e3))
    near = {**one, "lon": 149e3}
    assert align_breakups([[one], [near]], plane) == [[one], [near]]
    assert align_breakups([[one], [far]], plane) == [[one, None], [None, far]]


def test_runs_without_break_ups_have_no_rows() -> None:
    assert align_breakups([[], []], EARTH) == [[], []]
    assert align_breakups([[], [TIP]], EARTH) == [[None], [TIP]]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a run beside which others are put."""
    return read_compared(make_run(tmp_path_factory.mktemp("side") / "one"), "one", [])


def differences(plain: Any, *changes: dict[str, Any], files: Sequence[str] = ()) -> dict[str, list[str]]:
    """Return the rows of runs with other summaries, and experiment files, that differ."""
    names = ("experiment", "forcing", "parameters that differ", "experiment file")
    runs = [
        replace(plain, summary=plain.summary | changed, file=file)
        for changed, file in zip(changes, files or [""] * len(changes), strict=True)
    ]
    return {label: cells for label, cells in compare(runs).rows if label in names}


def test_only_differences_are_told(plain: Any) -> None:
    earth = {"earth": plain.summary["numerics"]["earth"]}
    one: dict[str, Any] = {
        "experiment": "a68a",
        "forcing": "x",
        "numerics": {**earth, "fracture": {"normal_strength": 18e3, "a": 1}},
    }
    two: dict[str, Any] = {
        "experiment": "a68a",
        "forcing": "y",
        "numerics": {**earth, "fracture": {"normal_strength": 16e3, "a": 1}},
    }
    assert differences(plain, one, one) == {}
    assert differences(plain, one) == {}
    assert differences(plain, one, two) == {
        "forcing": ["x", "y"],
        "parameters that differ": ["fracture.normal_strength 18000", "fracture.normal_strength 16000"],
    }
    many = {**one, "numerics": {**earth, "fracture": dict.fromkeys("abcde", 2)}}
    few = {**one, "numerics": {**earth, "fracture": dict.fromkeys("abcde", 3)}}
    assert (
        differences(plain, many, few)["parameters that differ"][0]
        == "fracture.a 2, fracture.b 2, fracture.c 2 and 2 more"
    )


def test_of_two_files_the_lines_that_differ_are_named(plain: Any) -> None:
    def lines(*files: str) -> list[str] | None:
        return differences(plain, {}, {}, files=files).get("experiment file")

    one = "days: 1\nberg:\n  thickness: 200 m\n"
    assert lines(one, one.replace("200", "250")) == ["thickness: 200 m", "thickness: 250 m"]
    assert (lines(one, "a: 1\nb: 1\nc: 1\nd: 1\n") or [])[1] == "a: 1; b: 1; c: 1 and 1 lines more"
    assert lines(one, one) is None
