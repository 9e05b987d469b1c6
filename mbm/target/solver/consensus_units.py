"""What the units of a data set are: where their residuals stand, their noise, their rounding, their directions."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import CONSENSUS_ROUNDING
from mbm.target.solver.consensus_description import (
    AWAY,
    BLOCK_OF,
    BLOCKS_AT,
    COMPONENTS,
    CUTS,
    FIRST,
    GROUP_OF,
    LEVEL,
    LEVEL_CUT,
    LEVEL_MEDIAN,
    LEVEL_REACH,
    MEDIANS,
    PLACE,
    REACHES,
    ROW_OF,
    RULED,
    RULED_GROUP,
    RULED_TYPE,
    UNIT_OF,
    UNIT_ROUNDINGS,
    by_row_at,
    directions_at,
    place_vector_at,
    simple_at,
    slot_at,
    small_at,
    unit_vector_at,
)
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_OUTPUTS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCKS,
    CHUNK,
    COORDINATES,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_ROWS,
    LANES,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
)
from mbm.target.solver.description import BLOCKS_AT as SYSTEM_BLOCKS_AT
from mbm.target.solver.equations import groups_of
from mbm.target.solver.linear_algebra import filled
from mbm.target.solver.manifolds import coordinates_of
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


def list_units(
    system: ConstantIntegers,
    data: ConstantIntegers,
    rules: ConstantIntegers,
    levels: ConstantReals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The units of a data set, in order; how many there are."""
    n = 0
    there = 0
    scalars = 0
    simple = 1
    ruled = bench[by_row_at(system, rules) + system[CHUNK] :]
    filled(system[CHUNK], 0.0, ruled)
    for b in range(system[BLOCKS]):
        block = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK :]
        rows = data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        lines = block[BLOCK_OUTPUTS]
        own = rules[rules[BLOCKS_AT] + b * RULED :]
        if own[RULED_TYPE] >= 0:
            for row in range(rows):
                for u in range(block[BLOCK_UNITS]):
                    unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
                    size = unit[UNIT_LAST] - unit[UNIT_FIRST]
                    level = levels[(own[RULED_TYPE] + u) * LEVEL :]
                    place = there + (row // LANES * lines + unit[UNIT_FIRST]) * LANES + row % LANES
                    places[place_vector_at(rules, COMPONENTS) + n] = size
                    places[place_vector_at(rules, GROUP_OF) + n] = own[RULED_GROUP]
                    places[place_vector_at(rules, PLACE) + n] = place
                    places[place_vector_at(rules, BLOCK_OF) + n] = b
                    places[place_vector_at(rules, ROW_OF) + n] = row
                    places[place_vector_at(rules, UNIT_OF) + n] = u
                    places[place_vector_at(rules, FIRST) + n] = scalars
                    bench[unit_vector_at(rules, MEDIANS) + n] = level[LEVEL_MEDIAN]
                    bench[unit_vector_at(rules, CUTS) + n] = level[LEVEL_CUT]
                    bench[unit_vector_at(rules, REACHES) + n] = level[LEVEL_REACH]
                    if size != 1 or place != n:
                        simple = 0
                    for i in range(size):
                        ruled[place + i * LANES] = 1.0
                    scalars += size
                    n += 1
        elif rows > 0:
            simple = 0
        there += groups_of(rows) * LANES * lines
    places[place_vector_at(rules, FIRST) + n] = scalars
    places[simple_at(rules)] = simple
    return n


def judge_rounding(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    point: ConstantReals,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """The squared norms (U,) that the arithmetic alone makes, from ``[J r]`` at the point in slot 0."""
    n = system[COORDINATES]
    stride = system[CHUNK]
    chunk = bench[slot_at(system, rules, 0) :]
    size = bench[small_at(system, rules, AWAY) :]
    coordinates_of(system, point, size)
    for u in range(units):
        place = places[place_vector_at(rules, PLACE) + u]
        largest = 0.0
        for i in range(places[place_vector_at(rules, COMPONENTS) + u]):
            terms = fabs(chunk[n * stride + place + i * LANES])
            for j in range(n):
                terms += fabs(chunk[j * stride + place + i * LANES] * size[j])
            if isfinite(terms):
                largest = max(largest, terms)
        bench[unit_vector_at(rules, UNIT_ROUNDINGS) + u] = CONSENSUS_ROUNDING * largest * (CONSENSUS_ROUNDING * largest)


def norm_directions(
    system: ConstantIntegers, rules: ConstantIntegers, units: Integer, bench: Reals, places: ConstantIntegers
) -> None:
    """Rows of the units' Jacobian in slot 0, columns scaled to norm 1, then each row to norm 1: (scalars, n)."""
    n = system[COORDINATES]
    stride = system[CHUNK]
    chunk = bench[slot_at(system, rules, 0) :]
    norms = bench[small_at(system, rules, AWAY) :]
    directions = bench[directions_at(system, rules) :]
    for j in range(n):
        norms[j] = 0.0
    for u in range(units):
        first = places[place_vector_at(rules, FIRST) + u]
        place = places[place_vector_at(rules, PLACE) + u]
        for i in range(places[place_vector_at(rules, COMPONENTS) + u]):
            for j in range(n):
                value = chunk[j * stride + place + i * LANES]
                if not isfinite(value):
                    value = 0.0
                directions[(first + i) * n + j] = value
                norms[j] += value * value
    for j in range(n):
        norms[j] = 1.0 / sqrt(norms[j]) if norms[j] > 0.0 else 1.0
    for k in range(places[place_vector_at(rules, FIRST) + units]):
        square = 0.0
        row = directions[k * n :]
        for j in range(n):
            row[j] *= norms[j]
            square += row[j] * row[j]
        if square > 0.0:
            length = sqrt(square)
            for j in range(n):
                row[j] = row[j] / length
