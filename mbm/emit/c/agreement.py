"""C text for consensus before a solve: its arrays in the frame, how much room they take, and the call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mbm.emit.answers import Agreement
from mbm.emit.c.cells import Cells
from mbm.emit.c.layout import doubles, longs
from mbm.emit.system import weights_width
from mbm.emit.types import BlockCase, BlockShape, Blueprint
from mbm.problem.types import BlockRole
from mbm.target.c import number
from mbm.target.solver import consensus_description as c
from mbm.target.solver import description as at


def called(agreement: Agreement, lossy: bool) -> list[str]:
    """The routines that the text calls; ``lossy``: the covariance is that of losses."""
    names = [
        "come_to_agreement",
        "connected",
        "set_room",
        "side_by_side",
        "bench_reals",
        "places_integers",
    ]
    names += ["place_vector_at"] if agreement.kept else []
    names += ["inform"] if agreement.kept and not lossy else []
    return names + (["known_units"] if agreement.rules[c.FORM] else [])


def ruled(agreement: Agreement, number: int) -> bool:
    """Whether consensus acts on the kernel of this number."""
    return agreement.rules[agreement.rules[c.BLOCKS_AT] + number * c.RULED + c.RULED_TYPE] >= 0


def agreement_constants(agreement: Agreement) -> str:
    """The arrays that do not depend on data."""
    text = [longs("RULES", agreement.rules, f"What consensus ({agreement.kind}) is asked for, without room for rows.")]
    text += [doubles("LEVELS", agreement.levels, "Of each kind of unit: median, limit and reach of its squared norm.")]
    if agreement.rules[c.FORM]:
        doc = "Of each kind of unit: where its map begins, -1: it has none."
        text += [longs("MAP_PLACES", agreement.map_places, doc)]
        text += [doubles("MAPS", agreement.maps, "From the data of a row to what the closed form for subsets wants.")]
    return "\n".join(text)


def agreement_fields() -> Iterator[str]:
    """Arrays of the frame."""
    yield "    long *rules, *places;    /* of consensus: what is asked for, scratch */"
    yield "    struct problem *wide;    /* the equations with all rows side by side */"
    yield "    double *desk, *bench, *known;    /* scratch, and what the closed form knows of the units */"
    yield f"    long agreement[{c.ANSWERS}], units;"
    yield "    int startless;"


def agreement_room(blueprint: Blueprint, agreement: Agreement, prefix: int) -> Iterator[str]:
    """How much the arrays take at most; the header in ``lay_out`` is widened, as all rows stand side by side."""
    cells = Cells(blueprint)
    cases = [(i, b, k) for i, (b, k) in enumerate(blueprint.cases)]
    head = ", ".join(str(v) for v in agreement.rules[: c.HEADER])
    width = agreement.rules[c.FORM_WIDTH]
    yield "    {    /* consensus: all rows side by side */"
    yield f"        long room[{c.HEADER}] = {{{head}}};"
    yield "        long units = 1, rows = 1;"
    constraints = sum(block.role is BlockRole.CONSTRAINT for block, _ in blueprint.cases)
    yield f"        header.residual_blocks = {len(cases) - constraints};"
    yield f"        header.constraint_blocks = {constraints};"
    yield "        if (header.chunk < residuals)"
    yield "            header.chunk = (residuals + 3) / 4 * 4;"
    for _, _, case in cases:
        lines = case.kernel.outputs
        wide = f"{lines + len(case.kernel.jacobian_rows)} * (header.chunk / {lines} + 1)"
        yield f"        if (header.most_outputs < {wide})"
        yield f"            header.most_outputs = {wide};"
    for block in blueprint.blocks:
        own = [(i, k) for i, b, k in cases if b is block]
        if block.role is not BlockRole.CONSTRAINT and own:
            yield from _rows(cells, block, own, agreement)
    yield f"        room[{c.MOST_UNITS}] = units;"
    yield f"        room[{c.MOST_ROWS}] = rows;"
    yield f"        f->rules = integers_of(a, {len(agreement.rules)});"
    yield f"        f->wide = (struct problem *)integers_of(a, {prefix} + (2 + {at.PIECE}) * n);"
    yield "        f->places = integers_of(a, places_integers(&header, room));"
    yield "        f->bench = reals_of(a, bench_reals(&header, room));"
    yield "        f->desk = reals_of(a, rows_reals(&header));"
    yield f"        f->known = reals_of(a, units * {max(width, 1)});"
    yield "    }"


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
    yield f"    for (b = 0; b < {len(agreement.rules)}; b++)"
    yield "        f->rules[b] = RULES[b];"
    yield f"    for (b = 0; b < {c.ANSWERS}; b++)"
    yield "        f->agreement[b] = 0;"
    yield "    f->units = 0;"
    yield f"    f->startless = {tests or '0'};"


def agreement_function(blueprint: Blueprint, agreement: Agreement, prefix: int) -> str:
    """``agree_on``: the equations and the start as consensus leaves them, and a status."""
    cells = Cells(blueprint)
    lines = ["/* Consensus: where the solve begins, and which rows count. */"]
    lines += ["static int agree_on(struct frame *f, double *factors)", "{"]
    lines += ["    long scalars;", ""]
    lines += ["    if (!f->startless)", "        return 0;"] if agreement.begins else []
    lines += ["    if (f->system->n > 1"]
    lines += ["        && !connected(f->system, f->data_set, f->columns, f->places))"]
    lines += [f"        return {cells.status('NOT_CONNECTED')};"]
    lines += ["    scalars = set_room(f->system, f->data_set, f->rules);"]
    lines += [f"    side_by_side((long *)f->system, {prefix} + (2 + {at.PIECE}) * f->system->n, (long *)f->wide);"]
    lines += [f"    f->rules[{c.STARTLESS}] = f->startless;"]
    if agreement.rules[c.FORM]:
        lines += ["    known_units(f->system, f->data_set, f->rules, MAP_PLACES, MAPS,"]
        lines += [f"        {number(agreement.sign)}, f->parameters, f->known);"]
    lines += [f"    f->units = come_to_agreement({int(agreement.kept)}, scalars, f->system, f->wide, f->constants,"]
    lines += ["        f->data_set, f->parameters, f->weights, f->index, f->columns, f->rules, LEVELS, f->known,"]
    lines += ["        f->start, f->work.rows, f->desk, f->bench, f->places, f->agreement, f->kappa, factors);"]
    lines += [f"    if (f->startless && f->agreement[{c.AGREED}] == 0)"]
    lines += [f"        return {cells.status('NO_START')};", "    return 0;", "}", ""]
    return "\n".join(lines)


def agreement_answer(agreement: Agreement) -> Iterator[str]:
    """Statements of ``answer`` that tell the caller which units agree."""
    if agreement.kept:
        yield "    result->units = f->units;"
        yield f"    result->inliers = f->agreement[{c.INLIERS}];"
        yield f"    result->ambiguous = f->agreement[{c.AMBIGUOUS}] != 0;"
        yield f"    result->inside = f->places + place_vector_at(f->rules, {c.INSIDE});"
