"""A closed-form ocean, fitted to the observed drift of A68a in December 2020, in which the berg breaks as observed.

These currents are fitted, not measured: nobody observed the water under the berg. In local coordinates
X = R cos(-55.8) (lon + 37.4), Y = R (lat + 55.8) with s days since 9 December 13:00 UTC, the current is
``u = -psi_Y``, ``v = psi_X cos(-55.8) / cos(lat)``, which is free of divergence on the sphere. The sea surface holds it: with
``eta = f0 psi / g`` in geostrophic balance, and with ``-Du/Dt / g`` on its curved and unsteady path (not in the reference's
story, whose slope is geostrophic). Here is::

    psi = G (V x - U y) exp(-(r / Ld)^4)                                    the drift along the observed path
        + W Le^2 / 2 (1 - exp(-(r / Le)^2))                                 the eddy that turns the berg
        - A [Um Y + Uj bj tanh((Y - Yj) / bj) - Uc bc tanh((Y - Yc) / bc)]  the shear that breaks the finger off

where (x, y) is measured from a centre that moves at (U, V) along a polynomial path, r is the distance from it, G makes
up for the rim of the drift, where the berg's ends lie, and W(s) is the spin of the eddy. The drift ends at its rim, so
that the tip, once it has been held by the shoal, stays behind. The shear is an eastward jet (Uj) at the finger and a
counter-current (Uc) at the middle of the berg; a uniform flow (Um) makes its pull on the whole berg vanish. It grows
and decays with A(s). A wind, and a shoal on which the tip grounds, complete it: a bell as deep as the keel
(166 m) on a circle of 5.0 km. The form follows the shared description of the A68a
story, whose own numbers (`REFERENCE`) belong to the numerics of the reference.
"""

from __future__ import annotations

import math
from datetime import datetime
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel, plain, stage
from riftberg.config.units import place_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY, SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.ocean.forcing import Forcing
from riftberg.ocean.formulas import MATERIAL_STEP
from riftberg.ocean.grid import Grid
from riftberg.physics.elementary import cos, cosh, exp, sin, tanh
from riftberg.physics.geometry import fast_cos_latitude
from riftberg.state import Elements, Floats

LATITUDE, LONGITUDE = -55.8, -37.4
"""Origin of the local coordinates, degrees."""

BEGINS: Final = datetime(2020, 12, 9, 13)
"""Date (UTC) from which the numbers count their days."""


class StoryNumbers(NamedTuple):
    """Numbers of the fitted ocean."""

    # Path of the centre, km in local coordinates: polynomials in days since the start, highest power first
    path_x: tuple[float, ...]
    path_y: tuple[float, ...]
    last_day: float  # After this many days the drift keeps its velocity
    eddy_spin: float  # Largest spin of the eddy at its centre, s-1; negative is clockwise
    eddy_day: float  # Day of that spin, and its duration (half-width of a sech^2), days
    eddy_days: float  # Day of that spin, and its duration (half-width of a sech^2), days
    late_spin: float  # Spin after the ninth day, s-1
    jet_speed: float  # Speed (m s-1, eastward), half-width (m) and latitude (degrees) of the jet
    jet_width: float  # Speed (m s-1, eastward), half-width (m) and latitude (degrees) of the jet
    jet_latitude: float  # Speed (m s-1, eastward), half-width (m) and latitude (degrees) of the jet
    shear_end: float  # Days on which the shear has grown and decayed to half; each takes about a day
    # Longitude and latitude (degrees), length scale (m), height above the floor (m) and depth of the floor (m)
    shoal: tuple[float, float, float, float, float]
    eddy_radius: float = 100e3  # Radius, m
    # Radius of the drift's rim (m), and by how much the drift exceeds the velocity of its centre
    drift_radius: float = math.inf
    drift_gain: float = 1.0
    surge: float = 0.0  # Displacement of an onshore surge to the north-east around day 7.8, m
    counter_speed: float = 0.0  # The same of the counter-current, westward
    counter_width: float = 25e3  # The same of the counter-current, westward
    counter_latitude: float = -56.0  # The same of the counter-current, westward
    shear_flow: float = 0.0  # Uniform eastward current that goes with jet and counter-current, m s-1
    shear_start: float = -math.inf  # Days on which the shear has grown and decayed to half; each takes about a day
    wind: tuple[float, float] = (5.0, -2.0)  # Eastward and northward wind, m s-1
    gradient_wind: bool = True  # The sea surface also balances the change of the current along the path of the water
    reference: bool = False  # Fitted with the numerics of the reference, not with Riftberg's own


