"""Movements along the surface where constraints hold, by Householder's reflections that turn the constraints away.

The product of the reflections is an orthogonal matrix Q; its columns after the first ``turned`` span the surface.
A reflection is a vector u with ``|u|² = 2``: it takes v to ``v - (u·v) u``.
"""

from __future__ import annotations

from math import sqrt

from mbm.target.solver.linear_algebra import add_multiple, dot, filled
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals

REPEATED = 1e-12
"""The share of a constraint's slope that those before it leave, below which it says nothing new."""


def turn_constraints(
    n: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    scale: ConstantReals,
    holding: Integer,
    held: ConstantReals,
    slopes: ConstantReals,
    reflections: Reals,
) -> Integer:
    """The ``reflections`` (turned, count) for the constraints that hold, and how many there are.

    ``slopes`` (holding, n); of the coordinates those ``chosen`` (count,) may move, each over its ``scale``. A
    constraint holds where ``held`` is not 0.
    """
    turned = 0
    for c in range(holding):
        if held[c] != 0.0 and turned < count:
            row = reflections[turned * count :]
            for k in range(count):
                row[k] = slopes[c * n + chosen[k]] / scale[k]
            length = sqrt(dot(count, row, row))
            for q in range(turned):
                reflection = reflections[q * count :]
                add_multiple(count, -dot(count, reflection, row), reflection, row)
            filled(turned, 0.0, row)
            rest = sqrt(dot(count, row, row))
            if rest > REPEATED * length:
                row[turned] += rest if row[turned] >= 0.0 else -rest
                factor = sqrt(2.0 / dot(count, row, row))
                for k in range(turned, count):
                    row[k] *= factor
                turned += 1
    return turned


def along_surface(count: Integer, turned: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Qᵀ vector``: after the first ``turned`` numbers its part along the surface."""
    for q in range(turned):
        reflection = reflections[q * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)


def from_surface(count: Integer, turned: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Q vector``."""
    for back in range(turned):
        reflection = reflections[(turned - 1 - back) * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)
