"""What else is made of likelihoods: budgets, explanations, reports; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

DATA = "(data t (table (g x n) (1 0 3) (1 1 5) (1 2 4) (2 3 9) (2 4 11) (2 5 19)))"
LINE = "(unknowns (a :init 2) (b :init 3)) (observe t (= n (+ a (* b x))) {})"


def problem(options: str, more: str = "") -> mbm.Problem:
    return mbm.loads(f"(problem p {DATA} {LINE.format(options)} {more})")


def codes(error: mbm.MbmError) -> set[str]:
    return {each.code.name for each in error.diagnostics}


@pytest.mark.parametrize("options", [":distribution poisson", ":sigma (* 20% model)", ":sigma 2 :above (> n 15)"])
def test_a_budget_adds_up_to_the_variance(options: str) -> None:
    found = problem(options).solve()
    budget = found.budget("b")
    assert budget.sigma == pytest.approx(float(found["b"].sigma), rel=1e-9)
    assert sum(row.contribution**2 for row in budget.rows) == pytest.approx(budget.sigma**2, rel=1e-9)


@pytest.mark.parametrize(
    ("options", "said"),
    [(":distribution poisson", ":distribution poisson"), (":sigma (* 20% model)", "model in the noise")],
)
def test_the_explanation_says_what_the_noise_is(
    options: str, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "p.mbm"
    file.write_text(f"(problem p {DATA} {LINE.format(options)})", "utf-8")
    assert run(["explain", str(file)]) == 0
    text = capfd.readouterr().out
    assert f"noise: {said}" in text
    assert "a + b*x" in text


def test_raw_residuals_are_model_minus_measured() -> None:
    found = problem(":sigma (* 20% model)").solve()
    table = found.residuals("t")
    a, b = float(found["a"].value), float(found["b"].value)
    model = a + b * np.arange(6.0)
    off = model - np.array([3.0, 5, 4, 9, 11, 19])
    raw = np.asarray(table["raw"], dtype=float)
    assert raw == pytest.approx(off, rel=1e-9)
    whitened = np.asarray(table["whitened"], dtype=float)
    assert whitened == pytest.approx(off / (0.2 * model), rel=1e-9)


@pytest.mark.parametrize(
    ("options", "more", "code"),
    [
        (":distribution poisson :common ((1 :per g))", "", "likelihood-not-here"),
        (":distribution poisson :loss huber", "", "likelihood-not-here"),
        (":distribution poisson :errors ((x 0.1))", "", "likelihood-not-here"),
        (":sigma (* 5% model) :errors ((x 0.1))", "", "likelihood-not-here"),
        (":distribution poisson", "(solve :method closed-form)", "likelihood-not-here"),
        (":sigma 1 :distribution (student 4) :below (> n 3)", "", "likelihood-not-here"),
        (":sigma a", "", "depends-on-unknown"),
        (":distribution (student a) :sigma 1", "", "depends-on-unknown"),
    ],
)
def test_what_does_not_go_together(options: str, more: str, code: str) -> None:
    with pytest.raises(mbm.MbmError) as error:
        problem(options, more).solve()
    assert codes(error.value) == {code}


def test_trials_draw_normal_errors_only() -> None:
    with pytest.raises(mbm.MbmError) as error:
        problem(":distribution poisson").propagate(trials=100)
    assert codes(error.value) == {"not-propagated"}


@pytest.mark.parametrize("options", [":distribution poisson", ":sigma (* 20% model)"])
def test_designs_refuse(options: str) -> None:
    with pytest.raises(mbm.MbmError) as error:
        problem(options).design(at={"a": 2, "b": 3})
    assert codes(error.value) == {"not-designed"}


def test_generated_solvers_refuse(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "p.mbm"
    file.write_text(f"(problem p {DATA} {LINE.format(':distribution poisson')})", "utf-8")
    assert run(["compile", str(file), "--target", "c", "-o", str(tmp_path / "out")]) == 2
    assert "not-emitted" in capfd.readouterr().err
