"""The StRD sets from both starts in every way that mbm has: certified estimates, deviations, sums of squares.

With default settings they are tried by `tests/evidence/test_nist_problems.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimation.nist import digits
from tests.estimation.nist_typed import TYPED
from tests.evidence.nist_problems import FORMULAS, LOGARITHMIC
from tests.oracles.kinds import Kind
from tests.oracles.paths import PATHS, generated_c, generated_python

SETS = {reference.name: reference for reference in TYPED}
WAYS = ("casadi", "numpy", "compiled", "for-each", "window", "estimator")
QUICK = ("numpy", "for-each")
COPIES = 9
"""Data sets of which `for-each` and `window` have so many: from there on they are solved together."""


def kind_of(name: str, start: int) -> Kind:
    """A set from one of its starts."""
    reference = SETS[name]
    begun = tuple(float(v) for v in reference.starts[start])
    x = {"x1": reference.x[0], "x2": reference.x[1]} if name in LOGARITHMIC else {"x": reference.x}
    y = np.exp(reference.y) if name in LOGARITHMIC else reference.y
    measured = "(log y)" if name in LOGARITHMIC else "y"
    return Kind(
        unknowns={f"b{i}": f":init {value!r}" for i, value in enumerate(begun, start=1)},
        clauses=f"(observe d (= {measured} {FORMULAS[name]}) :sigma unknown)",
        draw=lambda _: {"d": {**x, "y": y}},
        residuals=lambda b, _: reference.model(b, reference.x) - reference.y,
        start=begun,
        given=("d.y",),
    )


def wrong(name: str, answer) -> list[str]:
    """What is wrong with an answer."""
    reference = SETS[name]
    found = [] if answer.status == "converged" else [answer.status]
    # Eleven digits are certified; eight leave room for the conditioning of the worst sets.
    if digits(answer.values, reference.certified) < 8:
        found.append(f"{answer.values} for {reference.certified}")
    # Lanczos1 fits to the last digit of its data: its residuals, and so its deviations, are rounding.
    exact = name == "Lanczos1"
    if digits(answer.sigmas, reference.deviations) < (2.5 if exact else 6):
        found.append(f"σ {answer.sigmas} for {reference.deviations}")
    if answer.dof not in (None, len(reference.y) - len(reference.certified)):
        found.append(f"{answer.dof} degrees of freedom")
    off = 0.0 if answer.cost is None else abs(answer.cost / reference.sum_of_squares - 1)
    return found if exact or off < 1e-8 else [*found, f"cost {answer.cost} for {reference.sum_of_squares}"]


@pytest.mark.parametrize("start", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("way", [way if way in QUICK else pytest.param(way, marks=pytest.mark.slow) for way in WAYS])
@pytest.mark.parametrize("name", SETS)
def test_certified_digits(name, way, start):
    kind = kind_of(name, start)
    answers = PATHS[way](kind, [kind.draw(None)] * (COPIES if way in ("for-each", "window") else 2))
    assert [wrong(name, answer) for answer in answers] == [[] for _ in answers]


@pytest.mark.slow
@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("make", [generated_c, generated_python])
@pytest.mark.parametrize("name", SETS)
def test_generated_solvers(name, make, start, tmp_path):
    kind = kind_of(name, start)
    answers = make(kind, [kind.draw(None)] * 2, tmp_path)
    assert [wrong(name, answer) for answer in answers] == [[] for _ in answers]
