"""What elements meet in a product: twin, exactness, land, drafts, slopes and vorticity on straight, turned and skewed grids."""

from __future__ import annotations

import numpy as np
import pytest

from ocean.seas import meet, sea, within
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.errors import ForcingError
from riftberg.state import Floats
from twins.at_elements import value_at

LON, LAT = -42.0 + 0.5 * np.arange(14), -59.0 + 0.25 * np.arange(16)
LEVELS = np.array([10.0, 30.0, 70.0, 150.0])
LIMITS = np.array([0.0, 20.0, 50.0, 110.0, 190.0])  # half-way between the levels
METRE = EARTH_RADIUS_A68 * DEGREE


def turned(angle: float = 0.6, skew: float = 0.0) -> tuple[Floats, Floats]:
    """Return positions of a grid whose rows do not follow the parallels, with uneven steps."""
    x, y = np.meshgrid(0.3 * np.arange(24) + 0.05 * np.sin(np.arange(24)), 0.2 * np.arange(24))
    x = x + skew * y
    c, s = np.cos(angle), np.sin(angle)
    return -42.0 + (c * x - s * y) / 0.55, -58.0 + s * x + c * y


GRIDS = {"axes": (LON, LAT), "turned": turned(), "mirrored": turned(2.5), "skewed": turned(0.3, 0.4)}


