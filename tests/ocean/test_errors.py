"""Errors of current, wind and sea floor: variance, correlation in space and time, balance, where elements sample them."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Forcing, Iceberg
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY
from riftberg.errors import InputError
from riftberg.ocean.errors import Errors, FieldError, UncertainForcing, onto_plane
from riftberg.plane import ConformalPlane

DAY = 86400.0
LENGTH = 50e3


def probes(lat: float = -56.0, distances: tuple[float, ...] = (0.0, LENGTH, 2 * LENGTH)) -> Any:
    """Return elements at odd places: along a parallel, and then along a meridian."""
    degree = DEGREE * EARTH_RADIUS_A68
    east = [(-37.0 + d / degree / np.cos(lat * DEGREE), lat) for d in distances]
    north = [(-37.0, lat + d / degree) for d in distances[1:]]
    points = np.array(east + north) + 0.0137
    berg = Iceberg.from_points(*points.T, radius=10.0, thickness=200.0)
    return berg.elements


def drawn(
    errors: Errors, elements: Any, times: tuple[float, ...], base: Any = None, start: Any = None
) -> dict[str, Any]:
    """Return what the elements sample at some times; ``start``: where they were at the start."""
    forcing = UncertainForcing(base or Forcing.uniform(), errors, elements if start is None else start)
    got: dict[str, list[Any]] = {
        name: [] for name in ("uo", "vo", "ua", "va", "slope_x", "slope_y", "vorticity", "depth")
    }
    for time in times:
        forcing.sample(elements, time)
        for name, values in got.items():
            values.append(getattr(elements.environment, name).copy())
    return {name: np.array(values) for name, values in got.items()}


def many(count: int, times: tuple[float, ...]) -> dict[str, Any]:
    """Return draws at the probes, shape (draws, times, elements)."""
    elements = probes()
    got = []
    for seed in range(count):
        errors = Errors(
            FieldError(0.1, LENGTH, 3 * DAY),
            FieldError(2.0, 300e3, DAY),
            FieldError(1.0, 20e3),
            floor_spread=30.0,
            seed=seed,
        )
        got.append(drawn(errors, elements, times, Forcing.uniform(depth=2000.0)))
    return {name: np.array([g[name] for g in got]) for name in got[0]}


def check_statistics(got: dict[str, Any], tolerance: float, correlation: float) -> None:
    """Check what the draws have in common against the formulas of a Gaussian field.

    ``tolerance``: of a variance, relative; ``correlation``: of a correlation.
    """
    u, v = got["uo"], got["vo"]
    # The middle of a length of time too, where fields are blended.
    assert (u[:, :, 0].var(axis=0) / 0.01) == pytest.approx(1.0, rel=tolerance)
    assert (v[:, :, 0].var(axis=0) / 0.01) == pytest.approx(1.0, rel=tolerance)
    assert (got["ua"][:, :, 0].var(axis=0) / 4.0) == pytest.approx(1.0, rel=tolerance)
    assert (got["va"][:, :, 0].var(axis=0) / 4.0) == pytest.approx(1.0, rel=tolerance)
    assert (got["depth"][:, 0] - 2000.0).var(axis=0) / 900.0 == pytest.approx(1.0, rel=tolerance)

    def related(a: Any, b: Any) -> float:
        return float(np.mean(a * b) / np.sqrt(np.mean(a * a) * np.mean(b * b)))

    # Along a velocity the correlation is exp(-r2 / 2 L2), across it (1 - r2 / L2) times that.
    for place, ratio in ((1, 1.0), (2, 2.0)):
        along, across = np.exp(-0.5 * ratio**2), (1.0 - ratio**2) * np.exp(-0.5 * ratio**2)
        assert related(u[:, 0, 0], u[:, 0, place]) == pytest.approx(along, abs=correlation)
        assert related(v[:, 0, 0], v[:, 0, place]) == pytest.approx(across, abs=correlation)
        assert related(v[:, 0, 0], v[:, 0, place + 2]) == pytest.approx(along, abs=correlation)
        assert related(u[:, 0, 0], u[:, 0, place + 2]) == pytest.approx(across, abs=correlation)
    # After one time scale 1 / e is left.
    assert related(u[:, 0, 0], u[:, -1, 0]) == pytest.approx(np.exp(-1.0), abs=correlation)
    assert related(u[:, 0, 0], v[:, 0, 0]) == pytest.approx(0.0, abs=correlation)


TIMES = (0.4 * DAY, 0.4 * DAY + 3 * DAY / 16, 3.4 * DAY)


@pytest.mark.slow
def test_some_hundred_draws_have_the_spread_and_scales_asked_for() -> None:
    check_statistics(many(400, TIMES), 0.25, 0.17)


@pytest.mark.slow
def test_ten_thousand_draws_have_the_spread_and_scales_asked_for() -> None:
    check_statistics(many(10_000, TIMES), 0.05, 0.035)


@pytest.mark.parametrize("lat", [-56.0, 56.0, -30.0, 3.0])
def test_the_current_is_in_balance_with_its_sea_level(lat: float) -> None:
    elements = probes(lat)
    got = drawn(Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=4), elements, (DAY,))
    f = 2.0 * EARTH_ROTATION * np.sin(np.asarray(elements.lat) * DEGREE)
    assert np.abs(got["uo"]).max() > 0.02
    assert got["slope_x"][0] == pytest.approx(f * got["vo"][0] / GRAVITY, rel=1e-12)
    assert got["slope_y"][0] == pytest.approx(-f * got["uo"][0] / GRAVITY, rel=1e-12)


@pytest.mark.parametrize("start", [(-37.0, -56.0), (-5.0, -62.0)])
def test_slopes_are_those_of_one_level_and_the_current_hardly_diverges(start: tuple[float, float]) -> None:
    """Around a ring the slopes add up to nothing; divergence and vorticity by differences of what elements sample.

    Also where ice has drifted far, and the plane of the fields is turned against north.
    """
    begun = Iceberg.from_points([start[0]], [start[1]], radius=10.0, thickness=200.0).elements
    h, lat = 20.0, -56.0  # so near that the knots of the splines between do not matter
    dy = h / (DEGREE * EARTH_RADIUS_A68)
    dx = dy / np.cos(lat * DEGREE)
    ratio, curl = [], []
    for seed in range(6):
        points = np.array([(-37.0 + dx, lat), (-37.0 - dx, lat), (-37.0, lat + dy), (-37.0, lat - dy), (-37.0, lat)])
        elements = Iceberg.from_points(*points.T, radius=10.0, thickness=200.0).elements
        errors = Errors(FieldError(0.1, LENGTH, 3 * DAY), FieldError(2.0, 300e3, DAY), seed=seed)
        got = {k: v[0] for k, v in drawn(errors, elements, (DAY,), start=begun).items()}
        u, v = got["uo"], got["vo"]
        stretch = np.cos(np.asarray(elements.lat) * DEGREE) / np.cos(lat * DEGREE)  # meridians converge
        divergence = (u[0] - u[1] + (v * stretch)[2] - (v * stretch)[3]) / (2 * h)
        vorticity = (v[0] - v[1] - (u * stretch)[2] + (u * stretch)[3]) / (2 * h)
        wind = got["ua"][0] - got["ua"][1] + (got["va"] * stretch)[2] - (got["va"] * stretch)[3]
        assert abs(wind / (2 * h)) < 1e-4 * 2.0 / 300e3  # that of the air has none at all
        assert got["vorticity"][4] == pytest.approx(vorticity, rel=2e-3, abs=2e-9)
        beta = 2.0 * EARTH_ROTATION * np.cos(lat * DEGREE) / EARTH_RADIUS_A68
        f = 2.0 * EARTH_ROTATION * np.sin(lat * DEGREE)
        assert divergence == pytest.approx(-beta * v[4] / f, rel=0.05, abs=2e-10)
        ratio.append((divergence**2, vorticity**2))
        sx, sy = got["slope_x"], got["slope_y"]
        curl.append((sy[0] - sy[1] - (sx * stretch)[2] + (sx * stretch)[3]) / (2 * h) / np.hypot(sx[4], sy[4]) * LENGTH)
    d, z = np.sqrt(np.mean(ratio, axis=0))
    assert d < 0.01 * z
    assert np.abs(curl).max() < 1e-3


def test_at_the_equator_the_current_has_no_level_and_no_jump() -> None:
    lat = np.array([-0.02, 0.0, 0.02])
    elements = Iceberg.from_points(np.full(3, -37.0), lat, radius=10.0, thickness=200.0).elements
    got = drawn(Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=2), elements, (DAY,))
    assert np.hypot(got["uo"], got["vo"]).min() > 0.01
    assert got["uo"][0, 0] == pytest.approx(got["uo"][0, 2], abs=0.01)
    assert got["slope_x"][0, 1] == 0.0
    assert got["slope_x"][0, 0] == pytest.approx(-got["slope_x"][0, 2], rel=0.1)


class Coast(Forcing):
    """Still water north of a parallel, land south of it."""

    lat = -56.0

    def add_to(self, elements: Any, time: float) -> None:
        """Add nothing."""

    def currents(self, lon: Any, lat: Any, time: float) -> Any:
        """Return still water, and nothing on land."""
        still = np.where(np.asarray(lat) < self.lat, np.nan, 0.0)
        return still, still


class Shelf(Coast):
    """The same, known by its depth alone."""

    def currents(self, lon: Any, lat: Any, time: float) -> Any:
        """Return still water everywhere."""
        return np.zeros(np.shape(lon)), np.zeros(np.shape(lon))

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the depth of water, unknown on land."""
        return np.where(np.asarray(lat) < self.lat, np.nan, 3000.0)


