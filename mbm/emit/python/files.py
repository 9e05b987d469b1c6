"""All files of a generated solver in Python, its test among them."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from mbm.emit.data_files import data_files
from mbm.emit.identifiers import Identifiers
from mbm.emit.markdown import fenced, prose
from mbm.emit.python.module import module
from mbm.emit.python.text import literal
from mbm.emit.system import static_system
from mbm.emit.types import Blueprint, OutputFile
from mbm.emit.words import described

RESERVED_MODULES = frozenset({"numpy", "pytest"})
"""What the module must not be mistaken for, besides those of the standard library."""
CHUNK = 512
"""Residuals that are triangularised at a time, at least: NumPy's calls cost more than a few rows that are not used."""


TEST = '''"""The numbers of `mbm solve` for the data of `data/` must come again: `python test_{name}.py`, or pytest."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import {name} as solver

FOLDER = Path(__file__).parent


def differences() -> tuple[list[str], int]:
    """What differs by more than `reference.csv` allows; how many numbers there are."""
    with (FOLDER / "reference.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    paths = [str(FOLDER / "data" / name) for name in {files!r}]
    found, compared = [], 0
    tables = solver.read_tables(paths)
    for number, (_, chosen) in enumerate(solver.data_sets(tables), start=1):
        own = [r for r in rows if int(r["solve"]) == number]
        begun = {{int(r["row"]): float(r["value"]) for r in own if r["what"] == "start"}}
        result = solver.solve(chosen, solver.started(chosen, begun) if begun else None)
        for row in (r for r in own if r["what"] != "start"):
            i, j, value, allowed = int(row["row"]), int(row["column"]), float(row["value"]), float(row["allowed"])
            answers = {{
                "status": lambda: float(solver.STATUSES.index(result["status"])),
                "number": lambda: result["point"][i],
                "covariance": lambda: result["covariance"][i, j],
                "freedom": lambda: float(result["freedom"]),
                "cost": lambda: result["cost"],
                "derived": lambda: list(result["derived"].values())[i]["value"].ravel()[j],
                "derived sigma": lambda: list(result["derived"].values())[i]["sigma"].ravel()[j],
            }}
            answer = answers[row["what"]]()
            compared += 1
            if not abs(answer - value) <= allowed:
                found.append(f"solve {{number}}: {{row['what']}} {{i}} {{j}}: {{answer!r}}, wanted {{value!r}}")
    return found, compared


def test_reference_numbers() -> None:
    """As `differences` says."""
    found, compared = differences()
    assert compared > 0
    assert not found, "\\n".join(found)


if __name__ == "__main__":
    wrong, of = differences()
    print("\\n".join([*wrong, f"{{len(wrong)}} of {{of}} numbers differ"]))
    sys.exit(1 if wrong or not of else 0)
'''
"""The test beside the module; ``name`` is the module's, ``files`` are those of its tables."""


def python_files(blueprint: Blueprint) -> tuple[OutputFile, ...]:
    """The module, its test, README, data."""
    name = module_name(blueprint)
    files = [f"{table.identifier}.csv" for table in blueprint.tables]
    texts = {
        f"{name}.py": module(blueprint, static_system(blueprint, CHUNK)),
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
    yield from (
        f"# {prose(blueprint.name)}",
        "",
        *((prose(blueprint.doc), "") if blueprint.doc else ()),
        f"A solver in one Python module, written by mbm {blueprint.version}. It needs NumPy, nothing else.",
        "",
        "```sh",
        f"python {name}.py {tables}".rstrip(),
        f"python test_{name}.py    # solves data/ and compares with reference.csv, the answer of `mbm solve`",
        "```",
        "",
    )
    usage = [
        f"import {name}",
        "",
        f"result = {name}.solve(tables)    # tables: name → columns by name, numbers in SI",
        *[f'result["estimates"][{literal(unknown.name)}]["value"]' for unknown in blueprint.unknowns[:1]],
    ]
    yield from (
        *fenced(usage, "python"),
        "",
        "`solve_each` goes through the data sets of a problem with `for-each`; `residuals` and `jacobian` give the",
        "equations at a point. Kernels run over all rows at once, the solver itself is plain Python: for speed take",
        "the target `c`.",
        "",
    )
