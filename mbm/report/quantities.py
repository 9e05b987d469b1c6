"""Unknowns and derived quantities → how they are shown: their units, and the names of their numbers. Derived
quantities of a solution as reports hold them, and why values or standard deviations are missing.

What a solution knows of the standard deviations that it reports, for their intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.layout import Entry, half_turns
from mbm.equations.spreads import Followed, Moved
from mbm.equations.types import NoiseState, Reason
from mbm.estimation.search.solution import DerivedSolution, Solution, no_profiles
from mbm.estimation.uncertainty.observability import limited
from mbm.expression.units import Dimension, Unit
from mbm.problem.tables import Table
from mbm.problem.types import Derived, Problem, Unknown, UnknownKind
from mbm.report.elements import GEOMETRIC, coordinate_factors, element_names
from mbm.report.spreads import Ends, Released, Spread
from mbm.report.types import DerivedValue, Floats, Key, Kind, Mask, Quantity
from mbm.scales import SI, Scale
from mbm.values import dataclass, replace

UNIT_ONE = "1"
"""`:unit 1` says of an unknown that it is a pure number; nobody wants to read it beside the value."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """How all that a solution estimates is shown: unknowns and derived quantities in their order.

    ``names`` (M,) are those of all coordinates of all unknowns, ``factors`` (M,) SI per unit shown of differences.
    """

    unknowns: tuple[Quantity, ...]
    derived: tuple[Quantity, ...]
    names: tuple[str, ...]
    factors: Floats


def shown(problem: Problem, solution: Solution) -> Shown:
    """How the estimates of a solution are shown."""
    entries = solution.layout.entries
    unknowns = tuple(quantity_of(problem, entry.unknown) for entry in entries)
    pairs = tuple(zip(entries, unknowns, strict=True))
    return Shown(
        unknowns=unknowns,
        derived=tuple(derived_quantity(problem, problem.derived[one.owner]) for one in solution.derived),
        names=tuple(name for entry, quantity in pairs for name in element_names(quantity, entry.keys)),
        factors=np.concatenate([np.empty(0), *(entry_factors(quantity, entry) for entry, quantity in pairs)]),
    )


def quantity_of(problem: Problem, unknown: Unknown) -> Quantity:
    """How an unknown is shown."""
    unit, scale = _unit(unknown.unit, unknown.kind is UnknownKind.ANGLE, problem, unknown.name, _united(unknown))
    if unknown.unit is None and unit is not None and _is_rate_of_angle(problem, unknown):
        unit = f"rad/{unit.removesuffix('^-1')}" if unit.endswith("^-1") else f"rad*{unit}" if unit else "rad"
    return Quantity(
        name=unknown.name,
        kind=Kind(unknown.kind.value),
        shape=unknown.shape,
        dimension=unknown.dimension,
        unit=unit,
        scale=scale,
        doc=unknown.doc or None,
        over=_steps(problem) if unknown.is_state else None,
    )


def repeated(values: NDArray[Any], steps: tuple[int, ...]) -> NDArray[Any]:
    """The values, for all ``steps`` (their number) where a state does not change."""
    return np.tile(values, (*steps, *(1,) * values.ndim)) if steps else values


def entry_factors(quantity: Quantity, entry: Entry) -> Floats:
    """SI per unit shown for each coordinate of an unknown, members one after the other."""
    if quantity.kind in GEOMETRIC:
        return np.tile(coordinate_factors(quantity), entry.members)
    return np.full(entry.count, quantity.scale.factor)


def _steps(problem: Problem) -> str | None:
    return None if problem.sequence is None else problem.sequence.column


def derived_quantity(problem: Problem, derived: Derived) -> Quantity:
    """How a derived quantity is shown."""
    sequence = problem.sequence
    over = _steps(problem) if sequence is not None and derived.table == sequence.steps else None
    size = len(derived.cases[0].values) if derived.cases else 1
    if derived.kind is not None:
        square = derived.dimension**2
        lengths = range(square, square + derived.dimension) if derived.kind is not UnknownKind.ROTATION else range(0)
        unit, scale = _unit(derived.unit, False, problem, derived.name, lengths)
        kind = Kind(derived.kind.value)
        shape, dimension = derived.shape, derived.dimension
        return Quantity(
            name=derived.name, kind=kind, shape=shape, dimension=dimension, unit=unit, scale=scale, over=over
        )
    unit, scale = _unit(derived.unit, derived.angle, problem, derived.name, range(size))
    kind = Kind.ANGLE if derived.turns else Kind.VECTOR if derived.shape else Kind.REAL
    return Quantity(name=derived.name, kind=kind, shape=derived.shape, unit=unit, scale=scale, over=over)


def keys_over(derived: Derived, tables: Mapping[str, Table]) -> tuple[str | None, tuple[Key, ...] | None]:
    """What a derived quantity ranges over, and where it has its values there; None twice for one value."""
    if derived.table is None:
        return None, None
    if derived.grid is not None:
        return derived.grid.variable, tuple(derived.grid.shown().tolist())
    table = tables[derived.table]
    return derived.table, tuple(table.keys()) if table.key is not None else tuple(float(r) for r in table.rows)


def _is_rate_of_angle(problem: Problem, unknown: Unknown) -> bool:
    sequence = problem.sequence
    of = {state.name: state.rate_of for state in sequence.states} if sequence is not None else {}
    kinds = {each.name: each.kind for each in problem.unknowns}
    return kinds.get(of.get(unknown.name) or "") is UnknownKind.ANGLE


def _united(unknown: Unknown) -> range:
    """The numbers that have the unit: all of them, or those of the translation."""
    if not unknown.dimension:
        return range(unknown.size)
    if unknown.kind in (UnknownKind.POSE, UnknownKind.SIMILARITY):
        first = 4 if unknown.dimension == 3 else 1
        return range(first, first + unknown.dimension)
    return range(0)


def _unit(stated: Unit | None, angle: bool, problem: Problem, name: str, numbers: range) -> tuple[str | None, Scale]:
    if stated is not None:
        return (None if stated.symbol == UNIT_ONE else stated.symbol), stated.scale
    if angle:
        return "rad", SI
    found: set[Dimension | None] = {problem.dimensions.get((name, i)) for i in numbers}
    dimension = next(iter(found)) if len(found) == 1 else None
    return (dimension.symbol() or None, SI) if dimension is not None else (None, SI)


EXACT = "the noise is unknown, and residuals that are zero but for rounding cannot tell it"
NO_NOISE = "the noise is unknown, and without redundancy the residuals cannot tell it"
DEPENDENT = "the covariance of the noise is unknown, and some combination of its components has no scatter"
VANISHED = "the noise that it is due to is estimated as nothing"
FREE = "the data do not determine it"
_NO_SLOPE = "its derivative is not finite at the estimates"
_NOT_FINITE = "the value is not finite"


def stuck(solution: Solution) -> bool:
    """Whether the start has no finite value or derivative, so that nothing but that can be said of it."""
    return solution.minimum.bad_row is not None


def nothing_known_of(solution: Solution) -> str | None:
    """Why no standard deviation at all is known; None where some may be."""
    if stuck(solution) or solution.minimum.reason is Reason.INFEASIBLE:
        return solution.minimum.reason.sentence
    return None if solution.sigma_known else NO_NOISE


def derived_value(problem: Problem, solution: Solution, found: DerivedSolution, quantity: Quantity) -> DerivedValue:
    """A derived quantity, for the rows of the solution's tables."""
    derived, unknown = problem.derived[found.owner], nothing_known_of(solution)
    leading = () if derived.table is None else (len(found.values),)
    shape = (*leading, *derived.shape)
    sigma = found.sigma if unknown is None else np.full_like(found.sigma, np.nan)
    stated = shape if derived.kind is None else (*leading, sigma.shape[1])
    over, keys = keys_over(derived, solution.tables)
    return DerivedValue(
        quantity=quantity,
        value=found.values.reshape(shape),
        sigma=sigma.reshape(stated),
        keys=keys,
        over=over,
        reason=_why_derived_missing(solution, found, sigma, unknown),
        spread=derived_spread(solution, found, stated),
    )


