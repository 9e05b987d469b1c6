"""The one layout of the source, which ``mbm fmt`` writes: square brackets for paren vectors that mean the same, too."""

from __future__ import annotations

from dataclasses import replace

from mbm.text.comments import find_comments
from mbm.text.layout import Block, Layouter, with_notes
from mbm.text.layout_tree import Item, Note, build_tree
from mbm.text.reader import read
from mbm.text.types import Bracket, Form, Keyword, Numeral, Sequence, Source, Symbol

LAYOUTS = 5
"""Layouts of layouts: two are enough but for lists whose rows decide where those around them stand."""


_ARITHMETIC = (
    "+ - * / ^ sqrt exp log log10 abs min max sign mod floor hypot sin cos tan asin acos atan atan2 sinh cosh tanh"
)
_COMPARISON = "= < <= > >= and or not if"
_VECTORS = "dot cross norm distance normalize addvv subvv mulmv transpose @ outer det identity list"
_FRAMES = (
    "euler rot-x rot-y rot-z rot2 axis-angle quaternion look-at pose2 pose3 rotation translation heading "
    "trans rotate scale transform inverse compose between"
)
_OBSERVABLES = (
    "project perse vertex-on-image line-on-image vertex-on-line line-through image-line "
    "point-line-distance point-plane-distance bearing elevation normal uniform"
)
EVALUATING = frozenset(" ".join((_ARITHMETIC, _COMPARISON, _VECTORS, _FRAMES, _OBSERVABLES)).split())
"""Built-in heads all of whose arguments are evaluated, so that a paren vector among them is a value."""
_FORM_OPTIONS = {
    "observe": frozenset({"sigma", "covariance", "information", "bound", "when"}),
    "unknowns": frozenset({"init", "sigma", "covariance"}),
    "states": frozenset({"init", "sigma", "covariance"}),
}
"""Options of a clause (or of its entries) whose value is an expression."""


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


def literal_vectors(forms: tuple[Form, ...]) -> frozenset[int]:
    """The offsets of the lists inside `problem` forms that are vectors beyond doubt: they begin with a number and stand
    where an expression is evaluated. Everything else is left out: pairs such as ``:in (lo hi)``, rows of tables,
    quoted forms, arguments of names that the file or another one defines.
    """
    redefined = frozenset(
        item.name for form in forms if isinstance(form, Sequence) for item in form.items[:2] if isinstance(item, Symbol)
    )
    search = _Search(EVALUATING - redefined)
    for form in forms:
        if isinstance(form, Sequence) and form.head == "problem":
            for clause in form.items[1:]:
                search.clause(clause)
    return frozenset(search.found)


class _Search:
    """Walks the clauses of a problem; ``found`` collects offsets."""

    def __init__(self, evaluating: frozenset[str]) -> None:
        self.evaluating = evaluating
        self.found: set[int] = set()

    def clause(self, form: Form) -> None:
        """One clause of a problem."""
        if not isinstance(form, Sequence):
            return
        match form.head:
            case "observe":
                self._options(form, "observe")
                for item in _positional(form.items[1:]):
                    self.expression(item)
            case "unknowns" | "states":
                for entry in form.items[1:]:
                    if isinstance(entry, Sequence):
                        self._options(entry, str(form.head))
            case "derive" | "define":
                for entry in form.items[1:]:
                    if isinstance(entry, Sequence) and len(entry.items) > 1:
                        self.expression(entry.items[1])
            case "constraints":
                for entry in form.items[1:]:
                    self._constraint(entry)

    def _constraint(self, form: Form) -> None:
        if isinstance(form, Sequence) and form.head == "for":
            for item in form.items[2:]:
                self._constraint(item)
        else:
            self.call(form)

    def expression(self, form: Form) -> None:
        """A form that is evaluated, and would be a vector if it were a list with a number at its head."""
        if isinstance(form, Sequence) and form.items and isinstance(form.items[0], Numeral):
            if form.bracket is Bracket.ROUND:
                self.found.add(form.span.start)
            for item in form.items:
                self.expression(item)
        else:
            self.call(form)

    def call(self, form: Form) -> None:
        """The arguments of a built-in function, the elements of a vector, the bodies of ``let``."""
        if not isinstance(form, Sequence):
            return
        if form.bracket is Bracket.SQUARE:
            for item in form.items:
                self.expression(item)
        elif form.head in ("let", "let*") and form.head not in self.evaluating and len(form.items) > 1:
            bindings = form.items[1]
            for binding in bindings.items if isinstance(bindings, Sequence) else ():
                if isinstance(binding, Sequence) and len(binding.items) == 2:
                    self.expression(binding.items[1])
            for item in form.items[2:]:
                self.expression(item)
        elif form.head in self.evaluating:
            for item in _positional(form.items[1:]):
                self.expression(item)

    def _options(self, form: Sequence, clause: str) -> None:
        for name, value in zip(form.items, form.items[1:], strict=False):
            if isinstance(name, Keyword) and name.name in _FORM_OPTIONS[clause]:
                self.expression(value)


def _positional(items: tuple[Form, ...]) -> tuple[Form, ...]:
    """The items before the first keyword."""
    first = next((place for place, item in enumerate(items) if isinstance(item, Keyword)), len(items))
    return items[:first]
