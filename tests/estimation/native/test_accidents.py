"""Bounds that are touched by accident: no backend takes them for ones that hold, and all list the same minima."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

ROWS = {
    "sum": "(0.3 -2.642) (1.2 4.031) (2.1 2.076) (3 1.046)",
    "line": "(0.3 -0.671) (1.65 -0.109) (3 0.988)",
    "decay": "(0.3 1.889) (1.65 -1.771) (3 -0.309)",
    "offset": "(0.3 -1.775) (3 1.172)",
}
CASES = {
    "sum": ("(a :init 0.723 :in (-1.25 0.77)) (b :init -0.417 :in (-1.29 1.8))", "(+ (* a t) (* b t))", 12),
    "line": ("(a :init -0.561 :in (-1.43 0.72)) (b :init -0.212 :in (-0.78 2.2))", "(+ (* a t) (* b t))", 12),
    "decay": (
        "(a :init -0.532 :in (-1.9 0.84)) (b :init -0.281 :in (-2.88 1.74)) (c :init -0.951 :in (-2.52 0.33))",
        "(* c a (exp (* b t)))",
        1,
    ),
    "offset": (
        "(a :init -0.055 :in (-0.88 0.26)) (b :init -0.382 :in (-0.72 0.24)) (c :init 2.319 :in (-2.59 2.46))",
        "(+ (* a b) c)",
        12,
    ),
}
"""Only sums or products of some unknowns are determined; the minima form lines that end at bounds."""


@pytest.mark.parametrize("name", CASES)
def test_backends_agree_where_a_valley_ends_at_bounds(name):
    unknowns, model, starts = CASES[name]
    text = (
        f"(problem p (data d (table (t y) {ROWS[name]})) (unknowns {unknowns})"
        f" (observe d (= y {model}) :sigma 0.1) (solve :starts (random {starts})))"
    )
    native, plain = (mbm.loads(text).solve(backend=backend).first for backend in ("native", "numpy"))
    assert native.status is plain.status
    assert native.status == "unobservable"
    assert [e.at_bound.any() for e in native.estimates] == [e.at_bound.any() for e in plain.estimates]
    # Both are minima to 1e-10 standard deviations; costs agree to the square of that, which rounding covers.
    assert native.cost == pytest.approx(plain.cost, rel=1e-9)
    assert len(native.alternatives) == len(plain.alternatives)
    for mine, theirs in zip(native.alternatives, plain.alternatives, strict=True):
        assert mine.cost == pytest.approx(theirs.cost, rel=1e-9)


@pytest.mark.parametrize("backend", ["native", "numpy"])
@pytest.mark.parametrize(("bound", "held"), [(3.0, True), (4.0, False), (5.0, False)])
def test_a_bound_holds_where_the_data_push_against_it(backend, bound, held):
    """The mean of 3, 4, 5 under a bound below it, at it, and above it."""
    text = (
        "(problem p (data d (table (y) (3) (4) (5))) (unknowns (a :init 2 :in (0 %s)))"
        " (observe d (= y (log (exp a))) :sigma 1))"
    )
    solve = mbm.loads(text % bound).solve(backend=backend).first
    (estimate,) = solve.estimates
    assert bool(estimate.at_bound.any()) is held
    assert float(np.asarray(estimate.value)) == pytest.approx(min(bound, 4.0), rel=1e-9)  # far beyond the stopping rule
    if not held:
        assert float(np.asarray(estimate.sigma)) == pytest.approx(1 / np.sqrt(3), rel=1e-9)
