"""Free directions that are motions of everything at once: named, and settled by the minimum-norm datum if asked.

Coordinates of points and poses mean something beside each other only: no equation between them notices if all are
shifted, turned or (for directions alone) enlarged together; heights and clock readings beside each other only, if all
are shifted. Such motions are made for the unknowns there are and looked for in the null space of the Jacobian; unknowns
of any other kind may take part without being understood, if more motions are found than any null space would hold.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np

from mbm.equations.layout import Entry, Layout, places_in
from mbm.equations.manifolds import tangent_axes
from mbm.equations.types import CommonMotion, Floats, GaugeMotion, Indices, Observability
from mbm.estimation.uncertainty.freedom import free_combinations, touched_by
from mbm.problem.kinds import Gauge
from mbm.problem.types import UnknownKind
from mbm.rotations import matrix_of_quaternion
from mbm.values import dataclass

WITHIN = 1e-6
"""A motion is free where no more than this share of it lies outside the null space."""

INDEPENDENT = 1e-6
"""Relative size of singular values that count."""

SAID = 20
"""Free directions of very large problems that are put into words."""

POSES = (UnknownKind.POSE, UnknownKind.SIMILARITY)
ORIENTED = (*POSES, UnknownKind.ROTATION)
NUMBERS = (UnknownKind.REAL, UnknownKind.ANGLE)
LINE = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    """Unknowns of one space; ``inverse``: their poses lead from the scene to something, not into it."""

    entries: tuple[Entry, ...]
    dimension: int
    inverse: bool


def with_gauge(
    observed: Observability,
    layout: Layout,
    free: Indices,
    numbers: Floats,
    gauge: Gauge,
    bent: Floats | None = None,
) -> Observability:
    """``observed`` with the common motions among what is free; ``numbers`` (N,) the estimates, ``free`` (n,) as there.

    Directions that are ``bent`` (n, k), orthonormal where scaled, are free to first order only, and no motions (None:
    there are none).

    With ``Gauge.FREE`` they are taken out of the null space: the coordinates that nothing else moves are then estimable
    in the datum in which their corrections have the least norm, in SI (inner constraints, Meissl 1965): the covariance
    is then the pseudo-inverse of ``JᵀJ``.
    """
    directions, spare = _moving(observed)
    curving = directions[:, :0] if bent is None else bent
    if curving.shape[1]:
        directions = directions @ np.linalg.qr(directions.T @ curving, mode="complete")[0][:, curving.shape[1] :]
        spare = np.hstack([spare, curving])
    every = directions
    found, left = _settled(observed, layout, free, numbers, directions, (3, 2))
    numbered, rest = _settled(observed, layout, free, numbers, left, (LINE,))
    if not found and not numbered and observed.inverse is None:
        return observed
    point = np.where(layout.number[free] >= 0, numbers[layout.number[free]], 0.0)
    combinations = observed.combinations
    if observed.inverse is not None:
        combinations = (*combinations, *free_combinations(left[:, :SAID], observed.scale, point))
    elif any(motion.motion is CommonMotion.ROTATION for motion in found):
        combinations = free_combinations(np.hstack([left, curving]), observed.scale, point)
    settled = directions.shape[1] - rest.shape[1]
    found, directions = [*found, *numbered], rest
    if gauge is not Gauge.FREE:
        return replace(observed, gauge=tuple(found), combinations=combinations)
    if observed.inverse is None:
        combinations = free_combinations(np.hstack([directions, curving]), observed.scale, point)
        touched = touched_by(np.hstack([spare, directions]))
    else:
        touched = touched_by(directions) | observed.inverse.single()
        touched[list(observed.unused)] = True
    return replace(
        observed,
        gauge=tuple(found),
        datum=settled,
        datum_space=np.linalg.qr(every / observed.scale[:, None])[0] if settled else None,
        combinations=combinations,
        null_space=np.hstack([spare, directions]),
        estimable=~touched & ~observed.fixed,
    )


def _settled(
    observed: Observability,
    layout: Layout,
    free: Indices,
    numbers: Floats,
    directions: Floats,
    dimensions: tuple[int, ...],
) -> tuple[list[GaugeMotion], Floats]:
    """The common motions of scenes of these dimensions among the ``directions`` (n, k), and the directions left."""
    found: list[GaugeMotion] = []
    while directions.shape[1]:
        scenes = list(_scenes(layout, dimensions))
        each = [_recognised(observed, scene, layout, free, numbers, directions) for scene in scenes]
        motions, left, taken = max(each, key=lambda one: one[2], default=([], directions, 0))
        if not taken:
            break
        found.extend(motions)
        directions = left
    return found, directions


def _moving(observed: Observability) -> tuple[Floats, Floats]:
    """The null space (n, k) without the coordinates that nothing depends on, and with those alone."""
    if observed.inverse is not None:
        return observed.null_space, np.zeros((len(observed.scale), 0))
    spare = len(observed.unused)
    return observed.null_space[:, spare:], observed.null_space[:, :spare]


def _scenes(layout: Layout, dimensions: tuple[int, ...]) -> Iterator[_Scene]:
    """All geometric unknowns of a space together, then each family by itself, its poses either way round."""
    for dimension in dimensions:
        entries = tuple(e for e in layout.entries if _space(e) == dimension)
        if dimension != LINE and sum(e.members for e in entries) >= 2:
            yield _Scene(entries=entries, dimension=dimension, inverse=False)
        for entry in sorted(entries, key=lambda e: -e.members):
            if entry.members < 2:
                continue
            if len(entries) > 1 or dimension == LINE:
                yield _Scene(entries=(entry,), dimension=dimension, inverse=False)
            if entry.unknown.kind in ORIENTED:
                yield _Scene(entries=(entry,), dimension=dimension, inverse=True)


def _space(entry: Entry) -> int:
    """2 or 3 for points, poses, rotations and directions, 1 for families of numbers, 0 for anything else."""
    unknown = entry.unknown
    if unknown.kind in ORIENTED:
        return unknown.dimension
    if unknown.kind is UnknownKind.DIRECTION:
        return 3
    if unknown.kind is UnknownKind.VECTOR and unknown.shape in ((2,), (3,)):
        return unknown.shape[0]
    return LINE if unknown.kind in NUMBERS and entry.keys is not None else 0


def _recognised(
    observed: Observability, scene: _Scene, layout: Layout, free: Indices, numbers: Floats, directions: Floats
) -> tuple[list[GaugeMotion], Floats, int]:
    """Motions of the scene among the ``directions`` (n, k), the directions left, and how many went."""
    places = np.concatenate([np.arange(e.coordinates.start, e.coordinates.stop) for e in scene.entries])
    column = places_in(free, len(layout.number))
    lines = column[places]
    every = np.vstack([_motions(e, scene, numbers) for e in scene.entries])[lines >= 0]
    lines = lines[lines >= 0]
    every = every * observed.scale[lines, None]
    length = np.sqrt(np.square(every).sum(axis=0))
    part = directions[lines]
    moving = length > 0.0
    if not len(lines) or not bool(moving.any()):
        return [], directions, 0
    basis, triangle = np.linalg.qr(every[:, moving] / length[moving])
    left, singular, right = np.linalg.svd(part, full_matrices=False)
    kept = singular > INDEPENDENT
    inside = left[:, kept]
    outside = basis - inside @ (inside.T @ basis)
    _, missed, turned = np.linalg.svd(np.linalg.qr(outside, mode="r"), full_matrices=True)
    missed = np.concatenate([missed, np.zeros(len(turned) - len(missed))])
    shared = basis @ turned[missed <= WITHIN].T
    chosen = right[kept].T @ ((inside.T @ shared) / singular[kept, None])
    if shared.shape[1] <= basis.shape[1] + inside.shape[1] - len(lines):
        # So many motions lie in any null space of this size: they say something where all else stays.
        _, size, ways = np.linalg.svd(np.delete(directions, lines, axis=0) @ chosen, full_matrices=True)
        still = ways[int((size > INDEPENDENT).sum()) :].T
        shared, chosen = shared @ still, chosen @ still
    if not shared.shape[1]:
        return [], directions, 0
    weights = np.zeros((len(length), shared.shape[1]))
    weights[moving] = np.linalg.lstsq(triangle, basis.T @ shared, rcond=None)[0]
    names = _names(layout, free, directions @ chosen)
    rest = np.linalg.svd(chosen, full_matrices=True)[0][:, chosen.shape[1] :]
    return list(_named(weights, scene.dimension, names)), directions @ rest, shared.shape[1]


def _names(layout: Layout, free: Indices, moving: Floats) -> tuple[str, ...]:
    """Unknowns that take part in a motion."""
    touched = np.zeros(len(layout.number), dtype=bool)
    touched[free] = touched_by(moving)
    return tuple(e.unknown.name for e in layout.entries if bool(touched[e.coordinates].any()))


def _motions(entry: Entry, scene: _Scene, numbers: Floats) -> Floats:
    """Steps of an unknown's coordinates (members · freedom, q) under the q motions: shifts, turns, growth."""
    unknown, d = entry.unknown, scene.dimension
    if d == LINE:
        return np.ones((entry.members, 1))
    values = numbers[entry.range].reshape(entry.members, unknown.size)
    turns = 3 if d == 3 else 1
    steps = np.zeros((entry.members, unknown.freedom, d + turns + 1))
    if unknown.kind is UnknownKind.VECTOR:
        steps[:, :, :d] = np.eye(d)
        steps[:, :, d : d + turns] = _turned(values)
        steps[:, :, -1] = values
        return steps.reshape(-1, steps.shape[2])
    if unknown.kind is UnknownKind.DIRECTION:
        steps[:, :, d : d + turns] = np.stack(tangent_axes(values), axis=1) @ _turned(values)
        return steps.reshape(-1, steps.shape[2])
    held = 4 if d == 3 else 1
    position = values[:, held : held + d]
    rotation = matrix_of_quaternion(values[:, :4]) if d == 3 else _plane_rotations(values[:, 0])
    place = slice(turns, turns + d)
    if scene.inverse:
        steps[:, :turns, d : d + turns] = -np.eye(turns)
    else:
        steps[:, :turns, d : d + turns] = rotation.transpose(0, 2, 1) if d == 3 else 1.0
    if unknown.kind is UnknownKind.ROTATION:
        return steps.reshape(-1, steps.shape[2])
    steps[:, place, :d] = -rotation if scene.inverse else np.eye(d)
    if not scene.inverse:
        steps[:, place, d : d + turns] = _turned(position)
    steps[:, place, -1] = position
    if unknown.kind is UnknownKind.SIMILARITY:
        steps[:, turns + d, -1] = -1.0 if scene.inverse else 1.0
        steps[:, place, -1] = 0.0 if scene.inverse else position
    return steps.reshape(-1, steps.shape[2])


