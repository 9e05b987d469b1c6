"""Derivatives of residual blocks that owe nothing to the kernels: SymPy's, evaluated with mpmath, and differences.

SymPy differentiates every named part of a block, the chain rule puts the parts together, and mpmath evaluates with 30
digits. What is not smooth is first replaced by what it is around the point: ``Abs``, ``Min``, ``Max`` and ``Piecewise``
by the branch that holds there; ``ceiling``, ``floor``, ``sign`` and what is held, whose slope is zero, by their value.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import mpmath
import numpy as np
import sympy

import mbm
from mbm import compiler
from mbm.equations.manifolds import tangent_axes
from mbm.estimation.search.starting import beginnings
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.kernels.derive import kernel_of
from mbm.kernels.serialised import function_of
from mbm.problem.manifold import Piece
from mbm.rotations import hamilton
from mbm.symbolic.conversion import Finite, Held
from mbm.symbolic.printing import named_subexpressions

DIGITS = 30

LONG = ("shoulder", "can", "chain-intervals")
"""Problems that SymPy cannot follow: equations of some thousand operations take it minutes (`tests/language` compares
what they are made of with SciPy), and outlines are called (`tests/kernels/outlines`). Bounded errors are no residuals
(`tests/estimation/intervals`)."""


def number(expression: sympy.Basic, point: Mapping[sympy.Symbol, Any]) -> Any:
    """The value of an expression with 30 digits; of a condition, whether it holds."""
    if isinstance(expression, sympy.Not):
        return not number(expression.args[0], point)
    if isinstance(expression, sympy.And | sympy.Or):
        decide = all if isinstance(expression, sympy.And) else any
        return decide(number(a, point) for a in expression.args)
    if isinstance(expression, sympy.core.relational.Relational):
        left, right = (number(a, point) for a in expression.args)
        return bool(expression.func(sympy.Float(left, DIGITS), sympy.Float(right, DIGITS)))
    if isinstance(expression, Finite):
        return bool(mpmath.isfinite(number(expression.args[0], point)))
    return numbers([smooth(expression, point)], point)[0]


def numbers(expressions: Sequence[sympy.Expr], point: Mapping[sympy.Symbol, Any]) -> list[Any]:
    """Values of smooth expressions."""
    with mpmath.workdps(DIGITS):
        function = sympy.lambdify(list(point), list(expressions), modules="mpmath", cse=False)
        return [mpmath.mpf(v) for v in function(*point.values())]


def smooth(expression: sympy.Basic, point: Mapping[sympy.Symbol, Any]) -> sympy.Basic:
    """What ``expression`` is around ``point``, without the functions that have kinks and steps."""
    if not expression.args:
        return expression
    if isinstance(expression, sympy.Piecewise):
        chosen = next(value for value, test in expression.args if test is sympy.true or number(test, point))
        return smooth(chosen, point)
    arguments = [smooth(a, point) for a in expression.args]
    if isinstance(expression, sympy.Abs):
        return arguments[0] if number(arguments[0], point) >= 0 else -arguments[0]
    if isinstance(expression, sympy.Min | sympy.Max):
        pick = min if isinstance(expression, sympy.Min) else max
        return pick(arguments, key=lambda a: number(a, point))
    if isinstance(expression, Held):
        with mpmath.workdps(DIGITS):
            return sympy.Float(number(arguments[0], point), DIGITS)
    if isinstance(expression, sympy.ceiling | sympy.floor | sympy.sign):
        value = number(arguments[0], point)
        with mpmath.workdps(DIGITS):
            step = {"ceiling": mpmath.ceil, "floor": mpmath.floor, "sign": mpmath.sign}[type(expression).__name__]
            return sympy.Integer(int(step(value)))
    return expression.func(*arguments)


@functools.lru_cache(maxsize=1024)  # rows of a block have most parts in common
def with_slopes(expression: sympy.Expr) -> tuple[list[sympy.Symbol], Callable[..., list[Any]]]:
    """The symbols of a smooth expression, and what gives its value and its derivatives by them."""
    inputs = sorted(expression.free_symbols, key=str)
    whole = [expression, *(sympy.diff(expression, s) for s in inputs)]
    return inputs, sympy.lambdify(inputs, whole, modules="mpmath", cse=False)


def by_sympy(block: Any, point: Mapping[sympy.Symbol, float]) -> tuple[np.ndarray, np.ndarray]:
    """Values (m,) and Jacobian (m, n) of a block; ``point`` gives every input."""
    with mpmath.workdps(DIGITS):
        known: dict[sympy.Symbol, Any] = {s: mpmath.mpf(float(v)) for s, v in point.items()}
    unit = np.array([mpmath.mpf(0)] * len(block.variable_symbols))
    slopes = {s: unit.copy() for s in known}
    for position, symbol in enumerate(block.variable_symbols):
        slopes[symbol][position] = mpmath.mpf(1)
    definitions, components = named_subexpressions(block.expressions, {s.name for s in known})
    values, rows = [], []
    for symbol, expression in (*definitions, *((None, c) for c in components)):
        local = smooth(expression, known)
        inputs, function = with_slopes(local)
        with mpmath.workdps(DIGITS):
            value, *partial = (mpmath.mpf(v) for v in function(*(known[s] for s in inputs)))
            slope = sum((p * slopes[s] for p, s in zip(partial, inputs, strict=True)), unit.copy())
        if symbol is None:
            values.append(float(value))
            rows.append(slope)
        else:
            known[symbol], slopes[symbol] = value, slope
    return np.array(values), np.array(rows, dtype=float).reshape(len(values), len(unit))


def by_kernel(kernel: Any, inputs: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Values (m,) and dense Jacobian (m, n) of a kernel by CasADi's own virtual machine."""
    both = np.asarray(function_of("both", kernel.jacobian_program)(np.asarray(inputs, dtype=float))).reshape(-1)
    jacobian = np.zeros((kernel.outputs, len(kernel.tangents)))
    jacobian[kernel.jacobian_rows, kernel.jacobian_columns] = both[kernel.outputs :]
    return both[: kernel.outputs], jacobian


