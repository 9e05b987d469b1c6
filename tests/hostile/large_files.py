"""Data files that are large, unpack to much, or hold many names, columns, digits or levels."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.hostile.data_files import PACKERS, SOURCES, problem, sound
from tests.hostile.sizes import digits, size
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home

CHUNK = 1 << 20
LONGEST = 10_000_000
"""Bytes that are written for one case. Sound rows are work in proportion: a solve of three times as many, which are a
million, takes some four seconds."""
ROWS_AT_ONCE = 1 << 20


def _tiled(kind: str, choices: Choices) -> bytes:
    """The last line of a sound file, again and again."""
    *head, last = sound(kind).splitlines(keepends=True)
    return b"".join(head) + last * size(choices, 1, LONGEST // len(last))


def _wide(kind: str, choices: Choices) -> bytes:
    """Many columns, long cells, or long numbers."""
    comma = {"csv": ",", "tsv": "\t"}.get(kind, " ")
    match choices.below(4):
        case 0:
            count = size(choices, 10, 300_000)
            return "\n".join((comma.join(f"c{i}" for i in range(count)), comma.join("1" * count))).encode()
        case 1:
            return sound(kind) + b"9" * size(choices, 10, LONGEST)
        case 2:
            return sound(kind) + b'"' + b"a\n" * size(choices, 10, LONGEST // 2)
        case _:
            return sound(kind) + comma.join((digits(choices, 1_000_000), "1", "p")).encode()


def _lines(kind: str, choices: Choices) -> bytes:
    return _wide(kind, choices) if choices.chance(2) else _tiled(kind, choices)


def _json(choices: Choices) -> bytes:
    count = size(choices, 10, 300_000)
    match choices.below(7):
        case 0:
            return json.dumps({"x": [1], "y": [2]} | {f"n{i}": [1] for i in range(count)}).encode()
        case 1:
            return json.dumps([{f"n{i}": 1.0} for i in range(count)]).encode()
        case 2:
            return (
                f'{{{", ".join(f"{chr(34)}n{i}{chr(34)}: [1]" for i in range(count))}, "n{count - 1}": [1]}}'.encode()
            )
        case 3:
            opening = choices.one_of(("[", '{"x": ', '{"x": [', "[[1], "))
            return (opening * count).encode()
        case 4:
            return f'{{"x": [{digits(choices, 1_000_000)}], "y": [1]}}'.encode()
        case 5:
            return json.dumps({"x": list(range(count)), "y": [0.5] * count}).encode()
        case _:
            return json.dumps({"x": ["é" * count, "p"], "y": [1, 2]}, ensure_ascii=choices.chance(2)).encode()


def _npz(choices: Choices) -> bytes:
    """Arrays that unpack to as much as they say, to more, or to less; or many of them."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        if choices.chance(4):
            for i in range(size(choices, 10, 30_000)):
                file.writestr(f"n{i}.npy", b"")
            return stream.getvalue()
        count = size(choices, 1000, 500_000_000)
        said = choices.one_of((count, count, count, 10 * count, 1))
        kind, width = choices.one_of((("<f8", 8), ("|i1", 1), ("<U100", 400), ("<i4", 4), ("|b1", 1)))
        many = min(count // width, said)
        for name in "xy":
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(
                header, {"descr": kind, "fortran_order": choices.chance(4), "shape": (many,)}
            )
            with file.open(f"{name}.npy", "w", force_zip64=True) as part:
                part.write(header.getvalue())
                for _ in range(count // CHUNK + 1):
                    part.write(bytes(CHUNK))
    return stream.getvalue()


def _parquet(choices: Choices) -> bytes:
    """Up to a billion rows in few bytes, or many columns."""
    import pyarrow
    from pyarrow import parquet

    stream = io.BytesIO()
    if choices.chance(4):
        columns = {f"c{i}": [1.0] for i in range(size(choices, 10, 10_000))}
        parquet.write_table(pyarrow.table({"x": [1.0], "y": [2.0], **columns}), stream)
        return stream.getvalue()
    rows = size(choices, 1000, 1_000_000_000)
    part = min(rows, ROWS_AT_ONCE)
    values = choices.one_of((pyarrow.array(np.zeros(part)), pyarrow.nulls(part), pyarrow.array(np.zeros(part, bool))))
    table = pyarrow.table({"x": values, "y": values})
    with parquet.ParquetWriter(stream, table.schema, compression="zstd") as writer:
        for _ in range(rows // part):
            writer.write_table(table)
    return stream.getvalue()


MAKERS: dict[str, Callable[[Choices], bytes]] = {"json": _json, "npz": _npz, "parquet": _parquet}


def large_file(here: Home, choices: Choices) -> Case:
    """A table of much: as it is, or packed."""
    folder = here.cleared("case")
    kind = choices.one_of(tuple(SOURCES))
    match choices.below(6):
        case 0 if kind not in MAKERS:
            return _packed(folder, kind, choices)
        case 1:
            return _hollow(folder, kind, choices)
    make = MAKERS.get(kind)
    content = _lines(kind, choices) if make is None else make(choices)
    return _read(folder, folder / f"d.{kind}", content, kind, choices)


def _packed(folder: Path, kind: str, choices: Choices) -> Case:
    """Up to 10 GB of lines in a file of less than 10 MB: files one behind the other unpack as one."""
    ending = choices.one_of(tuple(PACKERS))
    *head, last = sound(kind).splitlines(keepends=True)
    pack, lines = PACKERS[ending], last * (CHUNK // len(last))
    content = pack(b"".join(head)) + pack(lines) * size(choices, 1, 10_000)
    return _read(folder, folder / f"d.{kind}{ending}", content, kind, choices, ending)


def _hollow(folder: Path, kind: str, choices: Choices) -> Case:
    """A file of up to a terabyte that takes no room."""
    case = _read(folder, folder / f"d.{kind}", b"", kind, choices)
    place = choices.one_of((folder / f"d.{kind}", folder / f"d.{kind}", folder / "p.mbm"))
    with place.open("ab") as stream:
        stream.truncate(size(choices, 1000, 10**12))
    return Case(arguments=case.arguments, files=tuple(path for path in case.files if path != place))


def _read(folder: Path, table: Path, content: bytes, kind: str, choices: Choices, ending: str = "") -> Case:
    table.write_bytes(content)
    file = folder / "p.mbm"
    file.write_text(problem(kind, ending), encoding="utf-8")
    command = choices.one_of(
        (("check",), ("check", "--json", "-"), ("solve", "--backend", "numpy"), ("solve", "--json", "-"))
    )
    return Case(arguments=(*command, str(file)), files=(file,), kept=(file, table))