OWN = StoryNumbers(
    path_x=(
        4.8553129e-06,
        -0.00030114182,
        0.0074267509,
        -0.093287993,
        0.64321639,
        -2.4683338,
        4.1499729,
        18.534261,
        -108.11449,
    ),
    path_y=(
        4.5451895e-06,
        -0.00033106322,
        0.0099035781,
        -0.1554586,
        1.352136,
        -6.2516944,
        12.297993,
        -11.912432,
        99.919945,
    ),
    last_day=17.0,
    drift_radius=105e3,
    drift_gain=1.05,
    surge=4.91e3,
    eddy_spin=-4.6e-6,
    eddy_day=3.027,
    eddy_days=3.415,
    late_spin=0.3e-6,
    jet_speed=0.26,
    jet_width=25.6e3,
    jet_latitude=-56.612,
    counter_speed=1.013,
    counter_width=25.4e3,
    counter_latitude=-56.216,
    shear_flow=0.335,
    shear_start=10.876,
    shear_end=11.895,
    shoal=(-37.221, -54.95, 7580.0, 130.0, 250.0),
)
"""Fitted with Riftberg's own numerics."""


REFERENCE = StoryNumbers(
    reference=True,
    gradient_wind=False,
    path_x=(-3.04797e-4, 0.0129882, -0.197984, 1.30416, -4.19217, 23.207, -115.233),
    path_y=(2.24966e-4, -0.00939015, 0.144074, -0.951043, 1.36853, -0.696596, 86.7088),
    last_day=14.5,
    eddy_spin=-8.0e-6,
    eddy_day=3.46,
    eddy_days=2.36,
    late_spin=1.13e-6,
    surge=4e3,
    jet_speed=0.75,
    jet_width=25e3,
    jet_latitude=-56.85,
    shear_end=22.5 - 9.0 - 13.0 / 24.0,
    shoal=(-37.25, -54.95, 7580.0, 130.0, 250.0),
)
"""Fitted with the numerics of the reference, whose damper slows the turning: the shared description's own numbers."""


class _Instant(NamedTuple):
    """The ocean at one time: centre (m), drift (m s-1), spin (s-1), shear (m s-1), and constants."""

    x: float
    y: float
    u: float
    v: float
    spin: float
    jet: float
    counter: float
    flow: float
    eddy_radius: float
    drift_radius: float
    jet_width: float
    jet_y: float
    counter_width: float
    counter_y: float


# LLVM takes no function of this length into a loop by itself, and a loop with calls in it does not vectorise.
@stage
def stream(x_local: float, y_local: float, instant: _Instant) -> tuple[float, float, float, float]:
    """Return psi (m2 s-1), psi_X, psi_Y (m s-1) and the Laplacian of psi (s-1) at a point in local coordinates (m)."""
    x, y = x_local - instant.x, y_local - instant.y
    q, rim = (x * x + y * y) / instant.eddy_radius**2, (x * x + y * y) / instant.drift_radius**2
    bell, envelope = exp(-q), exp(-rim * rim)
    slope = -4.0 * rim / instant.drift_radius**2  # of ln(envelope), along (x, y)
    drift = (instant.v * x - instant.u * y) * envelope
    jet = tanh((y_local - instant.jet_y) / instant.jet_width)
    counter = tanh((y_local - instant.counter_y) / instant.counter_width)
    jet_profile, counter_profile = 1.0 - jet * jet, 1.0 - counter * counter
    psi = drift + 0.5 * instant.spin * instant.eddy_radius**2 * (1.0 - bell)
    psi += (
        -instant.flow * y_local
        - instant.jet * instant.jet_width * jet
        + instant.counter * instant.counter_width * counter
    )
    psi_x = instant.v * envelope + slope * x * drift + instant.spin * x * bell
    psi_y = -instant.u * envelope + slope * y * drift + instant.spin * y * bell
    psi_y += -instant.flow - instant.jet * jet_profile + instant.counter * counter_profile
    curl = slope * drift * (6.0 - 4.0 * rim * rim) + 2.0 * instant.spin * bell * (1.0 - q)
    curl += 2.0 * instant.jet * jet * jet_profile / instant.jet_width
    curl -= 2.0 * instant.counter * counter * counter_profile / instant.counter_width
    return psi, psi_x, psi_y, curl


