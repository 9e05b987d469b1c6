"""Other minima beside one that a single start has led to, as far as the data do not exclude them.

From the minimum along rays: the directions of the coordinates' intervals and those of the singular vectors, both ways,
at distances from a few standard deviations to tens of thousands. Where the cost is far below that of a linear model, or
falls again, another basin may begin: the most promising of these points are followed down, all at once. Of silhouettes
only what lies beyond the edge-on view of a face is looked at.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled
from mbm.equations.metric import column_norms, rounding_at
from mbm.equations.surface import exact_constraints, on_surface
from mbm.equations.turning import may_turn
from mbm.equations.types import Fit, Floats, Mask, Minimum
from mbm.estimation.minimise.minimise import minima
from mbm.estimation.search.basins import EQUAL, Basin, merged, same_minimum, without_twins
from mbm.estimation.search.search import Alternative, other_minimum
from mbm.estimation.search.starting import LARGE
from mbm.estimation.search.twins import Agreement, Twin, separation
from mbm.estimation.search.valleys import RANK, Walks, flat
from mbm.estimation.settings import Settings
from mbm.estimation.starts.random_starts import costs
from mbm.expression.nodes import External
from mbm.problem.manifold import Piece
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

PLAUSIBLE = 9.0
"""A minimum whose Σ r² is larger by less is not excluded: three standard deviations, were it one of two hypotheses."""

BOTH_ZERO = 1e-6
"""What Σ r² may differ by where both are zero."""

DISTANCES = 8.0 * 2.0 ** np.arange(13)
"""Standard deviations at which points on a ray are looked at: 8 to 33,000 …"""

RESIDUALS, LEAST = 60_000, 3
"""… fewer where these are more residuals in all than that, but so many at least."""

FEW = 5
"""Distances along a ray where each point takes a search: for corrections of measured columns, or back to the surface of
constraints; 8 to 2,000 standard deviations, since from farther away the search does not come back."""

CURVED = 0.5
"""Share of the cost of a linear model below which a point may lie in another basin (`decisions.SAME_BASIN`)."""

FOLLOWED, FEW_FOLLOWED = 6, 2
"""Points that are followed down, and with corrections of measured columns, which take a search at each step."""

AT_FIRST = 12
"""Steps of a descent at first …"""

NEARLY = 30.0
"""… after which it goes on if it costs less above the minimum than so many times what is allowed."""

BACK = 1e-2
"""Squared standard deviations below which an end is at the minimum again, by the derivatives there."""

ROUGHLY = 1e-4
"""Share of the largest residual by which those of two minima differ that no observation tells apart, where a descent
has ended with moderate accuracy; EQUAL afterwards."""

POSITIVE = 1e-2
"""Share of its value at the minimum that a positive number keeps, and the scale of a similarity."""

ASYMPTOTIC = 1e-6
"""What residuals may change by, beside the largest, where a coordinate that went far goes as far again."""

MOST_UNKNOWNS = 20
"""Unknowns above which the search would cost more than the solve."""


def looks_beside(equations: Assembled, settings: Settings, problem: Problem) -> bool:
    """Whether other minima are looked for beside the one of a single start."""
    asked = settings.starts is not None or settings.robust is not None or not settings.iterative
    there = min(equations.count, equations.dimension) > 0
    return there and not asked and not straight(equations) and why_not(equations, problem) is None


def straight(equations: Assembled) -> bool:
    """Whether there is one minimum at most: equations are linear, and so is what constrains them."""
    return equations.linear and bool(exact_constraints(equations).all())


def why_not(equations: Assembled, problem: Problem) -> str | None:
    """Why other minima are not looked for beside a single start; None where they are."""
    if problem.sequence is not None:
        return "the problem has states"
    if equations.lossy and problem.estimates_noise:
        return "unknown noise under a loss"
    if equations.structure is not None:
        return "rows share noise"
    if equations.rows is not None:
        return "rows are left out by consensus"
    if any(isinstance(call.external, External) for group in equations.groups for call in group.kernel.calls):
        return "functions in Python are called"
    if equations.implicit is not None and equations.constraints:
        return "there are constraints beside errors in columns"
    if equations.dimension > MOST_UNKNOWNS or equations.count * equations.dimension > LARGE:
        return f"more than {MOST_UNKNOWNS} unknowns, or too many rows for so many unknowns"
    return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centre:
    """A minimum, beside which others that cost ``most`` at most are of interest.

    ``factor`` (n, k) is that of its covariance, ``variance`` that of the noise which is in it. ``told`` is −2 log L
    where the cost is no χ², since unknowns decide the weights.
    """

    minimum: Minimum
    factor: Floats
    variance: float
    most: float
    told: float | None


def centre(minimum: Minimum, factor: Floats, fit: Fit, likelihood: float | None, *, scaled: bool) -> Centre:
    """Beside a minimum those that the data do not exclude; if unknown noise is ``scaled`` to, in units of its estimate.

    ``likelihood`` is log L where the cost is no χ².
    """
    variance = minimum.cost / fit.dof if scaled and fit.dof > 0 else 1.0
    return Centre(
        minimum=minimum,
        factor=factor,
        variance=variance,
        most=minimum.cost + PLAUSIBLE * variance + BOTH_ZERO,
        told=None if likelihood is None else -2.0 * likelihood,
    )


def minima_beside(
    equations: Assembled, about: Centre, settings: Settings, problem: Problem, agrees: Agreement
) -> tuple[Alternative, ...]:
    """The other minima, the lowest first.

    What is one solution written twice is none. Of minima that are equal in all residuals no observation says which is
    meant: the start does, where one is stated, and then they are none either.
    """
    minimum, most = about.minimum, about.most
    found_well = minimum.reason.converged and minimum.blocks is None and bool(np.isfinite(minimum.cost))
    if not found_well or not looks_beside(equations, settings, problem):
        return ()
    walks = Walks(equations, settings.stopped)
    found = [
        Basin(minimum=each, starts=np.array([1 + number]))
        for number, each in enumerate(_ends(equations, about, settings, problem))
        if each.reason.converged and each.cost <= most and not same_minimum(walks, minimum, each)
    ]
    found = [each for each in found if not _collapsed(equations, each.minimum.point, minimum.point)]
    found = [each for each in found if not _endless(equations, about, each.minimum)]
    found = [each for each in found if not _chosen(equations, minimum, each.minimum.point[None], EQUAL)[0]]
    if not found:
        return ()
    own = Basin(minimum=minimum, starts=np.array([0]))
    others = without_twins(equations, (own, *merged(walks, found)), agrees)[1:]
    return tuple(
        other_minimum(equations, each.minimum, len(each.starts), mirrored=each.twin is Twin.MIRRORED) for each in others
    )


def rivals(
    problem: Problem, equations: Assembled, about: Centre, alternatives: Sequence[Alternative]
) -> tuple[Diagnostic, ...]:
    """A warning where other minima cost so little that the data do not exclude them."""
    near = [a for a in alternatives if a.minimum.cost <= about.most]
    if not near:
        return ()
    first = near[0]
    costs, what = _costs(equations, about, first.minimum), _what_costs(equations, about)
    return (faults.another_solution(problem.span, len(near), costs, what, mirrored=first.mirrored),)


def _costs(equations: Assembled, about: Centre, other: Minimum) -> tuple[float, ...]:
    """Those of another minimum and of the best, 0 where that is rounding."""
    best = about.minimum
    if about.told is not None:
        return about.told + other.cost - best.cost, about.told
    least = rounding_at(equations, best) ** 2
    return tuple(cost if cost > least else 0.0 for cost in (other.cost, best.cost))


def _what_costs(equations: Assembled, about: Centre) -> str:
    """What the cost is called."""
    return "sum of the losses" if equations.lossy else "cost" if about.told is None else "−2 log L"


def endless(
    problem: Problem, equations: Assembled, about: Centre, ends: Sequence[Alternative]
) -> tuple[Diagnostic, ...]:
    """A warning for each of the ``ends`` of `unfelt` coordinates that the data do not exclude."""
    found: dict[tuple[str, ...], tuple[float, ...]] = {}
    for end in ends:
        going = unfelt(equations, about, end.minimum)
        numbers = equations.layout.number[equations.free]
        names = tuple(
            f"`{entry.unknown.name}` → {'∞' if step > 0.0 else '−∞'}"
            for number, step in zip(numbers[going != 0.0].tolist(), going[going != 0.0].tolist(), strict=True)
            for entry in equations.layout.entries
            if entry.range.start <= number < entry.range.stop
        )
        if end.minimum.cost <= about.most:
            found.setdefault(tuple(dict.fromkeys(names)), _costs(equations, about, end.minimum))
    what = _what_costs(equations, about)
    return tuple(faults.open_ended(problem.span, names, costs, what) for names, costs in found.items())


@np.errstate(all="ignore")
def unfelt(equations: Assembled, about: Centre, end: Minimum) -> Floats:
    """How far plain coordinates (n,) have gone from the best to an end where nothing is felt of going as far again; 0
    of all others. The cost approaches a value there, and the end is no minimum.
    """
    best, layout, free = about.minimum, equations.layout, equations.free
    going = end.point[layout.number[free]] - best.point[layout.number[free]]
    if end.blocks is not None:
        return np.zeros_like(going)
    slopes = end.jacobian if end.constraints is None else np.vstack([end.jacobian, end.constraints.slopes])
    spread = max(float(np.sqrt(about.variance)), rounding_at(equations, best))
    far = np.abs(going) * np.linalg.norm(best.jacobian, axis=0) > DISTANCES[0] * spread
    able = far & (layout.number[free] >= 0) & ~layout.angle[free] & (end.at_bound == 0)
    going = np.where(able & (np.abs(slopes * going) < ASYMPTOTIC * spread).all(axis=0), going, 0.0)
    if not going.any():
        return going
    there = equations.residuals(equations.retract(end.point, going))
    off = np.abs(there - end.residuals).max(initial=0.0)
    return going if off <= ASYMPTOTIC * max(spread, np.abs(end.residuals).max(initial=0.0)) else np.zeros_like(going)


def _ends(equations: Assembled, about: Centre, settings: Settings, problem: Problem) -> Iterable[Minimum]:
    """Where descents from points in other basins, perhaps, end."""
    if any(group.kernel.calls for group in equations.groups):
        # Loaded by silhouettes only, so that the others start at once.
        from mbm.estimation.search.contours import minima_beyond

        return minima_beyond(equations, about.minimum, settings, problem)
    trials = _promising(equations, about)
    points = trials if equations.constraints or not len(trials) else _followed(equations, about, settings, trials)
    return minima(equations, points, settings, problem.span)


def _followed(equations: Assembled, about: Centre, settings: Settings, trials: Floats) -> Floats:
    """Where points (T, N) lead to in some steps, as far as it is elsewhere, and may cost little enough."""
    # Loaded where a point is followed only, so that other problems start at once.
    from mbm.estimation.minimise.native.minimum import ends_of_starts

    minimum = about.minimum
    ends = ends_of_starts(equations, trials, AT_FIRST, settings)
    low = np.flatnonzero(ends.cost <= minimum.cost + NEARLY * (about.most - minimum.cost))
    apart = separation(equations, minimum.point, ends.points[low]) * column_norms(minimum.jacobian)
    points = ends.points[low[np.square(apart).sum(axis=1) > BACK * about.variance]]
    return np.asarray(points[~_chosen(equations, minimum, points, ROUGHLY)]) if len(points) else points


def _chosen(equations: Assembled, minimum: Minimum, points: Floats, share: float) -> Mask:
    """Which points (T, N) are equal to the minimum in all residuals, so that a start that is stated has chosen it.

    Up to their signs: a line with its normal turned round has the opposite distances. Differences that turn with the
    unknowns are equal if they are as long: a scene about its only anchor may be turned, and seen in a mirror.
    """
    own = _lengths(equations, minimum.residuals)
    apart = np.abs(_lengths(equations, equations.residuals_at(points)) - own).max(axis=1, initial=0.0)
    layout = equations.layout
    stated = np.isfinite(layout.start) & ~layout.guessed
    decided = (stated & (points != minimum.point)).any(axis=1)
    return np.asarray(decided & (apart <= share * (1.0 + own.max(initial=0.0))))


def _lengths(equations: Assembled, residuals: Floats) -> Floats:
    """The sizes of residuals (…, m): of those that movements may turn the lengths of their units."""
    units = np.where(may_turn(equations), equations.units, -1 - np.arange(equations.count))
    first = np.flatnonzero(np.diff(units, prepend=np.nan))
    return np.sqrt(np.add.reduceat(np.square(residuals), first, axis=-1))


def _collapsed(equations: Assembled, point: Floats, inside: Floats) -> bool:
    """Whether a scale goes to zero, where no similarity is: the cost falls towards a limit there, to no minimum."""
    scales = [one.numbers for one in equations.layout.curved if one.piece is Piece.SCALE]
    return any(bool((point[places] < POSITIVE * inside[places]).any()) for places in scales)


def _endless(equations: Assembled, about: Centre, end: Minimum) -> bool:
    """Whether the cost falls towards a limit in the infinite, as that of circles does that become a line.

    The end of a descent is then farther away than points were looked at, and the unknowns are not determined there.
    """
    places, lengths = equations.layout.number[equations.free], np.linalg.norm(about.factor, axis=1)
    plain = (places >= 0) & np.isfinite(lengths)
    away = np.abs(end.point - about.minimum.point)[places[plain]]
    return bool((away > DISTANCES[-1] * lengths[plain]).any()) and flat(equations, end, RANK)


def _promising(equations: Assembled, about: Centre) -> Floats:
    """Points (T, N) on rays from a minimum in other basins, perhaps: where the cost falls, and where it is flattest."""
    minimum, rays = about.minimum, _rays(about.factor)
    if not len(rays):
        return np.empty((0, len(minimum.point)))
    distances = _distances(equations, rays)
    steps = (rays[:, None, :] * distances[:, :, None]).reshape(-1, rays.shape[1])
    surface = on_surface(equations, minimum) or equations
    points = _within(equations, surface.retract(np.tile(minimum.point, (len(steps), 1)), steps), minimum.point)
    found = _plain_costs(equations, np.vstack([points, minimum.point]))
    grown = found[:-1].reshape(distances.shape) - found[-1]
    with np.errstate(invalid="ignore"):
        share = grown / (about.variance * np.square(distances))
        falls = np.concatenate([np.zeros((len(rays), 1), dtype=bool), grown[:, 1:] < grown[:, :-1]], axis=1)
    lowest = np.where(falls, grown, np.inf).argmin(axis=1)
    flattest = np.where(np.isfinite(share), share, np.inf).argmin(axis=1)
    line, none = np.arange(len(rays)), np.full(len(rays), np.inf)
    first = np.where(falls[line, lowest], grown[line, lowest], none)
    second = np.where(
        (share[line, flattest] < CURVED) & ((flattest != lowest) | np.isinf(first)), share[line, flattest], none
    )
    order = [*np.argsort(first, kind="stable")[: int(np.isfinite(first).sum())].tolist()]
    further = [*np.argsort(second, kind="stable")[: int(np.isfinite(second).sum())].tolist()]
    chosen = [
        *(distances.shape[1] * k + lowest[k] for k in order),
        *(distances.shape[1] * k + flattest[k] for k in further),
    ]
    count = FOLLOWED if equations.implicit is None else FEW_FOLLOWED
    return points[np.array(chosen[:count], dtype=np.int64)]


def _plain_costs(equations: Assembled, points: Floats) -> Floats:
    """Σ r² at points (T, N) without losses, which are level far away; infinite where an equation has no value."""
    if not equations.lossy and equations.implicit is None:
        return costs(equations, points)
    with np.errstate(all="ignore"):
        plain = equations.implicit is None
        found = equations.plain_residuals_at(points) if plain else equations.residuals_at(points)
        found = np.square(found).sum(axis=1)
    return np.where(np.isfinite(found), found, np.inf)


def _rays(factor: Floats) -> Floats:
    """Steps (p, n) of one standard deviation in some directions, each with its opposite."""
    lengths = np.linalg.norm(factor, axis=1)
    known = np.flatnonzero(np.isfinite(lengths) & (lengths > 0.0))
    if not known.size:
        return np.empty((0, len(lengths)))
    parts = np.where(np.isfinite(factor), factor, 0.0)
    rays = parts.T if parts.shape[1] == 1 else np.vstack([parts.T, (parts[known] / lengths[known, None]) @ parts.T])
    return np.vstack([rays, -rays])


def _distances(equations: Assembled, rays: Floats) -> Floats:
    """How far along each ray (p, k) points are looked at; no angle moves by more than half a turn."""
    angles = equations.layout.angle[equations.free]
    turning = angles if equations.turning is None else angles | equations.turning
    fastest = np.abs(rays[:, turning]).max(axis=1, initial=0.0)
    if equations.implicit is not None or equations.constraints:
        shares = DISTANCES[::2][:FEW] / DISTANCES[-1]
    else:
        count = max(RESIDUALS // (len(rays) * equations.count), LEAST)
        shares = DISTANCES[:: -(-len(DISTANCES) // count)] / DISTANCES[-1]
    with np.errstate(divide="ignore"):
        farthest: Floats = np.minimum(DISTANCES[-1], np.pi / fastest)
    return np.asarray(farthest[:, None] * shares)


def _within(equations: Assembled, points: Floats, inside: Floats) -> Floats:
    """The points (T, N) brought back within the bounds; positive numbers keep a share of what they are ``inside``."""
    layout = equations.layout
    places = layout.number[equations.free]
    plain = places >= 0
    places = places[plain]
    lower = np.where(
        equations.positive[plain], np.maximum(equations.lower[plain], POSITIVE * inside[places]), equations.lower[plain]
    )
    points[:, places] = np.clip(points[:, places], lower, equations.upper[plain])
    return points
