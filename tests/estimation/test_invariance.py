"""Movements that leave the sum of squares as it is, though they change every residual: drives about one anchor."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

DRIVE = """(problem drive
  (data ranges (table (t ax ay r) (0 0 0 1)))
  (data wheels (table (t dh) (0 0)))
  (states :over t (p (vector 2) :init [3 0.5]) (h angle :init 0.1))
  (dynamics (= (next p) (+ p (* 0.4 [(cos h) (sin h)])) :sigma 0.03) (= (next h) (+ h dh) :sigma 0.02))
  (observe ranges (= r (distance p [ax ay])) :sigma 0.05)
  (derive (away (norm p)))
  %s
  (solve :method %s))"""


def drawn(steps, seed, anchors=((0.0, 0.0),)):
    """Ranges to the anchors in turn, and turns of the wheels, with the noise that `DRIVE` states."""
    g = np.random.default_rng(seed)
    heading = np.cumsum(0.12 + 0.02 * g.normal(size=steps))
    place = np.zeros((steps, 2))
    place[0] = 3.0, 0.5
    for k in range(1, steps):
        ahead = np.array([np.cos(heading[k - 1]), np.sin(heading[k - 1])])
        place[k] = place[k - 1] + 0.4 * ahead + 0.03 * g.normal(size=2)
    anchor = np.array(anchors)[np.arange(steps) % len(anchors)]
    heard = np.linalg.norm(place - anchor, axis=1) + 0.05 * g.normal(size=steps)
    turned = np.concatenate([[0.0], np.diff(heading)]) + 0.02 * g.normal(size=steps)
    t = np.arange(steps)
    return {
        "ranges": {"t": t, "ax": anchor[:, 0], "ay": anchor[:, 1], "r": heard},
        "wheels": {"t": t, "dh": turned},
    }


def turns(solve):
    return [(each.motion, each.dimensions) for each in solve.observability.gauge]


@pytest.mark.parametrize(
    ("method", "steps"), [("batch", 12), ("batch", 130), ("(smoother)", 12), ("ekf", 12), ("iterated-ekf", 12)]
)
def test_a_drive_may_be_turned_about_the_only_anchor(method, steps):
    # Noise is the same along both axes, so that turning place and heading about the anchor changes no probability.
    solve = mbm.loads(DRIVE % ("", method)).solve(data=drawn(steps, 1)).solves[0]
    assert solve.status == "unobservable"
    assert turns(solve) == [("rotation", 1)]
    assert solve.observability.gauge[0].unknowns == ("p", "h")
    assert np.isnan(solve["p"].sigma).all()
    assert np.isnan(solve["h"].sigma).all()


@pytest.mark.parametrize("method", ["batch", "(smoother)", "ekf"])
def test_a_second_anchor_holds_the_drive(method):
    solve = mbm.loads(DRIVE % ("", method)).solve(data=drawn(12, 1, ((0.0, 0.0), (12.0, 5.0)))).solves[0]
    assert solve.status == "converged"
    assert np.isfinite(solve["h"].sigma[-6:]).all()  # those of a filter have seen both anchors by then


def test_distances_to_the_anchor_keep_their_sigma():
    # A heading that is stated at first holds what may be turned, and tells nothing of distances.
    free, held = (
        mbm.loads(DRIVE % (more, "batch")).solve(data=drawn(12, 3)).solves[0]
        for more in ("", "(constraints (= h 0.3 :at first))")
    )
    assert held.status == "converged"
    np.testing.assert_allclose(free["away"].value, held["away"].value, rtol=1e-6)
    # The Jacobian of turned residuals differs from zero by the residuals: a share of the square of σ/r.
    np.testing.assert_allclose(free["away"].sigma, held["away"].sigma, rtol=0.05)
    assert free.cost == pytest.approx(held.cost, rel=1e-9)
    assert free.dof == held.dof


def test_points_without_states_likewise():
    text = """(problem points
      (data a (table (r1 r2 r3) (3.09 2.90 2.84)))
      (unknowns (p (vector 2) :init [3 0.5]) (q (vector 2) :init [3 1]) (s (vector 2) :init [3 1.5]))
      (unknowns (h angle :init 1.5))
      (observe a (= r1 (norm p)) :sigma 0.05)
      (observe a (= r2 (norm q)) :sigma 0.05)
      (observe a (= r3 (norm s)) :sigma 0.05)
      (observe a (= [0 0] (- q p (* 0.4 [(cos h) (sin h)]))) :sigma 0.03)
      (observe a (= [0 0] (- s q (* 0.4 [(cos (+ h 0.5)) (sin (+ h 0.5))]))) :sigma 0.03)
      (observe a (= 0.45 (distance p q)) :sigma 0.03)
      (solve %s))"""
    solve = mbm.loads(text % "").solve().solves[0]
    assert solve.cost > 0.5
    assert solve.status == "unobservable"
    assert turns(solve) == [("rotation", 1)]
    assert mbm.loads(text % ":gauge free").solve().solves[0].status == "converged"


def test_a_number_that_is_zero_but_for_rounding_is_not_free():
    """Steps were a share of its size, 1e-31: no gradient changed by them, and all unknowns were called free."""
    solve = (
        mbm.loads("""(problem growth (data plants (table (id) ("a") ("b") ("c")) :key id)
      (data d (table (who day y) ("a" 1 2.1) ("b" 1 3.2) ("c" 1 4.1) ("a" 2 2.6) ("b" 2 3.4) ("c" 2 4.7)))
      (unknowns (g :per plants) (o :per d.day) (k))
      (observe d (= y (+ (exp (* 0.3 (g who))) (o day) k)) :sigma 0.1)
      (constraints (normal k 0 1) (normal (o day) 0 1 :over d)))""")
        .solve()
        .solves[0]
    )
    assert solve.status == "converged"


def chain(count, sigma, walk):
    """Standard deviations of distances on a ray, which are measured with ``sigma`` and walk: a linear problem."""
    steps = np.diff(np.eye(count), axis=0) / walk
    return np.sqrt(np.diag(np.linalg.inv(np.eye(count) / sigma**2 + steps.T @ steps)))


@pytest.mark.parametrize("loss", ["", ":loss huber"])
def test_a_walk_on_one_ray_from_its_anchor_turns(loss):
    """Distances do not notice either if all places are shifted across the ray; but only to first order."""
    solve = (
        mbm.loads(f"""(problem walk
      (data d (table (k r) (0 2.3) (1 3.3) (2 3.9) (3 4.3) (4 4.7) (5 5.5) (6 6.2) (7 7.1)))
      (states :over k (p (vector 2) :init [2 1]))
      (dynamics (random-walk p :sigma 0.5))
      (observe d (= r (norm p)) :sigma 0.1 {loss})
      (derive (away (norm p))))""")
        .solve()
        .solves[0]
    )
    assert solve.status == "unobservable"
    assert turns(solve) == [("rotation", 1)]
    assert solve.observability.rank == 15
    assert solve.dof == 7  # 8 distances, 14 numbers of steps, 15 of 16 unknowns determined
    assert np.isnan(solve["p"].sigma).all()
    if not loss:
        np.testing.assert_allclose(solve["away"].sigma, chain(8, 0.1, 0.5), rtol=1e-6)


PLACES = """(problem places
  (data d (table (k r) {}))
  (unknowns (p (vector 2) :per d.k :init [{} 2]))
  (observe d (= r (norm (p k))) :sigma 0.1)
  {})"""


def test_what_is_free_to_first_order_only_is_no_motion():
    """The steps have a direction: shifted across it, the places are farther from the anchor."""
    more = "(data e (table (i j) (0 1) (1 2) (2 3))) (observe e (= [0.1 0] (- (p j) (p i))) :sigma 0.5)"
    text = PLACES.format("(0 2.1) (1 2.6) (2 2.9) (3 3.8)", "(+ 2 k)", more).replace(" 2]", " 0]")
    solve = mbm.loads(text).solve().solves[0]
    assert solve.observability.gauge == ()
    assert not any("only their differences" in each.sentence for each in solve.observability.unobservable)


def test_a_scene_that_is_turned_is_no_other_solution():
    more = """(data f (table (a b c) (0 1 2) (1 2 3)))
      (observe f (= [0 0] (+ (p a) (- (p c) (* 2 (p b))))) :sigma 0.2)
      (data g (table (a b) (0 1) (1 2) (2 3)))
      (observe g (= 1.1 (norm (- (p b) (p a)))) :sigma 0.1)"""
    solve = mbm.loads(PLACES.format("(0 4.1) (1 3.4) (2 2.9) (3 2.6)", "(+ -4 k)", more)).solve().solves[0]
    assert turns(solve) == [("rotation", 1)]
    assert "another-solution" not in [each.code.name for each in solve.diagnostics]


def test_differences_from_data_tell_of_a_turn():
    """However weak a stated place is beside other noise: it holds the scene."""
    more = "(data e (table (i j) (0 1) (1 2) (2 3))) (observe e (= [0 0] (- (p j) (p i))) :sigma 0.5)"
    text = PLACES.format("(0 2.1) (1 2.6) (2 2.9) (3 3.8)", "(+ 2 k)", more)
    held = text[: text.rindex(")")] + "(constraints (normal (p 0) [1 1.8] 3)))"
    free, known = (mbm.loads(each).solve().solves[0].status for each in (text, held))
    assert (free, known) == ("unobservable", "converged")


@pytest.mark.parametrize(
    ("equation", "free"),
    [
        ("(= [0 0] (- (p j) (p i)))", True),
        ("(= (p i) (p j))", True),
        ("(- (p j) (p i))", True),
        ("(= (+ (p i) [0 0]) (p j))", True),
        ("(= [0.1 0] (- (p j) (p i)))", False),
        ("(= [x y] (- (p j) (p i)))", False),
        ("(= (pose2 x y 0) (pose2 (- ((p j) 1) ((p i) 1)) (- ((p j) 2) ((p i) 2)) 0))", False),
    ],
)
def test_differences_from_unknowns_may_turn(equation, free):
    more = f"(data e (table (i j x y) (0 1 .1 .2) (1 2 .1 0) (2 3 0 .1))) (observe e {equation} :sigma 0.5)"
    solve = mbm.loads(PLACES.format("(0 2.1) (1 2.6) (2 2.9) (3 3.8)", "(+ 2 k)", more)).solve().solves[0]
    assert (turns(solve) == [("rotation", 1)]) == free
