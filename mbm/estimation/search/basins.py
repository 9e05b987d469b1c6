"""From where many starts ended to the distinct minima: what is the same, what is no minimum, what is a twin."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binding import INPUTS_AT_A_TIME, Group
from mbm.equations.metric import minimum_norms, rounding_at
from mbm.equations.types import Floats, Indices, Minimum
from mbm.estimation.minimise.native.minimum import StartEnds
from mbm.estimation.search.twins import Agreement, Twin, plainer, separation, twin_of
from mbm.estimation.search.valleys import RANK, Walks, flat
from mbm.solver.decisions import DIFFERENCE, fits_exactly, usual_cost
from mbm.values import dataclass

COARSE = 1e-4
"""Ends nearer to each other than this share of the spread of all ends are the same before they are polished."""

FINE = 1e-3
"""Minima are the same if no coordinate differs by more than this share of its conditional standard deviation."""

EQUAL = 1e-6
"""Costs that differ by less, relatively, are equal."""

NEGATIVE = -1e-3
"""A curvature below this share of the largest one that JᵀJ has in its direction is a way down, not rounding."""

LARGEST = 400
"""Unknowns up to which the curvature at a minimum is looked at."""

COMPARED = 60
"""Minima, the lowest first, that are looked at for twins."""

ENDLESS = 1e6
"""Standard deviations from a minimum beyond which the end of a descent is on the way to the infinite."""

APART = 1e3
"""Factor by which a number has grown or vanished that is on its way to the infinite or to 0."""

UNFELT = 1e-3
"""Standard deviations of the noise by which residuals change that no longer do."""

NEARLY_EXACT = 1e6
"""Roundings of a fit with noise: measured values have fewer digits."""

LARGEST_MOVE = 0.1
"""Share of its box, or of its size, that a coordinate moves at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Basin:
    """A minimum, the starts that led to it (numbers, ascending), and how it follows from a better one, if it does."""

    minimum: Minimum
    starts: Indices
    twin: Twin | None = None


def ends_apart(equations: Assembled, ends: StartEnds) -> Iterator[tuple[Floats, Indices]]:
    """The ends that differ (N,), the lowest cost first, each with the numbers of the starts that it stands for."""
    usable = np.flatnonzero(np.isfinite(ends.cost))
    left = usable[np.argsort(ends.cost[usable], kind="stable")]
    if not left.size:
        return
    reach = COARSE * np.ptp(separation(equations, ends.points[left[0]], ends.points[left]), axis=0)
    size = np.abs([equations.coordinates(p) for p in ends.points[left]]).max(axis=0)
    allowed = np.maximum(reach, EQUAL * size)
    while left.size:
        first = left[0]
        near = (separation(equations, ends.points[first], ends.points[left]) <= allowed).all(axis=1)
        near &= ends.cost[left] <= ends.cost[first] + COARSE * (1.0 + ends.cost[first])
        near[0] = True
        yield ends.points[first], np.sort(left[near])
        left = left[~near]


def merged(walks: Walks, basins: Sequence[Basin]) -> tuple[Basin, ...]:
    """The basins that differ, the lowest cost first; those that do not meet the constraints come after all others.

    Of equal costs, those that converged come first, then those that the first starts led to.
    """
    order = sorted(basins, key=lambda b: (b.minimum.cost, int(b.starts[0])))
    kept: list[Basin] = []
    for basin in order:
        number = next((i for i, k in enumerate(kept) if same_minimum(walks, k.minimum, basin.minimum)), None)
        if number is None:
            kept.append(basin)
        else:
            kept[number] = _joined(kept[number], basin)
    meeting = [b for b in kept if b.minimum.feasible]
    return (*_ranked(meeting), *_ranked([b for b in kept if not b.minimum.feasible]))


def _ranked(basins: Sequence[Basin]) -> Iterator[Basin]:
    """In the order of costs, where the last digits of a cost do not count."""
    left = list(basins)
    while left:
        lowest = left[0].minimum.cost
        equal = [b for b in left if equal_costs(lowest, b.minimum.cost)]
        yield from sorted(equal, key=lambda b: (not b.minimum.reason.converged, int(b.starts[0])))
        left = left[len(equal) :]


