"""A filter or smoother that is fed step by step: rows of a step in, its estimate out, as a solve of all rows has it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from mbm.api import faults
from mbm.api.arrivals import Arrivals
from mbm.compiler import Inputs
from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Floats
from mbm.estimation.sequences.filtering import smoothed
from mbm.estimation.sequences.limits import limits_of
from mbm.estimation.sequences.places import spread_entries
from mbm.estimation.sequences.run import Begun, begun
from mbm.estimation.sequences.stepping import StepEstimate, Stepper
from mbm.estimation.sequences.unsuited import unsuited
from mbm.estimation.settings import settings_of
from mbm.problem.bounded import refused_likelihoods
from mbm.problem.types import Problem
from mbm.report.elements import GEOMETRIC, coordinate_factors, element_names
from mbm.report.named import Named, named
from mbm.report.quantities import quantity_of
from mbm.report.spreads import Spread
from mbm.report.types import Estimate, Quantity
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """An unknown or a state within the numbers and coordinates of a step."""

    entry: Entry
    quantity: Quantity
    numbers: slice
    coordinates: slice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """What a step estimates: ``names`` (n,) of the coordinates that vary, ``factors`` (n,) SI per unit shown."""

    parts: Mapping[str, Part]
    layout: Layout
    free: np.ndarray
    names: tuple[str, ...]
    factors: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepAnswer:
    """The estimate of one step, whose ``key`` is its value of the steps' column (SI).

    ``answer[name]`` is a state or an unknown as ``result[name]`` has one: ``.value`` and ``.sigma`` in the unit of the
    report, without an axis over the steps. ``cost`` is what the rows of the step add to the cost of the filter, None of
    a smoother, whose steps come later than their rows. ``hypotheses`` are followed after the step.
    """

    key: float
    cost: float | None
    hypotheses: int
    _found: StepEstimate = field(repr=False)
    _plan: Plan = field(repr=False)

    def __getitem__(self, name: str) -> Named:
        """A state or an unknown.

        Raises:
            KeyError: nothing is called so.

        """
        part = self._plan.parts.get(name)
        if part is None:
            raise KeyError(f"`{name}` is not estimated at a step; there are {', '.join(self._plan.parts)}")
        entry, unknown = part.entry, part.entry.unknown
        leading = () if entry.keys is None or unknown.is_state else (entry.members,)
        stated = (*leading, *(unknown.shape if not unknown.dimension else (unknown.freedom,)))
        sigma = self._sigma()[part.coordinates].reshape(stated)
        return named(
            Estimate(
                quantity=part.quantity,
                value=self._plan.layout.reported(self._found.numbers)[part.numbers].reshape((*leading, *unknown.shape)),
                sigma=sigma,
                fixed=self._plan.layout.fixed[part.coordinates].reshape(stated),
                keys=entry.keys if leading else None,
                spread=Spread(dof=np.full(stated, np.inf), inflation=np.ones(stated)),
            ),
            COVERAGE,
        )

    def __iter__(self) -> Iterator[str]:
        """The names of the states and unknowns."""
        return iter(self._plan.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """The estimated coordinates (n,), in the order of `covariance`."""
        return self._plan.names

    @property
    def covariance(self) -> Floats:
        """The covariance (n, n) of the coordinates `names` in the units of the report; NaN where it is not known."""
        found = self._found
        matrix = found.factor.T @ found.factor / np.outer(self._plan.factors, self._plan.factors)
        return np.where(found.touched[:, None] | found.touched, np.nan, matrix)

    def _sigma(self) -> Floats:
        """Standard deviations of all coordinates of a step, in SI; NaN of what is fixed."""
        found = self._found
        sigma = np.full(len(self._plan.layout.fixed), np.nan)
        own = np.sqrt(np.square(found.factor).sum(axis=0))
        sigma[self._plan.free] = np.where(found.touched, np.nan, own)
        return sigma


COVERAGE = 0.95
"""Of the intervals of a step's estimates."""


