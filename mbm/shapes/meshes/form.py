"""``(mesh "part.stl" [:unit mm])``: a shape whose vertices, lines and planes stand in a file."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import field
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Number
from mbm.expression.units import TAKE_PREFIXES, parse_unit
from mbm.files.faults import unreadable_file
from mbm.files.memory import check_memory, largest_file, text_memory
from mbm.files.reading import read_bytes
from mbm.language import faults as language_faults
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
            found = self.known[resolved, factor] = _surface(_mesh(reader, path, content, written.span), factor, call)
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
    try:
        resolved = path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a name that no file can have
        raise MbmError(unreadable_file(path, str(error), written.span)) from None
    if program.sandbox is not None and not resolved.is_relative_to(program.sandbox.resolve()):
        raise MbmError(language_faults.outside_sandbox(written.span, written.value))
    return path, resolved


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


def _surface(mesh: Mesh, factor: float, call: Call) -> Surface:
    """The features of a mesh, numbered from 1."""
    call.evaluator.budget.make(3 * len(mesh.vertices), call.form)
    rows = (factor * mesh.vertices).tolist()
    vertexes = {i: Array((3,), tuple(Number(x, LENGTH) for x in row)) for i, row in enumerate(rows, start=1)}
    lines = {i: (a + 1, b + 1) for i, (a, b) in enumerate(edges(mesh), start=1)}
    planes = {i: tuple(corner + 1 for corner in face) for i, face in enumerate(mesh.faces, start=1)}
    return Surface(vertexes=vertexes, lines=lines, planes=planes, span=call.span)


LEAST_ANGLE = np.deg2rad(1.0)
"""Faces that meet at less are one surface."""


def edges(mesh: Mesh) -> list[tuple[int, int]]:
    """The edges (positions from 0, the lower first) between faces that meet at more than `LEAST_ANGLE`, in order."""
    with np.errstate(all="ignore"):  # of coordinates near the largest numbers squares are infinite
        normals = [_normal(mesh.vertices[list(face)]) for face in mesh.faces]
    beside: dict[tuple[int, int], list[tuple[int, bool]]] = defaultdict(list)
    for number, face in enumerate(mesh.faces):
        for a, b in pairwise((*face, face[0])):
            if a != b:
                beside[min(a, b), max(a, b)].append((number, a < b))
    with np.errstate(all="ignore"):
        return sorted(edge for edge, faces in beside.items() if _bent(faces, normals))


def _bent(faces: list[tuple[int, bool]], normals: list[NDArray[np.float64]]) -> bool:
    """Whether one of the faces at an edge meets the first at an angle.

    Two faces that run along it in the same direction are seen from different sides: one of them is turned over.
    """
    one, forward = faces[0]
    for other, along in faces[1:]:
        a, b = normals[one], normals[other] * (-1.0 if forward == along else 1.0)
        if np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b) > LEAST_ANGLE:
            return True
    return False


def _normal(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction a polygon faces, of length 1 or zero (Newell)."""
    away = corners - corners[0]
    total = np.cross(away, np.roll(away, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length if length > 0 else total)
