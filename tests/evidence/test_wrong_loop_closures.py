"""A real pose graph (Intel research lab) with fifteen made-up loop closures: exactly those are left out."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.material import measured

TEXT = """
(problem graph
  (data nodes (g2o "graph.g2o" :vertices) :key id)
  (data edges (g2o "graph.g2o" :edges :information from))
  (unknowns (T (pose 2) :per nodes :init (pose2 x y theta) :fixed (= row 1)))
  (observe edges (= (pose2 dx dy dtheta) (between (T from) (T to))) :information information {loss})
  {solve})
"""
WRONG = 15


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "solve"), [("", "(solve :robust gnc)"), (":loss geman-mcclure", "")])
def test_wrong_loop_closures_are_found_among_five_thousand_unknowns(tmp_path, loss, solve):
    lines = measured("posegraph", "intel.g2o").read_text().splitlines()
    nodes = [line for line in lines if line.startswith("VERTEX")]
    edges = [line for line in lines if line.startswith("EDGE")]
    generator = np.random.default_rng(0)
    numbers = [int(line.split()[1]) for line in nodes]
    for _ in range(WRONG):
        first, second = generator.choice(numbers, 2, replace=False)
        x, y = generator.normal(size=2)
        edges.append(f"EDGE_SE2 {first} {second} {x} {y} {generator.uniform(-3, 3)} 500 0 0 500 0 5000")
    (tmp_path / "graph.g2o").write_text("\n".join([*nodes, *edges]) + "\n")
    (tmp_path / "p.mbm").write_text(TEXT.format(loss=loss, solve=solve))
    result = mbm.load(tmp_path / "p.mbm").solve().solves[0]
    assert result.status.trusted
    assert list(result.residual_summaries["edges"].outliers) == list(range(len(edges) - WRONG + 1, len(edges) + 1))
    if not loss:
        # The best χ² that is known for the graph without the wrong edges.
        assert result.cost == pytest.approx(44.418, abs=5e-4)
