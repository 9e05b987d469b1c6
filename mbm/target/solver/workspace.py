"""What a solve works with: two linearisation points, the state of its iteration, and scratch, as records.

`Rows` of the data set stand apart, as consensus evaluates them too: in one array, in which functions give offsets.
"""

from __future__ import annotations

from mbm.target.records import Reference, integers_in, lay_out, reals_in, record, sized
from mbm.target.solver.description import LANES, DataSet, Problem
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


@record
class Place:
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
    image: Reals = sized("n")
    """``Qᵀ r``: with the scaled triangle all that the rows say about steps."""
    norms: Reals = sized("n")
    """Norms of the columns."""
    factor: Reals = sized("n * n")
    """The scaled triangle."""
    triangle: Reals = sized("(n + 1) * (n + 1)")
    """That of ``[J r]``."""


@record
class Work:
    """What one thread needs for a solve.

    The caller brings ``reals`` and ``integers`` of the sizes `work_reals` and `work_integers`; see `share_out`.
    """

    constants: ConstantReals
    data: Reference[DataSet]
    index: ConstantIntegers
    columns: ConstantIntegers
    """Of the solve, see `description`."""
    reals: Reals
    integers: Integers
    shared: Integer
    """1: the arrays here are parts of them, as the problem wants it."""
    first: Place
    second: Place
    here: Reference[Place]
    """Where the iteration is."""
    other: Reference[Place]

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
    bent_trial: Reals = sized("numbers")

    step: Reals = sized("n")
    """The step tried."""
    step_stopped: Reals = sized("n")
    """1 for coordinates that a bound stopped in it."""
    scaled: Reals = sized("n")
    bent: Reals = sized("n")
    """The step with the curvature answered."""
    gradient: Reals = sized("n")
    row: Reals = sized("n")
    right: Reals = sized("n")
    moving: Reals = sized("n")
    rest: Reals = sized("n")
    part_image: Reals = sized("n")
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

    loaded: Integer
    """Number of the data set whose rows are loaded, and its weights unchanged; -1: none."""
    rows: Reals
    """The rows of the data set, as the kernels take them and as they come out; functions below give offsets."""


UNITED_NOW = 0
"""1: the united rows of the data set are loaded, 0: its blocks are taken one by one."""


def residuals_at(system: Problem, number: Integer) -> Integer:
    """Vector of residuals 0, 1 or 2."""
    return UNITED_NOW + 1 + number * system.most_residuals


def chunk_at(system: Problem) -> Integer:
    """Rows of ``[J r]`` that are triangularised at a time, column by column."""
    return residuals_at(system, 3)


def outputs_at(system: Problem) -> Integer:
    """What the kernels put out."""
    return chunk_at(system) + system.chunk * (system.n + 1)


def inputs_at(system: Problem) -> Integer:
    """What the kernels take."""
    return outputs_at(system) + system.most_outputs


def weights_at(system: Problem) -> Integer:
    """The weights, lane by lane."""
    return inputs_at(system) + system.most_inputs


def united_at(system: Problem) -> Integer:
    """The data of united blocks."""
    return weights_at(system) + system.most_weights


def rows_reals(system: Problem) -> Integer:
    """Reals that the rows of a data set need."""
    if LANES > 1:
        return united_at(system) + system.united_reals
    return united_at(system)


def work_reals(system: Problem) -> Integer:
    """Reals of scratch that a thread needs."""
    return reals_in(Work, system) + rows_reals(system)


def work_integers(system: Problem) -> Integer:
    """Integers of scratch that a thread needs."""
    return integers_in(Work, system)


def share_out(system: Problem, work: Work) -> None:
    """Let the arrays in ``work`` be parts of its `work_reals` reals and `work_integers` integers."""
    lay_out(work, system, work.reals, work.integers)
    work.rows = work.reals[reals_in(Work, system) :]
    work.shared = 1
