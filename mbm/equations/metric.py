"""The sizes of coordinates and columns, the scale made of them, and rows without a value.

`Forwarding` is the base of equations made of other equations: what stays as those have it.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Equations, Floats, Indices, Mask, Minimum
from mbm.solver.decisions import HUGE, ROUNDED_ROTATION, TINY, decided_rank, rounding_of_norm


class Forwarding:
    """A base of equations over the same points and steps as ``equations``, the field that subclasses bring.

    Bounds are not among what is forwarded: a dataclass would take an inherited property for the default of its field.
    """

    __slots__ = ()

    if TYPE_CHECKING:
        equations: Equations

    @property
    def dimension(self) -> int:
        """Free coordinates, n."""
        return self.equations.dimension

    @property
    def count(self) -> int:
        """Residuals, m."""
        return self.equations.count

    @property
    def positive(self) -> Mask:
        """Coordinates that stay above zero (n,)."""
        return self.equations.positive

    @property
    def turning(self) -> Mask | None:
        """Coordinates of rotations, directions and scales (n,); None where there are none."""
        return turning(self.equations)

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals (m,)."""
        return self.equations.residuals(x)

    def jacobian(self, x: Floats) -> Floats:
        """Their derivative by a step (m, n)."""
        return self.equations.jacobian(x)

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The point after a step (n,)."""
        return self.equations.retract(x, step)

    def coordinates(self, x: Floats) -> Floats:
        """The numbers that steps add to (n,)."""
        return self.equations.coordinates(x)

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        """The point with other coordinates."""
        return self.equations.placed(x, coordinates)


def metric(jacobian: Floats, slopes: Floats) -> Floats:
    """The scale of each coordinate (n,) > 0: the norm of its column; where that is zero, from the constraints."""
    return scale_of(column_norms(jacobian), slopes)


def scale_of(norms: Floats, slopes: Floats) -> Floats:
    """The same for columns with the ``norms`` (…, n) and constraints with the ``slopes`` (…, c, n)."""
    felt = norms > 0.0
    scale = norms
    if slopes.shape[-2] and not bool(felt.all()):
        sizes = np.abs(slopes)
        shares = np.where(felt[..., None, :], slopes / np.where(felt, norms, 1.0)[..., None, :], 0.0)
        known = np.sqrt(np.square(shares).sum(axis=-1))
        known = np.where(known > 0.0, known, sizes.max(axis=-1, initial=0.0))
        scale = np.where(felt, norms, (sizes / np.where(known > 0.0, known, 1.0)[..., None]).max(axis=-2))
    return np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)


def magnitudes(equations: Equations, coordinates: Floats) -> Floats:
    """The size (n,) of what rounds: ``|coordinates|``, 1 for rotations and directions, whose numbers are about 1."""
    size = np.abs(coordinates)
    curved = turning(equations)
    return size if curved is None else np.where(curved, 1.0, size)


def magnitudes_at(points: Floats, places: Indices) -> Floats:
    """The same (K, n) at many ``points`` (K, N); ``places`` (n,) are those of the coordinates among the numbers, -1 for
    rotations and directions.
    """
    return np.where(places >= 0, np.abs(points[:, places]), 1.0)


def terms_of_rows(equations: Equations, minimum: Minimum) -> Floats:
    """The squares (m,) of what the residuals at a minimum are made of, whose rounding theirs is: ``Σ (J_ij x_j)²``."""
    jacobian: Any = minimum.jacobian
    terms = np.square(magnitudes(equations, equations.coordinates(minimum.point)))
    return np.asarray((jacobian * jacobian) @ terms, dtype=np.float64)


def rounding_at(equations: Equations, minimum: Minimum) -> float:
    """The rounding error of ``‖r‖`` at a minimum."""
    terms = minimum_norms(minimum) * magnitudes(equations, equations.coordinates(minimum.point))
    return rounding_of_norm(float(terms @ terms), minimum.cost)


def roundings(norms: Floats, points: Floats, places: Indices, cost: Floats) -> Floats:
    """The same (K,) of many ends: ``norms`` (K, n) of the columns, ``points`` (K, N), ``cost`` (K,).

    ``places`` as for `magnitudes_at`.
    """
    terms = np.square(norms * magnitudes_at(points, places)).sum(axis=1)
    return of_arrays(rounding_of_norm)(terms, cost)


def steps_between(layout: Layout, free: Indices, points: Floats, others: Floats) -> Floats:
    """The steps (…, n) of free coordinates from points (…, N) to others, where all numbers vary by addition."""
    numbers = layout.number[free]
    steps = others[..., numbers] - points[..., numbers]
    turned = np.remainder(steps + np.pi, 2 * np.pi) - np.pi
    return np.where(layout.angle[free], turned, steps)


def minimum_norms(minimum: Minimum) -> Floats:
    """Norms of the columns of the Jacobian (n,), dense or sparse."""
    if minimum.blocks is not None:
        squares: Any = minimum.jacobian
        return np.sqrt(np.asarray((squares * squares).sum(axis=0), dtype=np.float64).ravel())
    return column_norms(minimum.jacobian)


def turning(equations: Equations) -> Mask | None:
    """Which coordinates (n,) are those of rotations, directions and scales; None where there is none.

    Only equations that have any need an attribute ``turning``; an instance check of a protocol would cost as much as
    the rest of a small step.
    """
    found: Mask | None = getattr(equations, "turning", None)
    return found


def rounded_turns(turned: Mask | None, length: Floats) -> Mask:
    """Which columns of a ``length`` (…, n) are zero, or of the coordinates that are ``turned`` (n,) and only rounding.

    What turns a rotation about a line on which all points are moves none, and 1e-16 is left of it.
    """
    least = np.zeros(length.shape)
    if turned is not None:
        least[..., turned] = ROUNDED_ROTATION * length[..., turned].max(axis=-1, initial=0.0, keepdims=True)
    return np.asarray(~(length > least))


def column_norms(jacobian: Floats) -> Floats:
    """Euclidean norm of each column (n,) without overflow or underflow on the way."""
    norms: Floats = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    if norms.size and not (norms.min() > TINY and norms.max() < inf):
        largest = np.abs(jacobian).max(axis=0, initial=0.0)
        divisor = np.where(largest > 0.0, largest, 1.0)
        norms = np.minimum(divisor * np.sqrt(np.square(jacobian / divisor).sum(axis=0)), HUGE)
        norms[largest == 0.0] = 0.0
    return norms


def cost_at(equations: Equations, point: Floats) -> float:
    """The sum of squares at a point; infinite where it has no finite value."""
    with np.errstate(all="ignore"):
        residuals = equations.residuals(point)
        cost = float(residuals @ residuals)
    return cost if np.isfinite(cost) else inf


def first_bad(values: Floats) -> int | None:
    """Row (from 0) of the first value that is not finite; None: all are."""
    good = np.isfinite(values)
    if good.all():
        return None
    return int(np.argmin(good if good.ndim == 1 else good.all(axis=1)))


def taken_away(slopes: Floats, equality: Mask, *, whole: bool = True) -> tuple[Floats, int, int]:
    """Directions (q, n), as many of the first as constraints take away, and as many of these as equations do.

    ``slopes`` (k, n) are of constraints that hold, dependent ones count once; ``equality`` (k,): which are equations.
    The directions are orthonormal, with ``whole`` a basis of the space.
    """
    lengths = np.sqrt(np.square(slopes).sum(axis=1))
    rows, equality = slopes[lengths > 0.0] / lengths[lengths > 0.0, None], equality[lengths > 0.0]
    if not len(rows):
        return np.eye(slopes.shape[1] if whole else 0, slopes.shape[1]), 0, 0
    _, singular, directions = np.linalg.svd(rows, full_matrices=whole)
    of_equalities = np.linalg.svd(rows[equality], compute_uv=False) if bool(equality.any()) else np.zeros(0)
    equalities = decided_rank(len(of_equalities), of_equalities, 0)
    return directions, decided_rank(len(singular), singular, 0), equalities


def violations(values: Floats, equality: Mask | bool) -> Floats:
    """How far each constraint is from being met, of the shape of ``values``, >= 0."""
    return np.where(equality, np.abs(values), np.maximum(values, 0.0))
