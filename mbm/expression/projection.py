"""How a point of space came into an image: what a projection was made of, kept beside the numbers that it gives."""

from __future__ import annotations

from fractions import Fraction

from mbm.expression.algebra import negate
from mbm.expression.nodes import Expression, Number
from mbm.text.types import Span
from mbm.values import dataclass

AXES = ("opencv", "paper", "opengl")

NEAR = Number(Fraction(1, 10))
"""What is nearer to a camera is not seen: in m, or what the problem measures lengths in."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """The image of ``point`` (3, in the frame of the camera, its axes), by the numbers that the camera has there."""

    camera: str
    model: str
    axes: str
    focal: tuple[Expression, Expression]
    center: tuple[Expression, Expression]
    distortion: tuple[Expression, ...]
    point: tuple[Expression, ...]

    @property
    def in_pixels(self) -> bool:
        """Whether image coordinates are counted in pixels; the paper's are in whatever its focal lengths are in."""
        return self.axes != "paper"

    @property
    def depth(self) -> Expression:
        """How far in front of the camera the point is."""
        return by_axes(self.point, self.axes)[2]


def by_axes(point: tuple[Expression, ...], axes: str, span: Span | None = None) -> tuple[Expression, ...]:
    """What of a point in the frame of a camera goes with the first coordinate of the image, with the second, and ahead.

    The second coordinate grows downwards with ``opencv``, else upwards; the first to the left with ``paper``.
    """
    x, y, z = point
    return {"opencv": (x, y, z), "paper": (y, z, x), "opengl": (x, y, negate(z, span))}[axes]
