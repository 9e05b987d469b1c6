"""Command lines with options of odd values, for the problem ``small`` of `tests.fuzz.kinds`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.fuzz.forms import DOUBTFUL, HUGE, NUMBERS, WILD
from tests.fuzz.mutations import ODD_CELLS, mutated_bytes
from tests.trials.choices import Choices

NAMES = [
    "a",
    "h",
    "w",
    "v",
    "p",
    "T",
    "q",
    "zzz",
    "readings",
    "",
    "a b",
    "v.1",
    "a[1]",
    "é",
    "*/",
    "--",
    "\x1b[2J",
    "p[q]",
]
TEXTS = [
    *NUMBERS,
    *DOUBTFUL,
    *HUGE,
    *ODD_CELLS,
    "[1 2]",
    "(1 2)",
    "(+ 1 2)",
    "3cm",
    "10deg",
    '"text"',
    "(",
    "'a",
    "a",
    "\x1b[31m",
    "\u202e1",
    "1" * 5000,
    "(- " * 300 + "1" + ")" * 300,
]
PATHS = ["readings.csv", "nodes.csv", "zzz.csv", ".", "..", "", "small.mbm", "a\nb", "r.json", "/dev/null", "x/y.csv"]
METHODS = ["auto", "lm", "dogleg", "gauss-newton", "ipopt", "closed-form", "direct-search", "zzz", "", "(interval)"]
JUNK: list[Any] = [
    None,
    True,
    0,
    1,
    -1.5,
    1e300,
    10**400,
    "1",
    "3cm",
    "zzz",
    "\x1b",
    [],
    [1],
    [1, 2],
    [1, 2, 3],
    [[1, 0], [0, 1]],
    {},
    {"value": 1},
    {"value": [1, 2]},
    {"value": None},
    {"angle": 1, "translation": [1, 2]},
    {"quaternion": [1, 0, 0, 0], "translation": [1, 2, 3]},
    {"keys": ["p", "q"], "value": [1, 2]},
    {"keys": ["p"], "value": [1, 2]},
    float("nan"),
    float("inf"),
]


def values_file(path: Path, choices: Choices) -> Path:
    """A file of values for ``--init`` or ``--at``: name → value, a result document, or nothing of the kind."""
    values: Any = {choices.one_of([*NAMES, "a", "b"]): _value(choices, 2) for _ in range(choices.below(4))}
    match choices.below(8):
        case 0:
            values = {"solves": [{"key": {}, "estimates": values}]}
        case 1:
            values = {"solves": values, "mbm": "0.1.0"}
        case 2:
            values = _value(choices, 3)
    content = json.dumps(values).encode()
    path.write_bytes(mutated_bytes(content, choices) if choices.chance(6) else content)
    return path


def _value(choices: Choices, depth: int) -> Any:
    if depth == 0 or not choices.chance(3):
        return choices.one_of(JUNK)
    if choices.chance(2):
        return [_value(choices, depth - 1) for _ in range(choices.below(4))]
    return {choices.one_of(NAMES): _value(choices, depth - 1) for _ in range(choices.below(3))}


COMMANDS = {
    "solve": ("set", "data", "init", "problem", "method", "starts", "seed", "flag"),
    "check": ("data", "problem", "flag"),
    "simulate": ("set", "data", "at", "problem", "noise", "outliers", "flag"),
    "compile": ("set", "data", "flag"),
    "explain": ("problem", "flag"),
}
"""Commands, and which options each of them has."""
FLAGS = ("-q", "-v", "--no-color", "--strict-units", "--latex", "--sandbox", "--force", "--", "--zzz", "--help")
SOUND = ["a=2", "h=3m", "w=20deg", "v=[1 2]", "a=-3.5", "h=70cm", "w=1", "p=2"]


def option_lists(folder: Path, choices: Choices) -> tuple[list[str], tuple[Path, ...]]:
    """A command with one to four options, and the files that these name; half of the options are sound."""
    command = choices.one_of(("solve", "solve", "simulate", "check", "compile", "explain"))
    arguments, files = [command], []
    for _ in range(choices.count(1, 4)):
        option = choices.one_of(COMMANDS[command])
        if choices.chance(20):
            option = choices.one_of(COMMANDS["solve"])
        if option in ("init", "at"):
            files.append(values_file(folder / f"values{len(files)}.json", choices))
            arguments += [f"--{option}", str(files[-1])]
        else:
            arguments += _option(option, folder, choices)
    if command in ("simulate", "compile"):
        arguments += ["-o", str(folder / "made")]
    if command == "compile":
        arguments += ["--target", "python"]
    if command == "solve":
        arguments += ["--backend", "numpy"]
    if choices.chance(2) and command in ("solve", "check"):
        arguments += ["--json", "-"]
    return arguments, tuple(files)


def _option(option: str, folder: Path, choices: Choices) -> list[str]:
    odd = choices.chance(2)
    match option:
        case "set":
            entry = f"{choices.one_of(NAMES)}={choices.one_of(TEXTS)}" if odd else choices.one_of(SOUND)
            return ["--set", entry]
        case "data":
            name, path = (choices.one_of(NAMES), choices.one_of(PATHS)) if odd else ("readings", "readings.csv")
            return ["--data", f"{name}={folder / path}"]
        case "noise":
            return [choices.one_of(("--noise", "--measured")), f"readings={choices.one_of(TEXTS) if odd else 'y'}"]
        case "outliers":
            return ["--outliers", *((choices.one_of(TEXTS), choices.one_of(TEXTS)) if odd else ("0.2", "10"))]
        case "method":
            return ["--method", choices.one_of(METHODS)]
        case "starts":
            return ["--starts", choices.one_of(("0", "-1", "1e9", "9" * 30, "10000001")) if odd else "2"]
        case "flag":
            return [choices.one_of(FLAGS)]
        case _:
            return [f"--{option}", choices.one_of(WILD) if odd else {"problem": "small"}.get(option, "3")]
