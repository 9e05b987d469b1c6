"""True states drawn from the dynamics: each step from the one before, with the noise of its transition."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Layout
from mbm.equations.types import Floats
from mbm.estimation.starts.carried import carried
from mbm.expression.evaluate import evaluate
from mbm.kernels.types import KernelSet
from mbm.problem.naming import key_text
from mbm.problem.rows import lookup
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Block, BlockRole, Equation, NoiseKind, Problem
from mbm.simulation import faults
from mbm.simulation.noise import stream
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
