"""Whether errors of relative rows are correlated: transitions of states, and motions between neighbours of a family.

Odometry that drifts is wrong in the same way for many steps. Its fitted residuals are correlated in any case, as few
other rows check it: what independent noise makes of them is drawn, u − J (JᵀJ)⁻¹ Jᵀ u for normal u, and the sums
Σ eᵢ eⱼ aⁱ⁻ʲ / Σ eᵢ² over rows i > j are compared with those of the draws (a Monte Carlo test, Barnard 1963; its level
is nearly exact).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Minimum
from mbm.estimation.starts.closed_forms.trees import behind_one_another, related
from mbm.estimation.trust import faults
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

DECAYS = (0.0, 0.8, 0.97)
"""Neighbours alone, and about 5 and about 33 rows before."""

LEVEL = 0.01
"""Share of solves with independent noise of which it is said by chance."""

DRAWS, FEW_DRAWS, LARGE = 399, 29, 3_000
"""Draws; so few of more residuals than that, whose sums are nearly normal: Student's t stands in for the ranks."""

LEAST_ROWS, MOST_ROWS = 20, 100_000
"""Rows of a chain from which the test can tell anything, and residuals above which nobody asks."""

CHECKED = 1e-4
"""Mean square of what independent noise leaves of a residual below which no other row checks it."""

SCALINGS = 6
"""Times that the noise is scaled to what residuals tell; then scales of the pose graph Manhattan change by 1 %."""

RIDGE = 1e-12
"""What the normal equations of free directions are held by, as a share of their diagonal."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """The residuals of one clause in the order of its rows: their places (rows, outputs) in m."""

    owner: int
    places: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alike:
    """The standardised sum of a chain that is the farthest from those of independent noise.

    ``sums`` (3,) are the sum, and the mean and standard deviation of those of the draws.
    """

    away: float
    chain: Chain
    decay: float
    sums: Floats


@np.errstate(all="ignore")
def correlated_chains(
    problem: Problem, equations: Assembled, minimum: Minimum, chains: Sequence[Chain], *, overstated: bool
) -> tuple[Diagnostic, ...]:
    """A warning that names the clause whose errors are most alike along its rows, if independent noise is not so.

    ``overstated``: chi² says that the stated noise is too large. Then the draws are repeated with the noise that the
    residuals tell of each clause and coordinate: those of one that is stated too small beside others follow the noise
    of these, and are alike. Where chi² is large, a drift may be why, and the noise is left as it is stated.
    """
    left = _left_of(minimum) if chains else None
    if left is None:
        return ()
    draws = left(_noise(minimum))
    checked = np.square(draws).mean(axis=1)
    most_alike = _most_alike(minimum.residuals, chains, draws, checked)
    if most_alike is not None and overstated:
        scales = _scales(minimum.residuals, _kinds(problem, equations, chains), left)
        most_alike = _most_alike(minimum.residuals, chains, left(scales[:, None] * _noise(minimum)), checked)
    if most_alike is None:
        return ()
    block = problem.blocks[most_alike.chain.owner]
    carried = block.role is BlockRole.TRANSITION
    found, decay = most_alike.sums, most_alike.decay
    return (faults.correlated_chain(block.span, block.name, found, decay, carried=carried, overstated=overstated),)


def _most_alike(residuals: Floats, chains: Sequence[Chain], draws: Floats, left: Floats) -> Alike | None:
    """What is beyond chance, as ``draws`` (m, draws) of the residuals (m,) have it.

    ``left`` (m,) is the share of a residual's variance that the fit leaves, whatever its noise. Coordinates that are
    fitted exactly tell nothing.
    """
    worst: Alike | None = None
    highest, compared = np.full(draws.shape[1], -np.inf), 0
    for each in chains:
        own, drawn = residuals[each.places], draws[each.places]
        checked = (left[each.places].mean(axis=0) > CHECKED) & (np.square(own).sum(axis=0) > 0.0)
        for decay in DECAYS:
            found, chance = sums(own[:, checked, None], decay)[:, 0], sums(drawn[:, checked], decay)
            mean, spread = chance.mean(axis=1), chance.std(axis=1, ddof=1)
            highest = np.maximum(highest, ((chance - mean[:, None]) / spread[:, None]).max(axis=0, initial=-np.inf))
            away = (found - mean) / spread
            compared += len(away)
            k = int(np.argmax(away)) if len(away) else 0
            if len(away) and (worst is None or away[k] > worst.away):
                told = np.array([found[k], mean[k], spread[k]])
                worst = Alike(away=float(away[k]), chain=each, decay=decay, sums=told)
    return worst if worst is not None and _beyond(worst.away, highest, compared) else None


def _kinds(problem: Problem, equations: Assembled, chains: Sequence[Chain]) -> Indices:
    """Residuals (m,) of one clause and coordinate have one number, links of a chain another one than other rows.

    Those of too few rows to tell their noise have one together.
    """
    found = np.zeros(equations.count, dtype=np.int64)
    for group in equations.groups:
        if group.rows >= LEAST_ROWS:
            outputs = np.arange(group.kernel.outputs)
            numbers = 1 + group.kernel.owner + len(problem.blocks) * outputs
            found[group.first : group.first + group.count] = np.tile(numbers, group.rows)
    apart = found.max(initial=0) + 1
    for each in chains:
        found[each.places] += apart
    return np.unique(found, return_inverse=True)[1]


def _scales(residuals: Floats, kinds: Indices, left: Callable[[Floats], Floats]) -> Floats:
    """Factors (m,) of the noise, one for each of the ``kinds`` (m,), of which as large residuals are left as there are.

    Each factor is multiplied until they are, as in the estimation of variance components (Förstner 1979), but with
    the weights of the fit.
    """
    noise = np.random.default_rng(1).normal(size=(len(residuals), FEW_DRAWS))
    seen = np.bincount(kinds, np.square(residuals))
    scales = np.ones(len(seen))
    for _ in range(SCALINGS):
        expected = np.bincount(kinds, np.square(left(scales[kinds, None] * noise)).mean(axis=1))
        scales *= np.sqrt(np.where(expected > 0.0, seen / expected, 1.0))
    return scales[kinds]


def tested_chains(problem: Problem, equations: Assembled, minimum: Minimum) -> tuple[Chain, ...]:
    """The chains at a minimum that are long enough to be tested."""
    forced = minimum.constraints is not None and bool(minimum.constraints.forcing.any())
    here = len(minimum.residuals) == equations.count and not forced
    if not here or not may_be_correlated(problem, equations, equations.count):
        return ()
    return tuple(each for each in _chains(problem, equations) if len(each.places) >= LEAST_ROWS)


def may_be_correlated(problem: Problem, equations: Assembled, count: int) -> bool:
    """Whether data sets of ``count`` residuals are tested, by the form of their equations; these may be of many."""
    odd = equations.rows is not None or equations.likely or equations.lossy or equations.structure is not None
    if odd or equations.implicit is not None or not LEAST_ROWS <= count <= MOST_ROWS:
        return False
    return any(_may_follow(problem, equations, group) for group in equations.groups)


def _beyond(away: float, highest: Floats, compared: int) -> bool:
    """Whether the largest of the ``compared`` standardised sums is beyond those of the draws (draws,)."""
    if len(highest) == DRAWS:
        return 1 + int((highest >= away).sum()) <= LEVEL * (1 + DRAWS)
    from scipy.special import stdtr

    scale = np.sqrt(1.0 + 1.0 / len(highest))
    return bool(stdtr(len(highest) - 1, -away / scale) * compared < LEVEL)


def sums(residuals: Floats, decay: float) -> Floats:
    """Σ eᵢ eⱼ aⁱ⁻ʲ⁻¹ / Σ eᵢ² over rows i > j, of residuals (rows, …); shape (…)."""
    before = np.zeros_like(residuals)
    before[1:] = residuals[:-1]
    if decay > 0.0:
        for k in range(1, len(before)):
            before[k] += decay * before[k - 1]
    return np.asarray((residuals * before).sum(axis=0) / np.square(residuals).sum(axis=0))


def _noise(minimum: Minimum) -> Floats:
    """Draws (m, draws) of the residuals' independent noise."""
    count = len(minimum.residuals)
    return np.random.default_rng(0).normal(size=(count, DRAWS if count <= LARGE else FEW_DRAWS))


