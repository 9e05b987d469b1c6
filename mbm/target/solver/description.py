"""How equations are handed to the solver: flat arrays of integers and reals, and where things stand in them.

One **system** is what a batch of solves has in common. It is described by two arrays:

* ``system`` (integers): the header below, then tables at the offsets that the header gives;
* ``constants`` (reals): the settings below, then lower and upper bounds of the n free coordinates (``BOUNDS_AT``,
  n + n; infinite where there is none), then for each unit with a loss its parameter and its shape (two reals).

The rows of all **data sets** stand in four arrays, row by row as they are in tables (no blocks of lanes here):

* ``parameters``: (rows, parameters of the block);
* ``weights``: (rows, ``BLOCK_WEIGHTS``) what whitens: for each unit its factors (k) or its triangular matrix (k, k,
  row by row). A unit whose first weight is 0 takes no part: its values are not looked at. Blocks of constraints have
  no weights;
* ``index``: for each input of an unknown its place among all numbers, (rows, variables), or one row if shared;
* ``columns``: for each tangent its place among the free coordinates, -1: not free, (rows, tangents) or one row.

``data`` (integers) has for each data set ``DATA_HEAD + DATA_BLOCK · blocks`` numbers: how many residuals count, then
for each block (observations and priors first, then constraints) where its first row stands in the four arrays and how
many rows there are.

A **solve** k of a batch takes the data set ``which[k]`` and starts at ``starts[k]`` (N,), all finite.

Kernels are reached by ``call_kernel(address, inputs, outputs, blocks)``: LANES rows to a block,
``inputs[(block · n_inputs + i) · LANES + lane]`` (variables, then parameters),
``outputs[(block · n_outputs + o) · LANES + lane]``. ``BLOCK_VALUES`` is the address of the function with the values
alone, ``BLOCK_JACOBIAN`` of the one that puts the nonzeros of the Jacobian behind them. Targets without addresses take
numbers instead. LANES is 4 in the process and 1 in printed text.

Per solve come back (arrays of the whole batch; a solve writes its own part only):

* ``numbers`` (N,) the point;
* ``results`` (``RESULTS``,) reals, ``states`` (``STATES``,) integers as named below;
* ``sides`` (n,) -1 and +1 for coordinates held at their lower and upper bound, else 0;
* ``triangle`` (n + 1, n + 1) row by row: the upper triangular factor of ``[J r]``, whitened, with losses in square-root
  form and without constraints, at the point. ``RᵀR = JᵀJ`` for its leading (n, n) part;
* ``covariance`` (n, n): inverse of ``JᵀJ`` on the surface of the bounds and constraints that hold, 0 for what they
  hold, in the directions that are determined (see `mask_undetermined`); times nothing (a common unknown factor s² is
  ``cost / freedom``);
* ``multipliers`` (``MULTIPLIERS``,) of ``cost/2 + Σ λ c``; 0 where a constraint does not hold anything.

The entry of a batch (`batch`), which solves ``first … last`` of it::

    solve_many(system, constants, parameters, weights, index, columns, data, which, starts, first, last,
               work, flags, numbers, results, states, sides, triangles, covariances, multipliers)

with ``work`` and ``flags`` the scratch of one thread. All arrays are of 64-bit floats or integers, contiguous.

Everything is in SI, angles in radians; quaternions (w, x, y, z). Scratch sizes come from `workspace.work_reals` and
`workspace.work_integers` of the ``system`` array. Results do not depend on how a batch is cut into calls.
"""

from __future__ import annotations

from collections.abc import Mapping

LANES = 4
"""Rows of a kernel's block; `modules.solver_module` reads the text with another number where that is asked for."""

