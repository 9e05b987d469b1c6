"""Values of pictures of models and scenes, before anything is drawn: numbers in SI, no Matplotlib."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from mbm.report.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """A line of space through ``points`` (n, 3). ``kind`` is model, camera or spread: it decides how it is drawn.

    ``normals`` (2, 3) are those of the two faces of a mesh that meet there, if there are two.
    """

    points: Floats
    kind: str = "model"
    normals: Floats | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """What is written at a point (3,) of a model: ``kind`` is vertex, line, plane, curve, point or part.

    ``normal`` (3,) points out of the plane that is named; None of other kinds.
    """

    kind: str
    text: str
    at: Floats
    normal: Floats | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """A model in numbers.

    ``faces`` are plane polygons (k, 3); ``patches`` smooth stretches of surface as grids (n, m, 3).
    ``unit`` is the unit of its lengths, empty where the model states none. ``dots`` (n, 3) are points without a name.
    """

    name: str
    strokes: tuple[Stroke, ...]
    faces: tuple[Floats, ...]
    patches: tuple[Floats, ...]
    marks: tuple[Mark, ...]
    unit: str = ""
    dots: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def bounds(self) -> tuple[Floats, Floats]:
        """The least and greatest coordinates, each (3,)."""
        every = [*(s.points for s in self.strokes), *self.faces, *(p.reshape(-1, 3) for p in self.patches)]
        every += [self.dots, *(mark.at[None] for mark in self.marks)]
        points = np.vstack(every)
        points = points if len(points) else np.zeros((1, 3))
        return points.min(axis=0), points.max(axis=0)