class Stream:
    """A filter or smoother that takes steps as they come. Not to be shared between threads.

    It begins before the first step: no row that the problem was compiled with is used, apart from those of tables
    without steps.
    """

    def __init__(self, ready: Begun, compilation: Compilation, origin: Origin, inputs: Inputs) -> None:
        self._sequence, self._smooth = ready.sequence, ready.rules.smooth
        self._arrivals = Arrivals(ready, compilation, origin, inputs)
        self._stepper = Stepper(ready, compilation.kernels, compilation.cache)
        self._plan = _plan(ready)
        self._keys: list[float] = []
        self._ended: Diagnostic | None = None

    def __reduce__(self) -> NoReturn:
        """A copy would take steps into the same numbers as this one."""
        message = "a stream is neither pickled nor copied: `compiled.stream()` makes another, which is given the steps"
        raise TypeError(message)

    @property
    def names(self) -> tuple[str, ...]:
        """The coordinates (n,) that every step estimates."""
        return self._plan.names

    def step(self, tables: Mapping[str, object] | None = None, *, at: float | None = None) -> StepAnswer | None:
        """Take the rows of the next step, and give its estimate.

        Args:
            tables: the rows of each table that has some, as `compiled.solve(data=…)` takes them; numbers alone are one
                row. Rows may leave out the steps' column where ``at`` says it.
            at: the value of the steps' column (SI). Without rows it makes a step that is predicted.

        Returns:
            The estimate of this step, by a smoother of all steps given all rows so far; of a smoother of lag n that of
            the step n before, None while there is none.

        Raises:
            MbmError: the rows do not go with the problem, or are not those of one step that follows on the last; the
                step is not taken then. Or something is not finite at the step; then the stream is at its end.

        """
        if self._ended is not None:
            raise MbmError(self._ended)
        key, arrived = self._arrivals.read(tables, at, self._keys[-1] if self._keys else None)
        found = self._stepper.take(arrived)
        if self._stepper.failed:
            self._ended = faults.stream_stopped(self._sequence.column, key)
            raise MbmError(self._ended)
        self._keys.append(key)
        return None if found is None else self._answer(found, self._keys[-1 - self._stepper.lag])

    def last(self, steps: int) -> list[StepAnswer]:
        """The estimates of so many last steps, or of all there are, given all rows so far, by a smoother of all steps.

        Raises:
            MbmError: the method is another, or something is not finite; then the stream is at its end.

        """
        if self._ended is not None:
            raise MbmError(self._ended)
        if not self._stepper.growing:
            raise MbmError(faults.gives_steps_once())
        return self._answers(self._stepper.given_all(steps))

    def finish(self) -> list[StepAnswer]:
        """The estimates of the steps that a smoother has not given yet, given all rows; no step can come then.

        A smoother of all steps gives all of them.

        Raises:
            MbmError: something is not finite at one of them.

        """
        if self._ended is not None:
            return []
        found = self._answers(self._stepper.finish())
        self._ended = faults.stream_finished()
        return found

    def _answers(self, found: list[StepEstimate]) -> list[StepAnswer]:
        """Those of the last steps."""
        if self._stepper.failed:
            self._ended = faults.stream_stopped(self._sequence.column, self._keys[-1])
            raise MbmError(self._ended)
        keys = self._keys[len(self._keys) - len(found) :]
        return [self._answer(each, key) for each, key in zip(found, keys, strict=True)]

    def _answer(self, found: StepEstimate, key: float) -> StepAnswer:
        return StepAnswer(
            key=key,
            cost=None if self._smooth else found.cost,
            hypotheses=found.followed,
            _found=found,
            _plan=self._plan,
        )


def stream(compilation: Compilation, origin: Origin, inputs: Inputs) -> Stream:
    """The stream of a compiled problem.

    Raises:
        MbmError: it has no states, needs all steps at once, or asks for several solves; its data do not go with it.

    """
    found = compilation.elaborated
    problem = smoothed(found.problem, "a stream", "let `solve` with `:method batch` have all rows at once")
    _one_sequence(problem)
    starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    settings = settings_of(problem.request, forms=origin.registry.closed_forms)
    ready = begun(problem, compilation.kernels, found.tables, starts, settings, compilation.cache)
    for what in unsuited(ready):
        raise MbmError(faults.no_stream(what, "`solve` has all rows at once"))
    if ready.sequence.estimator.whole:
        for limit, _ in limits_of(problem, ready.equations):
            hint = "say `(solve :method truncated-ekf)`, which meets them at each step, or leave them out"
            raise MbmError(faults.no_stream(f"for all steps with {limit},", hint))
    return Stream(ready, compilation, origin, inputs)


def _one_sequence(problem: Problem) -> None:
    """Refuse what has no steps that follow one on the other."""
    request, sequence = problem.request, problem.sequence
    if sequence is None:
        raise MbmError(faults.no_stream("without `states`", "`compiled.estimator()` takes streams of data sets"))
    asked = {"`for-each`": request.for_each, "`window`": request.window}
    for what, stated in asked.items():
        if stated:
            raise MbmError(faults.no_stream(f"with {what}", "compile it without, and take a stream for each key"))
    if any(constant.sigmas for constant in problem.constants):
        raise MbmError(faults.no_stream("with uncertain constants", "`solve` varies them"))
    if refused := tuple(refused_likelihoods(problem, streaming=True)):
        raise MbmError(*refused)


def _plan(ready: Begun) -> Plan:
    """What the steps of a problem estimate."""
    problem, places = ready.problem, ready.places
    parts: dict[str, Part] = {}
    names: list[str] = []
    factors: list[Floats] = []
    numbers = coordinates = 0
    for entry in spread_entries(ready.equations.layout):
        unknown, quantity = entry.unknown, replace(quantity_of(problem, entry.unknown), over=None)
        members = 1 if unknown.is_state else entry.members
        count, size = members * unknown.size, members * unknown.freedom
        parts[unknown.name] = Part(
            entry=entry,
            quantity=quantity,
            numbers=slice(numbers, numbers + count),
            coordinates=slice(coordinates, coordinates + size),
        )
        numbers, coordinates = numbers + count, coordinates + size
        names += element_names(quantity, None if unknown.is_state else entry.keys)
        own = quantity.kind in GEOMETRIC
        one = coordinate_factors(quantity) if own else np.full(unknown.freedom, quantity.scale.factor)
        factors.append(np.tile(one, members))
    free = places.free
    return Plan(
        parts=parts,
        layout=ready.chained.seen.equations.layout,
        free=free,
        names=tuple(names[j] for j in free.tolist()),
        factors=np.concatenate(factors)[free],
    )
