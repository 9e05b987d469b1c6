"""All files of a generated solver in C."""

from __future__ import annotations

from mbm.emit.c.build import cmake, makefile, readme
from mbm.emit.c.csv import CSV
from mbm.emit.c.header import header
from mbm.emit.c.main import main_file, test_file
from mbm.emit.c.reading import tables_file
from mbm.emit.c.source import kernels_file, solver_file, source_file
from mbm.emit.data_files import data_files
from mbm.emit.system import static_system
from mbm.emit.types import Blueprint, OutputFile


def c_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """Header, source, program, test, build files, README, data."""
    name = blueprint.identifier
    static = static_system(blueprint)
    source = source_file(blueprint, static)
    texts = {
        f"{name}.h": header(blueprint),
        f"{name}.c": source,
        f"{name}_kernels.h": kernels_file(blueprint),
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
