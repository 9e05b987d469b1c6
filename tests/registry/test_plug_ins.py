"""What an installed package announces as entry points, and what is said where it cannot be used."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import mbm
from mbm.api import MbmError

SOURCE = """
from mbm.data.content import BLANKS, read_text
from mbm.data.readers.fields import line_numbers, lines_of, number_columns, number_table
from mbm.data.types import RawTable, Reader
from mbm.expression.algebra import multiply, number
from mbm.language.values import Builtin
from mbm.language.vocabulary.arithmetic import elementwise


def _triple(call):
    spans = tuple(form.span for form in call.forms)
    return elementwise(lambda x: multiply(number(3), x, call.span), call.arguments, spans, call.span)


def read(path):
    text, digest = read_text(path, between=BLANKS)
    (_, names), *lines = lines_of(text, separator=";")
    numbers = number_table(lines, tuple(names), path.as_posix())
    rows = line_numbers(number for number, _ in lines)
    return RawTable(path=path.as_posix(), sha256=digest, columns=number_columns(names, numbers), file_rows=rows)


TRIPLE = Builtin("triple", "(triple x)", "Three times x.", 1, 1, _triple)
READER = Reader(name="semicolons", extensions=(".semi",), read=read)
NOTHING = 1
"""
ANNOUNCED = """
[mbm.functions]
triple = extra:TRIPLE
sqrt = extra:TRIPLE
absent = extra_absent:X
nothing = extra:NOTHING
[mbm.readers]
semicolons = extra:READER
csv = extra:READER
gone = extra:missing
"""

Problem = Callable[..., mbm.Problem]


@pytest.fixture
def problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Problem:
    """``problem(data, equation)`` with the package installed."""
    info = tmp_path / "site" / "extra_package-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: extra-package\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(ANNOUNCED, "utf-8")
    (info.parent / "extra.py").write_text(SOURCE, "utf-8")
    monkeypatch.syspath_prepend(info.parent)
    monkeypatch.delitem(sys.modules, "extra", raising=False)
    (tmp_path / "t.semi").write_text("x;y\n1;6\n2;12\n", "utf-8")
    (tmp_path / "t.csv").write_text("x,y\n1,6\n2,12\n", "utf-8")

    def made(data: str, equation: str) -> mbm.Problem:
        text = f"(problem p (data d {data}) (unknowns (a :init 1)) (observe d (= y {equation}) :sigma 1))"
        return mbm.loads(text, base=tmp_path)

    return made


def fault(made: mbm.Problem) -> str:
    with pytest.raises(MbmError) as caught:
        made.solve()
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "broken-plug-in"
    assert "extra-package" in diagnostic.message
    assert diagnostic.hint is not None
    assert "extra-package" in diagnostic.hint
    return diagnostic.message


def test_a_function_and_a_reader(problem: Problem) -> None:
    """y = 6 x = 3 a x."""
    assert problem('(semicolons "t.semi")', "(triple (* a x))").solve()["a"].value == pytest.approx(2, rel=1e-12)


def test_the_ending_of_a_file_given_in_place_of_another(problem: Problem, tmp_path: Path) -> None:
    file = tmp_path / "p.mbm"
    file.write_text(
        '(problem p (data d (csv "t.csv")) (unknowns (a :init 1)) (observe d (= y (* a x)) :sigma 1))', "utf-8"
    )
    command = [sys.executable, "-m", "mbm", "solve", "p.mbm", "--data", "d=t.semi", "-q"]
    path = str(tmp_path / "site")
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": path, "MBM_CACHE": "off"}, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_a_function_stands_for_itself(problem: Problem) -> None:
    made = problem('(csv "t.csv")', "(reduce + (map triple (list (* a x) 0)))")
    assert made.solve()["a"].value == pytest.approx(2, rel=1e-12)


def test_names_of_mbm_stay_its_own(problem: Problem) -> None:
    """y = 6 x = √(a x²), with the square root and the format of mbm."""
    assert problem('(csv "t.csv")', "(sqrt (* a (^ x 2)))").solve()["a"].value == pytest.approx(36, rel=1e-6)


def test_the_number_of_arguments_is_checked(problem: Problem) -> None:
    with pytest.raises(MbmError, match="wrong-arity"):
        problem('(csv "t.csv")', "(triple a x)").solve()


@pytest.mark.parametrize(
    ("data", "equation", "reason"),
    [
        ('(csv "t.csv")', "(absent a)", "`absent` of the package `extra-package` cannot be used: ModuleNotFoundError"),
        ('(csv "t.csv")', "(nothing a)", "it is of the type int, and no function of the language"),
        ('(gone "t.csv")', "(* a x)", "`gone` of the package `extra-package` cannot be used: AttributeError"),
    ],
)
def test_a_broken_package_is_named(problem: Problem, data: str, equation: str, reason: str) -> None:
    assert reason in fault(problem(data, equation))


def test_a_broken_closed_form_is_named(problem: Problem, tmp_path: Path) -> None:
    (tmp_path / "site" / "extra_package-1.0.dist-info" / "entry_points.txt").write_text(
        "[mbm.closed_forms]\nbroken = extra:NOTHING\n", "utf-8"
    )
    made = problem('(csv "t.csv")', "(* a x)")
    with pytest.raises(MbmError, match="broken-plug-in: `broken` of the package `extra-package` cannot be used"):
        made.solve(method="closed-form")
