"""``CompiledProblem.estimator``: the same answers as whole solves and as other programs, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from mbm.estimation.batches.stream import SHARE
from mbm.kernels.native.engine import available
from tests.api.conftest import gauss_newton, measured
from tests.api.test_solving import Ranges

EQUAL = 1e-9
"""Both end within 1e-10 standard deviations of the minimum, in other arithmetic; whole sigmas are some 1e-3 of it."""


@pytest.fixture
def compiled(problem: mbm.Problem, ranges: Ranges) -> mbm.CompiledProblem:
    return problem.compile(data={"ranges": ranges})


def numbers(solved: mbm.Solved, names: tuple[str, ...]) -> np.ndarray:
    return np.concatenate([np.ravel(solved[name].value) for name in names])


def agree(found: object, solved: mbm.Solved, names: tuple[str, ...]) -> None:
    """The estimates of one data set are those of a whole solve of it."""
    np.testing.assert_allclose(found.values, numbers(solved, names), rtol=EQUAL, atol=EQUAL)
    np.testing.assert_allclose(
        found.covariance, solved.covariance.matrix, rtol=1e-7, atol=1e-9 * found.sigma.max() ** 2
    )
    assert found.names == solved.covariance.names
    assert found.cost == pytest.approx(solved.first.cost, rel=1e-9, abs=1e-18)
    assert found.status == solved.first.status


def test_estimates_are_those_of_gauss_newton_computed_apart(compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    assert estimator.inputs == ("ranges.range",)
    assert estimator.fast is available()
    for seed in range(5):
        ranges = measured(x=1.0 + 0.3 * seed, seed=seed)["range"]
        found = estimator(ranges)
        place, covariance = gauss_newton(ranges)
        # Fifty steps of a quadratically convergent iteration: rounding times a condition of some ten.
        np.testing.assert_allclose(found["p"], place, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9)
        np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(covariance)), rtol=1e-9)
        assert found.status == "converged"
        assert found.clean is estimator.fast


@pytest.mark.parametrize("backend", ["auto", "casadi", "numpy"])
def test_estimates_are_those_of_whole_solves(backend: str, problem: mbm.Problem, ranges: Ranges) -> None:
    compiled = problem.compile(data={"ranges": ranges}, backend=backend)
    estimator = compiled.estimator("range")
    assert estimator.fast is available()
    other = measured(x=2.0, seed=3)
    agree(estimator(other["range"]), compiled.solve(data={"ranges": other}), ("p",))


def test_many_data_sets_are_those_of_one_by_one_to_the_last_bit(compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    given = np.stack([measured(x=1.0 + 0.1 * t, seed=t)["range"] for t in range(7)])
    many = estimator.many(given)
    each = [estimator(line) for line in given]
    assert many["p"].shape == (7, 3)
    for name in ("values", "covariance", "cost", "status", "clean", "sigma"):
        np.testing.assert_array_equal(getattr(many, name), np.array([getattr(one, name) for one in each]))
    nothing = estimator.many(np.empty((0, 5)))
    assert nothing.values.shape == (0, 3)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_the_number_of_threads_changes_nothing(workers: int, compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    given = np.stack([measured(x=1.0 + 0.001 * t, seed=t % 7)["range"] for t in range(5 * SHARE)])
    given[317, 2] += 2.0  # goes the general way
    usual, other = estimator.many(given), estimator.many(given, workers=workers)
    assert usual.clean.sum() == (len(given) - 1 if estimator.fast else 0)
    for name in ("values", "covariance", "cost", "status", "clean"):
        np.testing.assert_array_equal(getattr(usual, name), getattr(other, name))


def test_angles_beyond_half_a_turn_come_back_within_it() -> None:
    """At 190°, and whole turns away from the start: between -180° and 180°, alike in one solve and in many."""
    text = """
    (problem p (data d external :columns ((a a :unit deg)))
      (unknowns (h angle :init 900deg :unit deg) (b :init 1))
      (observe d (= c (* b (cos (+ h a)))) :sigma 0.01) (observe d (= s (* b (sin (+ h a)))) :sigma 0.01))"""
    a = np.array([0.0, 50.0, 120.0])

    def data(angle: float) -> dict[str, np.ndarray]:
        whole = np.radians(a + angle)
        return {"a": a, "c": 2 * np.cos(whole), "s": 2 * np.sin(whole) + [0.01, -0.01, 0.0]}

    compiled = mbm.loads(text).compile(data={"d": data(180.0)})
    estimator = compiled.estimator("c", "s")
    sets = [data(angle) for angle in (170.0, 180.0, 190.0)]
    many = estimator.many(*(np.stack([each[name] for each in sets]) for name in "cs"))
    one = np.array([float(estimator(each["c"], each["s"])["h"]) for each in sets])
    np.testing.assert_array_equal(many["h"], one)
    # An error of 0.01 in lengths of 2 turns by 0.3° at most.
    np.testing.assert_allclose((one - [170.0, 180.0, 190.0] + 180.0) % 360.0, 180.0, atol=0.3)
    assert (np.abs(one) <= 180.0).all()


def test_rows_that_do_not_count_may_stand_anywhere() -> None:
    text = """
    (problem p (data d external) (unknowns (a :init 0) (b :init 1))
      (observe d (= y (+ a (* b x))) :sigma 0.1 :when (< 0 w)))"""
    x, w = np.arange(7.0), np.array([1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    compiled = mbm.loads(text).compile(data={"d": {"x": x, "w": w, "y": x}})
    y = np.where(w > 0, 3 + 2 * x, 1e6)
    found = compiled.estimator()(y.tolist())
    # Affine and exact: one step, with the rounding of numbers up to 20.
    np.testing.assert_allclose(found.values, [3.0, 2.0], rtol=0, atol=1e-13)


def test_what_was_given_out_does_not_change_with_later_calls(compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    first = estimator(measured(seed=1)["range"])
    kept = first.values.copy(), first.covariance.copy()
    estimator(measured(x=3.0, seed=2)["range"])
    estimator.many(np.stack([measured(x=2.0, seed=s)["range"] for s in range(3)]))
    np.testing.assert_array_equal(first.values, kept[0])
    np.testing.assert_array_equal(first.covariance, kept[1])


def test_columns_and_answers_keep_their_units() -> None:
    text = """
    (problem p (data d external :columns ((y y :unit mm) (t t :unit deg)))
      (unknowns (a :init 1m :unit cm) (h angle :init 10deg :unit deg) (b :init 0m))
      (observe d (= y (+ b (* a (sin (+ t h))))) :sigma 1mm))"""
    turns = np.linspace(0.0, 350.0, 24)

    def data(seed: int) -> dict[str, np.ndarray]:
        noise = np.random.default_rng(seed).normal(0.0, 1.0, 24)
        return {"t": turns + seed, "y": 800.0 * np.sin(np.radians(turns + seed + 170.0)) + 20.0 + noise}

    compiled = mbm.loads(text).compile(data={"d": data(0)})
    estimator = compiled.estimator("y", "d.t")
    found = estimator(data(4)["y"], data(4)["t"])
    agree(found, compiled.solve(data={"d": data(4)}), ("a", "h", "b"))
    # 800 mm in cm, known to 0.03 cm; 170° to 0.02°: within five sigmas.
    assert abs(float(found["a"])) == pytest.approx(80.0, abs=0.15)


def test_poses_and_similarities() -> None:
    text = """
    (problem p (data d external) (unknowns (S (similarity 3)) (T (pose 2) :init (pose2 1 2 3)))
      (observe d (= [u v w] (transform S [x y z])) :sigma 0.01)
      (observe d (= [p q] (transform T [x y])) :sigma 0.02))"""
    random = np.random.default_rng(5)
    points = random.uniform(-1, 1, (12, 3))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))

    def data(scale: float) -> dict[str, np.ndarray]:
        there = scale * points @ turn.T + [1.0, 2.0, 3.0] + 0.01 * random.normal(size=(12, 3))
        c, s = np.cos(3.0), np.sin(3.0)
        flat = points[:, :2] @ np.array([[c, s], [-s, c]]) + [1.0, 2.0] + 0.02 * random.normal(size=(12, 2))
        return dict(zip("xyzuvwpq", (*points.T, *there.T, *flat.T), strict=True))

    compiled = mbm.loads(text).compile(data={"d": data(2.0)})
    estimator = compiled.estimator(*"uvwpq")
    other = data(2.2)
    found = estimator(*(other[name] for name in "uvwpq"))
    agree(found, compiled.solve(data={"d": other}), ("S", "T"))
    assert found["S"].shape == (8,)
    assert found["S"][7] == pytest.approx(2.2, abs=0.05)


def test_one_unknown_noise_follows_from_the_residuals() -> None:
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x)))))"
    x = np.arange(10.0)

    def data(seed: int) -> dict[str, np.ndarray]:
        return {"x": x, "y": 1 + 2 * x + np.random.default_rng(seed).normal(size=10)}

    compiled = mbm.loads(text).compile(data={"d": data(0)})
    found = compiled.estimator()(data(1)["y"])
    agree(found, compiled.solve(data={"d": data(1)}), ("a", "b"))
    slope, covariance = np.polyfit(x, data(1)["y"], 1, cov=True)
    np.testing.assert_allclose(found.values[::-1], slope, rtol=1e-10)
    np.testing.assert_allclose(found.covariance[::-1, ::-1], covariance, rtol=1e-9)


def test_what_is_not_clean_goes_the_general_way(compiled: mbm.CompiledProblem, ranges: Ranges) -> None:
    """A gross error of 2 m fits far worse than stated noise lets expect."""
    estimator = compiled.estimator()
    wrong = ranges["range"].copy()
    wrong[2] += 2.0
    both = estimator.many(np.stack([ranges["range"], wrong]))
    assert both.clean.tolist() == [estimator.fast, False]
    solved = compiled.solve(data={"ranges": {**ranges, "range": wrong}})
    agree(estimator(wrong), solved, ("p",))
    np.testing.assert_array_equal(both.values[1], solved["p"].value)


def test_bounds_and_loose_ends_have_the_general_paths_answers() -> None:
    text = """
    (problem p (data d external) (unknowns (a :init 1 :in (0 5)) (b :init 1))
      (observe d (= y (* a x)) :sigma 1) (observe d (= z (* b u)) :sigma 1))"""
    x = np.array([1.0, 2.0, 3.0])
    good = {"x": x, "y": 2 * x, "u": x, "z": 3 * x}
    compiled = mbm.loads(text).compile(data={"d": good})
    estimator = compiled.estimator("y", "u")
    held = estimator(-x, x)
    assert not held.clean
    assert held.values[0] == 0.0
    assert np.isnan(held.covariance[0, 0])
    loose = estimator(2 * x, 0 * x)
    assert loose.status == "unobservable"
    assert not loose.clean


def test_a_cell_without_a_number_is_named(compiled: mbm.CompiledProblem, ranges: Ranges) -> None:
    bad = ranges["range"].copy()
    bad[3] = np.nan
    with pytest.raises(mbm.MbmError, match="not-finite-cell"):
        compiled.estimator()(bad)


@pytest.mark.parametrize(
    ("shape", "says"),
    [((4,), "`ranges.range` has 4 numbers; 5 are wanted"), ((), "has one number;"), ((2, 5), "has 2 × 5 numbers")],
)
def test_arrays_of_another_shape(shape: tuple[int, ...], says: str, compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    with pytest.raises(mbm.MbmError, match=says) as caught:
        estimator(np.ones(shape))
    assert caught.value.diagnostics[0].code.name == "wrong-input"


@pytest.mark.parametrize("given", ["abc", [[1.0, 2.0], [3.0]], [1.0, {}, 3.0, 4.0, 5.0]])
def test_what_is_no_array_of_numbers(given: object, compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    for call in (estimator, estimator.many):
        with pytest.raises(mbm.MbmError, match=r"`ranges\.range` is no array of numbers"):
            call(given)


def test_the_wrong_number_of_arrays_and_of_lines(compiled: mbm.CompiledProblem) -> None:
    estimator = compiled.estimator()
    for call in (estimator, estimator.many):
        for given in ((), (np.ones(5), np.ones(5))):
            with pytest.raises(mbm.MbmError, match=f"arrays given: {len(given)}; inputs: 1, `ranges.range`"):
                call(*given)
    with pytest.raises(mbm.MbmError, match="has 3 × 4 numbers; 3 × 5 are wanted"):
        estimator.many(np.ones((3, 4)))


@pytest.mark.parametrize(
    ("columns", "code", "says"),
    [
        (("rnge",), "no-such-input", "no equation uses a column `rnge`"),
        (("id",), "deciding-input", "`places.id` decides the names of rows"),
        (("s",), "deciding-input", "`d.s` decides the noise"),
        (("k",), "deciding-input", "`d.k` decides which row is joined"),
        (("w",), "deciding-input", "`d.w` decides which rows count"),
        (("x0",), "deciding-input", "`d.x0` decides the start"),
        (("y",), "no-such-input", "`y` may mean several columns"),
        (("e.y", "e.y"), "no-such-input", "`e.y` is named twice"),
    ],
)
def test_columns_that_cannot_be_inputs(columns: tuple[str, ...], code: str, says: str) -> None:
    text = """
    (problem p (data places (table (id x) (1 0) (2 1)) :key id) (data d external :with (places k)) (data e external)
      (unknowns (a :init (first d x0)) (b :init 1))
      (observe d (= y (+ (* a s) places.x x0)) :sigma s :when (< 0 w))
      (observe e (= y b) :sigma 1))"""
    d = {"k": [1.0, 2.0], "y": [1.0, 2.0], "s": [1.0, 2.0], "w": [1.0, 1.0], "x0": [1.0, 2.0]}
    compiled = mbm.loads(text).compile(data={"d": d, "e": {"y": [1.0]}})
    with pytest.raises(mbm.MbmError) as caught:
        compiled.estimator(*columns)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == code
    assert says in diagnostic.message


@pytest.mark.parametrize(
    ("clause", "what"),
    [
        ("(for-each k)", "`for-each`"),
        ("(window k :length 2 :step 1)", "`window`"),
        ("(solve :starts (random 3))", "`:starts`"),
    ],
)
def test_problems_that_ask_for_several_solves(clause: str, what: str) -> None:
    text = f"(problem p (data d external) (unknowns (a :init 1 :in (0 9))) (observe d (= y a) :sigma 1) {clause})"
    compiled = mbm.loads(text).compile(data={"d": {"k": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 3.0]}})
    with pytest.raises(mbm.MbmError, match="not-a-stream") as caught:
        compiled.estimator()
    assert what in caught.value.diagnostics[0].message


def test_consensus_is_the_general_paths(problem: mbm.Problem) -> None:
    text = """
    (problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.1) (solve :robust lmeds))"""
    x = np.arange(12.0)
    y = 1 + 2 * x
    y[3] += 50.0
    compiled = mbm.loads(text).compile(data={"d": {"x": x, "y": y}})
    estimator = compiled.estimator()
    assert not estimator.fast
    y[3], y[7] = 7.0, -40.0
    agree(estimator(y), compiled.solve(data={"d": {"x": x, "y": y}}), ("a", "b"))


@pytest.mark.parametrize(
    ("unknowns", "observe", "fast"),
    [
        ("(a) (b)", "(observe d (= y (+ a (* b x))))", True),
        ("(a) (b)", "(observe d (= y (+ a (* b x)))) (observe d (= z b))", False),
        ("(a) (b)", "(observe d (= y (+ a (* b x))) :sigma 0.1 :loss huber)", False),
        ("(a) (b :init 1)", "(observe d (= y (+ a (sin (* b x)))) :sigma 0.1)", True),
        ("(a) (b)", "(observe d (= y (+ a (* b x))) :sigma 0.1) (solve :method dogleg)", True),
    ],
)
def test_what_is_fast_and_what_goes_the_general_way(unknowns: str, observe: str, fast: bool) -> None:
    """As the manual has it; the answers are those of whole solves either way."""
    x = np.linspace(0.0, 1.0, 9)
    data = {"x": x, "y": 1.0 + 2.0 * x + 0.01 * np.cos(7.0 * np.arange(9.0)), "z": 2.0 + 0.1 * np.sin(5.0 * x)}
    compiled = mbm.loads(f"(problem p (data d external) (unknowns {unknowns}) {observe})").compile(data={"d": data})
    estimator = compiled.estimator("y")
    assert estimator.fast is (fast and available())
    agree(estimator(data["y"]), compiled.solve(data={"d": data}), ("a", "b"))


@pytest.mark.parametrize("given", [np.full(5, 1.0 + 0.0j), [1j] * 5, [10**400] * 5])
def test_complex_and_endless_numbers_are_none(given: object, compiled: mbm.CompiledProblem) -> None:
    """Not even those whose imaginary part is 0: what was meant by it is not clear."""
    estimator = compiled.estimator()
    for call, columns in ((estimator, given), (estimator.many, [given])):
        with pytest.raises(mbm.MbmError, match=r"`ranges\.range` is no array of numbers"):
            call(columns)


@pytest.mark.parametrize("kind", ["f4", "i8", ">f8", "O", "U32"])
def test_numbers_of_other_types_are_taken_as_they_are(kind: str, compiled: mbm.CompiledProblem) -> None:
    ranges = np.round(measured()["range"] * 64) / 64 if kind != "i8" else np.array([2, 3, 4, 4, 3])
    estimator = compiled.estimator()
    np.testing.assert_array_equal(estimator(ranges.astype(kind)).values, estimator(ranges.astype(np.float64)).values)


SIDES = """
(problem sides (data d (table (sx sy r) (0 0 5.0) (5 {bend} 2.9) (10 0 6.9)))
  (unknowns (p (vector 2){start})) (observe d (= r (distance p [sx sy])) :sigma {sigma}))
