"""`:errors` against other ways to the same optimum: SciPy over corrections and unknowns, closed forms, ODRPACK."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.implicit_reference import (
    ODRPACK_CONIC,
    ODRPACK_GROWTH,
    PEARSON,
    deming,
    joint_optimum,
    rim_angles,
    rim_points,
    york,
)
from tests.evidence.material import EXAMPLES

LINE = """
(problem line
  (data pts external)
  (unknowns (a) (b))
  (observe pts (= y (+ a (* b x))) :errors ((x sx) (y sy))))
"""

CONIC = """
(problem conic
  (data pts external)
  (unknowns (b1 :init -1) (b2 :init -3) (b3 :init 0.09) (b4 :init 0.02) (b5 :init 0.08))
  (observe pts
    (let ((p (- x b1)) (q (- y b2))) (- (+ (* b3 (^ p 2)) (* 2 b4 p q) (* b5 (^ q 2))) 1))
    :errors ((x 1) (y 1))))
"""

GROWTH = """
(problem growth
  (data d external)
  (unknowns (b1 :init 1500) (b2 :init -50) (b3 :init -0.1))
  (observe d (= y (+ b1 (* b2 (^ (- (exp (* b3 x)) 1) 2)))) :errors ((x sx)) :sigma 1))
"""


def value(solved: mbm.Result, *names: str) -> np.ndarray:
    return np.array([float(solved[name].value) for name in names])


def sigma(solved: mbm.Result, *names: str) -> np.ndarray:
    return np.array([float(solved[name].sigma) for name in names])


def corrections(solved: mbm.Result, table: str, column: str) -> np.ndarray:
    return np.array(solved.document()["solves"][0]["corrections"][table][column]["value"])


def test_pearsons_line_is_the_published_one() -> None:
    x, wx, y, wy = PEARSON.T
    data = {"x": x, "y": y, "sx": wx**-0.5, "sy": wy**-0.5}
    solved = mbm.loads(LINE).solve(data={"pts": data})
    # York 1966 and Neri et al. 1989: 5.47991022, −0.480533407, S = 11.8663531941
    np.testing.assert_allclose(value(solved, "a", "b"), [5.47991022, -0.480533407], rtol=1e-9)
    assert solved.first.cost == pytest.approx(11.8663531941, rel=1e-11)
    # the iteration stops within 1e-10 standard deviations of the minimum
    np.testing.assert_allclose(value(solved, "a", "b"), york(x, wx, y, wy), rtol=1e-10)
    assert solved.first.dof == 8


@pytest.mark.parametrize("ratio", [0.25, 1.0, 9.0])
def test_a_line_with_equal_errors_is_demings(ratio: float) -> None:
    random = np.random.default_rng(8)
    x = np.linspace(-2, 3, 40) + 0.1 * random.normal(size=40)
    y = 1 + 2 * x + 0.2 * random.normal(size=40)
    data = {"x": x, "y": y, "sx": np.full(40, 0.1), "sy": np.full(40, 0.1 * ratio**0.5)}
    solved = mbm.loads(LINE).solve(data={"pts": data})
    np.testing.assert_allclose(value(solved, "a", "b"), deming(x, y, ratio), rtol=1e-10)


def test_odrpacks_first_set_to_its_digits_and_beyond() -> None:
    x, y = ODRPACK_GROWTH.T
    sx = np.where((x == 0) | (x == 100), 0.0, 1.0)  # ODRPACK's run holds these three fixed
    solved = mbm.loads(GROWTH).solve(data={"d": {"x": x, "y": y, "sx": sx}})
    found, deviations = value(solved, "b1", "b2", "b3"), sigma(solved, "b1", "b2", "b3")
    # ODRPACK's report: its test on the sum of squares (1.5e-8) leaves the parameters within 1e-4 standard deviations
    report = np.array([1264.65481, -54.0184100, -0.0878497122])
    assert np.abs((found - report) / deviations).max() < 1e-4
    assert solved.first.cost == pytest.approx(21.4455017, abs=6e-8)
    # its standard deviations are scaled by the residual standard deviation, and rounded to three digits
    scale = (solved.first.cost / solved.first.dof) ** 0.5
    assert solved.first.dof == 9
    assert scale == pytest.approx(1.54364294, rel=1e-8)
    np.testing.assert_allclose(deviations * scale, [1.03, 1.58, 6.33e-3], rtol=5e-3)

    moving = sx > 0

    def residuals(point: np.ndarray) -> np.ndarray:
        shift = np.zeros(12)
        shift[moving] = point[3:]
        model = point[0] + point[1] * np.expm1(point[2] * (x + shift)) ** 2
        return np.concatenate([y - model, point[3:]])

    exact = joint_optimum(residuals, np.array([1264.0, -54.0, -0.088]), np.zeros(9))
    np.testing.assert_allclose(found, exact.values, atol=1e-7 * exact.sigma.min())
    np.testing.assert_allclose(deviations, exact.sigma, rtol=1e-6)
    assert solved.first.cost == pytest.approx(exact.cost, rel=1e-13)
    np.testing.assert_allclose(corrections(solved, "d", "x"), exact.others, atol=1e-7)


def test_odrpacks_implicit_conic_to_its_digits_and_beyond() -> None:
    points = ODRPACK_CONIC
    solved = mbm.loads(CONIC).solve(data={"pts": {"x": points[:, 0], "y": points[:, 1]}})
    names = ("b1", "b2", "b3", "b4", "b5")
    found = value(solved, *names)
    # ODRPACK's report: a penalty of 1e5 stands for the equations, which leaves four to five digits
    report = np.array([-0.999381804, -2.93104759, 0.0875730238, 0.0162299929, 0.0797537723])
    np.testing.assert_allclose(found, report, rtol=1e-5)
    scale = (solved.first.cost / solved.first.dof) ** 0.5
    assert solved.first.dof == 15
    np.testing.assert_allclose(sigma(solved, *names) * scale, [0.111, 0.110, 4.11e-3, 2.75e-3, 3.50e-3], rtol=5e-3)

    def residuals(point: np.ndarray) -> np.ndarray:
        return (rim_points(point[:5], point[5:]) - points).ravel()

    exact = joint_optimum(residuals, report, rim_angles(report, points))
    assert solved.first.cost == pytest.approx(exact.cost, rel=1e-12)
    np.testing.assert_allclose(found, exact.values, atol=1e-7 * exact.sigma.min())
    np.testing.assert_allclose(sigma(solved, *names), exact.sigma, rtol=1e-6)
    moved = points + np.stack([corrections(solved, "pts", c) for c in "xy"], axis=1)
    np.testing.assert_allclose(moved, rim_points(exact.values, exact.others), atol=1e-7)


def ellipse_points(random: np.random.Generator, count: int, spread: float) -> np.ndarray:
    angle, turn = random.uniform(0, 2 * np.pi, count), 0.4
    rim = np.stack([2 * np.cos(angle), np.sin(angle)])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ rim
    return np.asarray(turned.T + [1.0, -0.5] + spread * random.normal(size=(count, 2)))


@pytest.mark.parametrize("spread", [0.02, 0.2])
def test_the_ellipse_of_the_examples_is_the_exact_optimum(spread: float, tmp_path) -> None:
    text = (EXAMPLES / "ellipse.mbm").read_text().replace("0.02", repr(spread))
    points = ellipse_points(np.random.default_rng(1), 60, spread)
    (tmp_path / "ellipse.mbm").write_text(text)
    rows = "".join(f"{x!r},{y!r}\n" for x, y in points.tolist())
    (tmp_path / "rim.csv").write_text("x,y\n" + rows)
    solved = mbm.load(tmp_path / "ellipse.mbm").solve()
    assert solved.first.status == "converged"

    def rim(values: np.ndarray, angle: np.ndarray) -> np.ndarray:
        c1, c2, a, b, turn = values
        u, v = a * np.cos(angle), b * np.sin(angle)
        return np.stack([c1 + u * np.cos(turn) - v * np.sin(turn), c2 + u * np.sin(turn) + v * np.cos(turn)], axis=1)

    start = np.array([1.0, -0.5, 2.0, 1.0, 0.4])
    relative = points - start[:2]
    turned = np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]]) @ relative.T
    angles = np.arctan2(turned[1], turned[0] / 2)
    exact = joint_optimum(lambda p: ((rim(p[:5], p[5:]) - points) / spread).ravel(), start, angles)
    found = np.concatenate([solved["c"].value, value(solved, "a", "b", "phi")])
    assert solved.first.cost == pytest.approx(exact.cost, rel=1e-11)
    # SciPy's differenced Jacobian settles to about 1e-7 of a standard deviation
    np.testing.assert_allclose(found, exact.values, atol=1e-6 * exact.sigma.min())
    deviations = np.concatenate([solved["c"].sigma, sigma(solved, "a", "b", "phi")])
    np.testing.assert_allclose(deviations, exact.sigma, rtol=1e-5)
    moved = points + np.stack([corrections(solved, "pts", c) for c in "xy"], axis=1)
    np.testing.assert_allclose(moved, rim(exact.values, exact.others), atol=1e-6)


STATIONS = """
(problem explicit
  (data stations external :key id) (data tags external :key id) (data ranges external)
  (unknowns (p (vector 2) :per tags :init [5 4]) (q (vector 2) :per stations :init [x y] :sigma s))
  (observe ranges (= r (norm (- (p tag) (q station)))) :sigma 0.02))
