"""A problem's clauses → ``Problem``: reads them in the order in which they need one another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from mbm.expression.nodes import Number
from mbm.language import faults as language_faults
from mbm.language.functions import bind_definition, parse_definition
from mbm.language.limits import Limits
from mbm.language.session import ProblemDefinition, Program, Session, open_session
from mbm.language.values import FunctionTable, Vocabulary
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate
from mbm.problem.checks import check_data
from mbm.problem.clauses import CAMERA, effective_clauses
from mbm.problem.dimensions import infer
from mbm.problem.elaborated import Consulted, Elaborated
from mbm.problem.elaboration import Routines, Workspace
from mbm.problem.joining import filtered, grid_tables, joined
from mbm.problem.naming import TakenNames
from mbm.problem.overrides import Overrides
from mbm.problem.pairing import paired
from mbm.problem.reading.aggregates import OVER_ROWS, Gatherer, Writer
from mbm.problem.reading.cameras import read_camera
from mbm.problem.reading.constants import constant_values, read_constants
from mbm.problem.reading.constraints import model_constraints, read_constraints
from mbm.problem.reading.declarations import Declaration, declare_unknowns, meant, names_in, read_window
from mbm.problem.reading.derived import read_derived
from mbm.problem.reading.dynamics import read_dynamics
from mbm.problem.reading.estimators import read_estimator
from mbm.problem.reading.noise_structure import check_structures, with_scales
from mbm.problem.reading.observations import read_observation, with_shared_errors
from mbm.problem.reading.pairs import read_pair
from mbm.problem.reading.request import read_request, trusting
from mbm.problem.reading.sources import (
    DataClause,
    Formats,
    check_members,
    check_units,
    in_join_order,
    matrices,
    plan_of,
    read_source,
    refuse_overwriting,
)
from mbm.problem.reading.states import Declared, declare_states, first_states
from mbm.problem.reading.unknowns import given_start, read_unknown
from mbm.problem.scopes import ProblemScope
from mbm.problem.sequence.dimensions import open_rates
from mbm.problem.sequence.types import Sequence as Steps
from mbm.problem.tables import PairDeclaration, Table, TableDeclaration
from mbm.problem.types import Block, Derived, Method, Problem, Request, TablePlan, Unknown
from mbm.problem.vocabulary import FUNCTIONS, SPECIAL_FORMS, Earlier, looking_back, previous, refuse_corrected
from mbm.shapes.model import ModelLog, model_maker
from mbm.text.types import Diagnostic, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

Loader = Callable[[Iterable[TableDeclaration]], Mapping[str, Table]]
"""Reads the tables of all data clauses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What elaboration needs besides the text; ``drawing``: inputs may be without a variance."""

    vocabulary: Vocabulary
    limits: Limits
    formats: Formats
    routines: Routines = tuple
    drawing: bool = False


def elaborate(
    program: Program, definition: ProblemDefinition, front: Front, overrides: Overrides, load: Loader
) -> Elaborated:
    """The problem that ``definition`` says, with its tables read by ``load``.

    Raises:
        MbmError: every error found; clauses are independent, so several may be reported.

    """
    clauses = with_scales(effective_clauses(program, definition))
    tables: dict[str, Table] = {}
    log = ModelLog()
    session = _session(program, front, tables, log, FUNCTIONS if _all(clauses, "states") else {})
    world = session.evaluator.world
    if not isinstance(world, ProblemScope):
        raise TypeError(world)
    work = Workspace(session.evaluator, world, tables, front.formats, front.routines, drawing=front.drawing)
    _functions(work, session, clauses)
    stated = [each for c in _all(clauses, "constants") for each in read_constants(work, c, overrides)]
    numbers = constant_values(work, stated, definition.span)
    earlier = work.scope.earlier = Earlier(work.tables, {})
    plans, raw = _tables(work, clauses, load, earlier)
    pairs = _pairs(work, clauses)
    work.finish()
    states = _states(work, clauses)
    declarations = [d for c in _all(clauses, "unknowns") for d in declare_unknowns(work, c)]
    declarations += () if states is None else states.declarations
    for clause in _all(clauses, CAMERA):
        with work.collecting(clause):
            read_camera(work, clause)
    _definitions(work, clauses)
    unknowns, priors = _unknowns(work, declarations)
    starts = _starts(work, declarations, [each.name for each in stated], overrides)
    taken = TakenNames({prior.name: prior.span for prior in priors})
    observed, concerns = _observed(work, clauses, taken, plans)
    sequence, unknowns, known = _sequence(work, clauses, states, (unknowns, priors), taken)
    blocks = (*observed, *known)
    derived, aggregates = _derived(work, clauses)
    blocks = (*blocks, *model_constraints(work, log, taken))
    request = _request(work, clauses, declarations)
    blocks = _trusted(work, clauses, blocks)
    _check_content(work, declarations, (blocks, derived, request), definition)
    blocks = tuple(map(looking_back, blocks)) if earlier.asked else blocks
    given, wanted = (starts, _widths(request)), (derived, aggregates)
    dimensions, blocks, clashes = infer(unknowns, blocks, wanted, plans, pairs, tables, given, sequence)
    work.diagnostics.extend(clashes)
    work.finish()
    if request is None:
        raise TypeError(definition.name)
    problem = Problem(
        name=definition.name,
        doc=definition.doc,
        plans=plans,
        pairs=pairs,
        constants=numbers,
        unknowns=unknowns,
        blocks=blocks,
        derived=derived,
        aggregates=aggregates,
        written_out=tuple(work.written_out),
        earlier=tuple(earlier.asked),
        request=request,
        sequence=sequence,
        dimensions=dimensions,
        warnings=(*work.evaluator.warnings.values(), *concerns),
        span=definition.span,
    )
    numbers_of = {name: tuple(float(n.value) for n in given) for name, given in starts.items()}
    return replace(_checked(problem, raw, tables, numbers_of, work.reads.consulted()), read=tuple(session.read))


def _trusted(work: Workspace, clauses: tuple[Sequence, ...], blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    """The blocks with the rows that no outlier rule may reject."""
    with work.collecting():
        blocks = trusting(work, _all(clauses, "solve"), blocks)
    return blocks  # noqa: RET504 - those that were there, where the condition is wrong


def _widths(request: Request | None) -> Mapping[str, tuple[Number, ...]]:
    """How wide the boxes of interval methods may stay, by unknown."""
    return {} if request is None or request.enclosing is None else request.enclosing.widths


def _check_content(
    work: Workspace,
    declarations: list[Declaration],
    told: tuple[tuple[Block, ...], tuple[Derived, ...], Request | None],
    definition: ProblemDefinition,
) -> None:
    """Raise what was collected, and that there is nothing to estimate or derive, or nothing that is ``told`` of it."""
    blocks, derived, request = told
    with work.collecting():
        check_structures(blocks, request)
    bounded = request is not None and request.method is Method.INTERVAL
    if not declarations:
        if not (blocks or derived or work.undeclared or work.diagnostics):
            work.diagnostics.append(faults.no_unknowns(definition.span))
    elif not (blocks or bounded or work.diagnostics or all(each.options.get("fixed") for each in declarations)):
        work.diagnostics.append(faults.no_equations(definition.span))
    work.finish()


def _checked(
    problem: Problem,
    raw: Mapping[str, Table],
    tables: Mapping[str, Table],
    starts: Mapping[str, tuple[float, ...]],
    consulted: Consulted,
) -> Elaborated:
    """The problem with what its data make doubtful; raises what they make wrong."""
    tables = {**tables, **grid_tables(problem.derived)}
    errors, warnings = check_data(problem, tables)
    if errors:
        raise MbmError(*errors)
    return Elaborated(
        problem=replace(problem, warnings=(*problem.warnings, *warnings)),
        raw=raw,
        tables=tables,
        starts=starts,
        consulted=consulted,
        lasting=problem.warnings,
    )


def _session(
    program: Program, front: Front, tables: Mapping[str, Table], log: ModelLog, functions: FunctionTable
) -> Session:
    """``functions`` are those of this problem, beside those of the vocabulary."""
    vocabulary = Vocabulary(
        special_forms={**front.vocabulary.special_forms, **SPECIAL_FORMS},
        functions={**functions, **front.vocabulary.functions},
        not_yet=front.vocabulary.not_yet,
        late={**OVER_ROWS, "previous": previous},
    )
    return open_session(
        program, vocabulary, model_maker(log), front.limits, make_world=lambda scope: ProblemScope(scope, tables)
    )


def _all(clauses: tuple[Sequence, ...], head: str) -> list[Sequence]:
    return [c for c in clauses if c.head == head]


def _functions(work: Workspace, session: Session, clauses: tuple[Sequence, ...]) -> None:
    """A ``defun`` inside a problem sees its unknowns and constants."""
    work.scope.evaluator = work.evaluator
    places: dict[str, Span] = {}
    for clause in _all(clauses, "defun"):
        with work.collecting():
            definition = parse_definition(clause)
            name, span = definition.name, definition.span
            if name in work.evaluator.vocabulary.special_forms:
                raise MbmError(language_faults.reserved_name(span, name))
            if name in places:
                raise MbmError(language_faults.duplicate_definition(span, name, places[name]))
            places[name] = span
            session.define(bind_definition(definition, work.scope))


def _tables(
    work: Workspace, clauses: tuple[Sequence, ...], load: Loader, earlier: Earlier
) -> tuple[tuple[TablePlan, ...], dict[str, Table]]:
    found: dict[str, DataClause] = {}
    for clause in _all(clauses, "data"):
        with work.collecting():
            data = read_source(work.evaluator, work.scope, clause, work.formats)
            name = data.declaration.name
            if name in found:
                other = found[name].declaration.span
                raise MbmError(language_faults.duplicate_definition(data.declaration.span, name, other))
            found[name] = data
    work.finish()
    found |= matrices(_all(clauses, "observe"))
    check_members(found)
    raw = dict(load([data.declaration for data in found.values()]))
    check_units(found, raw)
    tables = work.tables
    ordered = in_join_order(found)
    for data in ordered:
        with work.collecting():
            name = data.declaration.name
            refuse_overwriting(raw[name], data, raw)
            tables[name] = joined(raw[name], data.joins, {**raw, **tables})
    work.finish()
    keys, passing = (names_in(clauses, head) for head in ("for-each", "window"))
    work.scope.divided = meant(keys, tables), (*passing, *meant(passing, tables))
    earlier.unfiltered.update(tables)
    earlier.keys = work.scope.divided[0]
    plans = []
    for data in ordered:
        with work.collecting():
            plans.append(plan_of(work, data))
    work.finish()
    for plan in plans:
        tables[plan.name] = filtered(plan, tables, plan.where)
    work.reads.filtered = True
    return tuple(plans), raw


def _pairs(work: Workspace, clauses: tuple[Sequence, ...]) -> tuple[PairDeclaration, ...]:
    """The tables that are laid on one another, each pair after those written before it."""
    found = []
    for clause in _all(clauses, "pair"):
        with work.collecting():
            pair = read_pair(work, clause, *work.scope.divided)
            work.tables[pair.name] = paired(pair, work.tables)
            found.append(pair)
    return tuple(found)


def _definitions(work: Workspace, clauses: tuple[Sequence, ...]) -> None:
    usage = "(define (name form)…)"
    for clause in _all(clauses, "define"):
        for item in clause.items[1:]:
            with work.collecting(item):
                if not (isinstance(item, Sequence) and len(item.items) == 2 and isinstance(item.items[0], Symbol)):
                    raise MbmError(language_faults.bad_form(item.span, "a definition is (name form)", usage))
                name = item.items[0]
                other = work.scope.entries.get(name.name)
                if other is not None:
                    raise MbmError(language_faults.duplicate_definition(name.span, name.name, other.span))
                if name.name in work.scope.definitions:
                    place = work.scope.definitions[name.name].span
                    raise MbmError(language_faults.duplicate_definition(name.span, name.name, place))
                work.scope.definitions[name.name] = item.items[1]


def _unknowns(work: Workspace, declarations: list[Declaration]) -> tuple[tuple[Unknown, ...], tuple[Block, ...]]:
    unknowns, priors = [], []
    for declaration in declarations:
        with work.collecting():
            unknown, prior = read_unknown(work, declaration)
            unknowns.append(unknown)
            if prior is not None:
                work.extent.add(prior)
                priors.append(prior)
    return tuple(unknowns), tuple(priors)


def _states(work: Workspace, clauses: tuple[Sequence, ...]) -> Declared | None:
    dynamics, states = _all(clauses, "dynamics"), _all(clauses, "states")
    found = None
    with work.collecting(*states[:1]):
        divided = bool(_all(clauses, "for-each") or _all(clauses, "window"))
        found = declare_states(work, states, dynamics, divided=divided)
        if found is None and dynamics:
            raise MbmError(faults.no_states(dynamics[0].items[0].span, "`dynamics`"))
    return found


def _sequence(
    work: Workspace,
    clauses: tuple[Sequence, ...],
    declared: Declared | None,
    known: tuple[tuple[Unknown, ...], tuple[Block, ...]],
    taken: TakenNames,
) -> tuple[Steps | None, tuple[Unknown, ...], tuple[Block, ...]]:
    """The sequence that the states make, the unknowns and their priors in it, and the equations of its transitions."""
    unknowns, priors = known
    sequence: Steps | None = None
    carried: tuple[Block, ...] = ()
    with work.collecting():
        estimator = read_estimator(work, _all(clauses, "solve"))
        if declared is not None:
            states, unknowns, priors = first_states(declared, unknowns, priors)
            sequence, carried = read_dynamics(work, _all(clauses, "dynamics"), declared, states, taken)
            sequence, unknowns, priors = open_rates(replace(sequence, estimator=estimator), unknowns, priors)
    return sequence, unknowns, (*priors, *carried)


def _starts(
    work: Workspace, declarations: list[Declaration], constants: list[str], overrides: Overrides
) -> dict[str, tuple[Number, ...]]:
    """Starts given from outside; a name that is neither a constant nor an unknown is an error."""
    known = {d.name.name: d for d in declarations}
    found = {}
    for name, override in overrides.items():
        with work.collecting():
            if name in known:
                found[name] = given_start(work, known[name], override)
            elif name not in constants:
                raise MbmError(faults.unknown_override(name, (*constants, *known)))
    return found


def _observed(
    work: Workspace, clauses: tuple[Sequence, ...], taken: TakenNames, plans: tuple[TablePlan, ...]
) -> tuple[tuple[Block, ...], tuple[Diagnostic, ...]]:
    """Observations and constraints with the errors that their columns share, and the warnings about those."""
    blocks: list[Block] = []
    for clause in _all(clauses, "observe"):
        with work.collecting():
            blocks.append(read_observation(work, clause, taken))
            work.extent.add(blocks[-1])
    work.scope.gather = Writer(work, work.scope.divided[0], _all(clauses, "window"))
    for clause in _all(clauses, "constraints"):
        work.evaluator.budget.reset(clause.span)
        blocks.extend(read_constraints(work, clause, taken))
    work.scope.gather = None
    observed: tuple[tuple[Block, ...], tuple[Diagnostic, ...]] = tuple(blocks), ()
    with work.collecting():
        observed = with_shared_errors(observed[0], plans, work.tables)
        refuse_corrected(observed[0])
    return observed


def _request(work: Workspace, clauses: tuple[Sequence, ...], declarations: list[Declaration]) -> Request | None:
    found = []
    with work.collecting():
        request = read_request(work, _all(clauses, "solve"), _all(clauses, "for-each"), declarations)
        found.append(replace(request, window=read_window(work, _all(clauses, "window"), request.for_each)))
    return found[0] if found else None


def _derived(work: Workspace, clauses: tuple[Sequence, ...]) -> tuple[tuple[Derived, ...], tuple[Aggregate, ...]]:
    """The derived quantities, and the aggregates in them."""
    gatherer = work.scope.gather = Gatherer(work)
    found = tuple(d for c in _all(clauses, "derive") for d in read_derived(work, c))
    work.scope.gather = None
    return found, tuple(gatherer.found)
