"""Truth values are numbers: where branches tie, both backends answer the same Jacobian."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

HALF = [[0.5, 0.5]]
"""At a tie of `min` or `max` the derivative is the mean of both sides."""

CASES = ["(min a b)", "(max a b)", "(min a (max a b))", "(if (and (< a b) (< b 9)) a (max b a))"]


@pytest.mark.parametrize("form", CASES)
def test_backends_agree_at_ties(form: str) -> None:
    text = f"(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 {form}) :sigma 1))"
    found = [mbm.loads(text).compile(backend=b).jacobian([0.0, 0.0]) for b in ("casadi", "numpy")]
    np.testing.assert_array_equal(found[0], found[1])
    assert np.abs(found[1]).sum() == pytest.approx(1.0, rel=1e-15)


def test_the_two_sides_of_a_tie_share_the_derivative() -> None:
    text = "(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 (min a b)) :sigma 1))"
    jacobian = mbm.loads(text).compile(backend="numpy").jacobian([0.0, 0.0])
    np.testing.assert_allclose(jacobian, HALF, rtol=1e-15)
