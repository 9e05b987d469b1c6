"""Many starts: every minimum once, how often each was found, saddles left, twins recognised; the same for any seed."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations.interruption import Interruption

QUARTIC = """
(problem quartic "(x² - 1)² + y² + x/5: minima near -1 and 1, a saddle between."
  (unknowns (x :in (-3 3)) (y :in (-3 3)))
  (observe a (- (^ x 2) 1) :sigma 1)
  (observe b (= 0 y) :sigma 1)
  (observe c (+ 1 (* 0.1 x)) :sigma 1)
  (solve :starts (random 40 :seed 3)))"""


def minima(solve):
    return sorted([solve.cost, *(a.cost for a in solve.alternatives)])


def test_both_minima_of_a_quartic_and_not_the_saddle():
    """Stationary points: 4x(x² − 1) + 0.2 (1 + 0.1 x) = 0; the middle root is the saddle."""
    roots = np.sort(np.roots([4, 0, -4 + 0.02, 0.2]).real)

    def cost(x):
        return (x**2 - 1) ** 2 + (1 + 0.1 * x) ** 2

    solve = mbm.loads(QUARTIC).solve().first
    assert minima(solve) == pytest.approx([cost(roots[0]), cost(roots[2])], rel=1e-9)
    assert solve.estimates[0].value == pytest.approx(roots[0], rel=1e-7)
    assert (solve.starts.tried, solve.starts.converged) == (40, 40)
    assert solve.starts.best_found + solve.alternatives[0].starts == 40
    # Uniform starts in (-3, 3): about half to either side.
    assert 10 < solve.starts.best_found < 30
    assert float(solve.alternatives[0].estimates[0].value) == pytest.approx(roots[2], rel=1e-7)
    assert "another-solution" in [d.code.name for d in solve.diagnostics]


def test_a_start_on_the_saddle_goes_on_downhill():
    """At x = 0 the gradient vanishes without the slope of c; three given starts at the saddle, all end in minima."""
    text = QUARTIC.replace("(observe c (+ 1 (* 0.1 x)) :sigma 1)", "").replace(
        "(random 40 :seed 3)", "(given ((x 0) (y 1)) ((x 0) (y 2)))"
    )
    solve = mbm.loads(text).solve().first
    assert minima(solve)[0] == pytest.approx(0, abs=1e-12)
    assert abs(float(solve.estimates[0].value)) == pytest.approx(1, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_position_below_and_above_a_plane_of_stations_is_two(seed):
    """Stations in the plane z = 0: the mirror image fits as well, and is marked."""
    text = f"""
    (problem tag
      (data s (table (x y r) (0 0 5.1) (6 0 5.83) (0 8 6.16) (6 8 6.71)))
      (unknowns (p (vector 3) :in (-10 10)))
      (observe s (= r (distance p [x y 0])) :sigma 0.05)
      (solve :starts (random 30 :seed {seed})))"""
    solve = mbm.loads(text).solve().first
    other = solve.alternatives[0]
    assert other.cost == pytest.approx(solve.cost, rel=1e-9)
    np.testing.assert_allclose(other.estimates[0].value, solve.estimates[0].value * [1, 1, -1], rtol=1e-6)
    assert "mirror" in other.remark
    assert solve.starts.best_found == solve.starts.converged


def test_euler_angles_of_one_rotation_are_one_solution():
    """(φ+π, π−θ, ψ+π) is the same rotation: starts over the whole circle find both, and both count as one."""
    text = """
    (problem turned
      (data d (table (x y z u v w) (1 0 0 0.66 0.72 -0.2) (0 1 0 -0.71 0.69 0.2) (0 0 1 0.29 0.03 0.96)))
      (unknowns (f angle) (t angle) (p angle))
      (observe d (= [u v w] (rotate (euler f t p) [x y z])) :sigma 0.01)
      (solve :starts (random 40)))"""
    solve = mbm.loads(text).solve().first
    best = [a for a in solve.alternatives if a.cost < solve.cost * 1.001 + 1e-6]
    assert best == []
    assert solve.starts.best_found > 20


def test_rotations_and_directions_have_one_best_value_from_anywhere():
    """Aligned points have a single minimum over all rotations (Wahba's problem), and quaternions q and -q are one."""
    text = """
    (problem aligned
      (data d (table (x y z u v w) (1 0 0 0.1 1 0.2) (0 1 0 -1 0.2 0.1) (0 0 1 0.3 0.1 1) (1 1 0 -1 1.3 0.2)))
      (unknowns (T (pose 3)) (n direction))
      (observe d (= [u v w] (transform T [x y z])) :sigma 0.1)
      (observe e d (= z (dot n [u v w])) :sigma 0.3)
      (solve :starts (random 40)))"""
    solve = mbm.loads(text).solve().first
    assert solve.alternatives == ()
    assert (solve.starts.converged, solve.starts.best_found) == (40, 40)


def test_two_decays_that_trade_places_are_one_solution():
    """The sum of two exponentials does not say which is the first."""
    t = np.arange(10) / 4
    y = 2 * np.exp(-0.5 * t) + np.exp(-3 * t)
    rows = " ".join(f"({a:.6f} {b:.9f})" for a, b in zip(t, y, strict=True))
    text = f"""
    (problem decays
      (data d (table (t y) {rows}))
      (unknowns (a :in (0 5)) (b :in (0 5)) (k :in (0.1 6)) (l :in (0.1 6)))
      (observe d (= y (+ (* a (exp (- (* k t)))) (* b (exp (- (* l t)))))) :sigma 0.001)
      (solve :starts (random 60)))"""
    solve = mbm.loads(text).solve().first
    assert solve.cost == pytest.approx(0, abs=1e-3)  # the data are rounded to 1e-9
    assert all(a.cost > 1 for a in solve.alternatives)


def test_what_is_derived_may_tell_twins_apart():
    """The same two decays, with a quantity that names the first of them."""
    rows = " ".join(f"({t} {np.exp(-t) + 3 * np.exp(-4 * t):.9f})" for t in np.arange(8) / 4)
    text = f"""
    (problem decays
      (data d (table (t y) {rows}))
      (unknowns (k :in (0.1 6)) (l :in (0.1 6)) (a :in (0 5)) (b :in (0 5)))
      (observe d (= y (+ (* a (exp (- (* k t)))) (* b (exp (- (* l t)))))) :sigma 0.001)
      (derive (quotient (/ k l)))
      (solve :starts (random 40)))"""
    solve = mbm.loads(text).solve().first
    best = [a for a in solve.alternatives if a.cost < 1e-3]
    assert len(best) == 1
    values = [{e.name: float(e.value) for e in found} for found in (solve.estimates, best[0].estimates)]
    assert values[0]["k"] == pytest.approx(values[1]["l"], rel=1e-4)


def test_starts_differ_by_the_seed_and_documents_do_not_by_the_run():
    problem = mbm.loads(QUARTIC)
    first, again, other = (problem.solve(seed=s).document() for s in (3, 3, 4))
    for document in (first, again, other):
        document["solves"][0]["seconds"] = None
    assert first == again
    assert first["solves"][0]["iterations"] != other["solves"][0]["iterations"]
    assert first["solves"][0]["estimates"]["x"]["value"] == pytest.approx(
        other["solves"][0]["estimates"]["x"]["value"], rel=1e-9
    )


def test_native_starts_find_the_minima_that_numpy_finds():
    """Each finds both minima; a start near a ridge may go to either side, since the steps differ in length."""
    one, other = (mbm.loads(QUARTIC).solve(backend=backend).first for backend in ("auto", "numpy"))
    assert minima(one) == pytest.approx(minima(other), rel=1e-12)
    assert one.starts.tried == one.starts.converged == other.starts.converged
    # 40 starts, of which the ridge x = 0 has a few nearby.
    assert abs(one.starts.best_found - other.starts.best_found) <= 8


def test_an_unknown_that_nothing_determines_makes_one_valley():
    """x + y alone is measured: all starts end in the same valley."""
    text = """(problem valley (unknowns (x :in (-1 1)) (y :in (-1 1)))
      (observe a (= 0.3 (+ x y)) :sigma 1) (observe b (= 0.1 (* 2 (+ x y))) :sigma 1) (solve :starts (random 20)))"""
    solved = mbm.loads(text).solve()
    assert solved.first.alternatives == ()
    assert solved.first.status == "unobservable"
    assert solved.first.starts.tried == 20


def test_constraints_and_fixed_unknowns_take_part():
    text = QUARTIC.replace("(y :in (-3 3))", "(y :init 0.5 :fixed true)").replace(
        "(solve", "(constraints (>= x 0.2)) (solve"
    )
    solve = mbm.loads(text).solve(starts=8).first
    roots = np.sort(np.roots([4, 0, -4 + 0.02, 0.2]).real)
    assert float(solve.estimates[0].value) == pytest.approx(roots[2], rel=1e-6)


def test_an_interruption_ends_with_what_is_there():
    asked = Interruption()
    asked.request()
    from mbm.report.options import SolveSettings

    compiled = mbm.loads(QUARTIC).compile()
    result = compiled.result(SolveSettings(interruption=asked))
    assert (result.complete, tuple(result.solves), result.status.value) == (False, (), "attention")
    assert [d.code.name for d in result.diagnostics] == ["interrupted"]


def test_where_trials_are_separated_a_bound_is_wanted():
    """The likelihood of (1 + e^{-(a + b x)})⁻¹ rises towards 1 as b grows: Albert, Anderson, Biometrika 71 (1984)."""
    rows = " ".join(f"({x} 10 {10 * (x > 2)})" for x in range(6))
    text = f"""(problem p (data d (table (x n k) {rows})) (unknowns (a) (b))
      (observe d (= k (/ n (+ 1 (exp (- (+ a (* b x))))))) :distribution (binomial n)))"""
    solve = mbm.loads(text).solve().first
    assert solve.status == "not-converged"
    assert solve.message.endswith("may be highest in the infinite: give a prior or `:in`, which bound `a`, `b`")
    assert solve.record.starts.converged == 0


@pytest.mark.parametrize(
    ("unknowns", "model", "wanted"),
    [
        ("(a)", "(exp a) :distribution poisson", "`a`"),
        ("(a) (b)", "(exp (+ a (* b x))) :distribution poisson", "`a`, `b`"),
        ("(a)", "(/ 10 (+ 1 (exp a))) :distribution (binomial 10)", "`a`"),
    ],
)
def test_rates_without_a_count_that_never_come_to_zero_want_a_bound(unknowns: str, model: str, wanted: str):
    """exp(−Σ exp(a + b x)) is highest in the infinite, however small the expectations get on the way."""
    mean, law = model.split(" :")
    text = f"""(problem p (data d (table (x k) (0 0) (1 0) (2 0) (3 0))) (unknowns {unknowns})
      (observe d (= k {mean}) :{law}))"""
    solve = mbm.loads(text).solve().first
    assert solve.status == "not-converged"
    assert solve.message.endswith(f"may be highest in the infinite: give a prior or `:in`, which bound {wanted}")
    assert np.isnan(float(solve["a"].sigma))


def test_where_no_start_leads_to_a_minimum_the_starts_that_are_missing_are_named():
    """The root of a x − 10⁶⁰ − b² has values where a is 10⁶⁰ or more only; c has a start."""
    text = """(problem p (data d (table (x y) (1 2) (2 3) (3 3.5))) (unknowns (a) (b) (c :init 1))
      (observe d (= y (sqrt (- (* a x) 1e60 (* b b)))) :sigma 1) (observe (= 2 c) :sigma 1))"""
    solve = mbm.loads(text).solve().first
    assert solve.status == "not-converged"
    assert solve.record.starts.converged == 0
    assert solve.message.endswith("no start led to a minimum: give `:init` or a narrow `:in` of `a`, `b`")
