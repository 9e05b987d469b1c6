"""Filters and smoothers in native code: a sequence as `mbm.solver.filter_records` describes it, walked over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import loss_lines
from mbm.equations.types import Floats, Indices
from mbm.estimation.minimise.native.system import NativeSystem, never
from mbm.estimation.sequences.local import Local
from mbm.estimation.sequences.types import Hypothesis, Prior, Rules, Track
from mbm.machine.kinds import Held
from mbm.machine.records import plans_of, put, reals_in, slot, slots_of, view
from mbm.solver import description as of
from mbm.solver.filter_records import Chain, Walk, walk_integers, walk_reals
from mbm.solver.workspace import Rows
from mbm.values import dataclass

PRODUCTS, PASSES = 20.0, 10.0
"""Products in a step, in units of the third power of its coordinates, and iterations where there are some: guesses."""

ENDLESS = 2**62
"""Steps of a sequence that goes on."""

STEPS_OF_A_STREAM, STEPS_AT_A_TIME = 5_000, 1000
"""Those that come, as a guess; those between which the user may interrupt."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chained:
    """The local problems of a sequence: rows of a step, and transitions, from each step to the next.

    ``still`` coordinates and ``still_numbers`` numbers of a step do not move, and come first; the first ``plain``
    coordinates are those of plain unknowns. ``spreads`` (T − 1, p, q) has L of each transition, whose p rows equal
    ``L w`` for a standard normal w. ``begin`` is the first step with rows. ``rates`` (n,)
    gives the coordinate of the rate of each, -1 where there is none, -2 of rates.
    """

    seen: Local
    moving: Local
    still: int
    still_numbers: int
    plain: int
    spreads: Floats
    rates: Indices
    begin: int = 0

    @property
    def steps(self) -> int:
        """T."""
        return self.seen.steps

    @property
    def linear(self) -> bool:
        """Whether rows and transitions are affine in everything."""
        return self.seen.linear and self.moving.linear

    @property
    def lossy(self) -> bool:
        """Whether some rows have a loss."""
        return self.seen.equations.lossy

    def walk(self, prior: Prior, rules: Rules, stopped: Callable[[], bool] = never) -> Track:
        """Over all steps.

        Raises:
            Exception: what a function in Python raised that an equation calls.

        """
        return Memory(self, prior, rules).walked(stopped)


