"""Faults whose files are made here: too large to keep, or not made of a file alone."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import mbm
from mbm.cli.main import run


def checked(tmp_path: Path, capfd: pytest.CaptureFixture[str], text: str) -> tuple[int, str]:
    file = tmp_path / "made.mbm"
    file.write_text(text, "utf-8")
    status = run(["check", str(file)])
    return status, capfd.readouterr().err


@pytest.mark.parametrize("bracket", ["(", "[", "'"])
def test_twenty_thousand_nested_brackets(bracket: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    closing = {"(": ")", "[": "]", "'": "x"}[bracket]
    status, said = checked(tmp_path, capfd, "(problem p\n" + bracket * 20_000 + closing * 20_000 + ")\n")
    assert status == 2
    assert "error[too-deeply-nested]: brackets and quotes are nested more than" in said
    assert "made.mbm:2:" in said
    assert "by `let` or `defun`" in said


def test_a_text_larger_than_any_problem(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    status, said = checked(tmp_path, capfd, "; " + "x" * (17 * 2**20) + "\n")
    assert status == 2
    assert "error[text-too-large]" in said
    assert "keep measurements in data files" in said


def test_files_that_are_larger_than_any_problem_together(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        used = f'(use "{number + 1}.mbm")\n' if number < 2 else ""
        (tmp_path / f"{number}.mbm").write_text(used + "; " + "x" * (2**21 - 100) + "\n", "utf-8")
    status, said = checked(tmp_path, capfd, '(use "0.mbm")\n')
    assert status == 2
    assert "error[text-too-large]: with this file, the problem and what it uses are larger than 4 MiB" in said
    assert "2.mbm:1" in said


@pytest.mark.parametrize(
    "form",
    ["(doubled 40 1)", "`(a ,(doubled 40 1))", "(doubled 40 [1 2])", "(grown 40 'x)", "(grown 40 y)", "(grown 4000 y)"],
)
def test_a_form_whose_parts_are_shared_is_not_printed_without_end(
    form: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Written out, each is 2⁴⁰ words and more; what is kept of it are 40 lists."""
    file = tmp_path / "bomb.mbm"
    file.write_text(
        "(defun doubled (n x) (if (= n 0) x (let ((y (doubled (- n 1) x))) (list y y))))\n"
        "(defun grown (n x) (if (= n 0) x (let ((y (grown (- n 1) x))) `(+ ,y ,y))))\n(defconst y 2)\n",
        "utf-8",
    )
    status = run(["expand", str(file), form])
    said = capfd.readouterr()
    assert status == 2
    assert said.out == ""
    assert "error[too-long-to-print]" in said.err or "error[too-many" in said.err or "error[too-deep" in said.err
    assert run(["expand", str(file), form.replace("4000", "3").replace("40", "3")]) == 0


def test_an_unknown_backend_is_named_with_those_there_are() -> None:
    problem = mbm.loads("(problem p (unknowns (a :init 1)) (observe o (= 1 a) :sigma 1))")
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(backend="numpi")
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "unknown-backend"
    assert "`numpy`" in (diagnostic.hint or "")


def test_machine_code_asked_for_where_none_can_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = mbm.loads("(problem p (unknowns (a :init 1)) (observe o (= 1 a) :sigma 1))")
    for name in [n for n in sys.modules if n.split(".")[0] == "llvmlite"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(backend="native")
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "native-unavailable"
    assert "install llvmlite" in (diagnostic.hint or "")
    # What was not asked for is taken only where it is there.
    assert problem.solve(backend="auto").status == "ok"


def test_a_long_let_nests_scopes_without_python_recursion(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    names = " ".join(f"(x{i} (+ x{i - 1} 1))" for i in range(1, 3001))
    text = f"(problem p (unknowns (a :init 1))\n (observe o (let* ((x0 a) {names}) (= 3001 x3000))))"
    status, said = checked(tmp_path, capfd, text)
    assert (status, said) == (0, "")


def test_a_misspelt_name_below_a_long_let_still_gets_its_answer(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    names = " ".join(f"(x{i} {i})" for i in range(2000))
    text = f"(problem p (unknowns (alpha :init 1))\n (observe o (let* ({names}) (= 3 alhpa))))"
    status, said = checked(tmp_path, capfd, text)
    assert status == 2
    assert "did you mean `alpha`?" in said


RUNAWAYS = {
    "a function of lists that doubles": "(defun g (l n) (if (= n 0) l (g (append l l) (- n 1))))",
    "a quoted form that doubles": "(defun g (f n) (if (= n 0) f (g `(+ ,f ,f) (- n 1))))",
    "quoted lists spliced into one another": "(defun g (l n) (if (= n 0) l (g `(,@l ,@l) (- n 1))))",
    "a function that calls itself twice": "(defun g (l n) (+ (length (g l (+ n 1))) (length (g l (+ n 1)))))",
    "a macro that expands to itself": "(defmacro g (l n) `(g ,l ,n))",
    "a power of powers": "(defun g (l n) (if (= n 0) 1 (* (g l (- n 1)) (g l (- n 1)))))",
    "sums of vectors": "(defun g (l n) (sum (i 1 50000) (range 1 50000)))",
    "branches of vectors": ("(defun g (l n) (sum (i 1 50000) ((if (> (l 1) 0) (range 1 50000) (range 1 50000)) 1)))"),
    "rows of a large matrix": "(defun g (l n) (let ((m (identity 300))) (sum (i 1 45000) (sum (j 1 9) (m 7 j)))))",
    "a fold over pairs of lists": "(defun g (l n) (reduce append (map (lambda (i) (range 1 1000)) (range 1 1000))))",
}


@pytest.mark.parametrize("definition", RUNAWAYS.values(), ids=RUNAWAYS)
def test_runaways_end_with_an_error_at_a_form(
    definition: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = f"{definition}\n(problem p (unknowns (a :init 1)) (observe o (= 1 (g (list a a) 60))))"
    status, said = checked(tmp_path, capfd, text)
    assert status == 2
    assert any(f"error[{code}]" in said for code in ("too-many-steps", "too-deep", "list-too-long")), said
    assert "made.mbm:1:" in said


@pytest.mark.parametrize(
    "form",
    [
        "(sum (i 1 7500) (* a i))",
        "(reduce + (map (lambda (i) (* a i)) (range 1 7500)))",
        "(dot (map (lambda (i) (* a i)) (range 1 5000)) (range 1 5000))",
    ],
)
def test_honest_long_work_stays_within_the_limits(form: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = f"(problem p (unknowns (a :init 1)) (observe o (= 1 {form})))"
    assert checked(tmp_path, capfd, text) == (0, "")


def test_a_document_that_cannot_be_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "made.mbm"
    file.write_text("(problem p (unknowns (a :init 1)) (observe o (= 1 a) :sigma 1))")
    assert run(["solve", str(file), "--json", str(tmp_path / "nowhere" / "out.json")]) == 2
    said = capfd.readouterr().err
    assert "error[not-writable]" in said
    assert "its folder does not exist" in said
