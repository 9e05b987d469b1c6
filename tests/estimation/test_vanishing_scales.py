"""Scales in `:sigma` that the data drive to nothing are told, and others are not."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mbm

CODE = "vanishing-scale"
X = np.arange(1.0, 21.0)


def told(noise: str, y: np.ndarray, scales: str = "(s positive)") -> list[str]:
    text = f"""(problem p (data d external) (unknowns (a) (b) {scales})
      (observe d (= y (+ a (* b x))) {noise}))"""
    solve = mbm.loads(text).solve(data={"d": {"x": X[: len(y)], "y": y}}).first
    return [each.message for each in solve.diagnostics if each.code.name == CODE]


@pytest.mark.parametrize("noise", [":sigma s :resolution 1", ":sigma s :distribution (student 4)"])
def test_readings_on_a_line(noise):
    """The likelihood of the scale has no maximum above zero: P → 1 for rounded readings, density → ∞ for others."""
    messages = told(noise, 3.0 + 2.0 * X[:6])
    assert len(messages) == 1
    assert "`s`" in messages[0]


def test_readings_within_their_rounding():
    """A line passes within half a step of 3 5 8 10 12 15, so that any small scale has probability 1."""
    assert told(":sigma s :resolution 1", np.array([3.0, 5.0, 8.0, 10.0, 12.0, 15.0]))


@pytest.mark.parametrize("seed", [0, 4, 5])
def test_a_part_of_the_noise_that_the_other_explains(seed):
    """Drawn with 10 % of the value alone; in these draws the likelihood falls with s from 0 on."""
    y = (3.0 + 2.0 * X) * (1.0 + 0.1 * np.random.default_rng(seed).normal(size=20))
    messages = told(":sigma (hypot s (* r model))", y, "(s positive) (r positive)")
    assert len(messages) == 1
    assert "`s`" in messages[0]
    assert "`r`" not in messages[0]


@pytest.mark.parametrize("noise", [":sigma s :resolution 0.1", ":sigma s :distribution (student 4)"])
def test_scales_that_data_tell_are_not_doubted(noise):
    for seed in range(5):
        y = 3.0 + 2.0 * X + np.random.default_rng(seed).normal(size=20)
        assert not told(noise, np.round(y, 1))


def test_large_numbers_beside_the_readings():
    """Timestamps of 1.7e9 s say nothing of how large readings of 3 to 5 are."""
    x = 1.7e9 + X
    y = 3.0 + 0.1 * X + 0.003 * np.random.default_rng(2).normal(size=20)
    text = """(problem p (data d external) (unknowns (a) (b) (s positive))
      (observe d (= y (+ a (* b (- x 1.7e9)))) :sigma s :distribution (student 4)))"""
    solve = mbm.loads(text).solve(data={"d": {"x": x, "y": y}}).first
    assert not [each for each in solve.diagnostics if each.code.name == CODE]


@pytest.mark.parametrize(
    ("noise", "scales"), [("(exp l)", "(l :init 0)"), ("(* s (exp (* q x)))", "(s positive) (q :init 0)")]
)
def test_logarithms_and_slopes_near_zero(noise, scales):
    """What is zero in an exponent is no noise of zero."""
    for seed in range(3):
        y = 3.0 + 2.0 * X + np.random.default_rng(seed).normal(size=20)
        assert not told(f":sigma {noise} :distribution (student 4)", y, scales)


@pytest.mark.parametrize(("scale", "part"), [("(s :init 0.1)", "s"), ("(s :init -1)", "(exp s)")])
@pytest.mark.parametrize("seed", [0, 4, 5])
def test_scales_of_either_sign_and_logarithms_that_the_other_part_explains(seed, scale, part):
    """The draws of `test_a_part_of_the_noise_that_the_other_explains`, with other words for the same part."""
    y = (3.0 + 2.0 * X) * (1.0 + 0.1 * np.random.default_rng(seed).normal(size=20))
    messages = told(f":sigma (hypot {part} (* r model))", y, f"{scale} (r positive)")
    assert len(messages) == 1
    assert "`s`" in messages[0]
    assert "`r`" not in messages[0]


@pytest.mark.parametrize(("scale", "part"), [("(s :init 1)", "s"), ("(s :init 0)", "(exp s)")])
def test_scales_of_either_sign_and_logarithms_beside_another_part(scale, part):
    """Noise of 3 beside 10 % of values from 5 to 43 is told, and 10 % alone is told apart from it."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        y = (3.0 + 2.0 * X) * (1.0 + 0.1 * rng.normal(size=20)) + 3.0 * rng.normal(size=20)
        assert not told(f":sigma (hypot {part} (* 10% model))", y, scale)


def test_a_scale_that_a_bound_holds_is_not_zero():
    y = 3.0 + 2.0 * X + np.random.default_rng(1).normal(size=20)
    for scale in ("(s :init 3 :in (2 5))", "(s positive :init 3 :in (2 5))"):
        assert not told(":sigma s :distribution (student 4)", y, scale)


def test_stated_noise_beside_a_scale_of_zero():
    """The other estimates follow the stated part, and are not those of an arbitrary scale."""
    messages = told(":sigma (hypot 0.1 s) :distribution (student 4)", 3.0 + 2.0 * X)
    assert all("arbitrary" not in each for each in messages)


def test_the_mend():
    assert not told(":sigma 0.1 :resolution 1", np.array([3.0, 5.0, 8.0, 10.0, 12.0, 15.0]), "")


def test_residuals_from_several_threads():
    """Kernels have one place for their inputs: readers of one compiled problem wait for one another."""
    data = {"d": {"x": X, "y": 3.0 + 2.0 * X}}
    text = "(problem p (data d external) (unknowns (a :init 0) (b :init 0)) (observe d (= y (+ a (* b x))) :sigma 1))"
    compiled = mbm.loads(text).compile(data=data)
    points = np.random.default_rng(1).normal(size=(200, 2))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(compiled.residuals, points))
    expected = points[:, :1] + points[:, 1:] * X - (3.0 + 2.0 * X)
    assert np.abs(np.array(found) - expected).max() < 1e-12
