"""Run files are read by every later version; restarts by the version that wrote them, and by others refused in a sentence.

``tests/data`` holds a run file and a restart of each layout, of a small model with a piece that breaks off. No version has been
released yet: one run file and one restart of each release is to be added when it is tagged.
"""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from riftberg import open_run
from riftberg.errors import InputError
from riftberg.runs.restart import load_state

FORMAT = 7

DATA = Path(__file__).parent / "data"
RUNS = sorted(DATA.glob("run-*.nc.gz"))
RESTARTS = sorted(DATA.glob("restart-*.nc.gz"))


def unpacked(packed: Path, folder: Path) -> Path:
    path = folder / packed.stem
    path.write_bytes(gzip.decompress(packed.read_bytes()))
    return path


@pytest.mark.parametrize("packed", RUNS, ids=lambda path: path.name)
def test_run_files_of_all_versions_are_opened(packed: Path, tmp_path: Path) -> None:
    with open_run(unpacked(packed, tmp_path)) as run:
        assert dict(run.sizes) | {"trajectory": 8, "time": 4} == dict(run.sizes)
        assert run["fragment_number"].values.tolist() == [1, 2]
        assert str(run["time"].values[-1])[:16] == "2020-12-11T01:00"
        assert np.isfinite(run["lon"].values).all()
        assert run.attrs["experiment"] == "stored"


@pytest.mark.parametrize("packed", RESTARTS, ids=lambda path: path.name)
def test_restarts_of_other_versions_are_refused_in_a_sentence(packed: Path, tmp_path: Path) -> None:
    path = unpacked(packed, tmp_path)
    layout = int(packed.name.removeprefix("restart-layout-").removesuffix(".nc.gz"))
    if layout == FORMAT:
        state = load_state(path)
        assert state.elements.size == 8
        assert state.time == 129_600.0
        return
    with pytest.raises(
        InputError, match=rf"layout {layout} is older .* Use the Riftberg that wrote it .*make the run again$"
    ):
        load_state(path)


def test_the_present_layout_is_among_them() -> None:
    """A change of the layout takes a new pair of files with it."""
    assert {f"{kind}-layout-{FORMAT}.nc.gz" for kind in ("run", "restart")} <= {
        path.name for path in (*RUNS, *RESTARTS)
    }
