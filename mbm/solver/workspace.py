"""What a solve works with: the rows of its data set, two linearisation points, its state, and scratch, as records."""

from __future__ import annotations

from mbm.machine.records import Reference, integers_in, lay_out, reals_in, record, sized
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.description import DataSet, Problem

MOST_PLACES = 3
"""Places that ranges give."""

SCRATCH = 161
"""Numbers of scratch for ranges with four unknowns: six vectors, two matrices, a triangle, and the rows of a chunk."""


@record
class Rows:
    """The rows of a data set: as they are handed over, as the kernels take them, and as they come out."""

    constants: ConstantReals
    data: Reference[DataSet]
    parameters: ConstantReals
    whitening: Reals
    index: ConstantIntegers
    columns: ConstantIntegers
    """Brought by the caller, as `description` says."""
    fused: Integer
    """1: the fused rows are loaded, 0: blocks are taken one by one."""
    fused_data: Reals = sized("fused_reals")
    """Parameters and weights of the fused rows."""
    inputs: Reals = sized("most_inputs")
    """What the kernels take."""
    outputs: Reals = sized("most_outputs")
    """What the kernels put out."""
    weights: Reals = sized("most_weights")
    """What whitens, lane by lane."""
    chunk: Reals = sized("chunk * (n + 1)")
    """Rows of ``[J r]`` that are triangularised at a time, column by column."""
    residuals: Reals = sized("3 * most_residuals")
    """Three vectors of residuals."""


@record
class Linearisation:
    """A linearisation point: a point with all that depends on it alone."""

    cost: Real
    predicted: Real
    """Decrease of the cost that the undamped step promises."""
    length: Real
    """Its scaled length."""
    offset: Real
    """Relative offset (Bates and Watts 1981)."""
    rounding: Real
    """The rounding of ``‖r‖``."""
    cost_rounding: Real
    """The rounding of the cost."""
    squared_condition: Real
    """Upper estimate of it where the triangle comes from sums of products; 0 where it does not."""
    freedom: Integer
    ending: Integer
    """Why the iteration would end here."""
    deficient: Integer
    """Columns as good as dependent on those before them."""
    point: Reals = sized("numbers")
    x: Reals = sized("n")
    """Coordinates as bounds compare them."""
    peak: Reals = sized("n")
    """The largest norm that each column has had."""
    scale: Reals = sized("n")
    """The scale of each coordinate."""
    full: Reals = sized("n")
    """The undamped step."""
    stopped: Reals = sized("n")
    """1 for coordinates that a bound stopped in the undamped step."""
    free: Reals = sized("n")
    """1 for coordinates free to move."""
    projected: Reals = sized("n")
    """``Qᵀ r``: with the scaled triangle all that the rows say about steps."""
    norms: Reals = sized("n")
    """Norms of the columns."""
    factor: Reals = sized("n * n")
    """The scaled triangle."""
    triangle: Reals = sized("(n + 1) * (n + 1)")
    """That of ``[J r]``."""


@record
class Answer:
    """What a solve says, see `description`."""

    numbers: Reals
    results: Reals
    states: Integers
    sides: Integers
    triangle: Reals
    covariance: Reals
    multipliers: Reals


