"""The documentation says what is so: reference pages are fresh, code runs, commands exist, links lead somewhere."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from typer.models import OptionInfo

import riftberg
from keys import extra
from pages import run_blocks
from riftberg.cli.main import app
from riftberg.parameters import fields_by_path
from scripts import loaded

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(path for path in DOCS.rglob("*.md") if path.parent.name != "made-notebooks"),  # made with the site
        *(ROOT / "benchmarks").glob("*.md"),
    ],
    key=lambda path: path.as_posix(),
)
NAMES = [path.relative_to(ROOT).as_posix() for path in PAGES]
QUIRKS = DOCS / "evidence" / "quirks.md"


def script() -> ModuleType:
    """Return docs/build.py as a module."""
    return loaded("docs/build.py")


def blocks(page: Path) -> list[tuple[str, str]]:
    """Return language and content of the code blocks of a page."""
    return re.findall(r"^```(\w+)\n(.*?)^```", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)


def commands() -> list[tuple[str, list[str]]]:
    """Return every command line of the documentation that calls riftberg, with its page."""
    found = []
    for page in PAGES:
        text = "".join(content for kind, content in blocks(page) if kind in ("bash", "console"))
        for line in text.replace("\\\n", " ").splitlines():
            for part in re.split(r"&&|;", line):
                words = shlex.split(part, comments=True)
                if words and Path(words[0]).name == "riftberg":
                    found.append((page.relative_to(ROOT).as_posix(), words[1:]))
    return found


def run_page(page: Path, folder: Path) -> None:
    """Run the Python and bash blocks of a page."""
    run_blocks([block for block in blocks(page) if block[0] in ("bash", "python")], folder)


@pytest.mark.parametrize("name", script().PAGES)
def test_reference_page_is_fresh(name: str) -> None:
    written = (DOCS / "reference" / name).read_text("utf-8")
    assert written == script().page(name), "run: python docs/build.py --pages"


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not re.match(r"[a-z]+:", target):
            path, _, anchor = target.partition("#")
            aim = (page.parent / path).resolve() if path else page
            assert aim.exists(), f"{name} links to {target}"
            assert not anchor or anchor in anchors(aim), f"{name} links to {target}"


@pytest.mark.parametrize("folder", ["tutorials", "howto", "explanation"])
def test_every_page_has_a_line_on_the_first_page(folder: str) -> None:
    """The pages of contents take their groups and lines from there."""
    first = (DOCS / "index.md").read_text("utf-8")
    for path in (DOCS / folder).glob("*.md"):
        assert f"({folder}/{path.name})" in first
    if folder != "tutorials":
        name = {"howto": "how to", "explanation": "explanation"}[folder]
        assert f"<!-- {name}: begin -->" in (DOCS / f"{folder}s.md").read_text("utf-8")
        between = first.partition(f"<!-- {name}: begin -->")[2].partition(f"<!-- {name}: end -->")[0]
        assert all(f"({folder}/{path.name})" in between for path in (DOCS / folder).glob("*.md"))


@pytest.mark.parametrize(("folder", "contents"), [("howto", "howtos.md"), ("explanation", "explanations.md")])
def test_sidebar_first_page_and_pages_have_one_order_and_one_title(folder: str, contents: str) -> None:
    lines = re.findall(rf"^- \[(.+)\]\({folder}/(.+)\.md\)", (DOCS / "index.md").read_text("utf-8"), flags=re.MULTILINE)
    sidebar = re.findall(rf"^{folder}/(.+)$", (DOCS / contents).read_text("utf-8"), flags=re.MULTILINE)
    assert [name for _, name in lines] == sidebar
    titles = [
        (DOCS / folder / f"{name}.md").read_text("utf-8").partition("# ")[2].partition("\n")[0] for name in sidebar
    ]
    assert [title for title, _ in lines] == titles


@pytest.mark.parametrize("word", ["ensemble", "restart", "grounding", "melt", "GLORYS", "OpenDrift", "calving", "BMI"])
def test_a_task_is_found_on_the_first_page_by_the_word_that_a_user_types(word: str) -> None:
    lines = re.findall(r"^- \[.*$", (DOCS / "index.md").read_text("utf-8"), flags=re.MULTILINE)
    assert any(word.lower() in line.lower() for line in lines)


def test_the_documentation_keeps_to_its_number_of_words() -> None:
    assert loaded("docs/words.py").over(loaded("docs/words.py").pages()) == []


def test_the_changelog_has_short_lines_and_few_of_them() -> None:
    releases = re.split(r"^(?=## )", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.MULTILINE)[1:]
    for text in releases:
        lines = text.strip().splitlines()
        assert len(lines) <= 80, lines[0]
        assert [line for line in lines if len(line) > 120] == []


def test_words_are_counted_without_formulas_and_comments() -> None:
    words = loaded("docs/words.py").words
    assert words("A berg of $x = 3 y$ km,\n\n$$\na + b\n$$\n\n<!-- no word --> `run it` | 3 |") == 9


def test_messages_on_the_page_of_troubleshooting_are_those_of_the_program() -> None:
    rows = re.findall(r"^\| ([^|]+) \|", (DOCS / "troubleshooting.md").read_text("utf-8"), flags=re.MULTILINE)
    quoted = [row.strip("` ") for row in rows if re.fullmatch(r"`[^`]+` *", row)]
    assert len(quoted) >= 5
    said = "".join(path.read_text("utf-8") for path in (ROOT / "src" / "riftberg").rglob("*.py"))
    for text in quoted:
        name = re.sub(r"\bu[ov]$", "", text)  # the field is filled in
        assert name in said, text


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize(
    ("page", "words"), commands(), ids=lambda value: value if isinstance(value, str) else " ".join(value)
)
def test_commands_exist(page: str, words: list[str]) -> None:
    """Names of commands and of their options."""
    if words[0].startswith("-"):
        assert words[0] in ("--help", "--version")
        return
    known = {command.name: command.callback for command in app.registered_commands}
    assert words[0] in known, f"{page}: riftberg {words[0]}"
    options = {"--help", "-h"}
    signature = script().inspect.signature(known[words[0]], eval_str=True)
    for p in signature.parameters.values():
        info = getattr(p.annotation, "__metadata__", (None,))[0]  # the context of a command has none
        if isinstance(info, OptionInfo):
            first = [info.default] if isinstance(info.default, str) else []
            given = [*first, *(info.param_decls or ())] or ["--" + p.name.strip("_").replace("_", "-")]
            options |= {part for name in given for part in name.split("/")}
    for word in words[1:]:
        if re.match(r"--?[a-z]", word):
            assert word in options, f"{page}: riftberg {words[0]} {word}"


FAILING = {
    "an error of Python": [("python", "a = 1"), ("python", "assert a == 2")],
    "a deprecated call": [("python", "import warnings"), ("python", "warnings.warn('old', DeprecationWarning)")],
    "code that ends": [("python", "raise SystemExit(3)"), ("bash", "true")],
    "a command": [("bash", "riftberg run nothing.yaml"), ("python", "a = 1")],
    "a command after others": [("bash", "true\nriftberg run nothing.yaml\ntrue")],
    "bash": [("bash", "false\ntrue")],
}


@pytest.mark.parametrize("what", FAILING)
def test_a_page_that_fails_is_noticed(what: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        run_blocks(FAILING[what], tmp_path)


def test_blocks_of_a_page_share_what_they_make(tmp_path: Path) -> None:
    blocks = [
        ("python", "from pathlib import Path\nn = 3"),
        ("bash", "printf 'x' > seen\nriftberg --version"),
        ("python", "assert Path('seen').read_text() == 'x' and n == 3 and __name__ == '__main__'"),
    ]
    run_blocks(blocks, tmp_path)
    assert "riftberg " in (tmp_path / ".said").read_text()


def test_readme_runs(tmp_path: Path) -> None:
    run_page(ROOT / "README.md", tmp_path)


@pytest.mark.slow
def test_the_break_of_the_five_lines_does_not_come_from_the_step() -> None:
    text = (ROOT / "README.md").read_text("utf-8").partition("## Five lines of Python")[2]
    lines = text.partition("```python\n")[2].partition("```")[0].replace("days=6", "days=2.1")
    pieces = []
    for step in (1800, 900):
        here: dict[str, Any] = {}
        code = lines.replace(".changed(", f'.changed(stepping={{"time_step": {step}}}, ')
        assert code.count("time_step") == 1
        exec(code.rpartition("draw_map")[0], here)
        run = here["run"]
        born = (run["fragment_birth_time"] - run["time"][0]).values / np.timedelta64(1, "h")
        pieces.append((np.round(run["fragment_area"].values / 1e6), born))
    assert len(pieces[0][0]) == 3
    np.testing.assert_array_equal(pieces[0][0], pieces[1][0])
    np.testing.assert_allclose(pieces[0][1], pieces[1][1], atol=0.5)


@pytest.mark.parametrize("name", ["first-run.md", pytest.param("from-outline-to-break-up.md", marks=pytest.mark.slow)])
def test_tutorial_runs(name: str, tmp_path: Path) -> None:
    run_page(DOCS / "tutorials" / name, tmp_path)


def test_all_tutorials_are_run() -> None:
    assert sorted(path.name for path in (DOCS / "tutorials").glob("*.md")) == [
        "first-run.md",
        "from-outline-to-break-up.md",
    ]


ENSEMBLES = (
    "a-population.md", "calibration.md", "ensemble-forecast.md", "hazard-products.md", "many-runs.md", "sensitivity.md",
    "update.md", "verification.md",
)  # fmt: skip
"""Pages of five to twenty seconds each, which run with the site; tests of their commands have smaller ensembles."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(path.name, marks=pytest.mark.slow if path.name in ENSEMBLES else ())
        for path in sorted((DOCS / "howto").glob("*.md"))
    ],
)
def test_howto_runs(name: str, tmp_path: Path) -> None:
    run_page(DOCS / "howto" / name, tmp_path)


