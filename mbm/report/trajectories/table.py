"""Errors of trajectories for people: a table of their statistics."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.problem.naming import key_text
from mbm.report.columns import laid_out, left, right
from mbm.report.trajectories.types import Errors, Segments, Statistics, Trajectory

HEADER = ("", "rmse", "mean", "median", "std", "min", "max", "95 %", "unit", "rows")
_NAMES = {
    "translation": "position",
    "rotation": "rotation",
    "rotation_part": "|R - I|",
    "full": "|E - I|",
}


def text(trajectories: Sequence[Trajectory], *, full: bool = False) -> str:
    """The table; ``full`` adds the errors of the matrices."""
    lines: list[str] = []
    for found in trajectories:
        key = "".join(f", {name} = {key_text(value)}" for name, value in found.key.items())
        sides = " against ".join(f"`{side.rstrip('.')}`" for side in found.sides)
        lines += [f"trajectory `{found.clause}`{key}: {sides}, {len(found.rows)} poses", ""]
        rows = [HEADER, *_rows("absolute", found.ape, full=full)]
        for each in found.rpe:
            rows += _rows(_step(each), each.errors, full=full)
        lines += ["  " + "  ".join(line).rstrip() for line in laid_out(rows, (left, *(right,) * 7, left, right))]
        drifts = [line for each in found.rpe for line in _drift(each)]
        lines += ["", *drifts] if drifts else []
        lines.append("")
    return "\n".join(lines)


def _step(found: Segments) -> str:
    unit = f" {found.unit}" if found.unit else " row" if found.step == 1 else " rows"
    return f"per {found.step:g}{unit}"


def _drift(found: Segments) -> list[str]:
    if found.by != "distance":
        return []
    said = found.drift()
    parts = [f"{said['translation_percent']:.3g} % of the path"] if "translation_percent" in said else []
    parts += [f"{said['rotation_deg_per_m']:.3g} deg/m"] if "rotation_deg_per_m" in said else []
    return [f"drift {_step(found)}: {', '.join(parts)}"] if parts else []


def _rows(name: str, errors: Errors, *, full: bool) -> list[tuple[str, ...]]:
    parts = {part: each for part, each in errors.statistics().items() if full or part in ("translation", "rotation")}
    return [_row(f"{name}, {_NAMES[part]}", each) for part, each in parts.items()]


def _row(name: str, found: Statistics) -> tuple[str, ...]:
    numbers = (found.rmse, found.mean, found.median, found.std, found.minimum, found.maximum, found.percentiles[95])
    return (name, *(f"{value:.6f}" for value in numbers), found.unit or "", str(found.rows))
