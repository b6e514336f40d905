"""The package that others install: its version, what wheel and sdist hold, and that they run from where they were installed."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

from scripts import loaded

ROOT = Path(__file__).resolve().parents[1]
LINE = '__version__ = "9.9.9"'


def run(*words: str | Path, folder: Path = ROOT, **environment: str) -> str:
    """Run a command; return what it prints."""
    done = subprocess.run(
        [str(word) for word in words], cwd=folder, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )  # fmt: skip
    assert done.returncode == 0, f"{words}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout.strip()


def git(folder: Path, *words: str) -> str:
    return run("git", "-c", "user.name=Nobody", "-c", "user.email=nobody@example.org", *words, folder=folder)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build sdist, and the wheel from it, of the source as version 9.9.9."""
    pytest.importorskip("hatchling")
    pytest.importorskip("build")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    archive = source / "source.tar"
    listed = run("git", "ls-files", "--cached", "--others", "--exclude-standard").splitlines()
    with tarfile.open(archive, "w") as tar:
        for name in listed:
            if (ROOT / name).exists():
                tar.add(ROOT / name, arcname=name)
    with tarfile.open(archive) as tar:
        tar.extractall(source / "riftberg", filter="data")
    git(source / "riftberg", "init", "--quiet")
    git(source / "riftberg", "add", "--all")
    git(source / "riftberg", "commit", "--quiet", "--message", "all")
    git(source / "riftberg", "tag", "v9.9.9")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, source / "riftberg", folder=source)
    return out


def test_version_comes_from_the_tag_and_else_from_the_line(tmp_path: Path) -> None:
    pytest.importorskip("hatchling")
    version_of = loaded("hatch_build.py").version_of
    package = tmp_path / "src" / "riftberg"
    package.mkdir(parents=True)
    (package / "version.py").write_text('__version__ = "1.2.0.dev0"\n', "utf-8")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message", "first")
    assert version_of(tmp_path) == "1.2.0.dev0"  # no tag
    git(tmp_path, "tag", "v1.2.0")
    git(tmp_path, "tag", "older-words")
    assert version_of(tmp_path) == "1.2.0"
    git(tmp_path, "commit", "--quiet", "--allow-empty", "--message", "second")
    head = git(tmp_path, "rev-parse", "HEAD")
    name, _, commit = version_of(tmp_path).partition("+1.g")
    assert name == "1.2.0"
    assert commit
    assert head.startswith(commit)
    # An unpacked archive inside of a tagged checkout of something else.
    inside = tmp_path / "vendor"
    (inside / "src" / "riftberg").mkdir(parents=True)
    (inside / "src" / "riftberg" / "version.py").write_text('__version__ = "3.0"\n', "utf-8")
    assert version_of(inside) == "3.0"


def test_wheel_and_sdist_carry_version_and_licence(built: Path) -> None:
    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    assert wheel.name == "riftberg-9.9.9-py3-none-any.whl"
    assert sdist.name == "riftberg-9.9.9.tar.gz"
    licence = (ROOT / "LICENSE").read_text("utf-8")
    with zipfile.ZipFile(wheel) as file:
        inside = set(file.namelist())
        assert file.read("riftberg-9.9.9.dist-info/licenses/LICENSE").decode() == licence
        assert LINE in file.read("riftberg/version.py").decode()
        metadata = file.read("riftberg-9.9.9.dist-info/METADATA").decode()
    for wanted in ("riftberg/py.typed", "riftberg/viz/coast.npz", "riftberg/viz/replay_template.html"):
        assert wanted in inside
    assert not {name for name in inside if not name.startswith(("riftberg/", "riftberg-9.9.9.dist-info/"))}
    assert re.search(r"^License-Expression: BSD-3-Clause$", metadata, flags=re.MULTILINE)
    with tarfile.open(sdist) as file:
        names = set(file.getnames())
        for wanted in ("LICENSE", "pyproject.toml", "hatch_build.py", "README.md", "CHANGELOG.md", "CITATION.cff"):
            assert f"riftberg-9.9.9/{wanted}" in names
        version = file.extractfile("riftberg-9.9.9/src/riftberg/version.py")
        assert version is not None
        assert LINE in version.read().decode()


