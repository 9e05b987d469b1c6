"""Shapes as a camera sees them: the sheets of a `Figure`, and the expressions for its numbers.

What does not vary over a sheet (sizes, elements of a rotation, focal lengths, images of vertexes) becomes a number of
the figure, so that derivatives by unknowns follow from those by these numbers.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import field

from mbm.expression.algebra import ONE, add, multiply, subtract
from mbm.expression.derivative import substituted
from mbm.expression.nets import Net, SeenNet
from mbm.expression.nodes import Apply, Constant, Expression, Figure, Leaf, Number, Parameter, Sheet, postorder
from mbm.expression.projection import by_axes
from mbm.language import faults as language_faults
from mbm.language.curves import Point
from mbm.language.values import Array, Call, CameraValue
from mbm.language.vocabulary.cameras import project_point
from mbm.shapes import faults
from mbm.shapes.features import Place, carried, contents, root
from mbm.shapes.model import Identities
from mbm.shapes.types import ModelCall, Node, Part, Patch, Projection, Shape, SmoothFace, Step, Surface, SweptSide
from mbm.text.types import MbmError
from mbm.values import dataclass

_NUMBERS_PER_SHEET = 400
"""Numbers that are made for a sheet, about."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """A figure and the expressions (size,) for its numbers."""

    figure: Figure
    numbers: tuple[Expression, ...] = field(repr=False)


def drawn(call: Call, camera: CameraValue | None, shape: Shape) -> Drawn:
    """What a camera sees of a shape; without a camera the paper's projection.

    Raises:
        MbmError: no-faces, nothing in the shape covers anything; or it is projected already.

    """
    drawing = _Drawing(call, camera)
    for node, steps in _faces(call, root(shape)):
        if any(isinstance(step, Projection) for step in steps):
            raise MbmError(faults.already_projected(call.span))
        if isinstance(node, Surface) and node.net is not None:
            drawing.add_net(node.net, steps)
        elif isinstance(node, Surface):
            drawing.add_surface(node, steps)
        elif isinstance(node, SweptSide):
            drawing.add_side(node, steps)
        elif isinstance(node, SmoothFace):
            drawing.add_patch(node.patch, steps)
    if not drawing.faces and not drawing.patches and not drawing.nets:
        raise MbmError(faults.no_faces(call.span, shape.kind))
    return drawing.finished()


def _faces(call: Call, place: Place) -> Iterator[tuple[Node, tuple[Step, ...]]]:
    """What covers something, in all parts; planes of a model that has smooth faces are features of these."""
    found = tuple(contents(call, place))
    smooth = {id(face) for node, _ in found if isinstance(node, ModelCall) for face in _smooth_ones(node)}
    for node, steps in found:
        if isinstance(node, Part):
            yield from _faces(call, Place(nodes=node.children, steps=steps, owner=place.owner))
        elif id(node) not in smooth:
            yield node, steps


def _smooth_ones(model: ModelCall) -> tuple[Node, ...]:
    """The surfaces of a model whose true faces are written beside them."""
    if not any(isinstance(child, SmoothFace) for child in model.children):
        return ()
    return tuple(child for child in model.children if isinstance(child, Surface))


class _Drawing:
    """A figure as it grows. Local to one."""

    def __init__(self, call: Call, camera: CameraValue | None) -> None:
        self._call, self._camera = call, camera
        self._identities = Identities()
        self._numbers: dict[Hashable, int] = {}
        self._expressions: list[Expression] = []
        self._sheets: dict[Sheet, int] = {}
        self._lines: dict[tuple[int, tuple[int, ...]], int] = {}
        self._line = _bent_line(call, camera, ()) if _bends(camera) else None
        self.faces: list[tuple[tuple[int, bool], ...]] = []
        self.patches: list[tuple[int, tuple[int, ...]]] = []
        self.nets: list[SeenNet] = []
        self._ends: list[tuple[tuple[int, int, bool], ...]] = []

    def add_surface(self, surface: Surface, steps: tuple[Step, ...]) -> None:
        """The planes of a surface."""
        corners = {n for face in surface.planes.values() for n in face}
        self._call.evaluator.budget.make(_NUMBERS_PER_SHEET * len(corners), self._call.form)
        places = {n: self._vertex(carried(surface.vertexes[n], steps, self._call)) for n in sorted(corners)}
        for face in surface.planes.values():
            pairs = zip(face, (*face[1:], face[0]), strict=True)
            self.faces.append(tuple(self._edge(places[a], places[b], along=a < b) for a, b in pairs))

    def _vertex(self, point: Array) -> tuple[int, ...]:
        """The places of what a line takes of one of its ends: the image and the depth, or, if lines bend, the point."""
        own = point.elements if self._line is not None else self._image(point.elements)
        return tuple(self._number(each) for each in own)

    def _edge(self, a: tuple[int, ...], b: tuple[int, ...], *, along: bool) -> tuple[int, bool]:
        first, second = (a, b) if along else (b, a)
        sheet, others = self._line if self._line is not None else (_STRAIGHT, ())
        places = (*first, *second, *(self._number(each) for each in others))
        return self._lines.setdefault((self._sheet(sheet), places), len(self._lines)), along

    def add_net(self, net: Net, steps: tuple[Step, ...]) -> None:
        """A mesh: what all its points have in common is said once."""
        if not len(net.first):
            return
        call, span = self._call, self._call.span
        call.evaluator.budget.make(_NUMBERS_PER_SHEET, call.form)
        axes = tuple(Parameter(name, span) for name in ("x", "y", "z"))
        point, of_point = _sheet(self._image(carried(Array((3,), axes), steps, call).elements), (), axes)
        line, of_line = _bent_line(call, self._camera, steps) if self._line is not None else (_STRAIGHT, ())
        self.nets.append(
            SeenNet(
                net=net,
                point=self._sheet(point),
                of_point=tuple(self._number(each) for each in of_point),
                line=self._sheet(line),
                of_line=tuple(self._number(each) for each in of_line),
            )
        )

    def add_side(self, side: SweptSide, steps: tuple[Step, ...]) -> None:
        """The patches of a swept side, and the flat ends that they bound."""
        first = len(self.patches)
        for patch in side.patches:
            self.add_patch(patch, steps)
        self._ends.extend(tuple((first + n, k, along) for n, k, along in loop) for loop in side.ends)

    def add_patch(self, patch: Patch, steps: tuple[Step, ...]) -> None:
        """A smooth face."""
        call, span = self._call, self._call.span
        call.evaluator.budget.make(_NUMBERS_PER_SHEET, call.form)
        shares = Parameter("s", span), Parameter("t", span)
        ways: dict[Leaf, Expression] = {
            parameter: add(first, multiply(share, subtract(last, first, span), span), span)
            for share, (parameter, first, last) in zip(shares, (patch.first, patch.second), strict=True)
        }
        inside = substituted(carried(Array((3,), patch.point), steps, call).elements, ways)
        sheet, others = _sheet(self._image(inside), shares)
        self.patches.append((self._sheet(sheet), tuple(self._number(each) for each in others)))

    def _image(self, point: Point) -> Point:
        """u, v and the depth of a point in the camera's frame."""
        return _seen(self._call, self._camera, point)

    def _number(self, expression: Expression) -> int:
        place = self._numbers.setdefault(self._identities.key(expression), len(self._numbers))
        if place == len(self._expressions):
            self._expressions.append(expression)
        return place

    def _sheet(self, sheet: Sheet) -> int:
        return self._sheets.setdefault(sheet, len(self._sheets))

    def finished(self) -> Drawn:
        """All of it."""
        figure = Figure(
            size=len(self._expressions),
            sheets=tuple(self._sheets),
            lines=tuple(self._lines),
            faces=tuple(self.faces),
            patches=tuple(self.patches),
            ends=tuple(self._ends),
            nets=tuple(self.nets),
        )
        return Drawn(figure=figure, numbers=tuple(self._expressions))


