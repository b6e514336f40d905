"""``riftberg why --controls`` with the built-in A68a: which part of its ocean each break-up needs."""

from __future__ import annotations

import json
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from riftberg.cli.main import app

pytestmark = pytest.mark.slow


def call(*arguments: object) -> Any:
    """Run the command line."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of A68a until 21 December, with its reasons and controls."""
    path = tmp_path_factory.mktemp("a68a")
    call("run", "a68a", "--days", 12, "-o", path, "-q", "--no-map")
    (path / "told.json").write_text(call("why", path, "--controls", "--json", "--no-figure", "-q").stdout)
    return path


@pytest.fixture(scope="module")
def breakups(folder: Path) -> list[dict[str, Any]]:
    """Return the break-ups: the tip and the finger."""
    content: dict[str, Any] = json.loads((folder / "told.json").read_text())
    found: list[dict[str, Any]] = content["breakups"]
    assert [b["grounded"] for b in found] == [True, False]
    return found


def test_the_shoal_takes_the_tip_and_the_shear_the_finger(breakups: list[dict[str, Any]]) -> None:
    tip, finger = (b["controls"] for b in breakups)
    assert (tip["without shoal"], finger["without shear"]) == ("removed", "removed")
    assert tip["without shear"] == f"breaks off at {breakups[0]['time']}"
    # The finger needs no shoal; from a berg that still has its tip another length of it breaks off.
    found = re.fullmatch(
        r"breaks off at 2020-12-20T\d\d:\d\d:\d\d(?: with another area, (\d+) km2 instead of \d+ km2)?",
        finger["without shoal"],
    )
    assert found is not None, finger["without shoal"]
    assert found[1] is None or 450 <= int(found[1]) <= 900


def test_with_half_the_long_step_both_break_off_as_they_did(breakups: list[dict[str, Any]]) -> None:
    """In equilibrium the long step changes neither piece, see the row "long step of 900 s" in docs/evidence/a68a.md.

    With explicit stepping half the long step took another finger, 783 km2 instead of 504, because the stress rang.
    """
    for breakup in breakups:
        found = re.fullmatch(
            r"breaks off at (2020-12-\d\dT\d\d:\d\d:\d\d)", breakup["controls"]["with half the long step"]
        )
        assert found is not None, breakup["controls"]
        apart = datetime.fromisoformat(found[1]) - datetime.fromisoformat(breakup["time"])
        assert abs(apart) <= timedelta(minutes=2)


def test_the_controls_are_in_the_file_and_not_in_the_run(folder: Path, breakups: list[dict[str, Any]]) -> None:
    written = json.loads((folder / "why.json").read_text())["breakups"]
    assert [b["controls"] for b in written] == [b["controls"] for b in breakups]
    assert sorted(p.name for p in folder.iterdir()) == ["run.nc", "summary.json", "told.json", "why.json"]
