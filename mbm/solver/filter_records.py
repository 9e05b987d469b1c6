"""The rows of one step, or of one transition, as lines of ``[J r]``."""

from __future__ import annotations

from mbm.machine.kinds import LANES
from mbm.machine.records import Reference, integers_in, lay_out, reals_in, record, sized, view
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals, distinct_arrays
from mbm.solver.description import DATA_BLOCK, DATA_HEAD, NO_LOSS, Block, DataSet, Problem
from mbm.solver.equations import cost_at_point, gather, groups_of, load_rows, portion, residuals_at_point, weights_width
from mbm.solver.linear_algebra import copied, dot
from mbm.solver.sweeps import slope_portion
from mbm.solver.workspace import Rows


@record
class Chain:
    """The sizes of a sequence."""

    steps: Integer
    """T."""
    n: Integer
    """Free coordinates of a step."""
    still: Integer
    """Those that do not move among them, s; p = n − s do …"""
    plain: Integer
    """… and of these those of plain unknowns."""
    numbers: Integer
    """Numbers of a step, N …"""
    still_numbers: Integer
    """… and those that do not move among them."""
    noises: Integer
    """Columns of the noise of a transition, q."""
    lines: Integer
    """Most scalar rows of a step, those of inequalities included, at least n + q + 1."""
    limits: Integer
    """Most scalar constraints in a block of a step, at least 1."""
    affine: Integer
    """1: transitions are affine in everything."""
    linear: Integer
    """1: transitions and rows are."""
    iterations: Integer
    """Most iterations of an update, or of a smoother; 1: an update is linearised once, where it was predicted."""
    begin: Integer
    """The first step with rows: bounds of plain unknowns cut there only."""
    cut: Integer
    """1: inequalities and bounds cut the distribution after each update."""
    cuts: Integer
    """Most scalar inequalities of a step that a smoother has rows for, two bounds of each coordinate included; or 0."""
    kept: Integer
    """Steps whose policies are kept: T for a smoother, the lag and 2 more for one of fixed lag, else 1."""
    remembered: Integer
    """Steps whose priors are kept: as many as `kept` for a smoother of all steps that come one by one, else 0."""
    hypotheses: Integer
    """Most hypotheses that are followed."""
    lag: Integer
    """Steps after which a step is reported by a smoother of fixed lag; T: it is none."""
    constants: Integer
    """Constants of the rows of a step, 0 where they have no loss."""
    rivals: Integer
    """1: a loss of theirs has minima of its own."""
    pools: Integer
    """Units of these rows with a loss, whose covariances are those of the sandwich; 0: they are not."""
    held: Integer
    """Steps whose rows and answers there is room for: step k is at ``k % held``. T, or fewer where steps come singly,
    in which case T is larger than any step."""