def without_twins(equations: Assembled, basins: Sequence[Basin], agree: Agreement) -> tuple[Basin, ...]:
    """Basins that are another way to write a better one are joined to it; mirror images stay, and are marked.

    Those of which derived quantities do not ``agree`` stay as well: somebody tells them apart. Angles, and plain
    numbers that turn as angles do, are written as near to their starts as they can be.
    """
    kept: list[Basin] = []
    for number, basin in enumerate(basins):
        found = _twin_among(equations, kept, basin) if number < COMPARED else None
        if found is None:
            kept.append(basin)
        elif found[1] is Twin.MIRRORED:
            kept.append(replace(basin, twin=Twin.MIRRORED))
        elif agree((same := kept[found[0]]).minimum.point, basin.minimum.point):
            swapped = found[1] is not Twin.EXCHANGED and plainer(equations, same.minimum.point, basin.minimum.point)
            kept[found[0]] = _joined(basin, same) if swapped else _joined(same, basin)
        else:
            kept.append(basin)
    return tuple(kept)


def without_limits(equations: Assembled, basins: tuple[Basin, ...], *, stated: bool) -> tuple[Basin, ...]:
    """The basins from the best minimum on, where the lowest cost is a limit in the infinite: scales that shrink what is
    compared to nothing fit anything.

    Only where a minimum that determines all unknowns fits as well as ``stated`` noise lets expect; of unknown noise,
    where the limit fits all but exactly.
    """
    first, freedom = basins[0].minimum, float(equations.count - equations.dimension)
    for number, basin in enumerate(basins[1:], 1):
        minimum = basin.minimum
        dense = minimum.blocks is None and first.blocks is None  # with many unknowns nobody asks
        if not dense or not minimum.reason.converged or not minimum.feasible or flat(equations, minimum, RANK):
            continue
        if stated:
            variance, sound = 1.0, minimum.cost <= usual_cost(freedom)
        else:
            variance = minimum.cost / max(freedom, 1.0)
            sound = bool(fits_exactly(first.cost, NEARLY_EXACT * rounding_at(equations, minimum)))
        return basins[number:] if sound and _endless(equations, minimum, variance, first) else basins
    return basins


@np.errstate(all="ignore")
def _endless(equations: Assembled, minimum: Minimum, variance: float, end: Minimum) -> bool:
    """Whether the way from a minimum to an end leads on to the infinite: numbers have grown far beyond what the data
    may mean, and go on growing, or where they double, and those that have all but vanished halve, no residual changes.
    """
    places = equations.layout.number[equations.free]
    plain = (places >= 0) & ~equations.layout.angle[equations.free]
    here, there = (np.where(plain, each.point[places], 0.0) for each in (minimum, end))
    squares = variance * np.diag(np.linalg.pinv(minimum.jacobian.T @ minimum.jacobian, hermitian=True))
    grown = (np.abs(there) > APART * np.abs(here)) & (np.square(there - here) > ENDLESS**2 * squares)
    if not grown.any() or not end.reason.converged:
        return bool(grown.any())
    onwards = np.where(grown, there, np.where(np.abs(there) * APART < np.abs(here), -0.5 * there, 0.0))
    off = np.abs(equations.residuals(equations.retract(end.point, onwards)) - end.residuals).max(initial=0.0)
    return bool(off <= UNFELT * np.sqrt(variance))


def equal_costs(first: float, second: float) -> bool:
    """Both fit equally well."""
    return abs(first - second) <= EQUAL * (1.0 + min(first, second))


def ways_down(equations: Assembled, minimum: Minimum) -> tuple[Floats, ...]:
    """Two points on either side of a saddle, in the direction in which the cost falls; none at a minimum.

    The Hessian of Σ r²/2 by differences of the gradient, over the coordinates that no bound holds, in units of their
    conditional standard deviations (of a tenth of their size, where no residual feels them to first order).
    """
    free = np.flatnonzero(minimum.at_bound == 0)
    if not 0 < free.size <= LARGEST or minimum.cost <= EQUAL:
        return ()
    spread = np.sqrt(minimum.cost / max(minimum.residuals.size, 1))
    units = _units(equations, minimum, spread)[free]
    lengths = DIFFERENCE * units
    steps = np.zeros((2 * free.size, minimum.jacobian.shape[1]))
    line = np.arange(free.size)
    steps[line, free], steps[free.size + line, free] = lengths, -lengths
    points = equations.retract(np.broadcast_to(minimum.point, (len(steps), len(minimum.point))), steps)
    with np.errstate(all="ignore"):
        gradient = gradients_at(equations, points)[:, free]
    slopes = (gradient[: free.size] - gradient[free.size :]) / (2.0 * lengths[:, None])
    hessian = slopes * np.multiply.outer(units, units) / (spread * spread)
    if not np.isfinite(hessian).all():
        return ()
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    if values[0] >= NEGATIVE:
        return ()
    step = np.zeros(minimum.jacobian.shape[1])
    step[free] = units * vectors[:, 0]
    return tuple(equations.retract(minimum.point, sign * step) for sign in (1.0, -1.0))


