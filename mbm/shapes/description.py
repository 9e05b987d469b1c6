"""Shape descriptions in a model's body → nodes of the shape (LANGUAGE §3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from mbm.expression.nodes import Apply, Column, Parameter, leaves
from mbm.language import faults as language_faults
from mbm.language.curves import CurveValue, in_space
from mbm.language.scope import LocalScope, condition, scalar, vector
from mbm.language.special import clauses_of_cond, cond_condition, let_scope
from mbm.language.values import (
    FORMS,
    SCALARS,
    Array,
    Call,
    Callable_,
    Evaluator,
    ListValue,
    Scope,
    StaticColumnNeeded,
    Transform,
    Value,
    describe,
)
from mbm.language.vocabulary.frames import rotation_transform, scale_transform, translation_transform
from mbm.language.vocabulary.rigid import pose
from mbm.shapes import faults
from mbm.shapes.features import pose_transform
from mbm.shapes.heads import CURVES, SWEEP_USAGES, fits, is_users
from mbm.shapes.motions import motion_of
from mbm.shapes.repetition import repetitions
from mbm.shapes.surface import clause, surface
from mbm.shapes.sweeps import points_of, profile_of, swept
from mbm.shapes.truth import truth
from mbm.shapes.types import (
    CurveNode,
    Group,
    ModelCall,
    ModelFunction,
    Moved,
    NamedPoint,
    Node,
    Part,
    Patch,
    Projection,
    Shape,
    SmoothFace,
    Surface,
    dimension_of,
)
from mbm.text.types import Bracket, Diagnostic, Form, MbmError, Sequence, Span, Symbol, Text
from mbm.values import dataclass

POINT_USAGE = "(point name (x y z))"
PART_USAGE = "(part name shape…)"
SURFACE = "(surface (s first last) (t first last) [x y z])"


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Where a description stands: ``names`` are those taken at this level of paths, ``part`` the part it is in."""

    evaluator: Evaluator
    scope: Scope
    names: dict[str, Span]
    part: str | None = None

    def inside(self, scope: Scope) -> Site:
        """The same level in another scope, inside a form that is no part."""
        return replace(self, scope=scope, part=None)

    def claim(self, name: str, span: Span) -> None:
        """Take a name at this level."""
        if name in self.names:
            raise MbmError(faults.duplicate_part(span, name, self.names[name]))
        self.names[name] = span

    def words(self) -> list[str]:
        """The models and transforms that are known here, for suggestions."""
        functions = self.evaluator.vocabulary.functions.items()
        return [*_WORDS, *(name for name, function in functions if isinstance(function, ModelFunction))]


def describe_shapes(forms: Iterable[Form], site: Site) -> tuple[Node, ...]:
    """The nodes of neighbouring shape descriptions; neighbouring clauses make one surface.

    Raises:
        MbmError: with a diagnostic at the innermost form that is wrong.
        StaticColumnNeeded: the value of a data column decides what the shape is.

    """
    nodes: list[Node] = []
    clauses: list[Sequence] = []
    for form in forms:
        kind = clause(form)
        if isinstance(form, Sequence) and kind is not None:
            if kind == "vertexes" and any(clause(c) == "vertexes" for c in clauses):
                nodes.append(_surface(clauses, site))
                clauses = []
            clauses.append(form)
            continue
        if clauses:
            nodes.append(_surface(clauses, site))
            clauses = []
        nodes.append(_describe(form, site))
    if clauses:
        nodes.append(_surface(clauses, site))
    return tuple(nodes)


def _surface(clauses: list[Sequence], site: Site) -> Surface:
    return surface(site.evaluator, tuple(clauses), site.scope)


