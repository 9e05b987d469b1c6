"""What consensus has before its first trial: the rows, their units, and a start where these determine the unknowns.

Lines of sight behind a lens that distorts: found from near ones, by Newton's method on the equations themselves.

A camera stands still, and a point is put before it so that the equation of its image holds: its direction is the line
of sight. Slopes are difference quotients, which leaves the root as it is and the last steps as short as rounding.

Whether the stations of spheres lie in one plane, so that places on both sides of it fit all of them alike.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_kernel
from mbm.solver.consensus_constraints import begin_on_constraints, put_on_constraints
from mbm.solver.consensus_forms import points_in_closed_form, put_motion
from mbm.solver.consensus_records import NOWHERE, SPHERES, ConsensusWork, Rules, share_out_consensus
from mbm.solver.consensus_scores import GNC, median
from mbm.solver.consensus_trials import begin_trials, empty_lists, seldom_in_vain, size_of_subsets
from mbm.solver.consensus_units import linearised, list_units, norm_directions, set_rounding, squares_at
from mbm.solver.decisions import ATTEMPTS, FAR, MIRRORED, STATED
from mbm.solver.description import Problem
from mbm.solver.equations import load_rows
from mbm.solver.linear_algebra import add_multiple, copied, dot, filled, multiplied


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
    linearised(problem, work.rows, work.begun, work, work.here.chunk)
    work.rank = work.left
    if work.rules.kind == GNC or work.rules.near == 1:
        return work.left
    norm_directions(problem, work)
    return size_of_subsets(problem, work)


def size_where_told(problem: Problem, work: ConsensusWork) -> Integer:
    """The same; 0 where units leave unknowns open."""
    size = size_there(problem, work)
    return size if work.rank == work.left else 0


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
            put_on_constraints(problem, own, work)
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
    begin_on_constraints(problem, work)
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


def told_alike(work: ConsensusWork) -> Integer:
    """Whether all rows have one noise: then all unknowns are told by its inliers, whose redundancy is known."""
    if work.rules.groups == 0:
        return 1
    units = work.units
    for u in range(units.count):
        if units.group[u] != 0:
            return 0
    return work.rows.data.count == units.scalars


def set_subsets(problem: Problem, work: ConsensusWork) -> None:
    """The size of the subsets of each group of noise, by the rows linearised where consensus begins."""
    units = work.units
    for u in range(units.count):
        units.subset[u] = work.size
    if work.alike == 1:
        return
    for group in range(STATED, work.rules.groups):
        touched = 0
        for j in range(problem.n):
            touches = 0
            for u in range(units.count):
                if units.group[u] == group:
                    for i in range(units.components[u]):
                        if work.here.chunk[j * problem.chunk + units.place[u] + i * LANES] != 0.0:
                            touches = 1
            touched += touches
        for u in range(units.count):
            if units.group[u] == group and touched < work.size:
                units.subset[u] = touched


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
    work.alike = told_alike(work)
    work.spent = work.left if work.alike == 1 else work.rank
    work.trials_wanted = 0
    work.trials_made = 0
    work.points_made = 0
    if work.size != NOWHERE:
        set_subsets(problem, work)
        set_rounding(problem, work.begun, work)
        empty_lists(work)
        if work.rules.kind != GNC and work.rules.near == 0:
            begin_trials(work)


STEPS = 30
"""Steps of Newton's method; from near ones it takes five."""

QUOTIENT_STEP = 1e-6
"""By which a slope is taken, beside a direction whose largest component is 1. Rounding and curvature make a millionth
of the slope wrong, so that each step leaves as much of the error before."""

LAST_STEP = 1e-12
"""Change of the direction from which nothing but rounding is left to gain."""


def image_misfit(problem: Problem, u: Integer, sight: ConstantReals, work: ConsensusWork, target: Reals) -> None:
    """What the equation of unit ``u`` leaves (2,) if its point stands at ``sight`` (3,) before the camera."""
    units = work.units
    rows = work.rows
    about = work.rules.about
    block = problem.blocks[units.block[u]]
    part = rows.data.blocks[units.block[u]]
    row = units.row[u]
    point = work.kept
    pose = work.form_scratch[24:]
    known = work.forms[u * work.rules.form_width :]
    filled(9, 0.0, pose)
    for i in range(3):
        pose[4 * i] = 1.0
        pose[9 + i] = sight[i] - known[i]
    put_motion(about[0], about[1], pose, about[2:], work.form_scratch[36:], point)
    inputs = work.subset_rows.inputs
    outputs = work.subset_rows.outputs
    index = rows.index[part.index + row * block.index :]
    given = rows.parameters[part.parameters + row * block.parameters :]
    for lane in range(LANES):
        for v in range(block.variables):
            inputs[v * LANES + lane] = point[index[v]]
        for p in range(block.parameters):
            inputs[(block.variables + p) * LANES + lane] = given[p]
    call_kernel(block.values, inputs, outputs, 1)
    first = block.units[units.equation[u]].first
    for i in range(2):
        target[i] = outputs[(first + i) * LANES]


