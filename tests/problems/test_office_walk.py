"""An odometer's track laid onto Bluetooth positions: every window of the shared reference, and what it is good for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import mbm

ROOT = Path(__file__).parents[2]
OWN = ROOT / "problems" / "office-walk"
WINDOWS = """
(problem office-walk
  (data ble (csv "{folder}/ble_pdr_1hz.csv"))
  (data vio (csv "{folder}/vio_10hz.csv"))
  (pair both (ble vio) :by t :tolerance 10ms)
  (unknowns (S (similarity 2)))
  (observe both (= [ble.x ble.y] (transform S [vio.x vio.y])) :sigma 1m)
  (window t :length {length} :step 1 :min-rows 2)
  (derive (here (transform S (last both [vio.x vio.y])))))
"""


def reference() -> Path:
    folder = Path(os.environ.get("MBM_SHARED", ROOT.parent / "shared")) / "reference" / "trajectory"
    if not folder.exists():
        pytest.skip("the shared reference is not here (set MBM_SHARED)")
    return folder


def numbers(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def windows(text):
    """Scale, yaw, shift and newest place (n, 6) of each window, and the sigma of the place (n, 2); NaN: skipped."""
    found = []
    for solve in mbm.loads(text).solve().solves:
        if solve.status.value == "skipped":
            found.append([np.nan] * 8)
            continue
        values = {each.name: each for each in (*solve.estimates, *solve.derived)}
        yaw, x, y, scale = values["S"].value
        found.append([scale, yaw, x, y, *values["here"].value, *values["here"].sigma])
    return np.array(found)


@pytest.mark.parametrize(("length", "name"), [("60", "T60"), ("100000", "Tall")])
def test_every_window_is_that_of_the_reference(length, name):
    folder = reference()
    found = windows(WINDOWS.format(folder=folder.as_posix(), length=length))[:, :6]
    wanted = numbers(folder / f"align_similarity_{name}.csv")
    aligned = wanted["fallback"] == 0
    rows = np.column_stack([wanted[column] for column in ("c", "yaw", "tx", "ty", "x_est", "y_est")])
    apart = found - rows
    apart[:, 1] = np.remainder(apart[:, 1] + np.pi, 2 * np.pi) - np.pi
    # the reference is printed with 13 digits of c and yaw, 12 of the shift, 10 of the place
    assert np.abs(apart[aligned]).max() < 1e-9
    assert np.isnan(found[~aligned]).all()


def test_two_minutes_of_odometry_bring_the_error_to_half_a_metre():
    folder = reference()
    found = windows(WINDOWS.format(folder=folder.as_posix(), length="120"))
    ble, truth = numbers(folder / "ble_pdr_1hz.csv"), numbers(folder / "truth_10hz.csv")
    at = np.searchsorted(truth["t"], ble["t"] - 1e-6)
    true = np.column_stack([truth["x"][at], truth["y"][at]])
    before = np.hypot(ble["x"] - true[:, 0], ble["y"] - true[:, 1])
    after = np.linalg.norm(found[:, 4:6] - true, axis=1)
    # Yamamoto and others' table: 0.93 m and 0.50 m
    assert before.mean() == pytest.approx(0.94, abs=0.01)
    assert np.nanmean(after) < 0.55


def test_our_own_walk_is_placed_better_and_says_how_well():
    text = (
        (OWN / "office-walk.mbm")
        .read_text()
        .replace(":step 10", ":step 1")
        .replace('"ble.csv', f'"{OWN.as_posix()}/ble.csv')
    )
    for name in ("vio", "truth"):
        text = text.replace(f'"{name}.csv', f'"{OWN.as_posix()}/{name}.csv')
    found = windows(text)
    kept = ~np.isnan(found[:, 0])
    truth, ble = numbers(OWN / "truth.csv"), numbers(OWN / "ble.csv")
    true = np.column_stack([truth["x"], truth["y"]])
    before = np.hypot(ble["x"] - truth["x"], ble["y"] - truth["y"])
    apart = (found[:, 4:6] - true)[kept]
    assert before.mean() == pytest.approx(0.94, abs=0.01)
    assert np.linalg.norm(apart, axis=1).mean() < 0.45
    # Errors last about five seconds, windows two minutes: some four independent ones, of which the mean square
    # (normalised, per coordinate) lies in [0.27, 2.2] 95 % of the time.
    normalised = np.square(apart / found[kept, 6:8]).mean()
    assert 0.27 < normalised < 2.2
