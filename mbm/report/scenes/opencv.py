"""Cameras as OpenCV's FileStorage has them in YAML, under the names that its calibration sample uses."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mbm.report.scenes import faults
from mbm.report.scenes.scene import image_sizes
from mbm.report.scenes.types import Files, Scene, words
from mbm.report.types import Floats
from mbm.rotations import quaternion_of_matrix, vector_of_quaternion
from mbm.text.types import MbmError

FORM = "opencv-yaml"
MODELS = ("pinhole", "fisheye")


def written(scene: Scene) -> Files:
    """A file for each camera: its matrix and distortion, its rms reprojection error per point, and where it was.

    Raises:
        MbmError: format-needs: a camera that OpenCV has no model for.

    """
    found: Files = {}
    names = words([camera.name for camera in scene.cameras])
    for number, (camera, name, size) in enumerate(zip(scene.cameras, names, image_sizes(scene), strict=True)):
        if camera.model not in MODELS:
            raise MbmError(faults.format_has_no(FORM, f"{camera.model} cameras, as `{camera.name}` is"))
        (fx, fy), (cx, cy) = camera.focal, camera.center
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        distortion = np.array(camera.distortion or (0.0,) * (5 if camera.model == "pinhole" else 4))
        mine = scene.camera_of == number
        vectors = vector_of_quaternion(quaternion_of_matrix(scene.rotations[mine]))
        squares = np.square(scene.residual[mine[scene.image]]).sum(axis=1)
        lines = [
            "%YAML:1.0",
            "---",
            f"camera_model: {camera.model}",
            f"image_width: {size[0]}",
            f"image_height: {size[1]}",
            *_matrix("camera_matrix", matrix),
            *_matrix("distortion_coefficients", distortion[:, None]),
            *([f"avg_reprojection_error: {float(np.sqrt(squares.mean()))!r}"] if squares.size else []),
            "# a row for each image: rotation vector and translation from the world to the camera",
            *_matrix("extrinsic_parameters", np.hstack([vectors, scene.translations[mine]])),
        ]
        found[f"{name}.yml"] = ("\n".join(lines) + "\n").encode()
    return found


def _matrix(name: str, values: Floats) -> Iterable[str]:
    rows, columns = values.shape
    data = ", ".join(repr(float(value) + 0.0) for value in values.ravel())
    return (
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {columns}",
        "   dt: d",
        f"   data: [ {data} ]",
    )