def _describe(form: Form, site: Site) -> Node:
    if isinstance(form, Symbol):
        return _named(form, site)
    if not isinstance(form, Sequence) or form.bracket is not Bracket.ROUND or not form.items:
        raise MbmError(_no_shape(form, site))
    site.evaluator.budget.enter(form)
    try:
        head = form.items[0]
        if isinstance(head, Symbol):
            return _headed(head, form, site)
        if isinstance(head, Sequence):
            return _list_headed(head, form, site)
        raise MbmError(_no_shape(form, site))
    finally:
        site.evaluator.budget.leave()


def _headed(head: Symbol, form: Sequence, site: Site) -> Node:
    """A list with a name in front. A definition of the user comes before every other meaning of its name."""
    evaluator, name = site.evaluator, head.name
    function = evaluator.vocabulary.functions.get(name)
    if is_users(function):
        return _called(form, site)
    word = _WORDS.get(name)
    if word is not None:
        return word(form, site)
    if isinstance(function, ModelFunction) and fits(function, form, evaluator, site.scope):
        return _called(form, site)
    variable = site.scope.lookup(name, head.span)
    if isinstance(variable, Callable_):
        return _called(form, site)
    return _part(name, head.span, form.items[1:], form, site)


def _list_headed(head: Sequence, form: Sequence, site: Site) -> Node:
    """``((leg i) shape…)``, or the paper's ``((vertexes …) (lines …) (planes …))``."""
    if clause(head) is not None:
        clauses = [item for item in form.items if isinstance(item, Sequence)]
        if len(clauses) < len(form.items):
            raise MbmError(_no_shape(form, site))
        return _surface(clauses, site)
    name = site.evaluator.evaluate(head, site.scope)
    if not isinstance(name, Symbol | str):
        raise MbmError(_no_shape(form, site))
    return _part(name if isinstance(name, str) else name.name, head.span, form.items[1:], form, site)


def _named(form: Symbol, site: Site) -> Node:
    """A variable that holds a shape."""
    value = site.scope.lookup(form.name, form.span)
    if isinstance(value, Shape):
        return Group(children=(value.content,), span=form.span)
    if isinstance(value, CurveValue):
        return CurveNode(curve=in_space(value), span=form.span)
    raise MbmError(_no_shape(form, site))


def _no_shape(form: Form, site: Site) -> Diagnostic:
    got = "a number or a list of numbers"
    if isinstance(form, Symbol):
        value = site.scope.lookup(form.name, form.span)
        got = f"the name `{form.name}`" if value is None else f"{describe(value)} (`{form.name}`)"
    elif isinstance(form, Text):
        got = "a text"
    return faults.not_a_shape(form.span, got, part=site.part, words=site.words())


def _called(form: Sequence, site: Site) -> Node:
    """A model with its arguments, or a function that gives a shape or the form of one."""
    value = site.evaluator.evaluate(form, site.scope)
    if isinstance(value, Shape):
        is_model = isinstance(site.evaluator.vocabulary.functions.get(form.head or ""), ModelFunction)
        if is_model and isinstance(value.content, ModelCall):
            return value.content
        return Group(children=(value.content,), span=form.span)
    if isinstance(value, FORMS):
        return Group(children=describe_shapes((value,), site.inside(site.scope)), span=form.span)
    if isinstance(value, CurveValue):
        return CurveNode(curve=in_space(value), span=form.span)
    raise MbmError(faults.not_a_shape(form.span, describe(value)))


def _part(name: str, span: Span, contents: tuple[Form, ...], form: Sequence, site: Site) -> Part:
    if not contents:
        variable = site.scope.lookup(name, span)
        if isinstance(variable, ListValue):
            raise MbmError(faults.not_a_shape(form.span, describe(variable)))
        raise MbmError(faults.empty_part(form.span, name, site.words()))
    inner = Site(evaluator=site.evaluator, scope=site.scope, names={}, part=name)
    children = describe_shapes(contents, inner)
    site.claim(name, span)
    return Part(name=name, children=children, span=form.span)


