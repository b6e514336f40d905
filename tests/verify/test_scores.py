"""Scores: against plain sums and closed forms, and each is best for the ensemble that the truth is drawn from."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from shapely import Point as Point2
from shapely.affinity import translate

from riftberg.verification.scores import Outlines, Point, outline_scores, position_scores

CASES = 4000


def truth_and_ensemble(scale: float, shift: float = 0.0, members: int = 20, seed: int = 1):
    """Return positions drawn from a unit normal about their centres, and members with another spread and place."""
    random = np.random.default_rng(seed)
    centre = random.normal(0.0, 5.0, (CASES, 2))
    observed = centre + random.normal(0.0, 1.0, (CASES, 2))
    return centre + shift + random.normal(0.0, scale, (members, CASES, 2)), observed


def scores(members: Any, observed: Any, error: float = 0.0) -> dict[str, Any]:
    """Return the scores of positions of one berg: members of shape (members, cases, 2), observed (cases, 2)."""
    return position_scores(
        [Point("one", x, y) for x, y in zip(np.swapaxes(members, 0, 1), observed, strict=True)], error
    )


def test_the_fair_crps_is_the_plain_sum() -> None:
    """Along and across, each case by itself; the energy score of members on one line is that of the line."""
    random = np.random.default_rng(2)
    x, y = random.normal(size=(7, 3, 2)), random.normal(size=(3, 2))
    for k in range(3):
        found = scores(x[:, [k]], y[[k]])
        for a, axis in enumerate(("along", "across")):
            pairs = sum(abs(p - q) for p, q in itertools.permutations(x[:, k, a], 2)) / (7 * 6)
            expected = np.abs(x[:, k, a] - y[k, a]).mean() - 0.5 * pairs
            assert found[f"crps_{axis}_km"] == pytest.approx(expected, rel=1e-12)
        on_line = scores(x[:, [k]] * (1.0, 0.0), y[[k]] * (1.0, 0.0))
        assert on_line["energy_km"] == pytest.approx(found["crps_along_km"], rel=1e-12)
        pairs = sum(np.hypot(*(p - q)) for p, q in itertools.permutations(x[:, k], 2)) / (7 * 6)
        expected = np.hypot(*(x[:, k] - y[k]).T).mean() - 0.5 * pairs
        assert found["energy_km"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("members", [2, 5, 50])
def test_the_fair_crps_of_few_members_is_that_of_many(members: int) -> None:
    """Of a reliable unit normal it is 1/sqrt(pi), whatever the number of members."""
    found = scores(*truth_and_ensemble(1.0, members=members))
    assert (found["crps_along_km"], found["crps_across_km"]) == pytest.approx((np.pi**-0.5,) * 2, abs=0.02)


def test_a_library_gives_the_same() -> None:
    """Outside check, where scoringrules is installed."""
    library = pytest.importorskip("scoringrules", reason="outside check: pip install scoringrules")
    x, y = truth_and_ensemble(1.3, members=8)
    for k in range(50):
        found = scores(x[:, [k]], y[[k]])
        outside = library.crps_ensemble(y[k, 0], x[:, k, 0], estimator="fair")
        assert found["crps_along_km"] == pytest.approx(outside, rel=1e-10)
        assert found["energy_km"] == pytest.approx(library.es_ensemble(y[k], x[:, k], estimator="fair"), rel=1e-10)


@pytest.mark.parametrize("score", ["crps_along_km", "crps_across_km", "energy_km"])
@pytest.mark.parametrize(("scale", "shift"), [(0.5, 0.0), (2.0, 0.0), (1.0, 0.7)])
def test_positions_score_best_with_the_ensemble_of_the_truth(score: str, scale: float, shift: float) -> None:
    right, observed = truth_and_ensemble(1.0)
    wrong, _ = truth_and_ensemble(scale, shift, seed=1)
    assert scores(wrong, observed)[score] > scores(right, observed)[score] + 0.02


@pytest.mark.parametrize("members", [5, 20, 200])
def test_areas_hold_what_they_say_whatever_the_number_of_members(members: int) -> None:
    found = scores(*truth_and_ensemble(1.0, members=members))
    assert (found["inside_50%"], found["inside_90%"]) == pytest.approx((0.5, 0.9), abs=0.025)


def test_a_perfect_ensemble_misses_observations_with_errors_unless_they_are_added() -> None:
    """Members of 10 km and observations of 6 km: 80 % of them lie in the area of 90 %."""
    random = np.random.default_rng(5)
    x, truth = random.normal(0.0, 10.0, (200, CASES, 2)), random.normal(0.0, 10.0, (CASES, 2))
    seen = truth + random.normal(0.0, 6.0, truth.shape)
    assert scores(x, seen)["inside_90%"] == pytest.approx(1.0 - 0.1 ** (100.0 / 136.0), abs=0.02)
    assert scores(x, seen, 6.0)["inside_90%"] == pytest.approx(0.9, abs=0.02)


def test_members_at_one_point_hold_that_point_alone() -> None:
    members = np.zeros((5, 1, 2))
    assert scores(members, [[0.0, 0.0]])["inside_90%"] == 1.0
    assert scores(members, [[1e-3, 0.0]])["inside_90%"] == 0.0


@pytest.mark.parametrize(
    ("scale", "middle", "ratio"),
    [(1.0, (0.17, 0.23), 1.0), (0.5, (0.0, 0.15), 0.509), (2.0, (0.3, 0.5), 1.871)],
)  # fmt: skip
def test_ranks_and_spread_tell_reliable_from_over_and_underconfident(scale, middle, ratio) -> None:
    """Bug: of 20 members some of the ten bins held two ranks and others three, so that a reliable one was not flat."""
    found = scores(*truth_and_ensemble(scale))
    counts = found["ranks_along"]
    assert (sum(counts), len(counts)) == (CASES, 10)
    assert middle[0] <= sum(counts[4:6]) / CASES <= middle[1]
    # scale (21/20)^1/2 over (1 + scale^2 / 20)^1/2, for the mean of 20 members errs too.
    assert found["spread_over_error"] == pytest.approx(ratio, rel=0.02)


def test_equal_members_share_the_rank() -> None:
    found = scores(np.zeros((4, 1000, 2)), np.zeros((1000, 2)))
    for axis in ("along", "across"):
        assert (sum(found[f"ranks_{axis}"]), len(found[f"ranks_{axis}"])) == (1000, 5)
        assert min(found[f"ranks_{axis}"]) > 140


@pytest.mark.parametrize(("shift", "full"), [(1e3, 0), (-1e3, -1)])
def test_what_lies_beyond_all_members_has_the_first_or_the_last_rank(shift: float, full: int) -> None:
    found = scores(*truth_and_ensemble(1.0, shift=shift))
    for axis in ("along", "across"):
        assert found[f"ranks_{axis}"][full] == CASES


def test_outlines_score_best_with_the_ensemble_of_the_truth() -> None:
    """The overlap alone is won by members that are too close together."""
    disc = Point2(0.0, 0.0).buffer(10.0, quad_segs=4)
    found = {}
    for name, scale, shift in (("right", 6.0, 0.0), ("narrow", 2.0, 0.0), ("wide", 15.0, 0.0), ("off", 6.0, 6.0)):
        random = np.random.default_rng(8)
        cases = []
        for _ in range(40):
            truth, members = random.normal(0.0, 6.0, 2), shift + scale * random.normal(0.0, 1.0, (20, 2))
            cases.append(Outlines([translate(disc, *m) for m in members], translate(disc, *truth), 1.0))
        found[name] = outline_scores(cases, 0.0)
    right = found.pop("right")
    assert all(other["area_km2"] > right["area_km2"] + 5.0 for other in found.values()), found
    assert found["narrow"]["overlap"] > right["overlap"]
    # By hand: two members, one on the truth and one elsewhere; fair: (1/2)2 - 1/4 / 1 = 0 on both discs.
    two = [Outlines([disc, translate(disc, 50.0, 0.0)], disc, 1.0)]
    assert outline_scores(two, 0.0)["area_km2"] == pytest.approx(0.0, abs=1e-9)
    assert outline_scores(two, 0.0)["overlap"] == pytest.approx(0.5)
    apart = [Outlines([translate(disc, 50.0, 0.0)] * 2, disc, 1.0)]
    assert outline_scores(apart, 0.0)["area_km2"] == pytest.approx(2.0 * disc.area, rel=0.05)


def test_intervals_from_groups_are_wider_than_from_values_that_repeat_each_other() -> None:
    """Errors of 20 bergs with 100 starts each, all alike of one berg; then each start as a berg of its own."""
    errors = np.abs(np.random.default_rng(6).normal(size=20))

    def interval(groups: Any) -> float:
        points = [Point(name, np.full((2, 2), (error, 0.0)), np.zeros(2)) for name, error in groups]
        low, high = position_scores(points, 0.0)["error_of_mean_km_interval"]
        return high - low

    berg_by_berg = interval((f"{k:02d}", error) for k, error in enumerate(errors) for _ in range(100))
    assert berg_by_berg == pytest.approx(2 * 1.645 * errors.std() / 20**0.5, rel=0.1)
    assert (
        interval((f"{k:02d}-{n:02d}", error) for k, error in enumerate(errors) for n in range(100)) < 0.2 * berg_by_berg
    )
    few = [Point(name, np.zeros((2, 2)), np.ones(2)) for name in "abcd"]
    assert "error_of_mean_km_interval" not in position_scores(few, 0.0)


def test_one_member_has_an_error_and_no_score_of_an_ensemble() -> None:
    found = scores(np.full((1, 1, 2), (3.0, 4.0)), np.zeros((1, 2)))
    assert found == {"starts": 1, "bergs": 1, "error_of_mean_km": pytest.approx(5.0)}
    assert not {"inside_90%", "ranks_along", "spread_over_error"} & set(scores(np.zeros((3, 1, 2)), np.ones((1, 2))))


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 0.75, 1.25), (2.0, 0.35, 0.7), (0.5, 1.4, 2.6)])
def test_the_interval_of_spread_over_error_tells_reliable_from_over_and_underconfident(
    factor: float, low: float, high: float
) -> None:
    """Truth from the ensemble's own errors, from errors twice and half as large."""
    random = np.random.default_rng(7)
    points = [
        Point(f"B{k % 12}", random.normal(0.0, 10.0, (30, 2)), random.normal(0.0, 10.0 * factor, 2)) for k in range(120)
    ]
    first, last = position_scores(points, 0.0)["spread_over_error_interval"]
    assert low < first < last < high
    assert (first < 1.0 < last) is (factor == 1.0)