def value_elsewhere(problem: Problem, solution: Solution, derived: Derived, table: Table) -> DerivedValue | None:
    """A derived quantity for the rows of another table in the place of its own; None where the solution cannot."""
    if solution.elsewhere is None:
        return None
    moved = replace(solution, tables={**solution.tables, table.name: table}, profiles=no_profiles)
    found = solution.elsewhere(problem.derived.index(derived), table)
    return derived_value(problem, moved, found, derived_quantity(problem, derived))


def _why_derived_missing(solution: Solution, found: DerivedSolution, sigma: Floats, unknown: str | None) -> str | None:
    """Why values or sigmas of a derived quantity are missing; several causes are all named."""
    undefined = ~np.isfinite(found.values)
    if sigma.shape != undefined.shape:  # of rotations and the like, one coordinate is no one number
        undefined = np.broadcast_to(undefined.any(axis=1, keepdims=True), sigma.shape)
    missing = ~np.isfinite(sigma) & ~undefined
    causes = []
    if bool(undefined.any()):
        causes.append(_NOT_FINITE if found.undefined is None else f"{_NOT_FINITE}: {found.undefined}")
    if bool(missing.any()):
        why = found.reason or _slopeless(found, missing) or _noise_alone(solution, found, missing)
        causes.append(unknown or why or FREE)
    return ", or ".join(causes) or None


