"""``(mesh "part.stl" [:unit mm])``: a shape whose vertices, lines and planes stand in a file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from hashlib import sha256
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nets import Net
from mbm.expression.nodes import Number
from mbm.expression.units import TAKE_PREFIXES, parse_unit
from mbm.files.memory import check_memory, largest_file, text_memory
from mbm.files.reading import read_bytes
from mbm.language import faults as language_faults
from mbm.language.limits import resolved_inside
from mbm.language.session import FileReader, Program, ReadFile
from mbm.language.values import Array, Call, Callable_
from mbm.shapes import faults
from mbm.shapes.meshes import obj, ply, stl
from mbm.shapes.meshes.types import DamagedMeshError, Mesh
from mbm.shapes.types import Shape, Surface
from mbm.text.types import Form, Keyword, MbmError, Span, Symbol, Text
from mbm.values import dataclass

USAGE = '(mesh "part.stl" [:unit mm])'

LENGTH = TAKE_PREFIXES["m"].dimension

LARGEST = 50_000_000
"""Bytes of a file: a hundred thousand triangles take some 30 MB as text."""

V = TypeVar("V", bound=Array | tuple[int, ...])

READERS: Mapping[str, Callable[[bytes], Mesh]] = MappingProxyType(
    {".stl": stl.read, ".obj": obj.read, ".ply": ply.read}
)
"""By the ending of the name."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshMaker(FileReader):
    """The function ``mesh`` of a program; ``known`` are the meshes that it has made, by path and unit."""

    program: Program | None = None
    read: list[ReadFile] = field(default_factory=list)
    known: dict[tuple[Path, float], Surface] = field(default_factory=dict)
    name: str = "mesh"
    usage: str = USAGE
    doc: str = "The shape in a file: STL, OBJ or PLY. Lengths are in m, or in the unit that is stated."

    def within(self, program: Program, read: list[ReadFile]) -> Callable_:
        """The function where the forms of ``program`` are evaluated; files are added to ``read``."""
        return MeshMaker(program, read, {})

    def call(self, call: Call) -> Shape:
        """The shape.

        Raises:
            MbmError: bad-form, unknown-unit, what reading a file raises, damaged-mesh.

        """
        written, factor = _arguments(call)
        if self.program is None:
            raise TypeError(self.name)
        path, resolved = _place(self.program, written)
        reader = _reader(path, written.span)
        found = self.known.get((resolved, factor))
        if found is None:
            content = read_bytes(path, written.span, largest=min(LARGEST, largest_file()))
            words = content.count(b" ") + content.count(b"\n")
            check_memory(text_memory(content, words), f"the mesh of {len(content):,} bytes", written.span)
            self.read.append(ReadFile(path=path, resolved=resolved, sha256=sha256(content).hexdigest()))
            found = self.known[resolved, factor] = _surface(
                _mesh(reader, path, content, written.span), factor, call.span
            )
        return Shape(content=found, span=call.span)


def _arguments(call: Call) -> tuple[Text, float]:
    """The path as it is written, and the length of one unit in m."""
    if len(call.forms) not in (1, 3) or not isinstance(call.forms[0], Text):
        raise MbmError(language_faults.bad_form(call.span, "`mesh` takes the path of a file, as a text", USAGE))
    if len(call.forms) == 1:
        return call.forms[0], 1.0
    option, unit = call.forms[1:]
    if not isinstance(option, Keyword) or option.name != "unit":
        raise MbmError(language_faults.bad_form(option.span, "the option of a mesh is `:unit`", USAGE))
    return call.forms[0], _length(unit)


def _length(form: Form) -> float:
    unit = parse_unit(form.name) if isinstance(form, Symbol) else None
    if unit is None or unit.dimension != LENGTH:
        raise MbmError(language_faults.bad_form(form.span, "the unit of a mesh is a unit of length", USAGE))
    return unit.scale.factor


def _place(program: Program, written: Text) -> tuple[Path, Path]:
    """The file, relative to the one in which the form stands, and where that leads."""
    source = written.span.source
    folder = program.base if source is program.source else Path(source.name).parent
    path = folder / written.value
    return path, resolved_inside(program.sandbox, path, written)


def _reader(path: Path, span: Span) -> Callable[[bytes], Mesh]:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MbmError(faults.damaged_mesh(span, path, "its name ends in none of " + " ".join(READERS), None))
    return reader


def _mesh(reader: Callable[[bytes], Mesh], path: Path, content: bytes, span: Span) -> Mesh:
    try:
        return reader(content)
    except DamagedMeshError as error:
        raise MbmError(faults.damaged_mesh(span, path, error.message, error.line)) from None


@dataclass(frozen=True, slots=True, eq=False)
class _Numbered(Mapping[int, V]):
    """Features by their numbers, from 1; each is made when it is asked for, of row ``number - 1``."""

    count: int
    make: Callable[[int], V]

    def __getitem__(self, number: int) -> V:
        """The feature. Raises KeyError."""
        if not 1 <= number <= self.count:
            raise KeyError(number)
        return self.make(number - 1)

    def __iter__(self) -> Iterator[int]:
        return iter(range(1, self.count + 1))

    def __len__(self) -> int:
        return self.count


def _surface(mesh: Mesh, factor: float, span: Span) -> Surface:
    """The features of a mesh, numbered from 1."""
    scaled = Mesh(vertices=factor * mesh.vertices, faces=mesh.faces)
    net = net_of(scaled)
    bent = net.edges[_bent(net)]
    return Surface(
        vertexes=_Numbered(
            len(net.points), lambda i: Array((3,), tuple(Number(x, LENGTH) for x in net.points[i].tolist()))
        ),
        lines=_Numbered(len(bent), lambda i: tuple((bent[i] + 1).tolist())),
        planes=_Numbered(len(mesh.faces), lambda i: tuple(corner + 1 for corner in mesh.faces[i])),
        span=span,
        net=net_of(with_flat_faces(scaled, net)),
    )


