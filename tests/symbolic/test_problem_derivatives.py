"""Every block of every problem that ships with mbm, and of two examples besides: kernel = SymPy = differences."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import mbm
from tests.symbolic.derivatives import LONG, blocks_of, check

ROOT = Path(__file__).parents[2]
PROBLEMS = ROOT / "problems"
AT_A_KINK = ("boat",)
"""Problems that start where a norm is 0."""
FILES = [path for path in sorted(PROBLEMS.glob("*/*.mbm")) if path.stem not in (*LONG, *AT_A_KINK)]
CASES = [(path, name) for path in FILES for name in mbm.load(path).names]
EXAMPLES = ROOT / "tests" / "problems" / "examples"
ROWS = 2
"""Rows of each block that are compared: the equations of all rows of a block are the same."""


@pytest.mark.parametrize(("path", "name"), CASES, ids=[f"{p.parent.name}:{n}" for p, n in CASES])
def test_problem(path, name):
    count = 0
    for block, kernel, inputs in blocks_of(mbm.load(path).named(name)):
        for row in inputs[:ROWS]:
            check(block, kernel, row)
            count += 1
    assert count > 0


@pytest.fixture
def folder(tmp_path):
    """The examples beside the data of the problems of the same name."""
    for path in EXAMPLES.glob("*.mbm"):
        shutil.copy(path, tmp_path)
    for name in ("desk/furniture.mbm", "skeleton/skeleton_joints.csv", "skeleton/skeleton_dofs.csv"):
        shutil.copy(PROBLEMS / name, tmp_path)
    corners = [
        f"{part},{40 * i},{-30 * i}" for i, part in enumerate(("board/vertex/1", "board/vertex/3", "leg2/origin"))
    ]
    (tmp_path / "corners.csv").write_text("path,X,Y\n" + "\n".join(corners) + "\n")
    return tmp_path


# That of `problems/` has the same equations, which `test_problem` compares in each run.
SKELETON = pytest.param("skeleton", "skeleton-near", 15, marks=pytest.mark.slow)


@pytest.mark.parametrize(("file", "name", "groups"), [("desk", "desk", 3), SKELETON])
def test_example(file, name, groups, folder):
    found = list(blocks_of(mbm.load(folder / f"{file}.mbm").named(name)))
    assert len({(b.owner, b.case) for b, _, _ in found if b.purpose.value == "equation"}) >= groups
    for block, kernel, inputs in found:
        check(block, kernel, inputs[0])
