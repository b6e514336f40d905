"""Fill in what only people can say, and rehearse a release.

    python docs/release.py left              name each placeholder that is left, and its file; fails if there is one
    python docs/release.py fill              put the values of docs/placeholders.toml into all files; fails if one is left
    python docs/release.py rehearse FOLDER   a whole release with trial values, in an empty folder: a clone, filled in and
                                             tagged, sdist and wheel, an installation, metadata, site (some minutes)

Nothing is sent anywhere.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
VALUES = "docs/placeholders.toml"
AUTHORS = "Riftberg developers"
LATER = ("CHECKSUM", "DOI")
"""Known only once the release is there."""

WORDS = ("ORGANISATION", "SITE_ADDRESS", "CONTACT_ADDRESS", "AI_STATEMENT", "AFFILIATION", AUTHORS, "CHECKSUM")
ABOUT_THEM = (VALUES, "docs/release.py", "docs/release.md", "tests/test_release.py")
"""Files that name the placeholders and do not hold them."""

TRIAL: dict[str, Any] = {
    "ORGANISATION": "trial-organisation",
    "SITE_ADDRESS": "trial.example.org",
    "CONTACT_ADDRESS": "maintainers@example.org",
    "AI_STATEMENT": "A statement that the authors write.",
    "DOI": "10.5281/zenodo.0",
    "CHECKSUM": "",
    "authors": [
        {"given": "Ada", "family": "Trial", "affiliation": "Institute of Ice", "orcid": "0000-0002-1825-0097"},
        {"given": "Bo", "family": "Trial", "affiliation": "University of the Sea", "orcid": ""},
    ],
}


def run(*words: str | Path, folder: Path, **environment: str) -> str:
    """Run a command; return what it prints, and stop where it fails."""
    done = subprocess.run(
        [str(word) for word in words], cwd=folder, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )  # fmt: skip
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout.strip()


def texts(folder: Path) -> Iterator[tuple[str, str]]:
    """Return name and text of each file of the repository that may hold a placeholder."""
    for name in run("git", "ls-files", "--cached", "--others", "--exclude-standard", folder=folder).splitlines():
        path = folder / name
        if name not in ABOUT_THEM and path.is_file():
            try:
                yield name, path.read_text("utf-8")
            except UnicodeDecodeError:
                continue


def left(folder: Path, *, later: bool = False) -> list[str]:
    """Return a line for each placeholder in a file; those that are known after the release only with ``later``."""
    words = [word for word in WORDS if later or word not in LATER]
    return [f"{name}: {word}" for name, text in texts(folder) for word in words if re.search(rf"\b{word}\b", text)]


def missing(values: Mapping[str, Any]) -> list[str]:
    """Return the names of the values that are not given."""
    names = [name for name in TRIAL if name not in (*LATER, "authors") and not values.get(name)]
    authors = values.get("authors") or [{}]
    for number, author in enumerate(authors, 1):
        names += [f"{key} of author {number}" for key in ("given", "family", "affiliation") if not author.get(key)]
    return names


def author_texts(authors: list[dict[str, str]]) -> dict[str, tuple[str, str]]:
    """Return for each file with authors what stands there and what takes its place."""
    names = [f"{a['given']} {a['family']}" for a in authors]
    places = list(dict.fromkeys(a["affiliation"] for a in authors))

    def orcid(author: dict[str, str], text: str) -> str:
        return text.format(author["orcid"]) if author.get("orcid") else ""

    cff = [f"  - family-names: {a['family']}\n    given-names: {a['given']}\n    affiliation: {a['affiliation']}"
           + orcid(a, "\n    orcid: https://orcid.org/{}") for a in authors]  # fmt: skip
    zenodo = [{"name": f"{a['family']}, {a['given']}", "affiliation": a["affiliation"],
               **({"orcid": a["orcid"]} if a.get("orcid") else {})} for a in authors]  # fmt: skip
    people = [{"@type": "Person", "givenName": a["given"], "familyName": a["family"],
               "affiliation": {"@type": "Organization", "name": a["affiliation"]},
               **({"@id": f"https://orcid.org/{a['orcid']}"} if a.get("orcid") else {})} for a in authors]  # fmt: skip
    paper = [f"  - name: {a['given']} {a['family']}" + orcid(a, "\n    orcid: {}")
             + f"\n    affiliation: {places.index(a['affiliation']) + 1}" for a in authors]  # fmt: skip
    rooms = [f"  - name: {place}\n    index: {number}" for number, place in enumerate(places, 1)]
    return {
        "CITATION.cff": ("  - name: The Riftberg developers", "\n".join(cff)),
        ".zenodo.json": ('[{"name": "The Riftberg developers"}]', json.dumps(zenodo, ensure_ascii=False)),
        "codemeta.json": ('[{"@type": "Organization", "name": "The Riftberg developers"}]',
                          json.dumps(people, ensure_ascii=False)),
        "pyproject.toml": ('{ name = "The Riftberg developers" }',
                           ", ".join(f"{{ name = {json.dumps(name, ensure_ascii=False)} }}" for name in names)),
        "paper/paper.md": ("  - name: The Riftberg developers\n    affiliation: 1\naffiliations:\n"
                           "  - name: AFFILIATION\n    index: 1", "\n".join([*paper, "affiliations:", *rooms])),
        "LICENSE": ("the Riftberg developers", ", ".join(names)),
        "docs/site/conf.py": ("The Riftberg developers", ", ".join(names)),
    }  # fmt: skip


def fill(folder: Path, values: Mapping[str, Any]) -> list[str]:
    """Put the values into all files of a repository; return the placeholders that are left."""
    if missing(values):
        return [f"{VALUES}: {name} is not given" for name in missing(values)]
    authors = author_texts(values["authors"])
    for name, text in texts(folder):
        new = text.replace(*authors[name]) if name in authors else text
        for word in WORDS:
            if values.get(word):
                new = re.sub(rf"\b{word}\b", lambda _, word=word: values[word], new)  # type: ignore[misc]
        if name == "CITATION.cff" and values.get("DOI") and "\ndoi: " not in new:
            new = new.replace("\nlicense:", f"\ndoi: {values['DOI']}\nlicense:", 1)
        if new != text:
            (folder / name).write_text(new, "utf-8")
    return left(folder, later=bool(values.get("CHECKSUM")))


def check_metadata(folder: Path) -> None:
    """Stop unless the files that archives and reference managers read are sound and of one version."""
    import yaml

    cited = yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))
    archive = json.loads((folder / ".zenodo.json").read_text("utf-8"))
    described = json.loads((folder / "codemeta.json").read_text("utf-8"))
    project = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    head = yaml.safe_load((folder / "paper" / "paper.md").read_text("utf-8").split("---\n")[1])
    count = len(cited["authors"])
    assert cited["version"] == described["version"], "versions of CITATION.cff and codemeta.json"
    assert all(author["family-names"] and author["given-names"] for author in cited["authors"])
    for authors in (archive["creators"], described["author"], project["authors"], head["authors"]):
        assert len(authors) == count, "authors are not the same everywhere"
    assert {author["affiliation"] for author in head["authors"]} == {place["index"] for place in head["affiliations"]}
    assert archive["license"] == project["license"] == cited["license"]
    assert set(archive) >= {"title", "description", "upload_type", "creators", "license"}, "what an archive asks for"


def rehearse(folder: Path) -> None:
    """Make a whole release with trial values in an empty folder."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        sys.exit(f"{folder} is not empty")
    clone, dist, site = folder / "riftberg", folder / "dist", folder / "installed"
    git = ("git", "-c", "user.name=Nobody", "-c", "user.email=nobody@example.org")

    run("git", "clone", "--quiet", "--no-hardlinks", ROOT, clone, folder=folder)
    line = clone / "src" / "riftberg" / "version.py"
    line.write_text(line.read_text("utf-8").replace(".dev0", ""), "utf-8")
    cited = re.search(r"^version: (.+)$", (clone / "CITATION.cff").read_text("utf-8"), flags=re.MULTILINE)
    assert cited is not None
    version = cited[1]
    found = fill(clone, TRIAL)
    if found:
        sys.exit("\n".join(found))
    check_metadata(clone)
    run(*git, "commit", "--quiet", "--all", "--message", f"Riftberg {version}", folder=clone)
    run(*git, "tag", "--force", "--annotate", f"v{version}", "--message", f"Riftberg {version}", folder=clone)
    print(f"clone, filled in and tagged as v{version}; authors, licence and version agree in all files")

    archive = folder / f"v{version}.tar.gz"
    run(
        "git",
        "archive",
        "--format=tar.gz",
        f"--prefix=riftberg-{version}/",
        f"--output={archive}",
        "HEAD",
        folder=clone,
    )
    checksum = hashlib.sha256(archive.read_bytes()).hexdigest()
    if fill(clone, {**TRIAL, "CHECKSUM": checksum}):
        sys.exit("\n".join(left(clone, later=True)))
    run("git", "checkout", "--quiet", ".", folder=clone)
    print(f"archive {archive.name}, its checksum in the conda recipe, no placeholder left")

    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, clone, folder=folder)
    run(sys.executable, "-m", "twine", "check", "--strict", *dist.iterdir(), folder=folder)
    (wheel,) = dist.glob(f"riftberg-{version}-*.whl")
    assert (dist / f"riftberg-{version}.tar.gz").is_file(), "the source distribution has another version"
    run(
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--target",
        site,
        wheel,
        folder=folder,
    )
    said = run(site / "bin" / "riftberg", "--version", folder=folder, PYTHONPATH=str(site))
    assert said == f"riftberg {version}", said
    run(site / "bin" / "riftberg", "experiments", folder=folder, PYTHONPATH=str(site))
    print(f"{wheel.name} and its source distribution: checked, installed, run")

    run(sys.executable, clone / "docs" / "build.py", "--site", "--quick", "--into", folder / "made", folder=clone)
    first = (folder / "made" / "site" / "docs" / "index.html").read_text("utf-8")
    assert "Riftberg" in first
    print(f"site in {folder / 'made' / 'site'}, without a warning")


def main() -> int:
    """Do what is asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", choices=("left", "fill", "rehearse"))
    parser.add_argument("folder", nargs="?", type=Path, help="empty folder for a rehearsal")
    asked = parser.parse_args()
    if asked.what == "rehearse":
        if asked.folder is None:
            parser.error("rehearse needs an empty folder")
        rehearse(asked.folder.resolve())
        return 0
    found = left(ROOT) if asked.what == "left" else fill(ROOT, tomllib.loads((ROOT / VALUES).read_text("utf-8")))
    print(*found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
