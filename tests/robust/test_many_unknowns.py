"""Outliers among families, chains of unknowns, rotations, and measured values with errors of their own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import mbm
from mbm.estimation.consensus.truncated import noise_of_inliers
from mbm.estimation.consensus.units import Units
from tests.robust.scenes import CEILING

STATIONS = CEILING[::4]

PLACES = """
(problem places
  (data receivers external :key id)
  (data epochs external :key e)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :per epochs :init [1.75m 1.75m 1m]))
  (observe ranges (= range (distance (p e) [receivers.x receivers.y receivers.z])) {noise})
  (solve :robust {robust}))
"""
CHAIN = """
(problem chain
  (data nodes external :key id)
  (data steps external)
  (unknowns (h :per nodes :init first))
  (observe steps (= dh (- (h b) (h a))) {noise})
  (constraints (= (h 0) 0))
  (solve :robust {robust}))
"""
ALIGN = """
(problem alignment
  (data t external)
  (unknowns (S (similarity 3)))
  (observe t (= [u v w] (transform S [x y z])) :sigma 0.01)
  (solve :robust {robust}))
"""
ELLIPSE = """
(problem rim
  (data t external)
  (unknowns (c (vector 2) :init [0.8 0.4]) (a :init 2.5) (b :init 1.8))
  (observe t (- (+ (^ (/ (- x (c 1)) a) 2) (^ (/ (- y (c 2)) b) 2)) 1) :errors ((x 0.02) (y 0.02)))
  (solve :robust lmeds))
