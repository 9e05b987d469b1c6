"""Functions of the restricted Python, element by element: each element has what the function gives for it alone."""

from __future__ import annotations

from math import exp, fabs, sqrt

import numpy as np
import pytest

from mbm.machine.elementwise import elementwise
from mbm.machine.words import Integer, Real


def halved(x: Real) -> Real:
    """A function that another one calls."""
    return 0.5 * x if x > 1.0 else x


def branching(kind: Integer, x: Real, y: Real) -> Real:
    """Branches on an integer and on numbers, one within the other, with names that change on the way."""
    z = x
    if kind == 1:
        if not (x < 0.0 or y < 0.0):
            z = sqrt(x) - y
        else:
            if x < y and y > -3.0:
                return fabs(x)
            z += 2.0
        return halved(z)
    return max(exp(-x), min(y, 2.0)) + float(kind)


def first_alone(x: Real, y: Real) -> Real:
    """What does not depend on its second argument."""
    return halved(x)


def looping(x: Real) -> Real:
    """What cannot be taken element by element."""
    for _ in range(3):
        x = x * 2.0
    return x


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_elements_are_those_of_the_function(kind):
    generator = np.random.default_rng(kind)
    x, y = generator.normal(size=(2, 5, 40)) * 3.0
    found = elementwise(branching)(kind, x, y)
    assert found.shape == x.shape
    wanted = [branching(kind, a, b) for a, b in zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)]
    # The same operations; NumPy's exponential may differ from that of C by a rounding.
    np.testing.assert_allclose(found.ravel(), wanted, rtol=1e-15)


def test_what_does_not_depend_on_the_elements_has_their_shape():
    np.testing.assert_array_equal(elementwise(branching)(3, np.full(4, np.inf), 1.0), np.full(4, 4.0))


@pytest.mark.parametrize(("x", "y"), [(1.5, np.arange(4.0)), (np.arange(3.0)[:, None], np.arange(4.0))])
def test_arguments_are_broadcast(x, y):
    """Also where the first argument is not of the shape that all have together."""
    wanted = np.vectorize(lambda a, b: branching(2, float(a), float(b)))(x, y)
    found = elementwise(branching)(2, x, y)
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, rtol=1e-15)


def test_what_depends_on_one_argument_has_the_shape_of_all():
    found = elementwise(first_alone)(1.5, np.arange(4.0))
    np.testing.assert_array_equal(found, np.full(4, 0.75))


def test_loops_are_refused():
    with pytest.raises(TypeError):
        elementwise(looping)(np.ones(3))
