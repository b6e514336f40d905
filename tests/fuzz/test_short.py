"""The short form of the fuzzer: some kinds of every class; the long form is ``python tests/fuzz/long.py --kinds 2000``."""

from __future__ import annotations

import random
from collections import defaultdict
from pathlib import Path

import pytest

from fuzz.judging import BAD, Kind, judge, vague
from fuzz.kinds import kinds
from fuzz.more_kinds import more

EACH = 2
"""Kinds of a class in the short form."""

SLOW = ("bench", "plot", "animate")
"""Commands that draw or time for seconds; the long form has them."""


def sample(each: int, seed: int) -> list[Kind]:
    """Return some kinds of every class."""
    families: dict[str, list[Kind]] = defaultdict(list)
    for kind in (*kinds(each), *more(each)):
        if not any(word in f"{kind.family} {kind.name}" for word in SLOW):
            families[kind.family.split(" of ")[0]].append(kind)  # all keys, parameters and options are one class here
    rng = random.Random(seed)
    return [kind for one in families.values() for kind in rng.sample(one, min(each, len(one)))]


def test_bad_input_of_every_class_is_refused_in_one_sentence(tmp_path: Path) -> None:
    verdicts = [judge(kind, tmp_path / str(number)) for number, kind in enumerate(sample(EACH, 5))]
    bad = [f"{v.what}: {v.kind.family}, {v.kind.name}: {v.message}" for v in verdicts if v.what in BAD]
    assert not bad, "\n".join(bad)
    assert len(verdicts) > 60


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_more_bad_input(tmp_path: Path, seed: int) -> None:
    verdicts = [judge(kind, tmp_path / str(number)) for number, kind in enumerate(sample(10, 100 + seed))]
    bad = [f"{v.what}: {v.kind.family}, {v.kind.name}: {v.message}" for v in verdicts if v.what in BAD]
    assert not bad, "\n".join(bad)


def test_the_judge_knows_a_vague_message() -> None:
    """A judge that lets everything pass would make the rest worthless."""
    assert vague("Error: something went wrong", ("a.nc",))
    assert vague("Error: KeyError in a.nc. Try again", ("a.nc",))
    assert vague("a.nc is bad", ("a.nc",))
    assert not vague("Error: a.nc, variable lon: NaN. Fill the gap", ("a.nc",))
