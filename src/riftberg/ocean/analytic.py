"""Forcing given by formulas at the elements themselves: no grid, no land, no files."""

from __future__ import annotations

import numpy as np

from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats


class Steady:
    """A uniform, steady environment.

    Parameters
    ----------
    current : tuple of float, optional
        Eastward and northward ocean current, m s-1.
    wind : tuple of float, optional
        Eastward and northward wind, m s-1.
    slope : tuple of float, optional
        Eastward and northward slope of the sea surface, dimensionless.
    sea_ice : tuple of float, optional
        Eastward and northward sea-ice velocity (m s-1) and its thickness (m).
    depth : float, optional
        Depth of water, m.
    """

    grid: Grid | None = None

    def __init__(
        self,
        current: tuple[float, float] = (0.0, 0.0),
        wind: tuple[float, float] = (0.0, 0.0),
        slope: tuple[float, float] = (0.0, 0.0),
        sea_ice: tuple[float, float, float] = (0.0, 0.0, 0.0),
        depth: float = 1e4,
    ) -> None:
        self.current, self.wind, self.slope, self.sea_ice, self.water = current, wind, slope, sea_ice, depth

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        e = elements
        e.uo[:], e.vo[:] = self.current
        e.ua[:], e.va[:] = self.wind
        e.slope_x[:], e.slope_y[:] = self.slope
        e.ui[:], e.vi[:], e.ice_thickness[:] = self.sea_ice
        e.depth[:] = self.water
        e.vorticity[:] = 0.0

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Serve any place and time."""

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        return np.full(np.shape(lon), self.current[0]), np.full(np.shape(lon), self.current[1])

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        return np.full(np.shape(lon), self.water)

    def describe(self) -> str:
        """Return the values in words."""
        return f"steady and uniform: current {self.current} m/s, wind {self.wind} m/s, depth {self.water:g} m"
