"""Minima that a search must not miss: far from the middle of ranges, and beside limits that fit by shrinking scales."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

import mbm

Floats = NDArray[np.float64]
RNG = np.random.default_rng(5)


def table(names: str, *columns: Floats) -> str:
    rows = zip(*columns, strict=True)
    return f"(data d (table ({names}) " + " ".join("(" + " ".join(map(repr, map(float, r))) + ")" for r in rows) + "))"


def test_two_oscillations_within_ranges_of_their_frequencies() -> None:
    """The middle of the ranges leads to a minimum of 50 times the cost; the amplitudes enter linearly."""
    t = np.linspace(0.0, 4.0, 120)
    y = np.sin(2 * np.pi * 3.1 * t + 0.3) + 0.5 * np.sin(2 * np.pi * 7.45 * t - 1.0) + RNG.normal(0.0, 0.1, len(t))
    wave = "(* a{0} (sin (* 2 pi f{0} t))) (* b{0} (cos (* 2 pi f{0} t)))"
    found = mbm.loads(
        f"(problem p {table('t y', t, y)} (unknowns (a1) (b1) (f1 :in (2 5)) (a2) (b2) (f2 :in (5 10)))"
        f" (observe d (= y (+ {wave.format(1)} {wave.format(2)}))))"
    ).solve()

    def misfit(f: Floats) -> Floats:
        phases = 2 * np.pi * t[:, None] * f
        basis = np.hstack([np.sin(phases), np.cos(phases)])
        return np.asarray(y - basis @ np.linalg.lstsq(basis, y)[0])

    best = least_squares(misfit, [3.1, 7.45], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # SciPy's derivatives are differences: good to 1e-8 of a frequency
    assert found["f1"].value == pytest.approx(best.x[0], rel=1e-6)
    assert found["f2"].value == pytest.approx(best.x[1], rel=1e-6)
    assert found.cost == pytest.approx(2 * best.cost, rel=1e-9)


@pytest.mark.parametrize("sigma", [":sigma 0.005", ""])
def test_an_accelerometer_whose_scales_would_shrink_everything_to_nothing(sigma: str) -> None:
    """With infinite scales every reading has the norm that is wanted: a limit that costs nothing, and no answer."""
    down = RNG.normal(size=(24, 3))
    read = 9.81 * down / np.linalg.norm(down, axis=1)[:, None] * [1.02, 0.98, 1.01] + [0.1, -0.2, 0.05]
    read += RNG.normal(0.0, 0.005, read.shape)
    found = mbm.loads(
        f"(problem p {table('x y z', *read.T)} (unknowns (s (vector 3)) (b (vector 3)))"
        f" (observe d (= 9.81 (norm (/ (- [x y z] b) s))) {sigma}))"
    ).solve()
    best = least_squares(lambda p: np.linalg.norm((read - p[3:]) / p[:3], axis=1) - 9.81, [1.0, 1, 1, 0, 0, 0])
    assert found.status == "ok"
    assert np.abs(found["s"].value) == pytest.approx(np.abs(best.x[:3]), rel=1e-6)
    assert found["b"].value == pytest.approx(best.x[3:], abs=1e-5)
    assert found.alternatives == ()


def test_a_magnetometer_with_nine_unknowns_and_no_start() -> None:
    """A full matrix and an offset; SciPy begins at the truth. Signs of the matrix's rows are free."""
    field = RNG.normal(size=(80, 3))
    field *= 0.48 / np.linalg.norm(field, axis=1)[:, None]
    soft = np.array([[1.1, 0.05, -0.02], [0.0, 0.95, 0.03], [0.0, 0.0, 1.05]])
    read = np.linalg.solve(soft, field.T).T + np.array([0.2, -0.1, 0.3]) + RNG.normal(0.0, 2e-3, field.shape)
    found = mbm.loads(
        f"(problem p {table('x y z', *read.T)} (unknowns (a (array 6)) (b (vector 3)))"
        " (define (M [[(a 1) (a 4) (a 5)] [0 (a 2) (a 6)] [0 0 (a 3)]]))"
        " (observe d (= 0.48 (norm (@ M (- [x y z] b)))) :sigma 0.002))"
    ).solve()

    def misfit(p: Floats) -> Floats:
        matrix = np.array([[p[0], p[3], p[4]], [0.0, p[1], p[5]], [0.0, 0.0, p[2]]])
        return np.asarray((np.linalg.norm((read - p[6:]) @ matrix.T, axis=1) - 0.48) / 0.002)

    best = least_squares(misfit, [1.1, 0.95, 1.05, 0.05, -0.02, 0.03, 0.2, -0.1, 0.3])
    assert found.status == "ok"
    assert found.cost == pytest.approx(2 * best.cost, rel=1e-6)
    assert np.abs(found["a"].value) == pytest.approx(np.abs(best.x[:6]), abs=1e-5)
    assert found["b"].value == pytest.approx(best.x[6:], abs=1e-6)


