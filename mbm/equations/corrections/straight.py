"""Equations with errors in measured columns as equations without: kernels that eliminate the corrections themselves.

Where no two rows share a measured value, each row's corrections are a matter of that row, and its kernel can find them
(`mbm.machine.elimination`). What is left are equations like others, which the native solver takes and which go to many
points at once. They have no finite value where finding the corrections takes more care than a few of Newton's steps:
there `Elimination` has the answer, as it has where rows share values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.corrections.system import System
from mbm.equations.types import Floats
from mbm.equations.whitening import Whitener
from mbm.kernels.types import Kernel
from mbm.values import dataclass

KEPT = "eliminated"
"""Where `EvaluationCache.native` has the kernels that were made."""

NUMBERS = 1_000_000
"""Kernels that were made are numbered from here on: beyond all others."""


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """Kernels by the number of the one they were made of and by its noise; None: not to be had."""

    kernels: dict[tuple[int, tuple[tuple[int, int, bool], ...]], tuple[int, Kernel | None]]

    def of(self, group: Group) -> tuple[int, Kernel | None]:
        """The kernel for a group, and its number."""
        noises = tuple((w.first, w.last, w.weights.ndim == 3) for w in group.whiteners)
        key = (group.number, noises)
        if key not in self.kernels:
            # Loaded where it is needed first, as most problems are without.
            from mbm.kernels.eliminated import eliminated_kernel

            self.kernels[key] = (NUMBERS + len(self.kernels), eliminated_kernel(group.kernel, noises))
        return self.kernels[key]


def straight_groups(groups: tuple[Group, ...], systems: tuple[System, ...]) -> tuple[Group, ...] | None:
    """The groups, with kernels that eliminate the corrections of ``systems`` themselves; None: it cannot be done so.

    Their residuals and Jacobian are not finite where the corrections need a search.
    """
    sigmas = _sigmas(groups, systems)
    return None if sigmas is None else eliminating(groups, sigmas)


def eliminating(groups: tuple[Group, ...], sigmas: Mapping[int, Floats]) -> tuple[Group, ...] | None:
    """The groups, with kernels that eliminate the corrections of values that no other equation of a solve uses.

    ``sigmas`` (rows, c) are the standard deviations of these values, by the numbers of the groups. None: it cannot be
    done so.
    """
    if any(group.sampled for group in groups):
        return None
    kept = groups[0].cache.native
    made = kept.setdefault(KEPT, _Made({}))
    if not isinstance(made, _Made):
        raise TypeError(KEPT)
    found = []
    for number, group in enumerate(groups):
        sigma = sigmas.get(number)
        changed = group if sigma is None else _group(group, sigma, made)
        if changed is None:
            return None
        found.append(changed)
    return tuple(found)


def _sigmas(groups: tuple[Group, ...], systems: tuple[System, ...]) -> dict[int, Floats] | None:
    """The standard deviations for each group with corrections; None where some rows hang together."""
    found: dict[int, Floats] = {}
    of_first = {group.first: number for number, group in enumerate(groups) if group.rows}
    for system in systems:
        part = system.parts[0]
        if len(system.parts) > 1 or not part.alone:
            return None
        number = of_first.get(part.group.first)
        if number is None or part.group.rows != groups[number].rows:
            return None
        found[number] = part.sigma
    wanted = {n for n, group in enumerate(groups) if group.kernel.corrections is not None and group.rows}
    return found if set(found) == wanted else None


def _group(group: Group, sigma: Floats, made: _Made) -> Group | None:
    """The group with its kernel replaced; None where that is too large, or the roots of the covariances are others."""
    if group.kernel.outputs > sigma.shape[1]:
        return None
    number, kernel = made.of(group)
    if kernel is None:
        return None
    rows = group.rows
    weights = [w.weights.reshape(rows, -1) for w in group.whiteners]
    own = [w.noisy.astype(np.float64) for w in group.whiteners]
    return replace(
        group,
        number=number,
        kernel=kernel,
        evaluation=group.cache.evaluation(number, kernel, rows),
        parameters=np.hstack([group.parameters, sigma, *weights, *own]),
        whiteners=tuple(Whitener(w.first, w.last, np.ones((rows, w.last - w.first))) for w in group.whiteners),
    )