def positions(grid: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return the positions of all points of a grid."""
    lon, lat = np.meshgrid(*grid) if grid[0].ndim == 1 else grid
    return lon, lat


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
def test_values_agree_with_the_twin_over_drafts_land_and_gaps(weight: float) -> None:
    """Current on levels, over the draft, and 0 where none is known near by; ice, 0 where a record knows none."""
    rng = np.random.default_rng(11)
    records = rng.normal(scale=0.5, size=(2, 4, LAT.size, LON.size))
    records[:, :, rng.random((LAT.size, LON.size)) < 0.4] = np.nan  # land
    records[1, :, rng.random((LAT.size, LON.size)) < 0.2] = np.nan  # known at the first time only
    records[:, 2:, rng.random((LAT.size, LON.size)) < 0.3] = np.nan  # a shallow floor
    records[:, :, :7, :6] = np.nan  # land without water near by
    lon, lat = within(LON, LAT, 300)
    draft = rng.uniform(0.5, 180.0, 300)
    forcing = sea(LON, LAT, depth=LEVELS, uo=records, vo=-records, ice_thickness=np.abs(records[:, 0]))
    e = meet(forcing, lon, lat, draft=draft, hours=weight)
    of, share = (records, weight) if weight < 1.0 else (records[[1, 1]], 0.0)  # at its very date a record counts alone
    unknown = 0
    for n in range(300):
        column, row = int((lon[n] - LON[0]) // 0.5), int((lat[n] - LAT[0]) // 0.25)
        place = (row, column), (lon[n] - LON[column]) / 0.5, (lat[n] - LAT[row]) / 0.25
        current = value_at(of, share, LIMITS, draft[n], *place, None)
        unknown += current is None
        assert e.uo[n] == pytest.approx(current or 0.0, rel=1e-8, abs=1e-12)
        assert e.vo[n] == -e.uo[n]
        thickness = value_at(np.abs(of[:, :1]), share, np.array([0.0, 1.0]), 1.0, *place, 0.0)
        assert e.ice_thickness[n] == pytest.approx(thickness, rel=1e-8, abs=1e-12)
    assert unknown >= 2


def test_a_known_value_is_not_lost_between_unknown_ones() -> None:
    """One wet point near by serves an element on land; a map shows land there."""
    field = np.full((LAT.size, LON.size), np.nan)
    field[8, 7] = 0.25
    forcing = sea(LON, LAT, uo=field, vo=field)
    lon, lat = LON[7] + np.array([0.1, -0.8, 1.1, 2.0]), LAT[8] + np.array([0.1, 0.05, 0.0, 0.0])
    np.testing.assert_allclose(meet(forcing, lon, lat).uo, [0.25, 0.25, 0.25, 0.0], rtol=1e-15)
    np.testing.assert_allclose(forcing.currents(lon, lat, 0.0)[0], [0.25, np.nan, np.nan, np.nan], rtol=1e-15)


def test_thin_ice_feels_the_surface_and_thick_ice_the_deep() -> None:
    """A surface current of 20 m: over it alone 0.5 m/s, over a draft D 0.5 * 20 / D, and less water counts for less."""
    field = np.zeros((4, LAT.size, LON.size))
    field[0] = 0.5
    lon, lat = within(LON, LAT, 50)
    draft = np.linspace(4.0, 188.0, 50)
    e = meet(sea(LON, LAT, depth=LEVELS, uo=field, vo=field), lon, lat, draft=draft)
    np.testing.assert_allclose(e.uo, 0.5 * np.minimum(1.0, 20.0 / draft), rtol=1e-12)
    field[1:] = np.nan  # the floor at 20 m
    e = meet(sea(LON, LAT, depth=LEVELS, uo=field, vo=field), lon, lat, draft=draft)
    np.testing.assert_allclose(e.uo, 0.5, rtol=1e-12)


@pytest.mark.parametrize("name", GRIDS)
def test_a_plane_is_met_exactly_and_so_are_its_slope_and_curl(name: str) -> None:
    """Whatever way the rows of the grid run: values, slope in m/m to the east and north, vorticity dv/dx - du/dy."""
    grid = GRIDS[name]
    x, y = positions(grid)
    lon, lat = within(x, y)

    def plane(a: float, b: float, lon: Floats, lat: Floats) -> Floats:
        return 0.1 + a * (lon + 40.0) + b * (lat + 56.0)

    def records(a: float, b: float) -> Floats:
        return np.array([1.0, 3.0])[:, None, None] * plane(a, b, x, y)

    forcing = sea(*grid, uo=records(0.02, 0.03), vo=records(0.05, 0.01), ssh=records(0.02, 0.03))
    e = meet(forcing, lon, lat, hours=0.25)  # 1.5 times the first record
    np.testing.assert_allclose(e.uo, 1.5 * plane(0.02, 0.03, lon, lat), atol=1e-12)
    np.testing.assert_allclose(e.vo, 1.5 * plane(0.05, 0.01, lon, lat), atol=1e-12)
    narrow = np.cos(lat * DEGREE)
    np.testing.assert_allclose(e.slope_x, 1.5 * 0.02 / (METRE * narrow), rtol=1e-9)
    np.testing.assert_allclose(e.slope_y, 1.5 * 0.03 / METRE, rtol=1e-9)
    np.testing.assert_allclose(e.vorticity, 1.5 * (0.05 / narrow - 0.03) / METRE, rtol=1e-9)


def test_a_curvilinear_grid_that_goes_round_has_cells_between_its_last_and_its_first_column() -> None:
    """They were missing: places there had the values of the columns themselves, of the nearer one."""
    lon, lat = np.arange(5.0, 365.0, 5.0), np.arange(-70.0, -50.0, 2.5)
    rng = np.random.default_rng(4)
    x, y = np.append(rng.uniform(0.0, 5.0, 60), rng.uniform(-180.0, 540.0, 60)), rng.uniform(-69.0, -53.0, 120)
    px, py = np.meshgrid(lon, lat)
    field = 0.1 * np.sin(np.deg2rad(px)) + 0.01 * py
    straight, bent = (
        meet(sea(*grid, uo=field, vo=field, ssh=field), x, y) for grid in ((lon, lat), (px, py))
    )  # fmt: skip
    assert straight.uo[:60] == pytest.approx(0.1 * np.sin(np.deg2rad(x[:60])) + 0.01 * y[:60], abs=2e-4)
    for name in ("uo", "slope_x", "slope_y", "vorticity"):
        np.testing.assert_allclose(getattr(bent, name), getattr(straight, name), rtol=1e-9, atol=1e-18, err_msg=name)


@pytest.mark.parametrize(("seam", "closed"), [(0.18, False), (0.21, True), (1.0, True), (1.45, True), (1.6, False)])
def test_a_grid_goes_round_where_its_seam_is_about_a_step_wide(seam: float, closed: bool) -> None:
    """A seam of less than a fifth of a step is a column that is given twice, one of more than one and a half a gap."""
    step = 360.0 / (60.0 + seam)
    x, y = np.meshgrid(step * np.arange(61), LAT)
    y = y + 0.01 * np.sin(5.0 * DEGREE * x)  # else its rows are the axis of latitude
    field = np.zeros(x.shape)
    field[:, -1] = 1.0  # only where the grid closes does the first column follow upon the last
    forcing, place = sea(x, y, uo=field, vo=field), step * (60.0 + 0.45 * seam)
    if seam > 1.5:
        with pytest.raises(ForcingError, match="outside of the data"):
            meet(forcing, [place], [-57.1])
    else:
        assert meet(forcing, [place], [-57.1]).uo[0] == pytest.approx(0.55 if closed else 1.0, abs=1e-3)


def test_a_grid_without_positions_along_its_edge_does_not_go_round() -> None:
    lon, lat = np.meshgrid(np.arange(0.0, 360.0, 5.0), LAT)
    field = np.zeros(lon.shape)
    meet(sea(lon, lat, uo=field, vo=field), [358.0], [-57.1])
    lon[:, 0] = np.nan
    with pytest.raises(ForcingError, match="outside of the data"):
        meet(sea(lon, lat, uo=field, vo=field), [358.0], [-57.1])


def test_the_slope_is_of_second_order_on_a_wavy_sea() -> None:
    """Half the step, a quarter of the error."""
    errors = []
    for step in (0.4, 0.2, 0.1):
        lon, lat = np.arange(-42.0, -36.0, step), np.arange(-59.0, -53.0, step)
        x, y = np.meshgrid(lon, lat)
        east, north = within(lon, lat, 400)
        e = meet(sea(lon, lat, ssh=np.sin(x) * np.cos(1.5 * y)), east, north)
        wrong_x = e.slope_x * METRE * np.cos(north * DEGREE) - np.cos(east) * np.cos(1.5 * north)
        wrong_y = e.slope_y * METRE + 1.5 * np.sin(east) * np.sin(1.5 * north)
        errors.append(np.sqrt((wrong_x**2 + wrong_y**2).mean()))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_there_is_no_slope_across_a_shore() -> None:
    level = np.ones((LAT.size, LON.size))
    level[:, :7] = np.nan
    e = meet(sea(LON, LAT, ssh=level), [LON[7] + 0.1, LON[6] + 0.1], [-57.1, -57.1])
    np.testing.assert_array_equal([e.slope_x, e.slope_y], 0.0)


def test_drift_leads_away_from_land_on_any_grid() -> None:
    grid = GRIDS["turned"]
    lon, lat = within(*grid)
    wet = grid[0] > lon.mean()
    still = np.where(wet, 0.0, np.nan)
    share = meet(sea(*grid, uo=wet * 1.0, vo=wet * 0.0), lon, lat).uo  # of the points around that are wet, by weight
    e = meet(sea(*grid, uo=still, vo=still, coastal_drift=0.1), lon, lat)
    shore, off = (share > 1e-6) & (share < 1.0 - 1e-6), share > 1.0 - 1e-6
    assert shore.sum() > 5
    assert (e.uo[shore] > 0.0).all()  # the land is in the west
    np.testing.assert_array_equal(np.hypot(e.uo, e.vo)[off], 0.0)
    assert np.hypot(e.uo, e.vo).max() <= 0.1 * np.sqrt(2.0) + 1e-12


@pytest.mark.parametrize(("apart", "held"), [(2.9, True), (3.1, False)])
def test_scattered_nodes_reach_three_of_their_distances(apart: float, held: bool) -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(20), 0.1 * np.arange(20)))
    forcing = sea(lon, lat, uo=np.full(400, 0.3), vo=np.full(400, 0.3))
    if held:
        assert meet(forcing, [1.0], [-0.1 * apart]).uo == [0.3]
    else:
        with pytest.raises(ForcingError, match="outside of the data"):
            meet(forcing, [1.0], [-0.1 * apart])


@pytest.mark.parametrize("missing", [0, 1, 4])
def test_slopes_on_scattered_nodes_come_from_the_nodes_that_are_known(missing: int) -> None:
    """One missing node of the nine near by made the slope 0."""
    rng = np.random.default_rng(0)
    lon, lat = -40.0 + rng.random(400), -56.0 + rng.random(400)
    level = 1e-6 * METRE * (lat + 56.0) + 2e-6 * METRE * np.cos(DEGREE * 55.5) * (lon + 40.0)
    near = np.argsort(np.hypot((lon + 39.5) * np.cos(DEGREE * 55.5), lat + 55.5))
    level[near[1:9:2][:missing]] = np.nan
    e = meet(sea(lon, lat, ssh=level), [-39.5], [-55.5])
    assert (e.slope_x[0], e.slope_y[0]) == pytest.approx((2e-6, 1e-6), rel=0.01)


def test_three_nodes_nearly_on_a_line_tell_no_slope_across_it() -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(3), 0.1 * np.arange(3)))
    lat = lat + 1e-3 * (np.arange(9) % 2)
    level = np.full(9, np.nan)
    level[3:6] = [0.0, 1e-3, 0.0]  # noise of a millimetre
    e = meet(sea(lon, lat, ssh=level), [0.1], [0.1])
    assert np.hypot(e.slope_x[0], e.slope_y[0]) < 1e-7


def test_where_no_node_is_known_the_sea_is_level() -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(9), 0.1 * np.arange(9)))
    level = np.where(lon > 0.55, lon, np.nan)
    e = meet(sea(lon, lat, ssh=level), [0.2], [0.2])
    assert (e.slope_x[0], e.slope_y[0]) == (0.0, 0.0)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_places_within_half_a_step_of_the_edge_have_the_value_of_the_edge(angle: float) -> None:
    """The field is not continued beyond its points; farther out there is nothing."""
    lon, lat = turned(angle)
    field = 0.01 * (lon + 2.0 * lat)
    forcing = sea(lon, lat, uo=field, vo=field)
    for edge, inner in (((0, 9), (1, 9)), ((-1, 9), (-2, 9)), ((9, 0), (9, 1)), ((9, -1), (9, -2))):
        for part, known in ((0.3, True), (0.8, False)):
            x, y = (np.array([q[edge] + part * (q[edge] - q[inner])]) for q in (lon, lat))
            if known:
                assert meet(forcing, x, y).uo[0] == pytest.approx(field[edge], abs=1e-9)
            else:
                with pytest.raises(ForcingError, match="outside of the data"):
                    meet(forcing, x, y)
