"""All files of a generated solver in C, those that build it and the README that says how to call it among them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from mbm.emit.c.agreement import agreement_constants, range_constants
from mbm.emit.c.cells import input_name, program_name
from mbm.emit.c.clauses import clause_functions
from mbm.emit.c.csv import CSV
from mbm.emit.c.derived import call_kernel, derived_functions, derived_kernels, function, helpers, kernel_functions
from mbm.emit.c.frame import frame_text
from mbm.emit.c.header import header
from mbm.emit.c.main import main_file, test_file
from mbm.emit.c.reading import tables_file
from mbm.emit.c.solve import solve_functions
from mbm.emit.c.tables import programs_used, table_functions
from mbm.emit.c.text import comment, doubles, longs, opening, remark
from mbm.emit.c.unknowns import unknown_functions
from mbm.emit.data_files import data_files
from mbm.emit.foreign import told
from mbm.emit.markdown import code, prose
from mbm.emit.routines.modules import called_in_c, emitted_module
from mbm.emit.system import StaticSystem, static_system
from mbm.emit.types import BlockCase, Blueprint, OutputFile
from mbm.emit.words import described
from mbm.machine.c import number, prelude, text as module_text

CHUNK = 32
"""Residuals that are triangularised at a time, at least: the matrices stay in the cache, the loop's share is small."""
MAKEFILE = """# Builds the solver {name}: `make` the program and its test, `make test` the comparison with
# the reference numbers.

CC ?= cc
CFLAGS ?= -O2
WARNINGS = -std=c99 -pedantic -Wall -Wextra -Werror
HEADERS = {name}.h {name}_kernels.h {name}_solver.h {name}_tables.h csv.h

all: {name} {name}_test

{name}: main.o {name}.o
\t$(CC) $(CFLAGS) $(LDFLAGS) -o $@ main.o {name}.o -lm

{name}_test: test.o {name}.o
\t$(CC) $(CFLAGS) $(LDFLAGS) -o $@ test.o {name}.o -lm

%.o: %.c $(HEADERS)
\t$(CC) $(CFLAGS) $(WARNINGS) -c -o $@ $<

test: {name}_test
\t./{name}_test

clean:
\trm -f main.o test.o {name}.o {name} {name}_test

.PHONY: all test clean
"""
CMAKE = """cmake_minimum_required(VERSION 3.10)
project({name} C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)

add_library({name}_solver STATIC {name}.c)
target_include_directories({name}_solver PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
target_link_libraries({name}_solver PUBLIC -lm)

add_executable({name} main.c)
target_link_libraries({name} {name}_solver)

enable_testing()
add_executable({name}_test test.c)
target_link_libraries({name}_test {name}_solver)
add_test(NAME reference COMMAND {name}_test WORKING_DIRECTORY ${{CMAKE_CURRENT_SOURCE_DIR}})
"""


def c_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """Header, source, program, test, build files, README, data."""
    name = blueprint.identifier
    static = static_system(blueprint, CHUNK)
    source = source_file(blueprint, static)
    texts = {
        f"{name}.h": header(blueprint),
        f"{name}.c": source,
        f"{name}_kernels.h": kernels_file(blueprint, [case for _, case in blueprint.cases]),
        f"{name}_solver.h": solver_file(blueprint, source),
        f"{name}_tables.h": tables_file(blueprint),
        "csv.h": CSV,
        "main.c": main_file(blueprint),
        "test.c": test_file(blueprint),
        "Makefile": makefile(blueprint),
        "CMakeLists.txt": cmake(blueprint),
        "README.md": readme(blueprint),
    }
    files = tuple(OutputFile(path=path, content=text.encode()) for path, text in texts.items())
    return (*files, *data_files(blueprint))


def makefile(blueprint: Blueprint) -> str:
    """``Makefile``."""
    return MAKEFILE.format(name=blueprint.identifier)


def cmake(blueprint: Blueprint) -> str:
    """``CMakeLists.txt``."""
    return CMAKE.format(name=blueprint.identifier)


def readme(blueprint: Blueprint) -> str:
    """``README.md``."""
    return "\n".join([*_building(blueprint), *_calling(blueprint), *described(blueprint)]) + "\n"


