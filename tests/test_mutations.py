"""The sampler of changes of the source: it runs as its own page says."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from scripts import loaded


@pytest.mark.quick(1)
@pytest.mark.parametrize("seconds", [math.inf, 1e12, 60.0])
def test_tests_are_waited_for_without_a_limit_of_time(
    seconds: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bug: the documented command ended in OverflowError, for ``--for`` is infinite where it is not given."""
    mutations = loaded("tests/mutations.py")
    (tmp_path / "few").mkdir()
    (tmp_path / "few" / "law.py").write_text("HALF = 0.5\n")
    (tmp_path / "test_one.py").write_text("def test_one():\n    pass\n")
    monkeypatch.setattr(mutations, "SOURCE", tmp_path / "few")
    monkeypatch.setattr(mutations, "ROOT", tmp_path)
    tree = mutations.Tree(tmp_path / "results.jsonl")
    code, text = tree.pytest(["test_one.py"], {}, compiled=True, seconds=seconds)
    assert code == 0, text
    assert "1 passed" in text


@pytest.mark.slow
def test_a_set_up_that_compiles_under_load_is_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a thousand tests with a limit of time each, one ended in an error of its set-up on a loaded machine."""
    mutations = loaded("tests/mutations.py")
    (tmp_path / "few").mkdir()
    (tmp_path / "test_one.py").write_text(
        "import time, pytest\n@pytest.fixture\ndef slow():\n    time.sleep(1.2)\ndef test_one(slow):\n    pass\n"
        "def test_two():\n    time.sleep(5.0)\n"
    )
    monkeypatch.setattr(mutations, "SOURCE", tmp_path / "few")
    monkeypatch.setattr(mutations, "ROOT", tmp_path)
    tree = mutations.Tree(tmp_path / "results.jsonl")
    _, text = tree.pytest(["test_one.py"], {"options": ["--timeout", "1"]}, compiled=True, seconds=60.0)
    assert "1 failed, 1 passed" in text
    assert "ERROR" not in text
