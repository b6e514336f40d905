"""kill -9 at any moment: every file is whole or not there, its records are those of the whole run, and leftovers go."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from forked import Program
from riftberg import open_run
from riftberg.runs.restart import load_state
from riftberg.system.atomic_files import replacing

HERE = Path(__file__).parent

COMMON = """
import itertools, sys
from pathlib import Path
sys.path[:0] = [{here!r}]
from fakes import FakeModel
out = Path(sys.argv[1])
steps = int(sys.argv[2])
def tell():
    print("ready", flush=True)
"""

WRITERS = {
    "run.nc": """
from riftberg.runs.run_file import RunWriter
model, writer = FakeModel(), RunWriter(out / "run.nc", every_hours=0.5, flush_seconds=0)
writer.start(model)
tell()
for _ in range(steps):
    model.step()
    writer.record(model)
""",
    "restart": """
from riftberg.runs.restart import save
model = FakeModel()
save(model, out / "run.restart.nc")
tell()
for _ in range(steps):
    model.step()
    save(model, out / "run.restart.nc")
""",
    "kid trajectories": """
import numpy as np
from riftberg.kid.ncfile import BlockWriter
from riftberg.kid.ncfile import Column
writers = [BlockWriter(out / name, [Column("lon", "f8", "longitude", "degrees_E")]) for name in ("t.nc", "bonds.nc")]
tell()
for step in range(steps):
    for writer in writers:
        writer.append({"lon": np.arange(100.0) + 100 * step})
        writer.flush()
""",
    "kid restart": """
import numpy as np
from riftberg.kid.ncfile import Column, write_restart_file
columns = [(Column(f"v{k}", "f8", "value", "m"), np.arange(5000.0) + k) for k in range(20)]
write_restart_file(out / "kid.nc", columns, 5000, counter=True)
tell()
for _ in range(steps):
    write_restart_file(out / "kid.nc", columns, 5000, counter=True)
""",
    "summary": """
from riftberg.system.atomic_files import write_json
summary = {"numbers": list(range(200_000))}
write_json(summary, out / "summary.json")
tell()
for _ in range(steps):
    write_json(summary, out / "summary.json")
""",
    "picture": """
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from riftberg.viz.style import save_figure
figure = Figure()
FigureCanvasAgg(figure)
figure.add_subplot().plot([1, 2, 3])
save_figure(figure, out / "map.png")
tell()
for _ in range(steps):
    save_figure(figure, out / "map.png")
""",
}
SHOWN = """
from riftberg.runs.run_file import RunWriter, open_run
model = FakeModel(4, 2)
model.advance(1, recorders=[RunWriter(out / "run.nc", every_hours=6)])
run = open_run(out / "run.nc")
"""
WRITERS |= {
    "forces": """
