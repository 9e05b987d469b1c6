"""What can be wrong where the errors of a trajectory are asked for."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.types import Code, DataPlace, Diagnostic, Span

NO_TRAJECTORY = Code(
    "no-trajectory",
    "No observation lays a trajectory on a reference: MEASURED holds the position (or pose) of the reference as "
    "columns of the row, MODEL that of the estimate, moved.",
    "Write `(pair both (ref est) :by t)` and "
    "`(observe both (= [ref.x ref.y ref.z] (transform S [est.x est.y est.z])))`.",
)
SEVERAL_TRAJECTORIES = Code(
    "several-trajectories",
    "Several observations lay a trajectory on a reference; the errors are those of one.",
    "Name one with `--observation`.",
)
BAD_DELTA = Code(
    "bad-delta",
    "A step of the relative errors is no number of rows, seconds or metres, or no two poses are so far apart.",
    "Write `10f` for rows, `0.5s` for times, `2m` for the reference's path, shorter than the trajectory.",
)


NO_ROTATION = Code(
    "no-rotation",
    "A quaternion of a trajectory has no length, or holds no numbers, so that it is no rotation.",
    "Correct the line, or leave it out (`:where`).",
)


def no_rotation(place: DataPlace, length: float) -> Diagnostic:
    """A quaternion of this ``length``, the first number of which stands at ``place``."""
    return Diagnostic(
        code=NO_ROTATION,
        message=f"a quaternion of the length {length:g} is no rotation",
        place=place,
        hint=NO_ROTATION.mend,
    )


def no_trajectory(span: Span, why: str) -> Diagnostic:
    """Nothing that could be one."""
    return Diagnostic(
        code=NO_TRAJECTORY, message=f"there is no trajectory here: {why}", place=span, hint=NO_TRAJECTORY.mend
    )


def no_scale(span: Span, sides: tuple[str, str], *, still: bool) -> Diagnostic:
    """A similarity whose scale has collapsed; ``still``: the reference does not move."""
    estimate, reference = (side.rstrip(".") for side in sides)
    why = f"`{reference}` does not move" if still else f"`{estimate}` and `{reference}` do not move alike"
    return Diagnostic(
        code=NO_TRAJECTORY,
        message=f"{why}, so that no scale can be told: the similarity shrinks the path of `{estimate}` to a point",
        place=span,
        hint="align with `(pose 2)` or `(pose 3)` in place of the similarity, or check that the tables belong together",
    )


def without_equations() -> Diagnostic:
    """A trajectory of a result that was pickled, or of nothing."""
    return Diagnostic(
        code=NO_TRAJECTORY, message="a result that was pickled, or of which nothing was solved, has no trajectory",
        place=None, hint="solve again, or ask for the errors of the trajectory before the result is pickled",
    )  # fmt: skip


def several_trajectories(names: Sequence[str]) -> Diagnostic:
    """More than one."""
    shown = ", ".join(f"`{name}`" for name in names)
    return Diagnostic(
        code=SEVERAL_TRAJECTORIES, message=f"several observations are of trajectories: {shown}", place=None,
        hint=SEVERAL_TRAJECTORIES.mend,
    )  # fmt: skip


def bad_delta(text: str) -> Diagnostic:
    """A text that is no step."""
    return Diagnostic(
        code=BAD_DELTA, message=f"`{text}` is no step for relative errors", place=None, hint=BAD_DELTA.mend
    )


def no_steps(what: str) -> Diagnostic:
    """No two poses are that far apart."""
    return Diagnostic(
        code=BAD_DELTA, message=f"no two poses are {what} apart", place=None,
        hint="take a shorter step, or a wider `:tolerance` of the `pair`",
    )  # fmt: skip


def no_times(table: str) -> Diagnostic:
    """Steps of time without times."""
    return Diagnostic(
        code=BAD_DELTA, message=f"the table `{table}` has no column `t`, so that no step can be in seconds", place=None,
        hint="give the step in rows (`10f`) or along the path (`2m`)",
    )  # fmt: skip
