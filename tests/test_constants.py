"""Constants stand once."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from riftberg import constants

SOURCES = Path(constants.__file__).parent
LAWS = [p for room in ("physics", "engines", "engines/common") for p in sorted((SOURCES / room).glob("*.py"))]
ALL = [p for p in sorted(SOURCES.rglob("*.py")) if p.name != "constants.py"]
VALUES = {name: value for name, value in vars(constants).items() if name.isupper() and isinstance(value, float)}
ORDINARY = {
    "OCEAN_DRAG_SIDE",
    "SEA_ICE_DRAG_SIDE",
    "AIR_DRAG_SIDE",
    "RHO_AIR",
    "WAVE_RADIATION_MAX",
    "SECONDS_PER_DAY",
    "STRESS_INVERSION_DRAG",
}
"""Constants whose values are common numbers that mean other things outside the laws."""


def numbers(path: Path) -> set[float]:
    """Every number written in a file, and the values of ``math.pi / 180``."""
    tree = ast.parse(path.read_text())
    found = {float(n.value) for n in ast.walk(tree) if isinstance(n, ast.Constant) and type(n.value) in (int, float)}
    quotients = (n for n in ast.walk(tree) if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Div))
    degrees = (n for n in quotients if ast.unparse(n) == "math.pi / 180.0")
    return found | {constants.DEGREE for _ in degrees}


@pytest.mark.parametrize("path", ALL, ids=lambda p: str(p.relative_to(SOURCES)))
def test_no_file_types_a_constant_again(path: Path) -> None:
    """Bug once: nine constants of `constants.py` stood a second time in the laws."""
    names = VALUES.keys() if path in LAWS else VALUES.keys() - ORDINARY
    written = numbers(path)
    assert not {name for name in names if VALUES[name] in written}
