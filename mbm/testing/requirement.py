"""What the suites raise: plain text that says which promise was not kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


class NotConformingError(AssertionError):
    """A plug-in does not keep what its contract promises."""


def require(kept: bool, subject: str, promise: str) -> None:
    """Go on if the promise was kept.

    Raises:
        NotConformingError: it was not.

    """
    if not kept:
        raise NotConformingError(f"{subject}: {promise}")


def require_close(found: ArrayLike, wanted: ArrayLike, tolerance: float, subject: str, promise: str) -> None:
    """Go on if all numbers agree to ``tolerance · max(1, |wanted|)``; NaN agrees with NaN, infinity with itself.

    Raises:
        NotConformingError: shapes or numbers differ; the text names the first place and both numbers.

    """
    one, two = np.asarray(found, dtype=np.float64), np.asarray(wanted, dtype=np.float64)
    require(one.shape == two.shape, subject, f"{promise}: the shape is {one.shape}, not {two.shape}")
    with np.errstate(invalid="ignore"):
        near = np.abs(one - two) <= tolerance * np.maximum(1.0, np.abs(two))
    agree = near | (one == two) | (np.isnan(one) & np.isnan(two))
    if not agree.all():
        place = tuple(int(i) for i in np.argwhere(~agree)[0])
        raise NotConformingError(f"{subject}: {promise}: at {place} it is {one[place]!r}, not {two[place]!r}")
