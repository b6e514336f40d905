"""Cases that need what is not built yet are refused, by the name of the namelist entry or group."""

from __future__ import annotations

from pathlib import Path

from .cases import CASES, MELTING


def test_no_case_is_forgotten(shared: Path) -> None:
    folders = {path.name for path in (shared / "reference").iterdir() if path.is_dir()}
    assert folders == {*CASES, *MELTING, "coupling", "more"}
