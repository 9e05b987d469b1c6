"""Absolute and relative pose errors (Sturm and others 2012, Zhang and Scaramuzza 2018).

With the reference Q and the aligned estimate P, both leading from the body to the world, the error of a pose is
``E = Q⁻¹ P``; that of a step from i to j is ``E = (Qᵢ⁻¹ Qⱼ)⁻¹ (Pᵢ⁻¹ Pⱼ)``. Without rotations, positions are compared,
and over steps the distances between them.
"""

from __future__ import annotations

import numpy as np

from mbm.report.trajectories.types import Errors, Floats, Indices, Path, Segments


def absolute_errors(reference: Path, estimate: Path, unit: str | None, factor: float) -> Errors:
    """The error of each pose; of the same number and order."""
    apart = estimate.positions - reference.positions
    if reference.rotations is None or estimate.rotations is None:
        return Errors(translation=_lengths(apart), unit=unit, factor=factor)
    turned = np.einsum("nji,njk->nik", reference.rotations, estimate.rotations)
    return _errors(turned, np.einsum("nji,nj->ni", reference.rotations, apart), unit, factor)


def relative_errors(paths: tuple[Path, Path], start: Indices, end: Indices, unit: str | None, factor: float) -> Errors:
    """The errors of the steps from ``start`` (k,) to ``end`` (k,); ``paths`` are the reference and the estimate."""
    begin, finish = ([path.take(rows) for path in paths] for rows in (start, end))
    if any(path.rotations is None for path in paths):
        lengths = [_lengths(b.positions - a.positions) for a, b in zip(begin, finish, strict=True)]
        return Errors(translation=np.abs(lengths[1] - lengths[0]), unit=unit, factor=factor)
    steps = [_step(a, b) for a, b in zip(begin, finish, strict=True)]
    (turn, move), (own_turn, own_move) = steps
    turned = np.einsum("nji,njk->nik", turn, own_turn)
    return _errors(turned, np.einsum("nji,nj->ni", turn, own_move - move), unit, factor)


def segments(
    paths: tuple[Path, Path],
    pairs: tuple[Indices, Indices],
    said: tuple[str | None, str, float, str | None],
    unit: str | None,
    factor: float,
) -> Segments:
    """The errors over steps; ``said`` is the name of the pair, what it goes by, its step and unit."""
    start, end = pairs
    positions = paths[0].positions
    gone = np.concatenate([np.zeros(1), np.cumsum(_lengths(np.diff(positions, axis=0)))])
    name, by, step, own = said
    return Segments(
        name=name,
        by=by,
        step=step,
        unit=own,
        start=start,
        end=end,
        lengths=np.abs(gone[end] - gone[start]),
        errors=relative_errors(paths, start, end, unit, factor),
    )


def _step(begin: Path, finish: Path) -> tuple[Floats, Floats]:
    """The rotations and translations from one pose to another, in the axes of the first."""
    if begin.rotations is None or finish.rotations is None:
        raise TypeError(begin)
    turn = np.einsum("nji,njk->nik", begin.rotations, finish.rotations)
    return turn, np.einsum("nji,nj->ni", begin.rotations, finish.positions - begin.positions)


def _errors(turned: Floats, moved: Floats, unit: str | None, factor: float) -> Errors:
    apart = np.square(turned - np.eye(turned.shape[1])).sum(axis=(1, 2))
    return Errors(
        translation=_lengths(moved),
        rotation=_angles(turned),
        turned=np.sqrt(apart),
        full=np.sqrt(apart + np.square(moved).sum(axis=1)),
        unit=unit,
        factor=factor,
    )


def _angles(turned: Floats) -> Floats:
    """The angles (n,) of rotations, in [0, π]; exact for small ones, where the trace has lost its digits."""
    if turned.shape[1] == 2:
        return np.asarray(np.abs(np.arctan2(turned[:, 1, 0], turned[:, 0, 0])))
    axis = np.stack(
        [
            turned[:, 2, 1] - turned[:, 1, 2],
            turned[:, 0, 2] - turned[:, 2, 0],
            turned[:, 1, 0] - turned[:, 0, 1],
        ],
        axis=1,
    )
    return np.asarray(np.arctan2(_lengths(axis), np.trace(turned, axis1=1, axis2=2) - 1.0))


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.square(vectors).sum(axis=1)))
