"""Valleys: points along which no residual changes, where equations do not determine all unknowns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.manifolds import tangent_axes
from mbm.equations.metric import rounded_turns, steps_between, turning
from mbm.equations.types import Floats, Mask, Minimum
from mbm.problem.manifold import Piece
from mbm.rotations import CONJUGATE, hamilton

STEPS = 40
"""Steps of a walk; one that has not come to its end says nothing against one valley."""

LONGEST = 0.3
"""Length of a step beside the size of what it moves, or in rad: Gauss-Newton's method brings it back to the valley."""

ARRIVED = 1e-2
"""Change of the residuals, beside their size, that is left at the end: equal costs differ by its square at most."""

DAMPED = 0.3
"""Steps are shorter by this factor from where one has gone too far."""

STUCK = 1e-2
"""Share of what is left that leads on, below which nothing does."""

ALIKE = 100.0
"""Numbers that differ by a smaller factor may be places in one plane, whose distances count alike."""

MOST_WALKS = 200
"""Walks of a search, each up to 40 steps: tens of seconds with as many unknowns as are walked, else far less."""

WALKED = 60
"""Unknowns up to which a valley is walked along: each step takes the singular values of the Jacobian."""

RANK = 1e-7
"""Singular value beside the largest one, of columns of length one, below which a direction is free."""


def flat(equations: Assembled, minimum: Minimum, tolerance: float) -> bool:
    """The equations do not determine all unknowns at the minimum; with many unknowns nobody asks."""
    if minimum.blocks is not None:
        return False
    columns = minimum.jacobian[:, minimum.at_bound == 0]
    dead = _dead(equations, columns, minimum.at_bound == 0)
    if dead.any():
        return True
    return bool(np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), tol=tolerance) < columns.shape[1])


def _dead(equations: Assembled, columns: Floats, free: Mask) -> Mask:
    """Which of the columns (m, k) of the ``free`` coordinates vanish but for rounding."""
    curved = turning(equations)
    return rounded_turns(None if curved is None else curved[free], np.linalg.norm(columns, axis=0))


class Walks:
    """The walks along the valleys of one search, `MOST_WALKS` of them at most, until it is ``stopped()``."""

    def __init__(self, equations: Assembled, stopped: Callable[[], bool]) -> None:
        self.equations = equations
        self._stopped = stopped
        self._left = MOST_WALKS

    def connect(self, minimum: Minimum, target: Floats) -> bool:
        """Whether a walk from a flat minimum along its valley may lead to ``target`` (N,), of the same residuals.

        Where nobody walks, it may.
        """
        equations = self.equations
        free = minimum.at_bound == 0
        if minimum.blocks is not None or not 0 < free.sum() <= WALKED or equations.rows is not None or not self._left:
            return True
        self._left -= 1
        return self._arrives(minimum, target, free)

    @np.errstate(all="ignore")
    def _arrives(self, minimum: Minimum, target: Floats, free: Mask) -> bool:
        """Whether a walk comes near, or does not come to an end.

        Each step goes as far towards the target as the valley does. No, where it leads no nearer, as from where it is
        farthest: there it is pushed on once. A walk that leaves where the equations are defined tells nothing: it may.
        """
        equations, point, jacobian = self.equations, minimum.point, minimum.jacobian
        size = _sizes(equations, point, target)
        near, pushed = ARRIVED * np.sqrt(max(1.0, minimum.cost)), False
        share, before = 1.0, np.inf
        for _ in range(STEPS):
            if self._stopped():
                break
            left, slopes = _towards(equations, point, target) / size, jacobian * size
            if not np.isfinite(slopes).all() or not np.linalg.norm(slopes @ left) > near:
                return True
            directions = _free_directions(equations, slopes, free)
            along = directions @ (directions.T @ left)
            away = float(np.linalg.norm(left))
            share, before = share if away < before else DAMPED * share, away
            if np.linalg.norm(along) <= STUCK * away:
                if pushed or not directions.size:
                    return False
                pushed, along, before = True, LONGEST * directions[:, 0] / share, np.inf
            step = along * min(share, LONGEST / float(np.linalg.norm(along)))
            point = equations.retract(point, step * size)
            slopes, apart = equations.jacobian(point) * size, equations.residuals(point) - minimum.residuals
            if not np.isfinite(slopes).all() or not np.isfinite(apart).all():
                return True
            back, *_ = np.linalg.lstsq(slopes, apart)
            point = equations.retract(point, -np.where(free, back, 0.0) * size)
            jacobian = equations.jacobian(point)
        return True


def _sizes(equations: Assembled, point: Floats, target: Floats) -> Floats:
    """How large the coordinates (n,) are, alike where they differ little: 1 rad for those of rotations."""
    layout = equations.layout
    plain = layout.number[equations.free] >= 0
    steps = np.abs(_towards(equations, point, target))
    ends = [np.abs(equations.coordinates(each)) for each in (point, target)]
    own = np.maximum(np.maximum(*ends), steps)[plain]
    near = (own[:, None] <= ALIKE * own) & (own <= ALIKE * own[:, None])
    size = np.ones(len(steps))
    size[plain] = np.where(own > 0.0, np.where(near, own, 0.0).max(axis=1, initial=0.0), 1.0)
    return size


def _towards(equations: Assembled, point: Floats, target: Floats) -> Floats:
    """The step (n,) from a point towards another one; rotations are turned by the shorter way."""
    layout = equations.layout
    found = np.zeros(len(layout.number))
    plain = layout.number >= 0
    found[plain] = steps_between(layout, np.flatnonzero(plain), point, target)
    for curved in layout.curved:
        here, there = point[curved.numbers], target[curved.numbers]
        if curved.piece is Piece.SCALE:
            step = np.log(there / here)
        elif curved.piece is Piece.QUATERNION:
            turn = hamilton(here * CONJUGATE, there)
            sine = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
            angle = 2.0 * np.arctan2(sine, np.abs(turn[:, :1])) * np.where(turn[:, :1] < 0.0, -1.0, 1.0)
            step = turn[:, 1:] * np.where(sine > 0.0, angle / sine, 0.0)
        else:
            step = np.stack([(axis * there).sum(axis=1) for axis in tangent_axes(here)], axis=1)
        found[curved.coordinates] = step
    return found[equations.free]


def _free_directions(equations: Assembled, jacobian: Floats, free: Mask) -> Floats:
    """An orthonormal basis (n, k) of the steps that change no residual."""
    columns = jacobian[:, free]
    dead = _dead(equations, columns, free)
    scale = np.where(dead, np.inf, np.linalg.norm(columns, axis=0))
    _, values, rows = np.linalg.svd(columns / scale)
    whole = np.zeros(columns.shape[1])
    whole[: len(values)] = values
    directions = np.zeros((len(free), int((whole <= RANK * whole.max(initial=0.0)).sum())))
    directions[free] = (rows[whole <= RANK * whole.max(initial=0.0)] / np.where(dead, 1.0, scale)).T
    return np.asarray(np.linalg.qr(directions)[0])
