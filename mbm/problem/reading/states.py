"""``(states :over TABLE-OR-COLUMN (NAME [TYPE] option…)…)``: unknowns that have a value at every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mbm.expression.nodes import Member, Number
from mbm.language import faults as language_faults
from mbm.language.values import Value
from mbm.problem import faults
from mbm.problem.clauses import Options, only, split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.joining import with_families
from mbm.problem.naming import PRIOR
from mbm.problem.reading.declarations import Declaration, components, named_column, read_declaration, refuse_texts
from mbm.problem.scopes import Entry, Steps
from mbm.problem.sequence.certain import held_at_first
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, RATE, State
from mbm.problem.types import Block, Family, NoiseKind, Unknown, UnknownKind
from mbm.text.types import Form, MbmError, Numeral, Sequence, Symbol
from mbm.values import dataclass

USAGE = "(states :over column (name [type] [:init form] [:sigma s] [:in (lo hi)] [:unit u])…)"
_RATE_OPTIONS = {"velocity": "init", "velocity-sigma": "sigma"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Declared:
    """The states as declared, rates behind those that they belong to (``rate_of``), and the family of the steps.

    ``divided``: the rows make several sequences.
    """

    declarations: tuple[Declaration, ...]
    rate_of: Mapping[str, str]
    family: Family
    clause: Sequence
    divided: bool


def declare_states(
    work: Workspace, clauses: list[Sequence], dynamics: list[Sequence], *, divided: bool
) -> Declared | None:
    """Declare the states, so that all clauses may use them; None where there are none.

    ``divided``: other clauses make several sequences of the rows.

    Raises:
        MbmError: two clauses, no column of numbers to go over.

    """
    clause = only(clauses, "states")
    if clause is None:
        return None
    options = split_options(clause.items[1:], clause.span, owner="`states`", known=("over",))
    over = options.get("over")
    if over is None:
        raise MbmError(language_faults.bad_form(clause.items[0].span, "`states` says over which steps", USAGE))
    family = _steps(work, over)
    work.tables.update(with_families(work.tables, (family,)))
    work.scope.steps = Steps(
        column=str(family.column),
        table=family.rows,
        reached=f"transitions of {family.column}",
        previous=PREVIOUS,
        interval=INTERVAL,
    )
    moving = _moving(dynamics)
    found: list[Declaration] = []
    rate_of: dict[str, str] = {}
    for item in options.positional:
        with work.collecting(item):
            declaration = read_declaration(work, item, steps=family)
            found.append(declaration)
            _enter(work, declaration)
            form = moving.get(declaration.name.name)
            if form is not None:
                rate = _rate(declaration, form)
                found.append(rate)
                _enter(work, rate)
                rate_of[rate.name.name] = declaration.name.name
    return Declared(declarations=tuple(found), rate_of=rate_of, family=family, clause=clause, divided=divided)


def first_states(
    declared: Declared, unknowns: tuple[Unknown, ...], priors: tuple[Block, ...]
) -> tuple[tuple[State, ...], tuple[Unknown, ...], tuple[Block, ...]]:
    """The states, with unknowns that are held at the first step where they are certain, and priors of the others.

    Raises:
        MbmError: of a rotation or translation, some coordinates are certain and others are not.

    """
    states: list[State] = []
    held, left = {each.name: each for each in unknowns}, {each.name: each for each in priors}
    for declaration in declared.declarations:
        name = declaration.name.name
        prior = left.get(PRIOR + name)
        certain = _certain(declaration, prior) if prior is not None else ()
        if prior is not None and any(certain):
            held[name] = held_at_first(held[name], certain)
            if all(certain):
                prior = None
                del left[PRIOR + name]
            else:
                prior = left[PRIOR + name] = _without(prior, certain)
        states.append(
            State(
                name=name,
                rate_of=declared.rate_of.get(name),
                prior=prior.name if prior is not None else None,
                certain=certain if any(certain) else (),
                span=declaration.name.span,
            )
        )
    return tuple(states), tuple(held.values()), tuple(left.values())


def _certain(declaration: Declaration, prior: Block) -> tuple[bool, ...]:
    """Which coordinates have a standard deviation of 0 at the first step."""
    (equation,) = prior.cases[0].equations
    if equation.noise_kind is not NoiseKind.SIGMA:
        return ()
    found = tuple(isinstance(each, Number) and each.value == 0 for each in equation.noise)
    turns = {2: 1, 3: 3}.get(declaration.dimension, len(found))
    parts = (found[:turns], found[turns : turns + declaration.dimension]) if declaration.dimension else ()
    if any(any(part) and not all(part) for part in parts):
        message = "a rotation or a translation is certain as a whole, or not at all"
        raise MbmError(language_faults.bad_form(equation.span, message, ":sigma [0 0.1 0.1]"))
    return found


def _without(prior: Block, certain: tuple[bool, ...]) -> Block:
    """The prior of what is not certain."""
    (case,) = prior.cases
    (equation,) = case.equations
    kept = [i for i, sure in enumerate(certain) if not sure]
    mean = equation.measured
    left = replace(
        equation,
        components=tuple(equation.components[i] for i in kept),
        noise=tuple(equation.noise[i] for i in kept),
        measured=None if mean is None else tuple(mean[i] for i in kept),
    )
    return replace(prior, cases=(replace(case, equations=(left,)),))


def _steps(work: Workspace, form: Form) -> Family:
    """The family over the steps: the values of a column in all tables that have it."""
    if not isinstance(form, Symbol):
        raise MbmError(language_faults.bad_form(form.span, "`:over` names a column, or a table with a key", USAGE))
    named = work.tables.get(form.name)
    if named is not None and named.key is None:
        raise MbmError(faults.table_without_key(form.span, form.name))
    column = named_column(work, form) if named is None or named.key is None else named.key
    sources = tuple((name, column) for name, table in work.tables.items() if column in table.columns)
    refuse_texts((work.tables[name] for name, _ in sources), column, form.span)
    several = len(sources) > 1
    return Family(
        table=f"all {column}" if several else sources[0][0],
        column=column,
        rows=f"steps of {column}",
        key=column,
        sources=sources if several else (),
        ordered=True,
    )


def _moving(dynamics: list[Sequence]) -> dict[str, Sequence]:
    """The names that have a rate, with the transitions that say so."""
    forms = (form for clause in dynamics for form in clause.items[1:] if isinstance(form, Sequence))
    moving = (form for form in forms if form.head == "constant-velocity" and len(form.items) > 1)
    return {form.items[1].name: form for form in moving if isinstance(form.items[1], Symbol)}


def _rate(declaration: Declaration, form: Sequence) -> Declaration:
    """The rate of a state: what it adds to each of the state's coordinates in a unit of the steps' column."""
    if declaration.kind is UnknownKind.DIRECTION:
        usage = "a direction goes on by (random-walk name :sigma q)"
        raise MbmError(language_faults.bad_form(form.span, "a direction has no rate", usage))
    shape, kind = declaration.shape, UnknownKind.VECTOR
    if declaration.dimension:
        size = declaration.manifold.tangent
        shape, kind = ((size,), UnknownKind.VECTOR) if size > 1 else ((), UnknownKind.REAL)
    elif declaration.kind in (UnknownKind.ARRAY, UnknownKind.VECTOR):
        kind = declaration.kind
    else:
        kind = UnknownKind.REAL
    known = ("acceleration", *_RATE_OPTIONS)
    given = split_options(form.items[2:], form.span, owner="`constant-velocity`", known=known)
    keywords = {_RATE_OPTIONS[name]: value for name, value in given.keywords.items() if name in _RATE_OPTIONS}
    places = {_RATE_OPTIONS[name]: place for name, place in given.places.items() if name in _RATE_OPTIONS}
    keywords.setdefault("init", Numeral(value=0, unit=None, span=form.span))
    name = Symbol(name=declaration.name.name + RATE, span=declaration.name.span)
    options = Options(positional=(), keywords=keywords, repeated={}, places=places, span=form.span)
    return Declaration(name=name, kind=kind, shape=shape, dimension=0, family=declaration.family, options=options)


def _enter(work: Workspace, declaration: Declaration) -> None:
    def at_step(member: Member) -> Value:
        return components(declaration, member)

    def nowhere() -> Value:
        return components(declaration, None)

    name = declaration.name
    work.scope.add(name.name, Entry("state", name.span, nowhere, at_step))
