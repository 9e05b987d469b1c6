"""Values of the writers of scenes: cameras, images and points at the estimates."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.report.types import Floats
from mbm.values import dataclass

Indices: TypeAlias = NDArray[np.int64]

Files: TypeAlias = dict[str, bytes]
"""What a writer gives: the contents of files by their names in the folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera at the estimates: ``name`` with its key if it has one, numbers as mbm has them (pixel centres at whole
    numbers), ``size`` (width, height) in px as a table of its states it, None where nothing does.
    """

    name: str
    model: str
    focal: tuple[float, float]
    center: tuple[float, float]
    distortion: tuple[float, ...]
    size: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What was seen by which camera from where.

    Images have ``names``, ``cameras`` (I,) among all, ``rotations`` (I, 3, 3) and ``translations`` (I, 3) from the
    world to the camera, which looks along +z with y down. ``points`` (P, 3) have ``point_names``. Point
    ``point`` (M,) was seen in image ``image`` (M,) at ``measured`` (M, 2) px, with the ``residual`` (M, 2).
    """

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    camera_of: Indices
    rotations: Floats
    translations: Floats
    points: Floats
    point_names: tuple[str, ...]
    image: Indices
    point: Indices
    measured: Floats
    residual: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Poses by key, body to world: ``keys``, ``rotations`` (n, 3, 3), ``translations`` (n, 3)."""

    name: str
    keys: tuple[str | float, ...]
    rotations: Floats
    translations: Floats
