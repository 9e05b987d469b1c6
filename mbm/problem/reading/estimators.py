"""How a sequence is estimated: ``:method`` where it names a filter, a smoother or ``batch``, and ``:hypotheses``;
what it asks of interval methods. ``:loss`` of an observation and ``:robust`` of the solve: what is to happen to
measurements that do not fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from enum import StrEnum
from math import inf, isfinite
from types import MappingProxyType
from typing import TypeVar

from mbm.expression.nodes import Apply, Constant, Number, nearest
from mbm.expression.units import NONE as DIMENSIONLESS
from mbm.language import faults as language_faults
from mbm.language.scope import integer, static_number
from mbm.problem import faults
from mbm.problem.clauses import split_options
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.kinds import ConsensusKind, LossKind
from mbm.problem.reading.declarations import Declaration
from mbm.problem.requests import Contractor, Enclosing
from mbm.problem.sequence.types import Estimator, SequenceMethod
from mbm.problem.types import Block, BlockRole, Consensus, Loss
from mbm.problem.zero_points import stated_difference
from mbm.solver.losses import LOSSES
from mbm.text.types import Form, Keyword, MbmError, Sequence, Span, Symbol

_NAMES = [f"({kind.value} a [c])" if LOSSES[kind].shaped else kind.value for kind in LossKind]
LOSS_USAGE = f":loss none | {_NAMES[0]} | ({_NAMES[0]} c) | {' | '.join(_NAMES[1:])}"
CONSENSUS_USAGE = (
    ":robust none | lmeds | (lmeds :trials n) | (ransac :threshold t :trials n) | (msac …) | "
    "(gnc :threshold t | :quantile 99% :trust form)"
)
NONE = "none"
MAXIMUM_TRIALS = 100_000
LARGEST_QUANTILE = 1.0 - 1e-12
"""Beyond it χ² has no limit that could be told from none."""
LARGEST_SHAPE = 2.0
LEAST_DEVIATIONS, MOST_DEVIATIONS = 1e-50, 1e50
"""Between them lies each number of standard deviations that means something, and its powers are numbers."""


Word = TypeVar("Word", bound=StrEnum)


def read_loss(work: Workspace, form: Form | None) -> Loss | None:
    """The loss that ``:loss`` names; None for none.

    Raises:
        MbmError: it names no loss, or its parameters are none.

    """
    name, parameters = named(form, LOSS_USAGE)
    if form is None or name == NONE:
        return None
    kind = next((k for k in LossKind if k.value == name), None)
    if kind is None:
        known = (NONE, *(k.value for k in LossKind))
        raise MbmError(faults.unknown_loss(form.span, name, known))
    shape = None
    if LOSSES[kind].shaped:
        if not parameters:
            raise MbmError(language_faults.bad_form(form.span, f"`{name}` takes its exponent a", LOSS_USAGE))
        shape = number_within(work, parameters[0], -inf, LARGEST_SHAPE, f"the exponent of `{name}` should be at most 2")
        parameters = parameters[1:]
    if len(parameters) > 1:
        raise MbmError(language_faults.bad_form(parameters[1].span, f"`{name}` takes no more", LOSS_USAGE))
    scale = None
    if parameters:
        scale = _deviations(work, parameters[0], f"the parameter of `{name}`", LOSS_USAGE)
    return Loss(kind=kind, scale=scale, shape=shape)


def read_consensus(work: Workspace, form: Form | None) -> Consensus | None:
    """The consensus estimator that ``:robust`` names; None for none.

    Raises:
        MbmError: it names none, or its options are wrong.

    """
    name, items = named(form, CONSENSUS_USAGE)
    if form is None or name == NONE:
        return None
    kind = next((k for k in ConsensusKind if k.value == name), None)
    if kind is None:
        known = (NONE, *(k.value for k in ConsensusKind))
        raise MbmError(faults.unknown_consensus(form.span, name, known))
    allowed = {ConsensusKind.LMEDS: ("trials",), ConsensusKind.GNC: ("threshold", "quantile", "trust")}
    options = split_options(
        items, form.span, owner=f"`{name}`", known=allowed.get(kind, ("threshold", "trials")), alone=CONSENSUS_USAGE
    )  # fmt: skip
    trials = threshold = quantile = None
    if (given := options.get("trials")) is not None:
        trials = whole_within(work, given, 1, MAXIMUM_TRIALS, "`:trials`", CONSENSUS_USAGE)
    if (given := options.get("threshold")) is not None:
        threshold = _deviations(work, given, "`:threshold`", CONSENSUS_USAGE)
    if (given := options.get("quantile")) is not None:
        if threshold is not None:
            wrong = "`:quantile` and `:threshold` say the same in two ways"
            raise MbmError(language_faults.bad_form(given.span, wrong, CONSENSUS_USAGE))
        wrong = "`:quantile` is a probability between 0 and 1, such as `99%`"
        quantile = number_within(work, given, 0.0, LARGEST_QUANTILE, wrong, usage=CONSENSUS_USAGE)
    trusting = options.get("trust") is not None
    return Consensus(kind=kind, trials=trials, threshold=threshold, quantile=quantile, trusting=trusting)


def read_trust(work: Workspace, form: Form | None, blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    """The blocks with the rows that ``:trust`` of ``:robust`` means; of tables without its columns no row.

    Raises:
        MbmError: no table has its columns, or it is no condition.

    """
    _, items = named(form, CONSENSUS_USAGE)
    given = next(
        (items[i + 1] for i, item in enumerate(items) if isinstance(item, Keyword) and item.name == "trust"), None
    )
    if given is None:
        return blocks
    found, missed = list(blocks), list[MbmError]()
    observed = [i for i, block in enumerate(blocks) if block.role is BlockRole.OBSERVATION]
    for i in observed:
        table = blocks[i].table
        try:
            trust = work.conditions(given, None if table is None else work.tables[table], 1, wanted="`:trust`")
        except MbmError as error:
            if any(d.code is not language_faults.UNKNOWN_NAME for d in error.diagnostics):
                raise
            missed.append(error)
        else:
            found[i] = replace(blocks[i], trust=trust)
    if missed and len(missed) == len(observed):
        raise missed[0]
    return tuple(found)


def named(form: Form | None, usage: str) -> tuple[str, tuple[Form, ...]]:
    """The name that a symbol or the head of a list is, and what follows it."""
    if form is None:
        return NONE, ()
    if isinstance(form, Symbol):
        return form.name, ()
    if isinstance(form, Sequence) and form.head is not None:
        return form.head, form.items[1:]
    raise MbmError(language_faults.bad_form(form.span, f"`{form.span.text}` names nothing", usage))


def _deviations(work: Workspace, form: Form, what: str, usage: str) -> float:
    wrong = (
        f"{what} is a number of standard deviations above 0, and between {LEAST_DEVIATIONS:g} and {MOST_DEVIATIONS:g}"
    )
    return number_within(work, form, LEAST_DEVIATIONS, MOST_DEVIATIONS, wrong, usage)


def whole_within(work: Workspace, form: Form, low: int, high: int, what: str, usage: str) -> int:
    """A whole number from ``low`` to ``high``."""
    value = integer(work.evaluator.wanted(form, work.scope), form.span, f"{what} (a whole number)")
    if not low <= value <= high:
        raise MbmError(language_faults.bad_form(form.span, f"{what} should lie in {low} … {high}", usage))
    return value


def word_of(form: Form, words: type[Word], wrong: str, usage: str) -> Word:
    """One of the ``words`` that an option may say; ``wrong`` has a place for what it says else."""
    name = form.name if isinstance(form, Symbol) else form.span.text
    found = next((each for each in words if each.value == name), None)
    if found is None:
        raise MbmError(language_faults.bad_form(form.span, wrong.format(name), usage))
    return found


def number_within(work: Workspace, form: Form, low: float, high: float, wrong: str, usage: str = LOSS_USAGE) -> float:
    """A number without a unit above ``low`` and up to ``high``, both finite or not."""
    given = work.evaluator.wanted(form, work.scope)
    value = nearest(static_number(given, form.span))
    measured = isinstance(given, Number | Constant) and given.dimension not in (None, DIMENSIONLESS)
    if measured or not (low < value <= high and abs(value) < inf):
        raise MbmError(language_faults.bad_form(form.span, wrong, usage))
    return value


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
    count = whole_within(work, hypotheses, 1, MOST_HYPOTHESES, "`:hypotheses`", USAGE)
    if count > 1 and found.method is SequenceMethod.BATCH:
        message = "`batch` follows one hypothesis"
        raise MbmError(
            language_faults.bad_form(hypotheses.span, message, "(solve :method truncated-ekf :hypotheses 8)")
        )
    return replace(found, hypotheses=count)


def checked_cuts(estimator: Estimator, span: Span) -> Estimator:
    """The estimator, unless it is to cut distributions and cannot.

    Raises:
        MbmError: a smoother of fixed lag, or ``batch``.

    """
    batch = estimator.method is SequenceMethod.BATCH
    if not estimator.cuts or not (batch or estimator.lag):
        return estimator
    mend = "`batch` meets constraints" if batch else "one of fixed lag takes none"
    message = f"`:constraints truncate` cuts what a filter, or the smoother of all steps, knows; {mend}"
    raise MbmError(language_faults.bad_form(span, message, "(solve :method smoother :constraints truncate)"))


def named_estimator(name: str) -> Estimator | None:
    """The estimator of a name alone, as callers give it; None where the name is no sequence's."""
    return Estimator(method=SequenceMethod(name)) if name in METHODS else None


