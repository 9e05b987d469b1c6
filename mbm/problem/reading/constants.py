"""``(constants (name form)…)``: known numbers, which the caller may override."""

from __future__ import annotations

import math
from dataclasses import replace

from mbm.expression.algebra import UndefinedValueError, constant_value, noting_constants
from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Constant, Expression, Number, leaves, nearest
from mbm.expression.units import Dimension, Unit, parse_unit
from mbm.language import faults as language_faults
from mbm.language.scope import static_number, vector
from mbm.language.values import SCALARS, Array, ListValue, Value, describe
from mbm.problem import faults
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace, given_value, shaped
from mbm.problem.overrides import NORMAL_LAW, ConstantValue, Law, Override, Overrides
from mbm.problem.reading.distributions import is_distribution, law_of, moments
from mbm.problem.scopes import Entry
from mbm.problem.zero_points import is_temperature, stated_difference
from mbm.text.types import Form, MbmError, Numeral, Sequence, Source, Span, Symbol
from mbm.values import dataclass

USAGE = "(constants (name form [:sigma s | :prior (rectangular lo hi)] [:dof n])…)"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredConstant:
    """A constant as declared: its name, and what stands behind it."""

    name: str
    options: Options


def read_constants(work: Workspace, clause: Sequence, overrides: Overrides) -> list[DeclaredConstant]:
    """Declare the constants of a clause, in order."""
    names = []
    for item in clause.items[1:]:
        with work.collecting(item):
            if not (isinstance(item, Sequence) and item.items and isinstance(item.items[0], Symbol)):
                raise MbmError(language_faults.bad_form(item.span, "a constant is (name form)", USAGE))
            name = item.items[0]
            options = split_options(item.items[1:], item.span, owner="a constant", known=("sigma", "prior", "dof"))
            if len(options.positional) != 1:
                raise MbmError(language_faults.bad_form(item.span, "a constant is (name form)", USAGE))
            _declare(work, name.name, options.positional[0], name.span, overrides.get(name.name))
            names.append(DeclaredConstant(name=name.name, options=options))
    return names


def _declare(work: Workspace, name: str, form: Form, span: Span, override: Override | None) -> None:
    def make() -> Value:
        value = work.evaluator.wanted(form, work.scope)
        if override is not None:
            value = _overridden(work, value, override)
        return _named(work, value, name, form.span)

    work.scope.add(name, Entry("constant", span, make))


def _overridden(work: Workspace, declared: Value, override: Override) -> Value:
    """The value given instead: of the same shape, of the same dimension where both state one."""
    if override.text is not None:
        given = given_value(work, override.name, override.text)
    else:
        numbers = tuple(Number(v) for v in override.values or ())
        given = numbers[0] if len(numbers) == 1 and isinstance(declared, SCALARS) else Array((len(numbers),), numbers)
    if isinstance(declared, SCALARS) and isinstance(given, SCALARS):
        return _redimensioned(given, declared, override)
    if isinstance(declared, ListValue):
        declared = vector(declared, _NOWHERE)
    if isinstance(given, ListValue):
        given = vector(given, _NOWHERE)
    if isinstance(declared, Array) and isinstance(given, Array) and len(declared.elements) == len(given.elements):
        pairs = zip(given.elements, declared.elements, strict=True)
        return Array(declared.shape, tuple(_redimensioned(g, d, override) for g, d in pairs))
    if isinstance(declared, Array) or type(declared) is not type(given):
        message = f"is {describe(given)}, but the constant is {describe(declared)}"
        raise MbmError(faults.wrong_value(override.name, message))
    return given


_NOWHERE = Span(source=Source("", ""), start=0, end=0)
"""The place of what was given from outside."""


def _redimensioned(given: Expression, declared: Expression, override: Override) -> Expression:
    """A number given without a unit takes the dimension of the constant that it replaces."""
    stated, wanted = (_dimension(node) for node in (given, declared))
    if stated is not None and wanted is not None and stated != wanted:
        message = f"is {stated.describe()}, but the constant is {wanted.describe()}"
        raise MbmError(faults.wrong_value(override.name, message))
    if isinstance(given, Number) and given.dimension is None:
        absolute = is_temperature(declared, declared.span or _NOWHERE)
        if absolute and not override.computed:
            message = f"has no unit, and would be in kelvin: write `{float(given.value):g}degC`"
            raise MbmError(faults.wrong_value(override.name, message))
        return replace(given, dimension=wanted, absolute=absolute)
    return given


def _named(work: Workspace, value: Value, name: str, span: Span) -> Value:
    """The value as constants that carry their name, so that equations show it."""
    if isinstance(value, str | bool):
        return value
    if isinstance(value, SCALARS):
        return _constant(work, value, name, span)
    if isinstance(value, ListValue):
        value = vector(value, span)
    if isinstance(value, Array):
        width = value.shape[-1]
        indices = [
            f"{i // width + 1},{i % width + 1}" if value.is_matrix else f"{i + 1}" for i in range(len(value.elements))
        ]
        elements = tuple(_constant(work, e, f"{name}[{i}]", span) for e, i in zip(value.elements, indices, strict=True))
        return Array(value.shape, elements)
    return value


