"""How a sequence is estimated: ``:method`` where it names a filter, a smoother or ``batch``, and ``:hypotheses``;
what it asks of interval methods.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import inf, isfinite
from types import MappingProxyType

from mbm.expression.dimension import NONE as DIMENSIONLESS
from mbm.expression.nodes import Apply, Constant, Number, nearest
from mbm.language import faults as language_faults
from mbm.language.coerce import integer, static_number
from mbm.problem import faults
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.options import split_options
from mbm.problem.reading.declarations import Declaration
from mbm.problem.reading.robust import named, number_within
from mbm.problem.requests import Contractor, Enclosing
from mbm.problem.sequence.types import Estimator, SequenceMethod
from mbm.problem.zero_points import stated_difference
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol

TRUNCATE = "truncate"
"""What ``:constraints`` says where inequalities cut the distribution of a filter."""

METHODS = tuple(method.value for method in SequenceMethod)
USAGE = ":method ekf | iterated-ekf | (truncated-ekf [:skip 3] [:iterated true]) | (smoother [:lag n]) | batch"
MOST_HYPOTHESES = 1000
LONGEST_LAG = 1_000_000_000
_OPTIONS = {SequenceMethod.TRUNCATED: ("skip", "iterated"), SequenceMethod.SMOOTHER: ("lag",)}


def is_of_sequences(form: Form | None) -> bool:
    """Whether ``:method`` names a method for sequences."""
    if isinstance(form, Symbol):
        return form.name in METHODS
    return isinstance(form, Sequence) and form.head in METHODS


def read_estimator(work: Workspace, solves: list[Sequence]) -> Estimator:
    """The estimator that ``solve`` asks for; ``batch`` where it names none of a sequence's.

    Raises:
        MbmError: an option that the method does not have, numbers out of range, no states.

    """
    items = solves[0].items[1:] if solves else ()
    given = dict(zip(items[::2], items[1::2], strict=False))
    options = {getattr(key, "name", ""): form for key, form in given.items()}
    method, hypotheses = options.get("method"), options.get("hypotheses")
    for form in (each for each in (method, hypotheses) if each is not None and work.scope.steps is None):
        if form is hypotheses or is_of_sequences(form):
            what = "`:hypotheses`" if form is hypotheses else f"`:method {form.span.text}`"
            raise MbmError(faults.no_states(form.span, what))
    found = _read(work, method) if method is not None and is_of_sequences(method) else Estimator()
    constraints = options.get("constraints")
    if isinstance(constraints, Symbol) and constraints.name == TRUNCATE:
        if work.scope.steps is None:
            raise MbmError(faults.no_states(constraints.span, "`:constraints truncate`"))
        found = checked_cuts(replace(found, cuts=True), constraints.span)
    if hypotheses is None:
        return found
    count = _whole(work, hypotheses, MOST_HYPOTHESES, ":hypotheses")
    if count > 1 and found.method is SequenceMethod.BATCH:
        message = "`batch` follows one hypothesis"
        raise MbmError(
            language_faults.bad_form(hypotheses.span, message, "(solve :method truncated-ekf :hypotheses 8)")
        )
    return replace(found, hypotheses=count)


def checked_cuts(estimator: Estimator, span: Span) -> Estimator:
    """The estimator, unless it is to cut distributions and is no filter.

    Raises:
        MbmError: a smoother, or ``batch``.

    """
    if not estimator.cuts or estimator.method not in (SequenceMethod.SMOOTHER, SequenceMethod.BATCH):
        return estimator
    batch = estimator.method is SequenceMethod.BATCH
    mend = "meets constraints at all steps at once" if batch else "reports how they are violated"
    message = f"`:constraints truncate` cuts what a filter knows after each step; `{estimator.method.value}` {mend}"
    raise MbmError(language_faults.bad_form(span, message, "(solve :method ekf :constraints truncate)"))


def named_estimator(name: str) -> Estimator | None:
    """The estimator of a name alone, as callers give it; None where the name is no sequence's."""
    return Estimator(method=SequenceMethod(name)) if name in METHODS else None


def _read(work: Workspace, form: Form) -> Estimator:
    name, items = named(form, USAGE)
    method = SequenceMethod(name)
    options = split_options(items, form.span, owner=f"`{name}`", known=_OPTIONS.get(method, ()))
    if options.positional:
        raise MbmError(language_faults.bad_form(options.positional[0].span, f"`{name}` takes options only", USAGE))
    found = Estimator(method=method, span=form.span)
    skip, lag = options.get("skip"), options.get("lag")
    if skip is not None:
        wrong = "`:skip` is a number of standard deviations above 0"
        found = replace(found, skip=number_within(work, skip, 0.0, inf, wrong, usage=USAGE))
    iterated = options.get("iterated")
    if iterated is not None:
        if not isinstance(iterated, Symbol) or iterated.name not in ("true", "false"):
            raise MbmError(language_faults.bad_form(iterated.span, "`:iterated` is true or false", USAGE))
        found = replace(found, iterated=iterated.name == "true")
    if lag is not None:
        found = replace(found, lag=_whole(work, lag, LONGEST_LAG, ":lag"))
    return found


