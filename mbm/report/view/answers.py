"""One solve of a problem as pictures need it: the answer, and which equations compare images."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mbm.estimation.batches.types import Block
from mbm.estimation.intervals.network import Enclosure
from mbm.estimation.run import Solutions
from mbm.estimation.search.solution import Alone, Failure, Skipped, Solution
from mbm.problem.types import Problem
from mbm.report.from_solution import solve_report
from mbm.report.types import Result, SolveReport
from mbm.report.view import faults
from mbm.report.view.seeings import Seen
from mbm.text.types import MbmError
from mbm.values import dataclass

Part = Solution | Enclosure | Failure | Skipped | Alone | Block


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Viewed:
    """A solve of ``count``, and what is ``seen`` in the problem."""

    problem: Problem
    solution: Solution
    seen: Seen
    count: int
    report: SolveReport


@np.errstate(all="ignore")  # overflow and NaN are results here, as in `mbm.report.run.result_of`
def view_of(problem: Problem, made: Solutions, number: int, seen: Seen) -> Viewed:
    """Solve ``number`` (from 1) of those that are made.

    Raises:
        MbmError: there is no such solve, or nothing was solved in it.

    """
    solution = solve_number(made.parts, number, made.count)
    report = solve_report(problem, solution, covariance_full=False)
    return Viewed(problem=problem, solution=solution, seen=seen, count=made.count, report=report)


def view_of_result(result: Result) -> Viewed:
    """The first solve of a result.

    Raises:
        MbmError: nothing-to-draw, nothing was solved in it.

    """
    first = result.solves[0] if result.solves else None
    if first is None or first.made_from is None or result.seen is None:
        reason = "no solve was made" if first is None else first.message
        raise MbmError(faults.nothing_to_draw(reason, "look at the diagnostics of the solve"))
    problem, solution = first.made_from()
    return Viewed(problem=problem, solution=solution, seen=result.seen(), count=len(result.solves), report=first)


def solve_number(parts: Iterable[Part], number: int, count: int) -> Solution:
    """Solve ``number`` (from 1) of ``count``.

    Raises:
        MbmError: there is no such solve, or nothing was solved in it: the reason.

    """
    if not 1 <= number <= count:
        raise MbmError(faults.no_such_solve(number, count))
    done = 0
    for part in parts:
        found: Solution | Failure | Skipped | None = None
        if isinstance(part, Alone):
            found = part.solution if part.place == number - 1 else None
        elif isinstance(part, Solution | Failure | Skipped):
            found = part if done == number - 1 else None
            done += 1
        elif isinstance(part, Enclosure):
            raise MbmError(faults.nothing_to_draw("interval methods give bounds, and no values", "choose a `--method`"))
        elif number - 1 in part.which:
            found = part.solution(number - 1)
        if isinstance(found, Solution):
            return found
        if isinstance(found, Failure):
            raise MbmError(*found.diagnostics)
        if found is not None:
            break
    raise MbmError(faults.nothing_to_draw(f"solve {number} was skipped", "choose another by `--solve`"))
