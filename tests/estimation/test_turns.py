"""Plain numbers that turn as angles do: one solution, written as a person would; frequencies a turn apart are two."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.search.twins import Twin, twin_of

SINE = """(problem s (data d external) (unknowns (a) (w :in (0.5 {most})) (phi))
  (observe d (= y (* a (sin (+ phi (* w t))))) :sigma 0.05) {more})"""


def wave(times: np.ndarray, truth: tuple[float, float, float], seed: int) -> dict[str, dict[str, np.ndarray]]:
    noise = np.random.default_rng(seed).normal(0.0, 0.05, len(times))
    return {"d": {"t": times, "y": truth[0] * np.sin(truth[2] + truth[1] * times) + noise}}


@pytest.mark.parametrize(("seed", "phase"), [(1, 2.8), (2, -2.4), (3, 0.3)])
def test_a_wave_has_a_positive_amplitude_and_a_phase_within_half_a_turn(seed, phase):
    """(a, φ), (−a, φ + π) and (a, φ + 2π) are one wave; SciPy begins at the truth, which is so written."""
    data = wave(np.linspace(0.0, 9.7, 12), (2.5, 0.85, phase), seed)
    t, y = data["d"]["t"], data["d"]["y"]
    wanted = least_squares(lambda p: (p[0] * np.sin(p[2] + p[1] * t) - y) / 0.05, [2.5, 0.85, phase], xtol=1e-12).x
    solve = mbm.loads(SINE.format(most=3, more="")).solve(data=data).first
    found = [float(each.value) for each in solve.estimates]
    assert found == pytest.approx(list(wanted), abs=1e-4)  # a hundredth of their standard deviations
    assert not solve.alternatives


def test_frequencies_a_turn_apart_are_two_at_whole_times():
    """At t = 0, 1, 2, … nobody can tell ω from ω + 2π: both are told, though the residuals are the same."""
    data = wave(np.arange(10.0), (2.5, 0.85, 0.4), 4)
    solve = mbm.loads(SINE.format(most=8, more="")).solve(data=data).first
    rates = [float(each.estimates[1].value) for each in (solve, *solve.alternatives)]
    assert np.ptp([abs(rate) for rate in rates]) > 2.0
    assert any(abs(abs(a - b) - 2 * np.pi) < 1e-3 for a in rates for b in rates)


def test_turns_that_a_derived_quantity_tells_apart_are_told():
    data = wave(np.linspace(0.0, 9.7, 12), (2.5, 0.85, 2.8), 1)
    solve = mbm.loads(SINE.format(most=3, more="(derive (half (* 0.5 phi)))")).solve(data=data).first
    assert solve.alternatives


def test_a_fix_by_stars_is_on_the_map():
    """sin h = sin φ sin δ + cos φ cos δ cos(G + λ): (φ, λ) is (π − φ, λ + π) too, each with any number of turns."""
    place = np.radians([47.3, -8.5])
    stars = np.radians([[40.0, 20.0], [110.0, -10.0], [300.0, 45.0], [200.0, 60.0]])

    def heights(p: np.ndarray) -> np.ndarray:
        across = np.cos(p[0]) * np.cos(stars[:, 1]) * np.cos(stars[:, 0] + p[1])
        return np.arcsin(np.sin(p[0]) * np.sin(stars[:, 1]) + across)

    h = heights(place) + np.radians([0.01, -0.02, 0.015, 0.005])
    rows = "\n".join(f"({g:.12f} {d:.12f} {x:.12f})" for (g, d), x in zip(stars, h, strict=True))
    text = f"""(problem fix (data d (table (g d h) {rows})) (unknowns (lat :unit deg) (lon :unit deg))
      (observe d (= h (asin (+ (* (sin lat) (sin d)) (* (cos lat) (cos d) (cos (+ g lon)))))) :sigma 0.02deg))"""
    solve = mbm.loads(text).solve().first
    wanted = least_squares(lambda p: heights(p) - h, place, xtol=1e-12, ftol=1e-15, gtol=1e-15).x
    assert [float(each.value) for each in solve.estimates] == pytest.approx(list(np.degrees(wanted)), abs=1e-4)
    assert not solve.alternatives


@pytest.mark.parametrize("scale", [1e-6, 1.0])
def test_small_numbers_are_no_turns(scale):
    """Two roots, and the two sides of a line, are two solutions in micrometres as in metres."""
    roots = f"""(problem p (unknowns (x))
      (observe (= 0 (* (/ (- x {scale}) {scale}) (/ (- x {3 * scale}) {scale}))) :sigma 0.1))"""
    ranges = f"""(problem p (data d (table (s r) (0 {5 * scale}) ({6 * scale} {5 * scale}))) (unknowns (x) (y))
      (observe d (= r (sqrt (+ (^ (- x s) 2) (^ y 2)))) :sigma {0.01 * scale}))"""
    for text, last in ((roots, [1.0, 3.0]), (ranges, [-4.0, 4.0])):
        solve = mbm.loads(text).solve(starts=20).first
        ends = sorted(float(each.estimates[-1].value) / scale for each in (solve, *solve.alternatives))
        assert ends == pytest.approx(last, abs=1e-3)


@pytest.mark.parametrize(
    ("second", "kind"),
    [
        ((2.5, 0.85, 0.4 + 2 * np.pi, 2.0), Twin.WOUND),
        ((-2.5, 0.85, 0.4 - np.pi, 2.0), Twin.WOUND),
        ((2.5, 0.85, 0.4, -2.0), Twin.MIRRORED),
        ((-2.5, 0.85, 0.4 - np.pi, -2.0), Twin.MIRRORED),
        ((2.5, 0.85, 0.4 + np.pi, 2.0), None),
    ],
)
def test_a_mirror_image_of_a_wave_is_none_of_its_ways_to_be_written(second, kind):
    """a sin(ω t + φ) + z²: z and −z are two solutions, whichever way the wave is written where each is found."""
    text = """(problem s (data d external) (unknowns (a :init 2) (w :init 1) (phi :init 0) (z :init 1))
      (observe d (= y (+ (* z z) (* a (sin (+ phi (* w t)))))) :sigma 0.05))"""
    data = {"d": {"t": np.linspace(0.0, 9.7, 12), "y": np.ones(12)}}
    equations, _ = mbm.loads(text).compile(data=data)._assembled()
    assert twin_of(equations, np.array([2.5, 0.85, 0.4, 2.0]), np.array(second)) is kind


def test_clauses_without_rows_tell_no_phase_from_a_frequency():
    """At 0, 1, 2, 3 and 4 seconds ω and 2π − ω are one in all residuals, and are two solutions."""
    values = 2.5 * np.sin(0.4 + 0.85 * np.arange(5.0))
    clauses = " ".join(
        f"(observe (= {y!r} (* a (sin (+ phi (* w {k}))))) :sigma 0.01)" for k, y in enumerate(values.tolist())
    )
    text = f"(problem s (unknowns (a :in (0 5)) (w :in (0.5 8)) (phi :in (-3 3))) {clauses})"
    solve = mbm.loads(text).solve(starts=60).first
    rates = {round(float(each.estimates[1].value), 3) for each in (solve, *solve.alternatives)}
    assert {0.85, round(2 * np.pi + 0.85, 3)} <= rates


def test_a_level_camera_above_a_road_is_not_said_to_be_upside_down():
    """Pitch and yaw half a turn off, each, turn the road above the camera: the same lines in the image."""
    pitch, yaw = 0.06, 0.03
    lane, ahead = np.repeat([-1.75, 1.75], 15), np.tile(np.linspace(6.0, 40.0, 15), 2)
    places = np.column_stack([lane - 0.4, np.full(30, 1.4), ahead])
    x, y, z = (Rotation.from_euler("x", -pitch) * Rotation.from_euler("y", yaw)).apply(places).T
    noise = np.random.default_rng(0).normal(0.0, 0.5, (2, 30))
    data = {"d": {"lane": lane, "u": 1000 * x / z + 640 + noise[0], "v": 1000 * y / z + 360 + noise[1]}}
    text = """(problem road (data d external) (camera cam :focal 1000 :center (640 360))
      (unknowns (h positive) (pitch angle) (yaw angle) (off))
      (define (R (@ (rot-x (- pitch)) (rot-y yaw))))
      (observe d (vertex-on-line [u v] (line-through
        (project cam (rotate R [(- lane off) h 5])) (project cam (rotate R [(- lane off) h 50])))) :sigma 0.5))"""
    solve = mbm.loads(text).solve(data=data).first
    found = {each.name: (float(each.value), float(each.sigma)) for each in solve.estimates}
    assert abs(found["pitch"][0] - pitch) < 4 * found["pitch"][1]
    assert abs(found["yaw"][0] - yaw) < 4 * found["yaw"][1]


@pytest.mark.parametrize("starts", [None, 20])
def test_the_side_of_a_plane_is_that_of_the_start(starts):
    """A normal and its distance may both change sign; the stated normal counts, not how many numbers are positive."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1.0, 1.0, (2, 20))
    data = {"d": {"x": x, "y": y, "z": -2.0 + 0.01 * rng.normal(size=20)}}
    text = """(problem plane (data d external) (unknowns (n direction :init [0 0 1]) (q))
      (observe d (= 0 (- (dot n [x y z]) q)) :sigma 0.01))"""
    found = mbm.loads(text).solve(data=data, starts=starts)
    assert found["n"].value[2] > 0.9
    assert float(found["q"].value) == pytest.approx(-2.0, abs=0.02)