def by_differences(kernel: Any, inputs: Sequence[float]) -> np.ndarray:
    """The Jacobian (m, n) by central differences at two steps, extrapolated (Richardson): error of fourth order."""
    inputs = np.asarray(inputs, dtype=float)
    values = function_of("values", kernel.value_program)

    def slope(column: int, step: float) -> np.ndarray:
        moved = np.zeros_like(inputs)
        moved[column] = step
        ahead, behind = (np.asarray(values(inputs + s * moved)).reshape(-1) for s in (1, -1))
        return (ahead - behind) / (2 * step)

    columns = []
    for column in range(len(kernel.variables)):
        # eps^(1/5): where truncation of fourth order and rounding meet.
        step = 5e-4 * max(1.0, abs(inputs[column]))
        columns.append((4 * slope(column, step / 2) - slope(column, step)) / 3)
    return np.column_stack(columns) if columns else np.zeros((kernel.outputs, 0))


def blocks_of(problem: Any, data: Mapping[str, object] | None = None) -> Iterator[tuple[Any, Any, np.ndarray]]:
    """Each block of a problem with its kernel and its inputs (rows, variables + parameters) near the start."""
    compiled = problem.compile(data=data, backend="casadi")
    found = compiled.elaborated
    model = compiler.symbolic(found)
    starts = {k: np.asarray(v, dtype=float) for k, v in found.starts.items()}
    equations, binder = assemble(found.problem, compiled.kernels, found.tables, starts, compiled.cache)
    random = np.random.default_rng(1)
    # Off the start by some per cent: starts are often special points (zero angles, equal members).
    start = beginnings(equations, settings_of(found.problem.request))[0].point
    away = random.uniform(-0.03, 0.03, len(start))
    moved = start * (1 + away) + np.where(np.abs(start) < 1, 0.01 * away, 0)
    owners = range(len(found.problem.derived))
    groups = (*equations.groups, *(g for o in owners for g in binder.derived(compiled.kernels, o)))
    by_kernel_id = {id(group.kernel): group for group in groups}
    for block, kernel in zip(model.blocks, compiled.kernels.kernels, strict=True):
        group = by_kernel_id.get(id(kernel))
        if group is not None and group.rows:
            group.fill(moved)
            yield block, kernel, np.array(group.evaluation.inputs)


def single(text: str, names: str = "a b", columns: str = "x y z") -> tuple[Any, Any]:
    """Block and kernel of an expression of unknowns ``names`` and columns; inputs are in the order of the block."""
    row = " ".join("1" for _ in columns.split())
    unknowns = " ".join(f"({name} :init 1)" for name in names.split())
    problem = mbm.loads(
        f"(problem p (data t (table ({columns}) ({row}))) (unknowns {unknowns}) (observe t {text} :sigma 1))"
    )
    found = compiler.elaborated(problem.program, None, compiler.Inputs(), problem.registry)
    (block,) = compiler.symbolic(found).blocks
    return block, kernel_of(block)


def tangent_map(kernel: Any, inputs: np.ndarray) -> np.ndarray:
    """How the inputs vary with the coordinates of their tangent spaces (variables, tangents): R Exp(ω), c exp(s)."""
    found = np.zeros((len(kernel.variables), len(kernel.tangents)))
    for chart in kernel.charts:
        numbers = inputs[list(chart.variables)]
        if chart.piece is Piece.SCALE:
            slopes = numbers[:, None]
        elif chart.piece is Piece.QUATERNION:
            pure = np.hstack([np.zeros((3, 1)), np.eye(3)])
            slopes = 0.5 * hamilton(np.tile(numbers, (3, 1)), pure).T
        elif chart.piece is Piece.SPHERE:
            slopes = np.stack(tangent_axes(numbers), axis=1)
        else:
            slopes = np.ones((1, 1))
        found[np.ix_(chart.variables, chart.tangents)] = slopes
    return found


def point_of(block: Any, values: Mapping[str, float]) -> list[float]:
    """The inputs of a block by name."""
    return [values[s.name] for s in (*block.variable_symbols, *block.parameter_symbols)]


def check(block: Any, kernel: Any, inputs: np.ndarray) -> None:
    """Kernel = SymPy = differences at one row's inputs."""
    symbols = (*block.variable_symbols, *block.parameter_symbols)
    tangents = tangent_map(kernel, inputs)
    values, jacobian = by_sympy(block, dict(zip(symbols, inputs, strict=True)))
    jacobian = jacobian @ tangents
    found, slopes = by_kernel(kernel, inputs)
    # Rounding of the kernel's some hundred operations; cancellation loses what the largest entries are rounded by.
    scale = max(1.0, np.abs(values).max(initial=0))
    np.testing.assert_allclose(found, values, rtol=1e-12, atol=1e-12 * scale, err_msg=block.name)
    steep = max(1.0, np.abs(jacobian).max(initial=0))
    np.testing.assert_allclose(slopes, jacobian, rtol=1e-11, atol=1e-12 * steep, err_msg=block.name)
    # Differences with steps of 5e-4 are good to some 1e-11 of the values, divided by the step.
    np.testing.assert_allclose(
        by_differences(kernel, inputs) @ tangents,
        jacobian,
        rtol=1e-6,
        atol=1e-7 * max(steep, scale),
        err_msg=block.name,
    )
