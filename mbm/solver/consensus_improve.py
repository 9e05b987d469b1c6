"""The best of the trials, improved by fits to the units that they explain; the best of those."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer
from mbm.solver.consensus_order import robust_variance
from mbm.solver.consensus_ranking import limit_by_noise, score_trials
from mbm.solver.consensus_records import (
    BY_MEDIAN,
    BY_RULE,
    BY_WIDE_LIMITS,
    NO_CANDIDATE,
    ConsensusWork,
)
from mbm.solver.consensus_refine import NEARLY_STILL, refined
from mbm.solver.consensus_rows import linearised, squares_at
from mbm.solver.consensus_scores import LMEDS
from mbm.solver.consensus_weights import TRIMMED, TRUNCATED
from mbm.solver.decisions import CANDIDATES, REFINING_STEPS, SAME_OBJECTIVE, STATED, STILL, WIDE_STEPS
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied, filled


def put_candidate(number: Integer, problem: Problem, work: ConsensusWork) -> None:
    """The point where the fit is, and its squares, as a candidate with the objective."""
    units = work.units.count
    work.objectives[number] = work.objective
    copied(problem.numbers, work.here.point, work.candidates[number * problem.numbers :])
    copied(units, work.here.squares, work.candidate_squares[number * units :])


def merged_lists(target: Integer, other: Integer, work: ConsensusWork) -> None:
    """What one list of the best has more than another, put behind that one's, up to `CANDIDATES` of each."""
    mine = work.best[target * CANDIDATES :]
    theirs = work.best[other * CANDIDATES :]
    found = work.listed[target]
    kept = found
    for k in range(work.listed[other]):
        new = 1
        for i in range(found):
            if mine[i] == theirs[k]:
                new = 0
        if new == 1:
            mine[kept] = theirs[k]
            kept += 1
    work.listed[target] = kept


def scored_candidates(scored_before: Integer, count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """The best of the trials by the rule's score, and with wide limits, and by the least median if noise is unknown.

    How many there are in the list by the rule. So many trials have been judged before.
    """
    units = work.units
    rules = work.rules
    if count <= CANDIDATES:
        for k in range(count):
            work.best[k] = k
        return count
    copied(units.count, units.cuts, units.limits)
    kind = rules.kind
    if rules.groups > 0:
        score_trials(LMEDS, 0, count, problem, work)
        if kind != LMEDS and work.listed[BY_MEDIAN] > 0:
            limit_by_noise(problem, work.trials[work.best[BY_MEDIAN * CANDIDATES] * problem.numbers :], work)
        scored_before = 0
    if kind == LMEDS:
        if rules.groups == 0:
            score_trials(kind, scored_before, count, problem, work)
        merged_lists(BY_RULE, BY_MEDIAN, work)
    else:
        score_trials(kind, scored_before, count, problem, work)
        merged_lists(BY_RULE, BY_WIDE_LIMITS, work)
        # The rule needs the noise; where that is unknown, trials with the least median may be the ones that know it.
        merged_lists(BY_RULE, BY_MEDIAN, work)
    return work.listed[BY_RULE]


def widen_for_point(problem: Problem, work: ConsensusWork) -> Integer:
    """Limits as wide as the units scatter about the point; 0 where they are no wider than they were."""
    units = work.units
    here = work.here
    squares_at(problem, here.point, work, here.squares)
    own = robust_variance(units, problem.n, here.squares, STATED, work.sorted)
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * max(own, 1.0)
    return own > 1.0


def improve_one(wide: Integer, found: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Candidates with what the point leads to: how many, ``found`` of them before; ``wide`` 1: in two stages."""
    units = work.units
    rule = TRIMMED if work.rules.groups > 0 else TRUNCATED
    if wide == 1:
        if widen_for_point(problem, work) == 0:
            return found  # this way has been gone
        refined(rule, WIDE_STEPS, NEARLY_STILL, 0, problem, work)
    copied(units.count, units.cuts, units.limits)
    alike = refined(rule, REFINING_STEPS, STILL, found, problem, work)
    if alike == NO_CANDIDATE and isfinite(work.objective):
        put_candidate(found, problem, work)
        return found + 1
    return found


def improve(count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Candidates after fits to the units that they explain, no end twice: how many; ``count`` trials are improved."""
    filled(problem.n, 1.0, work.scale)
    filled(work.units.count, 1.0, work.units.variances)
    found = 0
    for way in range(2):
        for k in range(count):
            copied(problem.numbers, work.trials[work.best[k] * problem.numbers :], work.here.point)
            found = improve_one(way, found, problem, work)
        if work.rules.groups > 0:
            break
    return found


def best_candidate(count: Integer, start: ConstantReals, problem: Problem, work: ConsensusWork) -> Integer:
    """The candidate with the lowest objective; of equals (mirrored ones, say) the nearest to the start (N,)."""
    n = problem.n
    chunk = work.here.chunk
    scale = work.scale
    objectives = work.objectives
    rows = linearised(problem, work.rows, start, chunk)
    for j in range(n):
        total = 0.0
        for i in range(rows):
            slope = chunk[j * problem.chunk + i]
            if isfinite(slope):
                total += slope * slope
        scale[j] = sqrt(total)
    lowest = objectives[0]
    for k in range(1, count):
        lowest = min(objectives[k], lowest)
    reach = lowest + SAME_OBJECTIVE * max(fabs(lowest), 1.0)
    best = 0
    nearest = -1.0
    for k in range(count):
        if objectives[k] <= reach:
            own = work.candidates[k * problem.numbers :]
            away = 0.0
            for j in range(n):
                place = problem.number_of[j]
                if place >= 0:
                    difference = (own[place] - start[place]) * scale[j]
                    away += difference * difference
            if nearest < 0.0 or away < nearest:
                nearest = away
                best = k
    return best
