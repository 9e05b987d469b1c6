"""Tables in equations: joins, keys, units, gaps, static columns, families."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""

STATIONS = '(data s (table (id x) ("n" 1) ("s" 2) ("e" 5)) :key id)'


def test_joined_columns_are_those_of_the_row_with_the_key(estimate):
    text = (
        f'(problem p {STATIONS} (data t (table (at y) ("s" 4) ("e" 10)) :with (s at))'
        " (unknowns (a)) (observe t (= y (* a s.x))))"
    )
    assert estimate(text) == pytest.approx((2 * 4 + 5 * 10) / (4 + 25), rel=EXACT)


def test_two_joins_to_one_table_under_two_names(estimate):
    text = (
        f'(problem p {STATIONS} (data t (table (i j y) ("s" "n" 2) ("e" "s" 9)) :with (a s i) :with (b s j))'
        " (unknowns (k)) (observe t (= y (* k (- a.x b.x)))))"
    )
    assert estimate(text, "k") == pytest.approx((1 * 2 + 3 * 9) / (1 + 9), rel=EXACT)


def test_units_of_columns_convert_and_cells_may_state_theirs(estimate):
    stated = (
        "(problem p (data t (table (w) (100) (300)) :columns ((width w :unit cm)))"
        " (unknowns (a)) (observe t (= width a)))"
    )
    assert estimate(stated) == pytest.approx(2.0, rel=EXACT)
    inline = "(problem p (data t (table (w) (100cm) (3m))) (unknowns (a)) (observe t (= w a)))"
    assert estimate(inline) == pytest.approx(2.0, rel=EXACT)


def test_gaps_may_be_skipped_or_left_out_by_when():
    data = {"t": {"x": [1.0, np.nan, 3.0], "y": [2.0, 5.0, 7.0]}}
    for clause in ("(data t external :missing skip)", "(data t external)"):
        when = "" if "skip" in clause else ":when (finite x)"
        text = f"(problem p {clause} (unknowns (a)) (observe t (= y a) {when}) (derive (d (+ a 1))))"
        assert float(mbm.loads(text).solve(data=data)["a"].value) == pytest.approx(4.5, rel=EXACT)


def test_a_gap_in_a_column_that_is_not_used_does_not_matter(solve):
    data = {"t": {"x": [1.0, np.nan], "y": [2.0, 5.0]}}
    text = "(problem p (data t external) (unknowns (a)) (observe t (= y a)))"
    assert float(mbm.loads(text).solve(data=data)["a"].value) == pytest.approx(3.5, rel=EXACT)


STATIC = """
(problem p (data t (table (n kind y) (1 "p" 10) (2 "p" 20) (3 "q" 7) (1 "q" 9)))
  (unknowns (v (vector 3) :init 0))
  (observe t (if (= kind "p") (= y (v n)) (= y (+ (v n) 1))) :sigma 1))
