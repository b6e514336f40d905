"""Currents over the draft of each element: law, twin, units, scaling, invariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.errors import ForcingError
from riftberg.ocean.grid import Grid
from riftberg.ocean.gridded import GriddedForcing
from riftberg.ocean.over_draft import Columns, DraftCurrents
from riftberg.state import Elements, Floats

LIMITS = np.array([0.0, 20.0, 50.0, 110.0, 190.0])
DENSITY = 850.0
DAY = 86400.0


@pytest.fixture
def grid() -> Grid:
    lon, lat = -41.0 + 0.25 * np.arange(1, 17), -57.0 + 0.25 * np.arange(1, 13)
    return Grid.from_corners(*np.meshgrid(lon, lat))


@pytest.fixture
def elements(grid: Grid) -> Elements:
    """Elements of many thicknesses, at known cells."""
    e = Iceberg.rectangle(30e3, 12e3, thickness=200.0, placement=(-39.0, -55.5)).elements
    e.thickness[:] = np.linspace(5.0, 225.0, e.thickness.size)
    grid.locate(e)
    return e


def column_fields(grid: Grid, seed: int) -> Columns:
    """Random layers, some of them below the sea floor, some columns without water."""
    rng = np.random.default_rng(seed)
    shape = (LIMITS.size - 1, *grid.arrays.mask.shape)
    layers = rng.integers(1, LIMITS.size, shape[1:])
    layers[rng.random(shape[1:]) < 0.1] = 0
    wet = (np.arange(LIMITS.size - 1)[:, None, None] < layers) * np.diff(LIMITS)[:, None, None]
    u, v = rng.normal(0.0, 0.3, (2, *shape)) * wet
    padded = [np.concatenate([np.zeros((1, *shape[1:])), a.cumsum(axis=0)]) for a in (u, v, wet.astype(float))]
    return Columns(*padded)


def forcing_of(grid: Grid, records: list[Columns], times: list[float] | None = None) -> GriddedForcing:
    over = DraftCurrents(LIMITS, lambda k: records[k], DENSITY, 100.0)
    fields = [grid.fields(**dict(zip(("uo", "vo"), over.at_nominal(k), strict=True))) for k in range(len(records))]
    return GriddedForcing(grid, fields if times else fields[0], times, over_draft=over)


def plain(
    grid: Grid, e: Elements, n: int, before: Columns, after: Columns, weight: float
) -> tuple[float, float, float]:
    """Twin: layer by layer, corner by corner."""
    keel = e.thickness[n] * DENSITY / 1025.0
    corner = {}
    for name, (j, i) in {"ne": (0, 0), "nw": (0, -1), "se": (-1, 0), "sw": (-1, -1)}.items():
        at = e.cell_j[n] + j, e.cell_i[n] + i
        total_u = total_v = water = 0.0
        for layer in range(LIMITS.size - 1):
            share = min(max(keel - LIMITS[layer], 0.0) / (LIMITS[layer + 1] - LIMITS[layer]), 1.0)
            for columns, part in ((before, 1.0 - weight), (after, weight)):
                step = [a[layer + 1][at] - a[layer][at] for a in columns]
                total_u, total_v, water = (
                    old + part * share * new for old, new in zip((total_u, total_v, water), step, strict=True)
                )
        corner[name] = (total_u / water, total_v / water) if water > 0.0 else (0.0, 0.0)
    x, y = e.xi[n], e.eta[n]
    u, v = (
        y * (x * corner["ne"][c] + (1 - x) * corner["nw"][c])
        + (1 - y) * (x * corner["se"][c] + (1 - x) * corner["sw"][c])
        for c in (0, 1)
    )
    g, (j, i) = grid.arrays, (e.cell_j[n], e.cell_i[n])
    turn = (
        y * (corner["ne"][1] - corner["nw"][1]) / g.dx[j, i]
        + (1 - y) * (corner["se"][1] - corner["sw"][1]) / g.dx[j - 1, i]
    )
    turn -= (
        x * (corner["ne"][0] - corner["se"][0]) / g.dy[j, i]
        + (1 - x) * (corner["nw"][0] - corner["sw"][0]) / g.dy[j, i - 1]
    )
    return u, v, turn


@pytest.mark.parametrize("weight", [0.0, 0.3])
def test_each_element_gets_the_mean_over_its_own_draft(grid: Grid, elements: Elements, weight: float) -> None:
    records = [column_fields(grid, seed) for seed in (1, 2)]
    forcing_of(grid, records, [0.0, DAY]).sample(elements, weight * DAY)
    for n in range(elements.id.size):
        u, v, turn = plain(grid, elements, n, *records, weight)
        assert elements.uo[n] == pytest.approx(u, rel=1e-12, abs=1e-15)
        assert elements.vo[n] == pytest.approx(v, rel=1e-12, abs=1e-15)
        assert elements.vorticity[n] == pytest.approx(turn, rel=1e-9, abs=1e-18)


def uniform_with_depth(grid: Grid, profile: Floats) -> Columns:
    """The same profile (m s-1 by layer) everywhere, water to the last limit."""
    summed = np.concatenate([[0.0], np.cumsum(profile * np.diff(LIMITS))])
    shape = grid.arrays.mask.shape
    u, wet = (np.broadcast_to(a[:, None, None], (LIMITS.size, *shape)).copy() for a in (summed, LIMITS))
    return Columns(u, -2.0 * u, wet)


def test_thin_ice_feels_the_surface_and_thick_ice_the_deep(grid: Grid, elements: Elements) -> None:
    """A surface current of 20 m: over it alone 0.5 m/s, over a draft D 0.5 * 20 / D."""
    forcing_of(grid, [uniform_with_depth(grid, np.array([0.5, 0.0, 0.0, 0.0]))]).sample(elements, 0.0)
    draft = elements.thickness * DENSITY / 1025.0
    np.testing.assert_allclose(elements.uo, 0.5 * np.minimum(1.0, 20.0 / draft), rtol=1e-12)
    np.testing.assert_allclose(elements.vo, -2.0 * elements.uo, rtol=1e-12)  # each component by itself
    np.testing.assert_allclose(elements.vorticity, 0.0, atol=1e-18)


def test_one_draft_for_all_is_the_nominal_field(grid: Grid, elements: Elements) -> None:
    """With the nominal draft the elements get what the plain fields give."""
    elements.thickness[:] = 100.0 * 1025.0 / DENSITY
    records = [column_fields(grid, 4)]
    with_levels = forcing_of(grid, records)
    with_levels.sample(elements, 0.0)
    found = elements.uo.copy(), elements.vo.copy(), elements.vorticity.copy()
    with_levels.over_draft = None
    with_levels.sample(elements, 0.0)
    for ours, theirs in zip(found, (elements.uo, elements.vo, elements.vorticity), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-18)


def test_current_scales_and_the_order_of_elements_does_not_matter(grid: Grid, elements: Elements) -> None:
    columns = column_fields(grid, 5)
    forcing_of(grid, [columns]).sample(elements, 0.0)
    once = elements.uo.copy()
    forcing_of(grid, [Columns(3.0 * columns.u, 3.0 * columns.v, columns.wet)]).sample(elements, 0.0)
    np.testing.assert_allclose(elements.uo, 3.0 * once, rtol=1e-12)
    for name in ("lon", "lat", "thickness", "cell_i", "cell_j", "xi", "eta"):
        getattr(elements, name)[:] = getattr(elements, name)[::-1].copy()
    forcing_of(grid, [columns]).sample(elements, 0.0)
    np.testing.assert_array_equal(elements.uo, once[::-1])


def test_a_keel_below_the_levels_is_refused_before_the_run(grid: Grid, elements: Elements) -> None:
    elements.thickness[7] = 300.0
    forcing = forcing_of(grid, [column_fields(grid, 6)])
    with pytest.raises(ForcingError, match=rf"element {elements.id[7]} has a draft of 249 m.*end at 190 m"):
        forcing.check(elements, 0.0, DAY)
    assert "mean over the draft of each element" in forcing.describe()
    assert math.isclose(forcing.over_draft.nominal if forcing.over_draft else 0.0, 100.0)
