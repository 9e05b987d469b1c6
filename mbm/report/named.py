"""An estimate or derived quantity as Python users hold it: numbers in the unit of the report, rotations, members."""

from __future__ import annotations

import numpy as np

from mbm.problem.naming import member_name
from mbm.report.elements import shown_bounds, shown_sigma
from mbm.report.geometric import GEOMETRIC, number_factors
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
    none. Then ``value`` is their middle, and ``sigma`` NaN.
    """

    name: str
    value: Floats
    sigma: Floats
    unit: str | None
    keys: tuple[Key, ...] | None
    kind: Kind
    dimension: int
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
            bounds=None if self.bounds is None else self.bounds[place],
        )

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


def named(item: Estimate | DerivedValue) -> Named:
    """An estimate or a derived quantity of a solve."""
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
        bounds=shown_bounds(item),
    )
