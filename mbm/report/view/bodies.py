"""The round bodies of the library as surfaces of revolution: what their features alone do not draw."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from mbm.report.types import Floats
from mbm.report.view.types import Stroke
from mbm.values import dataclass

TURN = 73
"""Points around an axis, the first again at the end."""

ARC = 37
"""Points of a meridian that is bent."""

Profile = tuple[Floats, ...]
"""Stretches (k, 2) of radius and height, each beginning where the one before it ends, with a rim between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """The smooth patches (n, m, 3) of a body, and the rims where they meet."""

    patches: tuple[Floats, ...]
    rims: tuple[Stroke, ...]


def round_body(name: str, arguments: Mapping[str, float]) -> Body | None:
    """The surface of a round body of the library; None if the model called ``name`` has plane faces only."""
    make = _PROFILES.get(name)
    if make is None:
        return None
    numbers = list(arguments.values())
    profile, stretch = make(*numbers), np.ones(3)
    if name == "ellipsoid":
        profile, stretch = _PROFILES["sphere"](1.0), np.array(numbers)
    patches = tuple(_revolved(stretch_of) * stretch for stretch_of in profile)
    corners = [stretch_of[0] for stretch_of in profile] + [profile[-1][-1]]
    rims = _distinct(corner for corner in corners if corner[0] > 0.0 and len(profile[0]) < ARC)
    return Body(patches=patches, rims=tuple(Stroke(points=_revolved(c[None])[0]) for c in rims))


def _distinct(corners: Iterable[Floats]) -> list[Floats]:
    found: list[Floats] = []
    for corner in corners:
        if not any(np.array_equal(corner, other) for other in found):
            found.append(corner)
    return found


def _revolved(profile: Floats) -> Floats:
    """The grid (k, TURN, 3) of a profile (k, 2) turned about z."""
    angles = np.linspace(0.0, 2 * np.pi, TURN)
    rho, z = profile[:, :1], profile[:, 1:]
    return np.stack([rho * np.cos(angles), rho * np.sin(angles), np.broadcast_to(z, (len(z), TURN))], axis=2)


def _corners(*points: tuple[float, float]) -> Profile:
    """Straight stretches from point to point, each cut in four."""
    share = np.linspace(0.0, 1.0, 5)[:, None]
    ends = [np.array(p, dtype=float) for p in points]
    return tuple(a + share * (b - a) for a, b in pairwise(ends))


def _arc(middle: float, radius: float, first: float, last: float) -> Profile:
    angles = np.linspace(first, last, ARC)
    return (np.stack([middle + radius * np.cos(angles), radius * np.sin(angles)], axis=1),)


_PROFILES: Mapping[str, Callable[..., Profile]] = MappingProxyType(
    {
        "disk": lambda r: _corners((0, 0), (r, 0)),
        "cylinder": lambda r, h: _corners((0, 0), (r, 0), (r, h), (0, h)),
        "cone": lambda r, h: _corners((0, 0), (r, 0), (0, h)),
        "frustum": lambda r1, r2, h: _corners((0, 0), (r1, 0), (r2, h), (0, h)),
        "tube": lambda R, r, h: _corners((r, 0), (R, 0), (R, h), (r, h), (r, 0)),
        "sphere": lambda r: _arc(0.0, r, -np.pi / 2, np.pi / 2),
        "ellipsoid": lambda a, b, c: _arc(0.0, a, -np.pi / 2, np.pi / 2),
        "torus": lambda R, r: _arc(R, r, 0.0, 2 * np.pi),
    }
)
