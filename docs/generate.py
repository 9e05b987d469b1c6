"""Writes the pages of the manual that say what the code says; ``--check`` only compares (exit status 1 if one is old).

python docs/generate.py [--check]
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType

import mbm
from mbm.data.cells import MOST_COLUMNS
from mbm.data.images.photographs import PER_PIXEL
from mbm.data.union.tables import MOST_MATCHES
from mbm.equations.selection import MAXIMUM_SOLVES, MAXIMUM_WINDOWS
from mbm.estimation.minimise.minimise import DENSE_LIMIT
from mbm.expression.units import PLAIN, PREFIXES, REFUSED, TAKE_PREFIXES, WITH_ZERO
from mbm.files import memory
from mbm.language import limits as language_limits
from mbm.language.vocabulary import (
    arithmetic,
    comparison,
    curve_observables,
    curves,
    directions,
    external,
    frames,
    lines,
    lists,
    rotations,
    vectors,
)
from mbm.problem.reading.aggregates import OVER_ROWS
from mbm.problem.requests import MOST_BOXES
from mbm.problem.vocabulary import FUNCTIONS as PROBLEM_FUNCTIONS, SPECIAL_FORMS as PROBLEM_FORMS
from mbm.registry.standard import standard_registry
from mbm.shapes.library import LibraryModel
from mbm.shapes.meshes.types import MOST as MOST_VERTICES
from mbm.shapes.vocabulary import FEATURE_FUNCTIONS
from mbm.text.characters import LARGEST_TEXT, MOST_WORDS
from mbm.text.faults import MOST_FAULTS
from mbm.text.printer import LONGEST
from mbm.text.reader import DEEPEST, LONGEST_NUMBER
from mbm.text.types import LONGEST_MESSAGE, Code

DOCS = Path(__file__).parent
NOTE = "<!-- Made by docs/generate.py; do not edit. -->\n\n"
ROOMS: tuple[tuple[str, ModuleType], ...] = (
    ("Arithmetic", arithmetic),
    ("Comparison and logic", comparison),
    ("Vectors and matrices", vectors),
    ("Rotations and poses", rotations),
    ("Frames", frames),
    ("Cameras, image lines, distances", lines),
    ("Directions", directions),
    ("Curves", curves),
    ("Measured curves", curve_observables),
    ("Lists", lists),
    ("Functions in Python", external),
)
SPECIAL = {
    "quote": ("'form", "The form itself, not evaluated."),
    "quasiquote": ("`form", "The form with its unquoted parts filled in."),
    "unquote": (",form", "In a quasi-quotation: the value of the form."),
    "unquote-splicing": (",@form", "In a quasi-quotation: the elements of the value of the form."),
    "if": ("(if condition then else)", "One of two; piecewise where the condition holds columns or unknowns."),
    "cond": ("(cond (condition body…)… (else body…))", "The first clause whose condition holds."),
    "let": ("(let ((name value)…) body…)", "Names for values; all values are evaluated outside."),
    "let*": ("(let* ((name value)…) body…)", "Names for values; later values see earlier names."),
    "lambda": ("(lambda (a b) body…)", "A function."),
    "sum": ("(sum (i first last) form)", "The sum of the form for i = first … last."),
    "first": ("(first TABLE form)", "The form with the columns of the table's first row; in problems."),
    "last": ("(last TABLE form)", "The form with the columns of the table's last row; in problems."),
    "mean": (
        "(mean TABLE form)",
        "The mean over the rows of the table; in `derive` and `constraints`, where its first argument names a table.",
    ),
    "rms": ("(rms TABLE form)", "The root mean square, in the same way."),
    "median": ("(median TABLE form)", "The median, in the same way; not in constraints."),
    "quantile": ("(quantile TABLE q form)", "The quantile q, from 0 to 1, linear between rows; not in constraints."),
    "count": ("(count TABLE [condition])", "How many rows there are, or fulfil the condition, in the same way."),
    "previous": (
        "(previous form)",
        "The form with the columns of the row before, in the order of the unfiltered table; in problems.",
    ),
    "sample": (
        "(sample TABLE form at [:by column] [:order 1|3])",
        "The form between the two rows of the table around a time: on a line, a cubic, the great circle; in problems.",
    ),
}


UNITS_INTRODUCTION = """Quantities are kept in SI: a unit is a factor and a dimension. A unit is stuck to its number
(`5mm`, `40deg/s^2`), or stated by `:unit`. Factors are joined by `*` or `/`, and may have whole powers: `N*m`, `m/s^2`,
`s^-1`. What begins with a digit is a number, so that `1/s` is a unit in quotes only: `:unit "1/s"`. These and no others
are known. A prefix stands before a unit that takes prefixes: `mA`, `kohm`, `ueV` (`µ` is `u`). `G` is the standard
acceleration of gravity. A result without a stated unit is in SI, in the unit with the shortest name: `ohm`, `W/m/K`,
`m/s^2`.

