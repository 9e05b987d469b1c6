"""Pose graphs without a start: rotations first, then translations, beside dense algebra, GTSAM and simulated truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.starts.closed_forms.numerics.chordal import Frames, Motions, chordal
from mbm.estimation.starts.closed_forms.trees import foremost_edges

COUNT = 30


def edges_of(generator):
    """A chain, and as many other edges."""
    chain = np.column_stack([np.arange(COUNT - 1), np.arange(1, COUNT)])
    others = np.array([generator.choice(COUNT, 2, replace=False) for _ in range(COUNT)])
    return np.vstack([chain, others]).T


def truth(dimension, generator):
    turns = Rotation.random(COUNT, random_state=7).as_matrix()
    if dimension == 2:
        angle = generator.uniform(-3, 3, COUNT)
        turns = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    return turns, generator.normal(0, 5, (COUNT, dimension))


def measured(dimension, generator, noise=0.0):
    first, second = edges_of(generator)
    turns, places = truth(dimension, generator)
    back = np.swapaxes(turns, 1, 2)
    error = Rotation.from_rotvec(generator.normal(0, noise, (len(first), 3))).as_matrix()
    if dimension == 2:
        angle = generator.normal(0, noise, len(first))
        error = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    shifts = np.einsum("nij,nj->ni", back[first], places[second] - places[first])
    shifts += generator.normal(0, noise, shifts.shape)
    stiffness = generator.uniform(0.5, 2.0, (len(first), 2))
    return Motions(
        first=first, second=second, turns=back[first] @ turns[second] @ error, shifts=shifts, stiffness=stiffness
    ), Frames(known=np.zeros(COUNT, dtype=bool), rotations=turns, translations=places)


def knowing(frames, *known):
    """Only some of the frames are told."""
    mask = np.isin(np.arange(COUNT), known)
    return Frames(
        known=mask,
        rotations=np.where(mask[:, None, None], frames.rotations, np.nan),
        translations=np.where(mask[:, None], frames.translations, np.nan),
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("known", [(0,), (4, 17, 18)])
def test_exact_motions_give_the_frames(dimension, known):
    motions, frames = measured(dimension, np.random.default_rng(3))
    found = chordal(motions, knowing(frames, *known))
    np.testing.assert_allclose(found.rotations, frames.rotations, atol=1e-11)  # 60 edges, condition below 1e4
    np.testing.assert_allclose(found.translations, frames.translations, atol=1e-10)
    np.testing.assert_array_equal(found.rotations[list(known)], frames.rotations[list(known)])


@pytest.mark.parametrize("dimension", [2, 3])
def test_both_steps_are_the_least_squares_that_they_claim_to_be(dimension):
    """Every row of every matrix equation, weighted, in one dense system each."""
    motions, frames = measured(dimension, np.random.default_rng(5), noise=0.1)
    found = chordal(motions, knowing(frames, 0))
    d, count = dimension, len(motions.first)
    A, b = np.zeros((count * d * d, COUNT * d * d)), np.zeros(count * d * d)
    for k, (i, j, M, (w, _)) in enumerate(
        zip(motions.first, motions.second, motions.turns, motions.stiffness, strict=True)
    ):
        for row in range(d):  # row of R_j − R_i M
            for column in range(d):
                line = k * d * d + row * d + column
                A[line, j * d * d + row * d + column] += np.sqrt(w)
                A[line, i * d * d + row * d : i * d * d + row * d + d] -= np.sqrt(w) * M[:, column]
    b -= A[:, : d * d] @ frames.rotations[0].ravel()
    relaxed = np.linalg.lstsq(A[:, d * d :], b, rcond=None)[0].reshape(-1, d, d)
    for one, matrix in zip(found.rotations[1:], relaxed, strict=True):
        U, _, V = np.linalg.svd(matrix)
        np.testing.assert_allclose(one, U @ np.diag([1.0] * (d - 1) + [np.linalg.det(U @ V)]) @ V, atol=1e-11)
    weight = np.sqrt(motions.stiffness[:, 1])
    A = np.zeros((count, COUNT))
    A[np.arange(count), motions.second] += weight
    A[np.arange(count), motions.first] -= weight
    moved = np.einsum("nij,nj->ni", found.rotations[motions.first], motions.shifts) * weight[:, None]
    places = np.linalg.lstsq(A[:, 1:], moved - A[:, :1] * frames.translations[0], rcond=None)[0]
    np.testing.assert_allclose(found.translations[1:], places, atol=1e-11)


def test_rotations_are_those_of_gtsam():
    gtsam = pytest.importorskip("gtsam")
    motions, frames = measured(3, np.random.default_rng(5), noise=0.05)
    graph = gtsam.NonlinearFactorGraph()
    even = Motions(
        first=motions.first,
        second=motions.second,
        turns=motions.turns,
        shifts=motions.shifts,
        stiffness=np.ones_like(motions.stiffness),
    )
    for i, j, turn, shift in zip(even.first, even.second, even.turns, even.shifts, strict=True):
        pose = gtsam.Pose3(gtsam.Rot3(turn), shift)
        graph.add(gtsam.BetweenFactorPose3(int(i), int(j), pose, gtsam.noiseModel.Isotropic.Sigma(6, 1.0)))
    start = gtsam.Pose3(gtsam.Rot3(frames.rotations[0]), frames.translations[0])
    graph.add(gtsam.PriorFactorPose3(0, start, gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    theirs = gtsam.InitializePose3.computeOrientationsChordal(gtsam.InitializePose3.buildPose3graph(graph))
    ours = chordal(even, knowing(frames, 0)).rotations
    anchor = frames.rotations[0] @ theirs.atRot3(0).matrix().T
    apart = [np.abs(anchor @ theirs.atRot3(n).matrix() - ours[n]).max() for n in range(COUNT)]
    # GTSAM lets its first matrix shrink by a prior of weight 1: a difference of the second order in the noise of 0.05
    assert max(apart) < 0.01


def test_what_nothing_connects_is_no_answer():
    motions, frames = measured(2, np.random.default_rng(3))
    apart = Motions(
        first=motions.first[:5], second=motions.second[:5], turns=motions.turns[:5], shifts=None,
        stiffness=motions.stiffness[:5],
    )  # fmt: skip
    assert chordal(apart, knowing(frames, 0)) is None


def test_a_tree_takes_the_foremost_edges_first():
    first, second = np.array([0, 1, 2, 0, 1]), np.array([3, 3, 3, 1, 2])
    assert foremost_edges(4, first, second, np.array([1.0, 1, 1, 0, 0])).tolist() == [0, 3, 4]


GRAPH = """
(problem graph
  (data places external :key id)
  (data steps external)
  (unknowns (T (pose 3) :per places :fixed (= id 0)))
  (observe steps (= (pose3 (quaternion qw qx qy qz) [x y z]) (between (T from) (T to))) :sigma 0.4))
