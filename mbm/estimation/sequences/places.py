"""Where the numbers of a step stand: of all steps among those of the whole problem, and in the vectors of one step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Indices, Mask
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.types import Name
from mbm.problem.sequence.types import Estimator
from mbm.text.types import MbmError
from mbm.values import dataclass

NOT_OF_A_STEP = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Places:
    """The numbers and coordinates of steps.

    ``numbers`` (T, N) and ``coordinates`` (T, M) give for each of a step its place in the whole problem: first those of
    plain unknowns, then those of static states (both the same in all rows), then those of states that move. ``free``
    (n,) are the coordinates of a step that vary; the first ``plain`` of them are those of plain unknowns, the first
    ``still`` those that do not move, as the first ``still_numbers`` numbers do not. ``step_of_number``
    and ``step_of_coordinate`` give the step of each of the whole problem, `NOT_OF_A_STEP` of what does not move, and
    ``number`` and ``coordinate`` their places within a step.
    """

    numbers: Indices
    coordinates: Indices
    free: Indices
    plain: int
    still: int
    still_numbers: int
    step_of_number: Indices
    step_of_coordinate: Indices
    number: Indices
    coordinate: Indices

    @property
    def still_coordinates(self) -> int:
        """Coordinates that do not move, free or not."""
        return int(np.count_nonzero(self.step_of_coordinate == NOT_OF_A_STEP))


def places_of(equations: Assembled, steps: int, estimator: Estimator) -> Places:
    """The places in a problem with so many steps, for an ``estimator``.

    Raises:
        MbmError: a state is fixed at some steps only.

    """
    layout = equations.layout
    order = spread_entries(layout)
    sizes = [(e, e.members, moves(e)) for e in order]
    numbers = np.hstack([_laid(e.offset, e.unknown.size, members, steps, moves) for e, members, moves in sizes])
    coordinates = np.hstack([_laid(e.first, e.unknown.freedom, members, steps, moves) for e, members, moves in sizes])
    still = [entry for entry in order if not moves(entry)]
    free_everywhere = equations.is_free
    free_everywhere |= _moves(layout)
    varying = free_everywhere[coordinates[-1]] & ~layout.fixed[coordinates[-1]]
    _refuse_held(layout, coordinates, varying, estimator)
    free = np.flatnonzero(varying)
    still_coordinates = sum(e.members * e.unknown.freedom for e in still)
    plain_coordinates = sum(e.members * e.unknown.freedom for e in still if _rank(e) == 0)
    step_of_number, number = _inverse(numbers, len(layout.start), sum(e.count for e in still))
    step_of_coordinate, coordinate = _inverse(coordinates, len(layout.number), still_coordinates)
    return Places(
        numbers=numbers,
        coordinates=coordinates,
        free=free,
        plain=int(np.count_nonzero(free < plain_coordinates)),
        still=int(np.count_nonzero(free < still_coordinates)),
        still_numbers=sum(e.count for e in still),
        step_of_number=step_of_number,
        step_of_coordinate=step_of_coordinate,
        number=number,
        coordinate=coordinate,
    )


def spread_places(equations: Assembled, spread: Assembled, places: Places) -> Places:
    """Those of equations in which static states have a member for each step; steps have their numbers in one order.

    ``places`` are those of ``equations``, in which they have one for all.
    """
    steps = len(places.numbers)
    order = [(spread.layout.entry(e.unknown.name), _rank(e) > 0) for e in spread_entries(equations.layout)]
    numbers = np.hstack([_laid(e.offset, e.unknown.size, e.members, steps, moves) for e, moves in order])
    coordinates = np.hstack([_laid(e.first, e.unknown.freedom, e.members, steps, moves) for e, moves in order])
    plain = [e for e, moves in order if not moves]
    step_of_number, number = _inverse(numbers, len(spread.layout.start), sum(e.count for e in plain))
    plain_coordinates = sum(e.members * e.unknown.freedom for e in plain)
    step_of_coordinate, coordinate = _inverse(coordinates, len(spread.layout.number), plain_coordinates)
    return replace(
        places,
        numbers=numbers,
        coordinates=coordinates,
        still=places.plain,
        still_numbers=sum(e.count for e in plain),
        step_of_number=step_of_number,
        step_of_coordinate=step_of_coordinate,
        number=number,
        coordinate=coordinate,
    )


def names_of_step(layout: Layout, places: Places) -> tuple[list[Name], list[Name]]:
    """What the numbers (N,) and the free coordinates (n,) of a step are."""
    order = spread_entries(layout)
    numbers = [name for e in order for name in _names(e, e.unknown.size)]
    coordinates = [name for e in order for name in _names(e, e.unknown.freedom)]
    return numbers, [coordinates[at] for at in places.free]


def _names(entry: Entry, size: int) -> list[Name]:
    keys = (None,) if entry.unknown.is_state or entry.keys is None else entry.keys
    return [(entry.unknown.name, key, part) for key in keys for part in range(size)]


def spread_entries(layout: Layout) -> list[Entry]:
    """The unknowns in the order in which they have the numbers of a step."""
    return sorted(layout.entries, key=_rank)


MOVING = 2


def moves(entry: Entry) -> bool:
    """Whether an unknown is a state that changes from step to step."""
    return _rank(entry) == MOVING


def _rank(entry: Entry) -> int:
    """0 for plain unknowns, 1 for static states, `MOVING` for the others."""
    if not entry.unknown.is_state:
        return 0
    return 1 if entry.steps is not None else MOVING


def _laid(first: int, size: int, members: int, steps: int, moves: bool) -> Indices:
    """Places (steps, …) of the numbers or coordinates of an unknown at each step; what does not move has members."""
    if moves:
        return first + size * np.arange(steps)[:, None] + np.arange(size)
    return np.broadcast_to(first + np.arange(size * members), (steps, size * members))


def _moves(layout: Layout) -> Mask:
    found = np.zeros(len(layout.number), dtype=bool)
    for entry in layout.entries:
        if moves(entry):
            found[entry.coordinates] = True
    return found


def _refuse_held(layout: Layout, coordinates: Indices, varying: Mask, estimator: Estimator) -> None:
    """States are free at all steps behind the first, or at none."""
    wrong = (layout.fixed[coordinates[1:]] == varying[None]).any(axis=0) & _moves(layout)[coordinates[-1]]
    if wrong.any():
        owner = layout.owner(int(coordinates[-1][np.flatnonzero(wrong)[0]])).unknown
        what = f"does not take states that are fixed at some steps only, as `{owner.name}` is"
        mend = f"fix it at all steps, or {estimator.instead}"
        raise MbmError(faults.not_for_filters(owner.span, estimator, what, mend))


def _inverse(places: Indices, count: int, still: int) -> tuple[Indices, Indices]:
    """The step of each of ``count`` places, and where it stands within a step."""
    step, within = np.full(count, NOT_OF_A_STEP, dtype=np.int64), np.zeros(count, dtype=np.int64)
    within[places] = np.arange(places.shape[1])
    step[places[:, still:]] = np.arange(len(places))[:, None]
    return step, within


def step_layout(layout: Layout, places: Places) -> Layout:
    """The layout of one step, with what the first step has of starts, and the last of what is fixed."""
    return _picked(layout, places, [0], places.still_numbers, places.still_coordinates)


def transition_layout(layout: Layout, places: Places) -> Layout:
    """The layout of a transition: what does not move, the states of the step before, and those of the step reached."""
    return _picked(layout, places, [0, 1], places.still_numbers, places.still_coordinates)


def _picked(layout: Layout, places: Places, copies: Sequence[int], still: int, still_coordinates: int) -> Layout:
    """The numbers of a step, those that move as often as there are ``copies``."""
    first = places.numbers[0], places.coordinates[0]
    numbers = np.concatenate([first[0][:still], *(first[0][still:] for _ in copies)])
    coordinates = np.concatenate([first[1][:still_coordinates], *(first[1][still_coordinates:] for _ in copies)])
    moving = len(first[0]) - still
    moving_coordinates = len(first[1]) - still_coordinates
    number = layout.number[coordinates]
    found = np.where(number >= 0, places.number[np.maximum(number, 0)], -1)
    for copy in copies:
        begin = still_coordinates + copy * moving_coordinates
        part = found[begin : begin + moving_coordinates]
        part[part >= 0] += copy * moving
    curved = tuple(
        replace(each, numbers=np.vstack(rows), coordinates=np.vstack(lines))
        for each in layout.curved
        if (pairs := _curved(each.numbers, each.coordinates, places, copies, moving, moving_coordinates))
        for rows, lines in [tuple(zip(*pairs, strict=True))]
    )
    last = places.coordinates[-1]
    lasting = np.concatenate([last[:still_coordinates], *(last[still_coordinates:] for _ in copies)])
    return replace(
        layout,
        entries=(),
        by_name={},
        start=layout.start[numbers],
        guessed=layout.guessed[numbers],
        lower=np.where(layout.positive[lasting], np.maximum(layout.lower[lasting], 0.0), layout.lower[lasting]),
        upper=layout.upper[lasting],
        start_lower=layout.start_lower[coordinates],
        start_upper=layout.start_upper[coordinates],
        fixed=layout.fixed[lasting],
        positive=layout.positive[coordinates],
        angle=layout.angle[coordinates],
        number=found,
        curved=curved,
    )


def _curved(
    numbers: Indices, coordinates: Indices, places: Places, copies: Sequence[int], moving: int, moving_coordinates: int
) -> list[tuple[Indices, Indices]]:
    """The pieces of a step among those of the whole problem, once for each copy if they move."""
    found = []
    for rows, lines in zip(numbers, coordinates, strict=True):
        step = int(places.step_of_coordinate[lines[0]])
        if step > 0:
            continue
        for copy in copies if step == 0 else copies[:1]:
            shift = copy if step == 0 else 0
            found.append((places.number[rows] + shift * moving, places.coordinate[lines] + shift * moving_coordinates))
    return found
