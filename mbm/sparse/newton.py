"""Newton's steps of sparse problems: conjugate gradients with Gauss-Newton's step as the preconditioner.

Products of the Hessian are differences of the gradient, so that it is never formed. With large residuals, and with
losses, whose bend ``JᵀJ`` sees in part only, Gauss-Newton converges linearly; these steps do better.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.types import Equations, Floats, Indices
from mbm.sparse.place import BlockEquations, Place
from mbm.sparse.system import Factorised, Plan

PRODUCTS = 50
"""Products with the Hessian in one step at most."""

FORCING = 1e-6
"""Share of the decrease that is left to the next step."""

NUDGE = 1e-4
"""Standard deviations over which gradients are compared: far above their rounding, far below what bends them."""


def newton_step(equations: BlockEquations, found: Plan, here: Place, factors: Factorised) -> tuple[Floats, float]:
    """Newton's step from a place over the padded columns, and the decrease of the cost that it promises.

    ``factors`` are those of ``JᵀJ`` there. Where the Hessian is indefinite along Gauss-Newton's step, that one.
    """
    still = found.structure.dead | here.held

    def pull(point: Floats) -> Floats:
        return found.gradient(equations.block_jacobian(point, found.arithmetic), equations.residuals(point))

    def along(force: Floats) -> Floats:
        return factors.solve(np.where(still, 0.0, force)[:, None])[:, 0]

    lengths = np.where(still, 0.0, np.sqrt(here.squares))
    bent = products(equations, here.point, pull, (here.gradient, lengths), found.structure.free)
    step, _ = conjugate(along, here.gradient, bent)
    return step, -float(here.gradient @ step)


def products(
    equations: Equations,
    point: Floats,
    pull: Callable[[Floats], Floats],
    here: tuple[Floats, Floats],
    free: Indices,
) -> Callable[[Floats], Floats]:
    """The Hessian times a direction (columns,), by differences of the gradient that ``pull`` gives at a point.

    ``here`` is the gradient at ``point``, and the lengths of the Jacobian's columns; ``free`` (n,) the estimated ones.
    """
    gradient, lengths = here

    def bent(direction: Floats) -> Floats:
        size = NUDGE / float((np.abs(direction) * lengths).max())
        return (pull(equations.retract(point, size * direction[free])) - gradient) / size

    return bent


def conjugate(
    along: Callable[[Floats], Floats], gradient: Floats, bent: Callable[[Floats], Floats]
) -> tuple[Floats, float]:
    """The step that conjugate gradients lead to, and the decrease that Gauss-Newton's would promise (Steihaug 1983).

    ``along`` is what Gauss-Newton makes of a gradient (columns,), ``bent`` the Hessian times a direction.
    """
    force = -gradient
    downhill = along(force)
    promise = left = float(force @ downhill)
    step, direction = np.zeros(len(force)), downhill
    for _ in range(PRODUCTS):
        if not left > FORCING * promise:
            break
        image = bent(direction)
        curvature = float(direction @ image)
        if not curvature > 0.0:
            return (step, promise) if step.any() else (downhill, promise)
        share = left / curvature
        step, force = step + share * direction, force - share * image
        downhill = along(force)
        left, before = float(force @ downhill), left
        direction = downhill + left / before * direction
    return step, max(promise, 0.0)