class Memory:
    """The records of one walk, and the arrays that they refer to. Not to be shared between threads."""

    def __init__(self, chained: Chained, prior: Prior, rules: Rules) -> None:
        seen, moving = chained.seen.native, chained.moving.native
        self._code = seen.code
        self._chained, self._prior, self._rules = chained, prior, rules
        self._failed = (seen.failed, moving.failed)
        self.chain = chain_of(chained, rules)
        n, steps, numbers = (int(self.chain[at]) for at in (Chain.n, Chain.held, Chain.numbers))
        passes = 1.0 if self.chain[Chain.iterations] == 1 else PASSES
        self.points = np.full((steps, numbers), np.nan)
        self.factors = np.zeros((steps, n, n))
        self.costs = np.zeros(steps)
        self.opens = np.zeros(steps, dtype=np.int64)
        self.followed = np.ones(steps, dtype=np.int64)
        self.touched = np.zeros((steps, n), dtype=np.int64)
        products = (n + 4) ** 3 * PRODUCTS * (3.0 if rules.smooth else 1.0) * passes
        self._code.expect((STEPS_OF_A_STREAM if rules.endless else steps) * products)
        self._held: list[Any] = [seen, moving, chained]
        self.walk = self._code.blank(Walk)
        sizes = view(Chain, self.chain)
        integers = np.zeros(walk_integers(sizes) + 1, dtype=np.int64)
        self._total = walk_reals(sizes)
        self._put(reals=np.zeros(self._total), integers=integers, chain=self.chain)
        self._put(followed=self.followed, rates=np.ascontiguousarray(chained.rates, dtype=np.int64))
        self._put(spreads=np.ascontiguousarray(chained.spreads, dtype=np.float64))
        self._put(points=self.points, factors=self.factors, costs=self.costs, opens=self.opens, touched=self.touched)
        self._rows("rows", "rows_reals", "seen", "seen_data", seen)
        self._rows("moves", "moves_reals", "moving", "moves_data", moving)
        self._set_reals(skip=rules.skip, tolerance=rules.tolerance)
        self.routine("begin_walk")
        self._starts = self._begins()
        self._set_prior()

    def go_on_from(self, other: Memory) -> None:
        """Let this be where another walk is, of the same steps with room for other rows, or for steps behind them."""
        names = list(self._starts)
        for name, after in zip(names, (*names[1:], None), strict=True):
            count = min(
                each.size_of(name, after) for each in (self, other)
            )  # what is left holds rows, which do not last
            self._fill(name, other._taken(name, count))
        for plan in plans_of(Walk):
            if plan.held is Held.VALUE and plan.text == "Integer":
                self._put(**{plan.name: other._get(plan.name)})
            elif plan.held is Held.VALUE and plan.text == "Real":
                self._set_reals(**{plan.name: other._real(plan.name)})
        for name in ("points", "factors", "costs", "opens", "followed", "touched"):
            getattr(self, name)[: len(getattr(other, name))] = getattr(other, name)
        self.chain[Chain.begin] = other.chain[Chain.begin]

    def end_at(self, tolerance: float) -> None:
        """Let steps shorter than this, in standard deviations, end an iteration."""
        self._set_reals(tolerance=tolerance)

    def size_of(self, name: str, after: str | None) -> int:
        """Numbers of an array of the walk, ``after`` which another one stands."""
        return (self._total if after is None else self._starts[after]) - self._starts[name]

    def _begins(self) -> dict[str, int]:
        """Where the arrays of the walk begin in that of all."""
        names = [p.name for p in plans_of(Walk) if p.held is Held.SIZED and p.text == "Reals"]
        return {name: self._total - len(self._array(name)) for name in names}

    def walked(self, stopped: Callable[[], bool]) -> Track:
        """`run`, with the covariances that losses leave."""
        chained, rules, track = self._chained, self._rules, self.run(stopped)
        if rules.cut or rules.lag is not None or not (chained.lossy and rules.smooth and track.settled):
            return track
        from mbm.estimation.sequences.losses import sandwiched  # loaded by problems with losses only

        return replace(track, factors=sandwiched(chained.seen, track.points, self.spread_along, track.factors))

    def run(self, stopped: Callable[[], bool]) -> Track:
        """All steps, so many at a time; what is smoothed as a whole begins with the path of a filter."""
        steps = len(self.points)
        whole = self._rules.smooth and self._rules.lag is None
        if whole and self.chain[Chain.linear] and not self._rules.cut:
            self.points[:] = self._prior.point
            made = steps
        else:
            made = self._steps("lag_steps" if self._rules.smooth and not whole else "filter_steps", stopped)
        fitting = made == steps
        if whole and made == steps:
            made, fitting = self._smoothed(stopped)
        self.raise_failure()
        whole_cost = self._real("left_cost") + self._real("last_cost")
        cost = whole_cost if self._rules.smooth else float(self.costs[:made].sum())
        return Track(
            points=self.points,
            factors=self.factors,
            opens=self.opens,
            touched=self.touched != 0,
            followed=self.followed,
            crowd=self._crowd(),
            costs=self.costs,
            cost=cost,
            made=made,
            failed=bool(self._get("failed")),
            settled=fitting and bool(self._get("settled")) and not self._get("unsettled"),
            equations=self._get("equations"),
            iterations=self._get("iterations"),
            evaluations=self._get("evaluations"),
        )

    def carried(self, count: int) -> Prior:
        """After a run the prior of the step so many behind the first, by the rows before it, along the path."""
        self._set_prior()
        self.routine("carry_on", count)
        n, numbers = int(self.chain[Chain.n]), int(self.chain[Chain.numbers])
        left = self._get("open_count")
        return Prior(
            point=self._taken("point", numbers),
            factor=self._taken("factor", n * n).reshape(n, n),
            open=self._taken("open", left * n).reshape(left, n),
        )

    def _smoothed(self, stopped: Callable[[], bool]) -> tuple[int, bool]:
        """Steps that are made of all at once from where `points` are, and whether cuts, if any cut, fit one another."""
        steps, fitting = len(self.points), not self._rules.cut
        self._set_prior()
        made = self.routine("smooth_all")
        for _ in range(self._rules.sweeps):
            if fitting or made < steps or stopped():
                break
            fitting = self.routine("renew_cuts") == 1
            if not fitting:
                self._set_prior()
                made = self.routine("smooth_all")
        return made, fitting

    def spread_along(self, seen: Local) -> Floats:
        """Factors (T, n, n) of covariances along the path with other rows of a step ``seen``; NaN: there are none."""
        other = Memory(replace(self._chained, seen=seen), self._prior, self._rules)
        for name, size in (("path", Chain.numbers), ("noises", Chain.noises)):
            other._fill(name, self._taken(name, len(self.points) * int(self.chain[size])))
        return other.factors if other.routine("spread_along") == 1 else np.full(self.factors.shape, np.nan)

    def raise_failure(self) -> None:
        """Raise what a function in Python raised that an equation calls, if one did."""
        for each in self._failed:
            each()

    def _crowd(self) -> tuple[Hypothesis, ...]:
        """The hypotheses after the last step; none where only one may be followed."""
        if self._rules.hypotheses == 1:
            return ()
        count = self._get("crowd")
        n, numbers = int(self.chain[Chain.n]), int(self.chain[Chain.numbers])
        points = self._taken("crowd_points", count * numbers).reshape(count, numbers)
        factors = self._taken("crowd_factors", count * n * n).reshape(count, n, n)
        costs = self._taken("crowd_costs", count)
        return tuple(
            Hypothesis(point=p, factor=f, cost=float(c)) for p, f, c in zip(points, factors, costs, strict=True)
        )

    def _steps(self, routine: str, stopped: Callable[[], bool]) -> int:
        made, steps = 0, len(self.points)
        while made < steps and not stopped() and not self._get("failed"):
            made += self.routine(routine, made, min(made + STEPS_AT_A_TIME, steps))
        return made

    def _set_prior(self) -> None:
        self._fill("point", self._prior.point)
        self._fill("factor", self._prior.factor)
        self._fill("open", self._prior.open)
        self._put(open_count=len(self._prior.open))

    def _rows(self, rows: str, reals: str, problem: str, data: str, native: NativeSystem) -> None:
        memory = self._code.blank(Rows)
        native.hand(memory)
        sizes = view(of.Problem, native.system)
        self._held.append(memory)
        given = {rows: memory, reals: np.zeros(reals_in(Rows, sizes)), problem: native.system, data: native.rows.data}
        self._put(**given)

    def _put(self, **values: Any) -> None:
        self._held.append(values)
        put(self.walk, Walk, **values)

    def _set_reals(self, **values: float) -> None:
        for name, value in values.items():
            if isinstance(self.walk, np.ndarray):
                self.walk.view(np.float64)[slot(Walk, name)] = value
            else:
                setattr(self.walk, name, value)

    def _get(self, name: str) -> int:
        return int(self.walk[slot(Walk, name)] if isinstance(self.walk, np.ndarray) else getattr(self.walk, name))

    def _real(self, name: str) -> float:
        memory = self.walk
        return float(
            memory.view(np.float64)[slot(Walk, name)] if isinstance(memory, np.ndarray) else getattr(memory, name)
        )

    def _fill(self, name: str, values: NDArray[Any]) -> None:
        """Numbers into an array of the walk."""
        flat = np.ascontiguousarray(values, dtype=np.float64).ravel()
        self._array(name)[: len(flat)] = flat

    def _taken(self, name: str, count: int) -> Floats:
        """The first numbers of an array of the walk."""
        return np.array(self._array(name)[:count])

    def _array(self, name: str) -> Floats:
        """An array of the walk, and what stands behind it."""
        if not isinstance(self.walk, np.ndarray):
            return np.asarray(getattr(self.walk, name))
        reals = next(held["reals"] for held in self._held if isinstance(held, dict) and "reals" in held)
        return np.asarray(reals[(int(self.walk[slot(Walk, name)]) - reals.ctypes.data) // 8 :])

    def routine(self, name: str, *numbers: int) -> int:
        """What a routine of the walk gives for some numbers."""
        kinds = (object, *(int for _ in numbers))
        return self._code.routine(name, *kinds)(self.walk, *numbers)


def chain_of(chained: Chained, rules: Rules) -> Indices:
    """`Chain` of a sequence."""
    seen, moving = chained.seen, chained.moving
    n, lossy = seen.equations.dimension, chained.lossy
    apart = lossy and not rules.cut and rules.hypotheses == 1 and not (rules.smooth and rules.lag is None)
    steps = chained.steps
    cuts = 2 * n + seen.most_constraints if rules.cut and rules.smooth else 0
    lines = int(seen.residuals.max(initial=0)) + cuts
    lag = steps if rules.lag is None else min(rules.lag, steps)
    kept = 1 if not rules.smooth else steps if rules.lag is None else lag + 2
    values = {
        "steps": ENDLESS if rules.endless else steps,
        "n": n,
        "still": chained.still,
        "numbers": len(seen.equations.layout.start),
        "still_numbers": chained.still_numbers,
        "plain": chained.plain,
        "noises": chained.spreads.shape[2],
        "lines": max(lines, n + chained.spreads.shape[2] + 1),
        "limits": seen.limits,
        "affine": int(moving.linear),
        "linear": int(chained.linear),
        "iterations": 1 if chained.linear else rules.iterations,
        "begin": chained.begin,
        "cut": int(rules.cut),
        "cuts": cuts,
        "kept": kept,
        "remembered": steps if rules.endless and rules.smooth and rules.lag is None else 0,
        "lag": lag,
        "held": steps,
        "hypotheses": rules.hypotheses,
        "constants": len(seen.native.constants) if lossy else 0,
        "rivals": int(not all(loss.convex for loss, _ in loss_lines(seen.equations))),
        "pools": sum(len(group.losses) for group in seen.equations.groups) if apart else 0,
    }
    found = np.zeros(slots_of(Chain), dtype=np.int64)
    for name, value in values.items():
        found[slot(Chain, name)] = value
    return found
