"""The test beside a generated Python module."""

TEST = '''"""The numbers of `mbm solve` for the data of `data/` must come again: `python test_{name}.py`, or pytest."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import {name} as solver

FOLDER = Path(__file__).parent


def differences() -> tuple[list[str], int]:
    """What differs by more than 1e-9 of its size or its standard deviation; how many numbers there are."""
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
            i, j, value, spread = int(row["row"]), int(row["column"]), float(row["value"]), float(row["spread"])
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
            if not abs(answer - value) <= 1e-9 * max(abs(value), spread):
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