def test_descriptions_of_wheel_and_sdist_are_sound(built: Path) -> None:
    pytest.importorskip("twine")
    run(sys.executable, "-m", "twine", "check", "--strict", *built.iterdir())


def test_installed_wheel_runs(built: Path, tmp_path: Path) -> None:
    """From a folder of its own, with the files of the wheel alone."""
    (wheel,) = built.glob("*.whl")
    site = tmp_path / "site"
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", site, wheel)
    inside = {"PYTHONPATH": str(site), "NUMBA_DISABLE_JIT": "1", "folder": tmp_path}
    where = run(sys.executable, "-c", "import riftberg; print(riftberg.__file__)", **inside)  # type: ignore[arg-type]
    assert Path(where).is_relative_to(site)
    assert run(site / "bin" / "riftberg", "--version", **inside) == "riftberg 9.9.9"  # type: ignore[arg-type]
    lines = (
        "from riftberg import *\n"
        "berg = Iceberg.rectangle(length=4e3, width=4e3, thickness=200, radius=1e3, placement=(-40, -55))\n"
        "model = Model(berg, Forcing.uniform(current=(0.1, 0)))\n"
        "run = model.run(days=0.1, output='run.nc'); draw_map(run, 'map.png'); print(run.attrs['source'])"
    )
    assert run(sys.executable, "-c", lines, **inside) == "Riftberg 9.9.9"  # type: ignore[arg-type]
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_one_version_everywhere() -> None:
    """The line, the citation and the descriptions for archives; at a tag also the tag."""
    version = re.search(r'__version__ = "(.+)"', (ROOT / "src/riftberg/version.py").read_text("utf-8"))
    assert version is not None
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), flags=re.MULTILINE)
    assert cited is not None
    recipe = re.search(
        r'^  version: "(.+)"$', (ROOT / "conda-recipe" / "recipe.yaml").read_text("utf-8"), flags=re.MULTILINE
    )
    assert recipe is not None
    described = json.loads((ROOT / "codemeta.json").read_text("utf-8"))["version"]
    assert {cited[1], recipe[1], described} == {version[1].removesuffix(".dev0")}
    words = ["git", "describe", "--tags", "--exact-match", "--match", "v[0-9]*"]
    tag = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    if tag.returncode == 0:
        assert tag.stdout.strip() == f"v{version[1]}"


