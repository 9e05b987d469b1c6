"""What closed forms know of the rows at hand, straight from their data, which was learnt when the problem was compiled.

It is an affine map of the parameters of a row: ``maps`` has for each type of unit ``(parameters + 1) · width`` numbers
from its offset in ``map_places`` on, the constant ones last; -1: nothing is known.
"""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals


def know_rows(
    width: Integer,
    count: Integer,
    rows: Integer,
    given: ConstantReals,
    maps: ConstantReals,
    constants: ConstantReals,
    step: Integer,
    target: Reals,
) -> None:
    """What is known of a unit (width,) in each row, from the parameters ``given`` (rows, count).

    ``maps`` (count, width) is that of the unit, ``constants`` (width,) are added; ``step`` is the distance from row to
    row in ``target``. Most coefficients are 0, so that rows are looped over last.
    """
    for w in range(width):
        for row in range(rows):
            target[row * step + w] = constants[w]
        for p in range(count):
            factor = maps[p * width + w]
            if factor != 0.0:
                for row in range(rows):
                    target[row * step + w] += factor * given[row * count + p]
