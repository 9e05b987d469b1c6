"""Numbers by which solvers decide, each with its reason, and the rule of rank: for compiled texts and those in NumPy.

Nothing is imported: whoever needs one number does not load the compiled solver, whose text takes long to read.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mbm.machine.words import ConstantReals, Integer, Real

# --- arithmetic -----------------------------------------------------------------------------------------------------
EPSILON = 2.220446049250313e-16
"""The distance from 1 to the next larger double."""

ROUNDING_ERRORS = 4.0
"""The rounding error of a value in units of ``EPSILON · ‖terms‖``: the model has a few operations behind it."""

CONSENSUS_ROUNDING = 64.0 * EPSILON
"""The rounding error of a residual, by which units are told apart, in units of the terms that it is made of."""

CONSTRAINT_SHARE = 1e-9
"""What is left of a constraint's derivative beside those of others, as a share of its own, if it says something new."""

ROUNDING_OF_BOUNDS = 4.0 * EPSILON
"""Relative error of a bound minus a number plus that number."""

ZERO_COST = 1e-60
"""A cost that is zero in any unit."""

TINY = 1e-140
HUGE = 1e150
"""Norms below and above are computed with care: their squares leave the range of the numbers."""

MOST_DENSE = 300
"""Unknowns up to which dense solvers are as fast as sparse ones, and tell more."""

MEMORY = 4_000_000
"""Numbers that are computed together: 32 MB, and a few times that on the way."""

# --- rank -----------------------------------------------------------------------------------------------------------
CERTAIN = 1e-12
"""Singular values of the column-scaled Jacobian below this share of the largest are zero: derivatives carry roundings
of a few 1e-16, sums over the rows some more, so an exact dependence shows at 1e-16 to 1e-13; the worst conditioned
sets of StRD (Bennett5, Lanczos, MGH10) stay above 1e-8."""

SUSPECT = 1e-9
GAP = 1e4
"""Between CERTAIN and SUSPECT they are zero where a gap this wide parts them from the larger ones: differences of large
coordinates (grid coordinates of millions of metres), and a point a rounding away from the surface of constraints, leave
dependences with errors of 1e-10. An ill-conditioned but determined problem (a polynomial of high degree) has singular
values that fall step by step, without such a gap."""

ROUNDED_DEPENDENCE = 1e-13
"""Those of affine equations are zero below this share if their derivatives are products of data: no difference of large
numbers makes their roundings larger. Dependences in them come to 1e-16 … 3e-15 (decimal numbers of all sizes). The
least certain deviations are known to a per cent."""

SHARE = 1e-6
"""A coordinate is undetermined if its component in the null space is above this, a derived quantity if the component
of its gradient is."""

# --- derivatives that vanish ------------------------------------------------------------------------------------------
ABSURD = 1e4
"""Conditional standard deviations above so many times the coordinate's size are looked into."""

VANISHING = 1e-12
"""A derivative that vanishes nearer to the estimate than this share of its size is zero."""

FAINT_BEND = 1e-8
"""``J² / |∂J/∂x|``, in standard deviations: where the curvature moves the residuals by one, ``J`` moves them by the
root of twice this at most. A parabola y = x² whose x is ten thousand times less certain than large comes to 1e-4."""

MOST_GROUPS = 16
"""Jacobians that are made for this at most: more suspects than these are moved in groups."""

BEND_STEP = 1e-4
LEAST_SIZE = 1e-6
"""Share of the size over which the derivative is differenced, and the least size."""

# --- trust region ---------------------------------------------------------------------------------------------------
LEAST_GAIN_RATIO = 1e-4
"""A step is accepted from this gain ratio on (MINPACK): the decrease over the predicted reduction."""

CURVED_SHARE = 0.75
"""A step with a lower gain ratio is tried again with the second-order correction."""

BEND = 0.75
"""The second-order correction may be this long beside the step (Transtrum and Sethna 2012)."""

UNDECIDED = 10.0
"""A predicted reduction below so many rounding errors of the cost says nothing: the relative offset decides."""

OFFSET_DECREASE = 0.95
"""A step that the relative offset decides must bring it below this share."""

