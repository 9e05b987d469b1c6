"""STL: triangles one by one. Corners with equal coordinates are one vertex, numbered as they first occur.

Binary: 80 bytes of anything, a count, and 50 bytes for each triangle. Text: ``facet … vertex x y z … endfacet``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.shapes.meshes.types import DamagedMeshError, Mesh, check_count, coordinates, mesh_of, text_of

_HEADER = 84
_TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read(content: bytes) -> Mesh:
    """The mesh.

    Raises:
        DamagedMeshError: it is none.

    """
    count = int.from_bytes(content[80:_HEADER], "little") if len(content) >= _HEADER else -1
    if len(content) == _HEADER + count * _TRIANGLE.itemsize:
        check_count(count, "faces")
        triangles = np.frombuffer(content, dtype=_TRIANGLE, offset=_HEADER)
        return _joined(triangles["corners"].reshape(-1, 3).astype(np.float64))
    if content.lstrip()[:5].lower() == b"solid":
        return _joined(_written(text_of(content)))
    if count < 0:
        raise DamagedMeshError("it neither begins with `solid` nor has the 84 bytes of a binary header")
    expected = _HEADER + count * _TRIANGLE.itemsize
    raise DamagedMeshError(f"its header counts {count:,} triangles, {expected:,} bytes; it has {len(content):,}")


def _written(text: str) -> NDArray[np.float64]:
    """The corners (3 n, 3) of a text."""
    corners: list[tuple[float, float, float]] = []
    open_line, ended = 0, False
    for line, written in enumerate(text.splitlines(), start=1):
        words = written.split()
        keyword = words[0].lower() if words else ""
        if keyword == "vertex":
            corners.append(coordinates(words[1:], line))
            check_count(len(corners) // 3, "faces")
        elif keyword == "facet":
            open_line = line
        elif keyword == "endfacet":
            if len(corners) % 3 or not open_line:
                raise DamagedMeshError("a facet does not have three vertices", line)
            open_line = 0
        ended = ended or keyword == "endsolid"
    if open_line or len(corners) % 3 or not ended:
        raise DamagedMeshError("it ends within a facet or without `endsolid`")
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _joined(corners: NDArray[np.float64]) -> Mesh:
    """Vertices of different coordinates in the order in which they first occur."""
    if not len(corners):
        raise DamagedMeshError("there are no triangles")
    _, first, inverse = np.unique(corners + 0.0, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    faces = [tuple(map(int, face)) for face in place[inverse.reshape(-1)].reshape(-1, 3)]
    return mesh_of(corners[first[order]], faces)
