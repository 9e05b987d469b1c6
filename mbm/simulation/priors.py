"""True values drawn from the priors: the values at which the priors' residuals are standard variates of their laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Layout
from mbm.equations.types import Floats
from mbm.kernels.types import KernelSet
from mbm.problem.overrides import NORMAL_LAW
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import BlockRole, Problem
from mbm.simulation import faults
from mbm.simulation.laws import standard_variates
from mbm.simulation.noise import stream
from mbm.text.types import MbmError

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
