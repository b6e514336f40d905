"""Forcing given by formulas at the elements themselves: no grid, no land, no files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np

from riftberg.config.values import ICE_UNITS, Pair, SeaIce, Section, Velocity, Wind, at_most, given, key, native, number
from riftberg.constants import EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.ocean.cells import OVER_KEEL
from riftberg.ocean.forcing import flows_text, ice_text, join_texts, pair_text
from riftberg.ocean.formulas import SUMMED, UNKNOWN, Formula
from riftberg.parameters import Earth
from riftberg.state import Elements, Floats, new_elements

DEEP = 1e4
"""Depth (m) of a sea without a floor to speak of."""


class Steady(Formula):
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
        Depth of water, m; 0 is dry ground.
    temperature, salinity : float, optional
        Of the sea, degrees Celsius and 1e-3; melt needs them.
    ice_fraction : float, optional
        Part of the sea that sea ice covers, its concentration: without it sea ice exerts no force on rigid bergs.

    Attributes
    ----------
    provides : frozenset of str
        Water properties that are known: ``sst``, ``sss``.

    Raises
    ------
    ForcingError
        If one of them is not possible, or has a wrong unit.

    Examples
    --------
    >>> Steady(current=("20 cm/s", 0.05), depth="0.5 km")
    <Steady: steady and uniform: current (0.2, 0.05) m/s, 500 m deep>
    """

    def __init__(
        self,
        current: tuple[float, float] = (0.0, 0.0),
        wind: tuple[float, float] = (0.0, 0.0),
        slope: tuple[float, float] = (0.0, 0.0),
        sea_ice: tuple[float, float, float] = (0.0, 0.0, 0.0),
        depth: float = DEEP,
        *,
        temperature: float | None = None,
        salinity: float | None = None,
        ice_fraction: float = 0.0,
    ) -> None:
        self._water = _checked_water(temperature, salinity, ice_fraction)
        self.ice_fraction = self._water[2]
        self.temperature = None if temperature is None else self._water[0]
        self.salinity = None if salinity is None else self._water[1]
        water_values = (("sst", temperature), ("sss", salinity))
        self.provides = frozenset(name for name, value in water_values if value is not None)
        self.current: tuple[float, float] = steady("current", current)
        self.wind: tuple[float, float] = steady("wind", wind)
        self.slope: tuple[float, float] = steady("slope", slope)
        self.sea_ice: tuple[float, float, float] = steady("sea_ice", sea_ice)
        self.water: float = 0.0 if native(depth) == 0.0 else steady("depth", depth)

    @classmethod
    def balanced(cls, current: tuple[float, float], latitude: float, **others: Any) -> Self:
        """Return an environment whose sea surface slopes in geostrophic balance with the current.

        ``f v = g d(eta)/dx`` and ``-f u = g d(eta)/dy`` with ``f = 2 Omega sin(latitude)``: water that flows freely on the
        turning Earth has this slope, and without it a berg does not follow the water but drifts off to the side.

        Parameters
        ----------
        current : tuple of float
            Eastward and northward ocean current, m s-1.
        latitude : float
            Latitude of the balance, degrees.
        **others
            Wind, sea ice and depth as for the class.
        """
        latitude = given(latitude, Earth, "reference_latitude", where="latitude", kind=ForcingError)
        current = steady("current", current)
        f = 2.0 * EARTH_ROTATION * math.sin(math.radians(latitude))
        return cls(current, slope=(f * current[1] / GRAVITY, -f * current[0] / GRAVITY), **others)

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements: the same as adding to nothing, and quicker."""
        e = elements
        e.uo[:], e.vo[:] = self.current
        e.ua[:], e.va[:] = self.wind
        e.slope_x[:], e.slope_y[:] = self.slope
        e.ui[:], e.vi[:], e.ice_thickness[:] = self.sea_ice
        e.depth[:] = self.water
        e.vorticity[:] = 0.0
        e.sst[:], e.sss[:], e.ice_fraction[:] = self._water

    def add_to(self, elements: Elements, time: float) -> None:
        """Add the values that `sample` of this class gives."""
        e, gives = elements.environment, self._values(elements, time)
        for name in SUMMED:
            getattr(e, name)[:] += gives[name]
        np.minimum(e.depth, gives["depth"], out=e.depth)
        for name in self.provides:
            getattr(e, name)[:] = gives[name]
            getattr(e, OVER_KEEL[name])[:] = np.nan  # the value at the surface counts, whatever another term has set
        np.maximum(e.ice_fraction, self._water[2], out=e.ice_fraction)

    def _values(self, elements: Elements, time: float) -> Mapping[str, Floats | float]:
        """What `sample` of this class fills, by name; numbers where it is the same everywhere."""
        if type(self).sample is Steady.sample:  # no elements are made for these, which takes longer than the sums
            summed = (*self.current, *self.slope, *self.wind, *self.sea_ice, 0.0)
            return {
                **dict(zip(SUMMED, summed, strict=True)),
                "depth": self.water,
                **dict(zip(UNKNOWN, self._water, strict=True)),
            }
        sampled = new_elements(elements.size)
        sampled.place.lon[:], sampled.place.lat[:] = elements.place.lon, elements.place.lat
        self.sample(sampled, time)
        return {name: getattr(sampled.environment, name) for name in (*SUMMED, "depth", *UNKNOWN)}

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        return np.full(np.shape(lon), self.current[0]), np.full(np.shape(lon), self.current[1])

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        return np.full(np.shape(lon), self.water)

    def describe(self) -> str:
        """Return the values in words."""
        depth = f"{self.water:g} m deep" if self.water != DEEP else ""
        ice = ice_text(self.sea_ice, self.ice_fraction)
        return "steady and uniform: " + join_texts(flows_text(self.current, self.wind), ice, depth)


def _checked_water(temperature: Any, salinity: Any, ice_fraction: Any) -> tuple[float, float, float]:
    """Return temperature, salinity and cover after a check; values not given are the defaults for an unknown sea."""
    temperature = None if temperature is None else number(temperature, "degC", where="temperature", kind=ForcingError)
    salinity = None if salinity is None else number(salinity, "1", where="salinity", kind=ForcingError)
    ice_fraction = number(ice_fraction, "1", where="ice_fraction", kind=ForcingError)
    if temperature is not None and not -3.0 <= temperature <= 45.0:
        kelvin = f": is it in kelvin? Then give {temperature - 273.15:.2f}" if 270.0 <= temperature <= 318.0 else ""
        raise ForcingError(
            f"temperature = {temperature:g} is none of the sea in degrees Celsius{kelvin}",
            where="Steady",
            remedy="Give one from -3 to 45",
        )
    if salinity is not None and not 0.0 <= salinity <= 50.0:
        raise ForcingError(
            f"salinity = {salinity:g} is none of the sea", where="Steady", remedy="Give one from 0 to 50"
        )
    if not 0.0 <= ice_fraction <= 1.0:
        raise ForcingError(f"ice_fraction = {ice_fraction:g} is no part", where="Steady", remedy="Give one from 0 to 1")
    return 0.0 if temperature is None else temperature, -1.0 if salinity is None else salinity, ice_fraction


def steady(name: str, value: Any) -> Any:
    """Return a value of a steady environment without unit, or refuse it in the words that an experiment file gets."""
    return given(value, ConstantForcing, name, kind=ForcingError)


class Convergence(Steady):
    """A uniform current along x that converges on a line in part of each period (equations 10.2).

    The northward current falls from ``speed`` south of the line to ``-speed`` north of it over ``ramp`` metres on either
    side, and sets in and ends over ``ramp`` along x, as bilinear interpolation does on a grid of that spacing.

    ``current``: uniform current, m s-1; ``speed``: speed towards the line, m s-1; ``line``: y of the line, m; ``span``:
    where along x the current converges, m; ``ramp``: width of the transition, m; ``period``: zonal period, m;
    ``depth``: depth of water, m.
    """

    def __init__(
        self,
        current: tuple[float, float],
        speed: float,
        line: float,
        span: tuple[float, float],
        ramp: float,
        period: float,
        depth: float = 1e4,
    ) -> None:
        super().__init__(current=current, depth=depth)
        self.speed, self.line, self.span, self.ramp, self.period = speed, line, span, ramp, period

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements; the vorticity comes from the northward current alone."""
        super().sample(elements, time)
        e = elements
        e.uo[:], e.vo[:] = self.currents(e.lon, e.lat, time)
        step = 1e-3 * self.ramp
        ahead, behind = (self.currents(e.lon + s, e.lat, time)[1] for s in (step, -step))
        e.vorticity[:] = (ahead - behind) / (2.0 * step)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points (m)."""
        along = (np.asarray(lon) - self.span[0]) % self.period
        end = self.span[1] - self.span[0]
        window = np.clip(along / self.ramp, 0.0, 1.0) * np.clip((end + self.ramp - along) / self.ramp, 0.0, 1.0)
        across = np.clip((self.line - np.asarray(lat)) / self.ramp, -1.0, 1.0)
        return np.full(np.shape(lon), self.current[0]), self.current[1] + self.speed * across * window

    def describe(self) -> str:
        """Return the values in words."""
        return (
            f"current {pair_text(self.current)} m/s that converges on y = {self.line / 1e3:g} km at {self.speed:g} m/s"
        )


class ConstantForcing(Section):
    """A uniform, steady environment."""

    kind: Literal["constant"]
    current: Velocity = key((0.0, 0.0), "m s-1", "eastward and northward ocean current")
    wind: Wind = key((0.0, 0.0), "m s-1", "eastward and northward wind")
    # A metre in a hundred: 1e-5 is steep for a current.
    slope: Annotated[Pair, at_most(0.01, "m m-1")] = key(
        (0.0, 0.0), "1", "eastward and northward slope of the sea surface"
    )
    sea_ice: SeaIce = key((0.0, 0.0, 0.0), "", "velocity (m s-1) and thickness (m) of sea ice", **ICE_UNITS)
    depth: float = key(1e4, "m", "depth of water", gt=0, le=1e5)
    ice_fraction: float = key(0.0, "1", "part of the sea that sea ice covers", ge=0, le=1)
