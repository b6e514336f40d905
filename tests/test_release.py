"""What only people can say is filled in everywhere at once, and a release does not go out without it."""

from __future__ import annotations

import json
import subprocess
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from scripts import loaded

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """Return docs/release.py as a module."""
    return loaded("docs/release.py")


@pytest.fixture
def copy(script: ModuleType, tmp_path: Path) -> Path:
    """Return a repository with those files of this one that hold a placeholder."""
    for name, text in script.texts(ROOT):
        if any(word in text for word in script.WORDS):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text, "utf-8")
    subprocess.run(["git", "init", "--quiet", str(tmp_path)], check=True)
    return tmp_path


def test_no_placeholder_is_left_and_the_files_are_sound(script: ModuleType, copy: Path) -> None:
    before = script.left(copy)
    assert len({line.split(": ")[0] for line in before}) >= 11
    assert script.fill(copy, script.TRIAL) == []
    script.check_metadata(copy)
    assert yaml.safe_load((copy / "CITATION.cff").read_text("utf-8"))["doi"] == script.TRIAL["DOI"]
    creators = json.loads((copy / ".zenodo.json").read_text("utf-8"))["creators"]
    assert creators[0] == {"name": "Trial, Ada", "affiliation": "Institute of Ice", "orcid": "0000-0002-1825-0097"}
    assert "Ada Trial, Bo Trial" in (copy / "LICENSE").read_text("utf-8")
    assert "https://trial.example.org" in (copy / "pyproject.toml").read_text("utf-8")
    assert script.left(copy, later=True) == ["conda-recipe/recipe.yaml: CHECKSUM"]
    assert script.fill(copy, {**script.TRIAL, "CHECKSUM": "0" * 64}) == []


@pytest.mark.parametrize("name", ["ORGANISATION", "SITE_ADDRESS", "CONTACT_ADDRESS", "AI_STATEMENT", "authors"])
def test_a_value_that_is_not_given_is_named_and_nothing_is_written(script: ModuleType, copy: Path, name: str) -> None:
    before = script.left(copy)
    found = script.fill(copy, {**script.TRIAL, name: [] if name == "authors" else ""})
    assert found
    assert all(name in line or "of author 1" in line for line in found)
    assert script.left(copy) == before


def test_a_placeholder_in_a_new_file_is_filled_in_too(script: ModuleType, copy: Path) -> None:
    (copy / "NEW.md").write_text("Write to CONTACT_ADDRESS, and thank the Riftberg developers.\n", "utf-8")
    assert script.fill(copy, script.TRIAL) == ["NEW.md: Riftberg developers"]
    assert (copy / "NEW.md").read_text("utf-8").startswith("Write to maintainers@example.org,")


def test_the_file_of_values_asks_for_all_and_is_empty(script: ModuleType) -> None:
    values: dict[str, Any] = tomllib.loads((ROOT / script.VALUES).read_text("utf-8"))
    assert set(values) == set(script.TRIAL)
    assert set(values["authors"][0]) == {key for author in script.TRIAL["authors"] for key in author}


@pytest.mark.slow
def test_a_release_is_rehearsed_from_the_clone_to_the_site(script: ModuleType, tmp_path: Path) -> None:
    for name in ("build", "twine", "sphinx"):
        pytest.importorskip(name)
    script.rehearse(tmp_path / "release")
