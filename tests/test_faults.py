"""What the machine refuses: memory, room on the disk, rights, a home, a whole cache, a folder to oneself."""

from __future__ import annotations

import hashlib
import os
import pickle
import resource
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import Forcing, Iceberg, Model, Parameters, allow_large
from riftberg.cli.main import app
from riftberg.compiled.kernels import cache_folder
from riftberg.errors import InputError
from riftberg.runs.run_file import RunWriter

MOST_STEPS = 10_000_000

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.0625
berg:
  rectangle: {length: 9 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}
"""
KERNEL = """\
from riftberg.compiled.kernels import cache_folder, kernel

@kernel
def doubled(x):
    return 2.0 * x

print(doubled(21.0), cache_folder())
"""


def riftberg(
    folder: Path, *arguments: str, limit: Callable[[], None] | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own."""
    (folder / "berg.yaml").write_text(EXPERIMENT)
    return subprocess.run(
        [sys.executable, "-m", "riftberg", *arguments], cwd=folder, capture_output=True, text=True, timeout=500,
        preexec_fn=limit, check=False,
        # Where files may not grow, Python would leave cut bytecode of the package behind, which all later imports trip over.
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONDONTWRITEBYTECODE": "1", **environment},
    )  # fmt: skip


def refused(result: subprocess.CompletedProcess[str], *words: str) -> None:
    """Assert that a process ended with one sentence."""
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr


@pytest.mark.slow
def test_files_may_not_grow(tmp_path: Path) -> None:
    """Like ``ulimit -f``: HDF5 answers with a RuntimeError, which once came through as a traceback."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    result = riftberg(tmp_path, "run", "berg.yaml", "-o", "out", "-q", "--no-map", limit=limit)
    refused(result, "Error", "out")


def test_memory_may_not_grow(tmp_path: Path) -> None:
    """Like ``ulimit -v``: a berg of a thousand million elements that was allowed."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))

    (tmp_path / "large.yaml").write_text(EXPERIMENT.replace("placement:", "radius: 0.1\n  placement:"))
    result = riftberg(tmp_path, "run", "large.yaml", "-o", "out", "-q", "--allow-large", limit=limit)
    refused(result, "memory", "radius")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("key", "value"), [("radius", "1 mm"), ("thickness", "1e-12")])
def test_too_much_is_refused_before_any_work(tmp_path: Path, key: str, value: str) -> None:
    """Elements by their number, ice by the sub-steps that it asks for."""
    (tmp_path / "bad.yaml").write_text(EXPERIMENT.replace("placement:", f"{key}: {value}\n  placement:"))
    result = CliRunner().invoke(
        app, ["run", str(tmp_path / "bad.yaml"), "-o", str(tmp_path / "out"), "-q", "--set", "stepping.scheme=mts"]
    )
    assert result.exit_code == 2
    assert "this asks for" in result.stderr or "stable" in result.stderr
    assert not (tmp_path / "out").exists()


def test_limits_can_be_lifted() -> None:
    most = r"this asks for 2000000 elements, about 5 GB; the most is 1000000.*--allow-large"
    with pytest.raises(InputError, match=most):
        Iceberg.rectangle(2e6, 1e6, thickness=200.0, radius=500.0, latlon=False)
    berg = Iceberg.rectangle(9e3, 6e3, thickness=200.0, placement=(-39.0, -55.5))
    sea, many = Forcing.uniform(slope=(0.0, 0.0)), {"scheme": "mts", "substeps": 500_000}
    model, fine = Model(berg, sea), Model(berg, sea, Parameters(stepping=many))
    long: list[tuple[Model, int, str]] = [
        (model, 2 * MOST_STEPS, "long steps"),
        (fine, MOST_STEPS - 1, "days of computing"),
    ]
    for kind, steps, words in long:
        with pytest.raises(InputError, match=words):
            kind.check(steps=steps)
    with allow_large():
        assert [kind.check(steps=steps) for kind, steps, _ in long] == [2 * MOST_STEPS, MOST_STEPS - 1]
    for kind, steps, words in long:
        with pytest.raises(InputError, match=words):
            kind.check(steps=steps)


