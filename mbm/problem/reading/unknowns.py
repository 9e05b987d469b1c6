"""``(unknowns (NAME [TYPE] option…)…)``: what is to be estimated.

``:prior (rectangular lo hi)`` is a prior on its numbers, and a start where ``:init`` gives none.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, prod

from mbm.expression.nodes import Apply, Column, Constant, Expression, Number, Operation, leaves, nearest
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.scope import difference, static_number, vector
from mbm.language.values import (
    Array,
    RotationValue,
    Scope,
    Value,
    described_with_space,
)
from mbm.language.vocabulary.rigid import (
    direction_difference,
    geometric_difference,
    pose,
)
from mbm.language.vocabulary.rotations import as_rotation
from mbm.problem import faults
from mbm.problem.clauses import stated_unit
from mbm.problem.elaboration import Workspace, given_value, pair_of, shaped
from mbm.problem.naming import PRIOR
from mbm.problem.overrides import Override
from mbm.problem.reading.declarations import USAGE, Declaration, components, own_member
from mbm.problem.reading.distributions import DISTRIBUTIONS, is_distribution, law_of, moments
from mbm.problem.reading.equations import data_only
from mbm.problem.tables import Table
from mbm.problem.types import (
    Block,
    BlockRole,
    Equation,
    EquationCase,
    NoiseKind,
    RowValues,
    Unknown,
    UnknownKind,
    ValueCase,
)
from mbm.text.suggest import suggestion
from mbm.text.types import Form, MbmError, Sequence, Span, Text

PRIOR_USAGE = ":prior (rectangular lo hi), and likewise " + " ".join(
    name for name in DISTRIBUTIONS if name != "rectangular"
)


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
        hint = PRIOR_USAGE if head is None else suggestion(head, tuple(DISTRIBUTIONS), PRIOR_USAGE)
        raise MbmError(
            language_faults.bad_form(form.span, f"`{form.span.text}` is no distribution", hint or PRIOR_USAGE)
        )
    return form


def _moments(
    work: Workspace, declaration: Declaration, form: Sequence, scope: Scope
) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    mean, sigma = moments(work, form.head or "", form.items[1:], declaration.shape, scope, form.span)
    work.refuse_unknowns((*mean, *sigma), form.span, f"`:prior` of `{declaration.name.name}`")
    return mean, sigma


def read_unknown(work: Workspace, declaration: Declaration) -> tuple[Unknown, Block | None]:
    """The unknown with its options evaluated, and the prior that ``:sigma`` or ``:covariance`` adds."""
    options, family, shape = declaration.options, declaration.family, declaration.shape
    table = work.tables[family.rows] if family is not None else None
    name = declaration.name.name

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
    unit_form = options.get("unit")
    start, fixed, at = _held(work, declaration, table)
    unknown = Unknown(
        name=name,
        kind=declaration.kind,
        shape=shape,
        dimension=declaration.dimension,
        family=family,
        start=start,
        lower=lower,
        upper=upper,
        start_lower=start_lower,
        start_upper=start_upper,
        fixed=fixed,
        at=at,
        unit=stated_unit(unit_form) if unit_form is not None else None,
        doc=_doc(options.get("doc")),
        span=declaration.name.span,
    )
    return unknown, _prior(work, declaration, table)


def _held(
    work: Workspace, declaration: Declaration, table: Table | None
) -> tuple[RowValues | None, RowValues | None, RowValues | None]:
    """The start, what is fixed, and where that is held if there is no start: ``:init``, ``:fixed``, ``:at``.

    What is fixed stays at ``:at``, without one at ``:init``, without that at the identity or 0. An ``:init`` of a
    column without a single number is none.
    """
    options, name, size = declaration.options, declaration.name.name, declaration.manifold.tangent
    init_form, fixed_form, at_form = options.get("init"), options.get("fixed"), options.get("at")
    if at_form is not None and fixed_form is None:
        said = "`:at` says where `:fixed` holds an unknown"
        raise MbmError(language_faults.bad_form(options.places["at"], said, USAGE))

    def here(form: Form, scope: Scope, option: str) -> tuple[Expression, ...]:
        wanted = f"`:{option}` of `{name}`"
        return work.evaluated_here(form, scope, lambda v: _stated(declaration, v, form.span), wanted=wanted)

    def rows(form: Form | None, option: str) -> RowValues | None:
        return None if form is None else work.row_values(form, table, lambda scope: here(form, scope, option))

    def fixed_here(form: Form, scope: Scope) -> tuple[Expression, ...]:
        return work.conditions_here(form, scope, size, wanted=f"`:fixed` of `{name}`")

    init = rows(init_form, "init")
    if init is not None and _numberless(init, work.tables):
        init_form = init = None
    if fixed_form is None:
        return init or prior_start(work, declaration, table), None, None
    fixed = work.row_values(fixed_form, table, lambda scope: fixed_here(fixed_form, scope))
    if init_form is None:
        at = rows(at_form, "at") if at_form is not None else _neutral(declaration, fixed_form.span)
        always = all(isinstance(v, Number) and v.value == 1 for case in fixed.cases for v in case.values)
        return (at, fixed, None) if always else (None, fixed, at)
    if at_form is None:
        return init, fixed, None

    def both(scope: Scope) -> tuple[Expression, ...]:
        held = _of_stated(declaration, fixed_here(fixed_form, scope))
        pairs = zip(here(at_form, scope, "at"), here(init_form, scope, "init"), strict=True)
        return tuple(
            Apply(Operation.IF, (condition, at, init), span=at_form.span)
            for condition, (at, init) in zip(held, pairs, strict=True)
        )

    return work.row_values(at_form, table, both), fixed, None


def _numberless(values: RowValues, tables: Mapping[str, Table]) -> bool:
    """Whether a column that they use has gaps only: a pose graph of edges, for one, knows no pose of its vertices."""
    used = {
        (leaf.table, leaf.name) for case in values.cases for leaf in leaves(case.values) if isinstance(leaf, Column)
    }
    columns = (tables[table].columns.get(name) for table, name in used)
    return any(column is not None and column.only_gaps for column in columns)


def _neutral(declaration: Declaration, span: Span) -> RowValues | None:
    """The identity, or zeros; None for directions, of which none is like it."""
    if declaration.kind is UnknownKind.DIRECTION:
        return None
    dimension = declaration.dimension
    if dimension:
        turn = [float(i == j) for i in range(dimension) for j in range(dimension)]
        shift = [0.0] * dimension if declaration.kind is not UnknownKind.ROTATION else []
        numbers = [*turn, *shift, *([1.0] if declaration.kind is UnknownKind.SIMILARITY else [])]
    else:
        numbers = [0.0] * prod(declaration.shape)
    table = declaration.family.rows if declaration.family is not None else None
    return RowValues(table=table, cases=(ValueCase(static=(), values=tuple(map(Number, numbers))),), span=span)


def _of_stated(declaration: Declaration, fixed: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """Of each number that ``:init`` states, whether it is fixed, from the same of each coordinate."""
    if not declaration.dimension:
        return fixed
    if declaration.kind is UnknownKind.DIRECTION:
        return (_any(fixed),) * 3
    turns = 3 if declaration.dimension == 3 else 1
    return (*(_any(fixed[:turns]),) * declaration.dimension**2, *fixed[turns:])


def _any(conditions: tuple[Expression, ...]) -> Expression:
    """Whether one of the conditions holds."""
    found, *others = dict.fromkeys(conditions)
    for other in others:
        found = Apply(Operation.IF, (found, Number(1.0), other))
    return found


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
    """What ``:init`` says: plain numbers, a direction (3), a rotation's matrix, then a translation, then a scale."""
    kind = declaration.kind
    if not declaration.dimension:
        return shaped(value, declaration.shape, span, broadcast=True)
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
    """The prior ``(normal NAME init sigma)``; of a state at the first step."""
    options = declaration.options
    form = options.get("sigma") or options.get("covariance")
    stated = stated_prior(work, declaration, table)
    if form is None or stated is not None:
        return stated
    name, kind = declaration.name.name, NoiseKind.SIGMA if options.get("sigma") else NoiseKind.COVARIANCE
    init_form = options.get("init")
    if init_form is None:
        raise MbmError(faults.prior_without_init(options.places[kind.value], name, kind.value))
    if options.get("sigma") is not None and options.get("covariance") is not None:
        raise MbmError(faults.two_noises(options.places["covariance"]))

    first = declaration.family is not None and declaration.family.ordered

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        evaluator = work.evaluator
        row = RowChoice.FIRST if first else RowChoice.EACH
        value = components(declaration, own_member(declaration.family, row), declaration.name.span)
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
        placed = mean is None
        return (Equation(components=found, noise_kind=kind, noise=noise, measured=mean, placed=placed, span=form.span),)

    if first and table is not None:
        cases, table = work.case_of_first(table, evaluate, form.span), None
    else:
        cases = work.cases(table, evaluate, form.span)
    return Block(
        name=PRIOR + name,
        role=BlockRole.PRIOR,
        table=table.name if table is not None else None,
        cases=tuple(EquationCase(static=s, equations=e) for s, e in cases),
        when=None,
        unknown_factor=False,
        singular=first,
        span=form.span,
    )


def given_start(work: Workspace, declaration: Declaration, override: Override) -> tuple[Number, ...]:
    """A start given from outside, in SI: one number for each component (families: one member's, or all members')."""
    if override.values is not None:
        return tuple(Number(v) for v in override.values)
    value = given_value(work, override.name, override.text or "")
    return stated_numbers(declaration, value, declaration.name.span)


def stated_numbers(declaration: Declaration, value: Value, span: Span) -> tuple[Number, ...]:
    """A start known while compiling, in SI: one number for each that ``:init`` states."""
    found = []
    for element in _stated(declaration, value, span):
        dimension = element.dimension if isinstance(element, Number | Constant) else None
        number = nearest(static_number(element, span))
        if not isfinite(number):
            raise MbmError(language_faults.undefined_value(span, declaration.name.name))
        found.append(Number(number, dimension, element.span))
    return tuple(found)
