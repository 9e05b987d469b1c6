"""Hock and Schittkowski's problems in every way that mbm has: the printed optimum, and SciPy's to the last digits."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from tests.oracles.hs_problems import PROBLEMS
from tests.oracles.kinds import Kind
from tests.oracles.outside import faults, outside
from tests.oracles.paths import CLAUSES, PATHS, applies, generated_c, generated_python, together

PRINTED = 2e-8
"""Of the optimum: nine or ten digits are printed (HS77 and HS79: eight)."""

FEW = ("numpy", "exact", "for-each")
"""Ways of a usual run: the general path, sequential quadratic programming, and machine code."""

MANY, ENDS = 9, slice(None, None, 8)
"""Equal data sets, from so many on they are solved together: what is said of the first and of the last is read."""

KNOWN = {
    # x2 runs off to where it does not matter: the minimum that Ipopt finds has no x2.
    ("HS57", "ipopt"),
    # A bound and a constraint that say the same at the optimum: it stops 1.5e-5 standard deviations before it.
    ("HS30", "exact"),
}


@functools.cache
def kind_of(name: str) -> Kind:
    """The same object for all answers: SciPy is asked once."""
    return PROBLEMS[name].kind()


def judged(name: str, answer) -> list[str]:
    """What is wrong with an answer."""
    problem, kind = PROBLEMS[name], kind_of(name)
    cost = float((kind.residuals(answer.values) ** 2).sum())
    least, x = min(problem.minima, key=lambda minimum: abs(minimum[0] - cost))
    if abs(cost - least) > PRINTED * (1 + least):
        return [f"cost {cost:.12g} for {least:.12g}"]
    if np.abs(answer.values - x).max() > 2e-6 * (1 + np.abs(x).max()):
        return [f"{answer.values} for {x}"]
    if problem.flat:
        return [] if answer.status != "infeasible" else [answer.status]
    tables = kind.draw(None)
    wanted = outside(kind, tables, np.array(x, dtype=float))
    assert wanted.objective == pytest.approx(least, rel=PRINTED, abs=PRINTED)
    return faults(kind, tables, answer, wanted)


@pytest.mark.parametrize("name", PROBLEMS)
def test_formulas_have_the_printed_optimum(name):
    problem, kind = PROBLEMS[name], kind_of(name)
    for least, x in problem.minima:
        point = np.array(x, dtype=float)
        # Solutions are printed to six digits at least; the sum is flat about them but along what holds.
        assert (kind.residuals(point) ** 2).sum() == pytest.approx(least, rel=2e-5, abs=2e-5)
        assert kind.equal is None or np.abs(kind.equal(point)).max() < 1e-4
        assert kind.below is None or kind.below(point).max() < 1e-4


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_published_optimum_is_reached(name):
    assert wrong_on(name, FEW) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_published_optimum_is_reached_in_every_way(name):
    assert wrong_on(name, [path for path in PATHS if path not in FEW]) == []


def wrong_on(name: str, paths) -> list[str]:
    """What is wrong on these paths."""
    kind = kind_of(name)
    found = []
    for path in paths:
        if applies(path, kind) and (name, path) not in KNOWN:
            if path in CLAUSES:
                answers = together(kind, [kind.draw(None)] * MANY, CLAUSES[path], ENDS)
            else:
                answers = PATHS[path](kind, [kind.draw(None)])
            found += [f"{path}: {fault}" for answer in answers for fault in judged(name, answer)]
    return found


@pytest.mark.parametrize(("name", "path"), sorted(KNOWN))
def test_what_is_known_to_be_wrong_still_is(name, path):
    """So that what mends it is told to take it off the list."""
    kind = kind_of(name)
    (answer,) = PATHS[path](kind, [kind.draw(None)])
    assert judged(name, answer)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in PROBLEMS if not PROBLEMS[name].flat])
@pytest.mark.parametrize("make", [generated_c, generated_python])
def test_generated_solvers_reach_the_published_optimum(name, make, tmp_path):
    kind = kind_of(name)
    for answer in make(kind, [kind.draw(None)] * 2, tmp_path):
        assert judged(name, answer) == []