def test_examples_for_those_who_come_from_other_models_run(tmp_path: Path) -> None:
    run_page(DOCS / "explanation" / "coming-from.md", tmp_path)


def test_every_quirk_is_told() -> None:
    rows = re.findall(r"^\| (Q\d+) \|", QUIRKS.read_text("utf-8"), flags=re.MULTILINE)
    assert sorted(rows, key=lambda q: int(q[1:])) == [f"Q{n}" for n in range(1, 44)]


SWITCHES = [
    path for path, field in fields_by_path().items() if path.startswith("compatibility.") or extra(field, "quirk")
]


@pytest.mark.parametrize("switch", SWITCHES)
def test_every_switch_of_the_quirks_is_told(switch: str) -> None:
    assert f"`{switch}`" in QUIRKS.read_text("utf-8")


@pytest.mark.parametrize("name", riftberg.__all__)
def test_every_public_name_is_on_the_page_of_python(name: str) -> None:
    assert re.search(rf"\briftberg\.{name}\b", (DOCS / "reference" / "api.md").read_text("utf-8"))


def test_the_tables_of_the_code_are_those_of_the_package() -> None:
    """Folders, central types with their fields, and the files of the reading path, whose lengths may be a little old."""
    house, package = loaded("benchmarks/house.py"), ROOT / "src" / "riftberg"
    code = (DOCS / "reference" / "code.md").read_text("utf-8")
    assert house.types_table(package) in code
    path = re.findall(house.FILE_ROW, (DOCS / "explanation" / "architecture.md").read_text("utf-8"), flags=re.MULTILINE)
    assert len(path) == 30
    assert all((package / file).exists() for _, file in path)
    text = code
    table = text.partition("<!-- folders: begin -->")[2].partition("<!-- folders: end -->")[0]
    named = re.findall(r"^\| `([^`]+/)` \|", table, flags=re.MULTILINE)
    assert sorted(named) == sorted(house.folder_sizes(package))


