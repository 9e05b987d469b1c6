"""What a generated solver does before it solves: consensus, prepared where the problem is known, but not the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.emit import faults
from mbm.emit.answers import Agreement
from mbm.equations.assembly import Assembled, loss_lines
from mbm.estimation.consensus.forms import KnownForm, known_form
from mbm.estimation.consensus.parts import Part, parts_of
from mbm.estimation.consensus.rules import NO_FORM, rules_of
from mbm.estimation.consensus.types import Asked, observed, with_loss
from mbm.estimation.consensus.units import without_losses
from mbm.estimation.settings import Settings
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import ConsensusKind
from mbm.problem.types import Consensus, Problem
from mbm.solver import consensus_records as c
from mbm.solver.decisions import MANY_CONNECTED
from mbm.text.suggest import listed
from mbm.text.types import MbmError

BY_MEDIAN = Consensus(kind=ConsensusKind.LMEDS)
"""What is asked for where the problem asks for nothing by name."""


def agreement_of(found: Elaborated, equations: Assembled, settings: Settings) -> Agreement | None:
    """The consensus of a problem with such ``equations``; None: it asks for none.

    Raises:
        MbmError: `mbm solve` has a consensus of its own for it, which generated solvers have not.

    """
    asked = _asked(found.problem, equations, settings)
    if asked is None:
        return None
    plain = without_losses(equations)
    _refuse(found.problem, plain, lossy=settings.robust is None)
    return _agreement(asked, plain, begins=False)


def beginning_of(found: Elaborated, equations: Assembled, settings: Settings) -> Agreement | None:
    """What gives a start to a problem that asks for no consensus and states none; None: its closed forms do not."""
    missing = np.isnan(equations.layout.start) | equations.layout.guessed
    plain = without_losses(equations)
    if equations.lossy or settings.robust is not None or not bool((missing & equations.moving()).any()):
        return None
    try:
        _refuse(found.problem, plain, lossy=False)
        asked = Asked(problem=found.problem, settings=settings, consensus=BY_MEDIAN, ruled=observed)
        made = _agreement(asked, plain, begins=True)
    except MbmError:
        return None
    return made if made.startless else None


def _agreement(asked: Asked, plain: Assembled, *, begins: bool) -> Agreement:
    """Consensus of ``plain`` equations; ``begins``: for a start alone."""
    problem, settings, consensus = asked.problem, asked.settings, asked.consensus
    acting = asked.acting(plain)
    known = _form(problem, plain, settings)
    families = any(unknown.family is not None for unknown in problem.unknowns)
    rules = rules_of(
        asked,
        plain,
        acting,
        form=NO_FORM if known is None else known.form,
        dimension=MANY_CONNECTED if families else None,
    )
    places, maps = ((), ()) if known is None else known.tables(plain, acting, open_ones=False)
    kept = settings.robust is not None
    anywhere = begins or (kept and consensus.kind is not ConsensusKind.GNC)
    return Agreement(
        kind=consensus.kind.value,
        kept=kept,
        begins=begins,
        rules=tuple(rules.rules.tolist()),
        levels=tuple(rules.levels.tolist()),
        map_places=places,
        maps=maps,
        sign=1.0 if known is None else known.sign,
        startless=frozenset() if known is None or not anywhere else _startless(plain, known),
    )


def _asked(problem: Problem, equations: Assembled, settings: Settings) -> Asked | None:
    """The consensus that `:robust` asks for, else least medians for losses that need them."""
    if settings.robust is not None:
        return Asked(problem=problem, settings=settings, consensus=settings.robust, ruled=observed)
    unknown = any(block.loss is not None and block.unknown_factor for block in problem.blocks)
    if not unknown and all(loss.convex for loss, _ in loss_lines(equations)):
        return None
    return Asked(problem=problem, settings=settings, consensus=BY_MEDIAN, ruled=with_loss)


def _refuse(problem: Problem, equations: Assembled, *, lossy: bool) -> None:
    """``lossy``: it is a loss that begins with a consensus."""
    if equations.dimension > MANY_CONNECTED:
        why = f"with more than {MANY_CONNECTED} unknowns it takes losses in place of subsets, which `mbm solve` has"
        raise MbmError(faults.not_emitted(problem.span, f"consensus of {equations.dimension} unknowns", why))
    parts = parts_of(equations) if equations.dimension > 1 else ()
    if len(parts) > 1:
        why = f"{_unconnected(equations, parts)}, and `mbm solve` takes the parts one by one"
        what, todo = "consensus of several parts", "compile a problem for one part, and call it for each"
        if lossy:
            what = "a `:loss` that is not convex, or beside `:sigma unknown`, in several parts"
            why = f"it begins with a consensus, {why}"
            todo = f"{todo}; a convex loss such as `huber`, of stated noise, needs no consensus"
        raise MbmError(faults.not_emitted(problem.span, what, why, todo))


def _unconnected(equations: Assembled, parts: Sequence[Part]) -> str:
    """What parts there are, in words."""
    entries = equations.layout.entries
    names = [
        {e.unknown.name for e in entries if bool(np.isin(part.columns, np.arange(e.first, e.coordinates.stop)).any())}
        for part in parts
    ]
    alone = min(names, key=len)
    if alone & set().union(*(each for each in names if each is not alone)):
        return "no equation connects all unknowns"
    return f"no equation connects {listed(tuple(sorted(alone)))} with the other unknowns"


def _form(problem: Problem, equations: Assembled, settings: Settings) -> KnownForm | None:
    """The closed form that fits subsets, as a map of the data.

    Raises:
        MbmError: there is one, but nothing simple says what it knows of other data.

    """
    known = known_form(equations, settings.closed_forms)
    moving = any(unknown.family is not None for unknown in problem.unknowns)
    if known is not None and (known.maps is None or known.rooted or moving):
        why = "its subsets have a closed form, and what that takes from the data follows no simple rule"
        raise MbmError(faults.not_emitted(problem.span, "this consensus", why))
    return known


def _startless(equations: Assembled, known: KnownForm) -> frozenset[int]:
    """The unknowns without a start of their own, if the closed form gives all that they lack."""
    layout = equations.layout
    missing = (np.isnan(layout.start) | layout.guessed) & equations.moving()
    first = 3 if known.form.kind == c.SPHERES else 2
    given = np.zeros(len(missing), dtype=bool)
    given[list(known.form.about[first:])] = True
    if bool((missing & ~given).any()):
        return frozenset()
    return frozenset(i for i, entry in enumerate(layout.entries) if bool(missing[entry.range].any()))
