"""What ``or`` makes one of."""

from __future__ import annotations

from abc import abstractmethod

from mbm.language.values import Call, Placeable, Value


class Unitable(Placeable):
    """What has a union with others of its kind."""

    __slots__ = ()

    @abstractmethod
    def united(self, call: Call) -> Value:
        """What ``(or …)`` of it, the first argument, and the others is.

        Raises:
            MbmError: one of the others does not go with it.

        """
