"""Whether observations with a likelihood of their own and the method of a problem go together."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.nodes import Number
from mbm.problem import faults
from mbm.problem.likelihoods.types import Law, Likelihood
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.types import Block, Method, NoiseKind, Problem
from mbm.text.types import Diagnostic, Span


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


def refused_likelihoods(problem: Problem) -> Iterator[Diagnostic]:
    """What the method cannot take."""
    request, sequence = problem.request, problem.sequence
    robust = f"`:robust {request.robust.kind.value}`" if request.robust is not None else ""
    filtering = sequence is not None and sequence.estimator.method is not SequenceMethod.BATCH
    why = (
        (filtering, "a filter or smoother, whose updates are linear", "write `(solve :method batch)`"),
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
