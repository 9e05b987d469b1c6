"""Texts that would do something to a terminal, files that hold them in every place, and what output must not hold."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

FORGED = "chi² = 0, all is well: 9 degrees of freedom"
"""A line that mbm never says, and that a text of a file tries to make it say."""

MARKS = (
    "\x1b]52;c;cm0gLXJm\x07"  # writes to the clipboard
    "\x1b]0;owned\x1b\\\x1b[2J\x1b[1;31m"  # the title of the window; clears the screen; colours as mbm has them
    "\x9b31m\x90\x85\x7f\x08\x0b\x0c"  # C1 controls, DEL, backspace
    "\u202e\u2066\u2069\u200b\u200d\u2028\u2029\ufeff\u00ad\U000e0041"  # other directions, invisible, line ends
)
HOSTILE = f"{MARKS}\r\n{FORGED}\r{FORGED}\n\t{FORGED}\n"

PAINTED = re.compile("\x1b\\[(?:1|2|1;3[1-4])m([^\x1b\n]*)\x1b\\[0m")
"""What mbm itself colours: one style and the end of it, on one line."""


def objections(output: str, *, color: bool = False) -> list[str]:
    """What a terminal should not have been shown, or that a forged line stands there as if mbm had said it."""
    text = PAINTED.sub(r"\1", output) if color else output
    found = sorted({f"U+{ord(c):04X}" for c in text if not (c.isprintable() or c == "\n")})
    return found + [line for line in text.split("\n") if line.startswith(FORGED[:12])]


def literal(text: str) -> str:
    """A text as the language writes it, line breaks as they are."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def csv_text(rows: list[list[str]]) -> str:
    """A CSV file with every cell in quotes."""
    stream = io.StringIO(newline="")
    csv.writer(stream, quoting=csv.QUOTE_ALL, lineterminator="\n").writerows(rows)
    return stream.getvalue()


NAME = f"{MARKS}\n{FORGED}"
"""What stands in the problem and in its table alike: of a problem, carriage returns are read as line feeds."""

KEYS = (f"a{NAME}", f"=1+1{NAME}")
COLUMN = f"reading{NAME}"
EPOCHS = (f"1{HOSTILE}!", f"@2{HOSTILE}!")

DATA = csv_text(
    [
        ["epoch", "part", "x", COLUMN],
        *([e, KEYS[x % 2], str(x), str(1.5 * x + 0.1 * x * x)] for e in EPOCHS for x in range(1, 7)),
    ]
)


def problem(*, data: str, many: bool, more: str = "") -> str:
    """A problem with hostile texts wherever the language takes texts; ``data`` is the path of its table."""
    doc, column = literal(HOSTILE), literal(COLUMN)
    rows = " ".join(f"({literal(key)} {i})" for i, key in enumerate(KEYS, 1))
    return f"""(problem p
  {doc}
  (constants (c 1))
  (data places (table (name weight) {rows}) :key name)
  (data parts (csv {literal(data)}) :columns (epoch part x (y {column} :unit mm)))
  (unknowns
    (a :doc {doc} :unit mm)
    (b :doc {doc})
    (offset :per places :doc {doc} :init 0 :sigma 1mm))
  (observe parts (= y (+ (* a x) (* 1mm b x x) (offset part))) :sigma 1mm)
  (derive (d (* 2 c a) :unit mm))
  {"(for-each epoch)" if many else ""}
  {more})
"""


def write(folder: Path, name: str, *, many: bool = False, more: str = "") -> Path:
    """The problem and its table, in files with hostile names."""
    data = f"data{MARKS}\n{FORGED}.csv".replace("/", "")
    (folder / data).write_text(DATA, encoding="utf-8", newline="")
    path = folder / f"{name}{MARKS}\n{FORGED}.mbm".replace("/", "")
    path.write_text(problem(data=data, many=many, more=more), encoding="utf-8", newline="")
    return path


def values(folder: Path) -> Path:
    """Initial values of which none is right."""
    path = folder / f"init{MARKS}\n.json".replace("/", "")
    path.write_text(json.dumps({HOSTILE: 1.0}), encoding="utf-8")
    return path
