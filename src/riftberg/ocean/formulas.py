"""Forcing by formula that is put together with ``+``: uniform, eddy, jet, shear, front, tide, seamount, slope, wind that turns.

Each part adds its current, the slope of the sea surface that goes with it, its wind; of several sea floors the shallowest
counts. The sea surface has the slope that moves this water itself, place by place::

    d(eta)/dx = (f v - Du/Dt) / g,    d(eta)/dy = -(f u + Dv/Dt) / g,    f = 2 Omega sin(latitude)

with D/Dt the rate of change along the path of the water, in all currents together. In straight steady currents that is the
geostrophic slope, in a round eddy the gradient wind, in one that travels at c the advection by u - c, in a tide the change in
time. Without these slopes a berg does not follow the water: it drifts off to the side, or is flung out of an eddy.

Positions are degrees and f varies with latitude; with ``latitude`` f is constant, and with ``latlon=False``
positions are metres on such a plane.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.dataclasses import dataclass
from pydantic_core import ArgsKwargs

from riftberg.config.units import place_text
from riftberg.config.values import (
    ICE_UNITS,
    PLACE,
    Pair,
    Position,
    SeaIce,
    SurfaceSlope,
    UnfitError,
    Velocity,
    Wind,
    about,
    explained,
    in_metres,
    plain_value,
    says_metres,
    section_fields,
)
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.ocean.forcing import (
    Forcing,
    as_forcing,
    compass,
    flows_text,
    ice_text,
    join_texts,
    pair_text,
)
from riftberg.ocean.needs import DEFAULTS, DEPTH, OVER_DRAFT, TEMPERATURE, WAVES
from riftberg.physics.elementary import cos, cos_array, exp_array, sin, sin_array, tanh_array
from riftberg.state import Elements, Floats
from riftberg.system.input_files import value_shown

M2: Final = 12.4206012 * 3600.0
"""Period of the principal lunar tide, s."""

SUMMED: Final = ("uo", "vo", "slope_x", "slope_y", "ua", "va", "ui", "vi", "ice_thickness", "vorticity")
"""Variables of the elements that parts add to; they begin at 0."""

UNKNOWN: Final = ("sst", "sss", "ice_fraction")
"""Variables of the elements that a part may set; where none does, they have the values of an unknown sea."""

_CENTRE = "longitude and latitude (x and y in m where positions are metres)"
_TOWARDS = "direction, clockwise from north: 90 is eastward"


class Formula(Forcing):
    """Forcing that formulas give at the elements themselves, and that can be added to other forcing.

    A forcing class of one's own may stand on this one: it must define `add_to`; maps also ask for
    `currents` and `depth`.
    """

    def add_to(self, elements: Elements, time: float) -> None:
        """Add the effect of this term to the environment of the elements at ``time`` (s since the start)."""
        raise NotImplementedError(f"{type(self).__name__} has no add_to(elements, time)")

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        # Set the environment of the elements to nothing at all, for parts to add to.
        environment = elements.environment
        for name in SUMMED:
            getattr(environment, name)[:] = 0.0
        # Of several floors the shallowest counts, so the search for it begins at no floor at all.
        environment.depth[:] = np.inf
        for name in UNKNOWN:
            getattr(environment, name)[:] = DEFAULTS.get(name, 0.0)
        environment.wave_height[:] = WAVES.default
        self.add_to(elements, time)
        _add_inertial_slope(self._flows(), elements, time)
        # Elements under which no part has a sea floor get the depth of an open ocean.
        depth = elements.environment.depth
        depth[np.isinf(depth)] = DEPTH.default

    def _flows(self) -> tuple[Flow, ...]:
        """Return the parts whose currents the sea surface balances."""
        return ()

    def describe(self) -> str:
        """Return this term in words."""
        return type(self).__name__

    def __add__(self, other: Forcing) -> Sum:
        """Return both as one forcing."""
        return (
            Sum(_split_sum(self) + _split_sum(other))
            if isinstance(other := as_forcing(other), Forcing)
            else NotImplemented
        )

    def __radd__(self, other: Any) -> Any:
        """Return both as one forcing; the other is no formula, such as fields from files, or the 0 that `sum` begins with."""
        if isinstance(other, int) and other == 0:
            return self
        return (
            Sum(_split_sum(other) + _split_sum(self))
            if isinstance(other := as_forcing(other), Forcing)
            else NotImplemented
        )


def _at(formula: Formula, point: Pair) -> str:
    """Return a place of a formula in words."""
    return place_text(*point, latlon=formula.latlon is not False, digits=2)


MATERIAL_STEP: Final = 10.0
"""Time (s) before and after the present over which the change along the path of the water is found: flows change over hours."""

NEAR_POLE: Final = 1e-4
"""Least cosine of the latitude by which metres become degrees of longitude there."""


def _add_inertial_slope(flows: Sequence[Flow], elements: Elements, time: float) -> None:
    """Add the slope that holds the water on curved paths and in unsteady currents, ``-Du/Dt / g``.

    The water goes with the whole current that the elements carry; the formulas give its change. Of fields from files it is
    left out: their accelerations are tides and noise.
    """
    curved = [flow for flow in flows if not isinstance(flow, Uniform)]
    if not curved:
        return
    place, e = elements.place, elements.environment
    east, north = MATERIAL_STEP * e.uo, MATERIAL_STEP * e.vo
    if curved[0].latlon:
        metre = 1.0 / (DEGREE * EARTH_RADIUS_A68)
        east, north = east * metre / np.maximum(cos_array(place.lat * DEGREE), NEAR_POLE), north * metre
    for sign in (1.0, -1.0):
        for flow in curved:
            at = place.lon + sign * east, place.lat + sign * north, time + sign * MATERIAL_STEP
            u, v, _ = flow.flow(*at)
            e.slope_x[:] -= u * (sign / (2.0 * MATERIAL_STEP * GRAVITY))
            e.slope_y[:] -= v * (sign / (2.0 * MATERIAL_STEP * GRAVITY))


def _gives_level(term: Forcing) -> bool:
    """Return whether a part says that it gives the slope of the sea surface; one that it assumes does not count."""
    return "slope_x" in term.provides and not term.assumes_slope


def _split_sum(forcing: Forcing) -> list[Forcing]:
    return list(forcing.parts) if isinstance(forcing, Sum) else [forcing]


class Sum(Formula):
    """Several forcings as one: formulas, on top of at most one that is none, such as fields from files."""

    def __init__(self, parts: Sequence[Forcing]) -> None:
        # Forcing from files comes first: it sets the environment, and formulas add to it.
        self.parts = tuple(sorted(parts, key=lambda term: isinstance(term, Formula)))
        others = [term for term in parts if not isinstance(term, Formula)]
        if len(others) > 1:
            raise ForcingError(
                f"{type(others[0]).__name__} and {type(others[1]).__name__} cannot be added",
                where="forcing",
                remedy="Add formulas to one forcing from files; several files are one forcing already",
            )
        for name, quantity in (("sst", "temperature"), ("sss", "salinity")):
            givers = [term for term in self.parts if name in term.provides]
            if len(givers) > 1:
                first, second = (str(term.describe()).splitlines()[0] for term in givers[:2])
                raise ForcingError(
                    f"two parts give the {quantity} of the water: {first}; and {second}", where="forcing",
                    remedy=f"Leave the {quantity} to one of them",
                )  # fmt: skip
        # One slope of the sea surface: where data give a level, no assumed slope is added to it.
        levels = [term for term in self.parts if _gives_level(term)]
        if levels:
            self.parts = tuple(term.without_assumed_slope() for term in self.parts)
        # A level without currents belongs to the currents of the formulas, whose own slopes are left out beside it.
        self._level_of_all = any("uo" not in term.provides for term in levels)
        self.grid = others[0].grid if others else None
        self.provides = frozenset(name for term in parts for name in term.provides)
        for name in ("latlon", "latitude"):
            values: list[Any] = sorted({getattr(term, name) for term in self.parts} - {None})
            if len(values) > 1:
                raise ForcingError(
                    f"parts of the forcing disagree on {name}: {' and '.join(map(str, values))}",
                    where="forcing",
                    remedy="Give all parts the same",
                )
            setattr(self, name, values.pop() if values else None)
        self.start = next((term.start for term in self.parts if term.start is not None), None)
        self.notices = tuple(text for term in self.parts for text in term.notices)
        self.citations = tuple(text for term in self.parts for text in term.citations)
        self.title = ", ".join(filter(None, (term.title for term in self.parts)))
        # Every part that gives sea ice gives its velocity, or one part gives that alone.
        alone = any(any(getattr(term, "sea_ice", (0.0, 0.0))[:2]) for term in self.parts)
        self.ice_drift_known = alone or all(term.ice_drift_known for term in self.parts)
        self.given = all(term.given for term in self.parts)
        self.assumes_slope = any(term.assumes_slope for term in self.parts)
        self.slope_remarks = tuple(text for term in self.parts for text in term.slope_remarks)

    def _flows(self) -> tuple[Flow, ...]:
        return () if self._level_of_all else tuple(term for term in self.parts if isinstance(term, Flow))

    @property
    def level_gaps(self) -> str:
        """Gaps of a given sea level; empty if there are none."""
        return next(filter(None, (term.level_gaps for term in self.parts)), "")

    @property
    def has_own_level_datum(self) -> bool:
        """Whether the sea level of a part counts from another zero than the depth of a chart may do."""
        return any(term.has_own_level_datum for term in self.parts)

    def components(self) -> tuple[Any, ...]:
        """Return the forcings or products of which the parts are made."""
        return tuple(component for term in self.parts for component in term.components())

    def depth_spacing(self) -> float | None:
        """Return the distance (m) between points of the first chart among the parts."""
        return next((spacing for term in self.parts if (spacing := term.depth_spacing()) is not None), None)

    def add_to(self, elements: Elements, time: float) -> None:
        """Add all parts."""
        e = elements.environment
        for term in self.parts:
            if not isinstance(term, Formula):
                term.sample(elements, time)
            elif self._level_of_all and isinstance(term, Flow) and term.is_balanced:
                slopes = e.slope_x.copy(), e.slope_y.copy()
                term.add_to(elements, time)
                e.slope_x[:], e.slope_y[:] = slopes
            else:
                term.add_to(elements, time)

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless all parts cover these elements from ``start`` to ``end`` (s)."""
        for term in self.parts:  # the currents of a sum may all come from its formulas
            term.check_fields(elements, start, end)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        flows = [term.currents(lon, lat, time) for term in self.parts]
        return np.sum([u for u, _ in flows], axis=0), np.sum([v for _, v in flows], axis=0)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points: the shallowest term counts."""
        shallowest: Floats = np.min([term.depth(lon, lat) for term in self.parts], axis=0)
        return np.where(np.isinf(shallowest), DEPTH.default, shallowest)

    def land(self, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
        """Return which points are land in any part."""
        return np.asarray(np.any([term.land(lon, lat) for term in self.parts], axis=0))

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the sea level (m) at arrays of points: the sum of all parts."""
        levels: Floats = np.sum([term.sea_level(lon, lat, time) for term in self.parts], axis=0)
        return levels

    def describe(self) -> str:
        """Return all parts in words."""
        return "; ".join(term.describe() for term in self.parts)


