"""What a row costs: values, and values with Jacobian, by backend and number of rows."""

from __future__ import annotations

import numpy as np

import mbm
from benchmarks.machine import best, machine, show
from benchmarks.scenes import RANGE, REPROJECTION, range_rows, reprojection_rows
from mbm.kernels.backends import casadi_map, numpy_stream
from mbm.kernels.types import Kernel

DESK = """
(problem desk
  (data corners external)
  (constants (k0 800) (k1 800))
  (unknowns (psi angle :init 0.2) (xg :init 2.5m) (yg :init 0m) (x :init 0.6m) (y :init 0.35m) (h :init 0.7m))
  (observe corners
    (= [X Y] (perse (trans [xg yg -1.5m] (rotate [0 0 psi] (vertex (box x y h) n)))))
    :sigma 2))
"""
ROWS = (1, 16, 64, 128, 256, 1024, 16_384)


def skeleton_text() -> str:
    """Four chains of three joints on a turning torso: 23 unknowns, the last joint of each chain in the image."""
    limbs = " ".join(f"(q{i} (vector 4) :init [0.1 0.2 0.3 0.4])" for i in range(1, 5))
    points = " ".join(
        f"(= [X{i} Y{i}] (perse (trans w (rotate v (rotate [0 0 s] (trans [0 0.2 {0.1 * i}]"
        f" (rotate [(q{i} 1) (q{i} 2) (q{i} 3)] (trans [0.3 0 0] (rotate [0 0 (q{i} 4)] [0.26 0 0])))))))))"
        for i in range(1, 5)
    )
    return f"""
(problem skeleton
  (data image external)
  (constants (k0 800) (k1 800))
  (unknowns (w (vector 3) :init [4m 0.1m 0.2m]) (v (vector 3) :init [0.1 0.2 2.8]) (s :init 0.3)
            {limbs})
  (observe image {points} :sigma 0.5))
"""


def kernels() -> dict[str, Kernel]:
    """One kernel of each kind."""
    image = {f"{c}{i}": np.zeros(2) for c in "XY" for i in range(1, 5)}
    desk = {"n": np.array([1.0, 1.0]), "X": np.zeros(2), "Y": np.zeros(2)}
    problems = {
        "range": (RANGE, {"ranges": range_rows(2)}),
        "reprojection": (REPROJECTION, {"marks": reprojection_rows(2)}),
        "desk corner": (DESK, {"corners": desk}),
        "skeleton, four limbs": (skeleton_text(), {"image": image}),
    }
    return {name: mbm.loads(text).compile(data=data).kernels.kernels[0] for name, (text, data) in problems.items()}


def main() -> None:
    print(machine())
    for name, kernel in kernels().items():
        counts = (len(kernel.value_program.instructions), len(kernel.jacobian_program.instructions))
        print(
            f"\n{name}: {counts[0]} instructions for the values, {counts[1]} with the Jacobian; ns a row, best of seven"
        )
        lines = []
        for rows in ROWS:
            cells = [f"{rows:,}"]
            both = []
            for backend in (casadi_map.BACKEND, numpy_stream.BACKEND):
                evaluation = backend.prepare(kernel, rows)
                evaluation.inputs[:] = np.random.default_rng(1).uniform(0.5, 1.5, evaluation.inputs.shape)
                evaluation.values()
                evaluation.values_and_jacobian()
                seconds = [best(evaluation.values, 7), best(evaluation.values_and_jacobian, 7)]
                cells.extend(f"{1e9 * s / rows:.0f}" for s in seconds)
                both.append(seconds[1])
            lines.append([*cells, f"{both[1] / both[0]:.2f}"])
        show(["rows", "CasADi", "with Jacobian", "NumPy", "with Jacobian", "NumPy / CasADi"], lines)


if __name__ == "__main__":
    main()