def _constant(work: Workspace, node: Expression, name: str, span: Span) -> Constant:
    names = set[str]()
    try:
        # other numbers of the constants that it is made of make another number, and decide nothing else
        with noting_constants(names):
            found = constant_value(node)
    except UndefinedValueError as error:
        raise MbmError(language_faults.undefined_value(span, str(error))) from None
    if found is None:
        raise MbmError(language_faults.not_static(span, f"the constant `{name}`"))
    dimension = node.dimension if isinstance(node, Number | Constant) else _dimension(node)
    number = nearest(found)
    if not math.isfinite(number):
        raise MbmError(language_faults.undefined_value(span, name))
    if names:
        work.made[name] = node
    return Constant(name, number, dimension, span, node.angle, is_temperature(node, span))


def _dimension(node: Expression) -> Dimension | None:
    stated = any(isinstance(leaf, Number | Constant) and leaf.dimension is not None for leaf in leaves((node,)))
    return Inference(Declared(components={}, columns={}, same_column={})).dimension(node) if stated else None


def constant_values(work: Workspace, declared: list[DeclaredConstant], span: Span) -> tuple[ConstantValue, ...]:
    """The numeric constants with their values, evaluated now so that faults show even in unused ones."""
    found = []
    for each in declared:
        name = each.name
        with work.collecting():
            value = work.scope.own(name, span)
            entry = work.scope.entries[name]
            elements = value.elements if isinstance(value, Array) else (value,)
            numbers = [e for e in elements if isinstance(e, Constant)]
            if numbers and value is not None:
                values, names_of = tuple(e.value for e in numbers), tuple(e.name for e in numbers)
                sigmas = _sigmas(work, each, value, numbers)
                work.uncertain.update(names_of if sigmas else ())
                found.append(
                    ConstantValue(
                        name=name,
                        values=values,
                        elements=names_of,
                        sigmas=sigmas,
                        law=_law(work, each),
                        unit=_unit(each, numbers[0]) if sigmas else None,
                        dof=_dof(work, each),
                        made=tuple((element, work.made[element]) for element in names_of if element in work.made),
                        span=entry.span,
                    )
                )
            elif each.options.keywords:
                message = f"`{name}` is no number, and has no standard deviation"
                raise MbmError(language_faults.bad_form(each.options.span, message, USAGE))
    return tuple(found)


def _dof(work: Workspace, declared: DeclaredConstant) -> float:
    """The degrees of freedom of the uncertainty of a constant; infinite where none are stated."""
    options = declared.options
    form = options.get("dof")
    if form is None:
        return math.inf
    if "sigma" not in options.keywords and "prior" not in options.keywords:
        message = "degrees of freedom are those of a `:sigma` or `:prior`, and there is none"
        raise MbmError(language_faults.bad_form(options.places["dof"], message, USAGE))
    found = nearest(static_number(work.evaluator.wanted(form, work.scope), form.span))
    if not found > 0.0:
        raise MbmError(language_faults.bad_form(form.span, "degrees of freedom are above 0", USAGE))
    return found


def _unit(declared: DeclaredConstant, number: Constant) -> Unit | None:
    """The unit in which the uncertainty of a constant is written, else its value; None: in none of its dimension.

    Temperatures in degC have their differences in K, and are shown as they are written.
    """
    options, dimension = declared.options, number.dimension
    stated = [options.get("sigma"), options.get("prior"), *options.positional]
    forms = [form for form in (reversed(stated) if number.absolute else stated) if form is not None]
    while forms:
        form = forms.pop(0)
        if isinstance(form, Sequence):
            forms = [*form.items, *forms]
        elif isinstance(form, Numeral) and form.unit is not None:
            unit = parse_unit(form.unit)
            if unit is not None and dimension in (None, unit.dimension) and unit.symbol != "%":
                return unit
    return None


def _law(work: Workspace, declared: DeclaredConstant) -> Law:
    """The law that a constant follows, whose distribution `_sigmas` has accepted."""
    form = declared.options.get("prior")
    if not isinstance(form, Sequence) or form.head is None:
        return NORMAL_LAW
    return law_of(work, form.head, form.items[1:], work.scope)


def _sigmas(work: Workspace, declared: DeclaredConstant, value: Value, numbers: list[Constant]) -> tuple[float, ...]:
    """The standard deviations of the elements of a constant; empty where it is exact."""
    options, shape = declared.options, value.shape if isinstance(value, Array) else ()
    form, law = options.get("sigma"), options.get("prior")
    if form is None and law is None:
        return ()
    if form is not None and law is not None:
        raise MbmError(language_faults.bad_form(options.places["prior"], "the uncertainty is stated twice", USAGE))
    if form is not None:
        stated, place = shaped(work.evaluator.wanted(form, work.scope), shape, form.span), form.span
    elif isinstance(law, Sequence) and law.head is not None and is_distribution(work, law.head):
        stated, place = moments(work, law.head, law.items[1:], shape, work.scope, law.span)[1], law.span
    else:
        place = law.span if law is not None else options.span
        raise MbmError(language_faults.bad_form(place, f"`{place.text}` is no distribution", USAGE))
    found = []
    for element, number in zip(stated, numbers, strict=True):
        own, wanted = _dimension(element), number.dimension
        if own is not None and wanted is not None and own != wanted:
            message = f"the standard deviation is {own.describe()}, but the constant is {wanted.describe()}"
            raise MbmError(language_faults.bad_form(place, message, USAGE))
        stated_difference(element, place)
        sigma = nearest(static_number(element, place))
        if not (math.isfinite(sigma) and sigma >= 0.0):
            raise MbmError(language_faults.bad_form(place, "a standard deviation is not below 0", USAGE))
        found.append(sigma)
    return tuple(found) if any(found) else ()
