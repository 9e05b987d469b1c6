"""A tree of poses that nothing ties to the world → where in the world it lies, by what else was measured from it.

Odometry places a whole drive but for one motion, and ranges to known stations, fixes or bearings tell that motion.
Given it, unknowns that enter linearly (the scale and offset of a radio) are solved for. The motion is looked for at
random, then nearer and nearer to the best that was found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.affine_part import affine_coordinates, solved_linearly
from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import excerpt
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.motions import origin, product, stepped
from mbm.estimation.starts.closed_forms.relative_poses import RELATIVE_POSES, relates
from mbm.estimation.starts.closed_forms.situation import Situation
from mbm.problem.types import UnknownKind

ENOUGH_UNITS = 600
"""Equations in rows that the motion is judged by."""

TRIALS = {2: 1500, 3: 4000}
"""Motions tried at random, of the plane and of space."""

NEARER_ROUNDS, NEAR, SHRINKING = 30, 16, 0.8
"""Rounds of motions near the best one, how many in each, and how much nearer each round is."""

FIRST_TURN, FIRST_SHIFT = 0.3, 0.1
"""How far those of the first round turn, in rad, and shift, as a share of the reach."""

ORIGIN = "aligned"


def aligned(equations: Assembled, numbers: Floats, settings: Settings) -> tuple[Floats, str] | None:
    """All numbers (N,), from those that are known (NaN: open), and how, in words; None where there is nothing to align.

    There is where the motions between all members of one family of poses are measured, none of which is known, other
    equations speak of them, and what else is open enters these linearly.
    """
    entry = _loose_family(equations, numbers)
    if entry is None:
        return None
    apart = [group for group in equations.groups if group.rows and not relates(group, entry)]
    others = [group for group in apart if any(slot.unknown == entry.unknown.name for slot in group.kernel.variables)]
    graph = tuple(group for group in equations.groups if group.rows and relates(group, entry))
    if not others or not graph:
        return None
    situation = Situation(layout=equations.layout, groups=graph, numbers=numbers)
    found = completions(situation, (RELATIVE_POSES,))[0]
    if bool(np.isnan(found.numbers[entry.range]).any()):
        return None
    missing = replace(equations.layout, start=found.numbers).missing()
    part = excerpt(equations, np.flatnonzero(missing), _some_units(apart, settings.seed))
    linear = affine_coordinates(part, missing)
    if not bool((linear == missing).all()):
        return None
    best = _searched(part, entry, found.numbers, linear, settings)
    return None if best is None else (best, "; ".join((*found.used, ORIGIN)))


def _loose_family(equations: Assembled, numbers: Floats) -> Entry | None:
    """The one family of poses of which nothing is known."""
    loose = [
        entry
        for entry in equations.layout.entries
        if entry.unknown.kind is UnknownKind.POSE and entry.members > 1 and bool(np.isnan(numbers[entry.range]).all())
    ]
    return loose[0] if len(loose) == 1 else None


def _some_units(groups: list[Group], seed: int) -> Indices:
    """Units of the groups, at most so many of each, drawn at random."""
    generator = np.random.default_rng(seed)
    found = []
    for group in groups:
        units = np.unique(group.units)
        found.append(units if len(units) <= ENOUGH_UNITS else generator.choice(units, ENOUGH_UNITS, replace=False))
    return np.sort(np.concatenate(found))


@np.errstate(all="ignore")
def _searched(part: Assembled, entry: Entry, numbers: Floats, linear: Mask, settings: Settings) -> Floats | None:
    """The numbers with the best motion of the family's members, and the ``linear`` coordinates that go with it."""
    dimension, size = entry.unknown.dimension, entry.unknown.size
    tree = numbers[entry.range].reshape(entry.members, size)
    middle = tree[:, -dimension:].mean(axis=0)
    still = np.where(np.isnan(numbers), 0.0, numbers)
    reach = float(np.ptp(tree[:, -dimension:], axis=0).max())
    for group in part.groups:
        values = np.abs(group.values(still)) if group.rows else np.zeros(1)
        reach = max(reach, float(np.max(values[np.isfinite(values)], initial=0.0)))

    def placed(motion: Floats) -> Floats:
        """All numbers with the tree turned about its middle and shifted."""
        about = tree.copy()
        about[:, -dimension:] -= middle
        moved = product(entry, np.tile(motion, (entry.members, 1)), about)
        moved[:, -dimension:] += middle
        result = numbers.copy()
        result[entry.range] = moved.ravel()
        return solved_linearly(part, result, linear) if linear.any() else result

    def cost(motion: Floats) -> float:
        value = float(np.square(part.plain_residuals(placed(motion))).sum())
        return value if np.isfinite(value) else np.inf

    best = _nearest(entry, cost, reach, np.random.default_rng(settings.seed), settings.stopped)
    return None if best is None else placed(best)


def _nearest(
    entry: Entry,
    cost: Callable[[Floats], float],
    reach: float,
    generator: np.random.Generator,
    stopped: Callable[[], bool],
) -> Floats | None:
    """The motion (s,) of least cost; None where none has a value."""
    dimension, freedom = entry.unknown.dimension, entry.unknown.freedom
    best, least = None, np.inf
    steps = np.zeros((TRIALS[dimension], freedom))
    steps[:, freedom - dimension :] = generator.uniform(-reach, reach, (len(steps), dimension))
    motions = stepped(entry, np.tile(origin(entry), (len(steps), 1)), steps)
    if dimension == 2:
        motions[:, 0] = generator.uniform(-np.pi, np.pi, len(steps))
    else:
        turns = generator.normal(size=(len(steps), 4))
        motions[:, :4] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    for motion in motions:
        value = cost(motion)
        if value < least:
            best, least = motion, value
        if stopped():
            return best
    scale = np.full(freedom, FIRST_TURN)
    scale[freedom - dimension :] = FIRST_SHIFT * reach
    for _ in range(NEARER_ROUNDS):
        if best is None or stopped():
            break
        for step in generator.normal(size=(NEAR, freedom)) * scale:
            motion = stepped(entry, best[None], step[None])[0]
            value = cost(motion)
            if value < least:
                best, least = motion, value
        scale = scale * SHRINKING
    return best
