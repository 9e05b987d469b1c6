"""Conformance of evaluation backends: `Backend` of `mbm.kernels.types`."""

from __future__ import annotations

import numpy as np

from mbm.api import loads
from mbm.equations.manifolds import moved
from mbm.kernels.serialised import function_of
from mbm.kernels.types import Backend, Floats, Kernel, KernelSet
from mbm.problem.manifold import Piece
from mbm.testing.requirement import require, require_close

ROWS = (0, 1, 2, 7, 1025)
"""Numbers of rows that are tried: none, one, and around the sizes of blocks."""

ROUNDING = 1e-11
"""A few units in the last place for each of the operations; fused multiplications and vector libraries move those."""

DIFFERENCE = 1e-6
"""Central differences with a step of 1e-6 are good to about 1e-9 of a value, and to 1e-6 beside strong curvature."""

STEP = 1e-6

SAMPLE = """
(problem sample
  (data rows (table (x y k) (1 2 1) (2 3 2) (3 5 1)))
  (constants (c 2))
  (unknowns (a :init 1) (b :init 2) (v (vector 3) :init [1 2 3]) (t angle :init 0.5) (f :per rows.k :init 1)
    (T (pose 3) :init (pose3 (rot-z 1) [1 2 3])) (S (similarity 2) :init (pose2 1 2 3)) (n direction :init [1 2 3])
    (P (pose 3) :per rows.k :init (pose3 (rot-x 1) [1 2 3])))
  (camera cam :focal (800 600) :center (320 240) :distortion (0.1 0.01 0.001 0.002 0.003))
  (observe rows
    (= y (+ (* a x) (/ b c) (f k)))
    (= y (if (< x a) (sqrt x) (exp (- (/ x b)))))
    (= [x y] (project cam (trans v (rotate [t 0.1 a] [x y 9]))))
    (= (pose3 (euler 0.1 0.2 x) [x y k]) (between T (P k)))
    (= [x y] (transform S [k a]))
    (= (pose3 (euler a 0.2 x) [x y k]) T)
    (= [x y k] n)
    (= t (atan2 (sin a) (+ 2 (cos b))))
    (= y (- (hypot a x) (^ b 2) (log (+ 2 (^ x 2))) (tan (/ a 9)) (sinh (/ a 3)) (cosh b) (tanh a)))
    (= y (+ (max a b x) (min a b x) (abs (- a 5)) (sign b) (mod x 3) (floor x)))
    (= y (+ (asin (/ a 9)) (acos (/ b 9)) (atan a) (asinh a) (acosh (+ 2 b)) (atanh (/ a 9)) (log10 (+ 3 b))))
    :sigma 1))
"""
"""A problem whose equations use nearly every operation of the language."""


def sample_kernels() -> KernelSet:
    """Kernels that use nearly every operation, to check a backend with."""
    kernels: KernelSet = loads(SAMPLE).compile().kernels
    return kernels


def check_backend(backend: Backend, kernels: KernelSet, *, seed: int = 1) -> None:
    """Whether a backend gives the numbers of the kernels: values, Jacobians, for any number of rows.

    Args:
        backend: the backend.
        kernels: what to evaluate, for instance ``sample_kernels()``; finite for inputs between 0.5 and 1.5.
        seed: of the random inputs.

    Raises:
        NotConformingError: it does not; the text says what was promised.

    """
    require(bool(backend.name), "a backend", "it has a name, as in `--backend`")
    random = np.random.default_rng(seed)
    for kernel in kernels.kernels:
        subject = f"backend `{backend.name}`, kernel `{kernel.name}` ({kernel.case + 1})"
        for rows in ROWS:
            _check_rows(backend, kernel, random.uniform(0.5, 1.5, (rows, _width(kernel))), subject)
        _check_jacobian(backend, kernel, random.uniform(0.6, 1.4, (3, _width(kernel))), subject)
        _check_independence(backend, kernel, random.uniform(0.5, 1.5, (4, _width(kernel))), subject)
        _check_stream(backend, kernel, random.uniform(0.5, 1.5, (max(ROWS), _width(kernel))), subject)


def _width(kernel: Kernel) -> int:
    return len(kernel.variables) + len(kernel.parameters)


def _reference(kernel: Kernel, inputs: Floats) -> tuple[Floats, Floats]:
    """Values and Jacobian nonzeros row by row, by CasADi's virtual machine."""
    function = function_of("values_and_jacobian", kernel.jacobian_program)
    both = [np.asarray(function(row), dtype=np.float64).reshape(-1) for row in inputs]
    table = np.array(both).reshape(len(inputs), kernel.outputs + len(kernel.jacobian_rows))
    return table[:, : kernel.outputs], table[:, kernel.outputs :]


