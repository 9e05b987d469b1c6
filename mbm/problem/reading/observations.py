"""``(observe [NAME] [TABLE] EQUATION… option…)``: what was measured, and how well.

``:errors ((col sigma)…)`` names measured columns with errors of their own, which concern other equations too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

from mbm.expression.nodes import Column, Number, leaves
from mbm.language import faults as language_faults
from mbm.language.values import Scope
from mbm.problem import faults
from mbm.problem.clauses import split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.naming import TakenNames
from mbm.problem.reading import likelihoods
from mbm.problem.reading.equations import Residual, residuals
from mbm.problem.reading.estimators import read_loss
from mbm.problem.reading.noise_structure import (
    NOISE,
    OPTIONS as SHARED_NOISE,
    read_structure,
    stated_noise,
    with_noise,
)
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, TablePlan, UncertainColumn
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, Form, Label, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

ERRORS_USAGE = ":errors ((column sigma)…)"


def read_errors(work: Workspace, form: Form | None, table: Table | None) -> tuple[UncertainColumn, ...]:
    """The uncertain columns that an ``observe`` clause over ``table`` names; none without the option.

    Raises:
        MbmError: not pairs of a column and a form, no column of numbers, a sigma that holds an unknown.

    """
    if form is None:
        return ()
    if table is None:
        raise MbmError(language_faults.bad_form(form.span, "`:errors` wants an observation over a table", ERRORS_USAGE))
    if not isinstance(form, Sequence) or not form.items:
        message = "`:errors` wants a list of columns with their sigmas"
        raise MbmError(language_faults.bad_form(form.span, message, ERRORS_USAGE))
    found: dict[str, UncertainColumn] = {}
    for pair in form.items:
        column = _uncertain(work, pair, table)
        if column.name in found:
            raise MbmError(language_faults.duplicate_definition(column.span, column.name, found[column.name].span))
        found[column.name] = column
    return tuple(found.values())


def _uncertain(work: Workspace, pair: Form, table: Table) -> UncertainColumn:
    symbol = pair.items[0] if isinstance(pair, Sequence) and len(pair.items) == 2 else None
    if not isinstance(pair, Sequence) or not isinstance(symbol, Symbol):
        message = "`:errors` takes pairs (column sigma), e.g. `((x 0.1))`"
        raise MbmError(language_faults.bad_form(pair.span, message, ERRORS_USAGE))
    name, sigma = _column_name(symbol, table), pair.items[1]
    head = sigma.head if isinstance(sigma, Sequence) else sigma.name if isinstance(sigma, Symbol) else None
    if head == "unknown":
        message = "the standard deviation of a column's errors must be stated"
        raise MbmError(language_faults.bad_form(sigma.span, message, ERRORS_USAGE))
    values = work.values(sigma, table, (), wanted="the sigma of `:errors`")
    return UncertainColumn(name=name, table=table.name, column=name, key=None, sigma=values, span=pair.span)


def _column_name(symbol: Symbol, table: Table) -> str:
    """The column's name in the table, which may be written with the table's own."""
    name = symbol.name
    if name not in table.columns and name.startswith(f"{table.name}."):
        name = name[len(table.name) + 1 :]
    column = table.columns.get(name)
    if column is None:
        near = closest(symbol.name, table.columns)
        why = f"is no column of `{table.name}`"
        raise MbmError(faults.errors_without_column(symbol.span, symbol.name, why, near))
    if column.is_text:
        why = "is a column of texts, which have no standard deviation"
        raise MbmError(faults.errors_without_column(symbol.span, symbol.name, why, None))
    return name


@dataclass(frozen=True, slots=True)
class _Source:
    """The table and column that a value was measured in, and the column that holds the key of its row there."""

    table: str
    column: str
    key: str | None


def with_shared_errors(
    blocks: tuple[Block, ...], plans: tuple[TablePlan, ...], tables: Mapping[str, Table]
) -> tuple[tuple[Block, ...], tuple[Diagnostic, ...]]:
    """``blocks`` with the uncertain columns of each: those that it names, and those that other observations name.

    A measured value has one error, so every observation that uses it is corrected by it, under whatever name a join
    gives it. The warnings are about columns that are named in vain.

    Raises:
        MbmError: noise of unknown size beside such a column.

    """
    if not any(block.errors for block in blocks):
        return blocks, ()
    joins = {plan.name: plan for plan in plans}
    declared: dict[tuple[str, str], Span] = {}
    for block in blocks:
        for each in block.errors:
            source = _source(each.table, each.name, joins, tables)
            declared.setdefault((source.table, source.column), each.span)
    warnings: list[Diagnostic] = []
    found = []
    for block in blocks:
        if block.role is BlockRole.OBSERVATION and block.table is not None:
            shared = replace(block, errors=tuple(_errors(block, declared, joins, tables)))
            _check_noise(shared, frozenset(e.name for e in block.errors))
            used = {c.name for c in _columns(block)}
            warnings += [faults.errors_unused(e.span, e.name, block.name) for e in block.errors if e.name not in used]
            found.append(shared)
        else:
            found.append(block)
    return tuple(found), tuple(warnings)


def _errors(
    block: Block,
    declared: Mapping[tuple[str, str], Span],
    joins: Mapping[str, TablePlan],
    tables: Mapping[str, Table],
) -> Iterator[UncertainColumn]:
    own = {each.name: each for each in block.errors}
    names = dict.fromkeys((*own, *(c.name for c in _columns(block))))
    for name in names:
        source = _source(block.table or "", name, joins, tables)
        if name in own:
            yield replace(own[name], table=source.table, column=source.column, key=source.key)
        elif (source.table, source.column) in declared:
            span = declared[source.table, source.column]
            yield UncertainColumn(
                name=name, table=source.table, column=source.column, key=source.key, sigma=None, span=span
            )


def _columns(block: Block) -> Iterator[Column]:
    """The columns of the block's own table in its equations."""
    for case in block.cases:
        for equation in case.equations:
            for leaf in leaves(equation.components):
                if isinstance(leaf, Column) and leaf.table == block.table:
                    yield leaf