@kernel
def _polynomial(coefficients: tuple[float, ...], x: float) -> tuple[float, float]:
    """Value and derivative of a polynomial, highest power first."""
    value = slope = 0.0
    degree = len(coefficients) - 1
    for k in range(degree):
        value = value * x + coefficients[k]
        slope = slope * x + (degree - k) * coefficients[k]
    return value * x + coefficients[degree], slope


@kernel
def ocean_instant(n: StoryNumbers, time: float) -> _Instant:
    """Return the ocean at ``time`` seconds after 9 December 2020 13:00 UTC."""
    s, metre = time / SECONDS_PER_DAY, EARTH_RADIUS_A68 * DEGREE
    day, late = min(s, n.last_day), max(s - n.last_day, 0.0)
    (x, u), (y, v) = _polynomial(n.path_x, day), _polynomial(n.path_y, day)
    spin = n.eddy_spin / cosh((s - n.eddy_day) / n.eddy_days) ** 2
    spin += n.late_spin * 0.5 * (1.0 + tanh((s - 9.0) / 1.5))
    bump = n.surge * exp(-(((s - 7.8) / 0.5) ** 2)) / math.sqrt(2.0)
    rate = bump * -2.0 * (s - 7.8) / 0.25 / SECONDS_PER_DAY
    on = 0.25 * (1.0 + tanh((n.shear_end - s) / 0.5)) * (1.0 + tanh((s - n.shear_start) / 0.5))
    return _Instant(
        1e3 * x + late * (1e3 * u) + bump,
        1e3 * y + late * (1e3 * v) + bump,
        n.drift_gain * (1e3 * u / SECONDS_PER_DAY + rate),
        n.drift_gain * (1e3 * v / SECONDS_PER_DAY + rate),
        spin,
        on * n.jet_speed,
        on * n.counter_speed,
        on * n.shear_flow,
        n.eddy_radius,
        n.drift_radius,
        n.jet_width,
        metre * (n.jet_latitude - LATITUDE),
        n.counter_width,
        metre * (n.counter_latitude - LATITUDE),
    )


# One call for all three moments, with the fields of the elements apart: they are written in place.
@borrower
def _fill(
    lon: Floats, lat: Floats, uo: Floats, vo: Floats, slope_x: Floats, slope_y: Floats, vorticity: Floats,
    numbers: StoryNumbers, time: float,
) -> None:  # fmt: skip
    """Fill current, slope and vorticity at many points."""
    scale, f_over_g = (
        cos(-55.8 * math.pi / 180.0),
        2.0 * EARTH_ROTATION * sin(-55.8 * math.pi / 180.0) / GRAVITY,
    )
    metre, instant = EARTH_RADIUS_A68 * math.pi / 180.0, ocean_instant(numbers, time)
    earlier = ocean_instant(numbers, time - MATERIAL_STEP)
    later = ocean_instant(numbers, time + MATERIAL_STEP)
    for e in range(lon.size):
        west = lon[e] - 360.0 * np.floor((lon[e] + 180.0) / 360.0)
        stretch = scale / fast_cos_latitude(lat[e])
        x, y = metre * scale * (west + 37.4), metre * (lat[e] + 55.8)
        _, psi_x, psi_y, curl = stream(x, y, instant)
        uo[e], vo[e], vorticity[e] = -psi_y, psi_x * stretch, curl
        slope_x[e], slope_y[e] = f_over_g * psi_x * stretch, f_over_g * psi_y
        if not numbers.gradient_wind:
            continue
        # -Du/Dt / g, by the current where the water comes from and where it goes.
        east, north = MATERIAL_STEP * uo[e] * stretch, MATERIAL_STEP * vo[e]
        _, ahead_x, ahead_y, _ = stream(x + east, y + north, later)
        _, behind_x, behind_y, _ = stream(x - east, y - north, earlier)
        ahead_x *= scale / fast_cos_latitude(lat[e] + north / metre)
        behind_x *= scale / fast_cos_latitude(lat[e] - north / metre)
        slope_x[e] += (ahead_y - behind_y) / (2.0 * MATERIAL_STEP * GRAVITY)
        slope_y[e] -= (ahead_x - behind_x) / (2.0 * MATERIAL_STEP * GRAVITY)


