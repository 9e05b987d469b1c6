"""Rows that a generated solver goes through though it reads little or nothing of them, and answers that are zero."""

from __future__ import annotations

import shutil
import sys

import pytest

from tests.emit.making import of_text, run, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

PROBLEMS = {
    "nothing of the table is read": """(problem rows
      (data d (table (x y) (0 1.1) (1 2.9) (2 5.1)))
      (unknowns (a :init 1))
      (observe d (= 1 a) :sigma 0.2))""",
    "a table is counted for what is derived": """(problem rows
      (data d (table (x) (1) (2)))
      (data e (table (y) (1.1) (2.2)))
      (unknowns (a :init 1))
      (observe e (= y a) :sigma 0.1)
      (derive (g (* a row) :over d)))""",
    "what is read stands in another row": """(problem rows
      (data arrow (table (x y) (0 1.1) (1 2.9) (2 5.1)))
      (data d (table (y) (0) (1)) :where (> y -1))
      (unknowns (a :init 1))
      (observe d (= (last arrow y) a) :sigma 0.2)
      (derive (g (* a 2) :over d)))""",
    "one prior for each distinct value": """(problem rows
      (data t (table (id w) ("a" 1) ("b" 2)) :key id)
      (data d (table (who x y) ("b" -1 7) ("a" 1 2) ("b" 2 4) ("a" 3 5) ("b" 4 8.5)) :with (t who) :where (> x 0))
      (unknowns (a :init 1) (w :per d.who :init 0.1 :sigma 0.3))
      (observe d (= y (+ (* a x t.w) (w who))) :sigma 1))""",
    "a constraint makes an estimate zero": """(problem rows
      (data t (table (id) ("a") ("b")) :key id)
      (data d (table (who x y) ("a" 1 10.1) ("b" 1 19) ("a" 2 20.3) ("b" 2 41)))
      (unknowns (a :init 1) (f :per t :init 0.1))
      (observe d (= y (+ (* a x) (f who))) :sigma 0.2)
      (constraints (= (f "a") 0)))""",
}


@needs_compiler
@pytest.mark.parametrize("name", PROBLEMS)
def test_c_gives_what_solve_gives(name, tmp_path):
    folder = written(of_text(PROBLEMS[name], "c"), tmp_path)
    made = run("make", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    assert any(line.startswith("0 of ") for line in made.stdout.splitlines()), made.stdout


@pytest.mark.parametrize(("target", "test"), [("python", "test_rows.py"), ("casadi", "test_functions.py")])
@pytest.mark.parametrize("name", PROBLEMS)
def test_python_and_casadi_give_what_solve_gives(name, target, test, tmp_path):
    folder = written(of_text(PROBLEMS[name], target), tmp_path)
    found = run(sys.executable, test, folder=folder)
    assert found.returncode == 0, found.stdout + found.stderr
