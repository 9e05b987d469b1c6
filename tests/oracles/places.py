"""Places from distances and directions to stations: data that are drawn, and residuals of points."""

from __future__ import annotations

import numpy as np

from tests.oracles.kinds import one
from tests.oracles.numerics import arctan2, wrapped


def ranges(generator, noise=0.05, wrong=0, rows=11):
    """Distances to a random place from stations around it; the first ``wrong`` have gross errors."""
    turn = generator.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(rows) / rows
    x, y = (generator.uniform(6, 12, rows) * f(turn) for f in (np.cos, np.sin))
    place = generator.uniform(-2, 2, 2)
    r = np.hypot(x - place[0], y - place[1]) + noise * generator.normal(size=rows)
    r[:wrong] += generator.uniform(6, 15, wrong) * noise * generator.choice([-1, 1], wrong)
    return one(x=x, y=y, r=r)


def beside_a_line(generator, noise=0.05):
    """Distances to a place on one side of stations that nearly stand in a line."""
    x, y = np.linspace(0, 10, 6), generator.uniform(-0.4, 0.4, 6)
    place = generator.uniform([2, 1.5], [8, 4])
    return one(x=x, y=y, r=np.hypot(x - place[0], y - place[1]) + noise * generator.normal(size=6))


def distances(x, tables):
    d = tables["d"]
    return (np.sqrt((x[0] - d["x"]) ** 2 + (x[1] - d["y"]) ** 2) - d["r"]) / 0.05


def bearings(generator):
    """Directions to stations around a place, from a heading of about half a turn."""
    d = ranges(generator)["d"]
    place, heading = generator.uniform(-1, 1, 2), np.pi + generator.uniform(-0.3, 0.3)
    t = np.arctan2(d["y"] - place[1], d["x"] - place[0]) - heading + 0.01 * generator.normal(size=11)
    return one(x=d["x"], y=d["y"], t=wrapped(t))


def seen_from(p, tables):
    d = tables["d"]
    return wrapped(arctan2(d["y"] - p[2], d["x"] - p[1]) - p[0] - d["t"]) / 0.01


def some_wrong(generator, rows=11, wrong=3):
    """As `ranges`: gross errors in the first rows, in the others at most one and a half standard deviations."""
    d = dict(ranges(generator, noise=0.0, rows=rows)["d"])
    d["r"] = d["r"] + 0.05 * generator.uniform(-1.5, 1.5, rows)
    d["r"][:wrong] += 0.05 * generator.uniform(12, 30, wrong) * generator.choice([-1, 1], wrong)
    return one(**d)


def right_ones(x, tables):
    return distances(x, tables)[3:]
