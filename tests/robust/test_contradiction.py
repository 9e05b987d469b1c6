"""A plain solve of a pose graph with false loops says so, and names them; one of a sound graph says nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares

import mbm
from tests.estimation.closed_forms.test_false_loops import GRAPH, graph, off
from tests.robust import test_trust
from tests.robust.test_trust import GRAPHS


def solved(kind, false, seed=0, noise=None):
    text, made = GRAPHS[kind]
    text = text.format(robust="none")
    if noise is not None:
        text = re.sub(r":sigma \[[^\]]*\]", noise, text)
    data, _, true = made(false, seed)
    return mbm.loads(text).solve(data=data), data, true


def told(solve):
    return [d for d in solve.diagnostics if d.code.name == "contradicting-rows"]


FALSE = [
    *(("plane", false) for false in (1, 5, 20, 100)),
    ("space", 1),
    *(pytest.param("space", false, marks=pytest.mark.slow) for false in (5, 20, 100)),
]


@pytest.mark.parametrize(("kind", "false"), FALSE)
def test_false_loops_are_said(kind, false):
    result, _, true = solved(kind, false)
    (diagnostic,) = told(result.first)
    listed = [int(row) for row in re.findall(r"(\d+) \(", diagnostic.message.split(" contradict")[0])]
    assert listed[0] > true if false == 1 else sum(row > true for row in listed) >= len(listed) // 2
    assert (result.status, result.first.status.value) == ("attention", "not-converged")


@pytest.mark.parametrize("kind", GRAPHS)
@pytest.mark.parametrize("noise", [None, ":sigma unknown"])
def test_sound_graphs_say_nothing(kind, noise):
    """The limit is passed once in a million graphs."""
    if noise is not None:
        noise = (
            ":sigma (unknown [1deg 5cm 5cm])" if kind == "plane" else ":sigma (unknown [1deg 1deg 1deg 5cm 5cm 5cm])"
        )
    for seed in range(5 if kind == "plane" else 2):
        result, _, _ = solved(kind, 0, seed, noise)
        assert (told(result.first), result.status) == ([], "ok")


def test_a_false_loop_shows_although_the_noise_is_stated_far_too_large():
    """χ² is 1e-4 of its freedom without the loop: no test of the whole sees anything."""
    result, _, true = solved("plane", 1, noise=":sigma [100deg 5m 5m]")
    assert result.first.chi2_p > 0.99
    (diagnostic,) = told(result.first)
    assert re.match(rf"rows? {true + 1} ", diagnostic.message)


def test_without_the_worst_row_the_cost_falls_by_what_is_said():
    result, data, true = solved("plane", 1)
    (diagnostic,) = told(result.first)
    saved = float(re.search(r"\(([\d.e+]+)\)", diagnostic.message).group(1))
    few = {**data, "steps": {name: values[:true] for name, values in data["steps"].items()}}
    clean = mbm.loads(GRAPHS["plane"][0].format(robust="none")).solve(data=few).first
    fallen = result.first.cost - clean.cost
    # to first order, and without what is common to the three numbers of the row
    assert 0.5 * fallen < saved < 2.0 * fallen


def test_a_false_loop_that_a_loss_holds_back_is_an_outlier_and_no_more():
    """One of forty loops: the poses are as far off as without it, by least squares half as much again."""
    assert mbm.loads(GRAPH % ":loss huber)").solve(data=graph(1)[0]).status == "ok"
    clean = off(":loss huber)", 0)
    assert off(":loss huber)", 1) < 1.1 * clean
    assert off(")", 1) > 1.3 * clean


@pytest.mark.parametrize("false", [0, 5])
def test_false_loops_go_on_drawing_at_a_convex_loss(false):
    """Five of them draw the poses off by more than the noise does; there are none, and nothing is said."""
    text, made = GRAPHS["plane"]
    text = re.sub(r"(:sigma \[[^\]]*\])", r"\1 :loss huber", text.format(robust="none"))
    data, _, true = made(false, 0)
    found = mbm.loads(text).solve(data=data)
    assert (found.status == "ok") == (not false)
    said = [int(row) for each in told(found.first) for row in re.findall(r"(\d+) \(", each.message)]
    assert len(said) == false
    assert all(row > true for row in said)


def test_rejected_rows_are_no_contradiction():
    text, made = GRAPHS["plane"]
    data, _, _ = made(5)
    found = mbm.loads(text.format(robust="(gnc :quantile 99% :trust (= (- to from) 1))")).solve(data=data)
    assert (told(found.first), found.status) == ([], "ok")


LIMITED = """
(problem square
  (data places (table (id) (1) (2) (3) (4)) :key id)
  (data steps (table (from to x y a) (1 2 1 0 90deg) (2 3 1.02 0.01 91deg) (3 4 0.98 0 89deg) (4 1 1 0.02 90deg)))
  (unknowns (T (pose 2) :per places :fixed (= id 1)))
  (observe steps (= (pose2 x y a) (between (T from) (T to))) :sigma [0.01 0.02 0.02])
  (constraints (<= (distance (translation (T 2)) (translation (T 4))) 1 :name near)
               (>= ((translation (T 3)) 1) 1.2 :name far)))
