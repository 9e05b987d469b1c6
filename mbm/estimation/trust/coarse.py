"""Readings that are no plain numbers: in coarse steps, all the same at a limit, or what their own weights follow."""

from __future__ import annotations

from functools import partial
from math import comb, erfc, exp, pi, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.solves import Lines
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.trust import faults
from mbm.estimation.trust.alike import autocorrelated
from mbm.estimation.trust.fits import Fits, Said
from mbm.estimation.trust.repeated import repeated_equations
from mbm.estimation.trust.uneven import NO_DIFFERENCE, outlying_rows, told_apart, uneven_noise
from mbm.expression.algebra import UndefinedValueError
from mbm.expression.derivative import derivatives
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Column, Component, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.rows import lookup
from mbm.problem.types import BlockRole, Equation, NoiseKind, Problem

COARSE = 0.55
"""Standard deviation of the readings about the model, in steps, below which the steps are coarse: 0.29 is that of
rounding alone; where the scatter before rounding is half a step, it is 0.58."""

COARSE_SHIFT = 0.5
"""Standard deviations by which rounding may shift estimates from which on that matters."""

LEAST_ROWS = 4
"""Readings that tell their steps: two of them have to be alike, and two to differ."""

WHOLE = 1e-6
"""Distance from whole numbers of steps up to which readings are such: what changes of units leave."""


def rounded_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations whose unknown noise their residuals tell."""
    block = problem.blocks[owner]
    return read_column(problem, owner) if block.unknown_factor and len(block.cases) == 1 else None


def read_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations."""
    block = problem.blocks[owner]
    if block.role is not BlockRole.OBSERVATION or block.table is None:
        return None
    sides = {each.measured for case in block.cases for each in case.equations}
    if len(sides) != 1 or any(len(case.equations) != 1 for case in block.cases):
        return None
    (measured,) = sides
    if measured is None or len(measured) != 1 or not isinstance(measured[0], Column):
        return None
    column = measured[0]
    simple = column.row is RowChoice.EACH and column.table == block.table and column.sampling is None
    return column.name if simple and column.member is None else None


@np.errstate(all="ignore")
def steps(readings: Floats) -> Floats:
    """The steps (…,) of readings (…, m), NaN where there is none; NaN where they are in no steps, or all are alike.

    Readings of a continuous quantity are never alike, and no whole numbers of their smallest difference.
    """
    ordered = np.sort(readings, axis=-1)
    apart = np.diff(ordered, axis=-1)
    step = np.min(np.where(apart > 0.0, apart, np.inf), axis=-1, initial=np.inf)
    counted = (ordered - ordered[..., :1]) / step[..., None]
    whole = (np.isnan(counted) | (np.abs(counted - np.rint(counted)) <= WHOLE)).all(axis=-1)
    alike = (apart == 0.0).any(axis=-1) & (np.isfinite(readings).sum(axis=-1) >= LEAST_ROWS)
    return np.where(whole & alike & np.isfinite(step), step, np.nan)


@np.errstate(all="ignore")
def coarse(readings: Floats, raw: Floats, deviations: Floats, basis: Floats) -> Mask:
    """Where the steps of readings are coarse.

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates. The rounding error of the reading of y has the first harmonic h/π sin(2π y/h).
    """
    there = np.isfinite(readings)
    step = steps(readings)
    known, scatter = np.where(there, deviations, np.nan), np.full(step.shape, np.nan)
    some = np.isfinite(known).any(axis=-1)
    scatter[some] = np.nanmedian(known[some], axis=-1)
    wave = np.exp(2j * np.pi * (readings + raw) / step[..., None]) / deviations
    along = np.einsum("...mk,...m->...k", basis, np.where(there, wave, 0.0))
    shift = step / np.pi * np.sqrt(np.square(np.abs(along)).sum(axis=-1))
    return np.asarray((scatter < COARSE * step) & (shift > COARSE_SHIFT))


def of_readings(fits: Fits) -> Said:
    """Clauses whose readings have coarse steps, whose weights follow the readings, or that have none and repeat."""
    yield from coarse_readings(fits)
    yield from weights_from_readings(fits)
    yield from repeated_equations(fits)


def coarse_readings(fits: Fits) -> Said:
    """Clauses whose readings have coarse steps."""
    equations = fits.solves.equations
    if fits.solves.consensus or equations.likely or equations.lossy or fits.solves.most < LEAST_ROWS:
        return
    for owner, block in enumerate(fits.problem.blocks):
        name = rounded_column(fits.problem, owner)
        if name is None or block.table is None:
            continue
        readings = fits.column(owner, block.table, name)
        which = np.flatnonzero(np.isfinite(steps(readings)))
        if not len(which):
            continue
        deviations = fits.deviations()
        found = coarse(readings[which], fits.errors()[which], deviations[which], fits.basis[which])
        for place in which[found].tolist():
            there = np.isfinite(readings[place])
            own = readings[place, there]
            scatter = float(np.median(deviations[place, there])) / float(steps(own))
            counts = bool((own >= 0.0).all() and (own == np.rint(own)).all())
            yield place, partial(faults.coarse_readings, block.span, block.name, scatter, counts=counts)