(problem shared
  (data stations external :key id) (data tags external :key id) (data ranges external :with (stations station))
  (unknowns (p (vector 2) :per tags :init [5 4]))
  (observe ranges (= r (norm (- (p tag) [stations.x stations.y])))
    :errors ((stations.x stations.s) (stations.y stations.s)) :sigma 0.02))
(problem apart
  (data stations external :key id) (data tags external :key id) (data ranges external :with (at stations station))
  (unknowns (p (vector 2) :per tags :init [5 4]))
  (observe first-ones ranges (= r (norm (- (p tag) [at.x at.y])))
    :errors ((at.x at.s) (at.y at.s)) :sigma 0.02 :when (<= tag 2))
  (observe others ranges (= r (norm (- (p tag) [at.x at.y]))) :sigma 0.02 :when (> tag 2)))
(problem measured
  (data stations external :key id) (data tags external :key id) (data ranges external :with (stations station))
  (unknowns (p (vector 2) :per tags :init [5 4]))
  (observe ranges (= r (norm (- (p tag) [stations.x stations.y])))
    :errors ((stations.x stations.s) (stations.y stations.s) (r 0.02))))
"""


def stations() -> dict[str, dict[str, np.ndarray]]:
    random = np.random.default_rng(3)
    places = np.array([[0, 0], [10, 0], [10, 8], [0, 8], [5, -3.0]])
    tags = np.array([[3, 4], [6, 2], [5, 5.0]])
    deviation = np.array([0.05, 0.03, 0.0, 0.06, 0.05])
    tag, station = (index.ravel() for index in np.indices((3, 5)))
    ranges = np.hypot(*(tags[tag] - places[station]).T) + 0.02 * random.normal(size=15)
    measured = places + deviation[:, None] * random.normal(size=places.shape)
    table = {"id": np.arange(1, 6), "x": measured[:, 0], "y": measured[:, 1], "s": deviation}
    pairs = {"tag": tag + 1, "station": station + 1, "r": ranges}
    return {"stations": table, "tags": {"id": np.arange(1, 4)}, "ranges": pairs}


@pytest.mark.parametrize("name", ["shared", "apart", "measured"])
def test_a_value_that_many_rows_use_has_one_correction(name: str) -> None:
    """Against the same problem with the stations as unknowns and their measured places as priors."""
    tables = stations()
    tables["stations"]["s"][2] = 0.01
    reference = mbm.loads(STATIONS).named("explicit").solve(data=tables)
    solved = mbm.loads(STATIONS).named(name).solve(data=tables)
    assert solved.first.cost == pytest.approx(reference.first.cost, rel=1e-10)
    assert solved.first.dof == reference.first.dof
    np.testing.assert_allclose(solved["p"].value, reference["p"].value, atol=1e-10)
    np.testing.assert_allclose(solved["p"].sigma, reference["p"].sigma, rtol=1e-8)
    measured = np.stack([tables["stations"][c] for c in "xy"], axis=1)
    moved = measured + np.stack([corrections(solved, "stations", c) for c in "xy"], axis=1)
    np.testing.assert_allclose(moved, reference["q"].value, atol=1e-9)
    document = solved.document()["solves"][0]["corrections"]["stations"]["x"]
    assert document["rows"] == document["keys"] == [1, 2, 3, 4, 5]


def test_values_without_error_are_left_alone() -> None:
    tables = stations()
    solved = mbm.loads(STATIONS).named("shared").solve(data=tables)
    assert solved.document()["solves"][0]["corrections"]["stations"]["x"]["rows"] == [1, 2, 4, 5]


def test_a_loss_acts_on_the_whole_misfit_of_a_row() -> None:
    """A line with one row far off: the robust cost against SciPy's over unknowns alone, the misfit in closed form."""
    random = np.random.default_rng(2)
    x = np.linspace(0, 5, 30) + 0.1 * random.normal(size=30)
    y = 1 + 0.5 * x + 0.1 * random.normal(size=30)
    y[7] += 4.0
    text = LINE.replace("(y sy))", "(y sy)) :loss (huber 1.5)")
    data = {"x": x, "y": y, "sx": np.full(30, 0.1), "sy": np.full(30, 0.1)}
    solved = mbm.loads(text).solve(data={"pts": data})

    from scipy.optimize import minimize

    def cost(point: np.ndarray) -> float:
        misfit = np.abs(y - point[0] - point[1] * x) / (0.1 * np.sqrt(1 + point[1] ** 2))
        return float(np.where(misfit <= 1.5, misfit**2, 2 * 1.5 * misfit - 1.5**2).sum())

    exact = minimize(cost, [1.0, 0.5], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 2000})
    np.testing.assert_allclose(value(solved, "a", "b"), exact.x, atol=1e-7)


