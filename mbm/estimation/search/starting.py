"""Where a solve begins: the starts that are given, and for unknowns without one what the equations themselves tell.

In this order: linear least squares of equations with one minimum; closed forms; the middle of the range that is stated;
linear least squares given the others; what contours of silhouettes tell; random points, with the unknowns that enter
linearly solved for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations import faults
from mbm.equations.affine_part import affine_coordinates, solved_linearly
from mbm.equations.assembly import Assembled
from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Mask
from mbm.estimation.search.leading import led_points
from mbm.estimation.search.separate import separated, together
from mbm.estimation.search.startless import refuse_guessing
from mbm.estimation.settings import Settings
from mbm.estimation.starts.nudging import off_stations
from mbm.estimation.starts.projection import projected_points
from mbm.estimation.starts.random_starts import costs, random_points
from mbm.expression.nodes import Outlined
from mbm.problem import faults as problem_faults
from mbm.problem.types import Method
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.starts.closed_forms.completion import Completion

SAMPLES = 128
"""Random points that are looked at where nothing else gives a start."""

KEPT = 24
"""How many of them, those that fit best, are started from."""

PROJECTED = 64
"""How many are started from where they were improved by variable projection: three peaks of 250 readings want them."""

CORRECTED = 8
"""The same where measured values are corrected, which takes long: each of them finds an ellipse in one of two cases."""

LARGE, FEW_KEPT = 20_000, 3
"""Numbers in the Jacobian, or in the normal equations, from which so few are kept: each start takes long."""

HUGE = 500_000
"""The same for the best one alone: each start takes seconds."""

DIRECT_SEARCH = 30_000
"""Random points of `:method direct-search`: in Nishida's room 99 % of searches then see a point within 10 cm."""

MOST_PUSHES, PUSH = 100, 0.5
"""Rounds in which rows are pushed to where their likelihood has a value, and how far in each: half a deviation of
a reading, half a count where none was read."""

GIVEN = "the initial values"

SILHOUETTES = "silhouettes"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beginning:
    """A point (N,) to start from, and where it came from in words."""

    point: Floats
    origin: str


def beginnings(equations: Assembled, settings: Settings) -> tuple[Beginning, ...]:
    """The points to start from, the most promising first; at least one.

    Raises:
        MbmError: an unknown is fixed at nothing, more is unknown than random points may guess, or none of them gives
            the equations finite values.

    """
    written, layout = equations.uncorrected(), equations.layout
    if settings.method is Method.CLOSED_FORM:
        return _closed_form_alone(written, settings)
    rough = written if equations.likely else equations.roughly_corrected()
    found = _of_written(written, rough, settings)
    moving = (np.isnan(layout.start) | layout.guessed)[equations.free]
    if not (equations.likely and moving.any()):
        return found
    return tuple(replace(each, point=_inside(equations, written, moving, each.point)) for each in found)


def _of_written(equations: Assembled, rough: Assembled, settings: Settings) -> tuple[Beginning, ...]:
    """The points for equations as they are written."""
    layout = equations.layout
    wanted = np.isnan(layout.start) | layout.guessed
    if settings.method is Method.DIRECT_SEARCH:
        return (_direct_search(equations, settings, wanted),)
    if not bool(wanted.any()):
        return (Beginning(point=layout.start, origin=GIVEN),)
    _refuse(layout, layout.missing() & layout.fixed)
    numbers = _with_idle_ones(equations)
    open_ones = wanted & equations.sought()
    if not bool(open_ones.any()):
        return (Beginning(point=numbers, origin=GIVEN),)
    one = _one_minimum(equations, np.where(open_ones, np.nan, numbers))
    if one is not None:
        return (one,)
    # Here and below: loaded where starts are missing only, so that other problems start at once.
    from mbm.estimation.search.aligning import aligned
    from mbm.estimation.starts.closed_forms.completion import completions
    from mbm.estimation.starts.closed_forms.rows import ENOUGH
    from mbm.estimation.starts.closed_forms.types import Situation

    wanted_numbers = np.where(open_ones, np.nan, numbers)
    tied = aligned(equations, wanted_numbers, settings) if settings.closed_forms else ()
    if tied:
        return tuple(Beginning(point=point, origin=origin) for point, origin in tied)
    situation = Situation(layout=layout, groups=equations.groups, numbers=wanted_numbers, most=ENOUGH)
    found = _filled_up(equations, completions(situation, settings.closed_forms), settings)
    most = min(int(np.isnan(c.numbers).sum()) for c in found)
    ends = [b for c in found if int(np.isnan(c.numbers).sum()) == most for b in _ended(equations, rough, c, settings)]
    return _sorted(equations, ends)


