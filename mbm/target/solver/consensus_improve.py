"""The best of the trials, improved by fits to the units that they explain; the best of those."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import CANDIDATES, REFINING_STEPS, SAME_OBJECTIVE, STATED, STILL, WIDE_STEPS
from mbm.target.solver.consensus_description import (
    BY_MEDIAN,
    BY_RULE,
    BY_WIDE_LIMITS,
    NO_CANDIDATE,
    Bench,
)
from mbm.target.solver.consensus_judge import judge_trials, limit_by_noise
from mbm.target.solver.consensus_order import robust_variance
from mbm.target.solver.consensus_refine import NEARLY_STILL, refined
from mbm.target.solver.consensus_rows import linearised, squares_at
from mbm.target.solver.consensus_rules import TRIMMED, TRUNCATED
from mbm.target.solver.consensus_scores import LMEDS
from mbm.target.solver.description import Problem
from mbm.target.solver.linear_algebra import copied, filled
from mbm.target.words import ConstantReals, Integer


def put_candidate(number: Integer, system: Problem, bench: Bench) -> None:
    """The point where the fit is, and its squares, as a candidate with the objective."""
    units = bench.units.count
    bench.objectives[number] = bench.objective
    copied(system.numbers, bench.here.point, bench.candidates[number * system.numbers :])
    copied(units, bench.here.squares, bench.candidate_squares[number * units :])


def merged_lists(target: Integer, other: Integer, bench: Bench) -> None:
    """What one list of the best has more than another, put behind that one's, up to `CANDIDATES` of each."""
    mine = bench.best[target * CANDIDATES :]
    theirs = bench.best[other * CANDIDATES :]
    found = bench.listed[target]
    kept = found
    for k in range(bench.listed[other]):
        new = 1
        for i in range(found):
            if mine[i] == theirs[k]:
                new = 0
        if new == 1:
            mine[kept] = theirs[k]
            kept += 1
    bench.listed[target] = kept


def scored_candidates(judged_before: Integer, count: Integer, system: Problem, bench: Bench) -> Integer:
    """The best of the trials by the rule's score, and with wide limits, and by the least median if noise is unknown.

    How many there are in the list by the rule. So many trials have been judged before.
    """
    units = bench.units
    rules = bench.rules
    if count <= CANDIDATES:
        for k in range(count):
            bench.best[k] = k
        return count
    copied(units.count, units.cuts, units.limits)
    kind = rules.kind
    if rules.groups > 0:
        judge_trials(LMEDS, 0, count, system, bench)
        if kind != LMEDS and bench.listed[BY_MEDIAN] > 0:
            limit_by_noise(system, bench.trials[bench.best[BY_MEDIAN * CANDIDATES] * system.numbers :], bench)
        judged_before = 0
    if kind == LMEDS:
        if rules.groups == 0:
            judge_trials(kind, judged_before, count, system, bench)
        merged_lists(BY_RULE, BY_MEDIAN, bench)
    else:
        judge_trials(kind, judged_before, count, system, bench)
        merged_lists(BY_RULE, BY_WIDE_LIMITS, bench)
        # The rule needs the noise; where that is unknown, trials with the least median may be the ones that know it.
        merged_lists(BY_RULE, BY_MEDIAN, bench)
    return bench.listed[BY_RULE]


def widen_for_point(system: Problem, bench: Bench) -> Integer:
    """Limits as wide as the units scatter about the point; 0 where they are no wider than they were."""
    units = bench.units
    here = bench.here
    squares_at(system, here.point, bench, here.squares)
    own = robust_variance(units, system.n, here.squares, STATED, bench.sorted)
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * max(own, 1.0)
    return own > 1.0


def improve_one(wide: Integer, found: Integer, system: Problem, bench: Bench) -> Integer:
    """Candidates with what the point leads to: how many, ``found`` of them before; ``wide`` 1: in two stages."""
    units = bench.units
    rule = TRIMMED if bench.rules.groups > 0 else TRUNCATED
    if wide == 1:
        if widen_for_point(system, bench) == 0:
            return found  # this way has been gone
        refined(rule, WIDE_STEPS, NEARLY_STILL, 0, system, bench)
    copied(units.count, units.cuts, units.limits)
    alike = refined(rule, REFINING_STEPS, STILL, found, system, bench)
    if alike == NO_CANDIDATE and isfinite(bench.objective):
        put_candidate(found, system, bench)
        return found + 1
    return found


def improve(count: Integer, system: Problem, bench: Bench) -> Integer:
    """Candidates after fits to the units that they explain, no end twice: how many; ``count`` trials are improved."""
    filled(system.n, 1.0, bench.scale)
    filled(bench.units.count, 1.0, bench.units.variances)
    found = 0
    for way in range(2):
        for k in range(count):
            copied(system.numbers, bench.trials[bench.best[k] * system.numbers :], bench.here.point)
            found = improve_one(way, found, system, bench)
        if bench.rules.groups > 0:
            break
    return found


def best_candidate(count: Integer, start: ConstantReals, system: Problem, bench: Bench) -> Integer:
    """The candidate with the lowest objective; of equals (mirrored ones, say) the nearest to the start (N,)."""
    n = system.n
    chunk = bench.here.chunk
    scale = bench.scale
    objectives = bench.objectives
    rows = linearised(system, bench.rows, start, chunk)
    for j in range(n):
        total = 0.0
        for i in range(rows):
            slope = chunk[j * system.chunk + i]
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
            own = bench.candidates[k * system.numbers :]
            away = 0.0
            for j in range(n):
                place = system.number_of[j]
                if place >= 0:
                    difference = (own[place] - start[place]) * scale[j]
                    away += difference * difference
            if nearest < 0.0 or away < nearest:
                nearest = away
                best = k
    return best