"""


def test_a_graph_that_is_too_noisy_for_a_tree_is_solved_without_a_start():
    """A grid of 6 × 6 × 6 poses, turns to 0.4 rad: along a tree errors add up, and lead to another minimum."""
    generator = np.random.default_rng(1)
    side = 6
    places = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    turns = Rotation.random(len(places), random_state=2)
    apart = np.abs(places[:, None] - places).sum(axis=2)
    i, j = np.nonzero(np.triu(apart == 1))
    seen = turns[i].inv() * turns[j] * Rotation.from_rotvec(generator.normal(0, 0.4, (len(i), 3)))
    moved = turns[i].inv().apply(places[j] - places[i]) + generator.normal(0, 0.4, (len(i), 3))
    qx, qy, qz, qw = seen.as_quat().T
    steps = dict(
        zip(("from", "to", "x", "y", "z", "qx", "qy", "qz", "qw"), (i, j, *moved.T, qx, qy, qz, qw), strict=True)
    )
    data = {"places": {"id": np.arange(float(len(places)))}, "steps": {k: v.astype(float) for k, v in steps.items()}}
    solve = mbm.loads(GRAPH).solve(data=data)
    assert solve.first.status.trusted
    assert 1e-3 < solve.first.chi2_p < 1 - 1e-3
    # … and costs what the minimum beside the truth costs
    qx, qy, qz, qw = (turns[0].inv() * turns).as_quat().T
    x, y, z = turns[0].inv().apply(places - places[0]).T
    data["places"] |= {"x": x, "y": y, "z": z, "qx": qx, "qy": qy, "qz": qz, "qw": qw}
    init = GRAPH.replace("per places", "per places :init (pose3 (quaternion qw qx qy qz) [x y z])")
    beside = mbm.loads(init).solve(data=data).first
    assert solve.first.cost == pytest.approx(beside.cost, rel=1e-9)


@pytest.mark.parametrize(("others", "x"), [("", (1.0,)), ("(0 2 2 0.1 0) (0 1 1.02 0 0.1)", (1.01, 2.0))])
def test_edges_that_all_start_at_what_is_fixed(others, x):
    """A star: each pose is the mean of what its edges say."""
    poses = " ".join(f"({k})" for k in range(len(x) + 1))
    solve = mbm.loads(f"""(problem star
      (data e (table (i j x y z) (0 1 1 0 0.1) {others}))
      (data n (table (k) {poses}) :key k)
      (unknowns (T (pose 3) :per n :fixed (= k 0)))
      (observe e (= (pose3 (euler 0 0 0.1) [x y z]) (between (T i) (T j))) :sigma 0.05))""").solve()
    found = solve.first["T"].translation[1:, 0]
    assert found == pytest.approx(x, abs=1e-9)