def _read(work: Workspace, form: Form) -> Estimator:
    name, items = named(form, USAGE)
    method = SequenceMethod(name)
    options = split_options(items, form.span, owner=f"`{name}`", known=_OPTIONS.get(method, ()), alone=USAGE)
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
        found = replace(found, lag=whole_within(work, lag, 1, LONGEST_LAG, "`:lag`", USAGE))
    return found


INTERVAL_USAGE = ":method (interval [:contract forward | hc4 | hull] [:width 1% | ((unknown width)…)] [:boxes n])"
LARGEST_LIMIT = 10_000_000


def read_enclosing(work: Workspace, form: Form | None, declarations: Iterable[Declaration]) -> Enclosing | None:
    """What is asked of interval methods; None where ``form`` is another method, or none.

    Raises:
        MbmError: an option is wrong.

    """
    if not (isinstance(form, Sequence) and form.head == "interval"):
        return None
    known = ("contract", "width", "boxes")
    options = split_options(form.items[1:], form.span, owner="`interval`", known=known, alone=INTERVAL_USAGE)
    contractor, boxes = Contractor.HC4, Enclosing().boxes
    if (given := options.get("contract")) is not None:
        contractor = word_of(given, Contractor, "`{}` is no contractor", INTERVAL_USAGE)
    if (given := options.get("boxes")) is not None:
        boxes = whole_within(work, given, 1, LARGEST_LIMIT, "`:boxes`", INTERVAL_USAGE)
    width = options.get("width")
    if width is None:
        return Enclosing(contractor=contractor, boxes=boxes)
    if isinstance(width, Sequence) and width.items and isinstance(width.items[0], Sequence):
        return Enclosing(contractor=contractor, widths=_widths(work, width, declarations), boxes=boxes)
    wrong = "`:width` is a part of each box above 0 and up to 100%, or a width for each unknown"
    fraction = number_within(work, width, 0.0, 1.0, wrong, INTERVAL_USAGE)
    return Enclosing(contractor=contractor, fraction=fraction, boxes=boxes)


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