WEIGHT_SHIFT = 0.35
"""Standard deviations by which weights that follow the readings shift estimates from which on that matters: a shift of
0.42 leaves intervals of 95 % in 93 %, and the deviations come out too small besides."""


@np.errstate(all="ignore")
def weights_from_readings(fits: Fits) -> Said:
    """Clauses whose stated standard deviations follow the readings: those that came out low then weigh too much, or
    those that came out high where the deviations fall with them.

    With σ(y) of readings y = μ + e, e/σ² is −2 σ′/σ on average, to first order: whitened, all readings are 2 σ′ low.
    """
    found = [_steepness(each, fits) for each in fits.solves.lines]
    if not any(each is not None for each in found):
        return
    steep, towards = (fits.solves.by_slot([each if each is None else each[k] for each in found], 0.0) for k in (0, 1))
    low = 2.0 * steep * fits.deviations()
    for owner, block in enumerate(fits.problem.blocks):
        mine = np.where(fits.solves.of_blocks((owner,)), low, 0.0)
        shift = np.sqrt(np.square(np.einsum("kmi,km->ki", fits.basis, mine)).sum(axis=-1))
        for place in np.flatnonzero(shift > WEIGHT_SHIFT).tolist():
            end = "low" if (mine[place] * towards[place]).sum() > 0.0 else "high"
            yield place, partial(faults.weights_from_readings, block.span, block.name, float(shift[place]), end)


def _steepness(lines: Lines, fits: Fits) -> Floats | None:
    """How fast log σ falls (R, outputs) as a component grows by what it reads, and 1 where that is by a lower reading,
    else -1: (2, R, outputs). None: not at all.
    """
    found = np.zeros((2, *lines.slots.shape))
    for each, whitener in zip(lines.group.equations, lines.whiteners, strict=True):
        if each.noise_kind is not NoiseKind.SIGMA or each.likelihood is not None:
            continue
        for place in range(len(each.noise)):
            growth, slope = _growths(each, place, lines, fits)
            with_reading = np.where(np.isfinite(growth / slope), -growth / slope, 0.0)
            found[0, :, whitener.first + place], found[1, :, whitener.first + place] = with_reading, -np.sign(slope)
    return found if found[0].any() else None


def _growths(equation: Equation, place: int, lines: Lines, fits: Fits) -> tuple[Floats | float, Floats | float]:
    """How fast log σ and a component grow (R,) with the one column that it reads, where σ is made of that.

    0 where it reads several, or one that acts together with unknowns.
    """
    component, sigma = equation.components[place], equation.noise[place]
    measured = [] if equation.measured is None else leaves((equation.measured[place],))
    columns = [leaf for leaf in measured if isinstance(leaf, Column)] or leaves((component,))
    read = {leaf.identity for leaf in columns if isinstance(leaf, Column)}
    made = {leaf.identity for leaf in leaves((sigma,)) if isinstance(leaf, Column)}
    if len(read) != 1 or not read <= made:
        return 0.0, 1.0
    every = [leaf for leaf in leaves((component, sigma)) if isinstance(leaf, Column) and leaf.identity in read]
    try:
        slopes = [derivatives((sigma, component), leaf) for leaf in every]
    except UndefinedValueError:
        return 0.0, 1.0
    parts = tuple(part for pair in slopes for part in pair)
    if any(isinstance(leaf, Component) for leaf in leaves(parts)):
        return 0.0, 1.0
    block = fits.problem.blocks[lines.group.kernel.owner]
    data = lookup(None if block.table is None else fits.tables[block.table], lines.positions, fits.tables)
    deviation, *numbers = evaluate((sigma, *parts), data)
    return sum(numbers[::2]) / deviation, sum(numbers[1::2])


SELDOM = 0.01
"""Probability below which readings are not alike by chance: that of one of six which is 0 is 0.065 with three figures,
and 0.0065 with four."""

EDGE_SHIFT = 0.1
"""Standard deviations by which limits shift estimates from which on that matters, as far as the estimates tell, which
are shifted themselves: of six readings about 0 one that is shown as 0 tells 0.17 of 0.3."""

NEAR, BEYOND = 2.0, 5.0
"""Standard deviations from a limit up to which a reading might have been beyond it; and from which on it was not."""

FINEST = 1e-6
"""Steps, as a share of the range of readings, below which they are not told from what changes of units leave."""

LEAST_OTHERS = 2
"""Readings within the limit that tell how fine readings are."""

SIGNS = 1.0, -1.0
"""The lower edge, and the upper one."""


