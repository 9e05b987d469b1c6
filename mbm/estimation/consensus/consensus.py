"""The units that agree → which rows count, from where to start, with what noise.

Consensus (`:robust`) leaves the units that agree. Losses (`:loss`) keep all units, but those whose minimum may hide
behind others are started where consensus is, and a noise factor that goes with a loss is estimated there, once and for
all (the M-step of MM-estimation, Yohai 1987): estimated together with the loss it would grow with every outlier.

If no start is known, consensus begins at the minimal-sample solution with the least median of squared residuals: a
closed form for all rows follows those that are grossly wrong. Far off, all equations say the same in the working
precision, or nearly so: no subset of them determines the unknowns there, and no few steps lead from there to what a
subset of good ones says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf, isfinite
from typing import TypeAlias

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.excerpt import excerpt
from mbm.equations.types import Floats
from mbm.estimation.consensus import faults
from mbm.estimation.consensus.agreeing import agreed, agreed_anywhere
from mbm.estimation.consensus.parts import agree_in_parts, parts_of
from mbm.estimation.consensus.rules import independent_columns
from mbm.estimation.consensus.scales import agree_beside_others, loss_noise
from mbm.estimation.consensus.truncated import agree_by_losses, fitted, informing, most_agreeing
from mbm.estimation.consensus.types import Agreed, Asked, Checked, Prepared, held_by, observed, with_loss
from mbm.estimation.consensus.units import Units, consistency, units_of, without_losses
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.search.starting import Beginning, with_idle_ones
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.minimal import minimal_solver
from mbm.estimation.starts.closed_forms.types import ClosedForm
from mbm.problem.kinds import ConsensusKind
from mbm.problem.requests import RandomStarts
from mbm.problem.types import Consensus, Method, Problem, UnknownKind
from mbm.solver.consensus_records import HELD_ROUNDS
from mbm.solver.decisions import ATTEMPTS, FAR, LEAST_SHARE, MANY_CONNECTED
from mbm.text.types import Diagnostic, MbmError

Starts: TypeAlias = Callable[[], tuple[Beginning, ...]]
"""Finds the points to start from, at least one; may raise MbmError."""

SAMPLE = 10_000
"""With more units the trials are judged by so many, drawn at random: the best of them is the best of all but for luck
that the last fits, to all units, do not depend on."""


def agreeing(
    problem: Problem, equations: Assembled, settings: Settings, consensus: Consensus, starts: Starts, checked: Checked
) -> Prepared:
    """The units that agree, by the consensus that the problem asks for; ``starts`` are looked for where they matter."""
    # graduated non-convexity narrows down from fits to all rows: which of the closed form's roots it begins at decides
    anywhere = settings.starts is None and consensus.kind is not ConsensusKind.GNC
    asked = Asked(problem=problem, settings=settings, consensus=consensus, ruled=observed, checked=checked)
    if _by_truncation(problem, consensus, equations):
        return _truncated(asked, equations, starts)
    found = _startless(asked, equations) if anywhere else None
    beginnings: tuple[Beginning, ...] = ()
    if found is None or found.share < LEAST_SHARE:  # what it began with may have been wrong itself
        try:
            beginnings = _told_apart(asked, equations, starts)
        except MbmError:
            if found is None:
                raise
    point = beginnings[0].point if found is None or beginnings else found.point
    units = units_of(equations, problem, point, observed)
    asked = replace(asked, held=held_by(equations, point, equations.equality))
    left = asked.left(equations)
    if found is None and units.scalars <= left:
        if problem.sequence is not None and equations.dimension:
            raise MbmError(faults.no_subset(problem.sequence.span, consensus.kind.value))
        return Prepared(equations=equations, starts=beginnings)
    if found is None or beginnings or equations.constraints:
        asked, found = _agreed(asked, equations, units, beginnings or (Beginning(point=point, origin=""),))
    if not found.inliers.any():  # no equation has a value anywhere near: the minimisation says which
        return Prepared(equations=equations, starts=beginnings or starts())
    return _prepared(asked, equations, units, found, beginnings)


def _by_truncation(problem: Problem, consensus: Consensus, equations: Assembled) -> bool:
    """Whether graduated non-convexity leads to truncated least squares by fits of all rows that are left: where it is
    asked for, of many unknowns, and of states, which subsets without transitions do not determine.
    """
    if consensus.kind is not ConsensusKind.GNC or not equations.dimension:
        return False
    large = equations.dimension > MANY_CONNECTED and max(len(p.columns) for p in parts_of(equations)) > MANY_CONNECTED
    return consensus.literal or large or problem.sequence is not None


def _truncated(asked: Asked, equations: Assembled, starts: Starts) -> Prepared:
    """The units that agree, by truncated least squares."""
    # Loaded by the problems that ask for it, so that others begin at once.
    from mbm.estimation.consensus.foremost import denied_step, foremost_ways, trusted_units
    from mbm.estimation.consensus.truncated import Way, agree_by_truncation

    units = units_of(equations, asked.problem, equations.numbers, asked.ruled)
    trusted = trusted_units(equations, units)
    ways = foremost_ways(equations, units, trusted, asked.settings)
    settled = bool(ways) and not bool((ways[0].held & ~trusted).any())
    beginnings: tuple[Beginning, ...] = ()
    stated = asked.settings.starts is not None or not _without_start(equations)
    if not ways or stated or not trusted.any():
        beginnings = _told_apart(asked, equations, starts)
    ways += [Way(start=each.point, origin=each.origin, held=trusted) for each in beginnings]
    if units.scalars == 0:
        return Prepared(equations=equations, starts=beginnings or starts())
    units = units_of(equations, asked.problem, ways[0].start, asked.ruled)
    found = agree_by_truncation(asked, equations, units, ways, trusted)
    if not found.inliers.any():
        return Prepared(equations=equations, starts=tuple(Beginning(point=w.start, origin=w.origin) for w in ways))
    made = _prepared(asked, equations, units, found, beginnings, settled=settled)
    denied = denied_step(equations, units, trusted, found.inliers)
    said = () if denied is None else (faults.denied_trust(asked.problem.span, *denied),)
    return replace(made, diagnostics=(*made.diagnostics, *said))


def _prepared(
    asked: Asked,
    equations: Assembled,
    units: Units,
    found: Agreed,
    beginnings: tuple[Beginning, ...],
    *,
    settled: bool = False,
) -> Prepared:
    """The equations of the units that agree, to be minimised from where they do.

    ``settled``: those that are trusted determine all unknowns, so that it needs no majority to tell which are wrong.
    """
    problem, consensus, settings = asked.problem, asked.consensus, asked.settings
    factors, noise = loss_noise(asked, equations, units, found)
    squares = units.squares(equations.plain_residuals(found.point))
    diagnostics: list[Diagnostic] = []
    told = settled or found.share >= LEAST_SHARE
    if not told:
        diagnostics.append(faults.too_few_agree(problem.span, int(found.inliers.sum()), units.count))
    elif found.ambiguous or not found.settled:  # what agrees holds other limits, and by these others agree
        diagnostics.append(faults.ambiguous_consensus(problem.span))
    return Prepared(
        equations=equations.kept(units.kept(equations, found.inliers)),
        starts=_from_agreement(found, consensus, settings, beginnings),
        factors=factors,
        noise=noise,
        truncation=_by_row(equations, units, consistency(units.components, found.limits / found.variances)),
        information=None if consensus.literal else _by_row(equations, units, informing(units, squares, found)),
        agreed=told,
        cut_short=found.cut_short,
        diagnostics=tuple(diagnostics),
    )


def scaled(problem: Problem, equations: Assembled, settings: Settings, search: Starts, checked: Checked) -> Prepared:
    """All units, from where consensus finds the losses' minimum, with noise factors from there; ``search`` as above."""
    unknown = any(block.loss is not None and block.unknown_factor for block in problem.blocks)
    convex = all(loss.convex for loss, _ in loss_lines(equations))
    if not unknown and convex:
        return Prepared(equations=equations, starts=search())
    consensus = Consensus(kind=ConsensusKind.LMEDS)
    asked = Asked(problem=problem, settings=settings, consensus=consensus, ruled=with_loss, checked=checked)
    starts = _told_apart(asked, equations, search)
    units = units_of(equations, problem, starts[0].point, with_loss)
    if units.scalars == 0:
        return Prepared(equations=equations, starts=starts)
    starts = _fitted_plainly(problem, equations, settings, starts)
    asked = replace(asked, held=held_by(equations, starts[0].point, equations.equality))
    few = equations.count < asked.left(equations)
    found = _all_agree(units, starts[0].point)
    if problem.sequence is not None and unknown:  # subsets without transitions tell no state
        found = agree_beside_others(asked, equations, units, starts[0].point, checked)
    elif not few:
        asked, found = _agreed(asked, equations, units, starts)
    factors, noise = loss_noise(asked, equations, units, found)
    return Prepared(
        equations=equations,
        starts=starts if few else _from_agreement(found, consensus, settings, starts),
        factors=factors,
        noise=noise,
        cut_short=found.cut_short,
        diagnostics=(faults.ambiguous_consensus(problem.span),) if found.ambiguous and not convex else (),
    )


