"""Pose graph files with other measurements: the lines of edges get new numbers, all else stays as it was written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mbm.data.content import lines_in
from mbm.problem.tables import Numbers

MEASURED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "EDGE_SE2": ("dx", "dy", "dtheta"),
        "EDGE2": ("dx", "dy", "dtheta"),
        "EDGE_SE3:QUAT": ("dx", "dy", "dz", "dqx", "dqy", "dqz", "dqw"),
    }
)
"""The columns of measurements in the order in which a line has them, behind the numbers of the two vertices."""

FIRST = 3
"""Place of the first measured number in a line: behind its tag and the two vertices."""


def with_measurements(text: str, rows: Sequence[int], columns: Mapping[str, Numbers]) -> str | None:
    """``text`` of a g2o or TORO file with ``columns`` in its ``rows`` (lines from 1); None if one is written otherwise.

    The information of an edge stays as the file has it.
    """
    lines = lines_in(text)
    for position, row in enumerate(rows):
        words = lines[row - 1].split()
        names = MEASURED.get(words[0] if words else "")
        if names is None or not set(columns) <= set(names):
            return None
        for place, name in enumerate(names, FIRST):
            if name in columns:
                words[place] = repr(float(columns[name][position]))
        lines[row - 1] = " ".join(words)
    return "\n".join(lines) + "\n"
