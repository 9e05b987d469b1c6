"""What a C compiler sees in a text: comments, strings and code, by the first phases of translation (C99, 5.1.1.2)."""

from __future__ import annotations

import re

TRIGRAPHS = {"=": "#", "/": "\\", "'": "^", "(": "[", ")": "]", "!": "|", "<": "{", ">": "}", "-": "~"}
PIECE = re.compile(
    r"""(?P<comment>/\*.*?\*/)
      | (?P<line>//[^\n]*)
      | (?P<string>"(?:\\.|[^"\\\n])*")
      | (?P<char>'(?:\\.|[^'\\\n])+')
      | (?P<blank>\s+)
      | (?P<code>[A-Za-z_]\w*|\.?[0-9](?:[eE][-+]|[\w.])*|.)""",
    re.DOTALL | re.VERBOSE,
)
ESCAPE = re.compile(rb"\\([0-7]{1,3}|.)", re.DOTALL)
LETTERS = {b"n": b"\n", b"t": b"\t", b"r": b"\r"}


def pieces(text: str) -> list[tuple[str, str | bytes]]:
    """The comments, strings (as bytes) and tokens of a C text in order; ``unended`` is a quote or comment left open."""
    whole = re.sub(r"\?\?([=/'()!<>-])", lambda found: TRIGRAPHS[found[1]], text)
    whole = whole.replace("\\\n", "")
    made = []
    for found in PIECE.finditer(whole):
        kind = found.lastgroup
        if kind == "string":
            made.append((kind, string_value(found[0])))
        elif kind == "code" and (found[0] in "\"'" or found[0] == "\\"):
            made.append(("unended", found[0]))
        elif kind != "blank":
            made.append((kind, found[0]))
    return made


def string_value(literal: str) -> bytes:
    """The bytes of a string literal in a file in UTF-8."""

    def value(found: re.Match[bytes]) -> bytes:
        if found[1][:1].isdigit():
            return bytes([int(found[1], 8)])
        return LETTERS.get(found[1], found[1])

    return ESCAPE.sub(value, literal[1:-1].encode())


def complaints(text: str) -> list[str]:
    """What ``-Wcomment -Wtrigraphs -Woverlength-strings`` and readers of comments would say."""
    found = [f"trigraph {each}" for each in re.findall(r"\?\?/\n", text)]
    found += [f"a line that goes on: {each!r}" for each in re.findall(r".{0,20}\\[ \t]*\n", text)]
    for kind, piece in pieces(text):
        if kind == "comment" and "/*" in piece[2:]:
            found.append(f"a comment in a comment: {piece!r}")
        if kind in ("comment", "code") and not piece.replace("\n", "").isprintable():
            found.append(f"not printable: {piece!r}")
        if kind == "string" and len(piece) > 4094:
            found.append(f"a string of {len(piece)} bytes")
        if kind in ("line", "unended"):
            found.append(f"{kind}: {piece!r}")
    return found
