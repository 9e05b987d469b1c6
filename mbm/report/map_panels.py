"""Maps drawn: vertices, odometry and loop closures coloured by their residuals, landmarks, error ellipses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.report.figures import BLUE, CHI_95_2D, GREY, ORANGE, RED, finish, round_step
from mbm.report.row_data import Map
from mbm.report.types import Floats, Mask

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mbm.report.figures import Panel

MOST_EDGES = 30_000
"""Edges that are drawn: each so-manyth of more."""

MOST_ELLIPSES = 400
"""Places with an ellipse: each so-manyth of more."""

SIGHT = 0.03
"""Size of a typical ellipse that needs no magnification, as a share of the map."""

SPACE = np.array([[-0.4695, 0.8829, 0.0], [-0.3591, -0.1910, 0.9135]])
"""Right and up of the picture of space: from 28° beside x, 24° above."""

_ANGLES = np.linspace(0.0, 2 * np.pi, 33)


def map_panels(found: Map) -> Iterator[Panel]:
    """A map of the plane; of space, from above and from the side."""
    if found.places.shape[1] == 2:
        yield partial(draw_map, found, np.eye(2), f"map of {found.name}")
    else:
        yield partial(draw_map, found, np.eye(3)[:2], f"{found.name} from above")
        yield partial(draw_map, found, SPACE, f"{found.name} in space")


def draw_map(found: Map, axes_of: Floats, title: str, axes: Axes) -> None:
    """Draw a map, its places (n, d) seen along ``axes_of`` (2, d)."""
    at = found.places @ axes_of.T
    _draw_edges(found, at, axes)
    _draw_ellipses(found, at, axes_of, axes)
    _draw_places(found, at, axes)
    axes.set_title(title, fontsize=10)
    unit = f" ({found.unit})" if found.unit else ""
    if axes_of.shape[1] == 2 or np.array_equal(axes_of, np.eye(3)[:2]):
        axes.set(xlabel=f"x{unit}", ylabel=f"y{unit}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    finish(axes, legend=True)


def _draw_edges(found: Map, at: Floats, axes: Axes) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    step = -(-len(found.edges) // MOST_EDGES)
    edges, residuals, odometry = found.edges[::step], found.residuals[::step], found.next_to[::step]
    finite = residuals[np.isfinite(residuals)]
    most = max(3.0, float(np.quantile(finite, 0.99)) if len(finite) else 3.0)
    poses: Mask = np.asarray(found.moving[edges].all(axis=1))
    kinds: tuple[tuple[Mask, str, float, Any, int], ...] = (
        (odometry, "odometry", 1.4, "solid", 2),
        (poses & ~odometry, "loop closures", 0.9, (0, (4.0, 1.5)), 3),
        (~poses, "to landmarks" if found.moving.any() else "measurements", 0.5, "solid", 1),
    )
    shown = None
    for chosen, label, width, style, order in kinds:
        if not chosen.any():
            continue
        every = f", 1 in {step} is drawn" if step > 1 else ""
        lines = LineCollection(
            list(at[edges[chosen]]),
            array=residuals[chosen],
            cmap=ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.82, 256))),
            linewidths=width,
            linestyles=[style],
            zorder=order,
        )
        axes.plot([], [], color=GREY, linewidth=width, linestyle=style, label=f"{int(chosen.sum()):,} {label}{every}")
        lines.set_clim(0.0, most)
        shown = axes.add_collection(lines)
    if shown is not None and axes.figure is not None:
        bar = axes.figure.colorbar(shown, ax=axes, shrink=0.75, pad=0.02)
        bar.set_label("normalised residual (rms)", fontsize=8)
        bar.ax.tick_params(labelsize=7)


def _draw_places(found: Map, at: Floats, axes: Axes) -> None:
    size = 3.5 if len(at) < 100 else 1.8 if len(at) < 1000 else 0.7
    poses, others = at[found.moving], at[~found.moving]
    if len(others):
        label = "landmarks" if found.moving.any() else "places"
        axes.plot(
            *others.T, "*" if found.moving.any() else "o", color=ORANGE, markersize=size + 3, label=label, zorder=4
        )
    if len(poses):
        axes.plot(*poses.T, ".", color=GREY, markersize=size, zorder=4)
        axes.plot(*poses[0], "^", color=BLUE, markersize=7, label="first", zorder=5)
        axes.plot(*poses[-1], "s", color=RED, markersize=6, label="last", zorder=5)


def _draw_ellipses(found: Map, at: Floats, axes_of: Floats, axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    spreads = axes_of @ found.spreads @ axes_of.T
    known = np.flatnonzero(np.isfinite(spreads).all(axis=(1, 2)) & (np.abs(spreads).max(axis=(1, 2)) > 0))
    known = known[:: -(-len(known) // MOST_ELLIPSES) or 1]
    if not len(known):
        return
    variances, directions = np.linalg.eigh(spreads[known])
    arms = CHI_95_2D * directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
    sizes = np.linalg.norm(arms, axis=1).max(axis=1)
    extent = float(np.ptp(at, axis=0).max())
    typical = float(np.median(sizes))
    factor = 1.0 if typical >= SIGHT * extent else max(1.0, round_step(SIGHT * extent / typical))
    circle = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
    lines = at[known][:, None] + factor * (arms @ circle).transpose(0, 2, 1)
    label = "95 % ellipses" + (f" × {factor:g}" if factor > 1.0 else "")
    axes.add_collection(LineCollection(list(lines), colors=BLUE, linewidths=0.7, alpha=0.6, label=label, zorder=3))
