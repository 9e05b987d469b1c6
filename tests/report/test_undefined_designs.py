"""Designs of quantities that have no value where the model is linearised."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

T = np.array([0.0, 1.0, 2.0, 3.0, 5.0])


@pytest.mark.parametrize("form", ["(sqrt (- a 5))", "(log (- b 9))", "(/ a (- b b))"])
def test_a_quantity_without_a_value_is_not_determined(form: str) -> None:
    """Beside unknowns that the data leave free, too."""
    problem = mbm.loads(f"""(problem p (data d external) (unknowns (a :init 1) (b :init 1) (c :init 1))
      (observe d (= y (+ a (* b t) c)) :sigma 0.1) (derive (w {form}) (v (* 2 b))))""")
    told = {each.name: each.sigma for each in problem.design(data={"d": {"t": T}}).expected}
    assert (told["a"], told["w"]) == (None, None)
    slope = 0.1 / np.sqrt(np.square(T - T.mean()).sum())  # of a line with an offset, a + c
    assert told["v"] == pytest.approx(2.0 * slope, rel=1e-9)
    assert problem.design("w", data={"d": {"t": T}}).sigma is None
