"""Of a quaternion and its negative, which turn alike, all outputs give the same: w is not negative."""

from __future__ import annotations

import csv
import json
import shutil
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.rotations import signed, vector_of_quaternion
from tests.emit.making import emitted, make, run, written

TURN = np.deg2rad(190.0)
"""About z, and begun at 170°: the way there leads past the half turn, where w changes its sign."""
BASE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
TRUE = Rotation.from_rotvec([0.0, 0.0, TURN])
ROWS = " ".join(f"({k} {' '.join(map(repr, map(float, (*x, *TRUE.apply(x)))))})" for k in (1, 2) for x in BASE)


def text(solve: str, data: str = "d", per: str = "") -> str:
    """A rotation or a pose from directions."""
    return f"""(problem turned (data {data} (table (k x y z u v w) {ROWS}))
      (unknowns (T (pose 3) {per} :init (pose3 (axis-angle [0 0 170deg]) [0 0 0])))
      (observe d (= [u v w] (transform {"(T k)" if per else "T"} [x y z])) :sigma 1cm) {solve})"""


WANTED = TRUE.as_quat(canonical=True, scalar_first=True)
CLOSE = {"atol": 1e-9}
"""The rows are exact but for rounding."""


def test_of_both_the_one_whose_first_number_is_positive():
    there = [[0.5, -0.5, 0.5, 0.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.6, -0.8], [0.0, 0.0, 0.0, 1.0]]
    for q in (np.array(there), -np.array(there)):
        found = signed(q)
        np.testing.assert_array_equal(found, there)
        assert not bool(np.signbit(found[found == 0.0]).any())
        np.testing.assert_allclose(vector_of_quaternion(q[1:]), np.pi * np.array(there)[1:, 1:], rtol=1e-15)


def test_documents_and_python_give_the_same_sign():
    result = mbm.loads(text("")).solve()
    assert WANTED[0] > 0.0
    np.testing.assert_allclose(result["T"].quaternion, WANTED, **CLOSE)
    np.testing.assert_allclose(result["T"].value[:4], WANTED, **CLOSE)
    np.testing.assert_allclose(result["T"].rotation, TRUE.as_matrix(), **CLOSE)
    document = json.loads(result.to_json())
    held = document["solves"][0]["estimates"]["T"]["value"]["quaternion"]
    np.testing.assert_array_equal(held, result["T"].quaternion)


def test_many_solves_members_and_arrays_give_it_too():
    each = mbm.loads(text("(for-each k)")).solve()
    np.testing.assert_allclose([one["T"].quaternion for one in each.solves], [WANTED, WANTED], **CLOSE)
    family = mbm.loads(text("", per=":per d.k")).solve()
    np.testing.assert_allclose(family["T"].quaternion, [WANTED, WANTED], **CLOSE)
    np.testing.assert_allclose(family["T"][2].quaternion, WANTED, **CLOSE)
    columns = np.array([row.split() for row in ROWS[1:-1].split(") (")], dtype=float).T
    found = mbm.loads(text("")).compile().estimator("u", "v", "w")(*columns[4:])
    np.testing.assert_allclose(found["T"][:4], WANTED, **CLOSE)


@pytest.mark.parametrize("target", ["python", "c"])
def test_generated_solvers_print_it(target, tmp_path):
    if target == "c" and shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) is here")
    folder = written(emitted(mbm.loads(text("")), target), tmp_path)
    if target == "c":
        assert make(folder).returncode == 0
    program = ("./turned",) if target == "c" else (sys.executable, "turned.py")
    lines = csv.DictReader(run(*program, "data/d.csv", folder=folder).stdout.splitlines())
    np.testing.assert_allclose([float(line["value"]) for line in lines][:4], WANTED, **CLOSE)
