"""Consensus and losses with unknown noise beside rows of other noise, which tell nothing of the same unknowns."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import mbm
from tests.emit.making import of_text, run, written

LINE = """(problem line (data d external) {data} (unknowns (a :init 0) (b :init 0))
  (observe d (= y (+ a (* b x))) :sigma unknown {loss}) {more} {solve})"""
BESIDE = """(unknowns (offset :per far.place :init 0))
  (observe far (= z (+ a (offset place))) :sigma 0.7)"""
WRONG = (3, 8, 11)


def _data(seed: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    x = np.linspace(0.0, 4.0, 14)
    y = 1.0 + 2.0 * x + 0.1 * generator.normal(size=14)
    y[list(WRONG)] += generator.uniform(3.0, 9.0, 3)
    return {"x": x, "y": y}


def _beside(count: int, seed: int, loss: str = "", solve: str = "") -> tuple[mbm.Solved, mbm.Solved]:
    """The answers of the line alone, and beside so many rows of which each has an unknown of its own."""
    data = {"d": _data(seed)}
    alone = mbm.loads(LINE.format(data="", more="", loss=loss, solve=solve)).solve(data=data)
    problem = mbm.loads(LINE.format(data="(data far external)", more=BESIDE, loss=loss, solve=solve))
    data["far"] = {"place": np.arange(float(count)), "z": np.cos(np.arange(count))}
    return alone, problem.solve(data=data)


@pytest.mark.parametrize("kind", ["lmeds", "msac"])
@pytest.mark.parametrize("count", [8, 20, 70])
def test_rows_with_unknowns_of_their_own_change_nothing(kind, count):
    """Each tells its own offset, so that the line, its noise and its outliers are those of the line alone.

    With unknowns shared out by the number of rows the noise was 50 times as large, and nothing an outlier; of more than
    60 unknowns it was 15 times as large.
    """
    for seed in range(2):
        alone, beside = _beside(count, seed, solve=f"(solve :robust {kind})")
        assert beside.record.dof == alone.record.dof == 9
        for name in "ab":
            assert beside[name].value == pytest.approx(alone[name].value, abs=1e-9)
            assert beside[name].sigma == pytest.approx(alone[name].sigma, rel=1e-7)
        kept = np.delete(np.arange(14), WRONG)
        wanted = np.polyfit(_data(seed)["x"][kept], _data(seed)["y"][kept], 1)
        assert [beside["b"].value, beside["a"].value] == pytest.approx(wanted.tolist(), abs=1e-8)


@pytest.mark.parametrize("loss", ["huber", "tukey"])
@pytest.mark.parametrize("count", [8, 20, 70])
def test_nor_do_they_where_a_loss_goes_with_the_noise(loss, count):
    """From twelve rows on there was no redundancy left by their number, and no standard deviation."""
    alone, beside = _beside(count, 1, loss=f":loss {loss}")
    for name in "ab":
        assert beside[name].value == pytest.approx(alone[name].value, abs=1e-7)
        assert beside[name].sigma == pytest.approx(alone[name].sigma, rel=1e-5)


def test_nor_in_generated_solvers(tmp_path):
    """They took the noise for 1, and the gross errors with it: 2.05 with 0.21 for a slope of 1.981 with 0.015."""
    line = "".join(f"({x!r} {y!r})" for x, y in zip(*(each.tolist() for each in _data(1).values()), strict=True))
    far = "".join(f"({place} {np.cos(place):.4f})" for place in range(20))
    text = LINE.format(data=f"(data far (table (place z) {far}))", more=BESIDE, loss=":loss huber", solve="")
    text = text.replace("(data d external)", f"(data d (table (x y) {line}))")
    folder = written(of_text(text, "python"), tmp_path)
    rows = run(sys.executable, "line.py", "data/d.csv", "data/far.csv", folder=folder).stdout.splitlines()
    wanted = mbm.loads(text).solve()["b"]
    found = next(row.split(",") for row in rows if row.startswith("b,"))
    assert float(found[1]) == pytest.approx(wanted.value, abs=1e-9)
    assert float(found[2]) == pytest.approx(wanted.sigma, rel=1e-9)