def test_what_is_imported_is_asked_for() -> None:
    """Every package that a module imports at its top comes with an installation, by itself or with one that is asked for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = {plain(line) for line in project["dependencies"]}
    brought = {
        plain(line) for name in asked for line in importlib.metadata.requires(name) or () if "extra ==" not in line
    }
    used = set()
    for path in (ROOT / "src" / "riftberg").rglob("*.py"):
        used |= set(re.findall(r"^(?:from|import) (\w+)", path.read_text("utf-8"), flags=re.MULTILINE))
    providers = importlib.metadata.packages_distributions()
    for name in sorted(used - {"riftberg", *sys.stdlib_module_names} - OF_EXTRAS):
        assert {plain(provider) for provider in providers[name]} & (asked | brought), name


OF_EXTRAS = {"bmipy", "distributed"}
"""Imported by modules that are themselves imported on use."""


def plain(requirement: str) -> str:
    """Return the name of a package out of a line that asks for it."""
    name = re.match(r"[\w.-]+", requirement)
    assert name is not None
    return name[0].lower().replace("_", "-")


def test_workflows_run_what_can_be_run_here() -> None:
    """Each command of a workflow is one of check.sh, of .github/jobs.sh, or of those that need the host."""
    jobs = re.findall(r"^(\w+)\(\) \{", (ROOT / ".github" / "jobs.sh").read_text("utf-8"), flags=re.MULTILINE)
    workflows = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    assert len(workflows) == 3
    seen = set()
    for path in workflows:
        for job in yaml.safe_load(path.read_text("utf-8"))["jobs"].values():
            for command in (step["run"] for step in job["steps"] if "run" in step):
                if command.startswith("bash .github/jobs.sh "):
                    assert command.split()[2] in jobs
                    seen.add(command.split()[2])
                else:
                    assert command.startswith(("bash check.sh", "python -m pip install ", "gh release create ")), (
                        command
                    )
    assert seen == set(jobs)


def test_conda_recipe_asks_for_what_the_package_asks_for() -> None:
    text = re.sub(r"\$\{\{.*?\}\}", "X", (ROOT / "conda-recipe" / "recipe.yaml").read_text("utf-8"))
    recipe = yaml.safe_load(text)
    names = {"matplotlib-base": "matplotlib"}
    rows = [line.split() for line in recipe["requirements"]["run"] if not line.startswith("python ")]
    asked = {names.get(name, name).replace("_", "-") + limit for name, limit in rows}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert asked == {line.lower() for line in project["dependencies"]}


def test_files_of_the_host_can_be_read() -> None:
    forms = [ROOT / ".github" / "ISSUE_TEMPLATE" / f"{name}.yml" for name in ("config", "bug", "product", "question")]
    for path in (ROOT / ".pre-commit-config.yaml", ROOT / ".github" / "dependabot.yml", *forms):
        assert yaml.safe_load(path.read_text("utf-8"))
    for path in forms[1:]:
        form = yaml.safe_load(path.read_text("utf-8"))
        assert {"name", "description", "body"} <= set(form)
        assert all(part["attributes"]["label"] for part in form["body"])
    for name in ("codemeta.json", ".zenodo.json"):
        assert json.loads((ROOT / name).read_text("utf-8"))["keywords"]


def test_paper_has_its_sections_and_its_citations() -> None:
    text = (ROOT / "paper" / "paper.md").read_text("utf-8")
    heads = re.findall(r"^# (.+)$", text, flags=re.MULTILINE)
    assert heads == [
        "Summary", "Statement of need", "State of the field", "Software design", "Research impact statement",
        "AI usage disclosure", "References",
    ]  # fmt: skip
    known = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text("utf-8"), flags=re.MULTILINE))
    assert set(re.findall(r"@([A-Z]\w+)", text)) == known
    assert 750 <= len(text.split()) <= 1750


@pytest.mark.parametrize(
    ("said", "page", "there"),
    [
        ("2.6 km off", "docs/evidence/scores.md", "| `riftberg run a68a` | 26 Dec | 16 of 16 | 2.6 |"),
        ("16 to 69 km off", "docs/evidence/scores.md", "| `riftberg run a68a-oras5` | 27 Dec | 17 of 17 | 57.6 |"),
        ("within 2.3 × 10⁻⁶ m", "docs/evidence/validation.md", "a68_story               67024     2.3e-06"),
        (
            "a quarter to a twelfth",
            "docs/evidence/speed.md",
            "| A68a, 472 elements, hourly forcing (`a68_story`) | 0.627 | 0.162 | 4.0 |",
        ),
        (
            "a quarter to a twelfth",
            "docs/evidence/speed.md",
            "constant forcing, whole (`a68_oras5`) | 1.75 | 0.149 | 12 |",
        ),
        ("8.6, 15.8 and 20.3 km", "docs/explanation/skill.md", "| Riftberg | 8.6 / 15.8 / 20.3 | |"),
        (
            "10.1 | 18.7 | 23.3",
            "docs/explanation/skill.md",
            "10.1 / 18.7 / 23.3 | -1.5 (-3.1..-0.3), -2.9 (-5.7..-0.3)",
        ),
        ("53.4 km off", "docs/explanation/skill.md", "| Riftberg | 23.1 / 38.6 / 53.4"),
        ("thins by 17 m", "docs/evidence/melt.md", "(`a68a-melt`) | 69 | 60 | 9.3 | 0.02 | 16.7 |"),
        ("up to 22 m", "docs/howto/melting-a68a.md", "21.6 m in three"),
    ],
)
def test_figures_of_the_paper_are_those_of_the_pages(said: str, page: str, there: str) -> None:
    assert said in (ROOT / "paper" / "paper.md").read_text("utf-8")
    assert there in (ROOT / page).read_text("utf-8"), f"{page} says something else now; so must paper/paper.md"


def test_paper_becomes_a_pdf(tmp_path: Path) -> None:
    pytest.importorskip("pypandoc")
    pytest.importorskip("typst")
    run(sys.executable, "paper/build.py", tmp_path / "paper.pdf")
    assert (tmp_path / "paper.pdf").read_bytes().startswith(b"%PDF")
