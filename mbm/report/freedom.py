"""What the data leave free, in sentences: which unknowns move together, and how."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.types import CommonMotion, FreeCombination, GaugeMotion, Motion
from mbm.estimation.search.solution import Solution
from mbm.report.faults import MOST_NAMES
from mbm.report.types import CommonDirection, FreeDirection

EQUAL_MOVEMENTS = 1e-6
"""Relative difference below which movements count as equal: far above rounding, far below anything a person means."""


def free_directions(solution: Solution, names: tuple[str, ...]) -> tuple[FreeDirection, ...]:
    """The free combinations, and the unknowns that nothing depends on; ``names`` (M,) are those of all coordinates."""
    found = [_direction(solution, names, combination) for combination in solution.observability.combinations]
    return (*_more(solution), *_unused(solution, names), *_whole(solution), *found)


def _more(solution: Solution) -> list[FreeDirection]:
    """That there may be more free combinations than were looked for, which the equations as they are do not tell."""
    observed = solution.observability
    if observed.complete:
        return []
    sentence = (
        f"{observed.null_space.shape[1]} combinations of unknowns, and perhaps more, for no more were looked for: very "
        "large standard deviations are theirs; fix what no row tells (`:fixed`), give it a `:sigma`, or add rows"
    )
    return [FreeDirection(sentence=sentence, unknowns=(), coefficients={})]


def _whole(solution: Solution) -> list[FreeDirection]:
    """The common motions of a scene, where they are not among the combinations: coefficients of turns say nothing."""
    found = solution.observability
    turning = any(motion.motion is CommonMotion.ROTATION for motion in found.gauge)
    if found.datum or (found.inverse is None and not turning):
        return []
    return [
        FreeDirection(sentence=common.sentence, unknowns=common.unknowns, coefficients={})
        for motion, common in zip(found.gauge, common_directions(solution), strict=True)
        if not motion.numbers
    ]


_MENDS: Mapping[CommonMotion, str] = {
    CommonMotion.TRANSLATION: "fix one position",
    CommonMotion.ROTATION: "fix one rotation or the directions to other points",
    CommonMotion.SCALE: "give one distance",
}
_MOTIONS: Mapping[CommonMotion, str] = {
    CommonMotion.TRANSLATION: "be shifted",
    CommonMotion.ROTATION: "be turned",
    CommonMotion.SCALE: "grow or shrink",
}
_AXES = "xyz"


def common_directions(solution: Solution) -> tuple[CommonDirection, ...]:
    """The motions of the whole scene that are free, each with what would fix it."""
    found = solution.observability
    return tuple(_common(motion, settled=found.datum > 0) for motion in found.gauge)


def _common(motion: GaugeMotion, *, settled: bool) -> CommonDirection:
    along = ""
    if motion.axes:
        which = " and ".join(_AXES[axis] for axis in motion.axes)
        along = f" {'along' if motion.motion is CommonMotion.TRANSLATION else 'about'} {which}"
    subject, mend = f"the whole scene ({listed(list(motion.unknowns))})", _MENDS[motion.motion]
    if motion.numbers:
        subject, mend = f"all of {listed(list(motion.unknowns))}", "fix one of them"
        along = " by one amount"
    sentence = f"{subject} may {_MOTIONS[motion.motion]}{along}: "
    if settled:
        sentence += "it is held by the minimum-norm datum"
    else:
        sentence += f"{mend} (`:fixed` or a prior), or take the minimum-norm datum (`:gauge free`)"
    return CommonDirection(
        sentence=sentence, motion=motion.motion.value, dimensions=motion.dimensions, unknowns=motion.unknowns
    )


def _owner(solution: Solution, position: int) -> str:
    return solution.layout.owner(position).unknown.name


def _unused(solution: Solution, every: tuple[str, ...]) -> list[FreeDirection]:
    by_unknown: dict[str, list[int]] = {}
    for index in solution.observability.unused:
        position = int(solution.free[index])
        by_unknown.setdefault(_owner(solution, position), []).append(position)
    mentioned = set(solution.unused.tolist())
    found = []
    for name, positions in by_unknown.items():
        names = [every[p] for p in positions]
        entry = solution.layout.entry(name)
        subject = f"`{name}`" if len(positions) == entry.members * entry.unknown.freedom else listed(names)
        if all(p in mentioned for p in positions):
            sentence = f"{subject} appears in no equation that has data"
        elif any(_read(solution, p) for p in positions):
            sentence = f"what was read is as likely with other values of {subject} near the estimates"
        else:
            sentence = f"no equation changes with {subject} at the estimates"
        found.append(FreeDirection(sentence=sentence, unknowns=(name,), coefficients=dict.fromkeys(names, 1.0)))
    return found


def _read(solution: Solution, position: int) -> bool:
    """Whether a coordinate stands in equations that say how likely readings are, such as rounded ones."""
    return any(group.readings is not None and position in group.columns for group in solution.groups)


def _direction(solution: Solution, every: tuple[str, ...], combination: FreeCombination) -> FreeDirection:
    positions = [int(solution.free[i]) for i in combination.indices]
    names = [every[p] for p in positions]
    coefficients: Mapping[str, float] = dict(zip(names, combination.coefficients, strict=True))
    owners = tuple(dict.fromkeys(_owner(solution, p) for p in positions))
    return FreeDirection(sentence=_sentence(names, combination), unknowns=owners, coefficients=coefficients)


def _sentence(names: list[str], combination: FreeCombination) -> str:
    if len(names) == 1:
        return f"{listed(names)} is not determined"
    relative, coefficients = combination.relative, combination.coefficients
    if combination.motion is Motion.SCALE and relative is not None:
        if _equal(relative):
            return f"{listed(names)} scale together: only their ratios are determined"
        if len(names) == 2 and _equal((relative[0], -relative[1])):
            return f"{listed(names)}: only their product is determined"
        powers = ", ".join(f"{n} × s^{r:.3g}" for n, r in list(zip(names, relative, strict=True))[:MOST_NAMES])
        return f"{listed(names)} scale together ({powers})"
    if combination.motion is Motion.SHIFT:
        if _equal(coefficients):
            return f"{listed(names)} move together by the same amount: only their differences are determined"
        if len(names) == 2 and _equal((coefficients[0], -coefficients[1])):
            return f"{listed(names)} move against each other: only their sum is determined"
    movements = ", ".join(f"δ{n} = {c:.3g}" for n, c in list(zip(names, coefficients, strict=True))[:MOST_NAMES])
    return f"{listed(names)} move together without any equation noticing ({movements})"


def _equal(values: tuple[float, ...]) -> bool:
    found = np.asarray(values)
    return bool((np.abs(found - found[0]) <= EQUAL_MOVEMENTS * np.abs(found).max()).all())


def listed(names: list[str]) -> str:
    """Names as a sentence lists them."""
    quoted = [f"`{n}`" for n in names]
    if len(quoted) > MOST_NAMES:
        return ", ".join(quoted[:MOST_NAMES]) + f" and {len(quoted) - MOST_NAMES} more"
    if len(quoted) == 1:
        return quoted[0]
    return ", ".join(quoted[:-1]) + f" and {quoted[-1]}"
