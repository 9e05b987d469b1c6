"""What the data cannot tell is named, with exit status 1; everything else keeps its estimate and its sigma."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.cli.main import run
from tests.evidence.material import loaded, write_problem

X = np.arange(8.0)
LINE = {"x": X.tolist(), "y": (2 * X + 1 + 0.1 * np.random.default_rng(5).standard_normal(8)).tolist()}
PLAIN = """
(problem plain
  (data d (csv "d.csv"))
  (unknowns (a :init 1) (b :init 0))
  (observe d (= y (+ (* a x) b)) :sigma 0.1))
"""
ABSENT = """
(problem absent
  (data d (csv "d.csv"))
  (unknowns (a :init 1) (b :init 0) (idle :init 3))
  (observe d (= y (+ (* a x) b)) :sigma 0.1)
  (derive (twice (* 2 a)) (both (+ a idle))))
"""
PRODUCT = """
(problem product
  (data d (csv "d.csv"))
  (unknowns (a :init 1) (g :init 2) (b :init 0))
  (observe d (= y (+ (* a g x) b)) :sigma 0.1)
  (derive (slope (* a g)) (at-ten (+ b (* 10 a g))) (ratio (/ a g))))
"""
SCENE = """
(problem scene
  (constants (k0 800) (k1 800))
  (data corners (csv "corners.csv"))
  (unknowns (psi angle :init 0.3) (xg :init 5m) (yg :init 0.2m) (zg :init -0.3m)
            (x :init 0.6m) (y :init 0.4m) (h :init 0.5m))
  (observe corners
    (= [X Y] (perse (trans [xg yg zg] (rotate [0 0 psi] (vertex (box x y h) n)))))
    :sigma 1)
  (derive (shape (/ x y)) (bearing-to (atan2 yg xg)) (volume (* x y h))))
"""
GAUGE = """
(problem gauge
  (data points (csv "points.csv") :key name)
  (data legs (csv "legs.csv"))
  (unknowns (p (vector 2) :per points :init [x y]))
  (observe legs (= [dx dy] (- (p to) (p from))) :sigma 1cm)
  (derive (side (distance (p "A") (p "C"))) (place (p "A"))))
"""
POINTS = {"name": ["A", "B", "C"], "x": [0.0, 10.0, 10.0], "y": [0.0, 0.0, 8.0]}
LEGS = {"from": ["A", "B", "A"], "to": ["B", "C", "C"], "dx": [10.01, 0.01, 10.0], "dy": [0.02, 8.01, 8.02]}
SPARE = """
(problem spare
  (data stations (csv "stations.csv") :key id)
  (data levels (csv "levels.csv"))
  (unknowns (s :per stations :init 0) (drift :init 0))
  (observe levels (= z (+ (s id) (* drift t))) :sigma 0.1))
