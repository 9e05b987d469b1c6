"""Steps along rotations, directions and scales against those of the general path, and against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbm.equations.manifolds import moved
from mbm.machine.records import slot
from mbm.problem.manifold import Piece
from mbm.solver import description as of


def described(piece, size, tangent, free=None):
    """A system with one piece alone, whose tangents in ``free`` (all: None) are free."""
    columns = np.arange(tangent) if free is None else np.where(free, np.cumsum(free) - 1, -1)
    count = int((columns >= 0).sum())
    system = np.zeros(of.HEADER + count + of.PIECE, dtype=np.int64)
    system[[of.Problem.numbers, of.Problem.n, of.Problem.component_count]] = size, count, 1
    system[slot(of.Problem, "number_of")], system[slot(of.Problem, "components")] = of.HEADER, of.HEADER + count
    system[of.HEADER : of.HEADER + count] = -1
    line = system[of.HEADER + count :]
    line[of.Component.kind] = piece
    line[of.Component.number_0 : of.Component.number_0 + size] = np.arange(size)
    line[of.Component.column_0 : of.Component.column_0 + tangent] = columns
    return system


def after(solver, system, point, step):
    target = np.zeros(len(point))
    solver("retract", system, point, step, target)
    return target


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 0.3, 3.0, 50.0])
def test_rotations(solver, size):
    point = np.array([0.5, -0.5, 0.7, 0.1])
    point /= np.linalg.norm(point)
    step = size * np.array([0.6, -0.64, 0.48])
    found = after(solver, described(of.QUATERNION, 4, 3), point, step)
    turned = (Rotation.from_quat(np.roll(point, -1)) * Rotation.from_rotvec(step)).as_quat()
    wanted = np.roll(turned, 1)
    # Rounding of sines of angles up to 50, which are known to 50 eps.
    np.testing.assert_allclose(found * np.sign(found @ wanted), wanted, rtol=0, atol=2e-14)


@pytest.mark.parametrize("z", [-1.0, -0.9, -0.3, 0.0, 0.8])
def test_directions(solver, z):
    point = np.array([np.sqrt((1 - z * z) * 0.36), np.sqrt((1 - z * z) * 0.64), z])
    step = np.array([0.2, -0.7])
    found = after(solver, described(of.DIRECTION, 3, 2), point, step)
    np.testing.assert_allclose(found, moved(Piece.SPHERE, point[None], step[None])[0], rtol=0, atol=1e-15)
    # A great circle: the angle between the ends is the length of the step.
    assert np.arccos(found @ point) == pytest.approx(np.linalg.norm(step), rel=1e-12)


def test_scales(solver):
    found = after(solver, described(of.SCALE, 1, 1), np.array([2.5]), np.array([-0.4]))
    np.testing.assert_allclose(found, 2.5 * np.exp(-0.4), rtol=1e-15)


ABOUT_AXES = [np.pi * axis for axis in np.eye(3)]
OBLIQUE = [np.array(v) for v in ((2.9, 0.7, -0.4), (-0.5, 3.0, 0.6), (0.3, -0.8, -2.9), (0.1, 0.2, -0.3), (0, 0, 0))]


@pytest.mark.parametrize("turn", ABOUT_AXES + OBLIQUE, ids=str)
def test_quaternions_of_matrices(solver, turn):
    """Half turns about each axis, and turns that begin with each of the four numbers."""
    rotation = Rotation.from_rotvec(turn)
    wanted = np.roll(rotation.as_quat(canonical=False), 1)
    found = np.zeros(4)
    solver("quaternion_of_matrix", rotation.as_matrix().ravel(), found)
    assert found[0] >= 0
    np.testing.assert_allclose(found * np.sign(found @ wanted), wanted, rtol=0, atol=1e-15)


def test_a_tangent_that_is_not_free_stays(solver):
    point = np.array([1.0, 0.0, 0.0, 0.0])
    found = after(solver, described(of.QUATERNION, 4, 3, np.array([True, False, True])), point, np.array([0.1, 0.2]))
    wanted = np.roll(Rotation.from_rotvec([0.1, 0.0, 0.2]).as_quat(), 1)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15)
