"""All files of a generated solver in C, those that build it and the README that says how to call it among them."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.csv import CSV
from mbm.emit.c.header import header
from mbm.emit.c.main import main_file, test_file
from mbm.emit.c.reading import tables_file
from mbm.emit.c.source import kernels_file, solver_file, source_file
from mbm.emit.data_files import data_files
from mbm.emit.markdown import code, prose
from mbm.emit.system import static_system
from mbm.emit.types import Blueprint, OutputFile
from mbm.emit.words import described

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
    yield f"# {prose(blueprint.name)}"
    yield ""
    yield from (prose(blueprint.doc), "") if blueprint.doc else ()
    yield f"A solver in C99, written by mbm {blueprint.version}. It needs a C compiler and `libm`, nothing else."
    yield ""
    yield "## Build"
    yield ""
    yield "```sh"
    yield f"make            # the program {name} and its test; or: cmake -B build && cmake --build build"
    yield "make test       # solves data/ and compares with reference.csv, the answer of `mbm solve`"
    yield f"./{name} {usage}".rstrip()
    yield "```"
    yield ""
    yield "The program prints `name,value,sigma,unit` lines, and to standard error how well the solution fits. It ends"
    yield "with 0: solved, 1: an answer that should not be trusted as it stands, 2: the data are wrong."
    yield ""


def _calling(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield "## Call"
    yield ""
    yield f"`{name}.c` with its two headers is the solver; `{name}.h` is what a caller includes. All numbers are in SI."
    yield "Nothing is allocated: the caller gives a workspace, and results point into it."
    yield ""
    yield "```c"
    yield f"{name}_data data = {{0}};           /* set the rows and columns of each table */"
    yield f"{name}_workspace workspace;"
    yield f"{name}_result result;"
    yield ""
    yield f"{name}_workspace_size(&data, &workspace);"
    yield "workspace.reals = malloc(sizeof(double) * workspace.reals_size);"
    yield "workspace.integers = malloc(sizeof(long) * workspace.integers_size);"
    yield f"if ({name}_solve(&data, &result, &workspace) == {name.upper()}_CONVERGED)"
    first = blueprint.unknowns[0].identifier
    yield f'    printf("%g +- %g\\n", result.{first}[0], result.{first}_sigma[0]);'
    yield "```"
    yield ""
    if blueprint.for_each:
        keys = ", ".join(map(code, blueprint.for_each))
        yield f"One call solves one data set: the rows that agree in {keys}. The program goes through all of them."
        yield ""
