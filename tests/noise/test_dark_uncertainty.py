"""Dark uncertainty, and noise between days: in any unit, and where the restricted likelihood has its maximum at 0."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

LABORATORIES = """(problem labs (data d external) {each} (unknowns (m) (b (vector 4)))
  (observe d (= y (+ m (b lab))) :sigma u) (observe dark d (= 0 (b lab)) :sigma unknown)
  (derive (own (+ m (b 1)))))"""
DAYS = """(problem days (data d external) {each} (unknowns (m) (b :per d.day))
  (observe d (= y (+ m (b day))) :sigma unknown) (observe days d.day (= 0 (b day)) :sigma unknown))"""
NESTED = """(problem nested (data d external) (data places (table (country) (1) (2))) {each}
  (unknowns (m) (b (vector 4)) (c (vector 2)))
  (observe countries places (= 0 (c country)) :sigma unknown)
  (observe labs d (= (b lab) (c country)) :sigma unknown)
  (observe d (= y (+ m (b lab))) :sigma u))"""
LABS = np.array([1, 2, 3, 4])
U = np.array([0.5, 0.8, 1.1, 1.4])
AGREE, APART, EQUAL = np.array([10, 10.2, 9.9, 10.4]), np.array([8, 10.1, 13.2, 9.0]), np.full(4, 10.0)
SCALES = 10.0 ** np.array([-9, -4, 0, 3, 4, 6, 9])
SETTLED = 1e-7
"""Relative: the rounds end when factors move by less than 1e-9, and converge linearly."""


def _solves(text, many, y, u=U, **more):
    """Each scale with the solve in its unit: of all at once, or one after the other."""
    if many:
        data = {name: np.tile(values, len(SCALES)) for name, values in {"lab": LABS, **more}.items()}
        data |= {name: np.outer(SCALES, values).ravel() for name, values in {"y": y, "u": u}.items()}
        data["run"] = np.repeat(np.arange(len(SCALES)), 4)
        found = mbm.loads(text.format(each="(for-each run)")).solve(data={"d": data}).solves
    else:
        compiled = mbm.loads(text.format(each="")).compile()
        found = [
            compiled.solve(data={"d": {"lab": LABS, "u": u * scale, "y": y * scale, **more}}).first for scale in SCALES
        ]
    return list(zip(SCALES, found, strict=True))


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("y", [AGREE, APART, EQUAL])
def test_units_change_nothing_else(y, many):
    solves = _solves(LABORATORIES, many, y)
    one = dict(solves)[1.0]
    assert one["m"].dof == pytest.approx(3.0, rel=SETTLED)
    for scale, solve in solves:
        assert solve.noise["dark"] == pytest.approx(scale * one.noise["dark"], rel=SETTLED)
        for name in ("m", "own", "b"):
            for here, there in zip(_numbers(solve[name]), _numbers(one[name]), strict=True):
                np.testing.assert_allclose(here, scale * there, rtol=SETTLED, atol=scale * SETTLED)
            np.testing.assert_allclose(solve[name].dof, one[name].dof, rtol=SETTLED)
        assert [each.code.name for each in solve.diagnostics] == [each.code.name for each in one.diagnostics]


def _numbers(quantity):
    return np.asarray(quantity.value), np.asarray(quantity.sigma), np.asarray(quantity.interval(0.95))


@pytest.mark.parametrize("many", [False, True])
def test_equal_values_have_no_dark_uncertainty(many):
    """The restricted likelihood falls with it from 0 on: the mean of four of 0.5 is known to 0.25."""
    for scale, solve in _solves(LABORATORIES, many, EQUAL, np.full(4, 0.5)):
        assert solve.noise["dark"] == 0.0
        assert float(solve["m"].sigma) == pytest.approx(0.25 * scale, rel=1e-6)
        assert not solve.diagnostics


@pytest.mark.parametrize("many", [False, True])
def test_noise_beside_noise_that_is_found(many):
    """What the laboratories of a country have in common is written before what they have alone."""
    solves = _solves(NESTED, many, np.array([8, 11, 17, 22]), country=np.array([1, 1, 2, 2]))
    one = dict(solves)[1.0]
    for scale, solve in solves:
        for name in ("labs", "countries"):
            assert solve.noise[name] == pytest.approx(scale * one.noise[name], rel=SETTLED)


def _criterion(dark, y):
    """−2 log of the restricted likelihood of a mean, for each dark uncertainty (n,)."""
    weights = 1.0 / (U**2 + dark[:, None] ** 2)
    rest = y - (weights @ y / weights.sum(axis=1))[:, None]
    return np.log(weights.sum(axis=1)) - np.log(weights).sum(axis=1) + (weights * rest**2).sum(axis=1)


def test_the_restricted_likelihood_is_highest_however_flat_it_is():
    """Of 150 sets; it has one maximum in these, and a grid comes within 1e-6 of it."""
    sets = np.random.default_rng(0).normal(size=(150, 4)) * np.hypot(U, 0.3)
    data = {"run": np.repeat(np.arange(150), 4), "lab": np.tile(LABS, 150), "u": np.tile(U, 150), "y": sets.ravel()}
    solves = mbm.loads(LABORATORIES.format(each="(for-each run)")).solve(data={"d": data}).solves
    grid = np.linspace(0.0, 6.0, 6001)
    for solve, y in zip(solves, sets, strict=True):
        assert _criterion(np.array([solve.noise["dark"]]), y) <= _criterion(grid, y).min() + 1e-6


@pytest.mark.parametrize("ratio", [0.5, 0.9, 0.99, 0.999, 1.0, 1.001, 1.01, 2.0])
def test_noise_between_days_is_that_of_the_analysis_of_variance(ratio):
    """Balanced rows: between days (``ratio`` − 1) / 3 where that is positive, else 0; within days what is left."""
    within, between = np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 1.0, -1.0, 1.0]) * np.sqrt(ratio / 4)
    data = {"day": np.repeat(np.arange(4), 3), "y": (10.0 + between[:, None] + within).ravel()}
    solve = mbm.loads(DAYS.format(each="")).solve(data={"d": data}).first
    # The nearer to 0, the slower do factors settle to 1e-9.
    assert solve.noise["days"] ** 2 == pytest.approx(max(ratio - 1.0, 0.0) / 3.0, rel=1e-5)
    assert solve.noise["d"] ** 2 == pytest.approx(1.0 if ratio > 1.0 else (8.0 + 3.0 * ratio) / 11.0, rel=1e-6)


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize(("over", "said"), [("d", True), ("d.day", False)])
def test_equations_without_readings_hold_once_for_each_key(over, said, many):
    """Two readings of each of three days: a day has one deviation, which is not stated anew by each reading."""
    text = DAYS.replace("days d.day", f"days {over}").format(each="(for-each run)" if many else "")
    days, y = np.repeat([1, 2, 3], 2), np.array([9.6, 9.8, 10.5, 10.3, 10.1, 9.9])
    data = {
        "d": {"day": np.tile(days, 2), "y": np.tile(y, 2), "run": np.repeat([1, 2], 6)}
        if many
        else {"day": days, "y": y}
    }
    for solve in mbm.loads(text).solve(data=data).solves:
        told = [each.message for each in solve.diagnostics if each.code.name == "repeated-equations"]
        assert [message.split(",")[0] for message in told] == ["the 6 rows of `days` are 3 different equations"] * said


@pytest.mark.parametrize(
    "clause",
    [
        "(observe still d (= 0 bias) :sigma 0.01)",
        "(observe still d (= 0 (b day)) :sigma u)",
        "(observe still d (= 0 (b day)) :sigma 0.1 :loss huber)",
    ],
)
def test_rows_that_are_readings_of_nothing_are_no_equations_stated_again(clause):
    """A sensor at rest reads 0 each time; so do rows of their own uncertainty, and rows that a loss judges."""
    text = f"""(problem rest (data d external) (unknowns (bias) (b :per d.day))
      (observe d (= y (+ bias (b day))) :sigma 0.1) {clause})"""
    data = {"day": np.repeat([1, 2, 3], 2), "y": np.array([0.1, 0.2, -0.1, 0.0, 0.2, 0.1]), "u": np.tile([0.1, 0.2], 3)}
    found = mbm.loads(text).solve(data={"d": data}).first
    assert "repeated-equations" not in [each.code.name for each in found.diagnostics]