# --- header of ``system`` ---------------------------------------------------------------------------------------
NUMBERS = 0
"""N, numbers of a point."""
COORDINATES = 1
"""n, free coordinates."""
CURVED = 2
"""Pieces that do not vary by addition (quaternions, directions, scales) with a free coordinate."""
BLOCKS = 3
"""Blocks of residuals: observations and priors."""
CONSTRAINTS = 4
"""Blocks of constraints."""
MULTIPLIERS = 5
"""Most constraint values K of a data set."""
LINEAR = 6
"""1: the residuals are affine in the unknowns."""
BOXED = 7
"""1: some coordinate has a bound or stays positive."""
ITERATIONS = 8
"""Most iterations."""
STRICT = 9
"""1: end at once where another method should take over (`UNSURE`); 0: go on and give the best that can be had."""
RESIDUALS = 10
"""Capacity for residuals: most ``Σ outputs · rows`` of a data set, rows of each block rounded up to LANES, and then
4 more."""
INPUTS = 11
"""Capacity for inputs: most ``Σ (variables + parameters) · rows``, rounded up likewise, of all blocks."""
WEIGHTS = 12
"""Capacity for weights: most ``Σ BLOCK_WEIGHTS · rows``, rounded up likewise; of constraints ``2 · outputs · rows``."""
CHUNK = 13
"""Residuals that are triangularised at a time: a multiple of 4 and of LANES · outputs of no block less."""
OUTPUTS = 14
"""Capacity for a kernel's outputs: most ``(outputs + nonzeros) · LANES · blocks at a time`` (see `equations.portion`)
of a block."""
PLACES_AT = 15
"""Offset of the table (n,) of the number that each free coordinate adds to, -1: it turns or scales something."""
CURVED_AT = 16
"""Offset of the table of pieces, `PIECE` integers each."""
BLOCKS_AT = 17
"""Offset of the table of blocks, `BLOCK` integers each."""
POSITIVE_AT = 18
"""Offset of the table (n,) of coordinates that stay above zero."""
DIRECT = 19
"""1: one step for affine equations (the method `linear`); 0: Marquardt's iteration."""
NOISES = 20
"""Groups of blocks whose noise has an unknown factor, for callers that estimate it: a solve itself takes the weights as
they are. 0 where one factor is common to all residuals: the estimates do not depend on it."""
UNITED_AT = 21
"""Offset of the table of blocks whose rows are united in one function, see below; 0: none are, as in printed text."""
UNITED_REALS = 22
"""Their parameters and weights, in all."""
SUMMED_FROM = 23
"""Rows of a block from which its normal equations are summed, where it has `BLOCK_NORMAL`."""
HEADER = 24

# --- pieces -----------------------------------------------------------------------------------------------------
PIECE_KIND = 0
PIECE_NUMBERS = 1
"""Places of up to four numbers among all."""
PIECE_COLUMNS = 5
"""Columns of up to three free coordinates, -1: not free."""
PIECE = 8
NUMBER = 0
SCALE = 1
QUATERNION = 2
DIRECTION = 3
PIECES: Mapping[str, int] = {"number": NUMBER, "scale": SCALE, "quaternion": QUATERNION, "sphere": DIRECTION}
"""By the labels of `mbm.problem.manifold.Piece`."""

# --- blocks -----------------------------------------------------------------------------------------------------
BLOCK_VALUES = 0
BLOCK_JACOBIAN = 1
BLOCK_OUTPUTS = 2
BLOCK_VARIABLES = 3
BLOCK_PARAMETERS = 4
BLOCK_TANGENTS = 5
BLOCK_NONZEROS = 6
BLOCK_INDEX = 7
"""Step from row to row in ``index``: the variables, or 0 where all rows are equal."""
BLOCK_COLUMNS = 8
"""Step from row to row in ``columns``: the tangents, or 0."""
BLOCK_WEIGHTS = 9
"""Weights of a row; 0 for constraints."""
BLOCK_UNITS = 10
"""Units (equations) of a row."""
BLOCK_UNITS_AT = 11
"""Offset in ``system`` of the units, `UNIT` integers each."""
BLOCK_NONZEROS_AT = 12
"""Offset in ``system`` of the nonzeros, `NONZERO` integers each."""
BLOCK_NOISE = 13
"""Group of unknown noise, -1: none; for callers, as `NOISES`."""
BLOCK_EQUALITY_AT = 14
"""Of constraints, offset in ``system`` of 1 (to be zero) or 0 (not above zero) for each output."""
BLOCK_NORMAL = 15
"""Address of the function that sums the normal equations of all rows, 0: there is none. It may be there for blocks with
one row of columns, weights that are the factors of the outputs in their order, and losses of all units or of none. It
is reached by ``call_normal(address, inputs, weights, losses, sums, blocks)``, see `mbm.target.normal_rows`; printed
text has none."""
BLOCK = 16

