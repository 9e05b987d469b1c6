"""Quantities derived once in each of many solves, with their uncertainty."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.manifolds import numbers_of_stated, tangent_slopes
from mbm.equations.types import Floats
from mbm.estimation.batches.portion import stated, stated_slopes
from mbm.estimation.batches.stack import Stack
from mbm.estimation.uncertainty.derived import cannot_vary, reported
from mbm.problem.types import Derived
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedColumns:
    """One derived quantity of K solves: ``values`` (K, numbers), ``sigma`` (K, size), ``gradient`` (K, size, n).

    ``image`` (K, size, n) is the gradient times a factor of the covariance.
    """

    owner: int
    group: Group
    values: Floats
    sigma: Floats
    gradient: Floats
    image: Floats


@np.errstate(all="ignore")
def derived_columns(quantity: Derived, owner: int, stack: Stack, points: Floats, factor: Floats) -> DerivedColumns:
    """A derived quantity at points (K, N), with the covariance ``factor @ factorᵀ`` (K, n, n) of the estimates."""
    group = stack.derived[owner][0]
    values = stated(group, points)
    gradient = stated_slopes(group, points, stack.equations)
    if quantity.kind is not None:
        gradient = tangent_slopes(quantity.kind, quantity.dimension, values, gradient)
        values = numbers_of_stated(quantity.kind, quantity.dimension, values)
    image = np.matmul(gradient, factor)
    sigma = np.sqrt(np.square(image).sum(axis=2))
    if quantity.kind is None:
        held = cannot_vary(values, sigma)
        gradient[held], image[held], sigma[held] = 0.0, 0.0, 0.0
        values = reported(quantity, values)
    return DerivedColumns(owner=owner, group=group, values=values, sigma=sigma, gradient=gradient, image=image)
