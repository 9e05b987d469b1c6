"""Poses of a cone, a bolt, a bracket and a cup in rendered images, without correspondences and without a start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.report.types import SolveReport
from tests.evidence import rendered

pytest.importorskip("shapely")
pytest.importorskip("cv2")

PROBLEM = """
(defmodel bolt ()
  (revolve (polyline ((0 0) (20mm 0) (20mm 12mm) (9mm 12mm) (9mm 70mm) (4mm 80mm) (0 80mm))) 360deg))
(defmodel bracket ()
  (or (box 12cm 6cm 1cm) (trans (-55mm 0 35mm) (box 1cm 6cm 6cm)) (trans (3cm 15mm 15mm) (box 2cm 1cm 2cm))))
(problem p
  (data edge (contour "object.png"))
  (camera cam :focal (700 700) :center (320 240))
  (unknowns (T (pose 3)))
  (observe edge (contour-distance (silhouette cam (transform T SHAPE)) [u v]) :sigma (unknown sigma)))
"""


def frustum(first: float, low: float, second: float, high: float, corners: int = 720) -> list[np.ndarray]:
    turn = 2 * np.pi * np.arange(corners) / corners
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ends = [np.column_stack([r * ring, np.full(corners, z)]) for r, z in ((first, low), (second, high))]
    return [rendered.hull(np.unique(np.concatenate(ends), axis=0))]


SHAPES = {
    "cone": ("(cone 4cm 11cm)", frustum(0.04, 0, 0, 0.11)),
    "bolt": (
        "(bolt)",
        [*rendered.disk(0.02, 0, 0.012), *rendered.disk(0.009, 0.012, 0.07), *frustum(0.009, 0.07, 0.004, 0.08)],
    ),
    "bracket": (
        "(bracket)",
        [
            *rendered.box((0.12, 0.06, 0.01)),
            *rendered.box((0.01, 0.06, 0.06), (-0.055, 0, 0.035)),
            *rendered.box((0.02, 0.01, 0.02), (0.03, 0.015, 0.015)),
        ],
    ),
    "cup": ("(or (tube 40mm 37mm 95mm) (cylinder 39mm 4mm))", [*rendered.wall(0.04, 0.037, 0, 0.095)]),
}
SHAPES["cup"][1].extend(rendered.disk(0.039, 0, 0.004))
ROUND = ("cone", "bolt", "cup")
FLAT = 30.0
"""Factor by which errors may be larger than stated where residuals show a wrong pose: it must be said then."""


def scene(name: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    R, t = rendered.pose(rng)
    return R, t - R @ [0, 0, 0.045 if name in ROUND else 0]


def solved(folder: Path, name: str, R: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> SolveReport:
    shape, solids = SHAPES[name]
    rendered.photograph(folder / "object.png", solids, R, t, rng)
    file = folder / "object.mbm"
    file.write_text(PROBLEM.replace("SHAPE", shape))
    return mbm.load(file).solve().first


def within(name: str, value: np.ndarray, sigma: np.ndarray, R: np.ndarray, t: np.ndarray) -> bool:
    """Whether an estimate is within 3 σ; how a round body is turned about its axis counts nothing."""
    D = Rotation.from_quat(np.roll(value[:4], -1)).as_matrix().T @ R
    told = [0, 1, 2, 3, 4, 5]
    if name in ROUND:
        D = D @ Rotation.from_euler("z", -np.arctan2(D[1, 0] - D[0, 1], D[0, 0] + D[1, 1])).as_matrix()
        told.remove(2)
    off = np.concatenate([Rotation.from_matrix(D).as_rotvec(), t - value[4:]])
    return bool((np.abs(off) < 3 * sigma)[told].all())


def check(folder: Path, name: str, seeds: range) -> list[bool]:
    """Whether each pose is found; one that looks the same must be among the alternatives, a wrong one be doubted."""
    good = []
    for seed in seeds:
        rng = np.random.default_rng(1000 + seed)
        R, t = scene(name, rng)
        found = solved(folder, name, R, t, rng)
        assert found.status == ("unobservable" if name in ROUND else "converged")
        (estimate,) = found.estimates
        sigma = np.asarray(estimate.sigma, dtype=float)
        hit = within(name, np.asarray(estimate.value), sigma, R, t)
        # σ of an alternative is not told; it is about that of the solution
        others = [np.asarray(each.estimates[0].value) for each in found.alternatives]
        same = any(within(name, other, np.full(6, 3 * np.nanmax(sigma)), R, t) for other in others)
        good.append(hit or same)
        off = within(name, np.asarray(estimate.value), FLAT * sigma, R, t)
        assert hit or same or off or found.diagnostics, f"a wrong pose is trusted: {name} {seed}"
    return good


def test_a_cup_upside_down_looks_the_same(tmp_path):
    """Of the two, one is the solution and one the alternative; neither is lost for the turn that nothing tells."""
    rng = np.random.default_rng(1000)
    R, t = scene("cup", rng)
    found = solved(tmp_path, "cup", R, t, rng)
    (other,) = found.alternatives
    ups = [
        Rotation.from_quat(np.roll(np.asarray(e.estimates[0].value)[:4], -1)).apply([0, 0, 1]) for e in (found, other)
    ]
    assert ups[0] @ ups[1] < -0.999
    assert "another-solution" in [each.code.name for each in found.diagnostics]


def test_a_descent_that_follows_a_wrong_edge_is_led_on(tmp_path):
    """The first minimum is 2.3° beside the truth, with residuals of 12 standard deviations."""
    assert all(check(tmp_path, "bracket", range(1)))


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_twenty_poses(tmp_path, name):
    assert np.mean(check(tmp_path, name, range(20))) >= 0.9
