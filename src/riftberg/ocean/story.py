"""A closed-form ocean, fitted to the observed drift of A68a in December 2020, in which the berg breaks as observed.

These currents are fitted, not measured: nobody observed the water under the berg. In local coordinates
X = R cos(-55.8) (lon + 37.4), Y = R (lat + 55.8) with s days since 9 December 13:00 UTC, the current is
``u = -psi_Y``, ``v = psi_X cos(-55.8) / cos(lat)``, which is free of divergence on the sphere, and the sea level is in
geostrophic balance, ``eta = f0 psi / g``, with::

    psi = V x - U y + W Le^2 / 2 (1 - exp(-(x^2 + y^2) / Le^2)) - A U0 b tanh((Y - YJ) / b)

where (x, y) is measured from a centre that drifts at (U, V) along a polynomial path (the drift), W(s) is the spin of a
travelling cyclonic eddy, and the last term is an eastward jet whose shear breaks the finger off. A wind, and a shoal of
5 km on which the tip grounds, complete it. The form is that of the shared description of the A68a story; the numbers
differ where Riftberg's own numerics (objective damping) turn the berg faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY, SECONDS_PER_DAY
from riftberg.kernels import kernel
from riftberg.ocean.grid import Grid
from riftberg.state import Elements, Floats

LATITUDE, LONGITUDE = -55.8, -37.4
"""Origin of the local coordinates, degrees."""

PATH_X = (-3.04797e-4, 0.0129882, -0.197984, 1.30416, -4.19217, 23.207, -115.233)
PATH_Y = (2.24966e-4, -0.00939015, 0.144074, -0.951043, 1.36853, -0.696596, 86.7088)
"""Path of the centre, km: polynomials in days since 9 December 13:00, highest power first."""

LAST_DAY = 14.5
"""After this many days the drift keeps its velocity."""

JET_END = 22.5 - 9.0 - 13.0 / 24.0
"""Day (since the start) around which the jet ends."""


@dataclass(frozen=True)
class StoryNumbers:
    """Numbers of the fitted ocean.

    Attributes
    ----------
    eddy_spin : float
        Largest spin of the eddy at its centre, s-1; negative is clockwise.
    eddy_day, eddy_days : float
        Day of that spin, and its duration (half-width of a sech^2), days.
    late_spin : float
        Spin after the ninth day, s-1.
    eddy_radius : float
        Radius, m.
    surge : float
        Displacement of an onshore surge to the north-east around day 7.8, m.
    jet_speed, jet_width, jet_latitude : float
        Speed (m s-1), half-width (m) and latitude (degrees) of the jet.
    wind : tuple of float
        Eastward and northward wind, m s-1.
    shoal : tuple of float
        Longitude and latitude (degrees), length scale (m), height above the floor (m) and depth of the floor (m).
    """

    eddy_spin: float = -4.64e-6
    eddy_day: float = 2.87
    eddy_days: float = 3.4
    late_spin: float = 0.32e-6
    eddy_radius: float = 100e3
    surge: float = 4e3
    jet_speed: float = 0.75
    jet_width: float = 25e3
    jet_latitude: float = -56.80
    wind: tuple[float, float] = (5.0, -2.0)
    shoal: tuple[float, float, float, float, float] = (-37.176, -54.925, 7580.0, 130.0, 250.0)


OWN = StoryNumbers()
"""Fitted with Riftberg's own numerics."""

REFERENCE = StoryNumbers(
    eddy_spin=-8.0e-6,
    eddy_day=3.46,
    eddy_days=2.36,
    late_spin=1.13e-6,
    jet_latitude=-56.85,
    shoal=(-37.25, -54.95, 7580.0, 130.0, 250.0),
)
"""Fitted with the numerics of the reference, whose damper slows the turning: the shared description's own numbers."""


class _Instant(NamedTuple):
    """The ocean at one time: centre (m), drift (m s-1), spin (s-1), jet speed (m s-1), and constants."""

    x: float
    y: float
    u: float
    v: float
    spin: float
    jet: float
    eddy_radius: float
    jet_width: float
    jet_y: float


@kernel
def derivatives(x_local: float, y_local: float, now: _Instant) -> tuple[float, float, float]:
    """Return psi_X, psi_Y (m s-1) and the Laplacian of psi (s-1) at a point in local coordinates (m)."""
    x, y, le = x_local - now.x, y_local - now.y, now.eddy_radius
    bell = math.exp(-(x * x + y * y) / (le * le))
    across = math.tanh((y_local - now.jet_y) / now.jet_width)
    profile = 1.0 - across * across
    psi_x = now.v + now.spin * x * bell
    psi_y = -now.u + now.spin * y * bell - now.jet * profile
    eddy = 2.0 * now.spin * bell * (1.0 - (x * x + y * y) / (le * le))
    return psi_x, psi_y, eddy + 2.0 * now.jet * across * profile / now.jet_width


@kernel
def _fill(lon, lat, uo, vo, slope_x, slope_y, vorticity, now):
    """Fill current, slope and vorticity at many points."""
    scale, f_over_g = math.cos(-55.8 * math.pi / 180.0), 2.0 * 7.292e-5 * math.sin(-55.8 * math.pi / 180.0) / 9.8
    metre = 6_363_827.0 * math.pi / 180.0
    for e in range(lon.size):
        west = lon[e] - 360.0 * np.floor((lon[e] + 180.0) / 360.0)
        stretch = scale / math.cos(lat[e] * math.pi / 180.0)
        psi_x, psi_y, curl = derivatives(metre * scale * (west + 37.4), metre * (lat[e] + 55.8), now)
        uo[e], vo[e] = -psi_y, psi_x * stretch
        slope_x[e], slope_y[e] = f_over_g * psi_x * stretch, f_over_g * psi_y
        vorticity[e] = curl