def _left_of(minimum: Minimum) -> Callable[[Floats], Floats] | None:
    """What noise (m, draws) leaves as residuals; None if nothing can be solved."""
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import splu

    free = np.flatnonzero(minimum.at_bound == 0)
    if not len(free):
        return None
    columns = minimum.jacobian[:, free]
    J = csr_array(columns).tocsc()
    normal = J.T @ J
    diagonal = normal.diagonal()
    if not bool(np.isfinite(diagonal).all()):
        return None
    held = (normal + diags_array(np.where(diagonal > 0.0, RIDGE * diagonal, 1.0))).tocsc()
    try:
        factor = splu(held)
    except RuntimeError:  # what no ridge holds
        return None
    return lambda noise: np.asarray(noise - J @ factor.solve(J.T @ noise))


def _chains(problem: Problem, equations: Assembled) -> Iterator[Chain]:
    """The clauses whose rows follow one another."""
    series: dict[tuple[int, int], list[tuple[Floats, Indices]]] = {}
    for group in equations.groups:
        if not group.kernel.outputs or not _may_follow(problem, equations, group):
            continue
        order = _order(problem, equations, group)
        kept = np.flatnonzero(np.isfinite(order))
        outputs = group.kernel.outputs
        places = group.first + kept[:, None] * outputs + np.arange(outputs)
        series.setdefault((group.kernel.owner, outputs), []).append((order[kept], places))
    for (owner, _), parts in series.items():
        order, places = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        yield Chain(owner=owner, places=places[np.argsort(order, kind="stable")])


def _order(problem: Problem, equations: Assembled, group: Group) -> Floats:
    """Where each row (rows,) stands in its chain; NaN where it is a link of none."""
    for entry in equations.layout.entries:
        ends = _ends(group, entry)
        if ends is not None:
            first, second = ends
            neighbours = behind_one_another(entry, first, second)
            return np.where(neighbours, np.minimum(first, second), np.nan)
    earlier = problem.blocks[group.kernel.owner].earlier
    return np.full(group.rows, np.nan) if group.positions is None or not earlier else group.positions.astype(float)


def _may_follow(problem: Problem, equations: Assembled, group: Group) -> bool:
    """Whether rows of a group may follow one another, by their form."""
    block = problem.blocks[group.kernel.owner]
    if block.role not in (BlockRole.TRANSITION, BlockRole.OBSERVATION) or not group.rows:
        return False
    return bool(block.earlier) or any(_ends(group, entry) is not None for entry in equations.layout.entries)


def _ends(group: Group, entry: Entry) -> tuple[Indices, Indices] | None:
    """The two members (rows,) of a family that each row knows of; None if it does not know of two."""
    members = {slot.member for slot in group.kernel.variables if slot.unknown == entry.unknown.name}
    return related(group, entry) if entry.members >= LEAST_ROWS and len(members) == 2 else None
