"""What may be wrong with a file of a format: the text in it, its header and rows, its shape, its records."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.text.shown import cut
from mbm.text.suggest import suggestion
from mbm.text.types import Code, DataPlace, Diagnostic

MISSING_HEADER = Code(
    "missing-header",
    "The first row is blank or holds nothing but numbers, where the names of the columns are expected. Numbers read as"
    " names would be lost as data.",
    "Add a first row with the names of the columns.",
)
WRONG_SEPARATOR = Code(
    "wrong-separator",
    "The header is one single cell with another separator in it than the format has.",
    "Save the file with the separator of its format, or name the other format: `csv` has commas, `tsv` tabulators.",
)
COMMENT_LINE = Code(
    "comment-line",
    "A line starts with `#`. Neither CSV nor TSV have comments, and a key may well start so: nothing is passed over.",
    "Remove the line. A header behind a `#` must stand without it.",
)
BAD_QUOTES = Code(
    "bad-quotes",
    "The double quotes around a cell do not match, so that the ends of cells and rows are not known.",
    'Close every quoted cell; a quote within it is written twice: `"a 5"" pipe"`.',
)
MALFORMED_JSON = Code(
    "malformed-json",
    "A file does not follow the rules of JSON.",
    "Correct it at the line and column named, or write it anew with a program.",
)
WRONG_JSON_SHAPE = Code(
    "wrong-json-shape",
    "A JSON file is well-formed, but no table: a list of objects, an object of arrays, or"
    ' `{"columns": […], "data": [[…], …]}`.',
    "Write it in one of these shapes.",
)
MALFORMED_NPZ = Code(
    "malformed-npz",
    "A file is not an archive of NumPy arrays as `numpy.savez` writes it, or it is damaged.",
    "Write it anew with `numpy.savez(path, x=…, y=…)`.",
)
MALFORMED_RECORD = Code(
    "malformed-record",
    "A line or record of a format with a fixed layout (`tum`, `kitti`, `euroc`, `bal`, `g2o`, `colmap`, `bundler`) does"
    " not hold what belongs there.",
    "Correct the line, or name the format that the file has.",
)
MIXED_RECORDS = Code(
    "mixed-records",
    "A graph holds records of different kinds, poses of the plane and of space or landmarks, which one table cannot"
    " hold together.",
    "Write the kinds to files of their own.",
)
NO_RECORDS = Code(
    "no-records",
    "A file holds no record of the kind that the data clause asks for.",
    "Ask for another part of the file, or name the right file.",
)
MALFORMED_PARQUET = Code(
    "malformed-parquet",
    "A file is no Parquet file, or it is damaged.",
    "Write it anew, for example with `to_parquet` of a data frame.",
)
MALFORMED_YAML = Code(
    "malformed-yaml",
    "A file does not follow the rules of YAML, or not those of the format that is written in it (`opencv`, `kalibr`).",
    "Correct it at the line named, or write it anew with the program that it comes from.",
)
NO_NODE = Code(
    "no-node",
    "A file has no node of the name that a data clause asks for.",
    "Correct the name. Nodes within nodes have their names with points between them: `left.camera_matrix`.",
)
MALFORMED_BAG = Code(
    "malformed-bag",
    "A file is no log of ROS (`.bag` of ROS 1, `.mcap`), or it is damaged.",
    "Record it anew, or repair it: `rosbag reindex`, `mcap recover`.",
)
NO_TOPIC = Code(
    "no-topic",
    "A log has no topic of the name that a data clause asks for, or its messages are of a type that makes no table.",
    "Correct the name; what a log holds is listed by `rosbag info` or `mcap info`.",
)
LONGEST_SHOWN = 40
MOST_NODES = 12
LONGEST_REASON = 160


def shown(text: str) -> str:
    """A piece of a file as messages show it: in backticks, and cut short."""
    return f"`{cut(text, LONGEST_SHOWN)}`"


def missing_header(place: DataPlace, said: str) -> Diagnostic:
    """The first row has no names: it ``holds only numbers`` or ``is blank``."""
    return Diagnostic(
        code=MISSING_HEADER,
        message=f"the first row of `{place.file}` {said}, where the names of the columns are expected",
        place=place,
    )


def wrong_separator(place: DataPlace, wanted: str, found: str) -> Diagnostic:
    """``found`` separates the names of the header, not ``wanted``."""
    return Diagnostic(
        code=WRONG_SEPARATOR,
        message=f"the columns of `{place.file}` are separated by {found}, where {wanted} are expected",
        place=place,
    )


def comment_line(place: DataPlace) -> Diagnostic:
    """A row that starts with ``#`` and is no row of the table."""
    return Diagnostic(
        code=COMMENT_LINE, message=f"row {place.row} starts with `#`, and this format has no comments", place=place
    )


