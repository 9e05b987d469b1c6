"""What CONTRACT §3 lists of results: each row of its table, for one solve and for many, before and after pickling."""

from __future__ import annotations

import json
import pickle
import pickletools
from concurrent.futures import ProcessPoolExecutor
from enum import StrEnum
from multiprocessing import get_context

import numpy as np
import pytest
from scipy import stats

import mbm

X = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
Y = np.array([10.2, 11.9, 14.1, 16.2, 17.7])
DESIGN = np.column_stack([np.ones(5), X])
LINE = """(problem line
  (data d external :columns ((y :unit mm)))
  (constants (shift 0))
  (unknowns (a :unit mm :doc "offset") (b :init 0 :unit mm))
  (observe readings d (= y (+ a shift (* b x))))
  (constraints (< a 1))
  (derive (at-ten (+ a (* 10 b)) :unit cm)))"""
"""In mm: a straight line of five points with unknown noise."""
GROUPS = "(problem g (data d external) (unknowns (m)) (observe d (= y m) :sigma 1) (for-each k))"


@pytest.fixture(scope="module")
def result():
    return mbm.loads(LINE).solve(data={"d": {"x": X, "y": Y}})


@pytest.fixture(scope="module")
def fit():
    """Estimates, covariance and s by NumPy, in mm."""
    value, (square,) = np.linalg.lstsq(DESIGN, Y, rcond=None)[:2]
    return value, np.linalg.inv(DESIGN.T @ DESIGN) * square / 3, np.sqrt(square / 3)


@pytest.fixture(scope="module")
def groups():
    return mbm.loads(GROUPS).solve(data={"d": {"y": [1.0, 2.0, 4.0, 8.0], "k": ["p", "q", "q", "q"]}})


def test_numbers_of_a_quantity_are_in_the_unit_of_the_report(result, fit):
    value, covariance, _ = fit
    a, derived = result["a"], result["at-ten"]
    sigma, factor = np.sqrt(covariance[0, 0]), stats.t.ppf(0.975, 3)
    assert (a.unit, a.dof, derived.unit) == ("mm", 3.0, "cm")
    assert a.value == pytest.approx(value[0], rel=1e-9)
    assert a.sigma == pytest.approx(sigma, rel=1e-9)
    assert a.k == pytest.approx(factor, rel=1e-9)
    assert float(a.U) == pytest.approx(factor * sigma, rel=1e-9)
    np.testing.assert_allclose(a.interval(), value[0] + np.array([-1, 1]) * factor * sigma, rtol=1e-9)
    ninety = stats.t.ppf(0.95, 3) * sigma
    np.testing.assert_allclose(a.interval(0.9), value[0] + np.array([-1, 1]) * ninety, rtol=1e-9)
    assert derived.value == pytest.approx((value[0] + 10 * value[1]) / 10, rel=1e-9)


def test_si_is_the_same_in_si(result):
    a, si = result["a"], result["a"].si
    assert (si.unit, si.name, result["at-ten"].si.unit) == ("m", "a", "m")
    for mine, its in ((a.value, si.value), (a.sigma, si.sigma), (a.U, si.U), (a.interval(), si.interval())):
        np.testing.assert_allclose(its, mine / 1000, rtol=1e-12)
    assert (si.k, si.dof) == (a.k, a.dof)
    assert si.si.value == si.value


def test_angles_families_and_poses_in_si():
    text = """(problem p
      (data t (table (k w) ("x" 30deg) ("y" 60deg)) :key k)
      (unknowns (f angle :per t :unit deg) (T (pose 2) :init (pose2 0 0 0) :unit cm))
      (observe t (= w (f k)) :sigma 1deg)
      (observe pose (= (pose2 1 2 0.5) T) :sigma [0.1 0.1m 0.1m]))"""
    solved = mbm.loads(text).solve()
    np.testing.assert_allclose(solved["f"].value, [30, 60], rtol=1e-12)
    np.testing.assert_allclose(solved["f"].si.value, np.radians([30, 60]), rtol=1e-12)
    assert (solved["f"].si.unit, solved["f"]["y"].si.unit) == ("rad", "rad")
    assert solved["f"]["y"].si.value == pytest.approx(np.pi / 3, rel=1e-12)
    np.testing.assert_allclose(solved["T"].translation, [100, 200], rtol=1e-12)
    np.testing.assert_allclose(solved["T"].si.translation, [1, 2], rtol=1e-12)
    np.testing.assert_allclose(solved["T"].si.sigma, [0.1, 0.1, 0.1], rtol=1e-12)
    np.testing.assert_allclose(solved["T"].sigma, [0.1, 10, 10], rtol=1e-12)