def found_sight(problem: Problem, u: Integer, work: ConsensusWork, sight: Reals) -> Integer:
    """The line of sight (3,) of unit ``u`` from one near by, by length as that; 0 where it is not found."""
    misfit = work.form_scratch[4:]
    beside = work.form_scratch[6:]
    slopes = work.form_scratch[8:]
    step = work.form_scratch[12:]
    axis = 0
    for i in range(1, 3):
        if fabs(sight[i]) > fabs(sight[axis]):
            axis = i
    multiplied(3, 1.0 / fabs(sight[axis]), sight)
    for _ in range(STEPS):
        image_misfit(problem, u, sight, work, misfit)
        for k in range(2):
            i = (axis + 1 + k) % 3
            held = sight[i]
            sight[i] = held + QUOTIENT_STEP
            image_misfit(problem, u, sight, work, beside)
            sight[i] = held
            for j in range(2):
                slopes[2 * j + k] = (beside[j] - misfit[j]) / QUOTIENT_STEP
        determinant = slopes[0] * slopes[3] - slopes[1] * slopes[2]
        step[0] = (slopes[1] * misfit[1] - slopes[3] * misfit[0]) / determinant
        step[1] = (slopes[2] * misfit[0] - slopes[0] * misfit[1]) / determinant
        if not isfinite(step[0]) or not isfinite(step[1]):
            return 0
        for k in range(2):
            sight[(axis + 1 + k) % 3] += step[k]
        if max(fabs(step[0]), fabs(step[1])) <= LAST_STEP:
            multiplied(3, 1.0 / sqrt(dot(3, sight, sight)), sight)
            return 1
    return 0


def find_sights(problem: Problem, work: ConsensusWork) -> None:
    """What the form knows of the units, with their own lines of sight; NaN where these are not found."""
    width = work.rules.form_width
    copied(problem.numbers, work.starts, work.kept)
    for u in range(work.units.count):
        own = work.sights[u * width :]
        copied(width, work.forms[u * width :], own)
        if isfinite(own[3]) and found_sight(problem, u, work, own[3:]) == 0:
            own[3] = inf - inf
    work.forms = work.sights


SWEEPS = 12
"""Sweeps of Jacobi's method: for matrices of three rows a few are enough."""

NOTHING = 1e-30
"""Share of the diagonal below which an element beside it is none."""

MOMENTS = 12
"""Reals of scratch for the moments of stations: their sums, then a matrix."""


def smallest_share(d: Integer, matrix: Reals) -> Real:
    """The smallest eigenvalue of a symmetric matrix (d, d) over the largest, by Jacobi's method; 0 if all are 0."""
    for _ in range(SWEEPS):
        for p in range(d):
            for q in range(p + 1, d):
                if fabs(matrix[p * d + q]) > NOTHING * (fabs(matrix[p * d + p]) + fabs(matrix[q * d + q])):
                    turn = (matrix[q * d + q] - matrix[p * d + p]) / (2.0 * matrix[p * d + q])
                    tangent = 1.0 / (fabs(turn) + sqrt(turn * turn + 1.0))
                    if turn < 0.0:
                        tangent = -tangent
                    cosine = 1.0 / sqrt(tangent * tangent + 1.0)
                    sine = tangent * cosine
                    for i in range(d):
                        left = matrix[i * d + p]
                        right = matrix[i * d + q]
                        matrix[i * d + p] = cosine * left - sine * right
                        matrix[i * d + q] = sine * left + cosine * right
                    for i in range(d):
                        left = matrix[p * d + i]
                        right = matrix[q * d + i]
                        matrix[p * d + i] = cosine * left - sine * right
                        matrix[q * d + i] = sine * left + cosine * right
    least = matrix[0]
    largest = matrix[0]
    for i in range(1, d):
        least = min(least, matrix[i * d + i])
        largest = max(largest, matrix[i * d + i])
    return max(least, 0.0) / largest if largest > 0.0 else 0.0


def one_sided(rules: Rules, units: Integer, forms: ConstantReals, moments: Reals) -> Integer:
    """Whether all known stations of spheres lie in one plane (on one line), and there is no offset."""
    if rules.form != SPHERES:
        return 0
    width = rules.form_width
    d = rules.about[0]
    if rules.about[1] != 0:
        return 0
    filled(MOMENTS, 0.0, moments)
    matrix = moments[3:]
    known = 0
    for again in range(2):
        for u in range(units):
            good = 1
            for w in range(width):
                if not isfinite(forms[u * width + w]):
                    good = 0
            if good == 1 and again == 0:
                known += 1
                add_multiple(d, 1.0, forms[u * width :], moments)
            if good == 1 and again == 1:
                for i in range(d):
                    for j in range(d):
                        away = forms[u * width + i] - moments[i]
                        matrix[i * d + j] += away * (forms[u * width + j] - moments[j])
        if known == 0:
            return 0
        if again == 0:
            multiplied(d, 1.0 / float(known), moments)
    return smallest_share(d, matrix) <= MIRRORED * MIRRORED
