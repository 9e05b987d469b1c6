"""Nearly straight drives past known stations, which have a mirror image: found, or told; drawn by `drives`."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from tests.estimation.sequences.drives import SIGMA_RANGE, drive, twelve

TABLES = """(data poses external :key k) (data steps external)
  (data nodes external :key node) (data ranges external :with (nodes node))"""
FAMILY = (
    """(problem drive """
    + TABLES
    + """
  (unknowns (T (pose 2) :per poses {start}) {radios})
  (observe steps (= (pose2 dx dy da) (between (T from) (T to))) :sigma [0.02 0.01 0.02])
  (observe ranges (= range {range}) :sigma 0.4))"""
)
STATES = (
    """(problem drive """
    + TABLES
    + """
  (states :over k (T (pose 2) :init (pose2 0 0 0) :sigma [{turned} 50 50]))
  (dynamics (= (next T) (compose T (pose2 steps.dx steps.dy steps.da)) :sigma [0.02 0.01 0.02]))
  (observe ranges (= range (distance (translation T) [nodes.x nodes.y])) :sigma 0.4))"""
)
PLAIN = FAMILY.format(start="", radios="", range="(distance (translation (T k)) [nodes.x nodes.y])")
RADIOS = FAMILY.format(
    start="",
    radios="(gain :per nodes) (offset :per nodes)",
    range="(+ (* (gain node) (distance (translation (T k)) [nodes.x nodes.y])) (offset node))",
)


def straight(seed, nodes, steps=60):
    """A nearly straight drive with ranges without gain and offset: true poses (n, 3), places of the nodes, tables."""
    true, places, _, _, tables = drive(seed, steps=steps, straight=True, nodes=nodes)
    ranges = tables["ranges"]
    noise = SIGMA_RANGE * np.random.default_rng(1000 + seed).normal(size=len(true))
    ranges["range"] = np.linalg.norm(true[:, :2] - places[ranges["node"]], axis=1) + noise
    return true, places, tables


def mirrored(poses, places):
    """The poses (n, 3) mirrored at the line through the first two nodes."""
    along = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    turned = 2 * np.outer(along, along) - np.eye(2)
    angle = 2 * np.arctan2(along[1], along[0]) - poses[:, 2]
    return np.column_stack([places[0] + (poses[:, :2] - places[0]) @ turned.T, angle])


def minimum(poses, places, tables):
    """The cost of the minimum that SciPy finds from some poses (n, 3)."""
    steps, ranges = tables["steps"], tables["ranges"]

    def residuals(x):
        p = x.reshape(-1, 3)
        c, s, d = np.cos(p[:-1, 2]), np.sin(p[:-1, 2]), np.diff(p, axis=0)
        turned = np.angle(np.exp(1j * (d[:, 2] - steps["da"])))
        forward, sideways = c * d[:, 0] + s * d[:, 1] - steps["dx"], c * d[:, 1] - s * d[:, 0] - steps["dy"]
        # the residual of a pose is in the frame of the measured one
        m, n = np.cos(steps["da"]), np.sin(steps["da"])
        forward, sideways = m * forward + n * sideways, m * sideways - n * forward
        far = np.linalg.norm(p[ranges["k"], :2] - places[ranges["node"]], axis=1) - ranges["range"]
        return np.concatenate([turned / 0.02, forward / 0.01, sideways / 0.02, far / SIGMA_RANGE])

    return 2 * least_squares(residuals, poses.ravel(), method="lm", xtol=1e-10).cost


@functools.cache
def minima(seed):
    """The costs of the minima beside the mirror image and the truth of a drive past two nodes."""
    true, places, tables = straight(seed, 2)
    return [minimum(poses, places, tables) for poses in (mirrored(true, places), true)]


def told(solve):
    """Whether a solve warns of another solution."""
    return any(each.code.name == "another-solution" for each in solve.diagnostics)


def wrong(result, true):
    """Whether poses lie where their standard deviations exclude them."""
    error = np.linalg.norm(result["T"].value[:, 1:] - true[:, :2], axis=1)
    return (error > 5 * np.linalg.norm(result["T"].sigma[:, 1:], axis=1)).any()


@pytest.mark.parametrize("start", ["", ":init (pose2 poses.x poses.y poses.a)"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_mirror_image_past_two_nodes_is_told(seed, start):
    """The better one is the answer, but from a stated start (seed 2) that to which it leads, as in generated solvers.
    The closed form, with which stated starts are compared, excludes the start of seed 1."""
    true, places, tables = straight(seed, 2)
    image = mirrored(true, places)
    tables["poses"] |= {"x": image[:, 0], "y": image[:, 1], "a": image[:, 2]}
    text = FAMILY.format(start=start, radios="", range="(distance (translation (T k)) [nodes.x nodes.y])")
    result = mbm.loads(text).solve(data=tables)
    costs = minima(seed)
    assert abs(costs[1] - costs[0]) < 9  # not excluded: a case that is to be told
    assert told(result.first)
    both = [result.cost, result.alternatives[0].cost]
    assert both == pytest.approx(costs if start and seed == 2 else sorted(costs), rel=1e-6)


@pytest.mark.parametrize("start", ["", ":init (pose2 poses.x poses.y poses.a)"])
def test_of_each_of_many_keys_as_of_one(start):
    true, places, tables = straight(2, 2, steps=25)
    image = mirrored(true, places)
    tables["poses"] |= {"x": image[:, 0], "y": image[:, 1], "a": image[:, 2]}
    nodes = tables.pop("nodes")
    text = FAMILY.format(start=start, radios="", range="(distance (translation (T k)) [nodes.x nodes.y])")
    one = mbm.loads(text).solve(data=tables | {"nodes": nodes})
    each = mbm.loads(text[:-1] + " (for-each run))").solve(data=twelve(tables) | {"nodes": nodes})
    assert told(one.first)
    for solve in each.solves:
        assert told(solve)
        both = [solve.cost, solve.alternatives[0].cost]
        assert both == pytest.approx([one.cost, one.alternatives[0].cost], rel=1e-6)


def test_a_third_node_beside_their_line_excludes_it():
    true, _, tables = straight(1, 3)
    result = mbm.loads(PLAIN).solve(data=tables)
    assert not told(result.first)
    assert not wrong(result, true)


@pytest.mark.parametrize(("turned", "expected"), [(3, True), (0.002, False)])
def test_states_are_told_unless_their_start_excludes_it(turned, expected):
    _, _, tables = straight(1, 2)
    steps = dict(tables["steps"])
    steps["k"] = steps.pop("to")
    del steps["from"]
    result = mbm.loads(STATES.format(turned=turned)).solve(data=tables | {"steps": steps})
    assert told(result.first) == expected


@pytest.mark.parametrize(("seed", "nodes"), [(2, 2), (0, 3)])
def test_none_is_wrong_without_a_word_where_scale_and_offset_are_unknown(seed, nodes):
    true, *_, tables = drive(seed, straight=True, nodes=nodes)
    result = mbm.loads(RADIOS).solve(data=tables)
    assert not wrong(result, true) or told(result.first)


def test_bends_are_turned_over_with_a_way_whose_odometry_drifts():
    """A way that is moved as one keeps its bends, and fits nowhere else where an unknown drift has bent it."""
    true, *_, tables = drive(100, straight=True, nodes=4, steps=80)
    text = RADIOS.replace("(offset :per nodes)", "(offset :per nodes) (b :init 0 :sigma 0.1)")
    result = mbm.loads(text.replace("(pose2 dx dy da)", "(pose2 dx dy (- da b))")).solve(data=tables)
    assert not wrong(result, true)


@pytest.mark.slow
@pytest.mark.parametrize(("text", "most"), [(PLAIN, 0), (RADIOS, 2)])
def test_twenty_drives_past_two_three_and_four_nodes(text, most):
    """Scales and offsets of either sign, one of each for a node, leave minima that are missed (2 of 60)."""
    silent = 0
    for seed in range(100, 120):
        for nodes in (2, 3, 4):
            drawn = drive(seed, straight=True, nodes=nodes) if text is RADIOS else straight(seed, nodes, 120)
            result = mbm.loads(text).solve(data=drawn[-1])
            silent += bool(wrong(result, drawn[0])) and not told(result.first)
    assert silent <= most
