"""Whether a problem and its method go together, as far as bounds and likelihoods are concerned."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.nodes import Apply, Column, Component, Expression, Number, postorder
from mbm.problem import faults
from mbm.problem.aggregates import is_aggregate
from mbm.problem.kinds import ConstraintMethod, Gauge
from mbm.problem.likelihoods.types import Law, Likelihood
from mbm.problem.requests import Contractor
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.types import Block, BlockRole, Method, NoiseKind, Problem, UnknownKind
from mbm.text.types import Diagnostic, MbmError, Span


def likelihood_of(block: Block) -> Likelihood | None:
    """What the first equation with a likelihood says; None: all errors are normal with stated weights."""
    every = (equation.likelihood for case in block.cases for equation in case.equations)
    return next((each for each in every if each is not None), None)


def called(likelihood: Likelihood) -> str:
    """How messages call what makes it one."""
    stated = likelihood.truncation
    if likelihood.law is not Law.NORMAL:
        return f"`:distribution {likelihood.law.value}`"
    if stated is None:
        return "`model` in the noise"
    return "`:resolution`" if stated.step is not None else "`:below`" if stated.below is not None else "`:above`"


def refused_likelihoods(problem: Problem, *, streaming: bool = False) -> Iterator[Diagnostic]:
    """What the method cannot take, or where steps come one by one (``streaming``) a stream."""
    request, sequence = problem.request, problem.sequence
    robust = f"`:robust {request.robust.kind.value}`" if request.robust is not None else ""
    filtering = sequence is not None and sequence.estimator.method is not SequenceMethod.BATCH
    carrying = request.window is not None and request.window.carry
    why = (
        (streaming, "a stream, whose updates are linear", "let `solve` with `:method batch` have all rows at once"),
        (carrying, "`:carry`, by which what leaves is a normal prior", "leave `:carry` out"),
        (
            filtering and not (streaming or carrying),
            "a filter or smoother, whose updates are linear",
            "write `(solve :method batch)`",
        ),
        (bool(robust), robust, "leave it out; `:distribution (student dof)` has long tails of its own"),
        (request.method is Method.CLOSED_FORM or request.routine is not None, "a closed form", "use another `:method`"),
    )
    for block in problem.blocks:
        found = likelihood_of(block)
        joined = (block.structure.joins, block.structure.what, "leave it out")
        for holds, what, hint in (*why, joined) if found is not None else ():
            if holds and found is not None:
                said = f"of `{block.name}` does not go with {what}"
                hint = faults.NEVER_FAR_OUT if found.truncation is not None and what == robust else hint
                yield faults.likelihood_not_here(block.span, called(found), said, hint)


def percentages(problem: Problem) -> Iterator[Diagnostic]:
    """A hint for each plain percentage that is a standard deviation: a number, whatever it looks like."""
    for block in problem.blocks:
        stated = (n for c in block.cases for e in c.equations if e.noise_kind is NoiseKind.SIGMA for n in e.noise)
        number = next((n for n in stated if isinstance(n, Number) and n.span is not None and _is_share(n.span)), None)
        if number is not None and number.span is not None and not block.unknown_factor:
            yield faults.sigma_not_relative(number.span, float(number.value))


def _is_share(span: Span) -> bool:
    return span.text.endswith("%")


_ANOTHER = "use another `:method`"
_NOISE = "write `:bound FORM`: the greatest error that may occur, in the unit of the measurement"


def refuse_mixed_bounds(problem: Problem) -> None:
    """Refuse bounds and likelihoods that the method cannot use, and what interval methods cannot use.

    Raises:
        MbmError: bound-without-interval, not-for-intervals, likelihood-not-here.

    """
    found = (
        *(_for_intervals(problem) if problem.request.method is Method.INTERVAL else _for_others(problem)),
        *refused_likelihoods(problem),
    )
    if found:
        raise MbmError(*found)


def bounded(block: Block) -> bool:
    """Whether the errors of an observation are bounded."""
    return any(e.noise_kind is NoiseKind.BOUND for case in block.cases for e in case.equations)


def _for_others(problem: Problem) -> Iterator[Diagnostic]:
    for block in problem.blocks:
        if bounded(block):
            yield faults.bound_without_interval(block.span, block.name, problem.request.method.value)


def _for_intervals(problem: Problem) -> Iterator[Diagnostic]:
    request = problem.request
    for block in problem.blocks:
        yield from _block(block)
    yield from _sequence(problem)
    for unknown in problem.unknowns:
        if not unknown.manifold.flat:
            hint = "write it with angles and numbers, e.g. `(euler phi theta psi)` of three unknowns of type `angle`"
            kind = (
                unknown.kind.value
                if unknown.kind is UnknownKind.DIRECTION
                else f"({unknown.kind.value} {unknown.dimension})"
            )
            yield faults.not_for_intervals(unknown.span, f"an unknown of type `{kind}`", hint)
    for constant in problem.constants:
        if any(constant.sigmas):
            hint = "make it an unknown with `:in (low high)`, or leave the deviation out"
            yield faults.not_for_intervals(
                constant.span, f"the standard deviation of the constant `{constant.name}`", hint
            )
    for derived in problem.derived:
        if derived.kind is not None:
            hint = "derive its numbers, e.g. `(heading P)` or `(translation P)`"
            yield faults.not_for_intervals(derived.span, f"a derived {derived.kind.value}", hint)
        for each in derived.cases:
            yield from _operations(each.values)
    asked = (
        (request.robust is not None, "`:robust`", "leave it out: an outlier is beyond its `:bound`"),
        (request.starts is not None, "`:starts`", "leave it out: the whole box is searched; `:in` says which"),
        (
            request.constraints is ConstraintMethod.EXACT,
            "`:constraints exact`",
            "leave it out: constraints always hold",
        ),
        (request.gauge is Gauge.FREE, "`:gauge free`", "leave it out: what is free has wide bounds"),
    )
    for given, what, hint in asked:
        if given:
            yield faults.not_for_intervals(problem.span, what, hint)


def _sequence(problem: Problem) -> Iterator[Diagnostic]:
    """Transitions whose noise is not bounded, and what of a sequence is not looked for frame by frame."""
    sequence, enclosing = problem.sequence, problem.request.enclosing
    if sequence is None:
        return
    blocks = {block.name: block for block in problem.blocks}
    for transition in sequence.transitions:
        block = None if transition.block is None else blocks[transition.block]
        if block is not None and not bounded(block):
            name = transition.states[0]
            hint = f"write `(= (next {name}) FORM :bound b)`, with `:sigma 0` for what is exact; `(dt)` is the time"
            what = f"the standard deviation of the transition of `{name}`"
            yield faults.not_for_intervals(transition.span, what, hint)
    for state in sequence.states:
        if state.prior is not None:
            hint = f"write `:in (low high)`, or a constraint on `{state.name}` with `:at first`"
            yield faults.not_for_intervals(state.span, f"the standard deviation of `{state.name}`", hint)
    if enclosing is not None and enclosing.contractor is Contractor.HULL:
        hint = "use `hc4`: states of all steps are too many to be bisected together"
        yield faults.not_for_intervals(sequence.span, "`:contract hull` with states", hint)


def _block(block: Block) -> Iterator[Diagnostic]:
    if block.role is BlockRole.PRIOR or (block.role is BlockRole.OBSERVATION and not bounded(block)):
        prior = block.role is BlockRole.PRIOR
        what = f"the standard deviation of {'a prior' if prior else f'`{block.name}`'}"
        hint = "write `:in (low high)`, or `(uniform FORM low high)` in `constraints`" if prior else _NOISE
        if block.unknown_factor:
            what = f"the unknown noise of `{block.name}`"
        yield faults.not_for_intervals(block.span, what, hint)
    if block.loss is not None:
        hint = "leave it out: errors beyond the `:bound` make the set empty"
        yield faults.not_for_intervals(block.span, f"the `:loss` of `{block.name}`", hint)
    if block.errors:
        hint = "make the true value an unknown, `:per` the table, and observe it with a `:bound`"
        yield faults.not_for_intervals(block.span, f"the `:errors` of `{block.name}`", hint)
    for case in block.cases:
        for equation in case.equations:
            yield from _operations(equation.components)


def _operations(values: tuple[Expression, ...]) -> Iterator[Diagnostic]:
    """What has no interval extension, each function once."""
    seen: set[str] = set()
    for node in postorder(values):
        if isinstance(node, Component) and is_aggregate(node.unknown) and node.unknown not in seen:
            seen.add(node.unknown)
            hint = "derive the form `:over` the table, or constrain the aggregate: there it is written out"
            yield faults.not_for_intervals(node.span, f"`{node.unknown}`, an aggregate over rows", hint)
        name = None
        if isinstance(node, Apply) and node.output is not None:
            name = node.output.external.function
        elif isinstance(node, Column) and node.sampling is not None:
            name = "sample"
        if name is not None and name not in seen:
            seen.add(name)
            hint = f"write the value with arithmetic and elementary functions, or {_ANOTHER}"
            yield faults.not_for_intervals(node.span, f"`{name}`, whose bounds are not known", hint)
