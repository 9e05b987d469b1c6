"""Real camera trajectories laid on motion capture: association, similarity and rigid alignment, against Umeyama's."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm
from tests.evidence.material import measured

ALIGN = """
(problem align
  (data truth (tum "{truth}"))
  (data track (tum "{track}"))
  (pair both (track truth) :by t :tolerance 20ms)
  (unknowns (S {kind}))
  (observe both
    (= [truth.x truth.y truth.z] (transform S [track.x track.y track.z]))
    :sigma 1cm))
"""


def aligned(track, truth, kind):
    """The problem solved, its rows, and the transformation as numbers."""
    paths = [measured("trajectory", name).as_posix() for name in (truth, track)]
    solved = mbm.loads(ALIGN.format(truth=paths[0], track=paths[1], kind=kind)).solve()
    assert solved.status == "ok"
    (solve,) = json.loads(solved.to_json())["solves"]
    return solve, solve["estimates"]["S"]["value"]


def loaded(name):
    return np.loadtxt(measured("trajectory", name), ndmin=2)


def umeyama(track, truth, rows, *, scaled):
    """The alignment of Umeyama (1991) over associated rows: scale, rotation, translation, root mean square error."""
    p, q = track[rows[0], 1:4], truth[rows[1], 1:4]
    pc, qc = p - p.mean(axis=0), q - q.mean(axis=0)
    u, d, vt = np.linalg.svd(qc.T @ pc / len(p))
    s = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ s @ vt
    scale = np.trace(np.diag(d) @ s) / pc.var(axis=0).sum() if scaled else 1.0
    shift = q.mean(axis=0) - scale * rotation @ p.mean(axis=0)
    left = q - scale * p @ rotation.T - shift
    return scale, rotation, shift, np.sqrt(np.square(left).sum(axis=1).mean())


def greedy(track, truth, tolerance):
    """The association of the TUM tools: all pairs within the tolerance, the nearest first, each row once."""
    a, b = track[:, 0], truth[:, 0]
    near = [(abs(a[i] - b[j]), i, j) for i in range(len(a)) for j in np.flatnonzero(np.abs(b - a[i]) < tolerance)]
    used_a, used_b, found = set(), set(), []
    for _, i, j in sorted(near):
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            found.append((i, j))
    return np.array(sorted(found)).T


@pytest.mark.parametrize(
    ("track", "truth", "scaled", "rmse", "scale"),
    [
        ("fr2_desk_ORB_kf_mono.txt", "fr2_desk_groundtruth.txt.gz", True, 0.0079, 2.228),
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt", True, 0.0134, None),
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt", False, None, 1.0),
    ],
)
def test_the_alignment_is_that_of_umeyama(track, truth, scaled, rmse, scale):
    solve, motion = aligned(track, truth, "(similarity 3)" if scaled else "(pose 3)")
    a, b = loaded(track), loaded(truth)
    rows = greedy(a, b, 0.02)
    wanted_scale, rotation, shift, error = umeyama(a, b, rows, scaled=scaled)
    assert solve["residuals"]["both"]["used"] == rows.shape[1]
    # Times of 1.3e9 s and places of metres: eleven digits of a well-conditioned alignment.
    assert motion.get("scale", 1.0) == pytest.approx(wanted_scale, rel=1e-10)
    np.testing.assert_allclose(motion["matrix"], rotation, atol=1e-10)
    np.testing.assert_allclose(motion["translation"], shift, atol=1e-10)
    found = np.sqrt(solve["cost"] * 0.01**2 / rows.shape[1])
    assert found == pytest.approx(error, rel=1e-10)
    if rmse is not None:
        assert found == pytest.approx(rmse, abs=1e-4)  # the digits that are published
    if scale is not None:
        assert motion.get("scale", 1.0) == pytest.approx(scale, abs=1e-3)
