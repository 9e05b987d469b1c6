"""What may be wrong with a table: its file, its columns, its cells, its keys. ``readers.faults`` has the formats."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.files import faults as file_faults
from mbm.problem.tables import CellKey
from mbm.text.faults import shown
from mbm.text.suggest import suggestion
from mbm.text.types import Code, DataPlace, Diagnostic, Label, Place

LONGEST_CELL_SHOWN = 40
MOST_NAMES_SHOWN = 12
MOST_ROWS_REPORTED = 5
"""Rows of a table, or lines of a file, that are said to be wrong at once."""

EMPTY_FILE = Code(
    "empty-file",
    "A data file holds nothing, not even the names of its columns.",
    "Look whether the program that wrote the file came to its end. A table without rows still has a header.",
)
DAMAGED_ARCHIVE = Code(
    "damaged-archive",
    "A file whose name ends in .gz, .bz2 or .xz cannot be unpacked: it is cut short, damaged, or not packed at all.",
    "Fetch or pack it anew, or correct the ending of its name.",
)
NOT_TEXT = Code(
    "not-text",
    "A file of a text format is not UTF-8 text: it is a binary file, or a text in another encoding.",
    "Save it as UTF-8, or name the format that it has.",
)
OUTSIDE_SANDBOX = Code(
    "outside-sandbox",
    "A data file lies outside the folder that `--sandbox` confines reads to, symbolic links followed.",
    "Move the file into the folder, or name a wider one.",
)
UNKNOWN_FORMAT = Code(
    "unknown-format",
    "The ending of a file name tells no format, and the data clause names none either.",
    "Rename the file, or name the format in the data clause: `(data NAME (csv …))`.",
)
MISSING_TABLE = Code(
    "missing-table",
    "A data clause says `external`, but no table was given.",
    "Give it with `--data NAME=PATH`, or in Python with `solve(data={…})`.",
)
UNDECLARED_TABLE = Code(
    "undeclared-table",
    "A table was given by name, but the problem has no data clause of that name: it would not be used.",
    "Correct the name, or add the data clause `(data NAME external)`.",
)
NOT_A_TABLE = Code(
    "not-a-table",
    "What was given as a table is none of: a data frame, a dict of arrays, a structured array, a list of dicts.",
    "Give the columns by name, for example as a dict of arrays.",
)
BAD_COLUMN_NAME = Code(
    "bad-column-name",
    "A column has no name, or one that is not a text. What has no name cannot be meant by an equation.",
    "Give every column a name. Row numbers that R or pandas write as a first column can be left out when writing.",
)
DUPLICATE_COLUMN = Code(
    "duplicate-column",
    "Two columns of one table have the same name, so that a use of it could mean either.",
    "Rename one of them, in the file or with `:columns`.",
)
NO_COLUMNS = Code(
    "no-columns",
    "A table has no column at all.",
    "Look at what was written to the file, or at what was given.",
)
TOO_MANY_COLUMNS = Code(
    "too-many-columns",
    "A table has more columns than any problem names.",
    "Leave out the columns that the problem does not use, or write what they hold as rows: one column for what the"
    " names say now, one for the values.",
)
MISSING_COLUMN = Code(
    "missing-column",
    "A data clause names a column that the table does not have. Names are case-sensitive.",
    "Correct the name. `:columns` names columns as the file does, `:key` as the problem does.",
)
UNEQUAL_LENGTHS = Code(
    "unequal-lengths",
    "The columns of a table have different lengths, so that the rows are not known.",
    "Give every column a value for each row, NaN where there is none.",
)
SHORT_ROW = Code(
    "short-row",
    "A row has fewer cells than the table has columns. Which ones are missing is not known, so none is guessed.",
    "Complete the row. An empty cell is written as nothing between two separators.",
)
LONG_ROW = Code(
    "long-row",
    "A row has more cells than the table has columns.",
    "Remove what is too much. A text with a separator in it must stand in double quotes, a decimal comma must be a"
    " point.",
)
BAD_CELL = Code(
    "bad-cell",
    "A cell is neither a number nor a text (but a list, another object, or a truth value among others).",
    "Write numbers or texts: 0 and 1 for truth values, seconds since a start for times, one column for each element.",
)
BAD_ARRAY = Code(
    "bad-array",
    "An array is no column of numbers or texts: it has not exactly one dimension, or cells of another type.",
    "Give one-dimensional arrays of numbers or texts, one for each column. Leave out a column that nothing uses.",
)
NOT_A_NUMBER = Code(
    "not-a-number",
    "A column that has a unit holds a cell that is no number. A column is numeric only if all its cells are.",
    "Correct the cell. A decimal point is a point, digits are not grouped, and units stand in the data clause.",
)
EMPTY_COLUMN = Code(
    "empty-column",
    "`:missing skip` would leave out every row, because a column has no value in any of them.",
    "Remove the column from the file, or give its values.",
)
MISSING_KEY = Code(
    "missing-key",
    "A row has an empty cell in the key column, so that nothing can refer to the row.",
    "Fill in the key, or remove the row.",
)
DUPLICATE_KEY = Code(
    "duplicate-key",
    "Two rows of a table have the same key, so that what refers to the key could mean either.",
    "Remove one of the rows, or choose a key that differs in all rows.",
)


def short_text(cell: str | None) -> str:
    """A piece of a file as messages show it, cut short."""
    return shown(cell or "", LONGEST_CELL_SHOWN)


def _names(names: Iterable[str]) -> str:
    every = [f"`{short_text(name)}`" for name in names]
    more = len(every) - MOST_NAMES_SHOWN
    return ", ".join(every[:MOST_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def table_of_cells(path: str, cells: int) -> str:
    """What a message about memory calls a table of so many cells."""
    return f"a table of {cells:,} cells (`{short_text(path)}`)"


def unpacks_too_large(place: DataPlace, packed: int, largest: int) -> Diagnostic:
    """A compressed file of ``packed`` bytes with more than ``largest`` bytes in it."""
    return Diagnostic(
        code=file_faults.FILE_TOO_LARGE,
        message=f"the {packed:,} bytes of `{place.file}` unpack to more than the {largest:,} that are read of them",
        place=place,
    )


def empty_file(place: DataPlace) -> Diagnostic:
    """Nothing in the file."""
    return Diagnostic(code=EMPTY_FILE, message=f"the file `{place.file}` is empty", place=place)


def damaged_archive(place: DataPlace, reason: str) -> Diagnostic:
    """A compressed file that does not unpack; ``reason`` is what the unpacker says."""
    return Diagnostic(
        code=DAMAGED_ARCHIVE,
        message=f"the compressed file `{place.file}` cannot be unpacked: {reason or 'it is damaged'}",
        place=place,
    )


def not_text(place: DataPlace, byte: int) -> Diagnostic:
    """``byte`` at ``place`` does not belong to UTF-8 text; 0 marks binary files."""
    said = "it holds NUL bytes, as binary files and UTF-16 do" if byte == 0 else f"byte 0x{byte:02x} is not UTF-8"
    return Diagnostic(
        code=NOT_TEXT, message=f"`{place.file}` is not a text file: in row {place.row} {said}", place=place
    )


def outside_sandbox(place: Place, path: str, sandbox: str) -> Diagnostic:
    """``path`` leads out of the folder ``sandbox``."""
    return Diagnostic(
        code=OUTSIDE_SANDBOX,
        message=f"the file `{path}` lies outside `{sandbox}`, and reads are confined to that folder",
        place=place,
    )


def unknown_format(place: Place, path: str, extensions: Iterable[str]) -> Diagnostic:
    """No reader claims the ending of ``path``; ``extensions`` are those that some reader claims."""
    return Diagnostic(
        code=UNKNOWN_FORMAT,
        message=f"the format of `{path}` is not known: the endings that are read are {_names(extensions)}",
        place=place,
    )


def missing_table(place: Place, table: str) -> Diagnostic:
    """``external`` and nothing given."""
    return Diagnostic(
        code=MISSING_TABLE,
        message=f"the table `{table}` is external, and none was given",
        place=place,
        hint=f'give it with `--data {table}=PATH`, or in Python with `data={{"{table}": …}}`',
    )


def undeclared_table(table: str, declared: Iterable[str]) -> Diagnostic:
    """A table given under a name that no data clause has."""
    names = tuple(declared)
    has = f"it has {_names(names)}" if names else "it has no data clause"
    return Diagnostic(
        code=UNDECLARED_TABLE,
        message=f"a table `{table}` was given, but the problem has no data clause of that name; {has}",
        hint=suggestion(table, names, None),
    )


def not_a_table(place: DataPlace, what: str) -> Diagnostic:
    """``what`` was given where a table is wanted."""
    return Diagnostic(
        code=NOT_A_TABLE,
        message=f"a table cannot be made of {what}",
        place=place,
        hint="give a data frame, a dict of arrays, a structured array or a list of dicts",
    )


def bad_column_name(place: Place, position: int, name: object) -> Diagnostic:
    """The column at ``position`` (from 1) is called ``name``, which is empty or no text."""
    said = "has no name" if name == "" else f"is called {short_text(repr(name))}, which is not a text"
    return Diagnostic(code=BAD_COLUMN_NAME, message=f"column {position} {said}", place=place)


def duplicate_column(place: Place, column: str) -> Diagnostic:
    """Two columns called ``column``."""
    return Diagnostic(code=DUPLICATE_COLUMN, message=f"two columns are called `{short_text(column)}`", place=place)


def no_columns(place: Place) -> Diagnostic:
    """Nothing to make a table of."""
    return Diagnostic(code=NO_COLUMNS, message="the table has no columns", place=place)


def too_many_columns(place: Place, columns: int, most: int) -> Diagnostic:
    """A table with more columns than are read."""
    return Diagnostic(
        code=TOO_MANY_COLUMNS,
        message=f"the table has {columns:,} columns, more than the {most:,} that are read",
        place=place,
    )


def missing_column(place: Place, column: str, path: str, present: Iterable[str]) -> Diagnostic:
    """The table read from ``path`` has the columns ``present``, ``column`` is not among them."""
    names = tuple(present)
    return Diagnostic(
        code=MISSING_COLUMN,
        message=f"`{path}` has no column `{short_text(column)}`; it has {_names(names)}",
        place=place,
        hint=suggestion(column, names, None),
    )


def unequal_lengths(place: DataPlace, first: str, length: int, other: str, other_length: int) -> Diagnostic:
    """Columns ``first`` and ``other`` differ in length."""
    return Diagnostic(
        code=UNEQUAL_LENGTHS,
        message=f"column `{short_text(other)}` has {other_length} cells, column `{short_text(first)}` has {length}",
        place=place,
    )


def short_row(place: Place, row: int, cells: int, columns: tuple[str, ...]) -> Diagnostic:
    """Row ``row`` has only ``cells`` cells."""
    message = (
        f"row {row} is blank" if cells == 0 else f"row {row} has {cells} cells, but there are {len(columns)} columns"
    )
    hint = (
        f"nothing stands for `{short_text(columns[cells])}`" if cells else "only blank lines at the end are passed over"
    )
    return Diagnostic(code=SHORT_ROW, message=message, place=place, hint=hint)


def long_row(place: Place, row: int, cells: int, columns: tuple[str, ...]) -> Diagnostic:
    """Row ``row`` has ``cells`` cells, more than there are columns."""
    return Diagnostic(
        code=LONG_ROW, message=f"row {row} has {cells} cells, but there are only {len(columns)} columns", place=place
    )


def bad_cell(place: DataPlace, what: str) -> Diagnostic:
    """A cell holds ``what``."""
    return Diagnostic(
        code=BAD_CELL,
        message=f"row {place.row}, column `{short_text(place.column)}` holds {what}, neither a number nor a text",
        place=place,
    )


def bad_array(place: DataPlace, what: str) -> Diagnostic:
    """A column is ``what``."""
    return Diagnostic(
        code=BAD_ARRAY,
        message=f"column `{short_text(place.column)}` is {what}, not a one-dimensional array of numbers or texts",
        place=place,
    )


def not_a_number(place: DataPlace, cell: str, unit: str, declared: Place) -> Diagnostic:
    """A text ``cell`` in a column that the data clause reads in ``unit``."""
    message = (
        f"row {place.counted}, column `{short_text(place.column)}` holds the text `{short_text(cell)}`, not a number"
    )
    label = Label(declared, f"read in `{unit}` here")
    return Diagnostic(code=NOT_A_NUMBER, message=message, place=place, labels=(label,))


def empty_column(place: DataPlace) -> Diagnostic:
    """``:missing skip`` and a column of gaps only."""
    message = (
        f"column `{short_text(place.column)}` has no value in any row, so `:missing skip` would leave out all of them"
    )
    return Diagnostic(code=EMPTY_COLUMN, message=message, place=place)


def missing_key(place: DataPlace) -> Diagnostic:
    """A gap in the key column."""
    return Diagnostic(
        code=MISSING_KEY,
        message=f"row {place.counted} has no key: its cell in column `{short_text(place.column)}` is empty",
        place=place,
    )


def duplicate_key(place: DataPlace, first: DataPlace, key: CellKey) -> Diagnostic:
    """The row at ``place`` has the ``key`` that the row ``first`` has."""
    same = short_text(key) if isinstance(key, str) else format(key, ".17g")
    rows = f"rows {first.counted} and {place.counted}"
    if first.file != place.file:
        rows = f"row {first.counted} of `{first.file}` and row {place.counted} of `{place.file}`"
    return Diagnostic(
        code=DUPLICATE_KEY,
        message=f"{rows} have the same key `{same}` in column `{short_text(place.column)}`",
        place=place,
        labels=(Label(first, "first here"),),
    )
