"""Random problems, solved in every way that mbm has, against SciPy: estimates, deviations, costs, freedom, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.oracles.catalogue import KINDS
from tests.oracles.kinds import SETS, drawn
from tests.oracles.outside import faults, outside
from tests.oracles.paths import PATHS, alone, applies, generated_c, generated_python

FEW = {"dogleg": 3, "gauss-newton": 3, "exact": 3, "ipopt": 3}
"""Data sets that these ways are asked in a usual run: each solve of theirs takes as long as ten of the others."""

HEAVY = (
    *("line", "lines of some rows", "bearings", "priors", "bounds", "bounds of a curve", "rotation"),
    *("an equation", "an equation and bounds", "inequalities"),
)
"""Kinds whose large problems, of more than 300 unknowns, take a second or more."""


def judged(name: str, path: str, sets, wanted) -> list[str]:
    """What is wrong with the answers of a path."""
    kind = KINDS[name]
    answers = PATHS[path](kind, sets)
    found = [(i, faults(kind, s, a, w)) for i, (s, a, w) in enumerate(zip(sets, answers, wanted, strict=True))]
    return [f"{path}, data set {i}: {fault}" for i, wrong in found for fault in wrong]


@pytest.mark.parametrize("name", KINDS)
def test_every_way_ends_where_scipy_does(name):
    kind = KINDS[name]
    sets = drawn(name, kind)
    wanted = [outside(kind, tables) for tables in sets]
    wrong = []
    for path in PATHS:
        if applies(path, kind) and not (path == "large" and name in HEAVY):
            few = FEW.get(path, SETS)
            wrong += judged(name, path, sets[:few], wanted[:few])
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_every_way_ends_where_scipy_does_many_times(name):
    kind = KINDS[name]
    sets = drawn(name, kind, 60, seed=2)
    wanted = [outside(kind, tables) for tables in sets]
    wrong = [w for path in PATHS if applies(path, kind) for w in judged(name, path, sets, wanted)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("make", [generated_c, generated_python])
def test_generated_solvers_end_where_scipy_does(name, make, tmp_path):
    kind = KINDS[name]
    sets = drawn(name, kind)
    answers = make(kind, sets, tmp_path)
    wrong = [faults(kind, s, a, outside(kind, s)) for s, a in zip(sets, answers, strict=True)]
    assert wrong == [[] for _ in sets]


@pytest.mark.parametrize("name", ["line", "ranges", "an equation", "two unknown noises", "rotation"])
def test_answers_that_are_wrong_are_told(name):
    """The comparison itself: what is off by a little more than it allows is found."""
    kind = KINDS[name]
    tables = drawn(name, kind, 1)[0]
    wanted = outside(kind, tables)
    (answer,) = alone(kind, [tables], "numpy")
    assert faults(kind, tables, answer, wanted) == []
    step = 1e-6 * wanted.sizes
    off = answer.values + step if kind.moved is None else kind.moved(answer.values, step)
    assert faults(kind, tables, replace(answer, values=off), wanted)
    assert faults(kind, tables, replace(answer, sigmas=answer.sigmas * (1 + 1e-5)), wanted)
    assert faults(kind, tables, replace(answer, cost=answer.cost * (1 + 1e-5)), wanted)
    assert faults(kind, tables, replace(answer, dof=answer.dof + 1), wanted)
    assert faults(kind, tables, replace(answer, status="not-converged"), wanted)
    if kind.groups:
        assert faults(kind, tables, replace(answer, factors=np.ones(len(kind.groups))), wanted)


def mirrored(generator):
    """A place from three stations that nearly stand in a line, and a start on the other side of it."""
    x, y = np.array([0.0, 5.0, 10.0]), generator.uniform(-0.2, 0.4, 3)
    place = generator.uniform([2, 1.5], [8, 4])
    return {"d": {"x": x, "y": y, "r": np.hypot(x - place[0], y - place[1]) + 0.05 * generator.normal(size=3)}}


MIRRORED = replace(
    KINDS["ranges"], unknowns={"p": "(vector 2) :init [4 -2]"}, start=(4, -2), draw=mirrored, many=True, scatters=False
)


def test_a_batch_ends_where_single_solves_do():
    sets = drawn("mirrored", MIRRORED, 20)
    single, batch = PATHS["native"](MIRRORED, sets), PATHS["for-each"](MIRRORED, sets)
    for one, other in zip(single, batch, strict=True):
        assert other.cost <= one.cost + 1e-6