@record
class Walk:
    """A walk over the steps of a sequence. ``reals`` and ``integers`` are as `walk_reals` and `walk_integers` say."""

    chain: Reference[Chain]
    seen: Reference[Problem]
    rows: Reference[Rows]
    rows_reals: Reals
    seen_data: ConstantIntegers
    moving: Reference[Problem]
    moves: Reference[Rows]
    moves_reals: Reals
    moves_data: ConstantIntegers
    spreads: ConstantReals
    """L of each transition (T − 1, p, q), of those that are held."""
    skip: Real
    """Deviations beyond which a cut is left out."""
    tolerance: Real
    """Steps shorter than this, in standard deviations, end an iteration."""
    reals: Reals
    integers: Integers

    points: Reals
    """(T, N) the answer for each step that is held …"""
    factors: Reals
    """… (T, n, n), of its covariance …"""
    opens: Integers
    """… (T,) how many open vectors there are, …"""
    touched: Integers
    """… (T, n) 1 for coordinates that they touch …"""
    costs: Reals
    """… (T,) and what its rows add to the cost."""

    point: Reals = sized("numbers")
    """Where the walk is: the mean of a step …"""
    factor: Reals = sized("n * n")
    """… and the factor of its covariance."""
    open_count: Integer
    open: Reals = sized("n * n")
    """The open vectors, one to a line."""
    failed: Integer
    """0; else 1 + the step where something was not finite, or a transition did not lead anywhere."""
    last_cost: Real
    last_equations: Integer
    """How many equations among the constraints of the step have told something that was not known …"""
    equations: Integer
    """… and of all steps so far."""
    iterations: Integer
    evaluations: Integer
    settled: Integer
    """1: the iteration has ended where the cost is least."""
    stretched: Integer
    """1: its last step was longer than a whole one."""
    vertex: Real
    """The part of a step at which the cost was least on the way of the last one that told."""

    spread: ConstantReals
    """L of the transition that is loaded."""
    ahead: Reals = sized("numbers")
    """The step reached."""
    pair: Reals = sized("numbers + numbers")
    """Numbers of a transition."""
    noise: Reals = sized("noises")
    """The noise w (q,) of a transition."""
    system: Reals = sized("n * (2 * n + 2 + noises)")
    carry: Reals
    """How the state reached varies with the step before (p, n) …"""
    push: Reals
    """… and with the noise (p, q), of the transition at hand: one of …"""
    carries: Reals = sized("(kept + 1) * n * n")
    """… those of a smoother's path, from step k at ``k % kept``, and …"""
    pushes: Reals = sized("(kept + 1) * n * noises")
    """… of any other one behind them."""
    move_lines: Reals = sized("n * (2 * n + 1)")

    jacobian: Reals = sized("lines * (n + 1)")
    """Rows of ``[J r]`` of a step, one behind the other."""
    chunk: Reals = sized("lines * (2 * n + noises + 1)")
    """Rows to go into a triangle, column by column."""
    triangle: Reals = sized("(2 * n + noises + 1) * (2 * n + noises + 1)")
    square: Reals = sized("4 * n * n")
    basis: Reals = sized("2 * n * n")
    """The vectors that an update combines: open ones that the rows determine, then those of the factor …"""
    local: Reals = sized("2 * n * n")
    """… about the point of the iteration."""
    share: Reals = sized("2 * n")
    """Their coefficients …"""
    wanted: Reals = sized("2 * n")
    """… and those that an iteration steps to."""
    rival: Reals = sized("2 * n")
    """Those of another minimum of the cost."""
    stated: ConstantReals
    """The constants of the rows of a step …"""
    widened: Reals = sized("constants")
    """… and with losses that are wider."""
    pools: Reals = sized("pools * 7")
    """Sums over the rows so far of each loss, as `filter_losses` has them, …"""
    counted: Integer
    """Steps of a window that moves on whose rows are in them."""
    sums: Reals = sized("pools * 7")
    """… with the rows at hand, too …"""
    owners: Integers = sized("lines")
    """… and whose sums each line of these counts for."""
    curvatures: Reals = sized("pools")
    """The factors of each loss in H …"""
    variances: Reals = sized("pools")
    """… and in G."""
    errors: Reals = sized("pools * n * n")
    """The factor of the covariance of a step that losses leave, where `factor` is that by which the step is weighed."""
    base_errors: Reals = sized("pools * n * n")
    """The same of `base_factor`."""
    scores: Reals = sized("pools * (lines + n) * n")
    """The triangle (n, n) of G, and rows that go into it."""
    newest: Reals = sized("numbers")
    """Where a smoother's path begins at the step that comes in."""
    mean: Reals = sized("numbers")
    """The point that they are counted from."""
    trial: Reals = sized("numbers")
    step: Reals = sized("2 * n")
    along: Reals = sized("2 * n")
    singular_step: Reals = sized("2 * n")
    singular: Reals = sized("n")
    axes: Reals = sized("n * n")
    turn: Reals = sized("18")
    path: Reals = sized("kept * numbers")
    """The points of a smoother's steps, k at ``k % kept`` …"""
    path_tried: Reals = sized("kept * numbers")
    path_kept: Reals = sized("rivals * kept * numbers")
    """… and those to which it may go back, …"""
    noises: Reals = sized("kept * noises")
    """… the noise of the transitions that lead from them, in standard deviations, …"""
    noises_tried: Reals = sized("kept * noises")
    gains: Reals = sized("kept * noises * (n + 1)")
    """… how the best noise varies with the step (q, n), and its own part, …"""
    roots: Reals = sized("kept * noises * noises")
    """… and the inverse triangle of the noise, given the step."""
    future: Reals = sized("(n + 1) * (n + 1)")
    """What the rows of a step and of all those behind it say about it: a triangle of ``[J r]``."""
    base_mean: Reals = sized("numbers")
    """The prior of the first step of a smoother: its mean, …"""
    base_factor: Reals = sized("n * n")
    """… its factor, …"""
    base_step: Reals = sized("n")
    """… the step that leads from there to where the path begins …"""
    base_share: Reals = sized("n")
    """… and the coefficients of the factor in it."""
    base_wanted: Reals = sized("2 * n")
    """What to add to these, after those of open vectors that the rows determine."""
    base_step_tried: Reals = sized("n")
    base_share_tried: Reals = sized("n")
    promise: Real
    """What a whole step promises to lower the cost by."""
    prior_means: Reals = sized("remembered * numbers")
    """The priors of steps, of all rows before them: means, …"""
    prior_factors: Reals = sized("remembered * n * n")
    """… factors, …"""
    prior_opens: Reals = sized("remembered * n * n")
    """… and the open vectors, zeros behind them."""
    base: Integer
    """The step where the window of a smoother begins …"""
    next_base: Integer
    """… and the one where that of the next step is to."""
    left_cost: Real
    """What the steps add to the cost that have left it."""
    unsettled: Integer
    """How often a window did not end where its cost is least."""
    free: Integer
    """Open vectors that the rows of a window determine."""
    loose: Integer
    """1: the path does not begin at the prior, nor does it follow the transitions: the next step closes the gaps."""
    rates: ConstantIntegers
    """Of each coordinate (n,) that of its rate, -1: there is none; -2: it is a rate itself."""
    followed: Integers
    """(T,) how many hypotheses there are after each step."""
    crowd: Integer
    """How many there are now …"""
    crowd_points: Reals = sized("3 * hypotheses * numbers")
    """… their means, those of least cost first; behind ``hypotheses`` of them those that a step makes, …"""
    crowd_factors: Reals = sized("3 * hypotheses * n * n")
    """… factors, …"""
    crowd_costs: Reals = sized("3 * hypotheses")
    """… costs, and how far they violate a constraint, in deviations."""
    crowd_violations: Reals = sized("3 * hypotheses")
    crowd_taken: Integers = sized("3 * hypotheses")
    way: Reals = sized("n")
    """A direction along which rows may say nothing, as long as a standard deviation."""
    way_slopes: Reals = sized("4 * lines")
    mirror_point: Reals = sized("numbers")
    """The mirrored continuation …"""
    mirror_factor: Reals = sized("n * n")
    """… with its factor."""
    cuts: Reals = sized("2 * kept * cuts")
    """The rows that stand for the inequalities of each step: precision, and precision times mean, of the value …"""
    cut_values: Reals = sized("cuts")
    """… which these are at a point, …"""
    cut_slopes: Reals = sized("cuts * n")
    """… with their slopes (cuts, n)."""
    still_slopes: Reals = sized("cuts * n")
    """Slopes (cuts, n) of different inequalities of what does not move, …"""
    still_limits: Reals = sized("3 * cuts")
    """… their values at the step where they are cut, and the limits low and high, from there, of all steps …"""
    still_owners: Integers = sized("cuts")
    """… and which of all cuts that is; below 0: there is no more."""
    limit_values: Reals = sized("limits")
    limit_slopes: Reals = sized("limits * n")