def _fitted_plainly(
    problem: Problem, equations: Assembled, settings: Settings, starts: tuple[Beginning, ...]
) -> tuple[Beginning, ...]:
    """The starts, where plain squares lead from them if the equations do not determine the unknowns there.

    A closed form, or a fit to a subset, then lies anywhere, and far off a loss that ends is level.
    """
    plain = without_losses(equations)
    if equations.count >= equations.dimension:
        known = not _without_start(equations)
        if known or equations.dimension > MANY_CONNECTED or equations.count > SAMPLE or equations.implicit is not None:
            return starts
        if independent_columns(plain.jacobian(starts[0].point)) >= equations.dimension:
            return starts
    ends = [minimise(plain, start.point, settings, problem.span) for start in starts]
    order = sorted(range(len(ends)), key=lambda i: ends[i].cost if isfinite(ends[i].cost) else inf)
    return tuple(replace(starts[i], point=ends[i].point) for i in order)


def _all_agree(units: Units, point: Floats) -> Agreed:
    """What fewer equations than unknowns say: none contradicts another."""
    return Agreed(
        point=point,
        inliers=np.ones(units.count, dtype=bool),
        limits=np.full(units.count, np.inf),
        variances=np.ones(units.count),
        redundancy=np.zeros(units.count),
    )


