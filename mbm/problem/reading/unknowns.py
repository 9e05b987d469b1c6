"""``(unknowns (NAME [TYPE] option…)…)``: what is to be estimated."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

from mbm.expression.nodes import Column, ColumnMember, Component, Constant, LiteralMember, Member, Number
from mbm.expression.units import Unit, parse_unit, refused_unit
from mbm.language import faults as language_faults
from mbm.language.coerce import difference, integer, static_number
from mbm.language.scope import Scope
from mbm.language.values import Array, FamilyValue, TextColumn, Value
from mbm.problem import faults
from mbm.problem.elaboration import Workspace, pair_of, shaped
from mbm.problem.joining import with_families
from mbm.problem.options import Options, split_options
from mbm.problem.reading.constants import given_value
from mbm.problem.scopes import ROW, Entry
from mbm.problem.tables import Table
from mbm.problem.types import (
    Block,
    BlockRole,
    Equation,
    EquationCase,
    Family,
    NoiseKind,
    Override,
    RowValues,
    Unknown,
    UnknownKind,
)
from mbm.text.suggest import closest
from mbm.text.types import Form, MbmError, Numeral, Sequence, Span, Symbol, Text

USAGE = "(name [type] [:init form] [:in (lo hi)] [:unit u] [:sigma s] [:fixed true] [:per TABLE])"
OPTIONS = ("init", "in", "start", "unit", "sigma", "covariance", "fixed", "per", "doc")
_SCALARS = {"real": UnknownKind.REAL, "positive": UnknownKind.POSITIVE, "angle": UnknownKind.ANGLE}
_LATER = ("direction", "rotation", "pose", "similarity")


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """An unknown as declared: its type is known, its options are forms still."""

    name: Symbol
    kind: UnknownKind
    shape: tuple[int, ...]
    family: Family | None
    options: Options


def declare_unknowns(work: Workspace, clause: Sequence) -> list[Declaration]:
    """Declare the names of a clause, so that all clauses may use them."""
    found = []
    for item in clause.items[1:]:
        with work.collecting(item):
            declaration = _declaration(work, item)
            keys = _family_keys(work, declaration.family)
            _enter(work, declaration, keys)
            found.append(declaration)
    return found


def _declaration(work: Workspace, item: Form) -> Declaration:
    if not (isinstance(item, Sequence) and item.items and isinstance(item.items[0], Symbol)):
        raise MbmError(language_faults.bad_form(item.span, "an unknown is a list that begins with its name", USAGE))
    name = item.items[0]
    options = split_options(item.items[1:], item.span, owner="an unknown", known=OPTIONS)
    if len(options.positional) > 1:
        raise MbmError(language_faults.bad_form(options.positional[1].span, "only one type may be given", USAGE))
    kind, shape = _type(work, options.positional[0] if options.positional else None)
    family = _family(work, options.get("per"))
    return Declaration(name=name, kind=kind, shape=shape, family=family, options=options)


def _type(work: Workspace, form: Form | None) -> tuple[UnknownKind, tuple[int, ...]]:
    if form is None:
        return UnknownKind.REAL, ()
    head = form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
    if head in _LATER:
        raise MbmError(language_faults.not_available_yet(form.span, f"the type `{head}` of unknowns", "manifolds"))
    if isinstance(form, Symbol) and form.name in _SCALARS:
        return _SCALARS[form.name], ()
    if isinstance(form, Sequence) and head in ("vector", "array"):
        extents = [integer(work.evaluator.wanted(f, work.scope), f.span, "a size") for f in form.items[1:]]
        most = 1 if head == "vector" else 2
        if not 1 <= len(extents) <= most:
            usage = "(vector n)" if head == "vector" else "(array n) or (array n m)"
            raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes its sizes", usage))
        for extent, size_form in zip(extents, form.items[1:], strict=True):
            if extent < 1:
                raise MbmError(language_faults.bad_index(size_form.span, f"there is no {head} of size {extent}"))
        work.evaluator.budget.check_length(prod(extents), form)
        return UnknownKind(head), tuple(extents)
    known = (*_SCALARS, "vector", "array", *_LATER)
    shown = head or form.span.text
    raise MbmError(faults.unknown_type(form.span, shown, closest(shown, known), known))


def _family(work: Workspace, form: Form | None) -> Family | None:
    if form is None:
        return None
    if isinstance(form, Symbol) and form.name not in work.tables and "." in form.name:
        table_name, column = form.name.split(".", 1)
        table = work.tables.get(table_name)
        if table is not None and column in table.columns:
            return Family(table=table_name, column=column, rows=form.name, key=column)
        if table is not None:
            raise MbmError(faults.unknown_column(form.span, column, table_name, tuple(table.columns)))
    table = work.table(form)
    if table.key is None:
        raise MbmError(faults.table_without_key(form.span, table.name))
    return Family(table=table.name, column=None, rows=table.name, key=table.key)


def _family_keys(work: Workspace, family: Family | None) -> frozenset[str | float] | None:
    if family is None:
        return None
    work.tables.update(with_families(work.tables, (family,)))
    return frozenset(work.tables[family.rows].keys(family.key))


def components(declaration: Declaration, member: Member | None, span: Span | None = None) -> Value:
    """The unknown, or one member of the family, as a value."""
    name = declaration.name.name
    angle = declaration.kind is UnknownKind.ANGLE
    shape = declaration.shape
    if not shape:
        return Component(name, (), member, angle, span)
    if len(shape) == 1:
        return Array(shape, tuple(Component(name, (i + 1,), member, angle, span) for i in range(shape[0])))
    indices = [(i + 1, j + 1) for i in range(shape[0]) for j in range(shape[1])]
    return Array(shape, tuple(Component(name, index, member, angle, span) for index in indices))


def _enter(work: Workspace, declaration: Declaration, keys: frozenset[str | float] | None) -> None:
    name = declaration.name

    def make() -> Value:
        if keys is None:
            return components(declaration, None)

        def member(key: str | float | Column | TextColumn) -> Value:
            if isinstance(key, Column | TextColumn):
                return components(declaration, ColumnMember(table=key.table, column=key.name, row=key.row))
            return components(declaration, LiteralMember(key=key))

        return FamilyValue(name.name, keys, member)

    work.scope.add(name.name, Entry("unknown", name.span, make))


def read_unknown(work: Workspace, declaration: Declaration) -> tuple[Unknown, Block | None]:
    """The unknown with its options evaluated, and the prior that ``:sigma`` or ``:covariance`` adds."""
    options, family, shape = declaration.options, declaration.family, declaration.shape
    table = work.tables[family.rows] if family is not None else None
    name = declaration.name.name

    def numbers(form: Form | None, wanted: str) -> RowValues | None:
        return None if form is None else work.values(form, table, shape, wanted=wanted)

    def ends(option: str) -> tuple[RowValues | None, RowValues | None]:
        form = options.get(option)
        if form is None:
            return None, None
        low, high = pair_of(form, f":{option}")
        wanted = f"`:{option}` of `{name}`"
        return numbers(low, wanted), numbers(high, wanted)

    lower, upper = ends("in")
    start_lower, start_upper = ends("start")
    fixed_form, unit_form = options.get("fixed"), options.get("unit")
    size = 1
    for extent in shape:
        size *= extent
    unknown = Unknown(
        name=name,
        kind=declaration.kind,
        shape=shape,
        family=family,
        start=numbers(options.get("init"), f"`:init` of `{name}`"),
        lower=lower,
        upper=upper,
        start_lower=start_lower,
        start_upper=start_upper,
        fixed=None if fixed_form is None else work.conditions(fixed_form, table, size, wanted=f"`:fixed` of `{name}`"),
        unit=stated_unit(unit_form) if unit_form is not None else None,
        doc=_doc(options.get("doc")),
        span=declaration.name.span,
    )
    return unknown, _prior(work, declaration, table)


def _doc(form: Form | None) -> str:
    if form is None:
        return ""
    if not isinstance(form, Text):
        raise MbmError(language_faults.wrong_kind(form.span, "a text", "something else"))
    return form.value


def _prior(work: Workspace, declaration: Declaration, table: Table | None) -> Block | None:
    """The prior ``(normal NAME init sigma)``."""
    options = declaration.options
    form = options.get("sigma") or options.get("covariance")
    if form is None:
        return None
    name, kind = declaration.name.name, NoiseKind.SIGMA if options.get("sigma") else NoiseKind.COVARIANCE
    init_form = options.get("init")
    if init_form is None:
        raise MbmError(faults.prior_without_init(options.places[kind.value], name, kind.value))
    if options.get("sigma") is not None and options.get("covariance") is not None:
        raise MbmError(faults.two_noises(options.places["covariance"]))

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        evaluator = work.evaluator
        value = components(declaration, own_member(declaration.family), declaration.name.span)
        own = value.elements if isinstance(value, Array) else (value,)
        mean = shaped(evaluator.wanted(init_form, scope), declaration.shape, init_form.span)
        differences = tuple(difference(a, b, init_form.span) for a, b in zip(own, mean, strict=True))  # type: ignore[arg-type]
        noise_shape = declaration.shape if kind is NoiseKind.SIGMA else (len(own), len(own))
        noise = shaped(evaluator.wanted(form, scope), noise_shape, form.span, broadcast=kind is NoiseKind.SIGMA)
        work.refuse_unknowns(noise, form.span, f"`:{kind.value}` of `{name}`")
        work.refuse_unknowns(mean, init_form.span, f"`:init` of `{name}`")
        return (Equation(components=differences, noise_kind=kind, noise=noise, measured=mean, span=form.span),)

    cases = work.cases(table, evaluate, form.span)
    return Block(
        name=f"prior {name}",
        role=BlockRole.PRIOR,
        table=table.name if table else None,
        cases=tuple(EquationCase(static=s, equations=e) for s, e in cases),
        when=None,
        unknown_factor=False,
        span=form.span,
    )


def own_member(family: Family | None) -> Member | None:
    """The member of a family that belongs to the row at hand of the family's own table."""
    if family is None:
        return None
    return ColumnMember(table=family.rows, column=family.key or ROW)


def stated_unit(form: Form) -> Unit:
    """The unit behind ``:unit``: ``m``, ``m/s``, ``"1/s"``."""
    if isinstance(form, Numeral) and form.value == 1 and form.unit:
        text = "1" + form.unit
    elif isinstance(form, Symbol):
        text = form.name
    elif isinstance(form, Text):
        text = form.value
    else:
        text = form.span.text
    unit = parse_unit(text)
    if unit is None:
        raise MbmError(language_faults.unknown_unit(form.span, text, refused_unit(text)))
    return unit


def given_start(work: Workspace, declaration: Declaration, override: Override) -> tuple[Number, ...]:
    """A start given from outside, in SI: one number for each component (families: one member's, or all members')."""
    if override.values is not None:
        return tuple(Number(v) for v in override.values)
    value = given_value(work, override.name, override.text or "")
    span = declaration.name.span
    found = []
    for element in shaped(value, declaration.shape, span):
        dimension = element.dimension if isinstance(element, Number | Constant) else None
        found.append(Number(float(static_number(element, span)), dimension, element.span))
    return tuple(found)
