"""PLY: a header says which elements follow, and which properties each has; text, or binary of either byte order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

import numpy as np

from mbm.shapes.meshes.types import MOST_CORNERS, DamagedMeshError, Mesh, check_count, mesh_of, numbers, text_of
from mbm.values import dataclass

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_LONGEST_HEADER, _MOST_PROPERTIES = 100_000, 256


@dataclass(frozen=True, slots=True, kw_only=True)
class _Property:
    """``count`` is the type of the length of a list; None: one number."""

    name: str
    kind: str
    count: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


def read(content: bytes) -> Mesh:
    """The mesh.

    Raises:
        DamagedMeshError: it is none.

    """
    order, elements, body = _header(content)
    source = _Text(body) if order == "" else _Binary(body, order)
    vertices: list[list[float]] = []
    faces: list[tuple[int, ...]] = []
    for element in elements:
        check_count(element.count, f"elements `{element.name[:40]}`")
        for row in _rows(element, source):
            if element.name == "vertex":
                vertices.append([_single(row, axis, element) for axis in "xyz"])
            elif element.name == "face":
                faces.append(_corners(row))
    return mesh_of(np.array(vertices, dtype=np.float64).reshape(-1, 3), faces)


def _single(row: dict[str, list[float]], name: str, element: _Element) -> float:
    found = row.get(name, [])
    if len(found) != 1:
        raise DamagedMeshError(f"the element `{element.name}` has no property `{name}`")
    return found[0]


def _corners(row: dict[str, list[float]]) -> tuple[int, ...]:
    found = next((row[name] for name in _INDICES if name in row), None)
    if found is None:
        raise DamagedMeshError("the element `face` has no list `vertex_indices`")
    if any(not np.isfinite(number) or number != int(number) for number in found):
        raise DamagedMeshError("a corner of a face is no whole number")
    return tuple(int(number) for number in found)


def _header(content: bytes) -> tuple[str, list[_Element], bytes]:
    """The byte order (empty: text), the elements, and what follows the header."""
    end = content[:_LONGEST_HEADER].find(b"end_header")
    line_end = content.find(b"\n", end)
    if not content.startswith(b"ply") or end < 0 or line_end < 0:
        raise DamagedMeshError("it has no header from `ply` to `end_header`")
    order: str | None = None
    elements: list[_Element] = []
    for line, written in enumerate(text_of(content[:end]).splitlines(), start=1):
        match written.split():
            case ["format", name, _] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 10:
                elements.append(_Element(name=name, count=int(count)))
            case ["property", "list", count, kind, name] if elements and {count, kind} <= _TYPES.keys():
                elements[-1].properties.append(_Property(name=name, kind=_TYPES[kind], count=_TYPES[count]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name=name, kind=_TYPES[kind], count=None))
            case [] | ["ply"] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise DamagedMeshError(f"`{written.strip()[:60]}` is no line of a header", line)
    if order is None:
        raise DamagedMeshError("its header names no known `format`")
    if any(not 0 < len(element.properties) <= _MOST_PROPERTIES for element in elements):
        raise DamagedMeshError(f"an element has no properties, or more than {_MOST_PROPERTIES}")
    return order, elements, content[line_end + 1 :]


class _Text:
    """The numbers of a text, one after the other."""

    def __init__(self, body: bytes) -> None:
        self._words = text_of(body).split()
        self._place = 0

    def take(self, kind: str, count: int) -> list[float]:
        """The next ``count`` numbers."""
        words = self._words[self._place : self._place + count]
        if len(words) < count:
            raise DamagedMeshError("it ends before all elements that its header counts")
        self._place += count
        found = numbers(words)
        if found is None:
            raise DamagedMeshError(f"numbers are wanted, not `{' '.join(words)[:60]}`")
        return found


class _Binary:
    """The numbers of a binary body."""

    def __init__(self, body: bytes, order: str) -> None:
        self._body = body
        self._order = order
        self._place = 0

    def take(self, kind: str, count: int) -> list[float]:
        """The next ``count`` numbers."""
        size = np.dtype(kind).itemsize
        if self._place + count * size > len(self._body):
            raise DamagedMeshError("it ends before all elements that its header counts")
        found = np.frombuffer(self._body, dtype=self._order + kind, count=count, offset=self._place)
        self._place += count * size
        return [float(number) for number in found]


def _rows(element: _Element, source: _Text | _Binary) -> Iterator[dict[str, list[float]]]:
    """The properties of each element by name."""
    for _ in range(element.count):
        row = {}
        for each in element.properties:
            length = 1.0 if each.count is None else source.take(each.count, 1)[0]
            if not 0 <= length <= MOST_CORNERS or length != int(length):
                raise DamagedMeshError(f"a list of {length:g} numbers; {MOST_CORNERS:,} are read at most")
            row[each.name] = source.take(each.kind, int(length))
        yield row
