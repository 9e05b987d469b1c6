"""Functions in Python that a problem calls: when they run, what they are given, and what happens where they fail."""

from __future__ import annotations

import json
import sys
import textwrap
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import mbm

ROWS = {"x": np.arange(5.0), "y": np.array([5.1, 3.0, 1.9, 1.05, 0.72])}
FORMULA = "(* a (exp (* -1 b x)))"
PROBLEM = """(problem p (data d external) (unknowns (a :init 4) (b :init 0.3))
  (observe d (= y {call}) :sigma 0.1) (derive (q (* a {call_at_2})) ) {more})"""
MODULE = """
import math
import numpy as np

def curve(a, b, x):
    return a * math.exp(-b * x)

def curves(a, b, x):
    return a * np.exp(-b * x)

def slopes(a, b, x):
    e = np.exp(-b * x)
    return np.stack([e, -a * x * e, -a * b * e], axis=-1)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder whose modules are forgotten at the end."""
    before = dict(sys.modules)
    (tmp_path / "curves.py").write_text(MODULE)
    yield tmp_path
    for name in set(sys.modules) - set(before):
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


def problem(call: str, folder: Path, more: str = "") -> mbm.Problem:
    """``{x}`` in the call stands for the column, or for 2."""
    text = PROBLEM.format(call=call.format(x="x"), call_at_2=call.format(x="2"), more=more)
    return mbm.loads(text, base=folder)


def external(name: str, options: str = "") -> str:
    return f'(external "{name}" a b {{x}} :size 1 {options})'


CALLS = {
    "differenced": external("curves:curve"),
    "all rows": external("curves:curves", ":batch true"),
    "a Jacobian": external("curves:curve", ':jacobian "curves:slopes"'),
    "both": external("curves:curves", ':jacobian "curves:slopes" :batch true'),
}


def solved(call: str, folder: Path, **options: object) -> mbm.Solved:
    return problem(call, folder).solve(data={"d": ROWS}, allow_external=True, **options)


def codes(error: pytest.ExceptionInfo[mbm.MbmError]) -> list[str]:
    return [d.code.name for d in error.value.diagnostics]


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
@pytest.mark.parametrize("way", CALLS)
def test_answers_are_those_of_the_formula(way: str, backend: str, folder: Path) -> None:
    """Differences leave 1e-10 of a derivative; what is compared is a solve, whose digits they carry on."""
    found, wanted = solved(CALLS[way], folder, backend=backend), solved(FORMULA.replace("x))", "{x}))"), folder)
    for name in ("a", "b", "q"):
        assert found[name].value == pytest.approx(wanted[name].value, rel=1e-9)
        assert found[name].sigma == pytest.approx(wanted[name].sigma, rel=1e-9)
    assert found.first.cost == pytest.approx(wanted.first.cost, rel=1e-9)
    assert found.result.diagnostics == ()


def test_nothing_is_imported_before_it_is_allowed(folder: Path) -> None:
    (folder / "loud.py").write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n" + MODULE)
    asked = problem(external("loud:curve"), folder)
    for _ in range(2):  # the second time, equations and kernels come from the cache
        for call in (asked.solve, asked.compile, asked.simulate):
            with pytest.raises(mbm.MbmError) as refused:
                call(data={"d": ROWS})
            assert codes(refused) == ["external-not-allowed"]
        (warning,) = asked.check(data={"d": ROWS})
        assert (warning.code.name, warning.severity) == ("external-not-allowed", "warning")
        asked.equations(data={"d": ROWS})
        asked = problem(external("loud:curve"), folder)
    assert not (folder / "ran").exists()
    asked.solve(data={"d": ROWS}, allow_external=True)
    assert (folder / "ran").exists()
    assert not (folder / "__pycache__").exists()


def test_permission_is_not_kept(folder: Path) -> None:
    """What was allowed once is in the cache as names; the next call is asked for its own permission."""
    assert solved(CALLS["differenced"], folder).status == "ok"
    with pytest.raises(mbm.MbmError) as refused:
        problem(CALLS["differenced"], folder).solve(data={"d": ROWS})
    assert codes(refused) == ["external-not-allowed"]


