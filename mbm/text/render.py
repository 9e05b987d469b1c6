"""Diagnostic → the excerpt a person reads, or the dictionary a program reads."""

from __future__ import annotations

from mbm.text.shown import Paint, Style, cell_width, joined, one_line
from mbm.text.types import Diagnostic, Place, Severity, Span

WIDEST_EXCERPT = 100
"""Columns of an excerpt; longer lines are cut around the place."""

_TAB = 4
_LONGEST = 4
"""Characters of a line that are looked at on each side of the place, and in it, for each column of the excerpt."""

_LONGEST_SIDE_HINT = 60
_STYLES = {Severity.ERROR: Style.BAD, Severity.WARNING: Style.WARNING}


def render(diagnostic: Diagnostic, *, color: bool = False) -> str:
    """The diagnostic with an excerpt of the source for each of its places, without a line break at the end.

    The hint stands behind the carets if there is room for it, else on a ``= help:`` line. With ``color``, ANSI
    escapes for a terminal. Control characters of the source are replaced, so no file can write to the terminal.
    """
    paint = Paint(color)
    style = _STYLES[diagnostic.severity]
    head = paint(f"{diagnostic.severity.value}[{diagnostic.code.name}]", style) + paint(
        f": {diagnostic.message}", Style.HEADING
    )
    gutter = _gutter(diagnostic)
    lines = [head]
    place, hint = diagnostic.place, diagnostic.mend
    if isinstance(place, Span):
        beside = hint if hint is not None and _fits_beside(place, hint, gutter) else None
        lines.extend(_excerpt(place, beside, "^", gutter, paint, style))
        hint = None if beside is not None else hint
    elif place is not None:
        lines.append(_arrow(place, gutter, paint))
    for label in diagnostic.labels:
        if isinstance(label.place, Span):
            lines.extend(_excerpt(label.place, label.message, "-", gutter, paint, Style.NOTE))
        else:
            lines.append(f"{_arrow(label.place, gutter, paint)}: {label.message}")
    if hint is not None:
        lines.append(f"{' ' * gutter} {paint('=', Style.NOTE)} {paint('help', Style.HEADING)}: {hint}")
    return joined(lines, color=color)


def as_json(diagnostic: Diagnostic) -> dict[str, str | int | None]:
    """The diagnostic with the keys of the result document: severity, code, message, file, line, column, length, hint.

    Lines and columns count from 1, lengths in characters. For a place in a data file ``line`` and ``row`` are the row
    as in the file (header = 1), ``column_name`` is the column's name, ``column`` and ``length`` are None.
    """
    place = diagnostic.place
    document: dict[str, str | int | None] = {
        "severity": diagnostic.severity.value,
        "code": diagnostic.code.name,
        "message": diagnostic.message,
        "file": None,
        "line": None,
        "column": None,
        "length": None,
        "hint": diagnostic.mend,
    }
    if isinstance(place, Span):
        document |= {"file": place.source.name, "line": place.line, "column": place.column, "length": place.length}
    elif place is not None:
        document |= {"file": place.file, "line": place.row, "row": place.row, "column_name": place.column}
    return document


def _gutter(diagnostic: Diagnostic) -> int:
    places = (diagnostic.place, *(label.place for label in diagnostic.labels))
    return max([2, *(len(str(place.line)) for place in places if isinstance(place, Span))])


def _arrow(place: Place, gutter: int, paint: Paint) -> str:
    return f"{' ' * gutter}{paint('-->', Style.NOTE)} {place.where}"


def _excerpt(place: Span, words: str | None, mark: str, gutter: int, paint: Paint, style: Style) -> list[str]:
    shown, indent, taken = _window(place, WIDEST_EXCERPT - gutter - 3)
    bar = paint("|", Style.NOTE)
    under = mark * taken if words is None else f"{mark * taken} {words}"
    return [
        _arrow(place, gutter, paint),
        f"{' ' * gutter} {bar}",
        f"{paint(str(place.line).rjust(gutter), Style.NOTE)} {bar} {shown}".rstrip(),
        f"{' ' * gutter} {bar} {' ' * indent}{paint(under, style)}",
    ]


def _fits_beside(place: Span, hint: str, gutter: int) -> bool:
    _shown, indent, taken = _window(place, WIDEST_EXCERPT - gutter - 3)
    return len(hint) <= _LONGEST_SIDE_HINT and gutter + 3 + indent + taken + 1 + cell_width(hint) <= WIDEST_EXCERPT


def _window(place: Span, room: int) -> tuple[str, int, int]:
    """The first line of the place cut to ``room`` columns, the columns before the place, the columns it takes."""
    text = place.source.line_text(place.line)
    start = place.column - 1
    end = min(start + max(place.length, 1), max(len(text), start + 1))
    longest = _LONGEST * room  # marks that combine take no columns: any number of them would have room
    before, inside, after = text[max(start - longest, 0) : start], text[start:end][:longest], text[end : end + longest]
    before, inside, after = _columns(before), _columns(inside), _columns(after)
    if cell_width(before + inside + after) > room:
        inside = _cut(inside, room - 2)
        margin = max((room - cell_width(inside)) // 2, 1)
        if cell_width(before) > margin and cell_width(before + inside) + 1 > room:
            before = "…" + _cut_left(before, margin - 1)
        after = _cut(after, room - cell_width(before + inside))
    return before + inside + after, cell_width(before), max(cell_width(inside), 1)


def _columns(text: str) -> str:
    return one_line(text.replace("\t", " " * _TAB))


def _cut(text: str, room: int) -> str:
    if cell_width(text) <= room:
        return text
    while text and cell_width(text) > room - 1:
        text = text[: min(len(text) - 1, room)]
    return text + "…"


def _cut_left(text: str, room: int) -> str:
    text = text[max(len(text) - room, 0) :]
    while cell_width(text) > room:
        text = text[1:]
    return text
