"""Functions that tests of kernels call."""

from __future__ import annotations

import math

import numpy as np


def wave(a, v):
    return [math.sin(a * v[0]), math.exp(v[1] - a)]


def square(x):
    return x * x


def slope_of_square(x):
    return 2 * x


def waves(a, v):
    return np.stack([np.sin(a * v[:, 0]), np.exp(v[:, 1] - a)], axis=1)


def slopes_of_waves(a, v):
    c, e, zero = np.cos(a * v[:, 0]), np.exp(v[:, 1] - a), np.zeros_like(a)
    return np.stack([np.stack([v[:, 0] * c, a * c, zero], axis=1), np.stack([-e, zero, e], axis=1)], axis=1)


def root(x):
    return math.sqrt(x) if x >= 0 else math.nan
