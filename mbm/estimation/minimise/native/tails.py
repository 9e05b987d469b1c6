"""The upper tails of the χ² distribution for many values at once, by the compiled text of `mbm.solver.chi_square`."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.native.code import AnyCode, native_code

PRODUCTS = 100.0
"""Products for one tail, about."""


def solver_code(equations: Assembled) -> AnyCode:
    """The solver's text for equations."""
    return native_code(equations.groups[0].cache).solver


MANY_PRODUCTS = 1e8
"""Products from which the code of lags alone pays: it takes 0.09 s to make and saves 1 ns of each (measured)."""


def lags_code(equations: Assembled, basis: Floats) -> AnyCode:
    """What tells correlated residuals, whose directions are ``basis`` (…, m, k): the solver, or code for it alone."""
    alone = 2.0 * basis.size * basis.shape[-1] >= MANY_PRODUCTS
    return native_code(equations.groups[0].cache).lags if alone else solver_code(equations)


def chi_square_tails(code: AnyCode, values: Floats, dof: Indices) -> Floats:
    """P(χ² > value) (n,) of values (n,) with ``dof`` (n,) degrees of freedom, at least one."""
    tails = np.empty(len(values))
    code.expect(PRODUCTS * len(values))
    find = code.routine("chi_square_tails", int, *[object] * 3)
    find(len(values), np.ascontiguousarray(values), np.ascontiguousarray(dof, dtype=np.int64), tails)
    return tails