class StoryOcean:
    """The fitted ocean as forcing, evaluated at the elements themselves.

    Parameters
    ----------
    numbers : StoryNumbers, optional
        The fit.
    shoal, shear : bool, optional
        Whether there is a shoal, and a jet; without them the berg does not lose its tip, or its finger.
    """

    grid: Grid | None = None
    title = "currents fitted to the observed drift, not measured"
    citations = ("Huth, A., Adcroft, A., Sergienko, O., Khan, N. (2022), doi:10.1126/sciadv.abq6974",)

    def __init__(self, numbers: StoryNumbers = OWN, *, shoal: bool = True, shear: bool = True) -> None:
        self.numbers = numbers if shear else replace(numbers, jet_speed=0.0)
        self.has_shoal = shoal

    def instant(self, time: float) -> _Instant:
        """Return the ocean at ``time`` seconds after 9 December 2020 13:00 UTC."""
        n, s = self.numbers, time / SECONDS_PER_DAY
        centre, drift = _path(s)
        bump = n.surge * math.exp(-(((s - 7.8) / 0.5) ** 2)) / math.sqrt(2.0)
        rate = bump * -2.0 * (s - 7.8) / 0.25 / SECONDS_PER_DAY
        spin = n.eddy_spin / math.cosh((s - n.eddy_day) / n.eddy_days) ** 2
        spin += n.late_spin * 0.5 * (1.0 + math.tanh((s - 9.0) / 1.5))
        jet = n.jet_speed * 0.5 * (1.0 + math.tanh((JET_END - s) / 0.5))
        jet_y = EARTH_RADIUS_A68 * DEGREE * (n.jet_latitude - LATITUDE)
        return _Instant(
            centre[0] + bump, centre[1] + bump, drift[0] + rate, drift[1] + rate, spin, jet, n.eddy_radius,
            n.jet_width, jet_y,
        )  # fmt: skip

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        e = elements
        _fill(e.lon, e.lat, e.uo, e.vo, e.slope_x, e.slope_y, e.vorticity, self.instant(time))
        e.ua[:], e.va[:] = self.numbers.wind
        e.depth[:] = self.depth(e.lon, e.lat)

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Serve any place and time; far from the berg's path the numbers mean nothing."""

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        x, y = np.ravel(np.asarray(lon, np.float64)), np.ravel(np.asarray(lat, np.float64))
        u, v, a, b, c = np.empty((5, x.size))
        _fill(x, y, u, v, a, b, c, self.instant(time))
        return u.reshape(np.shape(lon)), v.reshape(np.shape(lon))

    def sea_level(self, lon: float, lat: float, time: float) -> float:
        """Return the sea level (m) at one point, for tests and maps; its slope is what moves the berg."""
        now = self.instant(time)
        x_local = EARTH_RADIUS_A68 * math.cos(LATITUDE * DEGREE) * DEGREE * (lon - LONGITUDE)
        y_local = EARTH_RADIUS_A68 * DEGREE * (lat - LATITUDE)
        x, y, le = x_local - now.x, y_local - now.y, now.eddy_radius
        psi = now.v * x - now.u * y + 0.5 * now.spin * le * le * (1.0 - math.exp(-(x * x + y * y) / le**2))
        psi -= now.jet * now.jet_width * math.tanh((y_local - now.jet_y) / now.jet_width)
        return 2.0 * EARTH_ROTATION * math.sin(LATITUDE * DEGREE) * psi / GRAVITY

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        shoal_lon, shoal_lat, length, height, floor = self.numbers.shoal
        if not self.has_shoal:
            return np.full(np.shape(lon), floor)
        metre = EARTH_RADIUS_A68 * DEGREE
        west = (np.asarray(lon) + 180.0) % 360.0 - 180.0
        x = metre * math.cos(shoal_lat * DEGREE) * (west - shoal_lon)
        y = metre * (np.asarray(lat) - shoal_lat)
        shape: Floats = floor - height * np.exp(-(x * x + y * y) / length**2)
        return shape

    def describe(self) -> str:
        """Return what this ocean is, in plain words."""
        parts = ["a drift, an eddy", "a jet" if self.numbers.jet_speed else "no jet"]
        parts.append("a shoal at {:.2f} E, {:.2f} N".format(*self.numbers.shoal) if self.has_shoal else "no shoal")
        return f"closed-form ocean for A68a ({', '.join(parts)}); {self.title}"


def _path(s: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre of the eddy (m) and its velocity (m s-1) on day ``s``."""
    day, late = min(s, LAST_DAY), max(s - LAST_DAY, 0.0)
    speed = [1e3 * float(np.polyval(np.polyder(p), day)) for p in (PATH_X, PATH_Y)]
    place = [1e3 * float(np.polyval(p, day)) + late * v for p, v in zip((PATH_X, PATH_Y), speed, strict=True)]
    return (place[0], place[1]), (speed[0] / SECONDS_PER_DAY, speed[1] / SECONDS_PER_DAY)