def cached(folder: Path, **environment: str) -> list[str]:
    """Call a small kernel in a process of its own; returns its result and the folder of its code."""
    (folder / "small.py").write_text(KERNEL)
    kept = {k: v for k, v in os.environ.items() if k not in ("HOME", "RIFTBERG_CACHE", "XDG_CACHE_HOME")}
    result = subprocess.run(
        [sys.executable, str(folder / "small.py")], capture_output=True, text=True, env={**kept, **environment},
        timeout=300, check=False, cwd=folder,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the small kernel and of its code."""
    folder = tmp_path_factory.mktemp("kept")
    assert cached(folder, RIFTBERG_CACHE=str(folder / "cache"))[0] == "42.0"
    return folder


@pytest.mark.quick(1)
@pytest.mark.parametrize("fault", ["garbage", "cut", "empty", "bit"])
def test_a_damaged_cache_is_compiled_anew(tmp_path: Path, kept: Path, fault: str) -> None:
    cache = Path(shutil.copytree(kept / "cache", tmp_path / "cache"))
    files = sorted(cache.rglob("*.code"))
    assert files
    for path in files:
        data = path.read_bytes()
        middle = len(data) // 2
        path.write_bytes(
            {"garbage": b"garbage" * 50, "cut": data[:middle], "empty": b"",
             "bit": data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]}[fault]
        )  # fmt: skip
    assert cached(tmp_path, RIFTBERG_CACHE=str(cache))[0] == "42.0"
    assert sorted(cache.rglob("*.code")) == files  # it was looked up, and made again in its place


@pytest.mark.quick(1)
@pytest.mark.parametrize("place", ["/proc/riftberg", "/dev/null/cache"])
def test_a_cache_that_cannot_be_written_is_done_without(tmp_path: Path, place: str) -> None:
    result, folder = cached(tmp_path, RIFTBERG_CACHE=place)
    assert result == "42.0"
    assert "riftberg-kernels-" in folder
    assert not Path(folder).exists()


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[[Path], Path]]:
    """Give the folder of machine code that is chosen where RIFTBERG_CACHE names a folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))

    def choose(folder: Path) -> Path:
        monkeypatch.setenv("RIFTBERG_CACHE", str(folder))
        cache_folder.cache_clear()
        return cache_folder()

    yield choose
    cache_folder.cache_clear()


