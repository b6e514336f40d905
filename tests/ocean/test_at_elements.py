"""Sampling at the elements: twin, exactness, land, drafts, slopes and vorticity on straight, turned and skewed grids."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.ocean.product_records import (
    NO_RINGS,
    ONLY_FIELD,
    RINGS,
    Blend,
    Wanted,
    add_shore_drift,
    fill_slopes,
    fill_vorticity,
    values_at,
)
from riftberg.plane import unit_vectors
from riftberg.products.mesh import AxesMesh, CurvilinearMesh, Mesh, NodeMesh, Places, goes_round_in_x
from riftberg.state import Floats
from twins.at_elements import value_at

LON, LAT = -42.0 + 0.5 * np.arange(14), -59.0 + 0.25 * np.arange(16)
LIMITS = np.array([0.0, 20.0, 50.0, 110.0, 190.0])


def places_on(mesh: Mesh, count: int = 200, seed: int = 3) -> tuple[Floats, Floats, Places]:
    """Return positions well within a mesh, and their places."""
    rng = np.random.default_rng(seed)
    points = mesh.points
    low, high = np.nanquantile(points.lon, [0.25, 0.75]), np.nanquantile(points.lat, [0.25, 0.75])
    lon, lat = rng.uniform(*low, count), rng.uniform(*high, count)
    places = mesh.locate(lon, lat)
    assert (places.row >= 0).all()
    return lon, lat, places


def turned(angle: float = 0.6, skew: float = 0.0) -> CurvilinearMesh:
    """Return a mesh whose rows do not follow the parallels, with uneven steps."""
    x, y = np.meshgrid(0.3 * np.arange(24) + 0.05 * np.sin(np.arange(24)), 0.2 * np.arange(24))
    x = x + skew * y
    c, s = np.cos(angle), np.sin(angle)
    return CurvilinearMesh(-42.0 + (c * x - s * y) / 0.55, -58.0 + s * x + c * y)


def values(blend: Blend, places: Places, draft: Floats | float = 1.0, near: np.ndarray = RINGS) -> Floats:
    over = np.full(places.row.size, draft)
    return values_at(blend, places, 0, Wanted.of((0, True, np.nan)), draft=over, rings=near)[0]


def corners_of(blend: Blend, places: Places) -> Floats:
    """Return the values of all fields of a blend at the corners of cells."""
    count = blend.absent.size
    corners = np.empty((count, 4, places.row.size))
    values_at(blend, places, 0, Wanted.of(*((k, False, np.nan) for k in range(count))), corners=corners)
    return corners


def stacked(*blends: Blend) -> Blend:
    """Return fields without levels in one blend."""
    before, after = (np.concatenate(records) for records in zip(*((b.before, b.after) for b in blends), strict=True))
    count = len(blends)
    return blends[0]._replace(before=before, after=after, bounds=np.arange(count + 1), absent=np.full(count, np.nan))


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("absent", [None, 0.0])
def test_values_agree_with_the_twin_over_drafts_land_and_gaps(weight: float, absent: float | None) -> None:
    rng = np.random.default_rng(11)
    mesh = AxesMesh(LON, LAT)
    records = rng.normal(size=(2, 4, LAT.size, LON.size))
    records[:, :, rng.random((LAT.size, LON.size)) < 0.4] = np.nan  # land
    records[1, :, rng.random((LAT.size, LON.size)) < 0.2] = np.nan  # known at the first time only
    records[:, 2:, rng.random((LAT.size, LON.size)) < 0.3] = np.nan  # a shallow floor
    records[:, :, :7, :6] = np.nan  # land without water near by
    _, _, places = places_on(mesh, 300)
    draft = rng.uniform(0.5, 220.0, 300)
    moment = Blend.of(records[0], records[1], weight, LIMITS, np.nan if absent is None else absent)
    found = values(moment, places, draft)
    for n in range(300):
        cell = int(places.row[n]), int(places.column[n])
        told = value_at(records, weight, LIMITS, draft[n], cell, places.xi[n], places.eta[n], absent)
        assert found[n] == pytest.approx(np.nan if told is None else told, rel=1e-12, abs=1e-15, nan_ok=True)
    assert np.isnan(found).any() == (absent is None)


def test_a_known_value_is_not_lost_between_unknown_ones() -> None:
    """One wet point near by serves an element on land; a map shows land there."""
    field = np.full((1, LAT.size, LON.size), np.nan)
    field[0, 8, 7] = 0.25
    mesh = AxesMesh(LON, LAT)
    moment = Blend.of(field, field)
    lon, lat = LON[7] + np.array([0.1, -0.8, 1.1, 2.0]), LAT[8] + np.array([0.1, 0.05, 0.0, 0.0])
    places = mesh.locate(lon, lat)
    np.testing.assert_array_equal(values(moment, places), [0.25, 0.25, 0.25, np.nan])
    np.testing.assert_array_equal(values(moment, places, near=NO_RINGS), [0.25, np.nan, np.nan, np.nan])


def test_thin_ice_feels_the_surface_and_thick_ice_the_deep() -> None:
    """A surface current of 20 m: over it alone 0.5 m/s, over a draft D 0.5 * 20 / D, and less water counts for less."""
    mesh = AxesMesh(LON, LAT)
    field = np.zeros((4, LAT.size, LON.size))
    field[0] = 0.5
    _, _, places = places_on(mesh, 50)
    draft = np.linspace(4.0, 188.0, 50)
    found = values(Blend.of(field, field, limits=LIMITS), places, draft)
    np.testing.assert_allclose(found, 0.5 * np.minimum(1.0, 20.0 / draft), rtol=1e-12)
    field[1:] = np.nan  # the floor at 20 m
    np.testing.assert_allclose(values(Blend.of(field, field, limits=LIMITS), places, draft), 0.5, rtol=1e-12)


MESHES = {"axes": AxesMesh(LON, LAT), "turned": turned(), "mirrored": turned(2.5), "skewed": turned(0.3, 0.4)}


@pytest.mark.parametrize("name", MESHES)
def test_a_plane_is_met_exactly_and_so_are_its_slope_and_curl(name: str) -> None:
    """Whatever way the rows of the grid run: values, slope in m/m to the east and north, vorticity dv/dx - du/dy."""
    mesh = MESHES[name]
    lon, lat, places = places_on(mesh)
    x, y = mesh.points.lon, mesh.points.lat

    def moment(a: float, b: float) -> Blend:
        field = (0.1 + a * (x + 40.0) + b * (y + 56.0))[None]
        return Blend.of(field, 3.0 * field, 0.25)  # 1.5 times the first record

    np.testing.assert_allclose(
        values(moment(0.02, 0.03), places), 1.5 * (0.1 + 0.02 * (lon + 40.0) + 0.03 * (lat + 56.0)), atol=1e-12
    )
    metre, narrow = EARTH_RADIUS_A68 * DEGREE, np.cos(lat * DEGREE)
    sx, sy, turn = np.empty((3, lon.size))
    fill_slopes(moment(0.02, 0.03), 0, places, mesh.points, lon, lat, sx, sy)
    np.testing.assert_allclose(sx, 1.5 * 0.02 / (metre * narrow), rtol=1e-9)
    np.testing.assert_allclose(sy, 1.5 * 0.03 / metre, rtol=1e-9)
    corners = corners_of(stacked(moment(0.02, 0.03), moment(0.05, 0.01)), places)
    fill_vorticity(corners, places, mesh.points, lon, lat, turn)
    np.testing.assert_allclose(turn, 1.5 * (0.05 / narrow - 0.03) / metre, rtol=1e-9)


def test_a_curvilinear_grid_that_goes_round_has_cells_between_its_last_and_its_first_column() -> None:
    """They were missing: places there had the values of the columns themselves, of the nearer one."""
    lon, lat = np.arange(5.0, 365.0, 5.0), np.arange(-70.0, -50.0, 2.5)
    straight, bent = AxesMesh(lon, lat), CurvilinearMesh(*np.meshgrid(lon, lat))
    rng = np.random.default_rng(4)
    x, y = np.append(rng.uniform(0.0, 5.0, 60), rng.uniform(-180.0, 540.0, 60)), rng.uniform(-69.0, -53.0, 120)
    field = (np.sin(np.deg2rad(straight.points.lon)) + straight.points.lat)[None]
    moment, found = Blend.of(field, field), []
    for mesh in (straight, bent):
        places, out = mesh.locate(x, y), np.empty((4, x.size))
        assert ((places.row >= 0).all(), mesh.points.columns) == (True, lon.size)
        out[0] = values_at(moment, places, mesh.points.columns, ONLY_FIELD)[0]
        fill_slopes(moment, 0, places, mesh.points, x, y, out[1], out[2])
        fill_vorticity(corners_of(stacked(moment, moment), places), places, mesh.points, x, y, out[3])
        found.append(out)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-18)


def test_a_grid_without_positions_along_its_edge_does_not_go_round() -> None:
    lon, lat = np.meshgrid(np.arange(0.0, 360.0, 5.0), LAT)
    assert goes_round_in_x(unit_vectors(lon, lat))
    lon[:, 0] = np.nan
    assert not goes_round_in_x(unit_vectors(lon, lat))
    assert not goes_round_in_x(np.full((3, 5, 3), np.nan))


def test_the_slope_is_of_second_order_on_a_wavy_sea() -> None:
    """Half the step, a quarter of the error."""
    errors = []
    for step in (0.4, 0.2, 0.1):
        lon, lat = np.arange(-42.0, -36.0, step), np.arange(-59.0, -53.0, step)
        mesh = AxesMesh(lon, lat)
        x, y = np.meshgrid(lon, lat)
        level = (np.sin(x) * np.cos(1.5 * y))[None]
        e, n, places = places_on(mesh, 400)
        sx, sy = np.empty((2, e.size))
        fill_slopes(Blend.of(level, level), 0, places, mesh.points, e, n, sx, sy)
        metre = EARTH_RADIUS_A68 * DEGREE
        wrong_x = sx * metre * np.cos(n * DEGREE) - np.cos(e) * np.cos(1.5 * n)
        wrong_y = sy * metre + 1.5 * np.sin(e) * np.sin(1.5 * n)
        errors.append(np.sqrt((wrong_x**2 + wrong_y**2).mean()))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_there_is_no_slope_across_a_shore() -> None:
    mesh = AxesMesh(LON, LAT)
    level = np.ones((1, LAT.size, LON.size))
    level[0, :, :7] = np.nan
    lon, lat = np.array([LON[7] + 0.1, LON[6] + 0.1]), np.array([-57.1, -57.1])
    sx, sy = np.empty((2, 2))
    fill_slopes(Blend.of(level, level), 0, mesh.locate(lon, lat), mesh.points, lon, lat, sx, sy)
    np.testing.assert_array_equal([sx, sy], 0.0)


def test_drift_leads_away_from_land_on_any_grid() -> None:
    mesh = MESHES["turned"]
    lon, lat, places = places_on(mesh)
    wet = mesh.points.lon > lon.mean()
    field = np.where(wet, 0.0, np.nan)[None]
    moment = Blend.of(field, field)
    du, dv = np.zeros((2, lon.size))
    add_shore_drift(corners_of(moment, places)[0], places, mesh.points, lon, lat, 0.1, du, dv)
    corners = [wet[places.row + b, places.column + a] for a in (0, 1) for b in (0, 1)]
    shore = np.any(corners, axis=0) & ~np.all(corners, axis=0)
    assert shore.any()
    assert (du[shore] > 0.0).all()  # the land is in the west
    np.testing.assert_array_equal(np.hypot(du, dv)[~shore], 0.0)
    assert np.hypot(du, dv).max() <= 0.1 * np.sqrt(2.0) + 1e-12


@pytest.mark.parametrize(("seam", "closed"), [(0.18, False), (0.21, True), (1.0, True), (1.45, True), (1.6, False)])
def test_a_grid_goes_round_where_its_seam_is_about_a_step_wide(seam: float, closed: bool) -> None:
    """A seam of less than a fifth of a step is a column that is given twice, one of more than one and a half a gap."""
    step = 360.0 / (60.0 + seam)
    assert goes_round_in_x(unit_vectors(*np.meshgrid(step * np.arange(61), LAT))) == closed


@pytest.mark.parametrize(("apart", "held"), [(2.9, True), (3.1, False)])
def test_scattered_nodes_reach_three_of_their_distances(apart: float, held: bool) -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(20), 0.1 * np.arange(20)))
    places = NodeMesh(lon, lat).locate(np.array([1.0]), np.array([-0.1 * apart]))
    assert (places.row[0] >= 0) == held


@pytest.mark.parametrize("missing", [0, 1, 4])
def test_slopes_on_scattered_nodes_come_from_the_nodes_that_are_known(missing: int) -> None:
    """One missing node of the nine near by made the slope 0."""
    rng = np.random.default_rng(0)
    lon, lat = -40.0 + rng.random(400), -56.0 + rng.random(400)
    metre = DEGREE * EARTH_RADIUS_A68
    level = 1e-6 * metre * (lat + 56.0) + 2e-6 * metre * np.cos(DEGREE * 55.5) * (lon + 40.0)
    at = np.array([-39.5]), np.array([-55.5])
    near = np.argsort(np.hypot((lon - at[0]) * np.cos(DEGREE * 55.5), lat - at[1]))
    level[near[1:9:2][:missing]] = np.nan
    east, north = NodeMesh(lon, lat).slopes(level, *at)
    assert (east[0], north[0]) == pytest.approx((2e-6, 1e-6), rel=0.01)


def test_three_nodes_nearly_on_a_line_tell_no_slope_across_it() -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(3), 0.1 * np.arange(3)))
    lat = lat + 1e-3 * (np.arange(9) % 2)
    level = np.full(9, np.nan)
    level[3:6] = [0.0, 1e-3, 0.0]  # noise of a millimetre
    east, north = NodeMesh(lon, lat).slopes(level, np.array([0.1]), np.array([0.1]))
    assert np.hypot(east[0], north[0]) < 1e-7


def test_where_no_node_is_known_the_sea_is_level() -> None:
    lon, lat = (q.ravel() for q in np.meshgrid(0.1 * np.arange(5), 0.1 * np.arange(5)))
    assert NodeMesh(lon, lat).slopes(np.full(25, np.nan), np.array([0.2]), np.array([0.2])) == ([0.0], [0.0])


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_places_within_half_a_step_of_the_edge_have_the_value_of_the_edge(angle: float) -> None:
    """The field is not continued beyond its points; farther out there is nothing."""
    mesh = turned(angle)
    lon, lat = mesh.points.lon, mesh.points.lat
    field = (lon + 2.0 * lat)[None]
    for edge, inner in (((0, 9), (1, 9)), ((-1, 9), (-2, 9)), ((9, 0), (9, 1)), ((9, -1), (9, -2))):
        for part, known in ((0.3, True), (0.8, False)):
            out = [np.array([q[edge] + part * (q[edge] - q[inner])]) for q in (lon, lat)]
            found = values(Blend.of(field, field), mesh.locate(*out))[0]
            assert found == pytest.approx(field[0][edge], abs=1e-9) if known else np.isnan(found)
