"""The short form of the fuzzer: a fixed sample in the quick set, and one kind of every class among the slow tests.

The long form is ``python tests/fuzz/long.py --kinds 2000``.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from fuzz.base_files import store
from fuzz.families import FAMILIES
from fuzz.judging import BAD, REFUSED, RIGHT, SILENT, TOLD, Kind, Truth, Verdict, judge, judge_apart, vague
from fuzz.kinds import kinds
from fuzz.layouts import LAYOUTS, kind_of
from fuzz.more_kinds import more
from fuzz.oceans import PLAIN, RUN, Ocean, experiment, plain_files, truth

EACH = 1
"""Kinds of a class in the short form."""

STRIDES = (4, pytest.param(1, marks=pytest.mark.slow))
"""The quick set takes every fourth class and family; the slow tests all."""

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


@pytest.mark.parametrize("stride", STRIDES)
def test_bad_input_of_every_class_is_refused_in_one_sentence(tmp_path: Path, stride: int) -> None:
    chosen = sample(EACH, 5)
    assert len(chosen) > 60
    verdicts = [judge(kind, tmp_path / str(number)) for number, kind in enumerate(chosen[::stride])]
    bad = [f"{v.what}: {v.kind.family}, {v.kind.name}: {v.message}" for v in verdicts if v.what in BAD]
    assert not bad, "\n".join(bad)


LONG = ("large_tables", "kills", "streams", "outputs_in_use", "quiet", "waves")
"""Families that take seconds for each kind; the long form has them."""

EVERY = 60
"""Every so-many-th layout in the short form."""


def found(kinds: list[Kind], folder: Path) -> list[Verdict]:
    """Return the verdicts on kinds, each in a process of its own that has all kernels."""
    store()
    return [judge_apart(kind, folder / str(number)) for number, kind in enumerate(kinds)]


def told(verdicts: list[Verdict]) -> str:
    """Return what is bad in a list of verdicts."""
    return "\n".join(f"{v.what}: {v.kind.family}, {v.kind.name}: {v.message}" for v in verdicts if v.what in BAD)


APART = """\
import json, random, sys
from pathlib import Path
from fuzz.base_files import store
from fuzz.families import FAMILIES
from fuzz.judging import judge_apart
from fuzz.kid_kinds import good_ends
from fuzz.layouts import LAYOUTS, kind_of

folder, stride, every, *left_out = sys.argv[1:]
store()
good_ends()
rng = random.Random(7)
kinds = {
    "faults": [rng.choice(list(family())) for family in FAMILIES if family.__name__ not in left_out],
    "layouts": [kind_of(number, doctor=False) for number in range(0, LAYOUTS, int(every))],
}
kinds["faults"] = kinds["faults"][:: int(stride)]
verdicts = {
    what: [judge_apart(kind, Path(folder, what, str(number))) for number, kind in enumerate(some)] for what, some in kinds.items()
}
told = {what: [[v.what, v.kind.family, v.kind.name, v.message] for v in some] for what, some in verdicts.items()}
Path(folder, "verdicts.json").write_text(json.dumps(told))
"""
"""Kinds judged in a fresh process: one that has used threads, as earlier tests have, cannot be forked safely."""


Judged = dict[str, list[tuple[str, str]]]


@pytest.fixture(scope="module", params=STRIDES)
def judged(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Judged:
    """Verdict and story of faults and of layouts, from one process that has loaded the kernels once."""
    folder = tmp_path_factory.mktemp("judged")
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]),
    }
    command = [sys.executable, "-c", APART, str(folder), str(request.param), str(EVERY), *LONG]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    verdicts = json.loads((folder / "verdicts.json").read_text())
    return {
        what: [(verdict, f"{verdict}: {family}, {name}: {message}") for verdict, family, name, message in some]
        for what, some in verdicts.items()
    }


def test_a_fault_of_every_family_is_right_or_refused_or_told(judged: Judged) -> None:
    bad = [story for verdict, story in judged["faults"] if verdict in BAD]
    assert not bad, "\n".join(bad)
    assert len(judged["faults"]) > 12


def test_layouts_are_right_at_the_berg_or_refused_or_told(judged: Judged) -> None:
    verdicts = judged["layouts"]
    bad = [story for verdict, story in verdicts if verdict in BAD]
    assert not bad, "\n".join(bad)
    assert sum(verdict == RIGHT for verdict, _ in verdicts) > len(verdicts) / 2


def test_families_are_sixty_of_ten_kinds_each() -> None:
    tables = [list(family()) for family in FAMILIES]
    assert len(tables) >= 60
    assert all(len({kind.name for kind in table}) == 10 for table in tables)
    assert len({table[0].family for table in tables}) == len(tables)


def test_layouts_are_the_same_every_time_and_differ() -> None:
    names = [kind_of(number).name for number in range(LAYOUTS)]
    assert names == [kind_of(number).name for number in range(LAYOUTS)]
    assert len({name.split(":", 1)[1] for name in names}) > 0.97 * LAYOUTS


def _driven(known: Truth, change: str = "") -> Kind:
    """Return a kind that is a good run whose experiment has one text changed."""

    def make(folder: Path) -> list[str]:
        text = experiment(plain_files(folder), PLAIN)
        (folder / "bad.yaml").write_text(text.replace("wind.nc", change) if change else text)
        return RUN

    return Kind("judge", "good files", make, ("none.nc",), False, known, ("no file matches",))


def test_the_judge_compares_the_value_at_the_berg(tmp_path: Path) -> None:
    """A judge that takes whatever a run gives would make the rest worthless: a field of one per cent more is found."""
    strange = Ocean(lat=PLAIN.lat + 0.5)
    notice = Truth(truth(strange).wrong, ("wind",))
    verdicts = found(
        [_driven(truth()), _driven(truth(strange)), _driven(notice), _driven(truth(), "none.nc")], tmp_path
    )
    assert [v.what for v in verdicts] == [RIGHT, SILENT, SILENT, REFUSED], told(verdicts)


@pytest.mark.slow
def test_the_judge_takes_what_is_told_and_then_holds_to_it(tmp_path: Path) -> None:
    strange = truth(Ocean(lat=PLAIN.lat + 0.5)).wrong
    no_wind = Truth(strange, ("no file gives the wind",), truth(names=("uo", "vo", "slope")).wrong)
    and_wrong = Truth(strange, ("no file gives the wind",), strange)
    verdicts = found([_driven(no_wind, "ocean.nc"), _driven(and_wrong, "ocean.nc")], tmp_path)
    assert [v.what for v in verdicts] == [TOLD, SILENT], told(verdicts)


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
