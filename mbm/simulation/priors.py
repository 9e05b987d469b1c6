"""True values drawn from the priors: the values at which the priors' residuals are standard variates of their laws.
True states drawn from the dynamics: each step from the one before, with the noise of its transition.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Layout
from mbm.equations.types import Floats
from mbm.estimation.starts.carried import carried
from mbm.expression.evaluate import evaluate
from mbm.kernels.types import KernelSet
from mbm.problem.naming import key_text
from mbm.problem.overrides import NORMAL_LAW
from mbm.problem.rows import lookup
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Block, BlockRole, Equation, NoiseKind, Problem
from mbm.simulation import faults
from mbm.simulation.noise import standard_variates, stream
from mbm.simulation.types import NOT_KNOWN, KnownNoise
from mbm.text.types import MbmError

ROUNDED = 1e-14
"""Eigenvalue of a covariance beside the largest that is zero but for rounding."""

Drawing = tuple[Mapping[str, CellKey], int, Mapping[str, KnownNoise]]
"""The key of the solve, the seed, and what is known of unknown noise, by observation."""


def stated_throughout(places: Layout, values: Mapping[str, Floats]) -> bool:
    """Whether ``values`` has some state at every step: then all states are taken as they are given."""
    changing = (e for e in places.entries if e.unknown.is_state and e.steps is None and e.members > 1)
    return any(np.size(values.get(e.unknown.name, ())) >= e.count for e in changing)


def drawn_states(
    problem: Problem,
    carrying: tuple[KernelSet, EvaluationCache],
    tables: Mapping[str, Table],
    places: Layout,
    drawing: Drawing,
) -> Floats:
    """All numbers (N,): those of ``places.start`` at the first step and of constants, and states drawn step by step.

    Raises:
        MbmError: `not-simulated`, a transition that does not determine the next state, or noise that is none.

    """
    kernels, cache = carrying
    binder = Binder(problem=problem, layout=places, tables=tables, cache=cache)
    point, stuck = carried(binder, kernels, places.start, lambda group: _draws(problem, group, tables, drawing))
    if stuck is None or problem.sequence is None:
        return point
    step = key_text(float(tables[problem.sequence.steps].numbers(problem.sequence.column)[stuck]))
    raise MbmError(faults.not_carried(problem.sequence.span, problem.sequence.column, step))


def _draws(problem: Problem, group: Group, tables: Mapping[str, Table], drawing: Drawing) -> Floats:
    """What the equations of a transition (rows, outputs) leave: nothing where they are exact."""
    key, seed, factors = drawing
    block = problem.blocks[group.kernel.owner]
    if block.role is BlockRole.CONSTRAINT or block.table is None or group.positions is None:
        return np.zeros((group.rows, group.kernel.outputs))
    words = [f"{name}={value}" for name, value in key.items()]
    normal = stream(seed, block.name, *words).standard_normal((len(tables[block.table]), group.kernel.outputs))
    parts, first = [], 0
    for equation in block.cases[group.kernel.case].equations:
        size = len(equation.components)
        root = _root(equation, block, group, tables)
        own = normal[group.positions, first : first + size]
        parts.append((factors.get(block.factor_name, NOT_KNOWN).factor or 1.0) * np.einsum("rij,rj->ri", root, own))
        first += size
    return np.hstack(parts)


def _root(equation: Equation, block: Block, group: Group, tables: Mapping[str, Table]) -> Floats:
    """L (rows, k, k) with L Lᵀ the covariance that the equation states, which may be singular."""
    table = tables[block.table or ""]
    noise = np.empty((group.rows, len(equation.noise)))
    for j, column in enumerate(evaluate(equation.noise, lookup(table, group.positions, tables))):
        noise[:, j] = column
    size = len(equation.components)
    if equation.noise_kind is NoiseKind.SIGMA:
        return np.asarray(noise[:, :, None] * np.eye(size))
    values, vectors = np.linalg.eigh(noise.reshape(group.rows, size, size))
    if equation.noise_kind is NoiseKind.INFORMATION:
        values = 1.0 / values
    none = values <= ROUNDED * np.abs(values).max(axis=1, keepdims=True)
    return np.asarray(vectors * np.sqrt(np.where(none, 0.0, values))[:, None, :])


ITERATIONS = 50
SETTLED = 1e-12
"""Length of a step, in standard deviations, that is none."""


def drawn_from_priors(
    problem: Problem,
    kernels: tuple[KernelSet, EvaluationCache],
    tables: Mapping[str, Table],
    places: Layout,
    key: Mapping[str, CellKey],
    seed: int,
) -> Floats:
    """All numbers (N,): those of ``places.start``, moved such that the whitened residuals of all priors are drawn.

    Where several priors speak of one unknown the draw is theirs together: least squares of normal numbers have the
    covariance of the combined prior. What no prior speaks of stays (Gauss-Newton with steps of minimum norm).

    Raises:
        MbmError: not-simulated, a prior without a finite value or derivative there.

    """
    equations = blank(Binder(problem=problem, layout=places, tables=tables, cache=kernels[1]), kernels[0])
    rows = [equations.block_rows(i) for i, block in enumerate(problem.blocks) if block.role is BlockRole.PRIOR]
    priors = [block for block in problem.blocks if block.role is BlockRole.PRIOR]
    x = places.start
    if not sum(map(len, rows)):
        return x
    equations = replace(equations, rows=np.concatenate(rows))
    words = [f"{name}={value}" for name, value in key.items()]
    wanted = stream(seed, "priors", *words).standard_normal(equations.count)
    every = np.full(equations.whole, np.nan)
    every[equations.rows] = wanted
    _follow_laws(every, problem, equations.groups, lambda name: stream(seed, "priors", *words, name))
    wanted = every[equations.rows]
    for _ in range(ITERATIONS):
        residuals, jacobian = equations.plain_linearised(x)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        gap = wanted - residuals
        finite = np.isfinite(gap) & np.isfinite(jacobian).all(axis=1)
        if not finite.all():
            owner = np.repeat(np.arange(len(rows)), [len(own) for own in rows])[int(np.argmin(finite))]
            raise MbmError(faults.not_drawn(priors[owner].span, priors[owner].name))
        step = np.linalg.lstsq(jacobian / scale, gap, rcond=1e-12)[0]
        x = equations.retract(x, step / scale)
        if not float(np.linalg.norm(step)) > SETTLED:
            break
    return x


def _follow_laws(
    wanted: Floats, problem: Problem, groups: tuple[Group, ...], rng: Callable[[str], np.random.Generator]
) -> None:
    """Put variates of their laws for the priors that are not normal among all residuals ``wanted`` (all,)."""
    for group in groups:
        block = problem.blocks[group.kernel.owner]
        own = wanted[group.first : group.first + group.count].reshape(group.rows, group.kernel.outputs)
        if block.role is BlockRole.PRIOR:
            for equation, each in zip(block.cases[group.kernel.case].equations, group.whiteners, strict=True):
                if equation.law != NORMAL_LAW:
                    shape = (group.rows, each.last - each.first)
                    own[:, each.first : each.last] = standard_variates(equation.law, rng(block.name), shape)
