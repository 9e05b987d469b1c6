"""Generated solvers where the data do not suffice, and what their programs print."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys

import pytest

import mbm
from mbm.text.types import MbmError
from tests.emit.making import emitted, make, of_text, run, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

TWO_RANGES = """(problem {name}
  (data d (table (x y z r) (0 0 0.3 3.977552193014155) (10 0 2.5 8.438999155724861)))
  (unknowns (p (vector 3) :init [4 4 1]{bounds}))
  (observe d (= r (distance p [x y z])) :sigma 0.02{loss})
  {more})"""
BOUNDS = " :in ([0 0 0] [10 10 1.2])"
LINE = "(constraints (= (+ (p 1) (p 2)) 6)) (solve :constraints exact)"

FREE = {
    # two ranges and three unknowns: where a bound is met, it is met by accident
    "cauchy": TWO_RANGES.format(name="cauchy", bounds=BOUNDS, loss=" :loss cauchy", more=""),
    "huber": TWO_RANGES.format(name="huber", bounds=BOUNDS, loss=" :loss huber", more=""),
    "plain": TWO_RANGES.format(name="plain", bounds=BOUNDS, loss="", more=""),
    # the line misses the circle of both ranges: residuals remain, and the two columns along it are parallel
    "missed": TWO_RANGES.format(name="missed", bounds="", loss="", more=LINE),
}


@pytest.mark.parametrize("target", [pytest.param("c", marks=needs_compiler), "python"])
@pytest.mark.parametrize("name", FREE)
def test_what_data_do_not_determine_has_no_standard_deviation(name, target, tmp_path):
    assert mbm.loads(FREE[name]).solve().solves[0].status == "unobservable"
    folder = written(of_text(FREE[name], target), tmp_path)
    if target == "c":
        assert make(folder, "all", "test", watched=False).returncode == 0
        found = run(f"./{name}", "data/d.csv", folder=folder)
    else:
        assert run(sys.executable, f"test_{name}.py", folder=folder).returncode == 0
        found = run(sys.executable, f"{name}.py", "data/d.csv", folder=folder)
    assert found.returncode == 1
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert [row["name"] for row in rows] == ["p[1]", "p[2]", "p[3]"]
    assert {row["sigma"] for row in rows} == {""}


EACH = """(problem each
  (data d (table (epoch mast y) (1 7 2) (1 7 3) (1 8 5) (2.5 7 1) (2.5 8 4)))
  (unknowns (a :per d.mast :init 0))
  (observe d (= y (a mast)) :sigma 0.1)
  (for-each epoch))"""


@needs_compiler
def test_both_languages_print_keys_alike(tmp_path):
    c, python = (written(of_text(EACH, target), tmp_path / target) for target in ("c", "python"))
    assert make(c, "all", watched=False).returncode == 0
    commands = ((c, "./each"), (python, sys.executable, "each.py"))
    printed = [run(*command, "data/d.csv", folder=folder).stdout for folder, *command in commands]
    rows = [[(row["epoch"], row["name"]) for row in csv.DictReader(text.splitlines())] for text in printed]
    wanted = [(epoch, name) for epoch in ("1", "2.5") for name in ("a[7]", "a[8]")]
    assert rows == [wanted, wanted]


SPREADS = """(problem spreads
  (data d (table (day y s c) (1 4 0.1 1) (2 6 0.2 1) (3 5 0.1 1)))
  (unknowns (m :init 0))
  (observe d (= y (+ m (log c))) :sigma s)
  (for-each day))"""
FAULTY = {
    "6,0,1": "error: a standard deviation is not above zero",
    "6,0.1,-1": "error: an equation has no finite value at the start",
}
"""What a second row may hold, and what is said of it."""


@pytest.mark.parametrize("row", FAULTY)
@pytest.mark.parametrize("target", [pytest.param("c", marks=needs_compiler), "python"])
def test_a_faulty_data_set_does_not_stop_the_others(target, row, tmp_path):
    folder = written(of_text(SPREADS, target), tmp_path)
    (folder / "data" / "d.csv").write_text(f"day,y,s,c\n1,4,0.1,1\n2,{row}\n3,5,0.1,1\n", encoding="utf-8")
    if target == "c":
        assert make(folder, "all", watched=False).returncode == 0
        found = run("./spreads", "data/d.csv", folder=folder)
    else:
        found = run(sys.executable, "spreads.py", "data/d.csv", folder=folder)
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert [(row["day"], float(row["value"])) for row in rows] == [("1", 4.0), ("3", 5.0)]
    assert FAULTY[row] in found.stderr
    assert found.returncode == 2


ELSEWHERE = """(problem elsewhere
  (data d (table (day y) (1 4) (2 6)))
  (data e (table (day) (2) (3)))
  (unknowns (m :init 0))
  (observe d (= y m) :sigma 0.1)
  (for-each day))"""
"""Day 3 is in a table that no equation is about: mbm has no answer to compare with."""


@needs_compiler
@pytest.mark.parametrize("target", ["c", "python"])
def test_a_data_set_without_equations_is_no_answer(target, tmp_path):
    folder = written(of_text(ELSEWHERE, target), tmp_path)
    tables = ("data/d.csv", "data/e.csv")
    if target == "c":
        assert run("make", "all", "test", "CFLAGS=-O0", folder=folder).returncode == 0
        found = run("./elsewhere", *tables, folder=folder)
    else:
        assert run(sys.executable, "test_elsewhere.py", folder=folder).returncode == 0
        found = run(sys.executable, "elsewhere.py", *tables, folder=folder)
    assert found.returncode == 1
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert [row["day"] for row in rows] == ["1", "2", "3"]
    assert [float(row["value"]) for row in rows[:2]] == pytest.approx([4.0, 6.0])
    assert [float(row["sigma"]) for row in rows[:2]] == pytest.approx([0.1, 0.1])
    assert rows[2]["sigma"] == ""


def test_the_program_ends_quietly_where_nobody_reads_on(tmp_path):
    folder = written(of_text(FREE["plain"], "python"), tmp_path)
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as output:
        found = subprocess.run(
            [sys.executable, "plain.py", "data/d.csv"],
            cwd=folder, stdout=output, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert found.returncode == 1
    assert "Traceback" not in found.stderr
    assert "BrokenPipe" not in found.stderr


CPP = """(problem class "Names that C++ has for itself."
  (data new (table (this template) (1 2) (2 3)))
  (unknowns (namespace :init 0) (operator (vector 2) :init [1 1]))
  (observe new (= template (+ namespace (* this (operator 1)))) :sigma 0.1)
  (observe (= [1 1] operator) :sigma 1) (derive (delete (+ namespace 1))))"""
MAIN_CPP = """#include <cstdio>
#include "{name}.h"

