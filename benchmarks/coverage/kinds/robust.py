"""Losses and consensus, with and without outliers, noise stated and unknown, leverage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import LINE, line, normal, problem, table, with_outliers


def _loss(rows: int, loss: str, sigma: str = "unknown", share: float = 0.0) -> Kind:
    x = np.linspace(0.0, 1.0, rows)
    noise = with_outliers(share, 20.0, 0.1) if share else normal(0.1)
    return line(problem("(a) (b)", f"{LINE} :sigma {sigma} :loss {loss}"), x, noise)


def _consensus(rows: int, robust: str, sigma: str = "unknown", share: float = 0.0) -> Kind:
    x = np.linspace(0.0, 1.0, rows)
    noise = with_outliers(share, 40.0, 0.1) if share else normal(0.1)
    return line(problem("(a) (b)", f"{LINE} :sigma {sigma}", f"(solve :robust {robust})"), x, noise)


def _leverage(error: float, loss: str, sigma: str) -> Kind:
    """The last of 25 points stands far away from the others, with a gross error or without."""
    x: Floats = np.append(np.linspace(0.0, 1.0, 24), 10.0)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y = 2 - x + 0.1 * rng.normal(size=(runs, 25))
        y[:, -1] += error
        return {"d": table(runs, x=x, y=y)}, {"a": 2.0, "b": -1.0}

    return Kind(problem("(a) (b)", f"{LINE} :sigma {sigma} :loss {loss}"), make)


KINDS: Mapping[str, Kind] = {
    "huber, stated": _loss(25, "(huber 1.5)", "0.1"),
    "huber, stated, 8 rows": _loss(8, "(huber 1.5)", "0.1"),
    "huber, stated twice too large": _loss(40, "(huber 1.5)", "0.2"),
    "huber, 10 % outliers": _loss(60, "(huber 1.5)", "0.1", 0.1),
    "cauchy, 10 % outliers": _loss(60, "(cauchy)", "0.1", 0.1),
    "tukey, stated, 10 % outliers": _loss(60, "tukey", "0.1", 0.1),
    "soft-l1, stated": _loss(25, "soft-l1", "0.1"),
    "huber, unknown noise, 6 rows": _loss(6, "(huber 1.5)"),
    "huber, unknown noise, 8 rows": _loss(8, "(huber 1.5)"),
    "huber, unknown noise, 12 rows": _loss(12, "(huber 1.5)"),
    "huber, unknown noise, 40 rows": _loss(40, "(huber 1.5)"),
    "cauchy, unknown noise, 12 rows": _loss(12, "(cauchy)"),
    "geman-mcclure, unknown noise, 12 rows": _loss(12, "geman-mcclure"),
    "tukey, unknown noise, 8 rows": _loss(8, "tukey"),
    "tukey, unknown noise, 12 rows": _loss(12, "tukey"),
    "tukey, unknown noise, 15 rows": _loss(15, "tukey"),
    "tukey, unknown noise, 20 rows": _loss(20, "tukey"),
    "tukey, unknown noise, 60 rows": _loss(60, "tukey"),
    "tukey, unknown noise, 60 rows, 10 % outliers": _loss(60, "tukey", share=0.1),
    "consensus, stated": _consensus(25, "lmeds", "0.1"),
    "consensus, stated, 10 % outliers": _consensus(60, "lmeds", "0.1", 0.1),
    "consensus, unknown noise, 10 rows": _consensus(10, "lmeds"),
    "consensus, unknown noise, 15 rows": _consensus(15, "lmeds"),
    "consensus, unknown noise, 40 rows": _consensus(40, "lmeds"),
    "consensus, unknown noise, 40 rows, 10 % outliers": _consensus(40, "lmeds", share=0.1),
    "truncated least squares, 10 % outliers": _consensus(60, "(gnc :quantile 99%)", "0.1", 0.1),
    "huber, bad leverage point": _leverage(5.0, "(huber 1.5)", "0.1"),
    "huber, bad leverage point, unknown noise": _leverage(5.0, "(huber 1.5)", "unknown"),
    "huber, good leverage point": _leverage(0.0, "(huber 1.5)", "0.1"),
}
