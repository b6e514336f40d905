"""Contact by crushing: the law of a face and the overlap of polygons against twins; sign, units, invariance."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.physics import geometry
from riftberg.physics.contact import crushing_force, face_stiffness, sliding_force
from riftberg.physics.geometry import gap
from twins import crushing as twin


def overlap(one: np.ndarray, two: np.ndarray) -> tuple[float, ...]:
    return geometry.overlap(one, two, np.empty((2, 2 * (len(one) + len(two)), 3)))


def polygon(random: np.random.Generator, corners: int, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """A convex polygon of some kilometres, counter-clockwise."""
    angle = np.sort(random.uniform(0.0, 2.0 * np.pi, corners))
    return 1500.0 * np.column_stack([np.cos(angle), np.sin(angle)]) + np.array(at)


def test_law_and_twin_agree() -> None:
    random, branches = np.random.default_rng(3), np.zeros(4, int)
    for _ in range(400):
        depth, touched = random.uniform(-1.0, 30.0), random.uniform(0.0, 3.0)
        crushed, stiffness = touched + random.uniform(0.0, 20.0), 10.0 ** random.uniform(9, 12)
        limit, compliance = 20.0 * stiffness * random.uniform(0.1, 1.0), 10.0 ** random.uniform(-14, -9)
        given = depth, touched, crushed, stiffness, 100.0, limit, compliance
        force = crushing_force(*given)
        assert force == pytest.approx(twin.force(*given), rel=1e-9, abs=1e-3)
        now = depth - compliance * force
        branches[0] += force == 0.0
        branches[1] += force == limit
        branches[2] += 0.0 < force < limit and stiffness * (now - touched) == pytest.approx(force, rel=1e-9)
        branches[3] += 0.0 < force < limit and 100.0 * stiffness * (now - crushed) == pytest.approx(force, rel=1e-6)
    assert (branches > 20).all()  # each branch has been met


def test_stiffness_is_that_of_strength_over_depth() -> None:
    """1.5 MPa on 10 km x 250 m are reached after 20 m."""
    stiffness = face_stiffness(1.5e6, 250.0, 10e3, 20.0)
    assert 20.0 * stiffness == pytest.approx(1.5e6 * 250.0 * 10e3)
    assert crushing_force(40.0, 0.0, 0.0, stiffness, 100.0, 1.5e6 * 250.0 * 10e3, 0.0) == 1.5e6 * 250.0 * 10e3
    assert crushing_force(10.0, 0.0, 0.0, stiffness, 100.0, 1e30, 0.0) == pytest.approx(10.0 * stiffness)
    assert crushing_force(-1.0, 0.0, 0.0, stiffness, 100.0, 1e30, 0.0) == 0.0


def test_what_comes_back_is_one_over_the_ratio() -> None:
    """Press in slowly, and let go: the energy that the faces return is a hundredth of what they took."""
    stiffness, crushed, work = 1e10, 0.0, []
    for way in (np.linspace(0.0, 5.0, 4001), np.linspace(5.0, 0.0, 400_001)):
        force = []
        for depth in way:
            force.append(crushing_force(depth, 0.0, crushed, stiffness, 100.0, 1e30, 0.0))
            if force[-1] > 0.0:
                crushed = max(crushed, depth - force[-1] / (100.0 * stiffness))
        work.append(np.trapezoid(force, way))
    assert -work[1] / work[0] == pytest.approx(0.01, rel=1e-3)


def test_friction_stops_and_does_not_reverse() -> None:
    """Of a stiff face: what brings both to rest within the step, up to its limit."""
    for stop in (5.0, -5.0):
        assert sliding_force(0.0, 0.1 * stop, 1e12, 0.1, 20.0) == pytest.approx(stop)
    assert sliding_force(0.0, 5.0, 1e12, 0.1, 20.0) == 20.0
    assert sliding_force(0.0, -5.0, 1e12, 0.1, 20.0) == -20.0
    assert sliding_force(3.0, 1.0, 1e12, 0.1, 0.0) == 0.0


def test_friction_grows_by_the_way_along_the_face_and_is_given_back() -> None:
    """A slow plain twin: the force at which law and motion agree, by bisection."""
    for last, way in ((0.0, 1.0), (4.0, 1.0), (4.0, -3.0), (-4.0, 1.0), (6.0, 9.0)):
        low, high = -100.0, 100.0
        for _ in range(80):
            friction = 0.5 * (low + high)
            if last + 3.0 * (way - 0.2 * friction) > friction:
                low = friction
            else:
                high = friction
        limited = min(max(low, -7.0), 7.0)
        assert sliding_force(last, way, 3.0, 0.2, 7.0) == pytest.approx(limited)
        assert sliding_force(-last, -way, 3.0, 0.2, 7.0) == pytest.approx(-limited)
    there = sliding_force(0.0, 1.0, 3.0, 0.0, 7.0)
    assert sliding_force(there, -1.0, 3.0, 0.0, 7.0) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_overlap_and_gap_are_those_of_the_polygons(seed: int) -> None:
    random, met = np.random.default_rng(seed), [0, 0]
    for _ in range(60):
        one = polygon(random, int(random.integers(3, 7)))
        two = polygon(random, int(random.integers(3, 7)), tuple(random.uniform(-2500.0, 2500.0, 2)))
        area, mx, my, cx, cy = overlap(one, two)
        there, centroid, chord = twin.overlap(one, two)
        assert area == pytest.approx(there, rel=1e-9, abs=1e-5)
        apart, nx, ny = gap(one, two)
        assert np.hypot(nx, ny) == pytest.approx(1.0)
        if there > 1.0:
            met[0] += 1
            np.testing.assert_allclose([mx / area, my / area], centroid, atol=1e-3)
            np.testing.assert_allclose([cx, cy], chord, atol=1e-6)
            # Both faces of an overlap have the same chord, each the other way.
            _, _, _, ox, oy = overlap(two, one)
            np.testing.assert_allclose([cx, cy], [-ox, -oy], atol=1e-6)
            assert apart < 0.0
        elif there == 0.0:
            met[1] += 1
            assert apart <= twin.distance(one, two) + 1e-9  # a strip, so a lower bound
    assert min(met) > 5


def test_the_normal_points_out_of_the_first() -> None:
    square = 1000.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for turn in np.radians([0.0, 30.0, 100.0, 250.0]):
        spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        one, two = square @ spin.T, (square + np.array([1990.0, 300.0])) @ spin.T
        area, _, _, cx, cy = overlap(one, two)
        assert area == pytest.approx(10.0 * 1700.0)
        normal = np.array([cy, -cx]) / np.hypot(cx, cy)
        np.testing.assert_allclose(normal, spin @ [1.0, 0.0], atol=0.01)  # the ends of the strip are part of the face
        distance, nx, ny = gap(one, (square + np.array([2007.0, 300.0])) @ spin.T)
        assert distance == pytest.approx(7.0)
        np.testing.assert_allclose([nx, ny], spin @ [1.0, 0.0], atol=1e-12)


def test_the_parts_of_a_face_add_up() -> None:
    """An element cut in two has the area and the chord of the whole."""
    whole = np.array([[0.0, 0.0], [1000.0, 0.0], [1000.0, 1000.0], [0.0, 1000.0]])
    parts = whole[[0, 1, 2]], whole[[0, 2, 3]]
    other = whole + np.array([990.0, 100.0])
    np.testing.assert_allclose(
        np.sum([overlap(part, other) for part in parts], axis=0), overlap(whole, other), atol=1e-6
    )


def test_faces_at_a_flat_angle_overlap_as_deep_as_they_do() -> None:
    """An edge of millimetres at a corner, as footprints have: pieces of edges found one by one made a third too little of it.

    The faces cross at a milliradian; two footprints of 5 km as a run on the sphere had them.
    """
    one = [[-7491.844992072222, -2492.694297595268], [-2491.8460842025115, -2489.297476653046],
           [-2495.2414874795627, 2510.7013701186], [-7495.242648467633, 2507.3044219939584],
           [-7495.245119486492, 2507.304420315173]]  # fmt: skip
    two = [[2504.307235646177, -2492.7020728494244], [2507.7059900045615, 2507.2966459945414],
           [-2492.2919249350207, 2510.698580754632], [-2495.69308921396, -2489.3010340905466],
           [-2495.693091311154, -2489.3041157452244], [2504.305849412881, -2492.703457199429]]  # fmt: skip
    area, mx, my, cx, cy = overlap(np.array(one), np.array(two))
    assert area == pytest.approx(5443.72, rel=1e-3)  # by shapely
    assert [mx / area, my / area] == pytest.approx([-2493.77, -1545.93], abs=2.0)
    assert np.hypot(cx, cy) == pytest.approx(2829.5, abs=2.0)
