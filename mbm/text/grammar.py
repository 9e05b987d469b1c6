"""The lark parser of ``grammar/mbm.lark``, built once per process."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lark import Lark, Token, Tree


def grammar_text() -> str:
    """The grammar as text: that of an installed package, else that of the checkout.

    Raises ``FileNotFoundError`` if the installation holds neither.
    """
    shipped = Path(__file__).parents[1] / "grammar" / "mbm.lark"
    in_checkout = Path(__file__).parents[2] / "grammar" / "mbm.lark"
    return (shipped if shipped.is_file() else in_checkout).read_text(encoding="utf-8")


def tokenize(text: str) -> tuple[Token, ...]:
    """The tokens of a text, comments and white space left out. Every text has some: faulty words are tokens too."""
    return tuple(_parser().lex(text))


def parse(tokens: Iterable[Token]) -> Tree[Token]:
    """The tree of tokens whose nesting is sound; its children are the top-level forms."""
    from lark import Token

    parsing = _parser().parse_interactive()
    for token in tokens:
        parsing.feed_token(token)
    tree: Tree[Token] = parsing.feed_token(Token("$END", ""))
    return tree


@cache
def _parser() -> Lark:
    from lark import Lark  # here, not above: a start-up that reads no file need not pay for it

    return Lark(grammar_text(), parser="lalr", lexer="basic", maybe_placeholders=False)
