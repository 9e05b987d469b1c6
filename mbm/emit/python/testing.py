"""The test beside a generated Python module."""

TEST = '''"""The numbers of `mbm solve` for the data of `data/` must come again: `python test_{name}.py`, or pytest."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import {name}

FOLDER = Path(__file__).parent


def differences() -> tuple[list[str], int]:
    """What differs by more than 1e-9 of its size or its standard deviation; how many numbers there are."""
    with (FOLDER / "reference.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    paths = [str(FOLDER / "data" / name) for name in {files!r}]
    found, compared = [], 0
    for number, (_, result) in enumerate({name}.solve_each({name}.read_tables(paths)), start=1):
        for row in (r for r in rows if int(r["solve"]) == number):
            i, j, value, spread = int(row["row"]), int(row["column"]), float(row["value"]), float(row["spread"])
            answers = {{
                "status": lambda: float({name}.STATUSES.index(result["status"])),
                "number": lambda: result["point"][i],
                "covariance": lambda: result["covariance"][i, j],
                "freedom": lambda: float(result["freedom"]),
                "cost": lambda: result["cost"],
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
