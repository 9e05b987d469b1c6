"""Random starts lie as wide as the data suggest, also about a start that fits already, and come after the own ones."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

ROOM = """(problem m (data st (table (id x y z) (1 0 0 2) (2 4 0 2) (3 0 5 2)) :key id)
  (data r (table (s range) (1 1.9) (2 3.8) (3 4.6)) :with (st s))
  (unknowns (p (vector 3) {init}))
  (observe r (= range (distance p [st.x st.y st.z])) :sigma 0.01)
  (solve :starts (random {count})))"""


AT_A_SOLUTION = ":init [0.64625 0.745 3.623987665]"
"""A single random start beside it may end on either side, so two starts are too few here."""


@pytest.mark.parametrize(("init", "count"), [("", 2), ("", 20), (AT_A_SOLUTION, 20)])
def test_the_mirror_image_below_coplanar_stations(init, count):
    solve = mbm.loads(ROOM.format(init=init, count=count)).solve().first
    heights = sorted([solve.estimates[0].value[2], *(a.estimates[0].value[2] for a in solve.alternatives)])
    # z = 2 ± sqrt(1.9² − x² − y²), x and y from the differences of the squared ranges
    height = (1.9**2 - 0.64625**2 - 0.745**2) ** 0.5
    assert heights == pytest.approx([2 - height, 2 + height], rel=1e-9)
    assert "mirror image" in solve.alternatives[0].remark
    assert solve.starts.tried == count


def test_points_on_a_line_leave_one_rotation_and_one_solution():
    """Poses of a straight rod: the turn about it is free to any extent, which is one solution and not many."""
    text = """(problem p (data d (table (x u v w) (1 2 0 0) (2 3 0 0) (3 4 0 0))) (unknowns (T (pose 3)))
      (observe d (= [u v w] (transform T [x 0 0])) :sigma 0.01))"""
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.UNOBSERVABLE
    assert found.first.starts.converged == found.first.starts.tried
    assert found.first.alternatives == ()
    assert (found.observability.rank, found.observability.dimension) == (5, 6)
    assert found["T"].value[4:] == pytest.approx([1, 0, 0], abs=1e-9)


def test_a_line_written_with_the_opposite_direction_is_one_solution():
    """(α + π, −ρ) turns the signs of all residuals and is the same line."""
    text = """(problem p (data d (table (x y) (0 1.01) (1 1.49) (2 2.01) (3 2.5))) (unknowns (al angle) (rho))
      (observe d (- (- (* y (cos al)) (* x (sin al))) rho) :sigma 0.01) (solve :starts (random 20)))"""
    solve = mbm.loads(text).solve().first
    assert solve.alternatives == ()
    assert solve.starts.best_found == solve.starts.tried


def test_a_range_is_drawn_from_where_others_are_drawn_at_random():
    """From the middle of the range, a frequency of 2.75, no phase leads to the 2.1 of the data."""
    x = np.linspace(0, 9, 40)
    text = """(problem p (data d external) (unknowns (a) (w :in (0.5 5)) (ph angle) (c))
      (observe d (= y (+ c (* a (sin (+ (* w x) ph))))) :sigma 0.02))"""
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": 1 + 5 * np.sin(2.1 * x + 0.4)}})
    assert float(found["w"].value) == pytest.approx(2.1, rel=1e-9)
    assert float(abs(found["a"].value)) == pytest.approx(5, rel=1e-9)


def _graph(seed: int, poses: int) -> str:
    """A walk with loops, measured with the stated noise; the stated starts are far from everything."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0.0, 0.8, poses))
    walk = np.cumsum(np.column_stack([np.cos(turns), np.sin(turns)]), axis=0)
    pairs = [(i, i + 1) for i in range(poses - 1)] + [(i, i + 5) for i in range(0, poses - 5, 3)] + [(0, poses - 1)]
    edges = []
    for i, j in pairs:
        c, s = np.cos(turns[i]), np.sin(turns[i])
        x, y = np.array([[c, s], [-s, c]]) @ (walk[j] - walk[i]) + rng.normal(0.0, 0.05, 2)
        edges.append(f"({i} {j} {x:.5f} {y:.5f} {turns[j] - turns[i] + rng.normal(0.0, 0.02):.5f})")
    nodes = [f"({i} {x:.1f} {y:.1f} {a:.2f})" for i, (x, y, a) in enumerate(rng.uniform(-1000, 1000, (poses, 3)))]
    return f"""(problem walk
      (data n (table (id x y a) {" ".join(nodes)}) :key id) (data e (table (from to dx dy da) {" ".join(edges)}))
      (unknowns (T (pose 2) :per n :init (pose2 x y a) :fixed (= id 0)))
      (observe e (= (pose2 dx dy da) (between (T from) (T to))) :sigma [0.05 0.05 0.02])"""


@pytest.mark.parametrize("seed", [0, 3])
def test_more_starts_are_never_worse_than_none(seed: int) -> None:
    """The closed form along the edges leads to the minimum: χ² is within five standard deviations of its mean."""
    for asked in ("", f"(solve :starts (random 4 :seed {seed}))"):
        solve = mbm.loads(f"{_graph(seed, 150)} {asked})").solve().solves[0]
        assert solve.status == "converged"
        assert abs(solve.cost - solve.dof) < 5.0 * np.sqrt(2.0 * solve.dof)
    assert solve.starts.tried in (4, 5)  # and the closed form, where none led there
    assert all(other.cost > solve.cost for other in solve.alternatives)
