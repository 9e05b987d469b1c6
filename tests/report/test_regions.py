"""Joint regions of two numbers, against SciPy's quantiles, contours found anew, and how often they hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import f as fisher

import mbm
from mbm.report.regions import Region

X = np.linspace(1.0, 2.0, 6)
LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {sigma}) {more})"
DAYS = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0])
OXYGEN = """(problem p (data d external) (unknowns (a :init 214) (k :init 0.55))
  (observe d (= y (* a (- 1 (exp (* -1 k x))))) :sigma 20) {more})"""


def readings(seed, runs=1):
    """Readings on the line 2 − x."""
    y = 2 - X + 0.1 * np.random.default_rng(seed).normal(size=(runs, len(X)))
    return {"d": {"x": np.tile(X, runs), "y": y.ravel(), "run": np.repeat(np.arange(runs), len(X))}}


def oxygen(seed):
    """The oxygen demand of Bates and Watts, drawn anew."""
    y = 214 * (1 - np.exp(-0.55 * DAYS)) + 20 * np.random.default_rng(seed).normal(size=6)
    return {"d": {"x": DAYS, "y": y}}


@pytest.mark.parametrize(("sigma", "dof"), [("0.1", np.inf), ("unknown", 4)])
@pytest.mark.parametrize("level", [0.5, 0.95, 0.999])
def test_the_boundary_of_a_line_is_where_the_cost_has_grown_by_2f(sigma, dof, level):
    """(x − x̂)ᵀ JᵀJ (x − x̂) = 2 F s², with J of the line written down."""
    result = mbm.loads(LINE.format(sigma=sigma, more="")).solve(data=readings(1))
    region = result.region("a", "b", level)
    jacobian = np.column_stack([np.ones(6), X])
    variance = 0.01 if dof == np.inf else result.cost / dof
    quantile = fisher.ppf(level, 2, 1e12 if dof == np.inf else dof)
    grown = np.square((region.boundary - region.centre) @ jacobian.T).sum(axis=1) / variance
    np.testing.assert_allclose(grown, 2 * quantile, rtol=1e-8)  # SciPy's quantile for 1e12 in place of infinity
    assert region.kind == "t"
    assert region.dof == dof
    np.testing.assert_allclose(region.axes[0] @ region.axes[1], 0.0, atol=1e-12)
    inside, outside = (region.centre + share * (region.boundary - region.centre) for share in (0.999, 1.001))
    assert region.holds(inside).all()
    assert not region.holds(outside).any()


def test_units_and_derived_quantities_go_with_it():
    text = """(problem p (data d external :columns ((x :unit s) (y :unit mm))) (unknowns (a :unit mm) (b :unit mm/s))
      (observe d (= y (+ a (* b x))) :sigma 0.1mm) (derive (end (+ a (* b 3s)) :unit mm)))"""
    data = {"d": {name: values for name, values in readings(2)["d"].items() if name != "run"}}
    result = mbm.loads(text).solve(data=data)
    plain = mbm.loads(LINE.format(sigma=0.1, more="")).solve(data=data)
    np.testing.assert_allclose(result.region("a", "b").boundary, plain.region("a", "b").boundary, rtol=1e-9)
    region = result.region("b", "end")
    assert region.units == ("mm/s", "mm")
    turn = np.array([[0.0, 1.0], [1.0, 3.0]])  # (a, b) → (b, a + 3 b): the same cost
    own = np.square((region.boundary - region.centre) @ np.linalg.inv(turn).T @ np.column_stack([np.ones(6), X]).T)
    np.testing.assert_allclose(own.sum(axis=1) / 0.01, 2 * -np.log(0.05), rtol=1e-8)


def test_where_the_model_bends_the_boundary_is_a_contour_of_the_cost():
    """With two unknowns nothing is left to minimise: the cost at the boundary has grown by 2 F."""
    result = mbm.loads(OXYGEN.format(more="")).solve(data=oxygen(1))
    region = result.region("a", "k")
    y = oxygen(1)["d"]["y"]
    closed = np.isfinite(region.boundary).all(axis=1)
    assert region.kind == "profile"
    assert closed.sum() > 60
    a, k = region.boundary[closed].T
    cost = np.square((a[:, None] * (1 - np.exp(-k[:, None] * DAYS)) - y) / 20).sum(axis=1)
    np.testing.assert_allclose(cost - result.cost, -2 * np.log(0.05), rtol=4e-3)  # ends are found to 1e-3 of themselves


def test_the_other_unknowns_are_at_their_best_on_the_boundary():
    """A background is a third unknown: SciPy finds it anew at some points of the boundary."""
    x = np.linspace(0.0, 4.0, 12)
    y = 1 + 5 * np.exp(-x) + 0.8 * np.random.default_rng(3).normal(size=12)
    text = """(problem p (data d external) (unknowns (a :init 5) (k :init 1) (c :init 1))
      (observe d (= y (+ c (* a (exp (* -1 k x))))) :sigma 0.8))"""
    result = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})
    region = result.region("a", "k")
    assert region.kind == "profile"
    looked_at = 0
    for a, k in region.boundary[::9]:
        if not np.isfinite(a + k):
            continue
        best = least_squares(lambda c, a=a, k=k: (c[0] + a * np.exp(-k * x) - y) / 0.8, [1.0], xtol=1e-14)
        assert 2 * best.cost - result.cost == pytest.approx(-2 * np.log(0.05), rel=5e-3)
        looked_at += 1
    assert looked_at >= 4


def test_what_has_no_region_is_refused():
    result = mbm.loads(LINE.format(sigma=0.1, more="(derive (twice (* 2 a)))")).solve(data=readings(1))
    for first, second in (("a", "a"), ("a", "twice")):
        with pytest.raises(mbm.MbmError, match="no joint region"):
            result.region(first, second)
    with pytest.raises(KeyError, match="no number is called `q`; there are"):
        result.region("a", "q")
    with pytest.raises(ValueError, match="between 0 and 1"):
        result.region("a", "b", 95)
    with pytest.raises(ValueError, match=r"such as 0\.95 for 95 %"):
        result.region("a", "b", "95%")
    limited = mbm.loads(LINE.format(sigma=0.1, more="(constraints (<= a 1.9))")).solve(data=readings(1))
    with pytest.raises(mbm.MbmError) as caught:
        limited.region("a", "b")
    assert caught.value.diagnostics[0].code.name == "no-region"
    turned = mbm.loads("""(problem p (data d (table (x y u v) (0 0 1 2) (1 0 1.9 2.1) (0 1 0.9 3.0)))
      (unknowns (T (pose 2))) (observe d (= [u v] (transform T [x y])) :sigma 0.1))""").solve()
    with pytest.raises(mbm.MbmError, match="a part of a pose"):
        turned.region("T.trans[1]", "T.trans[2]")
    many = mbm.loads(LINE.format(sigma=0.1, more="(for-each run)")).solve(data=readings(1, 3))
    with pytest.raises(LookupError):
        many.region("a", "b")


def test_regions_hold_the_truth_as_often_as_they_say():
    """400 draws of 6 rows with unknown noise: 95 % ± 3.3 % (three standard deviations of a share)."""
    runs = 400
    many = mbm.loads(LINE.format(sigma="unknown", more="(for-each run)")).solve(data=readings(4, runs))
    held = sum(bool(solve.region("a", "b").holds([2.0, -1.0])) for solve in many.solves)
    assert abs(held / runs - 0.95) < 0.033


def test_a_region_without_an_end_holds_what_lies_far_that_way():
    """A circle of which one half has no end: points there are within however far they are, others as in the circle."""
    turn = 2 * np.pi / 72 * np.arange(72)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    centre = np.array([1.0, 2.0])
    boundary = np.where((circle[:, :1] > 0.1) & (circle != 0.0), np.copysign(np.inf, circle), centre + circle)
    region = Region(
        names=("a", "b"), units=("", ""), level=0.95, centre=centre, axes=np.eye(2), radius=1.0, dof=np.inf,
        boundary=boundary, kind="profile",
    )  # fmt: skip
    points = centre + np.array([[1e6, 1e5], [0.5, 0.0], [-0.99, 0.0], [-1.01, 0.0], [-1e6, 0.0], [0.0, 1.01]])
    assert region.holds(points).tolist() == [True, True, True, False, False, False]


@pytest.mark.slow
def test_bent_regions_hold_the_truth_as_often_as_they_say():
    """400 draws, of which the profile takes some 30 ms each."""
    runs = 400
    held = 0
    for seed in range(runs):
        result = mbm.loads(OXYGEN.format(more="")).solve(data=oxygen(seed))
        held += bool(result.region("a", "k").holds([214.0, 0.55]))
    assert abs(held / runs - 0.95) < 0.033


def test_several_numbers_have_no_region():
    text = "(problem p (data d (table (x y) (1 1) (2 2.1) (3 2.9))) (unknowns (v (vector 2)) (a :init 0 :sigma 1)) "
    result = mbm.loads(text + "(observe d (= y (+ (v 1) (* x (v 2)))) :sigma 0.1))").solve()
    with pytest.raises(mbm.MbmError, match=r"`v` has 2 numbers: name one of them, such as `v\[1\]`"):
        result.region("a", "v")
