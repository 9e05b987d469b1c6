"""Rows at the point of their own step: what does not move is where a filter had it with the rows up to that step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.gathering import Rows
from mbm.equations.layout import places_in
from mbm.equations.types import Floats, Indices
from mbm.estimation.sequences.places import NOT_OF_A_STEP, Places
from mbm.values import dataclass

SEVERAL = -1
"""Stands for the step of rows that mention states of several."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnSteps:
    """Places in the numbers of a walk: behind all N of the problem those that do not move, step by step (T, S).

    ``column`` (M,) gives the free coordinate of a step, or -1, that each coordinate of the problem is.
    """

    places: Places
    made: int
    column: Indices

    @staticmethod
    def of(places: Places, made: int) -> OwnSteps:
        """Those of a walk of which so many steps were made."""
        column = places_in(places.free, len(places.coordinates[0]))
        return OwnSteps(places=places, made=made, column=column[places.coordinate])

    @property
    def last(self) -> int:
        """The last step that was made."""
        return max(self.made - 1, 0)

    def numbers(self, whole: Floats, points: Floats) -> Floats:
        """All numbers of a walk, of those of the problem (N,) and of the steps (T, …); NaN where it did not come."""
        still = points[:, : self.places.still_numbers].copy()
        still[self.made :] = np.nan
        return np.concatenate([whole, still.ravel()])

    def steps(self, group: Group) -> Indices:
        """The step of each row (rows,): that of the states that move in it, the last of rows without, or `SEVERAL`."""
        return self._common(self.places.step_of_coordinate[self._touched(group)])

    def varied(self, group: Group, numbers: Floats, steps: Indices) -> Indices:
        """The ``steps`` (rows,) of a `placed` group; for `SEVERAL` that of the states by which a row has slopes."""
        own, found = self.places.step_of_coordinate, steps.copy()
        if bool((steps == SEVERAL).any()):
            for lines, slopes in group.dense_slopes(numbers, np.arange(len(own)), len(own)):
                found[lines] = self._common(np.where((slopes != 0.0).any(axis=1), own, NOT_OF_A_STEP))
        return np.where(steps == SEVERAL, found, steps)

    def _common(self, steps: Indices) -> Indices:
        """The step (rows,) of steps (rows, …) and of such as are of none."""
        most = steps.max(axis=1, initial=NOT_OF_A_STEP)
        several = ((steps != most[:, None]) & (steps != NOT_OF_A_STEP)).any(axis=1)
        return np.where(several, SEVERAL, np.where(most == NOT_OF_A_STEP, self.last, most))

    def reached(self, group: Group) -> Indices:
        """The latest step that each row mentions (rows,); the last of rows without one."""
        most = self.places.step_of_coordinate[self._touched(group)].max(axis=1, initial=NOT_OF_A_STEP)
        return np.where(most == NOT_OF_A_STEP, self.last, most)

    def placed(self, group: Group, steps: Indices) -> Group:
        """The group that takes the numbers of a walk, and of these what its ``steps`` (rows,) had; `SEVERAL`: the last.

        Aggregates take the rows that they gather likewise, each at its own step.
        """
        places = self.places
        if not places.still_numbers:
            return group
        count, still = len(places.number), places.still_numbers
        within = np.minimum(group.index, count - 1)
        held = (group.index < count) & (places.step_of_number[within] == NOT_OF_A_STEP)
        own = count + np.where(steps == SEVERAL, self.last, steps)[:, None] * still + places.number[within]
        moved = np.where(group.index < count, group.index, group.index + len(places.numbers) * still)
        gathered = group.gathered
        if gathered is not None:
            rows = tuple(tuple(self._gathered(each) for each in groups) for groups in gathered.groups)
            gathered = replace(gathered, groups=rows)
        return replace(group, index=np.where(held, own, moved), shared=(False,) * len(group.shared), gathered=gathered)

    def _gathered(self, rows: Rows) -> Rows:
        return self.placed(rows, self.steps(rows)) if isinstance(rows, Group) else rows

    def _touched(self, group: Group) -> Indices:
        """The coordinates (rows, …) of the problem that rows depend on, also by what they gather."""
        if group.gathered is None:
            return group.columns
        own = group.columns[:, (group.columns < len(self.column)).all(axis=0)]
        beside = group.gathered.touched
        return np.hstack([own, np.broadcast_to(beside, (group.rows, len(beside)))])
