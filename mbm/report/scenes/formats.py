"""The formats in which estimates are written, by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.report.scenes import faults
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.estimation.search.solution import Solution
    from mbm.files.journal import Read
    from mbm.problem.types import Problem
    from mbm.report.scenes.types import Files
    from mbm.report.types import Result

NAMES = ("colmap", "bundler", "opencv-yaml", "ply", "g2o", "tum", "kitti")


def check_format(form: str) -> None:
    """Refuse a format that there is not.

    Raises:
        MbmError: unknown-output.

    """
    if form not in NAMES:
        raise MbmError(faults.unknown_output(form, NAMES))


def files_of(result: Result, form: str) -> Files:
    """The files of a result in a format.

    Raises:
        MbmError: format-needs: the problem lacks what the format needs; unknown-output.

    """
    check_format(form)
    if len(result.solves) != 1:
        raise MbmError(faults.format_needs(form, f"one solve, and there are {len(result.solves)}"))
    made_from = result.solves[0].made_from
    if made_from is None:
        lacking = "and a result that was pickled has none" if result.solves[0].estimates else "and nothing was solved"
        raise MbmError(faults.format_needs(form, f"equations and estimates, {lacking}"))
    problem, solution = made_from()
    with solution.lock:
        return _writers()[form](problem, solution)


def _writers() -> Mapping[str, Callable[[Problem, Solution], Files]]:
    from mbm.report.scenes import bundler, colmap, g2o, opencv, ply, trajectories
    from mbm.report.scenes.scene import scene_of

    return MappingProxyType(
        {
            "colmap": lambda problem, solution: colmap.written(scene_of(problem, solution, colmap.FORM)),
            "bundler": lambda problem, solution: bundler.written(scene_of(problem, solution, bundler.FORM)),
            "opencv-yaml": lambda problem, solution: opencv.written(scene_of(problem, solution, opencv.FORM)),
            "ply": ply.written,
            "g2o": g2o.written,
            "tum": trajectories.tum,
            "kitti": trajectories.kitti,
        }
    )


def write(result: Result, form: str, folder: Path, *, force: bool, reads: tuple[Read, ...]) -> None:
    """Write the files of a result in a format into a folder, with a list of them; `write_folder` says what is kept.

    Files of ``reads`` are never written onto.

    Raises:
        MbmError: format-needs, unknown-output, foreign-folder, would-overwrite, not-writable; nothing was written.

    """
    from mbm.files.folders import write_folder
    from mbm.files.names import WRITE

    write_folder(folder, list(files_of(result, form).items()), WRITE, force=force, reads=reads)