def _check_noise(block: Block, own: frozenset[str]) -> None:
    names = frozenset(error.name for error in block.errors)
    for case in block.cases if own else ():
        exact = [e for e in case.equations if all(isinstance(n, Number) and n.value == 0 for n in e.noise)]
        if exact and not any(c.name in names for c in _columns(replace(block, cases=(case,)))):
            count = sum(len(e.components) for e in exact)
            raise MbmError(faults.too_few_errors(block.span, block.name, count, 0, None))
    if not block.errors or not block.unknown_factor:
        return
    each = block.errors[0]
    declared = None if each.name in own else each.span
    raise MbmError(faults.errors_with_unknown_noise(block.span, block.name, each.name, declared))


def _source(table: str, name: str, joins: Mapping[str, TablePlan], tables: Mapping[str, Table]) -> _Source:
    """Where the column ``name`` of ``table`` was measured: through its joins, and theirs."""
    plan = joins.get(table)
    for join in plan.joins if plan is not None else ():
        prefix = f"{join.alias}."
        rest = name[len(prefix) :]
        if name.startswith(prefix) and join.table in tables and rest in tables[join.table].columns:
            if join.table == table:
                return _Source(table, rest, join.column)
            inner = _source(join.table, rest, joins, tables)
            key = join.column if inner.key is None else prefix + inner.key
            return _Source(inner.table, inner.column, key)
    return _Source(table, name, None)


USAGE = "(observe [name] [table] equation… [:sigma form])"


