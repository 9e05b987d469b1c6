"""Consensus of one data set in native code, as `mbm.solution.robust.consensus` asks for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import numpy as np

from mbm.problem.types import Block, Consensus, Problem
from mbm.solution.assembly import Assembled
from mbm.solution.binding import Group
from mbm.solution.native.consensus import Rooms, consensus_many
from mbm.solution.native.consensus_forms import KnownForm, known_form
from mbm.solution.native.consensus_rules import NO_FORM, Rules, rules_of
from mbm.solution.native.system import native_code, never, system_of
from mbm.solution.robust.agree import Agreed
from mbm.solution.robust.binding import without_losses
from mbm.solution.settings import Settings
from mbm.solution.starting import with_idle_ones
from mbm.solution.types import Floats
from mbm.target.solver import consensus_records as c
from mbm.values import dataclass

KEPT = "consensus"
"""Where the cache of a problem keeps what consensus has learnt of it."""


@dataclass(slots=True, eq=False)
class Learnt:
    """Closed forms by the structure of the equations, None where there is none."""

    forms: dict[object, KnownForm | None] = field(default_factory=dict)
    rules: dict[object, Rules] = field(default_factory=dict)
    rooms: Rooms = field(default_factory=Rooms)


def agreed_natively(
    problem: Problem,
    equations: Assembled,
    settings: Settings,
    consensus: Consensus,
    ruled: Callable[[Block], bool],
    starts: Floats | None,
) -> Agreed | None:
    """The units of the ``ruled`` blocks that agree, from ``starts`` (S, N); None where the general path takes over.

    Without starts (None) the closed form has to give one; there is no answer where it does not.
    """
    plain = without_losses(equations)
    system = system_of(plain, settings)
    if system is None:
        return None
    cache = plain.groups[0].cache
    learnt = cache.native.setdefault(KEPT, Learnt())
    if not isinstance(learnt, Learnt):
        return None
    acting = tuple(ruled(problem.blocks[group.kernel.owner]) for group in plain.groups)
    if any(left_out(group) for group, mine in zip(plain.groups, acting, strict=True) if mine):
        return None
    known = _form(plain, settings, learnt)
    if starts is None and known is None:
        return None
    forms = known.of_rows(plain, acting, settings.closed_forms) if known is not None else None
    form = NO_FORM if known is None or forms is None else known.form
    begun = with_idle_ones(plain, plain.numbers)[None] if starts is None else starts
    key = (consensus, settings.seed, len(begun), form, acting, _shape(plain))
    rules = learnt.rules.get(key)
    if rules is None:
        rules = learnt.rules[key] = rules_of(
            problem, plain, consensus, acting, seed=settings.seed, starts=len(begun), form=form
        )
    code = native_code(plain.groups[0].cache)
    ends = consensus_many(
        system,
        code.consensus,
        rules,
        begun[None],
        forms,
        startless=starts is None,
        rooms=learnt.rooms,
        stopped=never if settings.interruption is None else settings.stopped,
    )
    if not ends.agreed[0]:
        return None
    return Agreed(
        point=ends.points[0],
        inliers=ends.inside,
        limits=ends.limits,
        variances=ends.variances,
        trials=int(ends.states[0, c.Verdict.trials]),
        ambiguous=bool(ends.states[0, c.Verdict.ambiguous]),
        cut_short=ends.cut_short,
    )


def left_out(group: Group) -> bool:
    """Whether some unit has a weight of zero: it takes no part, and is no outlier either."""
    firsts = (w.weights[:, 0] if w.weights.ndim == 2 else w.weights[:, 0, 0] for w in group.whiteners)
    return any(bool((first == 0.0).any()) for first in firsts)


def _form(plain: Assembled, settings: Settings, learnt: Learnt) -> KnownForm | None:
    """The closed form for equations of this structure, recognised when it is first met."""
    key = _shape(plain)
    if key not in learnt.forms:
        found = known_form(plain, settings.closed_forms)
        if found is None and not all(np.isfinite(group.parameters).all() for group in plain.groups):
            return None  # what one bad row hides is not to be missed for good
        learnt.forms[key] = found
    return learnt.forms[key]


def _shape(plain: Assembled) -> object:
    """What decides which closed form there is, and how its numbers stand."""
    names = tuple((entry.unknown.name, entry.members) for entry in plain.layout.entries)
    groups = tuple((group.number, group.rows) for group in plain.groups)  # few rows teach less than many
    return names, groups, plain.free.tobytes()
