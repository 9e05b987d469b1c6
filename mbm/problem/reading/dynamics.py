"""``(dynamics TRANSITION…)``: how the states get from one step to the next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from mbm.expression.algebra import add, apply, differences, multiply, number, subtract
from mbm.expression.nodes import Column, ColumnMember, Expression, Number, Operation, leaves
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.scope import difference, vector
from mbm.language.values import Array, Scope, Value
from mbm.language.vocabulary.rigid import direction_difference, geometric_difference
from mbm.problem import faults
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.kinds import ConstraintKind, Relation
from mbm.problem.naming import TakenNames
from mbm.problem.reading.declarations import Declaration, components
from mbm.problem.reading.equations import Residual
from mbm.problem.reading.noise_structure import NOISE, is_unknown, stated_noise, with_noise
from mbm.problem.reading.states import Declared
from mbm.problem.sequence.dimensions import undimensioned
from mbm.problem.sequence.tables import transitions_table
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, RATE, Sequence as Steps, State, Transition, TransitionKind
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, NoiseKind, Static, UnknownKind
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol, symbols_of
from mbm.values import dataclass

USAGE = (
    "(static x), (random-walk x :sigma q), (constant-velocity x :acceleration a [:velocity v :velocity-sigma s])"
    " or (= (next x) form :sigma q)"
)
_KINDS = {kind.value: kind for kind in TransitionKind}
_OPTIONS = {
    TransitionKind.STATIC: (),
    TransitionKind.RANDOM_WALK: ("sigma",),
    TransitionKind.CONSTANT_VELOCITY: ("acceleration", "velocity", "velocity-sigma"),
    TransitionKind.EQUATION: NOISE,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reading:
    """The states, by name, and the sequence as it is known before its transitions are."""

    work: Workspace
    states: Mapping[str, Declaration]
    steps: Steps
    taken: TakenNames


def read_dynamics(
    work: Workspace, clauses: list[Sequence], declared: Declared, first: tuple[State, ...], taken: TakenNames
) -> tuple[Steps, tuple[Block, ...]]:
    """The sequence of states, as they are at ``first``, with its transitions, and their blocks."""
    steps = work.scope.steps
    if steps is None:
        raise TypeError(declared)
    family, names = declared.family, [each.name.name for each in declared.declarations]
    known = Steps(
        column=steps.column,
        steps=steps.table,
        reached=steps.reached,
        sources=family.sources or ((family.table, steps.column),),
        states=first,
        divided=declared.divided,
        span=declared.clause.items[0].span,
    )
    states = dict(zip(names, declared.declarations, strict=True))
    reading = _Reading(work=work, states=states, steps=known, taken=taken)
    work.tables[known.reached] = transitions_table(known, work.tables)
    found: list[tuple[Transition, tuple[Block, ...], frozenset[tuple[str, str]]]] = []
    places: dict[str, Span] = {}
    for form in (form for clause in clauses for form in clause.items[1:]):
        with work.collecting():
            found.append(_transition(reading, form, places))
    missing = (d for d in declared.declarations if d.name.name not in places and not work.diagnostics)
    work.diagnostics.extend(faults.state_without_transition(d.name.span, d.name.name) for d in missing)
    used = {column for _, _, columns in found for column in columns}
    joined = tuple(
        (name, column) for name, _ in known.sources for column in work.tables[name].columns if (name, column) in used
    )
    sequence = replace(known, transitions=tuple(transition for transition, _, _ in found), joined=joined)
    with work.collecting():
        work.tables[known.reached] = transitions_table(sequence, work.tables)
    return sequence, tuple(block for _, blocks, _ in found for block in blocks)


def _transition(
    reading: _Reading, form: Form, places: dict[str, Span]
) -> tuple[Transition, tuple[Block, ...], frozenset[tuple[str, str]]]:
    """A transition, its blocks, and the columns of other tables in it; ``places`` gains the states that it moves."""
    kind = _KINDS.get(form.head or "") if isinstance(form, Sequence) else None
    if kind is None or not isinstance(form, Sequence):
        raise MbmError(language_faults.bad_form(form.span, "this is no transition", USAGE))
    options = split_options(form.items[1:], form.span, owner=f"`{kind.value}`", known=_OPTIONS[kind])
    declaration = _state(reading, kind, form, options)
    name = declaration.name.name
    moved = (name, name + RATE) if kind is TransitionKind.CONSTANT_VELOCITY else (name,)
    for each in moved:
        if each not in reading.states:
            reading.work.finish()  # it could not be declared
        if each in places:
            raise MbmError(language_faults.duplicate_definition(form.span, f"dynamics of {each}", places[each]))
        places[each] = form.span
    if kind is TransitionKind.STATIC:
        return Transition(kind=kind, states=moved, block=None, span=form.span), (), frozenset()
    columns, table = _table_for(reading, options)
    equations = _equation if kind is TransitionKind.EQUATION else _scaled
    block, scale = equations(reading, declaration, kind, form, options, table)
    noisy, exact = _parted(reading, block)
    blocks = tuple(each for each in (noisy, exact) if each is not None)
    for made in blocks:
        reading.work.extent.add(made)
    transition = Transition(
        kind=kind,
        states=moved,
        block=noisy.name if noisy is not None else None,
        exact=exact.name if exact is not None else None,
        scale=scale,
        span=form.span,
    )
    return transition, blocks, frozenset(_other_columns(block, columns))


def _parted(reading: _Reading, block: Block) -> tuple[Block | None, Block | None]:
    """The components that have noise, and those whose standard deviation is 0."""
    noisy, exact = (tuple(_part(case, exact=exact) for case in block.cases) for exact in (False, True))
    if not any(case.equations for case in exact):
        return block, None
    demanded = replace(
        block,
        name=reading.taken.free(f"{block.name} exactly", block.span),
        role=BlockRole.CONSTRAINT,
        cases=exact,
        unknown_factor=False,
        singular=False,
        constraint=ConstraintKind.EQUAL,
    )
    return (replace(block, cases=noisy) if any(case.equations for case in noisy) else None), demanded


def _part(case: EquationCase, *, exact: bool) -> EquationCase:
    """The equations with those components that have no noise, or with the others."""
    found = []
    for equation in case.equations:
        zero = [isinstance(n, Number) and n.value == 0 for n in equation.noise]
        if equation.noise_kind is not NoiseKind.SIGMA:
            zero = [False] * len(equation.components)
        kept = [i for i, each in enumerate(zero) if each is exact]
        if kept:
            found.append(
                replace(
                    equation,
                    components=tuple(equation.components[i] for i in kept),
                    noise=() if exact else tuple(equation.noise[i] for i in kept) if any(zero) else equation.noise,
                    relation=Relation.ZERO if exact else equation.relation,
                )
            )
    return replace(case, equations=tuple(found))


def _equation(
    reading: _Reading, declaration: Declaration, kind: TransitionKind, form: Sequence, options: Options, table: Table
) -> tuple[Block, tuple[Expression, ...]]:
    """``(= (next x) FORM …)``."""
    noise_kind, noise_form, factor = stated_noise(options)
    model = options.positional[1]

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        value = reading.work.evaluator.wanted(model, scope)
        found = _away(declaration, _pair(reading, declaration, model.span)[1], value, model.span)
        residual = Residual(found, None, form.span)
        return (with_noise(reading.work, residual, noise_kind, noise_form, scope, exact=False),)

    cases = reading.work.cases(table, evaluate, form.span)
    block = _block(reading, f"next {declaration.name.name}", table, cases, form.span)
    return replace(block, unknown_factor=factor), ()


def _scaled(
    reading: _Reading, declaration: Declaration, kind: TransitionKind, form: Sequence, options: Options, table: Table
) -> tuple[Block, tuple[Expression, ...]]:
    """A transition that the scale of its noise describes, with that scale."""
    walks = kind is TransitionKind.RANDOM_WALK
    option, make = ("sigma", _walk) if walks else ("acceleration", _constant_velocity)

    def evaluate(scope: Scope) -> tuple[tuple[Expression, ...], tuple[Equation, ...]]:
        scale = _scale(reading.work, declaration, option, options, form, scope)
        return scale, make(reading, declaration, scale, form.span)

    cases = reading.work.cases(table, evaluate, form.span)
    made = [(static, equations) for static, (_, equations) in cases]
    scale = cases[0][1][0] if cases else ()
    return _block(reading, f"{kind.value} {declaration.name.name}", table, made, form.span), scale


def _block(
    reading: _Reading, name: str, table: Table, cases: list[tuple[Static, tuple[Equation, ...]]], span: Span
) -> Block:
    return Block(
        name=reading.taken.free(name, span),
        role=BlockRole.TRANSITION,
        table=table.name,
        cases=tuple(EquationCase(static=static, equations=equations) for static, equations in cases),
        when=None,
        unknown_factor=False,
        singular=True,
        span=span,
    )


def _state(reading: _Reading, kind: TransitionKind, form: Sequence, options: Options) -> Declaration:
    """The state that a transition is about."""
    wanted = 2 if kind is TransitionKind.EQUATION else 1
    if len(options.positional) != wanted:
        raise MbmError(language_faults.bad_form(form.span, f"`{kind.value}` is not complete", USAGE))
    named = options.positional[0]
    if kind is TransitionKind.EQUATION:
        if not (isinstance(named, Sequence) and named.head == "next" and len(named.items) == 2):
            raise MbmError(language_faults.bad_form(named.span, "the measured side is `(next state)`", USAGE))
        named = named.items[1]
    name = named.name if isinstance(named, Symbol) else named.span.text
    declaration = reading.states.get(name)
    if declaration is None:
        raise MbmError(faults.unknown_state(named.span, name, tuple(reading.states)))
    return declaration


def _table_for(reading: _Reading, options: Options) -> tuple[dict[str, tuple[str, str]], Table]:
    """The table of transitions with the columns of other tables that the forms of a transition may mean.

    They are known by their qualified names (``table.column``), and by the plain one where one table has such a column
    and the problem has nothing of that name.
    """
    work, steps = reading.work, reading.steps
    mentioned = set(_names(work, (*options.positional, *options.keywords.values())))
    plain: dict[str, list[str]] = {}
    wanted: list[tuple[str, str]] = []
    for name, _ in steps.sources:
        table = work.tables[name]
        for called in (*table.columns, *table.groups):
            if called == steps.column:
                continue
            group = table.groups.get(called)
            parts = group.columns if group is not None else (called,)
            qualified = f"{name}.{called}"
            own = called not in work.scope.entries and called in mentioned
            if own:
                plain.setdefault(called, []).append(name)
            if own or qualified in mentioned:
                wanted.extend((name, column) for column in parts)
    for called, tables in plain.items():
        if len(tables) > 1:
            message = f"`{called}` is a column of `{tables[0]}` and of `{tables[1]}`"
            raise MbmError(language_faults.bad_form(options.span, message, f"write {tables[0]}.{called}"))
    table = transitions_table(replace(steps, joined=tuple(dict.fromkeys(wanted)), span=options.span), work.tables)
    columns = dict(table.columns)
    groups = dict(table.groups)
    for called, (name, *_) in plain.items():
        qualified = f"{name}.{called}"
        if qualified in table.columns:
            columns[called] = table.columns[qualified]
        else:
            groups[called] = table.groups[qualified]
    return {f"{name}.{column}": (name, column) for name, column in wanted}, replace(
        table, columns=columns, groups=groups
    )


def _names(work: Workspace, forms: tuple[Form, ...]) -> Iterator[str]:
    """The names in forms, and in what the problem defines by these names."""
    seen: set[str] = set()
    left = list(forms)
    while left:
        for symbol in symbols_of(left.pop()):
            if symbol.name not in seen:
                seen.add(symbol.name)
                yield symbol.name
                if symbol.name in work.scope.definitions:
                    left.append(work.scope.definitions[symbol.name])


def _other_columns(block: Block, columns: Mapping[str, tuple[str, str]]) -> Iterator[tuple[str, str]]:
    for case in block.cases:
        for name, _ in case.static:
            if name in columns:
                yield columns[name]
        for leaf in leaves(tuple(n for e in case.equations for n in (*e.components, *e.noise))):
            if isinstance(leaf, Column) and leaf.table == block.table and leaf.name in columns:
                yield columns[leaf.name]


def _pair(reading: _Reading, declaration: Declaration, span: Span) -> tuple[Value, Value]:
    """The state at the step before, and at the step reached."""
    steps = reading.steps
    before = ColumnMember(table=steps.reached, column=PREVIOUS)
    reached = ColumnMember(table=steps.reached, column=steps.column)
    return components(declaration, before, span), components(declaration, reached, span)


def _interval(reading: _Reading, span: Span) -> Column:
    return Column(reading.steps.reached, INTERVAL, RowChoice.EACH, span)


def _away(declaration: Declaration, measured: Value, model: Value, span: Span) -> tuple[Expression, ...]:
    """MODEL ⊖ MEASURED of a state's kind of value, one number for each tangent coordinate."""
    if declaration.kind is UnknownKind.DIRECTION:
        return direction_difference(vector(measured, span, 3).elements, vector(model, span, 3).elements, span)
    found = geometric_difference(measured, model, span)
    if found is not None:
        return found
    shape = declaration.shape
    pairs = zip(shaped(model, shape, span), shaped(measured, shape, span, broadcast=False), strict=True)
    return tuple(difference(a, b, span) for a, b in pairs)