from riftberg.bergs.iceberg import Iceberg
from riftberg import Forcing
from riftberg import A68A_2022
from riftberg.runs.model import Model
from riftberg.runs.run_file import RunWriter
berg = Iceberg.rectangle(9e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
model = Model(berg, Forcing.uniform(current=(0.3, 0.0), depth=500.0), A68A_2022)
writer = RunWriter(out / "run.nc", every_hours=0.5, flush_seconds=0, forces=True)
writer.start(model)
model.step()
writer.record(model)
tell()
for _ in range(steps):
    model.step()
    writer.record(model)
""",
    "film": SHOWN
    + """
from riftberg.viz.animate import write_film
write_film(run, out / "film.gif", hours=6, dpi=30)
tell()
for _ in range(steps):
    write_film(run, out / "film.gif", hours=6, dpi=30)
""",
    "replay": SHOWN
    + """
from riftberg.viz.replay import write_replay
write_replay(run, out / "replay.html")
tell()
for _ in range(steps):
    write_replay(run, out / "replay.html")
""",
    "score": SHOWN
    + """
from riftberg import read_observed, score_run
(out / "seen.csv").write_text("date,lat,lon\\n2020-12-10,-55.0,-39.0\\n")
score = score_run(run, read_observed(out / "seen.csv"))
score.write(out / "score.json")
tell()
for _ in range(steps):
    score.write(out / "score.json")
""",
}
"""What each writes, again and again, from when it says that it is ready."""


def _run_is_whole(folder: Path, steps: int) -> None:
    with open_run(folder / "run.nc") as run:
        hours = (run.time.values - run.time.values[0]) / np.timedelta64(30, "m")
        assert hours.tolist() == list(range(run.sizes["time"]))
        assert np.isfinite(run.lon.values).all()
        # An eastward drift: records stand in their order and none is of another run.
        assert (np.diff(run.lon.values, axis=1) > 0.0).all()


def _restart_is_whole(folder: Path, steps: int) -> None:
    state = load_state(folder / "run.restart.nc")
    assert state.time == 1800.0 * state.step_number


def _tracks_are_whole(folder: Path, steps: int) -> None:
    for name in ("t.nc", "bonds.nc"):
        with netCDF4.Dataset(folder / name) as file:
            lon = file["lon"][:]
        assert lon.size % 100 == 0
        np.testing.assert_array_equal(lon, np.arange(lon.size))


def _kid_restart_is_whole(folder: Path, steps: int) -> None:
    with netCDF4.Dataset(folder / "kid.nc") as file:
        for k in range(20):
            np.testing.assert_array_equal(file[f"v{k}"][:], np.arange(5000.0) + k)


def _summary_is_whole(folder: Path, steps: int) -> None:
    assert json.loads((folder / "summary.json").read_text()) == {"numbers": list(range(200_000))}


def _picture_is_whole(folder: Path, steps: int) -> None:
    content = (folder / "map.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    assert content.endswith(b"IEND\xaeB`\x82")


def _forces_are_whole(folder: Path, steps: int) -> None:
    with open_run(folder / "run.nc") as run:
        names = [name for name in run.data_vars if str(name).startswith("force")]
        assert names
        assert all(np.isfinite(run[name].values[..., 1:]).all() for name in names)
        hours = (run.time.values - run.time.values[0]) / np.timedelta64(30, "m")
        assert hours.tolist() == list(range(run.sizes["time"]))


def _film_is_whole(folder: Path, steps: int) -> None:
    from PIL import Image

    with Image.open(folder / "film.gif") as film:
        frames = [film.seek(k) or film.copy() for k in range(film.n_frames)]
    assert len(frames) == 5
    assert (folder / "film.gif").read_bytes().endswith(b";")


def _replay_is_whole(folder: Path, steps: int) -> None:
    assert (folder / "replay.html").read_text().rstrip().endswith("</html>")


def _score_is_whole(folder: Path, steps: int) -> None:
    assert json.loads((folder / "score.json").read_text())["days"]


CHECKS: dict[str, Callable[[Path, int], None]] = dict(
    zip(
        WRITERS,
        (
            _run_is_whole,
            _restart_is_whole,
            _tracks_are_whole,
            _kid_restart_is_whole,
            _summary_is_whole,
            _picture_is_whole,
            _forces_are_whole,
            _film_is_whole,
            _replay_is_whole,
            _score_is_whole,
        ),
        strict=True,
    )
)


def program(name: str) -> str:
    return COMMON.format(here=str(HERE)) + WRITERS[name]


def killed(name: str, folder: Path, after: float, number: int = signal.SIGKILL) -> None:
    process = Program(program(name), str(folder), str(10**9))
    try:
        assert process.printed.readline() == "ready\n"
        time.sleep(after)
        for _ in range(12):
            # netCDF4 loses one Ctrl-C in a hundred, so that it is pressed again, as a person would.
            process.send_signal(number)
            if process.wait(5) is not None:
                return
        pytest.fail("the process did not end")
    finally:
        process.kill()


TIMES = (0.0, 0.037, 0.11)
MANY = tuple(0.033 * k for k in range(16))


@pytest.mark.parametrize("after", [*TIMES, *(pytest.param(t, marks=pytest.mark.slow) for t in MANY)])
@pytest.mark.parametrize("name", ["run.nc", "kid trajectories"])
def test_records_are_whole_wherever_the_run_was_killed(tmp_path: Path, name: str, after: float) -> None:
    killed(name, tmp_path, after)
    CHECKS[name](tmp_path, 0)


@pytest.mark.parametrize("after", [TIMES[1], *(pytest.param(t, marks=pytest.mark.slow) for t in MANY)])
@pytest.mark.parametrize("name", ["restart", "kid restart", "summary", "picture", "forces", "film", "replay", "score"])
def test_files_are_whole_whenever_their_writer_was_killed(tmp_path: Path, name: str, after: float) -> None:
    killed(name, tmp_path, after)
    CHECKS[name](tmp_path, 0)


@pytest.mark.parametrize("after", [TIMES[2], *(pytest.param(4 * t, marks=pytest.mark.slow) for t in MANY[1:9])])
@pytest.mark.parametrize("name", ["film", "replay", "score", "picture"])
def test_an_interrupt_leaves_no_half_of_a_picture(tmp_path: Path, name: str, after: float) -> None:
    """With Ctrl-C the file is the whole one from before, and nothing hidden stays beside it."""
    killed(name, tmp_path, after, signal.SIGINT)
    CHECKS[name](tmp_path, 0)
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".") and path.name.endswith(".part")]


@pytest.mark.parametrize("name", ["run.nc", "summary"])
def test_the_next_run_removes_what_a_killed_one_left(tmp_path: Path, name: str) -> None:
    """A ``.run.nc.part`` once stayed for ever."""
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, text=True, check=True
    )
    file = "run.nc" if name == "run.nc" else "summary.json"
    import platform
    import re

    node = re.sub(r"[^\w]", "_", platform.node())
    old = [f".{file}.part", f".{file}.{gone.stdout.strip()}.part", f".{file}.{node}-{gone.stdout.strip()}-3.part"]
    kept = [f".{file}.{node}-{os.getpid()}-999.part", f".{file}.elsewhere-7-1.part", f".other-{file}.part"]
    for left in (*old, *kept):
        (tmp_path / left).write_bytes(b"half")
    (tmp_path / f".{file}.lock").write_text(gone.stdout)
    assert Program(program(name), str(tmp_path), "2").wait(120) == 0
    CHECKS[name](tmp_path, 2)
    left = {path.name for path in tmp_path.iterdir()} - {file, f".{file}.lock"}
    assert left == set(kept)


def test_nothing_is_left_after_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")

    def fail() -> None:
        with replacing(tmp_path / "a.txt") as part:
            part.write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.txt": "old"}


def test_passing_names_are_never_shared(tmp_path: Path) -> None:
    with replacing(tmp_path / "a.txt") as one, replacing(tmp_path / "a.txt") as other:
        assert one != other
        one.write_text("1")
        other.write_text("2")
    assert (tmp_path / "a.txt").read_text() in ("1", "2")
