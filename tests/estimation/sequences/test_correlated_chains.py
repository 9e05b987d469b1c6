"""Errors of odometry that are alike: told of transitions and of rows between neighbours; drawn by NumPy alone."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.trust.chains import sums
from tests.estimation.sequences.drives import twelve

WALK = """(problem walk (data fixes external) (data odo external)
  (states :over k (x :init 0 :sigma 10))
  (dynamics (= (next x) (+ x odo.d) :sigma 0.1))
  (observe fixes (= y x) :sigma {sigma}))"""
FAMILY = """(problem walk (data places external :key k) (data fixes external) (data odo external)
  (unknowns (x :per places :init 0))
  (observe odo (= d (- (x to) (x from))) :sigma 0.1)
  (observe fixes (= y (x k)) :sigma {sigma}))"""


EARLIER = """(problem lagged (data d external) (unknowns (a :init 1))
  (observe d (= y (* a (previous u))) :sigma {sigma}))"""


def walk(seed, drift, count=80, every=4, sigma=0.3):
    """Steps of a walk, wrong by 0.1 each, and by a drift of as many standard deviations; tables of both problems."""
    g = np.random.default_rng(seed)
    moved = g.normal(size=count - 1)
    k = np.arange(0, count, every)
    y = np.concatenate([[0.0], np.cumsum(moved)])[k] + sigma * g.normal(size=len(k))
    d = moved + 0.1 * g.normal(size=count - 1) + 0.1 * drift
    number = np.arange(count)
    states = {"fixes": {"k": k, "y": y}, "odo": {"k": number[1:], "d": d}}
    family = {
        "places": {"k": number},
        "fixes": {"k": k, "y": y},
        "odo": {"from": number[:-1], "to": number[1:], "d": d},
    }
    return {WALK: states, FAMILY: family}


def told(text, data, sigma=0.3):
    """The warnings of correlation."""
    solve = mbm.loads(text.format(sigma=sigma)).solve(data=data).first
    return [each for each in solve.diagnostics if each.code.name == "autocorrelated-residuals"]


@pytest.mark.parametrize("decay", [0.0, 0.8])
def test_sums_are_those_of_their_definition(decay):
    e = np.random.default_rng(0).normal(size=(30, 2))
    weights = np.array([[decay ** (i - j - 1) if i > j else 0.0 for j in range(30)] for i in range(30)])
    expected = np.einsum("ik,ij,jk->k", e, weights, e) / np.square(e).sum(axis=0)
    assert sums(e, decay) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("text", "name", "mend"), [(WALK, "the transition", "random-walk"), (FAMILY, "`odo`", ":per")])
def test_a_drift_is_told_with_the_clause_and_what_to_write(text, name, mend):
    (warning,) = told(text, walk(1, drift=2.0)[text])
    assert f"errors of {name} are positively correlated" in warning.message
    assert mend in warning.hint


@pytest.mark.parametrize("text", [WALK, FAMILY])
def test_what_it_says_to_write_mends_it(text):
    old, new = (
        ("(+ x odo.d)", "(+ x odo.d b)") if text is WALK else ("(- (x to) (x from))", "(+ b (- (x to) (x from)))")
    )
    mended = text.replace(old, new)
    if text is WALK:
        mended = mended.replace(":sigma 10))", ":sigma 10)) (unknowns (b :init 0))")
    else:
        mended = mended.replace(":init 0))", ":init 0) (b :init 0))")
    assert not told(mended, walk(1, drift=2.0)[text])


@pytest.mark.parametrize("text", [WALK, FAMILY])
@pytest.mark.parametrize("seed", range(3))
def test_independent_errors_are_not(text, seed):
    assert not told(text, walk(seed, drift=0.0)[text])


def test_steps_beside_fixes_that_are_stated_too_uncertain_are_not_called_correlated():
    """Their residuals follow fixes ten times as good as stated: told by chance of 1 % of 60, and four deviations;
    by the stated deviations alone it were a sixth of them."""
    compiled = mbm.loads(FAMILY.format(sigma=3.0)).compile()
    found = 0
    for seed in range(60):
        solve = compiled.solve(data=walk(seed, 0.0)[FAMILY]).first
        found += any("errors of `odo`" in each.message for each in solve.diagnostics)
    assert found <= 3


@pytest.mark.parametrize("factor", [30.0, 1000.0])
def test_a_drift_is_told_however_much_too_large_all_noise_is_stated(factor):
    """One factor of all noise changes no residual's share of the sums."""
    text = FAMILY.replace(":sigma 0.1)", f":sigma {0.1 * factor})")
    assert told(text, walk(1, drift=2.0)[FAMILY], sigma=0.3 * factor)


