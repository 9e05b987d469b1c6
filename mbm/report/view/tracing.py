"""Which equations compare an image with what a camera sees: noted while a problem is elaborated with traced words.

The equations themselves hold formulas only. Words that move points and project them note what they were given: the
point in the frame of its camera, the camera, and the shape that the point is a feature of, moved as the point was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import MappingProxyType

from mbm.expression.nodes import Apply, Expression, Operation, Parameter
from mbm.language.coerce import vector
from mbm.language.values import Array, Builtin, Call, Callable_, CameraValue, Value, Vocabulary
from mbm.problem.types import BlockRole, Problem
from mbm.shapes.types import Shape
from mbm.shapes.vocabulary import FeatureFunction
from mbm.text.types import Form, MbmError
from mbm.values import dataclass

MOVING = ("trans", "rotate", "scale", "transform")
SEEING = ("project", "perse", "vertex-on-image")

Feature = Callable[[Call, Shape, tuple[Form, ...]], Value]


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
        """``opencv`` or ``paper``."""
        if self.camera is not None:
            return self.camera.axes
        return "paper" if self.family is None else "opencv"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seeing:
    """An equation that compares a measured image point with ``sight``.

    ``block`` and ``case`` are its numbers in the problem, ``output`` that of its first component among those of the
    case; ``sign``: its value is ``sign`` times (model − measured).
    """

    block: int
    case: int
    output: int
    sign: float
    sight: Sight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """The equations of a problem that compare images; ``library``: models of the package that no definition hides."""

    seeings: tuple[Seeing, ...]
    library: frozenset[str]


class Trace:
    """What was noted in one elaboration."""

    def __init__(self) -> None:
        self.sights: list[Sight] = []
        self._shapes: dict[int, tuple[Array, Shape]] = {}

    def vocabulary(self, words: Vocabulary) -> Vocabulary:
        """The same words, which note what they are given."""
        functions: dict[str, Callable_] = dict(words.functions)
        for name, function in words.functions.items():
            if isinstance(function, Builtin) and name in MOVING:
                functions[name] = replace(function, function=self._moving(function.function))
            elif isinstance(function, Builtin) and name in SEEING:
                functions[name] = replace(function, function=self._seeing(function.function))
            elif isinstance(function, Builtin) and name == "feature":
                functions[name] = replace(function, function=self._picking(function.function))
            elif isinstance(function, FeatureFunction):
                functions[name] = replace(function, function=self._naming(function.function))
        return replace(words, functions=MappingProxyType(functions))

    def seeings(self, problem: Problem) -> Iterator[Seeing]:
        """The equations of ``problem``, as elaborated with the traced words, that compare images of points."""
        of_image = {id(s.image[0]): s for s in self.sights}
        for i, block in enumerate(problem.blocks):
            if block.role is not BlockRole.OBSERVATION:
                continue
            for k, case in enumerate(block.cases):
                output = 0
                for equation in case.equations:
                    found = _compared(equation.components, of_image)
                    if found is not None:
                        yield Seeing(block=i, case=k, output=output, sign=found[1], sight=found[0])
                    output += len(equation.components)

    def _shape_of(self, value: Value) -> Shape | None:
        noted = self._shapes.get(id(value))
        return None if noted is None else noted[1]

    def _note(self, value: Value, shape: Shape) -> Value:
        if isinstance(value, Array):
            self._shapes[id(value)] = (value, shape)
        return value

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
            return image

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
