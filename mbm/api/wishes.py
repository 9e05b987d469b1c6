"""What ``Problem.design`` may be asked to choose."""

from __future__ import annotations

from typing import TypedDict


class Wishes(TypedDict, total=False):
    """Keywords of ``Problem.design``.

    ``criterion`` is ``"c"`` (least variance of one number: the default for one), ``"A"`` (least sum of variances) or
    ``"D"`` (least determinant of the covariance). ``choose`` is how many candidates to choose, ``budget`` what they may
    cost, ``repeats`` whether one may be chosen again. ``sigma`` is a wanted standard deviation, a number in the unit of
    the quantity or a text such as ``"1mm"``. ``observation`` names the clause whose rows the candidates are, ``seed``
    what the search for sets draws from, ``solve`` which of many solves is planned, from 1.
    """

    criterion: str
    choose: int
    budget: float
    repeats: bool
    sigma: float | str
    observation: str
    seed: int
    solve: int