int main() {{ std::puts({name}_status_text(0)); return sizeof({name}_result) > 0 ? 0 : 1; }}
"""


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler (c++) is here")
def test_the_header_is_one_of_cpp_too(tmp_path):
    folder = written(of_text(CPP, "c"), tmp_path)
    name = "class_"
    (folder / "other.cpp").write_text(MAIN_CPP.format(name=name), encoding="utf-8")
    assert run("make", f"{name}.o", "CFLAGS=-O0", folder=folder).returncode == 0
    strict = ("-std=c++11", "-pedantic", "-Wall", "-Wextra", "-Werror")
    made = run("c++", *strict, "-o", "other", "other.cpp", f"{name}.o", "-lm", folder=folder)
    assert made.returncode == 0, made.stderr
    assert run("./other", folder=folder).stdout == "converged\n"


def test_columns_with_errors_become_casadi_functions(tmp_path):
    text = """(problem line (data d (table (u v) (0 1.0) (1 3.1) (2 4.9) (3 7.2)))
      (unknowns (a :init 0) (b :init 1))
      (observe d (= v (+ a (* b u))) :errors ((u 0.05)) :sigma 0.05))"""
    found = run(sys.executable, "test_functions.py", folder=written(of_text(text, "casadi"), tmp_path))
    assert found.returncode == 0, found.stderr


def test_quantities_without_unknowns_become_casadi_functions(tmp_path):
    text = "(problem p (constants (g 9.81)) (derive (gg (* g 2))))"
    found = run(sys.executable, "test_functions.py", folder=written(of_text(text, "casadi"), tmp_path))
    assert found.returncode == 0, found.stdout + found.stderr


def test_equations_without_rows_in_the_first_solve_are_no_rows_of_casadi_functions(tmp_path):
    text = """(problem slid (data n (table (x y) (0 0) (4 0))) (data d (table (x y) (1.5 2.5) (2.2 3.7) (6.5 8.2)))
      (unknowns (a :init 1)) (observe d (= y a) :sigma 1) (observe n (= y a) :sigma 1) (window x :length 1 :step 1))"""
    found = run(sys.executable, "test_functions.py", folder=written(of_text(text, "casadi"), tmp_path))
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize("target", ["c", "python"])
def test_columns_with_gaps_are_refused(target, tmp_path):
    (tmp_path / "gaps.csv").write_text("t,y\n0,1.0\n1,\n2,3.1\n", encoding="utf-8")
    text = """(problem gaps (data d (csv "gaps.csv")) (unknowns (a :init 0))
      (observe d (= y a) :when (finite y) :sigma 0.1))"""
    (tmp_path / "gaps.mbm").write_text(text, encoding="utf-8")
    problem = mbm.load(tmp_path / "gaps.mbm")
    with pytest.raises(MbmError) as caught:
        emitted(problem, target)
    (found,) = caught.value.diagnostics
    assert found.code.name == "not-emitted"
    assert "`y` of `d`" in found.message
