"""Python functions that find rows, turn those of a clause into the arrays of the solver, and set unknowns up."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.frame import ends
from mbm.emit.foreign import told
from mbm.emit.python.kernels import Cells, key as written
from mbm.emit.python.text import docstring, literal
from mbm.emit.system import varies
from mbm.emit.types import BlockCase, BlockShape, Blueprint, Choice, SlotPlace, UnknownShape
from mbm.problem.types import NoiseKind, UnknownKind


def finding(blueprint: Blueprint) -> str:
    """``find_rows`` and ``kept_rows``."""
    cells = Cells(blueprint)
    lines = [
        "def kept_rows(t: Tables, f: Found, table: str) -> Indices:",
        '    """The rows of a table that count."""',
        '    kept = f.get("kept " + table)',
        "    return np.arange(row_count(t, table)) if kept is None else kept",
        "",
        "",
        "def find_rows(t: Tables) -> Found:",
        '    """Rows that are kept, the members of families, and what keys name."""',
        "    f: Found = {}",
    ]
    for table in blueprint.tables:
        if table.where is not None:
            lines += [
                f"    row = np.arange(row_count(t, {literal(table.name)}))",
                f"    f[{literal('kept ', table.name)}] = row[{table.where.identifier}(t, f, row)[0] == 1.0]",
            ]
    for name, choice in ends(blueprint):
        place = 0 if choice is Choice.FIRST else -1
        lines += [
            f"    if not len(kept_rows(t, f, {literal(name)})):",
            f"        raise DataError({literal('the table `', name, '` has no rows')})",
            f"    f[{literal(choice.value, ' of ', name)}] = kept_rows(t, f, {literal(name)})[{place}]",
        ]
    for family in blueprint.families:
        lines.append(f"    row = kept_rows(t, f, {literal(family.table)})")
        if family.distinct and family.key is not None:
            lines += [
                f"    known = t[{literal(family.table)}][{literal(family.key)}][row].tolist()",
                "    row = row[[known.index(value) for value in dict.fromkeys(known)]]",
            ]
        lines.append(f"    f[{family.identifier!r}] = row")
    for link in blueprint.links:
        if link.family is not None:
            members = f"f[{blueprint.families[link.family].identifier!r}]"
            what = "member of "
        else:
            members, what = f"np.arange(row_count(t, {literal(link.target)}))", "row of "
        known = f"{members} + 1.0"
        if link.key is not None:
            known = f"t[{literal(link.target)}][{literal(link.key)}][{members}]"
        found = f"places({cells.key(link.cell)}, {known}, {literal(what, link.target)})"
        if link.table is None:
            lines.append(f"    f[{link.identifier!r}] = {found}")
            continue
        rows = (
            f"kept_rows(t, f, {literal(link.table)})"
            if link.family is not None
            else f"np.arange(row_count(t, {literal(link.table)}))"
        )
        lines += [
            f"    row = {rows}",
            f"    f[{link.identifier!r}] = np.full(row_count(t, {literal(link.table)}), -1)",
            f"    f[{link.identifier!r}][row] = {found}",
        ]
    return "\n".join([*lines, "    return f"])


def set_up(blueprint: Blueprint) -> Iterator[str]:
    """One function for each unknown: numbers (members, size), bounds and what stays (members, coordinates)."""
    for unknown in blueprint.unknowns:
        lines = [
            f"def set_up_{unknown.identifier}(t: Tables, f: Found, members: int) -> tuple[Array, Array, Array, Array]:"
        ]
        doc = (": ", unknown.doc) if unknown.doc else ()
        lines += docstring([told("Start, bounds and what stays of ", unknown.name, *doc, ".")])
        rows = "np.zeros(1, dtype=int)"
        if unknown.family is not None:
            rows = f"f[{blueprint.families[unknown.family].identifier!r}]"
        lines.append(f"    row = {rows}")
        lines += _bounds(unknown)
        lines += _start(unknown)
        yield "\n".join([*lines, "    return numbers, lower, upper, fixed"])


def _bounds(unknown: UnknownShape) -> Iterator[str]:
    for word, far, programs in (("lower", "-np.inf", unknown.lower), ("upper", "np.inf", unknown.upper)):
        yield f"    {word} = np.full((members, {unknown.freedom}), {far})"
        if programs is not None:
            yield f"    {word}[:, {list(unknown.bounded)}] = {programs.identifier}(t, f, row).T"
    if unknown.fixed is None:
        yield f"    fixed = np.zeros((members, {unknown.freedom}), dtype=int)"
    else:
        yield f"    fixed = ({unknown.fixed.identifier}(t, f, row).T == 1.0).astype(int)"


def _start(unknown: UnknownShape) -> Iterator[str]:
    size = unknown.size
    if unknown.falls_back:
        fallback = [float(v) for v in unknown.fallback] or [float("nan")] * size
        yield f"    numbers = np.tile(np.array({fallback!r}), (members, 1))".replace("nan", "np.nan")
        return
    if unknown.start is None:
        yield f"    stated = np.full((members, {size}), np.nan)"
    else:
        yield f"    stated = {unknown.start.identifier}(t, f, row).T"
    if unknown.dimension:
        yield from _turned(unknown)
        return
    yield f"    least, greatest = np.full((members, {size}), -np.inf), np.full((members, {size}), np.inf)"
    if unknown.start_range is not None:
        yield from (
            f"    {word}[:, {list(unknown.bounded)}] = {programs.identifier}(t, f, row).T"
            for word, programs in zip(("least", "greatest"), unknown.start_range, strict=True)
        )
    yield "    ends = zip(*(each.ravel().tolist() for each in (stated, least, greatest, lower, upper)), strict=True)"
    if unknown.angles:
        yield "    found = [within_turn(begun(*each), each[3], each[4]) for each in ends]"
    else:
        yield "    found = [begun(*each) for each in ends]"
    yield f"    numbers = np.array(found).reshape(members, {size})"
    if unknown.positive:
        yield from (
            "    if not bool(np.all(numbers > 0.0)):",
            f"        raise DataError({literal(unknown.name, ' does not begin above zero')})",
        )


def _turned(unknown: UnknownShape) -> Iterator[str]:
    """Directions, rotations, poses and similarities: stated as a vector, or as a matrix and what follows it."""
    yield from (f"    numbers = np.empty((members, {unknown.size}))", "    for m in range(members):")
    if unknown.kind is UnknownKind.DIRECTION:
        yield "        unit_vector(stated[m], numbers[m])"
        return
    held = 4 if unknown.dimension == 3 else 1
    if unknown.dimension == 3:
        yield "        quaternion_of_matrix(stated[m], numbers[m])"
    else:
        yield "        numbers[m, 0] = angle_of_matrix(stated[m])"
    yield f"        numbers[m, {held}:] = stated[m, {unknown.dimension**2}:]"


def clause_functions(blueprint: Blueprint) -> Iterator[str]:
    """The rows of each clause, and the arrays of each kernel, those of derived quantities too."""
    cells = Cells(blueprint)
    for derived in blueprint.derived:
        yield from ("\n".join(_case(blueprint, cells, case)) for case in derived.cases)
    for block in blueprint.blocks:
        yield "\n".join(_rows(cells, block))
        yield from ("\n".join(_case(blueprint, cells, case)) for case in block.cases)


def _rows(cells: Cells, block: BlockShape) -> Iterator[str]:
    yield from (
        f"def {block.identifier}_rows(t: Tables, f: Found) -> Indices:",
        *docstring([told("The rows that ", block.name, " is about.")]),
    )
    if block.table is None:
        yield "    return np.zeros(1, dtype=int)"
        return
    yield f"    row = kept_rows(t, f, {literal(block.table)})"
    if block.when is not None:
        yield f"    row = row[{block.when.identifier}(t, f, row)[0] == 1.0]"
    if block.distinct:
        values = ", ".join(f"{cells.cell(v)}.tolist()" for v in block.distinct)
        yield from (
            f"    kinds = list(zip({values}, strict=True))",
            "    row = row[[kinds.index(kind) for kind in dict.fromkeys(kinds)]]",
        )
    yield "    return row"


def _case(blueprint: Blueprint, cells: Cells, case: BlockCase) -> Iterator[str]:
    yield from (
        f"def {case.identifier}_assemble(",
        "    t: Tables, f: Found, row: Indices, offsets: Array, firsts: Array",
        ") -> tuple[int, tuple[Array, Array, Array, Array]]:",
        f'    """Number of rows of {case.identifier}; their parameters, weights, numbers and coordinates."""',
    )
    yield from (f"    row = row[{cells.cell(value)} == {written(key)}]" for value, key in case.static)
    yield f"    parameters = np.empty((len(row), {len(case.parameters)}))"
    yield from (
        f"    parameters[:, {position}] = {cells.input(parameter)}"
        for position, parameter in enumerate(case.parameters)
    )
    yield from _weights(cells, case)
    moving = varies(blueprint, case)
    rows = "len(row)" if moving else "min(len(row), 1)"
    for array, origin, slots in (("index", "offsets", case.variables), ("columns", "firsts", case.tangents)):
        yield from (
            f"    {array} = np.empty(({rows}, {len(slots)}), dtype=np.int64)",
            *(
                f"    {array}[:, {position}] = {_place(cells, blueprint, array, origin, slot)}"
                for position, slot in enumerate(slots)
            ),
        )
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