@np.errstate(all="ignore")
def _inside(told: Assembled, written: Assembled, moving: Mask, start: Floats) -> Floats:
    """A point (N,) where all likelihoods have a value: counts want rates above 0, of n trials below n.

    Rows without one are pushed to their readings and on, a bit more in each round, and the equations ``written`` for
    them fitted by the ``moving`` coordinates (n,): a relaxation of inequalities (Agmon 1954). ``start`` where no such
    point is found.
    """
    point, pushed = start, np.zeros(written.whole)
    for _ in range(MOST_PUSHES):
        outside = np.zeros(written.whole, dtype=bool)
        for group, own in zip(told.groups, written.groups, strict=True):
            lines = outside[own.first : own.first + own.count].reshape(own.rows, own.kernel.outputs)
            lines[~np.isfinite(group.values(point)).reshape(group.rows, -1).all(axis=1)] = True
        if not outside.any():
            return point
        residuals, jacobian = written.plain_linearised(point)
        if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
            return start
        pushed[outside] += np.where(residuals[outside] > 0.0, -PUSH, PUSH)
        step = np.zeros(written.dimension)
        step[moving] = np.linalg.lstsq(jacobian[:, moving], pushed - residuals, rcond=None)[0]
        point = written.retract(point, step)
    return start


def _filled_up(equations: Assembled, found: tuple[Completion, ...], settings: Settings) -> tuple[Completion, ...]:
    """What closed forms leave open beside stated starts as they give it without these, if that is all of it.

    The centre of a camera follows from many photographs together with its focal lengths, not from these.
    """
    from mbm.estimation.starts.closed_forms.completion import completions
    from mbm.estimation.starts.closed_forms.rows import ENOUGH
    from mbm.estimation.starts.closed_forms.types import Situation

    best, layout = found[0], equations.layout
    left = np.isnan(best.numbers)
    stated = equations.sought() & ~np.isnan(layout.start) & ~layout.guessed
    if not bool(left.any()) or not bool(stated.any()):
        return found
    situations = (
        Situation(layout=layout, groups=equations.groups, numbers=numbers, most=ENOUGH)
        for numbers in blank_numbers(equations)
    )
    every = [each for situation in situations for each in completions(situation, settings.closed_forms)]
    whole = [each for each in every if not bool(np.isnan(each.numbers[left]).any())]
    return (
        tuple(
            replace(best, numbers=np.where(left, each.numbers, best.numbers), used=(*best.used, *each.used))
            for each in whole
        )
        or found
    )


def _one_minimum(equations: Assembled, numbers: Floats) -> Beginning | None:
    """The least squares solution for the ``numbers`` (N,) that are NaN, where it leads to the one minimum there is.

    None: there may be several, or the equations are large.
    """
    layout = equations.layout
    bounded = equations.positive | np.isfinite(equations.lower) | np.isfinite(equations.upper)
    if not equations.linear or equations.likely or equations.constraints or bounded.any():
        return None
    missing = replace(layout, start=numbers).missing()
    linear = affine_coordinates(equations, missing)
    if equations.count * equations.dimension > LARGE or not np.array_equal(linear, missing):
        return None
    names = [each.unknown.name for each in layout.entries if missing[each.coordinates].any()]
    return Beginning(point=solved_linearly(equations, numbers, linear), origin=f"linear: {', '.join(names)}")


def _with_idle_ones(equations: Assembled) -> Floats:
    return with_idle_ones(equations, equations.layout.start)


def with_idle_ones(equations: Assembled, starts: Floats) -> Floats:
    """The starts (N,), with something for what no equation mentions; it stays without an estimate."""
    layout = equations.layout
    numbers = starts.copy()
    idle = np.isnan(numbers) & ~equations.sought()
    numbers[idle] = 0.0
    for curved in layout.curved:
        whole = idle[curved.numbers].all(axis=1)
        numbers[curved.numbers[whole]] = np.eye(curved.piece.size)[0]
    return numbers


