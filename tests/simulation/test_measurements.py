"""What is simulated: the model's prediction plus noise of the stated size, for every way of stating an equation."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.compiler import Inputs
from mbm.report.options import SimulationSettings

ROWS = 4000
X = np.linspace(-1.0, 2.0, ROWS)
LINE = """(problem line
  (data d external)
  (unknowns (a :init 2) (b :init -1))
  (observe d {equation} {noise}))"""


def line(equation: str = "(= y (+ a (* b x)))", noise: str = ":sigma 0.3") -> mbm.Problem:
    return mbm.loads(LINE.format(equation=equation, noise=noise))


def table(**columns: object) -> dict[str, object]:
    return {"d": {"x": X, "y": np.zeros(ROWS), **columns}}


def assert_standard_normal(numbers: np.ndarray) -> None:
    """Mean and variance within five deviations of chance: once in a million for a right generator."""
    count = len(numbers)
    assert abs(numbers.mean()) < 5 / np.sqrt(count)
    assert abs(numbers.var() - 1.0) < 5 * np.sqrt(2 / count)


@pytest.mark.parametrize(
    ("equation", "normal"),
    [
        ("(= y (+ a (* b x)))", lambda y: (y - 2 + X) / 0.3),
        ("(= (* 10 y) (+ a (* b x)))", lambda y: (10 * y - 2 + X) / 0.3),
        ("(- y (+ a (* b x)))", lambda y: (y - 2 + X) / 0.3),
        ("(- (+ a (* b x)) (/ y 2))", lambda y: (y / 2 - 2 + X) / 0.3),
        ("(= (log y) (+ a (* b x)))", lambda y: (np.log(y) - 2 + X) / 0.3),
        ("(= (- y a) (* b x))", lambda y: (y - 2 + X) / 0.3),
    ],
)
def test_the_measured_column_is_what_the_model_predicts_plus_noise(equation: str, normal) -> None:
    made = line(equation).simulate(data=table(y=np.ones(ROWS)), seed=3)
    assert_standard_normal(normal(made["d"]["y"]))
    np.testing.assert_array_equal(made["d"]["x"], X)


def test_sigma_may_depend_on_what_is_measured() -> None:
    """It is that of the prediction: a relative error of 10 %."""
    made = line("(= y (+ a x 3))", ":sigma (* 0.1 y)").simulate(data=table(y=np.ones(ROWS)), seed=1)
    predicted = 5 + X
    assert_standard_normal((made["d"]["y"] - predicted) / (0.1 * predicted))


@pytest.mark.parametrize("option", [":covariance [[4 1] [1 1]]", ":information [[1/3 -1/3] [-1/3 4/3]]"])
def test_covariances_are_those_stated(option: str) -> None:
    problem = line("(= [u v] [(+ a x) (* b x)])", option)
    made = problem.simulate(data={"d": {"x": X, "u": X, "v": X}}, seed=2)["d"]
    noise = np.stack([made["u"] - 2 - X, made["v"] + X])
    # elements of a sample covariance have variance (C_ij² + C_ii C_jj)/n, at most 32/n
    np.testing.assert_allclose(np.cov(noise), [[4, 1], [1, 1]], atol=5 * np.sqrt(32 / ROWS))


def test_rotations_and_poses_are_measured_in_their_own_columns() -> None:
    problem = mbm.loads("""(problem pose
      (data g external)
      (unknowns (T (pose 3) :init (pose3 (euler 0.1 -0.2 0.3) [1 2 3])))
      (observe g (= (pose3 (quaternion w i j k) [x y z]) T) :sigma [0.01 0.02 0.03 0.1 0.2 0.3]))""")
    count = 400
    given = {name: np.full(count, 0.5) for name in ("w", "i", "j", "k", "x", "y", "z")}
    made = problem.simulate(data={"g": given}, seed=4)["g"]
    true = Rotation.from_euler("ZYX", [0.3, -0.2, 0.1])
    measured = Rotation.from_quat(np.stack([made[name] for name in ("i", "j", "k", "w")], axis=1))
    turned = (measured.inv() * true).as_rotvec() / [0.01, 0.02, 0.03]
    shift = measured.inv().apply(np.array([1, 2, 3]) - np.stack([made[n] for n in ("x", "y", "z")], axis=1))
    for each in (*turned.T, *(shift / [0.1, 0.2, 0.3]).T):
        assert_standard_normal(each)
    norms = np.linalg.norm([made[name] for name in ("w", "i", "j", "k")], axis=0)
    np.testing.assert_allclose(norms, 1.0, rtol=1e-9)  # as long as what was there


def test_angles_keep_the_turn_that_the_file_counts_in() -> None:
    problem = mbm.loads("""(problem turn
      (data g external)
      (unknowns (t angle :init 0.1))
      (observe g (= (angle reading) t) :sigma 0.01))""")
    made = problem.simulate(data={"g": {"reading": [0.2, 6.3, -6.2]}}, seed=1)["g"]["reading"]
    np.testing.assert_allclose(made - 0.1, [0, 2 * np.pi, -2 * np.pi], atol=0.05)  # five deviations


def test_equations_are_simulated_in_the_order_in_which_they_need_one_another() -> None:
    problem = mbm.loads("""(problem chain
      (data d external)
      (unknowns (a :init 2) (b :init -1))
      (observe second d (= z (* b y)) :sigma 0.1)
      (observe first d (= y (+ a x)) :sigma 0.1))""")
    made = problem.simulate(data=table(z=X), seed=1)["d"]
    assert_standard_normal((made["y"] - 2 - X) / 0.1)
    assert_standard_normal((made["z"] + made["y"]) / 0.1)


def test_true_values_are_those_given_with_units_and_keys(tmp_path: Path) -> None:
    problem = mbm.loads("""(problem runs
      (data d external :columns ((y :unit mm)))
      (unknowns (level :init 0 :unit cm))
      (observe d (= y level) :sigma 0.1mm)
      (for-each run))""")
    given = {"d": {"run": ["a", "b", "a"], "y": [0.0, 0.0, 0.0]}}
    document = {
        "solves": [
            {"key": {"run": r}, "estimates": {"level": {"value": v, "unit": "m"}}} for r, v in (("a", 1), ("b", 2))
        ]
    }
    made = problem.simulate(at=document, data=given, seed=1)
    np.testing.assert_allclose(made["d"]["y"], [1000, 2000, 1000], atol=0.5)  # mm; five deviations
    again = problem.simulate(at=json.loads(json.dumps(made.truth)), data=given, seed=1)
    np.testing.assert_array_equal(again["d"]["y"], made["d"]["y"])
    assert [s["key"] for s in made.truth["solves"]] == [{"run": "a"}, {"run": "b"}]


def test_each_row_has_the_true_value_of_its_member() -> None:
    problem = mbm.loads("""(problem runs
      (data stations (table (id) (a) (b) (c)) :key id)
      (data d external)
      (unknowns (base :init 100) (p (vector 2) :per stations))
      (observe d (= y (+ base ((p station) 2))) :sigma 0.1)
      (observe first d (= z ((p "c") 1)) :sigma 0.1)
      (observe last d (= u ((p "a") 2)) :sigma 0.1))""")
    at = {"base": 100, "p": {"value": [[5, 6], [1, 2], [3, 4]], "keys": ["c", "a", "b"]}}
    given = {"d": {"station": ["c", "a", "b"], "y": np.zeros(3), "z": np.zeros(3), "u": np.zeros(3)}}
    made = problem.simulate(at=at, data=given, seed=1)["d"]
    np.testing.assert_allclose(made["y"], [106, 102, 104], atol=0.5)  # five deviations
    np.testing.assert_allclose(made["z"], 5, atol=0.5)
    np.testing.assert_allclose(made["u"], 2, atol=0.5)


def test_values_without_a_start_are_in_the_middle_of_where_they_may_be() -> None:
    problem = mbm.loads("""(problem middles
      (data d external)
      (unknowns (a :in (2 6)) (b :in (0 100) :start (10 20)))
      (observe d (= y a) :sigma 0.01)
      (observe e d (= z b) :sigma 0.01))""")
    made = problem.simulate(data={"d": {"y": np.zeros(3), "z": np.zeros(3)}}, seed=1)["d"]
    np.testing.assert_allclose(made["y"], 4, atol=0.05)  # five deviations
    np.testing.assert_allclose(made["z"], 15, atol=0.05)


def test_the_same_seed_gives_the_same_noise_whatever_else_is_simulated() -> None:
    alone = line().simulate(data=table(), seed=5)["d"]["y"]
    np.testing.assert_array_equal(line().simulate(data=table(), seed=5)["d"]["y"], alone)
    assert (line().simulate(data=table(), seed=6)["d"]["y"] != alone).all()
    beside = mbm.loads("""(problem both
      (data d external) (data e external)
      (unknowns (a :init 2) (b :init -1))
      (observe e (= z a) :sigma 1)
      (observe d (= y (+ a (* b x))) :sigma 0.3 :when (> x 0)))""")
    made = beside.simulate(data={**table(), "e": {"z": [0.0]}}, seed=5)["d"]["y"]
    np.testing.assert_array_equal(made[X > 0], alone[X > 0])
    np.testing.assert_array_equal(made[X <= 0], 0.0)  # rows that no equation uses stay


def test_unknown_noise_is_taken_from_the_call_the_document_or_one() -> None:
    problem = line(noise=":sigma unknown")
    one = problem.simulate(data=table(), seed=1)
    assert "assumed-noise" in [note.code.name for note in one.notes]
    noise = one["d"]["y"] - 2 + X
    for asked in (
        {"noise": {"d": 0.002}},
        {"noise": {"d": "2mm"}},
        {"at": {"solves": [{"key": {}, "estimates": {"a": {"value": 2}}, "noise": {"d": 0.002}}]}},
    ):
        made = problem.simulate(data=table(), seed=1, **asked)  # type: ignore[arg-type]
        assert "assumed-noise" not in [note.code.name for note in made.notes]
        np.testing.assert_allclose(made["d"]["y"] - 2 + X, 0.002 * noise, atol=1e-12)


def test_uncertain_columns_lie_about_points_that_meet_the_equation() -> None:
    problem = mbm.loads("""(problem circle
      (data d external)
      (unknowns (r :init 2))
      (observe d (- (+ (^ x 2) (^ y 2)) (^ r 2)) :errors ((x 0.01) (y 0.01))))""")
    turn = np.linspace(0, 6, ROWS)
    given = {"x": 2.1 * np.cos(turn), "y": 2.1 * np.sin(turn)}
    made = problem.simulate(data={"d": given}, seed=1)["d"]
    x, y = made["x"], made["y"]
    assert_standard_normal((x * np.cos(turn) + y * np.sin(turn) - 2) / 0.01)
    assert_standard_normal((y * np.cos(turn) - x * np.sin(turn)) / 0.01)


def test_a_column_with_errors_beside_a_measured_one_keeps_its_value_as_the_truth() -> None:
    made = line(noise=":errors ((x 0.5)) :sigma 0.1").simulate(data=table(), seed=1)["d"]
    assert_standard_normal((made["x"] - X) / 0.5)
    assert_standard_normal((made["y"] - 2 + X) / 0.1)


def test_outliers_come_at_the_asked_rate_and_are_listed() -> None:
    plain = line().simulate(data=table(), seed=1)["d"]["y"]
    made = line().simulate(data=table(), seed=1, outliers=(0.1, 50.0))
    moved = np.flatnonzero(made["d"]["y"] != plain)
    assert abs(len(moved) - 0.1 * ROWS) < 5 * np.sqrt(0.09 * ROWS)
    np.testing.assert_allclose(np.abs(made["d"]["y"] - plain)[moved], 15.0, rtol=1e-9)
    assert made.truth["solves"][0]["outliers"] == {"d": (moved + 1).tolist()}


def test_true_values_are_drawn_from_the_priors() -> None:
    problem = mbm.loads("""(problem drawn
      (data d external)
      (unknowns (a :init 2 :sigma 0.5) (b :init 1) (R (rotation 3) :init (euler 0 0 1)))
      (observe d (= y (+ a b)) :sigma 0.1)
      (constraints (normal R (euler 0 0 1) 0.1)))""")
    draws, turns = [], []
    simulator = problem.simulator(Inputs(tables={"d": {"y": [0.0]}}))
    for seed in range(100):
        made = simulator.measurements(SimulationSettings(seed=seed, draw_priors=True))
        true = made.truth["solves"][0]["estimates"]
        draws.append((true["a"]["value"] - 2) / 0.5)
        w, x, y, z = true["R"]["value"]["quaternion"]
        turns.append((Rotation.from_euler("Z", 1).inv() * Rotation.from_quat([x, y, z, w])).as_rotvec() / 0.1)
        assert true["b"]["value"] == 1.0
    assert_standard_normal(np.array(draws))
    for each in np.array(turns).T:
        assert_standard_normal(each)


@pytest.mark.parametrize(
    ("problem", "code"),
    [
        (line("(- (* a y) (* b x))"), "unclear-measurement"),
        (line("(= (^ y 2) (- 0 (^ a 2) 1))"), "not-simulated"),
        (line("(= y (+ a (first d y)))"), "measured-elsewhere"),
        (mbm.loads(LINE.replace("(a :init 2)", "(a)").format(equation="(= y (+ a b))", noise="")), "no-true-value"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_simulated_says_why(problem: mbm.Problem, code: str) -> None:
    with pytest.raises(mbm.MbmError, match=code):
        problem.simulate(data=table(y=np.ones(ROWS)), seed=1)


@pytest.mark.parametrize(
    ("equation", "noise", "said"),
    [
        ("(= y a)", ":sigma 1 :errors ((x y) (y x))", "a sigma of `.` is -"),
        ("(= y (* a x))", ":sigma y", "a sigma is -"),
        ("(= [x y] [a b])", ":covariance [[x 0] [0 y]]", "covariance matrix is not positive definite"),
    ],
)
def test_noise_that_is_stated_by_simulated_columns_must_be_noise_afterwards(
    equation: str, noise: str, said: str
) -> None:
    stated = np.linspace(0.5, 2.0, ROWS)
    with pytest.raises(mbm.MbmError, match="not-simulated") as caught:
        line(equation, noise).simulate(data=table(x=stated, y=stated), seed=1)
    assert re.search(said, caught.value.diagnostics[0].message)


def test_a_covariance_that_the_data_do_not_have_is_named_with_its_row() -> None:
    with pytest.raises(mbm.MbmError, match="bad-noise") as caught:
        line("(= [x y] [a b])", ":covariance [[z 0] [0 1]]").simulate(data=table(z=1.0 - X), seed=1)
    assert "not positive definite" in caught.value.diagnostics[0].message
    assert caught.value.diagnostics[0].labels


def test_a_prior_without_a_value_there_says_so() -> None:
    problem = mbm.loads("""(problem p (data d external) (unknowns (a :init 3)) (observe d (= y a) :sigma 1)
      (constraints (normal (asin a) 1 1)))""")
    with pytest.raises(mbm.MbmError, match="not-simulated") as caught:
        problem.simulate(data={"d": {"y": [1.0]}}, seed=1, draw_priors=True)
    assert "no finite value or derivative" in str(caught.value)
    assert problem.simulate(data={"d": {"y": [1.0]}}, at={"a": 0.5}, seed=1, draw_priors=True)


def test_a_column_measured_twice_in_a_row_is_refused() -> None:
    twice = mbm.loads("""(problem twice
      (data d external)
      (unknowns (a :init 2) (b :init -1))
      (observe one d (= y (+ a (* b x))) :sigma 1)
      (observe two d (= y (* a 2)) :sigma 1))""")
    with pytest.raises(mbm.MbmError, match="measured-elsewhere"):
        twice.simulate(data=table(), seed=1)


@pytest.mark.parametrize(
    ("clauses", "use"),
    [
        (
            "(data d external :with (n i)) (data n external :key k) (observe d (= i a) :sigma 1)",
            "a key of the table `n`",
        ),
        ("(data d external) (data n external :key k) (observe n (= k a) :sigma 1)", "the key of its table"),
        ("(data d external) (for-each y) (observe d (= y a) :sigma 1)", "in `for-each`"),
        ("(data d external) (window y :length 1 :step 1) (observe d (= y a) :sigma 1)", "in `window`"),
        ("(data d external) (unknowns (f :per d.i :init 1)) (observe d (= i a) :sigma 1)", "the key of the family `f`"),
        ("(data d external) (unknowns (f :per d.i :init 1)) (observe d (= y (f y)) :sigma 1)", "a key of `f`"),
        (
            "(data d external) (unknowns (v (vector 2) :init [1 1])) (observe d (= y a) :sigma 1) "
            "(observe e d (= i (v y)) :sigma 1)",
            "what decides which equation a row has",
        ),
        (
            "(data d external) (data n external) (pair P (d n) :by y) (observe P (= d.y a) :sigma 1)",
            "the time of a pair",
        ),
    ],
    ids=lambda value: value if value[0] != "(" else "",
)
def test_columns_that_name_things_are_not_simulated(clauses: str, use: str) -> None:
    """With noise in them they would name other things, or none: the folder could not be solved."""
    problem = mbm.loads(f"(problem p (unknowns (a :init 1)) {clauses})")
    given = {"d": {"i": [1.0, 2.0], "y": [1.0, 2.0]}, "n": {"k": [1.0, 2.0], "y": [1.0, 2.0]}}
    used = {name: columns for name, columns in given.items() if f"(data {name} " in clauses}
    with pytest.raises(mbm.MbmError, match="measured-elsewhere") as caught:
        problem.simulate(data=used, seed=1)
    assert use in str(caught.value)


@pytest.mark.parametrize(
    "asked", [{"noise": {"zzz": 1.0}}, {"measured": {"zzz": ["y"]}}, {"measured": {"d": ["zzz"]}}], ids=str
)
def test_names_that_are_none_are_refused(asked: dict[str, object]) -> None:
    with pytest.raises(mbm.MbmError, match="unknown-observation"):
        line().simulate(data=table(), seed=1, **asked)  # type: ignore[arg-type]


def test_what_was_assumed_is_said() -> None:
    problem = mbm.loads("""(problem p
      (data d external)
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y a) :sigma 1)
      (observe tie (= 0 (- a b)) :sigma 1))""")
    notes = problem.simulate(data={"d": {"y": [0.0]}}, at={"a": 3}, seed=1).notes
    assert [note.code.name for note in notes] == ["kept-equation", "assumed-value"]
    assert "`b`" in notes[1].message
    assert "`a`" not in notes[1].message


def test_an_unclear_equation_can_be_told_what_it_measures() -> None:
    made = line("(- (* a y) (* b x))").simulate(data=table(), seed=1, measured={"d": ["y"]})["d"]
    assert_standard_normal((2 * made["y"] + X) / 0.3)


PAIR = """(problem paired
  (data A external) (data B external)
  (pair m (A B) :by t {option})
  (unknowns (a :init 2))
  (observe m (= {measured} (+ a {other})) :sigma 0.1))"""


def test_paired_columns_are_simulated_in_the_table_that_holds_them() -> None:
    t = np.arange(100.0)
    given = {"A": {"t": t, "x": np.zeros(100)}, "B": {"t": t[::-1], "y": t[::-1]}}
    made = mbm.loads(PAIR.format(option="", measured="A.x", other="B.y")).simulate(data=given, seed=1)
    assert_standard_normal((made["A"]["x"] - 2 - t) / 0.1)
    made = mbm.loads(PAIR.format(option="", measured="B.y", other="A.x")).simulate(data=given, seed=1)
    assert_standard_normal((made["B"]["y"] - 2) / 0.1)


def test_interpolated_columns_are_no_cells() -> None:
    given = {"A": {"t": [0.5], "x": [0.0]}, "B": {"t": [0.0, 1.0], "y": [0.0, 1.0]}}
    problem = mbm.loads(PAIR.format(option=":interpolate true", measured="B.y", other="A.x"))
    with pytest.raises(mbm.MbmError, match="measured-elsewhere"):
        problem.simulate(data=given, seed=1)


def test_windows_are_simulated_together() -> None:
    problem = mbm.loads("""(problem slid
      (data d external)
      (window x :length 1 :step 0.5)
      (unknowns (a :init 2))
      (observe d (= y a) :sigma 0.1))""")
    made = problem.simulate(data=table(), at={"a": 3}, seed=1)
    assert_standard_normal((made["d"]["y"] - 3) / 0.1)
    assert len(made.truth["solves"]) == 1


def test_values_that_the_problem_excludes_are_said() -> None:
    problem = mbm.loads("""(problem p
      (data d external)
      (unknowns (a :init 2) (b :init 1))
      (observe d (= y (+ a (* b x))) :sigma 1)
      (constraints (<= a 3) (= (+ a b) 3)))""")

    def codes(**at: float) -> list[str]:
        notes = problem.simulate(data=table(), at=at, seed=1).notes
        return [note.code.name for note in notes]

    assert codes(a=2, b=1) == []
    assert codes(a=2, b=2) == ["values-against-constraint"]
    assert codes(a=4, b=0) == ["values-against-constraint"] * 2
