"""Aggregates over the rows of a table: values as NumPy has them, sigmas by differences, rows as the solve has them."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.api.files import emit_file
from mbm.problem.reading.aggregates import exchanges
from mbm.report.options import SolveOptions

T = np.array([0.0, 0.5, 1.1, 1.7, 2.4, 3.0, 3.3])
Y = np.array([2.0, 1.61, 1.19, 0.93, 0.65, 0.47, 0.45])
GROUP = np.array([1, 1, 2, 1, 2, 2, 2])
HEAD = """
(problem p
  (data d external {options})
  (unknowns (a :init 2) (b :init -0.4))
  (observe d (= y (* a (exp (* b t)))) :sigma 0.02)
  {more})
"""
AGGREGATES = {
    "(mean d (* a (exp (* b t))))": lambda v: np.mean(v),
    "(rms d (* a (exp (* b t))))": lambda v: np.sqrt(np.mean(v**2)),
    "(median d (* a (exp (* b t))))": np.median,
    "(min d (* a (exp (* b t))))": np.min,
    "(max d (* a (exp (* b t))))": np.max,
    "(quantile d 0.3 (* a (exp (* b t))))": lambda v: np.quantile(v, 0.3),
    "(quantile d 1 (* a (exp (* b t))))": np.max,
    "(count d (> (* a (exp (* b t))) 0.8))": lambda v: np.sum(v > 0.8),
    "(sqrt (mean d (^ (- (* a (exp (* b t))) (mean d (* a (exp (* b t))))) 2)))": np.std,
}


def given(rows=slice(None)):
    return {"d": {"t": T[rows], "y": Y[rows], "g": GROUP[rows]}}


def text(more, options=""):
    return HEAD.format(more=more, options=options)


def of(found, name):
    """The estimate or derived quantity of one solve."""
    return next(each for each in (*found.estimates, *found.derived) if each.name == name)


def propagated(function, solved, times):
    """Value and sigma of ``function`` of the modelled values, by central differences."""
    point = np.array([float(of(solved, name).value) for name in ("a", "b")])

    def value(p):
        return float(function(p[0] * np.exp(p[1] * times)))

    step = 1e-6
    gradient = np.array([(value(point + step * e) - value(point - step * e)) / (2 * step) for e in np.eye(2)])
    return value(point), np.sqrt(gradient @ np.asarray(solved.covariance.matrix) @ gradient)


@pytest.mark.parametrize("form", AGGREGATES)
def test_a_value_and_its_sigma_are_those_of_the_rows(form):
    solved = mbm.loads(text(f"(derive (f {form}))")).solve(data=given())
    value, sigma = propagated(AGGREGATES[form], solved.first, T)
    assert float(solved["f"].value) == pytest.approx(value, rel=1e-13)
    # central differences with steps of 1e-6 keep nine digits of the gradient
    assert float(solved["f"].sigma) == pytest.approx(sigma, rel=1e-8, abs=1e-12)


def test_each_key_has_its_own_rows():
    solved = mbm.loads(text("(for-each g) (derive (f (max d (* a (exp (* b t))))))")).solve(data=given())
    for one, group in zip(solved.solves, (1, 2), strict=True):
        value, sigma = propagated(np.max, one, T[group == GROUP])
        assert float(of(one, "f").value) == pytest.approx(value, rel=1e-13)
        assert float(of(one, "f").sigma) == pytest.approx(sigma, rel=1e-8)


def test_each_window_has_its_own_rows():
    more = "(window t :length 2 :step 1 :min-rows 3) (derive (f (mean d t)) (n (count d)))"
    solved = mbm.loads(text(more)).solve(data=given())
    for one in solved.solves:
        if one.status == "skipped":
            continue
        end = next(iter(one.key.values()))
        inside = T[np.searchsorted(T, end - 2 + 1e-9) : np.searchsorted(T, end + 1e-9)]
        assert float(of(one, "f").value) == pytest.approx(inside.mean(), rel=1e-14)
        assert float(of(one, "n").value) == len(inside)


def test_rows_left_out_by_where_do_not_count_and_outliers_do():
    more = "(derive (n (count d)) (m (mean d y))) (solve :robust msac)"
    wild = given()
    wild["d"]["y"] = Y.copy()
    wild["d"]["y"][3] = 5.0
    solved = mbm.loads(text(more, options=":where (< t 3.2)")).solve(data=wild)
    assert solved.first.residual_summaries["d"].outliers == (4,)
    assert float(solved["n"].value) == 6
    assert float(solved["m"].value) == pytest.approx(wild["d"]["y"][:6].mean(), rel=1e-14)


def test_an_aggregate_over_rows_of_text_columns_and_members():
    problem = mbm.loads("""
        (problem p
          (data d (table (who t y) ("u" 0 1.0) ("u" 1 1.2) ("v" 2 3.0) ("v" 3 3.4)))
          (unknowns (level :per d.who :init 0))
          (observe d (= y (level who)) :sigma 0.1)
          (derive (f (mean d (level who))) (g (max d (if (= who "u") (* 10 (level who)) (level who))))))""")
    solved = problem.solve()
    # the levels are means of two rows each: 1.1 and 3.2, with sigma 0.1/√2; all are independent
    assert float(solved["f"].value) == pytest.approx((1.1 + 3.2) / 2)
    assert float(solved["f"].sigma) == pytest.approx(0.05)
    assert float(solved["g"].value) == pytest.approx(11.0)
    assert float(solved["g"].sigma) == pytest.approx(1 / np.sqrt(2))


def test_a_vector_is_taken_element_by_element_and_a_row_may_see_the_aggregate():
    solved = mbm.loads(text("(derive (v (mean d [t y])) (dev (- y (mean d y)) :over d))")).solve(data=given())
    np.testing.assert_allclose(solved["v"].value, [T.mean(), Y.mean()], rtol=1e-14)
    np.testing.assert_allclose(solved["dev"].value, Y - Y.mean(), atol=1e-14)


def test_the_unit_is_that_of_the_form():
    problem = mbm.loads("""
        (problem p
          (data d (table (x y) (1m 2s) (3m 5s)))
          (unknowns (v))
          (observe d (= x (* v y)) :sigma 1cm)
          (derive (f (rms d (* v y)) :unit mm) (n (count d (> x 2m)))))""")
    solved = problem.solve()
    assert solved["f"].unit == "mm"
    assert solved["n"].unit is None
    clash = mbm.loads("""
        (problem p
          (data d (table (x y) (1m 2s) (3m 5s)))
          (unknowns (v))
          (observe d (= x (* v y)) :sigma 1cm)
          (derive (f (+ (mean d x) (mean d y)))))""").check()
    assert [d.code.name for d in clash] == ["unit-clash"]


def test_an_empty_table_has_no_mean_and_a_count_of_nothing():
    more = "(derive (n (count d (> t 100))) (f (mean e x)))"
    problem = mbm.loads(text(more).replace("(unknowns", "(data e external :where (> x 10)) (unknowns"))
    solved = problem.solve(data={**given(), "e": {"x": [1.0, 2.0]}})
    assert float(solved["n"].value) == 0
    assert np.isnan(float(solved["f"].value))


def test_a_constraint_holds_for_the_aggregate():
    more = "(constraints (= (mean d (* a (exp (* b t)))) 1.2)) (derive (f (mean d (* a (exp (* b t))))))"
    solved = mbm.loads(text(more + "(solve :constraints exact)")).solve(data=given())
    assert float(solved["f"].value) == pytest.approx(1.2, abs=1e-9)
    limited = mbm.loads(text("(constraints (<= (max d (* a (exp (* b t)))) 1.8)) (solve :constraints exact)"))
    solved = limited.solve(data=given())
    assert float(solved["a"].value) * np.exp(float(solved["b"].value) * T).max() == pytest.approx(1.8, abs=1e-9)


OF_TIMES = {
    "mean": np.mean,
    "rms": lambda v: np.sqrt(np.mean(v**2)),
    "median": np.median,
    "max": np.max,
    "quantile": lambda v: np.quantile(v, 0.3),
}


def constrained(kind, more):
    """The straight line a·(1 + b·t), where an aggregate of a·t is 3."""
    rest = "0.3 (* a t)" if kind == "quantile" else "(* a t)"
    exact = f"(constraints (= ({kind} d {rest}) 3)) (solve :constraints exact)"
    return mbm.loads(text(more + exact).replace("(exp (* b t))", "(+ 1 (* b t))"))


@pytest.mark.parametrize("kind", OF_TIMES)
def test_a_constraint_holds_for_the_aggregate_of_the_rows_of_a_key(kind):
    solves = constrained(kind, "(for-each g)").solve(data=given()).solves
    found = [float(of(each, "a").value) for each in solves]
    assert found == pytest.approx([3 / OF_TIMES[kind](T[g == GROUP]) for g in (1, 2)], rel=1e-7)
    alone = constrained(kind, "").solve(data=given(GROUP > 1))
    assert found[1] == pytest.approx(float(alone["a"].value), rel=1e-7)


@pytest.mark.parametrize("kind", OF_TIMES)
def test_a_constraint_holds_for_the_aggregate_of_the_rows_of_a_window(kind):
    solves = constrained(kind, "(window t :length 1.5 :step 0.6 :min-rows 2)").solve(data=given()).solves
    ends = [end for end in np.arange(6) * 0.6 if np.sum((end - 1.5 < T) & (end >= T)) > 1]
    inside = [T[(end - 1.5 < T) & (end >= T)] for end in ends]
    assert len({len(times) for times in inside}) > 1
    found = [float(of(each, "a").value) for each in solves if each.status.value != "skipped"]
    assert found == pytest.approx([3 / OF_TIMES[kind](times) for times in inside], rel=1e-7)


def test_rows_of_a_key_are_counted_and_their_families_are_theirs():
    rng = np.random.default_rng(4)
    group, point = np.repeat([1, 1, 1, 2, 2], 2), np.tile([1, 2], 5)
    y = rng.normal(size=10)
    problem = mbm.loads("""
        (problem p
          (data d external)
          (for-each g)
          (unknowns (h :per d.i))
          (observe d (= y (h i)) :sigma 1)
          (constraints (= (mean d (h i)) 0) (<= (count d (> y -9)) 6))
          (solve :constraints exact))""")
    for each, g in zip(problem.solve(data={"d": {"g": group, "i": point, "y": y}}).solves, (1, 2), strict=True):
        mean = np.array([y[(group == g) & (point == i)].mean() for i in (1, 2)])
        assert np.ravel(of(each, "h").value) == pytest.approx(mean - mean.mean(), abs=1e-7)


def test_a_part_without_rows_has_no_aggregate():
    problem = mbm.loads("""
        (problem p
          (data d external) (data e external)
          (for-each g)
          (unknowns (a))
          (observe d (= y a) :sigma 1)
          (constraints (= (mean e (* a u)) 0.5))
          (solve :constraints exact))""")
    rows = {"d": {"g": [1, 1, 2, 2], "y": [1.0, 2.0, 3.0, 4.0]}, "e": {"g": [1], "u": [0.5]}}
    solves = problem.solve(data=rows).solves
    assert [[d.code.name for d in each.diagnostics] for each in solves] == [[], ["empty-aggregate"]]
    assert "`e` has no rows" in solves[1].diagnostics[0].message


@pytest.mark.parametrize("form", ["(mean e 3)", "(max e a)", "(rms e (+ a 1))"])
def test_a_part_without_rows_has_no_aggregate_of_what_no_row_changes(form):
    found = mbm.loads(COUNTED.format(form=form, key="(for-each g)")).solve(data=PARTLY)
    assert [d.code.name for d in found.solves[1].diagnostics] == ["empty-aggregate"]


COUNTED = """(problem p (data d external) (data e external) {key} (unknowns (a))
  (observe d (= y (* a x)) :sigma 1) (constraints (= a (+ 1 {form}))) (solve :constraints exact))"""
PARTLY = {
    "d": {"g": [1, 1, 2, 2], "x": [1.0, 2.0, 3.0, 4.0], "y": [1.0, 2.0, 3.0, 4.0]},
    "e": {"g": [1, 1], "u": [0.5, 2.0]},
}


@pytest.mark.parametrize(
    ("form", "counts"),
    [
        ("(count e (> u 1))", [1, 0]),
        ("(count e (not (> u 1)))", [1, 0]),
        ("(count e)", [2, 0]),
        ("(count e true)", [2, 0]),
    ],
)
def test_there_are_none_in_a_part_without_rows(form, counts):
    """As in a table without any, with the rows of the key alone."""
    found = mbm.loads(COUNTED.format(form=form, key="(for-each g)")).solve(data=PARTLY).solves
    assert [float(of(each, "a").value) for each in found] == pytest.approx([1 + n for n in counts], rel=1e-12)
    none = {**PARTLY, "e": {"g": np.empty(0), "u": np.empty(0)}}
    alone = mbm.loads(COUNTED.format(form=form, key="")).solve(data=none)
    assert float(alone["a"].value) == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("key", ["", "(for-each g)"])
@pytest.mark.parametrize(
    ("constraint", "a"),
    [("(= (mean d (- t a)) 1K)", 24), ("(= (mean d t) (+ a 1K))", 24), ("(= (- (max d t) a) (- 30degC 20degC))", 20)],
)
def test_a_constraint_takes_cells_in_degrees_as_what_they_are(key, constraint, a):
    """The mean of 20 and 30 °C is 25 °C."""
    found = mbm.loads(f"""(problem p (data d (table (t g) (20degC 1) (30degC 1))) {key}
      (unknowns (a :init 20degC :unit degC)) (observe d (= t a) :sigma 1K)
      (constraints {constraint}) (solve :constraints exact))""").solve()
    assert float(of(found.first, "a").value) == pytest.approx(a, rel=1e-9)
    assert of(found.first, "a").unit == "degC"


@pytest.mark.parametrize("key", ["", "(for-each g)"])
@pytest.mark.parametrize("head", ["mean d", "rms d", "median d", "quantile d 0.3", "max d"])
def test_an_aggregate_in_a_constraint_has_the_unit_of_its_form(key, head):
    text = f"""(problem p (data d (table (g x y) (1 1m 2s) (1 2m 4s) (2 3m 7s))) {key} (unknowns (a) (b :init 1))
      (observe d (= y (* a x)) :sigma 1s) (constraints (<= ({head} (* a x)) 9s) (<= ({head} (* b x)) 9s)))"""
    assert [each.code.name for each in mbm.loads(text).check()] == ["unmentioned"]
    assert of(mbm.loads(text).solve().first, "b").unit == "s/m"
    assert [each.code.name for each in mbm.loads(text.replace("(* a x)) 9s", "(* a x)) 9m")).check()] == ["unit-clash"]


@pytest.mark.parametrize("dividing", ["(for-each g)", "(window g :length 1 :step 1)"])
def test_a_form_that_wants_texts_of_divided_rows_is_told_why(faults, dividing):
    (fault,) = faults(f"""(problem p (data d (table (g k y) (1 "x" 1) (1 "y" 2) (2 "x" 3))) {dividing}
      (unknowns (a) (b)) (observe d (= y (+ a b)) :sigma 1)
      (constraints (= (mean d (if (= k "x") a b)) 1)) (solve :constraints exact))""")
    assert fault.code.name == "not-static"
    assert "`k`" in fault.message
    assert "`for-each`" in fault.message
    assert "unknown" not in fault.message


@pytest.mark.parametrize("level", [0, 0.05, 0.3, 0.5, 2 / 3, 0.9, 1])
@pytest.mark.parametrize("sizes", [(1, 2, 3, 7, 8), (5, 5, 5)])
def test_quantiles_of_keys_of_many_sizes_are_those_of_numpy(level, sizes):
    """The formula is that of the most rows, whatever the level; a is above zero, so that rows keep their order."""
    g = np.repeat(np.arange(len(sizes)), sizes)
    x = np.random.default_rng(5).uniform(1, 4, len(g))
    text = f"""(problem p (data d external) (for-each g) (unknowns (a :init 1)) (observe d (= y (* a x)) :sigma 1)
      (constraints (= (quantile d {level!r} (* a x)) 3)) (solve :constraints exact))"""
    found = mbm.loads(text).solve(data={"d": {"g": g, "x": x, "y": x}}).solves
    wanted = [3 / np.quantile(x[g == k], level) for k in range(len(sizes))]
    assert [float(of(each, "a").value) for each in found] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("keys", ["", "(for-each g)"])
def test_medians_of_hundreds_of_rows_can_be_written_out(keys):
    text = f"""(problem p (data d external) {keys} (unknowns (a :init 1)) (observe d (= y (* a x)) :sigma 1)
      (constraints (= (median d (* a x)) 3)))"""
    x = np.linspace(1, 2, 383)
    told = mbm.loads(text).check(data={"d": {"g": (np.arange(383) < 3) * 1.0, "x": x, "y": x}})
    assert "too-much-to-compile" not in [fault.code.name for fault in told]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 13, 32, 37])
def test_the_exchanges_sort(count):
    values = list(np.random.default_rng(count).integers(0, 9, size=count))
    wanted = sorted(values)
    for lower, upper in exchanges(count):
        values[lower], values[upper] = sorted((values[lower], values[upper]))
    assert values == wanted


def test_other_data_make_the_constraint_anew():
    compiled = mbm.loads(
        text("(constraints (= (mean d (* a t)) 3)) (solve :constraints exact)").replace(
            "(exp (* b t))", "(+ 1 (* b t))"
        )
    ).compile()
    for rows in (slice(None), slice(1, 6), slice(None)):
        solved = compiled.solve(data=given(rows))
        assert float(solved["a"].value) == pytest.approx(3 / T[rows].mean(), rel=1e-9)


def test_what_decides_equations_is_known_where_the_rows_are():
    more = '(constraints (= (mean d (if (= k "x") a b)) 1)) (solve :constraints exact)'
    data = {"d": {**given()["d"], "k": ["x", *"yyyyyy"]}}
    solved = mbm.loads(text(more)).solve(data=data)
    assert float(solved["a"].value) + 6 * float(solved["b"].value) == pytest.approx(7, rel=1e-7)
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text(f"(for-each g) {more}")).solve(data=data)
    assert [d.code.name for d in caught.value.diagnostics] == ["not-static"]


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ("(observe more d (= t (mean d t)))", "aggregate-misplaced"),
        ("(derive (f (sample d y (mean d t) :by t)))", "aggregate-misplaced"),
        ("(derive (f (mean d)))", "bad-form"),
        ("(derive (f (quantile d 1.5 t)))", "bad-form"),
        ("(derive (f (quantile d a t)))", "not-static"),
        ("(derive (f (mean nobody t)))", "unknown-name"),
        ("(derive (f (let ((u t)) (mean d (* u t))) :over d))", "bad-form"),
    ],
)
def test_what_is_refused(more, code):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text(more)).solve(data=given())
    assert code in {d.code.name for d in caught.value.diagnostics}


def test_names_of_the_user_come_first():
    solved = mbm.loads("""
        (problem p
          (data d (table (t y) (1 1.0) (2 3.0)))
          (unknowns (mean (array 2) :init 0))
          (defun median (x y) (+ x y))
          (observe d (= y (mean t)) :sigma 0.1)
          (derive (f (median (mean 1) (mean 2))) (g (min (mean 1) (mean 2)))))""").solve()
    assert float(solved["f"].value) == pytest.approx(4.0)
    assert float(solved["g"].value) == pytest.approx(1.0)


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
def test_other_backends_say_the_same(backend):
    more = "(derive (f (quantile d 0.3 (* a (exp (* b t))))) (g (rms d (- y (* a (exp (* b t)) 1.1)))))"
    wanted = mbm.loads(text(more)).solve(data=given())
    found = mbm.loads(text(more)).compile(backend=backend).solve(data=given())
    for name in ("f", "g"):
        assert float(found[name].value) == pytest.approx(float(wanted[name].value), rel=1e-9)
        assert float(found[name].sigma) == pytest.approx(float(wanted[name].sigma), rel=1e-7)


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
def test_generated_solvers_refuse_it(target, tmp_path):
    file = tmp_path / "p.mbm"
    file.write_text("""
        (problem p
          (data d (table (t y) (1 1.0) (2 3.0)))
          (unknowns (a :init 0))
          (observe d (= y (* a t)) :sigma 0.1)
          (derive (f (mean d (* a t)))))""")
    with pytest.raises(mbm.MbmError) as caught:
        emit_file(file, SolveOptions(), target)
    assert {d.code.name for d in caught.value.diagnostics} == {"not-emitted"}
