"""What every source of forcing offers to the model, whether gridded or analytic."""

from __future__ import annotations

from typing import Protocol

from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats


class Forcing(Protocol):
    """Ocean, air, sea ice and sea floor around the bergs.

    Attributes
    ----------
    grid : Grid or None
        Grid that gives cells, land and metrics; None for an open, analytic ocean.
    """

    grid: Grid | None

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements (``uo`` ... ``vorticity``) at their positions and cells.

        Parameters
        ----------
        elements : Elements
            Their ``lon``, ``lat``, ``cell_i``, ``cell_j``, ``xi`` and ``eta`` are read.
        time : float
            Seconds since the start of the run.
        """

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `riftberg.errors.ForcingError` unless the forcing serves these elements from ``start`` to ``end`` (s)."""

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside."""

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points, for maps; NaN outside or unknown."""

    def describe(self) -> str:
        """Return what this forcing is, where it comes from and what it covers, in plain words."""