def test_estimates_have_the_units_of_the_result(result):
    assert [each.name for each in result.estimates] == ["a", "b"]
    assert [each.name for each in result.derived] == ["at-ten"]
    for each in (*result.estimates, *result.derived):
        assert each.value == result[each.name].value == result.first[each.name].value
        assert each.sigma == result[each.name].sigma
    assert result.covariance.matrix[0, 0] == pytest.approx(result["a"].sigma ** 2, rel=1e-12)
    assert result.derived_covariance.matrix[0, 0] == pytest.approx(result["at-ten"].sigma ** 2, rel=1e-12)


def test_names(result):
    assert list(result) == list(result.keys()) == list(result.solves[0]) == ["a", "b", "at-ten"]
    assert "at-ten" in result
    assert "c" not in result
    with pytest.raises(KeyError, match="there are a, b, at-ten"):
        result["c"]


def test_what_a_document_says_of_a_solve_is_said_by_results_and_solves(result, fit):
    document = result.document()["solves"][0]
    for one in (result, result.solves[0], result.first):
        for name in ("message", "cost", "dof", "sigma0", "chi2_p", "noise", "method", "iterations", "evaluations"):
            assert getattr(one, name) == document[name]
        assert one.seconds == document["seconds"]
        assert one.noise["readings"] * 1000 == pytest.approx(fit[2], rel=1e-9)
        assert [each.name for each in one.constraints] == [each["name"] for each in document["constraints"]]
        assert [each.code.name for each in one.diagnostics] == [each["code"] for each in document["diagnostics"]]
        assert one.observability.rank == 2
        assert one.alternatives == ()


def test_statuses_are_enums_of_the_words_of_the_document(result):
    assert isinstance(result.status, StrEnum)
    assert isinstance(result.solves[0].status, StrEnum)
    assert (result.status, result.solves[0].status) == ("ok", "converged")


def test_correlations(result, fit):
    deviations = np.sqrt(np.diag(fit[1]))
    assert result.correlation.names == ("a", "b", "at-ten")
    np.testing.assert_allclose(result.correlation.matrix[:2, :2], fit[1] / np.outer(deviations, deviations), rtol=1e-9)


def test_free_combinations_are_in_the_units_of_the_report():
    text = "(problem p (unknowns (a :init 1 :unit mm) (b :init 1)) (observe (= 2 (+ a (* 1m b))) :sigma 1))"
    solved = mbm.loads(text).solve()
    (written,) = solved.document()["solves"][0]["observability"]["unobservable"]
    (free,) = solved.observability.unobservable
    assert free.coefficients == written["coefficients"]
    assert free.coefficients["a"] == pytest.approx(-1000 * free.coefficients["b"], rel=1e-9)


def test_other_minima_are_in_the_units_of_the_report():
    text = "(problem p (unknowns (a :unit mm :in (-5 5))) (observe (= 4 (* a a)) :sigma 1) (solve :starts (random 20)))"
    solved = mbm.loads(text).solve(seed=1)
    (other,) = solved.alternatives
    assert (other["a"].unit, abs(other["a"].value)) == ("mm", pytest.approx(2000, rel=1e-6))
    assert other.estimates[0].value == pytest.approx(-solved["a"].value, rel=1e-6)
    assert other.cost == pytest.approx(0, abs=1e-9)


def test_residuals_are_a_table_with_the_columns_of_the_data(result, fit):
    table = result.residuals("readings")
    raw = (DESIGN @ fit[0] - Y) / 1000
    assert list(table) == [
        "row", "file_row", "component", "y", "x", "raw", "whitened", "weight", "leverage", "used", "outlier",
    ]  # fmt: skip
    assert list(table["row"]) == [1, 2, 3, 4, 5]
    np.testing.assert_array_equal(table["x"], X)
    np.testing.assert_allclose(table["y"], Y / 1000, rtol=1e-15)
    np.testing.assert_allclose(table["raw"], raw, atol=1e-12)
    np.testing.assert_allclose(table["whitened"], raw * 1000 / fit[2], atol=1e-8)
    hat = DESIGN @ np.linalg.inv(DESIGN.T @ DESIGN) @ DESIGN.T
    np.testing.assert_allclose(table["leverage"], np.diag(hat), rtol=1e-9)
    assert (table["weight"] == 1).all()
    assert not np.asarray(table["outlier"]).any()


