"""A plain solve of a pose graph with false loops says so, and names them; one of a sound graph says nothing."""

from __future__ import annotations

import re

import pytest

import mbm
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


def test_rejected_rows_are_no_contradiction():
    text, made = GRAPHS["plane"]
    data, _, _ = made(5)
    found = mbm.loads(text.format(robust="(gnc :quantile 99% :trust (= (- to from) 1))")).solve(data=data)
    assert (told(found.first), found.status) == ([], "ok")
