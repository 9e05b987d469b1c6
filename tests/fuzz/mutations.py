"""Sound files made unsound: words deleted, doubled, exchanged, brackets lost, bytes changed."""

from __future__ import annotations

import re

from tests.fuzz.forms import DOUBTFUL, HUGE, WILD
from tests.trials.choices import Choices

WORD = re.compile(r'"(?:[^"\\]|\\.)*"|;[^\n]*|[()\[\]]|[^\s()\[\]"]+|\s+')
CELL = re.compile(r"[,\n]|[^,\n]+")
ODD_CELLS = [
    "",
    "nan",
    "NaN",
    "inf",
    "-1e400",
    "zzz",
    "1,5",
    "1;5",
    '"',
    '""',
    "\x00",
    "\r",
    "é",
    "1e308",
    "-0",
    " 7 ",
    "0x1",
]


def mutated_text(text: str, choices: Choices, words: re.Pattern[str] = WORD, extra: list[str] | None = None) -> str:
    """The text with one to four changes among its words."""
    parts = words.findall(text)
    others = extra if extra is not None else [*WILD, *HUGE, *DOUBTFUL]
    for _ in range(choices.count(1, 4)):
        if not parts:
            break
        here, there = choices.below(len(parts)), choices.below(len(parts))
        match choices.below(7):
            case 0:
                del parts[here]
            case 1:
                parts.insert(there, parts[here])
            case 2:
                parts[here], parts[there] = parts[there], parts[here]
            case 3:
                parts[here] = choices.one_of(others)
            case 4:
                parts.insert(here, f" {choices.one_of(others)} ")
            case 5:
                first, last = sorted((here, there))
                del parts[first : min(last, first + 12)]
            case _:
                first, last = sorted((here, there))
                parts[first:first] = parts[first : min(last, first + 30)]
    return "".join(parts)


def mutated_bytes(content: bytes, choices: Choices) -> bytes:
    """The content with one to four bytes changed, or cut off."""
    changed = bytearray(content)
    for _ in range(choices.count(1, 4)):
        if not changed:
            break
        position = choices.below(min(len(changed), 65_536))
        match choices.below(4):
            case 0:
                changed[position] = choices.below(256)
            case 1:
                del changed[position]
            case 2:
                changed.insert(position, choices.below(256))
            case _:
                del changed[position:]
    return bytes(changed)