def test_rows_that_disagree_are_left_out_by_consensus() -> None:
    points = ellipse_points(np.random.default_rng(4), 50, 0.02)
    wrong = np.array([3, 11, 12, 30, 41])
    points[wrong] += [[0.6, 0.5]]
    text = CONIC.replace("((x 1) (y 1))))", "((x 0.02) (y 0.02)))\n  (solve :robust lmeds))")
    text = text.replace("-1", "1", 1).replace("-3", "-0.5").replace("0.09", "0.4").replace("0.08", "0.8")
    solved = mbm.loads(text).solve(data={"pts": {"x": points[:, 0], "y": points[:, 1]}})
    outliers = solved.document()["solves"][0]["residuals"]["pts"]["outliers"]
    assert set(wrong + 1) <= set(outliers)
    kept = np.setdiff1d(np.arange(50), np.array(outliers) - 1)
    plain = mbm.loads(text.replace("(solve :robust lmeds)", "")).solve(
        data={"pts": {"x": points[kept, 0], "y": points[kept, 1]}}
    )
    names = ("b1", "b2", "b3", "b4", "b5")
    np.testing.assert_allclose(value(solved, *names), value(plain, *names), atol=1e-9)


TRANSFORM = """
(problem explicit
  (data pts external :key id)
  (unknowns (t (vector 2) :init [0 0]) (turn angle :init 0) (grow positive :init 1)
    (p (vector 2) :per pts :init [x y] :sigma 0.03))
  (observe pts (= [u v] (+ t (* grow (mulmv (rot2 turn) (p id))))) :covariance [[4e-4 1e-4] [1e-4 9e-4]]))
(problem corrected
  (data pts external)
  (unknowns (t (vector 2) :init [0 0]) (turn angle :init 0) (grow positive :init 1))
  (observe pts (= [u v] (+ t (* grow (mulmv (rot2 turn) [x y]))))
    :errors ((x 0.03) (y 0.03)) :covariance [[4e-4 1e-4] [1e-4 9e-4]]))
"""


