"""What generated programs print: units as stated, by numbers worked out by hand; and nothing that a terminal obeys."""

from __future__ import annotations

import csv
import importlib.util
import math
import shutil
import sys
import unicodedata

import pytest

import mbm
from mbm import compiler
from mbm.compiler import Inputs
from mbm.emit.c.csv import CSV
from mbm.text.types import MbmError
from tests.emit.making import emitted, of_text, run, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

CLOSE = 1e-12
"""Relative: sums of four numbers in double precision."""

MEANS = """(problem means "Means of lengths and of angles, in units of their own."
  (data d (table (k y) ("a" 10mm) ("a" 14mm) ("b" 21mm) ("b" 25mm)))
  (data e (table (k v) ("a" 30deg) ("a" 32deg)))
  (unknowns (m :per d.k :init 0m :unit cm) (q :init 0rad :unit deg))
  (observe d (= y (m k)) :sigma 2mm)
  (observe e (= v q) :sigma 1deg)
  (derive
    (both (+ (m "a") (m "b")) :unit cm)
    (each (* 2 (m k)) :over d :unit km)
    (half (/ q 2) :unit deg)
    (plain (m "a"))))"""
ROOT = math.sqrt(2.0)
BY_HAND = [
    ("m[a]", 1.2, 0.2 / ROOT, "cm"),
    ("m[b]", 2.3, 0.2 / ROOT, "cm"),
    ("q", 31.0, 1.0 / ROOT, "deg"),
    ("both", 3.5, 0.2, "cm"),
    ("each[1]", 2.4e-5, 0.4e-5 / ROOT, "km"),
    ("each[2]", 2.4e-5, 0.4e-5 / ROOT, "km"),
    ("each[3]", 4.6e-5, 0.4e-5 / ROOT, "km"),
    ("each[4]", 4.6e-5, 0.4e-5 / ROOT, "km"),
    ("half", 15.5, 0.5 / ROOT, "deg"),
    ("plain", 0.012, 0.002 / ROOT, ""),
]
"""Two readings for each mean: their mean, and their standard deviation over the root of two."""

COLUMNS = """(problem columns "A length, in the units of two files."
  (data d (csv "d.csv") :columns ((length :unit mm) (turn :unit deg)))
  (unknowns (a :init 0m :unit cm) (b angle :init 0))
  (observe d (= length a) :sigma 1mm)
  (observe turned d (= turn b) :sigma 1deg))"""


def programs(text, folder):
    """Both programs for a problem: how each is called."""
    in_c = written(of_text(text, "c"), folder / "c")
    made = run("make", "CFLAGS=-O0", folder=in_c)
    assert made.returncode == 0, made.stdout + made.stderr
    in_python = written(of_text(text, "python"), folder / "python")
    name = next(path.name for path in in_python.iterdir() if path.suffix == ".py" and not path.name.startswith("test_"))
    return (lambda *given: run(f"./{name[:-3]}", *given, folder=in_c)), (
        lambda *given: run(sys.executable, str(in_python / name), *given, folder=in_c)
    )


@needs_compiler
def test_values_and_standard_deviations_are_in_the_stated_unit(tmp_path):
    for program in programs(MEANS, tmp_path):
        found = program("data/d.csv", "data/e.csv")
        rows = [tuple(row) for row in csv.reader(found.stdout.splitlines())][1:]
        assert [(row[0], row[3]) for row in rows] == [(name, unit) for name, _, _, unit in BY_HAND]
        for (_, value, sigma, _), (_, wanted, spread, _) in zip(rows, BY_HAND, strict=True):
            assert math.isclose(float(value), wanted, rel_tol=CLOSE)
            assert math.isclose(float(sigma), spread, rel_tol=CLOSE)


def test_columns_of_the_test_have_the_numbers_of_the_file(tmp_path):
    cells = [["length", "turn"], ["10.25", "30.5"], ["14.5", "31.25"]]
    (tmp_path / "d.csv").write_text("\n".join(map(",".join, cells)) + "\n", encoding="utf-8")
    (tmp_path / "p.mbm").write_text(COLUMNS, encoding="utf-8")
    folder = written(emitted(mbm.load(tmp_path / "p.mbm"), "python"), tmp_path / "python")
    with (folder / "data" / "d.csv").open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    assert names == cells[0]
    for row, wanted in zip(rows, cells[1:], strict=True):
        # one rounding on the way to SI and one on the way back
        assert all(math.isclose(float(a), float(b), rel_tol=4e-16) for a, b in zip(row, wanted, strict=True))


def characters() -> str:
    """Every character that some version of Unicode before the one of this Python has assigned, but NUL and halves."""
    return "".join(c for c in map(chr, range(1, 0x110000)) if unicodedata.category(c) not in ("Cn", "Cs"))


