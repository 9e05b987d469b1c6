"""Rules of problems and data that single cases hold to: each answer is told by the language, or counted by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.emit.c.cells import input_name
from mbm.emit.foreign import Foreign
from mbm.emit.types import Choice, ColumnValue, RowPlace
from mbm.equations.manifolds import stated_width
from mbm.estimation.batches.suits import asks_for_one_search
from mbm.estimation.settings import Settings
from mbm.problem.pairing import _near_enough, between
from mbm.problem.requests import RandomStarts
from mbm.problem.types import Method, UnknownKind

LINE = "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.1)"


def refused(text: str, **given: object) -> mbm.MbmError:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve(**given)  # type: ignore[arg-type]
    return caught.value


def test_a_key_of_one_row_that_no_member_has_is_named():
    error = refused("""(problem p (data m (table (k) ("a") ("b")) :key k) (data d (table (y w) (1 "c") (2 "a")))
      (unknowns (u :per m)) (observe d (= y (u (first d w))) :sigma 1))""")
    (diagnostic,) = error.diagnostics
    assert diagnostic.code.name == "dangling-key"
    assert "`c` is no key of the family `u`" in diagnostic.message
    assert diagnostic.place.text == "u"  # where the family is declared: no row of the table at hand is wrong


@pytest.mark.parametrize(("x", "wrong"), [([np.nan, 1.0], True), ([1.0, np.nan], False), ([1.0], False)])
def test_first_reads_the_first_row_alone(x, wrong):
    text = "(problem p (data d external) (data c external) (unknowns (a)) (observe d (= y (+ a (first c x))) :sigma 1))"
    data = {"d": {"y": [1.0, 2.0]}, "c": {"x": x}}
    if not wrong:
        assert mbm.loads(text).solve(data=data)["a"].value == pytest.approx(0.5)
        return
    (diagnostic,) = refused(text, data=data).diagnostics
    assert diagnostic.code.name == "not-finite-cell"
    assert diagnostic.place.row == 1


def test_a_shape_is_no_vector():
    error = refused("""(problem p (data d (table (r) (1))) (unknowns (p (vector 3) :init [1 1 1]))
      (observe d (= r (distance p (box 1 1 1))) :sigma 1))""")
    assert [each.code.name for each in error.diagnostics] == ["wrong-kind"]


def test_whole_numbers_in_formulas_are_pure_and_decimals_stay_open():
    def unit(number: str) -> str | None:
        text = (
            f"(problem p (data d (table (y) (1) (2))) (unknowns (a)) (observe d (= (* y 1m) (* {number} a)) :sigma 1m))"
        )
        return mbm.loads(text).solve()["a"].unit

    assert unit("2") == unit("1/2") == "m"
    assert unit("2.5") is None


@pytest.mark.parametrize(("seed", "good"), [(2**63 - 1, True), (2**63, False)])
def test_seeds_are_whole_numbers_of_63_bits(seed, good):
    text = f"(problem p (data d (table (x y) (0 1) (1 2) (2 3))) {LINE} (solve :seed {seed}))"
    if good:
        assert mbm.loads(text).solve().result.seed == seed
    else:
        assert [each.code.name for each in refused(text).diagnostics] == ["bad-form"]


def test_a_table_without_rows_has_no_gaps():
    solved = mbm.loads("""(problem p (data d external :missing skip) (data e (table (y) (1) (2))) (unknowns (a))
      (observe d (= x a) :sigma 1) (observe e (= y a) :sigma 1))""").solve(data={"d": {"x": np.zeros(0)}})
    assert solved["a"].value == pytest.approx(1.5)


def test_quotes_that_are_not_closed_are_an_error(tmp_path: Path):
    (tmp_path / "a.csv").write_text('x,y\n1,"2\n')
    problem = mbm.loads('(problem p (data d (csv "a.csv")) (unknowns (a)) (observe d (= x a) :sigma 1))', base=tmp_path)
    with pytest.raises(mbm.MbmError, match="bad-quotes"):
        problem.solve()


def test_errors_stand_beside_equations_without_a_table():
    """Rows without noise of their own and a measured slope: three pairs on a line of slope 1, a stated at 2 ± 0.3.

    b is 1 as nearly as the errors of x tell, and a the weighted mean of 1 (x errors: 0.1² + 0.1²) and 2.
    """
    text = "(problem p (data d (table (x y) (0 1) (1 2) (2 3))) (unknowns (a)) (observe d (= y (+ a x)) :sigma 0.1 {})"
    problem = mbm.loads((text + " (observe (= 2 a) :sigma 0.3))").format(":errors ((x 0.1))"))
    assert problem.check() == ()
    solved = problem.solve()
    weights = np.array([3.0 / (0.1**2 + 0.1**2), 1.0 / 0.3**2])
    assert solved["a"].value == pytest.approx(weights @ [1.0, 2.0] / weights.sum(), rel=1e-9)


def test_how_many_numbers_state_what_turns():
    """Matrices row by row, then the translation, then the scale; three numbers a direction."""
    kinds = UnknownKind.ROTATION, UnknownKind.POSE, UnknownKind.SIMILARITY, UnknownKind.DIRECTION, UnknownKind.VECTOR
    assert [stated_width(kind, 3 if kind is not UnknownKind.VECTOR else 0, 7) for kind in kinds] == [9, 12, 13, 3, 7]
    assert [stated_width(kind, 2, 0) for kind in kinds[:3]] == [4, 6, 7]


def test_a_row_at_the_very_time_of_another_needs_no_neighbour_within_the_tolerance():
    """0.5 lies 0.5 from both; 1 and 3 are times of the table themselves, 1.1 is 1.9 from the next."""
    times, table = np.array([0.5, 1.0, 1.1, 3.0]), np.array([0.0, 1.0, 3.0])
    rows, taken = _near_enough(between(times, table), times, table, 0.6)
    assert rows.tolist() == [0, 1, 3]
    assert len(taken.fraction) == 3


def test_one_search_is_one_descent_from_one_start():
    assert asks_for_one_search(Settings())
    assert not asks_for_one_search(Settings(starts=RandomStarts(count=3)))
    assert not asks_for_one_search(Settings(routine="line"))
    assert not asks_for_one_search(Settings(method=Method.CLOSED_FORM))


def test_inputs_of_generated_functions_are_called_as_their_columns():
    cells = [
        ColumnValue(place=RowPlace(table=Foreign("d"), choice=Choice.HERE), owner=Foreign("d"), column=name)
        for name in (Foreign("speed"), None)
    ]
    assert [input_name(cell).unescaped for cell in cells] == ["speed", "row"]


QUALIFIED = (
    "(problem p (data d (table (g t y) (1 0s 1) (1 1s 2) (2 0s 4) (2 1s 6))) {} (observe d (= y {}) :sigma 1) {})"
)


@pytest.mark.parametrize(
    ("clauses", "model", "more"),
    [
        ("(unknowns (x))", "x", "(for-each {}g)"),
        ("(unknowns (x))", "x", "(window {}t :length 2s :step 1s)"),
        ("(states :over {}t (x :init 0 :sigma 9)) (dynamics (random-walk x :sigma 1))", "x", "(solve :method ekf)"),
    ],
)
def test_columns_that_choose_rows_may_be_written_with_their_table(clauses, model, more):
    plain, qualified = (
        mbm.loads(QUALIFIED.format(clauses.format(name), model, more.format(name))).solve() for name in ("", "d.")
    )
    assert [s.key for s in plain.solves] == [s.key for s in qualified.solves]
    assert [np.asarray(s["x"].value).tolist() for s in plain.solves] == [
        np.asarray(s["x"].value).tolist() for s in qualified.solves
    ]


def test_a_qualified_column_that_its_table_has_not_is_named_and_nothing_that_follows_from_it():
    text = QUALIFIED.format("(states :over d.s (x :init 0 :sigma 9))", "x", "(solve :method ekf)")
    (diagnostic,) = refused(text).diagnostics
    assert diagnostic.message == "`s` is no column of `d`"


def test_a_member_is_picked_by_one_key():
    found = refused(QUALIFIED.format("(unknowns (x :per d.g))", "(x g t)", "")).diagnostics
    assert [each.message for each in found] == ["`(x g)` is a number, which cannot be indexed"]


def test_keys_that_are_whole_numbers_are_suggested_as_they_are_written():
    found = refused(QUALIFIED.format("(unknowns (x :per d.g))", "(x g)", "(derive (z (x 11)))")).diagnostics
    assert [each.hint for each in found] == ["did you mean `1`?"]


def test_a_clash_of_constants_shows_where_their_numbers_are_written():
    text = "(problem p (constants (a 1m) (b 2s)) (unknowns (x)) (observe (= x (+ a b)) :sigma 1))"
    (found,) = refused(text).diagnostics
    assert found.code.name == "unit-clash"
    assert [text[each.place.start : each.place.end] for each in found.labels] == ["1m", "2s"]


def test_elements_of_an_array_are_fixed_row_by_row():
    text = """(problem p (unknowns (m (array 2 2) :fixed [[true false] [false true]] :init [[1 2] [3 4]]))
      (observe (= [5 6] (m 1)) (= [7 8] (m 2)) :sigma 1))"""
    assert mbm.loads(text).solve()["m"].value.tolist() == [[1, 6], [7, 4]]
