"""Problems solved twice, by kernels that the solver calls and by equations that are asked as a whole."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
import mbm.estimation.minimise.constrained.solve as constrained
import mbm.estimation.minimise.native.minimum as native
from mbm.estimation.minimise import minimise
from mbm.estimation.search import challenge, search
from mbm.estimation.solve import weighing

pytest.importorskip("llvmlite")


class Both:
    """Every minimum that a solve asks for, with and without kernels (None: not by these).

    Each with the equations, the start and the settings.
    """

    def __init__(self, monkeypatch):
        self.found = []
        ask = minimise.minimise

        def twice(equations, start, settings, place=None):
            begun = []

            def refused(of, at, *_):
                begun.extend([at] if of is equations else [])

            with monkeypatch.context() as without:
                without.setattr(native, "kernel_minimum", refused)
                without.setattr(constrained, "kernel_constrained_minimum", refused)
                general = ask(equations, start, settings, place)
            # Where measured values have errors, a better start is looked for first.
            at = begun[0] if begun else start
            own = constrained.kernel_constrained_minimum if equations.constraints else native.kernel_minimum
            self.found.append((equations, at, settings, general, own(equations, at, settings)))
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
