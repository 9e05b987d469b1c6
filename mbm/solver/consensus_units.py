"""What the units of a data set are: where their residuals stand, their noise, their rounding, their directions."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer
from mbm.solver.consensus_records import LEVEL, ConsensusWork, Level
from mbm.solver.decisions import CONSENSUS_ROUNDING
from mbm.solver.description import Problem
from mbm.solver.equations import groups_of, weights_width
from mbm.solver.linear_algebra import filled
from mbm.solver.manifolds import coordinates_of


def put_unit(
    number: Integer, first: Integer, place: Integer, size: Integer, level: Integer, work: ConsensusWork
) -> Integer:
    """A unit of so many residuals with its law; whether it is one whose residual has its own number.

    ``first`` are the residuals of the units before it, ``place`` is where its own stand.
    """
    units = work.units
    law = view(Level, work.levels[level * LEVEL :])
    units.components[number] = size
    units.place[number] = place
    units.first[number] = first
    units.medians[number] = law.median
    units.cuts[number] = law.cut
    units.reaches[number] = law.reach
    for i in range(size):
        work.ruled[place + i * LANES] = 1.0
    return size == 1 and place == number


def list_units(problem: Problem, work: ConsensusWork) -> None:
    """The units of a data set, in order."""
    units = work.units
    n = 0
    there = 0
    whitening = 0
    scalars = 0
    simple = 1
    filled(problem.chunk, 0.0, work.ruled)
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        rows = work.rows.data.blocks[b].rows
        lines = block.outputs
        own = work.rules.ruled[b]
        if own.first_level >= 0:
            for row in range(rows):
                for u in range(block.unit_count):
                    unit = block.units[u]
                    weight = (row // LANES * block.weights + unit.weights) * LANES + row % LANES
                    if work.rows.weights[whitening + weight] != 0.0:
                        place = there + (row // LANES * lines + unit.first) * LANES + row % LANES
                        if put_unit(n, scalars, place, unit.last - unit.first, own.first_level + u, work) == 0:
                            simple = 0
                        units.group[n] = own.group
                        units.block[n] = b
                        units.row[n] = row
                        units.equation[n] = u
                        scalars += units.components[n]
                        n += 1
        elif rows > 0:
            simple = 0
        there += groups_of(rows) * LANES * lines
        whitening += groups_of(rows) * LANES * weights_width(block)
    units.first[n] = scalars
    units.simple = simple
    units.count = n
    units.scalars = scalars


def set_rounding(problem: Problem, point: ConstantReals, work: ConsensusWork) -> None:
    """The squared norms (U,) that the arithmetic alone makes, from ``[J r]`` at the point, as it is in the work."""
    n = problem.n
    stride = problem.chunk
    units = work.units
    chunk = work.here.chunk
    size = work.coordinates
    coordinates_of(problem, point, size)
    for u in range(units.count):
        place = units.place[u]
        largest = 0.0
        for i in range(units.components[u]):
            terms = fabs(chunk[n * stride + place + i * LANES])
            for j in range(n):
                terms += fabs(chunk[j * stride + place + i * LANES] * size[j])
            if isfinite(terms):
                largest = max(largest, terms)
        units.rounding[u] = CONSENSUS_ROUNDING * largest * (CONSENSUS_ROUNDING * largest)


def norm_directions(problem: Problem, work: ConsensusWork) -> None:
    """Rows of the units' Jacobian in the work, columns scaled to norm 1, then each row to norm 1: (scalars, n)."""
    n = problem.n
    stride = problem.chunk
    units = work.units
    chunk = work.here.chunk
    norms = work.coordinates
    directions = work.directions
    filled(n, 0.0, norms)
    for u in range(units.count):
        first = units.first[u]
        place = units.place[u]
        for i in range(units.components[u]):
            for j in range(n):
                value = chunk[j * stride + place + i * LANES]
                if not isfinite(value):
                    value = 0.0
                directions[(first + i) * n + j] = value
                norms[j] += value * value
    for j in range(n):
        norms[j] = 1.0 / sqrt(norms[j]) if norms[j] > 0.0 else 1.0
    for k in range(units.scalars):
        square = 0.0
        row = directions[k * n :]
        for j in range(n):
            row[j] *= norms[j]
            square += row[j] * row[j]
        if square > 0.0:
            length = sqrt(square)
            for j in range(n):
                row[j] = row[j] / length
