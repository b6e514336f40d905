"""Cases that need what is not built yet are refused, by the name of the namelist entry or group."""

from __future__ import annotations

from pathlib import Path

import pytest

from riftberg.errors import NamelistError
from riftberg.kid.run import run_kid

from .cases import CASES, REFUSED


@pytest.mark.parametrize("name", REFUSED)
def test_melt_and_footloose_are_refused_by_name(shared: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    with pytest.raises(NamelistError, match=REFUSED[name]) as caught:
        run_kid(shared / "reference" / name, out / "t.nc")
    assert f"{name}/input.nml" in str(caught.value)
    assert not out.exists()


def test_no_case_is_forgotten(shared: Path) -> None:
    folders = {path.name for path in (shared / "reference").iterdir() if path.is_dir()}
    assert folders == {*CASES, *REFUSED, "coupling"}
