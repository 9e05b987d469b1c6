"""Tokens → what is wrong with their nesting: brackets, quotes, depth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field
from typing import TYPE_CHECKING

from mbm.text import faults
from mbm.text.atoms import span_of
from mbm.text.types import Diagnostic, Source
from mbm.values import dataclass

if TYPE_CHECKING:
    from lark import Token

DEEPEST = 200
"""Levels of brackets and quotes that the reader follows."""

_OPENING = {"OPEN_ROUND": "CLOSE_ROUND", "OPEN_SQUARE": "CLOSE_SQUARE"}
_CLOSING = frozenset(_OPENING.values())
_PREFIXES = {"QUOTE": 0, "QUASIQUOTE": 1, "UNQUOTE": -1, "UNQUOTE_SPLICING": -1}


def nesting_faults(tokens: Iterable[Token], source: Source, *, cut_off: bool) -> tuple[Diagnostic, ...]:
    """Every independent fault of nesting, in order.

    If brackets stay open, the text is judged again under the assumption that a bracket in column 1 starts a new
    top-level form, so that one forgotten bracket does not hide what is wrong further down. ``cut_off`` says that
    the text ends inside a string or comment, which has swallowed closing brackets: open ones are then no fault.
    """
    tokens = tuple(tokens)
    walk = _Walk(source=source)
    walk.run(tokens)
    if walk.open and not walk.stopped and not cut_off:
        walk = _Walk(source=source, restarts=True)
        walk.run(tokens)
        walk.report_unclosed(None)
    return tuple(walk.found)


@dataclass(slots=True, kw_only=True)
class _Opened:
    """An open bracket: its token, the quasi-quotation level and depth of its items, the prefixes waiting for a form."""

    token: Token | None
    level: int
    depth: int
    prefixes: list[Token] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class _Walk:
    """One pass over the tokens; ``restarts``: a bracket in column 1 starts anew."""

    source: Source
    restarts: bool = False
    found: list[Diagnostic] = field(default_factory=list)
    open: list[_Opened] = field(default_factory=list)
    top: _Opened = field(default_factory=lambda: _Opened(token=None, level=0, depth=0))
    suspect: tuple[int, _Opened, Token] | None = None  # number of open brackets, the innermost, a token left of it
    silent: bool = False  # this top-level form has had its fault: what follows from it is not reported
    stopped: bool = False
    line: int = 0

    def run(self, tokens: tuple[Token, ...]) -> None:
        """Takes all tokens, or those up to the first that is nested too deeply."""
        for token in tokens:
            first_on_line, self.line = token.line != self.line, token.line or 0
            if token.type in _OPENING and token.column == 1 and (self.restarts or not self.open):
                self._restart(token)
            if token.type in _CLOSING:
                self._close(token)
            else:
                if first_on_line:
                    self._note_layout(token)
                self._take(token)
            if self.stopped:
                return
        self._need_form()

    def report_unclosed(self, noticed: Token | None) -> None:
        """Blames the brackets open now on one of them; ``noticed`` is the top-level form that begins too early."""
        if self.open and not self.silent:
            culprit, place = self.open[-1], noticed
            if self.suspect is not None:
                _count, culprit, place = self.suspect
            if culprit.token is not None:
                where = None if place is None else span_of(place, self.source)
                opening = span_of(culprit.token, self.source)
                self.found.append(faults.unclosed_bracket(opening, where, len(self.open) - 1))
        self.open.clear()
        self.suspect, self.silent = None, False

    def _inner(self) -> _Opened:
        return self.open[-1] if self.open else self.top

    def _restart(self, token: Token) -> None:
        if self.open:
            self._need_form()
        self.report_unclosed(token)

    def _note_layout(self, token: Token) -> None:
        """What begins a line not right of the innermost open bracket suggests that this one should be closed."""
        if self.suspect is None and self.open:
            opened = self.open[-1]
            if opened.token is not None and (token.column or 0) <= (opened.token.column or 0):
                self.suspect = (len(self.open), opened, token)

    def _take(self, token: Token) -> None:
        inner = self._inner()
        level = inner.level + sum(_PREFIXES[prefix.type] for prefix in inner.prefixes)
        depth = inner.depth + len(inner.prefixes) + 1
        if token.type in _PREFIXES:
            if _PREFIXES[token.type] < 0 and level <= 0:
                self.found.append(faults.unexpected_comma(span_of(token, self.source)))
                return
            inner.prefixes.append(token)
        elif token.type in _OPENING:
            inner.prefixes.clear()
            self.open.append(_Opened(token=token, level=level, depth=depth))
        else:
            inner.prefixes.clear()
            return
        if depth > DEEPEST:
            self.found.append(faults.too_deeply_nested(span_of(token, self.source), DEEPEST))
            self.stopped = True

    def _close(self, token: Token) -> None:
        self._need_form()
        if not self.open:
            if not self.silent:
                self.found.append(faults.surplus_bracket(span_of(token, self.source)))
            self.silent = True
            return
        opened = self.open.pop()
        if opened.token is not None and _OPENING[opened.token.type] != token.type and not self.silent:
            closing, opening = span_of(token, self.source), span_of(opened.token, self.source)
            self.found.append(faults.mismatched_bracket(closing, opening))
            self.silent = True
        if self.suspect is not None and len(self.open) < max(self.suspect[0] - 1, 1):
            self.suspect = None  # what encloses it was closed after all: the layout was only unusual

    def _need_form(self) -> None:
        inner = self._inner()
        if inner.prefixes:
            self.found.append(faults.nothing_to_quote(span_of(inner.prefixes[-1], self.source)))
            inner.prefixes.clear()
