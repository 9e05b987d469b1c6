"""Texts in generated C: comments and strings. The only way that a `Foreign` gets into a C file, but for identifiers.

Long lines and arrays are laid out here, too.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence

from mbm.emit.foreign import Word, told
from mbm.machine.c import number
from mbm.machine.escaping import in_comment
from mbm.scales import Scale

WIDTH = 110

LONGEST_STRING = 4095
"""Bytes of a string literal that every C99 compiler takes, the zero at its end included."""


def literal(*parts: Word) -> str:
    """An expression for a text of C, in UTF-8: only printable ASCII, no trigraph, no quote; longer ones as an array."""
    text = told(*parts).unescaped.encode()
    if len(text) < LONGEST_STRING:
        return '"' + "".join(map(_escaped, text)) + '"'
    return "(const char[]){" + ", ".join(f"'{_escaped(byte)}'" for byte in text) + ", 0}"


def _escaped(byte: int) -> str:
    return chr(byte) if 32 <= byte < 127 and chr(byte) not in "\"'\\?" else f"\\{byte:03o}"


def remark(*parts: Word) -> str:
    """A comment on one line."""
    return f"/* {in_comment(told(*parts).unescaped_line())} */"


def comment(lines: Iterable[Word]) -> str:
    """A comment of several lines, long ones over several."""
    text = [in_comment(told(line).unescaped_line()) for line in lines]
    if len(text) == 1 and len(text[0]) < WIDTH - 6:
        return f"/* {text[0]} */"
    found = []
    for line in text:
        indent = line[: len(line) - len(line.lstrip())]
        found += textwrap.wrap(
            line, WIDTH - 3, initial_indent="", subsequent_indent=indent + "    ", break_long_words=False
        ) or [""]
    return "/*\n" + "\n".join(f" * {_ended(line)}".rstrip() for line in found) + "\n */"


def _ended(line: str) -> str:
    """A line that the next one is no part of."""
    return f"{line} ." if line.endswith("\\") else line


_TEXTS = re.compile(r'"(?:\\.|[^"\\])*"|/\*.*?\*/', re.DOTALL)


def bare(text: str) -> str:
    """C text of this place without its strings and comments: what is looked for in it is code."""
    return _TEXTS.sub("", text)


def in_unit(value: str, scale: Scale) -> str:
    """The text of a value in SI, in a unit."""
    return f"{value if scale.zero == 0.0 else f'({value} - {number(scale.zero)})'} / {number(scale.factor)}"


def opening(name: str, what: Word) -> list[str]:
    """How ``NAME.c`` begins: ``what`` it does, and what it includes."""
    return [
        comment([what]),
        "",
        f'#include "{name}.h"',
        "",
        "#include <stddef.h>",
        "#include <string.h>",
        "",
        f'#include "{name}_kernels.h"',
        f'#include "{name}_solver.h"',
        "",
    ]


def status_text(name: str, sentences: Mapping[str, str]) -> Iterator[str]:
    """The function that says what a status means; ``sentences`` by the constants of C."""
    yield from (
        f"const char *{name}_status_text(int status)",
        "{",
        "    switch (status) {",
    )
    for constant, sentence in sentences.items():
        yield from (f"    case {constant}:", f'        return "{sentence}";')
    yield from ("    default:", '        return "no status";', "    }", "}")


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
