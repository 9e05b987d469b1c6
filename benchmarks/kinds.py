"""Kinds of problems of many solves: a place from 24 ranges in each epoch, estimated in every way there is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.scenes import Columns

HEAD = """
(problem epochs
  (data receivers external :key receiver)
  (data ranges external :with (receivers receiver))
  {data}
  (unknowns (p (vector 3) {start}) {more})
  (observe ranges (= {range} (distance p [receivers.x receivers.y receivers.z])) {noise})
  {rest}
  {each})
"""
HEIGHTS = "(data heights external)"
HEIGHT = "(observe heights (= h (p 3)) {noise})"
LMEDS = "(solve :robust lmeds)"


def text(
    start: str = ":init [1.75m 1.75m 1m]",
    more: str = "",
    measured: str = "range",
    noise: str = ":sigma 10mm",
    rest: str = "",
    each: str = "(for-each epoch)",
    data: str = "",
) -> str:
    """The problem with one of its parts otherwise."""
    return HEAD.format(start=start, more=more, range=measured, noise=noise, rest=rest, each=each, data=data)


def tables(count: int, wrong: float = 0.0) -> dict[str, Columns]:
    """Ranges (10 mm of noise) from a place that moves a millimetre an epoch, some wrong; heights (20 mm)."""
    generator = np.random.default_rng(2)
    at = np.column_stack([generator.uniform(0, 4, 24), generator.uniform(0, 4, 24), generator.uniform(0, 2.7, 24)])
    epoch, receiver = np.arange(count), np.arange(24)
    turn = epoch / 1000
    places = np.column_stack([1.75 + np.cos(turn), 1.75 + np.sin(turn), 1 + 0.3 * np.sin(turn)])
    ranges = np.linalg.norm(places[:, None] - at[None], axis=2) + 0.01 * generator.standard_normal((count, 24))
    ranges += (generator.random((count, 24)) < wrong) * generator.uniform(0.3, 1.0, (count, 24))
    heights = np.repeat(places[:, 2], 6) + 0.02 * generator.standard_normal(count * 6)
    return {
        "receivers": {"receiver": receiver, "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]},
        "ranges": {"epoch": np.repeat(epoch, 24), "receiver": np.tile(receiver, count), "range": ranges.ravel()},
        "heights": {"epoch": np.repeat(epoch, 6), "h": heights},
    }


def clean(count: int) -> dict[str, Columns]:
    return tables(count)


def spoilt(count: int) -> dict[str, Columns]:
    return tables(count, 0.1)


def points(count: int) -> dict[str, Columns]:
    """24 points (10 mm of noise) of a rim of 1 m that moves a millimetre an epoch."""
    generator = np.random.default_rng(3)
    epoch, angle = np.repeat(np.arange(count), 24), np.tile(np.linspace(0.0, 6.0, 24), count)
    x = 1.75 + np.cos(epoch / 1000) + np.cos(angle) + 0.01 * generator.standard_normal(len(epoch))
    y = 1.75 + np.sin(epoch / 1000) + np.sin(angle) + 0.01 * generator.standard_normal(len(epoch))
    return {"points": {"epoch": epoch, "x": x, "y": y}}


@dataclass(frozen=True)
class Kind:
    """A problem, and what makes its tables for a number of epochs."""

    text: str
    made: Callable[[int], dict[str, Columns]] = clean

    def data(self, count: int) -> dict[str, Columns]:
        """The tables that the problem names."""
        return {name: columns for name, columns in self.made(count).items() if f"(data {name} " in self.text}


STATED = HEIGHT.format(noise=":sigma 2cm")
BIASED = "(b :init 0m :sigma 1mm)"
KINDS = {
    "one table": Kind(text()),
    "two tables": Kind(text(data=HEIGHTS, rest=STATED)),
    "a prior": Kind(text(more=BIASED, measured="(- range b)")),
    "bounds": Kind(text(start=":init [1.75m 1.75m 1m] :in (0m 4m)")),
    "unknown noise": Kind(text(noise="")),
    "two unknown noises": Kind(text(noise="", data=HEIGHTS, rest=HEIGHT.format(noise=""))),
    "no start": Kind(text(start=":unit m")),
    "windows of one epoch": Kind(text(each="(window epoch :length 1 :step 1)")),
    "windows of five epochs": Kind(text(each="(window epoch :length 5 :step 1)")),
    "windows, no start": Kind(text(start=":unit m", each="(window epoch :length 5 :step 1)")),
    "windows, LMedS": Kind(text(rest=LMEDS, each="(window epoch :length 1 :step 1)"), spoilt),
    "Huber's loss": Kind(text(noise=":sigma 10mm :loss huber"), spoilt),
    "Huber's loss, unknown noise": Kind(text(noise=":loss huber"), spoilt),
    "Huber's loss, unknown noise, two tables": Kind(text(noise=":loss huber", data=HEIGHTS, rest=STATED), spoilt),
    "Huber's loss, unknown noises": Kind(
        text(noise=":loss huber", data=HEIGHTS, rest=HEIGHT.format(noise="")),
        spoilt,
    ),
    "Huber's loss, two tables": Kind(text(noise=":sigma 10mm :loss huber", data=HEIGHTS, rest=STATED), spoilt),
    "Cauchy's loss": Kind(text(noise=":sigma 10mm :loss cauchy"), spoilt),
    "LMedS": Kind(text(rest=LMEDS), spoilt),
    "LMedS, unknown noise": Kind(text(noise="", rest=LMEDS), spoilt),
    "LMedS, unknown noises": Kind(text(noise="", data=HEIGHTS, rest=HEIGHT.format(noise="") + LMEDS), spoilt),
    "LMedS, two tables": Kind(text(data=HEIGHTS, rest=STATED + LMEDS), spoilt),
    "LMedS, a prior": Kind(text(more=BIASED, measured="(- range b)", rest=LMEDS), spoilt),
    "an inequality": Kind(text(rest="(constraints (<= (p 3) 2.5m))")),
    "an equality": Kind(text(more="(q :init 1m)", rest="(constraints (= q (p 1)))")),
    "an inequality at its limit": Kind(text(rest="(constraints (<= (distance [(p 1) (p 2)] [1.75m 1.75m]) 1m))")),
    "errors in columns": Kind(
        """(problem rims (data points external) (unknowns (p (vector 2) :init [1.75m 1.75m]) (r positive :init 0.5m))
  (observe points (= (distance [x y] p) r) :errors ((x 10mm) (y 10mm))) (for-each epoch))""",
        points,
    ),
    "a family": Kind(
        text(more="(b :per receivers :init 0m :sigma 1cm)", measured="(- range (b receiver))"),
    ),
}
