"""Outliers within noise that is stated too large are doubted, and normal errors of any size are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kurtosistest

import mbm
from mbm.estimation.trust.hidden import kurtosis_tail, tail
from tests.robust import test_trust
from tests.robust.test_contradiction import solved

CODE = "hidden-outliers"
X = np.linspace(0.0, 1.0, 60)
NORMAL = np.random.default_rng(4).normal(size=X.size)
FALSE = np.isin(np.arange(60), [7, 30, 41, 55])
OUTLYING = np.where(FALSE, np.where(X < 0.6, 15.0, -15.0), NORMAL)
LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) {noise}) {more})"


def said(errors: np.ndarray, noise: str = ":sigma 20", more: str = "") -> list[str]:
    result = mbm.loads(LINE.format(noise=noise, more=more)).solve(data={"d": {"x": X, "y": 10 + 20 * X + errors}})
    return [each.message for each in result.diagnostics if each.code.name == CODE]


def test_outliers_hide_in_noise_that_is_stated_too_large() -> None:
    (message,) = said(OUTLYING)
    listed = message.split("those: rows ")[1]
    assert {int(word) for word in listed.split(" (in brackets")[0].replace(",", "").split()[::2]} == {8, 31, 42, 56}


@pytest.mark.parametrize("noise", [":sigma unknown", ":sigma 20 :loss cauchy", ":sigma 1"])
def test_outliers_that_do_not_hide(noise: str) -> None:
    """Of unknown noise they are a part, a loss expects them, and beside noise as most errors have it χ² shows them."""
    assert not said(OUTLYING, noise)


@pytest.mark.parametrize("sigma", [0.5, 1, 2, 20, 1000])
def test_normal_errors_of_another_size_than_stated(sigma: float) -> None:
    assert not said(NORMAL, f":sigma {sigma}")


def test_rounded_readings_are_no_outliers() -> None:
    """Most of them are the same, and those of the next step infinitely far beside nothing."""
    text = "(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma 0.5))"
    y = np.where(FALSE, 4.0, 3.0)
    found = mbm.loads(text).solve(data={"d": {"y": y}})
    assert CODE not in [each.code.name for each in found.diagnostics]


def test_rows_that_consensus_keeps() -> None:
    """All are within a limit of the stated noise."""
    assert said(OUTLYING, more="(solve :robust (gnc :quantile 99%))")


@pytest.mark.parametrize("count", [20, 100, 1000])
def test_chance_of_a_kurtosis(count: int) -> None:
    """As drawn, to a fifth of a chance of 1 % and what is drawn by chance."""
    draws = np.square(np.random.default_rng(1).normal(size=(20_000, count)))
    kurtosis = np.square(draws).mean(axis=1) / draws.mean(axis=1) ** 2
    share = np.mean([kurtosis_tail(each, count) < 0.01 for each in kurtosis.tolist()])
    assert abs(share - 0.01) < 0.002 + 3 * np.sqrt(0.01 / 20_000)


def test_chance_of_a_kurtosis_about_a_known_mean() -> None:
    """Of many rows the mean does not matter, and SciPy's test is the same (Anscombe and Glynn)."""
    draws = np.random.default_rng(2).standard_t(20, size=5000)
    draws = np.concatenate([draws, -draws])
    kurtosis = (draws**4).mean() / (draws**2).mean() ** 2
    assert kurtosis_tail(kurtosis, 10_000.0) == pytest.approx(kurtosistest(draws, alternative="greater")[1], rel=0.01)


DESIGNS = {
    "pairs": np.kron(np.eye(40), np.ones((2, 1))),
    "leverage": np.random.default_rng(3).normal(size=(60, 20))
    * np.random.default_rng(5).lognormal(0.0, 1.0, size=(60, 1)),
    "half": np.random.default_rng(6).normal(size=(60, 30)),
}


@pytest.mark.parametrize("design", DESIGNS)
def test_chance_of_residuals(design: str) -> None:
    """Correlated residuals are not accused more often than one in a hundred: three deviations above in 4,000 draws."""
    basis = np.linalg.qr(DESIGNS[design])[0]
    redundancy = 1.0 - np.square(basis).sum(axis=1)
    draws = 0.01 * np.random.default_rng(8).normal(size=(4000, len(basis)))
    residuals = draws - draws @ basis @ basis.T
    accused = sum(tail(each, redundancy, 1) is not None for each in residuals)
    assert accused / 4000 < 0.01 + 3 * np.sqrt(0.01 / 4000)


def test_many_solves_say_what_single_ones_say() -> None:
    rng = np.random.default_rng(6)
    data = []
    for k, count in enumerate([30, 60, 25, 15, 60]):
        x = np.linspace(0.0, 1.0, count)
        data.append(
            (x, 10 + 20 * x + np.where(np.arange(count) % 12 == 5, 15.0 * (k < 4), 1.0) * rng.normal(size=count))
        )
    columns = {"run": np.concatenate([np.full(x.size, k) for k, (x, _) in enumerate(data)])}
    columns |= {"x": np.concatenate([x for x, _ in data]), "y": np.concatenate([y for _, y in data])}
    many = mbm.loads(LINE.format(noise=":sigma 20", more="(for-each run)")).solve(data={"d": columns})
    for solve, (x, y) in zip(many.solves, data, strict=True):
        alone = mbm.loads(LINE.format(noise=":sigma 20", more="")).solve(data={"d": {"x": x, "y": y}})
        assert [d.code for d in solve.diagnostics] == [d.code for d in alone.diagnostics]
    found = [CODE in [d.code.name for d in solve.diagnostics] for solve in many.solves]
    assert found[1] and not found[3] and not found[4]


@pytest.mark.parametrize(("side", "method"), [(7, "lm"), (12, "dogleg-sparse")])
@pytest.mark.parametrize("false", [0, 5])
def test_false_loops_hide_in_noise_that_is_stated_too_large(
    side: int, method: str, false: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hundred times; with dense and with sparse matrices."""
    monkeypatch.setattr(test_trust, "SIDE", side)
    result, _, _ = solved("plane", false, noise=":sigma [100deg 5m 5m]")
    assert result.first.method == method
    assert [each.code.name for each in result.diagnostics].count(CODE) == (false > 0)