@pytest.mark.skipif(os.name != "posix", reason="modes of POSIX")
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o1777, 0o2770])
@pytest.mark.parametrize("depth", [0, 1, 2], ids=["folder", "parent", "grandparent"])
def test_a_cache_that_others_can_write_to_is_refused_with_a_notice(
    mode: int, depth: int, tmp_path: Path, chosen: Callable[[Path], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Bug: whoever could write there had code run as the user, without a word."""
    base = tmp_path / "a" / "shared"
    inner = chosen(base)
    assert inner.is_relative_to(base)
    assert capsys.readouterr().err == ""
    open_one = [inner, inner.parent, base.parent][depth]
    open_one.chmod(mode)
    trusted = mode == 0o1777 and depth > 0  # in a sticky folder nobody moves what is another's
    found = chosen(base)
    assert found.is_relative_to(base if trusted else tmp_path / "home")
    said = capsys.readouterr().err
    assert said == "" if trusted else str(open_one) in said
    (tmp_path / "link").symlink_to(base)
    assert chosen(tmp_path / "link") == found
    open_one.chmod(0o755)
    assert chosen(base) == inner


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="root alone gives folders away")
@pytest.mark.parametrize("depth", [0, 2])
def test_a_cache_of_another_user_is_refused(depth: int, tmp_path: Path, chosen: Callable[[Path], Path]) -> None:
    inner = chosen(tmp_path / "shared")
    os.chown([inner, *inner.parents][depth], 65534, 65534)
    assert chosen(tmp_path / "shared").is_relative_to(tmp_path / "home")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="modes of POSIX")
def test_machine_code_that_others_can_write_to_is_not_run(tmp_path: Path, kept: Path) -> None:
    """Of a file alone, as a umask of 0 leaves it, and of a folder; the code in it is that of somebody else."""
    for mode, folder_mode, run in (
        (0o644, 0o755, True),
        (0o666, 0o755, False),
        (0o664, 0o755, False),
        (0o644, 0o777, False),
    ):
        cache = tmp_path / f"{mode:o}-{folder_mode:o}"
        shutil.copytree(kept / "cache", cache)
        marker = tmp_path / f"{cache.name}.ran"
        for path in cache.rglob("*.code"):
            planted = pickle.dumps(Planted(marker))
            path.write_bytes(planted + hashlib.sha256(planted).digest())
            path.chmod(mode)
            path.parent.chmod(folder_mode)
        assert cached(tmp_path, RIFTBERG_CACHE=str(cache), XDG_CACHE_HOME=str(tmp_path / "home"))[0] == "42.0"
        assert marker.exists() == run


class Planted:
    """What makes a file where it is read."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> Any:
        return Path.touch, (self.marker,)


@pytest.mark.quick(1)
@pytest.mark.parametrize("home", [None, "/nonexistent", "/dev/null"])
def test_without_a_home(tmp_path: Path, home: str | None) -> None:
    given = {} if home is None else {"HOME": home}
    assert cached(tmp_path, XDG_CACHE_HOME="/dev/null", **given)[0] == "42.0"
    assert not (tmp_path / "~").exists()


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    (tmp_path / "berg.yaml").write_text(EXPERIMENT)
    out = tmp_path / "out"
    out.mkdir()
    model, other = FakeModel(), RunWriter(out / "run.nc")
    other.start(model)
    there = sorted(out.iterdir())
    result = CliRunner().invoke(app, ["run", str(tmp_path / "berg.yaml"), "-o", str(out), "-q", "--no-map"])
    assert result.exit_code == 2
    assert "another run" in result.stderr
    assert sorted(out.iterdir()) == there
    other.finish(model)


def test_a_refused_run_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor the folders above it that it made; one that was there stays."""
    (tmp_path / "berg.yaml").write_text(EXPERIMENT)
    folder = tmp_path / "a" / "b" / "c"
    words = ["run", str(tmp_path / "berg.yaml"), "-o", str(folder), "-q", "--no-map"]

    def refuse(self: RunWriter, *arguments: object) -> None:
        raise InputError("no run today")

    with monkeypatch.context() as patched:
        patched.setattr(RunWriter, "start", refuse)
        assert CliRunner().invoke(app, words).exit_code == 2
        assert [path.name for path in tmp_path.iterdir()] == ["berg.yaml"]
    assert CliRunner().invoke(app, words).exit_code == 0
    there = sorted(folder.iterdir())
    monkeypatch.setattr(RunWriter, "start", refuse)
    assert CliRunner().invoke(app, words).exit_code == 2
    assert sorted(folder.iterdir()) == there


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "run.nc").mkdir()
    (tmp_path / "berg.yaml").write_text(EXPERIMENT)
    for folder, words in ((tmp_path / "file", "a file, not a folder"), (tmp_path / "file" / "x", "a file, not a folder"),
                          (Path("/proc/riftberg"), "cannot be written"), (tmp_path, "run.nc is a folder")):  # fmt: skip
        result = CliRunner().invoke(app, ["run", str(tmp_path / "berg.yaml"), "-o", str(folder), "-q"])
        assert result.exit_code == 2
        assert words in " ".join(result.stderr.split())
    run = tmp_path / "fake.nc"
    FakeModel().advance(0.25, recorders=[RunWriter(run, every_hours=3)])
    (tmp_path / "folder.html").mkdir()
    (page := tmp_path / "page.html").symlink_to(run)
    for output, words in (
        (tmp_path / "folder.html", "a folder, where a file goes"),
        (page, "the output is one of the inputs"),
    ):
        result = CliRunner().invoke(app, ["replay", str(run), "-o", str(output)])
        assert result.exit_code == 2
        assert words in " ".join(result.stderr.split())


def test_a_full_disk_is_found_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10, 10, 1000))
    (tmp_path / "berg.yaml").write_text(EXPERIMENT)
    result = CliRunner().invoke(app, ["run", str(tmp_path / "berg.yaml"), "-o", str(tmp_path / "out"), "-q"])
    assert result.exit_code == 2
    assert "0.001 MB are free" in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


def test_a_disk_that_fills_in_the_run_is_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: RunWriter, *arguments: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "berg.yaml").write_text(EXPERIMENT)
    monkeypatch.setattr(RunWriter, "start", full)
    result = CliRunner().invoke(
        app, ["run", str(tmp_path / "berg.yaml"), "-o", str(tmp_path / "out"), "-q", "--no-map"]
    )
    assert result.exit_code == 2
    assert "the disk is full" in result.stderr
    assert not (tmp_path / "out").exists()
