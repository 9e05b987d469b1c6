"""How consensus is handed to the solver, and where things stand in its scratch arrays.

Beside the arrays of `description` (with ``CHUNK`` no less than ``RESIDUALS``: all rows stand side by side):

* ``rules`` (integers): the header below, then tables at the offsets that it gives;
* ``levels`` (reals): for each type of unit (an equation of a block of residuals) `LEVEL` numbers;
* ``forms`` (reals): what the closed form knows of each unit of each data set, ``FORM_WIDTH`` numbers from
  ``units_at · FORM_WIDTH`` on, NaN where it knows nothing; see `consensus_subsets`.

The units of a data set are numbered block by block of those that are ruled, row by row, equation by equation. A unit
whose first weight is 0 must not be among them.

``bench`` (reals) and ``places`` (integers) are scratch of one thread; U is the capacity for units.
"""

from __future__ import annotations

from mbm.target.decisions import CANDIDATES
from mbm.target.solver.description import BLOCKS, CHUNK, CONSTRAINTS, COORDINATES, NUMBERS
from mbm.target.words import ConstantIntegers, Integer

# --- header of ``rules`` ----------------------------------------------------------------------------------------
KIND = 0
"""How trials are scored: `consensus_scores`."""
GROUPS = 1
"""Groups of unknown noise; a unit's group is from 0, `STATED` where its noise is stated."""
FIRST_STATE = 2
SECOND_STATE = 3
"""State of the generator at the start of the first trial."""
FORM = 4
"""The closed form that fits subsets: 0 none, `SPHERES`, `SIGHTS`."""
FORM_AT = 5
"""Offset in ``rules`` of what the closed form says of itself."""
FORM_WIDTH = 6
STARTS = 7
"""Starts of each data set, at least one."""
MOST_UNITS = 8
MOST_POINTS = 9
"""Capacity for trials: points that are scored."""
TRIALS_AT = 10
"""Offset of the table of trials by the size of the subsets, 0 … n."""
BLOCKS_AT = 11
"""Offset of the table of blocks of residuals, `RULED` integers each."""
THRESHOLDED = 12
"""1: the limits of inliers are stated and are not widened."""
MOST_ROWS = 13
"""Capacity for the rows of a subset: numbers of the largest of its four arrays."""
STARTLESS = 14
"""1: what the first subset gives in closed form is the start; the one given holds the other numbers only."""
UNTIL_SURE = 15
"""1: trials end as soon as they are enough for what the best of them explains."""
HEADER = 16

RULED_TYPE = 0
"""The first type of unit of the block in ``levels``; -1: no rule acts on it."""
RULED_GROUP = 1
RULED = 2

SPHERES = 1
"""In ``rules``: dimension d, 1 for an offset, 1 for an even one, then the places of d + offset numbers."""
SIGHTS = 2
"""In ``rules``: 1 for the inverse motion, kind of the rotation's numbers, then their places and those of t (3)."""
AS_QUATERNION = 0
AS_EULER_ANGLES = 1
AS_ROTATION_VECTOR = 2

LEVEL_MEDIAN = 0
"""The median of the law of squared norms."""
LEVEL_CUT = 1
"""The squared limit for variance 1."""
LEVEL_REACH = 2
"""The squared limit at three standard deviations."""
LEVEL = 4

# --- answers of a data set --------------------------------------------------------------------------------------
AGREED = 0
"""1: there is an answer; 0: another method should take over."""
TRIALS = 1
AMBIGUOUS = 2
INLIERS = 3
ANSWERS = 4

# --- bench ------------------------------------------------------------------------------------------------------
BY_RULE = 0
BY_WIDE_LIMITS = 1
BY_MEDIAN = 2
LISTS = 3
"""Lists of the best trials, `CANDIDATES` at most in each."""
MOST_CANDIDATES = 40
"""Those that are improved, in two ways."""

MEDIANS = 0
CUTS = 1
REACHES = 2
UNIT_ROUNDINGS = 3
VARIANCES = 4
LIMITS = 5
SQUARES = 6
"""Squared norms at point 0, and in the next vector at point 1."""
WEIGHTS_OF = 8
SORTED = 9
NOISE = 10
FRESH = 11
UNIT_VECTORS = 12

STEP = 0
GRADIENT = 1
SCALES = 2
HOLD = 3
AWAY = 4
THRESHOLD = 5
OBJECTIVE = 6
SMALL_VECTORS = 7

NO_CANDIDATE = -1

# --- progress of one data set -----------------------------------------------------------------------------------
UNITS_LISTED = 0
SUBSET_SIZE = 1
"""Units of a subset; 0: the units do not determine the unknowns, and there are no trials."""
TRIALS_WANTED = 2
TRIALS_MADE = 3
POINTS_MADE = 4
MOST_INSIDE = 5
"""Units that the best of the trials explains."""
EVERY_SUBSET = 6
"""1: trials are all subsets there are, one after the other."""
UNTIL_ENOUGH = 7
"""1: trials end when they are enough for what the best of them explains."""
PROGRESS = 8


def unit_vector_at(rules: ConstantIntegers, number: Integer) -> Integer:
    """Vector (U,) of the bench."""
    return number * rules[MOST_UNITS]