def _agreed(asked: Asked, equations: Assembled, units: Units, starts: tuple[Beginning, ...]) -> tuple[Asked, Agreed]:
    """The units that agree, and what they were asked: with the limits that hold the fit to them put in.

    Equations that leave nothing free are put in as these are: the fit without them leads to the solution that is meant.
    """
    all_told = asked.held is not None and not asked.left(equations)
    asked = replace(asked, held=None) if all_told else asked
    found = _in_pieces(asked, equations, units, np.stack([start.point for start in starts]))
    bounded = bool((np.isfinite(equations.lower) | np.isfinite(equations.upper)).any())
    if equations.equality.all() and not bounded and not all_told:
        return asked, found
    before = equations.equality & (not all_told), np.zeros(equations.dimension, dtype=bool)
    for _ in range(HELD_ROUNDS):
        if not found.inliers.any():
            return asked, found
        end = fitted(asked, equations, units, found)
        forcing = equations.equality if end.constraints is None else end.constraints.forcing
        holding = forcing, end.at_bound != 0
        if all(map(np.array_equal, holding, before)) or not np.isfinite(end.cost):
            return asked, found
        before = holding
        asked = replace(asked, held=held_by(equations, end.point, *holding))
        found = _in_pieces(asked, equations, units, end.point[None])
    return asked, replace(found, settled=False)


def _in_pieces(asked: Asked, equations: Assembled, units: Units, points: Floats) -> Agreed:
    """The units that agree: in one piece, part by part, or, with very many connected unknowns, by way of losses."""
    if equations.dimension > 1:
        parts = parts_of(equations)
        found = []
        if _joins_poses(equations):
            from mbm.estimation.consensus.foremost import agree_foremost  # by these alone, so that others begin at once

            found = agree_foremost(asked, equations, units)
        if max(len(part.columns) for part in parts) > MANY_CONNECTED:
            return most_agreeing([*found, agree_by_losses(asked, equations, units, points[0])], units)
        if found:
            return found[0]
        if len(parts) > 1:
            return agree_in_parts(asked, equations, units, parts, points[0])
        if units.count > SAMPLE:
            return _agreed_from_sample(asked, equations, units, points)
    return agreed(asked, equations, points)


def _joins_poses(equations: Assembled) -> bool:
    """Whether rows measure motions between members of a family of poses."""
    families = [each for each in equations.layout.entries if each.unknown.kind is UnknownKind.POSE and each.members > 1]
    if not families:
        return False
    from mbm.estimation.starts.closed_forms.relative_poses import relates

    return any(group.rows and relates(group, each) for group in equations.groups for each in families)


def _startless(asked: Asked, equations: Assembled) -> Agreed | None:
    """The units that agree with what a closed form gives, where some unknown has no start of its own; None: unknown."""
    if equations.implicit is not None or not _without_start(equations) or _joins_poses(equations):
        return None
    if equations.whole > SAMPLE or (equations.dimension > 1 and len(parts_of(equations)) > 1):
        return None
    return agreed_anywhere(asked, equations)


