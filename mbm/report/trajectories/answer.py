"""What ``mbm trajectory`` answers: the result of the solve, and the errors of its trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mbm.report.document import document
from mbm.report.trajectories import faults
from mbm.report.trajectories.document import trajectory_document
from mbm.report.trajectories.sides import Place
from mbm.report.trajectories.trajectory import trajectory
from mbm.report.trajectories.types import Trajectory
from mbm.report.types import Result, ResultStatus
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryAnswer:
    """The errors of the trajectories of each solve.

    ``result`` is that of the solve; it has no solves where nothing was to be estimated, as the alignment is known.
    """

    result: Result
    trajectories: tuple[Trajectory, ...]

    @property
    def status(self) -> ResultStatus:
        """That of the solve; ``ok`` where nothing was to be solved."""
        return self.result.status if self.result.solves else ResultStatus.OK

    def document(self) -> dict[str, Any]:
        """The result document, each solve with its ``trajectory``."""
        found = document(self.result)
        found["status"] = self.status.value
        solves: list[dict[str, Any]] = found["solves"] or [{"key": {}}]
        for solve, each in zip(solves, self.trajectories, strict=True):
            solve["trajectory"] = trajectory_document(each)
        found["solves"] = solves
        return found


def trajectories_of(
    result: Result, deltas: Sequence[str] = (), observation: str | None = None
) -> tuple[Trajectory, ...]:
    """The errors of each solve of a result; arguments and errors as `trajectory` has them."""
    found = []
    for solve in result.solves:
        if solve.made_from is None:
            raise MbmError(faults.solved_together())
        problem, solution = solve.made_from()
        place = Place(
            problem=problem,
            groups=solution.groups,
            layout=solution.layout,
            numbers=solution.numbers,
            tables=solution.tables,
        )
        with solution.lock:
            found.append(trajectory(place, solve.key, deltas, observation))
    return tuple(found)
