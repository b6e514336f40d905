"""From a shelf to a berg without a jump: what the mass on cells differs by at first, and how it goes over."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from riftberg.bergs.bonding import Metric, separations
from riftberg.errors import InputError
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats


class Settling:
    """Mass that cells bear beyond that of the bergs on them, since ice calved there; its sum is 0, and it fades.

    ``time``: in which it becomes smaller by the factor e, s; ``rest``: kg (shape (nj, ni)).
    """

    def __init__(self, time: float, grid: Grid) -> None:
        if not 0.0 < time < math.inf:
            raise InputError(f"settling_time = {time:g} s", where="Exchange", remedy="Give a finite time above 0")
        self.time = time
        self.rest = np.zeros((grid.arrays.nj, grid.arrays.ni))

    def take_up(self, kept: Floats | None) -> None:
        """Go on from what a restart kept."""
        if kept is not None:
            self.rest = kept.copy()

    def settle(self, dt: float) -> None:
        """Let some time (s) pass."""
        self.rest *= math.exp(-dt / self.time)

    def settled(self, mass: Floats) -> Floats:
        """Return the mass of bergs on cells (kg) with what has not settled yet; never below 0, of the same sum."""
        more = np.maximum(self.rest, 0.0)
        if not more.any():
            return mass
        # A berg may have left cells that still lack something: as much less is then added elsewhere.
        less = np.minimum(np.maximum(-self.rest, 0.0), mass)
        return np.asarray(mass - less + more * (less.sum() / more.sum()))


def refuse_meeting(old: Elements, new: Elements, metric: Metric) -> None:
    """Refuse new elements that lie on others."""
    if not old.size:
        return
    size_old, size_new = (np.sqrt(e.body.length * e.body.width) for e in (old, new))
    lon0, lat0 = float(new.lon[0]), float(new.lat[0])
    places = [
        np.stack(separations(metric, e.lon, e.lat, np.asarray(lon0), np.asarray(lat0)), axis=1) for e in (old, new)
    ]
    reach = 0.5 * (float(size_old.max()) + float(size_new.max()))
    for n, near in enumerate(cKDTree(places[0]).query_ball_point(places[1], 2.0 * reach)):
        rows = np.asarray(near, np.int64)
        dx, dy = separations(metric, old.lon[rows], old.lat[rows], np.asarray(new.lon[n]), np.asarray(new.lat[n]))
        close = np.hypot(dx, dy) < 0.5 * (size_old[rows] + size_new[n])
        if close.any():
            raise InputError(
                f"element {int(old.body.id[rows[np.argmax(close)]])} lies where the ice shelf calves, at "
                f"{new.lon[n]:.4f}, {new.lat[n]:.4f}",
                where="ice shelf, mask", remedy="Leave cells with bergs out of the mask",
            )  # fmt: skip
