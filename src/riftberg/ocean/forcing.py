"""The interface of every source of forcing, how it describes itself, and the lock that shared ones read under."""

from __future__ import annotations

import html
import threading
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.config.units import POINTS
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats
from riftberg.system.input_files import shortened


class Forcing:
    """Ocean, air, sea ice and sea floor around the bergs: every question that a run may ask, with a default answer.

    Subclass `riftberg.Forcing` for a formula of your own, which can be added to others; subclass this class where a forcing
    fills the whole environment by itself. It must define ``sample`` and ``currents``.

    Attributes
    ----------
    grid : Grid or None
        Grid that gives cells, land and metrics; None for an open ocean.
    start : datetime or None
        Date of its time 0 (UTC), which a model takes over; None where the model's holds.
    latlon : bool or None
        Positions are degrees, not metres; None where both will do.
    latitude : float or None
        Latitude (degrees) of the Coriolis parameter in its balance; None to use the latitude of each point.
    provides : frozenset of str
        Variables around the elements that are known, such as ``sst`` and ``sss``.
    notices : sequence of str
        What should be known of it before a run.
    citations : sequence of str
        Works to cite.
    title : str
        What it is, for titles.
    given : bool
        Its fields are available; an ocean model delivers them with the first step.
    ice_drift_known : bool
        Sea ice, where there is any, has a velocity.
    assumes_slope : bool
        The slope of the sea surface was not asked for, but follows from the current.
    slope_remarks : sequence of str
        What should be known of that slope.
    """

    grid: Grid | None = None
    start: datetime | None = None
    latlon: bool | None = None
    latitude: float | None = None
    provides: frozenset[str] = frozenset()
    notices: Sequence[str] = ()
    citations: Sequence[str] = ()
    title: str = ""
    given: bool = True
    ice_drift_known: bool = True
    assumes_slope: bool = False
    slope_remarks: Sequence[str] = ()

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements (``uo`` ... ``vorticity``) at their positions and cells.

        Parameters
        ----------
        elements : Elements
            Their ``lon``, ``lat``, ``cell_i``, ``cell_j``, ``xi`` and ``eta`` are read.
        time : float
            Seconds since the start of the run.
        """
        raise NotImplementedError(f"{type(self).__name__} has no sample(elements, time)")

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `riftberg.errors.ForcingError` unless the forcing covers these elements from ``start`` to ``end`` (s)."""

    def check_fields(self, elements: Elements, start: float, end: float) -> None:
        """Do so where currents may come from another part of a sum."""
        self.check(elements, start, end)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points; NaN outside and on land."""
        return np.zeros(np.shape(lon)), np.zeros(np.shape(lon))

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points; NaN outside or unknown, infinite where there is no floor."""
        return np.full(np.shape(lon), np.inf)

    def depth_spacing(self) -> float | None:
        """Return the usual distance (m) between points of the chart of the sea floor; None where there is none."""
        return None

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the sea level (m) above the datum of the depth, at arrays of points."""
        return np.zeros(np.shape(lon))

    def land(self, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
        """Return which points are land; points beyond the data of a product are not."""
        flow, depth = self.currents(lon, lat, 0.0)[0], np.asarray(self.depth(lon, lat), float)
        return np.asarray(np.isnan(flow) | ~(depth > 0.0))

    @property
    def level_gaps(self) -> str:
        """Gaps of a given sea level; empty if there are none."""
        return ""

    @property
    def has_own_level_datum(self) -> bool:
        """Whether the sea level counts from another zero than the depth of a chart may do."""
        return False

    def without_assumed_slope(self) -> Forcing:
        """Return the same forcing without a slope of the sea surface that was not asked for: a sum has another one."""
        return self

    def components(self) -> tuple[Any, ...]:
        """Return the forcings or products of which it is made."""
        return (self,)

    def describe(self) -> str:
        """Return kind, source and coverage of this forcing in plain words."""
        return ""

    def __repr__(self) -> str:
        lines = [shortened(line, 160) for line in self.describe().splitlines()]
        lines_shown = (
            lines if len(lines) <= 20 else [*lines[:19], f"... and {len(lines) - 19} lines more, see describe()"]
        )
        return f"<{type(self).__name__}: " + "\n  ".join(lines_shown) + ">"

    def _repr_html_(self) -> str:
        return f'<pre style="white-space:pre-wrap">{html.escape(repr(self)[1:-1])}</pre>'


class WrappedForcing(Forcing):
    """Changes the values of another forcing at the elements; all else comes from the other one.

    An object of another class that samples may be inside too: its own attributes answer, and the defaults where it has none.
    """

    def __init__(self, forcing: Any) -> None:
        self.forcing = forcing

    def __getattr__(self, name: str) -> Any:
        # Not while it is being unpickled, when there is no forcing yet.
        if name.startswith("__") or "forcing" not in self.__dict__:
            raise AttributeError(name)
        return getattr(self.forcing, name)


def _delegate(name: str) -> property:
    """Return a property that answers by the forcing inside."""

    def answer(self: WrappedForcing) -> Any:
        inside = self.forcing
        answers = isinstance(inside, Forcing) or hasattr(inside, name)
        return getattr(inside if answers else super(WrappedForcing, self), name)

    return property(answer)


# Attributes that the base class declares would be read from it, never from the forcing inside.
for _name in [name for name in vars(Forcing) if not name.startswith("_")]:
    setattr(WrappedForcing, _name, _delegate(_name))


def as_forcing(candidate: Any) -> Any:
    """Return a forcing; an object of another class that has ``sample`` is wrapped, anything else comes back unchanged."""
    if isinstance(candidate, Forcing | type) or not callable(getattr(candidate, "sample", None)):
        return candidate
    return WrappedForcing(candidate)


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
    return "(" + ", ".join(f"{number:.5g}" for number in pair) + ")"


def flows_text(current: tuple[float, ...], wind: tuple[float, ...]) -> str:
    """Return current and wind in words; zero ones are left out."""
    flows = [f"{name} {pair_text(pair)} m/s" for name, pair in (("current", current), ("wind", wind)) if any(pair)]
    return ", ".join(flows) or "still water and air"


def join_texts(*texts: str) -> str:
    """Return the texts that are not empty, joined by commas."""
    return ", ".join(filter(None, texts))


def compass(towards: float) -> str:
    """Return a direction (degrees clockwise from north) as a point of the compass, or in degrees."""
    eighth, rest = divmod(towards % 360.0, 45.0)
    return POINTS[int(eighth)] if rest == 0.0 else f"{towards:g} degrees"


def ice_text(ice: tuple[float, float, float], fraction: float) -> str:
    """Return velocity (m s-1) and thickness (m) of sea ice with its concentration in words; empty where there is none."""
    if not any(ice) and fraction == 0.0:
        return ""
    concentration = f", concentration {fraction:g}" if fraction else ""
    return f"sea ice of {ice[2]:g} m at {pair_text(ice[:2])} m/s{concentration}"
