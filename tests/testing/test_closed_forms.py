"""mbm's own closed forms keep what the conformance suite asks, and the suite notices those that do not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.intersection import INTERSECTION
from mbm.estimation.starts.closed_forms.linear import LINEAR, SCALED_RANGES
from mbm.estimation.starts.closed_forms.measured import MEASURED
from mbm.estimation.starts.closed_forms.multilateration import MULTILATERATION
from mbm.estimation.starts.closed_forms.planar_calibration import PLANAR_CALIBRATION
from mbm.estimation.starts.closed_forms.planes import PLANES
from mbm.estimation.starts.closed_forms.pose_from_points import POSE_FROM_POINTS
from mbm.estimation.starts.closed_forms.relative_poses import RELATIVE_POSES
from mbm.estimation.starts.closed_forms.similarity import SIMILARITY
from mbm.estimation.starts.closed_forms.structure_from_motion import STRUCTURE_FROM_MOTION
from mbm.estimation.starts.closed_forms.types import ClosedForm, Plan
from mbm.testing.closed_forms import ClosedFormSample, check_closed_form
from mbm.testing.requirement import NotConformingError

GENERATOR = np.random.default_rng(1)
POINTS = GENERATOR.uniform(-1, 1, size=(9, 3))
PLACE = np.array([0.5, 2.0, 3.0])
MANY = GENERATOR.uniform(-1, 1, size=(16, 3))
TURNED = np.stack([-POINTS[:, 1], POINTS[:, 0], POINTS[:, 2]], axis=1)
"""A quarter of a turn about z: the quaternion (√½ 0 0 √½)."""

QUARTER = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]


def table(**columns: Floats) -> dict[str, object]:
    return {"d": columns}


def _graph() -> ClosedFormSample:
    """Four poses of the plane round a square of 2 m, each about a quarter turn on; measured round, and once across."""
    poses = np.array([[0.0, 0, 0], [1.5, 2, 0], [3.0, 2, 2], [-1.5, 0, 2]])
    columns = {"a": [], "b": [], "dx": [], "dy": [], "turn": []}
    for a, b in ((0, 1), (1, 2), (3, 2), (0, 2)):
        c, s = np.cos(poses[a, 0]), np.sin(poses[a, 0])
        dx, dy = poses[b, 1:] - poses[a, 1:]
        for name, number in zip(
            columns, (a, b, c * dx + s * dy, c * dy - s * dx, poses[b, 0] - poses[a, 0]), strict=True
        ):
            columns[name].append(float(number))
    return ClosedFormSample(
        text="""(problem p (data nodes (table (id) (0) (1) (2) (3)) :key id) (data d external)
          (unknowns (T (pose 2) :per nodes))
          (observe d (= (pose2 dx dy turn) (between (T a) (T b)))))""",
        numbers={"T": poses},
        data=table(**{name: np.array(values) for name, values in columns.items()}),
    )


def _calibration() -> ClosedFormSample:
    """Four views of a grid, turned about x and y; focal lengths 500 and 510, centre (320 240)."""
    grid = np.array([[a, b, 0.0] for a in range(4) for b in range(3)])
    columns: dict[str, list[float]] = {name: [] for name in ("view", "x", "y", "u", "v")}
    numbers = []
    for view, (first, second) in enumerate(((0.3, 0.0), (0.0, 0.4), (-0.3, 0.2), (0.2, -0.5))):
        q = np.array([np.cos(first / 2) * np.cos(second / 2), np.sin(first / 2) * np.cos(second / 2),
                      np.cos(first / 2) * np.sin(second / 2), np.sin(first / 2) * np.sin(second / 2)])  # fmt: skip
        cf, sf, cs, ss = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
        R = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]]) @ np.array([[cs, 0, ss], [0, 1, 0], [-ss, 0, cs]])
        t = np.array([-1.0, -1.5, 8.0 + view])
        seen = grid @ R.T + t
        numbers.append([*q, *t])
        columns["view"] += [float(view)] * len(grid)
        columns["x"] += list(grid[:, 0])
        columns["y"] += list(grid[:, 1])
        columns["u"] += list(500 * seen[:, 0] / seen[:, 2] + 320)
        columns["v"] += list(510 * seen[:, 1] / seen[:, 2] + 240)
    camera = {"fx": 500.0, "fy": 510.0, "cx": 320.0, "cy": 240.0}
    return ClosedFormSample(
        text="""(problem p (data d external) (camera cam :focal (fx fy) :center (cx cy))
          (unknowns (fx) (fy) (cx) (cy) (T (pose 3) :per d.view))
          (observe d (= [u v] (project cam (transform (T view) [x y 0])))))""",
        numbers={**{n: np.array(v) for n, v in camera.items()}, "T": np.array(numbers)},
        data=table(**{n: np.array(v) for n, v in columns.items()}),
    )


def _pair() -> ClosedFormSample:
    """A camera that moves 2 m to the right, and then a quarter of a turn about its own axis; a distance is known."""
    points = MANY + np.array([0.5, 0.2, 5.0])
    moved = np.stack([-points[:, 1], points[:, 0] - 2.0, points[:, 2]], axis=1)
    seen = np.concatenate([points[:, :2] / points[:, 2:], moved[:, :2] / moved[:, 2:]])
    keys = np.arange(16.0)
    views = {"view": np.repeat([0.0, 1.0], 16), "key": np.tile(keys, 2), "u": seen[:, 0], "v": seen[:, 1]}
    return ClosedFormSample(
        text=f"""(problem p (data points external :key key) (data d external)
          (camera cam :focal (1 1) :center (0 0))
          (unknowns (T (pose 3)) (X (vector 3) :per points))
          (observe first d (= [u v] (project cam (X key))) :when (= view 0))
          (observe second d (= [u v] (project cam (transform T (X key)))) :when (= view 1))
          (observe apart (= {np.linalg.norm(points[0] - points[1])} (distance (X 0) (X 1)))))""",
        numbers={"T": np.array([*QUARTER, 0.0, -2.0, 0.0]), "X": points},
        data={"points": {"key": keys}, "d": views},
    )


SAMPLES: dict[str, tuple[ClosedForm, ClosedFormSample]] = {
    "linear": (
        LINEAR,
        ClosedFormSample(
            text="(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x)))))",
            numbers={"a": np.array(2.0), "b": np.array(-3.0)},
            data=table(x=np.arange(5.0), y=2 - 3 * np.arange(5.0)),
        ),
    ),
    "ranges": (
        MULTILATERATION,
        ClosedFormSample(
            text="(problem p (data d external) (unknowns (p (vector 3))) (observe d (= r (distance p [x y z]))))",
            numbers={"p": PLACE},
            data=table(
                x=POINTS[:, 0], y=POINTS[:, 1], z=POINTS[:, 2], r=np.sqrt(np.square(POINTS - PLACE).sum(axis=1))
            ),
        ),
    ),
    "radio": (
        SCALED_RANGES,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (p (vector 3)) (gain) (offset))
              (observe d (= r (+ (* gain (distance p [x y z])) offset))))""",
            numbers={"p": PLACE, "gain": np.array(1.07), "offset": np.array(0.4)},
            data=table(
                x=MANY[:, 0], y=MANY[:, 1], z=MANY[:, 2], r=1.07 * np.sqrt(np.square(MANY - PLACE).sum(axis=1)) + 0.4
            ),
        ),
    ),
    "plane": (
        PLANES,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (n direction) (d))
              (observe d (= (dot n [x y (/ (- 10.5 (* 2 x) (* -3 y)) 6)]) d)))""",
            numbers={"n": np.array([2.0, -3.0, 6.0]) / 7, "d": np.array(1.5)},
            data=table(x=POINTS[:, 0], y=POINTS[:, 1]),
        ),
    ),
    "line": (
        PLANES,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (a angle) (d))
              (observe d (- (+ (* x (cos a)) (* y (sin a))) d)))""",
            numbers={"a": np.array(np.arctan2(4, 3)), "d": np.array(2.0)},
            data=table(x=POINTS[:, 0], y=(10 - 3 * POINTS[:, 0]) / 4),
        ),
    ),
    "pairs": (
        SIMILARITY,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (S (similarity 3)))
              (observe d (= [u v w] (transform S [x y z]))))""",
            numbers={"S": np.array([*QUARTER, *PLACE, 2.0])},
            data=table(**dict(zip("xyzuvw", (*POINTS.T, *(2 * TURNED + PLACE).T), strict=True))),
        ),
    ),
    "images": (
        POSE_FROM_POINTS,
        ClosedFormSample(
            text="""(problem p (data d external) (camera cam :focal (500 500) :center (320 240))
              (unknowns (T (pose 3))) (observe d (= [u v] (project cam (transform T [x y z])))))""",
            numbers={"T": np.array([*QUARTER, *PLACE])},
            data=table(
                x=POINTS[:, 0],
                y=POINTS[:, 1],
                z=POINTS[:, 2],
                u=500 * (TURNED + PLACE)[:, 0] / (TURNED + PLACE)[:, 2] + 320,
                v=500 * (TURNED + PLACE)[:, 1] / (TURNED + PLACE)[:, 2] + 240,
            ),
        ),
    ),
    "bearings": (
        INTERSECTION,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (p (vector 2)))
              (observe d (= a (atan2 (- (p 2) y) (- (p 1) x)))))""",
            numbers={"p": PLACE[:2]},
            data=table(x=POINTS[:, 0], y=POINTS[:, 1], a=np.arctan2(PLACE[1] - POINTS[:, 1], PLACE[0] - POINTS[:, 0])),
        ),
    ),
    "calibration": (PLANAR_CALIBRATION, _calibration()),
    "graph": (RELATIVE_POSES, _graph()),
    "pair": (STRUCTURE_FROM_MOTION, _pair()),
    "poses": (
        MEASURED,
        ClosedFormSample(
            text="""(problem p (data d external) (unknowns (T (pose 3)))
              (observe d (= (pose3 (axis-angle [a b c]) [x y z]) T)))""",
            numbers={"T": np.array([*QUARTER, *PLACE])},
            data=table(
                a=np.zeros(3),
                b=np.zeros(3),
                c=np.full(3, np.pi / 2),
                **{n: np.full(3, v) for n, v in zip("xyz", PLACE, strict=True)},
            ),
        ),
    ),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_mbms_own_conform(name: str) -> None:
    check_closed_form(*SAMPLES[name])


@dataclass(frozen=True, slots=True)
class Wrong:
    """Multilateration that answers one metre beside."""

    name: str = "wrong"
    joint: bool = False

    recognises = MULTILATERATION.recognises

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        return MULTILATERATION.solve(plan, subsets) + 1.0


def test_a_wrong_one_does_not() -> None:
    with pytest.raises(NotConformingError, match="give their truth back"):
        check_closed_form(Wrong(), SAMPLES["ranges"][1])


def test_one_that_does_not_know_the_sample_does_not() -> None:
    with pytest.raises(NotConformingError, match="recognises the sample"):
        check_closed_form(SIMILARITY, SAMPLES["ranges"][1])


def test_one_without_a_name_does_not() -> None:
    with pytest.raises(NotConformingError, match="has a name"):
        check_closed_form(replace(MULTILATERATION, name=""), SAMPLES["ranges"][1])