def slot_at(system: ConstantIntegers, rules: ConstantIntegers, number: Integer) -> Integer:
    """Columns of ``[J r]``, column by column: two points, and what is weighted."""
    return unit_vector_at(rules, UNIT_VECTORS) + number * (system[COORDINATES] + 1) * system[CHUNK]


def by_row_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Weights residual by residual, then 1 for each residual that a rule acts on, else 0."""
    return slot_at(system, rules, 3)


def bench_matrix_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """A matrix (n, n)."""
    return by_row_at(system, rules) + 2 * system[CHUNK]


def basis_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """A basis (n + 1, n)."""
    return bench_matrix_at(system, rules) + system[COORDINATES] * system[COORDINATES]


def small_at(system: ConstantIntegers, rules: ConstantIntegers, number: Integer) -> Integer:
    """A vector (n + 4,)."""
    n = system[COORDINATES]
    return basis_at(system, rules) + (n + 1) * n + number * (n + 4)


def point_at(system: ConstantIntegers, rules: ConstantIntegers, number: Integer) -> Integer:
    """Points (N,) of an iteration: 0 here, 1 there, 2 and 3 to keep."""
    return small_at(system, rules, SMALL_VECTORS) + number * system[NUMBERS]


def form_scratch_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Scratch of closed forms: 120 numbers and the rows of a subset with up to five unknowns."""
    return point_at(system, rules, 4)


FORM_SCRATCH = 240


def directions_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Rows of the Jacobian with norm 1, unit by unit (CHUNK, n)."""
    return form_scratch_at(system, rules) + FORM_SCRATCH


def trials_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Points that are scored (MOST_POINTS, N)."""
    return directions_at(system, rules) + system[CHUNK] * system[COORDINATES]


def begun_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """The starts (STARTS, N), then room for the solutions of a closed form (4, N)."""
    return trials_at(system, rules) + rules[MOST_POINTS] * system[NUMBERS]


def candidate_size(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Numbers of a candidate: its score or objective, its point, its squares."""
    return 1 + system[NUMBERS] + rules[MOST_UNITS]


def candidate_at(system: ConstantIntegers, rules: ConstantIntegers, number: Integer) -> Integer:
    """A candidate."""
    first = begun_at(system, rules) + (rules[STARTS] + 4) * system[NUMBERS]
    return first + number * candidate_size(system, rules)


def subset_rows_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Parameters of the rows of a subset, then their weights."""
    return candidate_at(system, rules, MOST_CANDIDATES)


def bench_reals(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Reals of the bench."""
    return subset_rows_at(system, rules) + 2 * rules[MOST_ROWS]


# --- places -----------------------------------------------------------------------------------------------------
COMPONENTS = 0
GROUP_OF = 1
PLACE = 2
"""Where the unit's first residual stands; the next ones follow at steps of LANES."""
BLOCK_OF = 3
ROW_OF = 4
FIRST = 5
"""The first of the unit's rows among the directions; U + 1 numbers, so that it takes two vectors."""
INSIDE = 7
ORDER = 8
UNIT_OF = 9
"""The equation of the unit in its row."""
PLACE_VECTORS = 10


def place_vector_at(rules: ConstantIntegers, number: Integer) -> Integer:
    """Vector (U + 1,) of the places."""
    return number * (rules[MOST_UNITS] + 1)


def chosen_at(rules: ConstantIntegers) -> Integer:
    """The units of a subset (n,), the next combination (n,), the state of a trial (2,) and the one used up (2,)."""
    return place_vector_at(rules, PLACE_VECTORS)


def small_places_at(system: ConstantIntegers, rules: ConstantIntegers, number: Integer) -> Integer:
    """Integers (n + 4,) of scratch: 0 the chosen units, 1 a combination, 2 states, 3 an order."""
    return chosen_at(rules) + number * (system[COORDINATES] + 4)


def best_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Numbers of the best trials (LISTS, CANDIDATES), then how many there are in each list."""
    return small_places_at(system, rules, 4)


def best_scores_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Their scores (LISTS, CANDIDATES), in the bench, where candidates come to stand later."""
    return candidate_at(system, rules, 0)


def simple_at(rules: ConstantIntegers) -> Integer:
    """1: there is nothing but units of one residual, and unit u has residual u; it stands behind the first rows."""
    return place_vector_at(rules, FIRST + 2) - 1


def one_side_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """1: all stations of the spheres lie in one plane, so that solutions mirror one another: one stands for both."""
    return best_at(system, rules) + LISTS * (CANDIDATES + 1)


def subset_data_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """The data set of a subset, then its ``index`` and its ``columns``."""
    return one_side_at(system, rules) + 1


def subset_index_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """The ``index`` of a subset's rows, then their ``columns``."""
    return subset_data_at(system, rules) + 1 + 5 * (system[BLOCKS] + system[CONSTRAINTS])


def progress_at(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """How far the trials of a data set have come, `PROGRESS` integers."""
    return subset_index_at(system, rules) + 2 * rules[MOST_ROWS]


def places_integers(system: ConstantIntegers, rules: ConstantIntegers) -> Integer:
    """Integers of the places."""
    return progress_at(system, rules) + PROGRESS
