"""``:prior (rectangular lo hi)`` of an unknown: a prior on its numbers, and a start where ``:init`` gives none."""

from __future__ import annotations

from mbm.expression.nodes import Expression
from mbm.language import faults as language_faults
from mbm.language.coerce import difference
from mbm.language.values import Array, Scope
from mbm.problem.elaboration import Workspace
from mbm.problem.naming import PRIOR
from mbm.problem.reading.declarations import Declaration, components, own_member
from mbm.problem.reading.distributions import DISTRIBUTIONS, is_distribution, law_of, moments
from mbm.problem.reading.equations import data_only
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, NoiseKind, RowValues
from mbm.text.suggest import suggestion
from mbm.text.types import MbmError, Sequence

USAGE = ":prior (rectangular lo hi), and likewise " + " ".join(name for name in DISTRIBUTIONS if name != "rectangular")


def prior_start(work: Workspace, declaration: Declaration, table: Table | None) -> RowValues | None:
    """The mean of the prior, where the unknown starts without ``:init``; None without a prior."""
    form = _distribution(work, declaration)
    if form is None:
        return None
    return work.row_values(form, table, lambda scope: _moments(work, declaration, form, scope)[0])


def stated_prior(work: Workspace, declaration: Declaration, table: Table | None) -> Block | None:
    """The prior of ``:prior``; None without one.

    Raises:
        MbmError: it is no distribution, the unknown is no number, or its noise is stated beside it.

    """
    form = _distribution(work, declaration)
    if form is None:
        return None

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        value = components(declaration, own_member(declaration.family), declaration.name.span)
        own = value.elements if isinstance(value, Array) else (value,)
        mean, sigma = _moments(work, declaration, form, scope)
        found = tuple(difference(a, b, form.span) for a, b in zip(own, mean, strict=True))  # type: ignore[arg-type]
        noise = NoiseKind.SIGMA
        law = law_of(work, form.head or "", form.items[1:], scope)
        known = data_only(mean)
        return (Equation(components=found, noise_kind=noise, noise=sigma, measured=known, law=law, span=form.span),)

    cases = work.cases(table, evaluate, form.span)
    return Block(
        name=PRIOR + declaration.name.name,
        role=BlockRole.PRIOR,
        table=table.name if table is not None else None,
        cases=tuple(EquationCase(static=s, equations=e) for s, e in cases),
        when=None,
        unknown_factor=False,
        span=form.span,
    )


def _distribution(work: Workspace, declaration: Declaration) -> Sequence | None:
    """The form behind ``:prior``, checked as far as its head."""
    form = declaration.options.get("prior")
    if form is None:
        return None
    places = declaration.options.places
    for other in ("sigma", "covariance"):
        if declaration.options.get(other) is not None:
            message = f"`:prior` and `:{other}` state two priors of `{declaration.name.name}`"
            raise MbmError(language_faults.bad_form(places[other], message, "", "keep one of them"))
    if declaration.dimension:
        message = f"`:prior` is for numbers, and a {declaration.kind.value} is none"
        raise MbmError(language_faults.bad_form(form.span, message, "`:init` with `:sigma` or `:covariance`"))
    head = form.head if isinstance(form, Sequence) else None
    if not isinstance(form, Sequence) or head is None or not is_distribution(work, head):
        hint = USAGE if head is None else suggestion(head, tuple(DISTRIBUTIONS), USAGE)
        raise MbmError(language_faults.bad_form(form.span, f"`{form.span.text}` is no distribution", hint or USAGE))
    return form


def _moments(
    work: Workspace, declaration: Declaration, form: Sequence, scope: Scope
) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    mean, sigma = moments(work, form.head or "", form.items[1:], declaration.shape, scope, form.span)
    work.refuse_unknowns((*mean, *sigma), form.span, f"`:prior` of `{declaration.name.name}`")
    return mean, sigma
