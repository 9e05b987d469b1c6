"""Sums of many piecewise terms, and equations of so many unknowns that their derivatives would not fit the memory."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

import mbm
from mbm.files.memory import VARIABLE
from mbm.kernels import derive
from mbm.text.types import MbmError

TERMS = 12


def test_the_slope_of_a_sum_of_choices_is_that_of_the_branches_taken():
    text = (
        "(problem p (unknowns (a :init 4.5) (b :init 2))"
        f" (observe (= 0 (sum (i 1 {TERMS}) (if (< a i) (* a i) (* b (if (< b i) a (* a b)))))) :sigma 1))"
    )
    found = mbm.loads(text).compile(backend="numpy").jacobian(np.zeros(2))
    a, b, slope = 4.5, 2.0, np.zeros(2)
    for i in range(1, TERMS + 1):
        slope += (i, 0.0) if a < i else (b, a) if b < i else (b * b, 2 * a * b)
    # The residual is the model less the measurement. Sums of a dozen numbers below 100, each exact.
    assert found == pytest.approx(slope[None], abs=1e-12)


def test_a_sum_is_gone_through_once_however_many_choices_it_holds(monkeypatch):
    sizes, real = [], casadi.jacobian

    def counted(*given):
        sizes.append(given[0].numel())
        return real(*given)

    monkeypatch.setattr(derive.casadi, "jacobian", counted)
    counts = []
    for terms in (10, 40):
        sizes.clear()
        text = f"(problem p (unknowns (a :init 1)) (observe (= 0 (sum (i 1 {terms}) (if (< a i) (* a i) 1))) :sigma 1))"
        mbm.loads(text).compile(backend="numpy").jacobian(np.zeros(1))
        counts.append(len(sizes) - 2 * terms)
    assert counts[0] == counts[1]


def test_derivatives_that_do_not_fit_are_refused(monkeypatch):
    text = "(problem p (unknowns (v (vector 300) :init 1)) (observe (= 0 (norm v)) :sigma 1))"
    monkeypatch.setenv(VARIABLE, "35MB")
    with pytest.raises(MbmError) as caught:
        mbm.loads(text).solve()
    assert [each.code.name for each in caught.value.diagnostics] == ["too-much-memory"]
    assert "300 unknown numbers" in caught.value.diagnostics[0].message
    monkeypatch.setenv(VARIABLE, "37MB")
    assert mbm.loads(text).solve().status == "attention"
