"""A small picture of a berg as SVG, for notebooks: made of text alone, so that it costs nothing to show."""

from __future__ import annotations

import html
from typing import Final

import numpy as np

from riftberg.constants import DEGREE
from riftberg.state import Elements, Floats

WIDTH: Final = 220.0
"""Longest side of the picture, pixels."""

MOST: Final = 1500
"""Elements that are drawn; of more, every n-th, larger."""

COLOURS: Final = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#777777")
"""Colours of the pieces, safe for colour-blind readers (Tol's bright scheme), in the order of their numbers."""


def portrait(elements: Elements, *, latlon: bool, hexagonal: bool) -> str:
    """Return a picture of the elements in true proportions, north up, coloured by piece."""
    if elements.size == 0:
        return ""
    stride = -(-elements.size // MOST)
    x, y = _metres(elements, latlon)
    half = 0.5 * np.sqrt(elements.length * elements.width) * np.sqrt(stride)
    low_x, high_x = float((x - half).min()), float((x + half).max())
    low_y, high_y = float((y - half).min()), float((y + half).max())
    scale = WIDTH / max(high_x - low_x, high_y - low_y)
    marks = [
        _mark((x[k] - low_x) * scale, (high_y - y[k]) * scale, half[k] * scale, float(elements.rotation[k]), hexagonal,
              COLOURS[(int(elements.berg[k]) - 1) % len(COLOURS)])
        for k in range(0, elements.size, stride)
    ]  # fmt: skip
    size = f'width="{(high_x - low_x) * scale:.0f}" height="{(high_y - low_y) * scale:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="the berg, north up">{"".join(marks)}</svg>'


def _metres(elements: Elements, latlon: bool) -> tuple[Floats, Floats]:
    """Return positions in metres about the first element; a berg across longitude 180 stays in one piece."""
    if not latlon:
        return elements.lon, elements.lat
    east = (elements.lon - elements.lon[0] + 180.0) % 360.0 - 180.0
    per_degree = 6.371e6 * DEGREE
    return east * per_degree * np.cos(elements.lat.mean() * DEGREE), (elements.lat - elements.lat[0]) * per_degree


def _mark(x: float, y: float, half: float, turn: float, hexagonal: bool, colour: str) -> str:
    corners = 6 if hexagonal else 4
    # The half side of a square of equal area; a hexagon of that area reaches 1.24 times as far.
    reach = half * (1.241 if hexagonal else np.sqrt(2.0))
    first = np.pi / 2.0 if hexagonal else np.pi / 4.0
    angles = first + turn + 2.0 * np.pi * np.arange(corners) / corners
    points = " ".join(f"{x + reach * np.cos(a):.1f},{y - reach * np.sin(a):.1f}" for a in angles)
    return f'<polygon points="{points}" fill="{colour}" stroke="white" stroke-width="0.4"/>'


def card(picture: str, text: str) -> str:
    """Return a picture beside lines of text, as a notebook shows it."""
    shown = html.escape(text)
    pre = f'<pre style="margin:0;white-space:pre-wrap">{shown}</pre>'
    return f'<div style="display:flex;gap:1em;align-items:center"><div>{picture}</div>{pre}</div>'
