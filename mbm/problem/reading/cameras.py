"""``(camera NAME :model … :focal (fx fy) :center (cx cy) :distortion (…) :axes … :per TABLE)``."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mbm.expression.algebra import ZERO
from mbm.expression.nodes import Column, ColumnMember, Expression, LiteralMember, Member, Number
from mbm.expression.projection import AXES, NEAR
from mbm.expression.units import NONE
from mbm.language import faults as language_faults
from mbm.language.scope import scalar, text, vector
from mbm.language.values import SCALARS, CameraValue, FamilyValue, Scope, TextColumn, Value
from mbm.problem.clauses import Options, split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.reading.declarations import family_of, keys_of
from mbm.problem.reading.source_arguments import METRE
from mbm.problem.scopes import Entry, MemberScope
from mbm.problem.types import Family
from mbm.text.suggest import closest
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol, Text

USAGE = (
    "(camera name [:model pinhole] [:focal (fx fy)] [:center (cx cy)] "
    "[:distortion (k1 k2 p1 p2 k3)] [:axes opencv|paper|opengl] [:near 0.1] [:per TABLE])"
)
_MODELS = ("pinhole", "fisheye", "weak-perspective", "orthographic")
_COEFFICIENTS = {"pinhole": (5, "k1 k2 p1 p2 k3"), "fisheye": (4, "k1 k2 k3 k4")}


def read_camera(work: Workspace, clause: Sequence) -> None:
    """Declare a camera, or a family of them; its numbers are evaluated when it is first used."""
    items = clause.items[1:]
    if not items or not isinstance(items[0], Symbol):
        place = items[0].span if items else clause.span
        raise MbmError(language_faults.bad_form(place, "a camera begins with its name", USAGE))
    name = items[0]
    options = split_options(
        items[1:],
        clause.span,
        owner="a camera",
        known=("model", "focal", "center", "distortion", "axes", "near", "per"),
        not_yet={"size": "images"},
        alone=USAGE,
    )
    axes = _choice(options.get("axes"), AXES, "axes") or AXES[0]
    distortion, near = options.get("distortion"), options.get("near")
    family = family_of(work, options.get("per"))
    keys = keys_of(work, family)
    form = options.get("model")
    word = (_choice(form, _MODELS, "model") or "pinhole") if form is None or _is_word(work, form, family) else None
    if distortion is not None and word is not None and word not in _COEFFICIENTS:
        message = f"this {word} camera has no distortion"
        raise MbmError(language_faults.bad_form(distortion.span, message, "leave `:distortion` out"))

    def camera(scope: Scope) -> CameraValue:
        model = word or _model(work, form, scope)
        return CameraValue(
            name.name,
            _focal(work, options, Number(1, NONE if model in _COEFFICIENTS else None), scope),
            _pair(work, options, "center", ZERO, scope),
            _distortion(work, distortion, model, scope),
            axes,
            model,
            NEAR if near is None else _near(work, near, scope),
        )

    def make() -> Value:
        if family is None or keys is None:
            return camera(work.scope)
        return _family(work, name.name, family, keys, camera)

    work.scope.add(name.name, Entry("camera", name.span, make))


def _family(
    work: Workspace, name: str, family: Family, keys: frozenset[str | float], camera: Callable[[Scope], CameraValue]
) -> FamilyValue:
    """The cameras of all members; each is evaluated in the scope of its row."""
    made: dict[Member, Value] = {}

    def member(key: str | float | Column | TextColumn) -> Value:
        picked: Member
        if isinstance(key, Column | TextColumn):
            picked = ColumnMember(table=key.table, column=key.name, row=key.row)
        else:
            picked = LiteralMember(key=key)
            work.reads.keyed[family.rows] = None
        if picked not in made:
            table = work.tables[family.rows]
            asked = () if table.key is None else (table.key,)

            def read(column: str) -> None:
                work.reads.grouped(table.name, (*asked, column), None)

            made[picked] = camera(MemberScope(work.scope, table, picked, key, read))
        return made[picked]

    return FamilyValue(name, keys, member)


def _is_word(work: Workspace, form: Form, family: Family | None) -> bool:
    """Whether ``:model`` names a model for all members: else it is a form that gives a text for each."""
    if family is None or isinstance(form, Text) or (isinstance(form, Symbol) and form.name in _MODELS):
        return True
    return isinstance(form, Symbol) and form.name not in work.tables[family.rows].columns


def _model(work: Workspace, form: Form | None, scope: Scope) -> str:
    """The model of a member, from a form in the scope of its row."""
    if form is None:
        return _MODELS[0]
    name = text(work.evaluator.wanted(form, _ModelWords(scope)), form.span, "the model of a camera")
    if name not in _MODELS:
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` is no camera model", " or ".join(_MODELS)))
    return name


class _ModelWords:
    """The names of the models, which mean themselves as texts, over another scope."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope

    def lookup(self, name: str, span: Span) -> Value | None:
        """A model, or what the name means else."""
        return name if name in _MODELS else self._scope.lookup(name, span)

    def names(self) -> Iterator[str]:
        """The models, then the names of the other scope."""
        yield from _MODELS
        yield from self._scope.names()

    def columns(self) -> tuple[str, tuple[str, ...]] | None:
        """Those of the other scope."""
        return self._scope.columns()


