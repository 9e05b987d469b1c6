"""Unit inference through whole problems (LANGUAGE §6): clashes with both places, and units of results."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TABLE = "(data t (table (x y) (1s 2m) (2s 5m) (3s 7m)))"


def test_unknowns_take_the_dimension_that_their_uses_ask_for(solve):
    result = solve(f"(problem p {TABLE} (unknowns (v) (d)) (observe t (= y (+ d (* v x)))))")
    assert (result["v"].unit, result["d"].unit) == ("m/s", "m")


def test_files_without_units_just_work(solve):
    result = solve(
        "(problem p (data t (table (x y) (1 2) (2 5))) (unknowns (v)) (observe t (= y (sin (* v x)))) )",
        init={"v": 0.1},
    )
    assert result["v"].unit in (None, "", "1")


def test_unit_of_an_unknown_is_that_of_value_sigma_and_start(solve):
    text = (
        f"(problem p {TABLE} (unknowns (d :unit mm :init 3000mm) (v :unit km/h))"
        " (observe t (= y (+ d (* v x))) :sigma 10cm))"
    )
    result = solve(text)
    matrix = np.array([[1.0, 1], [1, 2], [1, 3]])
    value = np.linalg.lstsq(matrix, [2.0, 5, 7], rcond=None)[0]
    sigma = 0.1 * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert result["d"].unit == "mm"
    np.testing.assert_allclose(
        [result["d"].value, result["d"].sigma], np.array([value[0], sigma[0]]) * 1000, rtol=1e-10
    )
    np.testing.assert_allclose([result["v"].value, result["v"].sigma], np.array([value[1], sigma[1]]) * 3.6, rtol=1e-10)


@pytest.mark.parametrize(
    ("clauses", "place", "labels"),
    [
        ("(unknowns (d :unit m)) (observe t (= y (+ d 3s)))", "(+ d 3s)", ["d", "3s"]),
        ("(unknowns (d)) (observe t (= y (+ d x)))", "(= y (+ d x))", None),
        ("(unknowns (d)) (observe t (= y d) :sigma 1s)", "1s", None),
        ("(unknowns (d)) (observe t (= y d) :covariance 4s^2)", "4s^2", None),
        ("(unknowns (d)) (observe t (= y d) :information 4s^-2)", "4s^-2", None),
        ("(unknowns (d :init 3s)) (observe t (= y d))", "3s", None),
        ("(unknowns (d :in (0s 1s))) (observe t (= y d))", "0s", None),
        ("(unknowns (d)) (observe t (= y (* 1m (exp x))))", "(exp x)", None),
        ("(unknowns (d)) (observe t (= y d)) (derive (e d :unit kg))", "e", None),
        ("(unknowns (d)) (observe t (= y d)) (constraints (normal d 1kg 1m))", "(normal d 1kg 1m)", None),
        ("(unknowns (d)) (observe t (if (< x y) (= y d) (= y d)))", "(< x y)", None),
        ("(unknowns (d angle :unit m)) (observe t (= y d))", None, None),
    ],
)
def test_two_known_dimensions_that_clash(faults, clauses, place, labels):
    diagnostic = faults(f"(problem p {TABLE} {clauses})")[0]
    assert diagnostic.code.name == "unit-clash"
    if place is not None:
        assert diagnostic.place.text == place
    if labels is not None:
        assert [label.place.text for label in diagnostic.labels] == labels


def test_one_column_used_as_length_and_as_time(faults):
    text = (
        "(problem p (data t (table (x) (1) (2))) (unknowns (a :unit m) (b :unit s))"
        " (observe one t (= x a)) (observe two t (= x b)))"
    )
    diagnostic = faults(text)[0]
    assert diagnostic.code.name == "unit-clash"
    assert diagnostic.place.text == "(= x b)"


def test_the_same_column_through_a_join_is_the_same_column(faults):
    text = (
        '(problem p (data s (table (id x) ("n" 1)) :key id) (data t (table (at y) ("n" 1)) :with (s at))'
        " (unknowns (a :unit m) (b :unit s)) (observe s (= x a)) (observe t (= s.x b)))"
    )
    assert faults(text)[0].code.name == "unit-clash"


def test_literals_without_units_take_any(solve):
    result = solve(f"(problem p {TABLE} (unknowns (d :init 2 :in (0 9))) (observe t (= y (+ d 1)) :sigma 0.5))")
    assert result["d"].unit == "m"


def test_cells_state_the_unit_of_a_column_that_is_renamed(solve):
    """The unit is stated once, by the cells; the new name does not lose it."""
    table = "(data t (table (d) (200cm) (4m)) :columns ((height d)))"
    result = solve(f"(problem p {table} (unknowns (h)) (observe t (= height h)))")
    assert (result["h"].unit, result["h"].value) == ("m", pytest.approx(3.0, rel=1e-15))
    with pytest.raises(mbm.MbmError) as caught:
        solve(f"(problem p {table.replace('d)))', 'd :unit m)))')} (unknowns (h)) (observe t (= height h)))")
    assert caught.value.diagnostics[0].code.name == "mixed-units"


def test_a_zero_without_a_unit_is_none_among_degrees_celsius():
    """0 mm is 0 m, and means no harm; 0 °C is 273.15 K."""
    text = "(problem p (data t (table (x y) {} {})) (unknowns (v)) (observe t (= y (* v x)) :sigma 1))"
    assert [d.code.name for d in mbm.loads(text.format("(20degC 1)", "(0 2)")).check()] == ["mixed-units"]
    assert mbm.loads(text.format("(20mm 1)", "(0 2)")).check() == ()


def test_strict_units_want_every_unit(tmp_path):
    file = tmp_path / "p.mbm"
    file.write_text("(problem p (data t (table (x y) (1 2m) (2 5m))) (unknowns (v)) (observe t (= y (* v x))))")
    found = mbm.api.check(file, strict_units=True)
    assert sorted(d.message for d in found) == ["column `x` states no unit", "the unknown `v` states no unit"]
    assert all(d.code.name == "missing-unit" for d in found)
    assert mbm.api.check(file) == ()