EQUATIONS = {"equations": DOCS / "explanation" / "equations.md", "files": DOCS / "explanation" / "equations-of-life.md"}
SOURCES = sorted(path for room in ("src", "tests", "docs", "benchmarks") for path in (ROOT / room).rglob("*.py"))


def numbered_sections(page: Path) -> set[str]:
    """Return the numbers of the sections of a page."""
    return set(re.findall(r"^#+ (\d+(?:\.\d+)*)\.? ", page.read_text("utf-8"), flags=re.MULTILINE))


@pytest.mark.parametrize("name", EQUATIONS)
def test_sections_of_the_equations_that_are_named_are_there(name: str) -> None:
    known = numbered_sections(EQUATIONS[name])
    for path in [*SOURCES, *PAGES]:
        for text in re.findall(rf"\({name} (\d[\d., ]*)\)", path.read_text("utf-8")):
            for number in re.findall(r"\d+(?:\.\d+)*", text):
                assert number in known, f"{path.relative_to(ROOT)} names {name} {number}"


def test_nothing_refers_to_a_text_that_is_not_here() -> None:
    """Sections of the specification that the project was written from are not in the repository."""
    for path in [*SOURCES, *PAGES]:
        if path != Path(__file__):
            found = re.search(r"\bspec \d|specification of the (dynamics|files)", path.read_text("utf-8"))
            assert found is None, f"{path.relative_to(ROOT)}: {found}"


