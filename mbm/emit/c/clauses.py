"""C functions that turn the rows of a clause into the arrays of the solver."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.text import remark
from mbm.emit.system import varies
from mbm.emit.types import BlockCase, BlockShape, Blueprint, ColumnValue, SlotPlace
from mbm.problem.types import NoiseKind


def clause_functions(blueprint: Blueprint) -> str:
    """One function for each kernel, and ``assemble``, which goes through the clauses."""
    cells = Cells(blueprint)
    numbers = {id(case): number for number, (_, case) in enumerate(blueprint.cases)}
    parts = []
    for block in blueprint.blocks:
        parts += ["\n".join(chosen_rows(blueprint, cells, block))]
        parts += ["\n".join(_case(blueprint, cells, block, c, numbers[id(c)])) for c in block.cases]
    return "\n".join([*parts, *_assemble(blueprint, cells)])


def _inputs(block: BlockShape) -> int:
    noise = max((len(c.noise.inputs) for c in block.cases if c.noise is not None), default=0)
    when = max((len(c.inputs) for c in block.when.cases), default=0) if block.when is not None else 0
    return max(noise, when, 1)


def chosen_rows(blueprint: Blueprint, cells: Cells, block: BlockShape) -> Iterator[str]:
    """The rows of the table that a clause uses: of `kept` those that `:when` lets through, each kind once."""
    if block.table is None:
        return
    yield remark("The rows of `", block.table, "` that ", block.name, " is about.")
    yield f"static int {block.identifier}_rows(struct frame *f, long *count)"
    yield "{"
    yield f"    const {blueprint.identifier}_data *data = f->data;"
    filtered = blueprint.table(block.table).where is not None
    yield f"    long {'i' if filtered else 'row'};"
    if block.distinct:
        yield "    long j;"
    if block.when is not None:
        yield f"    double inputs[{_inputs(block)}], used;"
    yield ""
    yield "    (void)data;"
    yield "    *count = 0;"
    opened, closed = cells.loop(block.table)
    yield from opened
    if block.when is not None:
        yield from cells.call(block.when, "&used", "        ")
        yield "        if (used != 1.0)"
        yield "            continue;"
    if block.distinct:
        same = " && ".join(_same(cells, value) for value in block.distinct)
        yield "        for (j = 0; j < *count; j++)"
        yield f"            if ({same})"
        yield "                break;"
        yield "        if (j < *count)"
        yield "            continue;"
    yield "        f->chosen[(*count)++] = row;"
    yield from closed
    yield "    return 0;"
    yield "}"
    yield ""


def _same(cells: Cells, value: ColumnValue) -> str:
    here, there = cells.cell(value), cells.cell(value, "f->chosen[j]")
    return f"strcmp({here}, {there}) == 0" if cells.is_text(value) else f"{here} == {there}"


def _case(blueprint: Blueprint, cells: Cells, block: BlockShape, case: BlockCase, number: int) -> Iterator[str]:
    yield f"/* Parameters, weights and unknowns of the rows of {case.identifier}: kernel {number}. */"
    yield f"static int {case.identifier}_assemble(struct frame *f, long count)"
    yield "{"
    yield f"    const {blueprint.identifier}_data *data = f->data;"
    if case.noise is not None:
        yield f"    double inputs[{max(len(case.noise.inputs), 1)}], noise[{len(case.noise.program.outputs)}];"
    yield f"    struct data_block *own = &blocks_of_data_set(f->data_set)[{number}];"
    yield "    long i, rows = 0;"
    yield ""
    yield "    (void)data;"
    if case.noise is not None and not case.noise.inputs:
        yield "    inputs[0] = 0.0;"
    for used in ("parameters", "weights", "index", "columns"):
        yield f"    own->{used} = f->{used}_used;"
    yield "    for (i = 0; i < count; i++) {"
    if block.table is not None:
        yield "        const long row = f->chosen[i];"
        yield from () if cells.reads(case) or varies(blueprint, case) else ("        (void)row;",)
    yield from (f"        {line}" for line in _row(blueprint, cells, case))
    yield "    }"
    yield "    own->rows = rows;"
    yield "    return (int)rows;"
    yield "}"
    yield ""


def _row(blueprint: Blueprint, cells: Cells, case: BlockCase) -> Iterator[str]:
    if case.static:
        tests = " && ".join(cells.equals(value, key) for value, key in case.static)
        yield f"if (!({tests}))"
        yield "    continue;"
    for value in case.parameters:
        yield f"f->parameters[f->parameters_used++] = {cells.input(value)};"
    if case.noise is not None:
        yield from weights(cells, case)
    lines = [
        *(_place(cells, blueprint, "index", "offsets", s) for s in case.variables),
        *(_place(cells, blueprint, "columns", "firsts", s) for s in case.tangents),
    ]
    if varies(blueprint, case):
        yield from lines
    else:
        yield "if (rows == 0) {    /* all rows share their unknowns */"
        yield from (f"    {line}" for line in lines)
        yield "}"
    yield "rows++;"


def _place(cells: Cells, blueprint: Blueprint, array: str, origin: str, slot: SlotPlace) -> str:
    text = f"f->{array}[f->{array}_used++] = {cells.slot(slot, origin)};"
    return f"{text}    {remark(blueprint.unknowns[slot.unknown].name)}"


def weights(cells: Cells, case: BlockCase) -> Iterator[str]:
    """The noise of the row at hand as weights."""
    if case.noise is None:
        return
    yield from cells.arguments(case.noise, "")
    yield f"{case.identifier}_noise(inputs, noise);"
    first = 0
    for equation in case.equations:
        size = equation.last - equation.first
        if equation.noise_kind is NoiseKind.SIGMA:
            for i in range(size):
                yield f"if (!weight_of_sigma(noise[{first + i}], f->weights + f->weights_used + {i}))"
                yield "    return -1;"
            yield f"f->weights_used += {size};"
            first += size
            continue
        word = equation.noise_kind.value
        yield f"if (!weights_of_{word}(noise + {first}, {size}, f->scratch, f->weights + f->weights_used))"
        yield "    return -1;"
        yield f"f->weights_used += {size * size};"
        first += size * size


def _assemble(blueprint: Blueprint, cells: Cells) -> Iterator[str]:
    yield "/* All clauses: the rows that they use, each in the case that its values ask for. */"
    yield "static int assemble(struct frame *f)"
    yield "{"
    yield "    long count;"
    yield "    int rows, all, status = 0;"
    yield ""
    for block in blueprint.blocks:
        yield from count_of_rows(block)
        for case in block.cases:
            yield f"    rows = {case.identifier}_assemble(f, count);"
            yield "    if (rows < 0)"
            yield f"        return {cells.status('BAD_NOISE')};"
            yield "    all += rows;"
        yield "    if (all != count)"
        yield f"        return {cells.status('UNKNOWN_CASE')};"
    yield "    return status;"
    yield "}"
    yield ""


def count_of_rows(block: BlockShape) -> Iterator[str]:
    """Statements that choose the rows of a clause and count them; no case has taken any yet."""
    yield f"    {remark(block.role.value, ' ', block.name)}"
    if block.table is None:
        yield "    count = 1;"
    else:
        yield f"    status = {block.identifier}_rows(f, &count);"
        yield "    if (status != 0)"
        yield "        return status;"
    yield "    all = 0;"