"""


def ranges_of_sides(bend: float, sigma: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Stations (3, 2), the middle one out of line, and ranges (count, 3) to places on one side."""
    generator = np.random.default_rng(5)
    stations = np.array([[0.0, 0.0], [5.0, bend], [10.0, 0.0]])
    places = np.column_stack([generator.uniform(2, 8, count), generator.uniform(1, 5, count)])
    away = np.linalg.norm(places[:, None] - stations, axis=2)
    return stations, away + sigma * generator.standard_normal(away.shape)


def best_of_both_sides(stations: np.ndarray, ranges: np.ndarray, sigma: float) -> float:
    ends = [
        least_squares(lambda p: (np.linalg.norm(stations - p, axis=1) - ranges) / sigma, (5.0, y), xtol=1e-14)
        for y in (3.0, -3.0)
    ]
    return min(2 * end.cost for end in ends)


@pytest.mark.parametrize("start", [" :init [4 -2]", " :init [4 2]", ""])
@pytest.mark.parametrize(("bend", "sigma"), [(0.3, 0.3), (0.3, 0.03), (0.0, 0.1), (2.5, 0.02)])
def test_the_closed_form_is_followed_where_it_fits_better(start: str, bend: float, sigma: float) -> None:
    """SciPy from both sides is the oracle; where the stations are in line, both cost the same."""
    stations, ranges = ranges_of_sides(bend, sigma, 60)
    estimator = mbm.loads(SIDES.format(bend=bend, sigma=sigma, start=start)).compile().estimator("r")
    assert estimator.fast is available()
    many = estimator.many(ranges)
    least = [best_of_both_sides(stations, lengths, sigma) for lengths in ranges]
    np.testing.assert_allclose(many.cost, least, rtol=1e-6, atol=1e-9)
    assert many.clean.mean() > 0.9
    each = [estimator(lengths) for lengths in ranges]
    np.testing.assert_allclose([one.cost for one in each], least, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(many.values, [one.values for one in each], rtol=0, atol=1e-9)


def test_what_the_closed_form_leads_to_has_its_own_covariance() -> None:
    """The plain solve of the same data says it, which compares as well."""
    problem = mbm.loads(SIDES.format(bend=0.3, sigma=0.3, start=" :init [4 -2]")).compile()
    found = problem.estimator("r")([5.0, 2.9, 6.9])
    assert found["p"][1] == pytest.approx(3.055, abs=5e-4)
    agree(found, problem.solve(), ("p",))