F = TypeVar("F", bound=type[Formula])


@dataclass_transform(eq_default=False, field_specifiers=(Field,))
def _formula(cls: F) -> F:
    """Make a class whose arguments are the keys of a section of a file: the same units, limits and words for mistakes."""
    section: Any = dataclass(config=ConfigDict(extra="forbid", allow_inf_nan=False), repr=False, eq=False)(cls)
    names = [field.alias or name for name, field in section_fields(section).items() if not field.kw_only]

    @functools.wraps(section.__init__)
    def init(self: Any, *args: Any, **values: Any) -> None:
        positional = dict(
            zip(names, args, strict=False)
        )  # by name, for pydantic names an argument without one by its number
        if twice := positional.keys() & values.keys():
            raise TypeError(f"{cls.__name__} got several values for {min(twice)!r}")
        arguments, metres = ArgsKwargs(args[len(names) :], {**positional, **values}), says_metres(values.get("latlon"))
        try:
            section.__pydantic_validator__.validate_python(arguments, self_instance=self, context={"metres": metres})
        except ValidationError as error:
            raise explained(error, section, kind=ForcingError, metres=metres) from error

    section.__init__ = init
    plain = inspect.signature(section)  # without the annotations, whose units and limits help() would show as code
    section.__signature__ = plain.replace(
        parameters=[parameter.replace(annotation=parameter.empty) for parameter in plain.parameters.values()]
    )
    return section  # type: ignore[no-any-return]


