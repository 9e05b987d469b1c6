"""What generated solvers do not have: said before anything is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.emit import faults
from mbm.emit.foreign import Foreign
from mbm.emit.types import GivenTable, Target
from mbm.expression.nodes import Column, Expression, externals, leaves
from mbm.problem.bounded import called, likelihood_of
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import Gauge
from mbm.problem.naming import PRIOR
from mbm.problem.requests import divided_by
from mbm.problem.sequence.types import Sequence as SequenceOfSteps, SequenceMethod
from mbm.problem.tables import Column as TableColumn
from mbm.problem.types import BlockRole, Method, Problem, TablePlan, Unknown
from mbm.solver.decisions import MOST_DENSE
from mbm.text.types import Diagnostic, MbmError, Place

INTERPOLATE = "interpolate before, into a column of the table that the equations are about"


def refuse(found: Elaborated, target: Target) -> None:
    """Raise what cannot be made for a target: functions alone need no method of solution.

    Raises:
        MbmError: with everything found.

    """
    problem = found.problem
    faults_found = [*_sequence(problem, target), *_data(problem), *_blocks(problem)]
    faults_found += [] if problem.sequence is None else _sequences(found, problem.sequence)
    faults_found += _derived(problem, target)
    for constant in (each for each in problem.constants if each.sigmas and target.solves):
        what, why = f"the uncertainty of the constant `{constant.name}`", "generated solvers solve once, for its value"
        todo = "leave its `:sigma` or `:prior` out, or make it an unknown with a prior"
        faults_found.append(faults.not_emitted(constant.span, what, why, todo))
    if target.solves and not problem.unknowns:
        why, todo = "a generated solver estimates something", "use `mbm solve`, or compile for `casadi`"
        faults_found.append(faults.not_emitted(problem.span, "a problem without unknowns", why, todo))
    if target.solves and problem.sequence is None:
        faults_found += [*_starts(problem), *_request(problem), *_keys(found), *_constraints(problem), *_size(found)]
    if faults_found:
        raise MbmError(*faults_found)


def _size(found: Elaborated) -> Iterator[Diagnostic]:
    """What is too large to be solved densely."""
    count = sum(
        u.freedom * (1 if u.family is None else len(found.tables[u.family.rows])) for u in found.problem.unknowns
    )
    if count > MOST_DENSE:
        message = f"generated solvers are dense, for up to {MOST_DENSE} coordinates"
        todo = "use `mbm solve`, which has a sparse solver; or compile for `casadi`"
        yield faults.not_emitted(found.problem.span, f"a problem of {count} coordinates", message, todo)


def refuse_startless(found: Elaborated, target: Target, known: frozenset[int]) -> None:
    """Raise which unknowns lack a start in data sets other than the first; those ``known`` begin where the data say.

    Raises:
        MbmError: with all of them.

    """
    open_ones = [
        u
        for i, u in enumerate(found.problem.unknowns)
        if i not in known and u.name not in found.starts and _startless(u)
    ]
    why = "each data set needs a start, and none is stated"
    faults_found = [
        faults.not_emitted(u.span, f"`for-each` with `{u.name}`", why, faults.STATE_ONE)
        for u in open_ones
        if target.solves and found.problem.request.for_each and u.family is None
    ]
    if faults_found:
        raise MbmError(*faults_found)


def refuse_cells(found: Elaborated, target: Target, given: Sequence[GivenTable]) -> None:
    """Raise which columns a generated solver could not read: with gaps, or texts that no CSV file holds.

    ``given`` are its tables.

    Raises:
        MbmError: with all of them.

    """
    tables = {table.name: table.columns for table in given}
    faults_found = [
        fault
        for plan in found.problem.plans
        for name, column in found.raw[plan.name].columns.items()
        if target.solves and Foreign(name) in tables[Foreign(plan.name)]
        for fault in _cells(plan, column, found.raw[plan.name].provenance.source_columns.get(name, name))
    ]
    if faults_found:
        raise MbmError(*faults_found)


def _cells(plan: TablePlan, column: TableColumn, source: str) -> Iterator[Diagnostic]:
    """What is wrong for generated solvers with the cells of a column, or with its name in a file."""
    what, place = f"the column `{column.name}` of `{plan.name}`", plan.declaration.span
    if column.numbers is not None and not bool(np.isfinite(column.numbers).all()):
        why = "generated solvers want a number in every cell"
        yield faults.not_emitted(place, f"{what}, which has gaps,", why, "leave the rows with gaps out of the tables")
    if not all(map(_is_text, (source, *(column.texts or ())))):
        why = "it has a text with a NUL character or half of a surrogate pair, which no CSV file holds"
        yield faults.not_emitted(place, what, why, "write the text without it")


def _is_text(text: str) -> bool:
    return "\0" not in text and not any("\ud800" <= character <= "\udfff" for character in text)


def _sequence(problem: Problem, target: Target) -> Iterator[Diagnostic]:
    """States by what takes one step after the other, in C."""
    sequence = problem.sequence
    if sequence is None:
        return
    estimator = sequence.estimator
    if target is not Target.C:
        what, why = f"a problem with `states` for `{target.value}`", "filters and smoothers are written in C alone"
        yield faults.not_emitted(sequence.span, what, why, "compile with `--target c`, or use `mbm solve`")
    method = estimator.method.value
    whole = estimator.method is SequenceMethod.SMOOTHER and estimator.lag is None
    if estimator.method is SequenceMethod.BATCH or whole:
        what = f"a problem with `states` by `:method {f'({method})' if whole else method}`"
        why = "it takes the rows of all steps at once, and a generated filter those of one step after the other"
        todo = "say `(solve :method ekf)`, another filter, or `(smoother :lag n)`"
        yield faults.not_emitted(estimator.span or sequence.span, what, why, todo)


def _sequences(found: Elaborated, sequence: SequenceOfSteps) -> Iterator[Diagnostic]:
    """Sequences that would begin otherwise, or that files do not tell apart."""
    problem = found.problem
    columns = divided_by(problem.request.for_each, problem.request.window)
    divided = {plan.name for plan in problem.plans if any(c in found.raw[plan.name].columns for c in columns)}
    stepped = {table for table, _ in sequence.sources}
    yield from _keys(found)
    known = {state.prior for state in sequence.states}
    for unknown in problem.unknowns:
        values = (unknown.start, unknown.start_lower, unknown.start_upper, unknown.lower, unknown.upper, unknown.fixed)
        nodes = [node for each in values if each is not None for case in each.cases for node in case.values]
        if _reads(nodes, divided | stepped):
            yield _begins(unknown.span, unknown.name)
        if unknown.family is not None and not unknown.is_state and unknown.family.table in divided:
            why = "its members would be others in each sequence, and a generated filter has the same ones"
            todo = "make a table of the members without the columns that tell the sequences apart"
            yield faults.not_emitted(unknown.span, f"the family `{unknown.name}`", why, todo)
    for block in problem.blocks:
        nodes = [n for case in block.cases for e in case.equations for n in (*e.components, *e.noise)]
        if block.name in known and _reads(nodes, divided | stepped):
            yield _begins(block.span, block.name.removeprefix(PRIOR))
    window = problem.request.window
    kept = any(plan.where is not None for plan in problem.plans) or any(b.when is not None for b in problem.blocks)
    if window is not None and kept:
        why = "the program would have to know which rows count before it goes through the windows"
        todo = "leave the rows out before, and `:where` and `:when` out of the problem"
        yield faults.not_emitted(window.span, "`window` with `:where` or `:when`", why, todo)


def _begins(place: Place | None, name: str) -> Diagnostic:
    why = "a generated filter begins before it sees any, and alike for every key and window"
    todo = "state its `:init`, `:sigma` and `:in` without tables that have steps, keys or windows"
    return faults.not_emitted(place, f"`{name}`, which begins by rows of its sequence,", why, todo)


def _reads(nodes: Sequence[Expression], tables: set[str]) -> bool:
    """Whether a cell of some tables is read."""
    return any(isinstance(leaf, Column) and leaf.table in tables for leaf in leaves(tuple(nodes)))


def _data(problem: Problem) -> Iterator[Diagnostic]:
    for pair in problem.pairs:
        why = "generated solvers do not match the times of tables"
        todo = "make one table of both before, with a column for what is measured in each, and compile for that"
        yield faults.not_emitted(pair.span, "`pair`", why, todo)
    chained = {block.table for block in problem.blocks if block.structure.correlation is not None}
    for name in (each for each in problem.earlier if each not in chained):
        place = next((p.declaration.span for p in problem.plans if p.name == name), problem.span)
        todo = "write what is wanted of the row before into columns of the row"
        yield faults.not_emitted(place, f"`previous` of `{name}`", "generated solvers see one row at a time", todo)
    for plan in problem.plans:
        if plan.declaration.skip_missing:
            why = "generated solvers want a number in every cell"
            todo = "leave the rows with gaps out of the tables, and `:missing skip` out of the problem"
            yield faults.not_emitted(plan.declaration.span, "a table with gaps", why, todo)


def _starts(problem: Problem) -> Iterator[Diagnostic]:
    for unknown in problem.unknowns:
        if unknown.family is not None and unknown.family.sources:
            why = "a generated solver numbers the members by one column"
            todo = "make a table of the members with a `:key`, and write it behind `:per`"
            yield faults.not_emitted(unknown.span, f"the family `{unknown.name}` over several columns", why, todo)
        if unknown.family is not None and _startless(unknown):
            why = "a generated solver finds no starts"
            yield faults.not_emitted(
                unknown.span, f"the family `{unknown.name}` without a start", why, faults.STATE_ONE
            )


def _startless(unknown: Unknown) -> bool:
    """Whether nothing says where an unknown, or what is not fixed of it, begins."""
    return unknown.at is not None or (unknown.start is None and unknown.start_lower is None and unknown.lower is None)


def _request(problem: Problem) -> Iterator[Diagnostic]:
    request, place = problem.request, problem.span
    if request.window is not None:
        why = "a generated solver solves one data set in one call"
        todo = "leave `(window …)` out, and call the solver with the rows of each window"
        yield faults.not_emitted(request.window.span, "`window`", why, todo)
    if request.method in (Method.CLOSED_FORM, Method.DIRECT_SEARCH) or request.routine is not None:
        what = f"`:method {request.routine or request.method.value}`"
        yield faults.not_emitted(place, what, "generated solvers iterate from a start", "state a start with `:init`")
    if request.method is Method.INTERVAL:
        why = "generated solvers compute with numbers, not with intervals"
        yield faults.not_emitted(
            place, "`:method (interval)`", why, "give `:sigma` in place of `:bound`, and a `:method`"
        )
    if request.gauge is Gauge.FREE:
        why = "generated solvers want every unknown determined"
        todo = "fix what is free, with `:fixed` or a prior (`:sigma`)"
        yield faults.not_emitted(place, "`:gauge free`", why, todo)
    if request.robust is not None and request.robust.literal:
        why = "generated solvers judge every row alike, by a number of standard deviations"
        todo = "state `:threshold` in place of `:quantile`, and leave `:trust` out"
        yield faults.not_emitted(place, "`gnc` with `:quantile` or `:trust`", why, todo)
    if request.starts is not None:
        why = "a generated solver iterates from one start"
        todo = "leave `:starts` out, call the solver from each start, and keep the answer with the least cost"
        yield faults.not_emitted(place, "`:starts`", why, todo)


def _keys(found: Elaborated) -> Iterator[Diagnostic]:
    """`for-each` over columns that stand together in a table, where tables keep all their rows."""
    problem, keys = found.problem, found.problem.request.for_each
    if not keys:
        return
    if any(plan.where is not None for plan in problem.plans):
        why = "the program would have to know both at once"
        todo = "leave the rows out before, and `:where` out of the problem"
        yield faults.not_emitted(problem.span, "`for-each` with `:where`", why, todo)
    tables = [found.raw[plan.name].columns for plan in problem.plans]
    if not any(set(keys) <= set(columns) for columns in tables):
        why = "no table has all of its columns, and generated solvers do not try every combination"
        yield faults.not_emitted(problem.span, "this `for-each`", why, "put all of them into one table")
    if any(len({columns[key].is_text for columns in tables if key in columns}) > 1 for key in keys):
        why = "a key is a text in one table, a number in another"
        yield faults.not_emitted(problem.span, "this `for-each`", why, "write it alike in all tables")


def _blocks(problem: Problem) -> Iterator[Diagnostic]:
    for block in problem.blocks:
        nodes = [n for case in block.cases for e in case.equations for n in e.stated]
        yield from _called(nodes)
        if _sampled(nodes):
            yield faults.not_emitted(block.span, "`sample`", "generated solvers do not interpolate tables", INTERPOLATE)
        if block.structure.joins:
            what, why = f"{block.structure.what} of `{block.name}`", "generated solvers weight each row by itself"
            yield faults.not_emitted(block.structure.place or block.span, what, why)
        likelihood = likelihood_of(block)
        if likelihood is not None:
            why = "generated solvers weigh squares of residuals, by what is known before the solve"
            yield faults.not_emitted(block.span, f"{called(likelihood)} of `{block.name}`", why)


def _constraints(problem: Problem) -> Iterator[Diagnostic]:
    lossy = next((b for b in problem.blocks if b.loss is not None), None)
    if lossy is None:
        return
    for block in problem.blocks:
        if block.role is BlockRole.CONSTRAINT:
            what = f"the constraint beside the loss of `{lossy.name}`"
            why = "generated solvers have no covariance for both together"
            todo = "state the constraint as an observation with a small `:sigma`, or use `mbm solve`"
            yield faults.not_emitted(block.span, what, why, todo)


def _derived(problem: Problem, target: Target) -> Iterator[Diagnostic]:
    for aggregate in problem.aggregates:
        what, todo = (
            f"`{aggregate.kind}` over the rows of a table",
            "derive the form `:over` the table, and average outside",
        )
        yield faults.not_emitted(aggregate.span, what, "generated solvers derive from one row at a time", todo)
    for written in problem.written_out:
        why = "it is written out for the rows at hand, and a generated solver gets others"
        yield faults.not_emitted(written.span, "an aggregate in a constraint", why, "leave it out")
    families = {
        u.family.rows
        for u in problem.unknowns
        if u.family is not None and u.family.column is not None and not u.is_state
    }
    for derived in problem.derived:
        what = f"the derived quantity `{derived.name}`"
        if derived.kind is not None and target.solves:
            why = "generated solvers derive numbers, no rotations or motions"
            yield faults.not_emitted(derived.span, what, why, "derive numbers of it, as its angles or its matrix")
        if derived.table in families:
            why = "it is derived for each distinct value of a column"
            yield faults.not_emitted(derived.span, what, why, "derive it over a table with one row for each value")
        if derived.grid is not None:
            why = "generated solvers derive for the rows of tables that they are given"
            todo = f"put the values of `{derived.grid.variable}` into a table, and derive `:over` that"
            yield faults.not_emitted(derived.span, what, why, todo)
        nodes = [n for case in derived.cases for n in case.values]
        yield from _called(nodes)
        if _sampled(nodes):
            yield faults.not_emitted(derived.span, what, "generated solvers do not interpolate tables", INTERPOLATE)


def _called(nodes: Sequence[Expression]) -> Iterator[Diagnostic]:
    """The first function that is called."""
    external = next(externals(tuple(nodes)), None)
    if external is not None:
        yield faults.calls(external)


def _sampled(nodes: Sequence[Expression]) -> bool:
    """Whether a table is interpolated."""
    return any(isinstance(leaf, Column) and leaf.sampling is not None for leaf in leaves(tuple(nodes)))
