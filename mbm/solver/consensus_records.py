"""How consensus is handed to the solver, and what it works with, as records.

The units of a data set (its equations in single rows) are numbered block by block of those that are ruled, row by row,
equation by equation. A unit whose first weight is 0 takes no part and has no number. All rows stand side by side: the
problem has a chunk no smaller than its residuals.
"""

from __future__ import annotations

from mbm.machine.records import Records, Reference, integers_in, lay_out, reals_in, record, sized, slots_of, table, view
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.decisions import CANDIDATES
from mbm.solver.description import DATA_BLOCK, DATA_HEAD, DataSet, Problem
from mbm.solver.workspace import Rows

SPHERES = 1
"""A closed form says of itself: dimension d, 1 for an offset, 1 for an even one, then the places of d + offset numbers.
"""
SIGHTS = 2
"""… 1 for the inverse motion, kind of the rotation's numbers, then their places and those of t (3)."""
AS_QUATERNION = 0
AS_EULER_ANGLES = 1
AS_ROTATION_VECTOR = 2

BY_RULE = 0
BY_WIDE_LIMITS = 1
BY_MEDIAN = 2
LISTS = 3
"""Lists of the best trials, `CANDIDATES` at most in each."""
MOST_CANDIDATES = 40
"""Those that are improved, in two ways."""

HELD_ROUNDS = 5
"""Times that inequalities and bounds are put in which hold the fit to what agrees, until they are the same."""

NO_CANDIDATE = -1
NOWHERE = -1


@record
class RuledBlock:
    """What consensus does with a block of residuals."""

    first_level: Integer
    """Number of its first equation among the levels; -1: no rule acts on it."""
    group: Integer
    """Its group of unknown noise; `STATED` where its noise is stated."""


@record
class Level:
    """The law of the squared norms of an equation."""

    median: Real
    cut: Real
    """The squared limit for variance 1."""
    reach: Real
    """The squared limit at three standard deviations."""


LEVEL = slots_of(Level)


@record
class Rules:
    """What is asked of consensus, and how much room it has."""

    kind: Integer
    """How trials are scored: `consensus_scores`."""
    groups: Integer
    """Groups of unknown noise."""
    first_state: Integer
    second_state: Integer
    """State of the generator at the start of the first trial."""
    form: Integer
    """The closed form that fits subsets: 0 none, `SPHERES`, `SIGHTS`."""
    form_width: Integer
    """What it knows of each unit: so many numbers, NaN where it knows nothing; see `consensus_forms`."""
    curved: Integer
    """1: lines of sight are known nearly, and found from there: `consensus_sights`."""
    starts: Integer
    """Starts of each data set, at least one."""
    thresholded: Integer
    """1: the limits of inliers are stated and are not widened."""
    startless: Integer
    """1: what the first subset gives in closed form is the start; the one given holds the other numbers only."""
    near: Integer
    """1: no trials, since some of the units agree with the start already: all of them are brought to agreement."""
    until_sure: Integer
    """1: trials end as soon as they are enough for what the best of them explains."""
    most_units: Integer
    most_points: Integer
    """Capacity for trials: points that are scored."""
    most_rows: Integer
    """Capacity for the rows of a subset: numbers of the largest of its four arrays."""
    blocks: Integer
    """Blocks of the problem; with the sizes that follow, as there: `take_sizes`."""
    numbers: Integer
    n: Integer
    chunk: Integer
    most_inputs: Integer
    most_outputs: Integer
    most_weights: Integer
    most_residuals: Integer
    fused_reals: Integer
    most_multipliers: Integer
    trials: ConstantIntegers = table()
    """Trials by the size of the subsets, 0 … n."""
    ruled: Records[RuledBlock] = table()
    """Blocks of residuals."""
    about: ConstantIntegers = table()
    """What the closed form says of itself."""


@record
class Verdict:
    """What is to be said of one data set."""

    agreed: Integer
    """1: there is an answer."""
    trials: Integer
    ambiguous: Integer
    inliers: Integer


ANSWERS = slots_of(Verdict)


