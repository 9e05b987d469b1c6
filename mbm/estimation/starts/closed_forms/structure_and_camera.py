"""Photographs of points whose places are not known, from poses that are not known, by cameras that are not known."""

from __future__ import annotations

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.cameras import ONE_FOCAL, Camera, cameras_of
from mbm.estimation.starts.closed_forms.chains import is_pose, with_poses
from mbm.estimation.starts.closed_forms.numerics.structure import LEAST_RAYS, structures
from mbm.estimation.starts.closed_forms.planar_calibration import PROBE, lines_of
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.structure_from_motion import (
    is_cloud,
    members_of,
    photographs,
    placed,
    squares,
)
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.values import dataclass

LENGTHS = np.geomspace(0.35, 14.0, 14)
"""Focal lengths that are tried, beside the extent of the image: from 110° to 4° across; each third more is one."""

FINER = np.geomspace(0.8, 1.25, 5)
"""Beside the best of them; a ninth apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncalibrated:
    """``cameras`` with the ``extents`` and ``middles`` (k, 2) of their images; ``cloud`` is the number of the points'
    unknown, ``inner`` those of it and of the poses.
    """

    cameras: tuple[Camera, ...]
    extents: tuple[float, ...]
    middles: Floats
    cloud: int
    inner: tuple[int, ...]

    def numbers(self, situation: Situation, length: float) -> Floats:
        """All numbers (N,), with focal lengths of so many extents, the centre in the middle, and no distortion."""
        numbers = situation.numbers.copy()
        for camera, extent, middle in zip(self.cameras, self.extents, self.middles, strict=True):
            focal = length * extent * camera.signs(situation)
            kinds = np.array(camera.kinds)
            centre = middle[np.clip(kinds - ONE_FOCAL - 1, 0, 1)]
            central = (kinds == ONE_FOCAL + 1) | (kinds == ONE_FOCAL + 2)
            numbers[camera.places] = np.where(kinds <= ONE_FOCAL, focal, np.where(central, centre, 0.0))
        return numbers


@dataclass(frozen=True, slots=True)
class StructureAndCamera:
    """`StructureFromMotion` with each of some focal lengths, of which the one that suits the images best is taken."""

    name: str = "structure-and-camera"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that see members of a family of points, from unknown poses, by cameras that have unknown numbers."""
        if candidate.paired or not any(map(is_pose, candidate.entries)):
            return None
        for number in candidate.support.entries:
            if is_cloud(situation.layout.entries[number]):
                found = _uncalibrated(situation, candidate, number)
                if found is not None:
                    rows = Rows.without_numbers(len(candidate.places), 2)
                    return Plan(form=self, candidate=candidate, rows=rows, minimal=2 * LEAST_RAYS, data=found)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """The best of all focal lengths, (1, 1, K·s); it takes all rows."""
        del subsets
        best, found = np.inf, np.full(plan.candidate.places.size, np.nan)
        lengths, most = LENGTHS, LENGTHS[0]
        for _ in range(2):
            for length in lengths:
                for cost, numbers in _ways(plan, float(length)):
                    if cost < best:
                        best, found, most = cost, numbers[plan.candidate.places].ravel(), length
            lengths = most * FINER
        return found[None, None]


def _uncalibrated(situation: Situation, candidate: Candidate, cloud: int) -> Uncalibrated | None:
    """The cameras of a candidate whose points are this unknown (by number); None if they are none."""
    layout = situation.layout
    others = tuple(e for e in candidate.support.entries if e != cloud)
    inner = tuple(e for e in candidate.support.entries if e == cloud or is_pose(layout.entries[e]))
    if len(inner) > len(others):
        return None
    points: Entry = layout.entries[cloud]
    probed = situation.numbers.copy()
    absent = np.isnan(probed[points.range])
    probed[points.range] = np.where(
        absent, np.random.default_rng(0).uniform(-1.0, 1.0, len(absent)), probed[points.range]
    )
    free = situation.with_numbers(probed)
    takers = np.unique(np.stack([members_of(candidate, layout.entries[e]) for e in others], axis=1), axis=0)
    seen = free.candidate(others, takers)
    cameras, extents, middles = list[Camera](), list[float](), list[Floats]()
    for camera in () if seen is None else cameras_of(seen)[1]:
        made, images = camera, list[Floats]()
        nothing = free.numbers.copy()
        nothing[camera.places] = 0.0
        free = free.with_numbers(nothing)
        for poses, lines in lines_of(free, camera).items():
            recognised = camera.recognised(free, lines, poses)
            if recognised is None or (made.kinds and made.kinds != recognised[0].kinds):
                return None
            made = recognised[0]
            shown = made.rows_of(with_poses(free, poses, PROBE), lines)
            images.append(-recognised[1] * shown.values(np.zeros(len(made.places))))
        image = np.concatenate(images)
        cameras.append(made)
        extents.append(float(np.ptp(image, axis=0).max()))
        middles.append((image.min(axis=0) + image.max(axis=0)) / 2)
    if not cameras or not all(
        extent > 0.0 and made.unknown().any() for extent, made in zip(extents, cameras, strict=True)
    ):
        return None
    return Uncalibrated(
        cameras=tuple(cameras), extents=tuple(extents), middles=np.array(middles), cloud=cloud, inner=inner
    )


def _ways(plan: Plan, length: float) -> list[tuple[float, Floats]]:
    """The ways in which photographs and points may lie with a focal length: what they cost, and all numbers (N,)."""
    seen: Uncalibrated = plan.data
    given = plan.candidate.situation.with_numbers(seen.numbers(plan.candidate.situation, length))
    entries = [given.layout.entries[e] for e in seen.inner]
    members = np.unique(np.stack([members_of(plan.candidate, entry) for entry in entries], axis=1), axis=0)
    inner = given.candidate(seen.inner, members)
    found = None if inner is None else photographs(given, inner, seen.cloud)
    ways = list[tuple[float, Floats]]()
    if found is None:
        return ways
    for each in structures(found.views, found.cloud.members):
        numbers = placed(found, given, each)
        if not bool(np.isnan(numbers[plan.candidate.places]).any()):
            ways.append((float(sum(squares(group, numbers[None])[0] for group in given.groups)), numbers))
    return ways


STRUCTURE_AND_CAMERA = StructureAndCamera()
