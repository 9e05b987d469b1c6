"""``:distribution``, ``:below``, ``:above``, ``:resolution`` of an observation, and ``model`` in its noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mbm.expression.algebra import ONE, UndefinedValueError
from mbm.expression.nodes import Component, Expression, Number, Operation, leaves
from mbm.expression.terms import Term, function
from mbm.language.scope import LocalScope, scalar
from mbm.language.values import Array, Scope, Value
from mbm.problem import faults
from mbm.problem.clauses import Options
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.likelihoods.making import Errors, likelihood
from mbm.problem.likelihoods.types import Law, Truncation
from mbm.problem.reading.equations import Residual
from mbm.problem.types import Equation, EquationCase, NoiseKind
from mbm.text.types import Diagnostic, Form, MbmError, Sequence, Span, Symbol, symbols_of
from mbm.values import dataclass

OPTIONS = ("distribution", "below", "above", "resolution")
MODEL = "model"
USAGE = ":distribution normal | poisson | (binomial n) | (student dof)"

WithNoise = Callable[[Scope, bool], Equation]
"""The equation with its noise, as the scope says what names mean; True: no unknown may occur in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedErrors:
    """What an observation says of its errors: the law with the form of its parameter, and forms of limits and steps.

    ``beside`` are the options given that go with stated weights only.
    """

    law: Law = Law.NORMAL
    parameter: Form | None = None
    limits: tuple[tuple[str, Form], ...] = ()
    beside: tuple[str, ...] = ()
    span: Span

    @property
    def plain(self) -> bool:
        """Normal errors of readings that are neither limits nor rounded."""
        return self.law is Law.NORMAL and not self.limits

    @property
    def called(self) -> str:
        """How messages call it."""
        return f"`:{self.limits[0][0]}`" if self.limits else f"`:distribution {self.law.value}`"


def stated_errors(options: Options, *, sigma: bool) -> StatedErrors:
    """What the ``options`` of an observation say; ``sigma``: some noise is stated.

    Raises:
        MbmError: no such distribution, or it stands beside what it does not go with.

    """
    law, parameter = _law(options.get("distribution"))
    limits = tuple((name, form) for name in OPTIONS[1:] if (form := options.get(name)) is not None)
    first = next((name for name in OPTIONS if name in options.places), None)
    found = StatedErrors(
        law=law,
        parameter=parameter,
        limits=limits,
        beside=tuple(name for name in _APART if options.get(name) is not None),
        span=options.span if first is None else options.places[first],
    )
    if found.plain:
        return found
    if law is not Law.NORMAL and limits:
        hint = f"leave `:{limits[0][0]}` or the distribution out"
        raise MbmError(_not_here(found, f"does not go with `:{limits[0][0]}`", hint))
    for name in found.beside:
        hint = faults.NEVER_FAR_OUT if limits and name == "loss" else _APART[name]
        raise MbmError(_not_here(found, f"does not go with `:{name}`", hint))
    if law.counts and sigma:
        hint = "leave the noise out: a count tells its own"
        raise MbmError(_not_here(found, "takes no `:sigma`", hint))
    return found


_APART = {
    "loss": "`(student dof)` has long tails of its own",
    "errors": "make the true value an unknown, `:per` the table, and observe it",
    "bound": "give a `:sigma` in place of the bound",
    "covariance": "give a `:sigma`",
    "information": "give a `:sigma`",
}


def _law(form: Form | None) -> tuple[Law, Form | None]:
    if form is None:
        return Law.NORMAL, None
    items = form.items if isinstance(form, Sequence) else (form,)
    name = items[0].name if items and isinstance(items[0], Symbol) else None
    law = next((each for each in Law if each.value == name), None)
    if law is None:
        raise MbmError(faults.bad_distribution(form.span, f"`{form.span.text}` is no distribution of measured values"))
    wanted = 1 if law in (Law.BINOMIAL, Law.STUDENT) else 0
    if len(items) != 1 + wanted:
        takes = {Law.BINOMIAL: "the number of trials", Law.STUDENT: "the degrees of freedom"}.get(law, "no parameter")
        raise MbmError(faults.bad_distribution(form.span, f"`{law.value}` takes {takes}"))
    return law, items[1] if wanted else None


