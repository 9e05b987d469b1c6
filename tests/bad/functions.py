"""Functions that problems of this folder call."""

from __future__ import annotations


def half(x):
    return x / 2


def slope_of_double(x):
    return 2.0


def nothing(x):
    return None
