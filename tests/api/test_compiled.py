"""``Problem.compile``: many solves of one compilation, residuals and Jacobian, CasADi and SymPy."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

import mbm
from tests.api.conftest import RECEIVERS, SIGMA, distances, measured
from tests.api.test_solving import Ranges


@pytest.fixture
def compiled(problem: mbm.Problem, ranges: Ranges) -> mbm.CompiledProblem:
    return problem.compile(data={"ranges": ranges})


def _document(solved: mbm.Solved) -> dict[str, object]:
    found = solved.document()
    for solve in found["solves"]:
        solve.pop("seconds")
    return found


def test_repeated_solves_equal_fresh_ones(problem: mbm.Problem, compiled: mbm.CompiledProblem) -> None:
    """Other positions, other noise, fewer rows: to the last bit, for nothing is carried over."""
    for seed, x in enumerate((1.2, 2.5, 3.0)):
        data = {"ranges": measured(x=x, seed=seed)}
        assert _document(compiled.solve(data=data)) == _document(problem.solve(data=data))
    fewer = {"ranges": {name: column[:4] for name, column in measured().items()}}
    assert _document(compiled.solve(data=fewer)) == _document(problem.solve(data=fewer))
    assert _document(compiled.solve()) == _document(problem.solve(data={"ranges": measured()}))


def test_wrong_data_for_a_compiled_problem(compiled: mbm.CompiledProblem, ranges: Ranges) -> None:
    bad = {**ranges, "range": np.array([1.0, np.nan, 2.0, 3.0, 4.0])}
    with pytest.raises(mbm.MbmError, match="not-finite-cell"):
        compiled.solve(data={"ranges": bad})
    with pytest.raises(mbm.MbmError, match="dangling-key"):
        compiled.solve(data={"ranges": {**ranges, "receiver": np.arange(5.0)}})
    assert compiled.solve(data={"ranges": ranges}).status == "ok"


def test_data_that_change_the_equations_compile_again() -> None:
    """A static column: the index of a vector is part of the equation."""
    text = "(problem p (data d external) (unknowns (v (vector 3) :init [0 0 0])) (observe d (= y (v k)) :sigma 1))"
    compiled = mbm.loads(text).compile(data={"d": {"y": [1.0, 2.0, 3.0], "k": [1, 2, 3]}})
    np.testing.assert_allclose(compiled.solve()["v"].value, [1, 2, 3])
    other = compiled.solve(data={"d": {"y": [1.0, 2.0, 3.0], "k": [3, 2, 1]}})
    np.testing.assert_allclose(other["v"].value, [3, 2, 1])


@pytest.mark.parametrize("backend", ["auto", "native", "casadi", "numpy"])
def test_residuals_and_jacobian_about_the_start(backend: str, problem: mbm.Problem, ranges: Ranges) -> None:
    compiled = problem.compile(data={"ranges": ranges}, backend=backend)
    start = np.ones(3)
    for step in (np.zeros(3), np.array([0.1, -0.2, 0.3])):
        point = start + step
        residuals = (distances(point) - ranges["range"]) / SIGMA
        jacobian = (point - RECEIVERS) / distances(point)[:, None] / SIGMA
        # A dozen operations on numbers of size 1, divided by 5 mm: rounding of about 1e-13.
        np.testing.assert_allclose(compiled.residuals(step), residuals, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(compiled.jacobian(step), jacobian, rtol=1e-12, atol=1e-11)


def test_backends_agree(problem: mbm.Problem, ranges: Ranges) -> None:
    answers = [problem.solve(data={"ranges": ranges}, backend=name)["p"].value for name in ("casadi", "numpy")]
    np.testing.assert_allclose(answers[0], answers[1], rtol=1e-10)


def test_casadi_functions(problem: mbm.Problem, compiled: mbm.CompiledProblem, ranges: Ranges) -> None:
    import casadi

    found = problem.casadi(data={"ranges": ranges})
    assert found.keys() == compiled.casadi().keys() == {"ranges/1", "height/1"}
    function = found["ranges/1"]
    assert isinstance(function, casadi.Function)
    assert function.size1_out(0) == 1 + 3  # a residual, and its derivatives by the three coordinates


def test_equations_are_sympy(problem: mbm.Problem, ranges: Ranges) -> None:
    ((equation,),) = problem.equations(data={"ranges": ranges}).values()
    assert isinstance(equation, sympy.Expr)
    names = {symbol.name: symbol for symbol in equation.free_symbols}
    assert {"p[1]", "p[2]", "p[3]", "range", "receivers.x"} <= names.keys()
    numbers = {
        "p[1]": 1,
        "p[2]": 2,
        "p[3]": 3,
        "receivers.x": 4,
        "receivers.y": 6,
        "receivers.z": 3,
        "range": 2,
        "offset": 1,
    }
    value = equation.subs({symbol: numbers[name] for name, symbol in names.items()})
    assert float(value) == pytest.approx(1 + 5 - 2)  # offset + distance − range: a 3-4-5 triangle
