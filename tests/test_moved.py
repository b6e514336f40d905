"""Old module paths and names still work, give the same objects, and warn with the new path."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from riftberg import moved

ROOT = Path(__file__).resolve().parent.parent
OLD = [f"riftberg.{path}" for path in moved.MODULES]
INSIDE = {
    "riftberg.io.kid.namelist": "riftberg.kid.namelist",
    "riftberg.ocean.products.era5": "riftberg.products.era5",
}


def forget(path: str) -> None:
    """Let the next import of a path look for it again."""
    for name in [name for name in sys.modules if name == path or name.startswith(path + ".")]:
        del sys.modules[name]


@pytest.mark.parametrize("path", [*OLD, *INSIDE])
def test_an_old_path_gives_the_module_of_today_and_warns(path):
    new = INSIDE.get(path) or f"riftberg.{moved.MODULES[path.removeprefix('riftberg.')]}"
    forget(path)
    with pytest.warns(DeprecationWarning, match=f"^{path} is now {new}$".replace(".", r"\.")):
        old = importlib.import_module(path)
    assert old is importlib.import_module(new)
    assert old.__name__ == new
    assert old.__spec__.name == new


def test_no_old_path_hides_a_module_of_today():
    for path in OLD:
        with_file = [f for f in sys.meta_path if not isinstance(f, moved.OldPaths)]
        folder = importlib.import_module(path.rpartition(".")[0]).__path__ if path.count(".") == 1 else None
        found = [f.find_spec(path, folder) for f in with_file] if folder is not None else []
        assert not any(found), f"{path} exists"


@pytest.mark.parametrize("name", moved.NAMES)
def test_an_old_name_gives_the_object_of_today_and_warns(name):
    home, _, old = f"riftberg.{name}".rpartition(".")
    new_home, _, new = f"riftberg.{moved.NAMES[name]}".rpartition(".")
    with pytest.warns(DeprecationWarning, match=rf"is now {new_home}\.{new}$"):
        value = getattr(importlib.import_module(home), old)
    assert value is getattr(importlib.import_module(new_home), new)


def names_asked_for(folder: str) -> list[tuple[Path, str, str]]:
    """All names of the package that the Python files below a folder import: file, module, name."""
    return [
        (path.relative_to(ROOT), node.module, part.name)
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "riftberg"
        for part in node.names
    ]


def is_there(module: str, name: str) -> bool:
    """Whether a module has a name today, under no old name, and is called so today itself."""
    if moved.new_path(module):
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            home = importlib.import_module(module)
            return hasattr(home, name) or importlib.util.find_spec(f"{module}.{name}") is not None
        except (ImportError, DeprecationWarning):
            return False


@pytest.mark.parametrize("folder", ["src", "tests", "benchmarks", "docs"])
def test_code_of_the_project_asks_only_for_names_of_today(folder):
    """A test that uses an old name fails only once it is collected; a benchmark or a page fails at nobody's desk."""
    asked = names_asked_for(folder)
    assert asked
    assert [f"{path}: {home}.{name}" for path, home, name in asked if not is_there(home, name)] == []


@pytest.mark.parametrize(
    "name", ["viz.style.speed_map", "diagnostics.overlap.shapely_module", "io.run_file.open_run", "no"]
)
def test_a_name_of_the_past_is_not_there(name):
    """The check of our own code sees a name that moved, one that is gone, one in a module that moved, and one that never was."""
    home, _, last = f"riftberg.{name}".rpartition(".")
    assert not is_there(home, last)


@pytest.mark.parametrize("path", moved.GONE_MODULES)
def test_a_module_that_is_gone_says_what_does_its_work(path):
    with pytest.raises(ModuleNotFoundError, match=f"{path} is gone: {moved.GONE_MODULES[path]}".replace(".", r"\.")):
        importlib.import_module(f"riftberg.{path}")


@pytest.mark.parametrize("name", moved.GONE_NAMES)
def test_a_name_that_is_gone_says_what_does_its_work(name):
    home, _, old = f"riftberg.{name}".rpartition(".")
    with pytest.warns(DeprecationWarning, match=f"{old} is gone: "), pytest.raises(AttributeError, match=old):
        getattr(importlib.import_module(home), old)


@pytest.mark.parametrize("text", [*moved.GONE_MODULES.values(), *moved.GONE_NAMES.values()])
def test_what_does_the_work_of_the_gone_is_there(text):
    for path in re.findall(r"riftberg[\w.]+\w", text):
        home, _, name = path.rpartition(".")
        assert hasattr(importlib.import_module(home), name) or importlib.util.find_spec(path), path


def test_what_never_was_is_still_an_error():
    for path in ("riftberg.io.nothing", "riftberg.nothing", "riftberg.ocean.products.nothing"):
        with pytest.raises(ModuleNotFoundError, match=path.replace(".", r"\.")):
            importlib.import_module(path)
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        importlib.import_module("riftberg.experiments").Nothing  # noqa: B018


def test_the_warning_names_the_line_that_imports(tmp_path):
    script = tmp_path / "old.py"
    script.write_text("import sys\nfrom riftberg.io.run_file import open_run\nprint(open_run.__module__)\n")
    done = subprocess.run([sys.executable, "-W", "always", script], capture_output=True, text=True, check=True)
    assert done.stdout == "riftberg.runs.run_file\n"
    assert "old.py:2: DeprecationWarning: riftberg.io.run_file is now riftberg.runs.run_file" in done.stderr
