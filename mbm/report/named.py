"""An estimate or derived quantity as Python users hold it: numbers in the unit of the report, rotations, members."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.expression.units import parse_unit
from mbm.problem.naming import member_name
from mbm.report.elements import GEOMETRIC, shown_bounds, shown_numbers, shown_sigma
from mbm.report.intervals import Intervals, intervals, level_of
from mbm.report.types import DerivedValue, Estimate, Floats, Key, Kind, Mask
from mbm.rotations import matrix_of_quaternion, planar, signed
from mbm.scales import SI
from mbm.values import dataclass

ROTATED = frozenset({Kind.ROTATION, Kind.POSE, Kind.SIMILARITY})
MOVED = frozenset({Kind.POSE, Kind.SIMILARITY})


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """One estimate or derived quantity in the unit that it is reported in; ``si`` is the same in SI.

    ``value`` and ``sigma`` are NumPy arrays of the quantity's shape (0-d for a number), with a leading axis over
    ``keys`` for families; ``sigma`` is 0 where fixed, NaN where held at a bound or not determined by the data.
    Rotations are unit quaternions (w, x, y, z), or angles in the plane; poses add the translation, similarities the
    scale. Their ``sigma`` is that of rotation vector, translation and logarithm of the scale.
    ``coverage`` is that of the solve. ``item`` is what the report holds, ``place`` the member meant (None: all).
    """

    item: Estimate | DerivedValue
    coverage: float
    place: int | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as data, as the result does."""
        from mbm.report.pickled import item_as_data

        return type(self), (item_as_data(self.item, self.coverage), self.coverage, self.place)

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
        return replace(self, place=place)

    @property
    def name(self) -> str:
        """The name of the quantity, ``f[2]`` of a member."""
        name = self.item.quantity.name
        if self.place is None or self.item.keys is None:
            return name
        return member_name(name, self.item.keys[self.place])

    @property
    def kind(self) -> Kind:
        """What it is: a number, a vector, a pose …"""
        return self.item.quantity.kind

    @property
    def unit(self) -> str | None:
        """The unit of ``value``, ``sigma`` and all that comes from them; None where none is known."""
        return self.item.quantity.unit

    @property
    def keys(self) -> tuple[Key, ...] | None:
        """The keys of a family's members; None of anything else."""
        return self.item.keys if self.place is None else None

    @property
    def value(self) -> Floats:
        """The value."""
        quantity = self.item.quantity
        value = np.asarray(self.item.value)
        geometric = quantity.kind in GEOMETRIC
        shown = shown_numbers(quantity, value) if geometric else quantity.scale.from_si(value)
        return self._part(np.asarray(shown))

    @property
    def sigma(self) -> Floats:
        """The standard deviation."""
        return self._part(shown_sigma(self.item))

    @property
    def bounds(self) -> Floats | None:
        """Guaranteed bounds [low, high] along a last axis behind the shape of ``sigma``; None: the method gives none.

        Then ``value`` is their middle, and ``sigma`` NaN.
        """
        found = shown_bounds(self.item)
        return None if found is None else self._part(found)

    @property
    def fixed(self) -> Mask:
        """Which of the numbers that ``sigma`` has were not estimated."""
        fixed = self.item.fixed if isinstance(self.item, Estimate) else np.zeros(np.shape(shown_sigma(self.item)), bool)
        return np.asarray(fixed if self.place is None else fixed[self.place])

    @property
    def at_bound(self) -> Mask:
        """Which of them are held at a hard bound."""
        held = self.item.at_bound if isinstance(self.item, Estimate) else None
        if held is None:
            return np.zeros(np.shape(self.sigma), dtype=bool)
        return np.asarray(held if self.place is None else held[self.place])

    @property
    def reason(self) -> str | None:
        """Why a number is missing; None where all are there."""
        return self.item.reason

    @property
    def si(self) -> Named:
        """The same in SI."""
        quantity = self.item.quantity
        unit = None if quantity.unit is None or quantity.scale.is_si else parse_unit(quantity.unit)
        if unit is None:
            return self
        symbol = "rad" if quantity.kind is Kind.ANGLE else unit.dimension.symbol() or None
        return replace(self, item=replace(self.item, quantity=replace(quantity, unit=symbol, scale=SI)))

    @property
    def dof(self) -> Floats:
        """Effective degrees of freedom of ``sigma``, of its shape; infinite where the noise was stated."""
        return self._intervals(self.coverage).dof

    @property
    def k(self) -> Floats:
        """The coverage factor at the coverage of the solve, of the shape of ``sigma``."""
        return self._intervals(self.coverage).k

    @property
    def U(self) -> Floats:  # noqa: N802 - the GUM's name of it
        """The expanded uncertainty ``k·sigma``, in the unit of the value."""
        return self._intervals(self.coverage).expanded

    @property
    def interval_kind(self) -> NDArray[np.object_]:
        """How each interval was found: ``t``, ``profile`` or ``limited``; None where there is none."""
        return self._intervals(self.coverage).names()

    def interval(self, level: float | None = None) -> Floats:
        """Low and high end along the last axis, in the unit of the value; ``level`` None: the coverage of the solve.

        NaN where no standard deviation is known, infinite where a profile has no end.

        Raises:
            ValueError: the level is no number between 0 and 1.

        """
        found = self._intervals(level_of(level, self.coverage))
        return np.stack([found.low, found.high], axis=-1)

    @property
    def rotation(self) -> Floats:
        """The matrices (…, d, d) of rotations, poses and similarities: of families, one for each key.

        Raises:
            AttributeError: it is none of these.

        """
        held = self._of("rotation", ROTATED)
        return matrix_of_quaternion(held[..., :4]) if self._solid else planar(held[..., 0])

    @property
    def quaternion(self) -> Floats:
        """The unit quaternions (…, 4), w first, and not negative; rotations of the plane are about z.

        Of half turns, where w is 0, the first number that is not zero is positive.

        Raises:
            AttributeError: as for `rotation`.

        """
        held = self._of("quaternion", ROTATED)
        if self._solid:
            return held[..., :4]
        half = held[..., 0] / 2
        none = np.zeros_like(half)
        return signed(np.stack([np.cos(half), none, none, np.sin(half)], axis=-1))

    @property
    def translation(self) -> Floats:
        """The translations (…, d) of poses and similarities, in their unit.

        Raises:
            AttributeError: it is none of these.

        """
        first = 4 if self._solid else 1
        return self._of("translation", MOVED)[..., first : first + self.item.quantity.dimension]

    @property
    def scale(self) -> Floats:
        """The scales (…) of similarities.

        Raises:
            AttributeError: it is none.

        """
        return self._of("scale", frozenset({Kind.SIMILARITY}))[..., -1]

    @property
    def _solid(self) -> bool:
        return self.item.quantity.dimension == 3

    def _of(self, part: str, kinds: frozenset[Kind]) -> Floats:
        if self.kind not in kinds:
            article = "an" if self.kind is Kind.ANGLE else "a"
            raise AttributeError(f"`{self.name}` is {article} {self.kind.value}, which has no {part}")
        return self.value

    def _part(self, values: Floats) -> Floats:
        return values if self.place is None else values[self.place]

    def _intervals(self, level: float) -> Intervals:
        found = intervals(self.item, level)
        return found if self.place is None else found.at((self.place,))

    def __repr__(self) -> str:
        unit = "" if self.unit is None else f" {self.unit}"
        return f"<{self.name} = {_short(self.value)} ± {_short(self.sigma)}{unit}>"


def _short(values: Floats) -> str:
    """An array on one line: its first and last numbers where it is long."""
    text = np.array2string(values, precision=6, threshold=6, edgeitems=2, separator=", ")
    return " ".join(text.split())


def named(item: Estimate | DerivedValue, coverage: float) -> Named:
    """An estimate or a derived quantity of a solve with intervals of this ``coverage``."""
    return Named(item, coverage)
