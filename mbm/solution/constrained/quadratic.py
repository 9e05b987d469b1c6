"""One linearised problem: least squares with linear equations, inequalities and bounds (Lawson and Hanson 1974, LSEI).

Equations go first, into the null space that a rank-revealing decomposition finds, so that redundant ones do no harm;
what is left is turned into the nearest point of a polyhedron.
"""

from __future__ import annotations

import numpy as np

from mbm.solution.constrained.polyhedron import nearest
from mbm.solution.triangle import triangle
from mbm.solution.types import Floats, Mask
from mbm.values import dataclass

REDUNDANT = 1e-10
"""Singular values of the equations (rows of unit length) below this share of the largest are zero."""

FLOOR = 1e-9
"""Directions that the residuals feel less than this are damped so much that they stay where they are."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subproblem:
    """``min ‖J p + r‖² + damping² ‖scale p‖²`` with ``A p + c = 0`` or ``<= 0``, and ``down <= p <= up``.

    ``jacobian`` (m, n), ``residuals`` (m,), ``slopes`` (k, n), ``values`` (k,), ``equality`` (k,), the others (n,).
    """

    jacobian: Floats
    residuals: Floats
    slopes: Floats
    values: Floats
    equality: Mask
    down: Floats
    up: Floats
    scale: Floats
    damping: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """The step (n,), the multipliers (k,) for ``‖·‖²/2 + Σ λ c`` (of either sign for equations), those of the lower and
    upper bounds (n,) as one number: negative where the lower holds, positive where the upper does. ``feasible`` is
    False where the linearised inequalities have no common point: the step then only serves the equations.
    """

    step: Floats
    multipliers: Floats
    bounds: Floats
    feasible: bool


def solve(problem: Subproblem) -> Solved:
    """The step that the linearised problem wants."""
    scale = problem.scale
    slopes = problem.slopes / scale
    lengths = np.sqrt(np.square(slopes).sum(axis=1))
    rows = slopes / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    values = problem.values / np.where(lengths > 0.0, lengths, 1.0)
    equality = problem.equality
    fixed, basis = _on_equations(rows[equality & (lengths > 0.0)], values[equality & (lengths > 0.0)], scale.size)
    weights, turned, minimum = _reduced(problem, fixed, basis)
    normals, limits, sources = _inequalities(problem, rows, values, lengths, fixed)
    inner = normals @ basis
    kept = np.sqrt(np.square(inner).sum(axis=1)) > REDUNDANT
    inner, limits, sources = inner[kept], limits[kept], sources[kept]
    image = (inner @ turned) / weights
    sizes = np.sqrt(np.square(image).sum(axis=1))
    found = nearest(image / sizes[:, None], (limits - inner @ minimum) / sizes)
    movement = fixed + basis @ (minimum + turned @ (found.point / weights))
    forces = found.multipliers / sizes
    multipliers, bounds = np.zeros(len(values)), np.zeros(scale.size)
    count = len(values)
    for source, force in zip(sources.tolist(), forces.tolist(), strict=True):
        if source < count:
            multipliers[source] = force / lengths[source]
        elif source < count + scale.size:
            bounds[source - count] -= force * scale[source - count]
        else:
            bounds[source - count - scale.size] += force * scale[source - count - scale.size]
    step = movement / scale
    if bool(equality.any()):
        multipliers[equality] = _of_equations(problem, step, multipliers, bounds)
    return Solved(step=step, multipliers=multipliers, bounds=bounds, feasible=found.feasible)


def _on_equations(rows: Floats, values: Floats, size: int) -> tuple[Floats, Floats]:
    """The shortest scaled step that meets the equations (as nearly as they allow), and their null space (n, q)."""
    if not rows.size:
        return np.zeros(size), np.eye(size)
    left, singular, right = np.linalg.svd(rows, full_matrices=True)
    rank = int((singular > REDUNDANT * singular[0]).sum())
    step = -right[:rank].T @ ((left[:, :rank].T @ values) / singular[:rank])
    return step, right[rank:].T


def _reduced(problem: Subproblem, fixed: Floats, basis: Floats) -> tuple[Floats, Floats, Floats]:
    """Singular values (q,) and directions (q, q) of the damped residuals on the null space, and their minimum there."""
    width = basis.shape[1]
    if width == 0:
        return np.zeros(0), np.zeros((0, 0)), np.zeros(0)
    scaled = problem.jacobian / problem.scale
    matrix = scaled @ basis
    rest = problem.residuals + scaled @ fixed
    if len(matrix) > 2 * (width + 1):
        reduced = triangle(np.column_stack([matrix, rest]))
        matrix, rest = reduced[:, :width], reduced[:, width]
    damping = max(problem.damping, FLOOR * float(np.linalg.norm(matrix)), np.finfo(float).tiny)
    left, singular, right = np.linalg.svd(np.vstack([matrix, damping * np.eye(width)]), full_matrices=False)
    target = np.concatenate([rest, np.zeros(width)])
    minimum = -right.T @ ((left.T @ target) / singular)
    return singular, right.T, minimum


def _inequalities(
    problem: Subproblem, rows: Floats, values: Floats, lengths: Floats, fixed: Floats
) -> tuple[Floats, Floats, np.ndarray]:
    """Rows and limits of inequalities and bounds, in scaled coordinates from ``fixed`` on; and where they are from."""
    scale = problem.scale
    chosen = np.flatnonzero(~problem.equality & (lengths > 0.0))
    low, high = np.flatnonzero(np.isfinite(problem.down)), np.flatnonzero(np.isfinite(problem.up))
    unit = np.eye(scale.size)
    normals = np.vstack([rows[chosen], -unit[low], unit[high]])
    limits = np.concatenate([-values[chosen], -(problem.down * scale)[low], (problem.up * scale)[high]])
    sources = np.concatenate([chosen, len(values) + low, len(values) + scale.size + high])
    return normals, limits - normals @ fixed, sources


def _of_equations(problem: Subproblem, step: Floats, multipliers: Floats, bounds: Floats) -> Floats:
    """Multipliers of the equations: the shortest that make the gradient vanish; redundant ones share theirs."""
    inequality = ~problem.equality
    damped = problem.damping**2 * problem.scale**2 * step
    force: Floats = problem.jacobian.T @ (problem.residuals + problem.jacobian @ step) + damped
    force = force + problem.slopes[inequality].T @ multipliers[inequality] + bounds
    rows = problem.slopes[problem.equality] / problem.scale
    return np.asarray(np.linalg.lstsq(rows.T, -force / problem.scale, rcond=REDUNDANT)[0], dtype=np.float64)
