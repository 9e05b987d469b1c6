"""Whether whoever waits for a solve wants it to end with the best point so far (Ctrl-C)."""

from __future__ import annotations


class Interruption:
    """Passed down to the loops of the solvers, which ask it between iterations; set from a signal handler.

    Until somebody listens, a request would be lost: whoever makes one should then end the program instead.
    """

    __slots__ = ("_listening", "_requested")

    def __init__(self) -> None:
        self._listening = False
        self._requested = False

    @property
    def listening(self) -> bool:
        """A solve has begun and will hear of a request."""
        return self._listening

    @property
    def requested(self) -> bool:
        """The solve is to end."""
        return self._requested

    def listen(self) -> None:
        """From now on, a request ends the solve."""
        self._listening = True

    def request(self) -> None:
        """Ask for the end."""
        self._requested = True
