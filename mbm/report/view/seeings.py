"""Equations that compare what was measured in images with what a camera sees: of points, lines, outlines and curves."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.nodes import Apply, Expression, Outlined, Parameter
from mbm.language.curves import CurveValue
from mbm.language.values import CameraValue
from mbm.problem.types import BlockRole, Equation, Problem
from mbm.shapes.types import Shape
from mbm.values import dataclass

Ends = tuple[tuple[Expression, ...], tuple[Expression, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """A point (3) in the frame of its camera, and its ``image`` (2).

    ``lens`` is the image of any point: of that whose coordinates are the parameters ``ray``. ``camera`` is None for the
    paper's projection; ``body`` is the shape that the point is a feature of, in the frame of the camera.
    ``family``: no camera is known, the image is made by functions of the user, of the points of this family; ``point``
    is then in the frame of those, and ``lens`` the image itself.
    """

    image: tuple[Expression, ...]
    point: tuple[Expression, ...]
    camera: CameraValue | None
    body: Shape | None
    ray: tuple[Parameter, ...]
    lens: tuple[Expression, ...]
    family: str | None = None

    @property
    def axes(self) -> str:
        """Those of the camera, as `AXES` has them."""
        if self.camera is not None:
            return self.camera.axes
        return "paper" if self.family is None else "opencv"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """An equation of an observation: ``block`` and ``case`` are its numbers in the problem, ``output`` that of its
    first component among those of the case.
    """

    block: int
    case: int
    output: int


def equations_of(problem: Problem) -> Iterator[tuple[Compared, Equation]]:
    """All equations of observations, and where they stand."""
    for i, block in enumerate(problem.blocks):
        for k, case in enumerate(block.cases if block.role is BlockRole.OBSERVATION else ()):
            output = 0
            for equation in case.equations:
                yield Compared(block=i, case=k, output=output), equation
                output += len(equation.components)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seeing:
    """An equation ``at`` its place, that compares a measured image point with ``sight``.

    ``sign``: its value is ``sign`` times (model − measured).
    """

    at: Compared
    sign: float
    sight: Sight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourSeeing:
    """An equation ``at`` its place, that is about the ``distance`` of an image point from the outline of a body.

    The arguments of the distance are numbers of the outline and,
    last, the point. ``upward``: the second coordinate of the image grows upwards.
    """

    at: Compared
    distance: Apply
    outlined: Outlined
    upward: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveSeeing:
    """An equation that is about the distance of an image ``point`` (2) from the image of a ``curve``.

    ``distance`` is that of any point: of that whose coordinates are the parameters ``place``. The others are as in
    `ContourSeeing`.
    """

    at: Compared
    point: tuple[Expression, ...]
    curve: CurveValue
    distance: Expression
    place: tuple[Parameter, ...]
    upward: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineSeeing:
    """An equation that compares a ``measured`` image line (α, ρ) with that through two image points, its ``ends``.

    The others are as in `ContourSeeing`.
    """

    at: Compared
    measured: tuple[Expression, Expression]
    ends: Ends
    upward: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """The equations of a problem that compare images of points and lines, and those about distances from outlines and
    curves in images.

    ``library``: models of the package that no definition hides.
    """

    seeings: tuple[Seeing, ...]
    lines: tuple[LineSeeing, ...]
    contours: tuple[ContourSeeing, ...]
    curves: tuple[CurveSeeing, ...]
    library: frozenset[str]
