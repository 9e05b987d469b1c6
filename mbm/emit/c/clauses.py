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
        parts += [
            "\n".join(chosen_rows(blueprint, cells, block)),
            *["\n".join(_case(blueprint, cells, block, c, numbers[id(c)])) for c in block.cases],
        ]
    return "\n".join([*parts, *_assemble(blueprint, cells)])


def _inputs(block: BlockShape) -> int:
    noise = max((len(c.noise.inputs) for c in block.cases if c.noise is not None), default=0)
    when = max((len(c.inputs) for c in block.when.cases), default=0) if block.when is not None else 0
    return max(noise, when, 1)


def chosen_rows(blueprint: Blueprint, cells: Cells, block: BlockShape) -> Iterator[str]:
    """The rows of the table that a clause uses: of `kept` those that `:when` lets through, each kind once."""
    if block.table is None:
        return
    yield from (
        remark("The rows of `", block.table, "` that ", block.name, " is about."),
        f"static int {block.identifier}_rows(struct frame *f, long *count)",
        "{",
        f"    const {blueprint.identifier}_data *data = f->data;",
    )
    filtered = blueprint.table(block.table).where is not None
    yield f"    long {'i' if filtered else 'row'};"
    if block.distinct:
        yield "    long j;"
    if block.when is not None:
        yield f"    double inputs[{_inputs(block)}], used;"
    yield from ("", "    (void)data;", "    *count = 0;")
    opened, closed = cells.loop(block.table)
    yield from opened
    if block.when is not None:
        yield from (
            *cells.call(block.when, "&used", "        "),
            "        if (used != 1.0)",
            "            continue;",
        )
    if block.distinct:
        same = " && ".join(_same(cells, value) for value in block.distinct)
        yield from (
            "        for (j = 0; j < *count; j++)",
            f"            if ({same})",
            "                break;",
            "        if (j < *count)",
            "            continue;",
        )
    yield from (
        "        f->chosen[(*count)++] = row;",
        *closed,
        "    return 0;",
        "}",
        "",
    )


def _same(cells: Cells, value: ColumnValue) -> str:
    here, there = cells.cell(value), cells.cell(value, "f->chosen[j]")
    return f"strcmp({here}, {there}) == 0" if cells.is_text(value) else f"{here} == {there}"


def _case(blueprint: Blueprint, cells: Cells, block: BlockShape, case: BlockCase, number: int) -> Iterator[str]:
    yield from (
        f"/* Parameters, weights and unknowns of the rows of {case.identifier}: kernel {number}. */",
        f"static int {case.identifier}_assemble(struct frame *f, long count)",
        "{",
        f"    const {blueprint.identifier}_data *data = f->data;",
    )
    if case.noise is not None:
        yield f"    double inputs[{max(len(case.noise.inputs), 1)}], noise[{len(case.noise.program.outputs)}];"
    yield from (
        f"    struct data_block *own = &blocks_of_data_set(f->data_set)[{number}];",
        "    long i, rows = 0;",
        "",
        "    (void)data;",
    )
    if case.noise is not None and not case.noise.inputs:
        yield "    inputs[0] = 0.0;"
    yield from (
        *(f"    own->{used} = f->{used}_used;" for used in ("parameters", "weights", "index", "columns")),
        "    for (i = 0; i < count; i++) {",
    )
    if block.table is not None:
        yield from (
            "        const long row = f->chosen[i];",
            *(() if cells.reads(case) or varies(blueprint, case) else ("        (void)row;",)),
        )
    yield from (
        *(f"        {line}" for line in _row(blueprint, cells, case)),
        "    }",
        "    own->rows = rows;",
        "    return (int)rows;",
        "}",
        "",
    )


def _row(blueprint: Blueprint, cells: Cells, case: BlockCase) -> Iterator[str]:
    if case.static:
        tests = " && ".join(cells.equals(value, key) for value, key in case.static)
        yield from (f"if (!({tests}))", "    continue;")
    yield from (f"f->parameters[f->parameters_used++] = {cells.input(value)};" for value in case.parameters)
    if case.noise is not None:
        yield from weights(cells, case)
    lines = [
        *(_place(cells, blueprint, "index", "offsets", s) for s in case.variables),
        *(_place(cells, blueprint, "columns", "firsts", s) for s in case.tangents),
    ]
    if varies(blueprint, case):
        yield from lines
    else:
        yield from (
            "if (rows == 0) {    /* all rows share their unknowns */",
            *(f"    {line}" for line in lines),
            "}",
        )
    yield "rows++;"


def _place(cells: Cells, blueprint: Blueprint, array: str, origin: str, slot: SlotPlace) -> str:
    text = f"f->{array}[f->{array}_used++] = {cells.slot(slot, origin)};"
    return f"{text}    {remark(blueprint.unknowns[slot.unknown].name)}"


def weights(cells: Cells, case: BlockCase) -> Iterator[str]:
    """The noise of the row at hand as weights."""
    if case.noise is None:
        return
    yield from (*cells.arguments(case.noise, ""), f"{case.identifier}_noise(inputs, noise);")
    first = 0
    for equation in case.equations:
        size = equation.last - equation.first
        if equation.noise_kind is NoiseKind.SIGMA:
            for i in range(size):
                yield from (
                    f"if (!weight_of_sigma(noise[{first + i}], f->weights + f->weights_used + {i}))",
                    "    return -1;",
                )
            yield f"f->weights_used += {size};"
            first += size
            continue
        word = equation.noise_kind.value
        yield from (
            f"if (!weights_of_{word}(noise + {first}, {size}, f->scratch, f->weights + f->weights_used))",
            "    return -1;",
            f"f->weights_used += {size * size};",
        )
        first += size * size


def _assemble(blueprint: Blueprint, cells: Cells) -> Iterator[str]:
    yield from (
        "/* All clauses: the rows that they use, each in the case that its values ask for. */",
        "static int assemble(struct frame *f)",
        "{",
        "    long count;",
        "    int rows, all, status = 0;",
        "",
    )
    for block in blueprint.blocks:
        yield from count_of_rows(block)
        for case in block.cases:
            yield from (
                f"    rows = {case.identifier}_assemble(f, count);",
                "    if (rows < 0)",
                f"        return {cells.status('BAD_NOISE')};",
                "    all += rows;",
            )
        yield from ("    if (all != count)", f"        return {cells.status('UNKNOWN_CASE')};")
    yield from ("    return status;", "}", "")


def count_of_rows(block: BlockShape) -> Iterator[str]:
    """Statements that choose the rows of a clause and count them; no case has taken any yet."""
    yield f"    {remark(block.role.value, ' ', block.name)}"
    if block.table is None:
        yield "    count = 1;"
    else:
        yield from (
            f"    status = {block.identifier}_rows(f, &count);",
            "    if (status != 0)",
            "        return status;",
        )
    yield "    all = 0;"
