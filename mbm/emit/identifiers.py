"""Names of the problem → names that C and Python take, each once: only here a `Foreign` becomes a name or a file.

A name that is wanted is free if all *forms* are that generated text makes of it: ``result.a`` and ``result.a_sigma``
are two members of a struct. What stands before the point is where they must differ.
"""

from __future__ import annotations

import keyword
import re
import unicodedata

from mbm.emit.foreign import Foreign
from mbm.emit.reserved import MACROS, RESERVED

LONGEST = 100
"""Characters of a name: file systems take twice as many, with what is added."""


class Identifiers:
    """Gives out names, each once; local to one blueprint."""

    def __init__(self, taken: frozenset[str] = frozenset()) -> None:
        """``taken`` are forms."""
        self._taken = set(taken)

    def made(self, name: Foreign | str, *forms: str, words: frozenset[str] = RESERVED) -> str:
        """A name like ``name`` that is none of ``words`` and whose ``forms`` nobody has yet.

        Forms have ``{name}``, or the same in small or capital letters: ``{lower}``, ``{upper}``.
        """
        wanted = identifier(name)
        found, number = wanted, 1
        while keyword.iskeyword(found) or found in words or not self._free(made := _forms(found, forms or ("{name}",))):
            found = f"{wanted}_" if number == 1 else f"{wanted}_{number}"
            number += 1
        self._taken |= made
        return found

    def _free(self, forms: set[str]) -> bool:
        return self._taken.isdisjoint(forms) and MACROS.isdisjoint(form.rpartition(".")[2] for form in forms)


def _forms(name: str, forms: tuple[str, ...]) -> set[str]:
    return {form.format(name=name, lower=name.lower(), upper=name.upper()) for form in forms}


def identifier(name: Foreign | str) -> str:
    """Letters of other alphabets by their names (``σ`` → ``sigma``), what is no letter or digit as ``_``."""
    parts = []
    for character in name.unescaped if isinstance(name, Foreign) else name:
        if character.isascii():
            parts.append(character if character.isalnum() else "_")
            continue
        words = unicodedata.name(character, "").lower().split()
        parts.append(re.sub(r"\W", "_", words[-1]) if "letter" in words else "_")
    joined = re.sub(r"_+", "_", "".join(parts))[:LONGEST].strip("_") or "unnamed"
    return f"n{joined}" if joined[0].isdigit() else joined
