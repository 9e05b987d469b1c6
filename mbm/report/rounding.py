"""Round numbers for marks and factors of pictures."""

from __future__ import annotations

import math


def round_step(about: float) -> float:
    """The number 1, 2 or 5 times a power of ten that is next to ``about``, which is above 0."""
    power = 10.0 ** math.floor(math.log10(about))
    ratio = about / power
    return power * (1 if ratio < 1.5 else 2 if ratio < 3.5 else 5 if ratio < 7.5 else 10)
