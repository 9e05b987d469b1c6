"""The table of a propagation: a line for each scalar, with its intervals and whether the linear one agrees."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from math import floor, log10

import numpy as np

from mbm.problem.naming import key_text
from mbm.report.columns import aligned, left, wrapped
from mbm.report.digits import measured, plain
from mbm.report.elements import unit_text
from mbm.report.interval_table import MOST_LINES
from mbm.report.propagation.samples import Part
from mbm.report.propagation.solve import PropagatedSolve
from mbm.report.sentences import diagnostic_sentence
from mbm.report.types import Result
from mbm.text.shown import Paint, Style, joined

HEAD = ("", "mean", "sigma", "interval", "shortest", "linear")


def table(
    result: Result, solves: Sequence[PropagatedSolve], *, width: int, color: bool = False, full: bool = False
) -> str:
    """The table, with a line break at the end; ``full`` shows all scalars."""
    paint = Paint(color)
    where = f"{result.file}: " if result.file else ""
    lines = [paint(f"{where}problem `{result.problem}`", Style.HEADING)]
    for each in solves:
        lines += ["", *_of_solve(each, width, paint, full)]
    return joined((line.rstrip() for line in lines), color=color) + "\n"


def _of_solve(found: PropagatedSolve, width: int, paint: Paint, full: bool) -> Iterator[str]:
    key = ", ".join(f"{name} = {key_text(value)}" for name, value in found.solve.key.items())
    level = f"{plain(100 * found.solve.coverage, 6)} %"
    yield f"{key + ': ' if key else ''}{found.trials:,} trials, {level} intervals"
    yield ""
    rows = list(chain.from_iterable(_rows(found, part) for part in found.parts))
    shown = rows if full else rows[:MOST_LINES]
    columns = list(zip(*shown, strict=True))
    if columns:
        texts = [left(columns[0]), *(aligned(list(each)) for each in columns[1:5]), left(columns[5])]
        widths = [max(len(head), len(text[0])) for head, text in zip(HEAD, texts, strict=True)]
        yield "  " + "  ".join(head.ljust(w) for head, w in zip(HEAD, widths, strict=True))
        for line in zip(*texts, strict=True):
            cells = [cell.ljust(w) for cell, w in zip(line, widths, strict=True)]
            yield "  " + "  ".join([paint(cells[0], Style.HEADING), *cells[1:]])
    if len(rows) > len(shown):
        yield paint("  … and more (-v shows all)", Style.QUIET)
    for diagnostic in found.diagnostics:
        yield from (paint(line, Style.WARNING) for line in wrapped(diagnostic_sentence(diagnostic), width))


def _rows(found: PropagatedSolve, part: Part) -> Iterator[tuple[str, ...]]:
    """Name, mean, sigma, intervals, and what the linear one says, of each scalar of a part."""
    told, agrees = found.sampled.spreads, found.agrees(part)
    unit = unit_text(part.item.quantity)
    for k, name in enumerate(part.names):
        place = part.columns.start + k
        sigma = float(told.sigma[place])
        scale = sigma if found.varies else float(np.diff(told.interval[place])[0]) / 4.0
        mean = _number(float(told.mean[place] if found.varies else told.median[place]), scale)
        ends = [_interval(told.interval[place], scale), _interval(told.shortest[place], scale)]
        middle = mean if found.varies else f"{mean} (median)"
        verdict = "" if agrees is None else "agrees" if agrees[k] else "differs"
        linear = f"{_interval(part.linear[k], scale)} {verdict}" if verdict else "none"
        yield name, f"{middle} {unit}".rstrip(), _sigma(sigma) if found.varies else "none", *ends, linear


def _interval(ends: np.ndarray, scale: float) -> str:
    return f"{_number(float(ends[0]), scale)} … {_number(float(ends[1]), scale)}"


def _number(value: float, sigma: float) -> str:
    """A number with the digits of its standard deviation; a very large or small one with its own power of ten."""
    text = measured(value, sigma).value if sigma > 0.0 else plain(value, 6)
    if not text.startswith("("):
        return text
    return plain(value, max(2, 2 + floor(log10(abs(value) / sigma))) if value else 1)


def _sigma(sigma: float) -> str:
    text = measured(0.0, sigma).sigma
    return plain(sigma, 2) if text.endswith(")") or "e" in text else text
