"""Names of the problem → names that C and Python take, each once."""

from __future__ import annotations

import keyword
import re
import unicodedata

_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while main data
result workspace inputs outputs rows row status cost dof sigma0 covariance iterations evaluations coordinates acos asin
atan atan2 ceil cos cosh erf exp expm1 fabs floor fmax fmin fmod gamma hypot j0 j1 jn log log1p pow remainder sin sinh
sqrt tan tanh y0 y1 yn tables constants numbers solve point sigmas free freedom robust_cost np math sys os"""
RESERVED = frozenset(_WORDS.split())
"""Words that C, Python or the printed text itself use."""


class Identifiers:
    """Gives out names, each once; local to one blueprint."""

    def __init__(self, taken: frozenset[str] = RESERVED) -> None:
        self._taken = set(taken)

    def made(self, name: str) -> str:
        """A name like ``name`` that nobody has yet."""
        wanted = identifier(name)
        if keyword.iskeyword(wanted) or wanted in self._taken:
            wanted += "_"
        found, number = wanted, 2
        while found in self._taken:
            found, number = f"{wanted.rstrip('_')}_{number}", number + 1
        self._taken.add(found)
        return found


def identifier(name: str) -> str:
    """Letters of other alphabets by their names (``σ`` → ``sigma``), what is no letter or digit as ``_``."""
    parts = []
    for character in name:
        if character.isascii():
            parts.append(character if character.isalnum() else "_")
            continue
        words = unicodedata.name(character, "").lower().split()
        parts.append(words[-1] if "letter" in words else "_")
    joined = re.sub(r"_+", "_", "".join(parts)).strip("_") or "unnamed"
    return f"n{joined}" if joined[0].isdigit() else joined