def _scale(
    work: Workspace, declaration: Declaration, option: str, options: Options, form: Sequence, scope: Scope
) -> tuple[Expression, ...]:
    """``:sigma`` of a random walk, ``:acceleration`` of a constant velocity: a number for each tangent coordinate."""
    stated = options.get(option)
    if stated is None:
        raise MbmError(language_faults.bad_form(form.span, f"`{form.head}` wants `:{option}`", USAGE))
    if is_unknown(stated) or (isinstance(stated, Sequence) and stated.head == "unknown"):
        raise MbmError(faults.unknown_scale(stated.span, declaration.name.name, option, walks=option == "sigma"))
    shape = declaration.shape if not declaration.dimension else (declaration.manifold.tangent,)
    found = shaped(work.evaluator.wanted(stated, scope), shape if shape != (1,) else (), stated.span)
    work.refuse_unknowns(found, stated.span, f"`:{option}`")
    return found


def _walk(
    reading: _Reading, declaration: Declaration, scale: tuple[Expression, ...], span: Span
) -> tuple[Equation, ...]:
    """What changes by white noise: its variance grows with the time."""
    before, reached = _pair(reading, declaration, span)
    root = apply(Operation.SQRT, _interval(reading, span), span=span)
    noise = tuple(multiply(each, root, span) for each in undimensioned(scale))
    found = _away(declaration, reached, before, span)
    return (Equation(components=found, noise_kind=NoiseKind.SIGMA, noise=noise, measured=None, span=span),)


