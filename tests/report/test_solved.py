"""What solved problems say about themselves: names, bounds, starts, reasons, options. Each was once said wrongly."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import mbm
from mbm.report.correlations import LARGEST_COVARIANCE

TWO_MINIMA = """
(problem p
  (data t (table (k y) ("x" 4) ("z" 4)) :key k)
  (unknowns (a :per t :init 1))
  (observe t (= y (^ (a k) 2)) :sigma 0.1))
"""
"""Each member has the minima −2 and 2; the start decides."""


def held_problem(kind: str = "") -> mbm.Solved:
    """`a` wants to be −1.5 and may not; `b` is 2 ± 1."""
    text = f"(problem p (unknowns (a {kind}) (b)) (observe o (= -1.5 a) (= 2 b) :sigma 1))"
    return mbm.loads(text).solve()


def codes(solved: mbm.Solved) -> list[str]:
    return [d.code.name for d in solved.first.diagnostics]


@pytest.mark.parametrize(("kind", "value"), [(":in (0 5) :init 1", 0.0), ("positive :init 1", 0.0)])
def test_what_is_held_at_its_bound_has_no_sigma_anywhere(kind: str, value: float) -> None:
    solved = held_problem(kind)
    assert solved["a"].value == pytest.approx(value, abs=1e-9)  # a positive number stays a little above zero
    assert math.isnan(float(solved["a"].sigma))
    assert solved["b"].sigma == pytest.approx(1.0, rel=1e-12)
    written = solved.document()["solves"][0]
    assert written["estimates"]["a"]["sigma"] is None
    assert written["estimates"]["a"]["reason"] == "held at its bound"
    assert written["covariance"]["matrix"] == [[None, None], [None, pytest.approx(1.0, rel=1e-12)]]
    assert "held at its bound" in str(solved)
    assert codes(solved) == ["near-bound"]
    assert [d["code"] for d in written["diagnostics"]] == ["near-bound"]


def test_the_side_of_the_bound_is_said() -> None:
    assert "`a` is held at its lower bound" in held_problem(":in (0 5) :init 1").first.diagnostics[0].message
    assert "`a` is driven to zero" in held_problem("positive :init 1").first.diagnostics[0].message
    assert "`a` is held at its upper bound" in held_problem(":in (-5 -2) :init -3").first.diagnostics[0].message
    assert codes(held_problem(":in (-5 5) :init 1")) == []


def test_starts_go_to_the_members_that_their_keys_name() -> None:
    problem = mbm.loads(TWO_MINIMA)
    solved = problem.solve(init={"a": {"keys": ["z", "x"], "value": [3, -3]}})
    np.testing.assert_allclose(solved["a"].value, [-2, 2], rtol=1e-9)
    one = problem.solve(init={"a": {"keys": ["z"], "value": [-3]}})
    np.testing.assert_allclose(one["a"].value, [2, -2], rtol=1e-9)


def test_a_null_in_a_document_takes_no_start_from_the_others() -> None:
    document = {"solves": [{"key": {}, "estimates": {"a": {"keys": ["z", "x", "w"], "value": [-3, None, 1]}}}]}
    np.testing.assert_allclose(mbm.loads(TWO_MINIMA).solve(init=document)["a"].value, [2, -2], rtol=1e-9)


def test_starts_of_each_solve_go_to_the_members_it_has() -> None:
    """Epoch 2 meets the members in the other order, and one that epoch 1 does not have."""
    text = """
    (problem p
      (data t (table (e k y) (1 "x" 4) (1 "z" 4) (2 "z" 4) (2 "u" 4) (2 "x" 4)))
      (unknowns (a :per t.k :init 1))
      (for-each e)
      (observe t (= y (^ (a k) 2)) :sigma 0.1))
    """
    solved = mbm.loads(text).solve(init={"a": {"keys": ["x", "u"], "value": [-3, -3]}})
    first, second = (dict(zip(s.estimates[0].keys or (), s.estimates[0].value, strict=True)) for s in solved.solves)
    assert first == pytest.approx({"x": -2, "z": 2}, rel=1e-9)
    assert second == pytest.approx({"z": 2, "u": -2, "x": -2}, rel=1e-9)


@pytest.mark.parametrize(
    ("init", "words"),
    [
        ({"a": {"keys": ["y"], "value": [1]}}, 'a member "y", which it does not have'),
        ({"a": {"keys": ["x"], "value": [[1, 2]]}}, "another shape"),
        ({"b": 1}, "no unknown"),
    ],
)
def test_starts_that_fit_nothing_are_refused(init: dict[str, object], words: str) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(TWO_MINIMA).solve(init=init)
    assert caught.value.diagnostics[0].code.name == "bad-initial-values"
    assert words in caught.value.diagnostics[0].message


def test_units_of_starts_are_those_of_the_unknown() -> None:
    problem = mbm.loads("(problem p (unknowns (a :init 1m :unit mm)) (observe (= 4 (/ (* a a) 1m^2)) :sigma 1))")
    assert problem.solve(init={"a": {"value": -3, "unit": "m"}})["a"].value == pytest.approx(-2000, rel=1e-6)
    for unit, words in (("s", "a time"), ("furlong", "no unit")):
        with pytest.raises(mbm.MbmError) as caught:
            problem.solve(init={"a": {"value": 3, "unit": unit}})
        assert caught.value.diagnostics[0].code.name == "bad-initial-values"
        assert words in caught.value.diagnostics[0].message


def test_names_tell_large_keys_and_odd_texts_apart() -> None:
    text = r"""
    (problem p
      (data t (table (k n y) ("a\"b" 1234567 1) ("a\\b" 1234568 2) ("c" 0.1 3)))
      (unknowns (a :per t.n) (b :per t.k))
      (observe t (= y (a n)) (= y (b k)) :sigma 1)
      (derive (c (+ (a n) (b k)) :over t)))
    """
    solved = mbm.loads(text).solve()
    wanted = ("a[1234567]", "a[1234568]", "a[0.1]", 'b["a\\"b"]', 'b["a\\\\b"]', 'b["c"]')
    assert solved.covariance is not None
    assert solved.covariance.names == wanted
    frame = solved.table()
    columns = list(frame.columns) if hasattr(frame, "columns") else list(frame)
    assert set(wanted) <= set(columns)
    assert solved.document()["solves"][0]["derived_covariance"]["names"] == ["c[1]", "c[2]", "c[3]"]


def test_free_combinations_have_the_names_of_the_covariance() -> None:
    text = """
    (problem p
      (data t (table (k y) (1234567 1) (1234568 2)))
      (unknowns (a :per t.k) (b))
      (observe t (= y (+ (a k) b)) :sigma 1))
    """
    solved = mbm.loads(text).solve()
    assert solved.covariance is not None
    (direction,) = solved.document()["solves"][0]["observability"]["unobservable"]
    assert set(direction["coefficients"]) == set(solved.covariance.names)


def test_a_derived_value_that_is_not_finite_says_so() -> None:
    text = """
    (problem p
      (data t (table (x) (1) (-1)))
      (unknowns (a))
      (observe o (= 2 a) :sigma 1)
      (derive (r (sqrt (* a x)) :over t) (q (sqrt (- a)))))
    """
    derived = mbm.loads(text).solve().document()["solves"][0]["derived"]
    assert derived["q"]["value"] is None
    assert derived["q"]["sigma"] is None
    assert derived["q"]["reason"] == "the value is not finite"
    # sqrt(2) ± 1/(2 sqrt(2)), by hand; one square root, so rounding
    assert derived["r"]["value"] == [pytest.approx(math.sqrt(2), rel=1e-14), None]
    assert derived["r"]["sigma"] == [pytest.approx(0.5 / math.sqrt(2), rel=1e-14), None]
    assert derived["r"]["reason"] == "the value is not finite"


def test_a_start_without_a_value_gives_one_reason_for_everything() -> None:
    solved = mbm.loads("(problem p (unknowns (a :init -1)) (observe (= 2 (log a)) (= 3 (log a)) :sigma 1))").solve()
    written = solved.document()["solves"][0]
    reason = "an equation has no finite value at the initial values"
    assert written["status"] == "not-converged"
    assert written["message"] == reason
    assert written["observability"] is None
    assert written["reasons"] == dict.fromkeys(("cost", "dof", "sigma0", "chi2_p"), reason)
    assert written["estimates"]["a"]["reason"] == reason
    assert "no equation changes" not in str(solved)


def test_the_options_say_what_was_asked_for() -> None:
    problem = mbm.loads("(problem p (constants (c 2)) (unknowns (a :init 1)) (observe (= c (* a a)) :sigma 1))")
    assert problem.solve().document()["options"] == {
        "method": "auto",
        "max-iterations": 100,
        "tolerance": 1e-10,
        "coverage": 0.95,
        "backend": "auto",
    }
    solved = problem.solve(constants={"c": "3"}, init={"a": np.array(2.0)}, backend="numpy", method="dogleg")
    options = solved.document()["options"]
    assert (options["method"], options["backend"]) == ("dogleg", "numpy")
    assert (options["set"], options["init"]) == ({"c": "3"}, {"a": 2.0})
    again = problem.solve(init=json.loads(solved.to_json())).document()["options"]["init"]
    assert again["document"] == "p"
    assert len(again["sha256"]) == 64


@pytest.mark.parametrize(("over", "kept"), [(0, True), (1, False)])
def test_large_covariances_are_left_out_unless_asked_for(over: int, kept: bool) -> None:
    count = LARGEST_COVARIANCE + over
    problem = mbm.loads("(problem p (data d external) (unknowns (a :per d.k)) (observe d (= y (a k)) :sigma 1))")
    data = {"d": {"k": np.arange(count), "y": np.ones(count)}}
    written = problem.solve(data=data).document()["solves"][0]["covariance"]
    assert (written["matrix"] is not None) == kept
    assert len(written["names"]) == count
    if not kept:
        assert "--covariance full" in written["reason"]
        full = problem.solve(data=data, covariance_full=True).document()["solves"][0]["covariance"]
        assert full["matrix"] == np.eye(count).tolist()


def test_tables_of_solves_hold_numbers_where_a_solve_has_no_such_one():
    rows = "(1 0 1) (1 1 2) (1 2 3) (2 0 3) (2 1 4) (2 2 5)"
    text = f"""(problem p (data d (table (k x y) {rows})) (unknowns (a :init 1) (b :init 0))
      (observe d (= y (+ (* a x) b)) :sigma 0.1) (derive (c (* a x) :over d)) (for-each k))"""
    frame = mbm.loads(text).solve().table()
    assert frame["dof"].tolist() == [1, 1]
    assert all(frame[name].dtype.kind == "f" for name in frame if name.startswith("c"))
    np.testing.assert_array_equal(np.isnan(frame["c[2]"]), [False, True])
    assert frame["c[2]"].mean() == pytest.approx(1.0, rel=1e-12)  # the slope of the first solve
