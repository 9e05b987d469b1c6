"""What generated solvers do not have: said before anything is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mbm.emit import faults
from mbm.expression.nodes import Column, Expression, leaves
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import LossKind
from mbm.problem.types import BlockRole, Gauge, Loss, Method, Problem, Unknown
from mbm.text.types import Diagnostic, MbmError

MOST_COORDINATES = 300
"""Coordinates beyond which a dense solver is the wrong one: `mbm solve` takes a sparse one there."""


def refuse(found: Elaborated) -> None:
    """Raise what a generated solver cannot do.

    Raises:
        MbmError: with everything found.

    """
    problem = found.problem
    faults_found = [*_data(problem), *_request(problem), *_keys(found), *_blocks(problem), *_derived(problem)]
    count = sum(
        u.freedom * (1 if u.family is None else len(found.tables[u.family.rows])) for u in found.problem.unknowns
    )
    if count > MOST_COORDINATES:
        message = f"generated solvers are dense, for up to {MOST_COORDINATES} coordinates"
        faults_found.append(faults.not_emitted(found.problem.span, f"a problem of {count} coordinates", message))
    if faults_found:
        raise MbmError(*faults_found)


def _data(problem: Problem) -> Iterator[Diagnostic]:
    for pair in problem.pairs:
        yield faults.not_emitted(pair.span, "`pair`", "generated solvers do not match the times of tables")
    for plan in problem.plans:
        if plan.declaration.skip_missing:
            yield faults.not_emitted(
                plan.declaration.span, "a table with gaps", "generated solvers want a number in every cell"
            )
    for unknown in problem.unknowns:
        if unknown.family is not None and _startless(unknown):
            why = "a generated solver finds no starts: state one with `:init`"
            yield faults.not_emitted(unknown.span, f"the family `{unknown.name}` without a start", why)


def _startless(unknown: Unknown) -> bool:
    """Whether nothing says where an unknown begins."""
    return unknown.start is None and unknown.start_lower is None and unknown.lower is None


def _request(problem: Problem) -> Iterator[Diagnostic]:
    request, place = problem.request, problem.span
    if request.window is not None:
        yield faults.not_emitted(request.window.span, "`window`", "a generated solver solves one data set in one call")
    if request.robust is not None:
        what = f"`:robust {request.robust.kind.value}`"
        yield faults.not_emitted(place, what, "generated solvers have no consensus; they have losses (`:loss`)")
    if request.method in (Method.CLOSED_FORM, Method.DIRECT_SEARCH) or request.routine is not None:
        what = f"`:method {request.routine or request.method.value}`"
        yield faults.not_emitted(place, what, "generated solvers iterate from a start")
    if request.gauge is Gauge.FREE:
        yield faults.not_emitted(place, "`:gauge free`", "generated solvers want every unknown determined")
    if request.starts is not None:
        yield faults.not_emitted(
            place, "`:starts`", "a generated solver iterates from one start, which its caller gives"
        )
    for unknown in problem.unknowns if request.for_each else ():
        if unknown.family is None and _startless(unknown):
            why = "each data set needs a start, and none is stated: state one with `:init`"
            yield faults.not_emitted(unknown.span, f"`for-each` with `{unknown.name}`", why)


def _keys(found: Elaborated) -> Iterator[Diagnostic]:
    """`for-each` over columns that stand together in a table, where tables keep all their rows."""
    problem, keys = found.problem, found.problem.request.for_each
    if not keys:
        return
    if any(plan.where is not None for plan in problem.plans):
        yield faults.not_emitted(
            problem.span, "`for-each` with `:where`", "the program would have to know both at once"
        )
    tables = [found.raw[plan.name].columns for plan in problem.plans]
    if not any(set(keys) <= set(columns) for columns in tables):
        why = "no table has all of its columns, and generated solvers do not try every combination"
        yield faults.not_emitted(problem.span, "this `for-each`", why)
    if any(len({columns[key].is_text for columns in tables if key in columns}) > 1 for key in keys):
        yield faults.not_emitted(problem.span, "this `for-each`", "a key is a text in one table, a number in another")


def _blocks(problem: Problem) -> Iterator[Diagnostic]:
    lossy = next((b for b in problem.blocks if b.loss is not None), None)
    for block in problem.blocks:
        if block.errors:
            yield faults.not_emitted(block.span, "`:errors`", "generated solvers take measured columns as exact")
        nodes = [n for case in block.cases for e in case.equations for n in (*e.components, *e.noise)]
        if _sampled(nodes):
            yield faults.not_emitted(block.span, "`sample`", "generated solvers do not interpolate tables")
        if block.role is BlockRole.CONSTRAINT and lossy is not None:
            what = f"the constraint beside the loss of `{lossy.name}`"
            yield faults.not_emitted(block.span, what, "generated solvers have no covariance for both together")
        if block.unknown_factor and block.loss is not None:
            what = f"the loss of `{block.name}` with unknown noise"
            why = "how large noise with outliers is takes a consensus, which generated solvers do not have"
            yield faults.not_emitted(block.span, what, why)
        if block.loss is not None and _bounded(block.loss):
            why = "far from the answer it has no slope: it takes many starts, and generated solvers go from one"
            yield faults.not_emitted(block.span, f"`:loss {block.loss.kind.value}`", why)


def _bounded(loss: Loss) -> bool:
    """Whether no residual, however large, costs more than some number: such a loss flattens out."""
    if loss.kind is LossKind.BARRON:
        return loss.shape is not None and loss.shape < 0.0
    return loss.kind in (LossKind.TUKEY, LossKind.GEMAN_MCCLURE)


def _derived(problem: Problem) -> Iterator[Diagnostic]:
    families = {u.family.rows for u in problem.unknowns if u.family is not None and u.family.column is not None}
    for derived in problem.derived:
        what = f"the derived quantity `{derived.name}`"
        if derived.kind is not None:
            yield faults.not_emitted(derived.span, what, "generated solvers derive numbers, no rotations or motions")
        if derived.table in families:
            yield faults.not_emitted(derived.span, what, "it is derived for each distinct value of a column")
        if _sampled([n for case in derived.cases for n in case.values]):
            yield faults.not_emitted(derived.span, what, "generated solvers do not interpolate tables")


def _sampled(nodes: Sequence[Expression]) -> bool:
    """Whether a table is interpolated."""
    return any(isinstance(leaf, Column) and leaf.sampling is not None for leaf in leaves(tuple(nodes)))
