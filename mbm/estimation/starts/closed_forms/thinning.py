"""Many rows of one member → enough of them: what a start is computed from."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Indices

ENOUGH = 4_000
"""Rows of a group that each member keeps where closed forms give starts.

A start's variance is then that of the estimate times n / 4000, far inside its basin; the answer is found from all rows.
"""


def thinned(member: Indices, most: int) -> Indices:
    """Positions, ascending, of at most ``most`` rows of each member (n,); the same ones at each call.

    They are drawn without a pattern, so that rows in which stations or times recur are met as often as they occur.
    """
    if len(member) <= most or int(np.bincount(member).max()) <= most:
        return np.arange(len(member))
    mixed = np.random.default_rng(0).permutation(len(member))
    order = mixed[np.argsort(member[mixed], kind="stable")]
    grouped = member[order]
    rank = np.arange(len(member)) - np.searchsorted(grouped, grouped)
    return np.sort(order[rank < most])
