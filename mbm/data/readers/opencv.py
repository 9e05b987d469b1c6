"""OpenCV's FileStorage as YAML: ``(opencv "f.yml" "node")``, ``(opencv "f.yml" "outer.inner")``, ``(opencv "f.yml")``.

A matrix is a table of its rows with the columns ``c1 c2 …`` (its channels one after the other) and the vector ``c`` of
them all; so is a list of numbers, or of lists of numbers of one length. A map, and the file itself, is one row: its
numbers and texts are columns, its matrices and lists of numbers vectors or matrices, ``camera_matrix`` with the columns
``camera_matrix11 …``; other nodes in it have to be asked for by name. Rows count from 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mbm.data.cells import check_names, column_from_values, row_numbers
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import number_columns
from mbm.data.readers.yaml_nodes import Document, Entries, Items, Node, Scalar, entries_of, numbers_in, read_document
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Column, ColumnGroup, Numbers
from mbm.text.types import DataPlace, MbmError

MATRIX = "opencv-matrix"
DEPTHS = "ucwsifdh"
"""The types of elements, behind the number of channels in ``dt``."""

MOST_CHANNELS = 512
"""Channels of a matrix of OpenCV."""


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """The tables of a file by the names of their nodes.

    Raises MbmError as ``read_document`` does; in the place of a table malformed-yaml, no-records.
    """
    return _Nodes(read_document(path, "the format `opencv`"))


class _Nodes(Mapping[str, "RawTable | MbmError"]):
    """Tables that are made when they are asked for: whatever a file holds, nobody can list what may be asked."""

    def __init__(self, document: Document) -> None:
        self._document = document

    def __getitem__(self, name: str) -> RawTable | MbmError:
        try:
            return _table(_node(self._document, name), self._document, name)
        except MbmError as error:
            return error

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str)

    def __iter__(self) -> Iterator[str]:
        root = self._document.root
        return iter(root.entries if isinstance(root, Entries) else ())

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _node(document: Document, name: str) -> Node:
    """The node of a name, whose parts are separated by points."""
    node = document.root
    for part in name.split(".") if name else ():
        entries = node.entries if isinstance(node, Entries) else {}
        if part not in entries:
            raise MbmError(format_faults.no_node(DataPlace(file=document.path), name, part, entries))
        node = entries[part]
    return node


def _table(node: Node, document: Document, name: str) -> RawTable:
    what = f"the node {format_faults.shown(name)}" if name else "the file"
    if isinstance(node, Entries) and node.tag != MATRIX:
        return _of_map(node, document, what)
    if isinstance(node, Scalar):
        cells = node.text if node.number is None else node.number
        columns: tuple[Column, ...] = (column_from_values("value", [cells], document.path),)
        return _made(document, columns, 1, {})
    numbers = _matrix(node, document, what)
    names = tuple(f"c{i + 1}" for i in range(numbers.shape[1]))
    check_names(names, DataPlace(file=document.path, row=node.line))
    groups = {"c": ColumnGroup(shape=(len(names),), columns=names)}
    return _made(document, number_columns(names, numbers), len(numbers), groups)


def _of_map(node: Entries, document: Document, what: str) -> RawTable:
    """One row of all that is a number, a text, a matrix or a list of numbers."""
    columns: list[Column] = []
    groups: dict[str, ColumnGroup] = {}
    for name, entry in node.entries.items():
        if isinstance(entry, Scalar):
            cell = entry.text if entry.number is None else entry.number
            columns.append(column_from_values(name, [cell], document.path))
        elif (isinstance(entry, Entries) and entry.tag == MATRIX) or (isinstance(entry, Items) and _is_numbers(entry)):
            numbers = _matrix(entry, document, f"`{name}`")
            if not numbers.size:
                continue
            rows, width = numbers.shape
            flat = min(rows, width) == 1
            shape = (numbers.size,) if flat else (rows, width)
            places = [f"{i + 1}" for i in range(numbers.size)] if flat else _places(rows, width)
            names = tuple(f"{name}{place}" for place in places)
            columns += number_columns(names, numbers.reshape(1, -1))
            groups[name] = ColumnGroup(shape=shape, columns=names)
    if not columns:
        raise MbmError(format_faults.no_records(DataPlace(file=document.path), f"numbers or texts in {what}"))
    check_names([column.name for column in columns], DataPlace(file=document.path, row=node.line))
    return _made(document, tuple(columns), 1, groups)


def _places(rows: int, width: int) -> list[str]:
    """What elements of a matrix are called, as in other formats: ``11``; with a ``_`` where that would be unclear."""
    between = "" if max(rows, width) < 10 else "_"
    return [f"{i + 1}{between}{j + 1}" for i in range(rows) for j in range(width)]


def _is_numbers(node: Items) -> bool:
    return bool(node.items) and all(isinstance(item, Scalar) and item.number is not None for item in node.items)


def _matrix(node: Node, document: Document, what: str) -> Numbers:
    """The numbers (rows, columns × channels) of a matrix, or of a list of numbers or of lists of them."""
    if isinstance(node, Items):
        if all(isinstance(item, Scalar) for item in node.items):
            return np.array(numbers_in(node, document, what), dtype=np.float64).reshape(-1, 1)
        lists = [numbers_in(item, document, what) for item in node.items]
        if len({len(each) for each in lists}) != 1 or not lists[0]:
            raise document.fault(node.line, f"the lists in {what} have different lengths, or none")
        return np.array(lists, dtype=np.float64)
    entries = entries_of(node, document, what)
    if not isinstance(node, Entries) or node.tag != MATRIX:
        raise document.fault(node.line, f"{what} is no matrix")
    rows, width = (_count(entries, key, document, node.line, what) for key in ("rows", "cols"))
    channels = _channels(entries.get("dt"), document, node.line, what)
    data = entries.get("data", Items(line=node.line))
    numbers = np.array(numbers_in(data, document, f"the data of {what}"), dtype=np.float64)
    if len(numbers) != rows * width * channels:
        said = f"{what} has {rows} rows, {width} columns, {channels} channels, but {len(numbers)} numbers"
        raise document.fault(data.line, said)
    return numbers.reshape(rows, width * channels)


def _count(entries: Mapping[str, Node], key: str, document: Document, line: int, what: str) -> int:
    node = entries.get(key)
    number = node.number if isinstance(node, Scalar) else None
    if number is None or not number.is_integer() or not 0 <= number < 2**31:
        raise document.fault(line if node is None else node.line, f"{what} states no number of `{key}`")
    return int(number)


def _channels(node: Node | None, document: Document, line: int, what: str) -> int:
    """The channels that ``dt`` states: ``d``, ``2f`` or ``"3u"``."""
    text = node.text if isinstance(node, Scalar) else ""
    number, depth = text[:-1], text[-1:]
    if not depth or depth not in DEPTHS or not (number == "" or (number.isascii() and number.isdigit())):
        raise document.fault(
            line, f"the type `dt` of {what} is {format_faults.shown(text)}; one is read such as `d`, `2f`"
        )
    channels = int(number[:4] or 1)
    if len(number) > 3 or not 1 <= channels <= MOST_CHANNELS:
        raise document.fault(
            line, f"{what} has {format_faults.shown(number)} channels; OpenCV has {MOST_CHANNELS} at most"
        )
    return channels


def _made(document: Document, columns: tuple[Column, ...], rows: int, groups: Mapping[str, ColumnGroup]) -> RawTable:
    return RawTable(
        path=document.path, sha256=document.sha256, columns=columns, file_rows=row_numbers(1, rows), groups=groups
    )


READER = ManyReader(name="opencv", extensions=(), parts=(), read=read, named=True)
