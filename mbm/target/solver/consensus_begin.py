"""What consensus has before its first trial: the rows, their units, and a start where these determine the unknowns."""

from __future__ import annotations

from math import inf

from mbm.target.decisions import ATTEMPTS, FAR
from mbm.target.solver.consensus_description import SPHERES, Bench, Rules, share_out_bench
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_judge import empty_lists
from mbm.target.solver.consensus_order import median
from mbm.target.solver.consensus_planes import one_sided
from mbm.target.solver.consensus_rows import linearised, squares_at
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_trials import begin_trials, seldom_in_vain, size_of_subsets
from mbm.target.solver.consensus_units import judge_rounding, list_units, norm_directions
from mbm.target.solver.description import Problem
from mbm.target.solver.equations import load_rows
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantReals, Integer, Real


def units_of_form(rules: Rules) -> Integer:
    """How many units the closed form takes."""
    if rules.form == SPHERES:
        return rules.about[0] + rules.about[1]
    return 3


def begin_anywhere(system: Problem, bench: Bench) -> Integer:
    """The first point that units one behind the other give in closed form as the start in the bench; 0 if none do."""
    begun = bench.begun
    target = begun[bench.rules.starts * system.numbers :]
    size = units_of_form(bench.rules)
    for one in range(bench.units.count - size + 1):
        for k in range(size):
            bench.chosen[k] = one + k
        if points_in_closed_form(system, size, begun, bench, target) > 0:
            copied(system.numbers, target, begun)
            return 1
    return 0


def size_where_told(system: Problem, bench: Bench) -> Integer:
    """The rows linearised at the start in the bench, and the size of subsets there; 0: units leave unknowns open."""
    linearised(system, bench.rows, bench.begun, bench.here.chunk)
    if bench.rules.kind == GNC:
        return system.n
    norm_directions(system, bench)
    return size_of_subsets(system, bench)


def median_misfit(system: Problem, point: ConstantReals, bench: Bench) -> Real:
    """The median of the units' squared misfits at a point; infinite where most have no value."""
    squares = bench.here.squares
    squares_at(system, point, bench, squares)
    return median(bench.units.count, squares)


def begun_where_most_fit(below: Real, system: Problem, bench: Bench) -> None:
    """The start in the bench becomes what units one behind the other give with the least median of squared misfits.

    Of at most `ATTEMPTS` such, if its median is less than ``below`` and all units determine the unknowns there.
    """
    numbers = system.numbers
    begun = bench.begun
    best = bench.kept
    found = begun[bench.rules.starts * numbers :]
    size = units_of_form(bench.rules)
    copied(numbers, begun, best)
    attempts = bench.units.count - size + 1
    if attempts > ATTEMPTS:
        attempts = ATTEMPTS
    for one in range(attempts):
        for k in range(size):
            bench.chosen[k] = one + k
        count = points_in_closed_form(system, size, bench.starts, bench, found)
        for k in range(count):
            own = found[k * numbers :]
            misfit = median_misfit(system, own, bench)
            if misfit < below:
                copied(numbers, own, begun)
                if size_where_told(system, bench) > 0:
                    below = misfit
                    copied(numbers, own, best)
    copied(numbers, best, begun)


def begun_where_units_tell(system: Problem, bench: Bench) -> Integer:
    """The start in the bench, linearised, and the size of subsets there; 0: all units do not determine the unknowns.

    Where a closed form gives the start, one of the units that it is made of may be grossly wrong. Far off the others
    say nearly the same, so that trials would hardly ever be made of them alone: where a tenth of the subsets that
    are drawn leaves unknowns open there, the start is what fits most units, if it does `FAR`² times better.
    """
    rules = bench.rules
    copied(rules.starts * system.numbers, bench.starts, bench.begun)
    if rules.startless == 1 and begin_anywhere(system, bench) == 0:
        return 0
    size = size_where_told(system, bench)
    if rules.startless == 0 or rules.kind == GNC:
        return size
    below = inf
    if size > 0:
        if seldom_in_vain(system, bench) == 1:
            return size
        below = median_misfit(system, bench.begun, bench) / (FAR * FAR)
    begun_where_most_fit(below, system, bench)
    return size_where_told(system, bench)


def begin_agreement(system: Problem, bench: Bench) -> None:
    """What there is before the first trial: the rows, their units, where to start."""
    verdict = bench.verdict
    verdict.agreed = 0
    verdict.trials = 0
    verdict.ambiguous = 0
    verdict.inliers = 0
    if bench.shared == 0:
        share_out_bench(bench)
    load_rows(system, bench.rows)
    list_units(system, bench)
    bench.one_side = one_sided(bench.rules, bench.units.count, bench.forms, bench.form_scratch)
    bench.size = begun_where_units_tell(system, bench)
    bench.trials_wanted = 0
    bench.trials_made = 0
    bench.points_made = 0
    if bench.size > 0:
        judge_rounding(system, bench.begun, bench)
        empty_lists(bench)
        if bench.rules.kind != GNC:
            begin_trials(bench)