OFF_PLANE = 1e-6
"""Of its size: how far a corner of a face may be from its plane, by rounding to single precision."""


def with_flat_faces(mesh: Mesh, net: Net) -> Mesh:
    """The mesh with faces that are no plane as triangles around one of their corners, as most programs draw them.

    It is the first corner from which no triangle is turned over; a face without such a corner stays.
    """
    faces = [face for face in mesh.faces if len(set(face)) > 1]  # those that the net has
    counts = np.array([len(face) for face in faces], dtype=np.int64)
    if not len(faces) or counts.max() == 3:
        return mesh
    owner = np.repeat(np.arange(len(net.first)), np.diff(net.first, append=len(net.sides)))
    normals = _normals(net, owner)
    corners = net.points[np.where(net.along, *net.edges[net.sides].T)]
    away = corners - corners[net.first][owner]
    heights, sizes = (
        np.maximum.reduceat(each, net.first)
        for each in (np.abs(np.einsum("ij,ij->i", away, normals[owner])), np.abs(away).max(axis=1))
    )
    bent = heights > OFF_PLANE * sizes
    found = [face for face, apart in zip(faces, bent.tolist(), strict=True) if not apart]
    for count in np.unique(counts[bent]).tolist():
        own = np.flatnonzero(bent & (counts == count))
        found.extend(_triangles(mesh.vertices, np.array([faces[k] for k in own.tolist()]), normals[own]))
    return Mesh(vertices=mesh.vertices, faces=tuple(found))


def _triangles(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], normals: NDArray[np.float64]
) -> Iterator[tuple[int, ...]]:
    """Triangles that faces (k, corners) are made of; those faces that no corner sees whole."""
    for first in range(faces.shape[1]):
        turned = np.roll(faces, -first, axis=1)
        ways = vertices[turned[:, 1:]] - vertices[turned[:, :1]]
        fits = (np.einsum("kci,ki->kc", np.cross(ways[:, :-1], ways[:, 1:]), normals) > 0).all(axis=1)
        for corner in range(1, faces.shape[1] - 1):
            yield from map(tuple, turned[fits][:, [0, corner, corner + 1]].tolist())
        faces, normals = faces[~fits], normals[~fits]
    yield from map(tuple, faces.tolist())


def net_of(mesh: Mesh) -> Net:
    """The points and faces of a mesh as columns; corners that come twice in a row are one."""
    counts = np.array([len(face) for face in mesh.faces], dtype=np.int64)
    corners = np.fromiter(chain.from_iterable(mesh.faces), dtype=np.int64, count=int(counts.sum()))
    begin = np.cumsum(counts) - counts
    after = np.arange(1, len(corners) + 1)
    after[begin + counts - 1] = begin
    low, high = np.minimum(corners, corners[after]), np.maximum(corners, corners[after])
    kept = low != high
    count = len(mesh.vertices)
    codes, sides = np.unique(low[kept] * count + high[kept], return_inverse=True)
    owner = np.repeat(np.arange(len(counts)), counts)[kept]
    digest = sha256(mesh.vertices.tobytes())
    digest.update(corners.tobytes())
    digest.update(counts.tobytes())
    return Net(
        key=digest.hexdigest(),
        points=mesh.vertices,
        edges=np.stack([codes // count, codes % count], axis=1),
        sides=sides.reshape(-1),
        along=(corners < corners[after])[kept],
        first=np.flatnonzero(np.diff(owner, prepend=-1)),
    )


LEAST_ANGLE = np.deg2rad(1.0)
"""Faces that meet at less are one surface."""


def edges(mesh: Mesh) -> list[tuple[int, int]]:
    """The edges (positions from 0, the lower first) between faces that meet at more than `LEAST_ANGLE`, in order."""
    net = net_of(mesh)
    return [(a, b) for a, b in net.edges[_bent(net)].tolist()]


def _bent(net: Net) -> NDArray[np.bool_]:
    """At which edges one of the faces meets the first at an angle.

    Two faces that run along it in the same direction are seen from different sides: one of them is turned over.
    """
    found = np.zeros(len(net.edges), dtype=bool)
    if not len(net.first):
        return found
    with np.errstate(all="ignore"):  # of coordinates near the largest numbers squares are infinite
        owner = np.repeat(np.arange(len(net.first)), np.diff(net.first, append=len(net.sides)))
        normals = _normals(net, owner)
        order = np.argsort(net.sides, kind="stable")
        side, along, normal = net.sides[order], net.along[order], normals[owner[order]]
        begin = np.flatnonzero(np.diff(side, prepend=-1))
        reference = np.repeat(begin, np.diff(begin, append=len(side)))
        a, b = normal[reference], normal * np.where(along == along[reference], -1.0, 1.0)[:, None]
        angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
        found[side[(angles > LEAST_ANGLE) & (reference != np.arange(len(side)))]] = True
    return found


def _normals(net: Net, owner: NDArray[np.int64]) -> NDArray[np.float64]:
    """The directions (faces, 3) that polygons face, of length 1 or zero (Newell)."""
    begin, end = net.edges[net.sides].T
    corners = net.points[np.where(net.along, begin, end)]
    away = corners - corners[net.first][owner]
    after = np.append(away[1:], away[:1], axis=0)
    after[net.first - 1] = 0  # behind the last corner comes the first one again
    total = np.add.reduceat(np.cross(away, after), net.first, axis=0)
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, lengths, out=total, where=lengths > 0))
