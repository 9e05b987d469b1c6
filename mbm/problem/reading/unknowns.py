"""``(unknowns (NAME [TYPE] option…)…)``: what is to be estimated."""

from __future__ import annotations

from math import isfinite, prod

from mbm.expression.nodes import (
    Column,
    ColumnMember,
    Component,
    Constant,
    Expression,
    LiteralMember,
    Member,
    Number,
    nearest,
)
from mbm.expression.units import Unit, parse_unit, refused_unit
from mbm.language import faults as language_faults
from mbm.language.coerce import difference, integer, static_number, vector
from mbm.language.values import (
    Array,
    FamilyValue,
    PoseValue,
    RotationValue,
    Scope,
    TextColumn,
    Value,
    described_with_space,
)
from mbm.language.vocabulary.rigid import (
    direction_difference,
    geometric_difference,
    plane_rotation,
    pose,
    quaternion_rotation,
)
from mbm.language.vocabulary.rotations import as_rotation
from mbm.problem import faults
from mbm.problem.elaboration import Workspace, pair_of, shaped
from mbm.problem.joining import with_families
from mbm.problem.manifold import Manifold, manifold_of
from mbm.problem.naming import PRIOR
from mbm.problem.options import Options, split_options
from mbm.problem.reading.constants import given_value
from mbm.problem.scopes import Entry
from mbm.problem.tables import ROW, Table
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
from mbm.text.types import Form, MbmError, Numeral, Sequence, Span, Symbol, Text
from mbm.values import dataclass

USAGE = "(name [type] [:init form] [:in (lo hi)] [:unit u] [:sigma s] [:fixed true] [:per TABLE])"
OPTIONS = ("init", "in", "start", "unit", "sigma", "covariance", "fixed", "per", "doc")
_SCALARS = {"real": UnknownKind.REAL, "positive": UnknownKind.POSITIVE, "angle": UnknownKind.ANGLE}
_SPATIAL = ("rotation", "pose", "similarity")


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """An unknown as declared: its type is known, its options are forms still."""

    name: Symbol
    kind: UnknownKind
    shape: tuple[int, ...]
    dimension: int
    family: Family | None
    options: Options

    @property
    def manifold(self) -> Manifold:
        """How its numbers vary."""
        return manifold_of(self.kind.value, self.dimension, prod(self.shape))


def declare_unknowns(work: Workspace, clause: Sequence) -> list[Declaration]:
    """Declare the names of a clause, so that all clauses may use them."""
    found = []
    for item in clause.items[1:]:
        with work.collecting(item):
            declaration = _declaration(work, item)
            keys = keys_of(work, declaration.family)
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
    kind, shape, dimension = _type(work, options.positional[0] if options.positional else None)
    family = family_of(work, options.get("per"))
    return Declaration(name=name, kind=kind, shape=shape, dimension=dimension, family=family, options=options)


def _type(work: Workspace, form: Form | None) -> tuple[UnknownKind, tuple[int, ...], int]:
    if form is None:
        return UnknownKind.REAL, (), 0
    head = form.name if isinstance(form, Symbol) else form.head if isinstance(form, Sequence) else None
    if isinstance(form, Symbol) and form.name in _SCALARS:
        return _SCALARS[form.name], (), 0
    if isinstance(form, Symbol) and head == "direction":
        return UnknownKind.DIRECTION, (manifold_of(head, 3, 0).size,), 3
    if head in _SPATIAL:
        return _spatial(work, form, head)
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
        return UnknownKind(head), tuple(extents), 0
    known = (*_SCALARS, "vector", "array", "direction", *_SPATIAL)
    shown = head or form.span.text
    raise MbmError(faults.unknown_type(form.span, shown, known))


