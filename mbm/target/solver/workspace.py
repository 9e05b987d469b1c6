"""Where things stand in the scratch arrays of one thread: ``work`` (reals) and ``flags`` (integers).

``work`` holds two places (points with all that is known there), vectors of residuals, steps, small matrices, and the
rows of the data set as the kernels take them. Functions give offsets in ``work``, or inside of a place.
"""

from __future__ import annotations

from mbm.target.solver.description import (
    CHUNK,
    COORDINATES,
    INPUTS,
    LANES,
    MULTIPLIERS,
    NUMBERS,
    OUTPUTS,
    RESIDUALS,
    UNITED_REALS,
    WEIGHTS,
)
from mbm.target.words import ConstantIntegers, Integer

# --- reals of a place -------------------------------------------------------------------------------------------
AT_COST = 0
AT_PREDICTED = 1
"""Decrease of the cost that the undamped step promises."""
AT_LENGTH = 2
"""Its scaled length."""
AT_OFFSET = 3
AT_NOISE = 4
"""The rounding of ``‖r‖``."""
AT_SLACK = 5
"""The rounding of the cost."""
AT_SQUARE = 6
"""Upper estimate of the squared condition where the triangle comes from sums of products; 0 where it does not."""
AT_POINT = 8

X = 0
"""Coordinates as bounds compare them."""
PEAK = 1
"""The largest norm that each column has had."""
METRIC = 2
"""The scale of each coordinate."""
FULL = 3
"""The undamped step."""
STOPPED = 4
"""1 for coordinates that a bound stopped in the undamped step."""
FREE = 5
"""1 for coordinates free to move."""
IMAGE = 6
"""``Qᵀ r``: with the scaled triangle all that the rows say about steps."""
NORMS = 7
"""Norms of the columns."""
VECTORS = 8

# --- integers: of places 0 and 1, then of the iteration ----------------------------------------------------------
FREEDOM_OF = 0
ENDING_OF = 1
DEFICIENT_OF = 2
SLOT = 4
HERE = 8
"""Number of the place where the iteration is."""
CURVATURE_KNOWN = 9
PATIENCE_LEFT = 10
STOP = 11
"""Why the iteration is over, `RUNNING` while it is not."""
ITERATIONS_DONE = 12
EVALUATIONS_DONE = 13
RESIDUALS_HERE = 14
"""Number of the vector of residuals at the place of the iteration."""
RESIDUALS_TRIED = 15
"""… and at the trial point."""
FINITE = 16
LOADED = 17
"""Number of the data set whose rows are loaded, and its weights unchanged; -1: none."""
ROUND = 18
COUNT_HERE = 19
"""Residuals that count, with those of penalties."""
PENALISED = 20
"""1: the constraints act as penalties, 0: they are left out."""
POINT_TRIED = 21
"""Number of the trial point."""
WHOLE = 22
"""1: the step tried is the undamped one."""
SUMMED = 23
"""1: triangles come from sums of products, as long as the condition allows it."""
RANK = 24
"""Directions along the surface that the residuals determine, as the last covariance has found …"""
LOOSE = 25
"""… and those that they do not."""
FLAGS = 26

# --- reals of the iteration --------------------------------------------------------------------------------------
RADIUS = 0
COST_TRIED = 1
STEP_PREDICTED = 2
"""Promise of the step tried …"""
STEP_LENGTH = 3
"""… and its scaled length."""
TOLERANCE_NOW = 4
"""The relative offset that ends the iteration."""
WEIGHT = 5
"""What a violation by one unit costs is half the square of this."""
WORST = 6
"""The largest violation of the rounds before, in units."""
UNITED_NOW = 7
"""1: the united rows of the data set are loaded, 0: its blocks are taken one by one."""
SCALARS = 16

STEP_VECTORS = 16
"""Vectors (n,) of scratch."""
TOUCHED = 15
"""The one of them that says which coordinates the last covariance leaves undetermined: not 0."""
MATRICES = 4
"""Matrices (n, n) of scratch."""


