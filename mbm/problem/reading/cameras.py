"""``(camera NAME :model … :focal (fx fy) :center (cx cy) :distortion (k1 k2 p1 p2 k3) :axes …)``."""

from __future__ import annotations

from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number
from mbm.language import faults as language_faults
from mbm.language.coerce import scalar, vector
from mbm.language.values import SCALARS, CameraValue, Value
from mbm.problem.elaboration import Workspace
from mbm.problem.options import Options, split_options
from mbm.problem.scopes import Entry
from mbm.text.suggest import closest
from mbm.text.types import Form, MbmError, Sequence, Symbol

USAGE = (
    "(camera name [:model pinhole] [:focal (fx fy)] [:center (cx cy)] "
    "[:distortion (k1 k2 p1 p2 k3)] [:axes opencv|paper])"
)
_MODELS_LATER = ("fisheye", "weak-perspective", "orthographic")
_AXES = ("opencv", "paper")


def read_camera(work: Workspace, clause: Sequence) -> None:
    """Declare a camera; its numbers are evaluated when it is first used."""
    items = clause.items[1:]
    if not items or not isinstance(items[0], Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "a camera begins with its name", USAGE))
    name = items[0]
    options = split_options(
        items[1:],
        clause.span,
        owner="a camera",
        known=("model", "focal", "center", "distortion", "axes"),
        not_yet={"per": "families of cameras", "near": "images of curves", "size": "images"},
    )
    if options.positional:
        raise MbmError(language_faults.bad_form(options.positional[0].span, "a camera takes options only", USAGE))
    _choice(options.get("model"), ("pinhole",), "model", later=_MODELS_LATER)
    axes = _choice(options.get("axes"), _AXES, "axes") or "opencv"

    def make() -> Value:
        return CameraValue(
            name.name,
            _pair(work, options, "focal", Number(1, NONE)),
            _pair(work, options, "center", Number(0, NONE)),
            _distortion(work, options.get("distortion")),
            axes,
        )

    work.scope.add(name.name, Entry("camera", name.span, make))


def _choice(form: Form | None, known: tuple[str, ...], option: str, later: tuple[str, ...] = ()) -> str | None:
    if form is None:
        return None
    name = form.name if isinstance(form, Symbol) else form.span.text
    if name in later:
        raise MbmError(language_faults.not_available_yet(form.span, f"`:{option} {name}`", "other camera models"))
    if name not in known:
        near = closest(name, known)
        hint = f":{option} {near}" if near else " or ".join(f":{option} {k}" for k in known)
        raise MbmError(language_faults.bad_form(form.span, f"`{name}` is no camera {option}", hint))
    return name


def _pair(work: Workspace, options: Options, name: str, default: Number) -> tuple[Expression, Expression]:
    form = options.get(name)
    if form is None:
        return default, default
    value = work.evaluator.wanted(form, work.scope)
    if isinstance(value, SCALARS):
        single = scalar(value, form.span)
        return single, single
    first, second = vector(value, form.span, 2).elements
    return first, second


def _distortion(work: Workspace, form: Form | None) -> tuple[Expression, ...]:
    if form is None:
        return ()
    elements = vector(work.evaluator.wanted(form, work.scope), form.span).elements
    if len(elements) > 5:
        raise MbmError(
            language_faults.length_clash(form.span, f"{len(elements)} coefficients", "k1 k2 p1 p2 k3 (at most 5)")
        )
    return elements + (Number(0, NONE),) * (5 - len(elements))
