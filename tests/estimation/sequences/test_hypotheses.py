"""A link that swings through the direction of sight: its projection does not tell on which side it is."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm

STEPS = 16
ANGLES = np.radians(-30 + 5 * np.arange(STEPS))
"""Through 0 at step 6."""

TEXT = """
(problem arm
  (data seen external) (data late external)
  (states :over k (theta :init -30deg :sigma 3deg))
  (dynamics (constant-velocity theta :acceleration 1deg :velocity 5deg :velocity-sigma 1deg))
  (observe seen (= x (* 10 (cos theta))) :sigma 0.02)
  (observe late (= s (* 10 (sin theta))) :sigma 0.1 :when (< s 1e3))
  {rest}
  (solve :method {method} :hypotheses {count}))
"""


def solved(method="ekf", count=4, late=False, rest=""):
    """The solve, with or without two late measurements of the other projection."""
    seen = 10 * np.cos(ANGLES) + 0.02 * np.random.default_rng(4).standard_normal(STEPS)
    other = 10 * np.sin(ANGLES[-2:]) if late else np.full(2, 1e4)
    k = np.arange(STEPS)
    text = TEXT.format(method=method, count=count, rest=rest)
    return mbm.loads(text).solve(data={"seen": {"k": k, "x": seen}, "late": {"k": k[-2:], "s": other}})


@pytest.mark.parametrize("method", ["ekf", "iterated-ekf", "truncated-ekf"])
def test_the_mirrored_pose_is_followed_too_and_its_rate(method):
    found = json.loads(solved(method).to_json())["solves"][0]
    first, second = found["hypotheses"]
    assert found["estimates"]["theta"]["hypotheses"][:4] == [1] * 4
    assert found["estimates"]["theta"]["hypotheses"][-1] == 2
    assert first["weight"] + second["weight"] == pytest.approx(1.0)
    assert first["weight"] == pytest.approx(0.5, abs=0.05)
    angles = sorted(each["estimates"]["theta"]["value"][0] for each in (first, second))
    # the two are mirror images, and one of them is right: 45 degrees
    assert angles[0] == pytest.approx(-angles[1], abs=1e-3)
    assert angles[1] == pytest.approx(ANGLES[-1], abs=4 * first["estimates"]["theta"]["sigma"][0])
    rates = sorted(each["estimates"]["theta.rate"]["value"][0] for each in (first, second))
    assert rates[0] == pytest.approx(-rates[1], abs=1e-3)


def said(found):
    return [each.message for each in found.diagnostics if each.code.name == "another-hypothesis"]


def test_a_choice_that_the_rows_leave_is_told():
    found = solved()
    (message,) = said(found)
    first, second = (each.weight for each in found.hypotheses)
    assert f"its weight is {second:.4g}, that of the one reported {first:.4g}" in message
    assert not said(solved(count=1))


@pytest.mark.parametrize("method", ["ekf", "iterated-ekf"])
@pytest.mark.parametrize("start", [-5, -4, -3, 3, 4, 5])
def test_what_rows_do_not_tell_apart_is_on_the_side_of_the_prior(method, start):
    text = f"""(problem side (data seen external) (states :over k (theta :init {start}deg :sigma 4deg))
      (dynamics (random-walk theta :sigma 0.2deg)) (observe seen (= x (* 10 (cos theta))) :sigma 0.05)
      (solve :method {method} :hypotheses 4))"""
    x = 10 * np.cos(np.radians(6)) + 0.05 * np.random.default_rng(start + 5).standard_normal(6)
    (found,) = mbm.loads(text).solve(data={"seen": {"k": np.arange(6.0), "x": x}}).solves
    assert len(found.hypotheses) == 2
    assert np.all(np.sign(found["theta"].value) == np.sign(start))
    assert said(found)


def test_later_rows_decide():
    found = solved(late=True)
    assert not said(found)
    assert found["theta"].value[-1] == pytest.approx(ANGLES[-1], abs=0.01)
    (only,) = json.loads(found.to_json())["solves"][0]["hypotheses"]
    assert only["weight"] == 1.0


@pytest.mark.parametrize(("limit", "sign"), [("(<= theta 3deg)", -1), ("(>= theta -33deg)", 1)])
def test_what_violates_a_constraint_is_dropped(limit, sign):
    found = solved("truncated-ekf", rest=f"(constraints {limit})")
    assert np.sign(found["theta"].value[-1]) == sign
    assert abs(found["theta"].value[-1]) == pytest.approx(ANGLES[-1], abs=0.01)


def test_one_hypothesis_is_what_it_was():
    alone = solved(count=1)
    assert "hypotheses" not in json.loads(alone.to_json())["solves"][0]
    assert abs(alone["theta"].value[-1]) == pytest.approx(ANGLES[-1], abs=0.01)


def test_straight_rows_have_no_mirror():
    text = TEXT.replace("(* 10 (cos theta))", "theta").replace("(* 10 (sin theta))", "theta")
    text = text.format(method="ekf", count=4, rest="")
    k = np.arange(STEPS)
    data = {"seen": {"k": k, "x": ANGLES}, "late": {"k": k[-2:], "s": ANGLES[-2:]}}
    found = json.loads(mbm.loads(text).solve(data=data).to_json())["solves"][0]
    assert len(found["hypotheses"]) == 1
    assert "hypotheses" not in found["estimates"]["theta"]


def test_a_smoother_follows_one_only():
    with pytest.raises(mbm.MbmError) as caught:
        solved("smoother")
    assert caught.value.diagnostics[0].code.name == "not-for-filters"