def _spatial(work: Workspace, form: Form, head: str) -> tuple[UnknownKind, tuple[int, ...], int]:
    """``(rotation 2)``, ``(pose 3)``, …: the dimension says of which space."""
    dimension = 0
    if isinstance(form, Sequence) and len(form.items) == 2:
        dimension = integer(work.evaluator.wanted(form.items[1], work.scope), form.items[1].span, "a dimension")
    if dimension not in (2, 3):
        usage = f"({head} 2) of the plane, or ({head} 3) of space"
        raise MbmError(language_faults.bad_form(form.span, f"`{head}` takes its dimension", usage))
    return UnknownKind(head), (manifold_of(head, dimension, 0).size,), dimension


def family_of(work: Workspace, form: Form | None) -> Family | None:
    """The family that ``:per`` states; None without one."""
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


def keys_of(work: Workspace, family: Family | None) -> frozenset[str | float] | None:
    """The keys of a family's members, whose table is entered where it is made of a column; None without a family."""
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
    if declaration.dimension:
        angles = declaration.manifold.number_angles()
        numbers = tuple(Component(name, (i + 1,), member, a, span) for i, a in enumerate(angles))
        return _geometric(declaration, numbers, span or declaration.name.span)
    if len(shape) == 1:
        return Array(shape, tuple(Component(name, (i + 1,), member, angle, span) for i in range(shape[0])))
    indices = [(i + 1, j + 1) for i in range(shape[0]) for j in range(shape[1])]
    return Array(shape, tuple(Component(name, index, member, angle, span) for index in indices))


def _geometric(declaration: Declaration, numbers: tuple[Component, ...], span: Span) -> Value:
    """A direction, rotation, pose or similarity made of the numbers that hold it."""
    kind, dimension = declaration.kind, declaration.dimension
    if kind is UnknownKind.DIRECTION:
        return Array((3,), numbers)
    held = 4 if dimension == 3 else 1
    rotation = quaternion_rotation(numbers[:4], span) if dimension == 3 else plane_rotation(numbers[0], span)
    if kind is UnknownKind.ROTATION:
        return rotation
    scale = numbers[-1] if kind is UnknownKind.SIMILARITY else None
    return PoseValue(rotation, numbers[held : held + dimension], scale)


def _enter(work: Workspace, declaration: Declaration, keys: frozenset[str | float] | None) -> None:
    name = declaration.name

    def make() -> Value:
        if keys is None:
            return components(declaration, None)

        def member(key: str | float | Column | TextColumn) -> Value:
            if isinstance(key, Column | TextColumn):
                return components(declaration, ColumnMember(table=key.table, column=key.name, row=key.row))
            if declaration.family is not None:
                work.reads.keyed[declaration.family.rows] = None
            return components(declaration, LiteralMember(key=key))

        return FamilyValue(name.name, keys, member)

    work.scope.add(name.name, Entry("unknown", name.span, make))


