"""Errors of current, wind and sea floor: variance, correlation in space and time, balance, where elements sample them."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from riftberg import Iceberg, Steady
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY
from riftberg.errors import InputError
from riftberg.ocean.errors import Errors, FieldError, UncertainForcing
from riftberg.ocean.formulas import Formula

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


def drawn(errors: Errors, elements: Any, times: tuple[float, ...], base: Any = None) -> dict[str, Any]:
    """Return what the elements sample at some times."""
    forcing = UncertainForcing(base or Steady(), errors, elements)
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
        got.append(drawn(errors, elements, times, Steady(depth=2000.0)))
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


def test_slopes_are_those_of_one_level_and_the_current_hardly_diverges() -> None:
    """Around a ring the slopes add up to nothing; divergence and vorticity by differences of what elements sample."""
    h, lat = 20.0, -56.0  # so near that the knots of the splines between do not matter
    dy = h / (DEGREE * EARTH_RADIUS_A68)
    dx = dy / np.cos(lat * DEGREE)
    ratio, curl = [], []
    for seed in range(6):
        points = np.array([(-37.0 + dx, lat), (-37.0 - dx, lat), (-37.0, lat + dy), (-37.0, lat - dy), (-37.0, lat)])
        elements = Iceberg.from_points(*points.T, radius=10.0, thickness=200.0).elements
        got = {k: v[0] for k, v in drawn(Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=seed), elements, (DAY,)).items()}
        u, v = got["uo"], got["vo"]
        stretch = np.cos(np.asarray(elements.lat) * DEGREE) / np.cos(lat * DEGREE)  # meridians converge
        divergence = (u[0] - u[1] + (v * stretch)[2] - (v * stretch)[3]) / (2 * h)
        vorticity = (v[0] - v[1] - (u * stretch)[2] + (u * stretch)[3]) / (2 * h)
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


class Coast(Formula):
    """Still water east of 37 W, land west of it."""

    def add_to(self, elements: Any, time: float) -> None:
        """Add nothing."""

    def currents(self, lon: Any, lat: Any, time: float) -> Any:
        """Return still water, and nothing on land."""
        still = np.where(np.asarray(lon) < -37.0, np.nan, 0.0)
        # Land ends in the west as in the east, so that it is no edge of a product.
        return np.where(np.asarray(lon) < -39.0, 0.0, still), still


def test_the_error_fades_towards_land_and_stays_balanced() -> None:
    lon = np.array([-37.0 + 1e-6, -36.8, -34.0])  # at the shore, 12 km and 187 km off
    speeds = []
    for seed in range(30):
        elements = Iceberg.from_points(lon, np.full(3, -56.0), radius=10.0, thickness=200.0).elements
        got = drawn(Errors(FieldError(0.1, LENGTH, 3 * DAY), seed=seed), elements, (DAY,), Coast())
        speeds.append(got["uo"][0] ** 2 + got["vo"][0] ** 2)
        f = 2.0 * EARTH_ROTATION * np.sin(-56.0 * DEGREE)
        assert got["slope_y"][0] == pytest.approx(-f * got["uo"][0] / GRAVITY, rel=1e-9)
    shore, near, far = np.sqrt(np.mean(speeds, axis=0))
    assert shore < 0.02
    assert shore < near < far
    assert far == pytest.approx(0.1 * np.sqrt(2.0), rel=0.35)


def test_the_floor_is_moved_where_there_is_one() -> None:
    elements = probes()
    base = Steady(depth=1000.0)
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
    base = Steady(current=(0.3, 0.1), wind=(5.0, 0.0))
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
        UncertainForcing(Steady(), Errors(FieldError(0.1, 10.0, DAY)), probes())
