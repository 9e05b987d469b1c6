"""Two trajectories on one another, and their errors. Errors of trajectories for people: a table of their statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mbm.problem.naming import key_text
from mbm.problem.tables import CellKey
from mbm.report.columns import laid_out, left, right
from mbm.values import dataclass

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PERCENTILES = (5, 25, 75, 95, 99)
DEGREE = float(np.pi / 180)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """Positions (n, d) in SI, and rotations (n, d, d) if they are known; d is 2 or 3."""

    positions: Floats = field(repr=False)
    rotations: Floats | None = field(default=None, repr=False)

    def take(self, rows: Indices) -> Path:
        """The poses of some rows."""
        turned = None if self.rotations is None else self.rotations[rows]
        return Path(positions=self.positions[rows], rotations=turned)


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """What n errors come to: ``rmse = sqrt(mean e²)``, ``std`` with n, ``percentiles`` linear; in ``unit``."""

    rmse: float
    mean: float
    median: float
    std: float
    minimum: float
    maximum: float
    percentiles: Mapping[int, float]
    rows: int
    unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Errors:
    """The errors of n poses, or of n steps.

    ``translation`` (n,) are lengths in SI; ``rotation`` (n,) the angle in rad, ``turned`` ‖R − I‖ and ``full`` ‖E − I‖
    (Frobenius, of the matrix of the whole pose), None where no rotations are known. ``unit`` is that of lengths, and
    ``factor`` SI in one of it.
    """

    translation: Floats = field(repr=False)
    rotation: Floats | None = field(default=None, repr=False)
    turned: Floats | None = field(default=None, repr=False)
    full: Floats | None = field(default=None, repr=False)
    unit: str | None
    factor: float

    def statistics(self) -> Mapping[str, Statistics]:
        """Of each part that is known: ``translation``, ``rotation`` (in deg), ``rotation_part``, ``full``."""
        found = {"translation": statistics(self.translation / self.factor, self.unit)}
        if self.rotation is not None:
            found["rotation"] = statistics(self.rotation / DEGREE, "deg")
        if self.turned is not None:
            found["rotation_part"] = statistics(self.turned, None)
        if self.full is not None:
            found["full"] = statistics(self.full, None)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """Errors over steps: ``by`` rows, time or path, ``step`` in ``unit``.

    Row ``start`` (n,) of the poses leads to ``end`` (n,). ``lengths`` (n,) are those of the reference's path between
    the two, in SI. ``name`` is the pair of the problem that says so, None for a step that the caller asked for.
    """

    name: str | None
    by: str
    step: float
    unit: str | None
    start: Indices = field(repr=False)
    end: Indices = field(repr=False)
    lengths: Floats = field(repr=False)
    errors: Errors

    def drift(self) -> Mapping[str, float]:
        """Mean error beside the length of the path: of positions in per cent, of rotations in deg per metre."""
        moved = self.lengths > 0
        if not bool(moved.any()):
            return {}
        found = {"translation_percent": 100 * float(np.mean(self.errors.translation[moved] / self.lengths[moved]))}
        if self.errors.rotation is not None:
            turned = self.errors.rotation[moved] / DEGREE / self.lengths[moved]
            found["rotation_deg_per_m"] = float(np.mean(turned))
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """An estimated trajectory laid on its reference, by the observation ``clause``.

    ``rows`` (n,) are those of the table, from 1, ``times`` (n,) what it has in its column ``t``. ``estimate`` and
    ``reference`` are the poses, ``ape`` their errors, ``rpe`` those over steps. ``sides`` are how the problem calls the
    columns of the two, the estimate first.
    """

    clause: str
    key: Mapping[str, CellKey] = field(default_factory=lambda: MappingProxyType({}))
    sides: tuple[str, str]
    rows: Indices = field(repr=False)
    times: Floats | None = field(repr=False)
    estimate: Path
    reference: Path
    ape: Errors
    rpe: tuple[Segments, ...]


def statistics(errors: Floats, unit: str | None) -> Statistics:
    """What errors (n,), one at least, come to."""
    levels = np.percentile(errors, PERCENTILES).tolist()
    return Statistics(
        rmse=float(np.sqrt(np.mean(np.square(errors)))),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        std=float(errors.std()),
        minimum=float(errors.min()),
        maximum=float(errors.max()),
        percentiles=MappingProxyType(dict(zip(PERCENTILES, levels, strict=True))),
        rows=len(errors),
        unit=unit,
    )


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
