"""Location of events within a step: the root finder, and the trials that it takes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.quasi_static.step import TimeStep, first_moment


def located(value: Callable[[float], float], end: float, tolerance: float) -> tuple[float, int]:
    """First moment of an event, and how often it was asked for."""
    asked: list[float] = []

    def counted(t: float) -> float:
        asked.append(t)
        return value(t)

    return first_moment(counted, (0.0, value(0.0)), (end, value(end)), tolerance), len(asked)


def halvings(end: float, tolerance: float) -> int:
    """Evaluations that bisection needs."""
    return math.ceil(math.log2(end / tolerance))


@pytest.mark.quick(25)
@pytest.mark.parametrize("seed", range(200))
def test_the_first_moment_is_bracketed_with_at_most_one_evaluation_more_than_bisection(seed: int) -> None:
    """Whatever the shape: smooth, steep, flat before the event, with jumps, or a sign alone."""
    rng = np.random.default_rng(seed)
    end, event = 10.0 ** rng.uniform(-1, 4), rng.uniform(0.0, 1.0)
    tolerance, event = end * 10.0 ** rng.uniform(-6, -0.3), event * end
    power, below, above = rng.uniform(0.2, 8.0), 10.0 ** rng.uniform(-9, 0), 10.0 ** rng.uniform(-9, 6)
    jump = rng.choice([0.0, 0.3, np.inf])

    def value(t: float) -> float:
        if t <= event:
            return float(-below * ((event - t) / event) ** power)
        return float(above * ((t - event) / end) ** power + 1e-12 + jump)

    found, asked = located(value, end, tolerance)
    assert event < found <= event + tolerance
    assert asked <= halvings(end, tolerance) + 1


def test_a_sign_is_bisected() -> None:
    """Touch-down has no slope."""
    found, asked = located(lambda t: 1.0 if t > 700.0 else -1.0, 1800.0, 1.0)
    assert 700.0 < found <= 701.0
    assert asked <= halvings(1800.0, 1.0)


def test_a_slope_needs_fewer_trials_than_bisection() -> None:
    """Stress under loads that grow evenly is nearly linear in time."""
    found, asked = located(lambda t: (t / 700.0) ** 1.5 - 1.0, 1800.0, 0.01)
    assert 700.0 < found <= 700.01
    assert asked <= 0.6 * halvings(1800.0, 0.01)


@pytest.mark.parametrize("value", [-np.inf, np.nan])
def test_a_value_that_is_no_number_is_no_event(value: float) -> None:
    """A lattice without ice has no stress over strength."""
    found, _ = located(lambda t: 1.0 if t > 700.0 else value, 1800.0, 1.0)
    assert 700.0 < found <= 701.0


def step_of_a_berg() -> TimeStep:
    """The second half hour of a berg of four elements in a current."""
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, radius=1500.0, placement=(0.0, 0.0), latlon=False)
    model = Model(
        berg, Forcing.uniform(current=(0.3, 0.1), slope=(0.0, 0.0)), Parameters(earth={"latlon": False, "period": 0.0})
    )
    model.advance(steps=1)  # begins with a look around
    return TimeStep(model)


@pytest.mark.parametrize("event", [3.0, 700.0, 1799.0])
def test_what_comes_before_an_event_is_the_state_and_not_taken_again(event: float) -> None:
    """A floor must be met in a step that is short itself."""
    step, taken = step_of_a_berg(), []
    plain = step.motion.trial

    def counted(start: Any, h: float) -> Any:
        taken.append(h)
        return plain(start, h)

    step.motion.trial = counted  # type: ignore[method-assign]
    step._checkpoint()
    first = counted(step.state, 1800.0)
    start = step.state.time
    trial = step._locate_event(first, lambda trial: 1.0 if trial.state.time - start > event else -1.0, 0.05)
    assert step.state.time - start <= event < trial.state.time - start <= event + 0.05
    assert trial.state.time == step.state.time + trial.h
    assert sum(taken) < 3.0 * 1800.0  # twenty times ``event`` before
    step._accept(trial)
    # The parts make the step that they are parts of.
    whole = step_of_a_berg()
    whole._checkpoint()
    whole._accept(whole.motion.trial(whole.state, trial.state.time - start))
    np.testing.assert_allclose(step.state.bodies.twist, whole.state.bodies.twist, rtol=1e-3, atol=1e-15)
    np.testing.assert_allclose(step.applied.sum(axis=1), whole.applied.sum(axis=1), rtol=1e-3)


def test_an_event_in_the_first_moments_is_taken_at_their_end() -> None:
    """A berg that shatters must not stop the clock: cracks are a shortest sub-step apart."""
    step = step_of_a_berg()
    step._checkpoint()
    start = step.state.time
    trial = step._locate_event(
        step.motion.trial(step.state, 1800.0), lambda trial: trial.state.time - start - 0.1, 0.01, least=2.0
    )
    assert (step.state.time, trial.h) == (start, 2.0)
