"""Directions from the equations of a camera, an eye or a bearing: where the residual vanishes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from mbm.equations.types import Floats, Mask

ITERATIONS = 30
SMALL = 1e-9
"""Length of the last step, in rad, with which a direction counts as found."""

LEFT_OVER = 1e-6
"""What may be left of the values, beside their size in other directions."""

Function = Callable[[Floats], Floats]
"""From one place for each row (n, d) to values (n, width) or slopes (n, width, d)."""


def directions(values: Function, slopes: Function, count: int, starts: Iterable[Floats]) -> Floats:
    """Unit vectors d (count, dim), one for each row, with ``values(d) = 0``; NaN where Newton finds none.

    The values depend on the direction of their argument alone. From each start (dim,) the search goes on in the plane
    that touches the sphere there, in which an undistorted pinhole camera is linear; the first start that leads all rows
    to a solution decides, otherwise each row takes its first.
    """
    found: Floats | None = None
    for start in starts:
        each = _from(values, slopes, count, start)
        each[~(np.abs(values(each)).max(axis=1) <= LEFT_OVER * _size(values, len(start)))] = np.nan
        found = each if found is None else np.where(np.isfinite(found), found, each)
        if bool(np.isfinite(found).all()):
            break
    if found is None:
        message = "a search for directions needs a start"
        raise ValueError(message)
    return found


def _size(values: Function, dimension: int) -> Floats:
    """The size of the values (n,) in directions that have nothing to do with the axes."""
    some = np.array([0.83, 0.71, 0.94])[:dimension]
    sizes = [np.nan_to_num(np.abs(values(sign * some)).max(axis=1)) for sign in (1.0, -1.0)]
    return np.asarray(np.maximum(*sizes))


def _from(values: Function, slopes: Function, count: int, start: Floats) -> Floats:
    axes = np.linalg.svd(start[None, :])[2][1:]
    offset = np.zeros((count, len(axes)))
    value = values(start + offset @ axes)
    done: Mask = np.zeros(count, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            slope = slopes(start + offset @ axes) @ axes.T
            step = solved(slope, value)
            length = np.linalg.norm(step, axis=1)
            step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-300))[:, None] if length.max(initial=0.0) > 5 else 1.0
            trial = offset - np.where(np.isfinite(step), step, 0.0)
            trial_value = values(start + trial @ axes)
            worse = ~(np.abs(trial_value).max(axis=1) <= np.abs(value).max(axis=1))
            for _ in range(8):
                if not bool((worse & ~done & np.isfinite(length)).any()):
                    break
                trial = np.where(worse[:, None], (trial + offset) / 2, trial)
                trial_value = values(start + trial @ axes)
                worse = ~(np.abs(trial_value).max(axis=1) <= np.abs(value).max(axis=1))
            done |= np.isfinite(length) & (length <= SMALL * (1 + np.linalg.norm(offset, axis=1)))
            offset = np.where(worse[:, None], offset, trial)
            value = np.where(worse[:, None], value, trial_value)
            if bool((done | ~np.isfinite(length)).all()):
                break
    found = start + offset @ axes
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(done[:, None], found, np.nan)


def solved(slope: Floats, value: Floats) -> Floats:
    """Newton's steps (n, width) of square systems, NaN where they are singular."""
    determinant = np.linalg.det(np.where(np.isfinite(slope), slope, 0.0))
    usable = np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(value).all(axis=1) & (determinant != 0)
    safe = np.where(usable[:, None, None], slope, np.eye(value.shape[1]))
    return np.where(
        usable[:, None], np.linalg.solve(safe, np.where(usable[:, None], value, 0.0)[..., None])[..., 0], np.nan
    )
