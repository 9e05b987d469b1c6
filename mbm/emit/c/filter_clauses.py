"""C functions of a generated filter that put the rows of one kernel into the solver's arrays."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.clauses import weights
from mbm.emit.c.text import remark
from mbm.emit.filtering.types import FilterBlueprint, FilterGroup
from mbm.emit.types import BlockCase, BlockShape, SlotPlace
from mbm.problem.types import NoiseKind

ARRAYS = ("parameters", "weights", "index", "columns")
"""The four arrays of rows, as blocks of data sets call them."""


def _varies(case: BlockCase) -> bool:
    """Whether some member is named by the row at hand, or by a key."""
    return any(slot.member is not None for slot in (*case.variables, *case.tangents))


def _weighs(cells: Cells, case: BlockCase, moves: bool) -> bool:
    """Whether the weights of rows differ."""
    return not moves and case.noise is not None and any(map(cells.moves, case.noise.inputs))


def _places(made: FilterBlueprint, case: BlockCase, moves: bool) -> Iterator[str]:
    """Statements that put the places of a row."""
    yield from (_place(made, slot, "index", moves) for slot in case.variables)
    yield from (_place(made, slot, "columns", moves) for slot in case.tangents)


def _place(made: FilterBlueprint, slot: SlotPlace, array: str, moves: bool) -> str:
    member = "" if slot.member is None else Cells(made.blueprint).member(slot.member)
    value = placed(made, slot, member, index=array == "index", moves=moves)
    return f"f->{array}[f->{array}_used++] = {value};    {remark(slot.shown)}"


def placed(made: FilterBlueprint, slot: SlotPlace, member: str, *, index: bool, moves: bool) -> str:
    """Where a number (``index``) of a step or of a transition stands, or the column of a coordinate."""
    unknown = made.blueprint.unknowns[slot.unknown]
    part = made.plan.parts[unknown.name]
    first = (part.number if index else part.coordinate) + slot.component
    first += made.plan.ahead[0 if index else 1] if slot.ahead else 0
    column = made.plan.pair_column if moves else made.plan.column
    if slot.member is None:
        return str(first if index else column[first])
    value = f"{first} + {member} * {unknown.size if index else unknown.freedom}"
    return value if index else f"{'PAIR_COLUMN' if moves else 'COLUMN'}[{value}]"


def begin_function(
    made: FilterBlueprint, cells: Cells, case: BlockCase, group: FilterGroup, moves: bool
) -> Iterator[str]:
    """What no row changes of the rows of a kernel: places, and weights where they are the same for all."""
    rows = group.capacity * made.plan.chain["held"]
    lines = [] if _varies(case) else list(_places(made, case, moves))
    if moves:
        lines += ["f->weights[f->weights_used++] = 1.0;"] * case.kernel.outputs
    elif case.noise is not None and not _weighs(cells, case, moves):
        lines += weights(cells, case)
    yield from (
        f"/* What is the same in all rows of {case.identifier}. */",
        f"static int {case.identifier}_begin(struct frame *f)",
        "{",
    )
    if not lines:
        yield from ("    (void)f;", "    return 0;", "}", "")
        return
    if any("noise" in line for line in lines) and case.noise is not None:
        outputs = len(case.noise.program.outputs)
        yield f"    double inputs[{max(len(case.noise.inputs), 1)}], noise[{outputs}];"
    yield from (
        f"    const {made.blueprint.identifier}_data *data = f->data;",
        "    long i;",
        "",
        "    (void)data;",
    )
    if any("noise" in line for line in lines):
        yield "    inputs[0] = 0.0;"
    yield from (
        f"    for (i = 0; i < {rows}; i++) {{",
        *(f"        {line}" for line in lines),
        "    }",
        "    return 0;",
        "}",
        "",
    )


def take_function(
    made: FilterBlueprint,
    cells: Cells,
    block: BlockShape,
    case: BlockCase,
    number: int,
    group: FilterGroup,
    moves: bool,
) -> Iterator[str]:
    """What puts the rows of a kernel, and the noise of a transition."""
    name = made.blueprint.identifier
    noisy = case.noise is not None and (moves or _weighs(cells, case, moves))
    reads = block.table is not None
    yield from (
        f"/* The rows of {case.identifier}; how many there are, -1: their noise is none. */",
        f"static long {case.identifier}_take(struct frame *f, struct data_set *set, long count)",
        "{",
        f"    const {name}_data *data = f->data;",
        f"    struct data_block *own = &blocks_of_data_set(set)[{number}];",
    )
    if noisy and case.noise is not None:
        outputs = max(len(case.noise.program.outputs), 1)
        yield f"    double inputs[{max(len(case.noise.inputs), 1)}], noise[{outputs}];"
    yield from ("    long i, rows = 0;", "", "    (void)data;")
    if noisy and case.noise is not None and not case.noise.inputs:
        yield "    inputs[0] = 0.0;"
    yield from (
        *(f"    f->{used}_used = own->{used};" for used in ARRAYS),
        "    for (i = 0; i < count; i++) {",
    )
    if reads:
        yield from ("        const long row = f->chosen[i];", "        (void)row;")
    if case.static:
        tests = " && ".join(cells.equals(value, key) for value, key in case.static)
        yield from (f"        if (!({tests}))", "            continue;")
    yield from (f"        f->parameters[f->parameters_used++] = {cells.input(value)};" for value in case.parameters)
    if _varies(case):
        yield from (f"        {line}" for line in _places(made, case, moves))
    if moves:
        yield from (f"        {line}" for line in _noise(made, cells, case, group))
    elif noisy:
        yield from (f"        {line}" for line in weights(cells, case))
    yield from (
        "        rows++;",
        "    }",
        "    own->rows = rows;",
        "    return rows;",
        "}",
        "",
    )


def _noise(made: FilterBlueprint, cells: Cells, case: BlockCase, group: FilterGroup) -> Iterator[str]:
    """L of the transition, in the lines of this row and the columns of the group."""
    stride = made.plan.chain["noises"]
    if case.noise is not None and group.noise[1] > 0:
        yield from (*cells.arguments(case.noise, ""), f"{case.identifier}_noise(inputs, noise);")
        first = 0
        column = group.noise[0]
        for equation in case.equations:
            size = equation.last - equation.first
            target = f"f->spread + (f->moves_count + {equation.first}) * {stride} + {column}"
            if equation.noise_kind is NoiseKind.SIGMA:
                for i in range(size):
                    yield from (
                        f"if (!root_of_sigma(noise[{first + i}], {target} + {i * stride + i}))",
                        "    return -1;",
                    )
                first, column = first + size, column + size
                continue
            width = group.noise[1] * size // case.kernel.outputs
            if equation.noise_kind is NoiseKind.COVARIANCE:
                call = f"root_of_covariance(noise + {first}, {size}, {width}, {stride}, {target})"
            else:
                call = f"root_of_information(noise + {first}, {size}, {stride}, f->scratch, {target})"
            yield from (f"if (!{call})", "    return -1;")
            first, column = first + size * size, column + width
    yield f"f->moves_count += {case.kernel.outputs};"