"""


def test_rows_that_a_constraint_bends_do_not_contradict_one_another():
    """The minimum is that on both constraints, to a thousandth of the standard deviations; only these are named."""
    steps = np.array([[1, 0, 90], [1.02, 0.01, 91], [0.98, 0, 89], [1, 0.02, 90]]) * [1, 1, np.pi / 180]

    def misfits(x):
        poses = np.vstack([np.zeros(3), x.reshape(3, 3)])  # x y angle
        first, second = poses, np.roll(poses, -1, axis=0)
        turned = np.exp(-1j * first[:, 2]) * ((second - first)[:, :2] @ [1, 1j])
        apart = np.exp(-1j * steps[:, 2]) * (turned - steps[:, :2] @ [1, 1j])
        angle = np.angle(np.exp(1j * (second[:, 2] - first[:, 2] - steps[:, 2])))
        return np.concatenate([angle / 0.01, apart.real / 0.02, apart.imag / 0.02])

    def on_both(z):  # where both constraints hold as equations, which leaves seven numbers free
        (x, y, a, second_y, second_a, turn, third_a) = z
        return np.array([x, y, a, 1.2, second_y, second_a, x - np.cos(turn), y - np.sin(turn), third_a])

    start = np.array([1, 0, np.pi / 2, 1, np.pi, -np.pi / 4, -np.pi / 2])
    outside = least_squares(lambda z: misfits(on_both(z)), start, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    x = on_both(outside.x)
    slopes = approx_fprime(x, lambda x: misfits(x) @ misfits(x), 1e-7)
    across = np.array([x[0] - x[6], x[1] - x[7]])
    assert slopes[3] > 0 and slopes[[0, 1]] @ across < 0  # both are pushed against
    found = mbm.loads(LIMITED).solve().first
    assert found.status.value == "converged"
    assert found.cost == pytest.approx(2 * outside.cost, rel=1e-6)
    assert found["T"][3].translation == pytest.approx(x[3:5], abs=2e-5)
    assert told(found) == []
    held = [d.message for d in found.diagnostics if d.code.name == "active-constraint"]
    assert ["near" in held[0], "far" in held[1]] == [True, True]


@pytest.mark.parametrize(("false", "expected"), [(0, "converged"), (1, "not-converged")])
@pytest.mark.parametrize(("side", "method"), [(7, "penalty"), (12, "penalty-sparse")])
def test_a_false_loop_shows_beside_a_constraint_that_bends_all(side, method, false, expected, monkeypatch):
    monkeypatch.setattr(test_trust, "SIDE", side)
    text, made = GRAPHS["plane"]
    data, _, true = made(false, 0)
    limit = f"(constraints (<= (distance (translation (T 0)) (translation (T {side**2 - 1}))) 4))"
    found = mbm.loads(text.format(robust="none").replace("(observe", limit + "(observe")).solve(data=data).first
    assert found.method == method
    assert [d.code.name for d in found.diagnostics].count("active-constraint") == 1
    assert found.status.value == expected
    assert [int(re.search(r"\d+", d.message).group()) > true for d in told(found)] == [True] * false
