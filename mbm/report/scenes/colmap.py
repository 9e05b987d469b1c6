"""COLMAP's text files ``cameras.txt``, ``images.txt``, ``points3D.txt``; its pixel centres are at 0.5 (…, 1.5, 2.5)."""

from __future__ import annotations

import numpy as np

from mbm.report.scenes import faults
from mbm.report.scenes.scene import image_sizes
from mbm.report.scenes.types import Camera, Files, Scene, ids, in_order, numbers
from mbm.rotations import quaternion_of_matrix
from mbm.text.types import MbmError

FORM = "colmap"
HALF = 0.5
"""Where COLMAP has the centre of the first pixel; mbm, as OpenCV, has it at 0."""


def written(scene: Scene) -> Files:
    """The files of a scene.

    Raises:
        MbmError: format-needs: a camera that COLMAP has no model for.

    """
    camera_ids = ids([camera.name.rpartition("-")[2] for camera in scene.cameras])
    return {
        "cameras.txt": _cameras(scene, camera_ids).encode(),
        "images.txt": _images(scene, camera_ids).encode(),
        "points3D.txt": _points(scene).encode(),
    }


def _cameras(scene: Scene, camera_ids: list[int]) -> str:
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"]
    for camera, number, (width, height) in zip(scene.cameras, camera_ids, image_sizes(scene), strict=True):
        model, distortion = _model(camera)
        parameters = numbers((*camera.focal, *(c + HALF for c in camera.center), *distortion))
        lines.append(f"{number} {model} {width} {height} {parameters}")
    return "\n".join(lines) + "\n"


def _model(camera: Camera) -> tuple[str, tuple[float, ...]]:
    """The model of COLMAP, and its parameters behind focal lengths and principal point."""
    if min(camera.focal) <= 0:
        raise MbmError(faults.format_has_no(FORM, f"focal length below zero, as that of `{camera.name}`"))
    if camera.model == "fisheye":
        return "OPENCV_FISHEYE", camera.distortion or (0.0,) * 4
    if camera.model != "pinhole":
        raise MbmError(faults.format_has_no(FORM, f"{camera.model} cameras, as `{camera.name}` is"))
    if not any(camera.distortion):
        return "PINHOLE", ()
    k1, k2, p1, p2, k3 = camera.distortion
    return ("FULL_OPENCV", (k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)) if k3 else ("OPENCV", (k1, k2, p1, p2))


def _images(scene: Scene, camera_ids: list[int]) -> str:
    """Two lines each: the pose from the world to the camera, then the 2D points."""
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# POINTS2D[] as X Y POINT3D_ID"]
    point_ids = ids(scene.point_names)
    quaternions = quaternion_of_matrix(scene.rotations)
    seen = (scene.measured + HALF).tolist()
    rows = in_order(scene.image, len(scene.names))
    for place, (file, number) in enumerate(zip(scene.files, ids(scene.names), strict=True)):
        pose = numbers((*quaternions[place], *scene.translations[place]))
        lines.append(f"{number} {pose} {camera_ids[scene.camera_of[place]]} {file}")
        lines.append(" ".join(f"{numbers(seen[row])} {point_ids[scene.point[row]]}" for row in rows[place]))
    return "\n".join(lines) + "\n"


def _points(scene: Scene) -> str:
    """Each point with its mean reprojection error and its track."""
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX"]
    image_ids, places = ids(scene.names), np.zeros(len(scene.image), dtype=np.int64)
    for rows in in_order(scene.image, len(scene.names)):
        places[rows] = np.arange(len(rows))
    lengths = np.linalg.norm(scene.residual, axis=1)
    tracks = in_order(scene.point, len(scene.points))
    for number, point, rows in zip(ids(scene.point_names), scene.points, tracks, strict=True):
        track = " ".join(f"{image_ids[scene.image[row]]} {places[row]}" for row in rows)
        error = numbers([float(lengths[rows].mean()) if rows else -1.0])
        lines.append(f"{number} {numbers(point)} 128 128 128 {error} {track}".rstrip())
    return "\n".join(lines) + "\n"
