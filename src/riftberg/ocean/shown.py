"""How a forcing shows itself at a prompt and in a notebook: what `describe` says, at most a screen of it."""

from __future__ import annotations

import html

from riftberg.input_files import shortened


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
