"""``Problem.solve``: data, constants, starts; what ``Solved`` answers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import mbm
from tests.api.conftest import SIGMA, gauss_newton, measured

CLOSE = 1e-9
"""Relative: both stop at the minimum to rounding, amplified by a condition below 100."""

Ranges = dict[str, NDArray[np.float64]]


def _frame(given: Ranges) -> object:
    return pytest.importorskip("pandas").DataFrame(given)


def _indexed_frame(given: Ranges) -> object:
    return pytest.importorskip("pandas").DataFrame(given, index=[f"row {i}" for i in range(5)])


def _structured(given: Ranges) -> object:
    made = np.zeros(5, dtype=[("receiver", "i4"), ("range", "f8")])
    for name, column in given.items():
        made[name] = column
    return made


def _polars(given: Ranges) -> object:
    return pytest.importorskip("polars").DataFrame(given)


def _records(given: Ranges) -> object:
    return [{"receiver": int(k), "range": float(v)} for k, v in zip(given["receiver"], given["range"], strict=True)]


def _lists(given: Ranges) -> object:
    return {name: column.tolist() for name, column in given.items()}


@pytest.mark.parametrize("form", [dict, _lists, _frame, _indexed_frame, _structured, _records, _polars])
def test_tables_in_every_form(form: Callable[[Ranges], object], problem: mbm.Problem, ranges: Ranges) -> None:
    point, covariance = gauss_newton(ranges["range"])
    found = problem.solve(data={"ranges": form(ranges)})["p"]
    np.testing.assert_allclose(found.value, point, rtol=CLOSE)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(covariance)), rtol=1e-7)


def test_given_tables_are_not_changed(problem: mbm.Problem, ranges: Ranges) -> None:
    before = {name: column.copy() for name, column in ranges.items()}
    problem.solve(data={"ranges": ranges})
    for name, column in before.items():
        np.testing.assert_array_equal(ranges[name], column)


@pytest.mark.parametrize("offset", [0.1, "10cm", "100mm", np.float64(0.1)])
def test_constants_as_numbers_in_si_or_with_units(offset: object, problem: mbm.Problem, ranges: Ranges) -> None:
    point, _ = gauss_newton(ranges["range"], offset=0.1)
    found = problem.solve(data={"ranges": ranges}, constants={"offset": offset})
    np.testing.assert_allclose(found["p"].value, point, rtol=CLOSE)


@pytest.mark.parametrize(
    "given",
    [
        {"constants": {"zzz": 1}},
        {"constants": {"offset": "3s"}},
        {"constants": {"offset": float("nan")}},
        {"init": {"zzz": 1}},
        {"init": {"p": [1, 2]}},
        {"init": {"p": "here"}},
        {"seed": -1},
        {"method": "zzz"},
        {"backend": "zzz"},
        {"data": {"zzz": {}}},
        {"data": {"ranges": 3}},
        {"data": {}},
    ],
    ids=str,
)
def test_wrong_calls_are_diagnostics(given: dict[str, object], problem: mbm.Problem, ranges: Ranges) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(**{"data": {"ranges": ranges}, **given})  # type: ignore[arg-type]
    assert all(d.code.name and d.message for d in caught.value.diagnostics)


def test_methods_of_sequences_ask_for_states(problem: mbm.Problem, ranges: Ranges) -> None:
    with pytest.raises(mbm.MbmError, match="no-states"):
        problem.solve(data={"ranges": ranges}, method="smoother")


def test_start_from_values_and_from_a_document(problem: mbm.Problem, ranges: Ranges, solved: mbm.Solved) -> None:
    """Below the receivers lies the tag, above them its mirror image, nearly.

    A start above leads to a minimum there; the closed form leads to a better one.
    """
    above = problem.solve(data={"ranges": ranges}, init={"p": [1.0, 1.0, 6.0]})
    np.testing.assert_allclose(above["p"].value, solved["p"].value, rtol=CLOSE)
    assert solved["p"].value[2] < 1.0
    again = problem.solve(data={"ranges": ranges}, init=solved.document())
    np.testing.assert_allclose(again["p"].value, solved["p"].value, rtol=CLOSE)
    assert again.first.iterations <= 1
    for init in (solved, solved.first, {"p": solved["p"]}, {"p": solved.first["p"]}):
        begun = problem.solve(data={"ranges": ranges}, init=init)
        np.testing.assert_allclose(begun["p"].value, solved["p"].value, rtol=CLOSE)
        assert begun.first.iterations <= 1


def test_there_are_so_many_solves(solved: mbm.Solved) -> None:
    for place in (1, -2):
        with pytest.raises(IndexError, match=f"no solve {place} of 1"):
            solved.solves[place]
    assert [each.status for each in solved.solves] == [solved.solves[-1].status]


def test_the_seed_is_kept(problem: mbm.Problem, ranges: Ranges) -> None:
    assert problem.solve(data={"ranges": ranges}, seed=7).document()["seed"] == 7


def test_values_and_sigmas_are_arrays_in_the_stated_unit(solved: mbm.Solved, ranges: Ranges) -> None:
    point, covariance = gauss_newton(ranges["range"])
    height = solved["height"]
    assert (height.unit, solved["p"].unit) == ("mm", "m")
    assert isinstance(height.value, np.ndarray)
    assert height.value == pytest.approx(1000 * point[2], rel=CLOSE)
    assert height.sigma == pytest.approx(1000 * np.sqrt(covariance[2, 2]), rel=1e-7)
    with pytest.raises(KeyError, match="there are p, height"):
        solved["zzz"]


def test_covariance_goes_with_the_sigmas(problem: mbm.Problem, solved: mbm.Solved, ranges: Ranges) -> None:
    _, covariance = gauss_newton(ranges["range"])
    assert solved.covariance is not None
    assert solved.covariance.names == ("p[1]", "p[2]", "p[3]")
    np.testing.assert_allclose(solved.covariance.matrix, covariance, rtol=1e-7)
    in_millimetres = mbm.loads(MILLIMETRES).solve(data={"d": {"y": [1.0, 1.1]}})
    assert in_millimetres.covariance is not None
    assert in_millimetres.covariance.matrix is not None
    # The mean of two readings with a standard deviation of 10 mm: 10/√2 mm.
    assert np.sqrt(in_millimetres.covariance.matrix[0, 0]) == pytest.approx(10 / np.sqrt(2), rel=1e-12)
    assert in_millimetres["a"].sigma == pytest.approx(10 / np.sqrt(2), rel=1e-12)
    document = in_millimetres.document()["solves"][0]["covariance"]["matrix"]
    assert document == in_millimetres.covariance.matrix.tolist()


MILLIMETRES = "(problem m (data d external) (unknowns (a :init 1m :unit mm)) (observe d (= y a) :sigma 10mm))"


def test_observability(solved: mbm.Solved) -> None:
    assert solved.observability is not None
    assert (solved.observability.rank, solved.observability.dimension) == (3, 3)
    assert solved.observability.unobservable == ()


def test_residuals_are_model_minus_measured_over_sigma(solved: mbm.Solved, ranges: Ranges) -> None:
    point, _ = gauss_newton(ranges["range"])
    rows = solved.residuals("ranges")
    assert list(rows["row"]) == [1, 2, 3, 4, 5]
    from tests.api.conftest import distances

    expected = (distances(point) - ranges["range"]) / SIGMA
    # Residuals of a few standard deviations at a point good to 1e-9: 1e-9 · 4 m / 5 mm is below 1e-6.
    np.testing.assert_allclose(rows["whitened"], expected, atol=1e-6)
    np.testing.assert_allclose(rows["raw"], expected * SIGMA, atol=1e-6 * SIGMA)
    np.testing.assert_array_equal(rows["range"], ranges["range"])
    assert list(solved.residuals()["clause"]) == ["ranges"] * 5
    assert solved.first.cost == pytest.approx(float(expected @ expected), rel=1e-9)
    assert solved.first.dof == 2


def test_table_has_one_row_per_solve(ranges: Ranges) -> None:
    pandas = pytest.importorskip("pandas")
    text = "(problem m (data d external) (unknowns (a :init 1)) (observe d (= y a) :sigma 1) (for-each k))"
    table = mbm.loads(text).solve(data={"d": {"y": [1.0, 2.0, 4.0], "k": ["p", "q", "q"]}}).table()
    assert isinstance(table, pandas.DataFrame)
    assert table["k"].tolist() == ["p", "q"]
    assert table["status"].tolist() == ["converged", "converged"]
    np.testing.assert_allclose(table["a"], [1.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(table["a.sigma"], [1.0, np.sqrt(0.5)], rtol=1e-12)


def test_table_without_pandas_is_a_dict_of_arrays(solved: mbm.Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    table = solved.table()
    assert isinstance(table, dict)
    np.testing.assert_allclose(table["p[1]"], [solved["p"].value[0]])


def test_json_is_the_document(solved: mbm.Solved, tmp_path: Path) -> None:
    text = solved.to_json(tmp_path / "out.json")
    assert json.loads(text) == json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    written = json.loads(text)
    assert written["problem"] == "tag"
    assert written["solves"][0]["estimates"]["p"]["value"] == solved["p"].value.tolist()


def test_plot_is_a_figure(solved: mbm.Solved, tmp_path: Path) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    figure = solved.plot()
    assert isinstance(figure, matplotlib.figure.Figure)
    assert figure.axes
    figure.savefig(tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_notebooks_show_the_table(solved: mbm.Solved) -> None:
    shown = solved._repr_html_()
    assert shown.startswith('<div class="mbm-result">')
    assert '<td class="text">p[1]</td>' in shown
    assert "95 % interval" in shown
    assert "±" in str(solved)


def test_a_doubtful_answer_is_no_exception() -> None:
    found = mbm.loads("(problem p (unknowns (a :init 1) (b :init 2)) (observe (= 1 a) :sigma 1))").solve()
    assert (found.status, found.first.status) == ("attention", "unobservable")
    assert found["a"].value == pytest.approx(1.0)
    assert np.isnan(found["b"].sigma)


def test_no_solve_is_said() -> None:
    text = "(problem m (data d external) (unknowns (a :init 1)) (observe d (= y a) :sigma 1) (for-each k))"
    found = mbm.loads(text).solve(data={"d": {"y": np.zeros(0), "k": np.zeros(0)}})
    assert len(found.solves) == 0
    with pytest.raises(LookupError, match="no solve"):
        found["a"]


def test_another_seed_of_noise_gives_another_answer(problem: mbm.Problem, solved: mbm.Solved) -> None:
    other = problem.solve(data={"ranges": measured(seed=1)})
    assert not np.array_equal(other["p"].value, solved["p"].value)
