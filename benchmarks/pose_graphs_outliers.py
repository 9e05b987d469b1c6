"""Pose graphs with false loops: mbm plain, with `gnc` and trusted odometry, beside GTSAM's GNC, on the same graphs.

The graphs are those of the shared material (``MBM_SHARED``, or beside the checkout), without their vertices, with 0, 5,
20 or 100 false loops between places drawn at random. GTSAM starts from odometry (and from the chordal relaxation in
space), knows the odometry as inliers, and its limit is the same quantile of χ². The error is the rms distance from the
places of the clean graph, after a rigid alignment; a plain solve is to doubt itself.

    python -m benchmarks.pose_graphs_outliers [graph …]
"""

from __future__ import annotations

import gzip
import os
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.peers import ROOT

SHARED = Path(os.environ.get("MBM_SHARED", ROOT.parent / "shared")) / "data" / "posegraph"
GRAPHS = {
    "intel.g2o": 2,
    "CSAIL.g2o": 2,
    "manhattan.g2o.gz": 2,
    "smallGrid3D.g2o": 3,
    "parking-garage.g2o.gz": 3,
}
FALSE = (0, 5, 20, 100)
MEASURED = {2: "(pose2 dx dy dtheta)", 3: "(pose3 (quaternion dqw dqx dqy dqz) [dx dy dz])"}
TEXT = """
(problem graph
  (data places (g2o "{path}" :vertices))
  (data edges (g2o "{path}" :edges))
  (unknowns (T (pose {dimension}) :per places :fixed (= row 1)))
  (observe edges (= {measured} (between (T from) (T to))) :information information)
  {solve})
"""
TRUSTING = "(solve :robust (gnc :quantile 99% :trust (= (- to from) 1)))"


def edges_of(name: str, false: int) -> list[str]:
    """The lines of the edges, the false ones last; their noise is that of edges drawn at random."""
    path = SHARED / name
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    edges = [line for line in text.splitlines() if line.startswith("EDGE")]
    dimension = GRAPHS[name]
    generator = np.random.default_rng(false)
    numbers = sorted({int(word) for line in edges for word in line.split()[1:3]})
    reach = max(abs(float(word)) for line in edges for word in line.split()[3 : 3 + dimension])
    found: list[str] = []
    while len(found) < false:
        i, j = generator.choice(numbers, 2, replace=False)
        if abs(i - j) > 1:
            like = edges[generator.integers(len(edges))].split()
            shift = generator.normal(0, 0.5 * reach, dimension)
            turn = generator.normal(size=4) if dimension == 3 else generator.uniform(-3, 3, 1)
            turn = turn / np.linalg.norm(turn) if dimension == 3 else turn
            width = 3 + dimension + len(turn)
            found.append(" ".join(map(str, (like[0], i, j, *shift, *turn, *like[width:]))))
    return [*edges, *found]


def apart(places: Any, others: Any) -> float:
    """The rms distance after a rigid alignment."""
    A, B = places - places.mean(axis=0), others - others.mean(axis=0)
    U, _, V = np.linalg.svd(A.T @ B)
    turn = np.diag([1.0] * (A.shape[1] - 1) + [np.linalg.det(U @ V)])
    return float(np.sqrt(np.square(A @ U @ turn @ V - B).sum(axis=1).mean()))


def ours(path: Path, dimension: int, solve: str) -> tuple[Any, str, float]:
    """The places, what is said of them, seconds."""
    import mbm

    text = TEXT.format(path=path.as_posix(), dimension=dimension, measured=MEASURED[dimension], solve=solve)
    problem = mbm.loads(text)
    problem.compile()
    began = perf_counter()
    found = problem.solve()
    seconds = perf_counter() - began
    codes = ", ".join(each.code.name for each in found.first.diagnostics)
    return found["T"].value[:, -dimension:], f"{found.status} {codes}".strip(), seconds


def theirs(path: Path, dimension: int) -> tuple[Any, float]:
    """The places by GTSAM's GNC, seconds."""
    import gtsam
    from scipy.stats import chi2

    space = dimension == 3
    graph, _ = gtsam.readG2o(str(path), space)
    factors = [graph.at(i) for i in range(graph.size())]
    ends = [tuple(factor.keys()) for factor in factors]
    keys = sorted({key for pair in ends for key in pair})
    began = perf_counter()
    first = gtsam.Pose3() if space else gtsam.Pose2()
    values = gtsam.Values()
    values.insert(keys[0], first)
    steps = {pair: f.measured() for pair, f in zip(ends, factors, strict=True) if pair[1] - pair[0] == 1}
    for before, key in pairwise(keys):
        at = values.atPose3(before) if space else values.atPose2(before)
        values.insert(key, at.compose(steps[before, key]))
    prior = gtsam.PriorFactorPose3 if space else gtsam.PriorFactorPose2
    graph.add(prior(keys[0], first, gtsam.noiseModel.Isotropic.Sigma(6 if space else 3, 1e-6)))
    parameters = gtsam.GncLMParams()
    known = [i for i, (before, key) in enumerate(ends) if key - before == 1]
    parameters.setKnownInliers([*known, len(factors)])
    optimiser = gtsam.GncLMOptimizer(graph, values, parameters)
    optimiser.setInlierCostThresholds(0.5 * chi2.ppf(0.99, 6 if space else 3))
    best = optimiser.optimize()
    pose = best.atPose3 if space else best.atPose2
    places = np.array([np.ravel(pose(key).translation()) for key in keys])
    return places, perf_counter() - began


def main() -> None:
    """A line for each graph and number of false loops."""
    for name in sys.argv[1:] or GRAPHS:
        dimension = GRAPHS[name]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "graph.g2o"
            clean = None
            for false in FALSE:
                path.write_text("\n".join(edges_of(name, false)) + "\n")
                plain, said, seconds = ours(path, dimension, "")
                clean = plain if clean is None else clean
                robust, told, longer = ours(path, dimension, TRUSTING)
                line = f"{name} {false}: plain {apart(plain, clean):.3f} m ({said}; {seconds:.1f} s)"
                line += f", gnc {apart(robust, clean):.3f} m ({told}; {longer:.1f} s)"
                try:
                    places, took = theirs(path, dimension)
                    line += f", GTSAM {apart(places, clean):.3f} m ({took:.1f} s)"
                except (ImportError, RuntimeError, KeyError) as error:
                    line += f", GTSAM failed: {type(error).__name__}"
                print(line, flush=True)


if __name__ == "__main__":
    main()
