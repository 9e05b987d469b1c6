"""What of a sequence cannot be said with the rows of one step alone."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.estimation.sequences.run import Begun
from mbm.estimation.sequences.step_rows import FIRST, whens
from mbm.expression.nodes import Column, ColumnMember, Expression, LiteralMember, leaves
from mbm.expression.rows import RowChoice
from mbm.kernels.types import KernelSet
from mbm.problem.previous import column_before
from mbm.problem.tables import ROW
from mbm.problem.types import Block, RowValues
from mbm.symbolic.types import ColumnInput, Purpose


def unsuited(begun: Begun) -> Iterator[str]:
    """What is in the way of taking one step at a time, as words behind `a problem`."""
    problem, sequence = begun.problem, begun.sequence
    plans = {plan.name: plan for plan in problem.plans}
    stepped = {name for name, _ in sequence.sources}
    for name in stepped:
        if name not in plans or plans[name].declaration.members:
            yield f"whose table `{name}` is made of others"
    seen = begun.chained.seen
    groups = (*seen.equations.groups, *seen.equations.constraints)
    for group, counts, when in zip(groups, seen.counts, whens(begun), strict=True):
        block = problem.blocks[group.kernel.owner]
        if when == FIRST and bool(counts[1:].any()):
            yield f"in which `{block.name}` names a step"
        if any(_named(slot.member) for slot in group.kernel.variables if slot.unknown in sequence.names):
            yield f"in which `{block.name}` names the step of a state"
    for block in problem.blocks:
        if block.earlier or (block.distinct and block.table in stepped and sequence.column not in block.distinct):
            yield f"in which `{block.name}` looks at rows of other steps"
        if any(_elsewhere(leaf, stepped) for leaf in _columns(block)):
            yield f"in which `{block.name}` looks at rows of other steps"
    moving = begun.chained.moving.equations
    for group in (*groups, *moving.groups, *moving.constraints):
        for each in group.kernel.parameters:
            if isinstance(each, ColumnInput) and _elsewhere(each, stepped):
                yield f"in which `{problem.blocks[group.kernel.owner].name}` looks at rows of other steps"


def derived_elsewhere(begun: Begun, kernels: KernelSet) -> Iterator[str]:
    """What derived quantities take that is not of one step, in the same words."""
    stepped = {name for name, _ in begun.sequence.sources}
    for kernel in kernels.kernels:
        if kernel.purpose is Purpose.DERIVED:
            name = begun.problem.derived[kernel.owner].name
            if any(_named(slot.member) for slot in kernel.variables if slot.unknown in begun.sequence.names):
                yield f"in which `{name}` names the step of a state"
            if any(isinstance(each, ColumnInput) and _elsewhere(each, stepped) for each in kernel.parameters):
                yield f"in which `{name}` looks at rows of other steps"


def _named(member: object) -> bool:
    """Whether a member is not that of the row at hand."""
    return isinstance(member, LiteralMember) or (isinstance(member, ColumnMember) and member.row is not RowChoice.EACH)


def _elsewhere(column: Column | ColumnInput, stepped: set[str]) -> bool:
    """Whether a number of a table with steps is from another row than the one at hand, or is the row's number."""
    if column.sampling is not None and column.sampling.table in stepped:
        return True
    if column.table not in stepped:
        return False
    return column.row is not RowChoice.EACH or column.name == ROW or column_before(column.name) is not None


def _columns(block: Block) -> Iterator[Column]:
    """The columns that decide which rows of a block count, and how much."""
    values = [*_values(block.when), *_values(block.trust)]
    values += [each for case in block.cases for equation in case.equations for each in equation.noise]
    yield from (leaf for leaf in leaves(tuple(values)) if isinstance(leaf, Column))


def _values(values: RowValues | None) -> list[Expression]:
    return [] if values is None else [each for case in values.cases for each in case.values]
