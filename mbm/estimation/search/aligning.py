"""A tree of poses that nothing ties to the world → where in the world it lies, by what else was measured from it.

Odometry places a whole drive but for one motion, and ranges to known stations, fixes or bearings tell that motion.
Given it, unknowns that enter linearly (the scale and offset of a radio) are solved for. There may be several: a nearly
straight drive past stations that stand nearly in a line has a mirror image on their other side. So what a start has led
to is laid elsewhere, too: which of the places is right, only a solve from each can tell.

A family of poses moved as one: the motions that suit what else was measured from it.

They are looked for at random, and followed down from the best that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.affine_part import affine_coordinates, linear_solver
from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import excerpt
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.motions import origin, product, stepped
from mbm.estimation.starts.closed_forms.relative_poses import RELATIVE_POSES, relates
from mbm.estimation.starts.closed_forms.types import Situation
from mbm.problem.types import UnknownKind
from mbm.values import dataclass

ENOUGH_UNITS = 600
"""Equations in rows that the motion is judged by."""

MOST_OTHERS = 100
"""Coordinates beside the poses that are solved for with each motion."""

LEAST_FELT = 3
"""Poses that more than one motion may suit: two are brought where they should be in one way."""

ORIGIN = "aligned"


def aligned(equations: Assembled, numbers: Floats, settings: Settings) -> tuple[tuple[Floats, str], ...]:
    """All numbers (N,), from those that are known (NaN: open), and how, in words; none where there is nothing to align.

    There is where the motions between all members of one family of poses are measured, none of which is known, other
    equations speak of them, and what else is open enters these linearly. The first fits best.
    """
    entry = _loose_family(equations, numbers)
    if entry is None:
        return ()
    apart = [group for group in equations.groups if group.rows and not relates(group, entry)]
    others = [group for group in apart if any(slot.unknown == entry.unknown.name for slot in group.kernel.variables)]
    graph = tuple(group for group in equations.groups if group.rows and relates(group, entry))
    if not others or not graph:
        return ()
    situation = Situation(layout=equations.layout, groups=graph, numbers=numbers)
    found = completions(situation, (RELATIVE_POSES,))[0]
    if bool(np.isnan(found.numbers[entry.range]).any()):
        return ()
    missing = replace(equations.layout, start=found.numbers).missing()
    part = excerpt(equations, np.flatnonzero(missing), _some_units(apart, settings.seed))
    linear = affine_coordinates(part, missing)
    if not bool((linear == missing).all()):
        return ()
    origin_of = "; ".join((*found.used, ORIGIN))
    return tuple((each, origin_of) for each in Tree(part, entry, found.numbers, linear).laid(settings))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Movable:
    """A family of poses between which motions are measured, the groups ``apart`` that are not of these, but of the
    poses or of ``others``: coordinates (M,) that are solved for with each motion of the family.
    """

    entry: Entry
    apart: tuple[Group, ...]
    others: Mask


def movable(equations: Assembled) -> Movable | None:
    """The largest family of poses, if it may be moved as one.

    None where no motions between members are measured, fewer than three are felt by other equations, or more than
    `MOST_OTHERS` coordinates stand in these beside them.
    """
    families = [
        e
        for e in equations.layout.entries
        if e.unknown.kind is UnknownKind.POSE and e.members >= LEAST_FELT and not e.steps
    ]
    entry = max(families, key=lambda e: e.members, default=None)
    if entry is None:
        return None
    graph = [group for group in equations.groups if group.rows and relates(group, entry)]
    apart = [group for group in equations.groups if group.rows and not relates(group, entry)]
    own, others = (np.zeros(len(equations.layout.number), dtype=bool) for _ in range(2))
    own[entry.coordinates] = True
    beside = [group for group in apart if own[group.columns].any()]
    if not graph or not beside:
        return None
    others[np.concatenate([np.unique(group.columns) for group in beside])] = True
    felt = (others & own)[entry.coordinates].reshape(entry.members, -1).any(axis=1).sum()
    others[np.concatenate([np.unique(group.columns) for group in graph])] = False
    others[entry.coordinates] = False
    others &= np.isin(np.arange(len(others)), equations.free)
    if others.sum() > MOST_OTHERS or felt < LEAST_FELT:
        return None
    return Movable(entry=entry, apart=tuple(g for g in apart if (own | others)[g.columns].any()), others=others)


def laid_elsewhere(equations: Assembled, tree: Movable, point: Floats, settings: Settings) -> tuple[Floats, ...]:
    """All numbers (N,) with the family of poses moved as one to where it fits nearly as well as at a point (N,).

    In the plane turned over, too, if the motions between poses are nearly the same then: on a nearly straight way.
    None where a pose is fixed.
    """
    if equations.layout.fixed[tree.entry.coordinates].any():
        return ()
    part = excerpt(equations, np.flatnonzero(tree.others), _some_units(tree.apart, settings.seed))
    linear = affine_coordinates(part, tree.others)
    found = Tree(part, tree.entry, point, linear).elsewhere(settings)
    over = _turned_over(equations, tree.entry, point)
    return found if over is None else (*found, *Tree(part, tree.entry, over, linear).laid(settings))


def _turned_over(equations: Assembled, entry: Entry, point: Floats) -> Floats | None:
    """All numbers (N,) with the poses of the plane mirrored at their longest axis; None where motions exclude that.

    In space, turns about that axis are motions.
    """
    if entry.unknown.dimension != 2:
        return None
    poses = point[entry.range].reshape(entry.members, -1).copy()
    middle = poses[:, 1:].mean(axis=0)
    along = np.linalg.svd(poses[:, 1:] - middle, full_matrices=False)[2][0]
    poses[:, 0] = 2.0 * np.arctan2(along[1], along[0]) - poses[:, 0]
    poses[:, 1:] = 2.0 * middle - poses[:, 1:] + 2.0 * ((poses[:, 1:] - middle) @ along)[:, None] * along
    result = point.copy()
    result[entry.range] = poses.ravel()
    residuals = equations.plain_residuals(result)
    graph = [residuals[g.first : g.first + g.count] for g in equations.groups if g.rows and relates(g, entry)]
    return result if np.square(np.concatenate(graph)).mean() <= PLAUSIBLE else None


def _loose_family(equations: Assembled, numbers: Floats) -> Entry | None:
    """The one family of poses of which nothing is known."""
    loose = [
        entry
        for entry in equations.layout.entries
        if entry.unknown.kind is UnknownKind.POSE and entry.members > 1 and bool(np.isnan(numbers[entry.range]).all())
    ]
    return loose[0] if len(loose) == 1 else None


def _some_units(groups: Sequence[Group], seed: int) -> Indices:
    """Units of the groups, at most so many of each, drawn at random."""
    generator = np.random.default_rng(seed)
    found = []
    for group in groups:
        units = np.unique(group.units)
        found.append(units if len(units) <= ENOUGH_UNITS else generator.choice(units, ENOUGH_UNITS, replace=False))
    return np.sort(np.concatenate(found))


TRIALS = {2: 1500, 3: 4000}
"""Motions tried at random, of the plane and of space."""

FOLLOWED, STEPS = 32, 15
"""Motions that are followed down, and by how many steps."""

ALIKE = 10
"""If so many lead to where the tree lies already, it is the only place."""

APART, SAME_PLACE = 0.15, 0.02
"""Shares of the reach by which trees lie apart, root mean square, to be followed down, and to be told apart then."""

FARTHER = 8.0
"""Reaches within which a tree is looked for that lies somewhere already."""

KEPT = 5
"""Motions that are answered at most, the best first …"""

PLAUSIBLE = 30.0
"""… which cost less than so many times the best: along a tree errors grow, and the rest of the solve mends them."""

ENOUGH = 1e-4
"""Share of the cost by which a step makes it smaller that is the last one."""

SLOPE_STEP = 1e-6
"""Step of the differences by which a motion is followed down, in rad, and as a share of the reach."""


class Tree:
    """A family of poses (m, s) that is moved as one, and the ``linear`` coordinates that go with each motion.

    ``part`` has the equations that a motion is judged by. ``reach``: how far poses lie from one another and, where
    nothing is known of the place, from what the equations speak of.
    """

    def __init__(self, part: Assembled, entry: Entry, numbers: Floats, linear: Mask) -> None:
        self._part, self._entry, self._numbers = part, entry, numbers
        self._solved = linear_solver(part, numbers, linear) if linear.any() else np.copy
        self._dimension, size = entry.unknown.dimension, entry.unknown.size
        self._about = numbers[entry.range].reshape(entry.members, size).copy()
        self._middle = self._about[:, -self._dimension :].mean(axis=0)
        self._about[:, -self._dimension :] -= self._middle
        inside = np.zeros(len(numbers), dtype=bool)
        for group in part.groups:
            inside[group.index] = True
        self._felt = np.flatnonzero(inside[entry.range].reshape(entry.members, size).any(axis=1))
        self._places = entry.offset + self._felt[:, None] * size + np.arange(size)
        self.reach = float(np.ptp(self._about[:, -self._dimension :], axis=0).max())

    @np.errstate(all="ignore")
    def laid(self, settings: Settings) -> tuple[Floats, ...]:
        """All numbers (N,) with each of the motions that fit and differ, the best first; none if none has a value."""
        still = np.where(np.isnan(self._numbers), 0.0, self._numbers)
        for group in self._part.groups:
            values = np.abs(group.values(still)) if group.rows else np.zeros(1)
            self.reach = max(self.reach, float(np.max(values[np.isfinite(values)], initial=0.0)))
        best = self._apart(self._followed(1.0, settings), KEPT, SAME_PLACE)
        return tuple(self._placed(motion) for cost, motion in best if cost <= PLAUSIBLE * best[0][0])

    @np.errstate(all="ignore")
    def elsewhere(self, settings: Settings) -> tuple[Floats, ...]:
        """The same of a tree that lies where it may be, without the motion that leaves it there."""
        here = self._lower(origin(self._entry))
        others = self._followed(FARTHER, settings, here)
        most = PLAUSIBLE * min([here[0], *(cost for cost, _ in others)])
        best = self._apart([here, *others], KEPT, SAME_PLACE)[1:]
        return tuple(self._placed(motion) for cost, motion in best if cost <= most)

    def _followed(
        self, farther: float, settings: Settings, here: tuple[float, Floats] | None = None
    ) -> list[tuple[float, Floats]]:
        """Costs and motions that the best of random ones lead to, the best first; few if all lead ``here``."""
        motions = self._random(np.random.default_rng(settings.seed), farther)
        fits = np.full(len(motions), np.inf)
        for number, motion in enumerate(motions):
            fits[number] = self._cost(self._residuals(motion))
            if settings.stopped():
                break
        chosen = self._apart([(fits[i], motions[i]) for i in np.argsort(fits, kind="stable")], FOLLOWED, APART)
        lower: list[tuple[float, Floats]] = []
        for each in chosen:
            lower.append(each if settings.stopped() else self._lower(each[1]))
            if here is not None and len(lower) == ALIKE and len(self._apart([here, *lower], KEPT, SAME_PLACE)) == 1:
                break
        return sorted(lower, key=lambda each: each[0])

    def _placed(self, motion: Floats) -> Floats:
        """All numbers with the tree turned about its middle and shifted."""
        return self._with(self._entry.range, self._moved(motion, self._about))

    def _with(self, places: slice | Indices, poses: Floats) -> Floats:
        result = self._numbers.copy()
        result[places] = poses if isinstance(places, np.ndarray) else poses.ravel()
        return self._solved(result)

    def _moved(self, motion: Floats, about: Floats) -> Floats:
        moved = product(self._entry, np.tile(motion, (len(about), 1)), about)
        moved[:, -self._dimension :] += self._middle
        return moved

    def _residuals(self, motion: Floats) -> Floats:
        """What the equations say, which feel some of the poses only."""
        return self._part.plain_residuals(self._with(self._places, self._moved(motion, self._about[self._felt])))

    @staticmethod
    def _cost(residuals: Floats) -> float:
        value = float(np.square(residuals).sum())
        return value if np.isfinite(value) else np.inf

    def _random(self, generator: np.random.Generator, farther: float) -> Floats:
        """Motions (k, s): turned in any way, shifted within the reach, or up to so many times ``farther``."""
        dimension, freedom = self._dimension, self._entry.unknown.freedom
        steps = np.zeros((TRIALS[dimension], freedom))
        far = self.reach * farther ** generator.uniform(0.0, 1.0, (len(steps), 1))
        steps[:, freedom - dimension :] = far * generator.uniform(-1.0, 1.0, (len(steps), dimension))
        motions = stepped(self._entry, np.tile(origin(self._entry), (len(steps), 1)), steps)
        if dimension == 2:
            motions[:, 0] = generator.uniform(-np.pi, np.pi, len(steps))
        else:
            turns = generator.normal(size=(len(steps), 4))
            motions[:, :4] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
        return motions

    def _apart(self, ranked: Sequence[tuple[float, Floats]], most: int, share: float) -> list[tuple[float, Floats]]:
        """The first of the costs and motions that lay the tree to different places; none without a value."""
        kept: list[tuple[float, Floats]] = []
        places: list[Floats] = []
        for cost, motion in ranked:
            if len(kept) == most or not np.isfinite(cost):
                break
            here = self._moved(motion, self._about[self._felt])[:, -self._dimension :]
            away = [np.sqrt(np.square(here - other).sum(axis=1).mean()) for other in places]
            if min(away, default=np.inf) > share * self.reach:
                kept.append((cost, motion))
                places.append(here)
        return kept

    def _lower(self, motion: Floats) -> tuple[float, Floats]:
        """Where Marquardt's steps lead from a motion, by differences of the residuals, and what it costs there."""
        freedom = self._entry.unknown.freedom
        units = np.ones(freedom)
        units[freedom - self._dimension :] = self.reach
        residuals, damping = self._residuals(motion), 1e-3
        cost = self._cost(residuals)
        for _ in range(STEPS):
            nearby = stepped(self._entry, np.tile(motion, (freedom, 1)), np.diag(SLOPE_STEP * units))
            slopes = np.stack([(self._residuals(each) - residuals) / SLOPE_STEP for each in nearby], axis=1)
            if not np.isfinite(slopes).all():
                break
            matrix = slopes.T @ slopes
            damped = matrix + damping * np.diag(np.diag(matrix)) + np.finfo(float).tiny * np.eye(freedom)
            step = units * np.linalg.lstsq(damped, -slopes.T @ residuals, rcond=None)[0]
            trial = stepped(self._entry, motion[None], step[None])[0]
            other = self._residuals(trial)
            value = self._cost(other)
            if not value < cost:
                damping *= 10.0
                continue
            done = value > (1.0 - ENOUGH) * cost
            motion, residuals, cost, damping = trial, other, value, 0.1 * damping
            if done:
                break
        return cost, motion