SLOW_OFFSET = 0.1
"""Near the minimum the relative offset should fall below this share in one iteration."""

NEAR_OFFSET = 0.3
"""The minimum is near where the relative offset is below this: a third of a standard deviation."""

CREEP, MOST_CREEPING = 1e-2, 60
"""Farther off, the second-order term, which takes as many Jacobians, may help up to so many unknowns: in an iteration
that lowers the cost by less than this share."""

PATIENCE, NEVER = 4, 1_000_000
"""Iterations from one computation of the second-order term to the next."""

REACH = 30.0
"""Newton's first step may be this many radii long."""

TRIAL_POINTS = 100
"""Trial points in one iteration; the radius has shrunk by 10⁻³⁰ at least by then."""

DIFFERENCE = 1e-4
"""Derivatives are differenced over this many conditional standard deviations of the coordinate."""

LEAST_DIFFERENCE = 1e-7
"""The least length of a difference beside the coordinate itself, so that rounding stays small."""

UNSCALED = 1e-3
"""A start so much shorter (as ‖scale · x‖) than the residuals says nothing about how far to go."""

FLOOR = 0.1
CAP = 1e7
"""The scale of a coordinate is raised until ``scale · x`` is this share of the largest, by the factor CAP at most: a
column that is nearly zero would let its coordinate move far beyond its own size. Without it the first step of MGH17
goes to where every derivative vanishes; the shares from 0.03 to 0.15 do equally well."""

ROUNDED_ROTATION = 1e-13
"""A column of a rotation below this share of the largest one is rounding: derivatives carry a few 1e-16."""

POSITIVE_KEPT = 0.1
"""A coordinate of type `positive` keeps at least this share of its value in one step (fraction to the boundary)."""

REFINEMENTS = 2
"""Corrections of a linear solve from the residuals at the new point: they restore the digits that a bad start or
conditioning costs."""

# --- damping by Nielsen (1999) ----------------------------------------------------------------------------------------
FIRST_DAMPING = 1e-3
"""Damping at the start, relative to the diagonal of the normal equations."""

HOPELESS_DAMPING = 1e10
"""A damping above this moves nothing any more."""

REGULARISATION = 1e-14
"""Added to the unit diagonal of the normal equations: they stay regular where an unknown is not determined."""

REVISIONS = 3
"""How often a step is computed anew for the coordinates that are left when others have met their bounds."""

# --- bounds and constraints -----------------------------------------------------------------------------------------
IDLE = 1e-8
"""Cosine between the residuals and a column of the Jacobian below which nothing pushes along its coordinate."""

ROUNDED_PUSH = 1e-13
"""The same for what rounding leaves of the residuals, beside what they are computed from."""

EXACT = 1e-12
"""A constraint holds if its violation is below this share of its unit, or below the rounding error …"""

MET = 1e-8
"""… and where no step improves it, below this: far below any standard deviation."""

PUSHED = 1e-6
"""Multiplier, in standard deviations that the data would gain, above which an inequality is strongly active."""

FIRST_WEIGHT = 3.0
"""A violation by one standard deviation costs half the square of this at first."""

HEAVIER = 10.0
"""Factor by which the weight of the violations grows."""

SHRINKS = 0.25
"""A round of penalties should bring the violations to this share."""

LOOSE = 1e-2
"""Standard deviations to which the first round of penalties is solved."""

SLOW_KKT = 0.2
"""The second-order term is computed if the relative offset does not fall below this share in one KKT Newton step."""

POLISH = 0.5
SETTLED = 1e-4
"""Near the end each step must be shorter by POLISH; a step of SETTLED standard deviations ends where none is."""

# --- uncertainty ------------------------------------------------------------------------------------------------------
FARTHEST = 10.0
"""Multiples of the linear interval beyond which an end of the confidence interval counts as open."""

# --- losses and noise -----------------------------------------------------------------------------------------------
NEARLY_ZERO = 1e-3
"""Below this share of c² the difference ρ's − ρ is taken from its series: above it the subtraction keeps 13 digits."""

EXHAUSTED = 1e-9
"""A freedom below this share of the residuals is rounding of none; a curvature below this share of the weights too."""