@borrower
def _fill_bell(
    lon: Floats, lat: Floats, centre_lon: float, centre_lat: float, length: float, height: float, floor: float, depth: Floats
) -> None:  # fmt: skip
    """Fill the depth (m) of a flat floor with a bell on it."""
    metre = EARTH_RADIUS_A68 * DEGREE
    along = metre * cos(centre_lat * DEGREE)
    for e in range(lon.size):
        west = lon[e] - 360.0 * np.floor((lon[e] + 180.0) / 360.0)  # a remainder would keep the loop from vectorising
        x = along * (west - centre_lon)
        y = metre * (lat[e] - centre_lat)
        depth[e] = floor - height * exp(-(x * x + y * y) / length**2)


class StoryOcean(Forcing):
    """The fitted ocean as forcing, evaluated at the elements themselves.

    ``shoal``, ``shear``: with these parts; ``start``: date (UTC) at which the run starts, which has the ocean of that date.
    """

    grid: Grid | None = None
    citations = ("Huth, A., Adcroft, A., Sergienko, O., Khan, N. (2022), doi:10.1126/sciadv.abq6974",)

    def __init__(
        self, numbers: StoryNumbers = OWN, *, shoal: bool = True, shear: bool = True, start: datetime = BEGINS
    ) -> None:
        if start < BEGINS:
            raise ForcingError(
                f"the ocean of A68a begins on {BEGINS:%Y-%m-%d %H:%M}, the run on {start:%Y-%m-%d %H:%M}",
                where="start", remedy="Start the run then or later; the currents were fitted to the drift until 26 December",
            )  # fmt: skip
        self.start, self._late = start, (start - BEGINS).total_seconds()
        self.numbers = numbers if shear else numbers._replace(jet_speed=0.0, counter_speed=0.0, shear_flow=0.0)
        self.has_shoal = shoal
        fitted_with = " with the reference's numerics" if numbers.reference else ""
        self.title = f"currents fitted to the observed drift{fitted_with}, not measured"

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        place, e = elements.place, elements.environment
        self._fill(place.lon, place.lat, time, e.uo, e.vo, e.slope_x, e.slope_y, e.vorticity)
        e.ua[:], e.va[:] = self.numbers.wind
        self._fill_depth(place.lon, place.lat, e.depth)

    def instant(self, time: float) -> _Instant:
        """Return the ocean at a time (s) of the run."""
        time += self._late
        return plain(ocean_instant)(self.numbers, time)

    def _fill(self, lon: Floats, lat: Floats, time: float, *fields: Floats) -> None:
        """Fill current, slopes and vorticity at a list of points."""
        _fill(lon, lat, *fields, self.numbers, time + self._late)

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Serve any place and time; far from the berg's path the numbers mean nothing."""

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        x, y = np.ravel(np.asarray(lon, np.float64)), np.ravel(np.asarray(lat, np.float64))
        u, v, a, b, c = np.empty((5, x.size))
        self._fill(x, y, time, u, v, a, b, c)
        return u.reshape(np.shape(lon)), v.reshape(np.shape(lon))

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        x, y = np.ravel(np.asarray(lon, np.float64)), np.ravel(np.asarray(lat, np.float64))
        depth = np.empty(x.size)
        self._fill_depth(x, y, depth)
        return depth.reshape(np.shape(lon))

    def _fill_depth(self, lon: Floats, lat: Floats, depth: Floats) -> None:
        """Fill the depth of water (m) at a list of points."""
        if self.has_shoal:
            _fill_bell(lon, lat, *self.numbers.shoal, depth)
        else:
            depth[:] = self.numbers.shoal[-1]

    def describe(self) -> str:
        """Return this ocean in plain words."""
        features = ["a drift, an eddy", "a shear" if self.numbers.jet_speed else "no shear"]
        features.append(
            f"a shoal at {place_text(*self.numbers.shoal[:2], latlon=True, digits=2)}" if self.has_shoal else "no shoal"
        )
        return f"closed-form ocean for A68a ({', '.join(features)}) from {self.start:%Y-%m-%d %H:%M}; {self.title}"
