"""The notebooks of the documentation run from top to bottom in a kernel of their own, and show their pictures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
NAMES = sorted(path.name for path in NOTEBOOKS.glob("*.ipynb"))


@pytest.mark.parametrize("name", NAMES)
def test_notebook_is_kept_without_output(name: str) -> None:
    book = json.loads((NOTEBOOKS / name).read_text("utf-8"))
    for cell in book["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "clear the output before the notebook is kept: it changes with each run"
            compile("".join(cell["source"]), name, "exec")
    assert "assert " in "".join(book["cells"][-1]["source"] + book["cells"][-2]["source"])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_notebook_runs_and_shows_its_pictures(name: str, tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    book = nbformat.read(NOTEBOOKS / name, as_version=4)
    nbclient.NotebookClient(
        book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    drawn = 0
    for cell in (cell for cell in book.cells if cell.cell_type == "code"):
        if cell.source.startswith("draw_"):
            shown = [output for output in cell.outputs if "image/png" in output.get("data", {})]
            assert shown, f"no picture below: {cell.source}"
            drawn += 1
    assert drawn


def test_there_are_three() -> None:
    assert len(NAMES) == 3
