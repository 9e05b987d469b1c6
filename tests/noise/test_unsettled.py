"""Noise that is not settled when the rounds run out that estimate it: said where it is, and only there."""

from __future__ import annotations

import pytest

import mbm
from mbm.estimation.consensus import scales
from mbm.estimation.solve import shared_noise
from mbm.estimation.uncertainty import variance

LINE = "(table (x y) (0 1.02) (1 2.9) (2 5.1) (3 6.95) (4 9.1) (5 10.9) (6 13.2))"
COMPONENTS = f"""(problem components (data d {LINE}) (data e (table (u) (1.4) (0.7) (1.5)))
  (unknowns (a :init 1) (b :init 1))
  (observe d (= y (+ (* a x) b)) :sigma unknown)
  (observe e (= u b) :sigma unknown))"""
CHAIN = f"""(problem chain (data d {LINE}) (unknowns (a :init 1) (b :init 1))
  (observe d (= y (+ (* a x) b)) :sigma unknown :correlation (ar1 unknown)))"""
STATES = f"""(problem walk (data d {LINE}) (states :over x (s :init 1 :sigma 1))
  (dynamics (= (next s) (+ s 2) :sigma 0.01))
  (observe d (= y s) :sigma unknown :loss huber) (solve :method batch))"""


@pytest.mark.parametrize(
    ("text", "module", "rounds"),
    [(COMPONENTS, variance, "NOISE_ROUNDS"), (CHAIN, shared_noise, "NOISE_ROUNDS"), (STATES, scales, "FITS")],
)
def test_rounds_that_run_out_are_said(text, module, rounds, monkeypatch):
    """One round of a sequence that takes several, as 200 of one that takes more."""
    settled = mbm.loads(text).solve().first
    monkeypatch.setattr(module, rounds, 1)
    cut = mbm.loads(text).solve().first
    said = [[d.message for d in each.diagnostics if d.code.name == "noise-not-estimated"] for each in (settled, cut)]
    assert said[0] == []
    assert any("`d` still changed when the rounds" in message for message in said[1])
