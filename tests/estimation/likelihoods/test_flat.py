"""Readings that are as likely with other values: what is said of the unknowns that they leave open."""

from __future__ import annotations

import mbm

ROUNDED = """(problem p (data d (table (y) (1) (1) (1))) (unknowns (a :init 1) (c :init 1))
  (observe d (= y a) :resolution 1 :sigma 0.01))"""


def test_rounded_readings_in_the_middle_of_a_step_leave_their_value_open():
    """From 0.55 to 1.45 each is read as 1 with a probability that no double tells from 1."""
    found = mbm.loads(ROUNDED).solve().first
    said = [each.sentence for each in found.observability.unobservable]
    assert said == [
        "what was read is as likely with other values of `a` near the estimates",
        "`c` appears in no equation that has data",
    ]
