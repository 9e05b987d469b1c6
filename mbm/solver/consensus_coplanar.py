"""Whether the stations of spheres lie in one plane, so that places on both sides of it fit all of them alike."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.consensus_records import SPHERES, Rules
from mbm.solver.decisions import MIRRORED

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
    for i in range(MOMENTS):
        moments[i] = 0.0
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
                for i in range(d):
                    moments[i] += forms[u * width + i]
            if good == 1 and again == 1:
                for i in range(d):
                    for j in range(d):
                        away = forms[u * width + i] - moments[i]
                        matrix[i * d + j] += away * (forms[u * width + j] - moments[j])
        if known == 0:
            return 0
        if again == 0:
            for i in range(d):
                moments[i] = moments[i] / float(known)
    return smallest_share(d, matrix) <= MIRRORED * MIRRORED