def _named_part(form: Sequence, site: Site) -> Part:
    """``(part name shape…)``."""
    if len(form.items) < 3:
        raise MbmError(language_faults.bad_form(form.span, "this `part` is not complete", PART_USAGE))
    written = form.items[1]
    name: Value = written if isinstance(written, Symbol) else site.evaluator.evaluate(written, site.scope)
    if not isinstance(name, Symbol | str):
        raise MbmError(language_faults.bad_form(written.span, "the name of a part is wanted here", PART_USAGE))
    return _part(name if isinstance(name, str) else name.name, written.span, form.items[2:], form, site)


def _point(form: Sequence, site: Site) -> NamedPoint:
    if len(form.items) != 3 or not isinstance(form.items[1], Symbol):
        raise MbmError(language_faults.bad_form(form.span, "this `point` is not complete", POINT_USAGE))
    name, at = form.items[1], form.items[2]
    position = vector(site.evaluator.wanted(at, site.scope), at.span, 3)
    site.claim(name.name, name.span)
    return NamedPoint(name=name.name, position=position, span=form.span)


def _transform(form: Sequence, site: Site) -> Moved:
    """``(trans v shape…)`` and its kin."""
    head = form.head or ""
    if len(form.items) < 3:
        raise MbmError(language_faults.bad_form(form.span, f"this `{head}` is not complete", f"({head} by shape…)"))
    written = form.items[1]
    value = site.evaluator.wanted(written, site.scope)
    children = describe_shapes(form.items[2:], site.inside(site.scope))
    dimension = dimension_of(children[0]) if children else 3
    return Moved(
        step=_step(head, value, written.span, dimension), children=children, dimension=dimension, span=form.span
    )


def _step(head: str, value: Value, span: Span, dimension: int) -> Transform:
    """The transform that a head and its argument say, for points of ``dimension`` coordinates."""
    if head == "trans":
        return translation_transform(vector(value, span, dimension), span)
    if head == "scale":
        return scale_transform(value if isinstance(value, SCALARS) else vector(value, span, dimension), span, dimension)
    if head == "rotate":
        is_angles = isinstance(value, (ListValue, *SCALARS)) or (isinstance(value, Array) and not value.is_matrix)
        step = rotation_transform(vector(value, span, 3) if dimension == 3 and is_angles else value, span)
    else:
        step = pose_transform(pose(value, span), span)
    if step.matrix is not None and step.matrix.shape[1] != dimension:
        matrix = describe(step.matrix)
        raise MbmError(
            language_faults.length_clash(span, f"`{head}` by {matrix}", f"points of {dimension} coordinates")
        )
    return step


def _smooth_face(form: Sequence, site: Site) -> Node:
    """``(surface (s a b) (t c d) [x y z])``; without a vector at its end, a part of that name."""
    if len(form.items) != 4 or not isinstance(last := form.items[3], Sequence) or last.bracket is not Bracket.SQUARE:
        return _part("surface", form.items[0].span, form.items[1:], form, site)
    scope, ranges = site.scope, []
    for written in form.items[1:3]:
        items = written.items if isinstance(written, Sequence) else ()
        if len(items) != 3 or not isinstance(items[0], Symbol):
            raise MbmError(
                language_faults.bad_form(written.span, "the range of a parameter is (s first last)", SURFACE)
            )
        name, ends = items[0], items[1:]
        first, end = (scalar(site.evaluator.wanted(each, site.scope), each.span) for each in ends)
        ranges.append((Parameter(name.name, name.span), first, end))
        scope = LocalScope({name.name: ranges[-1][0]}, scope)
    point = vector(site.evaluator.wanted(last, scope), last.span, 3).elements
    return SmoothFace(patch=Patch(first=ranges[0], second=ranges[1], point=point), span=form.span)


def _perse(form: Sequence, site: Site) -> Moved:
    children = describe_shapes(form.items[1:], site.inside(site.scope))
    if not children:
        raise MbmError(language_faults.bad_form(form.span, "this `perse` is not complete", "(perse shape…)"))
    return Moved(step=Projection(form), children=children, dimension=2, span=form.span)