def _told_apart(asked: Asked, equations: Assembled, starts: Starts) -> tuple[Beginning, ...]:
    """Starts at which the units that are ruled tell the unknowns apart, if closed forms give any.

    Raises:
        MbmError: there is no start, of whatever kind.

    """
    settings = asked.settings
    stated = settings.starts is not None or settings.method is Method.CLOSED_FORM
    if stated or equations.implicit is not None or not _without_start(equations) or equations.whole > SAMPLE:
        return starts()
    units = units_of(equations, asked.problem, equations.numbers, asked.ruled)
    try:
        found = starts()
    except MbmError:  # one row whose square has no value, and the cost has none at any start
        found = told_apart(equations, units, (), settings.closed_forms)
        if not found:
            raise
        return found
    return told_apart(equations, units, found, settings.closed_forms)


def _without_start(equations: Assembled) -> bool:
    """Whether some unknown has no start of its own."""
    missing = np.isnan(equations.layout.start) | equations.layout.guessed
    return bool((missing & equations.moving()).any())


def _agreed_from_sample(asked: Asked, equations: Assembled, units: Units, starts: Floats) -> Agreed:
    """Consensus of a sample of the units, then all units that agree with it."""
    generator = np.random.Generator(np.random.PCG64(asked.settings.seed))
    chosen = np.sort(generator.choice(units.count, SAMPLE, replace=False))
    rows = np.flatnonzero((units.of_row < 0) | np.isin(units.of_row, chosen))
    found = agreed(asked, excerpt(equations, equations.free, np.unique(equations.units[rows])), starts)
    whole = agreed(asked, equations, found.point[None], near=True)
    return replace(whole, trials=found.trials, ambiguous=found.ambiguous, cut_short=found.cut_short)


def _from_agreement(
    found: Agreed, consensus: Consensus, settings: Settings, starts: tuple[Beginning, ...]
) -> tuple[Beginning, ...]:
    """Where units agree; then the points of `:starts`, for other minima (the first random one is what it would be)."""
    agreeing = Beginning(point=found.point, origin=f"consensus ({consensus.kind.value})")
    if settings.starts is None:
        return (agreeing,)
    return (agreeing, *(starts[1:] if isinstance(settings.starts, RandomStarts) else starts))


def _by_row(equations: Assembled, units: Units, values: Floats) -> Floats:
    """Values (U,) by residual (all residuals,), 1 where no rule acts, and for losses: their sandwich sees it itself."""
    found = units.expanded(values)
    for _, lines in loss_lines(equations):
        found[lines] = 1.0
    return found


def told_apart(
    equations: Assembled, units: Units, starts: tuple[Beginning, ...], closed_forms: tuple[ClosedForm, ...]
) -> tuple[Beginning, ...]:
    """The starts, or what a few units give in closed form, if the first start is far off.

    It is where the ``units`` leave unknowns open there, or where the median of their misfits is `FAR` times that of a
    closed form of units behind one another, at which all units determine all unknowns. The one with the least median
    is taken, in all its solutions; where there is no such, the starts stay. There may be none to begin with.
    """
    plain = without_losses(equations)
    solver = minimal_solver(plain, with_idle_ones(plain, plain.numbers), closed_forms)
    if solver is None:
        return starts
    size = solver.plan.minimal
    behind = units.number[np.arange(min(max(units.count - size + 1, 0), ATTEMPTS))[:, None] + np.arange(size)]
    with np.errstate(all="ignore"):
        points, which = solver.points(behind)
        medians = _medians(plain, units, points)
        far = not starts or not _told(plain, units, starts[0].point)
        limit = np.inf if far else float(_medians(plain, units, starts[0].point[None])[0]) / FAR**2
        for one in np.argsort(medians, kind="stable").tolist():
            if not medians[one] < limit:
                break
            if _told(plain, units, points[one]):
                mine = points[which == which[one]]
                return tuple(Beginning(point=point, origin=solver.plan.description) for point in mine)
    return starts


def _medians(plain: Assembled, units: Units, points: Floats) -> Floats:
    """The median of the units' squared misfits at each point (P,); infinite where most have no value."""
    if not len(points):
        return np.empty(0)
    return np.asarray(np.median(units.squares(plain.residuals_at(points)), axis=1))


def _told(plain: Assembled, units: Units, point: Floats) -> bool:
    """Whether the units determine all unknowns, as far as the derivatives at a point say."""
    with np.errstate(all="ignore"):
        jacobian = plain.plain_jacobian(point)
    return independent_columns(jacobian[units.of_row >= 0]) >= plain.dimension
