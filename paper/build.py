"""Make a PDF of the paper, in a plain layout: python paper/build.py PAPER.pdf (pypandoc_binary, typst)."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pypandoc
import typst
import yaml

PAPER = Path(__file__).resolve().parent


def main(pdf: Path) -> None:
    """Write the PDF; a citation without an entry in the bibliography is an error."""
    head = yaml.safe_load((PAPER / "paper.md").read_text("utf-8").split("---\n")[1])
    names = [f"--metadata=author:{author['name']}" for author in head["authors"]]
    options = [
        *names,
        "--standalone",
        "--citeproc",
        f"--resource-path={PAPER}",
        "--fail-if-warnings",
        "--metadata=papersize:a4",
    ]
    text = pypandoc.convert_file(
        str(PAPER / "paper.md"), "typst", extra_args=[*options, f"--bibliography={PAPER / 'paper.bib'}"]
    )
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "paper.typ"
        source.write_text(text, "utf-8")
        pdf.parent.mkdir(parents=True, exist_ok=True)
        pdf.write_bytes(typst.compile(str(source)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
