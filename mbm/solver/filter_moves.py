"""Transitions: the state that follows on a step and a noise, and how it varies with both.

The rows of a transition say what the state reached is, explicitly or not: Newton's method finds it, in one step where
they are affine, and the inverse of their derivatives by it gives all slopes.
"""

from __future__ import annotations

from math import fabs, isfinite

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.filter_records import Walk, whitened_lines
from mbm.solver.linear_algebra import add_multiple, append_rows, copied, dot, filled, rotate
from mbm.solver.manifolds import retract

MOST_STEPS = 30
"""Newton's steps within a transition."""

CLOSE = 1e-12
"""A step of this share of the size of the state ends them: it is as good as its rounding …"""

NEAR = 1e-6
"""… and what is left behind one of this share, by its square, where slopes are not asked."""


@distinct_arrays
def eliminate(p: Integer, width: Integer, system: Reals) -> Integer:
    """``[A B] → [I A⁻¹B]`` in place (p, width), by rows with the largest pivots; 0 where A is singular, else 1."""
    for j in range(p):
        best = j
        for i in range(j + 1, p):
            if fabs(system[i * width + j]) > fabs(system[best * width + j]):
                best = i
        pivot = system[best * width + j]
        if not (fabs(pivot) > 0.0 and isfinite(pivot)):
            return 0
        if best != j:
            rotate(width - j, 0.0, 1.0, system[best * width + j :], system[j * width + j :])
            pivot = system[j * width + j]
        for k in range(j, width):
            system[j * width + k] /= pivot
        for i in range(p):
            factor = system[i * width + j]
            if i != j and factor != 0.0:
                add_multiple(width - j, -factor, system[j * width + j :], system[i * width + j :])
    return 1


def solve_move(walk: Walk) -> Integer:
    """The solved system of a transition at `pair`: ``[I | by the step before | distance | by the noise]``."""
    chain = walk.chain
    n = chain.n
    p = n - chain.still
    q = chain.noises
    wide = n + p + 1
    width = p + n + 1 + q
    if whitened_lines(walk.moving, walk.moves, walk.pair, walk.move_lines) != p:
        return 0
    for i in range(p):
        line = walk.move_lines[i * wide :]
        own = walk.system[i * width :]
        copied(p, line[n:], own)
        copied(n, line, own[p:])
        spread = walk.spread[i * q :]
        own[p + n] = line[n + p] - dot(q, spread, walk.noise)
        copied(q, spread, own[p + n + 1 :])
    return eliminate(p, width, walk.system)


def move_on(walk: Walk, before: ConstantReals) -> Integer:
    """Let `ahead` be the step that follows on ``before`` (N,) with the noise `noise`, with `carry` and `push`.

    `ahead` holds a guess. The transition is loaded. 0 where there is none, else 1.
    """
    if reach(walk, before, CLOSE) == 0:
        return 0
    n = walk.chain.n
    p = n - walk.chain.still
    q = walk.chain.noises
    width = p + n + 1 + q
    for i in range(p):
        for j in range(n):
            walk.carry[i * n + j] = -walk.system[i * width + p + j]
        copied(q, walk.system[i * width + p + n + 1 :], walk.push[i * q :])
    return 1


def reach(walk: Walk, before: ConstantReals, close: Real) -> Integer:
    """The same without the slopes, up to a step of this share of the size of the state."""
    chain = walk.chain
    n = chain.n
    still = chain.still
    p = n - still
    q = chain.noises
    width = p + n + 1 + q
    rest = chain.numbers - chain.still_numbers
    copied(chain.still_numbers, before, walk.ahead)
    copied(chain.numbers, before, walk.pair)
    going = 1
    steps = 0
    while going == 1:
        copied(rest, walk.ahead[chain.still_numbers :], walk.pair[chain.numbers :])
        if steps == MOST_STEPS or solve_move(walk) == 0:
            return 0
        steps += 1
        size = 0.0
        length = 0.0
        filled(n, 0.0, walk.step)
        for i in range(p):
            value = walk.system[i * width + p + n]
            walk.step[still + i] = -value
            length = max(length, fabs(value))
            place = walk.seen.number_of[still + i]
            size = max(size, fabs(walk.ahead[place]) if place >= 0 else 1.0)
        if not isfinite(length):
            return 0
        copied(chain.numbers, walk.ahead, walk.trial)
        retract(walk.seen, walk.trial, walk.step, walk.ahead)
        if chain.affine == 1 or length <= close * size:
            going = 0
    return 1


@distinct_arrays
def carried(n: Integer, still: Integer, carry: ConstantReals, vector: ConstantReals, target: Reals) -> None:
    """A vector (n,) about a step → about the next one."""
    copied(still, vector, target)
    for i in range(n - still):
        target[still + i] = dot(n, carry[i * n :], vector)


def carry_lines(walk: Walk, count: Integer, lines: Reals) -> None:
    """Vectors (count, n), each in place."""
    n = walk.chain.n
    for i in range(count):
        carried(n, walk.chain.still, walk.carry, lines[i * n :], walk.along)
        copied(n, walk.along, lines[i * n :])


@distinct_arrays
def to_columns(count: Integer, width: Integer, stride: Integer, lines: ConstantReals, chunk: Reals) -> None:
    """Lines (count, width) as columns that begin ``stride`` apart."""
    for i in range(count):
        for j in range(width):
            chunk[j * stride + i] = lines[i * width + j]


def predict(walk: Walk) -> Integer:
    """From a step to the next, without noise; the factor takes up that of the transition. 0 where there is none.

    The new factor is the triangle of the vectors carried on and those of the noise.
    """
    chain = walk.chain
    n = chain.n
    filled(chain.noises, 0.0, walk.noise)
    copied(chain.numbers, walk.point, walk.ahead)
    if move_on(walk, walk.point) == 0:
        return 0
    copied(chain.numbers, walk.ahead, walk.point)
    carry_lines(walk, n, walk.factor)
    carry_lines(walk, walk.open_count, walk.open)
    add_noise(walk, n, walk.factor, walk.factor)
    if chain.pools > 0:
        carry_lines(walk, n, walk.errors)
        add_noise(walk, n, walk.errors, walk.errors)
    return 1


def add_noise(walk: Walk, count: Integer, lines: ConstantReals, factor: Reals) -> None:
    """Vectors (count, n) and those of the noise, as the first ``factor`` that has the same covariance."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    still = chain.still
    stride = count + q
    to_columns(count, n, stride, lines, walk.chunk)
    for j in range(n):
        for i in range(q):
            walk.chunk[j * stride + count + i] = walk.push[(j - still) * q + i] if j >= still else 0.0
    filled(n * n, 0.0, factor)
    append_rows(n, stride, stride, walk.chunk, factor)
