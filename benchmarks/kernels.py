"""What a row costs, residuals with their Jacobian: by interpreters and by machine code, beside the memory's limit."""

from __future__ import annotations

import ctypes
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import best, machine, show
from benchmarks.scenes import RANGE, REPROJECTION, range_rows, reprojection_rows
from mbm.kernels.backends import casadi_map, native, numpy_stream
from mbm.kernels.native.engine import compiled, vector_library
from mbm.kernels.native.kernels import KernelCode
from mbm.kernels.native.normal import Unit, normal_kernels, normal_rows
from mbm.kernels.types import Kernel
from mbm.machine import straight_line
from mbm.machine.kinds import LANES
from mbm.machine.program import Program
from mbm.solver.description import NO_LOSS

DESK = """
(problem desk
  (data corners external)
  (constants (k0 800) (k1 800))
  (unknowns (psi angle :init 0.2) (xg :init 2.5m) (yg :init 0m) (x :init 0.6m) (y :init 0.35m) (h :init 0.7m))
  (observe corners
    (= [X Y] (perse (trans [xg yg -1.5m] (rotate [0 0 psi] (vertex (box x y h) n)))))
    :sigma 2))
"""
ROWS = (4, 64, 1024, 16_384)
MEMORY = 2**27
"""Bytes of results that no cache holds: there the stores alone show what memory takes."""


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


def of_tables(kernel: Kernel, rows: int) -> list[float]:
    """Seconds for tables of rows: CasADi, NumPy, machine code."""
    found = []
    for backend in (casadi_map.BACKEND, numpy_stream.BACKEND, native.backend(None)):
        evaluation = backend.prepare(kernel, rows)
        evaluation.inputs[:] = np.random.default_rng(1).uniform(0.5, 1.5, evaluation.inputs.shape)
        evaluation.values_and_jacobian()
        found.append(best(evaluation.values_and_jacobian, 7))
    return found


def storing(program: Program) -> Program:
    """A program that only stores: as many outputs, all of them the first input."""
    held = (0, *(-1 for _ in program.inputs[1:]))
    return Program(values=1, inputs=held, constants=(), instructions=(), outputs=(0,) * len(program.outputs))


def of_blocks(kernel: Kernel, rows: int) -> list[float]:
    """Seconds for blocks of rows: machine code, only its stores, and normal equations summed without a Jacobian."""
    program, blocks = kernel.jacobian_program, -(-rows // LANES)
    code = KernelCode(None).of([kernel], rows)
    store = compiled(straight_line.module_of({"store": storing(program)}, vector_library()), None, 1)
    units = tuple(Unit(first=o, last=o + 1, loss=NO_LOSS) for o in range(kernel.outputs))
    sums = normal_kernels({0: kernel}, {0: units}, None)
    inputs = np.random.default_rng(1).uniform(0.5, 1.5, (blocks, len(program.inputs), LANES))
    outputs = np.empty((blocks, len(program.outputs), LANES))
    weights = np.ones((blocks, kernel.outputs, LANES))
    losses, total = np.zeros(2 * len(units)), np.zeros(normal_rows(kernel, units).sums)
    found = []
    for address, arrays in (
        (code.jacobian_address(0), (inputs, outputs)),
        (store.address("store"), (inputs, outputs)),
        (sums.normal_address(0), (inputs, weights, losses, total)),
    ):
        call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays), ctypes.c_int64)(address)
        places = [a.ctypes.data for a in arrays]
        many = max(1, 4096 // rows)
        found.append(
            best(lambda call=call, places=places, many=many: [call(*places, blocks) for _ in range(many)], 9) / many
        )
    return found


def compiling(kernel: Kernel) -> list[float]:
    """Seconds until values and Jacobian are machine code: made fast, running fast."""
    text = straight_line.module_of({"v": kernel.value_program, "j": kernel.jacobian_program}, vector_library())
    return [best(lambda level=level: compiled(text, None, level), 3) for level in (0, 1)]


def main() -> None:
    start = perf_counter()
    vector_library()
    print(f"{machine()}; LLVM ready in {perf_counter() - start:.3f} s")
    for name, kernel in kernels().items():
        counts = (len(kernel.value_program.instructions), len(kernel.jacobian_program.instructions))
        seconds = compiling(kernel)
        print(
            f"\n{name}: {counts[0]} instructions for the values, {counts[1]} with the Jacobian;"
            f" compiled in {1e3 * seconds[0]:.0f} ms, for speed {1e3 * seconds[1]:.0f} ms"
        )
        lines = []
        beyond = MEMORY // (8 * len(kernel.jacobian_program.outputs))
        for rows in (*ROWS, beyond):
            tables = of_tables(kernel, rows) if rows in ROWS else []
            blocks = of_blocks(kernel, rows)
            times = [1e9 * s / rows for s in (*tables, *blocks)]
            cells = [f"{t:.0f}" if t >= 100 else f"{t:.1f}" for t in times]
            cells = ["–"] * (6 - len(cells)) + cells
            lines.append([f"{rows:,}", *cells, f"{blocks[0] / blocks[1]:.2f}"])
        show(["ns a row", "CasADi", "NumPy", "native", "blocks", "stores alone", "JᵀJ", "blocks / stores"], lines)


if __name__ == "__main__":
    main()
