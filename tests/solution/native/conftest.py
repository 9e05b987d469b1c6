"""Problems solved twice, natively and by the general path."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
import mbm.solution.native.minimum as native
from mbm.solution import challenge, minimise, search, weighing

pytest.importorskip("llvmlite")


class Both:
    """Every minimum that a solve asks for, by the general path and natively: pairs with the equations and the start."""

    def __init__(self, monkeypatch):
        self.found = []
        own, ask = native.native_minimum, minimise.minimise

        def twice(equations, start, settings, place=None):
            asked = []

            def refused(of, begun, _):
                asked.extend([begun] if of is equations else [])

            with monkeypatch.context() as without:
                without.setattr(native, "native_minimum", refused)
                general = ask(equations, start, settings, place)
            # Where measured values have errors, the general path looks for a better start first.
            begun = asked[0] if asked else start
            self.found.append((equations, start, settings, general, own(equations, begun, settings)))
            return general

        for module in (search, weighing, challenge):
            monkeypatch.setattr(module, "minimise", twice)

    def of(self, text, **data):
        """The pairs of a problem's text."""
        self.found.clear()
        mbm.loads(text).solve(data=data or None, backend="native")
        assert self.found, "nothing was minimised"
        return list(self.found)


@pytest.fixture
def both(monkeypatch):
    return Both(monkeypatch)


def sigmas(minimum):
    """Standard deviations (n,) where the Jacobian has full rank; 0 for what a bound holds."""
    free = minimum.at_bound == 0
    found = np.zeros(len(free))
    inverse = np.linalg.pinv(minimum.jacobian[:, free])
    found[free] = np.sqrt(np.square(inverse).sum(axis=1))
    return found
