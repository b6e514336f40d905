"""How a forcing shows itself at a prompt and in a notebook: what `describe` says, at most a screen of it."""

from __future__ import annotations

import html
from typing import Final

from riftberg.system.input_files import shortened


def pair_text(pair: tuple[float, ...]) -> str:
    """Return numbers in brackets, such as ``(0.2, -0.05)``."""
    return "(" + ", ".join(f"{part:.5g}" for part in pair) + ")"


def flows_text(current: tuple[float, ...], wind: tuple[float, ...]) -> str:
    """Return what water and air do, without what is nothing."""
    flows = [f"{name} {pair_text(pair)} m/s" for name, pair in (("current", current), ("wind", wind)) if any(pair)]
    return ", ".join(flows) or "still water and air"


def said(*parts: str) -> str:
    """Return the parts that say something, one after the other."""
    return ", ".join(filter(None, parts))


POINTS: Final = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def compass(towards: float) -> str:
    """Return a direction (degrees clockwise from north) as a point of the compass, or in degrees."""
    eighth, rest = divmod(towards % 360.0, 45.0)
    return POINTS[int(eighth)] if rest == 0.0 else f"{towards:g} degrees"


class ShownForcing:
    """Gives a forcing its `repr` and its look in notebooks; it needs a method ``describe``."""

    def describe(self) -> str:
        """Return what this forcing is; each forcing has its own words."""
        return ""

    def __repr__(self) -> str:
        lines = [shortened(line, 160) for line in self.describe().splitlines()]
        shown = lines if len(lines) <= 20 else [*lines[:19], f"... and {len(lines) - 19} lines more, see describe()"]
        return f"<{type(self).__name__}: " + "\n  ".join(shown) + ">"

    def _repr_html_(self) -> str:
        return f'<pre style="white-space:pre-wrap">{html.escape(repr(self)[1:-1])}</pre>'
