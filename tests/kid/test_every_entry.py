"""Every namelist entry in every scheme: it changes the result as the specification says, or is refused, or is told to be idle.

What the report calls without effect changes nothing, not the last bit.

All of it: ``python -m pytest -m "slow or not slow" tests/kid/test_every_entry.py``, some five minutes; a fixed sample of
it runs with the quick tests.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from riftberg.errors import InputError
from riftberg.kid.entries import GROUPS, NEEDS, Entry

from . import scenes
from .entry_checks import BY_SCHEME, CHECKS
from .entry_trials import FLIP, TRIALS, Trial
from .scenes import COMMON, DRIVERS, SCENES, SCHEMES, Outcome, Values

HONOURED = "honoured"
REFUSED = "refused"
REPORTED = "reported"
INTEGER = "integer"
LOGICAL = "logical"

ROUND_OFF = 1e-9
"""Largest difference of what is the same but for round-off, as part of the largest value."""


def entries_of(treatment: str) -> list[tuple[str, Entry]]:
    return [(group, entry) for group, table in GROUPS.items() for entry in table if entry.treatment == treatment]


def in_sample(number: int, scheme: str, every: int = 4) -> bool:
    """Whether a case is of the quick sample: each fourth entry, in another scheme each time."""
    return number % every == 0 and list(SCHEMES)[number // every % 4] == scheme


def cases(treatment: str, every: int = 4) -> list[Any]:
    return [
        pytest.param(group, entry, scheme, id=f"{group.split('_')[0]}-{entry.name}-{scheme}",
                     marks=() if in_sample(k, scheme, every) else pytest.mark.slow)
        for k, (group, entry) in enumerate(entries_of(treatment)) for scheme in SCHEMES
    ]  # fmt: skip


def scene_values(group: str, scene: str, scheme: str, given: Values, driver: Values) -> Values:
    """Return all values of a group in a scene."""
    defaults = {entry.name: entry.default for entry in GROUPS[group]}
    if group == "icebergs_nml":
        return {**defaults, **COMMON, **SCHEMES[scheme], **SCENES[scene], **given}
    return {**defaults, **DRIVERS[scene], **driver}


_KEPT: dict[str, Outcome] = {}


def run(trial: Trial, scheme: str, given: Values, driver: Values, *, keep: bool = False) -> Outcome:
    """Run the scene of a trial; unchanged scenes are kept, for many entries share them."""
    key = repr((trial.scene, scheme, given, driver, trial.restart, trial.prepare))
    if key not in _KEPT:
        more: dict[str, Any] = {"restart": trial.restart}
        if trial.prepare is not None:
            more["prepare"] = trial.prepare
        found = scenes.run(trial.scene, scheme, driver, given, **more)
        if not keep:
            return found
        _KEPT[key] = found
    return _KEPT[key]


def pair_of_runs(trial: Trial, group: str, name: str, scheme: str) -> tuple[Outcome, Any]:
    """Return the run without the change, and a function that runs with it."""
    given = {**trial.given, **(trial.multiple if SCHEMES[scheme].get("mts") else {})}
    driver = dict(trial.driver)
    value = trial.value
    if value is FLIP:
        value = not scene_values(group, trial.scene, scheme, given, driver)[name]
    before = run(trial, scheme, given, driver, keep=True)
    (given if group == "icebergs_nml" else driver)[name] = value
    return before, functools.partial(run, trial, scheme, given, driver)


def test_every_honoured_entry_has_a_trial() -> None:
    wanted = {(group, entry.name) for group, entry in entries_of(HONOURED)}
    assert wanted == {(group, name) for group, trials in TRIALS.items() for name in trials}
    names = {entry.name for table in GROUPS.values() for entry in table}
    assert set(NEEDS) <= names
    flags = {word.lstrip("-") for line in NEEDS.values() for word in line.split() if word != "|"}
    assert flags <= names
    assert set(CHECKS) <= names


@pytest.mark.quick(9)
@pytest.mark.parametrize(("group", "entry", "scheme"), cases(HONOURED))
def test_an_honoured_entry_acts_or_is_told_to_be_idle(group: str, entry: Entry, scheme: str) -> None:
    trial = TRIALS[group][entry.name]
    if scheme in trial.refused:
        with pytest.raises(InputError, match=trial.refused[scheme]):
            pair_of_runs(trial, group, entry.name, scheme)[1]()
        return
    before, changed = pair_of_runs(trial, group, entry.name, scheme)
    after = changed()
    idle = scheme in trial.idle
    said = after.said(entry.name)
    if idle:
        assert said.startswith("no effect here: ")
        assert scenes.same(before.files, after.files)
        return
    assert said.startswith("honoured")
    if trial.where == "same":
        assert scenes.same(before.files, after.files)
    elif trial.where == "roundoff":
        near(before.state, after.state)
    elif trial.where == "files" or scheme in trial.only_files:
        assert not scenes.same(before.files, after.files)
        assert set(after.state) != set(before.state) or scenes.same_values(before.state, after.state)
    else:
        assert not scenes.same_values(before.state, after.state)
    check = BY_SCHEME.get((entry.name, scheme), CHECKS.get(entry.name))
    if check is not None:
        assert check(before, after) in (None, True)


def near(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    """The same but for round-off."""
    for name, values in one.items():
        assert np.abs(values - other[name]).max() <= ROUND_OFF * max(np.abs(values).max(), 1e-30), name


def other_value(entry: Entry) -> Any:
    if entry.kind == LOGICAL:
        return not entry.default
    if entry.kind == INTEGER:
        return int(entry.default) + 1  # type: ignore[arg-type]
    return float(entry.default) + 1.0  # type: ignore[arg-type]


@pytest.mark.quick(3)
@pytest.mark.parametrize(("group", "entry", "scheme"), cases(REPORTED))
def test_an_entry_without_effect_has_none(group: str, entry: Entry, scheme: str) -> None:
    """And the report says why."""
    trial = Trial(scene="berg")
    given, driver = {}, {}  # type: ignore[var-annotated]
    before = run(trial, scheme, given, driver, keep=True)
    (given if group == "icebergs_nml" else driver)[entry.name] = other_value(entry)
    after = run(trial, scheme, given, driver)
    assert scenes.same(before.files, after.files)
    assert after.said(entry.name) == f"no effect here: {entry.note}"


@pytest.mark.parametrize(("group", "entry", "scheme"), cases(REFUSED, every=1))
def test_a_refused_entry_is_named_with_what_to_write(group: str, entry: Entry, scheme: str) -> None:
    # One of them makes bergs where there is no restart.
    absent = entry.name == "generate_test_icebergs"
    remove = {"prepare": lambda folder: (folder / "INPUT" / "icebergs.res.nc").unlink()} if absent else {}
    with pytest.raises(InputError, match=f"{entry.name} = .true.: .*Remedy: .*{entry.name}: set it to .false."):
        scenes.run("berg", scheme, {}, {entry.name: not entry.accepted}, **remove)


OF_THE_DATA = ("ni", "nj", "gridres", "ibuo", "ibvo", "ibua", "ibuy", "collision_test", "big_grounding_test", "fl_test")
"""Entries of the driver that its A68 case takes from its data, or does not have."""


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", OF_THE_DATA)
def test_the_a68_case_takes_grid_and_fields_from_its_data(name: str) -> None:
    """And says so of each entry that would set them otherwise."""
    trial = Trial(scene="a68")
    before = run(trial, "verlet", {}, {}, keep=True)
    entry = next(entry for entry in GROUPS["icebergs_driver_nml"] if entry.name == name)
    after = run(trial, "verlet", {}, {name: other_value(entry)})
    assert after.said(name) == "no effect here: it acts with a68_test = .false. only"
    assert scenes.same(before.files, after.files)


def test_an_entry_that_lacks_another_one_is_told_which() -> None:
    """Three examples: DEM bonds without multiple steps, footloose calving that is off, an ocean that is not there."""
    found = scenes.run(
        "berg", "verlet", {}, {"dem_spring_coef": 1e6, "fl_strength": 18.0, "tau_calving": 2.0, "passive_mode": True}
    )
    assert found.said("dem_spring_coef") == (
        "no effect here: it acts with mts = .true. and dem = .true. and iceberg_bonds_on = .true. only"
    )
    assert found.said("fl_strength") == "no effect here: it acts with footloose = .true. only"
    assert found.said("tau_calving").startswith("no effect here: in cases with an ocean")
