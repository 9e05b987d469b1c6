"""Predictions at other values and intervals of new readings: closed forms of regression, and simulated readings."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy import stats

import mbm
from mbm.report.plots import draw

T = np.array([0.0, 1.0, 2.0, 3.0, 5.0])
Y = np.array([1.1, 2.9, 5.2, 7.1, 10.8])
TEXT = """
(problem p
  (data d external)
  (unknowns (a) (b))
  (observe d (= y (+ a (* b t))) {noise})
  {more})
"""
LINE = "(derive (f (+ (* b x) a) :over (grid x 0 8 5)))"


def solved(noise=":sigma unknown", more=LINE, **columns):
    return mbm.loads(TEXT.format(noise=noise, more=more)).solve(data={"d": {"t": T, "y": Y, **columns}})


def column(table, name):
    return np.asarray(table[name], dtype=float)


def regression(at):
    """Fit, standard error of the mean, s, and degrees of freedom: Draper and Smith (1998), §1.4 and §3.1."""
    x = T - T.mean()
    slope = (x @ Y) / (x @ x)
    fit = Y.mean() + slope * (at - T.mean())
    dof = len(T) - 2
    s = np.sqrt(np.square(Y - Y.mean() - slope * x).sum() / dof)
    return fit, s * np.sqrt(1 / len(T) + np.square(at - T.mean()) / (x @ x)), s, dof


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_one_unknown_noise_is_the_textbook_interval_of_a_reading(level):
    at = np.array([-2.0, 0.3, 12.5])
    fit, error, s, dof = regression(at)
    found = solved().predict("f", at, level=level)
    k = stats.t.ppf((1 + level) / 2, dof)
    # closed forms of a small well-conditioned problem: roundings only
    np.testing.assert_allclose(column(found, "value"), fit, rtol=1e-11)
    np.testing.assert_allclose(column(found, "sigma"), error, rtol=1e-9)
    np.testing.assert_allclose(column(found, "high"), fit + k * error, rtol=1e-9)
    np.testing.assert_allclose(column(found, "reading_low"), fit - k * np.hypot(error, s), rtol=1e-9)
    np.testing.assert_allclose(column(found, "reading_high"), fit + k * np.hypot(error, s), rtol=1e-9)
    np.testing.assert_allclose(column(found, "x"), at)


@pytest.mark.parametrize(
    ("noise", "deviation"),
    [
        (":sigma 0.2", 0.2),
        (":covariance [[0.04]]", 0.2),
        (":information [[25]]", 0.2),
    ],
)
def test_stated_noise_is_normal(noise, deviation):
    text = TEXT.replace("(= y (+ a (* b t)))", "(= [y] [(+ a (* b t))])" if "[[" in noise else "(= y (+ a (* b t)))")
    more = LINE.replace("(+ (* b x) a)", "[(+ (* b x) a)]") if "[[" in noise else LINE
    found = mbm.loads(text.format(noise=noise, more=more)).solve(data={"d": {"t": T, "y": Y}}).predict("f", [4.0])
    reach = stats.norm.ppf(0.975) * np.hypot(column(found, "sigma"), deviation)
    np.testing.assert_allclose(column(found, "reading_high") - column(found, "value"), reach, rtol=1e-9)


def test_noise_of_columns_wants_them():
    result = solved(noise=":sigma (* 0.1 s)", more="(derive (f (+ a (* b t)) :over d))", s=T + 1)
    assert "reading_low" not in result.predict("f", {"t": [4.0]})
    found = result.predict("f", {"t": [4.0], "s": [30.0]})
    reach = stats.norm.ppf(0.975) * np.hypot(column(found, "sigma"), 3.0)
    np.testing.assert_allclose(column(found, "reading_high") - column(found, "value"), reach, rtol=1e-9)
    with pytest.raises(mbm.MbmError, match="column `s`"):
        result.predict("f", {"t": [4.0]}, clause="d")


def test_units_are_those_of_the_problem():
    text = """(problem p (data d external :columns ((t :unit min) (y :unit cm))) (unknowns (a :unit m) (b))
      (observe d (= y (+ a (* b t))) :sigma 1cm) (derive (f (+ a (* b t)) :unit mm :over (grid t 0min 1min 2))))"""
    found = mbm.loads(text).solve(data={"d": {"t": T, "y": Y}}).predict("f", [4.0])
    fit, _, _, _ = regression(np.array([4.0]))
    np.testing.assert_allclose(column(found, "value"), 10 * fit, rtol=1e-11)
    assert column(found, "reading_high") - column(found, "value") > 19.59  # 1.96 times 1 cm, and more, in mm


def test_what_cannot_be_predicted_says_why():
    result = solved()
    with pytest.raises(ValueError, match=r"such as 0\.95 for 95 %"):
        result.predict("f", [4.0], level=95)
    with pytest.raises(mbm.MbmError, match="a result that was pickled has no equations"):
        pickle.loads(pickle.dumps(result)).predict("f", [4.0])  # noqa: S301 - our own


@pytest.mark.slow
def test_readings_lie_inside_as_often_as_stated():
    """1,000 lines of 5 readings with unknown noise, and a sixth reading off the data: 95 % within three deviations."""
    at, rng, count = 7.0, np.random.default_rng(5), 1000
    compiled = mbm.loads(TEXT.format(noise=":sigma unknown", more=LINE)).compile(data={"d": {"t": T, "y": Y}})
    inside = 0
    for _ in range(count):
        y = 1 + 2 * T + 0.3 * rng.standard_normal(len(T))
        found = compiled.solve(data={"d": {"t": T, "y": y}}).predict("f", [at])
        inside += column(found, "reading_low")[0] < 1 + 2 * at + 0.3 * rng.standard_normal() < found["reading_high"][0]
    assert abs(inside / count - 0.95) < 3 * np.sqrt(0.95 * 0.05 / count)


def test_two_instruments_differ_in_their_readings():
    text = """(problem p (data d external) (data e external) (unknowns (a) (b))
      (observe d (= y (+ a (* b t))) :sigma 0.1) (observe e (= y (+ a (* b t))) :sigma 0.5)
      (derive (f (+ a (* b t)) :over (grid t 0 8 5))))"""
    result = mbm.loads(text).solve(data={"d": {"t": T, "y": Y}, "e": {"t": T, "y": Y}})
    assert "reading_low" not in result.predict("f")
    for clause, deviation in (("d", 0.1), ("e", 0.5)):
        found = result.predict("f", [1.0], clause=clause)
        reach = stats.norm.ppf(0.975) * np.hypot(column(found, "sigma"), deviation)
        np.testing.assert_allclose(column(found, "reading_high") - column(found, "value"), reach, rtol=1e-9)


@pytest.mark.parametrize(
    ("form", "model"),
    [
        ("(+ a (* b t))", True),
        ("(- (* t b) (- a))", True),
        ("(+ a (* b u))", True),
        ("(+ a (* 2 b t))", False),
        ("(+ a (* b t) (* 1e-6 t))", False),
        ("(* b t)", False),
        ("a", False),
        ("(exp (+ a (* b t)))", False),
    ],
)
def test_a_reading_is_of_what_is_the_model_however_it_is_written(form, model):
    variable = "u" if " u" in form else "t"
    result = solved(more=f"(derive (f {form} :over (grid {variable} 0 8 5)))")
    assert ("reading_low" in result.predict("f")) is model


def test_vectors_have_a_column_for_each_element():
    result = solved(more="(derive (f [a (* b t)] :over (grid t 0 8 5)))")
    found = result.predict("f", [3.0])
    value = [column(found, f"value[{i}]")[0] for i in (1, 2)]
    np.testing.assert_allclose(value, [float(result["a"].value), 3 * float(result["b"].value)])


@pytest.mark.parametrize(("form", "sides"), [("(+ (* b x) a)", ["value"]), ("[a (* b x)]", ["value[1]", "value[2]"])])
def test_no_rows_are_predicted_as_no_rows(form, sides):
    found = solved(more=f"(derive (f {form} :over (grid x 0 8 5)))").predict("f", {"x": []})
    assert [name for name in found if name.startswith("value")] == sides
    assert all(len(found[name]) == 0 for name in found)


@pytest.mark.parametrize(
    ("name", "at", "message"),
    [
        ("f", {"t": [1.0]}, "the column `x` is missing"),
        ("f", {"x": ["one"]}, "wants numbers"),
        ("f", [np.nan], "not finite"),
        ("h", [1.0], "depends on no column"),
        ("g", [1.0], "depends on `t`, `y`"),
        ("f", 3.0j, "complex"),
    ],
)
def test_what_cannot_be_predicted(name, at, message):
    more = LINE + "(derive (h (* a b)) (g (- y (* b t)) :over d))"
    with pytest.raises(mbm.MbmError, match=message) as caught:
        solved(more=more).predict(name, at)
    assert caught.value.diagnostics[0].code.name in ("not-predicted", "not-a-table")


@pytest.mark.parametrize("each", ["", "(for-each g)"])
def test_uncertain_constants_count(each):
    text = """(problem p (constants (h 1 :sigma 0.1 :dof 7)) (data d external) (unknowns (a) (b)) EACH
      (observe d (= y (+ a (* b t) (* h t t))) :sigma 0.1) (derive (f (* (+ b h) t) :over (grid t 0 2 3))))"""
    result = mbm.loads(text.replace("EACH", each)).solve(data={"d": {"t": T, "y": Y, "g": 0 * T}})
    x = T - T.mean()
    slope = -(x @ T**2) / (x @ x)  # of b by h
    own, added = 0.1 / np.sqrt(x @ x), 0.1 * abs(slope + 1.0)
    for at in (None, [0.0, 1.0, 2.0]):
        found = result.predict("f", at)
        np.testing.assert_allclose(column(found, "sigma"), np.hypot(own, added) * np.arange(3), rtol=1e-6)
        reach = stats.t.ppf(0.975, 7 * np.hypot(own, added) ** 4 / added**4) * np.hypot(own, added)
        np.testing.assert_allclose(column(found, "high") - column(found, "value"), reach * np.arange(3), rtol=1e-6)
    far = result.predict("f", [5.0])
    np.testing.assert_allclose(column(far, "sigma"), [5.0 * np.hypot(own, added)], rtol=1e-6)
    [drawn] = [data for data in result.solves[0].record.pictures() if data.clause == "f"]
    last = drawn.curve.band[1][-1] - drawn.curve.values[-1, 0]
    np.testing.assert_allclose(last, 2.0 * reach, rtol=1e-6)


def test_unknown_names_and_several_solves():
    with pytest.raises(KeyError, match="`a` is not derived"):
        solved().predict("a")
    several = solved(more=LINE + "(for-each g)", g=[1, 1, 1, 2, 2])
    with pytest.raises(LookupError, match="2 solves"):
        several.predict("f")


pytest.importorskip("matplotlib")


def panels(result):
    return {axes.get_title(): axes for axes in draw(result.result).axes}


def test_bands_are_drawn_smoothly_with_the_data_and_off_them():
    axes = panels(solved())["d: data and model"]
    line = next(each for each in axes.lines if each.get_label() == "model")
    x = np.asarray(line.get_xdata())
    assert len(x) == 200
    assert (x[0], x[-1]) == (0, 8)
    fit, error, s, dof = regression(x)
    np.testing.assert_allclose(line.get_ydata(), fit, rtol=1e-10)
    outer, inner = (each.get_paths()[0].vertices for each in axes.collections)
    k = stats.t.ppf(0.975, dof)
    assert inner[:, 1].max() == pytest.approx((fit + k * error).max())
    assert outer[:, 1].max() == pytest.approx((fit + k * np.hypot(error, s)).max())


def test_what_is_no_model_has_a_panel_of_its_own():
    found = panels(solved(more="(derive (f (* a b u) :over (grid u 0 8 300)))"))
    assert len(found["f"].lines[0].get_xdata()) == 300


def test_the_model_is_a_smooth_line_between_the_data():
    text = TEXT.replace("(+ a (* b t))", "(* a (exp (* b t)))").replace("(a) (b)", "(a :init 1) (b :init 0.4)")
    result = mbm.loads(text.format(noise=":sigma 0.2", more="")).solve(data={"d": {"t": T, "y": Y}})
    line = next(each for each in panels(result)["d: data and model"].lines if each.get_label() == "model")
    x = np.asarray(line.get_xdata())
    assert (x.min(), x.max(), len(x)) == (T.min(), T.max(), 200)
    a, b = (float(result[name].value) for name in "ab")
    np.testing.assert_allclose(line.get_ydata(), a * np.exp(b * x), rtol=1e-12)
