"""A kind of problem, and how often its 95 % intervals hold the truth and its results are doubted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mbm

Floats = NDArray[np.float64]
Tables = Mapping[str, Mapping[str, Any]]
Truth = Mapping[str, Any]
Maker = Callable[[np.random.Generator, int], tuple[Tables, Truth]]
"""From a generator and the number of runs to the tables of all runs, told apart by the column `run`, and true values:
of each estimate or derived quantity one array for all runs, or (runs, …)."""

FALSE, SPURIOUS = "FALSE WITHOUT A WORD", "DOUBTED, BUT TRUE"
INSIDE = (0.93, 0.97)
DOUBTED_OUTSIDE, DOUBTED_INSIDE = 0.95, 0.10

DOUBTS = frozenset(
    (
        "another-solution",
        "autocorrelated-residuals",
        "bad-leverage",
        "coarse-readings",
        "contradicting-rows",
        "hidden-outliers",
        "improbable-noise",
        "near-bound",
        "noise-against-data",
        "noise-not-estimated",
        "outlying-row",
        "prior-against-data",
        "readings-at-edge",
        "small-sample",
        "too-few-agree",
        "too-nonlinear",
        "uneven-noise",
        "weights-from-readings",
    )
)
"""Diagnostics that speak of the uncertainty of a result."""

SAID = {"too-nonlinear": ("profile",), "near-bound": ("limited", "profile")}
"""Those that doubt the standard deviation alone, where the interval is one that minds what they say."""


@dataclass(frozen=True)
class Kind:
    """``text`` has no clause `for-each`; the true values of ``turning`` quantities are known but for whole turns."""

    text: str
    make: Maker
    turning: tuple[str, ...] = ()
    most: int = 1_000_000


@dataclass(frozen=True)
class Judged:
    """Of ``runs``: ``covered`` is the share of intervals that hold the truth, of each number; ``doubted`` of runs.

    ``bent`` is the share of runs whose intervals follow a profile or a limit, and are doubted by nothing else.
    """

    runs: int
    covered: Mapping[str, float]
    doubted: float
    bent: float
    silent: int
    codes: Mapping[str, int]

    @property
    def worst(self) -> tuple[str, float]:
        """The number whose intervals are farthest from 95 %."""
        return max(self.covered.items(), key=lambda item: abs(item[1] - 0.95))

    @property
    def inside(self) -> bool:
        """All intervals hold the truth as often as they should."""
        return all(INSIDE[0] <= share <= INSIDE[1] for share in self.covered.values())

    @property
    def wrong(self) -> bool:
        """The doubts do not go with the intervals."""
        return self.verdict in (FALSE, SPURIOUS)

    @property
    def verdict(self) -> str:
        """Whether the doubts go with the intervals."""
        if self.inside:
            return "true" if self.doubted <= DOUBTED_INSIDE else SPURIOUS
        doubted = self.doubted + self.bent
        return "false, and doubted" if doubted >= DOUBTED_OUTSIDE else FALSE


def judged(kind: Kind, runs: int, seed: int = 1) -> Judged:
    """One kind of problem, simulated, and solved in one table."""
    runs = min(runs, kind.most)
    tables, truth = kind.make(np.random.default_rng(seed), runs)
    end = kind.text.rindex(")")
    text = f"{kind.text[:end]} (for-each run))"
    solves = mbm.loads(text).solve(data=tables).document()["solves"]
    if len(solves) != runs:
        message = f"{len(solves)} solves of {runs} runs"
        raise ValueError(message)
    ends = {name: _ends(solves, name, runs) for name in truth}
    covered: dict[str, float] = {}
    for name, found in ends.items():
        true = np.asarray(truth[name], dtype=np.float64).reshape(_shape(truth[name], runs))
        true = np.broadcast_to(true, found.shape[:2])
        if name in kind.turning:
            middle = found.mean(axis=2)
            true = true + 2 * np.pi * np.round((middle - true) / (2 * np.pi))
        known = ~np.isnan(found).any(axis=2)
        held = (found[..., 0] <= true) & (true <= found[..., 1])
        for place in range(found.shape[1]):
            if known[:, place].any():
                label = name if found.shape[1] == 1 else f"{name}[{place + 1}]"
                covered[label] = float(held[known[:, place], place].mean())
    doubts = [_doubts(solve) for solve in solves]
    return Judged(
        runs=runs,
        covered=covered,
        doubted=sum(bool(hard) for hard, _ in doubts) / runs,
        bent=sum(bool(soft) and not hard for hard, soft in doubts) / runs,
        silent=sum(1 for found in ends.values() for each in found if np.isnan(each).any()),
        codes=Counter(code for hard, soft in doubts for code in sorted(hard | soft)),
    )


def _shape(truth: Any, runs: int) -> tuple[int, ...]:
    shape = np.shape(truth)
    return (runs, -1) if shape and shape[0] == runs else (1, -1)


def _ends(solves: list[dict[str, Any]], name: str, runs: int) -> Floats:
    """The ends (runs, numbers, 2) of the intervals of a quantity; NaN where none is stated."""
    found = [_pairs((solve["estimates"] | solve["derived"])[name].get("interval")) for solve in solves]
    count = max(len(pairs) for pairs in found)
    empty = [(np.nan, np.nan)] * count
    return np.array([pairs if len(pairs) == count else empty for pairs in found]).reshape(runs, count, 2)


def _pairs(interval: Any) -> list[tuple[float, float]]:
    if interval is None:
        return [(np.nan, np.nan)]
    if not any(isinstance(each, list) for each in interval):
        low, high = interval
        return [(-np.inf if low is None else low, np.inf if high is None else high)]
    return [pair for each in interval for pair in _pairs(each)]


def _doubts(solve: dict[str, Any]) -> tuple[set[str], set[str]]:
    """What speaks against the intervals of a solve, and what these mind already."""
    kinds = str([each.get("interval_kind") for each in (solve["estimates"] | solve["derived"]).values()])
    found = {each["code"] for each in solve["diagnostics"]} & DOUBTS
    soft = {code for code in found if any(kind in kinds for kind in SAID.get(code, ()))}
    hard = found - soft
    if solve["status"] != "converged":
        hard = hard | {solve["status"]}
    if "limited" in kinds:
        soft = soft | {"limited"}
    return hard, soft
