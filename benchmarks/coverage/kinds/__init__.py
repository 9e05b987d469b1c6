"""All kinds, by name."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.coverage.judging import Kind
from benchmarks.coverage.kinds import (
    assays,
    chemistry,
    constants,
    constrained,
    curved,
    field,
    geometric,
    laboratory,
    linear,
    noises,
    robust,
    survey,
    workshop,
)

KINDS: Mapping[str, Kind] = {
    **linear.KINDS,
    **noises.KINDS,
    **curved.KINDS,
    **geometric.KINDS,
    **constrained.KINDS,
    **constants.KINDS,
    **robust.KINDS,
    **laboratory.KINDS,
    **assays.KINDS,
    **chemistry.KINDS,
    **field.KINDS,
    **workshop.KINDS,
    **survey.KINDS,
}