def _check_rows(backend: Backend, kernel: Kernel, inputs: Floats, subject: str) -> None:
    which = f"{subject}, {len(inputs)} rows"
    evaluation = backend.prepare(kernel, len(inputs))
    require(evaluation.inputs.shape == inputs.shape, which, f"`inputs` has the shape {inputs.shape}")
    require(evaluation.inputs.dtype == np.float64, which, "`inputs` is float64")
    values, jacobian = _reference(kernel, inputs)
    for attempt, scale in (("", 1.0), (", called again with other inputs", 1.001)):
        evaluation.inputs[:] = inputs * scale
        if scale != 1.0:
            values, jacobian = _reference(kernel, inputs * scale)
        require_close(evaluation.values(), values, ROUNDING, which, f"`values`{attempt} are those of the kernel")
        found = evaluation.values_and_jacobian()
        require_close(found[0], values, ROUNDING, which, f"values beside the Jacobian{attempt} are those of the kernel")
        require_close(found[1], jacobian, ROUNDING, which, f"the Jacobian{attempt} is that of the kernel")


def _check_jacobian(backend: Backend, kernel: Kernel, inputs: Floats, subject: str) -> None:
    """Nonzero k is the derivative of output ``jacobian_rows[k]`` by tangent ``jacobian_columns[k]``; others are 0."""
    for chart in kernel.charts:
        if chart.piece in (Piece.QUATERNION, Piece.SPHERE):
            held = list(chart.variables)
            inputs[:, held] /= np.linalg.norm(inputs[:, held], axis=1, keepdims=True)
    evaluation = backend.prepare(kernel, len(inputs))
    evaluation.inputs[:] = inputs
    nonzeros = np.array(evaluation.values_and_jacobian()[1])
    dense = np.zeros((len(inputs), kernel.outputs, len(kernel.tangents)))
    dense[:, kernel.jacobian_rows, kernel.jacobian_columns] = nonzeros
    for chart in kernel.charts:
        held = list(chart.variables)
        for place, column in enumerate(chart.tangents):
            sides = []
            for sign in (1.0, -1.0):
                step = np.zeros((len(inputs), chart.piece.tangent))
                step[:, place] = sign * STEP
                evaluation.inputs[:] = inputs
                evaluation.inputs[:, held] = moved(chart.piece, inputs[:, held], step)
                sides.append(np.array(evaluation.values()))
            slope = (sides[0] - sides[1]) / (2 * STEP)
            promise = f"the derivatives by tangent {column} are those that differences show"
            require_close(dense[:, :, column], slope, DIFFERENCE, subject, promise)


def _check_stream(backend: Backend, kernel: Kernel, inputs: Floats, subject: str) -> None:
    """What `stream` gives takes any number of rows, and gives arrays of their own."""
    values, jacobian = _reference(kernel, inputs)
    stream = backend.stream(kernel)
    found = [stream.values_and_jacobian(inputs[:rows]) for rows in ROWS]
    for rows, (some, nonzeros) in zip(ROWS, found, strict=True):
        which = f"{subject}, a stream of {rows} rows"
        require_close(some, values[:rows], ROUNDING, which, "values beside the Jacobian are those of the kernel")
        require_close(nonzeros, jacobian[:rows], ROUNDING, which, "the Jacobian is that of the kernel")
        require_close(stream.values(inputs[:rows]), some, ROUNDING, which, "`values` are those beside the Jacobian")
    plain = backend.tabulated({"values": kernel.value_program})["values"]
    for rows, (some, _) in zip(ROWS, found, strict=True):
        which = f"{subject}, its program for {rows} rows"
        require_close(plain(inputs[:rows]), some, ROUNDING, which, "`tabulated` gives what the kernel does")


def _check_independence(backend: Backend, kernel: Kernel, inputs: Floats, subject: str) -> None:
    """A row without a value stays by itself, and so does every prepared kernel."""
    if not _width(kernel):
        return
    values, _ = _reference(kernel, inputs)
    first, second = backend.prepare(kernel, len(inputs)), backend.prepare(kernel, len(inputs))
    first.inputs[:] = inputs
    second.inputs[:] = np.nan
    second.values()
    require_close(first.values(), values, ROUNDING, subject, "what is prepared twice does not share its inputs")
    first.inputs[1] = np.nan
    others = [0, 2, 3]
    require_close(first.values()[others], values[others], ROUNDING, subject, "a NaN in one row stays in that row")
