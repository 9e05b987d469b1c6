"""What can be wrong with a file that is to be read: codes and constructors."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from mbm.text.faults import shown
from mbm.text.suggest import closest
from mbm.text.types import Code, Diagnostic, Place

MISSING_FILE = Code(
    "missing-file",
    "A file that is to be read does not exist. Paths in a problem are relative to the problem file, paths on the "
    "command line to the folder that the command runs in.",
    "Correct the path; a table can also be given with `--data NAME=PATH`.",
)
NOT_A_FILE = Code(
    "not-a-file",
    "A path leads to a folder, a pipe or a device. Only ordinary files are read, because others may never end.",
    "Name a file; write what comes through a pipe to a file first.",
)
UNREADABLE_FILE = Code(
    "unreadable-file",
    "The operating system does not let a file be read.",
    "Look at the permissions of the file and of the folders above it.",
)
FILE_TOO_LARGE = Code(
    "file-too-large",
    "A file is larger than the bound that keeps a slip from filling the memory.",
    "Split the file, leave out columns that are not used, hand over the table through the Python API, or let mbm take"
    " more memory: `MBM_MEMORY=8GB mbm solve …`; files may have a third of it.",
)

TOO_MANY_FILES = Code(
    "too-many-files",
    "A problem names more files than are opened for one problem.",
    "Put definitions that are used together into one file, and tables of the same columns too.",
)
TOO_MUCH_MEMORY = Code(
    "too-much-memory",
    "What is asked for would take more memory than mbm takes: a table, a matrix, or all of them together. It is refused"
    " before the memory is taken.",
    "Use fewer rows or unknowns, or let mbm take more: `MBM_MEMORY=8GB mbm solve …`.",
)
BAD_MEMORY_BOUND = Code(
    "bad-memory-bound",
    "The environment variable `MBM_MEMORY` says how many bytes may be taken, and holds something else.",
    "Write a number with `KB`, `MB`, `GB` or `TB`, such as `MBM_MEMORY=4GB`.",
)

NEIGHBOURS_LOOKED_AT = 1000
"""Files of a folder that a missing file's name is compared with."""

LONGEST_PATH = 400
"""Characters of a path that a message shows: a path cut short is of little use."""


def missing_file(path: Path, place: Place) -> Diagnostic:
    """``place`` is where the file was asked for; the hint names a file of its folder that is spelt much the same."""
    name = shown(path.as_posix(), LONGEST_PATH)
    try:
        neighbours = [entry.name for entry in islice(path.parent.iterdir(), NEIGHBOURS_LOOKED_AT)]
    except (OSError, ValueError):  # the folder is missing too, or its name cannot be one
        message, near = f"the file `{name}` does not exist, nor does its folder", None
    else:
        message, near = f"the file `{name}` does not exist", closest(path.name, neighbours)
    hint = "check the path" if near is None else f"did you mean `{shown(near)}`?"
    return Diagnostic(code=MISSING_FILE, message=message, place=place, hint=hint)


def not_a_file(path: Path, place: Place, *, folder: bool) -> Diagnostic:
    """``path`` leads to a ``folder``, or to something else that is no ordinary file."""
    what, hint = ("a folder", "name a file in it") if folder else ("a pipe or a device", "write its content to a file")
    message = f"`{shown(path.as_posix(), LONGEST_PATH)}` is {what}, not a file"
    return Diagnostic(code=NOT_A_FILE, message=message, place=place, hint=hint)


def unreadable_file(path: Path, reason: str, place: Place) -> Diagnostic:
    """``reason`` is what the system says."""
    message = f"the file `{shown(path.as_posix(), LONGEST_PATH)}` cannot be read: {reason}"
    return Diagnostic(code=UNREADABLE_FILE, message=message, place=place, hint="check the path and its permissions")


def file_too_large(path: Path, size: int, largest: int, place: Place) -> Diagnostic:
    """``size`` bytes, where ``largest`` are read."""
    name = shown(path.as_posix(), LONGEST_PATH)
    message = f"the file `{name}` holds {size:,} bytes, more than the {largest:,} that are read"
    return Diagnostic(code=FILE_TOO_LARGE, message=message, place=place)


def too_many_files(place: Place, most: int) -> Diagnostic:
    """``place`` names the first file beyond the ``most`` that are opened."""
    message = f"this is one file more than the {most:,} that are opened for one problem"
    return Diagnostic(code=TOO_MANY_FILES, message=message, place=place)


def too_much_memory(what: str, needed: int, most: int, variable: str, place: Place | None) -> Diagnostic:
    """``what`` needs about ``needed`` bytes, ``most`` may be taken; ``variable`` of the environment raises that."""
    message = f"{what} needs about {in_units(needed)} of memory, and mbm takes {in_units(most)} at most"
    leading = 10 ** (len(str(needed)) - 1)
    wanted = in_units((needed // leading + 1) * leading).replace(" ", "").replace(",", "")
    hint = f"use less of it, or set the environment variable {variable}={wanted} if the machine has that much"
    return Diagnostic(code=TOO_MUCH_MEMORY, message=message, place=place, hint=hint)


def bad_memory_bound(variable: str, text: str) -> Diagnostic:
    """``text`` stands where a number of bytes is wanted."""
    message = f"`{variable}` is `{shown(text)}`, which is no number of bytes"
    return Diagnostic(code=BAD_MEMORY_BOUND, message=message, hint=f"write it as in `{variable}=4GB`")


def in_units(count: int) -> str:
    """A number of bytes as people read it: ``1.5 GB``, ``12 GB``, ``375 MB``."""
    for power, unit in ((12, "TB"), (9, "GB"), (6, "MB"), (3, "KB")):
        if count >= 10**power:
            value = count / 10**power
            return f"{value:.2f}".rstrip("0").rstrip(".") + f" {unit}" if value < 100 else f"{round(value):,} {unit}"
    return f"{count} bytes"
