"""LANGUAGE §4, the clauses of a problem one by one: what they mean is what they make of the estimates."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""

LINE = "(data t (table (x y) (0 1) (1 3) (2 5.5) (3 6.5)))"
X, Y = np.array([0.0, 1.0, 2.0, 3.0]), np.array([1.0, 3.0, 5.5, 6.5])


def fitted(columns, y, weights=None):
    matrix = np.column_stack(columns)
    root = np.ones(len(y)) if weights is None else np.sqrt(weights)
    return np.linalg.lstsq(matrix * root[:, None], y * root, rcond=None)[0]


def test_a_line(estimate):
    text = f"(problem p {LINE} (unknowns (a) (b)) (observe t (= y (+ a (* b x)))))"
    a, b = fitted([np.ones(4), X], Y)
    assert estimate(text, "a") == pytest.approx(a, rel=EXACT)
    assert estimate(text, "b") == pytest.approx(b, rel=EXACT)


def test_an_expression_that_should_be_zero_says_the_same(estimate):
    text = f"(problem p {LINE} (unknowns (a) (b)) (observe t (- (+ a (* b x)) y)))"
    assert estimate(text, "b") == pytest.approx(fitted([np.ones(4), X], Y)[1], rel=EXACT)


def test_clauses_may_stand_in_any_order(estimate):
    text = f"(problem p (observe t (= y m)) (define (m (* a x))) (unknowns (a)) {LINE})"
    assert estimate(text) == pytest.approx(X @ Y / (X @ X), rel=EXACT)


@pytest.mark.parametrize(
    ("equations", "count"),
    [
        ("(= y (* a x)) (= (* 2 y) (* 2 a x))", 2),
        ("(let ((m (* a x))) (= y m) (= y m))", 2),
        ("(let* ((k a) (m (* k x))) (if (> x 1) (= y m) (= y m)))", 1),
        ("(cond ((> x 2) (= y (* a x))) ((> x 1) (= y (* a x))) (else (= y (* a x))))", 1),
        ("(= [y y] [(* a x) (* a x)])", 2),
        ("'(= y (* a x))", 1),
        ("(let ((m 'x)) `(= y (* a ,m)))", 1),
        ("(equation)", 1),
    ],
)
def test_equation_position(solve, equations, count):
    text = f"(defun equation () '(= y (* a x))) (problem p {LINE} (unknowns (a)) (observe t {equations} :sigma 1))"
    result = solve(text)
    assert float(result["a"].value) == pytest.approx(X @ Y / (X @ X), rel=EXACT)
    assert result.result.solves[0].dof == 4 * count - 1


def test_branches_of_equations_differ_by_row(estimate):
    text = f"(problem p {LINE} (unknowns (a) (b)) (observe t (if (< x 2) (= y a) (= y b))))"
    assert estimate(text, "a") == pytest.approx(2.0, rel=EXACT)
    assert estimate(text, "b") == pytest.approx(6.0, rel=EXACT)


def test_observations_without_a_table_hold_once(estimate):
    text = "(problem p (unknowns (a) (b)) (observe first-one (= 3 (+ a b))) (observe (= 1 (- a b)) (= 1 (- a b))))"
    assert estimate(text, "a") == pytest.approx(2.0, rel=EXACT)


def test_observations_are_named_after_their_table(solve):
    text = (
        f"(problem p {LINE} (unknowns (a)) (observe t (= y a) :sigma 1) (observe t (= y a) :sigma 1)"
        " (observe other t (= y a) :sigma 1) (observe (= 1 a) :sigma 1))"
    )
    assert list(solve(text).result.solves[0].residual_summaries) == ["t", "t-2", "other", "observe"]


def test_when_picks_rows(estimate):
    text = f"(problem p {LINE} (unknowns (a)) (observe t (= y a) :when (and (> x 0) (not (= x 2)))))"
    assert estimate(text) == pytest.approx((3 + 6.5) / 2, rel=EXACT)


def test_where_filters_the_table_and_row_counts_in_the_file(estimate):
    text = "(problem p (data t (table (x y) (0 1) (1 3) (2 5.5) (3 6.5)) :where (> x 0)) (unknowns (a)) {})"
    assert estimate(text.format("(observe t (= y a))")) == pytest.approx(5.0, rel=EXACT)
    assert estimate(text.format("(observe t (= row a))")) == pytest.approx(3.0, rel=EXACT)


def test_first_and_last_take_one_row(estimate):
    base = f"(problem p {LINE} (unknowns (a :init (first t y))) (observe t (= y (+ a (- (last t x) (first t x))))))"
    assert estimate(base) == pytest.approx(Y.mean() - 3, rel=EXACT)


def test_definitions_resolve_columns_where_they_are_used(estimate):
    text = (
        "(problem p (data s (table (x y) (1 2))) (data t (table (x y) (10 30))) (unknowns (a) (b))"
        " (define (scaled (* 2 x)) (model (* a scaled)))"
        " (observe s (= y model)) (observe t (= y (+ b scaled))))"
    )
    assert estimate(text, "a") == pytest.approx(1.0, rel=EXACT)
    assert estimate(text, "b") == pytest.approx(10.0, rel=EXACT)


def test_a_function_inside_a_problem_sees_its_unknowns_and_constants(estimate):
    text = f"(problem p {LINE} (constants (k 2)) (unknowns (a)) (defun m (x) (* a k x)) (observe t (= y (m x))))"
    assert estimate(text) == pytest.approx(X @ Y / (X @ X) / 2, rel=EXACT)


def test_derived_quantities_see_earlier_ones_and_propagate(solve):
    text = (
        f"(problem p {LINE} (unknowns (a) (b)) (observe t (= y (+ a (* b x))) :sigma 0.5)"
        " (derive (root (- (/ a b))) (twice (* 2 root)) (line (+ a (* b x)) :over t) (both [a b])))"
    )
    result = solve(text)
    matrix = np.column_stack([np.ones(4), X])
    covariance = 0.25 * np.linalg.inv(matrix.T @ matrix)
    a, b = fitted([np.ones(4), X], Y)
    gradient = np.array([-1 / b, a / b**2])
    assert result["root"].value == pytest.approx(-a / b, rel=1e-10)
    assert result["root"].sigma == pytest.approx(np.sqrt(gradient @ covariance @ gradient), rel=1e-10)
    assert result["twice"].sigma == pytest.approx(2 * result["root"].sigma, rel=1e-10)
    np.testing.assert_allclose(result["line"].value, matrix @ [a, b], rtol=1e-10)
    np.testing.assert_allclose(result["line"].sigma, np.sqrt(np.diag(matrix @ covariance @ matrix.T)), rtol=1e-10)
    np.testing.assert_allclose(result["both"].sigma, np.sqrt(np.diag(covariance)), rtol=1e-10)


def test_for_each_makes_one_problem_for_each_key(solve):
    text = (
        '(problem p (data t (table (run kind y) (1 "a" 1) (1 "b" 5) (2 "a" 3) (1 "a" 2)))'
        " (unknowns (a)) (observe t (= y a) :sigma 1) (for-each run kind))"
    )
    solves = solve(text).result.solves
    found = {tuple(s.key.values()): float(s.estimates[0].value) for s in solves}
    assert found == {(1.0, "a"): 1.5, (1.0, "b"): 5.0, (2.0, "a"): 3.0}


LIKE = f"""
(problem base {LINE} (constants (k 1) (c 10)) (unknowns (a :init 1) (b :init 2 :fixed true))
  (define (model (* k a x)) (shift 0)) (observe t (= y (+ model shift)) :sigma 1) (derive (d a)))