def _whole(work: Workspace, form: Form, most: int, name: str) -> int:
    value = integer(work.evaluator.wanted(form, work.scope), form.span, f"`{name}` (a whole number)")
    if not 1 <= value <= most:
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` should lie in 1 … {most}", USAGE))
    return value


INTERVAL_USAGE = ":method (interval [:contract forward | hc4 | hull] [:width 1% | ((unknown width)…)] [:boxes n])"
LARGEST_LIMIT = 10_000_000


def read_enclosing(work: Workspace, form: Form | None, declarations: Iterable[Declaration]) -> Enclosing | None:
    """What is asked of interval methods; None where ``form`` is another method, or none.

    Raises:
        MbmError: an option is wrong.

    """
    if not (isinstance(form, Sequence) and form.head == "interval"):
        return None
    options = split_options(form.items[1:], form.span, owner="`interval`", known=("contract", "width", "boxes"))
    if options.positional:
        wrong = "`interval` takes options only"
        raise MbmError(language_faults.bad_form(options.positional[0].span, wrong, INTERVAL_USAGE))
    contractor, boxes = Contractor.HC4, Enclosing().boxes
    if (given := options.get("contract")) is not None:
        contractor = _contractor(given)
    if (given := options.get("boxes")) is not None:
        boxes = integer(work.evaluator.wanted(given, work.scope), given.span, "`:boxes` (a whole number)")
        if not 1 <= boxes <= LARGEST_LIMIT:
            wrong = f"`:boxes` should lie in 1 … {LARGEST_LIMIT}"
            raise MbmError(language_faults.bad_form(given.span, wrong, INTERVAL_USAGE))
    width = options.get("width")
    if width is None:
        return Enclosing(contractor=contractor, boxes=boxes)
    if isinstance(width, Sequence) and width.items and isinstance(width.items[0], Sequence):
        return Enclosing(contractor=contractor, widths=_widths(work, width, declarations), boxes=boxes)
    return Enclosing(contractor=contractor, fraction=_fraction(work, width), boxes=boxes)


def _contractor(form: Form) -> Contractor:
    name = form.name if isinstance(form, Symbol) else form.span.text
    found = next((c for c in Contractor if c.value == name), None)
    if found is None:
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` is no contractor", INTERVAL_USAGE))
    return found


def _fraction(work: Workspace, form: Form) -> float:
    given = work.evaluator.wanted(form, work.scope)
    value = nearest(static_number(given, form.span))
    measured = isinstance(given, Number | Constant) and given.dimension not in (None, DIMENSIONLESS)
    if measured or not 0.0 < value <= 1.0:
        wrong = "`:width` is a part of each box above 0 and up to 100%, or a width for each unknown"
        raise MbmError(language_faults.bad_form(form.span, wrong, INTERVAL_USAGE))
    return value


def _widths(work: Workspace, form: Sequence, declarations: Iterable[Declaration]) -> Mapping[str, tuple[Number, ...]]:
    """The widths by unknown, in SI: one number for each coordinate."""
    known = {d.name.name: d for d in declarations}
    found: dict[str, tuple[Number, ...]] = {}
    for item in form.items:
        if not (isinstance(item, Sequence) and len(item.items) == 2 and isinstance(item.items[0], Symbol)):
            raise MbmError(language_faults.bad_form(item.span, "a width is (unknown width)", INTERVAL_USAGE))
        name, stated = item.items[0].name, item.items[1]
        declaration = known.get(name)
        if declaration is None:
            raise MbmError(language_faults.bad_form(item.items[0].span, f"`{name}` is no unknown", INTERVAL_USAGE))
        if name in found:
            raise MbmError(language_faults.bad_form(item.span, f"`{name}` has two widths", INTERVAL_USAGE))
        shape = declaration.shape if not declaration.dimension else (declaration.manifold.tangent,)
        elements = shaped(work.evaluator.wanted(stated, work.scope), shape, stated.span)
        found[name] = tuple(_width(element, stated) for element in elements)
    return MappingProxyType(found)


def _width(element: object, form: Form) -> Number:
    value = nearest(static_number(element, form.span))  # type: ignore[arg-type]
    if isinstance(element, Number | Constant | Apply):
        stated_difference(element, form.span)
    if not (isfinite(value) and value > 0.0):
        raise MbmError(language_faults.bad_form(form.span, "a width is a number above 0", INTERVAL_USAGE))
    dimension = element.dimension if isinstance(element, Number | Constant) else None
    return Number(value, dimension, form.span)
