"""Angles of which the data tell nothing say so: against the standard deviation of the uniform distribution."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

ANGLE = """(problem angle {keys} (data d external)
  (unknowns (a angle :init 0.3) (b angle :init 0.3))
  (observe d (= m (* r (sin a))) :sigma 1) (observe d (= h (+ a b)) :sigma {sigma}))"""


def said(solve: mbm.Solve) -> list[str]:
    return [each.message for each in solve.diagnostics if each.code.name == "any-turn"]


@pytest.mark.parametrize("keys", ["", "(for-each k)"])
@pytest.mark.parametrize(("sigma", "doubted"), [(1.7, False), (1.9, True)])
def test_an_angle_as_uncertain_as_any_says_so(keys: str, sigma: float, doubted: bool) -> None:
    """π/√3 = 1.814; one reading of each solve, and the sine tells ``a`` to a millionth."""
    rows = {"k": np.arange(3.0), "m": 1e6 * np.sin(np.full(3, 0.3)), "r": np.full(3, 1e6), "h": np.full(3, 0.7)}
    data = rows if keys else {name: values[:1] for name, values in rows.items()}
    solved = mbm.loads(ANGLE.format(keys=keys, sigma=sigma)).solve(data={"d": data})
    for solve in solved.solves:
        assert len(said(solve)) == doubted
        assert not doubted or ("`b`" in said(solve)[0] and "`a`" not in said(solve)[0] and "1.9 rad" in said(solve)[0])


SCENE = """(problem scene (data d external) (camera cam :focal (500 500) :center (320 240))
  (unknowns (T (pose 3) :per d.image :init (pose3 (euler 0 0 0) [0 0 0])) (X (vector 3) :per d.point :init [0 0 5] {x}))
  (observe d (= [u v] (project cam (transform (T image) (X point)))) :sigma 0.5))"""


def test_a_scene_that_its_priors_shrink_to_a_point_says_so() -> None:
    """All priors have one mean and nothing states a scale: the smaller the scene, the better the priors fit."""
    generator = np.random.default_rng(3)
    points = generator.uniform([-1, -0.5, 4], [1, 0.5, 6], size=(12, 3))
    image, point = (each.ravel() for each in np.meshgrid(np.arange(3.0), np.arange(12.0), indexing="ij"))
    seen = (points[None] + np.array([[0, 0, 0], [-1, 0, 0], [-0.5, 0.1, 0]])[:, None]).reshape(-1, 3)
    uv = 500 * seen[:, :2] / seen[:, 2:] + [320, 240] + 0.5 * generator.normal(size=(36, 2))
    data = {"image": image, "point": point, "u": uv[:, 0], "v": uv[:, 1]}
    (shrunk,) = mbm.loads(SCENE.format(x=":sigma 3")).solve(data={"d": data}).solves
    assert len(said(shrunk)) == 1
    (free,) = mbm.loads(SCENE.format(x="")).solve(data={"d": data}).solves
    assert free.status == "unobservable" and not said(free)
