"""Why a number of a solve is missing, as CONTRACT §2 asks; a solve by itself and one of many say the same."""

from __future__ import annotations

import pytest

import mbm

REASONS = {
    "stated": (":sigma 1", "(1 1) (1 2) (1 4)", {}),
    "exact": (":sigma 1", "(1 3)", {"sigma0": "no degrees of freedom", "chi2_p": "no degrees of freedom"}),
    "unknown": ("", "(1 1) (1 2) (1 4)", {"chi2_p": "the noise is estimated from the residuals"}),
    "loss": (":sigma 1 :loss (huber 1)", "(1 1) (1 2) (1 4)", {"chi2_p": "with a robust loss"}),
    "no value": (":sigma 1", "(1 -1)", dict.fromkeys(("cost", "dof", "sigma0", "chi2_p"), "finite")),
}


@pytest.mark.parametrize("case", REASONS)
@pytest.mark.parametrize("end", ["", "(for-each run)"])
def test_the_reason_is_said(case: str, end: str) -> None:
    noise, rows, reasons = REASONS[case]
    model = "(sqrt (* y m))" if case == "no value" else "m"
    text = f"""(problem p (data d (table (run y) {rows})) (unknowns (m :init 1))
      (observe d (= y {model}) {noise}) {end})"""
    (solve,) = mbm.loads(text).solve().document()["solves"]
    assert {name for name in ("cost", "dof", "sigma0", "chi2_p") if solve[name] is None} == set(reasons)
    for name, reason in reasons.items():
        assert reason in solve["reasons"][name]
    assert ("robust_cost" in solve) == (case == "loss")
