"""Where a solve begins that has no start: at the best of the minima that the ranges lead to."""

from __future__ import annotations

from math import inf

from mbm.machine.words import Integer, Reals
from mbm.solver.batch import go_on, start_solve
from mbm.solver.decisions import takes_over
from mbm.solver.description import Problem
from mbm.solver.equations import load_rows
from mbm.solver.linear_algebra import copied
from mbm.solver.range_form import cost_of_place, find_places
from mbm.solver.workspace import RangeForm, Work


def begin_at_ranges(problem: Problem, start: Reals, form: RangeForm, work: Work) -> Integer:
    """Put the best minimum that places of the ranges lead to into ``start`` (numbers,); 0 where there is none.

    Of equal ones it is the first, as in single solves.
    """
    load_rows(problem, work.rows)
    least = inf
    rounding = 0.0
    for k in range(find_places(problem, start, form, work)):
        if cost_of_place(problem, k, start, form, work) < inf:
            start_solve(problem, work.rows.data, 1, form.point, work)
            go_on(problem, problem.iterations + 1, work)
            if takes_over(least, work.here.cost, rounding) == 1:
                least = work.here.cost
                rounding = work.here.rounding
                copied(problem.numbers, work.here.point, form.other)
    if least < inf:
        copied(problem.numbers, form.other, start)
        return 1
    return 0