def _building(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    usage = " ".join(f"{t.identifier}.csv" for t in blueprint.tables)
    yield from (
        f"# {prose(blueprint.name)}",
        "",
        *((prose(blueprint.doc), "") if blueprint.doc else ()),
        f"A solver in C99, written by mbm {blueprint.version}. It needs a C compiler and `libm`, nothing else.",
        "",
        "## Build",
        "",
        "```sh",
        f"make            # the program {name} and its test; or: cmake -B build && cmake --build build",
        "make test       # solves data/ and compares with reference.csv, the answer of `mbm solve`",
        f"./{name} {usage}".rstrip(),
        "```",
        "",
        "The program prints `name,value,sigma,unit` lines, and to standard error how well the solution fits. It ends",
        "with 0: solved, 1: an answer that should not be trusted as it stands, 2: the data are wrong.",
        "",
    )


def _calling(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        "## Call",
        "",
        f"`{name}.c` with its two headers is the solver; `{name}.h` is what a caller includes. All numbers are in SI.",
        "Nothing is allocated: the caller gives a workspace, and results point into it.",
        "",
        "```c",
        f"{name}_data data = {{0}};           /* set the rows and columns of each table */",
        f"{name}_workspace workspace;",
        f"{name}_result result;",
        "",
        f"{name}_workspace_size(&data, &workspace);",
        "workspace.reals = malloc(sizeof(double) * workspace.reals_size);",
        "workspace.integers = malloc(sizeof(long) * workspace.integers_size);",
        f"if ({name}_solve(&data, &result, &workspace) == {name.upper()}_CONVERGED)",
    )
    first = blueprint.unknowns[0].identifier
    yield from (
        f'    printf("%g +- %g\\n", result.{first}[0], result.{first}_sigma[0]);',
        "```",
        "",
    )
    if blueprint.for_each:
        keys = ", ".join(map(code, blueprint.for_each))
        yield from (
            f"One call solves one data set: the rows that agree in {keys}. The program goes through all of them.",
            "",
        )


LONG_CHECK = """#include <limits.h>
#if LONG_MAX < 0x1000000000000
#error "consensus draws its subsets with numbers of 48 bits: `long` is too short here"
#endif
"""


def kernels_file(blueprint: Blueprint, cases: Sequence[BlockCase]) -> str:
    """The equations, and the programs of data, as functions; kernel k is that of case k."""
    parts = [kernel_functions(case) for case in cases]
    parts += derived_kernels(blueprint)
    for case in cases:
        if case.noise is not None:
            names = [input_name(v) for v in case.noise.inputs]
            parts.append(
                function(f"{case.identifier}_noise", case.noise.program, names, [f"{case.identifier}: stated noise."])
            )
    for programs, words in programs_used(blueprint):
        for position, each in enumerate(programs.cases):
            names = [input_name(v) for v in each.inputs]
            parts.append(function(program_name(programs, position), each.program, names, [told(words, ".")]))
    body = "\n".join(parts)
    doc = [told(blueprint.name, ": its equations. Everything is in SI, angles in radians.")]
    constants = _constants(blueprint)
    return "\n".join([comment(doc), "", "#include <math.h>", "", helpers(body), body, call_kernel(cases), constants])


def _constants(blueprint: Blueprint) -> str:
    lines = [
        f"static const double constant_{c.identifier} = {number(c.value)};    {remark(c.name)}"
        for c in blueprint.constants
    ]
    return "\n".join(["/* Constants of the problem. */", *lines, ""]) if lines else ""


LEAST_SQUARES = "Least squares with Marquardt's method in a trust region: losses, bounds, constraints, covariance."


def solver_file(
    blueprint: Blueprint, source: str, what: str = LEAST_SQUARES, fixed: Mapping[str, int] = MappingProxyType({})
) -> str:
    """The solver, ``what`` in words: the same for all problems, as far as the text of this one calls it.

    ``fixed`` are fields of records that always have these values, ``record.field``.
    """
    doc = [what, "The same algorithm as mbm's own native solver; arrays are described where the solver is called."]
    text = module_text(emitted_module(called_in_c(source), fixed))
    checked = [LONG_CHECK] if blueprint.agreement is not None or blueprint.ranges is not None else []
    return "\n".join([comment(doc), "", prelude(text), *checked, text])


def source_file(blueprint: Blueprint, static: StaticSystem) -> str:
    """Data → arrays of the solver → answer."""
    name = blueprint.identifier
    parts = [
        *opening(name, told(blueprint.name, ": from tables to the arrays of the solver, and back.")),
        longs("SYSTEM", static.prefix, "How the solver's description of the equations begins: what no data change."),
        longs("UNKNOWNS", static.unknowns, "Of each unknown: numbers, coordinates, family, positive, pieces."),
        doubles("LOSSES", static.losses, "Parameter and shape of each loss."),
        *(() if blueprint.agreement is None else (agreement_constants(blueprint.agreement),)),
        *(() if blueprint.ranges is None else (range_constants(blueprint.ranges),)),
        f"static const double TOLERANCE = {number(blueprint.settings.tolerance)};"
        "    /* of the next step, in standard deviations */",
        "",
        frame_text(blueprint, static),
        table_functions(blueprint),
        unknown_functions(blueprint),
        clause_functions(blueprint),
        derived_functions(blueprint, static),
        solve_functions(blueprint, static),
        "",
    ]
    return "\n".join(parts)
