"""Values of the numerics: what a solver is given, what it answers, what is known about the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from enum import Enum
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mbm.values import dataclass

Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Indices: TypeAlias = NDArray[np.int64]


class Equations(Protocol):
    """A least squares problem in whitened form: minimise ``Σ r(x)²`` with ``r = h/σ``.

    ``x`` is a point: numbers that only the equations understand. A step is a vector of ``dimension`` n coordinates in
    the tangent space at the point. ``coordinates(x)`` (n,) are the numbers to which a step simply adds, and 0 where it
    does something else (rotations, directions); bounds compare those, so they are finite only there. Priors are rows
    like any other.
    """

    @property
    def dimension(self) -> int:
        """n, the number of free scalar unknowns."""
        ...

    @property
    def count(self) -> int:
        """m, the number of scalar residuals: observations and priors."""
        ...

    @property
    def lower(self) -> Floats:
        """Hard lower bounds, shape (n,), -inf where there is none."""
        ...

    @property
    def upper(self) -> Floats:
        """Hard upper bounds, shape (n,), +inf where there is none."""
        ...

    @property
    def positive(self) -> Mask:
        """Coordinates that must stay strictly above zero, shape (n,)."""
        ...

    @property
    def linear(self) -> bool:
        """The residuals are affine in ``x``."""
        ...

    def residuals(self, x: Floats) -> Floats:
        """r(x), shape (m,); NaN or inf where the model has no value."""
        ...

    def jacobian(self, x: Floats) -> Floats:
        """dr/d(step) at step 0, shape (m, n), dense."""
        ...

    def retract(self, x: Floats, step: Floats) -> Floats:
        """X ⊞ step, a point; ``x + step`` for real unknowns."""
        ...

    def coordinates(self, x: Floats) -> Floats:
        """The numbers that steps add to, shape (n,), 0 for the coordinates of rotations and directions."""
        ...

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        """The point with other ``coordinates``; the rotations and directions of ``x`` stay."""
        ...


@runtime_checkable
class Profiled(Protocol):
    """What equations have besides where corrections of measured values may have been eliminated from them.

    ``profiled``: ``residuals`` and ``jacobian`` give the exact cost and, by their product, its exact gradient, but the
    Jacobian is not the derivative of the residuals.
    """

    @property
    def profiled(self) -> bool:
        """Something was eliminated."""
        ...


@runtime_checkable
class Correctable(Profiled, Protocol):
    """Equations that can also be had without the corrections."""

    def uncorrected(self) -> Equations:
        """The same equations with all measured values taken as exact."""
        ...

    def roughly_corrected(self) -> Equations:
        """The same equations with corrections to first order."""
        ...


class SparseJacobian(Protocol):
    """The whitened Jacobian of a sparse problem; only `mbm.sparse` looks further into it."""

    @property
    def values(self) -> Sequence[Floats]:
        """An array (rows, outputs, width) for each piece of its structure."""
        ...


class CovarianceFactor(Protocol):
    """What stands in for the covariance of so many estimates that it is never formed."""

    def single(self) -> Mask:
        """Coordinates (n,) that free directions of single members touch."""
        ...

    def leverages(self, values: Sequence[Floats], fixed: Mask) -> Floats:
        """The diagonal of ``J Σ Jᵀ`` (m,) for a `SparseJacobian` with these values; ``fixed`` (n,) are known."""
        ...


class Reason(Enum):
    """Why a solver stopped. ``name`` is for programs, ``sentence`` for people."""

    SMALL_OFFSET = ("converged", "the next step is negligible beside the uncertainty of the estimates")
    ROUNDING = ("converged", "no step improves the fit beyond rounding")
    EXACT_FIT = ("converged", "the residuals are zero to rounding")
    KINK = ("converged", "the equations have a kink here, and the fit gets worse on all sides of it")
    CLOSED_FORM = ("converged", "this is the answer of the closed form, as was asked")
    ONE_STEP = ("converged", "the equations are linear and were solved in one step")
    NO_UNKNOWNS = ("converged", "there are no unknowns: the quantities are computed from what is given")
    FLAT = ("not-converged", "the fit no longer improves, but the next step is not small: the minimum may lie far off")
    ENDLESS = ("not-converged", "the fit improves on and on towards infinite values")
    MAX_ITERATIONS = ("not-converged", "the limit of iterations was reached before the estimates settled")
    NOT_FINITE_AT_START = ("not-converged", "an equation has no finite value at the initial values")
    INTERRUPTED = ("not-converged", "the solve was interrupted; this is the best point so far")
    NO_AGREEMENT = ("not-converged", "fewer than half of the measurements agree with any one solution")
    CONTRADICTION = ("not-converged", "rows contradict one another, and the fit lies between what they say")
    INFEASIBLE = ("infeasible", "no point meets all constraints")
    JACOBIAN_NOT_FINITE_AT_START = ("not-converged", "a derivative of an equation is not finite at the initial values")
    NO_FINITE_STEP = ("not-converged", "every step, however short, leads to an equation without a finite value")

    def __init__(self, outcome: str, sentence: str) -> None:
        self.outcome = outcome
        self.sentence = sentence

    @property
    def converged(self) -> bool:
        """The point is a minimum as far as the arithmetic can tell."""
        return self.outcome == "converged"

    @property
    def under_way(self) -> bool:
        """It is none yet, and the next iterations may come to one. At other ends that are none nothing is told."""
        return self in (Reason.FLAT, Reason.MAX_ITERATIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Constraints (by number) and coordinates whose lower or upper bounds contradict one another.

    ``smallest``: without any one of them the others can be met; False where there were too many to try.
    """

    constraints: tuple[int, ...]
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    smallest: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConstraintState:
    """The constraints at a minimum.

    ``values`` (k,) should be zero where ``equality``, not above zero elsewhere; ``slopes`` (k, n) their derivatives.
    ``multipliers`` (k,) of ``cost/2 + Σ λ c``: half of what the cost would lose if the constraint gave way by one unit.
    ``violated`` where the constraint does not hold, ``active`` where it is at its limit, ``forcing`` where it keeps the
    estimates from moving: equations, and inequalities that the data push against.
    """

    values: Floats
    slopes: Floats
    multipliers: Floats
    equality: Mask
    violated: Mask
    active: Mask
    forcing: Mask
    conflict: Conflict | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimum:
    """What a solver answers; how good the point is and why it stopped are separate fields.

    ``point`` as the equations have it, ``residuals`` (m,), ``jacobian`` (m, n) at the point; ``cost = Σ r²``;
    ``at_bound`` (n,) holds -1 and +1 for coordinates held at their lower and upper bound, 0 elsewhere;
    ``bad_row`` is the first residual (0-based) that is not finite where the reason speaks of one; constraints count on
    after the residuals.
    With ``blocks`` the problem is sparse: ``jacobian`` is a SciPy CSR array.
    """

    point: Floats
    residuals: Floats
    jacobian: Floats
    cost: float
    reason: Reason
    iterations: int
    evaluations: int
    at_bound: NDArray[np.int8]
    bad_row: int | None = None
    constraints: ConstraintState | None = None
    blocks: SparseJacobian | None = field(default=None, repr=False)

    @property
    def feasible(self) -> bool:
        """Every constraint holds."""
        return self.constraints is None or not bool(self.constraints.violated.any())


