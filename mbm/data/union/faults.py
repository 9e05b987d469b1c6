"""What may be wrong with tables that are put end to end, and with the pattern that names their files."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.data.faults import short_text
from mbm.problem.tables import SOURCE
from mbm.text.types import Code, DataPlace, Diagnostic, Label, Place

SOURCE_COLUMN = Code(
    "source-column",
    "A table of a union, or a file of a pattern, has a column `source` of its own. The union needs the name: it says"
    " which table or file a row is from.",
    "Rename the column: in the files, or in the table's data clause with `:columns ((new source))`.",
)
DIFFERENT_COLUMNS = Code(
    "different-columns",
    "Tables that are put end to end have different columns, or a column holds numbers in one and texts in another.",
    "Give all of them the same columns, in any order; `:columns` of a data clause renames.",
)
NO_MATCH = Code(
    "no-match",
    "No file has a name that fits the pattern of a data clause, or its folder is not there.",
    "Correct the pattern. It is relative to the problem file; `*` stands for any characters, `?` for one.",
)
BAD_PATTERN = Code(
    "bad-pattern",
    "A pattern, or a union of patterns, names files in a way that leaves open which of them a row is from.",
    "Write `*` and `?` in the name of the file only, and give the files names that differ before their endings.",
)
TOO_MANY_MATCHES = Code(
    "too-many-matches",
    "A pattern fits more files than are read for one table.",
    "Narrow the pattern, or join the files before.",
)


def source_column(place: Place, name: str) -> Diagnostic:
    """The table or file ``name`` has a column of the name that the union gives one."""
    return Diagnostic(
        code=SOURCE_COLUMN,
        message=f"`{short_text(name)}` has a column `{SOURCE}`, which a union adds to say where a row is from",
        place=place,
        hint="rename it in the file, or by `:columns` of its table",
    )


def different_columns(
    places: tuple[DataPlace, DataPlace], tables: tuple[str, str], columns: Iterable[str], others: Iterable[str]
) -> Diagnostic:
    """The ``columns`` of the first of two ``tables`` are not those of the other."""
    here, there = set(columns), set(others)
    name, other = _called(places, tables)
    lacks, more = sorted(there - here), sorted(here - there)
    if lacks:
        said = f"has no column `{short_text(lacks[0])}`, which `{other}` has"
    elif more:
        said = f"has a column `{short_text(more[0])}`, which `{other}` has not"
    else:
        said = f"has other matrices in its rows than `{other}`"
    return Diagnostic(
        code=DIFFERENT_COLUMNS,
        message=f"`{name}` {said}",
        place=places[0],
        hint="tables of a union have the same columns",
    )


def mixed_column(place: DataPlace, cell: str, number: DataPlace, tables: tuple[str, str]) -> Diagnostic:
    """The text ``cell`` stands in a column that holds a number at ``number``; ``tables`` hold the one and the other."""
    first, other = _called((place, number), tables)
    message = (
        f"row {place.counted} of `{short_text(first)}` holds the text `{short_text(cell)}` in column `{place.column}`,"
        f" which holds numbers in `{short_text(other)}`"
    )
    return Diagnostic(
        code=DIFFERENT_COLUMNS, message=message, place=place, labels=(Label(number, "a number here"),),
        hint="a column is numeric in all tables of a union, or in none",
    )  # fmt: skip


def _called(places: tuple[DataPlace, DataPlace], tables: tuple[str, str]) -> tuple[str, str]:
    """Two tables in words: files by their paths, tables in the text of a problem by their names."""
    first, second = (name if at.number else at.file for at, name in zip(places, tables, strict=True))
    return first, second


def no_match(place: Place, pattern: str, *, folder: bool) -> Diagnostic:
    """No file fits ``pattern``; ``folder``: its folder is there."""
    said = f"no file fits the pattern `{short_text(pattern)}`" + ("" if folder else ": its folder does not exist")
    return Diagnostic(code=NO_MATCH, message=said, place=place, hint="check the pattern")


def pattern_in_folder(place: Place, pattern: str) -> Diagnostic:
    """``pattern`` leaves the folder open."""
    message = f"`{short_text(pattern)}` has a `*` or `?` in the name of a folder"
    hint = "a pattern stands in the name of the file; read each folder by a clause of its own, then `(union A B …)`"
    return Diagnostic(code=BAD_PATTERN, message=message, place=place, hint=hint)


def same_source(place: Place, first: str, second: str, name: str) -> Diagnostic:
    """Two files that fit a pattern would be told by the same ``name`` in the table."""
    message = (
        f"the pattern fits `{short_text(first)}` and `{short_text(second)}`, whose rows would both be told by the name"
        f" `{short_text(name)}`"
    )
    return Diagnostic(code=BAD_PATTERN, message=message, place=place, hint="write the ending into the pattern")


def told_alike(place: Place, first: str, second: str, name: str) -> Diagnostic:
    """Rows of two tables that go into a union have the same ``name`` in the column ``source``."""
    message = f"rows of `{short_text(first)}` and of `{short_text(second)}` would both be told by the name `{name}`"
    return Diagnostic(
        code=BAD_PATTERN, message=message, place=place, hint="name each table once, and give the files different names"
    )


def too_many_matches(place: Place, pattern: str, most: int) -> Diagnostic:
    """``pattern`` fits more than ``most`` files."""
    return Diagnostic(
        code=TOO_MANY_MATCHES,
        message=f"more than {most:,} files fit the pattern `{short_text(pattern)}`",
        place=place,
        hint="narrow the pattern",
    )
