"""StRD as problem files, with default settings: both starts, certified digits of estimates and standard deviations."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.nist import MODELS, digits
from tests.estimation.nist_typed import TYPED
from tests.evidence.nist_problems import FORMULAS, problem_file

BY_NAME = {reference.name: reference for reference in TYPED}


def estimates(solved, reference):
    names = [f"b{i}" for i in range(1, len(reference.certified) + 1)]
    return np.array([[float(solved[n].value), float(solved[n].sigma)] for n in names]).T


@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("name", BY_NAME)
def test_certified_digits_with_default_settings(name, start, tmp_path):
    reference = BY_NAME[name]
    solved = mbm.load(problem_file(reference, start, tmp_path)).solve()
    assert solved.status == "ok"
    found, sigma = estimates(solved, reference)
    # Eleven digits are certified; eight leave room for the conditioning of the worst sets (9.3 is the fewest seen).
    assert digits(found, reference.certified) >= 8
    # Lanczos1 fits to the last digit of its data: its residuals, and so its deviations, are rounding.
    assert digits(sigma, reference.deviations) >= (2.5 if name == "Lanczos1" else 6)
    assert solved.first.dof == len(reference.y) - len(reference.certified)
    if name != "Lanczos1":
        assert solved.first.cost == pytest.approx(reference.sum_of_squares, rel=1e-8)


@pytest.mark.parametrize("name", BY_NAME)
def test_formulas_as_written_are_the_models(name, tmp_path):
    """The residuals at the first start, against the model in NumPy."""
    reference = BY_NAME[name]
    compiled = mbm.load(problem_file(reference, 0, tmp_path)).compile()
    start = reference.starts[0]
    residuals = compiled.residuals(np.zeros(start.size))
    model = MODELS[name](start, reference.x)
    # Model minus measured, in another order of operations: a few roundings of the larger of the two.
    size = np.abs(model) + np.abs(reference.y)
    assert np.max(np.abs(residuals - (model - reference.y)) / size) < 1e-13


def test_every_model_is_written_in_the_language():
    assert FORMULAS.keys() == MODELS.keys()