def test_a_compiled_problem_keeps_its_permission(folder: Path) -> None:
    compiled = problem(CALLS["both"], folder).compile(data={"d": ROWS}, allow_external=True)
    again = compiled.solve(data={"d": {**ROWS, "y": ROWS["y"] * 2}})
    assert again["a"].value == pytest.approx(2 * compiled.solve()["a"].value, rel=1e-4)  # the noise does not double


def test_the_folder_of_the_problem_comes_first_and_modules_stay_apart(tmp_path: Path, folder: Path) -> None:
    """Two problems with modules of one name; and one that is called as a module of Python."""
    for name, factor in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rates.py").write_text(f"def of(a, b, x):\n    return {factor} * a\n")
    (tmp_path / "two" / "json.py").write_text("def of(a, b, x):\n    return 5 * a\n")
    found = []
    for place, module in (("one", "rates"), ("two", "rates"), ("one", "rates"), ("two", "json")):
        text = f'(problem p (unknowns (a :init 1)) (observe (= 10 (external "{module}:of" a 1 1 :size 1)) :sigma 1))'
        found.append(mbm.loads(text, base=tmp_path / place).solve(allow_external=True)["a"].value)
    assert found == pytest.approx([10, 5, 10, 2], rel=1e-12)
    assert json.loads("1") == 1
    assert sys.modules["json"].__file__ == json.__file__
    assert str(tmp_path / "one") not in sys.path


def test_modules_of_packages_and_attributes(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "__init__.py").write_text("")
    (tmp_path / "lab" / "tools.py").write_text("from .rates import Rates\n")
    (tmp_path / "lab" / "rates.py").write_text(
        "class Rates:\n    @staticmethod\n    def twice(v):\n        return 2 * v\n"
    )
    text = """(problem p (unknowns (v (vector 2) :init [0 0]))
      (observe (= [2 3] (external "lab.tools:Rates.twice" v :size 2)) :sigma 1))"""
    assert mbm.loads(text, base=tmp_path).solve(allow_external=True)["v"].value == pytest.approx([1, 1.5], rel=1e-12)


