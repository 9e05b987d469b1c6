"""Volumes, areas and edges of bodies from their faces, with NumPy alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Component
from mbm.shapes.types import Group, ModelCall, Node, Patch, Surface, SweptSide

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
STEP, DIFFERENCE = 1e-2, {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
"""Sixth-order differences: what they leave of a smooth side of size 1 is about 1e-12."""


def pieces(node: Node) -> Iterator[Surface | SweptSide]:
    """The surfaces and sides of a body without transforms."""
    if isinstance(node, Group | ModelCall):
        for child in node.children:
            yield from pieces(child)
    elif isinstance(node, Surface | SweptSide):
        yield node


def coordinates(point, at: dict[object, object]) -> np.ndarray:
    """A point whose leaves have the values ``at``: unknowns by name, parameters themselves."""
    values = evaluate(tuple(point), lambda leaf: at[leaf.unknown if isinstance(leaf, Component) else leaf])
    return np.stack(np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in values)), axis=-1)


def vertexes(surface: Surface, at: dict[object, object] | None = None) -> dict[int, np.ndarray]:
    """The points of a surface by number."""
    return {n: coordinates(p.elements, at or {}) for n, p in surface.vertexes.items()}


def volume(node: Node, at: dict[object, object] | None = None) -> float:
    """∮ p·n dA / 3 over the faces and the smooth sides."""
    total = 0.0
    for piece in pieces(node):
        if isinstance(piece, Surface):
            points = vertexes(piece, at)
            for face in piece.planes.values():
                a, *rest = (points[n] for n in face)
                total += sum(np.dot(a, np.cross(b, c)) for b, c in pairwise(rest)) / 6
        else:
            total += sum(_flux(patch, at or {}) for patch in piece.patches)
    return total


def area(node: Node, at: dict[object, object] | None = None) -> float:
    """The area of the smooth sides."""
    sides = [piece for piece in pieces(node) if isinstance(piece, SweptSide)]
    return sum(_integral(p, at or {}, lambda _, n: np.linalg.norm(n, axis=-1)) for s in sides for p in s.patches)


def _flux(patch: Patch, at: dict[object, object]) -> float:
    return _integral(patch, at, lambda p, n: np.sum(p * n, axis=-1) / 3)


def _integral(patch: Patch, at: dict[object, object], function) -> float:
    """∬ function(p, ∂p/∂u × ∂p/∂v) du dv by Gauss' rule."""
    ends = [[float(coordinates((e,), at)[..., 0]) for e in side[1:]] for side in (patch.first, patch.second)]
    (u0, u1), (v0, v1) = ends
    u, v = np.meshgrid((u0 + u1) / 2 + NODES * (u1 - u0) / 2, (v0 + v1) / 2 + NODES * (v1 - v0) / 2, indexing="ij")
    weights = np.outer(WEIGHTS, WEIGHTS) * (u1 - u0) * (v1 - v0) / 4

    def place(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return coordinates(patch.point, {**at, patch.first[0]: u, patch.second[0]: v})

    def slope(du: float, dv: float) -> np.ndarray:
        terms = [w * (place(u + k * du, v + k * dv) - place(u - k * du, v - k * dv)) for k, w in DIFFERENCE.items()]
        return np.sum(terms, axis=0) / STEP

    normal = np.cross(slope(STEP, 0), slope(0, STEP))
    return float(np.sum(weights * function(place(u, v), normal)))


def is_closed(surface: Surface) -> bool:
    """Whether each edge of a face is one of another face, run through the other way: a closed, oriented surface."""
    edges = Counter((a, b) for face in surface.planes.values() for a, b in zip(face, (*face[1:], face[0]), strict=True))
    return all(count == 1 for count in edges.values()) and all((b, a) in edges for a, b in edges)


def euler_characteristic(surface: Surface) -> int:
    """Vertexes − lines + planes."""
    return len(surface.vertexes) - len(surface.lines) + len(surface.planes)