def _plane_rotations(angles: Floats) -> Floats:
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cosine, -sine], axis=1), np.stack([sine, cosine], axis=1)], axis=1)


def _turned(points: Floats) -> Floats:
    """Velocities of points (k, d) that turn about the axes: shape (k, 2, 1) in the plane, (k, 3, 3) in space."""
    if points.shape[1] == 2:
        return np.stack([-points[:, 1], points[:, 0]], axis=1)[:, :, None]
    x, y, z = points.T
    zero = np.zeros_like(x)
    rows = [[zero, z, -y], [-z, zero, x], [y, -x, zero]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def _named(weights: Floats, d: int, names: tuple[str, ...]) -> Iterator[GaugeMotion]:
    """What the motions with these weights (q, k) are: shifts first, then what turns, then what grows."""
    count = weights.shape[1]
    if d == LINE:
        yield GaugeMotion(motion=CommonMotion.TRANSLATION, dimensions=count, unknowns=names, numbers=True)
        return
    turning, growing = weights[d:-1], weights[-1:]
    grow = _rank(growing)
    beside = _rank(weights[d:])
    turn = beside - grow
    shift = count - beside
    if shift:
        still = np.linalg.svd(weights[d:], full_matrices=True)[2][beside:].T
        yield GaugeMotion(
            motion=CommonMotion.TRANSLATION, dimensions=shift, unknowns=names, axes=_axes(weights[:d] @ still)
        )
    if turn:
        yield GaugeMotion(motion=CommonMotion.ROTATION, dimensions=turn, unknowns=names, axes=_axes(turning))
    if grow:
        yield GaugeMotion(motion=CommonMotion.SCALE, dimensions=1, unknowns=names)


def _rank(weights: Floats) -> int:
    return int((np.linalg.svd(weights, compute_uv=False) > INDEPENDENT).sum()) if weights.size else 0


def _axes(weights: Floats) -> tuple[int, ...]:
    """The coordinate axes that the directions (d, k) span, where they are fewer than all and just such axes."""
    left, singular, _ = cast(Any, np.linalg.svd(weights, full_matrices=False))
    basis = left[:, singular > INDEPENDENT]
    inside = np.square(basis).sum(axis=1) > 1.0 - WITHIN
    spanned = basis.shape[1]
    return tuple(np.flatnonzero(inside).tolist()) if int(inside.sum()) == spanned < len(weights) else ()
