"""The equations that a walk is reported with: in those, states that do not change have a value at each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.layout import layout
from mbm.equations.types import Floats
from mbm.estimation.sequences.places import Places, spread_places
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import Sequence
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Told:
    """Equations, what binds them, and where the numbers of a step stand among theirs."""

    equations: Assembled
    binder: Binder
    places: Places


def told(known: Told, sequence: Sequence, kernels: KernelSet, starts: Mapping[str, Floats]) -> Told:
    """The equations that a walk over the ``known`` ones is reported with.

    A filter knows another value of a constant after each step. A smoother of all steps knows one, as ``batch`` does.
    """
    if not sequence.static or sequence.estimator.whole:
        return known
    binder = known.binder
    spread = layout(binder.problem, binder.tables, starts, spread=True)
    places = spread_places(known.equations, blank(replace(binder, layout=spread), kernels), known.places)
    # What does not vary is certain at every step, not at the first alone.
    fixed = spread.fixed.copy()
    fixed[np.delete(places.coordinates, places.free, axis=1)] = True
    found = replace(binder, layout=replace(spread, fixed=fixed))
    return Told(equations=blank(found, kernels), binder=found, places=places)