def test_oscillations_of_several_channels_are_found_each_by_itself() -> None:
    """No equation ties channels to one another: the frequencies of all would hardly ever be drawn right together."""
    truth = np.array([[2.8, 5.16, -1.7], [1.9, 3.1, 0.7], [2.1, 4.4, 1.1], [2.7, 2.66, 0.2]])
    times = np.sort(RNG.uniform(0.0, 3.0, (4, 30)), axis=1)

    def wave(p: Floats, t: Floats) -> Floats:
        return np.asarray(p[0] * np.sin(2 * np.pi * p[1] * t + p[2]))

    read = np.array([wave(p, t) for p, t in zip(truth, times, strict=True)]) + RNG.normal(0.0, 0.1, times.shape)
    channel = np.repeat(np.arange(4.0), 30)
    found = mbm.loads(
        f"(problem p {table('k t y', channel, times.ravel(), read.ravel())}"
        " (unknowns (a positive :per d.k) (f positive :per d.k) (ph angle :per d.k))"
        " (observe d (= y (* (a k) (sin (+ (* 2 pi (f k) t) (ph k))))) :sigma 0.1))"
    ).solve()
    best = [
        least_squares(lambda p, t=t, y=y: (wave(p, t) - y) / 0.1, p) for p, t, y in zip(truth, times, read, strict=True)
    ]
    assert found.cost == pytest.approx(2 * sum(each.cost for each in best), rel=1e-6)
    assert found["f"].value == pytest.approx([each.x[1] for each in best], rel=1e-6)


def test_precise_readings_with_two_solutions_keep_the_better_one_and_tell_the_other() -> None:
    """A throw's height at two times, far more standard deviations apart than a way to the infinite begins with."""
    text = """(problem p (data d (table (h) (1.0) (1.0000002) (0.9999999))) (unknowns (t))
      (observe d (= h (- (* 6 t) (* 4.9 t t))) :sigma 1e-7) (observe (= 0.21 t) :sigma 0.3))"""
    found = mbm.loads(text).solve()
    early, late = np.sort(np.roots([-4.9, 6.0, -1.0]))  # the readings move them by 1e-8
    assert found["t"].value == pytest.approx(early, rel=1e-6)
    (other,) = found.alternatives
    assert other.estimates[0].value == pytest.approx(late, rel=1e-6)


def test_a_double_root_is_no_limit() -> None:
    """At 0 both rows hold exactly and nothing is felt of a small step: finite, and the better fit of two."""
    found = mbm.loads(
        "(problem p (unknowns (a)) (observe (= 0 (* a a (- 3 (* 2 a)))) :sigma 1)"
        " (observe (= 0 (* a a (- 3.1 (* 2 a)))) :sigma 1))"
    ).solve()
    assert float(found["a"].value) == pytest.approx(0.0, abs=1e-3)
    assert "another-solution" in {each.code.name for each in found.diagnostics}