def test_outliers_are_marked_and_have_no_weight():
    text = """(problem p (data d external) (unknowns (m)) (observe d (= y m) :sigma 1)
      (solve :robust (lmeds)))"""
    table = mbm.loads(text).solve(data={"d": {"y": [1.0, 1.1, 0.9, 1.05, 50.0]}}).residuals("d")
    assert list(table["outlier"]) == [False] * 4 + [True]
    assert table["weight"][4] == 0


def test_columns_called_as_those_of_the_table_keep_a_name_of_their_own():
    text = "(problem p (data d external) (unknowns (m)) (observe d (= raw m) :sigma 1))"
    table = mbm.loads(text).solve(data={"d": {"raw": [1.0, 3.0], "weight": [7.0, 8.0]}}).residuals("d")
    np.testing.assert_array_equal(table["table.raw"], [1, 3])
    np.testing.assert_array_equal(table["table.weight"], [7, 8])
    np.testing.assert_allclose(table["raw"], [1, -1], atol=1e-12)


def test_residuals_of_an_unknown_name_are_an_error_that_lists_the_names(result):
    for one in (result, result.solves[0]):
        with pytest.raises(mbm.MbmError, match="`readings`") as caught:
            one.residuals("d")
        assert caught.value.diagnostics[0].code.name == "no-such-clause"
    with pytest.raises(mbm.MbmError) as caught:
        result.residuals("reading")
    assert caught.value.diagnostics[0].hint == "did you mean `readings`?"


def test_residuals_of_many_solves_have_their_keys(groups):
    table = groups.residuals("d")
    assert list(table["k"]) == ["p", "q", "q", "q"]
    assert list(groups.residuals()["clause"]) == ["d"] * 4
    np.testing.assert_allclose(table["raw"], [0, 14 / 3 - 2, 14 / 3 - 4, 14 / 3 - 8], atol=1e-12)