def bad_quotes(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` is what the parser of rows says."""
    return Diagnostic(code=BAD_QUOTES, message=f"row {place.row} cannot be split into cells: {reason}", place=place)


def malformed_json(place: DataPlace, reason: str, column: int | None = None) -> Diagnostic:
    """``reason`` is what the JSON parser says; ``column`` counts characters from 1, the place's row counts lines."""
    where = "" if column is None else f" at line {place.row}, column {column}"
    return Diagnostic(code=MALFORMED_JSON, message=f"`{place.file}` is not JSON{where}: {reason}", place=place)


def wrong_json_shape(place: DataPlace, what: str) -> Diagnostic:
    """``what`` was found."""
    return Diagnostic(
        code=WRONG_JSON_SHAPE,
        message=f"`{place.file}` holds no table: {what}",
        place=place,
        hint='a table is a list of objects, an object of arrays, or `{"columns": […], "data": [[…], …]}`',
    )


def malformed_npz(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what is wrong with the archive."""
    return Diagnostic(code=MALFORMED_NPZ, message=f"`{place.file}` is no archive of arrays: {reason}", place=place)


def malformed_record(place: DataPlace, reason: str, unit: str = "line") -> Diagnostic:
    """``reason`` says what is wrong with the line (or another ``unit``), or the file, at ``place``."""
    where = f"`{place.file}`" if place.row is None else f"{unit} {place.row} of `{place.file}`"
    return Diagnostic(code=MALFORMED_RECORD, message=f"{where}: {reason}", place=place)


def mixed_records(place: DataPlace, tag: str, other: str, row: int) -> Diagnostic:
    """``tag`` stands at ``place``, the record ``other`` of another kind in line ``row``."""
    return Diagnostic(
        code=MIXED_RECORDS,
        message=f"line {place.row} of `{place.file}` is a {shown(tag)}, line {row} a {shown(other)}",
        place=place,
        hint="write the kinds to files of their own",
    )


def no_records(place: DataPlace, what: str) -> Diagnostic:
    """``what`` are not in the file."""
    return Diagnostic(code=NO_RECORDS, message=f"`{place.file}` holds no {what}", place=place)


def malformed_yaml(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what is wrong with the line, or the file, at ``place``."""
    where = f"`{place.file}`" if place.row is None else f"line {place.row} of `{place.file}`"
    return Diagnostic(code=MALFORMED_YAML, message=f"{where}: {reason}", place=place)


def no_node(place: DataPlace, name: str, part: str, known: Iterable[str]) -> Diagnostic:
    """There is no ``part`` of the node ``name`` among the ``known`` ones."""
    known = tuple(known)
    listed = ", ".join(shown(each) for each in known[:MOST_NODES])
    near = suggestion(part, known, f"there are {listed}" if known else "there are none within it")
    return Diagnostic(code=NO_NODE, message=f"`{place.file}` has no node {shown(name)}", place=place, hint=near)


def malformed_bag(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what the library found."""
    return Diagnostic(
        code=MALFORMED_BAG,
        message=f"`{place.file}` is no log of ROS that can be read: {cut(reason, LONGEST_REASON)}",
        place=place,
    )


def no_topic(place: DataPlace, name: str, known: Iterable[str]) -> Diagnostic:
    """There is no topic ``name`` among the ``known`` ones."""
    known = tuple(known)
    listed = ", ".join(shown(each) for each in known[:MOST_NODES])
    near = suggestion(name, known, f"there are {listed}" if known else "it has no topics")
    return Diagnostic(code=NO_TOPIC, message=f"`{place.file}` has no topic {shown(name)}", place=place, hint=near)


def other_messages(place: DataPlace, name: str, kind: str, known: Iterable[str]) -> Diagnostic:
    """The messages of the topic ``name`` are of a ``kind`` that is not among those that make tables."""
    message = f"the messages of {shown(name)} in `{place.file}` are of the type {shown(kind)}, which makes no table"
    return Diagnostic(code=NO_TOPIC, message=message, place=place, hint=f"types that do are {', '.join(known)}")


def malformed_parquet(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what the library found."""
    return Diagnostic(code=MALFORMED_PARQUET, message=f"`{place.file}` is no Parquet file: {reason}", place=place)
