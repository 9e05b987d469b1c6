"""Which problems may be simulated many times over in one table: those whose rows know nothing of one another."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.expression.nodes import Column, leaves
from mbm.problem.types import Problem
from mbm.simulation.measured import measured_equations


def repeatable(problem: Problem, named: Mapping[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """The tables with something measured, which stand once for each data set; None where they cannot.

    ``named`` as for `measured_equations`. They cannot where other tables are joined to them, are paired with them or
    sample them, where they name members of a family, and where measured columns have errors of their own.

    Raises:
        MbmError: an equation that does not say what it measures.

    """
    equations, _ = measured_equations(problem, named)
    tables = {table for each in equations if (table := problem.blocks[each.block].table) is not None}
    request = problem.request
    joined = {join.table for plan in problem.plans for join in plan.joins}
    families = {unknown.family.table for unknown in problem.unknowns if unknown.family is not None}
    if not tables or request.for_each or request.window is not None or problem.pairs or tables & (joined | families):
        return None
    for block in problem.blocks:
        nodes = tuple(c for case in block.cases for equation in case.equations for c in equation.components)
        sampled = {leaf.table for leaf in leaves(nodes) if isinstance(leaf, Column) and leaf.sampling is not None}
        if block.errors or sampled & tables:
            return None
    return tuple(sorted(tables))