NONZERO_OUTPUT = 0
NONZERO_TANGENT = 1
NONZERO_WEIGHT = 2
"""Where in the weights of the row the factor of its output stands, -1: in a matrix, or it is a constraint's."""
NONZERO = 3

UNIT_FIRST = 0
UNIT_LAST = 1
"""The outputs ``first … last`` of a row."""
UNIT_WEIGHTS = 2
"""Where in the weights of the row the unit's begin."""
UNIT_MATRIX = 3
"""0: the weights are factors; 1 and 2: a lower or upper triangular matrix."""
UNIT_LOSS = 4
UNIT_LOSS_AT = 5
"""Offset in ``constants`` of the loss's parameter and shape."""
UNIT = 6
NO_LOSS = 0
HUBER = 1
SOFT_L1 = 2
CAUCHY = 3
TUKEY = 4
GEMAN_MCCLURE = 5
BARRON = 6
LOSSES: Mapping[str, int] = {
    "huber": HUBER,
    "soft-l1": SOFT_L1,
    "cauchy": CAUCHY,
    "tukey": TUKEY,
    "geman-mcclure": GEMAN_MCCLURE,
    "barron": BARRON,
}
"""By the names that ``:loss`` knows."""

# --- united blocks: one function for all their rows, of data sets that have just these rows and none of weight 0 ------
UNITED_VALUES = 0
"""Address of the function that gives the m whitened residuals."""
UNITED_JACOBIAN = 1
"""Address of the one that gives the columns of their derivatives, then the residuals, m numbers each. Both are reached
by ``call_united(address, point, data, target, stride)``: ``data`` are for each united block the parameters of its rows,
row by row, then their weights; columns begin ``stride`` apart."""
UNITED_RESIDUALS = 2
"""m; they come before those of all other blocks."""
UNITED_ROWS = 3
"""Here begins for each block of residuals how many rows are united; 0: the block is not."""

# --- data sets --------------------------------------------------------------------------------------------------
DATA_COUNT = 0
"""Residuals that count, m."""
DATA_HEAD = 1
DATA_PARAMETERS = 0
DATA_WEIGHTS = 1
DATA_INDEX = 2
DATA_COLUMNS = 3
DATA_ROWS = 4
DATA_BLOCK = 5

# --- constants --------------------------------------------------------------------------------------------------
TOLERANCE = 0
BOUNDS_AT = 8

# --- answers ----------------------------------------------------------------------------------------------------
COST = 0
"""``Σ r²``, with losses."""
OFFSET = 1
"""Relative offset (Bates and Watts 1981)."""
PLAIN_COST = 2
"""``Σ r²`` without losses."""
CONDITION = 3
"""Upper estimate of the condition of the column-scaled Jacobian; infinite where it is not known to be finite."""
VIOLATION = 4
"""Largest violation of a constraint in units of the constraints; 0 without."""
RESULTS = 8

REASON = 0
STEPS = 1
"""Iterations."""
EVALUATIONS = 2
FREEDOM = 3
"""Degrees of freedom: residuals, less the directions that they determine along the surface of the bounds and
constraints that hold."""
DEFICIENT = 4
"""1: the Jacobian is not of full rank there."""
ROUNDS = 5
"""Rounds of the penalties or of the variance components."""
STATES = 8

# --- reasons ----------------------------------------------------------------------------------------------------
RUNNING = 0
SMALL_OFFSET = 1
ROUNDING = 2
EXACT_FIT = 3
ONE_STEP = 4
FLAT = 5
MAX_ITERATIONS = 6
NOT_FINITE_AT_START = 7
NO_FINITE_STEP = 8
INFEASIBLE = 9
UNSURE = 10
"""Rank deficient, or out of range: the point is the best so far, another method should start anew."""