## Temperatures

`degC` and `degF` are temperatures with a zero of their own. mbm keeps them in kelvin: `20degC` is 293.15 K, in formulas
too (the gas law wants kelvin and gets them). Values come back in degC if `:unit degC` says so; standard deviations,
widths and sensitivities beside them are differences, which have no zero: 1 °C of difference is 1 K.

| you write | it means |
| --- | --- |
| `(+ 20degC 5K)` | 25 °C |
| `(- 20degC 15degC)` | a difference of 5 K |
| `(/ (+ 20degC 30degC) 2)`, `(mean d t)` | 25 °C, the mean of the column |
| `:sigma 0.1K`, `:sigma 0.2degR` | a difference: 0.1 K; 0.2 degrees Fahrenheit |
| `:sigma 0.1degC`, `(= t (+ x 5degC))` | an error: `0.1degC` is 273.25 K. Write `0.1K`, `5K` |
| `:init 20`, `(< t 100)`, `(- t 20)` beside degC | an error: a plain 20 would be 20 K. Write `20degC`, or `20K` |
| `:unit degC` of a difference | an error: report it in K |
| `(rms d t)` of temperatures | their root mean square in kelvin, reported in K; with `:unit degC` an error |
| `:sigma (* 5% model)` of a temperature in degC | an error: 5 % counts from 0 K, which nobody means |
| `4mV/degC`, `1/degF` | in a compound a temperature is a difference: 4 mV/K |
| `(* 8.314J/mol/K 20degC)` | a product with the absolute temperature, 293.15 K |

