"""What the process says when it ends (CONTRACT §1)."""

from __future__ import annotations

OK, ATTENTION, WRONG, INTERRUPTED = 0, 1, 2, 130
