"""Backends agree with one another, for any number of rows, and NumPy's own derivative of the model."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.kernels.backends.automatic import MANY
from mbm.kernels.backends.casadi_map import MAPPED_ROWS
from tests.evidence.material import loaded

TEXT = """
(problem stations
  (data marks external)
  (unknowns (p (vector 3) :init [1.7m 1.6m 0.8m]) (bias :per marks.station :init 0m :fixed (= station 2)))
  (observe marks (= range (+ (bias station) (distance p [x y z]))) :sigma 10mm))
"""


def marks(rows):
    generator = np.random.default_rng(rows)
    at = generator.uniform([0, 0, 2], [3, 3, 3], (rows, 3))
    return {
        "station": np.arange(rows) % 3,
        "x": at[:, 0],
        "y": at[:, 1],
        "z": at[:, 2],
        "range": np.linalg.norm(at - [1.7, 1.6, 0.8], axis=1) + 0.01 * generator.standard_normal(rows),
    }


def derivative(columns, place):
    """∂range/∂(p, bias of stations 0 and 1) in standard deviations; station 2 is held."""
    away = place - np.column_stack([columns[c] for c in "xyz"])
    slopes = away / np.linalg.norm(away, axis=1)[:, None]
    biases = columns["station"][:, None] == [0, 1]
    return np.hstack([slopes, biases]) / 0.01


# Row numbers on both sides of every limit: one row, the change of backend, whole blocks of CasADi's map and a rest.
@pytest.mark.parametrize("rows", [3, MANY - 1, MANY, MAPPED_ROWS, MAPPED_ROWS + 1, 2 * MAPPED_ROWS + 77, 5000])
def test_residuals_and_jacobian_of_all_backends(rows):
    columns = marks(rows)
    step = np.array([0.1, -0.2, 0.05, 0.02, -0.01])
    place = np.array([1.7, 1.6, 0.8]) + step[:3]
    distances = np.linalg.norm(place - np.column_stack([columns[c] for c in "xyz"]), axis=1)
    expected = (distances + np.array([0.02, -0.01, 0.0])[columns["station"]] - columns["range"]) / 0.01
    for backend in ("casadi", "numpy", "auto"):
        compiled = mbm.loads(TEXT).compile(data={"marks": columns}, backend=backend)
        # Roundings of the distance (a few metres) divided by 10 mm.
        np.testing.assert_allclose(compiled.residuals(step), expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(compiled.jacobian(step), derivative(columns, place), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rows", [60, 3000])
def test_estimates_of_all_backends_and_of_normal_equations(rows):
    columns = marks(rows)
    solved = {b: mbm.loads(TEXT).solve(data={"marks": columns}, backend=b) for b in ("casadi", "numpy", "auto")}
    matrix = derivative(columns, solved["casadi"]["p"].value)
    covariance = np.linalg.inv(matrix.T @ matrix)
    for each in solved.values():
        assert each.status == "ok"
        # The same minimum to a small part of a standard deviation, by sums in another order.
        np.testing.assert_allclose(each["p"].value, solved["casadi"]["p"].value, rtol=0, atol=1e-11)
        np.testing.assert_allclose(each["p"].sigma, np.sqrt(np.diag(covariance))[:3], rtol=1e-8)
        assert each["bias"].sigma[2] == 0


def test_one_compiled_problem_for_streams_of_any_length():
    """Kernels prepared for one number of rows must not be met by data of another."""
    compiled = mbm.loads(TEXT).compile(data={"marks": marks(30)})
    for rows in (30, 12, 500, 30, 3000):
        again = compiled.solve(data={"marks": marks(rows)})
        alone = mbm.loads(TEXT).solve(data={"marks": marks(rows)})
        np.testing.assert_array_equal(again["p"].value, alone["p"].value)


def test_no_row_is_left_out_by_blocks(tmp_path):
    """A mean over several blocks of rows: the one estimate that every row moves."""
    rows = 2 * 2048 + 2 * 1024 + 5
    values = np.random.default_rng(4).normal(3.0, 1.0, rows)
    text = '(problem mean (data d (csv "d.csv")) (unknowns (m :init 0)) (observe d (= y m) :sigma 1))'
    solved = loaded(tmp_path, text, d={"y": values.tolist()}).solve()
    # A linear problem: one step, exact to rounding.
    assert float(solved["m"].value) == pytest.approx(values.mean(), rel=1e-12)
    assert float(solved["m"].sigma) == pytest.approx(1 / np.sqrt(rows), rel=1e-12)
