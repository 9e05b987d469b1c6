"""What expressions hold in the place of aggregates, as the unknowns that the later stages take them for."""

from __future__ import annotations

from mbm.problem.aggregates import Aggregate
from mbm.problem.types import Unknown, UnknownKind


def stand_in(aggregate: Aggregate) -> Unknown:
    """A number without start and bounds: it is computed from the rows, never estimated."""
    return Unknown(
        name=aggregate.name,
        kind=UnknownKind.REAL,
        shape=(),
        family=None,
        start=None,
        lower=None,
        upper=None,
        start_lower=None,
        start_upper=None,
        fixed=None,
        unit=None,
        doc="",
        span=aggregate.span,
    )
