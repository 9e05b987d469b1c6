"""What a request says of starts and windows."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.text.types import Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomStarts:
    """``:starts (random n :seed s)``; ``seed`` None: that of the solve."""

    count: int
    seed: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenStarts:
    """``:starts (given ((name value)…)…)``: each start names some unknowns, with one number per component in SI."""

    starts: tuple[Mapping[str, tuple[float, ...]], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """``(window COLUMN :length L :step S :min-rows n)``, in SI: rows with ``end − length < column ≤ end``."""

    column: str
    length: float
    step: float
    min_rows: int = 1
    span: Span
