"""Block problems made up by a generator, with the dense matrices to check them against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbm.sparse.structure import BlockFamily, Piece, Structure, structure

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Network:
    """``seen`` rows tie a station (4 columns), a point (3) and shared numbers (2); ``tied`` ones two stations."""

    stations: int = 6
    points: int = 60
    seen: int = 300
    tied: int = 20
    seed: int = 1

    @property
    def columns(self) -> int:
        return 4 * self.stations + 3 * self.points + 2

    def structure(self, free: NDArray[np.int64] | None = None) -> Structure:
        generator = np.random.default_rng(self.seed)
        families = (
            BlockFamily(first=0, members=self.stations, size=4),
            BlockFamily(first=4 * self.stations, members=self.points, size=3),
            BlockFamily(first=4 * self.stations + 3 * self.points, members=1, size=2),
        )
        stations = generator.integers(0, self.stations, self.seen)
        points = generator.permutation(np.arange(self.seen) % self.points)  # each of them often enough
        members = np.stack([stations, points, np.zeros(self.seen, dtype=np.int64)])
        ends = generator.integers(0, self.stations, (2, self.tied))
        pieces = (
            Piece(first=0, outputs=2, families=(0, 1, 2), members=members, starts=(0, 4, 7), width=9),
            Piece(first=2 * self.seen, outputs=3, families=(0, 0), members=ends, starts=(0, 4), width=8),
        )
        count = 2 * self.seen + 3 * self.tied
        return structure(families, pieces, np.arange(self.columns) if free is None else free, count)

    def values(self) -> list[Floats]:
        generator = np.random.default_rng(self.seed + 100)
        return [generator.standard_normal((self.seen, 2, 9)), generator.standard_normal((self.tied, 3, 8))]

    def jacobian(self) -> Floats:
        """Dense, written row by row."""
        found, (seen, tied) = self.structure(), self.values()
        dense = np.zeros((found.count, self.columns))
        for piece, values in zip(found.pieces, (seen, tied), strict=True):
            for row in range(piece.rows):
                for output in range(piece.outputs):
                    line = piece.first + row * piece.outputs + output
                    for k, family in enumerate(piece.families):
                        block = found.families[family]
                        first = block.first + piece.members[k, row] * block.size
                        start = piece.starts[k]
                        dense[line, first : first + block.size] += values[row, output, start : start + block.size]
        return dense
