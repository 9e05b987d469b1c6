"""Starts from outside: whole values only."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mbm

TEXT = """
(problem p
  (data d (table (k x y z) (1 0 2 3) (1 1 4 5) (2 0 3 1) (2 1 5 3)))
  (unknowns (a :init 1) (v (vector 2) :init [1 1] :per d.k))
  (observe d (= [y z] (+ (v k) [(* a x) (* a x)])) :sigma 1))
"""


@pytest.fixture(scope="module")
def compiled() -> mbm.CompiledProblem:
    return mbm.loads(TEXT).compile()


@pytest.mark.parametrize("missing", [None, math.nan, np.nan])
@pytest.mark.parametrize("form", [lambda rows: rows, lambda rows: {"keys": [1, 2], "value": rows}])
def test_values_of_which_some_numbers_are_missing(missing: Any, form: Any, compiled: mbm.CompiledProblem) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        compiled.solve(init={"v": form([[1.0, 2.0], [3.0, missing]])})
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "bad-initial-values"
    assert "the initial value of `v` is incomplete" in diagnostic.message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, {"value": math.nan, "unit": ""}])
def test_values_that_are_no_numbers(value: Any, compiled: mbm.CompiledProblem) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        compiled.solve(init={"a": value})
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "bad-initial-values"
    assert "the initial value of `a` is not finite" in diagnostic.message


@pytest.mark.parametrize("value", [[[math.inf, 1.0], [1.0, 2.0]], [[math.nan, math.nan]] * 2])
def test_values_of_members_that_are_no_numbers(value: Any, compiled: mbm.CompiledProblem) -> None:
    with pytest.raises(mbm.MbmError, match="the initial value of `v` is not finite"):
        compiled.solve(init={"v": value})


def test_members_and_unknowns_without_a_start_may_be_left_out(compiled: mbm.CompiledProblem) -> None:
    """The model is affine with a slope of 2: y = (2, 3) + 2 x, z = (3, 1) + 2 x; whatever it starts from."""
    found = compiled.solve(init={"a": None, "v": [[1.0, 2.0], [None, None]]})
    # Numbers up to 5, one step: rounding.
    np.testing.assert_allclose(found["v"].value, [[2.0, 3.0], [3.0, 1.0]], atol=1e-12)
    assert found["a"].value == pytest.approx(2.0, abs=1e-12)


def test_a_value_for_all_members_is_whole_too(compiled: mbm.CompiledProblem) -> None:
    with pytest.raises(mbm.MbmError, match="the initial value of `v` is incomplete"):
        compiled.solve(init={"v": [1.0, math.nan]})