def _units(equations: Assembled, minimum: Minimum, spread: float) -> Floats:
    """How far each coordinate (n,) moves to change the residuals by about their size; at most a tenth of its box."""
    length = minimum_norms(minimum)
    width = equations.upper - equations.lower
    size = np.maximum(1.0, np.abs(equations.coordinates(minimum.point)))
    most = LARGEST_MOVE * np.where(np.isfinite(width), width, size)
    return np.asarray(spread / np.maximum(length, spread / most))


def same_minimum(walks: Walks, one: Minimum, other: Minimum) -> bool:
    """Whether it is one minimum, found twice; or they are points of one valley along which no residual changes.

    A cup upside down may look the same, and so it does however it is turned about its axis: these are two valleys.
    """
    if not equal_costs(one.cost, other.cost):
        return False
    equations = walks.equations
    apart = separation(equations, one.point, other.point[None])[0]
    length = minimum_norms(one)
    spread = np.sqrt(max(1.0, one.cost))
    size = np.abs(equations.coordinates(one.point))
    within = apart * length <= FINE * spread + EQUAL * size * length
    if within.all():
        return True
    if one.residuals.shape != other.residuals.shape or not flat(equations, one, EQUAL * FINE):
        return False
    if not (np.abs(one.residuals - other.residuals) <= FINE * spread).all():
        return False
    return walks.connect(one, other.point)


def _twin_among(equations: Assembled, kept: Sequence[Basin], basin: Basin) -> tuple[int, Twin] | None:
    """The first that it is another way to write, else the first that it is a mirror image of."""
    mirrored = None
    for number, other in enumerate(kept):
        if equal_costs(other.minimum.cost, basin.minimum.cost):
            twin = twin_of(equations, other.minimum.point, basin.minimum.point)
            if twin not in (None, Twin.MIRRORED):
                return number, twin
            mirrored = mirrored or (None if twin is None else (number, twin))
    return mirrored


def _joined(basin: Basin, other: Basin) -> Basin:
    return replace(basin, starts=np.union1d(basin.starts, other.starts))


def gradients_at(equations: Assembled, points: Floats) -> Floats:
    """Half the gradient of the cost (P, n), residualsᵀ Jacobian, at points (P, N)."""
    if equations.implicit is not None or equations.structure is not None:
        return np.stack([equations.residuals(point) @ equations.jacobian(point) for point in points])
    columns = equations.columns
    weights = _weights(equations, points)
    result = np.zeros((len(points), equations.dimension))
    for group in equations.groups:
        kernel = group.kernel
        width = len(kernel.variables) + len(kernel.parameters) + len(kernel.jacobian_rows)
        step = max(INPUTS_AT_A_TIME // max(group.rows * width, 1), 1)
        own = weights[:, group.first : group.first + group.count].reshape(len(points), group.rows, kernel.outputs)
        for first in range(0, len(points), step):
            some = slice(first, first + step)
            result[some] += _pulled_back(group, points[some], own[some], columns, equations.dimension)
    return result


def _weights(equations: Assembled, points: Floats) -> Floats:
    """What the plain residuals' derivatives are weighted with (P, all residuals): ρ'(s) r, 0 for rows not picked.

    ``r`` are residuals with their noise factors, which the derivatives lack, so that they divide once more.
    """
    plain = equations.plain_residuals_at(points)
    weighted = plain.copy()
    if equations.lossy:
        for loss, lines in loss_lines(equations):
            part = plain[:, lines]
            weighted[:, lines] = part * loss.weight(np.square(part).sum(axis=2))[:, :, None]
    if equations.rows is not None:
        whole = np.zeros((len(points), equations.whole))
        whole[:, equations.rows] = weighted
        weighted = whole
    return weighted if equations.factors is None else weighted / equations.factors


def _pulled_back(group: Group, points: Floats, weights: Floats, columns: Indices, width: int) -> Floats:
    """The sum over a group's rows of weights (P, rows, outputs) times the whitened Jacobian: (P, ``width``)."""
    kernel, count = group.kernel, len(points)
    outer = np.concatenate([whitener.transposed(weights) for whitener in group.whiteners], axis=-1)
    inputs = group.inputs_at(points, slice(group.rows))
    _, nonzeros = group.cache.stream(group.number, kernel).values_and_jacobian(inputs)
    parts = nonzeros.reshape(count, group.rows, len(kernel.jacobian_rows)) * outer[:, :, kernel.jacobian_rows]
    places = columns[group.columns[:, kernel.jacobian_columns]]
    lines = np.arange(count)[:, None, None] * width + places
    moved = np.broadcast_to(places >= 0, parts.shape)
    sums = np.bincount(lines[moved], weights=parts[moved], minlength=count * width)
    return np.asarray(sums, dtype=np.float64).reshape(count, width)
