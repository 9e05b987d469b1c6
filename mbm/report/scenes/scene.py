"""Views of all equations → one scene: each camera, image and point once."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mbm.equations.at_rows import DIVIDES_BY_DEPTH, looks_back
from mbm.estimation.search.solution import Solution
from mbm.problem.types import Problem
from mbm.report.scenes import faults
from mbm.report.scenes.types import Camera, Indices, Scene, word
from mbm.report.scenes.views import Views, views
from mbm.report.types import Floats
from mbm.text.types import MbmError

T = TypeVar("T", bound=Hashable)

HALF_TURN = np.array([1.0, -1.0, -1.0])
"""The signs of x, y, z after half a turn about x: from a camera that looks along −z with y upwards to one along +z."""

P1, P2 = 6, 7
"""Where the tangential distortion stands among the numbers of a pinhole camera."""

_SAME = 1e-9
"""Points that are nowhere named are one where they are this near, relative to the size of the scene."""


def scene_of(problem: Problem, solution: Solution, form: str) -> Scene:
    """The cameras, images and points of a solve; ``form`` is the format that is to be written.

    Raises:
        MbmError: format-needs: no equation is the image of a point by a camera with axes `opencv` or `opengl`, or no
            pose says where the camera was.

    """
    found = [_along_z(view, form) for view in views(problem, solution, form)]
    camera, cameras = _numbered((each.projection.camera, key) for each in found for key in each.camera)
    photos = (key for each in found for key in each.photo)
    image, names = _numbered(zip(photos, camera.tolist(), strict=True))
    point, point_names = _points(found)
    rows, image_rows, point_rows = _first(camera), _first(image), _first(point)
    rotations, translations = (np.concatenate([getattr(v, n) for v in found]) for n in ("rotation", "translation"))
    seen = np.concatenate([v.used & (v.measured is not None) for v in found])
    measured = np.concatenate([v.residual if v.measured is None else v.measured for v in found])
    called = _image_names(names, cameras)
    files = [file for v in found for file in v.file]
    return Scene(
        cameras=tuple(_camera(found, row, name) for row, name in zip(rows.tolist(), cameras, strict=True)),
        names=called,
        files=_image_files([files[row] for row in image_rows.tolist()], called),
        camera_of=camera[image_rows],
        rotations=rotations[image_rows],
        translations=translations[image_rows],
        points=np.concatenate([v.world for v in found])[point_rows],
        point_names=tuple(point_names),
        image=image[seen],
        point=point[seen],
        measured=measured[seen],
        residual=np.concatenate([v.residual for v in found])[seen],
    )


def _along_z(view: Views, form: str) -> Views:
    """The same by a camera that looks along +z, with the image's second coordinate downwards.

    Cameras that look along −z, by their axes or by negative focal lengths, are turned half about x, and the images
    about their first axis. A coordinate of the image that changes its sign takes its tangential distortion along.

    Raises:
        MbmError: format-needs: a camera with the axes of the paper.

    """
    camera = view.projection.camera
    if not view.projection.in_pixels:
        raise MbmError(faults.format_needs(form, f"a camera with `:axes opencv` or `opengl`; `{camera}` has others"))
    upwards = view.projection.axes == "opengl"
    back = looks_back(*view.numbers[:, :2].T) & (view.projection.model == DIVIDES_BY_DEPTH)
    turned = back != upwards  # of both, the second turn undoes the first
    axis, numbers = np.where(turned[:, None], HALF_TURN, 1.0), view.numbers.copy()
    numbers[:, :2] *= np.where(back, -1.0, 1.0)[:, None]
    numbers[:, 3] *= axis[:, 1]
    if view.projection.model == DIVIDES_BY_DEPTH and view.projection.distortion:
        numbers[:, P1] *= -1.0 if upwards else 1.0
        numbers[:, P2] *= np.where(back, -1.0, 1.0)
    return replace(
        view,
        rotation=axis[:, :, None] * view.rotation,
        translation=axis * view.translation,
        numbers=numbers,
        measured=None if view.measured is None else axis[:, :2] * view.measured,
        residual=axis[:, :2] * view.residual,
    )


def _numbered(items: Iterable[T]) -> tuple[Indices, list[T]]:
    """The number of each item among the distinct ones, as they are first met, and these."""
    known: dict[T, int] = {}
    numbers = [known.setdefault(item, len(known)) for item in items]
    return np.array(numbers, dtype=np.int64), list(known)


def _first(numbers: Indices) -> Indices:
    """The first place of each number."""
    return np.unique(numbers, return_index=True)[1]


def _image_names(images: Sequence[tuple[str, int]], cameras: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """The keys of the poses, behind the camera where one pose has several images: its key, and its name where cameras
    have several. What has no key, or is not unique, is numbered.
    """
    shared = len({photo for photo, _ in images}) < len(images)
    labels = {label for label, _ in cameras}
    front = [(label if len(labels) > 1 else "", key) if shared else () for label, key in cameras]
    names = ["-".join(filter(None, (*front[c], photo))) for photo, c in images]
    alone = Counter(names)
    return tuple(n if n and alone[n] == 1 else f"{n or 'image'}{i}" for i, n in enumerate(names, 1))


def _image_files(files: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """The files of images, without blanks, which end a field; their names if any file is unknown or not unique."""
    found = [re.sub(r"\s+", "_", file) for file in files]
    return tuple(found if all(found) and len(set(found)) == len(found) else map(word, names))


def _points(found: Sequence[Views]) -> tuple[Indices, list[str]]:
    """Points of one family by its keys, others by where they are."""
    world = np.concatenate([v.world for v in found])
    step = _SAME * max(float(np.abs(world).max(initial=0.0)), np.finfo(float).tiny)
    cells = np.round(world / step).astype(np.int64).tolist()
    names = [n for v in found for n in (v.point if v.point is not None else [None] * len(v.world))]
    items = [("", *cell) if name is None else (name,) for name, cell in zip(names, cells, strict=True)]
    numbers, known = _numbered(items)
    return numbers, [str(item[0]) or str(i) for i, item in enumerate(known, 1)]


def _camera(found: Sequence[Views], row: int, name: tuple[str, str]) -> Camera:
    """The camera of a row among those of all views."""
    for each in found:
        if row < len(each.world):
            break
        row -= len(each.world)
    fx, fy, cx, cy, *distortion = each.numbers[row].tolist()
    size = None if each.size is None else (int(each.size[0][row]), int(each.size[1][row]))
    label, key = name
    return Camera(
        name=f"{label}-{key}" if key else label,
        model=each.projection.model,
        focal=(fx, fy),
        center=(cx, cy),
        distortion=tuple(distortion),
        size=size,
    )


def image_sizes(scene: Scene) -> list[tuple[int, int]]:
    """Width and height of the images of each camera: as stated, else as small as hold what was measured, with the
    principal point in the middle or beyond it.
    """
    found = []
    for number, camera in enumerate(scene.cameras):
        mine = scene.camera_of[scene.image] == number
        corner: Floats = scene.measured[mine].max(axis=0, initial=0.0) + 1
        least = np.ceil(np.maximum(2 * np.array(camera.center) + 1, corner)).astype(int)
        found.append(camera.size or (int(least[0]), int(least[1])))
    return found