def blank_numbers(equations: Assembled) -> tuple[Floats, ...]:
    """What closed forms for all unknowns begin with: the starts (N,), NaN where a number is sought.

    Closed forms know nothing of priors. Where these speak of some numbers only (a height), there is one more, in which
    those keep their starts.
    """
    numbers = _with_idle_ones(equations)
    every = np.where(equations.sought(), np.nan, numbers)
    return (every, np.where(equations.foreknown(), numbers, every)) if partly_foreknown(equations) else (every,)


def partly_foreknown(equations: Assembled) -> bool:
    """Whether priors speak of some of the numbers that are sought, but not of all."""
    sought = equations.sought()
    known = equations.foreknown()[sought]
    return bool(known.any() and not known.all())


def _closed_form_alone(equations: Assembled, settings: Settings) -> tuple[Beginning, ...]:
    """What closed forms say of all estimated unknowns; else of those without a start, the others staying at theirs.

    Raises:
        MbmError: no closed form gives them, or the routine that is asked for has no part in it.

    """
    from mbm.estimation.starts.closed_forms.completion import completions
    from mbm.estimation.starts.closed_forms.types import Situation

    layout = equations.layout
    forms = sorted(settings.closed_forms, key=lambda form: form.name != settings.routine)
    sought = equations.sought()
    numbers = _with_idle_ones(equations)
    for open_ones in (sought, sought & (np.isnan(layout.start) | layout.guessed)):
        situation = Situation(layout=layout, groups=equations.groups, numbers=np.where(open_ones, np.nan, numbers))
        found = [
            Beginning(point=c.numbers, origin="; ".join(c.used))
            for c in completions(situation, forms)
            if not bool(np.isnan(c.numbers).any())
            and c.used
            and (settings.routine is None or any(u.startswith(f"{settings.routine}:") for u in c.used))
        ]
        if found:
            return _sorted(equations, found)
    names = [e.unknown for e in layout.entries if bool(sought[e.range].any())]
    raise MbmError(faults.no_closed_form(names[0].span if names else None, settings.routine))


def _direct_search(equations: Assembled, settings: Settings, wanted: Mask) -> Beginning:
    """The best fitting of many random points: in the ranges where there are some, at the starts elsewhere.

    Nishida et al.'s direct substitution method, in its own words the method of last resort.
    """
    layout = equations.layout
    numbers = np.where(wanted & equations.sought(), np.nan, _with_idle_ones(equations))
    ranged = np.isfinite(layout.lower) & np.isfinite(layout.upper)
    ranged |= np.isfinite(layout.start_lower) & np.isfinite(layout.start_upper)
    missing = replace(layout, start=numbers).missing()
    free = np.zeros(len(missing), dtype=bool)
    free[equations.free] = True
    points = random_points(equations, numbers, free & (missing | ranged), DIRECT_SEARCH, settings.seed)
    found = costs(equations, points)
    best = int(np.argmin(found))
    if not np.isfinite(found[best]):
        _refuse(layout, missing)
    return Beginning(point=points[best], origin=f"direct search ({DIRECT_SEARCH} random points)")


def _ended(equations: Assembled, rough: Assembled, completion: Completion, settings: Settings) -> tuple[Beginning, ...]:
    """Points without any unknown number, from what the closed forms gave."""
    layout = equations.layout
    numbers, used = completion.numbers, completion.used
    middle = np.isnan(numbers) & layout.guessed
    if bool(middle.any()):
        numbers = np.where(middle, layout.start, numbers)
        used = (*used, "the middle of the range")
    missing = replace(layout, start=numbers).missing()
    linear = affine_coordinates(equations, missing)
    if bool((linear == missing).all()):

        def completed(others: Floats) -> Floats:
            return solved_linearly(equations, others, linear) if linear.any() else others

        looked_at = bool(middle.any()) and equations.count * equations.dimension <= HUGE
        point = off_stations(equations, numbers, middle, completed) if looked_at else completed(numbers)
        first = Beginning(point=point, origin="; ".join((*used, "linear") if linear.any() else used))
        if not middle.any() or settings.starts is not None or _takes_long(equations):
            return (first,)
        return (first, *_elsewhere(equations if linear.any() else rough, completion, settings)[:FEW_KEPT])
    seen = _seen(equations, completion, settings)
    if seen:
        return tuple(end for each in seen for end in _ended(equations, rough, each, settings))
    # What is drawn at random for the others would fit the middle only: the ranges are drawn from as well.
    found = _elsewhere(equations if linear.any() else rough, completion, settings)
    if not found:
        _refuse(layout, replace(layout, start=completion.numbers).missing())
    return found