@record
class Units:
    """The units of a data set, in order."""

    count: Integer
    scalars: Integer
    """Residuals of all units."""
    simple: Integer
    """1: there is nothing but units of one residual, and unit u has residual u."""
    components: Integers = sized("most_units")
    group: Integers = sized("most_units")
    place: Integers = sized("most_units")
    """Where the unit's first residual stands; the next ones follow at steps of LANES."""
    block: Integers = sized("most_units")
    row: Integers = sized("most_units")
    equation: Integers = sized("most_units")
    """The equation of the unit in its row."""
    first: Integers = sized("most_units + 1")
    """The first of the unit's rows among the directions."""
    inlier: Integers = sized("most_units")
    """1 for inliers."""
    medians: Reals = sized("most_units")
    cuts: Reals = sized("most_units")
    reaches: Reals = sized("most_units")
    """As `Level` says."""
    rounding: Reals = sized("most_units")
    """The squared norm that the arithmetic alone makes."""
    variances: Reals = sized("most_units")
    limits: Reals = sized("most_units")
    """Squared norms up to which they are inliers."""
    noise: Reals = sized("most_units")
    """The variance of the noise, at the end."""
    information: Reals = sized("most_units")
    """What inliers of its group inform by, at the end; `inform_units`."""
    weights: Reals = sized("most_units")
    subset: Integers = sized("most_units")
    """The size of subsets of its group: that of all, or the number of unknowns that its group depends on."""
    redundancy: Reals = sized("most_units")
    """How much of the residuals of inliers shows, the unknowns being estimated from them."""


@record
class Fit:
    """A point with its rows of ``[J r]``, column by column, and the squared norms of the units there."""

    point: Reals = sized("numbers")
    chunk: Reals = sized("chunk * (n + 1)")
    squares: Reals = sized("most_units")


@record
class ConsensusWork:
    """What one thread needs for consensus.

    The caller brings what comes before ``units``, with ``reals`` and ``integers`` of the sizes `consensus_reals` and
    `consensus_integers`, and of ``rows`` what belongs to the problem.
    """

    rules: Reference[Rules]
    levels: ConstantReals
    """A `Level` for each equation that is ruled."""
    forms: ConstantReals
    """What the closed form knows of each unit of the data set (units, form_width)."""
    starts: ConstantReals
    """(starts, N)"""
    verdict: Reference[Verdict]
    rows: Rows
    """All rows of the data set."""
    reals: Reals
    integers: Integers
    shared: Integer
    """1: the arrays here are parts of them."""

    units: Units
    subset_rows: Rows
    """The rows of a subset, as a data set of its own."""
    first: Fit
    second: Fit
    here: Reference[Fit]
    """Where a fit is."""
    there: Reference[Fit]
    """Where it tries to go."""
    objective: Real
    """What the last fit lowered."""

    size: Integer
    """Units of a subset; 0: no unit says anything at the start, `NOWHERE`: nothing gives a start."""
    rank: Integer
    """Unknowns that a subset determines."""
    spent: Integer
    """Unknowns that all units together determine: the others are told by rows that no rule acts on."""
    told: Integer
    """Unknowns that the equations among the constraints tell …"""
    left: Integer
    """… and all others."""
    held: Integer
    """1: ``bounded``, and inequalities among ``equation``, are those that hold a fit; the caller brings it."""
    trials_wanted: Integer
    trials_made: Integer
    points_made: Integer
    most_inliers: Integer
    """Units that the best of the trials explains."""
    every_subset: Integer
    """1: trials are all subsets there are, one after the other."""
    until_enough: Integer
    """1: trials end when they are enough for what the best of them explains."""
    alike: Integer
    """1: all rows are units of one noise, whose inliers tell all unknowns."""
    one_side: Integer
    """1: all stations of the spheres lie in one plane, so that solutions mirror one another: one stands for both."""

    weighted: Reals = sized("chunk * (n + 1)")
    by_row: Reals = sized("chunk")
    """Weights residual by residual."""
    ruled: Reals = sized("chunk")
    """1 for each residual that a rule acts on, else 0."""
    normal: Reals = sized("n * n")
    basis: Reals = sized("(n + 1) * n")
    step: Reals = sized("n")
    gradient: Reals = sized("n")
    scale: Reals = sized("n")
    hold: Reals = sized("n")
    coordinates: Reals = sized("n")
    threshold: Reals = sized("3")
    kept: Reals = sized("numbers")
    """A point."""
    values: Reals = sized("most_multipliers")
    slopes: Reals = sized("most_multipliers * n")
    """Of constraints, those of equations in reduced form."""
    told_step: Reals = sized("n")
    put_point: Reals = sized("numbers")
    form_scratch: Reals = sized("240")
    """120 numbers, and the rows of a subset with up to five unknowns."""
    sights: Reals = sized("most_units * form_width")
    """What the closed form knows of each unit, with lines of sight that were found from near ones."""
    directions: Reals = sized("chunk * n")
    """Rows of the Jacobian with norm 1, unit by unit (scalars, n)."""
    trials: Reals = sized("most_points * numbers")
    """Points that are scored."""
    begun: Reals = sized("(starts + 4) * numbers")
    """The starts, then room for the solutions of a closed form (4, N)."""
    objectives: Reals = sized(f"{MOST_CANDIDATES}")
    candidates: Reals = sized(f"{MOST_CANDIDATES} * numbers")
    """Points …"""
    candidate_squares: Reals = sized(f"{MOST_CANDIDATES} * most_units")
    """… and the squared norms of the units there."""
    best_scores: Reals = sized(f"{LISTS * CANDIDATES}")
    sorted: Reals = sized("most_units")
    fresh: Reals = sized("most_units")
    subset_parameters: Reals = sized("most_rows")
    subset_whitening: Reals = sized("most_rows")

    equation: Integers = sized("most_multipliers")
    """1 for constraints that are equations, or hold as if they were, 0 for inequalities."""
    bounded: Integers = sized("n")
    """1 for coordinates that stay at a bound."""
    teller: Integers = sized("most_multipliers")
    """0 for equations that tell no coordinate yet."""
    told_by: Integers = sized("n")
    """The equation that tells each coordinate, -1: none does."""
    order: Integers = sized("most_units")
    chosen: Integers = sized("n + 4")
    """The units of a subset."""
    combination: Integers = sized("n + 4")
    """The next one."""
    form_order: Integers = sized("n + 4")
    state: Integers = sized("2")
    """Of the generator, at the start of a trial …"""
    state_used: Integers = sized("2")
    """… and within it."""
    best: Integers = sized(f"{LISTS * CANDIDATES}")
    """Numbers of the best trials (LISTS, CANDIDATES) …"""
    listed: Integers = sized(f"{LISTS}")
    """… and how many there are in each list."""
    subset_data: Integers = sized(f"{DATA_HEAD} + {DATA_BLOCK} * blocks")
    """The data set of a subset."""
    subset_index: Integers = sized("most_rows")
    subset_columns: Integers = sized("most_rows")