def read_observation(work: Workspace, clause: Sequence, taken: TakenNames) -> Block:
    """The block of equations of one ``observe`` clause; ``taken`` holds the names in use and gains this one."""
    options = split_options(
        clause.items[1:],
        clause.span,
        owner="`observe`",
        known=(*NOISE, *SHARED_NOISE, *likelihoods.OPTIONS, "errors", "loss", "when"),
    )
    loss = read_loss(work, options.get("loss"))
    symbols, equations = _split(options.positional)
    name, table = _name_and_table(work, symbols)
    if not equations:
        raise MbmError(language_faults.bad_form(clause.span, "`observe` has no equation", USAGE))
    kind, form, factor = stated_noise(options)
    noisy = any(options.get(each) is not None for each in NOISE)
    stated = likelihoods.stated_errors(options, sigma=noisy)
    factor &= not stated.law.counts
    exact = form is None and options.get("errors") is not None and options.get("sigma") is None

    def with_its_noise(residual: Residual, around: Scope, known: bool) -> Equation:
        return with_noise(work, residual, kind, form, around, exact=exact, known=known)

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        found = [r for each in equations for r in residuals(work.evaluator, each, scope)]
        empty = next((r for r in found if not r.components), None)
        if empty is not None:
            raise MbmError(faults.empty_equation(empty.span))
        return tuple(likelihoods.observed(work, r, stated, form, scope, partial(with_its_noise, r)) for r in found)

    when_form = options.get("when")
    try:
        errors = read_errors(work, options.get("errors"), table)
        when = None if when_form is None else work.conditions(when_form, table, 1, wanted="`:when`")
        cases = [EquationCase(static=s, equations=e) for s, e in work.cases(table, evaluate, clause.span, when)]
        if factor and form is not None:
            likelihoods.refuse_two_scales(form, cases)
        structure, shared = read_structure(work, options, table, cases)
    except MbmError as error:
        raise _explain_missing_table(work, error, symbols, table) from None
    return Block(
        name=_free_name(name, table, taken, clause.items[0].span),
        role=BlockRole.OBSERVATION,
        table=table.name if table is not None else None,
        cases=tuple(cases),
        when=when,
        unknown_factor=factor and not exact,
        loss=loss,
        errors=errors,
        structure=structure,
        shared=shared,
        span=clause.items[0].span,
    )


def _split(positional: tuple[Form, ...]) -> tuple[list[Symbol], list[Form]]:
    symbols: list[Symbol] = []
    for form in positional:
        if not isinstance(form, Symbol) or len(symbols) == 2:
            break
        symbols.append(form)
    return symbols, list(positional[len(symbols) :])


def _name_and_table(work: Workspace, symbols: list[Symbol]) -> tuple[Symbol | None, Table | None]:
    if len(symbols) == 2:
        return symbols[0], work.table(symbols[1])
    if len(symbols) == 1:
        if symbols[0].name in work.tables:
            return None, work.tables[symbols[0].name]
        return symbols[0], None
    return None, None


def _explain_missing_table(work: Workspace, error: MbmError, symbols: list[Symbol], table: Table | None) -> MbmError:
    """An unknown column may mean that the table's name is misspelt: the one symbol is then taken for a name."""
    columns = {name for each in work.tables.values() for name in each.columns}
    if table is not None or len(symbols) != 1 or not columns:
        return error
    near = closest(symbols[0].name, work.tables)
    note = f"`{symbols[0].name}` names no table, so this observation has no columns"
    label = Label(symbols[0].span, f"{note}; did you mean `{near}`?" if near else note)
    return MbmError(
        *(
            replace(d, labels=(*d.labels, label))
            if d.code == language_faults.UNKNOWN_NAME and isinstance(d.place, Span) and d.place.text in columns
            else d
            for d in error.diagnostics
        )
    )


def _free_name(name: Symbol | None, table: Table | None, taken: TakenNames, span: Span) -> str:
    """The name given, or one made of the table's that nobody has."""
    if name is None:
        return taken.free(table.name if table is not None else "observe", span)
    if name.name in taken.places:
        raise MbmError(language_faults.duplicate_definition(name.span, name.name, taken.places[name.name]))
    return taken.free(name.name, name.span)
