"""Diagnostics of the shapes stage: descriptions of shapes and paths to their features."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mbm.text.faults import shown
from mbm.text.suggest import closest, did_you_mean, suggestion
from mbm.text.types import Code, Diagnostic, Label, Span

NOT_A_SHAPE = Code(
    "not-a-shape",
    "In a model, where a shape is described, something stands that is none: a number, a vector, an unknown name.",
    "Write a surface model, a transform, a model with its arguments, or a part `(name shape…)`.",
)
DUPLICATE_PART = Code(
    "duplicate-part",
    "Two parts or points of one shape have the same name, so that a path could mean either.",
    "Rename one; in a `for`, take names from an array: `((leg i) …)`.",
)
DUPLICATE_NUMBER = Code(
    "duplicate-number",
    "Two vertexes, lines or planes of one surface model have the same number.",
    "Number each of a kind differently.",
)
UNKNOWN_VERTEX = Code(
    "unknown-vertex",
    "A line or plane of a surface model names a vertex that the surface does not have.",
    "Correct the number, or add the vertex.",
)
BAD_PROFILE = Code(
    "bad-profile",
    "What is to be swept is no plane shape in z = 0 with one surface or with curves, or is seen from its back.",
    "Sweep a plane shape such as `(rectangular x y)`, `(disk r)`, a closed spline, or vertexes with z = 0.",
)
DAMAGED_MESH = Code(
    "damaged-mesh",
    "A file of a mesh is not built as its ending says, ends too early, is larger than meshes may be, or holds a number "
    "or a corner that cannot be.",
    "Write the file anew; STL, OBJ and PLY with up to 100,000 vertices and faces are read.",
)
BAD_CONSTRAINT = Code(
    "bad-constraint",
    "An entry of a model's constraints block is of no known type, or has too few forms.",
    "The types are `= > < >= <= normal uniform`.",
)
NO_FACES = Code(
    "no-faces",
    "A silhouette is wanted of a shape that covers nothing: it has neither planes nor surfaces, only points and lines.",
    "Give the surface model `planes`, or use a body of the library.",
)
ALREADY_PROJECTED = Code(
    "already-projected",
    "A silhouette is wanted of a shape in whose model `perse` stands: it lies in an image already.",
    "Take `perse` out of the model, and write `(perse SHAPE)` where the silhouette is wanted.",
)
UNKNOWN_PART = Code(
    "unknown-part",
    "A path names a part that the shape does not have at that level.",
    "Correct the name; parts inside parts are named one after the other, model calls add no level.",
)
UNKNOWN_FEATURE = Code(
    "unknown-feature",
    "A path ends in a feature that the part does not have: an unknown kind, or a number that its surfaces lack.",
    "Choose one of the features that the message lists.",
)
AMBIGUOUS_FEATURE = Code(
    "ambiguous-feature",
    "A part, point or numbered feature occurs several times where the path leads: in several surfaces or model calls.",
    "Wrap the pieces in parts of their own, `(part name …)`, and name the part in the path.",
)
AMBIGUOUS_PART = Code(
    "ambiguous-part",
    "A plain name in the place of a part is a part of the shape and a variable as well.",
    "Rename the variable, or give the path quoted: `(feature MODEL '(part (vertex 1)))`.",
)
BAD_PATH = Code(
    "bad-path",
    "A path to a feature is not built as the language says, or ends before it reaches a feature.",
    "Write `'(part (vertex 1))` or the text `part/vertex/1`; they end in a kind and number, origin, axis or a point.",
)


def not_a_shape(span: Span, got: str, *, part: str | None = None, words: Iterable[str] = ()) -> Diagnostic:
    """Something else where a shape is described; ``part`` is the name whose content it was taken for."""
    hint = "shapes are surface models, transforms, models with arguments, and parts `(name shape…)`"
    if part is not None:
        near = closest(part, words)
        hint = f"`{part}` is no model here, so `({part} …)` is read as a part, and a part holds shapes"
        if near is not None:
            hint = f"`{part}` is no model here; did you mean `{near}`?"
    return Diagnostic(
        code=NOT_A_SHAPE, message=f"a shape is described here, but this is {got}", place=span, hint=hint
    )  # fmt: skip


def empty_part(span: Span, name: str, words: Iterable[str]) -> Diagnostic:
    """A part without content."""
    near = closest(name, words)
    hint = f"did you mean `{near}`, with its arguments?" if near else "write shapes into it: `(name shape…)`"
    return Diagnostic(code=NOT_A_SHAPE, message=f"the part `{name}` holds no shape", place=span, hint=hint)


def duplicate_part(span: Span, name: str, first: Span) -> Diagnostic:
    """Two parts, or a part and a point, of one name."""
    return Diagnostic(
        code=DUPLICATE_PART, message=f"this shape has a part or point `{name}` already", place=span,
        hint="rename one; in a `for`, take names from an array: `((leg i) …)`",
        labels=(Label(first, "first named here"),),
    )  # fmt: skip


def duplicate_number(span: Span, kind: str, number: int) -> Diagnostic:
    """Two vertexes, lines or planes of one number."""
    return Diagnostic(
        code=DUPLICATE_NUMBER, message=f"this surface has a {kind} {number} already", place=span,
        hint="number each of a kind differently",
    )  # fmt: skip


def unknown_vertex(span: Span, number: int, known: Iterable[int]) -> Diagnostic:
    """A line or plane over a vertex that is not there."""
    return Diagnostic(
        code=UNKNOWN_VERTEX, message=f"this surface has no vertex {number}", place=span,
        hint=f"its vertexes: {numbers(known) or 'none'}",
    )  # fmt: skip


def bad_profile(span: Span, why: str) -> Diagnostic:
    """Something that cannot be swept."""
    return Diagnostic(
        code=BAD_PROFILE, message=f"this is no profile: {why}", place=span,
        hint="a profile is one plane surface, or curves, in z = 0; its planes run counter-clockwise seen from +z",
    )  # fmt: skip


def bad_constraint(span: Span, message: str, near: str | None = None) -> Diagnostic:
    """A constraint of a model that is not built as it should."""
    hint = did_you_mean(near, "write `(type form…)`, type one of = > < >= <= normal uniform")
    return Diagnostic(code=BAD_CONSTRAINT, message=message, place=span, hint=hint)


def unknown_part(span: Span, name: str, owner: str, parts: tuple[str, ...]) -> Diagnostic:
    """A part that is not there."""
    return Diagnostic(
        code=UNKNOWN_PART, message=f"{owner} has no part `{name}`", place=span, hint=_choices(name, parts, "parts")
    )


def unknown_feature(span: Span, name: str, owner: str, features: tuple[str, ...], names: tuple[str, ...]) -> Diagnostic:
    """A name at the end of a path that is neither a kind nor a point nor a part."""
    hint = suggestion(name, names, f"it has {', '.join(features)}")
    return Diagnostic(code=UNKNOWN_FEATURE, message=f"{owner} has no feature `{name}`", place=span, hint=hint)


def unknown_number(span: Span, kind: str, number: int, owner: str, known: Iterable[int]) -> Diagnostic:
    """A numbered feature that is not there."""
    listed = numbers(known)
    hint = (
        f"its {kind} numbers: {listed}"
        if listed
        else f"it has no {kind} at all; features of parts need the part's name"
    )
    return Diagnostic(code=UNKNOWN_FEATURE, message=f"{owner} has no {kind} {number}", place=span, hint=hint)


def ambiguous_feature(span: Span, what: str, owner: str, places: tuple[Span, ...]) -> Diagnostic:
    """A name or number that several things answer to."""
    return Diagnostic(
        code=AMBIGUOUS_FEATURE, message=f"{owner} has more than one {what}", place=span,
        hint="wrap the pieces in parts of their own: `(part name …)`",
        labels=tuple(Label(place, "one of them") for place in dict.fromkeys(places[:2])),
    )  # fmt: skip


def ambiguous_part(span: Span, name: str, owner: str) -> Diagnostic:
    """A symbol that is a part and a variable."""
    return Diagnostic(
        code=AMBIGUOUS_PART, message=f"`{name}` is a part of {owner} and a variable as well", place=span,
        hint=f"rename the variable, or quote the path: `(feature MODEL '({name} …))`",
    )  # fmt: skip


def bad_path(span: Span, message: str) -> Diagnostic:
    """A path that is not built as it should."""
    return Diagnostic(
        code=BAD_PATH, message=message, place=span,
        hint="paths look like `'(board (vertex 1))` or `\"board/vertex/1\"`, `\"leg1/origin\"`",
    )  # fmt: skip


def numbers(values: Iterable[int]) -> str:
    """Numbers in runs: ``1…4, 7``."""
    runs: list[tuple[int, int]] = []
    for value in sorted(values):
        if runs and value <= runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], value)
        else:
            runs.append((value, value))
    return ", ".join(str(a) if a == b else f"{a}, {b}" if b == a + 1 else f"{a}…{b}" for a, b in runs[:12])


def _choices(name: str, known: tuple[str, ...], what: str) -> str:
    shown = ", ".join(f"`{k}`" for k in known[:12])
    every = f"its {what}: {shown}{', …' if len(known) > 12 else ''}" if known else f"it has no {what}"
    return suggestion(name, known, every)


def no_faces(span: Span, kind: str) -> Diagnostic:
    """A shape without faces."""
    return Diagnostic(
        code=NO_FACES,
        message=f"{kind} has no faces, and so no silhouette",
        place=span,
        hint="give its surface model `planes`, or use a body of the library",
    )


def already_projected(span: Span) -> Diagnostic:
    """A shape that lies in an image."""
    return Diagnostic(
        code=ALREADY_PROJECTED,
        message="this shape is projected by `perse` in its model, and cannot be projected again",
        place=span,
        hint="take `perse` out of the model, and write `(perse SHAPE)` here",
    )


def damaged_mesh(span: Span, path: Path, message: str, line: int | None) -> Diagnostic:
    """A file that is no mesh; ``line`` is where, if lines are counted."""
    where = "" if line is None else f", line {line}"
    return Diagnostic(code=DAMAGED_MESH, message=f"the mesh `{shown(path.as_posix())}`{where}: {message}", place=span)