def test_errors_on_both_sides_beside_a_covariance() -> None:
    """Two equations a row, with a full matrix of their own: against the true points as unknowns with priors."""
    random = np.random.default_rng(6)
    places = random.uniform(-1, 1, (12, 2))
    cosine, sine = np.cos(0.6), np.sin(0.6)
    seen = 1.7 * places @ np.array([[cosine, sine], [-sine, cosine]]) + [0.3, -0.2]
    seen += random.multivariate_normal([0, 0], [[4e-4, 1e-4], [1e-4, 9e-4]], 12)
    measured = places + 0.03 * random.normal(size=(12, 2))
    table = {"id": np.arange(12), "x": measured[:, 0], "y": measured[:, 1], "u": seen[:, 0], "v": seen[:, 1]}
    reference = mbm.loads(TRANSFORM).named("explicit").solve(data={"pts": table})
    solved = mbm.loads(TRANSFORM).named("corrected").solve(data={"pts": table})
    assert solved.first.cost == pytest.approx(reference.first.cost, rel=1e-10)
    assert solved.first.dof == reference.first.dof == 20
    np.testing.assert_allclose(solved["t"].value, reference["t"].value, atol=1e-10)
    np.testing.assert_allclose(value(solved, "turn", "grow"), value(reference, "turn", "grow"), atol=1e-10)
    np.testing.assert_allclose(solved["t"].sigma, reference["t"].sigma, rtol=1e-7)
    np.testing.assert_allclose(sigma(solved, "turn", "grow"), sigma(reference, "turn", "grow"), rtol=1e-7)
    moved = measured + np.stack([corrections(solved, "pts", c) for c in "xy"], axis=1)
    np.testing.assert_allclose(moved, reference["p"].value, atol=1e-9)