def coast_of_product(**more: Any) -> Any:
    """Return a forcing of currents on points half a degree apart, which end in the west; known as far as 56 S."""
    lat, lon = np.arange(-60.0, -49.9, 0.5), np.arange(-38.0, -27.9, 0.5)
    still = np.where(lat[:, None] < -55.6, np.nan, np.zeros((lat.size, lon.size)))
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    fields = {name: (("lat", "lon"), still, {"units": "m s-1", "standard_name": f"{way}_sea_water_velocity"})
              for name, way in (("uo", "eastward"), ("vo", "northward"))}  # fmt: skip
    return Forcing.from_xarray(xr.Dataset(fields, coords=axes), "2020-12-09", **more)


def sizes(base: Any, elements: Any, length: float = LENGTH, count: int = 60, **moved: Any) -> Any:
    """Return the root of the mean square of the error of the current at the elements, which may have moved since the start."""
    squares = []
    for seed in range(count):
        forcing = UncertainForcing(base, Errors(FieldError(0.1, length, 3 * DAY), seed=seed), elements)
        at = [moved.get(name, getattr(elements, name)) for name in ("lon", "lat")]
        (u, v), (own_u, own_v) = forcing.currents(*at, DAY), base.currents(*at, DAY)
        squares.append((u - own_u) ** 2 + (v - own_v) ** 2)
    return np.sqrt(np.mean(squares, axis=0))