def read_unknown(work: Workspace, declaration: Declaration) -> tuple[Unknown, Block | None]:
    """The unknown with its options evaluated, and the prior that ``:sigma`` or ``:covariance`` adds."""
    options, family, shape = declaration.options, declaration.family, declaration.shape
    table = work.tables[family.rows] if family is not None else None
    name = declaration.name.name

    def start(form: Form | None) -> RowValues | None:
        if form is None:
            return None
        wanted = f"`:init` of `{name}`"
        if not declaration.dimension:
            return work.values(form, table, shape, wanted=wanted)
        return work.evaluated(form, table, lambda value: _stated(declaration, value, form.span), wanted=wanted)

    def ends(option: str) -> tuple[RowValues | None, RowValues | None]:
        form = options.get(option)
        if form is None:
            return None, None
        low, high = pair_of(form, f":{option}")
        wanted = f"`:{option}` of `{name}`"
        extent = _bounded_shape(declaration, form)
        return work.values(low, table, extent, wanted=wanted), work.values(high, table, extent, wanted=wanted)

    lower, upper = ends("in")
    start_lower, start_upper = ends("start")
    fixed_form, unit_form = options.get("fixed"), options.get("unit")
    size = declaration.manifold.tangent
    unknown = Unknown(
        name=name,
        kind=declaration.kind,
        shape=shape,
        dimension=declaration.dimension,
        family=family,
        start=start(options.get("init")),
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


def _bounded_shape(declaration: Declaration, form: Form) -> tuple[int, ...]:
    """What ``:in`` and ``:start`` give ends for: the translation of poses and similarities, nothing of directions."""
    kind = declaration.kind
    if not declaration.dimension:
        return declaration.shape
    if kind in (UnknownKind.POSE, UnknownKind.SIMILARITY):
        return (declaration.dimension,)
    if kind is UnknownKind.ROTATION and declaration.dimension == 2:
        return ()
    usage = "bounds are for numbers and for the translation of poses"
    raise MbmError(language_faults.bad_form(form.span, f"a {kind.value} has no bounds", usage))


def _stated(declaration: Declaration, value: Value, span: Span) -> tuple[Expression, ...]:
    """What ``:init`` says of a direction (3), rotation (matrix), pose (and translation) or similarity (and scale)."""
    kind = declaration.kind
    if kind is UnknownKind.DIRECTION:
        return vector(value, span, 3).elements
    given = as_rotation(value, span) if kind is UnknownKind.ROTATION else pose(value, span)
    rotation = given if isinstance(given, RotationValue) else given.rotation
    if rotation.dimension != declaration.dimension:
        wanted = f"`({kind.value} {declaration.dimension})`"
        raise MbmError(language_faults.length_clash(span, described_with_space(given), wanted))
    if isinstance(given, RotationValue):
        return given.matrix.elements
    numbers = (*rotation.matrix.elements, *given.translation)
    return (*numbers, given.scale or Number(1)) if kind is UnknownKind.SIMILARITY else numbers


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
        given = evaluator.wanted(init_form, scope)
        found = geometric_difference(given, value, init_form.span)
        mean: tuple[Expression, ...] | None = None
        if declaration.kind is UnknownKind.DIRECTION and isinstance(value, Array):
            found = direction_difference(vector(given, init_form.span, 3).elements, value.elements, init_form.span)
        if found is None:
            own = value.elements if isinstance(value, Array) else (value,)
            mean = shaped(given, declaration.shape, init_form.span)
            found = tuple(difference(a, b, init_form.span) for a, b in zip(own, mean, strict=True))  # type: ignore[arg-type]
        size = declaration.manifold.tangent
        shape: tuple[int, ...] = declaration.shape if not declaration.dimension else (size,)
        noise_shape = shape if kind is NoiseKind.SIGMA else (size, size)
        noise = shaped(evaluator.wanted(form, scope), noise_shape, form.span, broadcast=kind is NoiseKind.SIGMA)
        work.refuse_unknowns(noise, form.span, f"`:{kind.value}` of `{name}`")
        stated = mean if mean is not None else _stated(declaration, given, init_form.span)
        work.refuse_unknowns(stated, init_form.span, f"`:init` of `{name}`")
        return (Equation(components=found, noise_kind=kind, noise=noise, measured=mean, span=form.span),)

    cases = work.cases(table, evaluate, form.span)
    return Block(
        name=PRIOR + name,
        role=BlockRole.PRIOR,
        table=table.name if table is not None else None,
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
    return stated_numbers(declaration, value, declaration.name.span)


def stated_numbers(declaration: Declaration, value: Value, span: Span) -> tuple[Number, ...]:
    """A start known while compiling, in SI: one number for each that ``:init`` states."""
    found = []
    elements = _stated(declaration, value, span) if declaration.dimension else shaped(value, declaration.shape, span)
    for element in elements:
        dimension = element.dimension if isinstance(element, Number | Constant) else None
        number = nearest(static_number(element, span))
        if not isfinite(number):
            raise MbmError(language_faults.undefined_value(span, declaration.name.name))
        found.append(Number(number, dimension, element.span))
    return tuple(found)
