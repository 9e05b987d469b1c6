"""Bundler v0.3 ``bundle.out``: cameras that look along −z with y upwards, images measured from the principal point."""

from __future__ import annotations

import numpy as np

from mbm.report.scenes import faults
from mbm.report.scenes.scene import HALF_TURN
from mbm.report.scenes.types import Camera, Files, Scene, in_order, numbers
from mbm.text.types import MbmError

FORM = "bundler"


def written(scene: Scene) -> Files:
    """The files of a scene, one camera for each image.

    Raises:
        MbmError: format-needs: a camera that Bundler has no model for.

    """
    cameras = [scene.cameras[number] for number in scene.camera_of.tolist()]
    lines = ["# Bundle file v0.3", f"{len(cameras)} {len(scene.points)}"]
    rotations, translations = HALF_TURN[:, None] * scene.rotations, HALF_TURN * scene.translations
    for camera, rotation, translation in zip(cameras, rotations, translations, strict=True):
        lines.append(numbers(_intrinsics(camera)))
        lines += [numbers(row) for row in (*rotation, translation)]
    centers = np.array([camera.center for camera in cameras]).reshape(-1, 2)
    seen = scene.measured - centers[scene.image]
    seen *= HALF_TURN[:2]
    keys = np.zeros(len(scene.image), dtype=np.int64)
    for rows in in_order(scene.image, len(cameras)):
        keys[rows] = np.arange(len(rows))
    for point, rows in zip(scene.points, in_order(scene.point, len(scene.points)), strict=True):
        views = [f"{scene.image[row]} {keys[row]} {numbers(seen[row])}" for row in rows]
        lines += [numbers(point), "128 128 128", " ".join([str(len(rows)), *views])]
    return {
        "bundle.out": ("\n".join(lines) + "\n").encode(),
        "list.txt": ("".join(f"{file}\n" for file in scene.files)).encode(),
    }


def _intrinsics(camera: Camera) -> tuple[float, float, float]:
    """f, k1, k2."""
    fx, fy = camera.focal
    if camera.model != "pinhole":
        raise MbmError(faults.format_has_no(FORM, f"{camera.model} cameras, as `{camera.name}` is"))
    if fx <= 0:
        raise MbmError(faults.format_has_no(FORM, f"focal length below zero, as that of `{camera.name}`"))
    if fx != fy:
        raise MbmError(faults.format_has_no(FORM, f"camera with two focal lengths, as `{camera.name}` is"))
    k1, k2, p1, p2, k3 = camera.distortion or (0.0,) * 5
    if p1 or p2 or k3:
        raise MbmError(faults.format_has_no(FORM, f"distortion beyond k1 and k2, as that of `{camera.name}`"))
    return fx, k1, k2
