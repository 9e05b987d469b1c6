"""The undamped step inside a trust radius: shortened (Gauss-Newton), or on Powell's path (dogleg, 1970).

Lengths are those of the metric of Marquardt's damping, the diagonal of ``JᵀJ``.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from mbm.equations.types import Floats
from mbm.problem.types import Method
from mbm.solver import description as of
from mbm.sparse.place import Place
from mbm.sparse.system import Plan

RULES = tuple(Method(name) for name, number in of.RULES.items() if number != of.MARQUARDT)
"""The methods whose steps are such."""


def length_of(step: Floats, squares: Floats) -> float:
    """The length of a step over the padded columns, with the metric's ``squares``."""
    return sqrt(float(squares @ np.square(step)))


def limited(rule: Method, plan: Plan, here: Place, step: Floats, squares: Floats, radius: float) -> Floats:
    """The undamped ``step`` where it is no longer than ``radius``, else the one that the rule has inside it.

    With bounds it is shortened: Powell's path might leave the box.
    """
    length = length_of(step, squares)
    if length <= radius:
        return step
    if rule is not Method.DOGLEG or here.gaps is not None:
        return step * (radius / length)
    downhill = np.where(step == 0.0, 0.0, -here.gradient / squares)
    image = plan.image(here.values, downhill)
    curvature = float(image @ image)
    slope = -float(here.gradient @ downhill)
    cauchy = downhill * (slope / curvature if curvature > 0.0 else 0.0)
    short = length_of(cauchy, squares)
    if short >= radius:
        return cauchy * (radius / short)
    onward = step - cauchy
    a, b = float(squares @ np.square(onward)), float(squares @ (cauchy * onward))
    c = short * short - radius * radius
    root = sqrt(max(b * b - a * c, 0.0))
    share = -c / (b + root) if b > 0.0 else (root - b) / a if a > 0.0 else 0.0
    return cauchy + min(share, 1.0) * onward