TOLD = 2.0
"""Degrees of freedom ν from which on residuals alone tell their variance: below, its deviation √(2/ν) exceeds it, and
the stated noise counts as well."""

# --- consensus ------------------------------------------------------------------------------------------------------
STATED = -1
"""The noise group of units whose noise is stated."""

ATTEMPTS = 100
"""Starts of closed forms that are looked at for one that fits most units, where the first is far off."""

FAR = 3.0
"""A start is rejected if the median residual of a minimal-sample solution is this many times smaller."""

FIT_STEPS = 12
"""Steps of the fit to one subset: those that need more are nearly degenerate."""

MOST_FITS = 4000
"""Several starts are tried with each subset, up to so many fits; beyond, subsets and starts are paired off."""

LEAST_SHARE = 0.5
"""A solution that fewer units than this share agree with explains nothing."""

MANY_CONNECTED = 60
"""Connected unknowns from which on no subsets are sampled."""

LARGE_SUBSET = 7
"""From so many units in a subset on, trials free of outliers are rare: graduated non-convexity gives one more."""

FEW_STARTS = 8
"""Starts of graduated non-convexity."""

CANDIDATES = 10
"""Trials that are refined."""

WIDE = 16.0
"""Squared, so four times the limits: a fit to as few units as there are unknowns is that far off for the others."""

WIDE_STEPS = 4
"""Fits with wide limits, which help a poor subset and mislead one of two halves: so both ways are gone."""

REFINING_STEPS = 12
"""Fits by which a candidate is refined, and by which its inliers are settled in one round."""

SETTLING_ROUNDS = 20
"""Rounds until fit, scale and inliers agree with one another."""

CANDIDATE_DAMPING = 1e-6
"""First damping, relative to the diagonal of the normal equations: candidates are near their fit."""

CANDIDATE_REGULARISATION = 1e-13
"""Added to the unit diagonal: the normal equations stay regular where an unknown is not determined."""

STILL = 1e-12
"""A step that promises to lower the objective by less than this has arrived; with given weights, by this share."""

SAME_OBJECTIVE = 1e-4
"""Objectives that differ by less, absolutely or as a share, belong to solutions that the data cannot tell apart."""

CONTRADICTED = 4.0
"""Deviations by which the inliers' variance must exceed the stated one before the robust scale takes its place."""

AS_GOOD = 4.0
"""Another solution whose objective is larger by less than this explains the data as well (two standard deviations)."""

APART = 25.0
"""… and is another solution if it disagrees with the inliers by so much more in their sum of squares."""

CONTROL_GROWTH = 1.4
"""Factor of the control parameter of graduated non-convexity from one round to the next (Yang et al. 2020, §IV)."""

GRADUATED_ROUNDS = 100
"""Rounds of graduated non-convexity at most."""

GRADUATED_FITS = 50
"""Steps of its first fit, to all units with equal weight."""

ABSOLUTE_ROUNDS = 12
"""Its reweighted fits towards the least absolute deviations."""

LEAST_KEPT = 0.1
"""Of their variance, inliers keep this share at least: limits that leave less say nothing of it."""

ROUNDED = 4e-16
"""Relative accuracy to which the variance of noise is solved for …"""

SECANTS = 60
"""… in so many steps of the secant at most; six to eight are the rule."""

JOINT_STEPS = 100
"""Steps at most to where fit and noise agree: they converge linearly, by the share that curvature has in a step."""

ARRIVED = 1e-24
"""A step that promises no more than this, in squared deviations, changes nothing."""

# --- other minima ---------------------------------------------------------------------------------------------------
LOWER = 1e-6
"""Share of the cost by which another minimum must be lower to take the place of the one that was found first."""

ROUNDED_FIT = 16.0
"""Rounding errors of ``‖r‖`` below which a fit is exact: of two exact ones, rounding alone says which costs less."""

SAME_BASIN = 0.5
"""Share by which curvature changes what a point costs that lies in the basin of a minimum."""

USUAL = 5.0
"""Standard deviations of χ² within which a fit gives no cause for doubt."""