"""


def test_like_takes_everything_and_replaces_by_head_and_name(estimate, solve):
    plain = X @ Y / (X @ X)
    assert estimate(LIKE + "(problem q :like base)", name="q") == pytest.approx(plain, rel=EXACT)
    halved = LIKE + "(problem q :like base (constants (k 2)))"
    assert estimate(halved, name="q") == pytest.approx(plain / 2, rel=EXACT)
    redefined = LIKE + "(problem q :like base (define (model (* 4 a x))))"
    assert estimate(redefined, name="q") == pytest.approx(plain / 4, rel=EXACT)
    data = LIKE + "(problem q :like base (data t (table (x y) (1 7))))"
    assert estimate(data, name="q") == pytest.approx(7.0, rel=EXACT)
    observed = LIKE + "(problem q :like base (observe t (= y (* 3 a x)) :sigma 1))"
    assert estimate(observed, name="q") == pytest.approx(plain / 3, rel=EXACT)
    added = solve(LIKE + "(problem q :like base (derive (e (* 2 a))))", name="q")
    assert float(added["e"].value) == pytest.approx(2 * float(added["d"].value), rel=EXACT)


def test_like_may_chain(estimate):
    text = LIKE + "(problem q :like base (constants (k 2))) (problem r :like q (define (shift 1)))"
    assert estimate(text, name="r") == pytest.approx(X @ (Y - 1) / (X @ X) / 2, rel=EXACT)


def test_overrides_of_constants_take_units(estimate):
    text = "(problem p (constants (h 2m) (v [1 2])) (unknowns (a)) (observe o (= (+ h 0) a)) (observe q (= h a)))"
    assert estimate(text) == pytest.approx(2.0, rel=EXACT)
    assert estimate(text, constants={"h": "70cm"}) == pytest.approx(0.7, rel=EXACT)
    assert estimate(text, constants={"h": 3.0}) == pytest.approx(3.0, rel=EXACT)


def test_vector_and_matrix_constants(estimate):
    text = (
        "(problem p (constants (v [1 2 3]) (m [[1 2] [3 4]])) (unknowns (a))"
        " (observe o (= (+ (v 3) (m 2 1)) a)) (observe q `(= (+ ,(v 3) ,(m 2 1)) a)))"
    )
    assert estimate(text) == pytest.approx(6.0, rel=EXACT)
    assert estimate(text, constants={"v": [1, 2, 7]}) == pytest.approx(10.0, rel=EXACT)


@pytest.mark.parametrize(
    ("clauses", "code"),
    [
        ("(unknowns (y)) (observe t (= y 1))", "ambiguous-name"),
        ("(constants (x 1)) (unknowns (a)) (observe t (= y (* a x)))", "ambiguous-name"),
        ("(unknowns (a)) (observe t (= y (f x 1)))", "unknown-name"),
        ("(unknowns (a)) (observe t (= y a) :when (> a 1))", "depends-on-unknown"),
        ("(unknowns (a)) (observe t (= y a) :sigma (* 2 a))", "depends-on-unknown"),
        ("(unknowns (a)) (observe t (= y a) (= y true))", "condition-as-equation"),
        ("(unknowns (a)) (observe t (= y (rot2 a)))", "length-clash"),
        ("(unknowns (a)) (observe t (= y [a]))", "unequal-sides"),
        ("(unknowns (a) (a)) (observe t (= y a))", "duplicate-definition"),
        ("(unknowns (a :init 1 :init 2)) (observe t (= y a))", "duplicate-definition"),
        ("(unknowns (a)) (observe t (= y a) :sigma [1 2])", "length-clash"),
        ("(unknowns (a)) (observe t (= [y y] [a a]) :sigma [1 2 3])", "length-clash"),
        ("(unknowns (a)) (observe t (= [y y] [a a]) :covariance [[1]])", "length-clash"),
        ("(unknowns (a)) (observe t (= y a)) (solve :max-iterations 0)", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (solve :tolerance 2)", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (solve :tolerance 1)", "bad-form"),
        ("(unknowns (n direction :in (0 1))) (observe t (= y (n 1)))", "bad-form"),
        ("(unknowns (a positive (vector 2))) (observe t (= y (a 1)))", "bad-form"),
        ("(unknowns (a) (b :init 1 :sigma a)) (observe t (= y a))", "depends-on-unknown"),
        ("(unknowns (a)) (observe t (= y a)) (solve :tolerance 0)", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (solve 3)", "bad-form"),
        ("(camera c 3) (unknowns (a)) (observe t (= y a))", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (for-each)", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (derive (d))", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (define (d))", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (constraints a)", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (constraints (nearly a 1))", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (constraints (normal a 1))", "bad-form"),
        ("(unknowns (a)) (observe t (= y a)) (constraints (normal a 1 (* 2 a)))", "depends-on-unknown"),
        ("(unknowns (a (vector 2 2))) (observe t (= y (a 1)))", "bad-form"),
        ("(unknowns (a (vector 0))) (observe t (= y 1))", "bad-index"),
        ("(unknowns (a :in 1)) (observe t (= y a))", "bad-form"),
    ],
)
def test_what_a_clause_refuses(faults, clauses, code):
    assert faults(f"(problem p {LINE} {clauses})")[0].code.name == code


def test_qualified_names_and_let_settle_ambiguity(estimate):
    text = f"(problem p {LINE} (unknowns (a) (x :init 1 :fixed true)) (observe t (= y (* a t.x))))"
    assert estimate(text) == pytest.approx(X @ Y / (X @ X), rel=EXACT)
    shadowed = f"(problem p {LINE} (unknowns (a) (x :init 1 :fixed true)) (observe t (let ((x t.x)) (= y (* a x)))))"
    assert estimate(shadowed) == pytest.approx(X @ Y / (X @ X), rel=EXACT)


def test_cuts_are_those_of_filters(faults):
    clause = "(solve :constraints truncate)"
    found = faults(f"(problem p {LINE} (unknowns (a :init 1)) (observe t (= y a) :sigma 1) {clause})")
    assert [d.code.name for d in found] == ["no-states"]
    assert found[0].place.text in clause


@pytest.mark.parametrize("rows", ["(> x 1)", "(not (< x 0))", "(= row 1)", "(and (finite x) (> x a0))"])
def test_rows_to_use_of_a_table_without_rows(rows):
    text = f"""(problem p (data d external) {LINE} (constants (a0 1)) (unknowns (a))
      (observe t (= y (* a x))) (observe d (= y (* a x)) :sigma 1 :when {rows}))"""
    empty = np.zeros(0)
    found = mbm.loads(text).solve(data={"d": {"x": empty, "y": empty}})
    assert float(found["a"].value) == pytest.approx(X @ Y / (X @ X), rel=EXACT)


def test_a_condition_on_the_first_row_of_none_is_open():
    text = "(problem p (data d external) (unknowns (a :init 1 :fixed (> (first d x) 1)) (b)) (observe (= 1 (+ a b))))"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve(data={"d": {"x": np.zeros(0)}})
    assert caught.value.diagnostics[0].message == "this condition depends on a number that is missing"


def test_a_gap_in_the_first_or_last_row_is_named_there():
    text = "(problem p (data d external) (unknowns (a :init 1 :fixed (> (last d x) 1)) (b)) (observe (= 1 (+ a b))))"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve(data={"d": {"x": [1.0, 2.0, np.nan]}})
    assert (caught.value.diagnostics[0].place.row, caught.value.diagnostics[0].place.column) == (3, "x")


def test_a_rotation_of_the_plane_may_have_bounds(estimate):
    text = "(problem p (data t (table (c s) (0.8 0.6))) (unknowns (r (rotation 2) :in (-1 1)))"
    found = estimate(f"{text} (observe t (= [c s] (rotate r [1 0])) :sigma 1e-3))", "r")
    np.testing.assert_allclose(np.ravel(found)[0], np.arctan2(0.6, 0.8), rtol=1e-9)


def test_unknowns_that_could_not_be_read_are_not_said_to_be_missing():
    text = f"(problem p {LINE} (states :over nope (x)))"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve()
    assert "no-unknowns" not in {each.code.name for each in caught.value.diagnostics}


def test_an_unknown_without_its_list_is_told_once():
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(f"(problem p {LINE} (unknowns a (b)) (observe t (= y (+ a (* b x)))))").solve()
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.place.text) == ("bad-form", "a") and "`(a)`" in fault.message


@pytest.mark.parametrize(
    ("clause", "belongs"), [("(prior a 0 1)", "constraints"), ("(normal a 0 1)", "constraints"), ("(= 1 a)", "observe")]
)
def test_what_is_no_clause_is_told_where_it_belongs(clause, belongs):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(f"(problem p {LINE} (unknowns (a)) (observe t (= y a)) {clause})").solve()
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "unknown-clause" and f"stand in `{belongs}`" in fault.hint