"""


@pytest.mark.parametrize("robust", ["lmeds", "gnc"])
@pytest.mark.parametrize("noise", [":sigma 5mm", ":sigma unknown"])
def test_each_member_of_a_family_has_outliers_of_its_own(robust, noise):
    """Twenty places at once: no subset of all sixty unknowns is ever clean."""
    generator = np.random.default_rng(11)
    count = 20
    places = generator.uniform([0.8, 0.8, 0.3], [2.7, 2.7, 1.3], (count, 3))
    ranges = np.linalg.norm(places[:, None] - STATIONS, axis=2) + 0.005 * generator.normal(size=(count, 12))
    bad = np.argsort(generator.random((count, 12)), axis=1) < 2
    data = {
        "receivers": {"id": np.arange(12.0), **{c: STATIONS[:, i] for i, c in enumerate("xyz")}},
        "epochs": {"e": np.arange(float(count))},
        "ranges": {
            "e": np.repeat(np.arange(float(count)), 12),
            "receiver": np.tile(np.arange(12.0), count),
            "range": (ranges + 0.5 * bad).ravel(),
        },
    }
    solve = mbm.loads(PLACES.format(robust=robust, noise=noise)).solve(data=data).solves[0]
    listed = np.array(solve.residual_summaries["ranges"].outliers) - 1
    assert set(np.flatnonzero(bad.ravel())) <= set(listed)
    # Three deviations leave out 0.3 % of 200 good rows, and with unknown noise few more.
    assert len(listed) <= 40 + 6
    assert np.linalg.norm(np.array(solve.estimates[0].value) - places, axis=1).max() < 0.03
    if noise == ":sigma unknown":
        # Ten good ranges and three unknowns in each place: 140 degrees of freedom tell the noise to 6 %.
        assert solve.noise["ranges"] == pytest.approx(0.005, rel=0.2)


@pytest.mark.parametrize("robust", ["lmeds", "gnc"])
def test_a_family_of_many_unknowns_is_as_sure_as_its_members_alone(robust):
    """102 places, 306 unknowns: what consensus cuts from the tails widens standard deviations there as in one place."""
    generator = np.random.default_rng(21)
    count = 102
    places = generator.uniform([0.8, 0.8, 0.3], [2.7, 2.7, 1.3], (count, 3))
    ranges = np.linalg.norm(places[:, None] - STATIONS, axis=2) + 0.005 * generator.normal(size=(count, 12))
    ranges[:, 3] += 0.5
    receivers = {"id": np.arange(12.0), **{c: STATIONS[:, i] for i, c in enumerate("xyz")}}

    def solved(members):
        epochs = np.arange(float(len(members)))
        seen = {
            "e": np.repeat(epochs, 12),
            "receiver": np.tile(np.arange(12.0), len(members)),
            "range": ranges[members].ravel(),
        }
        text = PLACES.format(robust=robust, noise=":sigma 5mm")
        return mbm.loads(text).solve(data={"receivers": receivers, "epochs": {"e": epochs}, "ranges": seen})

    together = solved(np.arange(count))
    assert together.first.method == "dogleg-sparse"
    for member in range(0, count, 20):
        alone = solved(np.array([member]))
        np.testing.assert_allclose(together["p"].value[member], alone["p"].value[0], atol=1e-9)
        # How many outliers may be within the limits is told by all rows together: a thousandth of them or so, where the
        # tails that are cut off make 0.8 % of a standard deviation.
        np.testing.assert_allclose(together["p"].sigma[member], alone["p"].sigma[0], rtol=4e-3)


def chain_data(count, generator):
    """Levelling: neighbours, shortcuts to every tenth, and wrong shortcuts."""
    height = np.cumsum(generator.normal(size=count))
    height -= height[0]
    pairs = [(i, i + 1) for i in range(count - 1)] + [(i, i + 10) for i in range(0, count - 10, 2)]
    good = len(pairs)
    inner = np.arange(12, count - 12, 2)  # ends hang on one step alone: nothing tells which of two is wrong there
    pairs += [tuple(generator.choice(inner, 2, replace=False)) for _ in range(8)]
    a, b = np.array(pairs).T
    dh = height[b] - height[a] + 0.01 * generator.normal(size=len(pairs))
    dh[good:] += generator.choice([-1.0, 1.0], 8) * generator.uniform(1.0, 4.0, 8)
    return height, a, b, dh, np.arange(len(pairs)) >= good


@pytest.mark.parametrize("robust", ["gnc", "lmeds"])
@pytest.mark.parametrize("noise", [":sigma 0.01", ":sigma unknown"])
def test_a_long_chain_with_wrong_shortcuts(noise, robust):
    generator = np.random.default_rng(12)
    count = 80
    height, a, b, dh, bad = chain_data(count, generator)
    data = {
        "nodes": {"id": np.arange(float(count)), "first": np.zeros(count)},
        "steps": {"a": a.astype(float), "b": b.astype(float), "dh": dh},
    }
    found = mbm.loads(CHAIN.format(noise=noise, robust=robust)).solve(data=data).solves[0]
    listed = np.array(found.residual_summaries["steps"].outliers) - 1
    assert set(np.flatnonzero(bad)) <= set(listed)
    assert len(listed) <= bad.sum() + 3
    # Chains between shortcuts drift by 0.01 √10 at most, and the shortcuts add up over eight of them.
    assert np.abs(np.ravel(found.estimates[0].value) - height).max() < 0.15


@pytest.mark.parametrize("robust", ["lmeds", "ransac", "msac", "gnc"])
def test_wrong_matches_do_not_turn_an_alignment(robust):
    generator = np.random.default_rng(13)
    points = generator.uniform(-2, 2, (40, 3))
    rotation = Rotation.from_rotvec([0.4, -0.9, 1.2])
    moved = 1.7 * rotation.apply(points) + [1.0, 2.0, 3.0] + 0.01 * generator.normal(size=(40, 3))
    bad = generator.choice(40, 8, replace=False)
    moved[bad] += generator.choice([-1.0, 1.0], (8, 3)) * generator.uniform(0.5, 2.0, (8, 3))
    data = {"t": dict(zip("xyzuvw", np.hstack([points, moved]).T, strict=True))}
    solve = mbm.loads(ALIGN.format(robust=robust)).solve(data=data).solves[0]
    assert set(bad + 1) <= set(solve.residual_summaries["t"].outliers)
    value, sigma = np.ravel(solve.estimates[0].value), np.ravel(solve.estimates[0].sigma)
    found = Rotation.from_quat(np.roll(value[:4], -1))
    off = np.concatenate([(rotation.inv() * found).as_rotvec(), value[4:7] - [1.0, 2.0, 3.0]])
    assert (np.abs(off) < 4.5 * sigma[:6]).all()


def test_points_off_an_ellipse_with_errors_in_both_coordinates():
    generator = np.random.default_rng(14)
    angle = generator.uniform(0, 2 * np.pi, 40)
    x = 3 * np.cos(angle) + 1 + 0.02 * generator.normal(size=40)
    y = 2 * np.sin(angle) + 0.5 + 0.02 * generator.normal(size=40)
    x[[2, 7, 11]] = 1 + 1.3 * (x[[2, 7, 11]] - 1)
    y[[2, 7, 11]] = 0.5 + 1.3 * (y[[2, 7, 11]] - 0.5)
    solve = mbm.loads(ELLIPSE).solve(data={"t": {"x": x, "y": y}}).solves[0]
    assert {3, 8, 12} <= set(solve.residual_summaries["t"].outliers)
    assert solve.residual_summaries["t"].used >= 35
    found = np.concatenate([np.ravel(e.value) for e in solve.estimates])
    sigma = np.concatenate([np.ravel(e.sigma) for e in solve.estimates])
    assert (np.abs(found - [1.0, 0.5, 3.0, 2.0]) < 4.5 * sigma).all()


@pytest.mark.parametrize("init", ["0", "7"])
def test_a_far_start_of_very_many_connected_unknowns_is_no_end(init):
    """A chain over kilometres from zeros: every equation is thousands of deviations off there, whatever it is worth."""
    random = np.random.default_rng(1)
    count = 100
    heights = np.concatenate([[0.0], np.cumsum(50 + 20 * random.normal(size=count - 1))])
    pairs = np.array([(i, i + step) for step in (1, 2, 3) for i in range(count - step)])
    wrong = random.choice(len(pairs), 30, replace=False)
    rises = heights[pairs[:, 1]] - heights[pairs[:, 0]] + 0.01 * random.normal(size=len(pairs))
    rises[wrong] += 5 * random.normal(size=30)
    data = {"nodes": {"id": np.arange(count)}, "steps": {"a": pairs[:, 0], "b": pairs[:, 1], "dh": rises}}
    text = CHAIN.format(noise=":sigma 0.01", robust="lmeds").replace(":init first", f":init {init}")
    found = mbm.loads(text).solve(data=data)
    good = np.setdiff1d(np.arange(len(pairs)), wrong)
    slopes = np.zeros((len(good), count))
    slopes[np.arange(len(good)), pairs[good, 1]] = 1.0
    slopes[np.arange(len(good)), pairs[good, 0]] = -1.0
    expected = np.linalg.lstsq(slopes[:, 1:], rises[good], rcond=None)[0]
    # of good rows 5 % are left out, and of wrong ones those within some deviations stay: a deviation of 0.01 or two
    np.testing.assert_allclose(found["h"].value[1:], expected, atol=0.03)


@pytest.mark.parametrize("sizes", [(1,), (2,), (1, 3)])
def test_noise_of_inliers_is_that_before_the_tails_were_cut_off(sizes):
    random = np.random.default_rng(7)
    components = np.repeat(np.array(sizes), 60_000)
    squares = 4.0 * random.chisquare(components)
    limits = 4.0 * chi2.ppf(0.9, components)
    units = Units(
        of_row=np.repeat(np.arange(len(components)), components),
        components=components,
        group=np.zeros(len(components), dtype=np.int64),
        number=np.arange(len(components)),
        rounding=np.zeros(len(components)),
    )
    redundancy = components * (1.0 - 3.0 / components.sum())  # three unknowns
    found = noise_of_inliers(squares, squares <= limits, np.ones(len(components)), units, redundancy, limits)
    # 4 is the variance; that of sixty thousand squares, a tenth of which is cut off, is known to a percent
    np.testing.assert_allclose(found, 4.0, rtol=0.02)
