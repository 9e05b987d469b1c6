"""Which equations compare an image with what a camera sees: noted while a problem is elaborated with traced words.

The equations themselves hold formulas only. Words that move points and project them note what they were given: the
point in the frame of its camera, the camera, and the shape that the point is a feature of, moved as the point was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TypeVar

from mbm.expression.nodes import Apply, Expression, Operation, Outlined, Parameter
from mbm.language.curves import CurveValue
from mbm.language.scope import vector
from mbm.language.values import (
    Array,
    Builtin,
    Call,
    Callable_,
    CameraValue,
    ImageLineValue,
    Placeable,
    Value,
    Vocabulary,
)
from mbm.language.vocabulary.cameras import project_point
from mbm.problem.types import Problem
from mbm.report.view.seeings import ContourSeeing, CurveSeeing, Ends, LineSeeing, Seeing, Seen, Sight, equations_of
from mbm.shapes.silhouettes import Silhouette
from mbm.shapes.types import Shape
from mbm.shapes.vocabulary import FeatureFunction
from mbm.text.types import Form, MbmError

MOVING = ("trans", "rotate", "scale", "transform")
SEEING = ("project", "perse", "vertex-on-image")
MEASURING, NEARING = "contour-distance", "curve-distance"
THROUGH, LINING = "line-through", ("line-on-image", "image-line")

T = TypeVar("T")
Feature = Callable[[Call, Shape, tuple[Form, ...]], Value]


class Trace:
    """What was noted in one elaboration."""

    def __init__(self) -> None:
        self.sights: list[Sight] = []
        self._distances: list[tuple[Value, partial[ContourSeeing]]] = []
        self._images: dict[int, tuple[CurveValue, bool]] = {}
        self._lines: dict[int, tuple[ImageLineValue, Ends | None, bool]] = {}
        self._nearest: list[tuple[Value, partial[CurveSeeing]]] = []
        self._shapes: dict[int, tuple[Array, Shape]] = {}

    def vocabulary(self, words: Vocabulary) -> Vocabulary:
        """The same words, which note what they are given."""
        functions: dict[str, Callable_] = dict(words.functions)
        traced: dict[str, Callable[[Callable[[Call], Value]], Callable[[Call], Value]]] = {
            **dict.fromkeys(MOVING, self._moving),
            **dict.fromkeys(SEEING, self._seeing),
            MEASURING: self._measuring,
            NEARING: self._nearing,
            **dict.fromkeys(LINING, partial(self._lining, ends=_images_of_ends)),
            THROUGH: partial(self._lining, ends=_points_of),
            "feature": self._picking,
        }
        for name, function in words.functions.items():
            if isinstance(function, Builtin) and name in traced:
                functions[name] = replace(function, function=traced[name](function.function))
            elif isinstance(function, FeatureFunction):
                functions[name] = replace(function, function=self._naming(function.function))
        return replace(words, functions=MappingProxyType(functions))

    def seen(self, problem: Problem, implied: Iterator[Seeing], library: frozenset[str]) -> Seen:
        """All that was noted of ``problem``, as elaborated with the traced words; ``implied`` if no images are."""
        return Seen(
            seeings=tuple(self.seeings(problem)) or tuple(implied),
            lines=tuple(self.lines(problem)),
            contours=tuple(self.contours(problem)),
            curves=tuple(self.curves(problem)),
            library=library,
        )

    def seeings(self, problem: Problem) -> Iterator[Seeing]:
        """The equations of ``problem``, as elaborated with the traced words, that compare images of points."""
        of_image = {id(s.image[0]): s for s in self.sights}
        for at, equation in equations_of(problem):
            found = _compared(equation.components, of_image)
            if found is not None:
                yield Seeing(at=at, sign=found[1], sight=found[0])

    def lines(self, problem: Problem) -> Iterator[LineSeeing]:
        """Those that compare image lines, of which one is through known points."""
        for at, equation in equations_of(problem):
            pair = [self._lines[id(rho)] for rho in _offsets(equation.components) if id(rho) in self._lines]
            for (_, ends, upward), (measured, *_) in (pair, pair[::-1]) if len(pair) == 2 else ():
                if ends is not None:
                    yield LineSeeing(at=at, measured=(measured.alpha, measured.rho), ends=ends, upward=upward)
                    break

    def contours(self, problem: Problem) -> Iterator[ContourSeeing]:
        """Those that are about the distance from an outline."""
        return _about(problem, self._distances)

    def curves(self, problem: Problem) -> Iterator[CurveSeeing]:
        """Those that are about the distance from the image of a curve."""
        return _about(problem, self._nearest)

    def _shape_of(self, value: Value) -> Shape | None:
        noted = self._shapes.get(id(value))
        return None if noted is None else noted[1]

    def _note(self, value: Value, shape: Shape) -> Value:
        if isinstance(value, Array):
            self._shapes[id(value)] = (value, shape)
        return value

    def _measuring(self, function: Callable[[Call], Value]) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            found, seen = function(call), call.arguments[0]
            outlined = found.output.external if isinstance(found, Apply) and found.output is not None else None
            if isinstance(found, Apply) and isinstance(outlined, Outlined) and isinstance(seen, Silhouette):
                made = partial(ContourSeeing, distance=found, outlined=outlined, upward=seen.upward)
                self._distances.append((found, made))
            return found

        return traced

    def _nearing(self, function: Callable[[Call], Value]) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            found = function(call)
            curve, upward = self._images.get(id(call.arguments[0]), (None, False))
            if curve is not None:
                place = tuple(Parameter(name, call.span) for name in "uv")
                distance = function(replace(call, arguments=(curve, Array((2,), place))))
                point = vector(call.arguments[1], call.forms[1].span, 2).elements
                if isinstance(distance, Apply):
                    made = partial(CurveSeeing, point=point, curve=curve, distance=distance, place=place, upward=upward)
                    self._nearest.append((found, made))
            return found

        return traced

    def _picking(self, function: Callable[[Call], Value]) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            found = function(call)
            shape = call.evaluator.arrived(call.arguments[0], call.form, call.scope)
            return self._note(found, shape) if isinstance(shape, Shape) else found

        return traced

    def _naming(self, function: Feature) -> Feature:
        return lambda call, shape, forms: self._note(function(call, shape, forms), shape)

    def _moving(self, function: Callable[[Call], Value]) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            found, shape = function(call), self._shape_of(call.arguments[1])
            if shape is not None:
                there = function(replace(call, arguments=(call.arguments[0], shape)))
                if isinstance(there, Shape):
                    self._note(found, there)
            return found

        return traced

    def _seeing(self, function: Callable[[Call], Value]) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            image = function(call)
            if isinstance(image, Array) and image.shape == (2,):
                self._see(call, function, image)
            elif isinstance(image, ImageLineValue):
                self._lines[id(image.rho)] = image, _images_of_ends(call), _upward(call)
            elif isinstance(image, CurveValue):
                self._images[id(image)] = image, _upward(call)
            return image

        return traced

    def _lining(
        self, function: Callable[[Call], Value], ends: Callable[[Call], Ends | None]
    ) -> Callable[[Call], Value]:
        def traced(call: Call) -> Value:
            found = function(call)
            if isinstance(found, ImageLineValue):
                self._lines[id(found.rho)] = (
                    found,
                    ends(call),
                    isinstance(call.arguments[0], CameraValue) and _upward(call),
                )
            return found

        return traced

    def _see(self, call: Call, function: Callable[[Call], Value], image: Array) -> None:
        thing = call.arguments[-1]
        try:
            point = vector(thing, call.forms[-1].span, 3).elements
        except MbmError:  # a feature that is no vector
            return
        ray = tuple(Parameter(name, call.span) for name in "xyz")
        lens = function(replace(call, arguments=(*call.arguments[:-1], Array((3,), ray))))
        first = call.arguments[0]
        if isinstance(lens, Array):
            self.sights.append(
                Sight(
                    image=image.elements,
                    point=point,
                    camera=first if isinstance(first, CameraValue) else None,
                    body=self._shape_of(thing),
                    ray=ray,
                    lens=lens.elements,
                )
            )


def _upward(call: Call) -> bool:
    """Whether the second coordinate grows upwards in the image of what is projected."""
    camera = call.arguments[0]
    return not isinstance(camera, CameraValue) or camera.axes != "opencv"


def _images_of_ends(call: Call) -> Ends | None:
    """The images of the ends of a line that is projected; None where none is."""
    camera, line = call.arguments[0], call.arguments[-1]
    ends = line.ends() if isinstance(line, Placeable) else None
    if ends is None or len(ends) != 2:
        return None
    first, second = (
        project_point(call, camera if isinstance(camera, CameraValue) else None, end.elements).elements for end in ends
    )
    return first, second


def _points_of(call: Call) -> Ends:
    """The two image points that a line is laid through."""
    first, second = (vector(p, form.span, 2).elements for p, form in zip(call.arguments, call.forms, strict=True))
    return first, second


def _offsets(components: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """ρ of the model and of the measured line where two components may be the difference of lines, as in
    `line_difference`: the model's, with its sign turned where directions are opposite, less the measured one.
    """
    difference = components[-1]
    if len(components) != 2 or not isinstance(difference, Apply) or difference.operation is not Operation.SUBTRACT:
        return ()
    model, measured = difference.arguments
    return (model.arguments[2], measured) if isinstance(model, Apply) and model.operation is Operation.IF else ()


def _about(problem: Problem, noted: Sequence[tuple[Value, Callable[..., T]]]) -> Iterator[T]:
    """What is made of the equations of one component that are about a distance that was ``noted``."""
    known = {id(distance): made for distance, made in noted}
    for at, equation in equations_of(problem):
        sides = (id(_side(equation.components[0], place)) for place in (0, 1) if len(equation.components) == 1)
        made = next((known[side] for side in sides if side in known), None)
        if made is not None:
            yield made(at=at)


def _compared(components: tuple[Expression, ...], of_image: dict[int, Sight]) -> tuple[Sight, float] | None:
    """The sight whose image makes two components, and the sign that it has in them; None if there is none."""
    if len(components) != 2:
        return None
    for sign, place in ((1.0, 0), (-1.0, 1)):
        sides = [_side(each, place) for each in components]
        sight = of_image.get(id(sides[0]))
        if sight is not None and sides[1] is sight.image[1]:
            return sight, sign
    return None


def _side(component: Expression, place: int) -> Expression:
    """One side of a difference; what is no difference counts as its first side."""
    if isinstance(component, Apply) and component.operation is Operation.SUBTRACT:
        return component.arguments[place]
    return component
