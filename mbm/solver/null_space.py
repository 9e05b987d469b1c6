"""Movements along the surface where constraints hold, by Householder's reflections that turn the constraints away.

The product of the reflections is an orthogonal matrix Q; its columns after the first ``reflected`` span the surface.
A reflection is a vector u with ``|u|² = 2``: it takes v to ``v - (u·v) u``.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals
from mbm.solver.linear_algebra import add_multiple, dot, filled

REPEATED = 1e-12
"""The share of a constraint's slope that those before it leave, below which it says nothing new."""


def reflect_constraints(
    n: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    scale: ConstantReals,
    holding: Integer,
    held: ConstantReals,
    slopes: ConstantReals,
    reflections: Reals,
) -> Integer:
    """The ``reflections`` (reflected, count) for the constraints that hold, and how many there are.

    ``slopes`` (holding, n); of the coordinates those ``chosen`` (count,) may move, each over its ``scale``. A
    constraint holds where ``held`` is not 0.
    """
    reflected = 0
    for c in range(holding):
        if held[c] != 0.0 and reflected < count:
            row = reflections[reflected * count :]
            for k in range(count):
                row[k] = slopes[c * n + chosen[k]] / scale[k]
            length = sqrt(dot(count, row, row))
            for q in range(reflected):
                reflection = reflections[q * count :]
                add_multiple(count, -dot(count, reflection, row), reflection, row)
            filled(reflected, 0.0, row)
            rest = sqrt(dot(count, row, row))
            if rest > REPEATED * length:
                row[reflected] += rest if row[reflected] >= 0.0 else -rest
                factor = sqrt(2.0 / dot(count, row, row))
                for k in range(reflected, count):
                    row[k] *= factor
                reflected += 1
    return reflected


def to_null_space(count: Integer, reflected: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Qᵀ vector``: after the first ``reflected`` numbers its part along the surface."""
    for q in range(reflected):
        reflection = reflections[q * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)


def from_null_space(count: Integer, reflected: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Q vector``."""
    for back in range(reflected):
        reflection = reflections[(reflected - 1 - back) * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)
