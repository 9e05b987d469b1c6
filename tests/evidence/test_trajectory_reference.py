"""Two tracks of one walk: every window's alignment, by similarity, by rigid motion, with Huber's loss."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest

import mbm
from tests.evidence.material import read_numbers, write_table

DIGITS = 1e-9
"""What the reference asks for; its numbers carry ten significant digits of inputs and thirteen of results."""
REFERENCE = {
    (60, 75.0): (1.033765708856, 2.123798964795, 3.898294924946, -7.018566674862, 34.5975123004),
    (60, 199.0): (1.108771737884, 2.116798588024, 4.484272637609, -7.904998734231, 46.3979200674),
    (1000, 130.0): (1.04762796275, 2.120778331051, 3.848277282724, -7.290862017471, 97.10290655507),
    (1000, 199.0): (1.070928498475, 2.113987493995, 3.929324289748, -7.519229410987, 185.3420379375),
}
"""Scale, turn in rad, shift in m and cost in m² of some windows, by length and end in s."""
WALKED = Path(__file__).with_name("office_walk.csv")
COUNT = 200
"""Seconds of the walk, made after Yamamoto (2019): laps of 13 m by 19 m, by radio and step counts, and by camera."""
WALK = """
(problem office-walk
  (data ble (csv "ble.csv"))
  (data vio (csv "vio.csv"))
  (pair both (ble vio) :by t :tolerance 10ms)
  (unknowns (S {kind}))
  (observe both (= [ble.x ble.y] (transform S [vio.x vio.y])) :sigma {sigma} {options})
  (window t :length {length} :step 1 :min-rows 2)
  (derive (here (transform S (last both [vio.x vio.y])))))
"""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Solves windows of the walk, each kind once: the result, and what is `found` in it.

    The camera's track has nine places more in every second, which find no partner.
    """
    folder = tmp_path_factory.mktemp("walk")
    track = read_numbers(WALKED)
    t = track["t"]
    write_table(folder / "ble.csv", {"t": t.tolist(), "x": track["ble_x"].tolist(), "y": track["ble_y"].tolist()})
    between = np.round(np.arange(0, t[-1] + 0.05, 0.1), 1)
    vio = {name: np.interp(between, t, track[f"vio_{name}"]).tolist() for name in "xy"}
    write_table(folder / "vio.csv", {"t": between.tolist(), **vio})

    @functools.cache
    def solve(length, kind="(similarity 2)", sigma="1m", options=""):
        text = WALK.format(length=length, kind=kind, sigma=sigma, options=options)
        result = mbm.loads(text, base=folder).solve()
        return result, found(result)

    return solve


def samples():
    """The positions of both tracks at the same instants, as complex numbers (n,)."""
    track = read_numbers(WALKED)
    return track["vio_x"] + 1j * track["vio_y"], track["ble_x"] + 1j * track["ble_y"]


def found(result):
    """Scale, turn, translation, cost and newest point (complex) of each solved window, by its end."""
    by_end = {}
    for solve in json.loads(result.to_json())["solves"]:
        if solve["status"] == "skipped":
            continue
        assert solve["status"] == "converged", solve["key"]
        motion = solve["estimates"]["S"]["value"]
        turn = complex(motion["matrix"][0][0], motion["matrix"][1][0])
        here = complex(*solve["derived"]["here"]["value"])
        shift = complex(*motion["translation"])
        by_end[solve["key"]["t"]] = (motion.get("scale", 1.0), turn, shift, solve["cost"], here)
    return by_end


def similarity(vio, ble, weights):
    """The weighted similarity of the plane, by complex numbers: ``ble = turn · vio + shift``, scale in the turn."""
    mean, other = np.average(vio, weights=weights), np.average(ble, weights=weights)
    turn = (weights * (ble - other) * np.conj(vio - mean)).sum() / (weights * np.abs(vio - mean) ** 2).sum()
    return turn, other - turn * mean


