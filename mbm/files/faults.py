"""What can be wrong with a file that is to be read or written: codes and constructors."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from mbm.text.faults import shown
from mbm.text.suggest import closest, did_you_mean
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
NOT_WRITABLE = Code(
    "not-writable",
    "A file, a folder or standard output that is to be written cannot be. What stood in a file before stands there "
    "still: files are written beside it, and take its place when they are whole.",
    "Check the path, its permissions and the space on the disk.",
)
WOULD_OVERWRITE = Code(
    "would-overwrite",
    "A file would be lost: a result would replace a problem, a file that the call reads, a file of somebody else or "
    "one that was changed since mbm wrote it. Nothing was written there.",
    "Name another file or folder.",
)
FOREIGN_FOLDER = Code(
    "foreign-folder",
    "The folder that a command is to write holds files that this command did not write. Which ones it wrote is said "
    "by the list that it leaves there (`.mbm-compile`, `.mbm-simulate`, `.mbm-write`).",
    "Choose another folder, or write into this one with `--force`: files of the same name are replaced, others stay.",
)
EXISTS_ALREADY = Code(
    "exists-already",
    "`mbm new` never overwrites: the folder holds files already, or the name is that of a file or a link.",
    "Choose another name, or empty the folder.",
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
    hint = did_you_mean(near and shown(near), "check the path")
    return Diagnostic(code=MISSING_FILE, message=message, place=place, hint=hint)


def not_a_file(path: Path, place: Place, *, folder: bool) -> Diagnostic:
    """``path`` leads to a ``folder``, or to something else that is no ordinary file."""
    what, hint = ("a folder", "name a file in it") if folder else ("a pipe or a device", "write its content to a file")
    return Diagnostic(
        code=NOT_A_FILE,
        message=f"`{shown(path.as_posix(), LONGEST_PATH)}` is {what}, not a file",
        place=place,
        hint=hint,
    )


def unreadable_file(path: Path, reason: str, place: Place) -> Diagnostic:
    """``reason`` is what the system says."""
    return Diagnostic(
        code=UNREADABLE_FILE,
        message=f"the file `{shown(path.as_posix(), LONGEST_PATH)}` cannot be read: {reason}",
        place=place,
        hint="check the path and its permissions",
    )


def file_too_large(path: Path, size: int, largest: int, place: Place) -> Diagnostic:
    """``size`` bytes, where ``largest`` are read."""
    name = shown(path.as_posix(), LONGEST_PATH)
    return Diagnostic(
        code=FILE_TOO_LARGE,
        message=f"the file `{name}` holds {size:,} bytes, more than the {largest:,} that are read",
        place=place,
    )


def not_writable(path: str | Path, reason: str) -> Diagnostic:
    """``reason`` is what speaks against it, often in the words of the system."""
    return Diagnostic(
        code=NOT_WRITABLE,
        message=f"`{_named(path)}` cannot be written: {reason}",
        hint="check the path, its permissions and the space on the disk",
    )


def output_not_writable(reason: str) -> Diagnostic:
    """Standard output takes nothing."""
    return Diagnostic(
        code=NOT_WRITABLE,
        message=f"standard output cannot be written: {reason}",
        hint="look at where it leads, and at the space there",
    )


def reason_of(error: OSError) -> str:
    """What the system says, without the numbers and names that Python adds."""
    return error.strerror or type(error).__name__


def would_overwrite(target: str, read: str, role: str | None) -> Diagnostic:
    """``target`` is the file that was read as ``read``, for what ``role`` says."""
    what = role or "a file that the problem reads"
    same = "" if Path(target) == Path(read) else f"`{_named(read)}`, "
    return Diagnostic(
        code=WOULD_OVERWRITE,
        message=f"`{_named(target)}` is {same}{what}: it would be lost; nothing was written there",
        hint="name another file",
    )


def would_replace_source(target: str) -> Diagnostic:
    """A result would be written over a file that is called as problems are."""
    return Diagnostic(
        code=WOULD_OVERWRITE,
        message=f"`{_named(target)}` is a problem file, which no result replaces; nothing was written there",
        hint="name another file",
    )


def written_twice(first: str, second: str) -> Diagnostic:
    """Two outputs of one call are one file."""
    return Diagnostic(
        code=WOULD_OVERWRITE,
        message=f"two outputs go to one file, {_both(first, second)}: one of them would be lost; nothing was written",
        hint="give each output a file of its own",
    )


def one_folder(first: str, second: str) -> Diagnostic:
    """Two outputs of one call are one folder."""
    message = f"two outputs go to one folder, {_both(first, second)}: one of them would be lost; nothing was written"
    return Diagnostic(code=WOULD_OVERWRITE, message=message, hint="give each output a folder of its own")


def _both(first: str, second: str) -> str:
    return f"`{_named(second)}`" if first == second else f"`{_named(first)}` and `{_named(second)}`"


def not_our_document(target: str) -> Diagnostic:
    """Diagnostics, or what the cache holds, are to be written over something that mbm did not write."""
    message = (
        f"`{_named(target)}` holds something else than a document that mbm wrote: it would be lost; nothing was "
        "written there"
    )
    return Diagnostic(code=WOULD_OVERWRITE, message=message, hint="name another file, or remove this one first")


def foreign_folder(path: str | Path, file: str, command: str) -> Diagnostic:
    """``file`` is what stands in the folder and was not written by ``command``."""
    return Diagnostic(
        code=FOREIGN_FOLDER,
        message=f"`{_named(path)}` holds files that `{command}` did not write, such as `{_named(file)}`",
        hint="choose another folder, or `--force`",
    )


def unreadable_list(path: str | Path, manifest: str, command: str) -> Diagnostic:
    """The list of what ``command`` wrote is damaged, or of a version that kept no digests."""
    return Diagnostic(
        code=FOREIGN_FOLDER,
        message=f"`{_named(path)}` does not say which of its files `{command}` wrote: `{manifest}` is damaged, or of "
        "an earlier version",
        hint="remove the folder, choose another one, or `--force`",
    )


def foreign_file(path: str, command: str) -> Diagnostic:
    """In a folder that ``command`` wrote, a new file of its would replace one that it did not write."""
    return Diagnostic(
        code=WOULD_OVERWRITE,
        message=f"`{_named(path)}` was not written by `{command}`: it would be lost; nothing was written",
        hint="move it away, choose another folder, or `--force`",
    )


def changed_file(path: str, command: str) -> Diagnostic:
    """Somebody changed a file that ``command`` wrote."""
    return Diagnostic(
        code=WOULD_OVERWRITE,
        message=f"`{_named(path)}` was changed since `{command}` wrote it: the changes would be lost; nothing was "
        "written",
        hint="move it away, choose another folder, or `--force`",
    )


def symbolic_link(path: Path) -> Diagnostic:
    """In a folder that is written, or instead of it, there is a link."""
    return Diagnostic(
        code=NOT_WRITABLE,
        message=f"`{_named(path)}` cannot be written: it is a symbolic link",
        hint="name the folder that is meant, or remove the link",
    )


def exists_already(path: str | Path) -> Diagnostic:
    """The folder of a new problem holds something."""
    return Diagnostic(
        code=EXISTS_ALREADY,
        message=f"`{_named(path)}` exists already",
        hint="choose another name; nothing is overwritten",
    )


def _named(path: str | Path) -> str:
    return shown(path.as_posix() if isinstance(path, Path) else path, LONGEST_PATH)


def too_many_files(place: Place, most: int) -> Diagnostic:
    """``place`` names the first file beyond the ``most`` that are opened."""
    return Diagnostic(
        code=TOO_MANY_FILES,
        message=f"this is one file more than the {most:,} that are opened for one problem",
        place=place,
    )


def too_much_memory(what: str, needed: int, most: int, variable: str, place: Place | None) -> Diagnostic:
    """``what`` needs about ``needed`` bytes, ``most`` may be taken; ``variable`` of the environment raises that."""
    message = f"{what} needs about {in_units(needed)} of memory, and mbm takes {in_units(most)} at most"
    leading = 10 ** (len(str(needed)) - 1)
    wanted = in_units((needed // leading + 1) * leading).replace(" ", "").replace(",", "")
    return Diagnostic(
        code=TOO_MUCH_MEMORY,
        message=message,
        place=place,
        hint=f"use less of it, or set the environment variable {variable}={wanted} if the machine has that much",
    )


def bad_memory_bound(variable: str, text: str) -> Diagnostic:
    """``text`` stands where a number of bytes is wanted."""
    return Diagnostic(
        code=BAD_MEMORY_BOUND,
        message=f"`{variable}` is `{shown(text)}`, which is no number of bytes",
        hint=f"write it as in `{variable}=4GB`",
    )


def in_units(count: int) -> str:
    """A number of bytes as people read it: ``1.5 GB``, ``12 GB``, ``375 MB``."""
    for power, unit in ((12, "TB"), (9, "GB"), (6, "MB"), (3, "KB")):
        if count >= 10**power:
            value = count / 10**power
            return f"{value:.2f}".rstrip("0").rstrip(".") + f" {unit}" if value < 100 else f"{round(value):,} {unit}"
    return f"{count} bytes"