def test_every_method_ends_at_the_same_minimum() -> None:
    x, wx, y, wy = PEARSON.T
    data = {"pts": {"x": x, "y": y, "sx": wx**-0.5, "sy": wy**-0.5}}
    for option in (":method dogleg", ":method gauss-newton", ":method ipopt", ":starts (random 4)", ":robust gnc"):
        text = LINE.replace("(a) (b)", "(a :in (0 10)) (b :in (-3 3))").rstrip()[:-1] + f" (solve {option}))"
        solved = mbm.loads(text).solve(data=data)
        np.testing.assert_allclose(value(solved, "a", "b"), [5.47991022, -0.480533407], rtol=1e-8)


def test_constraints_hold_beside_errors() -> None:
    x, wx, y, wy = PEARSON.T
    data = {"pts": {"x": x, "y": y, "sx": wx**-0.5, "sy": wy**-0.5}}
    text = LINE.rstrip()[:-1] + " (constraints (= b -0.5)))"
    solved = mbm.loads(text).solve(data=data)
    # with the slope known the equations are linear in a: the weighted mean of y + x/2
    weight = 1 / (1 / wy + 0.25 / wx)
    assert float(solved["a"].value) == pytest.approx(np.average(y + 0.5 * x, weights=weight), rel=1e-9)
    assert float(solved["a"].sigma) == pytest.approx(weight.sum() ** -0.5, rel=1e-7)
