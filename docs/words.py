"""Count the words of the documentation, by page and folder.

    python docs/words.py              words of each folder, and the pages over their limit
    python docs/words.py --pages      each page too
    python docs/words.py --at COMMIT  the same beside those of an earlier commit

A word is whatever stands between blanks, as `wc -w` counts; code and tables count, formulas and comments do not.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
UNCOUNTED = ("docs/reference", "docs/evidence", "docs/made-notebooks")
"""Made from the code, tables behind numbers, made with the site: outside of the limit on all pages."""

MOST = {"docs": 55_000, "docs/explanation": 1_500, "README.md": 1_000, "paper/paper.md": 1_750}
"""Most words of all pages that count, of a page of explanation, and of single files."""


def words(text: str) -> int:
    """Return the number of words of a page."""
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]+\$|<!--.*?-->", " ", text, flags=re.DOTALL)
    return len(text.split())


def pages() -> dict[str, int]:
    """Return the words of each page of the working tree."""
    files = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "paper" / "paper.md"]
    return {path.relative_to(ROOT).as_posix(): words(path.read_text("utf-8")) for path in sorted(files)}


def pages_at(commit: str) -> dict[str, int]:
    """Return the words of each page at a commit."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout

    names = git("ls-tree", "-r", "--name-only", commit, "docs", "README.md", "CHANGELOG.md", "paper").splitlines()
    return {name: words(git("show", f"{commit}:{name}")) for name in names if name.endswith(".md")}


def folders(counts: dict[str, int]) -> Counter[str]:
    """Return the words of each folder of ``docs``, of all pages that count, and of the files beside it."""
    sums: Counter[str] = Counter()
    for name, number in counts.items():
        folder = name.rpartition("/")[0]
        sums[folder if folder.startswith("docs") else name] += number
    sums["all that count"] = sum(n for f, n in sums.items() if f.startswith("docs") and f not in UNCOUNTED)
    return sums


def over(counts: dict[str, int]) -> list[str]:
    """Return a line for each limit that is exceeded."""
    lines = []
    for name, number in counts.items():
        most = MOST.get(name) or (MOST["docs/explanation"] if name.startswith("docs/explanation/") else None)
        if most and number > most:
            lines.append(f"{name}: {number} words, at most {most}")
    total = folders(counts)["all that count"]
    if total > MOST["docs"]:
        lines.append(f"docs without {', '.join(UNCOUNTED)}: {total} words, at most {MOST['docs']}")
    return lines


def main() -> int:
    """Print the words, and fail where there are too many."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pages", action="store_true", help="each page too")
    parser.add_argument("--at", help="an earlier commit, to compare with")
    asked = parser.parse_args()
    now, earlier = pages(), pages_at(asked.at) if asked.at else {}
    for title, here, there in (("", folders(now), folders(earlier)), *([("", now, earlier)] if asked.pages else [])):
        for name in sorted({*here, *there}):
            print(f"{name + title:60}" + (f"{there.get(name, 0):8}" if asked.at else "") + f"{here.get(name, 0):8}")
    found = over(now)
    print(*found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
