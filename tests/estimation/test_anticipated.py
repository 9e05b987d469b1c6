"""Large pose graphs with a stated start that costs more than a closed form: this is followed first."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

COUNT = 150
GRAPH = """
(problem ring (data nodes external :key id) (data edges external)
  (unknowns (T (pose 2) :per nodes :init (pose2 x y a) :fixed (= id 0)))
  (observe edges (= (pose2 dx dy da) (between (T one) (T two))) :sigma {sigma}))"""


def ring(seed: int, moved: float) -> tuple[dict[str, dict[str, np.ndarray]], np.ndarray]:
    """A walk around a ring with steps and chords measured to 0.02, its places turned and moved far; and the truth."""
    random = np.random.default_rng(seed)
    turn = np.linspace(0.0, 4.0 * np.pi, COUNT)
    place = np.column_stack([10 * np.cos(turn), 10 * np.sin(turn), turn + np.pi / 2])
    pairs = [(i, i + 1) for i in range(COUNT - 1)] + [(i, i + COUNT // 2) for i in range(0, COUNT // 2, 3)]
    one, two = np.array(pairs).T
    c, s = np.cos(place[one, 2]), np.sin(place[one, 2])
    x, y = (place[two, :2] - place[one, :2]).T
    measured = np.column_stack([c * x + s * y, c * y - s * x, place[two, 2] - place[one, 2]])
    measured += 0.02 * random.standard_normal(measured.shape)
    start = place + moved * random.uniform(-1.0, 1.0, place.shape)
    start[0] = place[0]
    nodes = {"id": np.arange(float(COUNT)), "x": start[:, 0], "y": start[:, 1], "a": start[:, 2]}
    edges = {
        "one": one.astype(float),
        "two": two.astype(float),
        **dict(zip(("dx", "dy", "da"), measured.T, strict=True)),
    }
    return {"nodes": nodes, "edges": edges}, place


@pytest.mark.parametrize("sigma", ["0.02", "unknown"])
def test_a_start_that_leads_astray_does_no_harm(sigma: str) -> None:
    text = mbm.loads(GRAPH.format(sigma=sigma))
    near, truth = ring(1, 0.01)
    far, _ = ring(1, 3.0)
    found, expected = text.solve(data=far), text.solve(data=near)
    assert found.first.cost == pytest.approx(expected.first.cost, rel=1e-8)
    # Two rounds of 75 steps of 0.02: some 0.2 at the far side, and five times that.
    assert np.abs(found["T"].value[:, 1:] - truth[:, :2]).max() < 1.0
    if sigma != "unknown":  # or else it is not known whether the fit is good, and the stated start is followed, too
        assert found.first.iterations <= 2 * expected.first.iterations + 5


def test_a_good_start_is_followed() -> None:
    near, _ = ring(2, 1e-4)
    found = mbm.loads(GRAPH.format(sigma="0.02")).solve(data=near).first
    assert found.status == "converged"
    assert found.chi2_p > 1e-3
    assert found.iterations <= 10