@_formula
class Part(Formula):
    """A formula in degrees with the Coriolis parameter of each place, or on a plane of one latitude."""

    latlon: Annotated[bool | None, about("", "positions are degrees, otherwise metres", hidden=True)] = Field(
        default=True, kw_only=True
    )
    latitude: Annotated[
        float | None, about("degree", "latitude of the Coriolis parameter", hidden=True, ge=-90, le=90)
    ] = Field(default=None, kw_only=True)

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, values: Any, info: ValidationInfo) -> Any:
        """Give a section of a file the coordinates of the parameters."""
        if isinstance(values, ArgsKwargs | cls):
            return values
        if not isinstance(values, dict):
            keys = ", ".join(field.alias or name for name, field in section_fields(cls).items() if not field.kw_only)
            raise UnfitError(f"{value_shown(values)} is not a section", f"It has the keys {keys}")
        repeated = values.keys() & {"latlon", "latitude"}
        if repeated:
            raise UnfitError(f"{min(repeated)} is that of the parameters", "Set earth there, and leave it out here")
        return {**{str(name): value for name, value in values.items()}, **(info.context or {}).get("coordinates", {})}

    @field_validator("*", mode="before")
    @classmethod
    def _plain(cls, value: Any, info: ValidationInfo) -> Any:
        return plain_value(value, section_fields(cls)[str(info.field_name)], metres=in_metres(info))


