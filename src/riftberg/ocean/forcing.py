"""What every source of forcing offers to the model, how it describes itself, and the lock that shared ones read under."""

from __future__ import annotations

import html
import threading
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from riftberg.config.units import POINTS
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats
from riftberg.system.input_files import shortened


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
        """Raise `riftberg.errors.ForcingError` unless the forcing covers these elements from ``start`` to ``end`` (s)."""

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside."""

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points, for maps; NaN outside or unknown."""

    def describe(self) -> str:
        """Return what this forcing is, where it comes from and what it covers, in plain words."""


class SharedLock:
    """Lock under which a forcing that runs in several threads share reads its records; its holder may take it again.

    A copy, also one in another process, is a lock of its own.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *error: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[SharedLock], tuple[()]]:
        return SharedLock, ()


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


def compass(towards: float) -> str:
    """Return a direction (degrees clockwise from north) as a point of the compass, or in degrees."""
    eighth, rest = divmod(towards % 360.0, 45.0)
    return POINTS[int(eighth)] if rest == 0.0 else f"{towards:g} degrees"


def ice_text(ice: tuple[float, float, float], fraction: float) -> str:
    """Return velocity (m s-1) and thickness (m) of sea ice with its concentration in words; empty where there is none."""
    if not any(ice) and fraction == 0.0:
        return ""
    return f"sea ice of {ice[2]:g} m at {pair_text(ice[:2])} m/s, concentration {fraction:g}"


class DescribedForcing:
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


class WrappedForcing(DescribedForcing):
    """Changes what another forcing gives at the elements; all else is that of the other one."""

    forcing: Forcing

    def __getattr__(self, name: str) -> Any:
        # Not while it is being unpickled, when there is no forcing yet.
        if name.startswith("__") or "forcing" not in self.__dict__:
            raise AttributeError(name)
        return getattr(self.forcing, name)


def sea_level(forcing: Forcing, lon: Floats, lat: Floats, time: float) -> Floats:
    """Return the sea level (m) above that to which the depth belongs, at arrays of points; 0 where the forcing gives none.

    A forcing of one's own may have a method ``sea_level(lon, lat, time)``.
    """
    given = getattr(forcing, "sea_level", None)
    return np.zeros(np.shape(lon)) if given is None else np.asarray(given(lon, lat, time), float)


def land_at(forcing: Forcing, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
    """Return which points a forcing knows to be land; what lies beyond the data of a product is none.

    A forcing of one's own may have a method ``land(lon, lat)``; without it, land is where it has no current or no water.
    """
    given = getattr(forcing, "land", None)
    if given is not None:
        return np.asarray(given(lon, lat), bool)
    flow, depth = forcing.currents(lon, lat, 0.0)[0], np.asarray(forcing.depth(lon, lat), float)
    return np.asarray(np.isnan(flow) | ~(depth > 0.0))
