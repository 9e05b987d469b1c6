"""YAML → nodes: scalars as they are written, lists and maps, each with its line. No object is ever made of a tag.

PyYAML takes the text apart into events; the nodes are put together here, so that depth is bounded before anything
recurses, and an alias stands for the node of its anchor itself, never for a copy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, TypeAlias

from mbm.data.content import cells_in, check_table, read_text
from mbm.data.readers import faults as format_faults
from mbm.problem.tables import reads_as_number
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

DEEPEST = 32
"""Lists and maps within one another."""

MARKS = b",:[]{}-"
"""What stands between the values of a text."""

PER_NODE = 400
"""Bytes of memory for a value: its event, its node and its text."""

OPENCV_HEADER = "%YAML:1.0"
"""The first line that OpenCV writes: a directive of YAML would have a blank where it has a colon."""

_SPECIAL = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Scalar:
    """A value as it is written; ``quoted`` ones are texts."""

    text: str
    quoted: bool
    line: int

    @property
    def number(self) -> float | None:
        """The number that it is, if it is one."""
        if self.quoted:
            return None
        written = _SPECIAL.get(self.text.lower(), self.text)
        return float(written) if reads_as_number(written) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Items:
    """A list."""

    items: list[Node] = field(default_factory=list)
    line: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Entries:
    """A map, in the order of the file; ``tag`` is what stands behind ``!!``."""

    entries: dict[str, Node] = field(default_factory=dict)
    tag: str | None
    line: int


Node: TypeAlias = Scalar | Items | Entries


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """The content of a file, with its path as messages print it and its digest."""

    path: str
    sha256: str
    root: Node

    def fault(self, line: int | None, reason: str) -> MbmError:
        """What is wrong with the line, or the file."""
        return MbmError(format_faults.malformed_yaml(DataPlace(file=self.path, row=line), reason))


def read_document(path: Path, what: str) -> Document:
    """The one document in a file; ``what`` names the format that wants it.

    Raises MbmError as ``read_text`` does, and malformed-yaml; missing-extra without PyYAML.
    """
    shown = path.as_posix()
    try:
        import yaml
    except ImportError:
        raise MbmError(missing_extra(what, "yaml", DataPlace(file=shown))) from None
    text, digest = read_text(path, between=MARKS)
    cells = cells_in(text.encode(), MARKS)
    check_table(path, cells, PER_NODE * cells)
    if text.startswith(OPENCV_HEADER):
        text = "#" + text
    builder = _Builder(shown)
    try:
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            builder.add(type(event).__name__, event)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        reason = getattr(error, "problem", None) or str(error).split("\n", 1)[0]
        last = max(len(text.splitlines()), 1)  # what is missing at the end is missing in the line behind it
        place = DataPlace(file=shown, row=None if mark is None else min(mark.line + 1, last))
        raise MbmError(format_faults.malformed_yaml(place, reason)) from None
    if builder.root is None:
        raise MbmError(format_faults.malformed_yaml(DataPlace(file=shown), "it holds nothing"))
    return Document(path=shown, sha256=digest, root=builder.root)


class _Builder:
    """Puts nodes together while events come in."""

    def __init__(self, path: str) -> None:
        self.root: Node | None = None
        self._path = path
        self._open: list[tuple[Items | Entries, str | None]] = []
        self._keys: list[str | None] = []
        self._anchors: dict[str, Node] = {}

    def add(self, kind: str, event: Any) -> None:
        """The next event of ``kind``."""
        line = event.start_mark.line + 1
        if kind in ("SequenceStartEvent", "MappingStartEvent"):
            if len(self._open) == DEEPEST:
                raise self._fault(line, f"lists and maps stand more than {DEEPEST} deep in one another")
            tag = None if event.tag is None else str(event.tag).rpartition(":")[2]
            opened = Items(line=line) if kind == "SequenceStartEvent" else Entries(tag=tag, line=line)
            self._open.append((opened, event.anchor))
            self._keys.append(None)
        elif kind in ("SequenceEndEvent", "MappingEndEvent"):
            node, anchor = self._open.pop()
            self._keys.pop()
            self._put(node, anchor, line)
        elif kind == "ScalarEvent":
            quoted = event.style in ("'", '"')
            self._put(Scalar(text=event.value, quoted=quoted, line=line), event.anchor, line)
        elif kind == "AliasEvent":
            if event.anchor not in self._anchors:
                raise self._fault(line, f"the alias `{format_faults.shown(event.anchor)}` has no anchor before it")
            self._put(self._anchors[event.anchor], None, line)

    def _put(self, node: Node, anchor: str | None, line: int) -> None:
        if anchor is not None:
            self._anchors[anchor] = node
        if not self._open:
            if self.root is not None:
                raise self._fault(line, "it holds more than one document")
            self.root = node
            return
        owner, _ = self._open[-1]
        if isinstance(owner, Items):
            owner.items.append(node)
            return
        key = self._keys[-1]
        if key is not None:
            owner.entries[key] = node
            self._keys[-1] = None
        elif not isinstance(node, Scalar):
            raise self._fault(line, "a key is no text")
        elif node.text in owner.entries:
            raise self._fault(line, f"the key {format_faults.shown(node.text)} stands twice in one map")
        else:
            self._keys[-1] = node.text

    def _fault(self, line: int, reason: str) -> MbmError:
        return MbmError(format_faults.malformed_yaml(DataPlace(file=self._path, row=line), reason))


def numbers_in(node: Node, document: Document, what: str) -> list[float]:
    """The numbers of a list of numbers; ``what`` names it in messages."""
    if not isinstance(node, Items):
        raise document.fault(node.line, f"{what} is no list of numbers")
    found = []
    for item in node.items:
        number = item.number if isinstance(item, Scalar) else None
        if number is None:
            raise document.fault(item.line, f"{what} holds something that is no number")
        found.append(number)
    return found


def entries_of(node: Node, document: Document, what: str) -> Mapping[str, Node]:
    """The entries of a map."""
    if not isinstance(node, Entries):
        raise document.fault(node.line, f"{what} is no map")
    return node.entries
