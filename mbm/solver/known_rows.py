"""What closed forms know of the rows at hand, straight from their data, which was learnt when the problem was compiled.

It is an affine map of the parameters of a row: ``maps`` has for each type of unit ``(parameters + 1) · width`` numbers
from its offset in ``map_places`` on, the constant ones last; -1: nothing is known, which NaN says.
"""

from __future__ import annotations

from math import inf

from mbm.machine.words import ConstantReals, Integer, Reals


def known_unit(
    width: Integer, count: Integer, given: ConstantReals, at: Integer, maps: ConstantReals, target: Reals
) -> None:
    """What is known of a unit (width,) of a row with the parameters ``given`` (count,)."""
    for w in range(width):
        total = inf - inf
        if at >= 0:
            total = maps[at + count * width + w]
            for p in range(count):
                total += given[p] * maps[at + p * width + w]
        target[w] = total
