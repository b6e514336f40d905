"""Currents over the draft of each element, from a grid with levels.

A berg moves with the water along its whole side, and elements differ in draft. At every corner of the grid the integral
from the surface downward is known at the limits of layers, of the current, I, and of the water itself, W (m). The
current that acts on an element of draft D is, at each corner of its cell,

    u(D) = I(D) / W(D),    0 where W(D) = 0,

with I and W linear in depth between the limits and in time between the records; between corners it is bilinear, as all
currents are (spec 3.2). In water shallower than the draft the mean ends at the sea floor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from riftberg.errors import ForcingError
from riftberg.kernels import kernel
from riftberg.ocean.geometry import bilinear, blend_corners
from riftberg.ocean.grid_arrays import GridArrays
from riftberg.ocean.interpolation import coastal_increment
from riftberg.physics.floating import draft_of
from riftberg.state import Elements, Floats, Ints


class Columns(NamedTuple):
    """Integrals from the surface to the limits of layers, at the north-east corners of a grid, shape (limits, nj, ni).

    Attributes
    ----------
    u, v : ndarray
        Of the current, m2 s-1.
    wet : ndarray
        Thickness of the water, m.
    """

    u: Floats
    v: Floats
    wet: Floats


class DraftCurrents:
    """Gives each element the current over its own draft.

    Parameters
    ----------
    limits : (k,) array
        Depths (m) of the integrals, ascending from 0.
    load : callable
        Returns the `Columns` of record number k, counted from 0.
    ice_density : float
        Density of the ice (kg m-3), for the draft of an element.
    nominal : float
        Draft (m) that currents are shown for on maps.
    """

    def __init__(self, limits: Floats, load: Callable[[int], Columns], ice_density: float, nominal: float) -> None:
        self.limits = np.ascontiguousarray(limits, np.float64)
        self.nominal = min(float(nominal), float(self.limits[-1]))
        self._load, self._ice_density = load, ice_density
        self._kept: dict[int, Columns] = {}

    def columns(self, record: int) -> Columns:
        """Return the integrals of a record; the last two are kept."""
        if record not in self._kept:
            while len(self._kept) > 1:
                del self._kept[min(self._kept, key=lambda old: (abs(old - record) <= 1, old))]
            self._kept[record] = Columns(*(np.ascontiguousarray(a, np.float64) for a in self._load(record)))
        return self._kept[record]

    def at_nominal(self, record: int) -> tuple[Floats, Floats]:
        """Return the current (m s-1) over the nominal draft at all corners."""
        columns = self.columns(record)
        lower = int(np.clip(np.searchsorted(self.limits, self.nominal, side="right") - 1, 0, self.limits.size - 2))
        part = (self.nominal - self.limits[lower]) / (self.limits[lower + 1] - self.limits[lower])
        u, v, wet = ((1.0 - part) * a[lower] + part * a[lower + 1] for a in columns)
        water = np.where(wet > 0.0, wet, 1.0)
        return np.where(wet > 0.0, u / water, 0.0), np.where(wet > 0.0, v / water, 0.0)

    def sample(self, elements: Elements, grid: GridArrays, record: int, weight: float, coastal_drift: float) -> None:
        """Fill ``uo``, ``vo`` and ``vorticity`` of the elements; ``weight`` is that of the record after ``record``."""
        before = self.columns(record)
        after = self.columns(record + 1) if weight > 0.0 else before
        e, g = elements, grid
        fill_over_draft(
            e.cell_i, e.cell_j, e.xi, e.eta, draft_of(e.thickness, self._ice_density), self.limits, before, after, weight,
            g.mask, g.cos_angle, g.sin_angle, g.dx, g.dy, coastal_drift, e.uo, e.vo, e.vorticity,
        )  # fmt: skip

    def check(self, elements: Elements) -> None:
        """Raise `ForcingError` if a keel reaches below the layers of the data."""
        draft = draft_of(float(elements.thickness.max()), self._ice_density)
        deepest = float(self.limits[-1])
        if draft > deepest * (1.0 + 1e-9):
            row = int(elements.thickness.argmax())
            raise ForcingError(
                f"element {elements.id[row]} has a draft of {draft:.0f} m, the levels of the currents end at "
                f"{deepest:.0f} m",
                where="forcing", remedy="Fetch deeper levels (--depth), or take the currents of the surface",
            )  # fmt: skip

    def describe(self) -> str:
        """Return one line that says what is done."""
        return f"currents: mean over the draft of each element, from {self.limits.size - 1} layers to {self.limits[-1]:g} m"


@kernel
def current_over_draft(
    lower: int, part: float, before: Columns, after: Columns, weight: float, j: int, i: int
) -> tuple[float, float]:
    """Return the current (m s-1) over a draft at one corner: u(D) = I(D) / W(D), 0 where there is no water.

    Parameters
    ----------
    lower, part : int, float
        Layer of the keel, and how much of it (0 to 1) the keel reaches through.
    before, after : Columns
        Records around the time.
    weight : float
        Weight of ``after``.
    j, i : int
        Corner.
    """
    w0, w1 = 1.0 - weight, weight
    d0, d1 = 1.0 - part, part
    water = d0 * (w0 * before.wet[lower, j, i] + w1 * after.wet[lower, j, i])
    water += d1 * (w0 * before.wet[lower + 1, j, i] + w1 * after.wet[lower + 1, j, i])
    if water <= 0.0:
        return 0.0, 0.0
    u = d0 * (w0 * before.u[lower, j, i] + w1 * after.u[lower, j, i])
    u += d1 * (w0 * before.u[lower + 1, j, i] + w1 * after.u[lower + 1, j, i])
    v = d0 * (w0 * before.v[lower, j, i] + w1 * after.v[lower, j, i])
    v += d1 * (w0 * before.v[lower + 1, j, i] + w1 * after.v[lower + 1, j, i])
    return u / water, v / water


@kernel
def fill_over_draft(
    i: Ints, j: Ints, xi: Floats, eta: Floats, draft: Floats, limits: Floats, before: Columns, after: Columns,
    weight: float, mask: Floats, cos: Floats, sin: Floats, dx: Floats, dy: Floats, drift: float,
    east: Floats, north: Floats, vorticity: Floats,
) -> None:  # fmt: skip
    """Fill current (m s-1) and its vorticity (s-1) over the draft of each element.

    Parameters
    ----------
    i, j, xi, eta : ndarray
        Cells of the elements and coordinates there.
    draft : ndarray
        Drafts, m; below the last limit the last counts.
    limits : ndarray
        Depths of the integrals, m.
    before, after, weight
        As in `current_over_draft`.
    mask, cos, sin, dx, dy : ndarray
        Of the grid.
    drift : float
        Speed of the drift away from land, m s-1.
    east, north, vorticity : ndarray
        Filled.
    """
    for n in range(i.size):
        keel = min(max(draft[n], 0.0), limits[-1])
        lower = 0
        while lower < limits.size - 2 and limits[lower + 1] <= keel:
            lower += 1
        part = (keel - limits[lower]) / (limits[lower + 1] - limits[lower])
        c, r = i[n], j[n]
        une, vne = current_over_draft(lower, part, before, after, weight, r, c)
        unw, vnw = current_over_draft(lower, part, before, after, weight, r, c - 1)
        use, vse = current_over_draft(lower, part, before, after, weight, r - 1, c)
        usw, vsw = current_over_draft(lower, part, before, after, weight, r - 1, c - 1)
        along = blend_corners(une, unw, use, usw, xi[n], eta[n])
        across = blend_corners(vne, vnw, vse, vsw, xi[n], eta[n])
        if drift > 0.0:
            du, dv = coastal_increment(mask, c, r, drift)
            along, across = along + du, across + dv
        cosine, sine = bilinear(cos, c, r, xi[n], eta[n]), bilinear(sin, c, r, xi[n], eta[n])
        east[n], north[n] = cosine * along + sine * across, cosine * across - sine * along
        turn = eta[n] * (vne - vnw) / dx[r, c] + (1.0 - eta[n]) * (vse - vsw) / dx[r - 1, c]
        vorticity[n] = turn - (xi[n] * (une - use) / dy[r, c] + (1.0 - xi[n]) * (unw - usw) / dy[r, c - 1])
