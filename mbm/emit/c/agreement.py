"""C text for consensus before a solve: its arrays in the frame, how much room they take, and the call. C text for the
closed form of ranges beside a start: its arrays in the frame, and what is done with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mbm.emit.answers import Agreement
from mbm.emit.c.cells import Cells
from mbm.emit.c.text import doubles, longs
from mbm.emit.system import weights_width
from mbm.emit.types import BlockCase, BlockShape, Blueprint
from mbm.machine.c import number
from mbm.machine.records import slot, slots_of
from mbm.problem.types import BlockRole
from mbm.solver import consensus_records as c, description as at
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import MOST_PLACES, SCRATCH


def ruled(agreement: Agreement, number: int) -> bool:
    """Whether consensus acts on the kernel of this number."""
    first = agreement.rules[slot(c.Rules, "ruled")] + number * slots_of(c.RuledBlock)
    return agreement.rules[first + slot(c.RuledBlock, "first_level")] >= 0


def agreement_constants(agreement: Agreement) -> str:
    """The arrays that do not depend on data."""
    text = [
        longs("RULES", agreement.rules, f"What consensus ({agreement.kind}) is asked for, without room for rows."),
        doubles("LEVELS", agreement.levels, "Of each kind of unit: median, limit and reach of its squared norm."),
    ]
    if agreement.rules[c.Rules.form]:
        doc = "Of each kind of unit: where its map begins, -1: it has none."
        text += [
            longs("MAP_PLACES", agreement.map_places, doc),
            doubles("MAPS", agreement.maps, "From the data of a row to what the closed form for subsets wants."),
        ]
    return "\n".join(text)


def agreement_fields() -> Iterator[str]:
    """Arrays of the frame."""
    yield from (
        "    struct rules *rules;    /* of consensus: what is asked for */",
        "    struct consensus_work consensus;",
        "    struct problem *wide;    /* the equations with all rows side by side */",
        "    double *known;    /* what the closed form knows of the units */",
        f"    long agreement[{c.ANSWERS}], units;",
        "    int startless;",
    )


def agreement_room(blueprint: Blueprint, agreement: Agreement, prefix: int) -> Iterator[str]:
    """How much the arrays take at most."""
    cells = Cells(blueprint)
    cases = [(i, b, k) for i, (b, k) in enumerate(blueprint.cases)]
    constraints = sum(block.role is BlockRole.CONSTRAINT for block, _ in blueprint.cases)
    yield from (
        "    {    /* consensus: all rows side by side */",
        "        struct problem wide = header;",
        "        struct rules room = *(const struct rules *)RULES;",
        "        long units = 1, rows = 1;",
        f"        wide.residual_blocks = {len(cases) - constraints};",
        f"        wide.constraint_blocks = {constraints};",
        "        if (wide.chunk < residuals)",
        "            wide.chunk = (residuals + 3) / 4 * 4;",
    )
    for _, _, case in cases:
        lines = case.kernel.outputs
        needed = f"{lines + len(case.kernel.jacobian_rows)} * (wide.chunk / {lines} + 1)"
        yield from (
            f"        if (wide.most_outputs < {needed})",
            f"            wide.most_outputs = {needed};",
        )
    for block in blueprint.blocks:
        own = [(i, k) for i, b, k in cases if b is block]
        if block.role is not BlockRole.CONSTRAINT and own:
            yield from _rows(cells, block, own, agreement)
    yield from (
        "        take_sizes(&wide, &room);",
        "        room.most_units = units;",
        "        room.most_rows = rows;",
        f"        f->rules = (struct rules *)integers_of(a, {len(agreement.rules)});",
        f"        f->wide = (struct problem *)integers_of(a, {prefix} + (2 + {at.PIECE}) * n);",
        "        f->consensus.integers = integers_of(a, consensus_integers(&room));",
        "        f->consensus.reals = reals_of(a, consensus_reals(&room));",
        f"        f->known = reals_of(a, units * {max(agreement.rules[c.Rules.form_width], 1)});",
        "    }",
    )


def _rows(cells: Cells, block: BlockShape, own: Sequence[tuple[int, BlockCase]], agreement: Agreement) -> Iterator[str]:
    rows = "1" if block.table is None else cells.rows(block.table)
    acting = ruled(agreement, own[0][0])
    if acting:
        yield f"        units += {rows} * {max(len(case.equations) for _, case in own)};"
    for _, case in own:
        longest = max(len(case.parameters), weights_width(case), len(case.variables), len(case.tangents))
        yield f"        rows += ({'n' if acting else rows} + 1) * {longest};"


def agreement_beginning(blueprint: Blueprint, agreement: Agreement) -> Iterator[str]:
    """Statements of ``prepare``: nothing is agreed on yet."""
    unknowns = (blueprint.unknowns[i] for i in sorted(agreement.startless))
    tests = " || ".join(f"data->start_{unknown.identifier} == NULL" for unknown in unknowns)
    yield from (
        f"    for (b = 0; b < {len(agreement.rules)}; b++)",
        "        ((long *)f->rules)[b] = RULES[b];",
        "    f->consensus.units.inlier = f->consensus.integers;",
        f"    for (b = 0; b < {c.ANSWERS}; b++)",
        "        f->agreement[b] = 0;",
        "    f->units = 0;",
        f"    f->startless = {tests or '0'};",
    )


def agreement_function(blueprint: Blueprint, agreement: Agreement, prefix: int) -> str:
    """``agree_on``: the equations and the start as consensus leaves them, and a status."""
    cells, kept = Cells(blueprint), int(agreement.kept)
    lines = [
        "/* Consensus: where the solve begins, and which rows count. */",
        "static int agree_on(struct frame *f, double *factors)",
        "{",
        "    long scalars;",
        "",
        *(["    if (!f->startless)", "        return 0;"] if agreement.begins else []),
        "    if (f->system->n > 1",
        "        && !connected(f->system, f->data_set, f->columns, f->consensus.integers))",
        f"        return {cells.status('NOT_CONNECTED')};",
        f"    side_by_side((long *)f->system, {prefix} + (2 + {at.PIECE}) * f->system->n, (long *)f->wide);",
        "    scalars = set_room(f->wide, f->data_set, f->rules);",
        "    f->rules->startless = f->startless;",
    ]
    if agreement.rules[c.Rules.form]:
        lines += [
            "    known_units(f->system, &f->work.rows, f->rules, MAP_PLACES, MAPS,",
            f"        {number(agreement.sign)}, f->known);",
        ]
    lines += [
        "    f->consensus.rules = f->rules;",
        "    f->consensus.levels = LEVELS;",
        "    f->consensus.forms = f->known;",
        "    f->consensus.verdict = (struct verdict *)f->agreement;",
        f"    f->units = begin_by_consensus({kept}, scalars, f->system, f->wide, &f->work, &f->consensus, f->start);",
        f"    take_agreement({kept}, f->system, &f->work.rows, &f->consensus, f->start, f->kappa, factors);",
        f"    if (f->startless && f->agreement[{c.Verdict.agreed}] == 0)",
        f"        return {cells.status('NO_START')};",
        "    return 0;",
        "}",
        "",
    ]
    return "\n".join(lines)


def agreement_answer(agreement: Agreement) -> Iterator[str]:
    """Statements of ``answer`` that tell the caller which units agree."""
    if agreement.kept:
        yield from (
            "    result->units = f->units;",
            f"    result->inliers = f->agreement[{c.Verdict.inliers}];",
            f"    result->ambiguous = f->agreement[{c.Verdict.ambiguous}] != 0;",
            "    result->inside = f->consensus.units.inlier;",
        )


def range_constants(ranges: RangeMaps) -> str:
    """The arrays that do not depend on data."""
    text = [
        longs("RANGE_PLACES", ranges.places, "Where what the ranges give stands among the numbers."),
        longs("RANGE_MAP_PLACES", ranges.map_places, "Of each kind of unit: where its map begins, -1: no range."),
        doubles("RANGE_MAPS", ranges.maps, "From the data of a row to station, length, addition and slope."),
        longs("RANGE_FIXED", ranges.fixed or (0,), "Numbers that are not estimated …"),
        doubles("RANGE_VALUES", ranges.values or (0.0,), "… and what they were."),
    ]
    return "\n".join(text)


def range_fields() -> Iterator[str]:
    """Arrays of the frame."""
    yield from (
        "    struct range_form form;    /* what the ranges say of where to begin */",
        "    int startless;",
    )


def range_room(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """How much the arrays take at most."""
    cells = Cells(blueprint)
    yield from ("    {    /* ranges */", "        long units = 1;")
    for block in blueprint.blocks:
        if block.role is not BlockRole.CONSTRAINT:
            rows = "1" if block.table is None else cells.rows(block.table)
            yield f"        units += {rows} * {max((len(case.equations) for case in block.cases), default=0)};"
    yield from (
        f"        f->form.ranges.spheres = reals_of(a, {ranges.dimension + 3} * units);",
        "        f->form.ranges.weights = reals_of(a, units);",
        f"        f->form.ranges.scratch = reals_of(a, {SCRATCH});",
        f"        f->form.found = reals_of(a, {MOST_PLACES * len(ranges.places)});",
        "        f->form.point = reals_of(a, numbers);",
        "        f->form.other = reals_of(a, numbers);",
        "    }",
    )


def range_beginning(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """Statements of ``prepare``."""
    unknowns = (blueprint.unknowns[i] for i in sorted(ranges.startless))
    tests = " || ".join(f"data->start_{unknown.identifier} == NULL" for unknown in unknowns)
    yield from (
        f"    f->form.ranges.d = {ranges.dimension};",
        f"    f->form.ranges.offset = {int(ranges.offset)};",
        f"    f->form.ranges.even = {int(ranges.even)};",
        f"    f->form.rooted = {int(ranges.rooted)};",
        f"    f->form.stated = {int(ranges.stated)};",
        "    f->form.places = RANGE_PLACES;",
        "    f->form.map_places = RANGE_MAP_PLACES;",
        "    f->form.maps = RANGE_MAPS;",
        f"    f->form.held = {int(ranges.held)};",
        f"    f->form.fixed_count = {len(ranges.fixed)};",
        "    f->form.fixed = RANGE_FIXED;",
        "    f->form.values = RANGE_VALUES;",
        f"    f->startless = {tests or '0'};",
    )


def range_solve(ranges: RangeMaps, no_start: str) -> Iterator[str]:
    """Statements of the solve: from the start, or where the ranges lead; ``no_start`` is a status."""
    if ranges.startless:
        yield from (
            "    if (f->startless && begin_at_ranges(f->system, f->start, &f->form, &f->work) == 0)",
            f"        return result->status = {no_start};",
        )
    yield "    solve_from(f->system, f->data_set, 0, f->start, &f->form, &f->work);"
