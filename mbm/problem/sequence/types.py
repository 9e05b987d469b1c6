"""What ``states``, ``dynamics`` and the methods of ``solve`` for sequences say, as values (LANGUAGE §8, §11)."""

from __future__ import annotations

from enum import StrEnum

from mbm.expression.nodes import Expression
from mbm.text.types import Span
from mbm.values import dataclass

PREVIOUS = "(previous)"
"""The column of the table of transitions that holds the key of the step before."""

INTERVAL = "(dt)"
"""The column of the table of transitions that holds the difference of the two keys."""

RATE = ".rate"
"""What the name of a rate ends with; the state's name stands before it."""


class SequenceMethod(StrEnum):
    """How a sequence is estimated; the value is the name in ``:method``."""

    BATCH = "batch"
    EKF = "ekf"
    ITERATED = "iterated-ekf"
    TRUNCATED = "truncated-ekf"
    SMOOTHER = "smoother"


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimator:
    """The method that the problem asks for.

    ``skip``: a cut farther away than so many standard deviations is left out. ``iterated``: updates before cuts are.
    ``lag``: the smoother's steps (None: all). ``hypotheses``: how many are kept at most. ``cuts``: inequalities cut the
    distribution of a filter, whatever its name. ``purpose`` and ``instead``: what it is for, where that is no solve,
    and what to do where it does not take something, as messages have it.
    """

    method: SequenceMethod = SequenceMethod.BATCH
    skip: float = 3.0
    iterated: bool = False
    lag: int | None = None
    hypotheses: int = 1
    cuts: bool = False
    purpose: str = ""
    instead: str = "use `:method batch`"
    span: Span | None = None

    @property
    def called(self) -> str:
        """As messages name it."""
        stated = self.method.value if self.lag is None else f"({self.method.value} :lag {self.lag})"
        return self.purpose or f"`{stated}`"

    @property
    def whole(self) -> bool:
        """Whether a state is given all rows: by ``batch``, and the smoother of all steps."""
        smoother = self.method is SequenceMethod.SMOOTHER and self.lag is None
        return smoother or self.method is SequenceMethod.BATCH


class TransitionKind(StrEnum):
    """How a transition is written; the value is its head in ``dynamics``."""

    STATIC = "static"
    RANDOM_WALK = "random-walk"
    CONSTANT_VELOCITY = "constant-velocity"
    EQUATION = "="


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """A state: the unknown of the same name, whose family goes over the table of steps.

    ``rate_of`` is the state whose rate it is. ``prior`` is the name of the block (role PRIOR, without a table) with
    what is known of it at the first step: its rows mention the members of the first step alone, its mean is the
    unknown's ``start`` there, its covariance may be singular; None where nothing is known. ``certain`` has a truth for
    each tangent coordinate (empty: none is true): those with ``:sigma 0``, which the prior leaves out and the unknown's
    ``fixed`` holds at the first step.
    """

    name: str
    rate_of: str | None = None
    prior: str | None = None
    certain: tuple[bool, ...] = ()
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """How ``states`` get from one step to the next: one state, with ``constant-velocity`` the state and its rate.

    ``block`` names the block (role TRANSITION, over the table of transitions) whose rows are MODEL ⊖ NEXT: members
    picked by the column `PREVIOUS` belong to the step before, those picked by the key to the step reached. Its noise is
    a standard deviation, or a covariance that may be singular. ``exact`` names the block (role CONSTRAINT, over the
    same table) of those components whose ``:sigma`` is 0. Together they have as many rows for each step as the states
    have tangent coordinates. Neither: the states do not change (``static``).
    ``scale`` is the form behind ``:sigma`` or ``:acceleration``, one number for each tangent coordinate; ``velocity``
    has those behind ``:velocity`` and ``:velocity-sigma``.
    """

    kind: TransitionKind
    states: tuple[str, ...]
    block: str | None
    exact: str | None = None
    scale: tuple[Expression, ...] = ()
    velocity: tuple[Expression, ...] = ()
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequence:
    """The states of a problem and their steps.

    Steps are the sorted distinct values of ``column`` over all tables that have it (``sources``: table, column).
    ``steps`` names the table made of them, one row for each step, with the key ``column``. ``reached`` names the table
    made of the transitions, one row for each step but the first: ``column`` (the key of the step reached), `PREVIOUS`,
    `INTERVAL`, and the columns ``joined`` (table, column) of the rows that other tables have at the step reached, each
    called ``table.column``. Rows of other tables belong to the step that their own ``column`` names; where an equation
    mentions a state, the member is picked by that column. ``states`` hold rates too, in the order of the unknowns;
    unknowns of the problem that are no states are constant over the sequence. Every state is in one transition.
    ``divided``: ``for-each`` or ``window`` make several sequences of the rows, each with steps of its own.
    """

    column: str
    steps: str
    reached: str
    sources: tuple[tuple[str, str], ...]
    states: tuple[State, ...]
    transitions: tuple[Transition, ...] = ()
    joined: tuple[tuple[str, str], ...] = ()
    estimator: Estimator = Estimator()
    divided: bool = False
    span: Span

    @property
    def names(self) -> frozenset[str]:
        """The names of the states."""
        return frozenset(state.name for state in self.states)

    @property
    def static(self) -> frozenset[str]:
        """The states that do not change."""
        still = (t for t in self.transitions if t.kind is TransitionKind.STATIC)
        return frozenset(name for transition in still for name in transition.states)