@np.errstate(all="ignore")
def at_edge(readings: Floats, raw: Floats, deviations: Floats, basis: Floats, sign: float) -> tuple[Floats, Mask]:
    """The least (``sign`` 1) or largest (−1) of the readings (…,), and whether it may be a limit that matters (…,).

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates.
    """
    there = np.isfinite(readings)
    ordered = np.where(there, sign * readings, np.inf)
    least = ordered.min(axis=-1, keepdims=True)
    tied = there & (ordered == least)
    count = tied.sum(axis=-1)
    edge = sign * least[..., 0] + 0.0
    told = (count > 1) | (least[..., 0] == 0.0)
    if not told.any():
        return edge, told
    depth = np.where(there, least - ordered - sign * raw, -np.inf) / deviations
    near = (depth > -NEAR).sum(axis=-1)
    size = np.where(there, np.abs(readings), 0.0).max(axis=-1, keepdims=True)
    noisy = (there & (np.abs(raw) > NO_DIFFERENCE * size)).any(axis=-1)
    found = noisy & told & ((count > 1) | (near > 1))
    hidden = np.zeros(depth.shape)
    tied &= found[..., None]
    hidden[tied] = [_below(each) for each in depth[tied].tolist()]
    shift = np.sqrt(np.square(np.einsum("...mk,...m->...k", basis, hidden)).sum(axis=-1))
    return edge, np.asarray(found & (shift > EDGE_SHIFT))


def _below(depth: float) -> float:
    """How far a standard normal value is below ``depth`` on average, if it is below."""
    depth = max(depth, -BEYOND)
    return depth + sqrt(2.0 / pi) * exp(-0.5 * depth * depth) / erfc(-depth / sqrt(2.0))


def by_chance(count: int, rows: int, others: Floats, deviation: float) -> float:
    """A bound of the probability that so many readings of some rows are equal to a value by chance.

    ``others`` (n,) are the distances from it of readings of one kind, which tell how fine these are.
    """
    if len(others) < LEAST_OTHERS:
        return 1.0
    once = grid(others) / (deviation * sqrt(2.0 * pi))
    return rows * once if count == 1 else comb(rows, count) * once ** (count - 1)


def grid(distances: Floats) -> float:
    """The largest step of which all ``distances`` (n,) > 0 are whole multiples, by Euclid's algorithm."""
    finest, step = FINEST * float(distances.max()), 0.0
    for each in distances.tolist():
        larger, smaller = each, step
        while smaller > finest:
            larger, smaller = smaller, abs(larger - round(larger / smaller) * smaller)
        step = larger
    return step


def clauses_read(problem: Problem, equations: Assembled) -> dict[int, tuple[str, str]]:
    """The table and the column that hold the readings, of each clause of which such readings may be told."""
    found = {}
    for owner in told_apart(problem, equations):
        column, table = read_column(problem, owner), problem.blocks[owner].table
        if column is not None and table is not None:
            found[owner] = table, column
    return found


def readings_at_edges(fits: Fits) -> Said:
    """Clauses some of whose readings stand at a limit that is not stated."""
    clauses = {} if fits.solves.consensus else clauses_read(fits.problem, fits.solves.equations)
    if not clauses:
        return
    read = {owner: fits.column(owner, *column) for owner, column in clauses.items()}
    raw, deviations, blocks = fits.errors(), fits.deviations(), fits.problem.blocks
    for owner, readings in read.items():
        block, left = blocks[owner], np.ones(fits.solves.count, dtype=bool)
        for sign in SIGNS:
            edges, suspect = at_edge(readings, raw, deviations, fits.basis, sign)
            for place in np.flatnonzero(suspect & left).tolist():
                alike = [each[place] for k, each in read.items() if blocks[k].factor_name == block.factor_name]
                away, own, edge = np.abs(np.concatenate(alike) - edges[place]), readings[place], float(edges[place])
                there = np.isfinite(own)
                count, deviation = (
                    (int((own == edge).sum()), int(there.sum())),
                    float(np.median(deviations[place, there])),
                )
                if 1 < count[0] <= np.unique(own[there], return_counts=True)[1][1:-1].max(initial=0):
                    continue  # readings repeat between the edges, too
                if by_chance(*count, away[away > 0.0], deviation) < SELDOM:
                    left[place] = False
                    said = partial(faults.readings_at_edge, block.span, block.name, count, edge, lower=sign > 0)
                    yield place, said


def uneven_rows(fits: Fits, over: Mask, tested: Indices | None = None) -> Said:
    """What is said of rows beside one another; arguments as for `autocorrelated`."""
    alike = set()
    for place, make in autocorrelated(fits, over, tested):
        alike.add(place)
        yield place, make
    yield from (each for each in uneven_noise(fits) if each[0] not in alike)
    yield from outlying_rows(fits)
    yield from readings_at_edges(fits)
