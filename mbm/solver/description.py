"""How equations are handed to the solver: flat arrays of integers and reals, and where things stand in them.

One **problem** is what a batch of solves has in common. It is described by two arrays:

* ``problem`` (integers): the header below, then tables at the offsets that the header gives;
* ``constants`` (reals): the settings below, then lower and upper bounds of the n free coordinates (``BOUNDS_AT``,
  n + n; infinite where there is none), then for each unit with a loss its parameter and its shape (two reals).

The rows of all **data sets** stand in four arrays, row by row as they are in tables (no blocks of lanes here):

* ``parameters``: (rows, parameters of the block);
* ``weights``: (rows, ``Block.weights``) what whitens: for each unit its factors (k) or its triangular matrix (k, k,
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
``outputs[(block · n_outputs + o) · LANES + lane]``. ``Block.values`` is the address of the function with the values
alone, ``Block.jacobian`` of the one that puts the nonzeros of the Jacobian behind them. Targets without addresses take
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

A batch is handed over as `batch.Solves`, with `workspace.Work` as the scratch of one thread. All arrays are of 64-bit
floats or integers, contiguous.

Everything is in SI, angles in radians; quaternions (w, x, y, z). Scratch sizes come from `workspace.work_reals` and
`workspace.work_integers` of the ``problem`` array. Results do not depend on how a batch is cut into calls.
"""

from __future__ import annotations

from collections.abc import Mapping

from mbm.machine.records import Records, behind, record, slots_of, table
from mbm.machine.words import ConstantIntegers, Integer, Integers


@record
class Unit:
    """Outputs of a row that are whitened together and share a loss."""

    first: Integer
    last: Integer
    """The outputs ``first … last`` of a row."""
    weights: Integer
    """Where in the weights of the row the unit's begin."""
    matrix: Integer
    """0: the weights are factors; 1 and 2: a lower or upper triangular matrix."""
    loss: Integer
    loss_at: Integer
    """Offset in ``constants`` of the loss's parameter and shape."""


@record
class Nonzero:
    """A derivative that a kernel puts out."""

    output: Integer
    tangent: Integer
    weight: Integer
    """Where in the weights of the row the factor of its output stands, -1: in a matrix, or it is a constraint's."""


@record
class Block:
    """Rows of one kind."""

    values: Integer
    jacobian: Integer
    outputs: Integer
    variables: Integer
    parameters: Integer
    tangents: Integer
    nonzero_count: Integer
    index: Integer
    """Step from row to row in ``index``: the variables, or 0 where all rows are equal."""
    columns: Integer
    """Step from row to row in ``columns``: the tangents, or 0."""
    weights: Integer
    """Weights of a row; 0 for constraints."""
    unit_count: Integer
    """Units (equations) of a row."""
    units: Records[Unit] = table()
    nonzeros: Records[Nonzero] = table()
    noise: Integer
    """Group of unknown noise, -1: none; for callers, as `noises`."""
    equality: ConstantIntegers = table()
    """Of constraints, 1 (to be zero) or 0 (not above zero) for each output."""
    normal: Integer
    """Address of the function that sums the normal equations of all rows, 0: there is none. It may be there for
    blocks with one row of columns, weights that are the factors of the outputs in their order, and losses of all
    units or of none. It is reached by ``call_normal(address, inputs, weights, losses, sums, blocks)``, see
    `mbm.kernels.native.normal`; printed text has none."""


@record
class Component:
    """Numbers that turn or scale: they do not vary by addition."""

    kind: Integer
    number_0: Integer
    """Places of up to four numbers among all."""
    number_1: Integer
    number_2: Integer
    number_3: Integer
    column_0: Integer
    """Columns of up to three free coordinates, -1: not free."""
    column_1: Integer
    column_2: Integer


@record
class Fused:
    """One function for all rows of some blocks, of data sets that have just these rows and none of weight 0."""

    values: Integer
    """Address of the function that gives the m whitened residuals."""
    jacobian: Integer
    """Address of the one that gives the columns of their derivatives, then the residuals, m numbers each. Both are
    reached by ``call_fused(address, point, data, target, stride)``: ``data`` are for each fused block the
    parameters of its rows, row by row, then their weights; columns begin ``stride`` apart."""
    residuals: Integer
    """m; they come before those of all other blocks."""
    rows: ConstantIntegers = behind()
    """Here begins for each block of residuals how many rows are fused; 0: the block is not."""