PLAUSIBLE = 1e3
"""Cost of a solution of a closed form beside that of its best one, above which it is not followed."""

# --- minimal samples ------------------------------------------------------------------------------------------------
MIRRORED = 1e-7
"""Extent of stations across their plane beside that along it, below which mirrored places fit them equally well."""

SYMMETRIC = 1e-6
"""Difference of the cosines between sights below which Grunert's fraction is nothing by nothing."""

SOLVED = 1e-6
"""What may be left of the laws of cosines, beside the largest squared side."""

NEARLY_REAL = 1e-6
"""A pair of roots whose imaginary parts are below this share of 1 + |x| counts as real: two roots nearly equal."""


def decided_rank(width: Integer, singular: ConstantReals, affine: Integer) -> Integer:
    """How many singular values (width,) (descending) count; see GAP, and ROUNDED_DEPENDENCE if affine."""
    if width == 0 or not singular[0] > 0.0:
        return 0
    for rank in range(1, width):
        value = singular[rank] / singular[0]
        before = singular[rank - 1] / singular[0]
        if affine == 1:
            if value <= ROUNDED_DEPENDENCE:
                return rank
        elif value <= CERTAIN or (value <= SUSPECT and value * GAP <= before):
            return rank
    return width


def vanishing(length: Real, size: Real, bend: Real, spread: Real) -> Integer:
    """Whether a column of a ``length`` is zero to first order, beside its change ``bend`` with its coordinate of a
    ``size``, where residuals have the standard deviation ``spread``.
    """
    return length <= VANISHING * size * bend or length * length <= FAINT_BEND * bend * spread


def usual_cost(freedom: Real) -> Real:
    """The cost that a fit with stated noise and so many degrees of freedom stays below, if nothing is wrong."""
    usual = max(freedom, 1.0)
    return usual + USUAL * sqrt(2.0 * usual)


def plausible(cost: Real, best: Real) -> Integer:
    """Whether a solution of a closed form may be meant beside its best one."""
    return cost <= PLAUSIBLE * best + PLAUSIBLE


def rounding_of_norm(terms: Real, cost: Real) -> Real:
    """The rounding error of ``‖r‖``: ``terms`` is ``Σ (‖J_j‖ x_j)²``, with 1 for coordinates of rotations."""
    return ROUNDING_ERRORS * EPSILON * (sqrt(terms) + sqrt(cost))


def fits_exactly(cost: Real, rounding: Real) -> Integer:
    """Whether a cost is nothing but ``rounding``, the rounding error of ``‖r‖``."""
    return cost <= rounding * rounding


def takes_over(cost: Real, other: Real, rounding: Real) -> Integer:
    """Whether a minimum that costs ``other`` takes the place of one that was found first, of which ``rounding`` is the
    rounding error of ``‖r‖``.
    """
    exact = fits_exactly(cost, ROUNDED_FIT * rounding)
    return isfinite(other) and not exact and not other >= (1.0 - LOWER) * cost


def leads_elsewhere(cost: Real, form: Real, away: Real) -> Integer:
    """Whether a point that costs ``form`` lies in another basin than a minimum at which it may be meant as well.

    ``away`` is ``‖J (x − x_min)‖²`` with the Jacobian at the minimum (NaN: not known): in its basin a point costs so
    much more than the minimum, but for curvature.
    """
    return plausible(form, cost) and fabs(form - cost - away) > SAME_BASIN * away


def worth_following(cost: Real, form: Real, away: Real, most: Real, rounding: Real) -> Integer:
    """Whether a closed form, which costs ``form``, is followed to its minimum, beside a minimum that was found.

    It costs more than the minimum that it lies near: it is followed where it costs less than what was found, or lies
    in another basin (``away`` as above). Where what was found costs more than the ``most`` that noise lets expect
    (infinite: noise says nothing), it may cost anything: errors add up along a chain of poses, whose start may cost
    more than a wrong minimum.
    """
    if not isfinite(form):
        return False
    if not cost < most:
        return True
    exact = fits_exactly(cost, ROUNDED_FIT * rounding)
    return not exact and (takes_over(cost, form, rounding) or leads_elsewhere(cost, form, away))
