"""All files of a generated solver in Python."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.data_files import data_files
from mbm.emit.python.module import module
from mbm.emit.python.testing import TEST
from mbm.emit.system import static_system
from mbm.emit.types import Blueprint, OutputFile
from mbm.emit.words import described


def python_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """The module, its test, README, data."""
    name = blueprint.identifier
    files = [f"{table.identifier}.csv" for table in blueprint.tables]
    texts = {
        f"{name}.py": module(blueprint, static_system(blueprint)),
        f"test_{name}.py": TEST.format(name=name, files=files),
        "README.md": "\n".join([*_readme(blueprint), *described(blueprint)]) + "\n",
    }
    made = tuple(OutputFile(path=path, content=text.encode()) for path, text in texts.items())
    return (*made, *data_files(blueprint))


def _readme(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    usage = " ".join(f"{table.identifier}.csv" for table in blueprint.tables)
    yield f"# {blueprint.name}"
    yield ""
    yield from (blueprint.doc, "") if blueprint.doc else ()
    yield f"A solver in one Python module, written by mbm {blueprint.version}. It needs NumPy, nothing else."
    yield ""
    yield "```sh"
    yield f"python {name}.py {usage}".rstrip()
    yield f"python test_{name}.py    # solves data/ and compares with reference.csv, the answer of `mbm solve`"
    yield "```"
    yield ""
    yield "```python"
    yield f"import {name}"
    yield ""
    yield f"result = {name}.solve(tables)    # tables: name → columns by name, numbers in SI"
    yield f'result["estimates"][{blueprint.unknowns[0].name!r}]["value"]'
    yield "```"
    yield ""
    yield "`solve_each` goes through the data sets of a problem with `for-each`; `residuals` and `jacobian` give the"
    yield "equations at a point. Kernels run over all rows at once, the solver itself is plain Python: for speed take"
    yield "the target `c`."
    yield ""
