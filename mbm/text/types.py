"""Values of the text stage: where things stand in a file, and what may be said about them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import field
from enum import StrEnum
from fractions import Fraction
from functools import cached_property
from typing import TypeAlias

from mbm.text.shown import cut, one_line
from mbm.values import dataclass

LONGEST_MESSAGE = 4000
"""Characters of what a diagnostic says: far more than mbm's own words and a few names and paths take."""


@dataclass(frozen=True)
class Source:
    """A named text. ``name`` is what messages print (a path as the user gave it, or ``<text>``)."""

    name: str
    text: str

    @cached_property
    def _line_starts(self) -> tuple[int, ...]:
        starts = [0]
        starts.extend(i + 1 for i, character in enumerate(self.text) if character == "\n")
        return tuple(starts)

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column, both from 1, of a character offset."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def line_text(self, line: int) -> str:
        """The text of a line (from 1) without its line break."""
        start = self._line_starts[line - 1]
        end = self._line_starts[line] - 1 if line < len(self._line_starts) else len(self.text)
        return self.text[start:end].rstrip("\r")


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A stretch of a source: offsets in characters, end excluded."""

    source: Source = field(repr=False)
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line of the first character, from 1."""
        return self.source.position(self.start)[0]

    @property
    def column(self) -> int:
        """Column of the first character, from 1."""
        return self.source.position(self.start)[1]

    @property
    def length(self) -> int:
        """Number of characters."""
        return self.end - self.start

    @property
    def text(self) -> str:
        """The characters themselves."""
        return self.source.text[self.start : self.end]

    @property
    def where(self) -> str:
        """``file:line:column``."""
        return f"{one_line(self.source.name)}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DataPlace:
    """A place in a data file: ``row`` counts as in the file (header = 1), ``column`` by name; both may be unknown.

    ``number``, of a table in the text of a problem, where several rows may stand on a line, is that of the table's row.
    """

    file: str
    row: int | None = None
    column: str | None = None
    number: int | None = None

    @property
    def counted(self) -> int | None:
        """The row as sentences say it: as in the file, or as in the table in the text."""
        return self.row if self.number is None else self.number

    @property
    def where(self) -> str:
        """``file:row (column name)``, as far as they are known."""
        row = "" if self.row is None else f":{self.row}"
        column = "" if self.column is None else f" (column {one_line(self.column)})"
        return f"{one_line(self.file)}{row}{column}"


Place: TypeAlias = Span | DataPlace


class Severity(StrEnum):
    """How much a diagnostic weighs: an error stops the run, a warning does not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Code:
    """A kind of diagnostic: the stable kebab-case name, what it means and why it is one, and how to mend it."""

    name: str
    meaning: str
    mend: str


@dataclass(frozen=True, slots=True)
class Label:
    """A second place that a diagnostic speaks of; ``message`` becomes a line as in `Diagnostic`."""

    place: Place
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", cut(self.message, LONGEST_MESSAGE))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """What is wrong, where, and the likely mend. Built by the constructors in each stage's ``faults`` module.

    Whatever the constructors put into ``message`` and ``hint``, names, cells, paths, what a library says: each becomes
    one line of printable characters, `LONGEST_MESSAGE` of them at most.
    """

    code: Code
    message: str
    place: Place | None = None
    hint: str | None = None
    labels: tuple[Label, ...] = ()
    severity: Severity = Severity.ERROR

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", cut(self.message, LONGEST_MESSAGE))
        if self.hint is not None:
            object.__setattr__(self, "hint", cut(self.hint, LONGEST_MESSAGE))

    @property
    def mend(self) -> str | None:
        """The hint; where a diagnostic with a place has none of its own, what its code says in general."""
        if self.hint is not None or self.place is None:
            return self.hint
        return self.code.mend[:1].lower() + self.code.mend[1:].rstrip(".")


class MbmError(Exception):
    """The problem, the data or the call is wrong; ``diagnostics`` says how, in the order found: one at least."""

    def __init__(self, *diagnostics: Diagnostic) -> None:
        if not diagnostics:
            raise ValueError("an error without a diagnostic")
        super().__init__("; ".join(f"{d.code.name}: {d.message}" for d in diagnostics))
        self.diagnostics: tuple[Diagnostic, ...] = diagnostics

    def __reduce__(self) -> tuple[type[MbmError], tuple[Diagnostic, ...]]:
        """It pickles as its diagnostics, so that it comes home from other processes."""
        return type(self), self.diagnostics


@dataclass(frozen=True, slots=True, kw_only=True)
class Symbol:
    """A name; case-sensitive."""

    name: str
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Keyword:
    """``:name``; ``name`` is without the colon."""

    name: str
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """A string literal, escapes resolved."""

    value: str
    span: Span = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Numeral:
    """A number as written: exact where it was written exactly; ``unit`` is the text stuck to it (not yet looked up)."""

    value: int | Fraction | float
    unit: str | None
    span: Span = field(compare=False)


class Bracket(StrEnum):
    """What encloses a sequence: a list, or a literal vector."""

    ROUND = "("
    SQUARE = "["


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequence:
    """``( … )`` or ``[ … ]``.

    ``'x`` reads as ``(quote x)``, `` `x ,x ,@x `` as quasiquote, unquote, unquote-splicing.
    """

    items: tuple[Form, ...]
    bracket: Bracket
    span: Span = field(compare=False)

    @property
    def head(self) -> str | None:
        """The name at the head of a list, if it is a symbol."""
        if self.bracket is Bracket.ROUND and self.items and isinstance(self.items[0], Symbol):
            return self.items[0].name
        return None


Form: TypeAlias = Symbol | Keyword | Text | Numeral | Sequence


def symbols_of(*forms: Form) -> Iterator[Symbol]:
    """The symbols of some forms, however deep."""
    left = list(forms)
    while left:
        form = left.pop()
        if isinstance(form, Symbol):
            yield form
        elif isinstance(form, Sequence):
            left.extend(form.items)