@record
class Work:
    """What one thread needs for a solve.

    The caller brings ``reals`` and ``integers`` of the sizes `work_reals` and `work_integers`, and of ``rows`` what
    belongs to the problem.
    """

    rows: Rows
    answer: Answer
    """Where it is to stand."""
    loaded: Integer
    """Number of the data set whose rows are loaded, and its weights unchanged; -1: none."""
    reals: Reals
    integers: Integers
    shared: Integer
    """1: the arrays here are parts of them, as the problem wants it."""
    first: Linearisation
    second: Linearisation
    here: Reference[Linearisation]
    """Where the iteration is."""
    other: Reference[Linearisation]

    radius: Real
    cost_tried: Real
    step_predicted: Real
    """Decrease of the cost that the step tried promises …"""
    step_length: Real
    """… and its scaled length."""
    tolerance: Real
    """The relative offset that ends the iteration."""
    weight: Real
    """What a violation by one unit costs is half the square of this."""
    worst: Real
    """The largest violation of the rounds before, in units."""
    curvature_known: Integer
    patience: Integer
    stop: Integer
    """Why the iteration is over, `RUNNING` while it is not."""
    iterations: Integer
    evaluations: Integer
    residuals_here: Integer
    """Number of the vector of residuals at the place of the iteration."""
    residuals_tried: Integer
    """… and at the trial point."""
    finite: Integer
    round: Integer
    count: Integer
    """Residuals that count, with those of penalties."""
    penalised: Integer
    """1: the constraints act as penalties, 0: they are left out."""
    sequential: Integer
    """1: steps are those of sequential quadratic programming."""
    contradicting: Integer
    """The last of those whose linearised constraints had no common point, in a row."""
    active: Integer
    """Active inequalities of a subproblem."""
    damping: Real
    """That of their steps, in scaled coordinates."""
    undamped: Integer
    """1: the step tried is the undamped one."""
    summed: Integer
    """1: triangles come from sums of products, as long as the condition allows it."""
    rank: Integer
    """Directions along the surface that the residuals determine, as the last covariance has found …"""
    loose: Integer
    """… and those that they do not."""

    tried: Reals
    """The trial point that counts: one of the next two."""
    trial: Reals = sized("numbers")
    corrected_trial: Reals = sized("numbers")

    step: Reals = sized("n")
    """The step tried."""
    step_stopped: Reals = sized("n")
    """1 for coordinates that a bound stopped in it."""
    scaled: Reals = sized("n")
    corrected: Reals = sized("n")
    """The step with the curvature answered."""
    gradient: Reals = sized("n")
    row: Reals = sized("n")
    right: Reals = sized("n")
    moving: Reals = sized("n")
    rest: Reals = sized("n")
    part_projected: Reals = sized("n")
    part_step: Reals = sized("n")
    moved: Reals = sized("n")
    back: Reals = sized("n")
    x: Reals = sized("n")
    shift: Reals = sized("n")
    gradient_shifted: Reals = sized("n")
    scale: Reals = sized("n")
    line: Reals = sized("n")
    along: Reals = sized("n")
    singular: Reals = sized("n")
    sizes: Reals = sized("n")
    """One over the scales of the coordinates, as the last covariance has taken them."""
    touched: Reals = sized("n")
    """Not 0 for coordinates that the last covariance leaves undetermined."""
    chosen: Integers = sized("n")
    """Coordinates that may move, one after the other."""

    damped: Reals = sized("n * n")
    part: Reals = sized("n * n")
    inner: Reals = sized("n * n")
    lower: Reals = sized("n * n")
    reflections: Reals = sized("n * n")
    inverse: Reals = sized("n * n")
    curvature: Reals = sized("n * n")
    """The second-order term."""
    small: Reals = sized("(n + 1) * (n + 1)")
    """A triangle …"""
    small_rows: Reals = sized("n * (n + 1)")
    """… and rows to go into it, column by column, ``n`` to a column."""

    equation: Integers = sized("most_multipliers")
    """1 for constraints that are equations, 0 for inequalities."""
    multipliers: Reals = sized("most_multipliers")
    units: Reals = sized("most_multipliers")
    values: Reals = sized("most_multipliers")
    roundings: Reals = sized("most_multipliers")
    held: Reals = sized("most_multipliers")
    """Units of the constraints that hold, else 0."""
    forces: Reals = sized("most_multipliers")
    """The multipliers at a place on their surface."""
    slopes: Reals = sized("most_multipliers * n")
    """Derivatives of the constraints."""
    trial_values: Reals = sized("most_multipliers")
    violation_weights: Reals = sized("most_multipliers")
    """What a violation adds to the merit function."""
    pushes: Reals = sized("n")
    """Multipliers of bounds in a subproblem: negative at lower, positive at upper ones."""
    faces: Integers = sized("n")
    """Active inequalities of a subproblem: constraints, then lower bounds from their count on, then upper bounds."""
    face_limits: Reals = sized("n")
    face_sizes: Reals = sized("n")
    face_forces: Reals = sized("n")
    face_changes: Reals = sized("n")
    normals: Reals = sized("n * n")
    """The normals of the active inequalities, of unit length, one to a row …"""
    face_basis: Reals = sized("n * n")
    """… and an orthonormal basis of what they span …"""
    face_triangle: Reals = sized("n * n")
    """… in which they are the columns of this upper triangle."""
    nearest: Reals = sized("n")
    onward: Reals = sized("n")
    normal: Reals = sized("n")


@record
class Ranges:
    """Rows that say ``√(|p − s|² + e) = l + β b``, for a place p of ``d`` coordinates and an offset b."""

    d: Integer
    """2 or 3; 0: there is no closed form."""
    offset: Integer
    """1: b is unknown; 0: it is nothing."""
    even: Integer
    """1: the sign of b is open, and taken positive."""
    rows: Integer
    spheres: Reals
    """Of each row s (d,), l, e and β: (rows, d + 3); NaN where nothing is known."""
    weights: Reals
    """One over the standard deviation of each row, 0: it takes no part; `places_of_ranges` makes it that of the squared
    range, but for a common factor."""
    scratch: Reals
    """`SCRATCH` numbers."""


@record
class RangeForm:
    """What is known of the rows of all data sets of a problem, if ranges give all numbers that are estimated."""

    ranges: Ranges
    """Those of the data set at hand; ``d`` is 0 where there is no such form."""
    rooted: Integer
    """1: the maps give the root of e: a known height above the stations."""
    stated: Integer
    """1: the noise is stated, so that the cost tells a bad fit."""
    places: ConstantIntegers
    """Where the coordinates of p, then b, stand among the numbers (m,)."""
    map_places: ConstantIntegers
    maps: ConstantReals
    """Of each type of unit of all blocks of residuals, as `known_rows` has them."""
    fixed_count: Integer
    fixed: ConstantIntegers
    """Numbers that are not estimated: the maps take them as further parameters."""
    values: ConstantReals
    held: Integer
    """1: the maps hold where they are the ``values`` only."""
    found: Reals
    """Places that fit, (`MOST_PLACES`, m)."""
    point: Reals
    """The best of them, and all other numbers (numbers,) …"""
    other: Reals
    """… and room for one more point (numbers,)."""


@record
class Solves:
    """Solves ``first … last`` of a batch."""

    problem: Reference[Problem]
    work: Reference[Work]
    """The scratch of one thread."""
    first: Integer
    last: Integer
    data: ConstantIntegers
    which: ConstantIntegers
    """The data set of each."""
    starts: ConstantReals
    answers: Answer
    """Of the whole batch."""
    form: RangeForm
    """What starts are compared with, if anything."""


def work_reals(problem: Problem) -> Integer:
    """Reals of scratch that a thread needs."""
    return reals_in(Work, problem)


def work_integers(problem: Problem) -> Integer:
    """Integers of scratch that a thread needs."""
    return integers_in(Work, problem)


def share_out(problem: Problem, work: Work) -> None:
    """Let the arrays in ``work`` be parts of its `work_reals` reals and `work_integers` integers."""
    lay_out(work, problem, work.reals, work.integers)
    work.shared = 1
