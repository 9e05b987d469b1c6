"""The same problem solved through blocks and densely: same cost, estimates, sigmas, ranks and names."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import mbm
from mbm.estimation.minimise import sparsity
from mbm.problem.types import Method
from mbm.report.types import SolveStatus
from mbm.sparse.place import limited

STATIONS, POINTS = 5, 14
SAME = 1e-8
"""Both stop where the next step is below 1e-10 standard deviations; sigmas of points seen from afar lose two digits."""

PROBLEM = """
(problem network
  (data stations external :key station) (data points external :key point) (data seen external)
  (unknowns
    (K (pose 2) :per stations :init (pose2 x y heading) {station})
    (q (vector 2) :per points :init [x y] {point}))
  (observe angles seen (= angle (bearing (transform (inverse (K station)) (q point)))) {angles} {each})
  (observe ranges seen (= range (norm (- (q point) (translation (K station))))) {ranges} {each})
  (derive (apart (norm (- (q 3) (q 8)))) (first ((q 5) 1)) (from-first (norm (- (q point) (q 0))) :over points))
  {more})
"""
VARIANTS = {
    "fixed": {"station": ":fixed (> fix 0.5)"},
    "priors": {"point": ":sigma 0.2"},
    "bounds": {"station": ":fixed (> fix 0.5)", "point": ":in ([(- x 0.3) (- y 0.3)] [(+ x 0.3) (+ y 0.3)])"},
    "one unknown noise": {"station": ":fixed (> fix 0.5)", "ranges": ":sigma (unknown 0.1)"},
    "two unknown noises": {
        "station": ":fixed (> fix 0.5)", "angles": ":sigma (unknown 0.01)", "ranges": ":sigma (unknown 0.1)",
    },
    "loss": {"station": ":fixed (> fix 0.5)", "each": ":loss (huber 1.5)"},
    "filtered": {"station": ":fixed (> fix 0.5)", "each": ":when (> range 6)"},
}  # fmt: skip


def survey():
    """Tables of a made-up survey: noisy starts, angles to 2 mrad and ranges to 5 cm, some of them grossly wrong."""
    generator = np.random.default_rng(3)
    station = np.column_stack([generator.uniform(-20, 20, (STATIONS, 2)), generator.uniform(-3, 3, STATIONS)])
    points = generator.uniform(-30, 30, (POINTS, 2))
    of, to = (g.ravel() for g in np.mgrid[0:STATIONS, 0:POINTS])
    difference = points[to] - station[of, :2]
    angle = np.arctan2(difference[:, 1], difference[:, 0]) - station[of, 2] + generator.normal(0, 2e-3, len(of))
    distance = np.hypot(*difference.T) + generator.normal(0, 0.05, len(of))
    distance[::17] += 0.4
    moved = station + np.where(np.arange(STATIONS)[:, None] < 2, 0.0, generator.normal(0, 0.1, station.shape))
    began = points + generator.normal(0, 0.2, points.shape)
    number = np.arange(STATIONS)
    x, y, heading = moved.T
    return {
        "stations": {"station": number, "x": x, "y": y, "heading": heading, "fix": number < 2},
        "points": {"point": np.arange(POINTS), "x": began[:, 0], "y": began[:, 1]},
        "seen": {"station": of, "point": to, "angle": angle, "range": distance},
    }


def solved(**clauses):
    parts = {"station": "", "point": "", "angles": ":sigma 0.002", "ranges": ":sigma 0.05", "each": "", "more": ""}
    data = {
        name: {column: np.asarray(values, dtype=np.float64) for column, values in table.items()}
        for name, table in survey().items()
    }
    return mbm.loads(PROBLEM.format(**(parts | clauses))).solve(data=data)


@pytest.fixture
def blockwise(monkeypatch):
    def solve(**clauses):
        with monkeypatch.context() as patched:
            patched.setattr(sparsity, "MOST_DENSE", 0)
            patched.setattr(sparsity, "SPARSE", 1.0)
            return solved(**clauses)

    return solve


@pytest.mark.parametrize("variant", VARIANTS)
def test_same_answer(blockwise, variant):
    sparse, dense = blockwise(**VARIANTS[variant]), solved(**VARIANTS[variant])
    assert (sparse.first.method, dense.first.method) == ("dogleg-sparse", "lm")
    assert sparse.first.status is dense.first.status
    assert sparse.first.cost == pytest.approx(dense.first.cost, rel=SAME)
    assert sparse.first.dof == dense.first.dof
    assert sparse.observability.rank == dense.observability.rank
    for factor, expected in zip(sparse.first.noise.values(), dense.first.noise.values(), strict=True):
        assert factor == (None if expected is None else pytest.approx(expected, rel=SAME))
    for own, other in zip(sparse.first.estimates, dense.first.estimates, strict=True):
        np.testing.assert_allclose(own.value, other.value, atol=SAME)
        np.testing.assert_allclose(own.sigma, other.sigma, rtol=SAME)
    for own, other in zip(sparse.first.derived, dense.first.derived, strict=True):
        np.testing.assert_allclose(own.value, other.value, atol=SAME)
        np.testing.assert_allclose(own.sigma, other.sigma, rtol=SAME)
    np.testing.assert_allclose(sparse.covariance.matrix, dense.covariance.matrix, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
def test_routines_with_many_parts_and_threads_give_the_same_answer(blockwise, variant, monkeypatch):
    pytest.importorskip("llvmlite", reason="llvmlite is not installed")
    from mbm.sparse import arithmetic, normal, routines

    plain = blockwise(**VARIANTS[variant])
    monkeypatch.setattr(routines, "WORTH", 0)
    monkeypatch.setattr(arithmetic, "HEAVY", 0)
    monkeypatch.setattr(arithmetic, "processors", lambda: 3)
    monkeypatch.setattr(arithmetic, "TOGETHER", 16)  # five parts, the last one short
    for few in (normal.FEW, 0):  # sums for each part, or target by target
        monkeypatch.setattr(normal, "FEW", few)
        found = blockwise(**VARIANTS[variant])
        assert found.first.method == "dogleg-sparse"
        assert found.first.cost == pytest.approx(plain.first.cost, rel=SAME)
        for own, other in zip(found.first.estimates, plain.first.estimates, strict=True):
            np.testing.assert_allclose(own.value, other.value, atol=SAME)
            np.testing.assert_allclose(own.sigma, other.sigma, rtol=SAME)


def test_free_motions_are_named_alike(blockwise):
    sparse, dense = blockwise(), solved()
    assert sparse.first.status is dense.first.status is SolveStatus.UNOBSERVABLE
    motions = [(g.motion, g.dimensions, g.unknowns) for g in sparse.observability.gauge]
    assert motions == [("translation", 2, ("K", "q")), ("rotation", 1, ("K", "q"))]
    assert motions == [(g.motion, g.dimensions, g.unknowns) for g in dense.observability.gauge]
    for found in (sparse, dense):
        assert all("the whole scene (`K` and `q`)" in g.sentence for g in found.observability.gauge)
        assert found.observability.unobservable
        assert np.isnan(found["K"].sigma).all()
        assert np.isnan(found["first"].sigma)
    assert sparse["apart"].sigma == pytest.approx(dense["apart"].sigma, rel=SAME)


def test_the_minimum_norm_datum(blockwise):
    sparse, dense = blockwise(more="(solve :gauge free)"), solved(more="(solve :gauge free)")
    assert sparse.first.status is dense.first.status is SolveStatus.CONVERGED
    assert sparse.observability.unobservable == dense.observability.unobservable == ()
    assert [g.motion for g in sparse.observability.gauge] == ["translation", "rotation"]
    assert sparse["apart"].sigma == pytest.approx(dense["apart"].sigma, rel=SAME)
    for found in (sparse, dense):
        assert (found["q"].sigma > 0).all()


@pytest.fixture
def logarithms(monkeypatch):
    """A family of one number each in ``1 = log a``, from given starts."""

    def solve(starts):
        monkeypatch.setattr(sparsity, "MOST_DENSE", 0)
        monkeypatch.setattr(sparsity, "SPARSE", 1.0)
        text = (
            "(problem p (data d external :key k) (unknowns (a :per d :init x))"
            " (observe d (= 1 (log (a k))) :sigma 1) (solve :method lm))"
        )
        data = {"d": {"k": np.arange(float(len(starts))), "x": np.array(starts)}}
        return mbm.loads(text).solve(data=data)

    return solve


def test_a_start_without_a_value_is_told(logarithms):
    found = logarithms([1.0, -1.0, 4.0])
    assert found.first.method == "lm-sparse"
    assert found.first.status is SolveStatus.NOT_CONVERGED
    (warning,) = found.first.diagnostics
    assert warning.code.name == "not-finite-at-start"
    assert warning.labels[0].place.row == 2


def test_trial_points_without_a_value_are_survived(logarithms):
    found = logarithms([1.0, 20.0, 40.0])  # the whole first steps from the last two lead below zero
    assert found.first.status is SolveStatus.CONVERGED
    np.testing.assert_allclose(found["a"].value, np.e, rtol=1e-9)


def test_the_elements_of_a_long_array_are_blocks_of_their_own(monkeypatch):
    text = """(problem curve (data d external) (unknowns (a (array 30) :init 0))
      (observe d (= y (* (a k) (a k))) :sigma 0.1)
      (constraints (for (i 1 28) (normal (+ (a i) (* -2 (a (+ i 1))) (a (+ i 2))) 0 0.01)) (normal (a 1) 1 0.1)))"""
    k = np.repeat(np.arange(1.0, 31.0), 2)
    data = {"d": {"k": k, "y": 1.0 + np.sin(k / 9.0) / 2}}
    start = {"a": np.ones(30)}
    dense = mbm.loads(text).solve(data=data, init=start)
    monkeypatch.setattr(sparsity, "MOST_DENSE", 0)
    monkeypatch.setattr(sparsity, "SPARSE", 1.0)
    sparse = mbm.loads(text).solve(data=data, init=start)
    assert (sparse.first.method, dense.first.method) == ("dogleg-sparse", "lm")
    np.testing.assert_allclose(sparse["a"].value, dense["a"].value, atol=SAME)
    np.testing.assert_allclose(sparse["a"].sigma, dense["a"].sigma, rtol=SAME)


@pytest.mark.parametrize("variant", ["fixed", "bounds", "loss"])
@pytest.mark.parametrize("method", ["lm", "dogleg", "gauss-newton"])
def test_every_rule_of_steps_leads_to_the_same_minimum(blockwise, method, variant):
    held = VARIANTS[variant]
    found, dense = blockwise(**held, more=f"(solve :method {method})"), solved(**held)
    assert found.first.method == f"{method}-sparse"
    assert found.first.status == dense.first.status
    assert found.first.cost == pytest.approx(dense.first.cost, rel=SAME)
    for own, other in zip(found.first.estimates, dense.first.estimates, strict=True):
        np.testing.assert_allclose(own.value, other.value, atol=SAME)


def test_limited_steps_are_powells():
    """Against the path worked out densely: to the lowest point downhill, and from there to the undamped step."""
    random = np.random.default_rng(7)
    J, r = random.standard_normal((12, 5)) * [1, 10, 0.1, 3, 1], random.standard_normal(12)

    class Whole:
        @staticmethod
        def image(values, step):
            return J @ step

    gradient, squares = J.T @ r, (J**2).sum(axis=0)
    place = SimpleNamespace(gradient=gradient, values=None, gaps=None)
    step = -np.linalg.solve(J.T @ J, gradient)
    d = np.sqrt(squares)
    slope = -gradient / d
    cauchy = slope * (slope @ slope) / np.square(J @ (slope / d)).sum()
    far = np.linalg.norm(d * step)
    for radius in np.array([0.05, 0.3, 0.6, 0.9, 0.99, 1.5]) * far:
        path = [share * cauchy for share in np.linspace(0.0, 1.0, 20_001)]
        path += [cauchy + share * (d * step - cauchy) for share in np.linspace(0.0, 1.0, 20_001)]
        expected = max((p for p in path if np.linalg.norm(p) <= radius), key=np.linalg.norm)
        found = d * limited(Method.DOGLEG, Whole, place, step, squares, radius)
        assert np.linalg.norm(found) == pytest.approx(min(radius, far), rel=1e-12)
        # Points of the path are 1/20,000 of its parts apart.
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4 * far)
        whole = d * limited(Method.GAUSS_NEWTON, Whole, place, step, squares, radius)
        np.testing.assert_allclose(whole, d * step * min(radius / far, 1.0), rtol=1e-12)


def test_what_does_not_depend_on_the_unknowns_is_known_exactly(blockwise):
    """A gradient of zero lies along no free direction: σ is 0, not unknown."""
    clauses = VARIANTS["fixed"] | {"more": "(derive (nothing (* 0 (sin ((q 5) 1)))) (still (- ((q 5) 1) ((q 5) 1))))"}
    for found in (solved(**clauses), blockwise(**clauses)):
        assert found["nothing"].value == found["still"].value == 0.0
        assert found["nothing"].sigma == found["still"].sigma == 0.0