def test_without_pandas_tables_are_arrays_by_name(result, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    table = result.residuals("readings")
    assert isinstance(table, dict)
    assert table["raw"].shape == (5,)
    assert isinstance(result.profile("a"), dict)


def test_the_profile_of_a_linear_problem_is_its_interval_at_each_level(result):
    table = result.profile("a")
    for level, low, high in zip(table["level"], table["low"], table["high"], strict=True):
        np.testing.assert_allclose([low, high], result["a"].interval(level), rtol=1e-12)
    with pytest.raises(KeyError, match="no number is called `c`; there are `a`, `b`, `at-ten`"):
        result.profile("c")


def test_the_profile_of_a_curved_problem_goes_where_the_cost_has_grown():
    """y = a² with a near 0: the cost (a² − 1)² / σ² is a function of a alone, which is inverted by hand."""
    text = "(problem p (unknowns (a :init 1)) (observe (= 1 (* a a)) :sigma 0.7))"
    table = mbm.loads(text).solve().profile("a")
    chosen = np.asarray(table["k"]) * 0.7 < 1
    wanted = np.sqrt(1 + 0.7 * np.asarray(table["k"]))
    assert set(table["kind"]) == {"profile"}
    # An end is followed to 1e-3 of the growth of the cost, which is about the distance there.
    np.testing.assert_allclose(table["high"] - 1, wanted - 1, rtol=2e-3)
    np.testing.assert_allclose(1 - table["low"][chosen], 1 - np.sqrt(1 - 0.7 * table["k"][chosen]), rtol=2e-3)


def test_texts(result, groups):
    for one in (result, result.solves[0], groups, groups.solves[1]):
        assert "\n" not in repr(one)
        assert "±" in str(one)
        assert "±" in one._repr_html_()
        assert "<" in one._repr_html_()
    assert "line" in repr(result)
    assert "converged" in repr(result.solves[0])
    assert "q" in repr(groups.solves[1])
    assert repr(result["a"]).startswith("<a = ")
    assert "\n" not in repr(mbm.loads(GROUPS.replace("(m)", "(m (vector 30))").replace("= y m", "= y (m 1)")).solve(
        data={"d": {"y": [1.0], "k": [1.0]}}).solves[0]["m"])  # fmt: skip


def test_many_solves_answer_alike(groups):
    assert len(groups.solves) == 2
    assert [solve.key for solve in groups.solves] == [{"k": "p"}, {"k": "q"}]
    assert [float(solve["m"].value) for solve in groups.solves] == pytest.approx([1, 14 / 3])
    assert [float(solve["m"].value) for solve in groups.solves[1:]] == pytest.approx([14 / 3])
    assert [solve.dof for solve in groups.solves] == [0, 2]
    assert list(groups) == ["m"]
    assert groups.status == "ok"
    for name in ("cost", "covariance", "noise", "observability", "alternatives", "record"):
        with pytest.raises(LookupError, match=r"2 solves.*\.solves"):
            getattr(groups, name)
    with pytest.raises(LookupError, match=r"2 solves.*\.solves"):
        groups["m"]
    assert list(groups.table()["k"]) == ["p", "q"]
    assert len(groups.diagnostics) == sum(len(solve.diagnostics) for solve in groups.solves)
    assert groups.solves[1].document()["solves"][0] == groups.document()["solves"][1]


def again(value):
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_results_pickle_as_data(result, groups):
    for one in (result, groups, groups.solves[1]):
        other = again(one)
        assert other.document() == one.document()
        assert str(other) == str(one)
        assert np.array_equal(other.residuals().to_numpy(), one.residuals().to_numpy())
    assert again(result)["a"].interval(0.8).tolist() == result["a"].interval(0.8).tolist()
    assert len(again(groups).plot().axes) == len(groups.plot().axes)


def test_pickles_of_results_name_no_function_but_those_that_make_values(result):
    named, texts = set(), []
    for operation, argument, _ in pickletools.genops(pickle.dumps(again(result))):
        if operation.name in ("SHORT_BINUNICODE", "BINUNICODE"):
            texts.append(argument)
        elif operation.name == "MEMOIZE":
            continue
        elif operation.name == "STACK_GLOBAL":
            named.add(texts[-1])
    assert "Solved" in named
    assert all(
        name[0].isupper() or name in {"_reconstruct", "_frombuffer", "dtype", "ndarray", "scalar"} for name in named
    )
    assert b"lambda" not in pickle.dumps(result)


def test_intervals_by_profile_are_kept_at_common_levels():
    text = "(problem p (unknowns (a :init 1)) (observe (= 1 (* a a)) :sigma 0.7) (solve :coverage 90%))"
    solved = mbm.loads(text).solve()
    other = again(solved)
    for level in (None, 0.95, 0.99):
        assert other["a"].interval(level).tolist() == solved["a"].interval(level).tolist()
    assert other["a"].interval_kind == "profile"
    with pytest.raises(LookupError, match=r"0\.5, 0\.6827, 0\.9, 0\.95.*solve again"):
        other["a"].interval(0.8)
    assert again(other).document() == solved.document()


def test_what_needs_the_equations_says_so_after_pickling(result, tmp_path):
    with pytest.raises(mbm.MbmError):
        again(result).write("ply", tmp_path / "out")
    with pytest.raises(mbm.MbmError):
        again(result).trajectory()


def solved(offset):
    return mbm.loads(LINE).solve(data={"d": {"x": X, "y": Y + offset}})


def fails(_):
    return mbm.loads("(problem p (unknowns (a)) (observe (= 1 aa)))").solve()


def test_process_pools_bring_results_and_errors_home(result):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(solved, [0.0, 1.0]))
        with pytest.raises(mbm.MbmError, match="aa") as caught:
            list(pool.map(fails, [0]))
    assert caught.value.diagnostics[0].place.line == 1
    assert found[0]["a"].value == result["a"].value
    assert found[1]["a"].value == pytest.approx(result["a"].value + 1, rel=1e-12)


def test_joblib_brings_results_home(result):
    joblib = pytest.importorskip("joblib")
    (found,) = joblib.Parallel(n_jobs=2)(joblib.delayed(solved)(offset) for offset in [0.0])
    assert found["a"].value == result["a"].value


def test_json_is_the_document(result, tmp_path):
    result.to_json(tmp_path / "out.json")
    assert json.loads((tmp_path / "out.json").read_text()) == json.loads(json.dumps(result.document()))
