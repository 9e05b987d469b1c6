"""An estimate or derived quantity as Python users hold it: numbers in the unit of the report, rotations, members."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mbm.problem.naming import member_name
from mbm.report.elements import shown_bounds, shown_sigma
from mbm.report.geometric import GEOMETRIC, number_factors
from mbm.report.intervals import Intervals, intervals
from mbm.report.types import DerivedValue, Estimate, Floats, Key, Kind
from mbm.rotations import matrix_of_quaternion, planar
from mbm.values import dataclass

ROTATED = frozenset({Kind.ROTATION, Kind.POSE, Kind.SIMILARITY})
MOVED = frozenset({Kind.POSE, Kind.SIMILARITY})


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """One estimate or derived quantity in the unit that it is reported in.

    ``value`` and ``sigma`` are NumPy arrays of the quantity's shape (0-d for a number), with a leading axis over
    ``keys`` for families; ``sigma`` is 0 where fixed, NaN where held at a bound or not determined by the data.
    Rotations are unit quaternions (w, x, y, z), or angles in the plane; poses add the translation, similarities the
    scale. Their ``sigma`` is that of rotation vector, translation and logarithm of the scale.
    ``bounds`` [low, high] along a last axis behind the shape of ``sigma`` are guaranteed ones; None: the method gives
    none. Then ``value`` is their middle, and ``sigma`` NaN. ``coverage`` is that of the solve, ``intervals``
    makes those of a level.
    """

    name: str
    value: Floats
    sigma: Floats
    unit: str | None
    keys: tuple[Key, ...] | None
    kind: Kind
    dimension: int
    coverage: float
    intervals: Callable[[float], Intervals] = field(repr=False)
    bounds: Floats | None = None

    def __getitem__(self, key: Key) -> Named:
        """The member of a family by its key; whole numbers may be integers.

        Raises:
            TypeError: it is no family.
            KeyError: the family has no such member.

        """
        if self.keys is None:
            message = f"`{self.name}` is one {self.kind.value}, not a family: its numbers are in `.value`"
            raise TypeError(message)
        try:
            place = self.keys.index(key)
        except ValueError:
            message = f"`{self.name}` has no member {key!r}; its {len(self.keys):,} keys are in `.keys`"
            raise KeyError(message) from None
        return Named(
            name=member_name(self.name, key),
            value=self.value[place],
            sigma=self.sigma[place],
            unit=self.unit,
            keys=None,
            kind=self.kind,
            dimension=self.dimension,
            coverage=self.coverage,
            intervals=partial(_of_member, self.intervals, place),
            bounds=None if self.bounds is None else self.bounds[place],
        )

    @property
    def dof(self) -> Floats:
        """Effective degrees of freedom of ``sigma``, of its shape; infinite where the noise was stated."""
        return self.intervals(self.coverage).dof

    @property
    def k(self) -> Floats:
        """The coverage factor at the coverage of the solve, of the shape of ``sigma``."""
        return self.intervals(self.coverage).k

    @property
    def U(self) -> Floats:  # noqa: N802 - the GUM's name of it
        """The expanded uncertainty ``k·sigma``, in the unit of the value."""
        return self.intervals(self.coverage).expanded

    @property
    def interval_kind(self) -> NDArray[np.object_]:
        """How each interval was found: ``t``, ``profile`` or ``limited``; None where there is none."""
        return self.intervals(self.coverage).names()

    def interval(self, level: float | None = None) -> Floats:
        """Low and high end along the last axis, in the unit of the value; ``level`` None: the coverage of the solve.

        NaN where no standard deviation is known, infinite where a profile has no end.

        Raises:
            ValueError: the level does not lie between 0 and 1.

        """
        level = self.coverage if level is None else level
        if not 0.0 < level < 1.0:
            message = f"the level of an interval lies between 0 and 1, and {level!r} does not"
            raise ValueError(message)
        found = self.intervals(level)
        return np.stack([found.low, found.high], axis=-1)

    @property
    def rotation(self) -> Floats:
        """The matrices (…, d, d) of rotations, poses and similarities: of families, one for each key.

        Raises:
            AttributeError: it is none of these.

        """
        held = self._of("rotation", ROTATED)
        return matrix_of_quaternion(held[..., :4]) if self.dimension == 3 else planar(held[..., 0])

    @property
    def quaternion(self) -> Floats:
        """The unit quaternions (…, 4), w first; rotations of the plane are about z.

        Raises:
            AttributeError: as for `rotation`.

        """
        held = self._of("quaternion", ROTATED)
        if self.dimension == 3:
            return held[..., :4]
        half = held[..., 0] / 2
        none = np.zeros_like(half)
        return np.stack([np.cos(half), none, none, np.sin(half)], axis=-1)

    @property
    def translation(self) -> Floats:
        """The translations (…, d) of poses and similarities, in their unit.

        Raises:
            AttributeError: it is none of these.

        """
        first = 4 if self.dimension == 3 else 1
        return self._of("translation", MOVED)[..., first : first + self.dimension]

    @property
    def scale(self) -> Floats:
        """The scales (…) of similarities.

        Raises:
            AttributeError: it is none.

        """
        return self._of("scale", frozenset({Kind.SIMILARITY}))[..., -1]

    def _of(self, part: str, kinds: frozenset[Kind]) -> Floats:
        if self.kind not in kinds:
            message = f"`{self.name}` is a {self.kind.value}, which has no {part}"
            raise AttributeError(message)
        return self.value


def _of_member(family: Callable[[float], Intervals], place: int, level: float) -> Intervals:
    return family(level).at((place,))


def named(item: Estimate | DerivedValue, coverage: float) -> Named:
    """An estimate or a derived quantity of a solve with intervals of this ``coverage``."""
    quantity = item.quantity
    factor = number_factors(quantity) if quantity.kind in GEOMETRIC else quantity.factor
    return Named(
        name=quantity.name,
        value=np.asarray(item.value / factor),
        sigma=shown_sigma(item),
        unit=quantity.unit,
        keys=item.keys,
        kind=quantity.kind,
        dimension=quantity.dimension,
        coverage=coverage,
        intervals=partial(intervals, item),
        bounds=shown_bounds(item),
    )
