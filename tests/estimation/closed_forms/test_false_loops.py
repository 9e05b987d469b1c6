"""Pose graphs without vertices under a loss, with false loops: as far off as without them."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

GRAPH = """(problem graph
  (data places external :key id)
  (data edges external)
  (unknowns (T (pose 2) :per places :fixed (= row 1)))
  (observe edges (= (pose2 x y a) (between (T from) (T to))) :sigma [0.01 0.03 0.03] :loss %s))"""


def graph(false):
    """A walk of 150 steps in a square, 40 true loops, and ``false`` ones between places drawn at random."""
    g = np.random.default_rng(4)
    heading, places = np.zeros(150), np.zeros((150, 2))
    for k in range(1, 150):
        heading[k] = heading[k - 1] + (np.pi / 2 * g.choice([-1, 1]) if g.random() < 0.25 else 0.0)
        ahead = np.array([np.cos(heading[k]), np.sin(heading[k])])
        if np.abs(places[k - 1] + ahead).max() > 7:
            heading[k] += np.pi
            ahead = -ahead
        places[k] = places[k - 1] + ahead
    near = np.linalg.norm(places[:, None] - places, axis=2) < 2
    loops = [(i, j) for i, j in np.argwhere(near) if j > i + 10]
    pairs = [(i, i + 1) for i in range(149)] + [loops[k] for k in g.permutation(len(loops))[:40]]
    rows = []
    for i, j in pairs:
        c, s = np.cos(heading[i]), np.sin(heading[i])
        seen = np.array([[c, s], [-s, c]]) @ (places[j] - places[i])
        rows.append((i, j, *(seen + 0.03 * g.normal(size=2)), heading[j] - heading[i] + 0.01 * g.normal()))
    for _ in range(false):
        i, j = sorted(g.choice(150, 2, replace=False))
        rows.append((i, j, *g.uniform(-2, 2, 2), g.uniform(-3, 3)))
    edges = dict(zip(("from", "to", "x", "y", "a"), np.transpose(rows), strict=True))
    return {"places": {"id": np.arange(150.0)}, "edges": edges}, places


def off(loss, false):
    """Root mean square distance from the true places, after shifts and turns."""
    data, places = graph(false)
    found = mbm.loads(GRAPH % loss).solve(data=data)["T"].value[:, 1:]
    one, two = found - found.mean(axis=0), places - places.mean(axis=0)
    left, _, right = np.linalg.svd(one.T @ two)
    return np.sqrt(np.square(one @ left @ right - two).sum(axis=1).mean())


@pytest.mark.parametrize("loss", ["tukey", "cauchy"])
def test_false_loops_leave_a_graph_where_it_is(loss):
    """Up to half as many as true ones; of twice as many some are kept."""
    clean = off(loss, 0)
    assert clean < 0.2  # an edge scatters by 0.03
    assert max(off(loss, false) for false in (5, 20)) < 2 * clean