"""


def test_static_columns_group_the_rows(estimate):
    # rows 1 and 4 see v1 as 10 and as 9 − 1
    np.testing.assert_allclose(estimate(STATIC, "v"), [9.0, 20.0, 6.0], rtol=EXACT)


def test_each_group_of_static_values_has_its_kernel():
    kernels = mbm.loads(STATIC).compile().kernels.kernels
    assert [k.case for k in kernels] == [0, 1, 2, 3]
    plain = "(problem p (data t (table (n y) (1 2) (2 3) (3 4))) (unknowns (a)) (observe t (= y (* a n))))"
    assert len(mbm.loads(plain).compile().kernels.kernels) == 1


@pytest.mark.parametrize(
    "form",
    ["(sum (i 1 n) (* a i))", "(reduce + (map (lambda (i) (* a i)) (range 1 n)))", "(* a ((list 1 3 6) n))"],
)
def test_columns_as_ends_of_ranges_and_indices(estimate, form):
    text = f"(problem p (data t (table (n y) (1 2) (2 6) (3 12))) (unknowns (a)) (observe t (= y {form})))"
    assert estimate(text) == pytest.approx(2.0, rel=EXACT)


def test_a_family_over_a_table_has_a_member_for_each_row(solve):
    text = (
        f'(problem p {STATIONS} (data t (table (at y) ("s" 4) ("e" 10) ("s" 6) ("n" 1)))'
        ' (unknowns (o :per s :init x)) (observe t (= y (o at)) :sigma 1) (derive (d (- (o "e") (o "n")))))'
    )
    result = solve(text)
    assert list(result["o"].keys) == ["n", "s", "e"]
    np.testing.assert_allclose(result["o"].value, [1, 5, 10], rtol=EXACT)
    np.testing.assert_allclose(result["o"].sigma, [1, np.sqrt(0.5), 1], rtol=EXACT)
    assert float(result["d"].value) == pytest.approx(9.0, rel=EXACT)
    assert float(result["d"].sigma) == pytest.approx(np.sqrt(2), rel=EXACT)


def test_a_family_over_a_column_has_a_member_for_each_value(solve):
    text = (
        "(problem p (data t (table (run y) (7 4) (3 10) (7 6)))"
        " (unknowns (o (vector 2) :per t.run)) (observe t (= [y (* 2 y)] (o run)) :sigma 1))"
    )
    result = solve(text)
    assert sorted(result["o"].keys) == [3.0, 7.0]
    found = dict(zip(result["o"].keys, np.asarray(result["o"].value), strict=True))
    np.testing.assert_allclose(found[7.0], [5, 10], rtol=EXACT)
    np.testing.assert_allclose(found[3.0], [10, 20], rtol=EXACT)


def test_two_members_meet_in_one_equation(solve):
    text = (
        '(problem p (data s (table (id) ("a") ("b") ("c")) :key id)'
        ' (data t (table (i j y) ("a" "b" 3) ("b" "c" 4) ("a" "c" 7.3)))'
        ' (unknowns (z :per s)) (observe t (= y (- (z j) (z i))) :sigma 0.1) (constraints (normal (z "a") 0 1e-6)))'
    )
    result = solve(text)
    # a triangle of height differences closes by 0.3, shared equally
    np.testing.assert_allclose(result["z"].value, [0.0, 3.1, 7.2], atol=1e-8)


def test_families_have_options_per_member(solve):
    text = (
        '(problem p (data s (table (id x w) ("n" 1 0.5) ("s" 2 0.25)) :key id)'
        ' (unknowns (o :per s :init x :sigma w :fixed (= id "s"))) (observe (= 3 (o "n")) :sigma 0.5))'
    )
    result = solve(text)
    np.testing.assert_allclose(result["o"].value, [2.0, 2.0], rtol=EXACT)  # equal weights for 1 and 3


def test_literal_keys_are_checked(faults):
    text = f'(problem p {STATIONS} (unknowns (o :per s)) (observe (= 3 (o "m")) :sigma 1))'
    assert faults(text)[0].code.name == "bad-index"


def test_keys_must_be_there_and_differ(faults):
    dangling = f'(problem p {STATIONS} (data t (table (at y) ("w" 1)) :with (s at)) (unknowns (a)) (observe t (= y a)))'
    assert faults(dangling)[0].code.name == "dangling-key"
    twice = '(problem p (data s (table (id x) ("n" 1) ("n" 2)) :key id) (unknowns (a)) (observe s (= x a)))'
    assert faults(twice)[0].code.name == "duplicate-key"


def test_a_text_where_a_number_is_wanted_names_the_cell(faults):
    text = '(problem p (data t (table (x y) (1 2) ("one" 3))) (unknowns (a)) (observe t (= y (* a x))))'
    diagnostic = faults(text)[0]
    assert diagnostic.code.name == "text-in-number-column"
    assert "`one`" in diagnostic.message


def test_a_row_of_units_is_told_where_units_stand(faults):
    text = "(problem p (data t (table (m x) (kg mm) (1 2) (2 3))) (unknowns (a)) (observe t (= x (* a m))))"
    assert ":columns ((m :unit kg))" in next(fault.hint for fault in faults(text) if "`kg`" in fault.message)


def test_a_unit_for_a_type_is_told_where_it_stands(faults):
    assert faults("(problem p (unknowns (a s)) (observe (= 3 a)))")[0].hint == "`s` is a unit: write `:unit s`"


def test_the_word_nan_is_blamed_and_not_the_number_beside_it(faults):
    for cells, blamed in (("(0 1) (1 nan)", "`nan`"), ("(0 inf) (1 2)", "`inf`"), ("(0 nan) (1 off)", "`off`")):
        diagnostic = faults(f"(problem p (data d (table (x y) {cells})) (unknowns (a)) (observe d (= y a)))")[0]
        assert diagnostic.code.name == "text-in-number-column"
        assert diagnostic.message.endswith(f"but a cell is {blamed}")


def test_texts_that_read_as_numbers_are_told_as_texts(faults):
    text = "(problem p (data d external) (unknowns (a)) (observe d (= y (* a x))))"
    hint = faults(text, data={"d": {"x": [1, "2", 3], "y": [1, 2, 3]}})[0].hint
    assert "holds texts" in hint
    assert "unit" not in hint


def test_rows_of_a_table_on_one_line_are_told_apart(faults):
    keyed = "(problem p (data s (table (k x) (a 1) (b 2) (a 3)) :key k) (unknowns (o :per s)) (observe s (= x (o k))))"
    diagnostic = faults(keyed)[0]
    assert diagnostic.message == "rows 1 and 3 have the same key `a` in column `k`"
    assert diagnostic.place.row == 1  # the line
    united = (
        "(problem p (data s (table (k x) (a 1) (b 2))) (data t (table (k x) (c 1) (b 2))) (data u (union s t) :key k)"
        "(unknowns (o :per u)) (observe u (= x (o k))))"
    )
    assert faults(united)[0].message == "rows 2 and 4 have the same key `b` in column `k`"


def test_a_union_of_numbers_and_texts_names_the_tables(faults):
    text = (
        "(problem p (data a (table (x y) (0 1) (1 2))) (data b (table (x y) (0 3) (1 off))) (data d (union a b))"
        "(unknowns (c)) (observe d (= y c)))"
    )
    message = "row 2 of `b` holds the text `off` in column `y`, which holds numbers in `a`"
    assert faults(text)[0].message == message
