"""Any text as part of a comment of C, or of the documentation of a Python function."""

from __future__ import annotations

import re

from mbm.text.shown import one_line

_MARKS = re.compile(r"\*(?=/)|/(?=\*)|\?\?(?=/)")
"""What would end a comment or begin another one, and the first half of the trigraph for a backslash."""


def in_comment(line: str) -> str:
    """A line of a C comment: marks of comments are taken apart, what is not printable is replaced.

    A backslash at its end stays: it must not stand at the end of a line.
    """
    return _MARKS.sub(lambda found: found[0] + " ", one_line(line))


def in_docstring(line: str) -> str:
    """A line between ``\"\"\"`` in Python, read back as the text itself but for what is not printable."""
    return one_line(line).replace("\\", "\\\\").replace('"', '\\"')