def walk_reals(chain: Chain) -> Integer:
    """Reals of scratch of a walk."""
    return reals_in(Walk, chain)


def walk_integers(chain: Chain) -> Integer:
    """Integers of scratch likewise."""
    return integers_in(Walk, chain)


def hold_move(walk: Walk, place: Integer) -> None:
    """Let `carry` and `push` be those at a place."""
    chain = walk.chain
    walk.carry = walk.carries[place * chain.n * chain.n :]
    walk.push = walk.pushes[place * chain.n * chain.noises :]


def share_out_walk(walk: Walk) -> None:
    """Let the arrays of a walk, and of the rows that it takes, be parts of those that it was given."""
    lay_out(walk, walk.chain, walk.reals, walk.integers)
    lay_out(walk.rows, walk.seen, walk.rows_reals, walk.integers)
    lay_out(walk.moves, walk.moving, walk.moves_reals, walk.integers)
    walk.stated = walk.rows.constants
    hold_move(walk, walk.chain.kept)


def load_step(walk: Walk, k: Integer) -> None:
    """The rows of step k."""
    stride = DATA_HEAD + DATA_BLOCK * (walk.seen.residual_blocks + walk.seen.constraint_blocks)
    walk.rows.data = view(DataSet, walk.seen_data[k % walk.chain.held * stride :])
    load_rows(walk.seen, walk.rows)


