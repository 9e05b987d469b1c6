"""Unknown noise of what agrees is the solution of its own equations, and the same whatever computes it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2

import mbm

LINE = (
    "(problem line (data points external) (unknowns (a :init 0) (b :init 0))"
    " (observe points (= y (+ a (* b x))) {option}){more})"
)
TWO = (
    "(problem line (data points external) (data others external) (unknowns (a :init 0) (b :init 0))"
    " (observe points (= y (+ a (* b x))) :loss huber) (observe others (= y (+ a (* b x x))) :loss huber))"
)


def points(seed, rows, outliers):
    generator = np.random.default_rng(seed)
    x = np.linspace(0, 10, rows)
    y = 1 + 2 * x + 0.1 * generator.normal(size=rows)
    y[generator.choice(rows, outliers, replace=False)] += 5
    return {"x": x, "y": y}


def document(text, data, backend):
    return json.loads(mbm.loads(text).compile(data=data, backend=backend).solve().to_json())["solves"]


def left(ratio):
    """Variance that standard normal numbers keep whose squares are up to ``ratio``."""
    return chi2.cdf(ratio, 3) / chi2.cdf(ratio, 1)


@pytest.mark.parametrize("backend", ["numpy", "native"])
@pytest.mark.parametrize("rows", [12, 30])
@pytest.mark.parametrize("seed", range(6))
def test_the_noise_of_a_loss_solves_its_equations(backend, rows, seed):
    """Rousseeuw and Leroy's scale where the line fits those inside, and the variance that is left inside of limits."""
    if backend == "native":
        pytest.importorskip("llvmlite")
    data = points(seed, rows, seed % 4)
    (solve,) = document(LINE.format(option=":loss huber", more=""), {"points": data}, backend)
    found = solve["noise"]["points"] ** 2
    design = np.column_stack([np.ones(rows), data["x"]])

    def consistent(inside):
        """The noise if just these are inside; None if its limits say something else."""
        fit = np.linalg.lstsq(design[inside], data["y"][inside], rcond=None)[0]
        squares = np.square(data["y"] - design @ fit)
        scale = np.median(squares) / chi2.ppf(0.5, 1) * (1 + 5 / (rows - 2)) ** 2
        raw = squares[inside].sum() / (inside.sum() * (1 - 2 / inside.sum()))
        limit = 2.5**2 * scale
        if (squares[inside] > limit).any():  # three deviations of those inside, where 2.5 robust ones leave one out
            noise = raw / left(9.0)
            limit = max(limit, 9 * noise)
            if (squares[inside] > limit).any():
                return None
        else:
            noise = brentq(lambda v: v * left(limit / v) - raw, raw, 10 * raw, xtol=1e-300, rtol=1e-14)
        return noise if ((squares <= max(limit, 9 * noise)) == inside).all() else None

    (kept,) = document(LINE.format(option="", more=" (solve :robust lmeds)"), {"points": data}, backend)
    fit = np.array([kept["estimates"]["a"]["value"], kept["estimates"]["b"]["value"]])
    order = np.argsort(np.abs(data["y"] - design @ fit))
    told = []
    for count in range(rows // 2, rows + 1):
        inside = np.zeros(rows, dtype=bool)
        inside[order[:count]] = True
        noise = consistent(inside)
        if noise is not None:
            told.append(noise)
    # 1e-10: the median of squares carries the point's rounding to first order, some 1e-14 beside residuals of 0.1
    assert any(abs(found / noise - 1) < 1e-10 for noise in told), (found, told)


@pytest.mark.parametrize("loss", ["huber", "tukey", "cauchy"])
@pytest.mark.parametrize("rows", [8, 21, 47])
def test_backends_and_batches_have_one_noise(loss, rows):
    pytest.importorskip("llvmlite")
    sets = [points(seed, rows, seed % (rows // 4 + 1)) for seed in range(8)]
    alone = LINE.format(option=f":loss {loss}", more="")
    every = LINE.format(option=f":loss {loss}", more=" (for-each k)")
    joined = {name: np.concatenate([each[name] for each in sets]) for name in "xy"}
    joined["k"] = np.repeat(np.arange(float(len(sets))), rows)
    together = [document(every, {"points": joined}, backend) for backend in ("numpy", "native")]
    for number, data in enumerate(sets):
        expected = document(alone, {"points": data}, "numpy")[0]["noise"]["points"]
        others = [document(alone, {"points": data}, "native")[0], *(solves[number] for solves in together)]
        # Rounding of some dozen terms, multiplied by what limits make of it: 1e-13 is seen.
        for solve in others:
            assert solve["noise"]["points"] == pytest.approx(expected, rel=1e-11)


def test_several_unknown_noises_come_to_one_solution():
    """Weights depend on noises, and these on the fit that the weights make."""
    pytest.importorskip("llvmlite")
    for seed in range(8):
        generator = np.random.default_rng(100 + seed)
        x = np.linspace(0, 3, 17)
        others = {"x": x, "y": 1 + 2 * x * x + 0.4 * generator.normal(size=17)}
        data = {"points": points(seed, 20, seed % 4), "others": others}
        expected, found = (document(TWO, data, backend)[0]["noise"] for backend in ("numpy", "native"))
        assert found == pytest.approx(expected, rel=1e-11)
