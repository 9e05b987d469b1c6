"""All solves together: where not one of them could be set up there is no result, but what is wrong."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TEXT = "(problem p (data d external) (unknowns (a :init 1)) (observe d (= y {model}) :sigma s) {each})"
MODELS = ["a", "(exp a)"]
SOLVES = ["(for-each k)", "(window k :length 1 :step 1)"]


def table(sigma: list[float]) -> dict[str, list[float]]:
    """Three sets of two rows; each set has a sigma."""
    return {"k": [1, 1, 2, 2, 3, 3], "y": [1, 2, 3, 4, 5, 6], "s": np.repeat(sigma, 2).tolist()}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("each", SOLVES)
def test_nothing_is_solved_where_no_solve_can_be_set_up(model: str, each: str) -> None:
    """Each kind of mistake is named once, however many solves have it."""
    problem = mbm.loads(TEXT.format(model=model, each=each))
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(data={"d": table([0.0, -1.0, -2.0])})
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == "bad-noise"
    assert diagnostic.message == "a sigma is 0"


@pytest.mark.parametrize("model", MODELS)
def test_one_solve_that_can_be_set_up_is_a_result(model: str) -> None:
    problem = mbm.loads(TEXT.format(model=model, each="(for-each k)"))
    found = problem.solve(data={"d": table([0.0, 1.0, -2.0])})
    assert [solve.status for solve in found.solves] == ["not-converged", "converged", "not-converged"]
    mean = 3.5
    # One number above one: rounding, or a quadratically convergent iteration stopped within it.
    assert found.solves[1].estimates[0].value == pytest.approx(mean if model == "a" else np.log(mean), rel=1e-9)


def test_a_start_for_no_unknown_is_told_of_all_solves_at_once() -> None:
    problem = mbm.loads(TEXT.format(model="a", each="(for-each k)"))
    with pytest.raises(mbm.MbmError, match="bad-initial-values"):
        problem.solve(data={"d": table([1.0, 1.0, 1.0])}, init={"b": 2.0})