def load_move(walk: Walk, k: Integer) -> None:
    """Those of the transition from step k."""
    stride = DATA_HEAD + DATA_BLOCK * (walk.moving.residual_blocks + walk.moving.constraint_blocks)
    place = k % walk.chain.held
    walk.moves.data = view(DataSet, walk.moves_data[place * stride :])
    walk.spread = walk.spreads[place * (walk.chain.n - walk.chain.still) * walk.chain.noises :]
    load_rows(walk.moving, walk.moves)


@distinct_arrays
def take_lines(
    problem: Problem, block: Block, groups: Integer, rows: Integer, chunk: ConstantReals, target: Reals
) -> None:
    """``rows`` rows of a portion of a chunk, line by line."""
    width = problem.n + 1
    stride = problem.chunk
    lines = block.outputs
    for group in range(groups):
        for lane in range(LANES):
            row = group * LANES + lane
            if row < rows:
                for i in range(lines):
                    place = (group * lines + i) * LANES + lane
                    for column in range(width):
                        target[(row * lines + i) * width + column] = chunk[column * stride + place]


def whitened_lines(problem: Problem, rows: Rows, point: ConstantReals, target: Reals) -> Integer:
    """The whitened rows at a point, with losses, as lines (…, n + 1) of ``[J r]``; how many there are."""
    inputs = 0
    whitening = 0
    done = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        count = part.rows
        width = (block.variables + block.parameters) * LANES
        heavy = weights_width(block) * LANES
        gather(block, count, rows.index[part.index :], point, rows.inputs[inputs:])
        first = 0
        while first < groups_of(count):
            groups = portion(problem, block)
            if first + groups > groups_of(count):
                groups = groups_of(count) - first
            given = rows.inputs[inputs + first * width :]
            weights = rows.weights[whitening + first * heavy :]
            slope_portion(problem, b, first, groups, rows, given, weights, rows.chunk)
            own = count - first * LANES
            if own > groups * LANES:
                own = groups * LANES
            take_lines(problem, block, groups, own, rows.chunk, target[done * (problem.n + 1) :])
            done += own * block.outputs
            first += groups
        inputs += groups_of(count) * width
        whitening += groups_of(count) * heavy
    return done


def step_lines(walk: Walk, point: ConstantReals) -> Integer:
    """Those of the step whose rows are loaded."""
    return whitened_lines(walk.seen, walk.rows, point, walk.jacobian)


def step_cost(walk: Walk, point: ConstantReals) -> Real:
    """What these rows add to the cost at a point, losses included."""
    walk.evaluations += 1
    return cost_at_point(walk.seen, walk.rows, point, 1, 0, walk.rows.residuals)


def plain_step_cost(walk: Walk, point: ConstantReals) -> Real:
    """The same without losses."""
    count = residuals_at_point(walk.seen, walk.rows, point, 0, 0, walk.rows.residuals)
    return dot(count, walk.rows.residuals, walk.rows.residuals)


def widen_losses(walk: Walk, factor: Real) -> None:
    """Let the losses of the rows begin to count less at so many times the residuals as stated."""
    problem = walk.seen
    copied(walk.chain.constants, walk.stated, walk.widened)
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            unit = block.units[u]
            if unit.loss != NO_LOSS:
                walk.widened[unit.loss_at] = factor * walk.stated[unit.loss_at]
    walk.rows.constants = walk.widened