def _constant_velocity(
    reading: _Reading, declaration: Declaration, scale: tuple[Expression, ...], span: Span
) -> tuple[Equation, ...]:
    """The state goes on by its rate; the acceleration is white, and constant within a step.

    The noise of a coordinate and of its rate is s² [[dt⁴/4 dt³/2] [dt³/2 dt²]], of rank 1. Rotations, poses and
    similarities go on by ``R Exp(ω dt)``, ``t + R v dt``: their rates are those in the frame of the step before.
    """
    before, reached = _pair(reading, declaration, span)
    rate = reading.states[declaration.name.name + RATE]
    velocity, later = (_numbers(each) for each in _pair(reading, rate, span))
    dt = _interval(reading, span)
    steps = tuple(multiply(dt, each, span) for each in velocity)
    if declaration.dimension:
        ahead = geometric_difference(before, reached, span) or ()
        away = differences(steps, ahead, span)
    else:
        moved = tuple(add(a, b, span) for a, b in zip(_numbers(before), steps, strict=True))
        away = tuple(difference(a, b, span) for a, b in zip(moved, _numbers(reached), strict=True))
    half = multiply(number(0.5), multiply(dt, dt, span), span)
    found = []
    for distance, old, new, each in zip(away, velocity, later, undimensioned(scale), strict=True):
        position, speed = multiply(each, half, span), multiply(each, dt, span)
        roots = (position, speed)
        noise = tuple(multiply(a, b, span) for a in roots for b in roots)
        change = subtract(old, new, span)
        found.append(
            Equation(
                components=(distance, change), noise_kind=NoiseKind.COVARIANCE, noise=noise, measured=None, span=span
            )
        )
    return tuple(found)


def _numbers(value: Value) -> tuple[Expression, ...]:
    return value.elements if isinstance(value, Array) else (value,)  # type: ignore[return-value]
