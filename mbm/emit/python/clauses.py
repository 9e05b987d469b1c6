"""Python functions that turn the rows of a clause into the arrays of the solver."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.foreign import told
from mbm.emit.python.cells import Cells
from mbm.emit.python.cells import key as written
from mbm.emit.python.text import docstring, literal
from mbm.emit.system import varies
from mbm.emit.types import BlockCase, BlockShape, Blueprint, SlotPlace
from mbm.problem.types import NoiseKind


def clause_functions(blueprint: Blueprint) -> Iterator[str]:
    """The rows of each clause, and the arrays of each kernel, those of derived quantities too."""
    cells = Cells(blueprint)
    for derived in blueprint.derived:
        for case in derived.cases:
            yield "\n".join(_case(blueprint, cells, case))
    for block in blueprint.blocks:
        yield "\n".join(_rows(cells, block))
        for case in block.cases:
            yield "\n".join(_case(blueprint, cells, case))


def _rows(cells: Cells, block: BlockShape) -> Iterator[str]:
    yield f"def {block.identifier}_rows(t: Tables, f: Found) -> Indices:"
    yield from docstring([told("The rows that ", block.name, " is about.")])
    if block.table is None:
        yield "    return np.zeros(1, dtype=int)"
        return
    yield f"    row = kept_rows(t, f, {literal(block.table)})"
    if block.when is not None:
        yield f"    row = row[{block.when.identifier}(t, f, row)[0] == 1.0]"
    if block.distinct:
        values = ", ".join(f"{cells.cell(v)}.tolist()" for v in block.distinct)
        yield f"    kinds = list(zip({values}, strict=True))"
        yield "    row = row[[kinds.index(kind) for kind in dict.fromkeys(kinds)]]"
    yield "    return row"


def _case(blueprint: Blueprint, cells: Cells, case: BlockCase) -> Iterator[str]:
    yield f"def {case.identifier}_assemble("
    yield "    t: Tables, f: Found, row: Indices, offsets: Array, firsts: Array"
    yield ") -> tuple[int, tuple[Array, Array, Array, Array]]:"
    yield f'    """Number of rows of {case.identifier}; their parameters, weights, numbers and coordinates."""'
    for value, key in case.static:
        yield f"    row = row[{cells.cell(value)} == {written(key)}]"
    yield f"    parameters = np.empty((len(row), {len(case.parameters)}))"
    for position, parameter in enumerate(case.parameters):
        yield f"    parameters[:, {position}] = {cells.input(parameter)}"
    yield from _weights(cells, case)
    moving = varies(blueprint, case)
    rows = "len(row)" if moving else "min(len(row), 1)"
    for array, origin, slots in (("index", "offsets", case.variables), ("columns", "firsts", case.tangents)):
        yield f"    {array} = np.empty(({rows}, {len(slots)}), dtype=np.int64)"
        for position, slot in enumerate(slots):
            yield f"    {array}[:, {position}] = {_place(cells, blueprint, array, origin, slot)}"
    yield "    return len(row), (parameters, weights, index, columns)"


def _place(cells: Cells, blueprint: Blueprint, array: str, origin: str, slot: SlotPlace) -> str:
    unknown = blueprint.unknowns[slot.unknown]
    width = unknown.size if array == "index" else unknown.freedom
    member = "" if slot.member is None else f" + {cells.linked(slot.member, 'row')} * {width}"
    component = f" + {slot.component}" if slot.component else ""
    return f"{origin}[{slot.unknown}]{member}{component}"


def _weights(cells: Cells, case: BlockCase) -> Iterator[str]:
    if case.noise is None:
        yield "    weights = np.empty((len(row), 0))"
        return
    yield f"    noise = np.empty(({len(case.noise.program.outputs)}, len(row)))"
    inputs = ", ".join(cells.input(v) for v in case.noise.inputs)
    yield f"    {case.identifier}_noise([{inputs}], noise)"
    parts, first = [], 0
    for equation in case.equations:
        size = equation.last - equation.first
        if equation.noise_kind is NoiseKind.SIGMA:
            parts.append(f"sigma_weights(noise[{first}:{first + size}].T)")
            first += size
        else:
            kind = equation.noise_kind.value
            parts.append(f"matrix_weights({kind!r}, noise[{first}:{first + size * size}].T, {size})")
            first += size * size
    yield f"    weights = np.hstack([{', '.join(parts)}])"
