"""Errors of the ocean, the air and the sea floor: random fields, correlated in space and time, on top of any forcing.

The error of the current is drawn as an error of the sea level eta, with a Gaussian correlation exp(-r^2 / 2 L^2) and an
exponential one in time. The current that balances it at each latitude comes with it::

    u = -(g / F) d(eta)/dy,    v = (g / F) d(eta)/dx,    F = s max(|f|, f(5 degrees)),    s the sign of f at the start

and the slopes are those that balance this current, ``f v / g`` and ``-f u / g``. Beyond 5 degrees from the equator these
are the slopes of eta itself; nearer to it eta is a stream function whose level fades with f. Such a current has the
divergence -beta v / f, about L / (R tan(latitude)) of its vorticity: below 1 % for 50 km poleward of 40 degrees. The
standard deviation of each component is the one given at the latitude of the start, and goes with 1 / f from there.

Fields are made by FFT on a periodic grid of points L / 2 apart, in time by an autoregressive sequence of order 1, and read
between the points by cubic splines, which keep the variance (linear interpolation loses up to half of it). They lie on a
conformal plane that touches the sphere at the start, so the length stays within 2 % over 1,700 km, poles and 180 degrees
included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY
from riftberg.errors import InputError
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.physics.elementary import cos, cos_array, exp, exp_array, sin
from riftberg.plane import ConformalPlane
from riftberg.state import Elements, Floats

KNOTS: Final = 8
"""Fields drawn within one time scale; those between are blended so that the variance stays."""

POINTS_PER_LENGTH: Final = 2.0
"""Points of the grid per length: the field has 2e-9 of its variance beyond their resolution."""

KEPT_BYTES: Final = 16_000_000
"""Memory for the knots of a field that are kept; at least two are."""

EQUATOR: Final = 5.0
"""Latitude (degrees) below which the level of the balanced current fades."""

Ends = tuple[float, float, float, float]
"""Least x and y, largest x and y of some places, m."""

_KINDS: Final = {"current": 1, "wind": 2, "floor": 3}
"""Streams of random numbers of one seed."""


@dataclass(frozen=True)
class FieldError:
    """Size of a random error: standard deviation, and the scales over which it is correlated."""

    spread: float  # Standard deviation: of each component of a velocity (m s-1), or of a depth (1, as factor of `RandomField`)
    length: float  # L of the correlation exp(-r^2 / 2 L^2) of level or stream function, m
    time: float = math.inf  # T of the correlation exp(-t / T), s


class RandomField:
    """A Gaussian random field, periodic on a square, that changes in time.

    ``gradient``: the spread describes its derivatives (m s-1 if the field is a stream function), not the field.
    """

    def __init__(self, error: FieldError, *, seed: int, kind: str, extent: float, gradient: bool) -> None:
        self.error, self.seed, self.kind = error, int(seed), kind
        self.step = error.length / POINTS_PER_LENGTH  # m between points
        # Twice the extent and sixteen lengths: the ends of a berg must not see the same error.
        needed = POINTS_PER_LENGTH * (16.0 + 2.0 * extent / error.length)
        self.points = 2 ** math.ceil(math.log2(max(needed, 32.0)))
        if self.points > 1024:
            raise InputError(
                f"an error with a length of {error.length:g} m under ice {extent / 1e3:.0f} km wide",
                where=f"{kind}_error.length", remedy=f"Give {extent / 200.0:.0f} m or more",
            )  # fmt: skip
        # What turns white noise into spline coefficients of the field.
        n = self.points
        kx, ky = 2.0 * np.pi * np.fft.rfftfreq(n), 2.0 * np.pi * np.fft.fftfreq(n)[:, None]  # per point
        square = kx**2 + ky**2
        shape: Floats = exp_array(-0.25 * square * POINTS_PER_LENGTH**2)
        multiplicity = np.where(
            (np.arange(kx.size) == 0) | (2 * np.arange(kx.size) == n), 1.0, 2.0
        )  # an rfft holds half of the waves
        weight = 0.5 * square / self.step**2 if gradient else 1.0
        variance = float((multiplicity * weight * shape**2).sum()) / n**2
        spline = (
            (2.0 + cos_array(kx)) / 3.0 * (2.0 + cos_array(ky)) / 3.0
        )  # a cubic spline's value at its points over its coefficients
        self._filter = np.asarray(self.error.spread / math.sqrt(variance) * shape / spline)
        self._white: Floats | None = None  # of the knot that was drawn last
        self._knot = -1
        self._known: dict[int, Floats] = {}

    def _drawn(self, knot: int) -> Floats:
        # Counter-based: the numbers of a knot depend on seed, kind and knot alone.
        stream = np.random.Philox(
            key=np.array([self.seed, _KINDS[self.kind]], np.uint64), counter=np.array([0, 0, 0, knot], np.uint64)
        )
        return np.random.Generator(stream).standard_normal((self.points, self.points))

    def _coefficients(self, knot: int) -> Floats:
        """Return the spline coefficients of a knot; knots come in turn, so a run that goes on has the same digits."""
        if knot not in self._known:
            if self._white is None or knot < self._knot:
                self._white, self._knot = self._drawn(0), 0
            keep = exp(-1.0 / KNOTS)
            for k in range(self._knot + 1, knot + 1):
                self._white = keep * self._white + math.sqrt(1.0 - keep * keep) * self._drawn(k)
            self._knot = knot
            field = np.fft.irfft2(np.fft.rfft2(self._white) * self._filter, s=(self.points, self.points))
            self._known[knot] = field
            # The means along the track ask for all knots again after the run; to draw them twice costs a tenth of a member.
            while len(self._known) > max(2, KEPT_BYTES // field.nbytes):
                del self._known[min(self._known)]
        return self._known[knot]

    def at(self, time: float) -> tuple[Floats, Floats, tuple[float, float]]:
        """Return the spline coefficients of the knots before and after a time (s), and the factor of each."""
        if math.isinf(self.error.time):
            return (first := self._coefficients(0)), first, (1.0, 0.0)
        position = max(time, 0.0) * KNOTS / self.error.time
        knot = int(position)
        right = position - knot
        first = self._coefficients(knot)
        if right == 0.0:
            return first, first, (1.0, 0.0)
        left, correlation = 1.0 - right, exp(-1.0 / KNOTS)
        # A plain mean of two fields has less variance than either.
        norm = 1.0 / math.sqrt(left * left + right * right + 2.0 * correlation * left * right)
        return first, self._coefficients(knot + 1), (norm * left, norm * right)


@kernel
def read_spline(
    first: Floats, last: Floats, factors: tuple[float, float], step: float, middle: tuple[int, int], periodic: bool,
    x: Floats, y: Floats, out: Floats,
) -> None:  # fmt: skip
    """Fill value, both first (m-1) and both second derivatives (m-2) of a cubic spline; beyond its edge the edge counts.

    ``first``, ``last``: coefficients, which count by ``factors``, the second not at all by 0; ``step``: m between points;
    ``middle``: number of the point at 0, along x and y; ``x``, ``y``: places, m; ``out``: shape (5, places).
    """
    rows, columns = first.shape
    first_factor, last_factor = factors
    wx, wy = np.zeros((3, 4)), np.zeros((3, 4))
    across = np.zeros(4, np.int64)
    for n in range(x.size):
        # The place within its cell has the same digits wherever the first point lies, as a run that goes on needs it.
        east_points, north_points = x[n] / step, y[n] / step
        i, j = math.floor(east_points), math.floor(north_points)
        for a in range(4):  # once for all rows: a remainder takes as long as all else of a coefficient
            column = int(i) + middle[0] + a - 1
            across[a] = column % columns if periodic else min(max(column, 0), columns - 1)
        for weights, t in ((wx, east_points - i), (wy, north_points - j)):
            s = 1.0 - t
            weights[0, 0], weights[0, 3] = s * s * s / 6.0, t * t * t / 6.0
            weights[0, 1], weights[0, 2] = (
                (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
                (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
            )
            weights[1, 0], weights[1, 3] = -0.5 * s * s, 0.5 * t * t
            weights[1, 1], weights[1, 2] = -2.0 * t + 1.5 * t * t, 2.0 * s - 1.5 * s * s
            weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3] = s, 3.0 * t - 2.0, 3.0 * s - 2.0, t
        value = east = north = east2 = north2 = 0.0
        for b in range(4):
            row = int(j) + middle[1] + b - 1
            row = row % rows if periodic else min(max(row, 0), rows - 1)
            s0 = s1 = s2 = 0.0
            for a in range(4):
                c = first_factor * first[row, across[a]]
                if last_factor != 0.0:
                    c += last_factor * last[row, across[a]]
                s0, s1, s2 = s0 + c * wx[0, a], s1 + c * wx[1, a], s2 + c * wx[2, a]
            value, east, east2 = value + s0 * wy[0, b], east + s1 * wy[0, b], east2 + s2 * wy[0, b]
            north, north2 = north + s0 * wy[1, b], north2 + s0 * wy[2, b]
        out[0, n], out[1, n], out[2, n] = value, east / step, north / step
        out[3, n], out[4, n] = east2 / step**2, north2 / step**2


@kernel
def onto_plane(lon: Floats, lat: Floats, lon0: float, lat0: float, sphere: bool, out: Floats) -> Ends:
    """Fill x, y (m), metres of the plane per metre, and cosine and sine of the angle at which local east lies on it.

    That of `riftberg.plane.ConformalPlane`, all in one, for it is asked in each step; the last two by the half-angles of the
    triangle of both places and the pole. Positions are metres unless on a ``sphere``. Returns least and largest x and y.
    ``out``: shape (5, places).
    """
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    sine0, cosine0 = sin(lat0 * DEGREE), cos(lat0 * DEGREE)
    for n in range(lon.size):
        x, y, scale, cosine, sine = lon[n] - lon0, lat[n] - lat0, 1.0, 1.0, 0.0
        if sphere:
            s, c = sin(lat[n] * DEGREE), cos(lat[n] * DEGREE)
            sine_a, cosine_a = sin(x * DEGREE), cos(x * DEGREE)
            denominator = 1.0 + sine0 * s + cosine0 * c * cosine_a
            scale = 2.0 / denominator
            x = EARTH_RADIUS_A68 * scale * c * sine_a
            y = EARTH_RADIUS_A68 * scale * (cosine0 * s - sine0 * c * cosine_a)
            cosine = (cosine_a * (1.0 + sine0 * s) + cosine0 * c) / denominator
            sine = sine_a * (s + sine0) / denominator
        out[0, n], out[1, n], out[2, n], out[3, n], out[4, n] = x, y, scale, cosine, sine
        west, south, east, north = min(west, x), min(south, y), max(east, x), max(north, y)
    return west, south, east, north


@kernel
def balanced_flow(
    level: Floats, factor: Floats, projected: Floats, lat: Floats, start: float, sphere: bool, out: Floats
) -> None:
    """Fill the flow of the error's stream function: u, v (m s-1), vorticity (s-1), and both slopes that balance it.

    ``level``: of the stream function at the latitude of the start, and ``factor`` of its envelope (no point
    where there is none), as `read_spline` fills them; ``projected``: as `onto_plane` fills it; ``lat``: degrees; ``start``: the
    Coriolis parameter of the start; it holds everywhere unless on a ``sphere``. ``out``: shape (5, places).
    """
    least = 2.0 * EARTH_ROTATION * sin(EQUATOR * DEGREE)
    for n in range(lat.size):
        value, x, y, curve = level[0, n], level[1, n], level[2, n], level[3, n] + level[4, n]
        if factor.shape[1]:
            # The level itself is brought to zero, so that the current along the shore stays balanced.
            t, t_x, t_y = factor[0, n], factor[1, n], factor[2, n]
            curve = t * curve + 2.0 * (t_x * x + t_y * y) + value * (factor[3, n] + factor[4, n])
            x, y = t * x + value * t_x, t * y + value * t_y
        scale, cosine, sine = projected[2, n], projected[3, n], projected[4, n]
        east, north = cosine * x + sine * y, cosine * y - sine * x
        # The field is the stream function at the start's latitude: eta = F psi / g, and there u = -d(psi)/dy.
        f = 2.0 * EARTH_ROTATION * sin(lat[n] * DEGREE) if sphere else start
        ratio = max(abs(start), least) / max(abs(f), least) if sphere else 1.0
        u, v, turn = -ratio * scale * north, ratio * scale * east, ratio * scale**2 * curve
        if sphere and abs(f) > least:
            # d(1/F)/dy turns the zonal flow: F grows poleward.
            turn += 2.0 * EARTH_ROTATION * cos(lat[n] * DEGREE) / EARTH_RADIUS_A68 * u / f
        out[0, n], out[1, n], out[2, n], out[3, n], out[4, n] = u, v, turn, f * v / GRAVITY, -f * u / GRAVITY


@dataclass(frozen=True, eq=False)
class SizeField:
    """Standard deviation of an error by place, such as a product states it, on axes of longitude and latitude."""

    lon: Floats  # Degrees, rising
    lat: Floats  # Degrees, rising
    size: Floats  # (lat, lon), as a factor on the spread of `FieldError`
    source: str = ""  # File

    def at(self, lon: Floats, lat: Floats) -> Floats:
        """Return it at points, linear between the points of the product; beyond its edge the edge counts."""
        from scipy.interpolate import RegularGridInterpolator

        middle = 0.5 * (self.lon[0] + self.lon[-1])
        east = np.clip(middle + (lon - middle + 180.0) % 360.0 - 180.0, self.lon[0], self.lon[-1])
        points = np.stack([np.clip(lat, self.lat[0], self.lat[-1]), east], axis=-1)
        return np.asarray(RegularGridInterpolator((self.lat, self.lon), self.size)(points))


class Envelope:
    """A factor on the level of the error: from 1 at sea to 0 at land, smoothly over two lengths, times the size of the error.

    It is known in a window around the ice, and made anew where ice leaves it. The points of all windows lie on one
    grid, and land beyond the window's margin acts on no point inside, so the factor of a place is the same in each.
    """

    def __init__(self, forcing: Forcing, plane: ConformalPlane, length: float, size: SizeField | None = None) -> None:
        self.forcing, self.plane, self.size = forcing, plane, size
        self.step = 0.25 * length
        self.window = (np.inf, np.inf, -np.inf, -np.inf)  # Least and largest x and y of places that it holds, m
        self.middle = (0, 0)  # Number of the point at the middle of the plane, along x and y
        self.factor = np.empty((0, 0))  # Empty where it is 1 everywhere

    def at(self, projected: Floats, ends: Ends) -> Floats:
        """Return value and derivatives at places, as `read_spline` fills them; of no place where it is 1 everywhere.

        ``projected``, ``ends``: as `onto_plane` gives them.
        """
        if ends[0] < self.window[0] or ends[1] < self.window[1] or ends[2] > self.window[2] or ends[3] > self.window[3]:
            self._make(ends)
        out = np.empty((5, projected.shape[1] if self.factor.size else 0))
        if self.factor.size:
            read_spline(
                self.factor, self.factor, (1.0, 0.0), self.step, self.middle, False, projected[0], projected[1], out
            )
        return out

    def _make(self, ends: Ends) -> None:
        """Make the window anew: five lengths around some points, with a margin that may act on points inside."""
        from scipy.ndimage import distance_transform_edt, gaussian_filter

        lengths = 4  # points
        margin = (5 if self.size is not None else 3) * lengths
        west, south = (math.floor(end / self.step) - 5 * lengths for end in ends[:2])
        east, north = (math.ceil(end / self.step) + 5 * lengths for end in ends[2:])
        self.window = (self.step * west, self.step * south, self.step * east, self.step * north)
        axes = [np.arange(low - margin, high + margin + 1) for low, high in ((west, east), (south, north))]
        self.middle = (int(-axes[0][0]), int(-axes[1][0]))
        lon, lat = self.plane.inverse(*np.meshgrid(*(self.step * axis for axis in axes)))
        land = self.forcing.land(lon, lat)
        self.factor = np.empty((0, 0))
        if not land.any() and self.size is None:
            return
        # Over two lengths: within one, the slope of the factor would make the current along the shore stronger than at sea.
        ramp = np.ones(land.shape)
        if land.any():
            ramp = np.clip((distance_transform_edt(~land) - 0.5) / (2 * lengths), 0.0, 1.0)
        factor = ramp * ramp * (3.0 - 2.0 * ramp)
        if self.size is not None:
            # Smooth over a length: each slope of the size adds to the current in proportion to the level there.
            factor *= gaussian_filter(self.size.at(lon, lat), lengths, mode="nearest")
        self.factor = np.ascontiguousarray(factor)


@dataclass(frozen=True)
class Errors:
    """Errors of a forcing; none where left out."""

    current: FieldError | None = None
    wind: FieldError | None = None
    floor: FieldError | None = None  # Its spread is 1; the sizes are those below
    current_scale: float = 1.0  # On the current and the slope that balances it
    wind_scale: float = 1.0
    floor_offset: float = 0.0  # m
    floor_scale: float = 1.0
    floor_spread: float = 0.0  # Least standard deviation of the random depth, m
    floor_share: float = 0.0  # The same in parts of the depth; the larger of both counts
    seed: int = 1
    current_size: SizeField | None = None  # Factor on the spread of the current's error by place


class UncertainForcing(WrappedForcing):
    """A forcing with errors added to its current, wind and sea floor; all else comes from the forcing.

    Parameters
    ----------
    forcing : Forcing
        Any forcing: formula, product or dataset.
    errors : Errors
        Sizes and scales of the errors, and the seed.
    elements : Elements
        The berg at the start: the middle and the extent of the fields.
    latitude : float or None
        Latitude (degrees) of the Coriolis parameter on a plane; by default that of each place.
    latlon : bool
        Positions are degrees.
    """

    def __init__(
        self,
        forcing: Forcing,
        errors: Errors,
        elements: Elements,
        *,
        latitude: float | None = None,
        latlon: bool = True,
    ) -> None:
        self.forcing, self.errors = forcing, errors
        lon, lat = np.asarray(elements.place.lon), np.asarray(elements.place.lat)
        # Elements of one berg may lie on both sides of 180 degrees.
        lon0 = lon[0] + float(np.mean((lon - lon[0] + 180.0) % 360.0 - 180.0)) if latlon else float(lon.mean())
        self.plane = ConformalPlane(lon0, float(lat.mean()), EARTH_RADIUS_A68, latlon)
        _, (west, south, east, north) = self._project(lon, lat)
        extent = math.hypot(east - west, north - south)

        def field(error: FieldError | None, kind: str) -> RandomField | None:
            if error is None:
                return None
            return RandomField(error, seed=errors.seed, kind=kind, extent=extent, gradient=kind != "floor")

        self._current, self._wind, self._floor = (field(getattr(errors, kind), kind) for kind in _KINDS)
        self._envelope = None
        if errors.current is not None:
            self._envelope = Envelope(forcing, self.plane, errors.current.length, errors.current_size)
        self._sphere = latitude is None and latlon
        at = latitude if latitude is not None else self.plane.lat0 if latlon else 0.0
        self._start = 2.0 * EARTH_ROTATION * sin(at * DEGREE)  # s-1

    def describe(self) -> str:
        """Return the forcing and its errors in words."""
        e, texts = self.errors, []
        for word, error, factor in (("current", e.current, e.current_scale), ("wind", e.wind, e.wind_scale)):
            if factor != 1.0:
                texts.append(f"{factor:g} x {word}")
            if error is not None:
                days = "steady" if math.isinf(error.time) else f"{error.time / 86400.0:g} days"
                sized = word == "current" and e.current_size is not None
                size = f"x {e.current_size.source}" if sized and e.current_size is not None else "m/s"
                texts.append(f"{word} {error.spread:g} {size}, {error.length / 1e3:g} km, {days}")
        if e.floor_offset or e.floor_scale != 1.0:
            texts.append(f"floor {e.floor_scale:g} x depth {e.floor_offset:+g} m")
        if e.floor is not None:
            texts.append(f"floor {100.0 * e.floor_share:g} % or {e.floor_spread:g} m, {e.floor.length / 1e3:g} km")
        return f"{self.forcing.describe()}; errors (seed {e.seed}): {', '.join(texts) or 'none'}"

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `riftberg.errors.ForcingError` unless the forcing covers these elements from ``start`` to ``end`` (s)."""
        self.forcing.check(elements, start, end)

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements, with the errors added."""
        self.forcing.sample(elements, time)
        e, lat = elements.environment, elements.place.lat
        for factor, arrays in ((self.errors.current_scale, (e.uo, e.vo, e.slope_x, e.slope_y, e.vorticity)),
                               (self.errors.wind_scale, (e.ua, e.va))):  # fmt: skip
            for array in arrays if factor != 1.0 else ():
                array[:] *= factor
        projected, ends = self._project(elements.place.lon, lat)
        if self._current is not None:
            flow = self._flow(projected, ends, lat, time)
            for array, error in zip((e.uo, e.vo, e.vorticity, e.slope_x, e.slope_y), flow, strict=True):
                array += error
        if self._wind is not None:
            wind = self._wind_error(self._wind, projected, time)
            e.ua[:] += wind[0]
            e.va[:] += wind[1]
        if self._has_floor:
            e.depth[:] = self._depth_with_error(e.depth, projected)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        u, v = (self.errors.current_scale * a for a in self.forcing.currents(lon, lat, time))
        if self._current is None:
            return u, v
        shape = np.shape(lon)
        flat = np.ravel(np.asarray(lon, float)), np.ravel(np.asarray(lat, float))
        error = self._flow(*self._project(*flat), flat[1], time)
        return u + error[0].reshape(shape), v + error[1].reshape(shape)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        depth = np.asarray(self.forcing.depth(lon, lat), float)
        if not self._has_floor:
            return depth
        projected, _ = self._project(np.ravel(np.asarray(lon, float)), np.ravel(np.asarray(lat, float)))
        return self._depth_with_error(depth.ravel(), projected).reshape(depth.shape)

    def mean_errors(self, time: Floats, lon: Floats, lat: Floats) -> dict[str, float]:
        """Return the means of the errors along a track: m s-1 to the east and north, and m of depth."""
        means: dict[str, list[float]] = {}
        for t, x, y in zip(time, lon, lat, strict=True):
            projected, ends = self._project(np.array([x]), np.array([y]))
            vector_errors = []
            if self._current is not None:
                vector_errors.append(("current_error", self._flow(projected, ends, np.array([y]), float(t))))
            if self._wind is not None:
                vector_errors.append(("wind_error", self._wind_error(self._wind, projected, float(t))))
            for name, flow in vector_errors:
                means.setdefault(f"{name}_east", []).append(float(flow[0, 0]))
                means.setdefault(f"{name}_north", []).append(float(flow[1, 0]))
            if self._floor is not None:
                means.setdefault("floor_error_mean", []).append(float(self._read(self._floor, projected, 0.0)[0, 0]))
        return {name: float(np.mean(values)) for name, values in means.items()}

    @property
    def _has_floor(self) -> bool:
        return self._floor is not None or self.errors.floor_offset != 0.0 or self.errors.floor_scale != 1.0

    def _depth_with_error(self, depth: Floats, projected: Floats) -> Floats:
        e = self.errors
        changed = depth * e.floor_scale + e.floor_offset
        if self._floor is not None:
            out = self._read(self._floor, projected, 0.0)
            changed = changed + out[0] * np.maximum(e.floor_spread, e.floor_share * depth)
        # Water stays water, and land land.
        return np.asarray(np.where(np.isfinite(depth) & (depth > 0.0), np.maximum(changed, 1e-3), depth))

    def _project(self, lon: Floats, lat: Floats) -> tuple[Floats, Ends]:
        """Return points projected onto the plane, and their least and largest x and y, as `onto_plane` gives them."""
        out = np.empty((5, lon.size))
        return out, onto_plane(lon, lat, self.plane.lon0, self.plane.lat0, self.plane.latlon, out)

    def _read(self, field: RandomField, projected: Floats, time: float) -> Floats:
        """Return value and derivatives (per m) of a field at places of the plane."""
        out = np.empty((5, projected.shape[1]))
        read_spline(*field.at(time), field.step, (0, 0), True, projected[0], projected[1], out)
        return out

    def _wind_error(self, field: RandomField, projected: Floats, time: float) -> Floats:
        """Return the error of the wind, shape (2, places)."""
        _, x, y, _, _ = self._read(field, projected, time)
        _, _, scale, cosine, sine = projected
        return np.stack([scale * (sine * x - cosine * y), scale * (cosine * x + sine * y)])

    def _flow(self, projected: Floats, ends: Ends, lat: Floats, time: float) -> Floats:
        """Return the error of the current at places of the plane, as `balanced_flow` fills it."""
        assert self._current is not None
        assert self._envelope is not None
        level, factor, out = (
            self._read(self._current, projected, time),
            self._envelope.at(projected, ends),
            np.empty(projected.shape),
        )
        balanced_flow(level, factor, projected, lat, self._start, self._sphere, out)
        return out
