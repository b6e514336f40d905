"""The house: nothing imports upwards, no circles (the contracts stand in ``pyproject.toml``), no long lists of arguments."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

from scripts import loaded

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def loggers_kept():
    """Keep the loggers as they are: import-linter configures logging and disables all that it does not know."""
    known = [logger for logger in logging.root.manager.loggerDict.values() if isinstance(logger, logging.Logger)]
    before = [(logger, logger.disabled) for logger in known]
    yield
    for logger, disabled in before:
        logger.disabled = disabled


@pytest.mark.usefixtures("loggers_kept")
def test_no_import_runs_upwards_and_none_in_circles(capsys):
    broken = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert not broken, capsys.readouterr().out


def test_no_function_takes_more_than_ten_arguments_but_kernels_and_commands():
    """Others take an options object, or options of a typed dict, which are checked by name in one place."""
    house = loaded("benchmarks/house.py")
    assert not house.with_many_arguments(house.modules(ROOT / "src" / "riftberg"))


def test_a_kernel_with_more_says_why_above_it(tmp_path):
    house = loaded("benchmarks/house.py")
    assert not house.without_reason(ROOT / "src" / "riftberg")
    names = ", ".join("abcdefghijk")
    (tmp_path / "law.py").write_text(f"@kernel\ndef many({names}): ...\n\n# Why\n@kernel\ndef said({names}): ...\n")
    assert house.without_reason(tmp_path) == ["law.many"]


def test_tests_hold_few_names_of_the_insides():
    """Once they held 1,030, and each renaming was paid for there first; a new test asks what a user can ask."""
    assert len(loaded("benchmarks/house.py").inner_names(ROOT / "tests")) <= 463


def test_names_say_what_a_value_is_and_what_a_function_does():
    """Once 6 % of the names were empty words (`part`, `found`, `own`), and 124 functions ended in a preposition."""
    house = loaded("benchmarks/house.py")
    trees = {name: tree for name, tree in house.modules(ROOT / "src" / "riftberg").items() if name.split(".")[1:2]}
    empty, bound = house.empty_names(trees)
    assert empty.total() < 0.01 * bound, empty
    assert len(house.named_by_preposition(trees)) <= 24
    code = house.ast.parse("def depth_at(place): part = place\ndef field_of_x(): ...\ndef find_depth(point): ...\n")
    assert house.empty_names({"a.b": code}) == ({"place": 1, "part": 1}, 3)
    assert house.named_by_preposition({"a.b": code}) == ["a.b.depth_at", "a.b.field_of_x"]
