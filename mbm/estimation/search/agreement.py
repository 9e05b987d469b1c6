"""Whether two points say the same of what is derived from the unknowns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.types import Floats
from mbm.kernels.types import KernelSet
from mbm.problem.types import Problem

Agreement = Callable[[Floats, Floats], bool]
"""Whether two points (N,) have the same derived quantities."""

NEAR = 1e-5
"""Relative difference of numbers that are to be equal, at minima found independently."""


def derived_agreement(problem: Problem, binder: Binder, kernels: KernelSet) -> Agreement:
    """The comparison for a problem; angles agree by whole turns. The equations are bound when it is first asked."""

    def agree(first: Floats, second: Floats) -> bool:
        for owner, derived in enumerate(problem.derived):
            for group in binder.derived(kernels, owner):
                one, other = group.values(first).copy(), group.values(second).copy()
                apart = one - other
                if derived.angle:
                    apart = np.remainder(apart + np.pi, 2 * np.pi) - np.pi
                size = np.abs(one).max(axis=1, keepdims=True, initial=0.0) + derived.angle
                if not bool((np.abs(apart) <= NEAR * size).all()):
                    return False
        return True

    return agree