@pytest.mark.parametrize(("drift", "expected"), [(0.0, False), (2.0, True)])
def test_of_long_chains_as_well(drift, expected):
    """So many places that the sparse solver takes them."""
    assert bool(told(FAMILY, walk(2, drift, count=1200)[FAMILY])) == expected


@pytest.mark.parametrize("drift", [0.0, 0.7])
def test_of_each_of_many_keys_as_of_one(drift):
    data = walk(1, drift)[FAMILY]
    one = mbm.loads(FAMILY.format(sigma=0.3)).solve(data=data).first
    each = mbm.loads(FAMILY.format(sigma=0.3)[:-1] + " (for-each run))").solve(data=twelve(data))
    said = [[told.message for told in solve.diagnostics] for solve in (one, *each.solves)]
    assert said == 13 * [said[0]]
    assert any("errors of `odo` are positively correlated" in message for message in said[0]) == (drift > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "every"), [(30, 3), (60, 4)])
def test_by_chance_in_one_of_a_hundred(count, every):
    """Of 1,000 runs 1 % and its four standard deviations."""
    compiled = mbm.loads(WALK.format(sigma=1)).compile()
    found = 0
    for seed in range(1000):
        solve = compiled.solve(data=walk(seed, 0.0, count, every, 1.0)[WALK]).first
        found += any(each.code.name == "autocorrelated-residuals" for each in solve.diagnostics)
    assert found <= 10 + 4 * np.sqrt(1000 * 0.01 * 0.99)


@pytest.mark.slow
def test_rows_with_previous_are_tested_once():
    """Of 1,000 runs 1 % and its four standard deviations; with the test of neighbours in addition it were 4 %."""
    compiled = mbm.loads(EARLIER.format(sigma=0.1)).compile()
    found = 0
    for seed in range(1000):
        g = np.random.default_rng(seed)
        u = g.normal(size=40)
        y = np.concatenate([[0.0], u[:-1]]) + 0.1 * g.normal(size=40)
        solve = compiled.solve(data={"d": {"u": u, "y": y}}).first
        found += any(each.code.name == "autocorrelated-residuals" for each in solve.diagnostics)
    assert found <= 10 + 4 * np.sqrt(1000 * 0.01 * 0.99)


@pytest.mark.parametrize("text", [WALK, FAMILY, EARLIER])
@pytest.mark.parametrize(("factor", "small"), [(1.0, True), (50.0, False)])
def test_deviations_are_not_called_too_small_where_the_noise_is_stated_too_large(text, factor, small):
    if text is EARLIER:
        u = np.ones(80)
        data = {"d": {"u": u, "y": 1 + 0.1 * np.sin(np.arange(80) / 5)}}
        (warning,) = told(text, data, 0.05 * factor)
    else:
        data = walk(1, drift=2.0)[text]
        (warning,) = told(text.replace(":sigma 0.1", f":sigma {0.1 * factor}"), data, 0.3 * factor)
    assert ("the standard deviations are too small" in warning.message) == small
    assert ("were the stated noise as small" in warning.message) != small


@pytest.mark.parametrize(
    ("text", "data"),
    [
        (WALK, {"fixes": {"k": np.arange(40), "y": np.zeros(40)}, "odo": {"k": np.arange(1, 40), "d": np.zeros(39)}}),
        (EARLIER, {"d": {"u": np.ones(40), "y": np.full(40, 2.0)}}),
    ],
)
def test_an_exact_fit_tells_nothing_of_its_errors(text, data):
    assert not told(text, data)


def test_a_coordinate_that_is_fitted_exactly_leaves_those_beside_it_to_be_told():
    text = """(problem walk (data places external :key k) (data fixes external) (data odo external)
      (unknowns (p (vector 2) :per places :init [0 0]))
      (observe odo (= [d e] (- (p to) (p from))) :sigma 0.1)
      (observe fixes (= [y z] (p k)) :sigma {sigma}))"""
    for drift, expected in ((0.0, 0), (2.0, 1)):
        data = walk(1, drift)[FAMILY]
        flat = {"odo": {"e": np.zeros(79)}, "fixes": {"z": np.zeros(20)}}
        warnings = told(text, {name: {**table, **flat.get(name, {})} for name, table in data.items()})
        assert len(warnings) == expected
        assert all("nan" not in each.message for each in warnings)
