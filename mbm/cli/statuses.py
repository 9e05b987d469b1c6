"""Exit statuses that no answer decides."""

from __future__ import annotations

WRONG = 2
"""The call, the problem or its data are wrong."""

INTERRUPTED = 130
"""As a shell says it: 128 and the number of the signal."""
