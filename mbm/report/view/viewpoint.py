"""From where a model is seen, and the outlines of smooth surfaces from there."""

from __future__ import annotations

import math

import numpy as np

from mbm.report.types import Floats
from mbm.values import dataclass

AZIMUTH, ELEVATION = 28.0, 24.0
"""Degrees: the viewer stands before +x, turned to +y, and above. No edge of a box hides another from there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """A parallel projection: ``axes`` (3, 3) are the picture's right, its up, and the way to the viewer, in space."""

    axes: Floats

    @staticmethod
    def at(azimuth: float = AZIMUTH, elevation: float = ELEVATION) -> View:
        """The view from a direction in degrees, with z of space up; from straight above, y is up."""
        a, e = math.radians(azimuth), math.radians(elevation)
        right = [-math.sin(a), math.cos(a), 0.0]
        toward = [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)]
        return View(axes=np.array([right, np.cross(toward, right), toward]))

    @staticmethod
    def beside(back: Floats, up: Floats, turn: float = 50.0, elevation: float = ELEVATION) -> View:
        """The view from the direction ``back`` (3,), turned about ``up`` (3,) by degrees, and from above."""
        level = back - (back @ up) * up
        length = float(np.linalg.norm(level))
        level = level / length if length > 1e-9 * float(np.linalg.norm(back)) else np.roll(up, 1)
        side, angle, height = np.cross(up, level), math.radians(turn), math.radians(elevation)
        level = math.cos(angle) * level + math.sin(angle) * side
        toward = math.cos(height) * level + math.sin(height) * up
        right = np.cross(up, level)
        return View(axes=np.array([right, np.cross(toward, right), toward]))

    @property
    def upright(self) -> int:
        """The axis of space (0, 1, 2) that is seen upright."""
        return int(np.argmax(np.abs(self.axes[1])))

    def of(self, points: Floats) -> Floats:
        """Points (…, 3) of space in the frame of the picture: right, up, toward the viewer."""
        return np.asarray(points @ self.axes.T)


def outlines(patch: Floats) -> tuple[Floats, ...]:
    """The lines (n, 3) along which a smooth patch (n, m, 3) in the frame of the picture turns away from the viewer."""
    from contourpy import LineType, contour_generator

    normals = _normals(patch)
    facing = normals[:, :, 2] / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)
    if facing.min() > -1e-9 or facing.max() < 1e-9:
        return ()
    lines = contour_generator(z=facing, line_type=LineType.Separate).lines(0.0)
    return tuple(_interpolated(patch, np.asarray(line)) for line in lines if len(line) > 1)


def _normals(patch: Floats) -> Floats:
    """Normals (n, m, 3) of a grid; at a pole, where a row is one point, those of the row beside."""
    along, across = np.gradient(patch, axis=0), np.gradient(patch, axis=1)
    normals = np.cross(along, across)
    length = np.linalg.norm(normals, axis=2)
    least = 1e-9 * max(float(length.max()), 1e-300)
    for axis in (0, 1):
        for end, beside in ((0, 1), (-1, -2)):
            view = np.moveaxis(normals, axis, 0)
            gone = np.linalg.norm(view[end], axis=1) < least
            view[end][gone] = view[beside][gone]
    return np.asarray(normals)


def _interpolated(patch: Floats, line: Floats) -> Floats:
    """Points of a grid at places (n, 2) of column and row, between its corners."""
    column, row = line.T
    i = np.clip(np.floor(row).astype(int), 0, patch.shape[0] - 2)
    j = np.clip(np.floor(column).astype(int), 0, patch.shape[1] - 2)
    s, t = (row - i)[:, None], (column - j)[:, None]
    low = (1 - t) * patch[i, j] + t * patch[i, j + 1]
    high = (1 - t) * patch[i + 1, j] + t * patch[i + 1, j + 1]
    return np.asarray((1 - s) * low + s * high)
