"""``:loss`` of an observation and ``:robust`` of the solve: what is to happen to measurements that do not fit."""

from __future__ import annotations

from dataclasses import replace
from math import inf

from mbm.expression.dimension import NONE as DIMENSIONLESS
from mbm.expression.nodes import Number, nearest
from mbm.language import faults as language_faults
from mbm.language.coerce import integer, static_number
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.kinds import ConsensusKind, LossKind
from mbm.problem.options import split_options
from mbm.problem.types import Block, BlockRole, Consensus, Loss
from mbm.solver.losses import LOSSES
from mbm.text.types import Form, Keyword, MbmError, Sequence, Symbol

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
        items, form.span, owner=f"`{name}`", known=allowed.get(kind, ("threshold", "trials"))
    )  # fmt: skip
    if options.positional:
        raise MbmError(
            language_faults.bad_form(options.positional[0].span, f"`{name}` takes options only", CONSENSUS_USAGE)
        )
    trials = threshold = quantile = None
    if (given := options.get("trials")) is not None:
        trials = integer(work.evaluator.wanted(given, work.scope), given.span, "`:trials` (a whole number)")
        if not 1 <= trials <= MAXIMUM_TRIALS:
            wrong = f"`:trials` should lie in 1 … {MAXIMUM_TRIALS}"
            raise MbmError(language_faults.bad_form(given.span, wrong, CONSENSUS_USAGE))
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


def number_within(work: Workspace, form: Form, low: float, high: float, wrong: str, usage: str = LOSS_USAGE) -> float:
    """A number without a unit above ``low`` and up to ``high``, both finite or not."""
    given = work.evaluator.wanted(form, work.scope)
    value = nearest(static_number(given, form.span))
    measured = isinstance(given, Number) and given.dimension not in (None, DIMENSIONLESS)
    if measured or not (low < value <= high and abs(value) < inf):
        raise MbmError(language_faults.bad_form(form.span, wrong, usage))
    return value
