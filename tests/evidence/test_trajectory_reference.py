"""The trajectories of shared/reference: every window's alignment, by similarity, by rigid motion, with Huber's loss."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest

import mbm
from tests.evidence.material import shared

DIGITS = 1e-9
"""What the reference asks for; its numbers carry ten significant digits of inputs and thirteen of results."""
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
    folder = tmp_path_factory.mktemp("walk")
    shutil.copy(shared("reference", "trajectory", "ble_pdr_1hz.csv"), folder / "ble.csv")
    shutil.copy(shared("reference", "trajectory", "vio_10hz.csv"), folder / "vio.csv")

    def solve(length, kind="(similarity 2)", sigma="1m", options=""):
        text = WALK.format(length=length, kind=kind, sigma=sigma, options=options)
        return mbm.loads(text, base=folder).solve()

    return solve


def columns(name):
    with shared("reference", "trajectory", name).open() as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


def samples():
    """The positions of both tracks at the same instants, as complex numbers (n,)."""
    ble, vio = columns("ble_pdr_1hz.csv"), columns("vio_10hz.csv")
    place = {round(10 * t): i for i, t in enumerate(vio["t"])}
    chosen = [place[round(10 * t)] for t in ble["t"]]
    return vio["x"][chosen] + 1j * vio["y"][chosen], ble["x"] + 1j * ble["y"]


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


@pytest.mark.parametrize(("length", "name"), [(60, "align_similarity_T60.csv"), (1000, "align_similarity_Tall.csv")])
def test_every_similarity_is_that_of_the_reference(walk, length, name):
    """Windows in which the reference falls back to the Bluetooth point have no alignment to compare."""
    wanted = columns(name)
    result = walk(length)
    assert [s.key["t"] for s in result.solves] == wanted["t"].tolist()
    assert [s.status.label for s in result.solves if s.key["t"] < 1] == ["skipped"]
    solved = found(result)
    assert result.status == "ok"
    compared = np.flatnonzero(wanted["fallback"] == 0)
    assert len(compared) > 390
    for i in compared:
        scale, turn, shift, cost, here = solved[wanted["t"][i]]
        assert abs(scale - wanted["c"][i]) < DIGITS
        assert abs(np.angle(turn * np.exp(-1j * wanted["yaw"][i]))) < DIGITS
        assert abs(shift - complex(wanted["tx"][i], wanted["ty"][i])) < DIGITS
        assert abs(cost - wanted["cost"][i]) < DIGITS
        assert abs(here - complex(wanted["x_est"][i], wanted["y_est"][i])) < DIGITS


def rigid(vio, ble, weights):
    """The weighted rigid motion in the plane: the turn is the argument of one complex sum."""
    weights = weights / weights.sum()
    p, q = (weights * vio).sum(), (weights * ble).sum()
    turn = (weights * (ble - q) * np.conj(vio - p)).sum()
    turn /= abs(turn)
    return turn, q - turn * p


def test_every_rigid_motion_is_the_one_computed_apart(walk):
    vio, ble = samples()
    solved = found(walk(60, kind="(pose 2)"))
    for end in range(1, 396):
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
        mean, other = np.average(vio, weights=weights), np.average(ble, weights=weights)
        turn = (weights * (ble - other) * np.conj(vio - mean)).sum() / (weights * np.abs(vio - mean) ** 2).sum()
        shift = other - turn * mean
        distance = np.abs(ble - turn * vio - shift)
        again = np.minimum(1, limit / np.maximum(distance, 1e-300))
        if np.abs(again - weights).max() < 1e-14:
            break
        weights = again
    return turn, shift


def test_every_similarity_under_hubers_loss_is_the_one_computed_apart(walk):
    """The paper's variant: k = 1.345 of 0.5 m."""
    vio, ble = samples()
    solved = found(walk(60, sigma="0.5m", options=":loss (huber 1.345)"))
    for end in range(20, 396, 5):
        rows = slice(max(end - 59, 0), end + 1)
        turn, shift = huber_similarity(vio[rows], ble[rows], 1.345 * 0.5)
        scale, found_turn, moved, _, here = solved[float(end)]
        # The weights of the iteration settle to 1e-14, the estimates to some 1e-10 where it is slow.
        assert abs(scale * found_turn - turn) < DIGITS
        assert abs(moved - shift) < 10 * DIGITS
        assert abs(here - (turn * vio[end] + shift)) < DIGITS
