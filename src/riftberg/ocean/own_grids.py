"""Forcing from several products, each on its own grid and at its own times: no field is interpolated twice.

Every part is a `GriddedForcing` on the grid of its product, and fills those variables of the elements that the product
gives: currents and their vorticity, slopes of the sea surface, wind, sea ice, depth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from riftberg.errors import ForcingError
from riftberg.ocean.grid import Grid
from riftberg.ocean.grid_arrays import FIELD_DEFAULTS
from riftberg.ocean.gridded import GriddedForcing
from riftberg.ocean.search import locate_points
from riftberg.state import Elements, Floats

FILLS = {
    "uo": ("uo", "vo", "vorticity"),
    "ui": ("ui", "vi"),
    "ua": ("ua", "va"),
    "ssh": ("slope_x", "slope_y"),
    "depth": ("depth",),
    "sst": ("sst",),
    "sss": ("sss",),
    "ice_fraction": ("ice_fraction",),
    "ice_thickness": ("ice_thickness",),
}
"""Variables of the elements that come from a field of a product; vectors are named by their eastward component."""

VARIABLES = tuple(dict.fromkeys(name for names in FILLS.values() for name in names))


class Part(NamedTuple):
    """Forcing on the grid of one product, and the fields (keys of `FILLS`) that it serves."""

    forcing: GriddedForcing
    serves: tuple[str, ...]


class OwnGrids:
    """Several products as one forcing; implements `riftberg.ocean.forcing.Forcing`.

    Parameters
    ----------
    parts : sequence of Part
        Each field is served by one part.
    notices : sequence of str
        What should be known of it before a run.

    Raises
    ------
    ForcingError
        If two parts serve the same field.
    """

    grid: Grid | None = None

    def __init__(self, parts: Sequence[Part], notices: Sequence[str] = ()) -> None:
        self.parts = tuple(parts)
        self.notices = tuple(notices)
        served = [name for part in self.parts for name in part.serves]
        for name in served:
            if served.count(name) > 1:
                raise ForcingError(f"{name} comes from two products", where="forcing", remedy="Name one of them")
        filled = {variable for name in served for variable in FILLS[name]}
        self._missing = tuple(name for name in VARIABLES if name not in filled)

    @property
    def title(self) -> str:
        """Return the products, for titles."""
        return ", ".join(dict.fromkeys(part.forcing.source for part in self.parts if part.forcing.source))

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements at ``time`` (s since the start of the run)."""
        for part, view in self._views(elements):
            part.forcing.sample(view, time)
        for name in self._missing:
            getattr(elements, name)[:] = FIELD_DEFAULTS.get(name, 0.0)

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless every part serves these elements from ``start`` to ``end`` (s)."""
        for part, view in self._views(elements):
            part.forcing.check(view, start, end)

    def _views(self, elements: Elements) -> Iterator[tuple[Part, Elements]]:
        """Give each part the elements with cells of its grid, and with arrays to waste for what it does not serve."""
        for part in self.parts:
            yield part, self._view(part, elements)

    def _view(self, part: Part, elements: Elements) -> Elements:
        size = elements.lon.size
        mine = {variable for name in part.serves for variable in FILLS[name]}
        waste: dict[str, Any] = {name: np.empty(size) for name in VARIABLES if name not in mine}
        i, j, xi, eta = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size), np.empty(size)
        assert part.forcing.grid is not None
        locate_points(elements.lon, elements.lat, part.forcing.grid.arrays, True, i, j, xi, eta)
        outside = np.flatnonzero(i < 0)
        if outside.size:
            row = int(outside[0])
            raise ForcingError(
                f"element {elements.id[row]} at ({elements.lon[row]:.6g}, {elements.lat[row]:.6g}) is outside of the "
                f"data of {', '.join(part.serves)}",
                where=part.forcing.source or "forcing",
                remedy="Take a larger box (forcing.longitude, forcing.latitude), files that cover it, or fewer days",
            )
        return elements.replaced(cell_i=i, cell_j=j, xi=xi, eta=eta, **waste)

    def _serving(self, name: str) -> GriddedForcing | None:
        return next((part.forcing for part in self.parts if name in part.serves), None)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside and on land."""
        forcing = self._serving("uo")
        if forcing is None:
            return np.full(np.shape(lon), np.nan), np.full(np.shape(lon), np.nan)
        return forcing.currents(lon, lat, time)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points, by the first record; NaN outside and on land."""
        forcing = self._serving("depth")
        return np.full(np.shape(lon), FIELD_DEFAULTS["depth"]) if forcing is None else forcing.depth(lon, lat)

    def describe(self) -> str:
        """Return what each product gives, on which grid and at which times."""
        told = [f"{', '.join(part.serves)}: {part.forcing.describe()}" for part in self.parts]
        return "\n".join(["each product on its own grid", *told, *self.notices]).replace("\n", "\n    ")
