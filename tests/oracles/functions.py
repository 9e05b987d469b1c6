"""The formulas of random problems as functions that a problem calls: one row at a time, or all rows, with Jacobians."""

from __future__ import annotations

import math

import numpy as np


def decay(a, k, c, x):
    return c + a * math.exp(-k * x)


def growth(a, b, x):
    return math.exp(a * x + b)


def squares(a, b):
    return a * a + b * b


def product(a, b):
    return a * b


def distance(p, q):
    return math.dist(p, q)


def line(a, b, x):
    return a + b * x


def bent(a, b, x):
    return a + b * math.exp(0.3 * x)


def free(a, b, c, x):
    return a + b + c * x


def power(a, b, x):
    return a * math.exp(b * x)


def turned(turn, point):
    return turn @ point


def decays(a, k, c, x):
    return c + a * np.exp(-k * x)


def slopes_of_decays(a, k, c, x):
    e = np.exp(-k * x)
    return np.stack([e, -a * x * e, np.ones_like(e), -a * k * e], axis=1)


def growths(a, b, x):
    return np.exp(a * x + b)


def slopes_of_growths(a, b, x):
    e = np.exp(a * x + b)
    return np.stack([x * e, e, a * e], axis=1)


def distances(p, q):
    return np.linalg.norm(p - q, axis=1)


def slopes_of_distances(p, q):
    unit = (p - q) / np.linalg.norm(p - q, axis=1, keepdims=True)
    return np.hstack([unit, -unit])


def powers(a, b, x):
    return a * np.exp(b * x)


def slopes_of_powers(a, b, x):
    e = np.exp(b * x)
    return np.stack([e, a * x * e, a * b * e], axis=1)


def turns(turn, points):
    return np.einsum("rij,rj->ri", turn, points)


def slopes_of_turns(turn, points):
    """By the nine numbers of the matrix, row by row, then by the point."""
    by_turn = np.einsum("ik,rl->rikl", np.eye(3), points).reshape(-1, 3, 9)
    return np.concatenate([by_turn, turn], axis=2)
