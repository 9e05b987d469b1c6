"""What closed forms are given and answer: candidates, plans, and the interface that plug-ins keep."""

from __future__ import annotations

from dataclasses import field
from typing import Any, Protocol

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.situation import Candidate, Situation
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A closed form that fits some unknowns: the rows that it uses, and what it found out about them.

    ``minimal`` rows determine the unknowns up to a few solutions. ``data`` is the form's own, with one entry for each
    of ``rows``; members of a family share the plan, and each has its own rows (``rows.member``).
    """

    form: ClosedForm
    candidate: Candidate
    rows: Rows
    minimal: int
    data: Any = field(repr=False)

    @property
    def description(self) -> str:
        """For people: the form and what it gives."""
        return f"{self.form.name}: {', '.join(self.candidate.names)}"


class ClosedForm(Protocol):
    """A method that computes unknowns directly where the equations are of its kind."""

    @property
    def name(self) -> str:
        """As in ``(solve :method NAME)`` and in ``mbm explain``."""
        ...

    @property
    def joint(self) -> bool:
        """It solves all members of a candidate together, and may be given members that share numbers.

        ``solve`` then answers for all: shape (T, S, K·s), member by member.
        """
        ...

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """How to compute the candidate's numbers, or None if its equations are of another kind."""
        ...

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """The numbers that follow from each of T subsets of k rows of the plan, with up to S solutions each.

        ``subsets`` (T, k) indexes the plan's rows, k ≥ ``minimal``; rows of one subset belong to one member. The answer
        has shape (T, S, s), s as ``candidate.places`` has it; NaN where there is no solution.
        """
        ...
