"""The ends of many descents → what is known of them, in columns, and which of them need a look by themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.faults import PRIOR_AGAINST_DATA
from mbm.equations.losses import loss_weights, rooted_residuals, rooted_slopes
from mbm.equations.metric import roundings
from mbm.equations.solves import Counted, counted_of, mean_roots, used_rows
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.components import degrees_columns, informing_slopes
from mbm.estimation.batches.doubts import doubtful, stationary
from mbm.estimation.batches.factor import (
    Factors,
    Spread,
    counted,
    factors,
    informed,
    sandwiches,
)
from mbm.estimation.batches.portion import DerivedColumns, Portion, derived_columns, stated
from mbm.estimation.batches.raw import rows_of
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.surface import held_back, limited_columns, near_limits
from mbm.estimation.batches.types import Columns, Descent, Ends, Kept, Limits, Remarks, Rows, Which, places_of
from mbm.estimation.consensus.units import outlying
from mbm.estimation.minimise.native.tails import chi_square_tails, solver_code
from mbm.estimation.trust import faults
from mbm.estimation.trust.behind import mostly_behind, turned_anyhow
from mbm.estimation.trust.coarse import of_readings, uneven_rows
from mbm.estimation.trust.fits import Fits, Said
from mbm.estimation.trust.hidden import hidden_outliers
from mbm.estimation.trust.plausibility import (
    IMPROBABLE,
    UNLIKELY,
    follows_statement,
    improbable,
    improbable_noise,
    overstated,
    strained,
)
from mbm.expression.nodes import Column, leaves
from mbm.problem.types import Block, BlockRole, Problem
from mbm.solver.decisions import usual_cost
from mbm.text.types import Diagnostic
from mbm.values import once

if TYPE_CHECKING:
    from mbm.estimation.batches.surface import Held
    from mbm.estimation.batches.types import Tangents


@np.errstate(all="ignore")
def answers(problem: Problem, stack: Stack, which: Which, descent: Descent, *, examined_alone: bool) -> Columns:
    """The answers of some solves; where they are ``examined_alone``, no column says all of a solve."""
    began, ends = perf_counter(), descent(which)
    portion = Portion(stack, which, ends.kept, ends.factors)
    count = stack.residuals[places_of(which)] if ends.kept is None else ends.kept.count
    residuals, slopes = portion.linearised(ends.points)
    lossy = stack.equations.lossy
    rooted = rooted_slopes(portion.acting(), residuals, slopes) if lossy else slopes
    counts = counted_of(portion, residuals, count)
    surface = _surface(portion, ends, rooted)
    found = factors(informing_slopes(stack, which, ends, rooted), None if surface is None else surface[1])
    solved = ends.minima & found.good
    freedom = counts.rows - stack.equations.dimension + (0 if surface is None else surface[1].taken)
    solved &= (freedom >= 0) & ~stationary(portion, ends, found, rooted)
    left = np.ones((1, 1)) if ends.kept is None else portion.by_slot(ends.kept.left)  # of cut-off variance
    scattered = ends.cost if ends.kept is None else (np.square(residuals) / left).sum(axis=1)
    unknown = [i for i, block in enumerate(problem.blocks) if block.unknown_factor]
    known, cost = not unknown, counts.cost if lossy or stack.equations.likely else ends.cost
    common = not known and ends.factors is None
    solved &= (not common) | ((freedom > 0) & (ends.cost > _rounded_costs(stack, ends, found)))
    noise = np.sqrt(scattered / np.maximum(freedom, 1)) if common else np.ones(len(which))
    if ends.factors is not None and len(unknown) == 1:
        cost = _as_stated(portion, residuals, unknown[0], ends.factors)
    spread = _spread(problem, portion, residuals, slopes, found, noise, ends.kept)
    reported, owners = stack.equations.layout.reported(ends.points), enumerate(problem.derived)
    derived = tuple(derived_columns(each, owner, stack, reported, spread.factor) for owner, each in owners)
    solved &= spread.sound & np.isfinite(cost) & _all_finite([one.sigma for one in derived], len(which))
    sigma0 = np.where(freedom > 0, np.sqrt(cost / np.maximum(freedom, 1)), np.nan)
    tails = _tails(stack, counts, cost if lossy else counts.tested(scattered), freedom, solved & known)
    chi2_p = np.full(len(which), np.nan) if lossy else np.where(counts.untested, np.nan, tails)
    undoubted = _undoubted(problem, portion, ends, found, spread, derived, residuals, surface)
    degrees = degrees_columns(problem, portion, spread, derived, (freedom.astype(np.float64), ends.cost), counts.limits)
    limited = limited_columns(portion, surface and surface[0], ends.points)
    undoubted &= ~near_limits(problem, portion, ends, (surface and surface[0], limited), spread, degrees)
    counting = counted(portion, residuals)
    fits = _fits(problem, stack, portion, residuals, found, spread, noise, surface)
    return Columns(
        points=ends.points,
        cost=cost,
        least=ends.cost,
        robust_cost=ends.cost - counts.uncounted,
        reason=ends.reason,
        iterations=ends.iterations,
        evaluations=ends.evaluations,
        dof=freedom,
        sigma0=sigma0,
        chi2_p=chi2_p,
        noise=np.where(_unknown(problem), noise[:, None], 1.0) if ends.factors is None else ends.factors,
        sigma=spread.sigma,
        factor=spread.factor,
        root=spread.root,
        scale=spread.scale,
        derived=tuple((one.values, one.sigma, one.image) for one in derived),
        rms=mean_roots(portion.lines, residuals, counting, len(problem.blocks)) / noise[:, None],
        used=used_rows(portion.lines, counting, len(problem.blocks)),
        outliers=_outliers(problem, stack, portion, ends, residuals),
        counting=counting if lossy or ends.kept is not None else None,
        priors=_priors(problem, stack, portion, ends.points),
        clean=solved & undoubted & (lossy | ~(tails < IMPROBABLE)) & (not examined_alone),
        solved=solved,
        expected=(ends.cost < _usual_costs(freedom)) & known,
        challenged=_challenged(ends, other=lossy or stack.equations.likely or surface is not None),
        log_likelihood=counts.log_likelihood,
        degrees=replace(degrees, limited=limited),
        remarks=_remarks(fits, _seen(fits, stack, ends, spread.sigma), sigma0, tails, degrees.poor),
        limits=_limits(problem, stack, portion, ends, surface),
        seconds=np.full(len(which), (perf_counter() - began) / len(which)),
    )


REMARKED = frozenset(
    code.name
    for code in (
        PRIOR_AGAINST_DATA,
        faults.ANY_TURN,
        faults.AUTOCORRELATED_RESIDUALS,
        faults.BEHIND_CAMERA,
        faults.COARSE_READINGS,
        faults.HIDDEN_OUTLIERS,
        faults.IMPROBABLE_NOISE,
        faults.OUTLYING_ROW,
        faults.READINGS_AT_EDGE,
        faults.REPEATED_EQUATIONS,
        faults.SMALL_SAMPLE,
        faults.UNEVEN_NOISE,
        faults.WEIGHTS_FROM_READINGS,
    )
)
"""The codes of the warnings whose numbers follow from columns."""


def _fits(
    problem: Problem,
    stack: Stack,
    portion: Portion,
    residuals: Floats,
    found: Factors,
    spread: Spread,
    noise: Floats,
    surface: tuple[Held, Tangents] | None,
) -> Fits:
    """K solves with plain ``residuals`` (K, m), as those see them who look at what these tell."""
    return Fits(
        problem=problem,
        tables=stack.tables,
        solves=portion,
        residuals=rooted_residuals(portion.acting(), residuals),
        pull=residuals * loss_weights(portion.acting(), residuals),
        basis=found.basis,
        image=spread.basis,
        noise=noise,
        held=np.zeros(portion.count, dtype=bool) if surface is None else np.asarray(surface[0].forcing.any(axis=1)),
        stated=once(portion.deviations),
        redundancy=lambda place: 1.0 - np.square(spread.basis[place]).sum(axis=1),
    )


def _seen(fits: Fits, stack: Stack, ends: Ends, sigma: Floats) -> Said:
    """Whether solves turn their backs on what is seen, or may be turned in any way; ``sigma`` (K, n) are deviations."""
    yield from mostly_behind(
        fits.problem, fits.solves, len(sigma), partial(rows_of, fits.problem, stack, points=ends.points)
    )
    yield from turned_anyhow(stack.equations.layout, stack.equations.free, sigma)


def _remarks(fits: Fits, seen: Said, sigma0: Floats, tails: Floats, poor: Mask) -> Remarks:
    """The warnings about K solves, of a χ² with the probability ``tails`` (K,) of one as large; ``seen`` come first.

    ``sigma0`` (K,) is the root mean square of the residuals per degree of freedom. ``poor`` (K,): the noise is told by
    too few rows.
    """
    span, unlikely = fits.problem.span, improbable(tails, sigma0, lossy=fits.solves.equations.lossy)
    noise = (
        (k, partial(improbable_noise, span, float(sigma0[k]), float(tails[k])))
        for k in np.flatnonzero(unlikely).tolist()
    )
    small = ((place, partial(faults.small_sample, span)) for place in np.flatnonzero(poor).tolist())
    rows = uneven_rows(fits, overstated(tails, sigma0))
    said: tuple[Said, ...] = (seen, noise, hidden_outliers(fits), rows, of_readings(fits), small, strained(fits))
    found: dict[int, tuple[Callable[[], Diagnostic], ...]] = {}
    for place, make in chain.from_iterable(said):
        found[place] = (*found.get(place, ()), make)
    return found


def _surface(portion: Portion, ends: Ends, jacobian: Floats) -> tuple[Held, Tangents] | None:
    """The constraints at the ends, and what they leave free; None where there are no constraints."""
    if ends.multipliers is None:
        return None
    # Here and below: loaded by problems with constraints only, so that the others start at once.
    from mbm.estimation.batches.surface import held, tangents

    found = held(portion, ends.points, jacobian, ends.cost, ends.multipliers)
    return found, tangents(found, jacobian)


def _undoubted(
    problem: Problem,
    portion: Portion,
    ends: Ends,
    found: Factors,
    spread: Spread,
    derived: tuple[DerivedColumns, ...],
    residuals: Floats,
    surface: tuple[Held, Tangents] | None,
) -> Mask:
    """Solves (K,) whose quantities all have values, and of which nothing more is to be said."""
    fine = _all_finite([one.values for one in derived], portion.count)
    if surface is None:
        return fine & ~doubtful(problem, portion, ends, found, spread, derived, residuals, None)
    from mbm.estimation.batches.doubts import curved

    fine &= ~held_back(surface[0])
    fine &= ~curved(portion, ends, surface[0], found, spread.deviation)
    return fine & ~doubtful(problem, portion, ends, found, spread, derived, residuals, surface[1])


def _limits(
    problem: Problem, stack: Stack, portion: Portion, ends: Ends, surface: tuple[Held, Tangents] | None
) -> Limits | None:
    """What is to be said of the constraints; None where there are none."""
    if surface is None or ends.multipliers is None:
        return None
    from mbm.estimation.batches.surface import limits

    return limits(problem, stack, portion, *surface, ends.multipliers)


def _unknown(problem: Problem) -> Mask:
    """Blocks (blocks,) whose noise is unknown."""
    return np.array([block.unknown_factor for block in problem.blocks], dtype=bool)


def _as_stated(portion: Portion, residuals: Floats, owner: int, factors: Floats) -> Floats:
    """The cost (K,) with the residuals (K, m) of one block not divided by its factor."""
    solve, slot = portion.block_slots(owner)
    whole = residuals.copy()
    whole[solve, slot] *= factors[solve, owner]
    return np.asarray(np.square(whole).sum(axis=1))


def _rounded_costs(stack: Stack, ends: Ends, found: Factors) -> Floats:
    """The costs (K,) that are nothing but rounding."""
    places = stack.equations.layout.number[stack.equations.free]
    return np.square(roundings(found.scale, ends.points, places, ends.cost))


def _usual_costs(freedom: Indices) -> Floats:
    """What fits with so many degrees of freedom (K,) usually cost: a few numbers, as a rule."""
    distinct, place = np.unique(freedom, return_inverse=True)
    return np.array([usual_cost(float(each)) for each in distinct])[place]


def _challenged(ends: Ends, *, other: bool) -> Mask:
    """Solves (K,) that `challenge` does not leave alone: no outliers were looked for, they began at a stated start,
    nothing has compared them on the way, and they are of no ``other`` kind than plain equations.
    """
    if ends.kept is not None or ends.factors is not None or other:
        return np.zeros(len(ends.cost), dtype=bool)
    given = np.ones(len(ends.cost), dtype=bool) if ends.given is None else ends.given
    return given if ends.compared is None else given & ~ends.compared


def _spread(
    problem: Problem,
    portion: Portion,
    residuals: Floats,
    slopes: Floats,
    found: Factors,
    noise: Floats,
    kept: Kept | None,
) -> Spread:
    """How far estimates scatter, with the factor ``noise`` (K,), by what rows that are ``kept`` inform (None: 1)."""
    information = None if kept is None else portion.by_slot(kept.information)
    root, scale, basis = found.root, found.scale, found.basis
    every = np.ones(len(noise), dtype=bool)
    if information is None and not portion.equations.lossy:
        return Spread(
            factor=root * noise[:, None, None],
            root=root,
            scale=scale,
            basis=basis,
            deviation=noise,
            looked_at=every,
            sound=every,
        )
    if information is None:
        bread = sandwiches(portion, residuals, slopes, root, _unknown(problem), found.gone)
    else:
        bread = informed(information, basis)
    along = np.matmul(root, bread.own)
    if information is not None:
        root, scale = along, np.sqrt((np.square(slopes) * information[:, :, None]).sum(axis=1))
    return Spread(
        factor=along * noise[:, None, None],
        root=root,
        scale=scale,
        basis=np.matmul(basis, bread.own),
        deviation=bread.deviation * noise,
        looked_at=bread.plain,
        sound=bread.sound,
    )


def _priors(problem: Problem, stack: Stack, portion: Portion, points: Floats) -> Floats:
    """How far points (K, N) are from what is known beforehand (K, k); nothing where solves know different things."""
    none = np.zeros((len(points), 0))
    found = [none]
    for number, group in enumerate(stack.equations.groups):
        if group.role is not BlockRole.PRIOR:
            continue
        block = problem.blocks[group.kernel.owner]
        if group.positions is None:
            found.append(stated(group, points))
        elif portion.as_many_rows(number) and (block.table not in stack.arranged.spans or not _reads_columns(block)):
            found.append(portion.values(number, points).reshape(len(points), -1))
        else:
            return none
    return np.hstack(found)


def _reads_columns(block: Block) -> bool:
    """Whether the equations of a block differ by row in more than the members that they speak of."""
    equations = (equation for case in block.cases for equation in case.equations)
    nodes = tuple(node for each in equations for node in each.stated)
    by_row = block.when is not None or len(block.cases) > 1
    return by_row or any(isinstance(leaf, Column) for leaf in leaves(nodes))


def _outliers(
    problem: Problem, stack: Stack, portion: Portion, ends: Ends, residuals: Floats
) -> tuple[Rows | None, ...]:
    """The rows of each block of which an equation was left out, or is far off under a loss, by solve."""
    found: list[Rows | None] = [None] * len(problem.blocks)
    far = outlying(portion.acting(), residuals)
    every = (None,) * len(portion.lines) if ends.kept is None else ends.kept.outputs
    for each, outputs in zip(portion.lines, every, strict=True):
        owner, positions = each.group.kernel.owner, each.positions
        table = problem.blocks[owner].table
        if table is None or positions is None or (outputs is None and not each.group.losses):
            continue
        wrong = (far[each.solve[:, None], each.slots] if outputs is None else ~outputs).any(axis=1)
        mine = Rows.of_rows(stack.tables[table], positions[wrong], each.solve[wrong], portion.count)
        before = found[owner]
        found[owner] = mine if before is None else before.joined(mine)
    return tuple(found)


def _tails(stack: Stack, counts: Counted, cost: Floats, freedom: Indices, solved: Mask) -> Floats:
    """P(χ² > cost) (K,); NaN without degrees of freedom, where nothing is solved, or nothing follows stated noise.

    Where χ² says nothing but that counts scatter too much, it is NaN where it does not say that.
    """
    result = np.full(len(cost), np.nan)
    if stack.equations.lossy and not follows_statement(stack.equations):
        return result
    asked = solved & (freedom > 0) & ~np.isnan(counts.larger)
    tested = (cost / counts.larger)[asked]
    result[asked] = chi_square_tails(solver_code(stack.equations), tested, freedom[asked])
    return np.where(counts.untested & ~(result < UNLIKELY), np.nan, result)


def _all_finite(parts: Sequence[Floats], count: int) -> Mask:
    found = np.ones(count, dtype=bool)
    for part in parts:
        found &= np.isfinite(part).all(axis=1)
    return found