class Flow(Part):
    """A formula whose current is balanced by the slope of the sea surface."""

    @model_validator(mode="after")
    def _has_a_latitude(self) -> Flow:
        self.require_latitude()
        return self

    def require_latitude(self) -> None:
        """Refuse positions in metres without the latitude that the balance of the current needs."""
        if not self.latlon and self.latitude is None:
            raise UnfitError(
                "positions in metres have no latitude",
                "Give latitude, the same as earth.reference_latitude of the parameters",
            )

    @property
    def is_balanced(self) -> bool:
        """Whether the sea surface slopes as the current asks."""
        return True

    def coriolis(self, lat: Floats) -> Floats:
        """Return the Coriolis parameter (s-1) at arrays of points."""
        where = np.asarray(lat, np.float64) if self.latitude is None else np.full(np.shape(lat), self.latitude)
        return 2.0 * EARTH_ROTATION * sin_array(where * DEGREE)

    def flow(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats, Floats]:
        """Return the current (m s-1) and its relative vorticity (s-1) at arrays of points."""
        raise NotImplementedError

    def _flows(self) -> tuple[Flow, ...]:
        return (self,)

    def add_to(self, elements: Elements, time: float) -> None:
        """Add current, vorticity and geostrophic slope; `sample` adds the slope of curved and unsteady flow."""
        place, e = elements.place, elements.environment
        u, v, vorticity = self.flow(place.lon, place.lat, time)
        f = self.coriolis(place.lat)
        e.uo[:] += u
        e.vo[:] += v
        e.vorticity[:] += vorticity
        e.slope_x[:] += f * v / GRAVITY
        e.slope_y[:] -= f * u / GRAVITY

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        u, v, _ = self.flow(np.asarray(lon, np.float64), np.asarray(lat, np.float64), time)
        return u, v


def metric_offsets(point: Pair, lon: Floats, lat: Floats, latlon: bool) -> tuple[Floats, Floats]:
    """Return how far (m) points lie east and north of one, with the metric of the mean latitude, across any seam."""
    dx, dy = np.asarray(lon, np.float64) - point[0], np.asarray(lat, np.float64) - point[1]
    if not latlon:
        return dx, dy
    dx = dx - 360.0 * np.round(dx / 360.0)
    scale = DEGREE * EARTH_RADIUS_A68
    return scale * cos_array((point[1] + 0.5 * dy) * DEGREE) * dx, scale * dy


def heading(towards: float) -> Pair:
    """Return the unit vector (east, north) of a direction in degrees clockwise from north."""
    return sin(towards * DEGREE), cos(towards * DEGREE)


