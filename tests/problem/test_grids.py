"""Derived quantities ``:over (grid t a b n)``: values and bands as linear algebra has them, in every kind of solve."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm
from mbm.api.files import emit_file
from mbm.report.options import SolveOptions

T = np.array([0.0, 1.0, 2.0, 3.0, 5.0])
Y = np.array([1.1, 2.9, 5.2, 7.1, 10.8])
HEAD = """
(problem p
  (constants (end 4s))
  (data d external :columns ((t :unit s) (y :unit m)))
  (unknowns (a) (b))
  (observe d (= y (+ a (* b t))) :sigma 0.1m)
  {more})
"""
EACH = "(derive (f (+ a (* b t)) :over (grid t 0s (* 2 end) 5)))"


def solved(more, data=None, **given):
    return mbm.loads(HEAD.format(more=more)).solve(data=data or {"d": {"t": T, "y": Y}}, **given)


def line(times, at, sigma=0.1, y=Y):
    """Value and standard deviation of a fitted line at other times."""
    matrix = np.column_stack([np.ones(len(times)), times])
    inverse = np.linalg.inv(matrix.T @ matrix)
    rows = np.column_stack([np.ones(len(at)), at])
    return rows @ (inverse @ matrix.T @ y), sigma * np.sqrt(np.einsum("ij,jk,ik->i", rows, inverse, rows))


def codes(text):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve(data={"d": {"t": T, "y": Y}})
    return [(each.code.name, each.message) for each in caught.value.diagnostics]


def test_values_and_bands_are_those_of_linear_algebra():
    at = np.linspace(0, 8, 5)
    value, sigma = line(T, at)
    f = solved(EACH)["f"]
    # the same floating-point problem by another route: a few roundings of numbers near 20
    np.testing.assert_allclose(f.value, value, rtol=1e-12)
    np.testing.assert_allclose(f.sigma, sigma, rtol=1e-9)
    assert f.keys == (0.0, 2.0, 4.0, 6.0, 8.0)
    np.testing.assert_allclose(
        f.interval(0.95), np.stack([value, value], 1) + 1.959964 * sigma[:, None] * [-1, 1], rtol=1e-6
    )


def test_the_document_has_the_values_of_the_variable_in_their_unit():
    more = "(derive (f (+ a (* b u)) :over (grid u -30s 0.1min 3)))"
    found = json.loads(solved(more).to_json())["solves"][0]["derived"]["f"]
    assert found["over"] == "u"
    np.testing.assert_allclose(found["keys"], [-0.5, -0.2, 0.1], rtol=1e-15)
    np.testing.assert_allclose(found["value"], line(T, np.array([-30, -12, 6]))[0], rtol=1e-12)
    assert len(found["interval"]) == len(found["sigma"]) == 3
    assert found["unit"] == "m"


def test_over_last_in_the_clause_holds_for_all_entries_that_have_none():
    more = "(derive (f (+ a (* b t))) (g (* 2 f)) (h (* b 1s) :over d) :over (grid t 0s 1s 2))"
    found = solved(more)
    np.testing.assert_allclose(found["g"].value, 2 * np.asarray(found["f"].value), rtol=1e-15)
    assert found["g"].keys == (0.0, 1.0)
    assert len(found["h"].value) == len(T)


def test_constants_move_the_ends():
    found = mbm.loads(HEAD.format(more=EACH))
    at = found.solve(data={"d": {"t": T, "y": Y}}, constants={"end": "1s"})["f"].keys
    np.testing.assert_allclose(at, [0, 0.5, 1, 1.5, 2])


def test_other_data_are_derived_at_the_same_values():
    compiled = mbm.loads(HEAD.format(more=EACH)).compile(data={"d": {"t": T, "y": Y}})
    for times, y in ((T, Y), (T[:3], Y[:3]), (T + 1, Y)):
        value, sigma = line(times, np.linspace(0, 8, 5), y=y)
        f = compiled.solve(data={"d": {"t": times, "y": y}})["f"]
        np.testing.assert_allclose(f.value, value, rtol=1e-11)
        np.testing.assert_allclose(f.sigma, sigma, rtol=1e-9)


@pytest.mark.parametrize("clause", ["(for-each t)", "(window t :length 1s :step 1s)"])
def test_keys_and_windows_over_a_column_of_that_name_take_no_rows_of_the_grid(clause):
    """One problem for each time of the data, and all values of the grid in each: a mean has one row."""
    text = """(problem p (data d external :columns ((t :unit s))) (unknowns (a))
      (observe d (= y a) :sigma 0.1) (derive (f (* a (/ t 1s)) :over (grid t 0s 10s 3))) {})"""
    found = mbm.loads(text.format(clause)).solve(data={"d": {"t": T[:4], "y": Y[:4]}})
    assert [dict(each.key) for each in found.solves] == [{"t": t} for t in T[:4]]
    for each, y in zip(found.solves, Y, strict=False):
        np.testing.assert_allclose(each.derived[0].value, [0, 5 * y, 10 * y], atol=1e-12)


def test_a_table_called_grid_is_a_table():
    text = """(problem p (data grid external) (unknowns (a)) (observe grid (= y a) :sigma 0.1)
      (derive (f (* a t) :over grid) (g (* a t) :over (grid t 0 1 2))))"""
    found = mbm.loads(text).solve(data={"grid": {"t": T, "y": Y}})
    assert found["f"].keys == (1.0, 2.0, 3.0, 4.0, 5.0)
    assert found["g"].keys == (0.0, 1.0)


@pytest.mark.parametrize("mine", ["(defun grid (t a b n) a)", "(defmodel grid (t a b n) (vertexes (1 (t a b))))"])
def test_a_definition_of_the_user_called_grid_wins(mine):
    found = codes(mine + HEAD.format(more="(derive (f a :over (grid t 0s 1s 2)))"))
    assert [code for code, _ in found] == ["bad-form"]
    assert "yours" in found[0][1]


@pytest.mark.parametrize(
    ("grid", "code", "message"),
    [
        ("(grid t 0s 10s)", "bad-form", "takes a variable"),
        ("(grid 0s 10s 5)", "bad-form", "takes a variable"),
        ("(grid t 0s 10s 1)", "bad-form", "from 2 to 100,000"),
        ("(grid t 0s 10s 1e9)", "bad-form", "from 2 to 100,000"),
        ("(grid t 0s 10s 2.5)", "wrong-kind", "a whole number"),
        ("(grid t 1s 1s 5)", "bad-form", "different numbers"),
        ("(grid t 1s (+ 1s 1e-15s) 50)", "bad-form", "different numbers"),
        ("(grid t -1.7e308 1.7e308 5)", "bad-form", "different numbers"),
        ("(grid t 0s (exp 1000) 5)", "undefined-value", "finite"),
        ("(grid t 0s a 5)", "depends-on-unknown", "an end of a grid"),
        ("(grid t 0s (last d t) 5)", "bad-form", "other data"),
        ("(grid t 0m 10s 5)", "unit-clash", "does not go with"),
        ("(grid t 0m 10m 5)", "unit-clash", "does not go with"),
        ("(grid a 0m 10m 5)", "ambiguous-name", "`a`"),
        ("grid", "unknown-table", "`grid` is no table"),
    ],
)
def test_what_is_no_grid(grid, code, message):
    found = codes(HEAD.format(more=f"(derive (f (+ a (* b t)) :over {grid}))"))
    assert code in [each for each, _ in found]
    assert any(message in each for _, each in found)


def test_an_uncertain_constant_is_no_end():
    text = """(problem p (constants (end 4 :sigma 1)) (data d external) (unknowns (a)) (observe d (= y a) :sigma 0.1)
      (derive (f (* a t) :over (grid t 0 end 2))))"""
    assert codes(text) == [("bad-form", "an end of a grid is an exact number, and `end` has a standard deviation")]


def test_steps_of_states_are_no_variable_of_a_grid():
    text = """(problem p (data d external) (states :over t (x :init 0 :sigma 1)) (dynamics (random-walk x :sigma 1))
      (observe d (= y x) :sigma 0.1) (derive (f {} :over (grid {} 0 1 2))))"""
    assert codes(text.format("(* t x)", "t"))[0][0] == "bad-form"
    assert codes(text.format("(* u x)", "u"))[0][0] == "state-without-step"


def test_over_of_the_clause_stands_last():
    assert codes(HEAD.format(more="(derive :over (grid t 0s 1s 2) (f (+ a (* b t))))"))[0][0] == "bad-form"


def test_interval_methods_bound_it():
    text = """(problem p (data d external) (unknowns (a :in (0 20))) (observe d (= y a) :bound 5)
      (derive (f (* a t) :over (grid t 1 3 3))) (solve :method (interval)))"""
    f = mbm.loads(text).solve(data={"d": {"t": T, "y": Y}}).first.derived[0]
    low, high = max(Y) - 5, min(Y) + 5
    np.testing.assert_allclose(f.bounds, [[low * t, high * t] for t in (1, 2, 3)], rtol=1e-9)
    assert f.keys == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
def test_generated_solvers_refuse_it(target, tmp_path):
    text = HEAD.format(more=EACH).replace("external", '(csv "d.csv")')
    (tmp_path / "p.mbm").write_text(text)
    (tmp_path / "d.csv").write_text("t,y\n" + "".join(f"{t},{y}\n" for t, y in zip(T, Y, strict=True)))
    with pytest.raises(mbm.MbmError, match="not-emitted") as caught:
        emit_file(tmp_path / "p.mbm", SolveOptions(), target)
    assert caught.value.diagnostics[0].hint == "put the values of `t` into a table, and derive `:over` that"
