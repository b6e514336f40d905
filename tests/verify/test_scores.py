"""Scores: against plain sums and closed forms, and each is best for the ensemble that the truth is drawn from."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats
from shapely import Point as Point2
from shapely.affinity import translate

from riftberg.errors import InputError
from riftberg.verification import scores
from riftberg.verification.scores import Point, position_scores

LEVELS = (0.5, 0.9)

CASES = 4000


def truth_and_ensemble(scale: float, shift: float = 0.0, members: int = 20, seed: int = 1):
    """Return positions drawn from a unit normal about their centres, and members with another spread and place."""
    random = np.random.default_rng(seed)
    centre = random.normal(0.0, 5.0, (CASES, 2))
    observed = centre + random.normal(0.0, 1.0, (CASES, 2))
    return centre + shift + random.normal(0.0, scale, (members, CASES, 2)), observed


def test_the_fair_crps_is_the_plain_sum() -> None:
    random = np.random.default_rng(2)
    x, y = random.normal(size=(7, 3)), random.normal(size=3)
    for k in range(3):
        pairs = sum(abs(a - b) for a, b in itertools.permutations(x[:, k], 2)) / (7 * 6)
        assert scores.fair_crps(x[:, k], y[k]) == pytest.approx(np.abs(x[:, k] - y[k]).mean() - 0.5 * pairs, rel=1e-12)
    # In one dimension the energy score is the same.
    np.testing.assert_allclose(scores.fair_energy(x[..., None], y[:, None]), scores.fair_crps(x, y), rtol=1e-12)


@pytest.mark.parametrize("members", [2, 5, 50])
def test_the_fair_crps_of_few_members_is_that_of_many(members: int) -> None:
    """Of a reliable unit normal it is 1/sqrt(pi), whatever the number of members."""
    x, y = truth_and_ensemble(1.0, members=members)
    assert scores.fair_crps(x, y).mean() == pytest.approx(np.pi**-0.5, abs=0.02)


def test_a_library_gives_the_same() -> None:
    """Outside check, where scoringrules is installed."""
    library = pytest.importorskip("scoringrules", reason="outside check: pip install scoringrules")
    x, y = truth_and_ensemble(1.3, members=8)
    outside = library.crps_ensemble(y[:50, 0], x[:, :50, 0].T, estimator="fair")
    np.testing.assert_allclose(scores.fair_crps(x[:, :50, 0], y[:50, 0]), outside, rtol=1e-10)
    outside = library.es_ensemble(y[:50], np.swapaxes(x[:, :50], 0, 1), estimator="fair")
    np.testing.assert_allclose(scores.fair_energy(x[:, :50], y[:50]), outside, rtol=1e-10)


@pytest.mark.parametrize("score", [scores.fair_crps, scores.fair_energy])
@pytest.mark.parametrize(("scale", "shift"), [(0.5, 0.0), (2.0, 0.0), (1.0, 0.7)])
def test_positions_score_best_with_the_ensemble_of_the_truth(score, scale: float, shift: float) -> None:
    right, observed = truth_and_ensemble(1.0)
    wrong, _ = truth_and_ensemble(scale, shift, seed=1)
    difference = score(wrong, observed).mean(axis=0) - score(right, observed).mean(axis=0)
    assert (difference > 0.02).all()


@pytest.mark.parametrize("wrong", [0.1, 0.5])
def test_yes_and_no_score_best_with_the_probability_of_the_truth(wrong: float) -> None:
    random = np.random.default_rng(3)
    occurred = random.random(CASES) < 0.3
    right, other = (random.random((10, CASES)) < p for p in (0.3, wrong))
    assert scores.fair_brier(right, occurred).mean() < scores.fair_brier(other, occurred).mean() - 0.01
    # Fair: that of ten members is that of the probability itself, which the plain score of ten members is not.
    assert scores.fair_brier(right, occurred).mean() == pytest.approx(scores.brier(0.3, occurred).mean(), abs=0.004)
    assert scores.brier(right.mean(axis=0), occurred).mean() > scores.brier(0.3, occurred).mean() + 0.015


def test_reliability_shows_what_was_given_and_what_occurred() -> None:
    random = np.random.default_rng(4)
    p = random.random(20000)
    honest = scores.reliability(p, random.random(p.size) < p)
    assert [b.cases > 3000 for b in honest] == [True] * 5
    assert all(abs(b.forecast - b.observed) < 0.03 for b in honest)
    bold = scores.reliability(p, random.random(p.size) < 0.5)
    assert bold[0].observed > 0.4 > 0.2 > bold[0].forecast
    assert bold[0].interval[0] < bold[0].observed < bold[0].interval[1]
    assert scores.reliability([1.0], [True])[0].interval[0] == pytest.approx(1 / (1 + stats.norm.ppf(0.95) ** 2))


@pytest.mark.parametrize("members", [5, 20, 200])
@pytest.mark.parametrize("level", LEVELS)
def test_areas_hold_what_they_say_whatever_the_number_of_members(members: int, level: float) -> None:
    x, y = truth_and_ensemble(1.0, members=members)
    assert scores.inside_area(x, y, level).mean() == pytest.approx(level, abs=0.025)


def test_a_perfect_ensemble_misses_observations_with_errors_unless_they_are_added() -> None:
    """Members of 10 km and observations of 6 km: 80 % of them lie in the area of 90 %."""
    random = np.random.default_rng(5)
    x, truth = random.normal(0.0, 10.0, (200, CASES, 2)), random.normal(0.0, 10.0, (CASES, 2))
    seen = truth + random.normal(0.0, 6.0, truth.shape)
    bare = scores.inside_area(x, seen, 0.9).mean()
    assert bare == pytest.approx(1.0 - 0.1 ** (100.0 / 136.0), abs=0.02)
    assert scores.inside_area(scores.with_observation_error(x, 6.0, random), seen, 0.9).mean() == pytest.approx(
        0.9, abs=0.02
    )


def test_members_at_one_point_hold_that_point_alone() -> None:
    members = np.zeros((5, 2, 2))
    np.testing.assert_array_equal(scores.inside_area(members, [[0.0, 0.0], [1e-3, 0.0]], 0.9), [True, False])


@pytest.mark.parametrize(
    ("scale", "middle", "ratio"),
    [(1.0, (0.17, 0.23), 1.0), (0.5, (0.0, 0.15), 0.509), (2.0, (0.3, 0.5), 1.871)],
)  # fmt: skip
def test_ranks_and_spread_tell_reliable_from_over_and_underconfident(scale, middle, ratio) -> None:
    """Bug: of 20 members some of the ten bins held two ranks and others three, so that a reliable one was not flat."""
    x, y = truth_and_ensemble(scale)
    found = position_scores([Point("one", x[:, k], y[k]) for k in range(CASES)], 0.0)
    counts = found["ranks_along"]
    assert (sum(counts), len(counts)) == (CASES, 10)
    assert middle[0] <= sum(counts[4:6]) / CASES <= middle[1]
    # scale (21/20)^1/2 over (1 + scale^2 / 20)^1/2, for the mean of 20 members errs too.
    assert found["spread_over_error"] == pytest.approx(ratio, rel=0.02)


def test_equal_members_share_the_rank() -> None:
    rank = scores.ranks(np.zeros((4, 1000)), np.zeros(1000), np.random.default_rng(1))
    assert np.bincount(rank, minlength=5).min() > 140


def test_liu_weisberg_by_hand() -> None:
    # Ways so far 10, 20, 30; separations add up to 15.
    assert scores.liu_weisberg([2.0, 5.0, 8.0], [10.0, 10.0, 10.0]) == pytest.approx(1.0 - 15.0 / 60.0)
    assert scores.liu_weisberg([50.0, 50.0], [10.0, 10.0]) == 0.0
    assert scores.liu_weisberg([0.0], [0.0]) == 1.0
    with pytest.raises(InputError, match="2 separations, 1 steps"):
        scores.liu_weisberg([1.0, 2.0], [1.0])


def test_the_mean_of_the_right_ensemble_has_the_best_skill_of_liu_and_weisberg() -> None:
    way = 5.0 * np.ones(50)

    def skill(shift: float) -> float:
        x, y = truth_and_ensemble(1.0, shift)
        return scores.liu_weisberg(np.linalg.norm(x.mean(axis=0) - y, axis=-1)[:50], way)

    assert skill(0.0) > max(skill(0.7), skill(-0.7))


def test_outlines_score_best_with_the_ensemble_of_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    """The overlap alone is won by members that are too close together."""
    monkeypatch.setattr(scores, "CELLS", 8)
    disc = Point2(0.0, 0.0).buffer(10.0)
    found = {}
    for name, scale, shift in (("right", 6.0, 0.0), ("narrow", 2.0, 0.0), ("wide", 15.0, 0.0), ("off", 6.0, 6.0)):
        random = np.random.default_rng(8)
        cases = []
        for _ in range(40):
            truth, members = random.normal(0.0, 6.0, 2), shift + scale * random.normal(0.0, 1.0, (20, 2))
            cases.append(scores.Outlines([translate(disc, *m) for m in members], translate(disc, *truth), 1.0))
        found[name] = scores.outline_scores(cases, 0.0)
    right = found.pop("right")
    assert all(other["area_km2"] > right["area_km2"] + 5.0 for other in found.values()), found
    assert found["narrow"]["overlap"] > right["overlap"]
    # By hand: two members, one on the truth and one elsewhere; fair: (1/2)2 - 1/4 / 1 = 0 on both discs.
    two = [scores.Outlines([disc, translate(disc, 50.0, 0.0)], disc, 1.0)]
    assert scores.outline_scores(two, 0.0)["area_km2"] == pytest.approx(0.0, abs=1e-9)
    assert scores.outline_scores(two, 0.0)["overlap"] == pytest.approx(0.5)
    apart = [scores.Outlines([translate(disc, 50.0, 0.0)] * 2, disc, 1.0)]
    assert scores.outline_scores(apart, 0.0)["area_km2"] == pytest.approx(2.0 * disc.area, rel=0.05)


def test_intervals_from_groups_are_wider_than_from_values_that_repeat_each_other() -> None:
    random = np.random.default_rng(6)
    values = [np.full(100, centre) for centre in random.normal(size=20)]
    low, high = scores.bootstrap_interval(values, np.mean)
    centres = np.array([v[0] for v in values])
    assert high - low == pytest.approx(2 * 1.645 * centres.std() / 20**0.5, rel=0.1)
    low, high = scores.bootstrap_interval([v[k : k + 1] for v in values for k in range(100)], np.mean, draws=200)
    assert high - low < 0.2


def test_too_few_members_are_refused() -> None:
    with pytest.raises(InputError, match="1 members"):
        scores.fair_crps([[1.0]], [1.0])


@pytest.mark.parametrize(("factor", "word"), [(1.0, "reliable"), (2.0, "overconfident"), (0.5, "underconfident")])
def test_twins_of_positions_are_called_what_they_are(factor: float, word: str) -> None:
    """Truth from the ensemble's own errors, from errors twice and half as large."""
    from riftberg.verification.scores import verdict

    random = np.random.default_rng(7)
    points = [
        Point(f"B{k % 12}", random.normal(0.0, 10.0, (30, 2)), random.normal(0.0, 10.0 * factor, 2)) for k in range(120)
    ]
    found = position_scores(points, 0.0)
    assert verdict(found) == word
    assert set(found) >= {"energy_km_interval", "crps_along_km", "crps_across_km", "ranks_along", "inside_90%"}


@pytest.mark.parametrize(("shift", "full"), [(1e3, 0), (-1e3, -1)])
def test_what_lies_beyond_all_members_has_the_first_or_the_last_rank(shift: float, full: int) -> None:
    x, y = truth_and_ensemble(1.0, shift=shift)
    found = position_scores([Point("one", x[:, k], y[k]) for k in range(CASES)], 0.0)
    for axis in ("along", "across"):
        assert found[f"ranks_{axis}"][full] == CASES
