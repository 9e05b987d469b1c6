"""``(observe [NAME] [TABLE] EQUATION… option…)``: what was measured, and how well."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mbm.expression.nodes import Expression, Number
from mbm.language import faults as language_faults
from mbm.language.values import Scope
from mbm.problem import faults
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.naming import TakenNames
from mbm.problem.options import Options, split_options
from mbm.problem.reading import likelihoods
from mbm.problem.reading.equations import Residual, residuals
from mbm.problem.reading.errors import read_errors
from mbm.problem.reading.noise_structure import OPTIONS as SHARED_NOISE
from mbm.problem.reading.noise_structure import frees_covariance, read_structure, read_unknown_noise
from mbm.problem.reading.robust import read_loss
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, NoiseKind
from mbm.text.suggest import closest
from mbm.text.types import Form, Label, MbmError, Sequence, Span, Symbol

USAGE = "(observe [name] [table] equation… [:sigma form])"
NOISE = ("sigma", "covariance", "information", "bound")


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


def stated_noise(options: Options) -> tuple[NoiseKind, Form | None, bool]:
    """The kind of noise, its form (None: 1), and whether it holds up to an unknown factor."""
    given = [k for k in NOISE if options.get(k) is not None]
    if len(given) > 1:
        raise MbmError(faults.two_noises(options.places[given[1]]))
    if not given:
        return NoiseKind.SIGMA, None, True
    if frees_covariance(options):
        return NoiseKind.SIGMA, None, False
    form = options.get(given[0])
    if given[0] == "sigma" and form is not None:
        if isinstance(form, Symbol) and form.name == "unknown":
            return NoiseKind.SIGMA, None, True
        if isinstance(form, Sequence) and form.head == "unknown":
            return NoiseKind.SIGMA, read_unknown_noise(form).form, True
    return NoiseKind(given[0]), form, False


def with_noise(
    work: Workspace,
    residual: Residual,
    kind: NoiseKind,
    form: Form | None,
    scope: Scope,
    *,
    exact: bool,
    known: bool = True,
) -> Equation:
    """``exact``: without noise of its own, all that is uncertain is in the columns; ``known``: no unknown decides."""
    size = len(residual.components)
    if form is None:
        noise: tuple[Expression, ...] = tuple(Number(0 if exact else 1) for _ in range(size))
        return _equation(residual, kind, noise)
    value = work.evaluator.wanted(form, scope)
    if kind in (NoiseKind.SIGMA, NoiseKind.BOUND):
        noise = shaped(value, (size,) if size > 1 or not _is_number(value) else (), form.span)
    elif size == 1 and _is_number(value):
        noise = shaped(value, (), form.span)
    else:
        noise = shaped(value, (size, size), form.span, broadcast=False)
    if known:
        work.refuse_unknowns(noise, form.span, f"`:{kind.value}`")
    return _equation(residual, kind, noise)


def _equation(residual: Residual, kind: NoiseKind, noise: tuple[Expression, ...]) -> Equation:
    return Equation(
        components=residual.components,
        noise_kind=kind,
        noise=noise,
        measured=residual.measured,
        measured_columns=residual.columns,
        units=residual.units,
        projection=residual.projection,
        span=residual.span,
    )


def _is_number(value: object) -> bool:
    return not hasattr(value, "elements") and not hasattr(value, "items")
