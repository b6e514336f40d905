"""The sea floor behind a map: steps of depth as colour, the same for all maps, and isobaths."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from riftberg.runs.scene import Box
from riftberg.state import Floats
from riftberg.viz import colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ISOBATHS: Final = (50, 100, 200, 300, 500, 1000, 2000, 3000, 4000, 5000)

DEPTHS: Final = (0, *ISOBATHS, 7000, 12000)
"""Edges (m) of the steps in which the sea floor is shaded."""

UNKNOWN_DEPTH: Final = 9000.0
"""A floor that is this deep (m) all over is the deep water of a run that knows no sea floor."""

NO_FLOOR: Final = 20.0
"""A floor nowhere deeper than this (m) is none: a depth of 0, and the sea level on top of it."""

POINTS: Final = 260
"""Points of the depth along each side of a map."""

STEPPED: Final = 50
"""A floor of fewer depths than this has steps, such as a zone that is simply declared dry, and no isobaths."""


class KnownDepth(Protocol):
    """What knows the depth of water."""

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""


class SeaFloor:
    """The depth of water in a box, as far as it is known.

    ``least``: a floor nowhere deeper than this (m) is none.
    """

    def __init__(self, box: Box, water: KnownDepth, *, least: float = NO_FLOOR) -> None:
        axes = np.linspace(box.west, box.east, POINTS), np.linspace(box.south, box.north, POINTS)
        self.x, self.y = np.meshgrid(*axes)
        self.depth: Any = np.ma.masked_invalid(water.depth(self.x, self.y))
        self.known = not self.depth.mask.all() and float(self.depth.max()) > least

    @property
    def span(self) -> tuple[float, float]:
        """Return the least and the largest depth, m."""
        return float(self.depth.min()), float(self.depth.max())

    def shade(self, ax: Axes) -> bool:
        """Draw the depth in steps of colour; returns False where the water is only deep."""
        from matplotlib.colors import BoundaryNorm

        if self.span[0] >= UNKNOWN_DEPTH:
            return False
        shades = colours.depth_map()
        norm = BoundaryNorm(DEPTHS, shades.N)
        ax.contourf(self.x, self.y, self.depth, levels=DEPTHS, cmap=shades, norm=norm, zorder=0.5, antialiased=True)
        return True

    def draw_isobaths(self, ax: Axes, *, labels: bool) -> None:
        """Draw lines of equal depth, with their depths if ``labels``."""
        low, high = self.span
        levels = [d for d in ISOBATHS if low < d < high]
        if not levels or len(np.unique(self.depth.compressed())) < STEPPED:
            return
        lines = ax.contour(self.x, self.y, self.depth, levels=levels, colors=colours.ISOBATH, linewidths=0.6, zorder=2)
        if labels:
            ax.clabel(lines, fmt="%d m", fontsize=6)
