"""Turns from where a fit to contours ended: when they are tried, and what is counted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import mbm
from mbm.equations.types import Reason
from mbm.estimation.search import contours
from mbm.estimation.search.search import Found, Tally
from tests.estimation.silhouettes.test_starts import BOX, CAMERA, CORNERS, PLACE, columns, outline, random_rotation

ALONE = f"(problem p (data d external) {CAMERA} (unknowns (T (pose 3))) (observe d {BOX.format('T')} :sigma 0.1))"


def minimum(cost, residuals=()):
    return SimpleNamespace(
        cost=cost, residuals=np.asarray(residuals), point=np.zeros(1), reason=SimpleNamespace(converged=True)
    )


def found(cost, tally):
    return Found(minimum=minimum(cost), alternatives=(), tally=tally, origin="silhouettes", iterations=3, evaluations=4)


def tally(tried, converged, best_found):
    return Tally(tried=tried, converged=converged, best_found=best_found)


@pytest.mark.parametrize(
    ("first", "second", "best_found"),
    [
        ((5.0, tally(4, 4, 2)), (5.0, tally(6, 5, 3)), 5),  # both ended at the same minimum
        ((5.0, tally(4, 4, 2)), (1.0, tally(6, 5, 3)), 3),
        ((1.0, tally(4, 4, 2)), (5.0, tally(6, 5, 3)), 2),
        ((5.0, None), (5.0, tally(6, 5, 3)), 4),  # a single start counts as one
        ((5.0, None), (1.0, tally(6, 5, 3)), 3),
    ],
)
def test_all_starts_are_counted_once(monkeypatch, first, second, best_found):
    monkeypatch.setattr(contours, "ROUNDS", 1)
    monkeypatch.setattr(contours, "rounding_at", lambda *_: 0.0)
    monkeypatch.setattr(contours, "_astray", lambda *_: True)
    monkeypatch.setattr(contours, "_turned", lambda *_: np.zeros((6, 1)))
    monkeypatch.setattr(contours, "search", lambda *_: found(*second))
    settings = SimpleNamespace(starts=None, robust=None, stopped=lambda: False)
    answer = contours.with_turns(None, found(*first), settings, None, None)
    before = 1 if first[1] is None else first[1].tried
    assert answer.minimum.cost == min(first[0], second[0])
    assert (answer.tally.tried, answer.tally.best_found) == (before + 6, best_found)
    assert answer.tally.converged == before + 5
    assert (answer.iterations, answer.evaluations) == (6, 8)


def test_where_nothing_turns_nothing_is_counted_twice(monkeypatch):
    monkeypatch.setattr(contours, "_astray", lambda *_: True)
    monkeypatch.setattr(contours, "_turned", lambda *_: np.zeros((0, 1)))
    settings = SimpleNamespace(starts=None, robust=None, stopped=lambda: False)
    first = found(5.0, tally(4, 4, 2))
    assert contours.with_turns(None, first, settings, None, None) is first


WAVE = np.sin(np.arange(100) / 10)
NOISE = np.random.default_rng(0).normal(size=100)
FEW_FAR = np.where(np.arange(100) % 20 == 0, 15.0, 1.0) * NOISE


@pytest.mark.parametrize(
    ("residuals", "astray"),
    [
        ([NOISE], False),
        ([WAVE], True),
        ([FEW_FAR], True),
        ([NOISE, WAVE], True),
        ([NOISE, NOISE[:0]], False),
        ([NOISE, NOISE[:1]], False),
        ([1e-13 * WAVE], False),
    ],
)
def test_residuals_that_are_no_noise(monkeypatch, residuals, astray):
    """Of as many as tell it; those of exact data are rounding."""
    every = np.concatenate(residuals)
    monkeypatch.setattr(contours, "_along_contours", lambda *_: iter(residuals))
    monkeypatch.setattr(contours, "rounding_at", lambda *_: 1e-11)
    at = minimum(float(every @ every), every)
    assert contours._astray(SimpleNamespace(count=len(every)), at) == astray
    unfinished = SimpleNamespace(residuals=every, reason=Reason.MAX_ITERATIONS, cost=at.cost)
    assert not contours._astray(SimpleNamespace(count=len(every)), unfinished)


@pytest.mark.parametrize("rows", [0, 1])
def test_a_clause_of_hardly_any_rows_beside_a_contour_changes_nothing(rows):
    points = outline(CORNERS @ random_rotation(1).T + PLACE)
    text = f"""(problem p (data d external) (data e external) {CAMERA} (unknowns (T (pose 3)))
      (observe d {BOX.format("T")} :sigma 0.1) (observe e {BOX.format("T")} :sigma 0.1))"""
    both = mbm.loads(text).solve(data={"d": columns(points), "e": columns(points[:rows])}).first
    one = mbm.loads(ALONE).solve(data={"d": columns(points)}).first
    assert both.starts == one.starts
