"""Cases that need what is not built yet are refused, by the name of the namelist entry or group."""

from __future__ import annotations

from pathlib import Path

import pytest

from riftberg.errors import NamelistError
from riftberg.kid.run import run_kid

from .cases import CASES, MELTING


def test_coupling_cases_are_refused(shared: Path, tmp_path: Path) -> None:
    folders = sorted(path for path in (shared / "reference" / "coupling").iterdir() if path.is_dir())
    assert len(folders) > 10
    for folder in folders:
        with pytest.raises(NamelistError, match="&icebergs_driver_nml is missing"):
            run_kid(folder, tmp_path / "out" / "t.nc")
    assert not (tmp_path / "out").exists()


def test_no_case_is_forgotten(shared: Path) -> None:
    folders = {path.name for path in (shared / "reference").iterdir() if path.is_dir()}
    assert folders == {*CASES, *MELTING, "coupling"}
