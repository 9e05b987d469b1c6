"""Python text for consensus before a solve: its constants, and the function that asks for it."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.answers import Agreement
from mbm.emit.python.text import literal
from mbm.emit.types import Blueprint
from mbm.solver import consensus_records as c

NOTHING = '''def agree_on(p: Prepared, factors: Array) -> None:
    """No consensus is asked for: all rows count, and the start is the one stated."""
'''
AGREE = '''def agree_on(p: Prepared, factors: Array) -> dict[str, Any] | None:
    """Consensus: where the solve begins and which rows count, in place; what there is to say of them."""
    startless = any(name not in p.given for name in STARTLESS_ONES)
    if BEGINS and not startless:
        return None
    if p.free > 1 and not connected(p.system, p.data, p.columns, integers(p.free)):
        raise DataError("no equation connects all unknowns, or they are more than 60: consensus is not for them")
    rules, wide, states = RULES.copy(), p.system.copy(), integers(ANSWERS)
    side_by_side(p.system, len(p.system), wide)
    scalars = set_room(wide, p.data, rules)
    rules[STARTLESS] = int(startless)
    known = reals(rules[MOST_UNITS] * rules[FORM_WIDTH])
    work = ConsensusWork()
    with np.errstate(all="ignore"):
        if rules[FORM]:
            known_units(p.system, p.work.rows, rules, MAP_PLACES, MAPS, SIGN, known)
        work.rules, work.levels, work.forms, work.verdict = rules, LEVELS, known, states
        work.reals, work.integers = reals(consensus_reals(rules)), integers(consensus_integers(rules))
        units = begin_by_consensus(int(KEPT), scalars, wide, p.work.rows, work, p.start, p.kappa, factors)
    if startless and not states[AGREED]:
        raise DataError("the data give no start: state one")
    return {
        "units": int(units),
        "inliers": int(states[INLIERS]),
        "ambiguous": bool(states[AMBIGUOUS]),
        "inside": work.units.inlier[:units] == 1 if units else np.zeros(0, dtype=bool),
    }
'''
PLACES = {
    "STARTLESS": c.Rules.startless,
    "MOST_UNITS": c.Rules.most_units,
    "FORM": c.Rules.form,
    "FORM_WIDTH": c.Rules.form_width,
    "ANSWERS": c.ANSWERS,
    "AGREED": c.Verdict.agreed,
    "INLIERS": c.Verdict.inliers,
    "AMBIGUOUS": c.Verdict.ambiguous,
}
"""Places in the arrays of consensus, by their names in the text."""


def agreement_constants(blueprint: Blueprint, agreement: Agreement) -> Iterator[tuple[str, str, str]]:
    """Names, values and documentation of what consensus is asked for."""
    startless = [literal(u.name) for i, u in enumerate(blueprint.unknowns) if i in agreement.startless]
    doc = f"What consensus ({agreement.kind}) is asked for, without room for rows."
    yield "RULES", f"np.array({list(agreement.rules)!r}, dtype=np.int64)", doc
    doc = "Of each kind of unit: median, limit and reach of its squared norm."
    yield "LEVELS", f"np.array({list(agreement.levels)!r})", doc
    doc = "Of each kind of unit: where its map begins, -1: it has none."
    yield "MAP_PLACES", f"np.array({list(agreement.map_places) or [0]!r}, dtype=np.int64)", doc
    doc = "From the data of a row to what the closed form for subsets wants."
    yield "MAPS", f"np.array({list(agreement.maps) or [0.0]!r})", doc
    yield "SIGN", repr(agreement.sign), "That of lines of sight."
    yield "KEPT", repr(agreement.kept), "Whether rows that do not agree are left out."
    yield "BEGINS", repr(agreement.begins), "Whether nothing is asked for but a start where none is given."
    yield (
        "STARTLESS_ONES",
        f"({''.join(f'{name}, ' for name in startless)})",
        "Unknowns that begin where the data say, unless a start is given.",
    )
