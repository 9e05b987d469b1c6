"""The panels of a picture: each function answers drawings, which are made when the picture has room for them.

Guaranteed bounds as a picture: a bar for each scalar, in parts where the set is in pieces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations
from math import isfinite
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mbm.report.digits import enclosed, plain
from mbm.report.elements import Scalar, element_names, plain_key, scalars, solve_scalars, unit_text
from mbm.report.figures import BLUE, CHI_95_2D, GREY, RED, SERIES, finish
from mbm.report.regions import Region, region
from mbm.report.row_data import Curve, PlotData, ResidualRow
from mbm.report.types import DerivedValue, Estimate, Floats, Kind, Result, SolveReport
from mbm.text.shown import cut
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mbm.report.figures import Panel

LONGEST_MARK = 24
"""Characters of a key below a mark of an axis; the frame shrinks to nothing above longer ones."""

_MOST_OVER_KEY = 6

MOST_PAIRED = 3
"""Numbers of a solve whose pairs are drawn."""


def data_panels(result: Result) -> Iterator[Panel]:
    """Measured values and the model, for every clause that handed them over; of many solves the first."""
    if result.solves:
        for data in result.solves[0].pictures():
            yield partial(draw_data, data)


def estimate_panels(result: Result) -> Iterator[Panel]:
    """Error ellipses of vectors of two or three elements; for many solves the estimates over the key."""
    solved = [solve for solve in result.solves if solve.estimates]
    if len(solved) > 1:
        yield from _over_key(solved)
    first = solved[0].estimates if solved else ()
    for estimate in first:
        size = estimate.quantity.shape[0] if len(estimate.quantity.shape) == 1 else 0
        if (
            estimate.bounds is None
            and estimate.quantity.kind is Kind.VECTOR
            and size in (2, 3)
            and not bool(np.all(estimate.fixed))
        ):
            for pair in combinations(range(size), 2):
                yield partial(_draw_ellipses, solved, estimate.quantity.name, pair)


def region_panels(result: Result) -> Iterator[Panel]:
    """The joint region of each pair of the numbers of one solve, if there are few."""
    solves = [solve for solve in result.solves if solve.estimates]
    if len(solves) != 1:
        return
    numbers = [
        estimate.quantity.name
        for estimate in solves[0].estimates
        if estimate.bounds is None
        and not estimate.quantity.shape
        and estimate.keys is None
        and not np.any(estimate.fixed)
    ]
    for pair in combinations(numbers, 2) if len(numbers) <= MOST_PAIRED else ():
        try:
            found = region(solves[0], pair, None)
        except MbmError:  # there is none, which is told where it is asked for
            continue
        yield partial(_draw_region, found)


def _draw_region(found: Region, axes: Axes) -> None:
    """Where two numbers lie together, with their estimates; open where the region has no end."""
    around = np.vstack([found.boundary, found.boundary[:1]])
    around[~np.isfinite(around).all(axis=1)] = np.nan
    if np.isfinite(around).all():
        axes.fill(around[:, 0], around[:, 1], facecolor=BLUE, alpha=0.25)
    axes.plot(around[:, 0], around[:, 1], color=BLUE, linewidth=1.0)
    axes.plot(*found.centre, "+", color=BLUE, markersize=7)
    labels = [f"{name} ({unit})" if unit else name for name, unit in zip(found.names, found.units, strict=True)]
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_title(f"{found.names[0]} and {found.names[1]}: {plain(100 * found.level, 6)} % region", fontsize=10)
    finish(axes, legend=False)


def residual_panels(result: Result) -> Iterator[Panel]:
    """Normalised residuals over the row, one panel for each clause, all solves together."""
    rows: dict[str, list[ResidualRow]] = {}
    for solve in result.solves:
        for row in solve.rows():
            rows.setdefault(row.clause, []).append(row)
    for clause, of_clause in rows.items():
        yield partial(draw_residuals, clause, of_clause)


def draw_data(data: PlotData, axes: Axes) -> None:
    """Measured values and the model, with the bands of a curve."""
    axes.set_title(f"{data.clause}: data and model" if len(data.measured) else data.clause, fontsize=10)
    if data.abscissa is None and data.measured.shape[1] == 2:
        axes.plot(data.measured[:, 0], data.measured[:, 1], "o", color=BLUE, markersize=4, label="measured")
        axes.plot(data.model[:, 0], data.model[:, 1], "x", color=RED, markersize=5, label="model")
        axes.set(xlabel=data.labels[0], ylabel=data.labels[1])
        axes.set_aspect("equal", adjustable="datalim")
    else:
        _draw_over_abscissa(data, axes)
    finish(axes, legend=True)


def _draw_over_abscissa(data: PlotData, axes: Axes) -> None:
    abscissa = np.arange(1.0, len(data.measured) + 1) if data.abscissa is None else data.abscissa
    order = np.argsort(abscissa, kind="stable")
    line, model = (abscissa[order], data.model[order])
    if data.curve is not None:
        line, model = data.curve.abscissa, data.curve.values
        _draw_bands(data.curve, axes)
    several = len(data.labels) > 1
    for column, label in enumerate(data.labels):
        color = SERIES[column % len(SERIES)]
        of = f" {label}" if several else ""
        if len(abscissa):
            axes.plot(
                abscissa, data.measured[:, column], "o", color=color, markersize=3.5, alpha=0.8, label="measured" + of
            )
        name = "model" + of if len(abscissa) else "value"
        axes.plot(line, model[:, column], "-", linewidth=1.3, color=color if several else RED, label=name)
    axes.set_xlabel(data.abscissa_label or "row")
    if not several:
        axes.set_ylabel(data.labels[0])


def _draw_bands(curve: Curve, axes: Axes) -> None:
    """What the curve may be, and where a new reading may lie."""
    share = f"{100 * curve.coverage:g} %"
    for ends, color, opacity, what in ((curve.reading, GREY, 0.13, "of readings"), (curve.band, RED, 0.22, "interval")):
        if ends is not None:
            axes.fill_between(
                curve.abscissa, ends[0], ends[1], color=color, alpha=opacity, linewidth=0, label=f"{share} {what}"
            )


def draw_residuals(clause: str, rows: Sequence[ResidualRow], axes: Axes) -> None:
    """Points of used rows; crosses for rows that were left out, triangles if they lie beyond the frame."""
    number = np.array([index + 1 if row.row is None else row.row for index, row in enumerate(rows)])
    value = np.array([row.residual for row in rows])
    used = np.array([row.used for row in rows])
    component = np.array([row.component for row in rows])
    limit = max(3.5, 1.15 * float(np.nanmax(np.abs(value[used]), initial=0.0)))
    size = 4 if len(rows) < 300 else 2
    axes.axhspan(-2, 2, color=GREY, alpha=0.12, linewidth=0)
    axes.axhline(0, color=GREY, linewidth=0.8)
    for which in np.unique(component):
        chosen = used & (component == which)
        label = f"component {which}" if component.max() > 1 else None
        axes.plot(number[chosen], value[chosen], "o", color=SERIES[(which - 1) % 6], markersize=size, label=label)
    beyond = ~used & (np.abs(value) > limit)
    for chosen, marker, label in ((~used & ~beyond, "x", "not used"), (beyond, "^", "not used, beyond the frame")):
        if chosen.any():
            shown = np.clip(value[chosen], -0.96 * limit, 0.96 * limit)
            axes.plot(number[chosen], shown, marker, color=RED, markersize=5, label=label)
    axes.set_ylim(-limit, limit)
    axes.locator_params(axis="x", integer=True)
    axes.set_title(f"residuals of {clause}", fontsize=10)
    axes.set(xlabel="row", ylabel="residual / standard deviation")
    finish(axes, legend=bool(component.max() > 1 or not used.all()))


def _over_key(solves: Sequence[SolveReport]) -> Iterator[Panel]:
    """The scalars that several solves estimate, over the last key (the time, in a sequence)."""
    found = [{scalar.name: scalar for scalar in solve_scalars(solve)} for solve in solves]
    names = list(dict.fromkeys(name for scalars in found for name, scalar in scalars.items() if not scalar.fixed))
    key = list(solves[0].key)[-1] if solves[0].key else ""
    for name in names[:_MOST_OVER_KEY]:
        points = [
            (plain_key(solve.key[key]) if key in solve.key else i, scalars[name])
            for i, (solve, scalars) in enumerate(zip(solves, found, strict=True))
            if name in scalars
        ]
        yield partial(_draw_over_key, key, name, points)


def _draw_over_key(key: str, name: str, points: Sequence[tuple[object, Scalar]], axes: Axes) -> None:
    """Estimates with bars of one standard deviation, or from bound to bound."""
    numbers = [float(where) for where, _ in points if isinstance(where, int | float)]
    numeric = len(numbers) == len(points)
    x = np.array(numbers if numeric else range(len(points)), dtype=float)
    y = np.array([scalar.value for _, scalar in points])
    bounded = points[0][1].bounds is not None
    spread = [np.subtract(s.bounds, s.value) if s.bounds is not None else (-s.sigma, s.sigma) for _, s in points]
    away = np.nan_to_num(np.abs(np.array(spread, dtype=float)), nan=0.0).T
    axes.errorbar(x, y, yerr=away, fmt="o", color=BLUE, ecolor=GREY, markersize=3, elinewidth=0.9)
    if not numeric and len(points) <= 20:
        axes.set_xticks(x, [cut(str(where), LONGEST_MARK) for where, _ in points], rotation=45, ha="right")
    unit = unit_text(points[0][1].quantity)
    axes.set_title(f"{name}: guaranteed bounds" if bounded else f"{name} ± standard deviation", fontsize=10)
    axes.set(xlabel=key or "solve", ylabel=f"{name} ({unit})" if unit else name)
    finish(axes, legend=False)


def _draw_ellipses(solves: Sequence[SolveReport], name: str, pair: tuple[int, int], axes: Axes) -> None:
    """The estimates in the plane of two elements, with their 95 % ellipses."""
    from matplotlib.patches import Ellipse

    marker, size = ("+", 7) if len(solves) == 1 else (".", 3)
    for solve in solves:
        for estimate in solve.estimates:
            if estimate.quantity.name != name:
                continue
            quantity = estimate.quantity
            axes.set(
                xlabel=_axis_label(quantity.name, pair[0], unit_text(quantity)),
                ylabel=_axis_label(quantity.name, pair[1], unit_text(quantity)),
            )
            for centre, covariance in zip(*_plane(solve, estimate, pair), strict=True):
                axes.plot(*centre, marker, color=BLUE, markersize=size)
                if np.all(np.isfinite(covariance)):
                    full_axes, angle = _ellipse(covariance)
                    axes.add_patch(
                        Ellipse(tuple(centre), *full_axes, angle=angle, facecolor=BLUE, edgecolor=BLUE, alpha=0.25)
                    )
    axes.set_title(f"{name}: 95 % confidence", fontsize=10)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, legend=False)


def _axis_label(name: str, index: int, unit: str) -> str:
    return f"{name}[{index + 1}]" + (f" ({unit})" if unit else "")


def _plane(solve: SolveReport, estimate: Estimate, pair: tuple[int, int]) -> tuple[Floats, Floats]:
    """Centres (k, 2) and covariances (k, 2, 2) of the members in the unit of the quantity; NaN where unknown."""
    members = estimate.quantity.scale.from_si(np.reshape(estimate.value, (-1, estimate.quantity.shape[0])))
    names = np.reshape(element_names(estimate.quantity, estimate.keys), members.shape)
    centres = members[:, list(pair)]
    covariances = np.full((len(members), 2, 2), np.nan)
    if solve.covariance is not None and solve.covariance.matrix is not None:
        position = {name: i for i, name in enumerate(solve.covariance.names)}
        for member, row in enumerate(names):
            places = [position.get(str(row[i])) for i in pair]
            known = [place for place in places if place is not None]
            if len(known) == 2:
                covariances[member] = solve.covariance.matrix[np.ix_(known, known)] / estimate.quantity.scale.factor**2
    return centres, covariances


def _ellipse(covariance: Floats) -> tuple[tuple[float, float], float]:
    """Full axes and the angle (degrees) of the first of them, of the 95 % ellipse."""
    variances, directions = np.linalg.eigh(covariance)
    axes = 2 * CHI_95_2D * np.sqrt(np.maximum(variances, 0.0))
    angle = np.degrees(np.arctan2(directions[1, 1], directions[0, 1]))
    return (float(axes[1]), float(axes[0])), float(angle)


LONGEST_LABEL = 70
"""Characters above a bar."""

MOST_BARS = 16
"""Scalars that are drawn, the first ones."""

Ends: TypeAlias = tuple[float, float]


def enclosure_panels(solve: SolveReport) -> Iterator[Panel]:
    """One panel with the bounds of a solve by interval methods, none of another."""
    wholes = _bounded([*solve.estimates, *solve.derived])
    if not wholes:
        return
    pieces = [_bounded([*piece.estimates, *piece.derived]) for piece in solve.pieces]
    bars = []
    for name, (scalar, ends) in list(wholes.items())[:MOST_BARS]:
        parts = [piece[name][1] for piece in pieces if name in piece] or [ends]
        bars.append((scalar, ends, parts))
    yield partial(_draw, bars)


def _bounded(items: list[Estimate | DerivedValue]) -> dict[str, tuple[Scalar, Ends]]:
    """The scalars that have finite bounds, and are not fixed."""
    every = (scalar for item in items for scalar in scalars(item) if not scalar.fixed and scalar.bounds is not None)
    return {s.name: (s, s.bounds) for s in every if s.bounds is not None and all(map(isfinite, s.bounds))}


def _draw(bars: list[tuple[Scalar, Ends, list[Ends]]], axes: Axes) -> None:
    """Each bar from the low to the high end of its own scalar."""
    for place, (scalar, (low, high), parts) in enumerate(bars):
        width = (high - low) or 1.0
        for begin, end in parts:
            axes.barh(-place, (end - begin) / width, left=(begin - low) / width, height=0.3, color=BLUE, alpha=0.6)
        label = f"{scalar.name}  {enclosed(low, high)} {unit_text(scalar.quantity)}".rstrip()
        axes.text(0.0, 0.22 - place, cut(label, LONGEST_LABEL), fontsize=8, va="bottom")
    axes.set(xlim=(-0.02, 1.02), ylim=(-len(bars) + 0.5, 0.9), xticks=[], yticks=[])
    axes.set_title("guaranteed bounds", fontsize=10)
