"""What consensus has before its first trial: the rows, their units, and a start where these determine the unknowns."""

from __future__ import annotations

from math import inf

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.consensus_coplanar import one_sided
from mbm.solver.consensus_forms import points_in_closed_form
from mbm.solver.consensus_order import median
from mbm.solver.consensus_ranking import empty_lists
from mbm.solver.consensus_records import NOWHERE, SPHERES, ConsensusWork, Rules, share_out_consensus
from mbm.solver.consensus_rows import linearised, squares_at
from mbm.solver.consensus_scores import GNC
from mbm.solver.consensus_sights import find_sights
from mbm.solver.consensus_trials import begin_trials, seldom_in_vain, size_of_subsets
from mbm.solver.consensus_units import list_units, norm_directions, set_rounding
from mbm.solver.decisions import ATTEMPTS, FAR
from mbm.solver.description import Problem
from mbm.solver.equations import load_rows
from mbm.solver.linear_algebra import copied


def units_of_form(rules: Rules) -> Integer:
    """How many units the closed form takes."""
    if rules.form == SPHERES:
        return rules.about[0] + rules.about[1]
    return 3


def begin_anywhere(problem: Problem, work: ConsensusWork) -> Integer:
    """The first point that units one behind the other give in closed form as the start in the work; 0 if none do."""
    begun = work.begun
    target = begun[work.rules.starts * problem.numbers :]
    size = units_of_form(work.rules)
    for one in range(work.units.count - size + 1):
        for k in range(size):
            work.chosen[k] = one + k
        if points_in_closed_form(problem, size, begun, work, target) > 0:
            copied(problem.numbers, target, begun)
            return 1
    return 0


def size_there(problem: Problem, work: ConsensusWork) -> Integer:
    """The rows linearised at the start in the work, and the size of subsets there, with their rank."""
    linearised(problem, work.rows, work.begun, work.here.chunk)
    work.rank = problem.n
    if work.rules.kind == GNC or work.rules.near == 1:
        return problem.n
    norm_directions(problem, work)
    return size_of_subsets(problem, work)


def size_where_told(problem: Problem, work: ConsensusWork) -> Integer:
    """The same; 0 where units leave unknowns open."""
    size = size_there(problem, work)
    return size if work.rank == problem.n else 0


def median_misfit(problem: Problem, point: ConstantReals, work: ConsensusWork) -> Real:
    """The median of the units' squared misfits at a point; infinite where most have no value."""
    squares = work.here.squares
    squares_at(problem, point, work, squares)
    return median(work.units.count, squares)


def begun_where_most_fit(below: Real, problem: Problem, work: ConsensusWork) -> None:
    """The start in the work becomes what units one behind the other give with the least median of squared misfits.

    Of at most `ATTEMPTS` such, if its median is less than ``below`` and all units determine the unknowns there.
    """
    numbers = problem.numbers
    begun = work.begun
    best = work.kept
    found = begun[work.rules.starts * numbers :]
    size = units_of_form(work.rules)
    copied(numbers, begun, best)
    attempts = work.units.count - size + 1
    if attempts > ATTEMPTS:
        attempts = ATTEMPTS
    for one in range(attempts):
        for k in range(size):
            work.chosen[k] = one + k
        count = points_in_closed_form(problem, size, work.starts, work, found)
        for k in range(count):
            own = found[k * numbers :]
            misfit = median_misfit(problem, own, work)
            if misfit < below:
                copied(numbers, own, begun)
                if size_where_told(problem, work) > 0:
                    below = misfit
                    copied(numbers, own, best)
    copied(numbers, best, begun)


def begun_where_units_tell(problem: Problem, work: ConsensusWork) -> Integer:
    """The start in the work, linearised, and the size of subsets there; `NOWHERE`: there is no such start.

    Where a closed form gives the start, one of the units that it is made of may be grossly wrong. Far off the others
    say nearly the same, so that trials would hardly ever be made of them alone: where a tenth of the subsets that
    are drawn leaves unknowns open there, the start is what fits most units, if it does `FAR`² times better.
    """
    rules = work.rules
    copied(rules.starts * problem.numbers, work.starts, work.begun)
    if rules.startless == 1 and begin_anywhere(problem, work) == 0:
        return NOWHERE
    if rules.startless == 0:
        return size_there(problem, work)
    size = size_where_told(problem, work)
    if rules.kind == GNC:
        return size
    below = inf
    if size > 0:
        if seldom_in_vain(problem, work) == 1:
            return size
        below = median_misfit(problem, work.begun, work) / (FAR * FAR)
    begun_where_most_fit(below, problem, work)
    size = size_where_told(problem, work)
    return size if size > 0 else NOWHERE


def begin_consensus(problem: Problem, work: ConsensusWork) -> None:
    """What there is before the first trial: the rows, their units, where to start."""
    verdict = work.verdict
    verdict.agreed = 0
    verdict.trials = 0
    verdict.ambiguous = 0
    verdict.inliers = 0
    if work.shared == 0:
        share_out_consensus(work)
    load_rows(problem, work.rows)
    list_units(problem, work)
    if work.rules.curved == 1:
        find_sights(problem, work)
    work.one_side = one_sided(work.rules, work.units.count, work.forms, work.form_scratch)
    work.size = begun_where_units_tell(problem, work)
    work.trials_wanted = 0
    work.trials_made = 0
    work.points_made = 0
    if work.size != NOWHERE:
        set_rounding(problem, work.begun, work)
        empty_lists(work)
        if work.rules.kind != GNC and work.rules.near == 0:
            begin_trials(work)