def _choice(form: Form | None, known: tuple[str, ...], option: str) -> str | None:
    if form is None:
        return None
    name = form.name if isinstance(form, Symbol) else form.value if isinstance(form, Text) else form.span.text
    if name not in known:
        near = closest(name, known)
        hint = f":{option} {near}" if near else " or ".join(f":{option} {k}" for k in known)
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` is no camera {option}", hint))
    return name


def _focal(work: Workspace, options: Options, default: Number, scope: Scope) -> tuple[Expression, Expression]:
    found = _pair(work, options, "focal", default, scope)
    form = options.get("focal")
    if form is not None and any(isinstance(each, Number) and each.value == 0 for each in found):
        message = "a camera with a focal length of 0 sees all points at one"
        raise MbmError(
            language_faults.bad_form(form.span, message, USAGE, "leave `:focal` out for 1, or name an unknown")
        )
    return found


def _near(work: Workspace, form: Form, scope: Scope) -> Expression:
    """How near a camera sees, a length in front of it."""
    found = scalar(work.evaluator.wanted(form, scope), form.span)
    if isinstance(found, Number) and (found.value <= 0 or found.dimension not in (None, METRE)):
        message = "what is nearer than this is not seen: it should be a length, more than 0"
        raise MbmError(language_faults.bad_form(form.span, message, USAGE, "`:near 1mm`, or leave it out for 0.1 m"))
    return found


def _pair(work: Workspace, options: Options, name: str, default: Number, scope: Scope) -> tuple[Expression, Expression]:
    form = options.get(name)
    if form is None:
        return default, default
    value = work.evaluator.wanted(form, scope)
    if isinstance(value, SCALARS):
        single = scalar(value, form.span)
        return single, single
    first, second = vector(value, form.span, 2, f"`:{name}` takes two numbers, or one for both axes").elements
    return first, second


def _distortion(work: Workspace, form: Form | None, model: str, scope: Scope) -> tuple[Expression, ...]:
    """The coefficients; where members have models of their own, those that have none take none."""
    if form is None or model not in _COEFFICIENTS:
        return ()
    most, names = _COEFFICIENTS[model]
    listed = f"a list of coefficients, `({names})`; those left out are 0"
    elements = vector(work.evaluator.wanted(form, scope), form.span, hint=listed).elements
    if len(elements) > most:
        message = f"a list of {len(elements)} coefficients"
        raise MbmError(language_faults.length_clash(form.span, message, f"{names} (at most {most})", listed))
    return elements + (ZERO,) * (most - len(elements))