class Motion(Enum):
    """How unknowns may move together over a finite distance, not only to first order."""

    TANGENT = "to first order"
    SHIFT = "by adding multiples of the coefficients"
    SCALE = "by multiplying with powers whose exponents are the relative coefficients"


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeCombination:
    """Unknowns that can move together without any equation noticing, to first order.

    ``indices`` are the coordinates concerned (0-based, ascending), ``coefficients`` their movement in the units of the
    coordinates, ``relative`` the same as ``δx_i / x_i`` (None unless every coordinate concerned is away from zero); the
    larger ones of ``relative`` (else of ``coefficients``) are 1 in magnitude. Where all of ``relative`` are equal, the
    unknowns scale together; where they are 1 and -1, only a product or quotient is determined.
    """

    indices: tuple[int, ...]
    coefficients: tuple[float, ...]
    relative: tuple[float, ...] | None
    motion: Motion = Motion.TANGENT


class CommonMotion(Enum):
    """A motion of everything at once; the value names it."""

    TRANSLATION = "translation"
    ROTATION = "rotation"
    SCALE = "scale"


@dataclass(frozen=True, slots=True, kw_only=True)
class GaugeMotion:
    """A motion of the whole scene that no equation notices, in ``dimensions`` directions; ``unknowns`` take part.

    ``axes`` are the directions where not all of them are free: the coordinate axes (from 0) of a translation, or the
    axis of a rotation. ``numbers``: a family of numbers that shift by one amount, no scene.
    """

    motion: CommonMotion
    dimensions: int
    unknowns: tuple[str, ...]
    axes: tuple[int, ...] = ()
    numbers: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observability:
    """The rank decision at a point.

    ``rank`` of ``dimension`` (the free coordinates only: those at a bound are ``fixed`` and not counted in either);
    ``equalities`` of the rank are what independent equations determine; ``condition`` of the column-scaled Jacobian
    on its estimable part; ``singular_values`` of that, descending; ``unused`` coordinates whose column is exactly zero;
    ``combinations`` that are free beside those; ``scale`` (n,) the column norms (1 for empty columns);
    ``row_space`` (n, rank − equalities) and ``null_space`` (n, k) orthonormal bases in scaled coordinates
    ``scale · step``; ``estimable`` (n,) False where a free combination or an unused coordinate touches; ``fixed`` (n,)
    those held at a bound. ``gauge`` names the common motions among what is free; ``datum`` of their dimensions were
    settled by the minimum-norm datum, and are in no ``null_space``: ``datum_space`` (n, k) has them, not scaled.
    ``inverse`` stands in for ``row_space`` (then empty) where there are very many coordinates.
    ``flat`` counts the directions that the equations determine, but along which robust losses leave the cost without
    curvature: they are in ``null_space`` and ``combinations``, though the rank counts them. ``limited_space`` (n, k) is
    an orthonormal basis of what inequalities that hold the estimates take away beside equations, scaled (None: nothing
    is, or of sparse problems nobody looks). ``unnoticed`` directions change residuals, but not the sum of squares.
    ``complete`` False: there may be more free combinations than were looked for.
    """

    dimension: int
    rank: int
    condition: float
    singular_values: Floats
    scale: Floats
    row_space: Floats
    null_space: Floats
    combinations: tuple[FreeCombination, ...]
    unused: tuple[int, ...]
    estimable: Mask
    fixed: Mask
    equalities: int = 0
    gauge: tuple[GaugeMotion, ...] = ()
    datum: int = 0
    datum_space: Floats | None = None
    inverse: CovarianceFactor | None = field(default=None, repr=False)
    flat: int = 0
    limited_space: Floats | None = None
    unnoticed: int = 0
    complete: bool = True

    @property
    def observable(self) -> bool:
        """Every free coordinate is determined by the equations, or by the datum that was asked for."""
        return self.rank + self.datum - self.flat == self.dimension


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Covariance:
    """Covariance of the estimates.

    ``matrix`` (n, n) holds NaN in the rows and columns of coordinates that a free combination touches and 0 for those
    fixed at a bound; ``sigma`` (n,) its root diagonal; ``factor`` (n, rank) with ``factor @ factor.T`` the covariance
    on the estimable subspace (minimum norm in the scaled metric), from which derived quantities are propagated.
    ``variance`` is the estimated s² in it. Of sparse problems ``factor`` and ``matrix`` are empty, and
    ``inverse`` times ``variance`` is the covariance. ``reason`` says why NaN stands elsewhere (None: it does not).
    """

    matrix: Floats
    sigma: Floats
    factor: Floats
    variance: float = 1.0
    inverse: CovarianceFactor | None = field(default=None, repr=False)
    reason: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagated:
    """Derived quantities: ``matrix`` (k, k) and ``sigma`` (k,), NaN where a free combination changes the quantity."""

    matrix: Floats
    sigma: Floats
    estimable: Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Residual statistics of CONTRACT §2: ``cost = Σ r²``; ``sigma0`` and ``chi2_p`` None where they mean nothing."""

    cost: float
    dof: int
    sigma0: float | None
    chi2_p: float | None


class NoiseState(Enum):
    """How the noise factor of a group came about; the value begins the sentence for people."""

    ESTIMATED = "the factor was estimated from the residuals"
    NO_REDUNDANCY = "no degrees of freedom are left to estimate the noise"
    COVERED = (
        "stated common errors or constants explain all of the residuals, which leaves nothing to estimate the noise"
    )
    NOTHING = "the noise of other rows explains all of the residuals, so that the noise is estimated as nothing"
    EXACT = "all residuals are zero but for rounding, which leaves nothing to estimate the noise"
    DEPENDENT = "without scatter, or in proportion to others, components leave nothing to estimate the covariance"


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Noise of one ``:sigma unknown`` group: its sigma times ``factor``, known by ``dof`` (None: as many as the fit's).

    Where ``state`` is not ESTIMATED, ``factor`` is the one last used as a weight (0 of NOTHING). ``rho`` is the
    correlation of neighbouring rows, ``covariance`` (k, k) that of a row's components, if they are estimated. Of
    ``dependent`` components some combination has no residuals at all. ``settled`` False: the rounds that estimate it
    ran out while it still changed.
    """

    factor: float
    state: NoiseState
    dof: float | None = None
    rho: float | None = None
    covariance: Floats | None = None
    dependent: tuple[int, ...] = ()
    settled: bool = True

    @property
    def why(self) -> str:
        """Why nothing is estimated, as the beginning of a sentence."""
        if not self.dependent:
            return self.state.value
        which, nothing = " and ".join(str(each + 1) for each in self.dependent), "nothing to estimate the covariance"
        if len(self.dependent) == 1:
            return f"component {which} has no scatter, which leaves {nothing}"
        return f"components {which} have residuals that depend linearly, which leaves {nothing}"
