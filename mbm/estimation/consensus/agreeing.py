"""Consensus of one data set by the compiled solver."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.consensus.forms import KnownForm, known_form
from mbm.estimation.consensus.native import Begun, ConsensusEnds, Rooms, consensus_many
from mbm.estimation.consensus.rules import NO_FORM, Form, Rules, rules_of
from mbm.estimation.consensus.types import Agreed, Asked, with_held
from mbm.estimation.consensus.units import without_losses
from mbm.estimation.minimise.native.iteration import iteration_of
from mbm.estimation.minimise.native.system import NativeSystem, never, system_of
from mbm.estimation.native.code import native_code
from mbm.estimation.search.starting import with_idle_ones
from mbm.estimation.settings import Settings
from mbm.solver import consensus_records as c
from mbm.values import dataclass

KEPT = "consensus"
"""Where the cache of a problem keeps what consensus has learnt of it."""


@dataclass(slots=True, eq=False)
class Learnt:
    """Closed forms by the structure of the equations, None where there is none."""

    forms: dict[object, KnownForm | None] = field(default_factory=dict)
    rules: dict[object, Rules] = field(default_factory=dict)
    rooms: Rooms = field(default_factory=Rooms)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Handed:
    """Equations as the solver has them: its blocks are the groups of ``equations``, those ``acting`` have units.

    ``units`` (U,) are the numbers of those that take part, in the solver's order; in the caller's equations.
    """

    system: NativeSystem
    equations: Assembled
    acting: tuple[bool, ...]
    units: Indices


def agreed(asked: Asked, equations: Assembled, starts: Floats, *, near: bool = False, once: bool = False) -> Agreed:
    """The units of the ruled blocks that agree, in ascending order, from ``starts`` (S, N).

    Units that a weight of zero leaves out count as agreeing, unless no unit has a value. ``near``: the one start is a
    consensus of some of the units already. ``once``: equations of this structure do not come again, so that nothing is
    kept of them.
    """
    plain = with_held(asked.held, without_losses(equations).roughly_corrected())
    learnt = Learnt() if once else _learnt(plain)
    formless = plain.implicit is not None or near or plain.constraints
    known = None if formless else _form(plain, asked.settings, learnt)
    handed = _handed(asked, plain, kept=not once)
    forms = None if known is None else _known_rows(known, asked, plain, handed.units)
    form = NO_FORM if known is None or forms is None else known.form
    ends = _ended(asked, handed, learnt, form, Begun(starts=starts[None], forms=forms, near=near))
    return _answer(asked, plain, handed, ends)


def agreed_anywhere(asked: Asked, equations: Assembled) -> Agreed | None:
    """The same from what a closed form gives; None where there is none, or it leads to nothing."""
    plain = with_held(None, without_losses(equations).roughly_corrected())
    learnt = _learnt(plain)
    known = None if plain.implicit is not None else _form(plain, asked.settings, learnt)
    if known is None:
        return None
    handed = _handed(asked, plain, kept=True)
    forms = _known_rows(known, asked, plain, handed.units)
    start = with_idle_ones(plain, plain.numbers)[None]
    form = NO_FORM if forms is None else known.form
    ends = _ended(asked, handed, learnt, form, Begun(starts=start[None], forms=forms, startless=True))
    return _answer(asked, plain, handed, ends) if ends.agreed[0] else None


def _learnt(plain: Assembled) -> Learnt:
    """What the cache of the problem keeps."""
    found = plain.groups[0].cache.native.setdefault(KEPT, Learnt())
    if not isinstance(found, Learnt):
        raise TypeError(found)
    return found


def _ended(asked: Asked, handed: _Handed, learnt: Learnt, form: Form, begun: Begun) -> ConsensusEnds:
    settings = asked.settings
    return consensus_many(
        handed.system,
        native_code(handed.equations.groups[0].cache).consensus,
        _rules(asked, handed, learnt, form, begun.starts.shape[1]),
        replace(begun, units_at=np.array([0, len(handed.units)])),
        rooms=learnt.rooms,
        stopped=never if settings.interruption is None else settings.stopped,
    )


def _answer(asked: Asked, plain: Assembled, handed: _Handed, ends: ConsensusEnds) -> Agreed:
    """The ends by all units, those that took no part included."""
    every = _units(plain, asked.acting(plain))
    place = np.searchsorted(every, handed.units)
    inliers = np.full(len(every), ends.agreed[0])
    limits, variances = np.full(len(every), np.inf), np.ones(len(every))
    inliers[place], limits[place], variances[place] = ends.inside & ends.agreed[0], ends.limits, ends.variances
    return Agreed(
        point=ends.points[0],
        inliers=inliers,
        limits=limits,
        variances=variances,
        trials=int(ends.states[0, c.Verdict.trials]),
        ambiguous=bool(ends.states[0, c.Verdict.ambiguous]),
        cut_short=ends.cut_short,
    )


def _handed(asked: Asked, plain: Assembled, *, kept: bool) -> _Handed:
    """The equations for the solver: by their kernels, else as rows of all of them."""
    system = system_of(plain, asked.settings, kept=kept)
    if system is not None:
        acting = asked.acting(plain)
        return _Handed(system=system, equations=plain, acting=acting, units=_units(plain, acting, taking_part=True))
    # Loaded by such equations only, so that others begin at once.
    from mbm.estimation.minimise.native.function import picked_rows

    picked = picked_rows(plain)
    iteration = iteration_of(plain, asked.settings, direct=False, strict=True)
    acting = asked.acting(picked.equations)
    mine = [units for units, acts in zip(picked.units, acting, strict=True) if acts]
    return _Handed(
        system=picked.system(iteration, native_code(plain.groups[0].cache).solver),
        equations=picked.equations,
        acting=acting,
        units=np.concatenate(mine) if mine else np.empty(0, dtype=np.int64),
    )


def _units(plain: Assembled, acting: tuple[bool, ...], *, taking_part: bool = False) -> Indices:
    """The units (U,) of the groups that are ``acting``, as far as they are picked; those ``taking_part`` alone."""
    picked = None
    if plain.rows is not None:
        picked = np.zeros(plain.whole, dtype=bool)
        picked[plain.rows] = True
    found = [np.empty(0, dtype=np.int64)]
    for group, acts in zip(plain.groups, acting, strict=True):
        if acts:
            mine = ~group.left_out if taking_part else np.ones((group.rows, len(group.whiteners)), dtype=bool)
            if picked is not None:
                lines = picked[group.first : group.first + group.count].reshape(group.rows, -1)
                mine &= lines[:, [whitener.first for whitener in group.whiteners]]
            found.append(group.first_unit + np.flatnonzero(mine))
    return np.concatenate(found)


def _rules(asked: Asked, handed: _Handed, learnt: Learnt, form: Form, starts: int) -> Rules:
    """The rules for such equations."""
    plain = handed.equations
    shape = tuple((g.kernel.owner, tuple((w.first, w.last) for w in g.whiteners)) for g in plain.groups)
    key = (asked.consensus, asked.settings.seed, starts, form, handed.acting, asked.stated, plain.dimension, shape)
    found = learnt.rules.get(key)
    if found is None:
        found = learnt.rules[key] = rules_of(asked, plain, handed.acting, starts=starts, form=form)
    return found


def _known_rows(known: KnownForm, asked: Asked, plain: Assembled, units: Indices) -> Floats | None:
    """What the closed form knows of the ``units`` (U, width)."""
    acting = asked.acting(plain)
    found = known.of_rows(plain, acting, asked.settings.closed_forms)
    every = _units(plain if plain.rows is None else plain.everything(), acting)
    return None if found is None else found[np.searchsorted(every, units)]


def _form(plain: Assembled, settings: Settings, learnt: Learnt) -> KnownForm | None:
    """The closed form for equations of this structure, recognised when it is first met."""
    if not settings.closed_forms:
        return None
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
