"""Long lines and arrays of C text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from mbm.emit.c.text import WIDTH, comment
from mbm.machine.c import number


def wrapped(lines: Iterable[str]) -> Iterator[str]:
    """Statements without strings or comments, long ones over several lines; broken at blanks only."""
    for line in lines:
        if len(line) <= WIDTH:
            yield line
            continue
        yield from textwrap.wrap(
            line, WIDTH, subsequent_indent="        ", break_long_words=False, break_on_hyphens=False
        )


def longs(name: str, values: Sequence[int], doc: str) -> str:
    """A constant array of integers."""
    return _array("long", name, [str(v) for v in values] or ["0"], doc)


def doubles(name: str, values: Sequence[float], doc: str) -> str:
    """A constant array of numbers."""
    return _array("double", name, [number(float(v)) for v in values] or ["0.0"], doc)


def _array(kind: str, name: str, values: Sequence[str], doc: str) -> str:
    body = textwrap.fill(", ".join(values), WIDTH, initial_indent="    ", subsequent_indent="    ")
    return f"{comment([doc])}\nstatic const {kind} {name}[{len(values)}] = {{\n{body}\n}};\n"
