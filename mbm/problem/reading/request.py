"""``(solve option…)`` and ``(for-each COLUMN…)``: how to solve, and which problems to make of the data."""

from __future__ import annotations

from dataclasses import replace

from mbm.language import faults as language_faults
from mbm.language.coerce import integer, static_number
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.options import split_options
from mbm.problem.types import Method, Problem, Request
from mbm.text.suggest import closest
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol

USAGE = "(solve [:method lm] [:max-iterations 100] [:tolerance 1e-10] [:seed 1])"
_METHODS_LATER = (
    "ipopt",
    "closed-form",
    "direct-search",
    "interval",
    "ekf",
    "iterated-ekf",
    "truncated-ekf",
    "smoother",
    "batch",
)
_DEFAULTS = {"robust": "none", "constraints": "penalty", "gauge": "report"}
_TOPICS = {"robust": "robust estimation", "constraints": "exact constraints", "gauge": "gauge freedom"}
MAXIMUM_ITERATIONS = 1_000_000
LARGEST_SEED = 2**63 - 1


def read_request(work: Workspace, solves: list[Sequence], for_each: list[Sequence]) -> Request:
    """The request that the clauses make: at most one ``solve``, and the columns of all ``for-each``."""
    columns = tuple(_columns(work, for_each))
    if not solves:
        return Request(for_each=columns)
    solve = solves[0]
    for other in solves[1:]:
        raise MbmError(language_faults.duplicate_definition(other.span, "solve", solve.span))
    options = split_options(
        solve.items[1:],
        solve.span,
        owner="`solve`",
        known=("method", "robust", "constraints", "gauge", "seed", "max-iterations", "tolerance"),
        not_yet={"starts": "multi-start", "hypotheses": "sequences"},
    )
    if options.positional:
        raise MbmError(language_faults.bad_form(options.positional[0].span, "`solve` takes options only", USAGE))
    for name, default in _DEFAULTS.items():
        form = options.get(name)
        if form is not None and not (isinstance(form, Symbol) and form.name == default):
            raise MbmError(language_faults.not_available_yet(form.span, f"`:{name} {form.span.text}`", _TOPICS[name]))
    return Request(
        method=_method(options.get("method")),
        seed=_integer(work, options.get("seed"), 1, 0, LARGEST_SEED, "seed"),
        max_iterations=_integer(work, options.get("max-iterations"), 100, 1, MAXIMUM_ITERATIONS, "max-iterations"),
        tolerance=_tolerance(work, options.get("tolerance")),
        for_each=columns,
    )


def _columns(work: Workspace, clauses: list[Sequence]) -> dict[str, Span]:
    """The names in all ``for-each``, each with its place."""
    found: dict[str, Span] = {}
    for clause in clauses:
        if len(clause.items) == 1:
            raise MbmError(language_faults.bad_form(clause.span, "`for-each` names no column", "(for-each column…)"))
    for form in (form for clause in clauses for form in clause.items[1:]):
        if not isinstance(form, Symbol):
            raise MbmError(
                language_faults.bad_form(form.span, "`for-each` takes names of columns", "(for-each column…)")
            )
        if not any(form.name in table.columns for table in work.tables.values()):
            every = tuple(dict.fromkeys(c for table in work.tables.values() for c in table.columns))
            raise MbmError(faults.unknown_column(form.span, form.name, "any table", every))
        if form.name in found:
            raise MbmError(language_faults.duplicate_definition(form.span, form.name, found[form.name]))
        found[form.name] = form.span
    return found


def requested(problem: Problem, *, seed: int | None, method: str | None) -> Problem:
    """``problem`` with the seed and the method that the caller asks for; None leaves them to the file."""
    request = problem.request
    if seed is not None:
        if not (isinstance(seed, int) and 0 <= seed <= LARGEST_SEED):
            raise MbmError(faults.bad_override("seed", f"should be a whole number in 0 … {LARGEST_SEED}"))
        request = replace(request, seed=seed)
    if method is not None:
        request = replace(request, method=_named_method(method, None))
    return replace(problem, request=request)


def _method(form: Form | None) -> Method:
    if form is None:
        return Method.AUTO
    name = form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
    return _named_method(name or form.span.text, form.span)


def _named_method(name: str, span: Span | None) -> Method:
    method = next((m for m in Method if m.value == name), None)
    if method is not None:
        return method
    if name in _METHODS_LATER:
        raise MbmError(language_faults.not_available_yet(span, f"`:method {name}`", "other solvers"))
    known = tuple(m.value for m in Method)
    raise MbmError(faults.unknown_method(span, name, closest(name, known), known))


def _integer(work: Workspace, form: Form | None, default: int, low: int, high: int, name: str) -> int:
    if form is None:
        return default
    value = integer(work.evaluator.wanted(form, work.scope), form.span, f"`:{name}` (a whole number)")
    if not low <= value <= high:
        raise MbmError(language_faults.bad_form(form.span, f"`:{name}` should lie in {low} … {high}", USAGE))
    return value


def _tolerance(work: Workspace, form: Form | None) -> float:
    if form is None:
        return Request().tolerance
    value = float(static_number(work.evaluator.wanted(form, work.scope), form.span))
    if not 0 < value < 1:
        raise MbmError(language_faults.bad_form(form.span, "`:tolerance` should lie between 0 and 1", USAGE))
    return value
