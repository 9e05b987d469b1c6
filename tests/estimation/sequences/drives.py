"""Drives of a robot with odometry and range radios, drawn by NumPy alone."""

from __future__ import annotations

import numpy as np

SIGMA_ODOMETRY = (0.01, 0.02, 0.02)
"""Of forward, sideways and turn, each step of about a metre."""

SIGMA_RANGE = 0.4


def drive(seed, steps=120, nodes=4, straight=False):
    """True poses (n, 3) as x, y, heading from the origin, places of the nodes, their gains and offsets, and tables."""
    g = np.random.default_rng(seed)
    true = np.zeros((steps, 3))
    for i in range(1, steps):
        turn = 0.01 * g.normal() if straight else 0.15 * np.sin(i / 15) + 0.1 * g.normal()
        middle, length = true[i - 1, 2] + turn / 2, 1.0 + 0.1 * g.normal()
        true[i] = true[i - 1] + [length * np.cos(middle), length * np.sin(middle), turn]
    low, high = true[:, :2].min(axis=0) - 10, true[:, :2].max(axis=0) + 10
    places = g.uniform(low, high, (nodes, 2))
    gains, offsets = 1 + 0.05 * g.normal(size=nodes), 0.5 * g.normal(size=nodes)
    moved, (c, s) = np.diff(true, axis=0), (np.cos(true[:-1, 2]), np.sin(true[:-1, 2]))
    forward, sideways, turn = np.array(SIGMA_ODOMETRY)[:, None] * g.normal(size=(3, steps - 1))
    k, node = np.arange(steps), g.integers(nodes, size=steps)
    heard = gains[node] * np.linalg.norm(true[k, :2] - places[node], axis=1) + offsets[node]
    tables = {
        "poses": {"k": k},
        "steps": {
            "from": k[:-1],
            "to": k[1:],
            "dx": c * moved[:, 0] + s * moved[:, 1] + forward,
            "dy": c * moved[:, 1] - s * moved[:, 0] + sideways,
            "da": moved[:, 2] + turn,
        },
        "nodes": {"node": np.arange(nodes), "x": places[:, 0], "y": places[:, 1]},
        "ranges": {"k": k, "node": node, "range": heard + SIGMA_RANGE * g.normal(size=steps)},
    }
    return true, places, gains, offsets, tables


def twelve(tables):
    """The tables twelve times, told apart by the column ``run``, with keys of places that are each run's own."""
    many = {}
    for name, table in tables.items():
        run = np.repeat(np.arange(12), len(next(iter(table.values()))))
        many[name] = {c: np.tile(values, 12) + 1000 * run * (c in ("k", "from", "to")) for c, values in table.items()}
        many[name]["run"] = run
    return many
