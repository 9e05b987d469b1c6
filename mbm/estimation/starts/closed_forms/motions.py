"""Rotations and poses as the numbers that hold them: steps, products, inverses, row by row."""

from __future__ import annotations

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.manifolds import moved
from mbm.equations.types import Floats
from mbm.problem.manifold import Piece
from mbm.rotations import hamilton


def origin(entry: Entry) -> Floats:
    """No motion: the numbers (s,) of the identity; some direction."""
    found = np.zeros(entry.unknown.size)
    for piece, number, _ in entry.unknown.manifold.spans():
        if piece is not Piece.NUMBER:
            found[number] = 1.0
    return found


def stepped(entry: Entry, numbers: Floats, step: Floats) -> Floats:
    """Numbers (n, s) after steps (n, q) of their coordinates."""
    result = numbers.copy()
    for piece, number, coordinate in entry.unknown.manifold.spans():
        places = slice(number, number + piece.size)
        result[:, places] = moved(piece, numbers[:, places], step[:, coordinate : coordinate + piece.tangent])
    return result


def product(entry: Entry, first: Floats, second: Floats) -> Floats:
    """The motions (n, s) first ∘ second."""
    if entry.unknown.dimension == 3:
        q = hamilton(first[:, :4], second[:, :4])
        shift = _rotated(first[:, :4], second[:, 4:]) + first[:, 4:] if second.shape[1] > 4 else second[:, 4:]
        return np.hstack([q, shift])
    c, s = np.cos(first[:, 0]), np.sin(first[:, 0])
    result = np.empty_like(second)
    result[:, 0] = np.remainder(first[:, 0] + second[:, 0] + np.pi, 2 * np.pi) - np.pi
    if second.shape[1] > 1:
        x, y = second[:, 1], second[:, 2]
        result[:, 1], result[:, 2] = first[:, 1] + c * x - s * y, first[:, 2] + s * x + c * y
    return result


def inverse(entry: Entry, numbers: Floats) -> Floats:
    """The inverse motions (n, s)."""
    result = numbers.copy()
    if entry.unknown.dimension == 3:
        result[:, 1:4] *= -1.0
        if numbers.shape[1] > 4:
            result[:, 4:] = -_rotated(result[:, :4], numbers[:, 4:])
        return result
    result[:, 0] *= -1.0
    if numbers.shape[1] > 1:
        c, s = np.cos(result[:, 0]), np.sin(result[:, 0])
        result[:, 1] = -(c * numbers[:, 1] - s * numbers[:, 2])
        result[:, 2] = -(s * numbers[:, 1] + c * numbers[:, 2])
    return result


def _rotated(q: Floats, v: Floats) -> Floats:
    """Vectors (n, 3) turned by unit quaternions (n, 4)."""
    twice = 2.0 * np.cross(q[:, 1:], v)
    return np.asarray(v + q[:, :1] * twice + np.cross(q[:, 1:], twice))
