"""Surface models: ``(vertexes …) (lines …) (planes …)``."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.language import faults as language_faults
from mbm.language.scope import integer, list_items, vector
from mbm.language.values import Array, Evaluator, Scope
from mbm.shapes import faults
from mbm.shapes.repetition import repetitions
from mbm.shapes.types import Surface
from mbm.text.types import Form, MbmError, Sequence, Span

CLAUSES = ("vertexes", "lines", "planes")
USAGE = "(vertexes (1 (x y z)) …) [(lines (1 (1 2)) …)] [(planes (1 (1 2 3)) …)]"
_FEWEST = {"line": 2, "plane": 3}


def clause(form: Form) -> str | None:
    """Which clause of a surface model a form is, if any."""
    head = form.head if isinstance(form, Sequence) else None
    return head if head in CLAUSES else None


def surface(evaluator: Evaluator, forms: tuple[Sequence, ...], scope: Scope) -> Surface:
    """The surface model that neighbouring clauses make.

    Raises:
        MbmError: a clause twice or without vertexes, numbers twice, lines and planes over unknown vertexes.

    """
    clauses: dict[str, Sequence] = {}
    for form in forms:
        name = clause(form)
        if name is None or name in clauses:
            message = f"`{name}` occurs twice" if name else "only vertexes, lines and planes belong here"
            raise MbmError(language_faults.bad_form(form.span, f"{message} in this surface model", USAGE))
        clauses[name] = form
    if "vertexes" not in clauses:
        raise MbmError(language_faults.bad_form(forms[0].span, "this surface model has no vertexes", USAGE))
    vertexes: dict[int, Array] = {}
    for number, at, inner, span in _entries(evaluator, clauses["vertexes"], scope):
        _claim(vertexes, number, "vertex", span)
        vertexes[number] = vector(evaluator.wanted(at, inner), at.span, 3)
    chains: dict[str, dict[int, tuple[int, ...]]] = {}
    for kind in ("line", "plane"):
        found = chains.setdefault(kind, {})
        if f"{kind}s" in clauses:
            for number, corners, inner, span in _entries(evaluator, clauses[f"{kind}s"], scope):
                _claim(found, number, kind, span)
                found[number] = _corners(evaluator, corners, inner, kind, vertexes)
    return Surface(vertexes=vertexes, lines=chains["line"], planes=chains["plane"], span=forms[0].span)


def _entries(evaluator: Evaluator, form: Sequence, scope: Scope) -> Iterator[tuple[int, Form, Scope, Span]]:
    """The entries ``(number form)`` of a clause with the scope they are read in; ``for`` repeats some."""
    for item in form.items[1:]:
        yield from _entry(evaluator, item, scope)


def _entry(evaluator: Evaluator, form: Form, scope: Scope) -> Iterator[tuple[int, Form, Scope, Span]]:
    if isinstance(form, Sequence) and form.head == "for":
        for inner in repetitions(evaluator, form, scope):
            for item in form.items[2:]:
                yield from _entry(evaluator, item, inner)
        return
    if not isinstance(form, Sequence) or len(form.items) != 2:
        raise MbmError(language_faults.bad_form(form.span, "an entry is (number what)", USAGE))
    number = integer(evaluator.wanted(form.items[0], scope), form.items[0].span, "a number (whole)")
    yield number, form.items[1], scope, form.items[0].span


def _claim(taken: dict[int, Array] | dict[int, tuple[int, ...]], number: int, kind: str, span: Span) -> None:
    if number in taken:
        raise MbmError(faults.duplicate_number(span, kind, number))


def _corners(evaluator: Evaluator, form: Form, scope: Scope, kind: str, vertexes: dict[int, Array]) -> tuple[int, ...]:
    items = list_items(evaluator.wanted(form, scope), form.span)
    written = form.items if isinstance(form, Sequence) and len(form.items) == len(items) else (form,) * len(items)
    corners = tuple(integer(v, f.span, "the number of a vertex") for v, f in zip(items, written, strict=True))
    few, exact = _FEWEST[kind], kind == "line"
    if len(corners) < few or (exact and len(corners) > few):
        wanted = f"a {kind} is given by {'' if exact else 'at least '}{few} vertexes"
        raise MbmError(language_faults.bad_form(form.span, wanted, USAGE))
    for corner, at in zip(corners, written, strict=True):
        if corner not in vertexes:
            raise MbmError(faults.unknown_vertex(at.span, corner, vertexes))
    return corners