def _seen(call: Call, camera: CameraValue | None, point: Point) -> Point:
    depth: Expression = ONE
    if camera is None or camera.model == "pinhole":
        depth = by_axes(point, "paper" if camera is None else camera.axes, call.span)[2]
    return (*project_point(call, camera, point).elements, depth)


def _bends(camera: CameraValue | None) -> bool:
    """Whether images of straight lines are bent."""
    if camera is None or camera.model in ("weak-perspective", "orthographic"):
        return False
    coefficients = camera.distortion
    return camera.model == "fisheye" or any(not isinstance(k, Number) or k.value != 0 for k in coefficients)


def _bent_line(call: Call, camera: CameraValue | None, steps: tuple[Step, ...]) -> tuple[Sheet, tuple[Expression, ...]]:
    """The image of the line between two points inside ``steps``; behind these it takes what else that depends on."""
    span = call.span
    share, *ends = (Parameter(name, span) for name in ("s", "x", "y", "z", "x", "y", "z"))
    pairs = zip(ends[:3], ends[3:], strict=True)
    inside = tuple(add(a, multiply(share, subtract(b, a, span), span), span) for a, b in pairs)
    return _sheet(_seen(call, camera, carried(Array((3,), inside), steps, call).elements), (share,), tuple(ends))


def _sheet(
    point: Point, parameters: tuple[Parameter, ...], ends: tuple[Parameter, ...] = (), *, straight: bool = False
) -> tuple[Sheet, tuple[Expression, ...]]:
    """A sheet, and what it takes for its inputs behind ``ends``: the largest expressions that hold neither."""
    leaves = (*parameters, *ends)
    made: dict[int, Expression] = {id(leaf): Constant(str(k), 0.0) for k, leaf in enumerate(leaves)}
    others: list[Expression] = []
    for node in postorder(point):
        if isinstance(node, Apply) and any(id(a) in made for a in node.arguments):
            if node.output is not None:
                message = "a function in Python cannot bend the surface of a shape"
                raise MbmError(language_faults.bad_form(node.output.external.span, message, "(curve (s a b) [x y z])"))
            arguments = tuple(_taken(a, made, others, len(leaves)) for a in node.arguments)
            made[id(node)] = Apply(node.operation, arguments)
    found = tuple(_taken(each, made, others, len(leaves)) for each in point)
    sheet = Sheet(
        parameters=len(parameters),
        inputs=len(ends) + len(others),
        point=found,
        straight=straight,
        key=_text(found),
    )
    return sheet, tuple(others)


