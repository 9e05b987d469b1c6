"""How many minimal subsets are drawn, with which numbers, and what equations determine at all."""

from __future__ import annotations

from hashlib import sha256
from math import ceil, log, log1p

import numpy as np

from mbm.equations.types import Floats
from mbm.solver.consensus_sample import FIRST_MODULUS, INDEPENDENT, SECOND_MODULUS

GOOD_SHARE = 0.6
"""Share of good units that the default number of trials is made for: 40 % outliers."""

MISSED = 1e-6
"""Probability that, with so many outliers, no trial is free of them."""

LEAST_TRIALS, MOST_TRIALS = 100, 3000


def needed_trials(size: int, asked: int | None) -> int:
    """How many trials with subsets of ``size`` units: what is asked for, or enough for 40 % outliers."""
    if asked is not None:
        return asked
    hit = GOOD_SHARE**size
    needed = ceil(log(MISSED) / log1p(-hit)) if 0.0 < hit < 1.0 else LEAST_TRIALS
    return min(max(needed, LEAST_TRIALS), MOST_TRIALS)


def independent_columns(jacobian: Floats) -> int:
    """How many combinations of the unknowns the rows (m, n) tell apart; what is not finite tells nothing."""
    return int(np.linalg.matrix_rank(_scaled(jacobian), tol=INDEPENDENT)) if jacobian.size else 0


def _scaled(jacobian: Floats) -> Floats:
    finite = np.where(np.isfinite(jacobian), jacobian, 0.0)
    norms = np.linalg.norm(finite, axis=0)
    found = finite / np.where(norms > 0.0, norms, 1.0)
    lengths = np.linalg.norm(found, axis=1)
    return np.asarray(found / np.where(lengths > 0.0, lengths, 1.0)[:, None])


def first_states(seed: int) -> tuple[int, int]:
    """The two states of the generator at the start of the first trial."""
    digest = sha256(repr(seed).encode()).digest()
    first, second = (int.from_bytes(part, "big") for part in (digest[:16], digest[16:]))
    return 1 + first % (FIRST_MODULUS - 1), 1 + second % (SECOND_MODULUS - 1)