@record
class Problem:
    """What a batch of solves has in common."""

    numbers: Integer
    """N, numbers of a point."""
    n: Integer
    """n, free coordinates."""
    component_count: Integer
    """Pieces that do not vary by addition (quaternions, directions, scales) with a free coordinate."""
    residual_blocks: Integer
    """Blocks of residuals: observations and priors."""
    constraint_blocks: Integer
    """Blocks of constraints."""
    most_multipliers: Integer
    """Most constraint values K of a data set."""
    linear: Integer
    """1: the residuals are affine in the unknowns."""
    affine: Integer
    """1: residuals, losses aside, and constraints are, and their derivatives are products of data."""
    boxed: Integer
    """1: some coordinate has a bound or stays positive."""
    iterations: Integer
    """Most iterations."""
    strict: Integer
    """1: end at once where the Jacobian is not of full rank (`UNSURE`), a column counts as dependent early; 0: go on
    with steps of least length, a column counts as dependent where only rounding is left of it."""
    rule: Integer
    """How steps are limited: `MARQUARDT`, `DOGLEG` or `GAUSS_NEWTON`."""
    exact: Integer
    """1: sequential quadratic programming meets the constraints, and penalties only where that gets stuck."""
    profiled: Integer
    """1: something is eliminated from the residuals: the Jacobian is not their derivative, though ``Jᵀ r`` is the exact
    gradient of ``Σ r² / 2``."""
    most_residuals: Integer
    """Capacity for residuals: most ``Σ outputs · rows`` of a data set, rows of each block rounded up to LANES, and
    then 4 more."""
    most_inputs: Integer
    """Capacity for inputs: most ``Σ (variables + parameters) · rows``, rounded up likewise, of all blocks."""
    most_weights: Integer
    """Capacity for weights: most ``Σ BLOCK_WEIGHTS · rows``, rounded up likewise; of constraints ``2 · outputs ·
    rows``."""
    chunk: Integer
    """Residuals that are triangularised at a time: a multiple of 4 and of LANES · outputs of no block less."""
    most_outputs: Integer
    """Capacity for a kernel's outputs: most ``(outputs + nonzeros) · LANES · blocks at a time`` (see
    `equations.portion`) of a block."""
    number_of: Integers = table()
    """Table (n,) of the number that each free coordinate adds to, -1: it turns or scales something."""
    components: Records[Component] = table()
    """Pieces."""
    blocks: Records[Block] = table()
    """Of residuals, then of constraints."""
    positive: Integers = table()
    """1 for coordinates (n,) that stay above zero."""
    direct: Integer
    """1: one step for affine equations (the method `linear`); 0: Marquardt's iteration."""
    noises: Integer
    """Groups of blocks whose noise has an unknown factor, for callers that estimate it: a solve itself takes the
    weights as they are. 0 where one factor is common to all residuals: the estimates do not depend on it."""
    scaled: Integer
    """1: one unknown factor is common to all residuals, so that their size tells it; 0: they are whitened."""
    fused: Records[Fused] = table()
    """The blocks whose rows are fused in one function, where there are `fused_reals`."""
    fused_reals: Integer
    """Their parameters and weights, in all."""
    summed_from: Integer
    """Rows of a block from which its normal equations are summed, where it has `normal`."""


@record
class DataBlock:
    """Where the rows of a block begin in the four arrays, and how many there are."""

    parameters: Integer
    weights: Integer
    index: Integer
    columns: Integer
    rows: Integer


@record
class DataSet:
    """The rows of one data set."""

    count: Integer
    """Residuals that count, m."""
    blocks: Records[DataBlock] = behind()


HEADER = slots_of(Problem)
BLOCK = slots_of(Block)
UNIT = slots_of(Unit)
PIECE = slots_of(Component)
DATA_HEAD = slots_of(DataSet)
DATA_BLOCK = slots_of(DataBlock)
FUSED = slots_of(Fused)

NUMBER = 0
SCALE = 1
QUATERNION = 2
DIRECTION = 3
PIECES: Mapping[str, int] = {"number": NUMBER, "scale": SCALE, "quaternion": QUATERNION, "sphere": DIRECTION}
"""Kinds of components, by the labels of `mbm.problem.manifold.Piece`."""

NO_LOSS = 0
"""Of a unit with plain squares; the others are numbered in `losses.LOSSES`."""

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
COMPARED = 6
"""1: the start was compared with a closed form."""
STATES = 8

# --- rules of steps ----------------------------------------------------------------------------------------------
MARQUARDT = 0
"""Damped steps (Levenberg 1944, Marquardt 1963, Moré 1978)."""
DOGLEG = 1
"""Along the gradient to its minimum, then straight towards the undamped step (Powell 1970)."""
GAUSS_NEWTON = 2
"""The undamped step, shortened (Hartley 1961)."""
RULES: Mapping[str, int] = {"lm": MARQUARDT, "dogleg": DOGLEG, "gauss-newton": GAUSS_NEWTON}
"""By the names that ``:method`` knows; all other methods that iterate are Marquardt's."""

# --- reasons ----------------------------------------------------------------------------------------------------
RUNNING = 0
SMALL_OFFSET = 1
ROUNDING = 2
EXACT_FIT = 3
KINK = 4
ONE_STEP = 5
FLAT = 6
MAX_ITERATIONS = 7
NOT_FINITE_AT_START = 8
NO_FINITE_STEP = 9
INFEASIBLE = 10
UNSURE = 11
"""Rank deficient, or out of range: the point is the best so far, another method should start anew."""
