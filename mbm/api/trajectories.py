"""What ``mbm trajectory`` does: the alignment that a problem states is solved, then the errors of the trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.api.files import inputs_of, settings_of
from mbm.api.problem import load

if TYPE_CHECKING:
    from mbm.report.options import SolveOptions
    from mbm.report.trajectories.answer import TrajectoryAnswer


def trajectory_file(
    path: str | Path, options: SolveOptions, deltas: Sequence[str] = (), observation: str | None = None
) -> TrajectoryAnswer:
    """The errors of the trajectory that a problem file aligns; ``deltas`` are steps, ``observation`` names the clause.

    Where every unknown is fixed, nothing is solved: the errors are those of that alignment.

    Raises:
        MbmError: the problem, the data or the call is wrong; no-trajectory, several-trajectories, bad-delta.

    """
    from mbm.report.run import asked_options, unsolved
    from mbm.report.trajectories.answer import TrajectoryAnswer, trajectories_of
    from mbm.report.trajectories.known import known_place
    from mbm.report.trajectories.trajectory import chosen_block, trajectory

    problem = load(path, sandbox=options.sandbox)
    if options.problem is not None:
        problem = problem.named(options.problem)
    inputs = inputs_of(options)
    ready = problem.compiled(inputs, options.backend.value)
    if options.loaded is not None:
        options.loaded()
    found = ready.elaborated
    chosen_block(found.problem, observation)
    place = known_place(found, ready.kernels, ready.cache)
    if place is None:
        result = ready.result(settings_of(options))
        return TrajectoryAnswer(result=result, trajectories=trajectories_of(result, deltas, observation))
    asked = asked_options(ready.cache.backend.name, inputs.overrides, inputs.paths, options.init)
    result = unsolved(found.problem, found.raw, file=ready.origin.file, asked=asked)
    result = replace(result, reads=ready.origin.reading.journal.reads())
    return TrajectoryAnswer(result=result, trajectories=(trajectory(place, {}, deltas, observation),))