def _takes_long(equations: Assembled) -> bool:
    """Whether one start takes so long that no other is tried beside the middle of the ranges."""
    called = any(group.kernel.calls or group.kernel.corrections is not None for group in equations.groups)
    return called or max(equations.count, equations.dimension) * equations.dimension > LARGE


def _seen(equations: Assembled, completion: Completion, settings: Settings) -> tuple[Completion, ...]:
    """What contours of silhouettes add to the numbers that closed forms gave; nothing if they add none."""
    calls = (call for group in equations.groups for call in group.kernel.calls)
    if not any(isinstance(call.external, Outlined) for call in calls):
        return ()
    from mbm.estimation.starts.silhouettes.search import silhouette_starts

    numbers = completion.numbers
    missing = replace(equations.layout, start=numbers).missing()
    found = silhouette_starts(equations, numbers, missing, settings.seed)
    if np.array_equal(found[0], numbers, equal_nan=True):
        return ()
    return tuple(replace(completion, numbers=each, used=(*completion.used, SILHOUETTES)) for each in found)


def _elsewhere(equations: Assembled, completion: Completion, settings: Settings) -> tuple[Beginning, ...]:
    """The best fitting of random points for what closed forms left open, ranges included; none where none has a value.

    Parts that no equation ties to one another are drawn each by itself.
    """
    base = completion.numbers
    missing = replace(equations.layout, start=base).missing()
    points = led_points(equations, base, missing, settings)
    try:
        refuse_guessing(equations, base, settings)
    except MbmError:
        if not len(points):
            raise
    else:
        drawn = tuple(_drawn(part.equations, base, part.missing, settings) for part in separated(equations, missing))
        every = together(base, drawn) if drawn and all(map(len, drawn)) else _drawn(equations, base, missing, settings)
        points = np.concatenate([points, every]) if len(every) else points
    origin = "; ".join((*completion.used, "random points"))
    return tuple(Beginning(point=point, origin=origin) for point in points)


def _drawn(equations: Assembled, base: Floats, missing: Mask, settings: Settings) -> Floats:
    """Points (some, N) with random values for ``missing`` coordinates, the best first.

    Where linear unknowns depend on the others, they are solved for.
    """
    linear = affine_coordinates(equations, missing)
    corrected = any(group.kernel.corrections is not None for group in equations.groups)
    numbers = max(equations.count, equations.dimension) * equations.dimension
    kept = 1 if numbers > HUGE else FEW_KEPT if numbers > LARGE else CORRECTED if corrected else KEPT
    most = PROJECTED if kept == KEPT else kept
    points = projected_points(equations, base, missing, linear, settings.seed, most, settings.stopped)
    if points is not None:
        return points
    points = random_points(equations, base, missing, SAMPLES, settings.seed)
    if bool(linear.any()):
        with np.errstate(all="ignore"):
            points = np.stack([solved_linearly(equations, point, linear) for point in points])
    found = costs(equations, points)
    return np.asarray(points[[i for i in np.argsort(found, kind="stable")[:kept] if np.isfinite(found[i])]])


def _sorted(equations: Assembled, found: list[Beginning]) -> tuple[Beginning, ...]:
    """Those that meet the constraints first, and of those the best fitting; bounds hold throughout if they can."""
    if len(found) == 1:
        return tuple(found)
    from mbm.estimation.starts.closed_forms.completion import SAME_COSTS

    violations = []
    for each in found:
        with np.errstate(all="ignore"):
            values = equations.constraint_values(each.point)
        above = values[~equations.equality]
        violations.append(float(np.maximum(above, 0.0).sum()) if np.isfinite(above).all() else np.inf)
    fits = costs(equations, np.stack([each.point for each in found]))
    lowest = fits.min()
    fits = np.where(fits <= lowest * (1 + SAME_COSTS) + SAME_COSTS, lowest, fits)
    met = [v <= 1e-6 for v in violations]
    order = sorted(range(len(found)), key=lambda i: (not met[i], fits[i]))
    if any(met):
        order = [i for i in order if met[i]]
    return tuple(found[i] for i in order)


def _refuse(layout: Layout, wrong: Mask) -> None:
    if bool(wrong.any()):
        unknowns = [e.unknown for e in layout.entries if bool(wrong[e.coordinates].any())]
        raise MbmError(*(problem_faults.missing_start(u.span, u.name) for u in unknowns))