@needs_compiler
def test_c_shows_every_character_as_a_terminal_may_have_it(tmp_path):
    (tmp_path / "csv.h").write_text(CSV, encoding="utf-8")
    main = '#include "csv.h"\nint main(void)\n{\n    size_t size;\n'
    main += '    char *text = csv_whole_file("in", &size);\n'
    main += "    csv_show(stdout, text, 0);\n    free(text);\n    return 0;\n}\n"
    (tmp_path / "main.c").write_text(main, encoding="utf-8")
    made = run("cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-o", "main", "main.c", folder=tmp_path)
    assert made.returncode == 0, made.stderr
    given = characters()
    (tmp_path / "in").write_bytes(given.encode())
    wanted = "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in given)
    shown = run("./main", folder=tmp_path).stdout
    assert [hex(ord(a)) for a, b, c in zip(given, shown, wanted, strict=True) if b != c] == []
    # bytes that are no UTF-8: alone, cut off, too long for what they say, half of a pair, beyond the last character
    broken = (b"\x80", b"\xff", b"\x9b", b"\xc3", b"\xe2\x82", b"\xf0\x9f\xa7", b"\xc0\xaf", b"\xe0\x80\xaf")
    broken += (b"\xf0\x80\x80\xaf", b"\xed\xa0\x80", b"\xf4\x90\x80\x80", b"\xf8\x88\x80\x80\x80")
    for each in broken:
        (tmp_path / "in").write_bytes(b"a" + each + b"b")
        assert set(run("./main", folder=tmp_path).stdout[1:-1]) == {"\N{REPLACEMENT CHARACTER}"}


LEVELS = """(problem levels
  (data days (table (day level) ("a" 1.1) ("b" 2.2) ("a" 1.3)))
  (unknowns (m :init 0) (=f :per days.day :init 0 :sigma 1))
  (observe days (= level (+ m (=f day))) :sigma 0.5)
  (for-each day))"""
CELLS = {
    "=1+1": "'=1+1",
    "+1": "'+1",
    "-x": "'-x",
    "@SUM(A1)": "'@SUM(A1)",
    "\t=1": "' =1",
    "1-2": "1-2",
    "'=1": "'=1",
    'a,"b"': 'a,"b"',
    "two\nlines": "two lines",
    "\x1b[2J\x07": "\N{REPLACEMENT CHARACTER}[2J\N{REPLACEMENT CHARACTER}",
    "\u202eback\u2066": "\N{REPLACEMENT CHARACTER}back\N{REPLACEMENT CHARACTER}",
    "": "",
}
"""Cells of text as they come, and as a program puts them into its table."""


@needs_compiler
def test_cells_reach_no_terminal_and_no_spreadsheet_as_they_are(tmp_path):
    for program in programs(LEVELS, tmp_path):
        given = tmp_path / "given.csv"
        with given.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([("day", "level"), *((cell, i + 1.5) for i, cell in enumerate(CELLS))])
        found = program(str(given))
        rows = list(csv.reader(found.stdout.splitlines()))
        assert rows[0] == ["day", "name", "value", "sigma", "unit"]
        assert [row[0] for row in rows[1::2]] == list(CELLS.values())
        shown = [cell if i not in (0, 1, 2, 3, 4) else cell[1:] for i, cell in enumerate(CELLS.values())]
        assert [row[1] for row in rows[2::2]] == [f"'=f[{cell}]" for cell in shown]
        assert all(line.isprintable() for line in (found.stdout + found.stderr).splitlines())


WRONG = (
    "day,\x1b[31mlevel\n",
    "day,level\na,\x1b]0;title\x07\n",
    'day,level\na,"1\n2"\n',
    "day,level\na\u202e\n",
    "day,level\na,1\n\0",
    "x" * 200000,
)


@needs_compiler
def test_what_is_wrong_is_told_in_one_line(tmp_path):
    given = tmp_path / "\x1b[2Jgiven\n\u202e.csv"
    for program in programs(LEVELS, tmp_path):
        for content in WRONG:
            given.write_text(content, encoding="utf-8")
            found = program(str(given))
            assert found.returncode == 2
            (line,) = found.stderr.splitlines()
            assert line.startswith("error: ")
            assert line.isprintable()
        assert program(str(given), str(given)).stderr.count("\n") == 1


def test_python_prints_into_any_encoding(tmp_path):
    text = "(problem greek (data d (table (y) (1) (2))) (unknowns (ω :init 0)) (observe d (= y ω) :sigma 1))"
    folder = written(of_text(text, "python"), tmp_path)
    found = run("env", "PYTHONIOENCODING=ascii", sys.executable, "greek.py", "data/d.csv", folder=folder)
    assert found.returncode == 0, found.stderr
    assert "\\u03c9,1.5," in found.stdout


def test_messages_of_the_module_show_names_by_their_letters(tmp_path, monkeypatch):
    folder = written(of_text(LEVELS, "python"), tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    spec = importlib.util.spec_from_file_location("emitted_levels", folder / "levels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.raises(module.DataError, match="the table 'days' is missing"):
        module.solve({})


@pytest.mark.parametrize("target", ["c", "python"])
@pytest.mark.parametrize("text", ["a\0b", "a\ud800"])
def test_texts_that_no_csv_file_holds_are_refused(text, target):
    problem = mbm.loads(
        "(problem p (data d external) (unknowns (a :per d.k :init 0)) (observe d (= y (a k)) :sigma 1))"
    )
    inputs = Inputs(tables={"d": {"k": [text, "other"], "y": [1.0, 2.0]}})
    found = compiler.elaborated(problem.program, None, inputs, problem.registry)
    with pytest.raises(MbmError, match="not-emitted: the column `k` of `d` cannot be compiled"):
        compiler.emitted(found, target, problem.registry)
    assert compiler.emitted(found, "casadi", problem.registry)
