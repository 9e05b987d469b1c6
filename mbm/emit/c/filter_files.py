"""All files of a generated filter in C: header, source, a program, a test, what builds them, and the README."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import isnan

import numpy as np

from mbm.emit.answers import Floats
from mbm.emit.c.csv import CSV
from mbm.emit.c.files import cmake, kernels_file, makefile, solver_file
from mbm.emit.c.filter_header import filter_header
from mbm.emit.c.filter_main import main_file, test_file
from mbm.emit.c.filter_memory import DerivedRoom, derived_rooms, places
from mbm.emit.c.filter_source import filter_source
from mbm.emit.c.filter_tables import tables_file
from mbm.emit.data_files import table_text
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.markdown import code, prose
from mbm.emit.types import BlockCase, OutputFile
from mbm.emit.words import described_blocks, described_derived

WHAT = "Filters and smoothers: square-root covariances, updates as least squares, cuts by constraints."


def filter_files(made: FilterBlueprint) -> tuple[OutputFile, ...]:
    """The files, in the order of their paths."""
    blueprint = made.blueprint
    name = blueprint.identifier
    source = filter_source(made)
    texts = {
        f"{name}.h": filter_header(made),
        f"{name}.c": source,
        f"{name}_kernels.h": kernels_file(blueprint, _kernels(made)),
        f"{name}_solver.h": solver_file(blueprint, source, WHAT, _fixed(made)),
        f"{name}_tables.h": tables_file(made),
        "csv.h": CSV,
        "main.c": main_file(made),
        "test.c": test_file(made),
        "Makefile": makefile(blueprint).replace("-O2", "-O3"),  # sizes are constants: loops unroll
        "CMakeLists.txt": cmake(blueprint),
        "README.md": _readme(made),
        "reference.csv": _references(made),
    }
    given = {table.name: table for table in blueprint.given}
    for table in made.files.tables:
        texts[f"data/{table.identifier}.csv"] = table_text(table, given[table.name])
    files = (OutputFile(path=path, content=text.encode()) for path, text in texts.items())
    return tuple(sorted(files, key=lambda file: file.path))


def _fixed(made: FilterBlueprint) -> dict[str, int]:
    """The sizes of the sequence, which compilers may know: all but what a step decides."""
    return {f"chain.{name}": value for name, value in made.plan.chain.items() if name != "begin"}


def _kernels(made: FilterBlueprint) -> list[BlockCase]:
    """The kernels in their order, with the programs of noise that are called."""
    groups = (*made.plan.seen.groups, *made.plan.moving.groups)
    cases = (*made.seen, *made.moving)
    first = len(made.seen)
    return [
        replace(case, noise=None) if group.fixed is not None or (k >= first and not group.noise[1]) else case
        for k, (case, group) in enumerate(zip(cases, groups, strict=True))
    ]


def _references(made: FilterBlueprint) -> str:
    """One line for each step: where it is, its numbers, its covariance row by row, v' S^-1 v, what is derived; nothing
    for NaN.
    """
    known = made.plan.references
    size = known.covariances.shape[1] ** 2
    heads = [
        "at",
        *(f"number {k + 1}" for k in range(known.numbers.shape[1])),
        *(f"covariance {k + 1}" for k in range(size)),
        "innovation",
    ]
    columns = [known.keys[:, None], known.numbers, known.covariances.reshape(len(known.keys), -1), known.costs[:, None]]
    for room in derived_rooms(made):
        laid = [_laid_out(room, *step[room.number]) for step in known.derived]
        heads += [f"derived {room.number + 1} number {k}" for k in range(len(laid[0]))]
        columns.append(np.array(laid))
    lines = [",".join(heads)]
    rows = np.hstack(columns).tolist()
    lines += [",".join("" if isnan(value) else repr(value) for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def _laid_out(room: DerivedRoom, values: Floats, covariances: Floats) -> Floats:
    """How many rows there are, and their values and covariances with nothing behind them."""
    lacking = room.rows - len(values)
    padded = [
        np.pad(a, [(0, lacking), *[(0, 0)] * (a.ndim - 1)], constant_values=np.nan) for a in (values, covariances)
    ]
    return np.concatenate([[len(values)], *(a.ravel() for a in padded)])


def _readme(made: FilterBlueprint) -> str:
    return (
        "\n".join(
            [*_building(made), *_calling(made), *described_blocks(made.blueprint), *described_derived(made.blueprint)]
        )
        + "\n"
    )


def _building(made: FilterBlueprint) -> Iterator[str]:
    blueprint = made.blueprint
    name = blueprint.identifier
    usage = " ".join(f"{t.identifier}.csv" for t in made.files.tables)
    yield from (
        f"# {prose(blueprint.name)}",
        "",
        *((prose(blueprint.doc), "") if blueprint.doc else ()),
        f"A filter (`{made.plan.method}`) in C99, written by mbm {blueprint.version}, for computers without memory to",
        "allocate and without files. It needs a C compiler and `libm`, nothing else.",
        "",
        "## Build",
        "",
        "```sh",
        f"make            # the program {name} and its test; or: cmake -B build && cmake --build build",
        "make test       # filters data/ and compares with reference.csv, the answers of `mbm solve`",
        f"./{name} {usage}".rstrip(),
        "```",
        "",
        "The program prints a line for each step: where it is, `innovation`, and estimates with standard deviations.",
        "",
    )


def _calling(made: FilterBlueprint) -> Iterator[str]:
    name, plan = made.blueprint.identifier, made.plan
    reals, integers = (sum(sizes.values()) for sizes in places(made))
    first = made.blueprint.unknowns[0].identifier
    tables = [table for table in made.blueprint.tables if table.name in made.given]
    beside = [table for table in made.blueprint.tables if table.name in made.beside]
    yield from (
        "## Call",
        "",
        f"`{name}.c` with `{name}.h`, `{name}_kernels.h` and `{name}_solver.h` is the filter. All numbers are in SI.",
        f"A filter takes {reals} `double` and {integers} `long`: {8 * (reals + integers)} bytes where both have 8. A",
        "call takes some kB of the stack; descriptions of the equations are constant. Nothing is allocated, read or",
        "printed.",
        "",
        "```c",
        f"static {name}_filter filter;",
        *(f"{name}_given given = {{0}};    /* set the rows and columns of its tables; they stay */",) * bool(beside),
        f"{name}_rows rows = {{0}};",
        f"{name}_result result;",
        "",
        f"{name}_begin(&filter{', &given' if beside else ''});",
        "for (;;) {",
        "    rows.at = ...;    /* where the step is */",
        *(f"    rows.{t.identifier}_rows = ...;    /* 0: the step has none; and its columns */" for t in tables),
        f"    if ({name}_step(&filter, &rows, &result) == {name.upper()}_ESTIMATED)",
        f"        use(result.{first}[0], result.{first}_sigma[0]);",
        "}",
        "```",
        "",
    )
    for table in (*tables, *beside):
        columns = ", ".join(code(c.source) + (f" ({prose(c.unit)})" if c.unit else "") for c in table.columns)
        most = f"{name.upper()}_MOST_{table.identifier.upper()}"
        when = " at a step" if table in tables else ", given at first"
        yield f"* table {code(table.name)}: {columns}; at most {plan.rows[table.name]} rows{when} (`{most}`)"
    yield ""
    if made.files.for_each or made.window is not None:
        yield from (
            "Each key and window of the data is a sequence of its own, with a filter that begins anew. The program",
            "goes through those of its files.",
            "",
        )
    yield from (
        "`innovation` is v'S^-1 v of the innovations v with their covariance S: of a consistent filter chi-square",
        "distributed with `residuals` degrees of freedom, so that steps much above that doubt it.",
    )
    if plan.smooth:
        yield f"`{name}_step` answers the step {plan.chain['lag']} before; `{name}_finish` those left at the end."
    yield ""
