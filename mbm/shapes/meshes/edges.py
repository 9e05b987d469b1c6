"""The edges of a mesh: where two faces meet at an angle."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbm.shapes.meshes.types import Mesh

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
