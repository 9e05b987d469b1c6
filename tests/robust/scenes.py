"""Problems with outliers, and what consensus finds in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import mbm
from mbm.equations.assembly import Assembled
from mbm.estimation.consensus.agreeing import agreed
from mbm.estimation.consensus.types import Agreed, Asked, observed
from mbm.estimation.consensus.units import Units, units_of
from mbm.estimation.search.multistart import starting_points
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.solver.decisions import STATED


@dataclass(frozen=True)
class Found:
    """What agrees in one data set, with the equations and their units."""

    agreed: Agreed
    equations: Assembled
    units: Units


def consensus(text, data=None, *, backend="auto", seed=None) -> Found:
    """What the units of all observations agree on by the ``:robust`` of the problem."""
    compiled = mbm.loads(text).compile(data=data, backend=backend)
    problem = compiled.elaborated.problem
    settings = settings_of(problem.request)
    settings = settings if seed is None else replace(settings, seed=seed)
    equations, _ = assemble(problem, compiled.kernels, compiled.elaborated.tables, {}, compiled.cache)

    starts = np.stack([each.point for each in starting_points(equations, settings, None)])
    asked = Asked(problem=problem, settings=settings, consensus=settings.robust, ruled=observed)
    found = agreed(asked, equations, starts)
    units = units_of(equations, problem, starts[0], observed)
    return Found(agreed=found, equations=equations, units=units)


def scalar_units(count, *, unknown=False):
    """Units of one component each, with stated noise or with one unknown factor."""
    return Units(
        of_row=np.arange(count),
        components=np.ones(count, dtype=np.int64),
        group=np.full(count, 0 if unknown else STATED),
        number=np.arange(count),
        rounding=np.full(count, 1e-28),
    )


CEILING = np.array([[x, y, 2.7] for x in np.linspace(1.0, 2.5, 6) for y in np.linspace(0.7, 2.8, 8)])
"""48 receivers in a ceiling, in m."""
