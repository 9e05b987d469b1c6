"""OBJ of Wavefront: ``v x y z`` and ``f a b c …``. Textures, normals, groups and materials say nothing of the shape.

Files of materials that it names are not read.
"""

from __future__ import annotations

import numpy as np

from mbm.shapes.meshes.types import MOST_CORNERS, DamagedMeshError, Mesh, check_count, coordinates, mesh_of, text_of


def read(content: bytes) -> Mesh:
    """The mesh.

    Raises:
        DamagedMeshError: it is none.

    """
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for line, written in enumerate(text_of(content).splitlines(), start=1):
        words = written.split("#", 1)[0].split()
        if not words:
            continue
        if words[-1] == "\\":
            raise DamagedMeshError("lines that go on in the next one are not read", line)
        if words[0] == "v":
            vertices.append(coordinates(words[1:4], line))
            check_count(len(vertices), "vertices")
        elif words[0] == "f":
            if len(words) - 1 > MOST_CORNERS:
                raise DamagedMeshError(f"a face has more than {MOST_CORNERS:,} corners", line)
            faces.append(tuple(_corner(word, len(vertices), line) for word in words[1:]))
            check_count(len(faces), "faces")
    return mesh_of(np.array(vertices, dtype=np.float64).reshape(-1, 3), faces)


def _corner(word: str, count: int, line: int) -> int:
    """The position of a vertex from ``7``, ``7/1/3``, ``7//3``; negative ones count back from the last so far."""
    text = word.split("/", 1)[0]
    try:
        number = int(text) if text.isascii() and len(text) < 12 else 0
    except ValueError:
        number = 0
    if number == 0 or number < -count:
        raise DamagedMeshError(f"`{word[:40]}` names no vertex", line)
    return number - 1 if number > 0 else count + number
