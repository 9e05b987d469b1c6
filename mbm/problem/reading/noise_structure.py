"""Noise that rows and clauses share: shared factors, an unknown covariance, common errors, correlation.

``:correlation (matrix "file.csv")``: the file is read as a table that no clause can name.

Limits, rounded readings and long tails have no s² = SSE/redundancy: there ``:sigma unknown`` becomes an unknown of the
likelihood. ``(observe d … :sigma unknown :below …)`` says the same as ``:sigma d-sigma`` beside
``(unknowns (d-sigma positive))``, and ``(unknown FORM :as NAME)`` as ``:sigma (* NAME FORM)``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from mbm.expression.nodes import Expression, Number
from mbm.language import faults as language_faults
from mbm.language.values import Scope
from mbm.problem import faults
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.noise import PLAIN, Correlation, NoiseStructure
from mbm.problem.reading.equations import Residual
from mbm.problem.tables import Table
from mbm.problem.types import (
    Block,
    Equation,
    EquationCase,
    NoiseKind,
    Request,
    RowValues,
)
from mbm.text.types import Bracket, Form, Keyword, MbmError, Sequence, Span, Symbol, Text, symbols_of
from mbm.values import dataclass

_TOLD_BY_LIKELIHOOD = frozenset({"below", "above", "resolution"})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """An observation whose noise is unknown: FORM of ``(unknown FORM :as NAME)``, where they are stated."""

    form: Form | None
    shared: Symbol | None
    wants: bool
    span: Span


def with_scales(clauses: tuple[Sequence, ...]) -> tuple[Sequence, ...]:
    """The clauses with a scale among the unknowns for each observation that needs one; one for all of one name."""
    asked = {place: found for place, each in enumerate(clauses) if (found := _asked(each)) is not None}
    shared = {each.shared.name for each in asked.values() if each.wants and each.shared is not None}
    taken = {each.name for clause in clauses for each in symbols_of(clause)}
    scales: dict[str, Symbol] = {}
    made = list(clauses)
    for place, each in asked.items():
        if each.wants or (each.shared is not None and each.shared.name in shared):
            name = each.shared
            if name is None:
                name = Symbol(name=_free(f"{_called(clauses[place])}-sigma", taken), span=each.span)
            scales[name.name] = name
            made[place] = _with_scale(clauses[place], name, each)
    if not scales:
        return clauses
    heads = (Symbol(name="unknowns", span=next(iter(scales.values())).span),)
    declared = (_list(name, Symbol(name="positive", span=name.span)) for name in scales.values())
    return (*made, _list(*heads, *declared))


def _asked(clause: Sequence) -> _Asked | None:
    """What an observation says of unknown noise; None where it is none, or stated otherwise."""
    if clause.head != "observe":
        return None
    pairs = zip(clause.items, clause.items[1:], strict=False)
    options = {key.name: form for key, form in pairs if isinstance(key, Keyword)}
    if options.keys() & {"covariance", "information", "bound"}:
        return None
    law, sigma = options.get("distribution"), options.get("sigma")
    wants = bool(options.keys() & _TOLD_BY_LIKELIHOOD) or (isinstance(law, Sequence) and law.head == "student")
    if sigma is None or is_unknown(sigma):
        return _Asked(form=None, shared=None, wants=wants, span=clause.items[0].span if sigma is None else sigma.span)
    if not isinstance(sigma, Sequence) or sigma.head != "unknown":
        return None
    try:
        noise = read_unknown_noise(sigma)
    except MbmError:
        return None  # said where the clause is read
    return _Asked(form=noise.form, shared=noise.shared, wants=wants, span=sigma.span)


def _with_scale(clause: Sequence, scale: Symbol, asked: _Asked) -> Sequence:
    """The clause with the ``scale``, or the scale times FORM, as its standard deviation."""
    kept: list[Form] = []
    items = iter(clause.items)
    for item in items:
        if isinstance(item, Keyword) and item.name == "sigma":
            next(items, None)
        else:
            kept.append(item)
    if not asked.wants:  # readings that are no limits have the same likelihood
        kept += [Keyword(name="below", span=asked.span), Symbol(name="false", span=asked.span)]
    times = Symbol(name="*", span=asked.span)
    sigma = scale if asked.form is None else _list(times, scale, asked.form)
    return replace(clause, items=(*kept, Keyword(name="sigma", span=asked.span), sigma))


def _called(clause: Sequence) -> str:
    """The name of an observation, or of its table."""
    return next((each.name for each in clause.items[1:2] if isinstance(each, Symbol)), "observe")


def _free(name: str, taken: set[str]) -> str:
    """The name, or the first with a number behind it that nobody has; it is taken then."""
    number, found = 2, name
    while found in taken:
        found, number = f"{name}-{number}", number + 1
    taken.add(found)
    return found


def _list(first: Symbol, *items: Form) -> Sequence:
    return Sequence(items=(first, *items), bracket=Bracket.ROUND, span=first.span)


USAGE = ":sigma (unknown FORM [:as NAME])"
COMMON = ":common ((FORM :per COLUMN)…)"
CORRELATION = ':correlation (ar1 FORM | unknown), or (matrix "file.csv")'
OPTIONS = ("common", "correlation")


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownNoise:
    """``(unknown FORM :as NAME)``: what the factor multiplies, and what it is called where clauses share it."""

    form: Form
    shared: Symbol | None


def read_unknown_noise(form: Sequence) -> UnknownNoise:
    """The noise that ``(unknown FORM [:as NAME])`` states.

    Raises:
        MbmError: not one form, or a name that is none.

    """
    options = split_options(form.items[1:], form.span, owner="`unknown`", known=("as",))
    name = options.get("as")
    if len(options.positional) != 1:
        raise MbmError(language_faults.bad_form(form.span, "`unknown` takes one form", USAGE))
    if name is not None and not isinstance(name, Symbol):
        raise MbmError(language_faults.bad_form(name.span, "`:as` takes a name", USAGE))
    return UnknownNoise(form=options.positional[0], shared=name)


def frees_covariance(options: Options) -> bool:
    """Whether the clause says ``:covariance unknown``."""
    return is_unknown(options.get("covariance"))


def is_unknown(form: Form | None) -> bool:
    """Whether a form is the word ``unknown``."""
    return isinstance(form, Symbol) and form.name == "unknown"


def read_structure(
    work: Workspace, options: Options, table: Table | None, cases: list[EquationCase]
) -> tuple[NoiseStructure, tuple[RowValues, ...]]:
    """What the options of an ``observe`` clause say of noise that rows share, and the forms of it.

    Raises:
        MbmError: forms that are none, options that do not go together.

    """
    sigma = options.get("sigma")
    shared = read_unknown_noise(sigma).shared if isinstance(sigma, Sequence) and sigma.head == "unknown" else None
    free = frees_covariance(options)
    given = [name for name in OPTIONS if options.get(name) is not None]
    if not (free or given):
        return (PLAIN if shared is None else NoiseStructure(shared=shared.name, place=shared.span)), ()
    place = options.places["covariance" if free else given[0]]
    _check_beside(options, free=free, given=given, place=place)
    sizes = {sum(len(e.components) for e in case.equations) for case in cases}
    if len(sizes) > 1 or (free and any(len(case.equations) != 1 for case in cases)):
        raise MbmError(faults.noise_of_unequal_rows(place))
    if table is None:
        raise MbmError(faults.noise_without_rows(place))
    size = max(sizes, default=1)
    common = _common(work, options.get("common"), table, size)
    matrix = matrix_path(options.get("correlation"))
    correlation, unknown, stated = _correlation(work, options.get("correlation"), table)
    structure = NoiseStructure(
        shared=None if shared is None else shared.name,
        free=free,
        per=tuple(column for column, _ in common),
        correlation=correlation,
        unknown=unknown,
        matrix=None if matrix is None else matrix_table(matrix),
        place=place if shared is None else shared.span,
    )
    return structure, (*(values for _, values in common), *stated)


def _check_beside(options: Options, *, free: bool, given: list[str], place: Span) -> None:
    """Raise what does not go together.

    Raises:
        MbmError: `noise-not-combined`.

    """
    if options.get("errors") is not None:
        what = "noise that rows share does not go with `:errors`, whose corrections are made row by row"
        hint = "leave `:errors` out, or make the true values unknowns (`:per` the table) that are observed with a sigma"
        raise MbmError(faults.noise_not_combined(place, what, hint))
    if free and given:
        what = f"`:{given[0]}` stands beside `:sigma`; `:covariance unknown` has no sigma that it could be added to"
        raise MbmError(faults.noise_not_combined(options.places[given[0]], what, "keep one of the two"))
    other = next((o for o in ("covariance", "information", "bound") if options.get(o) is not None and not free), None)
    if other is not None:
        what = f"`:{given[0]}` stands beside `:sigma`, and this clause has `:{other}`"
        raise MbmError(faults.noise_not_combined(place, what, "state the noise of a row by `:sigma`"))


def _common(work: Workspace, form: Form | None, table: Table, size: int) -> list[tuple[str, RowValues]]:
    """The columns of common errors, and what each does to the components of a row."""
    if form is None:
        return []
    if not isinstance(form, Sequence) or not form.items:
        raise MbmError(language_faults.bad_form(form.span, "`:common` takes a list of errors", COMMON))
    found = []
    for item in form.items:
        if not isinstance(item, Sequence):
            raise MbmError(language_faults.bad_form(item.span, "a common error is (FORM :per COLUMN)", COMMON))
        options = split_options(item.items, item.span, owner="`:common`", known=("per",))
        column = options.get("per")
        if len(options.positional) != 1 or not isinstance(column, Symbol):
            raise MbmError(language_faults.bad_form(item.span, "a common error is (FORM :per COLUMN)", COMMON))
        deviation = options.positional[0]
        if is_unknown(deviation) or (isinstance(deviation, Sequence) and deviation.head == "unknown"):
            raise MbmError(faults.unknown_common_error(deviation.span, column.name))
        if column.name not in table.columns:
            raise MbmError(faults.unknown_column(column.span, column.name, table.name, tuple(table.columns)))
        shape = (size,) if size > 1 else ()
        found.append((column.name, work.values(deviation, table, shape, wanted="`:common`")))
    return found


def _correlation(
    work: Workspace, form: Form | None, table: Table
) -> tuple[Correlation | None, bool, tuple[RowValues, ...]]:
    """The correlation along the rows: whether it is unknown, and what is stated."""
    if form is None:
        return None, False, ()
    if matrix_path(form) is not None:
        return Correlation.MATRIX, False, ()
    if not isinstance(form, Sequence) or form.head != "ar1" or len(form.items) != 2:
        raise MbmError(
            language_faults.bad_form(form.span, '`:correlation` takes `(ar1 …)` or `(matrix "file.csv")`', CORRELATION)
        )
    if any(isinstance(item, Keyword) for item in form.items):
        raise MbmError(language_faults.bad_form(form.span, "`ar1` takes one form", CORRELATION))
    if work.scope.earlier is not None:
        work.scope.earlier(table)  # the order of the rows within their key, before any is left out
    if is_unknown(form.items[1]):
        return Correlation.AR1, True, ()
    stated = work.values(form.items[1], None, (), wanted="`:correlation`")
    return Correlation.AR1, False, (stated,)


def check_structures(blocks: Iterable[Block], request: Request | None) -> None:
    """Raise the names of shared factors that clauses have, and outlier rules, which look at each row by itself.

    Raises:
        MbmError: `noise-name-taken`, `noise-not-combined`.

    """
    every = tuple(blocks)
    clauses = {block.name: block.span for block in every}
    found = []
    for block in every:
        structure, place = block.structure, block.structure.place or block.span
        if structure == PLAIN:
            continue
        if structure.shared in clauses:
            found.append(faults.noise_name_taken(place, structure.shared, clauses[structure.shared]))
        rule = ":loss" if block.loss is not None else ":robust" if request is not None and request.robust else None
        if rule is not None:
            found.append(faults.noise_beside_rule(place, block.name, structure.what, rule))
    if found:
        raise MbmError(*found)


READER = "matrix"


def matrix_path(form: Form | None) -> Text | None:
    """The path in ``(matrix "path")``; None where a form is anything else."""
    if isinstance(form, Sequence) and form.head == READER and len(form.items) == 2 and isinstance(form.items[1], Text):
        return form.items[1]
    return None


def matrix_table(path: Text) -> str:
    """What the table of a file is called."""
    return f"matrix {path.value}"


def matrix_forms(clause: Sequence) -> Iterator[tuple[Sequence, Text]]:
    """The matrices that an ``observe`` clause names, with their paths."""
    for option, form in zip(clause.items, clause.items[1:], strict=False):
        path = matrix_path(form) if isinstance(option, Keyword) and option.name == "correlation" else None
        if path is not None and isinstance(form, Sequence):
            yield form, path


NOISE = ("sigma", "covariance", "information", "bound")


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
        placed=residual.placed,
        span=residual.span,
    )


def _is_number(value: object) -> bool:
    return not hasattr(value, "elements") and not hasattr(value, "items")