@record
class ConsensusBatch:
    """Data sets ``first … last``, and what they agree on."""

    problem: Reference[Problem]
    """With a chunk no smaller than its residuals."""
    work: Reference[ConsensusWork]
    """The scratch of one thread."""
    first: Integer
    last: Integer
    data: ConstantIntegers
    stride: Integer
    """Integers of a data set."""
    units_at: ConstantIntegers
    """Where the units of each data set begin, in what follows."""
    forms: ConstantReals
    starts: ConstantReals
    """(data sets, starts, N)"""
    numbers: Reals
    """(data sets, N)"""
    verdicts: Integers
    """(data sets, ANSWERS)"""
    inlier: Integers
    limits: Reals
    noise: Reals
    information: Reals


def take_sizes(problem: Problem, rules: Rules) -> None:
    """The sizes of a problem among the rules."""
    rules.blocks = problem.residual_blocks + problem.constraint_blocks
    rules.numbers = problem.numbers
    rules.n = problem.n
    rules.chunk = problem.chunk
    rules.most_inputs = problem.most_inputs
    rules.most_outputs = problem.most_outputs
    rules.most_weights = problem.most_weights
    rules.most_residuals = problem.most_residuals
    rules.fused_reals = problem.fused_reals
    rules.most_multipliers = problem.most_multipliers


def consensus_reals(rules: Rules) -> Integer:
    """Reals of scratch that a thread needs."""
    return reals_in(ConsensusWork, rules)


def consensus_integers(rules: Rules) -> Integer:
    """Integers of scratch that a thread needs."""
    return integers_in(ConsensusWork, rules)


def share_out_consensus(work: ConsensusWork) -> None:
    """Let the arrays of the work be parts of its reals and integers."""
    lay_out(work, work.rules, work.reals, work.integers)
    work.here = work.first
    work.there = work.second
    subset_rows = work.subset_rows
    subset_rows.constants = work.rows.constants
    subset_rows.data = view(DataSet, work.subset_data)
    subset_rows.parameters = work.subset_parameters
    subset_rows.whitening = work.subset_whitening
    subset_rows.index = work.subset_index
    subset_rows.columns = work.subset_columns
    work.shared = 1
