"""Which columns of which observations are corrected, as the problem says before any solve."""

from __future__ import annotations

import mbm
from mbm.problem.types import UncertainColumn

TABLES = """
  (data sites (table (site height e) (1 0.2 0.01) (2 0.3 0.01)) :key site)
  (data poles (table (pole site x) (1 1 0.0) (2 2 5.0)) :key pole :with (sites site))
  (data ranges (table (pole r) (1 1.0) (2 2.0)) :with (poles pole) :with (again poles pole))
  (unknowns (a :init 1) (b :init 1))
"""


def errors(clauses: str) -> dict[str, dict[str, UncertainColumn]]:
    """The uncertain columns of each observation, by the name that it has for them."""
    problem = mbm.loads(f"(problem p {TABLES} {clauses})").compile().elaborated.problem
    return {block.name: {error.name: error for error in block.errors} for block in problem.blocks}


def test_a_column_is_corrected_where_it_was_measured_through_two_joins() -> None:
    found = errors(
        "(observe ranges (= r (+ a b poles.sites.height)) :errors ((poles.sites.height poles.sites.e)) :sigma 1)"
    )
    column = found["ranges"]["poles.sites.height"]
    assert (column.table, column.column, column.key) == ("sites", "height", "poles.site")


def test_two_names_of_one_value_are_one_error() -> None:
    found = errors("(observe ranges (= r (+ a b poles.x again.x)) :errors ((poles.x 0.1)) :sigma 1)")["ranges"]
    assert {(c.table, c.column, c.key) for c in found.values()} == {("poles", "x", "pole")}
    assert found["poles.x"].sigma is not None
    assert found["again.x"].sigma is None


def test_other_observations_that_use_the_value_correct_it_too_priors_do_not() -> None:
    found = errors(
        """
        (observe one ranges (= r (+ a poles.x)) :errors ((poles.x 0.1)) :sigma 1)
        (observe two poles (= x (+ b 1)) :sigma 1)
        (observe three poles (= pole b) :sigma 1)
        (constraints (normal a 1 (first poles x)))
        """
    )
    assert [list(found[name]) for name in ("one", "two", "three")] == [["poles.x"], ["x"], []]
    assert found["two"]["x"].key is None
    assert all(not columns for name, columns in found.items() if name not in ("one", "two"))


def test_the_own_noise_is_nothing_unless_it_is_stated() -> None:
    clauses = (
        "(observe bare ranges (= r (+ a b)) :errors ((r 0.1))) (observe both ranges (= r a) :errors ((r 0.1)) :sigma 2)"
    )
    problem = mbm.loads(f"(problem p {TABLES} {clauses})").compile().elaborated.problem
    noise = {block.name: block.cases[0].equations[0].noise[0].value for block in problem.blocks}
    assert noise == {"bare": 0, "both": 2}
    assert not any(block.unknown_factor for block in problem.blocks)
