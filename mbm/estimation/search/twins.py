"""Minima that are one solution written twice, or mirror images that no equation tells apart.

Two minima of the same residuals suggest a symmetry: angles that turn by half a turn (Euler angles: φ+π, π−θ, ψ+π),
plain numbers that do as angles do (a phase in a sine), values that change sign or are reflected, directions that point
the other way (a plane's normal, with its offset), unknowns that trade places. Whether the equations have it is tried at
random points: a symmetry holds everywhere, two solutions that happen to fit equally well agree at the solutions only.
That of plain numbers holds for all data, too: frequencies a turn apart are alike at whole times only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import Enum

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.kernels.types import KernelSet
from mbm.problem.manifold import Piece
from mbm.problem.types import Problem
from mbm.values import dataclass

Agreement = Callable[[Floats, Floats], bool]
"""Whether two points (N,) have the same derived quantities."""

NEAR = 1e-5
"""Relative difference of numbers that are to be equal, at minima found independently."""


def derived_agreement(problem: Problem, binder: Binder, kernels: KernelSet) -> Agreement:
    """The comparison for a problem; angles agree by whole turns. The equations are bound when it is first asked."""

    def agree(first: Floats, second: Floats) -> bool:
        for owner, derived in enumerate(problem.derived):
            for group in binder.derived(kernels, owner):
                one, other = group.values(first).copy(), group.values(second).copy()
                apart = one - other
                if derived.angle:
                    apart = np.remainder(apart + np.pi, 2 * np.pi) - np.pi
                size = np.abs(one).max(axis=1, keepdims=True, initial=0.0) + derived.angle
                if not bool((np.abs(apart) <= NEAR * size).all()):
                    return False
        return True

    return agree


AGREE = 1e-7
"""Relative difference of residuals that a symmetry may leave: rounding, magnified by the model."""

MIDDLES = 3
"""Numbers that a reflection may have about middles of their own: one through a plane across all axes."""

PROBES = 6
ANGLE = 0.3
TRIED_SHARE = 0.1
"""How far from the minimum a symmetry is tried: angles and directions in rad, others as a share of themselves."""


class Twin(Enum):
    """How one minimum follows from another; the value is the sentence for people."""

    TURNED = "the same solution in other angles"
    WOUND = "the same solution with plain numbers turned as angles are"
    EXCHANGED = "the same solution with unknowns exchanged"
    MIRRORED = "the mirror image: no observation tells the two apart"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Map:
    """``x[targets] ← sign · x[sources] + shift``, directions (k, 3) turn about; everything else stays."""

    targets: Indices
    sources: Indices
    sign: Floats
    shift: Floats
    about: Indices
    kind: Twin

    def applied(self, points: Floats) -> Floats:
        result = points.copy()
        result[:, self.targets] = self.sign * points[:, self.sources] + self.shift
        result[:, self.about] *= -1.0
        return result


def twin_of(equations: Assembled, first: Floats, second: Floats) -> Twin | None:
    """How the point ``second`` (N,) follows from ``first`` by a symmetry of the equations; None where it does not."""
    layout = equations.layout
    about = _turned_about(equations, first, second)
    mended = second.copy()
    mended[about] *= -1.0
    if any(_turned_apart(first[c.numbers], mended[c.numbers]) for c in layout.curved):
        return None
    places = layout.number[equations.free]
    angle = layout.angle[equations.free][places >= 0]
    places = places[places >= 0]
    difference = second[places] - first[places]
    difference = np.where(angle, np.remainder(difference + np.pi, 2 * np.pi) - np.pi, difference)
    differs = np.abs(difference) > NEAR * (np.abs(first[places]) + np.abs(second[places])) + angle * NEAR
    if not differs.any() and not len(about):
        return None
    moving, turning = places[differs], angle[differs]
    exchange = None if len(about) else _exchange(first, second, moving)
    for candidate in (exchange, _reflection(first, second, moving, turning, about)):
        if candidate is not None and _holds(equations, candidate, first, places, angle):
            return _kind(equations, candidate, first, places, angle)
    return None


def _kind(equations: Assembled, found: _Map, about: Floats, places: Indices, angle: Mask) -> Twin:
    """The kind of a symmetry: a mirror image where that of one of the numbers that do not turn holds alone."""
    if found.kind is not Twin.WOUND:
        return found.kind
    for k in np.flatnonzero((found.sign != 1.0) | (found.shift == 0.0)):
        own = found.targets[k : k + 1]
        alone = replace(
            found, targets=own, sources=own, sign=found.sign[[k]], shift=found.shift[[k]], kind=Twin.MIRRORED
        )
        if _holds(equations, alone, about, places, angle):
            return Twin.MIRRORED
    return found.kind


def _turned_about(equations: Assembled, first: Floats, second: Floats) -> Indices:
    """The numbers (k, 3) of the free directions that point the other way."""
    parts = [np.empty((0, 3), dtype=np.int64)]
    for curved in equations.layout.curved:
        if curved.piece is Piece.SPHERE:
            opposite = (np.abs(first[curved.numbers] + second[curved.numbers]) <= NEAR).all(axis=1)
            parts.append(curved.numbers[opposite & np.isin(curved.coordinates, equations.free).all(axis=1)])
    return np.vstack(parts)


def _turned_apart(first: Floats, second: Floats) -> bool:
    """Quaternions (k, 4) up to their sign, directions and scales (k, …) themselves."""
    if first.shape[1] == 4:
        return bool((np.abs(np.einsum("ki,ki->k", first, second)) < 1 - NEAR * NEAR).any())
    return bool((np.abs(first - second) > NEAR * (np.abs(first) + np.abs(second))).any())


def _exchange(first: Floats, second: Floats, moving: Indices) -> _Map | None:
    """The numbers that trade places: each of the second point is one of the first."""
    apart = np.abs(second[moving][:, None] - first[moving][None, :])
    same = apart <= NEAR * (np.abs(second[moving])[:, None] + np.abs(first[moving])[None, :])
    source = same.argmax(axis=1)
    if not same.any(axis=1).all() or len(np.unique(source)) < len(moving):
        return None
    ones, zeros, nothing = np.ones(len(moving)), np.zeros(len(moving)), np.empty((0, 3), dtype=np.int64)
    return _Map(targets=moving, sources=moving[source], sign=ones, shift=zeros, about=nothing, kind=Twin.EXCHANGED)


def _reflection(first: Floats, second: Floats, moving: Indices, turning: Mask, about: Indices) -> _Map | None:
    """Half turns of angles, supplements and changes of sign; a few numbers may be reflected about any middle.

    A plane is the same where its normal turns about and its offset changes sign: one number for each direction. Where
    more numbers do, places may be reflected.
    """
    a, b = first[moving], second[moving]

    def wrapped(x: Floats) -> Floats:
        return np.abs(np.remainder(x + np.pi, 2 * np.pi) - np.pi)

    halves = np.round((b - a) / np.pi)
    wound = ~turning & (halves != 0) & (np.abs(b - a - np.pi * halves) <= NEAR)
    half = turning & (wrapped(b - a - np.pi) <= NEAR)
    supplement = turning & ~half & (wrapped(b + a - np.pi) <= NEAR)
    negated = np.where(turning, wrapped(a + b) <= NEAR, np.abs(a + b) <= NEAR * (np.abs(a) + np.abs(b)))
    if (~(half | supplement | negated | wound)).sum() > MIDDLES:
        return None
    sign = np.where(half | wound, 1.0, -1.0)
    shift = np.select([wound, half | supplement, negated], [np.pi * halves, np.pi, 0.0], a + b)
    rewritten = len(about) > 0 and bool((half | supplement | negated).all()) and len(moving) <= len(about)
    kind = Twin.WOUND if wound.any() else Twin.TURNED if rewritten or half.any() else Twin.MIRRORED
    return _Map(targets=moving, sources=moving, sign=sign, shift=shift, about=about, kind=kind)


def unwound(equations: Assembled, minimum: Minimum, agree: Agreement) -> Floats:
    """The point (N,) of a minimum with plain numbers brought by whole turns as near to their starts, or 0, as nothing
    notices.
    """
    layout, result = equations.layout, minimum.point
    plain = equations.free[(layout.number[equations.free] >= 0) & ~layout.angle[equations.free]]
    places = layout.number[plain]
    shifts = -2 * np.pi * np.round((result[places] - _nearest(equations, places)) / (2 * np.pi))
    moved = result[places] + shifts
    few = np.flatnonzero((shifts != 0) & (moved >= layout.lower[plain]) & (moved <= layout.upper[plain]))
    if equations.constraints or not len(few):
        return result
    points = np.tile(result, (len(few), 1))
    points[np.arange(len(few)), places[few]] = moved[few]
    with np.errstate(all="ignore"):
        apart = np.abs(equations.residuals_at(points) - minimum.residuals).max(axis=1, initial=0.0)
    unnoticed = few[apart <= AGREE * (1.0 + np.abs(minimum.residuals).max(initial=0.0))]
    nothing, angle = np.empty((0, 3), dtype=np.int64), np.zeros(len(places), dtype=bool)
    for k in unnoticed:
        own = places[k : k + 1]
        turn = _Map(targets=own, sources=own, sign=np.ones(1), shift=shifts[k : k + 1], about=nothing, kind=Twin.WOUND)
        candidate = turn.applied(result[None])[0]
        if _holds(equations, turn, result, places, angle) and agree(result, candidate):
            result = candidate
    return result


def plainer(equations: Assembled, first: Floats, second: Floats) -> bool:
    """Whether a person would rather write the point ``second`` (N,) than its twin ``first``.

    It is the one nearer to the starts of what differs. Without any, more numbers that change sign are positive in it
    (amplitudes), else it is nearer to 0.
    """
    layout = equations.layout
    angle = np.zeros(len(first), dtype=bool)
    angle[layout.number[layout.angle & (layout.number >= 0)]] = True
    middle = np.where(np.isfinite(layout.start), layout.start, 0.0)
    before, after = (
        np.abs(np.where(angle, np.remainder(x - middle + np.pi, 2 * np.pi) - np.pi, x - middle))
        for x in (first, second)
    )
    stated = np.isfinite(layout.start) & ~layout.guessed & (np.abs(after - before) > NEAR * (after + before))
    if stated.any():
        return bool(after[stated].sum() < before[stated].sum())
    places = layout.number[equations.free]
    places = places[places >= 0]
    a, b = first[places], second[places]
    opposite = ~angle[places] & (np.abs(a + b) <= NEAR * (np.abs(a) + np.abs(b))) & ~np.isfinite(layout.start[places])
    gain = int((b[opposite] > 0).sum()) - int((a[opposite] > 0).sum())
    return gain > 0 or (gain == 0 and bool(after[places].sum() < (1.0 - NEAR) * before[places].sum()))


def _nearest(equations: Assembled, places: Indices) -> Floats:
    """The starts of numbers, 0 where none is known."""
    start = equations.layout.start[places]
    return np.where(np.isfinite(start), start, 0.0)


def _holds(equations: Assembled, candidate: _Map, about: Floats, places: Indices, angle: Mask) -> bool:
    """Whether the map leaves all residuals as they are, up to their signs, at points scattered about one minimum."""
    random = np.random.default_rng(len(places))
    reach = np.where(angle, ANGLE, TRIED_SHARE * np.abs(about[places]))
    probes = np.tile(about, (PROBES, 1))
    probes[:, places] += reach * random.uniform(-1.0, 1.0, (PROBES, len(places)))
    scattered = probes[:, candidate.about] + ANGLE * random.uniform(-1.0, 1.0, (PROBES, *candidate.about.shape))
    probes[:, candidate.about] = scattered / np.linalg.norm(scattered, axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        before, after = equations.residuals_at(probes), equations.residuals_at(candidate.applied(probes))
    if not _alike(before, after):
        return False
    return candidate.kind is not Twin.WOUND or _holds_of_all_data(equations, candidate, probes, random)


def _holds_of_all_data(equations: Assembled, candidate: _Map, probes: Floats, random: np.random.Generator) -> bool:
    """Whether the map leaves what the equations say as it is at the ``probes`` (P, N) with other data, too.

    Clauses without rows have no other data: nothing tells a phase from a frequency in them.
    """
    turned = candidate.targets[(candidate.sign == 1.0) & (candidate.shift != 0.0)]
    with np.errstate(all="ignore"):
        for group in equations.groups:
            if not np.isin(group.places, candidate.targets).any():
                continue
            if group.positions is None and np.isin(group.places, turned).any():
                return False
            data = group.parameters
            size = np.where(data == 0.0, np.abs(data).max(axis=0, initial=0.0), data)
            other = replace(group, parameters=data + TRIED_SHARE * size * random.random(data.shape))
            found = (other.values_at(each).reshape(PROBES, -1) for each in (probes, candidate.applied(probes)))
            if not _alike(*found):
                return False
    return True


def _alike(before: Floats, after: Floats) -> bool:
    """Whether residuals (P, m) at several points are those at others up to the sign of each column."""
    finite = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    if finite.sum() < 2:
        return False
    before, after = before[finite], after[finite]
    allowed = AGREE * (1.0 + np.abs(before).max(initial=0.0))
    kept, turned = (np.abs(before - sign * after).max(axis=0) <= allowed for sign in (1.0, -1.0))
    return bool((kept | turned).all())


def separation(equations: Assembled, point: Floats, others: Floats) -> Floats:
    """How far other points (T, N) are from a point (N,), per free coordinate, shape (T, n), at least 0.

    ``point`` (T, N): each from one of its own. Angles differ by less than half a turn; rotations and directions by
    the angle between them, scales by the logarithm of their ratio, in each of their coordinates.
    """
    layout = equations.layout
    apart = np.zeros((len(others), len(layout.number)))
    plain = layout.number >= 0
    difference = others[:, layout.number[plain]] - point[..., layout.number[plain]]
    turn = np.remainder(difference + np.pi, 2 * np.pi) - np.pi
    apart[:, plain] = np.abs(np.where(layout.angle[plain], turn, difference))
    for curved in layout.curved:
        here, there = point[..., curved.numbers], others[:, curved.numbers]
        if curved.piece.size == 1:
            angle = np.abs(np.log(there / here))[:, :, 0]
        else:
            chord = np.linalg.norm(there - here, axis=2)
            if curved.piece.size == 4:
                chord = 2.0 * np.minimum(chord, np.linalg.norm(there + here, axis=2))
            angle = chord
        apart[:, curved.coordinates] = angle[:, :, None]
    return apart[:, equations.free]
