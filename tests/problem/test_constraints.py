"""Constraints as they are written: chains, vectors, angles, rows, loops, models; what is decided before the solve."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.language import evaluator

EXACT = 1e-9
"""Linear problems: the optimum is known to far more digits than it is asked for."""

POINT = "(data t (table (x y) (2.0 5.0) (2.2 5.2)))"  # means 2.1 and 5.1
UNKNOWNS = "(unknowns (a :init 0) (b :init 0))"
OBSERVED = "(observe t (= x a) (= y b) :sigma 0.1)"


def problem(constraints: str, unknowns: str = UNKNOWNS, observed: str = OBSERVED) -> str:
    return f"(problem p {POINT} {unknowns} {observed} (constraints {constraints}))"


@pytest.mark.parametrize(
    ("constraints", "a", "b"),
    [
        ("(<= a 2)", 2, 5.1),
        ("(< a 2)", 2, 5.1),
        ("(>= a 3)", 3, 5.1),
        ("(> a 3)", 3, 5.1),
        ("(= a 3)", 3, 5.1),
        ("(<= 3 a 4)", 3, 5.1),
        ("(>= 2 a 1)", 2, 5.1),
        ("(uniform a 0 1)", 1, 5.1),
        ("(= a b)", 3.6, 3.6),
        ("(= a b 3)", 3, 3),
        ("(>= a b)", 3.6, 3.6),
        ("(<= b a 3)", 3, 3),
        ("(<= a b)", 2.1, 5.1),
        ("(= (+ a b) 8)", 2.5, 5.5),
        ("(<= (+ a b) 6) (<= b 4)", 2, 4),
        ("(<= b 4) (<= b 4.5) (<= (* 2 b) 8)", 2.1, 4),
        ("(<= [a b] [2 4])", 2, 4),
        ("(<= [a b] 2)", 2, 2),
        ("(<= 3 [a b] [4 5])", 3, 5),
        ("(= [a b] [2 4])", 2, 4),
    ],
)
@pytest.mark.parametrize("method", ["penalty", "exact"])
def test_what_a_constraint_makes_of_the_means(solve, constraints, a, b, method):
    found = solve(problem(f"{constraints}) (solve :constraints {method}"))
    assert [float(found[n].value) for n in "ab"] == pytest.approx([a, b], rel=EXACT)
    assert found.status == "ok"


@pytest.mark.parametrize("method", ["penalty", "exact"])
@pytest.mark.parametrize(
    ("kinked", "parts"),
    [
        ("(<= (max a b) 2)", "(<= a 2) (<= b 2)"),
        ("(>= 4 (max (- a 1) b 3))", "(<= (- a 1) 4) (<= b 4)"),
        ("(>= (min a b) 5)", "(>= a 5) (>= b 5)"),
        ("(<= (abs (- a b)) 1)", "(<= -1 (- a b) 1)"),
        ("(>= (- (abs (- a b))) -1)", "(<= -1 (- a b) 1)"),
        ("(<= (max a b) (min 3 (+ a 1)))", "(<= a 3) (<= b 3) (<= b (+ a 1))"),
        ("(<= (max t (+ a (* b x))) 8)", "(<= (+ a (* b x)) 8 :over t)"),
    ],
)
def test_a_limit_of_the_greatest_holds_all_of_them(solve, kinked, parts, method):
    """At the kink, with the sigmas and degrees of freedom of the limits one by one."""
    one, other = (solve(problem(f"{text}) (solve :constraints {method}")) for text in (kinked, parts))
    assert one.status == "ok"
    assert one.solves[0].dof == other.solves[0].dof
    for name in "ab":
        assert one[name].value == pytest.approx(other[name].value, rel=EXACT)
        assert one[name].sigma == pytest.approx(other[name].sigma, rel=1e-6, abs=EXACT)


def test_a_part_of_the_greatest_that_is_known_is_decided_before_the_solve():
    with pytest.raises(mbm.MbmError, match="contradiction"):
        mbm.loads(problem("(<= (max a 3) 2)")).solve()


def test_report_has_an_entry_for_each_constraint(solve):
    text = problem("(<= 0 a 3 :name low) (= (+ a b) 8) (for (i 1 2) (>= b (* i 1.0))) (uniform b 0 5.5)")
    found = solve(text).document()["solves"][0]["constraints"]
    assert [(c["name"], c["type"], c["active"], c["violation"]) for c in found] == [
        ("low", "<=", False, 0.0),
        ("(= (+ a b) 8)", "=", True, 0.0),
        ("(>= b (* i 1.0)) i=1", ">=", False, 0.0),
        ("(>= b (* i 1.0)) i=2", ">=", False, 0.0),
        ("(uniform b 0 5.5)", "uniform", True, 0.0),
    ]
    # a = 2.5, b = 5.5: what is left to the limits; of an equation the difference of its sides.
    assert [c["value"] for c in found] == pytest.approx([0.5, 0.0, 4.5, 3.5, 0.0], abs=1e-9)


def test_rows_of_a_table_are_constrained_one_by_one(solve):
    text = """(problem p
      (data t (table (k y hi) ("a" 1.0 0.5) ("b" 2.0 9.0) ("c" 3.0 2.5)) :key k)
      (unknowns (z :per t :init 0))
      (observe t (= y (z k)) :sigma 0.1)
      (constraints (<= (z k) hi :over t :name limit)))"""
    solved = solve(text)
    np.testing.assert_allclose(solved["z"].value, [0.5, 2.0, 2.5], rtol=EXACT)
    (found,) = solved.document()["solves"][0]["constraints"]
    assert found["over"] == "t"
    assert found["rows"] == 3
    assert found["active_rows"] == [1, 3]
    assert found["violated_rows"] == []
    assert found["value"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("limits", "measured", "expected"),
    [
        ("(<= 170deg a 190deg)", -160, -170),  # 200° is nearest to 190°, which is −170°
        ("(<= 170deg a 190deg)", 165, 170),
        ("(<= 170deg a 190deg)", -175, -175),
        ("(uniform a -60deg 200deg)", 150, 150),
        ("(<= a 90deg)", 100, 90),
        ("(<= a 90deg)", -170, -170),
        ("(>= a -0.5rad)", -40, -0.5 * 180 / np.pi),
    ],
)
def test_limits_of_an_angle_take_the_representative_between_them(solve, limits, measured, expected):
    start = np.radians(measured)
    observed = f"(unknowns (a angle :init {start})) (observe (= {measured}deg a) :sigma 1deg)"
    text = f"(problem p {observed} (constraints {limits}))"
    assert np.degrees(solve(text)["a"].value) == pytest.approx(expected, abs=1e-7)


def test_equal_angles_may_differ_by_whole_turns(solve):
    text = """(problem p (unknowns (a angle :init 3.1) (b angle :init -3.1))
      (observe (= 178deg a) (= -176deg b) :sigma 1deg) (constraints (= a b)))"""
    found = solve(text)
    assert np.degrees(found["a"].value) == pytest.approx(-179, abs=1e-7)
    assert np.degrees(found["b"].value) == pytest.approx(-179, abs=1e-7)


def test_constraints_of_a_model_join_once_with_its_arguments(solve):
    text = """
    (top (x y) (constraints (<= 0 x 2) (= y (* 2 x)) (> y 0)) (vertexes (1 (x y 0)) (2 ((- x) y 0))))
    (problem p
      (unknowns (a :init 1) (b :init 1))
      (observe (= [3 5 0] (vertex (top a b) 1)) (= [-3 5 0] (vertex (top a b) 2)) :sigma 0.1))"""
    found = solve(text)
    assert [float(found[n].value) for n in "ab"] == pytest.approx([2, 4], rel=EXACT)
    names = [c["name"] for c in found.document()["solves"][0]["constraints"]]
    assert names == ["top (<= 0 x 2)", "top (= y (* 2 x))", "top (> y 0)"]


def test_functions_and_macros_may_give_constraints(solve):
    text = """
    (defun between (x lo hi) `(<= ,lo ,x ,hi))
    (defmacro same (a b) `(= ,a ,b))
    """ + problem("(same b (* 2 a)) (for (i 1 2) (between 'a 0 i))")
    found = solve(text)
    # 2a nearest to 5.1 and a to 2.1, equally well known: (2.1 + 2 · 5.1)/5, cut at 1.
    assert [float(found[n].value) for n in "ab"] == pytest.approx([1, 2], rel=EXACT)
    names = [c["name"] for c in found.document()["solves"][0]["constraints"]]
    assert names == ["(= b (* 2 a))", "(<= 0 a 1) i=1", "(<= 0 a 2) i=2"]


def test_what_holds_without_unknowns_leaves_no_constraint(solve):
    text = problem("(<= 1 2) (= 0.3 (* 3 0.1)) (<= 0 1 a)")
    assert len(solve(text).document()["solves"][0]["constraints"]) == 1


@pytest.mark.parametrize(
    ("constraints", "code", "text"),
    [
        ("(<= 2 1)", "contradiction", "(<= 2 1)"),
        ("(< 1 1)", "contradiction", "(< 1 1)"),
        ("(= 1 1.001)", "contradiction", "(= 1 1.001)"),
        ("(<= 0 5 a 4)", None, ""),
        ("(<= 5 4 a)", "contradiction", "(<= 5 4 a)"),
        ("(< x 2.1 :over t)", "contradiction", "(< x 2.1 :over t)"),
        ("(<= a)", "bad-form", "(<= a)"),
        ("(uniform a 1)", "bad-form", "(uniform a 1)"),
        ("(nearly a 1)", "bad-form", "nearly"),
        ("(<= [a b] [1 2 3])", "unequal-sides", "(<= [a b] [1 2 3])"),
        ("(<= (< a b) 1)", "wrong-kind", None),
        ("(<= a 1 :at first)", "no-states", "first"),
    ],
)
def test_what_is_refused(solve, faults, constraints, code, text):
    if code is None:
        assert solve(problem(constraints)).status == "attention"
        return
    (found, *_) = faults(problem(constraints))
    assert found.code.name == code
    if text is not None:
        assert found.place.text == text


def test_contradiction_in_the_data_names_the_row(faults):
    table = POINT.replace(" (2.2", "\n (2.2")
    found = faults(problem("(<= y 5.1 :over t)").replace(POINT, table))[0]
    assert found.code.name == "contradiction"
    assert found.labels[0].place.row == 2  # rows of an inline table are named by their lines


def test_units_of_the_sides_must_agree(faults):
    found = faults("(problem p (unknowns (a :unit m :init 1)) (observe (= 1m a) :sigma 1cm) (constraints (<= a 3s)))")
    assert found[0].code.name == "unit-clash"


def test_unknown_that_only_an_equation_holds_is_observable(solve):
    text = problem("(= c (- b a))", "(unknowns (a :init 0) (b :init 0) (c :init 0))")
    found = solve(text)
    assert found.status == "ok"
    assert float(found["c"].value) == pytest.approx(3, rel=EXACT)
    # Two rows of 0.1 each for a and for b: the difference has the variance 2 · 0.01/2.
    assert float(found["c"].sigma) == pytest.approx(0.1, rel=1e-9)
    solve_ = found.first
    assert (solve_.dof, found.observability.rank, found.observability.dimension) == (2, 3, 3)


def test_unknown_that_only_an_inequality_holds_is_not_observable(solve):
    found = solve(problem("(<= c b)", "(unknowns (a :init 0) (b :init 0) (c :init 0))"))
    assert found.status == "attention"
    assert found.document()["solves"][0]["status"] == "unobservable"


def test_equations_count_as_degrees_of_freedom_and_unknown_noise_uses_them(solve):
    text = problem("(= b (+ a 4))", observed="(observe t (= x a) (= y b))")
    found = solve(text)
    # a = 1.6, b = 5.6: four residuals, one equation, two unknowns.
    a = np.array([2.0, 2.2, 1.0, 1.2]).mean()
    squares = float(np.sum((np.array([2.0, 2.2]) - a) ** 2) + np.sum((np.array([5.0, 5.2]) - a - 4) ** 2))
    solved = found.first
    assert float(found["a"].value) == pytest.approx(a, rel=EXACT)
    assert solved.dof == 3
    assert found.document()["solves"][0]["noise"]["t"] == pytest.approx(np.sqrt(squares / 3), rel=1e-9)
    assert float(found["a"].sigma) == pytest.approx(np.sqrt(squares / 3 / 4), rel=1e-9)


def test_infeasible_problem_says_which_constraints_contradict(solve):
    found = solve(problem("(>= a 3 :name big) (<= (+ a b) 4 :name sum) (>= b 2 :name other) (<= a 9 :name wide)"))
    (solved,) = found.document()["solves"]
    assert solved["status"] == "infeasible"
    (diagnostic,) = [d for d in solved["diagnostics"] if d["code"] == "conflicting-constraints"]
    assert diagnostic["message"] == "no values of the unknowns meet all of `big`, `sum`, `other`"
    assert solved["estimates"]["a"]["sigma"] is None


@pytest.mark.parametrize(
    ("constraints", "named"),
    [
        ("(= a 3 :name three)", "`three`, the fixed `a`"),
        ("(= b 1 :name one) (= (+ a b) 4 :name sum) (<= a 9 :name wide)", "`one`, `sum`, the fixed `a`"),
    ],
)
def test_what_is_fixed_and_contradicts_a_constraint_is_named_with_it(constraints, named):
    """Where it is fixed may be known at the solve alone; at 3, no constraint would contradict it."""
    text = problem(constraints, "(unknowns (a :init 3 :fixed true) (b :init 0))")
    assert mbm.loads(text).solve().first.status == "converged"
    found = mbm.loads(text).solve(init={"a": 2.0}).first
    assert found.status == "infeasible"
    (said,) = [d for d in found.diagnostics if d.code.name == "conflicting-constraints"]
    assert said.message == f"no values of the unknowns meet all of {named}"


def test_rotation_with_a_constraint_stays_a_rotation(solve):
    """The axis of a rotation is held upright: what is left is the turn about it."""
    text = """(problem p
      (data t (table (x y z u v w) (1 0 0 0.7 0.71 0.05) (0 1 0 -0.7 0.7 -0.03) (0 0 1 0.02 0.04 1.0)))
      (unknowns (R (rotation 3)))
      (observe t (= [u v w] (rotate R [x y z])) :sigma 0.01)
      (constraints (= (rotate R [0 0 1]) [0 0 1])))"""
    found = solve(text)
    (solved,) = found.document()["solves"]
    turn = np.arctan2(0.71 + 0.7, 0.7 + 0.7)  # Wahba's problem in the plane
    quaternion = [np.cos(turn / 2), 0, 0, np.sin(turn / 2)]
    np.testing.assert_allclose(np.abs(solved["estimates"]["R"]["value"]["quaternion"]), np.abs(quaternion), atol=1e-8)
    # Three equations, of which two are independent.
    assert solved["observability"]["rank"] == 3
    assert solved["dof"] == 9 + 2 - 3


@pytest.mark.parametrize(("constraint", "codes"), [("(= c (- b a))", []), ("(<= c b)", ["unmentioned"])])
def test_check_counts_equations_among_the_constraints(tmp_path, constraint, codes):
    path = tmp_path / "p.mbm"
    path.write_text(problem(constraint, "(unknowns (a :init 0) (b :init 0) (c :init 0))"))
    assert [d.code.name for d in mbm.api.check(path)] == codes


@pytest.mark.parametrize("method", ["penalty", "exact", "ipopt"])
def test_curved_constraints_of_an_image_of_a_circle(solve, method):
    """A point on a circle nearest to a measured one: known in closed form, with the variance along the tangent."""
    way = "(solve :method ipopt)" if method == "ipopt" else f"(solve :constraints {method})"
    text = f"""(problem p (unknowns (v (vector 2) :init [1 0.2]))
      (observe (= [1.23 1.64] v) :sigma 0.1) (constraints (= (norm v) 2)) {way})"""
    found = solve(text)
    np.testing.assert_allclose(found["v"].value, [1.2, 1.6], rtol=1e-9)
    tangent = np.array([-0.8, 0.6])
    np.testing.assert_allclose(found.covariance.matrix, 0.01 * np.outer(tangent, tangent), atol=1e-9)
    assert found.first.dof == 1
    assert found.first.method == method


def test_what_a_for_repeats_is_wrong_once(monkeypatch):
    """The name is looked for once, among the file's own names and then the functions, not 30,000 times."""
    looked = []
    plain = evaluator.closest
    monkeypatch.setattr(evaluator, "closest", lambda *given: (looked.append(given), plain(*given))[1])
    text = """(problem p (unknowns (a :init 1)) (observe o (= 1 a))
      (constraints (for (i 1 30000) (for (j first 30000) (normal a j 1)))))"""
    (found,) = mbm.loads(text).check()
    assert (found.code.name, len(looked)) == ("unknown-name", 2)