@pytest.mark.quick(2)
@pytest.mark.parametrize("base", [Coast(), Shelf(), Coast() + Forcing.uniform(), coast_of_product()])
def test_the_error_fades_towards_land_and_stays_balanced(base: Any) -> None:
    """The coast is a parallel, so that it fills whole rows; the product ends 12 km west of the berg, where there is no land."""
    lat = np.array([-56.0 + 1e-6, -55.9, -53.0])  # at the shore, 11 km and 330 km off
    elements = Iceberg.from_points(np.full(3, -37.8), lat, radius=10.0, thickness=200.0).elements
    shore, near, far = sizes(base, elements)
    assert shore < 0.02
    assert shore < near < far
    assert far == pytest.approx(0.1 * np.sqrt(2.0), rel=0.2)
    forcing = UncertainForcing(base, Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=2), elements)
    forcing.sample(elements, DAY)
    e, f = elements.environment, 2.0 * EARTH_ROTATION * np.sin(lat * DEGREE)
    assert e.slope_y == pytest.approx(-f * e.uo / GRAVITY, rel=1e-9)


def test_a_coast_that_comes_up_later_counts_as_one_at_the_start() -> None:
    """Ice may drift by more than ten lengths; the coast there is that of a run that starts beside it."""
    length, e = (
        5e3,
        Iceberg.from_points(np.full(2, -37.0), np.array([-53.0, -53.001]), radius=10.0, thickness=200.0).elements,
    )
    later = {"lon": np.full(2, -36.0), "lat": np.array([-56.0 + 1e-6, -55.0])}
    shore, sea = sizes(Coast(), e, length, **later)
    assert shore < 0.02
    assert sea == pytest.approx(0.1 * np.sqrt(2.0), rel=0.2)
    errors = Errors(FieldError(0.1, length, 3 * DAY), seed=3)
    places = np.full(2, -36.0), np.array([-55.951, -55.95])
    start = Iceberg.from_points(*places, radius=10.0, thickness=200.0).elements
    again = UncertainForcing(Coast(), errors, start).currents(*places, DAY)  # as a run that goes on
    for first in np.arange(-55.75, -55.94, -0.0137):  # by way of another window
        gone_on = UncertainForcing(Coast(), errors, start)
        gone_on.currents(np.full(2, -36.0), np.full(2, first), DAY)
        assert np.array_equal(gone_on.currents(*places, DAY), again)


