"""All faces of an island at once: its linear system, and the forces that it finds."""

import numpy as np
import pytest

from riftberg.engines.quasi_static.contact import face_newton as newton


def random_island(
    seed: int, bodies: int, faces: int
) -> tuple[newton.NewtonWorkspace, np.ndarray, np.ndarray, np.ndarray]:
    """Return a workspace with free velocities and laws, the levers of its faces, their bodies, and compliances."""
    rng = np.random.default_rng(seed)
    work = newton.allocate_newton.py_func(bodies, faces)
    work.free[:] = rng.normal(size=(bodies, 3))
    levers = rng.normal(size=(faces, 2, 6))
    levers[:, :, 3:5] = -levers[:, :, :2]
    ends = np.array([rng.choice(bodies, 2, replace=False) for _ in range(faces)])
    root = rng.normal(size=(bodies, 3, 3))
    skew = 0.1 * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    compliance = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3) + skew  # a Coriolis force turns it a little
    loading = rng.uniform(1.0, 3.0, faces)
    work.law[:] = np.column_stack(
        [rng.normal(size=faces), 20.0 * loading, rng.normal(size=faces), loading, rng.uniform(1.0, 3.0, faces),
         0.1 * rng.normal(size=faces), rng.uniform(1.0, 9.0, faces)]
    )  # fmt: skip
    return work, levers, ends, compliance


def speeds(levers: np.ndarray, ends: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Closing and sliding speed of each face."""
    return np.einsum("fkn,fn->fk", levers, np.hstack([velocity[ends[:, 0]], velocity[ends[:, 1]]]))


def kicks(levers: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Changes of the velocities of two bodies by a unit impulse across a face, then along it."""
    return np.hstack([levers[:, :3] @ first.T, levers[:, 3:] @ second.T]).ravel()


def velocities(work: newton.NewtonWorkspace, levers, ends, compliance, forces: np.ndarray, h: float) -> np.ndarray:
    """Velocities to which forces and frictions lead."""
    out = work.free.copy()
    for f, (a, b) in enumerate(ends):
        impulse = h * forces[f] @ levers[f]
        out[a] -= compliance[a] @ impulse[:3]
        out[b] -= compliance[b] @ impulse[3:]
    return out


def law_of(work: newton.NewtonWorkspace, speed: np.ndarray, friction: float) -> np.ndarray:
    """Force and friction of each face at its speeds."""
    law, force = work.law.T, np.empty_like(speed)
    force[:, 0] = np.clip(np.minimum(law[0] + law[1] * speed[:, 0], law[2] + law[3] * speed[:, 0]), 0.0, law[4])
    force[:, 1] = np.clip(law[5] + law[6] * speed[:, 1], -friction * force[:, 0], friction * force[:, 0])
    return force


@pytest.mark.parametrize(("bodies", "faces"), [(2, 1), (5, 4), (12, 30), (30, 46)])
def test_the_system_is_solved_by_elimination(bodies: int, faces: int) -> None:
    work, levers, ends, compliance = random_island(bodies, bodies, faces)
    work.course[:, newton.CLOSING_NOW : newton.SLIDING_NOW + 1] = speeds(levers, ends, work.free)
    newton.find_pieces(work, faces, 0.2)
    newton.begin_system(work)
    for f, (a, b) in enumerate(ends):
        newton.add_face(work, f, levers[f].ravel(), kicks(levers[f], compliance[a], compliance[b]), a, b, 0.3)
    matrix, right = work.matrix.transpose(0, 2, 1, 3).reshape(3 * bodies, -1).copy(), work.right.ravel().copy()
    solved = np.empty((bodies, 3))
    newton.solve_system(work, solved)
    np.testing.assert_allclose(solved.ravel(), np.linalg.solve(matrix, right), rtol=1e-9, atol=1e-9)
    # It says that the velocities are those to which the straight pieces of the law lead.
    closing, sliding = speeds(levers, ends, solved).T
    line = work.line.T
    forces = np.column_stack([line[0] + line[1] * closing, line[2] + line[3] * sliding + line[4] * closing])
    np.testing.assert_allclose(velocities(work, levers, ends, compliance, forces, 0.3), solved, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", range(12))
def test_forces_of_all_faces_at_once_are_those_of_their_law(seed: int) -> None:
    work, levers, ends, compliance = random_island(seed, 20, 30)
    course, h, friction, share, solved = work.course, 0.3, 0.2, 0.0, np.empty((20, 3))
    course[:, : newton.CLOSING_NOW] = 0.0
    course[:, newton.CLOSING_NOW : newton.SLIDING_NOW + 1] = speeds(levers, ends, work.free)
    for _ in range(newton.MOST_ITERATIONS):
        if not newton.find_pieces(work, 30, friction) and share == 1.0:
            break
        newton.begin_system(work)
        for f, (a, b) in enumerate(ends):
            newton.add_face(work, f, levers[f].ravel(), kicks(levers[f], compliance[a], compliance[b]), a, b, h)
        newton.solve_system(work, solved)
        course[:, newton.NEXT_CLOSING :] = speeds(levers, ends, solved)
        share = newton.approach_solution(work, 30, friction)
        assert 0.0 < share <= 1.0
    else:
        pytest.fail("no end")
    forces = course[:, : newton.CLOSING_NOW]
    velocity = velocities(work, levers, ends, compliance, forces, h)
    assert (forces[:, 0] > 0.0).any()
    assert (forces[:, 0] == 0.0).any()
    np.testing.assert_allclose(law_of(work, speeds(levers, ends, velocity), friction), forces, rtol=1e-7, atol=1e-7)
