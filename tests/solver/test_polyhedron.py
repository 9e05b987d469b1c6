"""The point of a polyhedron that is nearest to the origin, and its multipliers, against nonnegative least squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from mbm.machine.records import slot
from mbm.solver import description as of
from tests.solver.scratch import FirstPlace, Scratch

WIDTH = 5


@pytest.fixture
def scratch():
    system = np.zeros(of.HEADER + 2 * WIDTH, dtype=np.int64)
    system[[of.Problem.n, of.Problem.numbers]] = WIDTH
    return Scratch(system)


def outer_faces(count, seed):
    """Unit normals (count, WIDTH) and limits of a polyhedron that does not hold the origin, and sizes of normals."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(count, WIDTH)) + np.array([1.5, 0, 0, 0, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = random.normal(size=WIDTH) - np.array([4.0, 0, 0, 0, 0])
    return normals, normals @ inside + random.uniform(0, 0.5, count), random.uniform(0.5, 2, count)


def joined(solver, work, normals, limits, sizes):
    """Whether the faces have a common point: each joins where it is overstepped most."""
    for _ in range(200):
        beyond = normals @ work.record.nearest[:WIDTH] - limits
        face = int(np.argmax(beyond))
        if beyond[face] < 1e-12:
            return True
        work.record.normal[:WIDTH] = normals[face]
        if solver("join", WIDTH, face, limits[face], sizes[face], work) != 1:
            return False
    raise AssertionError("faces join and leave for ever")


def nearest_by_duality(normals, limits):
    """``w`` and λ of ``min ‖w‖²/2`` where ``N w <= l`` (Lawson and Hanson 1974, chapter 23)."""
    matrix, right = np.vstack([-normals.T, -limits]), np.append(np.zeros(WIDTH), 1.0)
    share, left = nnls(matrix, right)
    rest = matrix @ share - right
    return (None, None) if left < 1e-9 else (-rest[:-1] / rest[-1], share / -rest[-1])


@pytest.mark.parametrize("seed", range(8))
def test_nearest_point_and_its_multipliers(solver, scratch, seed):
    normals, limits, sizes = outer_faces(12, seed)
    assert joined(solver, scratch, normals, limits, sizes)
    solver("settle_nearest", WIDTH, scratch)
    work = scratch.record
    wanted, forces = nearest_by_duality(normals, limits)
    np.testing.assert_allclose(
        work.nearest[:WIDTH], wanted, atol=1e-9
    )  # of lengths of a few; nnls drops what is below 1e-14
    found = np.zeros(len(limits))
    found[work.faces[: work.active]] = work.face_forces[: work.active]
    np.testing.assert_allclose(found, forces, atol=1e-8)
    np.testing.assert_array_equal(work.face_sizes[: work.active], sizes[work.faces[: work.active]])


def test_faces_without_a_common_point(solver, scratch):
    normals, limits, sizes = outer_faces(6, 1)
    # a sum of the first three that contradicts them
    normals = np.vstack([normals, -normals[:3].sum(axis=0)])
    limits = np.append(limits, -limits[:3].sum() - 0.1)
    length = np.linalg.norm(normals[-1])
    normals[-1], limits[-1] = normals[-1] / length, limits[-1] / length
    assert nearest_by_duality(normals, limits) == (None, None)
    assert not joined(solver, scratch, normals, limits, np.append(sizes, 1.0))


def test_faces_of_bounds_are_lower_ones_and_then_upper_ones(solver, scratch):
    """Without constraints: face j is the lower bound of coordinate j, face n + j the upper one."""
    system = np.zeros(of.HEADER + 2 * WIDTH, dtype=np.int64)
    system[[of.Problem.n, of.Problem.numbers]] = WIDTH
    system[slot(of.Problem, "positive")] = of.HEADER
    x, low, high = np.arange(1.0, 6.0), np.arange(-5.0, 0.0), np.arange(11.0, 16.0)
    constants = np.zeros(of.BOUNDS_AT + 2 * WIDTH)
    constants[of.BOUNDS_AT : of.BOUNDS_AT + WIDTH], constants[of.BOUNDS_AT + WIDTH :] = low, high
    work = scratch.record
    work.rows.constants, work.scale[:WIDTH], work.values[:1] = constants, 2.0, 1e3
    place = FirstPlace(scratch)
    place.record.x[:WIDTH] = x
    for j in range(WIDTH):
        for face, sign, value in ((j, -1.0, 2.0 * (low - x)[j]), (WIDTH + j, 1.0, -2.0 * (high - x)[j])):
            assert solver("set_face", system, face, 0, place, scratch) == pytest.approx(value, rel=1e-15)
            assert work.moved[:WIDTH].tolist() == (sign * np.eye(WIDTH)[j]).tolist()
