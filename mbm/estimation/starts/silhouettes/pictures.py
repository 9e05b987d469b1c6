"""Contours that were measured point by point: which rows see one silhouette, and what is not known of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.random_starts import random_points
from mbm.expression.nodes import Outlined
from mbm.kernels.backends.calling import CallingStream
from mbm.problem.types import BlockRole
from mbm.values import dataclass

FEWEST_POINTS = 8
"""Points of a contour that say something of its hull."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """Rows ``lines`` (n,) of a group that have measured ``points`` (n, 2) on the contours of one silhouette.

    ``touched`` (M,) marks the coordinates that these rows depend on.
    """

    group: Group = field(repr=False)
    stream: CallingStream = field(repr=False)
    call: int
    called: Outlined
    lines: Indices = field(repr=False)
    points: Floats = field(repr=False)
    touched: Mask = field(repr=False)

    def numbers(self, points: Floats) -> Floats:
        """The numbers (S, size) of the figure at points (S, N)."""
        first = int(self.lines[0])
        inputs = self.group.inputs_at(points, slice(first, first + 1))
        return self.stream.arguments(self.call, inputs)[:, : self.called.figure.size]

    def misfit(self, point: Floats) -> float:
        """The mean square distance of the measured points from the contours in px², infinite where there are none."""
        inputs = self.group.inputs_at(point[None], slice(0, self.group.rows))[self.lines]
        distances = self.stream.functions.values(self.called, self.stream.arguments(self.call, inputs))
        found = float(np.mean(np.square(distances)))
        return found if np.isfinite(found) else np.inf


def pictures_of(equations: Assembled, base: Floats, missing: Mask, seed: int) -> Iterator[Picture]:
    """The pictures that depend on some of the ``missing`` coordinates (M,), the richest first.

    Rows see one silhouette if its numbers are the same at random points. The measured points must not depend on what is
    missing.
    """
    found: list[Picture] = []
    probes = random_points(equations, base, missing, 2, seed)
    for group in equations.groups:
        if group.role is not BlockRole.OBSERVATION or not group.kernel.calls or not missing[group.touched].any():
            continue
        stream = group.cache.stream(group.number, group.kernel)
        if isinstance(stream, CallingStream):
            for number, (call, _) in enumerate(stream.calls):
                if isinstance(call.external, Outlined) and call.external.function == "contour-distance":
                    found += _of_call(group, stream, number, call.external, probes, len(missing))
    yield from sorted((p for p in found if (p.touched & missing).any()), key=lambda p: -len(p.lines))


def _of_call(
    group: Group, stream: CallingStream, number: int, called: Outlined, probes: Floats, coordinates: int
) -> Iterator[Picture]:
    size = called.figure.size
    first, second = (stream.arguments(number, group.inputs_at(p[None], slice(0, group.rows))) for p in probes)
    if not np.array_equal(first[:, size:], second[:, size:]) or not np.isfinite(first[:, size:]).all():
        return
    _, owner = np.unique(first[:, :size], axis=0, return_inverse=True)
    order = np.argsort(owner.ravel(), kind="stable")
    for lines in np.split(order, np.flatnonzero(np.diff(owner.ravel()[order])) + 1):
        if len(lines) >= FEWEST_POINTS:
            touched = np.zeros(coordinates, dtype=bool)
            touched[group.columns[lines[0]]] = True
            yield Picture(
                group=group,
                stream=stream,
                call=number,
                called=called,
                lines=lines,
                points=first[lines, size:],
                touched=touched,
            )
