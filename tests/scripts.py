"""Scripts of ``benchmarks/`` and ``docs/`` as modules, for the tests of the pages that they write."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]


def loaded(path: str) -> ModuleType:
    """Return a script as a module; ``path`` is that from the root of the repository."""
    file = ROOT / path
    spec = importlib.util.spec_from_file_location(f"{file.parent.name}_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # scripts find each other, as when Python runs one of them
    spec.loader.exec_module(module)
    return module


def table_rows(page: Path, name: str) -> list[tuple[str, ...]]:
    """Return the rows, below the head, of the table between two marks of a page."""
    block = page.read_text("utf-8").partition(f"<!-- {name}: begin -->")[2].partition(f"<!-- {name}: end -->")[0]
    lines = [line for line in block.splitlines() if line.startswith("|")]
    return [tuple(cell.strip() for cell in line[1:-1].split("|")) for line in lines[2:]]
