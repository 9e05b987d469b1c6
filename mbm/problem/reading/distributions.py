"""Distributions of priors: ``(rectangular lo hi)`` and the like → mean and standard deviation, which the solve uses.

Formulas as in GUM 4.3 and Supplement 1, table 1. The words are words in ``constraints`` and ``:prior`` only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import exp, expm1, inf, log, sqrt
from types import MappingProxyType

from mbm.expression.algebra import UndefinedValueError, add, multiply, subtract
from mbm.expression.nodes import Constant, Expression, Number, nearest
from mbm.expression.units import NONE
from mbm.language import faults as language_faults
from mbm.language.functions import UserFunction, UserMacro
from mbm.language.scope import static_number
from mbm.language.values import Scope
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.overrides import ARCSINE, LOGNORMAL, NORMAL, RECTANGULAR, STUDENT, TRAPEZOIDAL, TRIANGULAR, Law
from mbm.text.types import Form, MbmError, Span
from mbm.values import dataclass

Moments = tuple[Expression, Expression]


@dataclass(frozen=True, slots=True)
class Distribution:
    """What a distribution is called, its parameters, and how its mean and standard deviation follow.

    ``shape`` (parameter, its limits, what is wrong elsewhere) is the parameter that has to be known while compiling;
    ``moments`` takes it after the other two, which may hold columns and, with ``limits``, have to ascend.
    """

    name: str
    parameters: tuple[str, ...]
    moments: Callable[[Expression, Expression, float], Moments]
    shape: tuple[float, float, str] | None = None
    limits: bool = False


def _between(share: Callable[[float], float]) -> Callable[[Expression, Expression, float], Moments]:
    """The moments of a symmetric distribution between two limits, whose sigma is a ``share`` of their distance."""

    def moments(low: Expression, high: Expression, shape: float) -> Moments:
        return _times(0.5, add(low, high)), _times(share(shape), subtract(high, low))

    return moments


def _student(mean: Expression, scale: Expression, dof: float) -> Moments:
    """Without a variance, the scale stands for the standard deviation."""
    return mean, _times(sqrt(dof / (dof - 2.0)) if dof > 2.0 else 1.0, scale)


def _lognormal(median: Expression, _: Expression, factor: float) -> Moments:
    variance = log(factor) ** 2
    mean = _times(exp(variance / 2.0), median)
    return mean, _times(sqrt(expm1(variance)), mean)


def _times(factor: float, value: Expression) -> Expression:
    """A multiple that keeps the dimension: a plain number in a file could take any."""
    return multiply(Number(factor, NONE), value)


_WIDEST = 1e10
"""Geometric standard deviations from here on have moments beyond all numbers."""

_NO_VARIANCE = "has no variance for dof ≤ 2, so that it does not count in a linear answer; `mbm propagate` takes it"

DISTRIBUTIONS: Mapping[str, Distribution] = MappingProxyType(
    {
        each.name: each
        for each in (
            Distribution(NORMAL, ("mean", "sigma"), lambda mean, sigma, _: (mean, sigma)),
            Distribution(RECTANGULAR, ("lo", "hi"), _between(lambda _: 1.0 / sqrt(12.0)), limits=True),
            Distribution(TRIANGULAR, ("lo", "hi"), _between(lambda _: 1.0 / sqrt(24.0)), limits=True),
            Distribution(
                TRAPEZOIDAL,
                ("lo", "hi", "ratio"),
                _between(lambda ratio: sqrt((1.0 + ratio**2) / 24.0)),
                (0.0, 1.0, "wants the ratio of its top to its base, from 0 to 1"),
                limits=True,
            ),
            Distribution(ARCSINE, ("lo", "hi"), _between(lambda _: 1.0 / sqrt(8.0)), limits=True),
            Distribution(STUDENT, ("mean", "scale", "dof"), _student, (0.0, inf, "wants dof above 0")),
            Distribution(
                LOGNORMAL,
                ("median", "factor"),
                _lognormal,
                (1.0, _WIDEST, f"wants a geometric standard deviation above 1 and below {_WIDEST:g}"),
            ),
        )
    }
)
"""By their names. Rotations, poses and directions have none but ``normal``."""

USAGES = MappingProxyType({name: f"({name} form {' '.join(each.parameters)})" for name, each in DISTRIBUTIONS.items()})


def is_distribution(work: Workspace, name: str) -> bool:
    """Whether a name means a distribution: a function or macro of the user goes before it, a model does not."""
    own = work.evaluator.vocabulary.functions.get(name)
    return name in DISTRIBUTIONS and not isinstance(own, UserFunction | UserMacro)


def moments(
    work: Workspace, name: str, forms: tuple[Form, ...], shape: tuple[int, ...], scope: Scope, span: Span
) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    """Mean and standard deviation of each element of a quantity of a ``shape``, from the forms of the parameters.

    Raises:
        MbmError: too few or too many parameters, or parameters without such a distribution.

    """
    law = DISTRIBUTIONS[name]
    if len(forms) != len(law.parameters):
        message = f"`{name}` takes {_listed(law.parameters)}"
        raise MbmError(language_faults.bad_form(span, message, USAGES[name]))
    told = 1.0 if law.shape is None else _shape_parameter(work, law, forms[-1], scope)
    first, second = (shaped(work.evaluator.wanted(form, scope), shape, form.span) for form in forms[:2])
    found = []
    for low, high in zip(first, second, strict=True):
        if law.limits and not _ascending(low, high):
            raise MbmError(language_faults.bad_form(span, f"the limits of `{name}` are not in order", USAGES[name]))
        if law.name == LOGNORMAL and isinstance(low, Number) and not low.value > 0.0:
            raise MbmError(language_faults.bad_form(span, "the median of `lognormal` is above 0", USAGES[name]))
        try:
            found.append(law.moments(low, high, told))
        except UndefinedValueError as error:
            raise MbmError(language_faults.undefined_value(span, str(error))) from None
    return tuple(mean for mean, _ in found), tuple(sigma for _, sigma in found)


def law_of(work: Workspace, name: str, forms: tuple[Form, ...], scope: Scope) -> Law:
    """The law of a distribution whose parameters `moments` has accepted."""
    law = DISTRIBUTIONS[name]
    return Law(name) if law.shape is None else Law(name, _shape_parameter(work, law, forms[-1], scope))


def _shape_parameter(work: Workspace, law: Distribution, form: Form, scope: Scope) -> float:
    low, high, wrong = law.shape or (0.0, 0.0, "")
    given = work.evaluator.wanted(form, scope)
    value = nearest(static_number(given, form.span))
    if isinstance(given, Number | Constant) and given.dimension not in (None, NONE):
        message = f"the {law.parameters[-1]} of `{law.name}` is a pure number, and not {given.dimension.describe()}"
        raise MbmError(language_faults.bad_form(form.span, message, USAGES[law.name]))
    inside = low <= value <= high if high == 1.0 else low < value < high
    if inside and not (work.drawing or Law(law.name, value).has_variance):
        raise MbmError(language_faults.bad_form(form.span, f"`{law.name}` {_NO_VARIANCE}", USAGES[law.name]))
    if not inside:
        raise MbmError(language_faults.bad_form(form.span, f"`{law.name}` {wrong}", USAGES[law.name]))
    return value


def _ascending(low: Expression, high: Expression) -> bool:
    """Whether two limits may be in order; of those that data decide, the solve says whether they are."""
    if isinstance(low, Number) and isinstance(high, Number):
        return bool(low.value < high.value)
    return True


def _listed(names: tuple[str, ...]) -> str:
    return "a form, " + ", ".join(names[:-1]) + f" and {names[-1]}"