def _taken(node: Expression, made: dict[int, Expression], others: list[Expression], first: int) -> Expression:
    """What stands for a node in a sheet; ``made`` keeps inputs apart, under the complement of their address."""
    known = made.get(id(node)) or made.get(~id(node))
    if known is None and isinstance(node, Number):
        known = Number(node.value, node.dimension)
    if known is None:
        known = made[~id(node)] = Constant(str(first + len(others)), 0.0)
        others.append(node)
    return known


def _text(point: Point) -> str:
    """What two sheets share if and only if they are the same."""
    names: dict[int, str] = {}
    lines: list[str] = []
    for node in postorder(point):
        if isinstance(node, Apply):
            names[id(node)] = f"v{len(lines)}"
            lines.append(f"{node.operation.value} {' '.join(names[id(a)] for a in node.arguments)}")
        else:
            names[id(node)] = f"c{node.name}" if isinstance(node, Constant) else repr(node)
    return "; ".join([*lines, *(names[id(each)] for each in point)])


def _straight_line() -> Sheet:
    """The image of a straight line from the images and depths of its ends."""
    share, *ends = (Parameter(name) for name in ("s", "u", "v", "w", "u", "v", "w"))
    point = tuple(add(a, multiply(share, subtract(b, a))) for a, b in zip(ends[:3], ends[3:], strict=True))
    return _sheet(point, (share,), tuple(ends), straight=True)[0]


_STRAIGHT = _straight_line()
