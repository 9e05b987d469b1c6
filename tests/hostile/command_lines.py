"""Command lines that are long, and values on them, or in the files they name, that are large."""

from __future__ import annotations

import json
from pathlib import Path

from mbm.problem.reading.request import MAXIMUM_STARTS
from tests.hostile.sizes import digits, size
from tests.hostile.texts import word
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home

NUMPY = ("--backend", "numpy")
PROBLEM = """(defconst h 2)
(problem p (data d (table (x y) (1 2) (2 4.5) (3 6))) (unknowns (a :init 1) (v (vector 3) :init [1 1 1]))
  (observe d (= y (+ (* a x) h)) :sigma 1) (observe (= [1 2 3] v) :sigma 1))
"""
LONGEST = 100_000
"""Characters of one argument: systems take 131,072 bytes."""
A_START = 0.001
"""Seconds that one more start may take where NumPy evaluates: twice what it takes, so that work that grows faster than
the number of starts is still seen."""


def command_line(here: Home, choices: Choices) -> Case:
    """A command for a sound problem, with one large option."""
    folder = here.cleared("case")
    file = folder / "p.mbm"
    file.write_text(PROBLEM, encoding="utf-8")
    name, work = choices.one_of(("a", "v", "h", "d", "zzz")), 0.0
    match choices.below(8):
        case 0 | 1:
            arguments = _values(folder, choices)
        case 2:
            arguments = ("solve", *NUMPY, "--set", f"{name}={digits(choices, LONGEST // 2)}")
        case 3:
            form = choices.one_of(("(+ 1 ", "[", "'", "(- ", "(sum (i 1 9999) ")) * size(choices, 1, LONGEST // 20)
            arguments = ("solve", *NUMPY, "--set", f"{name}={form}1")
        case 4:
            option = choices.one_of((("--set", "a=1"), ("--data", "d=zzz"), ("-v",), ("--zzz",), ("--json", "r.json")))
            arguments = ("solve", *NUMPY, *option * size(choices, 1, 10_000))
        case 5:
            option = choices.one_of(("--starts", "--seed", "--workers", "--method", "--problem", "--covariance"))
            value = choices.one_of((digits(choices, LONGEST // 2), str(size(choices, 1, 10**12)), "1e9"))
            arguments = ("solve", *NUMPY, f"{option}={value}")
            if option == "--starts" and len(value) <= len(str(MAXIMUM_STARTS)) and value.isdecimal():
                work = min(int(value), MAXIMUM_STARTS) * A_START
        case 6:
            long = choices.one_of(("x", "../", "é", "x/", "\n", "\x1b[2J", " ")) * size(choices, 1, LONGEST // 6)
            option = choices.one_of(("--init", "--json", "--csv", "--sandbox", "--problem", "--method"))
            arguments = ("solve", *NUMPY, option, long)
        case _:
            noise = choices.one_of((f"d={digits(choices, LONGEST // 2)}", word(choices).replace("\x00", "0")))
            arguments = ("simulate", "-o", "made", choices.one_of(("--noise", "--seed", "--measured")), noise[:LONGEST])
    return Case(arguments=(*arguments, str(file)), files=(file,), kept=(file,), work=work)


def _values(folder: Path, choices: Choices) -> tuple[str, ...]:
    """``--init`` or ``--at`` with a file of large values."""
    path, count = folder / "values.json", size(choices, 1, 300_000)
    match choices.below(6):
        case 0:
            text = f'{{"a": {digits(choices, 3_000_000)}}}'
        case 1:
            text = json.dumps({"v": [1.0] * count})
        case 2:
            text = json.dumps({f"n{i}": 1 for i in range(count)})
        case 3:
            text = choices.one_of(("[", '{"a": ', '{"a": [')) * count
        case 4:
            solves = [{"key": {"k": i}, "estimates": {"a": {"value": i}}} for i in range(count // 10)]
            text = json.dumps({"solves": solves})
        case _:
            text = json.dumps({"a": "x" * count, "x" * count: 1})
    path.write_text(text, encoding="utf-8")
    if choices.chance(3):
        return ("simulate", "-o", "made", "--at", str(path))
    return ("solve", *NUMPY, "--init", str(path))
