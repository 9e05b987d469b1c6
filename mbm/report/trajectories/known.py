"""Problems that leave nothing to estimate: both trajectories are compared as they are, or at a stated alignment."""

from __future__ import annotations

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import layout
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.report.trajectories.sides import Place


def known_place(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> Place | None:
    """Where a problem stands all of whose unknowns are fixed; None for any other, which has to be solved."""
    request = found.problem.request
    if any(u.fixed is None for u in found.problem.unknowns) or request.for_each or request.window is not None:
        return None
    starts = {name: np.asarray(given, dtype=np.float64) for name, given in found.starts.items()}
    places = layout(found.problem, found.tables, starts)
    if not bool(places.fixed.all()) or not bool(np.isfinite(places.start).all()):
        return None
    binder = Binder(problem=found.problem, layout=places, tables=found.tables, cache=cache)
    return Place(
        problem=found.problem,
        groups=binder.equations(kernels),
        layout=places,
        numbers=places.start,
        tables=found.tables,
    )
