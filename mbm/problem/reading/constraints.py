"""``(constraints …)`` of the problem and of the models it uses: what is known beyond the data.

The constraints that the models of a shape bring along.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from mbm.expression.algebra import number
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, leaves
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope, difference, integer
from mbm.language.values import Array, PoseValue, RotationValue, Scope
from mbm.language.vocabulary.rigid import geometric_difference
from mbm.problem import faults
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace, shaped
from mbm.problem.kinds import ConstraintKind, Relation
from mbm.problem.naming import TakenNames
from mbm.problem.reading.distributions import DISTRIBUTIONS, USAGES, is_distribution, law_of, moments
from mbm.problem.reading.equations import data_only, expanded
from mbm.problem.reading.relations import Pair, pairs, refuse_contradictions
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, NoiseKind, Static
from mbm.shapes.model import ModelLog
from mbm.shapes.types import Group, ModelCall, ModelConstraint, Moved, Node, Part, Shape
from mbm.text.printer import print_beginning
from mbm.text.suggest import ELSEWHERE, suggestion
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass


def calls_with_constraints(shapes: Iterable[Shape]) -> tuple[ModelCall, ...]:
    """The model calls in ``shapes`` that have constraints, each distinct model-with-arguments once, outermost first.

    Equal arguments give one and the same ``ModelCall`` (see ``Model``), so that identity of objects decides.
    """
    found: dict[int, ModelCall] = {}
    seen: set[int] = set()
    stack: list[Node] = [shape.content for shape in shapes][::-1]
    while stack:
        node = stack.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, ModelCall) and node.constraints:
            found[id(node)] = node
        if isinstance(node, Moved | Part | Group | ModelCall):
            stack.extend(reversed(node.children))
    return tuple(found.values())


T = TypeVar("T")

USAGE = (
    "(= a b …), (<= a b …), (uniform form lo hi), (normal form mean sigma) or another distribution, "
    "each [:over TABLE] [:name n]"
)
_RELATIONS = {kind.value: kind for kind in ConstraintKind}
_LONGEST_NAME = 60


@dataclass(frozen=True, slots=True)
class _Bound:
    """A constraint with the counters of the ``for`` around it."""

    form: Sequence
    variables: tuple[tuple[str, int], ...]


def read_constraints(work: Workspace, clause: Sequence, taken: TakenNames) -> list[Block]:
    """The blocks of a ``constraints`` clause."""
    found: list[Block | None] = []
    refused: set[Span] = set()  # what a `for` repeats is wrong once, not thousands of times
    for item in clause.items[1:]:
        for each in _unrolled(work, item, ()):
            if each.form.span in refused:
                continue
            refused.add(each.form.span)
            with work.collecting():
                found.append(_counted(work, _read(work, each, taken)))
                refused.remove(each.form.span)
    return [block for block in found if block is not None]


def _counted(work: Workspace, block: Block | None) -> Block | None:
    """The block, of which account is taken."""
    if block is not None:
        work.extent.add(block)
    return block


def _unrolled(work: Workspace, form: Form, variables: tuple[tuple[str, int], ...]) -> list[_Bound]:
    found: list[_Bound] = []
    with work.collecting():
        if not isinstance(form, Sequence) or form.head is None:
            raise MbmError(language_faults.bad_form(form.span, "a constraint is a list", USAGE))
        if form.head != "for" and (_is_constraint(work, form.head) or not _is_function(work, form.head)):
            return [_Bound(form, variables)]
        if form.head != "for":
            return _arrived(work, form, variables)
        header = form.items[1] if len(form.items) > 2 else None
        if not (isinstance(header, Sequence) and len(header.items) == 3 and isinstance(header.items[0], Symbol)):
            raise MbmError(
                language_faults.bad_form(form.span, "`for` is not complete", "(for (i first last) constraint…)")
            )
        scope = _scope(work.scope, variables)
        first, last = (integer(work.evaluator.wanted(f, scope), f.span) for f in header.items[1:])
        count = (last - first + 1) * (len(form.items) - 2)
        work.evaluator.budget.check_length(count, form)
        work.evaluator.budget.spend(max(0, count), form)
        counter = header.items[0].name
        wrong: set[int] = set()  # once, not thousands of times
        for i in range(first, last + 1):
            for number, inner in enumerate(form.items[2:]):
                if number not in wrong:
                    before = len(work.diagnostics)
                    found.extend(_unrolled(work, inner, (*variables, (counter, i))))
                    if len(work.diagnostics) > before:
                        wrong.add(number)
    return found


def _is_constraint(work: Workspace, head: str) -> bool:
    return head in _RELATIONS or is_distribution(work, head)


def _is_function(work: Workspace, head: str) -> bool:
    return head in work.evaluator.vocabulary.functions


def _arrived(work: Workspace, form: Sequence, variables: tuple[tuple[str, int], ...]) -> list[_Bound]:
    """The constraints in the form that a function or macro gives."""
    value = expanded(work.evaluator, form, _scope(work.scope, variables))
    if not isinstance(value, Sequence):
        raise MbmError(language_faults.bad_form(form.span, f"`{form.head}` gives no constraint", USAGE))
    work.evaluator.budget.enter(form)
    try:
        return _unrolled(work, value, variables)
    finally:
        work.evaluator.budget.leave()


def _scope(scope: Scope, variables: tuple[tuple[str, int], ...]) -> Scope:
    return LocalScope({name: number(value) for name, value in variables}, scope) if variables else scope


def _read(work: Workspace, bound: _Bound, taken: TakenNames) -> Block | None:
    """The block of one constraint; None where it holds whatever the unknowns are."""
    form = bound.form
    head = form.head or ""
    kind = _RELATIONS.get(head)
    if kind is None and not is_distribution(work, head):
        wrong = language_faults.bad_form(form.items[0].span, f"`{head}` is no constraint", USAGE)
        if head not in ELSEWHERE:  # `(not (= a b))` is a condition, no constraint
            wrong = replace(wrong, hint=suggestion(head, (*_RELATIONS, *DISTRIBUTIONS), wrong.hint))
        raise MbmError(wrong)
    options = split_options(form.items[1:], form.span, owner="a constraint", known=("over", "name", "at"))
    over = options.get("over")
    table = work.table(over) if over is not None else None
    first = _at_first(work, options)
    name = _name(options.get("name"), bound, taken)
    forms = options.positional
    if kind is not None:

        def chain(scope: Scope) -> tuple[Pair, ...]:
            inner = _scope(scope, bound.variables)
            return pairs(kind, [work.evaluator.wanted(f, inner) for f in forms], form.span)

        where, chains = _where(work, table, chain, form.span, first=first)
        return _constraint(work, name, kind, where, chains, form.span)

    def evaluate(scope: Scope) -> tuple[Equation, ...]:
        return (prior_equation(work, head, forms, _scope(scope, bound.variables), form.span),)

    where, cases = _where(work, table, evaluate, form.span, first=first)
    return Block(
        name=name,
        role=BlockRole.PRIOR,
        table=where.name if where is not None else None,
        cases=tuple(EquationCase(static=s, equations=e) for s, e in cases),
        when=None,
        unknown_factor=False,
        span=form.span,
    )


def _at_first(work: Workspace, options: Options) -> bool:
    """Whether a constraint holds at the first step only."""
    at = options.get("at")
    if at is None:
        return False
    if work.scope.steps is None:
        raise MbmError(faults.no_states(at.span, "`:at first`"))
    if not isinstance(at, Symbol) or at.name != "first" or options.get("over") is not None:
        message = "a constraint holds at every step, or `:at first`, without `:over`"
        raise MbmError(language_faults.bad_form(at.span, message, "(<= 0 x :at first)"))
    return True


def _where(
    work: Workspace, table: Table | None, evaluate: Callable[[Scope], T], span: Span, *, first: bool
) -> tuple[Table | None, list[tuple[Static, T]]]:
    """For which rows a constraint holds, and its cases: at every step if it mentions a state and names no table."""
    if first and work.scope.steps is not None:
        return None, work.case_of_first(work.tables[work.scope.steps.table], evaluate, span)
    return work.cases_at_steps(table, evaluate, span)


def _constraint(
    work: Workspace,
    name: str,
    kind: ConstraintKind,
    table: Table | None,
    found: list[tuple[Static, tuple[Pair, ...]]],
    span: Span,
    distinct: tuple[str, ...] = (),
) -> Block | None:
    """The block of what is left to be met once the pairs without unknowns are decided."""
    cases = []
    for static, chain in found:
        positions = rows_of(static, table) if table is not None else None
        work.reads.everything |= any(pair.known for pair in chain)
        refuse_contradictions(kind, chain, table, positions, work.tables, span, work.uncertain)
        components = tuple(pair.component for pair in chain if not pair.known)
        if components:
            cases.append(EquationCase(static=static, equations=(_demand(kind, components, span),)))
    if not cases:
        return None
    return Block(
        name=name,
        role=BlockRole.CONSTRAINT,
        table=table.name if table is not None else None,
        cases=tuple(cases),
        when=None,
        unknown_factor=False,
        distinct=distinct,
        constraint=kind,
        span=span,
    )


def _demand(kind: ConstraintKind, components: tuple[Expression, ...], span: Span) -> Equation:
    return Equation(
        components=components,
        noise_kind=NoiseKind.SIGMA,
        noise=(),
        measured=None,
        relation=Relation.ZERO if kind is ConstraintKind.EQUAL else Relation.NOT_ABOVE_ZERO,
        span=span,
    )


def prior_equation(work: Workspace, name: str, forms: tuple[Form, ...], scope: Scope, span: Span) -> Equation:
    """``(normal FORM mean sigma)`` or another distribution as residuals FORM − mean, with its standard deviation.

    Scalar parameters hold for all elements of FORM.
    """
    if not forms:
        raise MbmError(language_faults.bad_form(span, f"`{name}` is about no form", USAGES[name]))
    value = work.evaluator.wanted(forms[0], scope)
    if isinstance(value, RotationValue | PoseValue):
        if name != "normal" or len(forms) != 3:
            message = "priors on rotations and poses are `normal`, with a mean and a sigma"
            raise MbmError(language_faults.bad_form(span, message, USAGES["normal"]))
        return _normal_of_pose(work, value, forms, scope, span)
    shape = value.shape if isinstance(value, Array) else ()
    elements = shaped(value, shape, forms[0].span)
    mean, sigma = moments(work, name, forms[1:], shape, scope, span)
    work.refuse_unknowns(sigma, forms[-1].span, f"the {'sigma' if name == 'normal' else 'width'} of `{name}`")
    return Equation(
        components=tuple(difference(a, b, span) for a, b in zip(elements, mean, strict=True)),
        noise_kind=NoiseKind.SIGMA,
        noise=sigma,
        measured=data_only(mean),
        law=law_of(work, name, forms[1:], scope),
        span=span,
    )


def _normal_of_pose(
    work: Workspace, value: RotationValue | PoseValue, forms: tuple[Form, ...], scope: Scope, span: Span
) -> Equation:
    """``normal`` of a rotation, pose or similarity: sigma is a number, or one for each tangent coordinate."""
    found = geometric_difference(work.evaluator.wanted(forms[1], scope), value, span) or ()
    sigma = shaped(work.evaluator.wanted(forms[2], scope), (len(found),), forms[2].span)
    work.refuse_unknowns(sigma, forms[2].span, "the sigma of `normal`")
    return Equation(components=found, noise_kind=NoiseKind.SIGMA, noise=sigma, measured=None, placed=True, span=span)


def _name(form: Form | None, bound: _Bound, taken: TakenNames) -> str:
    if isinstance(form, Symbol):
        base = form.name
    elif form is not None and hasattr(form, "value"):
        base = str(form.value)
    elif bound.form.head in DISTRIBUTIONS:
        base = " ".join(item.span.text for item in bound.form.items[:2])
    else:
        base = print_beginning(bound.form, _LONGEST_NAME)
    base += "".join(f" {name}={value}" for name, value in bound.variables)
    return taken.free(base, bound.form.span)


def model_constraints(work: Workspace, log: ModelLog, taken: TakenNames) -> list[Block]:
    """The constraints of the models that the problem uses, once for every distinct model with its arguments."""
    for form in tuple(log.quoted):
        with work.collecting():
            work.evaluator.wanted(form, work.scope)
    found: list[Block | None] = []
    for call in calls_with_constraints(Shape(content=c, span=c.span) for c in log.calls):
        for constraint in call.constraints:
            with work.collecting():
                found.append(_counted(work, _of_model(work, call, constraint, taken)))
    return [block for block in found if block is not None]


def _of_model(work: Workspace, call: ModelCall, constraint: ModelConstraint, taken: TakenNames) -> Block | None:
    """A constraint of a model, with the model's arguments in place; it holds for each row that these come from."""
    kind = _RELATIONS.get(constraint.kind)
    span = constraint.span
    if kind is not None:
        chain = pairs(kind, [work.evaluator.wanted(f, constraint.scope) for f in constraint.forms], span)
        rows = _row_columns(tuple(node for pair in chain for node in (pair.left, pair.right)))
        name = taken.free(f"{call.name} {' '.join(span.text.split())}", span)
        table = _one_table(work, call, constraint, rows)
        return _constraint(work, name, kind, table, [((), chain)], span, _columns(rows))
    equation = prior_equation(work, constraint.kind, constraint.forms, constraint.scope, span)
    rows = _row_columns((*equation.components, *equation.noise))
    table = _one_table(work, call, constraint, rows)
    return Block(
        name=taken.free(f"{call.name} normal {constraint.forms[0].span.text}", span),
        role=BlockRole.PRIOR,
        table=table.name if table is not None else None,
        cases=(EquationCase(static=(), equations=(equation,)),),
        when=None,
        unknown_factor=False,
        distinct=_columns(rows),
        span=span,
    )


def _one_table(
    work: Workspace, call: ModelCall, constraint: ModelConstraint, rows: list[tuple[str, str]]
) -> Table | None:
    """The table whose rows the columns are read from; None where there are no columns."""
    tables = tuple(dict.fromkeys(table for table, _ in rows))
    if len(tables) > 1:
        raise MbmError(faults.two_tables(constraint.span, call.name, tables))
    return work.tables[tables[0]] if tables else None


def _columns(rows: list[tuple[str, str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(column for _, column in rows))


def _row_columns(nodes: tuple[Expression, ...]) -> list[tuple[str, str]]:
    """The columns, and the key columns of family members, that nodes read from the row at hand."""
    found: list[tuple[str, str]] = []
    for leaf in leaves(nodes):
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH:
            found.append((leaf.table, leaf.name))
        member = leaf.member if isinstance(leaf, Component) else None
        if isinstance(member, ColumnMember) and member.row is RowChoice.EACH:
            found.append((member.table, member.column))
    return found
