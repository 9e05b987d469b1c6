"""A photograph with its measured and predicted points, residuals and uncertainties magnified by a round factor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.report.figures import BLUE, CHI_95_2D, GREEN, GREY, RED, round_step
from mbm.report.types import Floats
from mbm.report.view.beneath import Beneath
from mbm.report.view.photographs import Photograph
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_POINTS = 1_000
"""Measurements of one image that are drawn: each so-manyth of more."""

ARROW = 0.06
"""Length of a typical magnified residual, as a share of the image's width."""

MANY = 50
"""Arrows of which not all need to lie in the frame."""

_ELLIPSE = 36


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Overlay:
    """What is drawn of a photograph.

    ``tails`` and ``tips`` (n, 2) are the ends of the residual arrows: from a measured point, the residual (model −
    measured) times ``factor``. ``ellipses`` (k, p, 2) are the 95 % regions of predictions, magnified by
    ``ellipse_factor`` about them. ``step``: each so-manyth measurement is drawn.
    """

    photograph: Photograph
    tails: Floats
    tips: Floats
    factor: float
    ellipses: Floats
    ellipse_factor: float
    step: int


def overlay_of(photograph: Photograph) -> Overlay:
    """Arrows and ellipses of a photograph, magnified by 1, 2 or 5 times a power of ten."""
    step = -(-len(photograph.measured) // MOST_POINTS)
    tails = photograph.measured[::step]
    residuals = photograph.predicted[::step] - tails
    width = float(np.ptp(photograph.measured[np.isfinite(photograph.measured).all(axis=1)], axis=0).max(initial=0.0))
    width = width or 1.0
    lengths = np.hypot(*residuals[photograph.used[::step]].T)
    factor = magnification(lengths[np.isfinite(lengths)], width)
    known = np.isfinite(photograph.covariance).all(axis=(1, 2))
    shapes = _ellipses(photograph.covariance[known])
    sizes = np.hypot(shapes[..., 0], shapes[..., 1]).max(axis=1) if len(shapes) else np.zeros(0)
    ellipse_factor = magnification(sizes, width)
    return Overlay(
        photograph=photograph,
        tails=tails,
        tips=tails + factor * residuals,
        factor=factor,
        ellipses=photograph.predicted[known][:, None] + ellipse_factor * shapes,
        ellipse_factor=ellipse_factor,
        step=step,
    )


def magnification(lengths: Floats, width: float) -> float:
    """The round factor, 1 or more, that makes the 90 % quantile of the lengths about ``ARROW`` of a width."""
    typical = float(np.quantile(lengths, 0.9)) if len(lengths) else 0.0
    if typical <= 1e-9 * width:
        return 1.0
    return max(1.0, round_step(ARROW * width / typical))


def _ellipses(covariances: Floats) -> Floats:
    """The boundaries (k, p, 2) of the 95 % regions about zero."""
    angles = np.linspace(0.0, 2 * np.pi, _ELLIPSE)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    variances, directions = np.linalg.eigh(covariances)
    spread = directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
    return np.asarray(CHI_95_2D * (spread @ circle).transpose(0, 2, 1))


def draw_overlay(found: Overlay, axes: Axes, image: Beneath | None = None) -> None:
    """Draw a photograph; ``image`` lies beneath, pixel centres at whole numbers, the middle of the first at 0."""
    photograph = found.photograph
    if image is not None:
        extent = (-0.5, image.width - 0.5, image.height - 0.5, -0.5)
        axes.imshow(image.pixels, cmap="gray", extent=extent, interpolation="nearest", zorder=0, alpha=0.7)
    _draw_lines(photograph, axes)
    _draw_points(found, axes)
    _draw_spread(found, axes)
    _frame(found, axes, image)
    axes.set_title(photograph.name or "the image", fontsize=11)


def _draw_lines(photograph: Photograph, axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    for hidden, colour, width, style in ((True, "#9fcfbd", 0.7, (0, (3.0, 2.0))), (False, GREEN, 1.1, "solid")):
        chosen = [line.points for line in photograph.lines if line.hidden == hidden]
        if chosen:
            label = None if hidden else "model at the estimates"
            axes.add_collection(
                LineCollection(chosen, colors=colour, linewidths=width, linestyles=[style], label=label, zorder=1)
            )
    if photograph.measured_lines:
        axes.add_collection(
            LineCollection(photograph.measured_lines, colors=BLUE, linewidths=0.6, label="measured lines", zorder=2)
        )


def _draw_points(found: Overlay, axes: Axes) -> None:
    photograph, step = found.photograph, found.step
    outlier = photograph.outlier[::step]
    unused = ~photograph.used[::step] & ~outlier
    good = ~outlier & ~unused
    size = 6.0 if len(found.tails) < 60 else 3.5 if len(found.tails) < 300 else 1.8
    predicted = photograph.predicted[::step]
    every = f", 1 in {step} of {len(photograph.measured):,}" if step > 1 else ""
    axes.plot(
        *found.tails[good].T,
        "o",
        color=BLUE,
        markersize=size,
        markerfacecolor="none",
        label=f"measured{every}",
        zorder=3,
    )
    axes.plot(*predicted.T, "x", color=RED, markersize=size * 0.8, label="predicted", zorder=4)
    for chosen, marker, label in ((outlier, "s", "outlier"), (unused, "D", "not used")):
        if chosen.any():
            axes.plot(
                *found.tails[chosen].T,
                marker,
                color="#CC79A7",
                markersize=size + 2,
                markerfacecolor="none",
                markeredgewidth=1.4,
                label=label,
                zorder=5,
            )


def _draw_spread(found: Overlay, axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    way = found.tips - found.tails
    axes.quiver(
        *found.tails.T,
        *way.T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color=BLUE,
        width=0.003 if len(found.tails) < 300 else 0.0015,
        headwidth=4,
        zorder=3,
        label=f"residual (model − measured) × {found.factor:g}",
    )
    if len(found.ellipses):
        label = f"95 % of the prediction × {found.ellipse_factor:g}"
        axes.add_collection(
            LineCollection(list(found.ellipses), colors=RED, linewidths=0.8, alpha=0.7, label=label, zorder=2)
        )


def _frame(found: Overlay, axes: Axes, image: Beneath | None) -> None:
    photograph = found.photograph
    if image is not None:
        lo, hi = np.array([-0.5, -0.5]), np.array([image.width - 0.5, image.height - 0.5])
    else:
        tips = found.tips[np.isfinite(found.tips).all(axis=1)]
        most = np.quantile(tips, [0.02, 0.98], axis=0) if len(tips) > MANY else tips  # a few may lead out of it
        points = np.vstack(
            [
                found.tails,
                most,
                photograph.predicted,
                *(line.points for line in photograph.lines),
                *photograph.measured_lines,
            ]
        )
        points = points[np.isfinite(points).all(axis=1)]
        lo, hi = points.min(axis=0), points.max(axis=0)
        room = 0.08 * float((hi - lo).max() or 1.0)
        lo, hi = lo - room, hi + room
    axes.set_xlim(*((hi[0], lo[0]) if photograph.left else (lo[0], hi[0])))
    axes.set_ylim(*((hi[1], lo[1]) if photograph.down else (lo[1], hi[1])))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(photograph.labels[0], fontsize=9)
    axes.set_ylabel(photograph.labels[1], fontsize=9)
    axes.tick_params(labelsize=8, colors=GREY)
    for side in axes.spines.values():
        side.set_color("#bbbbbb")
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=5.0, ncols=3, frameon=False)