def _or(form: Sequence, site: Site) -> Group:
    children = describe_shapes(form.items[1:], site.inside(site.scope))
    if not children:
        raise MbmError(language_faults.bad_form(form.span, "this `or` is not complete", "(or shape…)"))
    return Group(children=children, span=form.span)


def _sweep(form: Sequence, site: Site) -> Group:
    """``(extrude PROFILE length)``, ``(revolve PROFILE angle)``, ``(sweep PROFILE PATH)``."""
    head = form.head or ""
    if len(form.items) != 3:
        raise MbmError(language_faults.wrong_arity(form.span, head, SWEEP_USAGES[head], len(form.items) - 1))
    profile_form, way_form = form.items[1:]
    inner = Site(evaluator=site.evaluator, scope=site.scope, names={})
    call = Call(site.evaluator, form, site.scope, (), form.items[1:])
    profile = profile_of(describe_shapes((profile_form,), inner), call, profile_form.span)
    motion = motion_of(head, site.evaluator.wanted(way_form, site.scope), way_form.span)
    points = points_of(profile, motion)
    site.evaluator.budget.check_length(points, form)
    site.evaluator.budget.make(3 * points, form)
    return swept(profile, motion, form.span)


def swept_shape(call: Call) -> Shape:
    """The same as a value."""
    site = Site(evaluator=call.evaluator, scope=call.scope, names={})
    return Shape(content=_sweep(call.form, site), span=call.span)


def _for(form: Sequence, site: Site) -> Group:
    children: list[Node] = []
    for scope in repetitions(site.evaluator, form, site.scope):
        children.extend(describe_shapes(form.items[2:], site.inside(scope)))
    return Group(children=tuple(children), span=form.span)


def _let(form: Sequence, site: Site) -> Group:
    scope, body = let_scope(site.evaluator, form, site.scope)
    return Group(children=describe_shapes(body, site.inside(scope)), span=form.span)


def _if(form: Sequence, site: Site) -> Group:
    if len(form.items) not in (3, 4):
        raise MbmError(
            language_faults.bad_form(form.span, "`if` takes a condition and shapes", "(if condition shape [shape])")
        )
    test = condition(site.evaluator.wanted(form.items[1], site.scope), form.items[1].span)
    chosen = form.items[2:3] if _decided(test, form.items[1].span) else form.items[3:]
    return Group(children=describe_shapes(chosen, site.inside(site.scope)), span=form.span)


def _cond(form: Sequence, site: Site) -> Group:
    for test_form, body in clauses_of_cond(form):
        if _decided(cond_condition(site.evaluator, test_form, site.scope), test_form.span):
            return Group(children=describe_shapes(body, site.inside(site.scope)), span=form.span)
    return Group(children=(), span=form.span)


def _decided(test: bool | Apply, span: Span) -> bool:
    """A condition that chooses between shapes must be known while compiling."""
    known = truth(test)
    if known is not None:
        return known
    for leaf in leaves((test,) if isinstance(test, Apply) else ()):
        if isinstance(leaf, Column):
            raise StaticColumnNeeded(leaf, span)
    raise MbmError(language_faults.not_static(span, "this condition"))


_WORDS: Mapping[str, Callable[[Sequence, Site], Node]] = MappingProxyType(
    {
        **dict.fromkeys(CURVES, _called),
        **dict.fromkeys(SWEEP_USAGES, _sweep),
        "mesh": _called,
        "trans": _transform,
        "rotate": _transform,
        "scale": _transform,
        "transform": _transform,
        "perse": _perse,
        "or": _or,
        "for": _for,
        "part": _named_part,
        "point": _point,
        "surface": _smooth_face,
        "let": _let,
        "let*": _let,
        "if": _if,
        "cond": _cond,
    }
)