@pytest.mark.parametrize("length", [60, 1000])
def test_every_similarity_is_the_one_computed_apart(walk, length):
    vio, ble = samples()
    result, solved = walk(length)
    assert [s.key["t"] for s in result.solves] == list(range(COUNT))
    assert [s.status for s in result.solves if s.key["t"] < 1] == ["skipped"]
    assert result.status == "ok"
    for end in range(1, COUNT):
        rows = slice(max(end - length + 1, 0), end + 1)
        turn, shift = similarity(vio[rows], ble[rows], np.ones(end + 1 - rows.start))
        scale, found_turn, moved, cost, here = solved[float(end)]
        assert abs(scale * found_turn - turn) < DIGITS
        assert abs(moved - shift) < DIGITS
        assert abs(cost - (np.abs(ble[rows] - turn * vio[rows] - shift) ** 2).sum()) < DIGITS
        assert abs(here - (turn * vio[end] + shift)) < DIGITS


@pytest.mark.parametrize(("length", "end"), REFERENCE)
def test_windows_of_the_reference(walk, length, end):
    """Computed apart by the singular value decomposition (Umeyama 1991)."""
    scale, turn, shift, cost, _ = walk(length)[1][end]
    wanted_scale, yaw, x, y, wanted_cost = REFERENCE[length, end]
    assert abs(scale - wanted_scale) < DIGITS
    assert abs(np.angle(turn * np.exp(-1j * yaw))) < DIGITS
    assert abs(shift - complex(x, y)) < DIGITS
    assert abs(cost - wanted_cost) < DIGITS


def rigid(vio, ble, weights):
    """The weighted rigid motion in the plane: the turn is the argument of one complex sum."""
    weights = weights / weights.sum()
    p, q = (weights * vio).sum(), (weights * ble).sum()
    turn = (weights * (ble - q) * np.conj(vio - p)).sum()
    turn /= abs(turn)
    return turn, q - turn * p


def test_every_rigid_motion_is_the_one_computed_apart(walk):
    vio, ble = samples()
    _, solved = walk(60, kind="(pose 2)")
    for end in range(1, COUNT):
        rows = slice(max(end - 59, 0), end + 1)
        turn, shift = rigid(vio[rows], ble[rows], np.ones(end + 1 - rows.start))
        _, found_turn, moved, cost, here = solved[float(end)]
        assert abs(found_turn - turn) < DIGITS
        assert abs(moved - shift) < DIGITS
        assert abs(cost - (np.abs(ble[rows] - turn * vio[rows] - shift) ** 2).sum()) < DIGITS
        assert abs(here - (turn * vio[end] + shift)) < DIGITS


def huber_similarity(vio, ble, limit):
    """The similarity that minimises Huber's loss, by weights min(1, limit/|r|) until they settle."""
    weights = np.ones(len(vio))
    for _ in range(5000):
        turn, shift = similarity(vio, ble, weights)
        distance = np.abs(ble - turn * vio - shift)
        again = np.minimum(1, limit / np.maximum(distance, 1e-300))
        if np.abs(again - weights).max() < 1e-14:
            break
        weights = again
    return turn, shift


def test_every_similarity_under_hubers_loss_is_the_one_computed_apart(walk):
    """The paper's variant: k = 1.345 of 0.5 m."""
    vio, ble = samples()
    _, solved = walk(60, sigma="0.5m", options=":loss (huber 1.345)")
    for end in range(20, COUNT, 5):
        rows = slice(max(end - 59, 0), end + 1)
        turn, shift = huber_similarity(vio[rows], ble[rows], 1.345 * 0.5)
        scale, found_turn, moved, _, here = solved[float(end)]
        # The weights of the iteration settle to 1e-14, the estimates to some 1e-10 where it is slow.
        assert abs(scale * found_turn - turn) < DIGITS
        assert abs(moved - shift) < 10 * DIGITS
        assert abs(here - (turn * vio[end] + shift)) < DIGITS