def _check_celsius(temperature: float | None) -> float | None:
    """Refuse a temperature that no sea has."""
    if temperature is None or COLDEST <= temperature <= WARMEST:
        return temperature
    kelvin = 270.0 <= temperature <= 318.0
    hint = f": is it in kelvin? Then give {temperature - 273.15:.2f}" if kelvin else ""
    raise UnfitError(
        f"temperature = {temperature:g} is none of the sea in degrees Celsius{hint}",
        f"Give one from {COLDEST:g} to {WARMEST:g}",
    )


COLDEST, WARMEST = -3.0, 45.0
"""Temperatures (degrees Celsius) between which all seas lie."""


@_formula
class Uniform(Flow):
    """The same current, wind, sea ice and water everywhere, at all times.

    The sea surface slopes in balance with the current, unless its slope is given.
    """

    current: Annotated[Velocity, about("m s-1", "eastward and northward ocean current, in geostrophic balance")] = (
        0.0,
        0.0,
    )
    wind: Annotated[Wind, about("m s-1", "eastward and northward wind")] = (0.0, 0.0)
    sea_ice: Annotated[SeaIce, about("", "velocity (m s-1) and thickness (m) of sea ice", **ICE_UNITS)] = (
        0.0,
        0.0,
        0.0,
    )
    water: Annotated[float | None, about("m", "depth of water, 0 for dry ground", ge=0, le=1e5)] = Field(
        default=None, alias="depth"
    )
    ice_fraction: Annotated[float, about("1", "part of the sea that sea ice covers", ge=0, le=1)] = 0.0
    slope: Annotated[
        SurfaceSlope | None,
        about("1", "eastward and northward slope of the sea surface, without balance"),
    ] = None
    temperature: Annotated[
        float | None, AfterValidator(_check_celsius), about("degC", "temperature of the sea, for melt")
    ] = None
    salinity: Annotated[float | None, about("1e-3", "salinity of the sea, for melt", ge=0, le=50)] = None
    # Without a current to balance, it fits positions of both kinds.
    latlon: Annotated[bool | None, about("", "positions are degrees, otherwise metres", hidden=True)] = Field(
        default=None, kw_only=True
    )

    @field_validator("water", mode="before")
    @classmethod
    def _no_floor(cls, depth: Any) -> Any:
        # No floor and a floor endlessly deep are one; files have no number for the second.
        return None if depth == math.inf else depth

    @property
    def is_balanced(self) -> bool:
        """Whether the sea surface slopes as the current asks, and not as it was given."""
        return self.slope is None

    @model_validator(mode="after")
    def _has_a_latitude(self) -> Uniform:
        if self.is_balanced and any(self.current):
            self.latlon = True if self.latlon is None else self.latlon
            self.require_latitude()
        return self

    def __post_init__(self) -> None:
        water_values = (("sst", self.temperature), ("sss", self.salinity))
        self.provides = frozenset(name for name, value in water_values if value is not None)

    def flow(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats, Floats]:
        """Return the current and no vorticity."""
        ones = np.ones(np.shape(lon))
        return self.current[0] * ones, self.current[1] * ones, 0.0 * ones

    def add_to(self, elements: Elements, time: float) -> None:
        """Add current, slope, wind and sea ice; set depth, temperature and salinity where they are given."""
        e = elements.environment
        e.uo[:] += self.current[0]
        e.vo[:] += self.current[1]
        if self.slope is not None:
            e.slope_x[:] += self.slope[0]
            e.slope_y[:] += self.slope[1]
        elif any(self.current):
            f = self.coriolis(elements.place.lat)
            e.slope_x[:] += f * self.current[1] / GRAVITY
            e.slope_y[:] -= f * self.current[0] / GRAVITY
        e.ua[:] += self.wind[0]
        e.va[:] += self.wind[1]
        for values, value in zip((e.ui, e.vi, e.ice_thickness), self.sea_ice, strict=True):
            values[:] += value
        if self.ice_fraction > 0.0:
            np.maximum(e.ice_fraction, self.ice_fraction, out=e.ice_fraction)
        if self.water is not None:
            e.depth[:] = np.minimum(e.depth, self.water)
        for name, water_value in (("sst", self.temperature), ("sss", self.salinity)):
            if water_value is not None:
                getattr(e, name)[:] = water_value
                # The value at the surface counts, whatever another term has set.
                getattr(e, OVER_DRAFT[name])[:] = np.nan

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m)."""
        return np.full(np.shape(lon), math.inf if self.water is None else self.water)

    def describe(self) -> str:
        """Return the values in words."""
        ice = ice_text(self.sea_ice, self.ice_fraction)
        depth = "" if self.water is None else f"{self.water:g} m deep"
        return "uniform: " + join_texts(flows_text(self.current, self.wind), ice, depth)


@_formula
class Eddy(Flow):
    """A round eddy with a Gaussian stream function, which may travel.

    The water turns with ``s (r / R) exp((1 - r^2 / R^2) / 2)``: at most with s, at the distance R from the centre.
    """

    centre: Annotated[Position, about("degree", _CENTRE, **PLACE)]
    radius: Annotated[float, about("m", "distance of the fastest water from the centre", gt=0)]
    speed: Annotated[float, about("m s-1", "its speed, positive counter-clockwise", ge=-10, le=10)]
    velocity: Annotated[Velocity, about("m s-1", "eastward and northward velocity of the centre")] = (0.0, 0.0)

    def flow(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats, Floats]:
        """Return current and vorticity of the eddy."""
        centre = travelled(self.centre, self.velocity, time, bool(self.latlon))
        x, y = metric_offsets(centre, lon, lat, bool(self.latlon))
        q = (x * x + y * y) / self.radius**2
        turning = self.speed / self.radius * exp_array(0.5 * (1.0 - q))
        return -turning * y, turning * x, turning * (2.0 - q)

    def describe(self) -> str:
        """Return the values in words."""
        travels = f", travels at {pair_text(self.velocity)} m/s" if any(self.velocity) else ""
        return f"eddy at {_at(self, self.centre)}: {self.speed:g} m/s at {self.radius / 1e3:g} km{travels}"


def travelled(point: Pair, velocity: Pair, time: float, latlon: bool) -> Pair:
    """Return where a point is after a time (s) at a velocity (m s-1)."""
    east, north = velocity[0] * time, velocity[1] * time
    if not latlon:
        return point[0] + east, point[1] + north
    scale = DEGREE * EARTH_RADIUS_A68
    lat = point[1] + north / scale
    return point[0] + east / (scale * cos(0.5 * (point[1] + lat) * DEGREE)), lat


class Straight(Flow):
    """A current in one direction that depends on the distance from a line alone."""

    if TYPE_CHECKING:  # each has its arguments in an order of its own
        point: Pair
        towards: float
        width: float

    def profile(self, n: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return speed (m s-1) and its derivative (s-1) by the distance ``n`` (widths) to the left of the line."""
        raise NotImplementedError

    def flow(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats, Floats]:
        """Return current and vorticity."""
        east, north = heading(self.towards)
        x, y = metric_offsets(self.point, lon, lat, bool(self.latlon))
        speed, rise = self.profile((x * -north + y * east) / self.width, lat)
        return speed * east, speed * north, -rise

    def describe(self) -> str:
        """Return the values in words."""
        return f"{self.strength()} through {_at(self, self.point)} towards {compass(self.towards)}, {self.width / 1e3:g} km wide"

    def strength(self) -> str:
        """Return kind and strength in words."""
        return type(self).__name__.lower()


