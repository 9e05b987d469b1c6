"""Rotations as unit quaternions (w, x, y, z), and headings, for complex numbers too."""

from __future__ import annotations

import numpy as np

from tests.oracles.numerics import wrapped


def quaternion(q, step):
    """A unit quaternion turned by a small rotation vector on its right: R·Exp(ω), to the second order of ω."""
    w, v = q[0], q[1:]
    half = np.asarray(step) / 2
    found = np.concatenate([[w - v @ half], v + w * half + np.cross(v, half)])
    return found / np.sqrt(found @ found)


def turn_between(found, wanted):
    """The small rotation vector from one to the other."""
    w, v = wanted[0], wanted[1:]
    there = found[0] * v - w * found[1:] + np.cross(v, found[1:])
    return -2 * there * np.sign(found @ wanted)


def rotate(q, points):
    w, v = q[0], q[1:]
    across = np.cross(v, points)
    return points + 2 * (w * across + np.cross(v, across))


def turned_and_moved(found, wanted):
    return np.array([wrapped(found[0] - wanted[0]), *(found[1:] - wanted[1:])])
