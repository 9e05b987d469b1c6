"""Subsets fitted in closed form: spheres about known stations, sights of known points.

What the form knows of a unit (``Rules.form_width`` numbers, NaN where it knows nothing) is: of spheres the station
(d), the length, what is added to the squared distance, and the slope of the offset; of sights the point (3) and the
unit bearing (3).
"""

from __future__ import annotations

from math import atan2, fabs, isfinite, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals
from mbm.solver.consensus_records import AS_EULER_ANGLES, AS_QUATERNION, SPHERES, ConsensusWork
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied
from mbm.solver.manifolds import quaternion_of_matrix
from mbm.solver.minimal_pose import poses_from_three
from mbm.solver.minimal_spheres import places_from_spheres

LOCKED = 1e-12
"""Cosine of the middle Euler angle below which only a sum of the others is determined; the first is 0 then."""


def put_rotation(kind: Integer, R: ConstantReals, table: ConstantIntegers, quaternion: Reals, point: Reals) -> None:
    """A rotation matrix (9,) as the numbers that the unknowns hold: at the places of the table."""
    if kind == AS_EULER_ANGLES:
        level = sqrt(R[0] * R[0] + R[3] * R[3])
        point[table[1]] = atan2(-R[6], level)
        if level < LOCKED:
            point[table[0]] = 0.0
            point[table[2]] = atan2(-R[1], R[4])
        else:
            point[table[0]] = atan2(R[7], R[8])
            point[table[2]] = atan2(R[3], R[0])
    else:
        quaternion_of_matrix(R, quaternion)
        if kind == AS_QUATERNION:
            for i in range(4):
                point[table[i]] = quaternion[i]
        else:
            square = 0.0
            for i in range(1, 4):
                square += quaternion[i] * quaternion[i]
            sine = sqrt(square)
            factor = 2.0 * atan2(sine, quaternion[0]) / sine if sine > 1e-150 else 2.0
            for i in range(3):
                point[table[i]] = factor * quaternion[1 + i]


def put_motion(
    inverse: Integer, kind: Integer, pose: Reals, table: ConstantIntegers, quaternion: Reals, point: Reals
) -> None:
    """A motion (R row by row, then t) as numbers of the point; ``pose`` is inverted where that is what they hold."""
    if inverse == 1:
        for i in range(3):
            for j in range(i):
                kept = pose[3 * i + j]
                pose[3 * i + j] = pose[3 * j + i]
                pose[3 * j + i] = kept
        x = pose[9]
        y = pose[10]
        z = pose[11]
        for i in range(3):
            pose[9 + i] = -(pose[3 * i] * x + pose[3 * i + 1] * y + pose[3 * i + 2] * z)
    put_rotation(kind, pose, table, quaternion, point)
    first = 4 if kind == AS_QUATERNION else 3
    for i in range(3):
        point[table[first + i]] = pose[9 + i]


def points_in_closed_form(
    problem: Problem, count: Integer, base: ConstantReals, work: ConsensusWork, target: Reals
) -> Integer:
    """How many points (up to 4, N) fit the chosen units (count,) in closed form, other numbers being those of base."""
    wide = work.rules.form_width
    about = work.rules.about
    forms = work.forms
    chosen = work.chosen
    numbers = problem.numbers
    scratch = work.form_scratch
    for k in range(count):
        for i in range(wide):
            if not isfinite(forms[chosen[k] * wide + i]):
                return 0
    found = 0
    if work.rules.form == SPHERES:
        m = about[0] + about[1]
        if count != m:
            return 0
        for k in range(m):
            copied(wide, forms[chosen[k] * wide :], scratch[48 + k * wide :])
        order = work.form_order
        found = places_from_spheres(about[0], about[1], about[2], scratch[48:], scratch, order, scratch[96:])
        for k in range(found):
            copied(numbers, base, target[k * numbers :])
            for i in range(m):
                target[k * numbers + about[3 + i]] = scratch[k * m + i]
        if work.one_side == 1 and found == 2:
            found = 1
            first = 0.0
            second = 0.0
            for i in range(m):
                start = base[about[3 + i]]
                first += (scratch[i] - start) * (scratch[i] - start)
                second += (scratch[m + i] - start) * (scratch[m + i] - start)
            if not fabs(second - first) > 1e-9 * (first + second):  # no start, or one in the plane but for rounding
                first = 0.0
                second = 0.0
                for i in range(m):
                    first += scratch[i]
                    second += scratch[m + i]
            if second < first:
                copied(numbers, target[numbers:], target)
        return found
    if count != 3:
        return 0
    for k in range(3):
        copied(3, forms[chosen[k] * wide :], scratch[48 + 3 * k :])
        copied(3, forms[chosen[k] * wide + 3 :], scratch[57 + 3 * k :])
    found = poses_from_three(scratch[48:], scratch[57:], scratch, scratch[96:])
    for k in range(found):
        copied(numbers, base, target[k * numbers :])
        put_motion(about[0], about[1], scratch[12 * k :], about[2:], scratch[66:], target[k * numbers :])
    return found