def test_what_a_function_is_given(folder: Path) -> None:
    """Floats in SI, vectors, matrices row by row, rotations as matrices; of poses an error says what to give."""
    (folder / "seen.py").write_text(
        "seen = []\ndef look(*given):\n    seen.append(given)\n    return float(given[0])\n"
    )
    text = """(problem p (unknowns (a :init 250mm) (R (rotation 3) :init (rot-z 90deg) :fixed true))
      (observe (= 1m (external "seen:look" a [a 2] [[1 2 3] [4 5 6]] R 30deg :size 1)) :sigma 1mm))"""
    assert mbm.loads(text, base=folder).solve(allow_external=True)["a"].value == pytest.approx(1.0, rel=1e-9)
    number, vector, matrix, rotation, angle = sys.modules["seen"].seen[0]
    assert (type(number), number) == (float, 0.25)
    assert vector.tolist() == [0.25, 2.0]
    assert matrix.tolist() == [[1, 2, 3], [4, 5, 6]]
    np.testing.assert_allclose(rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert angle == pytest.approx(np.pi / 6, rel=1e-15)
    with pytest.raises(mbm.MbmError, match="give its rotation and its translation"):
        mbm.loads(text.replace("[a 2]", "(pose2 1 2 3)"), base=folder).solve(allow_external=True)


def test_a_table_cannot_name_a_function(folder: Path) -> None:
    text = """(problem p (data d (table (name y) ("curves:curve" 1))) (unknowns (a))
      (observe d (= y (external name a 1 1 :size 1)) :sigma 1))"""
    with pytest.raises(mbm.MbmError) as refused:
        mbm.loads(text, base=folder).solve(allow_external=True)
    assert codes(refused) == ["wrong-kind"]


BODIES = {
    "raise ValueError('too hot')": r"raised ValueError: too hot \(hostile.py:2\)",
    "raise SystemExit(3)": r"raised SystemExit: 3 \(hostile.py:2\)",
    "return [1.0, 2.0]": r"gave an array of shape \(2,\), where \(1,\) is wanted",
    "return []": r"gave an array of shape \(0,\), where \(1,\) is wanted",
    "return None": "gave no real numbers, but a value of the type `NoneType`",
    "return '3'": "gave no real numbers, but a value of the type `str`",
    "return 1j": "gave no real numbers, but a value of the type `complex`",
    "return [[1], [2, 3]]": "raised ValueError",
    "x[0] = 1": "raised ValueError: assignment destination is read-only",
    "return f(x)": "raised RecursionError",
}


@pytest.mark.parametrize("body", BODIES)
def test_a_function_that_fails(body: str, folder: Path) -> None:
    (folder / "hostile.py").write_text(f"def f(x):\n    {body}\n")
    text = """(problem p (unknowns (v (vector 1) :init [1]))
      (observe (= 3 (external "hostile:f" v :size 1)) :sigma 1))"""
    with pytest.raises(mbm.MbmError, match=BODIES[body]) as failed:
        mbm.loads(text, base=folder).solve(allow_external=True)
    (diagnostic,) = failed.value.diagnostics
    assert diagnostic.code.name == "external-failed"
    assert diagnostic.place.text.startswith('(external "hostile:f"')
    assert diagnostic.hint == "called with [1.]"


def test_a_module_that_fails(folder: Path) -> None:
    (folder / "broken.py").write_text("import no_such_thing\n")
    with pytest.raises(mbm.MbmError, match=r"no_such_thing' \(broken.py:1\)") as failed:
        solved(external("broken:f"), folder)
    assert codes(failed) == ["external-not-found"]


def test_a_row_without_a_value_is_a_row_without_a_value(folder: Path) -> None:
    """As with the square root of a negative number; the function is not asked about what is not finite."""
    (folder / "gaps.py").write_text("import math\ndef f(a, x):\n    return a * math.sqrt(x) if x >= 0 else math.nan\n")
    texts = [
        f"(problem p (data d external) (unknowns (a :init 1)) (observe d (= y {call}) :sigma 1))"
        for call in ('(external "gaps:f" a x :size 1)', "(* a (sqrt x))")
    ]
    rows = {"x": np.array([1.0, -1.0, 4.0]), "y": np.array([1.0, 2.0, 2.5])}
    one, other = (mbm.loads(text, base=folder).solve(data={"d": rows}, allow_external=True) for text in texts)
    assert one.first.status == other.first.status
    assert one.first.message == other.first.message


def test_an_interruption_goes_through(folder: Path) -> None:
    (folder / "stopped.py").write_text("def f(a, b, x):\n    raise KeyboardInterrupt\n")
    with pytest.raises(KeyboardInterrupt):
        solved(external("stopped:f"), folder)


def test_a_wrong_jacobian_is_named(folder: Path) -> None:
    right = "    return np.stack([e, -a * x * e, -a * b * e], axis=-1)\n"
    assert MODULE.endswith(right)
    (folder / "slips.py").write_text(MODULE.replace(right, right.replace("-a * x", "a * x")))
    call = external("curves:curve", ':jacobian "slips:slopes"')
    checked = problem(call, folder).check(data={"d": ROWS}, allow_external=True)
    diagnostics = (*solved(call, folder).result.diagnostics, *checked)
    assert [d.code.name for d in diagnostics] == ["wrong-jacobian"] * 2
    e = np.exp(-0.3)
    assert diagnostics[0].message == (
        f"`slips:slopes` gives {4 * e:.6g} for the derivative of value 1 by argument 2, "
        f"differences of the values {-4 * e:.6g}"
    )


def test_a_kink_is_no_wrong_jacobian(folder: Path) -> None:
    """At the kink, differences with steps of two sizes do not agree: they tell nothing."""
    (folder / "kinks.py").write_text("def f(x):\n    return abs(x)**0.5\ndef slope(x):\n    return 0.0\n")
    text = """(problem p (unknowns (x :init 0))
      (observe (= 1 (+ x (external "kinks:f" x :size 1 :jacobian "kinks:slope"))) :sigma 1))"""
    assert mbm.loads(text, base=folder).check(allow_external=True) == ()


def test_threads_call_one_at_a_time_and_change_nothing(folder: Path) -> None:
    (folder / "shared.py").write_text(
        textwrap.dedent(
            """
            import math, threading
            inside, most, threads = 0, 0, set()
            def curve(a, b, x):
                global inside, most
                inside += 1
                most = max(most, inside)
                threads.add(threading.get_ident())
                found = a * math.exp(-b * x)
                inside -= 1
                return found
            """
        )
    )
    rows = {"k": np.repeat(np.arange(12), 5), "x": np.tile(ROWS["x"], 12), "y": np.tile(ROWS["y"], 12)}
    asked = problem(external("shared:curve"), folder, "(for-each k)")
    documents = [asked.solve(data={"d": rows}, allow_external=True, workers=n).document() for n in (1, 4)]
    for document in documents:
        for solve in document["solves"]:
            del solve["seconds"]
    assert documents[0] == documents[1]
    assert sys.modules["shared"].most == 1
    assert threading.active_count() < 50


@pytest.mark.parametrize("sets", [4, 12])
def test_a_function_that_fails_for_one_data_set_ends_all(sets: int, folder: Path) -> None:
    """A function that raises is a fault of the program, whichever rows show it, solved together or one by one."""
    (folder / "some.py").write_text("def f(a, k):\n    if k == 2:\n        raise ValueError('two')\n    return a\n")
    text = """(problem p (data d external) (unknowns (a :init 1)) (for-each k)
      (observe d (= y (external "some:f" a k :size 1)) :sigma 1))"""
    rows = {"k": np.repeat(np.arange(float(sets)), 3), "y": np.arange(3.0 * sets)}
    with pytest.raises(mbm.MbmError) as failed:
        mbm.loads(text, base=folder).solve(data={"d": rows}, allow_external=True)
    assert codes(failed) == ["external-failed"]


def test_simulated_measurements_are_those_of_the_formula(folder: Path) -> None:
    at = {"a": 5.0, "b": 0.5}
    one, other = (
        problem(call, folder).simulate(at=at, seed=3, data={"d": ROWS}, allow_external=True)
        for call in (CALLS["differenced"], FORMULA.replace("x))", "{x}))"))
    )
    np.testing.assert_allclose(one["d"]["y"], other["d"]["y"], rtol=1e-12)


def test_results_take_the_dimension_that_they_are_used_with(folder: Path) -> None:
    text = """(problem p (data d external :columns ((x :unit s) (y :unit mm)))
      (unknowns (a :unit mm :init 4mm) (b :init 0.3))
      (observe d (= y (external "curves:curve" a b x :size 1)) :sigma 0.1mm))"""
    found = mbm.loads(text, base=folder).solve(data={"d": ROWS}, allow_external=True)
    assert found["a"].value == pytest.approx(solved(CALLS["differenced"], folder)["a"].value, rel=1e-9)


def test_no_casadi_function_holds_a_call(folder: Path) -> None:
    compiled = problem(CALLS["differenced"], folder).compile(data={"d": ROWS}, allow_external=True)
    with pytest.raises(mbm.MbmError) as refused:
        compiled.casadi()
    assert codes(refused) == ["not-emitted"]


def test_a_function_may_keep_the_name_of_the_user(folder: Path) -> None:
    """`external` is a function of the vocabulary like others: a definition in the file shadows it."""
    text = "(defun external (x) (* 2 x)) (problem p (unknowns (a)) (observe (= 4 (external a)) :sigma 1))"
    assert mbm.loads(text, base=folder).solve()["a"].value == pytest.approx(2.0, rel=1e-12)