An unknown without a unit that is equated with a temperature in degC, `(= t x)`, is one too: `:init 20degC`. It is
reported in K. A column that holds differences (a standard deviation in degC) is declared `:unit K`. The [recipe for a
thermometer](../how-to/laboratory-recipes.md#calibrate-a-thermometer) uses all this.

## Angles

`12d30m15.5s` are degrees, minutes and seconds of arc, `-0d30m` half a degree to the other side: 12.504306deg, −0.5deg.

## Known units

"""
VOCABULARY_INTRODUCTION = """All functions that problems may use; a definition in the file shadows one of the same name.
Arguments are numbers, or vectors of one length (element by element; numbers broadcast), unless it says otherwise. The
models of the shape library have [a page of their own](library.md).

## Special forms

"""
LIBRARY_INTRODUCTION = """Models that every file may call. They are written in the language itself, in
`mbm/shapes/library/`. Features are named by number: `(vertex (box 1m 2m 3m) 7)`, or from a column of data
`(feature (box 1m 2m 3m) path)` with `vertex/7`.

"""
DIAGNOSTICS_INTRODUCTION = """Every message of mbm has a stable code. It says where in the file or the data the fault
is, and its likely mend; several independent faults are reported in one run. Errors end with exit status 2; warnings
do not change it.

"""
BOUNDS_INTRODUCTION = f"""A problem is data that somebody else may have written, so what mbm takes for it is bounded.
What goes beyond a bound ends with a diagnostic that says the limit, before memory is taken. Bounds of memory follow
`{memory.VARIABLE}`, as in `{memory.VARIABLE}=8GB mbm solve …`; what may be written out follows
`{language_limits.VARIABLE}`, as in `{language_limits.VARIABLE}=4 mbm solve …` for four times as much, which takes four
times as long. The others are the same on every machine, so that a problem that is read here is read everywhere.

"""


def table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "".join(f"| {' | '.join(cell.replace('|', '&#124;') for cell in line)} |\n" for line in lines)


def code(text: str) -> str:
    """Text as Markdown code, whatever back-quotes it holds."""
    return f"`` {text} ``" if "`" in text else f"`{text}`"


def units() -> str:
    """The closed list of units."""
    known = {"prefixes": TAKE_PREFIXES, "none": {**PLAIN, **WITH_ZERO}}
    rows = [
        (
            code(u.symbol),
            f"{u.factor:.12g}" + (f" · value + {u.zero:.12g}" if u.zero else ""),
            u.dimension.symbol() or "—",
            beside,
        )
        for beside, units in known.items()
        for u in units.values()
    ]
    prefixes = [(code(prefix), f"10^{power}") for prefix, power in PREFIXES.items() if prefix]
    refused = [(code(symbol), reason) for symbol, reason in REFUSED.items()]
    return (
        f"# Units\n\n{NOTE}"
        f"{UNITS_INTRODUCTION}"
        + table(("unit", "in SI", "SI unit", "takes"), rows)
        + "\n## Prefixes\n\n"
        + table(("prefix", "factor"), prefixes)
        + "\n## Refused\n\nWhat people write and mbm does not read:\n\n"
        + table(("unit", "instead"), refused)
    )


def vocabulary() -> str:
    """Special forms and functions with their usage."""
    words = standard_registry().vocabulary()
    known = {*words.special_forms, *PROBLEM_FORMS, *(OVER_ROWS.keys() - words.functions.keys()), "previous"}
    if known != set(SPECIAL):
        message = f"docs/generate.py should describe these special forms: {sorted(known ^ set(SPECIAL))}"
        raise SystemExit(message)
    parts = [
        f"# Vocabulary\n\n{NOTE}",
        VOCABULARY_INTRODUCTION,
        table(("form", "means"), [(code(usage), doc) for usage, doc in SPECIAL.values()]),
    ]
    for title, room in ROOMS:
        parts += [f"\n## {title}\n\n", table(("usage", "value"), [(code(f.usage), f.doc) for f in room.FUNCTIONS])]
    for title, functions in (("Features of shapes", FEATURE_FUNCTIONS), ("Sequences", PROBLEM_FUNCTIONS.values())):
        rows = [(code(f.usage), f.doc) for f in functions]
        parts += [f"\n## {title}\n\n", table(("usage", "value"), rows)]
    return "".join(parts)


def library() -> str:
    """The shape library with its feature numbers."""
    parts = [
        f"# The shape library\n\n{NOTE}",
        LIBRARY_INTRODUCTION,
    ]
    for name, function in standard_registry().vocabulary().functions.items():
        if isinstance(function, LibraryModel):
            arguments = " ".join(function.parameters.required)
            parts.append(
                f"## `({name} {arguments})`\n\n" + "".join(f"{line}\n" for line in function.doc.splitlines()) + "\n"
            )
    parts.append("Shapes from files are [meshes](models.md).\n")
    return "".join(parts)


def diagnostic_codes() -> dict[str, list[tuple[str, Code]]]:
    """The codes of all ``faults`` modules of the package by name, with rooms and meanings."""
    found: dict[str, list[tuple[str, Code]]] = {}
    for module in pkgutil.walk_packages(mbm.__path__, "mbm."):
        if module.name.rpartition(".")[2] != "faults":
            continue
        room = module.name.split(".")[1]
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, Code):
                found.setdefault(value.name, []).append((room, value))
    return dict(sorted(found.items()))


def diagnostics() -> str:
    """What each code means, and how to mend it."""
    parts = [f"# Diagnostics\n\n{NOTE}", DIAGNOSTICS_INTRODUCTION]
    for name, entries in diagnostic_codes().items():
        parts.append(f"## `{name}`\n\n")
        for room, entry in entries:
            where = f" *({room})*" if len(entries) > 1 else ""
            parts.append(f"{_sentence(entry.meaning)}{where}\n\n**Mend.** {_sentence(entry.mend)}\n\n")
    return "".join(parts).rstrip("\n") + "\n"


def bounds() -> str:
    """What bounds the work on one problem, with the diagnostic that tells it, and what to do then."""
    limits = language_limits.Limits()
    usual = f"{memory.USUAL / 1e9:g} GB, or 1/{memory.SHARE} of the machine's memory if that is less"
    rows: tuple[tuple[str, str, str, str], ...] = (
        ("a problem file, in bytes", _count(LARGEST_TEXT), "text-too-large", "measurements in data files"),
        ("a problem file, in words", _count(MOST_WORDS), "text-too-large", "measurements in data files"),
        ("files of one problem", _count(limits.files), "too-many-files", "definitions, and tables, put together"),
        ("files of one pattern", _count(MOST_MATCHES), "too-many-matches", "a narrower pattern, or files put together"),
        ("brackets within brackets", _count(DEEPEST), "too-deeply-nested", "names for parts"),
        ("digits of a number", _count(LONGEST_NUMBER), "number-out-of-range", "powers of ten"),
        ("calls within calls", _count(limits.depth), "too-deep", "an end for the recursion, or `reduce`"),
        ("steps of one evaluation", _count(limits.steps), "too-many-steps", "tables in place of loops"),
        ("steps of all of them", _count(limits.total_steps), "too-many-steps", "tables in place of loops"),
        ("elements of a list or vector", _count(limits.list_length), "list-too-long", "a data table"),
        ("equations written out", _count(limits.equations), "too-much-to-compile", "`(observe TABLE …)`, `:per TABLE`"),
        ("operations in them", _count(limits.operations), "too-much-to-compile", "`(observe TABLE …)`, `:per TABLE`"),
        ("values that decide equations", _count(limits.equations), "too-many-static-values", "the column as a number"),
        ("words of a printed form", _count(LONGEST), "too-long-to-print", "a part of the form"),
        ("faults told in one run", _count(MOST_FAULTS), "more-faults", "the first ones mended"),
        ("characters of one message", _count(LONGEST_MESSAGE), "", "cut in the middle"),
        ("memory, everything together", usual, "too-much-memory", f"`{memory.VARIABLE}`"),
        ("a file, and what it unpacks to", f"1/{memory.FILE_SHARE} of that", "file-too-large", f"`{memory.VARIABLE}`"),
        ("an image", f"{PER_PIXEL} bytes of memory for a pixel", "too-much-memory", f"`{memory.VARIABLE}`"),
        ("vertices, and faces, of a mesh", _count(MOST_VERTICES), "damaged-mesh", "a coarser mesh"),
        ("columns of a table", _count(MOST_COLUMNS), "too-many-columns", "rows in place of columns"),
        ("numbers of a dense Jacobian", _count(DENSE_LIMIT), "too-many-unknowns", "`:method auto`"),
        ("solves of `for-each`", _count(MAXIMUM_SOLVES), "too-many-solves", "its columns in one table"),
        ("boxes that interval methods examine", _count(MOST_BOXES), "", "`(interval :boxes n)`"),
        ("windows", _count(MAXIMUM_WINDOWS), "too-many-solves", "a longer step"),
    )
    known = diagnostic_codes()
    strange = [name for *_, name, _ in rows if name and name not in known]
    if strange:
        message = f"docs/generate.py names diagnostics that there are not: {strange}"
        raise SystemExit(message)
    lines = [(what, most, f"[`{name}`](diagnostics.md#{name})" if name else "", do) for what, most, name, do in rows]
    return f"# Bounds\n\n{NOTE}{BOUNDS_INTRODUCTION}" + table(("what", "at most", "told by", "instead"), lines)


def _count(number: int) -> str:
    return f"{number:,}"


def _sentence(text: str) -> str:
    first = text[:1].upper() + text[1:]
    return first if first.endswith((".", "!", "?")) else first + "."


PAGES: dict[str, Callable[[], str]] = {
    "reference/units.md": units,
    "reference/vocabulary.md": vocabulary,
    "reference/library.md": library,
    "reference/diagnostics.md": diagnostics,
    "reference/bounds.md": bounds,
}


def outdated() -> list[str]:
    """The pages that differ from what would be written."""
    return [name for name, make in PAGES.items() if not (DOCS / name).is_file() or _read(name) != make()]


def _read(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def main(arguments: list[str]) -> int:
    """Write the pages, or with ``--check`` say which are old."""
    old = outdated()
    for name in old:
        if "--check" in arguments:
            print(f"docs/{name} is old: python docs/generate.py")
        else:
            (DOCS / name).write_text(PAGES[name](), encoding="utf-8")
    return 1 if old and "--check" in arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
