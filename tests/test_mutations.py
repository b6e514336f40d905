"""The sampler of changes of the source: it runs as its own page says."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from scripts import loaded


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
