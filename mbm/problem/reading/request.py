"""``(solve option…)`` and ``(for-each COLUMN…)``: how to solve, from where, and which problems to make of the data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence as Many
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType

from mbm.expression.nodes import nearest
from mbm.language import faults as language_faults
from mbm.language.scope import static_number
from mbm.problem import faults
from mbm.problem.clauses import only, split_options
from mbm.problem.elaboration import Routines, Workspace
from mbm.problem.kinds import ConstraintMethod, Gauge
from mbm.problem.reading.declarations import Declaration, named_column
from mbm.problem.reading.estimators import (
    METHODS,
    TRUNCATE,
    checked_cuts,
    is_of_sequences,
    named_estimator,
    read_consensus,
    read_enclosing,
    read_trust,
    whole_within,
    word_of,
)
from mbm.problem.reading.unknowns import stated_numbers
from mbm.problem.requests import GivenStarts, RandomStarts
from mbm.problem.types import Block, Method, Problem, Request
from mbm.text.types import Form, Keyword, MbmError, Sequence, Span, Symbol

USAGE = "(solve [:method lm] [:max-iterations 100] [:tolerance 1e-10] [:seed 1] [:coverage 95%])"
MAXIMUM_ITERATIONS = 1_000_000
OPTIONS = (
    "method",
    "robust",
    "starts",
    "constraints",
    "gauge",
    "seed",
    "max-iterations",
    "tolerance",
    "coverage",
    "hypotheses",
)


STARTS_USAGE = ":starts (random 100 [:seed 1]) | (given ((name value)…)…)"
MAXIMUM_STARTS = 100_000
LARGEST_SEED = 2**63 - 1


def read_request(
    work: Workspace, solves: list[Sequence], for_each: list[Sequence], declarations: Many[Declaration]
) -> Request:
    """The request that the clauses make: at most one ``solve``, and the columns of all ``for-each``."""
    columns = tuple(_columns(work, for_each))
    solve = only(solves, "solve")
    if solve is None:
        return Request(for_each=columns)
    options = split_options(
        solve.items[1:],
        solve.span,
        owner="`solve`",
        known=OPTIONS,
        alone=USAGE,
    )
    method, routine = _method(options.get("method"), work.routines)
    return Request(
        method=method,
        routine=routine,
        enclosing=read_enclosing(work, options.get("method"), declarations),
        constraints=_constraint_method(options.get("constraints")),
        gauge=_gauge(options.get("gauge")),
        robust=read_consensus(work, options.get("robust")),
        starts=read_starts(work, options.get("starts"), declarations),
        seed=_integer(work, options.get("seed"), 1, 0, LARGEST_SEED, "seed"),
        max_iterations=_integer(work, options.get("max-iterations"), 100, 1, MAXIMUM_ITERATIONS, "max-iterations"),
        tolerance=_share(work, options.get("tolerance"), "tolerance", Request().tolerance),
        coverage=_share(work, options.get("coverage"), "coverage", Request().coverage),
        for_each=columns,
    )


def trusting(work: Workspace, solves: list[Sequence], blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    """The blocks with the rows that ``(gnc :trust FORM)`` of the ``solve`` clause means."""
    items = solves[0].items[1:] if solves else ()
    robust = next((b for a, b in pairwise(items) if isinstance(a, Keyword) and a.name == "robust"), None)
    return read_trust(work, robust, blocks)


def _columns(work: Workspace, clauses: list[Sequence]) -> dict[str, Span]:
    """The names in all ``for-each``, each with its place."""
    found: dict[str, Span] = {}
    for clause in clauses:
        if len(clause.items) == 1:
            raise MbmError(language_faults.bad_form(clause.span, "`for-each` names no column", "(for-each column…)"))
    forms = [form for clause in clauses for form in clause.items[1:]]
    for form in forms:
        if not isinstance(form, Symbol):
            raise MbmError(
                language_faults.bad_form(form.span, "`for-each` takes names of columns", "(for-each column…)")
            )
        named_column(work, form)
    for form, column in zip(forms, work.scope.divided[0], strict=True):
        if column in found:
            raise MbmError(language_faults.duplicate_definition(form.span, column, found[column]))
        found[column] = form.span
    return found


def requested(
    problem: Problem,
    *,
    seed: int | None,
    method: str | None,
    starts: int | None = None,
    routines: Routines = tuple,
) -> Problem:
    """``problem`` with the seed, method and number of random starts that the caller asks for; None: as in the file.

    ``routines`` gives the names of the registered closed forms, which may be methods too. A seed from outside takes
    the place of all seeds in the file.
    """
    request = problem.request
    if seed is not None:
        if not (isinstance(seed, int) and not isinstance(seed, bool) and 0 <= seed <= LARGEST_SEED):
            message = f"should be a whole number in 0 … {LARGEST_SEED}"
            raise MbmError(faults.wrong_value("seed", message))
        if isinstance(request.starts, RandomStarts):
            request = replace(request, starts=replace(request.starts, seed=None))
        request = replace(request, seed=seed)
    if starts is not None:
        if not (isinstance(starts, int) and not isinstance(starts, bool) and 1 <= starts <= MAXIMUM_STARTS):
            message = f"should be a whole number in 1 … {MAXIMUM_STARTS}"
            raise MbmError(faults.wrong_value("starts", message))
        kept = request.starts.seed if isinstance(request.starts, RandomStarts) else None
        request = replace(request, starts=RandomStarts(count=starts, seed=kept))
    if method is None:
        return replace(problem, request=request)
    method = str(method)  # a value of another type names no solver either
    estimator = named_estimator(method)
    if estimator is None:
        chosen, routine = _named_method(method, None, routines)
        request = replace(request, method=chosen, routine=routine)
        return replace(problem, request=request)
    if problem.sequence is None:
        raise MbmError(faults.no_states(None, f"`--method {method}`"))
    before = problem.sequence.estimator
    estimator = replace(estimator, hypotheses=before.hypotheses, cuts=before.cuts)
    if before.span is not None:
        checked_cuts(estimator, before.span)
    sequence = replace(problem.sequence, estimator=estimator)
    return replace(problem, request=replace(request, method=Method.AUTO, routine=None), sequence=sequence)


def _method(form: Form | None, routines: Routines) -> tuple[Method, str | None]:
    """The method, and the registered closed form that it is, if it is one."""
    if form is None or is_of_sequences(form):
        return Method.AUTO, None
    name = form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
    return _named_method(name or form.span.text, form.span, routines)


def _named_method(name: str, span: Span | None, routines: Routines) -> tuple[Method, str | None]:
    method = next((m for m in Method if m.value == name), None)
    if method is not None:
        return method, None
    registered = routines()
    if name in registered:
        return Method.CLOSED_FORM, name
    known = (*(m.value for m in Method), *METHODS, *registered)
    raise MbmError(faults.unknown_method(span, name, known))


def _constraint_method(form: Form | None) -> ConstraintMethod:
    """How constraints are met; the estimator of a sequence takes ``truncate``."""
    if form is None or (form.name if isinstance(form, Symbol) else form.span.text) == TRUNCATE:
        return ConstraintMethod.PENALTY
    wrong = "constraints are met by `penalty` or `exact`, of filters by `truncate`, not by `{}`"
    return word_of(form, ConstraintMethod, wrong, "(solve :constraints exact)")


def _gauge(form: Form | None) -> Gauge:
    """What becomes of common motions."""
    wrong = "common motions are to be reported (`report`) or left to a datum (`free`), not `{}`"
    return Gauge.REPORT if form is None else word_of(form, Gauge, wrong, "(solve :gauge free)")


def _integer(work: Workspace, form: Form | None, default: int, low: int, high: int, name: str) -> int:
    return default if form is None else whole_within(work, form, low, high, f"`:{name}`", USAGE)


def _share(work: Workspace, form: Form | None, name: str, default: float) -> float:
    if form is None:
        return default
    value = nearest(static_number(work.evaluator.wanted(form, work.scope), form.span))
    if not 0 < value < 1:
        raise MbmError(language_faults.bad_form(form.span, f"`:{name}` should lie between 0 and 1", USAGE))
    return value


def read_starts(
    work: Workspace, form: Form | None, declarations: Iterable[Declaration]
) -> RandomStarts | GivenStarts | None:
    """The starts that ``:starts`` asks for; None where it is left out.

    Raises:
        MbmError: it asks for none, for too many, or for values of what is no unknown.

    """
    if form is None:
        return None
    if isinstance(form, Sequence) and form.head == "random":
        return _random(work, form)
    if isinstance(form, Sequence) and form.head == "given":
        return _given(work, form, {d.name.name: d for d in declarations})
    message = f"`{form.span.text}` says nothing about where to start"
    raise MbmError(language_faults.bad_form(form.span, message, STARTS_USAGE))


def _random(work: Workspace, form: Sequence) -> RandomStarts:
    options = split_options(form.items[1:], form.span, owner="`random`", known=("seed",))
    if len(options.positional) != 1:
        raise MbmError(language_faults.bad_form(form.span, "`random` takes the number of starts", STARTS_USAGE))
    count = whole_within(work, options.positional[0], 1, MAXIMUM_STARTS, "the number of starts", STARTS_USAGE)
    seed = options.get("seed")
    if seed is not None:
        return RandomStarts(count=count, seed=whole_within(work, seed, 0, LARGEST_SEED, "`:seed`", STARTS_USAGE))
    return RandomStarts(count=count)


def _given(work: Workspace, form: Sequence, declarations: Mapping[str, Declaration]) -> GivenStarts:
    if len(form.items) == 1:
        raise MbmError(language_faults.bad_form(form.span, "`given` lists no start", STARTS_USAGE))
    return GivenStarts(starts=tuple(_start(work, start, declarations) for start in form.items[1:]))


def _start(work: Workspace, form: Form, declarations: Mapping[str, Declaration]) -> Mapping[str, tuple[float, ...]]:
    """The values of one start by name, one number for each component in SI."""
    if not isinstance(form, Sequence) or not form.items:
        raise MbmError(language_faults.bad_form(form.span, "a start is a list of (name value)", STARTS_USAGE))
    found: dict[str, tuple[float, ...]] = {}
    for entry in form.items:
        if not isinstance(entry, Sequence) or len(entry.items) != 2 or not isinstance(entry.items[0], Symbol):
            raise MbmError(language_faults.bad_form(entry.span, "a start is a list of (name value)", STARTS_USAGE))
        name, given = entry.items[0].name, entry.items[1]
        declaration = declarations.get(name)
        if declaration is None:
            raise MbmError(faults.unknown_override(name, tuple(declarations), entry.items[0].span))
        value = work.evaluator.wanted(given, work.scope)
        found[name] = tuple(float(n.value) for n in stated_numbers(declaration, value, given.span))
    return MappingProxyType(found)