"""
LEVELS = {"id": ["A", "A", "B", "B"], "t": [1.0, 2.0, 1.0, 3.0], "z": [2.1, 2.9, 5.2, 7.1]}


def corners() -> dict[str, list[object]]:
    """A box of 0.6 × 0.4 × 0.5 m, 4 m away, turned by 0.4 rad; half a pixel of noise."""
    signs = np.array(
        [(1, 1, -1), (-1, 1, -1), (-1, -1, -1), (1, -1, -1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1)]
    )
    turn = np.array([[np.cos(0.4), -np.sin(0.4), 0], [np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]])
    at = (signs * [0.3, 0.2, 0.25]) @ turn.T + [4.0, 0.3, -0.2]
    image = 800 * at[:, 1:] / at[:, :1] + 0.5 * np.random.default_rng(5).standard_normal((8, 2))
    return {"n": list(range(1, 9)), "X": image[:, 0].tolist(), "Y": image[:, 1].tolist()}


def sentences(solved):
    return [direction.sentence for direction in solved.observability.unobservable]


def test_an_unknown_in_no_equation(tmp_path):
    solved = loaded(tmp_path, ABSENT, d=LINE).solve()
    alone = loaded(tmp_path, PLAIN, d=LINE).solve()
    assert solved.first.status == "unobservable"
    assert sentences(solved) == ["`idle` appears in no equation that has data"]
    for name in ("a", "b"):
        # The same equations with a column of zeros beside them.
        assert float(solved[name].value) == pytest.approx(float(alone[name].value), rel=1e-12)
        assert float(solved[name].sigma) == pytest.approx(float(alone[name].sigma), rel=1e-12)
    assert np.isnan(solved["idle"].sigma)
    assert float(solved["twice"].sigma) == pytest.approx(2 * float(alone["a"].sigma), rel=1e-12)
    assert np.isnan(solved["both"].sigma)
    assert (solved.first.dof, solved.first.cost) == (6, pytest.approx(alone.first.cost, rel=1e-12))


def test_two_unknowns_that_appear_only_as_a_product(tmp_path):
    solved = loaded(tmp_path, PRODUCT, d=LINE).solve()
    alone = loaded(tmp_path, PLAIN, d=LINE).solve()
    assert sentences(solved) == ["`a` and `g`: only their product is determined"]
    assert np.isnan(solved["a"].sigma)
    assert np.isnan(solved["g"].sigma)
    assert float(solved["b"].sigma) == pytest.approx(float(alone["b"].sigma), rel=1e-9)
    # The product is the slope of the plain problem, value and sigma; at x = 10 it extrapolates the same line.
    assert float(solved["slope"].value) == pytest.approx(float(alone["a"].value), rel=1e-9)
    assert float(solved["slope"].sigma) == pytest.approx(float(alone["a"].sigma), rel=1e-9)
    gradient = np.array([10.0, 1.0])
    expected = np.sqrt(gradient @ alone.covariance.matrix @ gradient)
    assert float(solved["at-ten"].sigma) == pytest.approx(expected, rel=1e-9)
    assert np.isnan(solved["ratio"].sigma)


def test_the_scale_of_a_scene_seen_by_one_camera(tmp_path):
    solved = loaded(tmp_path, SCENE, corners=corners()).solve()
    assert sentences(solved) == ["`xg`, `yg`, `zg`, `x`, `y` and `h` scale together: only their ratios are determined"]
    assert (solved.observability.rank, solved.observability.dimension) == (6, 7)
    # Turn, shape and direction do not feel the scale; half a pixel of noise is well inside these bounds.
    assert float(solved["psi"].value) == pytest.approx(0.4, abs=4 * float(solved["psi"].sigma))
    assert float(solved["shape"].value) == pytest.approx(1.5, abs=4 * float(solved["shape"].sigma))
    assert float(solved["bearing-to"].value) == pytest.approx(np.arctan2(0.3, 4.0), abs=1e-3)
    assert 0 < float(solved["bearing-to"].sigma) < 1e-3
    for name in ("xg", "yg", "zg", "x", "y", "h", "volume"):
        assert np.isnan(solved[name].sigma)


def test_sigmas_beside_the_free_scale_are_those_with_the_scale_known(tmp_path):
    """Holding one length fixed removes the freedom and must not change what never felt it."""
    free = loaded(tmp_path, SCENE, corners=corners()).solve()
    held = loaded(tmp_path, SCENE.replace("(h :init 0.5m)", "(h :init 0.5m :fixed true)"), corners=corners()).solve()
    assert held.status == "ok"
    for name in ("psi", "shape", "bearing-to"):
        # Both minima are exact to about 1e-10 standard deviations.
        assert float(free[name].value) == pytest.approx(float(held[name].value), rel=1e-8)
        assert float(free[name].sigma) == pytest.approx(float(held[name].sigma), rel=1e-6)


def test_a_net_of_differences_can_move_as_a_whole(tmp_path):
    solved = loaded(tmp_path, GAUGE, points=POINTS, legs=LEGS).solve()
    together = '`p["A"][{0}]`, `p["B"][{0}]` and `p["C"][{0}]` move together by the same amount: '
    assert sentences(solved) == [together.format(i) + "only their differences are determined" for i in (1, 2)]
    assert np.isnan(solved["p"].sigma).all()
    assert np.isnan(solved["place"].sigma).all()
    # A-C is seen directly with 1 cm and by way of B with √2 cm: √(2/3) cm along both axes, so along the line too.
    assert float(solved["side"].sigma) == pytest.approx(0.01 * np.sqrt(2 / 3), rel=1e-6)
    assert solved.first.dof == 2


def test_members_without_observations_are_listed_and_harm_nothing(tmp_path):
    solved = loaded(tmp_path, SPARE, stations={"id": list("ABCD")}, levels=LEVELS).solve()
    assert solved.status == "ok"
    assert solved.observability.unused == ('s["C"]', 's["D"]')
    assert np.isnan(solved["s"].sigma).tolist() == [False, False, True, True]
    matrix = np.array([[1, 0, 1], [1, 0, 2], [0, 1, 1], [0, 1, 3.0]])
    expected = np.linalg.lstsq(matrix, np.array(LEVELS["z"]), rcond=None)[0]
    sigma = 0.1 * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    # Linear: one step, exact to rounding.
    np.testing.assert_allclose([*solved["s"].value[:2], solved["drift"].value], expected, rtol=1e-10)
    np.testing.assert_allclose([*solved["s"].sigma[:2], solved["drift"].sigma], sigma, rtol=1e-10)


@pytest.mark.parametrize(
    ("text", "tables", "status", "words"),
    [
        (ABSENT, {"d": LINE}, 1, "`idle` appears in no equation that has data"),
        (PRODUCT, {"d": LINE}, 1, "`a` and `g`: only their product is determined"),
        (GAUGE, {"points": POINTS, "legs": LEGS}, 1, "only their differences are determined"),
        (SPARE, {"stations": {"id": list("ABCD")}, "levels": LEVELS}, 0, 'in no equation: `s["C"]`, `s["D"]`'),
    ],
    ids=["absent", "product", "gauge", "spare"],
)
def test_the_command_line_says_so(text, tables, status, words, tmp_path, capfd):
    assert run(["solve", str(write_problem(tmp_path, text, tables))]) == status
    assert words in " ".join(capfd.readouterr().out.split())
