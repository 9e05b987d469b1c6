"""A text of JSON (RFC 8259) → its values, with what makes a text none said in words."""

from __future__ import annotations

import json
from collections import Counter

from mbm.values import dataclass

MARKS = b",:[{"
"""Every value but the outermost stands behind one of these."""


class JsonError(Exception):
    """The text is no JSON. ``reason`` says why, ``line`` and ``column`` (from 1) where, as far as that is known."""

    def __init__(self, reason: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(reason)
        self.reason, self.line, self.column = reason, line, column


@dataclass(frozen=True, slots=True, kw_only=True)
class JsonText:
    """The value of a text, and the first name that an object of it holds ``twice``, of which the last counts."""

    value: object
    twice: str | None


def parsed(text: str) -> JsonText:
    """The value of a text; ``NaN`` and ``Infinity`` are taken for numbers.

    Raises:
        JsonError: it is no JSON, nested too deeply, or holds a whole number of more digits than Python converts.

    """
    twice: list[str] = []

    def as_dict(pairs: list[tuple[str, object]]) -> dict[str, object]:
        values = dict(pairs)
        if len(values) != len(pairs) and not twice:
            counts = Counter(name for name, _ in pairs)
            twice.append(next(name for name, count in counts.items() if count > 1))
        return values

    try:
        value: object = json.loads(text, object_pairs_hook=as_dict)
    except json.JSONDecodeError as error:
        raise JsonError(error.msg, error.lineno, error.colno) from None
    except RecursionError:
        raise JsonError("it is nested too deeply") from None
    except ValueError:
        raise JsonError("a whole number in it has thousands of digits") from None
    return JsonText(value=value, twice=twice[0] if twice else None)
