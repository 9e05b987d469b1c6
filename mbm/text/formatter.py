"""The one layout of the source: what ``mbm fmt`` writes."""

from __future__ import annotations

from dataclasses import replace

from mbm.text.comments import find_comments
from mbm.text.layout import Block, Layouter, with_notes
from mbm.text.layout_tree import Item, Note, build_tree
from mbm.text.reader import read
from mbm.text.types import Source
from mbm.text.vectors import literal_vectors

LAYOUTS = 5
"""Layouts of layouts: two are enough but for lists whose rows decide where those around them stand."""


def format_text(source: Source) -> str:
    """The text in its one layout: lines of at most 100 columns where that can be, two columns for each level of a body.

    Comments and the author's grouping by lines and blank lines stay; nothing is respelt, but that a literal vector in
    a problem, ``(0 0 h)``, becomes ``[0 0 h]``. Formatting the result changes nothing: rows that a layout makes are the
    author's in the next one, so it is laid out until that changes no more.
    Raises ``MbmError`` with the syntax errors of the text, as ``read`` does.
    """
    for _ in range(LAYOUTS):
        text = _laid_out(source)
        if text == source.text:
            break
        source = replace(source, text=text)
    return source.text


def _laid_out(source: Source) -> str:
    """One layout of the text."""
    forms = read(source)
    items = build_tree(forms, find_comments(source), source, literal_vectors(forms))
    layouter = Layouter()
    lines: list[str] = []
    notes: list[tuple[int, Note]] = []
    previous: tuple[Item, int] | None = None
    for item in items:
        block = layouter.block(item.nodes[0], 0, 0, 0)
        if previous is not None and _apart(previous, item, len(block.lines)):
            lines.append("")
        notes.extend((len(lines) + number, note) for number, note in block.notes)
        lines.extend(block.lines)
        if item.note is not None:
            notes.append((len(lines) - 1, item.note))
        previous = (item, len(block.lines))
    finished = with_notes(Block(lines=tuple(lines), notes=tuple(notes))) if lines else []
    return "".join(f"{line}\n" for line in finished)


def _apart(previous: tuple[Item, int], item: Item, height: int) -> bool:
    """A blank line is kept where there is one, and set beside a form of several lines, whose comment stays with it."""
    before, height_before = previous
    if item.blank:
        return True
    if _is_comment(before):
        return False
    return height_before > 1 or (height > 1 and not _is_comment(item))


def _is_comment(item: Item) -> bool:
    text = item.nodes[0].flat or ""
    return item.ends_line or text.startswith("#|")
