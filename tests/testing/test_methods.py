"""The conformance suite of methods: ours conform, and methods with one fault each are refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mbm.equations.types import Equations, Floats, Minimum, Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.testing.methods import check_method, samples
from mbm.testing.requirement import NotConformingError

METHODS = (Method.AUTO, Method.MARQUARDT, Method.DOGLEG, Method.GAUSS_NEWTON)
"""Those that go on from any start."""


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.value)
def test_our_methods_conform(method: Method) -> None:
    def found(equations: Equations, start: Floats, most: int) -> Minimum:
        return minimise(equations, start, Settings(method=method, max_iterations=most))

    check_method(method.value, found)


def test_the_known_answers_are_minima() -> None:
    """Stationary inside the bounds; at a bound the descent leads outwards."""
    for sample in samples():
        gradient = sample.jacobian(sample.answer).T @ sample.residuals(sample.answer)
        inside = sample.answer < sample.upper
        assert np.abs(gradient[inside]).max(initial=0.0) < 1e-12
        assert (gradient[~inside] < 0).all()


def marquardt(equations: Equations, start: Floats, most: int) -> Minimum:
    return minimise(equations, start, Settings(method=Method.MARQUARDT, max_iterations=most))


def never_done(equations: Equations, start: Floats, most: int) -> Minimum:
    return replace(marquardt(equations, start, min(most, 3)), reason=Reason.MAX_ITERATIONS)


def done_too_soon(equations: Equations, start: Floats, most: int) -> Minimum:
    return replace(marquardt(equations, start, 0), reason=Reason.SMALL_OFFSET)


def resigning(equations: Equations, start: Floats, most: int) -> Minimum:
    return replace(marquardt(equations, start, most), reason=Reason.FLAT)


def climbing(equations: Equations, start: Floats, most: int) -> Minimum:
    found = marquardt(equations, start, most)
    return replace(found, cost=found.cost + 1e9 * most)


def leaving(equations: Equations, start: Floats, most: int) -> Minimum:
    found = marquardt(equations, start, most)
    return replace(found, point=found.point + 1e-3)


@pytest.mark.parametrize(
    ("method", "promise"),
    [
        (never_done, "it finishes within"),
        (done_too_soon, "the minimum is where it is known to be"),
        (resigning, "it converges; it stopped because"),
        (climbing, "the cost never grows"),
        (leaving, "never leaves the bounds|where it is known to be"),
    ],
)
def test_a_fault_is_told(method: Callable[[Equations, Floats, int], Minimum], promise: str) -> None:
    with pytest.raises(NotConformingError, match=promise):
        check_method("faulty", method)