@_formula
class Stream(Straight):
    """A current in one direction whose profile scales with a speed."""

    point: Annotated[Position, about("degree", "a point of its middle, " + _CENTRE, **PLACE)]
    towards: Annotated[float, about("degree", _TOWARDS)]
    speed: Annotated[float, about("m s-1", "speed in the middle", ge=-10, le=10)]
    width: Annotated[float, about("m", "scale of the profile across", gt=0)]

    def strength(self) -> str:
        """Return kind and speed in words."""
        return f"{type(self).__name__.lower()} of {self.speed:g} m/s"


class Jet(Stream):
    """A straight jet with the profile ``s / cosh(n / w)^2`` (Bickley)."""

    def profile(self, n: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return speed and its derivative."""
        step = tanh_array(n)
        bell = self.speed * (1.0 - step * step)
        return bell, -2.0 * step * bell / self.width


class Shear(Stream):
    """A shear layer: the water flows with ``s tanh(n / w)``, one way on the left of a line and the other way on its right."""

    def profile(self, n: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return speed and its derivative."""
        step = tanh_array(n)
        return self.speed * step, self.speed * (1.0 - step * step) / self.width


@_formula
class Front(Straight):
    """A front: the sea surface steps up across a line, and water flows along it as the Earth turns.

    The sea level is ``step / 2 tanh(n / w)`` and the current ``-g / f d(eta)/dn``: with high water on its right on the
    northern hemisphere, on its left on the southern one.
    """

    point: Annotated[Position, about("degree", "a point of the line, " + _CENTRE, **PLACE)]
    along: Annotated[float, about("degree", "direction of the line, clockwise from north")]
    step: Annotated[float, about("m", "sea level on the left of the line above that on its right", ge=-10, le=10)]
    width: Annotated[float, about("m", "scale of the profile across", gt=0)]
    temperature: Annotated[Pair | None, about("degC", "temperature of the water on the left and on the right")] = None

    def __post_init__(self) -> None:
        self.towards = self.along
        self.provides = frozenset() if self.temperature is None else frozenset(("sst",))

    def strength(self) -> str:
        """Return kind and height of the step in words."""
        warm = "" if self.temperature is None else " from {1:g} to {0:g} °C".format(*self.temperature)
        return f"front of {self.step:g} m{warm}"

    def profile(self, n: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return speed and its derivative; f is the local one."""
        f = self.coriolis(lat)
        if (np.abs(f) < NEAR_EQUATOR).any():
            raise ForcingError(
                "a front near the equator has no balanced current",
                where="forcing",
                remedy="Keep it 2 degrees away, or give latitude",
            )
        step = tanh_array(n)
        bell = -GRAVITY / f * 0.5 * self.step / self.width * (1.0 - step * step)
        return bell, -2.0 * step * bell / self.width

    def add_to(self, elements: Elements, time: float) -> None:
        """Add current and slope, and set the temperature of the water."""
        super().add_to(elements, time)
        if self.temperature is None:
            return
        east, north = heading(self.towards)
        x, y = metric_offsets(self.point, elements.place.lon, elements.place.lat, bool(self.latlon))
        left, right = self.temperature
        share = 0.5 * (1.0 + tanh_array((x * -north + y * east) / self.width))
        elements.environment.sst[:] = right + (left - right) * share
        getattr(elements.environment, TEMPERATURE.over_draft)[:] = (
            np.nan
        )  # the value at the surface counts, whatever another term has set


NEAR_EQUATOR: Final = 5e-6
"""Coriolis parameter (s-1) below which no current is found from a sea level."""


@_formula
class Tide(Flow):
    """A tidal current: an ellipse that the water goes through once in a period, the same everywhere."""

    major: Annotated[float, about("m s-1", "largest speed", ge=0, le=10)]
    minor: Annotated[float, about("m s-1", "smallest speed, positive rotates counter-clockwise", ge=-10, le=10)] = 0.0
    towards: Annotated[float, about("degree", "direction of the largest speed, clockwise from north")] = 90.0
    period: Annotated[float, about("s", "period; M2 by default", ge=600)] = M2
    phase: Annotated[float, about("degree", "part of the period after the start at which the speed is largest")] = 0.0
    level: Annotated[float, about("m", "amplitude of the sea level, which lifts bergs off the floor", ge=0, le=20)] = (
        0.0
    )
    level_phase: Annotated[
        float, about("degree", "part of the period after the start at which the level is highest")
    ] = 0.0

    @model_validator(mode="after")
    def _an_ellipse(self) -> Tide:
        if abs(self.minor) > self.major:
            raise UnfitError(
                f"minor = {self.minor:g} m/s is faster than major = {self.major:g} m/s",
                "Swap them, and turn towards by 90",
            )
        return self

    def flow(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats, Floats]:
        """Return the current of the moment."""
        angle = 2.0 * math.pi * time / self.period - self.phase * DEGREE
        along, left = self.major * cos(angle), self.minor * sin(angle)
        east, north = heading(self.towards)
        u, v = along * east - left * north, along * north + left * east
        ones = np.ones(np.shape(lon))
        return u * ones, v * ones, 0.0 * ones

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the level of the moment (m), the same everywhere; constituents are tides that are added up."""
        angle = 2.0 * math.pi * time / self.period - self.level_phase * DEGREE
        return np.full(np.shape(lon), self.level * cos(angle))

    def describe(self) -> str:
        """Return the values in words."""
        level = f" and {self.level:g} m" if self.level else ""
        return f"tide of {self.major:g} m/s{level} every {self.period / 3600.0:.4g} h"


class SeaFloor(Part):
    """A sea floor; of several the shallowest counts."""

    def add_to(self, elements: Elements, time: float) -> None:
        """Raise the sea floor."""
        depth = elements.environment.depth
        depth[:] = np.minimum(depth, self.depth(elements.place.lon, elements.place.lat))


@_formula
class Seamount(SeaFloor):
    """A bell on the sea floor: ``depth - height exp(-r^2 / (2 w^2))``."""

    centre: Annotated[Position, about("degree", _CENTRE, **PLACE)]
    height: Annotated[float, about("m", "height of the summit above the plain", ge=-1e4, le=1e4)]
    width: Annotated[float, about("m", "standard deviation of the bell", gt=0)]
    plain: Annotated[float, about("m", "depth of the plain", gt=0, le=1e5)] = Field(alias="depth")

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m)."""
        x, y = metric_offsets(self.centre, lon, lat, bool(self.latlon))
        depth: Floats = self.plain - self.height * exp_array(-(x * x + y * y) / (2.0 * self.width**2))
        return depth

    def describe(self) -> str:
        """Return the values in words."""
        return (
            f"seamount at {_at(self, self.centre)}: summit {self.plain - self.height:g} m deep, plain {self.plain:g} m"
        )


@_formula
class Slope(SeaFloor):
    """A sea floor that deepens steadily in one direction."""

    point: Annotated[Position, about("degree", "where the water has the depth given, " + _CENTRE, **PLACE)]
    towards: Annotated[float, about("degree", "direction in which it deepens, clockwise from north")]
    gradient: Annotated[float, about("1", "metres of depth per metre", ge=-1, le=1)]
    middle: Annotated[float, about("m", "depth at that point", gt=0, le=1e5)] = Field(alias="depth")
    between: Annotated[Pair, about("m", "least and largest depth")] = (1.0, 5000.0)

    @model_validator(mode="after")
    def _in_order(self) -> Slope:
        if not self.between[0] < self.between[1]:
            raise UnfitError(f"between = {list(self.between)} is not in order", "The least depth stands first")
        return self

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m)."""
        x, y = metric_offsets(self.point, lon, lat, bool(self.latlon))
        east, north = heading(self.towards)
        depth: Floats = np.clip(self.middle + self.gradient * (x * east + y * north), *self.between)
        return depth

    def describe(self) -> str:
        """Return the values in words."""
        where = f"{self.middle:g} m at {_at(self, self.point)}"
        return f"sea floor that deepens by {1e3 * self.gradient:g} m per km towards {compass(self.towards)}, {where}"


@_formula
class TurningWind(Part):
    """A wind of one speed whose direction turns steadily."""

    speed: Annotated[float, about("m s-1", "speed", ge=0, le=150)]
    towards: Annotated[float, about("degree", "direction to which it blows at the start, clockwise from north")] = 90.0
    turning: Annotated[float, about("degree h-1", "how fast it rotates, positive clockwise")] = 15.0
    # A wind that is the same everywhere fits positions of both kinds.
    latlon: Annotated[bool | None, about("", "positions are degrees, otherwise metres", hidden=True)] = Field(
        default=None, kw_only=True
    )

    def add_to(self, elements: Elements, time: float) -> None:
        """Add the wind of the moment."""
        east, north = heading(self.towards + self.turning * time / 3600.0)
        elements.environment.ua[:] += self.speed * east
        elements.environment.va[:] += self.speed * north

    def describe(self) -> str:
        """Return the values in words."""
        return f"wind of {self.speed:g} m/s that rotates by {self.turning:g} degrees per hour"


FORMULAS: Final[dict[str, type[Part]]] = {
    "uniform": Uniform, "eddy": Eddy, "jet": Jet, "shear": Shear, "front": Front, "tide": Tide, "seamount": Seamount,
    "slope": Slope, "turning_wind": TurningWind,
}  # fmt: skip
"""The formulas by the names that files and `riftberg.Forcing` give them."""
