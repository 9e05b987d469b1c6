"""What a problem asks of consensus → the arrays that the native consensus takes (`consensus_records`):
kinds, minimal subsets, first states.
"""

from __future__ import annotations

from hashlib import sha256
from math import ceil, log, log1p

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.consensus.types import Asked
from mbm.estimation.consensus.units import CUT, STATED_CUT, limits, medians
from mbm.machine.records import put, slots_of
from mbm.problem.kinds import ConsensusKind
from mbm.solver import consensus_records as c
from mbm.solver.consensus_sample import FIRST_MODULUS, INDEPENDENT, SECOND_MODULUS
from mbm.solver.consensus_scores import GNC, LMEDS, MSAC, RANSAC
from mbm.solver.decisions import FEW_STARTS, STATED
from mbm.values import dataclass

KINDS = {
    ConsensusKind.LMEDS: LMEDS,
    ConsensusKind.RANSAC: RANSAC,
    ConsensusKind.MSAC: MSAC,
    ConsensusKind.GNC: GNC,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rules:
    """``rules`` and ``levels`` as the native consensus takes them, without the capacities, which data sets decide.

    ``ruled`` says which blocks have units.
    """

    rules: Indices
    levels: Floats
    ruled: tuple[bool, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A closed form by its kind and what it says of itself; ``width`` numbers for each unit.

    ``curved``: what is known of lines of sight is near them, and consensus finds them from there.
    """

    kind: int
    about: tuple[int, ...]
    width: int
    curved: bool = False


NO_FORM = Form(kind=0, about=(), width=0)


def rules_of(
    asked: Asked,
    equations: Assembled,
    ruled: tuple[bool, ...],
    *,
    starts: int = 1,
    form: Form = NO_FORM,
    dimension: int | None = None,
) -> Rules:
    """The arrays for data sets whose blocks are the groups of ``equations``.

    Args:
        asked: what is asked for.
        equations: one data set of those.
        ruled: for each group whether units of it may be taken out.
        starts: points that each data set is begun at.
        form: the closed form that fits subsets.
        dimension: unknowns at most; None: those of ``equations``.
    """
    problem, consensus = asked.problem, asked.consensus
    n = equations.dimension if dimension is None else dimension
    trials = [needed_trials(size, consensus.trials) for size in range(n + 1)]
    groups: dict[int, int] = {}
    table: list[int] = []
    levels: list[list[float]] = []
    for group, mine in zip(equations.groups, ruled, strict=True):
        block = problem.blocks[group.kernel.owner]
        if not mine:
            table += [-1, STATED]
            continue
        noise = (
            groups.setdefault(group.kernel.owner, len(groups)) if block.unknown_factor and not asked.stated else STATED
        )
        table += [len(levels), noise]
        for whitener in group.whiteners:
            size = np.full(1, whitener.last - whitener.first)
            deviations = STATED_CUT if noise == STATED else CUT
            cut = limits(size, deviations if consensus.threshold is None else consensus.threshold)[0]
            levels.append([medians(size)[0], cut, limits(size, STATED_CUT)[0]])
    first, second = first_states(asked.settings.seed)
    solutions = 4 if form.kind else starts
    head = np.zeros(slots_of(c.Rules), dtype=np.int64)
    put(
        head,
        c.Rules,
        kind=KINDS[consensus.kind],
        groups=len(groups),
        first_state=first,
        second_state=second,
        form=form.kind,
        form_width=form.width,
        curved=int(form.curved),
        starts=starts,
        most_points=max(trials) * solutions + starts + 2 * FEW_STARTS + 4,
        thresholded=int(consensus.threshold is not None),
        until_sure=int(consensus.trials is None and not groups),
        trials=len(head),
        ruled=len(head) + len(trials),
        about=len(head) + len(trials) + len(table),
    )
    return Rules(
        rules=np.concatenate([head, np.array([*trials, *table, *form.about], dtype=np.int64)]),
        levels=np.array(levels).ravel(),
        ruled=ruled,
    )


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
