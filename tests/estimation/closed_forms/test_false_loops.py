"""Pose graphs without vertices, with false loops, robustly: as far off as without them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.starts.closed_forms.numerics.chordal import Motions
from mbm.estimation.starts.closed_forms.numerics.consistency import _cycles, agreeing_loops
from mbm.rotations import planar

GRAPH = """(problem graph
  (data places external :key id)
  (data edges external)
  (unknowns (T (pose 2) :per places :fixed (= row 1)))
  (observe edges (= (pose2 x y a) (between (T from) (T to))) :sigma [0.01 0.03 0.03] %s)"""


def graph(false, count=150, true=40, wrong=None):
    """A walk of 150 steps in a square, 40 true loops, and ``false`` ones between places drawn at random.

    The step ``wrong`` is 2.5 m and 46 degrees off.
    """
    g = np.random.default_rng(4)
    heading, places = np.zeros(count), np.zeros((count, 2))
    for k in range(1, count):
        heading[k] = heading[k - 1] + (np.pi / 2 * g.choice([-1, 1]) if g.random() < 0.25 else 0.0)
        ahead = np.array([np.cos(heading[k]), np.sin(heading[k])])
        if np.abs(places[k - 1] + ahead).max() > 7:
            heading[k] += np.pi
            ahead = -ahead
        places[k] = places[k - 1] + ahead
    near = np.linalg.norm(places[:, None] - places, axis=2) < 2
    loops = [(i, j) for i, j in np.argwhere(near) if j > i + 10]
    pairs = [(i, i + 1) for i in range(count - 1)] + [loops[k] for k in g.permutation(len(loops))[:true]]
    rows = []
    for i, j in pairs:
        c, s = np.cos(heading[i]), np.sin(heading[i])
        seen = np.array([[c, s], [-s, c]]) @ (places[j] - places[i])
        rows.append((i, j, *(seen + 0.03 * g.normal(size=2)), heading[j] - heading[i] + 0.01 * g.normal()))
    if wrong is not None:
        rows[wrong] = tuple(np.add(rows[wrong], (0, 0, 2.0, 1.5, 0.8)))
    for _ in range(false):
        i, j = sorted(g.choice(count, 2, replace=False))
        rows.append((i, j, *g.uniform(-2, 2, 2), g.uniform(-3, 3)))
    edges = dict(zip(("from", "to", "x", "y", "a"), np.transpose(rows), strict=True))
    return {"places": {"id": np.arange(float(count))}, "edges": edges}, places


def off(how, *drawn):
    """Root mean square distance from the true places, after shifts and turns."""
    data, places = graph(*drawn)
    found = mbm.loads(GRAPH % how).solve(data=data)["T"].value[:, 1:]
    one, two = found - found.mean(axis=0), places - places.mean(axis=0)
    left, _, right = np.linalg.svd(one.T @ two)
    return np.sqrt(np.square(one @ left @ right - two).sum(axis=1).mean())


@pytest.mark.parametrize(
    "how", [":loss tukey)", ":loss cauchy)", ") (solve :robust ransac)", ") (solve :robust lmeds)"]
)
def test_false_loops_leave_a_graph_where_it_is(how):
    """Up to twice as many as true ones."""
    clean = off(how, 0)
    assert clean < 0.2  # an edge scatters by 0.03
    assert max(off(how, false) for false in (5, 20, 80)) < 2 * clean


@pytest.mark.parametrize("how", [":loss tukey)", ") (solve :robust ransac)"])
@pytest.mark.parametrize("wrong", [52, 110])
def test_loops_tell_a_wrong_step_of_the_chain(how, wrong):
    """Those that span it do not close with the chain, and agree with one another, which false loops do not.

    Other loops end at both of its ends, so that it is none of its neighbours.
    """
    assert off(how, 20, 150, 40, wrong) < 2 * off(how, 0)


@pytest.mark.parametrize("how", ["ransac", "gnc"])
@pytest.mark.parametrize("count", [20, 25])
def test_small_graphs_keep_the_loops_that_agree(how, count):
    """As many false loops as true ones: of few unknowns, and of more than subsets are drawn for (60)."""
    how = f") (solve :robust {how})"
    assert off(how, 10, count, 10) < 2 * off(how, 0, count, 10)


def test_a_wrong_step_between_the_ends_of_loops_is_said_to_be_any_of_them():
    """The places from the fourth on lie elsewhere by whichever step is left out, at one cost."""
    found = mbm.loads(GRAPH % ") (solve :robust gnc)").solve(data=graph(0, 40, 20, 5)[0])
    (said,) = (each.message for each in found.first.diagnostics if each.code.name == "ambiguous-consensus")
    assert said.startswith("row 3 of `edges` is left out, and one of rows 4, 5, 6, 7")  # row 6 is the step from place 5


@pytest.mark.parametrize(("wrong", "false"), [(24, 0), (24, 20), (None, 20)])
def test_a_wrong_step_that_is_trusted_is_said(wrong, false):
    """True loops across it are left out, and agree with one another; false ones do not."""
    text = GRAPH % ") (solve :robust (gnc :quantile 99% :trust (= (- to from) 1)))"
    data, _ = graph(false, 60, 30, wrong)
    edges = data["edges"]
    odometry = np.arange(len(edges["x"])) < 59
    kept = odometry | (edges["to"] - edges["from"] != 1)  # false loops between neighbours would be trusted
    data["edges"] = {name: each[kept] for name, each in edges.items()}
    said = [each.message for each in mbm.loads(text).solve(data=data).first.diagnostics]
    assert ["a trusted step of `T`, from 24 to 25 or" in each for each in said] == [True] * (wrong is not None)


@pytest.mark.parametrize("gap", [False, True])
def test_loops_that_agree_with_a_chain_and_one_another_are_told_from_others(gap):
    """Nothing of a pose graph but its motions, of which one step may be missing; true loops within their noise."""
    count, false = 150, 200
    edges = {name: np.array(each) for name, each in graph(false, count)[0]["edges"].items()}
    chain = np.delete(np.arange(count - 1), 70) if gap else np.arange(count - 1)
    first, second = edges["from"].astype(int), edges["to"].astype(int)
    shifts = np.stack([edges["x"], edges["y"]], axis=1)
    motions = Motions(
        first=first,
        second=second,
        turns=planar(edges["a"]),
        shifts=shifts,
        stiffness=np.tile([0.01**-2, 0.03**-2], (len(first), 1)),
    )
    found = agreeing_loops(motions, shifts, chain)
    assert found[chain].all()
    assert found[count - 1 : -false].sum() > 30  # of 40: within twice their noise
    assert not found[-false:].any()  # drawn from 100 times the area, and all turns


@pytest.mark.parametrize("size", [2, 3])
def test_of_true_loops_as_many_close_in_the_plane_as_in_space(size):
    """20,000 loops beside one exact step: one in 2,000 does not close, which is 10 ± 3."""
    count, noise, g = 20_000, 1e-3, np.random.default_rng(7)
    turns, shifts = np.tile(np.eye(size), (count + 1, 1, 1)), np.tile(np.eye(size)[0], (count + 1, 1))
    angles = noise * g.normal(size=(count, 3 if size == 3 else 1))
    turns[1:] = Rotation.from_rotvec(angles).as_matrix() if size == 3 else planar(angles[:, 0])
    shifts[1:] += noise * g.normal(size=(count, size))
    stiffness = np.full((count + 1, 2), noise**-2)
    stiffness[0] = 1e18
    ends = np.zeros(count + 1, dtype=np.int64)
    motions = Motions(first=ends, second=ends + 1, turns=turns, shifts=shifts, stiffness=stiffness)
    assert abs((~_cycles(motions, shifts, np.array([0])).closed).sum() - 10) < 4 * np.sqrt(10)
