"""Shapes before cameras, and their images by a projection of the tests' own."""

from __future__ import annotations

import numpy as np

import mbm

MODELS = """
(defmodel l-block (a) (or (trans ((/ a 2) 0 0) (box (* 2 a) a a)) (trans (0 0 a) (box a a a))))
(defmodel mug (r)
  (body (revolve (polyline ((0 0) (r 0) (r 0.3) ((* 0.9 r) 0.3) ((* 0.9 r) 0.03) (0 0.03))) 360deg))
  (handle
    (trans (0 0 0.15)
      (rotate (90deg 0 0)
        (sweep (disk 0.02) (spline ((r 0.08) ((+ r 0.1) 0.06) ((+ r 0.1) -0.06) (r -0.08))))))))
(defmodel patch (r) (surface (s 0.3 2.2) (q 0 1) [(* r (cos s)) (* r (sin s)) (* 0.4 q)]))
(defmodel post (r)
  (or (trans (0 0 -0.2) (box 0.5 0.4 0.1)) (trans (0 0 -0.15) (cylinder r 0.4)) (trans (0 0 0.3) (sphere 0.13))))
"""
SHAPES = {
    "box": "(box a 0.3 0.2)",
    "prism": "(prism 6 a 0.3)",
    "l-block": "(l-block a)",
    "disk": "(disk a)",
    "cylinder": "(cylinder a 0.4)",
    "cone": "(cone a 0.4)",
    "frustum": "(frustum a 0.1 0.3)",
    "sphere": "(sphere a)",
    "ellipsoid": "(ellipsoid a 0.3 0.1)",
    "torus": "(torus 0.4 (/ a 2))",
    "tube": "(tube a 0.15 0.3)",
    "mug": "(mug a)",
    "post": "(post (/ a 2))",
    "bar": "(extrude (disk a) 0.3)",
    "arch": "(revolve (trans (0.3 0 0) (rectangular (/ a 2) a)) 200deg)",
    "patch": "(patch a)",
}
CAMERAS = {
    "pinhole": ":focal (f 810) :center (320 240)",
    "distorted": ":focal (f 810) :center (320 240) :distortion (k 0.05 0.001 -0.002 0.01)",
    "fisheye": ":model fisheye :focal (f 810) :center (320 240) :distortion (k 0.01 0 0)",
    "orthographic": ":model orthographic :focal (/ f 2) :center (320 240)",
    "paper": ":axes paper :focal (f 810)",
    "opengl": ":axes opengl :focal (f 810) :center (320 240)",
}
MEASURES = {
    "area": "(= 0 (area S))",
    "centroid": "(= [0 0] (centroid S))",
    "perimeter": "(= 0 (perimeter S))",
    "extent": "(= [0 0] (extent S))",
    "left": "(= [0 0] (extreme S :left))",
    "right": "(= [0 0] (extreme S :right))",
    "top": "(= [0 0] (extreme S :top))",
    "bottom": "(= [0 0] (extreme S :bottom))",
}
ANGLES, PLACE = (0.5, 0.4, 0.2), (0.1, 0.05, 2.0)
SIZE, FOCAL, BEND = 0.2, 800.0, -0.1


def compiled(shape: str, camera: str = "pinhole", measures=tuple(MEASURES), *, points=(), angles=ANGLES, place=PLACE):
    """The problem whose residuals are what is measured; its unknowns are a pose, a size, f and k, in this order."""
    seen = {"paper": (place[2], *place[:2]), "opengl": (*place[:2], -place[2])}.get(camera, place)
    silhouette = f"(project cam (transform T {SHAPES.get(shape, shape)}))"
    whole = [f"(observe {m} (let ((S {silhouette})) {MEASURES[m]}) :sigma 1)" for m in measures]
    rows = f"(observe points (contour-distance {silhouette} [u v]) :sigma 1)" if len(points) else ""
    text = f"""{MODELS}
    (problem p
      (data points (table (u v) {" ".join(f"({u!r} {v!r})" for u, v in points) or "(0 0)"}))
      (camera cam {CAMERAS[camera]})
      (unknowns (T (pose 3) :init (pose3 (euler {" ".join(map(repr, angles))}) [{" ".join(map(repr, seen))}]))
        (a :init {SIZE}) (f :init {FOCAL}) (k :init {BEND}))
      {"".join(whole)}
      {rows})"""
    return mbm.loads(text).compile()


def measured(shape: str, camera: str = "pinhole", measures=tuple(MEASURES), **where) -> dict[str, np.ndarray]:
    """The numbers of each measure, and under ``points`` the distances."""
    found = compiled(shape, camera, measures, **where)
    values = found.residuals(np.zeros(9))
    sizes = [2 if MEASURES[name].startswith("(= [") else 1 for name in measures]
    ends = np.cumsum(sizes)
    numbers = {name: values[end - size : end] for name, size, end in zip(measures, sizes, ends, strict=True)}
    return numbers | {"points": values[ends[-1] if measures else 0 :]}


def rotation(angles=ANGLES) -> np.ndarray:
    """Rz Ry Rx."""
    (a, b, c), e = angles, np.eye(3)

    def turn(axis: int, angle: float) -> np.ndarray:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        found = e.copy()
        found[[i, j], [i, j]] = np.cos(angle)
        found[i, j], found[j, i] = -np.sin(angle), np.sin(angle)
        return found

    return turn(2, c) @ turn(1, b) @ turn(0, a)


def seen(points: np.ndarray, camera: str = "pinhole", angles=ANGLES, place=PLACE) -> np.ndarray:
    """Images (…, 2) of points (…, 3) of a shape, by the formulas of OpenCV's, the paper's and BAL's manuals."""
    if camera == "paper":
        x, y, z = np.moveaxis(points @ rotation(angles).T + [place[2], *place[:2]], -1, 0)
        return np.stack([FOCAL * y / x, 810 * z / x], axis=-1)
    if camera == "opengl":
        p = points @ rotation(angles).T + [*place[:2], -place[2]]
        return -p[..., :2] / p[..., 2:] * [FOCAL, 810] + [320, 240]
    x, y, z = np.moveaxis(points @ rotation(angles).T + place, -1, 0)
    if camera == "orthographic":
        return np.stack([FOCAL / 2 * x + 320, FOCAL / 2 * y + 240], axis=-1)
    x, y = x / z, y / z
    r2 = x * x + y * y
    if camera == "distorted":
        k1, k2, p1, p2, k3 = BEND, 0.05, 0.001, -0.002, 0.01
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        x, y = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    if camera == "fisheye":
        angle = np.arctan(np.sqrt(r2))
        scale = angle * (1 + BEND * angle**2 + 0.01 * angle**4) / np.sqrt(r2)
        x, y = x * scale, y * scale
    return np.stack([FOCAL * x + 320, 810 * y + 240], axis=-1)