def test_the_gallery_has_examples_with_a_picture_and_a_number() -> None:
    examples = sorted((DOCS / "gallery").glob("*.py"))
    assert len(examples) >= 12
    for path in examples:
        text = path.read_text("utf-8")
        assert re.search(r'\.png"', text), path.name
        assert re.search(r"^assert ", text, flags=re.MULTILINE), path.name


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.name for path in (DOCS / "gallery").glob("*.py")))
def test_example_of_the_gallery_runs(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    own = {"RIFTBERG_DATA": str(request.getfixturevalue("shared") / "data" / "a68a")} if name == "oras5.py" else {}
    subprocess.run([sys.executable, str(DOCS / "gallery" / name)], cwd=tmp_path, check=True, env={**os.environ, **own})
    assert list(tmp_path.glob("*.png"))


def test_notebooks_become_pages(tmp_path: Path) -> None:
    script().write_notebook_pages(tmp_path, run=False)
    pages = sorted(path.stem for path in tmp_path.glob("*.md"))
    assert pages == sorted(path.stem for path in (DOCS / "notebooks").glob("*.ipynb"))
    text = (tmp_path / "a-berg-in-an-eddy.md").read_text("utf-8")
    assert text.startswith("# A berg in an eddy")
    assert "```python\ndraw_map(run)\n```" in text


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Strictly: warnings and links that lead nowhere are errors; the examples of the gallery are not run."""
    done = subprocess.run(
        [sys.executable, str(DOCS / "build.py"), "--site", "--quick", "--into", str(tmp_path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    first = (tmp_path / "site" / "docs" / "index.html").read_text("utf-8")
    assert "replay.html#play" in first
    assert (tmp_path / "site" / "replay.html").stat().st_size > 50_000
    assert "<math" in (tmp_path / "site" / "docs" / "explanation" / "equations.html").read_text("utf-8")
    assert (tmp_path / "site" / "search.html").exists()
    assert "Iceberg.rectangle" in (tmp_path / "site" / "docs" / "reference" / "api.html").read_text("utf-8")
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 50
    for page in pages:
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text("utf-8")):
            if not re.match(r"[a-z]+:|//", target):
                assert (page.parent / target).exists(), f"{page.relative_to(tmp_path)} leads to {target}"
