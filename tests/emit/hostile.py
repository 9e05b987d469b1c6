"""Problems whose every name, key, documentation, path and cell holds what ends comments and strings somewhere."""

from __future__ import annotations

import csv
from pathlib import Path

NAME = "*//*//**//%&@<=>?!^é"
"""All of it that a name may hold, and letters of other alphabets."""

TEXT = (
    '*/ /* // **// """ \\ \\" \' \n \r \t % %n %s { } {0} $( ) ${HOME} $(touch pwned) `touch pwned` ``` ??/ ??) '
    "# -- ; & | < > <b> &amp; é ω 中 \x1b[31m \x07 \x9b \u202e \u2066 \u2028 \ufeff \U0001f9ff \\"
)
"""What a text may hold: line breaks, escape sequences, marks of direction and of other languages' comments."""

FORMULA = '=cmd|" /C calc"!A0'
KEYS = (TEXT, FORMULA, "@SUM(1;2)", "-1+2", "ends with \\", "??/", "plain")


def quoted(text: str) -> str:
    """The text as the language writes it; what it has no escape for stands as it is."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return '"' + escaped.replace("\r", "") + '"'


def as_read(text: str) -> str:
    """The text that `quoted` gives."""
    return text.replace("\r", "")


def written_problem(folder: Path) -> Path:
    """A problem in a folder of such a name, with a table from a file of such a name."""
    home = folder / TEXT.replace("/", ":").replace("\x00", "")
    home.mkdir(parents=True)
    table = "d*:" + TEXT.replace("/", ":").replace("\r", "")[:80] + ".csv"
    rows = [(key, x, 2.0 * x + 0.1 * (i % 3) + (0.3 if key == FORMULA else 0.0)) for i, key, x in _points()]
    with (home / table).open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, quoting=csv.QUOTE_ALL).writerows([(f"who{NAME}", f"x{NAME}", f"*{NAME}"), *rows])
    keys = " ".join(f"({quoted(key)} {i + 1})" for i, key in enumerate(KEYS))
    doc, one = quoted(TEXT), quoted(FORMULA)
    text = f"""
(problem ../../p{NAME}
  {doc}
  (constants (%n{NAME} 2) (//κ{NAME} 0.5))
  (data t{NAME} (table (id{NAME} w{NAME}) {keys}) :key id{NAME})
  (data *d{NAME} (csv {quoted(table)}) :columns ((y{NAME} *{NAME} :unit mm)) :with (t{NAME} who{NAME})
    :where (> x{NAME} 0.5))
  (unknowns
    (a{NAME} :init 1mm :unit cm :doc {doc})
    (=f{NAME} :per t{NAME} :init 0 :unit cm :doc {doc} :sigma 1cm)
    (v{NAME} (vector 2) :init [1 1] :sigma 10 :doc {doc})
    (ω{NAME} :per *d{NAME}.who{NAME} :init 0 :sigma 1 :doc {doc}))
  (observe o{NAME} *d{NAME}
    (= y{NAME} (+ (* a{NAME} x{NAME}) (* 1mm (sqrt t{NAME}.w{NAME})) (=f{NAME} who{NAME}))) :sigma 0.2mm)
  (observe two{NAME} *d{NAME}
    (= x{NAME} (+ (v{NAME} 1) (* (v{NAME} 2) (if (= who{NAME} {one}) 1 //κ{NAME})) (ω{NAME} who{NAME})))
    :sigma 0.2 :when (< x{NAME} 14.5))
  (constraints (<= (=f{NAME} {doc}) 5cm :name limit{NAME}))
  (derive
    (g{NAME} (* %n{NAME} a{NAME}) :unit cm)
    (h{NAME} (* a{NAME} x{NAME}) :over *d{NAME} :unit mm)
    (@k{NAME} (=f{NAME} {one}) :unit mm)))
"""
    problem = home / "problem.mbm"
    problem.write_text(text, encoding="utf-8")
    return problem


def _points() -> list[tuple[int, str, float]]:
    return [(i, as_read(KEYS[i % len(KEYS)]), 0.25 + i) for i in range(2 * len(KEYS))]


EPOCHS = f"""(problem n{NAME} {quoted(TEXT)}
  (data d{NAME} (table (day{NAME} y{NAME})
    ({quoted(TEXT)} 1.1cm) ({quoted(FORMULA)} 3.2cm) ({quoted(TEXT)} 1.3cm) ({quoted(FORMULA)} 2.7cm) ("=x,y" 5cm)
    ("=x,y" 6cm)))
  (unknowns (m{NAME} :init 0m :unit mm :doc {quoted(TEXT)}))
  (observe d{NAME} (= y{NAME} m{NAME}) :sigma 0.5cm)
  (for-each day{NAME}))"""
"""A problem of several solves: their keys are texts of cells."""