def observed(
    work: Workspace, residual: Residual, stated: StatedErrors, noise: Form | None, scope: Scope, plain: WithNoise
) -> Equation:
    """The equation with what it says of its errors; ``plain`` gives it with the noise of the form ``noise`` alone.

    Raises:
        MbmError: `model` has no meaning, or the equation is not of the kind that the errors want.

    """
    named = (
        noise is not None
        and any(each.name == MODEL for each in symbols_of(noise))
        and scope.lookup(MODEL, noise.span) is None
    )
    if stated.plain and not named:
        return plain(scope, True)
    own_scales = _unknown_scales(noise, scope)
    if residual.model is None or (residual.measured is None and not stated.plain):
        if named and noise is not None:
            raise MbmError(faults.without_model_side(noise.span))
        hint = "write `(= MEASURED MODEL)` with a measured number, or a vector of them"
        raise MbmError(_not_here(stated, "wants an equation of two sides, the first one measured", hint))
    if stated.limits and len(residual.components) > 1:
        raise MbmError(_not_here(stated, "goes with equations of one number", "write one equation for each number"))
    seen = residual.measured or tuple(Number(1, None, residual.span) for _ in residual.components)
    ones = dict.fromkeys(own_scales, Number(1, None, residual.span))
    # readings that scatter below zero have the sizes of values where a deviation has to be one, as √model
    sizes = tuple(function(Operation.ABS, Term(each)).node for each in seen)
    sides = ({MODEL: _like(residual.model, sizes)}, {MODEL: residual.model}) if named else ({}, {})
    known = made = plain(LocalScope({**ones, **sides[0]}, scope), True)
    if named or own_scales:
        made = plain(LocalScope(sides[1], scope), False)
    decides = any(isinstance(leaf, Component) for leaf in leaves(made.noise))
    if stated.plain and not decides:
        return made
    for name in stated.beside if stated.plain else ():
        if name in ("loss", "errors"):
            why = f"in the noise does not go with `:{name}`"
            raise MbmError(faults.likelihood_not_here(made.noise[0].span or stated.span, "`model`", why, _APART[name]))
    own = _own(work, stated, scope)
    errors = Errors(
        off=residual.components,
        measured=seen,
        model=shaped(residual.model, (len(seen),) if isinstance(residual.model, Array) else (), residual.span),
        sigma=made.noise,
        reference=known.noise if decides else None,
        matrix=made.noise_kind is not NoiseKind.SIGMA,
        inverse=made.noise_kind is NoiseKind.INFORMATION,
        law=stated.law,
        parameter=own[0],
        truncation=own[1],
        scales=tuple(sorted(own_scales)),
    )
    try:
        found = likelihood(errors)
    except UndefinedValueError as error:
        what = f"{stated.called} has no likelihood: `{error}` is no finite number"
        raise MbmError(faults.impossible_errors(stated.span, what)) from None
    return replace(made, noise=(ONE,) * len(seen) if stated.law.counts else made.noise, likelihood=found)


def refuse_two_scales(noise: Form, cases: list[EquationCase]) -> None:
    """Refuse a factor beside unknowns in the noise.

    Raises:
        MbmError: likelihood-not-here.

    """
    for each in (equation for case in cases for equation in case.equations):
        if each.likelihood is not None and each.likelihood.scales:
            hint = "leave `unknown` out: the noise has a scale of its own"
            why = "does not go with an unknown in the noise"
            raise MbmError(faults.likelihood_not_here(noise.span, "`unknown`", why, hint))


def _own(work: Workspace, stated: StatedErrors, scope: Scope) -> tuple[Expression | None, Truncation | None]:
    """The parameter of the law, and the limits and step, of the row at hand."""
    parameter = None
    if stated.parameter is not None:
        parameter = scalar(work.evaluator.wanted(stated.parameter, scope), stated.parameter.span)
        work.refuse_unknowns((parameter,), stated.parameter.span, f"the parameter of `{stated.law.value}`")
    if not stated.limits:
        return parameter, None
    found: dict[str, Expression] = {}
    for name, form in stated.limits:
        if name == "resolution":
            found["step"] = scalar(work.evaluator.wanted(form, scope), form.span)
            work.refuse_unknowns((found["step"],), form.span, "`:resolution`")
        else:
            found[name] = work.conditions_here(form, scope, 1, wanted=f"`:{name}`")[0]
    return parameter, Truncation(**found)


def _like(model: Value, elements: tuple[Expression, ...]) -> Value:
    """A value of the shape of the model's, with other numbers."""
    return Array(model.shape, elements) if isinstance(model, Array) else elements[0]


def _unknown_scales(noise: Form | None, scope: Scope) -> frozenset[str]:
    """The numbers that stand in the noise and are to be estimated."""
    found = () if noise is None else symbols_of(noise)
    return frozenset(each.name for each in found if isinstance(scope.lookup(each.name, each.span), Component))


def _not_here(stated: StatedErrors, why: str, hint: str) -> Diagnostic:
    return faults.likelihood_not_here(stated.span, stated.called, why, hint)
