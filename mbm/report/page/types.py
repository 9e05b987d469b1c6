"""What a page is made of, before it becomes HTML or PDF. Texts are plain; backticks mark names."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.figures import Panel


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; ``doubt``: it speaks against trusting the numbers."""

    text: str
    doubt: bool = False


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list."""

    items: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Listing:
    """Text of fixed width, line by line."""

    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """A table: titles, rows of as many cells, and which columns are texts (the others are numbers)."""

    titles: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: frozenset[int] = frozenset({0})
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A panel and what it shows."""

    caption: str
    panel: Panel


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures beside one another."""

    pictures: tuple[Picture, ...]


Block: TypeAlias = Paragraph | Bullets | Listing | Grid | Pictures


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and what stands below it."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """A page; ``trusted``: no solve needs attention."""

    title: str
    verdict: str
    trusted: bool
    sections: tuple[Section, ...]