def _slopeless(found: DerivedSolution, missing: Mask) -> str | None:
    """What is said where the missing ones have no finite derivative by the estimates, as a root has at 0."""
    if found.gradient is None:
        return None
    return None if bool(np.isfinite(found.gradient[missing.ravel()]).all()) else _NO_SLOPE


def untold_noise(solution: Solution) -> str | None:
    """Why what the data determine has no standard deviation; None where all of it has."""
    states = {noise.state for noise in solution.noise.values()}
    told = {
        NoiseState.NO_REDUNDANCY: NO_NOISE,
        NoiseState.EXACT: EXACT,
        NoiseState.DEPENDENT: DEPENDENT,
        NoiseState.NOTHING: VANISHED,
    }
    return ", or ".join(sentence for state, sentence in told.items() if state in states) or None


def _noise_alone(solution: Solution, found: DerivedSolution, missing: Mask) -> str | None:
    """What is said where the numbers that the missing ones depend on are determined, and only their noise is not."""
    if found.gradient is None:
        return None
    loose = ~solution.observability.estimable & ~solution.observability.fixed
    return None if bool(found.gradient[missing.ravel()][:, loose].any()) else untold_noise(solution)


def coordinate_spread(solution: Solution) -> Spread:
    """That of all coordinates (M,) of the unknowns."""
    limits, held = solution.limited, limited(solution.observability)

    def every(values: Floats, other: float) -> Floats:
        whole = np.full(len(solution.layout.number), other)
        whole[solution.free] = values
        return whole

    def told(found: Followed, level: float) -> tuple[Floats, Floats]:
        below, above = found.of_coordinates(level)
        return every(below, np.nan), every(above, np.nan)

    count = len(solution.layout.number)
    found = Spread(
        dof=every(solution.freedom.dof, np.inf),
        inflation=every(solution.freedom.inflation, 1.0),
        ends=_ends(solution, count, told),
    )
    if limits is None and not held:
        return found
    places = solution.layout.number[solution.free]
    values = np.where(places >= 0, solution.numbers[places], np.nan)

    def without() -> Floats:
        if not held:
            return every(values, np.nan)
        with solution.lock:
            followed = solution.profiles()
        return every(values + (np.nan if followed is None else followed.free_steps()), np.nan)

    found = replace(found, released=_released(solution, count, without, told))
    if limits is None:
        return found
    return replace(found, lower=every(limits.lower, -np.inf), upper=every(limits.upper, np.inf))


def entry_spread(solution: Solution, every: Spread, entry: Entry, shape: tuple[int, ...]) -> Spread:
    """That of an unknown, of the ``shape`` of its sigmas; limits of angles stand about the value that is reported."""
    found = every.each(lambda values: values[entry.coordinates].reshape(shape))
    if entry.unknown.kind is not UnknownKind.ANGLE or found.lower is None or found.upper is None:
        return found
    numbers = solution.numbers[entry.range].reshape(shape)
    turned = half_turns(numbers) - numbers
    return replace(found, lower=found.lower + turned, upper=found.upper + turned)


def derived_spread(solution: Solution, one: DerivedSolution, shape: tuple[int, ...]) -> Spread:
    """That of a derived quantity, of the ``shape`` of its sigmas."""

    def told(found: Followed, level: float) -> tuple[Floats, Floats]:
        return found.of_derived(one.owner, level)

    return Spread(
        dof=one.freedom.dof,
        inflation=one.freedom.inflation,
        ends=_ends(solution, one.freedom.dof.size, told),
        released=_released(solution, one.freedom.dof.size, lambda: one.values, told),
    ).shaped(shape)


def _released(
    solution: Solution,
    count: int,
    values: Callable[[], Floats],
    ask: Callable[[Followed, float], tuple[Floats, Floats]],
) -> Released:
    def beside(moved: Moved) -> Ends:
        own = moved.at(solution.free)
        return _ends(solution, count, lambda found, level: ask(found.beside(own), level)) or no_ends

    def no_ends(_: float) -> tuple[Floats, Floats]:
        return np.full(count, np.nan), np.full(count, np.nan)

    return Released(values, beside)


def _ends(solution: Solution, count: int, ask: Callable[[Followed, float], tuple[Floats, Floats]]) -> Ends | None:
    """The ends of ``count`` intervals, looked for when they are asked for; None where they never are."""
    if solution.profiles is no_profiles:
        return None

    def ends(level: float) -> tuple[Floats, Floats]:
        with solution.lock:
            followed = solution.profiles()
        none = np.full(count, np.nan)
        return (none, none) if followed is None else ask(followed, level)

    return ends
