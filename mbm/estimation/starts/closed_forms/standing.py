"""Where a camera stands before the unknown poses through which it sees, from how its images move with the points."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints
from mbm.estimation.starts.closed_forms.situation import AGREEMENT
from mbm.values import dataclass

PLACES = 24
"""Places that are looked at; six would tell all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eye:
    """An undistorted camera of focal length 1 (z forward) at the pose ``R``, ``t``: it sees R p + t."""

    R: Floats
    t: Floats

    def image(self, places: Floats) -> Floats:
        """Where places (…, 3) are seen (…, 2)."""
        p = places @ self.R.T + self.t
        with np.errstate(all="ignore"):
            return np.asarray(p[..., :2] / p[..., 2:])


def standing(moved: MovedPoints) -> Eye | None:
    """The camera that sees the places of all rows, if they have one: its residual is the image less what was measured.

    By the direct linear transformation (Abdel-Aziz and Karara 1971) of the first row, whose measured image shifts the
    principal point.
    """
    places = np.random.default_rng(0).uniform(-2.0, 2.0, size=(PLACES, 3))
    values = np.stack([moved.values(place) for place in places])
    known = np.isfinite(values).all(axis=(1, 2))
    if int(known.sum()) < PLACES // 2:
        return None
    places, values = places[known], values[known]
    P = _projection(places, values[:, 0])
    R, t = P[:, :3].copy(), P[:, 3].copy()
    shift = R[:2] @ R[2]
    R[:2] -= np.outer(shift, R[2])
    t[:2] -= shift * t[2]
    if not np.allclose(R @ R.T, np.eye(3), atol=AGREEMENT) or np.linalg.det(R) < 0:
        return None
    eye = Eye(R=R, t=t)
    shown = eye.image(places)[:, None]
    apart = values - values[:1] - (shown - shown[:1])
    size = 1.0 + np.abs(values).max() + np.abs(shown).max()
    return eye if bool(np.abs(apart).max() <= AGREEMENT * size) else None


def _projection(places: Floats, images: Floats) -> Floats:
    """P (3, 4) with ``images ~ P (places, 1)``, its third row of length 1, most places before the camera."""
    whole = np.column_stack([places, np.ones(len(places))])
    nothing = np.zeros_like(whole)
    lines = [np.hstack([whole, nothing, -images[:, :1] * whole]), np.hstack([nothing, whole, -images[:, 1:] * whole])]
    P = np.linalg.svd(np.vstack(lines))[2][-1].reshape(3, 4)
    P /= np.linalg.norm(P[2, :3]) * np.sign(np.linalg.det(P[:, :3]))
    return np.asarray(P)