@pytest.mark.parametrize("base", [Coast(), coast_of_product()])
def test_the_edge_of_a_product_is_no_coast(base: Any) -> None:
    elements = Iceberg.from_points([-37.9, -34.0], [-52.0, -52.0], radius=10.0, thickness=200.0).elements
    assert sizes(base, elements) == pytest.approx(0.1 * np.sqrt(2.0), rel=0.2)


PLACES = {"date line": (179.95, -56.0), "75 S": (-37.0, -75.0), "80 N": (10.0, 80.0), "88.5 S": (0.0, -88.5)}
CASES = {name: (place, 0.0) for name, place in {**PLACES, "equator": (-37.0, 0.2)}.items()}
CASES |= {f"{name}, drifted": (place, 12.0) for name, place in PLACES.items()}


def around(lon: float, lat: float, distance: float, turn: float = 0.3) -> Any:
    """Return a place and four around it, east, north, west and south of it and a little turned."""
    directions = turn + 0.5 * np.pi * np.arange(4)
    x, y = (np.append(0.0, distance * part(directions)) for part in (np.cos, np.sin))
    return ConformalPlane(lon, lat, EARTH_RADIUS_A68).inverse(x, y)


@pytest.mark.quick(3)
@pytest.mark.parametrize("count", [150, pytest.param(3000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("place", "far"), CASES.values(), ids=CASES.keys())
def test_size_and_scale_are_those_asked_for_wherever_the_ice_is(
    place: tuple[float, float], far: float, count: int
) -> None:
    """Against a sum of waves of another kind, and ``far`` degrees equatorward of the start, to which ice has drifted.

    There the error has grown as 1 / f, and its length has stayed.
    """
    own = (place[0] + np.array([0.0, 0.1]) + 180.0) % 360.0 - 180.0  # on both sides of the date line
    start = Iceberg.from_points(own, np.full(2, place[1]), radius=10.0, thickness=200.0).elements
    lon, lat = around(place[0], place[1] - np.sign(place[1]) * far, LENGTH)
    got = []
    for seed in range(count):
        forcing = UncertainForcing(Forcing.uniform(), Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=seed), start)
        got.append(forcing.currents(lon, lat, DAY))
    u, v = np.moveaxis(np.array(got), 1, 0)
    # Vectors at the places around, turned to east and north of the one in the middle.
    turn = ConformalPlane(float(lon[0]), float(lat[0]), EARTH_RADIUS_A68).eastward(lon, lat)
    u, v = u * np.cos(turn) - v * np.sin(turn), u * np.sin(turn) + v * np.cos(turn)
    least = 2.0 * EARTH_ROTATION * np.sin(5.0 * DEGREE)
    f = np.maximum(np.abs(2.0 * EARTH_ROTATION * np.sin(np.array([place[1], lat[0]]) * DEGREE)), least)
    spread = 0.1 * f[0] / f[1]
    noise = 1.0 / np.sqrt(count)
    assert np.std(u, axis=0) == pytest.approx(spread, rel=3 * noise + 0.02)
    assert np.std(v, axis=0) == pytest.approx(spread, rel=3 * noise + 0.02)
    expected = waves(around(0.0, 0.0, LENGTH), 40_000)
    for one, other in ((0, 0), (0, 1), (1, 1)):
        mean = np.mean((u, v)[one][:, :1] * (u, v)[other], axis=0) / spread**2
        assert mean == pytest.approx(expected[one, other], abs=4 * noise + 0.03)


def test_the_plane_of_the_fields_is_the_conformal_one() -> None:
    rng = np.random.default_rng(2)
    lon, lat, out = rng.uniform(-180.0, 180.0, 50), rng.uniform(-89.0, 60.0, 50), np.empty((5, 50))
    for at in ((170.0, -70.0), (3.0, -89.0), (0.0, 0.0)):
        ends = onto_plane(lon, lat, *at, True, out)
        plane = ConformalPlane(*at, EARTH_RADIUS_A68)
        east, expected = plane.eastward(lon, lat), np.stack([*plane.forward(lon, lat), plane.scale(lon, lat)])
        assert out[:3] == pytest.approx(expected, rel=1e-9, abs=1e-3)
        assert out[3:] == pytest.approx(np.stack([np.cos(east), np.sin(east)]), abs=1e-9)
        assert ends == pytest.approx((*out[:2].min(axis=1), *out[:2].max(axis=1)))
    onto_plane(lon, lat, 3.0, 5.0, False, out)
    assert (out[:, 0] == [lon[0] - 3.0, lat[0] - 5.0, 1.0, 1.0, 0.0]).all()


def waves(places: Any, count: int) -> Any:
    """Return the correlations of the current at the first place with that at all, shape (2, 2, places), from a sum of waves.

    Each wave has a random vector from the spectrum of exp(-r2 / 2 L2): no grid, no FFT and no spline.
    """
    rng = np.random.default_rng(5)
    k = rng.normal(0.0, 1.0 / LENGTH, (count, 2))
    x, y = ConformalPlane(0.0, 0.0, EARTH_RADIUS_A68).forward(*places)
    phase = np.cos(k[:, :1] * (x - x[0]) + k[:, 1:] * (y - y[0]))
    flow = np.stack([-k[:, 1], k[:, 0]])  # u, v of a wave of the stream function
    return np.einsum("in,jn,np->ijp", flow, flow, phase) / count * LENGTH**2


def test_the_floor_is_moved_where_there_is_one() -> None:
    elements = probes()
    base = Forcing.uniform(depth=1000.0)
    got = drawn(Errors(floor_offset=-50.0, floor_scale=1.2), elements, (0.0,), base)
    assert got["depth"][0] == pytest.approx(1150.0)
    forcing = UncertainForcing(
        base, Errors(floor=FieldError(1.0, 20e3), floor_spread=30.0, floor_share=0.1, seed=3), elements
    )
    forcing.sample(elements, 0.0)
    assert forcing.depth(elements.lon, elements.lat) == pytest.approx(elements.environment.depth)
    depths = []
    for seed in range(100):
        errors = Errors(floor=FieldError(1.0, 20e3), floor_spread=30.0, floor_share=0.1, seed=seed)
        depths.append(drawn(errors, elements, (0.0,), base)["depth"])
    spread = np.std(depths)
    assert spread == pytest.approx(100.0, rel=0.15)


def test_all_else_is_that_of_the_forcing_and_a_copy_goes_on_alike() -> None:
    elements = probes()
    base = Forcing.uniform(current=(0.3, 0.1), wind=(5.0, 0.0), slope=(0.0, 0.0))
    forcing = UncertainForcing(base, Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=6), elements)
    assert forcing.grid is None
    assert "errors (seed 6): current 0.1 m/s, 50 km, 3 days" in forcing.describe()
    with pytest.raises(AttributeError):
        forcing.no_such_thing  # noqa: B018
    later = 5 * DAY
    forcing.sample(elements, later)
    first = elements.environment.uo.copy()
    u, v = forcing.currents(elements.lon, elements.lat, later)
    assert u == pytest.approx(first)
    assert v == pytest.approx(elements.environment.vo)
    assert (elements.environment.ua == 5.0).all()
    for again in (pickle.loads(pickle.dumps(forcing)), copy.deepcopy(forcing)):
        again.sample(elements, 0.0)
        again.sample(elements, later)
        assert (elements.environment.uo == first).all()
    fresh = UncertainForcing(base, forcing.errors, probes())
    fresh.sample(elements, later)  # as after a restart: straight to a later time
    assert (elements.environment.uo == first).all()


def test_scales_far_smaller_than_the_berg_are_refused() -> None:
    with pytest.raises(InputError, match="an error with a length of 10 m under ice"):
        UncertainForcing(Forcing.uniform(), Errors(FieldError(0.1, 10.0, DAY)), probes())
