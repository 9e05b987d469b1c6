"""Silhouettes, and what is read off them (LANGUAGE §§6, 11).

A silhouette is the region of the image that a shape covers. Its outline changes its make-up with the unknowns: what is
read off it is no formula but a call, which mbm answers itself (`mbm.kernels.outlines`).
"""

from __future__ import annotations

from collections.abc import Callable

from mbm.expression.nodes import Apply, Expression, Operation, Outlined, Output
from mbm.language import faults
from mbm.language.scope import vector
from mbm.language.values import Array, Builtin, Call, CameraValue, Placeable, Transform, Value, describe
from mbm.language.vocabulary.lines import image_of
from mbm.shapes.figures import Drawn, drawn
from mbm.shapes.types import Shape
from mbm.text.types import Keyword, MbmError, Span
from mbm.values import dataclass

EXTREME_USAGE = "(extreme S :left|:right|:top|:bottom)"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Silhouette(Placeable):
    """The region that a shape covers in an image; ``upward``: the second coordinate grows upwards (axes paper and opengl)."""

    drawn: Drawn
    upward: bool
    span: Span

    @property
    def kind(self) -> str:
        """How messages call it."""
        return "a silhouette"

    @property
    def dimension(self) -> int:
        """It lies in an image."""
        return 2

    def moved(self, by: Transform) -> Value:
        """A silhouette stays where it is seen.

        Raises:
            MbmError: always.

        """
        raise MbmError(
            faults.bad_form(self.span, f"`{by.head}` moves no silhouette", "(silhouette camera (trans v SHAPE))")
        )

    def as_point(self) -> Array | None:
        """A silhouette is no point."""
        return None


def _silhouette(call: Call) -> Value:
    camera, shape = call.arguments
    if not isinstance(camera, CameraValue):
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a camera", describe(camera)))
    return silhouette(call, camera, shape, call.forms[1].span)


def silhouette(call: Call, camera: CameraValue | None, shape: Value, span: Span) -> Silhouette:
    """That of a shape in the camera's frame; without a camera in the paper's projection.

    Raises:
        MbmError: no shape, or one without faces.

    """
    if not isinstance(shape, Shape):
        raise MbmError(faults.wrong_kind(span, "a shape", describe(shape)))
    upward = camera is None or camera.axes != "opencv"
    return Silhouette(drawn=drawn(call, camera, shape), upward=upward, span=call.span)


def _project(call: Call) -> Value:
    camera, thing = call.arguments
    if isinstance(thing, Shape):
        return _silhouette(call)
    return image_of(call, camera, thing, call.forms[1].span)


def _perse(call: Call) -> Value:
    thing = call.arguments[0]
    if isinstance(thing, Shape):
        return silhouette(call, None, thing, call.forms[0].span)
    return image_of(call, None, thing, call.forms[0].span)


def _measure(call: Call, function: str, size: int, point: tuple[Expression, ...] = ()) -> Value:
    """The numbers that a function gives for a silhouette, the first argument."""
    found = call.arguments[0]
    if not isinstance(found, Silhouette):
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a silhouette", describe(found)))
    outlined = Outlined(function=function, size=size, figure=found.drawn.figure, form=call.form, span=call.span)
    arguments = (*found.drawn.numbers, *point)
    call.evaluator.budget.make(len(arguments), call.form)
    made = tuple(
        Apply(Operation.EXTERNAL, arguments, span=call.span, output=Output(outlined, index)) for index in range(size)
    )
    return made[0] if size == 1 else Array((size,), made)


def _read_off(function: str, size: int) -> Callable[[Call], Value]:
    return lambda call: _measure(call, function, size)


def _extreme(call: Call) -> Value:
    found, side = call.arguments
    upward = isinstance(found, Silhouette) and found.upward
    top, bottom = ("greatest v", "least v") if upward else ("least v", "greatest v")
    sides = {"left": "left", "right": "right", "top": top, "bottom": bottom}
    if not isinstance(side, Keyword) or side.name not in sides:
        raise MbmError(faults.bad_form(call.forms[1].span, "no side of a silhouette", EXTREME_USAGE))
    return _measure(call, f"extreme {sides[side.name]}", 2)


def _contour_distance(call: Call) -> Value:
    return _measure(call, "contour-distance", 1, vector(call.arguments[1], call.forms[1].span, 2).elements)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("perse", "(perse X)", "The paper's projection (k0 y/x, k1 z/x) of a point, a line, a curve or a shape; k0, k1 are the problem's, else 1.", 1, 1, _perse),
    Builtin("project", "(project camera X)", "The image of X in the camera's frame: [u v] of a point, an image line of a line, a curve of a curve, a silhouette of a shape.", 2, 2, _project),
    Builtin("silhouette", "(silhouette camera SHAPE)", "The region of the image that a shape in the camera's frame covers.", 2, 2, _silhouette),
    Builtin("area", "(area S)", "The area of a silhouette, without its holes.", 1, 1, _read_off("area", 1)),
    Builtin("centroid", "(centroid S)", "The centroid [u v] of a silhouette, without its holes.", 1, 1, _read_off("centroid", 2)),
    Builtin("perimeter", "(perimeter S)", "The length of a silhouette's contours, those of its holes included.", 1, 1, _read_off("perimeter", 1)),
    Builtin("extent", "(extent S)", "[width height] of a silhouette.", 1, 1, _read_off("extent", 2)),
    Builtin("extreme", EXTREME_USAGE, "The outermost point [u v] of a silhouette: left and right by u, top and bottom as a viewer sees them.", 2, 2, _extreme),
    Builtin("contour-distance", "(contour-distance S p)", "Signed distance of an image point from the contours of a silhouette, positive outside.", 2, 2, _contour_distance),
)  # fmt: skip
"""What this stage adds to the functions of images."""
