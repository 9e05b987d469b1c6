"""Comments, long lines and arrays of C text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from mbm.target.c import number

WIDTH = 110


def comment(lines: Iterable[str]) -> str:
    """A comment of several lines; what would end it is taken apart."""
    text = [line.replace("*/", "* /").replace("/*", "/ *") for line in lines]
    if len(text) == 1 and len(text[0]) < WIDTH - 6:
        return f"/* {text[0]} */"
    found = []
    for line in text:
        indent = line[: len(line) - len(line.lstrip())]
        found += textwrap.wrap(
            line, WIDTH - 3, initial_indent="", subsequent_indent=indent + "    ", break_long_words=False
        ) or [""]
    return "/*\n" + "\n".join(f" * {line}".rstrip() for line in found) + "\n */"


def wrapped(lines: Iterable[str]) -> Iterator[str]:
    """Statements, long ones over several lines; broken at blanks only, which no token of ours contains."""
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
