"""Steps on rotations, directions and scales against SciPy's rotations, matrix exponentials and differences."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from mbm.equations.manifolds import chart_slopes, moved, numbers_of_stated, tangent_axes, tangent_slopes
from mbm.estimation.starts.closed_forms.motions import inverse, product
from mbm.problem.manifold import Piece, manifold_of
from mbm.problem.types import UnknownKind
from mbm.rotations import (
    hamilton,
    matrix_of_quaternion,
    quaternion_of_matrix,
    quaternion_of_vector,
    vector_of_quaternion,
)

ROUNDING = 1e-14
"""A few units in the last place of numbers of size 1."""


@pytest.fixture
def rotations():
    return Rotation.random(50, random_state=5)


def scalar_first(rotation):
    return np.roll(rotation.as_quat(), 1, axis=-1)


def test_a_step_turns_about_the_axes_of_the_turned_frame(rotations):
    omega = np.random.default_rng(1).normal(size=(50, 3))
    found = matrix_of_quaternion(moved(Piece.QUATERNION, scalar_first(rotations), omega))
    wanted = (rotations * Rotation.from_rotvec(omega)).as_matrix()
    np.testing.assert_allclose(found, wanted, atol=ROUNDING)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 1.0, np.pi - 1e-9, np.pi])
def test_logarithm_undoes_the_exponential(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3
    found = vector_of_quaternion(quaternion_of_vector(angle * axis))
    sign = 1.0 if angle < np.pi else np.sign(found @ axis)  # both vectors of length pi are the same rotation
    np.testing.assert_allclose(sign * found, angle * axis, atol=1e-15, rtol=1e-14)


def test_products_and_matrices(rotations):
    other = Rotation.random(50, random_state=6)
    product = hamilton(scalar_first(rotations), scalar_first(other))
    np.testing.assert_allclose(matrix_of_quaternion(product), (rotations * other).as_matrix(), atol=ROUNDING)
    back = quaternion_of_matrix(rotations.as_matrix())
    np.testing.assert_allclose(matrix_of_quaternion(back), rotations.as_matrix(), atol=ROUNDING)
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    found = matrix_of_quaternion(quaternion_of_matrix(half_turns.as_matrix()))
    np.testing.assert_allclose(found, half_turns.as_matrix(), atol=ROUNDING)


def test_directions_move_along_great_circles():
    random = np.random.default_rng(2)
    start = random.normal(size=(40, 3))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    step = random.normal(size=(40, 2))
    first, second = tangent_axes(start)
    found = moved(Piece.SPHERE, start, step)
    for u, v, a, b, s in zip(start, found, first, second, step, strict=True):
        axis = np.cross(u, s[0] * a + s[1] * b)
        turn = expm(np.cross(np.eye(3), axis))
        np.testing.assert_allclose(v, turn @ u, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=ROUNDING)
    pole = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    for axis in tangent_axes(pole):
        np.testing.assert_allclose((axis * pole).sum(axis=1), 0.0, atol=ROUNDING)


@pytest.mark.parametrize("direction", [[0.6, 0.8, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.0, 0.0, -1.0]], ids=str)
def test_axes_of_usual_directions_do_not_depend_on_roundings(direction):
    """Along the axes, in their planes and at the pole, axes turn no farther than eight times as the direction."""
    random = np.random.default_rng(4)
    near = direction + 1e-12 * random.normal(size=(20, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    for found, wanted in zip(tangent_axes(near), tangent_axes(np.array(direction)), strict=True):
        np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), atol=8 * 4e-12)
        np.testing.assert_allclose((found * near).sum(axis=1), 0.0, atol=ROUNDING)


@pytest.mark.parametrize("piece", list(Piece))
@pytest.mark.parametrize("length", [0.0, 1e-5, 0.7, 2.5])
def test_chart_slopes_are_those_of_differences(piece, length):
    random = np.random.default_rng(3)
    numbers = random.normal(size=(6, piece.size))
    if piece.size > 1:
        numbers /= np.linalg.norm(numbers, axis=1, keepdims=True)
    step = random.normal(size=(6, piece.tangent))
    step *= length / np.linalg.norm(step, axis=1, keepdims=True)
    slopes = chart_slopes(piece, numbers, step)
    there = moved(piece, numbers, step)
    tiny = 1e-6
    for j in range(piece.tangent):
        shift = np.zeros(piece.tangent)
        shift[j] = tiny
        wanted = (moved(piece, numbers, step + shift) - moved(piece, numbers, step - shift)) / 2
        found = (moved(piece, there, tiny * slopes[:, :, j]) - moved(piece, there, -tiny * slopes[:, :, j])) / 2
        np.testing.assert_allclose(found / tiny, wanted / tiny, atol=1e-8)  # differences of 1e-6: eps / 1e-6


@pytest.mark.parametrize(("kind", "dimension"), [("rotation", 2), ("rotation", 3), ("pose", 3), ("similarity", 2)])
def test_slopes_of_what_is_stated(kind, dimension):
    """The tangent slopes of a constant similarity composed with a moving one are the identity at no step."""
    manifold = manifold_of(kind, dimension, 0)
    random = np.random.default_rng(4)
    stated = _stated(kind, dimension, random, np.zeros(manifold.tangent))
    tiny = 1e-6
    columns = []
    for j in range(manifold.tangent):
        shift = np.zeros(manifold.tangent)
        shift[j] = tiny
        ahead = _stated(kind, dimension, np.random.default_rng(4), shift)
        behind = _stated(kind, dimension, np.random.default_rng(4), -shift)
        columns.append((ahead - behind) / (2 * tiny))
    slopes = np.stack(columns, axis=-1)[None]
    found = tangent_slopes(UnknownKind(kind), dimension, stated[None], slopes)[0]
    np.testing.assert_allclose(found, np.eye(manifold.tangent), atol=1e-8)


def _stated(kind, dimension, random, step):
    """Matrix, translation, scale of a random value after a step, made without the code under test."""
    if dimension == 3:
        matrix = Rotation.from_rotvec(random.normal(size=3)).as_matrix() @ expm(np.cross(np.eye(3), step[:3]))
    else:
        angle = random.normal() + step[0]
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    parts = [matrix.ravel()]
    turning = 3 if dimension == 3 else 1
    if kind != "rotation":
        parts.append(random.normal(size=dimension) + step[turning : turning + dimension])
    if kind == "similarity":
        parts.append(np.array([1.7 * np.exp(step[-1])]))
    return np.concatenate(parts)


def test_stated_values_become_numbers(rotations):
    stated = np.hstack([rotations.as_matrix().reshape(-1, 9), np.arange(150.0).reshape(-1, 3)])
    found = numbers_of_stated(UnknownKind.POSE, 3, stated)
    wanted = scalar_first(rotations)
    wanted = np.where(wanted[:, :1] < 0, -wanted, wanted)
    np.testing.assert_allclose(found, np.hstack([wanted, stated[:, 9:]]), atol=ROUNDING)
    assert np.isnan(numbers_of_stated(UnknownKind.DIRECTION, 3, np.zeros((1, 3)))).all()


def test_poses_follow_one_another_as_their_matrices_do(rotations):
    """Products and inverses of motions of space: quaternion and shift."""
    entry = SimpleNamespace(unknown=SimpleNamespace(dimension=3))
    shifts = np.random.default_rng(8).normal(size=(50, 3))
    motions = np.hstack([scalar_first(rotations), shifts])
    other = motions[::-1]

    def matrices(numbers):
        found = np.tile(np.eye(4), (len(numbers), 1, 1))
        found[:, :3, :3] = Rotation.from_quat(np.roll(numbers[:, :4], -1, axis=1)).as_matrix()
        found[:, :3, 3] = numbers[:, 4:]
        return found

    np.testing.assert_allclose(
        matrices(product(entry, motions, other)), matrices(motions) @ matrices(other), atol=10 * ROUNDING
    )
    np.testing.assert_allclose(matrices(inverse(entry, motions)), np.linalg.inv(matrices(motions)), atol=10 * ROUNDING)