def vector_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Vector ``number`` in a place."""
    return AT_POINT + system[NUMBERS] + number * system[COORDINATES]


def factor_at(system: ConstantIntegers) -> Integer:
    """The scaled triangle (n, n) in a place."""
    return AT_POINT + system[NUMBERS] + VECTORS * system[COORDINATES]


def triangle_at(system: ConstantIntegers) -> Integer:
    """The triangle (n + 1, n + 1) of ``[J r]`` in a place."""
    return AT_POINT + system[NUMBERS] + (VECTORS + system[COORDINATES]) * system[COORDINATES]


def place_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Place 0 or 1; number 2 is where they end."""
    return number * (AT_POINT + 1 + system[NUMBERS] + (VECTORS + 2 + 2 * system[COORDINATES]) * system[COORDINATES])


def trial_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Trial point (N,) 0 or 1; number 2 is where they end."""
    return place_at(system, 2) + number * system[NUMBERS]


def scalars_at(system: ConstantIntegers) -> Integer:
    """Reals of the iteration, `SCALARS` of them."""
    return place_at(system, 2) + 2 * system[NUMBERS]


def step_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Vector (n,) of scratch."""
    return scalars_at(system) + SCALARS + number * system[COORDINATES]


def matrix_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Matrix (n, n) of scratch; number `MATRICES` is the second-order term."""
    return scalars_at(system) + SCALARS + (STEP_VECTORS + number * system[COORDINATES]) * system[COORDINATES]


def curvature_at(system: ConstantIntegers) -> Integer:
    """The second-order term (n, n)."""
    return matrix_at(system, MATRICES)


def small_triangle_at(system: ConstantIntegers) -> Integer:
    """A triangle (n + 1, n + 1) of scratch."""
    return matrix_at(system, MATRICES + 1)


def small_rows_at(system: ConstantIntegers) -> Integer:
    """Rows to go into it, column by column, ``n`` to a column."""
    return matrix_at(system, MATRICES + 2) + 2 * system[COORDINATES] + 1


def multipliers_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Vector (K,) of the constraints: `LAMBDA` and so on."""
    return matrix_at(system, MATRICES + 3) + 3 * system[COORDINATES] + 1 + number * system[MULTIPLIERS]


LAMBDA = 0
UNITS = 1
VALUES = 2
ROUNDINGS = 3
HELD = 4
FORCES = 5
MULTIPLIER_VECTORS = 6
"""Vectors (K,) of the constraints: multipliers, units, values, their roundings, units of those that hold (else 0), and
the multipliers at a place on their surface."""


def slopes_at(system: ConstantIntegers) -> Integer:
    """Derivatives of the constraints (K, n)."""
    return multipliers_at(system, MULTIPLIER_VECTORS)


def residuals_at(system: ConstantIntegers, number: Integer) -> Integer:
    """Vector of residuals 0, 1 or 2."""
    return slopes_at(system) + system[MULTIPLIERS] * system[COORDINATES] + number * system[RESIDUALS]


def chunk_at(system: ConstantIntegers) -> Integer:
    """Rows of ``[J r]`` that are triangularised at a time, column by column."""
    return residuals_at(system, 3)


def outputs_at(system: ConstantIntegers) -> Integer:
    """What the kernels put out."""
    return chunk_at(system) + system[CHUNK] * (system[COORDINATES] + 1)


def inputs_at(system: ConstantIntegers) -> Integer:
    """What the kernels take."""
    return outputs_at(system) + system[OUTPUTS]


def weights_at(system: ConstantIntegers) -> Integer:
    """The weights, lane by lane."""
    return inputs_at(system) + system[INPUTS]


def united_at(system: ConstantIntegers) -> Integer:
    """The data of united blocks."""
    return weights_at(system) + system[WEIGHTS]


def work_reals(system: ConstantIntegers) -> Integer:
    """Reals of scratch that a thread needs."""
    if LANES > 1:
        return united_at(system) + system[UNITED_REALS]
    return weights_at(system) + system[WEIGHTS]


def work_integers(system: ConstantIntegers) -> Integer:
    """Integers of scratch that a thread needs."""
    return FLAGS + system[COORDINATES]
