"""All files of a generated solver in Python."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from mbm.emit.data_files import data_files
from mbm.emit.identifiers import Identifiers
from mbm.emit.markdown import fenced, prose
from mbm.emit.python.module import module
from mbm.emit.python.testing import TEST
from mbm.emit.python.text import literal
from mbm.emit.system import static_system
from mbm.emit.types import Blueprint, OutputFile
from mbm.emit.words import described

RESERVED_MODULES = frozenset({"numpy", "pytest"})
"""What the module must not be mistaken for, besides those of the standard library."""


def python_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """The module, its test, README, data."""
    name = module_name(blueprint)
    files = [f"{table.identifier}.csv" for table in blueprint.tables]
    texts = {
        f"{name}.py": module(blueprint, static_system(blueprint)),
        f"test_{name}.py": TEST.format(name=name, files=files),
        "README.md": "\n".join([*_readme(blueprint), *described(blueprint)]) + "\n",
    }
    made = tuple(OutputFile(path=path, content=text.encode()) for path, text in texts.items())
    return (*made, *data_files(blueprint))


def module_name(blueprint: Blueprint) -> str:
    """What the module is called: as the problem, unless Python or something that is imported has that name."""
    words = RESERVED_MODULES | sys.stdlib_module_names
    return Identifiers().made(blueprint.identifier, words=words)


def _readme(blueprint: Blueprint) -> Iterator[str]:
    name = module_name(blueprint)
    tables = " ".join(f"{table.identifier}.csv" for table in blueprint.tables)
    yield f"# {prose(blueprint.name)}"
    yield ""
    yield from (prose(blueprint.doc), "") if blueprint.doc else ()
    yield f"A solver in one Python module, written by mbm {blueprint.version}. It needs NumPy, nothing else."
    yield ""
    yield "```sh"
    yield f"python {name}.py {tables}".rstrip()
    yield f"python test_{name}.py    # solves data/ and compares with reference.csv, the answer of `mbm solve`"
    yield "```"
    yield ""
    usage = [f"import {name}", "", f"result = {name}.solve(tables)    # tables: name → columns by name, numbers in SI"]
    usage += [f'result["estimates"][{literal(unknown.name)}]["value"]' for unknown in blueprint.unknowns[:1]]
    yield from fenced(usage, "python")
    yield ""
    yield "`solve_each` goes through the data sets of a problem with `for-each`; `residuals` and `jacobian` give the"
    yield "equations at a point. Kernels run over all rows at once, the solver itself is plain Python: for speed take"
    yield "the target `c`."
    yield ""
