"""Which minimum is the answer where a closed form leads to another one: the rule in the three languages."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mbm.solver.decisions import LOWER, ROUNDED_FIT

ROUNDING = 1e-15


@pytest.mark.parametrize(
    ("cost", "other", "wanted"),
    [
        (1.0, 1.0 - 2 * LOWER, 1),
        (1.0, 1.0 - LOWER / 2, 0),  # the same but for what tolerances leave
        (1.0, 1.0, 0),
        (1.0, np.nan, 0),
        (np.inf, 3.0, 1),
        (np.nan, 3.0, 1),
        (np.inf, np.inf, 0),
        ((ROUNDED_FIT * ROUNDING) ** 2, 0.0, 0),  # two exact fits
        (1.1 * (ROUNDED_FIT * ROUNDING) ** 2, 0.0, 1),
        (0.0, 0.0, 0),
    ],
)
def test_another_minimum_takes_over_where_it_costs_less_than_tolerances_and_rounding_explain(
    solver, cost, other, wanted
):
    assert solver("takes_over", cost, other, ROUNDING) == wanted


@pytest.mark.parametrize(
    ("cost", "form", "away", "most", "wanted"),
    [
        (1.0, 0.9, 0.1, 5.0, 1),
        (1.0, 1.1, 0.1, 5.0, 0),  # in the basin of the minimum
        (1.0, 1.13, 0.1, 5.0, 0),
        (1.0, 1.1, 8.0, 5.0, 1),  # far beyond it, and as good
        (1.0, 2e4, 8.0, 5.0, 0),
        (1.0, 1.1, np.nan, 5.0, 0),
        (6.0, 9.0, 3.0, 5.0, 1),  # noise does not explain what was found
        (6.0, 9.0, 3.0, np.inf, 0),
        (6.0, np.inf, np.inf, 5.0, 0),
        (np.nan, 9.0, np.nan, 5.0, 1),
        (1e-32, 0.0, 1.0, 5.0, 0),
        (1e-32, 2.0, 1.0, 5.0, 0),  # nothing is better than an exact fit
    ],
)
def test_a_closed_form_is_followed_where_it_costs_less_or_lies_elsewhere_or_noise_does_not_explain_the_cost(
    solver, cost, form, away, most, wanted
):
    assert solver("worth_following", cost, form, away, most, ROUNDING) == wanted


@pytest.mark.parametrize("freedom", [1, 2, 5, 20, 200])
def test_a_usual_cost_is_hardly_ever_exceeded(solver, freedom):
    most = solver("usual_cost", float(freedom))
    # Five deviations of a normal law are 6e-7; few degrees of freedom have a longer tail.
    assert stats.chi2.sf(most, freedom) < 5e-3
    assert stats.chi2.sf(most, freedom) > 2e-7


def test_without_degrees_of_freedom_a_usual_cost_is_that_of_one(solver):
    assert solver("usual_cost", 0.0) == solver("usual_cost", 1.0)


def test_a_solution_is_plausible_up_to_a_multiple_of_the_best_cost(solver):
    assert solver("plausible", 999.0, 0.0) == 1
    assert solver("plausible", 1e6, 1.0) == 0
    assert solver("plausible", 1e6, 1e3) == 1
