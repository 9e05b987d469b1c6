"""How unknowns are described to the routines: ``unknowns`` has `UNKNOWN` integers for each, then their pieces.

Piece kinds are those of `mbm.solver.description`.
"""

from __future__ import annotations

UNKNOWN_SIZE = 0
"""Numbers of a member."""
UNKNOWN_FREEDOM = 1
"""Coordinates of a member."""
UNKNOWN_FAMILY = 2
"""1: members that no equation mentions are left out."""
UNKNOWN_POSITIVE = 3
UNKNOWN_PIECES = 4
UNKNOWN_PIECES_AT = 5
"""Offset in ``unknowns`` of the pieces, `PART` integers each."""
UNKNOWN = 6

PART_KIND = 0
PART_NUMBER = 1
PART_COORDINATE = 2
PART = 3
