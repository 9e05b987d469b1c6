"""The closed form of ranges for the data sets of a problem: the place that fits the rows at hand best."""

from __future__ import annotations

from math import inf, isfinite

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.description import Problem
from mbm.solver.equations import cost_at_point
from mbm.solver.linear_algebra import add_multiple, copied
from mbm.solver.manifolds import coordinates_of, place_coordinates
from mbm.solver.spheres import places_of_ranges
from mbm.solver.steps import project
from mbm.solver.workspace import RangeForm, Rows, Work


def know_rows(
    width: Integer,
    count: Integer,
    rows: Integer,
    given: ConstantReals,
    maps: ConstantReals,
    constants: ConstantReals,
    step: Integer,
    target: Reals,
) -> None:
    """What is known of a unit (width,) in each row, from the parameters ``given`` (rows, count).

    ``maps`` (count, width) is that of the unit, ``constants`` (width,) are added; ``step`` is the distance from row to
    row in ``target``. Most coefficients are 0, so that rows are looped over last.
    """
    for w in range(width):
        for row in range(rows):
            target[row * step + w] = constants[w]
        for p in range(count):
            factor = maps[p * width + w]
            if factor != 0.0:
                for row in range(rows):
                    target[row * step + w] += factor * given[row * count + p]


def load_ranges(problem: Problem, rows: Rows, start: ConstantReals, form: RangeForm) -> None:
    """The rows of the data set at hand as ranges, with their weights as they are now, fixed numbers as in the start."""
    ranges = form.ranges
    wide = ranges.d + 3
    ranges.rows = 0
    kind = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        for u in range(block.unit_count):
            at = form.map_places[kind + u]
            if at >= 0:
                target = ranges.spheres[ranges.rows * wide :]
                given = rows.parameters[part.parameters :]
                slopes = form.maps[at + block.parameters * wide :]
                constants = ranges.scratch
                copied(wide, slopes[form.fixed_count * wide :], constants)
                for k in range(form.fixed_count):
                    add_multiple(wide, start[form.fixed[k]], slopes[k * wide :], constants)
                know_rows(wide, block.parameters, part.rows, given, form.maps[at:], constants, wide, target)
                for row in range(part.rows):
                    if form.rooted == 1:
                        target[row * wide + ranges.d + 1] *= target[row * wide + ranges.d + 1]
                    first = part.weights + row * block.weights
                    ranges.weights[ranges.rows + row] = rows.whitening[first + block.units[u].weights]
                ranges.rows += part.rows
        kind += block.unit_count


def put_inside(problem: Problem, constants: ConstantReals, point: Reals, x: Reals) -> Integer:
    """Move a point to the bounds that it lies beyond; 0 where a number that stays positive is not. ``x`` (n,) is
    scratch.
    """
    coordinates_of(problem, point, x)
    for j in range(problem.n):
        if problem.positive[j] != 0 and not x[j] > 0.0:
            return 0
    project(problem, constants, x)
    place_coordinates(problem, x, point)
    return 1


def find_places(problem: Problem, start: ConstantReals, form: RangeForm, work: Work) -> Integer:
    """The places that the rows give, which are loaded, into `found`; how many. None where the maps do not hold."""
    for k in range(form.fixed_count):
        if form.held == 1 and start[form.fixed[k]] != form.values[k]:
            return 0
    load_ranges(problem, work.rows, start, form)
    return places_of_ranges(form.ranges, form.found)


def cost_of_place(problem: Problem, k: Integer, start: ConstantReals, form: RangeForm, work: Work) -> Real:
    """The cost at the k-th place, inf where it is none, and the `point` there, moved to the bounds.

    Numbers that are not estimated are those of the ``start`` (numbers,).
    """
    m = form.ranges.d + form.ranges.offset
    copied(problem.numbers, start, form.point)
    for i in range(m):
        form.point[form.places[i]] = form.found[k * m + i]
    if problem.boxed == 1 and put_inside(problem, work.rows.constants, form.point, work.x) == 0:
        return inf
    cost = cost_at_point(problem, work.rows, form.point, 1, 0, work.rows.residuals)
    return cost if isfinite(cost) else inf


def best_of_ranges(problem: Problem, start: ConstantReals, form: RangeForm, work: Work) -> Real:
    """The cost at the best place that the ranges give, inf without one, and the `point` there."""
    least = inf
    best = 0
    for k in range(find_places(problem, start, form, work)):
        cost = cost_of_place(problem, k, start, form, work)
        if cost < least:
            least = cost
            best = k
    if least < inf:
        cost_of_place(problem, best, start, form, work)
    return least
